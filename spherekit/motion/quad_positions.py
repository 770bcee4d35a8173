"""Configurations beside dead centres, in quad precision, by the decimal numbers of a file.

Beside a dead centre at a distance d in angles, a configuration is off by the rounding of
the geometry over d. In float64 nothing is left of it within 1e-8, and whether the loops
close at all is not known. Here the links have the decimal sizes of the file, 64.02 degrees
and not the float64 number next to it. Groups are placed one after another in 33 digits:
dyads by the closed form of `spherekit.sphere.dyad`, other groups by Newton's method from
float64 values. The error of the placed bodies is bounded to first order along the way.
Mechanisms with contacts are left to float64.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Array, Bools, Floats, SmallIntegers
from spherekit.conventions import EPS, Status
from spherekit.files.document import Document, LiteralNumber, parse
from spherekit.files.write import canonical_text
from spherekit.model.gears import COLLINEAR, axes_from_sizes
from spherekit.model.graph import spanning
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import LinkSizes, PoseGeometry
from spherekit.motion.loops import LoopTree, left_inverse
from spherekit.numeric.quad import QUAD_EPS, quad, quad_pi
from spherekit.planning.inputs import Assembly, Group
from spherekit.sphere.dyad import HalfAngle, middle_axis

ROUNDING_RAD = 1e3 * QUAD_EPS
"""What a body is off by that inputs place: some hundred roundings."""
INPUT_ROUNDING = 2.0 * EPS
"""An input nearer than this part of it, or of 1 rad, to a dead centre is taken to be at it:
the float64 number may stand for a decimal number of degrees."""
LARGEST_ANGLE_ERROR_RAD = 1e-5
"""Angles with a larger bound are not given."""
MAX_NEWTON_STEPS = 150
"""Towards a double root each step halves the distance: 33 digits of it take 55."""
CLOSED_STEP_RAD = 1e-27
"""A smaller last step of Newton's method has reached a simple root."""
NEAREST_START_RAD = 1e-3
"""A solution farther from the float64 values than this is not the one meant."""

Frames = tuple[Array, Array]
"""The frames (3, 3) of a pair in its first and its second link, axis last, in quad."""


class Placed(NamedTuple):
    """Configurations at n inputs.

    `values` (n, variables) rad in float64, `error` (n,) rad a bound of their errors, and
    `status` (n,): OK, AT_SINGULARITY where a group is at its dead centre to 33 digits or
    nothing is known, OUT_OF_REACH where arcs do not close. The error is infinite where the
    values are not known. `exact_values` (n, variables) and `rotations` (n, links, 3, 3),
    from link axes to ground axes, are in quad precision.
    """

    values: Floats
    error: Floats
    status: SmallIntegers
    exact_values: Array
    rotations: Array


def decimal_frames(mechanism: Mechanism) -> dict[int, Frames]:
    """Return the frames of all pairs in quad precision, by the decimals of a file."""
    document = parse(canonical_text(mechanism, "deg"), mechanism.name)
    geometry = mechanism.geometry
    frames: dict[int, Frames] = {}
    if isinstance(geometry, PoseGeometry):
        values = _angles_of_pairs(document, "value")
        for name, axis in geometry.axes.items():
            exact_axis = _unit(_numbers([repr(float(x)) for x in axis]))
            first = _across(exact_axis, np.array(axis, dtype=float))
            second = first
            if name in values:
                second = product(first, _about_z(values[name]))
            frames[mechanism.pair_number[name]] = first, second
        return frames
    float_axes = {link: axes_from_sizes(sizes) for link, sizes in geometry.links.items()}
    axes = {}
    for link, sizes in geometry.links.items():
        item = document.data["links"][link]
        arcs, angles = (
            tuple(_radians(number) for number in item.get(key, ()))
            for key in ("arcs", "angles")
        )
        exact_sizes = LinkSizes(sizes.axes, arcs, angles)
        axes[link] = {
            name: np.asarray(axis, dtype=quad())
            for name, axis in axes_from_sizes(exact_sizes).items()
        }
    zeros = _angles_of_pairs(document, "zero")
    for number, pair in enumerate(mechanism.pairs):
        first, second = (
            _reference_frame(axes[link], float_axes[link], pair.name) for link in pair.links
        )
        if pair.name in zeros:
            first = product(first, _about_z(zeros[pair.name]))
        frames[number] = first, second
    return frames


def _numbers(texts: Sequence[str]) -> Array:
    """Return decimal numbers in quad precision."""
    return np.array([text.replace("_", "") for text in texts]).astype(quad())


