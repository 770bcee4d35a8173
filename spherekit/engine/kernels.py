"""Batch kernels: pole axes, coefficients, their derivatives and B."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.checked import checked
from spherekit.conventions import listing
from spherekit.engine.algebra import SeriesExpressions, by_coordinate, length, vector
from spherekit.engine.arrays import ArrayFunction, array_function
from spherekit.engine.cache import COMPILED
from spherekit.engine.compiler import CompiledFunction, available, compile_function
from spherekit.engine.dyads import place_by_inputs
from spherekit.engine.expression_graph import Expr, ExpressionNode, symbols
from spherekit.engine.inertia import inertia, tensors
from spherekit.engine.kinematics import RateExpressions, Structure
from spherekit.engine.pose import LinkOrientation, place_by_variables
from spherekit.errors import EngineError
from spherekit.model.mechanism import Mechanism
from spherekit.planning.poles import Pole, all_poles, pole_of
from spherekit.sphere.rotation import Floats

Source = Literal["variables", "input"]
Coordinate = Literal["input", "arc"]
Engine = Literal["auto", "numpy", "compiled"]

ENGINES: tuple[Engine, ...] = ("auto", "numpy", "compiled")

MOST_DERIVATIVES = 2
"""Rates with two derivatives are coefficients of third order."""


@final
@dataclass(frozen=True)
class KernelValues:
    """What a kernel found at n configurations; see `Kernel`.

    `direction[pole]` (n, 3); `rate[pole]`, its derivatives `acceleration_coefficient[pole]`
    and `acceleration_coefficient_dq[pole]`, `inertia`, its derivatives `inertia_dq` and
    `inertia_dq2` (n,); `tangent` (n, variables); `w[link]` and its first derivative
    `dw[link]` (n, 3). What was not asked for is missing or None. Rates and derivatives are
    by the kernel's coordinate.
    """

    direction: Mapping[Pole, Floats]
    velocity_coefficient: Mapping[Pole, Floats]
    acceleration_coefficient: Mapping[Pole, Floats]
    acceleration_coefficient_dq: Mapping[Pole, Floats]
    inertia: Floats | None
    inertia_dq: Floats | None
    inertia_dq2: Floats | None
    tangent: Floats | None
    w: Mapping[int, Floats]
    dw: Mapping[int, Floats]


@final
@dataclass(frozen=True)
class Kernel:
    """A function of configurations: poles, coefficients, generalised inertia.

    Inputs are the rows of an array (inputs, n): all pair variables, or the input's angle
    and a sign for each dyad. `inputs` and `columns` name the rows of input and output.
    rate * direction is the angular velocity of the pole's second link relative to its
    first per unit rate of the input, in ground axes. The direction of an R pair's pole is
    its axis. That of another pole is a unit vector along the angular velocity; it
    reverses where that passes through zero, and is NaN there. At a dead centre of the
    input rates by it are not finite; by the arc length of the curve of all variables they
    are, and its sense is that of the minors (`spherekit.engine.kinematics`). Where all
    variables are NaN, or no configuration closes (input), rates and B are NaN; that given
    variables do not close is not noticed. `engine` says what runs `function`.
    """

    inputs: tuple[str, ...]
    columns: tuple[str, ...]
    poles: tuple[Pole, ...]
    links: tuple[int, ...]
    derivatives: int
    with_inertia: bool
    with_tangent: bool
    engine: Literal["numpy", "compiled"]
    function: CompiledFunction | ArrayFunction

    @checked(EngineError)
    def __call__(self, inputs: ArrayLike, out: NDArray[Any] | None = None) -> NDArray[Any]:
        """Return the output (columns, n), written to `out` where that is given.

        Raises
        ------
        EngineError
            If an array has another shape.
        """
        rows = np.ascontiguousarray(inputs)
        for array, names in ((rows, self.inputs), (out, self.columns)):
            wanted = (len(names), *rows.shape[1:2])
            if array is not None and (rows.ndim != 2 or array.shape != wanted):
                raise EngineError(
                    f"a kernel was given an array of shape {array.shape}; its rows are "
                    f"{listing(names)}, its columns the configurations"
                )
        return np.asarray(self.function(rows, out))

    def values(self, inputs: ArrayLike) -> KernelValues:
        """Return the output by pole."""
        rows = self(inputs)
        width = 4 + self.derivatives
        at = {pole: width * k for k, pole in enumerate(self.poles)}
        last = width * len(self.poles)
        tangent = last + (1 + self.derivatives if self.with_inertia else 0)

        def rate(order: int) -> dict[Pole, Floats]:
            has_order = order <= self.derivatives
            return {pole: rows[k + 3 + order] for pole, k in at.items() if has_order}

        def inertia(order: int) -> Floats | None:
            return rows[last + order] if last + order < tangent else None

        variables = len(self.columns) - tangent if self.with_tangent else 0
        after = 3 * (1 + self.derivatives)
        variables -= after * len(self.links) if self.with_tangent else 0
        begin = tangent + variables

        def turning(order: int) -> dict[int, Floats]:
            if order > self.derivatives:
                return {}
            first = begin + 3 * order
            return {
                link: rows[first + after * k : first + after * k + 3].T
                for k, link in enumerate(self.links)
            }

        return KernelValues(
            {pole: rows[k : k + 3].T for pole, k in at.items()},
            rate(0),
            rate(1),
            rate(2),
            inertia(0),
            inertia(1),
            inertia(2),
            rows[tangent:begin].T if self.with_tangent else None,
            turning(0),
            turning(1),
        )


@checked(EngineError)
def kernel(
    mechanism: Mechanism,
    input_pair: str,
    poles: Iterable[Pole] | None = None,
    *,
    source: Source = "variables",
    coordinate: Coordinate = "input",
    derivatives: int = 1,
    with_inertia: bool = False,
    with_tangent: bool = False,
    links: Iterable[int] = (),
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
        How many derivatives of rates and of B are wanted, at most 2.
    with_inertia, with_tangent
        Whether B and the rates of all variables are wanted.
    links
        Numbers of links whose angular velocity relative to the ground is wanted, with its
        derivatives.
    engine
        ``"compiled"`` by heyoka, ``"numpy"`` in blocks of arrays, ready at once; ``"auto"``
        takes the compiled one where heyoka is installed.
    compact
        heyoka's compact mode: for very large kernels, which compile long without.
    number
        The type computed with: float, or heyoka's ``real128`` where the machine has it;
        with NumPy float or ``longdouble``.

    Raises
    ------
    EngineError
        If the engine does not know the mechanism's pairs or groups, or where a closed
        form is wanted and there is none.
    EngineMissing
        If ``"compiled"`` is asked for and heyoka is not installed.
    """
    taken = _engine(mechanism, engine)
    if derivatives not in range(MOST_DERIVATIVES + 1):
        raise EngineError(
            f"{mechanism.name}: {derivatives} derivatives were asked for; allowed is 0 to "
            f"{MOST_DERIVATIVES}"
        )
    wanted = all_poles(len(mechanism.links)) if poles is None else poles
    chosen = tuple(dict.fromkeys(pole_of(*pole) for pole in wanted))
    turning = tuple(dict.fromkeys(links))
    request = repr(
        (
            "kernel",
            input_pair,
            chosen,
            source,
            coordinate,
            int(derivatives),
            with_inertia,
            with_tangent,
            turning,
            taken,
            compact,
            number.__name__,
        )
    )

    def make() -> Kernel:
        structure = Structure.of(mechanism, input_pair)
        inputs, placed = _placed(structure, source)
        flow = RateExpressions(structure, placed, int(derivatives))
        scale = _scale(flow, coordinate)
        columns, outputs = _outputs(flow, scale, chosen, with_inertia)
        if with_tangent:
            columns += [f"rate_{name}" for name in mechanism.variable_names]
            outputs += [tau * scale.coefficients[0] for tau in flow.tau[0]]
        for link in turning:
            w = [by_coordinate(x * scale, scale) for x in _turning(flow, link)]
            columns += [
                f"{part}_{mechanism.links[link]}"
                for order in range(flow.order + 1)
                for part in _TURNING[order]
            ]
            outputs += [x[order] for order in range(flow.order + 1) for x in w]
        return Kernel(
            tuple(term.arguments[0] for term in inputs),
            tuple(columns),
            chosen,
            turning,
            flow.order,
            with_inertia,
            with_tangent,
            taken,
            compile_function(outputs, inputs, compact, number)
            if taken == "compiled"
            else array_function(outputs, inputs, number),
        )

    return COMPILED.get(mechanism, request, make)


