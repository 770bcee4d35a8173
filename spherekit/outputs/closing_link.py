"""A pointing output whose mechanism consists of dyads once one link is taken out.

While the output points in a direction, it can still turn about that direction by an angle,
the *turn*. If the turn is held too, a mechanism may consist of dyads and one more link with
two pairs, the *closing link* (called a bar in the names of legs). Its arc is one equation
for the turn,

    f = p . q - cos(arc) = 0,

with the axes p and q of its pairs as the neighbouring links carry them. Each root is a
configuration. The derivative of the residual f follows exactly from the rates of the dyads.
"""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import TURN
from spherekit.errors import CountError
from spherekit.geometry.triangle import frame_from, frame_toward, perpendicular
from spherekit.geometry.vectors import cross_columns, dot_columns
from spherekit.mechanism.joint import revolutes
from spherekit.numerics.angles import wrap
from spherekit.numerics.bracketed_zeros import find_bracketed_zeros
from spherekit.outputs.dyad_chain import DyadChain, Signs
from spherekit.outputs.virtual_output import VirtualOutputChain
from spherekit.outputs.working_mode import RateFraction, WorkingMode
from spherekit.planning.assembly_plan import Assembly, split_into_groups
from spherekit.planning.mobility import merge_locked_links
from spherekit.positions.loop_closure import newton
from spherekit.positions.position_solver import PositionSolver
from spherekit.tolerances import CLOSING_RESIDUAL

TURN_SAMPLES = 120
"""Number of turns between which roots of the residual are bracketed.

Larger: fewer pairs of close roots are missed, in more time.
"""

MAX_TURN_STEPS = 12
"""Largest number of Newton steps for the turn from a start.

Larger: more starts far from a root converge. Smaller: less time where none does.
"""

MAX_TURN_STEP_RAD = 0.3
"""Longest Newton step (rad) of the turn.

Larger: the method can leave the neighbourhood of the start. Smaller: more steps.
"""

TURN_STEP_TOLERANCE_RAD = 1e-11
"""Newton step (rad) of the turn below which the method has converged.

The next step would be below the rounding error. Larger: turns with larger errors count as
converged. Smaller: rounding errors are reported as NOT_CONVERGED.
"""

SAME_TURN_RAD = 1e-7
"""Difference (rad) of turns below which two roots are one.

Larger: two close solutions count as one. Smaller: a root that was bracketed twice counts as
two.
"""


@dataclass(frozen=True)
class TurnSolutions:
    """Configurations of a mechanism in which the output link points in given directions.

    The output link can still turn about the direction in which it points. The angle of this
    rotation is called the turn. One link of the mechanism, the closing link, fits only at
    certain turns: the angle between its two pair axes must be the arc a of the link. At a
    turn, the other links determine the actual angle d between these axes. The link fits
    where the residual f = cos(d) - cos(a) is 0. Each such turn is a solution. Solutions are
    ordered by direction and turn.

    Attributes
    ----------
    row
        (k,) index of the direction to which each of the k solutions belongs.
    turn
        (k,) turn (rad) in (-pi, pi].
    sense
        (k,) sign of the derivative of f with respect to the turn, 1.0 or -1.0. The sign
        distinguishes neighbouring solutions for the same direction.
    """

    row: Indices
    turn: Floats
    sense: Floats


@dataclass(frozen=True)
class TurnBrackets:
    """Intervals of the turn in which a mechanism may have a configuration.

    The turn is the angle of the output link about the direction at which it points. With
    direction and turn given, all links but one (the closing link) are placed. The placed
    links determine the angle d between the axes of the two pairs of the closing link. The
    closing link has the arc a between these axes, so it fits only where the residual f =
    cos(d) - cos(a) is 0. f changes its sign in each of the k intervals, either at a zero or
    by a jump.

    Attributes
    ----------
    row
        (k,) index of the direction to which the interval belongs.
    low, high
        (k,) ends of the interval (rad).
    low_residual, high_residual
        (k,) values of f at both ends.
    """

    row: Indices
    low: Floats
    high: Floats
    low_residual: Floats
    high_residual: Floats


