"""One assembly mode of a mechanism, evaluated at any input.

An assembly mode names one mode of every group: a sign for a dyad, whose closed form cannot
flip; for an irreducible group a guide of verified configurations (a curve for one input,
a sheet for several) that predicts where Newton's method has to arrive and what it must
not leave.

Angle unwrapping: which whole turns a passive pair has made at an input.

An angle that a motion reduces to a turn is a continuous function of the inputs along its
assembly mode. It is in (-pi, pi] at the anchor, which is the reference pose, or zero; what
wheels fix is a linear function of the inputs from there on, the rest is followed by
verified steps, however far samples lie apart.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, Integers, SmallIntegers
from spherekit.conventions import TURN, Names
from spherekit.geometry.rotation import all_finite, max_abs, nans
from spherekit.mechanism.joint_construction import make_joints_in_pose
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap
from spherekit.numerics.array_rows import ArrayRows
from spherekit.planning.assembly_plan import Assembly
from spherekit.planning.wheel_train import GearTrain, wheel_train
from spherekit.positions.fold_bounds import place_at_folds
from spherekit.positions.gear_phases import GearPhases, meshes_of
from spherekit.positions.group_assembly import (
    State,
    group_variables,
    place_dyad,
    place_group,
    train_turns,
    train_ways,
)
from spherekit.positions.input_revolutions import whole_laps
from spherekit.positions.linearisation import (
    DEPENDENT,
    Linearisation,
    left_inverse,
    rank_mobility,
)
from spherekit.positions.loop_closure import Closure
from spherekit.positions.mode_predictor import ModeCurve, ModeOverGrid, follow_each
from spherekit.positions.pair_states import penetrates
from spherekit.positions.path_continuation import determinant_sign, follow_inputs
from spherekit.positions.quad_positions import LARGEST_ANGLE_ERROR_RAD, QuadAssembly
from spherekit.status import Status
from spherekit.tolerances import CLOSURE_TOLERANCE, EPS, REACH_SLACK
from spherekit.wording import listing

SAME = 0.3
"""Angles (rad) of a followed mode that are farther from a row's are another's."""
LAST_STEP_RAD = 1e-9
"""The last node of a curve is nearer than this to the dead centre where the curve ends."""
BEYOND = 1e-4
"""An input beyond the end of a mode by less (rad) is at its end, a dead centre."""
HALF = np.pi + 1e-3
"""An angle (rad) of half a turn is positive, whatever rounding makes of it, and a singular
anchor of rounding."""


def first_turns(angles: Floats) -> Floats:
    """Return the whole turns less which angles are in (-pi, pi]."""
    return np.ceil((angles - HALF) / TURN)


SAME_INPUT = 1e-15
"""An input that differs by less (rad, or relatively) from that of a configuration known
exactly is the same but for rounding."""
EXACT_ERROR_RAD = 16.0 * EPS
"""Error bound of a configuration that is known exactly but for rounding."""
NEAR_EXACT = 1e-5
"""A singular configuration nearer (rad) than this to one known exactly is that one."""
BESIDE_CROSSING = 1e-4
"""Angles on both sides of a crossing are compared so far (rad) from it."""
FLAT_DYAD = 1e-6
"""A dyad straighter than this sine loses half its digits: its rates are not given."""
FLAT_GROUP = 1e-6
"""The same for the smallest relative singular value of an irreducible group."""
SMALLEST_SPREAD = 1e-9
"""Axes that differ by less are taken to be parallel."""
FAR_FROM_NAMED = np.radians(10.0)
"""A mode that misses a named configuration by more (rad) is another one."""
CLEARLY = 0.5
"""So much nearer than every other mode, as a part, the one meant is."""


class AssemblyMode(NamedTuple):
    """One assembly mode over the ranges of the inputs.

    `signs` has +1 or -1 for each dyad and 0 for each irreducible group; `guide` is
    None where all groups are dyads, or trains of wheels; `name` is the file's, if any.
    A mode that follows its smooth curve through crossings has `pieces`: inputs (rad), the
    first of them -inf, and the mode that lies on the curve from each of them on.
    """

    number: int
    signs: tuple[int, ...]
    guide: ModeCurve | ModeOverGrid | None = None
    determinants: tuple[float, ...] = ()
    name: str = ""
    pieces: tuple[tuple[float, "AssemblyMode"], ...] = ()

    def pieces_at(self, q: Floats) -> Indices:
        """Return the numbers (n,) of the pieces at values q (n,) rad of the only input."""
        starts = np.array([start for start, _ in self.pieces[1:]])
        return np.searchsorted(starts, q, side="right")

    def signs_along(self, q: Floats) -> Integers:
        """Return the signs (groups, n) at inputs q (inputs, n)."""
        if not self.pieces:
            return np.repeat(np.array(self.signs, dtype=int)[:, None], q.shape[1], axis=1)
        of_pieces = np.array([mode.signs for _, mode in self.pieces])
        return of_pieces[self.pieces_at(q[0])].T

    @property
    def title(self) -> str:
        """What it is called beside its number: its signs, and its name in the file."""
        return ", ".join(filter(None, (self.label, self.name)))

    @property
    def label(self) -> str:
        """The signs of the mode's groups, ``~`` for an irreducible one."""
        return label_of(self.signs) or "+"


