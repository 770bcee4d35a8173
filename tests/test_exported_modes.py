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
MAX_ERROR_RAD = 1e-7
"""Configurations that may be off by more (rad) are not compared: next to a dead centre."""
KINDS = {
    "change point": lambda a, b, c: (a, b, c, a + c - b),
    "parallelogram": lambda a, b, c: (a, b, a, b),
    "kite": lambda a, b, c: (a, a, b, b),
    "kite at its rocker": lambda a, b, c: (a, b, b, a),
    "flat-foldable vertex": lambda a, b, c: (a, b, 180.0 - a, 180.0 - b),
}


def load_case(name):
    """Return the mechanism of a file of `tests/files`."""
    return sk.load(str(HERE / "files" / f"{name}.toml"))


def special_four_bar(seed):
    """Return a four-bar with a change point; `seed` chooses one of `KINDS` and sizes.

    Arcs are whole degrees between 10 and 170. The input goes over one turn.
    """
    random = np.random.default_rng(seed)
    kind = list(KINDS)[seed % len(KINDS)]
    arcs = (0.0,) * 4
    while min(arcs) < 10.0 or max(arcs) > 170.0:
        arcs = KINDS[kind](*(float(5 * x) for x in random.integers(4, 33, 3)))
    start = float(np.radians(random.choice([-180.0, -90.0, -60.0, 0.0])))
    mechanism = four_bar([float(arc) for arc in arcs])
    driven = Input("21", start, start + 2.0 * np.pi)
    return replace(mechanism, name=f"special_{seed}", inputs=(driven,))


def functions_in_installed_languages(exported_formulas, folder):
    """Yield each installed language with the function of an exported source.

    The sources of the formulas are written into `folder`. The functions take arrays of
    numbers, one column for each configuration.
    """
    name = exported_formulas.mechanism.name
    path = folder / name
    path.with_suffix(".py").write_text(source(exported_formulas, "python"))
    yield "python", python_function(path.with_suffix(".py"), name)
    if GCC:
        path.with_suffix(".c").write_text(source(exported_formulas, "c"))
        yield (
            "c",
            c_function(path.with_suffix(".c"), name, len(exported_formulas.results), "c"),
        )
    if NODE:
        path.with_suffix(".mjs").write_text(source(exported_formulas, "js"))
        yield "js", js_function(path.with_suffix(".mjs"), name)


def random_inputs_of_mode(exported_formulas, mode, seed):
    """Return random inputs (inputs, n) in rad, over the whole ranges.

    Where formulas take Newton's steps, inputs are within 0.02 rad of the start of the mode.
    """
    random = np.random.default_rng(seed)
    if exported_formulas.step:
        return np.array(mode.at)[:, None] + random.uniform(-0.02, 0.02, (1, INPUTS))
    ranges = np.array([(x.start, x.stop) for x in exported_formulas.mechanism.inputs])
    return ranges[:, :1] + np.ptp(ranges, axis=1)[:, None] * random.random((1, INPUTS))


