"""Synthesis against random designs, differences, and what the mechanism then does.

A synthesis varies numbers of a mechanism within ranges to make an objective least, under
conditions. It evaluates many designs and improves the best ones ("starts").
"""

import warnings
from pathlib import Path

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call, mechanism_text, replace_passages
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.api.designs import specification_of
from spherekit.designs.cutting_planes import LinearisedFunctions, minimize_largest
from spherekit.designs.figure_gradients import FigureGradients
from spherekit.designs.linkage_comparison import is_same_linkage
from spherekit.designs.synthesis_modes import SynthesisMode
from spherekit.designs.synthesis_requirements import select_nondominated
from spherekit.errors import DesignError, FileError
from spherekit.files.library import find

EXAMPLES = Path(__file__).parent.parent / "examples" / "synthesis"


def find_best_random_objective(path, count):
    """Return the least objective of this many random designs that meet the conditions."""
    synthesis = specification_of(path, designs=count, seed=7)
    best = np.inf
    for part in range(synthesis.sweep.part_count):
        _, objectives = synthesis.select_rows(synthesis.sweep.compute_part(part))
        best = np.min(objectives[:, 0], initial=best)
    return best


def mode_number(mechanism, label):
    """Return the number of the assembly mode with this label."""
    modes = sk.trace(mechanism, samples=3).assembly_modes
    return next(mode.number for mode in modes if mode.label == label)


@pytest.mark.slow
def test_a_synthesized_rocker_follows_its_function():
    """A synthesized four-bar has a rocker near the wanted angle 30 (1 - cos q) degrees.

    The objective is the root mean square of the deviation. For the best linkage it is below
    0.5 degrees, and for the best of 8192 random ones it is not. It is computed again from
    the angles of the linkage, and differs only because the file has the wanted angles with
    four decimals. The transmission angle of the linkage exceeds 40 degrees as required.
    """
    path = EXAMPLES / "function.toml"
    result = sk.synthesize(path, designs=1024, starts=4)
    # (designs, objectives), the best design first.
    assert result.objectives[0, 0] < 0.5 < find_best_random_objective(path, 8192)
    # No linkage is listed twice.
    assert np.all(np.diff(result.objectives[:, 0]) > 1e-6)

    mechanism = result.mechanism()
    mode = mode_number(mechanism, result.modes[0])
    # The file states the wanted angle at these twelve inputs. The objective is the root
    # mean square over them.
    inputs_deg = np.arange(0.0, 360.0, 30.0)
    inputs = np.radians(inputs_deg)
    theta = sk.evaluate(mechanism, inputs, assembly_mode=mode).variable("41")
    deviations = np.degrees(theta) - 30.0 * (1.0 - np.cos(inputs))
    deviations = (deviations + 180.0) % 360.0 - 180.0
    rms = np.sqrt(np.mean(deviations**2))
    assert rms == pytest.approx(result.objectives[0, 0], rel=2e-3)

    # The table has a row for each sample and assembly mode.
    run = sk.run(mechanism, "singularities", samples=73)
    relation = run.frame("singularities", "relation")
    assert np.degrees(relation["transmission"].min()) > 40.0


def test_linkages_with_reversed_axes_are_the_same():
    """Linkages that differ only in the directions of their axes count as the same.

    If an axis is reversed, the arcs of both links at it become pi - arc. In the four-bar
    these are links 2 and 3 at the axis 32. If only one link at an axis has such an arc, it
    is another linkage. This is so for link 2 of the Stephenson linkage and of the four-bar.
    """
    stephenson = sk.load("stephenson")
    supplement = {"2": (np.pi - stephenson.geometry.links["2"].arcs[0],)}
    changed_stephenson = stephenson.with_sizes(arcs=supplement, angle_unit="rad")
    assert not is_same_linkage(stephenson, changed_stephenson)

    four_bar = sk.load("four_bar")
    sizes = four_bar.geometry.links
    supplements = {name: np.pi - sizes[name].arcs[0] for name in ("2", "3")}
    axis_reversed = four_bar.with_sizes(arcs=supplements, angle_unit="rad")
    assert is_same_linkage(four_bar, axis_reversed)
    assert is_same_linkage(axis_reversed, four_bar)

    one_changed = four_bar.with_sizes(arcs={"2": supplements["2"]}, angle_unit="rad")
    assert not is_same_linkage(four_bar, one_changed)
    assert not is_same_linkage(one_changed, four_bar)


