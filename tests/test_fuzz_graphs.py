"""Random mechanisms: the laws of plans and poles, and modes that do not jump."""

import json
import warnings
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from mechanism_examples.random_mechanisms import random_mechanism, reordered, turned
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.errors import PlanError, SpherekitError
from spherekit.mechanism.elements import Input
from spherekit.planning.plan_text import as_dict, as_text
from spherekit.planning.pole_plan import BlockPoles, LinePole, PrimaryPole, all_poles
from spherekit.planning.pole_planner import plans
from spherekit.positions.loop_closure import Closure
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

FRAME_ROTATION = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
"""Rotation of the whole mechanism, which must turn all results alike."""


def evaluate_fields(mechanism, samples=3):
    """Return the motion of assembly mode 0 and {input pair: velocity field} at its samples.

    Tests compare the fields of two descriptions of one mechanism, and check that the motion
    stays in one mode. An assembly mode is one way to assemble the links. A field has the
    poles (axes of relative rotation), their velocity coefficients (rates per rate of the
    input) and the angular velocities of all links, while one input moves and the others are
    locked.
    """
    with warnings.catch_warnings():
        # A warning of NumPy (division by zero, invalid value) fails the test.
        warnings.simplefilter("error", RuntimeWarning)
        # Without `search`, the only assembly mode is that of the reference pose.
        position_analysis = PositionAnalysis(
            mechanism, search=False, samples=samples, assembly_mode=0
        )
        motion = position_analysis.motion()
        poles = all_poles(len(mechanism.links))
        fields = {}
        for input_pair in position_analysis.inputs:
            # `by_rank` is true if the mobility follows from the rank of the velocity
            # equations. The analysis uses the rank if counting links and pairs fails.
            pole_request = request(
                position_analysis.mechanism,
                input_pair,
                poles=poles,
                rates=poles,
                by_rank=position_analysis.by_rank,
            )
            fields[input_pair] = evaluate(motion, pole_request)
    return motion, fields


def check_plan(plan):
    """Assert that a plan determines every pole once, only from poles of earlier steps.

    A pole is the axis about which one body rotates relative to another. A step is one of
    three:

    - the axis of a pair (`PrimaryPole`),
    - an intersection of great circles through other poles, its sources (`LinePole`),
    - or all poles of a part that great circles do not resolve (`BlockPoles`).

    The dictionary of the plan must also survive JSON unchanged, with one entry for each
    step.
    """
    determined = set()
    for step in plan.steps:
        assert isinstance(step, PrimaryPole | LinePole | BlockPoles)
        if isinstance(step, LinePole):
            assert set(step.sources) <= determined
        poles = step.poles if isinstance(step, BlockPoles) else (step.pole,)
        assert not determined & set(poles)
        determined |= set(poles)
    assert determined >= {tuple(sorted(pair)) for pair in combinations(plan.bodies, 2)}
    as_json = as_dict(plan)
    assert json.loads(json.dumps(as_json, allow_nan=False)) == as_json
    assert len(as_json["steps"]) == len(plan.steps)
    assert as_text(plan)


def check_invariance(mechanism, link_order):
    """Assert that names, orders and the frame of a file do not change its motion.

    The second mechanism has other link names, the links in `link_order`, exchanged ends of
    some pairs, and all axes rotated by `FRAME_ROTATION`. Pairs keep their names. Its
    angular velocities must be those of the first, rotated in the same way. If the first
    mechanism is refused, the second must be refused too. `evaluate_fields` returns a field
    for each moving input.
    """
    second, new_names = reordered(turned(mechanism, FRAME_ROTATION), link_order)
    try:
        _, first_fields = evaluate_fields(mechanism)
    except SpherekitError as refusal:
        with pytest.raises(type(refusal)):
            evaluate_fields(second)
        return
    _, second_fields = evaluate_fields(second)
    second_number = {
        mechanism.link_number[old]: second.link_number[new]
        for old, new in new_names.items()
    }
    # A row is a sample. Statuses may differ only where rounding decides whether it is OK.
    undecided = {
        Status.OK,
        Status.AT_SINGULARITY,
        Status.OUT_OF_REACH,
        Status.NOT_CONVERGED,
        Status.MODE_LOST,
        Status.NOT_CLOSED,
    }
    # The fields have the angular velocities w by number of the link, one field for each
    # input pair (by name) that moves.
    for input_pair, first_field in first_fields.items():
        second_field = second_fields[input_pair]
        is_ok = (first_field.status == Status.OK) & (second_field.status == Status.OK)
        for link, w in first_field.w.items():
            expected = w[is_ok] @ FRAME_ROTATION.T
            error = second_field.w[second_number[link]][is_ok] - expected
            scale = np.maximum(1.0, np.max(np.abs(expected), axis=1, initial=0.0))
            largest = np.max(np.abs(error), axis=1, initial=0.0)
            # Some random mechanisms are nearly singular, which enlarges rounding errors.
            assert np.max(largest / scale, initial=0.0) < 1e-7
        if np.any(first_field.status != second_field.status):
            for status in (first_field.status, second_field.status):
                assert {Status(code) for code in status} <= undecided


