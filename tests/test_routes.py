"""Every route to poles and coefficients against the others.

A route is a way to compute the poles of a mechanism: by the first two great circles of its
plan, by the two best conditioned ones, or by the velocity equations of all loops, in more
digits where double precision is doubtful (routes "best", the default, and "equations").
"""

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
from spherekit.velocities.pole_sequence import PlannedPoles

SHARP = 5e-10
"""Bound of directions (rad) below which a row counts as well conditioned."""
AGREEMENT = 1e-9
"""Largest difference of two routes in such rows, relative to 1 or the largest number."""

MECHANISMS = """four_bar stephenson eight_bar_01 eight_bar_07 eight_bar_12
    double_butterfly shaped_cam two_dof_spm"""


def request_of_all_poles(position_analysis, moving_input):
    """Return the request of all poles and coefficients while one input moves."""
    mechanism = position_analysis.mechanism
    poles = all_poles(len(mechanism.links))
    return request(
        mechanism, moving_input, poles, rates=poles, by_rank=position_analysis.by_rank
    )


def well_conditioned_rows(motion, field_by_route):
    """Return, for each row of a motion, whether every route has sharp poles there.

    A pole that does not exist, because its links do not turn relative to each other, counts
    as sharp.
    """
    is_good = np.ones(len(motion), dtype=bool)
    for field in field_by_route.values():
        is_good &= field.status == Status.OK
        for pole, status in field.pole_status.items():
            error = np.nan_to_num(field.direction_error[pole], nan=1.0)
            is_good &= (status == Status.NO_POLE) | (error < SHARP)
    return is_good


def check_rates(field, reference, rows, rate_scale, change_scale):
    """Assert that the rates of all links, and their derivatives by the input, agree.

    `field` and `reference` are results of two routes; the scales are the largest rate and
    the largest derivative, 1 at least.
    """
    for link in reference.w:
        difference = np.abs(field.w[link] - reference.w[link])[rows]
        assert np.max(difference) < AGREEMENT * rate_scale
        difference = np.abs(field.dw[link] - reference.dw[link])[rows]
        assert np.max(difference) < AGREEMENT * change_scale, link


def check_pole(field, reference, pole, rows, rate_scale, change_scale):
    """Assert that directions and coefficients of a pole agree by two ways of computing.

    A pole is the axis of the relative rotation of two links. Its sense is arbitrary, and
    coefficients change sign with it. Rows without the pole are left out.

    Parameters
    ----------
    field, reference
        Results of two ways to compute poles.
    pole
        The pole, by numbers of its two links.
    rows
        Which rows are compared.
    rate_scale, change_scale
        Largest component of the rate (angular velocity) of any link, and largest component
        of its derivative. Both are at least 1. Differences of velocity coefficients are
        relative to the first, those of acceleration coefficients to the second.
    """
    u = field.direction[pole][rows]
    v = reference.direction[pole][rows]
    exists = np.all(np.isfinite(u) & np.isfinite(v), axis=1)
    u = u[exists]
    v = v[exists]
    sense = np.sign(np.sum(u * v, axis=1))
    assert np.max(np.abs(u - v * sense[:, None]), initial=0.0) < AGREEMENT
    for name, scale in (
        ("velocity_coefficient", rate_scale),
        ("acceleration_coefficient", change_scale),
    ):
        coefficient = getattr(field, name)[pole][rows][exists]
        expected = getattr(reference, name)[pole][rows][exists]
        difference = np.max(np.abs(coefficient - sense * expected), initial=0.0)
        assert difference < AGREEMENT * scale, pole


@pytest.mark.many
@pytest.mark.parametrize("name", MECHANISMS.split())
def test_all_routes_agree_where_all_are_well_conditioned(name):
    """All ways to compute poles and rates of links agree in well conditioned rows.

    A pole is the axis of the relative rotation of two links. A route is a way to compute
    it, by great circles or by the velocity equations, which are the reference here. There
    are 25 samples with each input moving. More than 0.3 of the rows must be well
    conditioned by every route, so that the test compares enough of them.
    """
    position_analysis = PositionAnalysis(sk.load(name), samples=25)
    motion = position_analysis.motion()
    for moving_input in position_analysis.inputs:
        pole_request = request_of_all_poles(position_analysis, moving_input)
        field_by_route = {
            route: evaluate(motion, pole_request, route=route) for route in ROUTES
        }
        rows = well_conditioned_rows(motion, field_by_route)
        assert np.mean(rows) > 0.3
        reference = field_by_route["equations"]
        rates = [np.max(np.abs(w[rows])) for w in reference.w.values()]
        changes = [np.max(np.abs(dw[rows])) for dw in reference.dw.values()]
        scales = max(1.0, *rates), max(1.0, *changes)
        for field in field_by_route.values():
            check_rates(field, reference, rows, *scales)
            for pole in pole_request.poles:
                check_pole(field, reference, pole, rows, *scales)


