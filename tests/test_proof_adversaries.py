"""Geometries made so that modes, or dead centres, are as near as one likes."""

import numpy as np
import pytest
from helpers.refusals import decimal_mechanism, mechanism_text
from oracles.proof_checker import check, recorded

from spherekit.completeness import Guarantee
from spherekit.proof.ball_frames import exact_ball
from spherekit.proof.balls import centre_float, pi_ball, working_precision
from spherekit.proof.certificate import modes_certificate
from spherekit.proof.certified_modes import certify_modes
from spherekit.proof.configuration_curves import certify_curves

BASE, TIP = 40, 75
"""Angles (deg) from the axis of symmetry to the base's axes and to those of the cranks."""


def tripod(plate):
    """Return a platform on three equal legs, with two equal modes at inputs of zero.

    A mode is a way to assemble the platform. Each leg has a crank and a bar. At inputs of
    zero, the three axes of every leg are in one plane with the axis of symmetry. Their
    angles from it are BASE at the base, TIP between crank and bar, and `plate` (deg) at the
    plate. If the plate turns about the axis of symmetry by D, the arc of the bars requires
    cos(bar) = cos(tip) cos(plate) + sin(tip) sin(plate) cos(D). At D = 0 this is a double
    root, so that two modes are equal.
    """
    text = 'format = 1\nname = "tripod"\nangle_unit = "deg"\nground = "base"\n'
    text += "[links.base]\n[links.plate]\n"
    for leg, longitude in zip("abc", (0, 120, 240), strict=True):
        text += f"[links.crank{leg}]\n[links.bar{leg}]\n"
        for name, first_link, second_link, angle in (
            (f"base_{leg}", "base", f"crank{leg}", BASE),
            (f"tip_{leg}", f"crank{leg}", f"bar{leg}", TIP),
            (f"plate_{leg}", f"bar{leg}", "plate", plate),
        ):
            text += (
                f'[pairs.{name}]\ntype = "R"\nlinks = ["{first_link}", "{second_link}"]\n'
            )
            text += f"lonlat = [{longitude}, {90 - angle}]\n"
    text += "".join(f"[inputs.base_{leg}]\nfrom = 0\nto = 360\n" for leg in "abc")
    return decimal_mechanism(text)


def half_angle_between_modes(plate, digits):
    """Compute half the angle between two modes of the tripod that are nearly equal.

    The `tripod` is a plate on three equal legs of a crank and a bar, spread evenly about an
    axis of symmetry. At inputs of zero every leg is in one plane with this axis, and two
    modes (ways to assemble it) are equal. Here all inputs are 10 ** -digits degrees. D is
    the angle, about the axis of symmetry, from the tip of a crank to the axis of the plate
    on the same leg. In one mode it is positive, in the other one it has the opposite value.
    cos(D) follows from the spherical law of cosines, in 200 bits. As D is small, its square
    is nearly 2 (1 - cos(D)).

    Parameters
    ----------
    plate
        Angle (deg) from the axis of symmetry to the axes of the plate.
    digits
        The inputs are 10 ** -digits degrees.

    Returns
    -------
    half_angle
        |D| in radians.
    is_real
        Whether there are two modes; otherwise there is none.
    """
    with working_precision(200):
        degree = pi_ball() / 180
        # Arcs from the axis of symmetry, at inputs of zero: to the axis of a crank at the
        # base, to the tip of a crank, and to an axis of the plate.
        base, tip, top = (degree * exact_ball(float(a)) for a in (BASE, TIP, plate))
        step = degree * exact_ball(10.0) ** -digits  # the input
        # The arcs of crank and bar are differences, since a leg is in one plane at zero.
        crank = tip - base
        bar = tip - top
        # `end` is the arc from the axis of symmetry to the tip of a crank at the input. At
        # zero the crank continues the arc `base`, so the angle between both is 180 degrees
        # less the input. Its cosine is -cos(step).
        cosine_of_end = base.cos() * crank.cos() - base.sin() * crank.sin() * step.cos()
        sine_of_end = (1 - cosine_of_end * cosine_of_end).sqrt()
        numerator = bar.cos() - cosine_of_end * top.cos()
        cosine = numerator / (sine_of_end * top.sin())
        square = 2 * (1 - cosine)
        return float(abs(square).sqrt().mid()), bool(square > 0)


def modes_beside(plate, digits):
    """Certify the modes of the tripod at inputs of 10 ** -digits degrees."""
    step = "0." + "0" * (digits - 1) + "1"
    return certify_modes(tripod(plate), (step, step, step))


