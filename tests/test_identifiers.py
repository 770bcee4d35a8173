"""Names of functions in every language: whatever a mechanism is called, its source works.

What a language reserves is asked of its own compiler or interpreter.
"""

import builtins
import json
import keyword
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from helpers.page_waits import wait_until

import spherekit as sk
from spherekit.cli.main import main
from spherekit.exchange import identifiers
from spherekit.exchange.coupling_header import header
from spherekit.exchange.exported_pose import find_pose
from spherekit.exchange.formula_maker import formulas
from spherekit.exchange.identifiers import unique_names
from spherekit.exchange.mjcf import MujocoModel
from spherekit.exchange.source_languages import source

GCC, GPP, NODE = map(shutil.which, ("gcc", "g++", "node"))
STRICT = ["-Wall", "-Wextra", "-Wshadow=local", "-Werror"]
LISTS = """
assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal
stdalign stdarg stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string threads
time uchar wchar wctype

unistd fcntl dirent poll pthread semaphore regex strings sys/stat sys/wait

int main INFINITY I errno y0 j1 gamma index link select time NAN EOF SIGINT sin pow
double bool restrict complex signal read write exit malloc linux x X t0 table_0 sign_of
larger_of motion mode size result variables class template and xor std Scalar new delete
operator concept co_await this lambda np ca math MOTION MODES SIZES RESULTS None True
def print tuple range zip reversed Math NaN Array Float64Array undefined then await enum
eval arguments let static yield default window document function end begin struct local
zero map clamp jac hess null 4bar 4 _ __ _Bool __init__ __proto__ constructor a__b _x x_
E1 INT_MAX case_ four_bar
"""
ISO, POSIX, NAMES = (part.split() for part in LISTS.split("\n\n"))
"""What no mechanism would be called, and three harmless names."""
KEPT_NAMES = {"x_", "case_", "four_bar"}
"""The harmless names: a language must not rename them."""


@cache
def angle():
    """Return the formulas of one angle."""
    return formulas("four_bar", ["theta_41"])


def renamed_formulas(name, made=None):
    """Return formulas (by default of one angle) of a mechanism with another name."""
    made = made or angle()
    return replace(made, mechanism=replace(made.mechanism, name=name))


POINT = ([1.0], [1.0], [])


def expected_angle():
    """Return the angle at one input in the mode of sign +1, by `sk.evaluate`."""
    modes = {mode.values: mode.number for mode in angle().modes}
    here = sk.evaluate("four_bar", 1.0, assembly_mode=modes[1.0,])
    return np.ravel(here.variable("theta_41"))[0]


def includes(*headers):
    return "".join(f"#include <{header}.h>\n" for header in headers)


def names_by_identifier(rules, names=NAMES):
    """Return names by their identifiers, so that one file can hold all of them."""
    return {rules.identifier(name): name for name in names}


@pytest.mark.skipif(not GCC, reason="there is no gcc")
def test_sources_of_c_compile_beside_every_header(tmp_path):
    """Exported C of mechanisms with troublesome names compiles beside all standard headers.

    All sources are in one file, after the headers of ISO C and POSIX, in the GNU dialect,
    which knows the most functions. In the source, a comment says how a mechanism is
    renamed. The names in `KEPT_NAMES` are harmless, so they must not be changed.
    """
    texts = []
    for safe, name in names_by_identifier(identifiers.C_NAME_RULES).items():
        texts.append(source(renamed_formulas(name), "c"))
        assert f"\nvoid {safe}(const double motion[], " in texts[-1]
        said = f"The mechanism {name} is called {safe} here" in words_of(texts[-1])
        assert said == (safe != name), name
        assert safe == name or name not in KEPT_NAMES
    path = tmp_path / "all.c"
    path.write_text(includes(*ISO, *POSIX) + "\n".join(texts))
    words = [GCC, "-std=gnu17", "-D_XOPEN_SOURCE=700", *STRICT, "-c", str(path)]
    subprocess.run([*words, "-o", str(tmp_path / "all.o")], check=True)


def words_of(comment):
    """Return a comment of C on one line."""
    return comment.replace("\n * ", " ")


