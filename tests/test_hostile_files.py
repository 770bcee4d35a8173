"""Hostile files are read or refused in bounded time and memory, and never otherwise."""

import json
import resource
import subprocess
import sys
import time
from pathlib import Path

import pytest

from spherekit.errors import SpherekitError
from spherekit.files.mechanism_reader import load, loads
from spherekit.files.study_reader import load_study

pytestmark = pytest.mark.slow

MEMORY = 3 << 29
"""1.5 GiB of address space."""
SECONDS = 60.0
"""Most processor time of a file, some thirty times that of an idle machine: a file that
takes longer would take without end. This is no claim on speed."""
LONGEST = 3000
"""Most characters of a message."""


def judged(call):
    """Return the outcome of a call, its message and its processor time."""
    started = time.process_time()
    try:
        call()
        outcome, message = "read", ""
    except SpherekitError as error:
        outcome, message = type(error).__name__, str(error)
    except BaseException as error:  # a defect, told by the test
        outcome, message = "defect", repr(error)[:500]
    return outcome, message, time.process_time() - started


def everything(folder):
    """Return what becomes of every hostile file, by name."""
    from helpers import hostile_files

    found = {"warm": judged(lambda: load("four_bar"))}
    for name, text in hostile_files.hostile_mechanism_texts().items():
        found[name] = judged(lambda text=text: loads(text, "hostile.toml"))
    for name, path in hostile_files.make_files(folder).items():
        found[f"file {name}"] = judged(lambda path=path: load(Path(path)))
    study = folder / "hostile.study.toml"
    for name, text in hostile_files.hostile_study_texts().items():
        study.write_text(text)
        found[f"study {name}"] = judged(lambda: load_study(str(study)))
    return found


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hostile")
    command = [sys.executable, __file__, str(folder)]
    done = subprocess.run(
        command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=300
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stderr == ""
    return json.loads(done.stdout)


def test_every_hostile_file_is_read_or_refused(outcomes):
    assert {n: o for n, o in outcomes.items() if o[0] == "defect"} == {}
    assert {n: o for n, o in outcomes.items() if len(o[1]) > LONGEST} == {}
    assert {n: o for n, o in outcomes.items() if not o[1].isprintable()} == {}


def test_every_hostile_file_takes_bounded_time(outcomes):
    assert {n: o[2] for n, o in outcomes.items() if not o[2] < SECONDS} == {}


def test_what_is_refused_and_what_is_not(outcomes):
    read = {name for name, outcome in outcomes.items() if outcome[0] == "read"}
    assert read == {
        *("warm", "float of a million digits", "small float of a million zeros"),
        *("huge exponent in degrees", "digits in degrees", "long string", "comments"),
        *("blank lines", "many arguments", "profile of the most points"),
        *("profile of a high series", "study the most values", "study long table of a law"),
    }


def test_limits_are_told(outcomes):
    for name, words in {
        "many pairs": "keys and tables, but at most 30000 are read",
        "long links": "values, but at most 200000 are read",
        "file sparse": "found 100000000 bytes, but at most 4194304 are read",
        "file pipe": "not a regular file",
        "file /dev/zero": "not a regular file",
        "deep arrays": "27: the tables and arrays are nested too deeply; at most 32",
        "signs": "hostile.toml:28: loads.l.torque: in the expression, column 151",
    }.items():
        assert words in outcomes[name][1]


def test_a_thousand_links_and_pairs_are_read_and_no_more():
    from helpers.hostile_files import FOUR_BAR

    def made(count):
        return FOUR_BAR + "".join(f"[links.q{k}]\n" for k in range(count - 4))

    assert len(loads(made(1000)).links) == 1000
    with pytest.raises(SpherekitError, match="has 1001 names, expected at most 1000"):
        loads(made(1001))


if __name__ == "__main__":
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    print(json.dumps(everything(Path(sys.argv[1]))))
