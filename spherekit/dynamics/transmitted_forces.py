"""Moments and forces that pairs transmit, from the motion of the links and their loads.

Newton's and Euler's equations of all moving links about the centre O are solved for the
parts of the pairs' moments about the directions that their variables do not turn about, and
with `forces` those of their forces through O for the forces as well. The force of a contact
acts at its point, so that its moment says it where its distance from O is known.

O is at rest, so a body with the tensor I about O, the mass m and its centre of mass at c
needs

    I a + w x I w    and    m (a x c + w x (w x c)),

two sums of one form: a linear map of a, and w times that of w.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.dynamics.coordinates import CoordinateMotion
from spherekit.geometry.rotation import cross, max_abs, transpose
from spherekit.mechanism.elements import Pair
from spherekit.mechanism.friction import Bearings, ContactFriction, sliding_rate
from spherekit.mechanism.load import Called, Component, TorqueTable
from spherekit.mechanism.load_dependence import steep
from spherekit.mechanism.load_expression import Expression
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.array_rows import ArrayRows
from spherekit.positions.timing import Timing


class Loads:
    """The loads of a mechanism, ready to be evaluated at any configurations.

    `names` are those of the loads, `components` what they are made of, `owners` the
    number of the load of each component, `steep` the arguments at whose zeros and turns
    loads may change at once, see `spherekit.mechanism.load_dependence.steep`; `watched`
    says whether steps have to be looked at for that, or for functions of which nothing is
    known, `rubbing` are the components whose friction follows from reactions.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.names = tuple(load.name for load in mechanism.loads)
        by_load = [load.components(mechanism) for load in mechanism.loads]
        self.components = tuple(part for parts in by_load for part in parts)
        self.owners = [k for k, parts in enumerate(by_load) for _ in parts]
        self.steep = steep(mechanism)
        grips = {k: part.rubs.grip for k, part in enumerate(self.components) if part.rubs}
        self.rubbing = [k for k, grip in grips.items() if grip > 0.0]
        self.grips = np.array([grips[k] for k in self.rubbing])
        self.watched = bool(self.steep) or any(
            isinstance(part.magnitude, Called) for part in self.components
        )
        self._first = np.unique(self.owners, return_index=True)[1]

    def velocities(self, motion: CoordinateMotion) -> Floats:
        """Return what each component works on (n, m, components), per unit rates."""
        velocities = np.zeros((*motion.rates.shape[:2], len(self.components)))
        for column, part in enumerate(self.components):
            if part.pair:
                velocities[..., column] = self._rate(motion.rates, part.pair)
            for link, moment, _ in self.on_links(part, motion.rotations):
                worked = motion.w[:, :, link] @ moment[..., None]
                velocities[..., column] += worked[..., 0]
        return velocities

    def on_links(
        self, part: Component, rotations: Floats
    ) -> Iterator[tuple[int, Floats, Floats]]:
        """Yield the links on which a component acts, per unit of its magnitude.

        With its moment about the centre (n, 3) or (3,), and the force that it is the moment
        of, 0 of a couple, in ground axes; `rotations` (n, links, 3, 3) are of the links.
        """
        for given in part.moments:
            link = self.mechanism.link_number[given.link]
            turn = rotations[:, link]
            along = np.array(given.direction)
            if given.axes == "link":
                along = turn @ along
            if given.arm is None:
                yield link, along, 0.0 * along
            else:
                yield link, cross(turn @ given.arm, along), along

    def _rate(self, rates: Floats, pair: str) -> Floats:
        """Return the rate (...) of a pair, of a contact that at which it slides."""
        first, *second = self.mechanism.variables_of(self.mechanism.pair_number[pair])
        return rates[..., first] - np.sum(rates[..., second], axis=-1)

    def magnitudes(
        self, motion: CoordinateMotion, speed: Floats, t: Floats, carried: Floats | None
    ) -> Floats:
        """Return the magnitude of each component (n, components), N m or N.

        `speed` (n, m) are the rates of the motion's coordinates by time, `t` (n,) is in s;
        `carried` (n, k) what each of the `rubbing` carries, N on bearings and N m of
        contacts, without which these do not rub.
        """
        laws = [part.magnitude for part in self.components]
        sizes = self.evaluated(laws, motion, speed, t)
        sizes[:, self.rubbing] *= self.grips * (0.0 if carried is None else carried)
        return sizes

    def evaluated(
        self,
        laws: Sequence[Expression | Called | TorqueTable],
        motion: CoordinateMotion,
        speed: Floats,
        t: Floats,
    ) -> Floats:
        """Return the values of laws (n, laws), of what rubs per unit of grip and load.

        For the same as `magnitudes`.
        """
        names = {"t": t}
        angles = self.mechanism.angles
        values = motion.values
        rates = rates_by_time(motion, speed)
        for pair, k in angles.items():
            names |= {f"theta_{pair}": values[:, k], f"dtheta_{pair}": rates[:, k]}
        for pair in {self.components[k].pair for k in self.rubbing} - {*angles}:
            names[sliding_rate(pair)] = self._rate(rates, pair)
        results = np.empty((len(t), len(laws)))
        for column, law in enumerate(laws):
            results[:, column] = (
                law.at(t)
                if isinstance(law, TorqueTable)
                else law.evaluate({name: names[name] for name in law.names})
            )
        return results

    def parts(
        self,
        motion: CoordinateMotion,
        speed: Floats,
        t: Floats,
        carried: Floats | None = None,
    ) -> Floats:
        """Return each load's generalised forces (n, m, loads).

        Parameters
        ----------
        motion
            n rows with any m coordinates.
        speed
            (n, m) rates of these coordinates by time.
        t
            (n,) time, s.
        carried
            See `magnitudes`.
        """
        magnitudes = self.magnitudes(motion, speed, t, carried)
        powers = magnitudes[:, None] * self.velocities(motion)
        return np.add.reduceat(powers, self._first, axis=2)


