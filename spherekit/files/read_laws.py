"""Time laws of the inputs, and where a simulation starts, from a study file's data."""

from collections.abc import Mapping
from typing import Any

from spherekit.errors import ModelError
from spherekit.files.angles import angle_at, to_radians
from spherekit.files.document import Document
from spherekit.files.locate import KeyPath
from spherekit.model.changes import AngleUnit
from spherekit.model.laws import ConstantSpeed, Cycloidal, Law, Polynomial, Start, Tabulated


def read_laws(document: Document) -> dict[str, Law]:
    """Return the time law of each input that has one, by pair.

    Raises
    ------
    FileError
        If times do not increase, or a table is too short or does not last as long as
        the study.
    """
    return {
        pair: _law(document, ("inputs", pair, "law"), item["law"])
        for pair, item in document.data.get("inputs", {}).items()
        if "law" in item
    }


def read_start(document: Document) -> Start | None:
    """Return the state of the inputs at t = 0, if it is given."""
    if "start" not in document.data:
        return None
    item, unit = document.data["start"], document.data["angle_unit"]
    given, dq = item["q"], item.get("dq", 0.0)
    return Start(
        tuple(angle_at(document, ("start", "q", k), x, unit) for k, x in enumerate(given))
        if isinstance(given, list)
        else angle_at(document, ("start", "q"), given, unit),
        tuple(to_radians(x, unit) for x in dq)
        if isinstance(dq, list)
        else to_radians(dq, unit),
    )


def _law(document: Document, path: KeyPath, item: Mapping[str, Any]) -> Law:
    try:
        law = _built(item, document.data["angle_unit"])
    except ModelError as error:
        key, _, message = str(error).partition(": ")
        raise document.fault((*path, key), message) from None
    if isinstance(law, Tabulated) and "duration" in document.data:
        _check_span(document, path, law)
    return law


def _built(item: Mapping[str, Any], unit: AngleUnit) -> Law:
    # An input may make many turns in time, so that no angle is too large here.
    kind = item["kind"]
    if kind == "constant_speed":
        speed, start = (to_radians(item.get(key, 0.0), unit) for key in ("speed", "from"))
        return ConstantSpeed(speed, start)
    if kind == "polynomial":
        return Polynomial(
            tuple(to_radians(number, unit) for number in item["coefficients"])
        )
    if kind == "cycloidal":
        start, stop = (to_radians(item[key], unit) for key in ("from", "to"))
        return Cycloidal(start, stop, float(item["duration"]))
    return Tabulated(
        tuple(map(float, item["times"])),
        tuple(to_radians(angle, unit) for angle in item["angles"]),
        item.get("rest_at_ends", False),
    )


def _check_span(document: Document, path: KeyPath, law: Tabulated) -> None:
    duration = float(document.data["duration"])
    if law.times[0] > 0 or law.times[-1] < duration:
        raise document.fault(
            (*path, "times"),
            f"has {law.times[0]:g} to {law.times[-1]:g} s, but the study lasts from 0 to "
            f"{duration:g} s; add rows, or change the duration",
        )
