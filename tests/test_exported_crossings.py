"""Sources whose modes follow smooth curves through crossings, against `sk.evaluate`.

`sk.evaluate(..., crossings="pass")` joins modes by continuing them with their derivatives,
and evaluates dyads by angles of spherical triangles. Sources have a table of signs. Of a
flat-foldable vertex the fold angles have a closed form that is used as well.
"""

import ctypes
import json
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.exported_languages import (
    GCC,
    GPP,
    JULIA,
    NODE,
    compile_shared_library,
    python_function,
)
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
from spherekit.exchange.formula_maker import formulas
from spherekit.exchange.source_languages import source
from spherekit.mechanism.load_kinds import Spring

FILES = Path(__file__).parent / "files"
CASES = ("flatfold_through", "parallelogram", "folding", "ff_default", "cp2")
QUICK = ("flatfold_through", "cp2")
ANGLE_TOLERANCE_RAD = 1e-9
"""Beside ten times the error bound of the configurations of `sk.evaluate`."""
MAX_ERROR_RAD = 1e-7
"""Configurations with a larger error bound are not compared."""
RATE_ROUNDING = 1e-14
"""Divided by the square of the distance (rad) from a crossing: rounding of rates there. The
square of a dyad's triple product is proportional to that of the distance."""


def load_case(name):
    """Return the mechanism of a file of `tests/files`."""
    return sk.load(str(FILES / f"{name}.toml"))


def c_results(path, exported_formulas, row, q, language):
    """Return the results (results, n) of the C or C++ source at inputs q (n,) in rad.

    `row` is the number of a mode (way to assemble the links) in the source's table. Where
    curves of configurations cross, a mode follows its smooth curve and changes signs of
    dyads (pairs of links). The function `smooth_mode` of the source returns the signs that
    a mode has at an input. C++ functions are wrapped in C ones, and the library is called
    for each input.

    The arguments of the formulas are arrays of the input, the signs and the sizes. Sizes
    are numbers of the mechanism that the caller may change. No such numbers were chosen in
    these tests, so the array of sizes is never read.
    """
    name = exported_formulas.mechanism.name
    if language == "cpp":
        header = path
        path = header.with_suffix(".cpp")
        calls = f"{name}_formulas::{name}"
        path.write_text(
            f'#include "{header.name}"\nextern "C" {{\n'
            f"void {name}_smooth_mode(int k, double q, double *mode)\n"
            f"{{\n    {calls}_smooth_mode(k, q, mode);\n}}\n"
            f"void {name}(const double *q, const double *mode, const double *size, "
            f"double *result)\n{{\n    {calls}(q, mode, size, result);\n}}\n}}\n"
        )
    library = compile_shared_library(path, language)
    smooth_mode = library[f"{name}_smooth_mode"]
    function = library[name]
    # Type of an array of 64 numbers, which are 0 unless given. One input needs one number,
    # and the signs need one for each dyad, so 64 are enough for both.
    long_array = ctypes.c_double * 64
    unread_sizes = long_array()
    columns = []
    for value in q.tolist():
        signs = long_array()
        result = (ctypes.c_double * len(exported_formulas.results))()
        smooth_mode(ctypes.c_int(row), ctypes.c_double(value), signs)
        function(long_array(value), signs, unread_sizes, result)
        columns.append([*result])
    return np.array(columns).T


def js_results(path, exported_formulas, row, q):
    """Return the results (results, n) of the JavaScript source at inputs q, run by Node."""
    name = exported_formulas.mechanism.name
    program = path.with_name("run.mjs")
    program.write_text(
        f"import {{{name} as f, {name}_smooth_mode as smooth}} from './{path.name}';\n"
        f"const q = {json.dumps(q.tolist())};\n"
        f"console.log(JSON.stringify(q.map(x => Array.from(f([x], smooth({row}, x), [])))))"
    )
    done = subprocess.run([NODE, str(program)], check=True, capture_output=True, text=True)
    return np.array(json.loads(done.stdout), dtype=float).T


def python_results(path, exported_formulas, number, q):
    """Return the results (results, n) of the Python source at inputs q, in a mode by
    number.
    """
    name = exported_formulas.mechanism.name
    smooth, function = (python_function(path, x) for x in (f"{name}_smooth_mode", name))
    return function(q[None], smooth(number, q), ())


