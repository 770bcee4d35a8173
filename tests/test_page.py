"""Pages in a browser: dragged, read at the cursor, and compared with Python."""

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers.page_waits import wait_until

import spherekit as sk
from spherekit.cli.main import main
from spherekit.display.pages.page import PageMaker
from spherekit.display.pages.page_facts import quantity_facts
from spherekit.errors import EngineError
from spherekit.files.mechanism_reader import loads
from spherekit.geometry.vectors import unit_rows
from spherekit.mechanism.load_kinds import PairTorque, Spring
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.velocities.row_quantities import row_quantities

EVERY = (
    "four_bar",
    "stephenson",
    "roller_cam",
    "planetary_bevel",
    "five_bar",
    "double_butterfly",
)

LINKS_WITH_UNDERSCORES = """format = 1
name = "underscores"
angle_unit = "deg"
ground = "1"
links.1 = {axes = ["41", "21"], arcs = [60.0]}
links.2_1 = {axes = ["32", "43"], arcs = [70.0]}
links.2 = {axes = ["21", "32"], arcs = [20.0]}
links.4 = {axes = ["43", "41"], arcs = [40.0]}
pairs.21 = {type = "R", links = ["1", "2"]}
pairs.32 = {type = "R", links = ["2", "2_1"]}
pairs.43 = {type = "R", links = ["2_1", "4"]}
pairs.41 = {type = "R", links = ["1", "4"]}
inputs.21 = {from = 0.0, to = 360.0}
"""


@pytest.fixture
def opened(browser, tmp_path):
    """Return a function that writes the page of a mechanism and opens it in a browser tab.

    `fragment` is the part of the address after "#", which contains the state; `options` are
    those of Playwright's `new_page`. The test fails at its end if the page wrote to the
    console, raised an error or asked for anything from the network. Such requests are
    recorded and not answered.
    """
    complaints = []

    def open_page(name, fragment="", **options):
        path = tmp_path / f"{name}.html"
        if not path.exists():
            sk.page(name, path)
        tab = browser.new_page(viewport={"width": 1300, "height": 900}, **options)
        tab.on("console", lambda message: complaints.append(message.text))
        tab.on("pageerror", lambda error: complaints.append(str(error)))
        tab.route(re.compile("^http"), lambda route: complaints.append(route.request.url))
        tab.goto(f"{path.as_uri()}#{fragment}")
        # The page is ready when its first picture is drawn.
        wait_until(tab, "window.spherekit?.timing.pictures > 0")
        return tab

    yield open_page
    assert not complaints


def test_a_page_is_one_file_without_a_network(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["page", "four_bar", "--vary", "links.2.arc"]) == 0
    printed = capsys.readouterr().out
    assert "a page with 3 curves of 2 assembly modes and 1 slider" in printed
    assert "Files: four_bar.html" in printed
    text = (tmp_path / "four_bar.html").read_text("utf-8")
    kernels = re.search(r"^const KERNELS = \{.*?^\};$", text, re.M | re.S)[0]
    assert len(text) - len(kernels) < 250_000
    fetched = re.findall(r"(?:src|href|url)\s*[=(]\s*[\"']?[^\s\"'>)]+", text)
    assert not [x for x in fetched if "//" in x] and "default-src 'none'" in text


@pytest.mark.slow
@pytest.mark.parametrize("name", ["roller_cam", "double_butterfly"])
def test_the_saved_text_is_the_file(name):
    """With its numbers as they are it is read as the same mechanism, comments and all."""
    maker = PageMaker(name, None, ["q"], None)
    made = maker.make_model([])
    parts, values = made["toml"], [size["value"] for size in made["sizes"]]
    assert sorted(x for x in parts if isinstance(x, int)) == [*range(len(values))]
    text = "".join(repr(values[x]) if isinstance(x, int) else x for x in parts)
    assert loads(text, name) == sk.load(name)
    assert "# Assumed: " in text