def check_modes(mechanism, folder, least=0.5):
    """Compare angles and rates of all modes of a mechanism's sources with `sk.evaluate`.

    Parameters
    ----------
    folder
        Folder into which sources are written.
    least
        Fraction of all random inputs that must have been compared at least. The others
        are out of reach or near dead centres.

    Returns
    -------
    largest
        Largest difference of an angle (rad).
    """
    exported_formulas = formulas(mechanism, QUANTITIES)
    assert not exported_formulas.mode_table.left_out
    functions = dict(functions_in_installed_languages(exported_formulas, folder))
    steps = None
    if exported_formulas.step:
        name = exported_formulas.mechanism.name
        steps = python_function((folder / name).with_suffix(".py"), f"{name}_step")
    no_sizes = np.zeros((0, INPUTS))
    largest = 0.0
    compared = 0
    for mode in exported_formulas.modes:
        q = random_inputs_of_mode(exported_formulas, mode, mode.number)
        # The signs of the mode, or the variables at its start, for each input
        mode_values = np.repeat(np.array(mode.values).reshape(-1, 1), INPUTS, axis=1)
        if steps:
            for _ in range(10):
                mode_values, _ = steps(q, mode_values, ())
        python_results = functions["python"](q, mode_values, ())
        results_by_name = dict(zip(exported_formulas.results, python_results, strict=True))
        motion, rates = evaluate_mode(exported_formulas, mode, q, results_by_name)
        is_accurate = motion.configuration_error < MAX_ERROR_RAD
        is_compared = (motion.status == sk.Status.OK) & is_accurate
        is_out_of_reach = motion.status == sk.Status.OUT_OF_REACH
        compared += np.sum(is_compared)
        tolerance = ANGLE_TOLERANCE + 10.0 * motion.configuration_error[is_compared]
        for language, function in functions.items():
            results = function(q, mode_values, no_sizes)
            if not exported_formulas.step and exported_formulas.mode_value_names:
                unreached = results[:, is_out_of_reach]
                assert np.all(np.any(np.isnan(unreached), axis=0)), language
            for key, values in zip(exported_formulas.results, results, strict=True):
                kind, _, pair = key.partition("_")
                if kind == "theta":
                    expected = motion.values[
                        is_compared, exported_formulas.mechanism.angles[pair]
                    ]
                    gap = np.abs(np.exp(1j * values[is_compared]) - np.exp(1j * expected))
                    assert np.all(gap <= tolerance), (language, mode, key, np.max(gap))
                    largest = max([largest, *gap])
                elif pair in rates:
                    expected = rates[pair][is_compared]
                    # Errors of angles are multiplied by the rates of the rates.
                    size = np.maximum(1.0, np.abs(expected)) ** 2
                    gap = np.abs(values[is_compared] - expected)
                    assert np.all(gap <= 1e3 * tolerance * size), (language, mode, key)
    assert compared >= least * INPUTS * len(exported_formulas.modes), compared
    return largest


def evaluate_mode(exported_formulas, mode, q, results_by_name):
    """Return the configurations and rates of a mode at inputs, by `sk.evaluate`.

    They are the reference for exported formulas. With several inputs an assembly mode (way
    to assemble the links) can have another number at other inputs. The configuration is
    then the one nearest to the results of the formulas.

    Parameters
    ----------
    exported_formulas
        The formulas, with their mechanism and its assembly modes.
    mode
        The mode of the formulas that is evaluated.
    q
        (driven pairs, n) values of the inputs in rad.
    results_by_name
        (n,) results of the formulas, by names such as ``theta_41``.

    Returns
    -------
    motion
        One configuration (row) for each of the n values.
    rates
        (n,) rates of the angles, by pair. Empty with several inputs.
    """
    mechanism = exported_formulas.mechanism
    if len(q) == 1:
        (values_of_input,) = q
        evaluated = sk.evaluate(mechanism, values_of_input, assembly_mode=mode.number)
        rates = {pair: evaluated.variable_coefficient(pair) for pair in mechanism.angles}
        return evaluated._motion, rates
    # All configurations at the n samples, in all assembly modes.
    motion = sk.trace(mechanism, path=q.T)
    gaps = []
    for pair, variable in mechanism.angles.items():
        angles = results_by_name[f"theta_{pair}"][motion.sample]
        # The chord on the unit circle does not change if an angle differs by 2 pi.
        gaps.append(np.abs(np.exp(1j * angles) - np.exp(1j * motion.values[:, variable])))
    # NaN belongs to configurations that do not close. They are never the nearest.
    distances = np.nan_to_num(np.max(gaps, axis=0), nan=np.inf)
    nearest_rows = []
    for sample in range(q.shape[1]):
        rows = np.flatnonzero(motion.sample == sample)
        nearest_rows.append(rows[np.argmin(distances[rows])])
    return motion.rows(np.array(nearest_rows)), {}


