"""Runs of any length: bounded memory, stopping anywhere, going on bit for bit."""

import errno
import json
import os
import re
import shlex
import signal
import subprocess
import sys
import tracemalloc
from dataclasses import dataclass, replace
from pathlib import Path
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
from spherekit.runs.run_folder import WORK, RunFolder
from spherekit.scenes.scene import Scene, Series
from spherekit.symbolic.compiler import available
from spherekit.tables import table_files
from spherekit.tables.table import ASSEMBLY_MODE, SAMPLE, Column, Table

try:
    import resource
except ImportError:  # Windows
    resource = None


def four_bar(folder=None, **options):
    options = {"samples": 60, "block": 10} | options
    return sk.run(sk.load("four_bar"), "poles:only=31", folder=folder, **options)


ENGINE = "compiled" if available() else "numpy"


def swinging(folder=None, engine=ENGINE, **options):
    """A rocker that drives, over dead centres of its input."""
    made = replace(sk.load("four_bar"), loads=()).with_inputs("41")
    options = {"samples": 60, "block": 10} | options
    start = {"start": sk.Start(2.0, 3.0), "duration": 1.5, "tolerance": 1e-8}
    which = {"engine": engine, "folder": folder}
    return sk.run(made, "poles:only=31", **which, **start, **options)


def irreducible(folder=None, **options):
    options = {"search": False, "samples": 40, "block": 7} | options
    return sk.run("double_butterfly", "poles:only=31", folder=folder, **options)


def wound(folder=None, **options):
    """Springs that remember how often they were wound, over several turns."""
    options = {"samples": 60, "block": 10, "folder": folder} | options
    return sk.run(four_bar_with_springs("32", "43"), "eksergian", **options)


def wound_by_law(folder=None, **options):
    law = {"laws": {"21": sk.ConstantSpeed(-7.0, 1.0)}, "duration": 3.0}
    return wound(folder, **law, **options)


def wound_by_loads(folder=None, **options):
    start = {"start": sk.Start(0.3, 20.0), "duration": 2.0, "engine": ENGINE}
    return wound(folder, **start, **options)


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def contents(folder):
    """The bytes of all files; of the summary what is not a time."""
    found = {path.name: path.read_bytes() for path in Path(folder).iterdir()}
    summary = json.loads(found["summary.json"])
    for key in ("seconds", "predicted", "simulate"):
        summary["cost"].pop(key, None)
    del summary["signature"]  # of these times too
    return found | {"summary.json": summary}


def interrupt(number, is_last=False):
    """Stop a run after so many blocks, if others follow, as Ctrl-C does."""
    calls = []

    def progress(done, total):
        calls.append(done)
        if len(calls) == number and (done < total or is_last):
            raise KeyboardInterrupt

    return progress


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(
    "job", [four_bar, swinging, irreducible, wound, wound_by_law, wound_by_loads]
)
def test_stopped_after_every_block_it_ends_as_if_never_stopped(job, tmp_path):
    job(tmp_path / "whole")
    stops = 0
    while True:
        try:
            job(tmp_path / "again", unfinished="resume", progress=interrupt(1))
        except KeyboardInterrupt as stop:
            stops += 1
            assert re.fullmatch(r"\d+ of \d+ samples are done and kept in .*", note(stop))
            assert names_in(tmp_path / "again") == [WORK]
            continue
        break
    assert stops == 5
    assert contents(tmp_path / "again") == contents(tmp_path / "whole")


def note(error):
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
def test_killed_runs_go_on(tmp_path):
    """SIGKILL twice; what was written after the last journal is overwritten."""
    folder = tmp_path / "killed"
    for done in (20, 40):
        words = [sys.executable, "-c", KILLED, str(folder), str(done), str(signal.SIGKILL)]
        assert subprocess.run(words, check=False).returncode == -signal.SIGKILL
        state = json.loads((folder / WORK / "journal.json").read_text())["state"]
        assert state["standing"]["done"] == done
        for table in ("motion.motion", "poles.poles"):
            part = folder / WORK / f"{table}.{done // 10:06d}.parquet"
            part.write_bytes(b"a part that no journal knows")
            (folder / WORK / f".{part.name}.0a1b2c3d.part").write_bytes(b"half a part")
    four_bar(folder, unfinished="resume")
    four_bar(tmp_path / "whole")
    assert contents(folder) == contents(tmp_path / "whole")


