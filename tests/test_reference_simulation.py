"""Simulations in wide numbers against closed forms, and errors that a trade measures.

Wide numbers have 20 digits or more. A trade compares engines and tolerances by their cost
and by their error from such a reference.
"""

from dataclasses import replace
from functools import partial

import mpmath as mp
import numpy as np
import pytest
from helpers.engines import needs_heyoka
from mechanism_examples.named_mechanisms import one_link_mechanism
from oracles.exact_four_bar import arcs_of
from oracles.exact_four_bar import four_bar as four_bar_at

import spherekit as sk
from spherekit.dynamics.forward_dynamics import simulate
from spherekit.dynamics.reference_simulation import reference_simulation
from spherekit.errors import EngineError
from spherekit.files.study import Start
from spherekit.mechanism.load import TorqueTable
from spherekit.mechanism.load_kinds import Gravity, JointLimit, PairTorque, Spring
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.proof.balls import Digits
from spherekit.proof.reference_motion import ExactSimulation
from spherekit.runs.evaluation_options import Setting
from spherekit.runs.registry import create_analysis
from spherekit.runs.sampling import sample_simulation
from spherekit.runs.simulation_measurement import compute_timed_tables
from spherekit.runs.trade import trade
from spherekit.symbolic.compiler import available
from spherekit.tolerances import EPS

INERTIA = 0.75
"""Inertia of the pendulum about its hinge 12, kg m^2."""
MASS, DISTANCE = 2.5, 0.25
"""Mass of the pendulum (kg), and distance of its centre of mass from the hinge (m)."""
GRAVITY = 9.75
"""Acceleration of gravity, m/s^2. All these numbers are exact in binary."""
FIFTY_DIGITS = Digits(50)


@pytest.fixture(autouse=True)
def digits():
    """Compute in 50 digits, with mpmath and with wide numbers."""
    with mp.workdps(50), FIFTY_DIGITS.within():
        yield


def pendulum(*loads, **options):
    """Return a link on one hinge, driven by loads only; it hangs at the angle 0."""
    tensor = np.diag([INERTIA, 0.5, 0.5])
    centre = (0.0, 0.0, -DISTANCE)
    return one_link_mechanism(tensor, *loads, mass=MASS, centre=centre, **options)


def largest_difference(numbers, expected):
    """Return the largest difference of wide numbers from those of mpmath, as a float."""
    differences = []
    for number, exact in zip(np.ravel(numbers), expected, strict=True):
        differences.append(float(abs(mp.mpf(number) - exact)))
    return max(differences)


def test_a_pendulum_swings_by_elliptic_functions():
    """A pendulum simulated in 20 digits has the motion of Jacobi's elliptic functions.

    Angle, rate and acceleration at 13 times are compared with mpmath's sn and cn in 50
    digits. From the lowest position with the rate w0, sin(angle / 2) = k sn(w t, m) with
    the small oscillation's angular frequency w, k = w0 / (2 w) and the parameter m = k^2.
    """
    t = np.linspace(0.0, 6.0, 13)
    start_rate = 3.5
    mechanism = pendulum(Gravity("weight", (0.0, 0.0, -GRAVITY)))
    simulation = reference_simulation(mechanism, Start(0.0, start_rate), 6.0)
    q, dq, ddq = simulation.at(t)[:3]

    w = mp.sqrt(mp.mpf(MASS) * DISTANCE * GRAVITY / INERTIA)
    k = mp.mpf(start_rate) / (2 * w)
    angles = []
    rates = []
    accelerations = []
    for time in t:
        angle = 2 * mp.asin(k * mp.ellipfun("sn", w * time, m=k**2))
        angles.append(angle)
        rates.append(2 * w * k * mp.ellipfun("cn", w * time, m=k**2))
        accelerations.append(-w * w * mp.sin(angle))
    assert largest_difference(q[:, 0], angles) < 1e-18
    assert largest_difference(dq[:, 0], rates) < 4e-18
    assert largest_difference(ddq[:, 0], accelerations) < 2e-17


