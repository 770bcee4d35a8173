"""Closes the loops of bodies joined by pairs, by Newton's method.

The unknowns are the variables of the pairs: one angle of an R pair, one arc length of a
rolling contact, two of a sliding contact. A spanning tree of pairs places every body in the
axes of body 0. Each remaining pair, a chord, closes one loop. The closure residual is the
rotation vector between the frames that the two bodies of a chord give to it. Bodies are
links, or groups of links whose relative orientation differs from sample to sample.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.joint import Joint
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.linear_equations import solve_least_norm
from spherekit.positions.linearisation import Linearisation, Locks
from spherekit.positions.loop_tree import LoopTree

ROUNDED_RESIDUAL_RAD = 1e-15
"""Loops with a smaller closure residual are not changed by Newton's method.

Larger: configurations keep avoidable errors. Smaller: steps follow rounding errors.
"""
LAST_NEWTON_STEP_RAD = 1e-8
"""Newton's method ends with a step that is smaller.

It converges quadratically, so that the error after the step is about the square of it.
Larger: the error can exceed rounding. Smaller: steps without effect are taken.
"""
TINY_STEP_RAD = 1e-300
"""Replaces a step of length zero as a divisor."""


class NewtonSteps(NamedTuple):
    """Sizes of the first two Newton steps from n starts.

    Both attributes are small if the start was near a solution. When a curve of
    configurations is followed, a large value shows that the result may be on another curve.

    Attributes
    ----------
    first_step
        (n,) the largest component of the first Newton step (rad). `newton` may take a
        shorter step, but this is the full one.
    contraction
        (n,) the largest component of the second Newton step, divided by `first_step`. 0 if
        there was one step only.
    """

    first_step: Floats
    contraction: Floats


def newton(
    compute_steps: Callable[[Floats, Indices], Floats],
    values: Floats,
    max_steps: int,
    last_step: float = 0.0,
    longest_step: float = np.inf,
) -> tuple[Floats, NewtonSteps]:
    """Take Newton steps from n start values at the same time.

    Each start is a row of the arrays. The steps from a start end independently of the other
    starts.

    Parameters
    ----------
    compute_steps
        Function that computes the steps. It takes the values (k, variables) of some rows
        and the indices (k,) of these rows, and returns the Newton steps (k, variables).
    values
        (n, variables) start values (rad). They are not changed.
    max_steps
        Largest number of steps from a start.
    last_step
        The steps from a start end when no variable changes by more than this (rad), or when
        the step is NaN.
    longest_step
        Largest change of a variable (rad) in one step. Longer steps are shortened.

    Returns
    -------
    values
        (n, variables) values after the last step, converged or not.
    newton_steps
        Size of the first step of each start (rad), and the ratio of the second step to the
        first. Both numbers are small if the start was near a solution. Large numbers warn
        the caller that the result may be another solution than the one sought.
    """
    values = values.copy()
    active_rows = np.arange(len(values))
    first_step = np.zeros(len(values))
    second_step = np.zeros(len(values))
    for step_number in range(max_steps):
        step = compute_steps(values[active_rows], active_rows)
        length = max_abs(step, axis=1)
        if step_number == 0:
            first_step[active_rows] = length
        elif step_number == 1:
            second_step[active_rows] = length
        # Steps longer than the limit are shortened in the same direction. `TINY_STEP_RAD`
        # avoids division by zero.
        fraction = np.minimum(1.0, longest_step / np.maximum(length, TINY_STEP_RAD))
        values[active_rows] += step * fraction[:, None]
        active_rows = active_rows[length > last_step]  # Rows with a longer step go on.
        if not len(active_rows):
            break
    contraction = second_step / np.maximum(first_step, TINY_STEP_RAD)
    return values, NewtonSteps(first_step, contraction)


@dataclass(frozen=True)
class Closure:
    """The equations that close the loops of a chain of bodies, at n samples.

    A sample is one choice of the inputs.

    Attributes
    ----------
    tree
        The bodies, the pairs that join them, and their loops.
    joints
        The joint of each pair.
    body_from_links
        Two arrays (n or 1, pairs, 3, 3) of rotations from the axes of the first and of the
        second link of each pair to the axes of its body, if bodies are groups of links.
        None if each body is one link.
    locks
        Indices of locked variables, with the values (n or 1, locks) at which they are
        locked (rad). None if no variable is locked.
    """

    tree: LoopTree
    joints: tuple[Joint, ...]
    body_from_links: tuple[Floats, Floats] | None = None
    locks: Locks | None = None

    @staticmethod
    def of_mechanism(mechanism: Mechanism, joints: tuple[Joint, ...]) -> "Closure":
        """Return the closure of a whole mechanism, in which each link is a body."""
        return Closure(LoopTree.of_mechanism(mechanism), joints)

    def select_rows(self, rows: Indices) -> "Closure":
        """Return the loop equations at some of the samples, by their indices (k,).

        Arrays with a single row belong to all samples, so they are not indexed.
        """
        body_from_links = self.body_from_links
        locks = self.locks
        if body_from_links is not None and len(body_from_links[0]) > 1:
            body_from_links = body_from_links[0][rows], body_from_links[1][rows]
        if locks is not None and len(locks[1]) > 1:
            locks = locks[0], locks[1][rows]
        return replace(self, body_from_links=body_from_links, locks=locks)

    def locked(self, variables: Sequence[int], values: Floats) -> "Closure":
        """Return the closure with variables locked at values (n or 1, variables) rad."""
        return replace(self, locks=(list(variables), values))

    def linearise(self, values: Floats) -> Linearisation:
        """Return the closure linearised at configurations (n, variables) in rad."""
        return Linearisation(
            tree=self.tree,
            joints=self.joints,
            values=values,
            body_from_links=self.body_from_links,
            locks=self.locks,
        )

    def solve(
        self,
        values: Floats,
        fixed: Sequence[int] = (),
        max_steps: int = 12,
        longest_step: float = 0.5,
    ) -> Linearisation:
        """Close the loops by Newton's method, independently for each sample.

        A loop is a closed chain of bodies that are joined by pairs (joints). The unknowns
        are the variables of the pairs, for example angles of revolute pairs.

        Parameters
        ----------
        values
            (n, variables) start values (rad).
        fixed
            Indices of the variables that stay constant, for example those of the inputs.
        max_steps
            Largest number of steps.
        longest_step
            Largest change (rad) of a variable in one step.

        Returns
        -------
        The loop equations, linearised at the values after the last step. Its attribute
        `values` has these values. Newton's method may fail, so `closure_residual` tells by
        how much (rad) the loops of each sample are still open.
        """
        linearisation, _ = self.solve_and_report_steps(
            values, fixed, max_steps=max_steps, longest_step=longest_step
        )
        return linearisation

    def solve_and_report_steps(
        self,
        values: Floats,
        fixed: Sequence[int],
        max_steps: int,
        longest_step: float = 0.5,
    ) -> tuple[Linearisation, NewtonSteps]:
        """Close the loops as `solve` does, and report the sizes of the first steps.

        Small first steps show that the start values were near a solution.

        Parameters
        ----------
        values
            (n, variables) start values (rad).
        fixed
            Indices of the variables that stay constant.
        max_steps
            Largest number of steps.
        longest_step
            Largest change (rad) of a variable in one step.

        Returns
        -------
        linearisation
            The loop equations, linearised at the values after the last step, as `solve`
            returns them.
        newton_steps
            For each sample the first step (rad), and the ratio of the second step to the
            first.
        """
        # The passive variables, which are not fixed, are the unknowns of Newton's method.
        passive = np.delete(np.arange(values.shape[1]), fixed)
        values = values.copy()

        def compute_steps(passive_values: Floats, rows: Indices) -> Floats:
            """Return Newton steps (k, passive variables) of the samples `rows`.

            The steps solve J step = -F with the closure errors F and their derivatives J.
            Samples that are closed up to rounding have zero steps, so that they end at
            once.
            """
            all_values = values[rows]
            all_values[:, passive] = passive_values
            steps = np.zeros_like(passive_values)
            linearisation = self.select_rows(rows).linearise(all_values)
            is_open = linearisation.closure_residual > ROUNDED_RESIDUAL_RAD
            steps[is_open] = solve_least_norm(
                linearisation.jacobian[is_open][:, :, passive],
                -linearisation.residual[is_open],
            )
            return steps

        values[:, passive], newton_steps = newton(
            compute_steps,
            values[:, passive],
            max_steps=max_steps,
            last_step=LAST_NEWTON_STEP_RAD,
            longest_step=longest_step,
        )
        return self.linearise(values), newton_steps
