"""Where modes meet: the claim of a run, the inputs that it names, and smooth curves.

Claims are compared with `certify`, whose curves and crossings are proven. That a curve is
smooth is judged by closed forms (the fold angles of a flat-foldable vertex) and by jumps of
the velocity coefficients, which a curve in its arc length does not have.
"""

import itertools
from pathlib import Path

import numpy as np
import pytest
from helpers.refusals import decimal_mechanism
from mechanism_examples.flat_mechanisms import KINDS, four_bar_text, random_crossing_arcs
from mechanism_examples.linkages import mechanism_from_chain as chain_of
from mechanism_examples.linkages import random_axes

import spherekit as sk
from spherekit.cli.main import main
from spherekit.completeness import Guarantee
from spherekit.errors import SpherekitError
from spherekit.files.mechanism_reader import read
from spherekit.files.toml_document import parse
from spherekit.numerics.angles import wrap
from spherekit.numerics.sign_changes import find_sign_changes
from spherekit.positions.angle_unwrapping import continue_angles
from spherekit.positions.curve_continuation import follow_arc
from spherekit.positions.input_turning_points import find_input_turning_points
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.proof.configuration_curves import certify_curves

FILES = Path(__file__).parent / "files"
SAME_INPUT_RAD = 1e-6
"""Inputs that differ by less are the same: a double zero is known to half the digits."""


def loaded(text):
    return read(parse(text, "made"))


def contradictions(text, low, high):
    """Return in what the claim of a run and its inputs contradict what is proven."""
    position_analysis = PositionAnalysis(loaded(text), samples=10)
    found = find_input_turning_points(position_analysis.solver, *position_analysis.range)
    proven = certify_curves(decimal_mechanism(text), (str(low), str(high)))
    named = [meeting.input for meeting in position_analysis.mode_meetings]
    crossed = [
        (proven.wrap_into_range(proven.input_angle(saddle.centre)), saddle.level_sign)
        for saddle in proven.saddles
    ]
    crossed = [(q, level) for q, level in crossed if q is not None]
    wrong = []
    for q, level in crossed:
        is_open = any(start <= q <= stop for start, stop in found.doubtful)
        is_named = any(abs(q - other) < SAME_INPUT_RAD for other in named)
        if level == 0 and not (is_named or is_open):
            wrong.append(f"crossing at {q} is not named")
    for q in named:
        if not any(abs(q - other) < SAME_INPUT_RAD for other, _ in crossed):
            wrong.append(f"no curves cross at {q}")
    for q in proven.turning_points:
        known = np.abs(np.concatenate([found.places, named]) - q)
        is_open = any(start <= q <= stop for start, stop in found.doubtful)
        if not (np.any(known < SAME_INPUT_RAD) or is_open):
            wrong.append(f"dead centre at {q} is not known")
    claim = position_analysis.claim
    if claim.guarantee is Guarantee.COMPLETE and "nowhere" in str(claim):
        wrong += [f"curves cross at {q}" for q, level in crossed if level == 0]
    if not all(meeting.resolved for meeting in position_analysis.mode_meetings):
        wrong.append("it is not known which modes continue each other")
    return wrong, len(named)


def symmetric_range(random):
    """Return the ends in degrees of a range about a flat state."""
    centre = int(random.choice([0, 180]))
    half = int(random.integers(10, 180))
    return centre - half, centre + half


def compare_with_proof(count, seed):
    """Compare random mechanisms; return how many have named crossings."""
    random = np.random.default_rng(seed)
    compared = with_crossing = 0
    while compared < count:
        arcs = random_crossing_arcs(random, KINDS[compared % len(KINDS)])
        low, high = symmetric_range(random)
        text = four_bar_text(arcs, low, high, zero=str(random.choice(["0", "180"])))
        try:
            wrong, named = contradictions(text, low, high)
        except SpherekitError as problem:
            assert "arcs cannot close" in str(problem)
            continue
        assert not wrong, (arcs, low, high, wrong)
        compared += 1
        with_crossing += named > 0
    return with_crossing


def test_command_names_the_crossing_and_claims_nothing_false(capsys):
    """It said that modes meet nowhere; curves cross at the middle of the range."""
    assert main(["run", str(FILES / "falseclaim.toml"), "--samples", "10"]) == 0
    out = capsys.readouterr().out
    assert "complete: all modes, which meet at one input in the range" in out
    assert "(curves cross at 0 deg)" in out and "nowhere" not in out
    assert "modes 0 and 1 meet at c1 = 0 deg, where curves cross" in out


@pytest.mark.slow
def test_claims_do_not_contradict_proofs():
    assert compare_with_proof(8, seed=44) > 3


