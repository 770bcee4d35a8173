"""The motion of a single-DOF mechanism: every branch at every sample of its input."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status, listing
from spherekit.errors import PlanError, SolveError
from spherekit.model.geometry import Joint
from spherekit.model.mechanism import Mechanism
from spherekit.motion.branches import Branch, Solver
from spherekit.motion.loops import rank_mobility
from spherekit.motion.modes import MOST_BRANCHES, PROBED_INPUTS, find_branches
from spherekit.motion.pairs import (
    PairRates,
    PairStates,
    pair_axes,
    pair_rates,
    pair_states,
    variable_vectors,
)
from spherekit.planning.assembly import Assembly, plan_assembly
from spherekit.planning.poles import default_input
from spherekit.planning.rigidity import graph_mobility
from spherekit.sphere.rotation import Floats, quaternion

DEFAULT_SAMPLES = 361
BLOCK = 512
"""Samples evaluated at once by `Tracer.blocks`; long enough to hide call overhead."""


@final
@dataclass(frozen=True)
class Motion:
    """Configurations in rows: branch after branch, in each the samples in order.

    Row r belongs to branch `branches[r // samples]`. Shapes: `sample`, `branch`,
    `status`, `residual`, `q` (n,); `values` (n, variables) rad; `rotations`
    (n, links, 3, 3), from link axes to ground axes. Rows with a status other than OK or
    AT_SINGULARITY hold NaN, except for sample, branch, q and status.
    """

    mechanism: Mechanism
    joints: tuple[Joint, ...]
    assembly: Assembly
    branches: tuple[Branch, ...]
    samples: int
    sample: NDArray[np.int64]
    branch: NDArray[np.int64]
    q: Floats
    values: Floats
    rotations: Floats
    status: NDArray[np.int8]
    residual: Floats

    def rows(self, chosen: NDArray[np.bool_]) -> "Motion":
        """Return some rows only, as a motion of one nameless branch."""
        return replace(
            self,
            samples=int(np.sum(chosen)),
            sample=self.sample[chosen],
            branch=self.branch[chosen],
            q=self.q[chosen],
            values=self.values[chosen],
            rotations=self.rotations[chosen],
            status=self.status[chosen],
            residual=self.residual[chosen],
        )

    def __len__(self) -> int:
        return len(self.q)

    @property
    def input(self) -> int:
        """Number of the driven pair."""
        return self.assembly.input

    @cached_property
    def states(self) -> PairStates:
        """The pairs' frames in link axes, curvatures, and whether contacts exist."""
        return pair_states(self.joints, self.values)

    @cached_property
    def frames(self) -> Floats:
        """Pair frames (n, pairs, 3, 3) in ground axes; columns as in `Joint`."""
        owners = [a for a, _ in self.mechanism.ends]
        return self.rotations[:, owners] @ self.states.first

    @cached_property
    def axes(self) -> Floats:
        """Pair axes (n, pairs, 3) in ground axes, see `spherekit.motion.pairs`."""
        return pair_axes(self.joints, self.frames)

    @cached_property
    def vectors(self) -> Floats:
        """Vectors of the variables (n, variables, 3) in ground axes."""
        return variable_vectors(self.joints, self.frames, self.states.curvatures)

    def rates_of_pairs(self, first_w: Floats, second_w: Floats) -> PairRates:
        """Return how vectors and axes change, see `spherekit.motion.pairs.pair_rates`."""
        return pair_rates(self.joints, self.frames, self.states, first_w, second_w)

    def quaternions(self, link: int) -> Floats:
        """Return (n, 4) xyzw, from the link's axes to ground axes."""
        return quaternion(self.rotations[:, link])

    @property
    def failed(self) -> NDArray[np.bool_]:
        """(n,) rows that hold no configuration."""
        held = (self.status == Status.OK) | (self.status == Status.AT_SINGULARITY)
        return np.asarray(~held)


