"""C++ sources with `Scalar = float` compute in single precision, and with others as before.

The compiled code is read for operations in double precision. Results are compared with
those of `long double` (x86: 64 bits of mantissa).
"""

import re
import shutil
import subprocess

import numpy as np
import pytest
from helpers.exported_languages import GPP

import spherekit as sk
from spherekit.exchange.formula_maker import formulas
from spherekit.exchange.source_languages import source

OBJDUMP = shutil.which("objdump")
pytestmark = pytest.mark.skipif(not GPP, reason="no C++ compiler")

WARNINGS = "-Wall -Wextra -Wconversion -Wdouble-promotion -pedantic -Werror"
IN_DOUBLE = re.compile(
    r"\b(?:(?:v?(?:add|sub|mul|div|sqrt|max|min|u?comi|and|or|xor|round|cmp\w*)[sp]d)"
    r"|v?cvt\w*s[sd]2s[sd]|v?cvt\w*2sd)\b"
)
"""Operations of x86 on doubles, and conversions between float and double."""
RESULTS_BY_MECHANISM = {
    "four_bar": None,
    "stephenson": ["theta_*", "pole_*", "velocity_coefficient_*", "transmission_angle_*"],
    "five_bar": None,
    "shaped_cam": None,
    "double_butterfly": ["theta_*", "rate_*", "B"],
}
"""Results that are exported, None for all.

They have closed forms, poles with a sign and a maximum, tables of profiles, and Newton's
steps.
"""
QUICK = ("four_bar", "shaped_cam")


ROWS_FUNCTION = """
#include "x.hpp"
extern "C" void rows(const SCALAR *motion, const SCALAR *mode, const SCALAR *size,
                     SCALAR *result)
{
    NAME_formulas::NAME(motion, mode, size, result);
}
"""
STEP_FUNCTION = """
extern "C" SCALAR step(const SCALAR *motion, SCALAR *mode, const SCALAR *size)
{
    return NAME_formulas::NAME_step(motion, mode, size);
}
"""
"""Functions that use the exported header for a type of numbers and a mechanism."""


def compile_object(exported, scalar, folder):
    """Compile an exported C++ header for a type of numbers, and return the object file.

    The header is a template. The object file has functions of C: `rows` computes the
    results, and `step` does one step of Newton's method, if the mechanism needs it.
    Warnings are errors.

    Parameters
    ----------
    exported
        Formulas of a mechanism, the result of `formulas`.
    scalar
        Type of numbers, such as "long double".
    folder
        Folder for all files.
    """
    (folder / "x.hpp").write_text(source(exported, "cpp"))
    text = ROWS_FUNCTION
    if exported.step:
        text += STEP_FUNCTION
    text = text.replace("SCALAR", scalar).replace("NAME", exported.mechanism.name)
    path = folder / f"{scalar.replace(' ', '_')}.cpp"
    object_path = path.with_suffix(".o")
    path.write_text(text)
    command = [GPP, "-std=c++11", "-O2", *WARNINGS.split(), "-c", str(path)]
    subprocess.run([*command, "-o", str(object_path)], check=True)
    return object_path


def disassemble(object_path, *options):
    """Return the instructions of an object file as text."""
    command = [OBJDUMP or "objdump", "-d", *options, str(object_path)]
    return subprocess.check_output(command, text=True)


@pytest.mark.skipif(not OBJDUMP, reason="no objdump")
@pytest.mark.parametrize(
    "name",
    [
        x if x in QUICK else pytest.param(x, marks=pytest.mark.slow)
        for x in RESULTS_BY_MECHANISM
    ],
)
def test_floats_are_computed_in_single_precision(name, tmp_path):
    """No instruction of x86 is in double precision or converts to it.

    Functions of <cmath> that are called are those for floats, such as `sinf`.
    """
    exported = formulas(name, RESULTS_BY_MECHANISM[name])
    object_path = compile_object(exported, "float", tmp_path)
    text = disassemble(object_path, "-r", "--no-show-raw-insn")
    assert "mulss" in text  # a product of floats
    assert not IN_DOUBLE.findall(text)
    symbols = set(re.findall(r"R_X86_64_PLT32\s+(\w+)-", text))
    functions = {symbol for symbol in symbols if not symbol.startswith("_")}
    assert functions
    assert all(function.endswith("f") for function in functions), functions


