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
from mechanism_examples.flat_mechanisms import (
    KINDS,
    four_bar_text,
    loaded,
    random_crossing_arcs,
    six_bar_with_a_flat_loop,
    two_vertices,
)

import spherekit as sk
from spherekit.cli.main import main
from spherekit.completeness import Guarantee
from spherekit.errors import SpherekitError
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


def is_among(q, inputs):
    """Whether an input is equal to one of several inputs, up to `SAME_INPUT_RAD`."""
    return any(abs(q - other) < SAME_INPUT_RAD for other in inputs)


def find_proven_saddles(proven):
    """Return the inputs of all proven saddles in the range, and those of the crossings.

    Near a saddle the configuration curves are the zeros of a function g of two coordinates
    that has a saddle point. If g is 0 there, its level sign is 0 and two curves cross.
    """
    saddle_inputs = []
    crossing_inputs = []
    for saddle in proven.saddles:
        q = proven.wrap_into_range(proven.input_angle(saddle.centre))
        if q is None:
            continue
        saddle_inputs.append(q)
        if saddle.level_sign == 0:
            crossing_inputs.append(q)
    return saddle_inputs, crossing_inputs


def find_contradictions(text, low, high):
    """Compare the inputs at which a run says that modes meet with those of a proof.

    A mode is a way to assemble the links. A run is a position analysis, which computes in
    float64 and names the inputs at which modes meet (`mode_meetings`). `certify_curves`
    proves by interval arithmetic where all saddles and turning points (dead centres) of the
    configuration curves are. At a saddle two curves cross, or pass each other at a tiny
    distance.

    The run must name the inputs of all saddles at which curves cross. In float64 a tiny
    distance may look like a crossing. So the run may also name the inputs of saddles at
    which the curves do not cross.

    Parameters
    ----------
    text
        Text of a mechanism file.
    low, high
        Ends of the range of the input in degrees.

    Returns
    -------
    contradictions
        Messages; an empty list if the run claims nothing false.
    named_count
        Number of inputs at which the run says that modes meet.
    """
    position_analysis = PositionAnalysis(loaded(text), samples=10)
    turning_points = find_input_turning_points(
        position_analysis.solver, *position_analysis.range
    )
    proven = certify_curves(decimal_mechanism(text), (str(low), str(high)))
    named_inputs = [meeting.input for meeting in position_analysis.mode_meetings]
    saddle_inputs, crossing_inputs = find_proven_saddles(proven)

    def is_doubtful(q):
        """Whether the run says that it may have missed turning points near an input."""
        return any(start <= q <= stop for start, stop in turning_points.doubtful)

    messages = []
    for q in crossing_inputs:
        if not (is_among(q, named_inputs) or is_doubtful(q)):
            messages.append(f"crossing at {q} is not named")
    for q in named_inputs:
        if not is_among(q, saddle_inputs):
            messages.append(f"no curves cross at {q}")
    known_inputs = [*turning_points.turning_inputs, *named_inputs]
    for q in proven.turning_points:
        if not (is_among(q, known_inputs) or is_doubtful(q)):
            messages.append(f"dead centre at {q} is not known")
    # The claim of the run may be "complete: all modes, which meet nowhere in the range".
    claim = position_analysis.claim
    if claim.guarantee is Guarantee.COMPLETE and "nowhere" in str(claim):
        messages += [f"curves cross at {q}" for q in crossing_inputs]
    if not all(meeting.resolved for meeting in position_analysis.mode_meetings):
        messages.append("it is not known which modes continue each other")
    return messages, len(named_inputs)


def symmetric_range(random):
    """Return the ends (deg) of a random range whose middle is flat, at 0 or 180 deg."""
    centre = int(random.choice([0, 180]))
    half = int(random.integers(10, 180))
    return centre - half, centre + half