STOPPED = """
import os, sys
from spherekit.runs import batch_runner as rows_at_once
from spherekit.cli import run
from spherekit.cli.main import main
rows_at_once.BLOCK_BYTES = 1 << 21
def stop(done, total):
    os.kill(os.getpid(), int(sys.argv[1]))
run.progress = lambda: stop
sys.exit(main(sys.argv[2:]))
"""


def signalled(number, handler, words):
    """Run a command that sends itself a signal, which is handled so from the start."""
    return subprocess.run(
        [sys.executable, "-c", STOPPED, str(int(number)), *words],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: signal.signal(number, handler),
    )


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.skipif(os.name != "posix", reason="needs signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_says_how_to_go_on(number, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(batch_runner, "BLOCK_BYTES", 1 << 21)
    folder = tmp_path / "with space"
    words = ["run", "four_bar", "-a", "poles:only=31", "--samples", "80000", "-o"]
    # Ignored, as by the shells that start jobs in the background, it would stay so.
    done = signalled(number, signal.SIG_DFL, [*words, str(folder)])
    assert done.returncode == 128 + number and done.stdout == ""
    assert "Traceback" not in done.stderr
    (line,) = done.stderr.splitlines()
    done = re.match(r"spherekit: stopped; (\d+) of 80000 samples are done and kept", line)
    assert done and 0 < int(done[1]) < 80000
    command = shlex.split(line.partition("go on with: ")[2])
    assert command == ["spherekit", *words, str(folder), "--resume"]
    assert main([*words, str(folder)]) == 1
    assert "go on with --resume" in capsys.readouterr().err
    assert main(command[1:]) == 0 and main([*words, str(tmp_path / "whole"), "-q"]) == 0
    assert contents(folder) == contents(tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs signals")
def test_a_run_in_the_background_of_a_shell_ignores_ctrl_c(tmp_path):
    """Shells start such jobs with SIGINT ignored, and programs leave it so."""
    words = ["run", "four_bar", "-a", "poles:only=31", "--samples", "9000", "-o"]
    done = signalled(signal.SIGINT, signal.SIG_IGN, [*words, str(tmp_path)])
    assert done.returncode == 0, done.stderr
    assert contents(tmp_path)["summary.json"]["samples"] == 9000


def test_a_full_disk_keeps_what_is_done(tmp_path, monkeypatch):
    """Parts of some blocks fit, then one no more."""
    written, fsync = [], os.fsync

    def full(handle):
        written.append(handle)
        if len(written) > 20:
            raise OSError(errno.ENOSPC, "")
        fsync(handle)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(OutputError, match="the disk is full") as caught:
            four_bar(tmp_path / "full", samples=200)
    done = int(note(caught.value).partition(" of ")[0])
    assert 10 <= done < 200
    four_bar(tmp_path / "full", samples=200, unfinished="resume")
    four_bar(tmp_path / "whole", samples=200)
    assert contents(tmp_path / "full") == contents(tmp_path / "whole")


@pytest.mark.skipif(resource is None, reason="needs limits of files")
def test_a_disk_that_fills_at_the_end_leaves_the_older_results(tmp_path):
    four_bar(tmp_path, samples=5)
    older = contents(tmp_path)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))
    try:
        with pytest.raises(OutputError, match="larger than this user"):
            four_bar(tmp_path, samples=130, unfinished="discard")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    work = tmp_path / WORK
    assert not list(work.rglob("*.part"))
    parts = {path.name for path in work.iterdir()}
    assert parts > {"journal.json", "lock"}
    work.rename(tmp_path.parent / "aside")
    assert contents(tmp_path) == older
    (tmp_path.parent / "aside").rename(work)
    four_bar(tmp_path, samples=130, unfinished="resume")
    assert contents(tmp_path)["summary.json"]["samples"] == 130


def test_a_disk_without_room_is_told_early(tmp_path, monkeypatch):
    free = type("", (), {"free": 20_000})
    monkeypatch.setattr(resource_checks.shutil, "disk_usage", lambda _: free)
    with pytest.raises(OutputError, match=r"about .* kB.*20 kB left.*--format parquet"):
        four_bar(tmp_path)