def test_the_search_for_doubles_finds_them(tmp_path):
    """The same source for double has 80 such instructions or more."""
    object_path = compile_object(formulas("four_bar"), "double", tmp_path)
    assert len(IN_DOUBLE.findall(disassemble(object_path))) > 79


MAIN_FUNCTION = """
#include <cstdio>
extern "C" void rows(const SCALAR *, const SCALAR *, const SCALAR *, SCALAR *);
int main()
{
    SCALAR motion[] = {MOTION}, mode[] = {MODE};
    SCALAR size[1] = {0}, result[COUNT];
    rows(motion, mode, size, result);
    for (auto x : result)
        std::printf("%.21Lg\\n", (long double)x);
}
"""
"""Program that prints all results for the numbers of a motion and of a mode."""


def compute_results(exported, scalar, folder):
    """Return the results of an exported C++ header, compiled for one type of numbers.

    Tests compare results of different types.

    Parameters
    ----------
    exported
        The formulas. They are evaluated at the inputs at which the first assembly mode (way
        to assemble the links) was recorded.
    scalar
        The type of all numbers in C++, such as "float" or "double".
    folder
        Folder for the program.

    Returns
    -------
    (results,) the results as float64 numbers.
    """
    object_path = compile_object(exported, scalar, folder)
    mode = exported.modes[0]
    text = MAIN_FUNCTION
    # Results that depend on no input have no arguments of the motion.
    motion_values = mode.at if exported.motion else ()
    for word, numbers in (("MOTION", motion_values), ("MODE", mode.values)):
        literals = [f"({scalar}){number!r}L" for number in numbers]
        # An array without elements is not allowed in C++, so it gets a zero.
        text = text.replace(word, ", ".join(literals) or "0")
    text = text.replace("COUNT", str(len(exported.results))).replace("SCALAR", scalar)
    path = folder / f"main_{scalar.replace(' ', '_')}.cpp"
    program = path.with_suffix("")
    path.write_text(text)
    command = [GPP, "-std=c++11", str(path), str(object_path), "-o", str(program)]
    subprocess.run(command, check=True)
    printed = subprocess.check_output([str(program)], text=True)
    return np.array([float(word) for word in printed.split()])


@pytest.mark.many
@pytest.mark.parametrize("name", ["four_bar", "stephenson", "five_bar", "shaped_cam"])
def test_single_precision_is_near_long_double(name, tmp_path):
    """Angles, rates and coefficients of floats are off by 2e-5 at most, relative or not.

    A float has 6e-8, which the closed forms of dyads enlarge. Errors above 1e-10 show that
    the results are not doubles.
    """
    exported = formulas(name, ["theta_*", "rate_*", "velocity_coefficient_*"])
    single = compute_results(exported, "float", tmp_path)
    expected = compute_results(exported, "long double", tmp_path)
    assert single == pytest.approx(expected, rel=2e-5, abs=2e-5)
    assert np.max(np.abs(single - expected)) > 1e-10


