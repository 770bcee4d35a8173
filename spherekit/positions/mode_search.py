"""Finds the assembly modes of a mechanism over the samples or the range of its inputs.

There are three cases, which need different work:

- All groups have a closed form. The signs of the dyads are the modes, and only those that
  close somewhere are kept.
- The mechanism has one input, and irreducible groups
  (`spherekit.positions.modes_over_range`).
- It has several inputs, and irreducible groups (`spherekit.positions.modes_over_samples`).
"""

from collections.abc import Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.completeness import Completeness, Guarantee
from spherekit.errors import SolveError
from spherekit.geometry.vectors import nans
from spherekit.mechanism.elements import PoseGeometry
from spherekit.positions.assembly_enumeration import (
    MAX_ASSEMBLY_MODES,
    enumerate_modes,
    signs_at,
)
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.curve_crossing import Crossing
from spherekit.positions.group_assembly import place_dyad
from spherekit.positions.group_solutions import CLOSED_FORM, SolutionMethod
from spherekit.positions.input_grid import InputGrid, spread_rows
from spherekit.positions.input_turning_points import (
    RUN_COST_S,
    RUN_TIME_S,
    find_input_turning_points,
)
from spherekit.positions.mode_predictor import ModeOverGrid
from spherekit.positions.modes_over_range import ModesOverRange, check_mobility
from spherekit.positions.modes_over_samples import REFERENCE_ONLY, SampledModes
from spherekit.positions.position_solver import PositionSolver
from spherekit.status import Status

PROBED_RANGE_INPUTS = 721
"""Number of values of a single input at which the modes of dyads are searched.

These values are used only where the inputs at which modes meet are unknown. Larger: shorter
modes are found, in more time.
"""
MAX_PROBED_SAMPLES = 2**16
"""Largest number of samples of several inputs at which the modes of dyads are searched.

Larger: more modes are found.
"""
PROBED_TOGETHER = 2**13
"""Number of inputs that are examined together. Larger: more memory."""
RANKED_CONFIGURATIONS = 5
"""Number of configurations at which the mobility by rank is computed.

Some of them may be singular, and have a larger mobility than the mechanism.
"""
EXPLAINED_SAMPLES = 3
"""Number of samples at which groups are tried again if a mechanism does not close.

The tries show which group is at fault. Larger: more time until the error. Smaller: a group
is named although it closes at other samples.
"""


