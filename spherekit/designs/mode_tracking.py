"""Tracks all assembly modes of many designs over sampled inputs.

The closure equations of a start design have m complex solutions. All of them are tracked
to every design, and in each design from sample to sample of the inputs
(coefficient-parameter continuation). If m distinct solutions arrive at a sample, no real
solution is missing there. Otherwise the design is reported as lost, and the caller analyses
it without tracking.

Real solutions at neighbouring samples belong to one assembly mode if a path of real
configurations connects them. The module `homotopy` tracks the individual paths.
"""

from dataclasses import dataclass
from math import prod

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices, Integers
from spherekit.conventions import Names
from spherekit.designs.homotopy import (
    LONG_PATH_CONTRACTION,
    SAME_SOLUTION_RAD,
    ClosureProblem,
    StartSolutions,
    are_distinct,
    converge_solutions,
    solution_distance,
    track_solutions,
)
from spherekit.designs.path_kernel import PathKernel
from spherekit.geometry.vectors import max_abs, nans
from spherekit.numerics.angles import wrap
from spherekit.positions.input_grid import InputGrid

DETOUR_RATIOS = (0.0, 0.5, -0.9, 1.7)
"""Height of the detour through complex inputs, relative to the step of the inputs.

The ratios are tried in this order until all solutions of a design arrive. Zero is the
straight path, and a negative ratio passes the real axis on the other side. A design for
which every ratio fails is lost. A shorter list loses more designs, and a longer one spends
more time on them.
"""

NEAR_REAL_RAD = 1e-4
"""Largest imaginary part (rad) of a solution that is tested for being real.

A larger value tests more solutions. A smaller one misses real solutions near a singularity,
where rounding errors of the tracked path are amplified.
"""

SORTING_DECIMALS = 6
"""Decimals of the pair variables (rad) by which modes are sorted.

With more decimals the numbers of modes could depend on rounding errors.
"""

NO_MODE = -1
"""Mode identifier of solutions that are not real or belong to a lost design."""


@dataclass(frozen=True)
class TrackedModes:
    """The assembly modes of many designs at the same samples of the inputs.

    An assembly mode is one of the ways to assemble a mechanism at given inputs. A mode has
    at most one configuration at each sample. The modes are sorted by design, and within a
    design by the first sample at which they have a configuration.

    Attributes
    ----------
    design
        (modes,) index of the design of each mode.
    values
        (variables, samples, modes) pair (joint) variables in rad. Variables of pairs that
        are not driven are in (-pi, pi]. All variables are NaN at samples where the
        mechanism cannot be assembled in this mode.
    labels
        (modes,) number of the mode within its design, and a sign for each group of links:
        "+" or "-" for dyads (two links and three revolute pairs), "~" for larger groups. An
        example is "0 +~".
    lost_designs
        (lost,) indices of the designs whose modes are all left out. A solution of the
        closure equations was lost, so one of the modes could be missing.
    """

    design: Indices
    values: Floats
    labels: Names
    lost_designs: Indices


