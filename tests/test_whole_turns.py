"""Turns of passive pairs that loads and stops see: the same by every way to a state."""

from dataclasses import replace

import numpy as np
import pytest

import spherekit as sk
from spherekit.dynamics.forward import simulate
from spherekit.dynamics.inverse import inverse_dynamics
from spherekit.errors import SolveError
from spherekit.model.dynamics import Mass, PairTorque, Stop
from spherekit.model.laws import ConstantSpeed, Start

AWAY = 0.3 + 6.0 * np.pi


@pytest.fixture(scope="module")
def gears():
    """A bevel pair of 20 and 40 teeth, a coil on each shaft."""
    made = sk.load("bevel_pair")
    body = ((0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01))
    return replace(
        made,
        masses=(Mass("1", body), Mass("2", body)),
        loads=(
            PairTorque("one", "01", "-0.3*theta_01"),
            PairTorque("other", "02", "-2*(theta_02-0.5)"),
        ),
    )


@pytest.fixture(scope="module")
def coil():
    made = sk.load("four_bar")
    return replace(made, loads=(PairTorque("coil", "32", "-0.7*theta_32"),))


def torques(mechanism, speed, times, mode=0):
    law = ConstantSpeed(speed, 0.0)
    return inverse_dynamics(mechanism, law, times, assembly_mode=mode).torques[:, 0]


def test_gears_turn_by_their_ratio_however_few_samples(gears):
    """Half as fast as their teeth say, from the angle at zero on."""
    q = 18.0
    zero, beside = sk.trace(gears, path=np.array([[0.0], [0.1]])).values[:, 1]
    ratio = (beside - zero) / 0.1
    assert abs(ratio) == pytest.approx(0.5)
    right = 0.3 * q + ratio * 2.0 * (zero + ratio * q - 0.5)
    for count in (2, 9, 361):
        assert torques(gears, 2.0, np.linspace(0.0, 9.0, count))[-1] == pytest.approx(right)
    assert torques(gears, 2.0, [9.0])[0] == pytest.approx(right)
    ways = {
        "law": {"laws": {"01": ConstantSpeed(2.0, 0.0)}, "duration": 9.0, "samples": 9},
        "start": {"start": Start(q, 2.0), "duration": 0.1, "samples": 9, "torque": right},
    }
    for name, way in ways.items():
        rows = sk.run(gears, "dynamics", **way).results["dynamics"].data["dynamics"]
        row = -1 if name == "law" else 0
        assert rows["q"][row] == pytest.approx(q)
        assert -rows["Q"][row] == pytest.approx(right)


@pytest.mark.parametrize("mode", [0, 1])
def test_a_state_has_one_torque_by_every_way(coil, mode):
    """Rate 1 at q = 0.3 + 6 pi: stored function, laws with any times, a simulation."""
    stored = sk.online_model(coil, assembly_mode=mode, poles=[])
    right = stored.torque(AWAY, 1.0, 0.0)
    whole = stored.value("theta_32", AWAY)
    assert abs(whole) > 4.0 * np.pi
    for times in ([AWAY], np.linspace(0.0, AWAY, 7), np.linspace(0.0, AWAY, 500)):
        assert torques(coil, 1.0, times, mode)[-1] == pytest.approx(right, abs=1e-9)
    found = simulate(coil, Start(AWAY, 1.0), 0.01, assembly_mode=mode, engine="numpy")
    assert found.at([0.0]).values[0, 1] == pytest.approx(whole, abs=1e-9)


def test_three_samples_a_turn_say_what_many_do(coil):
    few, many = (
        sk.run(coil, "dynamics", samples=count).results["dynamics"].data["dynamics"]
        for count in (3, 361)
    )
    assert np.allclose(few["tau"], many["tau"].reshape(-1, 361)[:, ::180].ravel())


def test_stops_of_passive_pairs_count_turns(coil):
    """The same end from q = 0 and from q = 5; a start beyond it is refused."""
    whole = sk.online_model(coil, poles=[]).value
    limit = whole("theta_32", 5.5)
    side = np.sign(limit - whole("theta_32", 0.0))
    low, high = sorted([limit, limit - side * 30.0])
    stopped = replace(coil, loads=(), stops=(Stop("32", low, high),))
    for q in (0.0, 5.0):
        found = simulate(stopped, Start(q, 3.0), 20.0, engine="numpy")
        assert found.end.kind == "stop"
        assert found.at([found.end.t]).q[0] == pytest.approx(5.5, abs=1e-6)
    with pytest.raises(SolveError, match="outside its stops"):
        simulate(stopped, Start(5.0 + 2.0 * np.pi, 3.0), 1.0, engine="numpy")
