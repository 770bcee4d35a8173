"""A mechanism as free bodies held together: Newton's and Euler's equations, by SciPy.

Every moving link is a body about the fixed centre, I dw/dt + w x I w = moments; a pair of
axis u between links i and j holds two components of w_j - w_i at zero by multipliers. The
unknowns are orientations (quaternions) and angular velocities of all links. Nothing of
pole axes, Eksergian's equation, closed loops or coordinates is used.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp


@dataclass(frozen=True)
class Hinge:
    """An R pair: its name, the two bodies (0 is the ground) and its axis at the start."""

    name: str
    first: int
    second: int
    axis: np.ndarray


class MultiBody:
    """Bodies with tensors (n, 3, 3) about the centre at the start, in ground axes."""

    def __init__(self, tensors, hinges):
        self.tensors, self.hinges = np.array(tensors), tuple(hinges)
        self.count = len(self.tensors)
        held = [(each.first, each.second, each.axis) for each in self.hinges]
        first, second, lines = zip(*held, strict=True)
        self._first, self._second, self._axes = map(np.array, (first, second, lines))
        self._across = np.array([np.linalg.svd(line[None])[2][1:] for line in lines])

    def rates(self, given):
        """Return the angular velocities (n, 3) at the start for the rates of pairs."""
        rows = self._rows(self._across)
        names = [each.name for each in self.hinges]
        drives = np.zeros((len(given), self.count + 1, 3))
        for drive, pair in zip(drives, given, strict=True):
            number = names.index(pair)
            drive[self._second[number]] = self._axes[number]
            drive[self._first[number]] = -self._axes[number]
        rows = np.concatenate([rows, drives[:, 1:].reshape(len(given), -1)])
        right = np.concatenate([np.zeros(len(rows) - len(given)), list(given.values())])
        return np.asarray(np.linalg.lstsq(rows, right, rcond=None)[0]).reshape(-1, 3)

    def solve(self, torque, w, times, rtol=1e-11, longest=5e-3):
        """Return the angles (times,) that each pair has turned since the start.

        `torque` gives torques (N m) at pairs by the time, the angles turned and the rates.
        """
        n, names = self.count, [each.name for each in self.hinges]
        whole = np.tile([1.0, 0.0, 0.0, 0.0], n)
        start = np.concatenate([whole, w.ravel(), np.zeros(len(names))])

        def change(t, y):
            q, w = y[: 4 * n].reshape(n, 4), y[4 * n : 7 * n].reshape(n, 3)
            angles = y[7 * n :]
            turn = np.concatenate([np.eye(3)[None], _matrices(q)])
            turning = np.concatenate([np.zeros((1, 3)), w])
            held = turn[self._first]
            axes = np.einsum("kij,kj->ki", held, self._axes)
            across = np.einsum("kij,kaj->kai", held, self._across)
            apart = turning[self._second] - turning[self._first]
            speeds = np.sum(apart * axes, axis=1)[: len(names)]
            moments = np.zeros((n + 1, 3))
            given = torque(
                t,
                dict(zip(names, angles, strict=True)),
                dict(zip(names, speeds, strict=True)),
            )
            for number, name in enumerate(names):
                own = given.get(name, 0.0) * axes[number]
                moments[self._second[number]] += own
                moments[self._first[number]] -= own
            tensors = turn[1:] @ self.tensors @ np.swapaxes(turn[1:], 1, 2)
            spin = np.einsum("kij,kj->ki", tensors, w)
            free = moments[1:] - np.cross(w, spin)
            rows = self._rows(across)
            moved = np.cross(turning[self._first][:, None], across)
            gaps = -np.sum(moved * apart[:, None], axis=2).ravel()
            size = 3 * n
            matrix = np.zeros((size + len(rows), size + len(rows)))
            for body in range(n):
                part = slice(3 * body, 3 * body + 3)
                matrix[part, part] = tensors[body]
            matrix[size:, :size], matrix[:size, size:] = rows, rows.T
            right = np.concatenate([free.ravel(), gaps])
            faster = np.linalg.solve(matrix, right)[:size]
            return np.concatenate([_quaternion_rates(q, w).ravel(), faster, speeds])

        found = solve_ivp(
            change,
            (0.0, float(times[-1])),
            start,
            method="DOP853",
            t_eval=times,
            rtol=rtol,
            atol=rtol,
            max_step=longest,
        )
        assert found.success
        return dict(zip(names, found.y[7 * n :], strict=True))

    def _rows(self, across):
        rows = np.zeros((2 * len(self._axes), 3 * (self.count + 1)))
        for number, (i, j) in enumerate(zip(self._first, self._second, strict=True)):
            part = slice(2 * number, 2 * number + 2)
            rows[part, 3 * j : 3 * j + 3] += across[number]
            rows[part, 3 * i : 3 * i + 3] -= across[number]
        return rows[:, 3:]


def _matrices(q):
    q = q / np.linalg.norm(q, axis=1)[:, None]
    a, v = q[:, 0], q[:, 1:]
    skew = np.zeros((len(q), 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        skew[:, i, j], skew[:, j, i] = -v[:, k], v[:, k]
    return np.eye(3) + 2.0 * a[:, None, None] * skew + 2.0 * skew @ skew


def _quaternion_rates(q, w):
    a, v = q[:, :1], q[:, 1:]
    scalar = -np.sum(w * v, axis=1, keepdims=True)
    return 0.5 * np.concatenate([scalar, a * w + np.cross(w, v)], axis=1)
