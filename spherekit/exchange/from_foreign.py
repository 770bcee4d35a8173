"""Another program's model as a spherical mechanism: what turns about one point."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from spherekit.conventions import MAX_NAME_LENGTH, listing, numbered
from spherekit.errors import FileError
from spherekit.exchange.common_point import Line, common_point
from spherekit.exchange.foreign import ForeignHinge, ForeignHold, ForeignLoad, ForeignModel
from spherekit.exchange.gears import Turning, gears_of
from spherekit.exchange.plain_numbers import Units, plain
from spherekit.model.changes import AngleUnit
from spherekit.model.inertia import moved_to_sphere_centre
from spherekit.sphere.rotation import Floats

WITHIN = 1e-6
"""Axes may miss the centre by this part of the model's size."""

THIN = 2e-12
"""Tensors are read to this part; exported ones have been thickened by less."""

SLOW = 0.01
"""rad/s below which imported dry friction is smoothed: a model's own jumps at rest."""

Table = dict[str, Any]


@final
@dataclass(frozen=True)
class Tables:
    """The tables of a mechanism file, with comments above the file and above tables."""

    content: Mapping[str, Table]
    heading: tuple[str, ...]
    comments: Mapping[tuple[str, str], str]
    notes: tuple[str, ...]


@final
@dataclass(frozen=True)
class _Pair:
    name: str
    links: tuple[int, int]
    axis: Floats
    value: float
    hinge: ForeignHinge | None


def tables_of(
    where: str, model: ForeignModel, unit: AngleUnit, within: float | None = None
) -> Tables:
    """Return the tables of a mechanism file that a model is.

    Parameters
    ----------
    where
        The file, for messages.
    unit
        Of its angles.
    within
        Distance (m) by which axes may miss their common point; by default `WITHIN` of the
        distance of the farthest centre of mass or point that holds bodies.

    Raises
    ------
    FileError
        If axes miss the point or are parallel, or nothing moves.
    """
    return _Import(where, model, Units(unit), within).tables()


