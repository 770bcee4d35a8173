"""The recordings: what is in the file, what happens when it cannot be written."""

import os
import resource
import socket
import subprocess
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
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
from spherekit.display.rerun.shapes import path_on_sphere
from spherekit.display.rerun.timelines import input_ticks, input_timeline, ticks_per_degree
from spherekit.display.rerun.viewer_program import free_ports
from spherekit.errors import OutputError
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.scenes.link_scenes import link_bodies
from spherekit.scenes.recording_head import RecordingHead
from spherekit.scenes.scene import Arrow, Scene, sample_rows

SAMPLES = np.arange(361)
INPUTS = np.radians(SAMPLES)
FOUR_BAR = sk.load("four_bar")
SERIES = "plots/velocity/4_1"
PLOTTED = ("plots/velocity/3_1", SERIES, "plots/acceleration/4_1")
NO_CRANK = (np.pi / 3, np.radians(50), np.radians(38), np.radians(50))
"""Closes on part of the turn only."""


@cache
def told(arcs):
    """Return what a run of a four-bar tells at first, and what of each mode, some plots.

    Modes are numbered as the closed forms number them.
    """
    sizes = zip(FOUR_BAR.geometry.links.items(), arcs, strict=True)
    links = {name: replace(size, arcs=(arc,)) for (name, size), arc in sizes}
    made = replace(FOUR_BAR, geometry=replace(FOUR_BAR.geometry, links=links))
    run = Collector()
    sk.run(made, "poles", samples=len(SAMPLES), recorder=run)
    modes = {
        mode: tuple(
            item
            for scene in run.scenes()
            if scene.page == 1 - mode
            for item in scene.primitives
            if item.path in PLOTTED or not item.path.startswith("plots/")
        )
        for mode in (0, 1)
    }
    return run.scenes()[0], modes


def resting(arcs):
    """Return what does not move: the frame and the plan."""
    return told(arcs)[0]


def block(mode, samples, arcs=FOUR_BAR_ARCS):
    """Return the moving four-bar at some samples."""
    return part(Scene(mode, told(arcs)[1][mode]), samples)


def part(scene, rows):
    """Return some rows of a scene."""
    parts = [
        replace(item, **{name: values[rows] for name, values in sample_rows(item).items()})
        for item in scene.primitives
    ]
    return Scene(scene.page, tuple(parts))


def record(path, blocks=1, arcs=FOUR_BAR_ARCS, **places):
    """Record both modes of a four-bar."""
    with RerunRecorder("four bar", path=path, **places) as recorder:
        titles = {0: "Mode 0", 1: "Mode 1"}
        recorder.start(RecordingHead([resting(arcs)], INPUTS, titles))
        for mode in (0, 1):
            whole = block(mode, SAMPLES, arcs)
            for samples in np.array_split(SAMPLES, blocks):
                recorder.log(part(whole, samples), samples, INPUTS[samples])
    return path


def columns(path, static=False):
    """Return the rows of every component that moves, or stays, and of the timelines."""
    found = {}
    chunks = [chunk for chunk in RrdReader(path).stream() if chunk.is_static == static]
    batches = [(chunk.entity_path, chunk.to_record_batch()) for chunk in chunks]
    if not static:
        batches.sort(key=lambda item: (item[0], item[1].column("sample")[0].as_py()))
    for entity, batch in batches:
        for name in batch.schema.names:
            if name != "rerun.controls.RowId":
                rows = batch.column(name)
                rows = rows.cast("int64") if name == "time" else rows
                found.setdefault((entity, name), []).extend(rows.to_pylist())
    return found


def differences(one, other):
    """Return the components that two recordings do not share, NaN equal to NaN."""
    a, b = columns(one), columns(other)
    return sorted(k for k in a.keys() | b.keys() if repr(a.get(k)) != repr(b.get(k)))


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """The four-bar of the paper, in one block."""
    return record(tmp_path_factory.mktemp("view") / "four_bar.rrd")


@pytest.fixture(scope="module")
def partial(tmp_path_factory):
    """A four-bar that closes on part of the turn, in four blocks."""
    path = tmp_path_factory.mktemp("view") / "no_crank.rrd"
    return record(path, 4, NO_CRANK)


