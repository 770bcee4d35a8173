"""heyoka, the compiler behind the engine; imported here only, and only when called."""

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from types import ModuleType
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.errors import EngineError
from spherekit.symbolic.expression_graph import (
    OPERATORS,
    Expr,
    ExpressionNode,
    TermFunction,
    rewrite,
)

MOST_SWITCHES = 100_000
"""A run in which more events than this occur ends: its switches chatter."""


def available() -> bool:
    """Return whether heyoka is installed."""
    return find_spec("heyoka") is not None


def heyoka() -> ModuleType:
    """Return the module.

    Raises
    ------
    EngineError
        If it is not installed.
    """
    try:
        import heyoka as loaded
    except ImportError as problem:
        raise EngineError(
            f"the compiled engine needs heyoka, which does not import ({problem}); "
            'install it with pip install "spherekit-mechanisms[compiled]" (Linux) or '
            "conda-forge",
            "or use the NumPy engine, which gives the same results",
        ) from None
    module: ModuleType = loaded
    return module


def _lowered(items: Sequence[Expr], variables: Mapping[ExpressionNode, Any]) -> list[Any]:
    """Return heyoka's expressions; `variables` are those of terms that stand alone."""
    module, operators = heyoka(), {**OPERATORS, "**": operator.pow}

    def apply(term: ExpressionNode, arguments: list[Any]) -> Any:
        if term.operation == "variable":
            return variables[term]
        if term.operation == "sign":
            (value,) = arguments
            one, zero = module.expression(1.0), module.expression(0.0)
            least = module.select(module.lt(value, zero), -one, zero)
            return module.select(module.gt(value, zero), one, least)
        if term.operation == "maximum":
            return module.select(module.gt(*arguments), *arguments)
        made = operators.get(term.operation) or getattr(module, term.operation)
        return made(*arguments)

    return rewrite(items, module.expression, apply)


def _plain(terms: Sequence[ExpressionNode]) -> dict[ExpressionNode, Any]:
    """Return heyoka's variable for each variable."""
    return {term: heyoka().expression(term.arguments[0]) for term in terms}


def compile_function(
    outputs: Sequence[Expr],
    inputs: Sequence[ExpressionNode],
    compact: bool = False,
    number: type[Any] = float,
) -> TermFunction:
    """Compile expressions; `number` is the type computed with (float, real128)."""
    names = _plain(inputs)
    made = heyoka().cfunc(
        _lowered(outputs, names),
        list(names.values()),
        compact_mode=compact,
        fp_type=number,
    )

    def at(given: Array, out: Array | None = None) -> Any:
        return made(np.ascontiguousarray(given), outputs=out)

    return at


EventKind = Literal[
    "rest", "dead_centre", "type_2", "singularity", "coordinates", "joint_limit", "switch"
]
ENDING: tuple[EventKind, ...] = ("singularity", "coordinates", "joint_limit")
"""Events at which an integration ends."""


@dataclass(frozen=True)
class EventFunction:
    """A zero of an expression during an integration, about a variable or -1.

    Of a switch, `switch` is a parameter's number, which becomes the expression's new
    sign; the integration restarts from there, unless `sticks`, called with the state, the
    time and the parameters, says that it would turn back at once. Some kinds are `ENDING`;
    with a `sense` only passages to that sign count. Others are noted.
    """

    expression: Expr
    kind: EventKind
    variable: int = -1
    sense: Literal[-1, 0, 1] = 0
    switch: int = -1
    sticks: Callable[[Floats, float, Floats], bool] | None = None


StepEnd = Literal["step", "limit", "switch", "not_finite", "event"]
"""Why a step ended: it was as long as the tolerance allows, or as was allowed, a switch
turned, the state is not finite, or an event ends the integration."""


