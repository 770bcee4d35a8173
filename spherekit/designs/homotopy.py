"""Tracks closed configurations from design to design and from one input to another.

If the inputs are not real, the solutions of the closure equations neither meet nor
disappear. All complex solutions of one design then lead to all solutions of another design
(coefficient-parameter continuation; Sommese and Wampler, The Numerical Solution of Systems
of Polynomials, 2005, chapter 7). Real solutions are tracked with smaller steps, so that
they do not jump to another assembly mode.

The complex solutions of the first design are found by elimination.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import prod

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.designs.path_kernel import NewtonStep, PathKernel
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.numerics.angles import wrap
from spherekit.positions.elimination_order import find_elimination_orders, has_elimination
from spherekit.positions.mode_coalescence import ModeCoalescence
from spherekit.positions.position_solver import PositionSolver

SLOPE_FRACTION = 2.0**-16
"""Fraction of a path at which the equations are first evaluated, for its direction.

Larger: a path that starts near a singular configuration gets a wrong direction. Smaller:
closure errors of the start make the direction inaccurate.
"""

MIN_PATH_STEP_FRACTION = 2.0**-20
"""A path is given up if its step is not longer than this fraction of the path.

Larger: paths near singular configurations are lost. Smaller: more time is spent on them.
"""

MAX_PATH_STEPS = 600
"""Largest number of steps that are tried along a path."""

MAX_FIRST_NEWTON_STEP_RAD = 0.3
"""Largest first Newton step (rad) after a prediction; longer ones shorten the path step.

Larger: a prediction may converge to another solution. Smaller: more steps.
"""

COMPLEX_CONTRACTION = 0.2
"""Largest ratio of the second Newton step to the first one along complex paths."""

SHORT_PATH_CONTRACTION = 0.125
LONG_PATH_CONTRACTION = 0.03125
"""Largest ratio of successive Newton steps along real paths (Kantorovich 1948).

The first Newton step is compared with the predicted change of the configuration, the second
one with the first. The larger ratio is for small deviations of sizes, where no other
assembly mode is near. Larger: fewer steps, and a path may jump to another mode. Smaller:
more steps.
"""

STEP_GROWTH_RATIO = 0.1
"""The path step is doubled if the contraction is better by this factor than required."""

NEGLIGIBLE_STEP_RAD = 1e-9
"""A second Newton step (rad) of this length is accepted whatever its contraction.

It is rounding rather than a jump to another mode.
"""

PATH_ERROR_RAD = 1e-6
"""A first Newton step (rad) of this length is accepted whatever the predicted change.

Otherwise a configuration that hardly changes would need an exact prediction.
"""

MAX_FINAL_STEPS = 5
"""Largest number of Newton steps at the end of a path."""

FINAL_STEP_RAD = 1e-10
"""The last Newton step (rad) at the end of a path is smaller.

For complex solutions the limit grows with the imaginary part, as does the next one.
"""

CLOSURE_TOLERANCE_RAD = 1e-11
"""Loops count as closed if the closure residual (rad) is smaller."""

MAX_IMAGINARY_PART_RAD = 12.0
"""Solutions with larger imaginary parts (rad) are not distinguished from infinite ones."""

SAME_SOLUTION_RAD = 1e-6
"""Solutions that differ by less (rad) count as the same solution."""

MAX_SOLUTIONS = 64
"""Largest number of complex solutions of a design for which all of them are tracked.

The effort of tracking a design is proportional to the number of solutions.
"""

START_IMAGINARY_PART_RAD = 0.7
"""Imaginary part (rad) of the inputs from which all solutions are tracked to the designs.

It is large enough that the solutions are well apart there.
"""

ProfileColumns = Callable[[Floats, Indices, Floats], Floats]
"""A function that returns the columns of profiles along paths.

Columns are the nine numbers that describe a profile at its point of contact: the tangent
(3), the point (3), the curvature and its first two derivatives.

