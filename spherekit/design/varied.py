"""A mechanism of which numbers of its file vary: one set of terms for all designs."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.design.file_numbers import OK, FileNumbers
from spherekit.design.profile_numbers import ProfileNumbers, has_other_profiles
from spherekit.design.variables import ACTIONS, DesignVariable, designed_pairs
from spherekit.engine.hinges import Hinged
from spherekit.engine.row_quantities import (
    DesignTerms,
)
from spherekit.errors import SpherekitError
from spherekit.files.document import Document
from spherekit.model.mechanism import Mechanism
from spherekit.planning.wheels import ONE_LINE
from spherekit.sphere.rotation import Floats

DEG = np.pi / 180.0


@final
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

    def by_values(self, gradients: Floats, places: Floats) -> Floats:
        """Return derivatives (variables, c, n) from those by what kernels have.

        (k and 8 profiles, c, n), at closed configurations `places` (n, w).
        """
        count = len(self.sizes)
        made = np.zeros((len(self.values), *gradients.shape[1:]))
        for variable, slopes in enumerate(self.slopes.T):
            some = np.flatnonzero(slopes)  # others may have no derivative
            made[variable] = np.tensordot(slopes[some], gradients[:count][some], 1)
        if self.profiles is not None:
            slopes = self.profiles.slopes(places)
            made += np.einsum("kpn,pcn->kcn", slopes, gradients[count:])
        return made


@final
class VariedMechanism:
    """The designs of a mechanism, by numbers of its file.

    Kernels have the sizes of R pairs that vary, or with `contacts` of circles as links the
    angles of these; then the numbers of masses and loads that follow the variables, which
    with contacts, or where masses `follow` sizes, are read from the whole file of a design.
    Profiles that are no circles are handed in. Wheels may be `apart` (rad).
    """

    def __init__(
        self,
        document: Document,
        mechanism: Mechanism,
        variables: Sequence[DesignVariable],
        inputs: Sequence[str],
        contacts: Hinged | None = None,
        follow: bool = False,
        apart: float = ONE_LINE,
    ) -> None:
        self.document, self.mechanism, self.contacts = document, mechanism, contacts
        self.variables, self.inputs = tuple(variables), tuple(inputs)
        self.values = np.array([variable.value for variable in variables])
        unit = DEG if document.data["angle_unit"] == "deg" else 1.0
        self.scale = np.array([unit if v.is_angle else 1.0 for v in variables])
        self.sized: list[int] = []
        if contacts is None:
            self.sized = [k for k, v in enumerate(variables) if v.slot is not None]
        self.numbers: FileNumbers | None = None
        if contacts or follow or any(v.path[0] in ACTIONS for v in variables):
            self.numbers = FileNumbers(
                document, mechanism, variables, inputs, contacts, follow, apart
            )

    @cached_property
    def is_profiled(self) -> bool:
        """Whether profiles are no circles, and what they are is handed in."""
        return has_other_profiles(self.mechanism)

    def terms(self, closed_form: bool | None = None) -> DesignTerms:
        """Return what kernels of all designs are written in."""
        contacts, numbers = self.contacts, self.numbers
        acting = numbers.of_actions if numbers else ()
        if contacts is not None and numbers is not None:
            names = {k: f"turned_{k}" for k in numbers.of_contacts}
            return DesignTerms.of(
                contacts.mechanism,
                self.inputs,
                tuple(names.values()),
                lambda terms: contacts.pairs({k: terms[n] for k, n in names.items()}),
                closed_form,
                acting,
            )
        chosen, handed_in = [self.variables[k] for k in self.sized], self.is_profiled
        return DesignTerms.of(
            self.mechanism,
            self.inputs,
            [variable.name for variable in chosen],
            lambda terms: designed_pairs(self.mechanism, chosen, terms, handed_in),
            False if handed_in else closed_form,
            acting,
        )

    @cached_property
    def nominal(self) -> Floats:
        """What kernels have as sizes (k,) in the file."""
        sizes: Floats = (self.scale * self.values)[self.sized]
        if self.numbers is None:
            return sizes
        return np.concatenate([sizes, self.numbers.nominal[self.numbers.differing]])

    def sizes(self, values: Floats) -> tuple[Floats, NDArray[np.object_]]:
        """Return what kernels have (k, n) of designs (variables, n) in the file's units.

        In rad and SI; and why designs (n,) are none, `OK` where they are.
        """
        sizes = (values * self.scale[:, None])[self.sized]
        if self.numbers is None:
            return sizes, np.full(values.shape[1], OK, dtype=object)
        numbers, why = self.numbers.at(values)
        return np.concatenate([sizes, numbers]), why

    def design_at(self, values: Floats, made: Mechanism | None = None) -> DesignAt | None:
        """Return what kernels have of a design (variables,), None if there is none.

        `made` is the mechanism, if that is known.
        """
        sizes, why = self.sizes(values[:, None])
        slopes, profiles = np.diag(self.scale)[self.sized], None
        if why[0] != OK:
            return None
        if self.numbers is not None:
            slopes = np.vstack([slopes, self.numbers.slopes(values)])
        if self.is_profiled:
            try:
                profiles = ProfileNumbers(self.document, self.variables, values, made)
            except SpherekitError:
                return None
        return DesignAt(values, sizes[:, 0], slopes, profiles)
