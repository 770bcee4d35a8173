"""Numbers of a kernel that are read from the file of each design, with its checks."""

import re
from collections.abc import Sequence
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.design.variables import ACTIONS, DesignVariable, designed, with_actions
from spherekit.engine.actions import Actions
from spherekit.engine.hinges import Hinged, hinged
from spherekit.errors import SpherekitError
from spherekit.files.document import Document
from spherekit.model.mechanism import Mechanism
from spherekit.planning.wheels import ONE_LINE
from spherekit.sphere.rotation import Floats

OK = "OK"
UNLIKE = "its loads or contacts have another form"
"""What sends a design to the analysis of the single one."""
TRIED = (0.0173, -0.0311)
"""Parts by which variables are changed to see which numbers follow them."""
EIGHTH = (4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0)
"""Weights of central differences of the eighth order, from the nearest on."""
ONE_SIDED = (
    8.0,
    -14.0,
    56.0 / 3.0,
    -35.0 / 2.0,
    56.0 / 5.0,
    -14.0 / 3.0,
    8.0 / 7.0,
    -0.125,
)
"""Weights of differences of the same order from the value on, where it is a limit."""
PARTS = (1e-2, 1e-4, 1e-6)
"""Their steps, as parts of a number: shorter ones where no design is that far."""
SAME = 1e-14
"""Numbers that differ by less are the same but for rounding."""
TURN = 2.0 * np.pi
_PLACE = re.compile(r"^[^\s:]+\.toml(?::\d+)?: ", re.MULTILINE)
"""A file's name, and perhaps a line, before what is wrong."""
STEADY = 1e-10
"""Derivatives that differ by less, relative, are the same."""


