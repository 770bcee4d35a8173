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


def pickle_round_trip(value):
    """Return a value as another process receives it: pickled and read back."""
    return pickle.loads(pickle.dumps(value))


@pytest.mark.parametrize("name", PUBLIC)
def test_a_pickle_of_a_public_name_gives_the_same_object(name):
    """Process pools can therefore be given every public function and class."""
    assert pickle_round_trip(getattr(sk, name)) is getattr(sk, name)


def assert_frames_are_equal(frame, expected):
    """Fail unless two pandas tables are equal bit by bit."""
    pd.testing.assert_frame_equal(frame, expected, check_exact=True)


@pytest.mark.slow
def test_runs_in_another_process_give_the_tables_of_runs_in_this_one(tmp_path):
    """Runs of two four-bars in a spawned process return the same tables, bit by bit.

    Plots and recordings can be created from the results that came back.
    """
    crank_arcs_deg = (15.0, 25.0)
    mechanisms = [
        sk.load("four_bar").with_sizes(angle_unit="deg", arcs={"2": arc})
        for arc in crank_arcs_deg
    ]
    analyses = ["poles", "singularities"]
    run = partial(sk.run, samples=61)
    # A spawned process shares no memory with this one: everything passes through pickles.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context) as pool:
        pool_results = list(pool.map(run, mechanisms, [analyses] * len(mechanisms)))

    for mechanism, pool_result in zip(mechanisms, pool_results, strict=True):
        expected = run(mechanism, analyses)
        for name, analysis in expected.results.items():
            for table in analysis.tables:
                assert_frames_are_equal(
                    pool_result.frame(name, table.name), expected.frame(name, table.name)
                )
        assert pool_result.summary["units"] == expected.summary["units"]

    assert pool_results[0].plot("velocity coefficients").axes
    recording = pool_results[0].save(tmp_path / "a.rrd")
    assert recording.stat().st_size > 10_000


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
def test_the_result_of_a_run_is_equal_after_a_pickle(name, tmp_path, monkeypatch):
    """It is so even where the receiving process has another working folder."""
    monkeypatch.chdir(tmp_path)
    result = RUNS[name]("out")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    copy = pickle_round_trip(result)
    assert repr(copy) == repr(result)
    assert copy.failures == result.failures
    assert copy.summary == result.summary
    if name != "no tables":
        for analysis in set(result.results) - set(result.failures):
            assert_frames_are_equal(copy.frame(analysis), result.frame(analysis))


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
QUESTIONS = {
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
"""What is computed from an object before and after its pickle."""


@pytest.mark.parametrize("name", OBJECTS)
def test_an_object_computes_the_same_after_a_pickle(name):
    """The numbers that `QUESTIONS` computes from it are equal bit by bit."""
    original = OBJECTS[name]()
    copy = pickle_round_trip(original)
    assert type(copy) is type(original)
    if name in QUESTIONS:
        compute = QUESTIONS[name]
        # The table of a plan holds texts, which cannot be compared as numbers with NaN.
        has_numbers = name != "plan"
        assert np.array_equal(compute(copy), compute(original), equal_nan=has_numbers)


@pytest.mark.parametrize("tables", [False, True])
def test_a_pickled_sweep_without_a_folder_carries_its_tables(tables):
    """The pickle of a sweep without a folder contains its tables.

    Such a sweep writes its files to a temporary store, which is deleted together with the
    result. The pickle contains the rows themselves. The copy has a store of its own, which
    is deleted with the copy.
    """
    result = sk.sweep(
        "four_bar",
        {"links.2.arc": [20.0, 30.0]},
        "max(q)",
        analyses=["poles"],
        tables=tables,
        samples=3,
    )
    expected_rows = result.frame()
    expected_poles = result.table("poles") if tables else None
    pickled = pickle.dumps(result)
    store = result._store
    del result
    assert not store.exists()

    copy = pickle.loads(pickled)
    assert_frames_are_equal(copy.frame(), expected_rows)
    if tables:
        assert_frames_are_equal(copy.table("poles"), expected_poles)
    store = copy._store
    del copy
    assert not store.exists()
