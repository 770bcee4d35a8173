"""Columns of the gnomonic chart in the pole table, compared with the lecture's formulas.

The formulas with complex numbers are those of R. Di Gregorio, lecture 2, Barcelona 2019. A
pole is the point p = tan xi + j tan zeta of the chart. The line through two points has the
slope epsilon = Arg(p - p') and tan theta = Im[p exp(-j epsilon)].
"""

from dataclasses import dataclass

import numpy as np
import pytest
from helpers.minimal_analysis import MinimalAnalysis
from spherekit_analyses.gnomonic_chart import chart_coordinates, circle_coordinates

import spherekit as sk
from spherekit.runs.declaration_checks import find_class_fault
from spherekit.tables.table import Column, Table

CHART_COLUMNS = ["xi", "zeta"] + [
    f"circle_{number}_{angle}" for number in (1, 2) for angle in ("epsilon", "theta")
]

LINES_OF_POLES = {
    ("3", "1"): ((("2", "1"), ("3", "2")), (("4", "1"), ("4", "3"))),
    ("4", "2"): ((("2", "1"), ("4", "1")), (("3", "2"), ("4", "3"))),
}
"""The two great circles of each secondary pole of a four-bar, each through two poles."""


def rows_by_pole(frame):
    """Return the rows of each pole, by its two links."""
    groups = frame.groupby(["link", "relative_to"], observed=True)
    return {key: groups.get_group(key) for key in groups.groups}


def complex_points(rows):
    """Return the points p of poles in the chart."""
    return np.tan(rows["xi"].to_numpy()) + 1j * np.tan(rows["zeta"].to_numpy())


def test_the_table_has_the_columns_only_on_request():
    names = list(sk.run("four_bar", "poles", samples=5).frame().columns)
    requested = sk.run("four_bar", "poles:chart=yes", samples=5)
    assert not set(names) & set(CHART_COLUMNS)
    assert list(requested.frame().columns) == names + CHART_COLUMNS
    assert requested.frame().attrs["units"]["xi"] == "rad"
    plain = sk.run("four_bar", "poles", samples=5).frame()
    assert requested.frame()[names].equals(plain[names])


@pytest.mark.parametrize("chart", ["x", "y", "z"])
def test_a_pole_is_recovered_from_its_coordinates(chart):
    """(1, tan xi, tan zeta), scaled to unit length, is the axis (the lecture's formula)."""
    frame = sk.run("stephenson", f"poles:chart={chart}", samples=13).frame()
    xi = frame["xi"].to_numpy()
    zeta = frame["zeta"].to_numpy()
    assert np.all(np.abs(xi) <= np.pi / 2) and np.all(np.abs(zeta) <= np.pi / 2)
    first = "xyz".index(chart)
    u = frame[["ux", "uy", "uz"]].to_numpy()[:, [first, (first + 1) % 3, (first + 2) % 3]]
    is_finite_point = np.abs(u[:, 0]) > 1e-6
    point = np.stack([np.ones_like(xi), np.tan(xi), np.tan(zeta)], axis=1)[is_finite_point]
    axis = point / np.linalg.norm(point, axis=1, keepdims=True)
    cosines = np.sum(axis * u[is_finite_point], axis=1)
    assert np.abs(cosines) == pytest.approx(1.0, abs=1e-9)
    assert is_finite_point.any()


def difference_of_lines(line, other_line):
    """Return how much two lines of the chart differ; 0 if they are the same.

    A line is stated by its slope epsilon and by theta (rad). tan theta is its signed
    distance from the origin. A line also has the slope epsilon + pi, with the opposite sign
    of the distance.
    """
    epsilon, theta = line
    other_epsilon, other_theta = other_line
    turn = epsilon - other_epsilon  # 0 or pi if the slopes are the same
    slope_difference = abs(np.exp(2j * turn) - 1.0)
    sign = np.cos(turn)  # 1 or -1 if the slopes are the same
    distance_difference = abs(np.tan(theta) * sign - np.tan(other_theta))
    return slope_difference + distance_difference


