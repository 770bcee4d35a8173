"""Pages whose modes follow smooth curves through crossings, opened in Chromium.

The page joins signs of dyads by continuing directions of axes by a parabola; Python joins
modes by derivatives of the loops, and its angles are those that are compared.
"""

from pathlib import Path

import numpy as np
import pytest
from mechanism_examples.flat_mechanisms import (
    KINDS,
    four_bar_text,
    loaded,
    random_crossing_arcs,
    six_bar_with_a_flat_loop,
    two_vertices,
)

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import EngineError

FILES = Path(__file__).parent / "files"
CASES = ("flatfold_through", "parallelogram", "folding", "ff_default", "cp2")
TOLERANCE_RAD = 1e-8


def load_case(name):
    """Return the mechanism of a file of `tests/files`."""
    return sk.load(str(FILES / f"{name}.toml"))


@pytest.fixture
def open_page(browser, tmp_path):
    """Return a function that opens the page of a mechanism in a browser.

    Modes of the page continue through crossings (points at which curves of configurations
    cross). After the test there must be no message in the browser's console.
    """
    messages = []

    def open_tab(mechanism, fragment="", **options):
        path = tmp_path / "page.html"
        options = {"quantities": ["theta_*"], "crossings": "pass", **options}
        sk.page(mechanism, path, **options)
        tab = browser.new_page(viewport={"width": 1300, "height": 900})
        tab.on("console", lambda message: messages.append(message.text))
        tab.on("pageerror", lambda error: messages.append(str(error)))
        tab.goto(f"{path.as_uri()}#{fragment}")
        tab.wait_for_timeout(300)
        return tab

    yield open_tab
    assert not messages


def angles_on_page(tab, mechanism, q):
    """Return the pair angles that a page computes in every assembly mode.

    An assembly mode is one way to assemble the links. The browser runs the formulas of the
    page.

    Parameters
    ----------
    tab
        Browser tab that shows the page.
    mechanism, q
        The mechanism of the page, and inputs (n,) rad.

    Returns
    -------
    angles
        (modes, pairs, n) rad, in the order of the modes on the page. An angle is NaN where
        the mode does not close.
    mode_numbers
        Numbers that the same modes have in `sk.evaluate`.
    """
    # All modes have the same sizes, those of the sliders. `state` gives nothing where a
    # mode does not close.
    names = [f"theta_{pair}" for pair in mechanism.angles]
    rows = tab.evaluate(
        """([names, q]) => {
          const columns = names.map(name => spherekit.resultNames.indexOf(name));
          const sizes = spherekit.modes[0].sizes;
          return spherekit.modes.map(mode => q.map(x => {
            const row = mode.state([x], sizes)?.row;
            return columns.map(k => (row ? row[k] : null));
          }));
        }""",
        [names, q.tolist()],
    )
    return np.array(rows, dtype=float).swapaxes(1, 2), tab.evaluate("spherekit.modeNumbers")


def compare_page(tab, mechanism, crossings="pass", seed=0):
    """Compare the angles of all modes of a page with `sk.evaluate`.

    `tab` is the browser's tab that shows the page. Inputs are 20 random ones in the range,
    and four beside each crossing, an input at which curves of configurations cross.
    `crossings` says how modes continue there: "pass" along the smooth curve, "end" with the
    same signs of their dyads (two links joined by a pair).

    Returns
    -------
    int
        Number of compared configurations.
    """
    random = np.random.default_rng(seed)
    low, high = mechanism.inputs[0].range
    # `passed` of a mode are the inputs of the crossings through which it continues.
    crossing_inputs = tab.evaluate("spherekit.modes.flatMap(mode => mode.passed)")
    beside = [x + d for x in crossing_inputs for d in (-1e-2, -1e-3, 1e-3, 1e-2)]
    q = np.concatenate([random.uniform(low, high, 20), beside])
    mode_angles, numbers = angles_on_page(tab, mechanism, q)
    compared = 0
    for angles, number in zip(mode_angles, numbers, strict=True):
        rows = sk.evaluate(
            mechanism, q, poles=[], assembly_mode=number, crossings=crossings
        )
        is_accurate = (rows.status == sk.Status.OK) & (rows.configuration_error < 1e-10)
        compared += np.sum(is_accurate)
        for pair, values in zip(mechanism.angles, angles, strict=True):
            expected = rows.variable(pair)[is_accurate]
            gap = np.abs(np.exp(1j * values[is_accurate]) - np.exp(1j * expected))
            assert np.all(gap < TOLERANCE_RAD), (number, pair, np.max(gap))
    return compared