def casadi_results(path, exported_formulas, number, q):
    """Return the results (results, n) of the CasADi source at inputs q, in a mode by
    number.
    """
    casadi = pytest.importorskip("casadi")
    name = exported_formulas.mechanism.name
    symbol = casadi.SX.sym("q")
    smooth = casadi.Function(
        "smooth", [symbol], [python_function(path, f"{name}_smooth_mode")(number, symbol)]
    )
    function = python_function(path, name)()
    columns = [np.array(function(x, smooth(x), []))[:, 0] for x in q.tolist()]
    return np.array(columns).T


def julia_results(path, exported_formulas, row, q):
    """Return the results (results, n) of the Julia source at inputs q, run by Julia."""
    name = exported_formulas.mechanism.name
    program = path.with_name("run.jl")
    program.write_text(
        f'include("{path.name}")\nfor q in {q.tolist()}\n'
        f"    println({name}([q], {name}_smooth_mode({row + 1}, q)))\nend\n"
    )
    done = subprocess.run([JULIA, str(program)], check=True, capture_output=True, text=True)
    lines = done.stdout.replace("NaN", "nan").splitlines()
    return np.array([[float(x) for x in line[1:-1].split(",")] for line in lines]).T


def results_by_language(exported_formulas, folder, row, q, languages):
    """Yield each installed language with the results (results, n) of its source.

    `row` is the row of a mode (way to assemble the links) in the list `modes`, and `q` (n,)
    are inputs in rad. The function `smooth_mode` of the source takes this row in C, C++,
    JavaScript and Julia. In Python and CasADi it takes the number by which the mechanism
    names the mode. The source is written to a file in `folder`, and run there.
    """
    mode_number = exported_formulas.modes[row].number
    endings = {"c": "c", "cpp": "hpp", "js": "mjs", "julia": "jl"}
    installed = {"c": GCC, "cpp": GPP, "js": NODE, "julia": JULIA}
    for language in languages:
        if not installed.get(language, True):
            continue
        path = folder / f"{language}_{row}_x.{endings.get(language, 'py')}"
        path.write_text(source(exported_formulas, language))
        if language in ("c", "cpp"):
            yield language, c_results(path, exported_formulas, row, q, language)
        elif language == "js":
            yield language, js_results(path, exported_formulas, row, q)
        elif language == "julia":
            yield language, julia_results(path, exported_formulas, row, q)
        elif language == "casadi":
            yield language, casadi_results(path, exported_formulas, mode_number, q)
        else:
            yield language, python_results(path, exported_formulas, mode_number, q)


def inputs_about(smooth, seed, count=24):
    """Return random inputs (rad) over three turns, and inputs beside all crossings."""
    random = np.random.default_rng(seed)
    crossings = np.array(smooth.crossings)
    distances = [-0.3, -1e-2, -1e-4, -1e-5, 1e-5, 1e-4, 1e-2, 0.3]
    beside = (crossings[:, None] + distances).ravel()
    anywhere = random.uniform(-2.0 * np.pi, 4.0 * np.pi, count)
    return np.concatenate([anywhere, beside, beside - 2.0 * np.pi])


def distances_from_crossings(smooth, q):
    """Return the chord (n,) from each input to the nearest crossing on the unit circle."""
    away = np.abs(np.exp(1j * q[:, None]) - np.exp(1j * np.array(smooth.crossings)))
    return np.min(away, axis=1, initial=2.0)


@dataclass(frozen=True)
class ExpectedMode:
    """One assembly mode by `sk.evaluate`, and how much sources may differ from it.

    A source is exported code in one of several languages. An assembly mode is one way to
    assemble the links. At a crossing two modes meet.

    Attributes
    ----------
    evaluated
        Result of `sk.evaluate` at inputs (n,).
    is_accurate
        (n,) True for the inputs that are compared, k of them: status OK, and a small error
        bound of the configuration.
    angle_tolerance_rad
        (k,) largest difference of angles: ten times the error bound of the configuration,
        plus `ANGLE_TOLERANCE_RAD`.
    rate_rounding
        (k,) rounding of rates beside a crossing. Sources compute the triple product t of
        the axes of a dyad (two links) as the square root of t^2, and divide by it to get
        rates. Rounding changes t^2 by about 1e-16, so rates have the relative error 1e-16 /
        t^2. Near a crossing t is proportional to the distance from it.
    """

    evaluated: Any
    is_accurate: Any
    angle_tolerance_rad: Any
    rate_rounding: Any

    def compare_angle(self, pair, angles, language):
        """Assert that a source has the right angles (n,) of a pair, up to whole turns."""
        expected = self.evaluated.variable(pair)[self.is_accurate]
        gap = np.abs(np.exp(1j * angles[self.is_accurate]) - np.exp(1j * expected))
        assert np.all(gap <= self.angle_tolerance_rad), (language, pair)

    def compare_rate(self, pair, rates, language):
        """Assert that a source has the right rates (n,) of a pair, per rate of the input.

        A rate differs by the error of the angles times its derivative. This derivative is
        not computed. It is assumed to be at most 1e3 times the square of the rate, which is
        enough for the mechanisms of these tests.
        """
        expected = self.evaluated.variable_coefficient(pair)[self.is_accurate]
        assumed_derivative = 1e3 * np.maximum(1.0, np.abs(expected)) ** 2
        tolerance = assumed_derivative * self.angle_tolerance_rad + self.rate_rounding
        gap = np.abs(rates[self.is_accurate] - expected)
        assert np.all(gap <= tolerance), (language, pair)


