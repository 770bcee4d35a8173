"""Archives that were changed: one sentence, or what was written; never a hang."""

import json
import os
import shutil
import signal
import stat
import zipfile
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

import spherekit as sk
from spherekit.api.sweep import sweep_of
from spherekit.designs.design_space import DesignSpace, parse_variation
from spherekit.designs.sweep_parts import run_sweep
from spherekit.dynamics.reduced_model import load_reduced
from spherekit.errors import SpherekitError
from spherekit.exchange.coupling_table import write_npz
from spherekit.runs.registry import create_analysis

FEW_CHANGES = 24
"""Changes of each archive in the default tests."""
MANY_CHANGES = 500
"""Changes of each archive in slow tests."""

LONGEST_SECONDS = 30


def flip_bit(random, data):
    position = random.integers(len(data))
    changed_byte = data[position] ^ 1 << int(random.integers(8))
    return data[:position] + bytes([changed_byte]) + data[position + 1 :]


def set_byte(random, data):
    position = random.integers(len(data))
    return data[:position] + random.bytes(1) + data[position + 1 :]


def remove_end(random, data):
    return data[: random.integers(len(data))]


def remove_beginning(random, data):
    return data[random.integers(1, len(data)) :]


def remove_passage(random, data):
    first, last = sorted(random.integers(len(data) + 1, size=2))
    return data[:first] + data[last:]


def insert_bytes(random, data):
    position = random.integers(len(data) + 1)
    return data[:position] + random.bytes(int(random.integers(1, 40))) + data[position:]


def zero_passage(random, data):
    first, last = sorted(random.integers(len(data) + 1, size=2))
    return data[:first] + bytes(last - first) + data[last:]


def repeat_passage(random, data):
    first, last = sorted(random.integers(len(data) + 1, size=2))
    return data[:last] + data[first:last] + data[last:]


def swap_passages(random, data):
    a, b, c = sorted(random.integers(len(data) + 1, size=3))
    return data[:a] + data[b:c] + data[a:b] + data[c:]


def append_bytes(random, data):
    return data + random.bytes(int(random.integers(1, 100)))


ODD_VALUES = [None, True, -1, 0, 1e308, -1e308, float("nan"), 2**80]
ODD_VALUES += ["", "x", [], {}, [[1]], "1e9"]
"""Values by which a number, a text or a list in a JSON heading may be replaced."""


def replace_inside(random, value):
    """Return a JSON value in which one part, at any depth, is an odd value."""
    if isinstance(value, dict) and value and random.random() < 0.85:
        key = list(value)[random.integers(len(value))]
        return {**value, key: replace_inside(random, value[key])}
    if isinstance(value, list) and value and random.random() < 0.85:
        position = int(random.integers(len(value)))
        changed_item = replace_inside(random, value[position])
        return [*value[:position], changed_item, *value[position + 1 :]]
    return ODD_VALUES[random.integers(len(ODD_VALUES))]


def rewrite_npz(random, data):
    """Return a valid npz archive with another header or with one array changed.

    The tests check that these archives are refused, or read unchanged. An array may be
    missing, shortened, converted to text, or filled with NaN, infinity, 1e300 or -1. The
    comment of the zip file has the checksum of its content. Half of the new archives keep
    the comment of the old archive, so that the checksum is wrong. The other half have no
    comment.
    """
    with np.load(BytesIO(data)) as archive:
        arrays = dict(archive)
    header = json.loads(str(arrays.pop("header")))
    name = list(arrays)[random.integers(len(arrays))]
    array = arrays[name]
    kind = random.integers(6)
    if kind == 0:
        del arrays[name]
    elif kind == 1:
        arrays[name] = array.ravel()[: random.integers(array.size + 1)]
    elif kind == 2:
        unusual_numbers = [np.nan, np.inf, 1e300, -1.0]
        with np.errstate(invalid="ignore"):  # NaN has no integer
            arrays[name] = np.full_like(array, unusual_numbers[random.integers(4)])
    elif kind == 3:
        arrays[name] = array.astype(str)
    else:
        header = replace_inside(random, header)
    stream = BytesIO()
    np.savez_compressed(stream, header=np.array(json.dumps(header)), **arrays)
    if random.random() < 0.5:
        with zipfile.ZipFile(BytesIO(data)) as old, zipfile.ZipFile(stream, "a") as new:
            new.comment = old.comment
    return stream.getvalue()