def _radians(number: float) -> Any:
    """Return an angle of a file in degrees in rad."""
    text = number.text if isinstance(number, LiteralNumber) else repr(number)
    return _numbers([text])[0] * (quad_pi() / 180)


def _angles_of_pairs(document: Document, key: str) -> dict[str, Any]:
    pairs: Mapping[str, Any] = document.data["pairs"]
    return {name: _radians(item[key]) for name, item in pairs.items() if key in item}


def _reference_frame(
    axes: Mapping[str, Array], float_axes: Mapping[str, Floats], name: str
) -> Array:
    """Return the frame of an axis of a link; its x axis leads to the first other axis."""
    axis = axes[name]
    for other, direction in axes.items():
        sine = np.linalg.norm(np.cross(float_axes[name], float_axes[other]))
        if sine > COLLINEAR:
            return _frame(axis, _unit(direction - dot(axis, direction)[..., None] * axis))
    return _across(axis, float_axes[name])


def _across(axis: Array, float_axis: Floats) -> Array:
    """Return the frame of an axis that no other one gives a direction."""
    helper = np.eye(3)[np.argmin(np.abs(float_axis))].astype(quad())
    return _frame(axis, _unit(np.cross(axis, helper)))


def _frame(axis: Array, first: Array) -> Array:
    """Return frames (..., 3, 3) of unit vectors at right angles, `first` the x axis."""
    return np.stack([first, np.cross(axis, first), axis], axis=-1)


def dot(a: Array, b: Array) -> Array:
    """Return products (...) of vectors (..., 3)."""
    return np.sum(a * b, axis=-1)


def _unit(a: Array) -> Array:
    return a / np.sqrt(dot(a, a))[..., None]


