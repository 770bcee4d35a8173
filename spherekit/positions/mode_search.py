"""Finding the assembly modes of a mechanism over the ranges of its inputs.

With one input they are looked for between all inputs at which modes meet, where those
are known, else at several and by a search over the range. All modes of dyads are
enumerated. Those of irreducible groups at some inputs are all found by elimination or some
by a search; each new one is followed as far as it goes, and beyond where its curve goes on
in the range.
"""

from dataclasses import replace

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.completeness import Completeness, Guarantee
from spherekit.errors import PlanError, SolveError
from spherekit.geometry.vectors import max_abs, nans
from spherekit.mechanism.elements import PoseGeometry
from spherekit.numerics.angles import wrap
from spherekit.planning.mobility import graph_mobility, inputs_to_declare
from spherekit.positions.assembly_enumeration import (
    MOST_ASSEMBLY_MODES,
    RANGE_ROUNDS,
    assemblies,
    chains,
    group_signs,
    random_starts,
    signs_at,
)
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.configuration_curve import ArcCurve
from spherekit.positions.configuration_space import monotone_pieces
from spherekit.positions.curve_continuation import MAX_CURVE_LENGTH_RAD, follow_arc
from spherekit.positions.curve_crossing import Crossing
from spherekit.positions.elimination_order import has_elimination
from spherekit.positions.group_assembly import place_dyad
from spherekit.positions.group_solutions import (
    CLOSED_FORM,
    SEARCH,
    SolutionMethod,
    all_complete,
    least_complete,
)
from spherekit.positions.input_grid import InputGrid, spread_rows
from spherekit.positions.input_revolutions import whole_laps
from spherekit.positions.input_turning_points import input_turning_points
from spherekit.positions.mode_predictor import ModeCurve, ModeOverGrid, follow_each
from spherekit.positions.modes_over_samples import REFERENCE_ONLY, SampledModes
from spherekit.positions.position_solver import PositionSolver
from spherekit.positions.random_search import SAME_MODE, SearchStatistics
from spherekit.progress import ProgressReporter
from spherekit.status import Status
from spherekit.wording import counted

PROBED_INPUTS = 721
"""Inputs over the range at which the modes of dyads are looked for."""
MOST_PROBED_SAMPLES = 2**16
"""Samples of several inputs at which the modes of dyads are looked for."""
PROBED_AT_ONCE = 2**13
"""Inputs that are probed together. More of them need more memory."""
RANKED = 5
"""Configurations at which the mobility by rank is asked for: some may be singular."""
MOST_TRIED = 60000
"""Steps along modes of irreducible groups, after which no further one is followed: a mode
takes some tens, thousands where a configuration is singular in higher order."""
PROBED = np.array([0.5, 0.3, 0.7, 0.1, 0.9])
"""Where in a range of samples modes are looked for."""
PARTS = 15
"""The same number where the inputs at which they meet are unknown."""
MOST_COST = 3e-3
"""Time (s) that a value of the functions of meeting modes may take here."""
MOST_TIME = 10.0
"""Rough time (s) that looking for the inputs at which modes meet may take here."""
LONGEST_ROLLED = 200.0
"""Length (rad) after which a curve of wheels is ended whose rolled lengths do not follow
from the input, and which need not ever close."""
NEAR_GUIDE = 1e-3
"""A mode is examined where its guide is nearer (rad) than this and its nodes' spread."""
AHEAD = 16
"""Configurations on different modes that are followed together."""
GUESSED = 6
"""The same of random starts, some of which are on one mode."""
AS_ASSEMBLED = Completeness(
    Guarantee.COMPONENT,
    "the mode of the reference pose, and where it ends those that go on; wheels put "
    "together otherwise were not looked for",
)


