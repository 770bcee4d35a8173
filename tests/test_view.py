"""Recordings: the content of the file, and faults while it is written.

The four-bar of Di Gregorio 2024 is recorded with primitives that a run collected. Expected
numbers come from closed forms. `p` of the closed forms and the number of the assembly mode
are exchanged: mode 1 - p of the program is mode p here.
"""

import os
import resource
import socket
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from helpers.recording_columns import read_recording_columns
from oracles.closed_forms import (
    FOUR_BAR_ARCS,
    four_bar_angles,
    four_bar_coefficients,
    four_bar_frames,
    four_bar_poles,
)
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.display.figures.collector import Collector
from spherekit.display.rerun.labels import Names, facing, project
from spherekit.display.rerun.recorder import RerunRecorder
from spherekit.display.rerun.screenshot import screenshot
from spherekit.display.rerun.shapes import path_on_sphere, vertex_normals
from spherekit.display.rerun.timelines import input_ticks, input_timeline, ticks_per_degree
from spherekit.display.rerun.viewer_program import free_ports, recording_at
from spherekit.errors import OutputError
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.scenes.link_scenes import link_bodies, link_curves
from spherekit.scenes.recording_head import RecordingHead
from spherekit.scenes.scene import Arrow, Scene, sample_rows
from spherekit.storage.file_lock import try_lock

SAMPLES = np.arange(361)
INPUTS = np.radians(SAMPLES)
FOUR_BAR = sk.load("four_bar")
SERIES = "plots/velocity/4_1"
"""Path of the plot of the velocity coefficient of link 4 relative to link 1."""
PLOTTED = ("plots/velocity/3_1", SERIES, "plots/acceleration/4_1")
NO_CRANK = (np.pi / 3, np.radians(50), np.radians(38), np.radians(50))
"""Arcs (rad) of a four-bar whose input link cannot turn fully: no link is a crank."""


@cache
def collect_scenes(arcs):
    """Run a four-bar with these arcs (4,) in rad; return what the run sends to a recorder.

    A scene is a drawing of primitives such as lines and arrows.

    Returns
    -------
    first_scene
        The primitives at rest.
    primitives_by_mode
        Moving primitives of each assembly mode. The modes are numbered as in the formulas
        for four-bars with which the tests compare them. Of the plots only those in
        `PLOTTED` are included.
    """
    sized_links = {}
    for (name, size), arc in zip(FOUR_BAR.geometry.links.items(), arcs, strict=True):
        sized_links[name] = replace(size, arcs=(arc,))
    geometry = replace(FOUR_BAR.geometry, links=sized_links)
    collector = Collector()
    mechanism = replace(FOUR_BAR, geometry=geometry)
    sk.run(mechanism, "poles", samples=len(SAMPLES), recorder=collector)

    primitives_by_mode = {0: (), 1: ()}
    for mode in (0, 1):
        for scene in collector.scenes():
            # Each scene of an assembly mode has the number of the mode as its page. The run
            # numbers the two modes in the opposite order of the formulas.
            if scene.page == 1 - mode:
                primitives_by_mode[mode] += tuple(
                    item
                    for item in scene.primitives
                    if item.path in PLOTTED or not item.path.startswith("plots/")
                )
    return collector.scenes()[0], primitives_by_mode


def scene_at_rest(arcs):
    """Return the scene of what does not move: the frame and the plan."""
    return collect_scenes(arcs)[0]


def moving_scene(mode, samples, arcs=FOUR_BAR_ARCS):
    """Return the moving four-bar of an assembly mode at some samples."""
    return select_rows(Scene(mode, collect_scenes(arcs)[1][mode]), samples)


def select_rows(scene, rows):
    """Return a scene whose primitives have only some of the rows."""
    primitives = []
    for item in scene.primitives:
        values = {name: values[rows] for name, values in sample_rows(item).items()}
        primitives.append(replace(item, **values))
    return Scene(scene.page, tuple(primitives))


