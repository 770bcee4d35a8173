"""A mechanism with pairs locked: the two links of each become one."""

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.checked import checked
from spherekit.errors import ModelError
from spherekit.model.changes import AngleUnit, in_radians
from spherekit.model.dynamics import Load, Mass
from spherekit.model.geometry import axes_from_sizes, frames_of_sizes
from spherekit.model.mechanism import (
    LinkSizes,
    Mechanism,
    Pair,
    PoseGeometry,
    Profile,
    SizeGeometry,
)
from spherekit.sphere.rotation import Floats, about_z

SAME = 1e-12
"""Angles (rad) that differ by no more are that of the reference pose."""


@checked(ModelError)
def lock(
    mechanism: Mechanism, pairs: Mapping[str, float], *, angle_unit: AngleUnit
) -> Mechanism:
    """Return the mechanism with R pairs locked, the two links of each joined to one.

    The link that stays is the ground, or the one with contacts, or the pair's first;
    masses, loads and outputs of the other go over to it. Loads and stops at the pair go,
    as do an input there and outputs between both links.

    Parameters
    ----------
    mechanism
        Of any mobility.
    pairs
        The variable of each pair that is locked.
    angle_unit
        Their unit, ``"deg"`` or ``"rad"``.

    Raises
    ------
    ModelError
        If there is no such R pair, its stops exclude the value, or the mechanism is given
        in a reference pose in which the pair has another one.

    Examples
    --------
    >>> import spherekit as sk
    >>> four_bar = sk.lock(sk.load("five_bar"), {"51": 80.0}, angle_unit="deg")
    >>> len(four_bar.links), [item.pair for item in four_bar.inputs]
    (4, ['21'])
    """
    for name, value in pairs.items():
        mechanism = _locked(mechanism, mechanism.pair(name), in_radians(value, angle_unit))
    return mechanism


def _locked(made: Mechanism, pair: Pair, value: float) -> Mechanism:
    where = f"{made.name}: lock: pair {pair.name}"
    if not pair.kind.has_axis:
        raise ModelError(f"{where} is a contact; only R pairs can be locked")
    if not math.isfinite(value):
        raise ModelError(f"{where}: found {value}, needs a finite angle")
    for stop in made.stops:
        if stop.pair == pair.name and not stop.low <= value <= stop.high:
            raise ModelError(
                f"{where}: {value:.6g} rad is outside its stops, {stop.low:.6g} to "
                f"{stop.high:.6g} rad"
            )
    touching = {x for other in made.pairs if not other.kind.has_axis for x in other.links}
    kept, gone = pair.links
    if gone == made.ground or (gone in touching and kept not in touching | {made.ground}):
        kept, gone = gone, kept
    rest = tuple(other for other in made.pairs if other.name != pair.name)
    between = [other.name for other in rest if set(other.links) == {kept, gone}]
    if between:
        raise ModelError(
            f"{where} joins the same two links as pair {between[0]}, which could not move"
        )
    geometry, turn = _geometry(made, pair, value, kept, gone, rest, where)

    def on(link: str) -> str:
        return kept if link == gone else link

    outputs = tuple(
        replace(
            output,
            link=on(output.link),
            relative_to=on(output.relative_to),
            direction=_turned(turn, output.direction)
            if output.link == gone and output.direction is not None
            else output.direction,
        )
        for output in made.outputs
        if on(output.link) != on(output.relative_to)
    )
    still = {f"theta_{pair.name}": f"({value!r})", f"dtheta_{pair.name}": "(0)"}
    return replace(
        made,
        links=tuple(link for link in made.links if link != gone),
        pairs=tuple(_pair(other, kept, gone, turn, where) for other in rest),
        geometry=geometry,
        inputs=tuple(item for item in made.inputs if item.pair != pair.name),
        outputs=outputs,
        masses=_masses(made, kept, gone, turn),
        loads=tuple(
            _load(load, kept, gone, turn, still, where)
            for load in made.loads
            if getattr(load, "pair", "") != pair.name
        ),
        stops=tuple(stop for stop in made.stops if stop.pair != pair.name),
    )


def _geometry(
    made: Mechanism,
    pair: Pair,
    value: float,
    kept: str,
    gone: str,
    rest: tuple[Pair, ...],
    where: str,
) -> tuple[SizeGeometry | PoseGeometry, Floats]:
    """Return the new geometry, and the turn (3, 3) from axes of the link that goes."""
    geometry = made.geometry
    if isinstance(geometry, PoseGeometry):
        posed = geometry.values.get(pair.name, 0.0)
        if abs(math.remainder(value - posed, 2.0 * math.pi)) > SAME:
            raise ModelError(
                f"{where}: the mechanism is given in a reference pose, in which the pair "
                f"has {posed:.6g} rad, not {value:.6g} rad; lock it there, or give the "
                "mechanism by arcs and angles"
            )
        axes = {name: axis for name, axis in geometry.axes.items() if name != pair.name}
        values = {name: x for name, x in geometry.values.items() if name != pair.name}
        return PoseGeometry(axes, values), np.eye(3)
    first, second = frames_of_sizes(made, geometry)
    turn = first[pair.name] @ about_z(value) @ second[pair.name].T
    if kept != pair.links[0]:
        turn = turn.T
    links = dict(geometry.links)
    old = links.pop(gone, LinkSizes(()))
    links[kept] = _joined(links.get(kept, LinkSizes(())), old, pair.name, turn)
    zeros = {name: x for name, x in geometry.zeros.items() if name != pair.name}
    plain = replace(
        made,
        links=tuple(link for link in made.links if link != gone),
        pairs=tuple(
            replace(kept_pair, links=_ends(kept_pair, kept, gone)) for kept_pair in rest
        ),
        geometry=SizeGeometry(links, {}),
        inputs=(),
        outputs=(),
        masses=(),
        loads=(),
        stops=(),
    )
    one, other = frames_of_sizes(plain, SizeGeometry(links, {}))
    for remaining in rest:
        if remaining.kind.has_axis and {kept, gone} & set(remaining.links):
            wanted = [
                (turn if link == gone else np.eye(3)) @ frames[remaining.name]
                for link, frames in zip(remaining.links, (first, second), strict=True)
            ]
            shifts = [
                _about(want.T @ have)
                for want, have in zip(
                    wanted, (one[remaining.name], other[remaining.name]), strict=True
                )
            ]
            zeros[remaining.name] = shifts[1] - shifts[0]
    return SizeGeometry(links, zeros), turn


