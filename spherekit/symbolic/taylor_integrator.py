"""Taylor integration of differential equations with events, compiled by heyoka.

The equations and the functions whose zeros are events are symbolic expressions. A step
adapts its length to a tolerance. Its Taylor series describes the solution within the step.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Floats
from spherekit.symbolic.compiler import heyoka, heyoka_expressions, heyoka_variables
from spherekit.symbolic.expression_graph import Expr, ExpressionNode

CHATTERING_EVENT_COUNT = 100_000
"""A run ends at a switch after this many events: its switches are then taken to chatter.

Larger: a chattering run takes longer until it ends. Smaller: runs with many legitimate
events end early.
"""

IntegrationEventKind = Literal[
    "rest", "dead_centre", "type_2", "singularity", "coordinates", "joint_limit", "switch"
]
"""What the zero of an event function means; ``coordinates`` asks for other coordinates."""

ENDING_EVENTS: tuple[IntegrationEventKind, ...] = (
    "singularity",
    "coordinates",
    "joint_limit",
)
"""Kinds of events at which an integration ends."""


@dataclass(frozen=True)
class EventFunction:
    """A function of the state whose zeros are events of an integration.

    There are three sorts of events:

    - Those of the `ENDING_EVENTS` end the integration.
    - At a switch the equations change abruptly. An example is dry friction, which changes
      its sign with the sliding rate. The equations have this sign as a parameter. The
      parameter gets its new value, 1 or -1, and the integration continues.
    - Others are only noted.

    Attributes
    ----------
    expression
        The function, an expression of the variables, the time and the parameters.
    kind
        What a zero means.
    variable
        Index of the pair (joint) variable to which the event belongs, or -1 without a
        variable.
    sense
        Only for ending events: the sign that the function must have after the zero, or 0
        for any sign.
    switch
        Only for switches: index of the parameter that is the sign of the function.
    sticks
        Only for switches: a function of the state, the time (s) and the parameters after
        the switch. It returns whether the motion would switch back at once. An example is a
        body that dry friction holds at rest. The equations do not describe such a state, so
        the integration ends.
    """

    expression: Expr
    kind: IntegrationEventKind
    variable: int = -1
    sense: Literal[-1, 0, 1] = 0
    switch: int = -1
    sticks: Callable[[Floats, float, Floats], bool] | None = None


StepEnd = Literal["step", "limit", "switch", "not_finite", "event"]
"""Why a step ended.

