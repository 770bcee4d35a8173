"""The equation of motion as a system that the Taylor integrator runs.

Of one freedom it is that of `spherekit.dynamics.motion_expressions`, of several that of
`spherekit.dynamics.motion_expressions` in given coordinates; loads, joint limits and
switches are the same.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.dynamics.motion_expressions import (
    MOMENT,
    ParameterLayout,
    System,
    constant,
    stop_events,
)
from spherekit.dynamics.one_freedom import one_freedom
from spherekit.dynamics.several_freedoms import several_freedoms
from spherekit.errors import EngineError
from spherekit.mechanism.load import BearingFriction, TorqueTable, not_written
from spherekit.mechanism.load_kinds import JointLimit, PairTorque
from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.compiler import (
    EventFunction,
    Integrator,
    available,
    compile_function,
    heyoka,
)
from spherekit.symbolic.expression_graph import TermFunction, derivatives, in_order
from spherekit.velocities.axis_rotations import pair_rotations
from spherekit.velocities.dyad_expressions import COMPILED
from spherekit.velocities.load_expressions import steep_arguments

LOOSEST = 1e-12
"""Largest tolerance of a step.

A larger one saves little, for the order of the series grows with the digits, not the
number of steps; and crossings of curves need closed configurations to be seen.
"""

COARSEST = 1e-7
"""Largest tolerance of a step of several freedoms, whose runs end well before a crossing
to go on with `LOOSEST`."""


class EquationArguments(NamedTuple):
    """The arguments of `compiled_equation`, by which an equation is compiled again.

    An equation is pickled as its arguments. Whoever loads it compiles it again, or uses the
    equation that this process has compiled before.
    """

    mechanism: Mechanism
    tolerance: float
    compact: bool
    coordinates: Sequence[str]
    values: Floats | None


@dataclass(frozen=True)
class CompiledEquation:
    """The compiled equation of motion of a mechanism with its loads and joint limits.

    The state of the integrator is the pair variables less whole turns, the momenta in
    their unit, and the work of each load in the square of that unit. `tau` gives the
    homogeneous rates of all variables by each coordinate, and the measure that vanishes
    where sets of configurations cross. `conditions` gives
    what the switches depend on, then its rates by time, from the state, the time and all
    parameters. `steep` gives from the same the rates of the momenta, then the arguments at
    whose zeros and turns loads may change faster than a series shows, None where no load
    does; `tolerance` is that of a step. The integrator holds the state of a run, so `lock`
    is held while one lasts; the functions may be called by several threads at once.
    """

    layout: ParameterLayout
    integrator: Integrator
    tau: TermFunction
    conditions: TermFunction | None
    steep: TermFunction | None
    tolerance: float
    arguments: EquationArguments = field(repr=False, compare=False)
    lock: Lock = field(default_factory=Lock, repr=False, compare=False)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the arguments only, since machine code and locks do not pickle."""
        return _compile_again, (self.arguments,)

    def rates(self, values: Floats) -> Floats:
        """Return the homogeneous rates (n, m, variables) at variables (n, variables)."""
        columns: Floats = self.tau(values.T)
        return columns[:-1].T.reshape(-1, self.layout.freedoms, self.layout.variables)

    def measure(self, values: Floats) -> Floats:
        """Return (n,) what vanishes where sets of configurations cross."""
        return self.tau(values.T)[-1]


def compiled_equation(
    mechanism: Mechanism,
    tolerance: float,
    compact: bool = True,
    coordinates: Sequence[str] = (),
    values: Floats | None = None,
) -> tuple[CompiledEquation, bool]:
    """Return the equation of a mechanism, and whether it had been compiled before.

    Parameters
    ----------
    mechanism
        All its loads act. Of one freedom its first input is the input. The values of torque
        tables and joint limits are set for each run, so mechanisms that differ in them only
        share one equation.
    tolerance
        Error of each step, in states of size one, at most `LOOSEST`, of several freedoms
        `COARSEST`.
    compact
        heyoka's compact mode: compiles faster, runs slower.
    coordinates, values
        Of several freedoms the R pairs whose variables it is integrated by, and a closed
        configuration (variables,) at which these say how all variables move.

    Raises
    ------
    EngineError
        If the mechanism cannot be compiled.
    PlanError
        If the coordinates are not independent.
    """
    _need_written(mechanism)
    common, step, request = _request(mechanism, tolerance, compact, coordinates)
    held = [mechanism.angles[pair] for pair in mechanism.input_pairs]
    fresh: list[bool] = []

    def make() -> CompiledEquation:
        fresh.append(True)
        system = (
            one_freedom(common)
            if values is None
            else several_freedoms(common, values, held)
        )
        arguments = EquationArguments(common, tolerance, compact, coordinates, values)
        return _compile(common, system, step, compact, arguments)

    return COMPILED.get(common, request, make), not fresh


def _compile_again(arguments: EquationArguments) -> CompiledEquation:
    equation, _ = compiled_equation(*arguments)
    return equation


