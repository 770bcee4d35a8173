"""Coupling tables against what they were made of, and C against Python."""

import csv
import ctypes
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call
from mechanism_examples.wide_five_bar import wide_five_bar

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import FileError, SolveError
from spherekit.exchange import coupling_table_maker

# A coupling table stores, on a grid of the inputs, the angles of all passive pairs, their
# coefficients (rates per unit rate of an input), and the angular velocities of poles per
# unit rate of each input (`turning`). Between the nodes of the grid it is interpolated.

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


@pytest.fixture(scope="module")
def four_bar_table():
    return sk.coupling_table("four_bar", poles=["3/1"])


@pytest.fixture(scope="module")
def five_bar_table():
    return sk.coupling_table(wide_five_bar(), samples=25, tolerance=1e-3, assembly_mode=0)


@pytest.mark.parametrize("mode", [0, 1])
def test_a_coupling_table_of_one_input_is_within_its_errors(four_bar_table, mode):
    """Numbers interpolated in a coupling table are within the errors that it states.

    The reference is `sk.evaluate` at 200 random inputs. The table of the four-bar stores,
    on a grid of the input, the angles of the passive pairs, their coefficients (rates per
    unit rate of the input), and the angular velocity of link 3 relative to link 1. It
    states its largest error, which was measured at some inputs between the nodes of the
    grid. Other inputs can have a slightly larger error, so that 5 % more is allowed.
    """
    q = np.random.default_rng(2).uniform(0.0, 2.0 * np.pi, 200)
    exact = sk.evaluate("four_bar", q, poles=["3/1"], assembly_mode=mode)
    interpolated = four_bar_table.at(q[:, None], mode)
    coefficient_limit = 1.05 * four_bar_table.coefficient_error
    for k, name in enumerate(four_bar_table.variables):
        exact_angle = exact.variable(name)
        angle_gap = np.exp(1j * interpolated.angles[:, k]) - np.exp(1j * exact_angle)
        assert np.max(np.abs(angle_gap)) < 1.05 * four_bar_table.angle_error
        coefficients = exact.variable_coefficient(name.removeprefix("theta_"))
        coefficient_gap = np.abs(interpolated.coefficients[:, k, 0] - coefficients)
        assert np.max(coefficient_gap) < coefficient_limit
    # The angular velocity w per unit rate of the input is along the pole.
    w = exact.direction("3/1") * exact.velocity_coefficient("3/1")[:, None]
    interpolated_w = interpolated.turning[:, 0, 0]  # of pole 0 per input 0, (200, 3)
    assert np.max(np.abs(interpolated_w - w)) < coefficient_limit
    assert four_bar_table.angle_error < 1e-6
    assert four_bar_table.coefficient_error < 1e-4


def test_a_coupling_table_of_two_inputs_is_within_its_errors(five_bar_table):
    """Numbers interpolated in a table of two inputs are within its tolerance and errors.

    The reference is `sk.evaluate` at 300 random inputs. The table of the five-bar stores,
    on a grid of its inputs 21 and 51, the angles of the passive pairs and their
    coefficients (rates per unit rate of an input). Where the mechanism cannot be assembled,
    and beside such inputs, it has no numbers (NaN).

    The error of the angles should be within the tolerance that was requested for the table,
    and that of the coefficients within the largest error that the table states. Both errors
    were measured at some inputs when the table was computed. Other inputs can have a
    slightly larger error, so that 5 % more is allowed.
    """
    q = np.random.default_rng(7).uniform(0.8, 2.3, (300, 2))
    interpolated = five_bar_table.at(q)
    is_known = np.isfinite(interpolated.angles[:, 0])
    assert np.mean(is_known) > 0.3  # enough inputs with numbers for the comparison
    exact = sk.evaluate("five_bar", q[is_known], poles=[], assembly_mode=0)
    for k, name in enumerate(five_bar_table.variables):
        angles = interpolated.angles[is_known, k]
        angle_gap = np.exp(1j * angles) - np.exp(1j * exact.variable(name))
        assert np.max(np.abs(angle_gap)) < 1.05 * five_bar_table.tolerance
        # Coefficients by the second input, whose index is 1.
        coefficients = exact.variable_coefficient(name.removeprefix("theta_"), "51")
        coefficient_gap = np.abs(interpolated.coefficients[is_known, k, 1] - coefficients)
        assert np.max(coefficient_gap) < 1.05 * five_bar_table.coefficient_error
    assert np.all(np.isnan(five_bar_table.at([[0.0, 0.0]]).angles))


def test_second_derivatives_of_a_coupling_table_are_symmetric(five_bar_table):
    derivatives = five_bar_table.derivatives
    swapped = np.swapaxes(derivatives, -1, -2)
    is_known = np.isfinite(derivatives)
    assert np.allclose(derivatives[is_known], swapped[is_known], atol=1e-9)


