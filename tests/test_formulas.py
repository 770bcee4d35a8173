"""Formulas as source: compiled and run in every language, against the terms they are of.

Sizes, masses and loads as arguments against files with other numbers; see also
`test_latex.py`.
"""

import ctypes
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from helpers.exported_languages import GCC, STRICT, c_function, functions_by_language
from helpers.refusals import TABLES, check_call
from helpers.source_files import ROOT

import spherekit as sk
from spherekit.cli.main import main
from spherekit.designs.design_variables import (
    default_size_keys,
    design_variable,
    make_design,
)
from spherekit.errors import SpherekitError
from spherekit.exchange.formula_maker import formulas
from spherekit.files.mechanism_reader import read
from spherekit.files.number_change import document_of
from spherekit.files.toml_document import parse
from spherekit.symbolic.expression_evaluation import array_function

SEVERAL = ["four_bar", "double_butterfly", "shaped_cam", "five_bar", "planetary_bevel"]
"""A closed form, Newton's method, profiles, two inputs, wheels."""
EVERY = [*SEVERAL, *(name for name in sk.mechanisms() if name not in SEVERAL)]
MARKS = dict.fromkeys(EVERY[:16], pytest.mark.slow)
MARKS |= dict.fromkeys(("four_bar", "shaped_cam", "five_bar"), ())
ROWS = 200


def with_input(name):
    """Return a shipped mechanism's name, or the mechanism with an input if it has none."""
    mechanism = sk.load(name)
    return name if mechanism.inputs else mechanism.with_inputs(mechanism.pairs[0].name)


def evaluate_terms(formula_set, expressions, motion, mode_values, sizes=None):
    """Return the values (expressions, n) of symbolic expressions, by NumPy.

    The values are the reference for exported source code.

    Parameters
    ----------
    formula_set
        Formulas of a mechanism, with their symbols and tables.
    expressions
        Expressions of these formulas.
    motion
        (k, n) values of the formulas' symbols of motion. These are the inputs of the
        mechanism, and also rates and time if the formulas depend on them.
    mode_values
        (k, n) or (k, 1) values that select the assembly mode (way to assemble the links):
        signs of its dyads (groups of two links), or the variables of all pairs from which
        Newton's method starts.
    sizes
        (k, n) or (k, 1) values of those numbers of the file that the formulas take as
        arguments; by default the values of the file.
    """
    if sizes is None:
        sizes = np.array([size.value for size in formula_set.sizes])[:, None]
    n = np.shape(motion)[1]
    values = np.concatenate(
        [np.broadcast_to(x, (len(x), n)) for x in (motion, mode_values, sizes)]
    )
    # The symbols have the order of the rows of `values`: motion, mode values and sizes.
    motion_symbols, mode_symbols, size_symbols = formula_set.variables
    symbols = [*motion_symbols, *mode_symbols, *size_symbols]
    # A table has the functions that describe the profile of a contact, such as coordinates
    # of its points. They are functions of the arc length s, stored as series on cells with
    # the bounds `edges`. The formulas contain a symbol for each function (`table.terms`).
    # They contain a pair variable (`table.variable`), which is 0 at the arc length
    # `table.start`. Beyond the ends of an open profile the functions are NaN.
    table_columns = []
    for table in formula_set.tables:
        edges = table.series.edges
        s = values[symbols.index(table.variable)] + table.start
        if table.closed:
            s = edges[0] + np.mod(s - edges[0], table.length)
        column = table.series.evaluate(s)
        is_on_profile = (s >= edges[0]) & (s <= edges[-1])
        column[~is_on_profile] = np.nan
        table_columns.append(column.T)
    for table in formula_set.tables:
        symbols += table.terms
    function = array_function(expressions, symbols)
    return function(np.concatenate([values, *table_columns]))


def evaluate_results(formula_set, *columns):
    return evaluate_terms(formula_set, formula_set.outputs, *columns)


def evaluate_step(formula_set, *columns):
    return evaluate_terms(formula_set, formula_set.step, *columns)


