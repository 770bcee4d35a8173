"""Runs of simulations: which solution their rows are of, and what is told meanwhile."""

import numpy as np

import spherekit as sk
from spherekit import progress
from spherekit.dynamics import forward

START = sk.Start(q=0.3, dq=1.0)
COUNT = 801


def simulated(engine, **given):
    asked = {"start": START, "duration": 20.0, "samples": COUNT, "engine": engine, **given}
    return sk.run("four_bar", "eksergian", **asked)


def test_rows_are_those_of_the_engine_that_ends(monkeypatch):
    monkeypatch.setattr(forward, "compiling_time", lambda *_: 1e-3)
    result = simulated("auto")
    assert result.summary["simulation"]["engine"]["name"] == "compiled"
    for name in ("motion", "eksergian"):
        assert result.frame(name).equals(simulated("compiled").frame(name))


def test_rows_are_those_of_the_tighter_run_where_a_tolerance_is_missed(monkeypatch):
    difference, asked = forward._difference, []

    def missed(one, other):
        asked.append(one)
        return 1.0 if len(asked) == 1 else difference(one, other)

    monkeypatch.setattr(forward, "_difference", missed)
    frame = simulated("numpy", duration=2.0).frame("motion")
    t = frame["t"].to_numpy()
    tight = sk.simulate("four_bar", START, 2.0, engine="numpy", tolerance=1e-11).at(t)
    loose = sk.simulate("four_bar", START, 2.0, engine="numpy").at(t)
    q = frame["theta_21"]
    assert np.max(np.abs(tight.q - q)) < 1e-14 < np.max(np.abs(loose.q - q))


def test_a_long_simulation_tells_how_far_it_is(monkeypatch):
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    said = []
    with progress.progress_listener(said.append):
        simulated("numpy", duration=2.0)
    far = [float(text.split()[1]) for text in said if text.startswith("simulating: ")]
    assert len(far) > 5 and far[0] < 0.5 and 2.0 in far
    assert all(text.endswith(" of 2 s") for text in said if text.startswith("simulating"))
