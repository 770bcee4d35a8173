"""Outputs: inverse and forward kinematics, closed forms and the graph, workspaces."""

from functools import cached_property

import numpy as np
from sceptic.evidence import check
from sceptic.modes import place_of

from spherekit.conventions import Status
from spherekit.numeric.crossings import wrap
from spherekit.sphere.rotation import from_quaternion
from spherekit.workspace.inverse import output_kinematics
from spherekit.workspace.rows import OutputKinematics

PLACES = 4
"""At how many inputs poses are compared."""
CLEAR = 0.02
"""Least measure of singularity of configurations that are compared."""
SAME = 1e-6
"""Inputs and poses that differ by less (rad) are one."""
DIRECTIONS = 3000
"""Random directions by which an area is estimated."""
DEVIATIONS = 5.0
"""By how many standard deviations an estimated area may be off."""
EDGE = 1e-6
"""Places nearer (rad) to a limit are on neither side of it."""


class Outputs:
    """The pose solver of a mechanism, poses at some inputs, and their inverse."""

    def __init__(self, evidence):
        self.evidence = evidence
        self.solver: OutputKinematics = output_kinematics(evidence.mechanism)

    @cached_property
    def inputs(self):
        """Inputs (n, inputs) within their ranges."""
        items = self.evidence.mechanism.inputs
        low, high = (np.array([getattr(i, x) for i in items]) for x in ("start", "stop"))
        share = self.evidence.random.random((PLACES, len(items)))
        return np.asarray(low + share * (high - low))

    @cached_property
    def forward(self):
        """Every pose found at the inputs."""
        return self.solver.forward(self.inputs)

    def poses(self, found):
        """Return solutions in the terms of poses: directions, or rotations."""
        if not self.solver.points:
            return found.rotations
        assert found.directions is not None
        return found.directions

    def inverse(self, solver, poses):
        """Return the configurations of poses in every mode."""
        return solver.inverse(poses, solver.labels)


def outputs_of(evidence):
    """Return what solves poses, None where there is no output with an inverse."""
    if len(evidence.mechanism.inputs) not in (2, 3) or not evidence.mechanism.outputs:
        return None
    return Outputs(evidence)


def clear(rows):
    """Return which rows (k,) have a configuration well away from singularities."""
    least = np.fmin(np.min(rows.type_1, axis=1), rows.type_2)
    return np.asarray((rows.status == Status.OK) & (least > CLEAR))


def apart(one, other):
    """Return by how much (n, m) rows of inputs (n, k) and (m, k) differ, turns apart."""
    return np.asarray(np.max(np.abs(wrap(one[:, None] - other[None])), axis=2, initial=0.0))


@check("forward and inverse", "the inverse of a pose at inputs has these inputs, and back")
def forward_and_inverse(evidence, notes):
    """Go from inputs to poses to inputs, and from these to poses."""
    made = outputs_of(evidence)
    if made is None:
        return
    found = made.forward
    poses = made.poses(found)
    if not len(poses):
        return
    rows = made.inverse(made.solver, poses)
    for k in range(len(poses)):
        own = (rows.pose == k) & (rows.status != Status.OUT_OF_REACH)
        q = made.inputs[found.row[k]]
        gap = apart(q[None], rows.inputs[own])
        near = np.flatnonzero(own)[np.argsort(gap[0])] if np.any(own) else ()
        off = float(np.nanmin(gap, initial=np.inf))
        if not off < SAME:
            motion = evidence.tracer.given(found.values[k : k + 1])
            flat = not motion.conditioning[0] < 1e3
            loose = flat or any(not clear(rows)[n] for n in near[:1])
            notes.judged()
            if not loose:
                notes.found(
                    f"the pose at {place_of(q)} (solution {k}) has no inverse with these "
                    f"inputs, the nearest is {off:.2e} rad off"
                )
        else:
            notes.judged()
    good = np.flatnonzero(clear(rows))[:40]
    if not len(good):
        return
    back = made.solver.forward(rows.inputs[good])
    every = made.poses(back)
    for n, row in enumerate(good):
        gap = np.abs(every[back.row == n] - poses[rows.pose[row]])
        off = float(np.min(np.max(gap.reshape(len(gap), -1), axis=1), initial=np.inf))
        notes.contradiction(
            not off < SAME,
            f"the inputs {place_of(rows.inputs[row])} of a pose in mode {rows.mode[row]} "
            f"lead back to poses of which the nearest is {off:.2e} off",
        )


@check("workspace and inverse", "inside is where the inverse has inputs; areas by chance")
def workspace_and_inverse(evidence, notes):
    """Solve poses of the table of a workspace, and estimate its areas."""
    ran = evidence.ran("workspace")
    made = None if ran.status else outputs_of(evidence)
    if made is None:
        return
    frame, areas = ran.tables["workspace"], ran.tables["workspace_areas"]
    names = ["x", "y", "z"] if made.solver.points else ["x", "y", "z", "w"]
    for mode, rows in frame.groupby("working_mode", observed=True):
        chosen = evidence.random.permutation(len(rows))[:150]
        some = rows.iloc[chosen]
        places = some[names].to_numpy()
        if not made.solver.points:
            places = from_quaternion(places)
        found = made.solver.inverse(places, [str(mode)])
        inside = some["inside"].to_numpy() == "yes"
        reached = np.zeros(len(some), dtype=bool)
        solved = (found.status != Status.OUT_OF_REACH) & np.isfinite(found.inputs).all(
            axis=1
        )
        reached[found.pose[solved]] = True
        margin = some["margin"].to_numpy()
        wrong = (inside != reached) & (np.abs(margin) > EDGE)
        notes.judged(len(some))
        if np.any(wrong):
            k = int(np.flatnonzero(wrong)[0])
            notes.found(
                f"mode {mode}: {some[names].iloc[k].to_list()} is "
                f"{'inside' if inside[k] else 'outside'} with a margin of "
                f"{margin[k]:.3g}, the inverse says the opposite; {int(np.sum(wrong))} of "
                f"{len(some)} such places"
            )
        if not made.solver.points:
            continue
        own = areas[(areas["working_mode"] == mode) & (areas["part"] == "whole")]
        _area(made, str(mode), own["size"].item(), own["error"].item(), notes)


def _area(made, mode, size, error, notes):
    """Compare an area (sr) with the share of random directions that are reached."""
    given = made.evidence.random.normal(size=(DIRECTIONS, 3))
    given /= np.linalg.norm(given, axis=1)[:, None]
    found = made.solver.inverse(given, [mode])
    reached = np.unique(found.pose[found.status != Status.OUT_OF_REACH])
    share = len(reached) / DIRECTIONS
    told = size / (4.0 * np.pi)
    spread = np.sqrt(max(told * (1.0 - told), 1.0 / DIRECTIONS) / DIRECTIONS)
    notes.contradiction(
        abs(share - told) > DEVIATIONS * spread + error,
        f"mode {mode}: the area is {size:.5g} sr, {told:.4f} of the sphere, but the "
        f"inverse reaches {share:.4f} of {DIRECTIONS} random directions",
    )