class Integrator:
    """A compiled Taylor integrator of equations (variable, its rate by time), with events.

    For one `tolerance`. `moment` is the variable that stands for the time, `constants` are
    those whose values are set before each run. `state` and `parameters` are those reached,
    which may be changed between steps; `seen` collects what occurs in a run: events by
    number, with the time.
    """

    def __init__(
        self,
        equations: Sequence[tuple[ExpressionNode, Expr]],
        moment: ExpressionNode,
        constants: Sequence[ExpressionNode],
        tolerance: float,
        compact: bool,
        events: Sequence[EventFunction],
    ) -> None:
        module = heyoka()
        self.events = events
        self.terminal: list[int] = []
        self.seen: list[tuple[int, float]] = []
        names = _plain([variable for variable, _ in equations])
        stated = list(names.values())
        names |= {symbol: module.par[k] for k, symbol in enumerate(constants)}
        names[moment] = module.time
        conditions = _lowered([event.expression for event in events], names)
        passing, ending = [], []
        for which, (event, condition) in enumerate(zip(events, conditions, strict=True)):
            if event.kind == "switch":
                action = {"callback": self._flip(event, which)}
            elif event.kind in ENDING:
                sense = {-1: "negative", 0: "any", 1: "positive"}[event.sense]
                action = {"direction": getattr(module.event_direction, sense)}
            else:
                passing.append(module.nt_event(condition, self._note(which)))
                continue
            ending.append(module.t_event(condition, **action))
            self.terminal.append(which)
        rates = _lowered([rate for _, rate in equations], names)
        self.adaptive = module.taylor_adaptive(
            list(zip(stated, rates, strict=True)),
            np.zeros(len(stated)),
            tol=tolerance,
            compact_mode=compact,
            # What optimises more of long code takes most of the time of compiling it and
            # gains little; compact code is short.
            opt_level=3 if compact else 1,
            t_events=ending,
            nt_events=passing,
        )
        # Views of heyoka's own, which has parameters up to the last one that occurs.
        self.state, self.parameters = self.adaptive.state, self.adaptive.pars
        ends = module.taylor_outcome
        self.outcomes: dict[int, StepEnd] = {
            int(ends.success): "step",
            int(ends.time_limit): "limit",
            int(ends.err_nf_state): "not_finite",
        }

    def _note(self, which: int) -> Callable[[Any, Any, int], None]:
        return lambda _, when, sense: self.seen.append((which, when))

    def _flip(self, event: EventFunction, which: int) -> Callable[[Any, int], bool]:
        def turn(running: Any, sense: int) -> bool:
            now = float(running.time)
            self.seen.append((which, now))
            if sense:
                running.pars[event.switch] = sense
            now_at = running.state.copy(), now, running.pars.copy()
            stuck = event.sticks and event.sticks(*now_at)
            return not stuck and len(self.seen) < MOST_SWITCHES

        return turn

    def start(self, state: Floats, time: float, parameters: Floats) -> None:
        """Set the state, the time and the parameters before a run."""
        self.state[:] = state
        self.adaptive.time = time
        self.parameters[:] = parameters[: len(self.parameters)]
        if self.terminal:
            self.adaptive.reset_cooldowns()
        self.seen.clear()

    @property
    def time(self) -> float:
        """The time reached."""
        return float(self.adaptive.time)

    def step(self, longest: float) -> tuple[StepEnd, float]:
        """Take a step, at most this long; return why it ended and its length.

        The event that ends an integration is the last one seen.
        """
        outcome, length = self.adaptive.step(max_delta_t=longest, write_tc=True)
        code = int(outcome)
        if code in self.outcomes:
            return self.outcomes[code], length
        if code >= 0:
            return "switch", length
        which = self.terminal[-code - 1]
        if self.events[which].kind != "switch":
            self.seen.append((which, self.time))
        return "event", length

    @property
    def coefficients(self) -> Floats:
        """(states, order + 1) Taylor coefficients of the last step, from its start."""
        return np.array(self.adaptive.tc)