def dual_number_program(exported):
    """Return a C++ program that computes exported results of a four-bar in dual numbers.

    It shows that the exported template works with a number type of the user. A dual number
    has a value x and its derivative d by the input. For the input itself, d is 1. The class
    `Dual` has only the operations that exported formulas may use. The program prints value
    and derivative of each result at one input at which the first assembly mode exists.

    The exported function has four arrays as arguments: the input, the number that selects
    the assembly mode, the sizes that were exported as variables (none), and the results.
    """
    operations = "\n".join(
        f"inline Dual operator{sign}(Dual a, Dual b) {{ return Dual({value}, {slope}); }}"
        for sign, value, slope in (
            ("+", "a.x + b.x", "a.d + b.d"),
            ("-", "a.x - b.x", "a.d - b.d"),
            ("*", "a.x * b.x", "a.d * b.x + a.x * b.d"),
            ("/", "a.x / b.x", "(a.d - a.x / b.x * b.d) / b.x"),
        )
    )
    functions = "\n".join(
        f"inline Dual {name}(Dual a) {{ return Dual(std::{name}(a.x), a.d * ({slope})); }}"
        for name, slope in (
            ("sin", "std::cos(a.x)"),
            ("cos", "-std::sin(a.x)"),
            ("sqrt", "0.5 / std::sqrt(a.x)"),
        )
    )
    mode = exported.modes[0]
    # An array of C++ needs at least one entry, so `size` has one.
    return (
        "#include <cmath>\n#include <cstdio>\n"
        "struct Dual { double x, d; Dual(double x = 0.0, double d = 0.0) : x(x), d(d) {} "
        "};\n"
        f"{operations}\n{functions}\n"
        "inline Dual atan2(Dual a, Dual b) { return Dual(std::atan2(a.x, b.x), "
        "(a.d * b.x - a.x * b.d) / (a.x * a.x + b.x * b.x)); }\n"
        "inline bool operator>=(Dual a, Dual b) { return a.x >= b.x; }\n"
        "inline bool operator>(Dual a, Dual b) { return a.x > b.x; }\n"
        "inline bool operator<(Dual a, Dual b) { return a.x < b.x; }\n"
        "inline bool operator!=(Dual a, Dual b) { return a.x != b.x; }\n"
        '#include "x.hpp"\nint main()\n{\n'
        f"    Dual motion[] = {{Dual({mode.at[0]!r}, 1.0)}}, "
        f"mode[] = {{Dual({mode.values[0]!r})}};\n"
        f"    Dual size[1], result[{len(exported.results)}];\n"
        "    four_bar_formulas::four_bar(motion, mode, size, result);\n"
        "    for (Dual y : result)\n"
        '        std::printf("%.17g %.17g\\n", y.x, y.d);\n}\n'
    )


def test_a_number_type_of_the_user_compiles_and_gives_derivatives(tmp_path):
    """An exported C++ template gives derivatives if it is used with dual numbers.

    A dual number has a value and a derivative by the input (`dual_number_program`). Both
    must be those of `sk.evaluate` for all pair angles. The program evaluates them at one
    input: that of the known configuration of mode 0, which is exported with the mode
    (`at`).
    """
    # Formulas of a pole also compare numbers, which must compile for dual numbers too.
    exported = formulas("four_bar", ["theta_*", "pole_4_2_*"])
    (tmp_path / "x.hpp").write_text(source(exported, "cpp"))
    path = tmp_path / "dual.cpp"
    path.write_text(dual_number_program(exported))
    program = path.with_suffix("")
    command = [GPP, "-std=c++11", "-Wall", "-Wextra", "-Werror", str(path)]
    subprocess.run([*command, "-o", str(program)], check=True)
    printed = subprocess.check_output([str(program)], text=True)
    results = np.array([line.split() for line in printed.splitlines()], dtype=float)

    (known_input,) = exported.modes[0].at
    evaluation = sk.evaluate("four_bar", known_input, assembly_mode=0)
    angle_names = [name for name in exported.results if name.startswith("theta_")]
    # Angles are the first results.
    for (value, derivative), name in zip(results, angle_names, strict=False):
        pair = name.removeprefix("theta_")
        angle = evaluation.variable(pair)
        assert abs(np.exp(1j * value) - np.exp(1j * angle)) < 1e-12
        coefficient = evaluation.variable_coefficient(pair)
        assert derivative == pytest.approx(coefficient, abs=1e-11)
