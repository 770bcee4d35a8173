"""Singularities at the right input, in range or marked; searches that end and say so."""

import numpy as np
import pytest
from helpers.refusals import mechanism_text
from mechanism_examples.mid_plane_mechanism import mid_plane_mechanism
from mechanism_examples.named_mechanisms import four_bar
from mechanism_examples.wide_five_bar import wide_five_bar
from oracles.four_bar_singularities import (
    ROCKER,
    angles_with_links_in_line,
    axes_at_configuration,
    findings_and_warnings,
)
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit import progress
from spherekit.completeness import Guarantee
from spherekit.errors import ModelError
from spherekit.files.mechanism_reader import loads
from spherekit.files.mechanism_writer import dumps
from spherekit.outputs.mid_plane_loci import mid_plane_loci
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.singularities.singular_curves import singular_curves
from spherekit.singularities.singular_surface import singular_surface
from spherekit.time_limit import TimeLimit

NAME = "singularities"
GEARED = mechanism_text("geared_five_bar_singular_roots")
"""A five-bar whose cranks are wheels of 20 and 40 teeth: the input comes back after 720."""


def geared_five_bar(tmp_path, low_deg, high_deg):
    """Return the five-bar on wheels whose input runs between two angles."""
    path = tmp_path / "geared.toml"
    path.write_text(GEARED.format(low=low_deg, high=high_deg))
    return sk.load(path)


def dead_centres_of_geared_five_bar(mechanism, low, high):
    """Return the sorted inputs (rad) at which a geared five-bar has its couplers in line.

    A test compares the computed singularities with these inputs. The two cranks, left and
    right, are geared to each other, with 20 and 40 teeth. The couplers join their tips. The
    axes of one configuration are computed by the position analysis. From there both tips
    are turned about the fixed axes: the left one by the change of the input, the right one
    by half of it in the opposite sense.

    The couplers have arcs of 60 and 55 degrees. They are in line where the arc between the
    tips is the sum or the difference of these two arcs. The arc between the tips is
    computed at 2001 inputs from `low` to `high`. Between two inputs at which it passes the
    sum or the difference, the dead centre is found as a root.
    """
    motion = PositionAnalysis(mechanism, samples=61).motion()
    row = int(np.flatnonzero(~motion.failed)[0])
    axes = axes_at_configuration(mechanism, motion.values[row : row + 1])[0]
    left_axis, right_axis, left_tip, right_tip = (
        axes[mechanism.pair_number[name]] for name in ("left", "right", "32", "54")
    )

    def gap_between_tips(q):
        """Return the arc (n,) between the crank tips at inputs (n,) in rad."""
        angle = np.atleast_1d(q)[:, None] - motion.inputs[row, 0]
        first = Rotation.from_rotvec(angle * left_axis).apply(left_tip)
        second = Rotation.from_rotvec(-angle * 20 / 40 * right_axis).apply(right_tip)
        return np.arccos(np.sum(first * second, axis=1))

    inputs = np.linspace(low, high, 2001)
    dead_centres = []
    for arc_in_line in np.radians([60.0 + 55.0, 60.0 - 55.0]):
        differences = gap_between_tips(inputs) - arc_in_line
        for k in np.flatnonzero(np.diff(np.sign(differences))):
            root = brentq(
                lambda q, arc=arc_in_line: gap_between_tips(q)[0] - arc,
                inputs[k],
                inputs[k + 1],
                xtol=1e-14,
            )
            dead_centres.append(root)
    return np.sort(dead_centres)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(
    ("low_deg", "high_deg"),
    [
        (400.0, 620.0),
        pytest.param(0.0, 720.0, marks=pytest.mark.long),
        (-360.0, 360.0),
        pytest.param(-300.0, 1000.0, marks=pytest.mark.long),
    ],
)
def test_dead_centres_of_a_geared_five_bar_are_listed_in_their_turn(
    low_deg, high_deg, tmp_path
):
    """The wheels are back after 720 degrees, so an input is no angle modulo 360 degrees."""
    mechanism = geared_five_bar(tmp_path, low_deg, high_deg)
    low, high = np.radians([low_deg, high_deg])
    expected = dead_centres_of_geared_five_bar(mechanism, low, high)
    assert len(expected)
    frame = sk.run(mechanism, NAME, samples=13).frame()
    inside = frame[frame["inside"] == "yes"]
    assert set(inside["kind"]) == {"II"}
    assert np.unique(np.round(inside["q"], 7)) == pytest.approx(expected, abs=1e-7)
    outside = frame[frame["inside"] == "no"]["q"]
    assert np.all((outside < low) | (outside > high))


