"""What a run says to people: how far it is, on stderr, and its summary in lines."""

import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

from spherekit.conventions import Lines, counted, numbered
from spherekit.progress import ProgressReporter

BAR = 30


def report(summary: Any) -> str:
    """Return the summary in a few lines for people."""
    from spherekit.analysis.faults import failed_rows

    groups = ", ".join(summary["groups"]) or "none"
    lines = [f"{summary['mechanism']}: {_asked(summary)}; groups: {groups}"]
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
    lacking = {n: c for n, c in summary["pole_status"].items() if n != "OK"}
    if lacking:
        counts = ", ".join(f"{count} {name}" for name, count in lacking.items())
        lines.append(f"  of {sum(summary['pole_status'].values())} pole axes: {counts}")
    lines += [f"  {sentence}" for sentence in failed_rows(summary)]
    meanings = summary["status_meaning"].items()
    lines += [f"  {name}: {meaning}" for name, meaning in meanings if name != "OK"]
    if "simulation" in summary:
        lines.append(_simulated(summary["simulation"], summary["cost"]["simulate"]))
    lines += _errors(summary["errors_reached"])
    if "verified" in summary:
        from spherekit.analysis.running.summary import told

        lines += told(summary["verified"])
    lines += spent(summary["cost"])
    if "accuracy" in summary:
        lines.append(accuracy_line(summary["accuracy"]))
    return "\n".join(lines)


def _asked(summary: Any) -> str:
    """Return over what a mechanism was gone through, and its mobility."""
    mobility, count = summary["mobility"], len(summary["assembly_modes"])
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
    alike: dict[str, list[Any]] = {}
    for mode in assembly_modes:
        counts = ", ".join(f"{n} {name}" for name, n in mode["status"].items())
        alike.setdefault(counts, []).append(mode)
    return [
        f"  assembly mode{'s' * (len(modes) > 1)} "
        + ", ".join(f"{item['number']} ({_title(item)})" for item in modes)
        + f": {'each ' * (len(modes) > 1)}{counts}"
        for counts, modes in alike.items()
    ]


def _title(mode: Any) -> str:
    """Return what a mode is called beside its number, as in `AssemblyMode.title`."""
    return ", ".join(filter(None, (mode["mode"], mode.get("name"))))


def spent(cost: Any) -> Lines:
    """Return what a run has cost in lines for people."""
    seconds = cost["seconds"]
    whole = sum(seconds.values())
    shown = [(name, took) for name, took in seconds.items() if took > 0.005 * whole]
    stages = ", ".join(f"{name} {duration(took)}" for name, took in shown)
    counts = [
        (cost["configurations"], "configuration"),
        (cost["poles"], "pole"),
        (cost["axis_derivatives"], "derivative"),
        (cost["link_rates"], "link rate"),
    ]
    evaluated = ", ".join(counted(number, noun) for number, noun in counts if number)
    lines = [f"cost: {evaluated}{'; ' * bool(evaluated)}{duration(whole)} s ({stages})"]
    tables = cost["tables"]
    rows = sum(table["rows"] for table in tables.values())
    line = f"  {counted(rows, 'row')} in {counted(len(tables), 'table')}"
    for kind, name in (("csv_bytes", "CSV"), ("parquet_bytes", "Parquet")):
        if all(kind in table for table in tables.values()):
            line += f", {megabytes(sum(table[kind] for table in tables.values()))} {name}"
    if "recording" in cost:
        recording = cost["recording"]
        size = megabytes(recording["bytes"])
        line += f"; recording: {recording['entities']} entities, {size}"
    return [*lines, line]


def duration(seconds: float) -> str:
    """Return a number of seconds with two digits, more only where they are whole."""
    return f"{seconds:.2g}" if seconds < 99.5 else f"{seconds:.0f}"


def megabytes(count: int) -> str:
    """Return a number of bytes as people read it."""
    return f"{count / 1e6:.3g} MB" if count >= 1e5 else f"{count / 1e3:.3g} kB"


def accuracy_line(choice: Any) -> str:
    """Return which setting was taken for a tolerance, and what it reached."""
    error = choice["predicted_error"]
    predicted = "" if error is None else f", predicted error {error:.1e}"
    line = (
        f"tolerance {choice['tolerance']:g}: {choice['setting']} "
        f"({choice['why']}){predicted}"
    )
    unmet = "" if choice["met"] else ": THE TOLERANCE IS NOT MET"
    if choice["achieved_error"] is None and error is not None:
        return f"{line} by that trade{unmet}"
    if choice["achieved_error"] is None:
        return f"{line}; nothing that depends on samples was asked for"
    return (
        f"{line}; {choice['achieved_error']:.1e} reached at {choice['check_rows']} "
        f"check rows ({choice['worst_column']}){unmet}"
    )


def progress(quiet: bool) -> Callable[[int, int], None] | None:
    """Return what is told how many samples are done: a line, or words now and then."""
    if quiet:
        return None
    if sys.stderr.isatty():
        return bar(time.monotonic)
    working = ProgressReporter("computing")

    def tell(done: int, total: int) -> None:
        if done < total:
            working.tell(lambda: f"{done} of {total} samples")

    return tell


def bar(now: Callable[[], float]) -> Callable[[int, int], None]:
    """Return what prints how many samples are done, and how long the others will take.

    That follows from those done since the first call; `now` gives seconds.
    """
    started, width = now(), 0
    first: tuple[float, int] | None = None

    def tell(done: int, total: int) -> None:
        nonlocal first, width
        at = now()
        since, before = first = first or (at, done)
        if at - started < 0.5 and done < total:
            return
        filled = BAR * done // total
        text = f"[{'#' * filled + '.' * (BAR - filled)}] {done}/{counted(total, 'sample')}"
        if before < done < total:
            rest = (at - since) * (total - done) / (done - before)
            text += f", {duration(rest)} s left"
        shown, width = text.ljust(width), len(text)
        print(f"\r{shown}", end="\n" * (done == total), file=sys.stderr, flush=True)

    return tell