def track_assembly_modes(
    path_kernel: PathKernel,
    start_solutions: StartSolutions,
    sizes: Floats,
    input_grid: InputGrid,
) -> TrackedModes:
    """Track the assembly modes of many designs over all samples of the inputs.

    An assembly mode is one way in which the links are put together: real configurations
    that are connected along the samples. All complex solutions of the closure equations are
    tracked from sample to sample, so that no real one is missed. Then the real solutions at
    neighbouring samples are linked by real paths.

    Parameters
    ----------
    path_kernel
        Newton steps of the closure equations, which all designs share.
    start_solutions
        The m complex solutions of one design at complex inputs, from which all paths start.
        The modes of a design are complete only if `start_solutions.is_complete` is true.
    sizes
        (sizes, designs) sizes of each design, as `path_kernel.prepare` takes them.
    input_grid
        Samples of the inputs (rad), along a path or over a grid.

    Returns
    -------
    The modes of all designs that are not lost, and the lost designs.
    """
    sample_count = len(input_grid)
    design_count = sizes.shape[1]
    solutions_per_design = start_solutions.values.shape[1]
    # All solutions of all designs are tracked together. Solution i of design d is in column
    # d * solutions_per_design + i of the arrays.
    column_count = design_count * solutions_per_design
    tracker = _SolutionTracker(path_kernel, sizes, solutions_per_design)

    # inputs[sample] is (inputs, 1), so that all columns share it.
    inputs = input_grid.q[:, :, None]
    # neighbours() alternates between the next and the previous sample along each axis.
    previous_samples = input_grid.neighbours()[1::2]
    samples_per_step_of_first_input = prod(input_grid.shape[1:])

    solutions_at: dict[int, Array] = {}
    values = nans((path_kernel.variable_count, sample_count, column_count))
    mode_ids = np.full((sample_count, column_count), NO_MODE)
    for sample in range(sample_count):
        neighbours = previous_samples[:, sample]
        # The neighbour along the last axis has the largest index and comes first.
        neighbours = np.sort(neighbours[neighbours >= 0])[::-1].tolist()

        if neighbours:
            solutions = tracker.track_to_inputs(
                solutions_at[neighbours[0]],
                start_sizes=tracker.sizes,
                start_inputs=inputs[neighbours[0]],
                end_inputs=inputs[sample],
            )
        else:
            # At the first sample all designs start from the solutions of the start design.
            solutions = tracker.track_to_inputs(
                np.tile(start_solutions.values, (1, design_count)),
                start_sizes=np.broadcast_to(
                    start_solutions.sizes[:, None], tracker.sizes.shape
                ),
                start_inputs=start_solutions.inputs[:, None],
                end_inputs=inputs[sample],
            )
        solutions_at[sample] = solutions
        real = is_real(solutions)
        values[:, sample, real] = solutions[:, real].real

        # Each real solution starts as a mode of its own. A real path from a solution at a
        # neighbouring sample joins the modes of both solutions.
        mode_ids[sample, real] = sample * column_count + np.flatnonzero(real)
        for neighbour in neighbours:
            successors = tracker.link_real_solutions(
                solutions_at[neighbour],
                solutions,
                start_inputs=inputs[neighbour],
                end_inputs=inputs[sample],
            )
            columns = np.flatnonzero(successors >= 0)
            if neighbour == neighbours[0]:
                mode_ids[sample, successors[columns]] = mode_ids[neighbour, columns]
                continue
            # With several inputs, a path from another neighbour may connect two modes.
            for column in columns:
                first_column = column - column % solutions_per_design
                _merge_modes(
                    mode_ids[:, first_column : first_column + solutions_per_design],
                    mode_ids[neighbour, column],
                    mode_ids[sample, successors[column]],
                )
        # The previous sample along the first input is not needed by later samples. Deleting
        # its solutions limits the memory.
        solutions_at.pop(sample - samples_per_step_of_first_input, None)

    mode_ids[:, np.repeat(tracker.is_lost, solutions_per_design)] = NO_MODE
    return _collect_modes(path_kernel, sizes, values, mode_ids, tracker.is_lost)


def is_real(solutions: Array) -> Bools:
    """Return a mask (...,) of the solutions (variables, ...) that are real; NaN is not."""
    # A complex NaN may have an imaginary part of zero.
    return np.all(np.isfinite(solutions) & (solutions.imag == 0.0), axis=0)


def _merge_modes(mode_ids: Integers, mode: int, other_mode: int) -> None:
    """Give two modes of one design the same number if they can be one assembly mode.

    An assembly mode is one way to assemble the mechanism. It has at most one configuration
    at each sample of the inputs. A new real solution at a sample first gets a mode number
    of its own. The caller has found a path of real configurations, between two neighbouring
    samples, from one of these modes to the other.

    If both modes have a configuration at the same sample, they are different and keep their
    numbers. A path that leads around a singularity can connect such modes.

    Parameters
    ----------
    mode_ids
        (samples, solutions of the design) the number of the mode to which each
        configuration belongs. This array is changed: the larger of the two numbers is
        replaced by the smaller number.
    mode, other_mode
        Numbers of the two modes, which may be equal.
    """
    if mode == other_mode:
        return
    has_sample = np.any(mode_ids == mode, axis=1)
    other_has_sample = np.any(mode_ids == other_mode, axis=1)
    if not np.any(has_sample & other_has_sample):
        mode_ids[mode_ids == max(mode, other_mode)] = min(mode, other_mode)