DWELL = mechanism_text("dwell_drive")
"""A cam swings a wheel that turns the crank of a four-bar: what has rolled at an input
does not grow with the input, but comes back with it."""


def test_singularities_outside_the_range_are_listed_at_the_nearest_turn():
    """A dead centre just above the range of the input is marked as outside the range.

    A dead centre is a singularity of type II, where the input turns back. Its input is
    determined up to whole turns, and the listed value is the one nearest to the range. A
    run over the full range has the dead centre of the closed form, where coupler and rocker
    are in line.
    """
    closed_form = np.max(angles_with_links_in_line(*ROCKER))
    frame = sk.run(four_bar(ROCKER), NAME, samples=9).frame()
    dead_centres = np.sort(frame[frame["kind"] == "II"]["q"])
    differences = np.mod(dead_centres - closed_form + np.pi, 2 * np.pi) - np.pi
    assert np.min(np.abs(differences)) < 1e-9

    low = dead_centres[0] - 0.3
    high = dead_centres[0] - 0.1
    path = np.linspace(low, high, 9)[:, None]
    result = sk.run(four_bar(ROCKER).with_inputs("21"), NAME, path=path)
    frame = result.frame()
    type_2 = frame[frame["kind"] == "II"]
    assert set(type_2["inside"]) == {"no"}
    turns = 2 * np.pi * np.array([[0], [1], [-1]])
    inputs_by_turn = type_2["q"].to_numpy() + turns
    distances_by_turn = np.maximum(low - inputs_by_turn, inputs_by_turn - high)
    listed, turn_later, turn_earlier = distances_by_turn
    assert np.all(listed > 0.0)
    assert np.all(listed <= turn_later)
    assert np.all(listed <= turn_earlier)
    # The summary counts singularities within the range by their types, and those outside.
    findings, _ = findings_and_warnings(result)
    assert "II" not in findings["singularities"]
    assert findings["outside"]["II"] == len(type_2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("low_deg", "high_deg"), [(0.0, 720.0), (-500.0, 400.0), (10.0, 370.0)]
)
def test_singularities_are_listed_for_every_turn_of_a_range(low_deg, high_deg):
    """All dead centres of a rocker within a range of several turns are listed.

    A dead centre is a singularity of type II, where the input turns back. The expected ones
    follow from the spherical law of cosines, from three turns below to three turns above.
    The column ``input_margin_II`` of a row is the distance of its input (rad) to the
    nearest singularity of type II.
    """
    turns_deg = np.arange(-3, 4)[:, None] * 360.0
    dead_centres_deg = turns_deg + np.degrees(angles_with_links_in_line(*ROCKER))
    is_inside = (dead_centres_deg > low_deg) & (dead_centres_deg < high_deg)
    expected_deg = np.sort(dead_centres_deg[is_inside])
    mechanism = four_bar(ROCKER).with_inputs("21")
    path = np.radians(np.linspace(low_deg, high_deg, 31))[:, None]
    result = sk.run(mechanism, NAME, path=path)
    frame = result.frame()
    type_2 = frame[frame["kind"] == "II"]
    assert np.degrees(np.sort(type_2["q"])) == pytest.approx(expected_deg, abs=1e-7)
    # All are within the range, and both assembly modes meet at each.
    assert set(type_2["inside"]) == {"yes"}
    assert set(type_2["assembly_mode"]) == {"0+1"}
    findings, _ = findings_and_warnings(result)
    assert not findings["checks_failed"]
    assert "complete" in findings["guarantee"]

    relation = result.frame(NAME, "relation").dropna(subset="input_margin_II")
    q = relation["q"].to_numpy()
    margin = relation["input_margin_II"].to_numpy()
    assert len(q)
    dead_centres = np.radians(dead_centres_deg.ravel())
    # (above or below, rows, dead centres)
    differences = np.stack([q + margin, q - margin])[..., None] - dead_centres
    assert np.all(np.min(np.abs(differences), axis=(0, 2)) < 1e-7)


