"""Formulas as source: compiled and run in every language, against the terms they are of.

Sizes, masses and loads as arguments against files with other numbers; see also
`test_latex.py`.
"""

import ctypes
import shutil
import subprocess

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
from spherekit.files.number_change import document_of
from spherekit.symbolic.expression_evaluation import array_function

SEVERAL = ["four_bar", "double_butterfly", "shaped_cam", "five_bar", "planetary_bevel"]
"""A closed form, Newton's method, profiles, two inputs, wheels."""
EVERY = [*SEVERAL, *(name for name in sk.mechanisms() if name not in SEVERAL)]
MARKS = dict.fromkeys(EVERY[:16], pytest.mark.slow)
MARKS |= dict.fromkeys(("four_bar", "shaped_cam", "five_bar"), ())
ROWS = 200


def driven(name):
    mechanism = sk.load(name)
    return name if mechanism.inputs else mechanism.with_inputs(mechanism.pairs[0].name)


def computed(made, items, motion, places, sizes=None):
    """Return terms (n,) of formulas at motions, places and sizes, by NumPy."""
    if sizes is None:
        sizes = np.array([size.value for size in made.sizes])[:, None]
    n = np.shape(motion)[1]
    values = np.concatenate(
        [np.broadcast_to(x, (len(x), n)) for x in (motion, places, sizes)]
    )
    terms = [x for kind in made.variables for x in kind]
    columns = []
    for table in made.tables:
        s, low = values[terms.index(table.of)] + table.start, table.series.edges[0]
        s = low + np.mod(s - low, table.length) if table.closed else s
        column = table.series.evaluate(s)
        column[~((s >= low) & (s <= table.series.edges[-1]))] = np.nan
        columns.append(column.T)
    terms += [x for table in made.tables for x in table.terms]
    return array_function(items, terms)(np.concatenate([values, *columns]))


def at(made, *columns):
    return computed(made, made.outputs, *columns)


def stepped(made, *columns):
    return computed(made, made.step, *columns)


def keys_of(given):
    """Return what can vary: the sizes, or what the file allows of them, a mass, a load."""
    document = document_of(given)
    mechanism = sk.load(given) if isinstance(given, str) else given
    keys = list(default_size_keys(mechanism))[:4]
    mass = next(iter(document.data.get("mass", {})), None)
    keys += [f"mass.{mass}.mass", f"mass.{mass}.radius"]
    keys += [f"loads.{load}.stiffness" for load in document.data.get("loads", {})]
    kept = []
    for key in keys:
        try:
            formulas(given, ["q*"], [key])
            kept.append(key)
        except SpherekitError:
            continue
    return kept


def samples(made, seed=1):
    """Return motions, places and sizes (k, n) about those of the modes."""
    rng = np.random.default_rng(seed)
    which = rng.integers(len(made.modes), size=ROWS)
    motion = rng.uniform(-3.0, 3.0, (len(made.motion), ROWS))
    places = np.array([made.modes[k].values for k in which]).T.reshape(-1, ROWS)
    sizes = np.array([size.value for size in made.sizes])[:, None] * rng.uniform(
        0.999, 1.001, (len(made.sizes), ROWS)
    )
    if made.step:
        inputs = np.array([made.modes[k].at for k in which]).T
        motion[: len(inputs)] = inputs + rng.uniform(-1e-3, 1e-3, inputs.shape)
        for _ in range(5):
            places = stepped(made, motion, places, sizes)[:-1]
    return motion, places, sizes


@pytest.mark.many
@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=MARKS.get(x, pytest.mark.long)) for x in EVERY]
)
def test_sources_return_what_the_terms_do(name, tmp_path):
    """C to 4 units of the last place, others to 1e-14 or what one unit of a sample does."""
    given = driven(name)
    keys = keys_of(given)
    made = formulas(given, vary=keys)
    columns = samples(made)
    wanted = at(made, *columns)
    rng = np.random.default_rng(3)
    moved = [x * (1.0 + 2e-16 * rng.choice([-1.0, 1.0], x.shape)) for x in columns]
    if not made.step:
        moved[1] = columns[1]
    shaken = np.abs(at(made, *moved) - wanted)
    known = np.isfinite(wanted) & np.isfinite(shaken)
    assert np.mean(known) > 0.5
    size = np.maximum(1.0, np.abs(wanted))
    for language, function in functions_by_language(tmp_path, name, made):
        found = function(*columns)
        off = np.abs(found - wanted)
        assert np.array_equal(np.isfinite(found[known]), np.isfinite(wanted[known]))
        if language in ("c", "cpp") and not made.tables:
            allowed = 4.0 * np.spacing(np.abs(wanted))
        else:
            allowed = 1e-14 * size + 100.0 * shaken
        assert np.all(off[known] <= allowed[known]), language


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
    """Inertia follows arcs where the file states masses by them."""
    document = document_of(name)
    variables = [design_variable(document, key) for key in keys]
    values = np.array([v.value for v in variables]) * np.linspace(0.99, 1.01, len(keys))
    quantities = ["theta_*", "velocity_coefficient_*"]
    quantities += ["B*"] * bool(sk.load(name).masses)
    other = formulas(make_design(document, variables, values), quantities)
    made = formulas(name, quantities, keys)
    motion, places, _ = samples(other)
    units = np.where([size.unit == "rad" for size in made.sizes], np.pi / 180.0, 1.0)
    wanted = at(other, motion, places)
    found = at(made, motion, places, (units * values)[:, None])
    assert np.mean(np.isfinite(wanted)) > 0.5
    assert found == pytest.approx(wanted, rel=1e-11, abs=1e-12, nan_ok=True)


