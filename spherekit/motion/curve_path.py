"""A curve followed in its own arc length, until it closes or ends."""

from abc import ABC, abstractmethod
from typing import Generic, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.motion.continuation import Rows, Verification, follow_paths
from spherekit.sphere.rotation import Floats

NEARLY_THERE = 1e-6
"""How near (rad) a node is to the start of a lap, or to a limit, that it has reached."""
AIMED = 0.6
"""Part of the allowed change of the equations that the next step aims at."""
STEP_PARTS = np.array([0.5, 1.0])
"""Where a step is verified."""


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


def taylor(node: CurveNode, way: Floats) -> Floats:
    """Return the curve (n, variables) at arc lengths (n,) from a node, to second order."""
    way = way[:, None]
    return np.asarray(node.values + way * node.tangent + 0.5 * way**2 * node.bend)


class CurvePath(ABC, Generic[Node]):
    """One sense of a curve, from a node on.

    Parameters
    ----------
    start
        The first node.
    periods
        (variables,) growth of each variable that changes nothing.
    longest, largest
        Length (rad) after which the curve is ended, and the longest step.
    smallest, same, most_nodes
        The step at which it ends if not even that holds, how near (rad) to its start a lap
        ends, and the most nodes.
    verification
        The tests of a step.

    Attributes
    ----------
    nodes
        What was reached, without the start.
    why
        The status of what lies beyond; None while the curve goes on.
    closed
        Whether the last node is the start again, whole periods on.
    """

    def __init__(
        self,
        start: Node,
        periods: Floats,
        longest: float,
        largest: float,
        smallest: float,
        same: float,
        most_nodes: int,
        verification: Verification,
    ) -> None:
        self.start, self.at = start, start
        self.periods, self.longest, self.largest = periods, longest, largest
        self._smallest, self._same, self._most_nodes = smallest, same, most_nodes
        self.verification = verification
        self.nodes: list[Node] = []
        self.why: Status | None = None
        self.closed = False
        self._way = 0.0

    def run(self, first_step: float) -> Self:
        """Follow the curve to its end."""
        follow_paths(self, np.array([first_step]))
        return self

    @abstractmethod
    def step_to(self, at: Node, way: float) -> tuple[Node, float] | None:
        """Return the node at this projection on the tangent, if it passes all tests.

        And the relative change of the equations.
        """

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

    def bound(self, step: float) -> float:
        """Return the step that the last node allows, at most as long as given."""
        return min(step, self.largest)

    @property
    def going(self) -> Rows:
        """Number 0, until the curve ends."""
        if self.why is None:
            if self._way >= self.longest:
                self.why = Status.OK
            elif len(self.nodes) >= self._most_nodes:
                self.why = Status.BRANCH_LOST
            else:
                self.why = self.exhausted()
        return np.arange(1 if self.why is None else 0)

    def allowed(self, rows: Rows, step: Floats) -> Floats:
        """See `spherekit.motion.continuation`, as the further methods."""
        return np.array([self.bound(float(step[0]))])

    def smallest(self, rows: Rows) -> Floats:
        """Return the step at which the curve ends."""
        return np.array([self._smallest])

    def stop(self, row: int) -> None:
        """End the curve at its last node."""
        self.why = self.beyond()

    def advance(self, rows: Rows, step: Floats) -> Floats:
        """Go on by a step."""
        at, length = self.at, float(step[0])
        made = self.step_to(at, length)
        if made is not None and self._way > 4.0 * NEARLY_THERE:
            end = self._closing(length, made[0])
            if end is not None:
                if np.max(np.abs(end.values - at.values)) < NEARLY_THERE:
                    self.nodes.pop()
                self.nodes.append(end)
                self.why, self.closed = Status.OK, True
                return np.ones(1)
        if not self.within(length, None if made is None else made[0]):
            return np.ones(1) if self.why is not None else np.zeros(1)
        assert made is not None
        self.at, change = made
        self.nodes.append(self.at)
        self._way += float(np.linalg.norm(self.at.values - at.values))
        growth = AIMED * self.verification.change / (change + 1e-300)
        return np.array([min(2.0, max(0.5, growth))])

    def _closing(self, step: float, new: Node) -> Node | None:
        """Return the start, whole periods on, if a verified step runs through it."""
        at, start = self.at, self.start
        middle = 0.5 * (at.values + new.values)
        laps = np.round((middle - start.values) / self.periods)
        finite = np.where(np.isfinite(self.periods), self.periods, 0.0)
        values = start.values + laps * finite
        way = float(at.tangent @ (values - at.values))
        if not -NEARLY_THERE < way <= step or start.tangent @ at.tangent < 0.8:
            return None
        miss = np.max(np.abs(values - taylor(at, np.array([way]))[0]))
        if miss > self.verification.correction * step:
            return None
        if abs(way) > NEARLY_THERE:
            made = self.step_to(at, way)
            if made is None or np.max(np.abs(made[0].values - values)) > self._same:
                return None
        elif miss > self._same:
            return None
        return self.again(at, values)

    @property
    def end(self) -> Status:
        """Why the curve goes no further."""
        return Status.OK if self.why is None else self.why

    @property
    def winding(self) -> NDArray[np.int64]:
        """(variables,) whole periods of one lap of a closed curve."""
        laps = (self.nodes[-1].values - self.start.values) / self.periods
        return np.round(laps).astype(np.int64)