@pytest.mark.slow
@pytest.mark.skipif(not GPP, reason="there is no g++")
def test_sources_of_cpp_compile_with_each_name(tmp_path):
    """Exported C++ of mechanisms with troublesome names compiles, all in one file.

    Troublesome names are, for example, keywords, library functions, or no identifiers at
    all. The main program calls the function of each mechanism, so that the compiler leaves
    out none. The names in `KEPT_NAMES` must not be changed. `renamed_formulas` returns
    formulas of a mechanism with another name.
    """
    texts, calls = [], []
    for safe, name in names_by_identifier(identifiers.CPP_NAME_RULES).items():
        texts.append(source(renamed_formulas(name), "cpp"))
        # The arguments are inputs, signs of the mode, sizes and results. There are no sizes
        # here, so any array will do.
        calls.append(f"    {safe}_formulas::{safe}(input, mode, input, result);")
        assert safe == name or name not in KEPT_NAMES, name
    path = tmp_path / "x.cpp"
    body = "\n".join(calls)
    path.write_text(
        "#include <iostream>\n#include <complex>\n" + "\n".join(texts) + "\n"
        "int main() {\n"
        "    double input[1] = {1.0}, mode[1] = {1.0}, result[2];\n"
        f"{body}\n"
        "    return result[0] > 9;\n}\n"  # the result is used, as -Wall demands
    )
    words = [GPP, "-std=c++20", *STRICT, "-c", "-o", str(tmp_path / "x.o"), str(path)]
    subprocess.run(words, check=True)


@pytest.mark.skipif(not GCC, reason="there is no gcc")
def test_every_function_and_macro_that_the_compiler_knows_is_renamed(tmp_path):
    """A mechanism called like a function or macro of C gets another name in exported C.

    GCC lists the functions that ISO and POSIX headers declare, and the macros that ISO
    headers define. There are more than 1200.
    """
    source_path = tmp_path / "all.c"
    source_path.write_text(includes(*ISO, *POSIX))
    # With -aux-info, GCC writes a prototype of each declared function to a file.
    prototypes = tmp_path / "all.info"
    command = [GCC, "-std=c17", "-D_XOPEN_SOURCE=700", "-aux-info", str(prototypes)]
    command += ["-c", str(source_path), "-o", str(tmp_path / "all.o")]
    subprocess.run(command, check=True)
    reserved_names = set(re.findall(r"\b([A-Za-z]\w*)(?= \()", prototypes.read_text()))
    # With -dM and -E, GCC prints a line "#define NAME ..." for each macro.
    source_path.write_text(includes(*ISO))
    command = [GCC, "-std=c17", "-dM", "-E", str(source_path)]
    macros = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    reserved_names |= set(re.findall(r"^#define ([A-Za-z]\w*)", macros, re.M))
    assert len(reserved_names) > 1200
    unchanged_names = {
        name for name in reserved_names if identifiers.C_NAME_RULES.identifier(name) == name
    }
    assert not unchanged_names, sorted(unchanged_names)


@pytest.mark.skipif(not NODE, reason="there is no node")
def test_modules_of_javascript_run_with_each_name(tmp_path):
    """JavaScript modules of mechanisms with troublesome names give the right angle.

    Troublesome names are, for example, keywords, or no identifiers at all. The exporter
    must also refuse each global name of JavaScript as the name of a function. Node, the
    interpreter, lists these global names. `renamed_formulas` returns formulas of a
    mechanism with another name. `expected_angle` returns the angle by `sk.evaluate`.
    """
    list_globals = (
        "const {runInNewContext} = require('vm');"
        "const own = runInNewContext('Object.getOwnPropertyNames(globalThis)');"
        "console.log(JSON.stringify(own))"
    )
    listing = subprocess.run(
        [NODE, "-e", list_globals], check=True, capture_output=True, text=True
    )
    assert len(listing.stdout) > 500  # it is not an empty list
    not_refused = {
        global_name
        for global_name in json.loads(listing.stdout)
        if not identifiers.JAVASCRIPT_NAME_RULES.is_taken(global_name)
    }
    assert not not_refused
    # Every third troublesome name, which saves time, some of JavaScript's own names, and
    # harmless names.
    names = [*NAMES[::3], "then", "Math", "NaN", "undefined", "await", "let", *KEPT_NAMES]
    functions = []  # the only exported function of each module
    for k, name in enumerate(names):
        text = source(renamed_formulas(name), "js")
        functions += re.findall(r"^export function (\w+)\(", text, re.M)
        (tmp_path / f"m{k}.mjs").write_text(text)
    # Each module is imported and its function called with the input 1 rad, the sign +1 of
    # the mode, and no sizes.
    program = tmp_path / "run.mjs"
    program.write_text(
        f"const names = {json.dumps(functions)};\nconst angles = [];\n"
        "for (const [k, name] of names.entries()) {\n"
        "  const module = await import(`./m${k}.mjs`);\n"
        "  angles.push(module[name]([1], [1], [])[0]);\n}\n"
        "console.log(JSON.stringify(angles));\n"
    )
    output = subprocess.run(
        [NODE, str(program)], check=True, capture_output=True, text=True
    )
    np.testing.assert_allclose(json.loads(output.stdout), expected_angle(), atol=1e-12)


