"""What `spherekit sweep` prints: the best designs by each figure of merit."""

import math
from typing import TYPE_CHECKING, Any

from spherekit.cli.mode_text import number_list
from spherekit.cli.screen_report import ScreenReport
from spherekit.conventions import Lines
from spherekit.number_text import degree_range_text, degrees_text, number_text
from spherekit.tables.screen_table import ScreenColumn, ScreenTable
from spherekit.type_checks import NUMERIC_KINDS
from spherekit.wording import counted, listing, numbered, without_numbers

if TYPE_CHECKING:
    from spherekit.designs.sweep import Sweep
    from spherekit.designs.sweep_parts import SweepResult

MANY_FIGURES = 2
"""Number of figures of merit beyond which only one design is printed for each extreme."""

MAX_DESIGN_WORDS_LENGTH = 50
"""Characters of the longest list of design numbers within a line."""

DESIGNS_PER_EXTREME = 3
"""Number of printed designs with the largest, and with the smallest, value of a figure."""

MAX_PRINTED_REASONS = 5
"""Largest number of printed reasons for impossible designs, the most frequent first."""

ROUNDING = 1e-12
"""Numbers smaller than this, relative to the largest of their column, print as 0."""

EQUAL = 1e-9
"""Relative difference up to which modes of one design have the same figure of merit."""


def sweep_report(result: "SweepResult") -> ScreenReport:
    """Return the report on a finished sweep, with the best designs.

    A sweep analyses many designs (choices of sizes) of one mechanism. A figure of merit is
    a number that rates a design. An assembly mode is one way to assemble the mechanism.

    Parameters
    ----------
    result
        The results of the sweep. `frame` has a row for each assembly mode of each design.
    """
    import numpy as np

    sweep = result.sweep
    frame: Any = result.frame()
    # `mode_labels` is empty if no single mode is requested. Without a search of modes, it
    # depends on the mechanism whether all are computed.
    modes = "all its assembly modes" if sweep.searches_modes else "its assembly modes"
    if sweep.mode_labels:
        modes = "one assembly mode"
    report = ScreenReport(
        f"{sweep.mechanism.name}: {counted(sweep.space.count, 'design')}, each in {modes}, "
        f"with varied {_varied_sizes(result)}{_sample_words(sweep)}"
    )
    if frame.empty:
        report.results.append(f"0 rows: none meets {' and '.join(sweep.where)}")
    else:
        is_valid = np.array(frame["status"] == "OK")
        report.results.append(_count_rows(frame, is_valid, sweep.where))
        ranked = _ranked_rows(frame[is_valid])
        table = _best_designs(result, ranked)
        report.results += table
        ranks_whole_modes = np.all(ranked["closes"] >= 1.0)
        has_partial_modes = np.any(frame[is_valid]["closes"] < 1.0)
        if table and ranks_whole_modes and has_partial_modes:
            report.results.append(
                "This table leaves out modes that exist at a part of the samples only. As "
                "a rule they end at dead centres (type II singularities), near which "
                "velocity ratios and torques grow without bound."
            )
        ranked_change_points = _change_point_rows(ranked)
        change_points = _change_point_rows(frame[is_valid])
        if table and ranked_change_points.empty and not change_points.empty:
            report.results.append(
                f"This table leaves out {_describe_change_points(result, change_points)}"
            )
        report.results += _count_texts(result, frame[is_valid])
        if not ranks_whole_modes:
            report.warnings.append(
                "No mode exists at all samples. As a rule they end at dead centres (type "
                "II singularities). There a transmission angle is 0, and velocity ratios "
                "and torques grow without bound. The largest and smallest figures depend "
                "on how near the samples fall to the dead centres, so do not rank designs "
                "by them."
            )
        if table and not ranked_change_points.empty:
            text = _describe_change_points(result, ranked_change_points)
            report.warnings.append(
                f"The table contains {text} Do not rank designs by these figures."
            )
        report.warnings += _describe_reasons(frame[~is_valid])
    report.accuracy = "; ".join(
        [
            f"figures of merit are computed from samples{_sample_distance(sweep)}; the "
            "true extreme of a design can lie between two samples. No error is computed",
            *result.remarks,
        ]
    )
    if result.folder:
        # A part is a file with the rows of some successive designs.
        data_sets = "".join(f", {folder}" for folder in result.data_sets if sweep.tables)
        report.files = (
            f"all rows in {result.folder}{data_sets} (Parquet; read them with "
            "pandas.read_parquet)"
        )
        report.details.append(
            f"{counted(sweep.part_count, 'part')}, {result.computed} computed now"
        )
    else:
        report.files = "not saved; add -o DIR for all rows"
    return report


