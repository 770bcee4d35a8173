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
    """Return a function that opens the browser page of a mechanism.

    The argument `fragment` of this function is what follows # in the address of the page.
    Its further options go to `sk.page`. After the test the browser's console must be empty.
    """
    messages = []
    tabs = []

    def open_tab(mechanism, fragment="", **options):
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

    yield open_tab
    for tab in tabs:
        tab.close()
    assert not messages


def set_number(tab, row, value):
    """Type a number into the field beside a slider, whose label has the title `row`."""
    field = tab.locator(f".row:has(label[title='{row}']) input[type=number]")
    field.fill(str(value))
    field.press("Enter")
    tab.wait_for_timeout(100)


def curve_of_mode(tab, mode):
    """Return what the page knows of a mode along the range of the input.

    The keys are `x` (inputs in rad of the samples), `closes` (whether the mode exists at
    each), `ends` and `meets` (inputs at which it ends or meets another mode) and `beyond`
    (intervals outside a joint limit).
    """
    return tab.evaluate(
        f"""(({{x, values, ends, meets, beyond}}) =>
        ({{x, closes: values.map(Boolean), ends, meets, beyond}}))
        (spherekit.modes[{mode}].curve)"""
    )


@pytest.mark.slow
@pytest.mark.many(slow=20)
@pytest.mark.parametrize("name", EVERY_PAGE, ids=lambda name: Path(name).stem)
def test_a_page_is_drawn_at_every_end_of_every_slider(open_page, name):
    """No slider at an end, alone or with all others, and no mode gives an error message."""
    tab = open_page(name)
    assert tab.evaluate(DRIVE_TO_ENDS) == []


@pytest.mark.slow
def test_modes_end_right_where_an_inner_dyad_fails_first(open_page):
    """With a crank of 46 deg, the inner dyad of a Stephenson chain fails before the outer.

    The outer dyad then has NaN for the square of its triple product. The ranges of the
    modes are compared with a bisection of `sk.evaluate`.
    """
    tab = open_page("stephenson", "links.2.arc=46")
    assert tab.inner_text("#trouble") == ""
    changed = sk.load("stephenson").with_sizes(angle_unit="deg", arcs={"2": 46.0})
    assert_same_ranges(tab, changed)


def assert_same_ranges(tab, mechanism, tolerance=1e-7):
    """Assert that modes end on the page where they end by bisection of `sk.evaluate`.

    `tolerance` is in rad.
    """
    numbers = tab.evaluate("spherekit.modeNumbers")
    for row, number in enumerate(numbers):
        page_ends = np.sort(curve_of_mode(tab, row)["ends"])
        # The page may find a gap that is narrower than the samples of the bisection.
        between = 0.5 * (page_ends[1:] + page_ends[:-1])
        exact_ends = ends_by_bisection(mechanism, number, between)
        assert len(page_ends) == len(exact_ends), (number, page_ends, exact_ends)
        assert np.allclose(page_ends, exact_ends, rtol=0.0, atol=tolerance)


def ends_by_bisection(mechanism, number, more=()):
    """Return the inputs (rad) at which an assembly mode begins or ends, by `sk.evaluate`.

    An assembly mode is a way to assemble the links. It is tried at 359 inputs, equally
    spaced inside the range of the input. A change between neighbours is bisected 28 times,
    all changes at once.

    Parameters
    ----------
    mechanism
        Mechanism with one input.
    number
        Number of the assembly mode.
    more
        Further inputs (rad) at which the mode is tried.
    """
    start, stop = mechanism.inputs[0].range
    inside_range = np.linspace(start, stop, 361)[1:-1]
    x = np.unique(np.concatenate([inside_range, more]))
    closes = evaluate_closes(mechanism, x, number)
    changes = np.flatnonzero(closes[1:] != closes[:-1])
    low = x[changes]
    high = x[changes + 1]
    closes_at_low = closes[changes]
    if not len(changes):
        return low
    for _ in range(28):
        middle = 0.5 * (low + high)
        is_like_low = evaluate_closes(mechanism, middle, number) == closes_at_low
        low = np.where(is_like_low, middle, low)
        high = np.where(is_like_low, high, middle)
    return low


