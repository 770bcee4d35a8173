"""The analysis `workspace`: areas against quadrature, samples, bad input."""

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
SCATTER = 0.02
"""What an area counted from these may be off by (sr): some 30 of them."""


found_in = partial(run_single_analysis, "workspace")


FIVE = sk.load("five_bar")


@pytest.fixture(scope="module")
def mid_plane():
    return closed_kinematics(sk.load("two_dof_spm"))


def ten_degrees():
    ten = np.radians(10.0)
    return Constraints(
        apart=(InterferenceLimit("21", "43", ten), InterferenceLimit("61", "54", ten))
    )


def sub_loop():
    """A five-bar of seven links: one crank is driven through a four-bar."""
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


@pytest.mark.parametrize("least", [0, 10])
def test_area_of_the_five_bar(least):
    """Where it points at least an angle from both driven axes."""
    axes, angles = np.eye(3)[[0, 1, 0, 1]], np.radians([150.0, 150.0, least, least])
    exact = common_area(axes, angles, [True, True, False, False])
    apart = f"21/43:{least}+43/51:{least}"
    for tolerance in (1e-2, 1e-4, 1e-6):
        result, findings = found_in(FIVE, apart=apart, tolerance=tolerance)
        assert list(findings["working_modes"]) == ["++", "+-", "-+", "--"]
        for own in findings["working_modes"].values():
            assert abs(own["area_sr"] - exact) <= own["error_sr"] <= tolerance * exact
            assert len(own["components"]) == 1
            assert len(own["holes"]) == (3 if least else 1)
            assert len(own["bounded_by"]) == (4 if least else 2)
    assert abs(own["area_sr"] - exact) < 1e-6 * exact
    areas = result.frame("workspace", "areas")
    whole = areas[areas.part == "whole"]
    assert np.abs(whole["size"] - exact).max() < 1e-6 * exact
    parts = areas[areas["working_mode"] == "++"].query("part != 'whole'")
    assert abs(parts["size"].sum() - 4.0 * np.pi) < 1e-9


def test_samples_and_border_of_the_five_bar():
    """Samples against inverse and forward kinematics, borders against their limits."""
    result, _ = found_in(FIVE, apart="21/43:10", working_mode="+-")
    table = result.frame("workspace")
    place = table[["x", "y", "z"]].to_numpy()
    inverse = InverseKinematics(FIVE).at(place, [(1, -1)])
    axes = closed_kinematics(FIVE)
    rows = axes.at(place, (1, -1))
    angles = np.arccos(rows.cosine(*(FIVE.pair_number[p] for p in ("21", "43"))))
    expected = (inverse.status[0] == Status.OK) & (angles >= np.radians(10.0))
    assert np.array_equal(table["inside"] == "yes", expected)
    q = table[["q_21", "q_51"]].to_numpy()
    assert np.allclose(q, inverse.inputs[0], atol=1e-12, equal_nan=True)
    forward = ForwardKinematics(FIVE).at(q[expected])
    miss = np.linalg.norm(forward.directions - place[expected], axis=2).min(axis=0)
    assert miss.max() < 1e-9
    least = inverse.type_1[0].min(axis=1)
    assert np.allclose(table["type_1"][expected], least[expected], atol=1e-12)
    assert np.allclose(table["type_2"][expected], inverse.type_2[0][expected], atol=1e-12)
    border = result.frame("workspace", "boundary")
    place = border[["x", "y", "z"]].to_numpy()
    margin = judge(axes, bounds_of(axes, Constraints()), (1, -1), place).margin
    reach = border["constraint"].str.contains("at most 150")
    assert reach.any() and not reach.all()
    assert np.abs(margin[reach]).max() < 1e-11
    rows = axes.at(place[~reach], (1, -1))
    angles = np.arccos(rows.cosine(*(FIVE.pair_number[p] for p in ("21", "43"))))
    assert np.abs(angles - np.radians(10.0)).max() < 1e-11


