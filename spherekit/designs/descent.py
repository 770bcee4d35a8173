"""Descents of syntheses by exact gradients, and the assembly modes that they hold on to."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.designs.cutting_planes import Parts, least_greatest
from spherekit.designs.design_evaluation import Evaluator
from spherekit.designs.design_kernel import DesignKernel
from spherekit.designs.design_space import Columns
from spherekit.designs.figures_of_merit import widest_swings
from spherekit.designs.homotopy import LONG, SAME, apart, tracked
from spherekit.designs.path_kernel import PathKernel
from spherekit.designs.synthesis_requirements import MATCH, Specification
from spherekit.designs.varied_mechanism import DEG, DesignAt
from spherekit.errors import SpherekitError
from spherekit.geometry.vectors import all_finite, max_abs, nans
from spherekit.symbolic.expression_derivatives import differentiate
from spherekit.symbolic.expression_evaluation import ArrayFunction, array_function
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, symbols
from spherekit.symbolic.parsed_expressions import convert_to_graph


@dataclass(frozen=True, eq=False)
class HeldMode:
    """An assembly mode at the samples of a synthesis, then at the inputs of its figures.

    Its `label` is its name among the modes of the design. Of groups that are all dyads it
    has their signs, ``+-``. Others are `followed`: by Newton's step from a design and its
    configurations (variables, count), NaN where it does not close. At other designs they
    follow along the straight way between the numbers, in verified steps: what they are
    depends on no design that was tried in between.
    """

    label: str
    followed: tuple[PathKernel, DesignAt, Floats] | None = None

    def places(self, design: DesignAt, count: int = 1) -> Floats:
        """Return what the kernel has of it (w, count) for a design: signs, or variables.

        Those are of all samples and inputs of figures; NaN where it does not close or
        cannot be followed there.
        """
        if self.followed is None:
            signs = np.array([1.0 if letter == "+" else -1.0 for letter in self.label])
            return np.repeat(signs[:, None], count, axis=1)
        newton, begun, configurations = self.followed
        closes = np.flatnonzero(all_finite(configurations, 0))
        profiles = None
        sizes = begun.sizes[:, None], design.sizes[:, None]
        if begun.profiles is not None:
            profiles = begun.profiles.towards((design.values - begun.values)[:, None])
        start = configurations[:, closes]
        values, arrived = tracked(newton, start, sizes, profiles=profiles, contracts=LONG)
        made = nans(configurations.shape)
        made[:, closes[arrived]] = values[:, arrived]
        return made

    def moved(self, design: DesignAt) -> "HeldMode":
        """Return the mode that is followed from another design from now on."""
        if self.followed is None:
            return self
        return HeldMode(self.label, (self.followed[0], design, self.places(design)))

    def goes_on_in(self, other: "HeldMode") -> bool:
        """Return whether it is another, or becomes it when it is followed to its design.

        At all samples at which both close, and at one at least.
        """
        if other.followed is None:
            return self.label == other.label
        _, design, configurations = other.followed
        values = self.places(design)
        both = all_finite(values, 0) & all_finite(configurations, 0)
        gaps = apart(values[:, both], configurations[:, both])
        return bool(np.any(both) and np.max(gaps) < SAME)


def held_modes(
    evaluator: Evaluator, designs: Floats, labels: Sequence[str]
) -> list[HeldMode | None]:
    """Return the modes with labels (n,) of designs (variables, n), in the file's units.

    None where the configurations of a design are not all possible.
    """
    if not evaluator.follows_modes:
        return [HeldMode(label) for label in labels]
    unique, number = np.unique(designs, axis=1, return_inverse=True)
    by_design = [
        {mode.label: mode for mode in modes} for modes in every_mode(evaluator, unique)
    ]
    return [by_design[k].get(x) for k, x in zip(number, labels, strict=True)]


def every_mode(evaluator: Evaluator, designs: Floats) -> list[list[HeldMode]]:
    """Return all modes of each design (variables, n), which are followed ones."""
    made: list[list[HeldMode]] = [[] for _ in designs.T]
    there = map(evaluator.varied.design_at, designs.T)
    possible = [(k, design) for k, design in enumerate(there) if design is not None]
    if evaluator.varied.is_profiled:
        for k, design in possible:
            assert design.profiles is not None
            with suppress(SpherekitError):
                tracer, _, values = evaluator.traced(design.profiles.mechanism)
                for row, mode in enumerate(tracer.assembly_modes):
                    followed = evaluator.newton, design, values[:, :, row]
                    made[k].append(HeldMode(f"{mode.number} {mode.label}", followed))
    elif possible:
        numbers, values, labels, _ = evaluator.configurations(
            np.stack([design.sizes for _, design in possible], axis=1)
        )
        for row, number in enumerate(numbers):
            k, design = possible[number]
            followed = evaluator.newton, design, values[:, :, row]
            made[k].append(HeldMode(labels[row], followed))
    return made


STEPS = 50
"""Most steps of a descent by quadratic programming."""
SLACK = 1e-9
"""A condition that is missed by less, of its size, holds."""


class FigureGradients:
    """The figures of an evaluator with their derivatives by its variables.

    Of the least and the greatest value it is the derivative at the sample where that is.
    """

    def __init__(self, evaluator: Evaluator) -> None:
        self.evaluator, figures = evaluator, evaluator.figures
        self._kernel = DesignKernel(
            evaluator.varied.terms(), figures.columns, gradients=True
        )
        rows = symbols([*figures.sample, *figures.columns])
        named = {x.arguments[0]: (x, x) for x in rows}
        self._expressions = with_derivatives(
            [convert_to_graph(item, named) for item in figures.expressions], rows
        )

    def at(self, values: Floats, mode: HeldMode) -> tuple[Floats, Floats, float]:
        """Return figures (m,), gradients (m, variables), and the share that closes.

        Values (variables,) are in the file's units, and derivatives by them; figures are in
        rad and SI, NaN where there is no such design, or the mode cannot be followed to it.
        """
        of = self.evaluator.figures
        figures = nans(len(of.merits))
        gradients = nans((len(of.merits), len(values)))
        design = self.evaluator.varied.design_at(values)
        if design is None:
            return figures, gradients, 0.0
        samples = of.rows.T
        places = mode.places(design, len(of.rows))
        closed, made, changes = design.at(
            self._kernel, samples, places, places.T, self._turns(design, places)
        )
        closed &= all_finite(places, 0)
        with np.errstate(all="ignore"):
            every = self._expressions(np.concatenate([samples, made]))
        every = every.reshape(-1, len(of.merits), len(closed))
        for k, merit in enumerate(of.merits):
            rows = of.rows_of(merit)
            value = np.where(closed[rows], every[0, k, rows], np.nan)
            figures[k] = of.reduced(merit, value[:, None])[0]
            share = self._share(merit.reduction, value, figures[k])
            some = np.flatnonzero(share)
            if not merit.reduction.startswith("arg") and len(some):
                rows = rows[some]
                partial = every[1 + len(of.sample) :, k, rows]
                gradients[k] = np.einsum(
                    "cn,vcn,n->v", partial, changes[:, :, rows], share[some]
                )
        return figures, gradients, float(np.mean(closed[: len(of.samples.rows)]))

    def _share(self, kind: str, value: Floats, figure: float) -> Floats:
        """Return the share (n,) of each value in the derivative of a figure."""
        share = np.zeros(len(value))
        closed = np.isfinite(value)
        if not np.any(closed):
            return share
        if kind in ("mean", "sum", "at", "rms"):
            share[closed] = 1.0 if kind == "sum" else 1.0 / np.sum(closed)
            if kind == "rms":
                share[closed] *= value[closed] / max(figure, 1e-300)
            return share
        low, high = (np.atleast_1d(end(value)) for end in (np.nanargmin, np.nanargmax))
        if kind == "swing":
            _, low, high = widest_swings(value[:, None], self.evaluator.samples.returns)
        share[high] += kind != "min"
        share[low] += {"min": 1.0, "max": 0.0}.get(kind, -1.0)
        return share

    def _turns(self, design: DesignAt, places: Floats) -> Floats:
        """Return the turns (pairs, n), rad, at samples and points."""
        kernel = self._kernel
        evaluator = self.evaluator
        if kernel.closed_form:
            prepared = kernel.prepare(design.sizes[:, None])
            return evaluator.turns(kernel, prepared, places[:, 0].tolist())[:, :, 0]
        if not kernel.turning:
            return np.zeros((0, places.shape[1]))
        solver = evaluator.solver_of(evaluator.kernel_mechanism(design.values))
        return evaluator.turns_at(kernel, solver, places[:, :, None])[:, :, 0]


def with_derivatives(
    items: Sequence[Expr], terms: Sequence[ExpressionNode]
) -> ArrayFunction:
    """Return a function of terms: items, then their derivatives term by term."""
    partial = [slope for term in terms for slope in differentiate(items, {term: 1.0})]
    return array_function([*items, *partial], terms)


BEATEN = 1e-6
"""Part of the width of each objective along a front by less than which none is beaten."""
ENOUGH = 0.1 * BEATEN
"""Part of it by less than which a descent goes on no more."""
ROUNDS = 12
"""Most times that a descent is taken up again."""
OTHERS = 3
"""Other starts from which a point is attacked, those that come nearest to beating it."""
BESIDE = 0.1
"""Starts nearer than this part of every range lead to the same place."""


@dataclass(frozen=True)
class LocalOptimum:
    """Where a descent ended: mode, place in units of the ranges, objectives and figures."""

    mode: HeldMode
    x: Floats
    wanted: Floats
    figures: Floats


class Descent:
    """Descents of a synthesis to where objectives no longer fall, in units of the ranges.

    `rows` of a sweep, with objectives `wanted` (n, k), are tried as other starts: at
    `places` (n, variables). Objectives are compared by their `size` (k,).
    """

    def __init__(self, synthesis: Specification, rows: Columns, wanted: Floats) -> None:
        sweep = self.sweep = synthesis.sweep
        assert isinstance(sweep.evaluator, Evaluator)
        self.figures = FigureGradients(sweep.evaluator)
        self.low, high = np.array([(x.low, x.high) for x in sweep.space.variations]).T
        self.width = high - self.low
        varied = np.transpose([rows[variable.name] for variable in sweep.variables])
        self.places = (varied - self.low) / self.width
        self.modes, self.begun = rows["mode"], wanted
        widths = np.ptp(wanted, axis=0)
        several = (widths > 0.0) & (wanted.shape[1] > 1)
        least = np.min(np.abs(wanted), axis=0)
        self.size = np.where(several, widths, np.where(least > 0.0, least, 1.0))
        terms = symbols(sweep.names)
        named = {x.arguments[0]: (x, x) for x in terms}
        if synthesis.matched:
            missed = [named[name][0] for name in synthesis.matched]
            size = np.sqrt(sum(x * x for x in missed) / synthesis.points)
            named[MATCH] = (size, size)
        items = [convert_to_graph(item, named) for item in synthesis.objectives]
        self._wanted = len(items)
        items += [
            convert_to_graph(item.less, named) - convert_to_graph(item.more, named)
            for item in sweep.conditions
            if "closes" not in item.names
        ]
        self._function = with_derivatives(items, terms)
        units = [sweep.units()[merit.name] for merit in sweep.merits]
        self.figure_unit = np.array([DEG if unit == "deg" else 1.0 for unit in units])
        self._last: dict[tuple[bytes, HeldMode], tuple[Parts, float, Floats]] = {}

    @property
    def tolerance(self) -> Floats:
        """By how much of each objective (k,) a design has to be better to beat another."""
        return BEATEN * self.size

    def values(self, x: Floats) -> Floats:
        """Return the numbers (variables,) of a place, in the file's units."""
        return self.low + self.width * x

    def moved(self, x: Floats, mode: HeldMode) -> HeldMode:
        """Return a mode that is followed from x, where there is a design, from now on."""
        design = self.figures.evaluator.varied.design_at(self.values(x))
        return mode if design is None else mode.moved(design)

    def at(self, x: Floats, mode: HeldMode) -> tuple[Parts, float, Floats]:
        """Return objectives and limits, the share that closes, and the figures (k,).

        Limits are by how much conditions are missed, < 0 where they hold.
        """
        key = x.tobytes(), mode
        if key not in self._last:
            values = self.values(x)
            figures, slopes, closes = self.figures.at(values, mode)
            figures = figures / self.figure_unit
            slopes = slopes * self.width / self.figure_unit[:, None]
            by_x = np.nan_to_num(np.concatenate([np.diag(self.width), slopes]))
            with np.errstate(all="ignore"):
                made = self._function(np.concatenate([values, figures])[:, None])
            every = made.reshape(len(by_x) + 1, -1)
            partial = np.where(np.isnan(every[1:]), 0.0, every[1:])
            gradients = partial.T @ by_x
            k = self._wanted
            parts = every[0, :k], gradients[:k], every[0, k:], gradients[k:]
            self._last = {key: (parts, closes, figures)}
        return self._last[key]

    def go(self, x: Floats, mode: HeldMode) -> Floats:
        """Return where a descent of the first objective from x ends.

        The others may not grow (the epsilon-constraint method: Haimes, Lasdon and Wismer
        1971).
        """
        from scipy.optimize import minimize

        (begun, *_), closes, _ = self.at(x, mode)

        def objective(y: Floats) -> tuple[float, Floats]:
            wanted, gradients, *_ = self.at(y, mode)[0]
            if not np.isfinite(wanted[0]):
                return 1e6, np.zeros_like(y)
            return wanted[0], gradients[0]

        def slack(y: Floats) -> Floats:
            (wanted, _, limits, _), closed, _ = self.at(y, mode)
            made = np.concatenate([[closed - closes], -limits, begun[1:] - wanted[1:]])
            return np.nan_to_num(made, nan=-1e6)

        def slopes(y: Floats) -> Floats:
            _, gradients, _, by_limits = self.at(y, mode)[0]
            return np.concatenate([np.zeros((1, len(y))), -by_limits, -gradients[1:]])

        result = minimize(  # type: ignore[call-overload]
            objective,
            x,
            jac=True,
            method="SLSQP",
            bounds=[(0.0, 1.0)] * len(x),
            constraints=[{"type": "ineq", "fun": slack, "jac": slopes}],
            options={"maxiter": STEPS, "ftol": 1e-14},
        )
        ends: Floats = np.clip(result.x, 0.0, 1.0)
        better = objective(ends)[0] <= objective(x)[0]
        holds = np.all(slack(ends) >= -SLACK * (1.0 + np.abs(slack(x))))
        return ends if better and holds else x

    def towards(self, x: Floats, mode: HeldMode, aim: Floats) -> tuple[Floats, float]:
        """Return where objectives come nearest to an aim (k,) from x, and by how much.

        By how many sizes (k,) the objective that misses its aim most does, < 0 where all
        are less: the scalarisation of Pascoletti and Serafini 1984. Where the aim is what
        the objectives are at x, this is a descent of all of them, and ends where nothing
        beside makes all smaller.
        """
        least = self.at(x, mode)[1]

        def parts(y: Floats) -> Parts | None:
            (wanted, gradients, limits, slopes), closes, _ = self.at(y, mode)
            if closes < least:
                return None
            made = (
                (wanted - aim) / self.size,
                gradients / self.size[:, None],
                limits,
                slopes,
            )
            return made if all(map(all_finite, made)) else None

        return least_greatest(parts, x, ENOUGH)

    def down(self, mode: HeldMode, x: Floats) -> LocalOptimum:
        """Return where descents from x end for good, those of one objective and of all."""
        for _ in range(ROUNDS):
            before = self.at(x, mode)[0][0]
            x = self.go(x, mode)
            mode = self.moved(x, mode)
            x, _ = self.towards(x, mode, self.at(x, mode)[0][0])
            mode = self.moved(x, mode)
            if not np.max((before - self.at(x, mode)[0][0]) / self.size) > ENOUGH:
                break
        return self.here(mode, x)

    def here(self, mode: HeldMode, x: Floats) -> LocalOptimum:
        """Return a place as the end of a descent."""
        (wanted, *_), _, figures = self.at(x, mode)
        return LocalOptimum(mode, x, wanted, figures)

    def attacked(self, end: LocalOptimum, ends: Sequence[LocalOptimum]) -> LocalOptimum:
        """Return what is left where a design, also from other starts, beats an end."""
        for _ in range(ROUNDS):
            for start in self._others(end, ends):
                x, missed = self.towards(start, end.mode, end.wanted)
                if missed < -BEATEN:
                    end = self.down(end.mode, x)
                    break
            else:
                break
        return end

    def _others(self, end: LocalOptimum, ends: Sequence[LocalOptimum]) -> Iterator[Floats]:
        """Yield places apart from an end, those that come nearest to beating it first."""
        rows = self.modes == end.mode.label
        others = [other for other in ends if other.mode.goes_on_in(end.mode)]
        places = np.vstack([self.places[rows], *(other.x for other in others)])
        wanted = np.vstack([self.begun[rows], *(other.wanted for other in others)])
        missed = np.max((wanted - end.wanted) / self.size, axis=1)
        taken = [end.x]
        for k in np.argsort(missed, kind="stable"):
            if len(taken) > OTHERS:
                return
            if all(max_abs(places[k] - place) >= BESIDE for place in taken):
                taken.append(places[k])
                yield places[k]


def unbeaten(ends: Sequence[LocalOptimum], tolerance: Floats) -> list[LocalOptimum]:
    """Return the ends that none of their mode beats within a tolerance (k,).

    One beats another that is less in an objective by more than the tolerance, and in
    none greater by more.
    """

    def beats(one: LocalOptimum, other: LocalOptimum) -> bool:
        less = other.wanted - one.wanted
        return bool(np.all(less >= -tolerance) and np.any(less > tolerance))

    return [
        end
        for end in ends
        if not any(other.mode.goes_on_in(end.mode) and beats(other, end) for other in ends)
    ]