@pytest.mark.parametrize("name", ["stephenson", "roller_cam", "planetary_bevel"])
def test_formulas_say_what_the_motion_does(name):
    """Angles and coefficients are those of `sk.evaluate`, which places links otherwise."""
    made = formulas(name, ["theta_*", "velocity_coefficient_*"])
    links = sk.load(name).links
    for mode in made.modes:
        here = sk.evaluate(
            name, mode.at[0] + np.linspace(-0.05, 0.05, 5), assembly_mode=mode.number
        )
        places = np.reshape(mode.values, (-1, 1))
        found = dict(zip(made.results, at(made, here.q[None], places), strict=True))
        for key, values in found.items():
            kind, _, rest = key.partition("_")
            if kind == "theta":
                off = np.exp(1j * values) - np.exp(1j * here.variable(key))
                assert np.max(np.abs(off)) < 1e-12
                continue
            one, other = rest.removeprefix("coefficient_").split("_")[:2]
            if one in links and other in links:
                later, earlier = sorted((one, other), key=links.index, reverse=True)
                rate = here.velocity_coefficient(f"{later}/{earlier}")
                assert np.abs(values) == pytest.approx(np.abs(rate), abs=1e-12)


def test_what_is_asked_for_less_takes_less():
    whole = formulas("stephenson")
    angles = formulas("stephenson", ["theta_*"])
    one = formulas("stephenson", ["theta_16"])
    assert whole.operations > 1.5 * angles.operations > 2.0 * one.operations > 50
    assert list(one.results) == ["theta_16"]


@pytest.mark.slow
@pytest.mark.skipif(not GCC, reason="no C compiler")
def test_a_step_of_newton_s_method_closes_loops(tmp_path):
    made = formulas("double_butterfly", ["theta_*"])
    sk.export("double_butterfly", tmp_path / "x.c", quantities=["theta_*"])
    words = [
        GCC,
        *STRICT.split(),
        "-o",
        str(tmp_path / "x.so"),
        str(tmp_path / "x.c"),
        "-lm",
    ]
    subprocess.run(words, check=True)
    step = ctypes.CDLL(str(tmp_path / "x.so")).double_butterfly_step
    step.restype = ctypes.c_double
    mode = made.modes[2]
    count = len(mode.values)
    variables = (ctypes.c_double * count)(*mode.values)
    motion, none = (ctypes.c_double * 1)(mode.at[0] + 0.02), (ctypes.c_double * 1)()
    opened = [step(motion, variables, none) for _ in range(6)]
    assert opened[0] > 1e-3 > 1e-5 > opened[2] and max(opened[4:]) < 1e-14
    there = sk.evaluate("double_butterfly", mode.at[0] + 0.02, assembly_mode=mode.number)
    for value, name in zip(
        variables, sk.load("double_butterfly").variable_names, strict=True
    ):
        off = np.exp(1j * value) - np.exp(1j * there.variable(name)[0])
        assert abs(off) < 1e-12


@pytest.mark.skipif(not GCC, reason="no C compiler")
def test_stored_functions_have_their_source(tmp_path):
    """The inverse dynamics of the archive, in C."""
    archive = sk.load_reduced(sk.export("four_bar", tmp_path / "x.npz").path)
    sk.export("four_bar", tmp_path / "x.c", to="model")
    count = len(archive.heading.groups[0]) + 1
    function = c_function(tmp_path / "x.c", "four_bar", count, "c")
    q, dq, ddq, t = np.random.default_rng(4).uniform(-9.0, 9.0, (4, 50))
    found = function(np.array([q, dq, ddq, t]), np.zeros((0, 50)), np.zeros((0, 50)))
    wanted = archive.torque(q, dq, ddq, t)
    assert found[-1] == pytest.approx(wanted, rel=1e-12, abs=1e-12)


@pytest.mark.skipif(not shutil.which("arm-none-eabi-gcc"), reason="no cross compiler")
def test_the_wiper_fits_a_microcontroller(tmp_path):
    """The file of the first page, by one command, without a warning."""
    page = (ROOT / "docs" / "first_mechanism.md").read_text("utf-8")
    (tmp_path / "wiper.toml").write_text(page.partition("```toml\n")[2].partition("```")[0])
    made = str(tmp_path / "wiper.c")
    assert main(["export", str(tmp_path / "wiper.toml"), "--to", "c", "-o", made]) == 0
    core = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"]
    warned = [x for x in STRICT.split() if x not in ("-shared", "-fPIC")]
    words = ["arm-none-eabi-gcc", *core, *warned, "-std=c99", "-c", made, "-o", made + ".o"]
    subprocess.run(words, check=True)
    sizes = subprocess.check_output(["arm-none-eabi-size", made + ".o"], text=True)
    text, data, bss = map(int, sizes.splitlines()[1].split()[:3])
    assert 1000 < text < 8000 and data == bss == 0


@pytest.mark.parametrize("call", TABLES["sources"])
def test_what_has_no_source_is_refused(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    check_call(call, globals(), TABLES["sources"][call])
