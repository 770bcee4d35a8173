"""Moments and forces that pairs transmit, from the motion of the links and their loads.

The Newton-Euler equations of all moving links about the centre O are solved for the
reactions of the pairs. A reaction is a moment about a direction about which the pair does
not turn or, if forces are requested, a force through O. The force of a contact acts at the
contact point. If the distance of this point from O is known, the force follows from the
moment of the contact.

O is at rest. A link with inertia tensor I about O, mass m and centre of mass c needs

    moment  I a + w x (I w)   and   force  m (a x c + w x (w x c))

with its angular velocity w and angular acceleration a. Both have the form
L(a) + w x L(w) with one linear map L.

A wrench (6,) is a moment about O (N m) followed by a force (N).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.dynamics.coordinates import CoordinateMotion
from spherekit.dynamics.generalised_forces import Loads
from spherekit.geometry.rotation import transpose
from spherekit.geometry.vectors import cross, max_abs
from spherekit.mechanism.elements import Pair
from spherekit.mechanism.friction import Bearings, ContactFriction
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.array_rows import ArrayRows
from spherekit.positions.timing import Timing

DEPENDENT_REACTIONS_RATIO = 1e-9
"""Relative singular value of the equations below which reactions balance each other.

Larger: reactions of nearly redundant constraints are reported as not determined. Smaller:
they are computed with errors of up to the reciprocal of this number times rounding.
"""

MAX_TOOTH_SIDE_CHANGES = 6
"""Largest number of solutions of the equilibrium, by which the pressing side of gear teeth
is found.

Each solution assumes the sides that the one before showed. If teeth still change sides in
the last one, the reactions and the friction due to them are reported as not determined.
"""

MAX_UNLOADED_TOOTH_RATIO = 1e-11
"""Moment of gear teeth, relative to the largest moment of reactions on a link or in a pair,
below which the teeth count as unloaded, so that they may press on either side.

Larger: the sides of lightly loaded teeth are wrong. Smaller: rounding keeps the sides of
unloaded teeth from being found.
"""

MAX_UNDETERMINED_PART = 1e-7
"""Largest squared part outside the span of the equations of a reaction that is determined.

The part is that of the unit vector along the axis of the reaction outside the row space.
Larger: reactions that are slightly indeterminate are reported as numbers. Smaller: rounding
makes determined reactions indeterminate.
"""

MOMENT_COMPONENTS = 3
"""Components 0, 1, 2 of a wrench are the moment, components 3, 4, 5 the force."""

TANGENT_FORCE = 3
NORMAL_FORCE = 4
"""Components of a wrench in pair axes: the forces along x and y.

