"""Assembly modes that descents hold on to while sizes change."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.design.evaluate import Evaluator
from spherekit.design.homotopy import LONG, SAME, apart, straight, tracked
from spherekit.design.varied import DesignAt
from spherekit.engine.design_kernel import PathKernel
from spherekit.errors import SpherekitError
from spherekit.sphere.rotation import all_finite, nans


@dataclass(frozen=True, eq=False)
class HeldMode:
    """An assembly mode at the samples of a synthesis, then at the inputs of its figures.

    Its `label` is its name among the modes of the design. Of groups that are all dyads it
    has their signs, ``+-``. Others are `followed`: by Newton's step from a design and its
    configurations (variables, count), NaN where it does not close. At other designs they
    follow along the straight way between the numbers, in verified steps: what they are
    depends on no design that was tried in between.
    """

    label: str
    followed: tuple[PathKernel, DesignAt, Floats] | None = None

    def places(self, design: DesignAt, count: int) -> Floats:
        """Return what the kernel has of it (w, count) for a design: signs, or variables.

        NaN where it does not close or cannot be followed there.
        """
        if self.followed is None:
            signs = np.array([1.0 if letter == "+" else -1.0 for letter in self.label])
            return np.repeat(signs[:, None], count, axis=1)
        newton, begun, configurations = self.followed
        closes, profiles = np.flatnonzero(all_finite(configurations, 0)), None
        way = straight((begun.sizes[:, None], design.sizes[:, None]))
        if begun.profiles is not None:
            profiles = begun.profiles.towards((design.values - begun.values)[:, None])
        values, arrived = tracked(newton, way, configurations[:, closes], profiles, LONG)
        made = nans(configurations.shape)
        made[:, closes[arrived]] = values[:, arrived]
        return made

    def moved(self, design: DesignAt) -> "HeldMode":
        """Return the mode that is followed from another design from now on."""
        if self.followed is None:
            return self
        newton, _, configurations = self.followed
        values = self.places(design, configurations.shape[1])
        return HeldMode(self.label, (newton, design, values))

    def goes_on_in(self, other: "HeldMode") -> bool:
        """Return whether it is another, or becomes it when it is followed to its design.

        At all samples at which both close, and at one at least.
        """
        if other.followed is None:
            return self.label == other.label
        _, design, configurations = other.followed
        values = self.places(design, configurations.shape[1])
        both = np.all(np.isfinite(values) & np.isfinite(configurations), axis=0)
        gaps = apart(values[:, both], configurations[:, both])
        return bool(np.any(both) and np.max(gaps) < SAME)


def held_modes(
    evaluator: Evaluator, designs: Floats, labels: Sequence[str]
) -> list[HeldMode | None]:
    """Return the modes with labels (n,) of designs (variables, n), in the file's units.

    None where the configurations of a design are not all possible.
    """
    if not evaluator.follows_modes:
        return [HeldMode(label) for label in labels]
    unique, number = np.unique(designs, axis=1, return_inverse=True)
    by_design = [
        {mode.label: mode for mode in modes} for modes in every_mode(evaluator, unique)
    ]
    return [by_design[k].get(x) for k, x in zip(np.ravel(number), labels, strict=True)]


def every_mode(evaluator: Evaluator, designs: Floats) -> list[list[HeldMode]]:
    """Return all modes of each design (variables, n), which are followed ones."""
    there = [evaluator.varied.design_at(design) for design in designs.T]
    if evaluator.varied.is_profiled:
        return [list(_traced(evaluator, design)) if design else [] for design in there]
    made: list[list[HeldMode]] = [[] for _ in there]
    possible = [(k, design) for k, design in enumerate(there) if design is not None]
    if possible:
        sizes = np.stack([design.sizes for _, design in possible], axis=1)
        modes, place = evaluator.configurations(sizes)
        for row, number in enumerate(modes.design.tolist()):
            k, design = possible[number]
            followed = evaluator.newton, design, modes.values[:, place, row]
            made[k].append(HeldMode(modes.labels[row], followed))
    return made


def _traced(evaluator: Evaluator, design: DesignAt) -> Iterator[HeldMode]:
    """Yield all modes of a design with profiles."""
    assert design.profiles is not None
    try:
        tracer, _, values = evaluator.traced(design.profiles.mechanism)
    except SpherekitError:
        return
    for k, mode in enumerate(tracer.assembly_modes):
        followed = evaluator.newton, design, values[:, :, k]
        yield HeldMode(f"{mode.number} {mode.label}", followed)
