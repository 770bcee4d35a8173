"""The sides on which gear teeth with a pressure angle press, if they carry little."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.polynomial_motions import motion_by_polynomial_laws

import spherekit as sk
from spherekit.dynamics.reactions import reactions


def reactions_of_train(*loads, speed):
    """Return the reactions in the planetary bevel train at a constant speed, rad/s."""
    train = replace(sk.load("planetary_bevel"), loads=loads)
    times = np.linspace(0.0, 3.0, 31)
    return reactions(
        motion_by_polynomial_laws(train, (0.3,), times, rate=speed, quadratic=0.0)
    )


def test_teeth_that_carry_only_rounding_errors_do_not_lift_off():
    """Torques that balance each other leave rounding errors in the teeth."""
    loads = [
        sk.PairTorque("rising", "planet_axis", "10*sin(t) + 0.1"),
        sk.PairTorque("falling", "planet_axis", "-10*sin(t)"),
        sk.PairTorque("constant", "planet_axis", "-0.1"),
    ]
    result = reactions_of_train(*loads, speed=2.0)
    assert not np.any(result.status)
    assert not np.any(result.opened)


@pytest.mark.parametrize("torque", ["1e-4", "-1e-4"])
def test_a_load_on_the_ground_does_not_change_the_sides_of_teeth(torque):
    light = sk.PairTorque("light", "output_pivot", torque)
    on_ground = sk.Moment("on_ground", "sun", ("1e8", "0", "0"))
    push = reactions_of_train(light, on_ground, speed=0.0).push
    assert np.nanmin(push) > 0.0
    expected = reactions_of_train(light, speed=0.0).push
    np.testing.assert_allclose(push, expected, rtol=1e-9)