@final
class _Import:
    def __init__(
        self, where: str, model: ForeignModel, units: Units, within: float | None
    ) -> None:
        self.where, self.model, self.units = where, model, units
        self.notes: list[str] = list(model.notes)
        self.comments: dict[tuple[str, str], str] = {}
        self.node = list(range(len(model.bodies)))
        self.names: dict[int, str] = {}
        self.rigid = list(self._rigid_holds())
        self._join()
        self.centre, self.miss = self._meet(within)
        self.pairs = self._pairs()
        self.contacts = dict(self._contacts())

    def tables(self) -> Tables:
        model = self.model
        links: Table = {link: {} for link in self._links()}
        content: dict[str, Table] = {
            "source": {"citation": f"imported from the {model.source}"},
            "links": links,
            "pairs": {pair.name: self._pair(pair) for pair in self.pairs} | self.contacts,
            "inputs": self._inputs(),
            "mass": self._masses(),
        }
        content["loads"] = self._loads(content["mass"])
        content["stops"] = {
            pair.name: {
                "from": self.units.angle(pair.hinge.limits[0]),
                "to": self.units.angle(pair.hinge.limits[1]),
            }
            for pair in self.pairs
            if pair.hinge is not None and pair.hinge.limits is not None
        }
        x, y, z = (plain(coordinate, 1.0) for coordinate in self.centre)
        heading = (
            f"Imported from the {model.source}.",
            f"The centre of the sphere is at {x}, {y}, {z} m in its world axes, which are "
            f"the ground's here; axes pass it within {self.miss:.2g} m.",
            *(f"Note: {note}." for note in self.notes),
        )
        return Tables(
            {name: table for name, table in content.items() if table},
            heading,
            self.comments,
            tuple(self.notes),
        )

    # Bodies that are one link

    def find(self, body: int) -> int:
        while self.node[body] != body:
            body = self.node[body]
        return body

    def _merge(self, kept: int, other: int) -> None:
        kept, other = self.find(kept), self.find(other)
        if other == self.find(0):
            kept, other = other, kept
        self.node[other] = kept

    def _rigid_holds(self) -> Iterator[ForeignHold]:
        yield from (hold for hold in self.model.holds if hold.point is None)

    def _join(self) -> None:
        """Make one link of bodies that are welded, or hinged by locked joints alone."""
        model = self.model
        turning = {hinge.body for hinge in model.hinges if not hinge.locked}
        for number, body in enumerate(model.bodies):
            if number and number not in turning:
                self._merge(body.parent, number)
        for hold in self.rigid:
            self._merge(hold.first, hold.second)
        for hinge in model.hinges:
            if hinge.locked:
                self.notes.append(f"joint {hinge.name} is locked, so it is no pair")

    def members(self, link: int) -> list[int]:
        return [k for k in range(len(self.node)) if self.find(k) == link]

    def _name(self, node: int) -> str:
        """Return the name of a link: its body's, or of the ground its only body's."""
        if node in self.names:
            return self.names[node]
        text = self.model.bodies[node].name
        if node == self.find(0):
            children = [
                k for k in self.members(node) if k and self.model.bodies[k].parent == 0
            ]
            text = self.model.bodies[children[0]].name if len(children) == 1 else "ground"
        self.names[node] = self._unique(text, self.names.values())
        return self.names[node]

    def _unique(self, text: str, used: Iterable[str]) -> str:
        clean = re.sub(r"[^A-Za-z0-9_]", "_", text)[:MAX_NAME_LENGTH] or "unnamed"
        taken, name, k = set(used), clean, 1
        while name in taken:
            k += 1
            name = f"{clean[: MAX_NAME_LENGTH - 4]}_{k}"
        if name != text:
            self.notes.append(f'"{text}" is called {name}')
        return name

    def _links(self) -> list[str]:
        used = dict.fromkeys(
            [self.find(0), *(link for pair in self.pairs for link in pair.links)]
        )
        return [self._name(link) for link in used]

    # The centre

    def _lines(self) -> list[Line]:
        lines = [
            Line(f"joint {hinge.name}", hinge.point, hinge.axis)
            for hinge in self.model.hinges
            if not hinge.locked
        ]
        for holds in self._held().values():
            for other in holds[1:]:
                along = other.point - holds[0].point
                length = float(np.linalg.norm(along))
                if length > 0.0:
                    words = f"loop {holds[0].name}"
                    words += f" through {other.name}" * (other.name != holds[0].name)
                    lines.append(Line(words, holds[0].point, along / length))
        return lines

    def _held(self) -> dict[tuple[int, int], list[Any]]:
        """Return the points that hold bodies, by the two links."""
        holds: dict[tuple[int, int], list[Any]] = {}
        for hold in self.model.holds:
            if hold.point is not None:
                ends = self.find(hold.first), self.find(hold.second)
                if ends[0] != ends[1]:
                    holds.setdefault(
                        ends if ends in holds or ends[::-1] not in holds else ends[::-1], []
                    ).append(hold)
        return holds

    def _meet(self, within: float | None) -> tuple[Floats, float]:
        lines = self._lines()
        model = self.model
        places = [body.centre for body in model.bodies if body.mass is not None]
        places += [hold.point for hold in model.holds if hold.point is not None]
        places += [hinge.point for hinge in model.hinges]
        middle = np.mean(places, axis=0)
        size = max(float(np.linalg.norm(place - middle)) for place in places) or 1.0
        allowed = WITHIN * size if within is None else within
        centre = common_point(lines, allowed)
        if centre is None:
            raise FileError(
                f"{self.where}: all {len(lines)} axes are parallel: a planar mechanism, "
                "whose links turn about no common point; axes of a spherical mechanism "
                "meet in one"
            )
        gaps = {line.name: line.distance(centre) for line in lines}
        worst = max(gaps.values())
        if worst > allowed:
            x, y, z = (plain(coordinate, size) for coordinate in centre)
            told = "".join(
                f"\n  {name}: {gap if gap > 1e-3 * allowed else 0.0:.4g} m"
                for name, gap in sorted(gaps.items(), key=lambda g: -g[1])
            )
            passing = sum(gap <= allowed for gap in gaps.values())
            raise FileError(
                f"{self.where}: the axes do not meet in a point, so it is no spherical "
                f"mechanism. {passing} of {len(gaps)} pass the point {x}, {y}, {z} m; the "
                f"distances from it are:{told}\nAllowed is {allowed:.2g} m; give --within "
                "METRES if more is rounding, or take the other joints out of a copy of the "
                "file"
            )
        return centre, worst

    # Pairs

    def _pairs(self) -> list[_Pair]:
        model, pairs = self.model, []
        names: list[str] = []

        def named(text: str) -> str:
            names.append(self._unique(text, names))
            return names[-1]

        by_body: dict[int, list[ForeignHinge]] = {}
        for hinge in model.hinges:
            if not hinge.locked:
                by_body.setdefault(hinge.body, []).append(hinge)
        for body, hinges in by_body.items():
            below, last = self.find(model.bodies[body].parent), self.find(body)
            if below == last:
                told = listing(hinge.name for hinge in hinges)
                self.notes.append(f"joint {told} cannot turn: its bodies are welded")
                continue
            for k, hinge in enumerate(hinges):
                above = last
                if k < len(hinges) - 1:
                    above = len(self.node)
                    self.node.append(above)
                    self.names[above] = self._unique(
                        f"{model.bodies[body].name}_{hinge.name}", self.names.values()
                    )
                pairs.append(
                    _Pair(named(hinge.name), (below, above), hinge.axis, hinge.value, hinge)
                )
                below = above
        for ends, holds in self._held().items():
            pairs += self._closing(ends, holds, named)
        if not pairs:
            raise FileError(f"{self.where}: nothing moves: all bodies are welded together")
        self._need_pieces(pairs)
        return pairs

    def _closing(
        self, ends: tuple[int, int], holds: Sequence[Any], named: Any
    ) -> list[_Pair]:
        """Return the pair that points which hold two links make."""
        hold = max(
            holds,
            key=lambda candidate: float(np.linalg.norm(candidate.point - self.centre)),
        )
        arm = hold.point - self.centre
        length = float(np.linalg.norm(arm))
        if length <= self.miss or length == 0.0:
            self.notes.append(
                f"loop {hold.name} left out: it holds the centre, which does not move"
            )
            return []
        name = named(holds[0].name)
        one, other = (self._name(end) for end in ends)
        self.comments["pairs", name] = f"Closes a loop: holds {one} and {other} at a point."
        value = self.model.values.get(holds[0].name, 0.0)
        return [_Pair(name, ends, arm / length, value, None)]

    def _contacts(self) -> Iterator[tuple[str, Table]]:
        """Yield a rolling contact for each coupling of hinges."""
        turning = [Turning(p.hinge.name, p.links, p.axis) for p in self.pairs if p.hinge]
        names = [pair.name for pair in self.pairs]
        for coupling in self.model.couplings:
            gears = gears_of(turning, coupling.factors)
            if isinstance(gears, str):
                raise FileError(
                    f"{self.where}: {coupling.name} couples joints "
                    f"{listing(coupling.factors)}, but no two gears do: {gears}. Take it "
                    "out of a copy of the file"
                )
            names.append(self._unique(coupling.name, names))
            links = [self._name(link) for link in gears.links]
            table: Table = {"type": "Cr", "links": links}
            if gears.contact != "external":
                table["contact"] = gears.contact
            table["profiles"] = {
                link: {
                    "kind": "circle",
                    **{f"centre_{k}": x for k, x in self.units.axis(centre).items()},
                    "radius": self.units.angle(radius),
                }
                for link, centre, radius in zip(
                    links, gears.centres, gears.radii, strict=True
                )
            }
            self.comments["pairs", names[-1]] = "Joints at a constant ratio: gears."
            yield names[-1], table

    def _need_pieces(self, pairs: Sequence[_Pair]) -> None:
        joined = {self.find(0)}
        for _ in pairs:
            joined |= {k for pair in pairs for k in pair.links if joined & set(pair.links)}
        lost = {k for pair in pairs for k in pair.links} - joined
        if lost:
            raise FileError(
                f"{self.where}: link {listing(self._name(k) for k in lost)} is not joined "
                "to the ground"
            )

    def _pair(self, pair: _Pair) -> Table:
        one, other = (self._name(link) for link in pair.links)
        table: Table = {"type": "R", "links": [one, other], **self.units.axis(pair.axis)}
        if pair.value:
            table["value"] = self.units.angle(pair.value)
        return table

    def _inputs(self) -> Table:
        """Return the actuated pairs, with as many others as there are freedoms left."""
        numbers = {pair.hinge.name: k for k, pair in enumerate(self.pairs) if pair.hinge}
        driven = [numbers[name] for name in self.model.driven if name in numbers]
        ground = self.find(0)
        rest = sorted(
            (k for k in range(len(self.pairs)) if k not in driven),
            key=lambda k: (self.pairs[k].hinge is None, ground not in self.pairs[k].links),
        )
        rows = self._velocity_equations()
        rank = _rank(rows)
        chosen: list[int] = []
        for k in [*driven, *rest]:
            more = np.vstack([rows, np.eye(len(self.pairs))[k]])
            if _rank(more) > rank:
                chosen.append(k)
                rows, rank = more, rank + 1
        added = [self.pairs[k].name for k in chosen if k not in driven]
        if added:
            what = "has" if len(added) == 1 else "have"
            self.notes.append(
                f"{numbered('input', added)} {what} no actuator; there are more freedoms "
                "than actuators"
            )
        spare = [self.pairs[k].name for k in driven if k not in chosen]
        if spare:
            self.notes.append(
                f"actuator of {listing(spare)} left out: the others determine the motion"
            )
        return {self.pairs[k].name: self._range(self.pairs[k]) for k in chosen}

    def _range(self, pair: _Pair) -> Table:
        given = self.model.driven.get(pair.hinge.name) if pair.hinge is not None else None
        if given is None and pair.hinge is not None:
            given = pair.hinge.limits
        low, high = given or (pair.value - np.pi, pair.value + np.pi)
        return {"from": self.units.angle(low), "to": self.units.angle(high)}

    def _velocity_equations(self) -> Floats:
        """Return what loops say of the rates of all pairs, (3 links, pairs + 3 links).

        Every link has an angular velocity, the ground's is zero; a pair's rate is along its
        axis. Angular velocities are eliminated.
        """
        links = list(dict.fromkeys(k for pair in self.pairs for k in pair.links))
        links = [self.find(0), *(k for k in links if k != self.find(0))]
        spread = np.zeros((3 * len(self.pairs), 3 * (len(links) - 1)))
        along = np.zeros((3 * len(self.pairs), len(self.pairs)))
        for k, pair in enumerate(self.pairs):
            rows = slice(3 * k, 3 * k + 3)
            along[rows, k] = pair.axis
            for link, sign in zip(pair.links, (-1.0, 1.0), strict=True):
                if (at := links.index(link)) > 0:
                    spread[rows, 3 * at - 3 : 3 * at] = sign * np.eye(3)
        left, sizes, _ = np.linalg.svd(spread)
        rank = int(np.sum(sizes > 1e-9 * sizes[0]))
        numbers = {pair.hinge.name: k for k, pair in enumerate(self.pairs) if pair.hinge}
        ratios = np.zeros((len(self.model.couplings), len(self.pairs)))
        for row, coupling in zip(ratios, self.model.couplings, strict=True):
            for name, factor in coupling.factors.items():
                row[numbers[name]] = factor
        return np.concatenate([left[:, rank:].T @ along, ratios])

    # Inertia and loads

    def _masses(self) -> Table:
        model, masses = self.model, {}
        if model.made_up:
            self.notes.append(
                "the masses, which the file says are made up, and its servos were left out"
            )
            return {}
        used = [link for pair in self.pairs for link in pair.links]
        for link in dict.fromkeys(used):
            bodies = (
                [model.bodies[k] for k in self.members(link)]
                if link < len(model.bodies)
                else []
            )
            heavy = [body for body in bodies if body.mass is not None]
            if link == self.find(0) or not heavy:
                continue
            mass, moment, tensor = 0.0, np.zeros(3), np.zeros((3, 3))
            for body in heavy:
                assert body.mass is not None
                arm = body.centre - self.centre
                tensor += moved_to_sphere_centre(body.tensor, body.mass, arm)
                mass += body.mass
                moment += (0.0 if body.weightless else body.mass) * arm
            table: Table = {
                "tensor": [
                    [plain(x, float(np.max(np.abs(tensor))), THIN) for x in row]
                    for row in tensor
                ]
            }
            if not all(body.weightless for body in heavy) or model.gravity is not None:
                radius = float(np.sqrt(np.trace(tensor) / mass))
                table["mass"] = plain(mass, mass)
                table["centre"] = [plain(x, radius) for x in moment / mass]
                if any(body.weightless for body in heavy):
                    self.comments["mass", self._name(link)] = (
                        "Its weight is compensated: its centre counts as the sphere's."
                    )
            masses[self._name(link)] = table
        return masses

    def _loads(self, masses: Table) -> Table:
        model, loads = self.model, {}
        names: list[str] = []

        def put(name: str, table: Table) -> None:
            names.append(self._unique(name, names))
            loads[names[-1]] = table

        if model.gravity is not None and masses:
            put(
                "gravity",
                {"kind": "gravity", "acceleration": [plain(x, 1.0) for x in model.gravity]},
            )
        for pair in self.pairs:
            hinge = pair.hinge
            if hinge is None:
                continue
            if hinge.stiffness:
                spring = {
                    "stiffness": plain(hinge.stiffness, hinge.stiffness),
                    "rest": self.units.angle(hinge.rest),
                }
                put(f"spring_{pair.name}", {"kind": "spring", "pair": pair.name, **spring})
            damping = {"damping": plain(hinge.damping, hinge.damping)}
            if hinge.dry:
                dry = {
                    "torque": plain(hinge.dry, hinge.dry),
                    "speed": self.units.angle(SLOW),
                }
                if hinge.damping:
                    dry["viscous"] = damping["damping"]
                put(f"friction_{pair.name}", {"kind": "friction", "pair": pair.name, **dry})
                self.notes.append(
                    f"dry friction of {pair.name} is smoothed below {SLOW:g} rad/s"
                )
            elif hinge.damping:
                put(f"damper_{pair.name}", {"kind": "damper", "pair": pair.name, **damping})
        for load in model.loads:
            put(load.name, self._load(load))
        return loads

    def _load(self, load: ForeignLoad) -> Table:
        parts = [plain(x, float(np.max(np.abs(load.vector)))) for x in load.vector]
        if load.kind == "torque":
            pair = next(
                p.name for p in self.pairs if p.hinge and p.hinge.name == load.hinge
            )
            factors = (
                f"({parts[0]})",
                f"({parts[1]})*theta_{pair}",
                f"({parts[2]})*dtheta_{pair}",
            )
            used = [text for text, part in zip(factors, parts, strict=True) if part]
            return {"pair": pair, "torque": " + ".join(used) or "0"}
        table: Table = {"kind": load.kind, "link": self._name(self.find(load.body))}
        if load.point is not None:
            arm = load.point - self.centre
            table["point"] = [plain(x, float(np.max(np.abs(arm)))) for x in arm]
        table[load.kind] = [str(part) for part in parts]
        table["axes"] = "link" if load.turns else "ground"
        return table


def _rank(rows: Floats) -> int:
    return int(np.linalg.matrix_rank(rows, tol=1e-9)) if rows.size else 0
