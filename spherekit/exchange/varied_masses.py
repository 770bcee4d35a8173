"""Masses as expressions of the numbers of a mechanism file.

A file may state inertia by axes of pairs, for example the inertia of a uniform arc between
two axes. Such inertia changes with the sizes of the links.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from spherekit.files.toml_document import Document
from spherekit.files.toml_lines import KeyPath
from spherekit.mechanism.inertia import Mass, shift_to_sphere_centre
from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, dot, function
from spherekit.symbolic.vector_algebra import Exprs, constants, cross, vector
from spherekit.velocities.axis_rotations import PairRotations
from spherekit.velocities.carried_vectors import root


class ArcInertia(NamedTuple):
    """Inertia tensor (3, 3) about the centre of the sphere, and centre of mass (3,)."""

    tensor: Exprs
    centre: Exprs


def express_masses(
    document: Document,
    mechanism: Mechanism,
    pair_rotations: PairRotations,
    expression_by_path: Mapping[KeyPath, Expr],
) -> tuple[Mass, ...]:
    """Return the masses of a mechanism as expressions of the numbers that can vary.

    With these masses, formulas of the dynamics follow changes of the design. A mass
    consists of an inertia tensor, and often an amount (kg) and a centre of mass. A mass
    becomes an expression if `expression_by_path` has an expression for one of its numbers.

    The file can also refer to axes of pairs (joints). The file can state a mass as a
    uniform arc between two axes, or a tensor in a frame of two axes. The mass then becomes
    an expression if the sizes of links change these axes. All other masses are returned
    unchanged.

    Parameters
    ----------
    document
        The mechanism file. Its table "mass" has the mass of each link.
    mechanism
        The mechanism of this file, or its equivalent linkage.
    pair_rotations
        The pairs as rotations between their links, with sizes of links as symbols. The axes
        of pairs in link axes follow from these rotations.
    expression_by_path
        Expressions that replace numbers of the document (SI units). A path is the list of
        keys that lead to a number.

    Returns
    -------
    The masses in their order in the mechanism.
    """
    table_by_link = document.data.get("mass", {})
    return tuple(
        _express_mass(
            table_by_link[mass.link], mass, mechanism, pair_rotations, expression_by_path
        )
        for mass in mechanism.masses
    )


def _express_mass(
    table: Mapping[str, Any],
    mass: Mass,
    mechanism: Mechanism,
    pair_rotations: PairRotations,
    expression_by_path: Mapping[KeyPath, Expr],
) -> Mass:
    """Return the mass of one link with expressions in place of numbers that vary.

    The mass of a link includes its inertia tensor, amount (kg) and centre of mass. The
    inertia tensor about the centre of the sphere is computed from expressions as the file
    reader computes it from numbers. The mass is returned unchanged if none of its numbers
    varies.

    Parameters
    ----------
    table
        Table of the mass in the file.
    mass
        The mass with its numbers.
    mechanism, pair_rotations, expression_by_path
        As in `express_masses`.
    """
    link = mechanism.link(mass.link)

    def read(key: str, *indices: int) -> Expr:
        """Return an element of the table: its expression, or its number."""
        value = table[key]
        for index in indices:
            value = value[index]
        path: KeyPath = ("mass", mass.link, key, *indices)
        return expression_by_path.get(path, float(value))

    def axis_in_link(pair_name: str) -> Exprs:
        """Return the unit axis (3,) of a pair in the axes of the link."""
        pair = mechanism.pair_number[pair_name]
        side = mechanism.ends[pair].index(link)
        return constants(pair_rotations.axes(pair)[side])

    # The file gives a uniform arc, or a tensor about the centre of the sphere ("tensor") or
    # of mass ("tensor_at_centre"), perhaps in the frame of two axes.
    kilograms: Any = read("mass") if "mass" in table else None
    tensor: Any
    centre: Any = None
    if "arc" in table:
        first_pair, second_pair = table["arc"]
        first_axis = axis_in_link(first_pair)
        second_axis = axis_in_link(second_pair)
        tensor, centre = arc_inertia(first_axis, second_axis, kilograms, read("radius"))
    else:
        tensor_key = "tensor" if "tensor" in table else "tensor_at_centre"
        rows = [[read(tensor_key, i, j) for j in range(3)] for i in range(3)]
        tensor = np.array(rows, object)
        if "centre" in table:
            centre = vector([read("centre", k) for k in range(3)])
        if tensor_key == "tensor_at_centre":
            tensor = shift_to_sphere_centre(tensor, kilograms, centre)
        if "frame" in table:
            # The numbers of the file are in the frame of two axes.
            first_pair, second_pair = table["frame"]
            first_axis = axis_in_link(first_pair)
            frame = _frame_of_axes(first_axis, axis_in_link(second_pair))
            tensor = frame @ tensor @ frame.T
            centre = None if centre is None else frame @ centre
    tensor = 0.5 * (tensor + tensor.T)
    elements = [*tensor.ravel(), kilograms, *([] if centre is None else centre)]
    if not any(isinstance(element, ExpressionNode) for element in elements):
        return mass
    tensor_rows: Any = tuple(map(tuple, tensor))
    centre_elements: Any = None if centre is None else tuple(centre)
    return replace(mass, tensor=tensor_rows, mass=kilograms, centre=centre_elements)


def arc_inertia(first: Exprs, second: Exprs, mass: Expr, radius: Expr) -> ArcInertia:
    """Return inertia tensor and centre of mass of a uniform arc, as expressions.

    The arc joins two axes of a link. Mass, radius and axes may be expressions of numbers
    that vary between designs. The tensor is about the centre of the sphere.

    Let L be the length of the arc (rad), and s = sin(L) / (2 L). The unit vector m is along
    the sum of the two axes, and the unit vector a along their difference. The mean of r r^T
    over all points r of the arc on the unit sphere is

        M = (1/2 + s) m m^T + (1/2 - s) a a^T.

    The tensor is mass radius^2 (I - M) with the identity matrix I. The centre of mass is
    m radius sin(L/2) / (L/2).

    Parameters
    ----------
    first, second
        Unit vectors (3,) of the two axes, in the axes of the link.
    mass
        Mass of the arc (kg).
    radius
        Distance of the arc from the centre of the sphere (m).
    """
    normal = cross(first, second)
    middle = first + second
    across = second - first
    length = function("atan2", root(dot(normal, normal)), dot(first, second))
    spread = function("sin", length) / (2.0 * length)
    middle_square = dot(middle, middle)  # `middle` and `across` are not unit vectors
    mean_square = np.outer(middle, middle) * ((0.5 + spread) / middle_square)
    mean_square = mean_square + np.outer(across, across) * (
        (0.5 - spread) / dot(across, across)
    )
    half_length = 0.5 * length
    tensor = (mass * radius * radius) * (np.eye(3).astype(object) - mean_square)
    centre = middle * (
        radius * function("sin", half_length) / (half_length * root(middle_square))
    )
    return ArcInertia(tensor, centre)


def _frame_of_axes(first: Exprs, second: Exprs) -> Exprs:
    """Return the frame (3, 3) of two axes, as `spherekit.mechanism.inertia.axes_frame`."""
    across = cross(second, first)
    x = across * (1.0 / root(dot(across, across)))
    return np.stack([x, cross(first, x), first], axis=1)
