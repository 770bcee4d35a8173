"""Configurations and rates in 90 digits, and how far small changes of the data move them.

Nothing here calls a solver of spherekit. The frames of pairs in their links, as doubles,
are the data; they are made orthonormal in 90 digits, and from there on everything is
exact to rounding of that precision.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from spherekit.errors import ModelError
from spherekit.mechanism.joint import revolute
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.loop_tree import LoopTree

import mpmath as mp  # isort: skip

DIGITS = 90
SMALL = mp.mpf(10) ** -30
"""The change of the data, and of the input, that derivatives are taken with."""
CHANGES = 3
"""So many changes of all data at once, at random, are tried."""
MOST_STEPS = 60

Exact = Any
"""An array of mpmath numbers."""

_number = np.frompyfunc(mp.mpf, 1, 1)
_sine, _cosine, _root = (np.frompyfunc(f, 1, 1) for f in (mp.sin, mp.cos, mp.sqrt))


class NoSolution(Exception):
    """The loops do not close at these inputs."""


def exact(values: Any) -> Exact:
    """Return an array of floats as numbers of 90 digits, without rounding."""
    return _number(np.asarray(values, dtype=object) + mp.mpf(0))


def length(vectors: Exact) -> Exact:
    """Return the lengths (...,) of vectors (..., 3)."""
    return _root(np.sum(vectors * vectors, axis=-1))


def cross(a: Exact, b: Exact) -> Exact:
    """Return a x b for arrays (..., 3)."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def solved(matrix: Exact, right: Exact) -> Exact:
    """Return x (n, m) with matrix (n, n) x = right (n, m), by elimination with pivots.

    Raises
    ------
    NoSolution
        If the matrix is singular.
    """
    n = len(matrix)
    rows = np.concatenate([matrix, right], axis=1)
    for k in range(n):
        best = k + int(np.argmax(np.abs(rows[k:, k])))
        if rows[best, k] == 0:
            raise NoSolution
        rows[[k, best]] = rows[[best, k]]
        rows[k, k:] = rows[k, k:] / rows[k, k]
        below = np.flatnonzero(rows[k + 1 :, k] != 0) + k + 1
        rows[below, k:] -= rows[below, k, None] * rows[k, None, k:]
    out = rows[:, n:]
    for k in range(n - 1, 0, -1):
        out[:k] -= rows[:k, k, None] * out[k, None]
    return out


@final
@dataclass(frozen=True)
class Data:
    """What a mechanism is made of.

    `frames` (2, pairs, 3, 3): of each pair in its first and second link; for a circle its
    third column is the centre. `radii` (2, pairs) of circles; `turns` (2, pairs) is 1, or
    -1 where a circle is run backwards.
    """

    frames: Exact
    radii: Exact
    turns: Any

    def changed(self, random: np.random.Generator) -> "Data":
        """Turn each frame about its three axes, and scale each radius, by `SMALL`."""
        frames = self.frames.copy()
        for which, pair in np.ndindex(frames.shape[:2]):
            frames[which, pair] = _turned(frames[which, pair], random)
        parts = exact(random.uniform(-1, 1, self.radii.shape))
        return replace(self, frames=frames, radii=self.radii * (1 + SMALL * parts))


def _turned(frame: Exact, random: np.random.Generator) -> Exact:
    x, y, z = random.uniform(-1, 1, 3).tolist()
    turn = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=object)
    return frame + SMALL * (turn @ frame)


@final
@dataclass(frozen=True)
class Placed:
    """One choice of all variables: orientations, vectors of variables, what stays open."""

    rotations: Exact
    vectors: Exact
    gap: Exact


