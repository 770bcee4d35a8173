"""A motion and its poles as functions of the input, read from nodes.

Each assembly mode is evaluated at nodes over the range of the samples. What analyses read
of motions and fields are then functions of the input's variable, columns of one table,
which are read anywhere: along straight lines, from cubics with the exact slopes at the
nodes, or from series that converge faster than any power of the nodes' number.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.analysis.needs import Needs
from spherekit.analysis.running.setting import Setting
from spherekit.conventions import Status
from spherekit.errors import AnalysisError
from spherekit.model.mechanism import Mechanism
from spherekit.motion.motion import Motion, Tracer
from spherekit.numeric.chebyshev import DEGREE, PiecewiseChebyshev, through
from spherekit.numeric.chebyshev import nodes as nodes_of
from spherekit.numeric.periodic import Periodic
from spherekit.numeric.turns import wrap
from spherekit.planning.poles import Pole
from spherekit.rates.core import driven_rates
from spherekit.rates.field import evaluate
from spherekit.rates.pole_field import PoleField
from spherekit.rates.request import Request
from spherekit.sphere.rotation import Floats, cross

FEWEST_NODES = 4

RETURNED = 1e-9
"""Functions whose values at both ends of a turn differ by less are periodic."""

Key = tuple[str, Pole | int | None]


@final
@dataclass(frozen=True)
class _Columns:
    """Functions at the nodes of one mode: values and exact slopes (nodes, columns).

    `places` says which columns a quantity has. Slopes are NaN where none are known; then
    the column is the derivative of those in `parents`, or is read along straight lines.
    """

    places: dict[Key, slice]
    values: Floats
    slopes: Floats
    parents: dict[Key, Key]


@final
class InterpolatedMotion:
    """The motion of a mechanism with one input, read from nodes.

    Parameters
    ----------
    tracer
        Its assembly modes must close over the whole range.
    wanted
        What is wanted of the poles.
    needs
        What analyses read; rotations of other links than these are left out.
    all_links
        Whether the rotations of all links are wanted, for scenes.
    q
        The samples' inputs (k,) rad, whose range is covered.
    setting
        How values are read, from how many nodes for each assembly mode, and how these are
        made.

    Raises
    ------
    AnalysisError
        If there are several inputs, an assembly mode does not close everywhere in the
        range, a pole is not known there, or the nodes are too few.
    """

    def __init__(
        self,
        tracer: Tracer,
        wanted: Request,
        needs: Needs,
        all_links: bool,
        q: Floats,
        setting: Setting,
    ) -> None:
        self._tracer, self._wanted, self._setting = tracer, wanted, setting
        mechanism = tracer.mechanism
        _check(mechanism, tracer, setting)
        low, high = float(np.min(q)), float(np.max(q))
        if not high > low:
            raise AnalysisError(f"{mechanism.name}: all samples have the same input")
        ends = {link for name in needs.pair_rates for link in mechanism.pair(name).links}
        number = mechanism.link_number
        turned = set(mechanism.links) if all_links else needs.rotations | ends
        self._rotations = sorted(number[link] for link in turned)
        spun = {link for pole in needs.turns for link in pole}
        self._rates = sorted({number[link] for link in needs.link_rates | ends} | spun)
        nodes = setting.nodes
        places = np.linspace(low, high, nodes + (setting.representation == "spectral"))
        tables = self._tables(places)
        if setting.representation == "linear":
            reads = [_straight(low, high, t, False) for t in tables]
        elif setting.representation == "cubic":
            reads = [_straight(low, high, t, True) for t in tables]
        elif high - low > 2.0 * np.pi - RETURNED and all(map(_returns, tables)):
            reads = [_fourier(low, high, t) for t in tables]
        else:
            cells = max(1, nodes // (DEGREE + 1))
            starts = low + (high - low) * np.arange(cells)[:, None] / cells
            places = starts + 0.5 * (high - low) / cells * (1.0 + nodes_of(DEGREE))
            tables = self._tables(places.ravel())
            reads = [_chebyshev(low, high, t, cells) for t in tables]
        self._places = tables[0].places
        self._reads = reads

    def _tables(self, places: Floats) -> list[_Columns]:
        """Return the functions of each assembly mode at some inputs in rising order."""
        motion = self._tracer.at(places)
        field = evaluate(motion, self._wanted, route=self._setting.route)
        name = motion.mechanism.name
        bad = np.flatnonzero(field.status != Status.OK)
        if len(bad):
            row = bad[0]
            raise AnalysisError(
                f"{name}: functions of the input need assembly modes that close over "
                f"the whole "
                f"range; assembly mode {motion.assembly_mode[row]} is "
                f"{Status(field.status[row]).name} at {motion.q[row]:.6g} rad"
            )
        everywhere = np.ones(len(motion), dtype=bool)
        exact = driven_rates(motion, everywhere, self._wanted.plan.input)
        first, second = (
            exact.w[:, [pair[k] for pair in motion.mechanism.ends]] for k in (0, 1)
        )
        axes = motion.linearisation.pair_rates(first, second).axes
        k = motion.samples
        return [
            self._columns(motion, field, exact.w, exact.dw, axes, slice(n * k, (n + 1) * k))
            for n in range(len(motion.assembly_modes))
        ]

    def _columns(
        self,
        motion: Motion,
        field: PoleField,
        w: Floats,
        dw: Floats,
        turned: Floats,
        rows: slice,
    ) -> _Columns:
        columns: dict[Key, tuple[Floats, Floats | None]] = {}
        parents: dict[Key, Key] = {}
        mechanism = motion.mechanism
        values = motion.values[rows].copy()
        angles = self._tracer.solver.angles
        values[:, angles] = np.unwrap(values[:, angles], axis=0)
        columns["values", None] = values, _variable_rates(motion, w)[rows]
        for link in self._rotations:
            turn = motion.rotations[rows, link]
            spin = cross(w[rows, link, None], np.swapaxes(turn, 1, 2))
            slope = np.swapaxes(spin, 1, 2).reshape(-1, 9)
            columns["rotation", link] = turn.reshape(-1, 9), slope
        for link in self._rates:
            columns["w", link] = w[rows, link], dw[rows, link]
            columns["dw", link] = dw[rows, link], None
            parents["dw", link] = ("w", link)
        pairs = mechanism.pole_pairs
        for pole in self._wanted.poles:
            u = field.direction[pole][rows]
            finite = np.all(np.isfinite(u), axis=1)
            if not np.any(finite):
                continue
            i, j = pole
            if pole in pairs:
                slope = turned[rows, pairs[pole]]
            else:
                v, dv = w[rows, j] - w[rows, i], dw[rows, j] - dw[rows, i]
                size = np.sum(u * v, axis=1, keepdims=True)
                with np.errstate(divide="ignore", invalid="ignore"):
                    slope = (dv - u * np.sum(u * dv, axis=1, keepdims=True)) / size
            if not np.all(finite) or not np.all(np.isfinite(slope)):
                names = mechanism.links
                raise AnalysisError(
                    f"{mechanism.name}: the axis of links {names[j]} and {names[i]} is not "
                    f"known, or rests, at one of the nodes; take another number of them"
                )
            columns["direction", pole] = u, slope
            rate, change = (
                field.velocity_coefficient[pole][rows],
                field.acceleration_coefficient[pole][rows],
            )
            if np.all(np.isfinite(rate)):
                along = np.sum((dw[rows, j] - dw[rows, i]) * u, axis=1)
                columns["velocity_coefficient", pole] = rate[:, None], along[:, None]
            if np.all(np.isfinite(change)):
                columns["acceleration_coefficient", pole] = change[:, None], None
                parents["acceleration_coefficient", pole] = ("velocity_coefficient", pole)
        places: dict[Key, slice] = {}
        at = 0
        for key, (column, _) in columns.items():
            places[key] = slice(at, at + column.shape[1])
            at += column.shape[1]
        slopes = [np.full_like(a, np.nan) if b is None else b for a, b in columns.values()]
        table = np.concatenate([part for part, _ in columns.values()], axis=1)
        return _Columns(places, table, np.concatenate(slopes, axis=1), parents)

    def motion(self, q: Floats, first_sample: int) -> Motion:
        """Return all assembly modes at inputs q (k,) rad within the range."""
        tracer, k, count = self._tracer, len(q), len(self._reads)
        parts = [read(q) for read in self._reads]
        values = np.concatenate([part[:, self._places["values", None]] for part in parts])
        angles = tracer.solver.angles
        values[:, angles] = wrap(values[:, angles])
        rotations = np.full((k * count, len(tracer.mechanism.links), 3, 3), np.nan)
        for link in self._rotations:
            place = self._places["rotation", link]
            columns = np.concatenate([part[:, place] for part in parts])
            rotations[:, link] = columns.reshape(-1, 3, 3)
        return tracer.in_rows(q[:, None], first_sample, values, rotations)

    def field(self, motion: Motion) -> PoleField:
        """Return the poles and coefficients at the rows of such a motion.

        `angle`, `planes` and the bounds of errors are NaN: they belong to poles that
        are constructed.
        """
        n, k = len(motion), motion.samples
        parts = [read(motion.q[:k]) for read in self._reads]
        nothing = np.full((n, 1), np.nan)

        def of(what: str, which: Pole | int, width: int) -> Floats:
            place = self._places.get((what, which))
            if place is None:
                return np.repeat(nothing, width, axis=1)
            return np.concatenate([part[:, place] for part in parts])

        poles = self._wanted.poles
        bare = dict.fromkeys(poles, nothing[:, 0])
        status = np.full(n, Status.OK, dtype=np.int8)
        resting = np.full(n, Status.NO_POLE, dtype=np.int8)
        still = {pole for pole in poles if ("direction", pole) not in self._places}
        rate = {pole: of("velocity_coefficient", pole, 1)[:, 0] for pole in poles}
        change = {pole: of("acceleration_coefficient", pole, 1)[:, 0] for pole in poles}
        for pole in still:
            rate[pole], change[pole] = np.zeros(n), np.zeros(n)
        return PoleField(
            direction={pole: of("direction", pole, 3) for pole in poles},
            velocity_coefficient=rate,
            acceleration_coefficient=change,
            angle=bare,
            error=bare,
            velocity_coefficient_error=bare,
            acceleration_coefficient_error=bare,
            planes={pole: np.full((n, 2, 3), np.nan) for pole in self._wanted.planes},
            w={link: of("w", link, 3) for link in self._rates},
            dw={link: of("dw", link, 3) for link in self._rates},
            status=status,
            pole_status={pole: resting if pole in still else status for pole in poles},
            by_equations=np.zeros(n, dtype=bool),
            by_kernel=np.zeros(n, dtype=bool),
            loss=np.zeros(n),
        )


def _check(mechanism: Mechanism, tracer: Tracer, setting: Setting) -> None:
    if len(tracer.inputs) != 1:
        raise AnalysisError(
            f"{mechanism.name}: functions are read from nodes of one input, and there are "
            f"{len(tracer.inputs)}"
        )
    if setting.nodes < FEWEST_NODES:
        raise AnalysisError(
            f"{mechanism.name}: {setting.nodes} nodes are too few; give at least "
            f"{FEWEST_NODES}"
        )


def _variable_rates(motion: Motion, w: Floats) -> Floats:
    """Return the rates (n, variables) of all pair variables, given those of the links."""
    rates = np.empty_like(motion.values)
    for number, ends in enumerate(motion.mechanism.ends):
        variables = list(motion.mechanism.variables_of(number))
        relative = w[:, ends[1]] - w[:, ends[0]]
        vectors = np.swapaxes(motion.vectors[:, variables], 1, 2)
        rates[:, variables] = (np.linalg.pinv(vectors) @ relative[:, :, None])[..., 0]
    return rates


def _returns(table: _Columns) -> bool:
    """Whether all functions but the growing variables are the same at both ends."""
    apart = table.values[-1] - table.values[0]
    angles = table.places["values", None]
    apart[angles] = wrap(apart[angles])
    return bool(np.max(np.abs(apart)) < RETURNED)


def _straight(
    low: float, high: float, table: _Columns, cubic: bool
) -> Callable[[Floats], Floats]:
    """Return the reader of equally spaced nodes, by lines or by Hermite cubics."""
    from scipy.interpolate import CubicHermiteSpline, make_interp_spline

    values, slopes = table.values, table.slopes
    nodes = np.linspace(low, high, len(values))
    if not cubic:
        lines = make_interp_spline(nodes, values, k=1)
        return lambda q: np.asarray(lines(q))
    parent = np.arange(values.shape[1])
    derived = np.zeros(values.shape[1], dtype=bool)
    for key, source in table.parents.items():
        parent[table.places[key]] = np.arange(values.shape[1])[table.places[source]]
        derived[table.places[key]] = True
    spline = CubicHermiteSpline(nodes, values[:, ~derived], slopes[:, ~derived])
    rows = parent[derived]
    rates = CubicHermiteSpline(nodes, values[:, rows], slopes[:, rows]).derivative()

    def read(q: Floats) -> Floats:
        numbers = np.empty((len(q), values.shape[1]))
        numbers[:, ~derived], numbers[:, derived] = spline(q), rates(q)
        return numbers

    return read


def _fourier(low: float, high: float, table: _Columns) -> Callable[[Floats], Floats]:
    """Return the reader of equally spaced nodes of a whole period, the last at its end."""
    values = table.values[:-1]
    count = len(values)
    rise = np.zeros(values.shape[1])
    place = table.places["values", None]
    rise[place] = (
        np.round((table.values[-1] - values[0])[place] / (2.0 * np.pi)) * 2.0 * np.pi
    )
    series = np.fft.rfft(values - np.outer(np.arange(count) / count, rise), axis=0) / count
    periodic = Periodic(high - low, rise, series, count, np.nan)
    return lambda q: periodic.at(q - low)


def _chebyshev(
    low: float, high: float, table: _Columns, cells: int
) -> Callable[[Floats], Floats]:
    """Return the reader of Chebyshev nodes, in rising order on equal cells."""
    series = through(table.values.reshape(cells, DEGREE + 1, -1))
    return PiecewiseChebyshev(np.linspace(low, high, cells + 1), series).at
