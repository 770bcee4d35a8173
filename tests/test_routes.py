"""Every route to poles and coefficients against the others."""

from dataclasses import replace

import numpy as np
import pytest
from mechanism_examples.linkages import FOUR_BAR, mechanism_from_chain, random_axes

import spherekit as sk
from spherekit.errors import SolveError
from spherekit.mechanism.elements import Input
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import ROUTES, request

SHARP = 2e-10
"""Bound of directions (rad) below which a row counts as well conditioned."""

MECHANISMS = """four_bar stephenson eight_bar_01 eight_bar_07 eight_bar_12
    double_butterfly shaped_cam two_dof_spm"""


def asked(tracer, driven):
    poles = all_poles(len(tracer.mechanism.links))
    return request(tracer.mechanism, driven, poles, poles, by_rank=tracer.by_rank)


def sharp_rows(motion, wanted, fields):
    """Return the rows at which every route knows every pole well."""
    good = np.ones(len(motion), dtype=bool)
    for field in fields.values():
        good &= field.status == Status.OK
        for pole, codes in field.pole_status.items():
            sharp = np.nan_to_num(field.direction_error[pole], nan=1.0) < SHARP
            good &= (codes == Status.NO_POLE) | sharp
    return good


@pytest.mark.many
@pytest.mark.parametrize("name", MECHANISMS.split())
def test_all_routes_agree_where_all_are_sharp(name):
    tracer = PositionAnalysis(sk.load(name), samples=25)
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
                for name, scale in (("velocity", rate), ("acceleration", change)):
                    both = (getattr(x, f"{name}_coefficient") for x in (field, right))
                    ours, theirs = (part[pole][rows][known] for part in both)
                    gap = np.max(np.abs(ours - side * theirs), initial=0.0)
                    assert gap < 1e-9 * scale, (route, pole)


def test_only_the_best_route_changes_over():
    """With two nearly parallel axes the great circles fail, the equations do not."""
    axes = random_axes(np.random.default_rng(5), 4)
    axes[1] = axes[0] + 1e-9 * axes[2]
    made = mechanism_from_chain(
        FOUR_BAR, axes / np.linalg.norm(axes, axis=1, keepdims=True)
    )
    made = replace(made, inputs=(Input(made.inputs[0].pair, 0.0, 1e-3),))
    tracer = PositionAnalysis(made, search=False, samples=2)
    wanted = asked(tracer, tracer.inputs[0])
    motion = tracer.motion()
    best = evaluate(motion, wanted)
    assert np.all(best.status == Status.OK) and np.all(best.is_quad_precision)
    for route in ("first", "conditioned"):
        field = evaluate(motion, wanted, route=route)
        assert not np.any(field.is_quad_precision)
        assert np.all(field.status == Status.ILL_CONDITIONED)
        assert np.all(np.isnan(field.w[2]))
    with pytest.raises(SolveError, match='no route is "frist"; did you mean "first"'):
        evaluate(motion, wanted, route="frist")
