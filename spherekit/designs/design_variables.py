"""Design variables: numbers of a mechanism file that are varied."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.errors import DesignError, SpherekitError
from spherekit.files.mechanism_reader import mechanism_from_document
from spherekit.files.number_change import number_at, number_path, with_numbers
from spherekit.files.schema import check_numbers
from spherekit.files.toml_document import Document
from spherekit.files.toml_lines import KeyPath
from spherekit.mechanism.elements import PoseGeometry, SizeGeometry
from spherekit.mechanism.load_kinds import LOADS, PairTorque
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE
from spherekit.mechanism.pose_sizes import pose_sizes
from spherekit.velocities.row_quantities import row_quantities
from spherekit.wording import listing

DESIGNED = ("links", "pairs", "outputs", "mass", "loads")
"""Tables of a mechanism file whose numbers can be varied."""

ACTIONS = ("mass", "loads")
"""The tables among these whose numbers have no influence on positions."""

POINTED = "pointed"
"""Kind of the geometric angles that are the longitude or latitude of an output."""

OK = "OK"
"""Status of a design that closes at a sample, and reason of a design that is possible."""


class StencilPoint(NamedTuple):
    """A point at which a function is evaluated for a difference quotient.

    The first derivative is approximately a sum over several such points, divided by the
    step. The sum adds the function values at the points, each times its weight.

    Attributes
    ----------
    offset
        Difference of the variable from the place of the derivative, in steps.
    weight
        Weight of the function value in the sum.
    """

    offset: float
    weight: float


Stencil = tuple[StencilPoint, ...]
"""The values of a difference quotient. The weights add up to zero.

