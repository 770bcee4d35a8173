"""The entities of rerun for each primitive of a scene: static data, and rows that move.

A sample that failed has NaN, and the viewer must show nothing for it. Arrows, their labels,
and points get an empty row. The curves of a link are static, so its transform shrinks them
to a point instead. The names of a link are hidden.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import assert_never

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Bools, Floats
from spherekit.display.rerun import diagrams, portraits, shapes
from spherekit.display.rerun.chart_frame import place_in_frame
from spherekit.display.rerun.charts import dot_style
from spherekit.display.rerun.destination import ENTITY_ITSELF, Columns, Stills
from spherekit.display.rerun.labels import Name
from spherekit.display.rerun.rerun_sdk import rr
from spherekit.geometry.rotation import quaternion
from spherekit.geometry.sphere_mesh import sphere_mesh
from spherekit.geometry.triangle import frame_from, perpendicular
from spherekit.geometry.vectors import all_finite
from spherekit.scenes import colours
from spherekit.scenes.plot_layout import choose_map_range
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
    sample_rows,
    title_with_unit,
)

Moving = tuple[str, Columns]
"""Path below the primitive, and its columns for one block of rows."""

LINK_RADIUS = 0.016
JOINT_RADIUS = 0.03
LABEL_RADIUS = 0.001
"""Radii of tubes and points, in radii of the sphere."""

CIRCLE_RADIUS = 0.0035
"""Radius of the tube of a great circle, in radii of the sphere."""

SHELL_DISTANCE = 0.012
SHELL_COUNT = 6
"""Links lie on several shells, so that arcs that coincide do not flicker."""

SPHERE_SCALE = 0.985
MAP_SCALE = 1.002
PATH_SCALE = 1.003
TRAIL_SCALE = 1.004
CURVE_SCALE = 1.006
MARK_SCALE = 1.01
"""Distances from the centre at which the sphere and the objects on it are drawn.

They increase in this order, so that no object is hidden inside another one.
"""

PAIR_ARROW_LENGTH = 1.12
POLE_ARROW_LENGTH = 1.25
POLE_LABEL_DISTANCE = 1.3

HIDDEN_SCALE = 1e-6
"""Scale that shrinks a link to a point; the viewer ignores a scale of zero."""

GRAPH_SIZE = (420.0, 220.0)
"""Width and height of the graph of links and pairs."""

CUBE_SIDE = 1.6
"""Side of the cube that a surface fills; a coordinate that is constant has no extent."""

END_NUMBER_FRACTION = 0.94
"""Place of the numbers at the ends of a surface's axis, as a part of half the edge: 1 is a
corner of the box."""

TRACE_WIDTH = 1.8
POLE_PATH_WIDTH = 1.2
THIN_PATH_WIDTH = 0.7
"""Widths of the curves on which directions moved, in points of the screen.

The three widths are for paths in the axes of a link, for the path of a pole, and for paths
of pair axes or many paths of one pole.
"""

SPHERE_CURVE_WIDTH = 1.6
BOX_LINE_WIDTH = 0.8
"""Widths of curves on the sphere and of the edges of a surface's box, in points of the
screen."""

WORD_DISTANCE = 0.06
"""Distance of the numbers of a surface's axis from the two faces of the cube at its edge.

