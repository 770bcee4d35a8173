"""From block to block: angles that go on, findings, frames, and what is asked once."""

import json
from dataclasses import dataclass, replace
from typing import ClassVar, final

import numpy as np
import pytest
from helpers.minimal_analysis import MinimalAnalysis, with_row_columns
from helpers.scene_listener import SceneListener
from mechanism_examples.shipped_mechanisms import four_bar_with_springs

import spherekit as sk
from spherekit.conventions import TURN
from spherekit.positions.angle_unwrapping import continue_angles
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.runs.contract import Findings
from spherekit.runs.needs import Needs
from spherekit.scenes.scene import Axis, Portrait, Scene, Series
from spherekit.tables.table import ASSEMBLY_MODE, SAMPLE, Column, Table

BACK = {"laws": {"21": sk.ConstantSpeed(-7.0, 1.0)}, "duration": 3.0}
"""More than three turns of the crank, and of the coupler on it, backwards."""

RUN_OPTIONS = {
    "samples": {"samples": 120},
    "one assembly mode": {"samples": 120, "assembly_mode": 1},
    "a law": {"samples": 120, **BACK},
    "a path": {"path": np.sin(np.linspace(0.0, 9.0, 120))[:, None] * 9.0},
    "loads": {
        "samples": 120,
        "start": sk.Start(0.3, 20.0),
        "duration": 2.0,
        "engine": "numpy",
    },
}


def many_turns():
    return PositionAnalysis(sk.load("four_bar"), path=np.linspace(0.5, -25.0, 161)[:, None])


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("size", [1, 7, 100])
def test_angles_continue_from_block_to_block_as_in_one_motion(size):
    """Angles that count whole turns continue from block to block of samples.

    A block needs the last angles of the block before. The angles of blocks of `size`
    samples must equal those of the whole motion, for a four-bar that turns four times and
    for a path of two inputs. One sample in five is missing. The state between blocks passes
    through JSON, as in a run that is resumed.
    """

    def with_missing_samples(motion):
        values = motion.values.copy()
        values[motion.sample % 5 == 3] = np.nan
        return replace(motion, values=values)

    path = np.linspace(0.0, 1.0, 40)[:, None] * np.array([0.9, 0.7])
    five_bar = PositionAnalysis(sk.load("five_bar"), path=path)
    for position_analysis in (many_turns(), five_bar):
        names = list(position_analysis.mechanism.angles)
        mode_count = len(position_analysis.assembly_modes)
        # How the whole turns of each angle are counted.
        unwrapping = position_analysis.angle_unwrapping
        motion = with_missing_samples(position_analysis.motion())
        whole = continue_angles(motion, names, unwrapping, {})
        # The last angles of a block, which each call reads and replaces.
        state = {}
        blocks = []
        for block in position_analysis.blocks(size):
            angles = continue_angles(with_missing_samples(block), names, unwrapping, state)
            blocks.append(
                {x: column.reshape(mode_count, -1) for x, column in angles.items()}
            )
            state = json.loads(json.dumps(state))
        for name in names:
            joined = np.concatenate([block[name] for block in blocks], axis=1).ravel()
            assert np.allclose(joined, whole[name], rtol=0.0, atol=1e-12, equal_nan=True)


def test_angles_of_inputs_are_the_inputs_themselves():
    """A path from 0.5 to -25 rad keeps its turns."""
    position_analysis = many_turns()
    motion = position_analysis.motion()
    unwrapping = position_analysis.angle_unwrapping
    angles = continue_angles(motion, ["21"], unwrapping, {})["21"]
    assert np.array_equal(angles, motion.q)
    assert np.min(angles) == -25.0