@final
class FileNumbers:
    """What the file of a design says of masses and loads, and of contacts of circles.

    `with_contacts` is the mechanism with links for its contacts, if it has some; `whole`
    says that masses follow sizes, so that the whole file is read. `nominal` are all numbers
    of the file as it is, those of contacts first (wheels may be `apart`, rad), and
    `differing` which of them follow the variables, as far as these could be `varied`.
    """

    def __init__(
        self,
        document: Document,
        mechanism: Mechanism,
        variables: Sequence[DesignVariable],
        inputs: Sequence[str],
        with_contacts: Hinged | None,
        whole: bool,
        apart: float = ONE_LINE,
    ) -> None:
        self.document, self.mechanism = document, mechanism
        self.variables = tuple(variables)
        self.inputs = tuple(inputs)
        self.apart = apart
        self.hinged = with_contacts
        self.whole = whole or with_contacts is not None
        self._form = Actions.of(mechanism).form
        contacts = with_contacts.numbers if with_contacts else []
        self._contacts = len(contacts)
        self.nominal = [*contacts, *Actions.of(mechanism).numbers]
        self.varied = False
        self.differing = self._differing()

    @property
    def of_contacts(self) -> list[int]:
        """Those of the contacts that differ."""
        return [k for k in self.differing if k < self._contacts]

    @property
    def of_actions(self) -> list[int]:
        """Those of the masses and loads that differ, as `Actions` counts them."""
        return [k - self._contacts for k in self.differing if k >= self._contacts]

    def _differing(self) -> tuple[int, ...]:
        values = np.array([variable.value for variable in self.variables])
        tried = [self._read(values * (1.0 + share) + share) for share in TRIED]
        self.varied = any(isinstance(numbers, list) for numbers in tried)
        if not self.varied:
            # Some vary by whole numbers, and some only with others.
            steps = np.concatenate([size * np.eye(len(values)) for size in (1.0, *TRIED)])
            tried = [self._read(values * (1.0 + step)) for step in steps]
            self.varied = any(isinstance(numbers, list) for numbers in tried)
            return tuple(range(len(self.nominal)))
        differing: set[int] = set()
        for numbers in tried:
            if isinstance(numbers, list):
                both = zip(numbers, self.nominal, strict=True)
                differing |= {k for k, (new, old) in enumerate(both) if new != old}
        return tuple(sorted(differing))

    def _read(self, values: Floats) -> list[float] | str:
        """Return all numbers of a design (variables,), or why there are none."""
        numbers, contacts = list(values), []
        try:
            if self.whole:
                made = designed(self.document, self.variables, numbers)
            else:
                made = with_actions(self.document, self.mechanism, self.variables, numbers)
            actions = Actions.of(made)
            if self.hinged is not None:
                with_contacts = hinged(made, self.inputs, self.apart)
                if with_contacts is None or with_contacts.form != self.hinged.form:
                    return UNLIKE
                contacts = with_contacts.numbers
        except SpherekitError as problem:
            return reason_of(problem)
        if actions.form != self._form:
            return UNLIKE
        return [*contacts, *actions.numbers]

    def at(self, values: Floats) -> tuple[Floats, NDArray[np.object_]]:
        """Return the numbers (k, n) that differ, and why designs (variables, n) are none.

        Of a design whose laws have another form, or other numbers than these, `UNLIKE`.
        """
        made = np.full((len(self.differing), values.shape[1]), np.nan)
        why = np.full(values.shape[1], OK, dtype=object)
        rest = np.setdiff1d(np.arange(len(self.nominal)), self.differing)
        same = np.array(self.nominal)[rest]
        for k, design in enumerate(values.T):
            numbers = self._read(design)
            if isinstance(numbers, str):
                why[k] = numbers
            elif not np.allclose(np.array(numbers)[rest], same, rtol=0.0, atol=SAME):
                why[k] = UNLIKE
            else:
                made[:, k] = np.array(numbers)[list(self.differing)]
        return made, why

    def slopes(self, values: Floats) -> Floats:
        """Return the derivatives (k, variables) of the numbers by values (variables,).

        Differences of the eighth order, which of polynomials are exact.
        """
        columns = [
            self._slope(values, k) if steady is None else steady
            for k, steady in enumerate(self._steady)
        ]
        return np.stack(columns, axis=1)

    @cached_property
    def _steady(self) -> list[Floats | None]:
        """The derivatives (k,) by each variable that are the same everywhere."""
        values = np.array([variable.value for variable in self.variables])
        senses = self._senses(values)
        made: list[Floats | None] = []
        for k in range(len(values)):
            tried = [
                self._slope(values * (1.0 + share) + share, k)
                for share in (0.0 * senses, *(abs(share) * senses for share in TRIED))
            ]
            same = all(
                np.allclose(tried[0], slope, rtol=STEADY, atol=0.0) for slope in tried
            )
            made.append(tried[0] if same else None)
        return made

    def _senses(self, values: Floats) -> Floats:
        """Return in which sense each of the values (variables,) may change on its own."""
        share = max(map(abs, TRIED))
        senses = np.ones(len(values))
        for k in range(len(values)):
            tried = values.copy()
            tried[k] += share * (values[k] + 1.0)
            if isinstance(self._read(tried), str):
                senses[k] = -1.0
        return senses

    def _slope(self, values: Floats, k: int) -> Floats:
        """Return the derivatives of the numbers by one of the values (variables,)."""
        if not self.whole and self.variables[k].path[0] not in ACTIONS:
            return np.zeros(len(self.differing))
        near = np.arange(1.0, len(EIGHTH) + 1.0)
        central = np.concatenate([near, -near])
        both = np.concatenate([EIGHTH, np.negative(EIGHTH)])
        onward = np.arange(len(ONE_SIDED) + 1.0)
        ahead = np.array([-np.sum(ONE_SIDED), *ONE_SIDED])
        for part in PARTS:
            step = part * (abs(values[k]) or 1.0)
            for places, weights in ((central, both), (onward, ahead), (-onward, -ahead)):
                beside = np.repeat(values[:, None], len(places), axis=1)
                beside[k] += step * places
                if isinstance(self._read(beside[:, -1]), str):
                    continue
                numbers, reasons = self.at(beside)
                if np.all(reasons == OK):
                    # Of angles whole turns do not matter: wheels are put together by them.
                    away = numbers - numbers[:, :1]
                    turns = np.round(away / TURN)
                    turns[len(self.of_contacts) :] = 0.0
                    return np.asarray((away - TURN * turns) @ weights / step)
        return np.full(len(self.differing), np.nan)


def reason_of(problem: SpherekitError) -> str:
    """Return what is wrong with a design in one line, without the file's name."""
    return " ".join(_PLACE.sub("", str(problem)).split())