@pytest.mark.slow
def test_a_place_at_both_ends_of_a_turn_is_listed_once():
    """90 + 40 = 60 + 70: at q = 180 deg the four-bar lies in one plane."""
    made = four_bar(np.radians([90.0, 40.0, 60.0, 70.0])).with_inputs("21")
    path = np.radians(np.linspace(-180.0, 180.0, 9))[:, None]
    result = sk.run(made, NAME, path=path)
    frame = result.frame()
    own = frame[frame["kind"] == "III"]
    assert len(own) == 1 and set(own["assembly_mode"]) == {"0+1"}
    assert abs(np.degrees(own["q"].iloc[0])) == pytest.approx(180.0)
    relation = result.frame(NAME, "relation")
    at = relation[relation["status"].astype(str) == "AT_SINGULARITY"]
    assert len(at) and set(at["type"]) == {"III"} and set(at["group"]) == {1}
    to, away = relation["input_margin_II"], np.pi - relation["q"].abs()
    assert to.count() > 9 and (to - away).abs().max() < 1e-11


def check_points(position_analysis, points, kind):
    """Check the points that a search for singular configurations has found.

    All loops must be closed at each point. If the search was for type II, each point must
    be singular of this type. The flags `inside` must say whether the inputs are within
    their ranges.

    Parameters
    ----------
    position_analysis
        The mechanism with its solver.
    points
        Configurations on singular curves or on a singular surface. `values` are all pair
        variables (rad). The angles of inputs in them may differ by whole turns from
        `inputs` (rad).
    kind
        Type of the search, "I" or "II". At type II the columns of the passive pairs (all
        but the inputs) in the Jacobian of the loops are linearly dependent. Type I is not
        checked.
    """
    mechanism = position_analysis.mechanism
    solver = position_analysis.solver
    driven = list(solver.driven)
    values = points.values.copy()
    turns = (points.inputs - values[:, driven]) / (2.0 * np.pi)
    assert np.max(np.abs(turns - np.round(turns)), initial=0.0) < 1e-9
    # The loops must close at `inputs`, the numbers that users get.
    values[:, driven] = points.inputs
    closure = solver.closure.linearise(values)
    assert np.max(closure.closure_residual, initial=0.0) < 1e-12

    low, high = np.transpose([item.range for item in mechanism.inputs])
    is_above_low = np.all(points.inputs >= low - 1e-9, axis=1)
    is_below_high = np.all(points.inputs <= high + 1e-9, axis=1)
    assert np.array_equal(is_above_low & is_below_high, points.inside)
    if kind == "II":
        passive = np.delete(np.arange(values.shape[1]), driven)
        passive_jacobian = closure.jacobian[:, :, passive]
        singular_values = np.linalg.svd(passive_jacobian, compute_uv=False)
        assert np.max(singular_values[:, -1], initial=0.0) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["I", pytest.param("II", marks=pytest.mark.long)])
