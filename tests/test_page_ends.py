"""Pages at the ends of their sliders: every one is drawn, and says what Python says."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import spherekit as sk
from spherekit.display.pages.page import PageMaker
from spherekit.files.mechanism_reader import loads
from spherekit.mechanism.elements import Input
from spherekit.mechanism.load_kinds import JointLimit, Spring

FILES = Path(__file__).parent / "files"
CASES = (
    *("ends", "flat_pose", "cp2", "parallelogram", "folding", "ff_default", "arcs"),
    *("falseclaim", "flatfold_through", "posed_slider", "wiper", "bound_a"),
    *("planar_limit", "coaxial_wrist", "massless_crank"),
)
EVERY_PAGE = [*(str(FILES / f"{name}.toml") for name in CASES), *sk.mechanisms()]
EVERY_PAGE.sort(key=lambda name: not name.endswith("ends.toml"))
"""Files that showed faults, and all shipped mechanisms; the first is opened by default."""

DRIVE_TO_ENDS = """async () => {
  const picture = () => new Promise(done => requestAnimationFrame(done));
  const sliders = [...document.querySelectorAll("input[type=range]")], troubles = [];
  const move = (slider, value) => {
    slider.value = value;
    slider.dispatchEvent(new Event("input"));
  };
  const look = async what => {
    await picture();
    await picture();
    const said = document.getElementById("trouble").textContent;
    if (said) troubles.push(`${what}: ${said}`);
  };
  for (const slider of sliders) {
    const before = slider.value;
    const name = slider.closest(".row").querySelector("label").title;
    for (const end of ["min", "max"]) {
      move(slider, slider[end]);
      await look(`${name} at its ${end}`);
    }
    move(slider, before);
  }
  for (const end of ["min", "max"]) {
    for (const slider of sliders) move(slider, slider[end]);
    await look(`all sliders at their ${end}`);
  }
  document.getElementById("reset").click();
  for (const choice of document.querySelectorAll("#modes input")) {
    choice.click();
    await look(`mode ${choice.value}`);
  }
  return troubles;
}"""
"""Moves every slider alone to both ends, then all of them, and chooses every mode."""


@pytest.fixture
def open_page(browser, tmp_path):
    """Opens the page of a mechanism; nothing may be said in the console."""
    messages = []
    tabs = []

    def opener(mechanism, fragment="", **options):
        path = tmp_path / "page.html"
        sk.page(mechanism, path, **options)
        tab = browser.new_page(viewport={"width": 1300, "height": 900})
        tabs.append(tab)
        tab.on("console", lambda message: messages.append(message.text))
        tab.on("pageerror", lambda error: messages.append(str(error)))
        tab.goto(f"{path.as_uri()}#{fragment}")
        tab.wait_for_timeout(300)
        tab.messages = messages
        return tab

    yield opener
    for tab in tabs:
        tab.close()
    assert not messages


def set_number(tab, row, value):
    """Type a number into the field of a slider, by the title of its label."""
    field = tab.locator(f".row:has(label[title='{row}']) input[type=number]")
    field.fill(str(value))
    field.press("Enter")
    tab.wait_for_timeout(100)


def curve(tab, mode):
    """What the page has of a mode along its input: x, whether it closes, marks."""
    return tab.evaluate(
        f"""(({{x, values, ends, meets, beyond}}) =>
        ({{x, closes: values.map(Boolean), ends, meets, beyond}}))
        (spherekit.modes[{mode}].curve)"""
    )


@pytest.mark.slow
@pytest.mark.many(slow=20)
@pytest.mark.parametrize("name", EVERY_PAGE, ids=lambda name: Path(name).stem)
def test_a_page_is_drawn_at_every_end_of_every_slider(open_page, name):
    tab = open_page(name)
    assert tab.evaluate(DRIVE_TO_ENDS) == []


@pytest.mark.slow
def test_the_stephenson_with_a_long_crank(open_page):
    """The inner dyad ends before the outer one, whose square is not a number there."""
    tab = open_page("stephenson", "links.2.arc=46")
    assert tab.inner_text("#trouble") == ""
    changed = sk.load("stephenson").with_sizes(angle_unit="deg", arcs={"2": 46.0})
    assert_same_ranges(tab, changed)


def assert_same_ranges(tab, mechanism, tolerance=1e-7):
    """Modes end on the page where, by bisection, those of `evaluate` end."""
    numbers = tab.evaluate("spherekit.modeNumbers")
    for place, number in enumerate(numbers):
        of_page = np.sort(curve(tab, place)["ends"])
        # The page may find a gap that is narrower than the samples of the bisection.
        between = 0.5 * (of_page[1:] + of_page[:-1])
        exact = ends_by_bisection(mechanism, number, between)
        assert len(of_page) == len(exact), (number, of_page, exact)
        assert np.allclose(of_page, exact, rtol=0.0, atol=tolerance)


def ends_by_bisection(mechanism, number, more=()):
    """Return the inputs (rad) at which a mode begins or ends, all bisected at once.

    Samples are at degrees of the range, and at `more` inputs.
    """
    x = np.linspace(*mechanism.inputs[0].range, 361)[1:-1]
    x = np.unique(np.concatenate([x, more]))
    closes = evaluate_closes(mechanism, x, number)
    changes = np.flatnonzero(closes[1:] != closes[:-1])
    low, high, closes_at_low = x[changes], x[changes + 1], closes[changes]
    for _ in range(28 if len(changes) else 0):
        middle = 0.5 * (low + high)
        is_low = evaluate_closes(mechanism, middle, number) == closes_at_low
        low, high = np.where(is_low, middle, low), np.where(is_low, high, middle)
    return low


def evaluate_closes(mechanism, x, number):
    """Return whether a mode closes at inputs, singular configurations included."""
    rows = sk.evaluate(mechanism, x, poles=[], assembly_mode=number)
    return np.isin(rows.status, [sk.Status.OK, sk.Status.AT_SINGULARITY])


@pytest.mark.slow
@pytest.mark.many(slow=3)
@pytest.mark.parametrize("seed", range(8))
def test_modes_of_random_six_bars_end_where_evaluate_says(open_page, seed):
    """Both dyads of a Stephenson or a Watt chain fail somewhere in most of these."""
    rng = np.random.default_rng(seed)
    chain = sk.load("stephenson" if seed % 2 else "watt")
    sizes = {
        link: replace(
            size,
            arcs=tuple(np.radians(rng.uniform(20.0, 120.0, len(size.arcs)))),
            angles=tuple(np.radians(rng.uniform(-160.0, 160.0, len(size.angles)))),
        )
        for link, size in chain.geometry.links.items()
    }
    changed = replace(
        chain, geometry=replace(chain.geometry, links=sizes), modes={}, loads=()
    )
    try:
        tab = open_page(changed, vary=[])
    except sk.SpherekitError:
        pytest.skip("these sizes have no assembly mode")
    assert_same_ranges(tab, changed)


def four_bar(arcs, **changes):
    """Return a four-bar with these arcs (deg) of ground, crank, coupler and rocker."""
    sizes = dict(zip("1234", arcs, strict=True))
    return replace(
        sk.load("four_bar").with_sizes(angle_unit="deg", arcs=sizes), modes={}, **changes
    )


NARROW = [(70.0, 30.0, 60.0, 40.002), (70.0, 30.0, 60.0, 39.998)]
"""Ground, crank, coupler and rocker (deg) near a change point: 70 + 30 = 60 + 40."""


@pytest.mark.many
@pytest.mark.parametrize("arcs", NARROW)
def test_a_gap_between_two_samples_is_found(open_page, arcs):
    """The crank turns fully, or not by half a degree; samples are two degrees apart."""
    tab = open_page(four_bar(arcs), vary=[])
    ground, crank, coupler, rocker = np.radians(arcs)
    folded = np.cos([coupler - rocker, coupler + rocker])
    cosine = (folded - np.cos(ground) * np.cos(crank)) / (np.sin(ground) * np.sin(crank))
    angle = np.pi - np.arccos(-cosine[np.abs(cosine) < 1.0])
    exact = np.sort(np.concatenate([angle, 2.0 * np.pi - angle]))
    for mode in range(2):
        of_page = curve(tab, mode)
        ends = np.sort(of_page["ends"])
        assert len(ends) == len(exact) and np.allclose(ends, exact, rtol=0.0, atol=1e-7)
        gaps = sum(not closes for closes in of_page["closes"])
        assert bool(gaps) == bool(len(exact)) and not of_page["meets"]


@pytest.mark.many
@pytest.mark.parametrize(("name", "where"), [("cp2", 180.0), ("parallelogram", 180.0)])
def test_modes_that_meet_are_marked_and_do_not_end(open_page, name, where):
    path = str(FILES / f"{name}.toml")
    tab = open_page(path, vary=[])
    for mode in range(2):
        of_page = curve(tab, mode)
        assert not of_page["ends"]
        x, closes = np.array(of_page["x"]), np.array(of_page["closes"])
        assert np.all(closes[np.min(np.abs(x[:, None] - of_page["meets"]), axis=1) > 1e-6])
        assert np.min(np.abs(np.array(of_page["meets"]) - np.radians(where))) < 1e-6
    set_number(tab, f"input {sk.load(path).inputs[0].pair}", where)
    assert tab.inner_text("#lost") == "modes meet here"
    values = tab.locator("#values td[data-name]").all_inner_texts()
    assert values and set(values) == {"–"}
    assert tab.inner_text("#trouble") == ""


CONSTANT = [
    ("four_bar", {"input_pair": "41"}),
    ("planetary_bevel", {}),
    ("rolling_cones", {"quantities": ["velocity_*"]}),
    ("agile_eye", {"vary": []}),
    (str(FILES / "flat_pose.toml"), {"quantities": ["transmission_*", "velocity_*"]}),
]


@pytest.mark.many
@pytest.mark.parametrize(("name", "options"), CONSTANT, ids=lambda x: Path(str(x)).stem)
def test_a_constant_curve_is_level_in_a_plot_of_a_sensible_range(open_page, name, options):
    tab = open_page(name, **options)
    figures = tab.evaluate(
        """spherekit.figures.map(({range, plot}) =>
        ({range, values: plot.data.slice(1).flat().filter(Number.isFinite)}))"""
    )
    assert figures
    for figure in figures:
        low, high = figure["range"]
        values = np.array(figure["values"])
        spread = np.ptp(values)
        assert high - low > 1e-3 * max(abs(low), abs(high))
        if spread < 1e-12:
            assert np.ptp((values - low) / (high - low)) < 1e-9


BREAK_THE_SPHERE = (
    "CanvasRenderingContext2D.prototype.strokeText = () => { throw Error('torn'); }; 0"
)


@pytest.mark.slow
def test_an_error_in_a_drawing_is_shown_and_stops_no_number(browser, tmp_path):
    """Fields, numbers and the saved file are those of one state, the picture or not."""
    path = tmp_path / "page.html"
    sk.page("four_bar", path)
    tab = browser.new_page()
    tab.goto(path.as_uri())
    tab.wait_for_timeout(200)
    tab.evaluate(BREAK_THE_SPHERE)
    set_number(tab, "links.3.arc", 71)
    set_number(tab, "input 21", 100)
    assert "torn" in tab.inner_text("#trouble")
    changed = sk.load("four_bar").with_sizes(angle_unit="deg", arcs={"3": 71.0})
    shown = tab.get_attribute("td[data-name=velocity_coefficient_4_1]", "data-value")
    exact = sk.evaluate(changed, np.radians(100.0), assembly_mode=0)
    assert float(shown) == pytest.approx(exact.velocity_coefficient("4/1")[0], abs=1e-12)
    assert loads(tab.evaluate("spherekit.toml()"), "saved") == changed
    tab.evaluate("delete CanvasRenderingContext2D.prototype.strokeText")


@pytest.mark.slow
def test_a_field_never_says_what_the_page_does_not_show(open_page):
    tab = open_page("four_bar")
    field = tab.locator(".row:has(label[title='links.2.arc']) input[type=number]")
    for typed in ("", "", "-5", "-5", "1e9", "1e9", "181", "181"):
        field.click()
        field.evaluate("(field, text) => { field.value = text; }", typed)
        field.dispatch_event("change")
        tab.wait_for_timeout(100)
        assert float(field.input_value()) == tab.evaluate("spherekit.state.sizes[1]")
        assert loads(tab.evaluate("spherekit.toml()"), "saved")


@pytest.mark.many(slow=20)
@pytest.mark.parametrize("name", [str(FILES / "arcs.toml"), *EVERY_PAGE])
def test_every_end_of_a_slider_is_a_number_of_the_file(name):
    """And so is every number that can be typed beside it."""
    maker = PageMaker(name, None, None, None)
    facts = maker.make_model([])
    numbers = [size["value"] for size in facts["sizes"]]
    for k, size in enumerate(facts["sizes"]):
        assert size["least"] <= size["low"] <= size["value"] <= size["high"] <= size["most"]
        assert size["low"] < size["high"]
        for end in ("low", "high", "least", "most"):
            changed = [*numbers[:k], size[end], *numbers[k + 1 :]]
            parts = (changed[x] if isinstance(x, int) else x for x in facts["toml"])
            loads("".join(repr(x) if isinstance(x, float) else x for x in parts), name)


def test_a_slider_of_an_arc_has_the_range_of_the_format():
    model = PageMaker(str(FILES / "arcs.toml"), None, None, None).make_model([])
    signed, crank, also_signed, rocker = model["sizes"]
    assert (crank["low"], crank["high"], crank["least"]) == (0.1, 33.0, 0.0)
    assert (rocker["low"], rocker["high"], rocker["most"]) == (0.1, 60.0, 180.0)
    assert (signed["low"], signed["high"]) == (-180.0, -120.0)
    assert (also_signed["low"], also_signed["high"]) == (170.0, 230.0)


LIMITS = [("41", 0), ("43", -1), ("21", 0)]
LIMITS += [pytest.param(*case, marks=pytest.mark.slow) for case in (("41", 1), ("32", 0))]
"""Pairs of the four-bar that get a joint limit, and turns by which it is stated farther."""


@pytest.mark.many
@pytest.mark.parametrize(("pair", "turns"), LIMITS)
def test_a_page_shows_where_a_mode_is_beyond_a_joint_limit(open_page, pair, turns):
    """The limits are the middle half of what the pair's angle runs through in mode 0."""
    x = np.linspace(0.0, 2.0 * np.pi, 1441)[1:-1]
    angle = sk.evaluate("four_bar", x, poles=[], assembly_mode=0).variable(pair)
    low, high = np.min(angle), np.max(angle)
    low, high = low + 0.25 * (high - low), high - 0.25 * (high - low)
    outside = (angle < low) | (angle > high)
    limit = JointLimit(pair, low + 2.0 * np.pi * turns, high + 2.0 * np.pi * turns)
    limited = replace(sk.load("four_bar"), joint_limits=(limit,))
    tab = open_page(limited, vary=[])
    beyond = np.array([[x["from"], x["to"]] for x in curve(tab, 0)["beyond"]])
    of_page = np.any((x[:, None] > beyond[:, 0]) & (x[:, None] < beyond[:, 1]), axis=1)
    assert np.array_equal(of_page, outside)
    set_number(tab, "input 21", np.degrees(x[np.argmax(outside)]))
    assert f"beyond a joint limit: {pair} may go from" in tab.inner_text("#lost")
    set_number(tab, "input 21", np.degrees(x[np.argmin(outside)]))
    assert tab.inner_text("#lost") == ""