def compare_with_proof(count, seed):
    """Assert that runs of random four-bars contradict no proof about meetings of modes.

    Assembly modes (ways to assemble the links) meet at an input where their configuration
    curves cross. A run names these inputs; `certify_curves` proves where curves cross (see
    `find_contradictions`).

    The curves of each four-bar cross in a flat configuration (a change point), in which all
    axes lie on one great circle. Each four-bar counts the angles of its pairs from a zero
    position drawn at random: they are 0 or 180 deg in the flat configuration.

    Parameters
    ----------
    count
        Number of four-bars.
    seed
        Seed of the random numbers.

    Returns
    -------
    int
        Number of the four-bars for which the run names a meeting of modes.
    """
    random = np.random.default_rng(seed)
    compared = 0
    with_meeting = 0
    while compared < count:
        # The kinds are a vertex that folds flat, a kite, a parallelogram and a rhombus.
        arcs = random_crossing_arcs(random, KINDS[compared % len(KINDS)])
        # The ends of the input range (deg). A flat configuration is in its middle.
        low, high = symmetric_range(random)
        zero_deg = str(random.choice(["0", "180"]))
        text = four_bar_text(arcs, low, high, zero=zero_deg)
        try:
            contradictions, named_count = find_contradictions(text, low, high)
        except SpherekitError as problem:
            # The run found no input at which this four-bar closes. Another one is drawn.
            assert "arcs cannot close" in str(problem)
            continue
        assert not contradictions, (arcs, low, high, contradictions)
        compared += 1
        if named_count > 0:
            with_meeting += 1
    return with_meeting


def test_command_names_the_crossing_and_claims_nothing_false(capsys):
    """The command names the crossing in the middle of the range and claims no other."""
    assert main(["run", str(FILES / "falseclaim.toml"), "--samples", "10"]) == 0
    out = capsys.readouterr().out
    assert "All assembly modes were found (closed form)." in out
    meetings = [line.strip() for line in out.splitlines() if "meet" in line]
    assert len(meetings) == 1
    assert "odes 0 and 1 meet at c1 = 0 deg, where curves cross" in meetings[0]


@pytest.mark.slow
def test_claims_do_not_contradict_proofs():
    """Claims of meetings of modes agree with interval proofs of eight random four-bars."""
    assert compare_with_proof(8, seed=44) > 3


@pytest.mark.long
def test_claims_do_not_contradict_proofs_in_many_ranges():
    """The comparison with proofs in 400 ranges that are symmetric about a flat state."""
    assert compare_with_proof(400, seed=45) > 200


@pytest.mark.many
@pytest.mark.parametrize("shift", [0.0, 0.1, 1.0])
@pytest.mark.parametrize("power", [2, 4])
def test_a_double_zero_is_never_excluded(shift, power):
    """A zero of order 2 or 4, without a change of sign, is inside an undecided interval.

    `find_sign_changes` returns zeros with a change of sign, and intervals that it cannot
    decide. The function is zero at `shift` only, to the order `power`. To its values an
    error of some 2e-16 is added, which oscillates quickly and imitates rounding.
    """
    random = np.random.default_rng(3)
    for _ in range(40):
        scale = random.uniform(0.1, 2.0)
        noise = random.uniform(0.5, 2.0)

        def function(x, scale=scale, noise=noise):
            rounding = np.sin(1e7 * x + 17.0) * 2.2e-16 * noise
            return scale * np.sin(x - shift) ** power * (2.0 + np.cos(x)) + rounding

        zeros, undecided = find_sign_changes(function, shift - 1.3, shift + 1.3)
        assert not len(zeros)
        starts, stops = undecided.T
        assert np.any((starts <= shift) & (shift <= stops))
        # Near the zero the function is smaller than the error. This is so up to a distance
        # of about 1e-8 with order 2, and 1e-4 with order 4. The limits have a margin.
        largest_width = 1e-5 if power == 2 else 5e-3
        assert np.all(stops - starts < largest_width)


@pytest.mark.parametrize("difference", ["0", "1e-4", "1e-7", "1e-10", "1e-13"])
@pytest.mark.many
def test_a_near_miss_is_no_crossing(difference):
    """No crossing of curves is found for a kite whose equal sides differ slightly.

    The configuration curves of a four-bar with two and two equal sides cross in a flat
    configuration. If one of the two sides of 80 deg is changed by `difference` (deg), the
    curves pass each other at a small distance. The position analysis (`mode_meetings`) must
    not take this for a crossing. For 1e-4 and 1e-7 deg its result is also compared with a
    proof (`find_contradictions`). A difference of 1e-13 deg is too small for 64-bit
    numbers. The analysis must then not fail, but may find a crossing.
    """
    from decimal import Decimal

    for sense in (-1, 1):
        changed_arc = format(80 + sense * Decimal(difference), "f")
        text = four_bar_text(["60", "60", "80", changed_arc], -50, 50)
        position_analysis = PositionAnalysis(loaded(text), samples=10)
        named_count = len(position_analysis.mode_meetings)
        if difference != "1e-13":
            assert named_count == (1 if difference == "0" else 0)
        if difference in ("1e-4", "1e-7"):
            # Contradictions to the proof, in the range from -50 to 50 deg of the input.
            contradictions, _ = find_contradictions(text, -50, 50)
            assert contradictions == []