def test_surfaces_from_random_starts_lie_within_the_ranges_of_inputs(kind):
    """A singular surface of three inputs is a mesh of singular points within their ranges.

    At a singularity of type I an input can move while the output rests. At type II the
    output can move while the inputs are locked.

    The mesh is consistently oriented: no directed edge belongs to two triangles. The
    surface of type II is complete: its border is on ends of input ranges. Surfaces of type
    I cross each other, and their mesh ends where they do. The border and the lengths of
    edges are checked for type II only.
    """
    # The wanted length of edges (rad). The first mesh has edges of up to 1.5 times this
    # length, which are then halved once.
    side = 0.25
    mechanism = sk.load("three_rrr")
    # Without slices (curves of configurations with two of three inputs locked) the search
    # starts from random configurations.
    mesh = singular_surface(mechanism, kind, side=side, halved=1, slices_of_each=0)
    assert len(mesh.points.values)
    # Random starts may miss a part of the surface, and the result says so.
    assert mesh.claim.guarantee is Guarantee.SAMPLED
    assert np.all(mesh.points.inside)
    check_points(PositionAnalysis(mechanism, samples=3), mesh.points, kind)
    directed_edges = np.concatenate(
        [mesh.triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))]
    )
    assert len(np.unique(directed_edges, axis=0)) == 3 * len(mesh.triangles)
    if kind == "I":
        return

    range_ends = np.array([(item.start, item.stop) for item in mechanism.inputs])
    # (border edges, both vertices, inputs, both ends)
    distances = np.abs(mesh.points.inputs[mesh.border][..., None] - range_ends)
    # Both vertices of an edge are on the same end of the range of the same input.
    of_farther_vertex = np.max(distances, axis=1)
    to_nearest_end = np.min(of_farther_vertex, axis=(1, 2))
    assert np.max(to_nearest_end) < 1e-9
    # One edge of each triangle.
    first = mesh.points.values[mesh.triangles[:, 0]]
    second = mesh.points.values[mesh.triangles[:, 1]]
    differences = first - second
    differences -= 2.0 * np.pi * np.round(differences / (2.0 * np.pi))
    assert np.max(np.linalg.norm(differences, axis=1)) < 0.75 * side


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["I", "II"])
def test_random_starts_find_the_curves_that_slices_find(kind):
    """Each point of the singular curves by slices is on a curve that random starts find.

    A slice is the set of configurations with all inputs but one locked. A search by slices
    (here at 4 values of each input) guarantees that no curve larger than a box is missing.
    A search from random configurations, without slices, guarantees nothing.

    In a singular configuration a singular motion is possible, in which inputs or output
    rest (`motion`, rates of all variables). A point is on a curve if its configuration and
    its singular motion are. Points inside the ranges of the inputs are compared.
    """
    mechanism = wide_five_bar()
    by_slices = singular_curves(mechanism, kind, slices_of_each=4)
    by_starts = singular_curves(mechanism, kind, slices_of_each=0)
    assert by_slices.claim.guarantee is Guarantee.TO_BOX
    assert by_starts.claim.guarantee is Guarantee.SAMPLED
    position_analysis = PositionAnalysis(mechanism, samples=3)
    assert any(np.any(curve.points.inside) for curve in by_slices.curves)
    for curve in by_slices.curves:
        check_points(position_analysis, curve.points, kind)
        inside = curve.points.rows(curve.points.inside)
        is_on_curve = []  # (curves by random starts, points)
        for other in by_starts.curves:
            # `find` says for each point whether it is on this curve.
            _report, followed_curve = other.traced
            is_on_curve.append(followed_curve.find(inside.values, inside.motion))
        assert np.all(np.any(is_on_curve, axis=0))


def test_a_search_without_time_says_so():
    """With 0 s of processor time nothing is searched, and each part of the run says so.

    A search that was stopped only claims that it has sampled (`Guarantee.SAMPLED`), because
    anything may be missing. The analysis (`NAME`) searches curves of type I and of type II,
    and aspects: sets of configurations that are connected without singularities.

    The rows of the motion (its samples in each assembly mode, or way to assemble the links)
    are examined nevertheless. The agile eye is of type I in every row of four modes. This
    must be a remark, and no warning may speak of it.
    """
    time_limit = TimeLimit(0.0, "curves of type II")
    curves = singular_curves(sk.load("five_bar"), "II", budget=time_limit)
    assert not curves.curves
    assert curves.claim.guarantee is Guarantee.SAMPLED
    assert "stopped after 0 s of processor time" in curves.claim.reason

    result = sk.run(sk.load("agile_eye"), f"{NAME}:slices=6,seconds=0", samples=3)
    assert not len(result.frame())
    assert not len(result.frame(NAME, "aspects"))
    remarks = result.summary["remarks"]
    stopped = [text for text in remarks if "stopped after 0 s of processor time" in text]
    for part in ("type II", "type I", "aspects"):
        assert any(part in text for text in stopped)
    assert any("in every row of assembly modes 2, 3, 6, 7" in text for text in remarks)
    assert "type I of" not in " ".join(result.summary["warnings"])


