"""What recordings show, read back and compared with tables and closed forms."""

import os
import re
from itertools import pairwise

import numpy as np
import pytest
from helpers.refusals import mechanism_text
from helpers.scene_listener import SceneListener
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.cli.main import main
from spherekit.cli.view import find_recording
from spherekit.display.rerun.chart_frame import FRAME_HEIGHT, tick_text, ticks
from spherekit.display.rerun.charts import Chart, grid_values
from spherekit.display.rerun.preview import preview
from spherekit.display.rerun.recorder import RerunRecorder
from spherekit.display.rerun.screenshot import check_picture, check_version
from spherekit.errors import OutputError, SolveError
from spherekit.scenes.colours import HEAT, heat_colours
from spherekit.scenes.plot_layout import choose_plot_range
from spherekit.scenes.scene import Axis, Diagram, InputMarks, Series, Trace


def recorded(path, name, *args, **options):
    """Record a run, return its result and the titles of the pages in order."""
    with RerunRecorder(name, path=path) as recorder:
        result = sk.run(name, *args, recorder=recorder, **options)
        recorder.finish()
        pages = recorder._charts.layout.blueprint().root_container.contents
    return result, [page.name for page in pages]


def rows_of(path, entity, component):
    """Return the rows of one component of an entity, as recorded."""
    rows = []
    for chunk in RrdReader(path).stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path == entity and component in batch.schema.names:
            rows += batch.column(component).to_pylist()
    return rows


def number(text):
    return float(text.replace("\u2212", "-"))


def test_cursors_and_legends_of_plots_say_what_the_table_says(tmp_path):
    path = tmp_path / "a.rrd"
    result, pages = recorded(path, "four_bar", "poles:only=31+41", samples=73)
    assert pages == ["Mode 0 (+, p1)", "Mode 1 (-, p0)", "Compare"]
    frame = result.frame()
    for mode in (0, 1):
        where = f"/four_bar/assembly_mode_{mode}/charts/velocity_coefficients"
        x = np.array(rows_of(path, f"{where}/cursor", "LineStrips2D:strips"))[:, 0, 0, 0]
        degrees = np.degrees(result.frame("motion").query("assembly_mode == @mode")["q"])
        assert x / x[-1] == pytest.approx(degrees / 360.0, abs=1e-6)
        words = rows_of(path, f"{where}/legend", "Points2D:labels")
        for k, link in enumerate("34"):
            shown = np.array([number(row[k].split("  ")[1]) for row in words])
            own = frame[(frame["assembly_mode"] == mode) & (frame["link"] == link)]
            rate = own["velocity_coefficient"].to_numpy()
            assert shown == pytest.approx(rate, rel=6e-4)
            (curve,) = rows_of(path, f"{where}/curves/{k}", "LineStrips2D:strips")
            y = -np.array(curve[0])[:, 1]
            assert np.corrcoef(y, rate)[0, 1] == pytest.approx(1.0, abs=1e-9)
            assert np.all((y < 0.0) & (y > -FRAME_HEIGHT))
    with RerunRecorder("four_bar", path=path) as recorder:
        sk.run("four_bar", "poles:only=31", duration=2.0, samples=9, recorder=recorder)
        assert recorder._charts.layout.step == 0.25  # s, from one sample to the next


def test_over_a_grid_series_are_maps_of_the_inputs(tmp_path):
    path = tmp_path / "a.rrd"
    result, _ = recorded(path, "five_bar", "poles:only=31", samples=(5, 4), grid=True)
    entities = {chunk.entity_path for chunk in RrdReader(path).stream()}
    maps = {e for e in entities if e.endswith("/map")}
    assert maps and not any("/curves/" in entity for entity in entities)
    motion = result.frame("motion").query("assembly_mode == 0")
    values = np.arange(20.0)
    x, y, cells = grid_values(
        [motion["q_21"].to_numpy(), motion["q_51"].to_numpy()], values
    )
    assert np.degrees(x) == pytest.approx(np.linspace(40.0, 140.0, 5))
    assert np.degrees(y) == pytest.approx(np.linspace(40.0, 140.0, 4))
    assert np.array_equal(cells, values.reshape(5, 4))