def accepted_keys(mechanism_or_name):
    """Return keys of sizes, of a mass and of springs that formulas accept as arguments.

    A key names a number of the mechanism file. Which of them are accepted depends on the
    mechanism, so each candidate is tried with formulas of the inputs ("q*"). At most four
    sizes are taken, so that the formulas are short.
    """
    document = document_of(mechanism_or_name)
    mechanism = mechanism_or_name
    if isinstance(mechanism, str):
        mechanism = sk.load(mechanism)
    keys = list(default_size_keys(mechanism))[:4]
    first_mass = next(iter(document.data.get("mass", {})), None)
    keys += [f"mass.{first_mass}.mass", f"mass.{first_mass}.radius"]
    keys += [f"loads.{load}.stiffness" for load in document.data.get("loads", {})]
    accepted = []
    for key in keys:
        try:
            formulas(mechanism_or_name, ["q*"], [key])
        except SpherekitError:
            continue
        accepted.append(key)
    return accepted


def random_arguments(formula_set, seed=1):
    """Return 200 random arguments of formulas: motion, mode values and sizes.

    Each is an array (variables, 200). Motion has the inputs, their rates and further
    variables of time. Each column is in a random assembly mode (way to assemble the links).
    Mode values are the numbers that select the mode. Sizes are numbers of the file, changed
    by up to a thousandth.

    With a closed form, the mode values are signs. Otherwise they are pair variables: those
    of a known configuration of the mode, corrected by five steps of Newton's method at
    inputs near those of that configuration.
    """
    rng = np.random.default_rng(seed)
    modes = rng.integers(len(formula_set.modes), size=ROWS)
    motion = rng.uniform(-3.0, 3.0, (len(formula_set.motion), ROWS))
    mode_values = np.array([formula_set.modes[k].values for k in modes]).T.reshape(-1, ROWS)
    file_sizes = np.array([size.value for size in formula_set.sizes])[:, None]
    sizes = file_sizes * rng.uniform(0.999, 1.001, (len(formula_set.sizes), ROWS))
    has_closed_form = not formula_set.step  # the formulas of a step of Newton's method
    if not has_closed_form:
        # The inputs of the known configurations.
        inputs = np.array([formula_set.modes[k].at for k in modes]).T
        motion[: len(inputs)] = inputs + rng.uniform(-1e-3, 1e-3, inputs.shape)
        for _ in range(5):
            # The pair variables after a step, and in the last row the closure residual.
            after_step = evaluate_step(formula_set, motion, mode_values, sizes)
            mode_values = after_step[:-1]
    return motion, mode_values, sizes


@pytest.mark.many
@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=MARKS.get(x, pytest.mark.long)) for x in EVERY]
)
def test_sources_return_the_values_of_their_symbolic_terms(name, tmp_path):
    """Exported sources in every language return the values that NumPy gives.

    Formulas are symbolic expressions of the arguments. They are exported as source text in
    each language. For comparison, NumPy evaluates the expressions (`evaluate_results`). C
    and C++ may differ by 4 units of the last place. Other languages may differ by 1e-14
    plus 100 times the change of a result when arguments change by one rounding. This larger
    tolerance also applies to C and C++ if profiles in contact are stored as tables of
    coefficients (`formula_set.tables`).

    `accepted_keys` names the numbers of the file that become arguments.
    `random_arguments` has 200 sets of arguments.
    """
    mechanism = with_input(name)
    formula_set = formulas(mechanism, vary=accepted_keys(mechanism))
    arguments = random_arguments(formula_set)
    expected = evaluate_results(formula_set, *arguments)
    rng = np.random.default_rng(3)
    shaken_arguments = [
        x * (1.0 + 2e-16 * rng.choice([-1.0, 1.0], x.shape)) for x in arguments
    ]
    # The second argument selects the assembly mode. In closed form it consists of signs +1
    # and -1, which must not change. Otherwise there are formulas of a step of Newton's
    # method (`formula_set.step`), and the argument has the pair variables of a start point.
    if not formula_set.step:
        shaken_arguments[1] = arguments[1]
    sensitivity = np.abs(evaluate_results(formula_set, *shaken_arguments) - expected)
    is_finite = np.isfinite(expected) & np.isfinite(sensitivity)
    assert np.mean(is_finite) > 0.5
    size = np.maximum(1.0, np.abs(expected))
    for language, function in functions_by_language(tmp_path, name, formula_set):
        results = function(*arguments)
        assert np.all(np.isfinite(results[is_finite])), language
        if language in ("c", "cpp") and not formula_set.tables:
            tolerance = 4.0 * np.spacing(np.abs(expected))
        else:
            tolerance = 1e-14 * size + 100.0 * sensitivity
        gap = np.abs(results - expected)
        assert np.all(gap[is_finite] <= tolerance[is_finite]), language


