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

TURN = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()


def fields(made, samples=3):
    """Return the motion and the field of each input."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        tracer = PositionAnalysis(made, search=False, samples=samples, assembly_mode=0)
        motion = tracer.motion()
        poles = all_poles(len(made.links))
        found = {}
        for name in tracer.inputs:
            wanted = request(tracer.mechanism, name, poles, poles, by_rank=tracer.by_rank)
            found[name] = evaluate(motion, wanted)
    return motion, found


def check_plan(plan):
    """Every pole is found once, from poles found before it."""
    known = set()
    for step in plan.steps:
        if isinstance(step, LinePole):
            assert set(step.sources) <= known
        poles = step.poles if isinstance(step, BlockPoles) else (step.pole,)
        assert isinstance(step, PrimaryPole | LinePole | BlockPoles)
        assert not known & set(poles)
        known |= set(poles)
    assert known >= {tuple(sorted(pair)) for pair in combinations(plan.bodies, 2)}
    shown = as_dict(plan)
    assert json.loads(json.dumps(shown, allow_nan=False)) == shown
    assert len(shown["steps"]) == len(plan.steps) and as_text(plan)


def check_same(made, order):
    """Names, orders, exchanged links and a rotation change nothing but how it is said."""
    other, names = reordered(turned(made, TURN), order)
    try:
        _, found = fields(made)
    except SpherekitError as refusal:
        with pytest.raises(type(refusal)):
            fields(other)
        return
    _, again = fields(other)
    number = {made.link_number[old]: other.link_number[new] for old, new in names.items()}
    for name, field in found.items():
        moved = again[name]
        both = (field.status == Status.OK) & (moved.status == Status.OK)
        for link, w in field.w.items():
            want = w[both] @ TURN.T
            scale = np.maximum(1.0, np.max(np.abs(want), axis=1, initial=0.0))
            off = np.max(np.abs(moved.w[number[link]][both] - want), axis=1, initial=0.0)
            assert np.max(off / scale, initial=0.0) < 1e-7
        if np.any(field.status != moved.status):
            # Only at the edge of what rounding decides may one say more than the other.
            unsure = {Status.AT_SINGULARITY, Status.OUT_OF_REACH, Status.NOT_CONVERGED}
            unsure |= {Status.MODE_LOST, Status.NOT_CLOSED}
            for status in (field.status, moved.status):
                assert {Status(code) for code in status} <= unsure | {Status.OK}


def turning(motion, row):
    """Return the determinant of the closure equations, inputs held, and its flatness."""
    mechanism = motion.mechanism
    held = [mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]
    free = [v for v in range(motion.values.shape[1]) if v not in held]
    closure = Closure.of_mechanism(mechanism, motion.joints)
    jacobian = closure.at(motion.values[row : row + 1]).jacobian[0][:, free]
    sizes = np.linalg.svd(jacobian, compute_uv=False)
    if jacobian.shape[0] != jacobian.shape[1] or not sizes.size:
        return 1.0, 1.0
    return np.sign(np.linalg.det(jacobian)), sizes[-1] / sizes[0]


def walked(motion, row, steps=40):
    """Return the next sample reached by small steps from a row, None near singularities.

    Euler's steps and Newton's corrections with the inputs held, written here.
    """
    mechanism, closure = (
        motion.mechanism,
        Closure.of_mechanism(motion.mechanism, motion.joints),
    )
    held = [mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]
    free = [v for v in range(motion.values.shape[1]) if v not in held]
    values = motion.values[row].copy()
    goal = motion.inputs[row + 1] - motion.inputs[row]
    for _ in range(steps):
        jacobian = closure.at(values[None]).jacobian
        own = jacobian[0][:, free]
        sizes = np.linalg.svd(own, compute_uv=False)
        if sizes.size and not sizes[-1] > 1e-2 * sizes[0]:
            return None
        slope = -np.linalg.pinv(own) @ jacobian[0][:, held] @ goal
        if np.max(np.abs(slope), initial=0.0) > steps:
            return None
        values[free] += slope / steps
        values[held] += goal / steps
        for _ in range(6):
            at = closure.at(values[None])
            values[free] -= np.linalg.pinv(at.jacobian[0][:, free]) @ at.residual[0]
    return values


def check_one_mode(motion):
    """No row is in another mode than the row before, carried on in small steps."""
    made = motion.mechanism
    angles = [made.pairs[p].type == "R" for p in made.variable_owners]
    good = motion.status == Status.OK
    for row in np.flatnonzero(good[:-1] & good[1:]):
        reached = walked(motion, row)
        if reached is None:
            continue
        away = motion.values[row + 1] - reached
        away = np.where(angles, np.angle(np.exp(1j * away)), away)
        assert np.max(np.abs(away)) < 1e-6, row
        assert turning(motion, row)[0] == turning(motion, row + 1)[0]


def test_every_pole_of_a_plan_is_found_once():
    checked = 0
    for _, made in map(random_mechanism, range(90)):
        try:
            found = plans(made)
        except PlanError:
            continue
        for plan in found:
            check_plan(plan)
        checked += 1
    assert checked > 50


def test_said_otherwise_it_is_the_same():
    random = np.random.default_rng(5)
    for _, made in map(random_mechanism, range(400, 410)):
        check_same(made, random.permutation(len(made.links) - 1).tolist())


def check_no_jumps(seeds, span):
    for _, made in map(random_mechanism, seeds):
        wide = tuple(Input(item.pair, -span, span) for item in made.inputs)
        try:
            motion, _ = fields(replace(made, inputs=wide), samples=9)
        except SpherekitError:
            continue
        check_one_mode(motion)


@pytest.mark.slow
def test_no_branch_jumps_to_another_mode():
    check_no_jumps(range(500, 506), 1.2)


@pytest.mark.long
@pytest.mark.parametrize("part", range(10))
def test_no_branch_jumps_in_hundreds(part):
    check_no_jumps(range(1000 + 60 * part, 1060 + 60 * part), 1.5)


def test_a_jump_is_seen():
    tracer = PositionAnalysis(sk.load("four_bar"), samples=9)
    motion = tracer.motion()
    first, other = (motion.rows(motion.assembly_mode == k) for k in (0, 1))
    check_one_mode(first)
    values = first.values.copy()
    values[4:] = other.values[4:]
    with pytest.raises(AssertionError):
        check_one_mode(replace(first, values=values))
