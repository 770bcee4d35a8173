"""The motion of a mechanism under its loads in balls: a reference for simulations.

In each step a pair variable that moves fast is the coordinate c. With the equivalent
inertia B and the generalised force Q by c, Eksergian's equation (Di Gregorio 2024, eq. (9))
is

    dc/dt = p / sqrt(B),   dp/dt = Q / sqrt(B),

where p = sqrt(B) dc/dt. The square of p is twice the kinetic energy. In each step dc/dt and
dp/dt are Legendre series through Gauss nodes. They are found by Picard's iteration, which
starts from a float64 solution. Each sweep of the iteration also closes the loops once more,
by a Newton step with c held.

Loads that are not smooth have *switches*: each `abs`, `sign`, `min` and `max` depends on
the sign of a condition. Within a step every switch is held on one side, so that the load is
smooth. A step ends where a condition changes its sign.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.polynomial.legendre import legint, legvander

from spherekit.arrays import Array, Floats
from spherekit.errors import EngineError
from spherekit.mechanism.load import LoadComponent, TorqueTable, require_expression
from spherekit.mechanism.load_expression import ARRAY_OPERATIONS, NON_SMOOTH_FUNCTIONS, fold
from spherekit.mechanism.mechanism import Mechanism
from spherekit.proof.ball_forces import equivalent_inertia, interpolate_table
from spherekit.proof.ball_frames import exact_ball, exact_balls
from spherekit.proof.balls import (
    Ball,
    Digits,
    centre_floats,
    exact_centres,
    flint_library,
    power_series,
    series_coefficient,
)
from spherekit.proof.linkage import (
    Linkage,
    LoopClosure,
    angular_velocities,
    left_inverses,
)
from spherekit.status import Status

MAX_PICARD_SWEEPS = 40
"""Largest number of sweeps of Picard's iteration; a step that needs more is too long.

Larger: longer steps succeed, with many sweeps. Smaller: more steps are repeated.
"""

CHEAP_SWEEPS = 15
"""Number of sweeps beyond which the next step is shorter.

Larger: fewer and longer steps with more sweeps each. Smaller: more and shorter steps.
"""

CHEAP_STEP_GROWTH = 1.05
"""Length of the next step over the length of a step with few sweeps.

Larger: more steps are too long. Smaller: steps stay short after a difficult part.
"""

COSTLY_STEP_REDUCTION = 0.8
"""Length of the next step over the length of a step with many sweeps or a large error.

Larger: more steps stay costly. Smaller: steps become shorter than necessary.
"""

MAX_TRUNCATION_ROUNDINGS = 16
"""Largest size of the last terms of a step, in roundings.

Larger: longer steps with larger errors. Smaller: shorter steps, whose roundings add up.
"""

CONVERGED_ROUNDINGS = 2
"""Change of the last sweep, in roundings, below which the iteration has converged.

Larger: larger errors. Smaller: rounding hides the convergence.
"""

STAGNATION_ROUNDINGS = 1e5
"""Change of a sweep, in roundings, below which a change that no longer shrinks is rounding.

Larger: a slow iteration may count as converged. Smaller: ill-conditioned steps fail.
"""

MIN_SWEEPS_TO_STAGNATE = 10
"""First sweep in which a change that no longer shrinks may count as rounding.

Before it, the iteration may not have begun to converge.
"""

MIN_STEP_RATIO = 1e-10
"""Shortest step, over the whole time; if a shorter one were needed the motion fails.

Larger: more motions fail. Smaller: failing takes more steps.
"""

COORDINATE_CHANGE_RATIO = 1.5
"""Rate of another variable, per unit rate of the coordinate, that makes it the coordinate.

Larger: longer series near singularities of the coordinate. Smaller: frequent changes.
"""

SWITCH_SAMPLES_PER_NODE = 4
"""Number of samples, for each node of a step, at which the signs of conditions are seen.

Larger: two sign changes that are closer are noticed. Smaller: less evaluation.
"""

FloatSolution = Callable[[Floats], tuple[Floats, Floats]]
"""Returns an approximate solution at times (n,) s.