@pytest.mark.many
@pytest.mark.parametrize(
    "name, keys",
    [
        ("four_bar", ["links.2.arc", "links.3.arc", "mass.3.tensor.1.1"]),
        ("five_bar", ["links.2.arc", "links.5.arc", "mass.3.mass", "mass.2.radius"]),
        ("stephenson", ["links.2.arc", "mass.2.radius"]),
        ("universal_joint", ["links.3.arc", "mass.2.centre.0"]),
        ("roller_cam", ["links.frame.arc", "pairs.contact.profiles.cam.radius"]),
        ("bevel_pair", ["links.0.arc"]),
        ("agile_eye", ["links.crank1.arc"]),
    ],
)
def test_arguments_are_numbers_of_the_file(name, keys):
    """Changing numbers by arguments of formulas or in the file has the same results.

    Formulas with some numbers of the file as arguments are compared with formulas of a file
    in which these numbers are changed. The values are 0.99 to 1.01 times those of the file.
    """
    document = document_of(name)
    variables = [design_variable(document, key) for key in keys]
    values = np.array([variable.value for variable in variables])
    values *= np.linspace(0.99, 1.01, len(keys))
    quantities = ["theta_*", "velocity_coefficient_*"]
    if sk.load(name).masses:
        # The inertia reduced to the input, and its derivatives.
        quantities.append("B*")
    changed_file = formulas(make_design(document, variables, values), quantities)
    formula_set = formulas(name, quantities, keys)
    # Random inputs, and the numbers that select an assembly mode (way to assemble).
    motion, mode_values, _ = random_arguments(changed_file)
    expected = evaluate_results(changed_file, motion, mode_values)
    # Arguments are in radians, files in degrees.
    units = np.where([size.unit == "rad" for size in formula_set.sizes], np.pi / 180.0, 1.0)
    sizes = (units * values)[:, None]
    results = evaluate_results(formula_set, motion, mode_values, sizes)
    # In some random rows the loops do not close. They are NaN in both results.
    assert np.mean(np.isfinite(expected)) > 0.5
    assert results == pytest.approx(expected, rel=1e-11, abs=1e-12, nan_ok=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["stephenson", "roller_cam", "planetary_bevel"])
def test_formulas_have_the_angles_and_coefficients_of_evaluate(name):
    """Formulas have the angles and velocity coefficients that `sk.evaluate` computes.

    The two place the links by different methods. Velocity coefficients (relative rates per
    rate of the input) are compared in magnitude, because an axis has two directions.
    """
    formula_set = formulas(name, ["theta_*", "velocity_coefficient_*"])
    links = sk.load(name).links
    for mode in formula_set.modes:
        # `mode.at` has the inputs of a configuration of the mode. `mode.values` tells the
        # formulas which mode to compute. It has the signs of the mode's dyads, or the pair
        # variables from which Newton's method starts.
        q = mode.at[0] + np.linspace(-0.05, 0.05, 5)
        evaluated = sk.evaluate(name, q, assembly_mode=mode.number)
        mode_values = np.reshape(mode.values, (-1, 1))
        motion = evaluated.q[None]  # (1, 5): one input at five samples
        columns = evaluate_results(formula_set, motion, mode_values)  # (results, 5)
        for key, values in zip(formula_set.results, columns, strict=True):
            if key.startswith("theta_"):
                gap = np.exp(1j * values) - np.exp(1j * evaluated.variable(key))
                assert np.max(np.abs(gap)) < 1e-12
                continue
            # velocity_coefficient_LINK_LINK. Links whose names contain "_" are split at the
            # wrong place, and then not compared.
            first, second = key.removeprefix("velocity_coefficient_").split("_")[:2]
            if first in links and second in links:
                earlier, later = sorted((first, second), key=links.index)
                expected = evaluated.velocity_coefficient(f"{later}/{earlier}")
                assert np.abs(values) == pytest.approx(np.abs(expected), abs=1e-12)


