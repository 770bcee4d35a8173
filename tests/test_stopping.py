"""What a command does at signals, closed or full streams, and with little memory.

pytest may itself be started with signals ignored, as by `nohup` in the background; tests
set what they need of signals themselves.
"""

import os
import signal
import subprocess
import sys
import threading
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


def handle_during_test(request, number, handler):
    """Set the handler of a signal until the test ends."""
    previous_handler = signal.signal(number, handler)
    request.addfinalizer(lambda: signal.signal(number, previous_handler))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_raises_an_interrupt_with_its_number(number, request):
    """The handler from before is back afterwards."""
    handle_during_test(request, number, signal.default_int_handler)
    with pytest.raises(KeyboardInterrupt) as interrupt, raise_on_interrupt(False):
        signal.raise_signal(number)
    assert interrupt_number(interrupt.value) == number
    assert signal.getsignal(number) is signal.default_int_handler


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_was_ignored_stays_ignored(number, request):
    """As under `nohup`: nothing is raised."""
    handle_during_test(request, number, signal.SIG_IGN)
    with raise_on_interrupt(False):
        signal.raise_signal(number)
    assert signal.getsignal(number) is signal.SIG_IGN


def test_an_error_in_another_thread_does_not_refer_to_signals():
    errors = []

    def fail():
        """Raise an error where signals cannot be handled."""
        try:
            with raise_on_interrupt(False):
                raise KeyError
        except KeyError as error:
            errors.append(error)

    thread = threading.Thread(target=fail)
    thread.start()
    thread.join()
    assert errors[0].__context__ is None


def test_a_faulty_command_fails_also_if_nobody_reads_its_message():
    read_end, write_end = os.pipe()
    os.close(read_end)
    command = [*SPHEREKIT, "run", "four_bra"]
    done = subprocess.run(command, stderr=write_end, check=False, timeout=60)
    os.close(write_end)
    assert done.returncode == 1


def children_of(process):
    """Return the numbers of the processes that a process has started, from /proc."""
    lists = Path(f"/proc/{process.pid}/task").glob("*/children")
    return [int(pid) for path in lists for pid in path.read_text().split()]


def is_alive(pid):
    """Return whether a process exists and is not just an unread exit status (state Z)."""
    try:
        text_after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2]
    except OSError:
        return False
    state = text_after_name.split()[0]
    return state != "Z"


def times_of_files(folder):
    """Return the time of the last change of each file below a folder."""
    return {x: x.stat().st_mtime_ns for x in folder.rglob("*") if x.is_file()}


