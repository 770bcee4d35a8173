"""The position analysis: every assembly mode of a mechanism at samples of its inputs."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats, Indices
from spherekit.completeness import Completeness, Guarantee
from spherekit.conventions import DEFAULT_SAMPLES, Names
from spherekit.errors import CountError, SolveError, SpherekitError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.study import Crossings
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.sizes import angles_in_radians
from spherekit.planning.assembly_plan import driven_at, plan_assembly
from spherekit.positions.angle_unwrapping import AngleUnwrapping
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.configuration_space import Configurations, configuration_curves
from spherekit.positions.group_solutions import SolutionMethod
from spherekit.positions.input_grid import make_input_grid, make_path, spread_rows
from spherekit.positions.mode_meetings import (
    ModeMeeting,
    find_mode_meetings,
    follow_smooth_curves,
)
from spherekit.positions.mode_names import assign_mode_names
from spherekit.positions.mode_predictor import ModeOverGrid
from spherekit.positions.mode_search import ModeSearch
from spherekit.positions.motion import Motion, arrange_rows, make_motion
from spherekit.positions.position_solver import ModeConfigurations, PositionSolver
from spherekit.quantity import AngleUnit
from spherekit.wording import counted, listing, numbered

MIN_CROSSING_DISTANCE_RAD = 1e-6
"""Smooth curves are numbered this far from a crossing of curves.

At a crossing itself the modes coincide and cannot be distinguished. The input of a
reference pose that is nearer to a crossing does not number curves. The input just above the
low end of the range is at this distance from the low end.
"""
BLOCK_ROWS = 16384
"""Number of rows in a block of `PositionAnalysis.blocks`.

