"""Angles in texts are read as exact decimal numbers, for proofs."""

from decimal import Decimal
from fractions import Fraction

import pytest

from spherekit.files.angle_units import read_decimal_angle
from spherekit.quantity import QuantityError

LONG_NUMBER = f"0.{'1' * 70}"
"""A number with more digits than conversions compute with."""


@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_a_number_with_the_unit_of_the_file_keeps_all_its_digits(unit):
    assert str(read_decimal_angle(f"{LONG_NUMBER}{unit}", unit)) == LONG_NUMBER


def test_turns_become_degrees_exactly():
    turns = Fraction(Decimal(LONG_NUMBER))
    degrees = read_decimal_angle(f"{LONG_NUMBER}turn", "deg")
    assert Fraction(degrees) == 360 * turns


@pytest.mark.parametrize("unit", ["", "deg", "rad", "turn"])
@pytest.mark.parametrize("number", ["1e2000000", "1e-2000000", "-1e400"])
def test_a_number_far_outside_the_range_of_floats_is_refused(number, unit):
    with pytest.raises(QuantityError, match="power of ten is not in the range -308 to 308"):
        read_decimal_angle(f"{number}{unit}", "deg")
