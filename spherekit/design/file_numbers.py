"""Numbers of a kernel that are read from the file of each design, with its checks."""

import re
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import TURN
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
PARTS = np.array([1e-2, 1e-4, 1e-6])
"""Their steps, as parts of a number: shorter ones where no design is that far."""
SAME = 1e-14
"""Numbers that differ by less are the same but for rounding."""
STEADY = 1e-10
"""Derivatives that differ by less, relative, are the same."""
_PLACE = re.compile(r"^[^\s:]+\.toml(?::\d+)?: ", re.MULTILINE)
"""A file's name, and perhaps a line, before what is wrong."""


@final
class FileNumbers:
    """What the file of a design says of masses and loads, and of contacts of circles.

    `contacts` is the mechanism with links for its contacts, if it has some; `whole` says
    that masses follow sizes, so that the whole file is read. `nominal` are all numbers of
    the file as it is, those of contacts first (wheels may be `apart`, rad), and `differing`
    which of them follow the variables, as far as these could be `varied`.
    """

    def __init__(
        self,
        document: Document,
        mechanism: Mechanism,
        variables: Sequence[DesignVariable],
        inputs: Sequence[str],
        contacts: Hinged | None,
        whole: bool,
        apart: float = ONE_LINE,
    ) -> None:
        self.document, self.mechanism = document, mechanism
        self.variables, self.inputs = tuple(variables), tuple(inputs)
        self.values = np.array([variable.value for variable in variables])
        self.apart, self.contacts = apart, contacts
        self.whole = whole or contacts is not None
        actions = Actions.of(mechanism)
        self._form = actions.form
        of_contacts = contacts.numbers if contacts else []
        self._first = len(of_contacts)
        self.nominal = np.array([*of_contacts, *actions.numbers])
        steps = np.concatenate([size * np.eye(len(self.values)) for size in (1.0, *TRIED)])
        tried = [self._read(self.values * (1.0 + share) + share) for share in TRIED]
        there = [numbers for numbers in tried if not isinstance(numbers, str)]
        every = not there
        if every:  # some vary by whole numbers, and some only with others
            tried = [self._read(self.values * (1.0 + step)) for step in steps]
        self.varied = any(not isinstance(numbers, str) for numbers in tried)
        differ = np.any([numbers != self.nominal for numbers in there], axis=0) | every
        self.differing = np.flatnonzero(np.broadcast_to(differ, self.nominal.shape))

    @property
    def of_contacts(self) -> list[int]:
        """Those of the contacts that differ."""
        return [int(k) for k in self.differing if k < self._first]

    @property
    def of_actions(self) -> list[int]:
        """Those of the masses and loads that differ, as `Actions` counts them."""
        return [int(k) - self._first for k in self.differing if k >= self._first]

    def _read(self, values: Floats) -> Floats | str:
        """Return all numbers of a design (variables,), or why there are none."""
        numbers, contacts = list(values), []
        try:
            if self.whole:
                made = designed(self.document, self.variables, numbers)
            else:
                made = with_actions(self.document, self.mechanism, self.variables, numbers)
            actions = Actions.of(made)
            if self.contacts is not None:
                with_contacts = hinged(made, self.inputs, self.apart)
                if with_contacts is None or with_contacts.form != self.contacts.form:
                    return UNLIKE
                contacts = with_contacts.numbers
        except SpherekitError as problem:
            return reason_of(problem)
        if actions.form != self._form:
            return UNLIKE
        return np.array([*contacts, *actions.numbers])

    def _differing(self, values: Floats) -> Floats | str:
        """Return the numbers that differ, where the others are those of the file."""
        numbers = self._read(values)
        if isinstance(numbers, str):
            return numbers
        rest = np.delete(numbers - self.nominal, self.differing)
        return numbers[self.differing] if np.all(np.abs(rest) <= SAME) else UNLIKE

    def at(self, values: Floats) -> tuple[Floats, NDArray[np.object_]]:
        """Return the numbers (k, n) that differ, and why designs (variables, n) are none.

        Of a design whose laws have another form, or other numbers than these, `UNLIKE`.
        """
        made = np.full((len(self.differing), values.shape[1]), np.nan)
        why = np.full(values.shape[1], OK, dtype=object)
        for k, design in enumerate(values.T):
            numbers = self._differing(design)
            if isinstance(numbers, str):
                why[k] = numbers
            else:
                made[:, k] = numbers
        return made, why

    def slopes(self, values: Floats) -> Floats:
        """Return the derivatives (k, variables) of the numbers by values (variables,)."""
        columns = [
            self._slope(values, k) if steady is None else steady
            for k, steady in enumerate(self.steady)
        ]
        return np.stack(columns, axis=1)

    @cached_property
    def steady(self) -> list[Floats | None]:
        """The derivatives (k,) by each variable that are the same everywhere."""
        senses = np.ones(len(self.values))
        share = max(map(abs, TRIED))
        for k, unit in enumerate(np.eye(len(senses))):
            if isinstance(
                self._read(self.values + share * unit * (self.values + 1.0)), str
            ):
                senses[k] = -1.0
        shares = [0.0 * senses, *(abs(share) * senses for share in TRIED)]
        made: list[Floats | None] = []
        for k in range(len(senses)):
            tried = [self._slope(self.values * (1.0 + x) + x, k) for x in shares]
            same = all(np.allclose(tried[0], x, rtol=STEADY, atol=0.0) for x in tried)
            made.append(tried[0] if same else None)
        return made

    def _slope(self, values: Floats, k: int) -> Floats:
        """Return the derivatives of the numbers by one of the values (variables,)."""
        nothing = np.zeros(len(self.differing))
        if not self.whole and self.variables[k].path[0] not in ACTIONS:
            return nothing
        begun = self._differing(values)
        if isinstance(begun, str):
            return np.full(len(nothing), np.nan)

        def read(beside: Floats) -> Floats | None:
            numbers = self._differing(beside)
            if isinstance(numbers, str):
                return None
            # Of angles whole turns do not matter: wheels are put together by them.
            away, of_angles = numbers - begun, len(self.of_contacts)
            away[:of_angles] -= TURN * np.round(away[:of_angles] / TURN)
            return np.asarray(away)

        slope = slope_by(read, values, k, PARTS * (abs(values[k]) or 1.0))
        return np.full(len(nothing), np.nan) if slope is None else slope


