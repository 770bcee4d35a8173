"""Configurations in closed form at any inputs, of mechanisms whose groups are all dyads."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.engine.arrays import ArrayFunction, array_function
from spherekit.engine.cache import COMPILED
from spherekit.engine.compiler import CompiledFunction, compile_function
from spherekit.engine.dyads import place_by_inputs
from spherekit.engine.expression_graph import Expr, function, symbols
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


@final
@dataclass(frozen=True)
class ClosedPositions:
    """The configurations of a mechanism by its inputs and the signs of its dyads.

    `function` gives, of inputs and signs in `inputs` rows, all `variables` and the squares
    of the dyads' triple products: `outputs` rows.
    """

    variables: int
    inputs: int
    outputs: int
    function: CompiledFunction | ArrayFunction

    @property
    def width(self) -> int:
        """Rows of the memory that `at` may be given."""
        return self.inputs + self.outputs

    def at(
        self, q: Floats, signs: Sequence[int], memory: Floats | None = None
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the variables (variables, n) at inputs q (inputs, n), and what is lost.

        NaN where no configuration is found; (n,) is true where surely none is. They may be
        in `memory` (width, n).
        """
        if memory is None:
            memory = np.empty((self.width, q.shape[1]))
        given = memory[: self.inputs]
        given[: len(q)] = q
        given[len(q) :] = np.array(signs, dtype=float)[:, None]
        positions = np.asarray(self.function(given, memory[self.inputs :]))
        with np.errstate(invalid="ignore"):
            lost = np.any(positions[self.variables :] < OUT_OF_REACH, axis=0)
        return positions[: self.variables], lost


def closed_positions(
    mechanism: Mechanism, assembly: Assembly, engine: Literal["numpy", "compiled"]
) -> ClosedPositions | None:
    """Return them, None where a group is no dyad."""
    if not assembly.has_closed_form or not assembly.groups:
        return None

    def make() -> ClosedPositions:
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
        outputs = [*angles, *(dyad.square for dyad in placed.dyads)]
        by = compile_function if engine == "compiled" else array_function
        given = [*inputs, *signs]
        made = by(outputs, given)
        return ClosedPositions(len(angles), len(given), len(outputs), made)

    return COMPILED.get(mechanism, repr(("positions", assembly.inputs, engine)), make)


def _angle(mechanism: Mechanism, pair: int, placed: Sequence[LinkOrientation]) -> Expr:
    """Return the angle of an R pair between placed links."""
    joint = revolute(geometry_of(mechanism).joints[pair])
    a, b = mechanism.ends[pair]
    ahead, beside = (placed[a].direction(joint.first[:, k]) for k in (0, 1))
    other = placed[b].direction(joint.second[:, 0])
    return function("atan2", beside @ other, ahead @ other)