@pytest.mark.slow
def test_a_synthesized_peak_torque_is_that_of_the_mechanism_and_less_than_random_ones():
    """A swing of 65 degrees and a transmission angle of 30 degrees are required."""
    path = EXAMPLES / "torque.toml"
    result = sk.synthesize(path, designs=2048, starts=4)
    assert result.objectives[0, 0] <= find_best_random_objective(path, 16384)
    row = result.frame().iloc[0]
    assert row["swing"] > 65.0 - 1e-6
    assert row["least"] > 30.0 - 1e-6
    mechanism = result.mechanism()
    mode = mode_number(mechanism, result.modes[0])
    run = sk.run(mechanism, "eksergian", samples=181, assembly_mode=mode)
    peak_torque = run.frame("eksergian")["tau"].abs().max()
    assert peak_torque == pytest.approx(row["peak"], rel=1e-9)


def check_front(name, designs, count, starts, seed=0):
    """Assert that no random design beats one of a Pareto front in both objectives.

    A Pareto front has the designs of a synthesis that no other one beats. A design counts
    as better only if it is so by more than the tolerance of the synthesis, which is at most
    1e-5 of the largest objective. Designs are compared in the same assembly mode (way to
    assemble the mechanism), since each mode has a front of its own.

    Parameters
    ----------
    name
        File of the synthesis.
    designs, starts, seed
        Options of the synthesis: number of designs that are explored, number of the best
        ones that are improved, and seed of the random numbers.
    count
        Number of random designs for the comparison.

    Returns
    -------
    The result of the synthesis.
    """
    pytest.importorskip("pymoo")
    result = sk.synthesize(EXAMPLES / name, designs=designs, starts=starts, seed=seed)
    largest = np.max(np.abs(result.objectives), axis=0)
    assert np.all(result.tolerance <= 1e-5 * largest)
    assert np.all(np.diff(result.objectives[:, 0]) >= 0.0)
    synthesis = specification_of(EXAMPLES / name, designs=count, seed=7)
    for part in range(synthesis.sweep.part_count):
        rows, objectives = synthesis.select_rows(synthesis.sweep.compute_part(part))
        for mode in set(result.modes):
            random_objectives = objectives[rows["mode"] == mode]
            front = result.objectives[np.array(result.modes) == mode]
            for front_objectives in front:
                limit = front_objectives - result.tolerance
                assert not np.any(np.all(random_objectives < limit, axis=1))
    return result


@pytest.mark.slow
def test_no_random_design_beats_a_front_of_torque_and_swing():
    """No random design beats the front of least peak torque against widest swing.

    The front has the designs of a synthesis that no other one beats in both objectives.
    `check_front` compares it with `count` random designs. The file defines three figures:
    ``peak``, the largest torque; ``swing``, that of the rocker in degrees; and ``least``,
    the minimum of the transmission angle. The objectives to minimise are the peak and minus
    the swing. The file requires ``least`` to exceed 30 degrees. For the last design, the
    swing is computed once more from the angles of the rocker over a turn.
    """
    result = check_front("trade_off.toml", designs=1024, count=8192, starts=1)
    frame = result.frame()
    assert len(frame) > 4
    assert np.allclose(frame["objective_1"], frame["peak"])
    assert np.allclose(frame["objective_2"], -frame["swing"])
    assert (frame["least"] > 30.0 - 1e-6).all()

    last_row = frame.iloc[-1]
    mechanism = result.mechanism(len(frame) - 1)
    mode = mode_number(mechanism, last_row["mode"])
    inputs = np.radians(np.linspace(0.0, 360.0, 181))
    theta = np.unwrap(sk.evaluate(mechanism, inputs, assembly_mode=mode).variable("41"))
    assert np.degrees(np.ptp(theta)) == pytest.approx(last_row["swing"], rel=1e-9)