def test_angles_on_a_grid_grow_as_along_a_fine_path():
    """Whole turns of angles are counted right on a coarse grid of two inputs.

    Angles of a motion are in (-pi, pi], and `continue_angles` adds the whole turns. From
    the first to the last corner of the grid, an angle must grow as along a fine path
    between these corners. The path has 400 samples, close enough for `np.unwrap` to count
    turns.
    """
    five_bar = sk.load("five_bar")
    inputs = tuple(
        replace(item, start=0.7, stop=stop)
        for item, stop in zip(five_bar.inputs, (1.1, 2.4), strict=True)
    )
    mechanism = replace(five_bar, inputs=inputs)
    grid = PositionAnalysis(mechanism, samples=(3, 4), grid=True)
    names = sorted(set(grid.mechanism.angles) - set(grid.inputs))
    # `last` has the angles at the end of the block of samples before. There is no such
    # block here.
    angles = continue_angles(grid.motion(), names, grid.angle_unwrapping, last={})
    path = np.linspace([0.7, 0.7], [1.1, 2.4], 400)
    fine_motion = PositionAnalysis(mechanism, path=path).motion()
    for name in names:
        variable = fine_motion.mechanism.angles[name]
        # (modes, samples) angles on the path and on the grid
        path_angles = np.unwrap(fine_motion.values[:, variable].reshape(2, -1), axis=1)
        grid_angles = angles[name].reshape(2, -1)
        growth_on_path = path_angles[:, -1] - path_angles[:, 0]
        growth_on_grid = grid_angles[:, -1] - grid_angles[:, 0]
        assert np.max(np.abs(growth_on_grid - growth_on_path)) < 1e-9


def test_angles_grow_by_every_turn_of_one_of_several_inputs():
    def angles(turns):
        way = np.radians([[40.0 + 360.0 * turns, 40.0], [50.0 + 360.0 * turns, 45.0]])
        five = PositionAnalysis(sk.load("five_bar"), path=way)
        return continue_angles(five.motion(), ["54"], five.angle_unwrapping, {})["54"]

    lap = angles(1) - angles(0)
    assert np.max(np.abs(np.abs(lap) - TURN)) < 1e-9
    for turns in (-1000, 100_000):
        assert np.max(np.abs(angles(turns) - angles(0) - turns * lap)) < 1e-6


def data_of(result, name):
    found = result.results[name]
    return {table.name: found.data[table.name] for table in found.tables}


@pytest.mark.many
@pytest.mark.parametrize("course", RUN_OPTIONS)
def test_eksergian_gives_the_same_tables_and_findings_in_blocks(course):
    """The analysis "eksergian" has the same results in one block of samples and in several.

    It computes driving torques of a four-bar with springs at three pairs, whose torques
    depend on whole turns. `course` chooses how the mechanism moves (`RUN_OPTIONS`). Blocks
    have 7 samples. The findings are the largest condition number of the loop equations,
    with the mode and the input at which it occurs.
    """
    mechanism = four_bar_with_springs("21", "32", "43")
    options = RUN_OPTIONS[course]
    whole = sk.run(mechanism, "eksergian", **options, block=None)
    in_blocks = sk.run(mechanism, "eksergian", **options, block=7)
    assert in_blocks.summary["samples_in_a_block"] == 7
    assert whole.summary["samples"] > 7

    for name in ("motion", "eksergian"):
        block_tables = data_of(in_blocks, name)
        for table, columns in data_of(whole, name).items():
            for column, values in columns.items():
                block_values = block_tables[table][column]
                if values.dtype.kind != "f":
                    assert np.array_equal(values, block_values)
                    continue
                # The torque tau is a difference of larger numbers. One of them is Q, the
                # generalized force of the loads.
                scale_column = columns["Q"] if column == "tau" else values
                scale = max(np.nanmax(np.abs(scale_column), initial=0.0), 1.0)
                # Rows that failed are NaN, which is ignored.
                gap = np.nanmax(np.abs(values - block_values), initial=0.0)
                assert gap <= 2e-14 * scale, column

    findings = whole.summary["analyses"][0]["findings"]
    block_findings = in_blocks.summary["analyses"][0]["findings"]
    conditioning = findings["largest_conditioning"]
    assert block_findings["largest_conditioning"] == pytest.approx(conditioning, rel=1e-12)
    assert block_findings["at_assembly_mode"] == findings["at_assembly_mode"]
    assert block_findings["at_q_rad"] == pytest.approx(findings["at_q_rad"], abs=1e-14)


@pytest.mark.slow
def test_a_portrait_has_one_frame_whatever_the_blocks():
    listener = SceneListener()
    how = {**RUN_OPTIONS["loads"], "block": 50, "recorder": listener}
    frame = sk.run(four_bar_with_springs("21", "32", "43"), "eksergian", **how).frame()
    every = [part for scene in listener.scenes for part in scene.primitives]
    portraits = [part for part in every if isinstance(part, Portrait)]
    assert sum(len(portrait.x) for portrait in portraits) == 120
    for portrait in portraits:
        assert portrait.x_range == (frame["q"].min(), frame["q"].max())
        assert portrait.y_range == (frame["dq"].min(), frame["dq"].max())