@pytest.mark.many
@pytest.mark.parametrize("digits", range(4, 13))
def test_modes_of_a_platform_that_are_1e_6_to_1e_14_rad_apart_are_both_certified(digits):
    """Two modes of a platform on three legs are certified however near they are.

    Two modes (ways to assemble it) are equal at inputs of zero. Here the inputs are 10 **
    -digits degrees. One mode has the plate turned by a small angle to one side, the other
    by the same angle to the other side. `half_angle_between_modes` computes this angle by a
    closed form in 200 bits; it is 0.5 to 1 times 10 ** (-digits - 2) rad. All 8 complex
    modes (solutions of the closure equations) are certified.
    """
    plate = 50  # angle (deg) from the axis of symmetry to the axes of the plate
    half_angle, has_real_modes = half_angle_between_modes(plate, digits)
    assert has_real_modes and 0.5 < half_angle * 10.0 ** (digits + 2) < 1.0
    modes = modes_beside(plate, digits)
    # As many complex modes are proven as there can be (`mode_bound`).
    assert modes.is_counted and modes.mode_bound == 8
    rows = np.array([[centre_float(angle) for angle in row] for row in modes.angles()])
    # Both modes are near the double one, in which all angles are zero.
    first, second = sorted(rows, key=lambda row: np.sum(1 - np.cos(row)))[:2]
    # The joint angles differ by about the angle between both positions of the plate. Only
    # the order of magnitude is compared.
    distance = np.max(np.abs(first - second))
    assert 0.1 * half_angle < distance < 10 * half_angle
    # Only the certificate of the nearest modes is checked independently.
    if digits == 12:
        check(recorded(modes_certificate(modes)))


@pytest.mark.slow
@pytest.mark.parametrize("digits", (5, 12))
def test_modes_of_a_triad_that_just_miss_each_other_are_none(digits):
    _, real = half_angle_between_modes(100, digits)
    assert not real
    none = modes_beside(100, digits)
    assert none.is_counted and len(none.real) == 0


@pytest.mark.long
def test_a_double_mode_of_a_triad_is_a_cluster():
    double = certify_modes(tripod(50), ("0", "0", "0"))
    assert (
        not double.is_complete and double.completeness.guarantee is not Guarantee.CERTIFIED
    )
    near = [centre for centre, half in double.clusters if np.all(np.abs(centre) <= half)]
    assert len(near) == 1


TWO_DYADS = mechanism_text("two_dyads")
JOINTS = {"a": "12", "b": "14", "c": "16", "d": "23", "e": "25", "f": "34", "h": "56"}


def two_dyads(ground, crank, turn, coupler, rocker):
    """Return a six-bar of two four-bars with a common crank; sizes in degrees.

    Coupler and rocker of each four-bar are a dyad (two links joined by a pair). The first
    four-bar has the arcs 60 (ground), 50 (crank), 40 (coupler) and 35 (rocker). The
    arguments are the arcs of the second one. On the crank, the angle from the arm of the
    first four-bar to that of the second is `turn`. On the ground, it is 140 degrees.
    """
    sizes = {"coupler": coupler, "rocker": rocker}
    text = TWO_DYADS.format(ground=ground, crank=crank, turn=turn, **sizes)
    for name, (one, other) in JOINTS.items():
        text += f'[pairs.{name}]\ntype = "R"\nlinks = ["{one}", "{other}"]\n'
    return decimal_mechanism(text + "[inputs.a]\nfrom = 0\nto = 360\n")


STRETCHED_INPUT = np.arccos(
    (np.cos(np.radians(75.0)) - np.cos(np.radians(60.0)) * np.cos(np.radians(50.0)))
    / (np.sin(np.radians(60.0)) * np.sin(np.radians(50.0)))
)
"""The input (rad) at which the links of the first dyad, 40 and 35 degrees, are in line."""


def test_dead_centres_at_one_input_in_different_modes_are_each_certified():
    """A dead centre of the first dyad is certified once in either mode of the second."""
    curves = certify_curves(two_dyads(50, 20, 70, 60, 55), ("80", "110"))
    assert curves.completeness.guarantee is Guarantee.CERTIFIED
    # the second dyad closes in two modes, so that the first one's dead centre comes twice
    turning_inputs = np.array(curves.turning_points)
    assert (
        len(turning_inputs) == 2 and np.max(np.abs(turning_inputs - STRETCHED_INPUT)) < 1e-7
    )
    assert [count for _, _, count in curves.intervals] == [4, 0]


