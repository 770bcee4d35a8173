"""Sweeps by the workers of a Dask cluster, wherever these stand, and what they lose."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import spherekit as sk
from spherekit.designs import dask_cluster
from spherekit.errors import DesignError, OutputError
from spherekit.progress import progress_listener

pytest.importorskip("distributed")

VARY = {"links.2.arc": [float(x) for x in np.linspace(10.0, 40.0, 40)]}
"""Three parts, where each design is run."""

BLIND = """
import os

access = os.access
os.access = lambda path, mode: ".sweep-work" not in str(path) and access(path, mode)
"""
"""A worker that does not see the folders of sweeps."""

SLOW = """
import time
from spherekit.designs import sweep

write = sweep.Sweep.write_part


def write_slowly(self, folder, part):
    time.sleep(1.0)
    return write(self, folder, part)


sweep.Sweep.write_part = write_slowly
"""

ENDING = """
import os, signal
from spherekit.designs import sweep

write = sweep.Sweep.write_part


def write_or_end(self, folder, part):
    if part == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return write(self, folder, part)


sweep.Sweep.write_part = write_or_end
"""

LACKING = """
import sys

sys.modules["spherekit.designs.sweep"] = None
"""


def swept(folder, address=None, **options):
    how = {"analyses": ["poles"], "tables": True, "samples": 3, "workers": 1} | options
    return sk.sweep("four_bar", VARY, folder=folder, dask=address, **how)


@pytest.fixture(scope="module")
def undisturbed():
    """Return what a sweep gives in this process."""
    return swept(None)


@pytest.fixture(scope="module")
def wanted(undisturbed):
    """The rows when nothing disturbs a sweep."""
    return undisturbed.frame(), undisturbed.table("poles")


def same(found, wanted):
    """Say that a sweep has all rows, bit by bit."""
    for one, other in zip((found.frame(), found.table("poles")), wanted, strict=True):
        pd.testing.assert_frame_equal(one, other, check_exact=True)


class Machines:
    """A scheduler, and workers in folders of their own."""

    def __init__(self, root):
        self.root = root
        self.processes = []
        self.address = ""

    def start(self, words, site="", **environment):
        place = self.root / f"machine-{len(self.processes)}"
        (place / "site").mkdir(parents=True)
        (place / "site" / "sitecustomize.py").write_text(site)
        environment["PYTHONPATH"] = str(place / "site")
        process = subprocess.Popen(
            [sys.executable, "-m", *words],
            cwd=place,
            env=os.environ | environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        self.processes.append(process)
        return process

    def schedule(self, port=0, **environment):
        file = self.root / f"scheduler-{len(self.processes)}.json"
        words = ["distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--no-dashboard"]
        words += ["--port", str(port), "--scheduler-file", str(file)]
        process = self.start(words, **environment)
        while not (file.exists() and file.read_text().endswith("}")):
            assert process.poll() is None
            time.sleep(0.05)
        self.address = json.loads(file.read_text())["address"]
        return process

    def work(self, site="", threads=1, nanny=False):
        words = ["distributed.cli.dask_worker", self.address, "--no-dashboard"]
        words += ["--nthreads", str(threads), "--nanny" if nanny else "--no-nanny"]
        return self.start(words, site)

    def end(self):
        for process in self.processes:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.fixture
def machines(tmp_path):
    made = Machines(tmp_path / "machines")
    try:
        yield made
    finally:
        made.end()


@pytest.mark.slow
def test_threads_of_one_worker_make_the_same_rows(tmp_path, wanted):
    """Those of a cluster within this process, which share one sweep."""
    from dask.distributed import LocalCluster

    options = {"n_workers": 1, "threads_per_worker": 4, "dashboard_address": None}
    with LocalCluster(processes=False, **options) as local:
        found = swept(tmp_path, local.scheduler_address)
    assert found.computed == 3
    same(found, wanted)


@pytest.mark.slow
@pytest.mark.parametrize("site", ["", BLIND], ids=["seeing", "blind"])
def test_a_relative_folder_is_that_of_the_command(
    site, machines, tmp_path, wanted, monkeypatch
):
    """Workers stand elsewhere; those that do not see it send their parts."""
    machines.schedule()
    machines.work(site)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    found = swept("designs", machines.address)
    assert found.computed == 3 and found.folder == Path("designs")
    same(found, wanted)
    files = {path.name for path in Path("designs").iterdir()}
    assert files == {"designs", "tables", "_sweep.json", ".sweep.lock"}
    others = (tmp_path / "machines").rglob("part-*")
    assert not list(others)
    assert swept("designs").computed == 0


@pytest.mark.slow
def test_parts_of_seeing_and_blind_workers_are_one_data_set(machines, tmp_path, wanted):
    machines.schedule()
    machines.work(BLIND + SLOW)
    machines.work(SLOW)
    same(swept(tmp_path / "designs", machines.address), wanted)


class WorkerlessClient:
    """A client whose scheduler has no workers until some time (s) of a clock."""

    status = "running"

    def __init__(self, monkeypatch, until):
        self.now = 1000.0
        self.until = self.now + until
        monkeypatch.setattr(dask_cluster.time, "monotonic", lambda: self.now)
        monkeypatch.setattr(dask_cluster.time, "sleep", self.sleep)

    def sleep(self, seconds):
        self.now += seconds

    def nthreads(self):
        return {"tcp://worker": 1} if self.now >= self.until else {}


@pytest.mark.parametrize(
    ("wait", "minutes"),
    [
        (0.0, []),
        (5.0, [0]),
        (59.0, [0]),
        (130.0, [0, 1, 2]),
        (600.0, list(range(10))),
        (7200.0, list(range(120))),
    ],
)
def test_waiting_for_workers_is_reported_every_minute_with_a_way_out(
    wait, minutes, monkeypatch
):
    said = []
    client = WorkerlessClient(monkeypatch, wait)
    with progress_listener(said.append):
        dask_cluster._await_workers(client, "tcp://here:1")
    assert client.now >= client.until
    assert len(said) == len(minutes)
    for text, minute in zip(said, minutes, strict=True):
        words = "" if not minute else f" for {minute} minute{'s' if minute > 1 else ''}"
        assert text.startswith(f"tcp://here:1: the scheduler has no workers{words}; wait")
        assert "dask worker tcp://here:1" in text and "Ctrl-C" in text
        assert "parts that are written stay" in text and "without --dask" in text


@pytest.mark.slow
def test_workers_that_come_late_are_waited_for(machines, tmp_path, wanted):
    machines.schedule()
    said = []

    def listen(text):
        said.append(text)
        if "no workers" in text:
            machines.work()

    with progress_listener(listen):
        found = swept(tmp_path / "designs", machines.address)
    waiting = f"{machines.address}: the scheduler has no workers; waiting for them. Start"
    assert sum(text.startswith(waiting) for text in said) == 1
    same(found, wanted)


class FinishedFuture:
    """The future of a part whose result is lost with its worker, until there is another."""

    status = "finished"

    def __init__(self, client):
        self.client = client

    def result(self, timeout=None):
        if self.client.nthreads():
            return "the result"
        assert timeout is not None, "it would never return"
        self.client.sleep(timeout)
        raise TimeoutError


@pytest.mark.parametrize("wait", [0.0, 1.0, 100.0])
def test_a_result_that_is_lost_with_its_worker_is_waited_for(monkeypatch, wait):
    """The part is computed again by the next worker, and the wait is reported."""
    said = []
    client = WorkerlessClient(monkeypatch, wait)
    with progress_listener(said.append):
        result = dask_cluster._fetch_result(FinishedFuture(client), client, "tcp://here:1")
    assert result == "the result"
    assert bool(said) == (wait > 2.0)
    assert all("no workers" in text for text in said)


class FailedFuture:
    """The future of a part that raised an error on its worker."""

    status = "error"

    def __init__(self, error):
        self.error = error

    def result(self, timeout=None):
        raise self.error


@pytest.mark.many
@pytest.mark.parametrize("error", [OSError(28, "No space left"), TimeoutError("a lock")])
def test_an_error_of_a_part_is_not_taken_for_a_lost_scheduler(error):
    sweep = swept(None).sweep
    with pytest.raises(OSError) as raised:
        dask_cluster._read_answer(FailedFuture(error), None, "tcp://here:1", sweep, 2)
    assert raised.value is error


@pytest.mark.long  # it once waited for ever, perhaps for a lost result; see _fetch_result
@pytest.mark.parametrize("poll_seconds", [0.05, 4.0])
def test_when_all_workers_are_lost_others_make_the_parts(
    poll_seconds, machines, tmp_path, wanted
):
    """Also the sweep itself was lost with them.

    With few looks for finished parts, both workers have finished one when the first is
    taken, so the result of the other one is lost.
    """
    machines.schedule()
    lost = [machines.work(SLOW), machines.work(SLOW)]
    said = []

    def listen(text):
        said.append(text)
        if "no workers" in text and len(said) > 0 and all(x.poll() for x in lost):
            machines.work()

    made = 0
    write = dask_cluster._take_part

    def take_and_end(*words):
        nonlocal made
        write(*words)
        made += 1
        if made == 1:
            for process in lost:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()

    with pytest.MonkeyPatch.context() as patch, progress_listener(listen):
        patch.setattr(dask_cluster, "_take_part", take_and_end)
        patch.setattr(dask_cluster, "POLL_SECONDS", poll_seconds)
        found = swept(tmp_path / "designs", machines.address)
    same(found, wanted)


@pytest.mark.slow
def test_a_lost_scheduler_is_one_sentence_and_the_sweep_goes_on(machines, tmp_path, wanted):
    scheduler = machines.schedule()
    machines.work(SLOW)
    folder = tmp_path / "designs"
    words = ["-m", "spherekit", "sweep", "four_bar", "-a", "poles", "--tables"]
    words += ["--samples", "3", "-o", str(folder)]
    words += ["--vary", "links.2.arc=" + ",".join(map(repr, VARY["links.2.arc"]))]
    running = subprocess.Popen(
        [sys.executable, *words, "--dask", machines.address, "-q"],
        stderr=subprocess.PIPE,
        text=True,
    )
    while not list(folder.glob("designs/part-*")):
        assert running.poll() is None, running.stderr.read()
        time.sleep(0.02)
    os.killpg(scheduler.pid, signal.SIGKILL)
    said = running.communicate(timeout=120)[1]
    assert running.returncode == 1
    assert said == (
        f"spherekit: {machines.address}: the scheduler is lost; parts that are written "
        "stay, and the same command continues, with another --dask ADDRESS or, without "
        "--dask, on this machine\n"
    )
    done = len(list(folder.glob("designs/part-*")))
    assert 0 < done < 3
    found = swept(folder)
    assert found.computed == 3 - done
    same(found, wanted)


@pytest.mark.slow
def test_a_part_that_ends_every_worker_is_told(machines, tmp_path):
    machines.schedule(DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="1")
    machines.work(ENDING, nanny=True)
    with pytest.raises(DesignError, match=r"every worker of .* held part \d has ended"):
        swept(tmp_path / "designs", machines.address)
    assert len(list((tmp_path / "designs" / "designs").glob("part-*"))) >= 1


@pytest.mark.slow
def test_a_worker_without_spherekit_is_told(machines, tmp_path):
    machines.schedule()
    machines.work(LACKING)
    with pytest.raises(DesignError, match="cannot load the sweep .*install on it"):
        swept(tmp_path / "designs", machines.address)


def test_no_scheduler_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_cluster, "CONNECT_SECONDS", 0.5)
    for address in ("tcp://127.0.0.1:1", "nonsense://x", "127.0.0.1:99999"):
        with pytest.raises(DesignError, match="no scheduler answers"):
            swept(tmp_path / "designs", address)
    with pytest.raises(DesignError, match="give the folder"):
        swept(None, "tcp://127.0.0.1:1")


def test_a_part_that_is_not_there_is_no_part(undisturbed, tmp_path, monkeypatch):
    """What says that it has computed it may have written elsewhere."""
    monkeypatch.setattr(dask_cluster, "VISIBLE_SECONDS", 0.1)
    sweep = undisturbed.sweep
    with pytest.raises(OutputError, match="computed part 2, and it does not appear here"):
        dask_cluster._take_part(None, str(tmp_path), sweep, 2)
    with pytest.raises(OutputError, match="part 2 was computed, and is not in"):
        sweep.move_part(str(tmp_path), tmp_path / "designs", 2)

    def elsewhere(sweep, folder, numbers):
        yield sweep.write_part(folder, numbers[0])

    from spherekit.designs.sweep_parts import run_sweep

    with pytest.raises(OutputError, match=r"2 parts of 3 are missing in the end \(1, 2\)"):
        run_sweep(sweep, tmp_path / "designs", elsewhere=elsewhere)
