"""Bounds of directions, rates and derivatives, against many digits where numbers are round.

The four-bars are those of equal or supplementary arcs, which fold flat: beside that place
the closure Jacobian is nearly singular. Their reference is written here, in many digits.
"""

import mpmath as mp
import numpy as np
import pytest
from exact_four_bar import cross, dot
from random_mechanisms import random_mechanism
from refusals import text_of
from special_mechanisms import special_mechanism
from stated_errors import KINDS, evaluate, judged_special, stated

import spherekit as sk
from spherekit.conventions import EPS
from spherekit.motion.motion import PositionAnalysis
from spherekit.planning.poles import all_poles
from spherekit.rates.request import request

FOUR_BAR = text_of("special")
"""Four-bars as files state them, in decimal degrees."""

ARCS = [(90, 90, 90, 90), (40, 70, 60, 50), (60, 120, 45, 135), (50, 50, 50, 50)]


def written(tmp_path, arcs, extra=""):
    path = tmp_path / "special.toml"
    path.write_text(FOUR_BAR.format(*arcs) + extra)
    return sk.load(path)


def turned(axis, angle, vector):
    """Rodrigues' formula in mpmath."""
    c, s = mp.cos(angle), mp.sin(angle)
    across = cross(axis, vector)
    along = sum(a * b for a, b in zip(axis, vector, strict=True)) * (1 - c)
    return [c * v + s * w + along * a for v, w, a in zip(vector, across, axis, strict=True)]


def output(arcs, q, near):
    """The pole axis of links 3 and 1, and its rate, in many digits from decimal degrees.

    Axes lie as the package lays them: 41 on z of link 1, 21 in the half-plane of positive
    y. The circles on which axis 43 may lie about 41 and 32 meet on two sides; `near` (3,)
    says on which.
    """
    a1, a2, a3, a4 = (mp.mpf(a) * mp.pi / 180 for a in arcs)
    u41, u21 = [mp.mpf(0), mp.mpf(0), mp.mpf(1)], [mp.mpf(0), mp.sin(a1), mp.cos(a1)]
    toward = cross(cross(u21, u41), u21)
    size = mp.sqrt(dot(toward, toward))
    tangent = [x / size for x in toward]
    start = [mp.cos(a2) * u + mp.sin(a2) * t for u, t in zip(u21, tangent, strict=True)]
    u32 = turned(u21, q, start)
    c = dot(u41, u32)
    x = (mp.cos(a4) - c * mp.cos(a3)) / (1 - c * c)
    y = (mp.cos(a3) - c * mp.cos(a4)) / (1 - c * c)
    normal = cross(u41, u32)
    z = mp.sqrt((1 - x * x - y * y - 2 * x * y * c) / (1 - c * c))
    sides = [
        [x * u + y * v + s * z * w for u, v, w in zip(u41, u32, normal, strict=True)]
        for s in (1, -1)
    ]
    u43 = max(sides, key=lambda u: dot(u, near))
    along = cross(cross(u21, u32), cross(u41, u43))
    length = mp.sqrt(dot(along, along))
    pole = [v / length for v in along]
    arm = cross(pole, u32)  # axis 32 moves as part of link 2 and of link 3
    return pole, dot(cross(u21, u32), arm) / dot(arm, arm)