def test_two_runs_do_not_write_into_one_folder(tmp_path, capsys):
    with RunFolder.open(tmp_path):
        with pytest.raises(OutputError, match=rf"process {os.getpid()} on .* is writing"):
            four_bar(tmp_path)
        with pytest.raises(OutputError, match="is writing there"):
            four_bar().write(tmp_path)
        assert main(["run", "four_bar", "--samples", "3", "-o", str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "choose another folder" in said
    assert list(tmp_path.iterdir()) == []
    four_bar(tmp_path)


def test_work_of_another_run_is_refused_with_what_differs(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        four_bar(tmp_path, progress=interrupt(2))
    with pytest.raises(OutputError, match="when 20 of 60 samples were done; go on with"):
        four_bar(tmp_path)
    for options, words in [
        ({"samples": 61}, "samples: 60 there, 61 now"),
        ({"block": 5}, "samples in a block: 10 there, 5 now"),
        ({"assembly_mode": 1}, "assembly modes: "),
        ({"path": np.linspace(0, 1, 60)}, "input values: "),
        ({"duration": 1.0}, "over time: false there, true now"),
    ]:
        for unfinished in ("refuse", "resume"):
            with pytest.raises(OutputError, match=f"different run is there.*{words}"):
                four_bar(tmp_path, unfinished=unfinished, **options)
    with pytest.raises(OutputError, match="mechanism: four_bar there, stephenson now"):
        sk.run(sk.load("stephenson"), "poles", folder=tmp_path, unfinished="resume")
    with pytest.raises(OutputError, match="unfinished work"):
        four_bar().write(tmp_path)
    four_bar(tmp_path, samples=61, unfinished="discard")
    assert contents(tmp_path)["summary.json"]["samples"] == 61


@pytest.mark.parametrize(
    "damage, words",
    [
        (lambda work: (work / "journal.json").write_text(""), "does not read"),
        (lambda work: (work / "journal.json").write_text("[" * 9999), "does not read"),
        (lambda work: flip(work / "journal.json"), "checksum"),
        (lambda work: next(work.glob("poles*")).unlink(), "No such file"),
        (lambda work: turn_a_bit(next(work.glob("poles*")), 0.05), "damaged"),
        (lambda work: turn_a_bit(next(work.glob("poles*")), 0.1), "damaged"),
        (lambda work: turn_a_bit(next(work.glob("motion*")), 0.05), "damaged"),
        (lambda work: os.truncate(next(work.glob("motion*")), 100), "damaged"),
    ],
)
def test_a_damaged_journal_is_told(damage, words, tmp_path, capsys):
    with pytest.raises(KeyboardInterrupt):
        four_bar(tmp_path, progress=interrupt(2))
    damage(tmp_path / WORK)
    with pytest.raises(OutputError, match=f"cannot go on.*{words}.*--restart"):
        four_bar(tmp_path, unfinished="resume")
    options = ["-a", "poles:only=31", "--samples", "60", "-q", "-o", str(tmp_path)]
    assert main(["run", "four_bar", *options, "--restart"]) == 0
    assert "summary.json" in names_in(tmp_path) and WORK not in names_in(tmp_path)


def turn_a_bit(path, at):
    data = bytearray(path.read_bytes())
    data[int(at * len(data))] ^= 4
    path.write_bytes(data)


def flip(path):
    text = path.read_text()
    path.write_text(text.replace('"done": 20', '"done": 30'))


@pytest.mark.parametrize("job", [four_bar, swinging, wound_by_law])
def test_memory_and_folder_give_the_same_bits(job, tmp_path):
    kept = job()
    streamed = job(tmp_path / "streamed")
    kept.write(tmp_path / "written")
    mine, theirs = (contents(tmp_path / name) for name in ("streamed", "written"))
    assert mine == theirs and sorted(path.name for path in streamed.files) == sorted(mine)
    for name, found in kept.results.items():
        for table in found.tables:
            for degrees in (False, True):
                pd.testing.assert_frame_equal(
                    kept.frame(name, table.name, degrees),
                    streamed.frame(name, table.name, degrees),
                    check_exact=True,
                )


def test_csv_has_no_negative_zero(tmp_path):
    sk.run("bevel_pair", "statics", samples=3, folder=tmp_path / "statics")
    rows = (tmp_path / "statics" / "statics_outputs.csv").read_text().splitlines()
    assert len(rows) > 1 and not any("-0" in row.split(",") for row in rows)


@final
@dataclass(frozen=True, kw_only=True)
class Words(MinimalAnalysis):
    """Texts that come up block by block, with all that CSV has to quote."""

    name: ClassVar = "words"
    rowwise: ClassVar = True
    tables: ClassVar = (
        Table(
            "words", "texts", (SAMPLE, ASSEMBLY_MODE, Column("word", "", "a text", "text"))
        ),
        Table("plain", "no assembly modes", (Column("x", "", "a number"),)),
        Table("empty", "no rows", (SAMPLE, ASSEMBLY_MODE, Column("y", "", "no number"))),
    )
    plain: bool = False

    def compute(self, batch):
        odd = ["b", "a", "zz"] if self.plain else ['a "b"', "c,d", "é\nf", " a"]
        words = [odd[k * k % len(odd)] for k in batch.sample.tolist()]
        none = np.zeros(0)
        return {
            "words": with_row_columns(batch, word=words),
            "plain": {"x": batch.sample},
            "empty": {"sample": none, "assembly_mode": none, "y": none},
        }

    def scene(self, batch):
        rows = batch.assembly_mode_rows().items()
        return tuple(Scene(b, (Series("s", "s", "g", batch.q[own]),)) for b, own in rows)


@final
@dataclass(frozen=True, kw_only=True)
class Whole(MinimalAnalysis):
    """The analysis of texts as one that wants all samples at once."""

    name, tables, compute = Words.name, Words.tables, Words.compute
    plain: bool = False


@pytest.mark.parametrize("plain", [True, False])
def test_any_text_survives(plain, tmp_path):
    words, made = Words(plain=plain), sk.load("four_bar")
    streamed = sk.run(made, words, samples=25, block=4, folder=tmp_path / "a")
    kept = sk.run(made, words, samples=25, block=4)
    kept.write(tmp_path / "b")
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    frame = kept.frame("words")
    read = pd.read_csv(tmp_path / "a" / "words.csv")
    assert list(read["word"]) == list(frame["word"]) == list(streamed.frame()["word"])
    assert list(frame["assembly_mode"]) == [0] * 25 + [1] * 25
    assert len(pd.read_csv(tmp_path / "a" / "words_empty.csv")) == 0
    assert kept.frame("words", "plain")["x"].dtype == float


def test_files_are_read_and_written_in_pieces(tmp_path, monkeypatch):
    """Pieces of 32 rows cut across blocks and assembly modes."""
    for module in (table_store, table_files):
        monkeypatch.setattr(module, "CHUNK_ROWS", 32)
    four_bar(tmp_path)
    parquet = pq.ParquetFile(tmp_path / "motion.parquet")
    rows = [parquet.metadata.row_group(k).num_rows for k in range(parquet.num_row_groups)]
    assert rows == [32, 32, 32, 24]
    monkeypatch.undo()
    pd.testing.assert_frame_equal(
        pd.read_csv(tmp_path / "motion.csv", engine="pyarrow")[["assembly_mode", "q"]],
        four_bar().frame("motion")[["assembly_mode", "q"]],
        check_exact=True,
    )


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("job, count", [(four_bar, 5_000), (wound, 1_500)])
def test_memory_does_not_grow_with_the_samples(job, count, tmp_path, monkeypatch):
    """Four times as many rows: less than a tenth of their bytes beside the inputs."""
    for module in (table_store, table_files):
        monkeypatch.setattr(module, "CHUNK_ROWS", 1024)

    def peak(samples):
        pool = pa.default_memory_pool()
        before = pool.bytes_allocated()
        tracemalloc.start()
        try:
            result = job(tmp_path / str(samples), samples=samples, block=count // 2)
            found = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert result.summary["samples"] == samples
        tables = result.summary["cost"]["tables"].values()
        bytes_ = sum(8 * table["rows"] * table["columns"] for table in tables)
        return found, pool.bytes_allocated() - before, bytes_

    peak(count // 5)
    small, _, few = peak(count)
    large, held, many = peak(4 * count)
    inputs = 5 * 8 * 3 * count
    assert large - small < inputs + 0.1 * (many - few) and held < 1e6


def test_the_engine_that_began_goes_on(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        swinging(tmp_path, engine="numpy", progress=interrupt(1))
    result = swinging(tmp_path, engine="auto", unfinished="resume")
    assert result.summary["simulation"]["engine"]["name"] == "numpy"


def test_whole_batches_are_not_resumed_and_need_memory(tmp_path, monkeypatch, capsys):
    with pytest.raises(KeyboardInterrupt) as caught:
        sk.run(sk.load("four_bar"), Whole(), folder=tmp_path, progress=interrupt(1, True))
    assert "361 of 361 samples are done and kept" in note(caught.value)
    result = sk.run(sk.load("four_bar"), Whole(), folder=tmp_path, unfinished="resume")
    assert result.summary["samples_in_a_block"] == 361 and len(result.frame("words")) == 722
    monkeypatch.setattr(resource_checks, "usable_memory", lambda: 10**8)
    with pytest.raises(AnalysisError, match=r"words looks at all samples at once.* 100 MB"):
        sk.run(sk.load("four_bar"), Whole(), samples=50_000)
    assert main(["explain", "four_bar", "-a", "singularities", "-a", "eksergian"]) == 0
    assert "keeps nothing: singularities; about" in capsys.readouterr().out


def test_tables_that_were_not_kept_are_told(tmp_path):
    bare = four_bar(tables=False)
    assert bare.summary["status"] == {"OK": 120}
    for use in (bare.frame, lambda: bare.write(tmp_path)):
        with pytest.raises(AnalysisError, match="kept no tables"):
            use()
    with pytest.raises(AnalysisError, match="kept no tables"):
        four_bar(tmp_path, formats=("csv",)).frame()


def shown(listener):
    """The samples of all primitives that a recorder was given on pages."""
    return [
        own for (page, _), own in listener.samples_by_primitive.items() if page is not None
    ]


def test_a_long_recording_has_one_of_many_samples(monkeypatch, capsys, tmp_path):
    from spherekit.runs import recording_session

    monkeypatch.setattr(recording_session, "MAX_RECORDED_SAMPLES", 10)
    listener = SceneListener()
    result = four_bar(samples=45, recorder=listener)
    wanted = [0, 5, 10, 15, 20, 25, 30, 35, 40, 44]
    assert all(samples == wanted for samples in shown(listener))
    assert len(listener.inputs) == 10
    assert listener.properties["logged"] == "one of 5 successive samples"
    assert result.summary["recording"] == {"one_of": 5, "from_sample": 0}
    assert len(result.frame("motion")) == 90
    all_of_them = SceneListener()
    four_bar(samples=45, recorder=all_of_them, log_every=1)
    assert all(len(own) == 45 for own in shown(all_of_them))
    grid = SceneListener()
    sk.run("five_bar", samples=(3, 4), assembly_mode=0, recorder=grid, log_every=2)
    assert all(own == [0, 2, 4, 6, 8, 10] for own in shown(grid))
    assert grid.row == 2
    with pytest.raises(AnalysisError, match="log_every must be at least 1"):
        four_bar(recorder=SceneListener(), log_every=0)
    words = ["run", "four_bar", "--samples", "50", "--save", str(tmp_path / "x.rrd")]
    assert main(words) == 0
    assert "one of 5 samples of each assembly mode" in capsys.readouterr().err


def test_a_resumed_recording_says_where_it_begins(tmp_path):
    with pytest.raises(KeyboardInterrupt):
        four_bar(tmp_path, progress=interrupt(2))
    listener = SceneListener()
    result = four_bar(tmp_path, unfinished="resume", recorder=listener)
    assert all(own == list(range(20, 60)) for own in shown(listener))
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
        four_bar(recorder=first)
    assert path.stat().st_size > 10_000


def test_much_csv_is_written_when_asked_for(tmp_path, monkeypatch):
    """By default Parquet alone where CSV would be too large, and the summary says so."""
    monkeypatch.setattr("spherekit.tables.table_formats.MAX_CSV_BYTES", 1e4)
    left = sk.run("four_bar", samples=40, folder=tmp_path / "one")
    asked = sk.run("four_bar", samples=40, folder=tmp_path / "two", formats=["csv"])
    few = sk.run("four_bar", samples=2, folder=tmp_path / "three")
    assert not (tmp_path / "one/poles.csv").exists()
    assert (tmp_path / "one/poles.parquet").exists()
    assert any("--format both" in text for text in left.summary["remarks"])
    for folder, result in ("two", asked), ("three", few):
        assert (tmp_path / folder / "poles.csv").exists()
        assert not any("--format both" in text for text in result.summary["remarks"])


def sampled_at_once(analyses, samples):
    """Return how many samples blocks have, each as it is done."""
    done = [0]
    sk.run(
        "four_bar", analyses, samples=samples, tables=False,
        progress=lambda count, total: done.append(count),
    )  # fmt: skip
    return np.diff(done)


@pytest.mark.many
@pytest.mark.parametrize(
    ("analysis", "most"),
    [("eksergian", 16384), ("reactions", 16384), ("dynamics", 16384), ("statics", 16384)],
)
def test_blocks_of_frames_stay_small(analysis, most):
    """Frames of all links in all modes take some kB a row; blocks have 128 MB of them."""
    assert max(sampled_at_once(analysis, 40000)) <= most
