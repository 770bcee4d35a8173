"""Wheels whose turning follows from the inputs: rolling circles on common carriers.

Two wheels that one link carries, each about the centre of its circle, roll as far on one
circle as on the other: a linear relation of the angles of the pairs between them. Where
such relations fix all these angles by the inputs, they are linear functions of these, and
the contacts repeat what the carriers say.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import final

import numpy as np

from spherekit.engine.turns import AxisRotation, Chain, TurningPairs
from spherekit.model.geometry import geometry_of
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats, cross

ONE_LINE = 1e-9
"""Axes (rad) that differ by less are one; circles that miss by less touch."""
SAME_LENGTH = 1e-7
"""Lengths (rad) that differ by less are one."""
TURNED = 0.7
"""An angle (rad) by which it is seen how a contact moves on."""
MOST_TURNS = 2
"""Whole turns of wheels that are tried."""
MOST_ASSEMBLIES = 20_000
"""So many assemblies of wheels at most."""
SINGULAR = 1e-9
"""Relations of a smaller relative singular value do not fix the angles."""

TURN = 2.0 * np.pi


@final
@dataclass(frozen=True)
class WheelTrain:
    """The angles of pairs that follow from the inputs through wheels.

    `followers` are the numbers of the pairs; `ratios` (followers, inputs) their rates, and
    `offsets` (followers,) their angles at inputs of zero, rad.
    """

    followers: tuple[int, ...]
    ratios: Floats
    offsets: Floats

    @property
    def numbers(self) -> list[float]:
        """The ratios and the offset of each."""
        both = np.column_stack([self.ratios, self.offsets])
        return [float(number) for number in both.ravel()]


@final
@dataclass(frozen=True)
class _Mesh:
    """A rolling contact: how far it has gone on, by the angles of pairs.

    Along each of two circles by `lengths` (2,) at angles of zero, and by `rates` (2, pairs)
    of the angles; a whole turn is `laps` (2,).
    """

    lengths: Floats
    rates: Floats
    laps: Floats


def wheel_train(
    mechanism: Mechanism,
    pairs: TurningPairs,
    driven: Sequence[int],
    apart: float = ONE_LINE,
) -> WheelTrain | None:
    """Return how wheels follow the inputs, pairs `driven`.

    None if a rolling contact has no common carrier, or the contacts do not fix all the
    angles that they relate. Wheels are put together as the reference pose has them, without
    one so that they have rolled least at inputs of zero. Circles that miss each other by
    less than `apart` (rad) roll where they are nearest, as gears do.
    """
    rolling = [
        number for number, pair in enumerate(mechanism.pairs) if pair.kind.may_repeat
    ]
    meshes = [_mesh(mechanism, pairs, number, apart) for number in rolling]
    if not meshes:
        return None
    made = [mesh for mesh in meshes if mesh is not None]
    if len(made) < len(meshes):
        return None
    rows = np.array([mesh.rates[0] - mesh.rates[1] for mesh in made])
    related = np.any(rows != 0.0, axis=0)
    followers = [int(p) for p in np.flatnonzero(related) if p not in driven]
    if len(followers) != len(made):
        return None
    square = rows[:, followers]
    sizes = np.linalg.svd(square, compute_uv=False)
    if sizes[-1] < SINGULAR * sizes[0]:
        return None
    ratios = -np.linalg.solve(square, rows[:, list(driven)])
    reference = geometry_of(mechanism).reference
    if reference is not None:
        angles = [mechanism.variables_of(p)[0] for p in followers]
        inputs = [mechanism.variables_of(p)[0] for p in driven]
        offsets = reference[angles] - ratios @ reference[inputs]
        return WheelTrain(tuple(followers), ratios, offsets)
    put = _least_rolled(made, followers, square)
    return None if put is None else WheelTrain(tuple(followers), ratios, put)


def _mesh(
    mechanism: Mechanism, pairs: TurningPairs, number: int, apart: float
) -> _Mesh | None:
    """Return what a contact says of pairs; None unless a link carries its wheels."""
    chain = pairs.chains[number]
    turns = [turn for turn in chain.turns if isinstance(turn, AxisRotation)]
    way = _way(mechanism, pairs, number)
    if way is None or len(turns) != 2:
        return None
    start = _rolled(chain, _between(pairs, way, {}), apart)
    if start is None:
        return None
    rates = np.zeros((2, len(mechanism.pairs)))
    for pair, _ in way:
        there = _rolled(chain, _between(pairs, way, {pair: TURNED}), apart)
        if there is None:
            return None
        moved = there - start
        # A wheel turns by the angle, or the other way, or not at all.
        rates[:, pair] = np.round((moved - TURN * np.round(moved / TURN)) / TURNED)
    scale = np.array([turn.scale for turn in turns])
    lengths = (start - np.array([turn.offset for turn in turns])) / scale
    return _Mesh(lengths, rates / scale[:, None], TURN / scale)


Way = tuple[tuple[int, bool], ...]
"""Pairs, and whether they are passed from the first link to the second."""


def _way(mechanism: Mechanism, pairs: TurningPairs, number: int) -> Way | None:
    """Return the shortest way between wheels, through a link that carries both."""
    first, second = mechanism.ends[number]
    chain = pairs.chains[number]
    centres = chain.constants[0][:, 2], chain.constants[2][2]
    one, other = (
        _turning(mechanism, pairs, link, np.asarray(centre, dtype=float))
        for link, centre in zip((first, second), centres, strict=True)
    )
    shared = sorted(set(one) & set(other), key=lambda k: len(one[k]) + len(other[k]))
    if not shared:
        return None
    back = tuple((pair, not ahead) for pair, ahead in reversed(other[shared[0]]))
    return one[shared[0]] + back


def _turning(
    mechanism: Mechanism, pairs: TurningPairs, wheel: int, centre: Floats
) -> dict[int, Way]:
    """Return the ways to links relative to which a wheel turns about its centre only."""
    lines, ways, waiting = {wheel: centre}, {wheel: Way()}, [wheel]
    while waiting:
        link = waiting.pop(0)
        for pair, ends in enumerate(mechanism.ends):
            if link not in ends or not mechanism.pairs[pair].kind.has_axis:
                continue
            ahead = ends[0] == link
            further = ends[1] if ahead else ends[0]
            constants = pairs.chains[pair].constants
            axes = [
                np.asarray(axis, dtype=float)
                for axis in (constants[0][:, 2], constants[1][2])
            ]
            here, there = axes if ahead else axes[::-1]
            if further in ways or np.linalg.norm(cross(here, lines[link])) > ONE_LINE:
                continue
            lines[further] = there * np.sign(here @ lines[link])
            ways[further] = (*ways[link], (pair, ahead))
            waiting.append(further)
    return ways


def _between(pairs: TurningPairs, way: Way, angles: Mapping[int, float]) -> Floats:
    """Return the rotation (3, 3) of the last link in the first, other angles zero."""
    made = np.eye(3)
    for pair, ahead in way:
        one, other = pairs.chains[pair].constants
        angle = angles.get(pair, 0.0)
        c, s = np.cos(angle), np.sin(angle)
        turned = one @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ other
        made = made @ (turned if ahead else turned.T)
    return np.asarray(made, dtype=float)


def _rolled(chain: Chain, rotation: Floats, apart: float) -> Floats | None:
    """Return the turns (2,) of a contact that lead to a rotation; None if none do.

    In M = Z(a) C Z(b) the last column is that of C turned by a, the last row that of C
    turned back by b.
    """
    before, between, after = (np.asarray(item, dtype=float) for item in chain.constants)
    needed = before.T @ rotation @ after.T
    if abs(needed[2, 2] - between[2, 2]) > apart:
        return None
    (x, y, _), (u, v, _) = needed[:, 2], between[:, 2]
    (p, q, _), (r, s, _) = needed[2], between[2]
    return np.array(
        [
            np.arctan2(y, x) - np.arctan2(v, u),
            np.arctan2(s, r) - np.arctan2(q, p),
        ]
    )


def _least_rolled(
    meshes: Sequence[_Mesh], followers: Sequence[int], square: Floats
) -> Floats | None:
    """Return the angles (followers,) at inputs of zero with wheels rolled least.

    Of those that have rolled as far, the ones with the greatest first length. Only the
    turns that lengths differ by are tried.
    """
    lengths = np.array([mesh.lengths for mesh in meshes])
    first = np.array([mesh.rates[0, list(followers)] for mesh in meshes])
    to_angles = np.linalg.inv(square)
    unturned = to_angles @ (lengths[:, 1] - lengths[:, 0])
    rolled = lengths[:, 0] + first @ unturned
    steps: list[tuple[Floats, Floats]] = []
    for k, mesh in enumerate(meshes):
        for side in range(2):
            turned = to_angles[:, k] * mesh.laps[side] * (1.0 if side else -1.0)
            step = first @ turned
            step[k] += 0.0 if side else mesh.laps[0]
            if np.max(np.abs(step)) > SAME_LENGTH and not _repeats(step, steps):
                steps.append((step, turned))
    counts = range(-MOST_TURNS, MOST_TURNS + 1)
    if len(counts) ** len(steps) > MOST_ASSEMBLIES:
        return None
    best = min(_assemblies(rolled, unturned, steps, counts), key=lambda item: item[0])
    return best[1]


def _repeats(step: Floats, steps: Iterable[tuple[Floats, Floats]]) -> bool:
    return any(
        np.max(np.abs(step - sense * other)) < SAME_LENGTH
        for other, _ in steps
        for sense in (1.0, -1.0)
    )


def _assemblies(
    rolled: Floats,
    angles: Floats,
    steps: Sequence[tuple[Floats, Floats]],
    counts: Iterable[int],
) -> Iterable[tuple[tuple[int, ...], Floats]]:
    for turns in product(counts, repeat=len(steps)):
        lengths, put = rolled.copy(), angles.copy()
        for count, (step, turned) in zip(turns, steps, strict=True):
            lengths += count * step
            put += count * turned
        total = round(float(np.sum(np.abs(lengths))) / SAME_LENGTH)
        yield (total, *(-round(length / SAME_LENGTH) for length in lengths)), put