def test_modules_of_python_run_with_each_name():
    """Keywords and builtins are renamed; sources with troublesome names give the angle."""
    public = [name for name in dir(builtins) if not name.startswith("_")]
    for name in {*keyword.kwlist, *keyword.softkwlist, *public, "__import__", "__name__"}:
        assert identifiers.PYTHON_NAME_RULES.identifier(name) == f"m_{name}"
    for name in ("None", "lambda", "np", "zip", "MODES", "__name__", "4bar", *KEPT_NAMES):
        space = {}
        exec(compile(source(renamed_formulas(name), "python"), name, "exec"), space)
        function = space[identifiers.PYTHON_NAME_RULES.identifier(name)]
        np.testing.assert_allclose(function(*POINT)[0], expected_angle(), atol=1e-12)
        assert space["np"] is np and isinstance(space["MODES"], dict)


def test_names_of_functions_do_not_depend_on_the_shell():
    """IPython and others add names to `builtins`; functions of these names keep them."""
    program = (
        "import builtins; builtins.display = print\n"
        "from spherekit.exchange.identifiers import PYTHON_NAME_RULES\n"
        "print(PYTHON_NAME_RULES.identifier('display'))"
    )
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert done.stdout == "display\n"


def test_functions_of_casadi_have_names_that_casadi_allows():
    """CasADi functions have names that CasADi and C allow, as CasADi writes C of them."""
    ca = pytest.importorskip("casadi", reason="it reads the source")
    for name in NAMES:
        safe = identifiers.CASADI_NAME_RULES.identifier(name)
        assert ca.Function.check_name(safe) and not identifiers.C_NAME_RULES.is_taken(safe)
    for name in ("int", "jac", "ca", "a__b", "_x", "lambda", "t0", "4bar", *KEPT_NAMES):
        space = {}
        exec(compile(source(renamed_formulas(name), "casadi"), name, "exec"), space)
        safe = identifiers.CASADI_NAME_RULES.identifier(name)
        function = space[safe]()
        assert function.name() == safe
        made = float(function(*POINT)[0])
        np.testing.assert_allclose(made, expected_angle(), atol=1e-12)


@pytest.mark.parametrize("language", ["c", "js", "python"])
@pytest.mark.parametrize(
    "mechanism",
    ["shaped_cam", pytest.param("double_butterfly", marks=pytest.mark.slow)],
)
def test_sources_of_newtons_method_and_tables_take_any_name(mechanism, language, tmp_path):
    """Exported sources with helper functions work whatever the mechanism is called.

    Such a source has functions for the results, for a step of Newton's method and for a
    table of a profile. Their names are derived from that of the mechanism. Here the
    mechanism gets names that the language or the source itself uses. Python runs the
    source, other languages check that it compiles.
    """
    names_by_language = {
        "c": ("int", "sign_of"),
        "js": ("Math", "t0"),
        "python": ("np", "range"),
    }
    for name in names_by_language[language]:
        text = source(renamed_formulas(name, formulas_with_tables(mechanism)), language)
        path = tmp_path / f"x.{language}"
        path.write_text(text)
        if language == "python":
            space = {}
            exec(compile(text, name, "exec"), space)
            mode = formulas_with_tables(mechanism).modes[0]
            function = space[identifiers.PYTHON_NAME_RULES.identifier(name)]
            # The inputs of a known configuration, and the pair angles from which Newton's
            # method starts.
            assert np.all(np.isfinite(function(mode.at, mode.values)))
        elif language == "c" and GCC:
            words = [GCC, "-Wall", "-Wextra", "-Werror", "-c", str(path)]
            subprocess.run([*words, "-o", str(tmp_path / "x.o")], check=True)
        elif language == "js" and NODE:
            path = path.rename(path.with_suffix(".mjs"))
            subprocess.run([NODE, "--check", str(path)], check=True)