def evaluate_closes(mechanism, x, number):
    """Return whether a mode closes at inputs, singular configurations included."""
    rows = sk.evaluate(mechanism, x, poles=[], assembly_mode=number)
    return np.isin(rows.status, [sk.Status.OK, sk.Status.AT_SINGULARITY])


@pytest.mark.slow
@pytest.mark.many(slow=3)
@pytest.mark.parametrize("seed", range(8))
def test_modes_of_random_six_bars_end_where_evaluate_says(open_page, seed):
    """The page of a random Stephenson or Watt six-bar shows where all modes end.

    A mode is a way to assemble the links. It ends at inputs beyond which its links do not
    close the loops any more. The expected ends are those of `sk.evaluate` by bisection.
    `open_page` opens the page in a browser.
    """
    rng = np.random.default_rng(seed)
    chain = sk.load("stephenson" if seed % 2 else "watt")
    sizes = {}
    for link, size in chain.geometry.links.items():
        arcs = np.radians(rng.uniform(20.0, 120.0, len(size.arcs)))
        angles = np.radians(rng.uniform(-160.0, 160.0, len(size.angles)))
        sizes[link] = replace(size, arcs=tuple(arcs), angles=tuple(angles))
    geometry = replace(chain.geometry, links=sizes)
    mechanism = replace(chain, geometry=geometry, modes={}, loads=())
    try:
        # With `vary=[]` the page has no sliders for sizes.
        tab = open_page(mechanism, vary=[])
    except sk.SpherekitError:
        pytest.skip("these sizes have no assembly mode")
    assert_same_ranges(tab, mechanism)


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
    """A gap of half a degree in the crank's range is shown, though samples are 2 deg apart.

    The crank stops where the arc from its end to the rocker's axis is coupler + rocker or
    coupler - rocker. This arc, ground and crank are a spherical triangle, whose angle
    between ground and crank is the input. It follows from the law of cosines. If there is
    no such angle, the crank turns fully. `open_page` opens the page in a browser, and
    `curve_of_mode` returns what it knows of a mode (way to assemble the links).
    """
    tab = open_page(four_bar(arcs), vary=[])
    ground, crank, coupler, rocker = np.radians(arcs)
    cosine_of_reach = np.cos([coupler - rocker, coupler + rocker])
    cosine = cosine_of_reach - np.cos(ground) * np.cos(crank)
    cosine /= np.sin(ground) * np.sin(crank)
    inputs = np.arccos(cosine[np.abs(cosine) < 1.0])
    exact = np.sort(np.concatenate([inputs, 2.0 * np.pi - inputs]))
    for mode in range(2):
        shown = curve_of_mode(tab, mode)
        ends = np.sort(shown["ends"])
        assert len(ends) == len(exact)
        assert np.allclose(ends, exact, rtol=0.0, atol=1e-7)
        # `closes` says for each sample of the page whether the mode exists.
        has_gap = not all(shown["closes"])
        assert has_gap == (len(exact) > 0)
        assert not shown["meets"]  # no crossings with another mode


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(("name", "where_deg"), [("cp2", 180.0), ("parallelogram", 180.0)])
def test_modes_that_meet_are_marked_and_do_not_end(open_page, name, where_deg):
    """At a change point the page says that modes meet, and shows no values there.

    A mode is a way to assemble the links. Both modes of these four-bars meet at the input
    `where_deg`; they close on either side. `open_page` opens the page in a browser.
    """
    path = str(FILES / f"{name}.toml")
    tab = open_page(path, vary=[])
    for mode in range(2):
        shown = curve_of_mode(tab, mode)
        assert not shown["ends"]
        x = np.array(shown["x"])
        closes = np.array(shown["closes"])
        distance_to_meeting = np.min(np.abs(x[:, None] - shown["meets"]), axis=1)
        assert np.all(closes[distance_to_meeting > 1e-6])
        assert np.min(np.abs(np.array(shown["meets"]) - np.radians(where_deg))) < 1e-6
    set_number(tab, f"input {sk.load(path).inputs[0].pair}", where_deg)
    assert tab.inner_text("#lost") == "modes meet here"
    values = tab.locator("#values td[data-name]").all_inner_texts()
    assert values
    assert set(values) == {"–"}
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
    """A constant curve on a page is a level line: its axis is far wider than rounding.

    Curves of several mechanisms are constant but for rounding, which must not fill the
    plot. `open_page` opens the page in a browser.
    """
    tab = open_page(name, **options)
    # `range` is that of the vertical axis. The first list of the data has the inputs, the
    # others have the values of the curves.
    figures = tab.evaluate(
        """spherekit.figures.map(({range, plot}) =>
        ({range, values: plot.data.slice(1).flat().filter(Number.isFinite)}))"""
    )
    assert figures
    for figure in figures:
        low, high = figure["range"]
        values = np.array(figure["values"])
        spread = np.ptp(values)
        # Rounding is about 1e-16 of the values, much less than the height of the axis.
        assert high - low > 1e-3 * max(abs(low), abs(high))
        if spread < 1e-12:
            assert np.ptp((values - low) / (high - low)) < 1e-9