@final
class Reference:
    """A mechanism of R pairs and contacts of circles.

    `held` (variables of the inputs that stand still) and `moved` (the one that moves)
    are numbers of variables.
    """

    def __init__(self, mechanism: Mechanism, moved: str | None = None) -> None:
        self.mechanism = mechanism
        self.tree = LoopTree.of_mechanism(mechanism)
        self.joints = make_joints(mechanism)
        self.count = len(self.tree.owners)
        names = [item.pair for item in mechanism.inputs]
        numbers = [mechanism.variables_of(mechanism.pair_number[p])[0] for p in names]
        self.inputs = tuple(numbers)
        self.moved = numbers[names.index(moved) if moved else 0]
        self.angles = [v for v, p in enumerate(self.tree.owners) if self.joints[p].has_axis]
        with mp.workdps(DIGITS):
            self.data = self._data()

    def _data(self) -> Data:
        pairs = len(self.joints)
        frames = np.zeros((2, pairs, 3, 3))
        radii, turns = np.ones((2, pairs)), np.ones((2, pairs), dtype=int)
        for k, joint in enumerate(self.joints):
            if joint.has_axis:
                hinge = revolute(joint)
                frames[0, k], frames[1, k] = hinge.first, hinge.second
                continue
            profiles = self.mechanism.pairs[k].profiles
            assert profiles is not None
            for which, curve in enumerate(track.curve for track in joint.contact_profiles):
                profile = profiles[which]
                if profile.kind not in ("circle", "great_circle"):
                    raise ModelError(
                        f"{self.mechanism.name}: pairs.{self.mechanism.pairs[k].name}: the "
                        f'profile of link {self.mechanism.pairs[k].links[which]} is "'
                        f'{profile.kind}", but this reference is of circles alone; '
                        "compare with spherekit.proof.reference_rows for other profiles"
                    )
                turns[which, k] = -1 if curve.backwards else 1
                frames[which, k] = curve.path.axes  # type: ignore[union-attr]
                radii[which, k] = profile.radius or 0.5 * np.pi
        axis = exact(frames[..., 2])
        axis = axis / length(axis)[..., None]
        side = exact(frames[..., 0])
        side = side - np.sum(side * axis, axis=-1)[..., None] * axis
        side = side / length(side)[..., None]
        return Data(np.stack([side, cross(axis, side), axis], -1), exact(radii), turns)

    def _own(self, data: Data, which: int, pair: int, value: Exact) -> tuple[Exact, Exact]:
        """Return the frame of a pair in one link, and the curvature of its circle."""
        joint, frame = self.joints[pair], data.frames[which, pair]
        if joint.has_axis:
            if which:
                return frame, mp.mpf(0)
            c, s = mp.cos(value), mp.sin(value)
            x, y, z = frame.T
            return np.stack([c * x + s * y, c * y - s * x, z], axis=-1), mp.mpf(0)
        start = joint.contact_profiles[which].start
        turn, radius = int(data.turns[which, pair]), data.radii[which, pair]
        sine, cosine = mp.sin(radius), mp.cos(radius)
        angle = turn * (value + start) / sine
        c, s = mp.cos(angle), mp.sin(angle)
        x, y, z = frame.T
        point = cosine * z + sine * (c * x + s * y)
        tangent = turn * (c * y - s * x)
        return (
            np.stack([tangent, cross(point, tangent), point], axis=-1),
            turn * cosine / sine,
        )

    def place(self, values: Exact, data: Data | None = None) -> Placed:
        """Return the links as variables (count,) place them."""
        data = data or self.data
        tree = self.tree
        own: list[tuple[Exact, Exact]] = []
        vectors_in: list[list[Exact]] = []
        at = 0
        for pair, joint in enumerate(self.joints):
            last = at + joint.variable_count - 1
            first, k1 = self._own(data, 0, pair, values[at])
            second, k2 = self._own(data, 1, pair, values[last])
            own.append((first, second))
            normal, point = first[:, 1], first[:, 2]
            if joint.has_axis:
                vectors_in.append([point])
            elif last == at:
                vectors_in.append([(k1 - k2) * point])
            else:
                vectors_in.append([normal + k1 * point, -(normal + k2 * point)])
            at = last + 1
        rotations = np.empty((tree.count, 3, 3), dtype=object)
        rotations[0] = exact(np.eye(3))
        for pair, parent, child in tree.placements:
            first, second = own[pair]
            across = first @ second.T
            ahead = tree.ends[pair][0] == parent
            rotations[child] = rotations[parent] @ (across if ahead else across.T)
        gap = []
        for chord in tree.chords:
            a, b = tree.ends[chord]
            first, second = own[chord]
            open_by = rotations[a] @ first @ (rotations[b] @ second).T
            skew = (open_by - open_by.T) / 2
            gap += [skew[2, 1], skew[0, 2], skew[1, 0]]
        vectors = [
            rotations[a] @ vector
            for (a, _), several in zip(tree.ends, vectors_in, strict=True)
            for vector in several
        ]
        return Placed(rotations, np.array(vectors), np.array(gap, dtype=object))

    def jacobian(self, placed: Placed) -> Exact:
        """Return (3 loops, variables)."""
        signs = self.tree.signs
        grid = signs[:, None, :] * placed.vectors.T[None]
        return grid.reshape(3 * len(self.tree.chords), self.count)

    def closed(self, values: Exact, held: Sequence[int]) -> Exact:
        """Return the variables with the loops closed, those of `held` as they are.

        Raises
        ------
        NoSolution
            If Newton's method does not come to rest.
        """
        free = [v for v in range(self.count) if v not in held]
        values = values.copy()
        small, closed = mp.mpf(10) ** (35 - DIGITS), mp.mpf(10) ** (10 - DIGITS)
        for _ in range(MOST_STEPS):
            placed = self.place(values)
            matrix = self.jacobian(placed)[:, free]
            change = solved(matrix, -placed.gap[:, None])[:, 0]
            size = np.max(np.abs(change))
            if size > mp.mpf("0.3"):
                change = change * (mp.mpf("0.3") / size)
            values[free] = values[free] + change
            if size < small and np.max(np.abs(placed.gap)) < closed:
                return values
        raise NoSolution

    def rates(self, placed: Placed) -> tuple[Exact, Exact]:
        """Return the rates of variables (count,) and of links (links, 3) by the input."""
        matrix = self.jacobian(placed)
        free = [v for v in range(self.count) if v not in self.inputs]
        rates = exact(np.zeros(self.count))
        rates[self.moved] = mp.mpf(1)
        rates[free] = solved(matrix[:, free], -matrix[:, [self.moved]])[:, 0]
        return rates, self.tree.paths @ (rates[:, None] * placed.vectors)

    def turning(self, values: Exact, stands: int, held: Sequence[int] = ()) -> Exact:
        """Return the configuration nearby in which a variable stands still.

        It is the input at a dead centre of the input (type II), an output's pair at one
        of the output (type I). `held` are inputs that keep their values. Newton's method
        for closure and the null vector of the velocity equations without `stands`.
        """
        loose = [v for v in range(self.count) if v not in held]
        moving = [v for v in loose if v != stands]
        start = self.jacobian(self.place(values))[:, moving]
        null = np.linalg.svd(start.astype(float))[2][-1]
        scale, z = exact(null), np.concatenate([values[loose], exact(null)])

        def function(z: Exact) -> Exact:
            there = values.copy()
            there[loose] = z[: len(loose)]
            placed = self.place(there)
            v = z[len(loose) :]
            still = self.jacobian(placed)[:, moving] @ v
            return np.concatenate([placed.gap, still, [scale @ v - 1]])

        for _ in range(MOST_STEPS):
            here = function(z)
            columns = []
            for k in range(len(z)):
                moved = z.copy()
                moved[k] += SMALL
                columns.append((function(moved) - here) / SMALL)
            change = solved(np.stack(columns, axis=1), -here[:, None])[:, 0]
            z = z + change
            if np.max(np.abs(change)) < mp.mpf(10) ** (45 - DIGITS):
                out = values.copy()
                out[loose] = z[: len(loose)]
                return out
        raise NoSolution

    def tangent(self, values: Exact, held: Sequence[int] = ()) -> Exact:
        """Return the direction (count,) in which the mechanism moves, of unit length."""
        loose = [v for v in range(self.count) if v not in held]
        matrix = self.jacobian(self.place(values))[:, loose]
        rough = np.linalg.svd(matrix.astype(float))[2][-1]
        bordered = np.concatenate([matrix, exact(rough)[None]])
        right = exact(np.zeros((len(loose), 1)))
        right[-1, 0] = mp.mpf(1)
        out = exact(np.zeros(self.count))
        found = solved(bordered, right)[:, 0]
        out[loose] = found / mp.sqrt(np.sum(found * found))
        return out