SIGNED = [
    "eight_bar_01",
    "eight_bar_12",
    "single_flier",
    "agile_eye",
    "three_rrr",
    "eight_bar_05",
]


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("name", SIGNED)
def test_velocity_coefficients_have_the_signs_of_evaluate(open_page, name):
    """Along the range of the first input, in every mode: no V where they are zero."""
    tab = open_page(name, vary=[])
    mechanism = sk.load(name)
    names = [x for x in tab.evaluate("spherekit.resultNames") if x.startswith("velocity_c")]
    compared = 0
    for place in range(len(tab.evaluate("spherekit.modeNumbers"))):
        x, values = tab.evaluate(
            f"""(({{x, values}}) => [x, values.map(row => row && [...row])])
            (spherekit.modes[{place}].curve)"""
        )
        x = np.array([at for at, row in zip(x, values, strict=True) if row])
        if not len(x):  # the mode does not close with the other inputs as they are
            continue
        rows = np.array([row for row in values if row])
        q = np.tile(tab.evaluate("spherekit.state.q"), (len(x), 1))
        q[:, 0] = x
        of_python = sk.evaluate(mechanism, q if q.shape[1] > 1 else x)
        for quantity in names:
            column = rows[:, tab.evaluate("spherekit.resultNames").index(quantity)]
            link, other, *moving = quantity.removeprefix("velocity_coefficient_").split("_")
            pair = "_".join(moving[1:]) or mechanism.inputs[0].pair
            exact = of_python.velocity_coefficient(f"{link}/{other}", pair)
            # Near ends of modes coefficients run away and both lose digits.
            exact = exact.reshape(-1, len(x))
            near = np.abs(exact) < 1e3
            off = np.where(near, np.abs(column - exact), 0.0)
            assert np.min(np.max(off, axis=1)) < 1e-9, (place, quantity)
            compared += 1
    assert compared