def test_series_poles_and_links_are_where_they_belong(recording):
    """Series keep every digit."""
    found = columns(recording)
    for mode in (0, 1):
        entity = f"/four_bar/assembly_mode_{mode}/{SERIES}"
        values = np.concatenate(found[entity, "Scalars:scalars"])
        _, fourth = four_bar_coefficients(INPUTS, FOUR_BAR_ARCS, mode)
        np.testing.assert_allclose(values, fourth, atol=1e-12)
        (logged,) = [x for x in told(FOUR_BAR_ARCS)[1][mode] if x.path == SERIES]
        np.testing.assert_array_equal(values, logged.values)
        for timeline in ("sample", "input_deg"):
            assert found[entity, timeline] == SAMPLES.tolist()
    vectors = np.array(found["/four_bar/assembly_mode_1/pole/3_1", "Arrows3D:vectors"])
    u31 = four_bar_poles(INPUTS, FOUR_BAR_ARCS, 1)["31"]
    np.testing.assert_allclose(vectors[:, 0], 1.25 * u31, atol=1e-6)
    entity = "/four_bar/assembly_mode_1/link/3"
    turns = np.array(found[entity, "Transform3D:quaternion"])[:, 0]
    frames = four_bar_frames(INPUTS, FOUR_BAR_ARCS, 1)
    turned = Rotation.from_quat(turns).as_matrix()
    np.testing.assert_allclose(turned, frames[3], atol=1e-6)
    np.testing.assert_allclose(np.array(found[entity, "Transform3D:scale"]), 1.0)


def test_what_stays_is_logged_once(partial):
    still = [
        (chunk.entity_path, name)
        for chunk in RrdReader(partial).stream()
        if chunk.is_static and chunk.entity_path.startswith("/four_bar")
        for name in chunk.to_record_batch().schema.names
        if ":" in name and "RowId" not in name
    ]
    assert len(still) == len(set(still))
    curves = {entity for entity, name in still if name == "LineStrips3D:strips"}
    links = {f"/four_bar/assembly_mode_{m}/link/{j}" for m in (0, 1) for j in (2, 3, 4)}
    paths = {f"/four_bar/assembly_mode_{m}/pole/3_1/path" for m in (0, 1)}
    assert links | paths | {"/four_bar/link/1"} <= curves


@pytest.mark.many
@pytest.mark.parametrize("blocks", [5, [*range(1, 40), 200, *range(350, 361)]])
def test_block_size_does_not_matter(recording, tmp_path, blocks):
    """Five like blocks, and blocks of one sample before and behind long ones."""
    assert differences(record(tmp_path / "b.rrd", blocks), recording) == []


def of_assembly_modes(path, count):
    """Record five samples of so many assembly modes."""
    samples = SAMPLES[:5]
    with RerunRecorder("x", path=path) as recorder:
        titles = {k: f"Mode {k}" for k in range(count)}
        recorder.start(RecordingHead([], INPUTS, titles))
        for mode in range(count):
            scene = Scene(mode, block(0, samples).primitives)
            recorder.log(scene, samples, INPUTS[samples])
    return path


def test_files_grow_with_the_branches_and_not_with_their_square(tmp_path):
    sizes = [
        of_assembly_modes(tmp_path / f"{count}.rrd", count).stat().st_size
        for count in (1, 4, 16)
    ]
    assert sizes[2] - sizes[0] < 1.6 * 15 / 3 * (sizes[1] - sizes[0])


@pytest.mark.slow
def test_curves_have_the_colours_of_their_plot_and_compare_is_legible(tmp_path):
    found, entities = {}, set()
    for chunk in RrdReader(of_assembly_modes(tmp_path / "few.rrd", 2)).stream():
        if chunk.is_static and chunk.entity_path.startswith("/x"):
            entities.add(chunk.entity_path)
            batch = chunk.to_record_batch()
            for name in ("Points2D:colors", "LineStrips2D:colors"):
                if "/charts/" in chunk.entity_path and name in batch.schema.names:
                    found[chunk.entity_path] = batch.column(name).to_pylist()[0]
    for mode in (0, 1):
        chart = f"/x/assembly_mode_{mode}/charts/velocity_coefficients"
        names = found[f"{chart}/legend"]
        assert len(set(names)) == 2
        assert names == [found[f"{chart}/curves/{k}"][0] for k in (0, 1)]
    assert "/x/compare/acceleration_coefficients_1_rad/curves/1" in entities
    many = RrdReader(of_assembly_modes(tmp_path / "many.rrd", 31)).stream()
    compared = {c.entity_path for c in many if c.entity_path.startswith("/x/compare/")}
    assert {path.split("/")[3] for path in compared} == {"acceleration_coefficients_1_rad"}


