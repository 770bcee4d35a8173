"""Runs of simulations: which solution has their rows, and what is reported meanwhile."""

import numpy as np
import pytest

import spherekit as sk
from spherekit import progress
from spherekit.dynamics import forward_dynamics
from spherekit.dynamics.numpy_engine import Collocation
from spherekit.geometry.rotation import quaternion
from spherekit.runs.run_result import MOTION

START = sk.Start(q=0.3, dq=1.0)
SAMPLES = 801


def run_simulation(engine, duration=20.0, **options):
    """Return a run of the four-bar with 801 times, simulated by an engine for some s."""
    return sk.run(
        "four_bar",
        "eksergian",
        start=START,
        duration=duration,
        samples=SAMPLES,
        engine=engine,
        **options,
    )


def test_rows_come_from_the_engine_that_ends(monkeypatch):
    """Of both engines at work, that is the compiled one if compiling takes 1 ms only."""
    monkeypatch.setattr(forward_dynamics, "estimate_compile_seconds", lambda *_: 1e-3)
    result = run_simulation("auto")
    assert result.summary["simulation"]["engine"]["name"] == "compiled"
    compiled = run_simulation("compiled")
    for name in ("motion", "eksergian"):
        assert result.frame(name).equals(compiled.frame(name))


def test_rows_come_from_a_tighter_simulation_where_the_tolerance_is_missed(monkeypatch):
    """A run checks its simulation by a more accurate one, and takes that if both differ.

    The default tolerance is 1e-9 rad; the more accurate simulation has 1e-11. Here the
    comparison is replaced by one that says that both differ by 1 rad. The rows must then
    agree with a simulation of 1e-11 to rounding, and not with one of the default tolerance.
    """
    largest_difference = forward_dynamics._largest_difference
    calls = []

    def miss_once(first, second):
        calls.append(first)
        return 1.0 if len(calls) == 1 else largest_difference(first, second)

    monkeypatch.setattr(forward_dynamics, "_largest_difference", miss_once)
    frame = run_simulation("numpy", duration=2.0).frame("motion")
    t = frame["t"].to_numpy()
    q = frame["theta_21"]
    tight = sk.simulate("four_bar", START, 2.0, engine="numpy", tolerance=1e-11).at(t)
    loose = sk.simulate("four_bar", START, 2.0, engine="numpy").at(t)
    assert np.max(np.abs(tight.q - q)) < 1e-14
    assert np.max(np.abs(loose.q - q)) > 1e-14


def test_a_long_simulation_reports_the_time_that_it_has_reached(monkeypatch):
    """With no pause between reports: several of them, from the start to the end."""
    monkeypatch.setattr(progress, "REPORT_INTERVAL_S", 0.0)
    messages = []
    with progress.progress_listener(messages.append):
        run_simulation("numpy", duration=2.0)
    reports = [message for message in messages if message.activity == "simulating"]
    assert all(report.state.endswith(" of 2 s") for report in reports)
    reached_s = [float(report.state.split()[0]) for report in reports]
    assert len(reached_s) > 5
    assert reached_s[0] < 0.5
    assert 2.0 in reached_s


class EventRecorder:
    """Recorder for tests that notes both steps of a simulation and rows given to it.

    From the order of these events tests see whether rows are recorded while the simulation
    goes on.

    Attributes
    ----------
    events
        Pairs ("step", time reached in s) and ("rows", last time of the rows in s).
    times
        Times (s) of all samples, once a recording is started.
    row_by_sample
        The time and the quaternions of the links last logged for each sample.
    """

    def __init__(self, monkeypatch):
        """Replace the solver's `advance` by one that notes each step."""
        self.events = []
        self.row_by_sample = {}
        advance = Collocation.advance

        def advance_and_note(solver):
            goes_on = advance(solver)
            self.events.append(("step", solver.reached))
            return goes_on

        monkeypatch.setattr(Collocation, "advance", advance_and_note)

    def start(self, head):
        """Store the times of all samples."""
        self.times = head.times

    def log(self, scene, samples, inputs=None, times=None):
        """Note rows of the motion of assembly mode 0; other scenes are left out.

        The source `MOTION` means that a scene shows the motion, not results of an analysis.
        """
        if scene.page == 0 and scene.source == MOTION:
            self.events.append(("rows", float(times[-1])))
            rows = zip(times, scene.primitives[0].quaternions, strict=True)
            self.row_by_sample |= dict(zip(samples.tolist(), rows, strict=True))