At a contact, x is the common tangent of the profiles, and y their normal.
"""

AXIAL_FORCE = 5
"""Component of a wrench in pair axes: the force along the axis of an R pair."""


@dataclass(frozen=True)
class DrivenState(ArrayRows):
    """n samples (rows) of a moving mechanism with its driving torques.

    The reactions in the pairs (joints) are computed from these samples.

    Attributes
    ----------
    mechanism
        The mechanism with its masses and loads.
    motion
        Configurations and their derivatives with respect to m coordinates, such as the
        inputs or the arc length of the curve of configurations.
    timing
        Time, and rates and accelerations (n, m) of these coordinates.
    torques
        (n, inputs) driving torques, N m.
    carried
        (n, k) loads on the bearings or contacts of k pairs with friction, in the order of
        `Loads.friction_components`; their friction is proportional to these loads. The load
        of an R pair (revolute joint) is the sum of the sizes of the forces (N) on its
        bearings. The load of a sliding contact is the size of the moment (N m) of its
        normal force about the centre O. None without such friction.
    """

    mechanism: Mechanism
    motion: CoordinateMotion
    timing: Timing
    torques: Floats
    carried: Floats | None = None


@dataclass(frozen=True)
class JointReactions:
    """Moments and forces that pairs (joints) transmit at n rows (samples), in pair axes.

    A wrench is a moment about the centre O of the mechanism followed by a force. The first
    link of the pair exerts it on the second. Axis z of an R pair (revolute joint) is its
    axis. At a contact, z points from O to the contact, x along the common tangent and y
    along the normal.

    Attributes
    ----------
    wrenches
        (n, pairs, 6) moments about O (N m) and forces through O (N). NaN if a component is
        not determined or was not requested.
    opened
        (n, pairs, 6) whether a component is open: the equations of equilibrium do not
        determine its size, for example because constraints are redundant. False if a
        component was not requested.
    unbalanced
        (n,) largest residual (N m) of the equations of equilibrium. It is zero if the
        reactions balance all links. Residuals of forces are multiplied by a mean length.
    slides
        (n, links) whether a link can be displaced from the centre O, because no pair
        prevents it. False if forces were not requested, and for links with inertia whose
        centre of mass is not known.
    """

    wrenches: Floats
    opened: Bools
    unbalanced: Floats
    slides: Bools

    @property
    def moments(self) -> Floats:
        """(n, pairs, 3) moments about O that the pairs transmit, N m."""
        return self.wrenches[..., :3]

    @property
    def across(self) -> Floats:
        """(n, pairs) sizes (N m) of the moments at right angles to the axis z of each pair.

        z is the axis of an R pair, or the line from the centre O to a contact.
        """
        return np.hypot(self.wrenches[..., 0], self.wrenches[..., 1])


@dataclass(frozen=True)
class Equilibrium:
    """Solution of the Newton-Euler equations at n rows (samples): reactions of the pairs.

    A wrench (6,) is a moment about the centre O (N m) followed by a force (N). A reaction
    is one component of the wrench that a pair (joint) transmits, in a direction in which
    the pair has no motion.

    Attributes
    ----------
    reaction_wrenches
        (n, links, 6) for each moving link the wrench, in ground axes, that the reactions
        of all its pairs together have to exert on it.
    torques
        (n, pairs) the known torques of loads and drives at the pairs, N m.
    reactions
        (n, columns) sizes of the reactions, one column per reaction, N m. Forces are
        multiplied by `NewtonEuler.length` (the mean distance of contacts from O) and so
        become moments.
    residual
        (n,) largest error of an equation, N m. Errors of forces are multiplied by the same
        length.
    """

    reaction_wrenches: Floats
    torques: Floats
    reactions: Floats
    residual: Floats


@dataclass(frozen=True)
class ReactionEquations:
    """A part of the equilibrium equations that can be solved by itself.

    No unknown reaction (moment or force of a pair) occurs both in these equations and in
    other equations.

    Attributes
    ----------
    is_equation
        (equations,) whether an equation belongs to this part.
    is_reaction
        (reactions,) whether a reaction is an unknown of these equations.
    """

    is_equation: Bools
    is_reaction: Bools


class NewtonEuler:
    """Newton-Euler equations of all links at n configurations, solved for reactions.

    A wrench (6,) is a moment about the centre O (N m) followed by a force (N). A reaction
    is one of these six components at one pair (joint). A reaction does no work, because the
    pair has no motion in its direction.

    Attributes
    ----------
    columns
        Pair and component (0 to 5) of each reaction.
    matrix
        (n, equations, columns) wrenches on links by reactions of size 1.
    is_open
        (n, columns) whether a reaction is not determined.
    slides
        (n, links) whether a link can be displaced from O, because no pair prevents it.
        False without equations of forces on the link.
    unit_torque_wrenches
        (pairs, 6) wrench, in pair axes, of a torque of 1 N m of a load or drive at a pair.
        At an R pair (revolute joint) the torque is about the axis of the pair. At a contact
        a force along the common tangent causes the torque, which is about the normal. The
        wrench contains this force if the distance of the contact from O is known.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        frames: Floats,
        *,
        forces: bool = False,
        tooth_sides: Floats | None = None,
    ) -> None:
        """Assemble the matrix of the equations of equilibrium, and invert it.

        The unknowns are the reactions of the pairs (joints), each a column of the matrix.
        In the axes of an R pair (revolute joint), z points along its axis. At a contact, z
        points from the centre O of the mechanism to the contact, x along the common tangent
        of the profiles and y along their normal.

        Parameters
        ----------
        mechanism
            A mechanism.
        frames
            (n, pairs, 3, 3) axes of the pairs in their columns, in ground axes, at n rows.
        forces
            Whether to solve for forces through O as well as for moments.
        tooth_sides
            (n, pairs) +1 or -1: on which of their two sides gear teeth with a pressure
            angle press. The value is the sign of the moment about y that the teeth
            transmit. By default all values are +1.
        """
        self.mechanism = mechanism
        self.frames = frames
        self.columns = _list_moment_columns(mechanism)
        if forces:
            self.columns += _list_force_columns(mechanism)
        distances = [x.distance for x in mechanism.pairs if x.distance is not None]
        # A length by which forces are multiplied to be comparable in size with moments: the
        # mean distance of contacts from O.
        self.length = float(np.mean(distances)) if distances else 1.0
        # A wrench (6,) is a moment about O followed by a force. These are the wrenches of a
        # torque of 1 N m at each pair. Torques of loads and drives are multiples of these
        # wrenches.
        self.unit_torque_wrenches = np.stack(
            [_unit_torque_wrench(pair) for pair in mechanism.pairs]
        )
        if tooth_sides is None:
            tooth_sides = np.ones(frames.shape[:2])
        # The wrench of each reaction of size 1.
        self.unit_wrenches = self._compute_unit_wrenches(tooth_sides)

        link_count = len(mechanism.links)
        # A row for each pair. A pair acts on its second link (1 in the column of the link),
        # and with the opposite sign on its first (-1).
        first_links, second_links = np.array(mechanism.ends).T
        self._pair_to_link = (
            np.eye(link_count)[second_links] - np.eye(link_count)[first_links]
        )
        # A row for each reaction, with 1 in the column of its pair.
        column_pairs = [pair for pair, _ in self.columns]
        self._column_to_pair = np.eye(len(mechanism.pairs))[column_pairs]
        # Which components of the moment and force on which link have an equation.
        self._has_equation = _list_equations(mechanism, forces)
        self.matrix = self._assemble_matrix(column_pairs)
        # A force causes the moment of a contact. If the distance of the contact from O is
        # known, the same unknown is in equations of moments and of forces. If not, these
        # equations are separate systems.
        has_forces_in_moments = bool(distances)
        systems = self._divide_equations(is_coupled=has_forces_in_moments)
        self._invert_systems(systems)

    def _assemble_matrix(self, column_pairs: Sequence[int]) -> Floats:
        """Return the matrix (n, equations, columns) of the equilibrium of all links.

        A column has the moments and forces on the links by one reaction of size 1.
        `column_pairs` has the index of the pair of each reaction.
        """
        # `unit_wrenches` (n, columns, 6) are the moment and force of each reaction of size
        # 1. Forces are multiplied by a length, the mean distance of contacts from O, so
        # that all equations are in N m.
        scaled_wrenches = self.unit_wrenches * np.repeat([1.0, self.length], 3)
        ground_wrenches = _rotate_to_ground(self.frames[:, column_pairs], scaled_wrenches)
        # (links, columns) 1 for the second link of the pair of a reaction, -1 for the first
        # link, and 0 for other links.
        signs = self._pair_to_link[column_pairs].T
        # (n, links, 6, columns) the wrench on each link by a unit of each reaction.
        matrix = signs[:, None] * np.swapaxes(ground_wrenches, 1, 2)[:, None]
        # The mask `_has_equation` (links, 6) leaves out the ground, and the forces on links
        # whose centre of mass is not known.
        return matrix[:, self._has_equation]

    def _divide_equations(self, is_coupled: bool) -> list[ReactionEquations]:
        """Divide the equations of equilibrium into systems that are solved separately.

        The equations of moments have the moments of the pairs (joints) as unknowns, and
        those of forces have the forces. These are two separate systems. The caller inverts
        each system by itself, and finds out which reactions it leaves undetermined.

        Parameters
        ----------
        is_coupled
            Whether the distance of some contact from the centre O is known. The force of
            this contact then is an unknown in equations of moments and of forces, so all
            equations form one system.
        """
        # Components 0 to 2 are those of a moment, 3 to 5 those of a force. `_has_equation`
        # (links, 6) says which components on which link have an equation.
        _, equation_components = np.nonzero(self._has_equation)
        # Each unknown reaction is one component at one pair.
        reaction_components = np.array(
            [component for _pair_number, component in self.columns], dtype=int
        )
        if is_coupled:
            all_equations = np.ones(len(equation_components), dtype=bool)
            all_reactions = np.ones(len(reaction_components), dtype=bool)
            return [ReactionEquations(all_equations, all_reactions)]
        is_moment_equation = equation_components < MOMENT_COMPONENTS
        is_moment = reaction_components < MOMENT_COMPONENTS
        return [
            ReactionEquations(is_moment_equation, is_moment),
            ReactionEquations(~is_moment_equation, ~is_moment),
        ]

    def _invert_systems(self, systems: Sequence[ReactionEquations]) -> None:
        """Invert systems of equations, and find undetermined reactions and sliding links.

        The equations state the equilibrium of the links at n rows (samples). This method
        sets:

        - `_inverse` (n, columns, equations), which gives reactions from wrenches on links;
        - `is_open` (n, columns), whether the equations leave a reaction undetermined;
        - `slides` (n, links), whether a link can be displaced from the centre O, because no
          reactions balance some force on the link.

        A system is a part of the equations that has no reaction (column) in common with the
        other parts. Each system is therefore inverted by itself. Its inverse is a block of
        `_inverse`, which is zero elsewhere.
        """
        n, equation_count, column_count = self.matrix.shape
        self._inverse = np.zeros((n, column_count, equation_count))
        self.is_open = np.zeros((n, column_count), dtype=bool)
        is_unbalanced = np.zeros((n, equation_count), dtype=bool)
        for system in systems:
            equations = system.is_equation
            reactions = system.is_reaction
            inverted = _invert(self.matrix[:, equations][:, :, reactions])
            # In all rows the elements of these reactions and equations.
            block = np.ix_(np.arange(n), reactions, equations)
            self._inverse[block] = inverted.inverse
            self.is_open[:, reactions] = ~inverted.is_determined
            # For some loads, no reactions satisfy the equation.
            is_unbalanced[:, equations] = ~inverted.is_always_solvable
        self.slides = self._find_sliding_links(is_unbalanced)

    def _find_sliding_links(self, is_unbalanced: Bools) -> Bools:
        """Return a mask (n, links) of links that can be displaced from the centre O.

        A link can be displaced if there is a force on it that no reactions balance. Each
        equation states the equilibrium of one link in one component: a moment about an axis
        of the ground, or a force along it.

        Parameters
        ----------
        is_unbalanced
            (n, equations) whether an equation can't be satisfied for some loads, whatever
            the reactions are.
        """
        # The link and the component (0 to 5) of each equation.
        equation_links, components = np.nonzero(self._has_equation)
        is_sliding = np.zeros((len(is_unbalanced), len(self._has_equation)), dtype=bool)
        for equation, (link, component) in enumerate(
            zip(equation_links, components, strict=True)
        ):
            if component >= MOMENT_COMPONENTS:  # it is the equilibrium of forces
                is_sliding[:, link] |= is_unbalanced[:, equation]
        return is_sliding

    def _compute_unit_wrenches(self, tooth_sides: Floats) -> Floats:
        """Return the wrench (n, columns, 6) of each reaction of size 1, in pair axes.

        The matrix of the equilibrium is assembled from these wrenches. A wrench is a moment
        about the centre O of the sphere (components 0 to 2) and a force (3 to 5). A
        reaction is an unknown of the equations, and a column of their matrix. There are
        three kinds:

        - A force through O, which has no moment. Its unit is 1 N m divided by the mean
          distance of contacts from O, so that it is comparable with moments.
        - A moment about one axis (x, y or z) of a pair (joint).
        - The moment m_y about axis y that gear teeth with a pressure angle transmit. The
          teeth also transmit a positive moment about x that is proportional to ``|m_y|``.
          With an assumed sign of m_y, it is proportional to m_y and belongs to the same
          column (`_unit_tooth_moments`).

        The moment of a contact is caused by a force at its contact point. If the distance
        of this point from O is known, the force is computed and is part of the wrench.

        Parameters
        ----------
        tooth_sides
            (n, pairs) assumed signs, +1 or -1, of the moments m_y of teeth with a pressure
            angle. `solve_equilibrium` changes signs that the solution contradicts.
        """
        wrenches = np.zeros((len(tooth_sides), len(self.columns), 6))
        moments = wrenches[..., :MOMENT_COMPONENTS]
        forces = wrenches[..., MOMENT_COMPONENTS:]
        for column, (pair_number, component) in enumerate(self.columns):
            pair = self.mechanism.pairs[pair_number]
            if component >= MOMENT_COMPONENTS:
                wrenches[:, column, component] = 1.0 / self.length
                continue
            if pair.pressure_angle is not None:
                moments[:, column] = _unit_tooth_moments(
                    pair.pressure_angle, tooth_sides[:, pair_number]
                )
            else:
                moments[:, column, component] = 1.0
            if pair.distance is not None:
                forces[:, column] = _contact_forces(moments[:, column], pair.distance)
        return wrenches

    def subtract_torques(self, link_wrenches: Floats, torques: Floats) -> Floats:
        """Return the wrenches (n, links, 6) that the reactions must exert on the links.

        A wrench is a moment about the centre O of the sphere followed by a force, here in
        ground axes. The links need certain wrenches to move as they do at the n rows
        (samples). Known torques of loads and drives at the pairs (joints) exert a part of
        these wrenches. The reactions of the pairs, which are unknown, must exert the rest.
        The caller passes this rest to `solve_reactions`, which computes the reactions.

        Parameters
        ----------
        link_wrenches
            (n, links, 6) wrenches that the motion of the links needs, minus the wrenches of
            loads that act on links.
        torques
            (n, pairs) known torques (N m) that the first link of a pair exerts on the
            second. At an R pair (revolute joint) a torque is about the axis of the pair. At
            a contact a force along the common tangent causes the torque, which is about the
            normal of the profiles.
        """
        unit_wrenches = _rotate_to_ground(self.frames, self.unit_torque_wrenches)
        pair_wrenches = torques[..., None] * unit_wrenches
        # A wrench of a pair acts on its second link, and the opposite wrench on its first.
        # `_pair_to_link` (pairs, links) has 1 for the second link and -1 for the first.
        return link_wrenches - self._pair_to_link.T @ pair_wrenches

    def solve_reactions(self, reaction_wrenches: Floats) -> tuple[Floats, Floats]:
        """Solve the equations of equilibrium for the reactions in the pairs (joints).

        A reaction is an unknown component of the moment or force in a pair, and a column of
        the matrix of these equations.

        Parameters
        ----------
        reaction_wrenches
            (n, links, 6) the moments (N m) and forces (N) that the reactions have to exert
            on the links, in ground axes. Moments are about the centre O of the sphere.

        Returns
        -------
        reactions
            (n, columns) reactions, N m. Reactions that are forces are multiplied by the
            length `length`, so they are in N m, too.
        residual
            (n,) largest error of an equation, N m.
        """
        # Forces are multiplied by `length`, as in the matrix, so that all equations are in
        # N m.
        scaled_wrenches = reaction_wrenches * np.repeat([1.0, self.length], 3)
        # `_has_equation` (links, 6) leaves out the ground. It also leaves out forces if
        # they are not solved for, or if the centre of mass of their link is not known.
        right_side = scaled_wrenches[:, self._has_equation][..., None]
        reactions = self._inverse @ right_side
        # The inverse is a Moore-Penrose inverse. One step of iterative refinement restores
        # the digits that it loses.
        reactions = reactions + self._inverse @ (right_side - self.matrix @ reactions)
        residual = max_abs(right_side - self.matrix @ reactions, axis=(1, 2))
        return reactions[..., 0], residual

    def solve(self, link_wrenches: Floats, torques: Floats) -> Equilibrium:
        """Return the solution of the equations: the reactions of the pairs (joints).

        The parameters are as in `subtract_torques`.
        """
        reaction_wrenches = self.subtract_torques(link_wrenches, torques)
        reactions, residual = self.solve_reactions(reaction_wrenches)
        return Equilibrium(reaction_wrenches, torques, reactions, residual)

    @property
    def open_components(self) -> Bools:
        """(n, pairs, 6) mask of wrench components of pairs that are not determined."""
        return self.sum_wrenches(self.is_open.astype(float)) != 0.0

    def sum_wrenches(self, reactions: Floats) -> Floats:
        """Return the moment and force that each pair transmits, the sum of its reactions.

        Moment and force are in the axes of the pair.

        Parameters
        ----------
        reactions
            (n, reactions) sizes of the reactions. Each is one component of the moment or
            force of one pair.

        Returns
        -------
        (n, pairs, 6) moments about the centre (N m) and forces (N).
        """
        # (n, reactions, 6) moment and force of each reaction.
        reaction_wrenches = reactions[..., None] * self.unit_wrenches
        # `_column_to_pair` is a matrix (reactions, pairs). The row of a reaction has a 1 at
        # the pair of the reaction, otherwise 0.
        return self._column_to_pair.T @ reaction_wrenches


