"""An output at poses in one working mode, and configurations of poses in rows."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.model.mechanism import Mechanism
from spherekit.motion.assembly_modes import FLAT_DYAD
from spherekit.numeric.rows import ArrayRows
from spherekit.output.dyads import DyadArcs
from spherekit.output.measures import InputRates, reciprocal
from spherekit.sphere.rotation import Floats


class Rows(Protocol):
    """A mechanism at n poses of its output, in one working mode.

    Everything is NaN where it is not determined; what limits the reach is not.
    """

    def cosine(self, one: int, other: int) -> Floats:
        """Return the cosine (n,) of the angle between the axes of two pairs."""

    def angle(self, pair: int) -> Floats:
        """Return the variable (n,) of a pair in (-pi, pi] rad."""

    @property
    def inputs(self) -> Floats:
        """(n, inputs) rad in (-pi, pi]."""

    @property
    def type_1(self) -> Floats:
        """(n, inputs) measures of type I, see `Inverse`."""

    @property
    def type_1_square(self) -> Floats:
        """(n, inputs) its squares, continued smoothly where a leg does not reach.

        There they are negative.
        """

    @property
    def type_2(self) -> Floats:
        """(n,) measure of type II, see `Inverse`."""

    @property
    def rates(self) -> Floats:
        """(n, inputs, 3) rates of the inputs per unit angular velocity of the output.

        In axes of the link that the output is seen from; for a pointing output of the part
        at right angles to its direction.
        """


@final
@dataclass(frozen=True)
class Span:
    """Two pairs whose axes a leg joins, and between what angles (rad) it does.

    `folds` says that the leg's two links can lie over each other there.
    """

    one: int
    other: int
    cones: DyadArcs
    folds: bool


class Spanned(Protocol):
    """An output whose reach is limited by spans of legs."""

    mechanism: Mechanism
    wheels: frozenset[int]

    @property
    def spans(self) -> tuple[Span, ...]:
        """What limits the reach."""

    def name_of(self, pair: int) -> str:
        """Return the name of a pair."""


@final
@dataclass(frozen=True)
class InverseRows(ArrayRows):
    """k rows: the number of the pose, the label of the working mode, and what is there.

    Attributes
    ----------
    pose
        (k,) number of the pose, ascending.
    mode
        (k,) label of the working mode, ``~`` for each group without signs; empty for a
        pose without a configuration.
    inputs
        (k, inputs) rad in (-pi, pi].
    status
        (k,) values of `Status`: OK; OUT_OF_REACH, and then all but margin and limiting
        are NaN; AT_SINGULARITY where a measure is nearly 0 or has no value.
    margin, limiting
        (k,) rad left to the nearest limit, negative outside, and its number in `limits`;
        NaN and -1 where no limit says anything.
    type_1, type_2
        (k, inputs) and (k,), see `Inverse` and `spherekit.rates.transmission`.
    rates
        (k, inputs, 3), see `Rows`.
    values
        (k, pairs asked for) rad in (-pi, pi].
    limits
        Names of the limits.
    """

    pose: NDArray[np.intp]
    mode: NDArray[np.str_]
    inputs: Floats
    status: NDArray[np.int8]
    margin: Floats
    limiting: NDArray[np.intp]
    type_1: Floats
    type_2: Floats
    rates: Floats
    values: Floats
    limits: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.pose)

    @property
    def solved(self) -> NDArray[np.bool_]:
        """Which rows (k,) have a configuration."""
        return np.asarray(self.status != Status.OUT_OF_REACH)

    @staticmethod
    def judged(
        pose: NDArray[np.intp],
        mode: NDArray[np.str_],
        limit: tuple[Floats, NDArray[np.intp], tuple[str, ...]],
        *,
        inputs: Floats,
        type_1: Floats,
        type_2: Floats,
        rates: Floats,
        values: Floats,
    ) -> "InverseRows":
        """Return rows with their status, empty where a limit or the reach says no.

        `limit` are margins, numbers and names of the limits; poses need not ascend.
        """
        margin, limiting, names = limit
        out = margin < 0.0
        least = np.fmin(np.min(type_1, axis=1), type_2)
        regular = np.isfinite(inputs).all(axis=1) & (least > FLAT_DYAD)
        status = np.where(regular, Status.OK, Status.AT_SINGULARITY)
        status[out] = Status.OUT_OF_REACH
        gone = np.where(out, np.nan, 0.0)
        return InverseRows(
            pose,
            mode,
            inputs + gone[:, None],
            status.astype(np.int8),
            np.where(np.isfinite(margin), margin, np.nan),
            limiting,
            type_1 + gone[:, None],
            type_2 + gone,
            rates + gone[:, None, None],
            values + gone[:, None],
            names,
        )

    @classmethod
    def joined(cls, parts: "Sequence[InverseRows]") -> "InverseRows":
        """Return the rows of several modes, those of a pose together."""
        every = super().joined(parts)
        return every.rows(np.argsort(every.pose, kind="stable"))


def turns_of(rates: Floats, directions: Floats | None) -> Floats:
    """Return the output's angular velocity (k, 3, inputs) per unit rate of each input.

    From the rates (k, inputs, 3) of the inputs: with two inputs, at right angles to the
    directions (k, 3).
    """
    turns = InputRates.of_turns(np.swapaxes(rates, 1, 2), directions).rates
    return np.swapaxes(turns, 1, 2)


def sense_of(rates: Floats, directions: Floats | None) -> NDArray[np.int64]:
    """Return the sign (k,) of the determinant of rates (k, inputs, 3), 0 for none.

    It changes at singularities only: poses of one mode and one sign that hang together
    are an aspect. With two inputs the determinant is seen along the directions (k, 3).
    """
    _, volume = reciprocal(rates, directions)
    return np.asarray(np.sign(np.nan_to_num(volume)), dtype=np.int64)
