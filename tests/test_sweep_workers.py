"""Sweeps by worker processes: from any program, and when the system ends some of them."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import spherekit as sk
from spherekit.designs import worker_processes
from spherekit.errors import DesignError
from spherekit.progress import progress_listener

TESTS = Path(__file__).parent
VARY = {"links.2.arc": [float(x) for x in np.linspace(10.0, 40.0, 40)]}
"""Three parts, where each design is run."""

PLAIN = f"""
import spherekit as sk

print("begun", flush=True)
found = sk.sweep(
    "four_bar", {VARY}, analyses=["poles"], tables=True, samples=3, folder="designs",
    workers=2,
)
print(found.computed, len(found.frame()), flush=True)
"""
"""A program as in the documentation, without a main guard."""

PLUGIN = """
from dataclasses import dataclass
from typing import ClassVar

from spherekit.plugin import (
    ASSEMBLY_MODE, SAMPLE, STATUS, AbstractAnalysis, Column, Needs, Table, registered
)

COLUMNS = SAMPLE, ASSEMBLY_MODE, Column("twice", "rad", "2 q"), STATUS
TABLE = Table("rows", "a row per sample", COLUMNS)
double = lambda q: FACTOR * q
FACTOR = 2.0


@dataclass(frozen=True, kw_only=True)
class Twice(AbstractAnalysis):
    name: ClassVar = "twice"
    version: ClassVar = "1"
    summary: ClassVar = "twice the input"
    rowwise: ClassVar = True
    tables: ClassVar = (TABLE,)

    def needs(self, mechanism):
        return Needs()

    def compute(self, batch):
        print("a plugin may print")
        columns = {"sample": batch.sample, "assembly_mode": batch.assembly_mode}
        return {"rows": columns | {"twice": double(batch.q), "status": batch.status}}

"""
"""An analysis that only the script knows."""

PROGRAM_WITH_ANALYSIS = f"""{PLUGIN}
import spherekit as sk

with registered(Twice):
    found = sk.sweep(
        "four_bar", {VARY}, "most=max(twice.rows: twice)", analyses=["twice"],
        tables=True, samples=3, folder="designs", workers=2,
    )
