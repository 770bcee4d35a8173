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
CALLED = re.compile(r"\bcall\S*\s+\S*<(\w+)")
CASES = {
    "four_bar": None,
    "stephenson": ["theta_*", "pole_*", "velocity_coefficient_*", "transmission_angle_*"],
    "five_bar": None,
    "shaped_cam": None,
    "double_butterfly": ["theta_*", "rate_*", "B"],
}
"""Closed forms, poles with a sign and a maximum, tables of profiles, Newton's steps."""
QUICK = ("four_bar", "shaped_cam")


def program(made, scalar, folder):
    """Return the path of an object with the functions for a type of numbers."""
    name = made.mechanism.name
    (folder / "x.hpp").write_text(source(made, "cpp"))
    calls = f"{name}_formulas::{name}(motion, mode, size, result);"
    text = (
        f'#include "x.hpp"\nextern "C" void rows(const {scalar} *motion, '
        f"const {scalar} *mode, const {scalar} *size, {scalar} *result)\n"
        f"{{\n    {calls}\n}}\n"
    )
    if made.step:
        text += (
            f'extern "C" {scalar} step(const {scalar} *motion, {scalar} *mode, '
            f"const {scalar} *size)\n{{\n    return {name}_formulas::{name}_step("
            "motion, mode, size);\n}\n"
        )
    path = folder / f"{scalar.replace(' ', '_')}.cpp"
    path.write_text(text)
    words = [GPP, "-std=c++11", "-O2", *WARNINGS.split(), "-c", str(path)]
    subprocess.run([*words, "-o", str(path.with_suffix(".o"))], check=True)
    return path.with_suffix(".o")


@pytest.mark.skipif(not OBJDUMP, reason="no objdump")
@pytest.mark.parametrize(
    "name",
    [x if x in QUICK else pytest.param(x, marks=pytest.mark.slow) for x in CASES],
)
def test_floats_are_computed_in_single_precision(name, tmp_path):
    """No operation in double, no conversion, and the functions of <cmath> for floats."""
    made = formulas(name, CASES[name])
    text = subprocess.check_output(
        [OBJDUMP, "-dr", "--no-show-raw-insn", str(program(made, "float", tmp_path))],
        text=True,
    )
    assert "mulss" in text
    assert not IN_DOUBLE.findall(text)
    called = set(re.findall(r"R_X86_64_PLT32\s+(\w+)-", text))
    functions = {x for x in called if not x.startswith("_")}
    assert functions and all(x.endswith("f") for x in functions), functions


def test_the_search_for_doubles_finds_them(tmp_path):
    """The same source for double is full of such operations."""
    made = formulas("four_bar")
    text = subprocess.check_output(
        [OBJDUMP or "objdump", "-d", str(program(made, "double", tmp_path))], text=True
    )
    assert len(IN_DOUBLE.findall(text)) > 79


@pytest.mark.many
@pytest.mark.parametrize("name", ["four_bar", "stephenson", "five_bar", "shaped_cam"])
def test_single_precision_is_near_long_double(name, tmp_path):
    """Results of floats are off by some 1e-7 times what the dyads enlarge it by."""
    made = formulas(name, ["theta_*", "rate_*", "velocity_coefficient_*"])
    mode = made.modes[0]
    rows = {}
    for scalar in ("float", "long double"):
        path = program(made, scalar, tmp_path)
        values = (made.motion and mode.at, mode.values)
        lists = [", ".join(f"({scalar}){x!r}L" for x in row) or "0" for row in values]
        main = tmp_path / "main.cpp"
        main.write_text(
            f'#include <cstdio>\nextern "C" void rows(const {scalar} *, const {scalar} *, '
            f"const {scalar} *, {scalar} *);\nint main()\n{{\n"
            f"    {scalar} motion[] = {{{lists[0]}}}, mode[] = {{{lists[1]}}};\n"
            f"    {scalar} size[1] = {{0}}, result[{len(made.results)}];\n"
            "    rows(motion, mode, size, result);\n    for (auto x : result)\n"
            '        std::printf("%.21Lg\\n", (long double)x);\n}\n'
        )
        made_program = tmp_path / f"{name}_{len(rows)}"
        words = [GPP, "-std=c++11", str(main), str(path), "-o", str(made_program)]
        subprocess.run(words, check=True)
        said = subprocess.check_output([str(made_program)], text=True)
        rows[scalar] = np.array([float(x) for x in said.split()])
    assert rows["float"] == pytest.approx(rows["long double"], rel=2e-5, abs=2e-5)
    assert np.max(np.abs(rows["float"] - rows["long double"])) > 1e-10  # single, not double


def test_numbers_of_one_s_own_still_compile(tmp_path):
    """Dual numbers, of which only operations with themselves and doubles are known."""
    made = formulas("four_bar", ["theta_*", "pole_4_2_*"])
    (tmp_path / "x.hpp").write_text(source(made, "cpp"))
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
    (tmp_path / "dual.cpp").write_text(
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
        f"    Dual motion[] = {{Dual({made.modes[0].at[0]!r}, 1.0)}}, "
        f"mode[] = {{Dual({made.modes[0].values[0]!r})}};\n"
        f"    Dual size[1], result[{len(made.results)}];\n"
        "    four_bar_formulas::four_bar(motion, mode, size, result);\n"
        "    for (Dual y : result)\n"
        '        std::printf("%.17g %.17g\\n", y.x, y.d);\n}\n'
    )
    words = [GPP, "-std=c++11", "-Wall", "-Wextra", "-Werror", str(tmp_path / "dual.cpp")]
    subprocess.run([*words, "-o", str(tmp_path / "dual")], check=True)
    said = subprocess.check_output([str(tmp_path / "dual")], text=True)
    found = np.array([line.split() for line in said.splitlines()], dtype=float)
    here = sk.evaluate("four_bar", made.modes[0].at[0], assembly_mode=0)
    pairs = [x.removeprefix("theta_") for x in made.results if x.startswith("theta_")]
    for (value, slope), pair in zip(found, pairs, strict=False):
        assert abs(np.exp(1j * value) - np.exp(1j * here.variable(pair)[0])) < 1e-12
        assert slope == pytest.approx(here.variable_coefficient(pair)[0], abs=1e-11)
