"""Reference values against closed forms and equations in 50 digits, written here."""

from dataclasses import replace
from functools import cache
from itertools import product

import mpmath as mp
import numpy as np
import pytest
from helpers.error_bound_checks import KINDS, compare_errors_with_bounds
from mechanism_examples.linkages import mechanism_from_chain
from mechanism_examples.random_mechanisms import random_mechanism
from oracles.exact_four_bar import angle, arcs_of

import spherekit as sk
from spherekit.errors import EngineError, SolveError, SpherekitError
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.proof.ball_forces import exact_inertia
from spherekit.proof.ball_frames import exact_balls
from spherekit.proof.balls import Digits, centre_floats
from spherekit.proof.reference_rows import (
    exact_direction,
    exact_field,
    exact_motion,
    exact_rows_by_input,
)
from spherekit.status import Status
from spherekit.tolerances import EPS
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

FIFTY_DIGITS = Digits(50)
"""Arithmetic with 50 digits, in which reference rows are computed here."""


@pytest.fixture(autouse=True)
def digits():
    """Balls are computed with as many digits as those that are compared."""
    with FIFTY_DIGITS.within():
        yield


def select_good_rows(motion, count):
    """Return a mask (rows,) of rows that are OK, spread evenly over the motion."""
    good = np.flatnonzero(motion.status == Status.OK)
    chosen = np.zeros(len(motion), dtype=bool)
    chosen[good[np.linspace(0, len(good) - 1, count).astype(int)]] = True
    return chosen


@cache
def traced(name, samples=5):
    return sk.trace(sk.load(name), samples=samples)


@pytest.mark.parametrize("name", ["four_bar", "universal_joint"])
def test_reference_rows_of_four_bars_agree_with_the_closed_form(name):
    """The output angle of a four-bar and three of its derivatives are those of a formula.

    `sk.exact_rows` computes rows (one sample in one assembly mode) in 50 digits. The
    formula is that of Di Gregorio 2024. mpmath computes its derivatives by the input from
    differences in 60 digits. The first derivative has about 45 correct digits, the second
    30 and the third 20.

    File and formula measure the output angle from different zeros. So the difference of
    both angles must be the same in all rows, but for whole turns.
    """
    motion = traced(name, 6)
    mechanism = motion.mechanism
    # The first and last of six samples (0 and 360 deg) are left out. There the two modes
    # are mirror images with the same output rate, so the rate could not tell them apart.
    chosen = (motion.sample > 0) & (motion.sample < 5)
    exact = sk.exact_rows(
        motion, chosen, mechanism.pair_number["21"], FIFTY_DIGITS, order=3
    )
    (output_variable,) = mechanism.variables_of(mechanism.pair_number["41"])
    (input_variable,) = mechanism.variables_of(mechanism.pair_number["21"])
    output_axis = exact.axes[:, mechanism.pair_number["41"]]
    output_link = 3  # the number of link 4, counted from 0

    def distance_from_whole_turns(angle_difference):
        turns = angle_difference / (2 * mp.pi)
        return abs(turns - mp.nint(turns))

    with mp.workdps(60):
        arcs = arcs_of(mechanism)
        for assembly_mode in (0, 1):
            rows = np.flatnonzero(motion.assembly_mode[chosen] == assembly_mode)
            offsets = []
            for row in rows:
                q = mp.mpf(float(motion.inputs[chosen][row, 0]))
                assert (
                    distance_from_whole_turns(q - exact.values[row, input_variable]) < 1e-50
                )
                # The angular velocity w of the output link per rate of the input, and its
                # two derivatives by the input, along the output axis.
                rate, rate_dq, rate_ddq = (
                    np.sum(vector[row, output_link] * output_axis[row])
                    for vector in (exact.w, exact.dw, exact.ddw)
                )
                # Taylor coefficients of the angle in both modes of the formula. The one
                # with the rate of the row is its mode.
                series_by_mode = [
                    mp.taylor(lambda x, mode=mode: angle(arcs, x, mode), q, 3)
                    for mode in (0, 1)
                ]
                series = min(series_by_mode, key=lambda item: abs(rate - item[1]))
                # Derivatives are 1, 2 and 6 times the Taylor coefficients.
                assert abs(rate - series[1]) < 1e-45
                assert abs(rate_dq - 2 * series[2]) < 1e-30
                assert abs(rate_ddq - 6 * series[3]) < 1e-20
                assert abs(exact.rates[row, output_variable] - series[1]) < 1e-45
                offsets.append(exact.values[row, output_variable] - series[0])
            for offset in offsets[1:]:
                assert distance_from_whole_turns(offset - offsets[0]) < 1e-46