def rates_by_time(motion: CoordinateMotion, speed: Floats) -> Floats:
    """Return the rates by time (n, variables), given those (n, m) of coordinates."""
    return (speed[:, None] @ motion.rates)[:, 0]


DEPENDENT = 1e-9
"""Reactions whose relative singular value is below this balance each other."""


SIDES = 6
"""Times that teeth may change the side on which they press before it is left open."""


DETERMINED = 1e-7
"""A reaction that takes a larger part than this in such a balance is not determined."""


@dataclass(frozen=True)
class DrivenState(ArrayRows):
    """n rows of a mechanism that moves, with the torques (n, inputs) that drive it.

    `motion` says how it moves by its inputs, `timing` how these move in time; `carried` as
    of `Loads.magnitudes`.
    """

    mechanism: Mechanism
    motion: CoordinateMotion
    timing: Timing
    torques: Floats
    carried: Floats | None = None


@dataclass(frozen=True)
class JointReactions:
    """Moments about O (N m) and forces through it (N), in pair axes, at n rows.

    `wrenches` (n, pairs, 6), the moment and then the force, which is NaN where it was not
    asked for; `opened` (n, pairs, 6) which components are not determined, also NaN;
    `unbalanced` (n,) is what is left over of the moments, `slides` (n, links) which links
    no pair holds at O.
    """

    wrenches: Floats
    opened: Bools
    unbalanced: Floats
    slides: Bools

    @property
    def moments(self) -> Floats:
        """(n, pairs, 3) N m."""
        return self.wrenches[..., :3]

    @property
    def across(self) -> Floats:
        """(n, pairs) N m: the part across the axis, or across the point of a contact."""
        return np.hypot(self.wrenches[..., 0], self.wrenches[..., 1])


