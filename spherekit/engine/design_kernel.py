"""Kernels of which sizes are inputs: one for a topology, whatever its geometry.

What does not depend on the configuration is computed once a design (`prepare`), the rest
at every row (`evaluate`): a row is one sample of one design in one assembly mode.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.engine.actions import Actions
from spherekit.engine.algebra import Exprs, constants, cross, dot
from spherekit.engine.arrays import ArrayFunction, array_function
from spherekit.engine.compiler import CompiledFunction, available, compile_function
from spherekit.engine.derivatives import derivatives
from spherekit.engine.dyads import ClosedDyad, place_by_inputs
from spherekit.engine.expression_graph import (
    Expr,
    ExpressionNode,
    function,
    hoisted,
    symbols,
)
from spherekit.engine.frames import DesignGeometry
from spherekit.engine.kinematics import Structure
from spherekit.engine.misfits import answers, misfit_rates, misfits, newton_step
from spherekit.engine.pose import LinkOrientation, place_by_variables
from spherekit.engine.profile_columns import ProfileColumns
from spherekit.engine.row_quantities import RowQuantities, sample_names
from spherekit.engine.turns import TurningPairs, turning_pairs
from spherekit.model.actions import wound_pairs
from spherekit.model.mechanism import Mechanism
from spherekit.motion.motion import Motion


@final
@dataclass(frozen=True)
class DesignKernel:
    """A function of designs and samples.

    `prepare` takes the sizes (variables, n) to what is the same at all samples of a design.
    `evaluate` takes a sample, the places of the links (then the columns of profiles that
    are handed in) and what is prepared to the
    `columns`, then to their derivatives, size by size, where they were asked for. Places
    are the sign of each dyad in closed form; then the first outputs, one for each dyad, are
    not negative where it closes. Otherwise they are the variables of all pairs.

    Loads that count turns take those (rad) of the pairs `turning`, after the places and the
    columns of profiles. `angles` is the function of the same rows that gives the first
    outputs and then the variables of these pairs less the turns.
    """

    places: tuple[str, ...]
    closed_form: bool
    columns: tuple[str, ...]
    prepare: CompiledFunction | ArrayFunction
    evaluate: CompiledFunction | ArrayFunction
    turning: tuple[str, ...] = ()
    angles: CompiledFunction | ArrayFunction | None = None

    @property
    def reaches(self) -> int:
        """How many outputs come before the columns."""
        return len(self.places) if self.closed_form else 0


Geometry = Callable[[Mapping[str, Expr]], TurningPairs]
"""The pairs in which sizes, by name, are terms."""


@final
@dataclass(frozen=True)
class DesignTerms:
    """What kernels of a topology are written in.

    Attributes
    ----------
    structure
        The kinematics, with `sizes` for the numbers of the mechanism.
    actions
        Its masses and loads; numbers of these that differ are among the sizes too.
    sample, places
        The variables of `sample_names`, and the signs of dyads or the variables of pairs.
    variables
        Of pairs, where these are the places; those that follow from others as terms.
    links, dyads
        The links placed by these, and the dyads in closed form.
    turns
        Of passive pairs whose variables loads depend on, by name: what their turns (rad)
        add to angles that places give.
    """

    structure: Structure
    actions: Actions
    sizes: tuple[ExpressionNode, ...]
    sample: tuple[ExpressionNode, ...]
    places: tuple[ExpressionNode, ...]
    variables: tuple[Expr, ...]
    links: tuple[LinkOrientation, ...]
    dyads: tuple[ClosedDyad, ...]
    turns: Mapping[str, ExpressionNode]

    @staticmethod
    def of(
        mechanism: Mechanism,
        inputs: Sequence[str],
        sizes: Sequence[str] = (),
        geometry: Geometry | None = None,
        closed_form: bool | None = None,
        differing: Sequence[int] = (),
        closed: Motion | None = None,
    ) -> "DesignTerms":
        """Return the terms of a mechanism; by default in closed form where there is one.

        `differing` says which of the numbers of `Actions` are terms, after the sizes;
        `closed` is a motion of the mechanism, if one is known.

        Raises
        ------
        EngineError
            If the engine does not know the mechanism's pairs or groups.
        """
        terms = symbols(sizes)
        pairs = geometry(dict(zip(sizes, terms, strict=True))) if geometry else None
        structure = Structure.of(mechanism, inputs, pairs, closed)
        sample = symbols(sample_names(inputs))
        if closed_form is None:
            closed_form = structure.assembly.has_closed_form
        dyads: list[ClosedDyad] = []
        variables: list[Expr] = []
        if closed_form:
            places = symbols([f"sign_{k + 1}" for k in range(len(structure.groups))])
            placed = place_by_inputs(structure, sample[: len(inputs)], places)
            links, dyads = placed.links, placed.dyads
        else:
            places = symbols(mechanism.variable_names)
            following = structure.following([places[v] for v in structure.inputs])
            variables = [following.get(v, place) for v, place in enumerate(places)]
            links = place_by_variables(mechanism, structure.pairs, variables)
        actions = Actions.of(mechanism)
        numbers: list[Expr] = list(actions.numbers)
        more = symbols([f"number_{k}" for k in differing])
        for k, term in zip(differing, more, strict=True):
            numbers[k] = term
        return DesignTerms(
            structure,
            actions.replaced(numbers),
            sizes=(*terms, *more),
            sample=tuple(sample),
            places=tuple(places),
            variables=tuple(variables),
            links=tuple(links),
            dyads=tuple(dyads),
            turns={
                pair: symbols([f"turns_of_{pair}"])[0]
                for pair in wound_pairs(structure.mechanism)
                if pair not in inputs
            },
        )

    @property
    def closed_form(self) -> bool:
        """Whether the links are placed by the signs of dyads."""
        return bool(self.dyads) or not self.places

    @property
    def profiles(self) -> tuple[ProfileColumns, ...]:
        """The profiles whose columns are handed in after the places."""
        return self.structure.pairs.columns

    @property
    def handed_in(self) -> list[ExpressionNode]:
        """The columns of profiles."""
        both = ((*profile.terms, profile.last) for profile in self.profiles)
        return [term for terms in both for term in terms]

    def _by_place(self, items: Sequence[Expr], v: int) -> list[Expr]:
        """Return the derivatives by a variable, along the profiles that run with it."""
        total = derivatives(items, self.places[v])
        for profile in self.profiles:
            if profile.variable == v:
                for term, along in zip(profile.terms, profile.along, strict=True):
                    partial = derivatives(items, term)
                    total = [x + y * along for x, y in zip(total, partial, strict=True)]
        return total

    def by_sizes(self, items: Sequence[Expr]) -> list[list[Expr]]:
        """Return the derivatives of expressions by each size, the loops kept closed.

        Then by the columns of profiles but for the last of each, if some are handed in.
        """
        if self.closed_form:
            return [derivatives(items, size) for size in self.sizes]
        by_places = [self._by_place(items, v) for v in range(len(self.places))]
        columns = [term for profile in self.profiles for term in profile.terms]
        made = []
        for size in (*self.sizes, *columns):
            rates = misfit_rates(self.structure, self.links, self.variables, size)
            moved = answers(self.structure, self.links, rates)
            total = derivatives(items, size)
            for change, partial in zip(moved, by_places, strict=True):
                total = [x + y * change for x, y in zip(total, partial, strict=True)]
            made.append(total)
        return made


def design_kernel(
    terms: DesignTerms,
    columns: Sequence[str],
    gradients: bool = False,
    compiled: bool = True,
) -> DesignKernel:
    """Return the kernel of a topology.

    Parameters
    ----------
    terms
        What it is written in.
    columns
        Names of `row_quantities`.
    gradients
        Whether their derivatives by all sizes are wanted too.
    compiled
        Whether to compile, where heyoka is installed, or to be ready at once.

    Raises
    ------
    EngineError
        If a column is not known.
    """
    quantities = RowQuantities(terms)
    outputs = [quantities.of(name) for name in columns]
    if gradients:
        outputs += [slope for slopes in terms.by_sizes(outputs) for slope in slopes]
    squares = [dyad.square for dyad in terms.dyads]
    turns = terms.turns if quantities.needs_turns(columns) else {}
    angles = [quantities.angle(pair) for pair in turns]
    moving = [*terms.sample, *terms.places, *terms.handed_in, *turns.values()]
    row_terms, fixed = hoisted([*squares, *outputs, *angles], moving, "design_")
    count, every = len(squares) + len(outputs), [*moving, *fixed]
    make = _made(compiled)
    return DesignKernel(
        tuple(place.arguments[0] for place in terms.places),
        terms.closed_form,
        tuple(columns),
        make(list(fixed.values()), terms.sizes),
        make(row_terms[:count], every),
        tuple(turns),
        make([*row_terms[: len(squares)], *row_terms[count:]], every) if turns else None,
    )


def _made(
    compiled: bool,
) -> Callable[[Sequence[Expr], Sequence[ExpressionNode]], CompiledFunction | ArrayFunction]:
    """Return what makes functions of terms; there is nothing to compile where none is."""

    def make(
        outputs: Sequence[Expr], inputs: Sequence[ExpressionNode]
    ) -> CompiledFunction | ArrayFunction:
        if compiled and available() and outputs:
            return compile_function(outputs, inputs)
        return array_function(outputs, inputs)

    return make


@final
@dataclass(frozen=True)
class NewtonKernel:
    """Newton's step towards closed loops, for designs in rows.

    `prepare` as in `DesignKernel`; `step` takes the variables of all pairs and what is
    prepared to the changes of the variables, the input at rest, then to the determinant
    of the closure equations, and to the square of the misfit (rad2).
    """

    prepare: CompiledFunction | ArrayFunction
    step: CompiledFunction | ArrayFunction


def newton_kernel(terms: DesignTerms, compiled: bool = True) -> NewtonKernel:
    """Return the kernel of Newton's step; `terms` are of variables, not of signs."""
    off = misfits(terms.structure, terms.links, terms.variables)
    change, determinant = newton_step(terms.structure, terms.links, off)
    square: Expr = 0.0
    for misfit in off.values():
        square = square + dot(misfit, misfit)
    moving = [*terms.places, *terms.handed_in]
    row_terms, fixed = hoisted([*change, determinant, square], moving, "design_")
    make = _made(compiled)
    return NewtonKernel(
        make(list(fixed.values()), terms.sizes),
        make(row_terms, [*moving, *fixed]),
    )


def arc_function(
    mechanism: Mechanism,
    variables: Sequence[str],
    geometry: Callable[[Mapping[str, Expr]], DesignGeometry],
) -> tuple[tuple[int, ...], ArrayFunction]:
    """Return the links with two axes, and the function of sizes that gives their arcs.

    The arcs (links, n) are in [0, pi] rad.
    """
    terms = symbols(variables)
    pairs = turning_pairs(mechanism, geometry(dict(zip(variables, terms, strict=True))))
    axes: dict[int, list[Exprs]] = {k: [] for k in range(len(mechanism.links))}
    for variable, (spin, *rest) in enumerate(pairs.spins):
        if not rest and variable in pairs.twin:
            for end in (spin, pairs.twin[variable]):
                axes[end.link].append(constants(end.axis))
    links = tuple(link for link, directions in axes.items() if len(directions) == 2)
    arcs = []
    for link in links:
        one, other = axes[link]
        normal = cross(one, other)
        arcs.append(function("atan2", np.sqrt(dot(normal, normal)), dot(one, other)))
    return links, array_function(arcs, terms)
