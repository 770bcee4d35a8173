"""Statics worked by hand from the formulas of textbooks, each with its source."""

from dataclasses import replace

import numpy as np
import pytest

import spherekit as sk
from spherekit.dynamics.reactions import reactions
from spherekit.motion.motion import Tracer
from spherekit.motion.timing import by_laws


def at_rest(made, pair, q):
    """Return what pairs transmit at inputs (n,) of a mechanism that does not move."""
    made = made.with_inputs(pair)
    timing = by_laws([pair], {pair: sk.ConstantSpeed(0.0)}, np.arange(len(q)) * 1.0)[1]
    found = Tracer(made, None, 0, path=np.array(q)[:, None]).motion()
    return reactions(replace(found, timing=timing))


BEVEL_GEARS = """format = 1
name = "example"
ground = "frame"
angle_unit = "deg"
[links.frame]
axes = ["pinion_shaft", "gearshaft"]
arcs = [90.0]
[links.pinion]
axes = ["pinion_shaft"]
[links.gear]
axes = ["gearshaft"]
[pairs.pinion_shaft]
type = "R"
links = ["frame", "pinion"]
[pairs.gearshaft]
type = "R"
links = ["frame", "gear"]
[pairs.mesh]
type = "Cr"
links = ["pinion", "gear"]
teeth = [15, 45]
axes = ["pinion_shaft", "gearshaft"]
[inputs.pinion_shaft]
from = 0.0
to = 360.0
[loads.driven]
pair = "gearshaft"
torque = "178.01"
"""


def test_the_transmitted_load_of_bevel_gears(tmp_path):
    """5 hp at 600 rev/min, 15 to 45 teeth, average pitch radii 1.293 in and 3.88 in.

    V = 2 pi 1.293 600 / 12 = 406.2 ft/min and W_t = 33 000 5 / 406.2 = 406 lbf, so the
    gearshaft carries 406 3.88 = 1575 lbf in = 178.0 N m; 406 lbf are 1807 N (Budynas and
    Nisbett, Shigley's Mechanical Engineering Design, 8th ed. 2008, section 13-15, the
    example on bevel gears). The parts of the tooth force by its pressure angle, which pitch
    cones do not have, are left open.
    """
    (tmp_path / "gears.toml").write_text(BEVEL_GEARS)
    made = sk.load(tmp_path / "gears.toml")
    found = at_rest(made, "pinion_shaft", [0.3, 1.0])
    pitch_radius, angle = 1.293 * 0.0254, np.arctan(15 / 45)
    cone_distance = pitch_radius / np.sin(angle)
    mesh = made.pair_number["mesh"]
    assert np.abs(found.traction[:, mesh]) / cone_distance == pytest.approx(1807, rel=1e-3)
    pinion_torque = 5 * 745.7 / (600 * 2 * np.pi / 60)
    assert np.abs(found.torques.tau) == pytest.approx(pinion_torque, rel=1e-3)
    assert np.all(found.is_open[:, mesh, 0])


def test_the_bearings_of_hookes_joint():
    """100 N m into a joint bent by 35 degrees, bearings of each shaft 0.2 m apart.

    The cross transmits a moment normal to its arms. With the driving yoke normal to the
    plane of the shafts, it bends the driving shaft by M tan b = 70.02 N m, 350.1 N on each
    bearing, and the driven one, with M / cos b = 122.1 N m, not at all. With the yoke in
    that plane it bends the driven one, with M cos b = 81.92 N m, by M sin b = 57.36 N m,
    286.8 N on each bearing, and the driving one not at all (Seherr-Thoss, Schmelz and
    Aucktor, Universal Joints and Driveshafts, 2nd ed. 2006, chapter 4, on the forces on the
    support bearings of Hooke's jointed driveshafts).
    """
    made = sk.load("universal_joint")
    for yoke, torque, driving, driven in (
        (90.0, 122.077, 350.10, 0.0),
        (0.0, 81.915, 0.0, 286.79),
    ):
        loads = [
            sk.PairTorque("brake", "41", repr(-torque)),
            sk.Bearings("front", "21", (0.1, 0.3)),
            sk.Bearings("back", "41", (0.15, 0.35)),
        ]
        found = at_rest(made.with_loads(*loads), "21", [np.radians(yoke)])
        assert found.torques.tau[0] == pytest.approx(100.0, rel=1e-4)
        forces = [found.couples[name][0, 0] for name in ("front", "back")]
        assert forces == pytest.approx([driving, driven], rel=1e-4, abs=1e-9)
