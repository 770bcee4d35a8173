"""Simulations with friction that follows from the reactions which it changes."""

import numpy as np
import pytest
from mechanism_examples.named_mechanisms import one_link_mechanism
from oracles.newton_euler import check_simulated_motion, with_point_masses

import spherekit as sk


def spun(grip, positions=(0.2, 0.7)):
    """Return a wheel out of balance on one axis, on two bearings 0.5 m apart or on one."""
    tensor = (2.0, 0.0, 0.3), (0.0, 2.0, 0.4), (0.3, 0.4, 1.0)
    rub = sk.Bearings("rub", "12", positions, 0.25 * grip, 1.0, 1e-3)
    return one_link_mechanism(tensor, rub, axis=(0.0, 0.0, 1.0))


@pytest.mark.parametrize("positions", [(0.2, 0.7), (0.25,)])
def test_a_wheel_out_of_balance_is_slowed_by_what_its_bearings_carry(positions):
    """By hand: M^2 = P^2 (a^2 + w^4) across the axis, with P its product of inertia.

    With C a = -g M and the moment of inertia C about the axis, a = -k w^2 with
    k = g P / sqrt(C^2 - g^2 P^2), so the angle is log(1 + k w t) / k.
    """
    grip, first, product, tensor = 0.4, 5.0, 0.5, 1.0
    found = sk.simulate(spun(grip, positions), sk.Start(0.0, first), 1.0, tolerance=1e-11)
    assert found.end.kind == "time" and found.engine.name == "numpy"
    assert "follows from the reaction" in found.engine.reason
    k = grip * product / np.sqrt(tensor**2 - grip**2 * product**2)
    t = np.linspace(0.0, 1.0, 7)
    history = found.at(t)
    assert history.q == pytest.approx(np.log1p(k * first * t) / k, abs=1e-10)
    assert history.dq == pytest.approx(first / (1.0 + k * first * t), abs=1e-9)
    # What is lost of the energy is the work of the friction.
    lost = 0.5 * tensor * (history.dq**2 - first**2)
    assert history.work[:, 0] == pytest.approx(lost, abs=1e-9)
    assert found.checks.energy < 1e-12 * found.checks.energy_scale
    across = found.moments(t).across[:, 0]
    want = product * history.dq**2 * np.sqrt(1.0 + k**2)
    assert across == pytest.approx(want, rel=1e-9)


def test_bearings_that_lock_end_a_simulation():
    """As found by hand above: there is no motion where g P reaches C."""
    with pytest.raises(sk.SpherekitError, match="cannot leave its start: bearings lock"):
        sk.simulate(spun(2.01), sk.Start(0.0, 5.0), 1.0)
    assert sk.simulate(spun(1.9), sk.Start(0.0, 5.0), 0.01).end.kind == "time"


@pytest.mark.slow
def test_rows_at_singularities_say_nothing_of_what_bearings_carry():
    """At a change point reactions are open, which is no fault of the other rows."""
    sizes = dict(zip("1234", (60.0, 40.0, 60.0, 40.0), strict=True))
    made = with_point_masses("four_bar").with_sizes(angle_unit="deg", arcs=sizes)
    made = made.with_inputs(ranges={"21": (0.0, 1.0)}, angle_unit="rad")
    rub = sk.Bearings("rub", "41", (0.4, 0.9), 0.1, 0.3, speed=0.05)
    run = sk.run(made.with_loads(rub), ["eksergian", "dynamics"], samples=3)
    for name in run.results:
        if name != "motion":
            told = run.frame(name)["status"].astype(str)
            assert list(told) == ["AT_SINGULARITY", "OK", "OK"] * 2


CASES = {
    "four_bar": ((0.3,), (2.0,), ("21", "41"), 0.4),
    "five_bar": ((1.0, 1.2), (1.0, -0.8), ("21", "43"), 0.4),
    "two_dof_spm": ((0.4, 0.9), (0.6, -0.5), ("21", "61"), 0.5),
}


def moving(name):
    made = with_point_masses(name)
    return made.with_inputs(*([item.pair for item in made.inputs] or ["21"]))


def test_friction_recovers_the_torque_that_drove_it():
    """The inverse problem, which finds friction with the torques, along a simulation."""
    made = moving("four_bar")
    rub = sk.Bearings("rub", "41", (0.4, 0.9), 0.1, 0.8, speed=0.05)
    run = sk.run(
        made.with_loads(rub),
        ["eksergian", "dynamics"],
        start=sk.Start(0.3, 2.0),
        torque="5*sin(2*t)",
        duration=0.05,
        samples=5,
    )
    for analysis in ("eksergian", "dynamics"):
        table = run.frame(analysis)
        want = 5.0 * np.sin(2.0 * table["t"].to_numpy())
        assert table["tau"].to_numpy() == pytest.approx(want, abs=1e-7)


@pytest.mark.many
@pytest.mark.parametrize(
    "name", ["four_bar", "five_bar", pytest.param("two_dof_spm", marks=pytest.mark.long)]
)
def test_free_bodies_with_all_reactions_and_friction_move_the_same_way(name):
    q, dq, rubbing, until = CASES[name]
    made = moving(name)
    inputs = [item.pair for item in made.inputs]
    driven = inputs[0]
    rub = [
        sk.Bearings(f"rub_{pair}", pair, (0.4, 0.9), 0.1, 0.4, speed=0.05)
        for pair in rubbing
    ]
    drive = sk.PairTorque("drive", driven, f"5*sin(2*t) - 0.5*dtheta_{driven}")
    made = made.with_loads(drive, *rub)
    found = sk.simulate(made, sk.Start(q, dq), until, tolerance=1e-11)
    assert found.end.kind == "time"
    t = np.linspace(0.0, until, 6)
    history = found.at(t)
    checks = found.checks
    assert checks.energy < 1e-12 * checks.energy_scale
    work = [history.work[:, k] for k, load in enumerate(made.loads) if load in rub]
    assert len(work) == 2 and np.all(np.diff(work, axis=1) < 0.0)

    def driving(t, rates):
        return [5.0 * np.sin(2.0 * t) - 0.5 * rates[0], *(0.0 for _ in inputs[1:])]

    grips = dict.fromkeys(rubbing, 2 * 0.4 * 0.1 / 0.5)
    check_simulated_motion(found, driving, grips, 0.05, within=1e-9)