def test_ticks_are_round_and_colours_go_from_first_to_last():
    assert choose_plot_range(np.array([np.nan, 1.0, 3.0]), 3.0) == pytest.approx((0.9, 3.1))
    assert choose_plot_range(np.array([np.nan, 1.0, 3.0]), 3.0, shown_by="colours") == (
        1,
        3,
    )
    for low, high, degrees, expected in (
        (0.0, 360.0, True, ["0", "60", "120", "180", "240", "300", "360"]),
        (0.0, 1.0, False, ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]),
        (-0.3, 0.2, False, ["\u22120.3", "\u22120.2", "\u22120.1", "0", "0.1", "0.2"]),
    ):
        step, values = ticks(low, high, degrees)
        assert [tick_text(value, step) for value in values] == expected
    over = (Axis("input", "deg", np.linspace(0.0, 90.0, 7)),)
    chart, marks = Chart("c", over), InputMarks("m", "m", np.array([[-30.0], [45.0]]))
    chart.add("c", Series("c", "c", "c", np.arange(7.0)), over)
    (line,) = dict(chart.draw([marks]))["marks/0"].strips.as_arrow_array().to_pylist()
    assert line[0][0] == pytest.approx(0.5 * chart.width)  # that at 45 deg alone
    low, high = heat_colours(np.array([2.0, 5.0]), 2.0, 5.0).tolist()
    assert (tuple(low), tuple(high)) == (HEAT[0], HEAT[-1])


@pytest.mark.slow
def test_what_is_to_be_seen_is_kept_after_the_first_time(tmp_path):
    pytest.importorskip("matplotlib", reason="figures are drawn by matplotlib")
    options = {"samples": 13, "block": 5}
    sk.run("four_bar", "poles", **options).save(tmp_path / "a.rrd")
    result = sk.run("four_bar", "poles", **options)
    names = list(result.plot())

    def go(recorder):
        raise AssertionError("it went through the run again")

    result.views.go = go
    assert list(result.plot(columns=1)) == names
    result.save(tmp_path / "b.rrd")
    where = "/four_bar/assembly_mode_1/charts/velocity_coefficients/legend"
    rows = [rows_of(tmp_path / f"{n}.rrd", where, "Points2D:labels") for n in "ab"]
    assert rows[0] == rows[1] and len(rows[0]) == 13


@pytest.mark.slow
def test_what_was_asked_for_comes_first(tmp_path):
    pose = "inverse_kinematics:poses=x=0.5+y=0.6+z=0.62"
    _, pages = recorded(tmp_path / "a.rrd", "five_bar", [pose, "poles"], samples=3)
    assert pages[0] == "Inverse" and pages.index("Mode 0 (+)") > pages.index("Measure")
    _, pages = recorded(tmp_path / "b.rrd", "five_bar", ["poles", pose], samples=3)
    assert pages[0] == "Mode 0 (+)"
    _, pages = recorded(tmp_path / "c.rrd", "four_bar", "singularities", samples=9)
    assert pages[0] == "Singularities"


def test_solved_poses_are_drawn():
    listener = SceneListener()
    wanted = np.array([0.5, 0.6, 0.62]) / np.linalg.norm([0.5, 0.6, 0.62])
    pose = "inverse_kinematics:poses=x=0.5+y=0.6+z=0.62"
    result = sk.run("five_bar", pose, recorder=listener, samples=3)
    (page,) = [scene for scene in listener.scenes if scene.page == "Inverse"]
    bodies = {p.path: p for p in page.primitives if p.path.startswith("link/")}
    solved = result.frame("inverse_kinematics").query("status == 'OK'")
    assert len(bodies["link/3"].quaternions) == len(solved) == 4
    mechanism = sk.load("five_bar")
    axis = np.array(mechanism.outputs[0].direction)
    turned = Rotation.from_quat(bodies["link/3"].quaternions).apply(axis)
    assert np.max(np.abs(turned - wanted)) < 1e-9


def test_the_moving_axode_rolls_on_the_fixed_one():
    listener = SceneListener()
    result = sk.run("four_bar", "poles:only=31,axodes=31", recorder=listener, samples=2881)
    frame = result.frame().query("assembly_mode == 0")
    pages = [scene.primitives for scene in listener.scenes if scene.page == 0]
    fixed, moving = (item for page in pages for item in page if isinstance(item, Trace))
    u = frame[["ux", "uy", "uz"]].to_numpy()
    assert fixed.quaternions is None
    assert np.max(np.abs(fixed.directions - u)) < 1e-14
    lengths = [
        np.cumsum(np.linalg.norm(np.diff(each.directions, axis=0), axis=1))
        for each in (fixed, moving)
    ]
    assert lengths[0][-1] > 1.0
    assert lengths[1] == pytest.approx(lengths[0], rel=1e-4)  # no slip
    turned = Rotation.from_quat(moving.quaternions).apply
    assert np.max(np.abs(turned(moving.directions) - u)) < 1e-12  # in contact
    step = np.gradient(moving.directions, axis=0)
    there, here = turned(step), np.gradient(fixed.directions, axis=0)
    sine = np.linalg.norm(np.cross(there, here), axis=1)
    size = np.linalg.norm(there, axis=1) * np.linalg.norm(here, axis=1)
    assert np.max((sine / size)[2:-2]) < 5e-3  # tangent