@pytest.mark.slow
def test_a_search_tells_what_it_does(monkeypatch):
    monkeypatch.setattr(progress, "REPORT_INTERVAL_S", 0.0)
    told = []
    with progress.progress_listener(lambda report: told.append(report.text)):
        singular_curves(sk.load("five_bar"), "II", slices_of_each=1)
    assert "search: slice 1 of 1" in told[0]
    assert any("curve 1 of type II" in words for words in told)


@pytest.mark.slow
def test_a_differential_is_singular_everywhere_and_has_no_regular_part():
    """One axis for both inputs and the output: two inputs always rest it in some motion."""
    result = sk.run(sk.load("bevel_differential"), f"{NAME}:input_grid=5", samples=5)
    relation = result.frame(NAME, "relation")
    assert set(relation["type"]) == {"I"}
    assert not len(result.frame(NAME, "aspects"))
    remarks = " ".join(result.summary["remarks"])
    assert remarks.count("of type I in every configuration") == 1
    assert "aspect" not in remarks
    assert (relation["input_rate"] > 0.0).all() and relation["c"].isna().all()


@pytest.mark.slow
def test_three_inputs_have_surfaces_by_default_and_every_vertex_a_reason():
    result = sk.run(sk.load("three_rrr"), f"{NAME}:input_grid=0", samples=3)
    frame = result.frame()
    assert {"I", "II"} == set(frame["kind"])
    assert frame["condition"].astype(bool).all()
    remarks = result.summary["remarks"]
    assert sum("random starts" in each for each in remarks) == 2


def test_a_driven_link_is_no_output_by_default():
    made = sk.load("four_bar").with_inputs("41")
    result = sk.run(made, NAME, samples=9)
    assert "4/1" not in set(result.frame(NAME, "relation")["output"])


@pytest.fixture(scope="module")
def mid_plane():
    made = sk.load("two_dof_spm")
    return made, {kind: mid_plane_loci(made, kind) for kind in ("I", "II")}


@pytest.mark.slow
def test_mid_plane_loci_are_singular(mid_plane):
    made, loci = mid_plane
    tracer = PositionAnalysis(made, samples=3)
    for kind, found in loci.items():
        assert found.curves
        for each in found.curves:
            check_points(tracer, each.points, kind)
            assert np.max(each.points.residual) < 1e-12


@pytest.mark.slow
def test_mid_plane_loci_of_type_one_are_circles_at_the_limit_of_reach(mid_plane):
    """There base axis and mid-plane are the leg's arc apart, 40 deg: n . b = sin 40 deg."""
    made, loci = mid_plane
    form = sk.mid_plane_form(made)
    for each in loci["I"].curves:
        normals, off = form.normals(each.points.orientation)
        assert np.max(off) < 1e-9
        heights = np.abs(normals @ form.plane.axes[list(form.plane.driven)].T)
        assert np.max(np.min(np.abs(heights - np.sin(np.radians(40.0))), axis=1)) < 1e-9


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(
    "name", ["shaped_flat_cam", "shaped_cam", "roller_cam", "four_bar", "stephenson", DWELL]
)
def test_the_output_reverses_where_singularities_are_listed(name, tmp_path):
    """Between samples the output's rate reverses if an odd number of reversals is listed.

    The rate is the velocity coefficient times the pole axis of table `poles` (the axis of
    the output's rotation and its rate per rate of the input). The scalar product of the
    rates at two successive samples is negative where the rate reverses between them.
    Singularities come from the analysis "singularities" (`NAME`). A label such as "0+1"
    lists all assembly modes (ways to assemble the links) of a singularity. `DWELL` is the
    file of a cam drive, other names are shipped mechanisms.
    """
    (tmp_path / "dwell.toml").write_text(DWELL)
    mechanism = sk.load(tmp_path / "dwell.toml" if name == DWELL else name)
    (output,) = mechanism.outputs
    pole = f"{output.link}/{output.relative_to}"
    poles = sk.run(mechanism, f"poles:only={pole}", samples=61).frame("poles")
    singularities = sk.run(mechanism, NAME, samples=61).frame()
    is_reversal = singularities["reversal"].str.contains("output", na=False)
    reversals = singularities[is_reversal]
    modes_of_reversals = reversals["assembly_mode"].str.split("+")
    reversal_count = 0
    for mode, rows in poles.groupby("assembly_mode"):
        q = rows["q"].to_numpy()
        rates = rows[["ux", "uy", "uz"]].to_numpy()
        rates = rates * rows["velocity_coefficient"].to_numpy()[:, None]
        products = np.sum(rates[1:] * rates[:-1], axis=1)
        is_of_mode = [str(mode) in modes for modes in modes_of_reversals]
        reversal_inputs = reversals["q"][is_of_mode]
        for k in np.flatnonzero(np.isfinite(products)):
            is_between = reversal_inputs.between(q[k], q[k + 1], inclusive="neither")
            assert is_between.sum() % 2 == int(products[k] < 0.0), (mode, q[k])
        reversal_count += np.sum(products < 0.0)
    assert reversal_count


