"""Every assembly mode of sources in C, JavaScript and Python against `sk.evaluate`.

`sk.evaluate` places dyads by angles of spherical triangles and follows other groups; the
sources compute the signs of triple products or take Newton's steps. Special four-bars stand
at a change point in the middle of their range, where no side of a dyad can be read.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.exported_languages import GCC, NODE, c_function, js_function, python_function
from mechanism_examples.special_mechanisms import four_bar

import spherekit as sk
from spherekit.cli.main import main
from spherekit.display.pages.page import PageMaker
from spherekit.errors import EngineError
from spherekit.exchange import mode_table
from spherekit.exchange.formula_maker import formulas
from spherekit.exchange.source_languages import source
from spherekit.mechanism.elements import Input
from spherekit.mechanism.load_kinds import Spring

HERE = Path(__file__).parent
CASES = ("cp2", "parallelogram", "folding", "ff_default")
QUANTITIES = ["theta_*", "rate_*"]
INPUTS = 20
ANGLE_TOLERANCE = 1e-9
"""Beside ten times what the configurations of `sk.evaluate` may be off by (rad)."""
KNOWN = 1e-7
"""Configurations that may be off by more (rad) are not compared: next to a dead centre."""
KINDS = {
    "change point": lambda a, b, c: (a, b, c, a + c - b),
    "parallelogram": lambda a, b, c: (a, b, a, b),
    "kite": lambda a, b, c: (a, a, b, b),
    "kite at its rocker": lambda a, b, c: (a, b, b, a),
    "flat-foldable vertex": lambda a, b, c: (a, b, 180.0 - a, 180.0 - b),
}


def case(name):
    return sk.load(str(HERE / "files" / f"{name}.toml"))


def special_four_bar(seed):
    """Return a four-bar of one of the `KINDS`, of whole degrees, by its seed."""
    random = np.random.default_rng(seed)
    kind = list(KINDS)[seed % len(KINDS)]
    arcs = (0.0,) * 4
    while min(arcs) < 10.0 or max(arcs) > 170.0:
        arcs = KINDS[kind](*(float(5 * x) for x in random.integers(4, 33, 3)))
    start = float(np.radians(random.choice([-180.0, -90.0, -60.0, 0.0])))
    made = four_bar([float(arc) for arc in arcs])
    drive = Input("21", start, start + 2.0 * np.pi)
    return replace(made, name=f"special_{seed}", inputs=(drive,))


def in_every_language(made, folder):
    """Yield the languages that are there, each with its function."""
    name = made.mechanism.name
    path = folder / name
    path.with_suffix(".py").write_text(source(made, "python"))
    yield "python", python_function(path.with_suffix(".py"), name)
    if GCC:
        path.with_suffix(".c").write_text(source(made, "c"))
        yield "c", c_function(path.with_suffix(".c"), name, len(made.results), "c")
    if NODE:
        path.with_suffix(".mjs").write_text(source(made, "js"))
        yield "js", js_function(path.with_suffix(".mjs"), name)


def inputs_of(made, mode, seed):
    """Return inputs (inputs, n): over the ranges, or near those of a mode for steps."""
    random = np.random.default_rng(seed)
    if made.step:
        return np.array(mode.at)[:, None] + random.uniform(-0.02, 0.02, (1, INPUTS))
    ranges = np.array([(x.start, x.stop) for x in made.mechanism.inputs])
    return ranges[:, :1] + np.ptp(ranges, axis=1)[:, None] * random.random((1, INPUTS))


def check_modes(mechanism, folder, least=0.5):
    """Check all modes of a mechanism's sources; return the largest difference (rad).

    At least the part `least` of the inputs must have been compared.
    """
    made = formulas(mechanism, QUANTITIES)
    assert not made.mode_table.left_out
    functions = dict(in_every_language(made, folder))
    steps = None
    if made.step:
        name = made.mechanism.name
        steps = python_function((folder / name).with_suffix(".py"), f"{name}_step")
    no_sizes, largest, compared = np.zeros((0, INPUTS)), 0.0, 0
    for mode in made.modes:
        q = inputs_of(made, mode, mode.number)
        places = np.repeat(np.array(mode.values).reshape(-1, 1), INPUTS, axis=1)
        for _ in range(10 if steps else 0):
            places, _ = steps(q, places, ())
        first = dict(zip(made.results, functions["python"](q, places, ()), strict=True))
        motion, rates = expected(made, mode, q, first)
        good = (motion.status == sk.Status.OK) & (motion.configuration_error < KNOWN)
        lost = motion.status == sk.Status.OUT_OF_REACH
        compared += np.sum(good)
        allowed = ANGLE_TOLERANCE + 10.0 * motion.configuration_error[good]
        for language, function in functions.items():
            results = function(q, places, no_sizes)
            if not made.step and made.places:
                assert np.all(np.any(np.isnan(results[:, lost]), axis=0)), language
            for key, values in zip(made.results, results, strict=True):
                kind, _, pair = key.partition("_")
                if kind == "theta":
                    wanted = motion.values[good, made.mechanism.angles[pair]]
                    off = np.abs(np.exp(1j * values[good]) - np.exp(1j * wanted))
                    assert np.all(off <= allowed), (language, mode, key, np.max(off))
                    largest = max([largest, *off])
                elif pair in rates:
                    wanted = rates[pair][good]
                    size = np.maximum(1.0, np.abs(wanted)) ** 2
                    off = np.abs(values[good] - wanted)
                    assert np.all(off <= 1e3 * allowed * size), (language, mode, key)
    assert compared >= least * INPUTS * len(made.modes), compared
    return largest


def expected(made, mode, q, found):
    """Return the motion (n rows) and rates by pair at inputs (inputs, n) in a mode.

    With several inputs modes are numbered by the inputs asked for. The configuration is
    taken that is nearest to the results `found`, at each input, and no rates are.
    """
    mechanism = made.mechanism
    if len(q) == 1:
        here = sk.evaluate(mechanism, q[0], assembly_mode=mode.number)
        rates = {pair: here.variable_coefficient(pair) for pair in mechanism.angles}
        return here._motion, rates
    motion = sk.trace(mechanism, path=q.T)
    off = [
        np.abs(np.exp(1j * found[f"theta_{pair}"][motion.sample]) - np.exp(1j * values))
        for pair, values in zip(
            mechanism.angles, motion.values[:, [*mechanism.angles.values()]].T, strict=True
        )
    ]
    apart = np.nan_to_num(np.max(off, axis=0), nan=np.inf)
    nearest = [
        rows[np.argmin(apart[rows])]
        for rows in (np.flatnonzero(motion.sample == k) for k in range(q.shape[1]))
    ]
    return motion.rows(np.array(nearest)), {}


@pytest.mark.many
@pytest.mark.parametrize("name", CASES)
def test_modes_through_a_singular_middle(name, tmp_path):
    """At the middle of their range a dyad is in line: no sign can be read there."""
    assert check_modes(case(name), tmp_path) < 1e-12
    signs = [mode.values for mode in formulas(case(name)).modes]
    assert signs == [(1.0,), (-1.0,)]


def test_a_change_point_by_numbers():
    """The four-bar 70, 30, 60, 40 deg at 1 rad, by spherical trigonometry, to 1e-5 rad."""
    made = formulas(case("cp2"), ["theta_tip", "theta_joint", "theta_out"])
    function = made.numpy_function(made.outputs)
    found = [
        function(np.ones((1, 1)), np.array([mode.values]).T, made.size_values)[:, 0]
        for mode in made.modes
    ]
    assert found[0][2] == pytest.approx(0.89580, abs=1e-5)
    assert found[1] == pytest.approx([2.72287, 1.26604, -1.95178], abs=1e-5)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("first", range(5))
def test_modes_of_special_four_bars(first, tmp_path):
    """Of each five kinds one; the modes of all close at some of the inputs at least."""
    for seed in range(first, 20 + first, 5):
        check_modes(special_four_bar(seed), tmp_path, least=0.2)


@pytest.mark.long
def test_modes_of_a_hundred_special_four_bars(tmp_path):
    for seed in range(100):
        check_modes(special_four_bar(seed), tmp_path, least=0.2)


@pytest.mark.many
@pytest.mark.parametrize(
    "name",
    [
        x if x in ("stephenson", "roller_cam") else pytest.param(x, marks=pytest.mark.slow)
        for x in sk.mechanisms()
    ],
)
def test_modes_of_shipped_mechanisms(name, tmp_path):
    mechanism = sk.load(name)
    if not mechanism.inputs:
        mechanism = mechanism.with_inputs(mechanism.pairs[0].name)
    assert check_modes(mechanism, tmp_path, least=0.1) < 1e-7


@pytest.mark.slow
def test_working_modes_of_a_coaxial_wrist(tmp_path):
    """All eight, by the inverse kinematics: its inputs are the angles of the head."""
    mechanism = sk.InverseKinematics(case("coaxial_wrist")).mechanism
    assert check_modes(mechanism, tmp_path, least=0.3) < 1e-9
    signs = {mode.values for mode in formulas(mechanism).modes}
    assert len(signs) == 8


def test_a_mode_that_formulas_do_not_give_is_not_written(tmp_path, monkeypatch, capsys):
    """The signs of mode 1 are made wrong before the comparison."""
    right = mode_table._find_candidate

    def wrong(tracer, sampled, mode, *others):
        candidate = right(tracer, sampled, mode, *others)
        return replace(candidate, places=np.abs(candidate.places))

    monkeypatch.setattr(mode_table, "_find_candidate", wrong)
    path = tmp_path / "x.c"
    assert main(["export", "four_bar", "--to", "c", "-o", str(path)]) == 0
    said = capsys.readouterr().err
    assert "left out: assembly mode 1 (-, p0): the formulas do not give this mode" in said
    text = path.read_text("utf-8")
    assert "not written: 1 (-, p0)" in text and "four_bar_modes[1][1]" in text
    assert "0 modes" not in sk.page("four_bar", tmp_path / "x.html").holds
    with pytest.raises(EngineError, match="no assembly mode can be written: 1"):
        sk.export("four_bar", path, assembly_mode=1)


@pytest.mark.slow
def test_a_mode_without_a_regular_sample_is_named():
    """A range of no width at a change point: every row there is singular."""
    flat = replace(case("cp2"), inputs=(Input("in", np.pi, np.pi + 1e-9),))
    with pytest.raises(EngineError, match="well conditioned.*give ranges"):
        formulas(flat)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("language", ["cpp", "julia", "casadi"])
def test_the_other_languages_name_the_same_modes(name, language):
    made = formulas(case(name))
    text = source(made, language)
    assert "1.0" in text and "-1.0" in text
    assert "0 (+): mode 1;" in text and "1 (-): mode -1;" in text
    said = " ".join(text.replace("# ", "").replace("// ", "").split())
    assert "each mode was compared with the mechanism at 20 inputs" in said


@pytest.mark.parametrize("name", CASES)
def test_pages_name_the_same_modes(name):
    text, _, modes = PageMaker(case(name), None, None, None).make_page()
    assert modes == 2
    for values in ("1.0", "-1.0"):
        assert f'"values": [\n    {values}\n' in text


def test_the_argument_that_counts_turns_is_explained():
    """A spring follows the angle itself, of which the formulas know the reduced one."""
    wound = replace(sk.load("four_bar"), loads=(Spring("wound", "32", 1.0),))
    text = source(formulas(wound, ["torque"]), "c")
    assert "turns_of_32 (rad: whole turns of theta_32, 0 while it is in (-pi, pi])" in text
