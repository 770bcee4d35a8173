"""Loop closure of bodies joined by pairs: residual, Jacobian, and its Newton solver.

The unknowns are the variables of the pairs: one angle of an R pair, one arc length of a
rolling contact, two of a sliding one. A spanning tree of pairs places every body in the
axes of body 0; each remaining pair closes one loop, and the rotation vector by which it
fails to close is the residual. Bodies may be links, or groups of links whose
relative orientation differs from sample to sample.

Continuation: paths of configurations, followed by verified steps.

Every path is followed in the same way, whatever its parameter: inputs on a straight way,
the arc length of a curve, the angle of a rotation. A step is predicted from the last node
by its derivatives, corrected by Newton's method, and accepted only if

- the prediction was nearly right,
- Newton's method contracted at once,
- the equations changed by less than would make them singular on the way, or the
  determinant kept its sign,
- the tangent turned little,
- the Hermite polynomial through both ends predicts the middle.

Otherwise it is halved. After a step that holds, the next one may be longer. A path ends
where it arrives, where its owner says so (a limit, a closed lap), or where no step holds.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Generic, Protocol, Self, TypeVar, final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import CLOSURE_TOLERANCE, Status
from spherekit.model.joints import Joint
from spherekit.model.mechanism import Mechanism
from spherekit.motion.loops import REDUNDANT, Linearisation, LoopTree
from spherekit.motion.turns import whole_laps
from spherekit.sphere.rotation import Floats, transpose

Rows = NDArray[np.intp]

CONTRACTION = 0.1
"""The second step of Newton's method may be this part of the first."""
NEARLY_THERE = 1e-6
"""How near (rad) a node is to the start of a lap, or to a limit, that it has reached."""
AIMED = 0.6
"""Part of the allowed change of the equations that the next step aims at."""
STEP_PARTS = np.array([0.5, 1.0])
"""Where a step is verified."""


@final
@dataclass(frozen=True)
class Verification:
    """How well steps have to be predicted and corrected; `size` is that of a step.

    Attributes
    ----------
    correction, slack
        A prediction may be wrong by this part of the step and so much (rad) besides.
    settled
        Newton's method need not contract after a first step smaller than this (rad).
    change
        Change of the equations, relative; at 1 they may be singular on the way.
    turn
        Least cosine of the angle by which the tangent turns.
    middle
        The prediction of the middle from both ends may be wrong by this part of the step.
    """

    correction: float = 0.05
    slack: float = CLOSURE_TOLERANCE
    settled: float = 1e-7
    change: float = 0.6
    turn: float = 0.9
    middle: float = 1e-4

    def corrected(
        self, first: Floats, ratio: Floats, size: Floats | float
    ) -> NDArray[np.bool_]:
        """Return (n,) whether Newton's first steps (n,), and second by first, are fine."""
        near = first <= self.correction * size + self.slack
        return np.asarray(near & ((first <= self.settled) | (ratio <= CONTRACTION)))

    def regular(self, change: Floats, cosine: Floats | float = 1.0) -> NDArray[np.bool_]:
        """Return (n,) whether equations and tangents changed little enough."""
        return np.asarray((change < self.change) & (np.asarray(cosine) > self.turn))

    def predicted(
        self, miss: Floats | float, size: Floats | float, rounding: Floats | float = 0.0
    ) -> NDArray[np.bool_]:
        """Return (n,) whether the middles of steps lie where both ends predict them."""
        return np.asarray(miss <= self.middle * size + rounding)


class Paths(Protocol):
    """Paths that are followed side by side, each by steps of its own length."""

    @property
    def going(self) -> Rows:
        """The paths that have not ended."""

    def allowed(self, rows: Rows, step: Floats) -> Floats:
        """Return the steps (k,) to try on these paths, at most as long as `step`."""

    def advance(self, rows: Rows, step: Floats) -> Floats:
        """Go on by steps that hold; return how (k,) the next may grow, 0 if none holds."""

    def smallest(self, rows: Rows) -> Floats:
        """Return the steps (k,) at which these paths end if not even they hold."""

    def stop(self, row: int) -> None:
        """End a path that no step leaves."""


