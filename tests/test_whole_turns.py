"""Loads and joint limits on passive pairs see whole turns: 370 degrees is not 10 degrees.

A test load, a "coil", is a linear spring whose torque grows with every turn of its pair.
"""

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

THREE_TURNS_ON_RAD = 0.3 + 6.0 * np.pi
"""An input angle of 0.3 rad after three whole turns."""


def mechanism_with_coil(name, pair):
    """Return a shipped mechanism whose only load is a coil on a passive pair.

    The torque of the coil is -0.7 N m/rad times the angle of the pair. Each moving link
    gets a moment of inertia if the mechanism has no masses.
    """
    mechanism = sk.load(name)
    if not mechanism.masses:
        inertia = ((0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01))
        moving_links = [link for link in mechanism.links if link != mechanism.ground]
        masses = tuple(Mass(link, inertia) for link in moving_links)
        mechanism = replace(mechanism, masses=masses)
    return replace(mechanism, loads=(PairTorque("coil", pair, f"-0.7*theta_{pair}"),))


def unwrapped_angle(mechanism, pair, q, mode):
    """Return the angle (rad) of a pair at an input q (rad), whole turns included.

    The angle is followed from q = 0 with 120 samples per radian of input, so that it
    changes by less than half a turn from sample to sample.
    """
    sample_count = 1 + 120 * int(np.ceil(abs(q)))
    path = np.linspace(0.0, q, sample_count)[:, None]
    position_analysis = PositionAnalysis(mechanism, path=path, assembly_mode=mode)
    angles = position_analysis.motion().values[:, mechanism.angles[pair]]
    return np.unwrap(angles)[-1]


def generalised_forces(mechanism, q, mode):
    """Yield the generalised force (N m) at an input q (rad) by each route of spherekit.

    A route is a way to obtain this force: an analysis, a simulation, a stored model, ...
    The only load is a spring. Its force does not depend on the speed of the input.

    Yields
    ------
    route, force
        Name of the route and the force. Routes that return the torque that balances the
        load contribute it with the opposite sign.
    """
    (input_pair,) = (item.pair for item in mechanism.inputs)
    # The input moves from 0 to q in one second. With 2 or 3 samples the pairs turn by more
    # than half a turn from sample to sample. Turns must be counted all the same.
    for sample_count in (2, 3, 40):
        result = sk.run(
            mechanism,
            "dynamics",
            assembly_mode=mode,
            laws={input_pair: ConstantSpeed(speed=q, start=0.0)},
            duration=1.0,
            samples=sample_count,
        )
        yield f"law, {sample_count} samples", result.frame()["Q"].iloc[-1]

    at_q = {"path": np.array([[q]]), "assembly_mode": mode}
    yield "dynamics on a path", sk.run(mechanism, "dynamics", **at_q).frame()["Q"][0]
    yield "eksergian", sk.run(mechanism, "eksergian", **at_q).frame()["Q"][0]
    yield "statics", -sk.run(mechanism, "statics", **at_q).frame()["tau"][0]

    result = sk.run(
        mechanism,
        "dynamics",
        assembly_mode=mode,
        start={"q": q},
        duration=0.001,
        samples=2,
        engine="numpy",
    )
    yield "start of a simulation", result.frame()["Q"][0]

    for times in ([1.0], np.linspace(0.0, 1.0, 7)):
        law = sk.Cycloidal(0.0, q, 1.0)
        at_rest = inverse_dynamics(mechanism, law, times, assembly_mode=mode)
        yield "inverse dynamics", -at_rest.torques[-1, 0]

    stored_model = sk.reduced_model(mechanism, assembly_mode=mode, poles=[])
    stored_torque = stored_model.torque(q, 0.0, 0.0)
    yield "stored model", -stored_torque

    # A sweep varies a size. Here the size has only its nominal value, so the only design is
    # the mechanism as it is. The input moves at 1 rad/s, and the inertia B changes with it:
    # the driving torque is dB/dq / 2 - Q with the generalised force Q. The figure, the
    # torque without the first term, is -Q. There is a row for each assembly mode. The one
    # nearest to the stored model is compared.
    key = next(iter(default_size_keys(mechanism)))
    nominal_size = design_variable(document_of(mechanism), key).value
    figure = f"force=at(torque - 0.5*dB_dq, {float(np.degrees(q))!r})"
    sweep = sk.sweep(mechanism, {key: [nominal_size]}, [figure], samples=4)
    forces = -sweep.frame()["force"].dropna().to_numpy()
    stored_force = -stored_torque
    yield "sweep", forces[np.argmin(np.abs(forces - stored_force))]