def test_failed_samples_leave_nothing_on_the_screen(partial):
    found = columns(partial)
    failed = np.isnan(four_bar_angles(INPUTS, NO_CRANK, 0))
    assert 0 < failed.sum() < len(failed)
    base = "/four_bar/assembly_mode_0"
    arrows = found[f"{base}/pole/3_1", "Arrows3D:vectors"]
    assert [len(row or []) for row in arrows] == (~failed).astype(int).tolist()
    labels = found[f"{base}/link/3/labels", "Points3D:show_labels"]
    assert [row[0] for row in labels] == (~failed).tolist()
    for entity in (f"{base}/link/3", f"{base}/construction/circle_0"):
        turns = np.array(found[entity, "Transform3D:quaternion"])
        assert np.isfinite(turns).all()
        scale = np.array(found[entity, "Transform3D:scale"])[:, 0, 0]
        assert np.array_equal(scale < 1e-3, failed)
    shown = found[f"{base}/status", "Points3D:positions"]
    assert [len(row or []) for row in shown] == failed.astype(int).tolist()
    values = np.concatenate(found[f"{base}/{SERIES}", "Scalars:scalars"])
    assert np.array_equal(np.isnan(values), failed)


def test_arrows_that_cover_each_other_share_a_label(tmp_path):
    """Row 0: all apart. Row 1: the first two together. Row 2: one of them is missing."""
    x, y, z = np.eye(3)
    near = Rotation.from_rotvec([0.0, 0.0, np.radians(0.5)]).apply(x)
    rows = {
        "14": np.array([x, x, x]),
        "25": np.array([y, near, np.full(3, np.nan)]),
        "36": np.array([z, z, z]),
        "pair": np.array([x, x, x]),
    }
    arrows = [
        Arrow(f"pole/{name}", f"P{name}", u, name == "pair") for name, u in rows.items()
    ]
    path = tmp_path / "x.rrd"
    with RerunRecorder("four_bar", path=path) as recorder:
        recorder.start(RecordingHead())
        recorder.log(Scene(0, tuple(arrows)), np.arange(3))
    said = columns(path)
    base = "/four_bar/assembly_mode_0/pole"

    def labels(name):
        entity = f"{base}/{name}/label"
        shown = [len(row or []) for row in said[entity, "Points3D:positions"]]
        words = [list(row or []) for row in said[entity, "Points3D:labels"]]
        assert shown == [len(row) for row in words]
        return words

    assert labels("14") == [["P14"], ["P14, P25"], ["P14"]]
    assert labels("25") == [["P25"], [], []]
    assert labels("36") == 3 * [["P36"]]


def test_input_timeline_uses_the_coarsest_whole_unit():
    for degrees, name in [
        ([0.0, 90.0, 360.0], "input_deg"),
        ([0.0, 0.5], "input_deg_x10"),
        ([0.25], "input_deg_x100"),
        ([-0.125, 7.0], "input_deg_x1000"),
        ([1.0 / 3.0], "input_deg_x1000"),
    ]:
        timeline = input_timeline(np.radians(degrees))
        scale = timeline.ticks_per_degree
        assert (timeline.name, timeline.is_exact) == (name, degrees != [1.0 / 3.0])
        ticks = np.rint(np.array(degrees) * scale)
        assert np.array_equal(input_ticks(np.radians(degrees), scale), ticks)
        assert ticks_per_degree(name) == scale
    assert ticks_per_degree("sample") is None