BREAK_THE_SPHERE = (
    "CanvasRenderingContext2D.prototype.strokeText = () => { throw Error('torn'); }; 0"
)


@pytest.mark.slow
def test_an_error_in_a_drawing_is_shown_and_stops_no_number(browser, tmp_path):
    """If drawing fails, a changed field still changes the numbers and the mechanism file.

    The page draws a sphere. The browser's method `strokeText` is replaced by one that
    throws the error "torn". The page shows the text of the error. Numbers are compared with
    `sk.evaluate`. `spherekit.toml()` is the mechanism file that the page offers to save.
    """
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
    assert float(shown) == pytest.approx(exact.velocity_coefficient("4/1"), abs=1e-12)
    assert loads(tab.evaluate("spherekit.toml()"), "saved") == changed


@pytest.mark.slow
def test_a_refused_number_is_replaced_by_the_one_in_use(open_page):
    """After an empty, negative or too large number, a field shows the size in use."""
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
def test_every_end_of_a_slider_gives_a_valid_file(name):
    """A file with any size at an end of its slider or of its field can be read.

    The page of a mechanism has a slider and a field for each size, and can save the file.
    A slider reaches from `low` to `high`. The field accepts more: from `least` to `most`.
    The text of the file is a list of passages and of indices, one in place of each size.
    """
    maker = PageMaker(name, vary=None, quantities=None, input_pair=None)
    model = maker.make_model(shown_names=[])
    values = [size["value"] for size in model["sizes"]]
    for k, size in enumerate(model["sizes"]):
        assert size["least"] <= size["low"] <= size["value"] <= size["high"] <= size["most"]
        assert size["low"] < size["high"]
        for end in ("low", "high", "least", "most"):
            changed_values = [*values[:k], size[end], *values[k + 1 :]]
            text = ""
            for part in model["toml"]:
                is_index_of_size = isinstance(part, int)
                if is_index_of_size:
                    part = changed_values[part]
                text += repr(part) if isinstance(part, float) else part
            loads(text, name)


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


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(("pair", "turns"), LIMITS)
def test_a_page_shows_where_a_mode_is_beyond_a_joint_limit(open_page, pair, turns):
    """The page marks the inputs at which a pair is outside its joint limits.

    The limits are the middle half of the angles of the pair in assembly mode 0 (one way to
    assemble the links), stated `turns` whole turns away. The expected angles are those of
    `sk.evaluate` at quarter degrees. `open_page` opens the page in a browser.
    """
    x = np.linspace(0.0, 2.0 * np.pi, 1441)[1:-1]
    angle = sk.evaluate("four_bar", x, poles=[], assembly_mode=0).variable(pair)
    quarter = 0.25 * np.ptp(angle)
    low = np.min(angle) + quarter
    high = np.max(angle) - quarter
    is_outside = (angle < low) | (angle > high)
    limit = JointLimit(pair, low + 2.0 * np.pi * turns, high + 2.0 * np.pi * turns)
    limited = replace(sk.load("four_bar"), joint_limits=(limit,))
    tab = open_page(limited, vary=[])
    intervals = [[x["from"], x["to"]] for x in curve_of_mode(tab, 0)["beyond"]]
    starts, stops = np.array(intervals).T
    is_marked = np.any((x[:, None] > starts) & (x[:, None] < stops), axis=1)
    assert np.array_equal(is_marked, is_outside)
    first_outside = x[np.argmax(is_outside)]
    set_number(tab, "input 21", np.degrees(first_outside))
    assert f"beyond a joint limit: {pair} may go from" in tab.inner_text("#lost")
    first_inside = x[np.argmin(is_outside)]
    set_number(tab, "input 21", np.degrees(first_inside))
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
    """Velocity coefficients on a web page equal those of `sk.evaluate`, sign included.

    They are relative rates of two links per rate of an input. They are compared along the
    range of the first input in every mode (way to assemble the links). A page that showed
    absolute values would have curves with a kink where the coefficient changes its sign.
    """
    tab = open_page(name, vary=[])
    mechanism = sk.load(name)
    result_names = tab.evaluate("spherekit.resultNames")
    quantities = [x for x in result_names if x.startswith("velocity_c")]
    compared = 0
    for mode in range(len(tab.evaluate("spherekit.modeNumbers"))):
        # A row has the results at one input; it is null where the mode does not exist. Rows
        # are copied to plain arrays, which Python can receive.
        x, rows = tab.evaluate(
            f"""(({{x, values}}) => [x, values.map(row => row && [...row])])
            (spherekit.modes[{mode}].curve)"""
        )
        x = np.array([value for value, row in zip(x, rows, strict=True) if row])
        rows = np.array([row for row in rows if row])
        if not len(x):  # the mode does not close with the other inputs as they are
            continue
        q = np.tile(tab.evaluate("spherekit.state.q"), (len(x), 1))
        q[:, 0] = x
        evaluated = sk.evaluate(mechanism, q if q.shape[1] > 1 else x)
        for quantity in quantities:
            shown = rows[:, result_names.index(quantity)]
            # velocity_coefficient_LINK_LINK or ..._LINK_LINK_by_INPUT
            link, relative_to, *by_input = quantity.removeprefix(
                "velocity_coefficient_"
            ).split("_")
            pair = "_".join(by_input[1:]) or mechanism.inputs[0].pair
            exact = evaluated.velocity_coefficient(f"{link}/{relative_to}", pair)
            # (modes of evaluate, inputs): rows are sorted by mode, then by input.
            exact = exact.reshape(-1, len(x))
            # Near ends of modes coefficients grow without bound and both lose digits.
            is_moderate = np.abs(exact) < 1e3
            error = np.where(is_moderate, np.abs(shown - exact), 0.0)
            # One of the modes of `evaluate` is that of the page.
            assert np.min(np.max(error, axis=1)) < 1e-9, (mode, quantity)
            compared += 1
    assert compared


