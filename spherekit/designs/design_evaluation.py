"""Figures of merit of designs: for all designs at once by a kernel, or one by one.

A kernel is a function that evaluates quantities of many designs at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Floats, Indices
from spherekit.completeness import Guarantee
from spherekit.conventions import TURN
from spherekit.designs.design_kernel import DesignKernel, RedundantKernel, arc_function
from spherekit.designs.design_revolutions import (
    unwrap_along_one_input,
    unwrap_along_several_inputs,
)
from spherekit.designs.design_variables import ACTIONS, OK, DesignVariable, make_design
from spherekit.designs.figures_of_merit import (
    DESIGNS_PER_BLOCK,
    IMPOSSIBLE,
    INERTIAL,
    NEVER_CLOSES,
    NEVER_CLOSES_REASON,
    POINT_TOLERANCE_RAD,
    DesignSamples,
    DesignTable,
    KernelFigures,
    failed_design,
)
from spherekit.designs.homotopy import StartSolutions, find_start_solutions
from spherekit.designs.mode_tracking import TrackedModes, track_assembly_modes
from spherekit.designs.path_kernel import PathKernel
from spherekit.designs.profile_numbers import make_contact_profiles
from spherekit.designs.varied_mechanism import OTHER_FORM, VariedMechanism
from spherekit.errors import CountError, DesignError, SpherekitError
from spherekit.files.toml_document import Document
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.mechanism.elements import PoseGeometry, SizeGeometry
from spherekit.mechanism.load_dependence import check_torque_tables_cover
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.angle_unwrapping import AngleUnwrapping
from spherekit.positions.input_grid import InputGrid
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.position_solver import PositionSolver
from spherekit.runs.figure_of_merit import FigureOfMerit
from spherekit.singularities.grashof import class_of, four_bar_links
from spherekit.velocities.axis_rotations import pair_rotations
from spherekit.velocities.design_expressions import DesignExpressions
from spherekit.velocities.equivalent_linkage import find_equivalent_linkage
from spherekit.velocities.load_numbers import LOAD_DEPENDENT_PREFIXES
from spherekit.wording import listing

ROWS_PER_ANGLE_BLOCK = 16384
"""Rows whose angles are evaluated together. Larger: the core's cache is too small."""

CLOSED_FORM_PART_SIZE = 16384
"""Designs in a part of a sweep if positions are in closed form."""

MAX_TRACKED_DESIGNS = 768
"""Largest number of designs whose modes are tracked together, and of a part of a sweep.

Larger: more memory, and less work for other processes. Smaller: more calls.
"""

SINGLE_DESIGN_PART_SIZE = 16
"""Designs in a part of a sweep if designs are analysed one by one."""

MIN_TRACKED_DESIGNS = 256
"""Smallest number of designs in a part of a sweep if modes are tracked and memory permits.

Smaller: tracking so few designs together takes longer for each.
"""

TRACKED_PART_COUNT = 8
"""Parts into which a sweep with many designs is divided if modes are tracked.

Larger: more processes have work. Smaller: more designs are tracked together.
"""

MAX_FIGURE_VALUES = 2**24
"""Largest number of values of figures at samples that are in memory at once."""

MAX_TRACKED_VALUES = 2**25
"""Largest number of variables, over all solutions and samples, in memory while tracking."""

COMPLETE_CLAIM = Guarantee.COMPLETE.value
"""Claim for designs of which no assembly mode is missing."""

SAMPLED_CLAIM = Guarantee.SAMPLED.value
"""Claim for designs of which an assembly mode may be missing."""


@dataclass(frozen=True)
class DesignMotion:
    """The assembly modes of one design, found by a search.

    An assembly mode is one of the ways to assemble the mechanism at given inputs.

    Attributes
    ----------
    position_analysis
        The search with its results: the assembly modes.
    motion
        The configurations of all modes at the samples of the inputs.
    values
        (variables, samples + points, modes) pair (joint) variables in rad. The samples of
        the inputs come first. The points are additional sets of inputs, at which some
        figures of merit (numbers that rate a design) are evaluated. NaN where the mechanism
        cannot be assembled in the mode.
    """

    position_analysis: PositionAnalysis
    motion: Motion
    values: Floats


class TrackingStart(NamedTuple):
    """The known solutions from which solutions of all other designs are computed.

    The sizes change step by step from one design to another, and the solutions of the
    closure equations are followed (tracked).

    Attributes
    ----------
    path_kernel
        The closure equations, with the sizes of a design as arguments.
    solutions
        All complex solutions of these equations for one design.
    """

    path_kernel: PathKernel
    solutions: StartSolutions


