"""Derivatives by numbers of profiles against closed forms of a cam in fifty digits.

The roller's centre is beside the cam at the normal, at its arc from the pivot: one
equation in the cam's own parameter, whatever that is, and no arc length along the cam.
"""

from itertools import pairwise

import mpmath as mp
import numpy as np
import pytest
from refusals import text_of

import spherekit as sk
from spherekit.design.sensitivity import Sensitivity
from spherekit.files.write import document_of
from spherekit.model.gears import geometry_of

DIGITS = 50
BY_Q, BY_NUMBER = mp.mpf(10) ** -9, mp.mpf(10) ** -12

HARMONICS = """kind = "fourier"
centre_xyz = [0.0, 0.0, 1.0]
cosines = [25.0, 4.0, 3.0, 0.5]
sines = [0.0, 0.0, 1.0, 0.4]
"""
POINTS = """kind = "points"
points = [[0.0, 58.0], [37.0, 62.0], [85.0, 66.0], [120.0, 68.0], [165.0, 66.0],
    [200.0, 63.5], [243.0, 61.0], [280.0, 60.0], [325.0, 58.5]]
"""
CAM = text_of("cam_profile_sensitivity")


def cross(a, b):
    return [a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3)]


def dot(a, b):
    return mp.fsum(x * y for x, y in zip(a, b, strict=True))


def colatitude(cosines, sines):
    """Return the point and a tangent at an azimuth."""

    def at(u):
        terms = [(k, mp.cos(k * u), mp.sin(k * u)) for k in range(len(cosines))]
        c = mp.fsum(cosines[k] * x + sines[k] * y for k, x, y in terms)
        d = mp.fsum(k * (sines[k] * x - cosines[k] * y) for k, x, y in terms)
        sc, cc, su, cu = mp.sin(c), mp.cos(c), mp.sin(u), mp.cos(u)
        away, along = [cc * cu, cc * su, -sc], [-su, cu, 0]
        rate = [d * x + sc * y for x, y in zip(away, along, strict=True)]
        return [sc * cu, sc * su, cc], rate

    return at


def periodic(knots, points):
    """Return the periodic quintic spline: powers, and truncated ones from each knot on."""
    count, end = len(points), knots[-1]
    system, right = mp.zeros(count + 5), mp.zeros(count + 5, 3)
    inner = knots[1:-1]
    for row, u in enumerate(knots[:-1]):
        for column in range(6):
            system[row, column] = u**column
        for k, knot in enumerate(inner):
            system[row, 6 + k] = max(u - knot, mp.mpf(0)) ** 5
        right[row, :] = mp.matrix(points[row]).T
    for order in range(5):
        row = count + order
        for power in range(order, 6):
            system[row, power] = mp.ff(power, order) * end ** (power - order)
        system[row, order] -= mp.ff(order, order)
        if order == 0:
            system[row, 0] = 0
        for k, knot in enumerate(inner):
            system[row, 6 + k] = mp.ff(5, order) * (end - knot) ** (5 - order)
    found = [mp.lu_solve(system, right[:, axis]) for axis in range(3)]

    def at(u):
        """Return the place and its derivative; not on the sphere."""
        u = u - end * mp.floor(u / end)
        place, rate = [], []
        for c in found:
            x = mp.fsum(c[k] * u**k for k in range(6))
            v = mp.fsum(k * c[k] * u ** (k - 1) for k in range(1, 6))
            for k, knot in enumerate(inner):
                if u > knot:
                    x += c[6 + k] * (u - knot) ** 5
                    v += 5 * c[6 + k] * (u - knot) ** 4
            place.append(x)
            rate.append(v)
        return place, rate

    return at


def through(points):
    """Return the spline whose knots are lengths along it, after as many fits."""
    whole = [*points, points[0]]
    steps = [mp.atan2(mp.norm(cross(a, b)), dot(a, b)) for a, b in pairwise(whole)]
    for fit in range(5):
        knots = [mp.fsum(steps[:k]) for k in range(len(whole))]
        spline = periodic(knots, points)

        def speed(u):
            x, v = spline(u)  # noqa: B023
            return mp.norm(cross(x, v)) / dot(x, x)

        if fit < 4:
            steps = [
                mp.quad(speed, panel, method="gauss-legendre") for panel in pairwise(knots)
            ]

    def at(u):
        x, v = spline(u)
        r = mp.norm(x)
        along = dot(x, v) / r**2
        return [c / r for c in x], [(a - along * b) / r for a, b in zip(v, x, strict=True)]

    return at, knots[-1]