print(found.computed, found.frame()["most"].max())
"""


# Each function `as_...` or `in_...` runs the text of a program in another way, and returns
# what it printed.


def run(words, cwd, **options):
    """Run Python in a folder with arguments, and return what it printed.

    Its exit status has to be 0, and there is no traceback.
    """
    done = subprocess.run(
        [sys.executable, *words], cwd=cwd, capture_output=True, text=True, **options
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return done.stdout


def as_script(tmp_path, text):
    (tmp_path / "script.py").write_text(text)
    return run(["script.py"], tmp_path)


def as_module(tmp_path, text):
    (tmp_path / "script.py").write_text(text)
    return run(["-m", "script"], tmp_path)


def as_guarded_script(tmp_path, text):
    lines = "".join(f"    {line}\n" for line in text.splitlines() if line)
    return as_script(tmp_path, f'if __name__ == "__main__":\n{lines}')


def as_argument(tmp_path, text):
    return run(["-c", text], tmp_path)


def as_isolated_argument(tmp_path, text):
    return run(["-I", "-c", text], tmp_path)


def as_input(tmp_path, text):
    return run(["-"], tmp_path, input=text)


def as_typed(tmp_path, text):
    """In an interactive interpreter, which ends blocks at empty lines."""
    compiled = f"exec(compile({text!r}, '<typed>', 'exec'), globals())\n"
    return run(["-i", "-q"], tmp_path, input=compiled)


def in_a_notebook(tmp_path, text):
    shell = pytest.importorskip("IPython.core.interactiveshell")
    assert shell is not None
    cell = (
        "from IPython.core.interactiveshell import InteractiveShell\n"
        f"InteractiveShell.instance().run_cell({text!r}).raise_error()\n"
    )
    return run(["-c", cell], tmp_path)


def in_a_thread(tmp_path, text):
    """Run the program in another thread than the main one."""
    (tmp_path / "cell.py").write_text(text)
    code = (
        "import threading, runpy\n"
        "t = threading.Thread(target=runpy.run_path, args=('cell.py',),"
        " kwargs={'run_name': '__main__'})\n"
        "t.start(); t.join()\n"
    )
    return run(["-c", code], tmp_path)


def in_pytest(tmp_path, text):
    """Run the program as the body of a test function."""
    lines = "".join(f"    {line}\n" for line in text.splitlines() if line)
    (tmp_path / "test_inside.py").write_text(f"def test_it():\n{lines}")
    words = ["-m", "pytest", "-q", "-s", "-n", "0", "-p", "no:cacheprovider"]
    return run([*words, "--rootdir", str(tmp_path), "test_inside.py"], tmp_path)


PROGRAMS = [
    as_script,
    as_argument,
    as_input,
    as_module,
    as_typed,
    as_guarded_script,
    as_isolated_argument,
    in_a_notebook,
    in_a_thread,
    in_pytest,
]


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("program", PROGRAMS)
def test_a_sweep_needs_no_main_guard(program, tmp_path):
    """Workers do not run the program again, however it was started.

    It prints the number of parts, 3, and of rows: 40 designs in two assembly modes.
    """
    output = program(tmp_path, PLAIN)
    assert output.count("begun") == 1
    assert "3 80" in output
    parts = list((tmp_path / "designs" / "designs").glob("part-*.parquet"))
    assert len(parts) == 3


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("program", [as_script, as_argument, as_input, in_a_notebook])
def test_an_analysis_that_only_the_program_defines_is_sent_to_workers(program, tmp_path):
    """With the lambda that it calls; what it prints does not disturb the workers' talk.

    It computes twice the input, in degrees; the input turns once.
    """
    output = program(tmp_path, PROGRAM_WITH_ANALYSIS)
    part_count = 3
    largest_deg = 2.0 * 360.0
    assert f"{part_count} {largest_deg}" in output


def sweep_with_tables(folder, workers=2, **options):
    """Sweep the four-bar with one run per design, in three parts."""
    defaults = {"analyses": ["poles"], "tables": True, "samples": 3}
    return sk.sweep("four_bar", VARY, folder=folder, workers=workers, **defaults | options)


def test_a_sweep_that_cannot_be_sent_is_refused_in_a_sentence(tmp_path, monkeypatch):
    """A lock in its state cannot be pickled."""
    state = {"lock": threading.Lock()}
    monkeypatch.setattr("spherekit.designs.sweep.Sweep.__getstate__", lambda _: state)
    with pytest.raises(DesignError, match="cannot be sent.*keep thread locks.*--workers 1"):
        sweep_with_tables(tmp_path)


@pytest.mark.many
@pytest.mark.parametrize(
    ("python", "says"),
    [
        ("/nowhere/python", "no worker process can be started.*No such file"),
        ("/bin/false", "ended as it started .exit status 1"),
    ],
)
def test_a_python_that_does_not_start_is_reported(python, says, tmp_path, monkeypatch):
    """Where no Python is known at all, a sweep with default workers uses this process."""
    monkeypatch.setattr(worker_processes, "get_executable", lambda: python)
    with pytest.raises(DesignError, match=f"{says}.*--workers 1"):
        sweep_with_tables(tmp_path)
    monkeypatch.setattr(worker_processes, "get_executable", lambda: None)
    assert sweep_with_tables(tmp_path, workers=None).computed == 3


@pytest.mark.slow
def test_modules_that_a_worker_lacks_are_named(tmp_path, monkeypatch):
    """An analysis of a module whose folder is no longer on the path of modules."""
    (tmp_path / "of_elsewhere.py").write_text(PLUGIN)
    monkeypatch.syspath_prepend(tmp_path)
    from of_elsewhere import Twice, registered

    sys.path.remove(str(tmp_path))
    says = "cannot load the sweep .ModuleNotFoundError: No module named 'of_elsewhere'"
    with registered(Twice), pytest.raises(DesignError, match=says):
        sweep_with_tables(tmp_path / "designs", analyses=["twice"])


ENDING = """
import os, signal, sys
from pathlib import Path
from spherekit.designs import sweep

mark, mode, number = Path({mark!r}), {mode!r}, {number}
write = sweep.Sweep.write_part


def write_or_end(self, folder, part):
    count = len(list(mark.glob("*")))
    limits = {{"once": 1, "twice": 2, "always": 10**6}}
    if part == number and count < limits[mode]:
        (mark / str(count)).touch()
        os.kill(os.getpid(), signal.{signal})
    return write(self, folder, part)


sweep.Sweep.write_part = write_or_end
"""
"""A `sitecustomize` by which a process ends itself when it writes part `number`.

