"""The motion of a single-DOF mechanism as expressions, in a homogeneous parameter.

The parameter p is that in which the rates of the variables are the minors of the velocity
equations (`spherekit.engine.rates`): dv/dp = tau(v). Nothing is divided, so p runs through
the dead centres of every pair. Rates by the input are those by p over tau_q, rates by the
arc length of the curve in the space of all variables those over |tau|.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from spherekit.engine.algebra import (
    Exprs,
    cross,
    jets,
    rates_of,
    vector,
)
from spherekit.engine.pose import Placement, spin_vectors
from spherekit.engine.rates import GroupRows, HomogeneousRates, group_rows
from spherekit.engine.terms import Expr, function
from spherekit.engine.turns import Spin, TurningPairs, turning_pairs
from spherekit.errors import EngineError
from spherekit.model.mechanism import Mechanism
from spherekit.motion.loops import LoopTree
from spherekit.motion.motion import Tracer
from spherekit.planning.assembly import Assembly, plan_assembly
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Structure:
    """What of a mechanism's kinematics does not depend on how links are placed."""

    mechanism: Mechanism
    assembly: Assembly
    pairs: TurningPairs
    groups: tuple[GroupRows, ...]
    driven: int

    @staticmethod
    def of(mechanism: Mechanism, input_pair: str) -> "Structure":
        """Return the structure of a mechanism with this pair as input.

        Raises
        ------
        EngineError
            If a profile is no circle, or a group is too large.
        PlanError
            If the mechanism does not have exactly one freedom.
        """
        assembly = plan_assembly(mechanism.with_inputs(input_pair))
        pairs = turning_pairs(mechanism)

        def vectors() -> Floats:
            tracer = Tracer(mechanism, input_pair, search=False)
            motion = tracer.at(np.linspace(*tracer.range, 9))
            closed = np.flatnonzero(~motion.failed)
            if not len(closed):
                raise EngineError(
                    f"{mechanism.name}: no configuration was found at which to choose "
                    "independent equations; give a range of the input where it closes"
                )
            first = int(closed[0])
            return np.asarray(motion.vectors[first])

        groups = group_rows(mechanism, assembly, vectors)
        (driven,) = mechanism.variables_of(assembly.input)
        return Structure(mechanism, assembly, pairs, groups, driven)

    def span(self, one: int, other: int) -> float | None:
        """Return |A x B|^2 of two variables' vectors where it is constant, else None."""
        owners = self.mechanism.variable_owners
        if owners[one] == owners[other]:
            sizes = [self.pairs.spins[v][0].size for v in (one, other)]
            cosine = float(self.pairs.chains[owners[one]].constants[1][2, 2])
            return (sizes[0] * sizes[1]) ** 2 * (1.0 - cosine * cosine)
        held = [
            {s.link: s.size * s.axis for s in self.single_spins(v)} for v in (one, other)
        ]
        for link in set(held[0]) & set(held[1]):
            return float(np.sum(np.cross(held[0][link], held[1][link]) ** 2))
        return None

    def single_spins(self, variable: int) -> list[Spin]:
        """Return a variable's vector as an axis of one link, for each link it suits."""
        spins = self.pairs.spins[variable]
        if len(spins) > 1:
            return []
        twin = self.pairs.twin.get(variable)
        return [*spins, twin] if twin else [*spins]