The function takes variables (variables, k), the numbers (k,) of the paths and the path
parameters (k,) from 0 to 1. It returns columns (w, k), with w = 9 times the number of
profiles. They are NaN where there is no design.
"""

NO_INPUTS = np.zeros((0, 1)), np.zeros((0, 1))
"""Inputs at the ends of paths along which the inputs stay constant."""


@dataclass(frozen=True)
class PathProfiles:
    """Contact profiles of m designs, each of which lies on a path from design to design.

    A contact profile is the curve on a link that touches another link. A path changes the
    sizes from one design to another. Newton's method follows configurations along the path,
    and needs the profiles of the designs on the way. If all profiles are circles, this
    class is not used.

    Attributes
    ----------
    columns_at
        Function that returns the columns of the profiles: nine numbers that describe each
        profile at its point of contact (`ProfileColumns`).
    paths
        (m,) index of the path on which each design lies.
    parameters
        (m,) position of each design on its path: 0 at the start, 1 at the end.
    """

    columns_at: ProfileColumns
    paths: Indices
    parameters: Floats

    def select(self, indices: Indices) -> "PathProfiles":
        """Return the profiles of some of the m designs."""
        return PathProfiles(self.columns_at, self.paths[indices], self.parameters[indices])

    def evaluate(self, values: Array) -> Floats:
        """Return the columns of the profiles at some configurations.

        Parameters
        ----------
        values
            (variables, m) pair variables (rad), one configuration for each design.

        Returns
        -------
        (w, m) columns, with w = 9 times the number of profiles.
        """
        return self.columns_at(values, self.paths, self.parameters)


@dataclass(frozen=True)
class ClosureProblem:
    """The loop-closure equations of m designs.

    A design is one choice of sizes. Newton's method solves the equations for all designs
    together.

    Attributes
    ----------
    kernel
        The closure equations as functions, the same for all designs.
    prepared
        (k, m) the numbers in the equations that follow from the sizes of each design.
    profiles
        The contact profiles (curves) of the designs. None if all are circles.
    """

    kernel: PathKernel
    prepared: Floats
    profiles: PathProfiles | None = None

    def select(self, indices: Indices) -> "ClosureProblem":
        """Return the closure equations of some of the m designs."""
        profiles = self.profiles.select(indices) if self.profiles else None
        return ClosureProblem(self.kernel, self.prepared[:, indices], profiles)

    def newton_step(self, values: Array) -> NewtonStep:
        """Return a step of Newton's method from pair variables (variables, m) in rad."""
        numbers = self.prepared
        if self.profiles is not None:
            # The kernel takes the columns of profiles before the prepared numbers.
            numbers = np.concatenate([self.profiles.evaluate(values), numbers])
        return self.kernel.newton_step(values, numbers)