def follow_paths(paths: Paths, step: Floats) -> None:
    """Follow paths to their ends, the first steps `step` (n,)."""
    step = step.copy()
    while len(rows := paths.going):
        step[rows] = paths.allowed(rows, step[rows])
        growth = paths.advance(rows, step[rows])
        held = growth > 0.0
        failed = rows[~held]
        for row in failed[~(step[failed] > paths.smallest(failed))]:
            paths.stop(int(row))
        step[rows] *= np.where(held, growth, 0.5)


class CurveNode(Protocol):
    """A point of a curve in the space of the variables, and how the curve goes on."""

    @property
    def values(self) -> Floats:
        """(variables,) rad."""

    @property
    def tangent(self) -> Floats:
        """(variables,) of unit length."""

    @property
    def bend(self) -> Floats:
        """(variables,) second derivatives by arc length."""


Node = TypeVar("Node", bound=CurveNode)


def taylor(values: Floats, tangents: Floats, bends: Floats, ways: Floats) -> Floats:
    """Return curves at arc lengths (n, k) from points (n, variables), to second order.

    Row after row, (n k, variables).
    """
    way = ways[:, :, None]
    there = values[:, None] + way * tangents[:, None] + 0.5 * way**2 * bends[:, None]
    return np.asarray(there.reshape(-1, values.shape[1]))


@dataclass
class CurvePath(ABC, Generic[Node]):
    """One sense of a curve, from a node on.

    Attributes
    ----------
    verification, smallest_step, same, most_nodes
        The tests of a step, the step at which the curve ends if not even that holds, how
        near (rad) to its start a lap ends, and the most nodes.
    start
        The first node.
    periods
        (variables,) growth of each variable that changes nothing.
    longest, largest
        Length (rad) after which the curve is ended, and the longest step.
    nodes
        What was reached, without the start.
    end
        The status of what lies beyond; None while the curve goes on.
    closed
        Whether the last node is the start again, whole periods on.
    """

    verification: ClassVar[Verification]
    smallest_step: ClassVar[float]
    same: ClassVar[float]
    most_nodes: ClassVar[int]

    start: Node
    periods: Floats
    longest: float
    largest: float
    nodes: list[Node] = field(default_factory=list, init=False)
    end: Status | None = field(default=None, init=False)
    closed: bool = field(default=False, init=False)
    way: float = field(default=0.0, init=False)

    @property
    def at(self) -> Node:
        """The last node."""
        return self.nodes[-1] if self.nodes else self.start

    def run(self, first_step: float) -> Self:
        """Follow the curve to its end."""
        run_each([self], first_step)
        return self

    @staticmethod
    @abstractmethod
    def steps_to(
        paths: "Sequence[CurvePath[Node]]", ats: Sequence[Node], ways: Floats
    ) -> list[tuple[Node, float] | None]:
        """Return the nodes at projections (n,) on the tangents where they pass all tests.

        And the relative changes of the equations. Paths are of one class, and alike but for
        where they run.
        """

    def step_to(self, at: Node, way: float) -> tuple[Node, float] | None:
        """Return what `steps_to` does of this path."""
        return self.steps_to([self], [at], np.array([way]))[0]

    @abstractmethod
    def again(self, at: Node, values: Floats) -> Node | None:
        """Return the start at values whole periods on, None if it is another one."""

    @abstractmethod
    def within(self, step: float, node: Node | None) -> bool:
        """Return whether a step is to be taken; end the curve where a limit is reached."""

    @abstractmethod
    def beyond(self) -> Status:
        """Return the status of what lies beyond the last node, which no step leaves."""

    def exhausted(self) -> Status | None:
        """Return why not to go on from the last node, if there is a reason."""
        return None

    @property
    def goes_on(self) -> bool:
        """Whether the curve has not ended."""
        if self.end is None:
            if self.way >= self.longest:
                self.end = Status.OK
            elif len(self.nodes) >= self.most_nodes:
                self.end = Status.MODE_LOST
            else:
                self.end = self.exhausted()
        return self.end is None

    @property
    def allowed(self) -> float:
        """The longest step from here."""
        return self.largest

    def take(self, length: float, made: tuple[Node, float] | None) -> float:
        """Go on to what a step made; return how the next may grow, 0 if none holds."""
        at = self.at
        if made is not None and self.way > 4.0 * NEARLY_THERE:
            end = self._closing(length, made[0])
            if end is not None:
                if np.max(np.abs(end.values - at.values)) < NEARLY_THERE:
                    self.nodes.pop()
                self.nodes.append(end)
                self.end, self.closed = Status.OK, True
                return 1.0
        if not self.within(length, None if made is None else made[0]):
            return 0.0 if self.end is None else 1.0
        assert made is not None
        node, change = made
        self.nodes.append(node)
        self.way += float(np.linalg.norm(node.values - at.values))
        growth = AIMED * self.verification.change / (change + 1e-300)
        return min(2.0, max(0.5, growth))

    def _closing(self, step: float, new: Node) -> Node | None:
        """Return the start, whole periods on, if a verified step runs through it."""
        at, start = self.at, self.start
        middle = 0.5 * (at.values + new.values)
        values = start.values + whole_laps(middle - start.values, self.periods)
        way = float(at.tangent @ (values - at.values))
        if not -NEARLY_THERE < way <= step or start.tangent @ at.tangent < 0.8:
            return None
        there = at.values + way * at.tangent + 0.5 * way**2 * at.bend
        miss = np.max(np.abs(values - there))
        if miss > self.verification.correction * step:
            return None
        if abs(way) > NEARLY_THERE:
            made = self.step_to(at, way)
            if made is None or np.max(np.abs(made[0].values - values)) > self.same:
                return None
        elif miss > self.same:
            return None
        return self.again(at, values)

    @property
    def winding(self) -> NDArray[np.int64]:
        """(variables,) whole periods of one lap of a closed curve."""
        laps = (self.nodes[-1].values - self.start.values) / self.periods
        return np.round(laps).astype(np.int64)