@pytest.mark.many
@pytest.mark.parametrize("name", CASES)
def test_sources_have_both_modes_though_the_middle_of_the_range_is_singular(name, tmp_path):
    """Sources have both modes of a four-bar with a change point amid its range.

    At the middle the dyad is in line, so that its sign has to be read elsewhere.
    """
    assert check_modes(load_case(name), tmp_path) < 1e-12
    signs = [mode.values for mode in formulas(load_case(name)).modes]
    assert signs == [(1.0,), (-1.0,)]


def test_a_change_point_by_numbers():
    """The four-bar 70, 30, 60, 40 deg at 1 rad, by spherical trigonometry, to 1e-5 rad."""
    exported_formulas = formulas(
        load_case("cp2"), ["theta_tip", "theta_joint", "theta_out"]
    )
    function = exported_formulas.numpy_function(exported_formulas.outputs)
    angles = [
        function(np.ones((1, 1)), np.array([mode.values]).T, exported_formulas.size_values)[
            :, 0
        ]
        for mode in exported_formulas.modes
    ]
    assert angles[0][2] == pytest.approx(0.89580, abs=1e-5)
    assert angles[1] == pytest.approx([2.72287, 1.26604, -1.95178], abs=1e-5)


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
        if x != "miura_unit"
    ],
)
def test_modes_of_shipped_mechanisms(name, tmp_path):
    """Sources of every shipped mechanism but one have all of its modes.

    The Miura unit is over-constrained. Its source has the equations that are independent
    in the Miura fold. Modes with creases that are folded by 180 deg need others.
    """
    mechanism = sk.load(name)
    if not mechanism.inputs:
        mechanism = mechanism.with_inputs(mechanism.pairs[0].name)
    assert check_modes(mechanism, tmp_path, least=0.1) < 1e-7


@pytest.mark.slow
def test_the_source_of_the_miura_unit_has_the_miura_fold_and_names_what_it_lacks():
    exported = formulas(sk.load("miura_unit"))
    modes = sk.run("miura_unit", samples=3).summary["assembly_modes"]
    assert exported.modes[0].name.endswith("miura")
    left_out = exported.mode_table.left_out
    assert len(exported.modes) + len(left_out) == len(modes)
    repetition = "equations of this mechanism repeat others"
    assert all(repetition in mode.reason for mode in left_out)
    numbers = tuple(mode.number for mode in left_out)
    assert exported.mode_table.undetermined == numbers


def modes_without_common_source():
    """Return the numbers of the modes of the Miura unit that need a source of their own.

    The closure equations of the Miura unit repeat each other. The source of all modes has
    a choice of equations that are independent in the Miura fold. In other modes, where some
    creases are folded by 0 or 180 degrees, these equations do not determine the angles, so
    the source lacks such modes. How many they are depends on the chosen equations, and so
    on the processor.
    """
    numbers = formulas(sk.load("miura_unit")).mode_table.undetermined
    assert numbers
    return numbers


@pytest.mark.slow
def test_an_export_names_the_option_for_a_mode_that_its_source_lacks(tmp_path, capsys):
    path = tmp_path / "x.c"
    assert main(["export", "miura_unit", "--to", "c", "-o", str(path)]) == 0
    printed = capsys.readouterr().out
    assert f"--assembly-mode {modes_without_common_source()[0]}" in printed


@pytest.mark.slow
def test_each_mode_of_the_miura_unit_has_a_source_of_its_own():
    """A source of one mode has this mode, although the source of all modes lacks it."""
    for number in modes_without_common_source():
        exported = formulas(sk.load("miura_unit"), assembly_mode=number)
        (mode,) = exported.modes
        assert mode.number == number
        assert not exported.mode_table.left_out
        # A crease of this mode is folded by 0 or 180 degrees.
        assert np.min(np.abs(np.sin(mode.values))) < 1e-12
        assert exported.mode_table.largest_difference < 1e-9