def _engine(mechanism: Mechanism, engine: Engine) -> Literal["numpy", "compiled"]:
    if engine not in ENGINES:
        raise EngineError(
            f'{mechanism.name}: engine "{engine}" is not known; it is {listing(ENGINES)}'
        )
    if engine == "auto":
        return "compiled" if available() else "numpy"
    return engine


def _placed(
    structure: Structure, source: Source
) -> tuple[list[ExpressionNode], list[LinkOrientation]]:
    """Return the inputs, and the links placed by them."""
    mechanism = structure.mechanism
    if source == "variables":
        inputs = symbols(mechanism.variable_names)
        return inputs, place_by_variables(mechanism, structure.pairs, inputs)
    if source != "input":
        raise EngineError(
            f'{mechanism.name}: source "{source}" is not known; it is variables or input'
        )
    inputs = symbols(["q", *(f"sign_{k + 1}" for k in range(len(structure.groups)))])
    return inputs, place_by_inputs(structure, inputs[:1], inputs[1:]).links


def _scale(flow: RateExpressions, coordinate: Coordinate) -> SeriesExpressions:
    """Return dp by a coordinate."""
    if coordinate == "input":
        return 1.0 / flow.rate_of(flow.structure.driven)
    if coordinate != "arc":
        raise EngineError(
            f'{flow.structure.mechanism.name}: coordinate "{coordinate}" is not known; it '
            "is input or arc"
        )
    return 1.0 / length([vector(rates) for rates in flow.tau])[1]