def compiling_time(
    mechanism: Mechanism, tolerance: float, compact: bool, coordinates: Sequence[str] = ()
) -> float:
    """Return about how long `compiled_equation` will take (s), 0 where it is kept.

    Fitted to the shipped mechanisms with up to ten loads, on one core; half and twice as
    much occur. Machine code that heyoka has kept on disk takes less and is not noticed.

    Raises
    ------
    EngineError
        If heyoka is not installed, or a profile cannot be compiled.
    """
    _need_written(mechanism)
    pair_rotations(mechanism)
    if not available():
        heyoka()
    common, _, request = _request(mechanism, tolerance, compact, coordinates)
    if COMPILED.known(common, request):
        return 0.0
    variables = len(mechanism.variable_names)
    on_links = sum("pair" not in load.keys for load in mechanism.loads)
    at_pairs = len(mechanism.loads) - on_links
    if compact:
        more = 0.5 if coordinates else 0.0
        return more + max(0.22 * variables - 0.55, 0.3) + 0.07 * on_links + 0.02 * at_pairs
    plain = 0.36 if coordinates else 0.06
    return plain * variables**2 * (1.0 + 0.25 * on_links + 0.03 * at_pairs)


def _need_written(mechanism: Mechanism) -> None:
    """Raise `EngineError` where a load is no expression of the state."""
    for load in mechanism.loads:
        if isinstance(load, PairTorque) and callable(load.torque):
            raise EngineError(not_written(load.pair))
        if isinstance(load, BearingFriction) and load.grip > 0.0:
            raise EngineError(
                f"{mechanism.name}: the friction of loads.{load.name} follows from the "
                f"reaction of pair {load.pair}, which Taylor series do not solve for",
                "NumPy's engine does",
            )


def _request(
    mechanism: Mechanism, tolerance: float, compact: bool, coordinates: Sequence[str]
) -> tuple[Mechanism, float, str]:
    """Return what `_common` does, the tolerance of a step, and what is asked for."""
    step = min(tolerance, COARSEST if coordinates else LOOSEST)
    asked = repr(("motion", step, compact, mechanism.input_pairs))
    return _common(mechanism, coordinates), step, asked


def _common(mechanism: Mechanism, coordinates: Sequence[str]) -> Mechanism:
    """Return the mechanism without what is set for each run, driven at its coordinates."""
    if coordinates and tuple(coordinates) != mechanism.input_pairs:
        mechanism = mechanism.with_inputs(*coordinates)
    tables = any(isinstance(load, TorqueTable) for load in mechanism.loads)
    if not tables and not mechanism.joint_limits:
        return mechanism
    return replace(
        mechanism,
        loads=tuple(
            replace(load, times=(0.0, 1.0), torques=(0.0, 0.0), periodic=False)
            if isinstance(load, TorqueTable)
            else load
            for load in mechanism.loads
        ),
        joint_limits=tuple(
            JointLimit(stop.pair, -1.0, 1.0) for stop in mechanism.joint_limits
        ),
    )


def _compile(
    mechanism: Mechanism,
    system: System,
    tolerance: float,
    compact: bool,
    equation_arguments: EquationArguments,
) -> CompiledEquation:
    layout = system.layout
    equations = [*zip(layout.state, system.changes, strict=True)]
    arguments = dict.fromkeys(
        argument
        for load in mechanism.loads
        for argument in steep_arguments(load, system.moving)
    )
    moved = {*layout.variable_terms, *layout.momentum_terms}
    events = [
        event
        for event in (*system.events, *stop_events(mechanism, layout))
        if moved & {*in_order([event.expression])}
    ]
    count = len(layout.conditions)
    parameters = [constant(k) for k in range(layout.side + count)]
    given = [*layout.state, MOMENT, *parameters]
    conditions = None
    if count:
        rates = derivatives(layout.conditions, dict(equations) | {MOMENT: 1.0})
        conditions = compile_function([*layout.conditions, *rates], given, compact=True)
        events += [
            EventFunction(
                condition,
                "switch",
                switch=layout.side + which,
                sticks=_sticking(conditions, which, layout),
            )
            for which, condition in enumerate(layout.conditions)
        ]
    steep = None
    if arguments:
        looked_at = [*system.changes[layout.momenta], *arguments]
        steep = compile_function(looked_at, given, compact=True)
    homogeneous = [*chain(*system.tau), system.measure]
    return CompiledEquation(
        layout,
        Integrator(equations, MOMENT, parameters, tolerance, compact, events),
        compile_function(homogeneous, layout.variable_terms, compact=True),
        conditions,
        steep,
        tolerance,
        equation_arguments,
    )


def _sticking(
    conditions: TermFunction, which: int, layout: ParameterLayout
) -> Callable[[Floats, float, Floats], bool]:
    """Return whether a condition, now of its new sign, goes back at once."""

    def stuck(state: Floats, time: float, constants: Floats) -> bool:
        row = np.concatenate([state, [time], constants])[:, None]
        sides = constants[layout.side :]
        return bool(conditions(row)[len(sides) + which, 0] * sides[which] < 0.0)

    return stuck