@dataclass(frozen=True)
class DesignPaths:
    """Paths along which sizes and inputs change, to follow solutions of closure equations.

    There are n paths. Along each, a parameter increases from 0 at the start to 1 at the
    end. An array with one column instead of n applies to all paths.

    Attributes
    ----------
    kernel
        The closure equations that all designs share.
    start_sizes, end_sizes
        (k, n) or (k, 1) sizes at start and end. Between them, sizes are linear functions of
        the parameter.
    start_inputs, end_inputs
        (inputs, n) or (inputs, 1) inputs (rad) at start and end.
    detour
        (inputs, 1) deviation (rad) of the inputs from a straight path, at half of the path.
        An imaginary detour leads around real inputs at which solutions meet, because
        tracking would fail at these inputs.
    profiles
        The numbers of the contact profiles along the paths; None if all profiles are
        circles.
    """

    kernel: PathKernel
    start_sizes: Floats
    end_sizes: Floats
    start_inputs: Array
    end_inputs: Array
    detour: Array | float
    profiles: ProfileColumns | None

    def inputs_at(self, paths: Indices, parameters: Floats) -> Array:
        """Return the inputs at one point of each of some paths.

        Along a path, sizes and inputs of a mechanism change from start to end. The inputs
        make a detour from the straight line. An imaginary `detour` leads through complex
        inputs, around real ones at which two solutions meet. Tracking would fail there.

        Parameters
        ----------
        paths
            (m,) numbers of the paths.
        parameters
            (m,) position of the point on its path, from 0 (start) to 1 (end).

        Returns
        -------
        (inputs, m) inputs (rad).
        """
        start = _columns_of_paths(self.start_inputs, paths)
        end = _columns_of_paths(self.end_inputs, paths)
        # A parabola that is zero at both ends and `detour` halfway.
        bulge = 4.0 * self.detour * parameters * (1.0 - parameters)
        return start + (end - start) * parameters + bulge

    def equations_at(self, paths: Indices, parameters: Floats) -> ClosureProblem:
        """Return the loop-closure equations at one point of each of some paths.

        Along a path, the sizes of a mechanism change linearly from one design to another.
        The equations also depend on the contact profiles, the curves along which links
        touch. `profiles` gives the numbers that describe these curves. It is None if there
        are no contacts or only circles.

        Parameters
        ----------
        paths
            (m,) numbers of the paths.
        parameters
            (m,) position of the point on its path, from 0 (start) to 1 (end).

        Returns
        -------
        The closure equations of the m designs at these points.
        """
        start = _columns_of_paths(self.start_sizes, paths)  # (sizes, m)
        end = _columns_of_paths(self.end_sizes, paths)
        sizes = start + (end - start) * parameters
        # Numbers in the equations that depend only on the sizes.
        prepared = self.kernel.prepare(sizes)
        if self.profiles is None:
            return ClosureProblem(self.kernel, prepared)
        path_profiles = PathProfiles(self.profiles, paths, parameters)
        return ClosureProblem(self.kernel, prepared, path_profiles)


def _columns_of_paths(values: Array, paths: Indices) -> Array:
    """Return the columns of some paths; a single column applies to all paths."""
    return values[:, paths] if values.shape[1] > 1 else values


