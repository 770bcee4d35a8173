"""Checks that wheels in mesh turn as a certificate says, without spherekit.

Circles about a and b that touch roll on each other if their links' angular velocities
differ by a vector along the contact only, which is at u a + v b for numbers u and v. Each
of these products is a trigonometric polynomial of degree 2 in every angle between the
wheels, so that values at five angles of each bound it everywhere.
"""

import itertools

import numpy as np
from flint import arb, ctx
from oracles.proof_checker import Sizes, ball, matrix, need, size, spin

TOUCHING = 1e-9
"""Decimal numbers say only nearly that a wheel's carrier is where its circle is."""
NODES = 5
NORM = 2.0
"""Norm of interpolation at five evenly spaced angles, rounded up."""
MOST = 6
"""Pairs on the way from one wheel to the other."""


class Wheels:
    """The links of a file that hang on its R pairs without a loop."""

    def __init__(self, certificate):
        self.sizes = Sizes(
            certificate["mechanism"], certificate["tolerance_rad"], None, True
        )
        data = self.sizes.data
        self.inputs, self.columns = list(data["inputs"]), certificate["inputs"]
        need(sorted(self.inputs) == sorted(self.columns), "other inputs")
        self.rates = {
            name: [arb(int(name == other)) for other in self.columns]
            for name in self.columns
        }
        for row in certificate["ratios"]:
            need(row["pair"] not in self.rates, "a pair twice")
            need(len(row["ratios"]) == len(self.columns), "other inputs")
            need(0 <= row["off"] < 1e-12, "ratios that are no numbers")
            self.rates[row["pair"]] = [arb(r, row["off"]) for r in row["ratios"]]
        need(sorted(self.rates) == sorted(self.sizes.ends), "pairs are missing")
        self.followers = [row["pair"] for row in certificate["ratios"]]
        self.contacts = [n for n, p in data["pairs"].items() if p["type"] == "Cr"]
        need(len(self.sizes.ends) == len(self.sizes.links) - 1, "a loop of R pairs")

    def way(self, start, goal):
        """The pairs from one link to another, each with the side that is left."""
        reached, waiting = {start: []}, [start]
        for link in waiting:
            for pair, ends in self.sizes.ends.items():
                further = ends[1 - ends.index(link)] if link in ends else None
                if further is not None and further not in reached:
                    reached[further] = [*reached[link], (pair, ends.index(link))]
                    waiting.append(further)
        need(goal in reached, "wheels that no pairs join")
        return reached[goal]

    def sides(self, contact):
        """Centre and numbers in the ratio of the sines of both circles, and their arc."""
        item = self.sizes.data["pairs"][contact]
        inner = item.get("contact", "external") == "internal"
        if "axes" not in item:
            (a, r), (b, s) = (self.sizes.circle(contact, link) for link in item["links"])
            return a, b, r.sin(), s.sin(), (r - s if inner else r + s), inner
        need(item.keys() & {"teeth", "half_angles"}, "cones of no size")
        on = [
            self.sizes.frame(n, k) for n, k in zip(item["axes"], item["links"], strict=True)
        ]
        a, b = (frame[:, 2] for frame in on)
        one, other = (self.sizes.ends[name] for name in item["axes"])
        carrier = next(link for link in one if link in other)
        one, other = (self.sizes.frame(name, carrier)[:, 2] for name in item["axes"])
        normal = np.cross(one, other)
        arc = arb.atan2((normal @ normal).sqrt(), one @ other)
        if "teeth" in item:
            first, second = (arb(int(count)) for count in item["teeth"])
            return a, b, first, second, arc, inner
        half = self.sizes.angle(item["half_angles"][0])
        return a, b, half.sin(), (half - arc if inner else arc - half).sin(), arc, inner

    def slips(self, contact, angles):
        """By how much centres are apart from touching, and by input the slip of wheels.

        For each follower too: what a rate of it alone adds.
        """
        first, second = self.sizes.data["pairs"][contact]["links"]
        a, b, u, v, arc, inner = self.sides(contact)
        place, turning = ball(np.eye(3)), {}
        for (pair, side), angle in zip(self.way(first, second), angles, strict=True):
            ends = self.sizes.ends[pair]
            before = self.sizes.frame(pair, ends[side])
            after = self.sizes.frame(pair, ends[1 - side])
            sense = -1 if side else 1
            s, c = angle.sin_cos()
            turning[pair] = sense * (place @ before[:, 2])
            place = place @ before @ spin(c, sense * s, 1) @ after.T
        far = place @ b
        line = (-v if inner else v) * a + u * far
        slip = {pair: np.cross(axis, line) for pair, axis in turning.items()}
        return a @ far - arc.cos(), slip


def check_wheels(certificate):
    """Show that wheels roll without slip at the ratios given, and at no others."""
    ctx.prec = 80
    wheels = Wheels(certificate)
    table = []
    for contact in wheels.contacts:
        first, second = wheels.sizes.data["pairs"][contact]["links"]
        way = wheels.way(first, second)
        need(len(way) <= MOST, "too many pairs between two wheels")
        allowed = TOUCHING / NORM ** len(way)
        nodes = [2 * arb.pi() * k / NODES for k in range(NODES)]
        for angles in itertools.product(nodes, repeat=len(way)):
            gap, slip = wheels.slips(contact, angles)
            need(abs(gap) < allowed, "circles that do not touch")
            total = sum(np.outer(slip[pair], wheels.rates[pair]) for pair in slip)
            need(np.all(size(total) < allowed), "wheels that slip")
        nothing = ball(np.zeros(3))
        table.append(np.stack([slip.get(p, nothing) for p in wheels.followers], axis=1))
    every = np.concatenate(table)
    need(not matrix(every.T @ every).det().contains(0), "ratios that may be others")
