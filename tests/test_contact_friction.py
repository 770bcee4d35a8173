"""Coulomb's friction of a contact that slides, against Newton and Euler by hand."""

import numpy as np
import pytest
from helpers.refusals import mechanism_text

import spherekit as sk

CAM = mechanism_text("rubbed_cam")
SPEED, STIFFNESS, INERTIA = 1.3, 2.0, 0.4
FRAME, OFF_SHAFT, CENTRES, ARM = 1.1, 0.15, 0.65, 0.8


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
    """Return push, traction, the input's torque (n,) N m at its speed, and the slip.

    The contact lies on the great circle through both centres; the follower turns about
    its hinge by the moment of the spring, the push along that circle and the friction
    across it.
    """
    step = 2e-3
    around = (t[:, None] * SPEED + step * np.arange(-4, 5)).ravel()
    motion = sk.trace(mechanism, path=around, assembly_mode=mode)
    angle = motion.values[:, mechanism.angles["hinge"]].reshape(len(t), 9)
    first = np.array([3, -32, 168, -672, 0, 672, -168, 32, -3]) / 840 / step
    second = np.array([-9, 128, -1008, 8064, -14350, 8064, -1008, 128, -9]) / 5040 / step**2
    rate, change = SPEED * angle @ first, SPEED**2 * angle @ second
    middle = 9 * np.arange(len(t)) + 4
    shaft = np.array([0.0, 0.0, 1.0])
    hinge = np.array([0.0, np.sin(FRAME), np.cos(FRAME)])
    rows = []
    for row, turns in enumerate(motion.placed[middle]):
        cam, roller = (
            turns[mechanism.link_number[link]] @ np.array(pair.centre)
            for link, pair in zip(
                ("cam", "follower"), mechanism.pair("touch").profiles, strict=True
            )
        )
        assert np.arccos(cam @ roller) == pytest.approx(CENTRES, abs=1e-12)
        tangent = np.cross(cam, roller) / np.sin(CENTRES)
        point = turned(cam, tangent, 0.45)
        normal = np.cross(point, tangent)
        slip = np.cross(rate[row] * hinge - SPEED * shaft, point) @ tangent
        grip = -coefficient * np.tanh(slip / 0.02)
        free = INERTIA * change[row] + STIFFNESS * (angle[row, 4] - rest)
        along, across = tangent @ hinge, normal @ hinge
        # The friction goes by the size of the push, whose sign that decides.
        push = next(
            free / (along + sign * grip * across)
            for sign in (1.0, -1.0)
            if sign * free / (along + sign * grip * across) >= 0.0
        )
        moment = push * tangent + grip * abs(push) * normal
        rows.append((push, grip * abs(push), moment @ shaft, slip))
    return np.array(rows).T


@pytest.mark.many
@pytest.mark.parametrize(("coefficient", "rest"), [(0.2, 0.5), (0.6, -2.0)])
@pytest.mark.parametrize("mode", [0, 1])
def test_newton_and_euler_by_hand(cam, coefficient, rest, mode):
    mechanism = cam(coefficient, rest, "distance = 0.1")
    t = np.linspace(0.1, 4.0, 9)
    push, traction, torque, slip = by_hand(mechanism, coefficient, rest, t, mode)
    run = sk.run(
        mechanism,
        ["reactions", "eksergian", "dynamics"],
        samples=9,
        laws={"shaft": sk.ConstantSpeed(SPEED, 0.1 * SPEED)},
        duration=3.9,
        assembly_mode=mode,
    )
    rows = run.frame("reactions", "reactions").query("pair == 'touch'")
    assert rows["contact_torque"].to_numpy() == pytest.approx(push, abs=1e-7)
    assert rows["traction"].to_numpy() == pytest.approx(traction, abs=1e-7)
    assert rows["force_x"].to_numpy() == pytest.approx(traction / 0.1, abs=1e-6)
    assert rows["force_y"].to_numpy() == pytest.approx(-push / 0.1, abs=1e-6)
    for analysis in ("eksergian", "dynamics"):
        tau = run.frame(analysis, analysis)["tau"].to_numpy()
        assert tau == pytest.approx(torque, abs=1e-7)
    power = run.frame("eksergian", "loads").query("load == 'rub'")["power"].to_numpy()
    assert power == pytest.approx(traction * slip, abs=1e-7) and np.all(power < 0.0)


@pytest.mark.slow
def test_energy_of_a_motion_goes_into_friction(cam):
    mechanism = cam(0.3, 0.9)
    found = sk.simulate(mechanism, sk.Start(0.3, 2.0), 1.2, torque="0.5*cos(t)", check=True)
    assert found.end.kind == "time" and found.engine.name == "numpy"
    assert "follows from the reaction" in found.engine.reason
    checks = found.checks
    assert checks.energy < 1e-11 * checks.energy_scale and not found.missed
    history = found.at(np.linspace(0.0, 1.2, 9))
    work = history.work[:, [load.name for load in mechanism.loads].index("rub")]
    assert np.all(np.diff(work) < 0.0) and work[-1] < -0.1


def test_a_contact_that_does_not_slide_has_none(cam, tmp_path):
    mechanism = cam(0.2, 0.5)
    for made in (mechanism, cam(0.0, 0.5)):
        sk.dump(made, tmp_path / "copy.toml")
        assert sk.load(tmp_path / "copy.toml") == made
    with pytest.raises(sk.SpherekitError, match="follows from the reaction of pair touch"):
        sk.reduced_model(mechanism)
    rub = sk.ContactFriction("rub", "hinge", 0.2)
    with pytest.raises(sk.SpherekitError, match=r"loads\.rub\.pair.* Cs pairs: touch"):
        mechanism.with_loads(rub)
    without = sk.run(cam(0.0, 0.5), "eksergian", samples=5).frame("eksergian", "loads")
    assert not np.any(without.query("load == 'rub'")["Q"])
