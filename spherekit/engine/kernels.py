"""Batch kernels: pole axes, coefficients, their derivatives and B, compiled."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.conventions import listing
from spherekit.engine.algebra import Exprs, dot
from spherekit.engine.arrays import ArrayFunction, array_function
from spherekit.engine.cache import cached
from spherekit.engine.compiler import Function, available, compile_function
from spherekit.engine.dyads import place_by_input
from spherekit.engine.inertia import inertia, tensors
from spherekit.engine.kinematics import Flow, Structure
from spherekit.engine.pose import place_by_variables
from spherekit.engine.terms import Expr, Term, function, symbols
from spherekit.errors import EngineError
from spherekit.model.mechanism import Mechanism
from spherekit.planning.poles import Pole, all_poles, pole_of
from spherekit.sphere.rotation import Floats

Source = Literal["variables", "input"]
Coordinate = Literal["input", "arc"]
Engine = Literal["auto", "numpy", "compiled"]

ENGINES: tuple[Engine, ...] = ("auto", "numpy", "compiled")


@final
@dataclass(frozen=True)
class Values:
    """What a kernel found at n configurations; see `Kernel`.

    `direction[pole]` (n, 3), `rate[pole]` (n,), `rate_dq[pole]` (n,), `inertia` (n,),
    `inertia_dq` (n,) and `tangent` (n, variables); what was not asked for is missing or
    None. Rates and derivatives are by the kernel's coordinate.
    """

    direction: Mapping[Pole, Floats]
    rate: Mapping[Pole, Floats]
    rate_dq: Mapping[Pole, Floats]
    inertia: Floats | None
    inertia_dq: Floats | None
    tangent: Floats | None


@final
@dataclass(frozen=True)
class Kernel:
    """A compiled function of configurations: poles, coefficients, generalised inertia.

    Inputs are the rows of an array (inputs, n): all pair variables, or the input's angle
    and a sign for each dyad. `columns` names the rows of the output. rate * direction is
    the angular velocity of the pole's second link relative to its first per unit rate of
    the input, in ground axes. The direction of an R pair's pole is its axis. That of
    another pole is a unit vector along the angular velocity; it reverses where that
    passes through zero, and is NaN there. At a dead centre of the input rates by it are
    not finite; by the arc length of the curve of all variables they are, and its sense is
    that of the minors (`spherekit.engine.kinematics`). Configurations that do not close
    give NaN (input) or are not noticed (variables).
    """

    columns: tuple[str, ...]
    poles: tuple[Pole, ...]
    derivatives: bool
    with_inertia: bool
    with_tangent: bool
    engine: Literal["numpy", "compiled"]
    function: Function | ArrayFunction

    def __call__(self, inputs: ArrayLike, out: NDArray[Any] | None = None) -> NDArray[Any]:
        """Return the output (columns, n), written to `out` where that is given."""
        rows = np.ascontiguousarray(inputs)
        return np.asarray(self.function(rows, out))

    def values(self, inputs: ArrayLike) -> Values:
        """Return the output by pole."""
        rows = self(inputs)
        width = 5 if self.derivatives else 4
        at = {pole: width * k for k, pole in enumerate(self.poles)}
        last = width * len(self.poles)
        here, change = self.with_inertia, self.with_inertia and self.derivatives
        tangent = last + int(here) + int(change)
        return Values(
            {pole: rows[k : k + 3].T for pole, k in at.items()},
            {pole: rows[k + 3] for pole, k in at.items()},
            {pole: rows[k + 4] for pole, k in at.items()} if self.derivatives else {},
            rows[last] if here else None,
            rows[last + 1] if change else None,
            rows[tangent:].T if self.with_tangent else None,
        )


def kernel(
    mechanism: Mechanism,
    input_pair: str,
    poles: Iterable[Pole] | None = None,
    *,
    source: Source = "variables",
    coordinate: Coordinate = "input",
    derivatives: bool = True,
    with_inertia: bool = False,
    with_tangent: bool = False,
    engine: Engine = "auto",
    compact: bool = False,
    number: type[Any] = float,
) -> Kernel:
    """Return a kernel; from the cache where it was compiled before.

    Parameters
    ----------
    mechanism, input_pair
        A mechanism with one freedom, and the pair whose angle q is the input.
    poles
        Pairs of link numbers; all by default.
    source
        What the inputs are: all pair variables, or, for mechanisms whose groups are all
        dyads, q and the sign of each dyad in solving order (closed form).
    coordinate
        What rates, derivatives and B are by: the input's angle, or the arc length of the
        curve of all variables, which is regular at dead centres of the input.
    derivatives
        Whether the derivatives of rates and of B are wanted.
    with_inertia, with_tangent
        Whether B and the rates of all variables are wanted.
    compact
        heyoka's compact mode: for very large kernels, which compile long without.
    number
        The type computed with: float, or heyoka's ``real128`` where the machine has it.

    Raises
    ------
    EngineError
        If the mechanism cannot be compiled, or has no closed form where that is wanted.
    """
    taken = _engine(mechanism, engine)
    wanted = all_poles(len(mechanism.links)) if poles is None else poles
    chosen = tuple(dict.fromkeys(pole_of(*pole) for pole in wanted))
    request = repr(
        (
            "kernel",
            input_pair,
            chosen,
            source,
            coordinate,
            derivatives,
            with_inertia,
            with_tangent,
            taken,
            compact,
            number.__name__,
        )
    )

    def make() -> Kernel:
        structure = Structure.of(mechanism, input_pair)
        inputs, flow = _flow(structure, source)
        scale = _scale(flow, coordinate, derivatives)
        columns, outputs = _outputs(flow, scale, chosen, derivatives, with_inertia)
        if with_tangent:
            columns += [f"rate_{name}" for name in mechanism.variable_names]
            outputs += [tau * scale.share for tau in flow.tau]
        return Kernel(
            tuple(columns),
            chosen,
            derivatives,
            with_inertia,
            with_tangent,
            taken,
            compile_function(outputs, inputs, compact, number)
            if taken == "compiled"
            else array_function(outputs, inputs, number),
        )

    return cached(mechanism, request, make)


def _engine(mechanism: Mechanism, engine: Engine) -> Literal["numpy", "compiled"]:
    if engine not in ENGINES:
        raise EngineError(
            f'{mechanism.name}: engine "{engine}" is not known; it is {listing(ENGINES)}'
        )
    if engine == "auto":
        return "compiled" if available() else "numpy"
    return engine


def _flow(structure: Structure, source: Source) -> tuple[list[Term], Flow]:
    mechanism = structure.mechanism
    if source == "variables":
        inputs = symbols(mechanism.variable_names)
        return inputs, Flow(
            structure, place_by_variables(mechanism, structure.pairs, inputs)
        )
    if source != "input":
        raise EngineError(
            f'{mechanism.name}: source "{source}" is not known; it is variables or input'
        )
    inputs = symbols(["q", *(f"sign_{k + 1}" for k in range(len(structure.groups)))])
    return inputs, Flow(structure, place_by_input(structure, inputs[0], inputs[1:]))


@final
@dataclass(frozen=True)
class _Scale:
    """dp by a coordinate, and the derivative of its reciprocal by p over itself."""

    share: Expr
    bend: Expr

    def derivative(self, value: Expr, rate: Expr, order: int) -> Expr:
        """Return d(value share^order) by the coordinate, `rate` being d(value)/dp."""
        power = self.share
        for _ in range(order):
            power = power * self.share
        return (rate - float(order) * (value * self.bend)) * power


def _scale(flow: Flow, coordinate: Coordinate, derivatives: bool) -> _Scale:
    if coordinate == "input":
        share = 1.0 / flow.input_rate
        bent = flow.tau_rate[flow.structure.driven] if derivatives else 0.0
        return _Scale(share, bent * share)
    if coordinate != "arc":
        raise EngineError(
            f'{flow.structure.mechanism.name}: coordinate "{coordinate}" is not known; it '
            "is input or arc"
        )
    share = 1.0 / flow.speed
    bent = 0.0
    for tau, change in zip(flow.tau, flow.tau_rate if derivatives else (), strict=False):
        bent = bent + tau * change
    return _Scale(share, bent * (share * share))


def _outputs(
    flow: Flow,
    scale: _Scale,
    poles: Sequence[Pole],
    derivatives: bool,
    with_inertia: bool,
) -> tuple[list[str], list[Expr]]:
    mechanism = flow.structure.mechanism
    columns: list[str] = []
    outputs: list[Expr] = []
    for pole in poles:
        direction, size, change = _pole(flow, pole, derivatives)
        label = "_".join(mechanism.links[k] for k in pole)
        columns += [f"{part}_{label}" for part in ("ux", "uy", "uz", "rate")]
        outputs += [*direction, size * scale.share]
        if derivatives:
            columns.append(f"rate_dq_{label}")
            outputs.append(scale.derivative(size, change, 1))
    if with_inertia:
        whole = inertia(flow, tensors(mechanism))
        columns.append("B")
        outputs.append(whole.value * scale.share * scale.share)
        if derivatives:
            columns.append("dB_dq")
            outputs.append(scale.derivative(whole.value, whole.rate, 2))
    return columns, outputs


def _pole(flow: Flow, pole: Pole, derivatives: bool) -> tuple[Exprs, Expr, Expr]:
    """Return a unit vector, the rate along it per unit of p, and its derivative."""
    mechanism = flow.structure.mechanism
    for number, (a, b) in enumerate(mechanism.ends):
        if mechanism.pairs[number].type == "R" and {a, b} == set(pole):
            (variable,) = mechanism.variables_of(number)
            sense = 1.0 if pole == (a, b) else -1.0
            change = sense * flow.tau_rate[variable] if derivatives else 0.0
            return flow.vectors[variable], sense * flow.tau[variable], change
    w = flow.relative(*pole)
    size = function("sqrt", dot(w, w))
    unit = np.asarray(w * (1.0 / size))
    return unit, size, dot(unit, flow.relative_rate(*pole)) if derivatives else 0.0
