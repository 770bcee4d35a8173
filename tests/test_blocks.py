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

COURSES = {
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
def test_blocks_go_on_where_the_one_before_ended(size):
    """Over gaps too, and through JSON; with one input, and along a path of several."""
    way = np.linspace(0.0, 1.0, 40)[:, None] * np.array([0.9, 0.7])
    for tracer in (many_turns(), PositionAnalysis(sk.load("five_bar"), path=way)):

        def gaps(motion):
            values = motion.values.copy()
            values[motion.sample % 5 == 3] = np.nan
            return replace(motion, values=values)

        names, modes = list(tracer.mechanism.angles), len(tracer.assembly_modes)
        whole = continue_angles(gaps(tracer.motion()), names, tracer.angle_unwrapping, {})
        memory, parts = {}, []
        for motion in tracer.blocks(size):
            found = continue_angles(gaps(motion), names, tracer.angle_unwrapping, memory)
            parts.append({name: own.reshape(modes, -1) for name, own in found.items()})
            memory = json.loads(json.dumps(memory))
        for name in names:
            joined = np.concatenate([part[name] for part in parts], axis=1)
            here = joined.ravel(), whole[name]
            assert np.allclose(*here, rtol=0.0, atol=1e-12, equal_nan=True)


def test_inputs_are_as_given_and_grids_go_on_as_paths():
    tracer = many_turns()
    motion = tracer.motion()
    found = continue_angles(motion, ["21"], tracer.angle_unwrapping, {})["21"]
    assert np.array_equal(found, motion.q) and np.min(found) == -25.0
    low = replace(
        five := sk.load("five_bar"),
        inputs=tuple(
            replace(item, start=0.7, stop=stop)
            for item, stop in zip(five.inputs, (1.1, 2.4), strict=True)
        ),
    )
    grid = PositionAnalysis(low, samples=(3, 4), grid=True)
    names = sorted(set(grid.mechanism.angles) - set(grid.inputs))
    motion = grid.motion()
    found = continue_angles(motion, names, grid.angle_unwrapping, {})
    way = np.linspace([0.7, 0.7], [1.1, 2.4], 400)
    fine = PositionAnalysis(low, path=way).motion()
    for name in names:
        column = fine.values[:, fine.mechanism.angles[name]].reshape(2, -1)
        grown = np.ptp(np.unwrap(column, axis=1)[:, [0, -1]], axis=1)
        ends = found[name].reshape(2, -1)[:, [0, -1]]
        assert np.max(np.abs(np.ptp(ends, axis=1) - grown)) < 1e-9


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
@pytest.mark.parametrize("course", COURSES)
def test_eksergian_in_blocks_and_at_once(course):
    """Up to the rounding of a motion evaluated in other blocks."""
    made = four_bar_with_springs("21", "32", "43")
    whole, blocks = (
        sk.run(made, "eksergian", **COURSES[course], block=block) for block in (None, 7)
    )
    assert blocks.summary["samples_in_a_block"] == 7 < whole.summary["samples"]
    for name in ("motion", "eksergian"):
        one, other = data_of(whole, name), data_of(blocks, name)
        for table, columns in one.items():
            for column, values in columns.items():
                if values.dtype.kind != "f":
                    assert np.array_equal(values, other[table][column])
                    continue
                # With loads the torque is a difference of larger ones.
                scale = columns["Q"] if column == "tau" else values
                size = np.nanmax(np.abs(scale), initial=0.0)
                off = np.abs(values - other[table][column])
                assert np.nanmax(off, initial=0.0) <= 2e-14 * max(size, 1.0), column
    first, second = (each.summary["analyses"][0]["findings"] for each in (whole, blocks))
    assert first["largest_conditioning"] == pytest.approx(
        second["largest_conditioning"], rel=1e-12
    )
    places = [(each["at_assembly_mode"], each["at_q_rad"]) for each in (first, second)]
    assert places[0][0] == places[1][0]
    assert places[0][1] == pytest.approx(places[1][1], abs=1e-14)


def test_a_portrait_has_one_frame_whatever_the_blocks():
    listener = SceneListener()
    how = {**COURSES["loads"], "block": 50, "recorder": listener}
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
    """Says how many rows it saw, or something that differs from block to block."""

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
    made = sk.load("four_bar")
    result = sk.run(made, Counting(), samples=25, block=4)
    assert result.summary["analyses"][0]["findings"] == {"rows": 50}
    result = sk.run(made, [Counting(joins=False), "poles"], samples=25, block=5)
    assert result.summary["analyses"][0]["findings"] == {"rows": 10}
    result = sk.run(made, [Counting(joins=False), "poles"], samples=25, block=4)
    assert "define joined()" in result.failures["counting"]
    reached = result.summary["errors_reached"]["largest_closure_residual_rad"]
    assert reached == result.frame("motion")["residual"].max()
    assert len(result.frame("poles")) == 25 * 2 * 6


@final
@dataclass(frozen=True, kw_only=True)
class Apart(MinimalAnalysis):
    """Reads no samples, and shows four rows of its own."""

    name: ClassVar = "apart"
    reads_samples: ClassVar = False
    tables: ClassVar = (Table("apart", "", (Column("x", "", ""),)),)
    calls: ClassVar = []

    def compute(self, batch):
        self.calls.append(batch.sample[0])
        return {"apart": {"x": np.arange(3.0)}}

    def findings(self, batch):
        return Findings({"third": 3.0}, (), ("Three.",))

    def scene(self, batch):
        return (Scene("Apart", (Series("s", "s", "g", np.arange(4.0)),), (OWN,)),)


OWN = Axis("row", "", np.arange(4.0))


def test_what_reads_no_samples_is_asked_once(tmp_path):
    made, pages = sk.load("four_bar"), SceneListener()
    Apart.calls.clear()
    result = sk.run(made, [Apart(), "poles"], samples=25, block=4, recorder=pages)
    assert Apart.calls == [0] and result.summary["samples_in_a_block"] == 4
    assert result.frame("apart")["x"].tolist() == [0.0, 1.0, 2.0]
    own = [each for each in pages.logged if isinstance(each[0], str)]
    logged = {page: rest for page, *rest in own}
    assert len(own) == len(logged) and set(logged) == {"Apart", "Construction"}
    samples, inputs, times = logged["Apart"]
    assert (samples, times) == ([0, 1, 2, 3], None)
    assert np.allclose(inputs, np.arange(4) * np.pi / 2.0)
    timed = SceneListener()
    sk.run(made, Apart(), samples=25, block=4, duration=2.0, recorder=timed)
    (own,) = (each for each in timed.logged if isinstance(each[0], str))
    assert own[2] is None and own[3].tolist() == [0.0, 0.5, 1.0, 1.5]


def test_nothing_is_traced_for_what_reads_no_samples(tmp_path, monkeypatch):
    """No mode is looked for, no sample followed, and no table of a motion written."""

    def followed(*given, **named):
        raise AssertionError("a motion was traced")

    monkeypatch.setattr("spherekit.positions.position_analysis.ModeSearch", followed)
    made = sk.load("two_dof_spm")
    for request in (
        "inverse_kinematics:poses=21=14+61=23",
        "workspace:working_mode=0,tolerance=0.1",
        "equivalent_rotation:start=phi=75+gamma=-20,end=phi=70+gamma=20,samples=3",
    ):
        result = sk.run(made, request)
        assert not result.failures and not result.results["motion"].tables
        assert result.summary["assembly_modes"] == [] and result.summary["remarks"]
    with pytest.raises(AssertionError, match="was traced"):
        sk.run(made, ["inverse_kinematics:poses=21=14+61=23", "poles"])


def test_it_is_not_asked_again_when_a_run_goes_on(tmp_path):
    def stop(done, total):
        if done == 8:
            raise KeyboardInterrupt

    made = sk.load("four_bar")
    Apart.calls.clear()
    words = {"samples": 25, "block": 4, "folder": tmp_path}
    with pytest.raises(KeyboardInterrupt):
        sk.run(made, [Apart(), "poles"], **words, progress=stop)
    result = sk.run(made, [Apart(), "poles"], **words, unfinished="resume")
    assert Apart.calls == [0]
    assert len(result.frame("apart")) == 3
    assert result.summary["remarks"] == ["apart: Three."]
    assert result.summary["analyses"][0]["findings"] == {"third": 3.0}
