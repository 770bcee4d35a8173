"""Everything that a run reads of a row, as terms of the pair variables.

The closure of the loops, the rates and their derivatives, all poles and how they turn,
and what each of them may be off by. A configuration closes its loops up to their residual
and the rounding of the numbers they are made of. Whichever way they stay open, the links
lie elsewhere, their axes with them, and so the velocity equations have other coefficients;
the bounds are of norms, with what the numbers given leave over in the equations.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, islice
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.pole_plan import Pole
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, dot
from spherekit.symbolic.vector_algebra import Exprs, vector_sum
from spherekit.tolerances import EPS, EQUAL_CURVATURE
from spherekit.velocities.axis_rotations import pair_rotations
from spherekit.velocities.carried_vectors import CarriedVector, absolute, largest, root
from spherekit.velocities.direction_signs import SIGNED
from spherekit.velocities.elimination_order import Pivot
from spherekit.velocities.loop_inverse import loop_inverse
from spherekit.velocities.pole_field import TURN_KNOWN, axis_pairs
from spherekit.velocities.pole_request import Request
from spherekit.velocities.pose_expressions import place_by_variables, sum_along_paths
from spherekit.velocities.velocity_equations import VelocityEquations

LARGEST_ERROR = 1e-9
"""Rows in which a direction may be off by more are not vouched for: norms alone say too
little of them."""
LARGEST_PART = 1e-8
"""The same for derivatives of rates, as a part of those of all links together, or of 1."""

PROFILE_ROUNDING = 4.0 * EPS
"""What rounding turns the frame of a profile by."""


ERRORS = ("error", "velocity_coefficient_error", "acceleration_coefficient_error")
"""What bounds its errors: of the direction, the rate and its derivative."""
DIRECTION_DQ_ERROR = "direction_dq_error"
"""What bounds the error (1/rad) of the derivative of the direction."""
BOUNDS = (*ERRORS, DIRECTION_DQ_ERROR)
"""All bounds of errors of a pole. The last one decides about no row."""
PARTS = (*SIGNED, "angle", *BOUNDS, "w", "dw")
"""Parts of a field that are columns, called as in `PoleField`."""


def placed(columns: dict[Any, int], items: Iterable[Expr]) -> list[int]:
    """Return where expressions are among columns; what is wanted twice is one column."""
    return [columns.setdefault(item, len(columns)) for item in items]


class RowTerms(VelocityEquations):
    """The terms of a row that do not depend on the input that moves."""

    def __init__(
        self,
        mechanism: Mechanism,
        variables: Sequence[ExpressionNode],
        pivots: Sequence[Pivot],
        inputs: Sequence[int],
    ) -> None:
        pairs = pair_rotations(mechanism, any_profile=True)
        placed = place_by_variables(mechanism, pairs, variables)
        super().__init__(mechanism, pairs, placed, variables, False)
        held = [self.owned[pair][0] for pair in inputs]
        self.free = [v for v in range(len(variables)) if v not in held]
        equations = np.stack(self.vectors, axis=1) * self.tree.signs[:, None]
        equations[..., held] = 0.0
        self.inverse = loop_inverse(equations, pivots)
        # Of a rotation by an angle x it is 2 sin x / 2.
        self.residual = root(self.openness)
        self._bounds()

    def _bounds(self) -> None:
        """Set the bounds of what variables, orientations and axes are off by."""
        tree = self.tree
        squares = [dot(row.flat, row.flat) for row in self.inverse]
        self.moved = [root(square) for square in squares]
        sensitivity = root(sum(squares, 0.0))
        self.turns = self.paths(self.moved)
        rounding = EPS * (2.0 + tree.longest_loop)
        gap = self.residual + rounding
        # Two axes of a frame are each off by as much.
        profiles = 2.0 * len(self.pairs.sides)
        self.open_by_rounding = np.sqrt(2.0) * (rounding + profiles * PROFILE_ROUNDING)
        self.open = gap * float(np.sqrt(3.0 * len(tree.chords)))
        self.numbers = 2.0 * EPS * (2.0 + tree.longest_path)
        self.axes, self.slides = [], []
        for carried, moved in zip(self.carried, self.moved, strict=True):
            axis_error, slide_error = self.position_errors(carried, moved)
            self.axes.append(axis_error)
            self.slides.append(slide_error)
        self.often = np.count_nonzero(tree.signs, axis=0).astype(float).tolist()
        sizes = [carried.length * carried.length for carried in self.carried]
        entries = sum((self.often[v] * sizes[v] for v in self.free), 0.0)
        self.flatness = sensitivity * root(entries)
        bent = float(tree.longest_loop) * largest(sizes)
        self.bend = bent * (sensitivity * sensitivity) * gap
        left = root(1.0 - 2.0 * self.bend)
        self.moved_by = sensitivity * gap * 2.0 / (1.0 + left) + 2.0 * EPS

    def position_errors(self, carried: CarriedVector, moved: Expr) -> tuple[Expr, Expr]:
        """Return bounds of the errors of a carried vector and of its slide.

        `moved` is how far the variable along which the vector slides moves as the loops
        open by one unit.
        """
        turn = self.turns[carried.link] * self.open + self.numbers
        slip = moved * self.open
        axis_error = carried.length * turn + carried.slide_length * slip
        return axis_error, carried.slide_length * turn + carried.slide_change_bound * slip

    def paths(self, parts: Sequence[Expr]) -> list[Expr]:
        """Return for each link how far variables that move by so much turn it at most."""
        both = zip(self.carried, parts, strict=True)
        return self.added([carried.length * part for carried, part in both])

    def added(self, parts: Sequence[Expr]) -> list[Expr]:
        """Return for each link the sum of parts of the variables on the way to it."""
        sums: list[Expr] = [0.0] * self.tree.count
        for pair, parent, child in self.tree.placements:
            sums[child] = sums[parent] + sum((parts[v] for v in self.owned[pair]), 0.0)
        return sums

    @property
    def closer(self) -> list[Expr]:
        """The free variables after a step of Newton's method."""
        step = self.answers(self.misfits)
        return [self.variables[v] + step[v] for v in self.free]

    def answers(self, misfits: Mapping[int, Exprs]) -> list[Expr]:
        """Return how all variables answer to misfits (3,) of pairs, the inputs at rest."""
        right = [
            vector_sum(x * row[self.owned[pair][0]] for pair, x in misfits.items())
            for row in self.tree.signs
        ]
        return [dot(row.flat, np.ravel(right)) for row in self.inverse]