def expected_mode(mechanism, mode_number, smooth, q):
    """Return an assembly mode at inputs q (n,) in rad by `sk.evaluate`, as reference.

    An assembly mode (way to assemble the links) follows its smooth curve through crossings,
    where two modes meet. `smooth` is a table of the exported formulas. It has the inputs of
    the crossings, from which distances are measured.

    The results of exported code may differ by two tolerances. Angles may differ by ten
    times the error bound of the reference, because the exported code rounds too. For rates,
    the code divides by the square of a number that is proportional to the distance from the
    crossing. So the rounding of rates grows with 1 / distance^2.
    """
    evaluated = sk.evaluate(
        mechanism, q, poles=[], assembly_mode=mode_number, crossings="pass"
    )
    error_rad = evaluated.configuration_error
    is_accurate = (evaluated.status == sk.Status.OK) & (error_rad < MAX_ERROR_RAD)
    distances = distances_from_crossings(smooth, q)[is_accurate]
    return ExpectedMode(
        evaluated,
        is_accurate,
        angle_tolerance_rad=ANGLE_TOLERANCE_RAD + 10.0 * error_rad[is_accurate],
        rate_rounding=RATE_ROUNDING / distances**2,
    )


def compare_sources(mechanism, folder, seed=0, languages=("python",)):
    """Compare joint angles and their rates by sources with `sk.evaluate`, in all modes.

    A source is exported code that computes the formulas. A mode is a way to assemble the
    links. At a crossing two configuration curves meet. With `crossings="pass"` a mode
    follows its smooth curve through the crossing. The mode then consists of pieces; on
    each, the signs of its dyads (groups of two links) stay the same.

    Angles of all pairs are compared, but rates only of R pairs (revolute joints).

    Returns
    -------
    compared
        Number of compared configurations.
    changing_modes
        Number of modes whose signs change at a crossing.
    """
    exported_formulas = formulas(mechanism, ["theta_*", "rate_*"], crossings="pass")
    mechanism = exported_formulas.mechanism
    smooth = exported_formulas.mode_table.smooth
    q = inputs_about(smooth, seed)
    compared = 0
    changing_modes = 0
    for row, mode in enumerate(exported_formulas.modes):
        if len(smooth.pieces(row)) > 1:
            changing_modes += 1
        expected = expected_mode(mechanism, mode.number, smooth, q)
        compared += np.sum(expected.is_accurate)
        is_out_of_reach = expected.evaluated.status == sk.Status.OUT_OF_REACH
        for language, results in results_by_language(
            exported_formulas, folder, row, q, languages
        ):
            # A configuration out of reach has results that are NaN.
            assert np.all(np.any(np.isnan(results[:, is_out_of_reach]), axis=0)), language
            # Names of results are "theta_" or "rate_" with the name of a pair.
            for key, values in zip(exported_formulas.results, results, strict=True):
                kind, _, pair = key.partition("_")
                is_revolute = pair in mechanism.angles
                if kind == "theta":
                    expected.compare_angle(pair, values, language)
                elif is_revolute:
                    expected.compare_rate(pair, values, language)
    return compared, changing_modes


@pytest.mark.parametrize(
    "name",
    [x if x in QUICK else pytest.param(x, marks=pytest.mark.slow) for x in CASES],
)
def test_sources_follow_smooth_curves(name, tmp_path):
    """Python and C sources have the modes of `sk.evaluate` on either side of a crossing."""
    languages = ("python", "c", "js") if name == "cp2" else ("python", "c")
    compared, changed = compare_sources(load_case(name), tmp_path, languages=languages)
    assert compared > 60 and changed == 2