COUNT_COLOURS_OF_TRANSMISSION_PLOT = """(() => {
  const isTransmission = ({quantity}) => quantity.name.startsWith("transmission");
  const {plot} = spherekit.figures.find(isTransmission);
  const {ctx, bbox: {left, top, width, height}} = plot, counts = {};
  const {data} = ctx.getImageData(left, top, width, height);
  for (let k = 0; k < data.length; k += 4)
    if (data[k + 3] === 255) {
      const parts = [...data.slice(k, k + 3)];
      const key = "#" + parts.map(x => x.toString(16).padStart(2, "0")).join("");
      counts[key] = (counts[key] || 0) + 1;
    }
  return counts;
})()"""
"""Counts the opaque pixels of the plot of the transmission angle by colour (#rrggbb)."""


@pytest.mark.slow
def test_equal_curves_are_dashed_in_two_colours(open_page):
    """Two equal curves on a page are both seen: the second one is dashed over the first.

    Both modes of the four-bar (ways to assemble the links) have the same transmission
    angle, so its two curves are equal. The velocity coefficients of the modes differ, so
    that both of their curves are solid. The pixels of the plot of the transmission angle
    are counted by colour. `open_page` opens the page in a browser.
    """
    tab = open_page("four_bar", vary=[], quantities=["transmission_angle_*", "velocity_*"])
    # Series 0 of a plot has the inputs, each further series has the curve of one mode. An
    # empty list of dashes means a solid curve.
    dashes = tab.evaluate(
        "spherekit.figures.map(({plot}) => plot.series.slice(1).map(x => x.dash))"
    )
    names = tab.evaluate("spherekit.figures.map(({quantity}) => quantity.name)")
    dashes_by_name = dict(zip(names, dashes, strict=True))
    assert dashes_by_name["velocity_coefficient_4_1"] == [[], []]
    (transmission_name,) = (name for name in names if name.startswith("transmission"))
    first_dash, second_dash = dashes_by_name[transmission_name]
    assert first_dash == []
    assert len(second_dash) == 2
    pixel_counts = tab.evaluate(COUNT_COLOURS_OF_TRANSMISSION_PLOT)
    for mode in range(2):
        colour = tab.evaluate(f"spherekit.modeColour({mode})")
        assert pixel_counts.get(colour, 0) > 50