def _rotate_to_ground(frames: Floats, wrenches: Floats) -> Floats:
    """Rotate moments and forces from the axes of pairs to ground axes, (n, k, 6).

    Parameters
    ----------
    frames
        (n, k, 3, 3) axes of k frames in their columns, in ground axes.
    wrenches
        (n, k, 6) or (k, 6) wrenches (moment and force) in these axes.
    """
    vectors = wrenches.reshape(*wrenches.shape[:-1], 2, 3) @ transpose(frames)
    return vectors.reshape(*frames.shape[:2], 6)


def _unit_torque_wrench(pair: Pair) -> Floats:
    """Return the moment and force (6,), in pair axes, of a torque of 1 N m at a pair.

    A wrench is a moment about O followed by a force. The torque is about the axis z of an R
    pair. At a contact the torque is that of a force along the tangent x, so the torque is
    about the normal y.
    """
    wrench = np.zeros(6)
    wrench[2 if pair.kind.has_axis else 1] = 1.0
    # The force at the contact, at a known distance from O along z.
    if pair.distance is not None:
        wrench[3] = 1.0 / pair.distance
    return wrench


def _unit_tooth_moments(pressure_angle: float, sides: Floats) -> Floats:
    """Return the moments (n, 3) about O that gear teeth transmit per unit of their m_y.

    m_y is an unknown of the equations of equilibrium, and the result is its column there.
    The axes of the contact are x along the common tangent of the pitch curves, y along
    their normal, z from the centre O of the sphere to the contact. The force along x causes
    m_y. The force along y presses the wheels apart. It causes the positive moment m_x =
    tan(angle) |m_y|. With an assumed sign s of m_y this is tan(angle) s m_y, which is
    linear in m_y.

    Parameters
    ----------
    pressure_angle
        The pressure angle, rad.
    sides
        (n,) assumed signs s of m_y: on which of their two sides the teeth press.
    """
    moments = np.zeros((len(sides), 3))
    moments[:, 0] = np.tan(pressure_angle) * sides
    moments[:, 1] = 1.0
    return moments