class Cam:
    """The cam's profile with numbers (rad), and how the follower turns."""

    def __init__(self, profile):
        if profile["kind"] == "points":
            lonlat = [[mp.mpf(x) for x in pair] for pair in profile["points"]]
            points = [
                [mp.cos(b) * mp.cos(a), mp.cos(b) * mp.sin(a), mp.sin(b)] for a, b in lonlat
            ]
            self.curve, self.end = through(points)
        else:
            series = ([mp.mpf(x) for x in profile[key]] for key in ("cosines", "sines"))
            self.curve, self.end = colatitude(*series), 2 * mp.pi
        self.roller, self.arm, self.base = (mp.mpf(x) for x in np.radians([12, 45, 60]))

    def centre(self, u, q):
        """Return the roller's centre in the axes of the pivot: z along it, y from z."""
        p, t = self.curve(u)
        n, size = cross(p, t), mp.norm(t)
        c = [
            mp.cos(self.roller) * a - mp.sin(self.roller) * b / size
            for a, b in zip(p, n, strict=True)
        ]
        x, y = (mp.cos(q) * c[0] - mp.sin(q) * c[1], mp.sin(q) * c[0] + mp.cos(q) * c[1])
        sine, cosine = mp.sin(self.base), mp.cos(self.base)
        return x, cosine * y - sine * c[2], sine * y + cosine * c[2]

    def angle(self, q, near):
        """Return how far the roller has turned about the pivot."""

        def missed(u):
            return self.centre(u, q)[2] - mp.cos(self.arm)

        u = mp.findroot(missed, (near, near + mp.mpf("1e-8")), tol=mp.mpf(10) ** -92)
        x, y, _ = self.centre(u, q)
        return mp.atan2(y, x)

    def motion(self, q, near):
        """Return the angle, its rate by the input and the change of that."""
        less, here, more = (self.angle(q + k * BY_Q, near) for k in (-1, 0, 1))
        return [here, (more - less) / (2 * BY_Q), (more - 2 * here + less) / BY_Q**2]

    def nearest(self, point):
        """Return the parameter nearest to a point."""
        places = [self.end * k / 4000 for k in range(4000)]
        with mp.workdps(16):
            return max(places, key=lambda u: dot(self.curve(u)[0], point))


QUANTITIES = ["theta_pivot", "rate_pivot", "acceleration_coefficient_follower_frame"]
PROFILE = "pairs.contact.profiles.cam"


def samples_of(motion):
    ones = np.ones_like(motion.q)
    return np.stack([motion.q, 1.3 * ones, 0.7 * ones, motion.q], axis=1)


def cam_of(profile, tmp_path, name="cam"):
    path = tmp_path / f"{name}.toml"
    path.write_text(CAM.replace('name = "cam"', f'name = "{name}"') + profile)
    return sk.load(path)


