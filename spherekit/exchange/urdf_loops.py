"""Loops of URDF files, in elements that the format itself does not define.

The joints of a URDF form a tree. Two ways to close loops are in use: `<loop_joint>` with
two links and the positions of the joint on them (Drake, Isaac Sim, and exporters that write
parent and child with origins), and `<loop>` with `<predecessor>` and `<successor>` (URDF+,
Chignoli et al. 2024).
"""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from spherekit.arrays import Floats
from spherekit.errors import FileError
from spherekit.wording import counted, listing

Element = ElementTree.Element

AXIS_LOOP_TYPES = ("revolute", "continuous")
"""Types of loop joints that have an axis."""

LOOP_TYPES = (*AXIS_LOOP_TYPES, "spherical", "ball", "fixed")
"""Types of loop joints that can be imported."""

END_TAGS = ("link1", "link2", "predecessor", "successor", "parent", "child")
"""Names of the elements that give the two links of a loop joint."""


def add_loop_joint(
    mujoco: Any, spec: Any, loop_joint: Element, path: Path
) -> dict[str, Floats]:
    """Add a loop joint of a URDF to a MuJoCo model, as a constraint.

    URDF joints form a tree. A loop joint is an extension that closes a loop between two
    links of the tree.

    A fixed joint becomes a weld of the two links. Any other joint holds one point of both
    links together.

    Parameters
    ----------
    mujoco
        The Python module `mujoco`, an optional dependency.
    spec
        The `MjSpec` of the model, which is changed.
    loop_joint
        The element of the joint, which has two links, with position and orientation of the
        joint on each.
    path
        The file, for messages.

    Returns
    -------
    The unit axis (3,) of the joint in the axes of its first link, by the name of the joint;
    empty if the joint has no axis.

    Raises
    ------
    FileError
        If the type is not one of `LOOP_TYPES`, there are not two links, or a link does not
        exist.
    ValueError
        If a vector is not given by numbers.
    """
    joint_type = loop_joint.get("type", "spherical")
    name = loop_joint.get("name", "loop")
    where = f"{path}: loop joint {name}"
    if joint_type not in LOOP_TYPES:
        raise FileError(
            f'{where}: found type "{joint_type}", allowed: {listing(LOOP_TYPES)}'
        )
    ends = [(tag, end) for tag in END_TAGS for end in loop_joint.findall(tag)]
    if len(ends) != 2:
        raise FileError(
            f"{where}: has {counted(len(ends), 'link')}, expected 2: link1 and link2, "
            "predecessor and successor, or parent and child with origins"
        )
    # Put a site (a point with a name) on each of the two links.
    axis_by_name: dict[str, Floats] = {}
    for end_index, (tag, end) in enumerate(ends):
        # Exporters write the position in one of three elements.
        origins = [end.find("origin"), loop_joint.find(f"{tag}_origin"), end]
        origin = next(element for element in origins if element is not None)
        link = end.get("link", "")
        body = spec.body(link)
        if body is None:
            raise FileError(f'{where}: no link "{link}"')
        body.add_site(name=f"{name}_{end_index}", pos=_read_vector(origin, "xyz"))
        if joint_type in AXIS_LOOP_TYPES and end_index == 0:
            axis_element = loop_joint.find("axis")
            if axis_element is None:
                axis = np.eye(3)[0]  # as for other joints of a URDF
            else:
                axis = _read_vector(axis_element, "xyz")
            rotation = Rotation.from_euler("xyz", _read_vector(origin, "rpy"))
            axis_by_name[name] = rotation.apply(axis) / np.linalg.norm(axis)
    # Add the constraint: a weld of the bodies, or the two sites held together.
    if joint_type == "fixed":
        first_name, second_name = (end.get("link", "") for _, end in ends)
        constraint_type = mujoco.mjtEq.mjEQ_WELD
        object_type = mujoco.mjtObj.mjOBJ_BODY
    else:
        first_name = f"{name}_0"
        second_name = f"{name}_1"
        constraint_type = mujoco.mjtEq.mjEQ_CONNECT
        object_type = mujoco.mjtObj.mjOBJ_SITE
    spec.add_equality(
        name=name,
        name1=first_name,
        name2=second_name,
        type=constraint_type,
        objtype=object_type,
    )
    return axis_by_name


def _read_vector(element: Element, attribute: str) -> Floats:
    """Return three numbers of an attribute; zeros if the element does not have it."""
    return np.array((element.get(attribute) or "0 0 0").split(), dtype=float)
