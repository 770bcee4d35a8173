"""The assembly modes of irreducible groups, found one after another and followed.

Those at some inputs are all found by elimination or some by a search; each new one is
followed as far as it goes, and beyond where its curve goes on in the range.
"""

from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status, counted
from spherekit.errors import PlanError, SolveError
from spherekit.guarantee import Claim, Guarantee
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.arc_length import LONGEST, follow_arc
from spherekit.motion.assemblies import MOST_ASSEMBLY_MODES, assemblies, signs_at
from spherekit.motion.assembly_modes import AssemblyMode, Solver, determinant_signs
from spherekit.motion.distinct import SAME_MODE
from spherekit.motion.elimination import has_elimination
from spherekit.motion.follow import ModeCurve
from spherekit.motion.groups import group_variables, place_dyad, place_group
from spherekit.motion.guides import Guided, guided
from spherekit.motion.input_grid import InputGrid
from spherekit.motion.input_turning_points import input_turning_points
from spherekit.motion.monotone_segments import MonotoneSegments
from spherekit.motion.range_search import RANGE_ROUNDS, RangeSearch
from spherekit.motion.search import STARTS, Census
from spherekit.motion.solutions import CLOSED_FORM, Method, least_complete
from spherekit.numeric.turns import wrap
from spherekit.planning.rigidity import graph_mobility, inputs_to_declare
from spherekit.progress import Working
from spherekit.sphere.rotation import Floats

Rows = NDArray[np.intp]

MOST_FOLLOWED = 60000
"""Nodes of all modes of irreducible groups, after which no further one is followed."""
MOST_IN_VAIN = 12000
"""The same for steps that led to none: a mode has some tens of nodes, and about three
such steps; thousands where a configuration is singular in higher order."""
PROBES = 5
"""Inputs at which modes are looked for where those at which they meet are not known."""
FINER = 3
"""So many times more of them where elimination finds all modes at an input."""
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
AS_ASSEMBLED = Claim(
    Guarantee.COMPONENT,
    "the mode of the reference pose, and where it ends those that go on; wheels put "
    "together otherwise were not looked for",
)