def _about_z(angle: Array) -> Array:
    """Return rotations (..., 3, 3) about z by angles (...) rad in quad precision."""
    angle = np.asarray(angle, dtype=quad())
    cosine, sine, nothing = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    rows = [
        [cosine, -sine, nothing],
        [sine, cosine, nothing],
        [nothing, nothing, nothing + 1],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def product(a: Array, b: Array) -> Array:
    """Return products of matrices (..., 3, 3).

    The operator @ of numpy-quaddtype 1.0 returns wrong numbers for stacks of matrices.
    """
    return np.sum(a[..., :, :, None] * b[..., None, :, :], axis=-2)


def rotated(a: Array, vector: Array) -> Array:
    """Return products of matrices (..., k, 3) with vectors (..., 3)."""
    return np.sum(a * vector[..., None, :], axis=-1)


def _transpose(a: Array) -> Array:
    return np.swapaxes(a, -1, -2)


@dataclass
class _Bodies:
    """Bodies while groups are placed, at n inputs.

    `within[link]` (n, 3, 3) are rotations from link axes to those of the link's body,
    `error` (n,) rad what these are off by at most, the inputs being exact; `rounding` (n,)
    rad is that of the inputs. `out` (n,) says where arcs do not close for any input within
    its rounding, `flat` where a group is at its dead centre for one of these.
    """

    within: dict[int, Array]
    values: Array
    error: Floats
    rounding: Floats
    out: Bools
    flat: Bools


class QuadAssembly:
    """The groups of a mechanism of R pairs, placed in quad precision."""

    def __init__(self, mechanism: Mechanism, assembly: Assembly) -> None:
        self.mechanism, self.assembly = mechanism, assembly

    @property
    def is_supported(self) -> bool:
        """Whether all pairs turn about axes, and no equation repeats others."""
        turning = all(pair.kind.has_axis for pair in self.mechanism.pairs)
        redundant = any(group.redundant for group in self.assembly.groups)
        return turning and not redundant

    @cached_property
    def frames(self) -> dict[int, Frames]:
        """The frames of all pairs, by the decimals of the file."""
        return decimal_frames(self.mechanism)

    def place(
        self,
        signs: Sequence[int],
        determinants: Sequence[float],
        q: Floats,
        starts: Floats,
    ) -> Placed:
        """Return an assembly mode at inputs.

        Parameters
        ----------
        signs, determinants
            Those of the `AssemblyMode`.
        q
            (n, inputs) rad, taken as the numbers they are.
        starts
            (n, variables) rad, the configurations in float64. Groups that are no dyads are
            closed from there.
        """
        with np.errstate(all="ignore"):
            bodies = self._with_inputs(q)
            for number, sign in enumerate(signs):
                group = self.assembly.groups[number]
                if sign:
                    self._place_dyad(bodies, group, sign)
                else:
                    determinant = determinants[number] if determinants else 0.0
                    self._close_group(bodies, group, determinant, starts)
            values = bodies.values.astype(float)
        error = np.where(np.all(np.isfinite(values), axis=1), bodies.error, np.inf)
        status = np.full(len(q), Status.OK, dtype=np.int8)
        status[bodies.flat | ~(error <= LARGEST_ANGLE_ERROR_RAD)] = Status.AT_SINGULARITY
        status[bodies.out] = Status.OUT_OF_REACH
        ground = _transpose(bodies.within[0])
        rotations = [
            product(ground, bodies.within[link]) for link in range(len(bodies.within))
        ]
        placed = np.stack(rotations, axis=1)
        return Placed(values, error, status, bodies.values, placed)

    def _with_inputs(self, q: Floats) -> _Bodies:
        """Return the bodies that links and inputs make."""
        n, mechanism = len(q), self.mechanism
        unturned = np.broadcast_to(np.eye(3).astype(quad()), (n, 3, 3))
        within = dict.fromkeys(range(len(mechanism.links)), unturned)
        values = np.full((n, len(mechanism.variable_owners)), np.nan).astype(quad())
        for pair, column in zip(self.assembly.inputs, q.T, strict=True):
            values[:, mechanism.variables_of(pair)[0]] = column.astype(quad())
        ways = spanning(mechanism.ends, self.assembly.bodies, self.assembly.inputs)
        for pair, parent, child in ways:
            first, second = self.frames[pair]
            angle = values[:, mechanism.variables_of(pair)[0]]
            turn = product(product(first, _about_z(angle)), second.T)
            ahead = mechanism.ends[pair][0] == parent
            within[child] = product(within[parent], turn if ahead else _transpose(turn))
        none = np.zeros((2, n), dtype=bool)
        rounding = INPUT_ROUNDING * np.maximum(1.0, np.max(np.abs(q), axis=1))
        error = np.full(n, ROUNDING_RAD)
        return _Bodies(within, values, error, rounding, none[0], none[1])

    def _axis(self, bodies: _Bodies, pair: int, side: int) -> Array:
        """Return the axis (n, 3) of a pair in the body of one of its links."""
        link = self.mechanism.ends[pair][side]
        return rotated(bodies.within[link], self.frames[pair][side][:, 2])

    def _place_dyad(self, bodies: _Bodies, group: Group, sign: int) -> None:
        """Place the two free bodies of a dyad, and add them to the first."""
        near, middle, far = group.dyad_places

        def axis(place: int, body: int) -> Array:
            side = group.ends[place].index(body)
            return self._axis(bodies, group.pairs[place], side)

        a, c = axis(near, 0), axis(far, 0)
        sides = (axis(near, 1), axis(middle, 1)), (axis(far, 2), axis(middle, 2))
        halves = [
            HalfAngle(0.5 * np.sqrt(dot(p - m, p - m)), 0.5 * np.sqrt(dot(p + m, p + m)))
            for p, m in sides
        ]
        more, less = dot(a + c, a + c), dot(a - c, a - c)
        # The square of the triple product is a product of two differences of cosines: of
        # the sum, or difference, of the arcs, less that of the arc between the outer axes.
        outer_sine = 0.5 * np.sqrt((more * less).astype(float))
        arcs = halves[0] - halves[1], halves[0] + halves[1]
        factors = [_over(arc, more, less) for arc in arcs]
        sizes = [np.abs(factor.astype(float)) for factor in factors]
        square = -factors[0] * factors[1]
        size = square.astype(float)

        def doubt(error: Floats) -> Floats:
            """Return what the square is off by (n,) where axes are off by an error."""
            first, second = (
                4.0 * error * (outer_sine + error + np.abs(_sine(arc))) for arc in arcs
            )
            return sizes[0] * second + sizes[1] * first + first * second

        wide_error = np.maximum(bodies.error, bodies.rounding)
        bodies.out |= size < -doubt(wide_error)
        flat = np.abs(size) <= doubt(wide_error)
        bodies.flat |= flat
        root = np.sqrt(np.where(size > doubt(bodies.error), square, 0.0 * square))
        root = root * (group.dyad_parity * sign)
        of_sum, of_rest, of_normal = middle_axis(halves[0], halves[1], more, less, root)
        b = of_sum[:, None] * (a + c) + of_rest[:, None] * (a - c)
        b = b + of_normal[:, None] * np.cross(a, c)
        turns = [
            product(
                _frame(outer, _unit(np.cross(outer, b))),
                _transpose(_frame(p, _unit(np.cross(p, m)))),
            )
            for outer, (p, m) in zip((a, c), sides, strict=True)
        ]
        sines = [*map(_sine, halves), outer_sine]
        error = np.where(flat, wide_error, bodies.error)
        bodies.error = _dyad_error(error, np.sqrt(np.where(flat, 0.0, size)), sines)
        self._merge(bodies, group, turns)
        for pair in group.pairs:
            one, other = (
                product(bodies.within[link], frame)
                for link, frame in zip(
                    self.mechanism.ends[pair], self.frames[pair], strict=True
                )
            )
            cosine, sine = (dot(one[..., k], other[..., 0]) for k in (0, 1))
            variable = self.mechanism.variables_of(pair)[0]
            bodies.values[:, variable] = np.arctan2(sine, cosine)

    @staticmethod
    def _merge(bodies: _Bodies, group: Group, turns: Sequence[Array]) -> None:
        """Make a group one body, by the rotations (n, 3, 3) of all but the first of it."""
        for links, turn in zip(group.bodies[1:], turns, strict=True):
            for link in links:
                bodies.within[link] = product(turn, bodies.within[link])

    def _close_group(
        self, bodies: _Bodies, group: Group, determinant: float, starts: Floats
    ) -> None:
        """Close the loops of an irreducible group by Newton's method from `starts`."""
        columns = [self.mechanism.variables_of(pair)[0] for pair in group.pairs]
        loops = _GroupLoops(self, bodies, group)
        float_values = starts[:, columns]
        x, size, gap = loops.closed(float_values.astype(quad()))
        flat, wrong = self._is_flat(loops, x, bodies.rounding, determinant)
        wrong &= size <= CLOSED_STEP_RAD
        if np.any(wrong):
            # The other solution lies across the dead centre.
            mirrored = x.copy()
            mirrored[wrong] = loops.across(x)[wrong]
            x, size, gap = loops.closed(mirrored)
            flat, wrong = self._is_flat(loops, x, bodies.rounding, determinant)
        distance = np.max(np.abs((x - float_values.astype(quad())).astype(float)), axis=1)
        is_near = distance < NEAREST_START_RAD
        regular = (size <= CLOSED_STEP_RAD) & ~wrong & ~flat & is_near
        wide_error = np.maximum(bodies.error, 16.0 * bodies.rounding)
        double = ~regular & flat & (gap <= wide_error) & is_near
        sensitivity = np.linalg.norm(left_inverse(loops.at(x)[2]), axis=(1, 2))
        error = np.where(regular, 4.0 * bodies.error * sensitivity, np.inf)
        # At a double root the loops open by the square of the error.
        bodies.error = np.where(double, 4.0 * np.sqrt(2.0 * wide_error), error)
        bodies.flat |= ~regular
        turns = loops.at(x)[0]
        self._merge(bodies, group, turns[1:])
        bodies.values[:, columns] = x

    @staticmethod
    def _is_flat(
        loops: "_GroupLoops", x: Array, rounding: Floats, determinant: float
    ) -> tuple[Bools, Bools]:
        """Return where a group is at its dead centre, and where it is in another mode.

        A mode has a `determinant` of one sign. Beside a dead centre at a distance s^2 of
        the input the smallest singular value of the Jacobian is about s.
        """
        jacobian = loops.at(x)[2]
        finite = np.nan_to_num(jacobian)
        least = np.linalg.svd(finite, compute_uv=False)[:, -1]
        flat = least**2 <= 8.0 * rounding
        return flat, (np.linalg.slogdet(finite)[0] * determinant < 0.0) & ~flat


class _GroupLoops:
    """The loops of a group whose bodies are known, at values (n, its pairs) in quad."""

    def __init__(self, assembly: QuadAssembly, bodies: _Bodies, group: Group) -> None:
        self.group = group
        self.tree = LoopTree(len(group.bodies), group.ends, tuple(range(len(group.pairs))))
        self.leads = [
            tuple(
                product(bodies.within[link], frame)
                for link, frame in zip(
                    assembly.mechanism.ends[pair], assembly.frames[pair], strict=True
                )
            )
            for pair in group.pairs
        ]

    def at(self, values: Array) -> tuple[list[Array], Array, Floats]:
        """Return rotations of the bodies, gaps (n, 3 loops), and the float64 Jacobian."""
        turned = [
            product(lead, _about_z(values[:, k])) for k, (lead, _) in enumerate(self.leads)
        ]
        unturned = np.broadcast_to(np.eye(3).astype(quad()), (len(values), 3, 3))
        placed: dict[int, Array] = {0: unturned}
        for place, parent, child in self.tree.placements:
            turn = product(turned[place], _transpose(self.leads[place][1]))
            ahead = self.group.ends[place][0] == parent
            placed[child] = product(placed[parent], turn if ahead else _transpose(turn))
        gaps = []
        for place in self.tree.chords:
            first, second = self.group.ends[place]
            one = product(placed[first], turned[place])
            other = product(placed[second], self.leads[place][1])
            off = product(one, _transpose(other))
            skew = off - _transpose(off)
            gaps.append(
                0.5 * np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)
            )
        vectors = [
            rotated(placed[first], lead[..., 2])
            for (first, _), (lead, _) in zip(self.group.ends, self.leads, strict=True)
        ]
        jacobian = self.tree.jacobian(np.stack(vectors, axis=1).astype(float))
        bodies = [placed[body] for body in range(len(placed))]
        return bodies, np.concatenate(gaps, axis=1), jacobian

    def closed(self, values: Array) -> tuple[Array, Floats, Floats]:
        """Return where Newton's method ends, its last step and how far loops are open."""
        n = len(values)
        values, best = values.copy(), values.copy()
        size, gap, least = np.full((3, n), np.inf)
        active = np.ones(n, dtype=bool)
        for _ in range(MAX_NEWTON_STEPS):
            _, gaps, jacobian = self.at(values)
            gap = np.max(np.abs(gaps.astype(float)), axis=1)
            better = gap < least
            best[better], least[better] = values[better], gap[better]
            inverse = left_inverse(jacobian).astype(quad())
            step = -rotated(inverse, gaps)
            length = np.max(np.abs(step.astype(float)), axis=1)
            size = np.where(active, length, size)
            active &= (length > CLOSED_STEP_RAD) & (length < 0.1)
            if not np.any(active):
                break
            values[active] += step[active]
        # Where nothing closes, and at a double root, the nearest that was met.
        settled = size <= CLOSED_STEP_RAD
        values = np.where(settled[:, None], values, best)
        return values, size, np.where(settled, gap, least)

    def across(self, values: Array) -> Array:
        """Return about where the other solution beside a dead centre lies.

        Along the direction n in which the loops hardly open they are open by
        e = s x + h x^2 / 2, with s the smallest singular value: again closed at -2 s / h.
        """
        _, _, jacobian = self.at(values)
        left, sizes, right = np.linalg.svd(jacobian)
        ahead, side = right[:, -1], left[:, :, -1]
        probe = 1e-4
        _, gaps, _ = self.at(values + (probe * ahead).astype(quad()))
        slope = sizes[:, -1]
        opened = np.sum(gaps.astype(float) * side, axis=1)
        bend = 2.0 * (opened - slope * probe) / probe**2
        return values + ((-2.0 * slope / bend)[:, None] * ahead).astype(quad())