@pytest.mark.long
@pytest.mark.parametrize(
    ("designs", "count", "starts", "seed"),
    [*((1024, 65536, 1, seed) for seed in range(1, 5)), (16384, 1 << 20, 12, 0)],
)
def test_no_random_design_beats_fronts_of_other_seeds(designs, count, starts, seed):
    check_front("trade_off.toml", designs, count, starts, seed)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("least_y", "centre"), [(-1.0, [0.5, 0.2, 0.3]), (0.5, [0.5, 0.5, 0.3])]
)
def test_cutting_planes_find_the_smallest_ball_around_points(least_y, centre):
    """The point with the least largest distance from four points is found, if y >= least_y.

    It is the centre of the smallest ball with all points. The first two points, 0.8 apart,
    determine it: the centre is between them, with the radius 0.4. The third point is on
    this ball, and the fourth slightly within, at 0.399 from the centre. The condition
    either does not act, or it moves the centre along y to its limit. `minimize_largest`
    uses cutting planes: linear bounds from gradients.
    """
    random = np.random.default_rng(3)
    corners = np.array([[0.1, 0.2, 0.3], [0.9, 0.2, 0.3], [0.5, 0.2 + 0.16**0.5, 0.3]])
    inner_point = corners[0] + [0.4, 0.0, 0.399]
    points = np.concatenate([corners, inner_point[None]])
    gradient_of_condition = np.array([[0.0, -1.0, 0.0]])

    def linearise(position):
        differences = position - points
        distances = np.linalg.norm(differences, axis=1)
        gradients = differences / distances[:, None]
        condition = np.array([least_y - position[1]])  # fulfilled if it is at most 0
        return LinearisedFunctions(distances, gradients, condition, gradient_of_condition)

    for start in random.uniform(0.5, 1.0, (4, 3)):
        solution, radius = minimize_largest(linearise, start, 1e-12)
        assert solution == pytest.approx(centre, abs=1e-4)
        assert radius == pytest.approx(np.hypot(0.4, centre[1] - 0.2), abs=1e-8)


def test_nondominated_rows_are_those_that_no_row_of_their_mode_beats():
    """200 random rows with three objectives, compared pair by pair."""
    random = np.random.default_rng(5)
    objectives = random.integers(0, 12, (200, 3)).astype(float)
    modes = random.integers(0, 2, 200)
    objectives = np.unique(objectives, axis=0)
    modes = modes[: len(objectives)]
    is_not_worse = np.all(objectives[:, None] <= objectives, axis=2)
    beats_or_is = is_not_worse & (modes[:, None] == modes)
    is_beaten = np.sum(beats_or_is, axis=0) > 1  # each row counts itself once
    expected = np.flatnonzero(~is_beaten).tolist()
    assert select_nondominated(objectives, modes).tolist() == expected


@pytest.mark.slow
def test_a_five_bar_for_a_cone_is_better_than_the_agile_eye():
    """A synthesized five-bar stays farther from singularities than the agile eye.

    The five axes of a five-bar are A and D at the base, the elbows B and E, and C on the
    platform. The distal arcs lead from C to B and from C to E. If they lie on one great
    circle, the five-bar is in a singularity of type II. So the sine of the angle between
    the distal arcs measures the distance from these singularities.

    Link 6 leads C round a cone with the half-angle 25 degrees about an axis W of the base.
    It also holds the axis of pair F, which is the same line as C. Pair C joins link 6 to
    one distal link, and pair F joins it to the other. So the angle between the distal arcs
    is theta_C - theta_F. The synthesis maximizes the least sine of this angle on the cone.
    Its objective is the negative of this least sine, since objectives are minimized.

    The agile eye is a five-bar whose four moving links have arcs of 90 degrees. W, A and D
    are at right angles to each other. Its least sine has a closed form. Let a and d be the
    components of C along A and D. The cosine between the distal arcs has the size

        a d / sqrt((1 - a^2) (1 - d^2)).

    On the cone a^2 + d^2 = sin(25 deg)^2. So the cosine is largest, and the sine least,
    where a = d. This is at 45 degrees on the cone. The sweep has 73 samples in steps of 5
    degrees, and so a sample there.
    """
    result = sk.synthesize(EXAMPLES / "cone.toml", designs=512, starts=1)
    # The sweep has one design, the agile eye. So each size has one value (deg). The sizes
    # of the base (link 1) are the arcs from W to A and to D, and the angle between them.
    arcs = {f"links.{link}.arc": [90.0] for link in "2345"}
    arcs["links.1.arcs.A"] = [90.0]
    arcs["links.1.arcs.D"] = [90.0]
    arcs["links.1.angles.D"] = [90.0]
    agile_eye = sk.sweep(
        EXAMPLES / "five_bar_cone.toml",
        arcs,
        "least_sine=min(abs(sin(theta_C - theta_F)))",
        samples=73,
    ).frame()
    a_squared = np.sin(np.radians(25.0)) ** 2 / 2.0
    largest_cosine = a_squared / (1.0 - a_squared)
    least_sine = np.sqrt(1.0 - largest_cosine**2)
    assert agile_eye["least_sine"].to_numpy() == pytest.approx(least_sine, rel=1e-12)
    assert -result.objectives[0, 0] > agile_eye["least_sine"].max()


