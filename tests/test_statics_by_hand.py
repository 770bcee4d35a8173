"""Statics of gears and of Hooke's joint, derived by hand."""

import numpy as np
import pytest
from helpers.polynomial_motions import motion_by_polynomial_laws
from helpers.refusals import mechanism_text

import spherekit as sk
from spherekit.dynamics.reactions import reactions


def at_rest(made, pair):
    """Return what pairs transmit in a mechanism that does not move."""
    motion = motion_by_polynomial_laws(
        made.with_inputs(pair), starts=(0.3,), t=[0.0], rate=0.0, quadratic=0.0
    )
    return reactions(motion)


BEVEL_GEARS = mechanism_text("example")


def test_forces_of_bevel_gears_are_those_of_a_textbook(tmp_path):
    """Forces along the pitch circles, torque and thrusts of bevel gears are a textbook's.

    The example has 5 hp (745.7 W each) at 600 rev/min, 15 and 45 teeth, shafts at 90
    degrees, a pressure angle of 20 degrees, and a mean pitch radius of the pinion r = 1.293
    in = 32.84 mm (R. G. Budynas and J. K. Nisbett, Shigley's Mechanical Engineering Design,
    chapter 13, force analysis of bevel gearing). By hand:

    - The force along the pitch circles W does the power P = W r w, with w = 62.83 rad/s, so
      W = 1807 N (406 lbf). The pinion's torque is P / w = 59.34 N m.
    - The pitch point is r / sin g from the centre, with tan g = 15/45.
    - W tan 20 = 657.7 N presses the wheels apart, across the line of contact. Its part sin
      g = 1/sqrt(10) along the pinion's shaft is 208.0 N, its part 3/sqrt(10) along the
      gear's shaft is 623.9 N.

    The file `BEVEL_GEARS` has a load torque of 178.01 N m = 3 * 59.34 N m at the shaft of
    the gear. `at_rest` returns what the pairs transmit while a torque at the pinion's shaft
    holds the load. No component of a moment or force may be undetermined there (`is_open`,
    `open_forces`).
    """
    text = BEVEL_GEARS.replace(
        "teeth =", "pressure_angle = 20\ndistance = 0.10385\nteeth ="
    )
    (tmp_path / "gears.toml").write_text(text)
    mechanism = sk.load(tmp_path / "gears.toml")
    result = at_rest(mechanism, "pinion_shaft")
    assert not np.any(result.is_open)
    assert not np.any(result.open_forces)

    # The traction of the mesh is a moment about the centre of the sphere.
    mesh = mechanism.pair_number["mesh"]
    cone_distance = 0.03284 / np.sin(np.arctan(15 / 45))
    tangential_force = np.abs(result.traction[:, mesh]) / cone_distance
    assert tangential_force == pytest.approx(1807, rel=1e-3)
    assert np.abs(result.torques.tau) == pytest.approx(59.34, rel=1e-3)

    # The z axis of the frame of a pair leads to the contact point, or along the shaft.
    contact_line = result.frames[:, mesh, :, 2]
    for pair, thrust in (("pinion_shaft", 208.0), ("gearshaft", 623.9)):
        number = mechanism.pair_number[pair]
        shaft = result.frames[:, number, :, 2]
        outward_sign = np.sign(np.sum(shaft * contact_line, axis=1))
        # The bearings push back, towards the centre.
        axial_force = result.forces[:, number, 2] * outward_sign
        assert axial_force == pytest.approx(-thrust, rel=1e-3)


def test_statics_along_a_law_of_time_says_where_the_largest_torque_is():
    """`statics` reads no times, also where the samples have some."""
    law = sk.Polynomial((0.5, 0.2))
    result = sk.run("four_bar", "statics", laws={"21": law}, duration=2.0, samples=5)
    assert not result.failures
    table = result.frame("statics")
    assert np.isfinite(table["tau"]).all()