def test_equal_modes_are_drawn_in_their_own_colours(open_page):
    """Both modes of the four-bar have one transmission angle: both colours are seen."""
    tab = open_page("four_bar", vary=[], quantities=["transmission_angle_*", "velocity_*"])
    dashes = tab.evaluate(
        "spherekit.figures.map(({plot}) => plot.series.slice(1).map(x => x.dash))"
    )
    names = tab.evaluate("spherekit.figures.map(({quantity}) => quantity.name)")
    by_name = dict(zip(names, dashes, strict=True))
    assert by_name["velocity_coefficient_4_1"] == [[], []]
    (equal,) = (x for name, x in by_name.items() if name.startswith("transmission"))
    assert equal[0] == [] and len(equal[1]) == 2
    colours = tab.evaluate(
        """(() => {
        const isEqual = ({quantity}) => quantity.name.startsWith("transmission");
        const {plot} = spherekit.figures.find(isEqual);
        const {ctx, bbox: {left, top, width, height}} = plot, counts = {};
        const {data} = ctx.getImageData(left, top, width, height);
        for (let k = 0; k < data.length; k += 4)
          if (data[k + 3] === 255) {
            const parts = [...data.slice(k, k + 3)];
            const key = "#" + parts.map(x => x.toString(16).padStart(2, "0")).join("");
            counts[key] = (counts[key] || 0) + 1;
          }
        return counts; })()"""
    )
    for mode in range(2):
        assert colours.get(tab.evaluate(f"spherekit.modeColour({mode})"), 0) > 50