def test_area_of_the_mid_plane_mechanism(mid_plane):
    """The 10 degree rule of Chen et al. leaves two equal parts, and those beyond a fold."""
    exact = mid_plane_area()
    bounds = bounds_of(mid_plane, ten_degrees())
    assert len(bounds) == 5
    for tolerance in (1e-2, 1e-4, 1e-6):
        every = direction_workspaces(mid_plane, bounds, mid_plane.modes, tolerance)
        assert [item.same_as is None for item in every] == [True] + 7 * [False]
        region = every[0].region
        assert region.error <= tolerance * region.area
    for part in region.components[:2]:
        assert abs(part.area - exact) < 1e-6 * exact
        (number,) = part.boundaries
        assert len(region.boundaries[number].corners) == 4


def test_border_in_the_angles_of_the_paper():
    """Table 2: the extremes of phi and gamma under the rule of 10 degrees."""
    mechanism = sk.load("two_dof_spm")
    asked = "workspace:apart=21/43:10+61/54:10,working_mode=-++,tolerance=1e-2"
    result = sk.run(mechanism, asked)
    border = result.frame("workspace", "boundary", degrees=True)
    paper = border[border["phi"] > 0.0]
    outer = paper[paper["component"] == paper.iloc[paper["phi"].argmax()]["component"]]
    found = [*outer["phi"].agg(["min", "max"]), *outer["gamma"].agg(["min", "max"])]
    assert found == pytest.approx([11.5519, 95.8430, -67.5085, 67.5085], abs=1e-4)
    assert {"phi", "gamma"} <= set(result.frame("workspace", "workspace").columns)


def test_width_of_links_is_an_angle_between_axes(mid_plane):
    """Links of a width on a radius, as section 3 of Chen et al. has it."""
    wide = Constraints(width=np.radians(10.0) * 0.3, radius=0.3)
    same = [bounds_of(mid_plane, wanted) for wanted in (ten_degrees(), wide)]
    margins = [make_margins(mid_plane, bounds, (1, 1, 1))(DIRECTIONS) for bounds in same]
    assert np.allclose(*margins, atol=1e-15, equal_nan=True)


@pytest.fixture(scope="module")
def loop_case():
    mechanism = sub_loop()
    kinematics = closed_kinematics(mechanism)
    wanted = Constraints(
        limits=(JointLimit("f2", -2.0, 1.0),),
        apart=(InterferenceLimit("b1", "b2", 0.3), InterferenceLimit("e2", "c", 0.0, 1.9)),
        near=np.radians(6.0),
    )
    return mechanism, kinematics, bounds_of(kinematics, wanted)


@pytest.mark.many
@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, -1)])
def test_mechanism_with_a_loop_within(loop_case, signs):
    """Brute force by the position analysis of the graph, in matrices."""
    mechanism, kinematics, bounds = loop_case
    inverse = InverseKinematics(mechanism)
    found = inverse.solver.evaluate(AssemblyMode(0, signs), azimuth_tilt(DIRECTIONS))
    number = mechanism.pair_number
    f2 = found.values[:, number["f2"]]
    middle = np.angle(np.exp(1j * (f2 + 0.5)))

    def axis(pair):
        joint = inverse.solver.joints[number[pair]]
        link = mechanism.ends[number[pair]][0]
        return found.rotations[:, link] @ joint.first[:, 2]

    measures = inverse.at(DIRECTIONS, [signs])
    inside = (found.status == Status.OK) & (np.abs(middle) <= 1.5)
    inside &= arc(axis("b1"), axis("b2")) >= 0.3
    inside &= arc(axis("e2"), axis("c")) <= 1.9
    least = np.minimum(measures.type_1[0].min(axis=1), measures.type_2[0])
    inside &= least >= np.sin(np.radians(6.0))
    judged = judge(kinematics, bounds, signs, DIRECTIONS)
    assert 1000 < inside.sum() < 15_000
    assert np.array_equal(judged.inside, inside)
    simple = [bound for bound in bounds if "axes" in bound.name]
    (item,) = direction_workspaces(kinematics, simple, [signs], 1e-2)
    counted = judge(kinematics, simple, signs, DIRECTIONS).inside.mean() * 4.0 * np.pi
    assert abs(item.region.area - counted) < item.region.error + SCATTER
    assert item.region.error < 1e-2 * item.region.area


