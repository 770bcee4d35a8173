"""Turns of passive pairs that loads and joint limits see, by every way to a state."""

from dataclasses import replace

import numpy as np
import pytest

import spherekit as sk
from spherekit.designs.design_variables import default_size_keys, design_variable
from spherekit.dynamics.forward_dynamics import simulate
from spherekit.dynamics.inverse_dynamics import inverse_dynamics
from spherekit.errors import SolveError
from spherekit.exchange.coupling_table_maker import coupling_table
from spherekit.exchange.exported_pose import find_pose
from spherekit.files.number_change import document_of
from spherekit.files.study import Start
from spherekit.files.time_law import ConstantSpeed
from spherekit.mechanism.inertia import Mass
from spherekit.mechanism.load_kinds import JointLimit, PairTorque
from spherekit.positions.position_analysis import PositionAnalysis

AWAY = 0.3 + 6.0 * np.pi


def loaded(name, pair):
    """A shipped mechanism with a coil on a passive pair alone."""
    made = sk.load(name)
    if not made.masses:
        body = ((0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01))
        moving = [link for link in made.links if link != made.ground]
        made = replace(made, masses=tuple(Mass(link, body) for link in moving))
    return replace(made, loads=(PairTorque("coil", pair, f"-0.7*theta_{pair}"),))


def whole_at(mechanism, pair, q, mode):
    """The angle of a pair that moves by less than half a turn from sample to sample."""
    path = np.linspace(0.0, q, 1 + 120 * int(np.ceil(abs(q))))[:, None]
    tracer = PositionAnalysis(mechanism, path=path, assembly_mode=mode)
    angles = tracer.motion().values[:, mechanism.angles[pair]]
    return np.unwrap(angles)[-1]


def generalised_forces(mechanism, q, mode):
    """The generalised force at an input at rest, by all that states one, by name."""
    (inp,) = (item.pair for item in mechanism.inputs)
    where = {"path": np.array([[q]]), "assembly_mode": mode}
    for count in (2, 3, 40):
        law = {"laws": {inp: ConstantSpeed(q, 0.0)}, "duration": 1.0, "samples": count}
        run = sk.run(mechanism, "dynamics", assembly_mode=mode, **law)
        yield f"law {count}", run.frame()["Q"].iloc[-1]
    yield "path", sk.run(mechanism, "dynamics", **where).frame()["Q"][0]
    yield "eksergian", sk.run(mechanism, "eksergian", **where).frame()["Q"][0]
    yield "statics", -sk.run(mechanism, "statics", **where).frame()["tau"][0]
    start = {"start": {"q": q}, "duration": 0.001, "samples": 2, "engine": "numpy"}
    run = sk.run(mechanism, "dynamics", assembly_mode=mode, **start)
    yield "simulation", run.frame()["Q"][0]
    for times in ([1.0], np.linspace(0.0, 1.0, 7)):
        law = sk.Cycloidal(0.0, q, 1.0)
        rest = inverse_dynamics(mechanism, law, times, assembly_mode=mode)
        yield "inverse dynamics", -rest.torques[-1, 0]
    stored = sk.reduced_model(mechanism, assembly_mode=mode, poles=[])
    yield "stored", -stored.torque(q, 0.0, 0.0)
    key, document = next(iter(default_size_keys(mechanism))), document_of(mechanism)
    figure = f"there=at(torque - 0.5*dB_dq, {float(np.degrees(q))!r})"
    varied = {key: [design_variable(document, key).value]}
    swept = sk.sweep(mechanism, varied, [figure], samples=4)
    every = -swept.frame()["there"].dropna().to_numpy()
    yield "sweep", every[np.argmin(np.abs(every + stored.torque(q, 0.0, 0.0)))]


CASES = [
    ("bevel_pair", "02", 18.0, 0),
    ("four_bar", "32", AWAY, 0),
    ("four_bar", "32", AWAY, 1),
    ("four_bar", "32", -17.0, 0),
    pytest.param("roller_cam", "follower_pivot", AWAY, 0, marks=pytest.mark.slow),
    pytest.param("double_butterfly", "C", AWAY, 0, marks=pytest.mark.slow),
]


@pytest.mark.many
@pytest.mark.parametrize("name, pair, q, mode", CASES)
def test_a_state_has_one_force_by_every_way(name, pair, q, mode):
    """Q of a coil alone: -0.7 theta by the pair's coefficient, by differences."""
    mechanism = loaded(name, pair)
    whole = whole_at(mechanism, pair, q, mode)
    h = 1e-5
    beside = [whole_at(mechanism, pair, x, mode) for x in (q - h, q + h)]
    right = -0.7 * whole * (beside[1] - beside[0]) / (2.0 * h)
    for way, found in generalised_forces(mechanism, q, mode):
        assert found == pytest.approx(right, rel=1e-7), way
    values = find_pose(mechanism, mode, q)[1]
    assert values[mechanism.angles[pair]] == pytest.approx(whole, abs=1e-9)


def test_tables_for_controllers_count_turns():
    """A coupling table over the third turn has the angle that runs have there."""
    mechanism = loaded("four_bar", "32")
    (driven,) = mechanism.inputs
    away = replace(driven, start=4.0 * np.pi, stop=6.0 * np.pi)
    table = coupling_table(replace(mechanism, inputs=(away,)), assembly_mode=0)
    found = table.at(5.3 * np.pi, 0).angles[0, table.variables.index("theta_32")]
    assert found == pytest.approx(whole_at(mechanism, "32", 5.3 * np.pi, 0), abs=1e-5)


def test_stops_of_passive_pairs_count_turns():
    """The same end from q = 0 and from q = 5; a start beyond it is refused."""
    coil = loaded("four_bar", "32")
    whole = sk.reduced_model(coil, poles=[]).value
    limit = whole("theta_32", 5.5)
    side = np.sign(limit - whole("theta_32", 0.0))
    low, high = sorted([limit, limit - side * 30.0])
    stopped = replace(coil, loads=(), joint_limits=(JointLimit("32", low, high),))
    for q in (0.0, 5.0):
        found = simulate(stopped, Start(q, 3.0), 20.0, engine="numpy")
        assert found.end.kind == "joint_limit"
        assert found.at([found.end.t]).q[0] == pytest.approx(5.5, abs=1e-6)
    with pytest.raises(SolveError, match="outside its joint limits"):
        simulate(stopped, Start(5.0 + 2.0 * np.pi, 3.0), 1.0, engine="numpy")
