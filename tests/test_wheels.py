"""Wheels over several turns: an input is a place on the line, wherever its range starts.

The independent side is a closed form: of wheels on fixed axes the second turns back by the
ratio of teeth, and the loop over both cranks closes where their tips are as far apart as
its two other arcs can reach.
"""

from dataclasses import replace

import numpy as np
import pytest
from cross_checks.mechanisms import random_subject
from helpers.hypothesis_strategies import MECHANISMS
from helpers.refusals import mechanism_text

import spherekit as sk
from spherekit.completeness import Guarantee
from spherekit.dynamics.inverse_dynamics import inverse_dynamics
from spherekit.dynamics.simulation_start import prepare
from spherekit.files.mechanism_reader import loads
from spherekit.files.study import Start
from spherekit.files.time_law import ConstantSpeed
from spherekit.mechanism.bevel_gears import pitch_angles
from spherekit.mechanism.elements import Input, Pair, PoseGeometry, Profile
from spherekit.mechanism.inertia import Mass
from spherekit.outputs.forward_kinematics import ForwardKinematics
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status

DEGREE = np.pi / 180.0
BASE, LEFT, COUPLERS, RIGHT = 75.0, 40.0, (60.0, 55.0), 35.0
FIVE_BAR = mechanism_text("geared_five_bar_wheels")
SECOND_PLANET = mechanism_text("wheels_second_planet")
MASS = Mass("3", ((2.0, 0.1, 0.0), (0.1, 1.5, 0.2), (0.0, 0.2, 1.0)))


def five_bar(folder, teeth, span):
    path = folder / "geared.toml"
    path.write_text(FIVE_BAR.format(*teeth, *span))
    return sk.load(path)


def test_a_linkage_on_wheels_has_all_modes(tmp_path):
    geared = five_bar(tmp_path, (20, 30), (0.0, 360.0))
    tracer = PositionAnalysis(geared, samples=25)
    assert tracer.claim.guarantee is Guarantee.COMPLETE
    assert tracer.configurations.guarantee is Guarantee.COMPLETE
    assert not tracer.configurations.mismatches


def test_wheels_of_an_irrational_ratio_never_return(tmp_path):
    """They were taken to be back after a turn, so that a run had modes a turn apart too."""
    path = tmp_path / "irrational.toml"
    text = FIVE_BAR.replace("teeth = [{0}, {1}]", "half_angles = [57.0]")
    path.write_text(text.format(0, 0, 0.0, 720.0))
    geared = sk.load(path)
    tracer = PositionAnalysis(geared, samples=25)
    assert np.isinf(tracer.solver.periods[0])
    motion = tracer.motion()
    ok = motion.status == Status.OK
    (mesh,) = geared.variables_of(geared.pair_number["mesh"])
    unrolled = motion.values[ok, mesh] + np.sin(57.0 * DEGREE) * motion.q[ok]
    assert np.ptp(unrolled) < 1e-9
    assert np.max(np.unique(motion.sample[ok], return_counts=True)[1]) == 2
    # Teeth 17 : 23 and 19 : 31 are back together after 23 times 31 turns.
    three = PositionAnalysis(loads(mechanism_text("three_wheels")), samples=1)
    assert three.solver.periods[0] == pytest.approx(23 * 31 * 2.0 * np.pi)


def right_crank(q, teeth):
    """Return the right crank's angle (deg) at the left one's: both read 90 unrolled.

    The contact lies towards the other axis; where nothing has rolled it lies at azimuth 0,
    the x axis of both cranks, from which their arcs are 90 degrees on.
    """
    return 90.0 - (q - 90.0) * teeth[0] / teeth[1]


def tip(axis, along, angle, arc):
    """Return the tip of a crank about an axis, its angle counted from a direction."""
    across = np.cross(axis, along)
    side = np.cos(angle)[:, None] * along + np.sin(angle)[:, None] * across
    return np.cos(arc) * axis + np.sin(arc) * side


def closes(q, right):
    """Return by how much (rad) couplers reach over the gap between tips at angles (deg)."""
    left_axis = np.array([0.0, 0.0, 1.0])
    base = BASE * DEGREE
    right_axis = np.array([np.sin(base), 0.0, np.cos(base)])
    one = tip(left_axis, np.array([1.0, 0.0, 0.0]), q * DEGREE, LEFT * DEGREE)
    back = np.array([-np.cos(base), 0.0, np.sin(base)])
    other = tip(right_axis, back, right * DEGREE, RIGHT * DEGREE)
    gap = np.arccos(np.sum(one * other, axis=1)) / DEGREE
    return np.minimum(sum(COUPLERS) - gap, gap - abs(COUPLERS[0] - COUPLERS[1])) * DEGREE


