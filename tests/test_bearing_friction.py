"""Simulations with friction that follows from the reactions which it changes."""

from dataclasses import replace

import numpy as np
import pytest
from mechanism_examples.named_mechanisms import one_link_mechanism
from oracles.newton_euler import check_simulated_motion, with_point_masses

import spherekit as sk
from spherekit.dynamics.transmitted_forces import DrivenState, compute_reactions
from spherekit.positions.timing import Timing


def unbalanced_wheel(friction_per_moment, positions=(0.2, 0.7)):
    """Return a wheel out of balance that turns about z on two bearings, or on one.

    The axis is loaded by a moment M (N m) perpendicular to it. Two bearings 0.5 m apart
    carry M / 0.5 each, together 4 M. A single bearing, 0.25 m from the centre of the
    sphere, carries M / 0.25 = 4 M too, because the centre supports the wheel as well.

    The friction torque is coefficient times radius times the sum of forces. The radius is
    chosen so that this is g M, with the stated factor g.

    Parameters
    ----------
    friction_per_moment
        The factor g: friction torque (N m) per moment perpendicular to the axis (N m).
    positions
        Positions of the bearings on the axis, m.
    """
    tensor = (2.0, 0.0, 0.3), (0.0, 2.0, 0.4), (0.3, 0.4, 1.0)
    # coefficient * radius * 4 M = g M
    radius = 0.25 * friction_per_moment
    bearings = sk.Bearings(
        "rub",
        "12",
        positions,
        radius=radius,
        coefficient=1.0,
        speed=1e-3,  # rad/s below which the jump of Coulomb's law is smoothed
    )
    return one_link_mechanism(tensor, bearings, axis=(0.0, 0.0, 1.0))


@pytest.mark.parametrize("positions", [(0.2, 0.7), (0.25,)])
def test_an_unbalanced_wheel_is_slowed_by_the_friction_of_its_bearings(positions):
    """A simulated wheel out of balance is slowed as by a closed form.

    With the product of inertia P (0.5 kg m^2), the rate w and the acceleration a, the
    moment M perpendicular to the axis is M^2 = P^2 (a^2 + w^4). The friction torque is g M,
    with the factor g of `unbalanced_wheel`. The equation of motion C a = -g M, with the
    moment of inertia C, gives a = -k w^2 with k = g P / sqrt(C^2 - g^2 P^2). So the angle
    is log(1 + k w0 t) / k and the rate w0 / (1 + k w0 t).
    """
    friction_per_moment = 0.4
    initial_rate = 5.0
    product_of_inertia = 0.5
    moment_of_inertia = 1.0
    wheel = unbalanced_wheel(friction_per_moment, positions)
    simulation = sk.simulate(wheel, sk.Start(0.0, initial_rate), 1.0, tolerance=1e-11)
    assert simulation.end.kind == "time"
    # The compiled engine cannot have loads that depend on reactions.
    assert simulation.engine.name == "numpy"
    assert "depends on the reaction" in simulation.engine.reason

    friction_moment = friction_per_moment * product_of_inertia
    k = friction_moment / np.sqrt(moment_of_inertia**2 - friction_moment**2)
    t = np.linspace(0.0, 1.0, 7)
    history = simulation.at(t)
    angle = np.log1p(k * initial_rate * t) / k
    rate = initial_rate / (1.0 + k * initial_rate * t)
    assert history.q == pytest.approx(angle, abs=1e-10)
    assert history.dq == pytest.approx(rate, abs=1e-9)

    # The energy that is lost is the work of the friction.
    lost = 0.5 * moment_of_inertia * (history.dq**2 - initial_rate**2)
    assert history.work[:, 0] == pytest.approx(lost, abs=1e-9)
    assert simulation.checks.energy < 1e-12 * simulation.checks.energy_scale
    moment_across = product_of_inertia * history.dq**2 * np.sqrt(1.0 + k**2)
    assert simulation.moments(t).across[:, 0] == pytest.approx(moment_across, rel=1e-9)


def test_a_simulation_with_bearings_that_lock_is_refused():
    """In the closed form above there is no motion if g P reaches C, at g = 2."""
    with pytest.raises(sk.SpherekitError, match="fails at its start: bearings lock"):
        sk.simulate(unbalanced_wheel(2.01), sk.Start(0.0, 5.0), 1.0)
    simulation = sk.simulate(unbalanced_wheel(1.9), sk.Start(0.0, 5.0), 0.01)
    assert simulation.end.kind == "time"


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


CASES = {  # inputs (rad), rates (rad/s), pairs with friction, duration (s)
    "four_bar": ((0.3,), (2.0,), ("21", "41"), 0.4),
    "five_bar": ((1.0, 1.2), (1.0, -0.8), ("21", "43"), 0.4),
    "two_dof_spm": ((0.4, 0.9), (0.6, -0.5), ("21", "61"), 0.5),
}


def moving(name):
    """Return a shipped mechanism with point masses, driven at its inputs or at pair 21."""
    mechanism = with_point_masses(name)
    return mechanism.with_inputs(*([item.pair for item in mechanism.inputs] or ["21"]))