def test_interpolation_in_a_coupling_table_is_exact_for_cubic_polynomials(five_bar_table):
    """Interpolation from values and derivatives at nodes is exact for cubic polynomials.

    A coupling table stores angles on a grid of inputs (nodes), with their first derivatives
    by the inputs (`coefficients`) and the second ones (`derivatives`). Here a table on the
    nodes of the five-bar's table is filled
    with a cubic of both inputs and its derivatives, as the only angle of one assembly mode
    (way to assemble the links). It is evaluated at 50 random points. All cells of the grid
    are marked as sure, which means that they can be interpolated. No input is periodic, so
    that `rise`, the growth of the angle over a period, does not matter.
    """
    x, y = five_bar_table.nodes.T
    cubic = x**3 - 2.0 * x**2 * y + 0.5 * x * y**2 + y**3 + x * y - 4.0
    by_x = 3 * x**2 - 4 * x * y + 0.5 * y**2 + y
    by_y = -2 * x**2 + x * y + 3 * y**2 + x
    by_xx = 6 * x - 4 * y
    by_xy = -4 * x + y + 1
    by_yy = x + 6 * y
    slopes = np.stack([by_x, by_y], axis=1)
    bends = np.stack([by_xx, by_xy, by_xy, by_yy], axis=1)
    # The axes are: mode (1), node, angle (1), then one or two axes for the inputs (2).
    table = replace(
        five_bar_table,
        variables=("theta_32",),
        angles=cubic[None, :, None],
        coefficients=slopes[None, :, None],
        derivatives=bends.reshape(1, -1, 1, 2, 2),
        sure=np.ones_like(five_bar_table.sure),
        rise=np.zeros((1, 2, 1)),
    )
    a, b = np.random.default_rng(1).uniform(0.8, 2.3, (2, 50))
    interpolated = table.at(np.stack([a, b], axis=1))
    value = a**3 - 2.0 * a**2 * b + 0.5 * a * b**2 + b**3 + a * b - 4.0
    by_a = 3 * a**2 - 4 * a * b + 0.5 * b**2 + b
    # The axes are: point, angle, and input.
    assert interpolated.angles[:, 0] == pytest.approx(value, abs=1e-12)
    assert interpolated.coefficients[:, 0, 0] == pytest.approx(by_a, abs=1e-12)


def test_archives_and_csv_hold_the_numbers_of_a_coupling_table(
    four_bar_table, tmp_path, capsys
):
    """Files written by `export --to coupling` have the numbers of the coupling table.

    A coupling table has, at nodes of the input, the angles of passive pairs, their rates
    per unit rate of the input, and the angular velocity of a pole, here that of link 3
    relative to link 1. It also has the error of interpolation in each cell, which is the
    interval from a node to the next one. The .npz and .csv files are read back.
    """
    command = ["export", "four_bar", "--to", "coupling", "--poles", "3/1", "-o"]
    archive = tmp_path / "t.npz"
    assert main([*command, str(archive)]) == 0
    assert (
        f"errors measured: {four_bar_table.angle_error:.2g} rad" in capsys.readouterr().out
    )
    loaded = sk.load_coupling(archive)
    assert np.array_equal(loaded.angles, four_bar_table.angles)
    assert loaded.modes == (0, 1)
    assert loaded.at(0.7).coefficients == pytest.approx(four_bar_table.at(0.7).coefficients)

    csv_path = tmp_path / "t.csv"
    assert main([*command, str(csv_path), "-q"]) == 0
    with csv_path.open() as file:
        rows = list(csv.DictReader(file))
    node_count = int(four_bar_table.count[0])
    assert len(rows) == 2 * node_count  # mode by mode
    row = rows[node_count + 9]  # node 9 of mode 1
    # Indices: mode 1, node 9, variable 2 (theta_41) or pole 0, input 0, component y (1).
    assert float(row["theta_41_by_21"]) == four_bar_table.coefficients[1, 9, 2, 0]
    assert float(row["w_3_1_y_by_21"]) == four_bar_table.turning[1, 9, 0, 0, 1]
    assert float(row["cell_error"]) == four_bar_table.error[1, 9]
    assert (
        rows[node_count - 1]["cell_error"] == ""
    )  # no cell begins at the last node of mode 0