class DesignEvaluator:
    """Computes figures of merit (numbers that rate a design) of designs of one mechanism.

    All designs have the same links and pairs, and differ in varied numbers. A kernel is a
    function that evaluates many designs at once. A kernel serves if the varied numbers are
    sizes of R pairs, masses or loads, or if links can replace all contacts.

    The kernel is in closed form if every group of links that are placed together is a dyad
    (two links and three R pairs). If not, all complex solutions of the closure equations
    are tracked from design to design.

    Other designs, and designs of which a solution is lost, are analysed one by one.

    Parameters
    ----------
    document
        The mechanism file whose numbers are varied.
    mechanism
        The mechanism of this file.
    variables
        The numbers that are varied.
    merits
        The figures of merit.
    samples
        The samples of the inputs over which the figures are reduced.
    needs_modes_of_runs
        Whether assembly modes must have the labels (signs or numbers) of a run, because one
        is selected by its label. Kernels that label modes in another way are then not used.

    Attributes
    ----------
    figures
        The figures of merit with their expressions and points.
    varied_mechanism
        Computes the sizes of the kernel for each design.
    kernel
        The kernel of all designs, or None if they are analysed one by one.
    """

    def __init__(
        self,
        document: Document,
        mechanism: Mechanism,
        variables: Sequence[DesignVariable],
        merits: Sequence[FigureOfMerit],
        samples: DesignSamples,
        needs_modes_of_runs: bool = False,
    ) -> None:
        """Prepare the evaluation of many designs (choices of sizes) of one mechanism.

        The figures of merit are read. If possible, a kernel is created: a function that
        evaluates quantities of many designs at once.

        Parameters
        ----------
        document, mechanism
            The mechanism file, and the mechanism in it.
        variables
            The numbers of the file that differ from design to design.
        merits
            The figures of merit: numbers by which designs are compared.
        samples
            The inputs at which each design is evaluated.
        needs_modes_of_runs
            Whether assembly modes (ways to assemble the links) must have the labels that a
            run gives them: signs or numbers. This is so if the user selects a mode by its
            label. A kernel that labels modes in another way is then not used.
        """
        self.document = document
        self.mechanism = mechanism
        self.inputs = samples.inputs
        self.variables = tuple(variables)
        self.samples = samples
        self._needs_modes_of_runs = needs_modes_of_runs
        # Reads the figures and computes them from quantities of the kernel.
        self.figures = KernelFigures(mechanism, merits, samples)
        # A file may state a torque as a table over time. An error is raised if samples have
        # times outside the table.
        self._check_torque_tables()
        # The mechanism with sizes that vary.
        self.varied_mechanism = VariedMechanism(
            document,
            mechanism,
            self.variables,
            self.inputs,
            # A linkage with revolute pairs that moves like a mechanism with circular
            # contacts; None if there is no such linkage.
            equivalent_linkage=find_equivalent_linkage(mechanism, self.inputs),
            # Whether masses follow from sizes of links, and so change from design to
            # design.
            masses_follow_sizes=self._masses_follow_sizes,
        )
        # The kernel is None if designs have to be analysed one by one. If the equations of
        # the positions have no closed-form solution, the positions are tracked (followed in
        # small steps) from design to design. The tracking starts at all positions of one
        # design; otherwise its start is None.
        self.kernel, self._tracking_start = self._make_kernel()

    def _check_torque_tables(self) -> None:
        """Raise an error if a table of torques over time lacks the time of a sample.

        The times matter only if a figure depends on loads, such as a driving torque.
        """
        depends_on_loads = any(
            name.startswith(LOAD_DEPENDENT_PREFIXES) for name in self.figures.columns
        )
        if depends_on_loads:
            times_in_s = self.samples.rows[:, -1]
            check_torque_tables_cover(self.mechanism, times_in_s)

    def _make_kernel(self) -> tuple[DesignKernel | None, TrackingStart | None]:
        """Create the function that evaluates many designs at once, if this is possible.

        All designs (choices of sizes) must share the same equations. If positions have no
        closed form, solutions of the closure equations are tracked from design to design.
        The tracking starts at the solutions of one design, which must be found.

        Returns
        -------
        kernel
            The kernel, or None.
        tracking_start
            The solutions from which others are tracked; None if positions have a closed
            form or there is no kernel.
        """
        if not self._has_common_equations:
            return None, None
        expressions = self.varied_mechanism.make_expressions()
        tracking_start = None
        replaces_contacts = self.varied_mechanism.equivalent_linkage is not None
        # If the user selects an assembly mode by its label, the kernel must label modes as
        # a run does. Two kinds of kernels label them in another way: those that track
        # solutions, and those for a linkage that replaces contacts.
        has_modes_of_runs = expressions.has_closed_form and not replaces_contacts
        if self._needs_modes_of_runs and not has_modes_of_runs:
            return None, None
        if not expressions.has_closed_form:
            tracking_start = self._find_tracking_start(expressions)
            if tracking_start is None:
                return None, None
        names_of_quantities = self.figures.columns
        return DesignKernel(expressions, names_of_quantities), tracking_start

    def _find_tracking_start(self, expressions: DesignExpressions) -> TrackingStart | None:
        """Return all solutions for the design of the file, None if they are not found."""
        path_kernel = PathKernel(expressions)
        solutions = find_start_solutions(path_kernel, self.varied_mechanism.nominal_sizes)
        return None if solutions is None else TrackingStart(path_kernel, solutions)

    @property
    def _has_common_equations(self) -> bool:
        """Whether one kernel with common equations can compute all designs.

        A kernel is a function that evaluates many designs at once. So the equations of all
        designs must be the same, up to numbers. They must also give the wanted assembly
        modes (ways to assemble the mechanism). Otherwise the designs are analysed one by
        one.
        """
        if self.samples.crossings == "pass":
            # Assembly modes pass crossings of their configuration curves. The signs of
            # dyads change at a crossing, at inputs that differ from design to design.
            return False
        if self._needs_reference_mode_only:
            # Only the assembly mode with the reference pose is wanted. A kernel does not
            # know which of the modes of a design this is.
            return False
        if self._is_over_constrained:
            # There are more closure equations than unknowns. The kernel would not notice
            # sizes for which some equations do not hold.
            return False
        if self.mechanism.has_contacts:
            return self._can_replace_contacts
        return all(_is_number_in_equations(variable) for variable in self.variables)

    @property
    def _can_replace_contacts(self) -> bool:
        """Whether one linkage of R pairs can replace the mechanism with sliding contacts.

        The linkage has the same motion. All numbers may vary except directions of outputs,
        for which the linkage has no arguments.
        """
        varied_mechanism = self.varied_mechanism
        has_linkage = varied_mechanism.equivalent_linkage is not None
        return has_linkage and not varied_mechanism.varies_outputs

    @property
    def _needs_reference_mode_only(self) -> bool:
        """Whether only the assembly mode of the reference pose is computed.

        The reference pose is the configuration that the file describes. If the file gives
        sizes of links instead, all modes are computed, as in a run.
        """
        has_reference_pose = isinstance(self.mechanism.geometry, PoseGeometry)
        return has_reference_pose and not self.samples.search

    @cached_property
    def _is_over_constrained(self) -> bool:
        """Whether counting links and pairs gives fewer degrees of freedom than inputs."""
        try:
            plan_assembly(self.mechanism.with_inputs(*self.inputs))
        except CountError:
            return True
        return False

    @property
    def has_gradients(self) -> bool:
        """Whether the figures can be differentiated with respect to the variables."""
        if self.kernel is not None:
            return True
        # Without a kernel, contact profiles that are not circles have derivatives, if only
        # numbers of profiles and angles of links, pairs and outputs vary.
        varies_profiles = self.varied_mechanism.has_shaped_profiles and all(
            v.is_angle or "profiles" in v.path for v in self.variables
        )
        return varies_profiles and not self._masses_follow_sizes

    @property
    def _masses_follow_sizes(self) -> bool:
        """Whether figures depend on masses that the file states by sizes of links."""
        masses = self.document.data.get("mass", {})
        stated_by_sizes = any("tensor" not in mass for mass in masses.values())
        return stated_by_sizes and any(
            name.startswith(INERTIAL) for name in self.figures.columns
        )

    def grashof_classes(self, values: Floats) -> NDArray[np.str_] | None:
        """Return the Grashof class of each design of a four-bar, such as "crank-rocker".

        A design is one choice of the sizes. The class says which links turn through full
        revolutions.

        Parameters
        ----------
        values
            (variables, n) values of the design variables, in the units of the file.

        Returns
        -------
        (n,) names of the classes, such as "crank-rocker". None if the mechanism is not a
        four-bar, or if its designs cannot be computed together.
        """
        links_of_four_bar = four_bar_links(self.mechanism)
        if links_of_four_bar is None or self.kernel is None:
            return None
        varied_mechanism = self.varied_mechanism
        # `compute_arcs` computes the arcs (links, n) in rad of all links with two axes,
        # from the sizes (sizes, n) of n designs.
        links, compute_arcs = arc_function(varied_mechanism.make_expressions())
        values_in_rad_and_si = values * varied_mechanism.unit_scales[:, None]
        # The variables that are sizes of links.
        link_sizes = values_in_rad_and_si[varied_mechanism.size_variables]
        # `compute_arcs` expects numbers of masses and loads after the sizes of links. These
        # numbers do not influence arcs and are zero here.
        other_count = len(varied_mechanism.nominal_sizes) - len(link_sizes)
        other_sizes = np.zeros((other_count, values.shape[1]))
        sizes = np.concatenate([link_sizes, other_sizes])
        arc_of_link = dict(zip(links, compute_arcs(sizes), strict=True))
        # The arcs of fixed link, input, coupler and output.
        return class_of(*(arc_of_link[link] for link in links_of_four_bar))

    def evaluate(self, values: Floats) -> DesignTable:
        """Compute the figures of merit of designs.

        A design is one choice of the sizes. A figure of merit is a number that rates it.

        Parameters
        ----------
        values
            (variables, n) values of the design variables, in the units of the file.

        Returns
        -------
        A row for each design and assembly mode (way to assemble the mechanism). The column
        `design` is the index of the design in `values`.
        """
        # Evaluate as many designs together as memory permits, and at least one. Each figure
        # has a value at each sample. `rows` has a row for each sample.
        sample_count = len(self.figures.rows)
        values_per_design = len(self.figures.merits) * sample_count
        fitting_count = max(1, MAX_FIGURE_VALUES // values_per_design)
        block_size = min(DESIGNS_PER_BLOCK, fitting_count)
        if self.tracks_solutions:
            # Tracking solutions of the closure equations from design to design needs more
            # memory than a closed form.
            block_size = self._designs_tracked_together
        parts = []
        for start in range(0, values.shape[1], block_size):
            block = values[:, start : start + block_size]
            # The kernel evaluates all designs of a block (group of successive designs) at
            # once.
            if self.kernel:
                part = self._evaluate_by_kernel(self.kernel, block)
            else:
                part = self._evaluate_one_by_one(block)
            # A block counts its designs from 0.
            parts.append(replace(part, design=part.design + start))
        return DesignTable.join_by_design(parts, self.figures.names)

    def part_size(self, count: int) -> int:
        """Return how many of `count` designs a part of a sweep should have."""
        if self.kernel is None:
            return SINGLE_DESIGN_PART_SIZE
        if not self.tracks_solutions:
            return CLOSED_FORM_PART_SIZE
        wanted_size = max(MIN_TRACKED_DESIGNS, count // TRACKED_PART_COUNT)
        return min(wanted_size, self._designs_tracked_together)

    @property
    def tracks_solutions(self) -> bool:
        """Whether all complex solutions are tracked from design to design."""
        return self._tracking_start is not None

    @property
    def has_signs_of_runs(self) -> bool:
        """Whether assembly modes have the same signs as in a run of one design.

        A sign is the way in which a dyad (two links with three R pairs) is assembled. If
        the signs are the same, a mode of this evaluation can be found among the modes of a
        run by its signs.
        """
        if self.tracks_solutions:
            # Solutions are followed from design to design. Modes have numbers, not signs.
            return False
        # A kernel (function for many designs) may replace contacts by links. The signs of
        # these links do not occur in a run.
        has_replaced_contacts = (
            self.kernel is not None and self.varied_mechanism.equivalent_linkage is not None
        )
        return not has_replaced_contacts

    @property
    def has_unsigned_modes(self) -> bool:
        """Whether pair variables identify a mode, and not how its dyads are assembled."""
        return self.tracks_solutions or self.varied_mechanism.has_shaped_profiles

    @cached_property
    def path_kernel(self) -> PathKernel:
        """The closure equations, by which configurations are tracked to other designs."""
        return PathKernel(self.varied_mechanism.make_expressions())

    @property
    def _designs_tracked_together(self) -> int:
        """Number of designs that are tracked together without using too much memory."""
        assert self._tracking_start is not None
        start_values = self._tracking_start.solutions.values
        values_per_design = start_values.size * len(self.samples.rows)
        return max(1, min(MAX_TRACKED_DESIGNS, MAX_TRACKED_VALUES // values_per_design))

    # All designs in one kernel.

    def _evaluate_by_kernel(self, kernel: DesignKernel, values: Floats) -> DesignTable:
        """Return the figures of merit of designs, by the kernel where it applies.

        A figure of merit is a number that rates a design (choice of sizes). The kernel
        computes many designs at once. There are three groups of designs:

        - Impossible designs get a row with the reason.
        - Most designs are computed together by the kernel.
        - The rest is analysed one by one. To some of them the kernel does not apply,
          because they have other kinds of loads or contacts than the mechanism of the file
          (`OTHER_FORM`). For others a solution of the closure equations is lost while it is
          tracked from design to design.

        Parameters
        ----------
        kernel
            Computes quantities of many designs at once.
        values
            (variables, n) values of the design variables, in the units of the file.

        Returns
        -------
        A row for each design and each assembly mode in which it can be assembled.
        """
        names = self.figures.names
        # `reasons` (n,) is OK, OTHER_FORM, or the reason why the design is impossible.
        sizes, reasons = self.varied_mechanism.kernel_sizes(values)
        for design, reason in self._find_impossible_arcs(values).items():
            reasons[design] = reason
        one_by_one = np.flatnonzero(reasons == OTHER_FORM)
        possible = np.flatnonzero(reasons == OK)
        impossible = np.flatnonzero((reasons != OK) & (reasons != OTHER_FORM))
        parts = [
            DesignTable.from_columns(
                impossible, names, status=IMPOSSIBLE, reason=reasons[impossible]
            )
        ]
        if len(possible):
            kernel_part, lost_designs = self._evaluate_modes(
                kernel, sizes[:, possible], file_values=values[:, possible]
            )
            one_by_one = np.append(one_by_one, possible[lost_designs])
            # Design k of `kernel_part` is design ``possible[k]`` of `values`.
            parts.append(_renumber_designs(kernel_part, possible))
        single_part = self._evaluate_one_by_one(values[:, one_by_one])
        parts.append(_renumber_designs(single_part, one_by_one))
        return DesignTable.join_by_design(parts, names)

    def _evaluate_modes(
        self, kernel: DesignKernel, sizes: Floats, file_values: Floats
    ) -> tuple[DesignTable, Indices]:
        """Return the figures of merit of designs in all assembly modes, by the kernel.

        A figure of merit is a number that rates a design (choice of sizes). An assembly
        mode is one way to assemble the mechanism. If positions have a closed form, a mode
        has a sign for each dyad (group of two links that can be assembled in two ways). If
        not, solutions of the closure equations are tracked from design to design, and some
        can be lost.

        Parameters
        ----------
        kernel
            Computes quantities of many designs at once.
        sizes
            (sizes, n) arguments of the kernel that differ between the n designs, in rad and
            SI units, which follow from `file_values`.
        file_values
            (variables, n) the numbers that the user varies, in the units of the file.

        Returns
        -------
        table
            The rows of all designs that are not lost.
        lost_designs
            Indices of the designs of which tracking has lost a solution. The caller
            evaluates them one by one.
        """
        if self.tracks_solutions:
            return self._evaluate_tracked_modes(kernel, sizes, file_values)
        no_designs = np.zeros(0, np.intp)
        return self._evaluate_signed_modes(kernel, sizes), no_designs

    def _find_impossible_arcs(self, values: Floats) -> dict[int, str]:
        """Return the designs that have an arc of a link outside 0 to 180 deg.

        Such designs are impossible. Each gets a text with the reason. Arcs of links that
        the file marks as signed are not checked, since they may be negative.

        Parameters
        ----------
        values
            (variables, n) values of the design variables, in the units of the file.

        Returns
        -------
        The reason for each impossible design, by the index of the design.
        """
        reasons: dict[int, str] = {}
        scales = self.varied_mechanism.unit_scales
        for variable, arcs, scale in zip(self.variables, values, scales, strict=True):
            if not self._is_unsigned_arc(variable):
                continue
            # NaN also counts as outside.
            is_outside = ~((arcs > 0.0) & (arcs * scale < np.pi))
            for design in np.flatnonzero(is_outside).tolist():
                reasons[design] = (
                    f"{variable.key} = {arcs[design]:g}: not between 0 and 180 deg"
                )
        return reasons

    def _is_unsigned_arc(self, variable: DesignVariable) -> bool:
        """Return whether a variable is an arc of a link that is not marked as signed.

        An arc is the angle between two axes of a link. If the file marks the link as
        signed, a negative arc leads from the first axis in the opposite direction.
        """
        geometry = self.mechanism.geometry
        angle = variable.geometric_angle
        if not isinstance(geometry, SizeGeometry):
            return False
        if angle is None or angle.kind != "arcs":
            return False
        link, _ = angle.owner
        return not geometry.links[link].signed

    def _add_missing_designs(
        self, parts: list[DesignTable], design_count: int, claim: str
    ) -> DesignTable:
        """Join tables of designs, and add a row for each design that is in none of them.

        Such a design cannot be assembled at any sample of the inputs, and its row says so.

        Parameters
        ----------
        parts
            Tables with a row for each design and assembly mode (way to assemble the
            mechanism).
        design_count
            Number of all designs.
        claim
            Text in the column `claim` of the added rows. It says whether an assembly mode
            may have been missed.
        """
        names = self.figures.names
        present = np.concatenate([part.design for part in parts])
        missing = DesignTable.from_columns(
            np.setdiff1d(np.arange(design_count), present),
            names,
            status=NEVER_CLOSES,
            reason=NEVER_CLOSES_REASON,
            claim=claim,
        )
        return DesignTable.join_by_design([*parts, missing], names)

    def _evaluate_signed_modes(self, kernel: DesignKernel, sizes: Floats) -> DesignTable:
        """Return the figures of merit of designs in all assembly modes, by signs.

        A figure of merit is a number that rates a design (choice of sizes). All positions
        have a closed form, because the links form dyads. A dyad (two links and three
        revolute pairs) can be assembled in two ways, which have different signs. Each
        combination of signs is an assembly mode (way to assemble the mechanism).

        Parameters
        ----------
        kernel
            Computes quantities of many designs from the signs of their dyads.
        sizes
            (sizes, n) sizes of the n designs (rad, SI units).

        Returns
        -------
        A row for each design and mode that can be assembled at a sample, and one for a
        design that never can. All combinations of signs are tried, so no mode of a design
        is missing. Each row says this in its column `claim`.
        """
        parts = []
        # Numbers that depend only on the sizes, computed once for all modes.
        prepared = kernel.prepare(sizes)
        # The positions depend on one sign for each dyad.
        dyad_count = len(kernel.position_arguments)
        # Each row of `rows` is one sample of the inputs.
        sample_count = len(self.figures.rows)
        shape = (dyad_count, sample_count, sizes.shape[1])
        for signs in product((1.0, -1.0), repeat=dyad_count):
            # All samples of all designs have the same signs.
            sign_arrays = np.broadcast_to(np.reshape(signs, (-1, 1, 1)), shape)
            # The closed form gives angles in (-pi, pi]. Loads such as wound springs also
            # need whole revolutions, which `revolution_offsets` adds.
            table = self.figures.evaluate_modes(
                kernel,
                prepared,
                position_arguments=sign_arrays,
                revolution_offsets=self.find_signed_mode_offsets(kernel, prepared, signs),
                labels="".join("+" if sign > 0 else "-" for sign in signs),
                claim=COMPLETE_CLAIM,
            )
            parts.append(table)
        return self._add_missing_designs(parts, sizes.shape[1], COMPLETE_CLAIM)

    def _evaluate_tracked_modes(
        self, kernel: DesignKernel, sizes: Floats, file_values: Floats
    ) -> tuple[DesignTable, Indices]:
        """Return the figures of merit of designs in all assembly modes, found by tracking.

        An assembly mode is one of the ways to assemble the mechanism. All solutions of the
        closure equations are known for one design. The solutions of other designs are
        computed while the sizes change step by step.

        Parameters
        ----------
        kernel
            Computes quantities of many designs from the variables of all pairs.
        sizes
            (sizes, n) arguments of the kernel that differ between the n designs, in rad and
            SI units, which follow from `file_values`.
        file_values
            (variables, n) the numbers that the user varies, in the units of the file.

        Returns
        -------
        table
            A row for each mode of each design that is not lost. A design that closes in no
            mode has one row too.
        lost_designs
            Indices of the designs of which tracking has lost a solution.
        """
        assert self._tracking_start is not None
        start_solutions = self._tracking_start.solutions
        # The guarantee in each row. If all solutions of the first design are known, no mode
        # of other designs is missed (complete). If not, modes may be missing (sampled).
        claim = COMPLETE_CLAIM if start_solutions.is_complete else SAMPLED_CLAIM
        # The modes of all designs, one after the other. `modes.design` is the index of the
        # design of each mode.
        modes = self.track_modes(sizes)
        # Loads may depend on whole revolutions, which tracking does not count. The offsets
        # (pairs, samples, modes) are multiples of 2 pi that are added to angles.
        revolution_offsets = np.zeros(
            (len(kernel.unwrapped_pairs), *modes.values.shape[1:])
        )
        if kernel.unwrapped_pairs:
            for design in np.unique(modes.design):
                rows = np.flatnonzero(modes.design == design)
                mechanism = self.make_kernel_mechanism(file_values[:, design])
                revolution_offsets[:, :, rows] = self.find_revolution_offsets(
                    kernel, self.make_solver(mechanism), modes.values[:, :, rows]
                )
        table = self.figures.evaluate_modes(
            kernel,
            kernel.prepare(sizes[:, modes.design]),
            position_arguments=modes.values,
            revolution_offsets=revolution_offsets,
            labels=modes.labels,
            claim=claim,
        )
        # `evaluate_modes` numbers the rows by mode. The rows are renumbered by design, and
        # a row is added for each design without a mode. Lost designs may have modes that
        # were not found, so their rows are removed.
        table = self._add_missing_designs(
            [_renumber_designs(table, modes.design)], sizes.shape[1], claim
        )
        is_lost = np.isin(table.design, modes.lost_designs)
        return table.rows(~is_lost), modes.lost_designs

    def track_modes(self, sizes: Floats) -> TrackedModes:
        """Return the configurations of n designs in all assembly modes, by tracking.

        An assembly mode is one way to assemble the mechanism. All solutions of the closure
        equations are known for one design. Changing the sizes step by step leads from these
        to the solutions of the other designs.

        Parameters
        ----------
        sizes
            (sizes, n) numbers in which the closure equations of the designs differ, in rad
            and SI units.

        Returns
        -------
        The modes. Each has its configurations at all samples of the inputs, followed by its
        configurations at the points. A point is an additional set of inputs, at which a
        figure of merit (number that rates a design) is evaluated.
        """
        assert self._tracking_start is not None
        path_kernel, start_solutions = self._tracking_start
        # The inputs in the order of tracking, from neighbour to neighbour. `row_indices`
        # finds the samples and points among them.
        input_grid, row_indices = self._tracking_inputs
        modes = track_assembly_modes(path_kernel, start_solutions, sizes, input_grid)
        return replace(modes, values=modes.values[:, row_indices])

    def analyse_positions(self, mechanism: Mechanism) -> DesignMotion:
        """Find the assembly modes of the mechanism of one design by a search.

        This is used for designs (choices of sizes) that are not computed together with
        others.

        Returns
        -------
        The modes (ways to assemble the mechanism) with their configurations, at the samples
        of the inputs and at the points. A point is an additional set of inputs, at which a
        figure of merit (number that rates a design) is evaluated.
        """
        position_analysis = self._search_modes(mechanism)
        motion_at_samples = position_analysis.motion()
        # The second axis of these values counts the samples, and then the points.
        values = [_values_by_mode(motion_at_samples)]
        if len(self.figures.points):
            values.append(_values_by_mode(self._evaluate_points(position_analysis)))
        return DesignMotion(
            position_analysis, motion_at_samples, np.concatenate(values, axis=1)
        )

    def _search_modes(self, mechanism: Mechanism) -> PositionAnalysis:
        """Search the assembly modes of one design, and return its position analysis.

        An assembly mode is one way to assemble the mechanism. All designs have the same
        samples of the inputs: a path, or a grid over the ranges of the inputs.
        `samples.search` says whether modes beside that of the reference pose are searched.
        """
        input_grid = self.samples.input_grid
        sampling: dict[str, Any] = {"path": input_grid.q}
        if not input_grid.is_path:
            sampling = {"samples": input_grid.shape}
        return PositionAnalysis(
            mechanism,
            self.inputs,
            **sampling,
            search=self.samples.search,
            # What a mode does where its configuration curve crosses another curve: "pass"
            # follows the smooth curve.
            crossings=self.samples.crossings,
        )

    def _evaluate_points(self, position_analysis: PositionAnalysis) -> Motion:
        """Return the configurations of all assembly modes at the points of figures.

        Some figures of merit (numbers that rate a design) are evaluated at certain inputs.
        These inputs are called a point.

        Parameters
        ----------
        position_analysis
            The search for the assembly modes (ways to assemble the mechanism), which has
            found the modes at the samples of the inputs.
        """
        if len(self.inputs) == 1:
            # The modes are continuous curves over one input and can be evaluated anywhere.
            # Column 0 of the points is the input. The others are rates and the time.
            return position_analysis.at(self.figures.points[:, :1])
        # With several inputs, modes are only known at samples. Each point has the inputs of
        # one sample, and `_point_samples` has its index.
        return position_analysis.samples(self._point_samples)

    @cached_property
    def _anchor(self) -> Floats:
        """(inputs,) inputs (rad) at which passive angles are in (-pi, pi]."""
        mechanism = self.mechanism.with_inputs(*self.inputs)
        return PositionSolver(mechanism, plan_assembly(mechanism)).anchor_inputs

    def find_signed_mode_offsets(
        self, kernel: DesignKernel, prepared: Floats, signs: Sequence[float]
    ) -> Floats:
        """Return the whole revolutions to add to angles of an assembly mode of n designs.

        The mode is given by the signs of its dyads (two links with three R pairs), so the
        angles are known in closed form, in (-pi, pi]. A revolution offset is the multiple
        of 2 pi that makes an angle continuous along the samples. Loads such as springs
        depend on it.

        Parameters
        ----------
        kernel
            A kernel in closed form.
        prepared
            (k, n) what ``kernel.prepare`` returns for the designs.
        signs
            The sign of each dyad.

        Returns
        -------
        (unwrapped pairs, samples + points, n) offsets (rad). Unwrapped pairs are those
        whose revolutions matter. Points are additional sets of inputs, at which figures of
        merit are evaluated.
        """
        rows = self.figures.rows
        input_count = len(self.inputs)
        design_count = prepared.shape[1]
        if not kernel.unwrapped_pairs:
            return np.zeros((0, len(rows), design_count))
        evaluate_angles = kernel.evaluate_angles
        # The arguments of the kernel are, one below the other: the sample, the signs, the
        # revolution offsets (which stay zero here) and the prepared numbers.
        signs_start = rows.shape[1]
        signs_end = signs_start + len(signs)
        prepared_start = signs_end + len(kernel.unwrapped_pairs)
        argument_count = prepared_start + len(prepared)

        def angles_at(designs: Indices, q: Floats) -> Floats:
            """Return the angles (pairs, m) of designs (m,) at inputs (m, inputs)."""
            parts = []
            for start in range(0, len(designs), ROWS_PER_ANGLE_BLOCK):
                block = designs[start : start + ROWS_PER_ANGLE_BLOCK]
                # Angles do not depend on rates, accelerations and time, which stay zero.
                arguments = np.zeros((argument_count, len(block)))
                arguments[:input_count] = q[start : start + ROWS_PER_ANGLE_BLOCK].T
                arguments[signs_start:signs_end] = np.reshape(signs, (-1, 1))
                arguments[prepared_start:] = prepared[:, block]
                outputs = evaluate_angles(arguments)
                closed = np.all(outputs[: kernel.reach_count] >= 0.0, axis=0)
                parts.append(np.where(closed, outputs[kernel.reach_count :], np.nan))
            return np.concatenate(parts, axis=1)

        q = rows[:, :input_count]
        linkage = self.varied_mechanism.equivalent_linkage
        # With a train of wheels, gear ratios relate angles to the input. So the angles do
        # not repeat after a revolution of the input.
        repeats = linkage is None or linkage.train is None
        with np.errstate(all="ignore"):
            if input_count == 1:
                return unwrap_along_one_input(
                    angles_at,
                    design_count,
                    anchor=self._anchor[0],
                    q=q[:, 0],
                    repeats=repeats,
                )
            sample_inputs, point_inputs = np.split(q, [len(self.samples.rows)])
            return unwrap_along_several_inputs(
                angles_at,
                design_count,
                anchor=self._anchor,
                q=sample_inputs,
                points=point_inputs,
            )

    def make_kernel_mechanism(self, values: Floats) -> Mechanism:
        """Return the mechanism of a design, in which links replace sliding contacts.

        A link between the centres of two circles moves the links like their contact does.
        The kernel (function for many designs) is for this mechanism, which has only R
        pairs.

        Parameters
        ----------
        values
            (variables,) values of the design variables, in the units of the file.
        """
        mechanism = make_design(self.document, self.variables, values)
        if self.varied_mechanism.equivalent_linkage is None:
            return mechanism
        equivalent_linkage = find_equivalent_linkage(mechanism, self.inputs)
        assert equivalent_linkage is not None
        return equivalent_linkage.mechanism

    def make_solver(self, mechanism: Mechanism) -> PositionSolver:
        """Return the position solver of a mechanism with the inputs of the designs."""
        mechanism = mechanism.with_inputs(*self.inputs)
        return PositionSolver(mechanism, plan_assembly(mechanism))

    def find_revolution_offsets(
        self, kernel: DesignKernel | RedundantKernel, solver: PositionSolver, values: Floats
    ) -> Floats:
        """Return multiples of 2 pi that make angles of one design continuous along samples.

        Configurations have angles in (-pi, pi]. Some loads also depend on the number of
        whole revolutions, for example a spring that is wound up. So they are counted here.

        Parameters
        ----------
        kernel
            The function that evaluates quantities of the design. Its `unwrapped_pairs` are
            the pairs (joints) for which loads depend on whole revolutions.
        solver
            The position solver of the design.
        values
            (variables, k, modes) pair variables (rad) at k successive samples. NaN where
            the mechanism cannot be assembled in the mode (way to assemble it).

        Returns
        -------
        (unwrapped pairs, k, modes) offsets (rad).
        """
        offsets = np.zeros((len(kernel.unwrapped_pairs), *values.shape[1:]))
        if not kernel.unwrapped_pairs:
            return offsets
        # Indices of the angles of these pairs among the pair variables.
        variables = [solver.mechanism.angles[name] for name in kernel.unwrapped_pairs]
        unwrapping = AngleUnwrapping(solver)
        for mode in range(values.shape[2]):
            mode_values = values[:, :, mode]
            # The samples at which the mode exists, and their configurations (n, variables).
            # At other samples the offsets stay 0.
            samples = np.flatnonzero(all_finite(mode_values, 0))
            configurations = mode_values[:, samples].T
            # (n, variables) number of revolutions to add.
            revolutions = unwrapping.count(
                mode,
                configurations,
                q=configurations[:, solver.driven],
                requested=variables,
            )
            offsets[:, samples, mode] = TURN * revolutions[:, variables].T
        return offsets

    @cached_property
    def _tracking_inputs(self) -> tuple[InputGrid, Indices]:
        """The inputs at which assembly modes are tracked, and the indices of samples.

        The configurations of an assembly mode (way to assemble the mechanism) are computed
        one from the other, at neighbouring inputs. A single input is tracked in increasing
        order through all samples and points. A point is an input at which some figure of
        merit (number that rates a design) is evaluated.

        If there are several inputs, their samples form a path or grid, and each point must
        be one of the samples.

        Returns
        -------
        input_grid
            The inputs (rad) with their neighbours.
        row_indices
            (samples + points,) index, in `input_grid`, of each sample and of each point.

        Raises
        ------
        DesignError
            If there are several inputs and a point is not a sample.
        """
        if len(self.inputs) == 1:
            # `figures.rows` are the samples, then the points. Column 0 is the input.
            q, row_indices = np.unique(self.figures.rows[:, 0], return_inverse=True)
            return InputGrid(q[:, None], (len(q),)), row_indices
        input_grid = self.samples.input_grid
        return input_grid, np.append(np.arange(len(input_grid)), self._point_samples)

    @cached_property
    def _point_samples(self) -> Indices:
        """(points,) index of the sample that has the inputs of each point.

        A point is the inputs at which some figure of merit (number that rates a design) is
        evaluated. Without a closed form, configurations are found by a search and from
        neighbour to neighbour. With several inputs they are then known only at samples, so
        each point has to be one of the samples.

        Raises
        ------
        DesignError
            If a point is not a sample.
        """
        input_grid = self.samples.input_grid
        # (points, inputs) inputs of each point. Further columns are rates and the time,
        # which do not matter for configurations.
        points = self.figures.points[:, : len(self.inputs)]
        # (samples, points) distance (rad) of each point from each sample.
        distances = max_abs(points - input_grid.q[:, None], axis=2)
        missing_points = points[np.min(distances, axis=0) > POINT_TOLERANCE_RAD]
        if len(missing_points):
            # The message names the first one.
            inputs = listing(f"{angle:.6g}" for angle in missing_points[0])
            raise DesignError(
                f"{self.mechanism.name}: no sample has the inputs {inputs} rad. If a "
                "mechanism has several inputs and groups of links other than dyads, "
                "figures of merit are computed only at samples; choose the inputs of a "
                "sample"
            )
        return np.argmin(distances, axis=0)

    # One design after the other.

    def _evaluate_one_by_one(self, values: Floats) -> DesignTable:
        """Return the figures of merit of designs, each with a position analysis of its own.

        `values` (variables, n) are the varied numbers of n designs in the units of the
        file. A design whose analysis raises an error gets one row with the reason.
        """
        parts = []
        for number, design in enumerate(values.T):
            try:
                mechanism = make_design(self.document, self.variables, design)
                table = self._evaluate_mechanism(mechanism)
            except SpherekitError as problem:
                table = failed_design(problem, self.figures.names)
            parts.append(replace(table, design=table.design + number))
        return DesignTable.join_by_design(parts, self.figures.names)

    def _evaluate_mechanism(self, mechanism: Mechanism) -> DesignTable:
        """Return the figures of the mechanism of one design, by functions of its own.

        The links are placed in closed form if possible. If not, a search finds the assembly
        modes, and a kernel computes quantities from their configurations.

        A kernel is a function that computes quantities at many samples at once.

        Returns
        -------
        A row for each assembly mode in which the loops close, or one row if they never
        close.
        """
        tries_all_signs = (
            self.samples.crossings == "end" and not self._needs_reference_mode_only
        )
        if not self._is_over_constrained and tries_all_signs:
            assembly = plan_assembly(mechanism.with_inputs(*self.inputs))
            if assembly.has_closed_form:
                closed_form_kernel = DesignKernel(
                    DesignExpressions(mechanism, self.inputs),
                    self.figures.columns,
                    compiled=False,
                )
                return self._evaluate_signed_modes(closed_form_kernel, np.empty((0, 1)))
        design_motion = self.analyse_positions(mechanism)
        position_analysis = design_motion.position_analysis
        motion = design_motion.motion
        has_shaped_profiles = self.varied_mechanism.has_shaped_profiles
        modes = position_analysis.assembly_modes
        claim = position_analysis.claim.guarantee.value
        kernel: DesignKernel | RedundantKernel
        # `by_rank`: constraints are redundant, and independent ones are chosen.
        if position_analysis.by_rank:
            # Equations that are independent in one mode may depend on each other in another
            # mode.
            configurations = most_regular_configurations(motion)
            if not configurations:
                return DesignTable.from_columns(
                    [0],
                    self.figures.names,
                    status=NEVER_CLOSES,
                    reason=NEVER_CLOSES_REASON,
                    claim=claim,
                )
            expressions_of_modes = [
                self._make_expressions(mechanism, configuration, is_redundant=True)
                for configuration in configurations
            ]
            kernel = RedundantKernel(expressions_of_modes, self.figures.columns)
        else:
            # The configuration is None if the design never closes.
            first_configuration = next(iter(motion.values[~motion.failed]), None)
            expressions = self._make_expressions(
                mechanism, first_configuration, is_redundant=False
            )
            kernel = DesignKernel(expressions, self.figures.columns, compiled=False)
        # The kernel of one design takes no sizes, hence the 0; it has one column per mode.
        table = self.figures.evaluate_modes(
            kernel,
            prepared=kernel.prepare(np.empty((0, len(modes)))),
            position_arguments=design_motion.values,
            revolution_offsets=self.find_revolution_offsets(
                kernel, position_analysis.solver, design_motion.values
            ),
            labels=[f"{mode.number} {mode.label}" for mode in modes],
            claim=claim,
            profiles=make_contact_profiles(mechanism) if has_shaped_profiles else (),
        )
        # All modes belong to the only design, with the index 0.
        table = replace(table, design=np.zeros_like(table.design))
        return self._add_missing_designs([table], 1, claim)

    def _make_expressions(
        self, mechanism: Mechanism, configuration: Floats | None, is_redundant: bool
    ) -> DesignExpressions:
        """Return the symbolic expressions of one design, from which a kernel is made.

        A design is one choice of the sizes of the mechanism. A kernel is a function that
        computes quantities, such as velocities, at many samples at once. The expressions
        are functions of the pair (joint) variables.

        Parameters
        ----------
        mechanism
            The mechanism of the design. All its sizes are constants in the expressions.
        configuration
            (variables,) pair variables in rad with which all loops close. None if none is
            known.
        is_redundant
            Whether constraints are redundant. The degrees of freedom then follow from the
            rank of the closure equations, not from counting links and pairs. Only closure
            equations that are independent at `configuration` are used.
        """
        # There are no expressions for the points of contact profiles other than circles.
        # If there are such profiles, symbols stand for the point, the tangent and the
        # curvature of each profile at its contact. These symbols are called columns.
        pairs = pair_rotations(
            mechanism, as_columns=self.varied_mechanism.has_shaped_profiles
        )
        return DesignExpressions(
            mechanism,
            self.inputs,
            # The function takes symbols for the sizes that vary. Here no size varies.
            make_pairs=lambda _size_symbols: pairs,
            # The expressions contain the pair variables, which the caller computes
            # numerically. So the variables are not expressed by the inputs.
            closed_form=False,
            closed=configuration,
            by_rank=is_redundant,
        )


def _values_by_mode(motion: Motion) -> Floats:
    """Return the pair variables (variables, samples, modes) of a motion in rad.

    A motion has a row for each sample in each assembly mode (way to assemble the links),
    sorted by mode and then by sample.
    """
    variable_count = motion.values.shape[1]
    values = motion.values.reshape(-1, motion.samples, variable_count)
    return np.transpose(values, (2, 1, 0))


def most_regular_configurations(motion: Motion) -> list[Floats]:
    """Return the configuration of each assembly mode that is farthest from a singular one.

    An assembly mode is one way to assemble the mechanism. In a singular configuration the
    inputs do not determine the motion of the other pairs. The Jacobian of the closure
    equations with respect to the passive variables (variables of pairs that are not driven)
    is then singular. The least singular value of the Jacobian measures the distance from
    such a configuration.

    Parameters
    ----------
    motion
        Configurations of one mechanism. Each row is one sample in one assembly mode.

    Returns
    -------
    For each mode that exists at some sample, the pair variables (variables,) in rad of the
    configuration with the largest least singular value.
    """
    closed_rows = np.flatnonzero(~motion.failed)
    if not len(closed_rows):
        return []
    # (closed rows, equations, passive variables)
    jacobians = motion.linearisation.jacobian[closed_rows][
        :, :, list(motion.passive_variables)
    ]
    least_singular_values = np.linalg.svd(jacobians, compute_uv=False)[:, -1]
    closed_modes = motion.assembly_mode[closed_rows]
    configurations = []
    for mode in np.unique(closed_modes):
        # Indices among the closed rows.
        candidates = np.flatnonzero(closed_modes == mode)
        best = candidates[np.argmax(least_singular_values[candidates])]
        configurations.append(motion.values[closed_rows[best]])
    return configurations


def _is_number_in_equations(variable: DesignVariable) -> bool:
    """Return whether a variable is a geometric angle, or a number of a mass or load."""
    table_in_file = variable.path[0]
    return variable.is_angle or table_in_file in ACTIONS


def _renumber_designs(table: DesignTable, numbers: Indices) -> DesignTable:
    """Return a table in which design k has the number ``numbers[k]``."""
    return replace(table, design=numbers[table.design])