@dataclass(frozen=True)
class DyadsWithClosingLink:
    """A mechanism with a pointing output that consists of dyads and a closing link.

    The output link points in a direction and can turn about this direction. If direction
    and turn are fixed, all links but one follow as dyads (two links each, closed by known
    axes). The remaining link, the closing link, has two pairs (joints). The angle between
    their axes must be the arc of the link, which is the equation for the turn.

    Attributes
    ----------
    chain
        The dyads. Each is joined to the base, to the output link or to earlier dyads.
    assembly
        The groups of links of the mechanism without the closing link.
    link
        Number of the closing link.
    pairs
        Numbers of the two pairs of the closing link.
    neighbours
        Numbers of the two links that the closing link joins, in the order of `pairs`.
    arc_cosine
        Cosine of the angle between the axes of these pairs.
    pointer_frame
        (3, 3) right-handed frame in the axes of the output link, as rows: two axes from
        which the turn is measured, then the direction of the output.
    """

    chain: DyadChain
    assembly: Assembly
    link: int
    pairs: tuple[int, ...]
    neighbours: tuple[int, ...]
    arc_cosine: float
    pointer_frame: Floats

    def place_dyads(self, directions: Floats, turns: Floats, signs: Signs) -> WorkingMode:
        """Place all links but the closing link, for poses of a pointing output link.

        A pose is the direction in which the output link points, and its turn (angle) about
        this direction. The other links follow two at a time. The two links, a dyad, are
        hinged to each other and to two placed links. A dyad therefore has two possible
        positions. One link, the closing link, is left out, because it fits at certain turns
        only.

        Parameters
        ----------
        directions
            (3, n) unit vectors in the axes of the base.
        turns
            (n,) angles (rad) of the output link about these directions.
        signs
            1 or -1 for each dyad, which chooses one of its two positions.

        Returns
        -------
        The placed links. Their orientations are computed when they are read.
        """
        output_orientation = self.orient_output(directions, turns)
        return WorkingMode(self.chain, signs, posed_rotation=output_orientation)

    def orient_output(self, directions: Floats, turns: Floats) -> Floats:
        """Return the orientation of the output link, from its direction and turn.

        The output link points in a direction. The turn is its angle about this direction.

        Parameters
        ----------
        directions
            (3, n) unit vectors in which the output link points, in the axes of the base.
        turns
            (n,) angles (rad) of the output link about these directions, counted from the
            axes that `_axes_around` chooses.

        Returns
        -------
        (3, 3, n) axes of the output link. Index 0 is the axis of the output link, index 1
        its component in the axes of the base.
        """
        # The pointer frame is fixed in the link. Its z axis is the direction.
        frame_x, frame_y = _turned_axes(directions, turns)  # (3, n), in the base
        frame_z = directions
        # Each axis of the link is a sum of the frame axes. Its components along them are
        # constant: a column of `pointer_frame`, whose rows are x, y and z of the frame.
        link_axes = []
        for link_axis_number in range(3):
            x, y, z = self.pointer_frame[:, link_axis_number]
            link_axes.append(x * frame_x + y * frame_y + z * frame_z)
        return np.array(link_axes)

    def measure_turns(self, directions: Floats, rotations: Floats) -> Floats:
        """Return the angles of the output link about its direction, in given orientations.

        The turn of the output link is its angle about the direction in which it points. A
        given orientation may point in a slightly different direction. The result is then
        the turn that fits the orientation best. A search of the exact turns starts at these
        turns.

        Parameters
        ----------
        directions
            (3, n) unit vectors in the axes of the base.
        rotations
            (n, 3, 3) orientations of the output link in the axes of the base.

        Returns
        -------
        (n,) turns (rad): angles from the first axis of `_axes_around` to the first row of
        `pointer_frame`. Its rows are three axes that are fixed in the output link, the last
        one along the direction in which the link points.
        """
        # The first two rows of `pointer_frame` in the given orientations: vectors (3, n) in
        # the axes of the base. The product has the shape (n, 3, 2), its transpose the shape
        # (2, 3, n).
        x_image, y_image = (rotations @ self.pointer_frame[:2].T).T
        x_axis, y_axis = _axes_around(directions)
        # With x and y for `x_axis` and `y_axis`: at the turn t, `x_image` should be
        # x cos t + y sin t, and `y_image` should be y cos t - x sin t. The scalar products
        # of these vectors with the actual images have the sum A cos t + B sin t. This sum
        # is largest at t = atan2(B, A).
        sine = dot_columns(y_axis, x_image) - dot_columns(x_axis, y_image)
        return np.arctan2(sine, dot_columns(x_axis, x_image) + dot_columns(y_axis, y_image))

    def link_orientations(self, mode: WorkingMode, count: int) -> Floats:
        """Return the orientations of all links of the mechanism.

        All links but one were placed as dyads (two links and three R pairs). The
        orientation of the remaining link, the closing link, follows from its two
        neighbours.

        Parameters
        ----------
        mode
            The dyads at n poses, as `place_dyads` returns them.
        count
            Number of links of the mechanism. The inverse kinematics adds virtual links,
            which hold the output in its pose. They have later numbers and are left out.

        Returns
        -------
        (n, count, 3, 3) rotations from the axes of each link to those of the base.
        """
        # `posed_rotation` is the orientation of the output link (3, 3, n).
        assert mode.posed_rotation is not None
        n = mode.posed_rotation.shape[-1]
        rotations = np.empty((n, count, 3, 3))
        for link in range(count):
            if link == self.link:
                continue
            # The columns of a rotation are the images of the three axes of the link.
            for column, unit_vector in enumerate(np.eye(3)):
                rotations[:, link, :, column] = mode.vector(link, unit_vector).T
        # The axes of its two pairs give the orientation of the closing link. The placed
        # neighbours give both axes in the base.
        first_in_base, second_in_base = (
            np.broadcast_to(axis, (3, n)).T for axis in self._end_axes(mode)
        )
        first_in_link, second_in_link = (
            self.chain.axis_in(pair, self.link) for pair in self.pairs
        )
        frame_in_base = frame_toward(first_in_base, second_in_base)
        frame_in_link = frame_toward(first_in_link, second_in_link)
        rotations[:, self.link] = frame_in_base @ frame_in_link.T
        return rotations

    def _end_axes(self, mode: WorkingMode) -> tuple[Floats, Floats]:
        """Return the axes p and q (3, n) of the closing link's pairs in its neighbours."""
        first, second = map(mode.axis, self.pairs, self.neighbours)
        return first, second

    def residual(self, mode: WorkingMode) -> Floats:
        """Return the closure error f = p . q - cos(arc) (n,) of the closing link.

        The closing link has two pairs (joints), with the axes p and q. Its neighbours
        determine these axes. f is 0 where the arc of the link fits between them, and NaN
        where a dyad (two links) does not reach.
        """
        p, q = self._end_axes(mode)
        return dot_columns(p, q) - self.arc_cosine

    def residual_rate(self, mode: WorkingMode) -> RateFraction:
        """Return the rate of the residual f for any angular velocity w of the output.

        The closure error of the closing link is f = p . q - cos(arc), with the axes p and q
        of its two pairs (joints). The link fits while f is 0. The rate is the fraction
        ``numerator . w / denominator``. The numerator has the shape (3, n), the denominator
        (n,).
        """
        p, q = self._end_axes(mode)
        # f' = (p x q) . (w_p - w_q) with the angular velocities of the links that carry p
        # and q. A rotation of these links about p or q adds nothing, because p x q is at
        # right angles to p and q. So `self.pairs` are passed as pairs to be ignored.
        normal = cross_columns(p, q)
        first_link, second_link = self.neighbours
        first_rate = mode.angular_velocity_along(normal, first_link, self.pairs)
        second_rate = mode.angular_velocity_along(normal, second_link, self.pairs)
        return first_rate - second_rate

    def slope(self, mode: WorkingMode, directions: Floats) -> Floats:
        """Return the derivative df/d(turn) (n,) of the closure error f of the closing link.

        The turn is the angle of the output link about its direction (3, n). The derivative
        is the rate of f at the angular speed 1 about this direction.
        """
        rate = self.residual_rate(mode)
        return dot_columns(rate.numerator, directions) / rate.denominator

    def solve_turn(self, directions: Floats, turn: Floats, signs: Signs) -> Floats:
        """Return turns of the output at which the closing link fits, by Newton's method.

        The turn is the angle of the output link about its direction. The closing link has
        the arc a between its two pair axes. At a turn, the other links determine the actual
        angle d between these axes. The link fits where the residual f = cos(d) - cos(a) is
        0.

        Parameters
        ----------
        directions
            (3, n) directions of the output.
        turn
            (n,) turns (rad) from which the method starts.
        signs
            1 or -1 for each dyad (two links placed together), for one of its two positions.

        Returns
        -------
        (n,) the turns (rad) at which the method ended, converged or not. The caller has to
        check the residual.
        """

        def newton_step(turns: Floats, rows: Indices) -> Floats:
            """Return Newton's steps (k, 1), rad, for the closure equation f = 0.

            The turn is the unknown angle of the output link about its direction. `turns`
            (k, 1) are the present values (rad). `rows` (k,) are the indices of their
            directions.
            """
            row_directions = directions[:, rows]
            placed = self.place_dyads(row_directions, turns[:, 0], signs)
            residual = self.residual(placed)
            slope = self.slope(placed, row_directions)  # derivative df/d(turn)
            step = -residual / slope
            # The step is not finite if a dyad cannot be placed at this turn, or if the
            # slope is 0. A step of 0 ends the iteration of this row.
            return np.where(np.isfinite(step), step, 0.0)[:, None]

        values, _ = newton(
            newton_step,
            values=turn[:, None],
            max_steps=MAX_TURN_STEPS,
            last_step=TURN_STEP_TOLERANCE_RAD,
            longest_step=MAX_TURN_STEP_RAD,
        )
        return values[:, 0]

    def find_turns(self, directions: Floats, signs: Signs) -> TurnSolutions:
        """Return all turns of the output at which the closing link fits in.

        The turn is the angle of the output link about its direction. The turn places all
        other links, and so determines the angle d between the two pair axes of the closing
        link. The arc of this link is a, so it fits if the residual f = cos(d) - cos(a) is
        0. Two roots of f between neighbouring samples of the turn can be missed.

        Parameters
        ----------
        directions
            (3, n) directions of the output.
        signs
            A dyad (two links placed together) has two positions. The sign of each dyad, 1
            or -1, chooses one of them.

        Returns
        -------
        The turns in (-pi, pi] with their directions, and for each turn the sign of the
        derivative of f with respect to the turn.
        """
        # Intervals of the turn in which f changes its sign. A jump of f is no root.
        brackets = self._bracket_roots(directions, signs)
        refined_turn, is_root = self._refine_brackets(brackets, directions, signs)
        row, turn = merge_equal_turns(brackets.row[is_root], wrap(refined_turn[is_root]))
        root_directions = directions[:, row]
        placed_dyads = self.place_dyads(root_directions, turn, signs)
        slope = self.slope(placed_dyads, root_directions)
        return TurnSolutions(row, turn, sense=np.where(slope < 0.0, -1.0, 1.0))

    def _refine_brackets(
        self, brackets: TurnBrackets, directions: Floats, signs: Signs
    ) -> tuple[Floats, Bools]:
        """Return the turn in each bracket at which the residual f changes its sign.

        The turn is the angle of the output link about its direction. At a given turn, the
        other links except the closing link are placed in dyads, two at a time. f is zero
        where the closing link fits between the placed links.

        Parameters
        ----------
        brackets
            k intervals of the turn. f has different signs at the ends of each. Each
            interval belongs to one of the n directions, with the index `brackets.row`.
        directions
            (3, n) directions of the output.
        signs
            1 or -1 for each dyad, for one of its two positions.

        Returns
        -------
        turn
            (k,) turns (rad).
        is_root
            (k,) whether f is 0 at the turn; False where f changes its sign by a jump.
        """

        def compute_residual(turns: Floats, bracket_numbers: Indices) -> Floats:
            """Return f (m,) at turns (m,), each with the direction of its bracket (m,)."""
            turn_directions = directions[:, brackets.row[bracket_numbers]]
            return self.residual(self.place_dyads(turn_directions, turns, signs))

        turn, _ = find_bracketed_zeros(
            compute_residual,
            low=brackets.low,
            high=brackets.high,
            values_at_low=brackets.low_residual,
            values_at_high=brackets.high_residual,
        )
        residual = compute_residual(turn, np.arange(len(turn)))
        return turn, np.abs(residual) < CLOSING_RESIDUAL

    def _bracket_roots(self, directions: Floats, signs: Signs) -> TurnBrackets:
        """Return intervals of the turn in which the closure error f changes its sign.

        The turn, the angle of the output link about its direction, is sampled in equal
        steps. A cell is the interval between two samples. Usually a root is seen by samples
        with different signs of f. A root can be hidden in two ways: a dyad gets out of
        reach within the cell, or f crosses 0 twice around an extremum. The turn of the
        extremum, or of the limit of the reach, is therefore searched and inserted as a
        further sample.

        Parameters
        ----------
        directions
            (3, n) directions of the output.
        signs
            The sign of each dyad, 1 or -1.
        """
        # 1. Sample f and its slope.
        n = directions.shape[1]
        spacing = 2.0 * np.pi / TURN_SAMPLES
        # All samples of a direction follow each other.
        row = np.repeat(np.arange(n), TURN_SAMPLES + 1)
        turn = np.tile(np.linspace(-np.pi, np.pi, TURN_SAMPLES + 1), n)
        mode = self.place_dyads(directions[:, row], turn, signs)
        residual = self.residual(mode)
        slope = self.slope(mode, directions[:, row])
        # The turns -pi and pi are the same pose. With different rounding errors, a root at
        # this pose could be outside of both the first and the last cell.
        for samples in (residual, slope):
            samples_of_directions = samples.reshape(n, TURN_SAMPLES + 1)
            samples_of_directions[:, -1] = samples_of_directions[:, 0]

        # 2. Find the cells in which roots can be hidden. At an extremum towards 0, |f|
        # falls at the start of the cell and rises at its end, without a sign change.
        size_slope = residual * slope
        has_extremum = (
            ~np.diff(residual <= 0.0) & (size_slope[:-1] < 0.0) & (size_slope[1:] > 0.0)
        )
        is_reached = np.isfinite(residual)
        is_same_direction = np.diff(row) == 0
        (cell,) = np.nonzero((has_extremum | np.diff(is_reached)) & is_same_direction)

        # 3. Search the extremum or the limit of the reach. The search starts at the end of
        # the cell that is in reach: the second one, cell + 1, if the first one is not.
        # `start_slope` is NaN if the limit of the reach is searched.
        start_turn = turn[cell + ~is_reached[cell]]
        cell_directions = directions[:, row[cell]]
        start_slope = np.where(has_extremum, slope[:-1], np.nan)[cell]

        def is_beyond(turns: Floats, which: Indices) -> Floats:
            """Return -1.0 before a special turn of the output and 1.0 beyond it (k,).

            The special turn is an extremum of the closure error f, or a limit of the reach,
            and is found by bisection. Beyond it the slope of f has another sign than at the
            start, or a dyad (two links) is out of reach. `turns` (k,) are turns in the
            cells with the indices `which` (k,).
            """
            mode = self.place_dyads(cell_directions[:, which], turns, signs)
            slopes = self.slope(mode, cell_directions[:, which])
            is_past_extremum = slopes * start_slope[which] <= 0.0
            is_before = np.isfinite(self.residual(mode)) & ~is_past_extremum
            return np.where(is_before, -1.0, 1.0)

        ones = np.ones(len(cell))
        distance = np.where(is_reached[cell], spacing, -spacing)
        # The second result is the end of the last bracket that is not beyond.
        _, inserted_turn = find_bracketed_zeros(
            is_beyond,
            low=start_turn,
            high=start_turn + distance,
            values_at_low=-ones,
            values_at_high=ones,
        )

        # 4. Insert these turns as samples, and take the cells in which f changes its sign.
        inserted_mode = self.place_dyads(cell_directions, inserted_turn, signs)
        row = np.insert(row, cell + 1, row[cell])
        turn = np.insert(turn, cell + 1, inserted_turn)
        residual = np.insert(residual, cell + 1, self.residual(inserted_mode))

        is_crossed = np.diff(residual >= 0.0) & np.isfinite(residual[:-1] + residual[1:])
        (bracket,) = np.nonzero(is_crossed & (np.diff(row) == 0))
        return TurnBrackets(
            row=row[bracket],
            low=turn[bracket],
            high=turn[bracket + 1],
            low_residual=residual[bracket],
            high_residual=residual[bracket + 1],
        )