@pytest.mark.slow
def test_a_dashed_curve_lies_on_a_solid_one_everywhere(open_page):
    """Mode 4 of this chain closes in a part of the range only, on curves of others."""
    tab = open_page("eight_bar_05", "mode=4", vary=[])
    figures = tab.evaluate(
        """spherekit.figures.map(({plot}) => plot.series.slice(1).map(({dash}, k) =>
        ({dash, column: plot.data[k + 1].map(y => Number.isFinite(y) ? y : null)})))"""
    )
    dashed = 0
    for curves in figures:
        columns = np.array([x["column"] for x in curves], dtype=float)
        solid = columns[[not x["dash"] for x in curves]]
        for each in columns[[bool(x["dash"]) for x in curves]]:
            off = np.abs(solid - each)
            shared = np.isfinite(each) & np.any(np.isfinite(solid), axis=0)
            assert np.all(np.nanmin(off[:, shared], axis=0) < 0.01 * np.nanmax(columns))
            dashed += 1
        first_dash = [bool(x["dash"]) for x in curves].index(True)
        assert first_dash and not curves[first_dash - 1]["dash"]
    assert dashed


@pytest.mark.slow
def test_every_mode_has_a_colour_of_its_own(open_page):
    tab = open_page("four_bar", vary=[])
    for theme in ("light", "dark"):
        tab.evaluate(f"spherekit.change('theme', {{theme: '{theme}'}})")
        tab.wait_for_timeout(100)
        colours = tab.evaluate("[...Array(96).keys()].map(spherekit.modeColour)")
        assert len(set(colours)) == 96
        first = np.array([[int(x[k : k + 2], 16) for k in (1, 3, 5)] for x in colours[:32]])
        apart = np.linalg.norm(first[:, None] - first[None], axis=2)
        assert np.min(apart + 1e3 * np.eye(32)) > 25.0