def track_solutions(
    kernel: PathKernel,
    start: Array,
    sizes: tuple[Floats, Floats],
    inputs: tuple[Array, Array] = NO_INPUTS,
    detour: Array | float = 0.0,
    profiles: ProfileColumns | None = None,
    contraction: float = COMPLEX_CONTRACTION,
) -> tuple[Array, Bools]:
    """Follow solutions of the closure equations while sizes and inputs change.

    While the path parameter goes from 0 to 1, sizes and inputs go from start to end. Each
    step predicts the configuration by a parabola through the last three configurations. Two
    steps of Newton's method correct the prediction. A step is halved if Newton's method
    contracts too slowly, and doubled if it contracts quickly. All paths are tracked
    together; each has its own step.

    Parameters
    ----------
    kernel
        The closure equations of the topology.
    start
        (variables, n) solutions (rad) at the start of n paths. If the solutions are real, a
        step that changes the sign of the determinant is refused as a jump to another
        solution.
    sizes
        Sizes at the start and at the end, (k, n), or (k, 1) if all paths share them.
    inputs
        Inputs (rad) at the start and at the end, (inputs, n) or (inputs, 1).
    detour
        (inputs, 1) by how much the inputs (rad) deviate from the straight path halfway.
    profiles
        The numbers of the contact profiles along the paths, if profiles are not circles.
    contraction
        Largest ratio of successive Newton steps that is accepted.

    Returns
    -------
    solutions
        (variables, n) solutions (rad) at the ends of the paths.
    arrived
        (n,) whether each path was followed to its end and the loops are closed there.
    """
    path_count = start.shape[1]
    is_real_path = not np.iscomplexobj(start)
    design_paths = DesignPaths(kernel, *sizes, *inputs, detour, profiles)

    history = PathHistory(start)
    step = np.ones(path_count)
    start_sign = np.zeros(path_count)
    # The variables of the inputs that are set along the path; none with `NO_INPUTS`.
    driven = kernel.driven[: len(inputs[0])]
    # The paths that are still tracked. A path whose start is NaN never arrives.
    paths = np.flatnonzero(all_finite(start, 0))
    with np.errstate(all="ignore"):
        # The first slope follows from a Newton step at a small fraction of the path.
        near_start = start[:, paths]
        near_parameters = np.full(len(paths), SLOPE_FRACTION)
        near_start[driven] = design_paths.inputs_at(paths, near_parameters)
        equations = design_paths.equations_at(paths, near_parameters)
        first_step, determinant, _ = equations.newton_step(near_start)
        history.set_first_slope(paths, near_start + first_step, SLOPE_FRACTION)
        start_sign[paths] = np.sign(determinant.real)
        for _ in range(MAX_PATH_STEPS):
            if not len(paths):
                break
            target = np.minimum(history.reached(paths) + step[paths], 1.0)
            predicted = history.predict(paths, target)
            predicted[driven] = design_paths.inputs_at(paths, target)
            correction = _correct(design_paths.equations_at(paths, target), predicted)
            is_accepted = correction.contracts(contraction)
            if is_real_path:
                # These two conditions prevent a jump to another assembly mode.
                predicted_change = max_abs(predicted - history.current[:, paths], 0)
                is_accepted &= correction.first_length <= np.maximum(
                    contraction * predicted_change, PATH_ERROR_RAD
                )
                is_accepted &= np.sign(correction.determinant) == start_sign[paths]
            history.append(
                paths[is_accepted], correction.values[:, is_accepted], target[is_accepted]
            )
            contracts_quickly = (
                correction.second_length
                < STEP_GROWTH_RATIO * contraction * correction.first_length
            )
            step[paths[is_accepted & contracts_quickly]] *= 2.0
            step[paths[~is_accepted]] *= 0.5
            has_not_arrived = history.reached(paths) < 1.0
            paths = paths[has_not_arrived & (step[paths] > MIN_PATH_STEP_FRACTION)]
        arrived = history.reached(np.arange(path_count)) >= 1.0
        paths = np.flatnonzero(arrived)
        equations = design_paths.equations_at(paths, np.ones(len(paths)))
        solutions = history.current
        solutions[:, paths], arrived[paths] = converge_solutions(
            equations, solutions[:, paths]
        )
    return solutions, arrived


class PathHistory:
    """The last three points of each of n paths, from which the next point is predicted.

    Attributes
    ----------
    current
        (variables, n) configurations (rad) at the last points.
    parameters
        (3, n) path parameters of the last three points, from 0 to 1.
    slopes
        (2, variables, n) change of the configuration per path parameter between successive
        points.
    """

    def __init__(self, start: Array) -> None:
        """Begin with one point, the configurations `start` (variables, n)."""
        self.current = start.copy()
        # An earlier point at -1 only avoids a division by zero.
        self.parameters = np.zeros((3, start.shape[1]))
        self.parameters[0] = -1.0
        self.slopes = np.zeros((2, *start.shape), start.dtype)

    def set_first_slope(self, paths: Indices, next_values: Array, parameter: float) -> None:
        """Set the slopes at the start, from which the first step is predicted.

        A slope is the change of the configuration per path parameter, between two of the
        last three points. The two slopes predict the next point of a path. Before the first
        step there is only one point, so both slopes get the same value here. The caller
        computes an auxiliary configuration near the start for this.

        Parameters
        ----------
        paths
            (m,) indices of some paths.
        next_values
            (variables, m) configurations (rad) near the start of these paths, approximated
            by one Newton step.
        parameter
            Path parameter of these configurations, which is 0 at the start.
        """
        # `slopes` is (2, variables, paths).
        self.slopes[:, :, paths] = (next_values - self.current[:, paths]) / parameter

    def reached(self, paths: Indices) -> Floats:
        """Return the path parameters (m,) of the last points of some paths."""
        return self.parameters[2, paths]

    def predict(self, paths: Indices, target: Floats) -> Array:
        """Return predicted configurations (variables, m) at path parameters (m,)."""
        return _extrapolate(
            self.parameters[:, paths],
            self.current[:, paths],
            self.slopes[:, :, paths],
            target,
        )

    def append(self, paths: Indices, values: Array, parameters: Floats) -> None:
        """Append a point to some paths, and drop the earliest of their three points.

        A path is a configuration that changes while sizes or inputs change. The last three
        points of each path are stored, to predict the next one.

        Parameters
        ----------
        paths
            (m,) numbers of the paths.
        values
            (variables, m) configurations (rad) at the new points.
        parameters
            (m,) positions of the new points on their paths, from 0 (start) to 1 (end).
        """
        # Slopes are changes of the configuration per path parameter, between stored points.
        self.slopes[0][:, paths] = self.slopes[1][:, paths]
        self.slopes[1][:, paths] = (values - self.current[:, paths]) / (
            parameters - self.parameters[2, paths]
        )
        self.current[:, paths] = values
        self.parameters[0, paths] = self.parameters[1, paths]
        self.parameters[1, paths] = self.parameters[2, paths]
        self.parameters[2, paths] = parameters