def _contact_forces(moments: Floats, distance: float) -> Floats:
    """Return the forces (n, 3) at a point of contact that have given moments about O.

    Components are in the axes of the contact. The point is on axis z at the distance r from
    O. A force F there has the moment (-r F_y, r F_x, 0), so F_x = m_y / r and
    F_y = -m_x / r. F_z is set to 0, because it has no moment.

    Parameters
    ----------
    moments
        (n, 3) moments about O.
    distance
        Distance r of the point of contact from O.
    """
    forces = np.zeros_like(moments)
    forces[:, 0] = moments[:, 1] / distance
    forces[:, 1] = -moments[:, 0] / distance
    return forces


def links_without_centre(mechanism: Mechanism) -> list[str]:
    """Return the moving links with inertia whose mass or centre of mass is not known."""
    return [
        mass.link
        for mass in mechanism.masses
        if mass.link != mechanism.ground and (mass.mass is None or mass.centre is None)
    ]


def _list_equations(mechanism: Mechanism, forces: bool) -> Bools:
    """Return a mask (links, 6) of the components of moment and force with an equation.

    These are the equations of equilibrium of the links. The ground (link 0) has no
    equations. A link with inertia whose centre of mass is not known has no equations of
    forces.

    Parameters
    ----------
    mechanism
        The mechanism.
    forces
        Whether the caller solves for forces. If not, only moments have equations.
    """
    has_equation = np.zeros((len(mechanism.links), 6), dtype=bool)
    has_equation[1:, : 6 if forces else MOMENT_COMPONENTS] = True
    for link in links_without_centre(mechanism):
        has_equation[mechanism.link_number[link], MOMENT_COMPONENTS:] = False
    return has_equation


