"""Configurations that are none: arbitrary numbers in the shapes of a motion.

Poles, rates and tables cost as much at arbitrary orientations as at real ones, so what a
branch will cost can be measured before any branch was found.
"""

import numpy as np

from spherekit.conventions import Status
from spherekit.model.geometry import geometry_of
from spherekit.model.mechanism import Mechanism
from spherekit.motion.branches import Branch, Solver
from spherekit.motion.groups import group_closure, group_variables, place_dyad
from spherekit.motion.motion import Motion
from spherekit.motion.pairs import contact_tracks
from spherekit.motion.timing import Timing
from spherekit.planning.assembly import Assembly
from spherekit.sphere.rotation import Floats, from_quaternion

NEWTON_STEPS = 2
"""Steps that Newton's method mostly takes from a prediction along a branch."""


def made_up_motion(mechanism: Mechanism, assembly: Assembly, samples: int) -> Motion:
    """Return arbitrary configurations of one branch, after the work of real ones.

    Every group is placed as in a run, an irreducible one with as many Newton steps as
    it mostly takes.
    """
    random = np.random.default_rng(samples)
    solver = Solver(mechanism, assembly)
    q = random.uniform(-3.0, 3.0, (samples, len(assembly.inputs)))
    values = _values(mechanism, random, samples)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        _place(solver, q, values)
    links = len(mechanism.links)
    turns = random.normal(size=(samples, links, 4))
    turns[:, 0] = 0.0, 0.0, 0.0, 1.0
    rotations = from_quaternion(turns / np.linalg.norm(turns, axis=-1, keepdims=True))
    return Motion(
        mechanism=mechanism,
        joints=solver.joints,
        assembly=assembly,
        branches=(Branch(0, tuple(int(group.is_dyad) for group in assembly.groups)),),
        samples=samples,
        sample=np.arange(samples),
        branch=np.zeros(samples, dtype=np.int64),
        inputs=q,
        values=values,
        rotations=rotations,
        status=np.full(samples, Status.OK, dtype=np.int8),
        residual=np.full(samples, 1e-16),
        timing=Timing(np.linspace(0.0, 1.0, samples), np.ones_like(q), np.zeros_like(q)),
    )


def _values(mechanism: Mechanism, random: np.random.Generator, samples: int) -> Floats:
    """Return arbitrary angles, and arc lengths on their profiles."""
    joints = geometry_of(mechanism).joints
    values = random.uniform(-3.0, 3.0, (samples, len(mechanism.variable_owners)))
    for _, (track, other) in contact_tracks(joints):
        for variable in sorted({track.variable, other.variable}):
            values[:, variable] = random.uniform(0.0, track.curve.length, samples)
    return values


def _place(solver: Solver, q: Floats, values: Floats) -> None:
    """Do what placing all groups takes."""
    ends = solver.mechanism.ends
    state = solver.start(q)
    for group in solver.assembly.groups:
        if group.is_dyad:
            place_dyad(state, group, ends, 1.0)
            continue
        own = group_variables(state, group)
        closure = group_closure(state, group, ends)
        closure.solve(values[:, own], iterations=NEWTON_STEPS)
        placed, states = closure.place(values[:, own])
        closure.tree.jacobian(closure.vectors(placed, states))
        state.merge(group, placed)
        state.values[:, own] = values[:, own]
    solver.closure.residual(*solver.closure.place(values))
