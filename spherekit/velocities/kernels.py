"""Batch kernels: pole axes, coefficients, their derivatives and B."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Array
from spherekit.conventions import Names
from spherekit.errors import EngineError
from spherekit.mechanism.link_inertia import link_inertia_tensors
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.pole_plan import Pole, all_poles, pole_of
from spherekit.symbolic.compiler import available
from spherekit.symbolic.expression_derivatives import differentiate
from spherekit.symbolic.expression_evaluation import ArrayFunction
from spherekit.symbolic.expression_function import expression_function
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, dot, function
from spherekit.symbolic.vector_algebra import cross
from spherekit.velocities.coordinate_rates import CoordinateRates
from spherekit.velocities.dyad_expressions import COMPILED
from spherekit.velocities.input_moments import InputMoments
from spherekit.velocities.row_quantities import VariedTerms
from spherekit.wording import listing

Source = Literal["variables", "input"]
Coordinate = Literal["input", "arc"]
Engine = Literal["auto", "numpy", "compiled"]

ENGINES: tuple[Engine, ...] = ("auto", "numpy", "compiled")

MOST_DERIVATIVES = 2
"""Rates with two derivatives are coefficients of third order."""


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
    are, and its sense is that of the minors (`spherekit.velocities.coordinate_rates`).
    Where all variables are NaN, or no configuration closes (input), rates and B are NaN;
    that given variables do not close is not noticed. `places` are the columns of what
    `values` gives, by its name and pole or link, None of what is the mechanism's; `engine`
    says what runs `function`.
    """

    inputs: Names
    columns: Names
    places: Mapping[str, Mapping[Any, int | slice]]
    engine: Literal["numpy", "compiled"]
    function: ArrayFunction

    @checked(EngineError)
    def __call__(self, inputs: ArrayLike, out: Array | None = None) -> Array:
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
        return self.function(rows, out)

    @property
    def poles(self) -> tuple[Pole, ...]:
        """The poles that there are, as pairs of link numbers."""
        return tuple(self.places["direction"])

    def values(self, inputs: ArrayLike) -> dict[str, Any]:
        """Return the output at n configurations by the names of `places`.

        `direction`, `velocity_coefficient`, its derivatives `acceleration_coefficient` and
        `acceleration_coefficient_dq` are by pole, `w` and its derivatives `dw` and `d2w` by
        link: directions and angular velocities (n, 3), others (n,). `B`, its derivatives
        `dB_dq` and `d2B_dq2` (n,) and `tangent` (n, variables) are arrays. What was not
        asked for is missing; rates and derivatives are by the kernel's coordinate.
        """
        rows = self(inputs)
        return {
            name: rows[by_key[None]].T
            if None in by_key
            else {key: rows[place].T for key, place in by_key.items()}
            for name, by_key in self.places.items()
        }


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
        form is wanted and there is none, or if ``"compiled"`` is asked for and heyoka is
        not installed.
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
        if source not in ("variables", "input"):
            raise EngineError(
                f'{mechanism.name}: source "{source}" is not known; it is variables or '
                "input"
            )
        terms = VariedTerms(mechanism, [input_pair], closed_form=source == "input")
        q = terms.sample[:1] if source == "input" else []
        inputs, flow = [*q, *terms.places], terms.flow
        scale = _scale(flow, coordinate)
        parts = [*_poles(flow, scale, chosen)]
        if with_inertia:
            masses = InputMoments(flow, link_inertia_tensors(mechanism))
            whole = masses.matrix[0][0] * scale * scale * masses.unit
            parts.append((None, {name: [name] for name in _INERTIA}, [whole]))
        if with_tangent:
            names = [f"rate_{name}" for name in mechanism.variable_names]
            parts.append((None, {"tangent": names}, [tau * scale for tau in flow.tau[0]]))
        parts += _turning(flow, scale, turning)
        values = [[item for _, _, items in parts for item in items]]
        rates = _rates(flow, scale, inputs if source == "variables" else ())
        for _ in range(int(derivatives)):
            values.append(differentiate(values[-1], rates))
        columns: list[str] = []
        outputs: list[Expr] = []
        places: dict[str, dict[Any, int | slice]] = {"direction": {}}
        at = 0
        for key, labels, items in parts:
            for (name, named), order in zip(labels.items(), values, strict=False):
                first = len(columns)
                columns += named
                outputs += order[at : at + len(items)]
                some = slice(first, len(columns)) if len(items) > 1 else first
                places.setdefault(name, {})[key] = some
            at += len(items)
        return Kernel(
            tuple(term.arguments[0] for term in inputs),
            tuple(columns),
            places,
            taken,
            expression_function(outputs, inputs, taken == "compiled", number, compact),
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


def _scale(flow: CoordinateRates, coordinate: Coordinate) -> Expr:
    """Return dp by a coordinate."""
    if coordinate == "input":
        return 1.0 / flow.scale
    if coordinate != "arc":
        raise EngineError(
            f'{flow.mechanism.name}: coordinate "{coordinate}" is not known; it '
            "is input or arc"
        )
    tau = flow.tau[0]
    return 1.0 / function("sqrt", dot(tau, tau))


def _rates(
    flow: CoordinateRates, scale: Expr, variables: Sequence[ExpressionNode]
) -> dict[ExpressionNode, Expr]:
    """Return the rates by the coordinate of what all terms are made of: u' = w x u."""
    rates = [tau * scale for tau in flow.tau[0]]
    made: dict[Expr, Expr] = dict(zip(variables, rates, strict=False))
    for link, w in zip(flow.placed, flow.w[0], strict=True):
        for axis in link.basis.T:
            made |= zip(axis, cross(w * scale, axis), strict=True)
    return {term: rate for term, rate in made.items() if isinstance(term, ExpressionNode)}


_Part = tuple[Any, Mapping[str, Sequence[str]], Sequence[Expr]]
"""A pole or link, the columns of terms and of their derivatives by name, and the terms."""


def _poles(flow: CoordinateRates, scale: Expr, poles: Sequence[Pole]) -> Iterator[_Part]:
    """Yield unit vectors along pole axes, and the rates along them."""
    mechanism = flow.mechanism
    for pole in poles:
        variable = mechanism.angle_between(*pole)
        if variable is None:
            turning = flow.w[0][pole[1]] - flow.w[0][pole[0]]
            rate = function("sqrt", dot(turning, turning))
            unit = turning * (1.0 / rate)
        else:
            ends = mechanism.ends[mechanism.variable_owners[variable]]
            unit = flow.vectors[variable]
            rate = flow.tau[0][variable] * (1.0 if pole == ends else -1.0)
        label = "_".join(mechanism.links[k] for k in pole)
        yield pole, {"direction": [f"u{k}_{label}" for k in "xyz"]}, [*unit]
        yield pole, {name: [f"{name}_{label}"] for name in _COEFFICIENTS}, [rate * scale]


def _turning(flow: CoordinateRates, scale: Expr, links: Sequence[int]) -> Iterator[_Part]:
    """Yield the angular velocities of links."""
    for link in links:
        labels = {
            part: [f"{written.format(k)}_{flow.mechanism.links[link]}" for k in "xyz"]
            for part, written in _TURNING.items()
        }
        yield link, labels, [*flow.w[0][link] * scale]


_COEFFICIENTS = (
    "velocity_coefficient",
    "acceleration_coefficient",
    "acceleration_coefficient_dq",
)
_INERTIA = ("B", "dB_dq", "d2B_dq2")
_TURNING = {"w": "w{}", "dw": "dw{}_dq", "d2w": "d2w{}_dq2"}
"""Angular velocities and their derivatives, and how their columns are written."""
