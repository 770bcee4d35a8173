"""Masses, loads and stops of a mechanism as tables of its file."""

from collections.abc import Iterable
from typing import Any

from spherekit.errors import EngineError
from spherekit.files.angles import to_text
from spherekit.files.toml_text import Literal
from spherekit.model.actions import not_written
from spherekit.model.changes import AngleUnit
from spherekit.model.dynamics import (
    Damper,
    Friction,
    Gravity,
    Load,
    Mass,
    Moment,
    PairTorque,
    PointForce,
    Spring,
    Stop,
    TorqueTable,
)

_Table = dict[str, Any]


def mass_tables(masses: Iterable[Mass]) -> dict[str, _Table]:
    """Return the table of each mass, in link axes, by link."""
    return {item.link: _mass(item) for item in masses}


def load_tables(loads: Iterable[Load], unit: AngleUnit) -> dict[str, _Table]:
    """Return the table of each load by name."""
    return {item.name: _load(item, unit) for item in loads}


def stop_tables(stops: Iterable[Stop], unit: AngleUnit) -> dict[str, _Table]:
    """Return the table of each stop by pair."""
    return {
        item.pair: {"from": _angle(item.low, unit), "to": _angle(item.high, unit)}
        for item in stops
    }


def _mass(mass: Mass) -> _Table:
    table: _Table = {"tensor": [[float(x) for x in row] for row in mass.tensor]}
    if mass.mass is not None:
        table["mass"] = float(mass.mass)
    if mass.centre is not None:
        table["centre"] = [float(x) for x in mass.centre]
    return table


def _load(load: Load, unit: AngleUnit) -> _Table:
    if isinstance(load, PairTorque):
        if not isinstance(load.torque, str):
            raise EngineError(not_written(load.pair))
        return {"pair": load.pair, "torque": load.torque}
    if isinstance(load, Gravity):
        return {"kind": "gravity", "acceleration": [float(x) for x in load.acceleration]}
    if isinstance(load, PointForce):
        return {
            "kind": "force",
            "link": load.link,
            "point": [float(x) for x in load.point],
            "force": list(load.force),
            "axes": load.axes,
        }
    if isinstance(load, Moment):
        return {
            "kind": "moment",
            "link": load.link,
            "moment": list(load.moment),
            "axes": load.axes,
        }
    return _at_pair(load, unit)


def _at_pair(load: Spring | Damper | Friction | TorqueTable, unit: AngleUnit) -> _Table:
    if isinstance(load, Spring):
        return {
            "kind": "spring",
            "pair": load.pair,
            "stiffness": float(load.stiffness),
            "rest": _angle(load.rest, unit),
        }
    if isinstance(load, Damper):
        return {"kind": "damper", "pair": load.pair, "damping": float(load.damping)}
    if isinstance(load, Friction):
        return {
            "kind": "friction",
            "pair": load.pair,
            "torque": float(load.torque),
            "speed": _angle(load.speed, unit),
            "viscous": float(load.viscous),
        }
    return {
        "kind": "table",
        "pair": load.pair,
        "times": [float(t) for t in load.times],
        "torques": [float(torque) for torque in load.torques],
        "periodic": load.periodic,
    }


def _angle(angle: float, unit: AngleUnit) -> Literal:
    return Literal(to_text(angle, unit))