@pytest.mark.slow
def test_two_equal_dyads_stretched_at_one_input_leave_a_small_range_undecided():
    """A small range about an input at which two equal dyads are stretched is undecided.

    The mechanism is two four-bars with a common crank. Coupler and rocker of each four-bar
    are a dyad (two links joined by a pair). Both four-bars have the same arcs. The second
    one is turned by 140 degrees about the axis of the crank. So both dyads are stretched at
    the same input. Each dyad closes in two ways below this input, and in none above it. So
    there are 2 * 2 modes (ways to assemble the links) below it. At this input all modes
    meet, and their configuration curves cross.

    The proof finds the place, but it does not prove the crossing:

    - It finds one saddle, a place where two curves cross or nearly so.
    - `gap` is an upper bound of the distance (rad) at which the curves may miss each other.
      It is nearly zero.
    - `level_sign` is None, because it is open whether the curves cross. A crossing is
      proven only where all axes of a loop of four pairs are in one plane. Here the axis of
      the crank is not in the plane of the other three.
    - The result is complete except for a range of the input about the saddle, less than
      1e-4 rad wide (`completeness.box`).
    """
    mechanism = two_dyads(ground=60, crank=50, turn=140, coupler=40, rocker=35)
    curves = certify_curves(mechanism, ("80", "110"))
    assert curves.completeness.guarantee is Guarantee.TO_BOX
    assert curves.completeness.box < 1e-4
    ((low, high),) = curves.undecided_ranges
    assert low < STRETCHED_INPUT < high
    (saddle,) = curves.saddles
    assert saddle.level_sign is None
    assert saddle.gap < 1e-90
    assert curves.count_modes_at(np.radians(85.0)) == 4
    assert curves.count_modes_at(np.radians(105)) == 0


FOUR_BAR = mechanism_text("four_bar_proof_adversaries")


@pytest.mark.many
@pytest.mark.parametrize(
    ("arcs", "crossings", "still"),
    [
        # Hooke's joint; a change point; links in line at 0 and 180 degrees of all arcs 90;
        # a kite and a rhombus; a crank that comes to the fixed axis, so that the rest may
        # turn at one input
        ((60, 90, 90, 90), 0, ()),
        ((80, 30, 50, 60), 1, ()),
        ((90, 90, 90, 90), 4, (0, 180)),
        ((40, 40, 70, 70), 2, (0,)),
        ((50, 50, 50, 50), 3, (0,)),
        ((0, 40, 70, 70), 0, ()),
    ],
)
def test_special_four_bars_have_the_modes_of_the_closed_form(arcs, crossings, still):
    """Two modes are proven for the inputs at which the triangle inequality holds.

    A mode is a way to assemble the links. `certify_curves` divides the range of the input
    into intervals, and proves the number of modes in each. The diagonal of the four-bar is
    the arc from the axis at the tip of the crank to the fixed axis of the rocker. Coupler
    and rocker close the loop, in two modes, if the diagonal is between the difference and
    the sum of their arcs. Otherwise there is no mode.

    Parameters
    ----------
    arcs
        Arcs (deg) of ground, crank, coupler and rocker.
    crossings
        Number of configurations in which curves of configurations cross.
    still
        Inputs (deg) at which other links may turn while the input rests.
    """
    curves = certify_curves(decimal_mechanism(FOUR_BAR.format(*arcs)), ("0", "360"))
    assert curves.completeness.guarantee is Guarantee.CERTIFIED
    # A saddle is a place where two curves cross or nearly so. A level sign of 0 means that
    # the proof shows that the curves cross.
    assert [saddle.level_sign for saddle in curves.saddles] == [0] * crossings
    assert np.allclose(np.degrees(curves.constant_input_values), still, atol=1e-9)
    assert curves.intervals
    ground, crank, coupler, rocker = np.radians(arcs)
    for low, high, count in curves.intervals:
        for q in np.random.default_rng(4).uniform(low, high, 20):
            cosine_of_diagonal = np.cos(ground) * np.cos(crank)
            cosine_of_diagonal += np.sin(ground) * np.sin(crank) * np.cos(q)
            is_shorter_than_sum = np.cos(coupler + rocker) < cosine_of_diagonal
            is_longer_than_difference = cosine_of_diagonal < np.cos(coupler - rocker)
            if is_shorter_than_sum and is_longer_than_difference:
                assert count == 2
            else:
                assert count == 0
