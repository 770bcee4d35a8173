"""What one analysis says of a mechanism against what another says of it."""

import warnings

import numpy as np
import pytest
from cross_checks import assembly_modes as modes  # noqa: F401
from cross_checks import default_commands as commands  # noqa: F401
from cross_checks import dynamics  # noqa: F401
from cross_checks import singularities as singular  # noqa: F401
from cross_checks.evidence import CHECKS, Evidence, Kind, Notes
from cross_checks.mechanisms import KINDS, Subject, random_subject, shipped_subjects

from spherekit.errors import SpherekitError
from spherekit.files.library import shipped

SAMPLES = 41
DYNAMICS = "simulation and inverse"
"""A check that takes more than a moment."""


def findings(evidence, name):
    """Run a check of one mechanism and return its findings: contradictions of analyses.

    A result that a search missed is no finding if the search itself says that it may be
    incomplete (`notes.wrong` leaves it out). A mechanism that the package refuses has no
    findings. A warning of NumPy is an error.

    Parameters
    ----------
    evidence
        The mechanism with its runs. The number of comparisons is added to its attribute
        `compared`, so that tests notice a check that compares nothing.
    name
        Name of the check.

    Returns
    -------
    List of (name of the check, kind of contradiction, its words).
    """
    notes = Notes()
    # Random numbers of the check do not depend on checks before it.
    evidence.begin_check(name)
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        try:
            CHECKS[name](evidence, notes)
        except SpherekitError:
            return []
    evidence.compared = getattr(evidence, "compared", 0) + notes.compared
    return [(name, kind, words) for kind, words in notes.wrong]


@pytest.fixture
def evidence_of(tmp_path):
    def make(name):
        (subject,) = shipped_subjects([name])
        return Evidence(Subject(name, "shipped", subject.mechanism, SAMPLES), tmp_path)

    return make


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("name", ["four_bar", "roller_cam"])
def test_nothing_contradicts_in_mechanisms_that_agree(evidence_of, name):
    evidence = evidence_of(name)
    for check in set(CHECKS) - {DYNAMICS}:
        assert not findings(evidence, check)
    assert evidence.compared > 1000


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(n for pack in shipped() for n in pack.files))
def test_nothing_contradicts_in_shipped_mechanisms(evidence_of, name):
    evidence = evidence_of(name)
    assert not [each for check in CHECKS for each in findings(evidence, check)]


@pytest.mark.long
@pytest.mark.parametrize("seed", range(50))
def test_nothing_contradicts_in_random_mechanisms(tmp_path, seed):
    evidence = Evidence(random_subject(seed), tmp_path)
    assert not [each for check in CHECKS for each in findings(evidence, check)]


@pytest.mark.many
@pytest.mark.parametrize("seed", [0, 1])
def test_the_dynamics_of_random_mechanisms_agree(tmp_path, seed):
    evidence = Evidence(random_subject(seed), tmp_path)
    assert not findings(evidence, DYNAMICS)


@pytest.mark.parametrize("seed", [0, 1, 2, 4, 7])
def test_random_mechanisms_are_the_same_each_time_and_move(seed):
    one, other = random_subject(seed), random_subject(seed)
    assert one.mechanism == other.mechanism
    assert one.kind == tuple(KINDS)[seed % len(KINDS)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("check", "analysis", "table", "column", "value"),
    [
        ("poles by default", "poles", "poles", "velocity_coefficient", np.nan),
        ("singularities by default", "singularities", "singularities", "q", 7.0),
        ("singularities by default", "singularities", "motion", "q", -1.0),
    ],
)
def test_a_check_finds_numbers_that_were_changed(
    evidence_of, check, analysis, table, column, value
):
    """The check has no finding for the four-bar, but has one after a column is changed."""
    evidence = evidence_of("four_bar")
    assert not findings(evidence, check)
    frame = evidence.run_analysis(analysis).tables[table]
    rows = slice(None) if table == "singularities" else slice(3, 12)
    frame.loc[frame.index[rows], column] = value
    assert findings(evidence, check)


@pytest.mark.slow
def test_an_empty_table_without_a_word_is_found(evidence_of):
    evidence = evidence_of("four_bar")
    result = evidence.run_analysis("singularities")
    result.tables["singularities"] = result.tables["singularities"].iloc[:0]
    found = findings(evidence, "singularities by default")
    assert Kind.SILENT in {kind for _, kind, _ in found}
