"""What users call and what they get goes from one process to another."""

import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
import pandas as pd
import pytest

import spherekit as sk

PUBLIC = [name for name in dir(sk) if not name.startswith("_")]
START = sk.Start(q=0.3, dq=1.0)
TWO_STARTS = sk.Start(q=(1.0, 1.2), dq=(0.3, 0.2))


def compiled_simulation(name, start):
    pytest.importorskip("heyoka")
    return sk.simulate(name, start, 0.1, engine="compiled")


def again(value):
    return pickle.loads(pickle.dumps(value))


@pytest.mark.parametrize("name", PUBLIC)
def test_public_names_are_found_by_pickles(name):
    """So that pools of processes can be given them."""
    assert again(getattr(sk, name)) is getattr(sk, name)


def same(one, other):
    pd.testing.assert_frame_equal(one, other, check_exact=True)


@pytest.mark.slow
def test_runs_in_a_pool_are_those_of_this_process(tmp_path):
    """Tables, summary, failures, figures and recordings."""
    mechanisms = [
        sk.load("four_bar").with_sizes(angle_unit="deg", arcs={"2": arc})
        for arc in (15.0, 25.0)
    ]
    analyses = [["poles", "singularities"]] * len(mechanisms)
    context = multiprocessing.get_context("spawn")
    run = partial(sk.run, samples=61)
    with ProcessPoolExecutor(1, context) as pool:
        found = list(pool.map(run, mechanisms, analyses))
    for mechanism, result in zip(mechanisms, found, strict=True):
        here = run(mechanism, ["poles", "singularities"])
        for name, analysis in here.results.items():
            for table in analysis.tables:
                same(result.frame(name, table.name), here.frame(name, table.name))
        assert result.summary["units"] == here.summary["units"]
    assert found[0].plot("velocity coefficients").axes
    assert found[0].save(tmp_path / "a.rrd").stat().st_size > 10_000


RUNS = {
    "memory": lambda folder: sk.run("four_bar", "poles", samples=5),
    "folder": lambda folder: sk.run("four_bar", "poles", samples=5, folder=folder),
    "simulation": lambda folder: sk.run("four_bar", "eksergian", start=START, duration=0.2),
    "grid": lambda folder: sk.run("five_bar", "poles", samples=(3, 3)),
    "no tables": lambda folder: sk.run("four_bar", "poles", samples=3, tables=False),
    "degrees": lambda folder: sk.run(
        "four_bar", "poles", samples=3, folder=folder, degrees=True
    ),
}


@pytest.mark.parametrize("name", RUNS)
def test_results_of_runs(name, tmp_path, monkeypatch):
    """Also where the other process stands in another folder."""
    monkeypatch.chdir(tmp_path)
    result = RUNS[name]("out")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    other = again(result)
    assert repr(other) == repr(result) and other.failures == result.failures
    assert other.summary == result.summary
    if name != "no tables":
        for analysis in set(result.results) - set(result.failures):
            same(other.frame(analysis), result.frame(analysis))


OBJECTS = {
    "mechanism": lambda: sk.load("four_bar"),
    "study": lambda: sk.load_study("four_bar"),
    "plan": lambda: sk.plan("four_bar"),
    "kinematics": lambda: sk.evaluate("four_bar", 0.7, assembly_mode=0),
    "motion": lambda: sk.trace("four_bar", samples=9),
    "motion over a grid": lambda: sk.trace("five_bar", samples=(3, 3)),
    "simulation": lambda: sk.simulate("four_bar", START, 0.3),
    "simulation by numpy": lambda: sk.simulate("four_bar", START, 0.3, engine="numpy"),
    "compiled simulation": lambda: compiled_simulation("four_bar", START),
    "compiled with two inputs": lambda: compiled_simulation("five_bar", TWO_STARTS),
    "reduced model": lambda: sk.reduced_model(sk.load("four_bar")),
    "coupling": lambda: sk.coupling_table(sk.load("four_bar")),
    "inverse": lambda: sk.InverseKinematics(sk.load("agile_eye")),
    "forward": lambda: sk.ForwardKinematics(sk.load("agile_eye")),
}
ASKED = {
    "plan": sk.table,
    "kinematics": lambda x: x.velocity_coefficient("4/1"),
    "motion": lambda x: x.values,
    "motion over a grid": lambda x: x.values,
    "simulation": lambda x: x.at(np.linspace(0.0, 0.3, 5)).q,
    "simulation by numpy": lambda x: x.at(np.linspace(0.0, 0.3, 5)).q,
    "compiled simulation": lambda x: x.at(np.linspace(0.0, 0.1, 5)).ddq,
    "compiled with two inputs": lambda x: x.at(np.linspace(0.0, 0.1, 5)).inputs,
    "reduced model": lambda x: x.torque(0.3, 1.0, 0.2, 0.1),
}


@pytest.mark.parametrize("name", OBJECTS)
def test_other_objects(name):
    """They answer as before, bit by bit."""
    here = OBJECTS[name]()
    other = again(here)
    assert type(other) is type(here)
    if ask := ASKED.get(name):
        assert np.array_equal(ask(other), ask(here), equal_nan=name != "plan")


@pytest.mark.parametrize("tables", [False, True])
def test_a_sweep_without_a_folder_brings_its_rows(tables):
    """Its files are those of the process that made them, and go with its result."""
    how = {"analyses": ["poles"], "tables": tables, "samples": 3}
    found = sk.sweep("four_bar", {"links.2.arc": [20.0, 30.0]}, "max(q)", **how)
    rows, poles = found.frame(), found.table("poles") if tables else None
    pickled = pickle.dumps(found)
    store = found._store
    del found
    assert not store.exists()
    other = pickle.loads(pickled)
    same(other.frame(), rows)
    if tables:
        same(other.table("poles"), poles)
    store = other._store
    del other
    assert not store.exists()
