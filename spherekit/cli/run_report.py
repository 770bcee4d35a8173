"""The summary of a run as text, and the progress that is printed during a run."""

from collections.abc import Callable, Sequence
from typing import Any

from spherekit.conventions import Lines
from spherekit.progress import ProgressReporter
from spherekit.wording import counted, numbered, size_text

MAX_LISTED_MEETINGS = 6
"""Number of inputs at which modes meet that are printed; summary.json has all of them."""

MIN_STAGE_SHARE = 0.005
"""Share of the time of a run below which a stage is not printed."""


def report(summary: Any) -> str:
    """Return the text that is printed for the summary of a run.

    It begins with the samples and assembly modes, then says what failed, and ends with the
    errors that were reached and the cost.

    Parameters
    ----------
    summary
        The content of ``summary.json``.
    """
    from spherekit.runs.analysis_faults import describe_failed_rows

    lines = [
        f"{summary['mechanism']}: {_describe_samples(summary)}; groups: "
        f"{', '.join(summary['groups']) or 'none'}"
    ]
    lines += summary["remarks"]
    lines += [f"warning: {text}" for text in summary["warnings"]]
    redundant = summary["redundant_constraints"]
    if redundant and redundant["count"]:
        lines.append(
            f"  {counted(redundant['count'], 'redundant constraint')} among pairs "
            f"{', '.join(redundant['pairs'])}"
        )
    # Assembly modes: the ways to close the loops at the same inputs.
    lines += by_equal_counts(summary["assembly_modes"])
    if summary["assembly_modes"]:
        lines.append(f"assembly modes: {summary['search']}")
        lines += _describe_mode_meetings(summary)
    # Failures: the number of poles with each status except OK, and rows of tables.
    pole_counts = summary["pole_status"]
    not_ok = [
        f"{count} {status}" for status, count in pole_counts.items() if status != "OK"
    ]
    if not_ok:
        lines.append(f"  of {sum(pole_counts.values())} pole axes: {', '.join(not_ok)}")
    lines += [f"  {sentence}" for sentence in describe_failed_rows(summary)]
    lines += [
        f"  {name}: {meaning}"
        for name, meaning in summary["status_meaning"].items()
        if name != "OK"
    ]
    if "simulation" in summary:
        simulation = summary["simulation"]
        lines.append(_describe_simulation(simulation, summary["cost"]["simulate"]))
    lines += _describe_errors(summary["errors_reached"])
    if "verified" in summary:
        from spherekit.runs.verification_text import format_verification

        lines += format_verification(summary["verified"])
    lines += spent(summary["cost"])
    if "accuracy" in summary:
        lines.append(accuracy_line(summary["accuracy"]))
    return "\n".join(lines)


def _describe_mode_meetings(summary: Any) -> Lines:
    """Return lines for the inputs at which assembly modes meet, each with its sentence.

    These inputs are computed from the equations, so they lie between the samples.
    """
    sentences = [meeting["sentence"] for meeting in summary["mode_meetings"]]
    lines = [f"  {sentence}" for sentence in sentences[:MAX_LISTED_MEETINGS]]
    unlisted = len(sentences) - MAX_LISTED_MEETINGS
    if unlisted > 0:
        lines.append(f"  and at {counted(unlisted, 'other input')}: summary.json has all")
    return lines


def _describe_samples(summary: Any) -> str:
    """Return the samples, inputs and modes of a run, and the mobility of the mechanism.

    The mobility by the graph follows from the numbers of links and pairs; the mobility by
    rank follows from the rank of the velocity equations.

    Parameters
    ----------
    summary
        The content of ``summary.json``.
    """
    mobility = summary["mobility"]
    mode_count = len(summary["assembly_modes"])
    inputs = numbered("input", summary["inputs"])
    if not mode_count:
        return (
            f"{inputs}; no motion was traced, as no analysis reads samples; mobility "
            f"{mobility['graph']} by the graph"
        )
    return (
        f"{counted(summary['sampling'], 'sample')} of {inputs}, "
        f"{counted(mode_count, 'assembly mode')}; mobility {mobility['graph']} by the "
        f"graph, {mobility['rank']} by rank"
    )


def _describe_simulation(simulation: Any, cost: Any) -> str:
    """Return one line about a simulation: its end, engine, errors and energy balance."""
    end = simulation["end"]
    return (
        f"simulated {end['t']:.6g} of {simulation['duration_s']:.6g} s "
        f"({end['reason']}), {counted(simulation['events'], 'event')}, "
        f"engine {simulation['engine']['name']} ({cost['reason']}); "
        f"error {simulation['achieved_error_rad']:.1e} rad at tolerance "
        f"{simulation['tolerance']:.1e}{' (MISSED)' if simulation['missed'] else ''}, "
        f"energy balanced to {simulation['energy_imbalance_J']:.1e} of "
        f"{simulation['energy_scale_J']:.1e} J"
    )


_ERROR_LINES = (
    (
        ("largest_closure_residual_rad", "largest closure residual {:.1e} rad"),
        ("largest_configuration_error_rad", "; configurations known to {:.1e} rad"),
    ),
    (
        (
            "largest_direction_error_bound_rad",
            "largest error bound of a pole direction {:.1e} rad",
        ),
        ("largest_velocity_coefficient_error_bound", ", of a velocity coefficient {:.1e}"),
        (
            "largest_acceleration_coefficient_error_bound",
            ", of an acceleration coefficient {:.1e} 1/rad",
        ),
    ),
)
"""For each line: keys of ``errors_reached``, and the format of the text for each key.

The text of the first key begins the line, and the other texts continue its sentence. The
line is therefore left out if the first error is None.
"""