@pytest.mark.skipif(COMPILER is None, reason="needs a C compiler")
@pytest.mark.parametrize("name", ["four_bar", "five_bar"])
def test_the_c_header_of_a_coupling_table_gives_the_numbers_of_python(
    name, request, tmp_path
):
    """The exported header is compiled and called at 200 random inputs in each mode.

    A coupling table has angles of passive pairs, their coefficients (rates per unit rate of
    an input) with derivatives, and angular velocities of poles, interpolated on a grid of
    inputs. Return codes of the function in C are 0 if there are numbers, 1 for a mode that
    does not exist, 2 for inputs outside of the grid, and 3 in a cell of the grid that is
    not interpolated, because the mode ends there. Python gives NaN for the same inputs.
    """
    from spherekit.exchange.coupling_header import header

    table = request.getfixturevalue(f"{name}_table")
    (tmp_path / "table.h").write_text(header(table), encoding="ascii")
    m = len(table.inputs)
    variable_count = len(table.variables)
    pole_count = max(len(table.poles), 1)
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
    c_function = ctypes.CDLL(str(library)).at

    def evaluate_in_c(q, mode):
        """Return the code, angles, coefficients, derivatives and angular velocities."""
        angles = np.zeros(variable_count)
        coefficients = np.zeros(variable_count * m)
        derivatives = np.zeros(variable_count * m * m)
        turning = np.zeros(pole_count * m * 3)
        arrays = (q, angles, coefficients, derivatives, turning)
        code = c_function(mode, *(x.ctypes.data_as(ctypes.c_void_p) for x in arrays))
        return code, angles, coefficients, derivatives, turning

    q = np.random.default_rng(4).uniform(-1.0, 8.0, (200, m))
    codes = set()
    for mode in table.modes:
        in_python = table.at(q, mode)
        for row in range(len(q)):
            code, angles, coefficients, derivatives, turning = evaluate_in_c(
                q[row].copy(), mode
            )
            codes.add(code)
            assert (code == 0) == np.isfinite(in_python.angles[row, 0])
            if code != 0:
                continue
            assert angles == pytest.approx(in_python.angles[row], abs=1e-13)
            expected = in_python.coefficients[row].ravel()
            assert coefficients == pytest.approx(expected, abs=1e-12)
            expected = in_python.derivatives[row].ravel()
            assert derivatives == pytest.approx(expected, abs=1e-11)
            if table.poles:
                expected = in_python.turning[row].ravel()
                assert turning == pytest.approx(expected, abs=1e-12)
    # The crank of the four-bar turns fully, so there are numbers at every input.
    assert codes == ({0} if name == "four_bar" else {0, 2, 3})
    assert evaluate_in_c(q[0], 9)[0] == 1
    assert evaluate_in_c(np.full(m, np.nan), 0)[0] in (2, 3)


@pytest.mark.parametrize("q", [[1.0], [1.0, 1.2, 1.5, 1.3], np.ones((2, 3)), 1.0])
def test_inputs_of_another_shape_are_refused_by_a_coupling_table(q, five_bar_table):
    """Two inputs need two columns; other shapes were divided into wrong points."""
    with pytest.raises(SolveError, match=r"expected \(number of points, 2\).*21, 51"):
        five_bar_table.at(q)


def test_a_coupling_table_of_one_input_takes_numbers_and_rows(four_bar_table):
    angles = four_bar_table.at([[0.3], [0.7]]).angles
    assert np.array_equal(four_bar_table.at([0.3, 0.7]).angles, angles)
    assert np.array_equal(four_bar_table.at(0.7).angles, angles[1:])
    assert four_bar_table.at([]).angles.shape == (0, 3)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf, 1e300])
def test_a_coupling_table_has_no_values_at_inputs_that_are_not_finite(
    number, four_bar_table, five_bar_table
):
    """The values are NaN, also for numbers far outside, without a warning of NumPy."""
    values = five_bar_table.at([[number, 1.2], [1.5, 1.2]])
    assert np.all(np.isnan(values.angles[0]))
    assert np.all(np.isfinite(values.angles[1]))
    if not np.isfinite(number):
        assert np.all(np.isnan(four_bar_table.at(number).coefficients))


@pytest.mark.parametrize("tolerance", [0, 1])
def test_the_ends_of_the_range_of_a_tolerance_are_excluded(tolerance):
    with pytest.raises(SolveError, match="greater than 0 and less than 1"):
        sk.coupling_table("four_bar", tolerance=tolerance)


def test_a_coupling_grid_without_a_whole_cell_is_refined(monkeypatch):
    """A mode can be missing in every cell of the first grid, and exist in smaller cells.

    The rocker of the four-bar drives, so that the mechanism closes in parts of the
    revolution only. A first grid of two nodes has a single cell, the whole revolution.
    """
    monkeypatch.setattr(coupling_table_maker, "FIRST_NODE_COUNTS", (2, 2, 2))
    options = {"input_pair": "41", "assembly_mode": 0, "tolerance": 1e-3}
    table = sk.coupling_table("four_bar", **options)
    assert np.any(table.sure)


def test_faults_say_what_is_allowed(tmp_path):
    np.savez(tmp_path / "x.npz", a=np.zeros(2))
    with pytest.raises(FileError, match="is not a spherekit coupling table"):
        sk.load_coupling(tmp_path / "x.npz")


@pytest.mark.parametrize("call", TABLES["couplings"])
def test_couplings_that_there_are_not(call):
    check_call(call, {"sk": sk}, TABLES["couplings"][call])