@pytest.mark.parametrize("arcs", ARCS)
def test_directions_and_rates_beside_a_fold_lie_within_their_bounds(tmp_path, arcs):
    """Pole 31, its rate and the rate's derivative (a central difference in 50 digits)."""
    made = written(tmp_path, arcs)
    beside = np.array([1e-1, 1e-2, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5, 1e-7])
    path = np.pi - beside
    result = sk.run(made, "poles:only=31+43", path=path[:, None])
    frame = result.frame()
    ok = 0
    with mp.workdps(50):
        for _, row in frame[frame["link"] == "3"].iterrows():
            if row["status"] != "OK":
                assert row["status"] in ("AT_SINGULARITY", "ILL_CONDITIONED")
                continue
            axis = frame[
                (frame["sample"] == row["sample"])
                & (frame["assembly_mode"] == row["assembly_mode"])
                & (frame["link"] == "4")
            ].iloc[0]
            near = [axis[k] for k in ("ux", "uy", "uz")]
            given = [row[k] for k in ("ux", "uy", "uz")]
            q, step = mp.mpf(row["q"]), mp.mpf(10) ** -15
            pole, rate = output(arcs, q, near)
            slope = output(arcs, q + step, near)[1] - output(arcs, q - step, near)[1]
            side = 1 if dot(pole, given) > 0 else -1
            apart = [side * p - g for p, g in zip(pole, given, strict=True)]
            assert mp.sqrt(dot(apart, apart)) <= row["error_bound"]
            for name, exact, more in (
                ("velocity_coefficient", rate, 0.0),
                ("acceleration_coefficient", slope / (2 * step), 1e-18),
            ):
                assert abs(side * exact - row[name]) <= row[f"{name}_error_bound"] + more
            ok += 1
    assert ok >= 6


def test_what_follows_from_rates_in_doubt_has_a_status(tmp_path):
    made = written(tmp_path, ARCS[0], MASSES)
    path = np.pi - np.array([1e-1, 1e-2, 1e-4])
    frame = sk.run(made, "eksergian", path=path[:, None], assembly_mode=0).frame(
        "eksergian"
    )
    assert list(frame["status"]) == ["OK", "OK", "ILL_CONDITIONED"]
    assert np.isnan(frame["B"].iloc[-1]) and np.all(np.isfinite(frame["B"].iloc[:2]))


MASSES = """
[mass.3]
tensor = [[2.0, 0.0, 0.0], [0.0, 1.9, 0.0], [0.0, 0.0, 0.3]]
"""


@pytest.mark.parametrize(
    "seeds", [range(12), pytest.param(range(12, 400), marks=pytest.mark.long)]
)
def test_special_geometry_keeps_to_what_is_stated(seeds):
    """By the float64 numbers and by the decimal degrees, every number of every row."""
    judged, marked, worst = 0, 0, 0.0
    for seed in seeds:
        _, found = judged_special(seed)
        for kind in KINDS:
            assert np.all(found.parts(kind) <= 1.0), (seed, kind)
        assert found.silent == 0 and found.unknown == 0, seed
        judged += found.numbers
        marked += found.marked
        worst = max(worst, float(np.max(found.parts("directions"), initial=0.0)))
    assert judged > 4000 and worst > 0.05
    assert marked < 0.6 * (judged / 6)  # of rows; far from folds none is marked


@pytest.mark.long
@pytest.mark.parametrize("name", sk.mechanisms())
def test_shipped_mechanisms_keep_to_what_is_stated(name):
    """All modes, against the closure equations in 18 digits, or 50 where these say no."""
    made = sk.load(name)
    grid = [3] * len(made.inputs) if len(made.inputs) > 1 else 13
    found = stated(PositionAnalysis(made, search=False, samples=grid))
    assert found.silent == found.unknown == 0
    for kind in KINDS:
        assert np.all(found.parts(kind) <= 1.0), kind


def test_special_mechanisms_are_of_all_kinds():
    kinds = {special_mechanism(seed)[0] for seed in range(200)}
    assert len(kinds) == 21


def test_bounds_of_rows_in_quad_precision_are_those_of_rounding_at_least():
    """An axis of the ground counted as what changes when loops open, by its components."""
    made = random_mechanism(2)[1]
    tracer = PositionAnalysis(made, search=False, samples=3, assembly_mode=0)
    poles = all_poles(len(made.links))
    field = evaluate(tracer.motion(), request(made, made.inputs[0].pair, poles, poles))
    assert np.all(field.by_equations)
    assert all(np.all(error > EPS) for error in field.error.values())
