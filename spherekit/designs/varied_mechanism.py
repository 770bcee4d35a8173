"""A mechanism of which numbers of its file vary: one set of terms for all designs.

Numbers of a kernel that are read from the file of each design, with its checks.
"""

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import Names
from spherekit.designs.design_kernel import DesignKernel
from spherekit.designs.design_variables import (
    ACTIONS,
    OK,
    POINTED,
    DesignVariable,
    designed,
    reason_of,
    slope_by,
)
from spherekit.designs.profile_numbers import ProfileNumbers, has_other_profiles
from spherekit.errors import DesignError, SpherekitError
from spherekit.files.mechanism_reader import replace_actions
from spherekit.files.number_change import with_numbers
from spherekit.files.toml_document import Document
from spherekit.geometry.vectors import all_finite, nans
from spherekit.mechanism.coaxial_links import SAME_AXIS_RAD
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap
from spherekit.symbolic.expression_graph import symbols
from spherekit.symbolic.frame_expressions import direction_from_angles
from spherekit.symbolic.vector_algebra import Exprs
from spherekit.velocities.axis_rotations import pair_rotations
from spherekit.velocities.design_expressions import DesignExpressions
from spherekit.velocities.equivalent_linkage import (
    EquivalentLinkage,
    find_equivalent_linkage,
)
from spherekit.velocities.load_numbers import (
    list_numbers,
    masses_and_loads,
    replace_numbers,
)

DEG = np.pi / 180.0
UNLIKE = "its loads or contacts have another form"
"""What sends a design to the analysis of the single one."""
TRIED = (0.0173, -0.0311)
"""Parts by which variables are changed to see which numbers follow them."""
PARTS = np.array([1e-2, 1e-4, 1e-6])
"""Steps of differences, as parts of a number: shorter ones where no design is that far."""
SAME = 1e-14
"""Numbers that differ by less are the same but for rounding."""
STEADY = 1e-10
"""Derivatives that differ by less, relative, are the same."""


@dataclass(frozen=True)
class DesignAt:
    """What kernels have of a design.

    `values` (variables,) in the file's units, `sizes` (k,) in rad and SI with their
    derivatives `slopes` (k, variables) by the values, and profiles that are handed in.
    """

    values: Floats
    sizes: Floats
    slopes: Floats
    profiles: ProfileNumbers | None

    def at(
        self,
        kernel: DesignKernel,
        samples: Floats,
        places: Floats,
        values: Floats,
        turns: Floats | None = None,
    ) -> tuple[Bools, Floats, Floats]:
        """Return where dyads close (n,), the columns (c, n) of a kernel, and their changes.

        Those (variables, c, n) by the values, the loops staying closed; `kernel` has the
        gradients of its columns, and `samples` (k, n), `places` and `turns` are as in it;
        `values` (n, w) are the configurations at which profiles touch, NaN where none is.
        """
        profiles = self.profiles
        columns = None if profiles is None else profiles.columns(values)
        outputs = kernel.at(samples, places, self.sizes[:, None], columns, turns)
        closed = np.all(outputs[: kernel.reaches] >= 0.0, axis=0)
        if not kernel.columns:
            # Figures of sizes and inputs alone read no column of a configuration.
            none = np.zeros((0, len(values)))
            return closed, none, np.zeros((len(self.values), *none.shape))
        made = outputs[kernel.reaches :].reshape(-1, len(kernel.columns), len(values))
        changes = np.zeros((len(self.values), *made.shape[1:]))
        for variable, slopes in enumerate(self.slopes.T):
            some = np.flatnonzero(slopes)  # others may have no derivative
            changes[variable] = np.tensordot(slopes[some], made[1 + some], 1)
        if profiles is not None:
            whole = all_finite(values, 1)
            changes[:, :, whole] += np.einsum(
                "kpn,pcn->kcn",
                profiles.slopes(values[whole]),
                made[1 + len(self.sizes) :, :, whole],
            )
        return closed, made[0], changes