@pytest.mark.parametrize(
    "arcs", [(100, 60, 80, 120), (70, 50, 110, 130), (45, 80, 135, 100)]
)
def test_fold_angles_of_a_flat_vertex_keep_their_ratio_through_it(arcs):
    """With `crossings="pass"` modes follow the smooth fold motions of a flat vertex.

    A flat-foldable vertex with four sectors is a four-bar, whose pair angles are the fold
    angles. In each of its two motions any two of them, f and g, obey tan(g/2) = p tan(f/2)
    with a constant p (Huffman 1976; Evans et al. 2015). This is true on both sides of the
    flat state, in which the two motions cross. `arcs` are the sector angles (deg).

    Without this option a mode changes from one motion to the other in the flat state. No
    sample is in the flat state.
    """
    vertex = loaded(four_bar_text(arcs, -40, 40))

    def ratio_spread(**options):
        """Return the largest change of a ratio of tangents, and the largest ratio."""
        motion = sk.trace(vertex, samples=10, **options)
        # (modes, samples, pairs). All ratios are those to the first fold angle, the input.
        tangents = np.tan(0.5 * motion.values.reshape(2, 10, 4))
        ratios = tangents / tangents[:, :, :1]
        return np.ptp(ratios, axis=1).max(), np.abs(ratios).max()

    spread, largest_ratio = ratio_spread(crossings="pass")
    assert spread < 1e-9 * largest_ratio
    spread_without_option, _ = ratio_spread()
    assert spread_without_option > 0.1


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
def test_modes_pass_change_points_without_a_bend(arcs, low, high):
    """With `crossings="pass"` the steps of joint angles hardly change at a crossing.

    At a change point the four-bar is flat, and two curves of configurations cross. The
    assembly modes (ways to assemble the links) on these curves meet there. A meeting is
    resolved if the run knows which mode after it continues which mode before it. On the
    other curve, the angles would move in another direction. `arcs` are those of ground,
    crank, coupler and rocker, the range goes from `low` to `high` (both in degrees).
    """
    samples = 96
    mechanism = loaded(four_bar_text(arcs, low, high, zero="0"))
    position_analysis = PositionAnalysis(mechanism, samples=samples, crossings="pass")
    motion = position_analysis.motion()
    meetings = position_analysis.mode_meetings
    assert meetings
    assert all(meeting.resolved for meeting in meetings)
    modes = len(position_analysis.assembly_modes)
    values = motion.values.reshape(modes, samples, 4)  # four pair angles (rad)
    is_valid = (motion.status == sk.Status.OK).reshape(modes, samples)
    checked = 0
    for meeting, mode in itertools.product(meetings, range(modes)):
        after = int(np.searchsorted(motion.q[:samples], meeting.input))
        if not 2 <= after < samples - 2:
            continue
        if not np.all(is_valid[mode, after - 2 : after + 2]):
            continue
        checked += 1
        # The steps before, across and after the crossing
        steps = wrap(np.diff(values[mode, after - 2 : after + 2], axis=0))
        bend = np.abs(np.diff(steps, axis=0)).max()
        # A third of a step is far below the bend onto another curve; 0.02 rad allows for
        # the curvature where all angles move little.
        largest_step = max(np.abs(steps).max(), 0.02)
        assert bend < 0.35 * largest_step, (arcs, meeting, steps)
    assert checked