@dataclass(frozen=True)
class PathCorrection:
    """The result of two Newton steps from predicted configurations.

    A configuration is followed along a path, while sizes or inputs change. Each prediction
    is corrected by Newton's method. There are m paths.

    Attributes
    ----------
    values
        (variables, m) configurations (rad) after the two steps.
    first_length, second_length
        (m,) largest change (rad) of a variable in each step.
    determinant
        (m,) determinant of the linearised closure equations before the second step. If it
        changes its sign on a real path, the path may have jumped to another mode.
    """

    values: Array
    first_length: Floats
    second_length: Floats
    determinant: Array

    def contracts(self, contraction: float) -> Bools:
        """Return a mask (m,) of the paths on which Newton's method stays near its start.

        The start is the predicted configuration. The first step must be short. The second
        step must be at most `contraction` times the first one, or as small as rounding
        (`NEGLIGIBLE_STEP_RAD`). Longer steps may lead to another solution.
        """
        is_short = self.first_length < MAX_FIRST_NEWTON_STEP_RAD
        return is_short & (
            self.second_length
            <= np.maximum(contraction * self.first_length, NEGLIGIBLE_STEP_RAD)
        )


def _correct(equations: ClosureProblem, predicted: Array) -> PathCorrection:
    """Correct predicted configurations (variables, m) by two steps of Newton's method."""
    corrected = predicted + equations.newton_step(predicted).change
    second_step = equations.newton_step(corrected)
    return PathCorrection(
        values=corrected + second_step.change,
        first_length=max_abs(corrected - predicted, 0),
        second_length=max_abs(second_step.change, 0),
        determinant=second_step.determinant,
    )


def _extrapolate(parameters: Floats, values: Array, slopes: Array, target: Floats) -> Array:
    """Predict the next point of each path by the parabola through its last three points.

    A path is a configuration that changes with a path parameter t. The caller corrects the
    predicted points by Newton's method. Let t0, t1, t2 be the parameters of the last three
    points, and x2 the configuration at t2. Let s01 and s12 be the slopes of the straight
    lines from t0 to t1 and from t1 to t2. Newton's form of the parabola is
    ``x2 + (t - t2) (s12 + (t - t1) (s12 - s01) / (t2 - t0))``.

    Parameters
    ----------
    parameters
        (3, m) path parameters t0, t1, t2 of the points.
    values
        (variables, m) configurations x2 (rad) at the last point.
    slopes
        (2, variables, m) slopes s01 and s12: change of the configuration per path
        parameter.
    target
        (m,) path parameters t at which the configurations are predicted.

    Returns
    -------
    (variables, m) predicted configurations (rad).
    """
    second_difference = (slopes[1] - slopes[0]) / (parameters[2] - parameters[0])
    return values + (target - parameters[2]) * (
        slopes[1] + (target - parameters[1]) * second_difference
    )


