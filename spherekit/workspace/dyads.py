"""Closed forms of outputs that fall into dyads when held, driven directly or by wheels."""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import final

import numpy as np

from spherekit.conventions import TURN
from spherekit.errors import AnalysisError, SpherekitError
from spherekit.guidance.mid_plane_architecture import axis_in
from spherekit.model.geometry import COLLINEAR
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Input, Output
from spherekit.numeric.turns import wrap
from spherekit.output.dyads import Signs
from spherekit.output.inverse import InverseKinematics
from spherekit.planning.inputs import driven_pairs
from spherekit.planning.part import of_pairs
from spherekit.planning.wheels import WheelTrain, wheel_train
from spherekit.sphere.rotation import Floats
from spherekit.workspace.kinematics import ClosedKinematics
from spherekit.workspace.rows import Rows, Span


@final
class DyadKinematics(ClosedKinematics):
    """An output whose mechanism falls into dyads when it is held."""

    solved_by = "dyads"

    def __init__(self, kinematics: InverseKinematics) -> None:
        wrist = kinematics.wrist
        super().__init__(kinematics.own, wrist.output, wrist.points)
        self.kinematics, self.modes = kinematics, kinematics.modes
        self._own = {pair: self._same_axis(pair) for pair in wrist.pairs}
        self.legs = tuple(
            "leg of "
            + ", ".join(
                self.name_of(self._own.get(pair, pair))
                for pair in (stand.near, stand.middle, stand.far)
            )
            for stand in kinematics.stands
        )

    def _same_axis(self, made: int) -> int:
        """Return the mechanism's own pair with the axis of one made for the output."""
        mechanism, joints = self.kinematics.mechanism, self.kinematics.solver.joints
        link = self.kinematics.wrist.link
        if link in mechanism.ends[made]:
            axis = axis_in(mechanism, joints, made, link)
            for pair, ends in enumerate(self.mechanism.ends):
                if link in ends:
                    gap = axis_in(mechanism, joints, pair, link) - axis
                    if np.linalg.norm(gap) < COLLINEAR:
                        return pair
        return made

    @property
    def spans(self) -> tuple[Span, ...]:
        """What limits the reach: the outer axes of every dyad."""
        renamed = self._own
        return tuple(
            Span(renamed.get(s.near, s.near), renamed.get(s.far, s.far), s.cones, True)
            for s in self.kinematics.stands
        )

    def at(self, poses: Floats, signs: Signs) -> Rows:
        """Return one mode at poses."""
        return self.kinematics.posed(poses, signs)


@final
@dataclass(frozen=True)
class _Carriers:
    """Pairs whose angles are linear in the inputs and say them: ratios q + offsets."""

    pairs: tuple[int, ...]
    ratios: Floats
    offsets: Floats

    @cached_property
    def inverse(self) -> Floats:
        """(inputs, carriers) rates of the inputs by the carriers."""
        return np.asarray(np.linalg.inv(self.ratios))

    def inputs(self, angles: Floats) -> Floats:
        """Return the inputs (n, k) at angles (n, k) of the carriers, known to turns.

        Of the turns those at which the inputs are least in sum.
        """
        least = wrap(angles - self.offsets)
        turns = TURN * np.array(list(product((0.0, -1.0, 1.0), repeat=least.shape[1])))
        every = (least[:, None] + turns) @ self.inverse.T
        best = np.argmin(np.round(np.sum(np.abs(every), axis=2), 9), axis=1)
        return np.asarray(every[np.arange(len(every)), best])