def check_gradients(evaluator, design, steps, mode, absolute_tolerance):
    """Assert that the gradients of all figures of merit agree with central differences.

    A figure of merit is a number of a design in an assembly mode (way to assemble the
    links). A sweep evaluates the design and the changed designs for the differences.

    Parameters
    ----------
    evaluator
        Computes the figures of merit of designs.
    design, steps
        (variables,) numbers of the design, and by how much each of them is increased and
        decreased.
    mode
        Label of the assembly mode.
    absolute_tolerance
        Allowed absolute difference of derivatives. A relative difference of 1e-6 is also
        allowed.

    Returns
    -------
    Share of the samples at which the mode closes.
    """
    result = FigureGradients(evaluator).evaluate(design, SynthesisMode(mode))
    changes = np.concatenate([np.diag(steps), -np.diag(steps)])
    designs = np.concatenate([design[None], design + changes])
    swept = evaluator.evaluate(designs.T)
    # One row for each design: the design itself, then those with larger and those with
    # smaller numbers.
    rows = np.flatnonzero(swept.mode == mode)
    count = len(design)
    assert len(rows) == 1 + 2 * count
    for k, merit in enumerate(evaluator.figures.merits):
        figures = swept.merits[merit.name][rows]
        assert result.figures[k] == pytest.approx(figures[0], rel=1e-12)
        above = figures[1 : 1 + count]
        below = figures[1 + count :]
        differences = (above - below) / (2.0 * steps)
        assert result.gradients[k] == pytest.approx(
            differences, rel=1e-6, abs=absolute_tolerance
        ), merit.name
    return result.closing_fraction


@pytest.mark.slow
def test_gradients_of_figures_of_every_kind_agree_with_differences(tmp_path):
    """Gradients of figures of merit of every kind agree with finite differences.

    A figure of merit is a number of a design that a synthesis improves. The kinds are
    extremes, means, ranges, and values at one input. Two arcs and the zero angle of pair 41
    vary (deg). Figure e is the value of an expression at the input of 70 deg. B in figure f
    is the inertia reduced to the input.

    `check_gradients` compares the gradients with central differences. A sweep computes the
    figures for these differences. It returns the share of the samples at which an assembly
    mode (way to assemble the links) closes. Here both modes close at all samples.
    """
    path = tmp_path / "synthesis.toml"
    path.write_text(
        'format = 1\nmechanism = "four_bar"\nsamples = 19\nminimise = "a"\n'
        '[vary]\n"links.2.arc" = [10, 40]\n"links.4.arc" = [30, 60]\n'
        '"pairs.41.zero" = [-90, 90]\n[figures]\na = "max(abs(torque))"\n'
        'b = "min(transmission_angle_43)"\nc = "rms(rate_41*sin(theta_41))"\n'
        'd = "swing(theta_41)"\ne = "at(max(theta_41, 0.1*q), 70)"\n'
        'f = "mean(min(B, 2))"\ng = "range(acceleration_coefficient_3_1)"\n'
    )
    evaluator = specification_of(path, designs=4).sweep.evaluator
    design = np.array([22.0, 41.0, 10.0])
    steps = np.full(3, np.degrees(1e-6))
    for mode in ("+", "-"):
        closed_share = check_gradients(
            evaluator, design, steps, mode, absolute_tolerance=1e-7
        )
        assert closed_share == 1.0


ACTED = mechanism_text("synthesis_acted")


@pytest.fixture
def acted_evaluator(tmp_path):
    """Return the evaluator of a four-bar whose masses and loads vary."""
    four_bar_text = find("four_bar").read_text()
    sizes = four_bar_text[: four_bar_text.index("[mass.2]")]
    (tmp_path / "acted.toml").write_text(sizes + ACTED)
    path = tmp_path / "synthesis.toml"
    path.write_text(
        'format = 1\nmechanism = "acted.toml"\nsamples = 19\nminimise = "a"\n'
        '[vary]\n"links.4.arc" = [30, 60]\n"mass.3.mass" = [1, 3]\n'
        '"mass.3.centre.1" = [0.1, 0.5]\n"loads.back.stiffness" = [1, 5]\n'
        '"loads.back.rest" = [-90, 90]\n[figures]\na = "max(abs(torque))"\n'
        'b = "rms(torque)"\nc = "mean(B)"\n'
    )
    return specification_of(path, designs=4).sweep.evaluator


ACTED_DESIGN = np.array([41.0, 2.1, 0.25, 2.5, 31.0])
"""Arc of link 4 (deg), mass and y of its centre (m) of link 3, stiffness, rest (deg)."""


