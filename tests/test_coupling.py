"""Coupling tables against what they were made of, and C against Python."""

import csv
import ctypes
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import FileError

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


@pytest.fixture(scope="module")
def four_bar():
    return sk.coupling_table("four_bar", poles=["3/1"])


@pytest.fixture(scope="module")
def five_bar():
    return sk.coupling_table("five_bar", samples=25, tolerance=1e-3, assembly_mode=0)


@pytest.mark.parametrize("mode", [0, 1])
def test_a_table_says_what_the_mechanism_does(four_bar, mode):
    q = np.random.default_rng(2).uniform(0.0, 2.0 * np.pi, 200)
    exact = sk.evaluate("four_bar", q, poles=["3/1"], assembly_mode=mode)
    found = four_bar.at(q[:, None], mode)
    for k, name in enumerate(four_bar.variables):
        off = np.exp(1j * found.angles[:, k]) - np.exp(1j * exact.variable(name))
        assert np.max(np.abs(off)) < 1.05 * four_bar.angle_error
        rate = exact.variable_coefficient(name.removeprefix("theta_"))
        off = np.abs(found.coefficients[:, k, 0] - rate)
        assert np.max(off) < 1.05 * four_bar.coefficient_error
    w = exact.direction("3/1") * exact.velocity_coefficient("3/1")[:, None]
    assert np.max(np.abs(found.turning[:, 0, 0] - w)) < 1.05 * four_bar.coefficient_error
    assert four_bar.angle_error < 1e-6 and four_bar.coefficient_error < 1e-4


def test_two_inputs_on_a_grid(five_bar):
    q = np.random.default_rng(7).uniform(0.8, 2.3, (300, 2))
    found = five_bar.at(q)
    sure = np.isfinite(found.angles[:, 0])
    assert np.mean(sure) > 0.3
    exact = sk.evaluate("five_bar", q[sure], poles=[], assembly_mode=0)
    for k, name in enumerate(five_bar.variables):
        off = np.exp(1j * found.angles[sure, k]) - np.exp(1j * exact.variable(name))
        assert np.max(np.abs(off)) < 1.05 * five_bar.tolerance
        rate = exact.variable_coefficient(name.removeprefix("theta_"), "51")
        off = np.abs(found.coefficients[sure, k, 1] - rate)
        assert np.max(off) < 1.05 * five_bar.coefficient_error
    # The derivatives are those of the coefficients: symmetric, and their differences.
    swapped = np.swapaxes(five_bar.derivatives, -1, -2)
    known = np.isfinite(five_bar.derivatives)
    assert np.allclose(five_bar.derivatives[known], swapped[known], atol=1e-9)
    assert np.all(np.isnan(five_bar.at([[0.0, 0.0]]).angles))


def test_cubics_are_exact(five_bar):
    """The formula between nodes, on functions that it has to reproduce."""
    x, y = five_bar.nodes.T
    cubic = x**3 - 2.0 * x**2 * y + 0.5 * x * y**2 + y**3 + x * y - 4.0
    slopes = np.stack(
        [3 * x**2 - 4 * x * y + 0.5 * y**2 + y, -2 * x**2 + x * y + 3 * y**2 + x], axis=1
    )
    bends = np.stack([6 * x - 4 * y, -4 * x + y + 1, -4 * x + y + 1, x + 6 * y], axis=1)
    table = replace(
        five_bar,
        variables=("theta_32",),
        angles=cubic[None, :, None],
        coefficients=slopes[None, :, None],
        derivatives=bends.reshape(1, -1, 1, 2, 2),
        sure=np.ones_like(five_bar.sure),
        rise=np.zeros((1, 2, 1)),
    )
    a, b = np.random.default_rng(1).uniform(0.8, 2.3, (2, 50))
    found = table.at(np.stack([a, b], axis=1))
    wanted = a**3 - 2.0 * a**2 * b + 0.5 * a * b**2 + b**3 + a * b - 4.0
    assert found.angles[:, 0] == pytest.approx(wanted, abs=1e-12)
    assert found.coefficients[:, 0, 0] == pytest.approx(
        3 * a**2 - 4 * a * b + 0.5 * b**2 + b, abs=1e-12
    )


