"""A study: a mechanism, samples of its inputs or a simulation, and the analyses to run."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from spherekit.argument_validation import check_fields, checked_class
from spherekit.arrays import Floats
from spherekit.conventions import DEFAULT_SAMPLES
from spherekit.errors import AnalysisError, ModelError, SpherekitError
from spherekit.files.time_law import Law, split_at_plus, store_finite_numbers
from spherekit.mechanism.joint import Numbers
from spherekit.mechanism.mechanism import Mechanism
from spherekit.quantity import (
    ANGLE,
    ANGULAR_SPEED,
    AngleUnit,
    Dimension,
    QuantityError,
    read_quantity,
)
from spherekit.wording import counted

Crossings = Literal["end", "pass"]
"""Whether a motion ends or continues at a configuration where curves of configurations
cross."""

START_SYNTAX = (
    "Write q and dq with a comma in between, such as q=20deg,dq=1rad/s. Join the values of "
    "several inputs by +, such as q=20deg+35deg,dq=1rad/s+0rad/s. A number without a unit "
    "is in the unit of the mechanism file"
)

DEFAULT_TOLERANCE = 1e-9
"""Default error of each step of a simulation, for pair variables (rad)."""

Locate = Callable[[tuple[str | int, ...], str], SpherekitError]
"""Returns the error to raise about a key, from its path and the message."""


@checked_class(ModelError, "each")
@dataclass(frozen=True)
class Start:
    """The state of the inputs at the start of a simulation.

    Attributes
    ----------
    q
        Variable (rad) of the input; for several inputs a number for each input, in their
        order.
    dq
        Rate (rad/s) of the input, or of each input. The number 0 applies to all inputs.
    """

    q: float | Numbers
    dq: float | Numbers = 0.0

    argument_hint: ClassVar[str] = (
        "A start is the variable q (rad) and the rate dq (rad/s) of the input at t = 0; "
        'write spherekit.Start(q=0.3, dq=0.0) or {"q": 0.3, "dq": 0.0}'
    )
    """What to write, for messages about an argument that is no start."""

    def __post_init__(self) -> None:
        """Raise an error if a number is not finite, and convert lists to tuples.

        Tuples make starts with the same numbers equal.
        """
        store_finite_numbers(self)

    @staticmethod
    def of(given: "StartGiven", angle_unit: AngleUnit = "rad") -> "Start":
        """Return the start of a simulation from a text or a mapping.

        Parameters
        ----------
        given
            The variables q (rad) and rates dq (rad/s) of the inputs (driven pairs), as
            ``"q=0.4,dq=1.2"`` or ``{"q": 0.4, "dq": 1.2}``. For several inputs it is
            ``"q=0.4+0.2,dq=1+0"``, or a mapping with sequences of numbers. Without dq the
            mechanism is at rest. A `Start` is returned unchanged. A number in a text may
            have a unit, as in ``"q=20deg,dq=1rad/s"``.
        angle_unit
            Unit of numbers without a unit, ``"rad"`` or ``"deg"``.

        Raises
        ------
        ModelError
            If a key is unknown, a value is not a number, or q is missing.
        """
        if isinstance(given, Start):
            return given
        if isinstance(given, str):
            # "q=0.4,dq=1.2" becomes the mapping {"q": "0.4", "dq": "1.2"}.
            parts = [part.partition("=") for part in given.split(",")]
            given = {key.strip(): text for key, _, text in parts}
            if len(given) < len(parts):
                raise ModelError(f"start: a key is given twice. {START_SYNTAX}")
        state: dict[str, float | Numbers] = {}
        for key, value in given.items():
            if key not in ("q", "dq"):
                raise ModelError(
                    f'start: the key "{key}" is neither q nor dq. {START_SYNTAX}'
                )
            dimension = ANGLE if key == "q" else ANGULAR_SPEED
            try:
                state[key] = _read_numbers(value, dimension, angle_unit)
            except QuantityError as problem:
                raise ModelError(f"start: {key}: {problem}. {START_SYNTAX}") from None
            except (TypeError, ValueError):
                raise ModelError(
                    f'start: {key}: found "{value}", expected a number, or one number for '
                    f"each input. {START_SYNTAX}"
                ) from None
        if "q" not in state:
            raise ModelError(f"start: q is missing. {START_SYNTAX}")
        return Start(**state)

    def each(self, inputs: Sequence[str]) -> tuple[Floats, Floats]:
        """Return the variables and the rates of all inputs at the start of a simulation.

        The attributes `q` and `dq` may be single numbers. The results are arrays with one
        number for each input, in the order of `inputs`.

        Parameters
        ----------
        inputs
            The names of the i driven pairs.

        Returns
        -------
        q
            (i,) variables, rad.
        dq
            (i,) rates, rad/s.

        Raises
        ------
        ModelError
            If `q` or `dq` does not have one number for each input. The default rate 0
            applies to any number of inputs.
        """
        # `q` and `dq` are a single number or a tuple. The default rate, the single number 0
        # (at rest), fits any number of inputs.
        is_default_rate = self.dq == 0.0
        rates = np.zeros(len(inputs)) if is_default_rate else self.dq
        state = []
        for key, values in (("q", self.q), ("dq", rates)):
            # A single number becomes an array (1,).
            numbers = np.array(values, float, ndmin=1)
            if len(numbers) != len(inputs):
                raise ModelError(
                    f"start: {key} has {counted(len(numbers), 'number')}, but the "
                    f"mechanism has {counted(len(inputs), 'input')} ({', '.join(inputs)}); "
                    "give one number for each input"
                )
            state.append(numbers)
        return state[0], state[1]


def read_start(
    given: "StartGiven", mechanism: Mechanism, angle_unit: AngleUnit = "rad"
) -> Start:
    """Return the start of a simulation of a mechanism.

    Parameters
    ----------
    given
        The start itself, or a text or a mapping that states it (see `Start.of`).
    mechanism
        The mechanism. Numbers without a unit in a text are in the unit of its file, as on
        the command line.
    angle_unit
        Unit of the numbers of a mapping. The numbers of a `Start` are in rad.

    Raises
    ------
    ModelError
        As `Start.of`.
    """
    is_text = isinstance(given, str)
    return Start.of(given, mechanism.angle_unit if is_text else angle_unit)


StartGiven = Start | str | Mapping[str, Any]
"""A start, or a text or mapping that `Start.of` reads."""


def _read_numbers(
    value: Any, dimension: Dimension, angle_unit: AngleUnit
) -> float | Numbers:
    """Return one number, or several from a sequence or a text such as ``0.4+0.2``.

    The sign + in a text separates numbers, for example those of two inputs.

    Parameters
    ----------
    value
        The number, sequence or text.
    dimension
        The kind of the quantity: an angle or an angular speed.
    angle_unit
        Unit of numbers without a unit.

    Returns
    -------
    The numbers in rad or rad/s.
    """

    def read_number(number: Any) -> float:
        """Return one number in rad or rad/s, from a number or a text."""
        # An angle of very many turns is refused as a mistake of the user if it is a text.
        # As a number it is accepted.
        is_text = isinstance(number, str)
        source = number if is_text else float(number)
        return read_quantity(source, dimension, angle_unit, is_limited=is_text)

    if isinstance(value, str):
        parts = split_at_plus(value)
        return tuple(map(read_number, parts)) if len(parts) > 1 else read_number(parts[0])
    return tuple(map(read_number, value)) if np.ndim(value) else read_number(value)


@dataclass(frozen=True)
class Study:
    """A mechanism, the samples of its inputs or its simulation, and the analyses to run.

    Raises `AnalysisError` if a value does not have the type of its field.

    Attributes
    ----------
    name
        Name of the study.
    mechanism
        A mechanism with one degree of freedom for each of its inputs.
    samples
        Number of samples on the straight path through the ranges of the inputs. A sequence
        of numbers, one for each input, states a grid.
    grid
        Whether all combinations of the inputs are sampled, `samples` values of each.
    path
        (n, inputs) rad, the inputs at every sample. It replaces the ranges of the inputs.
    assembly_mode
        Number or name of the only assembly mode to compute. By default all are computed.
    search
        Whether all assembly modes are searched for. Otherwise only the mode of the
        reference pose is computed, if the file states one.
    analyses
        Parameters of each analysis by its name, as in a file.
    laws
        Time law of each driven pair.
    duration
        Time (s) from t = 0 over which the samples are spaced, both ends included. Without
        laws and start, the only input turns at 1 rad/s.
    start
        State of the inputs at t = 0, also as a text or mapping that `Start.of` reads. A
        number in a text without a unit is in the unit of the mechanism's file. The motion
        over `duration` then follows from the loads.
    torque
        Driving torque (N m), a number or an expression, in a simulation. For several inputs
        it is a mapping by the name of the input.
    tolerance
        Error (rad) of each step of a simulation.
    crossings
        What happens where curves of configurations cross. With "end", assembly modes keep
        the signs of their dyads, and a simulation ends there. A dyad is two links with
        three R pairs, and its sign is one of two ways to assemble it. With "pass", modes
        and simulations follow the smooth curves.
    verify
        Number of rows that are computed once more in 50 digits.
    degrees
        Whether tables have angles in degrees.
    folder, recording
        Folder and recording that a study file names, relative to the working folder. The
        command `spherekit run` writes to them. The function `spherekit.run` does not: it
        writes only to the folder and the recorder that it gets as arguments.
    locate
        Function that makes an error from a key of the study file (a tuple of its parts) and
        a message. The error names the file and the line of the key. None without a file.
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
        """Check all fields, and convert some to the types with which the study is run.

        A start that is a text or a mapping becomes a `Start`. NumPy arrays and numbers in
        `samples` become tuples and numbers of Python. The path becomes a NumPy array.

        Raises
        ------
        AnalysisError
            If a value is wrong.
        """
        # A number in a start can be in the unit of the mechanism's file. So the start is
        # only read if there is a mechanism. `check_fields` refuses a mechanism of another
        # type.
        has_mechanism = isinstance(self.mechanism, Mechanism)
        if has_mechanism and isinstance(self.start, str | Mapping):
            object.__setattr__(self, "start", read_start(self.start, self.mechanism))
        check_fields(self, AnalysisError, self.name)
        if self.verify is not None and self.verify < 1:
            raise AnalysisError(
                f"{self.name}: verify must be at least 1, not {self.verify}"
            )
        # Arrays and numbers of NumPy become tuples and numbers of Python.
        samples = np.asarray(self.samples).tolist()
        if isinstance(samples, list):
            samples = tuple(samples)
        object.__setattr__(self, "samples", samples)
        if self.path is not None:
            object.__setattr__(self, "path", np.array(self.path, dtype=np.float64))

    def __eq__(self, other: object) -> bool:
        """Return whether another study has the same values, from whatever file."""
        return isinstance(other, Study) and all(
            np.array_equal(getattr(self, item.name), getattr(other, item.name))
            for item in fields(self)
            if item.compare
        )

    @property
    def driving_torque(self) -> str | Mapping[str, str] | None:
        """The driving torque as an expression, or one for each input by name, or None."""
        if isinstance(self.torque, Mapping):
            return {pair: _expression(torque) for pair, torque in self.torque.items()}
        return None if self.torque is None else _expression(self.torque)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of samples along the path, or along each input of a grid."""
        if self.path is not None:
            return (len(self.path),)
        if not isinstance(self.samples, int):
            return tuple(self.samples)
        return (self.samples,) * (len(self.mechanism.inputs) if self.grid else 1)

    @property
    def count(self) -> int:
        """Number of all samples."""
        return math.prod(self.shape)

    def fault(self, path: tuple[str | int, ...], message: str) -> SpherekitError:
        """Return the error to raise about a key, with file and line if there is a file."""
        if self.locate is not None:
            return self.locate(path, message)
        return AnalysisError(f"{self.name}: {'.'.join(map(str, path))}: {message}")


def _expression(torque: str | float) -> str:
    """Return a torque as an expression; a number becomes a constant."""
    return torque if isinstance(torque, str) else repr(float(torque))