class ModeSearch:
    """The assembly modes that have a configuration at some of the sampled inputs.

    For a single input, modes count in the whole range between the smallest and the largest
    sample. The mode of a given reference pose comes first. If all groups have a closed
    form, it is included even if it has no configuration there. The constructor runs the
    whole search.

    Parameters
    ----------
    solver
        The mechanism.
    input_grid
        The samples of its inputs.
    search
        Whether to search for modes other than that of the reference pose. They are also
        searched if this pose gives no mode.
    independent
        Whether the samples of a path are unrelated to each other, as in
        `spherekit.positions.position_analysis.PositionAnalysis`.

    Attributes
    ----------
    assembly_modes
        The modes.
    probes
        Number of inputs at which modes were searched, plus the number of random starts. 0
        if a reference pose was enough.
    methods
        For each group the least complete method by which its modes were found at any input.
        None if they were searched at no input.
    claim
        How complete the modes are.
    crossings
        Configurations at which curves cross, if the inputs at which modes meet are known.

    Raises
    ------
    SolveError
        If no mode was found, unless the samples are independent.
    PlanError
        If constraints are redundant, and the mobility by rank is not the number of inputs.
    """

    def __init__(
        self,
        solver: PositionSolver,
        input_grid: InputGrid,
        search: bool = True,
        independent: bool = False,
    ) -> None:
        """Find the assembly modes of a mechanism at the samples of its inputs.

        An assembly mode is one way to assemble the mechanism. The links are placed in
        groups:

        - A dyad (two links) closes in two ways, told apart by its sign (1 or -1).
        - A train of wheels closes in one way, with the sign 0.
        - Other groups have no closed form.

        If there are only dyads and trains of wheels, each combination of their signs with
        which the mechanism closes is a mode. If there are other groups, modes are followed
        by Newton's method. With one input they are followed along its range. With several
        inputs they are followed from sample to sample.

        Parameters
        ----------
        solver, input_grid
            The mechanism, and the sampled values of its inputs.
        search
            Whether to search for modes other than that of the reference pose.
        independent
            Whether the samples are unrelated to each other, and do not form a motion.
        """
        self.solver = solver
        self.input_grid = input_grid
        # First values of the results, which the class explains. Without a search, only the
        # mode of the reference pose is known.
        self.claim = REFERENCE_ONLY
        self.groups = solver.assembly.groups
        self.assembly_modes: list[AssemblyMode] = []
        self.methods: list[SolutionMethod | None] = [None] * len(self.groups)
        self.probes = 0
        self.crossings: tuple[Crossing, ...] = ()
        if solver.has_closed_form:
            self._find_closed_form_modes(search)
        elif len(solver.driven) > 1:
            self._find_modes_over_samples(search, independent)
        else:
            self._find_modes_over_range(search)
        # If no mode was found and the samples form a motion, an error is raised.
        # Independent samples get a mode without configurations, which gives each of them a
        # row in the results.
        if not self.assembly_modes:
            if not independent:
                raise SolveError(_explain_failure(solver, input_grid))
            self.assembly_modes = [self._make_empty_mode()]

    def _make_empty_mode(self) -> AssemblyMode:
        """Return a mode that has no configuration at any sample."""
        signs = tuple(int(group.is_dyad) for group in self.groups)
        count = len(self.input_grid)
        values = nans((count, len(self.solver.mechanism.variable_owners)))
        status = np.full(count, Status.OUT_OF_REACH, dtype=np.int8)
        return AssemblyMode(0, signs, ModeOverGrid(values, status))

    def _find_modes_over_samples(self, search: bool, independent: bool) -> None:
        """Find the assembly modes of a mechanism with several inputs at the samples.

        An assembly mode is one way to assemble the mechanism. The modes are stored in
        `assembly_modes`. `claim` states how complete they are, `probes` from how many
        samples and random starts they were searched, and `methods` how.

        Parameters
        ----------
        search
            Whether to search for modes other than that of the reference pose.
        independent
            Whether the samples are unrelated to each other, and not a motion. In a motion,
            modes on separate parts of the path of samples are different modes. For
            independent samples they are one mode if all groups of links have equal signs. A
            dyad (two links), for example, closes in two ways, told apart by its sign.

        Raises
        ------
        PlanError
            If the mechanism has another number of degrees of freedom than inputs. This is
            tested only with redundant constraints, by the rank of the velocity equations.
            Without them, the numbers of links and pairs give the degrees of freedom.
        """
        # The constructor runs the search.
        sampled_modes = SampledModes(
            self.solver, self.input_grid, search=search, shares_numbers=independent
        )
        self.assembly_modes = sampled_modes.assembly_modes
        self.methods = sampled_modes.methods
        self.claim = sampled_modes.claim
        # Number of samples at which modes were searched, plus that of random starts.
        self.probes = sampled_modes.probes
        # `mobilities` are degrees of freedom at the starts of the search.
        self._check_mobilities(sampled_modes.mobilities)

    def _check_mobilities(self, mobilities: Sequence[int]) -> None:
        """Raise an error if the mobility of the mechanism is not its number of inputs.

        The mobility is the number of degrees of freedom. A start is a configuration from
        which the search tries to follow a mode to the samples. The mobility is tested in
        two cases:

        - No mode was found.
        - The mobility at the first start is lower than the number of inputs.

        A singular configuration can have more degrees of freedom than the mechanism. A
        higher mobility at a single start is therefore no error, and the least mobility of
        all starts counts.

        Parameters
        ----------
        mobilities
            Degrees of freedom at each start, from the rank of the velocity equations. The
            first start is the reference pose, if there is one. The sequence is empty if no
            constraints are redundant. The numbers of links and pairs then give the
            mobility, so it is not tested here.

        Raises
        ------
        PlanError
            If the least mobility is not the number of inputs.
        """
        if not mobilities:
            return
        input_count = len(self.solver.driven)
        first_is_immobile = mobilities[0] < input_count
        if not self.assembly_modes or first_is_immobile:
            check_mobility(self.solver, min(mobilities))

    def _find_modes_over_range(self, search: bool) -> None:
        """Find the modes of a mechanism with one input over its range."""
        modes = ModesOverRange(self.solver, self.input_grid, search)
        self.assembly_modes = modes.assembly_modes
        self.methods = modes.methods
        self.claim = modes.claim
        self.probes = modes.probes
        self.crossings = modes.crossings

    def _find_closed_form_modes(self, search: bool) -> None:
        """Find the assembly modes of a mechanism of dyads and trains of wheels.

        An assembly mode is one way to assemble the mechanism. The links are placed in
        groups. A dyad (group of two links) closes in two ways. Its sign, 1 or -1, says in
        which. A train of wheels has one way only, and the sign 0. A mode is a combination
        of the signs of all groups with which the mechanism closes at some input, or in the
        reference pose.

        The results are stored in attributes:

        - `assembly_modes`: the modes.
        - `claim`: how complete they are.
        - `probes`: the number of inputs at which they were searched.
        - `methods`: for each group the method by which it was solved.

        Parameters
        ----------
        search
            Whether to search for modes other than that of the reference pose (the
            configuration that the file describes). Without this pose they are always
            searched.

        Raises
        ------
        PlanError
            If constraints are redundant, and the mobility is not the number of inputs.
        """
        solver = self.solver
        # The signs of all groups, for each mode that is found; a mode can occur twice.
        all_signs = []
        # The mode of the reference pose comes first and has the number 0.
        if solver.reference is not None:
            all_signs.append(signs_at(solver, solver.reference))
        if search or not all_signs:
            q, self.claim = self._select_probed_inputs()
            self.probes = len(q)
            self.methods = [CLOSED_FORM] * len(self.groups)
            all_signs += self._find_closing_signs(q)
        # Drop repetitions, but keep the order.
        different_signs = list(dict.fromkeys(all_signs))
        if len(different_signs) > MAX_ASSEMBLY_MODES:
            # The list of modes is not complete.
            reason = f"the first {MAX_ASSEMBLY_MODES} modes are kept, and there are more"
            self.claim = Completeness(Guarantee.SAMPLED, reason)
        self.assembly_modes = [
            AssemblyMode(number, signs)
            for number, signs in enumerate(different_signs[:MAX_ASSEMBLY_MODES])
        ]

    def _find_closing_signs(self, q: Floats) -> list[tuple[int, ...]]:
        """Return the combinations of signs with which the mechanism closes at some input.

        A dyad (group of two links) closes in two ways, told apart by its sign 1 or -1. Any
        other group has the sign 0. One combination of signs of all groups is one assembly
        mode.

        Parameters
        ----------
        q
            (k, inputs) values of the inputs (rad), which are examined in portions.

        Returns
        -------
        The signs of all groups in each mode. A mode that occurs in several portions is
        listed for each.
        """
        all_signs = []
        # If constraints are redundant, counting links and pairs does not give the mobility
        # (degrees of freedom). It is then computed at configurations of each mode. An error
        # is raised if it is not the number of inputs.
        has_redundant_group = any(group.redundant for group in self.groups)
        for first in range(0, len(q), PROBED_TOGETHER):
            inputs = q[first : first + PROBED_TOGETHER]
            # One mode more than the limit shows the caller that there are too many.
            placements, _ = enumerate_modes(self.solver, inputs, MAX_ASSEMBLY_MODES + 1)
            for signs, state in placements:
                all_signs.append(signs)
                if has_redundant_group:
                    self._check_mobility_of_mode(state.values[~state.is_open])
        return all_signs

    def _check_mobility_of_mode(self, closed_values: Floats) -> None:
        """Raise an error unless the mobility of a mode is the number of inputs.

        The mobility follows from the rank of the velocity equations. The mobility is
        computed at some of the closed configurations (n, variables) of the mode. The least
        value counts, because the mobility is larger at singular configurations.
        """
        rows = spread_rows(len(closed_values), RANKED_CONFIGURATIONS)
        mobilities = map(self.solver.compute_mobility, closed_values[rows])
        check_mobility(self.solver, min(mobilities))

    def _select_probed_inputs(self) -> tuple[Floats, Completeness]:
        """Return the inputs at which the assembly modes of dyads are searched.

        An assembly mode is one way to assemble the mechanism. All groups of links are dyads
        (two links) or trains of wheels here. With one input, `self.crossings` is set as
        well: configurations at which curves of modes cross.

        Returns
        -------
        q
            (k, inputs) values of the inputs (rad).
        claim
            How complete the modes found at these inputs are, with the reason in words.
        """
        grid = self.input_grid
        first_sample = grid.q[:1]
        # Without groups, the inputs place all links, so there is one mode at any input.
        if not self.groups:
            return first_sample, Completeness(Guarantee.COMPLETE, "no loop has to close")
        # Gear ratios place a train of wheels, so it has one mode at any input. Reports read
        # "complete: wheels in mesh have one" (mode).
        train_count = len(self.solver.wheel_trains)
        if train_count == len(self.groups):
            return first_sample, Completeness(Guarantee.COMPLETE, "wheels in mesh have one")
        input_count = grid.q.shape[1]
        if input_count > 1:
            return self._select_samples()
        # Modes appear or vanish only at turning points of the input, so one input between
        # each two of them is enough. The search for turning points is limited: `max_cost_s`
        # for one evaluation, `max_time_s` in all.
        low, high = grid.range
        turning_points = find_input_turning_points(
            self.solver, low, high, max_cost_s=RUN_COST_S, max_time_s=RUN_TIME_S
        )
        self.crossings = turning_points.crossings
        # Where the turning points are unknown, inputs at equal distances are examined.
        # `claim` states whether a turning point can have been missed.
        step = np.ptp(grid.q) / (PROBED_RANGE_INPUTS - 1)
        return turning_points.probes(step)[:, None], turning_points.claim(step)

    def _select_samples(self) -> tuple[Floats, Completeness]:
        """Return the samples of the inputs at which assembly modes will be searched.

        These are all samples, or `MAX_PROBED_SAMPLES` of them, spread evenly.

        Returns
        -------
        q
            (k, inputs) values of the inputs (rad).
        claim
            How complete the modes will be after the search, with the reason in words.
        """
        grid = self.input_grid
        q = grid.q[spread_rows(len(grid), MAX_PROBED_SAMPLES)]
        if len(q) == len(grid):
            reason = f"modes at all {len(grid)} samples"
            sentence = f"All assembly modes were found at the {len(grid)} samples."
        else:
            reason = f"modes at {len(q)} of the {len(grid)} samples"
            sentence = f"All assembly modes were found at {len(q)} of the samples."
        return q, Completeness(Guarantee.SAMPLED, reason, sentence=sentence)