def angle_of(motion, pair):
    (variable,) = motion.mechanism.variables_of(motion.mechanism.pair_number[pair])
    return motion.values[:, variable]


def turned(angles):
    """Return angles (rad) less whole turns as their distance from zero."""
    return np.abs(np.remainder(np.asarray(angles) + np.pi, 2.0 * np.pi) - np.pi)


@pytest.mark.parametrize(
    ("teeth", "span"),
    [
        ((20, 40), (600, 720)),
        ((17, 23), (3000, 3050)),
        pytest.param((20, 40), (-360, 360), marks=pytest.mark.slow),
        pytest.param((20, 30), (400, 500), marks=pytest.mark.slow),
    ],
)
def test_the_assembly_does_not_depend_on_where_the_range_starts(tmp_path, teeth, span):
    """It was that which had rolled least at the first input of the range."""
    made = five_bar(tmp_path, teeth, span)
    motion = sk.trace(made, samples=(span[1] - span[0]) // 5 + 1)
    q = motion.q / DEGREE
    held = ~motion.failed
    right = right_crank(q, teeth)
    assert np.max(turned(angle_of(motion, "right") - right * DEGREE)[held]) < 1e-9
    found = held.reshape(len(motion.assembly_modes), -1).sum(axis=0)
    margin = closes(q, right)[: motion.samples]
    assert np.any(margin > 0.02)
    assert np.all(found[margin > 1e-6] == 2)
    assert not np.any(found[margin < -1e-6])


@pytest.mark.slow
def test_every_analysis_reads_the_same_assembly(tmp_path):
    """Inputs outside the range, starts of simulations, laws, and poses at inputs."""
    teeth = 20, 40
    made = replace(five_bar(tmp_path, teeth, (0, 360)), masses=(MASS,))
    number = made.variables_of(made.pair_number["right"])[0]
    for q in (420.0, 700.0, 720060.0):
        wanted = right_crank(q, teeth) * DEGREE
        there = ForwardKinematics(made, "pointer").solutions([[q * DEGREE]])
        assert len(there.values) == 2
        assert np.max(turned(there.values[:, number] - wanted)) < 1e-8
        kept = np.remainder(q + 360.0, 720.0) - 360.0
        assert np.allclose(there.inputs / DEGREE, kept, rtol=0.0, atol=1e-7)
        problem = prepare(made, Start(q * DEGREE, 1.0), 0.1)
        assert turned(problem.values[number] - wanted) < 1e-8
        (row, *_) = inverse_dynamics(made, ConstantSpeed(0.1, q * DEGREE), [0.0]).values
        assert turned(row[number] - wanted) < 1e-8


def test_a_reference_pose_says_the_phase_and_nothing_else_does(tmp_path):
    """The pose is at 60 degrees, in the second turn of a range, or before it."""
    teeth, shaft = (17, 23), BASE * DEGREE
    radii = pitch_angles(teeth, shaft, "external")
    sizes = five_bar(tmp_path, teeth, (59, 61))
    there = PositionAnalysis(sizes, samples=3).motion()
    names = [pair.name for pair in sizes.pairs]
    axes = dict(zip(names, map(tuple, there.axes[1].tolist()), strict=True))
    del axes["mesh"]
    rounds = zip((axes["left"], axes["right"]), radii, strict=True)
    circles = tuple(Profile("circle", *of) for of in rounds)
    ends = {"left": "12", "right": "15", "32": "23", "43": "34", "54": "45"}
    pairs = [Pair(name, "R", tuple(links)) for name, links in ends.items()]
    pairs = (*pairs, Pair("mesh", "Cr", ("2", "5"), circles))
    posed = PoseGeometry(axes, {"left": 60.0 * DEGREE})
    inputs = (Input("left", 0.0, 1.0),)
    made = sk.Mechanism("posed", "1", tuple("12345"), pairs, posed, inputs)
    for low, high in ((410.0, 440.0), (-8220.0, -8200.0)):
        span = Input("left", low * DEGREE, high * DEGREE)
        motion = PositionAnalysis(replace(made, inputs=(span,)), samples=41).motion()
        held = ~motion.failed
        back = -(motion.q - 60.0 * DEGREE) * teeth[0] / teeth[1]
        assert np.any(held)
        assert np.max(turned(angle_of(motion, "right") - back)[held]) < 1e-9


@pytest.mark.parametrize(
    ("name", "pair", "ratio"),
    [
        ("bevel_pair", "02", -20.0 / 40.0),
        ("planetary_bevel", "output_pivot", 2.0),
        ("rolling_cones", "roller_axis", np.sin(50 * DEGREE) / np.sin(20 * DEGREE)),
    ],
)
def test_shipped_trains_turn_by_their_ratio_in_any_range(name, pair, ratio):
    made = sk.load(name)
    (driven,) = made.inputs
    seen = []
    for low, high in ((0.0, 1.0), (-400.0, -300.0), (1000.0, 1900.0)):
        span = replace(driven, start=low * DEGREE, stop=high * DEGREE)
        motion = PositionAnalysis(replace(made, inputs=(span,)), samples=11).motion()
        assert not motion.failed.any()
        seen.append(angle_of(motion, pair) - ratio * motion.q)
    assert np.max(turned(np.concatenate(seen) - seen[0][0])) < 1e-9


def test_two_inputs_of_a_differential_in_any_range():
    """The carrier stands half-way between the side gears, both of them counted in turns."""
    made = sk.load("bevel_differential")
    for shift in ((0.0, 0.0), (360.0, 0.0), (-720.0, 1080.0)):
        spans = tuple(
            replace(item, start=item.start + by * DEGREE, stop=item.stop + by * DEGREE)
            for item, by in zip(made.inputs, shift, strict=True)
        )
        motion = PositionAnalysis(replace(made, inputs=spans), samples=9).motion()
        held = ~motion.failed
        assert np.sum(held) >= 9
        carrier = angle_of(motion, "carrier_axle")[held]
        assert np.max(turned(carrier - 0.5 * np.sum(motion.inputs[held], axis=1))) < 1e-9


@pytest.mark.many
@pytest.mark.parametrize("shift", [0.0, -360.0, 360.0])
def test_wheels_on_moving_links_keep_to_the_curve_of_the_reference_pose(shift):
    """Along a closed curve that swings to and fro an input is met as often each way.

    How far these wheels have rolled does not follow from the input. A turn of it is the
    same configuration, whichever turn the range is in.
    """
    made = random_subject(4).mechanism
    (driven,) = (item.pair for item in made.inputs)
    span = {driven: (shift - 40.0, shift + 60.0)}
    tracer = PositionAnalysis(made.with_inputs(ranges=span, angle_unit="deg"), samples=101)
    motion = tracer.motion()
    fine = (motion.status == Status.OK).reshape(len(tracer.assembly_modes), -1)
    counted = np.sum(fine, axis=0)
    assert counted.max() == 2 and set(counted) <= {0, 2}
    apart = motion.values[motion.sample == 40] - tracer.solver.reference
    assert np.min(np.max(np.abs(np.sin(0.5 * apart)), axis=1)) < 1e-9
    assert "mode of the reference pose" in tracer.claim.reason


def test_a_second_planet_is_put_together_as_the_first_one_says(tmp_path):
    """Its contacts repeat what those of the first say of the output; the motion is one."""
    text = (MECHANISMS / "planetary_bevel.toml").read_text().partition("[mass.carrier]")[0]
    text = text.replace(
        'axes = ["carrier_pivot", "planet_axis"]\narcs = [90.0]',
        'axes = ["carrier_pivot", "planet_axis", "opposite"]\narcs = [90.0, 90.0]\n'
        "angles = [180.0]",
    )
    path = tmp_path / "two.toml"
    path.write_text(text + SECOND_PLANET)
    two, one = (
        PositionAnalysis(item, samples=9)
        for item in (sk.load(path), sk.load("planetary_bevel"))
    )
    assert two.solver.gear_phases.all_known and len(two.assembly_modes) == 1
    assert two.claim.guarantee is Guarantee.COMPLETE
    here, there = two.motion(), one.motion()
    assert np.all(here.status == Status.OK)
    shared = [two.mechanism.links.index(link) for link in one.mechanism.links]
    assert np.max(np.abs(here.rotations[:, shared] - there.rotations)) < 1e-12