def converge_solutions(equations: ClosureProblem, values: Array) -> tuple[Array, Bools]:
    """Refine approximate solutions of the closure equations to full accuracy.

    The solutions are configurations in which all loops of links close. Newton's method is
    used.

    Parameters
    ----------
    equations
        The closure equations of n designs (choices of sizes). The inputs stay constant.
    values
        (variables, n) approximate pair variables (rad), real or complex, one column for
        each design.

    Returns
    -------
    solutions
        (variables, n) refined solutions (rad), valid only where they have converged.
    converged
        (n,) whether Newton's method converged for each design and the loops are closed.
    """
    solutions = values.copy()
    converged = np.zeros(values.shape[1], bool)
    remaining = np.arange(values.shape[1])
    with np.errstate(all="ignore"):
        for _ in range(MAX_FINAL_STEPS):
            newton_step = equations.select(remaining).newton_step(solutions[:, remaining])
            solutions[:, remaining] += newton_step.change
            converged[remaining] = _has_converged(solutions[:, remaining], newton_step)
            remaining = np.flatnonzero(~converged)
            if not len(remaining):
                break
    return solutions, converged


def _has_converged(solutions: Array, last_step: NewtonStep) -> Bools:
    """Return a mask of the solutions that are finite and have converged (Newton's method).

    The last step must be short. Before this step the loops of links must have been closed.

    Parameters
    ----------
    solutions
        (variables, m) real or complex solutions (rad) after the last step.
    last_step
        The last Newton step. Its residual is the closure error before the step.

    Returns
    -------
    (m,) mask.
    """
    # Rounding errors grow with the imaginary part b of a solution, since |sin(a + i b)|
    # grows like exp(|b|). The equations have products of two such factors, so the
    # tolerances grow like exp(2 |b|).
    imaginary_part = max_abs(solutions.imag, 0)
    growth = np.exp(2.0 * imaginary_part)
    is_short_step = max_abs(last_step.change, 0) < FINAL_STEP_RAD * growth
    is_closed = np.abs(last_step.squared_residual) < (CLOSURE_TOLERANCE_RAD * growth) ** 2
    # A solution counts as infinite from this imaginary part on.
    is_finite = imaginary_part < MAX_IMAGINARY_PART_RAD
    return is_short_step & is_finite & is_closed


def solution_distance(solution_a: Array, solution_b: Array) -> Floats:
    """Return the largest difference of the variables of solutions.

    Parameters
    ----------
    solution_a, solution_b
        (variables, ...) real or complex solutions (rad).

    Returns
    -------
    (...,) distances (rad). Whole revolutions do not count.
    """
    difference = solution_a - solution_b
    return np.max(np.hypot(wrap(difference.real), difference.imag), axis=0)


def are_distinct(solutions: Array) -> Bools:
    """Return for each design whether its solutions are all finite and different.

    All solutions of the closure equations of a design are tracked together along paths. If
    a path jumps to another path, two solutions become equal and one solution is lost.

    Parameters
    ----------
    solutions
        (variables, designs, m) the m solutions (rad) of each design.

    Returns
    -------
    (designs,) False if a solution is NaN, or if two are nearer than `SAME_SOLUTION_RAD`.
    """
    # All variables (axis 0) of all solutions (axis 2) must be finite.
    distinct: Bools = all_finite(solutions, (0, 2))
    # Indices of the two solutions, for all pairs of solutions.
    first, second = np.triu_indices(solutions.shape[2], 1)
    for design in np.flatnonzero(distinct):
        distances = solution_distance(
            solutions[:, design, first], solutions[:, design, second]
        )
        # A single solution has no distances.
        distinct[design] = np.min(distances, initial=np.inf) > SAME_SOLUTION_RAD
    return distinct