def _varied_sizes(result: "SweepResult") -> str:
    """Return the varied sizes with their ranges and unit."""
    sweep = result.sweep
    units = sweep.units()
    texts = []
    for variable, variation in zip(sweep.variables, sweep.space.variations, strict=True):
        unit = units.get(variable.name) or ""
        if variation.low == variation.high:
            values = f"= {variation.low:g} {unit}"
        else:
            values = f"from {variation.low:g} to {variation.high:g} {unit}"
        texts.append(f"{variation.key} {values}".rstrip())
    return ", ".join(texts)


def _sample_words(sweep: "Sweep") -> str:
    """Return in words at which inputs each design of a sweep is analysed.

    An example is ``; 361 samples, input 21 from 0 to 360 deg``. The text is empty if the
    sweep has no samples.
    """
    if sweep.samples is None:
        return ""
    ranges = []
    for column, pair in enumerate(sweep.samples.inputs):
        # The first columns of the samples are the inputs (rad), in their order.
        values = sweep.samples.rows[:, column]
        ranges.append(f"{pair} from {degree_range_text(min(values), max(values))} deg")
    count = "x".join(map(str, sweep.samples.shape))
    noun = "input" if len(ranges) == 1 else "inputs"
    return f"; {counted(count, 'sample')}, {noun} {' and '.join(ranges)}"


def _sample_distance(sweep: "Sweep") -> str:
    """Return in words how far apart samples of the only input are, or an empty text.

    An example is `` (1 deg of input 21 apart)``, or ``up to 1 deg`` for unequal distances.
    """
    import numpy as np

    samples = sweep.samples
    if samples is None or len(samples.inputs) != 1 or len(samples.rows) < 2:
        return ""
    distances = abs(np.diff(samples.rows[:, 0]))
    least = degrees_text(np.min(distances))
    largest = degrees_text(np.max(distances))
    limit = "" if least == largest else "up to "
    return f" ({limit}{largest} deg of input {samples.inputs[0]} apart)"


def _ranked_rows(frame: Any) -> Any:
    """Return the rows with the figures of merit by which designs are ranked.

    A row is an assembly mode of a design. The modes that exist at all samples are ranked,
    or all modes if there are no such modes. Figures of a mode that ends depend on how near
    the last sample is to the end. Figures of a change-point four-bar depend on how near a
    sample is to its change point, so these designs are left out if others remain.

    Parameters
    ----------
    frame
        The rows with figures of merit.
    """
    exists_at_all_samples = frame["closes"] >= 1.0
    ranked = frame[exists_at_all_samples] if exists_at_all_samples.any() else frame
    others = ranked.drop(_change_point_rows(ranked).index)
    return ranked if others.empty else others


def _count_rows(frame: Any, is_valid: Any, where: tuple[str, ...]) -> str:
    """Return in words how many rows a sweep has, and how many exist at all samples.

    A row is one assembly mode (way to assemble the mechanism) of one design. The row exists
    at an input if the loops of links close at this input.

    Parameters
    ----------
    frame
        The table of the sweep. Its column ``closes`` is the share of samples at which the
        mode exists.
    is_valid
        Mask (rows,) of the rows that have figures of merit (numbers that rate the design).
        A row of a failed design has no figures.
    where
        The conditions of ``--where``, which all rows meet.
    """
    text = f"{counted(len(frame), 'row')}, one for each design and assembly mode"
    if where:
        text += f", that meet {' and '.join(where)}"
    failed_count = int((~is_valid).sum())
    if failed_count:
        text += (
            f"; {failed_count} of them have impossible dimensions or cannot be assembled "
            "at any sample"
        )
    valid_rows = frame[is_valid]
    # The share of samples at which each row exists.
    closes = valid_rows["closes"]
    partial_rows = valid_rows[closes < 1.0]
    if len(partial_rows):
        # A text such as " (designs 9-12)", empty for a long list.
        designs_text = _design_words(partial_rows)
        text += (
            f"; {len(partial_rows)} of the rows{designs_text} exist only at some of the "
            f"samples, each at {_percentage(closes.min())} % or more"
        )
    elif len(valid_rows):
        subject = "the others" if failed_count else "all"
        text += f"; {subject} exist at all samples"
    return text


def _percentage(share: float) -> str:
    """Return a share as text in percent; a share below 1 does not become ``100``."""
    return number_text(min(100.0 * share, 99.9) if share < 1.0 else 100.0, digits=3)


def _design_words(frame: Any) -> str:
    """Return the numbers of the designs in some rows as text, such as `` (designs 9-12)``.

    The text is empty if it would be longer than `MAX_DESIGN_WORDS_LENGTH`.
    """
    designs = sorted({int(design) for design in frame["design"]})
    noun = "design" if len(designs) == 1 else "designs"
    text = f" ({noun} {number_list(designs)})"
    return text if len(text) <= MAX_DESIGN_WORDS_LENGTH else ""


