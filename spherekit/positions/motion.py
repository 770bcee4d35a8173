"""The motion of a mechanism: every assembly mode at every sample of its inputs.

Angles that go on over whole turns, where a motion reduces them to one.

Loads that depend on an angle itself, such as wound springs, want it to go on.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Array, Bools, Floats, Indices, Integers, SmallIntegers
from spherekit.conventions import DEFAULT_SAMPLES, TURN, Names
from spherekit.errors import CountError, SolveError, SpherekitError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.study import Crossings
from spherekit.geometry.mirror import quaternion
from spherekit.geometry.rotation import all_finite, nans
from spherekit.mechanism.joint import Joint
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.array_rows import ArrayRows
from spherekit.planning.assembly_plan import Assembly, driven_at, plan_assembly
from spherekit.positions.assembly_mode import (
    AssemblyMode,
    Evaluated,
    Solver,
    assembled,
    named,
)
from spherekit.positions.configuration_space import Configurations, configuration_curves
from spherekit.positions.fold_bounds import (
    bound_by_newton,
    curvature_bound,
    rounding_of_loops,
)
from spherekit.positions.input_grid import given_path, sampled, spread_rows
from spherekit.positions.linearisation import (
    Linearisation,
    LoopTree,
    condition,
    left_inverse,
)
from spherekit.positions.mode_meetings import (
    ModeMeeting,
    find_mode_meetings,
    follow_smooth_curves,
)
from spherekit.positions.mode_predictor import ModeOverGrid
from spherekit.positions.mode_search import ModeSearch
from spherekit.positions.timing import Timing
from spherekit.status import Status
from spherekit.wording import counted, listing


def extents(inputs: Floats, timing: Timing | None = None) -> list[Floats]:
    """Return least and greatest values (2, inputs) of inputs (n, inputs) and their rates.

    In rad and rad/s; the latter NaN where nothing says how the inputs move.
    """
    rates = nans(inputs.shape) if timing is None else timing.dq
    # Column by column, which is ten times as quick.
    return [
        np.array([[least(x) for x in rows.T] for least in (np.min, np.max)])
        for rows in (inputs, rates)
    ]


BESIDE_CROSSING = 1e-6
"""An input nearer (rad) to one at which curves cross is not used to tell modes apart."""
BLOCK = 16384
"""Rows evaluated at once by `PositionAnalysis.blocks`: enough to hide what calls take, few
enough for the caches; with half or twice as many a run takes the same time."""


@dataclass(frozen=True)
class Motion(ArrayRows):
    """Configurations in rows: mode after mode, in each the samples in order.

    Row r belongs to assembly mode `assembly_modes[r // samples]`. Shapes: `sample`,
    `assembly_mode`, `status`, `residual` (n,); `inputs` (n, inputs) rad; `values` (n,
    variables) rad; `placed` (n, links, 3, 3) the `rotations`, where these are known.
    Rows with a status other than OK or AT_SINGULARITY hold NaN, except for sample,
    assembly mode, inputs and status. `is_path` says that successive samples are neighbours.
    `timing` says when the rows happen, if that is known. `sense` (n,) is given where rows
    follow a mechanism through dead centres of its input: +1, or -1 where the input moves
    back while the mechanism moves on. `search` says how the assembly modes were found, and
    what that says of their number. `singular_error` (n,) rad bounds the errors of the
    variables in rows near dead centres, and is NaN in other rows.
    """

    mechanism: Mechanism
    joints: tuple[Joint, ...]
    assembly: Assembly
    assembly_modes: tuple[AssemblyMode, ...]
    samples: int
    sample: Integers
    assembly_mode: Integers
    inputs: Floats
    values: Floats
    status: SmallIntegers
    residual: Floats
    placed: Floats | None = None
    is_path: bool = True
    timing: Timing | None = None
    sense: Floats | None = None
    search: str = ""
    singular_error: Floats | None = None

    def __repr__(self) -> str:
        counts = Counter(Status(code).name for code in self.status.tolist())
        told = listing(f"{count} {name}" for name, count in counts.items()) or "no rows"
        return (
            f"<Motion of {self.mechanism.name}: {counted(self.samples, 'sample')} in "
            f"{counted(len(self.assembly_modes), 'assembly mode')}; {told}>"
        )

    def rows(self, chosen: slice | Array) -> Self:
        """Return some rows only, as a motion of one nameless assembly mode."""
        part = super().rows(chosen)
        return replace(part, samples=len(part))

    def __len__(self) -> int:
        return len(self.inputs)

    @property
    def q(self) -> Floats:
        """(n,) rad, the input of a mechanism with one freedom.

        Raises
        ------
        SolveError
            If there are several inputs.
        """
        if self.inputs.shape[1] != 1:
            raise SolveError(
                f"{self.mechanism.name} has {self.inputs.shape[1]} inputs; read `inputs`"
            )
        return self.inputs[:, 0]

    @cached_property
    def rotations(self) -> Floats:
        """(n, links, 3, 3) from link axes to ground axes."""
        return self.linearisation.placed

    @cached_property
    def linearisation(self) -> Linearisation:
        """The rows with all that follows from them, in ground axes."""
        tree = LoopTree.of(self.mechanism)
        return Linearisation(tree, self.joints, self.values, None, self.placed)

    @property
    def frames(self) -> Floats:
        """Pair frames (n, pairs, 3, 3) in ground axes; columns as in `Joint`."""
        return self.linearisation.frames

    @property
    def axes(self) -> Floats:
        """Pair axes (n, pairs, 3) in ground axes, see `positions.linearisation`."""
        return self.linearisation.axes

    @property
    def vectors(self) -> Floats:
        """Vectors of the variables (n, variables, 3) in ground axes."""
        return self.linearisation.vectors

    @cached_property
    def conditioning(self) -> Floats:
        """(n,) condition of the closure Jacobian without the inputs, in the 2-norm.

        It grows without bound towards singularities of type II; infinite where loops do
        not hold the links, 1 where there is no loop, NaN where the row failed.
        """
        return condition(self.free_jacobian)

    @cached_property
    def free(self) -> tuple[int, ...]:
        """Numbers of the variables that are not inputs."""
        held = {self.mechanism.variables_of(pair)[0] for pair in self.assembly.inputs}
        return tuple(v for v in range(self.values.shape[1]) if v not in held)

    @cached_property
    def free_jacobian(self) -> Floats:
        """(n, equations, free) how loops open as the variables without the inputs move."""
        return np.ascontiguousarray(self.linearisation.jacobian[:, :, list(self.free)])

    @cached_property
    def closure_inverse(self) -> Floats:
        """(n, free, equations) how those variables close loops; NaN where singular."""
        return left_inverse(self.free_jacobian)

    @cached_property
    def sensitivity(self) -> Floats:
        """(n,) how far variables move when loops open by one unit.

        The Frobenius norm of the inverse of the closure Jacobian without the inputs:
        infinite where loops do not hold the links, 0 where nothing is left to hold, NaN
        where the row failed.
        """
        _, equations, free = self.free_jacobian.shape
        sensitivity = np.full(len(self), np.inf if free else 0.0)
        if 0 < free <= equations:
            inverse = np.linalg.norm(self.closure_inverse, axis=(1, 2))
            sensitivity = np.where(np.isfinite(inverse), inverse, np.inf)
        sensitivity[self.failed] = np.nan
        return sensitivity

    @property
    def gap(self) -> Floats:
        """(n,) rad, by how much loops may be open, in each component.

        The residual, and what rounding alone opens, see
        `spherekit.positions.fold_bounds.rounding_of_loops`.
        """
        return np.nan_to_num(self.residual) + rounding_of_loops(self.linearisation)

    @property
    def bend(self) -> Floats:
        """(n,) how much of `sensitivity` itself the gap of the loops may change.

        Above 1/2 nothing says that the solution is near (Kantorovich's theorem).
        """
        return self._curvature * self.sensitivity**2 * self.gap

    @cached_property
    def _curvature(self) -> Floats:
        """(n,) how much a turn of all variables by one radian bends the loops, at most."""
        return curvature_bound(self.linearisation)

    @property
    def fold_error(self) -> Floats:
        """(n,) rad, about how far variables are off where branches meet."""
        return np.sqrt(self.gap / self._curvature)

    @cached_property
    def float64_error(self) -> Floats:
        """(n,) rad, how far variables may be off, by float64 computations alone.

        It contains the rounding of the sizes of the file to float64, so it applies to the
        decimal sizes as well as to the float64 numbers next to them. It is infinite near
        dead centres (`spherekit.positions.fold_bounds.bound_by_newton`), and NaN where the
        row failed or was not constructed.
        """
        if np.all(np.isnan(self.residual)):
            return nans(len(self))
        error = bound_by_newton(self.sensitivity, self.gap, self._curvature)
        return np.where(self.failed, np.nan, error)

    @cached_property
    def configuration_error(self) -> Floats:
        """(n,) rad, how far variables may be off.

        It is `float64_error` where that is finite. Nearer to dead centres it is the
        `singular_error` of the row. NaN where the row failed or was not constructed.
        """
        if self.singular_error is None:
            return self.float64_error
        is_unknown = np.isinf(self.float64_error) & np.isfinite(self.singular_error)
        return np.where(is_unknown, self.singular_error, self.float64_error)

    @property
    def orientation_error(self) -> Floats:
        """(n,) rad, how far links may be off: all variables on the way to one add up."""
        return self.configuration_error * self.linearisation.tree.longest_path

    @checked(SolveError)
    def quaternions(self, link: int) -> Floats:
        """Return (n, 4) xyzw, from the link's axes to ground axes."""
        return quaternion(self.rotations[:, link])

    @cached_property
    def failed(self) -> Bools:
        """(n,) rows that hold no configuration.

        A row beside a dead centre whose angles are not known is one of them.
        """
        failed = ~assembled(self.status)
        singular = self.status == Status.AT_SINGULARITY
        if np.any(singular):
            failed[singular] = ~all_finite(self.values[singular], 1)
        return failed


def motion_of(solver: Solver, values: Floats) -> Motion:
    """Return closed configurations (n, V) as a motion of one nameless assembly mode.

    Singular ones are rows like others: their status is OK.
    """
    at, inputs = solver.closure.at(values), values[:, list(solver.driven)]
    status = np.full(len(values), Status.OK, dtype=np.int8)
    there = Evaluated(values, at.placed, status, at.gap, nans(len(values)))
    return _in_rows(solver, (), inputs, np.arange(len(values)), there, False)


def _in_rows(
    solver: Solver,
    assembly_modes: tuple[AssemblyMode, ...],
    q: Floats,
    sample: Indices,
    there: Evaluated,
    is_path: bool,
) -> Motion:
    """Return configurations at samples (k,), mode after mode, as a motion.

    The inputs there are q (k, inputs).
    """
    numbers = [mode.number for mode in assembly_modes] or [0]
    k, count = len(q), len(numbers)
    return Motion(
        mechanism=solver.mechanism,
        joints=solver.joints,
        assembly=solver.assembly,
        assembly_modes=assembly_modes,
        samples=k,
        sample=np.tile(sample, count),
        assembly_mode=np.repeat(numbers, k),
        inputs=np.tile(q, (count, 1)),
        values=there.values,
        placed=there.rotations,
        status=there.status,
        residual=there.residual,
        is_path=is_path,
        singular_error=there.singular_error,
    )


class PositionAnalysis:
    """The assembly modes of a mechanism over its inputs, evaluated as asked.

    Parameters
    ----------
    mechanism
        A mechanism with a freedom for each of its inputs.
    input_pair
        Names of the driven pairs, if not those the mechanism declares.
    assembly_mode
        Number of the only assembly mode wanted, or its name in the file; all by default.
    search
        Whether to look for assembly modes beside that of a given reference pose.
    samples
        Number of samples on the straight path through the ranges of all inputs; with
        `grid` the number for each input, or a sequence of those.
    grid
        Whether to sample all combinations of the inputs.
    path
        (n, inputs) rad: the inputs wanted, instead of the ranges.
    follow
        Whether assembly modes are found and followed over the samples; without there are
        none, and every motion is empty.
    crossings
        Whether an assembly mode keeps the signs of its dyads where curves cross ("end"), or
        follows its smooth curve through the crossing ("pass"), for which the signs change.
    independent
        Whether the samples of a path are given each for itself, and are no motion. Then
        configurations of several inputs that no verified steps join may belong to one mode,
        if it has none at a sample between them, so that inputs far apart from each other
        have few modes; and where no sample can be reached there is one mode of failed rows
        instead of an error.

    Raises
    ------
    PlanError
        If there is not one freedom for each input, or an input is a contact pair.
    SolveError
        If it cannot be assembled anywhere, or the assembly mode is unknown.
    """

    @checked(SolveError)
    def __init__(
        self,
        mechanism: Mechanism,
        input_pair: str | Sequence[str] | None = None,
        assembly_mode: int | str | None = None,
        search: bool = True,
        samples: int | Sequence[int] = DEFAULT_SAMPLES,
        grid: bool = False,
        path: Floats | None = None,
        follow: bool = True,
        crossings: Crossings = "end",
        independent: bool = False,
    ) -> None:
        self._follow = follow
        self.crossings = crossings
        self.numbering_input = np.nan
        """With crossings "pass": the input (rad) at which a smooth curve has the number and
        the signs of the mode there."""
        self._independent = independent
        self.mechanism = driven_at(mechanism, input_pair)
        self.input_grid = sampled(self.mechanism, samples, grid, path)
        self.by_rank = False
        try:
            self.assembly_modes = self._assembled(search)
        except CountError as counted:
            self.by_rank = True
            try:
                self.assembly_modes = self._assembled(search)
            except SpherekitError:
                raise counted from None
        self._every_mode = self.assembly_modes
        if crossings == "pass" and follow:
            self._pass_crossings()
        self.assembly_modes, self.unnamed = named(self.solver, self.assembly_modes)
        if assembly_mode is not None:
            self.assembly_modes = (self.assembly_modes[self.place_of(assembly_mode)],)

    def place_of(self, assembly_mode: int | str) -> int:
        """Return the place of an assembly mode among those found.

        Raises
        ------
        SolveError
            If none of them has this number, or this name in the file.
        """
        for place, item in enumerate(self.assembly_modes):
            if str(assembly_mode) in (str(item.number), item.name or str(item.number)):
                return place
        every = listing(f"{item.number} ({item.title})" for item in self.assembly_modes)
        raise SolveError(
            f"{self.mechanism.name}: there is no assembly mode {assembly_mode}; the "
            f"assembly modes found are {every}{''.join(f'; {why}' for why in self.unnamed)}"
        )

    def _assembled(self, search: bool) -> tuple[AssemblyMode, ...]:
        """Return the modes; `PlanError` unless there is a freedom for each input."""
        self.assembly = plan_assembly(self.mechanism, self.by_rank)
        self.solver = Solver(self.mechanism, self.assembly)
        if not self._follow:
            return ()
        there = ModeSearch(self.solver, self.input_grid, search, self._independent)
        self.methods, self.claim, self._probes = there.methods, there.claim, there.probes
        self._crossings = there.crossings
        self.solver.exact_configurations += [item.values for item in there.crossings]
        return tuple(there.assembly_modes)

    def _pass_crossings(self) -> None:
        """Let assembly modes follow their smooth curves through crossings.

        Each keeps its number around the reference pose, if its input is in the range and no
        curves cross there, else at the low end of the range.

        Raises
        ------
        SolveError
            If there are several inputs, or modes meet and it is not known how they go on.
        """
        name = self.mechanism.name
        if len(self.inputs) != 1:
            raise SolveError(
                f"{name}: crossings are passed with one input only: the inputs are "
                f'{listing(self.inputs)}; lock all but one, or leave crossings at "end"'
            )
        for meeting in self.mode_meetings:
            if not meeting.resolved:
                raise SolveError(
                    f"{name}: {meeting.describe(self.inputs[0], True)}; narrow the range "
                    'to one side of that input, or leave crossings at "end"'
                )
        low, high = self.input_grid.range
        self.numbering_input = low + BESIDE_CROSSING
        anchor = float(self.solver.anchor[0])
        away = [abs(meeting.input - anchor) for meeting in self.mode_meetings]
        if (
            self.solver.reference is not None
            and low <= anchor <= high
            and min(away, default=np.inf) > BESIDE_CROSSING
        ):
            self.numbering_input = anchor
        self.assembly_modes = follow_smooth_curves(
            self._every_mode, self.mode_meetings, self.numbering_input
        )

    @cached_property
    def mode_meetings(self) -> tuple[ModeMeeting, ...]:
        """Inputs in the range at which curves of assembly modes cross, rising.

        They are known of one input whose groups are dyads, triads, trains of wheels, or
        one group of seven bodies, and empty of others.
        """
        if not self._follow or len(self.inputs) != 1:
            return ()
        return find_mode_meetings(self.solver, self._every_mode, self._crossings)

    @property
    def meeting_sentences(self) -> Names:
        """What is to be said of each input at which modes meet."""
        (name,) = self.inputs if len(self.inputs) == 1 else ("",)
        passed = self.crossings == "pass"
        return tuple(meeting.describe(name, passed) for meeting in self.mode_meetings)

    @property
    def inputs(self) -> Names:
        """Names of the driven pairs."""
        return self.mechanism.input_pairs

    @property
    def range(self) -> tuple[float, float]:
        """The least and the greatest sampled value of the only input (rad).

        Raises
        ------
        PlanError
            If there are several inputs.
        """
        _ = self.assembly.input
        return self.input_grid.range

    @property
    def search(self) -> str:
        """How the assembly modes were found, and what that says of their number."""
        if not self._follow:
            return "no motion was traced"
        if not self._probes:
            return f"{self.claim}; no others were looked for"
        used = [
            f"{group.kind}: {method.words}"
            for group, method in zip(self.assembly.groups, self.methods, strict=True)
            if method is not None
        ]
        return "; ".join(dict.fromkeys([str(self.claim), *used]))

    @cached_property
    def configurations(self) -> Configurations:
        """All configuration curves that meet the input's range; `PlanError` as `range`."""
        return configuration_curves(self.solver, self.assembly_modes, *self.range)

    def at(self, q: Floats) -> Motion:
        """Return all assembly modes at inputs q (k,) or (k, inputs) rad, any order.

        Raises
        ------
        SolveError
            If several inputs drive irreducible groups, whose modes are followed over
            given samples only: give them to the tracer as `path`.
        """
        if any(isinstance(mode.guide, ModeOverGrid) for mode in self.assembly_modes):
            raise SolveError(
                f"{self.mechanism.name}: with several inputs and irreducible groups the "
                "motion is known at the samples of the tracer only; give these inputs as "
                "its path"
            )
        return self._at(given_path(q, len(self.inputs)).q, None)

    def given(self, values: Floats) -> Motion:
        """Return closed configurations (n, variables) as a motion; see `motion_of`."""
        return motion_of(self.solver, values)

    def _at(self, q: Floats, rows: Indices | None) -> Motion:
        if not self.assembly_modes:
            none = np.empty((0, len(self.mechanism.variable_owners)))
            return replace(motion_of(self.solver, none), samples=len(q))
        there = Evaluated.joined(
            [self.solver.evaluate(mode, q, rows) for mode in self.assembly_modes]
        )
        sample = np.arange(len(q)) if rows is None else rows
        is_path = self.input_grid.is_path
        motion = _in_rows(self.solver, self.assembly_modes, q, sample, there, is_path)
        return replace(motion, search=self.search)

    def sparse(self, most: int) -> Motion:
        """Return the motion at about `most` of the samples, spread evenly."""
        return self.samples(spread_rows(len(self.input_grid), most))

    def samples(self, rows: Indices) -> Motion:
        """Return the motion at some of the samples, by their numbers."""
        return self._at(self.input_grid.q[rows], rows)

    @property
    def block(self) -> int:
        """Samples in a block of about `BLOCK` rows of all assembly modes together."""
        return max(1, BLOCK // max(1, len(self.assembly_modes)))

    def motion(self) -> Motion:
        """Return the motion at all samples."""
        return next(self.blocks(len(self.input_grid)))

    def blocks(self, size: int | None = None, first: int = 0) -> Iterator[Motion]:
        """Yield the motion from sample `first` on in blocks of successive samples.

        So many samples that a block of all assembly modes has about `BLOCK` rows, if no
        `size` is given.
        """
        size = size or self.block
        for start in range(first, len(self.input_grid), size):
            yield self.samples(np.arange(start, min(start + size, len(self.input_grid))))


@checked(SolveError)
def trace(
    mechanism: AnyMechanism,
    samples: int | Sequence[int] = DEFAULT_SAMPLES,
    input_pair: str | Sequence[str] | None = None,
    assembly_mode: int | None = None,
    search: bool = True,
    grid: bool = False,
    path: Floats | None = None,
    crossings: Crossings = "end",
) -> Motion:
    """Return the motion of a mechanism over the ranges of its inputs.

    Parameters and errors are those of `PositionAnalysis`.
    """
    return PositionAnalysis(
        mechanism_of(mechanism),
        input_pair,
        assembly_mode,
        search,
        samples,
        grid,
        path,
        crossings=crossings,
    ).motion()


LastAngles = dict[str, list[float]]
"""The last configuration of each mode with its turns, from which samples go on.

With one input nothing is remembered: its value says how far all angles have turned.
"""


def continued(
    motion: Motion, names: Iterable[str], solver: Solver, last: LastAngles
) -> Mapping[str, Floats]:
    """Return the variables (n,) of pairs, by name, at the next block of a motion.

    Angles are those of `spherekit.positions.assembly_mode`; NaN stays, is passed over.
    That of a driven pair is the input as it was given. Arc lengths, and angles of a
    simulation, which go on already, are those of the motion. What is the `last` is set.
    """
    mechanism, inputs = motion.mechanism, motion.assembly.inputs
    names, turns = list(names), np.zeros_like(motion.values)
    wanted = [mechanism.angles[name] for name in names if name in mechanism.angles]
    if wanted and motion.sense is None:
        for place, mode in enumerate(motion.assembly_modes):
            first, key = place * motion.samples, str(mode.number)
            here = motion.values[first : first + motion.samples]
            rows = np.flatnonzero(all_finite(here, 1)) + first
            if not len(rows):
                continue
            at = motion.values[rows], motion.inputs[rows]
            unwrapping = solver.unwrapping
            if mode.pieces:
                turns[rows] = unwrapping.smooth_turns(mode, *at, wanted)
            else:
                turns[rows] = unwrapping.turns(mode.number, *at, wanted, last.get(key))
            if len(inputs) > 1:
                whole = motion.values[rows[-1]] + TURN * turns[rows[-1]]
                whole[list(solver.driven)] = motion.inputs[rows[-1]]
                last[key] = whole.tolist()
    angles = {}
    for name in names:
        pair = mechanism.pair_number[name]
        (variable,) = mechanism.variables_of(pair)
        angles[name] = motion.values[:, variable] + TURN * turns[:, variable]
        if pair in inputs:
            angles[name] = motion.inputs[:, inputs.index(pair)]
    return angles


def going_on(motion: Motion, solver: Solver) -> Motion:
    """Return a motion whose angles go on over all turns, as loads see them."""
    values, angles = motion.values.copy(), motion.mechanism.angles
    for pair, angle in continued(motion, angles, solver, {}).items():
        values[:, angles[pair]] = angle
    return replace(motion, values=values)