class NewtonEuler:
    """Newton's and Euler's equations of all links at n rows, solved for what pairs hold.

    `columns` are the pair and the component of its wrench of each reaction, `matrix` (n,
    equations, columns) what these do, `is_open` (n, columns) which are not determined,
    `slides` (n, links) which links no pair holds at O, `working` (pairs, 6) the wrench of
    1 N m of loads at each pair in its axes. Solved for loads: `left` (n, links, 6) for
    reactions, `about` (n, pairs), `reactions` (n, columns), `missed` (n,) N m what misses
    the equations, `settled` (n,) whether it is known on which side teeth bear.
    """

    left: Floats
    about: Floats
    reactions: Floats
    missed: Floats
    settled: Bools

    def __init__(
        self,
        mechanism: Mechanism,
        frames: Floats,
        *,
        forces: bool = False,
        sides: Floats | None = None,
    ) -> None:
        """`frames` (n, pairs, 3, 3) are those of the pairs in ground axes.

        Without `forces` the equations of moments alone are solved. `sides` (n, pairs) are
        the signs of the moments about y of teeth with a pressure angle, 1 if left out.
        """
        self.mechanism, self.frames = mechanism, frames
        self.columns = [
            (number, k)
            for number, pair in enumerate(mechanism.pairs)
            for k in range(pair.constraints)
            if k or pair.pressure_angle is None
        ]
        if forces:
            self.columns += _force_columns(mechanism)
        distances = [x.distance for x in mechanism.pairs if x.distance is not None]
        # A length makes forces comparable with moments where contacts tie them.
        self.length = float(np.mean(distances)) if distances else 1.0
        self.working = np.stack([_working(pair) for pair in mechanism.pairs])
        self.wrenches = self._wrenches(
            np.ones(frames.shape[:2]) if sides is None else sides
        )
        links = len(mechanism.links)
        # A pair acts on its second link, and the other way round on its first.
        first, second = np.array(mechanism.ends).T
        self._on_links = np.eye(links)[second] - np.eye(links)[first]
        pairs = [pair for pair, _ in self.columns]
        self._on_pairs = np.eye(len(mechanism.pairs))[pairs]
        turned = _turned(frames[:, pairs], self.wrenches * np.repeat([1.0, self.length], 3))
        matrix = self._on_links[pairs].T[:, None] * np.swapaxes(turned, 1, 2)[:, None]
        self._rows = np.zeros((links, 6), dtype=bool)
        self._rows[1:, : 6 if forces else 3] = True
        for link in without_centre(mechanism):
            self._rows[mechanism.link_number[link], 3:] = False
        self.matrix = matrix[:, self._rows]
        self._invert(bool(distances))

    def _invert(self, tied: bool) -> None:
        """Solve the equations, and note what they leave open and who slides."""
        n, equations_of_all, columns_of_all = self.matrix.shape
        self._inverse = np.zeros((n, columns_of_all, equations_of_all))
        self.is_open = np.zeros((n, columns_of_all), dtype=bool)
        unheld = np.zeros((n, equations_of_all), dtype=bool)
        # Moments and forces are two systems unless the places of contacts tie them.
        of_row = (np.nonzero(self._rows)[1] < 3) | tied
        of_column = np.array([tied or part < 3 for _, part in self.columns], dtype=bool)
        for equations, columns in ((of_row, of_column), (~of_row, ~of_column)):
            part = self.matrix[:, equations][:, :, columns]
            left, sizes, back = np.linalg.svd(part, full_matrices=False)
            left = transpose(left)
            kept = sizes > DEPENDENT * sizes[:, :1]
            sizes[~kept] = np.inf
            places = np.ix_(np.arange(n), columns, equations)
            self._inverse[places] = transpose(back) @ (left / sizes[..., None])
            self.is_open[:, columns] = _leave(kept, back)
            unheld[:, equations] = _leave(kept, left)
        by_link = np.zeros((n, len(self.mechanism.links), 6), dtype=bool)
        by_link[:, self._rows] = unheld
        self.slides = np.any(by_link[..., 3:], axis=2)

    def _wrenches(self, sides: Floats) -> Floats:
        """Return the wrench (n, columns, 6) of each reaction of size one, in pair axes.

        The force at a point of z is along y against its moment about x, and along x as that
        about y.
        """
        wrenches = np.zeros((len(sides), len(self.columns), 6))
        for k, (number, component) in enumerate(self.columns):
            pair = self.mechanism.pairs[number]
            wrench = wrenches[:, k]
            if component > 2:
                wrench[:, component] = 1.0 / self.length
                continue
            wrench[:, component] = 1.0
            if pair.pressure_angle is not None:
                wrench[:, 0] = np.tan(pair.pressure_angle) * sides[:, number]
            if pair.distance is not None:
                wrench[:, 3] = wrench[:, 1] / pair.distance
                wrench[:, 4] = -wrench[:, 0] / pair.distance
        return wrenches

    def left_by(self, needed: Floats, about: Floats) -> Floats:
        """Return what is left for reactions (n, links, 6), `about` (n, pairs) taken off.

        `needed` (n, links, 6) moves the links, `about` N m are torques about axes, and of
        contacts what acts along their tangents.
        """
        working = _turned(self.frames, self.working)
        return needed - self._on_links.T @ (about[..., None] * working)

    def held(self, left: Floats) -> tuple[Floats, Floats]:
        """Return the reactions (n, columns) and what misses the equations (n,), N m."""
        right = (left * np.repeat([1.0, self.length], 3))[:, self._rows][..., None]
        reactions = self._inverse @ right
        # A step of refinement brings back the digits that the inverse loses.
        reactions = reactions + self._inverse @ (right - self.matrix @ reactions)
        return reactions[..., 0], max_abs(right - self.matrix @ reactions, axis=(1, 2))

    def solve(self, needed: Floats, about: Floats) -> None:
        """Solve for `left_by` of the same: `left`, `about`, `reactions` and `missed`."""
        self.about, self.left = about, self.left_by(needed, about)
        self.reactions, self.missed = self.held(self.left)

    @property
    def opened(self) -> Bools:
        """(n, pairs, 6) which components of the pairs' wrenches are not determined."""
        return self.on_pairs(self.is_open.astype(float)) != 0.0

    def on_pairs(self, reactions: Floats) -> Floats:
        """Return reactions (n, columns) as wrenches (n, pairs, 6) in pair axes."""
        return self._on_pairs.T @ (reactions[..., None] * self.wrenches)


