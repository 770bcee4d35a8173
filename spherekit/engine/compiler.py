"""heyoka, the compiler behind the engine; imported here only, and only when called."""

import time
from collections.abc import Callable, Sequence
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

MOST_SWITCHES = 100_000
"""A run in which more events than this occur ends: its switches chatter."""


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


def power(base: Expr, exponent: Expr) -> Expr:
    """Return base ** exponent."""
    module = heyoka()
    return module.expression(base) ** module.expression(exponent)


def derivative(expression: Expr, variable: Expr) -> Expr:
    """Return the partial derivative by a variable."""
    module = heyoka()
    return module.diff(module.expression(expression), variable)


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
    """A zero of an expression during an integration.

    With `switch`, a parameter's number, that parameter becomes the expression's new
    sign, and the integration restarts from there. Otherwise, where it `stops`, the
    integration ends; else it is noted.
    """

    expression: Expr
    stops: bool = False
    switch: int | None = None


@final
@dataclass(frozen=True)
class Noted:
    """An event that occurred: its number, the time, and the sense of the passage."""

    event: int
    time: float
    sense: int


@final
@dataclass(frozen=True)
class Integrator:
    """A compiled Taylor integrator of given equations, with its events.

    `seen` collects what occurs in a run. `seconds` is what compiling took; `size`
    counts elementary operations.
    """

    adaptive: Any
    events: tuple[Event, ...]
    terminal: tuple[int, ...]
    seen: list[Noted]
    seconds: float
    size: int

    def start(self, state: Sequence[float], time: float, parameters: Sequence[float]) -> None:
        """Set the state, the time and the parameters before a run."""
        self.adaptive.state[:] = state
        self.adaptive.time = time
        self.adaptive.pars[:] = parameters
        if self.terminal:
            self.adaptive.reset_cooldowns()
        self.seen.clear()

    def run(self, times: Floats, max_steps: int) -> tuple[Floats, str, int]:
        """Run to the last of `times`, return the states there, why it ended, the steps.

        Rows after the end are missing. The reason is "" where the last time was reached.
        """
        outcome, _, _, steps, _, states = self.adaptive.propagate_grid(
            times, max_steps=max_steps
        )
        code = int(outcome)
        ends = heyoka().taylor_outcome
        if code == int(ends.time_limit):
            return states, "", steps
        if code == int(ends.step_limit):
            return states, f"{max_steps} steps were not enough", steps
        if code == int(ends.err_nf_state):
            return states, "the state is no longer finite", steps
        which = self.terminal[-code - 1]
        self.seen.append(Noted(which, float(self.adaptive.time), 0))
        return states, f"event {which}", steps


def compile_integrator(
    equations: Sequence[tuple[Expr, Expr]],
    tolerance: float,
    compact: bool,
    events: Sequence[Event] = (),
    parameters: int = 0,
    number: type[Any] = float,
) -> Integrator:
    """Compile the equations (variable, its rate by time) for one tolerance."""
    module = heyoka()
    started = time.perf_counter()
    seen: list[Noted] = []

    def note(which: int) -> Callable[[Any, Any, int], None]:
        return lambda _, when, sense: seen.append(Noted(which, float(when), sense))

    def flip(which: int, switch: int) -> Callable[[Any, int], bool]:
        def turn(running: Any, sense: int) -> bool:
            seen.append(Noted(which, float(running.time), sense))
            if sense:
                running.pars[switch] = number(sense)
            return len(seen) < MOST_SWITCHES

        return turn

    passing, ending, terminal = [], [], []
    for which, event in enumerate(events):
        expression = module.expression(event.expression)
        if event.switch is not None:
            action = flip(which, event.switch)
            ending.append(module.t_event(expression, callback=action, fp_type=number))
            terminal.append(which)
        elif event.stops:
            ending.append(module.t_event(expression, fp_type=number))
            terminal.append(which)
        else:
            passing.append(module.nt_event(expression, note(which), fp_type=number))
    system = [(name, module.expression(rate)) for name, rate in equations]
    made = module.taylor_adaptive(
        system,
        np.zeros(len(system), dtype=number),
        tol=number(tolerance),
        pars=np.zeros(parameters, dtype=number),
        compact_mode=compact,
        t_events=ending,
        nt_events=passing,
        fp_type=number,
    )
    return Integrator(
        made,
        tuple(events),
        tuple(terminal),
        seen,
        time.perf_counter() - started,
        len(made.decomposition),
    )


def time_symbol() -> Expr:
    """Return the time as it stands in the equations of an integrator."""
    return heyoka().time


def parameter(number: int) -> Expr:
    """Return a constant whose value is set before each run."""
    return heyoka().par[number]