@pytest.mark.slow
def test_inverse_dynamics_with_friction_recovers_the_torque_of_a_simulation():
    """Inverse dynamics of a simulated motion returns the torque that drove it.

    The crank of a four-bar is driven by 5 sin(2 t) N m. The bearings of its rocker (pair
    41) have friction. The friction follows from reactions, and these from the torque, so
    both are solved together. Two analyses do so: one by the equation of Eksergian, the
    other for any number of inputs.
    """
    bearings = sk.Bearings(
        "rub",
        "41",
        positions=(0.4, 0.9),
        radius=0.1,
        coefficient=0.8,
        speed=0.05,  # rad/s below which friction is smoothed
    )
    run = sk.run(
        moving("four_bar").with_loads(bearings),
        ["eksergian", "dynamics"],
        start=sk.Start(0.3, 2.0),
        torque="5*sin(2*t)",
        duration=0.05,
        samples=5,
    )
    for analysis in ("eksergian", "dynamics"):
        table = run.frame(analysis)
        torque = 5.0 * np.sin(2.0 * table["t"].to_numpy())
        assert table["tau"].to_numpy() == pytest.approx(torque, abs=1e-7)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(
    "name", ["four_bar", "five_bar", pytest.param("two_dof_spm", marks=pytest.mark.long)]
)
def test_simulations_with_bearing_friction_satisfy_euler_s_equations(name):
    """Simulations with bearing friction satisfy Euler's equations of all links.

    `check_simulated_motion` solves these equations with all reactions, independently of
    spherekit. The first input is driven by 5 sin(2 t) - 0.5 rate N m; two pairs have
    bearings with friction, 0.5 m apart. Friction must take energy away all the time.
    """
    q, dq, friction_pairs, duration = CASES[name]
    mechanism = moving(name)
    inputs = [item.pair for item in mechanism.inputs]
    driven = inputs[0]
    radius = 0.1
    coefficient = 0.4
    bearings = [
        sk.Bearings(f"rub_{pair}", pair, (0.4, 0.9), radius, coefficient, speed=0.05)
        for pair in friction_pairs
    ]
    drive = sk.PairTorque("drive", driven, f"5*sin(2*t) - 0.5*dtheta_{driven}")
    mechanism = mechanism.with_loads(drive, *bearings)
    simulation = sk.simulate(mechanism, sk.Start(q, dq), duration, tolerance=1e-11)

    assert simulation.end.kind == "time"
    assert simulation.checks.energy < 1e-12 * simulation.checks.energy_scale
    work = simulation.at(np.linspace(0.0, duration, 6)).work
    for k, load in enumerate(mechanism.loads):
        if load in bearings:
            assert np.all(np.diff(work[:, k]) < 0.0)

    def driving_torques(t, rates):
        return [5.0 * np.sin(2.0 * t) - 0.5 * rates[0], *[0.0] * (len(inputs) - 1)]

    # Bearings without shares of the axial force (`axial`) only support moments. A moment M
    # across the axis loads each of the two bearings with M / (0.5 m). The friction torque
    # is coefficient times radius times the sum of both forces.
    friction_per_moment = 2 * coefficient * radius / 0.5
    check_simulated_motion(
        simulation,
        driving_torques,
        # The friction torque per moment M, by pair.
        grips=dict.fromkeys(friction_pairs, friction_per_moment),
        speed=0.05,  # that of the bearings, below which friction is smoothed
        within=1e-9,
    )


def output_bearings():
    """Return bearings with friction for the output gear of the planetary bevel train."""
    return sk.Bearings("rub", "output_pivot", (0.03, 0.08), radius=0.02, coefficient=0.1)


@pytest.mark.parametrize("acceleration", [-50.0, -1.0, 1.0])
def test_friction_that_reverses_the_load_of_gear_teeth_follows_from_their_new_side(
    acceleration,
):
    """The loads that cause friction are those of the reactions with this friction.

    A moment across the axis of the output gear loads its bearings. Their friction brakes
    the gear. When the train slows down, its inertia alone would drive the teeth on one
    side, and the friction makes them press on the other.
    """
    bearings = output_bearings()
    across = sk.Moment("across", "output", ("3", "0", "0"))
    train = replace(sk.load("planetary_bevel"), loads=(across, bearings))
    law = sk.Polynomial((0.3, 2.0, 0.5 * acceleration))
    solution = sk.inverse_dynamics(train, law, [0.0, 0.01], assembly_mode=0)
    timing = Timing(solution.t, solution.input_rates, solution.input_accelerations)
    reactions = compute_reactions(
        DrivenState(train, solution.motion, timing, solution.torques, solution.carried)
    )
    moments = reactions.moments[:, train.pair_number["output_pivot"]]
    loads = np.linalg.norm(bearings.supported_loads(moments), axis=2)
    assert solution.carried[:, 0] == pytest.approx(np.sum(loads, axis=1), rel=1e-9)


def test_bearings_of_an_unloaded_gear_train_at_constant_speed_have_no_friction():
    """The teeth carry nothing but rounding errors, which do not tell on which side."""
    train = replace(sk.load("planetary_bevel"), loads=(output_bearings(),))
    law = sk.ConstantSpeed(0.3, 2.0)
    solution = sk.inverse_dynamics(train, law, np.linspace(0.0, 3.0, 101), assembly_mode=0)
    assert not np.any(solution.status)
    assert solution.tau == pytest.approx(0.0, abs=1e-15)
