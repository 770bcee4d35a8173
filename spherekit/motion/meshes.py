"""How far wheels have rolled at an input, which is a place on the line, not on the circle.

Two wheels put together one turn further on close the loops as well, and stand differently.
Which of these assemblies a file means is said at one value of the inputs, the anchor: that
of the reference pose, or zero, where the wheels have rolled least. From there the lengths
rolled go on with the inputs over any number of turns. Where a train of wheels leads from
the inputs to a contact, its length is a linear function of them, known also where the
rest of the mechanism does not close.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice, product
from math import lcm
from typing import final

import numpy as np

from spherekit.conventions import CLOSURE_TOLERANCE, TURN
from spherekit.model.graph import spanning
from spherekit.model.joints import MOST_TEETH, Joint
from spherekit.motion.arc_length import periods_of
from spherekit.motion.closure import Closure
from spherekit.motion.distinct import Distinct
from spherekit.motion.locked import Locked, lock
from spherekit.motion.loops import LoopTree
from spherekit.motion.pairs import rolled_lengths
from spherekit.motion.search import search
from spherekit.motion.steps import nodes_at, walk
from spherekit.motion.turns import whole_laps
from spherekit.planning.wheel_train import WheelTrain
from spherekit.planning.wheels import SAME_LENGTH
from spherekit.sphere.rotation import Floats
from spherekit.sphere.triangle import Bools

TRIED = (0.0, 1.0, -1.0, 2.0, -2.0, 0.5, -0.5, 1.5, -1.5, 2.5, -2.5, 3.1)
"""Inputs (rad) at which a configuration is looked for, from the anchor."""
WAYS = 8
"""Straight ways of the inputs along which rates are compared."""
LONGEST_WAY = 1.0
"""The longest of them (rad)."""
CONSTANT = 1e-9
"""Rates that differ by less, relative, are the same everywhere."""
SPREAD = 1e-3
"""Inputs (rad) that compared rates lie apart at least."""
FLAT = 1e-5
"""Configurations of a smaller relative singular value say nothing precise of rates."""
SAME_RATIO = 1e-9
"""Laps in a turn of an input that differ by less are the same."""
MOST_CHOICES, MOST_SORTED, MOST_ASSEMBLIES = 8, 4096, 64
"""Lengths of one contact, assemblies of all, and the least rolled of those, to be tried."""
MOST_TURNS = 12
"""Whole turns of an input by which a configuration found may have been put together."""
STARTS = 16
"""Starts from which each of them is closed."""


@final
@dataclass(frozen=True)
class Meshes:
    """The rolled lengths that follow from the inputs alone.

    `variables` are their numbers; `lengths` (m,) those at the inputs `anchor` (k,), rad;
    `ratios` (m, k) their rates by the inputs. `all_known` says that no other contact
    rolls. `periods` (k,) is the growth of each input with which the same assembly
    returns, infinite if there is none, and NaN where no length follows from the inputs, so
    that a curve itself says when it returns (`ArcCurve.returns_after`).
    """

    variables: tuple[int, ...]
    anchor: Floats
    lengths: Floats
    ratios: Floats
    periods: Floats
    all_known: bool

    def at(self, q: Floats) -> dict[int, float]:
        """Return the lengths (rad) by the numbers of their variables at inputs q (k,)."""
        lengths = self.rolled(q[None])[0]
        return dict(zip(self.variables, map(float, lengths), strict=True))

    def rolled(self, q: Floats) -> Floats:
        """Return the lengths (n, m), rad, at inputs q (n, k)."""
        return np.asarray(self.lengths + (q - self.anchor) @ self.ratios.T)

    def modes(self, closure: Closure, driven: Sequence[int], q: Floats) -> list[Floats]:
        """Return the closed configurations (variables,) found at inputs q (k,)."""
        far, q = q, q - whole_laps(q - self.anchor, self.periods)
        held = dict(zip(driven, map(float, q), strict=True)) | self.at(q)
        locked = _lock_all(closure, held)
        values = np.zeros((1, 0))
        if locked.kept:
            distinct = Distinct(locked.closure)
            search(locked.closure, distinct)
            values = np.array(distinct.values).reshape(-1, len(locked.kept))
        whole = locked.whole(values)
        gap = closure.at(whole).gap
        return [
            self.moved(configuration, driven, far)
            for configuration in whole[gap < CLOSURE_TOLERANCE]
        ]

    def moved(self, values: Floats, driven: Sequence[int], q: Floats) -> Floats:
        """Return the same configuration (variables,) at inputs nearest to q (k,).

        The inputs grow by whole periods.
        """
        values, held = values.copy(), list(driven)
        grown = whole_laps(q - values[held], self.periods)
        values[held] += grown
        values[list(self.variables)] += self.ratios @ grown
        return values


def _lock_all(closure: Closure, held: dict[int, float]) -> Locked:
    """Return a closure with pairs locked, and the R pairs that can then move no more."""
    locked = lock(closure, held)
    tree, joints = locked.closure.tree, locked.closure.joints
    states = locked.closure.at(np.zeros((1, len(locked.kept)))).states
    fixed = {}
    for pair, (one, other) in enumerate(tree.ends):
        if one == other and joints[pair].has_axis:
            turn = states.first[0, pair].T @ states.second[0, pair]
            variable = locked.kept[tree.owners.index(pair)]
            fixed[variable] = float(np.arctan2(turn[1, 0], turn[0, 0]))
    return lock(closure, held | fixed) if fixed else locked


def meshes_of(
    closure: Closure,
    driven: Sequence[int],
    reference: Floats | None,
    train: WheelTrain | None,
) -> Meshes | None:
    """Return what is known of the lengths rolled, None where no contact rolls.

    `driven` are the variables of the inputs, `reference` (variables,) those of a reference
    pose. Without a `train` of wheels on carriers the lengths are those whose rates are
    seen to be the same everywhere.
    """
    rolling = [variable for variable, _ in rolled_lengths(closure.joints)]
    if not rolling:
        return None
    anchor = np.zeros(len(driven)) if reference is None else reference[list(driven)]
    if train is not None:
        lengths = train.lengths + train.length_ratios @ anchor
        periods = _periods(closure, rolling, train.length_ratios)
        return Meshes(tuple(rolling), anchor, lengths, train.length_ratios, periods, True)
    for values in _configurations(closure, driven, reference):
        rates = _constant_rates(closure, driven, values)
        if rates is None:
            continue
        determined = [
            variable for variable in rolling if np.all(np.isfinite(rates[variable]))
        ]
        ratios = rates[determined]
        if reference is not None:
            lengths = reference[determined]
        else:
            lengths = _least_rolled(closure, driven, values, rates, determined)
        all_known = len(determined) == len(rolling)
        periods = np.full(len(driven), np.inf if determined else np.nan)
        if all_known:
            periods = _periods(closure, determined, ratios)
        return Meshes(tuple(determined), anchor, lengths, ratios, periods, all_known)
    none = np.zeros((0, len(driven)))
    return Meshes((), anchor, none[:, 0], none, np.full(len(driven), np.nan), False)


def _configurations(
    closure: Closure, driven: Sequence[int], reference: Floats | None
) -> Iterator[Floats]:
    """Yield closed configurations (variables,), the wheels put together anyhow."""
    if reference is not None:
        yield closure.solve(reference[None], driven).values[0]
        return
    for place in TRIED:
        # no direction of several inputs is a special one
        q = place * (1.0 + 0.37 * np.arange(len(driven)))
        locked = lock(closure, dict(zip(driven, map(float, q), strict=True)))
        distinct = Distinct(locked.closure)
        search(locked.closure, distinct)
        yield from locked.whole(np.array(distinct.values).reshape(-1, len(locked.kept)))


def _constant_rates(
    closure: Closure, driven: Sequence[int], values: Floats
) -> Floats | None:
    """Return the rates (variables, k) by the inputs that are the same everywhere.

    Those of other variables are NaN; None where the configuration does not move.
    """
    random = np.random.default_rng(20240616)
    count = len(driven)
    ways = random.normal(size=(WAYS, count))
    ways *= (LONGEST_WAY * (1.0 - np.arange(WAYS) / WAYS) / np.linalg.norm(ways, axis=1))[
        :, None
    ]
    start = np.repeat(values[None], WAYS, axis=0)
    goal = start[:, list(driven)] + ways
    with np.errstate(all="ignore"):
        there, _ = walk(closure, driven, start, goal)
        every = np.concatenate([values[None], there])
        at, slopes = closure.at(every), []
        for direction in np.eye(count):
            nodes = nodes_at(at, driven, np.repeat(direction[None], len(every), axis=0))
            slopes.append(nodes.slope)
    rates = np.stack(slopes, axis=-1)
    good = np.all(np.isfinite(rates), axis=(1, 2)) & (nodes.reciprocal_condition > FLAT)
    apart = (
        np.ptp(every[good][:, list(driven)], axis=0) if np.any(good) else np.zeros(count)
    )
    if not np.all(apart > SPREAD):
        return None
    rates = rates[good]
    size = 1.0 + np.max(np.abs(rates[0]), axis=1)
    constant = np.max(np.ptp(rates, axis=0), axis=1) < CONSTANT * size
    best = rates[np.argmax(nodes.reciprocal_condition[good])]
    return np.where(constant[:, None], best, np.nan)


def _least_rolled(
    closure: Closure,
    driven: Sequence[int],
    values: Floats,
    rates: Floats,
    determined: list[int],
) -> Floats:
    """Return the lengths (m,) at inputs of zero in which a train has rolled least.

    Of those that have rolled as far, the one with the greatest first length.
    """
    grown = rates[determined] @ values[list(driven)]
    joints = [closure.joints[closure.tree.owners[variable]] for variable in determined]
    tried = []
    for turns in product(range(-MOST_TURNS, MOST_TURNS + 1), np.eye(len(driven))):
        least = values[determined] - grown - TURN * turns[0] * rates[determined] @ turns[1]
        choices = map(whole_turns_apart, joints, map(float, least))
        tried += list(islice(product(*choices), MOST_SORTED))
    lengths = np.array(sorted(tried, key=_rolled)[:MOST_ASSEMBLIES])
    closes = np.ones(len(lengths), dtype=bool)
    for train in _trains(closure, rates):
        closes &= train.closes(values, driven, determined, lengths + grown)
    return np.asarray(
        lengths[np.argmax(closes)] if np.any(closes) else values[determined] - grown
    )


def _rolled(lengths: Sequence[float]) -> tuple[int, ...]:
    """Return a key that puts assemblies in order, whatever rounding does."""
    return (
        round(sum(map(abs, lengths)) / SAME_LENGTH),
        *(-round(length / SAME_LENGTH) for length in lengths),
    )


def whole_turns_apart(joint: Joint, length: float) -> list[float]:
    """Return lengths that differ from one by whole turns of a wheel, the least first."""
    lengths = {round(length / SAME_LENGTH): length}
    for lap in joint.laps:
        least = length - lap * round(length / lap)
        most = int(np.ceil(0.5 * max(joint.laps) / lap))
        for turns in range(-most, most + 1):
            lengths[round((least + turns * lap) / SAME_LENGTH)] = least + turns * lap
    return sorted(lengths.values(), key=abs)[:MOST_CHOICES]


@final
@dataclass(frozen=True)
class _Train:
    """Bodies joined by pairs whose variables follow the inputs linearly.

    `variables` are the numbers that those of its closure have in the whole mechanism.
    """

    closure: Closure
    variables: tuple[int, ...]

    def closes(
        self, values: Floats, driven: Sequence[int], determined: list[int], lengths: Floats
    ) -> Bools:
        """Return (n,) whether the train closes with lengths (n, m) of the `determined`."""
        held = [k for k, v in enumerate(self.variables) if v in determined or v in driven]
        n = len(lengths)
        whole = np.repeat(values[None], n, axis=0)
        whole[:, determined] = lengths
        start = np.repeat(whole[:, list(self.variables)], STARTS, axis=0)
        random = np.random.default_rng(20240616)
        moved = [k for k in range(len(self.variables)) if k not in held]
        start[:, moved] += random.uniform(-np.pi, np.pi, (len(start), len(moved)))
        start[::STARTS, moved] = values[[self.variables[k] for k in moved]]
        residual = self.closure.solve(start, held, iterations=30).residual
        return np.asarray(np.any(residual.reshape(n, STARTS) < CLOSURE_TOLERANCE, axis=1))


def _trains(closure: Closure, rates: Floats) -> Iterator[_Train]:
    """Yield the connected parts of a mechanism whose pairs have constant rates."""
    tree = closure.tree
    linear = np.all(np.isfinite(rates), axis=1)
    of_pair = {
        pair: [v for v, p in enumerate(tree.owners) if p == pair] for pair in tree.owners
    }
    pairs = [pair for pair, variables in of_pair.items() if np.all(linear[variables])]
    left = set(pairs)
    while left:
        first = tree.ends[min(left)][0]
        ways = spanning(tree.ends, (first,), left)
        bodies = {first, *(body for _, _, body in ways)}
        part = {pair for pair in left if tree.ends[pair][0] in bodies}
        left -= part
        number = {body: k for k, body in enumerate(sorted(bodies))}
        members = sorted(part)
        yield _Train(
            Closure(
                LoopTree(
                    len(number),
                    tuple(
                        (number[a], number[b]) for a, b in (tree.ends[p] for p in members)
                    ),
                    tuple(k for k, pair in enumerate(members) for _ in of_pair[pair]),
                ),
                tuple(closure.joints[pair] for pair in members),
            ),
            tuple(v for pair in members for v in of_pair[pair]),
        )


def _periods(closure: Closure, determined: list[int], ratios: Floats) -> Floats:
    """Return the growth (inputs,) of inputs, rad, with which all wheels return.

    It is in whole turns.
    """
    laps = periods_of(closure)[determined]
    return np.array([_period(laps, ratio) for ratio in ratios.T])


def _period(laps: Floats, ratios: Floats) -> float:
    turns = 1
    if np.any(np.isinf(laps) & (np.abs(ratios) > SAME_RATIO)):
        return float(np.inf)
    for passed in TURN * ratios / laps:
        whole = Fraction(float(passed)).limit_denominator(MOST_TEETH)
        if abs(float(whole) - passed) > SAME_RATIO:
            return float(np.inf)
        turns = lcm(turns, whole.denominator)
    return TURN * turns