class MovingTerms:
    """Rates while one input moves, and where they are among the columns of all inputs.

    `of` says it of each of the `PARTS`, by pole or link. `signed` are the poles whose
    direction is theirs but for its sign, `signs` their columns: as in `SIGNED`, each of all
    poles. `worst` is the largest of what decides about errors.
    """

    def __init__(self, rows: RowTerms, wanted: Request, columns: dict[Any, int]) -> None:
        self._rows, self._wanted = rows, wanted
        moved, tree = rows.owned[wanted.plan.input][0], rows.tree
        self._rates = rows.answers({wanted.plan.input: -1.0 * rows.vectors[moved]})
        self._rates[moved] = 1.0
        parts = rows.parts(self._rates)
        self._w = sum_along_paths(tree, parts)
        self._change, bent = rows.accelerated(self._rates, self._w)
        self._dw = sum_along_paths(tree, bent)
        self.over, self.over_bent = self._left(self._w, parts), self._left(self._dw, bent)
        self._follow_errors()
        self._place(columns)

    def _left(self, links: Sequence[Exprs], parts: Sequence[Exprs]) -> Expr:
        """Return the size of what rates leave over where loops close."""
        tree = self._rows.tree
        both = ((chord, *tree.ends[chord]) for chord in tree.chords)
        over = [links[a] - links[b] + parts[chord] for chord, a, b in both]
        return root(sum((dot(x, x) for x in over), 0.0))

    def _follow_errors(self) -> None:
        """Set what links and variables are off by, in first and second derivatives."""
        rows = self._rows
        speeds, bends = ([absolute(x) for x in y] for y in (self._rates, self._change))
        self._speeds, self._spins_at_most = speeds, rows.paths(speeds)
        slips = [speed * off for speed, off in zip(speeds, rows.axes, strict=True)]
        self._off_w, off_rates = self._off(slips, self.over)
        again, spread = list[Expr](), list[Expr]()
        of_variables = rows.carried, speeds, bends, off_rates, rows.axes, rows.slides
        self._off_turned = list[Expr]()
        for carried, speed, bend, off_rate, off, slide in zip(*of_variables, strict=True):
            turned = carried.length * self._spins_at_most[carried.link]
            turned = turned + speed * carried.slide_length
            off_turned = self._change_error(carried, speed, off_rate, off, slide)
            self._off_turned.append(off_turned)
            again.append(bend * off + speed * off_turned + turned * off_rate)
            spread.append(bend * carried.length + speed * turned)
        self._off_dw, off_change = self._off(again, self.over_bent)
        self._off_rates = [sum(both) for both in zip(off_rates, slips, strict=True)]
        self._off_change = [sum(both) for both in zip(off_change, again, strict=True)]
        self._swings, self.swings = rows.added(spread), sum(spread, 0.0)
        self.fast = dot(speeds, [carried.length for carried in rows.carried])
        bent = sum((dot(rate, rate) for rate in self._dw), 0.0)
        self.part = sum(self._off_dw, 0.0) / root(1.0 + bent)
        self.worst = self.part * (LARGEST_ERROR / LARGEST_PART)

    def _change_error(
        self, carried: CarriedVector, speed: Expr, off_rate: Expr, off: Expr, slide: Expr
    ) -> Expr:
        """Return a bound of the error of the derivative of a carried vector.

        The derivative is w x a + s r, where the link turns at w, and the vector a slides
        by s per unit of a variable, which runs at r. `off_rate`, `off` and `slide` bound
        the errors of r, a and s.
        """
        spin = self._spins_at_most[carried.link]
        error = carried.length * self._off_w[carried.link] + spin * off
        return error + carried.slide_length * off_rate + speed * slide

    def _off(self, slips: Sequence[Expr], over: Expr) -> tuple[list[Expr], list[Expr]]:
        """Return what links and variables are off by, in a derivative.

        `slips` are what the terms of variables in the equations are off by, `over` what the
        equations have left.
        """
        rows = self._rows
        whole = over + dot(rows.often, slips)
        along = zip(rows.turns, rows.added(slips), strict=True)
        return [x * whole + path for x, path in along], [x * whole for x in rows.moved]

    def _place(self, columns: dict[Any, int]) -> None:
        """Add the columns, of which those with a sign are of their own."""
        plan, parts = self._wanted.plan, dict[tuple[str, Any], Iterable[Expr]]()
        pairs, signed = axis_pairs(plan), dict[Pole, list[Expr]]()
        for pole in self._wanted.poles:
            body_pole = plan.pole(*pole)
            if body_pole in pairs:
                made = self._of_pair(pole, pairs[body_pole])
            elif body_pole is not None:
                signed[pole], made = self._across(*pole)
            else:
                continue
            parts |= {(name, pole): items for name, items in made.items()}
        for link in sorted(self._wanted.links):
            parts |= {("w", link): self._w[link], ("dw", link): self._dw[link]}
        first, count = len(columns), len(signed)
        for item in chain.from_iterable(zip(*signed.values(), strict=True)):
            columns[len(columns), item] = len(columns)
        self.signed, self.signs = tuple(signed), slice(first, len(columns))
        self._ends = np.array(self.signed, dtype=np.intp).reshape(-1, 2).T
        spins: dict[Expr, int] = {}
        self._at = np.array([placed(spins, w) for w in self._w])
        self.spins = list(spins)
        self.of: dict[str, dict[Any, list[int]]] = {name: {} for name in PARTS}
        for k, pole in enumerate(signed):
            at = iter(range(first + k, len(columns), count))
            for name, size in SIGNED.items():
                self.of[name][pole] = list(islice(at, size))
        for (name, key), items in parts.items():
            self.of[name][key] = placed(columns, items)

    def relative(self, spins: Floats, less: Floats | None = None) -> Floats:
        """Return (poles, 3, ...) relative angular velocities of poles without a sense.

        From `spins` (k, ...), what angular velocities of links have as components, `less`
        those, where they differ, that are subtracted.
        """
        first, second = self._ends
        return spins[self._at[second]] - (spins if less is None else less)[self._at[first]]

    def with_sign(self, columns: Floats) -> Floats:
        """Return (8, poles, n) what has a sign of its own, from all columns: a view."""
        return columns[self.signs].reshape(8, len(self.signed), columns.shape[1])

    @property
    def in_doubt(self) -> bool:
        """Whether links that no pair joins rest, or axes are one but for rounding."""
        relative = (self._w[j] - self._w[i] for i, j in self.signed)
        return bool(self._wanted.plan.rounded_axes) or not all(
            any(isinstance(x, ExpressionNode) for x in v) for v in relative
        )

    def _of_pair(self, pole: Pole, pair: int) -> dict[str, Iterable[Expr]]:
        """Return what there is of a pole that is the axis of a pair, by part."""
        rows, (i, j) = self._rows, pole
        (variable,) = rows.owned[pair]
        first, second = rows.tree.ends[pair]
        carried = rows.carried[variable]
        off, off_turned = rows.axes[variable], self._off_turned[variable]
        if pair in rows.lines:
            carried = rows.lines[pair]
            off, slide = rows.position_errors(carried, rows.moved[variable])
            off_turned = self._change_error(
                carried, self._speeds[variable], self._off_rates[variable], off, slide
            )
        unit = carried.vector
        turned = carried.derivative(self._w[carried.link], self._rates[variable])
        if {i, j} == {first, second} and pair not in rows.lines:
            sense = 1.0 if i == first else -1.0
            rate, change = sense * self._rates[variable], sense * self._change[variable]
            e_rate, e_change = self._off_rates[variable], self._off_change[variable]
        else:
            v, dv, e_rate, e_change, swing = self._between(i, j)
            rate, change = dot(v, unit), dot(dv, unit)
            e_change = e_change + off * swing
        axis = dict(zip(SIGNED, ([*unit], [*turned], [rate], [change]), strict=True))
        return {**axis, "angle": [1.0], **_errors(off, e_rate, e_change, off_turned)}

    def _between(self, i: int, j: int) -> tuple[Exprs, Exprs, Expr, Expr, Expr]:
        """Return how links turn relative to each other, its change, and the errors of both.

        And how fast the rates of both change at most.
        """
        off = self._off_w[i] + self._off_w[j]
        changed = self._off_dw[i] + self._off_dw[j] + off
        v, dv = (rates[j] - rates[i] for rates in (self._w, self._dw))
        return v, dv, off, changed, self._swings[i] + self._swings[j]

    def _across(self, i: int, j: int) -> tuple[list[Expr], dict[str, Iterable[Expr]]]:
        """Return the columns with a sign of a pole, and what else there is of it."""
        v, dv, e_rate, e_change, swing = self._between(i, j)
        length = root(dot(v, v))
        if length == 0.0:
            errors = _errors(1.0, e_rate, e_change, np.nan)
            return [*[np.nan] * 6, 0.0, 0.0], {"angle": [0.0], **errors}
        share = 1.0 / length
        unit = v * share
        change = dot(dv, unit)
        turn = (dv - change * unit) * share
        sizes = [root(dot(w, w)) for w in (self._w[i], self._w[j])]
        angle = length / (sizes[0] + sizes[1]) if all(sizes) else 1.0
        direction = e_rate * share
        # The derivative of the coefficient is dv . u. An error of u multiplies the part of
        # dv across u, which need not be small where v is.
        transverse = direction * swing
        e_change = e_change + transverse
        e_turn = (e_change + transverse) * share
        doubt = e_change * share * (2.0 * LARGEST_ERROR / TURN_KNOWN)
        self.worst = self.worst + direction + doubt
        errors = _errors(direction, e_rate, e_change, e_turn)
        return [*unit, *turn, length, change], {"angle": [angle], **errors}


def curved(rows: RowTerms) -> list[Expr]:
    """Return what is above 1 where the first profile of a contact curves too little."""
    curving = (one.curvature - other.curvature for one, other in rows.pairs.sides.values())
    # Roots are no numbers where the other profile curves more.
    return [
        2.0 * EQUAL_CURVATURE / (root(x) * root(x))
        for x in curving
        if isinstance(x, ExpressionNode)
    ]


def _errors(*bounds: Expr) -> dict[str, Iterable[Expr]]:
    return {name: [bound] for name, bound in zip(BOUNDS, bounds, strict=True)}
