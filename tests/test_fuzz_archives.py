"""Archives that were changed: one sentence, or what was written; never a hang."""

import json
import shutil
import signal
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

FEW, MANY = 24, 500
"""Changes of each archive, by default and when there is time."""

LONGEST_SECONDS = 30


def flip(random, data):
    at = random.integers(len(data))
    return data[:at] + bytes([data[at] ^ 1 << int(random.integers(8))]) + data[at + 1 :]


def set_byte(random, data):
    at = random.integers(len(data))
    return data[:at] + random.bytes(1) + data[at + 1 :]


def cut(random, data):
    return data[: random.integers(len(data))]


def behead(random, data):
    return data[random.integers(1, len(data)) :]


def remove(random, data):
    first, last = sorted(random.integers(len(data) + 1, size=2))
    return data[:first] + data[last:]


def insert(random, data):
    at = random.integers(len(data) + 1)
    return data[:at] + random.bytes(int(random.integers(1, 40))) + data[at:]


def blank(random, data):
    first, last = sorted(random.integers(len(data) + 1, size=2))
    return data[:first] + bytes(last - first) + data[last:]


def double(random, data):
    first, last = sorted(random.integers(len(data) + 1, size=2))
    return data[:last] + data[first:last] + data[last:]


def swap(random, data):
    a, b, c = sorted(random.integers(len(data) + 1, size=3))
    return data[:a] + data[b:c] + data[a:b] + data[c:]


def append(random, data):
    return data + random.bytes(int(random.integers(1, 100)))


ODD = [None, True, -1, 0, 1e308, -1e308, float("nan"), 2**80, "", "x", [], {}, [[1]], "1e9"]
"""What a number, a text or a list of a heading may be changed into."""


def change_inside(random, value):
    """Return a JSON value of which one part, at any depth, is an odd one."""
    if isinstance(value, dict) and value and random.random() < 0.85:
        key = list(value)[random.integers(len(value))]
        return {**value, key: change_inside(random, value[key])}
    if isinstance(value, list) and value and random.random() < 0.85:
        at = int(random.integers(len(value)))
        return [*value[:at], change_inside(random, value[at]), *value[at + 1 :]]
    return ODD[random.integers(len(ODD))]


def rewrite(random, data):
    """Return an archive that NumPy wrote anew with another heading or array."""
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
        odd = [np.nan, np.inf, 1e300, -1.0]
        with np.errstate(invalid="ignore"):  # NaN has no integer
            arrays[name] = np.full_like(array, odd[random.integers(4)])
    elif kind == 3:
        arrays[name] = array.astype(str)
    else:
        header = change_inside(random, header)
    stream = BytesIO()
    np.savez_compressed(stream, header=np.array(json.dumps(header)), **arrays)
    if random.random() < 0.5:  # the comment with the sum of the old content is kept
        with zipfile.ZipFile(BytesIO(data)) as old, zipfile.ZipFile(stream, "a") as new:
            new.comment = old.comment
    return stream.getvalue()


def change_words(random, data):
    """Return a file in JSON with a part that is an odd one."""
    return json.dumps(change_inside(random, json.loads(data))).encode()


BYTES = [flip, set_byte, cut, behead, remove, insert, blank, double, swap, append]


@contextmanager
def limited(seconds):
    """Fail where a block takes longer."""

    def stop(*_):
        raise AssertionError(f"no end after {seconds} s")

    if not hasattr(signal, "SIGALRM"):
        yield
        return
    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def judge(path, read, changes, count, seed):
    """Change a file again and again: it reads as it was, or is refused in a sentence.

    `read` gives what can be compared. Return how often it was refused.
    """
    random = np.random.default_rng(seed)
    data = path.read_bytes()
    wanted = read()
    refused = 0
    for number in range(count):
        change = changes[number % len(changes)]
        changed = change(random, data)
        path.write_bytes(changed)
        try:
            with limited(LONGEST_SECONDS):
                found = read()
        except SpherekitError as problem:
            words = str(problem)
            names = path.name, str(path.parent)
            assert "\n" not in words and any(x in words for x in names), (number, words)
            refused += changed != data
        else:
            assert found == wanted, (number, change.__name__)
    path.write_bytes(data)
    assert read() == wanted
    return refused


@pytest.fixture(
    params=[FEW, pytest.param(MANY, marks=pytest.mark.slow)], ids=["few", "many"]
)
def count(request):
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


def test_stored_models(model, count, tmp_path):
    path = tmp_path / "model.npz"
    model.save(path)
    refused = judge(
        path, lambda: load_reduced(path).heading, [*BYTES, rewrite, rewrite], count, 1
    )
    assert refused > 0.9 * count


def test_coupling_tables(count, tmp_path):
    path = tmp_path / "table.npz"
    write_npz(sk.coupling_table(sk.load("four_bar")), path)
    refused = judge(
        path, lambda: sk.load_coupling(path).inputs, [*BYTES, rewrite, rewrite], count, 2
    )
    assert refused > 0.9 * count


@pytest.fixture(scope="module")
def sweep():
    space = DesignSpace.from_variations([parse_variation("links.2.arc", [20.0, 30.0])])
    return sweep_of("four_bar", space, [], [create_analysis("poles")], 3, tables=True)


@pytest.mark.many
@pytest.mark.parametrize("file", ["designs", "tables/poles", "_sweep.json"])
def test_parts_of_sweeps(sweep, file, count, tmp_path):
    """Also by a part that other programs have written, with the same notes or none."""
    run_sweep(sweep, tmp_path)

    def read():
        found = run_sweep(sweep, tmp_path)
        assert not found.computed
        return [found.frame().to_csv(), found.table("poles").to_csv()]

    if file == "_sweep.json":
        path, changes = tmp_path / file, [*BYTES, change_words, change_words]
    else:
        path, changes = tmp_path / file / "part-000000.parquet", [*BYTES, foreign]
    judge(path, read, changes, count // 2, 3)


def foreign(random, data):
    """Return a part as pandas, or a program of Arrow's, writes it."""
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


def stop_after_two(done, total):
    if done >= 4:
        raise KeyboardInterrupt


@pytest.mark.many
@pytest.mark.parametrize("file", ["journal.json", "poles.poles.000000.parquet"])
def test_unfinished_runs(file, count, tmp_path):
    """It goes on to the same rows, or says that it cannot."""
    stopped = tmp_path / "stopped"
    options = {"samples": 6, "block": 2}
    with pytest.raises(KeyboardInterrupt):
        sk.run("four_bar", "poles", folder=stopped, progress=stop_after_two, **options)
    (path,) = stopped.rglob(file)
    again = tmp_path / "again"

    def read():
        shutil.rmtree(again, ignore_errors=True)
        shutil.copytree(stopped, again)
        try:
            run = sk.run("four_bar", "poles", folder=again, unfinished="resume", **options)
        except SpherekitError as problem:
            problem.args = (f"{problem} {file}",)  # it names the folder
            raise
        return run.frame().to_csv()

    changes = [*BYTES, change_words] if file == "journal.json" else BYTES
    judge(path, read, changes, count // 2, 4)


def test_a_device_is_no_archive():
    for path in ("/dev/zero", "/dev/null"):
        if Path(path).exists():
            with limited(5), pytest.raises(SpherekitError, match="pipe or a device"):
                load_reduced(path)