@cache
def formulas_with_tables(name):
    """Return the formulas of one angle, which need Newton's method or stored tables."""
    return formulas(name, [f"theta_{sk.load(name).pairs[1].name}"])


def test_reserved_words_of_julia_are_renamed():
    """Keywords in the manual's list and functions that a source calls get a prefix "m_"."""
    words = re.findall(r"\w+", JULIA)
    text = source(renamed_formulas("four_bar", formulas_with_tables("shaped_cam")), "julia")
    functions = set(re.findall(r"\b([a-z]\w+)\(", text))
    own = {x for x in functions if x.startswith("four_bar")}
    for word in {*words, *functions} - own:
        assert identifiers.JULIA_NAME_RULES.identifier(word) == f"m_{word}", word


JULIA = """
baremodule begin break catch const continue do else elseif end export false finally for
function global if import let local macro module quote return struct true try using while
abstract mutable primitive type where
"""


@pytest.mark.skipif(not GCC, reason="there is no gcc")
def test_tables_of_controllers_compile_with_each_name(tmp_path):
    table = sk.coupling_table("four_bar", assembly_mode=0, samples=9, tolerance=0.5)
    path = tmp_path / "x.c"
    names = names_by_identifier(
        identifiers.C_NAME_RULES, [*NAMES[::4], "X", "r", "W", "f", "2", "émile"]
    )
    texts = [header(replace(table, mechanism=name)) for name in names.values()]
    path.write_text(includes(*ISO, *POSIX) + "\n".join([*texts, "int unused;\n"]))
    words = [GCC, "-std=gnu17", "-D_XOPEN_SOURCE=700", "-Wall", "-Werror"]
    words += ["-Wno-unused-function", "-Wno-unused-const-variable"]
    words += ["-Wno-unused-variable", "-c", str(path), "-o", str(tmp_path / "x.o")]
    subprocess.run(words, check=True)


def test_equal_names_are_told_apart_in_their_order():
    """Repeated names get the suffixes _2, _3, ..., which avoid names in use."""
    assert unique_names(["a", "b", "a"]) == ["a", "b", "a_2"]
    assert unique_names(["a", "a", "a_2"]) == ["a", "a_3", "a_2"]
    assert unique_names(["a_2", "a", "a", "a"]) == ["a_2", "a", "a_3", "a_4"]
    assert unique_names(["world", "w"], ["world"]) == ["world_2", "w"]
    assert unique_names([]) == []
    rng = np.random.default_rng(4)
    for _ in range(200):
        names = [f"{'ab'[k % 2]}{'_2' * (k % 3)}" for k in rng.integers(0, 9, 12)]
        made = unique_names(names)
        assert len({*made}) == len(names) and made == unique_names(names)
        assert all(x.startswith(name) for x, name in zip(made, names, strict=True))


def test_results_whose_names_become_equal_are_told_apart():
    """Two differ in a sign that C does not have."""
    made = formulas("four_bar", ["theta_41", "theta_32"])
    made = replace(made, results={"p_4/1": "rad", "p_4_1": "rad"})
    text = source(made, "c")
    assert "four_bar_p_4_1 = 0" in text and "four_bar_p_4_1_2 = 1" in text
    said = text.replace("\n * ", " ")
    assert "The result p_4/1 is called p_4_1 here." in said
    assert "The result p_4_1 is called p_4_1_2 here." in said