def _list_moment_columns(mechanism: Mechanism) -> list[tuple[int, int]]:
    """Return the pair and the component of each unknown moment in the equations.

    A pair transmits moments about the axes about which it does not turn. For teeth with a
    pressure angle, the moment about x (component 0) follows from the moment about y, so the
    moment about x is no unknown.
    """
    return [
        (pair_number, component)
        for pair_number, pair in enumerate(mechanism.pairs)
        for component in range(pair.constraints)
        if component != 0 or pair.pressure_angle is None
    ]


def _list_force_columns(mechanism: Mechanism) -> list[tuple[int, int]]:
    """Return the pair and the component of each unknown force in the equilibrium equations.

    The equations have a column for each unknown moment, then a column for each unknown
    force. The result describes the columns of the forces. The component of a force is
    `TANGENT_FORCE` along the axis x of the pair (joint), `NORMAL_FORCE` along y or
    `AXIAL_FORCE` along z.

    An R pair (revolute joint) transmits a moment about the centre O of the sphere, and a
    force through O. The moment and the force are independent, so the force is an unknown.
    The force of a contact acts at the contact point. If the distance of this point from O
    is known, the force follows from its moment about O. If not, the force is an unknown.

    Some components are known to be zero. Bearings that let the links slide exert no axial
    force. A contact that slides without friction exerts no tangent force.
    """
    # Floating pairs have bearings that let the links slide along the axis.
    floating_pairs = set()
    contacts_with_friction = set()
    for load in mechanism.loads:
        if isinstance(load, Bearings) and load.floats:
            floating_pairs.add(load.pair)
        if isinstance(load, ContactFriction) and load.friction_coefficient > 0.0:
            contacts_with_friction.add(load.pair)
    columns = []
    for pair_number, pair in enumerate(mechanism.pairs):
        components = _unknown_force_components(
            pair,
            is_floating=pair.name in floating_pairs,
            has_friction=pair.name in contacts_with_friction,
        )
        columns += [(pair_number, component) for component in components]
    return columns