def _turned(frames: Floats, wrenches: Floats) -> Floats:
    """Return wrenches (..., k, 6) in ground axes, from those of frames (n, k, 3, 3)."""
    halves = wrenches.reshape(*wrenches.shape[:-1], 2, 3) @ transpose(frames)
    return halves.reshape(*frames.shape[:2], 6)


def _working(pair: Pair) -> Floats:
    """Return the wrench (6,), in pair axes, of 1 N m about an axis or along a tangent."""
    wrench = np.zeros(6)
    wrench[2 if pair.kind.has_axis else 1] = 1.0
    if pair.distance is not None:
        wrench[3] = 1.0 / pair.distance
    return wrench


def without_centre(mechanism: Mechanism) -> list[str]:
    """Return the moving links with inertia whose centre of mass is not known."""
    return [
        mass.link
        for mass in mechanism.masses
        if mass.link != mechanism.ground and (mass.mass is None or mass.centre is None)
    ]


def _force_columns(mechanism: Mechanism) -> list[tuple[int, int]]:
    """Return the components of forces that moments do not say: 3, 4 and 5 are x, y, z."""
    loads = mechanism.loads
    columns = []
    floating = {x.pair for x in loads if isinstance(x, Bearings) and x.floats}
    rubs = {load.pair for load in loads if isinstance(load, ContactFriction)}
    for number, pair in enumerate(mechanism.pairs):
        if pair.kind.has_axis:
            most = 5 if pair.name in floating else 6
            columns += [(number, axis) for axis in range(3, most)]
        elif pair.distance is None:
            # Against the moment about x the force is along y, as that about y along x.
            held = 2 if pair.name in rubs else pair.constraints
            columns += [(number, 4 - axis) for axis in range(held)]
    return columns


def _leave(kept: Bools, vectors: Floats) -> Bools:
    """Return which (n, k) of unit vectors do not lie in the span of the kept rows."""
    return 1.0 - np.sum(kept[..., None] * vectors**2, axis=1) > DETERMINED


def transmitted(driven: DrivenState, *, forces: bool = False) -> JointReactions:
    """Return what every pair transmits; open components are NaN.

    Where links slide, forces are not determined, for the loads would move the links.
    """
    balance = balanced(driven, forces)
    wrenches = balance.on_pairs(balance.reactions)
    wrenches += balance.about[..., None] * balance.working
    opened = balance.opened | ~balance.settled[:, None, None]
    wrenches[opened] = np.nan
    if not forces:
        wrenches[..., 3:], opened[..., 3:] = np.nan, False
    sliding = np.any(balance.slides, axis=1)
    if np.any(sliding):
        alone = transmitted(driven.rows(sliding))
        wrenches[sliding], opened[sliding] = alone.wrenches, alone.opened
        opened[sliding, :, 3:] = True
        balance.missed[sliding] = alone.unbalanced
    return JointReactions(wrenches, opened, balance.missed, balance.slides)