@pytest.mark.slow
def test_a_dashed_curve_lies_on_a_solid_one_everywhere(open_page):
    """A curve is dashed only if it coincides with curves of other modes, which are solid.

    A mode is a way to assemble the links. At each input the nearest solid curve must be
    within a hundredth of the height of the figure, since a difference that nobody sees does
    not count. Mode 4 of this eight-bar exists in a part of the range of the input only. Its
    curves coincide there with curves of other modes.
    """
    # With `vary=[]` the page has no sliders for sizes, so the sizes are those of the file.
    tab = open_page("eight_bar_05", "mode=4", vary=[])
    # Series 0 of a plot has the inputs, each further series has the curve of one mode.
    figures = tab.evaluate(
        """spherekit.figures.map(({plot}) => plot.series.slice(1).map(({dash}, k) =>
        ({dash, column: plot.data[k + 1].map(y => Number.isFinite(y) ? y : null)})))"""
    )
    dashed_count = 0
    for curves in figures:
        columns = np.array([x["column"] for x in curves], dtype=float)  # (modes, inputs)
        is_dashed = np.array([bool(x["dash"]) for x in curves])
        solid = columns[~is_dashed]
        for dashed in columns[is_dashed]:
            distances = np.abs(solid - dashed)
            # Curves have gaps where a mode does not close. At a few inputs, near its ends,
            # a dashed curve may have a value and no solid curve has one.
            is_drawn = np.isfinite(dashed)
            is_shared = is_drawn & np.any(np.isfinite(solid), axis=0)
            assert np.mean(is_shared[is_drawn]) > 0.95
            nearest = np.nanmin(distances[:, is_shared], axis=0)
            assert np.all(nearest < 0.01 * np.nanmax(columns))
            dashed_count += 1
        # Nothing is drawn before the first curve, so there is nothing that it could cover.
        assert not is_dashed[0]
        assert np.any(is_dashed)
    assert dashed_count


@pytest.mark.slow
def test_every_mode_has_a_colour_of_its_own(open_page):
    """The colours of 96 modes differ, and those of the first 32 clearly, in both themes.

    A mode is a way to assemble the links; its curves on the page have its colour. Clearly
    means a distance of 25 in the space of red, green and blue (0 to 255 each).
    """
    tab = open_page("four_bar", vary=[])
    for theme in ("light", "dark"):
        tab.evaluate(f"spherekit.change('theme', {{theme: '{theme}'}})")
        tab.wait_for_timeout(100)
        colours = tab.evaluate("[...Array(96).keys()].map(spherekit.modeColour)")
        assert len(set(colours)) == 96
        rgb = []
        for colour in colours[:32]:  # "#rrggbb"
            rgb.append([int(colour[k : k + 2], 16) for k in (1, 3, 5)])
        rgb = np.array(rgb)
        distances = np.linalg.norm(rgb[:, None] - rgb[None], axis=2)
        assert np.min(distances + 1e3 * np.eye(32)) > 25.0


