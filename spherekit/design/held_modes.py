"""Assembly modes that descents hold on to while sizes change."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, final

import numpy as np

from spherekit.design.evaluate import Evaluator
from spherekit.design.solution_paths import SAME, apart
from spherekit.design.verified_steps import followed
from spherekit.engine.design_kernel import NewtonKernel, newton_kernel
from spherekit.sphere.rotation import Floats


class HeldMode(Protocol):
    """An assembly mode at the samples of a sizing, then at the inputs of its figures."""

    @property
    def label(self) -> str:
        """Its name among the modes of the design."""
        ...

    def places(self, sizes: Floats, count: int) -> Floats:
        """Return the places of the kernel (w, count) for a design with sizes (k,).

        NaN where it does not close, or the mode cannot be followed to it.
        """
        ...

    def moved(self, sizes: Floats) -> "HeldMode":
        """Return the mode, to be followed from the design with sizes (k,) now."""
        ...

    def goes_on_in(self, other: "HeldMode") -> bool:
        """Return whether this mode, followed to the design of another, is that one."""
        ...


@final
@dataclass(frozen=True)
class SignedMode:
    """The mode of groups that are all dyads, by their signs: ``+-``."""

    label: str

    def places(self, sizes: Floats, count: int) -> Floats:
        """Return the signs (dyads, count)."""
        signs = np.array([1.0 if letter == "+" else -1.0 for letter in self.label])
        return np.repeat(signs[:, None], count, axis=1)

    def moved(self, sizes: Floats) -> "SignedMode":
        """Return the mode, which is the same for all designs."""
        return self

    def goes_on_in(self, other: HeldMode) -> bool:
        """Return whether the signs are those of another."""
        return self.label == other.label


@final
@dataclass(frozen=True, eq=False)
class FollowedMode:
    """The mode of any groups, by the configurations of one design.

    `values` (variables, count) of the design with `sizes` (k,), NaN where it does not
    close. At others they follow along the straight way between the sizes, in verified
    steps: what they are depends on no other design that was tried in between.
    """

    label: str
    newton: NewtonKernel
    sizes: Floats
    values: Floats

    def places(self, sizes: Floats, count: int) -> Floats:
        """Return the variables (w, count) at the design with sizes (k,)."""
        closes = np.flatnonzero(np.all(np.isfinite(self.values), axis=0))
        made = np.full(self.values.shape, np.nan)
        there = np.repeat(sizes[:, None], len(closes), axis=1)
        away = np.repeat((sizes - self.sizes)[:, None], len(closes), axis=1)
        values, arrived = followed(self.newton, self.values[:, closes], there, away)
        made[:, closes[arrived]] = values[:, arrived]
        return made

    def moved(self, sizes: Floats) -> "FollowedMode":
        """Return the mode with the configurations that the design with sizes (k,) has."""
        values = self.places(sizes, self.values.shape[1])
        return FollowedMode(self.label, self.newton, sizes, values)

    def goes_on_in(self, other: HeldMode) -> bool:
        """Return whether the configurations, followed to another design, are its own.

        At all samples at which both close, and at one at least.
        """
        if not isinstance(other, FollowedMode):
            return False
        values = self.places(other.sizes, self.values.shape[1])
        both = np.all(np.isfinite(values) & np.isfinite(other.values), axis=0)
        gaps = apart(values[:, both], other.values[:, both])
        return bool(np.any(both) and np.max(gaps) < SAME)


@final
class HeldModes:
    """The assembly modes of designs of an evaluator."""

    def __init__(self, evaluator: Evaluator) -> None:
        self._evaluator = evaluator

    @cached_property
    def _newton(self) -> NewtonKernel:
        return newton_kernel(self._evaluator.terms())

    @property
    def are_followed(self) -> bool:
        """Whether modes are followed from design to design, and have no signs."""
        return self._evaluator.is_followed

    def of(self, designs: Floats, labels: Sequence[str]) -> list[HeldMode | None]:
        """Return the modes with labels (n,) of designs (variables, n), in the file's units.

        None where the configurations of a design are not all known.
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
        evaluator, count = self._evaluator, designs.shape[1]
        sizes = [evaluator.inputs_at(design) for design in designs.T]
        there = [k for k in range(count) if sizes[k] is not None]
        made: list[list[FollowedMode]] = [[] for _ in range(count)]
        if not there:
            return made
        numbers = np.stack([pair[0] for pair in sizes if pair is not None], axis=1)
        modes, place = evaluator.configurations(numbers)
        for k, design in enumerate(modes.design.tolist()):
            mode = FollowedMode(
                modes.labels[k], self._newton, numbers[:, design], modes.values[:, place, k]
            )
            made[there[design]].append(mode)
        return made