def test_gradients_by_masses_and_loads_agree_with_differences(acted_evaluator):
    steps = np.array([1e-4, 1e-5, 1e-5, 1e-5, 1e-5])
    check_gradients(acted_evaluator, ACTED_DESIGN, steps, "+", 1e-8)


def test_derivatives_of_an_inertia_tensor_follow_the_parallel_axis_theorem(acted_evaluator):
    """About the centre O the tensor gains m (|c|^2 1 - c c^T), c the centre of mass.

    Its first entry is 0.2 + m (y^2 + z^2) with m = 2.1, y = 0.25 and z = 0.8. It depends on
    the second and the third number of the design, m and y.
    """
    varied_mechanism = acted_evaluator.varied_mechanism
    design = varied_mechanism.evaluate_design(ACTED_DESIGN)
    entry = 1 + list(varied_mechanism.varied_numbers).index(0)
    assert design.sizes[entry] == pytest.approx(0.2 + 2.1 * (0.25**2 + 0.64), rel=1e-14)
    derivatives = [0.0, 0.25**2 + 0.64, 2.0 * 2.1 * 0.25, 0.0, 0.0]
    assert design.slopes[entry] == pytest.approx(derivatives, rel=1e-12, abs=1e-12)


def test_numbers_at_their_physical_limit_have_derivatives():
    """Derivatives by a moment of inertia exist also at the end of its physical range.

    No principal moment of inertia of a body exceeds the sum of the other two. The rocker of
    the file is at this limit: a smaller value of the varied moment would be refused. So the
    derivative cannot come from differences to both sides.

    A design has four variables, in this order: the arc of link 3, the stiffness of a
    spring, its rest angle (deg), and a moment of inertia of the rocker. Each of the last
    three changes one number in the formulas of the dynamics. The derivatives of these three
    numbers are tested.
    """
    specification = specification_of(EXAMPLES / "spring.toml", designs=4)
    varied = specification.sweep.evaluator.varied_mechanism
    # Derivatives of the three numbers (rows) by the four variables (columns).
    by_moment_of_inertia = [0.0, 0.0, 0.0, 1.0]
    minus_stiffness = [0.0, -1.0, 0.0, 0.0]  # the torque is -stiffness times angle
    rest_angle_in_rad = [0.0, 0.0, np.pi / 180.0, 0.0]
    expected = np.array([by_moment_of_inertia, minus_stiffness, rest_angle_in_rad])
    design = varied.evaluate_design(varied.nominal_values)
    # Rows of `slopes` are the sizes that vary, then the numbers of masses and loads.
    slopes_of_numbers = design.slopes[len(varied.size_variables) :]
    assert slopes_of_numbers == pytest.approx(expected, rel=1e-12)
    # An item would be None if the derivatives were not the same in all designs.
    assert not any(slope is None for slope in varied.constant_slopes)


@pytest.mark.parametrize("call", TABLES["syntheses"])
def test_mistakes_in_a_synthesis_file_are_refused(call, tmp_path):
    """Each call of the table replaces passages of a small file; its message is checked."""

    def synthesize_changed_file(*changes):
        path = tmp_path / "synthesis.toml"
        path.write_text(replace_passages(mechanism_text("synthesis_small"), *changes))
        sk.synthesize(path, designs=8, starts=1)

    check_call(call, {"made": synthesize_changed_file}, TABLES["syntheses"][call])


def test_match_of_an_angle_is_the_rms_of_its_deviations(tmp_path):
    """The objective "match" of an angle is the root mean square of its deviations.

    The file states wanted angles of the rocker at three inputs. Deviations count modulo a
    turn, and are computed again from `sk.evaluate`.
    """
    path = tmp_path / "synthesis.toml"
    path.write_text(
        """
format = 1
mechanism = "four_bar"
minimise = "match"
vary = { "links.2.arc" = [19.0, 21.0] }
match = { quantity = "theta_41", at = [0.0, 90.0, 180.0], values = [300.0, 60.0, 0.0] }
"""
    )
    result = sk.synthesize(path, designs=4, starts=1)
    for row in range(len(result.modes)):
        motion = sk.evaluate(result.mechanism(row), np.radians([0.0, 90.0, 180.0]))
        theta_by_mode = np.degrees(motion.variable("41")).reshape(-1, 3)
        deviations = (theta_by_mode - [300.0, 60.0, 0.0] + 180.0) % 360.0 - 180.0
        rms_by_mode = np.sqrt(np.mean(deviations**2, axis=1))
        # The row is one of the modes.
        match = result.figures["match"][row]
        assert np.min(np.abs(match / rms_by_mode - 1.0)) < 1e-9