CHAINS = (
    *("stephenson", "double_butterfly", "two_dof_spm", "five_bar", "planetary_bevel"),
    "shaped_cam",
)


def check_arcs(mechanism, exact):
    """Check that the arcs between joint axes of a link are those of the file, in 50 digits.

    If the file gives sizes of links, these are the arcs from the first axis of a link to
    its others. If the file gives all axes in a reference pose, arcs between any two axes of
    one link follow from that pose.

    Parameters
    ----------
    mechanism
        The mechanism.
    exact
        Reference rows: configurations computed in 50 digits, with the axes (rows, pairs,
        3).
    """
    links = getattr(mechanism.geometry, "links", {})
    pose_axes = getattr(mechanism.geometry, "axes", {})
    pair_number = mechanism.pair_number
    with mp.workdps(50):
        for sizes in links.values():
            first_axis = exact.axes[:, pair_number[sizes.axes[0]]]
            for name, arc in zip(sizes.axes[1:], sizes.arcs, strict=True):
                cosines = np.sum(first_axis * exact.axes[:, pair_number[name]], axis=1)
                expected = mp.cos(mp.mpf(arc))
                assert all(abs(cosine - expected) < 1e-46 for cosine in cosines)

        # The planetary train is over-constrained. The numbers in its file are rounded, so
        # its loops only close up to the rounding of float64.
        tolerance = 1e-14 if mechanism.name == "planetary_bevel" else 1e-46
        for first, second in product(pose_axes, repeat=2):
            first_links = set(mechanism.ends[pair_number[first]])
            second_links = set(mechanism.ends[pair_number[second]])
            if not first_links & second_links:
                continue
            u = mp.matrix([mp.mpf(x) for x in pose_axes[first]])
            v = mp.matrix([mp.mpf(x) for x in pose_axes[second]])
            expected = mp.fdot(u, v) / mp.norm(u) / mp.norm(v)
            exact_first = exact.axes[:, pair_number[first]]
            exact_second = exact.axes[:, pair_number[second]]
            cosines = np.sum(exact_first * exact_second, axis=1)
            assert np.max(np.abs(cosines - expected)) < tolerance


@pytest.mark.many
@pytest.mark.parametrize("name", CHAINS)
def test_reference_rows_satisfy_the_equations_of_every_pair(name):
    """Arcs are those of the file, and relative rates lie along the axes of R pairs.

    Reference rows are configurations and rates computed in 50 digits. The relative rate of
    an input pair is 1 or 0. Derivatives agree with differences of reference rows at inputs
    that differ by about 1e-15. None of these is how the rows are computed.

    The planetary gear train is over-constrained: with the float64 numbers of its file the
    loops close to float64 only. At most two inputs are driven, since more take long.
    """
    motion = traced(name, 5)
    chosen = select_good_rows(motion, 1)
    mechanism = motion.mechanism
    input_pairs = motion.assembly.inputs
    is_over_constrained = name == "planetary_bevel"
    tolerance = 1e-14 if is_over_constrained else 1e-45
    for column, driven in enumerate(input_pairs[:2]):
        exact = sk.exact_rows(motion, chosen, driven, FIFTY_DIGITS)
        assert np.all(exact.status == Status.OK)
        check_arcs(mechanism, exact)
        for k, (pair, (a, b)) in enumerate(
            zip(mechanism.pairs, mechanism.ends, strict=True)
        ):
            if pair.type != "R":
                continue
            relative_rate = exact.w[:, b] - exact.w[:, a]
            axis = exact.axes[:, k]
            assert np.max(np.abs(np.cross(relative_rate, axis))) < tolerance
            if k in input_pairs:
                expected_rate = 1 if k == driven else 0
                rate_along_axis = np.sum(relative_rate * axis, axis=1)
                assert np.max(np.abs(rate_along_axis - expected_rate)) < tolerance

        # A power of 2 that is at least the spacing of float64 numbers of the size of the
        # inputs (2^-52), so that the changed inputs are exact.
        step = 2.0 ** np.ceil(np.log2(np.abs(motion.inputs).max()) - 50)
        inputs_above = motion.inputs.copy()
        inputs_above[:, column] += step
        inputs_below = motion.inputs.copy()
        inputs_below[:, column] -= step
        above = sk.exact_rows(
            replace(motion, inputs=inputs_above), chosen, driven, FIFTY_DIGITS
        )
        below = sk.exact_rows(
            replace(motion, inputs=inputs_below), chosen, driven, FIFTY_DIGITS
        )
        width = exact_balls(inputs_above[chosen][:, column])
        width = width - exact_balls(inputs_below[chosen][:, column])
        # The error of a central difference is about the square of the step, 1e-30, times
        # the third derivative of a rate. A rate is a first derivative of the configuration,
        # so this is a fourth one. With each order, derivatives may grow by the condition
        # number. The factor 1e6 leaves room for other terms of the derivatives.
        truncation = 1e-12 if is_over_constrained else 1e-24 * exact.condition.max() ** 4
        rate_difference = (above.w - below.w) / width[:, None, None]
        assert np.max(np.abs(rate_difference - exact.dw)) < truncation
        # dR/dq R^T is the skew matrix of the rate; its entry (2, 1) is w_x.
        rotation_difference = (above.rotations - below.rotations) / width[
            :, None, None, None
        ]
        spin = rotation_difference @ np.swapaxes(exact.rotations, -1, -2)
        assert np.max(np.abs(spin[..., 2, 1] - exact.w[..., 0])) < truncation


