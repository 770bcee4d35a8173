"""The analysis `equivalent_rotation` with few, unsorted, rounded or missing angles."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.scene_listener import SceneListener

import spherekit as sk
from spherekit.outputs.output_pose import PoseFinder

NAME = "equivalent_rotation"
TABLE_3 = f"{NAME}:start=phi=75+gamma=-20,end=phi=70+gamma=20"
"""A rotation of `two_dof_spm` by 40.3230614 deg, from Chen et al. 2021, Table 3."""
DEVIATING = f"{NAME}:start=21=70+51=72,end=21=77.5+51=77.5"
"""A rotation of `five_bar` whose axis is not fixed between its ends."""


def findings(result):
    """Return the findings of the only analysis of a run that did not fail."""
    assert not result.failures, result.failures
    (entry,) = result.summary["analyses"]
    return entry["findings"]


@pytest.mark.parametrize("rows", ["samples=2", "theta=0"])
def test_a_deviation_between_the_rows_makes_a_rotation_infeasible(rows):
    result = sk.run("five_bar", f"{DEVIATING},{rows}")
    assert not findings(result)["feasible"]
    assert findings(result)["largest_orientation_error_rad"] > 1e-3
    assert "deviates by up to" in "; ".join(result.summary["warnings"])


@pytest.mark.slow
def test_ranges_of_inputs_do_not_depend_on_the_rows():
    ranges = []
    for rows in ("samples=91", "theta=13"):
        remarks = sk.run("two_dof_spm", f"{TABLE_3},{rows}").summary["remarks"]
        ranges += [text for text in remarks if "pass through these ranges" in text]
    assert ranges[0] == ranges[1]
    assert "21 from 5.3391 to 49.2443 deg" in ranges[0]


def test_the_angle_of_the_message_is_accepted():
    refused = sk.run("two_dof_spm", f"{TABLE_3},theta=40.3230617")
    (message,) = refused.failures.values()
    assert "theta: 40.3230617 deg is beyond" in message
    stated = message.split("angle is ")[1].split(" deg")[0]
    result = sk.run("two_dof_spm", f"{TABLE_3},theta={stated}")
    theta = result.frame(NAME)["theta"].to_numpy()
    assert theta == pytest.approx(findings(result)["angle_rad"], abs=1e-9)


@pytest.mark.slow
def test_mid_planes_of_start_and_end_do_not_depend_on_the_order_of_angles():
    circles = []
    for angles in ("0+13+40", "40+0+13"):
        listener = SceneListener()
        sk.run("two_dof_spm", f"{TABLE_3},theta={angles}", recorder=listener)
        scene, _ = listener.last_scene("Equivalent rotation")
        by_path = {primitive.path: primitive for primitive in scene.primitives}
        circles.append([by_path[f"mid_plane/{end}"].curves[0] for end in ("start", "end")])
    assert np.array(circles[0]) == pytest.approx(np.array(circles[1]), abs=1e-12)


@pytest.mark.slow
def test_rows_beyond_a_singular_end_count_as_failed(monkeypatch):
    follow = PoseFinder.rotation

    def end_at_singularity(*arguments):
        return replace(follow(*arguments), end=sk.Status.AT_SINGULARITY)

    monkeypatch.setattr(PoseFinder, "rotation", end_at_singularity)
    pose = "start=phi=75+gamma=-20,end=ux=1+uy=0+uz=0+angle=60,samples=7"
    result = sk.run("two_dof_spm", f"{NAME}:{pose}")
    is_missing = np.isnan(result.frame(NAME)["q_21"].to_numpy())
    assert findings(result)["failed_rows"] == np.sum(is_missing) == 1


def test_a_mode_that_is_no_number_is_refused_with_the_list_of_modes():
    result = sk.run("two_dof_spm", f"{TABLE_3},mode=²")
    (message,) = result.failures.values()
    assert 'no configuration "²"; its configurations are' in message