def _best_designs(result: "SweepResult", frame: Any) -> list[str | ScreenTable]:
    """Return a table of the designs with the largest and smallest figures of merit.

    Whether a figure should be large or small depends on the purpose, which a sweep does not
    know. The largest and the smallest figures are therefore listed.

    Parameters
    ----------
    result
        The results of the sweep.
    frame
        The rows that are ranked, one for each assembly mode of each design.
    """
    import numpy as np

    sweep = result.sweep
    units = sweep.units()
    figures = [
        merit.name
        for merit in sweep.merits
        if frame[merit.name].dtype.kind in NUMERIC_KINDS
    ]
    count = DESIGNS_PER_EXTREME if len(figures) <= MANY_FIGURES else 1
    sizes = [variable.name for variable in sweep.variables]
    # The user knows the varied numbers by their keys in the file, as on the command line.
    headings = {
        variable.name: variation.key
        for variable, variation in zip(sweep.variables, sweep.space.variations, strict=True)
    }
    words = {merit.name: merit.meaning or merit.name for merit in sweep.merits}
    has_partial_modes = bool((frame["closes"] < 1.0).any())
    # Infinite figures would make all others of their column 0.
    largest_by_column = frame[[*sizes, *figures]].abs().replace(np.inf, np.nan).max()

    def cell(name: str, value: float) -> str:
        """Return a number of a column as text."""
        return _value_text(value, units.get(name), largest_by_column[name])

    rows = []
    for figure in figures:
        values = frame[frame[figure].notna()]
        for title, ascending in (("highest", False), ("lowest", True)):
            ordered = values.sort_values(figure, ascending=ascending, kind="stable")
            printed_designs: list[int] = []
            for _, row in ordered.iterrows():
                if row["design"] in printed_designs:
                    continue
                if len(printed_designs) == count:
                    break
                printed_designs.append(row["design"])
                same_design = values[values["design"] == row["design"]]
                # Modes of the design with the same value share a line of the table.
                is_equal = np.isclose(
                    same_design[figure], row[figure], rtol=EQUAL, atol=EQUAL * ROUNDING
                )
                modes = ", ".join(same_design[is_equal]["mode"].astype(str))
                is_first = len(printed_designs) == 1
                existence = [f"{_percentage(row['closes'])} %"]
                rows.append(
                    (
                        _heading(words[figure], units.get(figure))
                        if is_first and not ascending
                        else "",
                        title if is_first else "",
                        cell(figure, row[figure]),
                        str(row["design"]),
                        modes,
                        *(existence if has_partial_modes else []),
                        *(cell(name, row[name]) for name in sizes),
                    )
                )
    if not rows:
        return []
    columns = (
        ScreenColumn("figure of merit"),
        ScreenColumn("rank"),
        ScreenColumn("value", "right"),
        ScreenColumn("design", "right"),
        ScreenColumn("assembly mode (signs)"),
        *([ScreenColumn("exists at", "right")] if has_partial_modes else []),
        *(
            ScreenColumn(_heading(headings[name], units.get(name)), "right")
            for name in sizes
        ),
    )
    table = ScreenTable(columns, tuple(rows))
    # Conditions and files need the names of the columns, which are not in the table if the
    # figures have words.
    if all(words[figure] == figure for figure in figures):
        return [table]
    return [
        table,
        f"{'This figure' if len(figures) == 1 else 'These figures'} of merit "
        f"{'is the column' if len(figures) == 1 else 'are the columns'} "
        f"{', '.join(figures)} in files and in conditions (--where). The column closes is "
        "the share of samples at which a mode exists.",
    ]


def _value_text(value: float, unit: str | None, largest: float) -> str:
    """Return a number of a sweep as text, without its unit.

    `largest` is the largest magnitude of the numbers beside it. A number that is only a
    rounding error of this magnitude is printed as 0.
    """
    if unit == "deg":
        return degrees_text(math.radians(value))
    return number_text(value, error=ROUNDING * largest)


def _heading(text: str, unit: str | None) -> str:
    """Return the text of a column or of a figure of merit with its unit."""
    return f"{text} ({unit})" if unit else text


def _change_point_rows(frame: Any) -> Any:
    """Return the rows of a sweep whose designs are change-point four-bars.

    Such a four-bar has a change point, a configuration in which all four axes are in one
    plane and assembly modes meet. Only sweeps of four-bars have a column ``grashof``.
    """
    if "grashof" not in frame.columns:
        return frame.iloc[:0]
    return frame[frame["grashof"].astype(str) == "change-point"]