@pytest.mark.many
@pytest.mark.parametrize("language", ["cpp", "js", "julia", "casadi"])
def test_sources_in_other_languages_follow_smooth_curves(language, tmp_path):
    """C++, JavaScript, Julia and CasADi sources also have the modes of `sk.evaluate`."""
    compared, changed = compare_sources(load_case("cp2"), tmp_path, languages=[language])
    assert compared > 60 and changed == 2


@pytest.mark.parametrize("seed", range(2))
def test_sources_of_random_vertices_and_change_points(seed, tmp_path):
    compare_random(seed, tmp_path)


@pytest.mark.slow
def test_sources_of_many_vertices_and_change_points(tmp_path):
    assert sum(compare_random(seed, tmp_path) for seed in range(2, 22)) > 20


def compare_random(seed, folder):
    """Compare the sources of a random four-bar; return how many modes change signs."""
    random = np.random.default_rng(seed)
    arcs = random_crossing_arcs(random, KINDS[seed % len(KINDS)])
    low = int(random.choice([-180, -60, 0]))
    high = low + int(random.choice([360, 360, 250]))
    driven = str(random.choice(["c1", "c2"]))
    mechanism = loaded(four_bar_text(arcs, low, high, str(random.choice([0, 180])), driven))
    return compare_sources(mechanism, folder, seed)[1]


@pytest.mark.slow
def test_sources_of_several_dyads_that_change_at_once(tmp_path):
    compared, changed = compare_sources(two_vertices(), tmp_path)
    assert compared > 100 and changed == 4


SIX_BAR_AT_A_CHANGE_POINT = """
format = 1
name = "flat"
angle_unit = "deg"
ground = "s1"
[links]
s1 = { axes = ["c1", "c2", "d3"], arcs = [70, 80], angles = [40] }
s2 = { axes = ["c2", "c3"], arcs = [30] }
s3 = { axes = ["c3", "c4"], arcs = [60] }
s4 = { axes = ["c4", "c1", "d1"], arcs = [40, 45], angles = [30] }
s5 = { axes = ["d1", "d2"], arcs = [50] }
s6 = { axes = ["d2", "d3"], arcs = [60] }
[pairs]
c1 = { type = "R", links = ["s4", "s1"], zero = 0 }
c2 = { type = "R", links = ["s1", "s2"], zero = 0 }
c3 = { type = "R", links = ["s2", "s3"], zero = 0 }
c4 = { type = "R", links = ["s3", "s4"], zero = 0 }
d1 = { type = "R", links = ["s4", "s5"] }
d2 = { type = "R", links = ["s5", "s6"] }
d3 = { type = "R", links = ["s1", "s6"] }
[inputs.c1]
from = -170
to = 190
"""
"""The links s1 to s4 are a four-bar with the arcs 70, 30, 60 and 40 deg. At the input 0 all
its axes are in one plane, since 70 + 30 = 60 + 40. The crank s4 also drives a second dyad,
the links s5 and s6."""


@pytest.mark.slow
def test_a_six_bar_at_the_change_point_of_one_of_its_dyads(tmp_path):
    """Generated source code of a six-bar agrees with `sk.evaluate` near a change point.

    There are four assembly modes, one for each choice of the signs of both dyads. Only the
    sign of the first dyad, s2 and s3, can change at the change point.
    """
    mechanism = loaded(SIX_BAR_AT_A_CHANGE_POINT)
    compared, changing_modes = compare_sources(mechanism, tmp_path)
    # Each mode is compared at no more than 40 inputs, so more than one mode was compared.
    assert compared > 40
    assert changing_modes >= 2


def test_a_mechanism_whose_modes_do_not_cross(tmp_path):
    """Without crossings the source says so, and no mode changes its signs."""
    exported_formulas = formulas("four_bar", ["theta_41"], crossings="pass")
    assert exported_formulas.mode_table.smooth.crossings == ()
    assert "No curves cross between 0 and 6.28319 rad." in source(exported_formulas, "js")
    compared, changed = compare_sources(sk.load("four_bar"), tmp_path)
    assert compared > 20 and changed == 0