The results are the variables (n, variables) rad, whole turns included, and their rates (n,
variables) in rad/s.
"""

EndKind = Literal["time", "joint_limit", "sticking"]
"""Why a motion ends: the requested time, a joint limit, or a load such as dry friction that
would reverse it at once."""

SwitchSides = Floats | None
"""Side (switches,) of each switch: the sign, +1 or -1, that its condition has in a step.
None if the sides are not chosen yet: each then follows from the value of the condition."""

JOINT_LIMIT_SWITCH = -1
"""Number that stands for a joint limit among the numbers of switches."""


def find_table_kinks(parts: Sequence[LoadComponent], until: float) -> list[Ball]:
    """Return the times (s) between 0 and `until` at which tables of torques have kinks.

    Time steps must end there, since their series need smooth loads. A table is piecewise
    linear in time, with kinks at its listed times, which can repeat periodically. Times are
    balls (numbers of many digits with a bound of their error) with the bound 0.
    """
    times: list[Ball] = []
    for table in (part.magnitude for part in parts):
        if isinstance(table, TorqueTable):
            table_times = exact_balls(table.times)
            period = table_times[-1] - table_times[0]
            # `longest_shift` is an upper bound of the distance, forwards or backwards, from
            # a listed time to any time between 0 and `until`. A few periods more than
            # necessary do no harm, as times outside are left out below.
            period_count = 0
            if table.periodic:
                longest_shift = until + np.max(np.abs(table.times))
                period_count = int(longest_shift / float(period)) + 1
            for number in range(-period_count, period_count + 1):
                # A time step ends at an exact time, so the centres of the balls are used.
                times.extend(exact_centres(table_times + number * period))
    # Times with equal float64 numbers are listed once.
    kinks = {float(t): t for t in times if 0.0 < float(t) < until}
    return sorted(kinks.values(), key=float)


@dataclass(frozen=True)
class MovingMechanism:
    """A mechanism at n configurations, with the velocities of its motion.

    The coordinate is the pair variable that describes the motion; all other variables
    follow from it. Rates and angular velocities are those at unit rate of the coordinate.
    The generalised force of the loads is computed from them.

    Attributes
    ----------
    values
        (n, variables) pair variables (rad), whole turns included.
    rates
        (n, variables) rates of the variables.
    w
        (n, links, 3) angular velocities of the links in ground axes.
    rotations
        (n, links, 3, 3) rotations from link axes to ground axes.
    """

    values: Array
    rates: Array
    w: Array
    rotations: Array


@dataclass(frozen=True)
class _CoordinateState:
    """A mechanism at n nearly closed configurations, as needed for its equation of motion.

    The coordinate c is the pair variable that describes the motion; all other variables
    follow from it.

    Attributes
    ----------
    moving
        Configurations, and rates at unit rate of the coordinate.
    root_inertia
        (n,) square root of the equivalent inertia B of the coordinate. The equations of
        motion contain it: dc/dt = p / sqrt(B) and dp/dt = Q / sqrt(B), with the generalised
        force Q and p = sqrt(B) dc/dt.
    closing_step
        (n, variables) Newton step (rad) that closes the loops with a constant coordinate.
    """

    moving: MovingMechanism
    root_inertia: Array
    closing_step: Array


@dataclass(frozen=True)
class _CoordinateSeries:
    """The motion of a mechanism during one time step, as two polynomials in time.

    The mechanism has one degree of freedom. The first polynomial is the coordinate c: the
    angle of one pair, from which all other angles follow. The second one is p = sqrt(B)
    dc/dt with the equivalent inertia B, so that p^2 / 2 is the kinetic energy. The time x
    runs from -1 at the start of the step to 1 at its end.

    Attributes
    ----------
    coefficients
        (terms, 2) Legendre coefficients of c (rad) and of p, as functions of x.
    """

    coefficients: Array

    def evaluate(self, x: Array) -> Array:
        """Return c (rad) and p, (2, n), at times x (n,) from -1 to 1."""
        # Numbers are balls: a centre with a bound of the rounding error as radius. This
        # bound does not include the error of the missing terms of the series. It would
        # promise too much, so the balls of the result have the radius 0.
        return exact_centres(_evaluate_series(self.coefficients, x).T)


@dataclass(frozen=True)
class _EndCondition:
    """A quantity that is positive while a time step is valid; the step ends at its zero.

    One example is the angle between a joint and its limit. A second example is a load with
    a switch: a function such as `sign` or `abs`, which depends on the sign of its argument.
    The step is computed as if this sign did not change. The quantity is the argument,
    multiplied by its sign at the start. The step is valid as long as this is positive.

    Attributes
    ----------
    switch
        Index of the switch in the loads. `JOINT_LIMIT_SWITCH` if the quantity belongs to a
        joint limit.
    coefficients
        (terms,) Legendre coefficients of the quantity as a function of time, which runs
        from -1 at the start of the step to 1 at its end.
    """

    switch: int
    coefficients: Array


@dataclass(frozen=True)
class _StepConvergence:
    """How well the computation of a time step has converged.

    The motion is a series in time with a limited number of terms, found by Picard's
    iteration. Both numbers decide the length of the next step.

    Attributes
    ----------
    truncation_roundings
        Estimated error by the missing terms, as a multiple of the rounding error.
    picard_sweeps
        Number of repetitions (sweeps) of the iteration.
    """

    truncation_roundings: float
    picard_sweeps: int


@dataclass(frozen=True)
class _TimeStep:
    """The computed motion of a mechanism in one time step.

    The motion is a series in time, which needs smooth loads. A load can contain `sign`,
    `abs`, `min` or `max`, as in dry friction. Each of these functions, a switch, has a
    fixed sign in the step: abs(u) is u or -u. So the step must end where u changes its
    sign.

    Attributes
    ----------
    start, length
        Start and length in time (s).
    coordinate
        Index of the variable c that is stored. All other variables follow from it.
    motion
        The series of c and of sqrt(B) dc/dt, with the equivalent inertia B.
    switch_signs
        (switches,) +1 or -1, the fixed sign of each switch.
    end_conditions
        What ends the step: sign changes of switches, and joint limits.
    convergence
        How well the computation converged.
    """

    start: Ball
    length: Ball
    coordinate: int
    motion: _CoordinateSeries
    switch_signs: Floats
    end_conditions: list[_EndCondition]
    convergence: _StepConvergence


@dataclass(frozen=True)
class _SignChange:
    """The first sign change of a condition in a time step.

    A condition is a function that is positive while the step is valid. A condition belongs
    to a joint limit, or to a switch: a part of a load with two cases, such as the two
    directions of dry friction. Without a sign change, an object of this class stands for
    the end of the step.

    Attributes
    ----------
    x
        Time in the step, from -1 at its start to 1 at its end, as a ball (a number with a
        bound of its error).
    switch
        Index of the switch, -1 for a joint limit. None at the end of the step.
    is_at_start
        Whether the condition is negative already at the first examined time after the
        start.
    """

    x: Ball
    switch: int | None
    is_at_start: bool

    def change_sides(self, sides: Floats) -> Floats:
        """Return the sides (switches,), +1 or -1, after the sign change.

        `sides` (switches,) are those before it. A joint limit and the end of the step
        change none.
        """
        changed = sides.copy()
        if self.switch is not None and self.switch != JOINT_LIMIT_SWITCH:
            changed[self.switch] = -changed[self.switch]
        return changed


def _evaluate_series(coefficients: Array, x: Array) -> Array:
    """Return values (n, ...) of Legendre series at positions x (n,) in [-1, 1].

    `coefficients` (count, ...) begin with degree 0. `legval` of NumPy is not used, since it
    rounds its factors to float64.
    """
    return legvander(x, len(coefficients) - 1) @ coefficients


def _integrate_series(coefficients: Array) -> Array:
    """Return the Legendre series of the integrals from -1."""
    integral = legint(coefficients)
    integral[0] -= _evaluate_series(integral, exact_balls([-1.0]))[0]
    return integral


class ExactSimulation:
    """The motion of a mechanism with one degree of freedom under its loads.

    The motion is computed with many digits, as a reference for float64 simulations. In each
    time step one pair variable, the coordinate c, and p = sqrt(B) dc/dt are series in time.
    B is the equivalent inertia: twice the kinetic energy is B (dc/dt)^2.

    Attributes
    ----------
    arithmetic, mechanism, until
        The parameters as given.
    end
        The time (s) at which the motion ended.
    kind
        Why it ended: at the requested time, at a joint limit, or because a load such as dry
        friction would reverse it at once.
    switches
        The times (s) at which `abs`, `sign`, `min` or `max` in loads change sides.

    Raises
    ------
    EngineError
        If no step is short enough, or if a configuration is singular with its coordinate
        locked. At the start the coordinate is the driven variable.
    """

    def __init__(
        self,
        arithmetic: Digits,
        mechanism: Mechanism,
        driven: int,
        q: float,
        dq: float,
        until: float,
        float_solution: FloatSolution,
    ) -> None:
        """Prepare the nodes and matrices of the series, and compute the motion.

        In each step one pair variable, the coordinate c, and p = sqrt(B) dc/dt are Legendre
        series in time, with the equivalent inertia B. They are computed from values at
        Gauss nodes.

        Parameters
        ----------
        arithmetic
            The number of digits.
        mechanism
            A mechanism with masses. All its loads act.
        driven, q, dq
            The variable for which the value q (rad) and rate dq (rad/s) at t = 0 are given
            exactly.
        until
            The time (s) at which the motion ends, unless it ends earlier.
        float_solution
            A float64 solution of the same motion, as a function of time. The iteration of
            each step and Newton's method start from its values.
        """
        self.arithmetic = arithmetic
        self.mechanism = mechanism
        self.until = until
        self._float_solution = float_solution
        # Largest |p| so far. Changes of p that are tiny against it count as rounding.
        self._largest_p = 0.0
        self._steps: list[_TimeStep] = []
        self.switches: list[Ball] = []
        self.kind: EndKind = "time"
        with arithmetic.within():
            self.end = exact_ball(0.0)
            self._linkage = Linkage(mechanism)
            self._load_parts = [
                part for load in mechanism.loads for part in load.components(mechanism)
            ]
            # Gauss nodes in [-1, 1] in rising order, and their weights. More digits have
            # more nodes, and so more terms of the series.
            count = 10 + arithmetic.digits
            self._node_count = count
            legendre_root = flint_library().arb.legendre_p_root
            nodes_and_weights = [
                legendre_root(count, k, weight=True) for k in range(count)[::-1]
            ]
            self._nodes, weights = exact_centres(np.array(nodes_and_weights)).T
            # Two (nodes, nodes) matrices that multiply values at the nodes: the first gives
            # the Legendre coefficients, the second the integrals from -1 to each node. The
            # coefficient of degree n is (n + 1/2) times the integral of value and
            # polynomial, which Gauss quadrature gives.
            polynomials = legvander(self._nodes, count - 1) * (np.arange(count) + 0.5)
            self._to_series = exact_centres((polynomials * weights[:, None]).T)
            self._to_integrals = exact_centres(
                _evaluate_series(_integrate_series(self._to_series), self._nodes)
            )
            # Positions at which the signs of conditions are examined. A condition is the
            # term with the sign that decides the value of `abs`, `sign`, `min` or `max` in
            # a load.
            sample_count = SWITCH_SAMPLES_PER_NODE * count + 1
            self._samples = np.linspace(-1.0, 1.0, sample_count)
            self._run(driven, q, dq)

    def at(self, t: Floats) -> Array:
        """Return the variables and their first two time derivatives, at n times.

        The motion consists of time steps, and each time is evaluated in its step. Numbers
        are balls (many digits, with a bound of their error).

        Parameters
        ----------
        t
            (n,) times (s) from 0 to the end. Later times count as the end.

        Returns
        -------
        (3, n, variables) balls: variables (rad), rates (rad/s), accelerations (rad/s2).
        Variables include whole turns, so that they can exceed 2 pi.
        """
        t = np.asarray(t, dtype=float)
        with self.arithmetic.within():
            times = np.where(t >= float(self.end), self.end, exact_balls(t))
            # float64 is enough to find the step of each time.
            later_starts = [float(step.start) for step in self._steps[1:]]
            step_numbers = np.searchsorted(later_starts, t, side="right")
            shape = 3, len(t), len(self.mechanism.variable_owners)
            states: Array = np.empty(shape, dtype=object)
            for number in np.unique(step_numbers):
                rows = step_numbers == number
                states[:, rows] = self._evaluate_step(self._steps[number], times[rows])
        return states

    def _evaluate_step(self, step: _TimeStep, t: Array) -> list[Array]:
        """Return the variables and their first two derivatives at n times within a step.

        The step stores two functions of time: the coordinate c (the variable that describes
        the motion), and p = sqrt(B) dc/dt with the equivalent inertia B. In c and p, the
        equation of motion is dp/dt = Q / sqrt(B), without a derivative of B; Q is the
        generalised force. Closing the loops gives all other variables.

        Parameters
        ----------
        step
            The step, with the series of the coordinate and of p.
        t
            (n,) times (s).

        Returns
        -------
        Three arrays (n, variables): rad, rad/s, rad/s2.
        """
        # 1. The coordinate c and p at positions from -1 to 1 in the step, and all other
        #    variables.
        position = 2 * (t - step.start) / step.length - 1
        c, p = step.motion.evaluate(position)
        # All other variables follow from c by Newton's method. It starts from the float64
        # solution of the same motion, which was given when this simulation was created.
        closure = self._close_loops(t, c, step.coordinate)
        # Power series of all variables in the coordinate. The second coefficient is half of
        # the second derivative.
        values, first, half_second = self._linkage.expand_motion(
            closure, step.coordinate, 2
        )
        orientations, _ = self._linkage.place_links(
            power_series(values, first, half_second)
        )

        # 2. Angular velocities w at unit rate of the coordinate, and the inertia B. dw and
        #    dB are derivatives with respect to the coordinate. Then dc/dt.
        w, dw = angular_velocities(orientations, 2)
        rotations = series_coefficient(orientations, 0)
        B, dB = equivalent_inertia(self.mechanism, rotations, w, dw)
        speed = p / np.sqrt(B)

        # 3. The generalised force Q of the loads. Torque tables over time are piecewise
        #    linear. A time in the middle of the step selects the piece that is valid in the
        #    step. Signs in loads, such as that of dry friction, are constant in a step
        #    (`switch_signs`).
        time_inside = float(step.start + step.length / 2)
        moving = MovingMechanism(values=values, rates=first, w=w, rotations=rotations)
        force, _ = self._generalised_force(moving, speed, t, step.switch_signs, time_inside)

        # 4. Acceleration by Eksergian's equation B c'' + (dB/dc) c'^2 / 2 = Q.
        acceleration = (force - dB * speed * speed / 2) / B

        # 5. The derivatives of all variables with respect to time, by the chain rule.
        rates = first * speed[:, None]
        second_rates = (
            first * acceleration[:, None] + 2 * half_second * (speed * speed)[:, None]
        )
        return [values, rates, second_rates]

    def _generalised_force(
        self,
        moving: MovingMechanism,
        speed: Array,
        t: Array,
        sides: SwitchSides,
        time_inside: float,
    ) -> tuple[Array, list[Array]]:
        """Return the generalised force of the loads, and the conditions of their switches.

        The coordinate is the pair variable by which the motion is described. A load has a
        magnitude (a table or an expression) and a velocity with which it does work, such as
        the rate of a pair. The generalised force is the sum over all loads of the magnitude
        times this velocity per unit rate of the coordinate. A switch is an `abs`, `sign`,
        `min` or `max` in an expression. Its condition is the term with the deciding sign.
        Each switch stays on a fixed side, so that the load is smooth.

        Parameters
        ----------
        moving
            The mechanism at n configurations.
        speed
            (n,) time derivative of the coordinate (rad/s).
        t
            (n,) times (s).
        sides
            (switches,) side of each switch: the sign, +1 or -1, that its condition counts
            as having at all times. None for the sign of its value at each time.
        time_inside
            A time (s) between the two kinks of tables around all `t`.

        Returns
        -------
        force
            (n,) generalised force by the coordinate (N m).
        conditions
            For each condition its values (n,), in the order in which expressions are
            evaluated.
        """
        variables = self.mechanism.angles
        conditions = list[Array]()
        force = exact_balls(np.zeros(len(t)))

        def evaluate_name(name: str) -> Any:
            """Return (n,) the time, a pair angle or the time derivative of a pair angle.

            These are the quantities in the expressions of loads, at n times. The names are
            "t", and "theta_" (angle) or "dtheta_" (rate) followed by the pair.
            """
            kind, _, pair = name.partition("_")
            if kind == "t":
                return t
            if kind == "theta":
                return moving.values[:, variables[pair]]
            return moving.rates[:, variables[pair]] * speed

        def take_side(condition: Array) -> Any:
            """Record the condition (n,) of the next switch, and return its side.

            A switch is a function such as `abs` in a load. The load is computed as if the
            condition had the sign of this side, +1 or -1, at all times. So the load is
            smooth within a step. If `sides` is None, the present signs are returned.
            """
            number = len(conditions)
            conditions.append(np.atleast_1d(condition))
            return np.sign(centre_floats(condition)) if sides is None else sides[number]

        def apply_function(name: str, arguments: Sequence[Any]) -> Any:
            """Return the value of a function in an expression, for balls (n,) or one."""
            if name in NON_SMOOTH_FUNCTIONS:
                return _apply_non_smooth_function(name, arguments, take_side)
            return _apply_smooth_function(name, arguments)

        for part in self._load_parts:
            if isinstance(part.magnitude, TorqueTable):
                magnitude = interpolate_table(part.magnitude, t, time_inside)
            else:
                root = require_expression(part.magnitude).root
                magnitude = fold(root, exact_ball, evaluate_name, apply_function)
            # Velocities with which the magnitude does work, per rate of the coordinate.
            rates = [moving.rates[:, variables[part.pair]]] if part.pair else []
            for moment in part.moments:
                link = self.mechanism.link_number[moment.link]
                velocity = moving.w[:, link]
                rotation = moving.rotations[:, link]
                if moment.arm is not None:
                    # A force at a point: it does work with the velocity of the point.
                    velocity = np.cross(velocity, rotation @ exact_balls(moment.arm))
                direction = exact_balls(moment.direction)
                if moment.axes == "link":
                    direction = rotation @ direction
                rates.append(np.sum(velocity * direction, axis=1))
            force = force + magnitude * sum(rates)
        return force, conditions

    def _close_loops(self, t: Array, c: Array, coordinate: int) -> LoopClosure:
        """Return the closed configurations at given values of the coordinate.

        The coordinate is the variable that describes the motion. Newton's method computes
        the other variables in many digits. It starts from a float64 solution of the same
        motion (`float_solution` of `__init__`). The caller needs the variables to place the
        links and to compute velocities.

        The results are stored as balls (numbers with a bound of their error), but these
        bounds are not computed here.

        Parameters
        ----------
        t
            (n,) times (s), at which the float64 solution gives the starts.
        c
            (n,) values of the coordinate (rad).
        coordinate
            Index of the variable that is the coordinate.

        Raises
        ------
        EngineError
            If a configuration is singular with the coordinate locked.
        """
        values = exact_balls(self._float_solution(centre_floats(t))[0])
        values[:, coordinate] = c
        # Newton's method stops at the rounding error of the present number of digits.
        closure = self._linkage.close_loops(
            values, held=[coordinate], eps=self.arithmetic.eps
        )
        if np.any(closure.status != Status.OK):
            raise EngineError(
                f"{self.mechanism.name}: in a configuration of the motion, variable "
                f"{self.mechanism.variable_names[coordinate]} does not determine the other "
                "variables; start from a configuration beside the present start"
            )
        return closure

    def _evaluate_coordinate(self, values: Array, coordinate: int) -> _CoordinateState:
        """Return how a mechanism moves with its coordinate, at n configurations.

        The coordinate is the variable that describes the motion. The result contains what
        the equation of motion needs. All numbers are balls (numbers with a bound of their
        error).

        Parameters
        ----------
        values
            (n, variables) pair variables (rad). The loops are nearly closed.
        coordinate
            Index of the variable that is the coordinate.

        Returns
        -------
        Rates of all variables and links at unit rate of the coordinate, and the Newton
        steps that close the loops. Also sqrt(B), with the equivalent inertia B: twice the
        kinetic energy at unit rate. The motion is computed from p = sqrt(B) times the rate.
        """
        linkage = self._linkage
        orientations, residuals = linkage.place_links(values)
        vectors = linkage.variable_vectors(values, orientations)
        rates, closing_step = _solve_free_variables(
            linkage.jacobian(vectors), residuals, coordinate
        )
        w = linkage.link_velocities(vectors, rates)
        B = self._inertia_of_coordinate(orientations, w)
        moving = MovingMechanism(values=values, rates=rates, w=w, rotations=orientations)
        return _CoordinateState(moving, np.sqrt(B), closing_step)

    def _inertia_of_coordinate(self, orientations: Array, w: Array) -> Array:
        """Return the equivalent inertia B (n,) of the coordinate c of the motion.

        The coordinate is the variable that describes the motion. The kinetic energy is B
        (dc/dt)^2 / 2.

        Parameters
        ----------
        orientations
            (n, links, 3, 3) rotations from link axes to ground axes.
        w
            (n, links, 3) angular velocities at unit rate of the coordinate.
        """
        # Only the derivative of B, which is not needed here, depends on dw.
        unused_dw = exact_balls(np.zeros(w.shape))
        B, _derivative = equivalent_inertia(self.mechanism, orientations, w, dw=unused_dw)
        return B

    def _run(self, driven: int, q: float, dq: float) -> None:
        """Compute all steps from the start to the end.

        A switch is a part of a load with two cases, such as dry friction, and the sign of
        its condition decides. A step ends at the first of four events: its length is over,
        a torque table has a kink, a condition changes its sign, or a joint reaches its
        limit. The results become attributes: the steps, the end, its kind, and the times of
        switches.

        Parameters
        ----------
        driven
            The variable with a given start value; it is the first coordinate.
        q, dq
            Its value (rad) and rate (rad/s) at t = 0.
        """
        coordinate = driven
        start = exact_balls([0.0])
        values = self._close_loops(start, exact_balls([q]), driven).values
        state = self._evaluate_coordinate(values, driven)
        p = state.root_inertia[0] * dq
        # Steps end at kinks of tables, so that loads are smooth within a step.
        targets = [
            *find_table_kinks(self._load_parts, self.until),
            exact_ball(self.until),
        ]
        sides: SwitchSides = None
        # Sides of the steps that have ended at the present end.
        tried_sides: list[tuple[float, ...]] = []
        length = exact_ball(self.until) / 16
        while targets:
            # 1. Choose the coordinate: a variable that moves much faster replaces it.
            rates = centre_floats(state.moving.rates[0])
            fastest = int(np.argmax(np.abs(rates)))
            if abs(rates[fastest]) > COORDINATE_CHANGE_RATIO:
                # |p| is the root of twice the kinetic energy for every coordinate.
                coordinate = fastest
                p = p if rates[fastest] > 0.0 else -p
            time_left = (targets[0] - self.end).mid()
            planned_length = length
            length = min(length, time_left)
            # 2. Compute a step, and halve its length until the series converge.
            step: _TimeStep | None = None
            while (
                step is None
                or step.convergence.truncation_roundings > MAX_TRUNCATION_ROUNDINGS
            ):
                shortest = min(MIN_STEP_RATIO * self.until, float(time_left))
                if float(length) < shortest:
                    raise EngineError(
                        f"{self.mechanism.name}: no step of the reference computation is "
                        f"short enough at {float(self.end):.6g} s; smooth the loads"
                    )
                step = self._try_step(values[0, coordinate], p, coordinate, length, sides)
                length = (length / 2).mid()
            # 3. Use the step up to its first sign change, or as a whole.
            sign_change = min(
                self._find_sign_changes(step),
                key=lambda change: float(change.x),
                # At the end of the step, if nothing changes its sign.
                default=_SignChange(x=exact_ball(1.0), switch=None, is_at_start=False),
            )
            switch = sign_change.switch
            sides = sign_change.change_sides(step.switch_signs)
            if not sign_change.is_at_start:
                tried_sides.clear()
            elif switch != JOINT_LIMIT_SWITCH and tuple(sides) in tried_sides:
                # Switches change back at once: the motion cannot continue on any side.
                self.kind = "sticking"
                break
            tried_sides.append(tuple(step.switch_signs))
            self._steps.append(step)
            (c,), (p,) = step.motion.evaluate(np.array([sign_change.x]))
            self._largest_p = max(self._largest_p, abs(float(p)))
            reaches_target = switch is None and step.length is time_left
            step_end = (step.start + step.length * (sign_change.x + 1) / 2).mid()
            self.end = targets.pop(0) if reaches_target else step_end
            # 4. The state from which the next step starts, and its length.
            values = self._close_loops(np.array([self.end]), c, coordinate).values
            state = self._evaluate_coordinate(values, coordinate)
            if switch == JOINT_LIMIT_SWITCH:
                self.kind = "joint_limit"
                break
            if switch is not None:
                self.switches.append(self.end)
            is_costly = (
                step.convergence.picard_sweeps > CHEAP_SWEEPS
                or step.convergence.truncation_roundings > 1.0
            )
            # A step that was cut at its target does not shorten the next one.
            length = planned_length if step.length is time_left else step.length
            length = (
                length * (COSTLY_STEP_REDUCTION if is_costly else CHEAP_STEP_GROWTH)
            ).mid()
        if not self._steps:
            raise EngineError(
                f"{self.mechanism.name}: the motion ends at its start time, so there is "
                "nothing to compare; start from another configuration"
            )

    def _try_step(
        self, c: Ball, p: Ball, coordinate: int, length: Ball, sides: SwitchSides
    ) -> _TimeStep | None:
        """Return a step from the present end, None if Picard's iteration does not converge.

        The equations for the coordinate c and p = sqrt(B) dc/dt are dc/dt = p / sqrt(B) and
        dp/dt = Q / sqrt(B), with the equivalent inertia B and the generalised force Q. Each
        sweep of Picard's iteration evaluates the right sides at all Gauss nodes of the step
        and integrates them again. A sweep includes one Newton step that closes the loops.

        Loads may contain switches: `abs`, `sign`, `min` or `max`. Each depends on the sign
        of one condition, which is constant in a step, +1 or -1: the side of the switch.

        Parameters
        ----------
        c, p
            The coordinate (rad) and p at the start of the step.
        coordinate
            Index of the variable that is the coordinate.
        length
            Length of the step (s).
        sides
            (switches,) side of each switch. None to use the sign that each condition has at
            the first Gauss node, just after the start of the step.
        """
        half = length / 2
        t = self.end + half * (self._nodes + 1)
        time_inside = float(self.end + half)
        # 1. Start: the float64 solution at the nodes. The coordinate is integrated from its
        # exact start.
        values, rates = map(exact_balls, self._float_solution(centre_floats(t)))
        speed = rates[:, coordinate]
        c_nodes = exact_centres(c + half * (self._to_integrals @ speed))
        values[:, coordinate] = c_nodes
        p_nodes: Array | None = None
        last_change = np.inf
        for sweep in range(1, MAX_PICARD_SWEEPS + 1):
            # 2. The right sides at the nodes.
            state = self._evaluate_coordinate(values, coordinate)
            moving = state.moving
            p_nodes = state.root_inertia * speed if p_nodes is None else p_nodes
            speed = p_nodes / state.root_inertia
            if sides is None:
                _, conditions = self._generalised_force(
                    moving, speed, t, sides=None, time_inside=time_inside
                )
                sides = np.array(
                    [np.sign(float(condition[0])) or 1.0 for condition in conditions]
                )
            force, conditions = self._generalised_force(
                moving, speed, t, sides, time_inside
            )
            p_rate = force / state.root_inertia
            # 3. Both equations are integrated once more, and the remaining variables follow
            # the change of the coordinate and the Newton step.
            new_c = exact_centres(c + half * (self._to_integrals @ speed))
            new_p = exact_centres(p + half * (self._to_integrals @ p_rate))
            values = exact_centres(
                values + state.closing_step + moving.rates * (new_c - c_nodes)[:, None]
            )
            values[:, coordinate] = new_c
            # 4. Largest change of this sweep, in roundings; the change of p is relative to
            # its size.
            p_scale = max(self._largest_p, _largest(new_p), abs(float(p))) or 1.0
            largest_change = max(
                _largest(new_c - c_nodes),
                _largest(state.closing_step),
                _largest(new_p - p_nodes) / p_scale,
            )
            change = largest_change / self.arithmetic.eps
            c_nodes = new_c
            p_nodes = new_p
            if not np.isfinite(change):
                return None
            has_stagnated = (
                sweep >= MIN_SWEEPS_TO_STAGNATE
                and last_change / 2 <= change <= STAGNATION_ROUNDINGS
            )
            if change <= CONVERGED_ROUNDINGS or has_stagnated:
                # 5. Converged: Legendre series of both rates, integrated from the start.
                rate_series = self._to_series @ np.stack([speed, p_rate], axis=1)
                series = half * _integrate_series(rate_series)
                series[0] += np.array([c, p])
                last_terms = max(
                    _largest(rate_series[-2:, 0]), _largest(rate_series[-2:, 1]) / p_scale
                )
                # Integration divides a term of degree n by about 2 n.
                roundings_per_term = (
                    float(half) / (2 * self._node_count) / self.arithmetic.eps
                )
                return _TimeStep(
                    start=self.end,
                    length=length,
                    coordinate=coordinate,
                    motion=_CoordinateSeries(series),
                    switch_signs=sides,
                    end_conditions=self._expand_conditions(conditions, sides, values),
                    convergence=_StepConvergence(
                        truncation_roundings=roundings_per_term * last_terms,
                        picard_sweeps=sweep,
                    ),
                )
            last_change = change
        return None

    def _expand_conditions(
        self, conditions: Sequence[Array], sides: Floats, values: Array
    ) -> list[_EndCondition]:
        """Return Legendre series that are positive as long as a time step is valid.

        A load can contain switches: `abs`, `sign`, `min` or `max`. Each depends on the sign
        of a term, its condition. The step is computed with a fixed sign, the side of the
        switch, so it is valid while the condition times the side is positive. Each joint
        limit gives two series: the distances from both ends of its range.

        Parameters
        ----------
        conditions
            For each condition its values (nodes,) at the Gauss nodes (times) of the step,
            or (1,) if it is constant.
        sides
            (switches,) the fixed sign of each condition, +1 or -1.
        values
            (nodes, variables) pair variables (rad) at these times.

        Returns
        -------
        The series, each with the index of its switch, -1 for joint limits.
        """
        # The factor of ones repeats a constant condition at all nodes.
        ones = np.ones(self._node_count)
        node_values: list[tuple[int, Array]] = [
            (number, condition * (side * ones))
            for number, (condition, side) in enumerate(zip(conditions, sides, strict=True))
        ]
        for limit in self.mechanism.joint_limits:
            angle = values[:, self.mechanism.angles[limit.pair]]
            node_values.append((JOINT_LIMIT_SWITCH, angle - limit.low))
            node_values.append((JOINT_LIMIT_SWITCH, limit.high - angle))
        return [
            _EndCondition(number, self._to_series @ value) for number, value in node_values
        ]

    def _find_sign_changes(self, step: _TimeStep) -> Iterator[_SignChange]:
        """Yield the first sign change of each condition that has one in a time step.

        A condition is a quantity that is positive while the step is valid. It says that a
        joint limit is not reached, or that a sign in a load, such as the sense of dry
        friction, is the one with which the step was computed. A condition is a Legendre
        series in time, from -1 at the start of the step to 1 at its end. The sign change is
        first found between samples in float64. Then bisection of this interval computes the
        change in all digits.

        A sign change in the first interval has `is_at_start` True. By this the caller finds
        out that signs change back at once, so that the motion cannot continue.
        """
        # The start itself is not examined. A condition that has just changed is nearly 0
        # there, with either sign.
        interval_starts = self._samples[:-1]
        interval_ends = self._samples[1:]
        for end_condition in step.end_conditions:
            coefficients = end_condition.coefficients
            values_at_ends = _evaluate_series(centre_floats(coefficients), interval_ends)
            is_negative = values_at_ends < 0.0
            if not np.any(is_negative):
                continue
            # The first interval with a negative condition at its end.
            interval = np.argmax(is_negative)
            yield _SignChange(
                x=self._bisect(
                    coefficients,
                    low=exact_ball(interval_starts[interval]),
                    high=exact_ball(interval_ends[interval]),
                ),
                # Index of the sign in a load that changes, -1 for a joint limit.
                switch=end_condition.switch,
                is_at_start=interval == 0,
            )

    def _bisect(self, coefficients: Array, low: Ball, high: Ball) -> Ball:
        """Return where a Legendre series becomes negative between two positions.

        The series is a condition that changes its sign during a time step. The caller needs
        the time of the change in all digits. The method is bisection. The result is the
        upper end of the last interval, so the series is negative there.

        Parameters
        ----------
        coefficients
            (terms,) coefficients of the series. All numbers are balls (numbers with a bound
            of their error); the bounds are not used.
        low, high
            Positions from -1 to 1. The series is negative at the higher one.
        """
        # Each halving gains one bit, and a decimal digit has less than 3.4 bits. Eight more
        # are for safety.
        for _ in range(int(3.4 * self.arithmetic.digits) + 8):
            middle = (low + high).mid() / 2
            if _evaluate_series(coefficients, np.array([middle]))[0].mid() < 0:
                high = middle
            else:
                low = middle
        return high


def _apply_non_smooth_function(
    name: str, arguments: Sequence[Any], take_side: Callable[[Array], Any]
) -> Any:
    """Return `abs`, `sign`, `min` or `max` with a fixed sign of the condition.

    The condition is the argument of `abs` and `sign`, or the difference of two arguments of
    `min` and `max`. With a fixed sign these functions are smooth. The motion, which is
    computed as a series, requires this.

    Parameters
    ----------
    name
        Name of the function.
    arguments
        The arguments in balls (numbers with a bound of their error), one or (n,) each.
    take_side
        Function that returns the fixed sign, +1 or -1, of the next condition. It takes the
        values of the condition, and is called in the order in which they are evaluated.
    """
    first = arguments[0]
    if name == "sign":
        # The power 0 gives 1 in the type of the argument, one number or (n,).
        return take_side(first) * first**0
    if name == "abs":
        return take_side(first) * first
    # max(a, b) = (a + b + side * (a - b)) / 2, where `side` is the sign of a - b; min(a, b)
    # has the opposite sign before `side`. Further arguments are compared one by one.
    sense = 1 if name == "max" else -1
    extreme = first
    for argument in arguments[1:]:
        difference = extreme - argument
        signed_difference = sense * take_side(difference) * difference
        extreme = (extreme + argument + signed_difference) / 2
    return extreme


def _apply_smooth_function(name: str, arguments: Sequence[Any]) -> Any:
    """Return the value of a smooth function or operation, NaN outside its domain.

    Smooth functions have no kinks or jumps. For example, `abs` is not smooth. Arguments are
    balls (numbers with a bound of their error). Functions such as `sin` are methods of
    single balls. Operations such as `+` accept arrays of balls.

    Parameters
    ----------
    name
        Name of the function or operation.
    arguments
        Its arguments. Each is one ball or an array (n,) of balls.
    """
    # Any ball shows which methods the class has.
    is_method_of_balls = hasattr(exact_ball(0.0), name)
    if not is_method_of_balls:
        return ARRAY_OPERATIONS[name](*arguments)

    def call_method(ball: Ball, *others: Ball) -> Ball:
        """Return the value for single balls, one of each argument."""
        return getattr(ball, name)(*others)

    # `frompyfunc` calls the method for each element of the arrays.
    return np.frompyfunc(call_method, len(arguments), 1)(*arguments)


def _solve_free_variables(
    jacobian: Array, residuals: Array, coordinate: int
) -> tuple[Array, Array]:
    """Return how all variables follow the coordinate, and the Newton steps to closed loops.

    The coordinate c is the variable that describes the motion; all other variables are
    free. The Jacobian of the closure equations has the parts J, of the free variables, and
    J_c, of c. At unit rate of c the loops stay closed if J (rates) + J_c = 0. At constant
    c, the Newton step solves J (step) + residuals = 0. With redundant equations J has more
    rows than columns, so its left inverse is used. Results have the type of balls (numbers
    with a bound of their error).

    Parameters
    ----------
    jacobian
        (n, equations, variables) derivatives of the closure equations.
    residuals
        (n, equations) errors of the closure equations (rad).
    coordinate
        Index of the coordinate among the variables.

    Returns
    -------
    rates
        (n, variables) rates at unit rate of the coordinate.
    closing_step
        (n, variables) Newton steps (rad), 0 for the coordinate.
    """
    n, _, variable_count = jacobian.shape
    free = [variable for variable in range(variable_count) if variable != coordinate]
    inverse, _condition = left_inverses(jacobian[:, :, free])
    rates = exact_balls(np.zeros((n, variable_count)))
    rates[:, coordinate] = exact_ball(1.0)
    rates[:, free] = -np.matvec(inverse, jacobian[:, :, coordinate])
    closing_step = exact_balls(np.zeros((n, variable_count)))
    closing_step[:, free] = -np.matvec(inverse, residuals)
    return rates, closing_step


def _largest(balls: Any) -> float:
    """Return the largest magnitude of an array of numbers, 0 if it is empty.

    The numbers are balls (numbers with a bound of their error). The bounds are ignored.
    """
    return np.max(np.abs(centre_floats(balls)), initial=0.0)