def sprung(name, pair, first=0.0, last=360.0):
    """Return a mechanism with a spring at a pair, driven through a range (deg)."""
    mechanism = sk.load(name)
    driven = Input(mechanism.inputs[0].pair, *np.radians([first, last]))
    masses = mechanism.masses or sk.load(str(FILES / "massless_crank.toml")).masses[:0]
    return replace(
        mechanism, loads=(Spring("coil", pair, 0.7, 0.3),), inputs=(driven,), masses=masses
    )


SPRUNG = {
    "swings": lambda: sprung("four_bar", "41"),
    "turns fully": lambda: sprung("four_bar", "32"),
    "below zero": lambda: sprung("four_bar", "32", -500.0, 90.0),
    "falling range": lambda: sprung("four_bar", "32", 400.0, -20.0),
    "range without zero": lambda: sprung("four_bar", "43", 60.0, 500.0),
    "mode with gaps": lambda: replace(
        sprung("four_bar", "32").with_sizes(angle_unit="deg", arcs={"2": 44.0}), modes={}
    ),
    "nearly a change point": lambda: replace(
        sprung("four_bar", "32").with_sizes(
            angle_unit="deg", arcs=dict(zip("1234", NARROW[0], strict=True))
        ),
        modes={},
    ),
    "Newton's steps": lambda: sprung("double_butterfly", "F"),
    "wheels": lambda: sprung("planetary_bevel", "planet_axis", 0.0, 900.0),
}


