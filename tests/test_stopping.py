"""What the system does to a command: signals, streams that take nothing, little memory."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from spherekit import resources
from spherekit.cli import main as command
from spherekit.cli.interrupts import interrupt_number, raise_on_interrupt
from spherekit.cli.main import main

if os.name != "posix":
    pytest.skip("needs signals and limits of posix", allow_module_level=True)
import resource

SPHEREKIT = [sys.executable, "-m", "spherekit"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_raises_an_interrupt_with_its_number(number, request):
    # A signal that is ignored, as under nohup, stays ignored. Here it is not ignored.
    before = signal.signal(number, signal.default_int_handler)
    request.addfinalizer(lambda: signal.signal(number, before))
    with pytest.raises(KeyboardInterrupt) as interrupt, raise_on_interrupt(False):
        signal.raise_signal(number)
    assert interrupt_number(interrupt.value) == number
    assert signal.getsignal(number) is signal.default_int_handler


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_was_ignored_stays_ignored(number, request):
    before = signal.signal(number, signal.SIG_IGN)
    request.addfinalizer(lambda: signal.signal(number, before))
    with raise_on_interrupt(False):
        signal.raise_signal(number)
    assert signal.getsignal(number) is signal.SIG_IGN


def children(process):
    lists = Path(f"/proc/{process.pid}/task").glob("*/children")
    return [int(pid) for path in lists for pid in path.read_text().split()]


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def files(folder):
    return {x: x.stat().st_mtime_ns for x in folder.rglob("*") if x.is_file()}


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc of Linux")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_processes_of_a_sweep_end_with_it(number, tmp_path):
    """Ctrl-C goes to all of them, as from a terminal; the others to the first alone."""
    words = ["sweep", "four_bar", "--vary", "links.2.arc=10:20:300", "--workers", "2"]
    words += ["--vary", "links.3.arc=0:90:300", "--reduce", "max(rate_41)", "-q", "-o"]
    running = subprocess.Popen(
        [*SPHEREKIT, *words, tmp_path],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: [signal.signal(x, signal.SIG_DFL) for x in (2, 15)],
    )
    while len(children(running)) < 2:
        assert running.poll() is None
        time.sleep(0.02)
    time.sleep(0.2)  # the last of them is told what it is for
    others = children(running)
    (os.killpg if number == signal.SIGINT else os.kill)(running.pid, number)
    said = running.communicate(timeout=60)[1]  # all that could say something have ended
    left = files(tmp_path)
    while any(map(alive, others)):
        time.sleep(0.02)
    assert files(tmp_path) == left
    if number == signal.SIGKILL:
        assert running.returncode == -number and not said
    else:
        assert running.returncode == 128 + number
        assert said.startswith("spherekit: stopped; 0 of") and said.count("\n") == 1
        assert {path.name for path in left} == {"_sweep.json", ".sweep.lock"}


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(
    "words, redirected, status, says",
    [
        ("mechanisms", ">&-", 0, ""),
        ("mechanisms", ">/dev/full", 1, "standard output cannot be written: No space"),
        ("mechanisms", "| true", 0, ""),
        ("mechanisms", "<&- >&- 2>&-", 0, ""),
        ("run four_bar --samples 3 -o out", ">/dev/full", 1, "6 files in out"),
        ("validate /dev/stdin", "<four_bar.toml >&-", 0, ""),
        ("validate <(cat four_bar.toml)", ">&-", 0, ""),
        ("validate /dev/stdin", "< <(yes)", 1, "at most 4194304"),
    ],
)
def test_streams_that_take_nothing(words, redirected, status, says, tmp_path):
    file = Path(__file__).parent.parent / "mechanisms" / "four_bar.toml"
    (tmp_path / "four_bar.toml").write_bytes(file.read_bytes())
    script = f"{' '.join(SPHEREKIT)} {words} {redirected}"
    done = subprocess.run(
        ["bash", "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert done.returncode == status and done.stdout == ""
    assert says in done.stderr and "Traceback" not in done.stderr
    assert ("out" in words) == (tmp_path / "out" / "summary.json").exists()


@pytest.mark.many
@pytest.mark.parametrize("limit", [200_000, 500_000])
def test_little_memory_is_told(limit, tmp_path):
    script = f"ulimit -v {limit}; {' '.join(SPHEREKIT)} run four_bar --save a.rrd"
    done = subprocess.run(
        ["bash", "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert done.returncode == 1 and done.stderr.count("\n") == 1
    assert "memory" in done.stderr or "addresses" in done.stderr
    assert "allow more" in done.stderr and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "fault",
    [
        MemoryError(),
        OSError(12, "Cannot allocate memory"),
        ImportError("libx.so: failed to map segment from shared object"),
        RuntimeError("can't start new thread"),
    ],
)
def test_faults_of_memory_are_told(fault, capsys, monkeypatch):
    def execute(_):
        try:
            raise fault
        except type(fault):
            raise ImportError("this install seems to be broken") from None

    monkeypatch.setattr("spherekit.cli.mechanisms.execute", execute)
    assert main(["mechanisms"]) == command.BAD_INPUT
    assert "there is not enough memory" in capsys.readouterr().err


def test_limits_of_memory_are_those_of_this_process(tmp_path, monkeypatch):
    """Address space, and control groups of both versions with those around them."""
    free = resources.usable_memory()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (free // 2, hard))
    try:
        assert 0 < resources.usable_memory() < free // 2
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
    monkeypatch.setattr(resources, "GROUP_LIMITS", tmp_path)
    monkeypatch.setattr(resources, "GROUP_MEMBERSHIP", tmp_path / "cgroup")
    for line, name, inner in (
        ("0::/a/b", "memory.max", "a/b"),
        ("4:cpu,memory:/a/b", "memory.limit_in_bytes", "memory/a/b"),
    ):
        (tmp_path / "cgroup").write_text(f"7:pids:/x\n{line}\n")
        (tmp_path / inner).mkdir(parents=True)
        (tmp_path / inner / name).write_text("max\n")
        (tmp_path / inner).parent.joinpath(name).write_text("70000\n")
        assert resources.usable_memory() == 70000