def slope_by(
    read: Callable[[Floats], Floats | None], values: Floats, k: int, steps: Floats
) -> Floats | None:
    """Return the derivatives (n,) of numbers by one of the values (variables,).

    By differences of the eighth order, exact for polynomials, with the first of the steps,
    central or to one side, at which `read` gives numbers at all places; None without.
    """
    near, onward = np.arange(1.0, len(EIGHTH) + 1.0), np.arange(1.0, len(ONE_SIDED) + 1.0)
    both = np.concatenate([EIGHTH, np.negative(EIGHTH)])
    central = np.concatenate([near, -near])
    ahead, weights = np.append(0.0, onward), np.array([-np.sum(ONE_SIDED), *ONE_SIDED])
    stencils = (central, both), (ahead, weights), (-ahead, -weights)
    for step in steps:
        for places, weighing in stencils:
            total: Floats | None = np.zeros(())
            for place, weight in zip(places[::-1], weighing[::-1], strict=True):
                beside = values.copy()
                beside[k] += step * place
                numbers = read(beside)
                if numbers is None:
                    total = None
                    break
                total = total + weight * numbers
            if total is not None:
                return np.asarray(total / step)
    return None


def reason_of(problem: SpherekitError) -> str:
    """Return what is wrong with a design in one line, without the file's name."""
    return " ".join(_PLACE.sub("", str(problem)).split())
