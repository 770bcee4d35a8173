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

OPEN_CHAINS = {
    "one link": "1-2",
    "two in series": "1-2 2-3",
    "two side by side": "1-2 1-3",
    "three in series": "1-2 2-3 3-4",
    "a tree": "1-2 2-3 2-4 1-5",
}
"""Chains without a loop, by the links that each pair joins."""
INERTIA = ((2.0, 0.1, 0.0), (0.1, 1.5, 0.2), (0.0, 0.2, 1.0))
FIRST_PAIR_ANGLES = np.array([-0.9, 0.0, 0.7])
"""Angles (rad) of the first pair in three samples; later pairs turn less."""


@pytest.fixture(autouse=True)
def no_silent_division():
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


def open_chain(chain):
    """Return an open chain with random axes, masses and a weight, all pairs driven.

    An open chain has no loop. `chain` has the two links of each pair, such as "1-2 2-3".
    Each moving link has a mass of 1 kg. The output is a direction of the last link, seen
    from link "1", the ground.
    """
    edges = chain.split()
    axes = random_axes(np.random.default_rng(len(edges)), len(edges))
    mechanism = mechanism_from_chain(chain, axes)
    masses = []
    for link in mechanism.links[1:]:
        masses.append(Mass(link, INERTIA, mass=1.0, centre=(0.1, 0.2, -0.3)))
    return replace(
        mechanism,
        inputs=tuple(Input(pair.name, -1.0, 1.0) for pair in mechanism.pairs),
        masses=tuple(masses),
        outputs=(
            Output(
                "end",
                link=mechanism.links[-1],
                relative_to="1",
                direction=(0.0, 0.0, 1.0),
            ),
        ),
        loads=(Gravity("weight", (0.0, 0.0, -9.81)),),
    )


def link_rotations(mechanism, angles):
    """Return the rotation of each link at pair angles (rad), as a product of exponentials.

    A link is turned like the link before it, times the rotation about the pair's axis in
    the reference pose.
    """
    rotations = {"1": Rotation.identity()}
    while len(rotations) < len(mechanism.links):
        for pair, angle in zip(mechanism.pairs, angles, strict=True):
            first, second = pair.links
            if first in rotations and second not in rotations:
                axis = np.array(mechanism.geometry.axes[pair.name])
                rotations[second] = rotations[first] * Rotation.from_rotvec(angle * axis)
    return rotations


def links_beyond(mechanism, pair_number):
    """Return the links that a pair of an open chain moves."""
    beyond = {mechanism.pairs[pair_number].links[1]}
    for pair in mechanism.pairs[pair_number + 1 :]:
        if pair.links[0] in beyond:
            beyond.add(pair.links[1])
    return beyond


@pytest.mark.parametrize("chain", OPEN_CHAINS.values(), ids=OPEN_CHAINS)
@pytest.mark.parametrize("route", ["best", "equations", "conditioned"])
def test_rotations_and_rates_of_open_chains_are_those_by_exponentials(chain, route):
    """Rotations and rates of links in open chains are those by matrix exponentials.

    The rotation of a link is a product of rotations about pair axes, which are matrix
    exponentials. While one pair moves, the links beyond it turn about its axis and the
    others rest. A route is a way to compute angular velocities. "equations" solves the
    velocity equations of all links, and "best" does so in more digits where needed.
    "conditioned" finds each pole (axis of relative rotation) as the intersection of two
    great circles, those that amplify rounding least. An open chain has one assembly mode
    (way to assemble the links), so the set of modes is complete.
    """
    mechanism = open_chain(chain)
    input_count = len(mechanism.inputs)
    # (samples, pairs) pair angles, rad. The last of several pairs turns by half as much as
    # the first one.
    part_of_pair = np.linspace(1.0, 0.5, input_count)
    path = FIRST_PAIR_ANGLES[:, None] * part_of_pair
    position_analysis = PositionAnalysis(mechanism, path=path)
    motion = position_analysis.motion()
    assert np.all(motion.status == Status.OK)
    assert position_analysis.claim.guarantee == Guarantee.COMPLETE
    poles = all_poles(len(mechanism.links))
    for pair_number, pair in enumerate(mechanism.pairs):
        pole_request = request(mechanism, pair.name, poles, rates=poles)
        field = evaluate(motion, pole_request, route=route)
        assert np.all(field.status == Status.OK)
        moved_links = links_beyond(mechanism, pair_number)
        for row, angles in enumerate(path):
            rotations = link_rotations(mechanism, angles)
            reference_axis = mechanism.geometry.axes[pair.name]
            axis = rotations[pair.links[0]].apply(reference_axis)
            for number, link in enumerate(mechanism.links):
                # The pair moves at unit rate.
                angular_velocity = axis if link in moved_links else np.zeros(3)
                assert np.max(np.abs(field.w[number][row] - angular_velocity)) < 1e-14
                rotation = rotations[link].as_matrix()
                difference = motion.rotations[row, number] - rotation
                assert np.max(np.abs(difference)) < 1e-14