def find_closing_link(
    virtual_chain: VirtualOutputChain, solver: PositionSolver
) -> DyadsWithClosingLink | None:
    """Return the dyads and the closing link of a pointing output, None if it has none.

    A closing link has two pairs (joints). Suppose this link is removed, and the output is
    fixed in a direction and at a turn about this direction. The other links must then be
    dyads (two links each) that can be placed one after another. The arc of the closing link
    determines the turn. Every link is tried. If several links fit, that with the fewest
    joints between dyads is chosen.

    Parameters
    ----------
    virtual_chain
        The mechanism with virtual links that hold the output.
    solver
        Solver of this mechanism.
    """
    mechanism = virtual_chain.mechanism
    direction = virtual_chain.output.direction
    joints = revolutes(solver.joints)
    has_contacts = len(joints) < len(mechanism.pairs)
    if not virtual_chain.points or direction is None or has_contacts:
        return None
    # All virtual pairs are locked: direction and turn of the output are held.
    held_pairs = virtual_chain.pairs
    bodies = merge_locked_links(mechanism, held_pairs)
    axis = np.array(direction)
    frame = frame_from(axis, perpendicular(axis)).T
    candidates = []
    for link in range(len(mechanism.links)):
        pairs = tuple(pair for pair, ends in enumerate(mechanism.ends) if link in ends)
        # The angles of the inputs are results, so a driven pair must belong to a dyad.
        excluded_pairs = {*held_pairs, *virtual_chain.driven}
        if (
            len(pairs) != 2
            or not excluded_pairs.isdisjoint(pairs)
            or link == virtual_chain.base
        ):
            continue
        remaining_pairs = [
            pair
            for pair in range(len(mechanism.pairs))
            if pair not in (*held_pairs, *pairs)
        ]
        try:
            groups = split_into_groups(mechanism, bodies, remaining_pairs)
        except CountError:  # a part without the link is rigid or free
            continue
        assembly = Assembly(held_pairs, bodies, groups)
        if DyadChain.can_place(assembly, virtual_chain.base):
            chain = DyadChain(
                mechanism, joints, assembly, virtual_chain.base, virtual_chain.link
            )
            first_axis, second_axis = (chain.axis_in(pair, link) for pair in pairs)
            candidates.append(
                DyadsWithClosingLink(
                    chain=chain,
                    assembly=assembly,
                    link=link,
                    pairs=pairs,
                    # The sum of both ends less one of them is the other one.
                    neighbours=tuple(sum(mechanism.ends[pair]) - link for pair in pairs),
                    arc_cosine=float(np.dot(first_axis, second_axis)),
                    pointer_frame=frame,
                )
            )
    return min(candidates, key=_count_dependences, default=None)