@pytest.mark.slow
def test_a_shaped_cam_of_a_reference_row_touches_its_roller():
    """The centre of the roller is its radius away from the nearest point of the cam.

    The configuration is computed by spherekit in 50 digits (`sk.exact_rows`). Its check is
    written here in mpmath: the colatitude of the cam is a Fourier series of the azimuth a,
    from which follow the nearest point and its arc length. The variable of the contact must
    be this arc length, but for whole lengths of the profile.
    """
    motion = traced("shaped_cam", 5)
    chosen = select_good_rows(motion, 1)
    mechanism = motion.mechanism
    input_pair = mechanism.pair_number["cam_shaft"]
    exact = sk.exact_rows(motion, chosen, input_pair, FIFTY_DIGITS)
    cam, roller = mechanism.pair("contact").profiles
    link_number = mechanism.link_number
    variable = mechanism.variable_names.index("s_contact_cam")
    with mp.workdps(50):
        cosines = [mp.mpf(x) for x in cam.cosines]
        sines = [mp.mpf(x) for x in cam.sines]

        def colatitude(a):
            even = mp.fsum(x * mp.cos(k * a) for k, x in enumerate(cosines))
            odd = mp.fsum(x * mp.sin(k * a) for k, x in enumerate(sines))
            return even + odd

        def colatitude_slope(a):
            even = mp.fsum(-k * x * mp.sin(k * a) for k, x in enumerate(cosines))
            odd = mp.fsum(k * x * mp.cos(k * a) for k, x in enumerate(sines))
            return even + odd

        def arc_speed(a):
            return mp.sqrt(colatitude_slope(a) ** 2 + mp.sin(colatitude(a)) ** 2)

        # The centre of the roller in the frame of the cam.
        centre = np.array([mp.mpf(x) for x in roller.centre])
        centre = centre / mp.sqrt(np.sum(centre * centre))
        follower_rotation = exact.rotations[0, link_number["follower"]]
        cam_rotation = exact.rotations[0, link_number["cam"]]
        centre = cam_rotation.T @ follower_rotation @ centre

        def cosine_of_distance(a):
            c = colatitude(a)
            point = [mp.sin(c) * mp.cos(a), mp.sin(c) * mp.sin(a), mp.cos(c)]
            return np.sum(np.array(point) * centre)

        turn = 2 * mp.pi
        start = max((turn * k / 36 for k in range(36)), key=cosine_of_distance)
        # mpmath applies `tol` to the square of the function.
        nearest = mp.findroot(
            lambda a: mp.diff(cosine_of_distance, a), (start, start + 0.01), tol=1e-60
        )
        expected_cosine = mp.cos(mp.mpf(roller.radius))
        assert abs(cosine_of_distance(nearest) - expected_cosine) < 1e-40

        arc_length = mp.quad(arc_speed, mp.linspace(0, nearest % turn, 5))
        whole_length = mp.quad(arc_speed, mp.linspace(0, turn, 9))
        revolutions = (exact.values[0, variable] - arc_length) / whole_length
        assert abs(revolutions - mp.nint(revolutions)) < 1e-20


