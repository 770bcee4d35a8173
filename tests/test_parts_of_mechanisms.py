"""Parts of mechanisms that cannot exist are refused, and messages name what is wrong."""

import math
from dataclasses import replace

import numpy as np
import pytest

import spherekit as sk
from spherekit.errors import ModelError
from spherekit.mechanism.bevel_gears import pitch_angles
from spherekit.mechanism.pose_sizes import pose_sizes


@pytest.mark.parametrize(
    ("teeth", "shaft_angle", "contact"),
    [
        ((20, 20), math.pi, "external"),
        ((20, 20), 1e-16, "internal"),
        ((20, 40), 1e-12, "external"),
        ((20, 40), math.pi - 1e-12, "internal"),
    ],
)
def test_coaxial_gears_are_refused(teeth, shaft_angle, contact):
    with pytest.raises(ModelError, match="touch along a single line"):
        pitch_angles(teeth, shaft_angle, contact)


def test_the_message_names_the_first_size_without_a_pair():
    """The order of a set differs between processes, that of the arguments does not."""
    arcs = {f"wrong_{number}": 20.0 for number in range(30)}
    with pytest.raises(ModelError, match='leads to pair "wrong_0"'):
        sk.load("four_bar").with_sizes(angle_unit="deg", arcs={"2": arcs})


def test_three_bearings_of_a_pair_are_refused_with_what_is_possible():
    bearings = sk.Bearings("shaft", "21", (0.1, 0.2, 0.3))
    with pytest.raises(ModelError, match="expected one position that is not 0, or two"):
        sk.load("four_bar").with_loads(bearings)


def test_a_number_without_unit_has_no_space_before_the_comma():
    bearings = sk.Bearings("shaft", "21", (0.1,), coefficient=-0.5)
    with pytest.raises(ModelError, match=r"found -0\.5, expected at least 0"):
        sk.load("four_bar").with_loads(bearings)


def test_a_centre_of_mass_beyond_the_range_of_float64_is_refused():
    with pytest.raises(ModelError, match=r"mass\.4\.centre: .* too far"):
        sk.load("four_bar").with_mass("4", np.eye(3), mass=1.0, centre=(1e200, 0.0, 0.0))


@pytest.mark.parametrize("stop", [math.nan, math.inf])
def test_a_range_of_an_input_is_finite(stop):
    with pytest.raises(ModelError, match=rf"inputs\.21: found {stop}, expected a finite"):
        sk.load("four_bar").with_inputs(ranges={"21": (0.0, stop)}, angle_unit="deg")


def test_an_arc_beyond_the_range_of_degrees_is_refused():
    with pytest.raises(ModelError, match=r"found 1e\+307 rad; an arc .* between 0 and pi"):
        sk.load("four_bar").with_sizes(angle_unit="rad", arcs={"2": 1e307})


@pytest.mark.parametrize(
    ("mechanism", "kind", "size"),
    [
        ("bevel_pair", "zeros", 10.0),
        ("bevel_differential", "values", 10.0),
        ("bevel_differential", "axes", (1.0, 0.0, 0.0)),
    ],
)
def test_a_contact_pair_gets_no_zero_value_or_axis(mechanism, kind, size):
    made = sk.load(mechanism)
    contact = next(pair.name for pair in made.pairs if not pair.kind.has_axis)
    with pytest.raises(ModelError, match=f'pair "{contact}" is a contact pair'):
        made.with_sizes(angle_unit="deg", **{kind: {contact: size}})


def test_two_new_loads_of_one_name_are_refused():
    springs = [sk.Spring("spring", pair, stiffness=1.0) for pair in ("21", "41")]
    with pytest.raises(ModelError, match='load "spring" is given twice'):
        sk.load("four_bar").with_loads(*springs)


def test_a_link_without_pairs_has_no_sizes_in_a_reference_pose():
    posed = sk.load("eight_bar_10")
    assert pose_sizes(replace(posed, links=(*posed.links, "loose")), "loose") == ()