def merge_equal_turns(row: Indices, turn: Floats) -> tuple[Indices, Floats]:
    """Return the different turns of each direction, ordered by direction and turn.

    A turn is the angle of the output link about the direction in which the link points. The
    search finds the turns at which the mechanism closes. It can find the same turn twice.

    Parameters
    ----------
    row
        (k,) index of the direction to which a turn belongs.
    turn
        (k,) turns (rad) in (-pi, pi].
    """
    order = np.lexsort((turn, row))
    row = row[order]
    turn = turn[order]
    # A turn remains if its direction or its angle differs from the previous one. The first
    # turn always remains.
    is_kept = np.ones(len(turn), dtype=bool)
    has_next_direction = row[1:] > row[:-1]
    is_next_turn = turn[1:] - turn[:-1] > SAME_TURN_RAD
    is_kept[1:] = has_next_direction | is_next_turn
    row = row[is_kept]
    turn = turn[is_kept]
    # The turns of a direction lie on a circle, so the last one can equal the first one, as
    # pi and nearly -pi do.
    _, first, count = np.unique(row, return_index=True, return_counts=True)
    last = first + count - 1
    gap = turn[first] + TURN - turn[last]
    is_repeated = (last > first) & (gap <= SAME_TURN_RAD)
    repeated = last[is_repeated]
    return np.delete(row, repeated), np.delete(turn, repeated)