@pytest.mark.parametrize(
    "name",
    ["cp2", *(pytest.param(x, marks=pytest.mark.slow) for x in CASES if x != "cp2")],
)
def test_modes_of_a_page_are_those_of_evaluate(open_page, name):
    """Modes on a web page follow the smooth curves of `sk.evaluate` through a crossing.

    Each assembly mode (way to assemble the links) is a curve of configurations. At a
    crossing the curves of two modes cross. A sentence on the page names its input.
    `compare_page` compares angles and returns the number of compared configurations.
    """
    mechanism = load_case(name)
    tab = open_page(mechanism)
    # A page drives the first pair if the file names no input.
    if not mechanism.inputs:
        mechanism = mechanism.with_inputs(mechanism.pairs[0].name)
    assert compare_page(tab, mechanism) >= 40
    crossing = "0" if name == "flatfold_through" else "180"
    sentence = f"Modes follow their smooth curves through crossings at {crossing}°."
    assert tab.inner_text("#crossings") == sentence
    # At each sample between the first and the last one, every mode has values. There is
    # null where a mode does not exist.
    assert tab.evaluate(
        "spherekit.modes.every(({curve}) => curve.values.slice(1, -1).every(Boolean))"
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_modes_of_random_pages(open_page, seed):
    """Pages of random four-bars with crossings have the modes of `sk.evaluate`."""
    random = np.random.default_rng(seed + 300)
    arcs = random_crossing_arcs(random, KINDS[seed % len(KINDS)])
    low = int(random.choice([-180, -60, 0]))
    mechanism = loaded(four_bar_text(arcs, low, low + int(random.choice([360, 250]))))
    tab = open_page(mechanism)
    assert compare_page(tab, mechanism, seed=seed) > 0


@pytest.mark.slow
def test_several_dyads_change_at_once_on_a_page(open_page):
    mechanism = two_vertices()
    tab = open_page(mechanism)
    assert compare_page(tab, mechanism) > 60
    assert tab.inner_text("#crossings").endswith("through crossings at 0°.")


@pytest.mark.slow
def test_crossings_are_those_of_the_sizes_on_the_page(open_page):
    """Crossings follow the sizes on the page: one other arc has none, another vertex has
    one.
    """
    mechanism = loaded(four_bar_text((100, 60, 80, 120), -40, 40))
    tab = open_page(mechanism, "links.s3.arc=83")
    assert tab.inner_text("#crossings").startswith("With these sizes no curves cross")
    arcs = (100, 60, 83, 120)
    assert compare_page(tab, loaded(four_bar_text(arcs, -40, 40)), "end") > 20
    tab.evaluate("spherekit.change('sizes', {sizes: [95, 70, 85, 110]})")
    tab.wait_for_timeout(200)
    assert "crossings at 0°" in tab.inner_text("#crossings")
    assert compare_page(tab, loaded(four_bar_text((95, 70, 85, 110), -40, 40))) > 20


def bends_along_drag(tab, inputs):
    """Drag the knob of the input with the mouse along inputs (rad), in equal steps.

    The second differences of what is drawn are small along a smooth curve, and large where
    the curve has a kink.

    Returns
    -------
    bends
        (steps - 1, numbers) absolute second differences of the numbers from which the
        picture of mode 0 is drawn. The first numbers are the components of the axes of all
        pairs, others belong to contacts and outputs.
    """
    places = []  # where the knob is drawn at each input
    for q in inputs:
        tab.evaluate(f"spherekit.change('input', {{q: [{q}]}})")
        tab.wait_for_timeout(30)  # ms, so that the page is drawn anew
        places.append(tab.evaluate("spherekit.knobPlace(0)"))
    tab.evaluate(f"spherekit.change('input', {{q: [{inputs[0]}]}})")
    tab.wait_for_timeout(30)
    tab.mouse.move(*places[0])
    tab.mouse.down()
    rows = []
    reached_inputs = []
    for place in places:
        tab.mouse.move(*place)
        tab.wait_for_timeout(30)
        # All numbers from which the picture of mode 0 is drawn.
        rows.append(tab.evaluate("[...spherekit.modes[0].pictureRow]"))
        reached_inputs.append(tab.evaluate("spherekit.state.q[0]"))
    tab.mouse.up()
    # The mouse moves in whole pixels, so the inputs are only nearly those that were aimed
    # at.
    assert np.allclose(reached_inputs, inputs, atol=0.02)
    return np.abs(np.diff(np.array(rows, dtype=float), 2, axis=0))


@pytest.mark.slow
def test_a_knob_is_dragged_through_a_crossing(open_page):
    """Dragged through a crossing, axes of pairs move on evenly with `crossings="pass"`.

    With "end" they turn back there. Evenly means second differences below 0.01.
    """
    inputs = np.linspace(2.9, 3.4, 10)
    mechanism = load_case("cp2")
    largest_bends = {}
    for crossings in ("pass", "end"):
        tab = open_page(mechanism, "q=2.9", crossings=crossings)
        axes_of_pairs = slice(0, 3 * len(mechanism.pairs))
        bends = bends_along_drag(tab, inputs)
        largest_bends[crossings] = np.max(bends[:, axes_of_pairs])
    assert largest_bends["pass"] < 0.01 < 0.03 < largest_bends["end"]


@pytest.mark.slow
def test_a_curve_that_needs_two_turns_goes_on_in_the_other_mode(open_page):
    """On a curve that closes after two turns, dragging leads into the other mode.

    "cp2" is a four-bar whose crank, the input, can turn fully. It has two modes. At the
    input pi two smooth curves of configurations cross, and on the page each mode follows
    its own curve through the crossing. After one turn of the crank a mode is where the
    other mode began. So the smooth curve closes after two turns.

    A page shows inputs from 0 to 2 pi. The knob, which moves the input, is dragged from
    6.25 rad past 2 pi to about 0.05 rad. In mode 0 this leads into mode 1, and in mode 1 it
    leads back into mode 0. Between both drags the input is set back to 6.25 rad without
    dragging, which does not change the mode.
    """
    tab = open_page(load_case("cp2"), "q=6.25")
    for mode in (0, 1):
        assert tab.evaluate("spherekit.state.mode") == mode
        place = tab.evaluate("spherekit.knobPlace(0)")
        # Where the page draws the knob at the input 0.05 rad, the goal of the drag. To find
        # it, the input is set to 0.05 rad and then set back.
        place_ahead = tab.evaluate(
            """async () => {
              const now = spherekit.state.q;
              spherekit.change("input", {q: [0.05]});
              await new Promise(done => setTimeout(done, 150));
              const place = spherekit.knobPlace(0);
              spherekit.change("input", {q: now});
              await new Promise(done => setTimeout(done, 150));
              return place;
            }"""
        )
        tab.mouse.move(*place)
        tab.mouse.down()
        tab.mouse.move(*place_ahead, steps=6)
        tab.mouse.up()
        tab.wait_for_timeout(150)
        assert tab.evaluate("spherekit.state.q[0]") < 0.2
        tab.evaluate("spherekit.change('input', {q: [6.25]})")
        tab.wait_for_timeout(150)
    assert tab.evaluate("spherekit.state.mode") == 0


def test_command_and_default(tmp_path, capsys):
    path = tmp_path / "x.html"
    arguments = ["page", str(FILES / "cp2.toml"), "-o", str(path)]
    assert main([*arguments, "--crossings", "pass"]) == 0
    assert '"crossings": {"anchor": null}' in path.read_text()
    assert main(arguments) == 0
    assert '"crossings": null' in path.read_text()
    assert "a page with" in capsys.readouterr().out


@pytest.mark.slow
def test_a_page_that_takes_newton_steps_refuses_crossings(tmp_path):
    with pytest.raises(EngineError, match="curves cross at 0 deg.*Newton's method"):
        sk.page(six_bar_with_a_flat_loop(), tmp_path / "x.html", vary=[], crossings="pass")


def test_wound_springs_leave_out_the_torque(tmp_path):
    from dataclasses import replace

    from spherekit.mechanism.load_kinds import Spring

    wound = replace(sk.load("four_bar"), loads=(Spring("wound", "32", 1.0),))
    made = sk.page(wound, tmp_path / "x.html", vary=[], crossings="pass")
    assert "driving torque left out: " in made.notes[0] and "turns_of_32" in made.notes[0]
    assert not sk.page(wound, tmp_path / "x.html", vary=[]).notes


@pytest.mark.slow
def test_a_parallelogram_by_sizes(open_page):
    """The four-bar as shipped has no crossing; as a parallelogram it has one at 180 deg."""
    tab = open_page("four_bar")
    assert tab.inner_text("#crossings").startswith("With these sizes no curves cross")
    tab.evaluate("spherekit.change('sizes', {sizes: [60, 30, 60, 30]})")
    tab.wait_for_timeout(200)
    arcs = {"1": 60.0, "2": 30.0, "3": 60.0, "4": 30.0}
    changed = sk.load("four_bar").with_sizes(angle_unit="deg", arcs=arcs)
    assert "crossings at 180°" in tab.inner_text("#crossings")
    assert compare_page(tab, changed) > 40