def test_a_failed_or_wrong_row_has_no_reference():
    """Only rows near a solution of the closure equations have a reference.

    The reference of a row (one sample in one assembly mode) is this solution in many
    digits. It must be within 1e-6 rad of the row, or within its error bound. The distance
    is stated in any case. Here row 0 has failed. Row 1 is off by 1e-4 rad in all variables
    but the input, and row 2 by 1e-9 rad in one variable.
    """
    motion = traced("four_bar", 5)
    driven = motion.assembly.inputs[0]
    chosen = np.ones(len(motion), dtype=bool)
    status = motion.status.copy()
    status[0] = Status.OUT_OF_REACH
    values = motion.values.copy()
    values[0] = np.nan
    values[1, 1:] += 1e-4
    values[2, 1] += 1e-9
    changed_motion = replace(motion, values=values, status=status)
    exact = sk.exact_rows(changed_motion, chosen, driven)
    assert exact.status[0] == Status.OUT_OF_REACH
    assert exact.status[1] == Status.MODE_LOST
    assert exact.distance[1] == pytest.approx(1e-4, rel=1e-3)
    assert np.all(exact.status[2:] == Status.OK)
    assert exact.distance[2] == pytest.approx(1e-9, rel=1e-3)
    # Rows without a reference have no angular velocities w.
    assert np.all(np.isnan(exact.w[:2].astype(float)))


def test_rows_with_exchanged_modes_have_a_reference():
    """A row is compared with the nearest solution, whichever mode it is said to have."""
    motion = traced("four_bar", 5)
    driven = motion.assembly.inputs[0]
    chosen = np.ones(len(motion), dtype=bool)
    exchanged = replace(motion, values=np.roll(motion.values, motion.samples, axis=0))
    assert np.all(sk.exact_rows(exchanged, chosen, driven).status == Status.OK)


def four_bar_with_dead_centre():
    """Return the position analysis of a four-bar, and its input (rad) at a dead centre.

    The four-bar is driven by its rocker (pair 41), which stops at a dead centre. Bisection
    between 312.5 and 314.5 degrees finds the last input at which the loop closes.
    """
    position_analysis = PositionAnalysis(sk.load("four_bar").with_inputs("41"))
    low, high = np.radians([312.5, 314.5])
    for _ in range(60):
        middle = 0.5 * (low + high)
        if position_analysis.at(np.array([middle])).status[0] == Status.OK:
            low = middle
        else:
            high = middle
    return position_analysis, low


def test_near_a_dead_centre_the_reference_is_right_or_missing():
    """References next to a dead centre, where two assembly modes meet and end.

    A reference is the solution of a row in 50 digits. The inputs are 1e-2 to 1e-14 rad
    before the dead centre that `four_bar_with_dead_centre` finds. Each has a row in both
    modes. At most two of these ten rows may have no reference. A reference must be nearer
    to its row than a fifth of the gap between the modes. Its distance is at most 100
    roundings times the condition number, which grows towards the dead centre. Beyond the
    dead centre the loop does not close, so there is no reference.
    """
    position_analysis, dead_centre = four_bar_with_dead_centre()
    distances_rad = 10.0 ** -np.array([2.0, 5.0, 8.0, 10.0, 14.0])
    motion = position_analysis.at(dead_centre - distances_rad)
    driven = motion.assembly.inputs[0]
    chosen = motion.status == Status.OK
    exact = sk.exact_rows(motion, chosen, driven, FIFTY_DIGITS)
    has_reference = exact.status == Status.OK
    assert np.sum(has_reference) >= 8
    is_first_mode = has_reference & (motion.assembly_mode[chosen] == 0)
    assert np.all(np.diff(exact.condition[is_first_mode]) > 0.0)

    values_by_mode = motion.values.reshape(2, motion.samples, -1)
    mode_gap = np.max(np.abs(values_by_mode[0] - values_by_mode[1]), axis=1)
    mode_gap = np.tile(mode_gap, 2)[chosen]
    distance = exact.distance[has_reference]
    assert np.all(distance < 0.2 * mode_gap[has_reference])
    assert np.all(distance < 100 * EPS * exact.condition[has_reference])

    # The inputs are moved as far beyond the dead centre as they were before it. Rounding
    # decides the side at 1e-14 rad, so those rows are left out.
    distances_of_rows = np.tile(distances_rad, 2)
    inputs_beyond = motion.inputs + 2.0 * distances_of_rows[:, None]
    beyond = replace(motion, inputs=inputs_beyond)
    is_clearly_beyond = chosen & (distances_of_rows > 1e-12)
    lost = sk.exact_rows(beyond, is_clearly_beyond, driven, FIFTY_DIGITS)
    assert not np.any(lost.status == Status.OK)


