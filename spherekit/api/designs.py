"""Synthesis of sizes from a synthesis file."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from spherekit.api.sweep import sweep_of
from spherekit.argument_validation import checked
from spherekit.conventions import AnyPath
from spherekit.designs.design_space import DesignSpace, Variation, range_variation
from spherekit.designs.synthesis import Synthesis, synthesize_dimensions
from spherekit.designs.synthesis_requirements import Specification
from spherekit.errors import DesignError
from spherekit.files.library import named_in
from spherekit.files.mechanism_reader import angle_unit_of
from spherekit.files.schema import check
from spherekit.files.toml_document import Document, parse, read_text
from spherekit.files.toml_lines import KeyPath
from spherekit.geometry.rotation import from_quaternion
from spherekit.geometry.tilt_torsion import from_tilt_torsion, pointing
from spherekit.mechanism.sizes import to_radians
from spherekit.quantity import ANGLE, AngleUnit, QuantityError, read_quantity
from spherekit.wording import counted

DEFAULT_SAMPLES_OF_DESIGN = 181
"""Number of samples along the input at which each design is evaluated."""

DEFAULT_DESIGNS = 16384
"""Number of designs of the first, coarse search."""


@checked(DesignError)
def synthesize(
    path: AnyPath,
    *,
    designs: int = DEFAULT_DESIGNS,
    starts: int = 12,
    seed: int = 0,
) -> Synthesis:
    """Find sizes of links by which a mechanism meets the requirements of a synthesis file.

    The designs of the result are sorted by the first objective, the best first. A design is
    one choice of the sizes. A figure (of merit) is one number that rates a design, for
    example the largest torque.

    Parameters
    ----------
    path
        A synthesis file: a mechanism, the sizes that vary, figures, precision points, an
        objective and conditions.
    designs, seed
        Number and random seed of the designs that are evaluated first. They are points of a
        scrambled Sobol sequence, which fills the ranges of the sizes evenly.
    starts
        Number of the best designs from which a local search minimises the objective. With
        several objectives, each assembly mode (way to assemble the mechanism) has a Pareto
        front: the designs for which no other design is better in all objectives. Local
        searches then improve up to ``5 * starts`` designs of the front of each mode.

    Raises
    ------
    FileError
        If the file has faults. The message has one line for each fault.
    DesignError
        If an objective or a condition has a name that is neither a figure nor a size that
        varies, or if no design meets the conditions.

    Examples
    --------
    >>> from pathlib import Path
    >>> import spherekit as sk
    >>> wanted = '''
    ... format = 1
    ... mechanism = "four_bar"
    ... minimise = "peak"
    ... vary = {"links.2.arc" = [15, 30], "links.4.arc" = [30, 60]}
    ... figures = {peak = "max(abs(torque))"}
    ... '''
    >>> _ = Path("wanted.toml").write_text(wanted)
    >>> sk.synthesize("wanted.toml", designs=64, starts=1).mechanism().name
    'four_bar'
    """
    return synthesize_dimensions(specification_of(path, designs, seed), starts)


def specification_of(
    path: AnyPath, designs: int = DEFAULT_DESIGNS, seed: int = 0
) -> Specification:
    """Read a synthesis file and return its designs, objectives and conditions.

    A synthesis searches for sizes of links that meet the requirements of such a file. A
    design is one choice of the sizes.

    Parameters
    ----------
    path
        The synthesis file.
    designs, seed
        Number and random seed of the designs that the first, coarse search evaluates.

    Raises
    ------
    FileError
        If the file has faults. The message has one line for each fault.
    """
    # Read the sizes that vary, the mechanism, and the figures of merit (numbers that rate a
    # design). A figure of merit is a text such as "peak=max(abs(torque))".
    document = parse(read_text(Path(path)), str(path))
    check(document, "synthesis")
    data = document.data
    figures = [f"{name}={text}" for name, text in data.get("figures", {}).items()]
    # The name of a shipped mechanism, or a path relative to the folder of this file.
    name_or_path = named_in(data["mechanism"], Path(path).parent)
    angle_unit = angle_unit_of(name_or_path)
    # `ends` are the least and the greatest value of a size.
    variations = [
        _range_of(document, key, ends, angle_unit) for key, ends in data["vary"].items()
    ]
    # Precision points are desired values at given inputs. The deviation from each of these
    # values is a figure of merit, too: `deviation_figures` has its text by name.
    deviation_figures, point_count = _precision_point_deviations(document, angle_unit)
    # A sweep evaluates the figures of many designs. The designs of this sweep are a Sobol
    # sequence (points spread evenly over all ranges).
    sweep = sweep_of(
        name_or_path,
        DesignSpace.from_variations(variations, designs, "sobol", seed),
        [*figures, *deviation_figures.values()],
        samples=data.get("samples", DEFAULT_SAMPLES_OF_DESIGN),
    )
    # The conditions that a design has to meet, such as "peak < 3".
    sweep = replace(sweep, where=tuple(data.get("where", ())))
    # The objectives: one text or a list of texts, with figures that are to be minimised.
    minimise = data["minimise"]
    objectives = (minimise,) if isinstance(minimise, str) else tuple(minimise)
    return Specification(sweep, objectives, tuple(deviation_figures), point_count)


def _range_of(
    document: Document, key: str, ends: Sequence[float | str], angle_unit: AngleUnit
) -> Variation:
    """Return the range in which a number of the mechanism varies during a synthesis.

    A synthesis is a search for good designs. The ends of the range are converted to the
    unit of angles of the mechanism file.

    Parameters
    ----------
    document
        The synthesis file, for messages.
    key
        Key of the number in the mechanism file, such as ``links.2.arc``.
    ends
        The least and the greatest value. A text has a unit of angles, such as ``"30 deg"``.
        A number is in the unit of the mechanism file.
    angle_unit
        Unit of angles in the mechanism file.
    """
    low_and_high: list[float] = []
    has_angle_unit = False
    for index, end in enumerate(ends):
        if not isinstance(end, str):
            low_and_high.append(float(end))
            continue
        has_angle_unit = True
        try:
            angle = read_quantity(end, ANGLE, angle_unit, target=angle_unit)
        except QuantityError as problem:
            # The message names the place of the end in the synthesis file.
            raise document.fault(("vary", key, index), str(problem)) from None
        low_and_high.append(float(angle))
    low, high = low_and_high
    # If a unit of angles is written, the number must be an angle. This is checked later.
    return range_variation(key, low, high, has_angle_unit=has_angle_unit)


def _precision_point_deviations(
    document: Document, angle_unit: AngleUnit
) -> tuple[dict[str, str], int]:
    """Return figures of merit for the deviations from the precision points of a file.

    A precision point is a desired value of a quantity at certain inputs, such as an angle
    or a direction of an output. A figure of merit is a number that rates a design. It is
    stated as a text such as "missed_1=at(rate_41 - (0.5), 0.3)": its name, the deviation of
    rate_41 from 0.5, and the input 0.3 at which it is evaluated.

    Parameters
    ----------
    document
        The synthesis file. It has one table ``match`` or a list of such tables. Each table
        has a quantity, its inputs and its desired values.
    angle_unit
        Unit of angles of the mechanism file. Inputs and desired angles without a unit are
        in this unit.

    Returns
    -------
    Texts of figures of merit by name, ``missed_1`` and so on, and the number of precision
    points. A precision point has as many deviations as the quantity has components.
    """
    match = document.data.get("match", [])
    is_list = isinstance(match, list)
    figures: dict[str, str] = {}
    point_count = 0
    for index, table in enumerate(match if is_list else [match]):
        path: KeyPath = ("match", index, "values") if is_list else ("match", "values")
        inputs = table["at"]
        inputs_path = (*path[:-1], "at")
        values = table["values"]
        if len(inputs) != len(values):
            raise document.fault(
                path,
                f"has {counted(len(values), 'value')} for {counted(len(inputs), 'input')}; "
                "give one value for each input",
            )
        point_count += len(inputs)
        for input_values, value in zip(inputs, values, strict=True):
            if isinstance(input_values, list):
                input_list = input_values
            else:
                input_list = [input_values]
            for number in input_list:
                # Only checks the number: a wrong unit raises an error with its line.
                _angle_of(document, inputs_path, number, angle_unit)
            inputs_text = ", ".join(
                number if isinstance(number, str) else repr(float(number))
                for number in input_list
            )
            for deviation in _deviations(
                document, path, table["quantity"], value, angle_unit
            ):
                name = f"missed_{len(figures) + 1}"
                figures[name] = f"{name}=at({deviation}, {inputs_text})"
    return figures, point_count


def _angle_of(
    document: Document, path: KeyPath, number: float | str, angle_unit: AngleUnit
) -> float:
    """Return an angle of a synthesis file in rad, or raise an error with its line."""
    try:
        angle = read_quantity(number, ANGLE, angle_unit)
    except QuantityError as problem:
        raise document.fault(path, str(problem)) from None
    if not isfinite(angle):
        raise document.fault(path, f'found "{number}", expected a finite number')
    return angle


def _deviations(
    document: Document, path: KeyPath, quantity: str, value: Any, angle_unit: AngleUnit
) -> list[str]:
    """Return expressions for the deviation of a quantity from a value, in the file's unit.

    A synthesis chooses sizes so that these deviations become small. A number has one
    expression, and a vector or matrix has one for each component.

    The root of the sum of their squares is minimised. For a direction or an orientation
    this root is the angle between quantity and value, if this angle is small.

    Parameters
    ----------
    document, path
        The file and the path of the value, for messages.
    quantity
        Name of the quantity: a number, a direction or an orientation.
    value
        A number, a direction (3 components or azimuth and tilt), or an orientation (4
        components of a quaternion, or azimuth, tilt and torsion). Angles are in the unit of
        the file. A number that is no angle, such as a velocity coefficient, has no unit.
    angle_unit
        Unit of angles of the mechanism file, in which angles without a unit are.
    """
    unit = to_radians(1.0, angle_unit)
    if not isinstance(value, list):
        is_angle = quantity.startswith(("theta_", "transmission_angle_"))
        if not is_angle and isinstance(value, str):
            raise document.fault(
                path, f'found "{value}", but {quantity} is not an angle; leave the unit out'
            )
        if not is_angle:
            return [f"{quantity} - ({value!r})"]
        # An angle is compared modulo whole turns.
        angle = _angle_of(document, path, value, angle_unit)
        difference = f"{quantity} - ({angle!r})"
        return [f"{1.0 / unit!r}*atan2(sin({difference}), cos({difference}))"]
    if quantity.startswith("angular_velocity_"):
        raise document.fault(
            path,
            f"{value}: {quantity} is neither a direction nor an orientation; "
            "give its components one by one",
        )
    is_orientation = quantity.startswith("orientation_")
    angle_count = 3 if is_orientation else 2
    has_components = len(value) == angle_count + 1
    if has_components and any(isinstance(number, str) for number in value):
        raise document.fault(path, f"{value}: the components of {quantity} have no unit")
    # Components as they are written, angles in rad.
    numbers = np.array(
        value
        if has_components
        else [_angle_of(document, path, number, angle_unit) for number in value],
        dtype=float,
    )
    is_zero = has_components and not np.any(numbers)
    if len(numbers) not in (angle_count, angle_count + 1) or is_zero:
        allowed = "x, y, z, or azimuth and tilt"
        if is_orientation:
            allowed = "azimuth, tilt and torsion, or qx, qy, qz, qw"
        raise document.fault(path, f"{value} is not a value of {quantity}; give {allowed}")
    if has_components:
        numbers = numbers / np.linalg.norm(numbers)
        target = from_quaternion(numbers) if is_orientation else numbers
    else:
        from_angles = from_tilt_torsion if is_orientation else pointing
        target = from_angles(numbers[None])[0]
    # The length of the difference of two unit vectors at a small angle is that angle (rad).
    # For two rotation matrices the Frobenius norm is sqrt(2) times the angle. The target is
    # a vector (1 axis) or a matrix (2 axes), so the difference is divided by the root of
    # the number of array axes.
    factor = 1.0 / (unit * np.sqrt(target.ndim))
    # Names of the components: x, y, z of a vector; xx, xy, ..., zz of a matrix.
    components = ["".join(axes) for axes in product("xyz", repeat=target.ndim)]
    return [
        f"{float(factor)!r}*({quantity}_{component} - ({float(number)!r}))"
        for component, number in zip(components, target.ravel(), strict=True)
    ]