@final
@dataclass(frozen=True)
class Truth:
    """Quantities at one configuration, and how far unit changes of the data move them.

    `angles` (R variables,), `rotations` (links, 3, 3), `rates`, `derivatives` (links, 3).
    `condition[quantity]` is relative to the size of the quantity where that is above 1;
    for `rotations` and `angles` in rad/rad. `changed` has the same arrays after each
    change of the data, by name.
    """

    values: Exact
    angles: Exact
    rotations: Exact
    rates: Exact
    derivatives: Exact | None
    condition: dict[str, float]
    changed: tuple[dict[str, Exact], ...]

    def pole(self, i: int, j: int) -> tuple[Exact, float, float]:
        """Return the direction of a pole, its conditioning, and the size of its rate."""
        relative = self.rates[j] - self.rates[i]
        size = length(relative)
        if size == 0:
            return relative, float("inf"), 0.0
        rates = [changed["rates"] for changed in self.changed]
        moved = [length(cross(w[j] - w[i], relative)) for w in rates]
        return relative / size, _over(max(moved), size * size), float(size)


def _over(change: Exact, size: Exact) -> float:
    return max(1.0, float(change / size / SMALL))


def truth(reference: Reference, values: Exact, derivatives: bool = True) -> Truth:
    """Return the quantities at a closed configuration in 90 digits, with conditioning.

    The conditioning is the largest change of a quantity over changes of all data at
    once: each frame of each pair turned by up to one unit about each of its axes, each
    radius scaled and each input moved by up to one unit, times itself where it is above
    1. Units are infinitesimal (1e-30), the changes random, and the same every time.
    """
    with mp.workdps(DIGITS):
        return _truth(reference, values, derivatives)