@pytest.mark.slow
def test_a_saved_text_that_is_written_anew_has_every_number():
    """The file states directions by `xyz`, so that its text has no angles to replace."""
    made = PageMaker("miura_unit", None, ["q"], None).make_model([])
    parts, values = made["toml"], [size["value"] for size in made["sizes"]]
    assert [x for x in parts if isinstance(x, int)] == [*range(len(values))]
    assert len(values) > 9
    text = "".join(repr(values[x]) if isinstance(x, int) else x for x in parts)
    saved, mechanism = loads(text, "miura_unit"), sk.load("miura_unit")
    for pair, axis in mechanism.geometry.axes.items():
        assert np.allclose(saved.geometry.axes[pair], axis, rtol=0.0, atol=1e-15)


def test_a_pattern_selects_no_results_that_only_the_scripts_use(tmp_path):
    """`closure_1`, which also ends in "_1", is such a result."""
    made = sk.page("four_bar", tmp_path / "ends.html", vary=[], quantities=["*_1"])
    names = [name for name in row_quantities(sk.load("four_bar")) if name.endswith("_1")]
    assert f"{len(names)} curves" in made.holds


def test_quantities_that_a_page_cannot_compute_are_refused_without_loads(tmp_path):
    with pytest.raises(EngineError, match="quantities depend on t, which pages do not"):
        sk.page("watt", tmp_path / "time.html", vary=[], quantities=["t"])


def test_friction_of_a_mechanism_without_masses_refuses_no_page(tmp_path):
    """No torques are shown by default without masses, so the friction does not matter."""
    bearings = sk.Bearings("rubbing", "41", (0.1, 0.15), 0.01, 0.1)
    rubbed = replace(sk.load("four_bar"), masses=(), loads=(bearings,))
    made = sk.page(rubbed, tmp_path / "rubbed.html", vary=[])
    assert "2 curves" in made.holds and not made.notes


def test_a_label_names_the_links_even_if_another_link_is_named_by_its_first_part():
    """The links "2_1" and "2" both begin a name such as velocity_coefficient_2_1_4."""
    mechanism = loads(LINKS_WITH_UNDERSCORES, "underscores")
    assert mechanism.links == ("1", "2_1", "2", "4")
    for name, label in {
        "velocity_coefficient_2_1_4": "velocity coefficient 2 1/4",
        "velocity_coefficient_4_2": "velocity coefficient 4/2",
        "pole_2_1_4_x": "pole 2 1/4 x",
    }.items():
        assert quantity_facts(mechanism, name, "")["label"] == label


def test_loads_that_a_page_cannot_follow_are_left_out_and_named(tmp_path):
    """The time is not known, nor are whole turns where several inputs lead to a place."""
    four_bar, five_bar = sk.load("four_bar"), sk.load("five_bar")
    made = sk.page("four_bar", tmp_path / "sines.html", vary=[])
    assert "3 curves" in made.holds and not made.notes
    timed = replace(four_bar, loads=(PairTorque("timed", "41", "sin(t)"),))
    made = sk.page(timed, tmp_path / "timed.html", vary=[])
    assert "2 curves" in made.holds
    assert "depend on t, which pages do not support" in made.notes[0]
    with pytest.raises(EngineError, match="depend on t, which pages do not support"):
        sk.page(timed, tmp_path / "asked.html", vary=[], quantities=["torque"])
    wound = replace(five_bar, loads=(Spring("wound", "32", 1.0),))
    made = sk.page(wound, tmp_path / "wound.html", vary=[])
    assert "turns_of_32" in made.notes[0]


def drag(tab, start, offset):
    """Drag the mouse from a point of the page by an offset (pixels: right and down)."""
    tab.mouse.move(*start)
    tab.mouse.down()
    tab.mouse.move(start[0] + offset[0], start[1] + offset[1], steps=8)
    tab.mouse.up()


