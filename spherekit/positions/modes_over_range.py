"""Finds the assembly modes of a mechanism with one input and irreducible groups.

Modes are curves of configurations over the range of the input. All modes are computed at
one input in each interval between the inputs at which modes meet, if elimination applies;
otherwise some are found from random starts. Each new configuration is followed over the
range, as far as its mode reaches. If the mode ends inside the range, its configuration
curve is followed in arc length, and leads to further modes.

All configurations that the mechanism can reach without being taken apart form a component.
It is one curve and consists of one or more modes, because the input can turn back on it.
"""

from dataclasses import replace

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.completeness import Completeness, Guarantee
from spherekit.errors import PlanError, SolveError
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.angles import wrap
from spherekit.planning.mobility import graph_mobility, inputs_to_declare
from spherekit.positions.assembly_enumeration import (
    MAX_ASSEMBLY_MODES,
    RANGE_ROUNDS,
    can_find_all_modes,
    enumerate_assemblies,
    group_signs,
    random_starts,
    signs_at,
)
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.configuration_curve import ArcCurve
from spherekit.positions.configuration_space import monotone_pieces
from spherekit.positions.curve_continuation import MAX_CURVE_LENGTH_RAD, follow_arc
from spherekit.positions.curve_crossing import Crossing
from spherekit.positions.group_solutions import (
    CLOSED_FORM,
    RANDOM_SEARCH,
    SolutionMethod,
    all_complete,
    least_complete,
)
from spherekit.positions.input_grid import InputGrid
from spherekit.positions.input_turning_points import (
    RUN_COST_S,
    RUN_TIME_S,
    find_input_turning_points,
)
from spherekit.positions.mode_predictor import ModeCurve, follow_each
from spherekit.positions.modes_over_samples import REFERENCE_ONLY
from spherekit.positions.position_solver import PositionSolver
from spherekit.positions.random_search import SAME_MODE, SearchStatistics
from spherekit.progress import ProgressReporter
from spherekit.status import Status
from spherekit.wording import counted

MAX_STEPS_ALONG_MODES = 60000
"""Number of steps along modes after which no further mode is followed.

A mode takes some tens of steps, and thousands near configurations that are singular in
higher order. Larger: more modes of such mechanisms are found, in more time.
"""
PROBED_FRACTIONS = np.array([0.5, 0.3, 0.7, 0.1, 0.9])
"""Positions in the range at which the first mode of a mechanism with wheels is searched.

They are examined in this order, until a mode is found.
"""
PROBED_INTERVALS = 15
"""Number of intervals of the range in which modes are computed if meetings are unknown.

Larger: shorter modes are found, in more time.
"""
MAX_ROLLED_CURVE_LENGTH_RAD = 200.0
"""Length after which a curve is ended if the input does not determine how far wheels roll.

Such a curve need not close at all.
"""
MODE_DISTANCE_RAD = 1e-3
"""A configuration is compared with a mode only if it is nearer to the predicted one.

The difference of the two nodes around the prediction is added to this distance. Larger:
more modes are compared. Smaller: a known mode may be followed again.
"""
STARTS_FOLLOWED_TOGETHER = 16
"""Number of configurations, probably of different modes, that are followed together."""
RANDOM_STARTS_FOLLOWED_TOGETHER = 6
"""The same number for configurations from random starts, which can be on one mode."""
AS_ASSEMBLED = Completeness(
    Guarantee.COMPONENT,
    "the mode of the reference pose and the modes that continue it where it ends; other "
    "ways to mesh the wheels were not searched",
)


def check_mobility(solver: PositionSolver, mobility: int) -> None:
    """Raise `PlanError` unless a mobility by rank is the number of inputs."""
    mechanism = solver.mechanism
    input_count = len(solver.driven)
    if mobility != input_count:
        raise PlanError(
            f"{mechanism.name}: the mobility is {mobility} by the rank of the velocity "
            f"equations ({graph_mobility(mechanism)} by counting links and pairs), but the "
            f"number of inputs is {input_count}; {inputs_to_declare(mobility)}"
        )