def _collect_modes(
    path_kernel: PathKernel,
    sizes: Floats,
    solution_values: Floats,
    mode_ids: Integers,
    is_lost: Bools,
) -> TrackedModes:
    """Collect the configurations of each assembly mode, and sort and label the modes.

    A column of the arrays is one tracked solution of the closure equations. The solutions
    of a design are next to each other. Solutions with the same identifier at different
    samples are one assembly mode.

    Parameters
    ----------
    path_kernel
        Supplies the signs of the dyads, and which variables are inputs.
    sizes
        (sizes, designs) sizes of each design.
    solution_values
        (variables, samples, columns) pair variables (rad) of the real solutions.
    mode_ids
        (samples, columns) identifier of the mode of each real solution, or `NO_MODE`.
    is_lost
        (designs,) whether a solution of the design could not be tracked.

    Returns
    -------
    The modes of all designs, sorted by design, then by the first sample at which they close
    and then by their configuration there.
    """
    # The elements (sample, solution) of the arrays that belong to a mode; `mode` counts the
    # modes from 0.
    sample, column = np.nonzero(mode_ids >= 0)
    _, first_entry, mode = np.unique(
        mode_ids[sample, column], return_index=True, return_inverse=True
    )
    solutions_per_design = mode_ids.shape[1] // len(is_lost)
    design = column[first_entry] // solutions_per_design
    values = nans((*solution_values.shape[:2], len(first_entry)))
    values[:, sample, mode] = solution_values[:, sample, column]
    # The inputs keep their sampled values. Tracking can add revolutions to other angles.
    passive = np.delete(np.arange(len(values)), path_kernel.driven)
    values[passive] = wrap(values[passive])

    # The sorting does not depend on the order of the tracked solutions, so that the same
    # design always has the same mode numbers.
    first_sample = np.argmax(np.isfinite(values[0]), axis=0)
    first_values = values[:, first_sample, np.arange(len(first_sample))]
    # lexsort takes the most significant key last.
    sorting_values = np.round(first_values[::-1], SORTING_DECIMALS)
    order = np.lexsort((*sorting_values, first_sample, design))
    design = design[order]
    values = values[:, :, order]
    first_values = first_values[:, order]

    number_in_design = np.arange(len(design)) - np.searchsorted(design, design)
    dyad_signs = path_kernel.mode_signs(first_values, sizes[:, design])
    labels = [
        f"{number} {signs}"
        for number, signs in zip(number_in_design, dyad_signs, strict=True)
    ]
    return TrackedModes(design, values, tuple(labels), np.flatnonzero(is_lost))


