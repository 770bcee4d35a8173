"""What solves the poses of an output: a closed form, the graph, or one way only.

Pointing outputs of mechanisms in the mid-plane architecture, in closed form.

Closed forms of outputs that fall into dyads when held, driven directly or by wheels.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import product

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.errors import ModelError, SolveError, SpherekitError
from spherekit.guidance.loci import mid_plane_form
from spherekit.guidance.mid_plane_architecture import MidPlaneArchitecture, axis_in
from spherekit.model.gears import COLLINEAR
from spherekit.model.joints import revolute
from spherekit.model.mechanism import Mechanism, chosen_output
from spherekit.model.parts import Input, Output
from spherekit.motion.assembly_modes import label_of
from spherekit.motion.loops import turns_of
from spherekit.numeric.crossings import wrap
from spherekit.output.dyads import Signs, input_rates, rates_of_turns
from spherekit.output.forward import PoseSolutions
from spherekit.output.inverse import InverseKinematics
from spherekit.output.virtual_output import COORDINATES
from spherekit.planning.inputs import driven_pairs
from spherekit.planning.part import of_pairs
from spherekit.planning.wheels import GearTrain, wheel_train
from spherekit.sphere.rotation import arc, cross, nans
from spherekit.workspace.rows import (
    ClosedKinematics,
    InverseRows,
    OutputKinematics,
    Rows,
    Span,
)


class MidPlaneKinematics(ClosedKinematics):
    """A pointing output of a mechanism in its mid-plane symmetric architecture.

    The mid-plane of a direction p is the one that mirrors m, where the output would point
    with the end effector laid upon its image, to p; its normal n points from m to p. The
    mode of a leg is the sign of n . (base axis x elbow). In the direction m itself every
    plane through m serves, and nothing is determined.
    """

    form: MidPlaneArchitecture
    solved_by = "mid-plane"

    def __init__(
        self, mechanism: Mechanism, output: Output, form: MidPlaneArchitecture
    ) -> None:
        assert output.direction is not None
        super().__init__(mechanism, output, points=True)
        self.form = form
        self.modes = tuple(product((1, -1), repeat=len(form.legs)))
        self.legs = tuple(
            "leg of " + ", ".join(map(self.name_of, leg)) for leg in form.legs
        )

    @property
    def spans(self) -> tuple[Span, ...]:
        """What limits the reach: the axes of every leg at base and end effector."""
        plane = self.form.plane
        most = (2.0 * plane.reach).tolist()
        return tuple(
            (base, tip, 0.0, most[k], k in plane.driven)
            for k, (base, _, tip) in enumerate(self.form.legs)
        )

    def at(self, poses: Floats, signs: Signs) -> Rows:
        """Return one mode at directions (n, 3)."""
        return _MidPlaneRows(self, poses @ self.form.frame, signs)

    def forward(self, inputs: Floats) -> PoseSolutions:
        """Return the pose at driven readings (n, 2) rad, the other legs in each mode.

        None where the driven elbows lie on one line.
        """
        form, plane = self.form, self.form.plane
        upward = plane.normals(inputs)
        away = -np.sign(upward @ form.home)[:, None]  # from the image of the output
        normals, driven_modes = away * upward, away * plane.modes(inputs)
        every = np.array(self.modes)
        same = driven_modes[:, None] == every[:, plane.driven]
        row, mode = np.nonzero(np.all(same, axis=2))
        values, _ = form.values(form.place(normals[row], every[mode]))
        closed = np.isfinite(values).all(axis=1)
        row, mode, values = row[closed], mode[closed], values[closed]
        turned = form.orientations(normals[row])
        return PoseSolutions(
            row,
            inputs[row],
            values,
            turned,
            turned @ np.array(self.output.direction),
            tuple(self.modes[number] for number in mode),
            np.ones(len(inputs), dtype=bool),
        )


class _MidPlaneRows:
    def __init__(self, owner: MidPlaneKinematics, points: Floats, signs: Signs) -> None:
        self.form, self.signs, self.points = owner.form, signs, points
        self.driven = owner.form.plane.driven
        self.normals, self.distance = self.form.normals_to(points)

    def cosine(self, one: int, other: int) -> Floats:
        elbows = self._elbows[0]
        axes = (self.form.axis(pair, self.normals, elbows) for pair in (one, other))
        return np.broadcast_to(np.vecdot(*axes), len(self.points))

    def angle(self, pair: int) -> Floats:
        ends, joint = self.form.mechanism.ends[pair], revolute(self.form.joints[pair])
        placed = self.form.place(self.normals, self.signs, links=ends)
        return turns_of([ends], [joint], placed)[0][:, 0]

    @property
    def inputs(self) -> Floats:
        return self.form.plane.readings(self._elbows[0])[:, self.driven]

    @property
    def type_1(self) -> Floats:
        return self._moved[1]

    @property
    def rates(self) -> Floats:
        return self._moved[0]

    @cached_property
    def _moved(self) -> tuple[Floats, Floats]:
        elbows, root = self._elbows
        across = cross(elbows[:, self.driven], self.points[:, None]) @ self.form.frame.T
        senses = self.form.plane.senses[self.driven]
        bottoms = root[:, self.driven] * self.distance[:, None]
        return input_rates(across * senses[:, None], bottoms)

    @property
    def type_1_square(self) -> Floats:
        square = self.type_1**2
        flat, _, left = self.form.plane.nearest_elbows(self.normals)
        across = cross(self.points[:, None], flat[:, self.driven])
        beyond = left[:, self.driven] / np.vecdot(across, across)
        beyond = np.fmin(beyond * (self.distance**2)[:, None], 0.0)
        return np.where(np.isnan(square), beyond, square)

    @property
    def type_2(self) -> Floats:
        return self.form.transmission(self.normals, self._elbows[0])

    @cached_property
    def _elbows(self) -> tuple[Floats, Floats]:
        return self.form.plane.elbows(self.normals, self.signs)


class DyadKinematics(ClosedKinematics):
    """An output whose mechanism falls into dyads when it is held."""

    solved_by = "dyads"

    def __init__(self, kinematics: InverseKinematics) -> None:
        wrist = kinematics.wrist
        assert kinematics.dyads is not None
        super().__init__(kinematics.own, wrist.output, wrist.points)
        self.kinematics, self.modes = kinematics, kinematics.modes
        self.stands = kinematics.dyads.stands
        self.legs = tuple(
            "leg of "
            + ", ".join(
                self.name_of(self._own(pair))
                for pair in (stand.near, stand.middle, stand.far)
            )
            for stand in self.stands
        )

    def _own(self, made: int) -> int:
        """Return a pair, or for one made on the output link that with its axis there."""
        solver, wrist = self.kinematics.solver, self.kinematics.wrist
        axis = partial(axis_in, solver.mechanism, solver.joints, link=wrist.link)
        if made == wrist.pairs[-1]:
            for pair, ends in enumerate(self.mechanism.ends):
                if wrist.link in ends and arc(axis(pair), axis(made)) < COLLINEAR:
                    return pair
        return made

    @property
    def spans(self) -> tuple[Span, ...]:
        """What limits the reach: the outer axes of every dyad."""
        return tuple(
            (self._own(x.near), self._own(x.far), x.shortest, x.longest, True)
            for x in self.stands
        )

    def at(self, poses: Floats, signs: Signs) -> Rows:
        """Return one mode at poses."""
        return self.kinematics.posed(poses, signs)


class GearedKinematics(ClosedKinematics):
    """An output of a mechanism whose wheels only turn what carries it.

    `carriers` are pairs that say the inputs q: their angles are ratios q + offset, by their
    numbers; `rates` (inputs, carriers) those of the inputs by these angles.
    """

    solved_by = "dyads"

    def __init__(
        self,
        mechanism: Mechanism,
        output: Output,
        carried: DyadKinematics,
        train: GearTrain,
        carriers: Mapping[int, tuple[Floats, float]],
    ) -> None:
        super().__init__(mechanism, output, carried.points)
        self.carried, self.train, self.carriers = carried, train, tuple(carriers)
        ratios, offsets = zip(*carriers.values(), strict=True)
        self.offsets, self.rates = np.array(offsets), np.linalg.inv(np.array(ratios))
        self.modes, self.legs = carried.modes, carried.legs
        self.number = {
            mechanism.pair_number[pair.name]: k
            for k, pair in enumerate(carried.mechanism.pairs)
        }

    @property
    def carrying(self) -> Mechanism:
        """What the wheels turn."""
        return self.carried.mechanism

    @property
    def spans(self) -> tuple[Span, ...]:
        """What limits the reach of what carries the output."""
        return self.carried.spans

    def at(self, poses: Floats, signs: Signs) -> Rows:
        """Return one mode at poses."""
        return _GearedRows(self, self.carried.at(poses, signs))


class _GearedRows:
    def __init__(self, owner: GearedKinematics, rows: Rows) -> None:
        self.owner, self.rows = owner, rows

    def cosine(self, one: int, other: int) -> Floats:
        return self.rows.cosine(one, other)

    def angle(self, pair: int) -> Floats:
        return self._values[:, pair]

    @cached_property
    def inputs(self) -> Floats:
        """(n, inputs) rad, known to turns of the carriers: those least in sum."""
        owner = self.owner
        angles = [self.rows.angle(owner.number[pair]) for pair in owner.carriers]
        least = wrap(np.stack(angles, axis=1) - owner.offsets)
        turns = TURN * np.array(list(product((0.0, -1.0, 1.0), repeat=least.shape[1])))
        every = (least[:, None] + turns) @ owner.rates.T
        best = np.argmin(np.round(np.sum(np.abs(every), axis=2), 9), axis=1)
        return every[np.arange(len(every)), best]

    @cached_property
    def _values(self) -> Floats:
        """(n, pairs) variables of all pairs, those of R pairs in (-pi, pi]."""
        owner, train = self.owner, self.owner.train
        values = np.empty((len(self.inputs), len(owner.mechanism.pairs)))
        values[:, driven_pairs(owner.mechanism)] = wrap(self.inputs)
        values[:, train.followers] = wrap(self.inputs @ train.ratios.T + train.offsets)
        values[:, train.contacts] = self.inputs @ train.length_ratios.T + train.lengths
        for pair, k in owner.number.items():
            values[:, pair] = self.rows.angle(k)
        return values

    @cached_property
    def rates(self) -> Floats:
        return self.owner.rates @ self.rows.rates

    @property
    def type_1(self) -> Floats:
        return 1.0 / np.linalg.norm(self.rates, axis=2)

    @property
    def type_1_square(self) -> Floats:
        square, weights = self.type_1**2, self.owner.rates**2
        beyond = self.rows.type_1_square[:, None] / weights
        beyond = np.min(beyond, axis=2, where=weights > 0.0, initial=0.0)
        return np.where(np.isnan(square), beyond, square)

    @property
    def type_2(self) -> Floats:
        return self.owner.type_2(self._values)


def geared(mechanism: Mechanism, output: Output) -> GearedKinematics | None:
    """Return the closed form of an output that wheels turn, None if it has none.

    What is left without the wheels has to be dyads on the output, driven at pairs whose
    angles follow from the inputs by the ratios of the wheels.
    """
    driven = list(driven_pairs(mechanism))
    train = wheel_train(mechanism, driven)
    turning = set(map(mechanism.pair_number.__getitem__, mechanism.angles))
    if train is None or len(turning) + len(train.contacts) < len(mechanism.pairs):
        return None
    kept = _carrying(mechanism, output, turning)
    stopped = {mechanism.pair_number[stop.pair] for stop in mechanism.joint_limits}
    carriers = _carriers(train, driven, kept)
    if carriers is None or not stopped <= kept:
        return None
    inputs = (Input(mechanism.pairs[pair].name, 0.0, TURN) for pair in carriers)
    try:
        part = of_pairs(replace(mechanism, inputs=tuple(inputs), modes={}), kept)
        inverse = InverseKinematics(part, output.name)
    except SpherekitError:
        return None
    if not inverse.has_closed_form:
        return None
    return GearedKinematics(mechanism, output, DyadKinematics(inverse), train, carriers)


def _carrying(mechanism: Mechanism, output: Output, pairs: set[int]) -> set[int]:
    """Return the pairs that are left where links that only hang on others are dropped."""
    number, kept = mechanism.link_number, set(pairs)
    held = {0, number[output.link], number[output.relative_to]}
    while True:
        ends = [link for pair in kept for link in mechanism.ends[pair]]
        loose = {link for link in ends if ends.count(link) == 1} - held
        if not loose:
            return kept
        kept = {pair for pair in kept if not loose & set(mechanism.ends[pair])}


def _carriers(
    train: GearTrain, driven: list[int], kept: set[int]
) -> dict[int, tuple[Floats, float]] | None:
    """Return as many of the pairs kept as there are inputs, with ratios and offset."""
    rows = {pair: (np.eye(len(driven))[k], 0.0) for k, pair in enumerate(driven)}
    every = zip(train.followers, train.ratios, train.offsets, strict=True)
    rows |= {pair: (ratios, float(offset)) for pair, ratios, offset in every}
    chosen: list[int] = []
    for pair in sorted(kept & set(rows)):
        tried = np.array([rows[item][0] for item in (*chosen, pair)])
        if np.linalg.matrix_rank(tried) == len(tried):
            chosen.append(pair)
    return {pair: rows[pair] for pair in chosen} if len(chosen) == len(driven) else None


def output_kinematics(
    mechanism: Mechanism, output: str | None = None, graph: bool = False
) -> OutputKinematics:
    """Return what solves the poses of an output.

    Parameters
    ----------
    mechanism, output
        The mechanism, and the name of its output if there are several.
    graph
        Whether to solve the graph of all links, though there is a mid-plane symmetric
        architecture.

    Raises
    ------
    ModelError, PlanError
        If the output is unknown, or cannot take every pose.
    """
    if len(mechanism.inputs) not in COORDINATES:
        return OutputKinematics(mechanism, chosen_output(mechanism, output), points=False)
    inverse = InverseKinematics(mechanism, output)
    if inverse.has_closed_form or not graph:
        try:
            return _closed_form_of(inverse)
        except SolveError:
            pass
    return GraphKinematics(inverse)


def closed_kinematics(mechanism: Mechanism, output: str | None = None) -> ClosedKinematics:
    """Return the closed form of an output.

    Raises
    ------
    ModelError, PlanError
        If the output is unknown or cannot take every pose.
    SolveError
        If there is no closed form that needs no start.
    """
    return _closed_form_of(InverseKinematics(mechanism, output))


def _closed_form_of(inverse: InverseKinematics) -> ClosedKinematics:
    if inverse.has_closed_form:
        return DyadKinematics(inverse)
    output = inverse.wrist.output
    turned = geared(inverse.own, output)
    if turned is not None:
        return turned
    try:
        form = mid_plane_form(inverse.own, output.name)
    except ModelError as problem:
        raise inverse.no_closed_form(
            f"dyads on the output alone would do. And {problem}"
        ) from None
    return MidPlaneKinematics(inverse.own, output, form)


class GraphKinematics(OutputKinematics):
    """An output whose poses are solved on the graph of all links, row by row."""

    def __init__(self, inverse: InverseKinematics) -> None:
        super().__init__(inverse.own, inverse.wrist.output, inverse.wrist.points)
        self.kinematics, self.modes, self.legs = inverse, inverse.modes, inverse.legs
        try:
            self.form = mid_plane_form(self.mechanism, self.output.name)
        except ModelError:
            self.form = None

    def inverse(
        self, poses: Floats, modes: Sequence[str], pairs: Sequence[int] = ()
    ) -> InverseRows:
        """Return a row for each configuration found, or one that says there is none."""
        solutions = self.kinematics.solutions(poses)
        labels = np.array([*map(label_of, solutions.signs), ""])
        kept = np.flatnonzero(np.isin(labels[:-1], modes))
        none = np.setdiff1d(np.arange(len(poses)), solutions.row[kept])
        at = np.append(kept, np.full(len(none), -1))
        seen = at >= 0

        def filled(array: Floats) -> Floats:
            return np.concatenate([array, nans((1, *array.shape[1:]))])[at]

        values = filled(solutions.values)
        turns = nans((len(values), 3, len(self.mechanism.inputs)))
        turns[seen] = self.turns(values[seen])
        directions = None
        if self.points and solutions.directions is not None:
            directions = filled(solutions.directions)
        rates, type_1 = rates_of_turns(turns, directions)
        owners = self.mechanism.variable_owners
        rows = InverseRows(
            np.append(solutions.row[kept], none),
            labels[at],
            filled(solutions.inputs),
            np.zeros(len(at), dtype=np.int8),
            np.where(seen, np.nan, -np.inf),
            np.full(len(at), -1),
            type_1,
            self.type_2(values),
            rates,
            values[:, [*map(owners.index, pairs)]],
            (),
        )
        return InverseRows.joined([rows.judged()])
