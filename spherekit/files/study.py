"""What a run goes through: a mechanism, the samples of its inputs, and what drives them."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal

import numpy as np

from spherekit.argument_validation import check_fields, checked_class
from spherekit.arrays import Floats
from spherekit.conventions import DEFAULT_SAMPLES
from spherekit.errors import AnalysisError, ModelError, SpherekitError
from spherekit.files.time_law import Law, _need_finite_fields, _numbers
from spherekit.mechanism.joint import Numbers
from spherekit.mechanism.mechanism import Mechanism
from spherekit.wording import counted

Crossings = Literal["end", "pass"]
"""What a simulation does where sets of configurations cross."""


@checked_class(ModelError, "each")
@dataclass(frozen=True)
class Start:
    """The input's variable (rad) and rate (rad/s) when a simulation starts, at t = 0.

    Of several inputs one number for each, in their order; a rate of 0 is that of all.
    """

    q: float | Numbers
    dq: float | Numbers = 0.0

    def __post_init__(self) -> None:
        _need_finite_fields(self)

    @staticmethod
    def of(given: "StartGiven") -> "Start":
        """Return the start that the command's text or a mapping gives.

        ``"q=0.4,dq=1.2"`` and ``{"q": 0.4, "dq": 1.2}``, of several inputs
        ``"q=0.4+0.2,dq=1+0"`` and sequences of numbers, in rad and rad/s; without dq at
        rest.

        Raises
        ------
        ModelError
            For other keys, for what does not read as numbers, and without q.
        """
        if isinstance(given, Start):
            return given
        if isinstance(given, str):
            parts = (part.partition("=") for part in given.split(","))
            given = {key.strip(): text for key, _, text in parts}
        read = {}
        for key, state in given.items():
            if key not in ("q", "dq"):
                raise ModelError(f'start: "{key}" is neither q nor dq; {START_SHOWN}')
            try:
                read[key] = _numbers(state)
            except (TypeError, ValueError):
                raise ModelError(
                    f'start: {key}: "{state}" does not read as a number, or as one for '
                    f"each input; {START_SHOWN}"
                ) from None
        if "q" not in read:
            raise ModelError(f"start: q is missing; {START_SHOWN}")
        return Start(**read)

    def each(self, inputs: Sequence[str]) -> tuple[Floats, Floats]:
        """Return variable and rate (inputs,) of each input, by their names.

        Raises
        ------
        ModelError
            If there is not one number for each.
        """
        state = []
        rates = np.zeros(len(inputs)) if self.dq == 0.0 else self.dq
        for key, given in (("q", self.q), ("dq", rates)):
            numbers = np.array(given, float, ndmin=1)
            if len(numbers) != len(inputs):
                raise ModelError(
                    f"start: {key} has {counted(len(numbers), 'number')}, needs "
                    f"{len(inputs)}, one for each input ({', '.join(inputs)})"
                )
            state.append(numbers)
        return state[0], state[1]


StartGiven = Start | str | Mapping[str, Any]
"""A start, or what `Start.of` reads."""

START_SHOWN = "give q=Q,dq=W in rad and rad/s, of several inputs q=Q+Q,dq=W+W"


DEFAULT_TOLERANCE = 1e-9
"""Error tolerated in each step of a simulation, for pair variables (rad)."""

Locate = Callable[[tuple[str | int, ...], str], SpherekitError]
"""Makes the error to raise about a key, given by its path, with file and line."""


@dataclass(frozen=True)
class Study:
    """A mechanism with the inputs it is driven at, and what is to be run on it.

    Raises `AnalysisError` where a value is not of the type that its field has.

    Attributes
    ----------
    name, mechanism
        What it is called, and a mechanism with a freedom for each of its inputs.
    samples
        Samples on the straight path through the ranges of the inputs or, with a number for
        each input, of a grid.
    grid
        Whether all combinations of the inputs are sampled, so many of each.
    path
        (n, inputs) rad, the inputs at every sample, in place of their ranges.
    assembly_mode
        Number of the only assembly mode that is wanted, or its name; all by default.
    search
        Whether assembly modes are looked for beside that of a given reference pose.
    analyses
        Names of analyses with their parameters, as they stand in a file.
    laws, duration
        Time law of each driven pair, and the time (s) from t = 0 that the samples divide,
        both ends included. With a duration alone the only input turns at 1 rad/s.
    start, torque, tolerance
        State of the inputs at t = 0, also as what `Start.of` reads, ``"q=0.4,dq=1.2"`` or
        ``{"q": 0.4, "dq": 1.2}`` in rad and rad/s: the motion over `duration` then
        follows from the loads and the `torque` (N m, a number or an expression) at the
        input, or that of each of several inputs that has one, by its name; each step
        within the tolerance (rad), from the `assembly_mode` (default 0) of all there are.
    crossings
        What happens where curves of configurations cross: modes keep the signs of their
        dyads and a simulation ends there ("end"), or both follow the smooth curves
        ("pass").
    verify
        How many rows are computed once more in 50 digits.
    degrees
        Whether files have angles in degrees.
    folder, recording
        Where a file wants its results, relative to the working folder; the command writes
        there, `spherekit.run` only where it is told to.
    locate
        Gives errors about a key the file and line that say it.
    """

    name: str
    mechanism: Mechanism
    samples: int | Sequence[int] = DEFAULT_SAMPLES
    grid: bool = False
    path: Floats | None = None
    assembly_mode: int | str | None = None
    search: bool = True
    analyses: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    laws: Mapping[str, Law] = field(default_factory=dict)
    duration: float | None = None
    start: Start | None = None
    torque: str | float | Mapping[str, str | float] | None = None
    tolerance: float = DEFAULT_TOLERANCE
    crossings: Crossings = "end"
    verify: int | None = None
    degrees: bool = False
    folder: Path | None = None
    recording: Path | None = None
    locate: Locate | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        if isinstance(self.start, str | Mapping):
            object.__setattr__(self, "start", Start.of(self.start))
        check_fields(self, AnalysisError, self.name)
        if self.verify is not None and self.verify < 1:
            raise AnalysisError(
                f"{self.name}: verify must be at least 1, not {self.verify}"
            )
        if self.path is not None:
            object.__setattr__(self, "path", np.array(self.path, dtype=np.float64))

    def __eq__(self, other: object) -> bool:
        """Return whether another study says the same, whatever file it is from."""
        return isinstance(other, Study) and all(
            np.array_equal(getattr(self, item.name), getattr(other, item.name))
            for item in fields(self)
            if item.compare
        )

    @property
    def driving_torque(self) -> str | Mapping[str, str] | None:
        """The torque at the input, or at each of several, as an expression, if any."""
        if isinstance(self.torque, Mapping):
            return {pair: _as_text(torque) for pair, torque in self.torque.items()}
        return None if self.torque is None else _as_text(self.torque)

    @property
    def shape(self) -> tuple[int, ...]:
        """How many samples are asked for along a path, or along each input of a grid."""
        if self.path is not None:
            return (len(self.path),)
        if not isinstance(self.samples, int):
            return tuple(self.samples)
        return (self.samples,) * (len(self.mechanism.inputs) if self.grid else 1)

    @property
    def count(self) -> int:
        """How many samples are asked for in all."""
        return math.prod(self.shape)

    def fault(self, path: tuple[str | int, ...], message: str) -> SpherekitError:
        """Return the error to raise about a key, with file and line if it has one."""
        if self.locate is not None:
            return self.locate(path, message)
        return AnalysisError(f"{self.name}: {'.'.join(map(str, path))}: {message}")


def _as_text(torque: str | float) -> str:
    return torque if isinstance(torque, str) else repr(float(torque))
