"""Analyses: the contract, discovery, broken plugins, declared needs."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
import pytest
from helpers.broken_plugins import Tuned
from helpers.entry_points import write_distribution
from helpers.minimal_analysis import MinimalAnalysis

import spherekit as sk
from spherekit.errors import AnalysisError, PluginError
from spherekit.runs.batch import Batch
from spherekit.runs.contract import Findings
from spherekit.runs.needs import Needs
from spherekit.runs.registry import (
    analysis_names,
    create_analysis,
    list_analyses,
    load_analysis,
    registered,
)
from spherekit.tables.table import (
    ASSEMBLY_MODE,
    INPUTS,
    SAMPLE,
    STATUS,
    Column,
    Table,
    input_columns,
)


@final
@dataclass(frozen=True, kw_only=True)
class Swing(MinimalAnalysis):
    """Analysis for tests: the swing (range of the angle) of one pair in each assembly mode.

    It needs all samples of a mode at once, so they are given to `compute` as one batch.
    This is the default of analyses. `needs` declares what it reads.
    """

    name: ClassVar = "swing"
    tables: ClassVar = (
        Table(
            "swing",
            "of each mode",
            (ASSEMBLY_MODE, Column("swing", "rad", meaning="range of the angle")),
        ),
    )
    pair: str = "41"

    def needs(self, mechanism):
        # This raises an error if the mechanism has no pair of this name.
        mechanism.pair(self.pair)
        return Needs(pair_values=frozenset([self.pair]))

    def compute(self, batch: Batch):
        values = batch.pair_value(self.pair)
        rows = batch.assembly_mode_rows()
        swing = np.array([np.ptp(values[mode_rows]) for mode_rows in rows.values()])
        return {"swing": {"assembly_mode": np.array([*rows]), "swing": swing}}


@final
@dataclass(frozen=True, kw_only=True)
class AnalysisWithUndeclaredReads(MinimalAnalysis):
    """Faulty analysis for tests: it reads `what` without having declared that it needs it.

    It declares only the direction of the pole (axis of relative rotation) of links 0 and 1.
    Two values of `what` are other faults. With "nonsense" the analysis raises an error.
    With "columns" it reads nothing. The table that it returns then has a column "other"
    that its declaration does not have.
    """

    name: ClassVar = "greedy"
    rowwise: ClassVar = True
    tables: ClassVar = (Table("greedy", "", (SAMPLE,)),)
    what: str = "velocity_coefficient"

    def needs(self, mechanism):
        return Needs(directions=frozenset([(0, 1)]))

    def compute(self, batch: Batch):
        reads = {
            "velocity_coefficient": lambda: batch.velocity_coefficient(0, 1),
            "pole": lambda: batch.direction(0, 2),
            "value": lambda: batch.pair_value("21"),
            # The variable of the pair, without jumps of whole turns.
            "continued": lambda: batch.continued_value("32"),
            "rotation": lambda: batch.rotation("2"),
            "acceleration_coefficient": lambda: batch.acceleration_coefficient(0, 1),
            "nonsense": lambda: 1 / 0,
            "columns": lambda: None,
        }
        reads[self.what]()
        return {"greedy": {"other": batch.sample}}


@final
@dataclass(frozen=True, kw_only=True)
class Ranges(MinimalAnalysis):
    """Analysis for tests: a column for each input, and findings with a warning.

    In a table, `INPUTS` stands for a column of each input. `batch.once` computes a value
    only once for all who ask. With `tracer=True` the analysis may read the position
    analysis of the run, from which it takes the number of assembly modes.
    """

    name: ClassVar = "ranges"
    tables: ClassVar = (Table("ranges", "one row per sample", (SAMPLE, INPUTS, STATUS)),)

    def needs(self, mechanism):
        return Needs(tracer=True)

    def compute(self, batch: Batch):
        inputs = batch.once("inputs", lambda: batch.inputs.copy())
        assert batch.once("inputs", lambda: None) is inputs
        columns = input_columns(batch.mechanism, inputs)
        return {"ranges": {"sample": batch.sample, **columns, "status": batch.status}}

    def findings(self, batch: Batch):
        widest = float(np.max(np.ptp(batch.inputs, axis=0)))
        modes = len(batch.tracer.assembly_modes)
        return Findings(
            figures={"widest": widest, "modes": modes},
            warnings=("So.",),
            remarks=("Yes.",),
        )


def test_columns_for_each_input_and_findings_in_the_summary():
    """Inputs have a column each (only `q` if there is one), and findings are in the
    summary.
    """
    result = sk.run("five_bar", Ranges(), samples=3)
    assert list(result.frame()) == ["sample", "q_21", "q_51", "status"]
    result = sk.run("four_bar", Ranges(), samples=3)
    assert list(result.frame()) == ["sample", "q", "status"]
    (entry,) = result.summary["analyses"]
    assert entry["findings"]["modes"] == 2
    assert entry["findings"]["widest"] == pytest.approx(2 * np.pi, abs=1e-12)
    assert result.summary["warnings"] == ["ranges: So."]
    assert result.summary["remarks"] == ["ranges: Yes."]


def test_poles_is_registered_like_anyones():
    assert "poles" in analysis_names()
    (own,) = [record for record in list_analyses() if record[0] == "poles"]
    assert own[1::2] == ("spherekit-mechanisms", "")
    assert load_analysis("poles").__module__ == "spherekit_analyses.poles"


def test_an_analysis_of_whole_batches():
    with registered(Swing):
        result = sk.run(
            sk.load("four_bar"), ["swing:pair=41", "poles:only=31"], samples=19, block=5
        )
    frame = result.frame("swing")
    assert list(frame["assembly_mode"]) == [0, 1]
    # the two modes of a four-bar mirror each other (theory of the paper's eq. 25)
    assert frame["swing"][0] == pytest.approx(frame["swing"][1], abs=1e-12)
    assert len(result.frame("poles")) == 2 * 19


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("velocity_coefficient", "Needs(rates=...)"),
        ("pole", "links 3 and 1"),
        ("value", 'pair_value("21")'),
        ("continued", 'continued_value("32")'),
        ("rotation", 'rotation("2")'),
        ("acceleration_coefficient", "derivatives=True"),
        ("nonsense", "ZeroDivisionError"),
        ("columns", "declared with columns"),
    ],
)
def test_faults_of_one_analysis_do_not_touch_the_others(what, words):
    """An analysis that fails is named with what it lacks; others have their results.

    `what` is what it reads without declaring it, `words` is part of the message.
    """
    with registered(AnalysisWithUndeclaredReads):
        result = sk.run(sk.load("four_bar"), [f"greedy:what={what}", "poles"], samples=5)
    assert words in result.failures["greedy"]
    assert len(result.frame("poles")) == 2 * 5 * 6
    with pytest.raises(AnalysisError, match="greedy failed"):
        result.frame("greedy")


def test_wrong_parameters_fail_before_anything_is_computed():
    with registered(Swing), pytest.raises(sk.SpherekitError, match="no pair is named"):
        sk.run(sk.load("four_bar"), "swing:pair=14")


def test_every_kind_of_parameter_can_be_given_on_the_command_line():
    assert create_analysis("poles:only=31+42,circles=42").only == ("31", "42")
    with registered(Tuned):
        made = create_analysis("tuned:count=3,kind=b,limit=2.5,ends=3+0.5,quick=true")
        assert made == Tuned(count=3, quick=True, kind="b", ends=(3.0, 0.5), limit=2.5)
        assert create_analysis("tuned:count=3,limit=none").limit is None
        for wrong in ("kind=left", "limit=x", "ends=1", "ends=1+2+3", "quick=maybe"):
            with pytest.raises(AnalysisError, match="does not read as"):
                create_analysis(f"tuned:count=3,{wrong}")


def test_the_same_name_twice_is_refused(tmp_path, monkeypatch):
    lines = "[spherekit.analyses]", "poles = helpers.broken_plugins:Sound"
    write_distribution(tmp_path, "third_party", *lines)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(PluginError, match="several installed packages"):
        load_analysis("poles")


def test_one_class_under_two_names_of_its_distribution_is_one(tmp_path, monkeypatch):
    """As where a distribution was installed before and after it was renamed."""
    analyses = "[spherekit.analyses]", "poles = spherekit_analyses.poles:Poles"
    mechanisms = "[spherekit.mechanisms]", "spherekit = spherekit_mechanisms"
    write_distribution(tmp_path, "third_party", *analyses, *mechanisms)
    monkeypatch.syspath_prepend(str(tmp_path))
    assert load_analysis("poles").name == "poles"
    assert len(sk.mechanisms()) == len(set(sk.mechanisms()))
    assert sk.load("four_bar").name == "four_bar"


def test_an_inner_block_gives_an_analysis_back_to_the_outer_block():
    @final
    @dataclass(frozen=True, kw_only=True)
    class OtherSwing(Swing):
        """Another analysis with the name of `Swing`."""

    with registered(Swing):
        with registered(OtherSwing):
            assert load_analysis("swing") is OtherSwing
        assert load_analysis("swing") is Swing
    assert "swing" not in analysis_names()


def test_a_faulty_class_of_this_process_is_refused_in_words():
    class Unnamed(MinimalAnalysis):
        pass

    class Unfrozen(Swing):
        pass

    Unfrozen.__dataclass_params__ = None
    with pytest.raises(PluginError, match="`name` is missing"), registered(Unnamed):
        pass
    with registered(Unfrozen):
        result = sk.run("four_bar", ["swing", "poles"], samples=3)
        (record,) = [item for item in list_analyses() if item.name == "swing"]
    assert "not a frozen dataclass" in result.failures["swing"]
    assert "not a frozen dataclass" in record.error
    assert len(result.frame("poles")) == 2 * 3 * 6


def test_a_folder_of_packages_that_cannot_be_read_is_passed_over(monkeypatch):
    """A name of 300 characters is too long for a folder."""
    monkeypatch.syspath_prepend("a" * 300)
    assert "poles" in analysis_names()


@final
@dataclass(frozen=True, kw_only=True)
class OneColumn(MinimalAnalysis):
    """Analysis for tests: returns any values in a column of any kind, and any findings."""

    name: ClassVar = "one_column"
    values: ClassVar = ()
    results: ClassVar = Findings()

    def compute(self, batch: Batch):
        return {"values": {"x": self.values}}

    def findings(self, batch: Batch):
        return self.results


def failure_of_one_column(monkeypatch, kind, values, findings=None):
    """Return why an analysis with these values in its only column fails; "" if it works."""
    table = Table("values", "of a test", (Column("x", "", "a value", kind),))
    monkeypatch.setattr(OneColumn, "tables", (table,), raising=False)
    monkeypatch.setattr(OneColumn, "values", values)
    monkeypatch.setattr(OneColumn, "results", findings or Findings())
    return sk.run("four_bar", OneColumn(), samples=3).failures.get("one_column", "")


@pytest.mark.parametrize(
    ("kind", "values", "first"),
    [
        ("integer", [1.0, np.inf], "inf"),
        ("integer", [1.0, 2.0**63], "9.223372036854775808e+18"),
        ("integer", np.array([1, 2**64 - 1], np.uint64), "18446744073709551615"),
        ("integer", [1.0, 2.5, 3.5], "2.5"),
        ("status", [0, 300], "300"),
        ("status", [0, -1], "-1"),
        ("status", [0, 13], "13"),
        ("number", [1.0, None], "None"),
        ("text", np.array(["a", 3], object), "3"),
    ],
)
def test_a_value_that_does_not_fit_its_column_is_refused_and_named(
    kind, values, first, monkeypatch
):
    failure = failure_of_one_column(monkeypatch, kind, values)
    number = failure.partition("but contains ")[2]
    assert number == first or float(number) == float(first)


@pytest.mark.parametrize(
    "values", [[True, False], np.array([1, 2], np.float16), [-(2**63), 2**63 - 1]]
)
def test_whole_numbers_of_any_type_are_accepted(values, monkeypatch):
    assert failure_of_one_column(monkeypatch, "integer", values) == ""


def test_masked_values_are_refused(monkeypatch):
    values = np.ma.array([1.0, 2.0], mask=[False, True])
    assert "masked" in failure_of_one_column(monkeypatch, "number", values)


@pytest.mark.parametrize(
    "findings", [{"remarks": "a sentence"}, {"warnings": (3,)}, {"tables": 5}]
)
def test_findings_of_another_type_are_refused(findings, monkeypatch):
    failure = failure_of_one_column(monkeypatch, "number", [1.0], Findings(**findings))
    assert f"{next(iter(findings))} has to be a tuple of" in failure
