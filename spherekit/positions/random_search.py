"""Searches closed configurations from random starts, and estimates how many were missed.

From each start the sum of squared closure residuals is minimised by the Levenberg-Marquardt
method. The search proves nothing. But the number of starts that led to each configuration
is counted. It decides when the search stops, and shows how reliable the search is: a
configuration to which as many starts lead as to the rarest one found would hardly have been
missed.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.joint import ContactProfile
from spherekit.numerics.least_squares import minimize_squares
from spherekit.positions.loop_closure import Closure
from spherekit.positions.pair_states import has_penetration, list_rolling_variables
from spherekit.progress import ProgressReporter
from spherekit.tolerances import CLOSURE_TOLERANCE, EPS
from spherekit.wording import counted

SEED = 20240616
"""Seed of the random starts. A fixed seed gives the same starts in every run."""
STARTS_PER_ROUND = 192
"""Number of random starts that are made together. Larger: more memory. Smaller: slower."""
MIN_ROUNDS = 2
"""Least number of rounds. A search in which no start closes makes twice as many."""
MAX_ROUNDS = 32
"""Largest number of rounds. Larger: rarer configurations are found, in more time."""
MAX_WORK = 5e6
"""Largest number of starts, times the square of the number of variables.

The time of a start grows with about this square. Larger: more time for large mechanisms.
"""
MIN_HITS = 8
"""A search ends when at least this number of starts has led to each configuration.

Larger: fewer configurations are missed, in more time.
"""
MISS_PROBABILITY = 0.01
"""Probability of missing a configuration to which the reported share of starts leads."""

NEWTON_START_RAD = 1e-6
"""Root of the sum of squared residuals below which Newton's method closes the loops.

Larger: Newton's method may fail or lead elsewhere. Smaller: more steps of the slower
Levenberg-Marquardt method.
"""
POLISHING_STEPS = 40
"""Largest number of Newton steps that close a configuration at the end.

At a double solution a step only halves the error.
"""
SAME_MODE = 1e-6
"""Configurations are one mode if no component of their rotation matrices differs by more.

Rotation matrices have no unit; the number is also a difference of angles in rad.

Larger: modes that nearly coincide are taken for one. Smaller: one mode counts several
times.
"""
SAME_DEAD_CENTRE = 1e-3
"""Upper limit of the tolerance `SAME_MODE` at a dead centre, where errors are largest."""
MAX_MODES = 64
"""Largest number of configurations of one group that are kept.