def with_spring(name, pair, first=0.0, last=360.0):
    """Return a shipped mechanism with a torsion spring at a pair as its only load.

    The spring has the stiffness 0.7 and is relaxed at 0.3 rad. The input goes from `first`
    to `last` (deg).
    """
    mechanism = sk.load(name)
    driven = Input(mechanism.inputs[0].pair, *np.radians([first, last]))
    spring = Spring("coil", pair, 0.7, 0.3)
    return replace(mechanism, loads=(spring,), inputs=(driven,))


SPRING_CASES = {
    "swings": lambda: with_spring("four_bar", "41"),
    "turns fully": lambda: with_spring("four_bar", "32"),
    "below zero": lambda: with_spring("four_bar", "32", -500.0, 90.0),
    "falling range": lambda: with_spring("four_bar", "32", 400.0, -20.0),
    "range without zero": lambda: with_spring("four_bar", "43", 60.0, 500.0),
    "mode with gaps": lambda: replace(
        with_spring("four_bar", "32").with_sizes(angle_unit="deg", arcs={"2": 44.0}),
        modes={},
    ),
    "nearly a change point": lambda: replace(
        with_spring("four_bar", "32").with_sizes(
            angle_unit="deg", arcs=dict(zip("1234", NARROW[0], strict=True))
        ),
        modes={},
    ),
    "Newton's steps": lambda: with_spring("double_butterfly", "F"),
    "wheels": lambda: with_spring("planetary_bevel", "planet_axis", 0.0, 900.0),
}


NEXT_PICTURE = """() => new Promise(done =>
  requestAnimationFrame(() => requestAnimationFrame(() => done(null))))"""


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("case", SPRING_CASES)
def test_springs_count_turns_as_inverse_dynamics_does(open_page, case):
    """The driving torque on the page counts all turns of a pair with a spring.

    It equals the torque by `sk.inverse_dynamics` at constant speed, in several modes (ways
    to assemble the links). `open_page` opens the page in a browser.
    """
    mechanism = SPRING_CASES[case]()
    tab = open_page(mechanism, vary=[], quantities=["torque"])
    input_pair = mechanism.inputs[0].pair
    low, high = mechanism.inputs[0].range
    # Python takes seconds for a torque where loops are closed by Newton's steps. Such a
    # mechanism is compared in fewer modes and at fewer inputs.
    mode_count = 2 if case == "Newton's steps" else 8
    input_count = 3 if case == "Newton's steps" else 5
    # The page stores samples at round angles. The inputs are shifted a little (rad), so
    # that the page has to count turns between its samples, but stay inside the range.
    inputs = np.minimum(np.linspace(low, high, input_count) + 0.0123, high - 0.0077)
    compared = 0
    for mode, number in enumerate(tab.evaluate("spherekit.modeNumbers")[:mode_count]):
        for q in inputs.tolist():
            tab.evaluate(f"spherekit.change('mode', {{mode: {mode}, q: [{q!r}]}})")
            tab.evaluate(NEXT_PICTURE)  # wait until the page is drawn with the new input
            shown = float(tab.get_attribute("td[data-name=torque]", "data-value") or "nan")
            row = sk.evaluate(mechanism, q, poles=[], assembly_mode=number)
            if not np.isfinite(shown):
                assert row.status != sk.Status.OK
                continue
            laws = {input_pair: sk.ConstantSpeed(1.0, q)}
            result = sk.inverse_dynamics(mechanism, laws, [0.0], assembly_mode=number)
            exact = result.torques[0, 0]
            assert shown == pytest.approx(exact, rel=1e-9, abs=1e-9), (mode, q)
            compared += 1
    assert compared > 4
