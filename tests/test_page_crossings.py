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


def case(name):
    return sk.load(str(FILES / f"{name}.toml"))


@pytest.fixture
def open_page(browser, tmp_path):
    """Opens the page of a mechanism; nothing may be said in the console."""
    messages = []

    def opener(mechanism, fragment="", **options):
        path = tmp_path / "page.html"
        options = {"quantities": ["theta_*"], "crossings": "pass", **options}
        sk.page(mechanism, path, **options)
        tab = browser.new_page(viewport={"width": 1300, "height": 900})
        tab.on("console", lambda message: messages.append(message.text))
        tab.on("pageerror", lambda error: messages.append(str(error)))
        tab.goto(f"{path.as_uri()}#{fragment}")
        tab.wait_for_timeout(300)
        return tab

    yield opener
    assert not messages


def angles_on_page(tab, mechanism, q):
    """Return the angles (modes, pairs, n) of a page at inputs q (n,), and its numbers."""
    names = [f"theta_{pair}" for pair in mechanism.angles]
    found = tab.evaluate(
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
    return np.array(found, dtype=float).swapaxes(1, 2), tab.evaluate(
        "spherekit.modeNumbers"
    )


def compare_page(tab, mechanism, crossings="pass", seed=0):
    """Compare all modes of a page with `sk.evaluate`; return how many rows are equal."""
    random = np.random.default_rng(seed)
    low, high = mechanism.with_inputs(mechanism.input_pairs[0]).inputs[0].range
    passed = tab.evaluate("spherekit.modes.flatMap(mode => mode.passed)")
    beside = [x + d for x in passed for d in (-1e-2, -1e-3, 1e-3, 1e-2)]
    q = np.concatenate([random.uniform(low, high, 20), beside])
    found, numbers = angles_on_page(tab, mechanism, q)
    compared = 0
    for angles, number in zip(found, numbers, strict=True):
        there = sk.evaluate(
            mechanism, q, poles=[], assembly_mode=number, crossings=crossings
        )
        is_known = (there.status == sk.Status.OK) & (there.configuration_error < 1e-10)
        compared += np.sum(is_known)
        for pair, values in zip(mechanism.angles, angles, strict=True):
            expected = there.variable(pair)[is_known]
            off = np.abs(np.exp(1j * values[is_known]) - np.exp(1j * expected))
            assert np.all(off < TOLERANCE_RAD), (number, pair, np.max(off))
    return compared


@pytest.mark.parametrize(
    "name",
    ["cp2", *(pytest.param(x, marks=pytest.mark.slow) for x in CASES if x != "cp2")],
)
def test_modes_of_a_page_are_those_of_evaluate(open_page, name):
    tab = open_page(case(name))
    mechanism = case(name)
    if not mechanism.inputs:
        mechanism = mechanism.with_inputs(mechanism.pairs[0].name)
    assert compare_page(tab, mechanism) >= 40
    crossing = "0" if name == "flatfold_through" else "180"
    said = f"Modes follow their smooth curves through crossings at {crossing}°."
    assert tab.inner_text("#crossings") == said
    # Nowhere along the curve of a mode there is a gap, except at the ends of the range.
    assert tab.evaluate(
        "spherekit.modes.every(({curve}) => curve.values.slice(1, -1).every(Boolean))"
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_modes_of_random_pages(open_page, seed):
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
    """They vanish with one size, and another vertex that folds flat has some again."""
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
    """Drag the knob along inputs; return how much steps of drawn directions change."""
    places = []
    for q in inputs:
        tab.evaluate(f"spherekit.change('input', {{q: [{q}]}})")
        tab.wait_for_timeout(30)
        places.append(tab.evaluate("spherekit.knobPlace(0)"))
    tab.evaluate(f"spherekit.change('input', {{q: [{inputs[0]}]}})")
    tab.wait_for_timeout(30)
    tab.mouse.move(*places[0])
    tab.mouse.down()
    rows, reached = [], []
    for place in places:
        tab.mouse.move(*place)
        tab.wait_for_timeout(30)
        rows.append(tab.evaluate("[...spherekit.modes[0].pictureRow]"))
        reached.append(tab.evaluate("spherekit.state.q[0]"))
    tab.mouse.up()
    assert np.allclose(reached, inputs, atol=0.02)
    return np.abs(np.diff(np.array(rows, dtype=float), 2, axis=0))


@pytest.mark.slow
def test_a_knob_is_dragged_through_a_crossing(open_page):
    """Drawn axes of pairs move on evenly; with "end" they turn back at the crossing."""
    inputs = np.linspace(2.9, 3.4, 10)
    mechanism = case("cp2")
    largest = {}
    for crossings in ("pass", "end"):
        tab = open_page(mechanism, "q=2.9", crossings=crossings)
        axes_of_pairs = slice(0, 3 * len(mechanism.pairs))
        bends = bends_along_drag(tab, inputs)
        largest[crossings] = np.max(bends[:, axes_of_pairs])
    assert largest["pass"] < 0.01 < 0.03 < largest["end"]


@pytest.mark.slow
def test_a_curve_that_needs_two_turns_goes_on_in_the_other_mode(open_page):
    tab = open_page(case("cp2"), "q=6.25")
    for mode in (0, 1):
        assert tab.evaluate("spherekit.state.mode") == mode
        place = tab.evaluate("spherekit.knobPlace(0)")
        ahead = tab.evaluate(
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
        tab.mouse.move(*ahead, steps=6)
        tab.mouse.up()
        tab.wait_for_timeout(150)
        assert tab.evaluate("spherekit.state.q[0]") < 0.2
        tab.evaluate("spherekit.change('input', {q: [6.25]})")
        tab.wait_for_timeout(150)
    assert tab.evaluate("spherekit.state.mode") == 0


def test_command_and_default(tmp_path, capsys):
    path = tmp_path / "x.html"
    words = ["page", str(FILES / "cp2.toml"), "-o", str(path)]
    assert main([*words, "--crossings", "pass"]) == 0
    assert '"crossings": {"anchor": null}' in path.read_text()
    assert main(words) == 0
    assert '"crossings": null' in path.read_text()
    assert "a page with" in capsys.readouterr().err


@pytest.mark.slow
def test_a_page_that_takes_newton_steps_refuses_crossings(tmp_path):
    with pytest.raises(EngineError, match="curves cross at 0 deg.*Newton's steps"):
        sk.page(six_bar_with_a_flat_loop(), tmp_path / "x.html", vary=[], crossings="pass")


def test_wound_springs_leave_out_the_torque(tmp_path):
    from dataclasses import replace

    from spherekit.mechanism.load_kinds import Spring

    wound = replace(sk.load("four_bar"), loads=(Spring("wound", "32", 1.0),))
    made = sk.page(wound, tmp_path / "x.html", vary=[], crossings="pass")
    assert "no driving torque: " in made.notes[0] and "turns_of_32" in made.notes[0]
    assert not sk.page(wound, tmp_path / "x.html", vary=[]).notes


@pytest.mark.slow
def test_a_parallelogram_by_sizes(open_page):
    """The four-bar as shipped has no crossing; as a parallelogram it has one inside."""
    tab = open_page("four_bar")
    assert tab.inner_text("#crossings").startswith("With these sizes no curves cross")
    tab.evaluate("spherekit.change('sizes', {sizes: [60, 30, 60, 30]})")
    tab.wait_for_timeout(200)
    arcs = {"1": 60.0, "2": 30.0, "3": 60.0, "4": 30.0}
    changed = sk.load("four_bar").with_sizes(angle_unit="deg", arcs=arcs)
    assert "crossings at 180°" in tab.inner_text("#crossings")
    assert compare_page(tab, changed) > 40
