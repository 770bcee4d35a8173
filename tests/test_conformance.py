"""The conformance check of plugins, and runs with plugins that do not pass it."""

import re
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
import pytest
from helpers.broken_plugins import BROKEN, UNNOTICED, Sound
from helpers.entry_points import write_distribution

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import AnalysisError, PluginError
from spherekit.plugin import conformance, registered
from spherekit.plugin.checks.case_checks import ROTATION
from spherekit.plugin.checks.suite import ConformanceSuite
from spherekit.plugin.checks.variants import rename_links, rotate_mechanism
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.runs.contract import Findings
from spherekit.runs.registry import analysis_names
from spherekit.tables.table import Column, Table

BROKEN_AT_IMPORT = {
    "raises_at_import": ("raises_at_import:Thing", "RuntimeError: not today"),
    "wrong_entry_point": ("helpers.broken_plugins:NoSuchClass", "NoSuchClass"),
    "not_an_analysis": (
        "helpers.broken_plugins:TABLE",
        "not a subclass of AbstractAnalysis",
    ),
    "misnamed": ("helpers.broken_plugins:Tuned", "the class has another name, 'tuned'"),
    "old": ("helpers.broken_plugins:Old", "written for contract 0"),
    "unfinished": ("helpers.broken_plugins:Unfinished", "methods missing: compute"),
    "exits_at_import": ("exits_at_import:Thing", "SystemExit"),
}

