"""Runs of any length: bounded memory, stopping anywhere, going on bit for bit."""

import errno
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tracemalloc
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar, final

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers.minimal_analysis import MinimalAnalysis, with_row_columns
from helpers.scene_listener import SceneListener
from mechanism_examples.shipped_mechanisms import four_bar_with_springs

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import AnalysisError, OutputError
from spherekit.runs import batch_runner, resource_checks, table_store
from spherekit.runs.contract import Findings
from spherekit.runs.run_folder import WORK, RunFolder
from spherekit.scenes.scene import Scene, Series
from spherekit.symbolic.compiler import available
from spherekit.tables import table_files
from spherekit.tables.table import ASSEMBLY_MODE, SAMPLE, Column, Table

try:
    import resource
except ImportError:  # Windows
    resource = None


def run_four_bar(folder=None, **options):
    """Run the poles of links 3 and 1 of the four-bar, 60 samples in blocks of 10."""
    options = {"samples": 60, "block": 10} | options
    return sk.run(sk.load("four_bar"), "poles:only=31", folder=folder, **options)


ENGINE = "compiled" if available() else "numpy"


def run_swinging_rocker(folder=None, engine=ENGINE, **options):
    """Simulate a four-bar driven at its rocker over dead centres, 10 samples per block."""
    mechanism = replace(sk.load("four_bar"), loads=()).with_inputs("41")
    options = {"samples": 60, "block": 10} | options
    start = {"start": sk.Start(2.0, 3.0), "duration": 1.5, "tolerance": 1e-8}
    output = {"engine": engine, "folder": folder}
    return sk.run(mechanism, "poles:only=31", **output, **start, **options)


def run_double_butterfly(folder=None, **options):
    """Run a mechanism whose loops are closed by Newton's method, in blocks of 7 samples."""
    options = {"search": False, "samples": 40, "block": 7} | options
    return sk.run("double_butterfly", "poles:only=31", folder=folder, **options)


def run_with_springs(folder=None, **options):
    """Run a four-bar with springs that count turns of their pairs, over several turns."""
    options = {"samples": 60, "block": 10, "folder": folder} | options
    return sk.run(four_bar_with_springs("32", "43"), "eksergian", **options)


def run_springs_by_law(folder=None, **options):
    """Run the four-bar with springs over 3 s at constant speed."""
    law = {"laws": {"21": sk.ConstantSpeed(-7.0, 1.0)}, "duration": 3.0}
    return run_with_springs(folder, **law, **options)


def run_springs_by_loads(folder=None, **options):
    """Simulate the four-bar with springs over 2 s."""
    start = {"start": sk.Start(0.3, 20.0), "duration": 2.0, "engine": ENGINE}
    return run_with_springs(folder, **start, **options)


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def contents(folder):
    """Return the bytes of all files of a folder; of the summary all but times."""
    bytes_by_name = {path.name: path.read_bytes() for path in Path(folder).iterdir()}
    summary = json.loads(bytes_by_name["summary.json"])
    for key in ("seconds", "predicted", "simulate"):
        summary["cost"].pop(key, None)
    del summary["signature"]  # of these times too
    return bytes_by_name | {"summary.json": summary}


def interrupt_after(number, is_last=False):
    """Return a progress function that interrupts a run, as Ctrl-C does, after `number`
    blocks.

    `is_last` allows it to do so after the last block, too.
    """
    calls = []

    def progress(done, total):
        calls.append(done)
        if len(calls) == number and (done < total or is_last):
            raise KeyboardInterrupt

    return progress


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(
    "job",
    [
        run_four_bar,
        run_swinging_rocker,
        run_double_butterfly,
        run_with_springs,
        run_springs_by_law,
        run_springs_by_loads,
    ],
)
def test_stopped_after_every_block_it_ends_as_if_never_stopped(job, tmp_path):
    """A run interrupted after each block and resumed writes the files of one whole run.

    A block is a part of the samples. The files are equal byte by byte. `job` is one of the
    runs above, each of six blocks. `interrupt_after` returns a function that interrupts
    like Ctrl-C.
    """
    job(tmp_path / "whole")
    folder = tmp_path / "resumed"
    stops = 0
    is_finished = False
    while not is_finished:
        try:
            job(folder, unfinished="resume", progress=interrupt_after(1))
            is_finished = True
        except KeyboardInterrupt as stop:
            stops += 1
            assert re.fullmatch(r"\d+ of \d+ samples are done and saved in .*", note(stop))
            assert names_in(folder) == [WORK]
    assert stops == 5
    assert contents(folder) == contents(tmp_path / "whole")


