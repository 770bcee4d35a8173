"""Assembly modes that a synthesis follows from design to design."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.designs.design_evaluation import DesignEvaluator
from spherekit.designs.homotopy import (
    LONG_PATH_CONTRACTION,
    SAME_SOLUTION_RAD,
    solution_distance,
    track_solutions,
)
from spherekit.designs.path_kernel import PathKernel
from spherekit.designs.varied_mechanism import DesignPoint
from spherekit.errors import SpherekitError
from spherekit.geometry.vectors import all_finite, nans


@dataclass(frozen=True, eq=False)
class ModeOrigin:
    """Configurations of an assembly mode in one design, from which others are computed.

    An assembly mode is one way to assemble a mechanism. A design is one choice of its
    sizes. In other designs the configurations are found by changing the sizes step by step.

    Attributes
    ----------
    path_kernel
        The closure equations of all designs.
    design
        The design with these configurations.
    configurations
        (variables, n) pair (joint) variables in rad. The first columns belong to the
        samples of the input. The last columns belong to inputs that figures of merit such
        as ``at(theta_41, 0.5)`` state. NaN where the mechanism cannot be assembled in this
        mode.
    """

    path_kernel: PathKernel
    design: DesignPoint
    configurations: Floats

    def track_to(self, design: DesignPoint) -> Floats:
        """Return the configurations of the mode in another design, at the same inputs.

        Callers evaluate the other design in this mode, or compare the configurations with
        those of a mode of the other design. The sizes change gradually to the sizes of the
        other design. Newton's method closes the loops of links at each step.

        Returns
        -------
        (variables, n) pair variables (rad), NaN where the mechanism cannot be assembled in
        one of the two designs, or the tracking fails.
        """
        # Columns of NaN are inputs at which this design cannot be assembled.
        closed_indices = np.flatnonzero(all_finite(self.configurations, 0))
        # Contact profiles that are not circles change gradually, too.
        profiles = None
        if self.design.profiles is not None:
            # Difference of the design variables, which determine the profiles.
            deviation = design.values - self.design.values
            profiles = self.design.profiles.interpolate_to(deviation[:, None])
        # `contraction` is the largest allowed ratio of two successive steps of Newton's
        # method. With a larger ratio the path could jump to another assembly mode, so the
        # sizes change by smaller steps.
        tracked_values, has_arrived = track_solutions(
            self.path_kernel,
            start=self.configurations[:, closed_indices],
            sizes=(self.design.sizes[:, None], design.sizes[:, None]),
            profiles=profiles,
            contraction=LONG_PATH_CONTRACTION,
        )
        configurations = nans(self.configurations.shape)
        configurations[:, closed_indices[has_arrived]] = tracked_values[:, has_arrived]
        return configurations


@dataclass(frozen=True, eq=False)
class SynthesisMode:
    """An assembly mode (way to assemble the links) that is followed from design to design.

    A dyad is a group of two links with three R pairs. If all groups are dyads and all
    contact profiles are circles, the signs of the dyads identify a mode. If not, the
    configurations of a new design are tracked: from a known design, the origin, the sizes
    change step by step to the new design.

    Tracking always starts at the origin. The result therefore does not depend on designs
    that were tried in between.

    Attributes
    ----------
    label
        Label of the mode among those of a design: the signs of the dyads such as ``"+-"``,
        or a number and signs.
    origin
        The known configurations from which all others of this mode are tracked. None if
        signs identify the mode.
    """

    label: str
    origin: ModeOrigin | None = None

    def position_arguments(self, design: DesignPoint, count: int) -> Floats:
        """Return the numbers from which the positions of links follow in this mode.

        The numbers are arguments of kernels (functions of many configurations). Without an
        `origin`, the numbers are signs of dyads: a dyad (two links and three revolute
        pairs) can be assembled in two ways. An `origin` has the known configurations of one
        design. The numbers are then the variables of all pairs (joints), tracked from this
        design.

        Parameters
        ----------
        design
            The design in which the mode is evaluated.
        count
            Number n of configurations. An origin has the same number.

        Returns
        -------
        (dyads, n) signs of the dyads (1 or -1), or (variables, n) pair variables (rad).
        These are NaN where the mechanism cannot be assembled or the tracking fails.
        """
        if self.origin is not None:
            return self.origin.track_to(design)
        # The label has one letter, "+" or "-", for each dyad.
        signs = np.array([1.0 if letter == "+" else -1.0 for letter in self.label])
        return np.repeat(signs[:, None], count, axis=1)

    def with_origin(self, design: DesignPoint) -> "SynthesisMode":
        """Return the same mode with another design as the start from which it is tracked.

        To track a mode means to follow its configurations while the sizes change step by
        step. A shorter way from the start takes fewer steps. A mode that is identified by
        signs of dyads (two links with three R pairs) is not tracked, and is returned
        unchanged.
        """
        if self.origin is None:
            return self
        origin = ModeOrigin(self.origin.path_kernel, design, self.origin.track_to(design))
        return SynthesisMode(self.label, origin)

    def continues_in(self, other_mode: "SynthesisMode") -> bool:
        """Return whether two assembly modes of different designs are the same mode.

        An assembly mode is one way to assemble the mechanism. If signs of dyads (groups of
        two links) identify modes, the signs are compared. If not, the configurations of
        this mode are followed to the other design, while the sizes change step by step.
        These configurations must agree with the configurations of the other mode at all
        inputs at which both modes exist, and there must be such an input.
        """
        # The origin of a mode is the design from which the mode is followed, with its
        # configurations there. Modes that are identified by signs have no origin, and their
        # labels are the signs.
        if self.origin is None or other_mode.origin is None:
            return self.label == other_mode.label
        # (variables, inputs) configurations. Those that do not exist are NaN.
        tracked_configurations = self.origin.track_to(other_mode.origin.design)
        other_configurations = other_mode.origin.configurations
        both_exist = all_finite(tracked_configurations, 0) & all_finite(
            other_configurations, 0
        )
        distances = solution_distance(
            tracked_configurations[:, both_exist], other_configurations[:, both_exist]
        )
        return bool(np.any(both_exist) and np.max(distances) < SAME_SOLUTION_RAD)


def find_labelled_modes(
    evaluator: DesignEvaluator, designs: Floats, labels: Sequence[str]
) -> list[SynthesisMode | None]:
    """Return, for each design, its assembly mode with a given label.

    A synthesis first evaluates many designs. Each row of the result has a design and the
    label of one of its assembly modes (ways to assemble the mechanism). Local optimisations
    start from the best rows, and follow their modes while the design changes.

    A dyad is a group of two links with three revolute pairs. If all groups are dyads and
    all contact profiles are circles, the label is a sign for each dyad, such as ``"+-"``.
    This label describes the mode completely, so no search is needed. If not, the label has
    a number and signs. All modes of each design are then searched at the samples of the
    evaluator.

    Parameters
    ----------
    evaluator
        Evaluates the designs of the mechanism.
    designs
        (variables, n) values of the numbers in the mechanism file that differ from design
        to design, in the units of the file.
    labels
        (n,) the label of the mode that is sought in each design.

    Returns
    -------
    The mode of each design. After a search, the item is None for a design without a mode of
    this label.
    """
    # The signs of dyads identify the modes, and are their labels.
    if not evaluator.has_unsigned_modes:
        return [SynthesisMode(label) for label in labels]
    # A design may occur several times, with different labels, but is searched once.
    unique_designs, unique_indices = np.unique(designs, axis=1, return_inverse=True)
    modes_of_unique_design = [
        {mode.label: mode for mode in modes}
        for modes in find_all_modes(evaluator, unique_designs)
    ]
    return [
        modes_of_unique_design[unique_index].get(label)
        for unique_index, label in zip(unique_indices, labels, strict=True)
    ]


def find_all_modes(
    evaluator: DesignEvaluator, designs: Floats
) -> list[list[SynthesisMode]]:
    """Return all assembly modes of each design, with their configurations.

    An assembly mode is one of the ways to assemble the mechanism at given inputs. The
    configurations serve as the start when a mode is tracked to other designs later.

    Parameters
    ----------
    evaluator
        An evaluator whose modes are not identified by signs of dyads (two links and three R
        pairs), because some group of links is larger, or a contact profile is no circle.
    designs
        (variables, n) values of the numbers in the mechanism file that differ from design
        to design, in the units of the file.

    Returns
    -------
    The modes of each design. The list is empty if the design is impossible or cannot be
    assembled.
    """
    modes_of_design: list[list[SynthesisMode]] = [[] for _ in designs.T]
    design_points = [
        evaluator.varied_mechanism.evaluate_design(design) for design in designs.T
    ]
    # Impossible designs are None. The others keep their index among all designs.
    possible_designs = [
        (index, design) for index, design in enumerate(design_points) if design is not None
    ]

    def append_mode(
        index: int, label: str, design: DesignPoint, configurations: Floats
    ) -> None:
        """Add an assembly mode to the modes of the design with this index.

        `configurations` (variables, n) are the pair variables in rad: at the samples of the
        input, then at the other inputs at which figures of merit are evaluated.
        """
        # The kernel has the closure equations, by which modes are tracked later.
        origin = ModeOrigin(evaluator.path_kernel, design, configurations)
        modes_of_design[index].append(SynthesisMode(label, origin))

    if evaluator.varied_mechanism.has_shaped_profiles:
        # Some profiles are not circles: the modes of each design are searched singly. A
        # design for which the search fails has no modes.
        for index, design in possible_designs:
            assert design.profiles is not None
            with suppress(SpherekitError):
                motion = evaluator.analyse_positions(design.profiles.mechanism)
                # `values` are (variables, n, modes).
                for k, mode in enumerate(motion.position_analysis.assembly_modes):
                    label = f"{mode.number} {mode.label}"
                    append_mode(index, label, design, motion.values[:, :, k])
    elif possible_designs:
        # The solutions of one design are tracked to all designs together.
        sizes = np.stack([design.sizes for _, design in possible_designs], axis=1)
        modes = evaluator.track_modes(sizes)
        for k, (position, label) in enumerate(zip(modes.design, modes.labels, strict=True)):
            # `modes.design` counts the possible designs only.
            index, design = possible_designs[position]
            append_mode(index, label, design, modes.values[:, :, k])
    return modes_of_design