@dataclass(frozen=True)
class Evaluated(ArrayRows):
    """An assembly mode at n inputs: variables, orientations, status and residual.

    `singular_error` (n,) rad bounds the errors of the variables in rows near dead centres,
    and is NaN in other rows.
    """

    values: Floats
    rotations: Floats
    status: SmallIntegers
    residual: Floats
    singular_error: Floats


class Solver:
    """Geometry, groups and closure of one mechanism with its input, ready to evaluate."""

    def __init__(self, mechanism: Mechanism, assembly: Assembly) -> None:
        self.mechanism = mechanism
        self.assembly = assembly
        self.joints, self.reference = make_joints_in_pose(mechanism)
        self.closure = Closure.of(mechanism, self.joints)
        self.driven = tuple(
            number for pair in assembly.inputs for number in mechanism.variables_of(pair)
        )
        self.anchor = np.zeros(len(self.driven))
        self.exact_configurations: list[Floats] = []
        """Configurations (variables,) that are known to rounding: the reference pose, and
        those at which curves cross. A closed form has half the digits where a dyad is in
        line."""
        if self.reference is not None:
            self.anchor = self.reference[list(self.driven)]
            self.exact_configurations.append(self.reference)

    @property
    def single(self) -> int:
        """The number of the only input's variable; `PlanError` if there are several."""
        (number,) = self.mechanism.variables_of(self.assembly.input)
        return number

    @cached_property
    def _train(self) -> GearTrain | None:
        return wheel_train(self.mechanism, self.assembly.inputs, whole=False)

    @cached_property
    def meshes(self) -> GearPhases | None:
        """How far wheels have rolled at inputs, None without rolling contacts."""
        return meshes_of(self.closure, self.anchor, self._train)

    @cached_property
    def unwrapping(self) -> "Unwrapping":
        """The turns of passive pairs at inputs."""
        return Unwrapping(self)

    @property
    def periods(self) -> Floats:
        """(k,) growth (rad) of each input with which the same configurations return.

        A turn; more where wheels count the turns, infinite where they never return.
        """
        if self.meshes is None:
            return np.full(len(self.driven), TURN)
        return self.meshes.periods

    def reduced(self, q: Floats) -> Floats:
        """Return inputs (n, k) less whole periods, from half a one below zero to above."""
        periods = self.periods
        returns = np.isfinite(periods)
        scale = np.where(returns, periods, TURN) / TURN
        return np.where(returns, scale * wrap(q / scale), q)

    @cached_property
    def trains(self) -> frozenset[int]:
        """The numbers of groups that are trains of wheels: inputs place their bodies."""
        train, numbers = self._train, set()
        if train is None:
            return frozenset()
        for number, group in enumerate(self.assembly.groups):
            contacts = {pair for pair in group.pairs if not self.joints[pair].has_axis}
            placed = 1 + len(train_ways(group, train.followers)) == len(group.bodies)
            if placed and contacts and contacts <= {*train.contacts}:
                numbers.add(number)
        return frozenset(numbers)

    @property
    def has_closed_form(self) -> bool:
        """Whether every group is a dyad, or a train of wheels."""
        return all(
            group.is_dyad or number in self.trains
            for number, group in enumerate(self.assembly.groups)
        )

    def train_angles(self, q: Floats) -> dict[int, Floats]:
        """Return the angles (n,) of pairs that wheels fix at inputs q (n, inputs)."""
        if self._train is None:
            return {}
        angles = self._train.offsets + q @ self._train.ratios.T
        return dict(zip(self._train.followers, angles.T, strict=True))

    def place(self, state: State, number: int, q: Floats) -> Linearisation:
        """Place a train of wheels, the group of a number, at inputs q (n, inputs)."""
        group, placed = self.assembly.groups[number], state.copy()
        turns = train_turns(
            group, state.within, state.ends, self.joints, self.train_angles(q)
        )
        every = [np.broadcast_to(turn, (len(q), 3, 3)) for turn in turns]
        placed.merge(group, np.stack(every, axis=1))
        placed.read_values(group)
        if self.meshes is not None:
            placed.values[:, list(self.meshes.variables)] = self.meshes.rolled(q)
        return place_group(state, group, placed.values[:, group_variables(state, group)])

    def moved(self, values: Floats, q: Floats) -> Floats:
        """Return configurations (n, variables) at inputs (n, k) whole periods away."""
        at = values.copy()
        at[:, list(self.driven)] = q
        if self.meshes is not None:
            grown = q - values[:, list(self.driven)]
            at[:, list(self.meshes.variables)] += grown @ self.meshes.ratios.T
        return at

    def start(self, q: Floats) -> State:
        """Return the state in which only the inputs have values q (n, inputs)."""
        return State.start(self.mechanism, self.joints, self.assembly, q)

    def freedoms(self, values: Floats, dependent: float = DEPENDENT) -> int:
        """Return the mobility by rank at a closed configuration (variables,).

        Singular values below the part `dependent` of the largest count as zero.
        """
        vectors = self.closure.at(values[None]).vectors
        return int(rank_mobility(self.closure.tree, vectors, dependent)[0])

    def evaluate(
        self, assembly_mode: AssemblyMode, q: Floats, rows: Indices | None = None
    ) -> Evaluated:
        """Return the mode at inputs q (n, inputs) in any order; failed samples are NaN.

        An assembly mode guided by a sheet is known at the samples of its input grid only;
        `rows` (n,) says which ones they are.
        """
        if assembly_mode.pieces:
            return self._evaluate_pieces(assembly_mode, q)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            state, status = self.start(q), np.zeros(len(q), dtype=np.int8)
            for number, sign in enumerate(assembly_mode.signs):
                if sign:
                    sine = place_dyad(state, self.assembly.groups[number], sign)
                    _mark(status, state.lost, Status.OUT_OF_REACH)
                    _mark(status, sine < FLAT_DYAD, Status.AT_SINGULARITY)
                else:
                    self._place(assembly_mode, number, q, rows, state, status)
            is_exact = self._restore_exact(q, state.values, status)
            beyond = self._past_the_end(assembly_mode, q, state, status)
            singular = ((status == Status.AT_SINGULARITY) & ~is_exact) | beyond
            # Several dyads that are nearly in line lose as many digits as one that is, and
            # so does a dyad between axes that nearly coincide.
            loses_digits = state.slack > REACH_SLACK / FLAT_DYAD
            loses_digits |= state.slenderness < FLAT_DYAD
            singular |= (status == Status.OK) & loses_digits
            singular_error = np.where(is_exact, EXACT_ERROR_RAD, np.nan)
            if np.any(singular):
                rows = np.flatnonzero(singular)
                singular_error[rows] = self._place_singular(
                    assembly_mode, q, rows, state, status
                )
            at = self.closure.at(state.values)
            values, rotations, residual = at.values, at.placed, at.gap
            has_angles = all_finite(state.values, 1) | (status != Status.AT_SINGULARITY)
            _mark(status, has_angles & ~(residual < CLOSURE_TOLERANCE), Status.NOT_CLOSED)
            failed = ~assembled(status) | ~has_angles
            for part in (values, rotations, residual):
                part[failed] = np.nan
            free = [v for v in self.angles if v not in self.driven]
            values[:, free] = wrap(values[:, free])
            return Evaluated(values, rotations, status, residual, singular_error)

    def _restore_exact(self, q: Floats, values: Floats, status: SmallIntegers) -> Bools:
        """Set singular configurations (n, variables) at inputs q that are known exactly.

        Return which rows (n,) these are.
        """
        is_exact = np.zeros(len(q), dtype=bool)
        singular = np.flatnonzero(status == Status.AT_SINGULARITY)
        driven = list(self.driven)
        for exact in self.exact_configurations if len(singular) else ():
            away = max_abs(wrap(q[singular] - exact[driven]), axis=1)
            rows = singular[
                away <= SAME_INPUT * np.maximum(1.0, max_abs(q[singular], axis=1))
            ]
            offset = exact - values[rows]
            angles = [v for v in self.angles if v not in driven]
            offset[:, angles] = wrap(offset[:, angles])
            offset[:, driven] = 0.0
            is_near = max_abs(offset, axis=1) < NEAR_EXACT
            values[rows[is_near]] += offset[is_near]
            is_exact[rows[is_near]] = True
        return is_exact

    def _evaluate_pieces(self, assembly_mode: AssemblyMode, q: Floats) -> Evaluated:
        """Return a mode that changes to other ones at inputs, at inputs q (n, 1)."""
        owners = assembly_mode.pieces_at(q[:, 0])
        order = np.argsort(owners, kind="stable")
        parts = [
            self.evaluate(mode, q[owners == number])
            for number, (_, mode) in enumerate(assembly_mode.pieces)
        ]
        return Evaluated.joined(parts).rows(np.argsort(order))

    @cached_property
    def _quad_assembly(self) -> QuadAssembly:
        return QuadAssembly(self.mechanism, self.assembly)

    def _past_the_end(
        self, assembly_mode: AssemblyMode, q: Floats, state: State, status: SmallIntegers
    ) -> Bools:
        """Return which rows (n,) lie past the last node of a curve, beside a dead centre.

        The variables there are set to those of the last node.
        """
        past = np.zeros(len(q), dtype=bool)
        guide = assembly_mode.guide
        if isinstance(guide, ModeCurve) and np.any(status == Status.OUT_OF_REACH):
            last = np.clip(q[:, 0], guide.inputs[0], guide.inputs[-1])
            past = (status == Status.OUT_OF_REACH) & (
                np.abs(q[:, 0] - last) < LAST_STEP_RAD
            )
            state.values[past] = guide.predict(last[past])[0]
        return past

    def _place_singular(
        self,
        assembly_mode: AssemblyMode,
        q: Floats,
        rows: Indices,
        state: State,
        status: SmallIntegers,
    ) -> Floats:
        """Place rows (k,) beside a dead centre again, and set their statuses.

        In float64 angles lose half their digits with each group that is at its dead
        centre. R pairs are therefore placed in quad precision. Contacts, and loops with
        redundant equations, have float64 values. So have rows of status OK for which the
        quad placement has no error bound, as in a long chain of dyads, whose bounds
        multiply. Angles that are not known to `LARGEST_ANGLE_ERROR_RAD` are set to NaN.

        Returns
        -------
        (k,) bounds (rad) of the errors of the variables.
        """
        if self._quad_assembly.is_supported:
            placed = self._quad_assembly.place(
                assembly_mode.signs, assembly_mode.determinants, q[rows], state.values[rows]
            )
            values, error, new_status = placed.values, placed.error, placed.status
            is_unknown = ~(error <= LARGEST_ANGLE_ERROR_RAD)
            in_float64 = np.flatnonzero((status[rows] == Status.OK) & is_unknown)
        else:
            values = state.values[rows]
            error = np.full(len(rows), np.inf)
            new_status = status[rows]
            in_float64 = np.arange(len(rows))
        if len(in_float64):
            float64_rows = rows[in_float64]
            fold = place_at_folds(
                self.closure, self.driven, q[float64_rows], state.values[float64_rows]
            )
            values[in_float64] = fold.values
            error[in_float64] = fold.error
            is_regular = (status[float64_rows] == Status.OK) & np.isfinite(fold.error)
            new_status[in_float64] = np.select(
                [is_regular, fold.is_out_of_reach],
                [Status.OK, Status.OUT_OF_REACH],
                Status.AT_SINGULARITY,
            )
        has_angles = error <= LARGEST_ANGLE_ERROR_RAD
        state.values[rows] = np.where(has_angles[:, None], values, np.nan)
        was_out = status[rows] == Status.OUT_OF_REACH
        status[rows] = np.where(was_out & ~has_angles, Status.OUT_OF_REACH, new_status)
        return error

    def _place(
        self,
        assembly_mode: AssemblyMode,
        number: int,
        q: Floats,
        rows: Indices | None,
        state: State,
        status: SmallIntegers,
    ) -> None:
        """Place a train of wheels or an irreducible group, and note in `status` how."""
        group = self.assembly.groups[number]
        if number in self.trains:
            at = self.place(state, number, q)
            _mark(status, ~(at.gap < CLOSURE_TOLERANCE), Status.NOT_CONVERGED)
        else:
            assert assembly_mode.guide is not None
            predicted, spread, why = assembly_mode.guide.at(q, rows)
            lost = assembled(status) & (why != Status.OK)
            status[lost] = why[lost]
            start = predicted[:, group_variables(state, group)]
            start = np.where(assembled(status)[:, None], start, np.nan)
            at = place_group(state, group, start)
            _mark(status, ~(at.gap < CLOSURE_TOLERANCE), Status.NOT_CONVERGED)
            distance = max_abs(at.values - start, axis=1)
            _mark(status, ~(distance <= 0.25 * spread + 1e-6), Status.MODE_LOST)
        reciprocal_condition = flatness(at.jacobian)
        if assembly_mode.determinants:
            # of a flat group the sign is rounding
            flipped = determinant_sign(at.jacobian) != assembly_mode.determinants[number]
            flipped &= reciprocal_condition >= FLAT_GROUP
            _mark(status, flipped, Status.MODE_LOST)
        _mark(status, reciprocal_condition < FLAT_GROUP, Status.AT_SINGULARITY)
        _mark(status, ~np.all(at.states.inside, axis=1), Status.OFF_PROFILE)
        joints = [self.joints[pair] for pair in group.pairs]
        _mark(status, penetrates(joints, at.states), Status.CURVATURE)

    @property
    def angles(self) -> list[int]:
        """Numbers of the variables that are angles of R pairs."""
        return list(self.mechanism.angles.values())


