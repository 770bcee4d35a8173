"""heyoka, the compiler behind the engine; imported here only, and only when called."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from types import ModuleType
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.errors import EngineMissing
from spherekit.sphere.rotation import Floats

Expr = Any
"""A number, or an expression that heyoka can compile."""


def available() -> bool:
    """Return whether heyoka is installed."""
    return find_spec("heyoka") is not None


def heyoka() -> ModuleType:
    """Return the module.

    Raises
    ------
    EngineMissing
        If it is not installed.
    """
    try:
        import heyoka as found
    except ImportError as problem:
        raise EngineMissing(
            f"the compiled engine needs heyoka, which does not import ({problem}); "
            'install it with pip install "spherekit[compiled]" (Linux) or from '
            "conda-forge, or use the NumPy engine, which gives the same results"
        ) from None
    module: ModuleType = found
    return module


def symbols(names: Sequence[str]) -> list[Expr]:
    """Return one variable for each name."""
    module = heyoka()
    return [module.expression(name) for name in names]


def function(name: str, *arguments: Expr) -> Expr:
    """Return heyoka's function of this name applied to expressions or numbers."""
    module = heyoka()
    return getattr(module, name)(*map(module.expression, arguments))


def choose(condition: Expr, positive: Expr, otherwise: Expr) -> Expr:
    """Return `positive` where a condition is greater than zero, else `otherwise`."""
    module = heyoka()
    each = map(module.expression, (condition, positive, otherwise))
    where, one, other = each
    return module.select(module.gt(where, module.expression(0.0)), one, other)


@final
@dataclass(frozen=True)
class Function:
    """A compiled function of arrays (inputs, n) with values (outputs, n).

    `seconds` is what compiling took; `size` counts its elementary operations.
    """

    call: Callable[..., Any]
    outputs: int
    seconds: float
    size: int

    def __call__(self, inputs: NDArray[Any], out: NDArray[Any] | None = None) -> Any:
        """Return the values (outputs, n) at inputs (inputs, n), written to `out`."""
        return self.call(inputs) if out is None else self.call(inputs, outputs=out)


def compile_function(
    outputs: Sequence[Expr],
    inputs: Sequence[Expr],
    compact: bool = False,
    number: type[Any] = float,
) -> Function:
    """Compile expressions; `number` is the type computed with (float, real128)."""
    module = heyoka()
    started = time.perf_counter()
    made = module.cfunc(
        [module.expression(each) for each in outputs],
        list(inputs),
        compact_mode=compact,
        fp_type=number,
    )
    size = len(made.dc) - len(inputs) - len(outputs)
    return Function(made, len(outputs), time.perf_counter() - started, size)


@final
@dataclass(frozen=True)
class Event:
    """A zero of an expression during an integration; one that stops ends it there."""

    expression: Expr
    stops: bool


@final
@dataclass(frozen=True)
class Integrator:
    """A compiled Taylor integrator of given equations, with its events.

    `seen` collects (time, number of the event, sense) while it runs.
    """

    adaptive: Any
    seen: list[tuple[float, int, int]]
    stopping: tuple[int, ...]
    seconds: float
    size: int

    def start(self, state: Sequence[float], time: float, parameters: Sequence[float]) -> None:
        """Set the state, the time and the parameters before a run."""
        self.adaptive.state[:] = state
        self.adaptive.time = time
        self.adaptive.pars[:] = parameters
        if self.stopping:
            self.adaptive.reset_cooldowns()
        self.seen.clear()


def compile_integrator(
    equations: Mapping[Any, Expr] | Sequence[tuple[Expr, Expr]],
    tolerance: float,
    compact: bool,
    events: Sequence[Event] = (),
    number: type[Any] = float,
) -> Integrator:
    """Compile the equations (variable, its rate by time) for one tolerance."""
    module = heyoka()
    started = time.perf_counter()
    pairs = equations.items() if isinstance(equations, Mapping) else equations
    seen: list[tuple[float, int, int]] = []

    def noted(which: int) -> Callable[[Any, Any, int], None]:
        return lambda _, when, sense: seen.append((when, which, sense))

    passing, stopping = [], []
    for which, event in enumerate(events):
        if event.stops:
            stopping.append(which)
        else:
            passing.append(
                module.nt_event(event.expression, noted(which), fp_type=number)
            )
    ends = [module.t_event(events[k].expression, fp_type=number) for k in stopping]
    system = [(name, module.expression(rate)) for name, rate in pairs]
    made = module.taylor_adaptive(
        system,
        np.zeros(len(system), dtype=number),
        tol=number(tolerance),
        compact_mode=compact,
        t_events=ends,
        nt_events=passing,
        fp_type=number,
    )
    seconds = time.perf_counter() - started
    return Integrator(made, seen, tuple(stopping), seconds, len(made.decomposition))


def time_symbol() -> Expr:
    """Return the time as it stands in the equations of an integrator."""
    return heyoka().time


def parameter(number: int) -> Expr:
    """Return a constant whose value is set before each run."""
    return heyoka().par[number]


__all__ = [
    "Event",
    "Expr",
    "Floats",
    "Function",
    "Integrator",
    "available",
    "choose",
    "compile_function",
    "compile_integrator",
    "function",
    "heyoka",
    "parameter",
    "symbols",
    "time_symbol",
]