def test_inputs_of_several_turns_are_taken_exactly():
    made = sk.load("four_bar")
    motion = sk.trace(made, path=np.array([[1.0], [1.0 + 2.0 * np.pi]]))
    motion.values[:, 0] = 1.0
    found = sk.exact_rows(motion, np.ones(len(motion), dtype=bool), 0, FIFTY_DIGITS)
    with mp.workdps(50):
        shift = mp.mpf(1.0 + 2.0 * np.pi) - 2 * mp.pi
        assert found.values[0, 0] == 1 and abs(found.values[1, 0] - shift) < 1e-48


def test_an_empty_selection_has_an_empty_reference():
    motion = traced("four_bar")
    no_rows = np.zeros(len(motion), dtype=bool)
    exact = sk.exact_rows(motion, no_rows, 0, order=3)
    assert exact.ddw.shape == (0, 4, 3)


def test_the_reference_of_a_hinge_is_a_rotation_about_its_axis():
    """One R pair without a loop; the axis (0, 0.6, 0.8) is normalized in 50 digits."""
    hinge = mechanism_from_chain("1-2", [(0.0, 0.6, 0.8)], span=(0.0, 1.0))
    motion = sk.trace(hinge, samples=3, search=False)
    exact = sk.exact_rows(motion, np.ones(3, dtype=bool), 0, FIFTY_DIGITS)
    assert np.all(exact.condition == 1.0)
    assert np.all(motion.conditioning == 1.0)
    with mp.workdps(50):
        length = mp.sqrt(mp.mpf(0.6) ** 2 + mp.mpf(0.8) ** 2)
        assert abs(exact.w[2, 1, 2] - mp.mpf(0.8) / length) < 1e-49
        # The trace of a rotation by 1 rad, the last of three inputs.
        assert abs(np.trace(exact.rotations[2, 1]) - 1 - 2 * mp.cos(1)) < 1e-48
    assert np.max(np.abs(exact.dw)) < 1e-48


def test_wrong_arguments_of_reference_rows_are_refused():
    """Rows with many digits (`exact_rows`) refuse wrong inputs, orders, digits and rows.

    The pair with the index 1 is no input. Derivatives go to order 3, digits from 20 to 300.
    """
    motion = traced("four_bar", 5)
    chosen = np.ones(len(motion), dtype=bool)
    with pytest.raises(SolveError, match="is not an input. Inputs: 21"):
        sk.exact_rows(motion, chosen, 1)
    with pytest.raises(SolveError, match="order: found 4, expected 1, 2 or 3"):
        sk.exact_rows(motion, chosen, 0, order=4)
    with pytest.raises(EngineError, match="between 20 and 300"):
        Digits(5)
    # Indices of rows are no mask, even if there are as many as rows.
    for wrong in (np.arange(len(motion)), chosen[1:], chosen[:, None]):
        with pytest.raises(SolveError, match="rows: found .* for each of the 10 rows"):
            sk.exact_rows(motion, wrong, 0)
    with pytest.raises(SolveError, match=r"inputs: found the shape \(10,\), expected"):
        sk.exact_rows(motion, chosen, 0, inputs=motion.inputs[:, 0])
    # Where two links are at relative rest, the direction of their pole follows from
    # derivatives of angular velocities (`dw`), which a result of order 1 does not have.
    # The array of zeros has the side of each direction and is not used here.
    exact = sk.exact_rows(motion, chosen, 0, order=1)
    assert exact.dw is None
    with pytest.raises(ValueError, match="order 2 or 3"):
        exact_direction(exact, (0, 1), np.zeros((len(motion), 3)))