def note(error):
    """Return the only note of an error."""
    (text,) = error.__notes__
    return text


KILLED = """
import os, sys
import spherekit as sk
def stop(done, total):
    if done >= int(sys.argv[2]):
        os.kill(os.getpid(), int(sys.argv[3]))
sk.run(
    sk.load("four_bar"), "poles:only=31", samples=60, block=10, folder=sys.argv[1],
    unfinished="resume", progress=stop,
)
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_a_killed_run_is_resumed_bit_for_bit(tmp_path):
    """A run that was killed twice (SIGKILL) ends with the files of one whole run.

    The program `KILLED` computes a run in blocks (parts of the samples), and kills itself
    after a stated number of samples. The journal is the record of what is complete. After
    each kill, the test puts files where the next block writes. The journal does not name
    these files, so the resumed run must overwrite them. `contents` returns the bytes of all
    files of a folder.
    """
    folder = tmp_path / "killed"
    for done in (20, 40):
        command = [
            sys.executable, "-c", KILLED, str(folder), str(done), str(signal.SIGKILL)
        ]  # fmt: skip
        assert subprocess.run(command, check=False).returncode == -signal.SIGKILL
        journal = json.loads((folder / WORK / "journal.json").read_text())
        assert journal["state"]["standing"]["done"] == done
        next_block = done // 10
        for table in ("motion.motion", "poles.poles"):
            part = folder / WORK / f"{table}.{next_block:06d}.parquet"
            part.write_bytes(b"a part that no journal knows")
            (folder / WORK / f".{part.name}.0a1b2c3d.part").write_bytes(b"half a part")
    run_four_bar(folder, unfinished="resume")
    run_four_bar(tmp_path / "whole")
    assert contents(folder) == contents(tmp_path / "whole")


STOPPED = """
import os, sys
from spherekit.runs import batch_runner as rows_at_once
from spherekit.cli import run
from spherekit.cli.main import main
rows_at_once.BLOCK_BYTES = 1 << 21
def stop(done, total):
    os.kill(os.getpid(), int(sys.argv[1]))