def nearly_parallel_four_bar():
    """Return a random four-bar with two axes about 1e-9 rad apart, and a small range."""
    axes = random_axes(np.random.default_rng(5), 4)
    axes[1] = axes[0] + 1e-9 * axes[2]
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    four_bar = mechanism_from_chain(FOUR_BAR, axes)
    return replace(four_bar, inputs=(Input(four_bar.inputs[0].pair, 0.0, 1e-3),))


def test_only_the_default_route_computes_ill_conditioned_rows_in_quad_precision():
    """With two nearly parallel axes, the default route has quad precision in all rows.

    A route is a way to compute the poles (axes of relative rotation) and rates of links.
    The routes "first" and "conditioned" construct each pole as the intersection of two
    great circles. Through each pole several great circles are known. "first" takes the
    first two of them, "conditioned" the two whose intersection is best conditioned. Here
    both routes fail in double precision. Their status says so, and their rates are NaN.
    """
    # Without a search for other modes than that of the reference pose.
    position_analysis = PositionAnalysis(
        nearly_parallel_four_bar(), search=False, samples=2
    )
    pole_request = request_of_all_poles(position_analysis, position_analysis.inputs[0])
    motion = position_analysis.motion()
    by_default = evaluate(motion, pole_request)
    assert np.all(by_default.status == Status.OK)
    assert np.all(by_default.is_quad_precision)
    for route in ("first", "conditioned"):
        field = evaluate(motion, pole_request, route=route)
        assert not np.any(field.is_quad_precision)
        assert np.all(field.status == Status.ILL_CONDITIONED)
        # Angular velocities by number of the link, from 0. The coupler is the third one.
        coupler = 2
        assert np.all(np.isnan(field.w[coupler]))


def test_a_wrong_name_of_a_route_is_refused_with_the_nearest_one():
    position_analysis = PositionAnalysis(
        nearly_parallel_four_bar(), search=False, samples=2
    )
    pole_request = request_of_all_poles(position_analysis, position_analysis.inputs[0])
    motion = position_analysis.motion()
    with pytest.raises(SolveError, match='"frist" is not a route; did you mean "first"'):
        evaluate(motion, pole_request, route="frist")


def test_the_routes_best_and_equations_differ_only_in_the_rows_they_count():
    """Both solve the velocity equations, and repeat doubtful rows in quad precision.

    Nearly parallel axes make all rows of the first four-bar doubtful, and none of the other
    one. The route "equations" counts all rows as computed by the equations.
    """
    cases = (nearly_parallel_four_bar(), True), (sk.load("four_bar"), False)
    for mechanism, is_doubtful in cases:
        position_analysis = PositionAnalysis(mechanism, search=False, samples=2)
        pole_request = request_of_all_poles(position_analysis, position_analysis.inputs[0])
        motion = position_analysis.motion()
        best = evaluate(motion, pole_request)
        by_equations = evaluate(motion, pole_request, route="equations")
        assert np.all(best.is_quad_precision == is_doubtful)
        assert np.all(by_equations.is_quad_precision)
        for link, w in best.w.items():
            np.testing.assert_array_equal(by_equations.w[link], w)
        for pole, direction in best.direction.items():
            np.testing.assert_array_equal(by_equations.direction[pole], direction)


def test_great_circles_of_a_pole_avoid_a_pole_that_is_unknown_in_a_row():
    """The two great circles that determine a pole do not use a pole that is unknown.

    A pole is the axis of the relative rotation of two links. For each third link, the pole
    of links 0 and 1 lies on a great circle: that through the poles of both with the third
    link. `great_circles` chooses two of these circles in each row (sample in one mode).

    In row 0 the pole of links 0 and 2 is made unknown: its direction is NaN. The circle of
    the third link 2 is then unknown, and circles of other links must be chosen.
    """
    position_analysis = PositionAnalysis(sk.load("stephenson"), samples=5)
    motion = position_analysis.motion()
    (driven,) = position_analysis.mechanism.inputs
    plan = request_of_all_poles(position_analysis, driven.pair).plan
    planned_poles = PlannedPoles(plan, motion)
    unknown_pole = 0, 2
    planned_poles.directions[unknown_pole][:, 0] = np.nan
    planned_poles.errors[unknown_pole][0] = np.nan
    # Unit normals of the circles. They are perpendicular to the pole, and none is NaN.
    circles = planned_poles.great_circles((0, 1))
    along_pole = circles @ planned_poles.directions[0, 1].T[:, :, None]
    assert np.max(np.abs(along_pole)) < 1e-9
    # They are two different circles.
    assert np.all(np.linalg.norm(np.cross(circles[:, 0], circles[:, 1]), axis=1) > 1e-6)
