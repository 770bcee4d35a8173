"""Checks that the scenes of an analysis have the shapes that viewers and figures need.

A scene is checked once, when the analysis returns it. A mistake is then one sentence about
that analysis, and recordings and figures of other analyses are not lost.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from spherekit.arrays import Array
from spherekit.conventions import Facts
from spherekit.errors import PluginError
from spherekit.scenes.scene import (
    Arrow,
    Axis,
    Body,
    Diagram,
    Graph,
    GreatCircle,
    InputMarks,
    Mark,
    PlaneCurve,
    Portrait,
    Primitive,
    Scene,
    Series,
    SphereCurves,
    SphereMap,
    Surface,
    Text,
    Trace,
)
from spherekit.wording import listing

Size = int | str
"""A length, or a letter for a length that all arrays of a primitive with it share."""

ARRAY_SHAPES: Mapping[type, Mapping[str, tuple[Size, ...]]] = {
    Axis: {"values": ("n",)},
    Body: {"joints": ("j", 3), "quaternions": ("n", 4)},
    Arrow: {"directions": ("n", 3)},
    Trace: {"directions": ("n", 3), "quaternions": ("n", 4)},
    GreatCircle: {"normals": ("n", 3)},
    Series: {"values": ("n",)},
    InputMarks: {"inputs": ("k", "axes")},
    Mark: {"place": ("d",)},
    PlaneCurve: {"points": ("k", 2)},
    Portrait: {"x": ("n",), "y": ("n",), "x_range": (2,), "y_range": (2,)},
    SphereCurves: {},
    SphereMap: {"vertices": ("v", 3), "triangles": ("t", 3), "values": ("v",)},
    Surface: {"vertices": ("v", 3), "triangles": ("t", 3), "values": ("v",)},
    Diagram: {
        "places": ("n", "k", 2),
        "lines": ("n", "m", 3),
        "readings": ("n", "k", 2),
        "x_range": (2,),
        "y_range": (2,),
    },
    Graph: {"positions": ("k", 2)},
    Text: {},
}
"""By class: the shapes of array fields.

