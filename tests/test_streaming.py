"""Runs of simulations: which solution their rows are of, and what is told meanwhile."""

import numpy as np
import pytest

import spherekit as sk
from spherekit import progress
from spherekit.dynamics import forward_dynamics
from spherekit.dynamics.numpy_engine import Collocation
from spherekit.geometry.rotation import quaternion
from spherekit.runs.run_result import MOTION

START = sk.Start(q=0.3, dq=1.0)
COUNT = 801


def simulated(engine, **given):
    asked = {"start": START, "duration": 20.0, "samples": COUNT, "engine": engine, **given}
    return sk.run("four_bar", "eksergian", **asked)


def test_rows_are_those_of_the_engine_that_ends(monkeypatch):
    monkeypatch.setattr(forward_dynamics, "estimate_compile_seconds", lambda *_: 1e-3)
    result = simulated("auto")
    assert result.summary["simulation"]["engine"]["name"] == "compiled"
    for name in ("motion", "eksergian"):
        assert result.frame(name).equals(simulated("compiled").frame(name))


def test_rows_are_those_of_the_tighter_run_where_a_tolerance_is_missed(monkeypatch):
    difference, asked = forward_dynamics._largest_difference, []

    def missed(one, other):
        asked.append(one)
        return 1.0 if len(asked) == 1 else difference(one, other)

    monkeypatch.setattr(forward_dynamics, "_largest_difference", missed)
    frame = simulated("numpy", duration=2.0).frame("motion")
    t = frame["t"].to_numpy()
    tight = sk.simulate("four_bar", START, 2.0, engine="numpy", tolerance=1e-11).at(t)
    loose = sk.simulate("four_bar", START, 2.0, engine="numpy").at(t)
    q = frame["theta_21"]
    assert np.max(np.abs(tight.q - q)) < 1e-14 < np.max(np.abs(loose.q - q))


def test_a_long_simulation_tells_how_far_it_is(monkeypatch):
    monkeypatch.setattr(progress, "REPORT_INTERVAL_S", 0.0)
    said = []
    with progress.progress_listener(said.append):
        simulated("numpy", duration=2.0)
    far = [float(text.split()[1]) for text in said if text.startswith("simulating: ")]
    assert len(far) > 5 and far[0] < 0.5 and 2.0 in far
    assert all(text.endswith(" of 2 s") for text in said if text.startswith("simulating"))


class Order:
    """Notes steps of the solver and links of a recorder in the order in which they come."""

    def __init__(self, monkeypatch):
        self.events, self.last = [], {}
        advance = Collocation.advance

        def noted(solver):
            goes_on = advance(solver)
            self.events.append(("step", solver.reached))
            return goes_on

        monkeypatch.setattr(Collocation, "advance", noted)

    def start(self, head):
        self.times = head.times

    def log(self, scene, samples, inputs=None, times=None):
        if scene.page == 0 and scene.source == MOTION:
            self.events.append(("rows", float(times[-1])))
            rows = zip(times, scene.primitives[0].quaternions, strict=True)
            self.last |= dict(zip(samples.tolist(), rows, strict=True))


@pytest.mark.slow
def test_links_are_logged_while_a_simulation_is_solved(monkeypatch):
    monkeypatch.setattr(progress, "REPORT_INTERVAL_S", 0.0)
    order = Order(monkeypatch)
    result = simulated("numpy", duration=2.0, recorder=order)
    first_run = order.events[: order.events.index(("step", 2.0))]
    came = [t for kind, t in first_run if kind == "rows"]
    assert len(came) > 5 and came == sorted(set(came)) and came[0] < 0.5 < 1.5 < came[-1]
    t = result.frame("motion")["t"].to_numpy()
    assert np.array_equal(order.times, t) and list(order.last) == list(range(COUNT))
    motion = sk.simulate("four_bar", START, 2.0, engine="numpy").at(t)
    logged, turned = zip(*order.last.values(), strict=True)
    assert np.array_equal(logged, t)
    assert np.max(np.abs(np.array(turned) - quaternion(motion.rotations[:, 1]))) < 1e-9
    some = Order(monkeypatch)
    simulated("numpy", duration=2.0, recorder=some, log_every=300)
    assert list(some.last) == [0, 300, 600, COUNT - 1]


def test_what_is_refused_for_unfinished_work_is_not_recorded(monkeypatch, tmp_path):
    order = Order(monkeypatch)

    def stopped(scene, samples, inputs=None, times=None):
        if samples[0] >= COUNT // 2:
            raise KeyboardInterrupt

    asked = {"folder": tmp_path, "block": 50, "duration": 2.0}
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(order, "log", stopped)
        simulated("numpy", recorder=order, **asked)
    monkeypatch.setattr(progress, "REPORT_INTERVAL_S", 0.0)
    again = Order(monkeypatch)
    with pytest.raises(sk.SpherekitError, match="--resume"):
        simulated("numpy", recorder=again, **asked)
    assert {kind for kind, _ in again.events} == {"step"} and not hasattr(again, "times")