FILE = """
format = 1
name = "{name}"
angle_unit = "deg"
ground = "{ground}"
[links]
{ground} = {{ axes = ["crank", "out"], arcs = [70.0] }}
crank = {{ axes = ["crank", "middle"], arcs = [30.0] }}
{coupler} = {{ axes = ["middle", "last"], arcs = [60.0] }}
out = {{ axes = ["out", "last"], arcs = [60.0] }}
[pairs]
crank = {{ type = "R", links = ["{ground}", "crank"] }}
middle = {{ type = "R", links = ["crank", "{coupler}"] }}
last = {{ type = "R", links = ["{coupler}", "out"] }}
out = {{ type = "R", links = ["{ground}", "out"] }}
[outputs]
out = {{ link = "out", axis = "last" }}
[mass]
crank = {{ mass = 1, centre = [0.1, 0, 0.2], tensor = [[3,0,0],[0,3,0],[0,0,3]] }}
{coupler} = {{ mass = 1, centre = [0.1, 0, 0.2], tensor = [[3,0,0],[0,3,0],[0,0,3]] }}
out = {{ mass = 1, centre = [0.1, 0, 0.2], tensor = [[3,0,0],[0,3,0],[0,0,3]] }}
[loads]
crank = {{ pair = "crank", torque = "1" }}
out = {{ kind = "force", link = "out", point = [0, 0, 1], force = ["1", "0", "0"] }}
last = {{ kind = "spring", pair = "last", stiffness = 1.0 }}
"""


@pytest.mark.parametrize("ground, coupler", [("1", "world"), ("world", "3")])
def test_models_of_equal_names_load_in_mujoco(ground, coupler, tmp_path):
    """A model of MuJoCo has different names where those of a mechanism are equal.

    In MuJoCo "world" is the name of the fixed body. So a link with this name, the ground or
    the coupler of the file, becomes "world_2". The file also has an output, loads and an
    input of equal names. A model that is imported again has the same links, with "world_2"
    for "world".
    """
    mujoco = pytest.importorskip("mujoco", reason="it reads the model")
    file, path = tmp_path / "x.toml", tmp_path / "x.xml"
    file.write_text(FILE.format(name="crank", ground=ground, coupler=coupler))
    assert main(["export", str(file), "--to", "mjcf", "-o", str(path), "--quiet"]) == 0
    model = mujoco.MjModel.from_xml_path(str(path))
    mechanism = sk.load(file)
    # MuJoCo raises an error for a name that does not exist, and numbers objects of a kind
    # from 0. A renamed object is not the first of its kind.
    assert model.body("world_2").id > 0
    assert model.actuator("crank_2").id > 0
    assert model.site("out_2").id > 0
    assert model.site("out").id >= 0
    notes = MujocoModel(*find_pose(mechanism, assembly_mode=0)).notes
    assert "the body of link world is called world_2, as world is in use" in notes
    again = sk.import_mechanism(path).mechanism
    assert {x.replace("world_2", "world") for x in again.links} == {*mechanism.links}


@pytest.mark.slow
def test_pages_of_reserved_names_move(browser, tmp_path):
    """Pages of mechanisms with troublesome names move without an error.

    Such names are those of JavaScript's own objects, a name that the page uses (KERNELS),
    and one that is no identifier (4bar). `browser` is a browser that the test controls.
    After the input has changed, the page must be drawn again, which `timing.pictures`
    counts. No message may appear in its console.
    """
    messages = []
    tab = browser.new_page()
    tab.on("console", lambda message: messages.append(message.text))
    tab.on("pageerror", lambda error: messages.append(str(error)))
    for name in ("Math", "class", "Float64Array", "NaN", "document", "KERNELS", "4bar"):
        file, page = tmp_path / f"{name}.toml", tmp_path / f"{name}.html"
        file.write_text(FILE.format(name=name, ground="constructor", coupler="__proto__"))
        assert main(["page", str(file), "-o", str(page), "--quiet"]) == 0
        tab.goto("about:blank")  # leaves the last page first
        tab.goto(page.as_uri())
        wait_until(tab, "window.spherekit?.timing.pictures > 0")
        tab.evaluate("spherekit.change('input', {q: [1.0]})")
        wait_until(tab, "spherekit.timing.pictures > 1")
        assert tab.evaluate("spherekit.modes.every(mode => mode.results)")
        assert not messages, (name, messages)
    tab.close()