- ``step``: it has the largest length that the tolerance allows.
- ``limit``: it has the largest length that the caller allows.
- ``switch``: a parameter was set to a new sign; the integration can continue.
- ``not_finite``: the state is infinite or undefined.
- ``event``: an event ends the integration.
"""


class Integrator:
    """A compiled Taylor integrator of first-order differential equations, with events.

    Parameters
    ----------
    equations
        Each state variable and its time derivative.
    time_symbol
        Variable that represents the time in the expressions.
    parameter_symbols
        Variables that are constant during a run and whose values are set before it.
    tolerance
        Error of a step, relative to the largest element of the state.
    compact
        Whether heyoka writes shorter code, which compiles faster and runs more slowly.
    events
        Functions whose zeros are events.

    Attributes
    ----------
    state, parameters
        Current state and parameters, which may be changed between steps. Parameters end
        with the last one that occurs in an expression.
    seen_events
        Index in `events` and time (s) of each event of the current run.
    """

    def __init__(
        self,
        equations: Sequence[tuple[ExpressionNode, Expr]],
        time_symbol: ExpressionNode,
        parameter_symbols: Sequence[ExpressionNode],
        tolerance: float,
        compact: bool,
        events: Sequence[EventFunction],
    ) -> None:
        """Compile the equations and the event functions.

        The class explains the parameters.
        """
        module = heyoka()
        self.events = events
        self.seen_events: list[tuple[int, float]] = []
        variables = heyoka_variables([variable for variable, _ in equations])
        state_variables = list(variables.values())
        for k, symbol in enumerate(parameter_symbols):
            variables[symbol] = module.par[k]
        variables[time_symbol] = module.time

        # heyoka calls events that may end a step terminal, and all others non-terminal.
        self._terminal_indices: list[int] = []  # in `events`, in heyoka's order
        terminal_events = []
        other_events = []
        functions = heyoka_expressions([event.expression for event in events], variables)
        for index, (event, function) in enumerate(zip(events, functions, strict=True)):
            if event.kind == "switch":
                options = {"callback": self._make_switch_callback(event, index)}
            elif event.kind in ENDING_EVENTS:
                sense = {-1: "negative", 0: "any", 1: "positive"}[event.sense]
                options = {"direction": getattr(module.event_direction, sense)}
            else:
                other_events.append(
                    module.nt_event(function, self._make_noting_callback(index))
                )
                continue
            terminal_events.append(module.t_event(function, **options))
            self._terminal_indices.append(index)

        rates = heyoka_expressions([rate for _, rate in equations], variables)
        self._adaptive = module.taylor_adaptive(
            list(zip(state_variables, rates, strict=True)),
            np.zeros(len(state_variables)),
            tol=tolerance,
            compact_mode=compact,
            # Full optimisation of long code takes most of the compilation time and makes
            # the code hardly faster. Compact code is short.
            opt_level=3 if compact else 1,
            t_events=terminal_events,
            nt_events=other_events,
        )
        # Views of heyoka's own arrays.
        self.state = self._adaptive.state
        self.parameters = self._adaptive.pars
        outcomes = module.taylor_outcome
        self._step_end_of_outcome: dict[int, StepEnd] = {
            int(outcomes.success): "step",
            int(outcomes.time_limit): "limit",
            int(outcomes.err_nf_state): "not_finite",
        }

    def _make_noting_callback(self, index: int) -> Callable[[Any, Any, int], None]:
        """Return heyoka's callback that appends an event with its time to `seen_events`."""
        return lambda _, time, sense: self.seen_events.append((index, time))

    def _make_switch_callback(
        self, event: EventFunction, index: int
    ) -> Callable[[Any, int], bool]:
        """Return the function that heyoka calls at a switch.

        A switch is a zero of an event function at which the equations of motion change. An
        example is dry friction, whose torque changes its sense. The equations have the sign
        of the event function as a parameter.

        At a switch, heyoka calls the returned function with its integrator and the new
        sign. The function sets the parameter to this sign, and returns whether the
        integration can continue. The integration must end in two cases:

        - The motion would switch back at once, because friction holds a body at rest.
        - There have been too many events.

        Parameters
        ----------
        event
            The switch.
        index
            Its index among the events.
        """

        def set_sign(adaptive: Any, sign: int) -> bool:
            """Record the event, set its sign, and return whether to continue.

            The equations of motion have the sign of the event function as a parameter, such
            as the sense of dry friction. `event.switch` is the index of the parameter.
            `adaptive` is heyoka's integrator. `sign` is the sign of the event function
            after its zero.
            """
            time = float(adaptive.time)
            self.seen_events.append((index, time))
            # The sign is 0 if the rate of the function is zero. The parameter then stays as
            # it is. heyoka's list of parameters ends with the last one that occurs in an
            # expression, so `event.switch` can be beyond its end.
            if sign and event.switch < len(adaptive.pars):
                adaptive.pars[event.switch] = sign
            # If dry friction holds a body at rest, the motion would switch to and fro
            # without progress. `event.sticks` tests for this. The copies protect the
            # integrator's arrays.
            would_switch_back = event.sticks and event.sticks(
                adaptive.state.copy(), time, adaptive.pars.copy()
            )
            # With more events, the signs would probably change for ever (chattering).
            has_too_many_events = len(self.seen_events) >= CHATTERING_EVENT_COUNT
            return not would_switch_back and not has_too_many_events

        return set_sign

    def start(self, state: Floats, time: float, parameters: Floats) -> None:
        """Start a new integration of the differential equations from an initial state.

        Parameters
        ----------
        state
            (states,) values of the state variables, in the order of the equations.
        time
            Initial time, s.
        parameters
            (parameters,) values of all parameters, such as the signs of friction torques.
        """
        self.state[:] = state
        self._adaptive.time = time
        # heyoka drops the parameters after the last one that occurs in an expression.
        self.parameters[:] = parameters[: len(self.parameters)]
        # After an event that ends a step, heyoka ignores further zeros of the same event
        # function for a short time, the cooldown. Without the reset, a cooldown of the
        # earlier integration could hide an event of the new one.
        if self._terminal_indices:
            self._adaptive.reset_cooldowns()
        self.seen_events.clear()

    @property
    def time(self) -> float:
        """The current time, s."""
        return float(self._adaptive.time)

    def step(self, max_length: float) -> tuple[StepEnd, float]:
        """Take one step, and return why it ended and its length (s).

        A step ends at its largest length, or earlier to keep its error within the
        tolerance. Some events end a step, too. After a "switch", where the equations change
        abruptly, the integration can continue. After an "event", the integration must end.
        The last element of the attribute `seen_events` is this event.

        Parameters
        ----------
        max_length
            Largest length of the step, s.
        """
        # `write_tc` stores the Taylor coefficients of the step for `coefficients`.
        outcome, length = self._adaptive.step(max_delta_t=max_length, write_tc=True)
        code = int(outcome)
        if code in self._step_end_of_outcome:
            return self._step_end_of_outcome[code], length
        # Other codes stand for an event. heyoka numbers the events that can end a step: 0,
        # 1, and so on. The code is this number if the integration can continue. If not, the
        # code is -1 for event 0, -2 for event 1, and so on.
        if code >= 0:
            return "switch", length
        heyoka_number = -code - 1
        # `_terminal_indices` has the index in `events` for each of heyoka's numbers.
        self._note_ending_event(self._terminal_indices[heyoka_number])
        return "event", length

    def _note_ending_event(self, index: int) -> None:
        """Append the event that ends the integration to `seen_events`, if necessary.

        heyoka (the integrator library) calls the callback of a switch within the step, and
        the callback has appended the switch already. Other events that end the integration
        have no callback.
        """
        if self.events[index].kind != "switch":
            self.seen_events.append((index, self.time))

    @property
    def coefficients(self) -> Floats:
        """(states, order + 1) Taylor coefficients of the last step, from its start."""
        return np.array(self._adaptive.tc)