def record_both_modes(path, blocks=1, arcs=FOUR_BAR_ARCS, **destinations):
    """Record both assembly modes of a four-bar, in blocks of samples; return the path.

    Parameters
    ----------
    path
        Path of the recording, a file of the viewer Rerun.
    blocks
        Number of blocks of equal size, or a list of the samples with which the second and
        all later blocks begin.
    arcs
        Arcs (4,) of the four-bar in rad.
    destinations
        Further arguments of `RerunRecorder`, such as the `url` of a viewer.
    """
    with RerunRecorder("four bar", path=path, **destinations) as recorder:
        titles = {0: "Mode 0", 1: "Mode 1"}
        recorder.start(RecordingHead([scene_at_rest(arcs)], INPUTS, titles))
        for mode in (0, 1):
            scene = moving_scene(mode, SAMPLES, arcs)
            for samples in np.array_split(SAMPLES, blocks):
                recorder.log(select_rows(scene, samples), samples, INPUTS[samples])
    return path


def find_differences(first_path, second_path):
    """Return the columns in which two recordings differ; NaN equals NaN."""
    first = read_recording_columns(first_path)
    second = read_recording_columns(second_path)
    keys = first.keys() | second.keys()
    return sorted(k for k in keys if repr(first.get(k)) != repr(second.get(k)))


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Return a recording of the four-bar of the paper, written in one block."""
    return record_both_modes(tmp_path_factory.mktemp("view") / "four_bar.rrd")


@pytest.fixture(scope="module")
def partial_recording(tmp_path_factory):
    """Return a recording in four blocks of a four-bar that closes on part of the turn."""
    path = tmp_path_factory.mktemp("view") / "no_crank.rrd"
    return record_both_modes(path, 4, NO_CRANK)


@pytest.mark.parametrize("mode", [0, 1])
def test_a_recorded_series_has_every_digit_of_its_plot(recording, mode):
    """Velocity coefficients are eq. (26b) of Di Gregorio, and not rounded to float32."""
    columns = read_recording_columns(recording)
    entity = f"/four_bar/assembly_mode_{mode}/{SERIES}"
    recorded = np.concatenate(columns[entity, "Scalars:scalars"])
    _, coefficient_41 = four_bar_coefficients(INPUTS, FOUR_BAR_ARCS, mode)
    np.testing.assert_allclose(recorded, coefficient_41, atol=1e-12)
    primitives = collect_scenes(FOUR_BAR_ARCS)[1][mode]
    (plot,) = [item for item in primitives if item.path == SERIES]
    np.testing.assert_array_equal(recorded, plot.values)
    # The input turns one degree per sample.
    for timeline in ("sample", "input_deg"):
        assert columns[entity, timeline] == SAMPLES.tolist()


def test_recorded_poles_and_links_agree_with_closed_forms(recording):
    """A recording draws a pole and a link where closed forms say that they are.

    A recording is a file of the viewer Rerun, with the drawn shapes at all samples of a
    motion. `recording` is that of the four-bar of Di Gregorio (2024), and the closed forms
    are those of the same paper. The pole 31 is the axis of the relative rotation of links 3
    and 1. It is drawn as an arrow with the length of 1.25 radii of the sphere. Link 3 is
    drawn with a rotation, which is compared with the closed form of its frame. The file has
    float32 numbers, hence the tolerance of 1e-6.
    """
    columns = read_recording_columns(recording)
    arrows = columns["/four_bar/assembly_mode_1/pole/3_1", "Arrows3D:vectors"]
    u_31 = four_bar_poles(INPUTS, FOUR_BAR_ARCS, 1)["31"]
    np.testing.assert_allclose(np.array(arrows)[:, 0], 1.25 * u_31, atol=1e-6)

    link = "/four_bar/assembly_mode_1/link/3"
    quaternions = np.array(columns[link, "Transform3D:quaternion"])[:, 0]
    rotations = Rotation.from_quat(quaternions).as_matrix()
    frames = four_bar_frames(INPUTS, FOUR_BAR_ARCS, 1)
    np.testing.assert_allclose(rotations, frames[3], atol=1e-6)
    np.testing.assert_allclose(np.array(columns[link, "Transform3D:scale"]), 1.0)


def test_shapes_at_rest_are_logged_once(partial_recording):
    """The shapes of links and the paths of poles are in a recording only once.

    `partial_recording` was written in several blocks of samples. A recording consists of
    chunks: columns of an entity such as "LineStrips3D:strips", with a column of row
    identifiers. A chunk that is static does not change in time.
    """
    logged = []
    for chunk in RrdReader(partial_recording).stream():
        if chunk.is_static and chunk.entity_path.startswith("/four_bar"):
            for name in chunk.to_record_batch().schema.names:
                if ":" in name and "RowId" not in name:
                    logged.append((chunk.entity_path, name))
    assert len(logged) == len(set(logged))
    curves = {entity for entity, name in logged if name == "LineStrips3D:strips"}
    expected = {"/four_bar/link/1"}
    for mode in (0, 1):
        expected.add(f"/four_bar/assembly_mode_{mode}/pole/3_1/path")
        for link in (2, 3, 4):
            expected.add(f"/four_bar/assembly_mode_{mode}/link/{link}")
    assert expected <= curves


@pytest.mark.many
@pytest.mark.parametrize("blocks", [5, [*range(1, 40), 200, *range(350, 361)]])
def test_block_size_does_not_change_a_recording(recording, tmp_path, blocks):
    """Five equal blocks, and blocks of one sample before and after long ones."""
    path = record_both_modes(tmp_path / "b.rrd", blocks)
    assert find_differences(path, recording) == []


def record_assembly_modes(path, count):
    """Record five samples of this many assembly modes."""
    samples = SAMPLES[:5]
    with RerunRecorder("x", path=path) as recorder:
        titles = {mode: f"Mode {mode}" for mode in range(count)}
        recorder.start(RecordingHead([], INPUTS, titles))
        for mode in range(count):
            scene = Scene(mode, moving_scene(0, samples).primitives)
            recorder.log(scene, samples, INPUTS[samples])
    return path


@pytest.mark.slow
def test_file_size_grows_linearly_with_the_number_of_modes(tmp_path):
    """15 more modes take at most 1.6 times what 3 more modes predict linearly."""
    sizes = []
    for count in (1, 4, 16):
        path = record_assembly_modes(tmp_path / f"{count}.rrd", count)
        sizes.append(path.stat().st_size)
    size_per_mode = (sizes[1] - sizes[0]) / 3
    assert sizes[2] - sizes[0] < 1.6 * 15 * size_per_mode


@pytest.mark.slow
def test_curves_of_a_chart_have_the_colours_of_its_legend(tmp_path):
    """The curves of a recorded chart have the colours of its legend, in the same order.

    Each of two assembly modes has a chart of two velocity coefficients. Both modes are also
    compared in a chart of acceleration coefficients (1/rad), with one curve for each mode.
    The name of the recording is "x", so the paths of its objects begin with "/x".
    """
    colours = {}
    entities = set()
    for chunk in RrdReader(record_assembly_modes(tmp_path / "few.rrd", 2)).stream():
        # Charts are static: they do not change with the sample that the viewer shows.
        if not (chunk.is_static and chunk.entity_path.startswith("/x")):
            continue
        entities.add(chunk.entity_path)
        batch = chunk.to_record_batch()
        for name in ("Points2D:colors", "LineStrips2D:colors"):
            if "/charts/" in chunk.entity_path and name in batch.schema.names:
                # The column has one row: the list of the colours of all points or lines.
                (colours[chunk.entity_path],) = batch.column(name).to_pylist()
    for mode in (0, 1):
        chart = f"/x/assembly_mode_{mode}/charts/velocity_coefficients"
        legend_colours = colours[f"{chart}/legend"]
        # Each curve is one line, with one colour.
        curve_colours = [colours[f"{chart}/curves/{k}"][0] for k in (0, 1)]
        assert len(set(legend_colours)) == 2
        assert legend_colours == curve_colours
    # Curve 1 of the comparison is that of mode 1.
    assert "/x/compare/acceleration_coefficients_1_rad/curves/1" in entities


@pytest.mark.slow
def test_many_modes_are_compared_in_one_chart_only(tmp_path):
    """With 31 modes, velocity coefficients (two curves per mode) are left out."""
    chunks = RrdReader(record_assembly_modes(tmp_path / "many.rrd", 31)).stream()
    paths = {chunk.entity_path for chunk in chunks}
    charts = {path.split("/")[3] for path in paths if path.startswith("/x/compare/")}
    assert charts == {"acceleration_coefficients_1_rad"}


def test_failed_samples_show_only_their_status(partial_recording):
    """Arrows, labels and links are hidden at samples where the four-bar does not close.

    `partial_recording` is a four-bar with the arcs `NO_CRANK`, whose input link cannot turn
    fully. The closed form says where it does not close. Links, and the great circles by
    which poles are constructed, are hidden by a scale below 1e-3. A text with the status
    takes their place.
    """
    columns = read_recording_columns(partial_recording)
    is_failed = np.isnan(four_bar_angles(INPUTS, NO_CRANK, 0))
    assert 0 < is_failed.sum() < len(is_failed)
    mode = "/four_bar/assembly_mode_0"

    arrows = columns[f"{mode}/pole/3_1", "Arrows3D:vectors"]
    arrow_counts = [len(row or []) for row in arrows]
    assert arrow_counts == (~is_failed).astype(int).tolist()

    labels = columns[f"{mode}/link/3/labels", "Points3D:show_labels"]
    assert [row[0] for row in labels] == (~is_failed).tolist()

    for entity in (f"{mode}/link/3", f"{mode}/construction/circle_0"):
        quaternions = np.array(columns[entity, "Transform3D:quaternion"])
        assert np.isfinite(quaternions).all()
        scale = np.array(columns[entity, "Transform3D:scale"])[:, 0, 0]
        assert np.array_equal(scale < 1e-3, is_failed)

    status_texts = columns[f"{mode}/status", "Points3D:positions"]
    assert [len(row or []) for row in status_texts] == is_failed.astype(int).tolist()

    values = np.concatenate(columns[f"{mode}/{SERIES}", "Scalars:scalars"])
    assert np.array_equal(np.isnan(values), is_failed)


def test_arrows_that_cover_each_other_share_a_label(tmp_path):
    """In a recording, two arrows half a degree apart get one label with both names.

    P14, P25 and P36 are arrows of poles. At sample 0 they are apart, at sample 1 P14 and
    P25 are together, and at sample 2 P25 is missing. The arrow "pair" always coincides with
    P14. It is marked as the axis of a pair. Its name must not appear in the label of P14.
    """
    x, y, z = np.eye(3)
    beside_x = Rotation.from_rotvec([0.0, 0.0, np.radians(0.5)]).apply(x)
    missing = np.full(3, np.nan)
    directions = {
        "14": np.array([x, x, x]),
        "25": np.array([y, beside_x, missing]),
        "36": np.array([z, z, z]),
        "pair": np.array([x, x, x]),
    }
    arrows = tuple(
        Arrow(f"pole/{name}", f"P{name}", u, name == "pair")
        for name, u in directions.items()
    )
    path = tmp_path / "x.rrd"
    with RerunRecorder("four_bar", path=path) as recorder:
        recorder.start(RecordingHead())
        recorder.log(Scene(0, arrows), np.arange(3))
    columns = read_recording_columns(path)

    def read_labels(name):
        """Return the labels of an arrow at each sample, an empty list if it has none."""
        entity = f"/four_bar/assembly_mode_0/pole/{name}/label"
        positions = columns[entity, "Points3D:positions"]
        labels = [list(row or []) for row in columns[entity, "Points3D:labels"]]
        assert [len(row or []) for row in positions] == [len(row) for row in labels]
        return labels

    assert read_labels("14") == [["P14"], ["P14, P25"], ["P14"]]
    assert read_labels("25") == [["P25"], [], []]
    assert read_labels("36") == [["P36"], ["P36"], ["P36"]]


def test_input_timeline_uses_the_coarsest_exact_unit():
    """The timeline of a recording counts the input in the coarsest unit that is exact.

    Timelines count integers: degrees, or tenths to thousandths of a degree. Where
    thousandths do not suffice, as for 1/3 degree, the timeline is inexact.
    """
    for degrees, name, is_exact in [
        ([0.0, 90.0, 360.0], "input_deg", True),
        ([0.0, 0.5], "input_deg_x10", True),
        ([0.25], "input_deg_x100", True),
        ([-0.125, 7.0], "input_deg_x1000", True),
        ([1.0 / 3.0], "input_deg_x1000", False),
    ]:
        timeline = input_timeline(np.radians(degrees))
        scale = timeline.ticks_per_degree
        assert timeline.name == name
        assert timeline.is_exact == is_exact
        expected_ticks = np.rint(np.array(degrees) * scale)
        assert np.array_equal(input_ticks(np.radians(degrees), scale), expected_ticks)
        assert ticks_per_degree(name) == scale
    assert ticks_per_degree("sample") is None


def test_a_path_on_the_sphere_is_divided_at_gaps_and_jumps():
    """A path on the sphere is drawn in pieces, divided at gaps and jumps.

    Ten points are 10 degrees apart, with a gap at point 4 and a jump at point 7. The three
    pieces must be refined to chords below 3.1 degrees and stay on the unit sphere.
    """
    angle = np.radians(np.arange(0.0, 100.0, 10.0))
    points = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    points[4] = np.nan
    points[7:] *= -1.0
    lines = path_on_sphere(points)
    assert len(lines) == 3
    for line in lines:
        np.testing.assert_allclose(np.linalg.norm(line, axis=1), 1.0)
        chords = np.linalg.norm(np.diff(line, axis=0), axis=1)
        assert chords.max() < np.radians(3.1)


@pytest.mark.parametrize("step", [1.0, 2.5, 44.0, 89.9])
def test_steps_of_a_path_on_the_sphere_are_at_most_three_degrees(step):
    """Long steps are divided into equal arcs, and short steps are left as they are."""
    angle = np.radians(np.arange(0.0, 180.0, step))
    points = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    (line,) = path_on_sphere(points)
    arcs = np.degrees(np.arccos(np.vecdot(line[1:], line[:-1])))
    np.testing.assert_allclose(arcs, step / np.ceil(step / 3.0))


@pytest.mark.parametrize("corner", [0, 1, 2])
def test_normals_of_triangles_with_opposite_orders_of_corners_do_not_cancel(corner):
    """Two triangles in the plane x = 0 share a corner, at the same place in both."""
    vertices = np.array([[0, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]], dtype=float)
    triangles = np.roll([[0, 1, 2], [0, 3, 2]], corner, axis=1)
    normals = vertex_normals(vertices, triangles)
    np.testing.assert_allclose(np.abs(normals), np.tile([1.0, 0.0, 0.0], (4, 1)))


def test_a_path_of_one_point_or_of_none_has_no_lines():
    assert path_on_sphere(np.tile([0.0, 0.0, 1.0], (5, 1))) == []
    assert path_on_sphere(np.full((3, 3), np.nan)) == []


def test_a_path_over_a_grid_is_divided_at_the_ends_of_its_rows():
    """Two rows of four points, the rows being equal: a closed line, or two lines."""
    angle = np.radians([0.0, 10.0, 20.0, 30.0])
    row = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    grid = np.roll(np.tile(row, (2, 1)), 2, axis=0)
    assert len(path_on_sphere(grid, None)) == 1
    assert len(path_on_sphere(grid, 4)) == 2


def test_a_path_that_cannot_be_written_is_refused(tmp_path):
    folder = tmp_path / "folder.rrd"
    folder.mkdir()
    for path, message in [
        (folder, "is a folder"),
        (tmp_path / "none" / "a.rrd", "does not exist"),
        (tmp_path / "a.txt", r"named \*.rrd"),
        ("", r"named \*.rrd"),
        ("/", r"named \*.rrd"),
        # This name fits, but not with the ending of the incomplete file.
        (tmp_path / f"{'a' * 250}.rrd", "too long; choose a shorter one"),
    ]:
        with pytest.raises(OutputError, match=message), RerunRecorder("x", path=path):
            pass
    assert list(tmp_path.iterdir()) == [folder]


@pytest.mark.parametrize("method", ["replace", "unlink"])
def test_a_recording_is_locked_until_its_file_is_renamed_or_deleted(
    method, tmp_path, monkeypatch
):
    """A recording without rows is deleted after an error, otherwise it is renamed."""
    path = tmp_path / "a.rrd"
    original = getattr(Path, method)
    refusals = []

    def record_meanwhile(part, *args, **options):
        """Try to begin another recording, then rename or delete the file."""
        if part == path.with_name("a.rrd.part"):
            with part.open("ab") as other_run:
                refusals.append(not try_lock(other_run.fileno()))
        return original(part, *args, **options)

    monkeypatch.setattr(Path, method, record_meanwhile)
    with suppress(KeyboardInterrupt), RerunRecorder("x", path=path):
        if method == "unlink":
            raise KeyboardInterrupt
    assert refusals == [True]


def test_an_error_does_not_name_a_file_that_was_deleted_during_the_recording(tmp_path):
    path = tmp_path / "a.rrd"
    with (
        pytest.raises(OutputError, match="was deleted or renamed during") as refusal,
        RerunRecorder("x", path=path),
    ):
        (tmp_path / "a.rrd.part").unlink()
    assert "the whole recording is in" not in str(refusal.value)


@pytest.mark.parametrize("room_in_bytes", [0, 400_000])
def test_a_full_disk_keeps_the_old_file(room_in_bytes, tmp_path):
    """The limit on file sizes stands for a disk that is full at once, or after a while."""
    path = tmp_path / "a.rrd"
    path.write_text("the recording of yesterday")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room_in_bytes, hard))
    try:
        with pytest.raises(OutputError, match="free some space"):
            record_both_modes(path, 8)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_text() == "the recording of yesterday"
    assert list(tmp_path.iterdir()) == [path]


def test_an_interrupted_run_keeps_what_it_recorded(tmp_path):
    """If a recording is interrupted, what was recorded so far remains in a file.

    The file is called `*.part`, and a note of the interrupt names it. It has the fifty
    samples that were recorded.
    """
    path = tmp_path / "a.rrd"
    with (
        pytest.raises(KeyboardInterrupt) as interrupt,
        RerunRecorder("four bar", path=path) as recorder,
    ):
        recorder.start(RecordingHead([scene_at_rest(FOUR_BAR_ARCS)], INPUTS))
        recorder.log(moving_scene(0, SAMPLES[:50]), SAMPLES[:50], INPUTS[:50])
        raise KeyboardInterrupt
    partial_file = tmp_path / "a.rrd.part"
    assert list(tmp_path.iterdir()) == [partial_file]
    assert str(partial_file) in interrupt.value.__notes__[0]
    columns = read_recording_columns(partial_file)
    assert len(columns["/four_bar/assembly_mode_0/link/2", "sample"]) == 50


def test_a_primitive_with_a_wrong_number_of_rows_is_refused(tmp_path):
    with (
        pytest.raises(ValueError, match="link/2: found 50 rows, expected 49"),
        RerunRecorder("four bar", path=tmp_path / "a.rrd") as recorder,
    ):
        recorder.start(RecordingHead([], INPUTS))
        recorder.log(moving_scene(0, SAMPLES[:50]), SAMPLES[:49], INPUTS[:49])


@pytest.mark.parametrize(
    "url", ["127.0.0.1", "http://x:1/", "rerun+http://127.0.0.1/proxy"]
)
@pytest.mark.slow
def test_an_address_that_is_no_viewer_address_is_refused(url):
    with pytest.raises(OutputError, match="looks like"), RerunRecorder("x", url=url):
        pass


@pytest.mark.parametrize("url", ["rerunx://{}/proxy", "rerun+http://{}", "RERUN://{}/x"])
def test_an_address_that_the_viewer_does_not_know_is_refused_even_if_a_viewer_listens(url):
    port = free_ports(1)[0]
    address = url.format(f"127.0.0.1:{port}")
    with (
        RerunRecorder("x", port=port),
        pytest.raises(OutputError, match="looks like"),
        RerunRecorder("y", url=address),
    ):
        pass


@pytest.mark.parametrize("host", [".", "a" * 64])
def test_a_host_that_cannot_exist_has_no_viewer(host):
    with (
        pytest.raises(OutputError, match="no viewer listens"),
        RerunRecorder("x", url=f"rerun+http://{host}:9876/proxy"),
    ):
        pass


@pytest.mark.slow
@pytest.mark.parametrize("listens", [False, True])
def test_a_port_without_a_viewer_is_refused(listens, tmp_path):
    """The port is bound by another program that listens and never answers, or not."""
    with socket.socket() as occupant:
        occupant.bind(("127.0.0.1", 0))
        if listens:
            occupant.listen()
        url = f"rerun+http://127.0.0.1:{occupant.getsockname()[1]}/proxy"
        with (
            pytest.raises(OutputError, match="no viewer listens"),
            RerunRecorder("x", path=tmp_path / "a.rrd", url=url),
        ):
            pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_port_in_use_cannot_be_served():
    with socket.socket() as occupant:
        occupant.bind(("127.0.0.1", 0))
        occupant.listen()
        with (
            pytest.raises(OutputError, match="cannot serve"),
            RerunRecorder("x", port=occupant.getsockname()[1]),
        ):
            pass


def test_a_file_is_the_same_with_a_live_viewer(tmp_path, recording):
    (port,) = free_ports(1)
    with RerunRecorder("server", port=port) as server:
        assert server.url == f"rerun+http://127.0.0.1:{port}/proxy"
        path = record_both_modes(tmp_path / "a.rrd", 3, url=server.url)
    assert find_differences(path, recording) == []


@pytest.mark.slow
def test_a_lost_viewer_does_not_stop_the_file(tmp_path, recording):
    """The server of the viewer ends between both modes; a warning is given once."""
    (port,) = free_ports(1)
    server = RerunRecorder("server", port=port)
    url = f"rerun+http://127.0.0.1:{port}/proxy"
    with server, RerunRecorder("four bar", path=tmp_path / "a.rrd", url=url) as recorder:
        titles = {0: "0", 1: "1"}
        scene = scene_at_rest(FOUR_BAR_ARCS)
        recorder.start(RecordingHead([scene], INPUTS, titles))
        recorder.log(moving_scene(0, SAMPLES), SAMPLES, INPUTS)
        server.__exit__(None, None, None)
        with pytest.warns(UserWarning, match="the recording in the file continues"):
            recorder.log(moving_scene(1, SAMPLES), SAMPLES, INPUTS)
    assert find_differences(tmp_path / "a.rrd", recording) == []


def take_screenshot(recording, path, **options):
    """Return a screenshot as an array (height, width, 3); skip where none can be taken."""
    try:
        screenshot(recording, path, **options)
    except OutputError as error:
        if "mesa-vulkan-drivers" in str(error):
            pytest.skip("no Vulkan driver: install mesa-vulkan-drivers")
        raise
    png_signature = b"\x89PNG\r\n\x1a\n"
    assert path.read_bytes()[:8] == png_signature
    return np.array(pytest.importorskip("PIL.Image").open(path).convert("RGB"))


@pytest.mark.slow
@pytest.mark.viewer
def test_a_screenshot_shows_links_and_poles(recording, tmp_path):
    """A screenshot of a recording shows all colours of links and poles.

    The time is chosen by the input (60 degrees) and by the sample (60), which must look
    alike. Compared is the left half, the view in space, without the bar of time at its
    bottom.
    """
    by_input = take_screenshot(
        recording, tmp_path / "a.png", input_deg=60.0, size=(1200, 800)
    )
    by_sample = take_screenshot(recording, tmp_path / "b.png", sample=60, size=(1200, 800))
    assert by_input.shape[1] % 1200 == 0  # an integer number of pixels per point

    colour_differences = by_input[..., None, :].astype(int) - np.array(COLOURS)
    has_colour = np.abs(colour_differences).max(axis=-1) < 40
    pixel_counts = has_colour.sum(axis=(0, 1))
    assert (pixel_counts > 150).all(), "a link or a pole is not to be seen"

    half_width = by_input.shape[1] // 2
    first_space = by_input[:-80, :half_width]
    second_space = by_sample[:-80, :half_width]
    assert (first_space != second_space).any(axis=-1).mean() < 0.01


COLOURS = ((86, 180, 233), (238, 108, 52), (32, 190, 142), (255, 196, 0))
"""Red, green and blue (0 to 255) of the moving links and of poles."""


@pytest.mark.slow
@pytest.mark.viewer
def test_a_screenshot_shows_the_first_sample_that_closes(tmp_path):
    """By default a screenshot shows the first sample at which the mechanism closes.

    The four-bar does not close at an input of 180 degrees. Its poses are recorded in
    another order, from 180 degrees on, with the sample numbers 0, 1, .... So the first
    samples have no configuration.
    """
    path = tmp_path / "a.rrd"
    samples_from_180 = np.roll(SAMPLES, -180)
    scene = moving_scene(0, SAMPLES, NO_CRANK)
    with RerunRecorder("four bar", path=path) as recorder:
        recorder.start(RecordingHead([scene_at_rest(NO_CRANK)], INPUTS, {0: "Mode 0"}))
        # The first three primitives are links; plots would add other views.
        links = select_rows(scene, samples_from_180).primitives[:3]
        recorder.log(Scene(0, links), SAMPLES, INPUTS)
    closes = np.isfinite(four_bar_angles(INPUTS[samples_from_180], NO_CRANK, 0))
    first_closed = int(np.argmax(closes))
    assert first_closed > 0

    options = {"view": "3D", "size": (500, 400)}
    by_default = take_screenshot(path, tmp_path / "a.png", **options)
    by_sample = take_screenshot(path, tmp_path / "b.png", sample=first_closed, **options)
    assert np.array_equal(by_default, by_sample)


@pytest.mark.viewer
@pytest.mark.parametrize("input_deg", [-1.0, 361.0, np.inf, np.nan])
def test_a_screenshot_at_an_input_that_is_not_recorded_is_refused(
    recording, tmp_path, input_deg
):
    with pytest.raises(OutputError, match="its inputs: 0 to 360 deg"):
        take_screenshot(recording, tmp_path / "a.png", input_deg=input_deg)


def test_a_screenshot_refuses_wrong_arguments_with_a_reason(recording, tmp_path):
    with pytest.raises(OutputError, match="not both"):
        screenshot(recording, tmp_path / "a.png", sample=1, input_deg=1.0)
    with pytest.raises(OutputError, match="give the name of a file"):
        screenshot(recording, "")


def test_a_recording_with_another_ending_is_refused(recording, tmp_path):
    path = tmp_path / "recording"
    path.write_bytes(recording.read_bytes())
    with pytest.raises(OutputError, match=r"name the recording \*\.rrd"):
        recording_at(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_a_pipe_is_not_read_as_a_recording(tmp_path):
    """The pipe has no writer, so that reading from it would never end."""
    pipe = tmp_path / "a.rrd"
    os.mkfifo(pipe)
    with pytest.raises(OutputError, match="is a pipe or a device"):
        recording_at(pipe)


@pytest.mark.viewer
def test_picture_without_graphics_names_the_package(recording, tmp_path, monkeypatch):
    monkeypatch.setenv("VK_DRIVER_FILES", "/nonexistent")
    monkeypatch.setenv("VK_ICD_FILENAMES", "/nonexistent")
    with pytest.raises(OutputError, match="mesa-vulkan-drivers"):
        screenshot(recording, tmp_path / "a.png")


def test_names_of_links_do_not_cover_each_other():
    """Names of links and pairs in the default view are placed once, without overlap.

    The test estimates the box of a name: its half width is 0.016 for each letter and one
    more, its half height 0.045, in units of the sphere's radius. Pairs on one axis, such as
    "32" and "9_2", share a label.
    """
    motion = PositionAnalysis(sk.load("two_dof_spm"), samples=1).motion()
    bodies = link_bodies(motion.mechanism, motion.rotations[:1])
    # The eye of the default view.
    sight = facing(None)
    names_by_body = Names(sight).place_names(bodies)
    texts = [text for names in names_by_body.values() for text, *_ in names]
    assert len(texts) == len(set(texts))
    assert {"32, 9_2", "11_8", "87", "2", "11"} <= set(texts)

    boxes = []
    for body in bodies:
        rotation = Rotation.from_quat(body.quaternions[0]).as_matrix()
        for text, position, _ in names_by_body[body.path]:
            centre = project(sight, rotation @ position)
            half_size = np.array([0.016 * (len(text) + 1), 0.045])
            boxes.append((centre, half_size))
    for (first_centre, first_half), (second_centre, second_half) in combinations(boxes, 2):
        distance = np.abs(first_centre - second_centre)
        assert np.any(distance >= first_half + second_half)


@pytest.mark.parametrize("azimuths_deg", [range(0, 360, 60), (0, 240, 70, 150, 310)])
def test_sides_of_a_link_on_a_great_circle_follow_it_once(azimuths_deg):
    """The axes of a link are on a great circle, in any order, with gaps below 180 degrees.

    The sides are the great circle, so that their lengths sum to one turn.
    """
    azimuths = np.radians(azimuths_deg)
    joints = np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros(len(azimuths))], axis=1)
    tilted = Rotation.from_rotvec([0.0, 0.7, 0.0]).apply(joints)
    points = np.concatenate(link_curves(tilted))
    assert np.linalg.norm(points, axis=1) == pytest.approx(1.0)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.max(lengths) < np.radians(2.01)  # an arc begins where the last one ended
    assert np.sum(lengths) == pytest.approx(2.0 * np.pi, rel=1e-3)


@pytest.mark.slow
def test_graphs_have_the_same_layout_in_every_process():
    """The layout of a graph of links is the same in every process.

    The order of sets of texts depends on the hash seed of Python; the layout must not.
    """
    code = (
        "import spherekit as sk; from spherekit.mechanism.graph import layout_graph; "
        "print(layout_graph(sk.load('three_rrr')).tolist())"
    )
    layouts = set()
    for seed in ("1", "2"):
        process = subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        )
        layouts.add(process.stdout)
    assert len(layouts) == 1