def test_a_distance_to_singularities_is_known_where_an_input_cannot_move():
    kinematics = closed_kinematics(sk.load("agile_eye"))
    bounds = bounds_of(kinematics, Constraints(near=0.1))
    (found,) = orientation_workspaces(kinematics, bounds, kinematics.modes[:1], 0.1)
    assert 71.0 < found.orientations.volume < 72.5


@pytest.mark.slow
def test_a_pose_outside_gets_the_nearest_reachable():
    cloud, kinematics = DIRECTIONS, closed_kinematics(FIVE)
    bounds = bounds_of(kinematics, Constraints(limits=(JointLimit("21", 0.7, 2.4),)))
    (item,) = direction_workspaces(kinematics, bounds, [(1, 1)], 1e-3)
    inside = judge(kinematics, bounds, (1, 1), cloud).inside
    counted = 4.0 * np.pi * inside.mean()
    assert abs(item.region.area - counted) < item.region.error + SCATTER
    for place in cloud[~inside][::1500]:
        there, angle = nearest_reachable(kinematics, bounds, item, place)
        here = judge(kinematics, bounds, (1, 1), there[None])
        assert here.inside[0] and np.isfinite(here.inputs).all()
        assert angle <= arc(cloud[inside], place).min() + 1e-8
        assert abs(angle - arc(place, there)) < 1e-12
    there, angle = nearest_reachable(kinematics, bounds, item, cloud[inside][7])
    assert angle < 1e-7


def test_stops_of_the_mechanism_are_limits():
    stopped = replace(FIVE, joint_limits=(JointLimit("51", 0.4, 2.0),))
    kinematics = closed_kinematics(stopped)
    (*_, bound) = bounds_of(kinematics, Constraints())
    rows = kinematics.at(DIRECTIONS, (1, -1))
    q = rows.inputs[:, 1]
    known = np.isfinite(q)
    assert np.array_equal(bound.left(rows)[known] >= 0.0, (np.abs(q - 1.2) <= 0.8)[known])
    with pytest.raises(sk.errors.AnalysisError, match="contradict each other"):
        bounds_of(kinematics, Constraints(limits=(JointLimit("51", 2.5, 3.0),)))


def test_a_pose_is_judged_in_each_mode():
    _, findings = found_in(FIVE, pose="x=1+y=1+z=0.2")
    assert [row["inside"] for row in findings["pose"]] == ["yes"] * 4
    result, findings = found_in(FIVE, pose="x=0+y=0+z=-1", working_mode="++")
    (row,) = findings["pose"]
    assert row["inside"] == "no"
    axes = closed_kinematics(FIVE)
    there = np.array(row["nearest"])
    assert abs(row["away_rad"] - arc(np.array([0.0, 0.0, -1.0]), there)) < 1e-12
    assert judge(axes, bounds_of(axes, Constraints()), (1, 1), there[None]).inside[0]
    assert any("is outside in mode ++" in text for text in result.summary["warnings"])
    _, findings = found_in(FIVE, pose="21=40+51=45", working_mode="0")
    assert len(findings["pose"]) == 2
    for row in findings["pose"]:
        if np.allclose(np.degrees(row["inputs"]), [40.0, 45.0], atol=1e-9):
            assert row["inside"] == "yes"


def test_an_empty_workspace_names_what_excludes_each_other():
    result, findings = found_in(FIVE, apart="21/43:0:30+43/51:0:30", working_mode="++")
    own = findings["working_modes"]["++"]
    (pair,) = own["excluding"]
    assert own["area_sr"] == 0.0 and "21/43 at most 30 deg" in pair
    assert "43/51 at most 30 deg" in pair
    assert any("the workspace is empty" in text for text in result.summary["warnings"])