def test_followed_curve_agrees_with_the_smooth_mode():
    """A curve followed in arc length has the slope of the mode across the crossing.

    At a crossing two modes (ways to assemble the links) meet, here in the flat state with
    all angles 0. With `crossings="pass"` a mode goes through the crossing smoothly. Its
    samples 4 and 5 are just before and after the crossing.

    `follow_arc` knows no modes: it follows the curve of configurations through sample 4. It
    stops before the crossing, where the tangent is not unique, but within 0.05 rad. Slopes
    are the changes of all angles per change of the input, as difference quotients. The
    slopes of curve and mode agree to 5e-3.
    """
    mechanism = sk.load(FILES / "flatfold_through.toml")
    position_analysis = PositionAnalysis(mechanism, samples=10, crossings="pass")
    motion = position_analysis.motion()
    curve = follow_arc(position_analysis.solver.closure, motion.values[4])
    curve_ends = curve.nodes.values[[0, -1]]
    distances = np.abs(curve_ends).max(axis=1)  # from the flat state, rad
    nearest_end = curve_ends[np.argmin(distances)]
    assert np.min(distances) < 0.05
    # The line from the flat state, where all angles are 0, to this end. The first angle is
    # the input.
    curve_slope = nearest_end / nearest_end[0]
    mode_slope = (motion.values[5] - motion.values[4]) / (motion.q[5] - motion.q[4])
    assert np.allclose(mode_slope, curve_slope, atol=5e-3)


def test_two_dyads_change_their_signs_together():
    """Each of four smooth modes changes both of its dyad signs at the flat state.

    The linkage of two flat-foldable vertices has two dyads. Each dyad can be assembled in
    two ways, and its sign selects one of them. Both signs are the label of a mode, such as
    "+-". Four curves of configurations cross at the flat state. With `crossings="pass"` a
    smooth mode stays on its curve there. `successors` maps the number of the mode before
    the crossing to the number of the mode after it on the same curve.

    Along each curve, the tangents of half the fold angles have constant ratios (Huffman
    1976).
    """
    position_analysis = PositionAnalysis(two_vertices(), samples=10, crossings="pass")
    (meeting,) = position_analysis.mode_meetings
    assert meeting.resolved
    assert len(meeting.successors) == 4
    motion = position_analysis.motion()
    # (modes, samples, fold angles)
    tangents = np.tan(0.5 * motion.values.reshape(4, 10, 7))
    ratios = tangents / tangents[:, :, :1]
    assert np.ptp(ratios, axis=1).max() < 1e-8 * np.abs(ratios).max()
    labels = {mode.number: mode.label for mode in position_analysis.assembly_modes}
    for before, after in meeting.successors.items():
        for sign_before, sign_after in zip(labels[before], labels[after], strict=True):
            assert sign_before != sign_after


def test_long_runs_follow_smooth_curves_too():
    """A run of 9000 samples, computed by a compiled kernel, follows smooth curves too.

    The ratio of half tangents of two fold angles is constant in each mode (Huffman 1976).
    """
    path = FILES / "flatfold_through.toml"
    result = sk.run(path, "poles:only=s3/s1", samples=9000, crossings="pass")
    motion = result.frame("motion")
    ratio = np.tan(0.5 * motion.theta_c3) / np.tan(0.5 * motion.theta_c1)
    ratios_by_mode = ratio.groupby(motion.assembly_mode)
    assert (ratios_by_mode.max() - ratios_by_mode.min()).max() < 1e-6
    assert len(result.summary["mode_meetings"]) == 1


def test_reference_pose_is_exact_where_it_is_flat():
    """A flat reference pose is computed to the last digit, with and without a search.

    Newton's method alone loses half the digits there, because the Jacobian is singular.
    """
    mechanism = sk.load(FILES / "flat_pose.toml")
    motion = sk.trace(mechanism, samples=18)
    flat_rows = motion.values[motion.q == 0.0]
    assert len(flat_rows) == 2
    assert np.abs(flat_rows).max() < 1e-15
    unsearched = sk.trace(mechanism, samples=18, search=False)
    assert np.abs(unsearched.values[0]).max() < 1e-15