def test_archives_and_csv_hold_the_table(four_bar, tmp_path, capsys):
    count = int(four_bar.count[0])
    target = tmp_path / "t.npz"
    words = ["export", "four_bar", "--to", "coupling", "--poles", "3/1", "-o"]
    assert main([*words, str(target)]) == 0
    assert f"errors measured: {four_bar.angle_error:.2g} rad" in capsys.readouterr().err
    again = sk.load_coupling(target)
    assert np.array_equal(again.angles, four_bar.angles) and again.modes == (0, 1)
    assert again.at(0.7).coefficients == pytest.approx(four_bar.at(0.7).coefficients)
    target = tmp_path / "t.csv"
    assert main([*words, str(target), "-q"]) == 0
    with target.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * count
    assert float(rows[count + 9]["theta_41_by_21"]) == four_bar.coefficients[1, 9, 2, 0]
    assert float(rows[count + 9]["w_3_1_y_by_21"]) == four_bar.turning[1, 9, 0, 0, 1]
    assert float(rows[count + 9]["cell_error"]) == four_bar.error[1, 9]
    assert rows[count - 1]["cell_error"] == ""


@pytest.mark.skipif(COMPILER is None, reason="needs a C compiler")
@pytest.mark.parametrize("name", ["four_bar", "five_bar"])
def test_c_says_the_same_as_python(name, request, tmp_path):
    from spherekit.exchange.coupling_header import header

    table = request.getfixturevalue(name)
    (tmp_path / "table.h").write_text(header(table), encoding="ascii")
    m, k, p = len(table.inputs), len(table.variables), max(len(table.poles), 1)
    (tmp_path / "table.c").write_text(
        '#include "table.h"\n'
        f"int at(int mode, const double *q, double *a, double *c, double *d, double *w)\n"
        f"{{ return {name}_at(mode, q, a, (double (*)[{m}])c, (double (*)[{m}][{m}])d, "
        f"(double (*)[{m}][3])w); }}\n"
    )
    library = tmp_path / "table.so"
    flags = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1"]
    command = [COMPILER, *flags, "-shared", "-fPIC", "-o", str(library), "table.c", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, timeout=60)
    at = ctypes.CDLL(str(library)).at

    def asked(q, mode):
        parts = [np.zeros(n) for n in (k, k * m, k * m * m, p * m * 3)]
        pointers = [part.ctypes.data_as(ctypes.c_void_p) for part in (q, *parts)]
        return at(mode, *pointers), parts

    q = np.random.default_rng(4).uniform(-1.0, 8.0, (200, m))
    codes = set()
    for mode in table.modes:
        whole = table.at(q, mode)
        for row in range(len(q)):
            code, parts = asked(q[row].copy(), mode)
            codes.add(code)
            assert (code == 0) == np.isfinite(whole.angles[row, 0])
            if code == 0:
                assert parts[0] == pytest.approx(whole.angles[row], abs=1e-13)
                assert parts[1] == pytest.approx(whole.coefficients[row].ravel(), abs=1e-12)
                assert parts[2] == pytest.approx(whole.derivatives[row].ravel(), abs=1e-11)
                if table.poles:
                    assert parts[3] == pytest.approx(whole.turning[row].ravel(), abs=1e-12)
    assert codes == ({0} if name == "four_bar" else {0, 2, 3})
    assert asked(q[0], 9)[0] == 1 and asked(np.full(m, np.nan), 0)[0] in (2, 3)


def test_faults_say_what_is_allowed(tmp_path):
    np.savez(tmp_path / "x.npz", a=np.zeros(2))
    with pytest.raises(FileError, match="is not a spherekit coupling table"):
        sk.load_coupling(tmp_path / "x.npz")


@pytest.mark.parametrize("call", TABLES["couplings"])
def test_couplings_that_there_are_not(call):
    check_call(call, {"sk": sk}, TABLES["couplings"][call])