class Unwrapping:
    """The turns of passive pairs of one mechanism, mode by mode."""

    def __init__(self, solver: "Solver") -> None:
        self.solver, self.anchor = solver, solver.anchor
        self._closure, self._driven = solver.closure, list(solver.driven)
        self._angles = sorted({*solver.angles} - {*solver.driven})
        self._pieces: dict[int, list[Callable[[Floats], Floats]]] = {}

    def turns(
        self,
        mode: int,
        values: Floats,
        q: Floats,
        wanted: Sequence[int],
        last: Sequence[float] | None = None,
    ) -> Floats:
        """Return turns (n, variables) to be added to configurations (n, variables).

        `q` (n, inputs) are their inputs, which may be whole periods from those of the
        configurations. Only the variables `wanted` are sought, those of others may be
        zero. With several inputs samples are followed in their order, from the `last`
        whole configuration (variables,) or else from the anchor.
        """
        turns = np.zeros_like(values)
        settled = set(self._driven)
        start = self.solver.train_angles(self.anchor[None])
        for pair, angle in self.solver.train_angles(q).items():
            (follower,) = self.solver.mechanism.variables_of(pair)
            angle = angle - TURN * first_turns(start[pair]) - values[:, follower]
            turns[:, follower] = np.round(angle / TURN)
            settled.add(follower)
        sought = [v for v in self._angles if v not in settled]
        if not set(sought) & set(wanted) or not len(values):
            return turns
        at = self.solver.moved(values, q)
        single = len(self._driven) == 1
        passive = self._by_pieces(mode, at) if single else self._in_order(at, last)
        turns[:, sought] = passive[:, np.isin(self._angles, sought)]
        return turns

    def smooth_turns(
        self, mode: AssemblyMode, values: Floats, q: Floats, wanted: Sequence[int]
    ) -> Floats:
        """Return turns that go on through the crossings that a mode passes.

        Parameters
        ----------
        mode
            A mode with `pieces`.
        values, q
            (n, variables) rad configurations of the mode and (n, 1) rad their inputs.
        wanted
            The variables whose turns are sought.

        Returns
        -------
        (n, variables) array
            Below the first crossing they are those of the mode that is there.
        """
        turns = np.zeros_like(values)
        owners = mode.pieces_at(q[:, 0])
        shift = np.zeros(values.shape[1])
        for number, (crossing, piece) in enumerate(mode.pieces):
            # Each piece is followed by itself: near a crossing other curves are as near.
            key = -1 - mode.number * len(mode.pieces) - number
            is_here = owners == number
            # Right at crossings it is open which curve is followed.
            ends = [start for start, _ in mode.pieces[number : number + 2]]
            for end in ends:
                is_here &= np.abs(q[:, 0] - end) > BESIDE_CROSSING
            rows = np.flatnonzero(is_here)
            turns[rows] = self.turns(key, values[rows], q[rows], wanted)
            turns[rows] += shift
            if number:
                before = mode.pieces[number - 1][1]
                below = self._angles_at(key + 1, before, crossing - BESIDE_CROSSING, wanted)
                above = self._angles_at(key, piece, crossing + BESIDE_CROSSING, wanted)
                if not (all_finite(below) and all_finite(above)):
                    continue  # The curve ends at the crossing.
                at_crossing = np.abs(q[:, 0] - crossing) <= BESIDE_CROSSING
                turns[at_crossing] = shift + np.round((below - values[at_crossing]) / TURN)
                change = np.round((below - above) / TURN)
                shift = shift + change
                turns[rows] += change
        turns[:, self._driven] = 0.0
        return turns

    def _angles_at(
        self, key: int, mode: AssemblyMode, q: float, wanted: Sequence[int]
    ) -> Floats:
        """Return the variables (variables,) of a mode with their turns at an input (rad).

        Its turns are found under the `key` of `turns`.
        """
        inputs = np.array([[q]])
        values = self.solver.evaluate(mode, inputs).values
        if not all_finite(values):
            return values[0]
        whole: Floats = values + TURN * self.turns(key, values, inputs, wanted)
        return whole[0]

    def _by_pieces(self, mode: int, at: Floats) -> Floats:
        (driven,), (period,) = self._driven, self.solver.periods
        turns, left = nans((len(at), len(self._angles))), np.arange(len(at))
        pieces, number = self._pieces.setdefault(mode, []), 0
        while len(left):
            made = number == len(pieces)
            if made:
                pieces.append(self._piece(at[left[0]], at[left, driven], period))
            turns[left] = pieces[number](at[left])
            left = left[int(made) :]
            left = left[np.isnan(turns[left, 0])]
            number += 1
        return turns

    def _piece(
        self, given: Floats, places: Floats, period: float
    ) -> Callable[[Floats], Floats]:
        """Return the turns over the inputs that a configuration reaches without a gap.

        They are (n, angles), to be added at configurations (n, variables): NaN for those
        that the mode through the one given (variables,) has not. Where the input returns,
        after a `period` (rad), the angles have grown by whole turns after every lap.
        """
        (driven,), (anchor,), angles = self._driven, self.anchor, self._angles
        ends, values = [anchor, *places.tolist()], given
        if np.isfinite(period):
            moved = anchor + np.mod(given[driven] - anchor, period)
            values = self.solver.moved(given[None], np.array([[moved]]))[0]
            ends = [anchor, anchor + period]
        curve = follow_each(self._closure, driven, values[None], min(ends), max(ends))[0]
        low, high = curve.inputs[[0, -1]]
        grown = (curve.values[-1] - curve.values[0])[angles]
        winding = np.round(grown / TURN)
        if not high - low > period - BEYOND:
            winding = np.zeros(len(angles))
        elif not max_abs(grown - TURN * winding) < SAME:  # another mode is there
            return self._piece(given, places, np.inf)
        reference = np.clip(anchor, low, high)
        if low > anchor + BEYOND and high > anchor + period - BEYOND:
            reference = high
        first = first_turns(curve.predict(np.array([reference]))[0][0])[angles]

        def turns(at: Floats) -> Floats:
            along = at[:, driven] - low + BEYOND
            place = low - BEYOND + np.mod(along, period)
            followed, _ = curve.predict(np.clip(place, low, high))
            away = (followed - at)[:, angles]
            whole = np.round(away / TURN)
            near = (place <= high + BEYOND) & (max_abs(away - TURN * whole, axis=1) < SAME)
            whole += np.floor(along / period)[:, None] * winding - first
            return np.where(near[:, None], whole, np.nan)

        return turns

    def _in_order(self, at: Floats, last: Sequence[float] | None) -> Floats:
        """Return turns (n, angles) of rows that follow each other, several inputs.

        Where no straight way within the mode leads there from the row before, one from the
        anchor, but for whole periods of inputs, with which angles grow as they do from the
        anchor: not, where it is singular. Where none leads there, angles are in (-pi, pi].
        """
        angles, given = self._angles, at if last is None else np.concatenate([[last], at])
        steps, follows = self._grown(given[1:], given[:-1])
        anew = np.concatenate([[last is None], ~follows])
        first, periods = given[anew], self.solver.periods
        q = first[:, self._driven]
        far, goal = whole_laps(q - self.anchor, periods), np.full_like(q, self.anchor)
        near = self.solver.moved(first, q - far)
        there = follow_inputs(self._closure, self._driven, near, goal)[0].values
        led = max_abs(there[:, self._driven] - goal, axis=1) < BEYOND
        turns = np.zeros((len(given), len(angles)))
        turns[anew] = -first_turns(np.where(led[:, None], there, near)[:, angles])
        jacobian = np.delete(self._closure.at(there).jacobian, self._driven, axis=2)
        led &= flatness(jacobian) >= FLAT_GROUP
        rows, which = np.nonzero(far * led[:, None])
        there, period = there[rows], periods[which, None]
        on = goal[rows] + np.eye(len(periods))[which] * period
        grown, whole = self._grown(there, self.solver.moved(there, on))
        laps = far[rows[whole], which[whole], None] / period[whole]
        np.add.at(turns, np.flatnonzero(anew)[rows[whole]], grown[whole] * laps)
        for row in np.flatnonzero(~anew[1:]):
            turns[row + 1] = turns[row] - steps[row]
        return turns[len(given) - len(at) :]

    def _grown(self, values: Floats, others: Floats) -> tuple[Floats, Bools]:
        """Return by how many turns (n, angles) values followed to others differ from these.

        And (n,) whether a straight way leads there.
        """
        there, status, _ = follow_inputs(
            self._closure, self._driven, values, others[:, self._driven]
        )
        grown = (there.values - others)[:, self._angles]
        turns = np.round(grown / TURN)
        away = max_abs(grown - TURN * turns, axis=1)
        return turns, (status == Status.OK) & (away < SAME)