The farthest value on a side is computed first. If it is not possible, the quotient fails
before the nearer values are computed.
"""

CENTRAL_STENCIL: Stencil = (
    StencilPoint(-4.0, 1.0 / 280.0),
    StencilPoint(-3.0, -4.0 / 105.0),
    StencilPoint(-2.0, 0.2),
    StencilPoint(-1.0, -0.8),
    StencilPoint(4.0, -1.0 / 280.0),
    StencilPoint(3.0, 4.0 / 105.0),
    StencilPoint(2.0, -0.2),
    StencilPoint(1.0, 0.8),
)
"""Central difference quotient of the eighth order."""

FORWARD_WEIGHTS = (
    8.0,
    -14.0,
    56.0 / 3.0,
    -17.5,
    11.2,
    -14.0 / 3.0,
    8.0 / 7.0,
    -0.125,
)
"""Weights of the forward difference quotient of the eighth order, at 1 to 8 steps."""

FORWARD_STENCIL: Stencil = (
    StencilPoint(8.0, FORWARD_WEIGHTS[7]),
    StencilPoint(7.0, FORWARD_WEIGHTS[6]),
    StencilPoint(6.0, FORWARD_WEIGHTS[5]),
    StencilPoint(5.0, FORWARD_WEIGHTS[4]),
    StencilPoint(4.0, FORWARD_WEIGHTS[3]),
    StencilPoint(3.0, FORWARD_WEIGHTS[2]),
    StencilPoint(2.0, FORWARD_WEIGHTS[1]),
    StencilPoint(1.0, FORWARD_WEIGHTS[0]),
    StencilPoint(0.0, -float(np.sum(FORWARD_WEIGHTS))),
)
"""Forward difference quotient of the eighth order."""

BACKWARD_STENCIL: Stencil = tuple(
    StencilPoint(-point.offset, -point.weight) for point in FORWARD_STENCIL
)
"""Backward difference quotient of the eighth order."""

_DIRECTION_KEYS_OF_POSES = frozenset({"xyz", "lonlat", "through_xyz", "through_lonlat"})
"""Keys of pairs with an axis in a file that states a reference pose."""

_FILE_LOCATION = re.compile(r"^[^\s:]+\.toml(?::\d+)?: ", re.MULTILINE)
"""The name of a file, and perhaps a line number, at the beginning of an error message."""


class GeometricAngle(NamedTuple):
    """An angle by which a mechanism file describes the geometry of a link, pair or output.

    Functions that compute many designs at once (kernels) take these angles as arguments.

    Attributes
    ----------
    kind
        Which angle it is:

        - "arcs": the length of an arc on a link. All arcs of a link begin at its first pair
          (joint) axis, and each ends at another pair axis.
        - "angles": the angle at the first pair axis of a link, between its first arc and
          another arc.
        - "zeros": the angle at a pair from the first arc of one link to the first arc of
          the other link, in the position in which the variable of the pair is zero.
        - "values": the variable of a pair in a reference pose (known configuration).
        - "longitudes" and "latitudes": the longitude or the latitude of a pair axis in a
          reference pose.
        - `POINTED`: longitude or latitude of a direction of an output.
    owner
        To what the angle belongs:

        - For "arcs": the link and the pair at which the arc ends. An example is ``("2",
          "32")``.
        - For "angles": the link and the pair at which the other arc ends.
        - For `POINTED`: the output, and 0 (longitude) or 1 (latitude).
        - Otherwise the name of the pair.
    """

    kind: str
    owner: Any


@dataclass(frozen=True)
class DesignVariable:
    """A number of a mechanism file that is varied from design to design.

    Attributes
    ----------
    key
        The key of the number as users write it. An example is ``"links.2.arc"``.
    path
        Location of the number in the file: a table and keys in it, such as
        ``("pairs", "41", "zero")``.
    value
        The value in the file, in the unit of the file.
    geometric_angle
        The angle of a link, pair (joint) or output that the number states. None for all
        other numbers, such as angles of loads and contact profiles.
    """

    key: str
    path: KeyPath
    value: float
    geometric_angle: GeometricAngle | None

    @property
    def is_angle(self) -> bool:
        """Whether the number is an angle of a link, pair or output."""
        return self.geometric_angle is not None

    @property
    def name(self) -> str:
        """Name of the number in tables and expressions, such as ``links_2_arc``."""
        return self.key.replace(".", "_").replace("-", "_")


def design_variable(document: Document, key: str) -> DesignVariable:
    """Return the number of a mechanism file that a key names, to be varied in designs.

    Parameters
    ----------
    document
        The mechanism file.
    key
        Key of a number in it, such as ``"links.2.arc"``.

    Returns
    -------
    The variable, with its value in the file.

    Raises
    ------
    FileError
        If the file has no such number.
    DesignError
        If the number is not one that can be varied.
    """
    path = number_path(document, key)
    if path[0] not in DESIGNED:
        raise DesignError(
            f"{document.name}: {key} cannot be varied: samples, ranges and joint limits "
            "are the same for all designs; vary numbers in the sections "
            f"{listing(DESIGNED)}"
        )
    _check_form_of_geometry(document, key, path)
    # If the number is an angle of a link, pair or output, it is stored as such. Functions
    # that compute many designs at once take these angles as arguments.
    geometric_angle = _find_geometric_angle(document, path)
    return DesignVariable(
        key=key,
        path=path,
        value=number_at(document, path),
        geometric_angle=geometric_angle,
    )


def _check_form_of_geometry(document: Document, key: str, path: KeyPath) -> None:
    """Raise `DesignError` if a number does not belong to the file's form of geometry.

    A file states its geometry in one of two forms: dimensions of links, or a reference pose
    (the axes of the pairs in one configuration). The number ``zero`` of a pair belongs to
    dimensions, and ``value`` to a reference pose. Both default to 0. A key can also name a
    number that the file leaves out. Therefore the key of the wrong number is found, too.
    """
    match path:
        case ("pairs", _, "zero" | "value" as number):
            has_pose = any(
                not _DIRECTION_KEYS_OF_POSES.isdisjoint(pair)
                for pair in document.data["pairs"].values()
            )
            if has_pose != (number == "value"):
                form, other = "dimensions of links", "zero"
                if has_pose:
                    form, other = "a reference pose", "value"
                raise DesignError(
                    f"{document.name}: {key} cannot be varied, because the file states "
                    f"{form}; vary {key.removesuffix(number)}{other} instead"
                )


def _find_geometric_angle(document: Document, path: KeyPath) -> GeometricAngle | None:
    """Return which angle of a link, pair (joint) or output a number in a file states.

    The angle is stored with the design variable (a number that differs between designs).
    Functions that compute many designs at once take it as an argument.

    A file states the sizes of the links, or a reference pose (a known configuration). With
    sizes, "zero" of a pair is the angle between its links when its variable is zero. With a
    reference pose, "value" is the variable of the pair in this pose. The key "lonlat" has
    the longitude and latitude of a pair axis in this pose, or of the direction of an
    output.

    Parameters
    ----------
    document
        The mechanism file.
    path
        Location of the number in it: the table, then keys, such as
        ``("pairs", "41", "zero")``.

    Returns
    -------
    The angle, or None if the number is not an angle of this kind.
    """
    match path:
        case ("links", str(link), "arcs" | "angles" as kind, int(k)):
            # The axes of a link are numbered from 0, and all its arcs start at axis 0.
            # Arc k ends at axis k + 1. Angle k leads from arc 0 to arc k + 1, which ends at
            # axis k + 2.
            axes = document.data["links"][link]["axes"]
            end = k + 1 if kind == "arcs" else k + 2
            return GeometricAngle(kind, (link, axes[end]))
        case ("pairs", str(pair), "zero" | "value" as kind):
            return GeometricAngle(f"{kind}s", pair)
        case ("pairs", str(pair), "lonlat", int(k)):
            return GeometricAngle(("longitudes", "latitudes")[k], pair)
        case ("outputs", str(output), "lonlat", int(k)):
            # Longitude and latitude of an output have the same kind. The index k, 0 or 1,
            # tells them apart.
            return GeometricAngle(POINTED, (output, k))
    return None


def is_angle_of_load(document: Document, key: str) -> bool:
    """Return whether a number of a load is an angle, or an angle per second."""
    table, name, *rest = number_path(document, key)
    if table != "loads" or len(rest) != 1:
        return False
    load_kind = LOADS[document.data["loads"][name].get("kind", PairTorque.kind)]
    return load_kind.field_kinds.get(str(rest[0])) in ("angle", "rate")


def make_design(
    document: Document, variables: Sequence[DesignVariable], values: Iterable[float]
) -> Mechanism:
    """Return the mechanism of a design: a file with some numbers replaced.

    Parameters
    ----------
    document
        The mechanism file, whose form is correct already. Only the new values are checked.
    variables
        The numbers that are varied.
    values
        (variables,) their values, in the units of the file.

    Raises
    ------
    FileError, ModelError
        If a mechanism with these values is impossible.
    """
    value_by_path = dict(zip([v.path for v in variables], map(float, values), strict=True))
    changed_document = with_numbers(document, value_by_path)
    check_numbers(changed_document, value_by_path)
    return mechanism_from_document(changed_document)


def check_variables(document: Document, variables: Sequence[DesignVariable]) -> None:
    """Raise `DesignError` if two variables are the same number of the file."""
    key_by_path: dict[KeyPath, str] = {}
    for variable in variables:
        if variable.path in key_by_path:
            raise DesignError(
                f"{document.name}: {variable.key} and {key_by_path[variable.path]} are two "
                "keys of the same number in the file; leave out one of them"
            )
        key_by_path[variable.path] = variable.key


def link_sizes(mechanism: Mechanism) -> dict[str, DesignVariable]:
    """Return the sizes of links as design variables, if the file has a reference pose.

    A file states either the sizes of links, or the axes of all pairs (joints) in a
    reference pose. In the second case this function derives the sizes. The caller can then
    take derivatives with respect to them. An arc is the angle between the first axis of a
    link and another axis of the link. An angle says how far the plane of another arc is
    turned from the plane of the first arc.

    The result has the sizes by their keys, such as ``links.2.arc``. The result is empty if
    the file has sizes, or if there are contacts (pairs in which two links touch along
    curves).
    """
    has_reference_pose = isinstance(mechanism.geometry, PoseGeometry)
    if not has_reference_pose or mechanism.has_contacts:
        return {}
    variables = {}
    for link in mechanism.links:
        # A size has a kind ("arcs" or "angles"), the pair to whose axis it leads, a value
        # (rad), and derivatives.
        sizes = pose_sizes(mechanism, link)
        kinds = [kind for kind, *_ in sizes]
        for kind, pair, value, _derivatives in sizes:
            # If a link has a single arc, its size key is "arc". Each of several arcs has
            # the size key "arcs.PAIR". Angles have the keys "angle" and "angles.PAIR".
            size_key = kind[:-1] if kinds.count(kind) == 1 else f"{kind}.{pair}"
            key = f"links.{link}.{size_key}"
            # The path of a design variable says where its number is in the file: the name
            # of a table, then keys in this table. The file has no number for a derived
            # size, so a path is invented, a different one for each size.
            path = ("links", link, kind, pair)
            geometric_angle = GeometricAngle(kind, (link, pair))
            variables[key] = DesignVariable(key, path, value, geometric_angle)
    return variables


def default_size_keys(mechanism: Mechanism) -> Names:
    """Return the keys of the sizes that vary by default, such as ``"links.2.arc"``.

    These sizes get sliders on a page, and derivatives with respect to them are computed. A
    mechanism file describes its links in one of two ways:

    - By arcs between pair axes and angles between arcs. All of them vary, except those of
      coaxial links. In a coaxial link the first axis coincides with another axis: the arc
      between them is 0 or 180 degrees. With other sizes these axes would not coincide.
    - By the pair axes in a reference pose. The longitudes and latitudes of all axes vary.
    """
    geometry = mechanism.geometry
    if isinstance(geometry, SizeGeometry):
        return _arc_and_angle_keys(geometry)
    # The file gives the axes in a reference pose.
    keys = []
    for pair in mechanism.pairs:
        if pair.kind.has_axis:
            keys += [f"pairs.{pair.name}.longitude", f"pairs.{pair.name}.latitude"]
    return tuple(keys)


def _arc_and_angle_keys(geometry: SizeGeometry) -> Names:
    """Return the keys of the arcs and angles of links that vary by default.

    A link with one arc has the key ``links.LINK.arc``. A link with several arcs has a key
    ``links.LINK.arcs.PAIR`` for each of them. The keys of angles have the same form.
    `coaxial_links` are left out. Two axes of such a link coincide, which they would not do
    with another arc.
    """
    keys = []
    coaxial = coaxial_links(geometry)
    for link, sizes in geometry.links.items():
        if link in coaxial:
            continue
        # Each axis after the first has an arc. Each axis after the second has an angle.
        for kind, axes in (("arc", sizes.axes[1:]), ("angle", sizes.axes[2:])):
            for pair in axes:
                size_key = f"{kind}s.{pair}" if len(axes) > 1 else kind
                keys.append(f"links.{link}.{size_key}")
    return tuple(keys)


def coaxial_links(geometry: SizeGeometry) -> Names:
    """Return the links whose first axis coincides with another (arc 0 or 180 degrees)."""
    return tuple(
        link
        for link, sizes in geometry.links.items()
        if any(abs(np.sin(arc)) <= COLLINEAR_SINE for arc in sizes.arcs)
    )


def default_quantities(mechanism: Mechanism) -> Names:
    """Return the quantities for which sensitivities are computed by default.

    A sensitivity is the derivative of a quantity with respect to a number of the mechanism
    file, such as the arc of a link. The result is the first of these lists that is not
    empty:

    1. the angles of passive (not driven) revolute pairs that join the two links of an
       output: its link and the link from which its motion is seen,
    2. the angles of all passive revolute pairs,
    3. the velocity coefficients of the outputs (angular velocity per rate of the input).
    """
    driven = mechanism.input_pairs
    # The two links of each output, in any order.
    output_links = {
        frozenset((output.link, output.relative_to)) for output in mechanism.outputs
    }
    passive_pairs = [
        pair for pair in mechanism.pairs if pair.kind.has_axis and pair.name not in driven
    ]
    output_pairs = [pair for pair in passive_pairs if frozenset(pair.links) in output_links]
    chosen_pairs = output_pairs or passive_pairs
    if chosen_pairs:
        return tuple(f"theta_{pair.name}" for pair in chosen_pairs)

    coefficients = [
        f"velocity_coefficient_{output.link}_{output.relative_to}"
        for output in mechanism.outputs
    ]

    # With several inputs there is one coefficient for each, with the suffix "_by_INPUT".
    def is_of_output(name: str) -> bool:
        return any(
            name == coefficient or name.startswith(f"{coefficient}_by_")
            for coefficient in coefficients
        )

    return tuple(name for name in row_quantities(mechanism) if is_of_output(name))


def differentiate_by_variable(
    read_numbers: Callable[[Floats], Floats], values: Floats, k: int, steps: Floats
) -> Floats | None:
    """Return derivatives of numbers with respect to a variable, by difference quotients.

    The quotients are exact for polynomials up to the eighth degree. With each step the
    central quotient is tried first. Forward and backward quotients follow, because a
    variable may be at the limit of its possible values.

    Parameters
    ----------
    read_numbers
        Function of values (variables,) that returns the numbers (n,).
    values
        (variables,) values at which the derivatives are computed.
    k
        Index of the variable.
    steps
        Steps of the variable, in the order in which they are tried. A quotient fails if
        `read_numbers` raises a `SpherekitError` at one of its values.

    Returns
    -------
    (n,) derivatives from the first quotient that does not fail, or None if all fail.
    """
    for step in steps:
        for stencil in (CENTRAL_STENCIL, FORWARD_STENCIL, BACKWARD_STENCIL):
            derivatives = _difference_quotient(read_numbers, values, k, step, stencil)
            if derivatives is not None:
                return derivatives
    return None


def _difference_quotient(
    read_numbers: Callable[[Floats], Floats],
    values: Floats,
    k: int,
    step: float,
    stencil: Stencil,
) -> Floats | None:
    """Return one difference quotient of numbers for a variable, or None if it fails.

    It is a weighted sum of the numbers at several values of the variable, divided by the
    step.

    Parameters
    ----------
    read_numbers
        Function of values (variables,) that returns the numbers (n,).
    values
        (variables,) values at which the quotient is computed.
    k
        Index of the variable.
    step
        Step of the variable.
    stencil
        The values at which the numbers are read, as multiples of the step, and their
        weights.

    Returns
    -------
    (n,) quotients, or None if `read_numbers` raises a `SpherekitError` at a value.
    """
    total = np.zeros(())
    for point in stencil:
        changed_values = values.copy()
        changed_values[k] += step * point.offset
        try:
            numbers = read_numbers(changed_values)
        except SpherekitError:
            return None
        total = total + point.weight * numbers
    return total / step


def reason_of(problem: SpherekitError) -> str:
    """Return the message of an error in one line, without the name of the file."""
    return " ".join(_FILE_LOCATION.sub("", str(problem)).split())