class _SideBySide(Generic[Node]):
    """Curves of one class that are followed together."""

    def __init__(self, paths: Sequence[CurvePath[Node]]) -> None:
        self.paths = paths
        self._left = list(range(len(paths)))

    @property
    def going(self) -> Rows:
        """The curves that have not ended."""
        self._left = [k for k in self._left if self.paths[k].goes_on]
        return np.array(self._left, dtype=np.intp)

    def allowed(self, rows: Rows, step: Floats) -> Floats:
        """Return the steps (k,), no longer than the longest."""
        return np.minimum(step, [self.paths[k].allowed for k in rows])

    def smallest(self, rows: Rows) -> Floats:
        """Return the steps (k,) at which curves end."""
        return np.full(len(rows), self.paths[0].smallest_step)

    def stop(self, row: int) -> None:
        """End a curve at its last node."""
        path = self.paths[row]
        path.end = path.beyond()

    def advance(self, rows: Rows, step: Floats) -> Floats:
        """Go on by a step each."""
        paths = [self.paths[k] for k in rows]
        made = paths[0].steps_to(paths, [path.at for path in paths], step)
        trials = zip(paths, step.tolist(), made, strict=True)
        return np.array([path.take(length, new) for path, length, new in trials])


def run_each(paths: Sequence[CurvePath[Node]], first_step: float) -> None:
    """Follow curves of one class to their ends, all steps of a kind at once."""
    if paths:
        follow_paths(_SideBySide(paths), np.full(len(paths), first_step))