class ModesOverRange:
    """The assembly modes of a mechanism over the range of its only input.

    The constructor runs the whole search.

    Parameters
    ----------
    solver
        The mechanism, which has one input and irreducible groups.
    input_grid
        The samples of the input. Their range counts.
    search
        Whether to search for modes other than the mode of the reference pose. They are also
        searched if there is no reference pose, or if its mode is not in the range.

    Attributes
    ----------
    assembly_modes
        The modes. The mode of the reference pose comes first.
    methods
        For each group of links the least complete method by which its configurations were
        computed at any input. None for a group whose configurations were computed at no
        input.
    claim
        How complete the modes are.
    probes
        Number of inputs at which modes were computed, plus the number of random starts.
    crossings
        Configurations at which curves cross, as far as they are known.

    Raises
    ------
    PlanError
        If the mobility by rank is not 1 in a mechanism with redundant constraints.
    """

    def __init__(self, solver: PositionSolver, input_grid: InputGrid, search: bool) -> None:
        """Search the assembly modes of a mechanism over the range of its input.

        An assembly mode is one of the ways to assemble the mechanism. Its configurations
        at increasing values of the input form a curve. The mode of the reference pose is
        followed first. All others are searched if `search` asks for them, if there is no
        reference pose, or if its mode is not in the range.
        """
        self.solver = solver
        self.input_grid = input_grid
        # Results. `claim` states how complete the modes are. `methods` has the method by
        # which the configurations of each group were computed; a group is a set of links
        # that are placed together. `probes` is the number of examined inputs.
        # At `crossings` curves of configurations cross.
        self.groups = solver.assembly.groups
        self.assembly_modes: list[AssemblyMode] = []
        self.methods: list[SolutionMethod | None] = [None] * len(self.groups)
        self.claim = REFERENCE_ONLY
        self.probes = 0
        self.crossings: tuple[Crossing, ...] = ()
        # Where a mode ends inside the range, the input turns back, and the configurations
        # continue as another mode of the same component. `_components` has the number of
        # the component of each mode. `_curves` has the curves that were followed in arc
        # length, through the turning points of the input.
        self._components: list[int] = []
        self._curves: list[ArcCurve] = []
        # The number of degrees of freedom at each start, from the rank of the velocity
        # equations. It is computed if a group has redundant constraints, because counting
        # links and pairs then gives a wrong number. Otherwise the list stays empty.
        self._mobilities: list[int] = []
        self._steps_along_modes = 0
        # The curves of so many modes, from the first one in `assembly_modes` on, were
        # already followed beyond the ends of the mode.
        self._extended_modes = 0
        self._progress = ProgressReporter("searching assembly modes")

        self._add_reference()
        if search or not self.assembly_modes:
            self.claim = self._search_all_modes()
        # A configuration from which a curve is followed must have one degree of freedom. If
        # there is no mode, the mechanism may have more or fewer degrees of freedom. An
        # error then says so. The least number is compared, because singular configurations
        # have more. If no number was computed, it is 1 by counting.
        if not self.assembly_modes:
            check_mobility(solver, min(self._mobilities, default=1))
        # Enough: the limit of modes, or of steps along them, is reached.
        if self._has_enough_modes:
            reason = (
                f"stopped at {counted(len(self.assembly_modes), 'mode')} after "
                f"{self._steps_along_modes} steps along them; there may be more"
            )
            self.claim = Completeness(Guarantee.SAMPLED, reason)

    @property
    def _has_enough_modes(self) -> bool:
        """Whether no further assembly mode is followed.

        This is so if there are `MAX_ASSEMBLY_MODES`, or if the modes so far have taken so
        many steps that the search would take too long.
        """
        count = len(self.assembly_modes)
        has_taken_long = self._steps_along_modes > MAX_STEPS_ALONG_MODES
        return count >= MAX_ASSEMBLY_MODES or (count > 0 and has_taken_long)

    @property
    def _has_free_wheels(self) -> bool:
        """Whether the input does not determine how far some wheels have rolled."""
        gear_phases = self.solver.gear_phases
        return gear_phases is not None and not gear_phases.all_known

    def _add_reference(self) -> None:
        """Add the assembly mode of the reference pose, if there is one.

        The reference pose is the configuration in which a file gives the axes of all pairs.

        Raises
        ------
        PlanError
            If the reference pose cannot move, by the rank of its velocity equations. Other
            modes, whose search would take long, are then not searched.
        """
        solver = self.solver
        if solver.reference is None:
            return
        values = solver.shift_near_samples(solver.reference, self.input_grid.q)
        (curve,) = self._follow_configurations(values)
        self._add_mode(curve)
        # If the input is still not in the range, the mode may end before the range begins.
        # This matters for wheels (`gear_phases`), whose configurations may never repeat, so
        # that the input has no period. The whole curve through the pose is then followed,
        # beyond the turning points of the input at which the mode ends. Other modes on it
        # may reach the range.
        if not self.assembly_modes and solver.gear_phases is not None:
            self._add_modes_on_curve(values[0])
        # `_follow_configurations` has appended the degrees of freedom of the pose, if a
        # group has redundant constraints. `check_mobility` raises the error.
        if self._mobilities and self._mobilities[0] < 1:
            check_mobility(solver, self._mobilities[0])

    def _follow_configurations(self, values: Floats) -> list[ModeCurve | None]:
        """Close configurations and follow them over the range.

        If a group has redundant constraints, the mobility of each configuration is appended
        to `_mobilities`.

        Parameters
        ----------
        values
            (n, variables) nearly closed configurations (rad).

        Returns
        -------
        The curve of each configuration. It is None if the rank of the velocity equations
        does not leave one degree of freedom.
        """
        solver = self.solver
        values = solver.closure.solve(values, fixed=solver.driven).values
        # With redundant constraints, the rank of the velocity equations decides whether a
        # configuration can move. Without them, all can move, because the numbers of links
        # and pairs leave one degree of freedom.
        is_mobile = np.ones(len(values), dtype=bool)
        if any(group.redundant for group in self.groups):
            mobilities = [solver.compute_mobility(row) for row in values]
            self._mobilities += mobilities
            is_mobile = np.array(mobilities) == 1
        # All mobile configurations are followed together.
        low, high = self.input_grid.range
        curves = iter(
            follow_each(
                solver.closure,
                driven=solver.driven[0],
                values=values[is_mobile],
                low=low,
                high=high,
            )
        )
        return [next(curves) if mobile else None for mobile in is_mobile]

    def _add_mode(self, curve: ModeCurve | None, component: int | None = None) -> bool:
        """Add the mode of a curve, if it is in the range, and return whether it is.

        Parameters
        ----------
        curve
            The curve, with rising values of the input. None if the configuration does not
            have one degree of freedom, so that it was not followed.
        component
            Number of the component to which the mode belongs. A component is a connected
            curve of configurations, on which the input can turn back. None if the component
            is new.
        """
        if curve is None:
            return False
        self._steps_along_modes += curve.tried_steps
        low, high = self.input_grid.range
        if curve.inputs[0] > high or curve.inputs[-1] < low:
            return False
        # Every group of links has a matrix: the three axes of a dyad (two links and three
        # R pairs), or the velocity equations of another group. The sign of its determinant
        # is constant in a mode. It is computed at the middle of the curve, because the
        # curve may begin at a dead centre, where the determinant is zero. `least` is the
        # reciprocal condition number below which a sign counts as unknown; with 0 none
        # does.
        middle_values = curve.values[len(curve.values) // 2]
        (determinant_signs,) = group_signs(self.solver, middle_values[None], least=0.0)
        self.assembly_modes.append(
            AssemblyMode(
                number=len(self.assembly_modes),
                # A dyad closes in two ways, which its sign (1 or -1) distinguishes. Other
                # groups have 0 here.
                signs=signs_at(self.solver, middle_values),
                # The configurations from which Newton's method starts at other inputs.
                guide=curve,
                group_signs=tuple(determinant_signs.tolist()),
            )
        )
        self._progress.report_if_due(lambda: f"{len(self.assembly_modes)} followed")
        new_component = max(self._components, default=-1) + 1
        self._components.append(new_component if component is None else component)
        return True

    def _search_all_modes(self) -> Completeness:
        """Search further modes in the whole range, and return how complete they are.

        If the input does not determine how far wheels have rolled, there are infinitely
        many modes, and only some are searched. Otherwise, elimination is tried first. It
        finds all configurations of a group of links at an input, as the roots of a
        polynomial. If it does not apply to all groups, modes are searched from random
        starts.
        """
        solver = self.solver
        # `gear_phases` is None for a mechanism without wheels.
        if solver.gear_phases is not None and not self.assembly_modes:
            # The reference pose has given no mode of a mechanism with wheels. Its first
            # modes are those of all configurations at the first sample.
            self._compute_modes_at(self.input_grid.q[:1])
        if self._has_free_wheels:
            return self._find_with_free_wheels()
        if can_find_all_modes(solver):
            completeness = self._find_by_elimination()
            # None if a polynomial could not be solved completely at one of the inputs.
            if completeness is not None:
                return completeness
        return self._find_by_random_search()

    def _find_by_random_search(self) -> Completeness:
        """Find modes from random starts, and return how complete they are.

        The attribute `methods` is set for all groups: dyads are solved in closed form, and
        other groups by random starts if no other method has solved them before.
        """
        methods: list[SolutionMethod | None] = []
        for group, method in zip(self.groups, self.methods, strict=True):
            if group.is_dyad:
                method = CLOSED_FORM
            elif method is None:
                method = RANDOM_SEARCH
            methods.append(method)
        self.methods = methods
        statistics = self._search_from_random_starts()
        if not self.assembly_modes:
            # The random search leaves out configurations near a dead centre. The solution
            # of all groups at one input, the middle sample, includes them.
            q = self.input_grid.q
            self._compute_modes_at(q[len(q) // 2][None])
        return Completeness(
            Guarantee.SAMPLED,
            statistics.describe("components"),
            sentence=statistics.sentence(len(self.assembly_modes)),
        )

    def _find_with_free_wheels(self) -> Completeness:
        """Find some of the modes, if wheels can be put together in any position.

        The input does not determine how far some wheels have rolled. Each position in which
        they can be put together has its own curve of configurations, so there are
        infinitely many curves. These are followed:

        - If the reference pose has a mode in the range, it is in `assembly_modes` already.
          Its curve is followed beyond the ends of the mode.
        - Otherwise all configurations are searched at a few inputs in turn, until one input
          has some. The curves through these are followed.

        Returns
        -------
        How complete the modes are. In the first case (`AS_ASSEMBLED`) all modes on the
        curve are known, in the second case those to which the examined inputs led.
        """
        q = self.input_grid.q
        # A few samples spread over the range, the middle first, each once.
        rows = (PROBED_FRACTIONS * len(q)).astype(np.intp)
        for row in dict.fromkeys(rows.tolist()):
            if self.assembly_modes:
                break
            self._compute_modes_at(q[row : row + 1])  # adds 1 to `probes`
        self._follow_modes_beyond_their_ends()
        # `probes` is the number of inputs at which configurations were searched. It is 0 in
        # the first case.
        if not self.probes:
            return AS_ASSEMBLED
        reason = f"modes found at {counted(self.probes, 'input')}"
        return Completeness(Guarantee.SAMPLED, reason)

    def _find_by_elimination(self) -> Completeness | None:
        """Find all modes at one input in each interval between turning points.

        Two modes meet, and end, at a turning point of the input. Between two turning points
        the number of modes is constant, so one input in each interval shows all of them.
        Elimination reduces the closure equations of each group of links at this input to a
        polynomial, whose roots are all configurations of the group.

        The attribute `crossings` is set: the configurations at which curves cross, so that
        modes meet and none ends.

        Returns
        -------
        How complete the modes are; None if modes may be missing at one of the inputs.
        """
        low, high = self.input_grid.range
        turning_points = find_input_turning_points(
            self.solver, low, high, max_cost_s=RUN_COST_S, max_time_s=RUN_TIME_S
        )
        self.crossings = turning_points.crossings
        # Turning points may be missed in parts of the range. There inputs are examined at
        # this distance from each other.
        step = (high - low) / PROBED_INTERVALS
        self._compute_modes_at(turning_points.probes(step)[:, None])
        if not all_complete(self.methods):
            return None
        completeness = turning_points.claim(step)
        # The gap is the width of the widest interval in which turning points may have been
        # missed, 0 if there is none.
        if not turning_points.gap(step):
            return completeness
        # A mode that begins and ends between two examined inputs has not been found. Two
        # searches may find it. At the end of a mode the curve of its configurations turns
        # back and continues as another mode, so curves are followed beyond the ends of the
        # modes. The other search begins at random starts.
        self._follow_modes_beyond_their_ends()
        statistics = self._search_from_random_starts()
        # A component is a connected curve of configurations.
        found_components = statistics.describe("components")
        reason = f"{completeness.reason}; between them {found_components}"
        return replace(completeness, reason=reason)

    def _compute_modes_at(self, inputs: Floats) -> None:
        """Compute all configurations at inputs (n, 1) in rad, and add their modes.

        The loop ends after an input at which some configurations may be missing, or when
        no further mode may be added. The caller then searches from random starts. `probes`
        counts the inputs at which configurations were computed.
        """
        for q in inputs:
            if self._has_enough_modes:
                break
            configurations = enumerate_assemblies(self.solver, q)
            self.probes += 1
            # Each group of links has a method that computes its configurations. Some find
            # all of them and some may miss a few. The result is only as complete as the
            # least complete method at any input so far, which is stored for each group.
            self.methods = [
                least_complete(old_method, new_method)
                for old_method, new_method in zip(
                    self.methods, configurations.methods, strict=True
                )
            ]
            self._add_new_modes(configurations.values)
            if not all_complete(self.methods):
                break

    def _add_new_modes(
        self,
        values: Floats,
        component: int | None = None,
        batch_size: int = STARTS_FOLLOWED_TOGETHER,
    ) -> Indices:
        """Follow configurations that are on no known mode, and add their modes.

        Each configuration is followed over the range of the input. The result is a new
        mode, which may contain others of the configurations. These need no mode of their
        own.

        Parameters
        ----------
        values
            (n, variables) closed configurations (rad).
        component
            Number of the component (connected curve of configurations) of all new modes.
            None if it is not known.
        batch_size
            Number of configurations that are followed together, which is faster. Larger:
            more of them are on the same mode, and are followed for nothing.

        Returns
        -------
        (n,) number of the component of each configuration. It is -1 for a configuration
        without a mode: it cannot move, no part of its curve is in the range, or no further
        modes are added because there are enough.
        """
        components = self._find_components(values, first_mode=0)
        (waiting_rows,) = np.nonzero(components < 0)
        while len(waiting_rows) and not self._has_enough_modes:
            batch = waiting_rows[:batch_size]
            curves = self._follow_configurations(values[batch])
            for row, curve in zip(batch.tolist(), curves, strict=True):
                # The mode of an earlier row of the batch may contain this configuration.
                if components[row] < 0 and not self._has_enough_modes:
                    self._add_mode_of_row(row, curve, values, components, component)
            waiting_rows = waiting_rows[batch_size:]
            waiting_rows = waiting_rows[components[waiting_rows] < 0]
        return components

    def _add_mode_of_row(
        self,
        row: int,
        curve: ModeCurve | None,
        values: Floats,
        components: Indices,
        new_component: int | None,
    ) -> None:
        """Add the mode of one configuration, and note which others are on the new modes.

        If the mode ends inside the range, the modes that continue it are added, too.

        Parameters
        ----------
        row
            Index of the configuration.
        curve
            The curve of this configuration over the range, None if it cannot move.
        values
            (n, variables) all configurations (rad).
        components
            (n,) number of the component of each configuration, -1 if it is not known. It is
            changed in place.
        new_component
            Number of the component of the new mode; None if it is not known.
        """
        first_new_mode = len(self.assembly_modes)
        if not self._add_mode(curve, new_component):
            return
        self._follow_modes_beyond_their_ends()
        components[row] = self._components[first_new_mode]
        unknown = np.flatnonzero(components < 0)
        components[unknown] = self._find_components(values[unknown], first_new_mode)

    def _find_components(self, values: Floats, first_mode: int) -> Indices:
        """Return on which component each configuration is, if it is on a known mode.

        A component is a connected curve of configurations, and consists of one or more
        modes.

        Parameters
        ----------
        values
            (n, variables) closed configurations (rad).
        first_mode
            Number of the first mode that is compared; all later ones are, too.

        Returns
        -------
        (n,) number of the component, or -1 if the configuration is on none of these modes.
        """
        components = np.full(len(values), -1, dtype=np.intp)
        rotations = self.solver.closure.linearise(values).rotations
        for mode, component in zip(
            self.assembly_modes[first_mode:], self._components[first_mode:], strict=True
        ):
            (rows,) = np.nonzero(components < 0)
            is_on_mode = self._is_on_mode(mode, values[rows], rotations[rows])
            components[rows[is_on_mode]] = component
        return components

    def _is_on_mode(self, mode: AssemblyMode, values: Floats, rotations: Floats) -> Bools:
        """Return whether configurations are on an assembly mode.

        A configuration is on the mode if all links have the same rotations as in the mode
        at the same input. The configuration of a mode takes long to compute. It is computed
        only for inputs at which a prediction of the mode is near the given configuration.

        Parameters
        ----------
        mode
            The assembly mode.
        values
            (n, variables) closed configurations (rad).
        rotations
            (n, links, 3, 3) rotations of the links in these configurations.
        """
        is_on_mode = self._is_near_prediction(mode, values)
        (rows,) = np.nonzero(is_on_mode)
        if len(rows):
            q = values[rows][:, list(self.solver.driven)]
            mode_rotations = self.solver.evaluate(mode, q).rotations
            distance = max_abs(mode_rotations - rotations[rows], axis=(1, 2, 3))
            is_on_mode[rows] = distance < SAME_MODE
        return is_on_mode

    def _is_near_prediction(self, mode: AssemblyMode, values: Floats) -> Bools:
        """Return whether configurations (n, variables) in rad may be on an assembly mode.

        The mode is predicted at their inputs, by interpolation between its verified
        configurations. A configuration that is far from the prediction is not on the mode.
        """
        driven = list(self.solver.driven)
        passive_angles = [v for v in self.solver.angles if v not in driven]
        assert isinstance(mode.guide, ModeCurve)
        prediction = mode.guide.predict(values[:, driven])
        deviation = wrap(prediction.values - values)[:, passive_angles]
        # `spread` is the change of the variables between two verified configurations. The
        # error of the interpolation between them is assumed to be smaller.
        is_near = max_abs(deviation, axis=1) < prediction.spread + MODE_DISTANCE_RAD
        # The status is not OK at inputs that the mode does not reach.
        return is_near & (prediction.status == Status.OK)

    def _follow_modes_beyond_their_ends(self) -> None:
        """Add the modes that are on the same curves as modes that end inside the range.

        Where a mode ends, for example because the input turns back, its configuration curve
        continues as another mode. The whole curve, a component, is followed. All modes on
        it get the number of the component of the first one. Only modes that were added
        since the last call are considered.
        """
        for assembly_mode in self.assembly_modes[self._extended_modes :]:
            self._extended_modes += 1
            # The guide of a mode is the curve of its verified configurations over the
            # input. Both ends have the status OK if the mode covers the whole range.
            guide = assembly_mode.guide
            if not isinstance(guide, ModeCurve) or guide.ends == (Status.OK, Status.OK):
                continue
            # The middle of the mode represents it. The ends may be singular, and a curve
            # cannot be followed from a singular configuration.
            middle_values = guide.values[len(guide.values) // 2]
            was_followed = any(
                followed_curve.passes(middle_values[None]).all()
                for followed_curve in self._curves
            )
            if not was_followed:
                self._add_modes_on_curve(
                    middle_values, component=self._components[assembly_mode.number]
                )

    def _add_modes_on_curve(self, values: Floats, component: int | None = None) -> None:
        """Add the modes in the range that are on the curve through a configuration.

        A configuration curve consists of all configurations that the mechanism can reach
        without being taken apart. A mode is a part of it on which the input rises or falls.

        Parameters
        ----------
        values
            (variables,) the configuration (rad). Nothing is added if it is singular.
        component
            Number that the curve has as a component. None if the component is new.
        """
        # The curve of a mechanism with free wheels need not close: it can go on for ever. A
        # shorter part is followed.
        longest = MAX_CURVE_LENGTH_RAD
        if self._has_free_wheels:
            longest = MAX_ROLLED_CURVE_LENGTH_RAD
        try:
            curve = follow_arc(self.solver.closure, values, longest=longest)
        except SolveError:  # a curve cannot be followed from a singular configuration
            return
        self._curves.append(curve)
        # The input rises or falls on each piece of the curve, so each piece is one mode. It
        # is added by the configuration in its middle.
        low, high = self.input_grid.range
        # Growth of the only input after which all configurations repeat.
        (period,) = self.solver.periods
        pieces = monotone_pieces(
            curve, driven=self.solver.input_variable, low=low, high=high, period=period
        )
        middles = np.array([piece.middle for piece in pieces])
        self._add_new_modes(middles.reshape(-1, curve.nodes.values.shape[1]), component)

    def _search_from_random_starts(self) -> SearchStatistics:
        """Add the modes to which random starts over the range lead.

        A component is a connected curve of configurations. Components are numbered from 0.
        The search ends when many starts have led to each component, because few components
        can then be missing.

        Returns
        -------
        How often the starts led to each component.
        """
        low, high = self.input_grid.range
        rounds = random_starts(self.solver, np.array([low]), np.array([high]))
        variable_count = len(self.solver.mechanism.variable_owners)
        # `random_starts` makes the first `RANGE_ROUNDS` rounds of starts together, so the
        # search has at least so many rounds. Later it makes one round at a time.
        statistics = SearchStatistics(variable_count, min_rounds=RANGE_ROUNDS)
        # All modes of the known components are needed, or a start that leads to another of
        # their modes would count as a new component.
        self._follow_modes_beyond_their_ends()
        while statistics.needs_more_starts and not self._has_enough_modes:
            # The number of starts that were made, and the configurations that closed.
            start_count, values, _ = next(rounds)
            # The number of the component of each configuration, -1 for none.
            components = self._add_new_modes(
                values, batch_size=RANDOM_STARTS_FOLLOWED_TOGETHER
            )
            component_count = max(self._components, default=-1) + 1
            statistics.add(start_count, hits=components, total=component_count)
            self.probes += start_count
            self._progress.report_if_due(lambda: statistics.progress_text("curves"))
        return statistics
