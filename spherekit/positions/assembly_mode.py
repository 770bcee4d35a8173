"""One assembly mode of a mechanism: how each of its groups is put together."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, Integers, SmallIntegers
from spherekit.positions.mode_predictor import ModeCurve, ModeOverGrid
from spherekit.status import Status


class AssemblyMode(NamedTuple):
    """One assembly mode over the ranges of the inputs.

    An assembly mode is one of the ways in which the links of a mechanism can be put
    together at given inputs. The links are placed group by group. A dyad (a group of two
    links) has a closed form with two solutions, and its sign selects one of them. A larger
    group has no closed form. Its mode is known by verified configurations, from which
    Newton's method starts.

    Attributes
    ----------
    number
        Number of the mode, from 0.
    signs
        For each group +1 or -1 if it is a dyad, else 0. A train of wheels, whose angles
        follow from the inputs by gear ratios, has one mode only and the sign 0.
    guide
        Verified configurations over the inputs: a curve for one input, the samples of a
        grid for several. None if all groups are dyads or trains of wheels and the mode has
        a configuration.
    group_signs
        For each group the sign of the determinant of its velocity equations, which is
        constant in a mode. Empty if all groups are dyads or trains of wheels, or if the
        mode has no configuration.
    name
        The name that the file gives to the mode, empty if it gives none.
    pieces
        The configurations of a mode form a curve over the input. Where the curves of two
        modes cross, this mode may follow the smooth curve, and its signs change there. The
        mode is then composed of pieces. Each piece is the input (rad) at which it begins
        (-inf for the first one), and the mode with constant signs from there on. Empty if
        the signs do not change.
    """

    number: int
    signs: tuple[int, ...]
    guide: ModeCurve | ModeOverGrid | None = None
    group_signs: tuple[float, ...] = ()
    name: str = ""
    pieces: tuple[tuple[float, "AssemblyMode"], ...] = ()

    def pieces_at(self, q: Floats) -> Indices:
        """Return the position in `pieces` (n,) for values q (n,) rad of the only input."""
        starts = np.array([start for start, _ in self.pieces[1:]])
        return np.searchsorted(starts, q, side="right")

    def signs_along(self, q: Floats) -> Integers:
        """Return the signs (groups, n) of the mode at inputs q (inputs, n) rad."""
        if not self.pieces:
            return np.repeat(np.array(self.signs, dtype=int)[:, None], q.shape[1], axis=1)
        signs_of_pieces = np.array([mode.signs for _, mode in self.pieces])
        return signs_of_pieces[self.pieces_at(q[0])].T

    @property
    def title(self) -> str:
        """The name of the mode in the file, or the signs of its groups without a name."""
        return self.name or self.label

    @property
    def signs_and_name(self) -> str:
        """The signs of the mode, followed by its name in the file if it has one."""
        return ", ".join(filter(None, (self.label, self.name)))

    @property
    def label(self) -> str:
        """The signs of the groups as text, such as ``+-``, to name the mode in reports.

        A mechanism without groups has a single mode with the label ``+``.
        """
        return label_of(self.signs) or "+"


def label_of(signs: Iterable[float]) -> str:
    """Return the signs of groups as text: ``+``, ``-``, and ``~`` for the sign 0."""
    return "".join("~+-"[int(sign)] for sign in signs)


def has_configuration(status: SmallIntegers) -> Bools:
    """Return a mask (n,) of the rows with a status for which a configuration exists."""
    return (status == Status.OK) | (status == Status.AT_SINGULARITY)