POSES_TEXT = """
format = 1
mechanism = "five_bar"
minimise = "match"
vary = { "links.2.arc" = [59.0, 61.0] }
[[match]]
quantity = "direction_pointer"
at = [[40.0, 110.0], [60.0, 100.0]]
values = [[0.0, 2.0, 1.0], [30.0, 60.0]]
[[match]]
quantity = "orientation_3"
at = [[50.0, 110.0], [45.0, 100.0]]
values = [[10.0, 20.0, 30.0], [0.0, 0.0, 0.6, 0.8]]
"""
"""Directions by x, y, z and by azimuth and tilt; orientations by angles and quaternion."""


@pytest.mark.slow
def test_match_of_directions_and_orientations_is_the_rms_of_chords(tmp_path):
    """The objective "match" of poses is the root mean square of chords, in degrees.

    A chord is 2 sin(angle/2) for the angle between the wanted and the actual direction or
    orientation. The file (`POSES_TEXT`) asks for two directions and two orientations of the
    output, each at values of both inputs. They are written out here:

    - the direction (0, 2, 1), normalized;
    - the direction of azimuth 30 and tilt 60 degrees;
    - the orientation of azimuth 10, tilt 20 and torsion 30 degrees. Torsion is the sum of
      the first and the last of the Euler angles ZYZ, which are 10, 20 and 20 degrees;
    - the orientation of the quaternion xyzw (0, 0, 0.6, 0.8).

    A row of the result is a design in one of its assembly modes (ways to assemble the
    links). The deviations are computed in all modes of the design, and must agree in one of
    them.
    """
    path = tmp_path / "synthesis.toml"
    path.write_text(POSES_TEXT)
    result = sk.synthesize(path, designs=4, starts=1)
    inputs = np.radians([[40.0, 110.0], [60.0, 100.0], [50.0, 110.0], [45.0, 100.0]])
    azimuth, tilt = np.radians([30.0, 60.0])
    directions = np.array(
        [
            [0.0, np.sqrt(0.8), np.sqrt(0.2)],
            [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)],
        ]
    )
    by_angles = Rotation.from_euler("ZYZ", [10.0, 20.0, 20.0], degrees=True)
    by_quaternion = Rotation.from_quat([0.0, 0.0, 0.6, 0.8])
    poses = Rotation.concatenate([by_angles, by_quaternion]).as_matrix()

    for row, match in enumerate(result.figures["match"]):
        mechanism = result.mechanism(row)
        (output,) = mechanism.outputs
        # (modes, 4, 3, 3) rotations of link 3: at two inputs for the directions, then at
        # two inputs for the orientations.
        rotations = sk.evaluate(mechanism, inputs).rotation("3").reshape(-1, 4, 3, 3)
        pointed = rotations[:, :2] @ output.direction
        cosines_of_directions = np.sum(pointed * directions, axis=2)
        traces = np.einsum("mkij,kij->mk", rotations[:, 2:], poses)
        cosines_of_poses = 0.5 * (traces - 1.0)
        cosines = np.concatenate([cosines_of_directions, cosines_of_poses], axis=1)
        chords_deg = np.degrees(2.0 * np.sin(0.5 * np.arccos(cosines)))
        rms_by_mode = np.sqrt(np.mean(chords_deg**2, axis=1))
        assert np.min(np.abs(match / rms_by_mode - 1.0)) < 1e-9


def test_a_direction_of_four_numbers_is_refused(tmp_path):
    path = tmp_path / "synthesis.toml"
    path.write_text(POSES_TEXT.replace("[30.0, 60.0]]", "[30.0, 60.0, 0.0, 1.0]]"))
    with pytest.raises(FileError, match=r"match\[0\]\.values: .* give x, y, z, or azimuth"):
        sk.synthesize(path)


TARGET_ARCS_DEG = {"1": 80.0, "2": 25.0, "3": 75.0, "4": 60.0}
"""Arcs of the four-bar that is to be found again, by link."""