def _unknown_force_components(
    pair: Pair, *, is_floating: bool, has_friction: bool
) -> list[int]:
    """Return the components of the force of a pair (joint) that are unknown.

    The other components are zero, or follow from the moment of the pair. Components 3, 4
    and 5 of a wrench are the forces along the axes x, y and z of the pair.

    Parameters
    ----------
    pair
        The pair: an R pair (revolute joint) or a contact.
    is_floating
        Whether the bearings of an R pair let the links slide along its axis without any
        force.
    has_friction
        Whether a contact has friction.
    """
    is_r_pair = pair.kind.has_axis
    if is_r_pair:
        radial_forces = [TANGENT_FORCE, NORMAL_FORCE]  # along x and y, across the axis z
        return radial_forces if is_floating else [*radial_forces, AXIAL_FORCE]
    if pair.distance is not None:
        # The distance of the contact from the centre O is known. The moment of the contact
        # is this distance times its force, so the force follows from the moment.
        return []
    # Every contact transmits a force along its normal y. A force along the tangent x needs
    # rolling without slip, or friction.
    has_tangent_force = pair.rolls or has_friction
    return [NORMAL_FORCE, TANGENT_FORCE] if has_tangent_force else [NORMAL_FORCE]


@dataclass(frozen=True)
class InvertedEquations:
    """Moore-Penrose inverses of n matrices A, and what equations A x = b determine.

    There is one matrix for each row (sample) of a motion. The unknowns x are reactions of
    pairs (joints). Each equation states the equilibrium of a link in one component. The two
    masks tell which reactions are not determined, and on which links a force cannot be
    balanced.

    Attributes
    ----------
    inverse
        (n, unknowns, equations) Moore-Penrose inverse of the matrix A.
    is_determined
        (n, unknowns) whether an unknown has the same value in all least-squares solutions.
    is_always_solvable
        (n, equations) whether the solution x = inverse b satisfies an equation for every
        right side b.
    """

    inverse: Floats
    is_determined: Bools
    is_always_solvable: Bools


def _invert(matrix: Floats) -> InvertedEquations:
    """Invert a matrix A (n, equations, unknowns) by its singular value decomposition.

    A = U diag(s) V^T. Singular values s below `DEPENDENT_REACTIONS_RATIO` of the largest
    count as zero. The columns of V with a nonzero s span the row space of A. The columns of
    U with a nonzero s span its column space.

    - An unknown is determined if the unit vector of its coordinate is in the row space.
    - An equation can be satisfied for every right side if the unit vector of its coordinate
      is in the column space.
    """
    u, singular_values, v_transposed = np.linalg.svd(matrix, full_matrices=False)
    u_transposed = transpose(u)
    is_nonzero = singular_values > DEPENDENT_REACTIONS_RATIO * singular_values[:, :1]
    # The Moore-Penrose inverse is V diag(1/s) U^T, with 0 in place of 1/s where s counts as
    # zero. Division by infinity gives this 0.
    divisors = np.where(is_nonzero, singular_values, np.inf)
    inverse = transpose(v_transposed) @ (u_transposed / divisors[..., None])
    return InvertedEquations(
        inverse=inverse,
        # The function takes the vectors as rows: the columns of V and of U, transposed.
        is_determined=_is_axis_in_span(v_transposed, is_nonzero),
        is_always_solvable=_is_axis_in_span(u_transposed, is_nonzero),
    )


def _is_axis_in_span(vectors: Floats, is_spanning: Bools) -> Bools:
    """Return whether each coordinate axis is in the subspace that some vectors span.

    For the equations A x = b, a coordinate is an unknown or an equation. An unknown is
    determined if its axis is in the row space of A. An equation can be satisfied for every
    b if its axis is in the column space.

    Parameters
    ----------
    vectors
        (n, r, k) orthonormal vectors in rows, with k coordinates.
    is_spanning
        (n, r) whether a vector is one of those that span the subspace.

    Returns
    -------
    (n, k) whether the unit vector along an axis is in the subspace, except for a part whose
    squared length is at most `MAX_UNDETERMINED_PART`.
    """
    # The unit vector along axis k has a part in the subspace and a part perpendicular to
    # it. The squared length of the first part is the sum of the squares of coordinate k of
    # the spanning vectors. Both squared lengths add up to 1.
    squared_part_inside = np.sum(is_spanning[..., None] * vectors**2, axis=1)
    squared_part_outside = 1.0 - squared_part_inside
    # Written as "not outside", so that NaN counts as inside.
    return ~(squared_part_outside > MAX_UNDETERMINED_PART)


def compute_reactions(driven: DrivenState, *, forces: bool = False) -> JointReactions:
    """Return the moments and forces (wrenches) that every pair (joint) transmits.

    Parameters
    ----------
    driven
        n rows (samples) of a moving mechanism, with its loads and driving torques.
    forces
        Whether to compute forces through the centre O as well as moments. Forces are not
        determined in rows in which a link can be displaced from O (for example slide along
        an axis), because no pair prevents this.
    """
    reactions = _solve_reactions(driven, forces)
    # In rows in which a link can be displaced from O, only the equations of moments are
    # solved.
    is_sliding = np.any(reactions.slides, axis=1)
    if np.any(is_sliding):
        moments_only = _solve_reactions(driven.rows(is_sliding), forces=False)
        reactions.wrenches[is_sliding] = moments_only.wrenches
        # The moments that the equations leave open (not determined), and all forces.
        reactions.opened[is_sliding] = moments_only.opened
        reactions.opened[is_sliding, :, MOMENT_COMPONENTS:] = True
        # The residual of equilibrium.
        reactions.unbalanced[is_sliding] = moments_only.unbalanced
    return reactions


