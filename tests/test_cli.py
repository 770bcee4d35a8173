"""The command line as a stranger uses it: every command, statuses, words on stderr."""

import json
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
from helpers.refusals import TABLES, check_fragments
from oracles.lecture_table import LECTURE_TABLE

import spherekit as sk
from spherekit import progress
from spherekit.cli.main import main
from spherekit.cli.progress_bar import make_sample_reporter
from spherekit.cli.run_report import duration
from spherekit.errors import ModelError

ROOT = Path(__file__).parent.parent


def run(capsys, *arguments):
    status = main([str(word) for word in arguments])
    out, err = capsys.readouterr()
    return status, out, err


def test_plan_prints_the_published_table_of_poles(capsys):
    """The command `plan` prints the published order in which poles are found.

    A pole is the axis of the relative rotation of two links. The table for the Stephenson
    mechanism is that of Di Gregorio 2019 (`LECTURE_TABLE`). It is printed as text, as JSON
    and as Markdown.
    """
    status, out, err = run(capsys, "plan", "stephenson")
    assert (status, err) == (0, "")
    assert [line.split()[1:] for line in out.splitlines()[2:8]] == LECTURE_TABLE

    _, out, _ = run(capsys, "plan", "stephenson", "--json")
    assert json.loads(out)["table"] == LECTURE_TABLE

    _, out, _ = run(capsys, "plan", "stephenson", "--markdown")
    _, second_line, *rows = out.splitlines()
    assert second_line == "|---|---|---|---|---|---|---|"
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    assert [row[1:] for row in cells] == LECTURE_TABLE


def test_plan_for_one_pole_leaves_out_the_others(capsys):
    _, out, _ = run(capsys, "plan", "stephenson", "--for", "3/1", "--steps")
    assert "P51" not in out


@pytest.mark.parametrize("name", ["flat_cam", "two_contacts"])
def test_the_legend_of_a_plan_names_contact_planes(capsys, name):
    _, out, _ = run(capsys, "plan", name)
    assert "poles of earlier passes, or in contact planes, intersect" in out


def test_the_legend_of_a_plan_explains_only_marks_of_its_table(capsys):
    """The pole of the output and the carrier is an axis that coaxial pairs share."""
    _, out, _ = run(capsys, "plan", "planetary_bevel", "--for", "output/carrier")
    assert "common axis of coaxial pairs" in out
    assert "x: known from the start" not in out


@pytest.mark.parametrize(
    ("words", "suggested"),
    [
        (["four_bar", "--input", "41"], "four_bar --input 41"),
        (["five_bar", "--lock", "21=30deg"], "five_bar --lock 21=30deg"),
        # A run drives all inputs of the file, not only the one of the plan.
        (["five_bar", "--input", "21"], "five_bar"),
    ],
)
def test_the_run_that_a_plan_suggests_is_of_the_same_mechanism(capsys, words, suggested):
    _, out, _ = run(capsys, "plan", *words)
    assert f"spherekit run {suggested}  " in out


@pytest.mark.parametrize("json_option", [[], ["--json"]])
def test_a_quiet_run_does_not_print_the_outcome_of_the_proof(capsys, tmp_path, json_option):
    words = ("run", "four_bar", "--samples", 3, "--prove", *json_option)
    _, out, err = run(capsys, *words)
    assert "were compared with proven values" in (err if json_option else out)
    _, out, err = run(capsys, *words, "-o", tmp_path / "proof", "--quiet")
    assert "compared" not in out
    assert err == ""


@pytest.mark.slow
def test_links_without_relative_motion_are_no_failure_of_a_strict_run(capsys):
    summary = sk.run("miura_unit", samples=3).summary
    assert summary["pole_status"]["NO_POLE"] > 0
    assert run(capsys, "run", "miura_unit", "--samples", 3, "--strict")[0] == 0


@pytest.mark.parametrize("command", TABLES["told by commands"])
def test_commands_tell(command, capsys):
    status, out, _ = run(capsys, *command.split())
    assert status == 0
    check_fragments(out, TABLES["told by commands"][command])


