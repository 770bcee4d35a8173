"""Coulomb's friction of a contact that slides, against Newton and Euler by hand."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.refusals import mechanism_text

import spherekit as sk

CAM = mechanism_text("rubbed_cam")
SPEED = 1.3
"""Speed of the shaft, rad/s."""
STIFFNESS = 2.0
"""Stiffness of the spring at the hinge, N m/rad."""
INERTIA = 0.4
"""Moment of inertia of the follower about its hinge, kg m^2."""
FRAME = 1.1
"""Arc between shaft and hinge, rad."""
CENTRES = 0.65
"""Arc between the centres of cam and roller, rad."""
CAM_RADIUS = 0.45
"""Radius of the cam, an arc on the sphere (rad)."""
SMOOTHING_SPEED = 0.02
"""Sliding speed (rad/s) below which the friction is smoothed."""


@pytest.fixture
def cam(tmp_path):
    """Return the mechanism with a coefficient of friction and a rest of its spring."""

    def made(coefficient, rest, distance=""):
        path = tmp_path / "rubbed_cam.toml"
        path.write_text(
            CAM.format(coefficient=coefficient, rest=rest, distance=distance), "utf-8"
        )
        return sk.load(path)

    return made


def turned(vector, axis, angle):
    """Return a vector turned about a unit axis (Rodrigues)."""
    return (
        vector * np.cos(angle)
        + np.cross(axis, vector) * np.sin(angle)
        + axis * (axis @ vector) * (1.0 - np.cos(angle))
    )


def by_hand(mechanism, coefficient, rest, t, mode):
    """Return contact forces, driving torque and sliding speed by a hand calculation.

    The contact lies on the great circle through the centres of cam and roller. The normal
    force acts along this circle, the friction at right angles to it. Their moments about
    the centre of the sphere are the push and the traction (N m). The moments of the spring,
    of the push and of the traction about the hinge accelerate the follower. Rates of the
    follower are central differences of its angle, of order 8, at the constant speed of the
    shaft.

    Parameters
    ----------
    mechanism, mode
        Cam mechanism, and number of its assembly mode.
    coefficient, rest
        Coefficient of friction, and angle (rad) at which the spring is free.
    t
        (n,) times, s.

    Returns
    -------
    (4, n) array: push and traction as moments (N m) about the centre of the sphere, torque
    (N m) at the shaft, and sliding speed (rad/s).
    """
    step = 2e-3
    inputs = (t[:, None] * SPEED + step * np.arange(-4, 5)).ravel()
    motion = sk.trace(mechanism, path=inputs, assembly_mode=mode)
    angle = motion.values[:, mechanism.angles["hinge"]].reshape(len(t), 9)
    first = np.array([3, -32, 168, -672, 0, 672, -168, 32, -3]) / 840 / step
    second = np.array([-9, 128, -1008, 8064, -14350, 8064, -1008, 128, -9]) / 5040 / step**2
    rate = SPEED * angle @ first
    acceleration = SPEED**2 * angle @ second
    middle = 9 * np.arange(len(t)) + 4  # rows at the times t

    shaft_axis = np.array([0.0, 0.0, 1.0])
    hinge_axis = np.array([0.0, np.sin(FRAME), np.cos(FRAME)])
    cam_profile, roller_profile = mechanism.pair("touch").profiles
    rows = []
    for row, rotations in enumerate(motion.placed[middle]):
        cam_rotation = rotations[mechanism.link_number["cam"]]
        follower_rotation = rotations[mechanism.link_number["follower"]]
        cam = cam_rotation @ np.array(cam_profile.centre)
        roller = follower_rotation @ np.array(roller_profile.centre)
        assert np.arccos(cam @ roller) == pytest.approx(CENTRES, abs=1e-12)
        tangent = np.cross(cam, roller) / np.sin(CENTRES)
        # The contact, on the rim of the cam towards the roller. A push has its moment along
        # `tangent`, a traction along `normal`.
        point = turned(cam, tangent, CAM_RADIUS)
        normal = np.cross(point, tangent)

        relative_rate = rate[row] * hinge_axis - SPEED * shaft_axis
        slip = np.cross(relative_rate, point) @ tangent
        friction_ratio = -coefficient * np.tanh(slip / SMOOTHING_SPEED)
        # The moment about the hinge that the contact has to supply.
        needed = INERTIA * acceleration[row] + STIFFNESS * (angle[row, 4] - rest)
        # The traction is the friction ratio times the size of the push. With each sign of
        # the push, the moment about the hinge is `arm` times the push. The sign is right if
        # the push that follows has it.
        for sign in (1.0, -1.0):
            arm = tangent @ hinge_axis + sign * friction_ratio * (normal @ hinge_axis)
            push = needed / arm
            if sign * push >= 0.0:
                break
        traction = friction_ratio * abs(push)
        moment = push * tangent + traction * normal
        rows.append((push, traction, moment @ shaft_axis, slip))
    return np.array(rows).T


@pytest.mark.many
@pytest.mark.parametrize(("coefficient", "rest"), [(0.2, 0.5), (0.6, -2.0)])
@pytest.mark.parametrize("mode", [0, 1])
def test_contact_forces_and_torques_with_friction_are_those_by_hand(
    cam, coefficient, rest, mode
):
    """Reactions, loads and driving torques with friction are those of a hand calculation.

    A run at nine times is compared with `by_hand`. The fixture `cam` builds the mechanism
    with a coefficient of friction and the angle `rest` (rad) at which its spring is free.
    In its file "touch" is the contact of cam and roller, and "rub" the friction there.
    Friction takes power away at all times. `mode` is the number of the assembly mode (way
    to assemble the links).
    """
    distance = 0.1  # of the contact from the centre of the sphere, m
    mechanism = cam(coefficient, rest, f"distance = {distance}")
    t = np.linspace(0.1, 4.0, 9)
    # Push and traction are moments (N m) of the contact about the centre of the sphere.
    # `torque` (N m) is at the shaft, and `slip` is the sliding speed on the unit sphere
    # (rad/s).
    push, traction, torque, slip = by_hand(mechanism, coefficient, rest, t, mode)
    run = sk.run(
        mechanism,
        ["reactions", "eksergian", "dynamics"],
        samples=9,
        # The time of a run begins at 0. So its inputs begin at the angle at t = 0.1 s.
        laws={"shaft": sk.ConstantSpeed(SPEED, start=0.1 * SPEED)},
        duration=3.9,
        assembly_mode=mode,
    )
    rows = run.frame("reactions", "reactions").query("pair == 'touch'")
    assert rows["contact_torque"].to_numpy() == pytest.approx(push, abs=1e-7)
    assert rows["traction"].to_numpy() == pytest.approx(traction, abs=1e-7)
    # Axes of the contact: x is tangent to both circles, y is normal to them, and z leads to
    # the contact point at the distance r. The force (X, Y, 0) at this point has the moment
    # (-r Y, r X, 0). The push is the moment about x, the traction that about y.
    force_x = traction / distance
    force_y = -push / distance
    assert rows["force_x"].to_numpy() == pytest.approx(force_x, abs=1e-6)
    assert rows["force_y"].to_numpy() == pytest.approx(force_y, abs=1e-6)
    for analysis in ("eksergian", "dynamics"):
        tau = run.frame(analysis, analysis)["tau"].to_numpy()
        assert tau == pytest.approx(torque, abs=1e-7)
    power = run.frame("eksergian", "loads").query("load == 'rub'")["power"].to_numpy()
    assert power == pytest.approx(traction * slip, abs=1e-7)
    assert np.all(power < 0.0)


def test_friction_with_the_coefficient_0_leaves_no_further_force_undetermined(cam):
    """A contact without friction transmits no force along its tangent."""
    laws = {"shaft": sk.ConstantSpeed(SPEED)}
    options = {"samples": 3, "laws": laws, "duration": 1.0, "assembly_mode": 0}
    mechanism = cam(0.0, 0.5)
    loads = [load for load in mechanism.loads if load.name != "rub"]
    forces = [
        sk.run(model, "reactions", **options).frame("reactions", "reactions")
        for model in (mechanism, replace(mechanism, loads=tuple(loads)))
    ]
    columns = ["force_x", "force_y", "force_z"]
    np.testing.assert_array_equal(forces[0][columns], forces[1][columns])


@pytest.mark.slow
def test_energy_of_a_motion_goes_into_friction(cam):
    mechanism = cam(0.3, 0.9)
    found = sk.simulate(mechanism, sk.Start(0.3, 2.0), 1.2, torque="0.5*cos(t)", check=True)
    assert found.end.kind == "time" and found.engine.name == "numpy"
    assert "depends on the reaction" in found.engine.reason
    checks = found.checks
    assert checks.energy < 1e-11 * checks.energy_scale and not found.missed
    history = found.at(np.linspace(0.0, 1.2, 9))
    work = history.work[:, [load.name for load in mechanism.loads].index("rub")]
    assert np.all(np.diff(work) < 0.0) and work[-1] < -0.1


@pytest.mark.parametrize("coefficient", [0.3, 0.0])
def test_friction_goes_with_its_contact_when_only_needed_links_are_computed(
    cam, coefficient
):
    mechanism = cam(coefficient, 0.5)
    part = sk.run(mechanism, "poles:only=cam/base", samples=3, only_needed=True)
    assert part.summary["part_of"]["left_out_pairs"] == ["hinge", "touch"]


@pytest.mark.parametrize("coefficient", [0.3, 0.0])
def test_contacts_with_friction_stay_if_loads_are_computed(cam, coefficient):
    """The follower has neither mass nor a spring, only the friction of its contact."""
    mechanism = cam(coefficient, 0.5)
    (cam_mass,) = (mass for mass in mechanism.masses if mass.link == "cam")
    (rub,) = (load for load in mechanism.loads if load.name == "rub")
    mechanism = replace(mechanism, masses=(cam_mass,), loads=(rub,))
    run = sk.run(mechanism, "dynamics", samples=3, only_needed=True)
    assert set(run.frame("dynamics", "loads")["load"]) == {"rub"}


def test_contact_friction_is_kept_in_files(cam, tmp_path):
    for coefficient in (0.2, 0.0):
        mechanism = cam(coefficient, 0.5)
        sk.dump(mechanism, tmp_path / "copy.toml")
        assert sk.load(tmp_path / "copy.toml") == mechanism


def test_contact_friction_is_refused_where_it_cannot_be_computed(cam):
    """A reduced model has no reactions, and only Cs pairs slide."""
    mechanism = cam(0.2, 0.5)
    with pytest.raises(sk.SpherekitError, match="depends on the reaction of pair touch"):
        sk.reduced_model(mechanism)
    friction = sk.ContactFriction("rub", "hinge", 0.2)
    with pytest.raises(sk.SpherekitError, match=r"loads\.rub\.pair.* Cs pairs: touch"):
        mechanism.with_loads(friction)


def test_a_contact_without_friction_does_no_work(cam):
    table = sk.run(cam(0.0, 0.5), "eksergian", samples=5).frame("eksergian", "loads")
    assert not np.any(table.query("load == 'rub'")["Q"])