def test_shapes():
    angle = np.radians(np.arange(0.0, 100.0, 10.0))
    arc = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    arc[4] = np.nan
    arc[7:] *= -1.0
    lines = path_on_sphere(arc)
    assert len(lines) == 3
    for line in lines:
        np.testing.assert_allclose(np.linalg.norm(line, axis=1), 1.0)
        assert np.linalg.norm(np.diff(line, axis=0), axis=1).max() < np.radians(3.1)
    assert path_on_sphere(np.tile([0.0, 0.0, 1.0], (5, 1))) == []
    assert path_on_sphere(np.full((3, 3), np.nan)) == []
    grid = np.roll(np.tile(arc[:4], (2, 1)), 2, axis=0)
    assert [len(path_on_sphere(grid, row)) for row in (None, 4)] == [1, 2]


def test_places_that_cannot_be_written(tmp_path):
    folder = tmp_path / "folder.rrd"
    folder.mkdir()
    for path, words in [
        (folder, "is a folder"),
        (tmp_path / "none" / "a.rrd", "does not exist"),
        (tmp_path / "a.txt", "named *.rrd"),
    ]:
        with (
            pytest.raises(OutputError, match=words.replace("*", r"\*")),
            RerunRecorder("x", path=path),
        ):
            pass
    assert list(tmp_path.iterdir()) == [folder]


@pytest.mark.parametrize("room", [0, 400_000])
def test_disk_that_fills_keeps_the_old_file(room, tmp_path):
    path = tmp_path / "a.rrd"
    path.write_text("the recording of yesterday")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        with pytest.raises(OutputError, match="make room"):
            record(path, 8)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_text() == "the recording of yesterday"
    assert list(tmp_path.iterdir()) == [path]


def test_interrupted_run_keeps_its_part(tmp_path):
    path = tmp_path / "a.rrd"
    with (
        pytest.raises(KeyboardInterrupt) as caught,
        RerunRecorder("four bar", path=path) as recorder,
    ):
        recorder.start(RecordingHead([resting(FOUR_BAR_ARCS)], INPUTS))
        recorder.log(block(0, SAMPLES[:50]), SAMPLES[:50], INPUTS[:50])
        raise KeyboardInterrupt
    part = tmp_path / "a.rrd.part"
    assert list(tmp_path.iterdir()) == [part]
    assert str(part) in caught.value.__notes__[0]
    assert len(columns(part)["/four_bar/assembly_mode_0/link/2", "sample"]) == 50


def test_wrong_number_of_rows(tmp_path):
    with (
        pytest.raises(ValueError, match="link/2 has 50 rows, the block has 49"),
        RerunRecorder("four bar", path=tmp_path / "a.rrd") as recorder,
    ):
        recorder.start(RecordingHead([], INPUTS))
        recorder.log(block(0, SAMPLES[:50]), SAMPLES[:49], INPUTS[:49])


@pytest.mark.slow
def test_no_viewer_listens_and_a_port_in_use_serves_none(tmp_path):
    for url in ("127.0.0.1", "http://x:1/", "rerun+http://127.0.0.1/proxy"):
        with pytest.raises(OutputError, match="looks like"), RerunRecorder("x", url=url):
            pass
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        url = f"rerun+http://127.0.0.1:{other.getsockname()[1]}/proxy"
        for listens in (False, True):
            if listens:
                other.listen()
            with (
                pytest.raises(OutputError, match="no viewer listens"),
                RerunRecorder("x", path=tmp_path / "a.rrd", url=url),
            ):
                pass
        with (
            pytest.raises(OutputError, match="cannot serve"),
            RerunRecorder("x", port=other.getsockname()[1]),
        ):
            pass
    assert list(tmp_path.iterdir()) == []


def test_file_and_live_together(tmp_path, recording):
    (port,) = free_ports(1)
    with RerunRecorder("server", port=port) as server:
        assert server.url == f"rerun+http://127.0.0.1:{port}/proxy"
        path = record(tmp_path / "a.rrd", 3, url=server.url)
    assert differences(path, recording) == []


@pytest.mark.slow
def test_lost_viewer_does_not_stop_the_file(tmp_path, recording):
    (port,) = free_ports(1)
    server = RerunRecorder("server", port=port)
    url = f"rerun+http://127.0.0.1:{port}/proxy"
    with server, RerunRecorder("four bar", path=tmp_path / "a.rrd", url=url) as recorder:
        titles = {0: "0", 1: "1"}
        recorder.start(RecordingHead([resting(FOUR_BAR_ARCS)], INPUTS, titles))
        for mode in (0, 1):
            if mode == 1:
                server.__exit__(None, None, None)
                with pytest.warns(UserWarning, match="the file goes on"):
                    recorder.log(block(mode, SAMPLES), SAMPLES, INPUTS)
            else:
                recorder.log(block(mode, SAMPLES), SAMPLES, INPUTS)
    assert differences(tmp_path / "a.rrd", recording) == []


