"""The analysis of singularities with several inputs: tables, conditions, what is seen."""

import numpy as np
import pytest
from helpers.scene_listener import SceneListener
from rerun.chunk import RrdReader

import spherekit as sk
from spherekit.display.rerun.recorder import RerunRecorder
from spherekit.scenes.scene import Portrait, SphereCurves, Surface

FEW = "singularities:slices=3,input_grid=5,near=10"


@pytest.fixture(scope="module")
def five_bar(tmp_path_factory):
    path = tmp_path_factory.mktemp("singular") / "five_bar.rrd"
    made = sk.load("five_bar")
    with RerunRecorder("five bar", path=path) as recorder:
        result = sk.run(made, FEW, samples=[7, 7], recorder=recorder)
    return result, path


@pytest.mark.slow
def test_points_of_singular_curves_say_why_they_are_singular(five_bar):
    result, _ = five_bar
    frame = result.frame("singularities")
    columns = "kind condition assembly_mode q_21 q_51 inside"
    assert list(frame)[:6] == columns.split()
    assert set(frame.guarantee) == {"complete to a box size"}
    assert frame.residual.max() < 1e-12
    one, two = (set(frame[frame.kind == kind].condition) for kind in ("I", "II"))
    assert two == {"c_21=0 c_51=0 u of 21, 51 coincide"}
    assert set(frame[frame.signs == "0"].assembly_mode) == {"0+1"}  # where both meet
    assert one <= {"u_21 along the direction", "d_51=0"}


def test_relation_has_every_input_and_agrees_with_itself(five_bar):
    result, _ = five_bar
    frame = result.frame("singularities", "relation")
    assert list(frame)[-3:] == ["moving", "type", "group"]
    good = frame[frame.status == "OK"]
    assert np.nanmax(np.abs(good.c * good.velocity_coefficient - good.d)) < 1e-12
    assert np.all(good.sigma > 0.0) and set(good.moving) == {"21", "51"}
    assert set(good.type) == {"regular"} and np.all(good.group == 0)


def test_aspects_and_findings(five_bar):
    result, _ = five_bar
    frame = result.frame("singularities", "aspects")
    assert list(frame) == ["aspect", "q_21", "q_51", "sign_II", "sign_I", "assembly_modes"]
    (own,) = result.summary["analyses"]
    assert own["findings"]["aspects"] == frame.aspect.value_counts().sort_index().tolist()
    points = result.frame("singularities")
    assert (
        own["findings"]["3/1"]["curves_II"] == points.curve[points.kind == "II"].nunique()
    )
    assert any("type II of output 3/1" in text for text in result.summary["warnings"])


def test_recording_has_the_curves_on_the_sphere_and_in_the_plane_of_inputs(five_bar):
    _, path = five_bar
    entities = {chunk.entity_path for chunk in RrdReader(path).stream()}
    for name in (
        "singular/pointer/II",
        *(f"plots/inputs/pointer/{x}" for x in ("curve_0", "mark")),
    ):
        assert f"/five_bar/assembly_mode_0/{name}" in entities


def test_three_inputs_have_coefficients_and_no_surface_if_it_is_left_out():
    pages = SceneListener()
    result = sk.run(
        "three_rrr", "singularities:input_grid=3,mesh=0", samples=3, recorder=pages
    )
    assert result.frame("singularities").empty
    assert set(result.frame("singularities", "relation").moving) == {"a1", "a2", "a3"}
    parts = [part for own in pages.primitives_by_page.values() for part in own]
    assert not any(isinstance(p, Surface | Portrait | SphereCurves) for p in parts)
