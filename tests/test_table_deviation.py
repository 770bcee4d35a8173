"""Errors of the columns of a table: the scale by which they are divided, and its words."""

import numpy as np

from spherekit.runs.table_deviation import compute_deviations, describe_scale
from spherekit.tables.table import Column, Table


def test_a_rate_per_angle_that_is_constant_is_compared_with_its_rate():
    """The derivative of a constant rate in 1/s has the unit 1/s/rad and tiny errors."""
    columns = (Column("rate", "1/s", ""), Column("slope", "1/s/rad", ""))
    table = Table("t", "", columns)
    reference = {"t": {"rate": np.array([2.0]), "slope": np.array([1e-17])}}
    given = {"t": {"rate": np.array([2.0]), "slope": np.array([2e-17])}}
    _, slope = compute_deviations([table], given, reference)
    assert slope.scale == 2.0
    assert "or in 1/s if" in describe_scale(columns[1])


def test_numbers_without_unit_are_compared_with_each_other_only():
    """The words of the scale say that numbers with a unit do not count."""
    columns = (Column("ratio", "", ""), Column("torque", "N m", ""))
    table = Table("t", "", columns)
    values = {"t": {"ratio": np.array([0.5]), "torque": np.array([1e3])}}
    ratio, torque = compute_deviations([table], values, values)
    assert (ratio.scale, torque.scale) == (0.5, 1e3)
    assert "largest number without unit" in describe_scale(columns[0])
    assert "largest number in N m" in describe_scale(columns[1])