@pytest.mark.slow
def test_a_load_with_a_kink_is_integrated_exactly_on_both_sides():
    """A link pushed by a load with a kink moves as its closed form says, in 20 digits.

    The load is zero up to the angle 0.5 rad, which the link reaches at 1 rad/s. Beyond
    0.5 rad it pushes the link on, with 3 N m per rad. So it has a kink at 0.5 rad. With
    3 / `INERTIA` = 4 = 2^2, the angle is 0.5 + sinh(2 (t - 0.5)) / 2 from 0.5 s on.
    """
    mechanism = pendulum(PairTorque("push", "12", "3*max(0, theta_12 - 0.5)"))
    simulation = reference_simulation(mechanism, Start(0.0, 1.0), 2.0)
    (kink_time,) = simulation.switches
    assert largest_difference([kink_time], [mp.mpf(0.5)]) < 1e-18
    t = np.linspace(0.0, 2.0, 9)
    angles = []
    for time in map(mp.mpf, t):
        beyond = 0.5 + mp.sinh(2 * (time - 0.5)) / 2
        angles.append(time if time < 0.5 else beyond)
    q = simulation.at(t)[0][:, 0]
    assert largest_difference(q, angles) < 1e-17


@pytest.mark.slow
def test_dry_friction_stops_a_link_at_the_time_and_angle_of_uniform_deceleration():
    """A link that starts at 1 rad/s with the deceleration a stops at the time 1 / a.

    Until then it turns by 1 / (2 a).
    """
    mechanism = pendulum(PairTorque("brake", "12", "-0.6*sign(dtheta_12)"))
    simulation = reference_simulation(mechanism, Start(0.0, 1.0), 2.0)
    deceleration = mp.mpf(0.6) / INERTIA
    assert simulation.kind == "sticking"
    assert largest_difference([simulation.end], [1 / deceleration]) < 1e-18
    q_after_end = simulation.at(np.array([2.0]))[0][:, 0]
    assert largest_difference(q_after_end, [1 / (2 * deceleration)]) < 1e-17


@pytest.mark.slow
def test_a_simulation_ends_at_a_joint_limit_at_the_time_of_uniform_motion():
    mechanism = pendulum(joint_limits=(JointLimit("12", -1.0, 0.7),))
    simulation = reference_simulation(mechanism, Start(0.0, 0.9), 2.0)
    assert simulation.kind == "joint_limit"
    expected_time = mp.mpf(0.7) / mp.mpf(0.9)
    assert largest_difference([simulation.end], [expected_time]) < 1e-18


@pytest.mark.slow
def test_the_rate_under_a_repeated_table_of_torques_is_its_impulse_over_the_inertia():
    """The rate of a link under a sawtooth torque is the torque's integral over the inertia.

    The torque rises to 1 N m in 0.1 s, falls to 0 in 0.2 s, and so on. Its integral is a
    closed form, evaluated in 50 digits.
    """
    rise = mp.mpf(0.1)
    period = mp.mpf(0.3)
    saw = TorqueTable("saw", "12", (0.0, 0.1, 0.3), (0.0, 1.0, 0.0), True)
    simulation = reference_simulation(pendulum(saw), Start(0.0, 0.0), 2.0)

    def rate_at(time):
        """Return the exact rate (rad/s) at a time (s)."""
        period_count = int(mp.floor(time / period))
        rest = time - period_count * period
        impulse_rising = min(rest, rise) ** 2 / (2 * rise)
        fall = max(rest - rise, 0)
        impulse_falling = fall - fall**2 / (2 * (period - rise))
        impulse = period_count * period / 2 + impulse_rising + impulse_falling
        return impulse / INERTIA

    t = np.linspace(0.0, 2.0, 9)
    rates = simulation.at(t)[1][:, 0]
    assert largest_difference(rates, [rate_at(mp.mpf(x)) for x in t]) < 1e-17


def test_a_torque_may_jump_between_two_close_times_of_a_table():
    """After a torque of 1 N m begins within 1e-12 s, the rate follows from its impulse."""
    jump_end = 1.0 + 1e-12
    table = TorqueTable("jump", "12", (0.0, 1.0, jump_end, 2.0), (0.0, 0.0, 1.0, 1.0))
    simulation = reference_simulation(pendulum(table), Start(0.0, 1.0), 2.0)
    rate = simulation.at(np.array([2.0]))[1][0]
    impulse = (mp.mpf(jump_end) - 1) / 2 + 2 - mp.mpf(jump_end)
    assert largest_difference(rate, [1 + impulse / INERTIA]) < 1e-18


