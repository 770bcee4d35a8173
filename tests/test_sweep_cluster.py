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
"""Code by which a worker takes the folders of sweeps for not writable (a blind worker)."""

SLOW = """
# Code by which a worker takes a second for each part.
import time
from spherekit.designs import sweep

write = sweep.Sweep.write_part


def write_slowly(self, folder, part):
    time.sleep(1.0)
    return write(self, folder, part)


sweep.Sweep.write_part = write_slowly
"""

ENDING = """
# Code by which a worker ends while it computes part 1, once part 0 is in the result folder.
import os, signal, time
from pathlib import Path
from spherekit.designs import sweep

write = sweep.Sweep.write_part


def write_or_end(self, folder, part):
    if part == 1:
        # `folder` is RESULT_FOLDER/.sweep-work/NAME, where parts are written at first.
        result_folder = Path(folder).parents[1]
        deadline = time.monotonic() + 60.0
        while time.monotonic() < deadline:
            if list(result_folder.glob("designs/part-*")):
                break
            time.sleep(0.02)
        os.kill(os.getpid(), signal.SIGKILL)
    return write(self, folder, part)


sweep.Sweep.write_part = write_or_end
"""

LACKING = """
import sys

sys.modules["spherekit.designs.sweep"] = None
"""


def sweep_on_cluster(folder, address=None, **options):
    """Sweep the four-bar in three parts; without an address, in this process."""
    defaults = {"analyses": ["poles"], "tables": True, "samples": 3, "workers": 1}
    options = defaults | options
    return sk.sweep("four_bar", VARY, folder=folder, dask=address, **options)


@pytest.fixture(scope="module")
def undisturbed():
    """Return the result of the sweep in this process."""
    return sweep_on_cluster(None)


@pytest.fixture(scope="module")
def expected_tables(undisturbed):
    """Return the designs and the poles of an undisturbed sweep."""
    return undisturbed.frame(), undisturbed.table("poles")


def assert_same_rows(result, expected_tables):
    """Assert that a sweep has the designs and poles of another, bit by bit."""
    designs, poles = expected_tables
    pd.testing.assert_frame_equal(result.frame(), designs, check_exact=True)
    pd.testing.assert_frame_equal(result.table("poles"), poles, check_exact=True)