Larger: the arrays of a block exceed the caches of the processor. Smaller: the overhead of
calls is noticeable. With half or twice as many a run takes the same time.
"""


class PositionAnalysis:
    """The assembly modes of a mechanism over samples of its inputs.

    Modes are searched when the analysis is constructed. Configurations are computed on
    request.

    Parameters
    ----------
    mechanism
        A mechanism with as many degrees of freedom as inputs.
    input_pair
        Names of the driven pairs, by default those that the mechanism declares.
    assembly_mode
        Number or name of the only mode to be computed; all by default.
    search
        Whether to search for modes other than the mode of a given reference pose.
    samples
        Number of samples on the straight path through the ranges of all inputs. If `grid`
        is true, it is the number for each input. A sequence has one number for each input,
        and always gives a grid.
    grid
        Whether to sample all combinations of the inputs.
    path
        (n, inputs) values of the inputs (rad), instead of their ranges.
    follow
        Whether configurations are computed. If not, there are no assembly modes, and every
        motion is empty.
    crossings
        What an assembly mode does where configuration curves cross. With "end" it keeps
        the signs of its dyads. With "pass" it follows its smooth curve through the
        crossing, and its signs change.
    independent
        Whether the samples of a path are unrelated to each other, and are no motion. With
        several inputs, modes with equal signs then count as one mode if no verified steps
        connect them and a sample without a configuration is between them. If no sample can
        be reached, the result is one mode of failed rows, not an error.

    Attributes
    ----------
    mechanism
        The mechanism, driven at the chosen pairs.
    input_grid
        The sampled inputs.
    assembly
        The groups of links in solving order.
    solver
        The solver of the positions.
    assembly_modes
        The modes that were found, or the requested one.
    by_rank
        Whether the mobility follows from the rank of the velocity equations, because
        counting on the graph gives another one.
    claim
        Whether assembly modes can be missing.
    methods
        How the modes of each group were found, None if they were not searched.
    unused_mode_names
        A sentence for each name in the file that no mode has.
    other_modes
        The modes that were found beside the requested one; empty if all are requested.
    numbering_input
        With "pass": an input (rad). Each smooth curve has the number and the signs of the
        mode to which it belongs at this input.

    Raises
    ------
    PlanError
        If the mobility is not the number of inputs, or an input is a contact pair.
    SolveError
        If the mechanism cannot be assembled anywhere, or the requested mode does not exist.
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
        """Sample the inputs, search the assembly modes, and name them.

        An assembly mode is one of the ways in which the mechanism can be put together at
        given inputs. `crossings` is "end" or "pass": what modes do where curves of
        configurations cross. If `follow` is false, there are no modes. `independent` says
        that the samples are unrelated and no motion. The class describes all parameters.
        """
        self._follow = follow
        self._independent = independent
        self.crossings = crossings
        # The input at which modes that pass crossings get their numbers. NaN unless
        # `_pass_crossings` sets this input.
        self.numbering_input = np.nan
        self.mechanism = driven_at(mechanism, input_pair)
        self.input_grid = make_input_grid(
            self.mechanism, samples, wants_grid=grid, path=path
        )
        # The mobility is first counted on the graph of links and pairs. Constraints that
        # repeat each other make this count too small. If the count fails, the rank of the
        # velocity equations at the configurations decides. `by_rank` tells `_search_modes`
        # which of the two to use.
        self.by_rank = False
        try:
            self.assembly_modes = self._search_modes(search)
        except CountError as count_error:
            self.by_rank = True
            try:
                self.assembly_modes = self._search_modes(search)
            except SpherekitError:
                # The error of the count is raised, because it names links and pairs.
                raise count_error from None
        # A group is a smallest part of the mechanism that can be placed by itself, such as
        # two links. Its sign tells the two ways to do so apart, and the signs of all groups
        # name a mode. The modes found so far have constant signs. `_pass_crossings` joins
        # them to modes that pass crossings, in which signs change.
        self._modes_with_constant_signs = self.assembly_modes
        if crossings == "pass" and follow:
            self._pass_crossings()
        named_modes = assign_mode_names(self.solver, self.assembly_modes, self.input_grid.q)
        self.assembly_modes = named_modes.assembly_modes
        self.unused_mode_names = named_modes.unused_names
        self.other_modes: tuple[AssemblyMode, ...] = ()
        if assembly_mode is not None:
            wanted_mode = self.assembly_modes[self.find_mode_index(assembly_mode)]
            self.other_modes = tuple(
                mode for mode in self.assembly_modes if mode is not wanted_mode
            )
            self.assembly_modes = (wanted_mode,)

    def find_mode_index(self, assembly_mode: int | str) -> int:
        """Return the index in `assembly_modes` of a mode, by its number or name.

        An assembly mode is one way to assemble the mechanism; the file can name it.

        Raises
        ------
        SolveError
            If no mode has this number or name.
        """
        for index, mode in enumerate(self.assembly_modes):
            has_number = str(assembly_mode) == str(mode.number)
            # The name is empty if the file gives none.
            has_name = bool(mode.name) and str(assembly_mode) == mode.name
            if has_number or has_name:
                return index
        titles = listing(f"{mode.number} ({mode.title})" for mode in self.assembly_modes)
        # The message lists names in the file that no mode has, since these may explain the
        # error.
        raise SolveError(
            f"{self.mechanism.name}: there is no assembly mode {assembly_mode}; the "
            f"assembly modes found are {titles or 'none'}"
            f"{''.join(f'; {sentence}' for sentence in self.unused_mode_names)}"
        )

    def _search_modes(self, search: bool) -> tuple[AssemblyMode, ...]:
        """Plan how the links are placed, then search the assembly modes and return them.

        An assembly mode is one way to assemble the mechanism. The plan lists groups of
        links in the order in which they are placed. The plan requires as many inputs as
        degrees of freedom. The degrees of freedom are counted from the numbers of links and
        pairs, or with `by_rank` follow from the rank of the velocity equations. If
        `_follow` is false, no motion is needed, and only the plan is computed.

        Parameters
        ----------
        search
            Whether modes other than that of the reference pose are searched.

        Raises
        ------
        PlanError
            If the mobility is not the number of inputs.
        """
        self.assembly = plan_assembly(self.mechanism, self.by_rank)
        self.solver = PositionSolver(self.mechanism, self.assembly)
        if not self._follow:
            self.methods: list[SolutionMethod | None] = [None] * len(self.assembly.groups)
            self.claim = Completeness(Guarantee.SAMPLED, "no motion was traced")
            self._probe_count = 0
            return ()
        # `independent`: the samples are unrelated to each other, and do not form a motion.
        mode_search = ModeSearch(
            self.solver, self.input_grid, search=search, independent=self._independent
        )
        # `claim` says how complete the modes are, `methods` how each group was solved, and
        # `probes` at how many inputs modes were searched. `crossings`
        # are the configurations at which curves of configurations cross.
        self.methods = mode_search.methods
        self.claim = mode_search.claim
        self._probe_count = mode_search.probes
        self._crossings = mode_search.crossings
        # At a crossing the loop equations are singular, so the solver would find it with
        # only half the digits. The exact configurations replace the results of the solver.
        self.solver.exact_configurations += [
            crossing.values for crossing in mode_search.crossings
        ]
        return tuple(mode_search.assembly_modes)

    def _pass_crossings(self) -> None:
        """Replace the assembly modes by those that follow smooth curves through crossings.

        The configurations of a mode form a curve over the input. At some inputs, called
        meetings, curves cross. Modes can continue there in two ways:

        - The modes known so far (`_modes_with_constant_signs`) keep the signs of their
          dyads (groups of two links). These modes change to the other smooth curve.
        - The new modes stay on their smooth curve, and their signs change.

        The new modes need numbers. A new mode gets the number of the known mode that is on
        its curve at one input, the `numbering_input`.

        Raises
        ------
        SolveError
            If there are several inputs, or if it is not known how curves continue at a
            crossing.
        """
        name = self.mechanism.name
        if len(self.inputs) != 1:
            raise SolveError(
                f'{name}: crossings: found "pass", which is possible with one input only, '
                f"but the mechanism has {counted(len(self.inputs), 'input')} "
                f"({numbered('pair', self.inputs)}); lock all but one, or leave crossings "
                'at "end"'
            )
        # At a resolved meeting it is known which modes continue each other. At an end of
        # the range it need not be known.
        low, high = self.input_grid.range
        for meeting in self.mode_meetings:
            end_distance = min(meeting.input - low, high - meeting.input)
            if not meeting.resolved and end_distance > MIN_CROSSING_DISTANCE_RAD:
                sentence = meeting.describe(self.inputs[0], passed=True)
                raise SolveError(
                    f"{name}: {sentence}; narrow the range "
                    'to one side of that input, or leave crossings at "end"'
                )
        # The numbering input is the input of the reference pose (anchor), if the anchor is
        # in the range and not at a meeting. At a meeting modes coincide, so their numbers
        # would be ambiguous. The default is an input just above the low end of the range,
        # since there can be a meeting at the low end.
        self.numbering_input = low + MIN_CROSSING_DISTANCE_RAD
        anchor = float(self.solver.anchor_inputs[0])
        distances = [abs(meeting.input - anchor) for meeting in self.mode_meetings]
        least_distance = min(distances, default=np.inf)
        if (
            self.solver.reference is not None
            and low <= anchor <= high
            and least_distance > MIN_CROSSING_DISTANCE_RAD
        ):
            self.numbering_input = anchor
        self.assembly_modes = follow_smooth_curves(
            self._modes_with_constant_signs, self.mode_meetings, self.numbering_input
        )

    @cached_property
    def mode_meetings(self) -> tuple[ModeMeeting, ...]:
        """Inputs in the range at which curves of assembly modes cross, in rising order.

        An assembly mode is one way to assemble the links. The crossings are known for
        mechanisms with one input in two cases. Either all groups of links are dyads (two
        links joined by a pair), triads (six pairs in two loops) or trains of wheels, or
        there is one group of seven bodies. In other cases the result is empty.
        """
        if not self._follow or len(self.inputs) != 1:
            return ()
        return find_mode_meetings(
            self.solver, self._modes_with_constant_signs, self._crossings
        )

    @property
    def meeting_sentences(self) -> Names:
        """A sentence for each input at which modes meet."""
        name = self.inputs[0] if len(self.inputs) == 1 else ""
        passes = self.crossings == "pass"
        return tuple(meeting.describe(name, passes) for meeting in self.mode_meetings)

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
        """How the assembly modes were searched, and whether some can be missing."""
        if not self._follow:
            return "no motion was traced"
        if not self._probe_count:
            return f"{self.claim}; no others were searched"
        method_texts = [
            f"{group.kind}: {method.description}"
            for group, method in zip(self.assembly.groups, self.methods, strict=True)
            if method is not None
        ]
        return "; ".join(dict.fromkeys([str(self.claim), *method_texts]))

    @property
    def probe_count(self) -> int:
        """Number of samples at which assembly modes were searched."""
        return self._probe_count

    @cached_property
    def configurations(self) -> Configurations:
        """All configuration curves that have a point in the range of the only input.

        Raises
        ------
        PlanError
            If there are several inputs.
        """
        return configuration_curves(self.solver, self.assembly_modes, *self.range)

    @cached_property
    def angle_unwrapping(self) -> AngleUnwrapping:
        """The object that counts the whole revolutions of passive pairs."""
        return AngleUnwrapping(self.solver)

    @checked(SolveError)
    def at(self, q: Floats) -> Motion:
        """Return all assembly modes at inputs q (k,) or (k, inputs) rad in any order.

        An assembly mode is one way to assemble the mechanism. The result has a row for each
        mode and each input. Modes with groups of links without a closed form are known in
        the range of the samples. Far outside this range, also a whole turn away, their rows
        have no configuration (NaN), and a status that says why.

        Raises
        ------
        SolveError
            If q does not fit the number of inputs, or is not finite. Also if there are
            several inputs, and groups of links without a closed form. Their configurations
            are known at the samples of the analysis only.
        """
        # Groups without a closed form are solved by Newton's method, from a start that the
        # `guide` of the mode predicts. A `ModeOverGrid`, the guide for several inputs, has
        # only the configurations at the samples.
        if any(isinstance(mode.guide, ModeOverGrid) for mode in self.assembly_modes):
            raise SolveError(
                f"{self.mechanism.name}: for a mechanism with several inputs and "
                "irreducible groups, the motion is known only at the samples of the "
                "position analysis; run a new one with these inputs as its path"
            )
        return self._evaluate(make_path(q, len(self.inputs)).q, rows=None)

    def given(self, values: Floats) -> Motion:
        """Return closed configurations (n, variables), rad, as a motion without modes."""
        return make_motion(self.solver, values)

    def _evaluate(self, q: Floats, rows: Indices | None) -> Motion:
        """Return the configurations of all assembly modes at some inputs, as a motion.

        An assembly mode is one way to assemble the mechanism. A motion is a table with a
        row for each mode and each input.

        Parameters
        ----------
        q
            (k, inputs) inputs (rad).
        rows
            (k,) indices of the samples with these inputs. None if the inputs are not
            samples.

        Returns
        -------
        The motion: all inputs in the first mode, then all in the next mode, and so on.
        """
        if not self.assembly_modes:
            # Without modes, the motion has no rows. `samples` is the number of inputs.
            no_values = np.empty((0, len(self.mechanism.variable_owners)))
            return replace(make_motion(self.solver, no_values), samples=len(q))
        configurations = ModeConfigurations.concatenate(
            [self.solver.evaluate(mode, q, rows) for mode in self.assembly_modes]
        )
        if rows is None:
            # Inputs that are not samples get the numbers 0, 1, ... in their order.
            sample_numbers = np.arange(len(q))
        else:
            sample_numbers = rows
        motion = arrange_rows(
            self.solver,
            self.assembly_modes,
            q=q,
            sample=sample_numbers,
            configurations=configurations,
            is_path=self.input_grid.is_path,
        )
        # Add a text that says how the modes were searched.
        return replace(motion, search=self.search)

    def sparse(self, most: int) -> Motion:
        """Return the motion at no more than `most` samples, spread evenly."""
        return self.samples(spread_rows(len(self.input_grid), most))

    def samples(self, rows: Indices) -> Motion:
        """Return the motion at some of the samples, given by their indices."""
        return self._evaluate(self.input_grid.q[rows], rows)

    @property
    def block(self) -> int:
        """Number of samples in a block: all modes together have about `BLOCK_ROWS` rows."""
        return max(1, BLOCK_ROWS // max(1, len(self.assembly_modes)))

    def motion(self) -> Motion:
        """Return the motion at all samples."""
        return next(self.blocks(len(self.input_grid)))

    def blocks(self, size: int | None = None, first: int = 0) -> Iterator[Motion]:
        """Yield the configurations in blocks of successive samples, to save memory.

        Parameters
        ----------
        size
            Number of samples in a block, by default the attribute `block`.
        first
            Sample with which the first block begins.
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
    angle_unit: AngleUnit = "rad",
) -> Motion:
    """Return the motion of a mechanism over the ranges of its inputs.

    The motion contains the configurations of all assembly modes (ways to assemble the
    mechanism) at all samples. Its angles are in rad. Errors are those of
    `PositionAnalysis`.

    Parameters
    ----------
    mechanism
        The mechanism, its name, or its file.
    samples
        Number of samples. They are on a straight path: all inputs go through their ranges
        together. If `grid` is true, each input has this number of values. A sequence has
        one number for each input, and always gives a grid.
    input_pair
        Names of the driven pairs, by default those that the mechanism declares.
    assembly_mode
        Number of the only mode to be computed; all by default.
    search
        Whether to search for modes other than the mode of a given reference pose.
    grid
        Whether to sample all combinations of the values of the inputs.
    path
        (n, inputs) values of the inputs in `angle_unit`, instead of their ranges.
    crossings
        What an assembly mode does where curves of configurations cross. A dyad (group of
        two links) can close in two ways. With "end", all dyads keep their way, so the mode
        leaves its smooth curve at the crossing. With "pass", the mode stays on its smooth
        curve, and dyads change their way.
    angle_unit
        Unit of `path`, ``"rad"`` or ``"deg"``.
    """
    position_analysis = PositionAnalysis(
        mechanism_of(mechanism),
        input_pair=input_pair,
        assembly_mode=assembly_mode,
        search=search,
        samples=samples,
        grid=grid,
        path=None if path is None else angles_in_radians(path, angle_unit),
        crossings=crossings,
    )
    return position_analysis.motion()
