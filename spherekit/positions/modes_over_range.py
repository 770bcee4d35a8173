"""Finds the assembly modes of a mechanism with one input and irreducible groups.

Modes are curves of configurations over the range of the input. All modes are computed at
one input in each interval between the inputs at which modes meet, if elimination applies;
otherwise some are found from random starts. Each new configuration is followed over the
range, as far as its mode reaches. If the mode ends inside the range, its configuration
curve is followed in arc length, and leads to further modes.

All configurations that the mechanism can reach without being taken apart form a component.
A component is one curve and consists of one or more modes, because the input can turn back
on it.
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
"""Positions among the samples at which the first mode with free wheels is searched.

Wheels are free if the input does not determine how far they have rolled on each other.
The positions are examined in this order, until a mode is found.
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
    sentence="Only the mode of the reference pose and the modes that continue it where it "
    "ends were computed; other ways to mesh the wheels were not searched.",
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
        The modes. The mode of the reference pose comes first if it reaches the range.
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
        """Find the assembly modes of a mechanism over the range of its only input.

        An assembly mode is one way to assemble the mechanism. Its configurations over the
        input form a curve. The mode of the reference pose (configuration that the file
        describes) is followed first. All others are searched if `search` is true, or if the
        reference pose gives no mode in the range.
        """
        self.solver = solver
        self.input_grid = input_grid
        # A group has the links that are placed together.
        self.groups = solver.assembly.groups
        # The results. They are explained as attributes of the class.
        self.assembly_modes: list[AssemblyMode] = []
        self.methods: list[SolutionMethod | None] = [None] * len(self.groups)
        self.claim = REFERENCE_ONLY
        self.probes = 0
        self.crossings: tuple[Crossing, ...] = ()
        # A component is a connected curve of configurations. Where the input turns back on
        # it, one mode ends and another begins. `_components` has the index of the component
        # of each mode. `_curves` has the components that were followed along their arc
        # length, and `_curve_components` their indices.
        self._components: list[int] = []
        self._curves: list[ArcCurve] = []
        self._curve_components: list[int] = []
        # Degrees of freedom at each configuration from which a mode was to be followed, by
        # the rank of the velocity equations. The list stays empty unless constraints are
        # redundant, because otherwise the numbers of links and pairs give them.
        self._mobilities: list[int] = []
        # Number of steps along the curves of modes so far, which is limited.
        self._steps_along_modes = 0
        # Index of the first mode that `_follow_modes_beyond_their_ends` has still to treat.
        self._extended_modes = 0
        self._progress = ProgressReporter("searching assembly modes")

        self._add_reference()
        if search or not self.assembly_modes:
            self.claim = self._search_all_modes()
        # If no mode was found, an error is raised unless the mobility (number of degrees of
        # freedom) is 1. The mobility can be larger at singular configurations, so the least
        # one counts. `_mobilities` is empty if no constraints are redundant, or if no
        # configuration was found. The mobility then counts as 1.
        if not self.assembly_modes:
            mobility = min(self._mobilities, default=1)
            check_mobility(solver, mobility)
        # The search has stopped at the limit of modes, or of steps along them.
        if self._has_enough_modes:
            reason = (
                f"stopped at {counted(len(self.assembly_modes), 'mode')} after "
                f"{self._steps_along_modes} steps along them; there may be more"
            )
            self.claim = Completeness(Guarantee.SAMPLED, reason)

    @property
    def _has_enough_modes(self) -> bool:
        """Whether the search stops following further assembly modes.

        The search stops if there are `MAX_ASSEMBLY_MODES`, or if the modes so far have
        taken too many steps.
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

        The reference pose is the configuration in which the file gives the axes of all
        pairs. An assembly mode is one way to assemble the mechanism, with its
        configurations over the input.

        Raises
        ------
        PlanError
            If the pose cannot move, by the rank of its velocity equations.
        """
        solver = self.solver
        if solver.reference is None:
            return
        # The input of the pose is changed by whole periods to come into the range.
        values = solver.shift_near_samples(solver.reference, self.input_grid.q)
        # Follow the mode while the input rises and falls. `curve` is None if the pose does
        # not have exactly one degree of freedom. `_add_mode` adds nothing for None, or if
        # the curve misses the range.
        (curve,) = self._follow_configurations(values)
        self._add_mode(curve)
        # The pose can be outside the range, and its mode may end before the range begins.
        # Another mode on the same curve of configurations may reach the range. If there are
        # wheels, this curve is followed here; along it, the wheels stay meshed as in the
        # pose. If still no mode was found, the constructor searches all modes.
        # `gear_phases` is None for a mechanism without wheels.
        has_wheels = solver.gear_phases is not None
        if not self.assembly_modes and has_wheels:
            self._add_modes_on_curve(values[0])
        # `_follow_configurations` has computed the degrees of freedom of the pose if
        # constraints are redundant. With none, the pose cannot move, which is an error.
        # More than one is no error, because the pose may be singular.
        if self._mobilities:
            mobility_of_pose = self._mobilities[0]
            if mobility_of_pose < 1:
                check_mobility(solver, mobility_of_pose)

    def _follow_configurations(self, values: Floats) -> list[ModeCurve | None]:
        """Close nearly closed configurations, and follow each over the range of the input.

        If a group of links has redundant constraints, the mobility (degrees of freedom) of
        each configuration is appended to `_mobilities`.

        Parameters
        ----------
        values
            (n, variables) nearly closed configurations (rad).

        Returns
        -------
        The curve of each configuration over the input. None if its mobility, from the rank
        of the velocity equations, is not 1.
        """
        solver = self.solver
        values = solver.closure.solve(values, fixed=solver.driven).values
        # Counting links and pairs gives one degree of freedom. With redundant constraints,
        # only the rank of the velocity equations shows whether a configuration has one.
        is_mobile = np.ones(len(values), dtype=bool)
        if any(group.redundant for group in self.groups):
            mobilities = [solver.compute_mobility(row) for row in values]
            self._mobilities += mobilities
            is_mobile = np.array(mobilities) == 1
        # All mobile configurations are followed together, which is faster.
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
        """Add the assembly mode of a curve if the curve reaches the range of the input.

        An assembly mode is one way to assemble the mechanism. Its configurations over the
        input form the curve. The result says whether the mode was added.

        Parameters
        ----------
        curve
            The curve, with rising values of the input. None if the configuration from which
            it would start does not have exactly one degree of freedom.
        component
            Index of the component to which the mode belongs. A component is a connected
            curve of configurations; it has several modes if the input turns back on it.
            None if the component is new.
        """
        if curve is None:
            return False
        # The steps along all curves are counted, because the search stops after
        # `MAX_STEPS_ALONG_MODES`.
        self._steps_along_modes += curve.tried_steps
        low, high = self.input_grid.range
        if curve.inputs[0] > high or curve.inputs[-1] < low:
            return False
        # A mode has two lists of signs, with a sign for each group (links placed together).
        # The signs are constant in a mode, except at its ends, so the middle is used.
        middle_values = curve.values[len(curve.values) // 2]
        # First list: a dyad (a group of two links) can close in two ways. Its sign, 1 or
        # -1, says which one, and the program places the dyad by it. Other groups have 0.
        dyad_signs = signs_at(self.solver, middle_values)
        # Second list: the sign of the determinant of each group, dyads included. This sign
        # serves to recognise configurations that have left the mode. `least=0.0` asks for
        # the sign even of a small determinant.
        (determinant_signs,) = group_signs(self.solver, middle_values[None], least=0.0)
        self.assembly_modes.append(
            AssemblyMode(
                number=len(self.assembly_modes),
                signs=dyad_signs,
                # The known configurations, from which others of the mode are computed.
                guide=curve,
                group_signs=tuple(determinant_signs.tolist()),
            )
        )
        self._progress.report_if_due(lambda: f"{len(self.assembly_modes)} followed")
        # `_components` has the index of the component of each mode. A new component gets
        # the next free number.
        if component is None:
            component = max(self._components, default=-1) + 1
        self._components.append(component)
        return True

    def _search_all_modes(self) -> Completeness:
        """Search further assembly modes in the whole range; return how complete they are.

        An assembly mode is one way to assemble the mechanism. The best method that applies
        is used:

        - Free wheels (the input does not determine how far they have rolled) have
          infinitely many modes, and only some are searched.
        - Elimination finds all configurations at an input, as roots of polynomials.
        - Otherwise modes are searched from random starts.
        """
        solver = self.solver
        # `gear_phases` is None for a mechanism without wheels.
        if solver.gear_phases is not None and not self.assembly_modes:
            # The reference pose (configuration in the file) has given no mode. The search
            # with wheels begins with all configurations at the first sample.
            self._compute_modes_at(self.input_grid.q[:1])
        if self._has_free_wheels:
            return self._find_with_free_wheels()
        if can_find_all_modes(solver):
            completeness = self._find_by_elimination()
            # None if elimination may have missed modes at an input.
            if completeness is not None:
                return completeness
        return self._find_by_random_search()

    def _find_by_random_search(self) -> Completeness:
        """Find assembly modes from random starts, and return how complete they are.

        An assembly mode is one way to assemble the mechanism. The modes are added to
        `assembly_modes`. The attribute `methods` says how each group of links is solved.
        Dyads (two links) are solved in closed form. Any other group keeps the method that
        is stored already. Without a stored method, it is solved from random starts.
        """
        methods: list[SolutionMethod | None] = []
        for group, method in zip(self.groups, self.methods, strict=True):
            if group.is_dyad:
                method = CLOSED_FORM
            elif method is None:
                method = RANDOM_SEARCH
            methods.append(method)
        self.methods = methods
        # `statistics` counts how many starts led to each component: a connected curve of
        # configurations, with one or more modes.
        statistics = self._search_from_random_starts()
        if not self.assembly_modes:
            # Random starts leave out configurations near a dead centre, so they may have
            # given no mode. Solving all groups at the middle sample can find such modes.
            q = self.input_grid.q
            self._compute_modes_at(q[len(q) // 2][None])
        # Two texts for users say how likely a mode was missed. `Guarantee.SAMPLED` means
        # that modes may have been missed.
        reason = statistics.describe("components")
        sentence = statistics.sentence(len(self.assembly_modes))
        return Completeness(Guarantee.SAMPLED, reason, sentence=sentence)

    def _find_with_free_wheels(self) -> Completeness:
        """Find some assembly modes of a mechanism with free wheels.

        The input does not determine how far free wheels have rolled on each other. Wheels
        can be put together with any teeth in mesh, after any number of rolled revolutions.
        Each way gives its own curve of configurations, so there are infinitely many curves.
        A mode is a part of a curve on which the input rises or falls. These curves are
        followed:

        - The curve of the reference pose (the configuration that the file describes), if
          `_add_reference` has added its mode to `assembly_modes`.
        - Otherwise the curves through all configurations at one input. A few inputs are
          tried in turn, until one has configurations.

        Returns
        -------
        How complete the modes are. In the first case (`AS_ASSEMBLED`) all modes on the
        curve are known, in the second case those to which the tried inputs led.
        """
        q = self.input_grid.q
        # A few samples spread over the range, the middle first, each once.
        rows = (PROBED_FRACTIONS * len(q)).astype(np.intp)
        for row in dict.fromkeys(rows.tolist()):
            if self.assembly_modes:
                break
            self._compute_modes_at(q[row : row + 1])  # adds 1 to `probes`
        self._follow_modes_beyond_their_ends()
        # No input was tried, so all modes are on the curve of the reference pose.
        if not self.probes:
            return AS_ASSEMBLED
        reason = f"modes found at {counted(self.probes, 'input')}"
        return Completeness(Guarantee.SAMPLED, reason)

    def _find_by_elimination(self) -> Completeness | None:
        """Find all assembly modes at one input in each interval between turning points.

        Modes begin and end only at turning points of the input, where two modes meet.
        Between two turning points their number is constant, so one input shows all of them.
        Elimination reduces the closure equations of a group of links to a polynomial. Its
        roots are all configurations of the group at this input.

        In some intervals of the input, turning points may have been missed. Such a doubtful
        interval is examined at several inputs, unless it is very short.

        Two attributes are set: `crossings`, the configurations at which curves of modes
        cross, and `methods`, how each group was solved.

        Returns
        -------
        How complete the modes are. None if elimination has not found all modes at an input.
        """
        low, high = self.input_grid.range
        # Modes meet where a function of the input changes its sign. `max_cost_s` limits the
        # time for one of its values, and `max_time_s` limits that of the whole search.
        turning_points = find_input_turning_points(
            self.solver, low, high, max_cost_s=RUN_COST_S, max_time_s=RUN_TIME_S
        )
        self.crossings = turning_points.crossings
        # Largest distance (rad) of the examined inputs (probes) in a doubtful interval.
        step = (high - low) / PROBED_INTERVALS
        # `methods` says afterwards whether solutions of a group can be missing.
        self._compute_modes_at(turning_points.probes(step)[:, None])
        if not all_complete(self.methods):
            return None
        completeness = turning_points.claim(step)
        # Width (rad) of the widest part of a doubtful interval without a probe.
        doubtful_width = turning_points.gap(step)
        if doubtful_width == 0.0:
            return completeness
        # A mode that begins and ends between two probes was not noticed. Two searches may
        # still show it: along the curves beyond the ends of known modes, and from random
        # starts.
        self._follow_modes_beyond_their_ends()
        statistics = self._search_from_random_starts()
        # A component is a connected curve of configurations, with one or more modes. The
        # text says how many components the random starts have shown.
        components_text = statistics.describe("components")
        reason = f"{completeness.reason}; between them {components_text}"
        return replace(completeness, reason=reason)

    def _compute_modes_at(self, inputs: Floats) -> None:
        """Compute all configurations at inputs (n, 1) in rad, and add their assembly modes.

        The computation stops at an input where configurations may be missing, or if there
        are enough modes. The attribute `probes` counts the inputs.
        """
        for q in inputs:
            if self._has_enough_modes:
                break
            configurations = enumerate_assemblies(self.solver, q)
            self.probes += 1
            # Each group of links is solved by a method that finds all configurations, or
            # may miss some. For each group the least complete method at any input is
            # stored.
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
        new_component: int | None = None,
        batch_size: int = STARTS_FOLLOWED_TOGETHER,
    ) -> Indices:
        """Follow configurations that are on no known mode, and add their assembly modes.

        An assembly mode is one way to assemble the mechanism, as a curve of configurations
        over the input. Its curve may contain several of the given configurations. Only one
        of them has to be followed.

        Parameters
        ----------
        values
            (n, variables) closed configurations (rad).
        new_component
            Index of the component (connected curve of configurations, of one or more modes)
            to which all new modes belong. None if this component is not known.
        batch_size
            Number of configurations that are followed together. Larger: fewer array
            operations, but more curves that turn out to be the same.

        Returns
        -------
        (n,) index of the component of each configuration. The index is -1 for a
        configuration without a mode: it cannot move, its curve is outside the range, or
        there are enough modes.
        """
        components = self._find_components(values, first_mode=0)
        (waiting_rows,) = np.nonzero(components < 0)
        while len(waiting_rows) and not self._has_enough_modes:
            batch = waiting_rows[:batch_size]
            curves = self._follow_configurations(values[batch])
            for row, curve in zip(batch.tolist(), curves, strict=True):
                # An earlier configuration of the batch may have added the mode of this
                # configuration.
                if components[row] < 0 and not self._has_enough_modes:
                    # This also fills in `components` for all configurations on new modes.
                    self._add_mode_of_row(row, curve, values, components, new_component)
            waiting_rows = waiting_rows[batch_size:]
            # Drop configurations that are on the new modes.
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
        """Add the assembly mode of one configuration, and further modes of its component.

        A component is a connected curve of configurations. Where the input turns back on
        it, one mode ends and another begins. All modes of the component that are in the
        range are added. Nothing is added if the curve does not reach the range. At the end,
        `components` is updated for all configurations on the new modes.

        Parameters
        ----------
        row
            Index of the configuration.
        curve
            The curve of this configuration over the range, None if it cannot move.
        values
            (n, variables) all configurations (rad).
        components
            (n,) index of the component of each configuration, -1 if it is not known. This
            function changes the array.
        new_component
            Index of the component of the new mode. None if it is not known; the mode then
            gets the number of a new component.
        """
        first_new_mode = len(self.assembly_modes)
        was_added = self._add_mode(curve, new_component)
        if not was_added:
            return
        # Add the other modes of the component.
        self._follow_modes_beyond_their_ends()
        # `_components` has the index of the component of each mode.
        components[row] = self._components[first_new_mode]
        # Other configurations may be on the modes that were just added.
        unknown = np.flatnonzero(components < 0)
        components[unknown] = self._find_components(values[unknown], first_new_mode)

    def _find_components(self, values: Floats, first_mode: int) -> Indices:
        """Return the component of each configuration that is on a known assembly mode.

        The caller follows a new curve only from a configuration that is on no known mode.

        A component is a connected curve of configurations. Where the input turns back along
        the curve, one mode ends and another begins. So a component has one or more modes.

        Parameters
        ----------
        values
            (n, variables) closed configurations (rad).
        first_mode
            Number of the first mode to compare with. Modes with larger numbers are
            compared, too.

        Returns
        -------
        (n,) index of the component, or -1 if the configuration is on none of the modes.
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
        """Return whether configurations (n,) are on an assembly mode.

        A configuration is on the mode if all links are oriented as in the mode at the same
        input. A quick prediction first rules out most of the given configurations, because
        computing those of the mode takes long.

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
        """Return whether configurations (n, variables) in rad can be on an assembly mode.

        This quick test rules out configurations that are far from the mode. The mode is
        interpolated between its known configurations, at the inputs of the given ones.
        """
        driven = list(self.solver.driven)
        passive_angles = [v for v in self.solver.angles if v not in driven]  # not inputs
        assert isinstance(mode.guide, ModeCurve)
        prediction = mode.guide.predict(values[:, driven])
        deviation = wrap(prediction.values - values)[:, passive_angles]
        # `spread` is the change of the variables between the known configurations on both
        # sides. The error of the interpolation is assumed to be smaller.
        is_near = max_abs(deviation, axis=1) < prediction.spread + MODE_DISTANCE_RAD
        # The status is not OK at inputs that the mode does not reach.
        return is_near & (prediction.status == Status.OK)

    def _follow_modes_beyond_their_ends(self) -> None:
        """Add the modes that continue known modes beyond an end inside the range.

        An assembly mode ends where the input turns back. The curve of configurations
        continues there as another mode. The whole curve (component) is followed, and each
        piece on which the input rises or falls becomes a mode. Modes that were treated by
        an earlier call are skipped.
        """
        # This method calls itself indirectly for the modes that it adds. Each mode is
        # therefore counted as treated before its curve is followed.
        while self._extended_modes < len(self.assembly_modes):
            assembly_mode = self.assembly_modes[self._extended_modes]
            self._extended_modes += 1
            # `guide` is the curve of known configurations of the mode. If both its ends are
            # OK, the mode covers the whole range.
            guide = assembly_mode.guide
            assert isinstance(guide, ModeCurve)  # modes of one input have a curve
            if guide.ends == (Status.OK, Status.OK):
                continue
            # The curve is followed from the middle, because the ends may be singular.
            middle_values = guide.values[len(guide.values) // 2]
            for followed_curve, component in zip(
                self._curves, self._curve_components, strict=True
            ):
                if followed_curve.passes(middle_values[None]).all():
                    # The mode is on a curve that was followed already. It may have been
                    # added before that, with the index of a new component.
                    self._components[assembly_mode.number] = component
                    break
            else:
                # All modes on the curve belong to the component of this mode. `_components`
                # has the index of the component of each mode.
                component = self._components[assembly_mode.number]
                self._add_modes_on_curve(middle_values, component=component)

    def _add_modes_on_curve(self, values: Floats, component: int | None = None) -> None:
        """Add the modes in the range that are on the curve through a configuration.

        The curve consists of all configurations that the mechanism can reach without being
        taken apart. An assembly mode is a piece of it on which the input rises or falls.

        Parameters
        ----------
        values
            (variables,) the configuration (rad). Nothing is added if it is singular.
        component
            Index of the component (connected curve) of the new modes. None if it is new.
        """
        # The input does not determine how far free wheels have rolled. With such wheels,
        # configurations need not repeat, so the curve can be endless. A shorter part of the
        # curve is followed.
        longest = MAX_CURVE_LENGTH_RAD
        if self._has_free_wheels:
            longest = MAX_ROLLED_CURVE_LENGTH_RAD
        try:
            curve = follow_arc(self.solver.closure, values, longest=longest)
        except SolveError:  # a curve cannot be followed from a singular configuration
            return
        if component is None:
            component = max(self._components, default=-1) + 1
        self._curves.append(curve)
        self._curve_components.append(component)
        # Each piece on which the input rises or falls is one mode. `_add_new_modes` needs
        # one configuration of each mode, and follows the mode from there over the range of
        # the input. The configuration in the middle of the piece is used.
        low, high = self.input_grid.range
        # Growth of the only input after which all configurations repeat.
        (period,) = self.solver.periods
        pieces = monotone_pieces(
            curve, driven=self.solver.input_variable, low=low, high=high, period=period
        )
        middles = np.array([piece.middle for piece in pieces])
        self._add_new_modes(middles.reshape(-1, curve.nodes.values.shape[1]), component)

    def _search_from_random_starts(self) -> SearchStatistics:
        """Add the assembly modes to which random starts over the range lead.

        A component is a connected curve of configurations, with one or more modes. The
        search ends when each known component was reached from many starts, so that a
        missing component is unlikely, or at a limit of starts or modes.

        Returns
        -------
        How often the starts led to each component.
        """
        low, high = self.input_grid.range
        rounds = random_starts(self.solver, np.array([low]), np.array([high]))
        # The statistics decide when to stop. More variables make a start more expensive, so
        # fewer starts are allowed. `random_starts` yields the first `RANGE_ROUNDS` rounds
        # together, so at least these are made.
        variable_count = len(self.solver.mechanism.variable_owners)
        statistics = SearchStatistics(variable_count, min_rounds=RANGE_ROUNDS)
        # First add all modes of the known components, so that a start on one of these modes
        # does not count as a new component.
        self._follow_modes_beyond_their_ends()
        while statistics.needs_more_starts and not self._has_enough_modes:
            # Number of starts, and the closed configurations to which they led.
            start_count, values, _ = next(rounds)
            # Follow the configurations that are on no known mode, and add their modes. The
            # result is the index of the component of each configuration, -1 for none.
            components = self._add_new_modes(
                values, batch_size=RANDOM_STARTS_FOLLOWED_TOGETHER
            )
            # Components are numbered from 0. `_components` has the number for each mode.
            component_count = max(self._components, default=-1) + 1
            statistics.add(start_count, hits=components, total=component_count)
            self.probes += start_count
            self._progress.report_if_due(lambda: statistics.progress_text("curves"))
        return statistics