assert callable(run.make_sample_reporter)
run.make_sample_reporter = lambda: stop
sys.exit(main(sys.argv[2:]))
"""


def run_with_signal(number, handler, arguments):
    """Run a command that sends itself a signal after its first block.

    `handler` is how the process handles the signal when it starts.
    """
    return subprocess.run(
        [sys.executable, "-c", STOPPED, str(int(number)), *arguments],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: signal.signal(number, handler),
    )


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.skipif(os.name != "posix", reason="needs signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_a_run_and_prints_the_command_to_resume_it(
    number, tmp_path, capsys, monkeypatch
):
    """After SIGINT or SIGTERM a run prints what is done and the command to go on.

    Exit status 128 + number says which signal it was. The same command without `--resume`
    is refused, because the folder has an unfinished run. The printed command completes the
    run; its files are those of an uninterrupted one.

    `run_with_signal` starts the run in another process, which sends itself the signal after
    the first block of samples. The run is completed in the process of this test.
    """
    # The blocks of this process are small (2 MB), so that the rest of the run has many.
    monkeypatch.setattr(batch_runner, "BLOCK_BYTES", 1 << 21)
    folder = tmp_path / "with space"
    arguments = ["run", "four_bar", "-a", "poles:only=31", "--samples", "80000", "-o"]
    # Shells start jobs in the background with SIGINT ignored; the default is needed here.
    process = run_with_signal(number, signal.SIG_DFL, [*arguments, str(folder)])
    assert process.returncode == 128 + number
    assert process.stdout == ""
    assert "Traceback" not in process.stderr
    (line,) = process.stderr.splitlines()
    match = re.match(r"spherekit: stopped; (\d+) of 80000 samples are done and saved", line)
    assert match
    assert 0 < int(match[1]) < 80000
    resume_command = shlex.split(line.partition("go on with: ")[2])
    assert resume_command == ["spherekit", *arguments, str(folder), "--resume"]
    assert main([*arguments, str(folder)]) == 1
    assert "continue it with --resume" in capsys.readouterr().err
    assert main(resume_command[1:]) == 0
    assert main([*arguments, str(tmp_path / "whole"), "-q"]) == 0
    assert contents(folder) == contents(tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_a_run_in_the_background_of_a_shell_ignores_ctrl_c(tmp_path):
    """A run started with SIGINT ignored, as shells start background jobs, leaves it so."""
    arguments = ["run", "four_bar", "-a", "poles:only=31", "--samples", "9000", "-o"]
    process = run_with_signal(signal.SIGINT, signal.SIG_IGN, [*arguments, str(tmp_path)])
    assert process.returncode == 0, process.stderr
    assert contents(tmp_path)["summary.json"]["samples"] == 9000


@pytest.mark.slow
def test_a_full_disk_keeps_what_is_done(tmp_path, monkeypatch):
    """If the disk is full after some blocks of samples, the run can be resumed from there.

    `os.fsync`, which writes a file to the disk, fails from its 21st call on, so that some
    blocks of 10 samples are complete.
    """
    sync_count = 0
    fsync = os.fsync

    def fail_when_full(handle):
        nonlocal sync_count
        sync_count += 1
        if sync_count > 20:
            raise OSError(errno.ENOSPC, "")
        fsync(handle)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", fail_when_full)
        with pytest.raises(OutputError, match="the disk is full") as error:
            run_four_bar(tmp_path / "full", samples=200)
    done = int(note(error.value).partition(" of ")[0])
    assert 10 <= done < 200
    run_four_bar(tmp_path / "full", samples=200, unfinished="resume")
    run_four_bar(tmp_path / "whole", samples=200)
    assert contents(tmp_path / "full") == contents(tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.skipif(resource is None, reason="needs limits of files")
def test_a_run_that_fails_at_its_end_leaves_the_older_results(tmp_path):
    """If a table cannot be written, older results stay and the new run can be resumed.

    A limit of 20 kB per file is set: blocks fit, the whole table does not.
    """
    run_four_bar(tmp_path, samples=5)
    older = contents(tmp_path)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    try:
        with pytest.raises(OutputError, match="larger than this user"):
            run_four_bar(tmp_path, samples=130, unfinished="discard")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    work = tmp_path / WORK
    assert not list(work.rglob("*.part"))
    assert {path.name for path in work.iterdir()} > {"journal.json", "lock"}
    # Without the folder of the unfinished work, everything is as before.
    aside = tmp_path.parent / "aside"
    work.rename(aside)
    assert contents(tmp_path) == older
    aside.rename(work)
    run_four_bar(tmp_path, samples=130, unfinished="resume")
    assert contents(tmp_path)["summary.json"]["samples"] == 130


def test_a_run_that_needs_more_disk_than_there_is_is_refused(tmp_path, monkeypatch):
    """With 20 kB of free disk the run is refused before it starts, with its need."""
    usage = SimpleNamespace(free=20_000)
    monkeypatch.setattr(resource_checks.shutil, "disk_usage", lambda path: usage)
    with pytest.raises(OutputError, match=r"about .* kB.*20 kB left.*--format parquet"):
        run_four_bar(tmp_path)


def test_two_runs_do_not_write_into_one_folder(tmp_path, capsys):
    """While one process has a folder open, runs of others are refused and write nothing."""
    with RunFolder.open(tmp_path):
        with pytest.raises(OutputError, match=rf"process {os.getpid()} on .* is writing"):
            run_four_bar(tmp_path)
        with pytest.raises(OutputError, match="is writing there"):
            run_four_bar().write(tmp_path)
        assert main(["run", "four_bar", "--samples", "3", "-o", str(tmp_path)]) == 1
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and "choose another folder" in message
    assert list(tmp_path.iterdir()) == []
    run_four_bar(tmp_path)


@pytest.mark.slow
def test_work_of_another_run_is_refused_with_what_differs(tmp_path):
    """Unfinished work is continued only by the same run; otherwise the difference is named.

    A run is interrupted after two blocks of samples. Other runs into its folder are
    refused. `unfinished="discard"` starts anew.
    """
    with pytest.raises(KeyboardInterrupt):
        run_four_bar(tmp_path, progress=interrupt_after(2))
    with pytest.raises(OutputError, match="after 20 of 60 samples; continue it with"):
        run_four_bar(tmp_path)
    for options, difference in [
        ({"samples": 61}, "samples: 60 there, 61 now"),
        ({"block": 5}, "samples in a block: 10 there, 5 now"),
        ({"assembly_mode": 1}, "assembly modes: "),
        ({"path": np.linspace(0, 1, 60)}, "other values of the inputs"),
        ({"duration": 1.0}, "over time: false there, true now"),
    ]:
        for unfinished in ("refuse", "resume"):
            with pytest.raises(OutputError, match=f"different run .*{difference}"):
                run_four_bar(tmp_path, unfinished=unfinished, **options)
    with pytest.raises(OutputError, match="mechanism: four_bar there, stephenson now"):
        sk.run(sk.load("stephenson"), "poles", folder=tmp_path, unfinished="resume")
    with pytest.raises(OutputError, match="unfinished work"):
        run_four_bar().write(tmp_path)
    run_four_bar(tmp_path, samples=61, unfinished="discard")
    assert contents(tmp_path)["summary.json"]["samples"] == 61


def test_the_first_difference_of_long_options_is_in_the_message(tmp_path):
    """The analyses of both runs as JSON begin with the same 60 characters."""
    options = {"samples": 20, "block": 10, "folder": tmp_path}
    with pytest.raises(KeyboardInterrupt):
        interrupt = interrupt_after(1)
        sk.run("four_bar", "poles:only=31+42,chart=x", progress=interrupt, **options)
    with pytest.raises(OutputError, match=r'"chart": "x".* there, .*"chart": "y".* now'):
        sk.run("four_bar", "poles:only=31+42,chart=y", **options)


def test_other_rates_at_the_same_times_are_named(tmp_path):
    """The laws t and t^3 have the same values at the times 0 and 1, but other rates."""
    options = {"samples": 2, "block": 1, "duration": 1.0, "folder": tmp_path}
    with pytest.raises(KeyboardInterrupt):
        law = {"21": sk.Polynomial((0.0, 1.0))}
        sk.run("four_bar", "poles", laws=law, progress=interrupt_after(1), **options)
    law = {"21": sk.Polynomial((0.0, 0.0, 0.0, 1.0))}
    with pytest.raises(OutputError, match=r"run \(other times .* or rates of the inputs\)"):
        sk.run("four_bar", "poles", laws=law, **options)


@pytest.mark.parametrize("figures", [{10: 1, 2: 3}, {1: 2, "b": 3}])
def test_findings_with_numbers_as_keys_are_resumed(figures, tmp_path):
    """A run can be resumed if its findings are a dictionary with numbers as keys.

    Findings are results besides the tables. An interrupted run stores them as JSON, which
    turns the keys into text. The findings of the next block have numbers as keys, and must
    still count as equal to the stored ones. `figures` is the dictionary. Checksums of a run
    sort the keys. As text, the keys 10 and 2 have another order than as numbers, and 1 and
    "b" can be sorted only as text.
    """

    @dataclass(frozen=True, kw_only=True)
    class Numbered(MinimalAnalysis):
        """Analysis for tests with numbers as keys of its findings."""

        name: ClassVar = "numbered"
        rowwise: ClassVar = True
        tables: ClassVar = (Table("t", "of a test", (Column("x", "", "a number"),)),)

        def compute(self, batch):
            return {"t": {"x": np.zeros(len(batch))}}

        def findings(self, batch):
            return Findings({"count": figures})

    options = {"samples": 20, "block": 10, "folder": tmp_path}
    with pytest.raises(KeyboardInterrupt):
        sk.run("four_bar", Numbered(), progress=interrupt_after(1), **options)
    result = sk.run("four_bar", Numbered(), unfinished="resume", **options)
    (entry,) = result.summary["analyses"]
    assert json.loads(json.dumps(entry["findings"]["count"])) == {
        str(key): number for key, number in figures.items()
    }


def test_a_folder_that_is_removed_during_a_run_is_an_error_in_words(tmp_path):
    folder = tmp_path / "run"
    with pytest.raises(OutputError, match="cannot be written"):
        run_four_bar(folder, progress=lambda done, total: shutil.rmtree(folder))


@pytest.mark.parametrize(
    "damage, words",
    [
        (lambda work: (work / "journal.json").write_text(""), "cannot be read"),
        (lambda work: (work / "journal.json").write_text("[" * 9999), "cannot be read"),
        (lambda work: change_done_count(work / "journal.json"), "checksum"),
        (lambda work: next(work.glob("poles*")).unlink(), "No such file"),
        (lambda work: flip_bit(next(work.glob("poles*")), 0.05), "damaged"),
        (lambda work: flip_bit(next(work.glob("poles*")), 0.1), "damaged"),
        (lambda work: flip_bit(next(work.glob("motion*")), 0.05), "damaged"),
        (lambda work: os.truncate(next(work.glob("motion*")), 100), "damaged"),
    ],
)
def test_damaged_unfinished_work_is_refused(damage, words, tmp_path, capsys):
    """A damaged journal or part of unfinished work is noticed; --restart discards it.

    The journal records what is complete, with checksums. `damage` gets the folder of the
    work.
    """
    with pytest.raises(KeyboardInterrupt):
        run_four_bar(tmp_path, progress=interrupt_after(2))
    damage(tmp_path / WORK)
    with pytest.raises(OutputError, match=f"cannot continue.*{words}.*--restart"):
        run_four_bar(tmp_path, unfinished="resume")
    options = ["-a", "poles:only=31", "--samples", "60", "-q", "-o", str(tmp_path)]
    assert main(["run", "four_bar", *options, "--restart"]) == 0
    assert "summary.json" in names_in(tmp_path) and WORK not in names_in(tmp_path)


def flip_bit(path, fraction):
    """Flip a bit of a file at a fraction of its length."""
    data = bytearray(path.read_bytes())
    data[int(fraction * len(data))] ^= 4
    path.write_bytes(data)


def change_done_count(path):
    """Write a wrong number of finished samples into a journal."""
    text = path.read_text()
    path.write_text(text.replace('"done": 20', '"done": 30'))


@pytest.mark.parametrize("job", [run_four_bar, run_swinging_rocker, run_springs_by_law])
def test_memory_and_folder_give_the_same_bits(job, tmp_path):
    """A run in memory, written later, and a run into a folder have equal files and tables.

    `job` is one of the runs above. `contents` returns the bytes of all files of a folder.
    """
    in_memory = job()
    streamed = job(tmp_path / "streamed")
    in_memory.write(tmp_path / "written")
    streamed_files = contents(tmp_path / "streamed")
    assert streamed_files == contents(tmp_path / "written")
    assert sorted(path.name for path in streamed.files) == sorted(streamed_files)
    for name, result in in_memory.results.items():
        for table in result.tables:
            for degrees in (False, True):
                pd.testing.assert_frame_equal(
                    in_memory.frame(name, table.name, degrees),
                    streamed.frame(name, table.name, degrees),
                    check_exact=True,
                )


def test_csv_has_no_negative_zero(tmp_path):
    """The torques of a bevel pair include zeros, which are written without a sign."""
    sk.run("bevel_pair", "statics", samples=3, folder=tmp_path / "statics")
    rows = (tmp_path / "statics" / "statics_outputs.csv").read_text().splitlines()
    assert len(rows) > 1 and not any("-0" in row.split(",") for row in rows)


@final
@dataclass(frozen=True, kw_only=True)
class AnalysisWithTexts(MinimalAnalysis):
    """An analysis with a table of texts that CSV has to quote, and two further tables.

    It tests how tables are written. The table "plain" has no column of assembly modes, and
    the table "empty" has no rows. The parameter `plain` does not refer to the table
    "plain". If it is True, the texts of the table "words" need no quotes.
    """

    name: ClassVar = "words"
    rowwise: ClassVar = True  # each sample is computed by itself
    tables: ClassVar = (
        Table(
            "words", "texts", (SAMPLE, ASSEMBLY_MODE, Column("word", "", "a text", "text"))
        ),
        Table("plain", "no assembly modes", (Column("x", "", "a number"),)),
        Table("empty", "no rows", (SAMPLE, ASSEMBLY_MODE, Column("y", "", "no number"))),
    )
    plain: bool = False

    def compute(self, batch):
        """Return the columns of the three tables for a block of samples.

        The frame of a table stores the distinct texts in alphabetical order. Here they
        first occur in another order. If both orders were mixed up, rows would get wrong
        texts, and tests with this analysis would fail. The text changes after every five
        samples, so that later blocks of a run have texts that are new there.
        """
        # `plain` says whether the texts of the table "words" need no quotes in CSV. The
        # table "plain" has no texts.
        if self.plain:
            texts = ["b", "a", "zz"]
        else:
            texts = ['a "b"', "c,d", "é\nf", " a"]
        column = []
        for sample in batch.sample.tolist():
            number = sample // 5 % len(texts)
            column.append(texts[number])
        no_rows = np.zeros(0)
        return {
            "words": with_row_columns(batch, word=column),
            "plain": {"x": batch.sample},
            "empty": {"sample": no_rows, "assembly_mode": no_rows, "y": no_rows},
        }

    def scene(self, batch):
        """Return a page for each assembly mode, with a plot of the inputs."""
        rows = batch.assembly_mode_rows().items()
        return tuple(
            Scene(mode, (Series("s", label="s", group="g", values=batch.q[mode_rows]),))
            for mode, mode_rows in rows
        )


@final
@dataclass(frozen=True, kw_only=True)
class AnalysisOfAllSamples(MinimalAnalysis):
    """The analysis with texts as one that needs all samples at once."""

    name, tables, compute = (
        AnalysisWithTexts.name,
        AnalysisWithTexts.tables,
        AnalysisWithTexts.compute,
    )
    plain: bool = False


@pytest.mark.parametrize("plain", [True, False])
def test_a_run_that_writes_blocks_has_the_files_of_a_run_in_memory(plain, tmp_path):
    """A run of 25 samples in blocks of 4 writes its rows block by block if it has a folder.

    Otherwise all rows stay in memory until `write`. `plain` texts need no quotes in CSV.
    """
    analysis = AnalysisWithTexts(plain=plain)
    sk.run("four_bar", analysis, samples=25, block=4, folder=tmp_path / "in_blocks")
    in_memory = sk.run("four_bar", analysis, samples=25, block=4)
    in_memory.write(tmp_path / "at_once")
    assert contents(tmp_path / "in_blocks") == contents(tmp_path / "at_once")


@pytest.mark.parametrize("plain", [True, False])
def test_any_text_survives(plain, tmp_path):
    """Texts with quotes, commas and line ends are equal in memory, in files and read again.

    `plain` texts need no quotes in CSV.
    """
    analysis = AnalysisWithTexts(plain=plain)
    in_memory = sk.run("four_bar", analysis, samples=25, block=4)
    expected_texts = list(in_memory.frame("words")["word"])

    in_files = sk.run("four_bar", analysis, samples=25, block=4, folder=tmp_path / "a")
    assert list(in_files.frame()["word"]) == expected_texts
    read_by_pandas = pd.read_csv(tmp_path / "a" / "words.csv")
    assert list(read_by_pandas["word"]) == expected_texts


def test_rows_of_a_run_in_blocks_are_in_the_order_of_assembly_modes():
    run = sk.run("four_bar", AnalysisWithTexts(), samples=25, block=4)
    assert list(run.frame("words")["assembly_mode"]) == [0] * 25 + [1] * 25


def test_a_table_without_rows_becomes_a_file_with_a_header_only(tmp_path):
    sk.run("four_bar", AnalysisWithTexts(), samples=25, block=4, folder=tmp_path / "a")
    assert len(pd.read_csv(tmp_path / "a" / "words_empty.csv")) == 0


def test_whole_numbers_of_a_table_become_floats():
    """The analysis "words" fills the column x of its table "plain" with whole numbers."""
    run = sk.run("four_bar", AnalysisWithTexts(), samples=25, block=4)
    assert run.frame("words", "plain")["x"].dtype == float


def test_files_are_read_and_written_in_pieces(tmp_path, monkeypatch):
    """Files that are written in pieces of 32 rows have the table of an ordinary run.

    The run has 120 rows: 60 samples, in blocks of 10, in two assembly modes (ways to
    assemble the links). Pieces may end inside blocks and modes. The CSV file is written
    from the rows that are stored, which are read in pieces as well. It is compared with a
    run with pieces of the usual size.
    """
    for module in (table_store, table_files):
        monkeypatch.setattr(module, "CHUNK_ROWS", 32)
    run_four_bar(tmp_path)
    parquet = pq.ParquetFile(tmp_path / "motion.parquet")
    rows = [parquet.metadata.row_group(k).num_rows for k in range(parquet.num_row_groups)]
    assert rows == [32, 32, 32, 24]
    monkeypatch.undo()
    pd.testing.assert_frame_equal(
        pd.read_csv(tmp_path / "motion.csv", engine="pyarrow")[["assembly_mode", "q"]],
        run_four_bar().frame("motion")[["assembly_mode", "q"]],
        check_exact=True,
    )


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("job, count", [(run_four_bar, 5_000), (run_with_springs, 1_500)])
def test_memory_does_not_grow_with_the_samples(job, count, tmp_path, monkeypatch):
    """A run with four times as many samples does not keep the additional rows in memory.

    Rows are written to files, and only inputs stay in memory for all samples. For each
    additional sample the peak of memory may grow by five numbers of 8 bytes and by a tenth
    of the bytes of its rows. Afterwards the library Arrow has less than 1 MB more than
    before. `count` is the smaller number of samples.
    """
    for module in (table_store, table_files):
        monkeypatch.setattr(module, "CHUNK_ROWS", 1024)

    # The same for all runs, so that a block adds the same memory to each of them. The
    # compared runs have two blocks and eight.
    samples_in_block = count // 2

    def measure(samples):
        """Return the peak of memory, the growth of Arrow's memory, and the size of tables.

        All three are in bytes. They belong to one run with this many samples, which `job`
        makes.
        """
        pool = pa.default_memory_pool()
        arrow_bytes_before = pool.bytes_allocated()
        tracemalloc.start()
        try:
            result = job(tmp_path / str(samples), samples=samples, block=samples_in_block)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert result.summary["samples"] == samples
        table_bytes = 0
        for table in result.summary["cost"]["tables"].values():
            table_bytes += 8 * table["rows"] * table["columns"]
        arrow_growth = pool.bytes_allocated() - arrow_bytes_before
        return peak, arrow_growth, table_bytes

    measure(count // 5)  # imports and caches
    small_peak, _, small_table_bytes = measure(count)
    large_peak, arrow_bytes, large_table_bytes = measure(4 * count)
    additional_samples = 3 * count
    permitted_input_bytes = 5 * 8 * additional_samples
    additional_bytes = large_table_bytes - small_table_bytes
    assert large_peak - small_peak < permitted_input_bytes + 0.1 * additional_bytes
    assert arrow_bytes < 1e6


@pytest.mark.slow
def test_the_engine_that_began_goes_on(tmp_path):
    """A simulation begun with NumPy is resumed with NumPy if the choice is automatic."""
    with pytest.raises(KeyboardInterrupt):
        run_swinging_rocker(tmp_path, engine="numpy", progress=interrupt_after(1))
    result = run_swinging_rocker(tmp_path, engine="auto", unfinished="resume")
    assert result.summary["simulation"]["engine"]["name"] == "numpy"


def test_an_analysis_of_all_samples_is_not_resumed(tmp_path):
    """On resuming, an analysis that needs all samples at once starts from the first one.

    The run is interrupted when its 361 samples are done and before the table "words" of the
    analysis is computed. After resuming, the analysis gets all 361 samples in one block,
    and its table has a row for each of them in both assembly modes (ways to assemble the
    links).
    """
    # The samples form a single block. With `is_last` the run is interrupted after it.
    interrupt = interrupt_after(1, is_last=True)
    with pytest.raises(KeyboardInterrupt) as error:
        sk.run(
            sk.load("four_bar"),
            AnalysisOfAllSamples(),
            folder=tmp_path,
            progress=interrupt,
        )
    assert "361 of 361 samples are done and saved" in note(error.value)
    result = sk.run(
        sk.load("four_bar"), AnalysisOfAllSamples(), folder=tmp_path, unfinished="resume"
    )
    assert result.summary["samples_in_a_block"] == 361
    assert len(result.frame("words")) == 722


def test_an_analysis_of_all_samples_needs_memory_for_them(monkeypatch, capsys):
    """If memory (here 100 MB) is too small for all samples, the run is refused."""
    monkeypatch.setattr(resource_checks, "usable_memory", lambda: 10**8)
    with pytest.raises(AnalysisError, match=r"words needs all samples at once.* 100 MB"):
        sk.run(sk.load("four_bar"), AnalysisOfAllSamples(), samples=50_000)
    assert main(["explain", "four_bar", "-a", "singularities", "-a", "eksergian"]) == 0
    printed = capsys.readouterr().out
    assert "singularities can only be computed from all samples at once" in printed
    assert "of memory for each sample of each assembly mode" in printed


def test_tables_that_were_not_kept_cannot_be_read(tmp_path):
    """Reading tables is an error if they are neither in memory nor in a readable format."""
    bare = run_four_bar(tables=False)
    assert bare.summary["status"] == {"OK": 120}
    for read in (bare.frame, lambda: bare.write(tmp_path)):
        with pytest.raises(AnalysisError, match="kept no tables"):
            read()
    with pytest.raises(AnalysisError, match="kept no tables"):
        run_four_bar(tmp_path, formats=("csv",)).frame()


def recorded_samples(listener):
    """Return the list of samples of each primitive that was recorded on a page."""
    return [
        samples
        for (page_name, _), samples in listener.samples_by_primitive.items()
        if page_name is not None
    ]


def test_a_long_recording_has_one_of_many_samples(monkeypatch, capsys, tmp_path):
    """A recording with at most 10 samples has each fifth of 45 samples, and the last.

    The tables of the run have all samples. `recorded_samples` returns the samples of each
    drawn object of the recording.
    """
    from spherekit.runs import recording_session

    monkeypatch.setattr(recording_session, "MAX_RECORDED_SAMPLES", 10)
    listener = SceneListener()
    result = run_four_bar(samples=45, recorder=listener)
    expected = [0, 5, 10, 15, 20, 25, 30, 35, 40, 44]
    assert all(samples == expected for samples in recorded_samples(listener))
    assert len(listener.inputs) == 10
    assert listener.properties["logged"] == "one of 5 successive samples"
    # One of 5 samples is recorded, from sample 0 on.
    assert result.summary["recording"] == {"one_of": 5, "from_sample": 0}
    assert len(result.frame("motion")) == 90  # 45 samples of two assembly modes
    arguments = ["run", "four_bar", "--samples", "50", "--save", str(tmp_path / "x.rrd")]
    assert main(arguments) == 0
    assert "only one of every 5 samples of each assembly mode" in capsys.readouterr().out


def test_log_every_chooses_the_recorded_samples(monkeypatch):
    """`log_every=1` records all samples, also above the limit; a grid keeps its order."""
    from spherekit.runs import recording_session

    monkeypatch.setattr(recording_session, "MAX_RECORDED_SAMPLES", 10)
    listener = SceneListener()
    run_four_bar(samples=45, recorder=listener, log_every=1)
    assert all(len(samples) == 45 for samples in recorded_samples(listener))
    grid = SceneListener()
    sk.run("five_bar", samples=(3, 4), assembly_mode=0, recorder=grid, log_every=2)
    assert all(samples == [0, 2, 4, 6, 8, 10] for samples in recorded_samples(grid))
    assert grid.row == 2
    with pytest.raises(AnalysisError, match="log_every must be at least 1"):
        run_four_bar(recorder=SceneListener(), log_every=0)


def test_a_resumed_recording_says_where_it_begins(tmp_path):
    """A recording of a resumed run has the samples from there on, and says so."""
    with pytest.raises(KeyboardInterrupt):
        run_four_bar(tmp_path, progress=interrupt_after(2))
    listener = SceneListener()
    result = run_four_bar(tmp_path, unfinished="resume", recorder=listener)
    assert all(own == list(range(20, 60)) for own in recorded_samples(listener))
    assert result.summary["recording"]["from_sample"] == 20
    assert "before 20" in listener.properties["resumed"]


def test_two_runs_do_not_record_into_one_file(tmp_path):
    from spherekit.display.rerun.recorder import RerunRecorder

    path = tmp_path / "x.rrd"
    with RerunRecorder("four_bar", path=path) as first:
        with (
            pytest.raises(OutputError, match="another run is recording there"),
            RerunRecorder("four_bar", path=path),
        ):
            pass
        run_four_bar(recorder=first)
    assert path.stat().st_size > 10_000


def test_much_csv_is_written_when_asked_for(tmp_path, monkeypatch):
    """If a CSV file would be too large, only Parquet is written, unless CSV is asked for.

    The summary says so. The limit is set to 10 kB; a run with two samples is below it.
    """
    monkeypatch.setattr("spherekit.tables.table_formats.MAX_CSV_BYTES", 1e4)
    default = sk.run("four_bar", samples=40, folder=tmp_path / "one")
    with_csv = sk.run("four_bar", samples=40, folder=tmp_path / "two", formats=["csv"])
    short = sk.run("four_bar", samples=2, folder=tmp_path / "three")
    assert not (tmp_path / "one/poles.csv").exists()
    assert (tmp_path / "one/poles.parquet").exists()
    assert any("--format both" in text for text in default.summary["remarks"])
    for folder, result in ("two", with_csv), ("three", short):
        assert (tmp_path / folder / "poles.csv").exists()
        assert not any("--format both" in text for text in result.summary["remarks"])


def samples_per_block(analyses, samples):
    """Return how many samples each block of a run of the four-bar has."""
    done = [0]
    sk.run(
        "four_bar", analyses, samples=samples, tables=False,
        progress=lambda count, total: done.append(count),
    )  # fmt: skip
    return np.diff(done)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(
    ("analysis", "most"),
    [("eksergian", 16384), ("reactions", 16384), ("dynamics", 16384), ("statics", 16384)],
)
def test_blocks_of_frames_stay_small(analysis, most):
    """Analyses with frames of all links, some kB per row, have blocks of at most `most`
    samples.
    """
    assert max(samples_per_block(analysis, 40000)) <= most
