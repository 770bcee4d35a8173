"""Solves the positions of a mechanism in one assembly mode at any inputs.

The groups of the mechanism are placed one after another, in the order of its assembly
plan. Dyads are placed in closed form, trains of wheels by their gear ratios, and other
groups by Newton's method from a configuration that the mode predicts. Each sample ends
with a status that says whether it has a configuration.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, SmallIntegers
from spherekit.conventions import TURN
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.mechanism.joint_construction import make_joints_in_pose
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap
from spherekit.numerics.array_rows import ArrayRows
from spherekit.planning.assembly_plan import Assembly, Group
from spherekit.planning.gear_train import GearTrain, find_gear_train
from spherekit.positions.assembly_mode import AssemblyMode, has_configuration
from spherekit.positions.fold_bounds import place_at_folds
from spherekit.positions.gear_phases import GearPhases, make_gear_phases
from spherekit.positions.group_assembly import (
    AssemblyState,
    find_train_paths,
    group_variables,
    place_dyad,
    place_group,
    place_train_bodies,
)
from spherekit.positions.group_conditioning import group_reciprocal_condition
from spherekit.positions.input_paths import determinant_sign
from spherekit.positions.input_revolutions import whole_laps
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure
from spherekit.positions.loop_tree import RANK_TOLERANCE, rank_mobility
from spherekit.positions.mode_predictor import ModeCurve
from spherekit.positions.pair_states import has_penetration
from spherekit.positions.quad_positions import QuadAssembly
from spherekit.status import Status
from spherekit.tolerances import (
    CLOSURE_TOLERANCE,
    EPS,
    EXACT_DISTANCE_RAD,
    MAX_SINGULAR_ANGLE_ERROR_RAD,
    PREDICTION_RATIO,
    PREDICTION_SLACK_RAD,
    REACH_SLACK,
    SINGULAR_DYAD_SINE,
    SINGULAR_GROUP_CONDITION,
)

LAST_NODE_DISTANCE_RAD = 1e-9
"""Largest distance of the last node of a mode's curve from the dead centre at its end.

