"""The table of pole quantities agrees with the field, the batch and the analysis."""

from dataclasses import fields

from spherekit.runs.batch import _POLE_FIELD_NAMES
from spherekit.velocities.input_columns import FIELD_PARTS
from spherekit.velocities.pole_field import (
    POLE_ERRORS,
    POLE_QUANTITIES,
    REPORTED_ERRORS,
    SIGNED_COMPONENTS,
    PoleField,
)


def test_every_quantity_of_a_pole_is_an_attribute_of_the_field_and_a_column():
    names = [quantity.name for quantity in POLE_QUANTITIES]
    attributes = {item.name for item in fields(PoleField)}
    assert {*names, *POLE_ERRORS} <= attributes
    assert {*names, *POLE_ERRORS, "w", "dw"} == set(FIELD_PARTS)
    assert {*names, *POLE_ERRORS, "pole_status"} == set(_POLE_FIELD_NAMES.values())


def test_the_direction_is_the_first_quantity_that_changes_sign():
    """Signs are chosen by the first three signed columns of a kernel."""
    assert next(iter(SIGNED_COMPONENTS.items())) == ("direction", 3)
    assert POLE_ERRORS[: len(REPORTED_ERRORS)] == REPORTED_ERRORS
    assert len(set(POLE_ERRORS)) == len(POLE_ERRORS)