Each death leaves a file in the folder `mark`, so that their number can be limited.
"""


@pytest.fixture
def end_processes(tmp_path, monkeypatch):
    """Return a function by which worker processes of a sweep end themselves.

    Worker processes compute a sweep in numbered parts of some designs each. A process ends
    itself just before it writes the part with the requested number. For this a file
    `sitecustomize.py` is written, which Python imports whenever a process starts. Its text
    `ENDING` replaces the method that writes a part.

    The arguments of the function are how often a process ends ("once", "twice", "always"),
    the number of the part, and the name of the signal. The function returns a folder, in
    which each process that ends itself leaves a file.
    """

    def install(mode, number=0, signal_name="SIGKILL"):
        mark = tmp_path / "mark"
        site = tmp_path / "site"
        mark.mkdir()
        site.mkdir()
        text = ENDING.format(mark=str(mark), mode=mode, number=number, signal=signal_name)
        (site / "sitecustomize.py").write_text(text)
        monkeypatch.setenv("PYTHONPATH", str(site))
        return mark

    return install


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs signals")
@pytest.mark.parametrize(
    ("mode", "number", "signal_name"),
    [
        ("once", 0, "SIGKILL"),  # before any part is made
        ("once", 2, "SIGKILL"),
        ("once", 1, "SIGSEGV"),
        ("twice", 0, "SIGKILL"),
        ("twice", 1, "SIGTERM"),
    ],
)
def test_a_part_whose_process_is_ended_is_computed_by_another(
    mode, number, signal_name, tmp_path, end_processes
):
    """If the worker process of a part of a sweep is ended, another one computes the part.

    The sweep has three parts of up to 16 designs. With `end_processes`, the process that
    computes part `number` ends itself by a signal, once or twice. The sweep reports each of
    these ends. The rows must be equal bit by bit to those of an undisturbed sweep.
    """
    # A folder with a file for each process that ended.
    mark = end_processes(mode, number, signal_name)
    messages = []
    with progress_listener(lambda report: messages.append(report.text)):
        result = sweep_with_tables(tmp_path / "designs")
    death_count = {"once": 1, "twice": 2}[mode]
    assert len(list(mark.iterdir())) == death_count
    reports = [text for text in messages if "its process was ended" in text]
    assert len(reports) == death_count
    assert f"part {number} (designs {16 * number} to " in reports[0]
    signal_number = int(getattr(signal, signal_name))
    assert f"signal {signal_number}, {signal_name}" in reports[0]
    assert result.computed == 3

    expected = sweep_with_tables(None)
    pd.testing.assert_frame_equal(result.frame(), expected.frame(), check_exact=True)
    for name in expected.table_names:
        pd.testing.assert_frame_equal(result.table(name), expected.table(name))


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_a_part_that_ends_every_process_ends_the_sweep_with_a_message(
    tmp_path, end_processes
):
    """If three processes of the same part of a sweep are ended, the sweep ends.

    `end_processes` has each process of part 1 ended. A message says so, and the other two
    parts are written. When processes are no longer ended, the same command only computes
    the missing part.
    """
    # A folder with a file for each process that ended.
    mark = end_processes("always", number=1)
    with pytest.raises(DesignError) as refusal:
        sweep_with_tables(tmp_path / "designs")
    assert str(refusal.value) == (
        "four_bar: part 1 (designs 16 to 31): the system ended each of 3 processes that "
        "computed it (signal 9, SIGKILL), perhaps because memory ran out; parts that are "
        "written are kept. Ask for fewer samples, or for --workers 1, which needs less "
        "memory, and run the same command again to continue"
    )
    assert len(list(mark.iterdir())) == 3
    # This file had made the processes end themselves.
    (tmp_path / "site" / "sitecustomize.py").write_text("")
    assert sweep_with_tables(tmp_path / "designs").computed == 1


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc of Linux")
def test_killing_worker_processes_from_outside_does_not_change_a_sweep(tmp_path):
    """A sweep has all its rows although four of its processes are killed, one per second.

    A system that is short of memory kills processes in this way. The test reads from /proc
    which child processes the sweep has, and may kill any of them.
    """
    command = [sys.executable, "-m", "spherekit", "sweep", "four_bar", "-a", "poles"]
    command += ["--tables", "--vary", "links.2.arc=10:40:160", "--samples", "91"]
    command += ["--workers", "2", "-q", "-o", str(tmp_path / "designs")]
    sweep = subprocess.Popen(command, start_new_session=True)
    killed = set()
    while sweep.poll() is None and len(killed) < 4:
        lists = Path(f"/proc/{sweep.pid}/task").glob("*/children")
        children = {int(pid) for path in lists for pid in path.read_text().split()}
        for pid in sorted(children - killed)[:1]:
            time.sleep(1.0)
            if sweep.poll() is None:
                os.kill(pid, signal.SIGKILL)
                killed.add(pid)
        time.sleep(0.05)
    assert sweep.wait(300) == 0
    assert len(killed) == 4
    # 160 designs with two assembly modes
    assert len(pd.read_parquet(tmp_path / "designs" / "designs")) == 2 * 160


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="closes a descriptor in a shell")
def test_printed_text_does_not_disturb_workers_without_standard_error(tmp_path):
    """The program starts with a closed standard error. Its three parts are computed."""
    (tmp_path / "script.py").write_text(PROGRAM_WITH_ANALYSIS)
    shell_command = ["sh", "-c", 'exec "$0" script.py 2>&-', sys.executable]
    process = subprocess.run(
        shell_command, cwd=tmp_path, stdout=subprocess.PIPE, text=True, check=False
    )
    assert process.returncode == 0
    assert process.stdout.split() == ["3", "720.0"]