def flatness(jacobian: Floats) -> Floats:
    """Return the reciprocal conditions (n,) of a group's Jacobians: 0 of a flat group.

    They do not depend on how near to each other all axes are: a small group is not a flat
    one.
    """
    reciprocal_condition = np.ones(len(jacobian))
    finite = all_finite(jacobian, (1, 2))
    spread = _spread(jacobian[finite])
    one, other = (np.linalg.norm(x, axis=(1, 2)) for x in (spread, left_inverse(spread)))
    reciprocal_condition[finite] = np.nan_to_num(1.0 / (one * other))
    return reciprocal_condition


def _spread(jacobian: Floats) -> Floats:
    """Return Jacobians as if all vectors of variables, seen from their mean, were large.

    Across the direction they have most in common, all loops are enlarged alike, so ranks
    and a loop's own flatness are kept.
    """
    n, rows, count = jacobian.shape
    loops = jacobian.reshape(n, rows // 3, 3, count)
    axes = np.moveaxis(loops, 2, 1).reshape(n, 3, rows // 3 * count)
    left, sizes, _ = np.linalg.svd(axes, full_matrices=False)
    common = left[:, :, :1] @ np.swapaxes(left[:, :, :1], 1, 2)
    sizes = np.pad(sizes, ((0, 0), (0, 1)))
    largest, across = sizes[:, :1, None], sizes[:, 1:2, None]
    across = np.maximum(across, SMALLEST_SPREAD * largest)
    even = common / largest + (np.eye(3) - common) / across
    return (even[:, None] @ loops).reshape(n, rows, count)


def label_of(signs: Iterable[float]) -> str:
    """Return the signs of a mode as text, ``+-+``, with ``~`` for groups without one."""
    return "".join("~+-"[int(sign)] for sign in signs)


def assembled(status: SmallIntegers) -> Bools:
    """Return which rows (n,) hold a configuration."""
    return (status == Status.OK) | (status == Status.AT_SINGULARITY)


def _mark(status: SmallIntegers, where: Bools, code: Status) -> None:
    free = (status == Status.OK) | (assembled(status) & (code != Status.AT_SINGULARITY))
    status[where & free] = code


def named(
    solver: Solver, assembly_modes: Sequence[AssemblyMode]
) -> tuple[tuple[AssemblyMode, ...], Names]:
    """Return assembly modes with the names that the file gives them, and what fails.

    A name goes to the mode that comes nearest to its configuration at the inputs of this.
    One whose configuration does not have all inputs is not used.
    """
    names: dict[int, str] = {}
    faults: list[str] = []
    if not assembly_modes:
        return (), ()
    inputs = solver.mechanism.input_pairs
    for name, said in solver.mechanism.modes.items():
        if not set(inputs) <= said.keys():
            continue
        place, why = _place(solver, assembly_modes, said, inputs)
        if place in names:
            why = f"it is mode {assembly_modes[place].number}, as {names[place]} is"
        if why:
            faults.append(f"modes.{name}: {why}; no mode has this name")
        else:
            names[place] = name
    made = (mode._replace(name=names.get(k, "")) for k, mode in enumerate(assembly_modes))
    return tuple(made), tuple(faults)


def _place(
    solver: Solver,
    assembly_modes: Sequence[AssemblyMode],
    said: Mapping[str, float],
    inputs: Sequence[str],
) -> tuple[int, str]:
    """Return the place of the mode with these variables, or -1 and why there is none."""
    if any(isinstance(item.guide, ModeOverGrid) for item in assembly_modes):
        return -1, "modes followed over samples of several inputs have no names"
    order = solver.mechanism.names_of(solver.assembly.inputs)
    q = np.array([[said[pair] for pair in order]])
    passive = [name for name in said if name not in inputs]
    variables = [solver.mechanism.angles[name] for name in passive]
    every = [solver.evaluate(item, q).values[0, variables] for item in assembly_modes]
    missed = np.abs(wrap(np.array(every) - [said[name] for name in passive]))
    off = np.nan_to_num(np.max(missed, axis=1, initial=0.0), nan=np.inf)
    best = int(np.argmin(off))
    if off[best] < min(FAR_FROM_NAMED, *CLEARLY * np.delete(off, best)):
        return best, ""

    def shown(names: Iterable[str], angles: Iterable[float]) -> list[str]:
        at = zip(names, np.degrees([*angles]), strict=True)
        return [f"{name} = {angle:.6g} deg" for name, angle in at]

    there = [
        f"mode {item.number}: {', '.join(shown(passive, wrap(angles)))}"
        for item, angles in zip(assembly_modes, every, strict=True)
        if all_finite(angles)
    ]
    where = listing(shown(inputs, (said[pair] for pair in inputs)))
    return -1, f"it is none at {where}, where there are {listing(there) or 'no modes'}"