@pytest.mark.parametrize("arcs", [(60, 30, 60, 30), (70, 30, 60, 40)])
def test_change_points_at_the_middle_and_the_ends_of_a_range_are_exact(arcs):
    """Flat four-bars have angles that are multiples of 90 deg, to 1e-12 of that."""
    motion = sk.trace(loaded(four_bar_text(arcs, 0, 360, "0")), samples=5)
    is_singular = motion.status == sk.Status.AT_SINGULARITY
    assert np.any(is_singular)
    right_angles = np.degrees(motion.values[is_singular]) / 90.0
    assert np.abs(right_angles - np.round(right_angles)).max() < 1e-12


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
def test_angles_that_count_turns_are_continuous_through_crossings(arcs, zero):
    """Angles with counted turns have no jump by a turn where the configurations are smooth.

    Such angles are needed for loads that depend on the turns of a pair. In flat
    configurations two curves of configurations cross. With `crossings="pass"` both assembly
    modes (ways to assemble the links) follow their smooth curves through a crossing. `arcs`
    are those of ground, crank, coupler and rocker (deg). `zero` is the zero position of the
    pairs (deg); the four-bar is flat at this input.
    """
    samples = 145
    mechanism = loaded(four_bar_text(arcs, low=0, high=360, zero=zero))
    position_analysis = PositionAnalysis(mechanism, samples=samples, crossings="pass")
    motion = position_analysis.motion()
    pairs = [pair.name for pair in mechanism.pairs]
    # Angles (rad) by pair, in the rows of the motion: all samples of one mode, then those
    # of the other. `last` are the angles before the first sample: none.
    counter_of_turns = position_analysis.angle_unwrapping
    angles = continue_angles(motion, pairs, counter_of_turns, last={})
    mode_count = 2
    for pair, values in angles.items():
        steps = np.abs(np.diff(values.reshape(mode_count, samples), axis=1))
        # Any limit (rad) between a step of the smooth motion and a turn would do.
        assert np.nanmax(steps) < 0.7, pair
        difference = wrap(values - motion.values[:, mechanism.angles[pair]])
        assert np.nanmax(np.abs(difference)) < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arcs", "zero"), [((70, 40, 60, 30), "0"), ((100, 60, 80, 120), "180")]
)
def test_angles_that_count_turns_do_not_depend_on_the_first_sample(arcs, zero):
    """Whole turns are counted from an input of zero, however many crossings are before it.

    With `crossings="pass"` the order of the modes depends on the first sample.
    """
    mechanism = loaded(four_bar_text(arcs, low=0, high=360, zero=zero))
    pairs = [pair.name for pair in mechanism.pairs]
    angles_at_end = []
    for first_deg in (-10.0, -200.0, -400.0, -800.0):
        path = np.radians(np.linspace(first_deg, 100.0, 20))[:, None]
        position_analysis = PositionAnalysis(mechanism, path=path, crossings="pass")
        angles = continue_angles(
            position_analysis.motion(), pairs, position_analysis.angle_unwrapping, last={}
        )
        # (modes, pairs) angles at 100 deg
        at_end = np.array([angles[pair].reshape(2, -1)[:, -1] for pair in pairs]).T
        angles_at_end.append(at_end[np.argsort(np.sin(at_end[:, 1]))])
    for angles in angles_at_end[1:]:
        assert np.allclose(angles, angles_at_end[0], rtol=0.0, atol=1e-9)


def test_evaluate_follows_smooth_curves():
    """With `crossings="pass"`, `evaluate` follows the smooth curve through a flat state.

    The mechanism is a paper vertex of four creases, a four-bar. In its flat state, at the
    input 0, two smooth curves of configurations cross. On each of the curves, the
    configurations at -0.3 and 0.3 rad are mirror images of each other. So a velocity
    coefficient (rate per rate of the input) has the same size at both inputs.

    By default, a mode is one way to assemble the dyad of the four-bar (its two links that
    are not the ground or the crank). On its way through the flat state, this mode leaves
    one curve and goes on along the other. So its coefficients at -0.3 and 0.3 rad belong to
    different curves, and their sizes differ by more than 0.1.
    """
    path = str(FILES / "flatfold_through.toml")

    def coefficient_sizes(**options):
        sizes = []
        for q in (-0.3, 0.3):
            row = sk.evaluate(path, q, assembly_mode=0, **options)
            sizes.append(abs(row.velocity_coefficient("s3/s1")))
        return sizes

    before, after = coefficient_sizes(crossings="pass")
    assert abs(before - after) < 1e-12
    before, after = coefficient_sizes()
    assert abs(before - after) > 0.1


def test_a_sweep_follows_smooth_curves():
    """A fold angle goes through 80 deg on the smooth curve, which no mode by signs does."""
    ranges_deg = {}
    for crossings in ("end", "pass"):
        result = sk.sweep(
            str(FILES / "flatfold_through.toml"),
            {"links.s1.arc": [100]},
            "s=range(theta_c3)",
            samples=10,
            crossings=crossings,
        )
        ranges_deg[crossings] = result.frame()["s"]
    assert np.allclose(ranges_deg["pass"], 80.0)
    assert np.all(ranges_deg["end"] < 40.0)