def sign_of_locked_determinant(motion, row):
    """Return the sign of the determinant of the closure equations with inputs locked.

    A continuous motion keeps this sign until a singularity, so a change shows a jump to
    another assembly mode. The sign is 1.0 if the equations are not square.
    """
    mechanism = motion.mechanism
    inputs = [mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]
    passive = [v for v in range(motion.values.shape[1]) if v not in inputs]
    closure = Closure.of_mechanism(mechanism, motion.joints)
    jacobian = closure.linearise(motion.values[row : row + 1]).jacobian[0][:, passive]
    if jacobian.shape[0] != jacobian.shape[1] or not jacobian.size:
        return 1.0
    return np.sign(np.linalg.det(jacobian))


def follow_to_next_sample(motion, row, steps=40):
    """Return the variables at the next sample, reached by small steps from a row (sample).

    This is an independent continuation: Euler steps of the closure equations with Newton
    corrections at fixed inputs, without spherekit's tracing. The result is None if the
    Jacobian of the passive variables is badly conditioned on the way, or if the variables
    change too fast for these steps. Passive variables are all except the inputs.
    """
    mechanism = motion.mechanism
    closure = Closure.of_mechanism(mechanism, motion.joints)
    inputs = [mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]
    passive = [v for v in range(motion.values.shape[1]) if v not in inputs]
    values = motion.values[row].copy()
    input_change = motion.inputs[row + 1] - motion.inputs[row]
    for _ in range(steps):
        jacobian = closure.linearise(values[None]).jacobian[0]
        passive_jacobian = jacobian[:, passive]
        singular_values = np.linalg.svd(passive_jacobian, compute_uv=False)
        if singular_values.size and not singular_values[-1] > 1e-2 * singular_values[0]:
            return None
        passive_change = (
            -np.linalg.pinv(passive_jacobian) @ jacobian[:, inputs] @ input_change
        )
        if np.max(np.abs(passive_change), initial=0.0) > steps:  # over 1 rad in a step
            return None
        values[passive] += passive_change / steps
        values[inputs] += input_change / steps
        for _ in range(6):
            position = closure.linearise(values[None])
            inverse = np.linalg.pinv(position.jacobian[0][:, passive])
            values[passive] -= inverse @ position.residual[0]
    return values


def check_rows_stay_in_one_mode(motion):
    """Assert that each row (sample) is reached from the one before by continuous motion.

    `follow_to_next_sample` moves the mechanism in small steps. It returns None where it
    would pass near a singularity, and such rows are skipped. In the other rows, the
    determinant of the closure equations with locked inputs must not change its sign either.
    """
    mechanism = motion.mechanism
    # For each variable whether its pair is an R pair.
    is_angle = [mechanism.pairs[p].type == "R" for p in mechanism.variable_owners]
    is_ok = motion.status == Status.OK
    for row in np.flatnonzero(is_ok[:-1] & is_ok[1:]):
        expected = follow_to_next_sample(motion, row)
        if expected is None:
            continue
        difference = motion.values[row + 1] - expected
        # Angles are compared without whole turns.
        difference = np.where(is_angle, np.angle(np.exp(1j * difference)), difference)
        # Another assembly mode would differ by much more.
        assert np.max(np.abs(difference)) < 1e-6, row
        sign = sign_of_locked_determinant(motion, row)
        assert sign == sign_of_locked_determinant(motion, row + 1)


def test_plans_of_random_mechanisms_determine_every_pole_once():
    """Of 90 random mechanisms, more than 50 have a plan."""
    checked = 0
    for seed in range(90):
        _, mechanism = random_mechanism(seed)
        try:
            mechanism_plans = plans(mechanism)
        except PlanError:
            continue
        for plan in mechanism_plans:
            check_plan(plan)
        checked += 1
    assert checked > 50


@pytest.mark.slow
def test_velocities_do_not_depend_on_names_orders_and_frame_of_the_file():
    random = np.random.default_rng(5)
    for seed in range(400, 410):
        _, mechanism = random_mechanism(seed)
        link_order = random.permutation(len(mechanism.links) - 1).tolist()
        check_invariance(mechanism, link_order)


def check_modes_of_random_mechanisms(seeds, largest_input_rad):
    """Trace random mechanisms from minus to plus an input angle in nine coarse samples."""
    for seed in seeds:
        _, mechanism = random_mechanism(seed)
        inputs = tuple(
            Input(item.pair, -largest_input_rad, largest_input_rad)
            for item in mechanism.inputs
        )
        try:
            motion, _ = evaluate_fields(replace(mechanism, inputs=inputs), samples=9)
        except SpherekitError:
            continue
        check_rows_stay_in_one_mode(motion)


@pytest.mark.slow
def test_coarse_samples_stay_in_their_assembly_mode():
    check_modes_of_random_mechanisms(range(500, 506), largest_input_rad=1.2)


@pytest.mark.long
@pytest.mark.parametrize("part", range(10))
def test_coarse_samples_of_hundreds_of_mechanisms_stay_in_their_assembly_mode(part):
    seeds = range(1000 + 60 * part, 1060 + 60 * part)
    check_modes_of_random_mechanisms(seeds, largest_input_rad=1.5)


def test_the_check_of_one_mode_notices_a_jump():
    """From sample 4 on, the values of mode 0 are replaced by those of mode 1."""
    motion = PositionAnalysis(sk.load("four_bar"), samples=9).motion()
    first_mode = motion.rows(motion.assembly_mode == 0)
    second_mode = motion.rows(motion.assembly_mode == 1)
    check_rows_stay_in_one_mode(first_mode)
    values = first_mode.values.copy()
    values[4:] = second_mode.values[4:]
    with pytest.raises(AssertionError):
        check_rows_stay_in_one_mode(replace(first_mode, values=values))
