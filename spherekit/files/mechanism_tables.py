"""Builds a mechanism from Python data with the tables and keys of mechanism files."""

import numbers
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from spherekit.argument_validation import checked
from spherekit.errors import ModelError
from spherekit.files.mechanism_reader import read
from spherekit.files.schema import FORMAT
from spherekit.files.toml_document import Document, key_path_text
from spherekit.files.toml_lines import KeyPath
from spherekit.mechanism.mechanism import Mechanism
from spherekit.quantity import AngleUnit
from spherekit.wording import counted

Tables = Mapping[Any, Any]
"""Tables by name. Faults in them are reported with the path of the key."""

TablesOrNames = Tables | Sequence[str]
"""Tables by name, or only names."""


@checked(ModelError)
def build(
    name: str,
    *,
    angle_unit: AngleUnit,
    ground: str,
    links: TablesOrNames,
    pairs: Tables,
    inputs: TablesOrNames | str = (),
    outputs: Tables | None = None,
    mass: Tables | None = None,
    loads: Tables | None = None,
    joint_limits: Tables | None = None,
    modes: Tables | None = None,
    source: Tables | None = None,
    user: Tables | None = None,
    description: str | None = None,
) -> Mechanism:
    """Return a mechanism from data in code, in the tables and keys of mechanism files.

    Parameters
    ----------
    name
        Its name: letters, digits and underscores, as all names.
    angle_unit
        Unit of every angle given, ``"deg"`` or ``"rad"``.
    ground
        Name of the link that does not move.
    links
        By name, a table of each link. ``"axes"`` lists its R pairs. ``"arcs"`` lists the
        arcs from the first axis to each of the others. With three or more axes,
        ``"angles"`` lists the angles at the first axis, from the first arc to each other
        arc. If the pairs state their axes in a pose, a list of link names is sufficient.
    pairs
        By name. An R pair is a list of its two links, such as ``["base", "crank"]``, or a
        table with ``"links"``. In the table, ``"zero"`` is the angle between the links at
        which the variable is zero. Alternatively, ``"xyz"`` or ``"lonlat"`` is the axis in
        a reference pose. The variable is the rotation of the second link relative to the
        first. A contact has the ``"type"`` ``"Cr"`` (rolling) or ``"Cs"`` (sliding), and
        profiles, cones or gears.
    inputs
        Driven pairs: their names, or by name the first and the last value of the
        variable. By default the first R pair, through one turn.
    outputs, mass, loads, joint_limits, modes, source, user
        Tables by name, as in files.
    description
        What the mechanism is and what it is used for.

    Raises
    ------
    ModelError
        If the data have faults. The message has one line for each fault, which names the
        key.

    Notes
    -----
    All keys are in docs/reference.md. `dump` writes the mechanism to a file.

    Examples
    --------
    >>> import spherekit as sk
    >>> crank_rocker = sk.build(
    ...     "crank_rocker",
    ...     angle_unit="deg",
    ...     ground="base",
    ...     links={
    ...         "base": {"axes": ["drive", "hinge"], "arcs": [60]},
    ...         "crank": {"axes": ["drive", "tip"], "arcs": [20]},
    ...         "coupler": {"axes": ["tip", "joint"], "arcs": [70]},
    ...         "rocker": {"axes": ["hinge", "joint"], "arcs": [40]},
    ...     },
    ...     pairs={
    ...         "drive": ["base", "crank"],
    ...         "tip": ["crank", "coupler"],
    ...         "joint": ["coupler", "rocker"],
    ...         "hinge": ["base", "rocker"],
    ...     },
    ...     inputs={"drive": (0, 360)},
    ...     mass={"rocker": {"mass": 2.0, "arc": ["hinge", "joint"], "radius": 0.1}},
    ... )

    The same by the axes of all pairs in one pose:

    >>> posed = sk.build(
    ...     "posed",
    ...     angle_unit="deg",
    ...     ground="base",
    ...     links=["base", "crank", "coupler", "rocker"],
    ...     pairs={
    ...         "drive": {"links": ["base", "crank"], "xyz": [0, 0, 1]},
    ...         "tip": {"links": ["crank", "coupler"], "lonlat": [90, 70]},
    ...         "joint": {"links": ["coupler", "rocker"], "lonlat": [20, 15]},
    ...         "hinge": {"links": ["base", "rocker"], "lonlat": [70, 30]},
    ...     },
    ...     inputs={"drive": (-30, 30)},
    ... )
    """
    data: dict[str, Any] = {
        "format": FORMAT,
        "name": name,
        "angle_unit": angle_unit,
        "ground": ground,
        "links": links if isinstance(links, Mapping) else {link: {} for link in links},
        "pairs": {key: _pair_table(item) for key, item in pairs.items()},
        "inputs": _input_tables(name, inputs),
        "outputs": outputs,
        "mass": mass,
        "loads": loads,
        "joint_limits": joint_limits,
        "modes": modes,
        "source": source,
        "user": user,
        "description": description,
    }
    tables = {key: table for key, table in data.items() if table is not None}
    return read(Document(name, None, _to_file_types(name, (), tables)))


def _pair_table(item: Any) -> Any:
    """Return the table of a pair from a table or its two links; the default type is R."""
    return {"type": "R", **(item if isinstance(item, Mapping) else {"links": item})}


def _input_tables(name: str, inputs: TablesOrNames | str) -> Tables:
    """Return tables of the inputs (driven pairs), as a mechanism file has them.

    The keys are the names of the pairs. A table can state the range of the variable.

    Parameters
    ----------
    name
        Name of the mechanism, for messages.
    inputs
        The inputs as the user states them: the name of a pair, several names, or a mapping
        of names to tables. In place of a table there can be the two ends of the range of
        the variable.
    """
    if isinstance(inputs, str):
        return {inputs: {}}
    if not isinstance(inputs, Mapping):
        return {pair: {} for pair in inputs}
    tables = {}
    for pair, item in inputs.items():
        if isinstance(item, np.ndarray):
            item = item.tolist()  # a number if the array has no dimension
        if isinstance(item, Sequence) and not isinstance(item, str):
            if len(item) != 2:
                raise ModelError(
                    f"{name}: inputs.{pair}: has {counted(len(item), 'value')}, expected "
                    "2: the first and the last value of the pair variable"
                )
            tables[pair] = {"from": item[0], "to": item[1]}
        else:
            tables[pair] = item
    return tables


def _to_file_types(name: str, path: KeyPath, value: Any) -> Any:
    """Convert Python data to the types of a TOML file: dict, list, text and number.

    Arrays of NumPy become lists, and other numbers become floats.

    Parameters
    ----------
    name
        Name of the mechanism, for messages.
    path
        Keys and indices that lead to the value in the data, for messages.
    value
        The value.

    Raises
    ------
    ModelError
        If a key is not a text, or if a value cannot be converted. Values in the table
        "user" can have any type.
    """
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str):
                raise ModelError(
                    f"{name}: {key_path_text(path)}: the name {key!r} has the type "
                    f'{type(key).__name__}; names have to be strings, so write "{key}"'
                )
        return {
            key: _to_file_types(name, (*path, key), item) for key, item in value.items()
        }
    if isinstance(value, list | tuple):
        return [
            _to_file_types(name, (*path, index), item) for index, item in enumerate(value)
        ]
    if isinstance(value, bool | int | float | str) or path[:1] == ("user",):
        return value
    if isinstance(value, numbers.Real):
        return float(value)
    raise ModelError(
        f"{name}: {key_path_text(path)}: found {type(value).__name__}, expected text, a "
        "number, a list or a mapping"
    )