@pytest.mark.many
@pytest.mark.parametrize("name", ["stephenson", "double_butterfly", "four_bar"])
def test_each_step_of_the_construction_gives_a_pole_where_its_lines_meet(name):
    listener = SceneListener()
    poles = "poles:circles=4/1" if name == "four_bar" else "poles"  # the axis of a pair
    result = sk.run(name, poles, recorder=listener, samples=3, assembly_mode=0)
    (page,) = [scene for scene in listener.scenes if scene.page == "Construction"]
    (diagram,) = [p for p in page.primitives if isinstance(p, Diagram)]
    shown = np.isfinite(diagram.places).all(axis=2)
    new = [np.flatnonzero(b & ~a) for a, b in pairwise(shown)]
    meets = 0
    for step, found in enumerate(new, start=1):
        lines = diagram.lines[step]
        if not np.isfinite(lines).all() or len(found) != 1:
            continue
        x = diagram.places[step, found[0]]
        gap = (lines[:, :2] @ x + lines[:, 2]) / np.linalg.norm(lines[:, :2], axis=1)
        assert np.max(np.abs(gap)) < 1e-7 * max(1.0, np.max(np.abs(x)))
        meets += 1
    links = len(sk.load(name).links)
    secondary = links * (links - 1) // 2 - len(sk.load(name).pairs)
    assert len(diagram.words) == secondary + 1
    assert meets == secondary - (name == "double_butterfly")
    assert sum("irreducible" in words for words in diagram.words) == secondary - meets
    assert len(result.frame()) > 0


def test_a_mechanism_is_seen_before_any_run(tmp_path):
    path = tmp_path / "a.rrd"
    assert preview(sk.load("stephenson"), path) == ""
    (text,) = rows_of(path, "/stephenson/assembly_mode_0/sizes", "TextDocument:text")
    assert "| 2 | 12\u201323 15 |" in text[0]
    motion = sk.run("stephenson", "poles:only=21", samples=1).frame("motion")
    for pair in ("34", "16", "56"):
        where = f"/stephenson/assembly_mode_0/zero/{pair}"
        (strips,) = rows_of(path, where, "LineStrips3D:strips")
        axis, fan = np.array(strips[0][0]), np.array(strips[1])
        axis /= np.linalg.norm(axis)
        flat = fan - np.outer(fan @ axis, axis)
        along = np.sum(np.cross(flat[:-1], flat[1:]) @ axis / np.sum(flat[1:] ** 2, axis=1))
        value = float(motion.query("assembly_mode == 0")[f"theta_{pair}"].iloc[0])
        assert along == pytest.approx(value, rel=2e-3)


FAR = mechanism_text("far")


def test_a_mechanism_that_does_not_close_everywhere_says_where_it_is_shown(tmp_path):
    """The crank's tip is at 0 at the start, and the others reach 5 to 15 deg."""
    file = tmp_path / "far.toml"
    file.write_text(FAR.format("0.0", "40.0"))
    assert "shown at 21 = 10 deg" in preview(sk.load(file), tmp_path / "a.rrd")
    file.write_text(FAR.format("100.0", "200.0"))
    with pytest.raises(SolveError):
        preview(sk.load(file), tmp_path / "b.rrd")
    assert not (tmp_path / "b.rrd").exists()


def test_what_cannot_be_shown_is_refused_at_once(tmp_path, capsys):
    old = tmp_path / "a.rrd"
    old.write_bytes(b"RRF2" + bytes([0, 99, 0, 0]) + bytes(40))
    with pytest.raises(OutputError, match=re.escape("rerun-sdk==0.99.*")):
        check_version(old)
    old.write_bytes(b"RRF0" + bytes(44))
    with pytest.raises(OutputError, match="make it again"):
        check_version(old)
    for name, size, words in (
        ("x.jpg", (800, 600), "name it"),
        ("none/x.png", (800, 600), "does not exist"),
        ("x.png", (800, 60), "100 to 8192"),
    ):
        with pytest.raises(OutputError, match=words):
            check_picture(tmp_path / name, size)
    recorded(tmp_path / "b.rrd", "four_bar", "poles:only=31", samples=3)
    assert main(["view", str(tmp_path), "--png", str(tmp_path / "x.jpg")]) == 1
    assert "x.png" in capsys.readouterr().err


def test_a_folder_says_which_recording_it_took(tmp_path, capsys):
    for age, name in enumerate(("old.rrd", "new.rrd")):
        path = tmp_path / name
        path.write_bytes(b"RRF2")
        os.utime(path, (age, age))
    assert find_recording(str(tmp_path)).name == "new.rrd"
    assert "old.rrd" in capsys.readouterr().err