def rewrite_json(random, data):
    """Return a valid JSON file with one part replaced by an odd value."""
    return json.dumps(replace_inside(random, json.loads(data))).encode()


BYTE_CHANGES = [
    flip_bit,
    set_byte,
    remove_end,
    remove_beginning,
    remove_passage,
    insert_bytes,
    zero_passage,
    repeat_passage,
    swap_passages,
    append_bytes,
]
"""Changes that know nothing about the format. Each takes a generator and bytes."""


@contextmanager
def time_limit(seconds):
    """Raise AssertionError if the block of `with` takes longer than some seconds.

    On a system without the signal SIGALRM, such as Windows, there is no limit.
    """

    def stop(*_):
        raise AssertionError(f"no end after {seconds} s")

    if not hasattr(signal, "SIGALRM"):
        yield
        return
    previous_handler = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, previous_handler)


def check_damaged_archive(path, read, changes, count, seed):
    """Damage a file many times: it must be read as before or be refused in one line.

    The file is restored at the end.

    Parameters
    ----------
    path
        Path of the file.
    read
        Function that reads the file and returns content that can be compared.
    changes
        Functions, used in turn. Each takes a random generator and the bytes of the file,
        and returns changed bytes.
    count, seed
        Number of changes, and seed of the generator.

    Returns
    -------
    Number of refusals. Each must name the file or its folder, and come within
    `LONGEST_SECONDS`.
    """
    random = np.random.default_rng(seed)
    data = path.read_bytes()
    expected = read()
    refusals = 0
    for number in range(count):
        change = changes[number % len(changes)]
        damaged_data = change(random, data)
        path.write_bytes(damaged_data)
        try:
            with time_limit(LONGEST_SECONDS):
                content = read()
        except SpherekitError as error:
            message = str(error)
            assert "\n" not in message, (number, message)
            assert path.name in message or str(path.parent) in message, (number, message)
            # A file that a change has left as it was must not be refused.
            assert damaged_data != data, (number, message)
            refusals += 1
        else:
            assert content == expected, (number, change.__name__)
    path.write_bytes(data)
    assert read() == expected
    return refusals


@pytest.fixture(
    params=[FEW_CHANGES, pytest.param(MANY_CHANGES, marks=pytest.mark.slow)],
    ids=["few", "many"],
)
def count(request):
    """Number of changes of an archive."""
    return request.param


MODELS = {
    "curve": lambda: sk.reduced_model(sk.load("four_bar"), poles=["3/1"]),
    "grid": lambda: sk.reduced_grid_model(sk.load("five_bar"), tolerance=1e-2),
}


@pytest.fixture(
    scope="module", params=["curve", pytest.param("grid", marks=pytest.mark.slow)]
)
def model(request):
    return MODELS[request.param]()


def test_damaged_reduced_models_are_refused_or_read_unchanged(model, count, tmp_path):
    """A checksum is stored, so more than nine in ten changes must be noticed."""
    path = tmp_path / "model.npz"
    model.save(path)
    changes = [*BYTE_CHANGES, rewrite_npz, rewrite_npz]
    refusals = check_damaged_archive(
        path, lambda: load_reduced(path).heading, changes, count, seed=1
    )
    assert refusals > 0.9 * count


def test_damaged_coupling_tables_are_refused_or_read_unchanged(count, tmp_path):
    """A checksum is stored, so more than nine in ten changes must be noticed."""
    path = tmp_path / "table.npz"
    write_npz(sk.coupling_table(sk.load("four_bar")), path)
    changes = [*BYTE_CHANGES, rewrite_npz, rewrite_npz]
    refusals = check_damaged_archive(
        path, lambda: sk.load_coupling(path).inputs, changes, count, seed=2
    )
    assert refusals > 0.9 * count


@pytest.fixture(scope="module")
def sweep():
    """Sweep of two four-bars with the table of poles."""
    space = DesignSpace.from_variations(
        [parse_variation("links.2.arc", [20.0, 30.0], "deg")]
    )
    return sweep_of("four_bar", space, [], [create_analysis("poles")], 3, tables=True)


