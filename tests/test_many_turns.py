"""Angles many turns from zero: the same configuration, and no digit less."""

from dataclasses import replace

import numpy as np
import pytest

import spherekit as sk
from spherekit.dynamics.configurations_at_inputs import count_whole_turns, wrap_to_pi
from spherekit.dynamics.forward_dynamics import simulate
from spherekit.dynamics.simulation_start import PoseStart
from spherekit.errors import SolveError
from spherekit.files.study import Start
from spherekit.mechanism.elements import Input
from spherekit.symbolic.compiler import available

TURN = 2.0 * np.pi
TIMES_S = np.linspace(0.0, 1.0, 9)
ENGINES = ("numpy", "compiled") if available() else ("numpy",)


@pytest.fixture(scope="module")
def four_bar():
    return sk.load("four_bar")


def restoring_torque(angle):
    """Return a torque expression proportional to the distance from an angle (rad).

    It depends on the whole turns of the input, unlike a function of its sine and cosine.
    """
    return f"-3*(theta_21-{angle!r})"


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("turns", [1, -100, 10_000, 10_000_000])
def test_a_simulation_from_an_input_many_turns_away_runs_alike(four_bar, engine, turns):
    """A simulation that starts many whole turns away has the same motion.

    The start is shifted by some whole turns. The torque, `restoring_torque`, is
    proportional to the distance of the input from an angle. Without a shift of this angle,
    whole turns would change the torque. So the angle is shifted by the same turns. The
    shifted motion may differ from the reference only by rounding of the large angles and by
    the tolerance of integration.
    """
    shift = turns * TURN
    settings = {"engine": engine, "tolerance": 1e-9}
    reference_simulation = simulate(
        four_bar, Start(0.3, 1.0), 1.0, torque=restoring_torque(0.0), **settings
    )
    shifted_simulation = simulate(
        four_bar, Start(0.3 + shift, 1.0), 1.0, torque=restoring_torque(shift), **settings
    )
    reference = reference_simulation.at(TIMES_S)
    shifted = shifted_simulation.at(TIMES_S)
    # Distance of neighbouring floats: 7e-9 rad after ten million turns. Angles may differ
    # by 20 such steps and the tolerance of integration, rates by ten times as much.
    rounding = np.spacing(abs(shift))
    tolerance = 20.0 * rounding + 1e-9
    assert np.max(np.abs(shifted.q - shift - reference.q)) < tolerance
    assert np.max(np.abs(shifted.dq - reference.dq)) < 10.0 * tolerance
    assert np.max(shifted.residual) < 1e-12
    assert shifted_simulation.checks.closure < 1e-12


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("turns", [(1, 1, 1, 1), (10_000, -20_000, 0, 30_000)])
def test_a_simulation_from_a_pose_many_turns_away_runs_alike(four_bar, engine, turns):
    """A simulation is the same if each angle of its start pose is turned by whole turns.

    The start pose has the four pair angles of a four-bar. Each is shifted by its own number
    of turns. The reference is the simulation without shifts.
    """
    start = simulate(four_bar, Start(0.3, 1.0), 0.1, engine="numpy")
    values = start.at([0.0]).values[0]
    shift = TURN * np.array(turns)
    reference_simulation = simulate(
        four_bar, PoseStart(values, "21", 1.0), 1.0, engine=engine
    )
    shifted_simulation = simulate(
        four_bar, PoseStart(values + shift, "21", 1.0), 1.0, engine=engine
    )
    reference = reference_simulation.at(TIMES_S)
    shifted = shifted_simulation.at(TIMES_S)
    assert np.max(np.abs(shifted.values - shift - reference.values)) < 1e-9
    assert np.max(shifted.residual) < 1e-12


def test_a_start_many_turns_away_is_moved_into_the_range_of_the_input():
    """A simulation of an eight-bar may start 50 turns beyond the range of its input.

    Assembly modes of this eight-bar are searched numerically, in the range of the input
    only (here 5.0 to 5.6 rad). So the start at 5.3 rad plus 50 turns must be moved into
    this range. The reference is the simulation without the turns. The input starts with 0.1
    rad/s, and 0.1 s are simulated.
    """
    mechanism = sk.load("eight_bar_01")
    input_range = Input(mechanism.inputs[0].pair, 5.0, 5.6)
    # A simulation needs a mass, and the file has none. That of a four-bar is used.
    mass = replace(sk.load("four_bar").masses[0], link=mechanism.links[1])
    mechanism = replace(mechanism, inputs=(input_range,), masses=(mass,))
    mode = sk.trace(mechanism, samples=3).assembly_modes[0].number
    reference, shifted = (
        simulate(
            mechanism,
            Start(5.3 + shift, 0.1),
            until=0.1,
            assembly_mode=mode,
            engine="numpy",
        )
        for shift in (0.0, 50 * TURN)
    )
    end_difference = shifted.at([0.1]).q - 50 * TURN - reference.at([0.1]).q
    assert np.max(np.abs(end_difference)) < 1e-9


@pytest.mark.parametrize("q", [2e9, -1e15, 1e300])
def test_a_start_angle_too_large_for_its_digits_is_refused(four_bar, q):
    """At 1e15 rad neighbouring floats are 0.1 rad apart, so loops could not be closed."""
    message = r"resolves to .* rad only; the largest angle allowed is 1e\+09"
    with pytest.raises(SolveError, match=message):
        simulate(four_bar, Start(q, 1.0), 0.5)


def test_angles_without_their_whole_turns_are_exact_to_one_rounding():
    """The reference is the angle less 2 pi times the number of turns, in 40 digits."""
    import mpmath as mp

    angles = np.array([3.0, -3.2, 7.0, 1e3, -1e6, 123456789.125])
    reduced_angles = wrap_to_pi(angles)
    turns = count_whole_turns(angles)
    with mp.workdps(40):
        for angle, reduced, count in zip(angles, reduced_angles, turns, strict=True):
            exact = mp.mpf(angle) - 2 * mp.pi * int(count)
            assert abs(exact - mp.mpf(reduced)) < 1e-15
            assert abs(exact) < 3.15