def _count_dependences(candidate: DyadsWithClosingLink) -> int:
    """Return how many outer pairs of the dyads of a candidate join links of other dyads."""
    chain = candidate.chain
    count = 0
    for dyad in chain.dyads:
        count += dyad.near_support in chain.dyad_of_link
        count += dyad.far_support in chain.dyad_of_link
    return count


def _axes_around(directions: Floats) -> tuple[Floats, Floats]:
    """Return unit vectors x and y (3, n) that form right-handed frames with z (3, n).

    The output points in the directions z. Its turn about z is counted from x: the angle
    from x to a fixed axis of the output link, the first row of
    `DyadsWithClosingLink.pointer_frame`. Equal directions z have the same x.
    """
    x_axis = perpendicular(directions.T).T
    return x_axis, cross_columns(directions, x_axis)


def _turned_axes(directions: Floats, turns: Floats) -> tuple[Floats, Floats]:
    """Return two axes at right angles to each direction, turned about it by an angle.

    With the direction as the third axis, they are the frame of an output link that points
    in this direction.

    Parameters
    ----------
    directions
        (3, n) unit vectors.
    turns
        (n,) angles (rad), counted from the axes that `_axes_around` chooses.

    Returns
    -------
    Unit vectors x and y (3, n), which form right-handed frames with the directions.
    """
    x_at_zero, y_at_zero = _axes_around(directions)
    cosine = np.cos(turns)
    sine = np.sin(turns)
    x_axis = x_at_zero * cosine + y_at_zero * sine
    y_axis = y_at_zero * cosine - x_at_zero * sine
    return x_axis, y_axis