@dataclass(frozen=True, eq=False)
class VariedMechanism:
    """The designs of a mechanism, by numbers of its file.

    Kernels have the sizes of R pairs that vary, or with `contacts` of circles as links the
    angles of these; then the numbers of masses and loads that follow the variables, which
    with contacts, or where masses `follow` sizes, are read from the whole file of a design.
    Profiles that are no circles are handed in. Wheels may be `apart` (rad).
    """

    document: Document
    mechanism: Mechanism
    variables: tuple[DesignVariable, ...]
    inputs: Names
    contacts: EquivalentLinkage | None = None
    follow: bool = False
    apart: float = SAME_AXIS_RAD

    @cached_property
    def values(self) -> Floats:
        """What the variables are in the file, in its units."""
        return np.array([variable.value for variable in self.variables])

    @cached_property
    def scale(self) -> Floats:
        """What a unit of each variable is in rad and SI."""
        unit = DEG if self.document.data["angle_unit"] == "deg" else 1.0
        return np.array([unit if v.is_angle else 1.0 for v in self.variables])

    @cached_property
    def sized(self) -> list[int]:
        """The variables that are sizes of kernels."""
        sized = [k for k, v in enumerate(self.variables) if v.slot is not None]
        return sized if self.contacts is None else []

    @property
    def _whole(self) -> bool:
        """Whether the whole file of a design is read."""
        return self.follow or self.contacts is not None

    @cached_property
    def is_profiled(self) -> bool:
        """Whether profiles are no circles, and what they are is handed in."""
        return has_other_profiles(self.mechanism)

    def terms(self, closed_form: bool | None = None) -> DesignExpressions:
        """Return what kernels of all designs are written in."""
        contacts = self.contacts
        first = self._contacts
        acting = [k - first for k in self.differing if k >= first]
        if contacts is not None:
            if self.points:
                raise DesignError(
                    f"{self.mechanism.name}: outputs point elsewhere in designs whose "
                    "contacts stay; vary one or the other"
                )
            names = {k: f"turned_{k}" for k in self.of_contacts}
            return DesignExpressions(
                contacts.mechanism,
                self.inputs,
                tuple(names.values()),
                lambda terms: contacts.pairs({k: terms[n] for k, n in names.items()}),
                closed_form,
                acting,
                pointing=self._pointing,
            )
        slots = {v.name: v.slot for v in self.variables if v.slot is not None}
        shapes = [name for name, (kind, _) in slots.items() if kind != POINTED]
        profiled = self.is_profiled
        mechanism = self.mechanism
        return DesignExpressions(
            mechanism,
            self.inputs,
            list(slots),
            lambda terms: pair_rotations(
                mechanism, {slots[x]: terms[x] for x in shapes}, as_columns=profiled
            ),
            False if profiled else closed_form,
            acting,
            pointing=self._pointing,
        )

    @property
    def points(self) -> bool:
        """Whether numbers of outputs vary."""
        return any(variable.path[0] == "outputs" for variable in self.variables)

    @property
    def _pointing(self) -> dict[str, str | Exprs]:
        """Where outputs point, if that varies: along the axis of a pair, or by terms."""
        outputs = self.document.data.get("outputs", {})
        made: dict[str, Any] = {x: y["axis"] for x, y in outputs.items() if "axis" in y}
        unit = DEG if self.document.data["angle_unit"] == "deg" else 1.0
        for variable in self.variables:
            kind, place = variable.slot or ("", None)
            if place is not None and kind == POINTED:
                name, k = place
                numbers = [unit * float(x) for x in outputs[name]["lonlat"]]
                angles = made.setdefault(name, numbers)
                (angles[k],) = symbols([variable.name])
        return {
            x: y if isinstance(y, str) else direction_from_angles(*y)
            for x, y in made.items()
        }

    @property
    def nominal(self) -> Floats:
        """What kernels have as sizes (k,) in the file."""
        return np.concatenate(
            [(self.scale * self.values)[self.sized], self._stated[self.differing]]
        )

    def sizes(self, values: Floats) -> tuple[Floats, NDArray[np.object_]]:
        """Return what kernels have (k, n) of designs (variables, n) in the file's units.

        In rad and SI; and why designs (n,) are none, `OK` where they are. Of a design whose
        laws have another form, or other numbers than those that differ, `UNLIKE`.
        """
        numbers = nans((len(self.differing), values.shape[1]))
        why = np.full(values.shape[1], OK, dtype=object)
        for k, design in enumerate(values.T if self._reads else ()):
            try:
                numbers[:, k] = self._differing(design)
            except SpherekitError as problem:
                why[k] = reason_of(problem)
        return np.concatenate([(values * self.scale[:, None])[self.sized], numbers]), why

    def design_at(self, values: Floats, made: Mechanism | None = None) -> DesignAt | None:
        """Return what kernels have of a design (variables,), None if there is none.

        `made` is the mechanism, if that is known.
        """
        sizes, why = self.sizes(values[:, None])
        if why[0] != OK:
            return None
        of_numbers = [
            self._slope(values, k) if steady is None else steady
            for k, steady in enumerate(self.steady)
        ]
        slopes = [np.diag(self.scale)[self.sized], np.stack(of_numbers, axis=1)]
        profiles = None
        if self.is_profiled:
            try:
                profiles = ProfileNumbers(self.document, self.variables, values, made)
            except SpherekitError:
                return None
        return DesignAt(values, sizes[:, 0], np.concatenate(slopes), profiles)

    # What the file of a design says of masses and loads, and of contacts of circles.

    @property
    def _reads(self) -> bool:
        """Whether numbers are read from the file of each design."""
        return self._whole or any(v.path[0] in ACTIONS for v in self.variables)

    @property
    def _contacts(self) -> int:
        """How many numbers contacts have: these are the first that are read."""
        return 0 if self.contacts is None else len(self.contacts.numbers)

    @cached_property
    def _stated(self) -> Floats:
        """All numbers that are read of the file as it is."""
        of_contacts = self.contacts.numbers if self.contacts else []
        return np.array([*of_contacts, *list_numbers(masses_and_loads(self.mechanism))])

    @cached_property
    def _tried(self) -> list[tuple[Floats, Floats]]:
        """Designs beside that of the file, and all numbers of these."""
        designs = [self.values * (1.0 + share) + share for share in TRIED]
        every = [(design, self._possible(design)) for design in designs]
        return [(design, numbers) for design, numbers in every if numbers is not None]

    @cached_property
    def varies(self) -> bool:
        """Whether the file can be read with other numbers."""
        # Some vary by whole numbers, and some only with others.
        steps = np.concatenate([size * np.eye(len(self.values)) for size in (1.0, *TRIED)])
        alone = (self._possible(self.values * (1.0 + step)) for step in steps)
        return bool(self._tried) or any(numbers is not None for numbers in alone)

    @cached_property
    def differing(self) -> Indices:
        """Which of the numbers that are read follow the variables, all if none can vary."""
        if not self._reads:
            return np.zeros(0, np.intp)
        others = [numbers != self._stated for _, numbers in self._tried]
        differ = np.any(others, axis=0) if others else np.ones(len(self._stated), bool)
        return np.flatnonzero(differ)

    @property
    def of_contacts(self) -> list[int]:
        """Those of the contacts that differ."""
        return [k for k in self.differing if k < self._contacts]

    def _read(self, values: Floats) -> Floats:
        """Return all numbers of a design (variables,); raise where there are none."""
        contacts: list[float] = []
        if self._whole:
            made = designed(self.document, self.variables, values)
        else:
            both = zip(self.variables, map(float, values), strict=True)
            acting = {v.path: number for v, number in both if v.path[0] in ACTIONS}
            made = replace_actions(self.mechanism, with_numbers(self.document, acting))
        actions = masses_and_loads(made)
        if self.contacts is not None:
            with_contacts = find_equivalent_linkage(made, self.inputs, self.apart)
            if with_contacts is None or with_contacts.form != self.contacts.form:
                raise DesignError(UNLIKE)
            contacts = with_contacts.numbers
        form, other = (
            replace_numbers(x, lambda number: 0.0)
            for x in (actions, masses_and_loads(self.mechanism))
        )
        if form != other:
            raise DesignError(UNLIKE)
        return np.array([*contacts, *list_numbers(actions)])

    def _possible(self, values: Floats) -> Floats | None:
        with suppress(SpherekitError):
            return self._read(values)
        return None

    def _differing(self, values: Floats) -> Floats:
        """Return the numbers that differ, where the others are those of the file."""
        numbers = self._read(values)
        if not np.all(np.abs(np.delete(numbers - self._stated, self.differing)) <= SAME):
            raise DesignError(UNLIKE)
        return numbers[self.differing]

    @cached_property
    def steady(self) -> list[Floats | None]:
        """The derivatives (k,) by each variable that are the same everywhere.

        So they are where they are at the designs that were tried; without any, of none.
        """
        made: list[Floats | None] = []
        for k, variable in enumerate(self.variables):
            if not self._whole and variable.path[0] not in ACTIONS:
                made.append(np.zeros(len(self.differing)))
                continue
            here, *others = self.tried_slopes(k)
            same = all(np.allclose(here, x, rtol=STEADY, atol=0.0) for x in others)
            made.append(here if others and same else None)
        return made

    def tried_slopes(self, k: int) -> list[Floats]:
        """Return the derivatives (k,) by a variable, here and at designs beside this."""
        designs = [self.values, *(design for design, _ in self._tried)]
        return [self._slope(design, k) for design in designs]

    def _slope(self, values: Floats, k: int) -> Floats:
        """Return the derivatives of the numbers by one of the values (variables,)."""

        def read(beside: Floats) -> Floats:
            # Of angles whole turns do not matter: wheels are put together by them.
            away = self._differing(beside) - begun
            of_angles = len(self.of_contacts)
            away[:of_angles] = wrap(away[:of_angles])
            return away

        slope = None
        with suppress(SpherekitError):
            begun = self._differing(values)
            slope = slope_by(read, values, k, PARTS * (abs(values[k]) or 1.0))
        return nans(len(self.differing)) if slope is None else slope