def _describe_errors(errors: Any) -> Lines:
    """Return lines for the largest errors of a run; errors that are None are left out.

    Parameters
    ----------
    errors
        The entry ``errors_reached`` of the summary.
    """
    lines = []
    for line_parts in _ERROR_LINES:  # pairs of a key and a format such as "{:.1e} rad"
        # The text of the first error begins the sentence that the other texts continue.
        first_key, _ = line_parts[0]
        if errors[first_key] is not None:
            texts = [
                text.format(errors[key])
                for key, text in line_parts
                if errors[key] is not None
            ]
            lines.append("".join(texts))
    return lines


def by_equal_counts(assembly_modes: Sequence[Any]) -> Lines:
    """Return lines for assembly modes.

    Modes with equally many samples of each status (such as OK) share a line.

    Parameters
    ----------
    assembly_modes
        The entry ``assembly_modes`` of the summary, with four keys for each mode:
        ``number``, ``mode`` (its signs, such as ``+-``), ``name`` (if it has one) and
        ``status`` (the number of samples of each status).
    """
    modes_of_counts: dict[str, Lines] = {}
    for mode in assembly_modes:
        counts = ", ".join(f"{count} {status}" for status, count in mode["status"].items())
        title = ", ".join(filter(None, (mode["mode"], mode.get("name"))))
        modes_of_counts.setdefault(counts, []).append(f"{mode['number']} ({title})")
    return [
        f"  {numbered('assembly mode', modes)}: {'each ' if len(modes) > 1 else ''}{counts}"
        for counts, modes in modes_of_counts.items()
    ]


def spent(cost: Any) -> Lines:
    """Return lines for the cost of a run: evaluations, time, and sizes of files.

    Parameters
    ----------
    cost
        The entry ``cost`` of the summary.
    """
    seconds = cost["seconds"]  # by stage of the run
    total = sum(seconds.values())
    # Stages that took less than a small share of the time are not listed.
    stages = ", ".join(
        f"{stage} {duration(time_s)}"
        for stage, time_s in seconds.items()
        if time_s > MIN_STAGE_SHARE * total
    )
    evaluations = ", ".join(
        counted(cost[key], noun)
        for key, noun in (
            ("configurations", "configuration"),
            ("poles", "pole"),
            ("axis_derivatives", "derivative"),
            ("link_rates", "link rate"),
        )
        if cost[key]
    )
    separator = "; " if evaluations else ""
    # Sizes of the files, for each format in which all tables were written.
    tables = cost["tables"].values()
    rows = counted(sum(table["rows"] for table in tables), "row")
    sizes = f"  {rows} in {counted(len(tables), 'table')}"
    for key, name in (("csv_bytes", "CSV"), ("parquet_bytes", "Parquet")):
        if all(key in table for table in tables):
            sizes += f", {size_text(sum(table[key] for table in tables))} {name}"
    if recording := cost.get("recording"):
        sizes += f"; recording: {recording['entities']} entities, "
        sizes += size_text(recording["bytes"])
    return [f"cost: {evaluations}{separator}{duration(total)} s ({stages})", sizes]


def duration(seconds: float) -> str:
    """Return seconds with two digits, or as a whole number from 100 on."""
    return f"{seconds:.2g}" if seconds < 99.5 else f"{seconds:.0f}"


def accuracy_line(choice: Any) -> str:
    """Return the line about the setting that was chosen for a tolerance.

    A setting is a way to compute the tables. A trade measures the time and the error of
    each setting. The run is predicted to have the error that a trade measured for the
    chosen setting. If the run computes poles at samples, some of its rows (check rows) are
    also compared with accurate values.

    Parameters
    ----------
    choice
        The entry ``accuracy`` of the summary. Its key ``why`` has the reason of the choice
        as a phrase, which names the trade. The predicted error is None without a trade, and
        the achieved error is None without check rows.
    """
    predicted_error = choice["predicted_error"]
    achieved_error = choice["achieved_error"]
    predicted = ""
    if predicted_error is not None:
        predicted = f", predicted error {predicted_error:.1e}"
    line = (
        f"tolerance {choice['tolerance']:g}: {choice['setting']} "
        f"({choice['why']}){predicted}"
    )
    unmet = "" if choice["met"] else ": THE TOLERANCE IS NOT MET"
    if achieved_error is not None:
        return (
            f"{line}; {achieved_error:.1e} reached at {choice['check_rows']} check rows "
            f"({choice['worst_column']}){unmet}"
        )
    if predicted_error is not None:
        return f"{line} by that trade{unmet}"
    # Neither a trade nor check rows: no analysis computes anything whose error depends on
    # the setting.
    return f"{line}; nothing that depends on samples was asked for"


def progress() -> Callable[[int, int], None]:
    """Return a function that prints progress from time to time.

    The returned function is called with the number of samples done and the number of all
    samples.
    """
    reporter = ProgressReporter("computing")

    def print_progress(done: int, total: int) -> None:
        """Print how many samples of the total are done, and how long the rest takes."""
        reporter.report_if_due(lambda: f"{done} of {total} samples", done, total)

    return print_progress
