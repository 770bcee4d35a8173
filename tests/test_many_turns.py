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
TIMES = np.linspace(0.0, 1.0, 9)
ENGINES = ("numpy", "compiled") if available() else ("numpy",)


@pytest.fixture(scope="module")
def four_bar():
    return sk.load("four_bar")


def pulled_to(angle):
    """Return a torque that grows with the way from an angle, so that turns count."""
    return f"-3*(theta_21-{angle!r})"


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("turns", [1, -100, 10_000, 10_000_000])
def test_a_start_many_turns_away_goes_the_same_way(four_bar, engine, turns):
    """Loads see the whole angle; nothing else changes but the last digits of that angle."""
    away = turns * TURN
    way = {"engine": engine, "tolerance": 1e-9}
    here, there = (
        simulate(four_bar, Start(0.3 + shift, 1.0), 1.0, torque=pulled_to(shift), **way)
        for shift in (0.0, away)
    )
    one, other = here.at(TIMES), there.at(TIMES)
    digits = 20.0 * np.spacing(abs(away)) + 1e-9
    assert np.max(np.abs(other.q - away - one.q)) < digits
    assert np.max(np.abs(other.dq - one.dq)) < 10.0 * digits
    assert np.max(other.residual) < 1e-12
    assert there.checks.closure < 1e-12


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("turns", [(1, 1, 1, 1), (10_000, -20_000, 0, 30_000)])
def test_a_pose_many_turns_away(four_bar, engine, turns):
    """It was refused: 0 rad from one that closes, by a residual of 2e-12 rad."""
    values = simulate(four_bar, Start(0.3, 1.0), 0.1, engine="numpy").at([0.0]).values[0]
    away = TURN * np.array(turns)
    here, there = (
        simulate(four_bar, PoseStart(values + shift, "21", 1.0), 1.0, engine=engine)
        for shift in (np.zeros(4), away)
    )
    one, other = here.at(TIMES), there.at(TIMES)
    assert np.max(np.abs(other.values - away - one.values)) < 1e-9
    assert np.max(other.residual) < 1e-12


def test_a_start_is_moved_into_a_range_of_less_than_a_turn():
    """The modes of an irreducible group are known within the range only."""
    made = sk.load("eight_bar_01")
    made = replace(made, inputs=(Input(made.inputs[0].pair, 5.0, 5.6),))
    masses = sk.load("four_bar").masses[0]
    made = replace(made, masses=(replace(masses, link=made.links[1]),))
    number = sk.trace(made, samples=3).assembly_modes[0].number
    first, again = (
        simulate(made, Start(5.3 + shift, 0.1), 0.1, assembly_mode=number, engine="numpy")
        for shift in (0.0, 50 * TURN)
    )
    assert np.max(np.abs(again.at([0.1]).q - 50 * TURN - first.at([0.1]).q)) < 1e-9


@pytest.mark.parametrize("q", [2e9, -1e15, 1e300])
def test_angles_without_digits_are_refused(four_bar, q):
    """A run from there had loops open by up to 2.5 rad, and said nothing."""
    with pytest.raises(SolveError, match=r"holds to .* rad only; allowed is up to 1e\+09"):
        simulate(four_bar, Start(q, 1.0), 0.5)


def test_reduced_angles_keep_every_digit():
    """Against 40 digits of pi: an angle less its turns, rounded once."""
    import mpmath as mp

    given = np.array([3.0, -3.2, 7.0, 1e3, -1e6, 123456789.125])
    with mp.workdps(40):
        for angle, least, count in zip(
            given, wrap_to_pi(given), count_whole_turns(given), strict=True
        ):
            exact = mp.mpf(angle) - 2 * mp.pi * int(count)
            assert abs(exact - mp.mpf(least)) < 1e-15 and abs(exact) < 3.15
