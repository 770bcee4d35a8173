"""Making the stored functions of several inputs: over the box of their ranges.

The assembly mode is followed over a coarse grid; configurations between are found by
Newton's method from the nearest of it, predicted to the second order.
"""

from collections.abc import Iterable
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.checked import checked
from spherekit.conventions import CLOSURE_TOLERANCE, Status
from spherekit.dynamics.equation import christoffel
from spherekit.dynamics.forces import Loads
from spherekit.dynamics.grid_model import GridMetadata, GridModel
from spherekit.dynamics.inertia import inertia
from spherekit.dynamics.kinematics import CoordinateMotion, by_variables, determined
from spherekit.dynamics.model_metadata import StoredFunction
from spherekit.dynamics.stored_loads import own_velocities, stored_loads
from spherekit.dynamics.tabulate import LEAST, pole_name
from spherekit.errors import SolveError
from spherekit.files.read import AnyMechanism, mechanism_of
from spherekit.files.write import mechanism_hash
from spherekit.model.bearings import need_no_rubbing
from spherekit.motion.continued import going_on
from spherekit.motion.loops import left_inverse
from spherekit.motion.motion import Tracer
from spherekit.numeric.cells import TensorChebyshev
from spherekit.planning.poles import parse_pole
from spherekit.progress import Working
from spherekit.sphere.rotation import Floats
from spherekit.version import __version__

SAMPLES = 33
"""Samples of each of two inputs between which the mode is found; fewer of more inputs."""

MOST_SAMPLES = 1200

NEWTON_STEPS = 8

TRUST = 0.2
"""Largest change (rad) of a variable in a step."""

APART = 0.02
"""A configuration farther (rad) than this from where the trapezoidal rule leads from the
nearest known one is not of the same mode."""

SURE = 0.02
"""Inputs that determine the motion less surely than this are too near a singularity."""

MEASURED = 4000
"""Random places at which errors are measured."""


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
    mechanism = mechanism_of(mechanism)
    if not 1e-13 <= tolerance <= 1e-2:
        raise SolveError(
            f"{mechanism.name}: tolerance is {tolerance:g}, allowed is 1e-13 to 1e-2"
        )
    need_no_rubbing(mechanism, "a stored model has not")
    inputs = len(mechanism.inputs)
    count = min(SAMPLES, int(MOST_SAMPLES ** (1.0 / max(inputs, 1))))
    tracer = Tracer(mechanism, None, assembly_mode, samples=count, grid=True)
    sampler = _Sampler(tracer, tuple(parse_pole(mechanism, text) for text in poles))
    size = _sizes(sampler.names, sampler.columns(sampler.known))
    working = Working("fitting functions")

    def function(q: Floats) -> Floats:
        working.tell(f"{len(q)} places".__str__)
        return sampler.at(q)

    series = TensorChebyshev.fit(function, sampler.low, sampler.high, tolerance, size)
    if not len(series.bounds):
        raise SolveError(
            f"{mechanism.name}: assembly mode {assembly_mode} is nowhere smooth enough "
            "over the ranges of the inputs to be stored; narrow them, or give a larger "
            "tolerance"
        )
    units = zip(sampler.names.items(), size.tolist(), _errors(series, sampler), strict=True)
    heading = GridMetadata(
        mechanism=tracer.mechanism.name,
        mechanism_sha256=mechanism_hash(tracer.mechanism),
        made_by=__version__,
        inputs=tracer.inputs,
        assembly_mode=assembly_mode,
        low=tuple(sampler.low.tolist()),
        high=tuple(sampler.high.tolist()),
        covered=series.covered,
        variables=mechanism.variable_names,
        angles=tuple(mechanism.angles),
        poles=tuple(pole_name(mechanism, pole) for pole in sampler.poles),
        loads=stored_loads(sampler.loads, str),
        functions=tuple(
            StoredFunction(name, unit, most, error / most)
            for (name, unit), most, error in units
        ),
    )
    return GridModel(heading, series)


def _errors(series: TensorChebyshev, sampler: "_Sampler") -> list[float]:
    """Return the largest error of each function at random places of the domain."""
    random = np.random.default_rng(1)
    q = sampler.low + (sampler.high - sampler.low) * random.random(
        (MEASURED, len(sampler.low))
    )
    q = q[series.cells(q) >= 0]
    exact = sampler.at(q)
    finite = np.all(np.isfinite(exact), axis=1)
    gap = np.abs(series.at(q[finite]) - exact[finite])
    return [float(error) for error in np.max(gap, axis=0, initial=0.0)]


def _sizes(names: dict[str, str], values: Floats) -> Floats:
    """Return the largest value (F,) of each function, at least `LEAST` of its kind's."""
    size = np.max(np.abs(values), axis=0, initial=0.0)
    kinds: dict[str, list[int]] = {}
    for column, name in enumerate(names):
        kinds.setdefault(name.split()[0].partition("_")[0], []).append(column)
    if "c" in kinds:
        # Of a constant inertia the symbols are rounding.
        size[kinds["c"]] = np.maximum(size[kinds["c"]], LEAST * np.max(size[kinds["M"]]))
    for columns in kinds.values():
        size[columns] = np.maximum(size[columns], LEAST * np.max(size[columns]))
    size[size == 0.0] = 1.0
    return np.asarray(size)


