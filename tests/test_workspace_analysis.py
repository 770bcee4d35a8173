"""The analysis `workspace`: the directions or orientations that an output can reach.

A working mode is the choice of one inverse solution per leg. It is written as one sign per
leg, for example "+-". Type I singularities are those of a leg, type II those of the output
with locked inputs; `type_1` and `type_2` are sines of the angle to them (0 = singular).
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from helpers.analysis_runs import run_single_analysis
from helpers.scene_listener import SceneListener
from mechanism_examples.named_mechanisms import (
    mechanism_from_sizes,
    platform_with_unlike_legs,
)
from oracles.closed_forms import mid_plane_area
from oracles.sphere_areas import common_area
from spherekit_analyses.workspace_modes import (
    DistinctPoses,
    WorkspaceModes,
    read_distinct_poses,
)

import spherekit as sk
from spherekit.geometry.rotation import from_quaternion, transpose
from spherekit.geometry.sphere_mesh import spiral_directions
from spherekit.geometry.tilt_torsion import azimuth_tilt, euler_zyz
from spherekit.geometry.triangle import arc
from spherekit.mechanism.elements import Output
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.outputs.forward_kinematics import ForwardKinematics
from spherekit.outputs.inverse_kinematics import InverseKinematics
from spherekit.outputs.pose_constraints import (
    AngleLimit,
    Constraints,
    InterferenceLimit,
    bounds_of,
    find_least_margin,
)
from spherekit.outputs.pose_solver import closed_kinematics
from spherekit.outputs.workspace import (
    direction_workspaces,
    judge,
    make_margins,
    nearest_reachable,
    orientation_samples,
    orientation_workspaces,
)
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.scenes.scene import SphereCurves, SphereMap, Text
from spherekit.status import Status

DIRECTIONS = spiral_directions(20_000)
"""(20000, 3) unit vectors spread evenly over the sphere."""
COUNTED_AREA_ERROR_SR = 0.02
"""Error of an area counted from `DIRECTIONS`; one direction stands for 4 pi/20000 sr."""


run_workspace = partial(run_single_analysis, "workspace")


FIVE_BAR = sk.load("five_bar")
"""A five-bar driven at both ground pairs, 21 and 51; its output is a direction."""


@pytest.fixture(scope="module")
def mid_plane_kinematics():
    """Return the inverse kinematics of the mid-plane mechanism of Chen et al. 2021."""
    return closed_kinematics(sk.load("two_dof_spm"))


def interference_limits_of_the_paper():
    """Return the rule of Chen et al.: two pairs of axes stay 10 degrees apart."""
    least_angle = np.radians(10.0)
    return Constraints(
        apart=(
            InterferenceLimit("21", "43", least_angle),
            InterferenceLimit("61", "54", least_angle),
        )
    )


def five_bar_with_driving_four_bar():
    """Return a five-bar of seven links, one crank of which is driven through a four-bar.

    The sizes of a link are its axes, the arcs from its first axis to each further one, and
    the angles between these arcs, in degrees. The output is a direction (pointer) in the
    second coupler: the z axis of this link, which is its first axis c. The last argument
    states for each input the angle (rad) between the first arcs of its two links at which
    the input is 0.

    Tests of limits need this five-bar as an example with an inner loop. The loop consists
    of base, drive, rod and crank2.
    """
    return mechanism_from_sizes(
        {
            "base": ("a1 a2 d2", [70.0, 95.0], [30.0]),
            "crank1": ("a1 b1", [50.0], []),
            "coupler1": ("b1 c", [75.0], []),
            "drive": ("d2 e2", [35.0], []),
            "rod": ("e2 f2", [78.0], []),
            "crank2": ("a2 f2 b2", [40.0, 65.0], [75.0]),
            "coupler2": ("c b2", [70.0], []),
        },
        {
            "a1": "base crank1",
            "b1": "coupler1 crank1",
            "c": "coupler1 coupler2",
            "d2": "drive base",
            "e2": "drive rod",
            "f2": "rod crank2",
            "a2": "base crank2",
            "b2": "crank2 coupler2",
        },
        ["a1", "d2"],
        Output("tip", "coupler2", "base", (0.0, 0.0, 1.0)),
        {"a1": 0.4, "d2": -0.7},
    )


@pytest.mark.parametrize("least_angle_deg", [0, 10])
def test_area_of_the_five_bar_is_that_of_intersected_caps(least_angle_deg):
    """The reachable area of each working mode of a five-bar is right.

    A working mode is a choice of one way to bend each leg. Each leg spans at most 150
    degrees, so a direction is reachable if it is at most 150 degrees from both driven axes
    (x and y). With a least angle it must also be at least that angle from them.
    `common_area` computes the area of these intersected caps by quadrature. The area may be
    off by the stated error.

    The parts that cannot be reached are two caps of 30 degrees about -x and -y, and with a
    least angle two more about x and y. One of these caps
    counts as the outside of the workspace, and each other cap counts as a hole.
    """
    # Caps about x and y: inside of 150 degrees, and outside of the least angle.
    cap_centres = np.eye(3)[[0, 1, 0, 1]]
    cap_radii = np.radians([150.0, 150.0, least_angle_deg, least_angle_deg])
    exact_area_sr = common_area(cap_centres, cap_radii, [True, True, False, False])
    # The axes of the pairs 21 and 43, and 43 and 51, are at least this angle apart. The
    # axis of pair 43 is the direction of the output.
    apart = f"21/43:{least_angle_deg}+43/51:{least_angle_deg}"

    hole_count = 3 if least_angle_deg else 1
    limit_count = 4 if least_angle_deg else 2
    for tolerance in (1e-2, 1e-4, 1e-6):
        result, findings = run_workspace(FIVE_BAR, apart=apart, tolerance=tolerance)
        assert list(findings["working_modes"]) == ["++", "+-", "-+", "--"]
        for region in findings["working_modes"].values():
            area_error_sr = abs(region["area_sr"] - exact_area_sr)
            assert area_error_sr <= region["error_sr"] <= tolerance * exact_area_sr
            assert len(region["components"]) == 1
            assert len(region["holes"]) == hole_count
            assert len(region["bounded_by"]) == limit_count
    # The table of areas at the last tolerance, 1e-6, has the exact area too.
    assert area_error_sr < 1e-6 * exact_area_sr
    areas = result.frame("workspace", "areas")
    whole = areas[areas.part == "whole"]
    assert np.abs(whole["size"] - exact_area_sr).max() < 1e-6 * exact_area_sr
    # The other rows of a mode are the reachable component, the outside and the holes.
    # Together these cover the sphere.
    parts = areas[(areas["working_mode"] == "++") & (areas["part"] != "whole")]
    assert abs(parts["size"].sum() - 4.0 * np.pi) < 1e-9


@pytest.fixture(scope="module")
def five_bar_result():
    """Return the workspace of mode +-, where 21 and 43 stay 10 degrees apart."""
    result, _ = run_workspace(FIVE_BAR, apart="21/43:10", working_mode="+-")
    return result


def angle_between_21_and_43(directions):
    """Return the angles (n,) in rad between the axes 21 and 43 in mode +-."""
    rows = closed_kinematics(FIVE_BAR).at(directions, (1, -1))
    pair_numbers = [FIVE_BAR.pair_number[pair] for pair in ("21", "43")]
    return np.arccos(rows.cosine(*pair_numbers))


def test_samples_of_the_five_bar_agree_with_its_kinematics(five_bar_result):
    """A sample of a workspace is inside where inverse kinematics and limits allow it.

    `five_bar_result` is the workspace of the working mode +- (signs 1 and -1 of the two
    legs), in which the axes of the pairs 21 and 43 must be 10 degrees apart. Forward
    kinematics of the inputs of a sample must lead back to its direction. `type_1` (a value
    for each input) and `type_2` measure the distance from singularities of types I and II.
    They are zero at a singularity. The table has the least of the values of `type_1`.
    """
    table = five_bar_result.frame("workspace")
    directions = table[["x", "y", "z"]].to_numpy()
    inverse = InverseKinematics(FIVE_BAR).at(directions, [(1, -1)])

    is_apart = angle_between_21_and_43(directions) >= np.radians(10.0)
    is_inside = (inverse.status[0] == Status.OK) & is_apart
    assert np.array_equal(table["inside"] == "yes", is_inside)

    inputs = table[["q_21", "q_51"]].to_numpy()
    assert np.allclose(inputs, inverse.inputs[0], atol=1e-12, equal_nan=True)
    forward = ForwardKinematics(FIVE_BAR).at(inputs[is_inside])
    # Forward kinematics has several modes; the nearest one is the one of the sample.
    misses = np.linalg.norm(forward.directions - directions[is_inside], axis=2)
    assert misses.min(axis=0).max() < 1e-9

    least_type_1 = inverse.type_1[0].min(axis=1)
    type_2 = inverse.type_2[0]
    assert np.allclose(table["type_1"][is_inside], least_type_1[is_inside], atol=1e-12)
    assert np.allclose(table["type_2"][is_inside], type_2[is_inside], atol=1e-12)


def test_points_of_the_five_bar_border_lie_on_their_limit(five_bar_result):
    """Each border point names its limit: 150 degrees of reach, or axes 10 degrees apart."""
    kinematics = closed_kinematics(FIVE_BAR)
    border = five_bar_result.frame("workspace", "boundary")
    directions = border[["x", "y", "z"]].to_numpy()
    limits_of_reach = bounds_of(kinematics, Constraints())
    margin_rad = judge(kinematics, limits_of_reach, (1, -1), directions).margin
    is_reach = border["constraint"].str.contains("at most 150")
    assert is_reach.any() and not is_reach.all()
    assert np.abs(margin_rad[is_reach]).max() < 1e-11
    angles = angle_between_21_and_43(directions[~is_reach])
    assert np.abs(angles - np.radians(10.0)).max() < 1e-11


@pytest.mark.slow
def test_area_of_the_mid_plane_mechanism_is_that_of_the_paper(mid_plane_kinematics):
    """The two largest parts of the workspace have the area by the formula of the paper.

    The mechanism is that of Chen et al. 2021. By the rule of the paper, the axes of the
    pairs 21 and 43 stay at least 10 degrees apart, and those of 61 and 54 too. The exact
    area of one of the two parts is a double integral (`mid_plane_area`). All eight working
    modes (ways to bend the legs) have the same workspace, so seven are reported to be the
    same as the first (`same_as`).
    """
    exact_area_sr = mid_plane_area()
    bounds = bounds_of(mid_plane_kinematics, interference_limits_of_the_paper())
    # Two limits of the rule, and the reach of each of the three legs.
    assert len(bounds) == 2 + 3
    for tolerance in (1e-2, 1e-4, 1e-6):
        workspaces = direction_workspaces(
            mid_plane_kinematics, bounds, mid_plane_kinematics.modes, tolerance
        )
        is_computed = [workspace.same_as is None for workspace in workspaces]
        assert is_computed == [True] + 7 * [False]
        region = workspaces[0].region
        assert region.error <= tolerance * region.area
    # `region` is now the one of the smallest tolerance. Its two largest parts come first,
    # each with a border of four corners.
    for component in region.components[:2]:
        assert abs(component.area - exact_area_sr) < 1e-6 * exact_area_sr
        (boundary,) = component.boundaries
        assert len(region.boundaries[boundary].corners) == 4


@pytest.mark.slow
def test_border_has_the_extreme_angles_of_the_paper():
    """Table 2 of Chen et al.: extremes of phi and gamma (deg) under the 10 degree rule."""
    workspace = "workspace:apart=21/43:10+61/54:10,working_mode=-++,tolerance=1e-2"
    result = sk.run(sk.load("two_dof_spm"), workspace)
    border = result.frame("workspace", "boundary", degrees=True)
    upper = border[border["phi"] > 0.0]
    outer_component = upper.iloc[upper["phi"].argmax()]["component"]
    outer = upper[upper["component"] == outer_component]
    extremes = [*outer["phi"].agg(["min", "max"]), *outer["gamma"].agg(["min", "max"])]
    assert extremes == pytest.approx([11.5519, 95.8430, -67.5085, 67.5085], abs=1e-4)
    assert {"phi", "gamma"} <= set(result.frame("workspace", "workspace").columns)


def test_width_of_links_acts_as_an_angle_between_axes(mid_plane_kinematics):
    """Links of width b on a sphere of radius r stay b/r apart (Chen et al., section 3)."""
    by_width = Constraints(width=np.radians(10.0) * 0.3, radius=0.3)
    margins = []
    for constraints in (interference_limits_of_the_paper(), by_width):
        bounds = bounds_of(mid_plane_kinematics, constraints)
        compute_margins = make_margins(mid_plane_kinematics, bounds, (1, 1, 1))
        margins.append(compute_margins(DIRECTIONS))
    assert np.allclose(margins[0], margins[1], atol=1e-15, equal_nan=True)


@pytest.fixture(scope="module")
def seven_link_case():
    """Return the seven-link five-bar, its kinematics, and limits of several kinds."""
    mechanism = five_bar_with_driving_four_bar()
    kinematics = closed_kinematics(mechanism)
    constraints = Constraints(
        limits=(JointLimit("f2", -2.0, 1.0),),
        apart=(InterferenceLimit("b1", "b2", 0.3), InterferenceLimit("e2", "c", 0.0, 1.9)),
        near=np.radians(6.0),
    )
    return mechanism, kinematics, bounds_of(kinematics, constraints)


@pytest.mark.many
@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, -1)])
def test_limits_of_a_five_bar_with_an_inner_loop_agree_with_brute_force(
    seven_link_case, signs
):
    """`judge` says of the right directions that they are inside the workspace.

    The reference computes the limits from rotation matrices of all links. One crank of this
    five-bar is driven through a four-bar. `seven_link_case` has the mechanism, its
    kinematics and limits (rad):

    - The angle of pair f2 is from -2 to 1.
    - The axes b1 and b2 are at least 0.3 apart, e2 and c at most 1.9 apart.
    - Singularities are at least 6 degrees away. `type_1` (of each input) and `type_2` are
      sines of the angle to a singularity.

    `signs` is the working mode, a sign for each dyad (two links joined by a pair).
    """
    mechanism, kinematics, bounds = seven_link_case
    inverse = InverseKinematics(mechanism)
    # The position solver is driven by the direction, given by azimuth and tilt (rad).
    configurations = inverse.solver.evaluate(
        AssemblyMode(0, signs), azimuth_tilt(DIRECTIONS)
    )
    pair_number = mechanism.pair_number

    def axis(pair):
        """Return the axis (n, 3) of a pair in the frame of the ground."""
        joint = inverse.solver.joints[pair_number[pair]]
        first_link, _ = mechanism.ends[pair_number[pair]]
        # `first` is the frame of the pair in its first link, with the axis as z column.
        axis_in_link = joint.first[:, 2]
        return configurations.rotations[:, first_link] @ axis_in_link

    # -2 <= f2 <= 1 is |f2 + 0.5| <= 1.5, compared modulo whole turns.
    f2 = configurations.values[:, pair_number["f2"]]
    f2_from_middle = np.angle(np.exp(1j * (f2 + 0.5)))
    # The axes of `type_1` are working modes (one), directions and inputs.
    measures = inverse.at(DIRECTIONS, [signs])
    least_sine = np.minimum(measures.type_1[0].min(axis=1), measures.type_2[0])

    is_inside = configurations.status == Status.OK
    is_inside &= np.abs(f2_from_middle) <= 1.5
    is_inside &= arc(axis("b1"), axis("b2")) >= 0.3
    is_inside &= arc(axis("e2"), axis("c")) <= 1.9
    is_inside &= least_sine >= np.sin(np.radians(6.0))

    judgement = judge(kinematics, bounds, signs, DIRECTIONS)
    # Many of the 20000 directions are inside, and many are outside.
    assert 1000 < is_inside.sum() < 15_000
    assert np.array_equal(judgement.inside, is_inside)


@pytest.mark.many
@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, -1)])
def test_area_of_a_five_bar_with_an_inner_loop_is_the_counted_share(seven_link_case, signs):
    """The area under limits between axes is 4 pi times the share of directions inside."""
    _, kinematics, bounds = seven_link_case
    axis_bounds = [bound for bound in bounds if "axes" in bound.name]
    (workspace,) = direction_workspaces(kinematics, axis_bounds, [signs], 1e-2)
    region = workspace.region
    is_inside = judge(kinematics, axis_bounds, signs, DIRECTIONS).inside
    counted_area_sr = 4.0 * np.pi * is_inside.mean()
    assert abs(region.area - counted_area_sr) < region.error + COUNTED_AREA_ERROR_SR
    assert region.error < 1e-2 * region.area


@pytest.mark.slow
def test_orientations_away_from_singularities_have_a_volume():
    """The agile eye has axes about which an input cannot move; the distance exists there.

    All orientations have the volume 8 pi^2 = 78.96; 0.1 rad around singularities is lost.
    """
    kinematics = closed_kinematics(sk.load("agile_eye"))
    bounds = bounds_of(kinematics, Constraints(near=0.1))
    (workspace,) = orientation_workspaces(kinematics, bounds, kinematics.modes[:1], 0.1)
    assert 71.0 < workspace.orientations.volume < 72.5


@pytest.mark.slow
def test_a_direction_outside_gets_the_nearest_reachable_one():
    """For a direction outside of a workspace, the nearest reachable direction is found.

    No sampled direction inside may be nearer. The five-bar has a limit at the driven pair
    21 (0.7 to 2.4 rad), and bends both legs to the same side (signs 1, 1). `judge` tells
    which directions are inside. The area of the workspace (sr) must agree with the share of
    sampled directions inside.
    """
    kinematics = closed_kinematics(FIVE_BAR)
    bounds = bounds_of(kinematics, Constraints(limits=(JointLimit("21", 0.7, 2.4),)))
    # The area is wanted to a relative error of 1e-3.
    (workspace,) = direction_workspaces(kinematics, bounds, [(1, 1)], tolerance=1e-3)
    is_inside = judge(kinematics, bounds, (1, 1), DIRECTIONS).inside
    counted_area_sr = 4.0 * np.pi * is_inside.mean()
    region = workspace.region
    assert abs(region.area - counted_area_sr) < region.error + COUNTED_AREA_ERROR_SR

    inside = DIRECTIONS[is_inside]
    some_outside = DIRECTIONS[~is_inside][::1500]
    for direction in some_outside:
        nearest, angle = nearest_reachable(kinematics, bounds, workspace, direction)
        judgement = judge(kinematics, bounds, (1, 1), nearest[None])
        assert judgement.inside[0]
        assert np.isfinite(judgement.inputs).all()
        assert angle <= arc(inside, direction).min() + 1e-8
        assert abs(angle - arc(direction, nearest)) < 1e-12

    # A direction that is inside, here any one of them, is its own nearest one.
    _, angle = nearest_reachable(kinematics, bounds, workspace, inside[7])
    assert angle < 1e-7


def test_joint_limits_of_the_mechanism_bound_its_workspace():
    """0.4 <= q_51 <= 2.0 is |q_51 - 1.2| <= 0.8; a second, disjoint range is refused."""
    limited = replace(FIVE_BAR, joint_limits=(JointLimit("51", 0.4, 2.0),))
    kinematics = closed_kinematics(limited)
    (*_, joint_bound) = bounds_of(kinematics, Constraints())
    rows = kinematics.at(DIRECTIONS, (1, -1))
    q_51 = rows.inputs[:, 1]
    is_solved = np.isfinite(q_51)
    is_within = np.abs(q_51 - 1.2) <= 0.8
    has_margin = joint_bound.left(rows) >= 0.0
    assert np.array_equal(has_margin[is_solved], is_within[is_solved])
    with pytest.raises(sk.errors.AnalysisError, match="contradict each other"):
        bounds_of(kinematics, Constraints(limits=(JointLimit("51", 2.5, 3.0),)))


def test_a_reachable_direction_is_inside_in_each_mode():
    _, findings = run_workspace(FIVE_BAR, pose="x=1+y=1+z=0.2")
    assert [row["inside"] for row in findings["pose"]] == ["yes"] * 4


def test_a_direction_out_of_reach_is_answered_with_the_nearest_one():
    """Mode ++ cannot reach the direction -z; the run warns and names the nearest."""
    result, findings = run_workspace(FIVE_BAR, pose="x=0+y=0+z=-1", working_mode="++")
    (row,) = findings["pose"]
    assert row["inside"] == "no"
    nearest = np.array(row["nearest"])
    assert abs(row["away_rad"] - arc(np.array([0.0, 0.0, -1.0]), nearest)) < 1e-12
    kinematics = closed_kinematics(FIVE_BAR)
    bounds = bounds_of(kinematics, Constraints())
    assert judge(kinematics, bounds, (1, 1), nearest[None]).inside[0]
    assert any("is outside in mode ++" in text for text in result.summary["warnings"])


def test_a_pose_given_by_inputs_is_inside_in_the_mode_with_these_inputs():
    """Inputs of 40 and 45 degrees give two directions, one per forward solution."""
    _, findings = run_workspace(FIVE_BAR, pose="21=40+51=45", working_mode="0")
    assert len(findings["pose"]) == 2
    for row in findings["pose"]:
        if np.allclose(np.degrees(row["inputs"]), [40.0, 45.0], atol=1e-9):
            assert row["inside"] == "yes"


def test_an_empty_workspace_names_the_limits_that_exclude_each_other():
    """Axis 43 cannot be within 30 degrees of both 21 and 51, which are 90 degrees apart."""
    result, findings = run_workspace(
        FIVE_BAR, apart="21/43:0:30+43/51:0:30", working_mode="++"
    )
    region = findings["working_modes"]["++"]
    (excluding,) = region["excluding"]
    assert region["area_sr"] == 0.0
    assert "21/43 at most 30 deg" in excluding
    assert "43/51 at most 30 deg" in excluding
    assert any("the workspace is empty" in text for text in result.summary["warnings"])


@pytest.fixture(scope="module")
def unlike_legs():
    """Return kinematics, limits, random orientations and workspaces of unlike legs.

    The orientations are quaternions (20000, 4), uniform over all rotations. The workspaces
    are those of the first two working modes.
    """
    kinematics = closed_kinematics(platform_with_unlike_legs())
    bounds = bounds_of(kinematics, Constraints())
    workspaces = orientation_workspaces(kinematics, bounds, kinematics.modes[:2], 0.05)
    return kinematics, bounds, orientation_samples(20_000), workspaces


@pytest.mark.slow
def test_volume_of_a_platform_with_unlike_legs_is_the_share_that_closes(unlike_legs):
    """The volume of reachable orientations is the share of random ones whose loops close.

    `unlike_legs` has a platform with different legs, its limits, random orientations, and
    the workspaces of two working modes (ways to bend each leg). `judge` says for each
    orientation whether the legs reach it. A position solver, which uses only the graph of
    the mechanism, must agree. All orientations together have the volume 8 pi^2.
    """
    kinematics, bounds, samples, (workspace, second_workspace) = unlike_legs
    signs = kinematics.modes[0]
    solver = InverseKinematics(platform_with_unlike_legs()).solver
    # The solver holds the output by two virtual links with three R pairs between base and
    # platform. Their angles are Euler angles ZYZ of the orientation, and are its inputs.
    angles = euler_zyz(from_quaternion(samples))
    configurations = solver.evaluate(AssemblyMode(0, signs), angles)
    is_inside = judge(kinematics, bounds, signs, samples).inside
    assert np.array_equal(is_inside, configurations.status == Status.OK)
    # The second workspace is its own, or marked as equal to that of the first mode.
    assert second_workspace.same_as in (None, signs)

    share = is_inside.mean()
    # Four standard deviations of a share counted from independent samples.
    share_error = 4.0 * np.sqrt(share * (1.0 - share) / len(samples))
    # The volume of the set of all orientations in the workspace.
    volume = workspace.orientations
    # `fraction` is the volume divided by 8 pi^2.
    volume_error_as_share = volume.error / (8.0 * np.pi**2)
    assert abs(volume.fraction - share) < share_error + volume_error_as_share


@pytest.mark.slow
def test_an_orientation_out_of_reach_gets_a_reachable_one_at_the_stated_angle(unlike_legs):
    """The angle is that of the rotation between both, from the trace of its matrix."""
    kinematics, bounds, samples, (workspace, _) = unlike_legs
    signs = kinematics.modes[0]
    is_inside = judge(kinematics, bounds, signs, samples).inside
    outside = samples[~is_inside][3]
    nearest, angle = nearest_reachable(kinematics, bounds, workspace, outside)
    assert judge(kinematics, bounds, signs, nearest[None]).inside[0]
    rotation = transpose(from_quaternion(outside[None])) @ from_quaternion(nearest[None])
    angle_by_trace = np.arccos(0.5 * (np.trace(rotation[0]) - 1.0))
    assert abs(angle_by_trace - angle) < 1e-6


def test_orientations_are_written_as_unit_quaternions():
    """The agile eye reaches all orientations, whose volume is 8 pi^2."""
    result, findings = run_workspace(
        sk.load("agile_eye"), tolerance=0.2, working_mode="0", pose="qx=0+qy=0+qz=0+qw=1"
    )
    (workspace,) = findings["working_modes"].values()
    assert 0.0 < workspace["volume"] <= 8.0 * np.pi**2 + workspace["error"]
    table = result.frame("workspace")
    assert len(table) == 4000
    assert np.allclose(np.linalg.norm(table[["x", "y", "z", "w"]], axis=1), 1.0)
    assert len(findings["pose"]) == 1
    (table,) = result.summary["analyses"][0]["screen_tables"]
    assert table["rows"][0][0].startswith("+++") and table["rows"][0][-1] == "100.0%"


def test_pages_of_a_workspace_show_map_border_mark_and_text():
    """Both pages of a workspace have a coloured map, borders, a mark and a text.

    A run draws its results on named pages, and `SceneListener` collects what is drawn.

    - The map of the page "Workspace" shows the margin: the angle (rad) to the nearest
      limit. The map of the page "Singularity" shows the angle to the nearest singularity.
    - The option `near=15` excludes directions that are less than 15 degrees away from a
      singularity.
    - The limits that bound the workspace have different colours (`tone`).
    - The mark is at the direction with the largest margin.
    """
    listener = SceneListener()
    workspace = "workspace:near=15,working_mode=++"
    sk.run(FIVE_BAR, [workspace], samples=2, recorder=listener)
    assert {"Workspace", "Singularity"} <= set(listener.primitives_by_page)
    for page in ("Workspace", "Singularity"):
        primitives = listener.primitives_by_page[page]
        (sphere_map,) = [item for item in primitives if isinstance(item, SphereMap)]
        assert sphere_map.triangles.max() < len(sphere_map.vertices)
        assert len(sphere_map.vertices) == len(sphere_map.values)
        # Angles to limits and singularities inside the workspace.
        drawn_values = sphere_map.values[np.unique(sphere_map.triangles)]
        assert drawn_values.min() >= 0.0
        assert drawn_values.max() <= np.pi / 2

        # The last item has no curve, only the mark of the largest margin.
        curves = [item for item in primitives if isinstance(item, SphereCurves)]
        *borders, best_direction = curves
        # Singularities of type I of both inputs, and of type II.
        assert len(borders) == 3
        assert len({border.tone for border in borders}) == 3
        # A legend has one entry for equal labels, so item and mark have the same label.
        assert best_direction.label == best_direction.marks[0].label

        (text,) = [item.markdown for item in primitives if isinstance(item, Text)]
        assert "bounded by" in text
        assert "type II at least 15 deg away" in text
        if page == "Singularity":
            assert drawn_values.min() > np.radians(14.999)


def test_rounding_does_not_exclude_an_angle_that_is_on_its_limit():
    """An angle equal to its limit has a margin of zero, not a negative one.

    arccos(cos(limit)) is often below the limit by rounding. The margin is therefore judged
    by the cosine. At least one of the 50 random limits shows the rounding.
    """
    is_rounded_beyond = []
    for limit in np.random.default_rng(1).uniform(0.1, 3.0, 50):
        bound = AngleLimit("a", limit, True, lambda _, x=limit: np.array([np.cos(x)]))
        margins, _ = find_least_margin([bound], None)
        assert 0.0 <= margins[0] < 1e-15
        is_rounded_beyond.append(float(np.arccos(np.cos(limit))) < limit)
    assert any(is_rounded_beyond)


def test_inputs_without_a_pose_are_named():
    """The mechanism closes at only one of two sets of inputs. A warning names the other."""
    result, findings = run_workspace(
        FIVE_BAR, pose="21=40+51=45+21=-130+51=-130", working_mode="0", tolerance=1e-2
    )
    assert len(findings["pose"]) == 2
    (warning,) = result.summary["warnings"]
    assert warning.endswith("No pose was found at the inputs 21 = -130 deg, 51 = -130 deg")


def test_poses_that_are_equal_up_to_rounding_are_examined_once():
    """An angle with a whole revolution more gives the same pose, up to rounding.

    The same orientation written as q and -q, with nearly qw = 0, is also one pose.
    """
    kinematics = closed_kinematics(FIVE_BAR)
    by_direction = "azimuth=10+tilt=20+azimuth=370+tilt=20+azimuth=11+tilt=20"
    assert len(read_distinct_poses(by_direction, kinematics).poses) == 2
    # Each set of inputs has two poses.
    assert len(read_distinct_poses("21=40+51=45+21=400+51=45", kinematics).poses) == 2
    two_signs = "qx=0.6+qy=0.8+qz=0+qw=1e-17+qx=-0.6+qy=-0.8+qz=0+qw=1e-17"
    kinematics = closed_kinematics(sk.load("agile_eye"))
    assert len(read_distinct_poses(two_signs, kinematics).poses) == 1


def test_warnings_about_an_area_say_no_more_than_is_known():
    """An area without unresolved triangles has no borders that touch.

    In unresolved triangles, a workspace can be hidden. It is then not said to be empty.
    """
    kinematics = closed_kinematics(FIVE_BAR)
    modes = WorkspaceModes(
        FIVE_BAR,
        kinematics,
        Constraints(),
        kinematics.modes[:1],
        DistinctPoses(np.empty((0, 3))),
        1e-15,
    )
    (workspace,) = modes.workspaces
    _, warning = modes.summarize(workspace)
    assert warning.startswith("the area ") and warning.endswith(" sr")
    region = replace(
        workspace.region,
        area=0.0,
        error=1e-3,
        unresolved=1e-3,
        components=(),
        boundaries=(),
        excluding=((0,),),
    )
    _, warning = modes.summarize(replace(workspace, region=region))
    assert "empty" not in warning and "at most 0.001 sr" in warning
    assert "no direction was found that satisfies" in warning


def test_each_mode_has_its_own_page_of_singularities():
    """All modes of the five-bar have one workspace, but different singularities.

    `SceneListener` collects what is drawn. The map of a page shows the angle (rad) to the
    nearest singularity of its mode.
    """
    listener = SceneListener()
    sk.run(FIVE_BAR, ["workspace:tolerance=1e-2"], samples=2, recorder=listener)
    assert "Workspace" in listener.primitives_by_page
    kinematics = closed_kinematics(FIVE_BAR)
    bounds = bounds_of(kinematics, Constraints())
    for label, signs in zip(kinematics.labels, kinematics.modes, strict=True):
        primitives = listener.primitives_by_page[f"Singularity {label}"]
        (sphere_map,) = [item for item in primitives if isinstance(item, SphereMap)]
        judged = judge(kinematics, bounds, signs, sphere_map.vertices)
        sines = np.fmin(judged.type_1, judged.type_2)
        is_known = np.isfinite(sines)
        assert is_known.any()
        assert np.allclose(np.sin(sphere_map.values[is_known]), sines[is_known])
        (text,) = [item.markdown for item in primitives if isinstance(item, Text)]
        assert f"Mode {label}:" in text


def test_every_two_ranges_of_a_pair_have_to_overlap():
    """The range 20 to 30 deg contradicts 0 to 10 deg, with or without a range between."""
    kinematics = closed_kinematics(FIVE_BAR)
    ranges = np.radians([[0.0, 10.0], [0.0, 30.0], [20.0, 30.0]]).tolist()
    limits = tuple(JointLimit("21", low, high) for low, high in ranges)
    bounds_of(kinematics, Constraints(limits=limits[:2]))
    bounds_of(kinematics, Constraints(limits=limits[1:]))
    with pytest.raises(sk.errors.AnalysisError, match="to 10 deg and within 20"):
        bounds_of(kinematics, Constraints(limits=limits))


def test_a_range_of_one_angle_names_the_source_of_both_of_its_limits():
    """The angle between two axes is at least 0 anyway, and here also at most 0."""
    kinematics = closed_kinematics(FIVE_BAR)
    coaxial = InterferenceLimit("21", "43", 0.0, 0.0)
    with pytest.raises(sk.errors.AnalysisError, match=r"0 deg \(like every angle\)"):
        bounds_of(kinematics, Constraints(apart=(coaxial,)))


def pan_and_tilt_with_resting_links(inputs):
    """Return a pan and tilt whose pan axis is also held by a rod and a rocker.

    The pan axis is fixed in the base, so the rod and the rocker never move. The tilt axis
    is at 70 deg from the pan axis, and the output at the angle u with cos u = 0.8 from the
    tilt axis.
    """
    return mechanism_from_sizes(
        {
            "base": ("pan side", [60.0], []),
            "rotor": ("pan held tilt", [0.0, 70.0], [0.0]),
            "head": ("tilt", [], []),
            "rocker": ("side knee", [70.0], []),
            "rod": ("knee held", [50.0], []),
        },
        {
            "pan": "base rotor",
            "side": "base rocker",
            "knee": "rocker rod",
            "held": "rotor rod",
            "tilt": "rotor head",
        },
        inputs,
        Output("camera", "head", "base", (0.6, 0.0, 0.8)),
    )


def test_links_that_never_move_do_not_prevent_a_workspace():
    """A pan and tilt has its usual workspace if other links, which never move, are added.

    The rod and the rocker of `pan_and_tilt_with_resting_links` are these links. The tilt
    axis is at 70 deg from the pan axis, and the output at the angle u from the tilt axis,
    with cos u = 0.8. Both turn fully. So the angle between output and pan axis is from 70
    deg - u to 70 deg + u, and the workspace is a spherical zone.
    """
    tilt_arc = np.radians(70.0)
    output_arc = np.arccos(0.8)
    exact_area_sr = (
        2.0 * np.pi * (np.cos(tilt_arc - output_arc) - np.cos(tilt_arc + output_arc))
    )
    _, findings = run_workspace(
        pan_and_tilt_with_resting_links(["pan", "tilt"]), tolerance=1e-3
    )
    modes = findings["working_modes"]
    # A working mode has two signs: one for the pan and tilt, and one for rod and rocker.
    # Each sign selects one of two ways to assemble these links.
    assert list(modes) == ["++", "+-", "-+", "--"]
    for region in modes.values():
        assert region["area_sr"] == pytest.approx(exact_area_sr, rel=1e-3)


def test_an_input_that_never_moves_is_judged_as_a_singularity_of_type_2():
    """With this input and the pan locked, the head can still turn about the tilt axis."""
    kinematics = closed_kinematics(pan_and_tilt_with_resting_links(["pan", "side"]))
    directions = np.array([[0.0, 0.6, 0.8], [0.0, 0.8, 0.6]])
    judged = judge(kinematics, kinematics.bounds, kinematics.modes[0], directions)
    assert np.all(np.isfinite(judged.inputs))
    assert np.all(judged.type_2 < 1e-12)
