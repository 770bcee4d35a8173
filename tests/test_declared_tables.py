"""Faulty declarations of analyses are named, and no table or earlier result is lost."""

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
import pytest
from helpers.minimal_analysis import MinimalAnalysis, with_row_columns

import spherekit as sk
from spherekit.errors import AnalysisError
from spherekit.runs.contract import Findings
from spherekit.runs.declaration_checks import find_class_fault
from spherekit.tables.table import ASSEMBLY_MODE, INPUTS, SAMPLE, Column, Table

SOME_COLUMN = Column("height", "", "a number")


def make_analysis(*tables: Table, **attributes: Any) -> type[MinimalAnalysis]:
    """Return the class of an analysis with some tables; its name is "small" by default."""

    class Small(MinimalAnalysis):
        name: ClassVar = "small"
        rowwise: ClassVar = True

        def compute(self, batch):
            table, *_ = self.tables
            numbers = {column.name: np.zeros(len(batch)) for column in table.columns}
            return {item.name: {**numbers, **with_row_columns(batch)} for item in tables}

    for key, value in {"tables": tables, **attributes}.items():
        setattr(Small, key, value)
    return dataclass(frozen=True)(Small)


def make_table(*columns: Column, name: str = "small") -> Table:
    """Return a table with the sample, the assembly mode and some columns."""
    return Table(name, "of a test", (SAMPLE, ASSEMBLY_MODE, *columns))


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (make_table(replace(SOME_COLUMN, kind="float")), 'kind: found "float"'),
        (make_table(replace(SOME_COLUMN, unit=None)), "unit is None"),
        (make_table(replace(SOME_COLUMN, unit="10")), "'10' is not a unit"),
        (make_table("height"), "each item is a Column"),
        (replace(make_table(), name=3), "name is 3"),
    ],
)
def test_fields_of_wrong_types_in_a_table_are_named(table, words):
    """They are found before anything is computed, and other analyses have results."""
    analysis = make_analysis(table)
    assert words in find_class_fault(analysis)
    result = sk.run("four_bar", [analysis(), "poles"], samples=3)
    assert words in result.failures["small"]
    assert len(result.frame("poles"))


def test_an_object_of_a_faulty_class_does_not_stop_the_other_analyses(tmp_path):
    """One class has no name, the other is no dataclass."""

    class Nameless(MinimalAnalysis):
        tables: ClassVar = (make_table(),)

        def compute(self, batch):
            return {}

    class Bare(Nameless):
        name: ClassVar = "bare"

    result = sk.run(
        "four_bar", [Nameless(), Bare(), "poles"], samples=3, folder=tmp_path / "run"
    )
    assert "`name` is missing" in result.failures["Nameless"]
    assert "not a frozen dataclass" in result.failures["bare"]
    assert len(result.frame("poles"))


@pytest.mark.parametrize(
    ("mechanism", "columns", "name"),
    [
        ("four_bar", [Column("mode_name", "", "a text", "text")], "mode_name"),
        ("five_bar", [INPUTS, Column("q_21", "rad", "an angle")], "q_21"),
    ],
)
def test_columns_that_the_mechanism_adds_replace_no_declared_column(
    mechanism, columns, name
):
    """The names of assembly modes, and the columns of several inputs."""
    analysis = make_analysis(make_table(*columns))
    failures = sk.run(mechanism, analysis(), samples=3).failures
    assert f"2 columns have the name '{name}'" in failures["small"]


@pytest.mark.parametrize("other_name", ["small_more", "motion_events"])
def test_analyses_whose_tables_have_the_same_file_name_are_refused(other_name):
    first = make_analysis(make_table(), make_table(name="more"))
    other = make_analysis(make_table(), name=other_name)
    with pytest.raises(AnalysisError, match=f"table '{other_name}' has the name"):
        sk.run("four_bar", [first(), other()], samples=3)


def test_a_column_on_request_is_left_out_if_its_parameter_has_a_default_factory():
    analysis = make_analysis(
        make_table(replace(SOME_COLUMN, on_request="heights")),
        heights=field(default_factory=tuple),
        __annotations__={"heights": tuple[float, ...]},
    )
    (table,) = analysis().requested_tables()
    assert SOME_COLUMN.name not in [column.name for column in table.columns]
    (table,) = analysis((1.0,)).requested_tables()
    assert SOME_COLUMN.name in [column.name for column in table.columns]


def test_equal_findings_with_tuples_and_nan_are_equal_after_a_run_is_resumed(tmp_path):
    """A run that is stopped and resumed accepts findings that are equal in all blocks.

    Findings are results of an analysis in addition to its tables. A run computes them for
    each block of samples. By default it refuses findings that differ from those of earlier
    blocks. After a resume, the earlier findings come from the journal of the run, where
    tuples have become lists. NaN is not equal to itself either. Neither may count as a
    difference.
    """

    def find(self, batch):
        return Findings(figures={"range": (0, 1), "least": float("nan")})

    analysis = make_analysis(make_table(), findings=find)
    options = {"samples": 9, "block": 3, "folder": tmp_path / "run"}

    def stop(samples_done, sample_count):
        """Stop the run after its first block."""
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sk.run("four_bar", analysis(), progress=stop, **options)
    result = sk.run("four_bar", analysis(), unfinished="resume", **options)
    assert not result.failures
    assert len(result.frame("small")) == 2 * 9  # two assembly modes
