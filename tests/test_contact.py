"""Rolling and sliding contact: cams that are four-bars, exact derivatives, random chains."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from chains import joints, mechanism, random_axes, random_chain
from oracles import off_axis
from test_poles import field_of

import spherekit as sk
from spherekit.conventions import Status
from spherekit.errors import ModelError, PlanError
from spherekit.model.mechanism import (
    Input,
    LinkSizes,
    Mechanism,
    Pair,
    PoseGeometry,
    Profile,
    SizeGeometry,
)
from spherekit.motion.motion import Tracer
from spherekit.planning.poles import all_poles, plan
from spherekit.rates.request import request

DEGREE = np.pi / 180


def at(colatitude):
    """Return the direction at this colatitude from z, towards y (as link arcs lie)."""
    return (0.0, float(np.sin(colatitude)), float(np.cos(colatitude)))


def cam(ground, profile, follower, contact="external"):
    """Return a cam (link 2) and an oscillating follower (link 3) touching it."""
    return Mechanism(
        "cam",
        "1",
        ("1", "2", "3"),
        (
            Pair("12", "R", ("1", "2")),
            Pair("13", "R", ("1", "3")),
            Pair("23", "Cs", ("2", "3"), (profile, follower), contact),
        ),
        SizeGeometry(
            {"1": LinkSizes(("12", "13"), (ground,)), "2": LinkSizes(("12",)), "3": LinkSizes(("13",))}
        ),
        inputs=(Input("12", 0.0, 2 * np.pi),),
    )


def four_bar(ground, crank, coupler, rocker):
    """Return the four-bar with the same reference directions as `cam`."""
    return Mechanism(
        "four_bar",
        "1",
        ("1", "2", "3", "4"),
        (
            Pair("12", "R", ("1", "2")),
            Pair("13", "R", ("1", "3")),
            Pair("24", "R", ("2", "4")),
            Pair("34", "R", ("3", "4")),
        ),
        SizeGeometry(
            {
                "1": LinkSizes(("12", "13"), (ground,)),
                "2": LinkSizes(("12", "24"), (crank,)),
                "3": LinkSizes(("13", "34"), (rocker,)),
                "4": LinkSizes(("24", "34"), (coupler,)),
            }
        ),
        inputs=(Input("12", 0.0, 2 * np.pi),),
    )


GROUND, ECCENTRICITY, DISC, ROLLER, ARM = (x * DEGREE for x in (60.0, 10.0, 25.0, 12.0, 45.0))


@pytest.mark.parametrize("kind", ["roller", "flat"])
def test_circular_cam_is_a_four_bar(kind):
    """Position, first and second derivatives over a turn, to 1e-11."""
    disc = Profile("circle", at(ECCENTRICITY), DISC)
    if kind == "roller":
        made = cam(GROUND, disc, Profile("circle", at(ARM), ROLLER))
        equal = four_bar(GROUND, ECCENTRICITY, DISC + ROLLER, ARM)
    else:
        made = cam(GROUND, disc, Profile("great_circle", at(ARM + np.pi / 2)))
        equal = four_bar(GROUND, ECCENTRICITY, DISC + np.pi / 2, ARM + np.pi / 2)
    motion, field = field_of(made, samples=73)
    same, other = field_of(equal, samples=73)
    assert np.all(same.status == Status.OK)
    found = 0
    for branch in motion.branches:
        rows = motion.branch == branch.number
        if not np.all(motion.status[rows] == Status.OK):
            continue
        psi = motion.values[rows, 1]
        for twin in same.branches:
            twins = same.branch == twin.number
            if np.max(np.abs(np.exp(1j * psi) - np.exp(1j * same.values[twins, 1]))) < 1e-3:
                found += 1
                gap = np.exp(1j * psi) - np.exp(1j * same.values[twins, 1])
                assert np.max(np.abs(gap)) < 1e-11
                for name in ("rate", "rate_dq"):
                    ours, theirs = getattr(field, name), getattr(other, name)
                    assert np.max(np.abs(ours[0, 2][rows] - theirs[0, 2][twins])) < 1e-11
                w = field.rate[1, 2][rows, None] * field.direction[1, 2][rows]
                v = other.rate[1, 2][twins, None] * other.direction[1, 2][twins]
                assert np.max(np.abs(w - v)) < 1e-11
                dw = field.rate_dq[1, 2][rows] ** 2
                assert np.max(np.abs(dw - other.rate_dq[1, 2][twins] ** 2)) < 1e-10
    assert found >= 1


SHAPE = Profile(
    "fourier", (0.0, 0.0, 1.0), cosines=(25 * DEGREE, 4 * DEGREE, 3 * DEGREE), sines=(0.0, 0.0, 1.0 * DEGREE)
)


def test_non_circular_cam_against_fifty_digits():
    """First and second derivatives of the follower's angle, contact, and the pole's plane."""
    made = cam(GROUND, SHAPE, Profile("circle", at(ARM), ROLLER))
    motion, field = field_of(made, samples=13)
    whole = [b for b in motion.branches if np.all(motion.status[motion.branch == b.number] == 0)]
    assert whole
    rows = np.flatnonzero(motion.branch == whole[0].number)
    assert np.max(motion.residual[rows]) < 1e-13
    normal = motion.axes[rows, 2]
    assert np.max(np.abs(np.sum(normal * field.direction[1, 2][rows], axis=1))) < 1e-13
    mpmath.mp.dps = 40
    cos, sin, pi = mpmath.cos, mpmath.sin, mpmath.pi
    degree = pi / 180

    def point(a):
        c = degree * (25 + 4 * cos(a) + 3 * cos(2 * a) + sin(2 * a))
        return sin(c) * cos(a), sin(c) * sin(a), cos(c)

    def centre_in_cam(theta, psi):
        arm, ground = 45 * degree, 60 * degree
        # link frames: z the axis, angles from the arcs between the ground axes
        x, y, z = -sin(arm) * sin(psi), sin(arm) * cos(psi), cos(arm)
        # reference at 13 points to 12, at 12 to 13; ground frame: z = 12, y towards 13
        east, north = -x, -y
        gx = east
        gy = sin(ground) * z + cos(ground) * north
        gz = cos(ground) * z - sin(ground) * north
        # turn back by theta about 12; the cam's y lies at theta from the arc to 13
        return cos(theta) * gx + sin(theta) * gy, cos(theta) * gy - sin(theta) * gx, gz

    def follower(theta, start):
        def gap(psi, a):
            c = centre_in_cam(theta, psi)
            p = point(a)
            h = mpmath.mpf(10) ** -18
            dp = [(u - v) / (2 * h) for u, v in zip(point(a + h), point(a - h), strict=True)]
            return (
                sum(u * v for u, v in zip(p, c, strict=True)) - cos(12 * degree),
                sum(u * v for u, v in zip(dp, c, strict=True)),
            )

        return mpmath.findroot(gap, start, tol=1e-30)

    checked = 0
    for row in rows[1::3]:
        frame = motion.states.first[row, 2, :, 2]
        start = (float(motion.values[row, 1]), float(np.arctan2(frame[1], frame[0])))
        theta = mpmath.mpf(float(motion.q[row]))
        found = follower(theta, start)
        if abs(float(found[0]) - start[0]) > 1e-6:
            continue
        assert abs(float(found[0]) - start[0]) < 1e-12
        h = mpmath.mpf(10) ** -8
        psi = [follower(theta + k * h, (found[0], found[1]))[0] for k in (-2, -1, 0, 1, 2)]
        first = (psi[0] - 8 * psi[1] + 8 * psi[3] - psi[4]) / (12 * h)
        second = (-psi[0] + 16 * psi[1] - 30 * psi[2] + 16 * psi[3] - psi[4]) / (12 * h * h)
        assert abs(float(first) - field.rate[0, 2][row]) < 1e-10
        assert abs(float(second) - field.rate_dq[0, 2][row]) < 1e-10
        checked += 1
    assert checked >= 3


def null_space_with_contact(made, motion, row):
    """Return link rates and the relative gap from the velocity equations, one row."""
    blocks = []
    count = len(made.links)
    for k, (pair, (a, b)) in enumerate(zip(made.pairs, made.ends, strict=True)):
        u = motion.axes[row, k]
        across = u[None] if pair.type == "Cs" else np.eye(3) - np.outer(u, u)
        block = np.zeros((len(across), 3 * count))
        block[:, 3 * b : 3 * b + 3] = across
        block[:, 3 * a : 3 * a + 3] = -across
        blocks.append(block)
    _, values, right = np.linalg.svd(np.vstack(blocks)[:, 3:])
    w = np.vstack([np.zeros(3), right[3 * count - 4].reshape(-1, 3)])
    return w, values[3 * count - 5] / values[0]


def random_mixed(random, links):
    """Return a random chain in which pairs became rolling and binary links sliding contact."""
    while True:
        edges = random_chain(random, links)
        degree = {k: sum(k in e for e in edges) for k in range(1, links + 1)}
        kinds = dict.fromkeys(edges, "R")
        gone = set()
        for link in random.permutation(np.arange(2, links + 1)):
            near = [e for e in kinds if link in e]
            if degree[link] != 2 or len(gone) >= 2 or any(kinds[e] != "R" for e in near):
                continue
            a, b = (next(x for x in e if x != link) for e in near)
            if (min(a, b), max(a, b)) in kinds or random.random() < 0.4:
                continue
            for e in near:
                del kinds[e]
            kinds[min(a, b), max(a, b)] = "Cs"
            gone.add(link)
        for e in list(kinds):
            if kinds[e] == "R" and random.random() < 0.2 and 1 not in e:
                kinds[e] = "Cr"
        first = next((e for e in kinds if 1 in e and kinds[e] == "R"), None)
        if first is None or len(kinds) < 3:
            continue
        made = touching(random, kinds, first)
        try:
            plan(made)
        except PlanError:
            continue
        return made


def touching(random, kinds, driven):
    """Return a mechanism whose circles touch at random points of a reference pose."""
    pairs, axes = [], {}
    for (a, b), kind in kinds.items():
        name = f"p{a}_{b}"
        if kind == "R":
            axes[name] = tuple(random_axes(random, 1)[0])
            pairs.append(Pair(name, "R", (str(a), str(b))))
            continue
        p, other = random_axes(random, 2)
        n = np.cross(p, other)
        n /= np.linalg.norm(n)
        d1, d2 = random.uniform(0.3, 1.0, 2)
        circles = (
            Profile("circle", tuple(np.cos(d1) * p + np.sin(d1) * n), float(d1)),
            Profile("circle", tuple(np.cos(d2) * p - np.sin(d2) * n), float(d2)),
        )
        pairs.append(Pair(name, kind, (str(a), str(b)), circles))
    links = tuple(str(k) for k in sorted({x for e in kinds for x in e}))
    return Mechanism(
        "mixed",
        "1",
        links,
        tuple(pairs),
        PoseGeometry(axes),
        inputs=(Input(f"p{driven[0]}_{driven[1]}", -1e-3, 1e-3),),
    )


@pytest.mark.slow
def test_random_mixed_mechanisms_against_the_null_space(capsys):
    """R, Cr and Cs in single-freedom chains of 4 to 12 links: all poles to 1e-9."""
    random = np.random.default_rng(2025)
    judged = blocks = cases = 0
    for number in range(400):
        made = random_mixed(random, [6, 8, 10, 12][number % 4])
        planned = plan(made)
        blocks += bool(planned.blocks)
        cases += any(getattr(step, "contacts", ()) for step in planned.steps)
        motion, field = field_of(made, samples=3, search=False)
        if motion.status[1] != Status.OK:
            continue
        w, gap = null_space_with_contact(made, motion, 1)
        if gap < 1e-6:
            continue
        a, b = made.ends[motion.input]
        driven = (w[b] - w[a]) @ motion.axes[1, motion.input]
        judged += 1
        for i, j in all_poles(len(made.links)):
            vector = w[j] - w[i]
            size = np.linalg.norm(vector)
            if size > 1e-4:
                assert off_axis(field.direction[i, j][1], vector) < 1e-9
            if abs(driven) > 1e-3 and size > 1e-4:
                ours = field.rate[i, j][1] * field.direction[i, j][1]
                scale = max(1.0, np.linalg.norm(w / driven))
                assert np.linalg.norm(ours - vector / driven) / scale < 1e-9
    print(f"{judged} judged, {blocks} with irreducible parts, {cases} with contact lines")
    assert judged > 380


def test_derivatives_of_mixed_mechanisms_by_taylor_remainder():
    random = np.random.default_rng(7)
    for _ in range(12):
        made = random_mixed(random, 8)
        tracer = Tracer(replace(made, inputs=(Input(made.inputs[0].pair, -0.02, 0.02),)), search=False)
        poles = all_poles(len(made.links))
        asked = request(tracer.mechanism, made.inputs[0].pair, poles, poles)
        steps = np.array([0.0, 1e-2, 1e-3, 1e-4])
        from spherekit.rates.field import evaluate

        field = evaluate(tracer.at(steps), asked)
        if np.any(field.status != Status.OK):
            continue
        for pole in poles:
            rate = field.rate[pole]
            rest = np.abs(rate - rate[0] - steps * field.rate_dq[pole][0])[1:]
            size = max(1.0, abs(rate[0]), abs(field.rate_dq[pole][0]))
            assert rest[2] < 0.02 * rest[1] + 1e-11 * size
