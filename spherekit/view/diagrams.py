"""Points and straight lines that move in a plane with one scale on both axes."""

from collections.abc import Iterable, Iterator

import numpy as np

from spherekit.analysis.plotted import placed_labels
from spherekit.analysis.scene import Diagram, Floats
from spherekit.view import charts, colours
from spherekit.view.sdk import rr

UNIT = 100.0
"""Pixels of a diagram along its longer range, per hundredth of it."""
LEGEND = 62.0
"""Width of the list of points with their readings."""
LINE = 7.2
LABEL = 5.0
"""The viewer writes a label so far below its point."""
MOST_LISTED = 14

Still = tuple[str, rr.AsComponents]
Moving = tuple[str, Iterable[rr.ComponentColumn]]


def still(item: Diagram) -> Iterator[Still]:
    """Yield the frame with its ticks, and the looks of points and lines."""
    (left, right), (low, high) = item.x_range, item.y_range
    corners = np.array(
        [[left, low], [right, low], [right, high], [left, high], [left, low]]
    )
    lines = [corners]
    words: list[tuple[float, float, str]] = []
    step, values = charts.ticks(left, right, False)
    for value in values:
        lines.append(np.array([[value, low], [value, high]]))
        words.append((value, low, charts.written(value, step)))
    step, values = charts.ticks(low, high, False)
    for value in values:
        lines.append(np.array([[left, value], [right, value]]))
        words.append((left - 0.03 * (right - left), value, charts.written(value, step)))
    words.append((0.5 * (left + right), low - 0.07 * (high - low), item.x_label))
    words.append((left, high + 0.09 * (high - low), item.y_label))
    yield (
        "frame",
        rr.LineStrips2D(
            [_placed(item, line) for line in lines],
            colors=colours.GRATICULE,
            radii=rr.Radius.ui_points(0.5),
        ),
    )
    yield (
        "words",
        rr.Points2D(
            _placed(item, np.array([word[:2] for word in words])),
            labels=[word[2] for word in words],
            colors=colours.PALE,
            radii=0.0,
            show_labels=True,
        ),
    )
    yield "points", rr.Points2D.from_fields(radii=rr.Radius.ui_points(4.0))
    yield "names", rr.Points2D.from_fields(radii=0.0, show_labels=True)
    yield (
        "leaders",
        rr.LineStrips2D.from_fields(
            colors=colours.GRATICULE, radii=rr.Radius.ui_points(0.7)
        ),
    )
    yield (
        "lines",
        rr.LineStrips2D.from_fields(colors=colours.VIOLET, radii=rr.Radius.ui_points(1.0)),
    )
    if item.readings is not None:
        shown = len(item.names[:MOST_LISTED])
        edge, top = _placed(item, np.array([[right, high]]))[0]
        places = [(edge + 0.5 * LEGEND, top + LINE * k) for k in range(shown)]
        tints = [colours.tone(tone) for tone in item.tones[:MOST_LISTED]]
        yield "legend", charts.legend_style(np.array(places), tints)
    yield "step", rr.Points2D.from_fields(radii=0.0, show_labels=True, colors=colours.PALE)


def moving(item: Diagram) -> Iterator[Moving]:
    """Yield points within the frame with their names, and the visible part of lines."""
    (left, right), (low, high) = item.x_range, item.y_range
    n, k = item.places.shape[:2]
    x, y = item.places[:, :, 0], item.places[:, :, 1]
    seen = (x >= left) & (x <= right) & (y >= low) & (y <= high)
    count = seen.sum(axis=1)
    tints = np.array([colours.tone(tone) for tone in item.tones], dtype=np.uint8)
    places = _placed(item, item.places.reshape(-1, 2)).reshape(n, k, 2)
    names = np.broadcast_to(np.array(item.names, dtype=object), (n, k))
    shades = np.broadcast_to(tints, (n, k, 3))[seen]
    middles = placed_labels(item.names, np.where(seen[..., None], places, np.nan), LINE)
    yield (
        "points",
        rr.Points2D.columns(positions=places[seen], colors=shades).partition(count),
    )
    yield (
        "names",
        rr.Points2D.columns(
            positions=middles[seen] - [0.0, LABEL],
            labels=names[seen].tolist(),
            colors=shades,
        ).partition(count),
    )
    leaders = np.stack([places[seen], middles[seen]], axis=1)
    yield "leaders", rr.LineStrips2D.columns(strips=list(leaders)).partition(count)
    ends, visible = clipped(item)
    strips = _placed(item, ends.reshape(-1, 2)).reshape(*ends.shape)[visible]
    yield "lines", rr.LineStrips2D.columns(strips=strips).partition(visible.sum(axis=1))
    if item.readings is not None:
        shown = item.readings[:, :MOST_LISTED]
        yield "legend", _read(item, np.degrees(shown))
    if item.words:
        top = _placed(item, np.array([[0.5 * (left + right), high]]))
        above = np.repeat(top - [0.0, 0.17 * UNIT], n, axis=0)
        yield "step", rr.Points2D.columns(positions=above, labels=list(item.words))


def _read(item: Diagram, angles: Floats) -> Iterable[rr.ComponentColumn]:
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
    a, b, c = np.moveaxis(item.lines, -1, 0)
    (left, right), (low, high) = item.x_range, item.y_range
    with np.errstate(divide="ignore", invalid="ignore"):
        length = np.hypot(a, b)
        foot = -np.stack([a, b], axis=-1) * (c / length**2)[..., None]
        along = np.stack([-b, a], axis=-1) / length[..., None]
        bounds = np.array([[left, right], [low, high]])
        t = (bounds - foot[..., None]) / along[..., None]
        t = np.where(along[..., None] == 0.0, [-np.inf, np.inf], t)
        first = np.max(np.min(t, axis=-1), axis=-1)
        last = np.min(np.max(t, axis=-1), axis=-1)
        ends = (
            foot[..., None, :]
            + np.stack([first, last], -1)[..., None] * along[..., None, :]
        )
    visible = (first < last) & np.isfinite(ends).all(axis=(-1, -2))
    return ends, visible


def bounds(item: Diagram) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return what of the plane a view of a diagram shows."""
    corners = _placed(
        item,
        np.array([[item.x_range[0], item.y_range[0]], [item.x_range[1], item.y_range[1]]]),
    )
    (left, bottom), (right, top) = corners
    margin = 0.16 * UNIT
    beside = LEGEND if item.readings is not None else margin
    return (left - margin, right + beside), (top - 1.3 * margin, bottom + margin)


def _placed(item: Diagram, points: Floats) -> Floats:
    """Return points (n, 2) where the viewer draws them: its y points down."""
    size = max(item.x_range[1] - item.x_range[0], item.y_range[1] - item.y_range[0])
    return np.asarray(points * np.array([UNIT / size, -UNIT / size]))