def test_validate_good_and_bad(capsys, tmp_path):
    bad = tmp_path / "bad.toml"
    bad.write_text('format = 1\nname = "x"\nangle_unit = "grad"\n')
    status, out, err = run(capsys, "validate", "four_bar", bad, "watt")
    assert status == 1
    assert re.findall(r"^(\w+): valid mechanism", out, re.M) == ["four_bar", "watt"]
    assert "bad.toml" in err and "angle_unit" in err
    assert "  2 assembly modes; named: mode 0 (p1), mode 1 (p0)\n" in out
    _, out, _ = run(capsys, "validate", "five_bar")
    assert (
        "2 assembly modes on the straight path through the ranges of all inputs; a" in out
    )
    status, out, _ = run(capsys, "validate", "four_bar", "--json")
    assert json.loads(out)["groups"] == ["dyad"]


def test_mechanisms_lists_all_with_their_source(capsys):
    _, out, _ = run(capsys, "mechanisms", "--json")
    rows = json.loads(out)
    files = (ROOT / "mechanisms").glob("*.toml")
    assert len(rows) == sum(not path.stem.endswith(".study") for path in files)
    assert all(row["source"] for row in rows)


def test_run_writes_tables_and_recording(capsys, tmp_path):
    status, out, err = run(
        capsys, "run", "four_bar", "--samples", 13, "-o", tmp_path,
        "--save", tmp_path / "a.rrd", "--deg",
    )  # fmt: skip
    assert status == 0
    assert "2 assembly modes, both exist over the whole range: 0 (p1), 1 (p0)" in out
    assert "recording " in out and not err
    frame = pd.read_csv(tmp_path / "poles.csv")
    assert frame["q [deg]"].max() == 360.0
    assert (tmp_path / "a.rrd").stat().st_size > 10_000


def test_statuses_of_run(capsys):
    assert run(capsys, "run", "four_bar", "--samples", 5)[0] == 0
    assert run(capsys, "run", "four_bar", "--samples", 5, "--strict")[0] == 0
    lost = ("run", "four_bar", "--input", "43", "--samples", 9)
    assert run(capsys, *lost)[0] == 0 and run(capsys, *lost, "--strict")[0] == 3
    assert run(capsys, "run", "no_such_mechanism")[0] == 1
    assert run(capsys, "run", "four_bar", "-a", "pols")[0] == 1
    assert run(capsys, "run", "four_bar", "--assembly-mode", 9)[0] == 1
    for wrong in (["run"], ["run", "four_bar", "--samples", "0"]):
        with pytest.raises(SystemExit) as caught:
            main(wrong)
        assert caught.value.code == 2


def test_errors_are_traced_when_asked_for():
    with pytest.raises(Exception, match="four_bra"):
        main(["run", "four_bra", "--traceback"])