@final
class GearedKinematics(ClosedKinematics):
    """An output of a mechanism whose wheels only turn what carries it."""

    solved_by = "dyads"

    def __init__(
        self,
        mechanism: Mechanism,
        output: Output,
        carried: DyadKinematics,
        train: WheelTrain,
        carriers: _Carriers,
    ) -> None:
        super().__init__(mechanism, output, carried.points)
        self.carried, self.train, self.carriers = carried, train, carriers
        self.modes, self.legs = carried.modes, carried.legs
        pairs = enumerate(carried.mechanism.pairs)
        self.number = {mechanism.pair_number[pair.name]: k for k, pair in pairs}
        self.wheels = frozenset(range(len(mechanism.pairs))) - set(self.number)

    @property
    def spans(self) -> tuple[Span, ...]:
        """What limits the reach of what carries the output."""
        numbers = {k: pair for pair, k in self.number.items()}
        more = len(self.mechanism.pairs) - len(numbers)
        spans = self.carried.spans
        ends = {k: numbers.get(k, k + more) for s in spans for k in (s.one, s.other)}
        return tuple(replace(s, one=ends[s.one], other=ends[s.other]) for s in spans)

    def at(self, poses: Floats, signs: Signs) -> Rows:
        """Return one mode at poses."""
        return _GearedRows(self, self.carried.at(poses, signs))


@final
class _GearedRows:
    def __init__(self, owner: GearedKinematics, rows: Rows) -> None:
        self.owner, self.rows = owner, rows

    def cosine(self, one: int, other: int) -> Floats:
        return self.rows.cosine(self._number(one), self._number(other))

    def _number(self, pair: int) -> int:
        owner = self.owner
        if pair in owner.wheels:
            raise AnalysisError(
                f"{owner.mechanism.name}: {owner.name_of(pair)} is the pair of a wheel, "
                "which does not carry the output; take the axis of a pair that does"
            )
        return owner.number.get(pair, pair - len(owner.wheels))

    def angle(self, pair: int) -> Floats:
        return self._values[:, pair]

    @cached_property
    def inputs(self) -> Floats:
        pairs = self.owner.carriers.pairs
        angles = [self.rows.angle(self.owner.number[pair]) for pair in pairs]
        return self.owner.carriers.inputs(np.stack(angles, axis=1))

    @cached_property
    def _values(self) -> Floats:
        """(n, pairs) variables of all pairs, those of R pairs in (-pi, pi]."""
        owner, train = self.owner, self.owner.train
        values = np.empty((len(self.inputs), len(owner.mechanism.pairs)))
        values[:, list(driven_pairs(owner.mechanism))] = wrap(self.inputs)
        values[:, train.followers] = wrap(self.inputs @ train.ratios.T + train.offsets)
        values[:, train.contacts] = self.inputs @ train.length_ratios.T + train.lengths
        for pair, k in owner.number.items():
            values[:, pair] = self.rows.angle(k)
        return values

    @cached_property
    def rates(self) -> Floats:
        return self.owner.carriers.inverse @ self.rows.rates

    @property
    def type_1(self) -> Floats:
        return np.asarray(1.0 / np.linalg.norm(self.rates, axis=2))

    @property
    def type_1_square(self) -> Floats:
        square = self.type_1**2
        weights = self.owner.carriers.inverse[None] ** 2
        beyond = np.min(self.rows.type_1_square[:, None] / weights, axis=2)
        return np.where(np.isnan(square), np.fmin(beyond, 0.0), square)

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
    stopped = {mechanism.pair_number[stop.pair] for stop in mechanism.stops}
    carriers = _carriers(train, driven, kept)
    if carriers is None or not stopped <= kept:
        return None
    inputs = (Input(mechanism.pairs[pair].name, 0.0, TURN) for pair in carriers.pairs)
    try:
        part = of_pairs(replace(mechanism, inputs=tuple(inputs), modes=()), kept)
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


def _carriers(train: WheelTrain, driven: list[int], kept: set[int]) -> _Carriers | None:
    """Return as many of the pairs kept as there are inputs, which say these."""
    rows = {pair: (np.eye(len(driven))[k], 0.0) for k, pair in enumerate(driven)}
    every = zip(train.followers, train.ratios, train.offsets, strict=True)
    rows |= {pair: (ratios, float(offset)) for pair, ratios, offset in every}
    chosen: list[int] = []
    for pair in sorted(kept & set(rows)):
        tried = np.array([rows[item][0] for item in (*chosen, pair)])
        if np.linalg.matrix_rank(tried) == len(tried):
            chosen.append(pair)
    if len(chosen) < len(driven):
        return None
    ratios, offsets = zip(*(rows[pair] for pair in chosen), strict=True)
    return _Carriers(tuple(chosen), np.array(ratios), np.array(offsets))
