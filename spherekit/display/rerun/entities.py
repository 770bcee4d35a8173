"""Every primitive of a scene as entities: what stays, sent once, and what moves.

A sample that failed (a NaN row) must leave nothing on the screen. Arrows, points and
labels get an empty row there. The curves of a link stay in the recording for good, so
its transform shrinks them to a point instead; the viewer ignores a scale of zero.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Bools, Floats
from spherekit.display.rerun import charts, diagrams, shapes
from spherekit.display.rerun.destination import Columns, Stills
from spherekit.display.rerun.labels import Name
from spherekit.display.rerun.rerun_sdk import rr
from spherekit.geometry.rotation import quaternion
from spherekit.geometry.sphere_mesh import sphere_mesh
from spherekit.geometry.triangle import frame_from, perpendicular
from spherekit.geometry.vectors import all_finite
from spherekit.scenes import colours
from spherekit.scenes.plot_layout import map_range
from spherekit.scenes.scene import (
    Arrow,
    Body,
    Diagram,
    Graph,
    GreatCircle,
    InputMarks,
    Portrait,
    Primitive,
    Series,
    SphereCurves,
    SphereMap,
    Surface,
    Text,
    Trace,
    rows_of,
    titled,
)

Moving = tuple[str, Columns]
"""Path below the primitive, and its columns for one block of samples."""

LINK_RADIUS = 0.016
LIFT = 0.012
LEVELS = 6
"""Links lie on shells `LIFT` apart, so that arcs that coincide do not flicker."""

JOINT_RADIUS = 0.03
POINT = 0.001
GRAPH_SIZE = (420.0, 220.0)
GRATICULE_LIFT = 1.006
MAP_LIFT = 1.002
"""Maps lie just outside of the sphere, and inside of curves."""
HIDDEN = 1e-6
CUBE = 1.6
"""Side of the space that a surface fills if its axes differ."""


def world() -> Stills:
    """Yield the sphere with its graticule."""
    vertices, triangles = sphere_mesh()
    yield (
        "sphere/body",
        rr.Mesh3D(
            vertex_positions=0.985 * vertices,
            triangle_indices=triangles,
            vertex_normals=vertices,
            albedo_factor=colours.SPHERE,
        ),
    )
    lines = shapes.graticule()
    yield "sphere/graticule", _curves(lines, GRATICULE_LIFT, colours.GRATICULE, 0.6)


def still(primitive: Primitive, names: Sequence[Name] = ()) -> Stills:
    """Yield what is logged once for a primitive; `names` are those that a link shows."""
    match primitive:
        case Body():
            yield from _still_body(primitive, names)
        case Arrow():
            if primitive.primary:
                yield "", rr.Arrows3D.from_fields(colors=colours.SILVER, radii=0.006)
            else:
                colour = colours.GOLD
                yield "", rr.Arrows3D.from_fields(colors=colour, radii=0.014)
                yield (
                    "label",
                    rr.Points3D.from_fields(show_labels=True, colors=colour, radii=POINT),
                )
                if primitive.shown and primitive.path_shown:
                    yield (
                        "trail",
                        rr.Points3D.from_fields(colors=colours.PALE, radii=0.008),
                    )
        case GreatCircle():
            yield (
                "",
                rr.LineStrips3D(
                    [shapes.unit_circle()],
                    colors=colours.VIOLET,
                    radii=0.0035,
                    labels=primitive.label,
                    show_labels=False,
                ),
            )
        case Series() | Trace() | InputMarks():
            return
        case Portrait():
            yield from charts.portrait(primitive)
            yield "mark", charts.dot()
        case Diagram():
            yield from diagrams.still(primitive)
        case SphereCurves():
            yield from _still_curves(primitive)
        case SphereMap():
            yield from _still_map(primitive)
        case Surface():
            yield from _still_surface(primitive)
        case Graph():
            yield from _still_graph(primitive)
        case Text():
            yield "", rr.TextDocument(primitive.markdown, media_type="text/markdown")
        case _:
            assert_never(primitive)


def moving(
    primitive: Primitive, labels: NDArray[np.object_] | None = None
) -> Iterator[Moving]:
    """Yield the columns of one block of samples; nothing for what does not move.

    `labels` (n,) are those of an arrow, if it does not have its own at all rows.
    """
    match primitive:
        case Trace(quaternions=quaternions) if quaternions is not None:
            yield "", _turned(quaternions)
        case Diagram():
            yield from diagrams.moving(primitive)
        case Body(quaternions=quaternions) if quaternions is not None:
            yield "", _turned(quaternions)
            yield "labels", rr.Points3D.columns(show_labels=all_finite(quaternions, 1))
        case Arrow(directions=directions, primary=primary, path_shown=path_shown):
            good = all_finite(directions, 1)
            arrows, length = directions[good], 1.12 if primary else 1.25
            yield "", rr.Arrows3D.columns(vectors=length * arrows).partition(good)
            if not primary:
                if labels is None:
                    labels = np.full(len(good), primitive.label, dtype=object)
                named = good & (labels != "")
                places, words = 1.3 * directions[named], labels[named].tolist()
                columns = rr.Points3D.columns(positions=places, labels=words)
                yield "label", columns.partition(named)
                if primitive.shown and path_shown:
                    yield "trail", _points(1.004 * arrows, good)
        case GreatCircle(normals=normals):
            yield "", _turned(quaternion(frame_from(normals, perpendicular(normals))))
        case Portrait():
            points = charts.in_frame(primitive.placed())
            good = all_finite(points, 1)
            yield "mark", rr.Points2D.columns(positions=points[good]).partition(good)
        case Series(values=values):
            yield "", rr.Scalars.columns(scalars=values)
        case _:  # what does not move
            return


def check_rows(primitive: Primitive, count: int) -> None:
    """Raise ValueError if a primitive has another number of rows than the block."""
    for rows in rows_of(primitive).values():
        if isinstance(rows, np.ndarray) and len(rows) != count:
            raise ValueError(
                f"{primitive.path} has {len(rows)} rows, the block has {count}"
            )


def drawn_whole(primitive: Primitive) -> Floats | None:
    """Return the rows of a primitive of which something is drawn in the end, if any."""
    match primitive:
        case Trace(directions=rows) | Arrow(directions=rows, path_shown=True):
            return rows
        case Portrait(curves=curves) if not curves:
            return primitive.placed()
    return None


def whole(primitive: Primitive, rows: Floats, row: int | None) -> Stills:
    """Yield what stands still of all rows of a primitive, in a grid of rows so long.

    The path that a pole leaves on the sphere, that of a direction in the axes of a link,
    and the curve of a portrait.
    """
    if isinstance(primitive, Portrait):
        if shapes.unbroken(rows):
            yield "curve", charts.portrait_line(rows, colours.TONES[1])
        return
    lines = shapes.path_on_sphere(rows, row)
    if lines and isinstance(primitive, Trace):
        colour = colours.link_colour(primitive.number)
        yield "curve", _curves(lines, 1.006, colour, 1.8)
    elif lines and isinstance(primitive, Arrow):
        colour, width = colours.SILVER, 0.7
        if not primitive.primary:
            colour, width = (colours.GOLD, 1.2) if row is None else (colours.BRONZE, 0.7)
        yield "path", _curves(lines, 1.003, colour, width)


def _curves(
    lines: Iterable[Floats], lift: float, colour: colours.Colour, width: float
) -> rr.LineStrips3D:
    """Return curves just outside of the sphere, so many points wide."""
    return rr.LineStrips3D(
        [lift * np.asarray(line) for line in lines],
        colors=colour,
        radii=rr.Radius.ui_points(width),
    )


def failure_label() -> rr.Points3D:
    """Return the words shown at the centre where an assembly mode has no configuration."""
    return rr.Points3D.from_fields(
        labels="no configuration here",
        show_labels=True,
        colors=colours.WARNING,
        radii=0.0,
    )


def failure_columns(failed: Bools) -> Columns:
    """Return the columns that show the failure label at the failed samples only."""
    return _points(np.zeros((failed.sum(), 3)), failed)


def _points(positions: Floats, there: Bools) -> Columns:
    return rr.Points3D.columns(positions=positions).partition(there)


def _turned(quaternions: Floats) -> Columns:
    good = all_finite(quaternions, 1)[:, None]
    return rr.Transform3D.columns(
        quaternion=np.where(good, quaternions, [0.0, 0.0, 0.0, 1.0]),
        scale=np.where(good, np.ones(3), HIDDEN),
    )


def _still_body(body: Body, names: Sequence[Name]) -> Stills:
    colour = colours.link_colour(body.number)
    lift = 1.0 + LIFT * (1 + body.number % LEVELS)
    if len(body.curves):
        curves = [lift * np.asarray(curve) for curve in body.curves]
        yield "", rr.LineStrips3D(curves, colors=colour, radii=LINK_RADIUS)
    if len(body.joints):
        yield (
            "joints",
            rr.Points3D(lift * body.joints, colors=colours.PALE, radii=JOINT_RADIUS),
        )
    yield (
        "labels",
        rr.Points3D.from_fields(
            positions=np.reshape([place for _, place, _ in names], (-1, 3)),
            labels=[words for words, *_ in names],
            colors=[colours.PALE if of_pair else colour for *_, of_pair in names],
            radii=POINT,
            show_labels=True if body.quaternions is None else None,
        ),
    )


def _still_curves(item: SphereCurves) -> Stills:
    if item.curves:
        yield "", _curves(item.curves, 1.006, colours.tone(item.tone), 1.6)
    if item.marks:
        yield (
            "marks",
            rr.Points3D(
                [1.01 * mark.place for mark in item.marks],
                labels=[mark.label for mark in item.marks],
                colors=[colours.tone(mark.tone) for mark in item.marks],
                radii=rr.Radius.ui_points(4.0),
                show_labels=len({mark.label for mark in item.marks}) == len(item.marks),
            ),
        )


def _still_map(item: SphereMap) -> Stills:
    tints = colours.heat_of(item.values, *map_range(item.shown_values, item.unit))
    places = MAP_LIFT * item.vertices
    if len(item.triangles):
        yield (
            "",
            rr.Mesh3D(
                vertex_positions=places,
                triangle_indices=item.triangles,
                vertex_normals=item.vertices,
                vertex_colors=tints,
            ),
        )
    else:
        yield "", rr.Points3D(places, colors=tints, radii=rr.Radius.ui_points(4.0))


def _still_surface(surface: Surface) -> Stills:
    low, high = np.min(surface.vertices, axis=0), np.max(surface.vertices, axis=0)
    scale = CUBE / np.where(high > low, high - low, 1.0)
    middle = 0.5 * (low + high)
    places = (surface.vertices - middle) * scale
    if len(surface.triangles):
        yield (
            "",
            rr.Mesh3D(
                vertex_positions=places,
                triangle_indices=surface.triangles,
                vertex_normals=shapes.vertex_normals(places, surface.triangles),
                albedo_factor=colours.tone(surface.tone),
            ),
        )
    else:
        tints: NDArray[np.uint8] | colours.Colour = colours.tone(surface.tone)
        if surface.values is not None:
            tints = colours.heat_of(
                surface.values, *map_range(surface.values, surface.values_unit)
            )
        yield "", rr.Points3D(places, colors=tints, radii=rr.Radius.ui_points(3.0))
    ends = np.array([low - middle, high - middle]) * scale
    yield "axes", _curves(shapes.box(*ends), 1.0, colours.GRATICULE, 0.8)
    where, words = [], []
    for axis, name in enumerate(surface.axes):
        corner = np.where([axis == 1, False, False], ends[1], ends[0])
        out = 0.06 * np.sign(corner) * (np.arange(3) != axis)
        for far, at, text in (
            (1.0, 0.94 * ends[0][axis], f"{low[axis]:.4g}"),
            (1.0, 0.94 * ends[1][axis], f"{high[axis]:.4g}"),
            (2.0, 0.0, titled(name, surface.unit)),
        ):
            place = corner + far * out
            place[axis] = at
            where.append(place)
            words.append(text)
    yield (
        "words",
        rr.Points3D(where, labels=words, colors=colours.PALE, radii=0.0, show_labels=True),
    )


def _still_graph(graph: Graph) -> Stills:
    names, labels, numbers = zip(*graph.nodes, strict=True)
    tints = [
        colours.SILVER if number is None else colours.link_colour(number)
        for number in numbers
    ]
    places = np.array(GRAPH_SIZE) * np.reshape(graph.positions, (-1, 2))
    yield "", rr.GraphNodes(names, labels=labels, colors=tints, positions=places)
    if graph.edges:
        yield "", rr.GraphEdges(graph.edges, graph_type="undirected")
