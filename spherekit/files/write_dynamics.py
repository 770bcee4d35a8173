"""Masses, loads and stops of a mechanism as tables of its file."""

from collections.abc import Iterable
from typing import Any

from spherekit.errors import EngineError
from spherekit.files.angles import to_text
from spherekit.files.toml_text import Literal
from spherekit.model.changes import AngleUnit
from spherekit.model.dynamics import Mass, PairTorque, Stop
from spherekit.model.load import Load, not_written

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
        item.pair: {"from": angle_text(item.low, unit), "to": angle_text(item.high, unit)}
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
    table: _Table = {} if load.kind == PairTorque.kind else {"kind": load.kind}
    for key, form in load.keys.items():
        given = getattr(load, key)
        if given is None:
            continue
        if callable(given):
            raise EngineError(not_written(getattr(load, "pair", "")))
        if form in ("angle", "rate"):
            table[key] = angle_text(given, unit)
        elif form in ("vector", "numbers"):
            table[key] = [float(x) for x in given]
        elif form == "number":
            table[key] = float(given)
        else:
            table[key] = list(given) if form == "texts" else given
    return table


def angle_text(angle: float, unit: AngleUnit) -> Literal:
    """Return an angle (rad) as a number of a file in its unit."""
    return Literal(to_text(angle, unit))