def _over(arc: HalfAngle, more: Array, less: Array) -> Array:
    """Return the cosine of an arc less that between two axes; see `sphere.dyad`."""
    first = 0.5 * less - 2.0 * (arc.sine * arc.sine)
    second = 2.0 * (arc.cosine * arc.cosine) - 0.5 * more
    return np.where(np.abs(arc.sine) < np.abs(arc.cosine), first, second)


def _sine(arc: HalfAngle) -> Floats:
    return np.asarray(2.0 * arc.sine * arc.cosine).astype(float)


def _dyad_error(error: Floats, triple: Floats, sines: Sequence[Floats]) -> Floats:
    """Return what the bodies of a dyad are off by (n,) rad.

    Parameters
    ----------
    error
        (n,) rad, by how much the bodies that carry its axes are off.
    triple
        (n,) the triple product of its axes, the determinant of its velocity equations.
    sines
        Sines (n,) of the arcs of both bodies and of the arc between the outer axes.

    Returns
    -------
    (n,) the error over the triple product; at the dead centre, where that vanishes, the
    angles of a spherical triangle are off by the root of the error over the sines beside
    them. Infinite where a sine is of the size of the error: the dyad can turn about a line.
    """
    least = np.minimum.reduce(sines)
    folded = np.where(least > 0.0, np.sqrt(2.0 * error) / least, np.inf)
    regular = np.where(triple > 0.0, error / triple, np.inf)
    return 4.0 * (error + np.fmin(regular, np.where(folded < 0.1, folded, np.inf)))
