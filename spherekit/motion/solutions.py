"""All closed configurations of one irreducible group at one sample, and by which method."""

from dataclasses import dataclass, replace
from typing import final

import numpy as np

from spherekit.conventions import CLOSURE_TOLERANCE
from spherekit.motion.closure import Closure
from spherekit.motion.elimination import candidates
from spherekit.motion.search import POLISHING_STEPS, Census, Distinct, search
from spherekit.numeric.turns import wrap
from spherekit.planning.assembly import Group
from spherekit.sphere.rotation import Floats

DIGITS = 6
"""Decimals of an angle (rad) that tell modes apart where they are put in order."""
MOVED = 1e-2
"""Farthest (rad) that an angle of a real root moves until the group is closed."""


@final
@dataclass(frozen=True)
class Method:
    """How the modes of one group were found.

    `roots` is the number of complex solutions that were all computed, 0 for a search;
    `problem` says why an elimination that exists for the group was not complete; `census`
    counts the starts of a search.
    """

    roots: int
    problem: str = ""
    closed_form: bool = False
    census: Census | None = None

    @property
    def is_complete(self) -> bool:
        """Whether no real mode at the inputs probed can be missing."""
        return self.roots > 0

    @property
    def doubt(self) -> float:
        """What orders methods: 0 where nothing can be missing, the more the worse."""
        if self.is_complete:
            return 0.0
        return 1.0 if self.census is None else self.census.share

    def __str__(self) -> str:
        if self.closed_form:
            return "closed form"
        if self.is_complete:
            return f"elimination: all {self.roots} complex roots"
        words = f"search ({self.problem})" if self.problem else "search"
        return words if self.census is None else f"{words}: {self.census.words('modes')}"


CLOSED_FORM = Method(2, closed_form=True)
"""The method of dyads."""
ONE_WAY = Method(1, closed_form=True)
"""The method of trains of wheels, which have one mode."""


def solutions(
    group: Group, closure: Closure, given: Floats | None = None
) -> tuple[list[Floats], Method]:
    """Return the closed configurations (variables,) of a group, and the method.

    All of them where an elimination applies and is sound, else those that it and a
    search from random starts find, which tries those `given` (n, variables) first.
    `closure` is the group's own, with a single sample.
    The order is that of the angles and the same every time.
    """
    distinct = Distinct(closure)
    method = Method(0)
    eliminated = candidates(group, closure)
    if eliminated is not None:
        problem = eliminated.problem
        result = closure.solve(eliminated.values, iterations=POLISHING_STEPS)
        closed = result.residual < CLOSURE_TOLERANCE
        moved = np.abs(wrap(result.values - eliminated.values))
        kept = closed & (np.max(moved, axis=1, initial=0.0) < MOVED)
        if np.any(eliminated.real & ~kept):
            problem = problem or "a real root led to no closed configuration"
        distinct.add(result.values[closed])
        method = Method(0 if problem else eliminated.roots, problem)
    if not method.is_complete:
        census = search(closure, distinct, given)
        method = replace(method, census=census)
    values = distinct.values
    values.sort(key=in_order)
    return values, method


def in_order(mode: Floats) -> list[float]:
    """Return a key that puts modes in order by their angles, whatever rounding does.

    Angles of a half turn are above zero, on either side of where they begin anew.
    """
    angles = np.round(wrap(mode), DIGITS)
    turned = np.where(angles <= np.round(-np.pi, DIGITS), -angles, angles)
    return [float(angle) for angle in turned]


def least_complete(one: Method | None, other: Method | None) -> Method | None:
    """Return the method that guarantees less; None stands for not used."""
    if one is None or other is None:
        return one or other
    return max(one, other, key=lambda method: method.doubt)