def test_default_coefficients_are_relative_to_the_ground():
    """A link x_1 is not taken for the ground 1, although its name ends in the same way."""
    text = (ROOT / "mechanisms" / "four_bar.toml").read_text()
    text = text.partition("[mass")[0].replace("[links.3]", "[links.x_1]")
    mechanism = read(parse(text.replace('"3"', '"x_1"'), "made"))
    assert mechanism.links == ("1", "2", "x_1", "4")
    names = [name for name in formulas(mechanism).results if "coefficient" in name]
    links = ("2", "x_1", "4")
    velocities = [f"velocity_coefficient_{link}_1" for link in links]
    assert names == velocities + [f"acceleration_coefficient_{link}_1" for link in links]


def test_fewer_results_take_fewer_operations():
    """Formulas of all results have more operations than those of angles or of one angle."""
    whole = formulas("stephenson")
    angles = formulas("stephenson", ["theta_*"])
    one = formulas("stephenson", ["theta_16"])
    assert whole.operations > 1.5 * angles.operations > 2.0 * one.operations > 50
    assert list(one.results) == ["theta_16"]


@pytest.mark.slow
@pytest.mark.skipif(not GCC, reason="no C compiler")
def test_newton_steps_of_a_source_close_the_loops(tmp_path):
    """Six calls of the step function in C converge quadratically to `sk.evaluate`.

    The function does one step of Newton's method, for a mechanism without a closed form.
    The input is 0.02 rad from the start of mode 2 (a way to assemble the links). Each call
    returns how far the loops were open before it.
    """
    formula_set = formulas("double_butterfly", ["theta_*"])
    source_path = str(tmp_path / "x.c")
    library_path = str(tmp_path / "x.so")
    sk.export("double_butterfly", source_path, quantities=["theta_*"])
    command = [GCC, *STRICT.split(), "-o", library_path, source_path, "-lm"]
    subprocess.run(command, check=True)
    step = ctypes.CDLL(library_path).double_butterfly_step
    step.restype = ctypes.c_double
    mode = formula_set.modes[2]
    q = mode.at[0] + 0.02
    variables = (ctypes.c_double * len(mode.values))(*mode.values)
    motion = (ctypes.c_double * 1)(q)
    no_sizes = (ctypes.c_double * 1)()
    residuals = [step(motion, variables, no_sizes) for _ in range(6)]
    assert residuals[0] > 1e-3
    assert residuals[2] < 1e-5
    assert max(residuals[4:]) < 1e-14
    evaluated = sk.evaluate("double_butterfly", q, assembly_mode=mode.number)
    names = sk.load("double_butterfly").variable_names
    for value, name in zip(variables, names, strict=True):
        gap = np.exp(1j * value) - np.exp(1j * evaluated.variable(name))
        assert abs(gap) < 1e-12


@pytest.mark.slow
@pytest.mark.skipif(not GCC, reason="no C compiler")
def test_stored_functions_have_their_source(tmp_path):
    """A reduced model has a source in C, whose last result is its driving torque."""
    archive = sk.load_reduced(sk.export("four_bar", tmp_path / "x.npz").path)
    sk.export("four_bar", tmp_path / "x.c", to="model")
    count = len(archive.heading.groups[0]) + 1
    function = c_function(tmp_path / "x.c", "four_bar", count, "c")
    q, dq, ddq, t = np.random.default_rng(4).uniform(-9.0, 9.0, (4, 50))
    columns = function(np.array([q, dq, ddq, t]), np.zeros((0, 50)), np.zeros((0, 50)))
    torque = archive.torque(q, dq, ddq, t)
    assert columns[-1] == pytest.approx(torque, rel=1e-12, abs=1e-12)