def test_a_table_of_torques_may_have_its_first_kink_just_after_the_start():
    kink = 1e-13
    table = TorqueTable("early", "12", (0.0, kink, 2.0), (0.0, 1.0, 1.0))
    simulation = reference_simulation(pendulum(table), Start(0.0, 1.0), 2.0)
    rate = simulation.at(np.array([2.0]))[1][0]
    assert largest_difference(rate, [1 + (2 - mp.mpf(kink) / 2) / INERTIA]) < 1e-18


def test_two_different_brakes_on_one_pair_stop_the_link(monkeypatch):
    """The motion ends at rest, where neither brake lets it continue in either sense."""
    monkeypatch.setattr(
        ExactSimulation, "_try_step", limit_calls(ExactSimulation._try_step, 50)
    )
    weak = PairTorque("weak", "12", "-0.3*sign(dtheta_12)")
    strong = PairTorque("strong", "12", "-0.6*sign(dtheta_12)")
    simulation = reference_simulation(pendulum(weak, strong), Start(0.0, 1.0), 2.0)
    assert simulation.kind == "sticking"
    deceleration = (mp.mpf(0.3) + mp.mpf(0.6)) / INERTIA
    assert largest_difference([simulation.end], [1 / deceleration]) < 1e-18


def limit_calls(function, count):
    """Return a function that fails after a number of calls, so that no test runs on."""
    remaining = iter(range(count))

    def call(*arguments):
        assert next(remaining, None) is not None, "too many steps"
        return function(*arguments)

    return call


STIFFNESS, REST_ANGLE = 0.5, 0.2
"""Of the spring at the input, N m/rad and rad."""
SPRING = Spring("coil", "21", STIFFNESS, REST_ANGLE)
FOUR_BAR = replace(sk.load("four_bar"), loads=(SPRING,))
START = Start(0.5, 3.0)


def inertia_by_link(q):
    """Return the equivalent inertia at the input of the three moving links, 50 digits.

    It is computed from a closed form of the four-bar, without spherekit's solver.
    """
    tensors = {int(mass.link): mass.tensor for mass in FOUR_BAR.masses}
    return four_bar_at(arcs_of(FOUR_BAR), q, 1).inertia(tensors)


def potential_energy(q):
    """Return the energy of the spring at an input angle."""
    return mp.mpf(STIFFNESS) * (q - mp.mpf(REST_ANGLE)) ** 2 / 2


@pytest.fixture(scope="module")
def four_bar_motion():
    """Return times, inputs and their rates of the four-bar, in wide numbers."""
    with mp.workdps(50), FIFTY_DIGITS.within():
        t = np.linspace(0.0, 0.5, 4)
        q, dq = reference_simulation(FOUR_BAR, START, 0.5).at(t)[:2]
        return t, [mp.mpf(x) for x in q[:, 0]], [mp.mpf(x) for x in dq[:, 0]]


@pytest.mark.slow
def test_a_four_bar_with_a_spring_keeps_its_energy(four_bar_motion):
    """Kinetic energy by the closed form of the inertia, and the energy of the spring."""
    _, q, rates = four_bar_motion
    assert largest_difference([q[0], rates[0]], [START.q, START.dq]) < 1e-18
    energies = []
    for angle, rate in zip(q, rates, strict=True):
        kinetic_energy = mp.fsum(inertia_by_link(angle)) * rate**2 / 2
        energies.append(kinetic_energy + potential_energy(angle))
    assert largest_difference(energies, [energies[0]] * len(q)) < 1e-16