@final
class NewtonSteps:
    """The steps of one correction of n samples.

    `first` (n,) is the size of the first step, `ratio` (n,) that of the second by the
    first, 0 where one was enough: small both, they say that the start was near a solution
    (`spherekit.motion.closure`). No variable changes by more than `trust` in a step.
    """

    def __init__(self, count: int, trust: float = np.inf) -> None:
        self.first, self.ratio, self.trust = np.zeros(count), np.zeros(count), trust
        self._taken = 0

    def part(self, size: Floats, rows: NDArray[np.intp] | slice = slice(None)) -> Floats:
        """Note a step of sizes (k,) of some rows; return the part (k, 1) to take of it."""
        if self._taken == 0:
            self.first[rows] = size
        elif self._taken == 1:
            self.ratio[rows] = size / np.maximum(self.first[rows], 1e-300)
        self._taken += 1
        return np.minimum(1.0, self.trust / np.maximum(size, 1e-300))[:, None]


def newton(
    change: Callable[[Floats, NDArray[np.intp]], Floats],
    values: Floats,
    most: int,
    settled: float = 0.0,
    trust: float = np.inf,
) -> tuple[Floats, NewtonSteps]:
    """Return what so many steps at most make of values (n, variables), and the steps.

    `change` returns the steps (k, variables) of some rows from values (k, variables). A row
    ends with a step of at most `settled` (rad), or one that is not a number.
    """
    steps = NewtonSteps(len(values), trust)
    values, active = values.copy(), np.arange(len(values))
    for _ in range(most):
        step = change(values[active], active)
        length = np.max(np.abs(step), axis=1, initial=0.0)
        values[active] += step * steps.part(length, active)
        active = active[length > settled]
        if not len(active):
            break
    return values, steps


@final
@dataclass(frozen=True)
class Closure:
    """A loop tree with the joints of its pairs.

    `leads`: (n or 1, pairs, 3, 3) twice, from the axes of the pair's first and second links
    to those of the bodies that hold them; None where bodies are links.
    """

    tree: LoopTree
    joints: tuple[Joint, ...]
    leads: tuple[Floats, Floats] | None = None

    @staticmethod
    def of(mechanism: Mechanism, joints: tuple[Joint, ...]) -> "Closure":
        """Return the closure of a whole mechanism, each link a body."""
        return Closure(LoopTree.of(mechanism), joints)

    def take(self, rows: NDArray[np.intp]) -> "Closure":
        """Return the closure of some samples only."""
        if self.leads is None or len(self.leads[0]) == 1:
            return self
        first, second = self.leads
        return Closure(self.tree, self.joints, (first[rows], second[rows]))

    @staticmethod
    def stacked(parts: Sequence["Closure"]) -> "Closure":
        """Return the closure of a sample of each part; they differ in their leads alone."""
        leads = [part.leads for part in parts if part.leads is not None]
        if not leads:
            return parts[0]
        first, second = (np.concatenate(side) for side in zip(*leads, strict=True))
        return Closure(parts[0].tree, parts[0].joints, (first, second))

    def at(self, values: Floats) -> Linearisation:
        """Return the closure at configurations (n, variables)."""
        return Linearisation(self.tree, self.joints, values, self.leads)

    def solve(
        self,
        values: Floats,
        held: Sequence[int] = (),
        iterations: int = 12,
        trust: float = 0.5,
    ) -> "NewtonResult":
        """Close the loops by Newton's method, each sample on its own.

        Parameters
        ----------
        values
            (n, variables) starting values.
        held
            Numbers of the variables that are not changed, those of inputs.
        iterations, trust
            Most steps taken, and the largest change (rad) of a variable in one step.

        Returns
        -------
        NewtonResult
            Per sample: values, residual, the size of the first step and the ratio of
            the second to the first (0 where one step was enough); and the closure there.
        """
        free = [v for v in range(values.shape[1]) if v not in held]
        values = values.copy()
        n = len(values)
        residual = np.full(n, np.inf)
        steps = NewtonSteps(n, trust)
        active = np.arange(n)
        best, at_best = values.copy(), None
        for step in range(iterations + 1):
            at = self.take(active).at(values[active])
            size = at.gap
            better = size < residual[active]
            improved = active[better]
            best[improved], residual[improved] = values[improved], size[better]
            if len(improved):
                at_best = at if len(improved) == n else None
            going = np.isfinite(size) & (size > 1e-15) & (better | (size > 1e-9))
            if step == iterations or not np.any(going):
                break
            active = active[going]
            change = least_change(at.jacobian[going][:, :, free], -at.residual[going])
            length = np.max(np.abs(change), axis=1)
            values[active[:, None], free] += change * steps.part(length, active)
        if at_best is None:
            at_best = self.at(best)
        return NewtonResult(best, residual, steps.first, steps.ratio, at_best)