@pytest.mark.slow
def test_view_says_what_to_do_without_display(capsys, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    status, _, err = run(capsys, "view", tmp_path)
    assert (status, "holds no recording" in err) == (1, True)
    status, _, err = run(capsys, "view", tmp_path / "none.rrd")
    assert (status, "No such file" in err) == (1, True)
    out = run(capsys, "run", "four_bar", "--samples", 3, "-o", tmp_path, "--view", "-q")
    assert out[0] == 0
    status, _, err = run(capsys, "view", tmp_path)
    assert (status, "--png" in err) == (0, True)


def start_serving_run(*words):
    """Start the command `run --serve`, which serves its recording, in another process.

    Returns
    -------
    process, port
        Process, and a free port at which it serves its recording.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    process = subprocess.Popen(
        [sys.executable, "-m", "spherekit", "run", *words, "--serve", str(port)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # Shells that start jobs in the background ignore the interrupt signal, and a child
        # process would inherit this.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    return process, port


@pytest.mark.slow
def test_a_served_run_can_be_reached_and_ends_with_an_interrupt():
    """A finished run prints its address, accepts viewers, and exits with 0 on Ctrl-C.

    `start_serving_run` starts the command in another process.
    """
    process, port = start_serving_run("four_bar", "--samples", "20")
    try:
        first_lines = [process.stderr.readline(), process.stderr.readline()]
        socket.create_connection(("127.0.0.1", port), 5.0).close()
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
    url = f"rerun+http://127.0.0.1:{port}/proxy"
    assert first_lines[0] == f"serving at {url}; open it with: rerun {url}\n"
    # The line can come after another one, and is then in the rest of the output.
    assert "the run is done" in first_lines[1] + err
    # Each mode has a number and, in brackets, the name that the source gives to it.
    assert "2 assembly modes, both exist over the whole range: 0 (p1), 1 (p0)" in out
    assert process.returncode == 0
    assert "Traceback" not in err


SERVED_LONG = [
    ("four_bar", "--samples", "2000000", "-a", "poles"),
    ("four_bar", "--samples", "2000000", "-a", "singularities", "-a", "poles"),
    ("stephenson", "--samples", "1000000", "--deg"),
    ("five_bar", "--samples", "700x700"),
    ("four_bar", "-a", "eksergian", "--start", "q=0.3rad,dq=1rad/s", "--duration", "4000"),
    ("four_bar", "--samples", "2000000", "--verify"),
]


@pytest.mark.slow
@pytest.mark.parametrize("words", SERVED_LONG)
def test_a_long_run_prints_its_address_before_it_computes(words):
    """Viewers can connect to a run of several minutes while it is at work.

    `start_serving_run` starts the command in another process. The test connects to the
    printed address, and then interrupts the command as Ctrl-C does. The exit status must
    be 130.
    """
    process, port = start_serving_run(*words)
    try:
        first_line = process.stderr.readline()
        assert process.poll() is None
        socket.create_connection(("127.0.0.1", port), 5.0).close()
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
    finally:
        process.kill()
    assert first_line.startswith(f"serving at rerun+http://127.0.0.1:{port}/proxy")
    assert process.returncode == 130


def test_a_run_that_fails_leaves_no_empty_folder(tmp_path, capsys):
    new, old = tmp_path / "new", tmp_path / "old"
    old.mkdir()
    for folder in (new, old):
        assert main(["run", "four_bar", "--assembly-mode", "7", "-o", str(folder)]) == 1
    assert list(tmp_path.iterdir()) == [old]


def test_a_tolerance_that_is_not_met_counts_with_strict(capsys):
    words = ["run", "four_bar", "-a", "poles:only=31", "--samples", "5", "--tol"]
    assert main([*words, "1e-9", "--strict"]) == 0 and main([*words, "1e-30"]) == 0
    assert main([*words, "1e-30", "--strict"]) == 3


def test_long_times_are_whole_seconds():
    shown = {0.01234: "0.012", 9.96: "10", 99.4: "99", 99.6: "100", 918.4: "918"}
    assert {value: duration(value) for value in shown} == shown


def test_an_output_without_legs_says_so(tmp_path):
    text = (ROOT / "mechanisms" / "stephenson.toml").read_text()
    text += '\n[outputs.tool]\nlink = "6"\nxyz = [0.0, 0.0, 1.0]\n'
    path = tmp_path / "tool.toml"
    path.write_text(text)
    with pytest.raises(ModelError, match="no leg of two links joins the base"):
        sk.mid_plane_form(sk.load(path), "tool")


def test_progress_says_how_long_the_rest_will_take(monkeypatch):
    """The forecast of the remaining time counts only samples of this run.

    A resumed run had 200 samples before it began. Then 100 samples take 4 s, so that the
    remaining 700 take 28 s. The clock is replaced by `clock`.
    """
    clock = iter([0.0, 10.0, 14.0, 42.0])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(clock))
    reports = []
    with progress.progress_listener(reports.append):
        show = make_sample_reporter()  # reads the clock once
        for done in (200, 300, 1000):
            show(done, 1000)
    assert [report.text for report in reports] == [
        "computing: 200 of 1000 samples",
        "computing: 300 of 1000 samples, 28 s left",
        "computing: 1000 of 1000 samples, 0 s left",
    ]
    assert [report.share for report in reports] == [0.2, 0.3, 1.0]


def test_remaining_times_have_units_that_suit_them():
    assert progress.remaining_time_text(119.0) == "119 s left"
    assert progress.remaining_time_text(210.0) == "3.5 min left"
    assert progress.remaining_time_text(9000.0) == "2.5 h left"


def test_remaining_times_of_three_digits_are_written_in_full():
    assert progress.remaining_time_text(6000.0) == "100 min left"
    assert progress.remaining_time_text(7199.0) == "120 min left"
    assert progress.remaining_time_text(450000.0) == "125 h left"
