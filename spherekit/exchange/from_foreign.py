"""Another program's model as a spherical mechanism: what turns about one point."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain, count, groupby
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import MAX_NAME_LENGTH, listing, numbered
from spherekit.errors import FileError
from spherekit.exchange.foreign_axes import (
    Turning,
    common_point,
    distances,
    gears_of,
    plain,
    plain_angle,
    plain_axis,
)
from spherekit.exchange.mujoco_file import MASSLESS, ForeignModel, named
from spherekit.model.dynamics import moved_to_sphere_centre
from spherekit.model.graph import joined
from spherekit.motion.loops import LoopTree
from spherekit.sphere.rotation import max_abs

WITHIN = 1e-6
"""Axes may miss the centre by this part of the model's size."""

THIN = 2e-12
"""Tensors are read to this part; exported ones have been thickened by less."""

SLOW = 0.01
"""rad/s below which imported dry friction is smoothed: a model's own jumps at rest."""

Table = dict[str, Any]


class ForeignTables:
    """The tables of a mechanism file that a model is, with angles in degrees.

    `content` are the tables, `heading` and `comments` are above the file and above tables,
    `notes` say what was left out or changed. Axes may miss their common point by a
    distance `within` (m), by default `WITHIN` of that of the farthest centre of mass or
    point that holds bodies.

    Raises
    ------
    FileError
        If axes miss the point or are parallel, or nothing moves.
    """

    def __init__(self, where: str, model: ForeignModel, within: float | None) -> None:
        self.where, self.model = where, model
        self.m, self.d, self.notes = model.m, model.d, list[str]()
        self.comments: dict[tuple[str, str], str] = {}
        self.names: dict[int, str] = {}
        self.turning = [k for k in range(self.m.njnt) if k not in model.locked]
        limited = np.flatnonzero(self.m.jnt_limited).tolist()
        self.limits = {k: self.m.jnt_range[k].tolist() for k in limited}
        self.link = self._links_of_bodies()
        self.closing = self._closing_points()
        self.centre, self.miss = self._meet(within)
        self.pairs = self._pairs()
        every = (link for pair in self.pairs for link in pair.links)
        self.links = list(dict.fromkeys([0, *every]))
        self.content = {name: table for name, table in self._tables().items() if table}
        self.notes += model.notes
        x, y, z = (plain(coordinate, 1.0) for coordinate in self.centre)
        self.heading = (
            f"Imported from the {model.source}.",
            f"The centre of the sphere is at {x}, {y}, {z} m in its world axes, which are "
            f"the ground's here; axes pass it within {self.miss:.2g} m.",
            *(f"Note: {note}." for note in self.notes),
        )

    def _tables(self) -> dict[str, Table]:
        contacts, masses = dict(self._contacts()), {}
        links: Table = {self._name(link): {} for link in self.links}
        inputs = self._inputs()
        if self.model.made_up:
            self.notes.append(
                "the masses, which the file says are made up, and its servos were left out"
            )
        else:
            masses = dict(self._masses())
        loads: Table = {}
        for name, table in self._loads(masses):
            loads[self._unique(name, loads)] = table
        return {
            "source": {"citation": f"imported from the {self.model.source}"},
            "links": links,
            "pairs": {pair.name: self._pair(pair) for pair in self.pairs} | contacts,
            "inputs": inputs,
            "mass": masses,
            "loads": loads,
            "joint_limits": {
                pair.name: self._ends(self.limits[pair.joint])
                for pair in self.pairs
                if pair.joint in self.limits
            },
        }

    def _ends(self, angles: Sequence[float]) -> Table:
        return dict(zip(("from", "to"), map(plain_angle, angles), strict=True))

    # Bodies that are one link

    def _links_of_bodies(self) -> list[int]:
        """Return the links of bodies: one of those welded, or hinged by locked joints."""
        moved = {0, *self.m.jnt_bodyid[self.turning].tolist()}
        parents = enumerate(self.m.body_parentid.tolist())
        still = ((up, k) for k, up in parents if k not in moved)
        link = list(range(self.m.nbody))
        for ends in [*still, *self.model.welds]:
            kept, other = (link[end] for end in ends)
            kept, other = (other, kept) if other == 0 else (kept, other)
            link = [kept if x == other else x for x in link]
        self.notes += [
            f"joint {self.model.joints[k]} is locked, so it is no pair"
            for k in sorted(self.model.locked)
        ]
        return link

    def _name(self, link: int) -> str:
        """Return the name of a link: its body's, or of the ground its only body's."""
        if link not in self.names:
            text = self.model.bodies[link]
            if link == 0:
                parents = self.m.body_parentid
                children = [
                    k for k in range(1, self.m.nbody) if not (self.link[k] or parents[k])
                ]
                text = self.model.bodies[children[0]] if len(children) == 1 else "ground"
            self.names[link] = self._unique(text, self.names.values())
        return self.names[link]

    def _unique(self, text: str, used: Iterable[str]) -> str:
        clean = re.sub(r"[^A-Za-z0-9_]", "_", text)[:MAX_NAME_LENGTH] or "unnamed"
        taken = set(used)
        others = (f"{clean[: MAX_NAME_LENGTH - 4]}_{k}" for k in count(2))
        name = next(word for word in chain([clean], others) if word not in taken)
        if name != text:
            self.notes.append(f'"{text}" is called {name}')
        return name

    # The centre

    def _closing_points(self) -> dict[tuple[int, int], list[tuple[str, Floats]]]:
        """Return the named points that hold bodies, by the two links."""
        held: dict[tuple[int, int], list[tuple[str, Floats]]] = {}
        for name, (first, second), point in self.model.holds:
            ends = self.link[first], self.link[second]
            if ends[0] != ends[1]:
                order = ends[::-1] if ends[::-1] in held else ends
                held.setdefault(order, []).append((name, point))
        return held

    def _lines(self) -> Iterator[tuple[str, Floats, Floats]]:
        """Yield the axes that have to meet: names, points and directions (3,)."""
        for k in self.turning:
            yield f"joint {self.model.joints[k]}", self.d.xanchor[k], self.d.xaxis[k]
        for (first, place), *others in self.closing.values():
            for other, point in others:
                length = float(np.linalg.norm(point - place))
                if length > 0.0:
                    words = f"loop {first}" + f" through {other}" * (other != first)
                    yield words, place, (point - place) / length

    def _meet(self, within: float | None) -> tuple[Floats, float]:
        names, points, axes = map(np.array, zip(*self._lines(), strict=True))
        places = [*self.d.xipos[self.m.body_mass > MASSLESS], *self.d.xanchor]
        places += [point for *_, point in self.model.holds]
        away = np.array(places) - np.mean(places, axis=0)
        size = float(np.max(np.linalg.norm(away, axis=1))) or 1.0
        allowed = WITHIN * size if within is None else within
        centre = common_point(points, axes, allowed)
        if centre is None:
            raise FileError(
                f"{self.where}: all {len(points)} axes are parallel: a planar mechanism, "
                "whose links turn about no common point; axes of a spherical mechanism "
                "meet in one"
            )
        gaps = distances(centre, points, axes)
        worst = float(np.max(gaps))
        if worst > allowed:
            x, y, z = (plain(coordinate, size) for coordinate in centre)
            told = "".join(
                f"\n  {name}: {gap if gap > 1e-3 * allowed else 0.0:.4g} m"
                for gap, name in sorted(zip(gaps, names, strict=True), key=lambda x: -x[0])
            )
            passing = np.sum(gaps <= allowed)
            raise FileError(
                f"{self.where}: the axes do not meet in a point, so it is no spherical "
                f"mechanism. {passing} of {len(gaps)} pass the point {x}, {y}, {z} m; the "
                f"distances from it are:{told}\nAllowed is {allowed:.2g} m; give --within "
                "METRES if more is rounding, or take the other joints out of a copy of the "
                "file"
            )
        return centre, worst

    # Pairs

    def _pairs(self) -> list[Turning]:
        pairs: list[Turning] = []

        def put(text: str, links: tuple[int, int], axis: Floats, *more: Any) -> str:
            name = self._unique(text, (pair.name for pair in pairs))
            pairs.append(Turning(name, links, axis, *more))
            return name

        for body, (*joints,) in groupby(
            self.turning, self.m.jnt_bodyid.tolist().__getitem__
        ):
            below, last = self.link[self.m.body_parentid[body]], self.link[body]
            if below == last:
                them = listing(self.model.joints[k] for k in joints)
                self.notes.append(f"joint {them} cannot turn: its bodies are welded")
                continue
            for k in joints:
                above, joint = last, self.model.joints[k]
                if k != joints[-1]:
                    above = len(self.link)
                    self.link.append(above)
                    text = f"{self.model.bodies[body]}_{joint}"
                    self.names[above] = self._unique(text, self.names.values())
                axis, value = self.d.xaxis[k].copy(), float(self.d.qpos[k])
                put(joint, (below, above), axis, value, k)
                below = above
        for ends, points in self.closing.items():
            arms = np.array([point for _, point in points]) - self.centre
            lengths = np.linalg.norm(arms, axis=1)
            far = int(np.argmax(lengths))
            if lengths[far] <= self.miss or lengths[far] == 0.0:
                self.notes.append(
                    f"loop {points[far][0]} left out: it holds the centre, which does not "
                    "move"
                )
                continue
            first, axis = points[0][0], arms[far] / lengths[far]
            name = put(first, ends, axis, self.model.values.get(first, 0.0))
            one, other = map(self._name, ends)
            words = f"Closes a loop: holds {one} and {other} at a point."
            self.comments["pairs", name] = words
        if not pairs:
            raise FileError(f"{self.where}: nothing moves: all bodies are welded together")
        piece = joined(len(self.link), (pair.links for pair in pairs))
        lost = {k for pair in pairs for k in pair.links if piece[k]}
        if lost:
            raise FileError(
                f"{self.where}: link {listing(map(self._name, lost))} is not joined to the "
                "ground"
            )
        return pairs

    def _contacts(self) -> Iterator[tuple[str, Table]]:
        """Yield a rolling contact for each coupling of hinges."""
        turning = [pair for pair in self.pairs if pair.joint >= 0]
        names = [pair.name for pair in self.pairs]
        for coupling, factors in self.model.couplings:
            gears = gears_of(turning, factors)
            if isinstance(gears, str):
                them = listing(self.model.joints[k] for k in factors)
                raise FileError(
                    f"{self.where}: {coupling} couples joints {them}, but no two gears do: "
                    f"{gears}. Take it out of a copy of the file"
                )
            circles, external = gears
            names.append(self._unique(coupling, names))
            profiles = {}
            for radius, link, centre in circles:
                place = plain_axis(centre)
                circle = {
                    "kind": "circle",
                    "centre_xyz": place,
                    "radius": plain_angle(radius),
                }
                profiles[self._name(link)] = circle
            contact = {} if external else {"contact": "internal"}
            self.comments["pairs", names[-1]] = "Joints at a constant ratio: gears."
            table: Table = {"type": "Cr", "links": [*profiles], **contact}
            yield names[-1], {**table, "profiles": profiles}

    def _pair(self, pair: Turning) -> Table:
        links = [*map(self._name, pair.links)]
        table: Table = {"type": "R", "links": links, "xyz": plain_axis(pair.axis)}
        if pair.value:
            table["value"] = plain_angle(pair.value)
        return table

    def _inputs(self) -> Table:
        """Return the actuated pairs, with as many others as there are freedoms left."""
        numbers = {pair.joint: k for k, pair in enumerate(self.pairs) if pair.joint >= 0}
        driven = [numbers[joint] for joint in self.model.drives if joint in numbers]
        rest = sorted(
            set(range(len(self.pairs))).difference(driven),
            key=lambda k: (self.pairs[k].joint < 0, 0 not in self.pairs[k].links, k),
        )
        rows = self._velocity_equations(numbers)
        chosen: list[Turning] = []
        for k in [*driven, *rest]:
            more = np.vstack([rows, np.eye(len(self.pairs))[k]])
            if _rank(more) > _rank(rows):
                chosen.append(self.pairs[k])
                rows = more
        actuated = [self.pairs[k] for k in driven]
        added = [pair.name for pair in chosen if pair not in actuated]
        if added:
            what = "has" if len(added) == 1 else "have"
            self.notes.append(
                f"{numbered('input', added)} {what} no actuator; there are more freedoms "
                "than actuators"
            )
        spare = [pair.name for pair in actuated if pair not in chosen]
        if spare:
            self.notes.append(
                f"actuator of {listing(spare)} left out: the others determine the motion"
            )
        return {
            pair.name: self._ends(
                self.model.drives.get(pair.joint)
                or self.limits.get(pair.joint)
                or (pair.value - np.pi, pair.value + np.pi)
            )
            for pair in chosen
        }

    def _velocity_equations(self, numbers: Mapping[int, int]) -> Floats:
        """Return what loops and couplings say of the rates of all pairs, (m, pairs).

        `numbers` are the pairs of joints.
        """
        place = self.links.index
        ends = tuple((place(a), place(b)) for a, b in (pair.links for pair in self.pairs))
        tree = LoopTree(len(self.links), ends, tuple(range(len(ends))))
        rows = [tree.jacobian(np.array([[pair.axis for pair in self.pairs]]))[0]]
        for _, factors in self.model.couplings:
            ratio = np.zeros((1, len(ends)))
            ratio[0, [numbers[joint] for joint in factors]] = list(factors.values())
            rows.append(ratio)
        return np.concatenate(rows)

    # Inertia and loads

    def _masses(self) -> Iterator[tuple[str, Table]]:
        """Yield the links that are heavy, about the centre of the sphere."""
        m = self.m
        for link in self.links[1:]:
            heavy = [
                k
                for k, of in enumerate(self.link[: m.nbody])
                if of == link and m.body_mass[k] > MASSLESS
            ]
            if not heavy:
                continue
            mass, moment, tensor = 0.0, np.zeros(3), np.zeros((3, 3))
            weightless = m.body_gravcomp[heavy] == 1.0
            for k, light in zip(heavy, weightless, strict=True):
                one, arm = float(m.body_mass[k]), self.d.xipos[k] - self.centre
                turn = self.d.ximat[k].reshape(3, 3)
                about = turn @ np.diag(m.body_inertia[k]) @ turn.T
                tensor += moved_to_sphere_centre(about, one, arm)
                mass += one
                moment += (0.0 if light else one) * arm
            most = float(max_abs(tensor))
            table: Table = {"tensor": [[plain(x, most, THIN) for x in r] for r in tensor]}
            if not np.all(weightless) or self.model.gravity is not None:
                radius = float(np.sqrt(np.trace(tensor) / mass))
                table["mass"] = plain(mass, mass)
                table["centre"] = [plain(x, radius) for x in moment / mass]
                if np.any(weightless):
                    self.comments["mass", self._name(link)] = (
                        "Its weight is compensated: its centre counts as the sphere's."
                    )
            yield self._name(link), table

    def _loads(self, masses: Table) -> Iterator[tuple[str, Table]]:
        """Yield the loads, with names that may be taken; note what no load is."""
        m = self.m
        if self.model.gravity is not None and masses:
            acceleration = [plain(x, 1.0) for x in self.model.gravity]
            yield "gravity", {"kind": "gravity", "acceleration": acceleration}
        for k, name in ((pair.joint, pair.name) for pair in self.pairs if pair.joint >= 0):
            stiffness, viscous, dry = (
                plain(of[k], of[k])
                for of in (m.jnt_stiffness, m.dof_damping, m.dof_frictionloss)
            )
            if stiffness:
                spring = {"stiffness": stiffness, "rest": plain_angle(m.qpos_spring[k])}
                yield f"spring_{name}", {"kind": "spring", "pair": name, **spring}
            if dry:
                rubs = {"torque": dry, "speed": plain_angle(SLOW)}
                rubs |= {"viscous": viscous} if viscous else {}
                yield f"friction_{name}", {"kind": "friction", "pair": name, **rubs}
                self.notes.append(
                    f"dry friction of {name} is smoothed below {SLOW:g} rad/s"
                )
            elif viscous:
                yield f"damper_{name}", {"kind": "damper", "pair": name, "damping": viscous}
        yield from self._actuators()
        for k, name in enumerate(self.model.joints):
            if m.dof_armature[k]:
                self.notes.append(
                    f"armature of joint {name} left out, {m.dof_armature[k]:g} kg m2"
                )
            if np.any(m.jnt_stiffnesspoly[k]) or np.any(m.dof_dampingpoly[k]):
                self.notes.append(
                    f"joint {name}: spring or damper left out where not linear"
                )

    def _actuators(self) -> Iterator[tuple[str, Table]]:
        """Yield actuators without control as loads; note others that drive no hinge."""
        m, kinds = self.m, self.model.mj.mjtTrn
        for k in range(m.nu):
            name, transmission = named(m.actuator(k), "actuator", k), m.actuator_trntype[k]
            gear, bias = m.actuator_gear[k], m.actuator_biasprm[k][:3]
            first, second = (int(number) for number in m.actuator_trnid[k])
            at_joint = transmission == kinds.mjTRN_JOINT
            if np.any(m.actuator_gainprm[k]):
                if not at_joint:
                    self.notes.append(f"actuator {name} left out: it drives no hinge")
                elif np.any(bias) and not self.model.made_up:
                    self.notes.append(f"feedback of actuator {name} left out")
            elif at_joint:
                pair = next(pair.name for pair in self.pairs if pair.joint == first)
                parts = _plain(gear[0] * bias * [1.0, gear[0], gear[0]])
                terms = zip(parts, ("", f"*theta_{pair}", f"*dtheta_{pair}"), strict=True)
                told = " + ".join(f"({part}){name}" for part, name in terms if part)
                yield name, {"pair": pair, "torque": told or "0"}
            elif (
                transmission == kinds.mjTRN_SITE
                and not np.any(bias[1:])
                and (second < 0 or m.body_weldid[m.site_bodyid[second]] == 0)
            ):
                turn = self.d.site_xmat[first if second < 0 else second].reshape(3, 3)
                link = {"link": self._name(self.link[m.site_bodyid[first]])}
                axes = {"axes": "link" if second < 0 else "ground"}
                for kind, part in (("force", gear[:3]), ("moment", gear[3:])):
                    if np.any(part * bias[0]):
                        arm = self.d.site_xpos[first] - self.centre
                        point = {"point": _plain(arm)} if kind == "force" else {}
                        vector = {kind: [*map(str, _plain(turn @ (part * bias[0])))]}
                        yield name, {"kind": kind, **link, **point, **vector, **axes}
            else:
                self.notes.append(f"actuator {name} left out: it is no constant load")


def _plain(vector: Floats) -> list[float]:
    """Return the components of a vector as they stand in a file."""
    return [plain(part, float(max_abs(vector))) for part in vector]


def _rank(rows: Floats) -> int:
    return int(np.linalg.matrix_rank(rows, tol=1e-9)) if rows.size else 0
