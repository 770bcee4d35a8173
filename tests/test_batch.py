"""What an analysis reads from a batch: signs, arrays, messages, errors of plugins."""

import runpy
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar, final

import numpy as np
import pytest
from helpers.minimal_analysis import MinimalAnalysis

import spherekit as sk
from spherekit.runs import analysis_faults
from spherekit.runs.batch import Batch
from spherekit.runs.needs import Needs
from spherekit.tables.table import SAMPLE, Table


@final
@dataclass(frozen=True, kw_only=True)
class Reading(MinimalAnalysis):
    """An analysis by which a test looks at the batches of a run.

    A run is computed in batches (blocks of samples). A batch has only the quantities that
    an analysis asks for.

    Attributes
    ----------
    declared
        The quantities for which the analysis asks; none by default.
    read
        Function that is called with each batch. Its result is not used.
    """

    name: ClassVar = "reading"
    # Rows do not depend on each other, so a batch need not have all samples.
    rowwise: ClassVar = True
    tables: ClassVar = (Table("reading", "one row per sample", (SAMPLE,)),)
    declared: Needs = field(default_factory=Needs)
    read: Callable[[Batch], Any] = len

    def needs(self, mechanism):
        return self.declared

    def compute(self, batch: Batch):
        self.read(batch)
        return {"reading": {"sample": batch.sample}}


def read_batch(mechanism, declared, read, samples=3):
    """Return what a function returns for the batch of a run, or the reason of its error."""
    results: list[Any] = []
    analysis = Reading(declared=declared, read=lambda batch: results.append(read(batch)))
    try:
        failures = sk.run(mechanism, analysis, samples=samples).failures
    except sk.SpherekitError as error:
        return str(error)
    return failures.get("reading") or results[0]


def test_a_table_of_poles_states_the_same_motion_for_links_in_any_order():
    """The velocity coefficient is that of the link with the larger index."""
    declared = Needs(rates=frozenset([(0, 2)]), derivatives=True)

    def read(batch):
        for poles in ([(0, 2, 0)], [(2, 0, 0)]):
            columns = batch.pole_columns(poles)
            yield {name: np.asarray(column).tolist() for name, column in columns.items()}

    rising, falling = read_batch("four_bar", declared, lambda batch: [*read(batch)])
    assert rising["link"][0] == "3"
    assert rising == falling


def test_a_table_without_poles_has_no_rows():
    columns = read_batch("four_bar", Needs(), lambda batch: batch.of_poles([]))(
        "direction", 0
    )
    assert np.asarray(columns).shape == (0,)
    frame = sk.evaluate("four_bar", 0.5, poles=[]).frame()
    assert len(frame) == 0
    assert [*frame] == [*sk.evaluate("four_bar", 0.5).frame()]


# Many samples are evaluated by a kernel, which computes columns when they are read.
@pytest.mark.parametrize("samples", [3, 20001])
@pytest.mark.parametrize(
    ("quantity", "component", "words"),
    [
        ("direction", None, "the component None, expected 0 or 1 or 2"),
        ("direction", 3, "the component 3, expected 0 or 1 or 2"),
        ("velocity_coefficient", 0, "the component 0, expected None"),
        ("error_bound", 1, "the component 1, expected None"),
    ],
)
def test_a_column_of_a_component_that_does_not_exist_is_refused(
    quantity, component, words, samples
):
    declared = Needs(rates=frozenset([(0, 2)]), derivatives=True)
    reason = read_batch(
        "four_bar",
        declared,
        lambda batch: batch.of_poles([(0, 2, 0)])(quantity, component),
        samples,
    )
    assert f"{quantity}: found {words}" in reason


def test_the_rates_of_pairs_cannot_be_written_to():
    rates = read_batch(
        "four_bar", Needs(pair_rates=frozenset(["41"])), lambda batch: batch.pair_rate("41")
    )
    with pytest.raises(ValueError, match="read-only"):
        rates[0] = 0.0


@pytest.mark.parametrize(
    ("declared", "read", "words"),
    [
        (Needs(), lambda batch: batch.angular_velocity("2"), 'angular_velocity("2")'),
        (
            Needs(rates=frozenset([(0, 2)]), derivatives=True),
            lambda batch: batch.angular_velocity_dq("2"),
            'angular_velocity_dq("2")',
        ),
    ],
)
def test_an_undeclared_angular_velocity_is_named_with_its_declaration(
    declared, read, words
):
    reason = read_batch("four_bar", declared, read)
    assert f"{words} was read; declare it in Needs(link_rates=...)" in reason


def test_the_range_of_several_inputs_is_refused_with_what_to_read():
    reason = read_batch("five_bar", Needs(), lambda batch: batch.q_range)
    assert "five_bar has 2 inputs; read inputs, input_rates or" in reason


def test_continued_angles_are_counted_from_input_zero():
    """A continued angle does not depend on the input at which the run begins.

    A continued angle has no jumps of whole revolutions. It is within half a revolution
    where the input is zero, and is continued from there. So at the input 5 rad it can be
    beyond half a revolution, even if the run begins there. A run that begins at zero must
    reach the same angles at 5 rad.
    """
    declared = Needs(continued_values=frozenset(["32"]))

    def read(path):
        """Return the angles (two assembly modes, samples) of pair 32 along a path."""
        results: list[Any] = []
        analysis = Reading(
            declared=declared,
            read=lambda batch: results.append(batch.continued_value("32")),
        )
        sk.run("four_bar", analysis, path=path)
        return results[0].reshape(2, -1)

    angles = read([5.0, 4.5, 4.0])
    assert np.max(np.abs(angles)) > np.pi
    whole_revolution = read(np.linspace(0.0, 5.0, 51))
    assert np.all(np.abs(whole_revolution[:, 0]) <= np.pi)
    assert angles[:, 0] == pytest.approx(whole_revolution[:, -1], abs=1e-9)


@pytest.mark.parametrize("name", ["spherekit_plugin", "numpy_plugin"])
def test_an_error_in_a_package_named_like_a_library_is_located(name, tmp_path, monkeypatch):
    """A folder that begins with the name of a library is another folder."""
    folders = tuple(str(tmp_path / library) for library in ("spherekit", "numpy"))
    monkeypatch.setattr(analysis_faults, "LIBRARY_FOLDERS", folders)
    plugin = tmp_path / name / "part.py"
    plugin.parent.mkdir()
    plugin.write_text("\n1 / 0\n")
    with pytest.raises(ZeroDivisionError) as caught:
        runpy.run_path(str(plugin))
    assert analysis_faults.describe_exception(caught.value).endswith("(part.py, line 2)")
