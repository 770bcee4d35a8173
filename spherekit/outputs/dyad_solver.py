"""Closed forms of outputs that fall into dyads when held, driven directly or by wheels."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property, partial
from itertools import product

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.errors import SpherekitError
from spherekit.geometry.triangle import arc
from spherekit.mechanism.elements import Input, Output
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE
from spherekit.numerics.angles import wrap
from spherekit.outputs.dyad_chain import Signs
from spherekit.outputs.inverse_kinematics import InverseKinematics
from spherekit.outputs.mid_plane_architecture import axis_in
from spherekit.outputs.pose_constraints import ClosedKinematics, Rows, Span
from spherekit.planning.assembly_plan import driven_pairs
from spherekit.planning.submechanism import of_pairs
from spherekit.planning.wheel_train import GearTrain, wheel_train


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
                if wrist.link in ends and arc(axis(pair), axis(made)) < COLLINEAR_SINE:
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