@pytest.mark.many
@pytest.mark.parametrize("chain", OPEN_CHAINS.values(), ids=OPEN_CHAINS)
def test_every_command_handles_an_open_chain_or_refuses_its_inputs(chain, tmp_path, capsys):
    """No command ends with a traceback on an open chain; some refuse its number of inputs.

    All pairs of an open chain are inputs, one to four. The reasons to refuse are:

    - Eksergian's equation is for one input.
    - An orientation has three freedoms. So four inputs can always move while the output
      rests, and singularities do not divide a grid of inputs (`input_grid`).
    - A table for a coupling has the variables of pairs that are not driven, and there are
      none.
    """
    mechanism = open_chain(chain)
    file = tmp_path / "open.toml"
    sk.dump(mechanism, file)
    laws = []
    for item in mechanism.inputs:
        laws += ["--law", f"{item.pair}=constant_speed:speed=1rad/s"]
    input_count = len(mechanism.inputs)
    few_samples = ("--samples", "3")
    over_time = (*few_samples, "--duration", "1", *laws)
    # Whether the command is refused, and its words.
    cases = (
        (0, "validate"),
        (0, "plan"),
        (0, "explain", "-a", "poles"),
        (0, "run", "-a", "poles", *over_time),
        (
            input_count > 3,
            *("run", "-a", "singularities:input_grid=3,slices=2", *few_samples),
        ),
        (0, "run", "-a", "singularities:slices=0,seconds=2", *few_samples),
        (input_count > 1, "run", "-a", "eksergian", *over_time),
        (0, "export", "--to", "mjcf", "-o", str(tmp_path / "mjcf.xml")),
        (0, "export", "--to", "model", "-o", str(tmp_path / "model.npz")),
        (1, "export", "--to", "coupling", "-o", str(tmp_path / "table.csv")),
    )
    for is_refused, command, *arguments in cases:
        status = main([command, str(file), *arguments])
        error_text = capsys.readouterr().err
        assert "Traceback" not in error_text
        assert status == is_refused, (command, arguments, error_text)
        if is_refused:
            assert " inputs" in error_text or "one input" in error_text


def test_errors_of_derivatives_that_are_zero_are_not_judged_by_their_own_size():
    """All coefficients of a chain are 1, so their derivatives are zero up to rounding."""
    trade = sk.trade(open_chain(OPEN_CHAINS["three in series"]), "poles", samples=21)
    assert all(item.error < 1e-14 for item in trade.settings if not item.reason)


def test_one_link_is_a_pendulum():
    """Inertia, torque and acceleration of a link about a fixed axis have closed forms.

    The inertia is a . I a about the axis a. The torque of the weight is a . (c x g), with
    the centre of mass c turned by the angle q and the mass of 1 kg. The driving torque at
    constant speed balances the weight.
    """
    mechanism = open_chain(OPEN_CHAINS["one link"])
    axis = np.array(mechanism.geometry.axes["p1_2"])
    inertia = axis @ np.array(INERTIA) @ axis

    def torque_of_weight(q):
        centre = Rotation.from_rotvec(q * axis).apply((0.1, 0.2, -0.3))
        return axis @ np.cross(centre, (0.0, 0.0, -9.81))

    t = np.linspace(0.0, 1.0, 11)
    driven = inverse_dynamics(mechanism, ConstantSpeed(1.3, 0.2), t)
    assert np.all(driven.status == Status.OK)
    assert np.max(np.abs(driven.B - inertia)) < 1e-13
    assert np.max(np.abs(driven.dB_dq)) < 1e-13
    holding_torques = [-torque_of_weight(0.2 + 1.3 * time) for time in t]
    assert np.max(np.abs(driven.tau - holding_torques)) < 1e-13

    free = simulate(mechanism, Start(0.2, 0.5), 1.0, engine="numpy").at(t)
    accelerations = [torque_of_weight(q) / inertia for q in free.q]
    assert np.max(np.abs(free.ddq - accelerations)) < 1e-12
    assert abs(reduced_model(mechanism).inertia(0.4) - inertia) < 1e-12


def test_the_smallest_that_cannot_move():
    axes = random_axes(np.random.default_rng(5), 3)
    for chain in ("1-2 2-3 1-3", "1-2 2-3"):
        with pytest.raises(PlanError, match=r"rigid|mobility"):
            sk.trace(mechanism_from_chain(chain, axes[: len(chain.split())]), samples=3)


def test_inputs_that_can_move_without_any_mass_are_named():
    """Four freedoms of one body: it was said that a load jumps."""
    made = open_chain("1-2 2-3 3-4 4-5")
    light = replace(made, masses=made.masses[-1:])
    with pytest.raises(SolveError, match="can turn together without moving any link"):
        simulate(light, Start((0.1, 0.2, 0.3, 0.4), (0.0,) * 4), 1.0, engine="numpy")
