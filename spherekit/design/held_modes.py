"""Assembly modes that descents hold on to while sizes change."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Floats
from spherekit.design.evaluate import Evaluator
from spherekit.design.homotopy import LONG, SAME, apart, straight, tracked
from spherekit.design.sensitivity import DesignAt
from spherekit.engine.design_kernel import PathKernel, path_kernel
from spherekit.errors import SpherekitError
from spherekit.sphere.rotation import all_finite, nans


@dataclass(frozen=True)
class SignedMode:
    """The mode of groups that are all dyads, by their signs: ``+-``."""

    label: str

    def places(self, design: DesignAt, count: int) -> Floats:
        """Return the signs (dyads, count)."""
        signs = np.array([1.0 if letter == "+" else -1.0 for letter in self.label])
        return np.repeat(signs[:, None], count, axis=1)

    def moved(self, design: DesignAt) -> "SignedMode":
        """Return the mode, which is the same for all designs."""
        return self

    def goes_on_in(self, other: "HeldMode") -> bool:
        """Return whether the signs are those of another."""
        return self.label == other.label


@dataclass(frozen=True, eq=False)
class FollowedMode:
    """The mode of any groups and profiles, by the configurations of one design.

    `configurations` (variables, count) of a `design`, NaN where it does not close. At
    others they follow along the straight way between the numbers, in verified steps:
    what they are depends on no other design that was tried in between.
    """

    label: str
    newton: PathKernel
    design: DesignAt
    configurations: Floats

    def places(self, design: DesignAt, count: int) -> Floats:
        """Return the variables (w, count) at a design."""
        closes = np.flatnonzero(all_finite(self.configurations, 0))
        made = nans(self.configurations.shape)
        way = straight((self.design.sizes[:, None], design.sizes[:, None]))
        start, profiles = self.configurations[:, closes], None
        if self.design.profiles is not None:
            onward = design.values - self.design.values
            profiles = self.design.profiles.towards(onward[:, None])
        values, arrived = tracked(self.newton, way, start, profiles, LONG)
        made[:, closes[arrived]] = values[:, arrived]
        return made

    def moved(self, design: DesignAt) -> "FollowedMode":
        """Return the mode with the configurations that another design has."""
        values = self.places(design, self.configurations.shape[1])
        return FollowedMode(self.label, self.newton, design, values)

    def goes_on_in(self, other: "HeldMode") -> bool:
        """Return whether the configurations, followed to another design, are its own.

        At all samples at which both close, and at one at least.
        """
        if not isinstance(other, FollowedMode):
            return False
        values = self.places(other.design, self.configurations.shape[1])
        both = np.all(np.isfinite(values) & np.isfinite(other.configurations), axis=0)
        gaps = apart(values[:, both], other.configurations[:, both])
        return bool(np.any(both) and np.max(gaps) < SAME)


HeldMode = SignedMode | FollowedMode
"""An assembly mode at the samples of a synthesis, then at the inputs of its figures.

Its `label` is its name among the modes of the design, `places` are those (w, count) that
the kernel has of it for a design, NaN where it does not close or cannot be followed to it.
"""


class TrackedModes:
    """The assembly modes of designs of an evaluator."""

    def __init__(self, evaluator: Evaluator) -> None:
        self._evaluator = evaluator

    @cached_property
    def _newton(self) -> PathKernel:
        return path_kernel(self._evaluator.varied.terms(), alone=True)

    @property
    def are_followed(self) -> bool:
        """Whether modes are followed from design to design, and have no signs."""
        return self._evaluator.is_followed or self._evaluator.varied.is_profiled

    def of(self, designs: Floats, labels: Sequence[str]) -> list[HeldMode | None]:
        """Return the modes with labels (n,) of designs (variables, n), in the file's units.

        None where the configurations of a design are not all possible.
        """
        if not self.are_followed:
            return [SignedMode(label) for label in labels]
        made: list[HeldMode | None] = [None] * len(labels)
        unique, number = np.unique(designs, axis=1, return_inverse=True)
        for design, modes in enumerate(self.every(unique)):
            for row in np.flatnonzero(np.ravel(number) == design).tolist():
                same = [mode for mode in modes if mode.label == labels[row]]
                made[row] = same[0] if same else None
        return made

    def every(self, designs: Floats) -> list[list[FollowedMode]]:
        """Return all modes of each design (variables, n), which are followed ones."""
        there = [self._evaluator.varied.design_at(design) for design in designs.T]
        if self._evaluator.varied.is_profiled:
            return [self._traced(design) if design else [] for design in there]
        made: list[list[FollowedMode]] = [[] for _ in there]
        possible = [k for k, design in enumerate(there) if design is not None]
        if not possible:
            return made
        sizes = np.stack([design.sizes for design in there if design is not None], axis=1)
        modes, place = self._evaluator.configurations(sizes)
        for k, number in enumerate(modes.design.tolist()):
            design = there[possible[number]]
            assert design is not None
            values = modes.values[:, place, k]
            made[possible[number]].append(self._held(modes.labels[k], design, values))
        return made

    def _held(self, label: str, design: DesignAt, values: Floats) -> FollowedMode:
        return FollowedMode(label, self._newton, design, values)

    def _traced(self, design: DesignAt) -> list[FollowedMode]:
        """Return all modes of a design with profiles."""
        assert design.profiles is not None
        try:
            tracer, _, values = self._evaluator.traced(design.profiles.mechanism)
        except SpherekitError:
            return []
        return [
            self._held(f"{mode.number} {mode.label}", design, values[:, :, k])
            for k, mode in enumerate(tracer.assembly_modes)
        ]