@final
class Flow:
    """Rates in the homogeneous parameter p at given placements of the links.

    `tau[v]`, `tau_rate[v]`: dv/dp and d2v/dp2; `vectors[v]`, `vector_rates[v]` (3,): the
    angular velocity of a pair's second link per unit rate of its variable, in ground
    axes, and its derivative; `w[link]`, `w_rate[link]` (3,): angular velocity relative
    to the ground per unit of p, and its derivative.
    """

    def __init__(self, structure: Structure, placed: Sequence[Placement]) -> None:
        self.structure = structure
        self.placed = placed
        mechanism = structure.mechanism
        self.tree = LoopTree.of(mechanism)
        spins = [
            spin_vectors(structure.pairs, placed, v)
            for v in range(len(mechanism.variable_owners))
        ]
        self.vectors = [_sum([axis * size for size, _, axis in each]) for each in spins]
        self.tau = self._solve(self.vectors)
        self.w = [self.relative(0, link) for link in self._links]
        self.vector_rates = [
            _sum([cross(self.w[link], axis) * size for size, link, axis in each])
            for each in spins
        ]

    @property
    def _links(self) -> range:
        return range(len(self.structure.mechanism.links))

    def _solve(self, vectors: Sequence[Exprs]) -> list[Expr]:
        structure = self.structure
        solver = HomogeneousRates(
            structure.mechanism, structure.assembly.input, vectors, structure.span
        )
        for rows in structure.groups:
            solver.close(rows)
        return [solver.rates[v] for v in range(len(vectors))]

    def _along(
        self, link: int, other: int, vectors: Sequence[Exprs], tau: Sequence[Expr]
    ) -> Exprs:
        senses = self.tree.paths[other] - self.tree.paths[link]
        parts = [vectors[v] * (float(s) * tau[v]) for v, s in enumerate(senses) if s]
        return _sum(parts)

    def relative(self, link: int, other: int) -> Exprs:
        """Return (3,) the angular velocity of the other link relative to a link."""
        return self._along(link, other, self.vectors, self.tau)

    def relative_rate(self, link: int, other: int) -> Exprs:
        """Return (3,) its derivative by p in ground axes."""
        turning = self._along(link, other, self.vectors, self.tau_rate)
        return np.asarray(turning + self._along(link, other, self.vector_rates, self.tau))

    @cached_property
    def tau_rate(self) -> list[Expr]:
        """d2v/dp2 of every variable."""
        moving = [
            jets(one, other)
            for one, other in zip(self.vectors, self.vector_rates, strict=True)
        ]
        return [rates_of(vector([each]))[0] for each in self._solve(moving)]

    @cached_property
    def w_rate(self) -> list[Exprs]:
        """Derivatives (3,) by p of every link's w."""
        return [self.relative_rate(0, link) for link in self._links]

    def seen(self, link: int) -> Exprs:
        """Return w as components (3,) along a link's basis."""
        placed, seen = self.placed[link], _sum([])
        for v, sense in enumerate(self.tree.paths[link]):
            if sense:
                seen = seen + self._along_basis(v, placed, link) * (
                    float(sense) * self.tau[v]
                )
        return seen

    def seen_rate(self, link: int) -> Exprs:
        """Return the derivative of w as components (3,) along a link's basis."""
        placed, change = self.placed[link], _sum([])
        for v, sense in enumerate(self.tree.paths[link]):
            if not sense:
                continue
            axis = self._along_basis(v, placed, link)
            turned = placed.seen(self.vector_rates[v])
            change = change + axis * (float(sense) * self.tau_rate[v])
            change = change + turned * (float(sense) * self.tau[v])
        return change

    def _along_basis(self, variable: int, placed: Placement, link: int) -> Exprs:
        fixed = self._fixed(variable, link)
        return placed.seen(self.vectors[variable]) if fixed is None else fixed

    def _fixed(self, variable: int, link: int) -> Exprs | None:
        """Return a variable's vector along a link's basis if it is fixed in the link."""
        for spin in self.structure.single_spins(variable):
            if spin.link == link:
                return np.asarray(self.placed[link].fixed(spin.axis) * spin.size)
        return None

    @property
    def input_rate(self) -> Expr:
        """dq/dp."""
        return self.tau[self.structure.driven]

    @property
    def speed(self) -> Expr:
        """|tau|: how fast the curve of all variables is run along, per unit of p."""
        square: Expr = 0.0
        for each in self.tau:
            square = square + each * each
        return function("sqrt", square)


def _sum(parts: Sequence[Exprs]) -> Exprs:
    total = vector([0.0, 0.0, 0.0])
    for part in parts:
        total = total + part
    return total