def assert_pole_agrees_with_reference(field, reference, exact, pole):
    """Assert that a pole in float64 agrees with the pole in reference rows of 20 digits.

    - The directions agree within the error bound of float64.
    - The velocity coefficients differ by at most 60 EPS times the condition number of the
      closure equations. Both are NaN in the same rows.
    - The reference is right itself: its coefficient times its direction is the relative
      angular velocity of both links in the reference rows.

    Parameters
    ----------
    field
        `PoleField` in float64.
    reference
        `PoleField` that was computed from the reference rows; it has no error bounds.
    exact
        The reference rows. `exact.w` (rows, links, 3) are the angular velocities, and
        `exact.condition` (rows,) the condition numbers.
    pole
        Numbers of the two links.
    """
    coefficient = field.velocity_coefficient[pole]
    reference_coefficient = reference.velocity_coefficient[pole]
    is_known = np.isfinite(coefficient)
    assert np.array_equal(is_known, np.isfinite(reference_coefficient))
    difference = np.abs(coefficient - reference_coefficient)
    rounding = 60 * EPS * exact.condition
    assert np.all(difference[is_known] < rounding[is_known])

    u = reference.direction[pole]
    distance = np.linalg.norm(field.direction[pole] - u, axis=1)
    is_within = distance <= field.direction_error[pole]
    assert np.all(is_within | np.isnan(distance))
    # Error bounds are about float64, so the reference has none.
    assert np.all(np.isnan(reference.direction_error[pole]))

    rate = reference_coefficient[:, None] * u
    has_rate = np.isfinite(rate[:, 0])
    first, second = pole
    exact_rate = centre_floats(exact.w[:, second] - exact.w[:, first])
    assert np.allclose(rate[has_rate], exact_rate[has_rate], rtol=0.0, atol=1e-15)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["stephenson", "two_dof_spm", "roller_cam", "shaped_cam"])
def test_pole_fields_of_reference_rows_agree_with_float64_within_its_bounds(name):
    """Poles computed from many digits agree with the float64 evaluation of poles.

    A pole is the axis of the relative rotation of two links. The reference are rows in 20
    digits (`exact_rows_by_input`), one set for each input that moves alone, and the poles
    in them (`exact_field`). Each pole is compared by `assert_pole_agrees_with_reference`.
    Where a reference row has failed, its poles must have the status of the failure.
    """
    motion = traced(name, 5)
    mechanism = motion.mechanism
    chosen = select_good_rows(motion, 4)
    link_count = len(mechanism.links)
    poles = [(i, j) for j in range(link_count) for i in range(j)]
    input_pairs = motion.assembly.inputs
    exact_by_input = exact_rows_by_input(motion, chosen, input_pairs)
    for exact, number in zip(exact_by_input, input_pairs, strict=True):
        pole_request = request(mechanism, mechanism.pairs[number].name, poles, rates=poles)
        field = evaluate(motion, pole_request).rows(chosen)
        reference = exact_field(exact, pole_request, field)
        for pole in poles:
            assert_pole_agrees_with_reference(field, reference, exact, pole)
        # The motion with the configurations of the reference rows, which close the loops of
        # links to more digits than float64.
        exact_rows_motion = exact_motion(motion, chosen, exact)
        assert np.max(np.abs(exact_rows_motion.values - motion.values[chosen])) < 1e-13
        # `two_dof_spm` is over-constrained: its sizes are consistent in float64 only.
        if name != "two_dof_spm":
            assert np.max(exact_rows_motion.residual) < 1e-18
    # The rows of the last input are marked as failed.
    lost_status = np.full(4, Status.MODE_LOST, dtype=np.int8)
    lost = replace(exact_by_input[-1], status=lost_status)
    assert np.all(exact_field(lost, pole_request, field).status == Status.MODE_LOST)