def let_signals_end_the_process():
    """Forget that SIGINT and SIGTERM are ignored, if they are."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc of Linux")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_worker_processes_end_with_their_sweep(number, tmp_path):
    """A signal ends a sweep with all its worker processes.

    A sweep of 90000 designs with two workers gets the signal before its first part is
    complete. SIGINT goes to all processes, as Ctrl-C from a terminal; the others go to the
    first process alone. All workers end, and none writes after the first process has ended.
    SIGTERM and SIGINT leave a message of one line and the exit status of shells, 128 plus
    the signal.
    """
    words = ["sweep", "four_bar", "--vary", "links.2.arc=10:20:300", "--workers", "2"]
    words += ["--vary", "links.3.arc=0:90:300", "--reduce", "max(rate_41)", "-q", "-o"]
    sweep = subprocess.Popen(
        [*SPHEREKIT, *words, tmp_path],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=let_signals_end_the_process,
    )
    while len(children_of(sweep)) < 2:
        assert sweep.poll() is None
        time.sleep(0.02)
    time.sleep(0.2)  # in which the last worker gets its sweep
    workers = children_of(sweep)
    if number == signal.SIGINT:
        os.killpg(sweep.pid, number)
    else:
        os.kill(sweep.pid, number)
    # Ends when all processes that could write a message have ended.
    _, message = sweep.communicate(timeout=60)
    files = times_of_files(tmp_path)
    while any(is_alive(pid) for pid in workers):
        time.sleep(0.02)
    assert times_of_files(tmp_path) == files
    if number == signal.SIGKILL:
        assert sweep.returncode == -number
        assert not message
    else:
        assert sweep.returncode == 128 + number
        assert message.startswith("spherekit: stopped; 0 of")
        assert message.count("\n") == 1
        assert {path.name for path in files} == {"_sweep.json", ".sweep.lock"}


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(
    "words, redirection, status, fragment",
    [
        ("mechanisms", ">&-", 0, ""),
        ("mechanisms", ">/dev/full", 1, "standard output cannot be written: No space"),
        ("mechanisms", "| true", 0, ""),
        ("mechanisms", "<&- >&- 2>&-", 0, ""),
        ("run four_bar --samples 3 -o out", ">/dev/full", 1, "cannot be written: No space"),
        ("validate /dev/stdin", "<four_bar.toml >&-", 0, ""),
        ("validate <(cat four_bar.toml)", ">&-", 0, ""),
        ("validate /dev/stdin", "< <(yes)", 1, "at most 4194304"),
    ],
)
def test_commands_end_well_where_streams_are_closed_full_or_endless(
    words, redirection, status, fragment, tmp_path
):
    """Commands end with the right status where streams are closed, full or endless.

    They are run by bash with a redirection. Expected are the exit status and a fragment of
    stderr. Nothing is on standard output, there is no traceback, and files are written even
    if their list cannot be printed. `>&-` closes a stream, `/dev/full` takes nothing, `|
    true` reads nothing, and `< <(yes)` does not end.
    """
    file = Path(__file__).parent.parent / "mechanisms" / "four_bar.toml"
    (tmp_path / "four_bar.toml").write_bytes(file.read_bytes())
    script = f"{' '.join(SPHEREKIT)} {words} {redirection}"
    done = subprocess.run(
        ["bash", "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert done.returncode == status
    assert done.stdout == ""
    assert fragment in done.stderr
    assert "Traceback" not in done.stderr
    writes_files = "-o out" in words
    assert (tmp_path / "out" / "summary.json").exists() == writes_files


@pytest.mark.many
@pytest.mark.parametrize("limit_kib", [200_000, 500_000])
def test_a_command_without_enough_memory_says_so_in_one_line(limit_kib, tmp_path):
    """The address space is limited; imports or the recording then fail. No file stays."""
    script = f"ulimit -v {limit_kib}; {' '.join(SPHEREKIT)} run four_bar --save a.rrd"
    done = subprocess.run(
        ["bash", "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path
    )
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "memory" in done.stderr or "address space" in done.stderr
    assert "allow more" in done.stderr or "raise the limit" in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "fault",
    [
        MemoryError(),
        OSError(12, "Cannot allocate memory"),
        ImportError("libx.so: failed to map segment from shared object"),
        RuntimeError("can't start new thread"),
    ],
)
def test_errors_for_want_of_memory_are_reported_as_such(fault, capsys, monkeypatch):
    """Also where the error has become the cause of another, which would mislead."""

    def execute(_):
        try:
            raise fault
        except type(fault):
            raise ImportError("this install seems to be broken") from None

    monkeypatch.setattr("spherekit.cli.mechanisms.execute", execute)
    assert main(["mechanisms"]) == command.BAD_INPUT
    assert "not enough memory" in capsys.readouterr().err


def test_usable_memory_is_below_a_limit_of_the_address_space():
    free = resources.usable_memory()
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (free // 2, hard))
    try:
        assert 0 < resources.usable_memory() < free // 2
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@pytest.mark.parametrize(
    ("membership", "limit_file", "group"),
    [
        ("0::/a/b", "memory.max", "a/b"),
        ("4:cpu,memory:/a/b", "memory.limit_in_bytes", "memory/a/b"),
    ],
    ids=["version 2", "version 1"],
)
def test_usable_memory_is_the_limit_of_an_enclosing_control_group(
    membership, limit_file, group, tmp_path, monkeypatch
):
    """Usable memory is the limit of the control group that encloses the process's group.

    Linux control groups limit the memory of processes. Here the process is in group a/b,
    which has no limit; the group a has 70000 bytes. Files have the layout of Linux, in
    version 1 or 2 of control groups: `membership` is a line of `/proc/self/cgroup`, and
    `limit_file` is in the folder of each group.
    """
    monkeypatch.setattr(resources, "GROUP_LIMITS", tmp_path)
    monkeypatch.setattr(resources, "GROUP_MEMBERSHIP", tmp_path / "cgroup")
    # The group of the first line limits the number of processes, so it does not matter.
    (tmp_path / "cgroup").write_text(f"7:pids:/x\n{membership}\n")
    folder = tmp_path / group
    folder.mkdir(parents=True)
    (folder / limit_file).write_text("max\n")
    (folder.parent / limit_file).write_text("70000\n")
    assert resources.usable_memory() == 70000


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has control groups")
@pytest.mark.parametrize("name", [b"\xff", "a\x85b".encode()])
def test_control_groups_with_odd_names_limit_the_memory(name, tmp_path, monkeypatch):
    monkeypatch.setattr(resources, "GROUP_LIMITS", tmp_path)
    monkeypatch.setattr(resources, "GROUP_MEMBERSHIP", tmp_path / "cgroup")
    (tmp_path / "cgroup").write_bytes(b"0::/" + name + b"\n")
    folder = tmp_path / os.fsdecode(name)
    folder.mkdir()
    (folder / "memory.max").write_text("70000\n")
    assert resources.usable_memory() == 70000
