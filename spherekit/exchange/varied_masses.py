"""Masses of a file as terms of its numbers: inertia that follows the sizes of links."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from spherekit.files.toml_document import Document
from spherekit.files.toml_lines import KeyPath
from spherekit.mechanism.inertia import Mass, shift_to_sphere_centre
from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, dot, function
from spherekit.symbolic.vector_algebra import Exprs, constants, cross, vector
from spherekit.velocities.axis_rotations import PairRotations
from spherekit.velocities.carried_vectors import root


def masses_in_terms(
    document: Document,
    mechanism: Mechanism,
    pairs: PairRotations,
    numbers: Mapping[KeyPath, Expr],
) -> tuple[Mass, ...]:
    """Return masses whose entries are terms where a file states them by what varies.

    `numbers` are the terms of numbers of the document (SI) by their paths, `pairs` those
    of the mechanism, sizes being terms.
    """
    of_file = document.data.get("mass", {})
    return tuple(
        _mass(of_file[mass.link], mass, mechanism, pairs, numbers)
        for mass in mechanism.masses
    )


def _mass(
    item: Mapping[str, Any],
    mass: Mass,
    mechanism: Mechanism,
    pairs: PairRotations,
    numbers: Mapping[KeyPath, Expr],
) -> Mass:
    path = ("mass", mass.link)

    def stated(key: str, *places: int) -> Expr:
        value = item[key]
        for place in places:
            value = value[place]
        return numbers.get((*path, key, *places), float(value))

    def axis(pair: str) -> Exprs:
        number = mechanism.pair_number[pair]
        ends = mechanism.ends[number]
        return constants(pairs.axes(number)[ends.index(mechanism.link(mass.link))])

    kilograms: Any = stated("mass") if "mass" in item else None
    tensor: Any
    centre: Any = None
    if "arc" in item:
        first, second = map(axis, item["arc"])
        tensor, centre = arc_inertia(first, second, kilograms, stated("radius"))
    else:
        key = "tensor" if "tensor" in item else "tensor_at_centre"
        tensor = np.array([[stated(key, i, j) for j in range(3)] for i in range(3)], object)
        if "centre" in item:
            centre = vector([stated("centre", k) for k in range(3)])
        if key == "tensor_at_centre":
            tensor = shift_to_sphere_centre(tensor, kilograms, centre)
        if "frame" in item:
            frame = _frame(*map(axis, item["frame"]))
            tensor = frame @ tensor @ frame.T
            centre = None if centre is None else frame @ centre
    tensor = 0.5 * (tensor + tensor.T)
    parts = [*tensor.ravel(), kilograms, *([] if centre is None else centre)]
    if not any(isinstance(part, ExpressionNode) for part in parts):
        return mass
    rows: Any = tuple(map(tuple, tensor))
    place: Any = None if centre is None else tuple(centre)
    return replace(mass, tensor=rows, mass=kilograms, centre=place)


def arc_inertia(
    first: Exprs, second: Exprs, mass: Expr, radius: Expr
) -> tuple[Exprs, Exprs]:
    """Return tensor (3, 3) about O and centre of mass (3,) of a uniform arc, as terms.

    They are those of `spherekit.mechanism.inertia.uniform_arc`, in its notation.
    """
    normal, middle, across = cross(first, second), first + second, second - first
    length = function("atan2", root(dot(normal, normal)), dot(first, second))
    spread = function("sin", length) / (2.0 * length)
    along = dot(middle, middle)
    taken = np.outer(middle, middle) * ((0.5 + spread) / along)
    taken = taken + np.outer(across, across) * ((0.5 - spread) / dot(across, across))
    half = 0.5 * length
    tensor = (mass * radius * radius) * (np.eye(3).astype(object) - taken)
    return tensor, middle * (radius * function("sin", half) / (half * root(along)))


def _frame(first: Exprs, second: Exprs) -> Exprs:
    """Return the frame (3, 3) of two axes, see `spherekit.mechanism.inertia.axes_frame`."""
    across = cross(second, first)
    x = across * (1.0 / root(dot(across, across)))
    return np.stack([x, cross(first, x), first], axis=1)
