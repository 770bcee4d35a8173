"""Removal of parts of an MJCF model that an import does not need or cannot read.

A mechanism does not depend on appearance, so files of meshes and textures may be missing. A
ball joint becomes three hinges, since the import reads joints of one variable.
"""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from spherekit.exchange.identifiers import unique_names
from spherekit.exchange.mujoco_loops import element_name


def drop_missing_files(mujoco: Any, spec: Any, folder: Path) -> list[str]:
    """Delete everything that a model reads from files that are missing.

    MuJoCo refuses models that refer to missing files.

    Textures become plain colours. Skins, height fields, meshes and the shapes (geoms) of
    bodies that use them are deleted, and so are contacts and sensors of these shapes.

    Parameters
    ----------
    mujoco
        The Python module `mujoco`, an optional dependency.
    spec
        The `MjSpec` (the model before it is compiled), which is changed.
    folder
        The folder of the model's file, from which paths are relative.

    Returns
    -------
    A sentence for each shape whose mass is lost, if it counts for the mass of a body.
    """

    def is_missing(file: str, subfolder: str) -> bool:
        """Return whether a file is named in the model and does not exist."""
        name = Path(file).name if spec.strippath else file
        return bool(file) and not (folder / subfolder / name).is_file()

    for texture in spec.textures:
        files = [texture.file, *texture.cubefiles]
        if any(is_missing(file, spec.texturedir) for file in files):
            texture.file = ""
            for side in range(len(texture.cubefiles)):
                texture.cubefiles[side] = ""
            texture.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
            texture.width = texture.height = 1
    for skin in [*spec.skins]:
        if is_missing(skin.file, spec.meshdir):
            spec.delete(skin)

    # Shapes refer to meshes and height fields by name; an unnamed element has the name of
    # its file.
    missing_fields = [x for x in spec.hfields if is_missing(x.file, spec.meshdir)]
    missing_meshes = [x for x in spec.meshes if is_missing(x.file, spec.meshdir)]
    files_by_mesh = {
        mesh.name or Path(mesh.file).stem: mesh.file for mesh in missing_meshes
    }
    fields = {field.name or Path(field.file).stem for field in missing_fields}
    always_from_shapes = (
        spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    )
    first_group, last_group = spec.compiler.inertiagrouprange
    deleted_shapes: set[str] = set()
    notes: list[str] = []
    for number, body in enumerate(spec.bodies):
        for geom in [*body.geoms]:
            if geom.hfieldname not in fields and geom.meshname not in files_by_mesh:
                continue
            # A shape without mass, or of the world, adds no inertia.
            has_inertia = geom.mass != 0.0 and geom.density != 0.0
            is_counted = always_from_shapes or not body.explicitinertial
            is_counted = is_counted and first_group <= geom.group <= last_group
            is_mesh = geom.meshname in files_by_mesh
            if is_mesh and has_inertia and is_counted and body.name != "world":
                notes.append(
                    f"the mass of body {element_name(body, 'body', number)} lacks that of "
                    f"mesh {geom.meshname}, since its file {files_by_mesh[geom.meshname]} "
                    "is missing"
                )
            deleted_shapes.add(geom.name)
            spec.delete(geom)
    for pair in [*spec.pairs]:
        if not deleted_shapes.isdisjoint((pair.geomname1, pair.geomname2)):
            spec.delete(pair)
    _delete_sensors(spec, mujoco.mjtObj.mjOBJ_GEOM, deleted_shapes)
    for item in [*missing_meshes, *missing_fields]:
        spec.delete(item)
    return notes


def _delete_sensors(spec: Any, object_type: Any, names: Collection[str]) -> None:
    """Delete all sensors that read objects of one type with some names."""
    for sensor in [*spec.sensors]:
        objects = (sensor.objtype, sensor.objname), (sensor.reftype, sensor.refname)
        if any(kind == object_type and name in names for kind, name in objects):
            spec.delete(sensor)


def replace_ball_joints(
    mujoco: Any, spec: Any
) -> tuple[Mapping[str, list[str]], list[str]]:
    """Replace each ball joint by three hinges at right angles.

    The import reads only joints with one variable, and three hinges allow the same motion.

    Actuators and sensors of ball joints are deleted, sensors of these actuators, and all
    key frames (stored poses).

    Parameters
    ----------
    mujoco
        The Python module `mujoco`, an optional dependency.
    spec
        The `MjSpec` (the model before it is compiled), which is changed.

    Returns
    -------
    hinges
        Names of the hinges about x, y and z of the body, by ball joint.
    notes
        What ball joints had and hinges do not have: limits, springs, dampers, actuators.
    """
    hinges: dict[str, list[str]] = {}
    notes: list[str] = []
    balls = [x for x in spec.joints if x.type == mujoco.mjtJoint.mjJNT_BALL]
    ball_names = {ball.name for ball in balls} - {""}
    used_names = [joint.name for joint in spec.joints]
    for number, ball in enumerate(balls):
        body = ball.parent
        name = ball.name or unique_names([f"ball{number}"], taken=used_names)[0]
        hinges[name] = unique_names((f"{name}_{x}" for x in "xyz"), taken=used_names)
        used_names += [name, *hinges[name]]
        # A joint with a range is limited, unless the file says otherwise.
        is_limited = ball.limited == mujoco.mjtLimited.mjLIMITED_TRUE or (
            ball.limited == mujoco.mjtLimited.mjLIMITED_AUTO and np.any(ball.range)
        )
        lost = [
            word
            for word, value in (
                ("its limit", is_limited),
                ("its spring", np.any(ball.stiffness)),
                ("its damper", np.any(ball.damping)),
                ("its dry friction", ball.frictionloss),
                ("its armature", ball.armature),
            )
            if value
        ]
        if lost:
            notes.append(f"ball joint {name}: {', '.join(lost)} left out")
        for hinge, axis in zip(hinges[name], np.eye(3), strict=True):
            body.add_joint(
                name=hinge, type=mujoco.mjtJoint.mjJNT_HINGE, pos=ball.pos, axis=axis
            )
        spec.delete(ball)
    deleted_actuators: set[str] = set()
    for number, actuator in enumerate([*spec.actuators]):
        if actuator.target in ball_names and actuator.trntype in (
            mujoco.mjtTrn.mjTRN_JOINT,
            mujoco.mjtTrn.mjTRN_JOINTINPARENT,
        ):
            name = element_name(actuator, "actuator", number)
            notes.append(f"actuator {name} left out: it drives a ball joint")
            deleted_actuators.add(actuator.name)
            spec.delete(actuator)
    _delete_sensors(spec, mujoco.mjtObj.mjOBJ_JOINT, ball_names)
    _delete_sensors(spec, mujoco.mjtObj.mjOBJ_ACTUATOR, deleted_actuators)
    if balls:
        # Key frames have the variables of the ball joints.
        for key in [*spec.keys]:
            spec.delete(key)
    return hinges, notes