@pytest.mark.slow
def test_a_linkage_is_found_again_by_the_poses_of_its_coupler(tmp_path):
    """A synthesis finds a known four-bar by six orientations of its coupler.

    The orientations are those of the known four-bar. The four arcs may vary by 20 degrees
    to both sides of the numbers that are to be found, and are found to 1e-5 degrees. The
    synthesis tries 256 designs and improves the best two.
    """
    target = sk.load("four_bar").with_sizes(angle_unit="deg", arcs=TARGET_ARCS_DEG)
    inputs_deg = [0.0, 40.0, 90.0, 150.0, 230.0, 300.0]
    rotations = sk.evaluate(target, np.radians(inputs_deg), assembly_mode=0).rotation("3")
    quaternions = Rotation.from_matrix(rotations).as_quat().tolist()
    ranges = "".join(
        f'"links.{link}.arc" = [{arc - 20.0}, {arc + 20.0}]\n'
        for link, arc in TARGET_ARCS_DEG.items()
    )
    path = tmp_path / "synthesis.toml"
    path.write_text(
        'format = 1\nmechanism = "four_bar"\nminimise = "match"\n'
        f'[vary]\n{ranges}[match]\nquantity = "orientation_3"\n'
        f"at = {inputs_deg}\nvalues = {quaternions}\n"
    )
    result = sk.synthesize(path, designs=256, starts=2)
    # (designs, objectives), the best design first.
    assert result.objectives[0, 0] < 1e-6
    assert result.values[0] == pytest.approx([*TARGET_ARCS_DEG.values()], abs=1e-5)


@pytest.mark.slow
def test_a_linkage_is_found_again_by_the_path_of_a_point_of_its_coupler(tmp_path):
    """A synthesis finds a known four-bar by nine points of the path of a coupler point.

    Arcs, the zero position of the crank's angle, and longitude and latitude of the point on
    the coupler vary, each by 15 degrees to both sides of the number that is to be found
    again. They are found to 1e-4 degrees.
    """
    target = sk.load("four_bar").with_sizes(angle_unit="deg", arcs=TARGET_ARCS_DEG)
    inputs_deg = np.arange(0.0, 360.0, 40.0)
    point = np.array([0.48, 0.36, 0.8])
    rotations = sk.evaluate(target, np.radians(inputs_deg), assembly_mode=0).rotation("3")
    path_points = rotations @ point

    # The point of the file is another one; its longitude and latitude vary.
    output_of_point = '[outputs.tip]\nlink = "3"\nlonlat = [20.0, 40.0]\n'
    four_bar_text = find("four_bar").read_text()
    text = four_bar_text.replace("[outputs.rocker]", output_of_point + "[outputs.rocker]")
    (tmp_path / "bar.toml").write_text(text)

    target_numbers = {f"links.{k}.arc": arc for k, arc in TARGET_ARCS_DEG.items()}
    target_numbers["outputs.tip.longitude"] = np.degrees(np.arctan2(0.36, 0.48))
    target_numbers["outputs.tip.latitude"] = np.degrees(np.arcsin(0.8))
    target_numbers["pairs.21.zero"] = 0.0
    ranges = "".join(
        f'"{key}" = [{number - 15.0}, {number + 15.0}]\n'
        for key, number in target_numbers.items()
    )
    (tmp_path / "path.toml").write_text(
        'format = 1\nmechanism = "bar.toml"\nminimise = "match"\n'
        f'[vary]\n{ranges}[match]\nquantity = "direction_tip"\n'
        f"at = {inputs_deg.tolist()}\nvalues = {path_points.tolist()}\n"
    )
    result = sk.synthesize(tmp_path / "path.toml", designs=512, starts=3)
    assert result.objectives[0, 0] < 1e-6
    assert result.values[0] == pytest.approx([*target_numbers.values()], abs=1e-4)


def synthesize_swing(tmp_path, minimise, *conditions):
    """Return the synthesis of a four-bar in which the arcs of links 2 and 4 vary.

    Tests use it to try objectives and conditions.

    Parameters
    ----------
    tmp_path
        Folder for the file of the synthesis.
    minimise
        Formula of the objective. It can contain ``sw``, the swing of the rocker (the range
        of theta_41 in degrees), and the arcs ``links_2_arc`` and ``links_4_arc``.
    conditions
        Conditions that a design must meet, such as ``"sw > 60"``.
    """
    path = tmp_path / "synthesis.toml"
    path.write_text(
        f"""
format = 1
mechanism = "four_bar"
samples = 31
minimise = "{minimise}"
where = {list(conditions)}
vary = {{ "links.2.arc" = [10.0, 90.0], "links.4.arc" = [40.0, 90.0] }}
figures = {{ sw = "swing(theta_41)" }}
"""
    )
    return sk.synthesize(path, designs=16, starts=1)