@pytest.mark.slow
def test_links_are_recorded_while_a_simulation_is_solved(monkeypatch):
    """Rows are logged before the solver reaches the end, in the order of time."""
    monkeypatch.setattr(progress, "REPORT_INTERVAL_S", 0.0)
    recorder = EventRecorder(monkeypatch)
    run_simulation("numpy", duration=2.0, recorder=recorder)
    events_before_end = recorder.events[: recorder.events.index(("step", 2.0))]
    row_times = [t for kind, t in events_before_end if kind == "rows"]
    assert len(row_times) > 5
    assert row_times == sorted(set(row_times))
    assert row_times[0] < 0.5
    assert row_times[-1] > 1.5


@pytest.mark.slow
def test_the_recording_of_a_simulation_ends_with_the_rows_of_its_solution(monkeypatch):
    """Rows recorded meanwhile are replaced; quaternions of the crank agree to 1e-9."""
    monkeypatch.setattr(progress, "REPORT_INTERVAL_S", 0.0)
    recorder = EventRecorder(monkeypatch)
    result = run_simulation("numpy", duration=2.0, recorder=recorder)
    t = result.frame("motion")["t"].to_numpy()
    assert np.array_equal(recorder.times, t)
    assert list(recorder.row_by_sample) == list(range(SAMPLES))
    row_times, quaternions = zip(*recorder.row_by_sample.values(), strict=True)
    assert np.array_equal(row_times, t)
    motion = sk.simulate("four_bar", START, 2.0, engine="numpy").at(t)
    first_moving_link = 1
    expected = quaternion(motion.rotations[:, first_moving_link])
    assert np.max(np.abs(np.array(quaternions) - expected)) < 1e-9


@pytest.mark.slow
def test_a_recording_of_some_samples_has_the_first_and_the_last(monkeypatch):
    monkeypatch.setattr(progress, "REPORT_INTERVAL_S", 0.0)
    recorder = EventRecorder(monkeypatch)
    run_simulation("numpy", duration=2.0, recorder=recorder, log_every=300)
    assert list(recorder.row_by_sample) == [0, 300, 600, SAMPLES - 1]


@pytest.mark.slow
def test_a_run_that_is_refused_because_of_unfinished_work_is_not_recorded(
    monkeypatch, tmp_path
):
    """A run that is refused because of unfinished work has not started a recording.

    The first run is interrupted half way, as by Ctrl-C. It leaves unfinished work in its
    folder. The second run has the same folder, but does not say what to do with this work.
    It is refused, but only after its simulation. `EventRecorder` notes the steps of a
    simulation, and the rows that are recorded. So here it has steps, but no rows.
    """
    interrupted = EventRecorder(monkeypatch)

    def interrupt_half_way(scene, samples, inputs=None, times=None):
        if samples[0] >= SAMPLES // 2:
            raise KeyboardInterrupt

    options = {"folder": tmp_path, "block": 50, "duration": 2.0}
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        # The recorder raises the error when it is given the middle rows.
        patched.setattr(interrupted, "log", interrupt_half_way)
        run_simulation("numpy", recorder=interrupted, **options)
    # Progress is reported after each step. A started recording would get rows then.
    monkeypatch.setattr(progress, "REPORT_INTERVAL_S", 0.0)
    refused = EventRecorder(monkeypatch)
    with pytest.raises(sk.SpherekitError, match="--resume"):
        run_simulation("numpy", recorder=refused, **options)
    assert {kind for kind, _ in refused.events} == {"step"}
    # The recorder gets the attribute `times` when a recording is started.
    assert not hasattr(refused, "times")