CASES = [
    ("bevel_pair", "02", 18.0, 0),
    ("four_bar", "32", THREE_TURNS_ON_RAD, 0),
    ("four_bar", "32", THREE_TURNS_ON_RAD, 1),
    ("four_bar", "32", -17.0, 0),
    pytest.param(
        "roller_cam", "follower_pivot", THREE_TURNS_ON_RAD, 0, marks=pytest.mark.slow
    ),
    pytest.param("double_butterfly", "C", THREE_TURNS_ON_RAD, 0, marks=pytest.mark.slow),
]
"""Mechanism, passive pair with the coil, input angle (rad) and assembly mode."""


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("name, pair, q, mode", CASES)
def test_every_route_gives_the_same_force_after_whole_turns(name, pair, q, mode):
    """The generalised force of a spring counts whole turns, by every route of spherekit.

    The load is a linear spring (-0.7 N m/rad) on a passive pair with the angle theta. The
    expected force is -0.7 theta dtheta/dq. theta is followed from q = 0 in small steps
    (`unwrapped_angle`), and its derivative is a central difference. A route of
    `generalised_forces` is an analysis, a simulation, a stored model, ...
    """
    mechanism = mechanism_with_coil(name, pair)
    theta = unwrapped_angle(mechanism, pair, q, mode)
    step_rad = 1e-5
    theta_before = unwrapped_angle(mechanism, pair, q - step_rad, mode)
    theta_after = unwrapped_angle(mechanism, pair, q + step_rad, mode)
    dtheta_dq = (theta_after - theta_before) / (2.0 * step_rad)
    expected = -0.7 * theta * dtheta_dq
    for route, force in generalised_forces(mechanism, q, mode):
        assert force == pytest.approx(expected, rel=1e-7), route
    # The pose that is exported to other programs has the same angle.
    _, values = find_pose(mechanism, mode, q)
    assert values[mechanism.angles[pair]] == pytest.approx(theta, abs=1e-9)


def test_a_coupling_table_over_the_third_turn_counts_turns():
    """The table from 4 pi to 6 pi has the angle that is followed there from q = 0."""
    mechanism = mechanism_with_coil("four_bar", "32")
    (crank_input,) = mechanism.inputs
    third_turn = replace(crank_input, start=4.0 * np.pi, stop=6.0 * np.pi)
    table = coupling_table(replace(mechanism, inputs=(third_turn,)), assembly_mode=0)
    column = table.variables.index("theta_32")
    angle = table.at(5.3 * np.pi, 0).angles[0, column]
    expected = unwrapped_angle(mechanism, "32", 5.3 * np.pi, 0)
    assert angle == pytest.approx(expected, abs=1e-5)


def test_joint_limits_of_passive_pairs_count_turns():
    """A joint limit of a passive pair counts whole turns of the pair.

    The limit is the angle of the pair 32 at the input q = 5.5 rad, with its whole turns. A
    simulation must end there, from q = 0 and from q = 5. A start one turn later is beyond
    the limit and is refused.
    """
    # A mechanism with masses. Its only load, a spring, is removed below.
    mechanism = mechanism_with_coil("four_bar", "32")
    angle_at = sk.reduced_model(mechanism, poles=[]).value
    limit = angle_at("theta_32", 5.5)
    direction = np.sign(limit - angle_at("theta_32", 0.0))
    # 30 rad: so far behind the start that only `limit` can be reached.
    low, high = sorted([limit, limit - direction * 30.0])
    limited = replace(mechanism, loads=(), joint_limits=(JointLimit("32", low, high),))
    for q in (0.0, 5.0):
        simulation = simulate(limited, Start(q, 3.0), 20.0, engine="numpy")
        assert simulation.end.kind == "joint_limit"
        assert simulation.at([simulation.end.t]).q[0] == pytest.approx(5.5, abs=1e-6)
    with pytest.raises(SolveError, match="outside its joint limits"):
        simulate(limited, Start(5.0 + 2.0 * np.pi, 3.0), 1.0, engine="numpy")