@pytest.mark.parametrize("condition", ["closes < 0.9", "sw > 60*closes"])
def test_descents_keep_to_conditions_on_the_fraction_of_closed_samples(condition, tmp_path):
    """A small swing needs a short crank, and the mechanism then closes at all inputs."""
    result = synthesize_swing(tmp_path, "sw", condition)
    for row, mode in enumerate(result.modes):
        crank_arc, rocker_arc = result.values[row].tolist()
        sizes = {"links.2.arc": [crank_arc], "links.4.arc": [rocker_arc]}
        frame = sk.sweep("four_bar", sizes, "sw=swing(theta_41)", samples=31).frame()
        (found,) = frame[frame["mode"] == mode].to_dict("records")
        assert found["sw"] == pytest.approx(result.objectives[row, 0], rel=1e-6)
        if condition.startswith("closes"):
            assert found["closes"] < 0.9
        else:
            assert found["sw"] > 60.0 * found["closes"] - 1e-6


def test_large_objectives_do_not_lead_to_undefined_designs(tmp_path):
    """An objective of ten millions has no value where the crank is below 20 degrees."""
    objective = "1e7 + 1e3*links_2_arc + 1e-9*sqrt(links_2_arc - 20)"
    result = synthesize_swing(tmp_path, objective)
    assert np.all(result.values[:, 0] >= 20.0)
    assert np.all(np.isfinite(result.objectives))


def test_infinite_derivatives_of_an_objective_are_taken_for_zero(tmp_path):
    """The root of a size has an infinite derivative at the lower end of its range."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = synthesize_swing(tmp_path, "sw + sqrt(links_2_arc - 10)", "closes > 0.99")
    assert result.values[0, 0] == pytest.approx(10.0, abs=1e-6)


def test_a_condition_without_columns_holds_in_all_rows(tmp_path):
    with pytest.raises(
        DesignError, match=r"1 < 2 holds in (\d+) of \1 rows, 2 < 1 .* 0 of"
    ):
        synthesize_swing(tmp_path, "sw", "1 < 2", "2 < 1")


@pytest.mark.slow
def test_designs_of_a_front_meet_conditions_that_exclude_equality(tmp_path):
    """No design of a Pareto front has ``closes = 1`` if the condition is ``closes < 1``.

    `closes` is the fraction of samples at which a design can be assembled. It is exactly 1
    for many designs that vary these sizes, so equality has to be excluded.
    """
    path = tmp_path / "front.toml"
    path.write_text(
        """
format = 1
mechanism = "four_bar"
samples = 13
minimise = ["peak", "-sw"]
where = ["closes < 1"]
vary = { "links.2.arc" = [15, 100], "links.4.arc" = [30, 60] }
figures = { peak = "max(abs(torque))", sw = "range(theta_41)" }
"""
    )
    result = sk.synthesize(path, designs=256, starts=1)
    columns = result.synthesis.sweep.tabulate_designs(
        result.values.T, np.arange(len(result.values))
    )
    for number, mode in enumerate(result.modes):
        is_row = (columns["design"] == number) & (columns["mode"] == mode)
        assert columns["closes"][is_row] < 1.0


@pytest.mark.parametrize(
    ("name", "minimise"),
    [
        ("objective", '"-objective"'),
        ("objective_2", '["objective_2", "links_2_arc"]'),
        ("match", '"match"'),
    ],
)
def test_a_figure_with_the_name_of_a_column_of_the_result_is_refused(
    name, minimise, tmp_path
):
    """A figure of merit must not have the name of another column of the result.

    The result of a synthesis has a column for each objective in `minimise`. It is called
    "objective", or "objective_1", "objective_2" if there are several. The column "match"
    has the error at the precision points. Here the figure of merit has the name `name`,
    which is one of these names.
    """
    path = tmp_path / "synthesis.toml"
    path.write_text(
        f"""
format = 1
mechanism = "four_bar"
samples = 7
minimise = {minimise}
vary = {{ "links.2.arc" = [15, 30] }}
figures = {{ {name} = "max(abs(torque))" }}
match = {{ quantity = "theta_41", at = [0], values = [100] }}
"""
    )
    with pytest.raises(DesignError, match=f'two columns would be called "{name}"'):
        sk.synthesize(path, designs=4, starts=1)


def test_a_synthesis_without_starts_is_refused():
    path = EXAMPLES / "torque.toml"
    with pytest.raises(DesignError, match="starts = 0: give at least 1"):
        sk.synthesize(path, designs=4, starts=0)


def test_a_synthesis_is_shown_by_the_name_of_its_class(tmp_path):
    assert repr(synthesize_swing(tmp_path, "sw")).startswith("Synthesis(")
