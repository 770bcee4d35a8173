"""Making a mechanism's stored functions: what depends on the configuration alone.

Of one input these are B, the loads' geometry, the pair variables, and pole axes with their
coefficients, as Chebyshev series of one coordinate of the whole configuration curve
(Di Gregorio 2024, section 4); of several inputs tensor Chebyshev series over the box of
their ranges.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from spherekit.checked import checked
from spherekit.dynamics.forces import Loads
from spherekit.dynamics.inertia import AlongCurve, OverBox, own_velocities, pole_name
from spherekit.dynamics.stored_model import (
    GridMetadata,
    ModelMetadata,
    StoredFunction,
    StoredLoad,
)
from spherekit.dynamics.tabulated import GridModel, TabulatedModel
from spherekit.errors import SolveError
from spherekit.files.read import AnyMechanism, mechanism_of
from spherekit.files.write import mechanism_hash
from spherekit.model.dynamics import need_no_rubbing
from spherekit.model.expression import Expression
from spherekit.model.load import TorqueTable
from spherekit.model.mechanism import Mechanism
from spherekit.motion.motion import Tracer
from spherekit.numeric.cells import TensorChebyshev
from spherekit.numeric.chebyshev import ROUNDING, PiecewiseChebyshev
from spherekit.planning.poles import Pole, all_poles, parse_pole
from spherekit.progress import Working
from spherekit.sphere.rotation import Floats
from spherekit.version import __version__

MARKS = 1024
"""Places along the curve at which the sizes of functions are judged."""

FIRST_CELLS = 16
"""Cells of every stored function at first; fewer could miss a narrow feature."""

LEAST = 0.03
"""A function counts as no smaller than this part of the largest of its kind."""

SAMPLES = 33
"""Samples of each of two inputs between which the mode is found; fewer of more inputs."""

MOST_SAMPLES = 1200

MEASURED = 4000
"""Random places at which errors are measured."""


@checked(SolveError)
def online_model(
    mechanism: AnyMechanism,
    *,
    input_pair: str | None = None,
    assembly_mode: int = 0,
    poles: Iterable[str] | None = None,
    tolerance: float = 1e-13,
) -> TabulatedModel:
    """Return the stored functions of one assembly mode of a single-DOF mechanism.

    Parameters
    ----------
    mechanism
        Its masses and loads are stored where it has some; its stops end the curve.
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
    tracer = Tracer(mechanism, input_pair, assembly_mode)
    made = tracer.mechanism
    if poles is None:
        wanted = all_poles(len(made.links))
    else:
        wanted = tuple(dict.fromkeys(parse_pole(made, text) for text in poles))
    sampler = AlongCurve(tracer, wanted)
    heading = ModelMetadata(
        **_heading(made, assembly_mode, wanted, sampler),
        input=tracer.inputs[0],
        coordinate=sampler.coordinate,
        periodic=sampler.periodic,
        low=sampler.low,
        high=sampler.high,
        rise=tuple(sampler.rise.tolist()),
        groups=(),
    )
    every = [sampler.names(heading), *map(partial(_pole_names, heading), heading.poles)]
    names = {name: unit for group in every for name, unit in group.items()}
    size = _sizes(list(names), sampler.columns(range(len(every)), sampler.spread(MARKS)))
    fitted, groups, at = [], [], 0
    working = Working("fitting functions")
    for k, units in enumerate(every):
        working.tell(f"{at} of {len(size)}".__str__)
        sizes = size[at : at + len(units)]
        at += len(units)
        series, error = _fitted(sampler, k, tolerance, sizes)
        fitted.append(series)
        groups.append(_stored(units, sizes, error))
    return TabulatedModel(replace(heading, groups=tuple(groups)), tuple(fitted))


def _fitted(
    sampler: AlongCurve, group: int, tolerance: float, sizes: Floats
) -> tuple[PiecewiseChebyshev, Floats]:
    """Return the series of a group of functions, and the error measured of each."""
    function, ends = partial(sampler.columns, [group]), (sampler.low, sampler.high)
    series = PiecewiseChebyshev.fit(
        function, *ends, tolerance, sizes, FIRST_CELLS, rounding=ROUNDING
    )
    # Cells are parted unevenly, at other places than those sampled or checked.
    part = 0.5 * (np.sqrt(5.0) - 1.0)
    steps = [times * part % 1.0 * np.diff(series.edges) for times in (1, 2, 3)]
    x = np.sort(np.concatenate([series.edges[:-1] + step for step in steps]))
    return series, np.max(np.abs(series.at(x) - function(x)), axis=0)