def _solve_reactions(driven: DrivenState, forces: bool) -> JointReactions:
    """Return the reactions of all pairs (joints).

    Parameters
    ----------
    driven
        n rows (samples) of a moving mechanism, with its loads and driving torques.
    forces
        Whether equations of forces are solved as well as equations of moments.
    """
    balance = solve_equilibrium(driven, forces)
    equations = balance.equations
    equilibrium = balance.equilibrium
    # A pair transmits its reactions, and the torque of loads and drives at it.
    wrenches = equations.sum_wrenches(equilibrium.reactions)
    wrenches += equilibrium.torques[..., None] * equations.unit_torque_wrenches
    # With redundant constraints, some components can balance each other without loads. The
    # equations do not determine these components.
    is_undetermined = equations.open_components
    # In some rows it is not known on which of their two sides gear teeth press. No
    # component is determined there.
    is_undetermined = is_undetermined | ~balance.is_settled[:, None, None]
    wrenches[is_undetermined] = np.nan
    if not forces:
        # Forces that were not requested are not reported as undetermined.
        wrenches[..., MOMENT_COMPONENTS:] = np.nan
        is_undetermined[..., MOMENT_COMPONENTS:] = False
    return JointReactions(
        wrenches,
        opened=is_undetermined,
        # The moment by which equilibrium is missed is the residual of its equations.
        unbalanced=equilibrium.residual,
        # Links that no pair keeps from moving away from the centre of the sphere.
        slides=equations.slides,
    )


@dataclass(frozen=True)
class DrivenEquilibrium:
    """The reactions of a moving mechanism under its loads and driving torques.

    Gear teeth press on one of two sides, which depends on the reactions. `is_settled` (n,)
    says whether the sides are known in a row. In other rows the reactions are not
    determined.
    """

    equations: NewtonEuler
    equilibrium: Equilibrium
    is_settled: Bools


def solve_equilibrium(driven: DrivenState, forces: bool) -> DrivenEquilibrium:
    """Return the equilibrium of all links of a moving mechanism, with its reactions.

    Gear teeth with a pressure angle press on one of their two sides. The side follows from
    the sign of the transmitted moment, which is not known in advance. The equations are
    solved with assumed sides, and again with opposite sides where the solution contradicts
    the assumption. `is_settled` is False in rows that still contradict it after
    `MAX_TOOTH_SIDE_CHANGES` solutions. Callers treat reactions in these rows as unknown.

    Parameters
    ----------
    driven
        n rows (samples) of a moving mechanism.
    forces
        Whether to solve for the forces that pairs transmit through the centre O of the
        sphere, as well as for their moments.
    """
    mechanism = driven.mechanism
    motion = driven.motion
    timing = driven.timing
    applied = sum_applied_loads(driven)
    # (n, links, 6) wrenches (moments about O, then forces) that accelerate the links. One
    # part is linear in the accelerations of the inputs. The other part is that at constant
    # rates.
    inertia_wrenches = acceleration_wrenches(mechanism, motion, timing.ddq)
    inertia_wrenches += velocity_wrenches(mechanism, motion, timing.dq)
    # (n, pairs) assumed signs of the moments of teeth, first all 1.
    sides = np.ones(motion.frames.shape[:2])
    for _ in range(MAX_TOOTH_SIDE_CHANGES):
        equations = NewtonEuler(mechanism, motion.frames, forces=forces, tooth_sides=sides)
        equilibrium = equations.solve(
            inertia_wrenches - applied.link_wrenches, applied.torques
        )
        is_contradicted = _find_contradicted_sides(equations, equilibrium, sides)
        if not np.any(is_contradicted):
            break
        sides = np.where(is_contradicted, -sides, sides)
    # The result has the last sides that were tried, even if the solution contradicts them.
    is_settled = ~np.any(is_contradicted, axis=1)
    return DrivenEquilibrium(equations, equilibrium, is_settled)


def _find_contradicted_sides(
    equations: NewtonEuler, equilibrium: Equilibrium, sides: Floats
) -> Bools:
    """Return a mask (n, pairs) of pairs whose teeth do not press on the assumed side.

    Gear teeth press on one of their two sides. The caller assumes a side to form the
    equations. If the solution contradicts it, the caller tries the other side.

    The axes of the pair (contact) are z from the centre of the sphere to the contact, x
    along the common tangent of the pitch curves, and y along their normal. The part of the
    tooth force along x drives the wheel, and has opposite directions on the two sides of
    the teeth. The moment of this part about y is m_y. Its sign tells the side.

    Parameters
    ----------
    equations
        The equations of equilibrium that were solved with the assumed sides.
    equilibrium
        The solution of these equations.
    sides
        (n, pairs) assumed sides of teeth with a pressure angle, 1 or -1.
    """
    pairs = equations.mechanism.pairs
    has_sides = np.array([pair.pressure_angle is not None for pair in pairs])
    wrenches = equations.sum_wrenches(equilibrium.reactions)
    moment_about_y = wrenches[..., 1]
    # The moments of unloaded teeth are rounding errors of the other moments.
    # Loads on the ground (link 0) are not balanced by reactions.
    moments_on_links = equilibrium.reaction_wrenches[:, 1:, :MOMENT_COMPONENTS]
    largest_moment = np.maximum(
        max_abs(wrenches[..., :MOMENT_COMPONENTS], axis=(1, 2)),
        max_abs(moments_on_links, axis=(1, 2)),
    )
    min_moment = MAX_UNLOADED_TOOTH_RATIO * largest_moment[:, None]
    return (moment_about_y * sides < -min_moment) & has_sides