class _SolutionTracker:
    """Follows all solutions of many designs from one sample of the inputs to another.

    The solutions solve the closure equations. Assembly modes are real solutions that are
    connected.

    Attributes
    ----------
    path_kernel
        Newton steps of the closure equations.
    solutions_per_design
        Number m of complex solutions of each design.
    sizes
        (sizes, columns) sizes of the design to which each solution belongs.
    is_lost
        (designs,) whether a solution of the design was lost. The methods set it, and a
        design that is lost is not tracked any further.
    """

    def __init__(
        self, path_kernel: PathKernel, sizes: Floats, solutions_per_design: int
    ) -> None:
        """Repeat the sizes (sizes, designs) for each solution; no design is lost yet."""
        self.path_kernel = path_kernel
        self.solutions_per_design = solutions_per_design
        self.sizes = np.repeat(sizes, solutions_per_design, axis=1)
        self.is_lost = np.zeros(sizes.shape[1], bool)

    def track_to_inputs(
        self, start: Array, start_sizes: Floats, start_inputs: Array, end_inputs: Array
    ) -> Array:
        """Follow all solutions to the sizes of their designs and to other inputs.

        A solution is a configuration, possibly complex, in which all loops of links close.
        A solution is followed while sizes and inputs change step by step, with Newton's
        method at each step (`track_solutions`).

        On a straight path of the inputs, two solutions can meet at a singularity, and one
        is lost. So if the straight path fails, others are tried, on which the inputs have
        complex values. Such a detour begins at the start inputs and ends at the end inputs.
        `DETOUR_RATIOS` says how large its imaginary part is. A path succeeds for a design
        if all its solutions arrive and are different.

        A design is marked in `is_lost` if no path succeeds, or if on any path one of its
        solutions is neither clearly real nor clearly complex.

        Parameters
        ----------
        start
            (variables, columns) solutions (rad) at the start of the paths. Each column is
            one solution of one design. The solutions of a design are neighbours.
        start_sizes
            (sizes, columns) sizes at the start.
        start_inputs, end_inputs
            (inputs, 1) inputs (rad) at the start and at the end.

        Returns
        -------
        (variables, columns) complex solutions (rad) at the end inputs. Real solutions have
        an imaginary part of exactly zero. All solutions of a lost design are NaN.
        """
        solutions = np.full(start.shape, np.nan, dtype=complex)
        # (designs,) whether the design still needs a successful path.
        needs_path = ~self.is_lost
        for detour_ratio in DETOUR_RATIOS:
            # Each design has `solutions_per_design` successive columns.
            columns = np.flatnonzero(np.repeat(needs_path, self.solutions_per_design))
            if not len(columns):
                break
            sizes = self.sizes[:, columns]
            ends = _track_along_detour(
                self.path_kernel,
                start[:, columns],
                sizes=(start_sizes[:, columns], sizes),
                inputs=(start_inputs, end_inputs),
                detour_ratio=detour_ratio,
            )
            # Imaginary parts that are rounding errors become exactly 0.
            cleaned = _remove_imaginary_rounding(self.path_kernel, ends, sizes)
            solutions[:, columns] = cleaned.values
            # A design with an undecided solution stays lost, whatever later paths give.
            undecided_columns = columns[cleaned.is_undecided]
            self.is_lost[undecided_columns // self.solutions_per_design] = True
            # If a path did not arrive, its solution is NaN, which counts as not distinct.
            needs_path &= ~are_distinct(self._by_design(solutions))
        self.is_lost |= needs_path
        solutions[:, np.repeat(self.is_lost, self.solutions_per_design)] = np.nan
        return solutions

    def link_real_solutions(
        self,
        solutions: Array,
        next_solutions: Array,
        start_inputs: Array,
        end_inputs: Array,
    ) -> Indices:
        """Return the solution at the next sample to which each real solution leads.

        A solution solves the closure equations at the inputs of a sample. A real solution
        is a configuration. Real solutions are tracked along paths of real configurations,
        in steps that do not jump to another assembly mode. A mode ends if its path does not
        arrive. A design is marked in `is_lost` if a path arrives at none of the known real
        solutions, or if two paths arrive at the same one.

        Parameters
        ----------
        solutions, next_solutions
            (variables, columns) pair variables (rad) of all solutions at the two samples.
            The solutions of a design are successive columns.
        start_inputs, end_inputs
            (inputs, 1) inputs (rad) of the two samples.

        Returns
        -------
        (columns,) for each solution its column in `next_solutions`, or -1 if it is not real
        or its path does not arrive. Columns of lost designs have no meaning.
        """
        successors = np.full(solutions.shape[1], -1)
        columns = np.flatnonzero(is_real(solutions))
        sizes = self.sizes[:, columns]
        ends, arrived = track_solutions(
            self.path_kernel,
            solutions[:, columns].real,
            sizes=(sizes, sizes),
            inputs=(start_inputs, end_inputs),
            # Each Newton step must be shorter than the one before by this factor, so that a
            # path does not jump to another solution.
            contraction=LONG_PATH_CONTRACTION,
        )
        columns = columns[arrived]
        ends = ends[:, arrived]

        # The end of each path is compared with the real solutions of its design.
        design = columns // self.solutions_per_design
        # (variables, paths, solutions of the design)
        candidates = self._by_design(next_solutions)[:, design]
        # (paths, solutions of the design)
        distances = solution_distance(candidates.real, ends[:, :, None])
        distances[~is_real(candidates)] = np.inf
        nearest = np.argmin(distances, axis=1)
        is_certain = np.min(distances, axis=1) < SAME_SOLUTION_RAD
        next_columns = design * self.solutions_per_design + nearest
        successors[columns[is_certain]] = next_columns[is_certain]

        # If two paths arrive at the same solution, one of them has jumped to another mode.
        # Which path has jumped is unknown, so the design is lost.
        _, first_arrivals = np.unique(next_columns, return_index=True)
        is_repeated = np.ones(len(columns), bool)
        is_repeated[first_arrivals] = False
        self.is_lost[design[~is_certain | is_repeated]] = True
        return successors

    def _by_design(self, solutions: Array) -> Array:
        """Return solutions (variables, columns) as (variables, designs, m)."""
        return solutions.reshape(len(solutions), -1, self.solutions_per_design)


def _track_along_detour(
    path_kernel: PathKernel,
    start: Array,
    sizes: tuple[Floats, Floats],
    inputs: tuple[Array, Array],
    detour_ratio: float,
) -> Array:
    """Follow solutions while sizes and inputs change, the inputs through complex values.

    A solution is a configuration in which all loops of links close. On a path of real
    inputs, two solutions can meet at a singularity, and one is then lost. At complex inputs
    solutions do not meet.

    Parameters
    ----------
    path_kernel
        Computes Newton steps of the closure equations.
    start
        (variables, n) solutions (rad) at the start of the paths.
    sizes
        Two arrays (sizes, n): sizes of links at the start and at the end of the n paths.
    inputs
        Two arrays (inputs, 1): inputs (rad) at the start and at the end of all paths.
    detour_ratio
        Height of the detour relative to the change of the inputs. Half-way between start
        and end, the inputs deviate from the straight path by 1j * detour_ratio times their
        change. Along the path the deviation is a parabola that is zero at start and end.

    Returns
    -------
    (variables, n) complex solutions (rad) at the end, NaN where a path does not arrive.
    """
    start_inputs, end_inputs = inputs
    ends, arrived = track_solutions(
        path_kernel,
        start.astype(complex),
        sizes=sizes,
        inputs=inputs,
        detour=1j * detour_ratio * (end_inputs - start_inputs),
    )
    return np.where(arrived, ends, np.nan)


@dataclass(frozen=True)
class CleanedSolutions:
    """Solutions of the closure equations; tiny imaginary parts from rounding are removed.

    Attributes
    ----------
    values
        (variables, n) pair variables (rad). Real solutions have an imaginary part of
        exactly zero.
    is_undecided
        (n,) mask of the solutions of which it is not known whether they are real.
    """

    values: Array
    is_undecided: Bools


def _remove_imaginary_rounding(
    path_kernel: PathKernel, solutions: Array, sizes: Floats
) -> CleanedSolutions:
    """Remove the imaginary part of solutions that are real up to rounding.

    A solution is a configuration in which all loops of links close. A solution with an
    imaginary part below `NEAR_REAL_RAD` is tested: Newton's method starts from its real
    part. If the method converges to a point less than `SAME_SOLUTION_RAD` from the real
    part, the solution is real. A solution that fails the test is undecided if its imaginary
    part is below `SAME_SOLUTION_RAD`, and complex if not.

    Parameters
    ----------
    path_kernel
        Computes Newton steps of the closure equations.
    solutions
        (variables, n) complex solutions (rad).
    sizes
        (sizes, n) sizes of the design of each solution.

    Returns
    -------
    The solutions, and which of them are undecided.
    """
    imaginary_part = max_abs(solutions.imag, axis=0)
    tested = np.flatnonzero((imaginary_part > 0.0) & (imaginary_part < NEAR_REAL_RAD))
    real_parts = solutions[:, tested].real
    equations = ClosureProblem(path_kernel, path_kernel.prepare(sizes[:, tested]))
    refined, converged = converge_solutions(equations, real_parts)
    has_passed = converged & (max_abs(refined - real_parts, axis=0) < SAME_SOLUTION_RAD)

    values = solutions.copy()
    values[:, tested[has_passed]] = refined[:, has_passed]
    is_undecided = np.zeros(solutions.shape[1], bool)
    is_undecided[tested] = ~has_passed & (imaginary_part[tested] < SAME_SOLUTION_RAD)
    return CleanedSolutions(values, is_undecided)