def compute_in_python(mechanism, q, name):
    """Return a quantity of a browser page at inputs `q` (rad) in every assembly mode.

    An assembly mode is a way to assemble the links. The page must show the same numbers.
    They are computed here by `sk.evaluate`. `name` is the key of the quantity on the page:

    - "velocity_LINK_LINK_INPUT" is the velocity coefficient of two links (relative rate per
      rate of the input). The name of the input that moves is missing if there is only one.
    - "transmission_PAIR" is the transmission angle: the acute angle between the planes of
      both arcs of the dyad (two links in series) with this middle pair.
    - "torque_INPUT", or "torque" with one input, is the driving torque of an input while
      all inputs have unit speeds.
    """
    rows = sk.evaluate(mechanism, q)
    first_input, *further_inputs = rows.input_pairs
    kind, *parts = name.split("_")
    if kind == "velocity":
        # With one input, the key ends with the names of the links.
        input_pair = parts[-1] if further_inputs else first_input
        return rows.velocity_coefficient("/".join(parts[1:3]), input_pair)
    if kind == "transmission":
        middle = mechanism.pair_number["_".join(parts[1:])]
        # The group of two links whose middle pair is this one. `dyad_positions` are the
        # first outer, the middle and the last outer pair among its pairs.
        groups = plan_assembly(mechanism).groups
        (dyad,) = (x for x in groups if x.is_dyad and x.middle == middle)
        pairs = [mechanism.pairs[dyad.pairs[k]] for k in dyad.dyad_positions]
        first_axis, middle_axis, last_axis = (
            rows.direction("/".join(pair.links), first_input) for pair in pairs
        )
        first_normal = unit_rows(np.cross(first_axis, middle_axis))
        second_normal = unit_rows(np.cross(middle_axis, last_axis))
        sine = np.linalg.norm(np.cross(first_normal, second_normal), axis=1)
        # Planes have no sense, so the angle is the acute one.
        return np.arctan2(sine, np.abs(np.vecdot(first_normal, second_normal)))
    # At the time 0 each input has its value in `q` and the speed 1 rad/s.
    speeds = (sk.ConstantSpeed(1.0, x) for x in q)
    laws = dict(zip(rows.input_pairs, speeds, strict=True))
    torques = sk.inverse_dynamics(mechanism, laws, [0.0]).torques
    return torques[:, rows.input_pairs.index(parts[-1]) if further_inputs else 0]


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("name", EVERY)
def test_numbers_in_the_table_are_those_of_python(opened, name, tmp_path):
    """The numbers in the table of a page are those that Python computes, to 1e-12.

    The table has the numbers at the current inputs. A link that an input drives is drawn
    with a knob. A page may have sliders that change sizes of the mechanism. Before the
    numbers are read, the knobs of all inputs are dragged by some pixels, and so is the last
    slider, if there is one. Then the page saves its mechanism, and Python computes the
    numbers for it. Each number of the table has to be that of some assembly mode (way to
    assemble the links). `opened` opens the page in a browser.
    """
    tab = opened(name)
    q_at_first = tab.evaluate("spherekit.state.q")
    for k in range(len(q_at_first)):
        for offset in ((12, -30), (25, 8)):
            drag(tab, tab.evaluate(f"spherekit.knobPlace({k})"), offset)
    q = tab.evaluate("spherekit.state.q")
    assert all(abs(a - b) > 0.01 for a, b in zip(q, q_at_first, strict=True))

    sliders = tab.locator("#sliders input[type=range]")
    if sliders.count():
        sliders.last.scroll_into_view_if_needed()
        box = sliders.last.bounding_box()
        drag(tab, (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2), (6, 0))
        assert tab.locator("#sliders .changed").count() == 1
    tab.wait_for_timeout(100)
    with tab.expect_download() as download:
        tab.click("#save")
    download.value.save_as(tmp_path / "changed.toml")
    changed = sk.load(tmp_path / "changed.toml")
    assert (changed == sk.load(name)) == (not sliders.count())

    cells = tab.locator("#values td[data-name]").all()
    assert cells
    for cell in cells:
        quantity = cell.get_attribute("data-name")
        value = float(cell.get_attribute("data-value"))
        # The sense of an axis is a choice, so signs are not compared.
        errors = np.abs(np.abs(compute_in_python(changed, q, quantity)) - abs(value))
        assert np.nanmin(errors) < 1e-12, (quantity, value)


