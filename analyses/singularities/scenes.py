"""Scenes of the analysis `singularities`, with one input and with several."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from spherekit.plugin import (
    Floats,
    Mark,
    PlaneCurve,
    Portrait,
    Primitive,
    Series,
)

SELF_MOTION: Final = "self-motion"


Row = Mapping[str, Any]


TONES = {"I": 1, "II": 2, "III": 3, "self-motion": 4}


_PLOTTED = {
    "c": ("c", "input-output relation", ""),
    "d": ("d", "input-output relation", ""),
    "distance_I": ("to type I", "angles", "rad"),
    "distance_II": ("to type II", "angles", "rad"),
    "transmission": ("transmission angle", "angles", "rad"),
}
"""Columns of relations that are drawn: what of, group, and unit."""


def without_jumps(line: Floats) -> Floats:
    """Return points (n, 2) rad with NaN between two where an angle jumps by a turn."""
    jumps = np.max(np.abs(np.diff(line, axis=0)), axis=1) > np.pi
    return np.insert(line, np.flatnonzero(jumps) + 1, np.nan, axis=0)


def plane(
    path: str,
    label: str,
    rows: Floats,
    axes: tuple[str, str],
    curves: Sequence[PlaneCurve],
    marks: Sequence[Mark],
    spanned: Iterable[Floats] = (),
) -> Portrait:
    """Return curves in a plane of angles (rad), with a mark at each of the rows (n, 2).

    The frame spans the curves, and the points (k, 2) to be `spanned`.
    """
    every = [*(curve.points for curve in curves), *spanned] or [np.zeros((1, 2))]
    points = np.concatenate(every)
    x, y = zip(np.nanmin(points, axis=0), np.nanmax(points, axis=0), strict=True)
    return Portrait(
        path, label, rows[:, 0], rows[:, 1], *axes, x, y, "rad", "rad", curves, marks
    )


def relation_plots(relation: Row, count: int, rows: slice) -> list[Primitive]:
    """Return c, d and angles of each output in some of so many rows of a batch."""
    parts: dict[str, Primitive] = {}
    several = len(set(relation["moving"])) > 1
    for start in range(0, len(relation["c"]), count):
        output, form, moving = (relation[k][start] for k in ("output", "form", "moving"))
        at = slice(start + rows.start, start + rows.stop)
        for name, (words, group, unit) in _PLOTTED.items():
            by = f" by {moving}" * (several and not unit)
            end = (name + by).replace(" ", "_")
            values = relation[name][at]
            path = f"plots/{form}/{output.replace('/', '_')}/{end}"
            if np.any(np.isfinite(values)):
                label = f"{words}{by}, output {output}"
                parts[path] = Series(path, label, f"{group}, form {form}", values, unit)
    return [*parts.values()]


def words_of(kind: str) -> str:
    """Return the words for a kind: type II, self-motion."""
    return kind if kind == SELF_MOTION else f"type {kind}"