class ModeSearch:
    """The assembly modes that have at least one configuration at the inputs of a grid.

    The mode of a given reference pose comes first. For one input the range between the
    first and the last sample is what counts; for several the samples of the input grid.

    Attributes
    ----------
    assembly_modes, families
        The modes, and the numbers of their components, as far as is known: those that were
        come to on one configuration curve have the same.
    probes
        Number of inputs at which modes were looked for, 0 if a reference pose was enough.
    methods
        Of each group the least complete way in which its modes were found at any of these,
        None if at none.
    claim
        What holds of the number of modes.
    crossings
        Configurations at which curves cross, as far as the inputs at which modes meet are
        known.

    Parameters
    ----------
    independent
        As of `spherekit.positions.position_analysis.PositionAnalysis`.

    Raises
    ------
    SolveError
        If the arcs close nowhere.
    PlanError
        If the rank of a mechanism with redundant constraints leaves another number of
        freedoms than there are inputs.
    """

    def __init__(
        self,
        solver: PositionSolver,
        input_grid: InputGrid,
        search: bool = True,
        independent: bool = False,
    ) -> None:
        self.solver, self.input_grid, self.claim = solver, input_grid, REFERENCE_ONLY
        self.groups = solver.assembly.groups
        self.assembly_modes: list[AssemblyMode] = []
        self.families: list[int] = []
        self.methods: list[SolutionMethod | None] = [None] * len(self.groups)
        self.probes = 0
        self.crossings: tuple[Crossing, ...] = ()
        self._freedoms: list[int] = []
        self._tried = self._followed = 0
        self._curves: list[ArcCurve] = []
        self._working = ProgressReporter("searching the assembly modes")
        if solver.has_closed_form:
            self._enumerate(search)
        elif len(solver.driven) > 1:
            self._sample(search, independent)
        else:
            self._follow(search)
        if not self.assembly_modes:
            if not independent:
                raise SolveError(_why_nothing_closes(solver, input_grid))
            self.assembly_modes = [self._make_empty_mode()]

    def _make_empty_mode(self) -> AssemblyMode:
        """Return a mode that has no configuration at any sample."""
        signs = tuple(int(group.is_dyad) for group in self.groups)
        count = len(self.input_grid)
        values = nans((count, len(self.solver.mechanism.variable_owners)))
        status = np.full(count, Status.OUT_OF_REACH, dtype=np.int8)
        return AssemblyMode(0, signs, ModeOverGrid(values, status))

    def _sample(self, search: bool, independent: bool) -> None:
        """Find the modes over the samples of several inputs."""
        modes = SampledModes(self.solver, self.input_grid, search, independent)
        self.assembly_modes = modes.assembly_modes
        self.families = list(range(len(modes.assembly_modes)))
        self.methods = modes.methods
        self.claim = modes.claim
        self.probes = modes.probes
        mobilities = modes.mobilities
        if mobilities and (
            not modes.assembly_modes or mobilities[0] < len(self.solver.driven)
        ):
            self._check_rank(min(mobilities))

    def _follow(self, search: bool) -> None:
        """Find the modes over the range of one input."""
        self._add_reference()
        if search or not self.assembly_modes:
            self.claim = self._all_modes()
        if not self.assembly_modes:
            self._check_rank(min(self._freedoms, default=1))
        if self._is_full:
            words = (
                f"stopped at {counted(len(self.assembly_modes), 'mode')} after "
                f"{self._tried} steps along them; there may be more"
            )
            self.claim = Completeness(Guarantee.SAMPLED, words)

    def _enumerate(self, search: bool) -> None:
        """Find the modes of dyads and trains of wheels.

        Redundant constraints that leave another mobility than there are inputs, by the
        greatest rank of some configurations, are refused.
        """
        solver, reference = self.solver, self.solver.reference
        signs = [] if reference is None else [signs_at(solver, reference)]
        if search or not signs:
            q, self.claim = self._probed()
            self.probes = len(q)
            self.methods = [CLOSED_FORM] * len(self.groups)
            for first in range(0, len(q), PROBED_AT_ONCE):
                some = q[first : first + PROBED_AT_ONCE]
                for of_mode, state in chains(solver, some, MOST_ASSEMBLY_MODES + 1):
                    signs.append(of_mode)
                    if any(group.redundant for group in self.groups):
                        closed = state.values[~state.is_open]
                        rows = spread_rows(len(closed), RANKED)
                        self._check_rank(min(map(solver.compute_mobility, closed[rows])))
        different = list(dict.fromkeys(signs))
        if len(different) > MOST_ASSEMBLY_MODES:
            words = f"the first {MOST_ASSEMBLY_MODES} modes are kept, and there are more"
            self.claim = Completeness(Guarantee.SAMPLED, words)
        kept = different[:MOST_ASSEMBLY_MODES]
        self.assembly_modes = [AssemblyMode(k, one) for k, one in enumerate(kept)]

    def _check_rank(self, freedoms: int) -> None:
        """Raise an error unless a mechanism has an input for each freedom by rank."""
        mechanism, inputs = self.solver.mechanism, len(self.solver.driven)
        if freedoms != inputs:
            raise PlanError(
                f"{mechanism.name}: mobility {freedoms} by rank with "
                f"{graph_mobility(mechanism)} by the graph, but the number of inputs is "
                f"{inputs}; {inputs_to_declare(freedoms)}"
            )

    def _probed(self) -> tuple[Floats, Completeness]:
        """Return the inputs (k, inputs) at which the modes of dyads are looked for."""
        grid, trains = self.input_grid, self.solver.wheel_trains
        if len(trains) == len(self.groups):
            words = "wheels in mesh have one" if trains else "no loop has to close"
            return grid.q[:1], Completeness(Guarantee.COMPLETE, words)
        if grid.q.shape[1] > 1:
            q = grid.q[spread_rows(len(grid), MOST_PROBED_SAMPLES)]
            words = f"modes at {len(q)} of the {len(grid)} samples"
            if len(q) == len(grid):
                words = f"modes at all {len(grid)} samples"
            return q, Completeness(Guarantee.SAMPLED, words)
        dead = input_turning_points(self.solver, *grid.range, MOST_COST, MOST_TIME)
        self.crossings = dead.crossings
        step = np.ptp(grid.q) / (PROBED_INPUTS - 1)
        return dead.probes(step)[:, None], dead.claim(step)

    @property
    def _is_full(self) -> bool:
        """Whether no further assembly mode is to be followed."""
        count = len(self.assembly_modes)
        return count >= MOST_ASSEMBLY_MODES or (count > 0 and self._tried > MOST_TRIED)

    def _add_reference(self) -> None:
        """Add the assembly mode of the reference pose, if there is one."""
        solver, q = self.solver, self.input_grid.q
        if (reference := solver.reference) is None:
            return
        held = reference[list(solver.driven)]
        away = 0.5 * (np.min(q, axis=0) + np.max(q, axis=0)) - held
        outside = np.abs(away) > 0.5 * np.ptp(q, axis=0)
        far = np.where(outside, whole_laps(away, solver.periods), 0.0)
        values = solver.shift_inputs(reference[None], held + far)
        self._add(*self._guided(values)[0])
        if not self.assembly_modes and len(held) == 1 and solver.gear_phases is not None:
            self._add_along(values[0])
        if self._freedoms and self._freedoms[0] < len(held):
            # Where the pose given cannot move, a search of other modes takes long and is
            # not what was asked.
            self._check_rank(self._freedoms[0])

    def _guided(self, values: Floats) -> list[tuple[Floats, ModeCurve | None]]:
        """Return nearly closed configurations (n, variables), closed, with their guides.

        None where the mode has another number of freedoms than there are inputs.
        """
        solver, driven = self.solver, list(self.solver.driven)
        values = solver.closure.solve(values, driven).values
        moving = np.ones(len(values), dtype=bool)
        if any(group.redundant for group in self.groups):
            freedoms = [solver.compute_mobility(one) for one in values]
            self._freedoms += freedoms
            moving = np.array(freedoms) == len(driven)
        ends = self.input_grid.range
        guides = iter(follow_each(solver.closure, driven[0], values[moving], *ends))
        return [
            (one, next(guides) if moves else None)
            for one, moves in zip(values, moving, strict=True)
        ]

    def _add(
        self,
        values: Floats,
        guide: ModeCurve | None,
        family: int | None = None,
    ) -> None:
        """Add the mode through a configuration, if it is in the range."""
        if isinstance(guide, ModeCurve):
            self._tried += guide.tried_steps
            low, high = self.input_grid.range
            if guide.inputs[0] > high or guide.inputs[-1] < low:
                return
            # no dead centre, as a pose may be
            values = guide.values[len(guide.values) // 2]
        if guide is not None:
            signs = signs_at(self.solver, values)
            determinants = tuple(group_signs(self.solver, values[None], 0.0)[0].tolist())
            self.assembly_modes.append(
                AssemblyMode(len(self.assembly_modes), signs, guide, determinants)
            )
            self._working.tell(lambda: f"{len(self.assembly_modes)} followed")
            new = max(self.families, default=-1) + 1
            self.families.append(new if family is None else family)

    def _all_modes(self) -> Completeness:
        """Look for further modes in the whole range; return what is claimed then."""
        solver, q = self.solver, self.input_grid.q
        if solver.gear_phases is not None:
            if not self.assembly_modes:
                self._probe(q[:1])
            if not solver.gear_phases.all_known:
                return self._as_assembled()
        if all(
            group.is_dyad or number in solver.wheel_trains or has_elimination(group)
            for number, group in enumerate(self.groups)
        ) and (claim := self._eliminated()):
            return claim
        self.methods = [
            CLOSED_FORM if group.is_dyad else method or SEARCH
            for group, method in zip(self.groups, self.methods, strict=True)
        ]
        census = self._search()
        if not self.assembly_modes:
            # Random starts leave out what is next to a dead centre.
            self._probe(q[len(q) // 2][None])
        return Completeness(Guarantee.SAMPLED, census.words("components"))

    def _as_assembled(self) -> Completeness:
        """Find the curve of wheels whose lengths rolled do not follow from the inputs."""
        for q in self._scattered():
            if not self.assembly_modes:
                self._probe(q[None])
        self._go_beyond()
        words = f"modes found at {counted(self.probes, 'input')}"
        return Completeness(Guarantee.SAMPLED, words) if self.probes else AS_ASSEMBLED

    def _scattered(self) -> Floats:
        """Return samples (k, inputs) spread over the input grid, its middle first."""
        shape = self.input_grid.shape
        places = [
            (np.roll(PROBED, 2 * axis) * count).astype(np.intp)
            for axis, count in enumerate(shape)
        ]
        return self.input_grid.q[np.unique(np.ravel_multi_index(places, shape))]

    def _eliminated(self) -> Completeness | None:
        """Find all modes at some inputs; return None if some may be missing there."""
        ends = self.input_grid.range
        dead = input_turning_points(self.solver, *ends, MOST_COST, MOST_TIME)
        self.crossings = dead.crossings
        step = (ends[1] - ends[0]) / PARTS
        self._probe(dead.probes(step)[:, None])
        if not all_complete(self.methods):
            return None
        claim = dead.claim(step)
        if not dead.gap(step):
            return claim
        self._go_beyond()
        words = f"{claim.reason}; between them {self._search().words('components')}"
        return replace(claim, reason=words)

    def _probe(self, inputs: Floats) -> None:
        """Add the assembly modes of all modes at inputs (n, inputs), if they are sure."""
        for q in inputs:
            if self._is_full:
                break
            here = assemblies(self.solver, q)
            self.probes += 1
            self.methods = list(map(least_complete, self.methods, here.methods))
            rows = np.repeat(self.input_grid.nearest(q, 1), len(here.values))
            self._add_new(here.values, rows)
            if not all_complete(self.methods):
                break  # a search goes on

    def _add_new(
        self, values: Floats, rows: Indices, family: int | None = None, ahead: int = AHEAD
    ) -> Indices:
        """Add assembly modes of configurations (n, variables) that none of them has.

        `rows` (n,) are the samples they belong to, read if assembly modes are known at
        samples only. Returns the family (n,) of each, -1 if it is not in the range. With
        `family` that of all new ones is known. So many are followed together as `ahead`
        says, though one may turn out to be on the mode of another.
        """
        families = self._families_of(values, rows, 0)
        followed: dict[int, tuple[Floats, ModeCurve | None]] = {}
        for number in map(int, np.flatnonzero(families < 0)):
            before = len(self.assembly_modes)
            if families[number] >= 0 or self._is_full:
                continue
            if number not in followed:
                left = np.flatnonzero(families < 0)
                some = left[left >= number][:ahead]
                followed = dict(zip(some.tolist(), self._guided(values[some]), strict=True))
            self._add(*followed[number], family)
            if len(self.assembly_modes) == before:
                continue
            self._go_beyond()
            families[number] = self.families[before]
            left = np.flatnonzero(families < 0)
            families[left] = self._families_of(values[left], rows[left], before)
        return families

    def _families_of(self, values: Floats, rows: Indices, first: int) -> Indices:
        """Return the family (n,) of configurations on modes from `first` on, or -1.

        A configuration is on a mode if Newton's method leads there from near the guide.
        """
        families, driven = np.full(len(values), -1, dtype=np.intp), list(self.solver.driven)
        turning = [v for v in self.solver.angles if v not in driven]
        placed, q = self.solver.closure.at(values).placed, values[:, driven]
        for mode, family in zip(
            self.assembly_modes[first:], self.families[first:], strict=True
        ):
            (left,) = np.nonzero(families < 0)
            assert mode.guide is not None
            start, spread, why = mode.guide.predict(q[left], rows[left])
            off = max_abs(wrap(start - values[left])[:, turning], axis=1)
            left = left[(off < spread + NEAR_GUIDE) & (why == Status.OK)]
            if len(left):
                there = self.solver.evaluate(mode, q[left], rows[left]).rotations
                away = max_abs(there - placed[left], axis=(1, 2, 3))
                families[left[away < SAME_MODE]] = family
        return families

    def _go_beyond(self) -> None:
        """Follow the curves of modes that end within the range to further modes."""
        for assembly_mode in self.assembly_modes[self._followed :]:
            self._followed += 1
            guide = assembly_mode.guide
            if not isinstance(guide, ModeCurve) or guide.ends == (Status.OK, Status.OK):
                continue
            values = guide.values[len(guide.values) // 2]
            if not any(curve.passes(values[None])[0] for curve in self._curves):
                self._add_along(values, self.families[assembly_mode.number])

    def _add_along(self, values: Floats, family: int | None = None) -> None:
        """Add the modes in the range that lie on the curve through a configuration."""
        meshes = self.solver.gear_phases
        longest = (
            MAX_CURVE_LENGTH_RAD if meshes is None or meshes.all_known else LONGEST_ROLLED
        )
        try:
            curve = follow_arc(self.solver.closure, values, longest=longest)
        except SolveError:
            return
        self._curves.append(curve)
        given = self.solver.input_variable, *self.input_grid.range, *self.solver.periods
        middles = [piece.middle for piece in monotone_pieces(curve, *given)]
        values = np.array(middles).reshape(-1, curve.nodes.values.shape[1])
        self._add_new(values, np.zeros(len(values), dtype=np.intp), family)

    def _search(self) -> SearchStatistics:
        """Add what random starts over the range meet, and return how often they did."""
        low, high = self.input_grid.range
        starts = random_starts(self.solver, np.array([low]), np.array([high]))
        census = SearchStatistics(len(self.solver.mechanism.variable_owners), RANGE_ROUNDS)
        self._go_beyond()
        while census.goes_on and not self._is_full:
            made, values, rows = next(starts)
            met = self._add_new(values, rows, ahead=GUESSED)
            census.add(made, met, max(self.families, default=-1) + 1)
            self.probes += made
            self._working.tell(lambda: census.words("components"))
        return census


def _why_nothing_closes(solver: PositionSolver, input_grid: InputGrid) -> str:
    name = solver.mechanism.name
    inputs = solver.mechanism.names_of(solver.assembly.inputs)
    lows, highs = np.degrees([np.min(input_grid.q, axis=0), np.max(input_grid.q, axis=0)])
    degrees = ", ".join(
        f"{pair} in [{low:.6g}, {high:.6g}] deg"
        for pair, low, high in zip(inputs, lows, highs, strict=True)
    )
    state = solver.start(input_grid.q[spread_rows(len(input_grid), PROBED_INPUTS)])
    with np.errstate(invalid="ignore", divide="ignore"):
        for group in solver.assembly.groups:
            pairs = ", ".join(solver.mechanism.names_of(group.pairs))
            if not group.is_dyad:
                break
            place_dyad(state, group, 1)
            if np.all(state.is_open):
                return (
                    f"{name}: arcs cannot close: the {group.kind} of pairs {pairs} "
                    f"reaches nowhere for inputs {degrees}; change the arcs of its "
                    "links or the range"
                )
    cure = "its arcs, profiles or the range, or give a reference pose"
    if isinstance(solver.mechanism.geometry, PoseGeometry):
        cure = "the axes of its pose, profiles or the range"
    return (
        f"{name}: no configuration was found for inputs {degrees}: the {group.kind} "
        f"of pairs {pairs} did not close from any start, or only with profiles that enter "
        f"each other; change {cure}"
    )
