"""Every route to poles and coefficients against the others, and where the chart ends."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from chains import FOUR_BAR, mechanism, random_axes

import spherekit as sk
from benchmarks.routes import apart, routes
from spherekit.conventions import EPS, Status
from spherekit.errors import SolveError
from spherekit.model.parts import Input
from spherekit.motion.motion import Tracer
from spherekit.planning.poles import all_poles
from spherekit.rates.field import evaluate
from spherekit.rates.gnomonic import REFERENCE, Chart
from spherekit.rates.request import request
from spherekit.rates.routes import ROUTES
from spherekit.rates.signs import SignMemory

SHARP = 2e-10
"""Bound of directions (rad) below which a row counts as well conditioned."""

MECHANISMS = (
    "four_bar",
    "stephenson",
    "eight_bar_01",
    "eight_bar_07",
    "eight_bar_12",
    "double_butterfly",
    "shaped_cam",
    "two_dof_spm",
)


def asked(tracer, driven):
    poles = all_poles(len(tracer.mechanism.links))
    return request(tracer.mechanism, driven, poles, poles, by_rank=tracer.by_rank)


def sharp_rows(motion, wanted, fields):
    """Return the rows at which every route knows every pole well."""
    good = np.ones(len(motion), dtype=bool)
    for field in fields.values():
        good &= field.status == Status.OK
        for codes, error in zip(
            field.pole_status.values(), field.error.values(), strict=True
        ):
            known = codes != Status.NO_POLE
            good &= ~known | (np.nan_to_num(error, nan=1.0) < SHARP)
    with np.errstate(all="ignore"):
        chart = Chart(wanted.plan, motion)
        for body in set(wanted.bodies) - set(wanted.plan.ends[wanted.plan.input]):
            good &= np.nan_to_num(chart.ratio(body)[1]) > 1e-3
    return good


@pytest.mark.parametrize("name", MECHANISMS)
def test_all_routes_agree_where_all_are_sharp(name):
    tracer = Tracer(sk.load(name), samples=25)
    motion = tracer.motion()
    for driven in tracer.inputs:
        wanted = asked(tracer, driven)
        fields = {route: evaluate(motion, wanted, route=route) for route in ROUTES}
        rows = sharp_rows(motion, wanted, fields)
        assert np.mean(rows) > 0.3
        right = fields["equations"]
        rate = max(1.0, *(np.max(np.abs(w[rows])) for w in right.w.values()))
        change = max(1.0, *(np.max(np.abs(dw[rows])) for dw in right.dw.values()))
        for route, field in fields.items():
            for link in right.w:
                assert np.max(np.abs(field.w[link] - right.w[link])[rows]) < 1e-9 * rate
                gap = np.abs(field.dw[link] - right.dw[link])[rows]
                assert np.max(gap) < 1e-9 * change, (route, link)
            for pole in wanted.poles:
                u, v = field.direction[pole][rows], right.direction[pole][rows]
                known = np.all(np.isfinite(u) & np.isfinite(v), axis=1)
                u, v = u[known], v[known]
                side = np.sign(np.sum(u * v, axis=1))
                assert np.max(np.abs(u - v * side[:, None]), initial=0.0) < 1e-9
                for ours, theirs, scale in (
                    (field.velocity_coefficient, right.velocity_coefficient, rate),
                    (
                        field.acceleration_coefficient,
                        right.acceleration_coefficient,
                        change,
                    ),
                ):
                    gap = (ours[pole][rows][known]) - side * theirs[pole][rows][known]
                    assert np.max(np.abs(gap), initial=0.0) < 1e-9 * scale, (route, pole)


@pytest.mark.parametrize("route", ROUTES)
def test_blocks_of_samples_give_what_the_whole_gives(route):
    tracer = Tracer(sk.load("four_bar"), samples=41)
    wanted = asked(tracer, "21")
    whole = evaluate(tracer.motion(), wanted, route=route)
    memory = SignMemory()
    parts = [evaluate(motion, wanted, memory, route) for motion in tracer.blocks(size=20)]
    for pole in wanted.poles:
        for k in range(2):
            rows = [part.velocity_coefficient[pole].reshape(2, -1)[k] for part in parts]
            mine = whole.velocity_coefficient[pole].reshape(2, -1)[k]
            np.testing.assert_allclose(np.concatenate(rows), mine, rtol=1e-11)


@pytest.mark.parametrize("name", ["four_bar", "stephenson", "double_butterfly"])
def test_all_great_circles_meet_where_the_equations_say(name):
    jobs, asked_for = routes(name, samples=25)
    assert max(apart(jobs["least_squares"](), *asked_for)) < 1e-9


@pytest.mark.parametrize("route", ["first", "conditioned", "gnomonic"])
def test_derivatives_are_those_of_the_values(route):
    """Taylor: central differences of w approach dw with the square of the step."""
    tracer = Tracer(sk.load("stephenson"), samples=3, search=False)
    wanted = asked(tracer, tracer.inputs[0])
    gaps = []
    for step in (1e-2, 1e-3):
        motion = tracer.at(2.0 + step * np.arange(-1, 2))
        field = evaluate(motion, wanted, route=route)
        differences = [
            (w[2] - w[0]) / (2 * step) - field.dw[link][1] for link, w in field.w.items()
        ]
        gaps.append(np.max(np.abs(differences)))
    assert gaps[1] < 0.02 * gaps[0] < 1e-3


def test_only_the_best_route_changes_over():
    """With two nearly parallel axes the great circles fail, the equations do not."""
    axes = random_axes(np.random.default_rng(5), 4)
    axes[1] = axes[0] + 1e-9 * axes[2]
    made = mechanism(FOUR_BAR, axes / np.linalg.norm(axes, axis=1, keepdims=True))
    made = replace(made, inputs=(Input(made.inputs[0].pair, 0.0, 1e-3),))
    tracer = Tracer(made, search=False, samples=2)
    wanted = asked(tracer, tracer.inputs[0])
    motion = tracer.motion()
    best = evaluate(motion, wanted)
    assert np.all(best.status == Status.OK) and np.all(best.by_equations)
    for route in ("first", "conditioned", "gnomonic"):
        field = evaluate(motion, wanted, route=route)
        assert not np.any(field.by_equations)
        assert np.all(field.status == Status.ILL_CONDITIONED)
        assert np.all(np.isnan(field.w[2]))


def pole_31(axes):
    """Return the direction of P_31 of a four-bar, 50 digits, from its axes (4, 3)."""
    mpmath.mp.dps = 50
    u12, u23, u34, u14 = ([mpmath.mpf(float(x)) for x in u] for u in axes)

    def cross(a, b):
        return [a[k - 2] * b[k - 1] - a[k - 1] * b[k - 2] for k in range(3)]

    vector = mpmath.matrix(cross(cross(u12, u23), cross(u14, u34)))
    return vector / mpmath.norm(vector)


def test_the_chart_loses_digits_towards_its_edge():
    """A line by a point at a distance d from the infinity great circle: 1/d roundings."""
    random = np.random.default_rng(11)
    for d in (1e-1, 1e-3, 1e-5, 1e-7):
        worst = dict.fromkeys(ROUTES, 0.0)
        for _ in range(8):
            axes = random_axes(random, 4)
            across = np.cross(random.normal(size=3), REFERENCE[0])
            across /= np.linalg.norm(across)
            axes[0] = np.cos(d) * across + np.sin(d) * REFERENCE[0]
            tracer = Tracer(mechanism(FOUR_BAR, axes), search=False, samples=3)
            motion = tracer.motion()
            wanted = request(tracer.mechanism, tracer.inputs[0], [(0, 2)])
            exact = pole_31(motion.axes[1])
            for route in ROUTES:
                field = evaluate(motion, wanted, route=route)
                assert field.pole_status[0, 2][1] == Status.OK
                u = [mpmath.mpf(float(x)) for x in field.direction[0, 2][1]]
                gap = min(
                    max(abs(s * a - b) for a, b in zip(exact, u, strict=True))
                    for s in (-1, 1)
                )
                worst[route] = max(worst[route], float(gap))
                assert gap < field.error[0, 2][1]
        chart = worst.pop("gnomonic")
        assert max(worst.values()) < 3e-15
        assert 0.02 * EPS < chart * d < 20.0 * EPS


def test_unknown_route():
    tracer = Tracer(sk.load("four_bar"), samples=3)
    with pytest.raises(SolveError, match='no route is "frist"; did you mean "first"'):
        evaluate(tracer.motion(), asked(tracer, "21"), route="frist")