@pytest.mark.slow
def test_rates_of_a_reference_simulation_are_derivatives_of_its_inputs():
    """Rates agree with a five-point difference of the inputs with steps of 2^-12 s.

    Its error is below 1e-10.
    """
    step = 2.0**-12
    times = 0.25 + step * np.arange(-2, 3)
    q, dq = reference_simulation(FOUR_BAR, START, 0.5).at(times)[:2]
    q_m2, q_m1, _, q_p1, q_p2 = map(mp.mpf, q[:, 0])
    difference_quotient = (q_m2 - 8 * q_m1 + 8 * q_p1 - q_p2) / (12 * step)
    assert largest_difference([difference_quotient], [dq[2, 0]]) < 1e-10


def exact_tables(q, rates):
    """Return the columns of `eksergian` for the four-bar with a spring, in 50 digits.

    They are the reference for errors of simulations. The inertia B reduced to the input is
    a closed form and its derivative a difference in 50 digits; the acceleration follows
    from Eksergian's equation B ddq + dB/dq dq^2 / 2 = Q.

    Parameters
    ----------
    q, rates
        Inputs (rad) and their rates (rad/s) of the rows (instants).

    Returns
    -------
    dict
        Columns by name for each table by name.
    """
    B_by_link = []  # rows, links
    dB_by_link = []
    for angle in q:
        B_by_link.append(inertia_by_link(angle))
        dB_by_link.append(
            [mp.diff(lambda y, k=k: inertia_by_link(y)[k], angle) for k in range(3)]
        )
    B = [mp.fsum(row) for row in B_by_link]
    dB = [mp.fsum(row) for row in dB_by_link]
    Q = [-STIFFNESS * (angle - mp.mpf(REST_ANGLE)) for angle in q]
    accelerations = []
    power = []
    for k, rate in enumerate(rates):
        accelerations.append((Q[k] - dB[k] * rate * rate / 2) / B[k])
        power.append(Q[k] * rate)
    return {
        "eksergian": {
            "q": q,
            "dq": rates,
            "ddq": accelerations,
            "B": B,
            "dB_dq": dB,
            "Q": Q,
            "tau": [mp.mpf(0)] * len(q),
        },
        "inertia": {
            "B": [number for row in B_by_link for number in row],
            "dB_dq": [number for row in dB_by_link for number in row],
        },
        "loads": {"Q": Q, "power": power},
    }


def largest_relative_error(tables, exact):
    """Return the largest error of a column, relative to its largest number.

    Errors of angles are absolute. The driving torques `tau` of a simulation are zero,
    because all torques are loads, so that their errors are relative to the generalised
    forces `Q`. The result is at least EPS, the error of rounding the exact numbers to
    float64.

    Parameters
    ----------
    tables, exact
        The columns by name for each table by name, and the same in many digits.
    """
    largest = EPS
    for name, columns in exact.items():
        for column, numbers in columns.items():
            values = np.asarray(tables[name][column], dtype=float)
            scaling_numbers = columns["Q"] if column == "tau" else numbers
            scale = 1 if column == "q" else max(map(abs, scaling_numbers))
            error = largest_difference(values, numbers) / float(scale)
            largest = max(largest, error)
    return largest


SETTINGS = [Setting(integrator="numpy", tolerance=x) for x in (1e-4, 1e-9, 1e-13)]
if available():
    SETTINGS += [Setting(integrator="compiled", tolerance=x) for x in (1e-12, 1e-15)]

trade_eksergian = partial(trade, analysis="eksergian", rounds=1)


def tables_of_simulation(mechanism, analysis, setting, t, start):
    """Return the tables of an analysis of a simulation, like those of an ordinary run.

    A table is a mapping of columns by name; the result has the tables by name.

    Parameters
    ----------
    mechanism, analysis
        The mechanism, and the name of the analysis that computes the tables.
    setting
        The integrator of the simulation and its tolerance.
    t
        (n,) times (s) of the rows.
    start
        The input and its rate at t = 0.
    """
    simulation = simulate(
        mechanism,
        start,
        float(t[-1]),
        tolerance=setting.tolerance,
        engine=setting.integrator,
    )
    # The simulation starts in assembly mode 0 (way to assemble the links). The samples of
    # the position analysis are not used, so two are enough.
    position_analysis = PositionAnalysis(mechanism, assembly_mode=0, samples=2)
    samples = sample_simulation(position_analysis, simulation, t, setting.tolerance)
    # `setting` is for the simulation. The analysis itself has default settings.
    tables, *_ = compute_timed_tables(samples, create_analysis(analysis), Setting())
    return tables