@pytest.mark.slow
def test_working_modes_of_a_coaxial_wrist(tmp_path):
    """All eight, by the inverse kinematics: its inputs are the angles of the head."""
    mechanism = sk.InverseKinematics(load_case("coaxial_wrist")).mechanism
    assert check_modes(mechanism, tmp_path, least=0.3) < 1e-9
    signs = {mode.values for mode in formulas(mechanism).modes}
    assert len(signs) == 8


@pytest.fixture
def wrong_sign_of_mode_1(monkeypatch):
    """Let the export look for mode 1 of the four-bar with a wrong sign of its dyad.

    The formulas of a four-bar select one of its two assembly modes by this sign, 1 for mode
    0 and -1 for mode 1 (`mode_values`). Here both modes get 1.
    """
    find_candidate = mode_table._find_candidate

    def find_wrong_candidate(*arguments):
        """Return a mode that may be exported, with the sign 1 instead of -1."""
        candidate = find_candidate(*arguments)
        return replace(candidate, mode_values=np.abs(candidate.mode_values))

    monkeypatch.setattr(mode_table, "_find_candidate", find_wrong_candidate)


@pytest.mark.usefixtures("wrong_sign_of_mode_1")
def test_a_mode_that_formulas_do_not_give_is_left_out_and_named(tmp_path, capsys):
    """Mode 1, which the file names p0, is left out, and mode 0 is still exported."""
    path = tmp_path / "x.c"
    assert main(["export", "four_bar", "--to", "c", "-o", str(path)]) == 0
    message = capsys.readouterr().out
    assert "left out: assembly mode 1 (p0): the formulas do not give this mode" in message
    text = path.read_text("utf-8")
    assert "not written: 1 (p0)" in text
    # The table of modes in the source has one row and one column.
    assert "four_bar_modes[1][1]" in text


@pytest.mark.usefixtures("wrong_sign_of_mode_1")
def test_a_mode_that_formulas_do_not_give_is_not_exported_alone(tmp_path):
    with pytest.raises(EngineError, match="no assembly mode can be written: 1"):
        sk.export("four_bar", tmp_path / "x.c", assembly_mode=1)


@pytest.mark.usefixtures("wrong_sign_of_mode_1")
def test_a_page_has_the_modes_that_formulas_give(tmp_path):
    """The page says in words (`holds`) what it contains, with the number of its modes."""
    assert "0 modes" not in sk.page("four_bar", tmp_path / "x.html").holds


@pytest.mark.slow
def test_a_mode_without_a_regular_sample_is_named():
    """A range of 1e-9 rad at a change point has singular samples only, and is refused."""
    flat = replace(load_case("cp2"), inputs=(Input("in", np.pi, np.pi + 1e-9),))
    with pytest.raises(EngineError, match="well conditioned.*give ranges"):
        formulas(flat)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("language", ["cpp", "julia", "casadi"])
def test_the_other_languages_name_the_same_modes(name, language):
    """Sources in C++, Julia and CasADi list both modes and say how they were checked."""
    exported_formulas = formulas(load_case(name))
    text = source(exported_formulas, language)
    assert "1.0" in text and "-1.0" in text
    assert "0 (+): argument mode = {1}, exists for example at" in text
    assert "1 (-): argument mode = {-1}, exists for example at" in text
    comment = " ".join(text.replace("# ", "").replace("// ", "").split())
    assert "each mode was compared with the mechanism at 20 inputs" in comment


@pytest.mark.parametrize("name", CASES)
def test_pages_name_the_same_modes(name):
    """The page of a four-bar with a change point has the signs of both modes."""
    text, _, modes = PageMaker(load_case(name), None, None, None).make_page()
    assert modes == 2
    for values in ("1.0", "-1.0"):
        assert f'"values": [\n    {values}\n' in text


def test_the_argument_that_counts_turns_is_explained():
    """A spring follows the angle itself, of which the formulas know the reduced one."""
    wound = replace(sk.load("four_bar"), loads=(Spring("wound", "32", 1.0),))
    text = source(formulas(wound, ["torque"]), "c")
    assert "turns_of_32 (rad: whole turns of theta_32, 0 while it is in (-pi, pi])" in text