A group that can move has infinitely many configurations.
"""
MAX_SINGULAR_MODES = 4
"""Largest number of kept configurations in which the group can move, or nearly so."""
SINGULAR_MODE_RATIO = 1e-9
"""Relative singular value of the closure Jacobian below which a group can move."""
ERROR_SPREAD = 8.0
"""Largest difference of two copies of one solution, over the error to first order."""


@dataclass
class SearchStatistics:
    """Counts how often random starts led to each of the solutions that were found.

    The counts tell when the search can end: once every solution was found often, few can be
    missing. Solutions, for example closed configurations, are numbered from 0 in the order
    in which they were found. A round is `STARTS_PER_ROUND` starts, which are tried
    together.

    Attributes
    ----------
    variable_count
        Number of unknowns of a start.
    min_rounds
        Number of rounds after which `needs_more_starts` can end the search at the earliest.
    starts
        Number of starts so far.
    counts
        Number of starts that led to each solution, by the index of the solution.
    """

    variable_count: int
    min_rounds: int = MIN_ROUNDS
    starts: int = 0
    counts: Counter[int] = field(default_factory=Counter)

    def add(self, starts: int, hits: Indices, total: int) -> None:
        """Count the starts of one round of a random search, and where they led.

        Parameters
        ----------
        starts
            Number of starts.
        hits
            (k,) index of the solution to which each start led. Starts without a solution
            are -1, or are left out.
        total
            Number of solutions that are known so far, including those that no start has
            reached.
        """
        self.starts += starts
        # `update` adds to the counts. Adding 0 also creates counts for solutions that no
        # start has reached.
        self.counts.update(dict.fromkeys(range(total), 0))
        self.counts.update(hits[hits >= 0].tolist())

    @property
    def closed_starts(self) -> int:
        """Number of starts that led to a solution."""
        return self.counts.total()

    @property
    def needs_more_starts(self) -> bool:
        """Whether another round of starts is to be made."""
        rounds = self.starts / STARTS_PER_ROUND
        if rounds < self.min_rounds:
            return True
        if rounds >= MAX_ROUNDS or self.starts * self.variable_count**2 > MAX_WORK:
            return False
        if not self.closed_starts:
            return rounds < 2 * self.min_rounds
        return min(self.counts.values()) < MIN_HITS

    @property
    def missed_share(self) -> float:
        """Largest share of starts that may lead to a solution that was missed.

        If a share p of all starts leads to a solution, n starts all miss it with the
        probability (1 - p)^n. The result is the p for which this is `MISS_PROBABILITY`.
        """
        return 1.0 - MISS_PROBABILITY ** (1.0 / max(self.starts, 1))

    def sentence(self, mode_count: int) -> str:
        """Return sentences for users that say how likely a mode was missed.

        An assembly mode is one way to assemble the mechanism; modes are searched from
        random starts.

        Parameters
        ----------
        mode_count
            Number of assembly modes found. The statistics count curves of configurations,
            each of which can have several modes.
        """
        starts = counted(self.starts, "random start")
        # No start has led to a closed configuration. Modes can be known in another way, for
        # example from the reference pose.
        if not self.closed_starts:
            further = "further " if mode_count else ""
            return f"A search from {starts} found no {further}assembly mode."
        modes = counted(mode_count, "mode")
        # A mode to which this share of all starts leads is missed with the probability
        # `MISS_PROBABILITY`. The sentence writes the share as 1 in so many starts.
        share_of_starts = self.missed_share
        one_in = round(1.0 / share_of_starts)
        return (
            f"{starts} found {modes}. A mode that at least 1 in "
            f"{one_in} such starts reach has been found with a probability of "
            f"{1.0 - MISS_PROBABILITY:.0%}. A mode that fewer starts reach could be missed."
        )

    def progress_text(self, things: str) -> str:
        """Return the progress of the search in a few words.

        Parameters
        ----------
        things
            The word for solutions in the plural, such as "modes".
        """
        count = sum(count > 0 for count in self.counts.values())
        return f"{counted(count, things.removesuffix('s'))} found"

    def describe(self, things: str) -> str:
        """Return a summary of the random search that says how likely a solution was missed.

        Example: "1536 random starts, 812 closed on 3 curves, on each at least 9 times; one
        to which 0.30% of all starts lead would have been found with a probability of 99%".
        A start has closed if it led to a solution. In the example, 0.30% is `missed_share`,
        and 99% is 1 - `MISS_PROBABILITY`.

        Parameters
        ----------
        things
            The word for solutions in the plural, such as ``curves``.
        """
        result = f"{self.starts} random starts"
        if not self.closed_starts:
            result += ", none closed"
        else:
            # How often each solution was reached.
            counts = [*self.counts.values()]
            counted_things = counted(len(counts), things.removesuffix("s"))
            result += f", {self.closed_starts} closed on {counted_things}, on "
            if min(counts) > 1:
                result += f"each at least {min(counts)} times"
            else:
                # No start may have reached a solution that was found in another way.
                never_count = counts.count(0)
                once_count = counts.count(1)
                # Good's estimate of the probability that the next closing start finds a new
                # solution.
                new_probability = once_count / self.closed_starts
                result += (
                    f"{never_count + once_count} of them at most once, so that about "
                    f"{new_probability:.1%} of further starts that close would lead to "
                    "a new one"
                )
        return (
            f"{result}; one to which {self.missed_share:.2%} of all starts lead would "
            f"have been found with a probability of {1.0 - MISS_PROBABILITY:.0%}"
        )


def descend_to_closure(
    closure: Closure,
    values: Floats,
    fixed: Sequence[int] = (),
    low: Floats | float = -np.inf,
    high: Floats | float = np.inf,
) -> tuple[Floats, Bools]:
    """Minimise the sum of squared closure errors, independently from many starts.

    This brings random starts near to closed loops, where Newton's method can take over. The
    closure errors are angles (rad) by which the loops of links are open. A descent can end
    with open loops.

    Parameters
    ----------
    closure
        The loops, as equations for the pair variables.
    values
        (n, variables) start values (rad).
    fixed
        Indices of the variables that stay constant.
    low, high
        (variables,) limits of the variables (rad).

    Returns
    -------
    values
        (n, variables) values at the ends of the descents (rad).
    is_near_closed
        (n,) whether the errors there are so small that Newton's method can close the loops.
    """
    # The unknowns are the variables that are not fixed.
    free = [v for v in range(values.shape[1]) if v not in fixed]
    free_low = np.broadcast_to(low, values.shape[1])[free]
    free_high = np.broadcast_to(high, values.shape[1])[free]
    values = values.copy()

    def evaluate_residuals(free_values: Floats, rows: Indices) -> tuple[Floats, Floats]:
        """Return the closure errors (k, equations) of k starts, and their derivatives.

        The closure errors are by how much the loops are open.

        `rows` (k,) are the indices of the starts. `free_values` are their present values of
        the variables that are not fixed.
        """
        all_values = values[rows]
        all_values[:, free] = free_values
        linearisation = closure.select_rows(rows).linearise(all_values)
        return linearisation.residual.copy(), linearisation.jacobian[:, :, free]

    # A descent ends early when the root of its sum of squares is below `NEWTON_START_RAD`,
    # because Newton's method can close the loops from there. `squares` (n,) are the sums of
    # squares at the ends.
    values[:, free], squares = minimize_squares(
        evaluate_residuals,
        values[:, free],
        free_low,
        free_high,
        sufficient_root=NEWTON_START_RAD,
    )
    is_near_closed = squares < NEWTON_START_RAD**2
    return values, is_near_closed


@dataclass(frozen=True)
class WheelRepetition:
    """Which of two wheels in contact makes whole revolutions between two configurations.

    The wheels roll on each other from one configuration to the other. A wheel makes whole
    revolutions if it touches at the same point of its profile in both configurations. This
    information serves to recognise configurations that differ only by such revolutions.

    Attributes
    ----------
    repeated_wheel
        Index of a wheel (a body) that makes whole revolutions.
    turned_wheel
        Index of the other wheel, if it touches at different points of its profile. Its
        orientation may then differ. None if it makes whole revolutions, too.
    """

    repeated_wheel: int
    turned_wheel: int | None


@dataclass(frozen=True)
class RolledLength:
    """The variable that measures how far two wheels have rolled on each other.

    The variable serves to recognise configurations that differ only by whole revolutions of
    wheels.

    Attributes
    ----------
    variable
        Index of the variable among those of the group of bodies. The value of the variable
        is an arc length (rad).
    profiles
        The profiles (rims) of the two wheels.
    wheels
        The indices of the bodies of the two wheels, in the same order.
    """

    variable: int
    profiles: tuple[ContactProfile, ...]
    wheels: tuple[int, int]

    def find_repetition(self, additional_length: float) -> WheelRepetition | None:
        """Find the wheel that makes whole revolutions between two configurations.

        The caller has to know whether two configurations differ only by whole revolutions
        of wheels, because they then count as one. From one configuration to the other, the
        two wheels roll on each other. After whole revolutions, a wheel touches at the same
        point of its profile again. It is called the repeated wheel. If the other wheel
        touches at another point of its profile, its orientation may differ. It is then
        called the turned wheel, and the caller does not compare its orientation.

        Parameters
        ----------
        additional_length
            Arc length (rad) by which the two wheels have rolled on each other between two
            configurations. The length is the same on both profiles.

        Returns
        -------
        The repeated and the turned wheel. None if neither has made whole revolutions.
        """
        first_profile, second_profile = self.profiles
        first_repeats = _is_whole_circumference(first_profile, additional_length)
        second_repeats = _is_whole_circumference(second_profile, additional_length)
        first_wheel, second_wheel = self.wheels
        if first_repeats and second_repeats:
            # Both have made whole revolutions. The first one is chosen as the repeated
            # wheel, and there is no turned wheel.
            return WheelRepetition(repeated_wheel=first_wheel, turned_wheel=None)
        if first_repeats:
            return WheelRepetition(repeated_wheel=first_wheel, turned_wheel=second_wheel)
        if second_repeats:
            return WheelRepetition(repeated_wheel=second_wheel, turned_wheel=first_wheel)
        return None


def _is_whole_circumference(profile: ContactProfile, length: float) -> bool:
    """Return whether a rolled length (rad) is a whole number of turns of a closed profile.

    If so, the contact is in the same state again. False for an open profile.
    """
    if not profile.curve.closed:
        return False
    revolutions = length / profile.curve.length
    return abs(revolutions - round(revolutions)) <= SAME_MODE


@dataclass(frozen=True)
class ClosedConfiguration:
    """A closed configuration of a group of bodies, with data to recognise copies.

    A copy is the same configuration, computed from another start.

    Attributes
    ----------
    values
        (variables,) its variables (rad).
    rotations
        (bodies, 3, 3) rotations from body axes to those of body 0.
    copy_tolerance
        Largest difference between components of rotation matrices at which another
        configuration counts as a copy.
    is_singular
        Whether the group may be movable although the inputs are locked.
    """

    values: Floats
    rotations: Floats
    copy_tolerance: float
    is_singular: bool


class DistinctConfigurations:
    """Closed configurations of one group at one sample that differ from each other.

    A search adds its results here, copies included, and each assembly mode is stored once.
    Two configurations are copies in two cases:

    - They differ by less than their errors. At a dead centre the loops open only to second
      order, so a configuration with a small residual can be far from the exact one.
    - They differ by whole revolutions of wheels that roll on each other.

    Parameters
    ----------
    closure
        The loop equations of the group, with a single sample.

    Attributes
    ----------
    is_truncated
        Whether new configurations were left out because of `MAX_MODES` or
        `MAX_SINGULAR_MODES`.
    """

    def __init__(self, closure: Closure) -> None:
        """Begin with an empty collection; the class describes the argument."""
        self.closure = closure
        # True as soon as a new configuration is left out because there are too many.
        self.is_truncated = False
        self._configurations: list[ClosedConfiguration] = []
        # Lengths by which wheels have rolled on each other, to find configurations that
        # differ only by whole revolutions of wheels. The circumference of a profile is the
        # length of a revolution. `wheels` are the bodies that have these profiles.
        ends = closure.tree.ends
        self._rolled_lengths = [
            RolledLength(
                variable=variable,
                profiles=joint.contact_profiles,
                wheels=ends[closure.tree.pair_of_variable[variable]],
            )
            for variable, joint in list_rolling_variables(closure.joints)
        ]
        # The number of joints at each body, by the index of the body. A wheel that has only
        # its bearing and one contact can turn without moving other bodies.
        self._joint_counts = Counter(chain.from_iterable(ends))

    @property
    def values(self) -> list[Floats]:
        """Variables (variables,) in rad of each configuration, at most `MAX_MODES`."""
        return [configuration.values for configuration in self._configurations]

    def add(self, values: Floats) -> Indices:
        """Add those of the given closed configurations of a group that are new.

        A group is a set of bodies that are placed together. A configuration is left out if
        contact profiles enter each other, or are too short to reach the contact point. Each
        configuration is stored with two numbers:

        - `copy_tolerance`: a configuration that differs by less counts as the same.
        - `is_singular`: whether the group may be movable although the inputs are locked.
          A movable group has infinitely many configurations, so only a few are stored.

        Configurations that differ by whole revolutions of wheels count as one. The
        configuration whose wheels have rolled least is added first, and represents the
        others.

        Parameters
        ----------
        values
            (n, variables) closed configurations (rad).

        Returns
        -------
        (n,) index in `self.values` of each configuration, also if it was known before. -1
        if it was left out.
        """
        indices = np.full(len(values), -1, dtype=np.intp)
        # Closure errors and their derivatives (the Jacobian), and the states of contacts.
        linearisation = self.closure.linearise(values)
        # `inside` says whether the contact points are on the profiles.
        exists = np.all(linearisation.states.inside, axis=1)
        exists &= ~has_penetration(self.closure.joints, linearisation.states)
        # The group may be movable if the smallest singular value of the Jacobian is nearly
        # 0, compared with the largest.
        singular_values = np.linalg.svd(linearisation.jacobian, compute_uv=False)
        largest, smallest = singular_values[:, 0], singular_values[:, -1]
        is_singular = smallest < SINGULAR_MODE_RATIO * largest
        copy_tolerance = compute_copy_tolerances(
            linearisation.closure_residual, np.asarray(smallest)
        )
        # Sum of the lengths by which wheels have rolled on each other.
        rolled_variables = [length.variable for length in self._rolled_lengths]
        rolled_sum = np.sum(np.abs(values[:, rolled_variables]), axis=1)
        rows_by_rolling = np.argsort(rolled_sum, kind="stable").tolist()
        for row in rows_by_rolling:
            if exists[row]:
                indices[row] = self._add_configuration(
                    ClosedConfiguration(
                        values=values[row],
                        rotations=linearisation.rotations[row],
                        copy_tolerance=float(copy_tolerance[row]),
                        is_singular=bool(is_singular[row]),
                    )
                )
        return indices

    def _add_configuration(self, configuration: ClosedConfiguration) -> int:
        """Store a configuration unless it is a copy, and return its index.

        For a copy, the index of the equal stored configuration is returned. The result is
        -1 if there is no room for a new configuration.
        """
        index_of_copy = self._find_copy(configuration)
        if index_of_copy is not None:
            return index_of_copy
        if not self._has_room(configuration):
            self.is_truncated = True
            return -1
        self._configurations.append(configuration)
        return len(self._configurations) - 1

    def _has_room(self, configuration: ClosedConfiguration) -> bool:
        """Return whether one more configuration may be stored.

        A group that can move with locked inputs has infinitely many singular
        configurations. Singular configurations have a lower limit, so that they leave room
        for regular ones.
        """
        if len(self._configurations) >= MAX_MODES:
            return False
        singular_count = sum(stored.is_singular for stored in self._configurations)
        return not (configuration.is_singular and singular_count == MAX_SINGULAR_MODES)

    def _find_copy(self, configuration: ClosedConfiguration) -> int | None:
        """Return the index of the first stored configuration that is the same, or None.

        Two configurations are the same if all bodies are oriented alike, or if they differ
        only by whole revolutions of wheels that roll on each other.
        """
        if not self._configurations:
            return None
        # (stored configurations, bodies, 3, 3)
        stored_rotations = np.array([stored.rotations for stored in self._configurations])
        differences = max_abs(stored_rotations - configuration.rotations, axis=(1, 2, 3))
        # Both configurations are computed with errors. The larger tolerance counts.
        tolerances = np.maximum(
            configuration.copy_tolerance,
            [stored.copy_tolerance for stored in self._configurations],
        )
        is_equal = differences <= tolerances
        for index, stored in enumerate(self._configurations):
            if is_equal[index] or self._is_repetition(configuration, stored):
                return index
        return None

    def _is_repetition(
        self, configuration: ClosedConfiguration, stored: ClosedConfiguration
    ) -> bool:
        """Return whether one configuration repeats another after whole revolutions.

        Such configurations count as one, because whole revolutions of the inputs lead from
        one to the other. Three conditions must hold:

        - At each contact at which two wheels have rolled on, one of them has made whole
          revolutions: it touches at the same point of its profile again. It is called the
          repeated wheel. The other wheel may touch at another point of its profile. It is
          then called the turned wheel.
        - A turned wheel moves no other body.
        - All bodies except turned wheels have the same orientations relative to each other.
        """
        # One repetition for each contact at which wheels have rolled on, with the indices
        # of its two wheels. The list is empty if no wheels have rolled on, or if at some
        # contact neither wheel touches at the same point again.
        repetitions = self._find_repetitions(configuration.values - stored.values)
        if not repetitions:
            return False
        turned_wheels = set()
        for repetition in repetitions:
            if repetition.turned_wheel is not None:
                turned_wheels.add(repetition.turned_wheel)
        # A turned wheel may have two joints only: the contact and its bearing. With further
        # joints, it would have moved other bodies.
        if any(self._joint_counts[wheel] > 2 for wheel in turned_wheels):
            return False
        # The orientations of all bodies except turned wheels are compared relative to one
        # body. Any body that is compared could serve. It is the repeated wheel of the last
        # contact.
        repeated_wheel = repetitions[-1].repeated_wheel
        return _have_equal_orientations(
            configuration.rotations,
            stored.rotations,
            reference_body=repeated_wheel,
            ignored_bodies=turned_wheels,
        )

    def _find_repetitions(self, differences: Floats) -> list[WheelRepetition]:
        """Return which wheels have made whole revolutions, for each contact.

        `_is_repetition` needs this to decide whether one configuration repeats another. It
        can do so only if, at each contact at which two wheels have rolled on, one of them
        has made whole revolutions. This wheel touches at the same point of its profile
        again. A `WheelRepetition` names both wheels.

        Parameters
        ----------
        differences
            (variables,) differences of the variables (rad) between two configurations.

        Returns
        -------
        One repetition for each contact with a changed rolled length. Empty if no length has
        changed. Also empty if at some contact neither wheel has made whole revolutions,
        because no configuration is then repeated.
        """
        repetitions = []
        for rolled_length in self._rolled_lengths:
            additional_length = float(differences[rolled_length.variable])
            # `SAME_MODE` is a tolerance of angles and arc lengths (rad).
            if abs(additional_length) <= SAME_MODE:
                continue  # These two wheels have not rolled on.
            repetition = rolled_length.find_repetition(additional_length)
            if repetition is None:
                return []
            repetitions.append(repetition)
        return repetitions


def _have_equal_orientations(
    rotations: Floats,
    other_rotations: Floats,
    reference_body: int,
    ignored_bodies: set[int],
) -> bool:
    """Return whether bodies have equal relative orientations in two configurations.

    This is a part of the test whether two configurations differ only by whole revolutions
    of wheels that touch (`_is_repetition`).

    Parameters
    ----------
    rotations, other_rotations
        (bodies, 3, 3) rotations from the axes of each body to those of body 0, in the two
        configurations.
    reference_body
        Index of the body relative to which the orientations are compared.
    ignored_bodies
        Indices of bodies that are not compared: wheels that have rolled on to another point
        of their profiles.

    Returns
    -------
    Whether no component of the compared rotation matrices differs by more than `SAME_MODE`.
    """
    bodies = [body for body in range(len(rotations)) if body not in ignored_bodies]
    orientations = rotations[reference_body].T @ rotations[bodies]
    other_orientations = other_rotations[reference_body].T @ other_rotations[bodies]
    return bool(np.max(np.abs(orientations - other_orientations)) <= SAME_MODE)


def compute_copy_tolerances(residual: Floats, smallest_singular_value: Floats) -> Floats:
    """Return how much copies of a solution, computed from different starts, may differ.

    To first order, the error of a solution is its closure error divided by the smallest
    singular value of the Jacobian of the loops. Copies may differ by `ERROR_SPREAD` times
    this error. The tolerance is at least `SAME_MODE`, for rounding. The tolerance is at
    most `SAME_DEAD_CENTRE`, so that two modes near a dead centre stay distinct.

    Parameters
    ----------
    residual
        (n,) closure errors of the loops (rad).
    smallest_singular_value
        (n,) smallest singular values of the Jacobians.

    Returns
    -------
    (n,) tolerances of the components of rotation matrices.
    """
    error = np.maximum(residual, EPS) / np.maximum(smallest_singular_value, EPS)
    return np.clip(ERROR_SPREAD * error, SAME_MODE, SAME_DEAD_CENTRE)


def search_group(
    closure: Closure, distinct: DistinctConfigurations, start_values: Floats | None = None
) -> SearchStatistics:
    """Search the closed configurations of a group at fixed inputs from random starts.

    A group is a set of bodies that are placed together by closing their loops. The search
    ends when each configuration was reached often enough, at the limits of
    `SearchStatistics`, or when there are `MAX_MODES`.

    Parameters
    ----------
    closure
        The loop equations of the group, at one sample of the inputs.
    distinct
        The configurations known so far. New ones are added to this object.
    start_values
        (n, variables) starts (rad) that are tried before the random ones.

    Returns
    -------
    How often the random starts led to each configuration.
    """
    random = np.random.default_rng(SEED)
    low, high = starting_range(closure)
    if start_values is not None:
        distinct.add(_close_by_newton(closure, start_values))
    statistics = SearchStatistics(variable_count=len(low))
    progress = ProgressReporter("searching the modes of a group at an input")
    while statistics.needs_more_starts and len(distinct.values) < MAX_MODES:
        starts = random.uniform(low, high, (STARTS_PER_ROUND, len(low)))
        # Newton's method fails from most random starts. The Levenberg-Marquardt method
        # comes first. This method leads near a closed configuration, or to a minimum with
        # open loops.
        values, is_near_closed = descend_to_closure(closure, starts)
        # Index of the configuration to which each start has led. -1 if `distinct` leaves it
        # out, for example because profiles enter each other.
        hits = distinct.add(_close_by_newton(closure, values[is_near_closed]))
        statistics.add(STARTS_PER_ROUND, hits=hits, total=len(distinct.values))
        progress.report_if_due(lambda: statistics.progress_text("modes"))
    return statistics


def _close_by_newton(closure: Closure, values: Floats) -> Floats:
    """Return the closed configurations (k, variables) that Newton's method reaches.

    `values` (n, variables) are its starts (rad). Starts from which it does not converge
    give no configuration.
    """
    if not len(values):
        return values
    linearisation = closure.solve(values, max_steps=POLISHING_STEPS)
    return linearisation.values[linearisation.closure_residual < CLOSURE_TOLERANCE]


def starting_range(closure: Closure) -> tuple[Floats, Floats]:
    """Return the limits (variables,) in rad between which random starts are drawn.

    Both limits of a locked variable are the value at which it is locked.
    """
    ranges = [limits for joint in closure.joints for limits in joint.start_ranges]
    low, high = np.array(ranges).T
    if closure.locks is not None:
        variables, locked_values = closure.locks
        low[variables] = locked_values[0]
        high[variables] = locked_values[0]
    return low, high