def test_great_circles_have_the_slope_and_angle_of_the_line_through_two_poles():
    """The great circles of a pole have the chart angles of a lecture (Di Gregorio, 2019).

    The plane of a gnomonic chart touches the sphere, here on the axis z. A pole (axis of
    the relative rotation of two links) is a point p of the chart, as a complex number. A
    great circle through two poles p and p' is a line in the chart. Two angles state a line:
    its slope epsilon = Arg(p - p'), and theta. tan theta = Im[p exp(-j epsilon)] is its
    signed distance from the origin.

    `LINES_OF_POLES` names the two great circles of each pole, by two poles each.
    """
    frame = sk.run("four_bar", "poles:chart=z", samples=17).frame()
    rows = rows_by_pole(frame)
    compared_count = 0
    for pole, lines in LINES_OF_POLES.items():
        expected = []
        for first_pole, second_pole in lines:
            p = complex_points(rows[first_pole])
            epsilon = np.angle(p - complex_points(rows[second_pole]))
            theta = np.arctan(np.imag(p * np.exp(-1j * epsilon)))
            expected.append((epsilon, theta))
        for row in range(len(rows[pole])):
            columns = rows[pole].iloc[row]
            lines_of_table = [
                (columns["circle_1_epsilon"], columns["circle_1_theta"]),
                (columns["circle_2_epsilon"], columns["circle_2_theta"]),
            ]
            # Poles at infinity make the points of the chart, not the columns, inaccurate.
            points = [complex_points(rows[key])[row] for line in lines for key in line]
            if max(map(abs, points)) > 1e4:
                continue
            for epsilon, theta in expected:
                expected_line = (epsilon[row], theta[row])
                differences = [
                    difference_of_lines(line, expected_line) for line in lines_of_table
                ]
                # One of both lines of the table is the expected one.
                assert min(differences) < 1e-7
                compared_count += 1
    assert compared_count > 50


@pytest.mark.parametrize("name", ["stephenson", "five_bar", "roller_cam"])
def test_each_pole_is_on_both_of_its_great_circles(name):
    """Each pole lies on both great circles by which it is constructed.

    A pole is the axis of the relative rotation of two links. In the gnomonic chart it is a
    point p, as a complex number, and a great circle is a line. The line has the angle
    epsilon to the real axis, and the distance tan theta from the centre of the chart. Its
    points satisfy Im[p exp(-j epsilon)] = tan theta. Points far away are left out, because
    they are inaccurate.
    """
    frame = sk.run(name, "poles:chart=yes", samples=9).frame()
    rows = frame[frame["circle_1_epsilon"].notna()]
    p = complex_points(rows)
    near = np.abs(p) < 1e4
    for number in (1, 2):
        epsilon = rows[f"circle_{number}_epsilon"].to_numpy()
        theta = rows[f"circle_{number}_theta"].to_numpy()
        assert np.all((epsilon > -np.pi / 2) & (epsilon <= np.pi / 2))
        distance = np.imag(p * np.exp(-1j * epsilon)) - np.tan(theta)
        scale = 1.0 + np.abs(p) + np.abs(np.tan(theta))
        assert np.all(np.abs(distance / scale)[near] < 1e-9)
    assert near.any()


@pytest.mark.parametrize("name", ["stephenson", "five_bar", "roller_cam"])
def test_only_poles_of_pairs_with_an_axis_have_no_great_circles(name):
    """A pole of two links that a pair joins is the axis of this pair.

    A contact (type Cs) has no axis.
    """
    mechanism = sk.load(name)
    pairs = {frozenset(pair.links) for pair in mechanism.pairs if pair.type != "Cs"}
    frame = sk.run(name, "poles:chart=yes", samples=9).frame()
    rows = frame[frame["xi"].notna()]  # without poles that are not known
    links_of_poles = zip(rows["link"], rows["relative_to"], strict=True)
    is_pair_axis = [frozenset(links) in pairs for links in links_of_poles]
    assert rows["circle_1_epsilon"].isna().tolist() == is_pair_axis


def test_both_ends_of_an_axis_and_both_normals_of_a_circle_are_one_point_and_one_line():
    """Points at infinity and vertical lines have coordinates too."""
    directions = np.array([[1, 2, -3], [0, 1, 1], [0, 0, 1], [0, -1, 0], [2, 0, 0]], float)
    assert np.array_equal(chart_coordinates(directions), chart_coordinates(-directions))
    xi, zeta = np.degrees(chart_coordinates(directions))
    assert xi == pytest.approx([np.degrees(np.arctan(2.0)), 90.0, 0.0, 90.0, 0.0])
    assert zeta[1:] == pytest.approx([90.0, 90.0, 0.0, 0.0])
    # Lines: tan xi = 1 (vertical), tan zeta = 2 (horizontal), the diagonal, infinity.
    normals = np.array([[-1, 1, 0], [-2, 0, 1], [0, -1, 1], [1, 0, 0]], float)
    both = [circle_coordinates(normals), circle_coordinates(-normals)]
    for epsilon, theta in both:
        assert np.degrees(epsilon[:3]) == pytest.approx([90.0, 0.0, 45.0])
        assert np.isnan(epsilon[3]) and abs(theta[3]) == pytest.approx(np.pi / 2)
        assert np.tan(theta[:3]) == pytest.approx([-1.0, 2.0, 0.0])


def test_a_column_on_request_of_an_unknown_parameter_is_a_fault():
    @dataclass(frozen=True)
    class Asking(MinimalAnalysis):
        name = "asking"
        tables = (Table("t", "rows", (Column("a", "", "a number", on_request="more"),)),)
        less: int = 0

        def compute(self, batch):
            return {}

    fault = find_class_fault(Asking)
    assert "on_request is 'more', which is not a parameter; parameters: less" in fault
