"""How the variables answer where pairs do not fit: Newton's step, derivatives by sizes.

With links placed along a tree of pairs, the pairs that close loops miss each other by a
small rotation. At the inputs at rest, the variables change so that all pairs fit again:

    w_second - w_first = A x - e,

with A the vectors of the pair's variables, x their changes, and e the rotation by which its
second link is turned against where the pair has it. With the misfit of a configuration that
is nearly closed, x is Newton's step; with the rate of the misfit by a size, x is the
derivative of the variables by it.
"""

from collections.abc import Sequence

import numpy as np

from spherekit.engine.algebra import Exprs, cross, vector
from spherekit.engine.derivatives import derivatives
from spherekit.engine.expression_graph import Expr, ExpressionNode
from spherekit.engine.kinematics import Structure
from spherekit.engine.pose import Angles, LinkOrientation, placed_by
from spherekit.motion.loops import LoopTree


def _rotations(
    structure: Structure,
    links: Sequence[LinkOrientation],
    variables: Sequence[Expr],
    pair: int,
) -> list[Exprs]:
    """Return the rotation (3, 3) of a pair's second link, and where the pair has it."""
    first, second = structure.mechanism.ends[pair]
    chain = structure.pairs.chains[pair]
    there = placed_by(chain, links[first], Angles(variables))
    return [
        np.stack([placed.direction(axis) for axis in np.eye(3)], axis=1)
        for placed in (links[second], there)
    ]


def _half_turn(basis: Exprs, rate: Exprs) -> Exprs:
    """Return half the sum of b x b' over the columns of two matrices (3, 3)."""
    total = vector([0.0, 0.0, 0.0])
    for k in range(3):
        total = total + cross(basis[:, k], rate[:, k])
    return np.asarray(total * 0.5)


def misfits(
    structure: Structure, links: Sequence[LinkOrientation], variables: Sequence[Expr]
) -> dict[int, Exprs]:
    """Return by how much (3,) each pair that closes a loop is off, to first order (rad)."""
    made = {}
    for pair in LoopTree.of(structure.mechanism).chords:
        here, there = _rotations(structure, links, variables, pair)
        made[pair] = _half_turn(there, here)
    return made


def openness(
    structure: Structure, links: Sequence[LinkOrientation], variables: Sequence[Expr]
) -> Expr:
    """Return the square of by how much loops are open (rad2), half turns included."""
    total: Expr = 0.0
    for pair in LoopTree.of(structure.mechanism).chords:
        here, there = _rotations(structure, links, variables, pair)
        for entry in (here - there).ravel():
            total = total + 0.5 * (entry * entry)
    return total


def misfit_rates(
    structure: Structure,
    links: Sequence[LinkOrientation],
    variables: Sequence[Expr],
    by: ExpressionNode,
) -> dict[int, Exprs]:
    """Return the rates (3,) of the misfits by a size, the variables held."""
    made = {}
    for pair in LoopTree.of(structure.mechanism).chords:
        turned = []
        for basis in _rotations(structure, links, variables, pair):
            rate = vector(derivatives(list(basis.ravel()), by)).reshape(3, 3)
            turned.append(_half_turn(basis, rate))
        made[pair] = np.asarray(turned[0] - turned[1])
    return made


def answers(
    structure: Structure,
    links: Sequence[LinkOrientation],
    misfit: dict[int, Exprs],
) -> list[Expr]:
    """Return how all variables answer to misfits (3,) of pairs, the inputs at rest."""
    return newton_step(structure, links, misfit)[0]


def newton_step(
    structure: Structure,
    links: Sequence[LinkOrientation],
    misfit: dict[int, Exprs],
) -> tuple[list[Expr], Expr]:
    """Return the `answers`, and the determinant of the equations."""
    solver = structure.solved(structure.at_rest, structure.vectors(links), misfit)
    made = [solver.rates[v] / solver.scale for v in range(len(solver.vectors))]
    return made, solver.scale


def rates_by_inputs(
    structure: Structure, links: Sequence[LinkOrientation]
) -> tuple[list[list[Expr]], Expr]:
    """Return the derivatives of all variables by each input, and the determinant.

    It is that of the equations: its sign changes where modes meet.
    """
    made, vectors = [], structure.vectors(links)
    for pair in structure.input_pairs:
        solver = structure.solved(structure.moving(pair), vectors)
        made.append([solver.rates[v] / solver.scale for v in range(len(solver.vectors))])
    return made, solver.scale
