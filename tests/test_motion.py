"""The motion: closure, assembly modes, reach, statuses, and that no assembly mode flips."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call
from mechanism_examples.linkages import EIGHT_BARS, mechanism_from_chain, random_axes
from mechanism_examples.named_mechanisms import four_bar
from oracles.velocity_equations import revolute_frames

import spherekit as sk
from spherekit.errors import SolveError
from spherekit.mechanism.elements import LinkSizes, SizeGeometry
from spherekit.positions.mode_predictor import follow_each
from spherekit.positions.position_analysis import PositionAnalysis

SHIPPED = (
    *("four_bar", "universal_joint", "watt", "stephenson"),
    *("double_butterfly", "single_flier"),
)


@pytest.mark.parametrize("name", SHIPPED)
def test_joint_angles_and_orientations_of_links_agree_over_a_whole_turn(name):
    """R_second = R_first F_first Z(angle) F_second^T for each R pair, to 1e-14.

    R_first and R_second are the rotations of both links of the pair. F_first and F_second
    are the frames of the pair in these links, by an independent function. Z is the rotation
    about the pair's axis, which is z of these frames. After a turn of the input all links
    are back in their first orientations, so the motion has not changed to another assembly
    mode (way to assemble the links).
    """
    # Without a search, only the mode of the reference pose is computed. A file without a
    # reference pose has all modes.
    motion = sk.trace(sk.load(name), samples=181, search=False)
    assert np.all(motion.status == sk.Status.OK)
    assert np.max(motion.residual) < 5e-15
    rotations_of_mode_0 = motion.rotations[motion.assembly_mode == 0]
    assert np.max(np.abs(rotations_of_mode_0[0] - rotations_of_mode_0[-1])) < 1e-12

    first_frames, second_frames = revolute_frames(motion.mechanism)
    for k, (first, second) in enumerate(motion.mechanism.ends):
        c = np.cos(motion.values[:, k])
        s = np.sin(motion.values[:, k])
        zero = np.zeros_like(c)
        one = zero + 1
        z_rotation = np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]])
        z_rotation = np.moveaxis(z_rotation, -1, 0)  # (samples, 3, 3)
        expected = (
            motion.rotations[:, first] @ first_frames[k] @ z_rotation @ second_frames[k].T
        )
        assert np.max(np.abs(expected - motion.rotations[:, second])) < 1e-14


def test_samples_are_out_of_reach_exactly_where_the_diagonal_of_a_four_bar_is_too_long():
    """A four-bar is out of reach exactly where coupler and rocker cannot span its diagonal.

    Two links can span arcs between their difference and their sum. The diagonal from the
    crank's tip to the rocker's ground axis follows from the spherical law of cosines. Arcs
    are those of ground, crank, coupler and rocker.
    """
    ground, crank, coupler, rocker = np.radians([70.0, 60.0, 30.0, 45.0])
    motion = sk.trace(four_bar(np.array([ground, crank, coupler, rocker])), samples=3601)
    diagonal = np.arccos(
        np.cos(ground) * np.cos(crank) + np.sin(ground) * np.sin(crank) * np.cos(motion.q)
    )
    reachable = (diagonal > rocker - coupler) & (diagonal < coupler + rocker)
    assert 0 < np.sum(reachable) < len(reachable)
    assert np.array_equal(motion.status == sk.Status.OK, reachable)

    assert np.all(motion.status[~reachable] == sk.Status.OUT_OF_REACH)
    # The input is known everywhere; the other joint angles and orientations are NaN.
    assert np.all(np.isnan(motion.values[~reachable][:, 1:]))
    assert np.all(np.isnan(motion.rotations[~reachable]))
    assert np.all(np.isfinite(motion.q))
    assert len(motion) == 2 * 3601  # two assembly modes


def test_dead_centre_itself_closes_but_has_no_rates():
    arcs = np.radians([70.0, 60.0, 30.0, 45.0])
    cosine = (np.cos(arcs[2] + arcs[3]) - np.cos(arcs[0]) * np.cos(arcs[1])) / (
        np.sin(arcs[0]) * np.sin(arcs[1])
    )
    made = four_bar(arcs, (0.0, float(np.arccos(cosine))))
    result = sk.run(made, "poles", samples=5)
    last = result.frame().query("sample == 4")
    assert set(last["status"]) <= {"AT_SINGULARITY", "OUT_OF_REACH"}
    assert last["velocity_coefficient"].isna().all()


@pytest.mark.slow
def test_arcs_that_cannot_close_are_refused_with_the_group():
    random = mechanism_from_chain(EIGHT_BARS[8], random_axes(np.random.default_rng(1), 10))
    lengths = {}
    for link in random.links:
        axes = tuple(p.name for p in random.pairs if link in p.links)
        arcs = (1.5 if link == "3" else 0.05,) * (len(axes) - 1)
        lengths[link] = LinkSizes(axes, arcs, (0.3,) * (len(axes) - 2))
    made = sk.Mechanism(
        "far", "1", random.links, random.pairs, SizeGeometry(lengths), inputs=random.inputs
    )
    with pytest.raises(SolveError, match="could not be assembled; change the arcs"):
        sk.trace(made)


def test_inputs_go_opposite_ways_where_a_range_falls():
    """A range of an input that falls leads to the results of a law with negative speed.

    The left axle of a differential turns forwards through its range, the right one
    backwards through half of that. So the left one turns by 360 degrees, the right one by
    -180, and the cage by their mean, 90. The tables of dynamics and reactions of two runs
    are compared: one with these ranges, one with laws of constant speed.
    """
    differential = sk.load("bevel_differential")
    left, right = differential.inputs
    falling = replace(right, stop=-left.stop / 2)  # it starts at 0
    differential = replace(differential, inputs=(left, falling))
    analyses = ["poles", "dynamics", "reactions"]
    run_by_ranges = sk.run(differential, analyses, samples=9)
    laws = {left.pair: sk.ConstantSpeed(1.0), right.pair: sk.ConstantSpeed(-0.5)}
    run_by_laws = sk.run(differential, analyses, samples=9, laws=laws, duration=left.stop)
    cage = run_by_ranges.frame("motion")["theta_carrier_axle"]
    assert np.cos(cage.to_numpy()) == pytest.approx(np.cos(np.linspace(0.0, np.pi / 2, 9)))
    for table in ("dynamics", "reactions"):
        frame = run_by_ranges.frame(table)
        frame_by_laws = run_by_laws.frame(table)
        assert list(frame) == list(frame_by_laws)
        for name in frame:
            if frame[name].dtype == float:
                np.testing.assert_allclose(
                    frame[name], frame_by_laws[name], atol=1e-12, err_msg=name
                )


@pytest.mark.slow
def test_a_range_that_falls_has_the_singular_places_of_one_that_rises():
    made = sk.load("five_bar")
    one, other = made.inputs
    falls = replace(other, start=other.stop, stop=other.start)
    asked = "singularities:slices=1,mesh=0"
    found = [
        sk.run(each, asked, samples=3).frame("singularities")
        for each in (made, replace(made, inputs=(one, falls)))
    ]
    assert len(found[0]) > 100 and found[0].equals(found[1])


@pytest.mark.parametrize("call", TABLES["motions"])
def test_unknown_modes_ranges_and_samples(call):
    check_call(call, globals(), TABLES["motions"][call])


def test_one_sample_is_one_of_each_mode():
    assert len(sk.trace(sk.load("four_bar"), samples=1)) == 2


@pytest.mark.parametrize("name", ["single_flier", "shaped_cam"])
def test_curves_followed_side_by_side_are_those_of_each(name):
    tracer = PositionAnalysis(sk.load(name))
    closure, driven = tracer.solver.closure, tracer.solver.driven[0]
    guides = [mode.guide for mode in tracer.assembly_modes]
    values = np.array([guide.values[len(guide.values) // 3] for guide in guides])
    together = follow_each(closure, driven, values, *tracer.range)
    for one, curve in zip(values, together, strict=True):
        (alone,) = follow_each(closure, driven, one[None], *tracer.range)
        assert (curve.ends, curve.tried_steps) == (alone.ends, alone.tried_steps)
        assert np.max(np.abs(curve.values - alone.values)) < 1e-12


def test_some_rows_of_a_motion_are_printed_as_rows():
    """`repr` names samples and modes of a whole motion, and only rows of a part of it."""
    motion = sk.trace("four_bar", samples=7)
    assert "7 samples in 2 assembly modes; 14 OK" in repr(motion)
    assert repr(motion.rows(slice(5, 8))) == "<Motion of four_bar: 3 rows; 3 OK>"