@final
class Gathering:
    """The assembly modes of a mechanism with irreducible groups, found one after another.

    `families[k]` is the number of the component of assembly mode k, as far as is known:
    those that were come to on one configuration curve have the same.
    """

    def __init__(self, solver: Solver, input_grid: InputGrid) -> None:
        self.solver, self.input_grid = solver, input_grid
        self.assembly_modes: list[AssemblyMode] = []
        self.families: list[int] = []
        self.freedoms: list[int] = []
        self.probes = self.nodes = self.in_vain = 0
        self.methods: list[Method | None] = [None] * len(solver.assembly.groups)
        self._curves: list[ArcCurve] = []
        self._followed = 0
        self._working = Working("searching the assembly modes")

    @property
    def is_full(self) -> bool:
        """Whether no further assembly mode is to be followed."""
        return len(self.assembly_modes) >= MOST_ASSEMBLY_MODES or self.is_spent

    @property
    def is_spent(self) -> bool:
        """Whether as many steps were made as may be; there is at least one mode then."""
        in_vain = bool(self.assembly_modes) and self.in_vain > MOST_IN_VAIN
        return self.nodes > MOST_FOLLOWED or in_vain

    def add(self, start: Guided, family: int | None = None) -> None:
        """Add the mode through a configuration, if it is in the range."""
        values, guide = start.values, start.guide
        if start.freedoms is not None:
            self.freedoms.append(start.freedoms)
        self.in_vain += start.tried
        if guide is not None:
            assembly_mode = AssemblyMode(
                len(self.assembly_modes), signs_at(self.solver, values), guide
            )
            if isinstance(guide, ModeCurve):  # where the pose itself may be a dead centre
                values = guide.values[len(guide.values) // 2]
                self.in_vain -= len(guide.values) - 1
            self.assembly_modes.append(
                _with_determinants(self.solver, assembly_mode, values)
            )
            self.nodes += len(guide.values)
            self._working.tell(lambda: f"{len(self.assembly_modes)} followed")
            new = max(self.families, default=-1) + 1
            self.families.append(new if family is None else family)

    def add_reference(self) -> None:
        """Add the assembly mode of the reference pose, if there is one.

        Raises
        ------
        PlanError
            If the rank there leaves fewer freedoms than there are inputs.
        """
        reference = self.solver.geometry.reference
        if reference is None:
            return
        driven, q = list(self.solver.driven), self.input_grid.q
        values = reference.copy()
        middle = 0.5 * (np.min(q, axis=0) + np.max(q, axis=0))
        half = 0.5 * np.ptp(q, axis=0)
        outside = np.abs(reference[driven] - middle) > half
        if np.any(outside) and self.solver.meshes is not None:
            values = self.solver.meshes.moved(reference, driven, middle)
        elif np.any(outside):
            turns = np.round((middle - reference[driven]) / (2 * np.pi))
            values[driven] += np.where(outside, 2 * np.pi * turns, 0.0)
        self.add(guided(self.solver, self.input_grid, values[None])[0])
        if not self.assembly_modes and len(driven) == 1 and self.solver.meshes is not None:
            self._add_along(values)
        if self.freedoms and self.freedoms[0] < len(driven):
            # Where the pose given cannot move, a search of other modes takes long and is
            # not what was asked.
            raise other_rank(self.solver, self.freedoms[0])

    def all_modes(self) -> Claim:
        """Look for further modes in the whole range; return what is claimed then."""
        solver, input_grid = self.solver, self.input_grid
        if solver.meshes is not None and not self.assembly_modes:
            self.probe(input_grid.q[:1])
        if solver.meshes is not None and not solver.meshes.all_known:
            return self._as_assembled()
        groups = solver.assembly.groups
        if all(
            group.is_dyad or number in solver.trains or has_elimination(group)
            for number, group in enumerate(groups)
        ):
            claim = self._eliminated()
            if claim is not None:
                return claim
        self.methods = [
            CLOSED_FORM if group.is_dyad else method or Method(0)
            for group, method in zip(groups, self.methods, strict=True)
        ]
        census = self.search()
        if not self.assembly_modes:
            # Random starts leave out what is next to a dead centre.
            self.probe(input_grid.q[len(input_grid.q) // 2][None])
        things = "components" if len(solver.driven) == 1 else "modes"
        return Claim(Guarantee.SAMPLED, census.words(things))

    def _as_assembled(self) -> Claim:
        """Find the curve of wheels whose lengths rolled do not follow from the inputs."""
        for q in _scattered(self.input_grid):
            if not self.assembly_modes:
                self.probe(q[None])
        self.go_beyond()
        if self.probes:
            return Claim(
                Guarantee.SAMPLED, f"modes found at {counted(self.probes, 'input')}"
            )
        return AS_ASSEMBLED

    def _eliminated(self) -> Claim | None:
        """Find all modes at some inputs; return None if some may be missing there."""
        if len(self.solver.driven) > 1:
            self.probe(_scattered(self.input_grid))
            claim = Claim(Guarantee.SAMPLED, f"modes at {self.probes} of the samples")
            return claim if self._is_complete else None
        dead = input_turning_points(
            self.solver, *self.input_grid.range, MOST_COST, MOST_TIME
        )
        step = np.ptp(self.input_grid.q) / PROBES
        self.probe(dead.probes(step)[:, None])
        if self._is_complete and dead.gap(step):
            done = dead.probes(step)
            step = step / FINER
            finer = dead.probes(step)
            apart = np.abs(finer[:, None] - done).min(axis=1) > 1e-9
            self.probe(finer[apart, None])
        if not self._is_complete:
            return None
        claim = dead.claim(step)
        if not dead.gap(step):
            return claim
        self.go_beyond()
        words = f"{claim.reason}; between them {self.search().words('components')}"
        return replace(claim, reason=words)

    @property
    def _is_complete(self) -> bool:
        return all(method is None or method.is_complete for method in self.methods)

    def probe(self, inputs: Floats) -> None:
        """Add the assembly modes of all modes found at inputs (n, inputs)."""
        for q in inputs:
            if self.is_full:
                break
            here = assemblies(self.solver, q)
            self.probes += 1
            self.methods = [
                least_complete(*both)
                for both in zip(self.methods, here.methods, strict=True)
            ]
            if here.modes:
                values = np.array([values for _, values in here.modes])
                row = self.input_grid.nearest(q, 1)
                self.add_new(values, np.repeat(row, len(values)))

    def add_new(
        self, values: Floats, rows: Rows, family: int | None = None, ahead: int = AHEAD
    ) -> Rows:
        """Add assembly modes of configurations (n, variables) that none of them has.

        `rows` (n,) are the samples they belong to, read if assembly modes are known at
        samples only. Returns the family (n,) of each, -1 if it is not in the range. With
        `family` that of all new ones is known. So many are followed together as `ahead`
        says, though one may turn out to be on the mode of another.
        """
        families = self._families_of(values, rows, 0)
        followed: dict[int, Guided] = {}
        for number in map(int, np.flatnonzero(families < 0)):
            before = len(self.assembly_modes)
            if families[number] >= 0 or self.is_full:
                continue
            if number not in followed:
                left = np.flatnonzero(families < 0)
                some = left[left >= number][:ahead]
                starts = guided(self.solver, self.input_grid, values[some])
                followed = dict(zip(some.tolist(), starts, strict=True))
            self.add(followed[number], family)
            if len(self.assembly_modes) == before:
                continue
            self.go_beyond()
            families[number] = self.families[before]
            left = np.flatnonzero(families < 0)
            families[left] = self._families_of(values[left], rows[left], before)
        return families

    def go_beyond(self) -> None:
        """Follow the curves of modes that end within the range to further modes."""
        if len(self.solver.driven) > 1:
            return
        for assembly_mode in self.assembly_modes[self._followed :]:
            self._followed += 1
            guide = assembly_mode.guide
            if not isinstance(guide, ModeCurve) or guide.ends == (Status.OK, Status.OK):
                continue
            values = guide.values[len(guide.values) // 2]
            if any(curve.passes(values[None])[0] for curve in self._curves):
                continue
            self._add_along(values, self.families[assembly_mode.number])

    def _add_along(self, values: Floats, family: int | None = None) -> None:
        """Add the modes in the range that lie on the curve through a configuration."""
        meshes = self.solver.meshes
        longest = LONGEST if meshes is None or meshes.all_known else LONGEST_ROLLED
        try:
            curve = follow_arc(self.solver.closure, values, longest=longest)
        except SolveError:
            return
        self._curves.append(curve)
        (period,) = self.solver.periods
        parts = MonotoneSegments.of(
            curve, self.solver.single, *self.input_grid.range, period
        )
        rows = np.zeros(len(parts.middles), dtype=np.intp)
        self.add_new(parts.middles, rows, family)

    def search(self) -> Census:
        """Add what random starts over the range meet, and return how often they did."""
        q, several = self.input_grid.q, len(self.solver.driven) > 1
        low, high = np.min(q, axis=0), np.max(q, axis=0)
        starts = RangeSearch(self.solver, low, high, q if several else None)
        census = Census(len(self.solver.mechanism.variable_owners), RANGE_ROUNDS)
        self.go_beyond()
        while census.goes_on and not self.is_full:
            count = 1 if census.starts else RANGE_ROUNDS
            met = self.add_new(*starts.rounds(count), ahead=1 if several else GUESSED)
            census.add(count * STARTS, met, max(self.families, default=-1) + 1)
            self.probes += count * STARTS
            self._working.tell(lambda: census.words("components"))
        return census

    def _families_of(self, values: Floats, rows: Rows, first: int) -> Rows:
        """Return the family (n,) of configurations on modes from `first` on, or -1.

        Each is asked of the mode whose guide is nearest, then of the others that are near.
        """
        families = np.full(len(values), -1, dtype=np.intp)
        modes = self.assembly_modes[first:]
        if not modes or not len(values):
            return families
        of_modes = np.array(self.families[first:], dtype=np.intp)
        driven = list(self.solver.driven)
        placed = self.solver.closure.at(values).placed
        away = np.stack([self._away(mode, values, rows) for mode in modes])
        for nearest in np.argsort(away, axis=0, kind="stable"):
            near = np.isfinite(away[nearest, np.arange(len(values))])
            (left,) = np.nonzero(near & (families < 0))
            if not len(left):
                break
            which = nearest[left]
            there = self.solver.evaluate_each(
                modes, which, values[left][:, driven], rows[left]
            )
            same = np.max(np.abs(there.rotations - placed[left]), axis=(1, 2, 3))
            closed = (there.status == Status.OK) | (there.status == Status.AT_SINGULARITY)
            closed &= same < SAME_MODE
            families[left[closed]] = of_modes[which[closed]]
        return families

    def _away(self, assembly_mode: AssemblyMode, values: Floats, rows: Rows) -> Floats:
        """Return how far (n,) configurations are from a guide; infinite if not near it."""
        driven = list(self.solver.driven)
        angles = [v for v in self.solver.angles if v not in driven]
        guide, covered = assembly_mode.guide, np.ones(len(values), dtype=bool)
        if isinstance(guide, ModeCurve):
            along = values[:, driven[0]]
            predicted, spread = guide.predict(along)
            covered = guide.covers(along)
        else:
            assert guide is not None
            predicted, spread = guide.values[rows], np.zeros(len(rows))
        gaps = np.abs(wrap(predicted - values)[:, angles])
        away = np.max(gaps, axis=1, initial=0.0)
        return np.where(covered & (away < spread + NEAR_GUIDE), away, np.inf)


def other_rank(solver: Solver, freedoms: int) -> PlanError:
    """Return the error of a mechanism whose inputs are not its freedoms by rank."""
    return PlanError(
        f"{solver.mechanism.name}: mobility {freedoms} by rank with "
        f"{graph_mobility(solver.mechanism)} by the graph, but the number of inputs is "
        f"{len(solver.driven)}; {inputs_to_declare(freedoms)}"
    )


def _scattered(input_grid: InputGrid) -> Floats:
    """Return samples (k, inputs) spread over an input grid, its middle first."""
    parts = (np.arange(PROBES) + 0.5) / PROBES
    order = np.argsort(np.abs(parts - 0.5), kind="stable")
    rows = np.zeros(PROBES, dtype=np.intp)
    for axis, count in enumerate(input_grid.shape):
        step = np.roll(parts[order], axis * (PROBES // 2)) if axis else parts[order]
        place = np.minimum((step * count).astype(np.intp), count - 1)
        rows = rows * count + place
    return input_grid.q[np.unique(rows)]


def _with_determinants(
    solver: Solver, assembly_mode: AssemblyMode, values: Floats
) -> AssemblyMode:
    """Give the assembly mode the signs of its irreducible groups' determinants."""
    state = solver.start(values[None, list(solver.driven)])
    determinants = []
    for group, sign in zip(solver.assembly.groups, assembly_mode.signs, strict=True):
        if sign:
            place_dyad(state, group, solver.mechanism.ends, sign)
            determinants.append(float(sign))
        else:
            start = values[None, group_variables(state, group)]
            _, at = place_group(state, group, solver.mechanism.ends, start)
            determinant, _ = determinant_signs(at.jacobian)
            determinants.append(float(determinant[0]))
    return AssemblyMode(
        assembly_mode.number, assembly_mode.signs, assembly_mode.guide, tuple(determinants)
    )