@dataclass(frozen=True)
class StartSolutions:
    """All solutions of the loop-closure equations of one design, at complex inputs.

    The solutions of other designs are computed from these solutions, while the sizes change
    step by step. Solutions do not meet at complex inputs, so none is lost.

    Attributes
    ----------
    values
        (variables, m) complex pair variables (rad) of the m solutions.
    sizes
        (sizes,) sizes of the design.
    inputs
        (inputs,) complex inputs (rad).
    is_complete
        Whether no solution is missing: their number is the one that designs with these
        links and pairs have in general.
    """

    values: Array
    sizes: Floats
    inputs: Array
    is_complete: bool


def find_start_solutions(kernel: PathKernel, sizes: Floats) -> StartSolutions | None:
    """Find all solutions of the closure equations of the mechanism in a file.

    The links form groups, each a set of links whose positions are found together from those
    of other links. Elimination, an algebraic method, gives all solutions of a group, real
    and complex, at random real inputs. The solutions are tracked to complex inputs, where
    they are well apart.

    From these solutions the solutions of all other designs are tracked.

    Parameters
    ----------
    kernel
        The closure equations of the designs.
    sizes
        (sizes,) sizes of the mechanism in the file.

    Returns
    -------
    The solutions. None if elimination does not apply to some group, if there are more than
    `MAX_SOLUTIONS`, if no solution can be tracked, or if two solutions coincide.
    """
    structure = kernel.expressions.structure
    mechanism = structure.mechanism
    groups = structure.assembly.groups
    if not all(group.is_dyad or has_elimination(group) for group in groups):
        return None
    # The solutions of the groups can be combined freely.
    solution_count = prod(find_elimination_orders(group)[0].root_count for group in groups)
    if solution_count > MAX_SOLUTIONS:
        return None

    # Choose real inputs for the elimination, and complex inputs of the result. Special
    # inputs, such as zero, may be singular. The seed makes the result repeatable. For the
    # elimination, pairs that follow the inputs by gear ratios count as inputs, too.
    moving = mechanism.with_inputs(*mechanism.names_of(structure.assembly.inputs))
    solver = PositionSolver(moving, structure.assembly)
    inputs = mechanism.with_inputs(*mechanism.names_of(structure.input_pairs)).inputs
    ranges = np.array([(item.start, item.stop) for item in inputs])
    complex_inputs = np.mean(ranges, axis=1)[:, None] + 1j * START_IMAGINARY_PART_RAD
    real_inputs = np.random.default_rng(20).uniform(*np.sort(ranges, axis=1).T)[:, None]

    # Compute the angles of pairs that follow the inputs by gear ratios: a Newton step sets
    # them. `solver.driven` are the variables of the inputs and of these pairs.
    start = np.zeros((kernel.variable_count, 1))
    size_column = sizes[:, None]
    start[kernel.driven] = real_inputs
    with np.errstate(all="ignore"):
        change = kernel.newton_step(start, kernel.prepare(size_column)).change
    followers = [v for v in solver.driven if v not in kernel.driven]
    start[followers] += change[followers]
    driven_values = start[list(solver.driven)]

    # Find the solutions (variables, m) by elimination, and track them to complex inputs.
    values = ModeCoalescence(solver).configurations(driven_values[:, 0]).T
    values = values[:, all_finite(values, 0)]
    values[list(solver.driven)] = driven_values
    values, arrived = track_solutions(
        kernel,
        values,
        sizes=(size_column, size_column),
        inputs=(real_inputs, complex_inputs),
    )
    values = values[:, arrived]
    count = values.shape[1]
    if not count or not are_distinct(values[:, None])[0]:
        return None
    return StartSolutions(
        values, sizes, inputs=complex_inputs[:, 0], is_complete=count == solution_count
    )
