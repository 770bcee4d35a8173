"""A simulation hands over its rows while it is solved: order of events, and same rows."""

import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np

import spherekit as sk
from spherekit import progress
from spherekit.analysis.result import MOTION
from spherekit.analysis.scene import Portrait
from spherekit.dynamics import forward
from spherekit.dynamics.numpy_engine import Collocation
from spherekit.model.dynamics import JointLimit
from spherekit.view.rerun_view import RerunRecorder

START, LONG = sk.Start(q=0.3, dq=1.0), 20.0
COUNT = 801


class Order:
    """Notes steps of the solver and rows of a recorder in the order in which they come."""

    def __init__(self, monkeypatch, at_step=lambda t: None):
        self.events, self.samples, self.portraits = [], [], []
        advance = Collocation.advance

        def noted(solver):
            goes_on = advance(solver)
            self.events.append(("step", solver.reached))
            at_step(solver.reached)
            return goes_on

        monkeypatch.setattr(Collocation, "advance", noted)

    def start(self, head):
        self.times = head.times

    def log(self, scene, samples, inputs=None, times=None):
        if scene.page == 0 and scene.source == MOTION:
            self.events.append(("rows", float(times[-1])))
            self.samples += samples.tolist()
        self.portraits += [p for p in scene.primitives if isinstance(p, Portrait)]

    def before(self, what):
        """The number of events before the first of a kind."""
        return next(k for k, (kind, _) in enumerate(self.events) if kind == what)


def simulated(engine, **given):
    asked = {"start": START, "duration": LONG, "samples": COUNT, "engine": engine, **given}
    return sk.run("four_bar", "eksergian", **asked)


def test_rows_come_while_the_solver_goes_on(monkeypatch):
    order = Order(monkeypatch)
    result = simulated("numpy", recorder=order)
    steps = [t for kind, t in order.events[: order.before("rows")] if kind == "step"]
    assert max(steps) < 0.01 * LONG
    first_run = order.events[: order.events.index(("step", LONG))]
    came = [t for kind, t in first_run if kind == "rows"]
    assert len(came) > 8 and np.max(np.diff([0.0, *came, LONG])) < 0.25 * LONG
    reached = 0.0
    for kind, t in first_run:  # no row is sent before it is solved
        reached = t if kind == "step" else reached
        assert kind == "step" or t < reached
    assert order.samples == list(range(COUNT))
    assert len(order.times) == COUNT
    frame = result.frame("motion")
    at = sk.simulate("four_bar", START, LONG, engine="numpy").at(frame["t"].to_numpy())
    assert np.max(np.abs(at.q - frame["theta_21"])) < 1e-14
    whole = {p.path: (p.x_range, p.y_range) for p in order.portraits}
    assert all((p.x_range, p.y_range) == whole[p.path] for p in order.portraits)
    assert sum(len(p.x) for p in order.portraits if p.path in list(whole)[:1]) == COUNT


def test_rows_reach_the_disk_before_the_end(monkeypatch, tmp_path):
    sizes = []

    def look(t):
        parts = tmp_path.glob(".spherekit-run/*.parquet")
        sizes.append(sum(part.stat().st_size for part in parts))

    Order(monkeypatch, look)
    simulated("numpy", folder=tmp_path)
    during = sizes[: len(sizes) // 2]  # the other half are steps of the check
    assert len(set(during)) > 8 and during[len(during) // 2] > 0.1 * sizes[-1]


def test_another_engine_supersedes_what_numpy_began(monkeypatch):
    monkeypatch.setattr(forward, "compiling_time", lambda *_: 1e-3)
    order = Order(monkeypatch)
    result = simulated("auto", recorder=order)
    assert order.events[0][0] == "step"  # NumPy began
    assert result.summary["simulation"]["engine"]["name"] == "compiled"
    assert order.samples == list(range(COUNT))  # none is sent twice
    for name in ("motion", "eksergian"):
        assert result.frame(name).equals(simulated("compiled").frame(name))


def test_a_run_that_misses_its_tolerance_is_taken_back(monkeypatch, tmp_path):
    difference, asked = forward._difference, []

    def missed(one, other):
        asked.append(one)
        return 1.0 if len(asked) == 1 else difference(one, other)

    monkeypatch.setattr(forward, "_difference", missed)
    order = Order(monkeypatch)
    result = simulated("numpy", recorder=order, folder=tmp_path, duration=2.0)
    assert order.samples == [*range(COUNT), *range(COUNT)]
    frame = result.frame("motion")
    t = frame["t"].to_numpy()
    tight = sk.simulate("four_bar", START, 2.0, engine="numpy", tolerance=1e-11).at(t)
    loose = sk.simulate("four_bar", START, 2.0, engine="numpy").at(t)
    q = frame["theta_21"]
    assert np.max(np.abs(tight.q - q)) < 1e-14 < np.max(np.abs(loose.q - q))


def test_a_simulation_that_ends_early_has_its_end_as_the_last_row(monkeypatch):
    monkeypatch.setattr(forward, "compiling_time", lambda *_: 1e9)
    stopped = replace(sk.load("four_bar"), joint_limits=(JointLimit("21", -10.0, 0.35),))
    order = Order(monkeypatch)
    result = sk.run(
        stopped, "poles", start=START, duration=LONG, samples=COUNT, recorder=order
    )
    end = result.summary["simulation"]["end"]
    assert end["kind"] == "joint_limit" and end["t"] < LONG
    frame = result.frame("motion")
    assert frame["t"].iloc[-1] == end["t"]
    assert order.samples == frame["sample"].tolist()


def test_a_long_simulation_tells_how_far_it_is(monkeypatch):
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    said = []
    with progress.progress_listener(said.append):
        simulated("numpy", duration=2.0)
    far = [float(text.split()[1]) for text in said if text.startswith("simulating: ")]
    assert len(far) > 5 and far[0] < 0.5 and 2.0 in far
    assert all(text.endswith(" of 2 s") for text in said if text.startswith("simulating"))


def test_a_connected_viewer_has_rows_before_the_simulation_is_over(monkeypatch, tmp_path):
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        port = found.getsockname()[1]
    received = tmp_path / "received.rrd"
    words = ["-m", "rerun_cli", "--save", str(received), "--port", str(port)]
    server = subprocess.Popen(
        [sys.executable, *words], stderr=subprocess.DEVNULL, start_new_session=True
    )
    held = []

    def wait(t):
        """Hold the solver half way until what was sent so far has arrived."""
        if t > 0.5 * LONG and not held:
            held.append(until(lambda: received.stat().st_size > 100_000))

    try:
        assert until(lambda: socket.create_connection(("127.0.0.1", port), 1.0))
        Order(monkeypatch, wait)
        url = f"rerun+http://127.0.0.1:{port}/proxy"
        with RerunRecorder("four_bar", url=url) as recorder:
            simulated("numpy", recorder=recorder)
    finally:
        os.killpg(server.pid, signal.SIGTERM)  # the program behind it too
        server.wait()
    assert held == [True]


def until(holds, limit=60.0):
    """Whether something holds after some time."""
    end = time.monotonic() + limit
    while time.monotonic() < end:
        try:
            if holds():
                return True
        except OSError:
            pass
        time.sleep(0.05)
    return False