An input that exceeds the last node by less is beside the dead centre, not out of reach.
"""
SAME_INPUT_TOLERANCE = 1e-15
"""Deviation (rad, relative above 1 rad) of an input that is caused by rounding only."""
EXACT_ERROR_RAD = 16.0 * EPS
"""Error bound of the variables of an exact configuration."""


@dataclass(frozen=True)
class ModeConfigurations(ArrayRows):
    """The configurations of an assembly mode (one way to assemble) at n samples of inputs.

    Attributes
    ----------
    values
        (n, variables) pair variables (rad).
    rotations
        (n, links, 3, 3) rotations from link axes to ground axes.
    status
        (n,) `Status` of each sample. At OK there is a configuration, and at AT_SINGULARITY
        there may be one. Without a configuration, values, rotations and residual are NaN.
    residual
        (n,) largest component of the closure errors of the loops (rad).
    singular_error
        (n,) bounds (rad) of the errors of `values` at samples where rounding errors of
        angles can be large, as near dead centres. A bound is infinite if none could be
        computed. It is NaN at all other samples.
    """

    values: Floats
    rotations: Floats
    status: SmallIntegers
    residual: Floats
    singular_error: Floats


class PositionSolver:
    """Computes the configurations of a mechanism for given values of its inputs.

    The links are placed in groups: sets of bodies that are placed together by closing their
    loops.

    Attributes
    ----------
    mechanism, assembly
        The mechanism, and its groups in the order in which they are placed.
    joints
        The joint of each pair.
    reference
        (variables,) the reference pose (rad), None if the file gives none.
    closure
        Loop closure of the whole mechanism.
    driven
        Indices of the variables that are inputs.
    anchor_inputs
        (inputs,) inputs (rad) of the reference pose, or zero. Full revolutions of passive
        angles are counted from these inputs.
    exact_configurations
        Configurations (variables,) that are known up to rounding: the reference pose, and
        those at which curves cross. If they are singular, a closed form would give only
        half their digits.
    """

    def __init__(self, mechanism: Mechanism, assembly: Assembly) -> None:
        """Prepare the computation of positions of a mechanism.

        Parameters
        ----------
        mechanism
            The links and the pairs (joints) that join them.
        assembly
            The driven pairs (inputs), and the groups of links in the order in which they
            are placed.
        """
        self.mechanism = mechanism
        self.assembly = assembly
        self.joints, self.reference = make_joints_in_pose(mechanism)
        self.closure = Closure.of_mechanism(mechanism, self.joints)
        # Indices of the variables that are inputs.
        driven: list[int] = []
        for pair in assembly.inputs:
            driven += mechanism.variables_of(pair)
        self.driven = tuple(driven)
        # The angles of a motion may exceed a revolution. Whole revolutions are counted from
        # the configuration at the anchor inputs. At the anchor inputs all passive angles
        # are in (-pi, pi].
        self.anchor_inputs = np.zeros(len(self.driven))
        # Configurations that are known up to rounding: the reference pose, and crossings of
        # curves, which callers add. Near singular configurations, computed results have
        # only half the digits. There, these known configurations replace them.
        self.exact_configurations: list[Floats] = []
        if self.reference is not None:
            self.anchor_inputs = self.reference[list(self.driven)]
            self.exact_configurations.append(self.reference)

    @property
    def input_variable(self) -> int:
        """The index of the only input's variable; `PlanError` if there are several."""
        (number,) = self.mechanism.variables_of(self.assembly.input)
        return number

    @property
    def angles(self) -> list[int]:
        """Indices of the variables that are angles of R pairs."""
        return list(self.mechanism.angles.values())

    @cached_property
    def _gear_train(self) -> GearTrain | None:
        """The angles that follow from the inputs by gear ratios."""
        return find_gear_train(self.mechanism, self.assembly.inputs, whole=False)

    @cached_property
    def gear_phases(self) -> GearPhases | None:
        """How far wheels have rolled at given inputs, None without rolling contacts."""
        return make_gear_phases(self.closure, self.anchor_inputs, self._gear_train)

    @property
    def periods(self) -> Floats:
        """(inputs,) growth (rad) of each input after which the configurations repeat.

        Without rolling contacts the growth is one revolution. With rolling contacts it may
        be several, because wheels must be back in their positions. The growth is infinite
        if configurations never repeat, and NaN if no gear ratios lead from the inputs to
        the wheels.
        """
        if self.gear_phases is None:
            return np.full(len(self.driven), TURN)
        return self.gear_phases.periods

    def reduce_inputs(self, q: Floats) -> Floats:
        """Return inputs (n, inputs) reduced by whole periods, nearest to zero."""
        periods = self.periods
        is_periodic = np.isfinite(periods)
        revolutions = np.where(is_periodic, periods, TURN) / TURN
        return np.where(is_periodic, revolutions * wrap(q / revolutions), q)

    def shift_inputs(self, values: Floats, q: Floats) -> Floats:
        """Return the same configurations at inputs that are whole periods away.

        A period of an input is the change after which all orientations repeat. A period is
        one revolution, or several if wheels roll on each other.

        Parameters
        ----------
        values
            (n, variables) configurations (rad).
        q
            (n, inputs) new values of the inputs (rad).

        Returns
        -------
        (n, variables) configurations with the new inputs. The lengths by which wheels have
        rolled are larger by the amount that belongs to the periods.
        """
        shifted = values.copy()
        shifted[:, list(self.driven)] = q
        if self.gear_phases is not None:
            input_growth = q - values[:, list(self.driven)]
            # The variables that are rolled lengths, and their derivatives (lengths, inputs)
            # with respect to the inputs.
            rolled_variables = list(self.gear_phases.variables)
            ratios = self.gear_phases.ratios
            shifted[:, rolled_variables] += input_growth @ ratios.T
        return shifted

    def shift_near_samples(self, values: Floats, sampled_inputs: Floats) -> Floats:
        """Return a configuration whose inputs are moved near to samples by whole periods.

        After a period of an input all orientations repeat. Assembly modes are known near
        the samples only. The caller therefore needs inputs near the samples.

        An input inside the range of the samples stays. Any other input is moved as near to
        the middle of the range as possible. The input remains outside if no multiple of the
        period leads into the range.

        Parameters
        ----------
        values
            (variables,) the configuration (rad).
        sampled_inputs
            (n, inputs) the samples of the inputs (rad).

        Returns
        -------
        (1, variables) the configuration at the moved inputs.
        """
        inputs = values[list(self.driven)]
        lowest = np.min(sampled_inputs, axis=0)
        highest = np.max(sampled_inputs, axis=0)
        distance_to_middle = 0.5 * (lowest + highest) - inputs
        is_outside = np.abs(distance_to_middle) > 0.5 * (highest - lowest)
        whole_periods = whole_laps(distance_to_middle, self.periods)
        shift = np.where(is_outside, whole_periods, 0.0)
        return self.shift_inputs(values[None], inputs + shift)

    @cached_property
    def wheel_trains(self) -> frozenset[int]:
        """Positions, in solving order, of the groups of bodies that are trains of wheels.

        A group is a set of bodies that are placed together. A train of wheels has only one
        assembly mode (way to assemble it) at given inputs, which gear ratios determine. So
        no search for modes is needed. A group is a train of wheels if two conditions are
        met:

        - Gear ratios give the angles of enough revolute pairs to place all bodies.
        - It has contacts, and all of them are rolling contacts of the gear train.
        """
        gear_train = self._gear_train
        # The mechanism has no gear ratios.
        if gear_train is None:
            return frozenset()
        positions = set()
        for position, group in enumerate(self.assembly.groups):
            # Contacts are the pairs without an axis.
            contacts = {pair for pair in group.pairs if not self.joints[pair].has_axis}
            # The first body is placed already. Each revolute pair with a known angle
            # (`followers`) places one more.
            placed_count = 1 + len(find_train_paths(group, gear_train.followers))
            are_all_placed = placed_count == len(group.bodies)
            if are_all_placed and contacts and contacts <= {*gear_train.contacts}:
                positions.add(position)
        return frozenset(positions)

    @property
    def has_closed_form(self) -> bool:
        """Whether every group is a dyad or a train of wheels."""
        return all(
            group.is_dyad or position in self.wheel_trains
            for position, group in enumerate(self.assembly.groups)
        )

    def gear_train_angles(self, q: Floats) -> dict[int, Floats]:
        """Return the angles (n,) rad that gear ratios fix, by pair, at q (n, inputs)."""
        gear_train = self._gear_train
        if gear_train is None:
            return {}
        angles = gear_train.offsets + q @ gear_train.ratios.T
        return dict(zip(gear_train.followers, angles.T, strict=True))

    def place_wheel_train(
        self, state: AssemblyState, position: int, q: Floats
    ) -> Linearisation:
        """Place the bodies of a train of wheels at given inputs, and unite them.

        A body is a set of links with known relative orientations. Once the bodies of the
        train are placed, they become one body. The angles of the wheels
        follow from the inputs by gear ratios. These angles give the orientations of all
        bodies. Newton's method starts there and closes the loops of the train, which
        contain the contacts of the wheels.

        Parameters
        ----------
        state
            The bodies that are placed so far. This function changes the state: it unites
            the bodies of the train, and stores the variables of its pairs.
        position
            Position of the train among the groups of links, in solving order.
        q
            (n, inputs) inputs (rad).

        Returns
        -------
        Linearisation
            The loop equations of the train at the result. Their residual shows whether the
            train is closed.
        """
        group = self.assembly.groups[position]
        # For each body of the train the rotation from its axes to those of the first body.
        # `ends` has the indices of the two links of each pair. `body_from_link` has the
        # rotation of each link relative to its body.
        rotations = place_train_bodies(
            group,
            body_from_link=state.body_from_link,
            ends=state.ends,
            joints=self.joints,
            angles=self.gear_train_angles(q),
        )
        # A rotation that is the same at all inputs is repeated for each of them.
        rotations = [np.broadcast_to(rotation, (len(q), 3, 3)) for rotation in rotations]
        # The variables of the pairs (angles, and lengths that wheels have rolled) at these
        # orientations.
        start = self._compute_train_variables(
            state, group, rotations=np.stack(rotations, axis=1), q=q
        )
        # Make Newton's steps from these variables, and unite the bodies.
        return place_group(state, group, start)

    def _compute_train_variables(
        self, state: AssemblyState, group: Group, rotations: Floats, q: Floats
    ) -> Floats:
        """Return the variables of the pairs of a train of wheels at given orientations.

        The caller has computed the orientations from the gear ratios. Newton's method
        starts from the returned variables.

        Parameters
        ----------
        state
            The bodies that are placed so far, each of rigidly joined links. This object is
            not changed.
        group
            The train: bodies that revolute pairs and rolling contacts join.
        rotations
            (n, bodies, 3, 3) rotations from the axes of each body of the train to those of
            its first body.
        q
            (n, inputs) values of the inputs (rad).

        Returns
        -------
        (n, variables of the group) angles of revolute pairs, and lengths by which wheels
        have rolled on each other (rad).
        """
        trial_state = state.copy()
        # Revolute pairs: orient the links of the train in a copy of the state, and measure
        # the angles between them.
        trial_state.merge(group, rotations)
        trial_state.read_values(group)
        # Rolling contacts: orientations do not show the number of revolutions that wheels
        # have rolled. The rolled lengths follow from the inputs.
        gear_phases = self.gear_phases
        assert gear_phases is not None  # since a train has rolling contacts
        rolled_lengths = gear_phases.rolled_lengths(q)
        trial_state.values[:, list(gear_phases.variables)] = rolled_lengths
        return trial_state.values[:, group_variables(state, group)]

    def start(self, q: Floats) -> AssemblyState:
        """Return the state in which only the inputs are placed, at q (n, inputs) rad."""
        return AssemblyState.start(self.mechanism, self.joints, self.assembly, q)

    def compute_mobility(
        self, values: Floats, rank_tolerance: float = RANK_TOLERANCE
    ) -> int:
        """Return the mobility of a closed configuration (variables,) by rank.

        The mobility is the number of variables less the rank of the velocity equations.
        Singular values below `rank_tolerance` times the largest one count as zero.
        """
        vectors = self.closure.linearise(values[None]).vectors
        return int(rank_mobility(self.closure.tree, vectors, rank_tolerance)[0])

    def evaluate(
        self, assembly_mode: AssemblyMode, q: Floats, rows: Indices | None = None
    ) -> ModeConfigurations:
        """Return the configurations of an assembly mode at inputs in any order.

        The groups of links are placed one after another. Dyads (two links joined by a pair)
        have a closed form with two solutions, of which the sign of the mode selects one.
        Trains of wheels are placed by gear ratios. Other groups are placed by Newton's
        method from verified configurations of the mode.

        Parameters
        ----------
        assembly_mode
            The mode: one of the ways in which the groups can be put together.
        q
            (n, inputs) inputs (rad).
        rows
            (n,) indices of the samples that have these inputs. The indices are needed only
            with several inputs, if groups are placed by Newton's method.

        Returns
        -------
        The configurations with a status each. Samples without a configuration are NaN.
        Passive angles are in (-pi, pi].
        """
        if assembly_mode.pieces:
            return self._evaluate_pieces(assembly_mode, q)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            state = self.start(q)
            status = np.zeros(len(q), dtype=np.int8)
            for position, sign in enumerate(assembly_mode.signs):
                if sign:
                    sine = place_dyad(state, self.assembly.groups[position], sign)
                    _set_status(status, state.is_open, Status.OUT_OF_REACH)
                    _set_status(status, sine < SINGULAR_DYAD_SINE, Status.AT_SINGULARITY)
                else:
                    self._place_without_sign(
                        assembly_mode, position, q, rows, state, status
                    )

            # Rows near dead centres are solved again, by a method that keeps more digits.
            is_exact = self._restore_exact(q, state.values, status)
            is_past_node = self._move_to_last_node(assembly_mode, q, state, status)
            singular = ((status == Status.AT_SINGULARITY) & ~is_exact) | is_past_node
            # Digits are lost if several dyads are nearly in line, or if a dyad is between
            # axes that nearly coincide.
            loses_digits = state.slack > REACH_SLACK / SINGULAR_DYAD_SINE
            loses_digits |= state.side_ratio < SINGULAR_DYAD_SINE
            singular |= (status == Status.OK) & loses_digits
            singular_error = np.where(is_exact, EXACT_ERROR_RAD, np.nan)
            if np.any(singular):
                singular_rows = np.flatnonzero(singular)
                singular_error[singular_rows] = self._place_singular(
                    assembly_mode, q, singular_rows, state, status
                )

            # The loops of the whole mechanism check the result, and orient all links. Dead
            # centres whose angles could not be computed become NaN, and keep their status.
            closure = self.closure.linearise(state.values)
            values = closure.values
            rotations = closure.rotations
            residual = closure.closure_residual
            has_angles = all_finite(state.values, 1) | (status != Status.AT_SINGULARITY)
            is_open = ~(residual < CLOSURE_TOLERANCE)
            _set_status(status, has_angles & is_open, Status.NOT_CLOSED)
            failed = ~has_configuration(status) | ~has_angles
            for array in (values, rotations, residual):
                array[failed] = np.nan
            passive_angles = [v for v in self.angles if v not in self.driven]
            values[:, passive_angles] = wrap(values[:, passive_angles])
            return ModeConfigurations(values, rotations, status, residual, singular_error)

    def _evaluate_pieces(
        self, assembly_mode: AssemblyMode, q: Floats
    ) -> ModeConfigurations:
        """Return the configurations of an assembly mode with pieces at inputs q (n, 1) rad.

        Such a mode follows a smooth curve of configurations through crossings with other
        curves. A dyad (group of two links) can be assembled in two ways, which its sign
        selects. Between two crossings these signs are constant, and the mode coincides with
        the mode that has these signs. The curve consists of such pieces.
        """
        piece_numbers = assembly_mode.pieces_at(q[:, 0])
        # The results of the pieces are joined in the order of the pieces. `order` lists the
        # samples in this order, and `argsort(order)` puts the results back.
        order = np.argsort(piece_numbers, kind="stable")
        results_of_pieces = []
        # A piece is the input at which it begins, and its mode.
        for number, (_first_input, mode) in enumerate(assembly_mode.pieces):
            inputs_of_piece = q[piece_numbers == number]
            results_of_pieces.append(self.evaluate(mode, inputs_of_piece))
        return ModeConfigurations.concatenate(results_of_pieces).rows(np.argsort(order))

    def _place_without_sign(
        self,
        assembly_mode: AssemblyMode,
        position: int,
        q: Floats,
        rows: Indices | None,
        state: AssemblyState,
        status: SmallIntegers,
    ) -> None:
        """Place a group that is not a dyad, and set the status of samples that fail.

        A group is a set of bodies that are placed together. A dyad consists of two bodies
        joined by a pair. A train of wheels is placed by gear ratios. A larger group is
        closed by Newton's method, which starts from a prediction of the assembly mode.

        Parameters
        ----------
        assembly_mode
            The mode.
        position
            Position of the group in solving order.
        q
            (n, inputs) inputs (rad).
        rows
            (n,) indices of the samples that have these inputs. With one input the indices
            are not needed and can be None.
        state
            The bodies placed so far; changed in place.
        status
            (n,) status of each sample; changed in place.
        """
        group = self.assembly.groups[position]
        if position in self.wheel_trains:
            closure = self.place_wheel_train(state, position, q)
            is_open = ~(closure.closure_residual < CLOSURE_TOLERANCE)
            _set_status(status, is_open, Status.NOT_CONVERGED)
        else:
            assert assembly_mode.guide is not None
            # Variables (n, variables) interpolated between verified configurations, how far
            # apart these are (rad), and whether the mode exists there.
            predicted, spread, mode_status = assembly_mode.guide.predict(q, rows)
            lost = has_configuration(status) & (mode_status != Status.OK)
            status[lost] = mode_status[lost]
            start = predicted[:, group_variables(state, group)]
            start = np.where(has_configuration(status)[:, None], start, np.nan)
            closure = place_group(state, group, start)
            is_open = ~(closure.closure_residual < CLOSURE_TOLERANCE)
            _set_status(status, is_open, Status.NOT_CONVERGED)
            # Newton's method may converge to another mode, which is farther away than an
            # interpolation between two verified nodes can be wrong.
            deviation = max_abs(closure.values - start, axis=1)
            limit = PREDICTION_RATIO * spread + PREDICTION_SLACK_RAD
            _set_status(status, ~(deviation <= limit), Status.MODE_LOST)
        reciprocal_condition = group_reciprocal_condition(closure.jacobian)
        is_singular = reciprocal_condition < SINGULAR_GROUP_CONDITION
        if assembly_mode.group_signs:
            # The sign of the determinant differs between neighbouring modes. In a singular
            # configuration it is caused by rounding.
            sign = determinant_sign(closure.jacobian)
            is_flipped = sign != assembly_mode.group_signs[position]
            is_flipped &= reciprocal_condition >= SINGULAR_GROUP_CONDITION
            _set_status(status, is_flipped, Status.MODE_LOST)
        _set_status(status, is_singular, Status.AT_SINGULARITY)
        is_off_profile = ~np.all(closure.states.inside, axis=1)
        _set_status(status, is_off_profile, Status.OFF_PROFILE)
        joints = [self.joints[pair] for pair in group.pairs]
        _set_status(status, has_penetration(joints, closure.states), Status.CURVATURE)

    def _restore_exact(self, q: Floats, values: Floats, status: SmallIntegers) -> Bools:
        """Replace singular configurations by exact ones that are near to them.

        At a dead centre a computed configuration has only half the digits. Some
        configurations are known up to rounding (`exact_configurations`): the reference
        pose, and crossings of curves. One of them is taken if it has the same inputs and is
        nearer than `EXACT_DISTANCE_RAD`.

        Parameters
        ----------
        q
            (n, inputs) inputs (rad).
        values
            (n, variables) configurations (rad), changed in place. Inputs stay the same.
            Exact angles are shifted by full revolutions to the angles that they replace.
        status
            (n,) status of each configuration. Only those at a singularity are replaced.

        Returns
        -------
        (n,) whether the configuration was replaced by an exact one.
        """
        is_exact = np.zeros(len(q), dtype=bool)
        singular_rows = np.flatnonzero(status == Status.AT_SINGULARITY)
        if not len(singular_rows):
            return is_exact
        driven = list(self.driven)
        passive_angles = [v for v in self.angles if v not in driven]
        for exact_values in self.exact_configurations:
            # Samples with the inputs of the exact configuration, up to full revolutions.
            singular_q = q[singular_rows]
            input_deviation = max_abs(wrap(singular_q - exact_values[driven]), axis=1)
            scale = np.maximum(1.0, max_abs(singular_q, axis=1))
            rows = singular_rows[input_deviation <= SAME_INPUT_TOLERANCE * scale]
            correction = exact_values - values[rows]
            # Differences of full revolutions are removed; the inputs stay.
            correction[:, passive_angles] = wrap(correction[:, passive_angles])
            correction[:, driven] = 0.0
            is_near = max_abs(correction, axis=1) < EXACT_DISTANCE_RAD
            values[rows[is_near]] += correction[is_near]
            is_exact[rows[is_near]] = True
        return is_exact

    @cached_property
    def _quad_assembly(self) -> QuadAssembly:
        """The object that places mechanisms of R pairs in quad precision."""
        return QuadAssembly(self.mechanism, self.assembly)

    def _move_to_last_node(
        self,
        assembly_mode: AssemblyMode,
        q: Floats,
        state: AssemblyState,
        status: SmallIntegers,
    ) -> Bools:
        """Move samples just beyond the last node of an assembly mode back to this node.

        With one input, a mode is a curve of verified configurations, its nodes. The curve
        ends at a dead centre, where the input reverses. The last node is a little before
        the dead centre, at most `LAST_NODE_DISTANCE_RAD`. A sample beyond the node by less
        than this distance has the status `OUT_OF_REACH`, but counts as beside the dead
        centre. Its configuration becomes that of the node. The caller then computes it
        more exactly and sets its status (`_place_singular`).

        Parameters
        ----------
        assembly_mode
            The mode. Its `guide` is the curve with the nodes if it is a `ModeCurve`.
        q
            (n, inputs) inputs (rad).
        state
            The placed bodies. Its variables are changed for the moved samples.
        status
            (n,) status of each sample, which is not changed.

        Returns
        -------
        (n,) whether a sample was moved.
        """
        was_moved = np.zeros(len(q), dtype=bool)
        mode_curve = assembly_mode.guide
        is_out = status == Status.OUT_OF_REACH
        if isinstance(mode_curve, ModeCurve) and np.any(is_out):
            # Samples outside the curve get the input of the last node on their side.
            nearest_q = np.clip(q[:, 0], mode_curve.inputs[0], mode_curve.inputs[-1])
            distance_to_node = np.abs(q[:, 0] - nearest_q)
            was_moved = is_out & (distance_to_node < LAST_NODE_DISTANCE_RAD)
            node_values, _ = mode_curve.interpolate(nearest_q[was_moved])
            state.values[was_moved] = node_values
        return was_moved

    def _place_singular(
        self,
        assembly_mode: AssemblyMode,
        q: Floats,
        rows: Indices,
        state: AssemblyState,
        status: SmallIntegers,
    ) -> Floats:
        """Place samples beside a dead centre again, and set their status.

        In float64, angles lose half their digits with each group that is at its dead
        centre. Mechanisms of R pairs are therefore placed in quad precision (33 digits).
        Contacts and loops with redundant equations stay in float64. Samples of status OK
        stay in float64 if the quad placement has no useful error bound. Angles that are not
        known to `MAX_SINGULAR_ANGLE_ERROR_RAD` are set to NaN.

        Parameters
        ----------
        assembly_mode
            The mode.
        q
            (n, inputs) inputs (rad) of all samples.
        rows
            (k,) indices of the samples to place again.
        state
            The placed bodies; its variables are changed in place.
        status
            (n,) status of all samples; changed in place.

        Returns
        -------
        (k,) bounds (rad) of the errors of the variables, infinite if there is no bound.
        """
        # In quad precision, as far as that is possible.
        if self._quad_assembly.is_supported:
            placed = self._quad_assembly.place(
                assembly_mode.signs, assembly_mode.group_signs, q[rows], state.values[rows]
            )
            values = placed.values
            error = placed.error
            new_status = placed.status
            is_unknown = ~(error <= MAX_SINGULAR_ANGLE_ERROR_RAD)
            in_float64 = np.flatnonzero((status[rows] == Status.OK) & is_unknown)
        else:
            values = state.values[rows]
            error = np.full(len(rows), np.inf)
            new_status = status[rows]
            in_float64 = np.arange(len(rows))
        # Place the other samples in float64. `in_float64` has their positions in `rows`.
        if len(in_float64):
            float64_rows = rows[in_float64]
            fold = place_at_folds(
                self.closure, self.driven, q[float64_rows], state.values[float64_rows]
            )
            values[in_float64] = fold.values
            error[in_float64] = fold.error
            is_regular = status[float64_rows] == Status.OK
            is_regular &= fold.error <= MAX_SINGULAR_ANGLE_ERROR_RAD
            new_status[in_float64] = np.select(
                [is_regular, fold.is_out_of_reach],
                [Status.OK, Status.OUT_OF_REACH],
                Status.AT_SINGULARITY,
            )
        has_angles = error <= MAX_SINGULAR_ANGLE_ERROR_RAD
        state.values[rows] = np.where(has_angles[:, None], values, np.nan)
        # Samples that were out of reach stay so unless their angles are known now.
        was_out = status[rows] == Status.OUT_OF_REACH
        status[rows] = np.where(was_out & ~has_angles, Status.OUT_OF_REACH, new_status)
        return error


def _set_status(status: SmallIntegers, where: Bools, code: Status) -> None:
    """Set the status of the samples `where`, except for those that failed before.

    A sample therefore shows its first failure. AT_SINGULARITY is no failure, so a failure
    overwrites this status.
    """
    can_change = status == Status.OK
    if code != Status.AT_SINGULARITY:
        can_change |= status == Status.AT_SINGULARITY
    status[where & can_change] = code