@checked(SolveError)
def grid_model(
    mechanism: AnyMechanism,
    *,
    assembly_mode: int = 0,
    poles: Iterable[str] = (),
    tolerance: float = 1e-11,
) -> GridModel:
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
    inputs = len(mechanism.inputs)
    count = min(SAMPLES, int(MOST_SAMPLES ** (1.0 / max(inputs, 1))))
    tracer = Tracer(mechanism, None, assembly_mode, samples=count, grid=True)
    wanted = tuple(parse_pole(mechanism, text) for text in poles)
    sampler = OverBox(tracer, wanted)
    heading = GridMetadata(
        **_heading(tracer.mechanism, assembly_mode, wanted, sampler),
        inputs=tracer.inputs,
        low=tuple(sampler.low.tolist()),
        high=tuple(sampler.high.tolist()),
        covered=0.0,
        functions=(),
    )
    names = sampler.names(heading)
    for pole in heading.poles:
        for axis in "xyz":
            by = heading.by_coordinates(f"velocity {pole} {axis}")
            names |= dict.fromkeys(by, "")
    size = _sizes(list(names), sampler.columns(sampler.known))
    working = Working("fitting functions")

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
    error = _measured(series, function)
    functions = _stored(names, size, error)
    return GridModel(replace(heading, covered=series.covered, functions=functions), series)


def _measured(series: TensorChebyshev, function: Callable[[Floats], Floats]) -> Floats:
    """Return the largest error of each function at random places of the domain."""
    random = np.random.default_rng(1).random((MEASURED, len(series.low)))
    q = series.low + (series.high - series.low) * random
    q = q[series.cells(q) >= 0]
    gap = np.abs(series.at(q) - function(q))
    return np.asarray(np.max(gap[np.all(np.isfinite(gap), axis=1)], axis=0, initial=0.0))


def _storable(mechanism: AnyMechanism, tolerance: float, least: float) -> Mechanism:
    """Return the mechanism; errors of what no model stores, and of tolerances."""
    made = mechanism_of(mechanism)
    if not least <= tolerance <= 1e-2:
        raise SolveError(
            f"{made.name}: tolerance is {tolerance:g}, allowed is {least:g} to 1e-2"
        )
    need_no_rubbing(made, "a stored model has not")
    return made


def _heading(
    mechanism: Mechanism,
    assembly_mode: int,
    poles: Iterable[Pole],
    sampler: AlongCurve | OverBox,
) -> dict[str, Any]:
    """Return what headings of all models say."""
    return {
        "mechanism": mechanism.name,
        "mechanism_sha256": mechanism_hash(mechanism),
        "made_by": __version__,
        "assembly_mode": assembly_mode,
        "variables": mechanism.variable_names,
        "angles": tuple(mechanism.angles),
        "poles": tuple(pole_name(mechanism, pole) for pole in poles),
        "loads": _stored_loads(sampler.loads, sampler.rate),
    }


def _stored(
    names: Mapping[str, str], sizes: Floats, error: Floats
) -> tuple[StoredFunction, ...]:
    parts = zip(names.items(), sizes.tolist(), (error / sizes).tolist(), strict=True)
    return tuple(StoredFunction(name, unit, most, off) for (name, unit), most, off in parts)


def _stored_loads(loads: Loads, rate: Callable[[str], str]) -> tuple[StoredLoad, ...]:
    """Return what magnitudes of loads depend on besides the configuration.

    `rate` names what they work on of a pair's variable, by the variable's name.
    """
    velocities, stored = own_velocities(loads), []
    for number, load in enumerate(loads.mechanism.loads):
        parts = [
            (k, x) for k, x in enumerate(loads.components) if loads.owners[k] == number
        ]
        works_on = tuple(velocities.get(k, rate(f"theta_{part.pair}")) for k, part in parts)
        if isinstance(load, TorqueTable):
            table = load.times, load.torques, load.periodic
            stored.append(StoredLoad(load.name, works_on, (), *table))
            continue
        laws = [part.magnitude for _, part in parts]
        texts = tuple(law.text for law in laws if isinstance(law, Expression))
        stored.append(StoredLoad(load.name, works_on, texts))
    return tuple(stored)


def _pole_names(heading: ModelMetadata, pole: str) -> dict[str, str]:
    """Return the names of a pole's functions along a curve, with their units."""
    axis = {f"pole {pole} {axis}": "" for axis in "xyz"}
    return axis | {f"rate {pole}": "", heading.derivative(f"rate {pole}"): "1/rad"}


def _sizes(names: list[str], values: Floats) -> Floats:
    """Return the largest value (F,) of each function, of vectors that of all parts.

    A function counts as no smaller than `LEAST` of the largest of its kind, since those
    that vanish, but for rounding, have no size of their own: of a constant inertia these
    are the Christoffel symbols, next to it.
    """
    size = np.max(np.abs(values), axis=0, initial=0.0)
    vectors = [name[:-2] if name[-2:] in (" x", " y", " z") else name for name in names]
    kinds = [name.split()[0].partition("_")[0] for name in names]
    for stem in {*vectors}:
        alike = [vector == stem for vector in vectors]
        size[alike] = np.max(size[alike])
    masses = np.max(size[[kind == "M" for kind in kinds]], initial=0.0)
    for kind in {*kinds}:
        alike = [other == kind for other in kinds]
        most = max(np.max(size[alike]), masses if kind == "c" else 0.0)
        size[alike] = np.maximum(size[alike], LEAST * most)
    for k, name in enumerate(names):
        if name.startswith("d("):
            size[k] = max(size[k], LEAST * size[names.index(name[2 : name.index(")")])])
    size[size == 0.0] = 1.0
    return np.asarray(size)