@pytest.mark.slow
@pytest.mark.parametrize("arcs_deg", [(40.0, 50.0), (30.0, 10.0), (1.0, 1.0)])
def test_curves_of_type_one_end_only_where_another_leg_is_at_its_limit(arcs_deg):
    """Each end has n_z = 0, or ``|n . b| = sin a`` for another leg; bands may be narrow."""
    driven_deg, third_deg = arcs_deg
    sizes_deg = [60.0, driven_deg, driven_deg, 60.0, driven_deg, driven_deg]
    mechanism = mid_plane_mechanism(np.radians([*sizes_deg, third_deg, third_deg]))
    form = sk.mid_plane_form(mechanism)
    plane = form.plane
    curves = mid_plane_loci(mechanism, "I").curves
    assert curves
    for curve in curves:
        normals, _ = form.normals(curve.points.orientation)
        for normal in normals[[0, -1]]:
            angles = np.arcsin(np.abs(plane.axes @ normal))
            at_limit = np.abs(angles - plane.reach) < 1e-7
            # A point at which two legs are at their limits may be left out at n_z = 0.
            assert np.sum(at_limit) >= 2 or abs(normal[2]) < np.radians(1.0)


@pytest.mark.slow
def test_curves_of_type_two_have_no_gap_at_a_zero_in_a_mesh_vertex(mid_plane):
    """By symmetry, a mode and its opposite have curves of equal lengths."""
    _mechanism, loci = mid_plane
    for third_sign in (1, -1):
        modes = ((1, 1, third_sign), (-1, -1, -third_sign))
        lengths = [
            sorted(np.ptp(each.s) for each in loci["II"].curves if each.modes == mode)
            for mode in modes
        ]
        assert len(lengths[0]) == len(lengths[1])
        assert np.allclose(*lengths, atol=1e-9)


@pytest.mark.slow
def test_over_constrained_mid_plane_loops_have_curves_of_type_one_only():
    """For an over-constrained mechanism there are curves of type I, but None for type II.

    Base and output of the mechanism mirror each other in a plane, the mid-plane. A singular
    curve is a curve of normals of this plane. Curves of type I, at which an input can move
    while the output rests, have a closed form. Curves of type II are zeros of the
    determinant of the velocity equations with locked inputs.

    Here one more arc-prismatic pair (P) joins links 9 and 10. It adds a loop of three
    equations, but only one variable. So the velocity equations are not square.
    """
    text = dumps(sk.load("two_dof_spm"))
    for link, axes in (("9", '"9_2", "11_9"'), ("10", '"10_6", "11_10"')):
        old = f"[links.{link}]\naxes = [{axes}]\narcs = [90.0]\n"
        assert text.count(old) == 1
        new = f'[links.{link}]\naxes = [{axes}, "10_9"]\narcs = [90.0, 90.0]\n'
        text = text.replace(old, f"{new}angles = [0.0]\n")
    pair = '[pairs.10_9]\ntype = "P"\nlinks = ["10", "9"]\n\n'
    text = text.replace("[inputs.21]", pair + "[inputs.21]")
    mechanism = loads(text)
    assert mid_plane_loci(mechanism, "II") is None
    assert mid_plane_loci(mechanism, "I").curves


def test_legs_too_short_to_meet_one_mid_plane_are_refused():
    mechanism = mid_plane_mechanism(np.radians([60, *[0.05] * 2, 60, *[0.05] * 4]))
    with pytest.raises(ModelError, match="no mid-plane was found that all legs reach"):
        sk.mid_plane_form(mechanism)
