"""The motion: closure, assembly modes, reach, statuses, and that no assembly mode flips."""

from dataclasses import replace

import numpy as np
import pytest
from chains import EIGHT_BARS, STEPHENSON, mechanism, random_axes
from closed_forms import four_bar_angles
from example_mechanisms import four_bar
from oracles import closure_gap, null_space, revolute_frames
from refusals import TABLES, check_call

import spherekit as sk
from spherekit.errors import SolveError
from spherekit.model.parts import LinkSizes, SizeGeometry
from spherekit.motion.motion import PositionAnalysis

SHIPPED = (
    "four_bar",
    "universal_joint",
    "watt",
    "stephenson",
    "double_butterfly",
    "single_flier",
)


def random_crank(random):
    """Return arcs of a four-bar whose input turns fully, well away from change points."""
    while True:
        a = random.uniform(0.1, np.pi - 0.1, 4)
        reach_low = np.cos(a[2] - a[3]) - np.cos(a[0] - a[1])
        reach_high = np.cos(a[0] + a[1]) - np.cos(a[2] + a[3])
        if min(reach_low, reach_high) > 1e-3:
            return a


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_mechanism_closes_over_its_whole_turn(name):
    motion = sk.trace(sk.load(name))
    own = motion.assembly_mode == 0
    assert np.all(motion.status[own] == sk.Status.OK)
    frames = revolute_frames(motion.mechanism)
    assert closure_gap(motion.mechanism, motion.rotations, frames) < 2e-15
    assert np.nanmax(motion.residual) < 5e-15
    turns = motion.rotations[own]
    assert np.max(np.abs(turns[0] - turns[-1])) < 1e-12


@pytest.mark.parametrize("name", SHIPPED)
def test_reported_variables_describe_the_orientations(name):
    motion = sk.trace(sk.load(name), samples=25, search=False)
    first, second = revolute_frames(motion.mechanism)
    for k, (a, b) in enumerate(motion.mechanism.ends):
        c, s = np.cos(motion.values[:, k]), np.sin(motion.values[:, k])
        zero = np.zeros_like(c)
        turn = np.moveaxis(
            np.array([[c, -s, zero], [s, c, zero], [zero, zero, zero + 1]]), -1, 0
        )
        expected = motion.rotations[:, a] @ first[k] @ turn @ second[k].T
        assert np.nanmax(np.abs(expected - motion.rotations[:, b])) < 1e-14


@pytest.mark.slow
def test_four_hundred_random_cranks_never_flip():
    """12 samples a turn; theta41 against eq. (25) of Di Gregorio 2024, one p throughout."""
    random = np.random.default_rng(400)
    for _ in range(400):
        arcs = random_crank(random)
        motion = sk.trace(four_bar(arcs), samples=13)
        assert len(motion.assembly_modes) == 2 and np.all(motion.status == sk.Status.OK)
        theta41 = motion.values[:, 3].reshape(2, 13)
        q = motion.q[:13]
        found = []
        for assembly_mode in (0, 1):
            for p in (0, 1):
                gap = np.abs(
                    np.exp(1j * four_bar_angles(q, arcs, p))
                    - np.exp(1j * theta41[assembly_mode])
                )
                if np.max(gap) < 1e-9:
                    found.append((assembly_mode, p))
        assert len(found) == 2 and {p for _, p in found} == {0, 1}


def test_rocker_is_reported_out_of_reach_exactly_where_it_is():
    """Grashof-free four-bar: reach limits of its diagonal in closed form."""
    arcs = np.radians([70.0, 60.0, 30.0, 45.0])
    motion = sk.trace(four_bar(arcs), samples=3601)
    cosine = np.cos(arcs[0]) * np.cos(arcs[1]) + np.sin(arcs[0]) * np.sin(arcs[1]) * np.cos(
        motion.q
    )
    diagonal = np.arccos(cosine)
    reachable = (diagonal > arcs[3] - arcs[2]) & (diagonal < arcs[2] + arcs[3])
    assert 0 < np.sum(reachable) < len(reachable)
    assert np.array_equal(motion.status == sk.Status.OK, reachable)
    assert np.all(motion.status[~reachable] == sk.Status.OUT_OF_REACH)
    assert np.all(np.isnan(motion.values[~reachable][:, 1:]))
    assert np.all(np.isnan(motion.rotations[~reachable])) and len(motion) == 2 * 3601
    assert np.all(np.isfinite(motion.q))


def test_followed_branches_end_at_the_dead_centre_of_the_input():
    """A Stephenson driven in its outer loop: modes meet in pairs at dead centres."""
    made = mechanism(
        STEPHENSON, random_axes(np.random.default_rng(3), 7), "p1_6", span=(-np.pi, np.pi)
    )
    tracer = PositionAnalysis(made)
    ends = []
    for assembly_mode in tracer.assembly_modes:
        curve = assembly_mode.guide
        assert set(curve.ends) <= {sk.Status.OK, sk.Status.OUT_OF_REACH}
        for why, q in zip(curve.ends, curve.inputs[[0, -1]], strict=True):
            if why != sk.Status.OK:
                ends.append(q)
                axes = tracer.at(np.array([q])).axes
                rows = [r for r in range(len(axes)) if np.all(np.isfinite(axes[r]))]
                a, b = made.ends[tracer.assembly.inputs[0]]
                slowest = min(
                    abs((w[b] - w[a]) @ axes[r, tracer.assembly.inputs[0]])
                    for r in rows
                    for w in [null_space(6, made.ends, axes[r])[0]]
                )
                assert slowest < 1e-4
    ends = np.sort(ends)
    assert len(ends) % 2 == 0 and len(ends) > 0
    assert np.max(np.abs(ends[0::2] - ends[1::2])) < 1e-9


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


def test_arcs_that_cannot_close_are_refused_with_the_group():
    random = mechanism(EIGHT_BARS[8], random_axes(np.random.default_rng(1), 10))
    lengths = {
        link: LinkSizes(
            tuple(p.name for p in random.pairs if link in p.links),
            *(
                ((0.05, 0.05), (0.3,))
                if sum(link in p.links for p in random.pairs) == 3
                else ((1.5 if link == "3" else 0.05,), ())
            ),
        )
        for link in random.links
    }
    made = sk.Mechanism(
        "far", "1", random.links, random.pairs, SizeGeometry(lengths), inputs=random.inputs
    )
    with pytest.raises(SolveError, match="did not close from any start"):
        sk.trace(made)


def test_inputs_go_opposite_ways_where_a_range_falls():
    """As by laws of these speeds; the cage of a differential goes at their mean."""
    made = sk.load("bevel_differential")
    left, right = made.inputs
    made = replace(made, inputs=(left, replace(right, stop=-left.stop / 2)))
    fast = {left.pair: sk.ConstantSpeed(1.0), right.pair: sk.ConstantSpeed(-0.5)}
    asked = ["poles", "dynamics", "reactions"]
    run = sk.run(made, asked, samples=9)
    same = sk.run(made, asked, samples=9, laws=fast, duration=left.stop)
    cage = run.frame("motion")["theta_carrier_axle"]
    assert np.cos(cage.to_numpy()) == pytest.approx(np.cos(np.linspace(0.0, np.pi / 2, 9)))
    for table in ("dynamics", "reactions"):
        for one, other in zip(
            run.frame(table).items(), same.frame(table).items(), strict=True
        ):
            if one[1].dtype == float:
                np.testing.assert_allclose(one[1], other[1], atol=1e-12, err_msg=one[0])


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