@final
@dataclass(frozen=True)
class NewtonResult:
    """What Newton's method reached for each sample."""

    values: Floats
    residual: Floats
    first_step: Floats
    ratio: Floats
    at: Linearisation


def least_change(matrices: Floats, right: Floats) -> Floats:
    """Return the least x (n, k) with matrices (n, m, k) x = right (n, m)."""
    if matrices.shape[1] == matrices.shape[2]:
        try:
            return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0])
        except np.linalg.LinAlgError:
            pass
    inverse = np.linalg.pinv(matrices, rcond=REDUNDANT)
    return np.asarray(np.einsum("nij,nj->ni", inverse, right))


@final
@dataclass(frozen=True)
class Locked:
    """A closure with some variables locked, and the way back to all variables.

    `closure` has the variables `kept` of the whole closure, in order; `values` (V,) holds
    the locked ones.
    """

    closure: Closure
    kept: tuple[int, ...]
    values: Floats

    def whole(self, values: Floats) -> Floats:
        """Return all variables (n, V) from those kept."""
        out = np.tile(self.values, (len(values), 1))
        out[:, list(self.kept)] = values
        return out

    def rates(self, rates: Floats) -> Floats:
        """Return the rates (n, V) of all variables from those of the variables kept."""
        out = np.zeros((len(rates), len(self.values)))
        out[:, list(self.kept)] = rates
        return out


def lock(closure: Closure, held: Mapping[int, float]) -> Locked:
    """Return a closure of constant pair frames with R pairs or rolling contacts locked.

    `held` has the value (rad) of each locked pair's variable, by the variable's number.
    Where locked pairs close a loop of their own, the last of them is taken to fit.
    """
    tree = closure.tree
    values = np.zeros(len(tree.owners))
    for variable, value in held.items():
        values[variable] = value
    states = closure.at(values[None]).states
    first, second = states.first[0], states.second[0]
    body = list(range(tree.count))
    lift = [np.eye(3)] * tree.count
    for variable in held:
        pair = tree.owners[variable]
        a, b = tree.ends[pair]
        turn = lift[a] @ first[pair] @ transpose(lift[b] @ second[pair])
        keep, drop = body[a], body[b]
        if keep == drop:
            continue
        if keep > drop:
            keep, drop, turn = drop, keep, transpose(turn)
        for link in [k for k, owner in enumerate(body) if owner == drop]:
            body[link], lift[link] = keep, turn @ lift[link]
    number = {owner: k for k, owner in enumerate(sorted(set(body)))}
    locked = {tree.owners[variable] for variable in held}
    pairs = [pair for pair in range(len(tree.ends)) if pair not in locked]
    place = {pair: k for k, pair in enumerate(pairs)}
    kept = tuple(v for v, owner in enumerate(tree.owners) if owner not in locked)
    ends = tuple(
        (number[body[a]], number[body[b]]) for a, b in (tree.ends[p] for p in pairs)
    )
    leads = []
    for which in (0, 1):
        lifted = np.array([lift[tree.ends[pair][which]] for pair in pairs]).reshape(
            -1, 3, 3
        )
        if closure.leads is not None:
            lifted = lifted @ closure.leads[which][0][pairs]
        leads.append(lifted[None])
    return Locked(
        Closure(
            LoopTree(len(number), ends, tuple(place[tree.owners[v]] for v in kept)),
            tuple(closure.joints[pair] for pair in pairs),
            (leads[0], leads[1]),
        ),
        kept,
        values,
    )