def _truth(reference: Reference, values: Exact, derivatives: bool) -> Truth:
    free = [v for v in range(reference.count) if v not in reference.inputs]
    placed = reference.place(values)
    inverse = solved(reference.jacobian(placed)[:, free], exact(np.eye(len(free))))

    def settled(values: Exact, data: Data) -> Exact:
        values = values.copy()
        for _ in range(2):
            values[free] = values[free] - inverse @ reference.place(values, data).gap
        return values

    def at(values: Exact, data: Data) -> list[Exact]:
        placed = reference.place(values, data)
        slope, w = reference.rates(placed)
        out = [values[reference.angles], placed.rotations, w]
        if derivatives:
            further = settled(values + SMALL * slope, data)
            _, beyond = reference.rates(reference.place(further, data))
            out.append((beyond - w) / SMALL)
        return out

    names = ["angles", "rotations", "rates", "derivatives"]
    here = at(values, reference.data)
    sizes = [mp.mpf(1), mp.mpf(1)] + [
        max(mp.mpf(1), max(length(vectors))) for vectors in here[2:]
    ]
    condition = dict.fromkeys(names[: len(here)], 1.0)
    random = np.random.default_rng(1)
    changed: list[dict[str, Exact]] = []
    for _ in range(CHANGES):
        data = reference.data.changed(random)
        there = values.copy()
        for number in reference.inputs:
            unit = max(mp.mpf(1), abs(there[number]))
            there[number] += SMALL * unit * random.uniform(-1, 1)
        moved = at(settled(there, data), data)
        changed.append(dict(zip(names, moved, strict=False)))
        for name, size, one, other in zip(names, sizes, here, moved, strict=False):
            change = np.max(np.abs(one - other)) if np.size(one) else mp.mpf(0)
            condition[name] = max(condition[name], _over(change, size))
    return Truth(
        values,
        here[0],
        here[1],
        here[2],
        here[3] if derivatives else None,
        condition,
        tuple(changed),
    )
