"""Statics of gears and of Hooke's joint, derived by hand."""

import numpy as np
import pytest
from helpers.refusals import mechanism_text
from test_reactions import moving

import spherekit as sk
from spherekit.dynamics.reactions import reactions


def at_rest(made, pair):
    """Return what pairs transmit in a mechanism that does not move."""
    return reactions(moving(made.with_inputs(pair), (0.3,), [0.0], 0.0, 0.0))


BEVEL_GEARS = mechanism_text("example")


def test_the_load_and_the_thrust_of_bevel_gears(tmp_path):
    """Teeth press along the normal of their flanks, 20 degrees off the pitch circles.

    The cones roll without sliding at the pitch point, which moves with V = r w of either
    gear, and the force W along the pitch circles does P = W V: with 5 hp (745.7 W each), r
    = 32.84 mm and w = 62.83 rad/s of the pinion W = 1807 N, and the pinion's torque P/w =
    59.34 N m. The point is at r / sin g from the centre with tan g = 15/45, the pinion's
    half angle between shafts at 90 degrees. W comes with W tan 20 = 657.7 N that presses
    the wheels apart, at right angles to the line of contact in the plane of the shafts:
    of it sin g = 1/sqrt(10) pushes the pinion outwards along its shaft, 208.0 N, and
    the gear 3/sqrt(10), 623.9 N. These are the W tan(phi) sin(gamma) along the shaft and W
    tan(phi) cos(gamma) across it of textbooks (R. G. Budynas and J. K. Nisbett, Shigley's
    Mechanical Engineering Design, chapter 13, force analysis of bevel gearing), for the
    gears of the example there: 5 hp at 600 rev/min, 15 and 45 teeth, 20 degrees, the mean
    pitch radius of the pinion 1.293 in, so 406 lbf along the pitch circles.
    """
    text = BEVEL_GEARS.replace(
        "teeth =", "pressure_angle = 20\ndistance = 0.10385\nteeth ="
    )
    (tmp_path / "gears.toml").write_text(text)
    made = sk.load(tmp_path / "gears.toml")
    found = at_rest(made, "pinion_shaft")
    assert not np.any(found.is_open) and not np.any(found.open_forces)
    traction = found.traction[:, made.pair_number["mesh"]]
    cone_distance = 0.03284 / np.sin(np.arctan(15 / 45))
    assert np.abs(traction) / cone_distance == pytest.approx(1807, rel=1e-3)
    assert np.abs(found.torques.tau) == pytest.approx(59.34, rel=1e-3)
    for pair, thrust in (("pinion_shaft", 208.0), ("gearshaft", 623.9)):
        number = made.pair_number[pair]
        z = found.frames[:, number, :, 2]
        outwards = np.sign(
            np.sum(z * found.frames[:, made.pair_number["mesh"], :, 2], axis=1)
        )
        # The bearings push back, towards the centre.
        assert found.forces[:, number, 2] * outwards == pytest.approx(-thrust, rel=1e-3)