@pytest.mark.slow
def test_errors_that_a_trade_measures_are_right_within_a_factor_two(four_bar_motion):
    """Errors by a trade are at least half and at most twice the errors from 50 digits.

    A trade measures the time and the error of an analysis with several settings, here of
    `eksergian` (terms of the equation of motion). The settings are the engines of
    simulations, with tolerances of 1e-4 to 1e-15. The trade measures errors against a
    simulation in 20 digits; `floor` is the error of that simulation. The test measures them
    against exact tables. `exact_tables` computes them in 50 digits from times, inputs and
    rates with more digits than float64 (`four_bar_motion`).
    """
    t, q, rates = four_bar_motion
    result = trade_eksergian(
        FOUR_BAR, samples=len(t), start=START, duration=0.5, settings=SETTINGS
    )
    assert "20 digits" in result.reference
    assert result.floor < 1e-15
    exact = exact_tables(q, rates)
    for row in result.settings:
        tables = tables_of_simulation(FOUR_BAR, "eksergian", row.setting, t, START)
        error = largest_relative_error(tables, exact)
        assert 0.5 * error <= row.error <= 2.0 * error, (row.name, row.error, error)


def short_trade():
    """Return the trade of one tolerance of NumPy for a pendulum."""
    return trade_eksergian(
        pendulum(Gravity("weight", (0.0, 0.0, -GRAVITY))),
        samples=3,
        start=Start(0.0, 3.5),
        duration=0.05,
        settings=SETTINGS[:1],
    )


def test_a_trade_says_that_its_reference_has_20_digits():
    assert short_trade().reference == "a simulation in 20 digits"


def test_a_trade_without_a_reference_in_20_digits_says_what_it_compares_with(monkeypatch):
    """A trade compares with a simulation by NumPy if there is no reference in 20 digits.

    A trade measures the time and the error of simulations with several settings. Errors
    are differences from a reference. Here the reference in 20 digits (`refined`) and the
    compiled engine fail, so that a simulation by NumPy with the tolerance 1e-13 is the
    reference. Its own error is its difference from a simulation with the tolerance 1e-12.
    The trade cannot measure errors smaller than this one. The result states it as `floor`.
    """

    def fail(*_, **__):
        raise EngineError("there is none")

    def simulate_by_numpy_only(*arguments, engine, **options):
        if engine == "compiled":
            fail()
        return simulate(*arguments, engine="numpy", **options)

    module = "spherekit.runs.simulation_measurement"
    monkeypatch.setattr(f"{module}.refined", fail)
    monkeypatch.setattr(f"{module}.simulate", simulate_by_numpy_only)
    result = short_trade()
    assert result.reference.startswith("simulation numpy tolerance 1e-13, known to")
    assert result.reference.endswith("from numpy tolerance 1e-12 (there is none)")
    assert EPS <= result.floor < 1e-10


@needs_heyoka
def test_a_simulation_whose_end_depends_on_a_tolerance_has_no_reference():
    """The torque 1 / (0.1 - t) is infinite at 0.1 s, where every integration stops."""
    mechanism = pendulum(PairTorque("burst", "12", "1/(0.1 - t)"))
    with pytest.raises(EngineError, match="ended at 0.1 s .* shorter time"):
        reference_simulation(mechanism, Start(0.0, 1.0), 0.2)


@needs_heyoka
def test_a_trade_compares_motion_with_dry_friction_until_it_sticks():
    """The four-bar comes to rest before the end, and has a reference all the same."""
    brake = PairTorque("brake", "21", "-0.6*sign(dtheta_21)")
    result = trade_eksergian(
        replace(FOUR_BAR, loads=(brake,)),
        samples=5,
        start=Start(0.3, 0.5),
        duration=6.0,
        settings=[Setting(integrator="compiled", tolerance=1e-14)],
    )
    assert "20 digits" in result.reference
    assert result.settings[0].error < 1e-12