@pytest.mark.slow
@pytest.mark.skipif(not GCC, reason="no C compiler")
def test_sources_of_stored_functions_count_turns(tmp_path):
    """Exported C code of a reduced model counts the turns of the input.

    The model stores functions of the input over one period. In each further period the
    variable of the driven pair grows by a turn, and with it the torque of its spring: at
    1 rad + 1 turn, a spring of 3 N m/rad with rest at zero has 3*(1 + 2 pi) N m.

    The code returns the stored functions and, as the last result, the driving torque. The
    model in Python is the reference.
    """
    loads = (sk.Spring("coil", "21", stiffness=3.0, rest=0.0),)
    mechanism = replace(sk.load("four_bar"), loads=loads)
    model = sk.reduced_model(mechanism, assembly_mode=0)
    source_path = tmp_path / "x.c"
    sk.export(mechanism, source_path, to="model", assembly_mode=0)
    names = [function.name for function in model.heading.groups[0]]
    function = c_function(source_path, "four_bar", len(names) + 1, "c")
    q = np.array([1.0, 1.0 + 2.0 * np.pi, *np.linspace(-20.0, 20.0, 41)])
    rate = acceleration = time = np.zeros_like(q)
    # The code has no arguments that select the assembly mode or change sizes.
    no_arguments = np.zeros((0, len(q)))
    *functions, torque = function(
        np.array([q, rate, acceleration, time]), no_arguments, no_arguments
    )
    assert torque[:2] == pytest.approx([3.0, 3.0 * (1.0 + 2.0 * np.pi)], rel=1e-12)
    assert torque == pytest.approx(model.torque(q, 0.0, 0.0, 0.0), rel=1e-11)
    stored = model.functions(names, q).T
    assert np.array(functions) == pytest.approx(stored, rel=1e-11, abs=1e-11)


@pytest.mark.slow
def test_heads_speak_of_sides_of_dyads_only_with_signs_as_arguments(tmp_path):
    """Wheels and stored functions have no signs; a stored mode has no title either."""
    target = tmp_path / "x.c"
    sk.export("four_bar", target, quantities=["theta_41"])
    assert "one side of each dyad" in target.read_text("utf-8")
    sk.export("bevel_pair", target, quantities=["theta_*"])
    assert "dyad" not in target.read_text("utf-8")
    sk.export("four_bar", target, to="model")
    stored = target.read_text("utf-8")
    assert "dyad" not in stored
    assert " 0: argument mode is empty" in stored


@pytest.mark.skipif(not shutil.which("arm-none-eabi-gcc"), reason="no cross compiler")
def test_the_wiper_fits_a_microcontroller(tmp_path):
    """The formulas of the first tutorial's file compile for a Cortex-M4 to less than 8 kB.

    They are exported to C by one command, and compiled without a warning. The object has no
    global variables (sections data and bss).
    """
    page = (ROOT / "docs" / "first_mechanism.md").read_text("utf-8")
    file_text = page.partition("```toml\n")[2].partition("```")[0]
    (tmp_path / "wiper.toml").write_text(file_text)
    source_path = str(tmp_path / "wiper.c")
    object_path = source_path + ".o"
    arguments = ["export", str(tmp_path / "wiper.toml"), "--to", "c", "-o", source_path]
    assert main(arguments) == 0
    core = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
    warnings = [option for option in STRICT.split() if option not in ("-shared", "-fPIC")]
    compiler = ["arm-none-eabi-gcc", *core, *warnings, "-std=c99"]
    subprocess.run([*compiler, "-c", source_path, "-o", object_path], check=True)
    sizes = subprocess.check_output(["arm-none-eabi-size", object_path], text=True)
    text, data, bss = map(int, sizes.splitlines()[1].split()[:3])
    assert 1000 < text < 8000
    assert data == bss == 0


@pytest.mark.parametrize("call", TABLES["sources"])
def test_what_has_no_source_is_refused(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_call(call, globals(), TABLES["sources"][call])


@pytest.mark.parametrize("name", ["four_bar", "shaped_cam"])
def test_formulas_of_no_configurations_return_no_values(name):
    """Arrays of one column are combined with a motion of zero columns, without an error."""
    formula_set = formulas(name)
    motion = np.zeros((len(formula_set.motion), 0))
    mode_values = np.array(formula_set.modes[0].values)[:, None]
    evaluate = formula_set.numpy_function(formula_set.outputs)
    values = evaluate(motion, mode_values, formula_set.size_values)
    assert values.shape == (len(formula_set.outputs), 0)
