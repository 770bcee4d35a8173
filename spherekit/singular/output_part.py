"""The part of a mechanism that moves an output: what else moves is no singularity of it."""

from dataclasses import dataclass
from typing import final

from spherekit.model.mechanism import Mechanism
from spherekit.motion.loops import LoopTree
from spherekit.planning.assembly import Assembly
from spherekit.planning.part import moving_pairs


@final
@dataclass(frozen=True)
class OutputPart:
    """The pairs by which an output moves, and the loops that they close.

    Attributes
    ----------
    tree
        These loops, rooted in the link that the output is seen from.
    variables, driven
        Their variables, and those of them that are inputs, numbered as in the mechanism.
    way
        (V,) the sense in which the way to the output passes each variable of the
        mechanism, 0 for most.
    """

    tree: LoopTree
    variables: tuple[int, ...]
    driven: tuple[int, ...]
    way: tuple[float, ...]

    @staticmethod
    def of(
        mechanism: Mechanism, assembly: Assembly, link: int, relative_to: int
    ) -> "OutputPart | None":
        """Return the part that moves a link relative to another, None for all pairs."""
        pairs = moving_pairs(mechanism, assembly, (link, relative_to))
        if len(pairs) == len(mechanism.pairs):
            return None
        ends = [mechanism.ends[pair] for pair in pairs]
        bodies = list(dict.fromkeys([relative_to, link, *(x for two in ends for x in two)]))
        number = {body: k for k, body in enumerate(bodies)}
        owners = mechanism.variable_owners
        variables = tuple(v for v, owner in enumerate(owners) if owner in pairs)
        tree = LoopTree(
            len(bodies),
            tuple((number[a], number[b]) for a, b in ends),
            tuple(pairs.index(owners[v]) for v in variables),
        )
        way = dict(zip(variables, tree.paths[number[link]].tolist(), strict=True))
        driven = [mechanism.variables_of(pair)[0] for pair in assembly.inputs]
        return OutputPart(
            tree,
            variables,
            tuple(v for v in driven if v in variables),
            tuple(way.get(v, 0.0) for v in range(len(owners))),
        )
