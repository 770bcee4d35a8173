"""Mechanisms of the fewest links, among them open chains whose pairs are all driven."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from mechanism_examples.linkages import mechanism_from_chain, random_axes
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.cli.main import main
from spherekit.completeness import Guarantee
from spherekit.dynamics.forward_dynamics import simulate
from spherekit.dynamics.inverse_dynamics import inverse_dynamics
from spherekit.dynamics.reduced_model_maker import reduced_model
from spherekit.errors import PlanError, SolveError
from spherekit.files.study import Start
from spherekit.files.time_law import ConstantSpeed
from spherekit.mechanism.elements import Input, Output
from spherekit.mechanism.inertia import Mass
from spherekit.mechanism.load_kinds import Gravity
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

OPEN = {
    "one link": "1-2",
    "two in series": "1-2 2-3",
    "two side by side": "1-2 1-3",
    "three in series": "1-2 2-3 3-4",
    "a tree": "1-2 2-3 2-4 1-5",
}
INERTIA = ((2.0, 0.1, 0.0), (0.1, 1.5, 0.2), (0.0, 0.2, 1.0))
Q = np.array([-0.9, 0.0, 0.7])


@pytest.fixture(autouse=True)
def no_silent_division():
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


def open_chain(chain):
    edges = chain.split()
    axes = random_axes(np.random.default_rng(len(edges)), len(edges))
    made = mechanism_from_chain(chain, axes)
    inputs = tuple(Input(pair.name, -1.0, 1.0) for pair in made.pairs)
    last = made.links[-1]
    masses = tuple(Mass(link, INERTIA, 1.0, (0.1, 0.2, -0.3)) for link in made.links[1:])
    outputs = (Output("end", last, "1", (0.0, 0.0, 1.0)),)
    made = replace(made, inputs=inputs, masses=masses, outputs=outputs)
    return replace(made, loads=(Gravity("weight", (0.0, 0.0, -9.81)),))


def turned(made, values):
    """Return the rotation of each link by the product of exponentials."""
    found = {"1": Rotation.identity()}
    while len(found) < len(made.links):
        for pair, angle in zip(made.pairs, values, strict=True):
            a, b = pair.links
            if a in found and b not in found:
                axis = np.array(made.geometry.axes[pair.name])
                found[b] = found[a] * Rotation.from_rotvec(angle * axis)
    return found


@pytest.mark.parametrize("chain", OPEN.values(), ids=OPEN)
@pytest.mark.parametrize("route", ["best", "equations", "conditioned"])
def test_poles_of_open_chains(chain, route):
    """It raised ZeroDivisionError with one link; by the equations 1 was divided by 0."""
    made = open_chain(chain)
    q = np.repeat(Q[:, None], len(made.inputs), axis=1) * np.linspace(
        1.0, 0.5, len(made.inputs)
    )
    tracer = PositionAnalysis(made, path=q)
    motion = tracer.motion()
    assert np.all(motion.status == Status.OK)
    assert tracer.claim.guarantee == Guarantee.COMPLETE
    poles = all_poles(len(made.links))
    for driven, pair in enumerate(made.pairs):
        field = evaluate(motion, request(made, pair.name, poles, poles), route=route)
        assert np.all(field.status == Status.OK)
        for row, values in enumerate(q):
            placed = turned(made, values)
            axis = placed[pair.links[0]].apply(made.geometry.axes[pair.name])
            beyond = {pair.links[1]}
            for other in made.pairs[driven + 1 :]:
                if other.links[0] in beyond:
                    beyond.add(other.links[1])
            for number, name in enumerate(made.links):
                want = axis if name in beyond else np.zeros(3)
                assert np.max(np.abs(field.w[number][row] - want)) < 1e-14
                turn = placed[name].as_matrix()
                assert np.max(np.abs(motion.rotations[row, number] - turn)) < 1e-14


@pytest.mark.many
@pytest.mark.parametrize("chain", OPEN.values(), ids=OPEN)
def test_every_analysis_of_an_open_chain_ends(chain, tmp_path, capsys):
    made = open_chain(chain)
    file = tmp_path / "open.toml"
    sk.dump(made, file)
    laws = [
        word
        for item in made.inputs
        for word in ("--law", f"{item.pair}=constant_speed:speed=1")
    ]
    count = len(made.inputs)
    few = ("--samples", "3")
    asked = (
        (0, "validate"),
        (0, "plan"),
        (0, "explain", "-a", "poles"),
        (0, "run", "-a", "poles", *few, "--duration", "1", *laws),
        (count > 3, "run", "-a", "singularities:input_grid=3,slices=2", *few),
        (0, "run", "-a", "singularities:slices=0,seconds=2", *few),
        (count > 1, "run", "-a", "eksergian", *few, "--duration", "1", *laws),
        (0, "export", "--to", "mjcf", "-o", str(tmp_path / "mjcf.xml")),
        (0, "export", "--to", "model", "-o", str(tmp_path / "model.npz")),
        (1, "export", "--to", "coupling", "-o", str(tmp_path / "table.csv")),
    )
    for refused, command, *rest in asked:
        status = main([command, str(file), *rest])
        said = capsys.readouterr().err
        assert "Traceback" not in said
        assert status == refused, (command, rest, said)
        assert not refused or " inputs" in said or "one input" in said


def test_numbers_that_are_rounding_are_not_their_own_scale():
    """All coefficients of a chain are 1, and derivatives of theirs by the inputs zero."""
    found = sk.trade(open_chain(OPEN["three in series"]), "poles", samples=21)
    assert all(setting.error < 1e-14 for setting in found.settings if not setting.reason)


def test_one_link_as_a_pendulum():
    """Inertia, torque and motion of a link about a fixed axis, in closed form."""
    made = open_chain(OPEN["one link"])
    axis = np.array(made.geometry.axes["p1_2"])
    inertia = axis @ np.array(INERTIA) @ axis
    t = np.linspace(0.0, 1.0, 11)
    found = inverse_dynamics(made, ConstantSpeed(1.3, 0.2), t)
    assert np.all(found.status == Status.OK)
    assert np.max(np.abs(found.B - inertia)) < 1e-13
    assert np.max(np.abs(found.dB_dq)) < 1e-13

    def weight(q):
        arm = Rotation.from_rotvec(q * axis).apply((0.1, 0.2, -0.3))
        return axis @ np.cross(arm, (0.0, 0.0, -9.81))

    want = [-weight(0.2 + 1.3 * time) for time in t]
    assert np.max(np.abs(found.tau - want)) < 1e-13
    run = simulate(made, Start(0.2, 0.5), 1.0, engine="numpy")
    history = run.at(t)
    want = [weight(q) / inertia for q in history.q]
    assert np.max(np.abs(history.ddq - want)) < 1e-12
    model = reduced_model(made)
    assert abs(model.inertia(0.4) - inertia) < 1e-12


def test_the_smallest_that_cannot_move():
    axes = random_axes(np.random.default_rng(5), 3)
    for chain in ("1-2 2-3 1-3", "1-2 2-3"):
        with pytest.raises(PlanError, match=r"rigid|mobility"):
            sk.trace(mechanism_from_chain(chain, axes[: len(chain.split())]), samples=3)


def test_inputs_that_can_move_without_any_mass_are_named():
    """Four freedoms of one body: it was said that a load jumps."""
    made = open_chain("1-2 2-3 3-4 4-5")
    light = replace(made, masses=made.masses[-1:])
    with pytest.raises(SolveError, match="can turn together so that no link with mass"):
        simulate(light, Start((0.1, 0.2, 0.3, 0.4), (0.0,) * 4), 1.0, engine="numpy")