def _outputs(
    flow: RateExpressions,
    scale: SeriesExpressions,
    poles: Sequence[Pole],
    with_inertia: bool,
) -> tuple[list[str], list[Expr]]:
    mechanism = flow.structure.mechanism
    columns: list[str] = []
    outputs: list[Expr] = []
    for pole in poles:
        direction, rate = flow.pole(pole)
        label = "_".join(mechanism.links[k] for k in pole)
        parts = ["ux", "uy", "uz", *_DERIVATIVES["velocity_coefficient"][: flow.order + 1]]
        columns += [f"{part}_{label}" for part in parts]
        outputs += [*direction, *by_coordinate(rate * scale, scale)]
    if with_inertia:
        columns += _DERIVATIVES["B"][: flow.order + 1]
        whole = inertia(flow, tensors(mechanism))
        outputs += by_coordinate(whole * scale * scale, scale)
    return columns, outputs


def _turning(flow: RateExpressions, link: int) -> list[SeriesExpressions]:
    """Return the components of a link's angular velocity per unit of p."""
    return [SeriesExpressions(tuple(rates[link][k] for rates in flow.w)) for k in range(3)]


_TURNING = (
    ("wx", "wy", "wz"),
    ("dwx_dq", "dwy_dq", "dwz_dq"),
    ("d2wx_dq2", "d2wy_dq2", "d2wz_dq2"),
)
_DERIVATIVES = {
    "velocity_coefficient": (
        "velocity_coefficient",
        "acceleration_coefficient",
        "acceleration_coefficient_dq",
    ),
    "B": ("B", "dB_dq", "d2B_dq2"),
}