@final
class Tracer:
    """The branches of a mechanism over its input range, evaluated as asked."""

    def __init__(
        self,
        mechanism: Mechanism,
        input_pair: str | None = None,
        branch: int | None = None,
        search: bool = True,
    ) -> None:
        name = input_pair or default_input(mechanism)
        self.mechanism = mechanism.with_input(name)
        self.assembly = plan_assembly(self.mechanism, name)
        driven = self.mechanism.inputs[0]
        self.low, self.high = driven.start, driven.stop
        if not self.low < self.high:
            raise SolveError(
                f"{mechanism.name}: inputs.{name}: the range must rise from `from` to "
                f"`to`, but it is {driven.start:.6g} to {driven.stop:.6g} rad"
            )
        self.solver = Solver(self.mechanism, self.assembly)
        self.branches = find_branches(self.solver, self.low, self.high, search)
        if any(group.redundant for group in self.assembly.groups):
            self._check_rank()
        if branch is not None:
            chosen = [item for item in self.branches if item.number == branch]
            if not chosen:
                numbers = listing(item.number for item in self.branches)
                raise SolveError(
                    f"{mechanism.name}: there is no branch {branch}; the branches found "
                    f"are {numbers}"
                )
            self.branches = tuple(chosen)

    def _check_rank(self) -> None:
        """Raise `PlanError` unless the rank at some configuration leaves one freedom."""
        found = self.at(np.linspace(self.low, self.high, 9))
        good = found.rows(found.status == Status.OK)
        ranks = rank_mobility(self.solver.closure.tree, good.vectors)
        if len(ranks) and np.min(ranks) != 1:
            raise PlanError(
                f"{self.mechanism.name}: mobility {np.min(ranks)} by rank with "
                f"{graph_mobility(self.mechanism)} by the graph, but this needs 1; add or "
                "remove a pair"
            )

    @property
    def search(self) -> str:
        """How the assembly modes were found, and what that says of their number."""
        if len(self.branches) >= MOST_BRANCHES:
            return f"stopped at {MOST_BRANCHES} modes; there may be more"
        if self.assembly.has_closed_form:
            return f"all modes of dyads that close at one of {PROBED_INPUTS} inputs"
        return "modes of irreducible groups searched from random starts; some may be missed"

    def inputs(self, samples: int) -> Floats:
        """Return the sampled input values (samples,), both ends of the range included."""
        if samples < 1:
            raise SolveError(f"samples must be at least 1, not {samples}")
        if samples == 1:
            return np.array([self.low])
        return np.linspace(self.low, self.high, samples)

    def at(self, q: Floats, first_sample: int = 0) -> Motion:
        """Return all branches at inputs q (k,) rad, any order."""
        q = np.atleast_1d(np.asarray(q, dtype=float))
        parts = [self.solver.evaluate(branch, q) for branch in self.branches]
        count, k = len(self.branches), len(q)
        return Motion(
            mechanism=self.mechanism,
            joints=self.solver.joints,
            assembly=self.assembly,
            branches=self.branches,
            samples=k,
            sample=np.tile(np.arange(first_sample, first_sample + k), count),
            branch=np.repeat([branch.number for branch in self.branches], k),
            q=np.tile(q, count),
            values=np.concatenate([part.values for part in parts]),
            rotations=np.concatenate([part.rotations for part in parts]),
            status=np.concatenate([part.status for part in parts]),
            residual=np.concatenate([part.residual for part in parts]),
        )

    def blocks(self, samples: int, size: int = BLOCK) -> Iterator[Motion]:
        """Yield the motion in blocks of successive samples, for streaming."""
        q = self.inputs(samples)
        for start in range(0, samples, size):
            yield self.at(q[start : start + size], start)


def trace(
    mechanism: Mechanism,
    samples: int = DEFAULT_SAMPLES,
    input_pair: str | None = None,
    branch: int | None = None,
    search: bool = True,
) -> Motion:
    """Return the motion of a single-DOF mechanism over the range of its input.

    Parameters
    ----------
    mechanism
        A mechanism with one freedom.
    samples
        Number of equally spaced input values, both ends of the range included.
    input_pair
        Name of the driven pair; by default the mechanism's first declared input.
    branch
        Number of the only branch wanted; all by default.
    search
        Whether to look for assembly modes beside that of a given reference pose.

    Raises
    ------
    PlanError
        If the mechanism is not a single-DOF chain, or the input is a contact pair.
    SolveError
        If it cannot be assembled anywhere in the range, or the branch is unknown.
    """
    tracer = Tracer(mechanism, input_pair, branch, search)
    return tracer.at(tracer.inputs(samples))


def status_counts(status: Sequence[int] | NDArray[np.int8]) -> dict[str, int]:
    """Return how many samples have each status, by the status's name, OK first."""
    codes = np.asarray(status)
    return {
        code.name: int(np.sum(codes == code)) for code in Status if np.any(codes == code)
    }
