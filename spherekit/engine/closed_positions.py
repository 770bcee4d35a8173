"""Configurations in closed form at any inputs, of mechanisms whose groups are all dyads."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.engine.arrays import ArrayFunction, array_function
from spherekit.engine.cache import COMPILED
from spherekit.engine.dyads import place_by_inputs
from spherekit.engine.expression_graph import (
    Expr,
    ExpressionNode,
    function,
    symbols,
)
from spherekit.engine.kinematics import Structure
from spherekit.engine.pose import LinkOrientation
from spherekit.engine.turns import turning_pairs
from spherekit.model.geometry import geometry_of
from spherekit.model.joints import revolute
from spherekit.model.mechanism import Mechanism
from spherekit.motion.pairs import numbered
from spherekit.planning.assembly import Assembly
from spherekit.sphere.rotation import Floats

OUT_OF_REACH = -1e-4
"""Squares of triple products below this are those of arcs that do not reach each other,
whatever their ends are off by."""
IN_LINE = 1e-16
"""Squares above this are those of dyads that are placed to 1e-8 rad at least."""


@final
@dataclass(frozen=True)
class ClosedForm:
    """The terms of configurations, by `inputs` and `signs` of the dyads.

    `variables` are all variables, `squares` those of the dyads' triple products.
    """

    inputs: Sequence[ExpressionNode]
    signs: Sequence[ExpressionNode]
    variables: Sequence[Expr]
    squares: Sequence[Expr]

    @property
    def given(self) -> list[ExpressionNode]:
        """What functions of them are given."""
        return [*self.inputs, *self.signs]


def closed_form(mechanism: Mechanism, assembly: Assembly) -> ClosedForm | None:
    """Return the terms, None where a group is no dyad."""
    if not assembly.has_closed_form or not assembly.groups:
        return None
    inputs = symbols(f"q_{k + 1}" for k in range(len(assembly.inputs)))
    signs = symbols(f"sign_{k + 1}" for k in range(len(assembly.groups)))
    # Rates are not asked for, so no equations are chosen.
    structure = Structure(mechanism, assembly, turning_pairs(mechanism), ())
    placed = place_by_inputs(structure, inputs, signs)
    driven = dict(zip(assembly.inputs, inputs, strict=True))
    angles = [
        driven[pair] if pair in driven else _angle(mechanism, pair, placed.links)
        for pair, _, _ in numbered(geometry_of(mechanism).joints)
    ]
    return ClosedForm(inputs, signs, angles, [dyad.square for dyad in placed.dyads])


def given_by(q: Floats, signs: Sequence[int], out: Floats) -> Floats:
    """Write inputs q (inputs, n) and the signs of dyads into what functions are given."""
    out[: len(q)] = q
    out[len(q) :] = np.array(signs, dtype=float)[:, None]
    return out


def lost_by(squares: Floats) -> NDArray[np.bool_]:
    """Return (n,) where squares (dyads, n) say that there surely is no configuration.

    In solving order: one that follows a dyad in line says nothing.
    """
    lost = np.zeros(squares.shape[1], dtype=bool)
    placed = ~lost
    with np.errstate(invalid="ignore"):
        for square in squares:
            lost |= placed & (square < OUT_OF_REACH)
            placed &= square > IN_LINE
    return lost


@final
@dataclass(frozen=True)
class ClosedPositions:
    """The configurations of a mechanism by its inputs and the signs of its dyads.

    `function` gives, of inputs and signs in rows, all `variables`, then the squares.
    """

    variables: int
    inputs: int
    function: ArrayFunction

    def at(self, q: Floats, signs: Sequence[int]) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the variables (variables, n) at inputs q (inputs, n), and what is lost.

        NaN where no configuration is found; (n,) is true where surely none is.
        """
        given = given_by(q, signs, np.empty((self.inputs, q.shape[1])))
        positions = np.asarray(self.function(given))
        return positions[: self.variables], lost_by(positions[self.variables :])


def closed_positions(mechanism: Mechanism, assembly: Assembly) -> ClosedPositions | None:
    """Return them on arrays, None where a group is no dyad."""

    def make() -> ClosedPositions | None:
        form = closed_form(mechanism, assembly)
        if form is None:
            return None
        outputs = [*form.variables, *form.squares]
        made = array_function(outputs, form.given)
        return ClosedPositions(len(form.variables), len(form.given), made)

    return COMPILED.get(mechanism, repr(("positions", assembly.inputs)), make)


def _angle(mechanism: Mechanism, pair: int, placed: Sequence[LinkOrientation]) -> Expr:
    """Return the angle of an R pair between placed links."""
    joint = revolute(geometry_of(mechanism).joints[pair])
    a, b = mechanism.ends[pair]
    ahead, beside = (placed[a].direction(joint.first[:, k]) for k in (0, 1))
    other = placed[b].direction(joint.second[:, 0])
    return function("atan2", beside @ other, ahead @ other)