The title of the axis is at twice this distance.
"""


def draw_sphere() -> Stills:
    """Yield the sphere with its graticule."""
    vertices, triangles = sphere_mesh()
    yield (
        "sphere/body",
        rr.Mesh3D(
            vertex_positions=SPHERE_SCALE * vertices,
            triangle_indices=triangles,
            vertex_normals=vertices,
            albedo_factor=colours.SPHERE,
        ),
    )
    lines = shapes.graticule()
    yield "sphere/graticule", _curves(lines, CURVE_SCALE, colours.GRATICULE, 0.6)


def draw_static(primitive: Primitive, names: Sequence[Name] = ()) -> Stills:
    """Yield the data of a primitive that are the same in all rows and are logged once.

    A primitive is something to draw: a link, an arrow, a curve, a chart, a text and so on.
    A row is the state of the primitive at one sample of a motion. The data are written to a
    recording of the viewer rerun (`rr`). Many primitives log only their appearance here,
    and their positions row by row, see `moving_columns`.

    Parameters
    ----------
    primitive
        The primitive. A `Portrait` is a plot of one quantity against another, with a mark
        at the current sample. A `Trace` is the path of a direction seen from a link.
    names
        For a link, its own name and the names of its pairs (joints). Each item has the
        text, the place (3,) at which it is drawn, in axes of the link, and whether it names
        a pair. Unused for other primitives.

    Yields
    ------
    A path below the path of the primitive, and the data to log there. The path
    `ENTITY_ITSELF` stands for the path of the primitive.
    """
    match primitive:
        case Body():
            yield from _draw_body(primitive, names)
        case Arrow():
            yield from _arrow_style(primitive)
        case GreatCircle():
            yield (
                ENTITY_ITSELF,
                rr.LineStrips3D(
                    [shapes.unit_circle()],
                    colors=colours.VIOLET,
                    radii=CIRCLE_RADIUS,
                    labels=primitive.label,
                    show_labels=False,
                ),
            )
        case Series() | Trace() | InputMarks():
            return  # other functions draw these: in charts, or as curves after the last row
        case Portrait():
            yield from portraits.draw_portrait(primitive)
            yield "mark", dot_style()
        case Diagram():
            yield from diagrams.draw_static(primitive)
        case SphereCurves():
            yield from _draw_sphere_curves(primitive)
        case SphereMap():
            yield from _draw_sphere_map(primitive)
        case Surface():
            yield from _draw_surface(primitive)
        case Graph():
            yield from _draw_graph(primitive)
        case Text():
            yield (
                ENTITY_ITSELF,
                rr.TextDocument(primitive.markdown, media_type="text/markdown"),
            )
        case _:
            assert_never(primitive)


def moving_columns(
    primitive: Primitive, labels: NDArray[np.object_] | None = None
) -> Iterator[Moving]:
    """Yield the data of a primitive that change from row to row, for one block of rows.

    A primitive is something to draw, such as a link, an arrow or a plot. A row is its state
    at one sample of a motion. A row without a configuration is NaN: it gets no arrow, point
    or label. The curves of a link were logged (stored in the recording) once by
    `draw_static`. Only the rotation of the link (a quaternion) changes. A link or trace
    without quaternions is fixed to the ground.

    Parameters
    ----------
    primitive
        The primitive. If it does not move, nothing is yielded.
    labels
        (rows,) labels of an arrow. By default the label of the arrow is used in all rows.

    Yields
    ------
    A path below the path of the primitive, and the columns (one item per row) to log there
    with the viewer rerun (`rr`). The path `ENTITY_ITSELF` stands for the path of the
    primitive.
    """
    match primitive:
        case Trace(quaternions=quaternions) if quaternions is not None:
            # A trace is the path of an axis as seen from a link, a curve that turns with
            # this link.
            yield ENTITY_ITSELF, _rotation_columns(quaternions)
        case Diagram():
            yield from diagrams.moving_columns(primitive)
        case Body(quaternions=quaternions) if quaternions is not None:
            yield ENTITY_ITSELF, _rotation_columns(quaternions)
            # `draw_static` logged the labels of the link. The labels are hidden in rows
            # without a configuration.
            has_configuration = all_finite(quaternions, axis=1)
            yield "labels", rr.Points3D.columns(show_labels=has_configuration)
        case Arrow():
            yield from _arrow_columns(primitive, labels)
        case GreatCircle(normals=normals):
            # `draw_static` logged the unit circle about z. The rotation turns z to the
            # normal of the plane.
            rotations = frame_from(normals, perpendicular(normals))
            yield ENTITY_ITSELF, _rotation_columns(quaternion(rotations))
        case Portrait():
            # Only the mark at the current row moves. `placed` gives its place as fractions
            # of the width and height of the frame.
            points = place_in_frame(primitive.placed())
            is_valid = all_finite(points, axis=1)
            # `partition` assigns one point to each valid row and none to the other rows.
            columns = rr.Points2D.columns(positions=points[is_valid])
            yield "mark", columns.partition(is_valid)
        case Series(values=values):
            yield ENTITY_ITSELF, rr.Scalars.columns(scalars=values)
        case _:
            return


def _arrow_style(arrow: Arrow) -> Stills:
    """Yield the appearance of an arrow, which is the same at all samples of the motion.

    A primary arrow is the axis of a pair (joint), in silver. Every other arrow is a pole:
    the instantaneous axis of the relative rotation of two links that no pair joins. It is
    gold and has a label.

    An arrow can be hidden when the viewer opens (`shown` is false). Users can switch it on,
    so its appearance is logged too. A pole that is shown from the start also has a trail,
    if its path is to be shown (`path_shown`): dots where it was at the last samples.

    Yields
    ------
    A path below the path of the arrow, and the data to log there. `ENTITY_ITSELF` stands
    for the path of the arrow. `_arrow_columns` yields the positions at the samples.
    """
    if arrow.primary:
        yield ENTITY_ITSELF, rr.Arrows3D.from_fields(colors=colours.SILVER, radii=0.006)
        return
    yield ENTITY_ITSELF, rr.Arrows3D.from_fields(colors=colours.GOLD, radii=0.014)
    yield (
        "label",
        rr.Points3D.from_fields(show_labels=True, colors=colours.GOLD, radii=LABEL_RADIUS),
    )
    if arrow.shown and arrow.path_shown:
        yield "trail", rr.Points3D.from_fields(colors=colours.PALE, radii=0.008)


def _arrow_columns(arrow: Arrow, labels: NDArray[np.object_] | None) -> Iterator[Moving]:
    """Yield the directions of an arrow in all rows, and positions of its label and trail.

    A row is one sample of the motion. Rows without a direction (NaN) get no arrow.

    Parameters
    ----------
    arrow
        The axis of a pair (`primary`), or a pole: the axis of the relative rotation of two
        links that no pair joins. Only a pole has a label. It has a trail (dots along its
        path) if it is shown from the start (`shown`) and its path is shown (`path_shown`).
    labels
        (rows,) labels, empty where the pole has none. By default the label of the arrow is
        used in all rows.

    Yields
    ------
    The name of a part below the name of the arrow, and the columns to log there for the
    viewer rerun. `ENTITY_ITSELF` stands for the arrow itself.
    """
    is_valid = all_finite(arrow.directions, 1)
    # `partition` assigns one item to each valid row and none to the other rows.
    directions = arrow.directions[is_valid]
    length = PAIR_ARROW_LENGTH if arrow.primary else POLE_ARROW_LENGTH
    yield (
        ENTITY_ITSELF,
        rr.Arrows3D.columns(vectors=length * directions).partition(is_valid),
    )
    if arrow.primary:
        return
    if labels is None:
        labels = np.full(len(is_valid), arrow.label, dtype=object)
    has_label = is_valid & (labels != "")
    columns = rr.Points3D.columns(
        positions=POLE_LABEL_DISTANCE * arrow.directions[has_label],
        labels=labels[has_label].tolist(),
    )
    yield "label", columns.partition(has_label)
    if arrow.shown and arrow.path_shown:
        yield "trail", _point_columns(TRAIL_SCALE * directions, is_valid)


def check_rows(primitive: Primitive, count: int) -> None:
    """Raise `ValueError` if a primitive has another number of rows than its block."""
    for rows in sample_rows(primitive).values():
        if isinstance(rows, np.ndarray) and len(rows) != count:
            raise ValueError(
                f"{primitive.path}: found {len(rows)} rows, expected {count}, one for "
                "each sample"
            )


def rows_for_path(primitive: Primitive) -> Floats | None:
    """Return the positions at all samples through which a curve is drawn, or None.

    The curve shows how a drawn object has moved. The curve is drawn after the last sample
    of a recording (`draw_path`). The positions are directions (rows, 3), or points (rows,
    2) of a plot (portrait) as fractions of its width and height. The result is None if the
    object gets no curve.
    """
    match primitive:
        case Trace(directions=rows) | Arrow(directions=rows, path_shown=True):
            return rows
        case Portrait(curves=curves) if not curves:
            return primitive.placed()
    return None


def draw_path(primitive: Primitive, rows: Floats, line_length: int | None) -> Stills:
    """Yield the curve on which a direction or a point of a plot has moved over all rows.

    The curve is drawn once, after the last row (sample) of a recording. Curves on the
    sphere are drawn a little outside of it (`CURVE_SCALE`, `PATH_SCALE`), where the sphere
    cannot hide them.

    Parameters
    ----------
    primitive
        What has moved: an `Arrow`, a `Trace` (a direction seen in the axes of a link), or a
        `Portrait` (a plot of one quantity against another). A primary arrow is the axis of
        a pair (joint). Other arrows are poles (axes of the relative rotation of two links).
    rows
        The positions in all rows: directions (rows, 3), or points (rows, 2) of the plot as
        fractions of its width and height.
    line_length
        Number of samples in one line of a grid of two inputs, after which the curve is
        broken. None if the samples follow each other along a single curve.

    Yields
    ------
    A name and the curve, which is logged under this name below the path of the primitive.
    Nothing is yielded if no two successive rows are without NaN, or if a direction moves
    by less than `shapes.MIN_PATH_STEP_RAD`.
    """
    if isinstance(primitive, Portrait):
        if line_length is not None:
            line_starts = np.arange(line_length, len(rows), line_length)
            rows = np.insert(rows, line_starts, np.nan, axis=0)
        if shapes.split_at_nan(rows):
            yield "curve", portraits.draw_portrait_curve(rows, colours.TONES[1])
        return
    lines = shapes.path_on_sphere(rows, line_length)
    if not lines:
        return
    if isinstance(primitive, Trace):
        colour = colours.link_colour(primitive.number)
        yield "curve", _curves(lines, CURVE_SCALE, colour, TRACE_WIDTH)
    elif isinstance(primitive, Arrow):
        if primitive.primary:
            colour = colours.SILVER
            line_width = THIN_PATH_WIDTH
        elif line_length is None:
            colour = colours.GOLD
            line_width = POLE_PATH_WIDTH
        else:
            colour = colours.BRONZE  # many curves, one for each line of the grid
            line_width = THIN_PATH_WIDTH
        yield "path", _curves(lines, PATH_SCALE, colour, line_width)


def _curves(
    lines: Iterable[Floats], scale: float, colour: colours.Colour, line_width: float
) -> rr.LineStrips3D:
    """Return polylines as an object that the viewer rerun draws.

    Parameters
    ----------
    lines
        Polylines (n, 3), on the unit sphere or elsewhere.
    scale
        Factor of all coordinates. For polylines on the sphere it is a little more than 1,
        so that the sphere does not hide them.
    colour
        Colour of the polylines.
    line_width
        Width of the polylines in points of the screen.
    """
    return rr.LineStrips3D(
        [scale * np.asarray(line) for line in lines],
        colors=colour,
        radii=rr.Radius.ui_points(line_width),
    )


def failure_label() -> rr.Points3D:
    """Return the text at the centre for samples without a configuration."""
    return rr.Points3D.from_fields(
        labels="no configuration here",
        show_labels=True,
        colors=colours.WARNING,
        radii=0.0,
    )


def failure_columns(is_failed: Bools) -> Columns:
    """Return the rows (rows,) of the failure label, which is shown at failed samples."""
    return _point_columns(np.zeros((is_failed.sum(), 3)), is_failed)


def _point_columns(positions: Floats, has_point: Bools) -> Columns:
    """Return points for the viewer rerun, one for each row (sample) or none.

    Parameters
    ----------
    positions
        (k, 3) positions in the k rows that have a point.
    has_point
        (rows,) whether a row has a point.
    """
    return rr.Points3D.columns(positions=positions).partition(has_point)


def _rotation_columns(quaternions: Floats) -> Columns:
    """Return the rotation of a moving object in each row (sample), and hide it in NaN rows.

    The viewer rerun gets the object, such as the curves of a link, once for all rows. So it
    cannot remove the object in a single row. In a NaN row it shrinks the object to a point
    instead.

    Parameters
    ----------
    quaternions
        (rows, 4) rotations as quaternions xyzw; NaN in rows without a configuration.
    """
    is_valid = all_finite(quaternions, 1)[:, None]
    return rr.Transform3D.columns(
        quaternion=np.where(is_valid, quaternions, [0.0, 0.0, 0.0, 1.0]),
        scale=np.where(is_valid, np.ones(3), HIDDEN_SCALE),
    )


def _draw_body(body: Body, names: Sequence[Name]) -> Stills:
    """Yield the curves, joints and names of a link, in the frame that moves with the link.

    Parameters
    ----------
    body
        The link.
    names
        The names that the link shows: text, place (3,) in its frame, and whether it names
        a pair (joint).

    Yields
    ------
    A path below the path of the link, and the data to log there once. `ENTITY_ITSELF`
    stands for the path of the link.
    """
    colour = colours.link_colour(body.number)
    # Links are drawn at a few different distances from the centre, so that coinciding arcs
    # of two links do not flicker.
    scale = 1.0 + SHELL_DISTANCE * (1 + body.number % SHELL_COUNT)
    if len(body.curves):
        curves = [scale * np.asarray(curve) for curve in body.curves]
        yield ENTITY_ITSELF, rr.LineStrips3D(curves, colors=colour, radii=LINK_RADIUS)
    if len(body.joints):
        yield (
            "joints",
            rr.Points3D(scale * body.joints, colors=colours.PALE, radii=JOINT_RADIUS),
        )
    yield (
        "labels",
        rr.Points3D.from_fields(
            # reshape keeps three columns even if there are no names
            positions=np.reshape([place for _, place, _ in names], (-1, 3)),
            labels=[text for text, _, _ in names],
            colors=[colours.PALE if is_pair else colour for _, _, is_pair in names],
            radii=LABEL_RADIUS,
            # A moving link hides its names in rows without a configuration. This is logged
            # later, for each row.
            show_labels=True if body.quaternions is None else None,
        ),
    )


def _draw_sphere_curves(item: SphereCurves) -> Stills:
    """Yield curves and marks on the unit sphere, which do not move.

    Curves and marks are drawn a little outside of the sphere (`CURVE_SCALE`, `MARK_SCALE`),
    where the sphere cannot hide them. `tone`, an attribute of the curves and of each mark,
    is the number of a colour (`colours.tone_colour`).

    Yields
    ------
    The name of a part below the name of the drawing, and the data to log there once. The
    name `ENTITY_ITSELF` stands for the drawing itself.
    """
    if item.curves:
        colour = colours.tone_colour(item.tone)
        yield (
            ENTITY_ITSELF,
            _curves(item.curves, CURVE_SCALE, colour, SPHERE_CURVE_WIDTH),
        )
    if item.marks:
        # Labels are always visible if no two are equal. Otherwise each label is visible
        # only while the pointer is on its mark.
        labels = [mark.label for mark in item.marks]
        yield (
            "marks",
            rr.Points3D(
                [MARK_SCALE * mark.place for mark in item.marks],
                labels=labels,
                colors=[colours.tone_colour(mark.tone) for mark in item.marks],
                radii=rr.Radius.ui_points(4.0),
                show_labels=len(set(labels)) == len(labels),
            ),
        )


def _draw_sphere_map(item: SphereMap) -> Stills:
    """Yield a map: values on the unit sphere, shown as colours of a mesh or of points.

    The map is drawn as points if it has no triangles. One item is yielded: the path
    `ENTITY_ITSELF`, which stands for the path of the map, and the data to log there once.
    """
    # Colours span only the values at vertices that are drawn.
    low, high = choose_map_range(item.shown_values, item.unit)
    tints = colours.heat_colours(item.values, low, high)
    # The map is a little outside of the sphere, so that the sphere does not hide the map.
    positions = MAP_SCALE * item.vertices
    if len(item.triangles):
        yield (
            ENTITY_ITSELF,
            rr.Mesh3D(
                vertex_positions=positions,
                triangle_indices=item.triangles,
                vertex_normals=item.vertices,  # on the unit sphere, both are equal
                vertex_colors=tints,
            ),
        )
    else:
        yield (
            ENTITY_ITSELF,
            rr.Points3D(positions, colors=tints, radii=rr.Radius.ui_points(4.0)),
        )


def _draw_surface(surface: Surface) -> Stills:
    """Yield the drawings of a surface over three quantities, in a cube with labelled edges.

    The three quantities have different ranges, so each axis is scaled by itself to the side
    of the cube. Without triangles the surface is drawn as points.

    Each item is the name of a part, such as ``axes``, and its data. The data are stored
    once in a recording for the viewer rerun. Data in a recording have paths, like files:
    the name of a part follows the path of the surface. The name `ENTITY_ITSELF` stands for
    the surface itself.
    """
    if not len(surface.vertices):
        return
    low = np.min(surface.vertices, axis=0)
    high = np.max(surface.vertices, axis=0)
    scale = CUBE_SIDE / np.where(high > low, high - low, 1.0)
    middle = 0.5 * (low + high)
    positions = (surface.vertices - middle) * scale
    if len(surface.triangles):
        yield (
            ENTITY_ITSELF,
            rr.Mesh3D(
                vertex_positions=positions,
                triangle_indices=surface.triangles,
                vertex_normals=shapes.vertex_normals(positions, surface.triangles),
                albedo_factor=colours.tone_colour(surface.tone),
            ),
        )
    else:
        tints: NDArray[np.uint8] | colours.Colour = colours.tone_colour(surface.tone)
        if surface.values is not None:
            value_range = choose_map_range(surface.values, surface.values_unit)
            tints = colours.heat_colours(surface.values, *value_range)
        yield (
            ENTITY_ITSELF,
            rr.Points3D(positions, colors=tints, radii=rr.Radius.ui_points(3.0)),
        )
    low_corner = (low - middle) * scale
    high_corner = (high - middle) * scale
    box = shapes.box(low_corner, high_corner)
    yield "axes", _curves(box, 1.0, colours.GRATICULE, BOX_LINE_WIDTH)

    word_positions = []
    words = []
    for axis, name in enumerate(surface.axes):
        # Each axis is labelled along one edge of the box. The labelled edges of x and z
        # start at the low corner. The labelled edge of y is at the highest x.
        corner = low_corner.copy()
        if axis == 1:
            corner[0] = high_corner[0]
        # Words are a little outside of the box. The origin is the middle of the box, so the
        # sign of a coordinate says which way is outwards. Along the edge the words are not
        # moved.
        outwards = WORD_DISTANCE * np.sign(corner)
        outwards[axis] = 0.0
        # Distance outwards, coordinate along the edge and text of the two ends and the
        # title.
        for distance, along_axis, text in (
            (1.0, END_NUMBER_FRACTION * low_corner[axis], f"{low[axis]:.4g}"),
            (1.0, END_NUMBER_FRACTION * high_corner[axis], f"{high[axis]:.4g}"),
            (2.0, 0.0, title_with_unit(name, surface.unit)),
        ):
            position = corner + distance * outwards
            position[axis] = along_axis
            word_positions.append(position)
            words.append(text)
    yield (
        "words",
        rr.Points3D(
            word_positions, labels=words, colors=colours.PALE, radii=0.0, show_labels=True
        ),
    )


def _draw_graph(graph: Graph) -> Stills:
    """Yield the graph of a mechanism, with links and pairs (joints) as nodes.

    A node is a tuple of name, label and link number. The number decides the colour. A pair
    has no number, and its node is grey. The coordinates of nodes are from 0 to 1.
    """
    if not graph.nodes:
        return
    names, labels, link_numbers = zip(*graph.nodes, strict=True)
    tints = [
        colours.SILVER if number is None else colours.link_colour(number)
        for number in link_numbers
    ]
    positions = np.array(GRAPH_SIZE) * np.reshape(graph.positions, (-1, 2))
    yield (
        ENTITY_ITSELF,
        rr.GraphNodes(names, labels=labels, colors=tints, positions=positions),
    )
    if graph.edges:
        yield ENTITY_ITSELF, rr.GraphEdges(graph.edges, graph_type="undirected")