@pytest.mark.many
@pytest.mark.parametrize("file", ["designs", "tables/poles", "_sweep.json"])
def test_damaged_files_of_a_finished_sweep_are_refused_or_read_unchanged(
    sweep, file, count, tmp_path
):
    """A damaged file of a finished sweep is refused, or the sweep is read unchanged.

    Tables are stored in Parquet files of several designs, the rest in `_sweep.json`, which
    states what was computed and with which options. Damage includes a Parquet file that
    another program has written. A sweep over the same folder reads what is stored and
    computes nothing. `sweep` is the sweep, and `count` the number of changes per archive,
    half of which are tried for each file.
    """
    run_sweep(sweep, tmp_path)

    def read():
        result = run_sweep(sweep, tmp_path)
        assert not result.computed
        return [result.frame().to_csv(), result.table("poles").to_csv()]

    if file == "_sweep.json":
        path = tmp_path / file
        # Changes are made in turn, so valid JSON with odd values occurs twice as often as
        # any other change.
        changes = [*BYTE_CHANGES, rewrite_json, rewrite_json]
    else:
        path = tmp_path / file / "part-000000.parquet"
        changes = [*BYTE_CHANGES, rewrite_parquet]
    check_damaged_archive(path, read, changes, count // 2, seed=3)


def rewrite_parquet(random, data):
    """Return a valid Parquet file that the sweep did not write, made from one of its files.

    Such a file passes Parquet's own checks, so the reader of the sweep must find the
    difference or not need it. The generator `random` chooses one of four changes: the table
    is written by pandas, has no metadata, has lost its first column, or is replaced by a
    small other one. `data` are the bytes of the file of the sweep.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(BytesIO(data))
    kind = random.integers(4)
    stream = BytesIO()
    if kind == 0:
        table.to_pandas().to_parquet(stream)
    elif kind == 1:
        pq.write_table(table.replace_schema_metadata({}), stream)
    elif kind == 2:
        pq.write_table(table.select(table.column_names[1:]), stream)
    else:
        pq.write_table(pa.table({"a": [1, 2]}), stream)
    return stream.getvalue()


def interrupt_after_four_rows(done, total):
    """Stop a run of blocks of two samples as Ctrl-C does; a progress function."""
    if done >= 4:
        raise KeyboardInterrupt


@pytest.mark.many
@pytest.mark.parametrize("file", ["journal.json", "poles.poles.000000.parquet"])
def test_resuming_from_damaged_files_gives_the_same_rows_or_is_refused(
    file, count, tmp_path
):
    """A run resumed from a damaged file has the same rows, or is refused.

    The run is interrupted, and one of its files is damaged. `journal.json` says which
    blocks of samples are finished; the Parquet file has their rows. For each file, a fifth
    of `count` changes are tried.
    """
    stopped_folder = tmp_path / "stopped"
    resumed_folder = tmp_path / "again"
    options = {"samples": 6, "block": 2}
    with pytest.raises(KeyboardInterrupt):
        sk.run(
            "four_bar",
            "poles",
            folder=stopped_folder,
            progress=interrupt_after_four_rows,
            **options,
        )
    (path,) = stopped_folder.rglob(file)

    def read():
        shutil.rmtree(resumed_folder, ignore_errors=True)
        shutil.copytree(stopped_folder, resumed_folder)
        try:
            run = sk.run(
                "four_bar", "poles", folder=resumed_folder, unfinished="resume", **options
            )
        except SpherekitError as error:
            # `check_damaged_archive` looks for the file or its folder in the message. The
            # message may name the folder only, which is another one here: that of the copy.
            # So the name of the file is added.
            error.args = (f"{error} {file}",)
            raise
        return run.frame().to_csv()

    changes = [*BYTE_CHANGES, rewrite_json] if file == "journal.json" else BYTE_CHANGES
    check_damaged_archive(path, read, changes, count // 5, seed=4)


@pytest.mark.parametrize("path", ["/dev/zero", "/dev/null"])
def test_a_device_is_refused_as_an_archive(path):
    """/dev/zero has no end, so reading it would never finish."""
    if not Path(path).exists():
        pytest.skip(f"there is no {path}")
    with time_limit(5), pytest.raises(SpherekitError, match="pipe or a device"):
        load_reduced(path)


def test_a_disk_is_refused_as_an_archive(tmp_path, monkeypatch):
    """A file looks like a disk (a block device), which only few users may read."""
    path = tmp_path / "disk"
    path.write_bytes(b"x")
    of_disk = os.stat_result((stat.S_IFBLK, *path.stat()[1:]))
    monkeypatch.setattr(Path, "stat", lambda *_, **__: of_disk)
    with pytest.raises(SpherekitError, match="pipe or a device"):
        load_reduced(path)
