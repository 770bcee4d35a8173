"""Whether the scenes of an analysis have the shapes that viewers and figures rely on.

A scene is checked once, where the analysis returns it. A mistake is then one sentence
about that analysis, and no recording or figure of another one is lost.
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
"""A length, or a letter for one that all arrays of a primitive with the letter share."""

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
"""The shapes of array fields. "n" is the number of samples, or of values of an axis."""

CURVES: Mapping[type, str] = {Body: "curves", SphereCurves: "curves"}
"""Fields that are sequences of polylines (k, 3)."""

LISTS: Mapping[type, Mapping[str, Size]] = {
    Body: {"joint_labels": "j"},
    Diagram: {"names": "k", "tones": "k"},
    Graph: {"nodes": "k"},
    Surface: {"axes": 3},
}
"""The lengths of sequences."""

MARK_SIZES: Mapping[type, int] = {Portrait: 2, SphereCurves: 3}
"""Numbers of the place of a mark, by the primitive that it belongs to."""

RANGES = ("x_range", "y_range")
"""Fields that are a least and a greatest value."""

OPTIONAL = {
    (Body, "quaternions"),
    (Trace, "quaternions"),
    (Surface, "values"),
    (Diagram, "readings"),
}
"""Array fields that may be None."""

TEXTS = ("path", "label", "markdown", "unit", "group", "x_label", "y_label")
"""Fields that are texts."""


@dataclass(frozen=True)
class _Rows:
    """What the rows of a scene are: how many, and how many axes they run over."""

    count: int
    axes: tuple[int, ...]
    words: str


def check_scene(
    analysis: str, scene: Any, modes: Sequence[int], samples: int, inputs: int
) -> Scene:
    """Return a scene with its arrays as NumPy arrays, or refuse it in a sentence.

    Parameters
    ----------
    analysis
        Name of the analysis, with which messages begin.
    scene
        What the analysis returned as one of its scenes.
    modes
        Numbers of the assembly modes of the run.
    samples
        Samples of each assembly mode in the block.
    inputs
        Number of the inputs of the mechanism.

    Raises
    ------
    PluginError
        If it is no `Scene`, its page is no assembly mode of the run, it holds something
        that is no primitive, or a field has the wrong type or shape.
    """
    if not isinstance(scene, Scene):
        raise PluginError(
            f"{analysis}: scene returned a {type(scene).__name__}, it has to return a "
            "tuple of Scene(...)"
        )
    where = f"{analysis}: scene of page {scene.page!r}"
    is_mode = isinstance(scene.page, int | np.integer) and not isinstance(scene.page, bool)
    if is_mode and scene.page not in modes:
        raise PluginError(
            f"{where}: that is no assembly mode of the run; allowed are {listing(modes)}, "
            "a title for a page of its own, and None for every page"
        )
    if not (is_mode or scene.page is None or isinstance(scene.page, str)):
        raise PluginError(
            f"{where}: a page is the number of an assembly mode, a title, or None"
        )
    over = _check_axes(where, scene.over)
    if over:
        count = len(over[0].values)
        rows = _Rows(count, (len(over),), f"the {count} values of {over[0].label}")
    else:
        # Over time there is one axis; marks may still be given by all inputs.
        rows = _Rows(samples, (inputs, 1), f"the {samples} samples of the block")
    if not isinstance(scene.primitives, Sequence) or isinstance(scene.primitives, str):
        kind = type(scene.primitives).__name__
        raise PluginError(f"{where}: primitives is a {kind}, it has to be a tuple")
    parts = tuple(_check_primitive(where, part, rows) for part in scene.primitives)
    return replace(scene, primitives=parts, over=over)


def _check_axes(where: str, over: Any) -> tuple[Axis, ...]:
    """Return the axes that the rows run over, checked; all have the same length."""
    if not isinstance(over, Sequence) or not all(isinstance(x, Axis) for x in over):
        raise PluginError(f"{where}: over has to be a tuple of Axis(...)")
    axes: list[Axis] = []
    for axis in over:
        values = _numbers(f"{where}: Axis {axis.label!r}: values", axis.values, ("n",), {})
        if axes and len(values) != len(axes[0].values):
            raise PluginError(
                f"{where}: Axis {axis.label!r} has {len(values)} values, Axis "
                f"{axes[0].label!r} has {len(axes[0].values)}; a row has one of each axis"
            )
        axes.append(replace(axis, values=values))
    return tuple(axes)


def _check_primitive(where: str, primitive: Any, rows: _Rows) -> Primitive:
    """Return a primitive with its arrays as NumPy arrays."""
    kind = type(primitive)
    if kind not in ARRAY_SHAPES or kind in (Axis, Mark, PlaneCurve):
        allowed = listing(
            cls.__name__ for cls in ARRAY_SHAPES if cls not in (Axis, Mark, PlaneCurve)
        )
        raise PluginError(
            f"{where}: primitives has a {kind.__name__}; allowed are {allowed}"
        )
    where = f"{where}: {kind.__name__} {getattr(primitive, 'path', '')!r}"
    sizes: dict[str, tuple[int, str]] = {"n": (rows.count, rows.words)}
    changes = _check_fields(where, primitive, sizes)
    if kind in CURVES:
        name = CURVES[kind]
        curves = _sequence(where, name, getattr(primitive, name))
        changes[name] = [
            _numbers(f"{where}: {name}[{k}]", curve, ("k", 3), {})
            for k, curve in enumerate(curves)
        ]
    if isinstance(primitive, Portrait):
        changes["curves"] = [
            replace(curve, **_check_fields(f"{where}: curves[{k}]", curve, {}))
            for k, curve in enumerate(
                _sequence(where, "curves", primitive.curves, PlaneCurve)
            )
        ]
    if kind in MARK_SIZES:
        changes["marks"] = []
        for k, mark in enumerate(_sequence(where, "marks", primitive.marks, Mark)):
            size = {"d": (MARK_SIZES[kind], "coordinates")}
            changed = _check_fields(f"{where}: marks[{k}]", mark, size)
            changes["marks"].append(replace(mark, **changed))
    if isinstance(primitive, InputMarks) and changes["inputs"].shape[1] not in rows.axes:
        raise PluginError(
            f"{where}: inputs has {changes['inputs'].shape[1]} columns, it needs one for "
            f"each axis: {rows.axes[0]}"
        )
    if isinstance(primitive, SphereMap | Surface):
        _check_triangles(where, changes)
    if isinstance(primitive, Diagram) and len(primitive.words) not in (0, rows.count):
        raise PluginError(
            f"{where}: words has {len(primitive.words)} texts, it needs none or one for "
            f"each of {rows.words}"
        )
    return replace(primitive, **changes)


def _check_fields(where: str, item: Any, sizes: dict[str, tuple[int, str]]) -> Facts:
    """Return the array fields of a primitive or part of one as NumPy arrays.

    `sizes` are lengths by letter, with words for what is as long; others are added.
    """
    changes: Facts = {}
    names = {field.name for field in fields(item)}
    for name in TEXTS:
        if name in names and not isinstance(getattr(item, name), str):
            value = getattr(item, name)
            raise PluginError(f"{where}: {name} is {value!r}, it has to be a text")
    for name, shape in ARRAY_SHAPES[type(item)].items():
        value = getattr(item, name)
        if value is None and (type(item), name) in OPTIONAL:
            continue
        array = _numbers(f"{where}: {name}", value, shape, sizes)
        # A range stays a pair of floats, which can be compared as such.
        changes[name] = tuple(map(float, array)) if name in RANGES else array
    for name, size in LISTS.get(type(item), {}).items():
        length = len(_sequence(where, name, getattr(item, name)))
        needed, words = (size, "") if isinstance(size, int) else sizes[size]
        if length != needed:
            as_many = f", as many as {words}" if words else ""
            raise PluginError(
                f"{where}: {name} has {length} items, it needs {needed}{as_many}"
            )
    return changes


def _numbers(
    where: str,
    value: Any,
    shape: tuple[Size, ...],
    sizes: dict[str, tuple[int, str]],
) -> Array:
    """Return an array of numbers of a shape; letters without a length get one."""
    try:
        array = np.asarray(value)
    except ValueError:
        array = np.array(None)
    needed = "(" + ", ".join(map(str, shape)) + ("," if len(shape) == 1 else "") + ")"
    if array.dtype.kind not in "fiub":
        if value is None or np.isscalar(value):
            content = repr(value)
        elif array.shape == ():
            content = "rows of unequal length"
        else:
            content = f"{array.dtype} values"
        raise PluginError(
            f"{where} holds {content}, it has to be an array {needed} of numbers"
        )
    if array.ndim != len(shape):
        raise PluginError(f"{where} has the shape {array.shape}, it needs {needed}")
    for length, size in zip(array.shape, shape, strict=True):
        if isinstance(size, str):
            name = where.rpartition(": ")[2]
            expected, words = sizes.setdefault(size, (length, f"the {size} of {name}"))
        else:
            expected, words = size, ""
        if length != expected:
            meaning = f"; {size} is {expected}, {words}" if words else ""
            raise PluginError(
                f"{where} has the shape {array.shape}, it needs {needed}{meaning}"
            )
    return array


def _sequence(where: str, name: str, value: Any, kind: type | None = None) -> Any:
    """Return a field that is a sequence, of objects of one class if that is said."""
    if isinstance(value, str) or not isinstance(value, Sequence | np.ndarray):
        raise PluginError(
            f"{where}: {name} is a {type(value).__name__}, it has to be a sequence"
        )
    for k, item in enumerate(value):
        if kind is not None and not isinstance(item, kind):
            raise PluginError(
                f"{where}: {name}[{k}] is a {type(item).__name__}, it has to be a "
                f"{kind.__name__}(...)"
            )
    return value


def _check_triangles(where: str, arrays: Facts) -> None:
    """Refuse triangles whose corners are no vertices."""
    triangles, count = arrays["triangles"], len(arrays["vertices"])
    if len(triangles) and triangles.dtype.kind not in "iu":
        raise PluginError(
            f"{where}: triangles holds {triangles.dtype} values, it has to "
            "hold the numbers of vertices"
        )
    wrong = triangles[(triangles < 0) | (triangles >= count)]
    if len(wrong):
        raise PluginError(
            f"{where}: triangles has the corner {wrong[0]}, but the vertices have the "
            f"numbers 0 to {count - 1}"
        )