def picture(recording, path, **options):
    """Return a screenshot as an array, or skip the test where none can be taken."""
    try:
        screenshot(recording, path, **options)
    except OutputError as error:
        if "mesa-vulkan-drivers" in str(error):
            pytest.skip("no Vulkan driver: install mesa-vulkan-drivers")
        raise
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    return np.array(pytest.importorskip("PIL.Image").open(path).convert("RGB"))


@pytest.mark.viewer
def test_picture_shows_the_mechanism(recording, tmp_path):
    first = picture(recording, tmp_path / "a.png", input_deg=60.0, size=(1200, 800))
    again = picture(recording, tmp_path / "b.png", sample=60, size=(1200, 800))
    assert first.shape[1] % 1200 == 0
    near = np.abs(first[..., None, :].astype(int) - np.array(COLOURS)).max(axis=-1) < 40
    assert (near.sum(axis=(0, 1)) > 150).all(), "a link or a pole is not to be seen"
    space = first[:, : first.shape[1] // 2], again[:, : again.shape[1] // 2]
    different = (space[0][:-80] != space[1][:-80]).any(axis=-1).mean()
    assert different < 0.01


COLOURS = ((86, 180, 233), (238, 108, 52), (32, 190, 142), (255, 196, 0))


@pytest.mark.slow
@pytest.mark.viewer
def test_picture_starts_where_the_mechanism_closes(tmp_path):
    path, turned = tmp_path / "a.rrd", np.roll(SAMPLES, -180)
    whole = block(0, SAMPLES, NO_CRANK)
    with RerunRecorder("four bar", path=path) as recorder:
        recorder.start(RecordingHead([resting(NO_CRANK)], INPUTS, {0: "Mode 0"}))
        moving = part(whole, turned).primitives[:3]  # links, and no plot beside them
        recorder.log(Scene(0, moving), SAMPLES, INPUTS)
    closes = np.isfinite(four_bar_angles(INPUTS[turned], NO_CRANK, 0))
    first = int(np.argmax(closes))
    shown = picture(path, tmp_path / "a.png", view="3D", size=(500, 400))
    there = picture(path, tmp_path / "b.png", view="3D", size=(500, 400), sample=first)
    assert first > 0 and np.array_equal(shown, there)


@pytest.mark.viewer
def test_picture_without_graphics_names_the_package(recording, tmp_path, monkeypatch):
    monkeypatch.setenv("VK_DRIVER_FILES", "/nonexistent")
    monkeypatch.setenv("VK_ICD_FILENAMES", "/nonexistent")
    with pytest.raises(OutputError, match="mesa-vulkan-drivers"):
        screenshot(recording, tmp_path / "a.png")


def test_names_of_links_do_not_cover_each_other():
    motion = PositionAnalysis(sk.load("two_dof_spm"), samples=1).motion()
    bodies = link_bodies(motion.mechanism, motion.rotations[:1])
    sight = facing(None)
    given = Names(sight).place_names(bodies)
    words = [text for names in given.values() for text, *_ in names]
    assert len(words) == len(set(words))
    assert {"32, 9_2", "11_8", "87", "2", "11"} <= set(words)
    boxes = []
    for body in bodies:
        turn = Rotation.from_quat(body.quaternions[0]).as_matrix()
        for text, place, _ in given[body.path]:
            middle = project(sight, turn @ place)
            boxes.append((middle, np.array([0.016 * (len(text) + 1), 0.045])))
    for k, (middle, half) in enumerate(boxes):
        for other, size in boxes[:k]:
            assert np.any(np.abs(middle - other) >= half + size)


@pytest.mark.slow
def test_graphs_have_the_same_layout_in_every_process():
    """Sets of texts have another order in each process; a layout must not depend on it."""
    code = (
        "import spherekit as sk; from spherekit.mechanism.graph import layout_graph; "
        "print(layout_graph(sk.load('three_rrr')).tolist())"
    )
    layouts = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(layouts) == 1