def _about(turn: Floats) -> float:
    """Return the angle of a rotation about z."""
    return float(np.arctan2(turn[1, 0], turn[0, 0]))


def _joined(kept: LinkSizes, gone: LinkSizes, locked: str, turn: Floats) -> LinkSizes:
    """Return the sizes of two links as one, in the frame of the first."""
    axes, arcs, angles = list(kept.axes), list(kept.arcs), list(kept.angles)
    unpaired = [*kept.unpaired, *([locked] if locked in axes else [])]
    if len(axes) == 1:
        # Two axes fix a frame; the second one carries no pair.
        axes.append(f"{locked}_frame")
        arcs.append(0.5 * math.pi)
        unpaired.append(axes[-1])
    for name, axis in axes_from_sizes(gone).items():
        if name == locked or name in gone.unpaired:
            continue
        x, y, z = turn @ axis
        axes.append(name)
        arcs.append(math.atan2(math.hypot(x, y), z))
        angles.append(math.atan2(-x, y))
    return LinkSizes(tuple(axes), tuple(arcs), tuple(angles), tuple(unpaired), kept.signed)


def _turned(turn: Floats, vector: ArrayLike) -> tuple[float, float, float]:
    x, y, z = (turn @ np.array(vector, dtype=float)).tolist()
    return x, y, z


def _ends(pair: Pair, kept: str, gone: str) -> tuple[str, str]:
    one, other = (kept if link == gone else link for link in pair.links)
    return one, other


def _pair(pair: Pair, kept: str, gone: str, turn: Floats, where: str) -> Pair:
    if gone not in pair.links:
        return pair
    ends = _ends(pair, kept, gone)
    if pair.profiles is None or np.array_equal(turn, np.eye(3)):
        return replace(pair, links=ends)
    if pair.type == "Cr":
        raise ModelError(
            f"{where}: both of its links have contacts, and {pair.name} rolls on the one "
            "that goes: where its profile begins would be lost; lock another pair"
        )
    first, second = (
        _profile(profile, turn, pair, where) if link == gone else profile
        for link, profile in zip(pair.links, pair.profiles, strict=True)
    )
    return replace(pair, links=ends, profiles=(first, second))


def _profile(profile: Profile, turn: Floats, pair: Pair, where: str) -> Profile:
    if profile.kind == "fourier":
        raise ModelError(
            f"{where}: the Fourier profile of contact {pair.name} is on the link that "
            "goes; give it by points, or lock another pair"
        )
    centre = None if profile.centre is None else _turned(turn, profile.centre)
    points = tuple(_turned(turn, point) for point in profile.points)
    return replace(profile, centre=centre, points=points)


def _masses(made: Mechanism, kept: str, gone: str, turn: Floats) -> tuple[Mass, ...]:
    masses = {mass.link: mass for mass in made.masses}
    moved = masses.pop(gone, None)
    if moved is None:
        return tuple(masses.values())
    tensor = turn @ np.array(moved.tensor, dtype=float) @ turn.T
    mass, centre = moved.mass, moved.centre
    if centre is not None:
        centre = _turned(turn, centre)
    if kept in masses:
        other = masses[kept]
        tensor = tensor + np.array(other.tensor, dtype=float)
        if mass is None or other.mass is None or centre is None or other.centre is None:
            mass, centre = None, None
        else:
            both = mass * np.array(centre) + other.mass * np.array(other.centre)
            mass = mass + other.mass
            centre = _turned(np.eye(3), both / mass if mass else 0.0 * both)
    rows = tuple(map(tuple, (0.5 * (tensor + tensor.T)).tolist()))
    masses[kept] = Mass(kept, rows, mass, centre)  # type: ignore[arg-type]
    return tuple(masses.values())


def _load(
    load: Load, kept: str, gone: str, turn: Floats, still: Mapping[str, str], where: str
) -> Load:
    changes: dict[str, Any] = {}
    for key, form in load.keys.items():
        given = getattr(load, key)
        if form == "text" and key != "axes" and isinstance(given, str):
            changes[key] = _without(given, still)
        elif form == "texts":
            changes[key] = tuple(_without(text, still) for text in given)
    if getattr(load, "link", "") == gone:
        if getattr(load, "axes", "ground") == "link" and not np.array_equal(
            turn, np.eye(3)
        ):
            raise ModelError(
                f'{where}: load {load.name} is along the axes of link "{gone}", which '
                "goes; give it along ground axes"
            )
        changes["link"] = kept
        if hasattr(load, "point"):
            changes["point"] = _turned(turn, load.point)
    return replace(load, **changes) if changes else load  # type: ignore[type-var]


def _without(text: str, still: Mapping[str, str]) -> str:
    """Return an expression in which names stand for what does not change."""
    for name, number in still.items():
        text = re.sub(rf"\b{re.escape(name)}\b", number, text)
    return text
