"""What a sweep says of the processors and programs that have made its parts."""

import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers.least_kernels import environment_with_least_kernels

import spherekit as sk
from spherekit import processor
from spherekit.cli.main import main
from spherekit.errors import FileError, OutputError, SpherekitError
from spherekit.runs import run_identity

VARY = {"links.2.arc": [float(x) for x in np.linspace(10.0, 40.0, 40)]}
WORDS = ["sweep", "four_bar", "-a", "poles", "--tables", "--samples", "5", "--workers", "1"]
WORDS += ["--vary", "links.2.arc=" + ",".join(map(repr, VARY["links.2.arc"])), "-o"]


def swept(path, samples=5):
    """Return the sweep of the four-bar in 40 designs, which makes three parts in a folder.

    Parts that the folder has already are read. `WORDS` is the same sweep as a command.
    """
    return sk.sweep(
        "four_bar",
        VARY,
        folder=path,
        analyses=["poles"],
        tables=True,
        samples=samples,
        workers=1,
    )


@pytest.fixture(scope="module")
def finished_sweep(tmp_path_factory):
    """Return a sweep of three parts and the folder that it has written."""
    path = tmp_path_factory.mktemp("finished") / "sweep"
    return swept(path), path


@pytest.fixture
def folder_of_sweep(finished_sweep, tmp_path):
    """Return the folder of a finished sweep, which a test may change."""
    return shutil.copytree(finished_sweep[1], tmp_path / "sweep")


def part(path, number=1):
    """Return the file of a part in the folder of a sweep."""
    return path / "designs" / f"part-{number:06d}.parquet"


def complete_with_least_kernels(path):
    """Let the command compute missing parts by the least instructions of this processor.

    Returns its report.
    """
    done = subprocess.run(
        [sys.executable, "-m", "spherekit", *WORDS, str(path)],
        env=environment_with_least_kernels(),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_processor_is_known_by_what_it_computes():
    """The identity is the same in every process, and differs with the least kernels."""
    code = "from spherekit.processor import processor_identity; print(processor_identity())"
    identity = processor.processor_identity()
    printed = [
        subprocess.check_output([sys.executable, "-c", code], env=env, text=True).strip()
        for env in (os.environ, os.environ, environment_with_least_kernels())
    ]
    assert printed[0] == str(identity)
    assert printed[1] == str(identity)
    assert printed[2] != str(identity)
    assert set(identity) == {"instructions", "blas", "arithmetic"}


@pytest.mark.slow
def test_parts_of_another_processor_are_recorded_and_reported(tmp_path):
    """A sweep reports that one of its three parts was computed by another processor.

    Part 1 is removed and computed again by `complete_with_least_kernels`, which returns
    what the command prints. There NumPy and BLAS may use the oldest instructions only,
    which round differently. The sweep records which parts each kind of processor has
    computed. Its rows agree to rounding with those of one processor. A sweep by one kind of
    processor has no remark.
    """
    expected = swept(tmp_path / "whole")
    assert len(expected.processors) == 1
    assert not expected.remarks
    swept(tmp_path / "mixed")
    part(tmp_path / "mixed").unlink()
    printed = complete_with_least_kernels(tmp_path / "mixed")
    assert "everal kinds of processors have computed the parts (2 parts by" in printed
    assert "agree to rounding, not bit by bit" in printed

    mixed = swept(tmp_path / "mixed")
    assert mixed.computed == 0  # all parts are read from the folder
    # By kind of processor, the numbers of its parts.
    assert sorted(mixed.processors.values()) == [[0, 2], [1]]
    assert len(mixed.remarks) == 1
    tables = [(expected.frame(), mixed.frame())]
    for name in expected.table_names:
        tables.append((expected.table(name), mixed.table(name)))
    for first, second in tables:
        pd.testing.assert_frame_equal(
            first, second, check_exact=False, rtol=1e-9, atol=1e-9
        )
    metadata = pq.read_schema(part(tmp_path / "mixed")).metadata[b"spherekit"]
    assert set(json.loads(metadata)["processor"]) == {"instructions", "blas", "arithmetic"}


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("library", ["spherekit", "numpy", "scipy", "heyoka", "machine"])
def test_parts_of_other_versions_are_refused(library, folder_of_sweep, monkeypatch):
    code = run_identity.code_identity() | {library: "1.2.3"}
    monkeypatch.setattr("spherekit.designs.sweep.code_identity", lambda: code)
    with pytest.raises(OutputError, match=f"by other code .{library}: .* there, 1.2.3 now"):
        swept(folder_of_sweep)


# Each of these functions replaces the file of a part by one that is no part.


def rewrite(path, change):
    """Replace the table of a file by a changed one."""
    table = pq.read_table(path)
    pq.write_table(change(table), path)


def by_pandas(path):
    """Write the same rows by another program, which drops what identifies the part."""
    pd.read_parquet(path).to_parquet(path)


def without_notes(path):
    rewrite(path, lambda table: table.replace_schema_metadata({}))


def of_other_columns(path):
    rewrite(path, lambda table: table.select(table.column_names[1:]))


def of_another_program(path):
    pq.write_table(pa.table({"a": [1, 2]}), path)


def of_another_part(path):
    path.write_bytes(path.with_name("part-000000.parquet").read_bytes())


def of_another_sweep(path):
    """Replace it by the part of a sweep with other samples."""
    other = path.parents[2] / "other"
    swept(other, samples=7)
    path.write_bytes(part(other).read_bytes())


def no_parquet(path):
    path.write_text("design,status\n")


def cut(path):
    path.write_bytes(path.read_bytes()[:-100])


def empty(path):
    path.write_bytes(b"")


FAULTS = [
    *(by_pandas, without_notes, of_other_columns, of_another_program, of_another_part),
    *(of_another_sweep, no_parquet, cut, empty),
]


@pytest.mark.many
@pytest.mark.parametrize("fault", FAULTS)
def test_a_file_that_is_no_part_is_refused_in_a_sentence(fault, folder_of_sweep, capsys):
    """The sentence has the path and one of three reasons."""
    path = part(folder_of_sweep)
    fault(path)
    assert main([*WORDS, str(folder_of_sweep)]) == 1
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    assert str(path) in message
    reasons = (
        "is not part 1 of this sweep",
        "is not a Parquet file",
        "the file has been changed since it was written",
    )
    assert any(reason in message for reason in reasons)


@pytest.mark.slow
def test_a_file_that_was_refused_is_made_again_when_it_is_gone(
    finished_sweep, folder_of_sweep
):
    """The command refuses it until it is deleted; then rows are equal bit by bit."""
    expected, _ = finished_sweep
    by_pandas(part(folder_of_sweep))
    assert main([*WORDS, str(folder_of_sweep)]) == 1
    part(folder_of_sweep).unlink()
    result = swept(folder_of_sweep)
    assert result.computed == 1
    pd.testing.assert_frame_equal(result.frame(), expected.frame(), check_exact=True)


@pytest.mark.parametrize("fault", [by_pandas, of_another_part, of_another_program, cut])
def test_a_table_that_is_no_part_is_refused_when_it_is_read(fault, folder_of_sweep):
    """The rows of designs, 40 in two assembly modes, can still be read."""
    result = swept(folder_of_sweep)
    assert result.computed == 0
    fault(folder_of_sweep / "tables" / "poles" / "part-000001.parquet")
    assert len(result.frame()) == 2 * 40
    with pytest.raises(SpherekitError) as refusal:
        result.table("poles")
    assert isinstance(refusal.value, FileError)
    assert "part-000001" in str(refusal.value)