NEXT_PICTURE = """() => new Promise(done =>
  requestAnimationFrame(() => requestAnimationFrame(() => done(null))))"""


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("case", SPRUNG)
def test_springs_count_turns_as_inverse_dynamics_does(open_page, case):
    """A spring at a passive pair is in the driving torque, with all turns of the pair."""
    mechanism = SPRUNG[case]()
    tab = open_page(mechanism, vary=[], quantities=["torque"])
    low, high = mechanism.inputs[0].range
    compared = 0
    # Python takes seconds for a torque where loops are closed by Newton's steps.
    modes, samples = (2, 3) if case == "Newton's steps" else (8, 5)
    for place, number in enumerate(tab.evaluate("spherekit.modeNumbers")[:modes]):
        for q in np.linspace(low, high, samples) + 0.0123:
            q = float(min(q, high - 0.0077))
            tab.evaluate(f"spherekit.change('mode', {{mode: {place}, q: [{q!r}]}})")
            tab.evaluate(NEXT_PICTURE)
            shown = float(tab.get_attribute("td[data-name=torque]", "data-value") or "nan")
            rows = sk.evaluate(mechanism, q, poles=[], assembly_mode=number)
            if not np.isfinite(shown):
                assert rows.status[0] != sk.Status.OK
                continue
            laws = {mechanism.inputs[0].pair: sk.ConstantSpeed(1.0, q)}
            made = sk.inverse_dynamics(mechanism, laws, [0.0], assembly_mode=number)
            exact = made.torques[0, 0]
            assert shown == pytest.approx(exact, rel=1e-9, abs=1e-9), (place, q)
            compared += 1
    assert compared > 4