@pytest.mark.slow
def test_orientations_of_unlike_legs():
    """Volume against the share of orientations for which the graph closes."""
    mechanism = platform_with_unlike_legs()
    kinematics, solver = closed_kinematics(mechanism), InverseKinematics(mechanism).solver
    bounds, signs = bounds_of(kinematics, Constraints()), kinematics.modes[0]
    samples = orientation_samples(20_000)
    rotations = from_quaternion(samples)
    found = solver.evaluate(AssemblyMode(0, signs), euler_zyz(rotations))
    judged = judge(kinematics, bounds, signs, samples)
    assert np.array_equal(judged.inside, found.status == Status.OK)
    item, other = orientation_workspaces(kinematics, bounds, kinematics.modes[:2], 0.05)
    assert other.same_as in (None, signs)
    volume = item.orientations
    share = judged.inside.mean()
    spread_of_share = 4.0 * np.sqrt(share * (1.0 - share) / len(samples))
    assert abs(volume.fraction - share) < spread_of_share + volume.error / (8 * np.pi**2)
    outside = samples[~judged.inside][3]
    there, angle = nearest_reachable(kinematics, bounds, item, outside)
    assert judge(kinematics, bounds, signs, there[None]).inside[0]
    between = transpose(from_quaternion(outside[None])) @ from_quaternion(there[None])
    turned = np.arccos(0.5 * (np.trace(between[0]) - 1.0))
    assert abs(turned - angle) < 1e-6


def test_orientations_are_tabled():
    result, findings = found_in(
        sk.load("agile_eye"), tolerance=0.2, working_mode="0", pose="qx=0+qy=0+qz=0+qw=1"
    )
    (own,) = findings["working_modes"].values()
    assert 0.0 < own["volume"] <= 8.0 * np.pi**2 + own["error"]
    table = result.frame("workspace")
    assert len(table) == 4000
    assert np.allclose(np.linalg.norm(table[["x", "y", "z", "w"]], axis=1), 1.0)
    assert len(findings["pose"]) == 1
    assert "mode +++: the whole volume, all orientations" in result.summary["remarks"][0]


def test_pages_show_map_border_and_areas():
    watcher = SceneListener()
    request = "workspace:near=15,working_mode=++"
    sk.run(FIVE, [request], samples=2, recorder=watcher)
    assert {"Workspace", "Singularity"} <= set(watcher.primitives_by_page)
    for title in ("Workspace", "Singularity"):
        parts = watcher.primitives_by_page[title]
        (shown,) = [part for part in parts if isinstance(part, SphereMap)]
        assert shown.triangles.max() < len(shown.vertices) == len(shown.values)
        used = shown.values[np.unique(shown.triangles)]
        assert used.min() >= 0.0 and used.max() <= np.pi / 2
        *borders, deepest = [part for part in parts if isinstance(part, SphereCurves)]
        assert len(borders) == len({part.tone for part in borders}) == 3
        assert deepest.label == deepest.marks[0].label  # named once in legends of figures
        (words,) = [part.markdown for part in parts if isinstance(part, Text)]
        assert "bounded by" in words and "type II at least 15 deg away" in words
    singular = next(
        p for p in watcher.primitives_by_page["Singularity"] if isinstance(p, SphereMap)
    )
    assert singular.values[np.unique(singular.triangles)].min() > np.radians(14.999)


def test_on_a_limit_nothing_is_missing():
    """Where the arc cosine rounds to beyond the limit, its cosine says that it is on it."""
    rounded = []
    for limit in np.random.default_rng(1).uniform(0.1, 3.0, 50):
        bound = AngleLimit("a", limit, True, lambda _, x=limit: np.array([np.cos(x)]))
        left, _ = find_least_margin([bound], None)
        assert 0.0 <= left[0] < 1e-15
        rounded.append(float(np.arccos(np.cos(limit))) < limit)
    assert any(rounded)