@pytest.mark.long
def test_claims_do_not_contradict_proofs_in_many_ranges():
    """Of 400 symmetric ranges; 4 of 240 vertices and 2 of 150 kites did."""
    assert compare_with_proof(400, seed=45) > 200


@pytest.mark.many
@pytest.mark.parametrize("shift", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("power", [2, 4])
def test_zero_of_even_order_is_never_taken_for_none(shift, power):
    """The error measured at few places of a narrow cell was too small by chance."""
    random = np.random.default_rng(3)
    for _ in range(40):
        scale = random.uniform(0.1, 2.0)
        noise = random.uniform(0.5, 2.0)

        def function(x, scale=scale, noise=noise):
            rough = np.sin(1e7 * x + 17.0) * 2.2e-16 * noise
            return scale * np.sin(x - shift) ** power * (2.0 + np.cos(x)) + rough

        zeros, parts = find_sign_changes(function, shift - 1.3, shift + 1.3)
        assert not len(zeros)
        assert np.any((parts[:, 0] <= shift) & (shift <= parts[:, 1]))
        assert np.all(parts[:, 1] - parts[:, 0] < (1e-5 if power == 2 else 5e-3))


@pytest.mark.many
@pytest.mark.parametrize("off", ["0", "1e-4", "1e-7", "1e-10", "1e-13"])
def test_a_near_miss_is_no_crossing(off):
    """A kite off by 1e-10 deg has two modes all the way, or a gap without any."""
    from decimal import Decimal

    for sense in (-1, 1):
        arcs = ["60", "60", "80", format(80 + sense * Decimal(off), "f")]
        text = four_bar_text(arcs, -50, 50)
        position_analysis = PositionAnalysis(loaded(text), samples=10)
        named = len(position_analysis.mode_meetings)
        assert named == (off == "0") or off == "1e-13"
        if off in ("1e-4", "1e-7"):
            assert contradictions(text, -50, 50)[0] == []


@pytest.mark.parametrize(
    "arcs", [(100, 60, 80, 120), (70, 50, 110, 130), (45, 80, 135, 100)]
)
def test_fold_angles_of_a_flat_vertex_go_through_the_flat_state(arcs):
    """Opposite fold angles have equal sizes all along; their tangents keep one ratio.

    For fold angles f and g of a flat-foldable vertex of degree four tan(g/2) = p tan(f/2)
    with a constant p (Huffman 1976; Evans et al. 2015), through the flat state as well.
    """
    text = four_bar_text(arcs, -40, 40)
    motion = sk.trace(loaded(text), samples=10, crossings="pass")
    folds = np.tan(0.5 * motion.values.reshape(2, 10, 4))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = folds / folds[:, :, :1]
    assert np.ptp(ratios, axis=1).max() < 1e-9 * np.abs(ratios).max()
    signs = sk.trace(loaded(text), samples=10)
    halves = np.tan(0.5 * signs.values.reshape(2, 10, 4))
    assert np.ptp(halves / halves[:, :, :1], axis=1).max() > 0.1  # two smooth motions


@pytest.mark.parametrize(
    ("arcs", "low", "high"),
    [
        ((60, 30, 60, 30), 0, 360),  # parallelogram
        ((90, 90, 30, 30), 20, 340),  # folds onto itself
        ((70, 40, 60, 30), 0, 360),  # sums of arcs are equal
        ((50, 50, 50, 50), 10, 350),  # rhombus
        ((40, 40, 70, 70), -100, 91),  # kite
        ((40, 70, 70, 40), -100, 91),  # kite whose pairs coincide
    ],
)
def test_smooth_curves_of_change_points(arcs, low, high):
    """They are those that are followed in arc length, whose tangent is continuous."""
    mechanism = loaded(four_bar_text(arcs, low, high, zero="0"))
    position_analysis = PositionAnalysis(mechanism, samples=96, crossings="pass")
    motion = position_analysis.motion()
    meetings = position_analysis.mode_meetings
    assert meetings and all(meeting.resolved for meeting in meetings)
    values = motion.values.reshape(len(position_analysis.assembly_modes), 96, 4)
    good = (motion.status == sk.Status.OK).reshape(values.shape[:2])
    checked = 0
    for meeting, rows, is_good in itertools.product(meetings, values, good):
        k = int(np.searchsorted(motion.q[:96], meeting.input))
        if not 2 <= k < 94 or not np.all(is_good[k - 2 : k + 2]):
            continue
        checked += 1
        # Steps change little across a crossing, on another curve by much.
        near = [
            wrap(rows[i] - rows[j]) for i, j in ((k - 1, k - 2), (k, k - 1), (k + 1, k))
        ]
        bend = np.abs(np.diff(near, axis=0)).max()
        assert bend < 0.35 * max(np.abs(near).max(), 0.02), (arcs, meeting, near)
    assert checked


def test_followed_curve_agrees_with_the_smooth_mode():
    """The curve through a crossing, by steps in arc length from both of its sides."""
    mechanism = sk.load(FILES / "flatfold_through.toml")
    position_analysis = PositionAnalysis(mechanism, samples=10, crossings="pass")
    motion = position_analysis.motion()
    curve = follow_arc(position_analysis.solver.closure, motion.values[4])
    end = curve.nodes.values[[0, -1]]
    assert np.min(np.abs(end).max(axis=1)) < 0.05  # it ends beside the flat state
    slope = (motion.values[5] - motion.values[4]) / (motion.q[5] - motion.q[4])
    tangent = curve.nodes.values[np.argmin(np.abs(end).max(axis=1)) * -1]
    assert np.allclose(slope, tangent / tangent[0], atol=5e-3)


def two_vertices(low=-40.0, high=40.0):
    """Return two flat-foldable vertices on one crease: two dyads change at once."""
    sectors = np.radians([100.0, 60.0, 80.0])
    first = np.cumsum([0.0, *sectors])
    second = -np.cumsum(np.radians([70.0, 50.0, 110.0]))
    angles = [*first, *second]
    axes = np.array([[np.cos(a), np.sin(a), 0.0] for a in angles])
    # c1 joins links 1 and 2; the first vertex has links 3 and 4, the second 5 and 6.
    chain = ((1, 2), (1, 3), (3, 4), (2, 4), (1, 5), (5, 6), (2, 6))
    return chain_of(chain, axes, span=tuple(np.radians([low, high])))


def test_several_dyads_that_change_at_once():
    """Each of four modes changes both of its signs at the flat state."""
    position_analysis = PositionAnalysis(two_vertices(), samples=10, crossings="pass")
    (meeting,) = position_analysis.mode_meetings
    assert len(meeting.successors) == 4 and meeting.resolved
    motion = position_analysis.motion()
    folds = np.tan(0.5 * motion.values.reshape(4, 10, 7))
    ratios = folds / folds[:, :, :1]
    assert np.ptp(ratios, axis=1).max() < 1e-8 * np.abs(ratios).max()
    labels = {mode.number: mode.label for mode in position_analysis.assembly_modes}
    for before, after in meeting.successors.items():
        pairs = zip(labels[before], labels[after], strict=True)
        assert all(one != other for one, other in pairs)


def test_long_runs_follow_smooth_curves_too():
    """They are computed by a kernel that is given signs sample by sample."""
    path = FILES / "flatfold_through.toml"
    long = sk.run(path, "poles:only=s3/s1", samples=9000, crossings="pass")
    folds = long.frame("motion")
    ratio = np.tan(0.5 * folds.theta_c3) / np.tan(0.5 * folds.theta_c1)
    of_mode = ratio.groupby(folds.assembly_mode)
    assert (of_mode.max() - of_mode.min()).max() < 1e-6
    assert len(long.summary["mode_meetings"]) == 1


def test_reference_pose_is_exact_where_it_is_flat(capsys, tmp_path):
    """Angles were 3e-6 deg at the input of the pose itself."""
    motion = sk.trace(sk.load(FILES / "flat_pose.toml"), samples=18)
    flat = motion.values[motion.q == 0.0]
    assert len(flat) == 2 and np.abs(flat).max() < 1e-15
    alone = sk.trace(sk.load(FILES / "flat_pose.toml"), samples=18, search=False)
    assert np.abs(alone.values[0]).max() < 1e-15
    # At exact change points of sizes too, at the middle and at both ends of a range.
    for arcs, zero in (((60, 30, 60, 30), "0"), ((70, 30, 60, 40), "0")):
        turned = sk.trace(loaded(four_bar_text(arcs, 0, 360, zero)), samples=5)
        singular = turned.status == sk.Status.AT_SINGULARITY
        assert np.any(singular)
        away = np.degrees(turned.values[singular]) / 90.0
        assert np.abs(away - np.round(away)).max() < 1e-12


@pytest.mark.many
@pytest.mark.parametrize(
    ("arcs", "zero"),
    [
        ((60, 30, 60, 30), "0"),
        ((100, 60, 80, 120), "180"),
        pytest.param((70, 40, 60, 30), "0", marks=pytest.mark.slow),
        pytest.param((70, 50, 110, 130), "180", marks=pytest.mark.slow),
        pytest.param((60, 80, 60, 80), "180", marks=pytest.mark.slow),
    ],
)
def test_angles_go_on_through_crossings(arcs, zero):
    """Loads that count turns see no jump by a turn where the mode is smooth."""
    mechanism = loaded(four_bar_text(arcs, 0, 360, zero))
    position_analysis = PositionAnalysis(mechanism, samples=145, crossings="pass")
    motion = position_analysis.motion()
    names = [pair.name for pair in mechanism.pairs]
    angles = continue_angles(motion, names, position_analysis.angle_unwrapping, {})
    for name, values in angles.items():
        steps = np.abs(np.diff(values.reshape(2, 145), axis=1))
        assert np.nanmax(steps) < 0.7, name
        turned = np.abs(wrap(values - motion.values[:, mechanism.angles[name]]))
        assert np.nanmax(turned) < 1e-12


def test_evaluate_and_sweep_follow_smooth_curves():
    path = str(FILES / "flatfold_through.toml")
    sides = [-0.3, 0.3]
    passed = [
        sk.evaluate(path, q, assembly_mode=0, crossings="pass").velocity_coefficient(
            "s3/s1"
        )
        for q in sides
    ]
    assert abs(abs(passed[0][0]) - abs(passed[1][0])) < 1e-12
    kept = [
        sk.evaluate(path, q, assembly_mode=0).velocity_coefficient("s3/s1") for q in sides
    ]
    assert abs(abs(kept[0][0]) - abs(kept[1][0])) > 0.1
    swings = {
        how: sk.sweep(
            path, {"links.s1.arc": [100]}, "s=range(theta_c3)", samples=10, crossings=how
        ).frame()["s"]
        for how in ("end", "pass")
    }
    assert np.allclose(swings["pass"], 80.0) and np.all(swings["end"] < 40.0)


def test_command_of_sweeps_and_study_files(tmp_path, capsys):
    path = FILES / "flatfold_through.toml"
    study = tmp_path / "fold.study.toml"
    study.write_text(
        f'format = 1\nmechanism = "{path}"\nsamples = 10\ncrossings = "pass"\n'
    )
    assert main(["run", str(study)]) == 0
    assert "each follows its smooth curve through it" in capsys.readouterr().out
    words = ["sweep", str(study), "--vary", "links.s1.arc=100", "--reduce"]
    assert main([*words, "s=range(theta_c3)", "--json"]) == 0
    assert '"s": 80.0' in capsys.readouterr().out.replace("79.99999999999999", "80.0")


@pytest.mark.parametrize("name", ["four_bar", "stephenson", "watt", "single_flier"])
def test_mechanisms_whose_modes_do_not_cross_are_the_same(name):
    """Nothing is said of crossings, and every row stays as it was."""
    kept = sk.trace(sk.load(name), samples=7)
    passed = sk.trace(sk.load(name), samples=7, crossings="pass")
    assert np.array_equal(kept.values, passed.values, equal_nan=True)
    assert np.array_equal(kept.status, passed.status)


def flat_loop(seed=0):
    """Return a six-bar driven as a triad, one loop of which is flat in its pose."""
    axes = random_axes(np.random.default_rng(seed), 7)
    flat = [1, 2, 5, 6]  # the pairs of the loop of links 2, 3, 4 and 6
    axes[flat, 2] = 0.0
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    chain = ((1, 2), (2, 3), (3, 4), (4, 5), (1, 5), (2, 6), (4, 6))
    return chain_of(chain, axes, driven="p1_2", span=(-0.3, 0.35))


@pytest.mark.slow
def test_modes_of_a_triad_follow_smooth_curves():
    """Steps keep a determinant's sign: modes end or change curves at the crossing."""
    kept = PositionAnalysis(flat_loop(), samples=28)
    (meeting,) = kept.mode_meetings
    assert meeting.resolved and abs(meeting.input) < 1e-9
    passed = PositionAnalysis(flat_loop(), samples=28, crossings="pass")
    motion = passed.motion()
    good = (motion.status == sk.Status.OK).reshape(-1, 28)
    values = motion.values.reshape(*good.shape, 7)
    through = 0
    for rows, is_good in zip(values, good, strict=True):
        k = int(np.searchsorted(motion.q[:28], 0.0))
        if not np.all(is_good[k - 3 : k + 3]):
            continue
        through += 1
        steps = wrap(np.diff(rows[k - 3 : k + 3], axis=0))
        assert np.abs(np.diff(steps, axis=0)).max() < 0.5 * np.abs(steps).max()
    assert through >= 2
