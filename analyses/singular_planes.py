"""Singularities in a plane of two angles: lines, marks, and the frame around all."""

from collections.abc import Sequence

import numpy as np

from spherekit.plugin import Floats, Mark, PlaneCurve, Portrait

TONES = {"I": 1, "II": 2, "III": 3, "self-motion": 4}


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
    spanned: Floats | None = None,
) -> Portrait:
    """Return curves in a plane of angles (rad), with a mark at each of the rows (n, 2).

    The frame spans the curves, and the points (k, 2) to be `spanned`.
    """
    lines = [curve.points for curve in curves]
    if spanned is not None:
        lines.append(spanned)
    every = np.concatenate(lines or [np.zeros((1, 2))])
    (left, low), (right, high) = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    return Portrait(
        path,
        label,
        rows[:, 0],
        rows[:, 1],
        *axes,
        (float(left), float(right)),
        (float(low), float(high)),
        "rad",
        "rad",
        curves,
        marks,
    )