@final
@dataclass(frozen=True, kw_only=True)
class Counting(MinimalAnalysis):
    """Analysis for tests with the number of rows in a block of samples as its finding.

    A row is one sample in one assembly mode (way to assemble the links). The column `x` is
    an example of a quantity that continues from block to block: the angle of pair 41
    without jumps of whole revolutions (`continued_value`). The method `joined` joins the
    findings of two blocks. If `joins` is False, it is as if the method were not defined.
    """

    name: ClassVar = "counting"
    rowwise: ClassVar = True
    tables: ClassVar = (
        Table("counting", "", (SAMPLE, ASSEMBLY_MODE, Column("x", "", ""))),
    )
    joins: bool = True

    def needs(self, mechanism):
        return Needs(continued_values=frozenset(["41"]))

    def compute(self, batch):
        return {"counting": with_row_columns(batch, x=batch.continued_value("41"))}

    def findings(self, batch):
        return Findings({"rows": len(batch)})

    def joined(self, before, now):
        if not self.joins:
            return super().joined(before, now)
        return Findings({"rows": before.figures["rows"] + now.figures["rows"]})


def test_findings_of_blocks_are_joined():
    """25 samples of two modes are 50 rows, whatever the blocks."""
    result = sk.run(sk.load("four_bar"), Counting(), samples=25, block=4)
    assert result.summary["analyses"][0]["findings"] == {"rows": 50}


@dataclass(frozen=True)
class FailsLater(Counting):
    """An analysis that states a finding of its first block and fails in the second one."""

    name: ClassVar = "failing_later"

    def findings(self, batch):
        if batch.sample[0] > 0:
            raise ValueError("a later block")
        return Findings({"rows": 1}, warnings=("One.",), remarks=("One.",))


def test_an_analysis_that_fails_in_a_later_block_leaves_no_findings():
    """Findings of the first samples would be read as results of the whole motion."""
    result = sk.run(sk.load("four_bar"), FailsLater(), samples=8, block=4)
    assert "a later block" in result.failures["failing_later"]
    assert result.summary["analyses"][0]["findings"] == {}
    assert result.summary["remarks"] == result.summary["warnings"] == []


def test_findings_that_differ_between_blocks_need_a_way_to_join_them():
    """An analysis without `joined` fails if its findings differ between blocks of samples.

    Equal findings of all blocks are taken. 25 samples make five equal blocks of 5 samples
    (10 rows of two modes), but not of 4. The analysis `Counting` counts the rows of a
    block. Its failure does not end the run: the motion and the other analysis have all
    samples.
    """
    analyses = [Counting(joins=False), "poles"]
    mechanism = sk.load("four_bar")
    result = sk.run(mechanism, analyses, samples=25, block=5)
    assert result.summary["analyses"][0]["findings"] == {"rows": 10}
    result = sk.run(mechanism, analyses, samples=25, block=4)
    assert "define joined()" in result.failures["counting"]
    largest_residual = result.summary["errors_reached"]["largest_closure_residual_rad"]
    assert largest_residual == result.frame("motion")["residual"].max()
    mode_count = 2
    pole_count = 6  # one for each two of the four links
    assert len(result.frame("poles")) == 25 * mode_count * pole_count


@final
@dataclass(frozen=True, kw_only=True)
class SampleFreeAnalysis(MinimalAnalysis):
    """An analysis for tests, with results that do not depend on the samples of the run.

    A run computes its samples in blocks. It must call such an analysis once, and not for
    every block. To show this, `calls` gets an item for each call of `compute`: the number
    of the first sample.

    All results are arbitrary numbers. The table has three rows, and the page for the viewer
    a series of four values. The runs have more samples than these, so that tests see
    results whose length is not that of the samples.
    """

    name: ClassVar = "apart"
    reads_samples: ClassVar = False
    tables: ClassVar = (Table("apart", "", (Column("x", "", ""),)),)
    calls: ClassVar = []

    def compute(self, batch):
        self.calls.append(batch.sample[0])
        return {"apart": {"x": np.arange(3.0)}}

    def findings(self, batch):
        return Findings(figures={"third": 3.0}, warnings=(), remarks=("Three.",))

    def scene(self, batch):
        series = Series("s", "s", "g", np.arange(4.0))
        return (Scene("Apart", (series,), (ROW_AXIS,)),)


