"""The pairs of a configuration: their frames, and how their variables move links.

What a pair of each kind does is said in `spherekit.mechanism.joint`; here those of one kind
are evaluated together.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.geometry.triangle import arc
from spherekit.mechanism.joint import ContactProfile, Joint, Kind, PairStates, Revolute
from spherekit.tolerances import EQUAL_CURVATURE


def pair_angle(one: Floats, other: Floats) -> Floats:
    """Return the variable (...,) rad of an R pair by its frames (..., 3, 3) in links."""
    cosine, sine = (np.sum(one[..., k] * other[..., 0], axis=-1) for k in (0, 1))
    return np.arctan2(sine, cosine)


def turns_of(
    ends: Sequence[tuple[int, int]], joints: Sequence[Revolute], placed: Floats
) -> tuple[Floats, Floats]:
    """Return the variables (n, pairs) rad of R pairs between placed links, and gaps.

    `ends` are the numbers of each pair's links, `placed` (n, links, 3, 3) the orientations
    of these; a gap (n, pairs) rad is the angle between the axes of a pair in its links.
    """
    a, b = np.array(ends).T
    one = placed[:, a] @ np.array([joint.first for joint in joints])
    other = placed[:, b] @ np.array([joint.second for joint in joints])
    return pair_angle(one, other), arc(one[..., 2], other[..., 2])


def numbered(joints: Sequence[Joint]) -> Iterator[tuple[int, int, Joint]]:
    """Yield each joint after its number and that of its first variable."""
    at = 0
    for number, joint in enumerate(joints):
        yield number, at, joint
        at += joint.variable_count


def contact_tracks(
    joints: Sequence[Joint],
) -> Iterator[tuple[int, tuple[ContactProfile, ...]]]:
    """Yield the profiles of each contact after its number, variables numbered in all."""
    for number, at, joint in numbered(joints):
        if tracks := joint.contact_profiles:
            yield number, tuple(x._replace(variable=at + x.variable) for x in tracks)


def rolled_lengths(joints: Sequence[Joint]) -> list[tuple[int, Joint]]:
    """Return the variables that say how far wheels have rolled, with their joints."""
    return [
        (at + variable, joint)
        for _, at, joint in numbered(joints)
        for variable in joint.rolling_variables
    ]


Places = slice | list[int]


Alike = tuple[Kind, tuple[Joint, ...], Places, Places]
"""The joints of one kind, with the places of them and of their variables."""


@lru_cache(maxsize=512)
def _by_kind(joints: tuple[Joint, ...]) -> tuple[Alike, ...]:
    pairs: dict[Kind, list[int]] = {}
    variables: dict[Kind, list[int]] = {}
    for number, at, joint in numbered(joints):
        pairs.setdefault(type(joint), []).append(number)
        variables.setdefault(type(joint), []).extend(range(at, at + joint.variable_count))
    return tuple(
        (kind, tuple(joints[k] for k in members), _run(members), _run(variables[kind]))
        for kind, members in pairs.items()
    )


def _run(numbers: list[int]) -> Places:
    """Return rising numbers as a slice where they have no gap: a view, not a copy."""
    first, last = numbers[0], numbers[-1] + 1
    return slice(first, last) if last - first == len(numbers) else numbers


def pair_states(joints: tuple[Joint, ...], values: Floats) -> PairStates:
    """Return the states of pairs for variables (n, variables)."""
    n, parts = len(values), list[tuple[Places, PairStates]]()
    for kind, members, pairs, variables in _by_kind(joints):
        given = values[:, variables].reshape(n, len(members), kind.variable_count)
        parts.append((pairs, kind.evaluate_states(members, given)))
    if len(parts) == 1:
        return parts[0][1]
    states = PairStates.blank(n, len(joints))
    for pairs, part in parts:
        states.put(pairs, part)
    return states


def penetrates(joints: Sequence[Joint], states: PairStates) -> Bools:
    """Return (n,) whether a contact's profiles curve into each other, or alike."""
    contact = [bool(joint.contact_profiles) for joint in joints]
    relative = states.curvatures[:, contact, 0] - states.curvatures[:, contact, 1]
    return np.any(relative < EQUAL_CURVATURE, axis=1)