def test_inertia_and_its_derivative():
    """The inertia B and its derivative, computed with 50 digits, pass two comparisons.

    B is the inertia of all links of a four-bar, reduced to the input. Its derivative is by
    the input. Such numbers of many digits serve as a reference for float64 (`exact_rows`,
    `exact_inertia`).

    - B and its derivative agree with the analysis `eksergian`, which computes in float64,
      to 1e-14.
    - The derivative agrees with the central difference of B over inputs 2^-47 rad apart, to
      1e-25. The error of this difference is of the order of the step squared, 1e-29.

    The motion has five samples, of which two rows (samples in a mode) are chosen.
    """
    motion = traced("four_bar", samples=5)
    chosen = select_good_rows(motion, 2)
    mechanism = sk.load("four_bar")
    moving_pair = mechanism.pair_number[mechanism.inputs[0].pair]

    def inertia(step):
        """Return B and its derivative in the rows, with inputs changed by a step (rad)."""
        moved = replace(motion, inputs=motion.inputs + step)
        rows = sk.exact_rows(moved, chosen, moving_pair, FIFTY_DIGITS)
        return exact_inertia(rows)

    B, dB = inertia(0.0)
    frame = sk.run(mechanism, "eksergian", samples=5).frame()
    # B and dB are balls (numbers with a bound of their error). `centre_floats` rounds the
    # centres of balls to float64.
    for numbers, name in ((B, "B"), (dB, "dB_dq")):
        of_analysis = frame[name].to_numpy()[chosen]
        assert np.max(np.abs(centre_floats(numbers) - of_analysis)) < 1e-14
    # The step is a power of 2, so that the changed inputs are exact.
    step = 2.0**-48
    B_after, _ = inertia(step)
    B_before, _ = inertia(-step)
    slope = (B_after - B_before) * 2.0**47
    assert np.max(np.abs(slope - dB)) < 1e-25


@pytest.mark.slow
@pytest.mark.parametrize(
    "seeds", [range(20), pytest.param(range(20, 1000), marks=pytest.mark.long)]
)
def test_errors_of_random_mechanisms_lie_within_their_bounds(seeds):
    """Errors of random mechanisms are within the error bounds that spherekit states.

    The errors of configurations, directions, rates and derivatives are differences from a
    computation in many digits (`compare_errors_with_bounds`). No number with the status OK
    may be NaN. The last lines check that the comparison says something: enough directions,
    errors above rounding, and bounds that are not far too wide everywhere.
    """
    direction_count = 0
    largest_ratio = 0.0
    largest_error = 0.0
    for seed in seeds:
        try:
            _, mechanism = random_mechanism(seed)
            position_analysis = PositionAnalysis(
                mechanism, search=False, samples=3, assembly_mode=0
            )
        except SpherekitError:
            continue
        comparison = compare_errors_with_bounds(position_analysis)
        for kind in KINDS:
            assert np.all(comparison.error_ratios(kind) <= 1.0), (seed, kind)
        assert comparison.missing_numbers == 0
        ratios = comparison.error_ratios("directions")
        direction_count += len(ratios)
        largest_ratio = max(largest_ratio, float(np.max(ratios, initial=0.0)))
        errors, _ = comparison.errors_and_bounds("configurations")
        largest_error = max(largest_error, float(np.max(errors, initial=0.0)))
    assert direction_count > 500
    assert largest_ratio > 1e-3
    assert largest_error > 1e-15


def test_the_reference_of_a_contact_at_rest_turns_with_its_links():
    """Two rolling contacts of this mechanism rest: their links turn as one about the crank.

    The derivative of a contact line u is then w x u. Divided by the rate of the contact, it
    would be the quotient of two rounding errors.
    """
    _, mechanism = random_mechanism(338)
    position_analysis = PositionAnalysis(
        mechanism, search=False, samples=3, assembly_mode=0
    )
    comparison = compare_errors_with_bounds(position_analysis)
    for kind in KINDS:
        assert np.all(comparison.error_ratios(kind) <= 1.0), kind
    assert len(comparison.error_ratios("direction derivatives")) > 20


def test_poles_found_from_a_common_axis_have_the_error_of_its_rounding():
    """Poles that only rounding determines still have errors within their bounds.

    In this random mechanism the two axes of the crank coincide, but for rounding. So the
    crank turns about this common axis without moving the other links, but for about 1e-16
    rad. The positions of their poles (axes of relative rotation) therefore depend on
    rounding. spherekit states the poles nevertheless, with error bounds. The errors against
    a computation in many digits must be within these bounds, so no ratio of error and bound
    may exceed 1. `KINDS` are the kinds of numbers with a bound, such as directions. No
    coefficient or bound may be NaN (`missing_numbers`).
    """
    _, mechanism = random_mechanism(72)
    # Without a search, only the assembly mode of the reference pose is computed.
    position_analysis = PositionAnalysis(
        mechanism, search=False, samples=3, assembly_mode=0
    )
    comparison = compare_errors_with_bounds(position_analysis)
    for kind in KINDS:
        assert np.all(comparison.error_ratios(kind) <= 1.0), kind
    assert len(comparison.error_ratios("directions")) > 30
    assert comparison.missing_numbers == 0