def _describe_change_points(result: "SweepResult", rows: Any) -> str:
    """Return which designs are change-point four-bars, and why not to rank them.

    An example is ``design 4 (links.2.arc = 50 deg), a change-point four-bar. It has ...``.

    Parameters
    ----------
    result
        The results of the sweep.
    rows
        The rows of these designs, at least one.
    """
    designs = rows.drop_duplicates("design").sort_values("design")
    names = numbered("design", designs["design"].tolist())
    names += _values_of_designs(result, designs)
    if len(designs) == 1:
        return (
            f"{names}, a change-point four-bar. It has a configuration in which all axes "
            "lie in one plane and the assembly modes meet. Its figures depend on how near "
            "a sample is to this configuration."
        )
    return (
        f"{names}, change-point four-bars. Such a four-bar has a configuration in which "
        "all axes lie in one plane and the assembly modes meet. Its figures depend on how "
        "near a sample is to this configuration."
    )


def _values_of_designs(result: "SweepResult", designs: Any) -> str:
    """Return the varied numbers of some designs, such as `` (links.2.arc = 30, 50 deg)``.

    With several varied numbers the text would be long, so it is empty unless there is one
    design.

    Parameters
    ----------
    result
        The results of the sweep.
    designs
        One row for each of these designs.
    """
    sweep = result.sweep
    if len(sweep.variables) > 1 and len(designs) > 1:
        return ""
    units = sweep.units()
    texts = []
    for variable, variation in zip(sweep.variables, sweep.space.variations, strict=True):
        unit = units.get(variable.name)
        largest = max(abs(variation.low), abs(variation.high))
        values = listing(
            _value_text(value, unit, largest) for value in designs[variable.name]
        )
        texts.append(f"{variation.key} = {values} {unit or ''}".rstrip())
    return f" ({', '.join(texts)})"


def _numbers_of_texts(column: Any) -> str:
    """Return how often each text occurs in a column of a frame, such as ``3 a, 1 b``."""
    texts_of_rows = column.dropna().astype(str)
    counts = texts_of_rows[texts_of_rows != ""].value_counts()
    return ", ".join(f"{count} {text}" for text, count in counts.items())


def _count_texts(result: "SweepResult", frame: Any) -> Lines:
    """Return lines that say how often each text occurs in a column of a sweep.

    An example is the type of a four-bar, such as ``crank-rocker``. A last line says whether
    all assembly modes (ways to assemble a mechanism) were found.

    Parameters
    ----------
    result
        The results of the sweep.
    frame
        The rows that have figures of merit (numbers or texts that rate a design).
    """
    lines = []
    if "grashof" in frame.columns:
        # All assembly modes of a design have the same type of four-bar, so count designs.
        designs = frame.drop_duplicates("design")
        texts = _numbers_of_texts(designs["grashof"])
        if texts:
            lines.append(f"Designs by type of four-bar: {texts}")
    for merit in result.sweep.merits:
        has_texts = frame[merit.name].dtype.kind not in NUMERIC_KINDS
        texts = _numbers_of_texts(frame[merit.name]) if has_texts else ""
        if texts:
            lines.append(f"{merit.name}: {texts}")
    # The claim says whether all assembly modes of a design were found.
    claims = frame["claim"].dropna().astype(str).value_counts()
    if list(claims.index) == ["complete"]:
        lines.append("All assembly modes of all designs were found.")
    elif len(claims):
        # For some rows there is no statement about missing modes.
        texts = ", ".join(
            f"{text or 'not stated'} in {counted(count, 'row')}"
            for text, count in claims.items()
        )
        lines.append(f"Guarantee that no assembly mode is missing: {texts}.")
    return lines


def _describe_reasons(failed: Any) -> Lines:
    """Return lines on why some designs of a sweep have no figures of merit.

    A figure of merit is a number that rates a design. Reasons that differ only in their
    numbers share a line, which shows the first reason.

    Parameters
    ----------
    failed
        A data frame with a row for each of these designs. Columns are the number of the
        design, the status (kind of failure) and the reason in words.
    """
    status = failed["status"].astype(str)
    kind_of_reason = failed["reason"].astype(str).map(without_numbers)
    groups = [rows for _, rows in failed.groupby([status, kind_of_reason], sort=False)]
    groups.sort(key=len, reverse=True)
    lines = []
    for rows in groups[:MAX_PRINTED_REASONS]:
        first = rows.iloc[0]
        designs = numbered("design", rows["design"])
        example = ""
        if rows["reason"].nunique() > 1:
            example = f"for example design {first['design']}: "
        lines.append(f"{first['status']}, {designs}: {example}{first['reason']}")
    if len(groups) > MAX_PRINTED_REASONS:
        unlisted = counted(len(groups) - MAX_PRINTED_REASONS, "more reason")
        lines.append(f"{unlisted}, in the column reason")
    return lines