def test_commands_read_how_to_pass_crossings_from_a_study_file(tmp_path, capsys):
    """`crossings = "pass"` of a study applies to `spherekit run` and `spherekit sweep`."""
    path = FILES / "flatfold_through.toml"
    study = tmp_path / "fold.study.toml"
    study.write_text(
        f'format = 1\nmechanism = "{path}"\nsamples = 10\ncrossings = "pass"\n'
    )
    assert main(["run", str(study)]) == 0
    assert "each follows its smooth curve through it" in capsys.readouterr().out
    arguments = ["sweep", str(study), "--vary", "links.s1.arc=100", "--reduce"]
    assert main([*arguments, "s=range(theta_c3)", "--json"]) == 0
    assert '"s": 80.0' in capsys.readouterr().out.replace("79.99999999999999", "80.0")


@pytest.mark.parametrize("name", ["four_bar", "stephenson", "watt", "single_flier"])
def test_crossings_pass_changes_nothing_where_modes_do_not_cross(name):
    """Where no curves cross, every row is bit for bit equal with `crossings="pass"`."""
    ended = sk.trace(sk.load(name), samples=7)
    passed = sk.trace(sk.load(name), samples=7, crossings="pass")
    assert np.array_equal(ended.values, passed.values, equal_nan=True)
    assert np.array_equal(ended.status, passed.status)


@pytest.mark.slow
def test_modes_of_a_triad_follow_smooth_curves():
    """Modes of a triad also pass a crossing of configuration curves without a bend.

    A mode is a way to assemble the links. A triad is a group of four links, and a dyad one
    of two. Signs distinguish the modes of a dyad, but not those of a triad. Without
    `crossings="pass"` a mode keeps the sign of the determinant of the closure equations, so
    that it ends at the crossing or changes to another curve.

    A meeting is an input at which curves of several modes cross. It is resolved if it is
    known which mode continues which. Steps of a mode are the changes of its pair angles
    from sample to sample. Without a bend, successive steps differ by less than half of the
    largest step near the crossing.
    """
    samples = 28
    mechanism = six_bar_with_a_flat_loop()
    (meeting,) = PositionAnalysis(mechanism, samples=samples).mode_meetings
    assert meeting.resolved
    assert abs(meeting.input) < 1e-9
    position_analysis = PositionAnalysis(mechanism, samples=samples, crossings="pass")
    motion = position_analysis.motion()
    is_valid = (motion.status == sk.Status.OK).reshape(-1, samples)
    # Angles of the 7 pairs: (modes, samples, pairs).
    values = motion.values.reshape(*is_valid.shape, 7)
    passing_modes = 0
    for mode_values, mode_is_valid in zip(values, is_valid, strict=True):
        after = int(np.searchsorted(motion.q[:samples], 0.0))
        around = slice(after - 3, after + 3)
        if not np.all(mode_is_valid[around]):
            continue
        passing_modes += 1
        steps = wrap(np.diff(mode_values[around], axis=0))
        bend = np.abs(np.diff(steps, axis=0)).max()
        assert bend < 0.5 * np.abs(steps).max()
    assert passing_modes >= 2


@pytest.mark.parametrize("turns", [41, 2700])
def test_modes_pass_a_crossing_after_many_turns_as_in_the_first(turns):
    """The motion of a parallelogram about its flat state repeats after whole turns.

    The rounding of an input of 2700 turns (17000 rad) is 2e-12.
    """

    def trace(middle):
        """Return the pair angles from 40 deg below to 40 deg above a flat state."""
        text = four_bar_text((60, 30, 60, 30), middle - 40, middle + 40, zero="0")
        return sk.trace(loaded(text), samples=10, crossings="pass").values

    assert np.abs(wrap(trace(360 * turns) - trace(0))).max() < 1e-10


@pytest.mark.slow
def test_modes_can_pass_crossings_in_a_range_that_ends_at_one():
    """The modes of a triad below its flat state need no successors above the range."""
    mechanism = six_bar_with_a_flat_loop()
    below = mechanism.with_inputs(
        ranges={mechanism.input_pairs[0]: (-0.3, 0.0)}, angle_unit="rad"
    )
    passed = sk.trace(below, samples=7, crossings="pass")
    ended = sk.trace(below, samples=7)
    assert np.array_equal(passed.values, ended.values, equal_nan=True)