"n" is the number of samples, or of the values of an axis.
"""

PARTS_OF_PRIMITIVES = (Axis, Mark, PlaneCurve)
"""Classes of `ARRAY_SHAPES` that are no primitives, but parts of scenes or primitives."""

POLYLINE_FIELDS: Mapping[type, str] = {Body: "curves", SphereCurves: "curves"}
"""By class: the field that is a sequence of polylines (k, 3)."""

SEQUENCE_LENGTHS: Mapping[type, Mapping[str, Size]] = {
    Body: {"joint_labels": "j"},
    Diagram: {"names": "k", "tones": "k", "reading_names": 2},
    Graph: {"nodes": "k"},
    Surface: {"axes": 3},
}
"""By class: the lengths of fields that are sequences and not arrays."""

MARK_DIMENSIONS: Mapping[type, int] = {Portrait: 2, SphereCurves: 3}
"""By class with marks: the number of coordinates of a mark."""

RANGE_FIELDS = ("x_range", "y_range")
"""Fields that are a least and a greatest value."""

OPTIONAL_FIELDS = {
    (Body, "quaternions"),
    (Trace, "quaternions"),
    (Surface, "values"),
    (Diagram, "readings"),
}
"""Array fields that may be None."""

TEXT_FIELDS = (
    "path",
    "label",
    "markdown",
    "unit",
    "group",
    "x_label",
    "y_label",
    "x_unit",
    "y_unit",
    "values_unit",
)
"""Fields that are texts, in every class that has them."""


@dataclass(frozen=True)
class _SceneRows:
    """The numbers of rows and columns that the arrays of a scene must have.

    A scene is a drawing of an analysis. Its values are plotted over the samples of the run,
    which arrive in blocks. A scene can also have its own axes (`Scene.over`), such as the
    angle of a rotation. Its values are then plotted over the values of these axes.

    Attributes
    ----------
    count
        Number of rows: that of the samples of the block, or of the values of the axes.
    input_column_counts
        Allowed numbers of columns of the array `InputMarks.inputs`. Each row of this array
        is a mark at a place on the axes of the plots.

        - In a scene over samples, a mark has a value of each input, or a single number such
          as a time.
        - In a scene with its own axes, a mark has a value of each axis.

    words
        What the rows are, in words for messages, such as "the 361 samples of the block".
    """

    count: int
    input_column_counts: tuple[int, ...]
    words: str


@dataclass(frozen=True)
class _SharedSize:
    """A length that several arrays of a drawn object (primitive) must have in common.

    Attributes
    ----------
    length
        The length.
    words
        Words for what has this length, in messages.
    """

    length: int
    words: str


def check_scene(
    analysis: str, scene: Any, modes: Sequence[int], sample_count: int, input_count: int
) -> Scene:
    """Check a scene that an analysis returned, and return it with NumPy arrays.

    A scene is a set of objects (primitives) that a viewer shows on one page.

    Parameters
    ----------
    analysis
        Name of the analysis, with which messages begin.
    scene
        What the analysis returned as one of its scenes.
    modes
        Numbers of the assembly modes of the run.
    sample_count
        Number of samples of each assembly mode in the block.
    input_count
        Number of inputs of the mechanism.

    Raises
    ------
    PluginError
        If it is not a `Scene`, if its page is not an assembly mode of the run, if it
        contains something that is not a primitive, or if a field in the tables of this
        module has the wrong type or shape.
    """
    if not isinstance(scene, Scene):
        raise PluginError(
            f"{analysis}: scene returned a {type(scene).__name__}; it has to return a "
            "tuple of Scene(...)"
        )
    # The page: an assembly mode of the run, a title, or None.
    where = f"{analysis}: scene of page {scene.page!r}"
    is_mode = isinstance(scene.page, int | np.integer) and not isinstance(scene.page, bool)
    if is_mode and scene.page not in modes:
        raise PluginError(
            f"{where}: this page is not an assembly mode of the run; allowed are "
            f"{listing(modes)}, a title for a page of its own, and None for every page"
        )
    if not (is_mode or scene.page is None or isinstance(scene.page, str)):
        raise PluginError(
            f"{where}: a page is the number of an assembly mode, a title, or None"
        )
    # The rows of arrays belong to the values of the axes of the scene. Without axes they
    # belong to the samples of the block.
    axes = _check_axes(where, scene.over)
    if axes:
        count = len(axes[0].values)
        words = f"the {count} values of {axes[0].label}"
        rows = _SceneRows(count, (len(axes),), words)
    else:
        # A mark on an axis over the inputs has a value for each input. A mark on an axis
        # over time has one number.
        rows = _SceneRows(
            sample_count, (input_count, 1), f"the {sample_count} samples of the block"
        )
    if not isinstance(scene.primitives, Sequence) or isinstance(scene.primitives, str):
        type_name = type(scene.primitives).__name__
        raise PluginError(f"{where}: primitives is a {type_name}; it has to be a tuple")
    primitives = tuple(
        _check_primitive(where, primitive, rows) for primitive in scene.primitives
    )
    return replace(scene, primitives=primitives, over=axes)


def _check_axes(where: str, axes: Any) -> tuple[Axis, ...]:
    """Check the axes of a drawing of an analysis, and return them with arrays of values.

    Parameters
    ----------
    where
        Words for the scene, with which messages begin.
    axes
        The field `over` of the drawing (scene): the quantities over which values are
        plotted.

    Raises
    ------
    PluginError
        If the items are no axes, if a field of an axis has the wrong type or shape, or if
        the axes have different numbers of values.
    """
    if not isinstance(axes, Sequence) or not all(isinstance(axis, Axis) for axis in axes):
        raise PluginError(f"{where}: over has to be a tuple of Axis(...)")
    checked_axes: list[Axis] = []
    for axis in axes:
        axis_words = f"{where}: Axis {axis.label!r}"
        # The values must be an array with one axis, of any length.
        changes = _check_fields(axis_words, axis, {})
        values = changes["values"]
        if checked_axes and len(values) != len(checked_axes[0].values):
            raise PluginError(
                f"{axis_words} has {len(values)} values, Axis "
                f"{checked_axes[0].label!r} has {len(checked_axes[0].values)}; a row has "
                "one of each axis"
            )
        checked_axes.append(replace(axis, **changes))
    return tuple(checked_axes)


def _check_primitive(where: str, primitive: Any, rows: _SceneRows) -> Primitive:
    """Check a primitive, and return it with its arrays as NumPy arrays.

    A primitive is an object that is drawn, such as a curve or an arrow. The tables of this
    module, such as `ARRAY_SHAPES`, say which fields of its class are checked, and how.

    Parameters
    ----------
    where
        Words for the scene, with which messages begin.
    primitive
        An item of the scene.
    rows
        The rows of the scene.
    """
    kind = type(primitive)
    if kind not in ARRAY_SHAPES or kind in PARTS_OF_PRIMITIVES:
        allowed = listing(
            cls.__name__ for cls in ARRAY_SHAPES if cls not in PARTS_OF_PRIMITIVES
        )
        raise PluginError(
            f"{where}: primitives has a {kind.__name__}; allowed are {allowed}"
        )
    # `changes` collects the checked fields by their names, for `replace` below. The letter
    # "n" in shapes is the number of rows of the scene.
    where = f"{where}: {kind.__name__} {getattr(primitive, 'path', '')!r}"
    changes = _check_fields(where, primitive, {"n": _SharedSize(rows.count, rows.words)})
    if kind in POLYLINE_FIELDS:
        name = POLYLINE_FIELDS[kind]
        curves = _check_sequence(where, name, getattr(primitive, name))
        changes[name] = [
            _check_numbers(f"{where}: {name}[{k}]", curve, ("k", 3), {})
            for k, curve in enumerate(curves)
        ]
    if isinstance(primitive, Portrait):
        plane_curves = _check_sequence(where, "curves", primitive.curves, PlaneCurve)
        changes["curves"] = [
            replace(curve, **_check_fields(f"{where}: curves[{k}]", curve, {}))
            for k, curve in enumerate(plane_curves)
        ]
    if kind in MARK_DIMENSIONS:
        dimension = _SharedSize(MARK_DIMENSIONS[kind], "coordinates")
        changes["marks"] = []
        for k, mark in enumerate(_check_sequence(where, "marks", primitive.marks, Mark)):
            mark_changes = _check_fields(f"{where}: marks[{k}]", mark, {"d": dimension})
            changes["marks"].append(replace(mark, **mark_changes))
    if isinstance(primitive, InputMarks):
        column_count = changes["inputs"].shape[1]
        if column_count not in rows.input_column_counts:
            raise PluginError(
                f"{where}: inputs has {column_count} columns, but needs one for each axis: "
                f"{rows.input_column_counts[0]}"
            )
    if isinstance(primitive, SphereMap | Surface):
        _check_triangles(where, changes["triangles"], len(changes["vertices"]))
    if isinstance(primitive, Diagram):
        text_count = len(_check_sequence(where, "words", primitive.words))
        if text_count not in (0, rows.count):
            raise PluginError(
                f"{where}: words has {text_count} texts, but needs none or one for each of "
                f"{rows.words}"
            )
    return replace(primitive, **changes)


def _check_fields(where: str, item: Any, sizes: dict[str, _SharedSize]) -> Facts:
    """Check the fields of an object that an analysis wants to draw (a primitive).

    Parameters
    ----------
    where
        Words for the item, with which messages begin.
    item
        The primitive, or a mark or curve that is a part of a primitive.
    sizes
        Known lengths of array axes by letter. `ARRAY_SHAPES` has the shape of each array
        field, for example ("n", 3). All arrays with "n" need the same length on that axis.
        The first array with a letter determines this length, which is added to `sizes`.

    Returns
    -------
    The array fields as NumPy arrays, by name.
    """
    field_names = {field.name for field in fields(item)}
    for name in TEXT_FIELDS:
        if name in field_names and not isinstance(getattr(item, name), str):
            value = getattr(item, name)
            raise PluginError(f"{where}: {name} is {value!r}; it has to be a text")
    arrays: Facts = {}
    for name, shape in ARRAY_SHAPES[type(item)].items():
        value = getattr(item, name)
        if value is None and (type(item), name) in OPTIONAL_FIELDS:
            continue
        array = _check_numbers(f"{where}: {name}", value, shape, sizes)
        if name in RANGE_FIELDS:
            # A range is a pair of floats. The comparison of such pairs by == gives a single
            # truth value.
            arrays[name] = tuple(map(float, array))
        else:
            arrays[name] = array
    # Other sequences, such as a list of names.
    for name, size in SEQUENCE_LENGTHS.get(type(item), {}).items():
        length = len(_check_sequence(where, name, getattr(item, name)))
        if isinstance(size, str):
            # The size is a letter. The sequence needs the length of the arrays with this
            # letter. For the message, `shared.words` names the things of which there are so
            # many.
            shared = sizes[size]
            needed_length = shared.length
            reason = f", as many as {shared.words}" if shared.words else ""
        else:
            needed_length = size
            reason = ""
        if length != needed_length:
            raise PluginError(
                f"{where}: {name} has {length} items, but needs {needed_length}{reason}"
            )
    return arrays


def _check_numbers(
    where: str, value: Any, shape: tuple[Size, ...], sizes: dict[str, _SharedSize]
) -> Array:
    """Check that a field is an array of numbers of a given shape, and return the array.

    The field belongs to a drawing of an analysis. A letter in the shape is a length that
    several fields share, such as the number of samples. The first field with this letter
    determines the length.

    Parameters
    ----------
    where
        Words for the field, with which messages begin. The words end with the name of the
        field.
    shape
        The length of each axis, or the letter of a shared length.
    sizes
        Known shared lengths, by letter. The lengths of new letters are added.
    """
    if np.ma.is_masked(value):
        # The conversion to an array would show the numbers under the mask.
        raise PluginError(
            f"{where} has masked values; it has to be an array without a mask, with NaN "
            "where a number is missing"
        )
    is_ragged = False
    try:
        array = np.asarray(value)
    except ValueError:
        # Rows of unequal length are no array. An error is raised below.
        is_ragged = True
        array = np.array(None)
    # The shape as Python writes it, with a comma after a single length.
    needed = "(" + ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "") + ")"
    # Floats, integers, unsigned integers and bools.
    if array.dtype.kind not in "fiub":
        if value is None or np.isscalar(value):
            content = repr(value)
        elif is_ragged:
            content = "rows of unequal length"
        elif array.shape == ():
            content = f"a {type(value).__name__}"
        else:
            content = f"{array.dtype} values"
        raise PluginError(
            f"{where} holds {content}; it has to be an array {needed} of numbers"
        )
    if array.ndim != len(shape):
        raise PluginError(f"{where} has the shape {array.shape}, but needs {needed}")
    field_name = where.rpartition(": ")[2]
    for length, size in zip(array.shape, shape, strict=True):
        if isinstance(size, str):
            first_use = _SharedSize(length, f"the {size} of {field_name}")
            expected = sizes.setdefault(size, first_use)
        else:
            expected = _SharedSize(size, "")
        if length != expected.length:
            meaning = ""
            if expected.words:
                meaning = f"; {size} is {expected.length}, {expected.words}"
            raise PluginError(
                f"{where} has the shape {array.shape}, but needs {needed}{meaning}"
            )
    return array


def _check_sequence(where: str, name: str, value: Any, kind: type | None = None) -> Any:
    """Return the value of a field of a drawn object, or raise `PluginError`.

    The error is raised if the value is no sequence, or if an item has the wrong class.

    Parameters
    ----------
    where
        Words for the object that is drawn, with which messages begin.
    name
        Name of the field, for messages.
    kind
        The class of all items, without derived classes. By default the items may be
        anything.
    """
    is_sequence = isinstance(value, Sequence) and not isinstance(value, str)
    # An array of the shape () has no items.
    if not is_sequence and not (isinstance(value, np.ndarray) and value.ndim):
        raise PluginError(
            f"{where}: {name} is a {type(value).__name__}; it has to be a sequence"
        )
    for k, item in enumerate(value):
        # Checks look up the exact class of an item in `ARRAY_SHAPES`, in which derived
        # classes are missing.
        if kind is not None and type(item) is not kind:
            raise PluginError(
                f"{where}: {name}[{k}] is a {type(item).__name__}; it has to be a "
                f"{kind.__name__}(...)"
            )
    return value


def _check_triangles(where: str, triangles: Array, vertex_count: int) -> None:
    """Raise `PluginError` if corners of triangles are not indices of vertices.

    Parameters
    ----------
    where
        Words for the object that is drawn, with which messages begin.
    triangles
        (t, 3) indices of the vertices at the corners of t triangles.
    vertex_count
        Number of vertices.
    """
    if len(triangles) and triangles.dtype.kind not in "iu":
        raise PluginError(
            f"{where}: triangles contains {triangles.dtype} values; it has to contain the "
            "indices of vertices, as integers"
        )
    wrong_corners = triangles[(triangles < 0) | (triangles >= vertex_count)]
    if len(wrong_corners):
        allowed = f"the vertices have the numbers 0 to {vertex_count - 1}"
        if not vertex_count:
            allowed = "there are no vertices"
        raise PluginError(
            f"{where}: triangles has the corner {wrong_corners[0]}, but {allowed}"
        )
