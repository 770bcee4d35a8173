"""The pairs of a configuration: their frames, and how their variables move links.

What a pair of each kind does is said in `spherekit.model.joints`; here those of one kind
are evaluated together.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import EQUAL_CURVATURE
from spherekit.model.joints import Joint, Kind, PairRates, PairStates, Revolute, Track
from spherekit.sphere.rotation import Floats, arc, transpose


def turns_of(
    ends: Sequence[tuple[int, int]], joints: Sequence[Revolute], placed: Floats
) -> tuple[Floats, Floats]:
    """Return the variables (n, pairs) rad of R pairs between placed links, and gaps.

    `ends` are the numbers of each pair's links, `placed` (n, links, 3, 3) the orientations
    of these; a gap (n, pairs) rad is the angle between the axes of a pair in its links.
    """
    values, gaps = [], []
    for (a, b), joint in zip(ends, joints, strict=True):
        one, other = placed[:, a] @ joint.first, placed[:, b] @ joint.second
        between = transpose(one) @ other
        values.append(np.arctan2(between[:, 1, 0], between[:, 0, 0]))
        gaps.append(arc(one[..., 2], other[..., 2]))
    return np.stack(values, axis=1), np.stack(gaps, axis=1)


def numbered(joints: Sequence[Joint]) -> Iterator[tuple[int, int, Joint]]:
    """Yield each joint after its number and that of its first variable."""
    at = 0
    for number, joint in enumerate(joints):
        yield number, at, joint
        at += joint.freedoms


def contact_tracks(joints: Sequence[Joint]) -> Iterator[tuple[int, tuple[Track, ...]]]:
    """Yield the profiles of each contact after its number, variables numbered in all."""
    for number, at, joint in numbered(joints):
        if tracks := joint.tracks:
            yield number, tuple(replace(x, variable=at + x.variable) for x in tracks)


def rolled_lengths(joints: Sequence[Joint]) -> list[tuple[int, Joint]]:
    """Return the variables that say how far wheels have rolled, with their joints."""
    every = numbered(joints)
    return [(at + variable, joint) for _, at, joint in every for variable in joint.rolled]


@final
@dataclass(frozen=True)
class _Alike:
    """The joints of one kind, with the numbers of them and of their variables."""

    kind: Kind
    joints: tuple[Joint, ...]
    pairs: slice | list[int]
    variables: slice | list[int]


@lru_cache(maxsize=512)
def _by_kind(joints: tuple[Joint, ...]) -> tuple[_Alike, ...]:
    pairs: dict[Kind, list[int]] = {}
    variables: dict[Kind, list[int]] = {}
    for number, at, joint in numbered(joints):
        pairs.setdefault(type(joint), []).append(number)
        variables.setdefault(type(joint), []).extend(range(at, at + joint.freedoms))
    return tuple(
        _Alike(
            kind, tuple(joints[k] for k in members), _run(members), _run(variables[kind])
        )
        for kind, members in pairs.items()
    )


def _run(numbers: list[int]) -> slice | list[int]:
    """Return rising numbers as a slice where they have no gap: a view, not a copy."""
    first, last = numbers[0], numbers[-1] + 1
    return slice(first, last) if last - first == len(numbers) else numbers


def _variables(joints: Sequence[Joint]) -> int:
    return sum(joint.freedoms for joint in joints)


def _flat(vectors: Floats) -> Floats:
    """Return (n, variables, 3) from (n, pairs, variables of each, 3)."""
    n, pairs, freedoms, _ = vectors.shape
    return vectors.reshape(n, pairs * freedoms, 3)


def pair_states(joints: Sequence[Joint], values: Floats) -> PairStates:
    """Return the states of pairs for variables (n, variables)."""
    n = len(values)
    alike = _by_kind(tuple(joints))
    parts = [
        item.kind.states(
            item.joints,
            values[:, item.variables].reshape(n, len(item.joints), item.kind.freedoms),
        )
        for item in alike
    ]
    if len(parts) == 1:
        return parts[0]
    states = PairStates.blank(n, len(joints))
    for group, part in zip(alike, parts, strict=True):
        states.put(group.pairs, part)
    return states


def variable_vectors(joints: Sequence[Joint], frames: Floats, curvatures: Floats) -> Floats:
    """Return the vectors (n, variables, 3) of all variables.

    `frames` (n, pairs, 3, 3) are the pair frames in the axes wanted, `curvatures` as in
    `PairStates`.
    """
    vectors = np.empty((len(frames), _variables(joints), 3))
    for group in _by_kind(tuple(joints)):
        part = group.kind.vectors(frames[:, group.pairs], curvatures[:, group.pairs])
        vectors[:, group.variables] = _flat(part)
    return vectors


def pair_axes(joints: Sequence[Joint], frames: Floats) -> Floats:
    """Return (n, pairs, 3): axis (R), contact line (Cr), normal of contact plane (Cs)."""
    axes = np.empty(frames.shape[:-1])
    for group in _by_kind(tuple(joints)):
        axes[:, group.pairs] = group.kind.axes(frames[:, group.pairs])
    return axes


def pair_rates(
    joints: Sequence[Joint],
    frames: Floats,
    states: PairStates,
    first_w: Floats,
    second_w: Floats,
) -> PairRates:
    """Return how vectors and axes change, given the rates of the pairs' two links.

    `first_w`, `second_w` (n, pairs, 3) are angular velocities of the links in the axes
    that `frames` (n, pairs, 3, 3) are given in.
    """
    n = len(frames)
    alike = _by_kind(tuple(joints))
    rates = PairRates(np.empty((n, _variables(joints), 3)), np.empty((n, len(joints), 3)))
    for group in alike:
        placed = frames[:, group.pairs], states.take(group.pairs)
        turning = first_w[:, group.pairs], second_w[:, group.pairs]
        vectors, axes = group.kind.rates(*placed, *turning)
        if len(alike) == 1:
            return PairRates(_flat(vectors), axes)
        rates.vectors[:, group.variables] = _flat(vectors)
        rates.axes[:, group.pairs] = axes
    return rates


def penetrates(joints: Sequence[Joint], states: PairStates) -> NDArray[np.bool_]:
    """Return (n,) whether a contact's profiles curve into each other, or alike."""
    contact = [bool(joint.tracks) for joint in joints]
    relative = states.curvatures[:, contact, 0] - states.curvatures[:, contact, 1]
    return np.asarray(np.any(relative < EQUAL_CURVATURE, axis=1))