@final
class _Sampler:
    """Every function to be stored, exactly, at any inputs."""

    def __init__(self, tracer: Tracer, poles: tuple[tuple[int, int], ...]) -> None:
        self.mechanism, self.poles = tracer.mechanism, poles
        self.closure = tracer.solver.closure
        self.driven = [self.mechanism.angles[pair] for pair in tracer.inputs]
        self.low, self.high = np.array([item.range for item in self.mechanism.inputs]).T
        self.loads = Loads(self.mechanism)
        self.velocities = own_velocities(self.loads)
        motion = going_on(tracer.motion(), tracer.solver)
        shape = tracer.input_grid.shape
        good = (motion.status == Status.OK).reshape(shape)
        values = motion.values.reshape(*shape, -1)
        nodes = by_variables(self.closure, values[good], self.driven)
        sure = np.all(np.isfinite(nodes.second), axis=(1, 2, 3))
        sure &= determined(nodes.rates) >= SURE
        if not np.any(sure):
            raise SolveError(
                f"{self.mechanism.name}: the assembly mode has no regular configuration on "
                "a grid over the ranges of the inputs; give another assembly mode or range"
            )
        self.known = by_variables(self.closure, values[good][sure], self.driven)

    @property
    def names(self) -> dict[str, str]:
        """Names of the functions with their units."""
        made = self.mechanism
        heading = [made.pairs[made.variable_owners[v]].name for v in self.driven]
        units = dict.fromkeys(made.variable_names, "rad")
        for name in made.variable_names:
            units |= dict.fromkeys((f"d({name})/d(theta_{x})" for x in heading), "")
        if made.masses or made.loads:
            lower = [(a, b) for i, a in enumerate(heading) for b in heading[: i + 1]]
            units |= {f"M {a} {b}": "kg m2" for a, b in lower}
            units |= {f"c {x} {a} {b}": "kg m2" for x in heading for a, b in lower}
        for k, name in self.velocities.items():
            unit = made.loads[self.loads.owners[k]].velocity_unit
            units |= {f"{name} by {pair}": unit for pair in heading}
        for pole in self.poles:
            for axis in "xyz":
                name = f"velocity {pole_name(made, pole)} {axis}"
                units |= {f"{name} by {pair}": "" for pair in heading}
        return units

    def at(self, q: Floats) -> Floats:
        """Return all functions (n, F) at inputs (n, m), NaN where the mode is not."""
        values, good = self._closed(q)
        functions = np.full((len(q), len(self.names)), np.nan)
        if np.any(good):
            motion = by_variables(self.closure, values[good], self.driven)
            functions[good] = self.columns(motion)
        return functions

    def columns(self, motion: CoordinateMotion) -> Floats:
        """Return all functions (n, F) of a motion by the inputs."""
        n, m = motion.rates.shape[:2]
        made = self.mechanism
        parts = [motion.values, np.swapaxes(motion.rates, 1, 2).reshape(n, -1)]
        rows, columns = np.tril_indices(m)
        if made.masses or made.loads:
            masses = inertia(made, motion)
            parts.append(masses.M[:, rows, columns])
            symbols = christoffel(masses.dM)
            parts.append(symbols[:, :, rows, columns].reshape(n, -1))
        if self.velocities:
            works = self.loads.velocities(motion)[..., list(self.velocities)]
            parts.append(np.swapaxes(works, 1, 2).reshape(n, -1))
        for first, second in self.poles:
            w = motion.w[:, :, second] - motion.w[:, :, first]
            parts.append(np.swapaxes(w, 1, 2).reshape(n, -1))
        return np.concatenate(parts, axis=1)

    def _closed(self, q: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Return closed configurations (n, variables) of the mode, and which are."""
        from scipy.spatial import cKDTree

        nodes, driven = self.known, self.driven
        near = cKDTree(nodes.values[:, driven]).query(q)[1]
        step = q - nodes.values[near][:, driven]
        ahead = np.einsum("ni,niv->nv", step, nodes.rates[near])
        bend = np.einsum("ni,nk,nikv->nv", step, step, nodes.second[near])
        values = nodes.values[near] + ahead + 0.5 * bend
        values[:, driven] = q
        free = np.setdiff1d(np.arange(values.shape[1]), driven)
        with np.errstate(all="ignore"):
            rows = np.arange(len(q))
            for _ in range(NEWTON_STEPS):
                at = self.closure.at(values[rows])
                inverse = left_inverse(at.jacobian[:, :, free])
                change = -(inverse @ at.residual[..., None])[..., 0]
                size = np.max(np.abs(change), axis=1, initial=0.0)
                change *= np.minimum(1.0, TRUST / np.maximum(size, 1e-300))[:, None]
                values[np.ix_(rows, free)] += change
                rows = rows[size > 1e-14]
                if not len(rows):
                    break
            moving = by_variables(self.closure, values, driven, order=1)
            both = nodes.rates[near] + moving.rates
            led = nodes.values[near] + 0.5 * np.einsum("ni,niv->nv", step, both)
            good = self.closure.at(values).gap < CLOSURE_TOLERANCE
            good &= np.max(np.abs(led - values), axis=1) < APART
            good &= determined(moving.rates) >= SURE
        good &= moving.status == Status.OK
        return values, good
