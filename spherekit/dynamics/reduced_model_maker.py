"""Making a mechanism's stored functions: what depends on the configuration alone.

Of one input these are B, the loads' geometry, the pair variables, and pole axes with their
coefficients, as Chebyshev series of one coordinate of the whole configuration curve
(Di Gregorio 2024, section 4); of several inputs tensor Chebyshev series over the box of
their ranges.

The direct problem of a stored curve: its motion under its loads, in two scalars.

The state is the coordinate x of the model, q or s, the momentum p = sqrt(B) x' and the
work W of all loads. As in `spherekit.dynamics.equation_of_motion`, which holds in any
coordinate,

    dx/dt = p / sqrt(B),   dp/dt = Q / sqrt(B),   dW/dt = Q dx/dt.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from math import sqrt

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats
from spherekit.dynamics.reduced_model import StoredModel
from spherekit.dynamics.reduced_model_archive import StoredFunction
from spherekit.dynamics.reduced_model_samples import AlongCurve, OverBox
from spherekit.errors import SolveError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.geometry.rotation import all_finite, max_abs, nans
from spherekit.mechanism.friction import need_no_rubbing
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.chebyshev import ROUNDING, PiecewiseChebyshev
from spherekit.numerics.tensor_chebyshev import TensorChebyshev
from spherekit.planning.pole_plan import all_poles, parse_pole
from spherekit.positions.motion import PositionAnalysis
from spherekit.progress import ProgressReporter

FIRST_CELLS = 16
"""Cells of every stored function at first; fewer could miss a narrow feature."""

SIZED = 1024
"""Places at which the largest value of every function of a curve is looked for."""

LEAST = 0.03
"""A function counts as no smaller than this part of the largest of its kind."""

SAMPLES = 33
"""Samples of each of two inputs between which the mode is found; fewer of more inputs."""

MOST_SAMPLES = 1200

MEASURED = 4000
"""Random places at which errors are measured."""


@checked(SolveError)
def reduced_model(
    mechanism: AnyMechanism,
    *,
    input_pair: str | None = None,
    assembly_mode: int = 0,
    poles: Iterable[str] | None = None,
    tolerance: float = 1e-13,
) -> StoredModel:
    """Return the stored functions of one assembly mode of a single-DOF mechanism.

    Parameters
    ----------
    mechanism
        Its masses and loads are stored where it has some; its joint limits end the curve.
    input_pair, assembly mode
        The driven R pair, by default the first input, and the assembly mode.
    poles
        The poles wanted, as ``"3/1"``; all by default.
    tolerance
        Error to reach, relative to the largest value of each function.

    Raises
    ------
    PlanError, SolveError
        If the mechanism has more freedoms than one, there is no such assembly mode or pole,
        a pole axis has no direction somewhere on the curve, or the tolerance is none.
    """
    mechanism = _storable(mechanism, tolerance, 1e-15)
    tracer = PositionAnalysis(mechanism, input_pair, assembly_mode)
    wanted = all_poles(len(mechanism.links))
    if poles is not None:
        wanted = tuple(dict.fromkeys(parse_pole(mechanism, text) for text in poles))
    sampler = AlongCurve(tracer, wanted)
    heading = sampler.heading(assembly_mode)
    every = [sampler.names(heading)]
    for pole in heading.poles:
        units = dict.fromkeys([f"pole {pole} {axis}" for axis in "xyz"], "")
        rate = f"rate {pole}"
        every.append(units | {rate: "", heading.derivative(rate): "1/rad"})
    x = np.linspace(0.0, heading.high[0], SIZED, endpoint=not sampler.periodic)
    size = _sizes([*chain(*every)], sampler.columns(range(len(every)), x))
    fitted, groups, at = [], [], 0
    working = ProgressReporter("fitting functions")
    for k, units in enumerate(every):
        working.tell(f"{at} of {len(size)}".__str__)
        sizes = size[at : at + len(units)]
        at += len(units)
        series, error = _fitted(sampler, k, tolerance, sizes)
        fitted.append(series)
        groups.append(_stored(units, sizes, error))
    return StoredModel(replace(heading, groups=tuple(groups)), tuple(fitted))


def _fitted(
    sampler: AlongCurve, group: int, tolerance: float, sizes: Floats
) -> tuple[PiecewiseChebyshev, Floats]:
    """Return the series of a group of functions, and the error measured of each."""
    function, high = partial(sampler.columns, [group]), float(sampler.high[0])
    series = PiecewiseChebyshev.fit(
        function, 0.0, high, tolerance, sizes, FIRST_CELLS, rounding=ROUNDING
    )
    # Cells are parted unevenly, at other places than those sampled or checked.
    parts = np.arange(1, 4)[:, None] * (0.5 * (np.sqrt(5.0) - 1.0)) % 1.0
    x = np.sort((series.edges[:-1] + parts * np.diff(series.edges)).ravel())
    return series, max_abs(series.at(x) - function(x), axis=0)


@checked(SolveError)
def reduced_grid_model(
    mechanism: AnyMechanism,
    *,
    assembly_mode: int = 0,
    poles: Iterable[str] = (),
    tolerance: float = 1e-11,
) -> StoredModel:
    """Return the stored functions of one assembly mode of a mechanism of several inputs.

    Parameters
    ----------
    mechanism
        Its masses and loads are stored where it has some; the ranges of its inputs bound
        the domain.
    assembly_mode
        Its number, as of runs over a grid of the inputs.
    poles
        Pairs of links whose relative angular velocities are wanted too, as ``"3/1"``.
    tolerance
        Error to reach, relative to the largest value of each function.

    Raises
    ------
    PlanError, SolveError
        If the mechanism has not a freedom for each input, there is no such assembly mode or
        pole, the tolerance is none, or no part of the ranges is resolved.
    """
    mechanism = _storable(mechanism, tolerance, 1e-13)
    count = min(SAMPLES, int(MOST_SAMPLES ** (1.0 / max(len(mechanism.inputs), 1))))
    tracer = PositionAnalysis(mechanism, None, assembly_mode, samples=count, grid=True)
    sampler = OverBox(tracer, tuple(parse_pole(mechanism, text) for text in poles))
    heading = sampler.heading(assembly_mode)
    names = sampler.names(heading)
    for pole in heading.poles:
        for axis in "xyz":
            names |= dict.fromkeys(heading.by_coordinates(f"velocity {pole} {axis}"), "")
    size = _sizes(list(names), sampler.columns(sampler.nodes))
    working = ProgressReporter("fitting functions")

    def function(q: Floats) -> Floats:
        working.tell(f"{len(q)} places".__str__)
        return sampler.at(q, len(names))

    series = TensorChebyshev.fit(function, sampler.low, sampler.high, tolerance, size)
    if not len(series.bounds):
        raise SolveError(
            f"{mechanism.name}: assembly mode {assembly_mode} is nowhere smooth enough "
            "over the ranges of the inputs to be stored; narrow them, or give a larger "
            "tolerance"
        )
    groups = (_stored(names, size, _measured(series, function)),)
    return StoredModel(replace(heading, covered=series.covered, groups=groups), (series,))


def _measured(series: TensorChebyshev, function: Callable[[Floats], Floats]) -> Floats:
    """Return the largest error of each function at random places of the domain."""
    random = np.random.default_rng(1).random((MEASURED, len(series.low)))
    q = series.low + (series.high - series.low) * random
    q = q[series.cells(q) >= 0]
    gap = np.abs(series.at(q) - function(q))
    return np.max(gap[all_finite(gap, 1)], axis=0, initial=0.0)


def _storable(mechanism: AnyMechanism, tolerance: float, least: float) -> Mechanism:
    """Return the mechanism; errors of what no model stores, and of tolerances."""
    made = mechanism_of(mechanism)
    if not least <= tolerance <= 1e-2:
        raise SolveError(
            f"{made.name}: tolerance is {tolerance:g}, allowed is {least:g} to 1e-2"
        )
    need_no_rubbing(made, "a stored model has not")
    return made


def _stored(
    names: Mapping[str, str], sizes: Floats, error: Floats
) -> tuple[StoredFunction, ...]:
    columns = names, names.values(), sizes.tolist(), (error / sizes).tolist()
    return tuple(StoredFunction(*parts) for parts in zip(*columns, strict=True))


def _sizes(names: list[str], values: Floats) -> Floats:
    """Return the largest value (F,) of each function, of vectors that of all parts.

    A function counts as no smaller than `LEAST` of the largest of its kind, since those
    that vanish, but for rounding, have no size of their own: of a constant inertia these
    are the Christoffel symbols, next to it.
    """

    def largest(kinds: Sequence[str], sizes: Floats) -> Floats:
        _, places = np.unique(kinds, return_inverse=True)
        most = np.zeros(len(sizes))
        np.maximum.at(most, places, sizes)
        return most[places]

    vectors = [name[:-2] if name[-2:] in (" x", " y", " z") else name for name in names]
    kinds = [name.split()[0].partition("_")[0] for name in names]
    size = largest(vectors, max_abs(values, axis=0))
    most, named = largest(kinds, size), np.array(kinds)
    most[named == "c"] = np.max(size[(named == "M") | (named == "c")], initial=0.0)
    size = np.maximum(size, LEAST * most)
    for k, name in enumerate(names):
        if name.startswith("d("):
            size[k] = max(size[k], LEAST * size[names.index(name[2 : name.index(")")])])
    return np.where(size == 0.0, 1.0, size)


MARGIN = 0.03
"""The integrator's own tolerance per step, as part of the error tolerated in the end."""


