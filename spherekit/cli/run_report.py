"""What a run says to people: how far it is, on stderr, and its summary in lines."""

import time
from collections.abc import Callable, Sequence
from typing import Any

from spherekit.conventions import Lines
from spherekit.progress import ProgressReporter
from spherekit.wording import counted, numbered, size_text


def report(summary: Any) -> str:
    """Return the summary in a few lines for people."""
    from spherekit.runs.analysis_faults import failed_rows

    lines = [
        f"{summary['mechanism']}: {_asked(summary)}; groups: "
        f"{', '.join(summary['groups']) or 'none'}"
    ]
    lines += summary["remarks"]
    lines += [f"warning: {text}" for text in summary["warnings"]]
    repeated = summary["redundant_constraints"]
    if repeated and repeated["count"]:
        lines.append(
            f"  {counted(repeated['count'], 'redundant constraint')} among pairs "
            f"{', '.join(repeated['pairs'])}"
        )
    lines += by_equal_counts(summary["assembly_modes"])
    if summary["assembly_modes"]:
        lines.append(f"assembly modes: {summary['search']}")
        lines += _meetings(summary)
    poles = summary["pole_status"]
    lacking = [f"{count} {name}" for name, count in poles.items() if name != "OK"]
    if lacking:
        lines.append(f"  of {sum(poles.values())} pole axes: {', '.join(lacking)}")
    lines += [f"  {sentence}" for sentence in failed_rows(summary)]
    lines += [
        f"  {name}: {meaning}"
        for name, meaning in summary["status_meaning"].items()
        if name != "OK"
    ]
    if "simulation" in summary:
        lines.append(_simulated(summary["simulation"], summary["cost"]["simulate"]))
    lines += _errors(summary["errors_reached"])
    if "verified" in summary:
        from spherekit.runs.verification_text import format_verification

        lines += format_verification(summary["verified"])
    lines += spent(summary["cost"])
    if "accuracy" in summary:
        lines.append(accuracy_line(summary["accuracy"]))
    return "\n".join(lines)


MOST_MEETINGS = 6
"""Inputs at which modes meet that are printed one by one."""


def _meetings(summary: Any) -> Lines:
    """Return where modes meet; samples need not be there."""
    sentences = [meeting["sentence"] for meeting in summary["mode_meetings"]]
    lines = [f"  {sentence}" for sentence in sentences[:MOST_MEETINGS]]
    if len(sentences) > MOST_MEETINGS:
        left = len(sentences) - MOST_MEETINGS
        lines.append(f"  and at {counted(left, 'other input')}: summary.json has all")
    return lines


def _asked(summary: Any) -> str:
    """Return over what a mechanism was gone through, and its mobility."""
    mobility = summary["mobility"]
    count = len(summary["assembly_modes"])
    names = numbered("input", summary["inputs"])
    if not count:
        return (
            f"{names}; no motion was traced, as no analysis reads samples; mobility "
            f"{mobility['graph']} by the graph"
        )
    return (
        f"{counted(summary['sampling'], 'sample')} of {names}, "
        f"{counted(count, 'assembly mode')}; mobility {mobility['graph']} by the graph, "
        f"{mobility['rank']} by rank"
    )


def _simulated(done: Any, took: Any) -> str:
    return (
        f"simulated {done['end']['t']:.6g} of {done['duration_s']:.6g} s "
        f"({done['end']['reason']}), {counted(done['events'], 'event')}, "
        f"engine {done['engine']['name']} ({took['reason']}); "
        f"error {done['achieved_error_rad']:.1e} rad at tolerance "
        f"{done['tolerance']:.1e}{' (MISSED)' if done['missed'] else ''}, "
        f"energy balanced to {done['energy_imbalance_J']:.1e} of "
        f"{done['energy_scale_J']:.1e} J"
    )


_ERRORS = (
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
"""Errors that share a line, said where the first of them is known."""


def _errors(reached: Any) -> Lines:
    return [
        "".join(
            words.format(reached[key]) for key, words in parts if reached[key] is not None
        )
        for parts in _ERRORS
        if reached[parts[0][0]] is not None
    ]


def by_equal_counts(assembly_modes: Sequence[Any]) -> Lines:
    """Return a line for all assembly modes whose samples have the same statuses."""
    alike: dict[str, Lines] = {}
    for mode in assembly_modes:
        counts = ", ".join(f"{n} {name}" for name, n in mode["status"].items())
        title = ", ".join(filter(None, (mode["mode"], mode.get("name"))))
        alike.setdefault(counts, []).append(f"{mode['number']} ({title})")
    return [
        f"  {numbered('assembly mode', modes)}: {'each ' * (len(modes) > 1)}{counts}"
        for counts, modes in alike.items()
    ]


def spent(cost: Any) -> Lines:
    """Return what a run has cost in lines for people."""
    seconds = cost["seconds"]
    whole = sum(cost["seconds"].values())
    stages = ", ".join(
        f"{name} {duration(took)}" for name, took in seconds.items() if took > 0.005 * whole
    )
    evaluated = ", ".join(
        counted(cost[key], noun)
        for key, noun in (
            ("configurations", "configuration"),
            ("poles", "pole"),
            ("axis_derivatives", "derivative"),
            ("link_rates", "link rate"),
        )
        if cost[key]
    )
    lines = [f"cost: {evaluated}{'; ' * bool(evaluated)}{duration(whole)} s ({stages})"]
    tables = cost["tables"].values()
    rows = counted(sum(table["rows"] for table in tables), "row")
    line = f"  {rows} in {counted(len(tables), 'table')}"
    for kind, name in (("csv_bytes", "CSV"), ("parquet_bytes", "Parquet")):
        if all(kind in table for table in tables):
            line += f", {size_text(sum(table[kind] for table in tables))} {name}"
    if recording := cost.get("recording"):
        line += f"; recording: {recording['entities']} entities, "
        line += size_text(recording["bytes"])
    return [*lines, line]


def duration(seconds: float) -> str:
    """Return a number of seconds with two digits, more only where they are whole."""
    return f"{seconds:.2g}" if seconds < 99.5 else f"{seconds:.0f}"


def accuracy_line(choice: Any) -> str:
    """Return which setting was taken for a tolerance, and what it reached."""
    error = choice["predicted_error"]
    reached = choice["achieved_error"]
    predicted = "" if error is None else f", predicted error {error:.1e}"
    line = (
        f"tolerance {choice['tolerance']:g}: {choice['setting']} "
        f"({choice['why']}){predicted}"
    )
    unmet = "" if choice["met"] else ": THE TOLERANCE IS NOT MET"
    if reached is not None:
        return (
            f"{line}; {reached:.1e} reached at {choice['check_rows']} check rows "
            f"({choice['worst_column']}){unmet}"
        )
    if error is not None:
        return f"{line} by that trade{unmet}"
    return f"{line}; nothing that depends on samples was asked for"


def progress() -> Callable[[int, int], None]:
    """Return what is told how many samples are done, and says so now and then.

    And how long the others will take, by those done since it was told first.
    """
    working = ProgressReporter("computing")
    first = list[tuple[float, int]]()

    def tell(done: int, total: int) -> None:
        now = time.monotonic()
        since, before = (first or [(now, done)])[0]
        first[:] = [(since, before)]
        if before < done < total:
            left = duration((now - since) * (total - done) / (done - before))
            working.tell(f"{done} of {total} samples, {left} s left".__str__)

    return tell