@pytest.mark.slow
def test_keys_and_links_reach_what_a_mouse_does(opened):
    """Keys change the state of a page, its address keeps the state, controls have names.

    A page can be used without a mouse: keys turn the input and the view, choose the
    assembly mode (way to assemble the links) and show the steps in which poles (axes of
    relative rotation) are found. A link with the state opens the same view. Every control
    has a name that a screen reader can say.
    """
    tab = opened("four_bar", color_scheme="dark")
    assert tab.evaluate("document.documentElement.dataset.theme") == "dark"
    tab.focus("#sphere")
    start_input = tab.evaluate("spherekit.state.q[0]")
    # The input grows by 1 deg and by 10 deg, the view turns and comes nearer, and the next
    # assembly mode is chosen. Then "n" shows the first five steps of the construction of
    # poles one by one. Steps are counted from 0, so the last one is step 4.
    for key in (".", ">", "ArrowLeft", "+", "m", "n", "n", "n", "n", "n"):
        tab.keyboard.press(key)
    # Each size has a slider and a field for its number, in this order. So input 2 is the
    # slider of the second size, the crank's arc of 20 deg. A key moves it by 0.1 deg.
    tab.focus("#sliders input >> nth=2")
    tab.keyboard.press("ArrowRight")
    state = tab.evaluate("structuredClone(spherekit.state)")
    assert state["q"][0] == pytest.approx(start_input + np.radians(11.0))
    assert state["mode"] == 1
    assert state["sizes"] == [60.0, 20.1, 70.0, 40.0]
    assert state["step"] == 4
    # The pole of the step is marked (class "hand") twice in the table, which is symmetric.
    # P31 lies in the plane of P21 and P32, and in that of P41 and P43. The text of the step
    # says so as a product of planes. "case (a)" means that both planes go through poles.
    assert tab.locator("#table .hand").count() == 2
    assert "P31 case (a) = (P21 P32) x (P41 P43)" in tab.inner_text("#step")
    fragment = tab.evaluate("spherekit.link()")
    linked_state = opened("four_bar", fragment).evaluate("structuredClone(spherekit.state)")
    assert linked_state["yaw"] == pytest.approx(state["yaw"], abs=1e-4)
    for name in ("q", "sizes", "mode", "step"):
        assert linked_state[name] == state[name]
    names = tab.evaluate(
        """[...document.querySelectorAll("button, input, select, [tabindex]")].map(
        x => (x.ariaLabel || x.labels?.[0]?.innerText || x.innerText).trim())"""
    )
    assert len(names) > 30 and all(names)


@pytest.mark.slow
def test_a_mode_that_is_lost_is_red_and_ends_at_its_dead_centre(opened, tmp_path):
    tab = opened("four_bar", "links.2.arc=44&q=0.2")
    assert tab.inner_text("#lost") == "assembly lost"
    assert tab.locator("#drive .gone").count() == 1
    ends = tab.evaluate("spherekit.modes[0].curve.ends")
    longer = sk.load("four_bar").with_sizes(angle_unit="deg", arcs={"2": 44.0})
    exact = dead_centres(longer)
    assert np.allclose(np.sort(ends), np.sort(exact), rtol=0.0, atol=1e-9)
    rests = tab.evaluate("spherekit.modes[0].curve.rests")
    rates = [sk.evaluate(longer, q, assembly_mode=0) for q in rests]
    assert rests and all(abs(x.velocity_coefficient("4/1")) < 1e-9 for x in rates)


def dead_centres(mechanism):
    """Inputs of a four-bar with coupler and rocker in line, by the law of cosines."""
    ground, crank, coupler, rocker = (
        mechanism.geometry.links[link].arcs[0] for link in "1234"
    )
    folded = np.cos([coupler - rocker, coupler + rocker])
    at = (np.cos(ground) * np.cos(crank) - folded) / (-np.sin(ground) * np.sin(crank))
    angle = np.arccos(at[np.abs(at) < 1.0])
    return np.concatenate([angle, 2.0 * np.pi - angle])