def mode_values_at(smooth, row, q):
    """Return the mode values (values, n) of a mode at inputs q (n,): signs of its dyads.

    The table `smooth` divides the inputs into intervals, each from its start to the next
    one, in which these values are constant. `row` is that of the mode in the table.
    """
    interval = np.searchsorted(smooth.starts, q) - 1
    return smooth.mode_values[interval, row].T


def test_fold_angles_by_exported_formulas_keep_their_ratio():
    """Tangents of half the fold angles stay in a constant ratio through the flat state.

    Huffman (1976) showed this for flat-foldable vertices. The ratios to the input crease c1
    are compared on both sides of the flat state, the input 0, in both modes (ways to fold).

    The exported formulas compute all fold angles from the input and the signs of a mode. A
    mode changes its signs in the flat state, so that it continues smoothly. The table
    `smooth` has these signs, and `mode_values_at` returns those at an input.
    """
    exported_formulas = formulas(
        load_case("flatfold_through"), ["theta_*"], crossings="pass"
    )
    smooth = exported_formulas.mode_table.smooth
    fold_angles = exported_formulas.numpy_function(exported_formulas.outputs)
    input_crease = list(exported_formulas.results).index("theta_c1")
    q = np.radians([-35.0, -20.0, -3.0, 3.0, 20.0, 35.0])
    for mode_row in range(2):
        # (creases, inputs) in rad
        signs = mode_values_at(smooth, mode_row, q)
        angles = fold_angles(q[None], signs, exported_formulas.size_values)
        half_tangents = np.tan(0.5 * angles)
        ratios = half_tangents / half_tangents[input_crease]
        assert np.ptp(ratios, axis=1).max() < 1e-9


def test_command_writes_and_says_where_curves_cross(tmp_path, capsys):
    """The command names the crossings; on request it writes functions for smooth modes."""
    path = tmp_path / "x.js"
    arguments = ["export", str(FILES / "parallelogram.toml"), "--to", "js", "-o", str(path)]
    assert main([*arguments, "--crossings", "pass"]) == 0
    message = capsys.readouterr().out
    assert "follow their smooth curves through crossings at 0, 180, 360 deg" in message
    text = path.read_text()
    assert "export function parallelogram_smooth_mode(k, q" in text
    assert "from 3.14159 rad on: argument mode = {-1}, for example at" in text
    assert main([*arguments, "--crossings", "end"]) == 0
    assert "smooth" not in path.read_text()


def test_signs_are_nan_right_at_a_crossing():
    """Within 5e-7 rad of a crossing a mode has no signs, as dyads are in line there."""
    formulas_of_mechanism = formulas(load_case("cp2"), ["theta_*"], crossings="pass")
    smooth = formulas_of_mechanism.mode_table.smooth
    for q in (np.pi, np.pi - 5e-7, np.pi + 5e-7):
        interval = np.searchsorted(smooth.starts, q) - 1
        assert np.all(np.isnan(smooth.mode_values[interval]))


def test_wrong_signs_beyond_a_crossing_are_noticed(monkeypatch, capsys, tmp_path):
    """An export fails if a mode keeps the signs that it has before a crossing.

    At a crossing two modes (ways to assemble the links) meet. The crossings divide the
    range of the input into four intervals. For a mode that passes them, the export
    determines the sign of the dyad (two links) in each interval (`mode_values`). Here all
    intervals get the sign of interval 1. The export then compares the formulas with the
    mechanism and must notice it.
    """
    from spherekit.exchange import mode_table

    find_candidate = mode_table._find_candidate

    def find_wrong_candidate(*arguments):
        candidate = find_candidate(*arguments)
        return replace(
            candidate, mode_values=np.broadcast_to(candidate.mode_values[1], (4, 1))
        )

    monkeypatch.setattr(mode_table, "_find_candidate", find_wrong_candidate)
    arguments = ["export", str(FILES / "parallelogram.toml"), "--to", "c", "--crossings"]
    assert main([*arguments, "pass", "-o", str(tmp_path / "x.c")]) != 0
    assert "the formulas do not give this mode" in capsys.readouterr().err