ROW_AXIS = Axis("row", "", np.arange(4.0))


def test_an_analysis_that_reads_no_samples_is_computed_once():
    """An analysis that reads no samples is called once in a run of seven blocks.

    `SampleFreeAnalysis` counts its calls. Its table has three rows. Its page has four rows
    and is shown once. The rows of the page start at 0, 90, 180 and 270 degrees of the
    input, or at quarters of the duration of a run in time. `SceneListener` collects the
    pages.
    """
    mechanism = sk.load("four_bar")
    listener = SceneListener()
    SampleFreeAnalysis.calls.clear()
    analyses = [SampleFreeAnalysis(), "poles"]
    result = sk.run(mechanism, analyses, samples=25, block=4, recorder=listener)
    assert SampleFreeAnalysis.calls == [0]  # one call, with a batch from sample 0 on
    assert result.summary["samples_in_a_block"] == 4
    assert result.frame("apart")["x"].tolist() == [0.0, 1.0, 2.0]

    # Pages with a name are logged once; the others are pages of assembly modes.
    logged = [entry for entry in listener.logged if isinstance(entry[0], str)]
    assert sorted(page for page, *_ in logged) == ["Apart", "Construction"]
    (entry,) = (entry for entry in logged if entry[0] == "Apart")
    _, samples, inputs, times = entry
    assert samples == [0, 1, 2, 3]
    assert np.allclose(inputs, np.arange(4) * np.pi / 2.0)
    assert times is None

    timed_listener = SceneListener()
    options = {"samples": 25, "block": 4, "duration": 2.0}
    sk.run(mechanism, SampleFreeAnalysis(), **options, recorder=timed_listener)
    (entry,) = (entry for entry in timed_listener.logged if isinstance(entry[0], str))
    _, _, inputs, times = entry
    assert inputs is None
    assert times.tolist() == [0.0, 0.5, 1.0, 1.5]


@pytest.mark.parametrize(
    "request_text",
    [
        "inverse_kinematics:poses=21=14+61=23",
        "workspace:working_mode=0,tolerance=0.1",
        "equivalent_rotation:start=phi=75+gamma=-20,end=phi=70+gamma=20,samples=3",
    ],
)
def test_no_motion_is_computed_for_analyses_that_read_no_samples(request_text, monkeypatch):
    """Analyses that read no samples need no motion: no assembly mode is searched.

    The search is replaced by an error. No table of a motion is written. As soon as another
    analysis reads samples, the search is called.
    """

    def refuse_to_search(*arguments, **options):
        raise AssertionError("a motion was traced")

    monkeypatch.setattr(
        "spherekit.positions.position_analysis.ModeSearch", refuse_to_search
    )
    mechanism = sk.load("two_dof_spm")
    result = sk.run(mechanism, request_text)
    assert not result.failures
    assert not result.results["motion"].tables
    assert result.summary["assembly_modes"] == []
    assert result.summary["remarks"]  # findings of the analysis
    with pytest.raises(AssertionError, match="was traced"):
        sk.run(mechanism, [request_text, "poles"])


def test_an_analysis_that_reads_no_samples_is_not_repeated_in_a_resumed_run(tmp_path):
    """A run that is interrupted and resumed calls an analysis without samples only once.

    `SampleFreeAnalysis` counts its calls. The run is interrupted after two blocks of
    samples. The resumed run must still have the three rows, the finding "third" and the
    remark "Three." that the analysis returned in the first part.
    """

    def interrupt_after_eight_samples(done, total):
        if done == 8:
            raise KeyboardInterrupt

    mechanism = sk.load("four_bar")
    SampleFreeAnalysis.calls.clear()
    analyses = [SampleFreeAnalysis(), "poles"]
    options = {"samples": 25, "block": 4, "folder": tmp_path}
    with pytest.raises(KeyboardInterrupt):
        sk.run(mechanism, analyses, **options, progress=interrupt_after_eight_samples)
    result = sk.run(mechanism, analyses, **options, unfinished="resume")
    assert SampleFreeAnalysis.calls == [0]  # one call, with a batch from sample 0 on
    assert len(result.frame("apart")) == 3
    assert result.summary["remarks"] == ["apart: Three."]
    assert result.summary["analyses"][0]["findings"] == {"third": 3.0}
