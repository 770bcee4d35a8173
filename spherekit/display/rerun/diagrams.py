"""Points and straight lines that move in a plane with one scale on both axes."""

from collections.abc import Iterator

import numpy as np

from spherekit.arrays import Floats
from spherekit.display.rerun import charts
from spherekit.display.rerun.destination import Columns, Stills
from spherekit.display.rerun.rerun_sdk import rr
from spherekit.geometry.vectors import all_finite
from spherekit.scenes import colours
from spherekit.scenes.plot_layout import placed_labels
from spherekit.scenes.scene import Diagram

MOST_LISTED = 14
LETTER = 20.0
BELOW = 46.0
"""From the frame to the words of a step."""

Moving = tuple[str, Columns]


def still(item: Diagram) -> Stills:
    """Yield the frame with its ticks, and the looks of points and lines."""
    width = _width(item)
    x, y = charts.side(item.x_label, item.x_range), charts.side(item.y_label, item.y_range)
    yield from charts.frame(width, x, y)
    yield "points", rr.Points2D.from_fields(radii=rr.Radius.ui_points(4.0))
    yield "names", rr.Points2D.from_fields(radii=0.0, show_labels=True)
    for name, colour, size in (
        ("leaders", colours.GRATICULE, 0.7),
        ("lines", colours.VIOLET, 1.0),
    ):
        yield (
            name,
            rr.LineStrips2D.from_fields(colors=colour, radii=rr.Radius.ui_points(size)),
        )
    if item.readings is not None:
        tints = [colours.tone(tone) for tone in item.tones[:MOST_LISTED]]
        yield "legend", charts.legend_style(charts.listed(width, len(tints)), tints)
    yield "step", rr.Points2D.from_fields(radii=0.0, show_labels=True, colors=colours.PALE)


def moving(item: Diagram) -> Iterator[Moving]:
    """Yield points within the frame with their names, and the visible part of lines."""
    n, k = item.places.shape[:2]
    low, high = np.transpose([item.x_range, item.y_range])
    seen = np.all((item.places >= low) & (item.places <= high), axis=2)
    count = seen.sum(axis=1)
    tints = np.array([colours.tone(tone) for tone in item.tones], np.uint8)
    places = _placed(item, item.places)
    shades = np.broadcast_to(tints, (n, k, 3))[seen]
    middles = placed_labels(item.names, np.where(seen[..., None], places, np.nan), LETTER)
    points = rr.Points2D.columns(positions=places[seen], colors=shades)
    yield "points", points.partition(count)
    labels = rr.Points2D.columns(
        positions=middles[seen] - [0.0, charts.LABEL],
        labels=np.tile(item.names, (n, 1))[seen].tolist(),
        colors=shades,
    )
    yield "names", labels.partition(count)
    leaders = np.stack([places[seen], middles[seen]], axis=1)
    yield "leaders", rr.LineStrips2D.columns(strips=list(leaders)).partition(count)
    ends, visible = clipped(item)
    lines = rr.LineStrips2D.columns(strips=_placed(item, ends)[visible])
    yield "lines", lines.partition(visible.sum(axis=1))
    if item.readings is not None:
        yield "legend", _read(item, np.degrees(item.readings[:, :MOST_LISTED]))
    if item.words:
        below = np.tile([0.5 * _width(item), charts.FRAME_HEIGHT + BELOW], (n, 1))
        yield "step", rr.Points2D.columns(positions=below, labels=item.words)


def _read(item: Diagram, angles: Floats) -> Columns:
    one, other = item.reading_names
    words = [
        f"{name}  {one} {_angle(a)}  {other} {_angle(b)}"
        for row in angles.tolist()
        for name, (a, b) in zip(item.names, row, strict=False)
    ]
    return rr.Points2D.columns(labels=words).partition([angles.shape[1]] * len(angles))


def _angle(value: float) -> str:
    return "\u2013" if value != value else f"{value:.1f}\u00b0".replace("-", "\u2212")


def clipped(item: Diagram) -> tuple[Floats, np.ndarray]:
    """Return where lines enter and leave the frame (n, m, 2, 2), and which do (n, m)."""
    normal, c = item.lines[..., :2], item.lines[..., 2:]
    frame = np.array([item.x_range, item.y_range])
    with np.errstate(divide="ignore", invalid="ignore"):
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        foot = -normal * (c / length**2)
        along = normal[..., ::-1] * [-1.0, 1.0] / length
        t = np.sort((frame - foot[..., None]) / along[..., None], axis=-1)
        first, last = np.max(t[..., 0], axis=-1), np.min(t[..., 1], axis=-1)
        ends = np.stack([foot + t[..., None] * along for t in (first, last)], axis=-2)
    return ends, (first < last) & all_finite(ends, (-1, -2))


def bounds(item: Diagram) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return what of the plane a view of a diagram shows."""
    beside = charts.LEFT if item.readings is None else charts.LEGEND
    _, (top, bottom) = charts.BOUNDS
    return (-charts.LEFT, _width(item) + beside), (top, bottom + charts.LABEL)


def _width(item: Diagram) -> float:
    """Return the width of the frame, with one scale on both axes."""
    (left, right), (low, high) = item.x_range, item.y_range
    return charts.FRAME_HEIGHT * (right - left) / (high - low)


def _placed(item: Diagram, points: Floats) -> Floats:
    """Return points (..., 2) where the viewer draws them: its y points down."""
    (left, _), (low, high) = item.x_range, item.y_range
    scale = charts.FRAME_HEIGHT / (high - low)
    return (points - [left, high]) * [scale, -scale]