def _explain_failure(solver: PositionSolver, input_grid: InputGrid) -> str:
    """Return the message for a mechanism that cannot be assembled at any sample.

    The message names the group of links that probably cannot close. The groups are placed
    one after another. The first groups are often dyads (two links joined by a pair), which
    can be placed in two ways. If one of them closes at no sample after any placement of the
    earlier dyads, the message names this dyad. If all these dyads close, all groups are
    tried at a few samples, and the message names the last group that is reached.
    """
    name = solver.mechanism.name
    inputs = solver.mechanism.names_of(solver.assembly.inputs)
    lows, highs = np.degrees([np.min(input_grid.q, axis=0), np.max(input_grid.q, axis=0)])
    degrees = ", ".join(
        f"{pair} in [{low:.6g}, {high:.6g}] deg"
        for pair, low, high in zip(inputs, lows, highs, strict=True)
    )
    # The cure is what the user can change. A file with a reference pose has no arcs.
    has_pose = isinstance(solver.mechanism.geometry, PoseGeometry)
    # Place the first groups as long as they are dyads, at up to `PROBED_RANGE_INPUTS`
    # samples. A dyad can close in two ways. All ways in which the dyads close at some
    # sample are kept, because later dyads may close after one of them only.
    samples = spread_rows(len(input_grid), PROBED_RANGE_INPUTS)
    states = [solver.start(input_grid.q[samples])]
    with np.errstate(invalid="ignore", divide="ignore"):
        for group in solver.assembly.groups:
            pairs = ", ".join(solver.mechanism.names_of(group.pairs))
            # A dyad before which there are too many ways is treated as other groups below.
            if not group.is_dyad or len(states) > MAX_ASSEMBLY_MODES:
                break
            closed_states = []
            for state in states:
                for sign in (1, -1):
                    next_state = state.copy()
                    place_dyad(next_state, group, sign)
                    # `is_open` marks the samples at which the dyad does not close.
                    if not np.all(next_state.is_open):
                        closed_states.append(next_state)
            states = closed_states
            if not states:
                cure = "the axes of its pose" if has_pose else "the arcs of its links"
                return (
                    f"{name}: the arcs cannot close: the {group.kind} of pairs {pairs} "
                    f"cannot be assembled anywhere in the range {degrees}; change {cure}, "
                    "or the range"
                )
    # `group` is the group at which the loop ended: the first one that is not a dyad, or the
    # last group. Groups after it are tried where it closes.
    position = solver.assembly.groups.index(group)
    for sample in spread_rows(len(input_grid), EXPLAINED_SAMPLES):
        q = input_grid.q[sample]
        placements, methods = enumerate_modes(solver, q[None], max_modes=1)
        if placements:
            # All groups close, so the fault is in no single group.
            position = solver.assembly.groups.index(group)
            break
        tried = [k for k, method in enumerate(methods) if method is not None]
        position = max(position, *tried)
    group = solver.assembly.groups[position]
    pairs = ", ".join(solver.mechanism.names_of(group.pairs))
    failure = "could not be assembled"
    cure = "the axes of its pose" if has_pose else "the arcs of its links"
    if solver.mechanism.has_contacts:
        failure += " from any start, or only with profiles that enter each other"
        cure += ", their profiles"
    cure += " or the range"
    if not has_pose:
        cure += ", or give a reference pose"
    return (
        f"{name}: no configuration was found for inputs {degrees}: the {group.kind} with "
        f"the pairs {pairs} {failure}; change {cure}"
    )
