"""A mechanism with pairs locked: the two links of each become one."""

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from spherekit.checked import checked
from spherekit.conventions import listing
from spherekit.errors import ModelError
from spherekit.model.changes import AngleUnit, in_radians
from spherekit.model.dynamics import Mass
from spherekit.model.geometry import axes_from_sizes, frames_of_sizes
from spherekit.model.link_axes import turned_vector, with_link_axes
from spherekit.model.load import Load
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import LinkSizes, Pair, PoseGeometry, SizeGeometry
from spherekit.model.sized import given_by_sizes, zeros_from
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
    as do an input there and outputs between both links. A mechanism given in a reference
    pose is given by arcs and angles if a pair is locked at another value than it has there.

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
        If there is no such R pair, its stops exclude the value, they are all inputs that
        the mechanism states, or a contact would lose
        the place from which lengths along its profiles are measured.

    Examples
    --------
    >>> import spherekit as sk
    >>> four_bar = sk.lock(sk.load("five_bar"), {"51": 80.0}, angle_unit="deg")
    >>> len(four_bar.links), [item.pair for item in four_bar.inputs]
    (4, ['21'])
    """
    driven = [item.pair for item in mechanism.inputs]
    if driven and set(driven) <= set(pairs):
        raise ModelError(
            f"{mechanism.name}: lock: {listing(driven)} are all inputs there are, so that "
            "nothing would move; leave one of them free"
            if len(driven) > 1
            else f"{mechanism.name}: lock: {driven[0]} is the only input, so that nothing "
            "would move; leave it free"
        )
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
    if isinstance(made.geometry, PoseGeometry):
        posed = made.geometry.values.get(pair.name, 0.0)
        if abs(math.remainder(value - posed, 2.0 * math.pi)) > SAME:
            posed_at = f"has {posed:.6g} rad in the reference pose, not {value:.6g} rad"
            made = given_by_sizes(made, f"{where} {posed_at}")
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
    geometry, turn = _geometry(made, pair, value, kept, gone, rest)
    made = with_link_axes(made, {gone: turn}, where)

    def on(link: str) -> str:
        return kept if link == gone else link

    outputs = tuple(
        replace(
            output,
            link=on(output.link),
            relative_to=on(output.relative_to),
        )
        for output in made.outputs
        if on(output.link) != on(output.relative_to)
    )
    still = {f"theta_{pair.name}": f"({value!r})", f"dtheta_{pair.name}": "(0)"}
    return replace(
        made,
        links=tuple(link for link in made.links if link != gone),
        pairs=tuple(
            replace(other, links=_ends(other, kept, gone))
            for other in made.pairs
            if other.name != pair.name
        ),
        geometry=geometry,
        inputs=tuple(item for item in made.inputs if item.pair != pair.name),
        outputs=outputs,
        masses=_masses(made, kept, gone),
        loads=tuple(
            _load(load, kept, gone, still)
            for load in made.loads
            if getattr(load, "pair", "") != pair.name
        ),
        stops=tuple(stop for stop in made.stops if stop.pair != pair.name),
        modes=(),
    )


def _geometry(
    made: Mechanism,
    pair: Pair,
    value: float,
    kept: str,
    gone: str,
    rest: tuple[Pair, ...],
) -> tuple[SizeGeometry | PoseGeometry, Floats]:
    """Return the new geometry, and the turn (3, 3) from axes of the link that goes."""
    geometry = made.geometry
    if isinstance(geometry, PoseGeometry):
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
        modes=(),
    )
    into = {gone: turn}
    wanted = tuple(
        {
            other.name: into.get(other.links[end], np.eye(3)) @ frames[other.name]
            for other in rest
            if other.kind.has_axis and {kept, gone} & set(other.links)
        }
        for end, frames in enumerate((first, second))
    )
    zeros |= zeros_from(plain, links, (wanted[0], wanted[1]), wanted[0])
    return SizeGeometry(links, zeros), turn


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


def _ends(pair: Pair, kept: str, gone: str) -> tuple[str, str]:
    one, other = (kept if link == gone else link for link in pair.links)
    return one, other


def _masses(made: Mechanism, kept: str, gone: str) -> tuple[Mass, ...]:
    masses = {mass.link: mass for mass in made.masses}
    moved = masses.pop(gone, None)
    if moved is None:
        return tuple(masses.values())
    mass, centre, tensor = moved.mass, moved.centre, np.array(moved.tensor, dtype=float)
    if kept in masses:
        other = masses[kept]
        tensor = tensor + np.array(other.tensor, dtype=float)
        if mass is None or other.mass is None or centre is None or other.centre is None:
            mass, centre = None, None
        else:
            both = mass * np.array(centre) + other.mass * np.array(other.centre)
            mass = mass + other.mass
            centre = turned_vector(np.eye(3), both / mass if mass else 0.0 * both)
    rows = tuple(map(tuple, tensor.tolist()))
    masses[kept] = Mass(kept, rows, mass, centre)  # type: ignore[arg-type]
    return tuple(masses.values())


def _load(load: Load, kept: str, gone: str, still: Mapping[str, str]) -> Load:
    changes: dict[str, Any] = {}
    for key, form in load.keys.items():
        given = getattr(load, key)
        if form == "text" and key != "axes" and isinstance(given, str):
            changes[key] = _without(given, still)
        elif form == "texts":
            changes[key] = tuple(_without(text, still) for text in given)
    if getattr(load, "link", "") == gone:
        changes["link"] = kept
    return replace(load, **changes) if changes else load  # type: ignore[type-var]


def _without(text: str, still: Mapping[str, str]) -> str:
    """Return an expression in which names stand for what does not change."""
    for name, number in still.items():
        text = re.sub(rf"\b{re.escape(name)}\b", number, text)
    return text