class Machines:
    """A Dask scheduler and workers for tests, each a process in its own folder.

    They stand for the machines of a cluster, on which parts of a sweep are computed.
    `address` is that of the scheduler that was started last.
    """

    def __init__(self, root):
        """Begin without processes, with `root` as the parent of their folders."""
        self.root = root
        self.processes = []
        self.address = ""

    def start(self, arguments, site="", **environment):
        """Start `python -m arguments` in a new folder, and return the process.

        `site` is the text of a module `sitecustomize`, which Python imports at its start.
        Tests use it to replace functions in this process. `environment` has further
        environment variables.
        """
        folder = self.root / f"machine-{len(self.processes)}"
        (folder / "site").mkdir(parents=True)
        (folder / "site" / "sitecustomize.py").write_text(site)
        environment["PYTHONPATH"] = str(folder / "site")
        process = subprocess.Popen(
            [sys.executable, "-m", *arguments],
            cwd=folder,
            env=os.environ | environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        self.processes.append(process)
        return process

    def start_scheduler(self, port=0, **environment):
        """Start a scheduler and wait for its address; port 0 is any free one."""
        file = self.root / f"scheduler-{len(self.processes)}.json"
        arguments = ["distributed.cli.dask_scheduler", "--host", "127.0.0.1"]
        arguments += ["--no-dashboard", "--port", str(port), "--scheduler-file", str(file)]
        process = self.start(arguments, **environment)
        while not (file.exists() and file.read_text().endswith("}")):
            assert process.poll() is None
            time.sleep(0.05)
        self.address = json.loads(file.read_text())["address"]
        return process

    def start_worker(self, site="", threads=1, nanny=False):
        """Start a worker; a nanny starts it again when it ends."""
        arguments = ["distributed.cli.dask_worker", self.address, "--no-dashboard"]
        arguments += ["--nthreads", str(threads), "--nanny" if nanny else "--no-nanny"]
        return self.start(arguments, site)

    def end(self):
        """Kill all processes and their children."""
        for process in self.processes:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.fixture
def machines(tmp_path):
    """Yield an empty set of machines, and end them after the test."""
    machines = Machines(tmp_path / "machines")
    try:
        yield machines
    finally:
        machines.end()


@pytest.mark.slow
def test_threads_of_one_worker_make_the_same_rows(tmp_path, expected_tables):
    """Those of a cluster within this process, which share one sweep."""
    from dask.distributed import LocalCluster

    options = {"n_workers": 1, "threads_per_worker": 4, "dashboard_address": None}
    with LocalCluster(processes=False, **options) as local:
        found = sweep_on_cluster(tmp_path, local.scheduler_address)
    assert found.computed == 3
    assert_same_rows(found, expected_tables)


@pytest.mark.slow
@pytest.mark.parametrize("site", ["", BLIND], ids=["seeing", "blind"])
def test_a_relative_folder_is_relative_to_the_command(
    site, machines, tmp_path, expected_tables, monkeypatch
):
    """A relative folder of a sweep is in the folder of the command, not of its workers.

    Each worker runs in its own folder. `site` is code that the worker executes at its
    start: none, or `BLIND`, by which the worker takes the folder of the sweep for not
    writable. The designs of a sweep are divided into parts. A blind worker must return the
    files of its parts to the command, which writes them. `machines` starts the processes of
    a cluster. `expected_tables` come from a sweep without workers.
    """
    machines.start_scheduler()
    machines.start_worker(site)
    working_folder = tmp_path / "here"
    working_folder.mkdir()
    monkeypatch.chdir(working_folder)
    result = sweep_on_cluster("designs", machines.address)
    assert result.computed == 3
    assert result.folder == Path("designs")
    assert_same_rows(result, expected_tables)
    names = {path.name for path in Path("designs").iterdir()}
    # Within the folder, "designs" is the data set of designs and "tables" that of tables.
    assert names == {"designs", "tables", "_sweep.json", ".sweep.lock"}
    # Workers leave nothing in their own folders.
    assert not list((tmp_path / "machines").rglob("part-*"))
    # The same sweep without workers finds all designs in the folder.
    assert sweep_on_cluster("designs").computed == 0


@pytest.mark.slow
def test_parts_of_seeing_and_blind_workers_are_one_data_set(
    machines, tmp_path, expected_tables
):
    machines.start_scheduler()
    # Each part takes at least a second, which leaves time for both workers to take parts.
    machines.start_worker(BLIND + SLOW)
    machines.start_worker(SLOW)
    assert_same_rows(
        sweep_on_cluster(tmp_path / "designs", machines.address), expected_tables
    )


class WorkerlessClient:
    """A client of a Dask scheduler that has no workers until some time.

    The clock is simulated: `now` is the time in seconds, and sleeping moves it on at once.
    So tests of long waits are fast.
    """

    status = "running"

    def __init__(self, monkeypatch, seconds):
        """Replace the clock of the cluster code; workers appear after `seconds`."""
        self.now = 1000.0
        self.until = self.now + seconds
        monkeypatch.setattr(dask_cluster.time, "monotonic", lambda: self.now)
        monkeypatch.setattr(dask_cluster.time, "sleep", self.sleep)

    def sleep(self, seconds):
        """Move the clock on."""
        self.now += seconds

    def nthreads(self):
        """Return the threads by worker: one worker, or none yet."""
        return {"tcp://worker": 1} if self.now >= self.until else {}


@pytest.mark.parametrize(
    ("wait_seconds", "minutes"),
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
    wait_seconds, minutes, monkeypatch
):
    """While a scheduler has no workers, a report comes at once and then every minute.

    The report says for how many minutes the command has waited, and what the user can do.
    `WorkerlessClient` has a simulated clock, on which workers appear after `wait_seconds`.
    `minutes` are the waiting times of the reports. The first report, after 0 minutes,
    states no time.
    """
    messages = []
    client = WorkerlessClient(monkeypatch, wait_seconds)
    with progress_listener(lambda report: messages.append(report.text)):
        dask_cluster._await_workers(client, "tcp://here:1")
    # On the simulated clock of the client, workers have appeared by now.
    assert client.now >= client.until
    assert len(messages) == len(minutes)
    for text, minute in zip(messages, minutes, strict=True):
        duration = ""
        if minute:
            duration = f" for {minute} minute{'s' if minute > 1 else ''}"
        assert text.startswith(
            f"tcp://here:1: the scheduler has no workers{duration}; wait"
        )
        assert "dask worker tcp://here:1" in text
        assert "Ctrl-C" in text
        assert "parts that are written are kept" in text
        assert "without --dask" in text


@pytest.mark.slow
def test_a_sweep_waits_for_workers_that_come_late(machines, tmp_path, expected_tables):
    """A sweep on a cluster without workers waits for the first one.

    The test starts a worker (of `machines`) when the sweep reports that there is none. The
    rows must be those of a sweep without a cluster.
    """
    machines.start_scheduler()
    messages = []

    def start_worker_when_missed(report):
        text = report.text
        messages.append(text)
        if "no workers" in text:
            machines.start_worker()

    with progress_listener(start_worker_when_missed):
        result = sweep_on_cluster(tmp_path / "designs", machines.address)
    report = f"{machines.address}: the scheduler has no workers; waiting for them. Start"
    assert sum(text.startswith(report) for text in messages) == 1
    assert_same_rows(result, expected_tables)


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
    with progress_listener(lambda report: said.append(report.text)):
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


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("error", [OSError(28, "No space left"), TimeoutError("a lock")])
def test_an_error_of_a_part_is_not_taken_for_a_lost_scheduler(error):
    sweep = sweep_on_cluster(None).sweep
    with pytest.raises(OSError) as raised:
        dask_cluster._read_answer(FailedFuture(error), None, "tcp://here:1", sweep, 2)
    assert raised.value is error


@pytest.mark.long  # it once waited for ever, perhaps for a lost result; see _fetch_result
@pytest.mark.parametrize("poll_seconds", [0.05, 4.0])
def test_after_the_loss_of_all_workers_another_one_computes_the_parts(
    poll_seconds, machines, tmp_path, expected_tables
):
    """A sweep whose workers are all killed goes on with a new worker.

    Both workers are killed after the sweep has got the first part. The sweep asks every
    `poll_seconds` which parts are finished, and gets their results. A worker needs 1 s for
    a part (`SLOW`). If the sweep asks every 4 s, both workers have finished a part when it
    gets the first one. The result of the second part is then lost with its worker, and is
    computed again.
    """
    machines.start_scheduler()
    killed_workers = [machines.start_worker(SLOW), machines.start_worker(SLOW)]

    def start_worker_when_missed(report):
        """Start a worker when the sweep reports "the scheduler has no workers"."""
        # The report also comes at the start, before the first workers are known. So the
        # first workers must be dead. `poll` returns None for a living process, and an exit
        # code other than 0 for a killed one.
        if "no workers" in report.text and all(worker.poll() for worker in killed_workers):
            machines.start_worker()

    taken_parts = 0
    take_part = dask_cluster._take_part

    def take_part_and_kill_workers(*arguments):
        nonlocal taken_parts
        take_part(*arguments)
        taken_parts += 1
        if taken_parts == 1:
            for worker in killed_workers:
                os.killpg(worker.pid, signal.SIGKILL)
                worker.wait()

    with (
        pytest.MonkeyPatch.context() as patch,
        progress_listener(start_worker_when_missed),
    ):
        patch.setattr(dask_cluster, "_take_part", take_part_and_kill_workers)
        patch.setattr(dask_cluster, "POLL_SECONDS", poll_seconds)
        result = sweep_on_cluster(tmp_path / "designs", machines.address)
    assert_same_rows(result, expected_tables)


@pytest.mark.slow
def test_a_lost_scheduler_ends_a_sweep_with_one_sentence(
    machines, tmp_path, expected_tables
):
    """If the scheduler of a cluster is lost, the sweep ends and says how to go on.

    The scheduler is killed after the first of three parts. The same sweep without a cluster
    must then compute only the other parts.
    """
    part_count = 3
    scheduler = machines.start_scheduler()
    # The worker takes a second for each part.
    machines.start_worker(SLOW)
    folder = tmp_path / "designs"
    numbers = ",".join(map(repr, VARY["links.2.arc"]))
    command = [sys.executable, "-m", "spherekit", "sweep", "four_bar", "-a", "poles"]
    command += ["--tables", "--samples", "3", "-o", str(folder), "-q"]
    command += ["--vary", f"links.2.arc={numbers}", "--dask", machines.address]
    sweep = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    while not list(folder.glob("designs/part-*")):
        assert sweep.poll() is None, sweep.stderr.read()
        time.sleep(0.02)
    os.killpg(scheduler.pid, signal.SIGKILL)
    error_text = sweep.communicate(timeout=120)[1]
    assert sweep.returncode == 1
    assert error_text == (
        f"spherekit: {machines.address}: the connection to the scheduler is lost. Parts "
        "that are written are kept; run the same command again to continue, with another "
        "--dask ADDRESS, or without --dask on this machine\n"
    )
    finished_count = len(list(folder.glob("designs/part-*")))
    assert 0 < finished_count < part_count
    # Without an address the parts are computed in this process.
    result = sweep_on_cluster(folder)
    assert result.computed == part_count - finished_count
    assert_same_rows(result, expected_tables)


@pytest.mark.slow
def test_a_part_that_ends_every_worker_is_told(machines, tmp_path):
    machines.start_scheduler(DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="1")
    machines.start_worker(ENDING, nanny=True)
    with pytest.raises(DesignError, match=r"every worker of .* held part \d has ended"):
        sweep_on_cluster(tmp_path / "designs", machines.address)
    assert len(list((tmp_path / "designs" / "designs").glob("part-*"))) >= 1


@pytest.mark.slow
def test_a_worker_without_spherekit_is_told(machines, tmp_path):
    machines.start_scheduler()
    machines.start_worker(LACKING)
    with pytest.raises(
        DesignError, match="cannot load the sweep .*install the same packages"
    ):
        sweep_on_cluster(tmp_path / "designs", machines.address)


@pytest.mark.slow
def test_no_scheduler_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(dask_cluster, "CONNECT_SECONDS", 0.5)
    addresses = (
        "tcp://127.0.0.1:1",
        "nonsense://x",
        "127.0.0.1:99999",
        "tls://127.0.0.1:1",  # encryption is not configured
    )
    for address in addresses:
        with pytest.raises(DesignError, match="no scheduler answers"):
            sweep_on_cluster(tmp_path / "designs", address)
    with pytest.raises(DesignError, match="give the argument folder"):
        sweep_on_cluster(None, "tcp://127.0.0.1:1")


@pytest.mark.slow
def test_a_part_that_does_not_appear_in_the_folder_is_missed(
    undisturbed, tmp_path, monkeypatch
):
    """A part that was computed and is not in the folder of the sweep is an error.

    A worker may have written the part on another disk. `undisturbed` is a sweep of three
    parts, and part 2 is not in the folder here. The sweep notices this in three cases:

    - A worker says that the part is computed, but does not send its file. The sweep waits
      for `VISIBLE_SECONDS`, the longest time until a file on a network disk is seen.
    - The part has to be moved to the folder of the sweep.
    - The sweep is at its end, and a cluster has computed some parts only.
    """
    monkeypatch.setattr(dask_cluster, "VISIBLE_SECONDS", 0.1)
    sweep = undisturbed.sweep
    with pytest.raises(OutputError, match="computed part 2, but its file is not in"):
        dask_cluster._take_part(
            files=None, folder=str(tmp_path), sweep=sweep, part_number=2
        )
    with pytest.raises(OutputError, match="part 2 was computed, but is no longer in"):
        sweep.move_part(str(tmp_path), tmp_path / "designs", 2)

    def write_first_part_only(sweep, folder, numbers):
        """Act as a cluster that computes only the first of the parts with these numbers."""
        yield sweep.write_part(folder, numbers[0])

    from spherekit.designs.sweep_parts import run_sweep

    # `elsewhere` is the function that has parts computed by other machines.
    with pytest.raises(OutputError, match=r"2 of 3 parts are missing \(1, 2\)"):
        run_sweep(sweep, tmp_path / "designs", elsewhere=write_first_part_only)
