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
    """The design from which the configurations of a mode are tracked to other designs.

    Attributes
    ----------
    path_kernel
        The closure equations of all designs.
    design
        The design.
    configurations
        (variables, n) pair variables (rad) of the mode at the samples and then at the
        points of figures; NaN where the mode does not close.
    """

    path_kernel: PathKernel
    design: DesignPoint
    configurations: Floats


@dataclass(frozen=True, eq=False)
class SynthesisMode:
    """An assembly mode that is followed from design to design.

    If all groups are dyads, a mode is identified by their signs in every design. Otherwise
    its configurations are tracked along the straight path of the sizes from its origin, in
    steps that do not jump to another mode. The configurations of a design do therefore not
    depend on designs that were tried in between.

    Attributes
    ----------
    label
        Its label among the modes of a design: the signs of the dyads such as ``"+-"``, or a
        number and signs.
    origin
        Where its configurations are tracked from; None if signs identify it.
    """

    label: str
    origin: ModeOrigin | None = None

    def position_arguments(self, design: DesignPoint, count: int = 1) -> Floats:
        """Return the position arguments of the kernel for this mode of a design.

        Parameters
        ----------
        design
            The design.
        count
            Number n of samples and points of figures.

        Returns
        -------
        (w, n) signs of the dyads, or pair variables (rad), which are NaN where the mode
        does not close or cannot be tracked.
        """
        if self.origin is None:
            signs = np.array([1.0 if letter == "+" else -1.0 for letter in self.label])
            return np.repeat(signs[:, None], count, axis=1)
        origin = self.origin.design
        configurations = self.origin.configurations
        closed = np.flatnonzero(all_finite(configurations, 0))
        profiles = None
        if origin.profiles is not None:
            deviation = design.values - origin.values
            profiles = origin.profiles.interpolate_to(deviation[:, None])
        # Only configurations at which the mode closes can be tracked; the inputs are held.
        values, arrived = track_solutions(
            self.origin.path_kernel,
            start=configurations[:, closed],
            sizes=(origin.sizes[:, None], design.sizes[:, None]),
            profiles=profiles,
            contraction=LONG_PATH_CONTRACTION,
        )
        arguments = nans(configurations.shape)
        arguments[:, closed[arrived]] = values[:, arrived]
        return arguments

    def with_origin(self, design: DesignPoint) -> "SynthesisMode":
        """Return the same mode, tracked from another design from now on."""
        if self.origin is None:
            return self
        origin = ModeOrigin(
            self.origin.path_kernel, design, self.position_arguments(design)
        )
        return SynthesisMode(self.label, origin)

    def continues_in(self, other_mode: "SynthesisMode") -> bool:
        """Return whether this mode is another one when it is tracked to its design.

        They are the same mode if their configurations agree wherever both close, which must
        be at one sample or more.
        """
        if other_mode.origin is None:
            return self.label == other_mode.label
        other_configurations = other_mode.origin.configurations
        values = self.position_arguments(other_mode.origin.design)
        both_close = all_finite(values, 0) & all_finite(other_configurations, 0)
        distances = solution_distance(
            values[:, both_close], other_configurations[:, both_close]
        )
        return bool(np.any(both_close) and np.max(distances) < SAME_SOLUTION_RAD)


def find_labelled_modes(
    evaluator: DesignEvaluator, designs: Floats, labels: Sequence[str]
) -> list[SynthesisMode | None]:
    """Return one mode of each design.

    Parameters
    ----------
    evaluator
        The evaluator of the designs.
    designs
        (variables, n) values of the variables, in the units of the file.
    labels
        (n,) the label of the mode of each design.

    Returns
    -------
    The modes, None where the design has no such mode.
    """
    if not evaluator.has_unsigned_modes:
        return [SynthesisMode(label) for label in labels]
    # Each design is searched once; `number` is that of each design among the unique ones.
    unique_designs, number = np.unique(designs, axis=1, return_inverse=True)
    modes_by_label = [
        {mode.label: mode for mode in modes}
        for modes in find_all_modes(evaluator, unique_designs)
    ]
    return [modes_by_label[k].get(x) for k, x in zip(number, labels, strict=True)]


def find_all_modes(
    evaluator: DesignEvaluator, designs: Floats
) -> list[list[SynthesisMode]]:
    """Return all modes of each design, with configurations from which they are tracked.

    If profiles are not circles, the modes of each design are found by a search. Otherwise
    the solutions of all designs are tracked together from those of one design.

    Parameters
    ----------
    evaluator
        An evaluator whose modes have no signs.
    designs
        (variables, n) values of the variables, in the units of the file.

    Returns
    -------
    The modes of each design; none if it is impossible or does not close.
    """
    modes_of_design: list[list[SynthesisMode]] = [[] for _ in designs.T]
    evaluated = [evaluator.varied_mechanism.evaluate_design(design) for design in designs.T]
    possible = [(k, design) for k, design in enumerate(evaluated) if design is not None]

    def append_mode(
        index: int, label: str, design: DesignPoint, configurations: Floats
    ) -> None:
        """Add a mode to those of the design with this index.

        The configurations are (variables, samples + points), in rad.
        """
        origin = ModeOrigin(evaluator.path_kernel, design, configurations)
        modes_of_design[index].append(SynthesisMode(label, origin))

    if evaluator.varied_mechanism.has_shaped_profiles:
        for index, design in possible:
            assert design.profiles is not None
            with suppress(SpherekitError):
                motion = evaluator.analyse_positions(design.profiles.mechanism)
                for k, mode in enumerate(motion.position_analysis.assembly_modes):
                    label = f"{mode.number} {mode.label}"
                    append_mode(index, label, design, motion.values[:, :, k])
    elif possible:
        sizes = np.stack([design.sizes for _, design in possible], axis=1)
        modes = evaluator.track_modes(sizes)
        # `number` counts the possible designs only.
        for k, (number, label) in enumerate(zip(modes.design, modes.labels, strict=True)):
            index, design = possible[number]
            append_mode(index, label, design, modes.values[:, :, k])
    return modes_of_design
