"""All closed configurations of a structure by an independent damped multi-start search.

Nothing of the package's kinematics is used, only the geometry of the file. Unknown are
the orientations of the bodies that are more than a bar; an R pair makes two axes coincide,
a link with two pairs keeps the arc of its axes, and so does a contact of two circles for
their centres. The package works with the angles and arc lengths of pairs around loops.
"""

from dataclasses import dataclass

import numpy as np

CLOSED = 1e-11
"""Largest residual of a configuration."""
APART = 1e-5
"""Rotation matrices of two configurations differ by more."""
SOUND = 1e-4
"""Least singular value of a configuration that is compared."""


def crossed(vectors):
    """Return the matrices (..., 3, 3) of the cross product with vectors (..., 3)."""
    out = np.zeros((*vectors.shape, 3))
    x, y, z = np.moveaxis(vectors, -1, 0)
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    return out - np.swapaxes(out, -1, -2)


def turned(vectors):
    """Return rotations (..., 3, 3) by rotation vectors (..., 3), Rodrigues' formula."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    k = crossed(vectors)
    return (
        np.eye(3)
        + np.sinc(angle / np.pi) * k
        + 0.5 * np.sinc(angle / 2 / np.pi) ** 2 * k @ k
    )


@dataclass
class Structure:
    """A mechanism of R pairs and contacts of circles with its single input locked."""

    bodies: list  # names of links of each body that is not a bar
    equations: list  # ("point" or "bar", body, link, axis, body, link, axis)
    driven: tuple  # links a, b, axis, value in the reference pose

    @staticmethod
    def of(made):
        """Return the structure of a mechanism given by a reference pose."""
        driven = made.pair(made.inputs[0].pair)
        a, b = driven.links
        axis = np.array(made.geometry.axes[driven.name])
        value = made.geometry.values.get(driven.name, 0.0)
        body_of = {link: a if link == b else link for link in made.links}
        joints = []
        for pair in made.pairs:
            if pair.name == driven.name:
                continue
            one, other = pair.links
            if pair.type == "R":
                u = np.array(made.geometry.axes[pair.name])
                joints.append(("point", one, u, other, u))
            else:
                assert pair.type == "Cs" and all(p.kind == "circle" for p in pair.profiles)
                u, v = (np.array(profile.centre) for profile in pair.profiles)
                joints.append(("bar", one, u, other, v))
        at = {}
        for joint in joints:
            for link in (joint[1], joint[3]):
                at.setdefault(body_of[link], []).append(joint)
        bars = set()
        for body in sorted(at, key=lambda body: (len(at[body]), body)):
            near = {body_of[x] for joint in at[body] for x in (joint[1], joint[3])} - {body}
            plain = all(joint[0] == "point" for joint in at[body])
            if body != a and len(at[body]) == 2 == len(near) and plain and not near & bars:
                bars.add(body)
        equations = [
            (kind, body_of[one], one, u, body_of[other], other, v)
            for kind, one, u, other, v in joints
            if not {body_of[one], body_of[other]} & bars
        ]
        for body in sorted(bars):
            outer = []
            for _, one, u, other, _ in at[body]:
                link = other if body_of[one] == body else one
                outer += [body_of[link], link, u]
            equations.append(("bar", *outer))
        bodies = sorted(set(at) - bars, key=lambda body: (body != a, -len(at[body]), body))
        return Structure(bodies, equations, (a, b, axis, value))

    def search(self, q, random, rounds=80):
        """Return which of random starts at inputs q (n,) closed, and rotations there.

        Rows (k,) of q, rotations (k, bodies, 3, 3) of the bodies seen from the first, and
        the least singular values (k,). Levenberg and Marquardt's method.
        """
        n, m = len(q), len(self.bodies)
        _, b, axis, value = self.driven
        lock = turned((q - value)[:, None] * axis)
        number = {body: k for k, body in enumerate(self.bodies)}

        def given(link, vector, rows):
            return lock[rows] @ vector if link == b else np.tile(vector, (len(rows), 1))

        quaternions = random.normal(size=(n, m, 4))
        quaternions /= np.linalg.norm(quaternions, axis=2, keepdims=True)
        w, v = quaternions[..., 0, None, None], quaternions[..., 1:]
        rotations = np.eye(3) + 2 * w * crossed(v) + 2 * crossed(v) @ crossed(v)
        rotations[:, 0] = np.eye(3)

        def system(rotations, rows):
            gaps, slopes = [], []
            for kind, one, link, u, other, beyond, v in self.equations:
                i, j = number[one], number[other]
                p = np.einsum("nij,nj->ni", rotations[:, i], given(link, u, rows))
                r = np.einsum("nij,nj->ni", rotations[:, j], given(beyond, v, rows))
                if kind == "point":
                    gap, one_by, other_by = p - r, -crossed(p), crossed(r)
                else:
                    gap = np.sum(p * r, axis=1)[:, None] - u @ v
                    one_by = np.cross(p, r)[:, None]
                    other_by = np.cross(r, p)[:, None]
                slope = np.zeros((len(rows), gap.shape[1], 3 * m))
                slope[:, :, 3 * i : 3 * i + 3] += one_by
                slope[:, :, 3 * j : 3 * j + 3] += other_by
                gaps.append(gap)
                slopes.append(slope)
            return np.concatenate(gaps, axis=1), np.concatenate(slopes, axis=1)[:, :, 3:]

        active, damping = np.arange(n), np.full(n, 0.1)
        gap, slope = system(rotations, active)
        size = np.sum(gap**2, axis=1)
        closed = np.zeros(n, dtype=bool)
        first = np.full(n, np.inf)
        for turn in range(rounds):
            normal = np.einsum("nij,nik->njk", slope, slope)
            damped = normal + (damping[active, None, None] + 1e-15) * np.eye(3 * m - 3)
            right = -np.einsum("nij,ni->nj", slope, gap)
            step = np.linalg.solve(damped, right[..., None])[..., 0]
            tried = rotations[active]
            tried[:, 1:] = turned(step.reshape(-1, m - 1, 3)) @ tried[:, 1:]
            new_gap, new_slope = system(tried, active)
            new = np.sum(new_gap**2, axis=1)
            better = new < size[active]
            rows = active[better]
            rotations[rows], size[rows] = tried[better], new[better]
            gap[better], slope[better] = new_gap[better], new_slope[better]
            damping[active] *= np.where(better, 0.2, 5.0)
            now_closed = np.max(np.abs(gap), axis=1) < CLOSED
            if turn % 10 == 9:
                stuck = (size[active] > 0.5 * first[active]) & (size[active] > 1e-6)
                first[active] = size[active]
            else:
                stuck = np.zeros(len(active), dtype=bool)
            stuck |= damping[active] > 1e12
            closed[active[now_closed]] = True
            going = ~(now_closed | stuck)
            active, gap, slope = active[going], gap[going], slope[going]
            if not len(active):
                break
        rows = np.flatnonzero(closed)
        _, slope = system(rotations[rows], rows)
        least = np.linalg.svd(slope, compute_uv=False)[:, -1]
        return rows, rotations[rows], least

    def modes(self, inputs, starts, random):
        """Return the modes at each input: rotations (k, bodies, 3, 3) and hits (k,)."""
        rows, rotations, least = self.search(np.repeat(inputs, starts), random)
        out = []
        for number in range(len(inputs)):
            here = (rows // starts == number) & (least > SOUND)
            modes, hits = [], []
            for one in rotations[here]:
                same = [
                    k
                    for k, other in enumerate(modes)
                    if np.max(np.abs(one - other)) < APART
                ]
                if same:
                    hits[same[0]] += 1
                else:
                    modes.append(one)
                    hits.append(1)
            out.append(
                (np.array(modes).reshape(-1, len(self.bodies), 3, 3), np.array(hits))
            )
        return out

    def seen(self, links, placed):
        """Return rotations (n, bodies, 3, 3) of the bodies from those of links."""
        number = {link: k for k, link in enumerate(links)}
        turned = placed[:, [number[body] for body in self.bodies]]
        return np.swapaxes(turned[:, :1], -1, -2) @ turned
