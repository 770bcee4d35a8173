"""The sceptic: what it says of mechanisms that agree, and of evidence that is spoilt."""

import time

import numpy as np
import pytest

from benchmarks.sceptic import main, sections
from benchmarks.sceptic.check import CHECKS, Check
from benchmarks.sceptic.evidence import Evidence
from benchmarks.sceptic.examine import checked, examine
from benchmarks.sceptic.finding import HARMLESS, Kind
from benchmarks.sceptic.suspects import KINDS, Suspect, random_suspect, shipped_suspects
from spherekit.errors import SolveError

SAMPLES = 41
LONG = ("verify", "both engines", "simulation and inverse", "energy")
"""Checks that take more than a moment."""


@pytest.fixture
def evidence_of(tmp_path):
    def make(name):
        (suspect,) = shipped_suspects([name])
        return Evidence(Suspect(name, "shipped", suspect.mechanism, SAMPLES), tmp_path)

    return make


def findings(evidence, name):
    return [each for each in checked(evidence, name).findings if each.kind not in HARMLESS]


@pytest.mark.parametrize("name", ["four_bar", "roller_cam"])
def test_nothing_contradicts_in_mechanisms_that_agree(evidence_of, name):
    evidence = evidence_of(name)
    compared = 0
    for check in CHECKS:
        if check in LONG:
            continue
        notes = checked(evidence, check)
        assert not [each for each in notes.findings if each.kind not in HARMLESS]
        compared += notes.compared
    assert compared > 1000


FEW = (0, 1, 7)
"""Seeds whose dynamics are asked in every run; a cam that turns wheels takes longest."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed",
    [
        *FEW,
        *(
            pytest.param(seed, marks=pytest.mark.long)
            for seed in range(len(KINDS))
            if seed not in FEW
        ),
    ],
)
def test_the_dynamics_of_random_mechanisms_agree(tmp_path, seed):
    evidence = Evidence(random_suspect(seed), tmp_path)
    for check in LONG[2:]:
        assert not findings(evidence, check)


@pytest.mark.parametrize("seed", [0, 1, 2, 4, 7])
def test_random_mechanisms_are_the_same_each_time_and_move(seed):
    one, other = random_suspect(seed), random_suspect(seed)
    assert one.mechanism == other.mechanism
    assert one.kind == tuple(KINDS)[seed % len(KINDS)]


def spoilt(evidence, analysis, table, column, rows, value):
    """Change numbers of a table that a command has left."""
    frame = evidence.ran(analysis).tables[table]
    frame.loc[frame.index[rows], column] = value


@pytest.mark.parametrize(
    ("check", "analysis", "table", "column", "value"),
    [
        ("poles by default", "poles", "poles", "velocity_coefficient", np.nan),
        ("singularities by default", "singularities", "singularities", "q", 7.0),
        ("singularities by default", "singularities", "motion", "q", -1.0),
        ("relation and poles", "poles", "poles", "velocity_coefficient", 0.123),
        ("signs change at places", "singularities", "singularities", "turns", ""),
        ("distances lead to places", "singularities", "singularities", "q", 0.01),
    ],
)
def test_what_is_spoilt_is_found(evidence_of, check, analysis, table, column, value):
    """Each check on the evidence as it is, and with some numbers changed."""
    evidence = evidence_of("four_bar")
    assert not findings(evidence, check)
    frame = evidence.ran(analysis).tables[table]
    if str(frame[column].dtype) == "category":
        frame[column] = frame[column].astype(object)
    rows = slice(None) if table == "singularities" else slice(3, 12)
    spoilt(evidence, analysis, table, column, rows, value)
    assert findings(evidence, check)


def test_an_empty_table_without_a_word_is_found(evidence_of):
    evidence = evidence_of("four_bar")
    ran = evidence.ran("singularities")
    ran.tables["singularities"] = ran.tables["singularities"].iloc[:0]
    found = findings(evidence, "singularities by default")
    assert Kind.SILENT in {each.kind for each in found}


def test_a_check_that_hangs_or_fails_does_not_stop_the_others(monkeypatch):
    def hangs(evidence, notes):
        end = time.process_time() + 60.0
        while time.process_time() < end:
            pass

    def faulty(evidence, notes):
        raise IndexError("no such row")

    def refuses(evidence, notes):
        raise SolveError("out of reach")

    def fine(evidence, notes):
        notes.judged(3)

    asked = {
        "fine": fine,
        "hangs": hangs,
        "faulty": faulty,
        "refuses": refuses,
        "last": fine,
    }
    for name, ask in asked.items():
        monkeypatch.setitem(CHECKS, name, Check(name, "", ask))
    (examined,) = examine(shipped_suspects(["bevel_pair"]), tuple(asked), limit=0.3)
    kinds = {
        name: [f.kind for f in notes.findings] for name, notes in examined.noted.items()
    }
    assert kinds == {
        "fine": [], "hangs": [Kind.LATE], "faulty": [Kind.FAULT], "refuses": [], "last": [],
    }  # fmt: skip
    assert examined.noted["last"].compared == 3
    assert examined.noted["refuses"].refused
    assert examined.contradictions == 2
    text = "".join(str(section.rows) for section in sections([examined]))
    assert "no such row" in text


def test_the_exit_status_says_whether_anything_contradicts(monkeypatch, capsys):
    def wrong(evidence, notes):
        notes.contradiction(True, "two and two is five")

    monkeypatch.setitem(CHECKS, "wrong", Check("wrong", "", wrong))
    asked = ["--only", "bevel_pair", "--check"]
    assert main([*asked, "wrong"]) == 1
    assert "two and two is five" in capsys.readouterr().out
    assert main([*asked, "run and narrow run"]) == 0