BY_NAME = {cls.name: cls for cls in BROKEN}


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A folder with a distribution whose entry points lead to nothing that works."""
    (tmp_path / "raises_at_import.py").write_text('raise RuntimeError("not today")\n')
    (tmp_path / "exits_at_import.py").write_text("raise SystemExit(3)\n")
    lines = [f"{name} = {target}" for name, (target, _) in BROKEN_AT_IMPORT.items()]
    write_distribution(tmp_path, "broken", "[spherekit.analyses]", *lines)
    monkeypatch.syspath_prepend(str(tmp_path))


def failing(subject):
    report = ConformanceSuite(subject, ["four_bar"], 5).report()
    return [line.name for line in report.failing], report


@pytest.mark.slow
def test_a_sound_analysis_conforms():
    report = conformance(Sound)
    verdicts = {line.name: line.verdict for line in report}
    assert verdicts.pop("installed") == "not checked"
    assert set(verdicts.values()) == {"holds"}, str(report)
    assert re.search(r"^blocks +holds +of 1 and 4 samples$", str(report), re.M)


@pytest.mark.slow
def test_a_mechanism_that_does_not_close_is_refused_beside_others():
    made = sk.load("four_bar")
    apart = made.with_inputs("41", ranges={"41": (0, 1)}, angle_unit="deg")
    report = conformance("poles", mechanisms=[made, apart], samples=3)
    assert not report.failing
    assert "refuses four_bar (four_bar: the arcs cannot" in str(report)


@pytest.mark.parametrize("broken", BROKEN, ids=lambda cls: cls.name)
def test_each_broken_one_fails_its_line(broken):
    failing_lines, report = failing(broken)
    assert failing_lines == [BROKEN[broken]], str(report)
    assert "Traceback" not in str(report)


@pytest.mark.parametrize("name", BROKEN_AT_IMPORT)
def test_what_does_not_load_fails_as_installed(name, installed):
    failing_lines, report = failing(name)
    assert failing_lines == ["installed"]
    assert BROKEN_AT_IMPORT[name][1] in report["installed"].note


def test_what_does_not_load_is_listed_beside_the_others(installed, capsys):
    assert main(["analyses"]) == 0
    said = capsys.readouterr().out
    assert all(f"BROKEN: analysis {name} of broken" in said for name in BROKEN_AT_IMPORT)
    assert "pole axes and velocity coefficients" in said


def test_what_is_installed_later_on_is_found(installed, tmp_path):
    assert "raises_at_import" in analysis_names() and "later" not in analysis_names()
    write_distribution(tmp_path, "later", "[spherekit.analyses]", "later = later:Later")
    assert "later" in analysis_names()


def test_all_failing_lines_are_raised():

    class Both(BY_NAME["keeps_its_axes"], BY_NAME["scene_raises"]):
        """Broken twice."""

        name = "both"

    with pytest.raises(PluginError, match=r"(?s)Both does not .*rotation: .*scene: "):
        conformance(Both, mechanisms=["four_bar"])


def run(name, folder, capsys):
    """Run a plugin and `poles`; return exit status, and what is said on stderr."""
    recording = str(folder / "x.rrd")
    asked = ["-a", name, "-a", "poles", "--samples", "5", "-o", str(folder / "out")]
    status = main(["run", "four_bar", *asked, "--save", recording])
    assert (folder / "out" / "poles.csv").read_text().count("\n") == 1 + 5 * 2 * 6
    said = capsys.readouterr().err.splitlines()
    return status, [line for line in said if line.startswith("spherekit: ")]


@pytest.mark.many
@pytest.mark.parametrize("broken", BROKEN, ids=lambda cls: cls.name)
def test_no_mistake_stops_a_run(broken, tmp_path, capsys):
    with registered(broken):
        status, said = run(broken.name, tmp_path, capsys)
    if broken.name in UNNOTICED:
        assert (status, said) == (0, [])
        return
    (sentence,) = said
    assert status == 4
    assert re.match(rf"spherekit: analysis {broken.name} failed: \w", sentence)
    assert "Traceback" not in sentence and len(sentence) < 400


@pytest.mark.many
@pytest.mark.parametrize("name", BROKEN_AT_IMPORT)
def test_nothing_that_does_not_load_stops_a_run(name, installed, tmp_path, capsys):
    status, (sentence,) = run(name, tmp_path, capsys)
    assert status == 4 and BROKEN_AT_IMPORT[name][1] in sentence


def test_the_reason_is_told_in_python():
    with registered(BY_NAME["raises"]):
        result = sk.run(sk.load("four_bar"), "raises", samples=5)
        said = r"^analysis raises failed: compute raises ZeroDivisionError.*line \d+\)$"
        with pytest.raises(AnalysisError, match=said):
            result.frame("raises")


def test_the_trace_is_shown_when_asked_for(tmp_path, capsys):
    with registered(BY_NAME["raises"]):
        main(["run", "four_bar", "-a", "raises", "--samples", "5", "--traceback"])
    assert "in compute\n" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["four_bar", "five_bar", "roller_cam", "eight_bar_04"])
def test_a_mechanism_turned_or_renamed_is_the_same(name):
    """Its configurations have the same pair axes, turned with the mechanism."""
    given = replace(sk.load(name), loads=())
    names = {given.ground: "base"} | {link: f"b_{link}" for link in given.links[:0:-1]}
    motions = [
        PositionAnalysis(made, samples=4, search=False).motion()
        for made in (given, rotate_mechanism(given, ROTATION), rename_links(given, names))
    ]
    first, other, third = motions
    np.testing.assert_allclose(other.axes, first.axes @ ROTATION.T, atol=1e-12)
    np.testing.assert_allclose(third.axes, first.axes, atol=1e-12)


SHIPPED = {
    "poles": "four_bar",
    "dynamics": "five_bar",
    "eksergian": "four_bar",
    "reactions": "five_bar",
    "statics:stiffness=50+80": "five_bar",
    "singularities:output=4/1": "four_bar",
    "workspace": "five_bar",
    "inverse_kinematics:poses=21=77.5+51=77.5+21=70+51=75": "five_bar",
    "equivalent_rotation:start=21=70+51=72,end=21=77.5+51=77.5": "five_bar",
}
"""With parameters that mean the same in any axes: poses by inputs."""


@pytest.mark.many
@pytest.mark.parametrize("asked", SHIPPED, ids=lambda asked: asked.partition(":")[0])
def test_shipped_analyses_conform(asked):
    report = conformance(asked, mechanisms=[SHIPPED[asked]], samples=5)
    left_out = {line.name for line in report if line.verdict == "not checked"}
    # The main table of poses has rows of samples, and these analyses read none.
    empty = {"tables"} if asked.startswith("inverse_kinematics") else set()
    assert left_out <= {"blocks", "failed rows"} | empty, str(report)


def line_of(name, **changes):
    """Return a line of the report of `Sound` with changed attributes."""
    changed = type("Changed", (Sound,), {"__module__": __name__, **changes})
    return ConformanceSuite(changed, ["four_bar"], 5).report()[name]


def test_a_dataclass_without_docstring_fails_the_line_metadata():
    """Python gives such a class the signature of its constructor as docstring."""

    @dataclass(frozen=True)
    class Undocumented(Sound):
        pass

    report = ConformanceSuite(Undocumented, ["four_bar"], 5).report()
    assert "the class has no docstring" in report["metadata"].note


def test_an_analysis_without_tables_is_checked_without_a_traceback():
    line = line_of("tables", tables=(), compute=lambda self, batch: {})
    assert (line.verdict, line.note) == ("not checked", "four_bar: it has no tables")


def test_parameters_that_the_class_computes_are_not_renamed():
    @dataclass(frozen=True)
    class Computing(Sound):
        """A parameter that the constructor does not take."""

        extra: int = field(init=False, default=3)

    report = ConformanceSuite(Computing, ["four_bar"], 5).report()
    assert report["names"].verdict == "holds", str(report)


def test_a_constructor_that_knows_names_of_links_fails_the_line_names():
    @dataclass(frozen=True)
    class Knowing(Sound):
        """Accepts only one name of a link."""

        of: str = "2"

        def __post_init__(self):
            if self.of != "2":
                raise ValueError("unknown link")

    line = ConformanceSuite(Knowing, ["four_bar"], 5).report()["names"]
    assert line.verdict == "FAILS"
    assert "its constructor raises ValueError: unknown link" in line.note


def test_a_row_more_with_other_names_fails_the_line_names():
    def compute(self, batch):
        links = batch.mechanism.links
        return {"links": {"link": [*links, "another"] if links[0] != "1" else [*links]}}

    table = Table("links", "of a test", (Column("link", "", "a link", "text"),))
    line = line_of("names", rowwise=False, tables=(table,), compute=compute)
    assert "table links has 5 rows instead of 4" in line.note


def test_figures_in_any_mapping_can_be_compared_in_blocks():
    findings = Findings(figures=MappingProxyType({"number": 1.0}))
    line = line_of("blocks", findings=lambda self, batch: findings)
    assert line.verdict == "holds", line.note


def test_the_part_of_findings_that_depends_on_blocks_is_named():
    def findings(self, batch):
        return Findings(remarks=(f"{len(batch)} rows.",))

    note = line_of("blocks", findings=findings).note
    assert "remarks of the findings in blocks of 1 sample are ['2 rows.'" in note


def test_no_mechanism_is_not_called_a_refusal():
    with pytest.raises(PluginError, match="the list of mechanisms is empty"):
        conformance(Sound, mechanisms=[])


@pytest.mark.slow
def test_columns_named_by_links_are_compared_under_other_names():
    """The arc lengths of a contact have the names of its links in their columns."""

    def compute(self, batch):
        table = columns_table.of(batch.mechanism)
        return {"columns": {column.name: np.zeros(1) for column in table.columns}}

    variable = Column("value", "", "a variable", per_passive=True)
    columns_table = Table("columns", "of a test", (variable,))
    changes = {"rowwise": False, "tables": (columns_table,), "compute": compute}
    changed = type("Changed", (Sound,), {"__module__": __name__, **changes})
    names = [column.name for column in columns_table.of(sk.load("roller_cam")).columns]
    assert "s_contact_cam" in names
    line = ConformanceSuite(changed, ["roller_cam"], 3).report()["names"]
    assert line.verdict == "holds", line.note