def acceleration_wrenches(
    mechanism: Mechanism, motion: CoordinateMotion, accelerations: Floats
) -> Floats:
    """Return the moments and forces (n, links, 6) that accelerate links, in ground axes.

    A wrench is a moment about the centre O followed by a force. `accelerations` (n, m) are
    the second time derivatives of the m coordinates of `motion`. The part of the inertia
    forces that depends on velocities is not included. The force on a link is 0 if the
    centre of mass of the link is not known.
    """
    # n rows, i coordinates, l links, a components
    angular_accelerations = np.einsum("ni,nila->nla", accelerations, motion.w)
    return _apply_inertia(mechanism, motion, angular_accelerations)


def velocity_wrenches(
    mechanism: Mechanism, motion: CoordinateMotion, rates: Floats
) -> Floats:
    """Return the wrenches (n, links, 6) that links need at constant rates, in ground axes.

    The caller adds the wrenches that are linear in the accelerations of the coordinates. A
    wrench is a moment about the centre O followed by a force: here gyroscopic moments and
    centripetal forces. For a link with the angular velocity w and the angular acceleration
    a, the wrench is L(a) + w x L(w). L is a linear map. L(w) consists of the angular
    momentum about O and the momentum of the link. The acceleration a is not zero although
    the rates of the coordinates are constant.

    Parameters
    ----------
    mechanism
        The mechanism with its masses.
    motion
        Configurations in n rows, and their derivatives with respect to m coordinates.
    rates
        (n, m) time derivatives of these coordinates.
    """
    # At constant rates q' the angular acceleration is the sum of dw_i/dq_k q'_i q'_k. The
    # letters are: n rows, i and k coordinates, l links, a components.
    w = np.einsum("ni,nila->nla", rates, motion.w)
    angular_accelerations = np.einsum("ni,nk,nikla->nla", rates, rates, motion.dw)
    # (n, links, 2, 3): the angular momentum about O, then the momentum, of each link.
    momenta = _apply_inertia(mechanism, motion, w).reshape(*w.shape[:2], 2, 3)
    # The cross product of w with both vectors of its link.
    momentum_rates = cross(w[:, :, None], momenta).reshape(*w.shape[:2], 6)
    return _apply_inertia(mechanism, motion, angular_accelerations) + momentum_rates


def _apply_inertia(
    mechanism: Mechanism, motion: CoordinateMotion, vectors: Floats
) -> Floats:
    """Return I v and m (v x c) for each link, in ground axes.

    I is the inertia tensor of the link about the centre O, m its mass and c its centre of
    mass. If v is the angular velocity, the results are the angular momentum about O and the
    momentum. If v is the angular acceleration, they are the moment about O and the force
    that accelerate the link from rest.

    Parameters
    ----------
    mechanism, motion
        The mechanism with its masses, and n configurations with rotations of its links.
    vectors
        (n, links, 3) angular velocities or accelerations v in ground axes.

    Returns
    -------
    (n, links, 6) the vector I v, then the vector m (v x c), of each link. The second vector
    is 0 for links without a known centre of mass.
    """
    wrenches = np.zeros((*vectors.shape[:2], 6))
    for mass in mechanism.masses:
        link = mechanism.link_number[mass.link]
        rotation = motion.rotations[:, link]
        vector = vectors[:, link]
        tensor = rotation @ mass.tensor @ transpose(rotation)
        wrenches[:, link, :3] = (tensor @ vector[..., None])[..., 0]
        if mass.mass is not None and mass.centre is not None:
            wrenches[:, link, 3:] = mass.mass * cross(vector, rotation @ mass.centre)
    return wrenches


@dataclass(frozen=True)
class AppliedLoads:
    """Loads and driving torques at n rows (samples of a motion).

    Attributes
    ----------
    link_wrenches
        (n, links, 6) wrenches of loads on links, in ground axes: the moment about the
        centre O, then the force.
    torques
        (n, pairs) torques of loads and drives at pairs, N m.
    """

    link_wrenches: Floats
    torques: Floats


def sum_applied_loads(driven: DrivenState) -> AppliedLoads:
    """Return the sums of all loads and driving torques on links and at pairs (joints).

    They are known terms in the equations of equilibrium.

    A load consists of components, each with a magnitude. A component at a pair is a torque
    about its axis, or about the normal of a contact. Other components act on links, with a
    moment about the centre O and a force in proportion to the magnitude. A wrench has the
    moment (N m) in its components 0 to 2 and the force (N) in 3 to 5.

    Parameters
    ----------
    driven
        n rows (samples) of a moving mechanism, with its loads and the driving torques of
        the inputs.
    """
    mechanism = driven.mechanism
    motion = driven.motion
    timing = driven.timing
    loads = Loads(mechanism)
    # Loads depend on the motion, the rates `timing.dq` of its coordinates, and the time.
    # `carried` are the forces on bearings and moments at contacts that cause friction.
    magnitudes = loads.evaluate_magnitudes(motion, timing.dq, timing.t, driven.carried)
    link_wrenches = np.zeros((len(timing.t), len(mechanism.links), 6))
    torques = np.zeros((len(timing.t), len(mechanism.pairs)))
    for magnitude, component in zip(magnitudes.T, loads.components, strict=True):
        if component.pair:
            torques[:, mechanism.pair_number[component.pair]] += magnitude
        # A component at a pair has no unit wrenches on links.
        for wrench in loads.unit_wrenches(component, motion.rotations):
            link_wrenches[:, wrench.link, :3] += magnitude[:, None] * wrench.moment
            link_wrenches[:, wrench.link, 3:] += magnitude[:, None] * wrench.force
    input_pairs = [mechanism.pair_number[item.pair] for item in mechanism.inputs]
    driving_torques = driven.torques
    torques[:, input_pairs] += driving_torques
    return AppliedLoads(link_wrenches, torques)