@pytest.mark.slow
@pytest.mark.parametrize(
    "profile, places",
    [
        (HARMONICS, [("cosines", 1), ("sines", 3)]),
        (POINTS, [("points", 3, 1), ("points", 0, 0)]),
    ],
    ids=["harmonics", "points"],
)
def test_derivatives_of_a_cam_are_those_of_differences_in_fifty_digits(
    profile, places, tmp_path
):
    """Of angle, rate and acceleration; of the torque that follows from these too."""
    mechanism = cam_of(profile, tmp_path)
    keys = []
    for name, *place in places:
        axis = ["longitude", "latitude"][place[-1]] if len(place) == 2 else None
        keys.append(f"{PROFILE}.{name}.{place[0]}" + (f".{axis}" if axis else ""))
    sensitivity = Sensitivity(mechanism, keys, [*QUANTITIES, "B", "dB_dq", "torque"])
    motion = sk.trace(mechanism, samples=6)
    rows = np.flatnonzero(~motion.failed & (motion.sample % 2 == 1))
    motion = motion.rows(rows)
    values, gradients = sensitivity.at(samples_of(motion), motion.values)
    given = document_of(mechanism, "rad").data["pairs"]["contact"]["profiles"]["cam"]
    column = mechanism.variable_names.index("s_contact_cam")
    cam_curve = geometry_of(mechanism).joints[2].first
    with mp.workdps(DIGITS):
        nominal = Cam(given)
        touched = cam_curve.at(motion.values[:, column]).frame[:, :, 2]
        near = [nominal.nearest(point) for point in touched]
        sides = []
        for place in places:
            for sign in (1, -1):
                changed = dict(given)
                item = changed[place[0]] = list(given[place[0]])
                moved = sign * BY_NUMBER
                if len(place) == 3:
                    pair = item[place[1]] = [mp.mpf(x) for x in item[place[1]]]
                    pair[place[2]] += moved
                else:
                    item[place[1]] = mp.mpf(item[place[1]]) + moved
                sides.append(Cam(changed))
        still, wanted = [], []
        for q, u in zip(motion.q, near, strict=True):
            q = mp.mpf(float(q))
            still.append(nominal.motion(q, u))
            made = [cam.motion(q, u) for cam in sides]
            wanted.append(
                [
                    [(a - b) / (2 * BY_NUMBER) for a, b in zip(more, less, strict=True)]
                    for more, less in zip(made[::2], made[1::2], strict=True)
                ]
            )
    still = np.array(still, dtype=float).T
    wanted = np.moveaxis(np.array(wanted, dtype=float), 0, 2)
    apart = values[0] - still[0]
    assert np.allclose(np.exp(1j * (apart - apart[0])), 1.0, atol=1e-12)
    assert values[1:3] == pytest.approx(still[1:], rel=1e-10, abs=1e-10)
    _, rate, change = still
    inertia, stiffness = 0.4, 3.0
    slope = np.stack(
        [
            2.0 * inertia * rate * wanted[:, 1],
            2.0 * inertia * (wanted[:, 1] * change + rate * wanted[:, 2]),
        ],
        axis=1,
    )
    push = stiffness * (values[0] - np.radians(20.0))
    torque = slope[:, 0] * 0.7 + 0.5 * slope[:, 1] * 1.3**2
    torque += stiffness * wanted[:, 0] * rate + push * wanted[:, 1]
    wanted = np.concatenate([wanted, slope, torque[:, None]], axis=1)
    off = np.max(np.abs(gradients - wanted), axis=2) / np.max(np.abs(wanted), axis=2)
    assert np.max(off) < 1e-12


POSED = text_of("posed")
SLID = (
    'pairs.pivot = { type = "R", links = ["frame", "follower"], lonlat = [90.0, 30.0] }\n'
)
ROLLED = (
    'pairs.knee = { type = "R", links = ["follower", "arm"], lonlat = [20.0, 42.0] }\n'
    'pairs.pivot = { type = "R", links = ["frame", "arm"], lonlat = [80.0, 25.0] }\n'
)


@pytest.mark.many
@pytest.mark.parametrize("kind, pairs", [("Cs", SLID), ("Cr", ROLLED)])
def test_profiles_of_a_reference_pose_touch_where_they_are_nearest(kind, pairs, tmp_path):
    """Against differences of mechanisms that deviate and are closed again."""
    text = POSED.replace("TYPE", kind).replace("inputs.shaft", pairs + "inputs.shaft")
    path = tmp_path / "posed.toml"
    path.write_text(text if kind == "Cr" else text.replace(", arm = {}", ""))
    mechanism = sk.load(path)
    driven = "arm" if kind == "Cr" else "follower"
    keys = [f"{PROFILE}.cosines.0", f"{PROFILE}.cosines.2", "pairs.pivot.latitude"]
    quantities = ["theta_pivot", "rate_pivot", f"acceleration_coefficient_{driven}_frame"]
    sensitivity = Sensitivity(mechanism, keys, quantities)
    motion = sk.trace(mechanism, samples=3)
    motion = motion.rows(np.flatnonzero(~motion.failed))
    samples = samples_of(motion)
    _, gradients = sensitivity.at(samples, motion.values)
    step = 2.0**-10
    away = step * np.concatenate([np.eye(3), -np.eye(3), 2 * np.eye(3), -2 * np.eye(3)])
    drawn = sensitivity.scattered(samples, motion.values, away.T)
    one, less, two, twice = np.moveaxis(drawn.reshape(*drawn.shape[:2], 4, 3), 2, 0)
    wanted = (8.0 * (one - less) - (two - twice)) / (12.0 * step)
    wanted = np.moveaxis(wanted, 2, 0)
    scale = np.max(np.abs(wanted), axis=2, keepdims=True)
    assert np.max(np.abs(gradients - wanted) / scale) < 1e-6
