"""Configurations and rates in 90 digits, with their conditioning.

Nothing here calls a solver of spherekit. The data are the frames of the pairs in their
links, as doubles. They are made orthonormal in 90 digits, and from there on everything is
exact up to rounding of that precision.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from spherekit.errors import ModelError
from spherekit.mechanism.joint import revolute
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.loop_tree import LoopTree

import mpmath as mp  # isort: skip

DIGITS = 90
"""Number of decimal digits."""

SMALL = mp.mpf(10) ** -30
"""Change of the data, and of the input, by which derivatives are computed.

Differences then have 30 exact digits, of 90.
"""

CHANGES = 3
"""Number of random changes of all data that are tried for the conditioning."""

MAX_REFERENCE_NEWTON_STEPS = 60
"""Largest number of steps of Newton's method."""

LONGEST_NEWTON_STEP_RAD = mp.mpf("0.3")
"""Longer steps (rad) are shortened, so that Newton's method stays near its start."""

LAST_STEP_RAD = mp.mpf(10) ** (35 - DIGITS)
"""Newton's method ends after a step (rad) that is smaller than this. Because it converges
quadratically, the result is then exact to all digits."""

CLOSURE_RESIDUAL_RAD = mp.mpf(10) ** (10 - DIGITS)
"""Loops count as closed if their residual (rad) is smaller."""

LAST_SINGULAR_STEP = mp.mpf(10) ** (45 - DIGITS)
"""Newton's method for a singular configuration ends after a step smaller than this.

Its derivatives are difference quotients. It therefore converges linearly, by 30 digits in
each step.
"""

Exact = Any
"""An array of mpmath numbers."""

_to_number = np.frompyfunc(mp.mpf, 1, 1)
_square_root = np.frompyfunc(mp.sqrt, 1, 1)


class NoSolution(Exception):
    """The loops do not close at these inputs."""


def exact(values: Any) -> Exact:
    """Return an array of floats as numbers of 90 digits, without rounding."""
    return _to_number(np.asarray(values, dtype=object) + mp.mpf(0))


def length(vectors: Exact) -> Exact:
    """Return the lengths (...,) of vectors (..., 3)."""
    return _square_root(np.sum(vectors * vectors, axis=-1))