def balanced(driven: DrivenState, forces: bool) -> NewtonEuler:
    """Return the equations of all links solved for what moves and drives them.

    Teeth press on the side on which they turn the wheels, and that follows from the
    solution: so it is solved again where they were taken to press on the other.
    """
    mechanism = driven.mechanism
    motion = driven.motion
    timing = driven.timing
    loads, about = applied(driven)
    needed = accelerating(mechanism, motion, timing.ddq)
    needed += gyroscopic(mechanism, motion, timing.dq)
    toothed = np.array([pair.pressure_angle is not None for pair in mechanism.pairs])
    sides = np.ones(motion.frames.shape[:2])
    for _ in range(SIDES):
        balance = NewtonEuler(mechanism, motion.frames, forces=forces, sides=sides)
        balance.solve(needed - loads, about)
        turned = (balance.on_pairs(balance.reactions)[..., 1] * sides < 0.0) & toothed
        if not np.any(turned):
            break
        sides = np.where(turned, -sides, sides)
    balance.settled = ~np.any(turned, axis=1)
    return balance


def accelerating(mechanism: Mechanism, motion: CoordinateMotion, change: Floats) -> Floats:
    """Return the wrenches (n, links, 6) that the coordinates' accelerations (n, m) need.

    Forces of links whose centre of mass is not known are left out.
    """
    return _of_inertia(mechanism, motion, np.einsum("ni,nila->nla", change, motion.w))


def gyroscopic(mechanism: Mechanism, motion: CoordinateMotion, speed: Floats) -> Floats:
    """Return those (n, links, 6) that rates (n, m) need while these stay as they are."""
    w = np.einsum("ni,nila->nla", speed, motion.w)
    bend = np.einsum("ni,nk,nikla->nla", speed, speed, motion.dw)
    momenta = _of_inertia(mechanism, motion, w).reshape(*w.shape[:2], 2, 3)
    turning = cross(w[:, :, None], momenta).reshape(*w.shape[:2], 6)
    return _of_inertia(mechanism, motion, bend) + turning


def _of_inertia(mechanism: Mechanism, motion: CoordinateMotion, vectors: Floats) -> Floats:
    """Return I v and m v x c of the links' vectors v (n, links, 3), in ground axes."""
    wrenches = np.zeros((*vectors.shape[:2], 6))
    for mass in mechanism.masses:
        link = mechanism.link_number[mass.link]
        turn = motion.rotations[:, link]
        vector = vectors[:, link]
        tensor = turn @ mass.tensor @ transpose(turn)
        wrenches[:, link, :3] = (tensor @ vector[..., None])[..., 0]
        if mass.mass is not None and mass.centre is not None:
            wrenches[:, link, 3:] = mass.mass * cross(vector, turn @ mass.centre)
    return wrenches


def applied(driven: DrivenState) -> tuple[Floats, Floats]:
    """Return the wrenches of loads on links (n, links, 6), and torques at pairs (n, pairs).

    Those of the drives are among the torques.
    """
    mechanism = driven.mechanism
    motion = driven.motion
    timing = driven.timing
    loads = Loads(mechanism)
    magnitudes = loads.magnitudes(motion, timing.dq, timing.t, driven.carried)
    wrenches = np.zeros((len(timing.t), len(mechanism.links), 6))
    about = np.zeros((len(timing.t), len(mechanism.pairs)))
    for size, part in zip(magnitudes.T, loads.components, strict=True):
        if part.pair:
            about[:, mechanism.pair_number[part.pair]] += size
        for link, moment, force in loads.on_links(part, motion.rotations):
            wrenches[:, link, :3] += size[:, None] * moment
            wrenches[:, link, 3:] += size[:, None] * force
    inputs = [mechanism.pair_number[item.pair] for item in mechanism.inputs]
    about[:, inputs] += driven.torques
    return wrenches, about