@pytest.mark.slow
def test_steps_from_the_starts_of_a_triad_lead_to_its_smooth_modes(tmp_path):
    """Newton's steps from stored configurations lead to the modes of `sk.evaluate`.

    The formulas of a mechanism are exported as source code, here in Python and C. At a
    crossing two configuration curves meet. With `crossings="pass"` an assembly mode (way to
    assemble the links) continues along its smooth curve through the crossing.

    The two modes of a dyad (two links) differ by a sign in its closed form. A triad (a
    group of four links) has no closed form, so the exported code uses Newton's method. As a
    start it stores the variables at one input (rad), for each mode and each side of the
    crossing.

    The test changes the input from the start to a goal in 200 steps, each with four
    iterations. The crossing is at the input 0, and there are goals on both sides. The code
    in Python is run. The code in C is only compiled.
    """
    mechanism = replace(six_bar_with_a_flat_loop(), name="flat_loop")
    exported_formulas = formulas(mechanism, ["theta_*"], crossings="pass")
    smooth = exported_formulas.mode_table.smooth
    assert len(smooth.crossings) == 1
    path = tmp_path / "x.py"
    path.write_text(source(exported_formulas, "python"))
    start = python_function(path, "flat_loop_smooth_variables")
    step = python_function(path, "flat_loop_step")
    angle_indices = list(mechanism.angles.values())
    modes_on_both_sides = 0
    compared = 0
    for row, mode in enumerate(exported_formulas.modes):
        # Each piece is a side of the crossing on which the mode has a stored start.
        if len(smooth.pieces(row)) > 1:
            modes_on_both_sides += 1
        for goal in (-0.2, -0.02, 0.02, 0.2):
            # The stored variables on the side of the goal, and the input at which they are.
            variables, q = start(mode.number, goal)
            evaluated = sk.evaluate(
                mechanism, goal, poles=[], assembly_mode=mode.number, crossings="pass"
            )
            # No start is stored on this side, or the mode does not reach the goal.
            if np.isnan(q) or evaluated.status != sk.Status.OK:
                continue
            for value in np.linspace(float(q), goal, 200):
                for _ in range(4):
                    # The formulas have no sizes as arguments. A step also returns how far
                    # the loops were open.
                    variables, _ = step(np.array([value]), variables, ())
            expected = np.array([evaluated.variable(pair) for pair in mechanism.angles])
            gap = np.abs(np.exp(1j * variables[angle_indices]) - np.exp(1j * expected))
            assert np.max(gap) < 1e-7, (mode, goal)
            compared += 1
    # The comparison is worth something only if enough cases were not skipped.
    assert modes_on_both_sides >= 2
    assert compared >= 6
    if GCC:
        path = tmp_path / "x.c"
        path.write_text(source(exported_formulas, "c"))
        compile_shared_library(path, "c")


def test_turns_are_counted_where_a_smooth_curve_turns_fully():
    """With a spring at a parallelogram's rocker, the torque needs a count of turns.

    `formulas` exports a function for the torque. The attribute `motion` of its result lists
    the arguments, and the count is one of them. The torque of a spring depends on whole
    turns of its pair, which an angle between -pi and pi does not tell. When all links of a
    parallelogram are in line, two configuration curves cross. With `crossings="pass"` a
    mode (way to assemble the links) follows the smooth curve through the crossings, on
    which the rocker (pair 41) turns fully. In the shipped four-bar the rocker only swings,
    so no count is needed.
    """
    arcs = {"1": 60.0, "2": 30.0, "3": 60.0, "4": 30.0}
    parallelogram = sk.load("four_bar").with_sizes(angle_unit="deg", arcs=arcs)
    spring = Spring("wound", "41", 1.0)
    turning = formulas(
        replace(parallelogram, loads=(spring,)), ["torque"], crossings="pass"
    )
    assert "turns_of_41" in [argument.name for argument in turning.motion]
    swinging = formulas(
        replace(sk.load("four_bar"), loads=(spring,)), ["torque"], crossings="pass"
    )
    assert "turns_of_41" not in [argument.name for argument in swinging.motion]


@pytest.mark.slow
def test_a_source_does_not_claim_that_searched_modes_cross_nowhere():
    """Where modes come from a search, a source says that curves may also cross elsewhere.

    The cam with a roller is equivalent to a four-bar with the arcs 60, 10, 37 and 33 deg.
    """
    text = (Path(sk.__file__).parents[1] / "mechanisms" / "roller_cam.toml").read_text()
    text = text.partition("[mass.cam]")[0].replace("[90.0, 45.0] }", "[90.0, 57.0] }")
    exported_formulas = formulas(loaded(text), ["theta_follower_pivot"], crossings="pass")
    assert not exported_formulas.mode_table.smooth.are_all_known
    comment = " ".join(source(exported_formulas, "js").replace("// ", "").split())
    assert "as far as crossings are known. Curves may also cross at inputs" in comment