def cross(a: Exact, b: Exact) -> Exact:
    """Return a x b for arrays (..., 3)."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def solve_equations(matrix: Exact, right_side: Exact) -> Exact:
    """Solve linear equations by elimination with partial pivoting.

    Parameters
    ----------
    matrix
        (n, n) matrix.
    right_side
        (n, m) right sides.

    Returns
    -------
    (n, m) solutions.

    Raises
    ------
    NoSolution
        If the matrix is singular.
    """
    n = len(matrix)
    rows = np.concatenate([matrix, right_side], axis=1)
    for k in range(n):
        pivot = k + int(np.argmax(np.abs(rows[k:, k])))
        if rows[pivot, k] == 0:
            raise NoSolution
        rows[[k, pivot]] = rows[[pivot, k]]
        rows[k, k:] = rows[k, k:] / rows[k, k]
        below = np.flatnonzero(rows[k + 1 :, k] != 0) + k + 1
        rows[below, k:] -= rows[below, k, None] * rows[k, None, k:]
    solutions = rows[:, n:]
    for k in range(n - 1, 0, -1):
        solutions[:k] -= rows[:k, k, None] * solutions[k, None]
    return solutions


@final
@dataclass(frozen=True)
class GeometryData:
    """The data of a mechanism, which may be changed slightly.

    Attributes
    ----------
    frames
        (2, pairs, 3, 3) frame of each pair in its first and in its second link. The third
        column is the axis of an R pair, or the centre of a circle.
    radii
        (2, pairs) radii (rad) of circles; 1 for R pairs.
    directions
        (2, pairs) 1, or -1 if the arc length along a circle runs in the opposite sense.
    """

    frames: Exact
    radii: Exact
    directions: Any

    def change_randomly(self, rng: np.random.Generator) -> "GeometryData":
        """Rotate each frame about its three axes, and scale each radius, by `SMALL`."""
        frames = self.frames.copy()
        for side, pair in np.ndindex(frames.shape[:2]):
            frames[side, pair] = _rotate_randomly(frames[side, pair], rng)
        factors = exact(rng.uniform(-1, 1, self.radii.shape))
        return replace(self, frames=frames, radii=self.radii * (1 + SMALL * factors))


def _rotate_randomly(frame: Exact, rng: np.random.Generator) -> Exact:
    """Return a frame (3, 3) rotated by up to `SMALL` about each coordinate axis."""
    x, y, z = rng.uniform(-1, 1, 3).tolist()
    rotation = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=object)
    return frame + SMALL * (rotation @ frame)


@final
@dataclass(frozen=True)
class PlacedLinks:
    """The links at one choice of all variables.

    Attributes
    ----------
    rotations
        (links, 3, 3) rotations from link axes to ground axes.
    vectors
        (variables, 3) angular velocity of the second link of a pair relative to the first
        one, per rate of the variable, in ground axes.
    residual
        (3 loops,) closure residual (rad).
    """

    rotations: Exact
    vectors: Exact
    residual: Exact


@final
class Reference:
    """A mechanism of R pairs and contacts of circles, in 90 digits.

    Parameters
    ----------
    mechanism
        The mechanism.
    moved
        Name of the input that moves, by default the first.

    Attributes
    ----------
    count
        Number of variables.
    inputs
        Numbers of the variables of all inputs.
    moved
        Number of the variable of the input that moves. The others stand still.
    angles
        Numbers of the variables of R pairs.
    """

    def __init__(self, mechanism: Mechanism, moved: str | None = None) -> None:
        self.mechanism = mechanism
        self.tree = LoopTree.of_mechanism(mechanism)
        self.joints = make_joints(mechanism)
        self.count = len(self.tree.pair_of_variable)
        input_pairs = [item.pair for item in mechanism.inputs]
        variables = [
            mechanism.variables_of(mechanism.pair_number[pair])[0] for pair in input_pairs
        ]
        self.inputs = tuple(variables)
        self.moved = variables[input_pairs.index(moved) if moved else 0]
        self.angles = [
            v for v, p in enumerate(self.tree.pair_of_variable) if self.joints[p].has_axis
        ]
        with mp.workdps(DIGITS):
            self.data = self._read_data()

    def _read_data(self) -> GeometryData:
        """Return the data of the mechanism, with orthonormal frames.

        Raises
        ------
        ModelError
            If a profile is not a circle.
        """
        pair_count = len(self.joints)
        frames = np.zeros((2, pair_count, 3, 3))
        radii = np.ones((2, pair_count))
        directions = np.ones((2, pair_count), dtype=int)
        for k, joint in enumerate(self.joints):
            if joint.has_axis:
                hinge = revolute(joint)
                frames[0, k] = hinge.first
                frames[1, k] = hinge.second
                continue
            pair = self.mechanism.pairs[k]
            assert pair.profiles is not None
            curves = [profile.curve for profile in joint.contact_profiles]
            for side, curve in enumerate(curves):
                profile = pair.profiles[side]
                if profile.kind not in ("circle", "great_circle"):
                    raise ModelError(
                        f"{self.mechanism.name}: pairs.{pair.name}: the "
                        f'profile of link {pair.links[side]} is "'
                        f'{profile.kind}", but this reference is of circles alone; '
                        "compare with spherekit.proof.reference_rows for other profiles"
                    )
                directions[side, k] = -1 if curve.backwards else 1
                frames[side, k] = curve.path.axes  # type: ignore[union-attr]
                radii[side, k] = profile.radius or 0.5 * np.pi
        axis = exact(frames[..., 2])
        axis = axis / length(axis)[..., None]
        x = exact(frames[..., 0])
        x = x - np.sum(x * axis, axis=-1)[..., None] * axis
        x = x / length(x)[..., None]
        orthonormal = np.stack([x, cross(axis, x), axis], -1)
        return GeometryData(orthonormal, exact(radii), directions)

    def _pair_frame(
        self, data: GeometryData, side: int, pair: int, value: Exact
    ) -> tuple[Exact, Exact]:
        """Return the moving frame of a pair in one of its links.

        Parameters
        ----------
        data
            The data of the mechanism.
        side
            0 for the first link, 1 for the second one.
        pair
            Number of the pair.
        value
            Angle (rad) of an R pair, or arc length (rad) along the circle.

        Returns
        -------
        frame
            (3, 3) frame. On a circle its columns are the tangent, the normal and the point.
        curvature
            Geodesic curvature of the circle, 0 for R pairs.
        """
        joint = self.joints[pair]
        frame = data.frames[side, pair]
        if joint.has_axis:
            if side == 1:
                return frame, mp.mpf(0)
            # The frame in the first link rotates about the axis.
            c, s = mp.cos(value), mp.sin(value)
            x, y, z = frame.T
            return np.stack([c * x + s * y, c * y - s * x, z], axis=-1), mp.mpf(0)
        start = joint.contact_profiles[side].start
        direction = int(data.directions[side, pair])
        radius = data.radii[side, pair]
        sine, cosine = mp.sin(radius), mp.cos(radius)
        angle = direction * (value + start) / sine
        c, s = mp.cos(angle), mp.sin(angle)
        x, y, z = frame.T
        point = cosine * z + sine * (c * x + s * y)
        tangent = direction * (c * y - s * x)
        moving_frame = np.stack([tangent, cross(point, tangent), point], axis=-1)
        return moving_frame, direction * cosine / sine

    def place(self, values: Exact, data: GeometryData | None = None) -> PlacedLinks:
        """Place the links by all variables.

        Parameters
        ----------
        values
            (variables,) angles and arc lengths (rad).
        data
            The data, by default those of the mechanism.
        """
        data = data or self.data
        tree = self.tree
        pair_frames: list[tuple[Exact, Exact]] = []
        # Vectors of the variables of each pair, in the axes of its first link.
        local_vectors: list[list[Exact]] = []
        variable = 0
        for pair, joint in enumerate(self.joints):
            last_variable = variable + joint.variable_count - 1
            first, k1 = self._pair_frame(data, 0, pair, values[variable])
            second, k2 = self._pair_frame(data, 1, pair, values[last_variable])
            pair_frames.append((first, second))
            normal = first[:, 1]
            point = first[:, 2]
            if joint.has_axis:
                local_vectors.append([point])
            elif last_variable == variable:
                # Rolling: both profiles run by the same arc length.
                local_vectors.append([(k1 - k2) * point])
            else:
                local_vectors.append([normal + k1 * point, -(normal + k2 * point)])
            variable = last_variable + 1
        rotations = np.empty((tree.count, 3, 3), dtype=object)
        rotations[0] = exact(np.eye(3))
        for pair, parent, child in tree.placements:
            first, second = pair_frames[pair]
            relative = first @ second.T
            first_link, _ = tree.ends[pair]
            if first_link != parent:
                relative = relative.T
            rotations[child] = rotations[parent] @ relative
        residual = []
        for chord in tree.chords:
            first_link, second_link = tree.ends[chord]
            first, second = pair_frames[chord]
            first_frame = rotations[first_link] @ first
            second_frame = rotations[second_link] @ second
            difference = first_frame @ second_frame.T
            skew = (difference - difference.T) / 2
            residual += [skew[2, 1], skew[0, 2], skew[1, 0]]
        vectors = [
            rotations[first_link] @ vector
            for (first_link, _), pair_vectors in zip(tree.ends, local_vectors, strict=True)
            for vector in pair_vectors
        ]
        return PlacedLinks(rotations, np.array(vectors), np.array(residual, dtype=object))

    def jacobian(self, placed: PlacedLinks) -> Exact:
        """Return the derivatives (3 loops, variables) of the closure residual."""
        signs = self.tree.signs
        grid = signs[:, None, :] * placed.vectors.T[None]
        return grid.reshape(3 * len(self.tree.chords), self.count)

    def closed(self, values: Exact, held: Sequence[int]) -> Exact:
        """Close the loops by Newton's method.

        Parameters
        ----------
        values
            (variables,) start values (rad).
        held
            Numbers of the variables that do not change.

        Returns
        -------
        (variables,) closed configuration (rad).

        Raises
        ------
        NoSolution
            If Newton's method does not converge.
        """
        passive = [v for v in range(self.count) if v not in held]
        values = values.copy()
        for _ in range(MAX_REFERENCE_NEWTON_STEPS):
            placed = self.place(values)
            matrix = self.jacobian(placed)[:, passive]
            change = solve_equations(matrix, -placed.residual[:, None])[:, 0]
            step_length = np.max(np.abs(change))
            if step_length > LONGEST_NEWTON_STEP_RAD:
                change = change * (LONGEST_NEWTON_STEP_RAD / step_length)
            values[passive] = values[passive] + change
            # The residual is that before the step.
            residual = np.max(np.abs(placed.residual))
            if step_length < LAST_STEP_RAD and residual < CLOSURE_RESIDUAL_RAD:
                return values
        raise NoSolution

    def rates(self, placed: PlacedLinks) -> tuple[Exact, Exact]:
        """Return the rates by the input that moves.

        Returns
        -------
        variable_rates
            (variables,) rates of the variables.
        link_rates
            (links, 3) angular velocities of the links in ground axes.
        """
        matrix = self.jacobian(placed)
        passive = [v for v in range(self.count) if v not in self.inputs]
        rates = exact(np.zeros(self.count))
        rates[self.moved] = mp.mpf(1)
        rates[passive] = solve_equations(matrix[:, passive], -matrix[:, [self.moved]])[:, 0]
        return rates, self.tree.paths @ (rates[:, None] * placed.vectors)

    def find_singular(self, values: Exact, resting: int, held: Sequence[int] = ()) -> Exact:
        """Return the configuration nearby in which a variable is stationary.

        Newton's method solves the closure equations together with J v = 0, where the vector
        v of rates has no entry for the stationary variable, and is normalised.

        Parameters
        ----------
        values
            (variables,) a configuration (rad) near the singular one.
        resting
            Number of the variable that is stationary: the input at a dead centre of the
            input (type II), or the variable of an output's pair (type I).
        held
            Numbers of the inputs that keep their values.

        Raises
        ------
        NoSolution
            If Newton's method does not converge.
        """
        free = [v for v in range(self.count) if v not in held]
        moving = [v for v in free if v != resting]
        start_jacobian = self.jacobian(self.place(values))[:, moving]
        start_rates = exact(np.linalg.svd(start_jacobian.astype(float))[2][-1])
        # The unknowns are the free variables, then the rates of the moving ones.
        unknowns = np.concatenate([values[free], start_rates])

        def equations(unknowns: Exact) -> Exact:
            configuration = values.copy()
            configuration[free] = unknowns[: len(free)]
            placed = self.place(configuration)
            rates = unknowns[len(free) :]
            loop_rates = self.jacobian(placed)[:, moving] @ rates
            normalisation = start_rates @ rates - 1
            return np.concatenate([placed.residual, loop_rates, [normalisation]])

        for _ in range(MAX_REFERENCE_NEWTON_STEPS):
            residual = equations(unknowns)
            columns = []
            for k in range(len(unknowns)):
                changed = unknowns.copy()
                changed[k] += SMALL
                columns.append((equations(changed) - residual) / SMALL)
            matrix = np.stack(columns, axis=1)
            change = solve_equations(matrix, -residual[:, None])[:, 0]
            unknowns = unknowns + change
            if np.max(np.abs(change)) < LAST_SINGULAR_STEP:
                singular = values.copy()
                singular[free] = unknowns[: len(free)]
                return singular
        raise NoSolution

    def tangent(self, values: Exact, held: Sequence[int] = ()) -> Exact:
        """Return the unit direction (variables,) in which the mechanism moves.

        Parameters
        ----------
        values
            (variables,) a closed configuration (rad).
        held
            Numbers of the inputs that keep their values.
        """
        free = [v for v in range(self.count) if v not in held]
        matrix = self.jacobian(self.place(values))[:, free]
        # The null vector in doubles makes the matrix square and regular.
        approximate = np.linalg.svd(matrix.astype(float))[2][-1]
        bordered = np.concatenate([matrix, exact(approximate)[None]])
        right_side = exact(np.zeros((len(free), 1)))
        right_side[-1, 0] = mp.mpf(1)
        null_vector = solve_equations(bordered, right_side)[:, 0]
        tangent = exact(np.zeros(self.count))
        tangent[free] = null_vector / mp.sqrt(np.sum(null_vector * null_vector))
        return tangent


@final
@dataclass(frozen=True)
class Truth:
    """Quantities at one configuration in 90 digits, with their conditioning.

    Attributes
    ----------
    values
        (variables,) the configuration (rad).
    angles
        (R variables,) angles (rad) of R pairs.
    rotations
        (links, 3, 3) rotations from link axes to ground axes.
    rates
        (links, 3) angular velocities by the input, in ground axes.
    derivatives
        (links, 3) their derivatives by the input; None if they were not asked for.
    condition
        Conditioning of each quantity by its name. It is relative to the size of the
        quantity if that is above 1; for angles and rotations it is in rad/rad.
    changed
        The same arrays after each random change of the data, by name.
    """

    values: Exact
    angles: Exact
    rotations: Exact
    rates: Exact
    derivatives: Exact | None
    condition: dict[str, float]
    changed: tuple[dict[str, Exact], ...]

    def pole(self, i: int, j: int) -> tuple[Exact, float, float]:
        """Return the pole axis of links i and j.

        Returns
        -------
        direction
            (3,) unit vector in ground axes; zero if the links rest relative to each other.
        conditioning
            Conditioning of the direction, infinite if the links rest.
        rate
            Size of the relative angular velocity by the input.
        """
        relative = self.rates[j] - self.rates[i]
        size = length(relative)
        if size == 0:
            return relative, float("inf"), 0.0
        # The cross product with the changed vector is the change of the direction.
        changed_rates = [changed["rates"] for changed in self.changed]
        changes = [length(cross(w[j] - w[i], relative)) for w in changed_rates]
        return relative / size, _conditioning(max(changes), size * size), float(size)


def _conditioning(change: Exact, size: Exact) -> float:
    """Return a change relative to a size, for a unit change of the data; at least 1."""
    return max(1.0, float(change / size / SMALL))


def truth(reference: Reference, values: Exact, derivatives: bool = True) -> Truth:
    """Return the quantities at a closed configuration in 90 digits, with conditioning.

    The conditioning is the largest change of a quantity over changes of all data at once:
    each frame of each pair is rotated by up to one unit about each of its axes, each radius
    is scaled and each input is moved by up to one unit, times itself if it is above 1.
    Units are infinitesimal (1e-30), the changes random, and the same every time.

    Parameters
    ----------
    reference
        The mechanism.
    values
        (variables,) the configuration (rad).
    derivatives
        Whether the derivatives of the rates are computed.
    """
    with mp.workdps(DIGITS):
        return _compute_truth(reference, values, derivatives)


def _compute_truth(reference: Reference, values: Exact, derivatives: bool) -> Truth:
    """Return the result of `truth`, with the present precision of mpmath."""
    passive = [v for v in range(reference.count) if v not in reference.inputs]
    nominal_jacobian = reference.jacobian(reference.place(values))[:, passive]
    inverse = solve_equations(nominal_jacobian, exact(np.eye(len(passive))))

    def close_nearby(values: Exact, data: GeometryData) -> Exact:
        """Close the loops after a change by about `SMALL`.

        Each step with the constant inverse gains 30 digits, so that two are enough.
        """
        values = values.copy()
        for _ in range(2):
            residual = reference.place(values, data).residual
            values[passive] = values[passive] - inverse @ residual
        return values

    def compute_quantities(values: Exact, data: GeometryData) -> dict[str, Exact]:
        placed = reference.place(values, data)
        variable_rates, link_rates = reference.rates(placed)
        quantities = {
            "angles": values[reference.angles],
            "rotations": placed.rotations,
            "rates": link_rates,
        }
        if derivatives:
            ahead = close_nearby(values + SMALL * variable_rates, data)
            _, rates_ahead = reference.rates(reference.place(ahead, data))
            quantities["derivatives"] = (rates_ahead - link_rates) / SMALL
        return quantities

    nominal = compute_quantities(values, reference.data)
    sizes = {"angles": mp.mpf(1), "rotations": mp.mpf(1)}
    for name in nominal.keys() - sizes.keys():
        sizes[name] = max(mp.mpf(1), max(length(nominal[name])))
    condition = dict.fromkeys(nominal, 1.0)
    rng = np.random.default_rng(1)
    changed: list[dict[str, Exact]] = []
    for _ in range(CHANGES):
        data = reference.data.change_randomly(rng)
        changed_values = values.copy()
        for variable in reference.inputs:
            unit = max(mp.mpf(1), abs(changed_values[variable]))
            changed_values[variable] += SMALL * unit * rng.uniform(-1, 1)
        quantities = compute_quantities(close_nearby(changed_values, data), data)
        changed.append(quantities)
        for name, array in nominal.items():
            difference = np.abs(array - quantities[name])
            change = np.max(difference) if np.size(array) else mp.mpf(0)
            condition[name] = max(condition[name], _conditioning(change, sizes[name]))
    return Truth(
        values,
        nominal["angles"],
        nominal["rotations"],
        nominal["rates"],
        nominal.get("derivatives"),
        condition,
        tuple(changed),
    )