@dataclass(frozen=True)
class TabulatedMotion:
    """The motion at times `t` (n,), s; NaN after the curve has ended.

    `x` (n,) coordinate of the model; `values`, `value_rates` (n, variables); `q`, `dq` of
    the input, rad and rad/s; `kinetic`, `work` (n,) J; `message` says why it ended;
    `evaluations` counts calls of the right-hand side.
    """

    t: Floats
    x: Floats
    values: Floats
    value_rates: Floats
    q: Floats
    dq: Floats
    kinetic: Floats
    work: Floats
    message: str
    evaluations: int

    @property
    def energy(self) -> float:
        """Largest difference of kinetic energy gained and work of the loads, J."""
        return float(np.nanmax(np.abs(self.kinetic - self.kinetic[0] - self.work)))


@checked(SolveError)
def simulate_reduced(
    model: StoredModel,
    times: Sequence[float] | Floats,
    x: float,
    dx: float,
    tolerance: float = 1e-9,
    switches: Iterable[float] = (),
) -> TabulatedMotion:
    """Return the motion of a stored model at times (n,), by SciPy's LSODA.

    Parameters
    ----------
    model
        One with masses; a driving torque is given by `StoredModel.with_torque`.
    times
        Increasing times (s), the first that of the start.
    x, dx
        Coordinate of the model and its rate at the start.
    tolerance
        Error aimed at in x (rad).
    switches
        Times (s) at which expressions have kinks; knots of torque tables are known.

    Raises
    ------
    SolveError
        If times do not increase, the model has no inertia or not this coordinate, or the
        integrator gives up.
    """
    heading, name = model.heading, model.heading.mechanism
    if not heading.alone:
        raise SolveError(f"{name}: the model is of several inputs; a motion is of a curve")
    t = np.atleast_1d(np.asarray(times, dtype=float))
    if len(t) < 2 or not (all_finite(t) and np.all(np.diff(t) > 0.0)):
        raise SolveError(f"{name}: give two or more finite, increasing times")
    (at, _), (low,), (high,) = model.dynamics, heading.low, heading.high
    inertia = at(x)[0]
    if not inertia > 0.0:
        raise SolveError(f"{name}: has no inertia, so loads would accelerate it endlessly")

    def right(time: float, state: Floats) -> tuple[float, float, float]:
        place, p, _ = state.tolist()
        within = place if heading.periodic else min(max(place, low), high)
        row = at(within)
        root = 1.0 / sqrt(row[0])
        speed = p * root
        push = 0.5 * row[1] * speed * speed - model.torque_at(row, within, speed, 0.0, time)
        return speed, push * root, push * speed

    tighter = max(MARGIN * tolerance, 1e-14)
    start, stop = float(t[0]), float(t[-1])
    tables = [table.knots(start, stop) for table in heading.tables]
    critical = sorted(k for k in {*chain(switches, *tables)} if start < k < stop)
    from scipy.integrate import odeint

    states, notes = odeint(
        right,
        [x, sqrt(inertia) * dx, 0.0],
        t,
        tfirst=True,
        rtol=tighter,
        atol=tighter,
        mxstep=100_000,
        tcrit=critical or None,
        full_output=True,
    )
    if notes["message"] != "Integration successful.":
        raise SolveError(f"{name}: {notes['message']}")
    return _motion(model, t, states, int(notes["nfe"][-1]))


def _motion(
    model: StoredModel, t: Floats, states: Floats, evaluations: int
) -> TabulatedMotion:
    """Return the motion of states (n, 3): the coordinate, momentum and work."""
    heading = model.heading
    message, reached = "", states[:, 0]
    if not heading.periodic:
        beyond = np.flatnonzero((reached < heading.low[0]) | (reached > heading.high[0]))
        if len(beyond):
            message = f"the curve ends before t = {t[beyond[0]]:.6g} s"
            states[beyond[0] :] = np.nan
    places, p, work = states.T
    finite = np.isfinite(places)
    values, rates = nans((2, len(t), len(heading.variables)))
    speeds = p[finite] / np.sqrt(model.inertia(places[finite]))
    slopes = [heading.derivative(name) for name in heading.variables]
    values[finite] = model.functions(heading.variables, places[finite])
    rates[finite] = model.functions(slopes, places[finite]) * speeds[:, None]
    driven = heading.variables.index(f"theta_{heading.inputs[0]}")
    return TabulatedMotion(
        t,
        places,
        values,
        rates,
        values[:, driven],
        rates[:, driven],
        0.5 * p**2,
        work,
        message,
        evaluations,
    )
