"""Another program's model as a spherical mechanism: what turns about one point."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain, count, groupby
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import MAX_NAME_LENGTH
from spherekit.errors import FileError, ModelError
from spherekit.exchange.foreign_axes import (
    common_point,
    distances,
    plain,
    plain_angle,
    plain_axis,
)
from spherekit.exchange.gear_couplings import (
    BevelGears,
    GearTrain,
    ImportedPair,
    find_gears,
)
from spherekit.exchange.mujoco_file import MASSLESS, ForeignModel, named
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.graph import component_labels, find_spanning_tree
from spherekit.mechanism.inertia import shift_to_sphere_centre
from spherekit.positions.loop_tree import LoopTree
from spherekit.wording import listing, numbered

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
        self.free_hinges = self._hinges_of_free_balls()
        self.pairs = self._pairs()
        self.links = [*dict.fromkeys(chain([0], *(pair.links for pair in self.pairs)))]
        self.content = {name: table for name, table in self._tables().items() if table}
        self.notes += model.notes
        self.heading = (
            f"Imported from the {model.source}.",
            f"The centre of the sphere is at {listing(plain_axis(self.centre))} m in its "
            f"world axes, which are the ground's here; axes pass it within {self.miss:.2g} "
            "m.",
            *(f"Note: {note}." for note in self.notes),
        )

    def _tables(self) -> dict[str, Table]:
        # Inputs are chosen before idler wheels come in, which the couplings say nothing of.
        inputs = self._inputs()
        train = self._find_gears()
        self._add_idlers(train)
        contacts, masses = dict(self._contacts(train.gears)), {}
        links = {self._name(link): Table() for link in self.links}
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
            "outputs": self._outputs(),
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
        still = [
            (self.m.body_parentid[k], k) for k in range(self.m.nbody) if k not in moved
        ]
        link = [*range(self.m.nbody)]
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
                children = [
                    body
                    for k, body in enumerate(self.model.bodies)
                    if k and not (self.link[k] or self.m.body_parentid[k])
                ]
                text = children[0] if len(children) == 1 else "ground"
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
                length = np.linalg.norm(point - place)
                if length > 0.0:
                    words = f"loop {first}" + f" through {other}" * (other != first)
                    yield words, place, (point - place) / length

    def _meet(self, within: float | None) -> tuple[Floats, float]:
        names, points, axes = map(np.array, zip(*self._lines(), strict=True))
        places = [*self.d.xipos[self.m.body_mass > MASSLESS], *self.d.xanchor]
        places += [point for *_, point in self.model.holds]
        away = places - np.mean(places, axis=0)
        size = np.max(np.linalg.norm(away, axis=1)) or 1.0
        allowed = WITHIN * size if within is None else within
        centre = common_point(points, axes, allowed)
        if centre is None:
            raise FileError(
                f"{self.where}: all {len(points)} axes are parallel: a planar mechanism, "
                "whose links turn about no common point; axes of a spherical mechanism "
                "meet in one"
            )
        gaps = distances(centre, points, axes)
        worst = np.max(gaps)
        if worst > allowed:
            place = listing(plain(coordinate, size) for coordinate in centre)
            told = "".join(
                f"\n  {name}: {gap if gap > 1e-3 * allowed else 0.0:.4g} m"
                for gap, name in sorted(zip(gaps, names, strict=True), key=lambda x: -x[0])
            )
            passing = np.sum(gaps <= allowed)
            raise FileError(
                f"{self.where}: the axes do not meet in a point, so it is no spherical "
                f"mechanism. {passing} of {len(gaps)} pass the point {place} m; the "
                f"distances from it are:{told}\nAllowed is {allowed:.2g} m; give --within "
                "METRES if more is rounding, or take the other joints out of a copy of the "
                "file"
            )
        return centre, worst

    # Pairs

    def _hinges_of_free_balls(self) -> set[int]:
        """Return the hinges, by number, of ball joints that constrain nothing.

        A ball joint about the centre leaves two links as free as links of a spherical
        mechanism are without a pair. It is left out if its link is held by others. Three
        hinges in its place would close the loops in twice as many ways.
        """
        body_of = {ball: self.m.jnt_bodyid[k[0]] for ball, k in self.model.balls.items()}
        on_balls = {int(body) for body in body_of.values()}
        held = [
            (self.m.body_parentid[body], body)
            for body in range(1, self.m.nbody)
            if body not in on_balls
        ]
        couples = [(self.link[one], self.link[other]) for one, other in held]
        for ends, points in self.closing.items():
            arms = [np.linalg.norm(point - self.centre) for _, point in points]
            if max(arms) > self.miss:
                couples.append(ends)
        free = set[int]()
        for ball, body in body_of.items():
            ends = self.link[self.m.body_parentid[body]], self.link[body]
            piece = component_labels(self.m.nbody, couples)
            if piece[ends[0]] == piece[ends[1]]:
                free |= set(self.model.balls[ball])
                self.notes.append(
                    f"ball joint {ball} left out: all links turn about the centre anyway"
                )
            else:
                couples.append(ends)
                self.notes.append(f"ball joint {ball} is three hinges, {ball}_x, _y and _z")
        return free

    def _pairs(self) -> list[ImportedPair]:
        pairs: list[ImportedPair] = []

        def put(text: str, links: tuple[int, int], axis: Floats, *more: Any) -> str:
            name = self._unique(text, (pair.name for pair in pairs))
            pairs.append(ImportedPair(name, links, axis, *more))
            return name

        holding = [k for k in self.turning if k not in self.free_hinges]
        for body, (*joints,) in groupby(holding, self.m.jnt_bodyid.tolist().__getitem__):
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
                    self.names[above] = self._unique(
                        f"{self.model.bodies[body]}_{joint}", self.names.values()
                    )
                put(joint, (below, above), self.d.xaxis[k], self.d.qpos[k], k)
                below = above
        for ends, points in self.closing.items():
            arms = np.array([point for _, point in points]) - self.centre
            lengths = np.linalg.norm(arms, axis=1)
            far = np.argmax(lengths)
            if lengths[far] <= self.miss:
                self.notes.append(
                    f"loop {points[far][0]} left out: it holds the centre, which does not "
                    "move"
                )
                continue
            first, value = points[0][0], self.model.values.get(points[0][0], 0.0)
            name = put(first, ends, arms[far] / lengths[far], value)
            held = " and ".join(map(self._name, ends))
            self.comments["pairs", name] = f"Closes a loop: holds {held} at a point."
        if not pairs:
            raise FileError(f"{self.where}: nothing moves: all bodies are welded together")
        piece = component_labels(len(self.link), (pair.links for pair in pairs))
        lost = {k for pair in pairs for k in pair.links if piece[k]}
        if lost:
            raise FileError(
                f"{self.where}: link {listing(map(self._name, lost))} is not joined to the "
                "ground"
            )
        return pairs

    def _find_gears(self) -> GearTrain:
        """Return the gears that the couplings of hinges stand for."""
        hinges = [pair for pair in self.pairs if pair.joint >= 0]
        try:
            return find_gears(hinges, self.model.couplings, len(self.link))
        except ModelError as error:
            names = listing(name for name, _ in self.model.couplings)
            raise FileError(
                f"{self.where}: joints are coupled by {names}. A coupling is imported as "
                f"bevel gears, but {error}. Take the couplings out of a copy of the file, "
                "or lock a joint of them"
            ) from None

    def _add_idlers(self, train: GearTrain) -> None:
        """Add the idler wheels of gears as links, each on a pair of its carrier."""
        for number, idler in enumerate(train.idlers, 1):
            self.link.append(idler.link)
            self.names[idler.link] = self._unique(f"idler_{number}", self.names.values())
            name = self._unique(f"idler_axis_{number}", (pair.name for pair in self.pairs))
            ends = idler.carrier, idler.link
            self.pairs.append(ImportedPair(name, ends, idler.axis, 0.0))
            self.links.append(idler.link)
            self.comments["pairs", name] = (
                "The idler wheel was added: two coaxial wheels need one for a ratio."
            )

    def _contacts(self, gears: Mapping[str, BevelGears]) -> Iterator[tuple[str, Table]]:
        """Yield a rolling contact for each two gears."""
        names = [pair.name for pair in self.pairs]
        for coupling, bevel_gears in gears.items():
            names.append(self._unique(coupling, names))
            profiles = {
                self._name(circle.link): {
                    "kind": "circle",
                    "centre_xyz": plain_axis(circle.centre),
                    "radius": plain_angle(circle.radius),
                }
                for circle in bevel_gears.circles
            }
            contact = {} if bevel_gears.external else {"contact": "internal"}
            self.comments["pairs", names[-1]] = "Joints at a constant ratio: gears."
            ends = {"type": "Cr", "links": [*profiles]}
            yield names[-1], {**ends, **contact, "profiles": profiles}

    def _pair(self, pair: ImportedPair) -> Table:
        value = {"value": plain_angle(pair.value)} if pair.value else {}
        links = [*map(self._name, pair.links)]
        return {"type": "R", "links": links, "xyz": plain_axis(pair.axis), **value}

    def _inputs(self) -> Table:
        """Return the actuated pairs, with as many others as there are freedoms left."""
        pairs, drives = self.pairs, self.model.drives
        numbers = {pair.joint: k for k, pair in enumerate(pairs) if pair.joint >= 0}
        driven = [numbers[joint] for joint in drives if joint in numbers]
        rest = sorted(
            set(range(len(pairs))).difference(driven),
            key=lambda k: (pairs[k].joint < 0, 0 not in pairs[k].links, k),
        )
        rows = self._velocity_equations()
        chosen: list[int] = []
        for k in [*driven, *rest]:
            more = np.vstack([rows, np.eye(len(pairs))[k]])
            if _rank(more) > _rank(rows):
                chosen.append(k)
                rows = more
        if added := [pairs[k].name for k in chosen if k not in driven]:
            self.notes.append(
                f"{numbered('input', added)} without actuator: there are more freedoms "
                "than actuators"
            )
        if spare := [pairs[k].name for k in driven if k not in chosen]:
            self.notes.append(
                f"actuator of {listing(spare)} left out: the others determine the motion"
            )
        ranges = {
            k: drives.get(pairs[k].joint) or self.limits.get(pairs[k].joint) for k in chosen
        }
        unlimited = [k for k, ends in ranges.items() if ends is None]
        half_width = self._half_width(chosen, unlimited)
        return {
            pairs[k].name: self._ends(
                ends or (pairs[k].value - half_width, pairs[k].value + half_width)
            )
            for k, ends in ranges.items()
        }

    def _half_width(self, inputs: Sequence[int], unlimited: Sequence[int]) -> float:
        """Return how far (rad) inputs without limits may go each way, at most half a turn.

        Where all pairs follow the inputs in proportion, as in gears, the limits of the
        others bound the inputs. In any combination of the inputs they are then kept.

        Parameters
        ----------
        inputs
            Numbers of the pairs that are inputs.
        unlimited
            Those of them without a range of their own.
        """
        if self.closing or not unlimited:
            return float(np.pi)
        pairs = self.pairs
        equations = np.vstack([self._velocity_equations(), np.eye(len(pairs))[inputs]])
        input_rates = np.zeros((len(equations), len(inputs)))
        input_rates[-len(inputs) :] = np.eye(len(inputs))
        rates = np.linalg.lstsq(equations, input_rates, rcond=None)[0]
        half_width = float(np.pi)
        for pair, row in zip(pairs, np.abs(rates), strict=True):
            reach = sum(row[inputs.index(k)] for k in unlimited)
            if pair.joint in self.limits and reach > 1e-9:
                low, high = self.limits[pair.joint]
                room = min(high - pair.value, pair.value - low)
                if room > 0.0:
                    half_width = min(half_width, room / reach)
        return half_width

    def _outputs(self) -> Table:
        """Return the links that sensors observe; without any, the last ones of all chains.

        These are the links on one hinge alone that no gear turns, or the only one of those
        farthest from the ground. A mechanism whose chains all close ends in the links that
        are farthest from the ground.
        """
        outputs: Table = {}
        for name, body, reference, point in self.model.outputs:
            if self.link[body] not in self.links or self.link[body] == self.link[reference]:
                continue
            table: Table = {"link": self._name(self.link[body])}
            if self.link[reference]:
                table["relative_to"] = self._name(self.link[reference])
            if point is not None:
                arm = point - self.centre
                table["xyz"] = plain_axis(arm / np.linalg.norm(arm))
            outputs[self._unique(name, outputs)] = table
        if outputs:
            return outputs
        return {self._name(link): {"link": self._name(link)} for link in self._last_links()}

    def _last_links(self) -> list[int]:
        """Return the numbers of the links at the ends of the chains, as `_outputs` says."""
        ends = [pair.links for pair in self.pairs]
        distance = {0: 0}
        for _, near, far in find_spanning_tree(ends):
            distance[far] = distance[near] + 1
        on_one_pair = [
            link for link in self.links[1:] if sum(link in pair for pair in ends) == 1
        ]
        candidates = on_one_pair or self.links
        farthest = max(distance[link] for link in candidates)
        # A gear at the end of a chain, such as the wheel of a motor, is no output.
        geared_joints = {joint for _, factors in self.model.couplings for joint in factors}
        geared = {
            link
            for pair in self.pairs
            if pair.joint in geared_joints
            for link in pair.links
        }
        free_ends = set(on_one_pair) - geared
        return [
            link for link in candidates if link in free_ends or distance[link] == farthest
        ]

    def _velocity_equations(self) -> Floats:
        """Return what loops and couplings say of the rates of all pairs, (m, pairs)."""
        place, pairs = self.links.index, self.pairs
        ends = tuple((place(a), place(b)) for _, (a, b), *_ in pairs)
        tree = LoopTree(len(self.links), ends, tuple(range(len(ends))))
        loops = tree.jacobian(np.array([[pair.axis for pair in pairs]]))[0]
        couplings = (factors for _, factors in self.model.couplings)
        return np.vstack(
            [loops, *([x.get(p.joint, 0.0) for p in pairs] for x in couplings)]
        )

    # Inertia and loads

    def _masses(self) -> Iterator[tuple[str, Table]]:
        """Yield the links that are heavy, about the centre of the sphere."""
        m = self.m
        rotors = self._rotors()
        for link in self.links[1:]:
            heavy = [
                k
                for k, of in enumerate(self.link[: m.nbody])
                if of == link and m.body_mass[k] > MASSLESS
            ]
            if not heavy and link in rotors:
                tensor = rotors[link]
                most = max_abs(tensor)
                yield (
                    self._name(link),
                    {"tensor": [[plain(x, most, THIN) for x in row] for row in tensor]},
                )
            if not heavy:
                continue
            weightless, masses = m.body_gravcomp[heavy] == 1.0, m.body_mass[heavy]
            arms, turns = self.d.xipos[heavy] - self.centre, self.d.ximat[heavy]
            turns = turns.reshape(-1, 3, 3)
            about = turns * m.body_inertia[heavy][:, None] @ np.swapaxes(turns, 1, 2)
            tensor = np.sum([*map(shift_to_sphere_centre, about, masses, arms)], axis=0)
            tensor = tensor + rotors.pop(link, 0.0)
            mass, most = np.sum(masses), max_abs(tensor)
            table: Table = {"tensor": [[plain(x, most, THIN) for x in r] for r in tensor]}
            if not np.all(weightless) or self.model.gravity is not None:
                radius = np.sqrt(np.trace(tensor) / mass)
                centre = masses * ~weightless @ arms / mass
                table["mass"] = plain(mass, mass)
                table["centre"] = [plain(x, radius) for x in centre]
                if np.any(weightless):
                    self.comments["mass", self._name(link)] = (
                        "Its weight is compensated: its centre counts as the sphere's."
                    )
            yield self._name(link), table

    def _rotors(self) -> dict[int, Floats]:
        """Return the tensors (3, 3) of the armatures of hinges on the ground, by link.

        An armature is a moment of inertia about the axis of its hinge. The link turns about
        that axis alone, so a thin disc, whose other moments are half as large, moves as the
        rotor does. On a link that moves itself, no rigid body does.
        """
        rotors: dict[int, Floats] = {}
        for pair in self.pairs:
            armature = self.m.dof_armature[pair.joint] if pair.joint >= 0 else 0.0
            if armature and pair.links[0] == 0:
                disc = 0.5 * armature * (np.eye(3) + np.outer(pair.axis, pair.axis))
                rotors[pair.links[1]] = rotors.get(pair.links[1], np.zeros((3, 3))) + disc
            elif armature:
                self.notes.append(
                    f"armature of joint {pair.name} left out, {armature:g} kg m2: the link "
                    "that carries the joint moves"
                )
        return rotors

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
                spring = {"kind": "spring", "pair": name, "stiffness": stiffness}
                yield f"spring_{name}", {**spring, "rest": plain_angle(m.qpos_spring[k])}
            if dry:
                rubs = {"kind": "friction", "pair": name, "torque": dry}
                rubs |= {"speed": plain_angle(SLOW), "viscous": viscous}
                yield f"friction_{name}", {k: x for k, x in rubs.items() if x}
                self.notes.append(
                    f"dry friction of {name} is smoothed below {SLOW:g} rad/s"
                )
            elif viscous:
                yield f"damper_{name}", {"kind": "damper", "pair": name, "damping": viscous}
        yield from self._actuators()
        for k, name in enumerate(self.model.joints):
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
            first, second = m.actuator_trnid[k]
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
                wrench, arm = gear * bias[0], self.d.site_xpos[first] - self.centre
                point = {"point": _plain(arm)}
                for kind, part, at in (
                    ("force", wrench[:3], point),
                    ("moment", wrench[3:], {}),
                ):
                    if np.any(part):
                        vector = {kind: [*map(str, _plain(turn @ part))]}
                        yield name, {"kind": kind, **link, **at, **vector, **axes}
            else:
                self.notes.append(f"actuator {name} left out: it is no constant load")


def _plain(vector: Floats) -> list[float]:
    """Return the components of a vector as they stand in a file."""
    return [plain(part, max_abs(vector)) for part in vector]


def _rank(rows: Floats) -> int:
    return int(np.linalg.matrix_rank(rows, tol=1e-9))
