"""Loops of four pairs that close with all four axes in one plane, exactly.

If a loop of four pairs is reflected in the plane of its axes, it closes with the same arcs.
Its equation is therefore an even function about such a configuration, and its derivatives
vanish there. The matrix F' of the derivatives of all equations then loses a rank, and
configuration curves may cross. Whether the loop closes in a plane is a question of a sum of
arcs. This question is decided exactly, with the decimal numbers of the mechanism file.

Let x and y be the two variables of the loop. Each has two *planar angles*, at which the
arcs of both links of its pair are in one plane. If x is one of its planar angles, the
equation of the loop is a + b cos(y) = 0, with y counted from one of the planar angles of y.
If the loop closes with both planar angles of y, a + b and a - b are zero, so that it closes
with all y. The configurations are then a whole curve along which x is constant.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise, product

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.mechanism.elements import SizeGeometry
from spherekit.numerics.angles import wrap
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.ball_frames import exact_ball, exact_balls
from spherekit.proof.balls import (
    Ball,
    centre_float,
    centre_floats,
    pi_ball,
    polar_angle,
    upper_magnitude,
    widen,
)
from spherekit.proof.construction import PlacementStep
from spherekit.proof.decimal_geometry import decimal_text
from spherekit.proof.decimal_mechanism import DecimalMechanism
from spherekit.proof.root_ball import bound_zero_distance
from spherekit.proof.saddle_arms import Quadrant
from spherekit.proof.saddles import Saddle, find_saddle
from spherekit.proof.tubes import ROUND_UP, CertifiedArc, OrientedBox

GIVEN_VALUE_TOLERANCE_RAD = 1e-9
"""Largest distance (rad) of a variable from a value that it is tried with.

Larger: more values are tried in vain. Smaller: rounding of the position excludes a value.
"""

SOLUTION_RADIUS_RAD = 1e-9
"""Half width (rad) of the balls in which the solved variables are proven to be.

Larger: the derivatives in the balls may be singular. Smaller: the error of the position is
no longer inside.
"""

NEAR_CENTRE_RATIO = 1e-3
"""Largest difference of a variable from the centre of a box, over half its shortest side.

With v variables it has to be less than 1 / sqrt(v), so that the position is inside the box.
Smaller: crossings farther from the centre are not proven.
"""

MAX_SADDLES = 64
"""Largest number of saddles of one search.

Larger: mechanisms with many crossings take longer. Smaller: they are not decided.
"""

Arm = tuple[int, Quadrant]
"""One of the four arms of a saddle: the index of the saddle, and the quadrant."""


@dataclass(frozen=True)
class PlanarAngle:
    """An angle of a pair (joint) at which the arcs of both its links are in one plane.

    The arc of a link is measured from the axis of the pair to the link's other axis in a
    closed loop. A pair has two such angles, half a turn apart.

    Attributes
    ----------
    angle
        The angle (rad) as a ball, a number with a bound of its error.
    is_same_side
        Whether both arcs extend from the axis of the pair to the same side, as in folded
        links. If false, both arcs extend to opposite sides, as in stretched links.
    """

    angle: Ball
    is_same_side: bool


@dataclass(frozen=True)
class FourPairLoop:
    """A loop of four pairs that gives one equation in two variable pair angles.

    Two pairs of the loop rotate by variables. These two pairs place the axes of the other
    two pairs, onto which the last link is put. The equation says that the arc between these
    axes equals the arc of the last link.

    Such a loop can have all four axes in one plane, where curves of configurations cross.
    The way around the loop is then on one great circle, and passes the arc of each link
    forwards or backwards. So the four arcs, with suitable signs, add up to whole turns.

    Attributes
    ----------
    equation
        Index of the equation among the equations of the mechanism.
    variables
        Indices of the two variables among the variables of the mechanism.
    planar_closures
        For each way in which the loop closes with all four axes in one plane: the angles of
        both variables, by index of the variable.
    """

    equation: int
    variables: tuple[int, int]
    planar_closures: Sequence[Mapping[int, PlanarAngle]]

    def other_variable(self, variable: int) -> int:
        """Return the index of the variable of the loop that is not the given one."""
        first, second = self.variables
        return second if variable == first else first

    def angles_that_free_other_variable(self, variable: int) -> list[Ball]:
        """Return the angles of one variable at which the second one can have any angle.

        The equation of a loop of four pairs (joints) contains the angles x and y of two
        pairs. Let y be 0 where the two links of its pair are folded onto each other, and pi
        where they are stretched. If, at some x, the loop closes in a plane with y = 0 and
        also with y = pi, it closes with all y:

        1. The equation of the loop is linear in cos(y) and sin(y).
        2. The reflection in the plane maps y to -y, so sin(y) does not occur. The equation
           is a + b cos(y) = 0.
        3. The equation holds for y = 0 and y = pi, so a + b = 0 and a - b = 0. So
           a and b are 0.

        `variable` is the index of x. The angles x (rad) are balls (numbers with error
        bounds).
        """
        other_variable = self.other_variable(variable)
        free_angles = []
        for is_folded in (True, False):
            # Planar closures in which the links of x are folded, or else stretched. The
            # links of a pair are folded at one angle only, so x is the same in all of them.
            closures = [
                closure
                for closure in self.planar_closures
                if closure[variable].is_same_side == is_folded
            ]
            sides_of_other = {closure[other_variable].is_same_side for closure in closures}
            closes_with_other_folded_and_stretched = sides_of_other == {True, False}
            if closes_with_other_folded_and_stretched:
                free_angles.append(closures[0][variable].angle)
        return free_angles


def complete_configuration(
    equations: ArcEquations, equation: int, given: Mapping[int, Ball], position: Floats
) -> Array | None:
    """Enclose the configuration near a position in which some variables have exact values.

    One equation is left out, because the caller knows that the given values satisfy it. The
    other equations determine the other variables. The result proves that these equations
    have exactly one solution near the position. A ball is a number with a bound of its
    error.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    equation
        Index of the equation that is left out.
    given
        For each given variable, by index, its exact value (rad), up to whole turns (2 pi).
    position
        (v,) approximate values of all v variables (rad).

    Returns
    -------
    (v,) balls (rad). The balls of the variables that are not given contain exactly one
    solution. None in three cases: a given value is not near the position; there are not as
    many equations as unknown variables; or no solution is proven.
    """
    balls = exact_balls(position)
    for variable, value in given.items():
        balls[variable] = _shift_by_turns(value, near_angle=position[variable])
        distance = abs(centre_float(balls[variable]) - position[variable])
        if distance > GIVEN_VALUE_TOLERANCE_RAD:
            return None
    free_variables = [j for j in range(equations.variable_count) if j not in given]
    # A mechanism has as many equations as unknown angles. Its variables are the unknown
    # angles, the inputs and some angles of wheels. The proof needs as many equations as
    # free variables.
    equation_count = equations.unknown_count
    other_equations = [k for k in range(equation_count) if k != equation]
    if len(free_variables) != len(other_equations):
        return None
    if not free_variables:
        return balls
    return _widen_around_solution(equations, other_equations, free_variables, balls)


def _shift_by_turns(angle: Ball, near_angle: float) -> Ball:
    """Return the angle (rad), shifted by whole turns, that is nearest to another angle."""
    turns = np.round((near_angle - centre_float(angle)) / (2.0 * np.pi))
    return angle + 2 * pi_ball() * turns


def _widen_around_solution(
    equations: ArcEquations,
    square_equations: Sequence[int],
    free_variables: Sequence[int],
    balls: Array,
) -> Array | None:
    """Widen some variables to balls that contain exactly one solution of the equations.

    A ball is a number with a bound of its error. The interval Newton method bounds the
    distance of a solution from the centre. The bound follows from the errors of the
    equations at the centre, and from the derivatives in the wide balls. If the bound is
    less than the radius, there is exactly one solution in the balls.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    square_equations
        Indices of the equations to solve, as many as there are free variables.
    free_variables
        Indices of the variables that are widened, by `SOLUTION_RADIUS_RAD`.
    balls
        (v,) balls of all variables (rad). The balls of free variables have no radius.

    Returns
    -------
    (v,) the balls, with those of free variables widened. None if no solution is proven.
    """
    # Errors of the equations at the centre, without derivatives.
    (residuals,) = equations.evaluate(balls, order=0)
    wide_balls = balls.copy()
    wide_balls[free_variables] += widen(0.0, SOLUTION_RADIUS_RAD)
    _, derivatives = equations.evaluate(wide_balls)
    distance_bound = bound_zero_distance(
        residuals[square_equations], derivatives[np.ix_(square_equations, free_variables)]
    )
    return wide_balls if distance_bound < SOLUTION_RADIUS_RAD else None


def _find_four_pair_loop(
    equations: ArcEquations, equation: int, step: PlacementStep
) -> FourPairLoop | None:
    """Return the loop of an equation if it has four pairs and exact arcs, else None.

    The equation belongs to a closing link, which a step puts on the axes of two pairs.
    These pairs join it to two links placed before, its parents. The loop consists of the
    closing link and of the two paths from its parents to the first link that both paths
    share.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    equation
        Index of the equation.
    step
        The step that gives this equation.
    """
    construction = equations.construction
    paths = construction.parent_paths(step)
    path_links = (*paths.first, *paths.second)
    path_steps = [
        path_step for path_step in construction.steps if path_step.link in path_links
    ]
    # Steps that rotate a link about one joint. The loop has four pairs if there are two
    # such joints, with different variables, and no other step; the closing link has the
    # other two pairs.
    joints = [path_step for path_step in path_steps if not path_step.has_two_parents]
    joint_variables = {joint.variable for joint in joints}
    if not len(path_steps) == len(joints) == len(joint_variables) == 2:
        return None
    # Angles that are multiples of a shared variable, such as wheel angles, are not handled.
    if any(
        joint.angle_factor != 1 or joint.pairs[0] in equations.follower_offsets
        for joint in joints
    ):
        return None
    # The links around the loop from the shared link on, and the pair after each of them.
    links = [paths.shared_link, *paths.first[::-1], step.link, *paths.second]
    pair_of_link = {joint.link: joint.pairs[0] for joint in joints}
    pairs = [
        *(pair_of_link[link] for link in paths.first[::-1]),
        *step.pairs,
        *(pair_of_link[link] for link in paths.second),
    ]
    # The exact arc of each link between the pairs before and after it, as in the file.
    decimal_mechanism = equations.decimal_mechanism
    arcs = []
    neighbours = pairwise([pairs[-1], *pairs])
    for link, (pair_before, pair_after) in zip(links, neighbours, strict=True):
        arc = _exact_arc(decimal_mechanism, link, pair_before, pair_after)
        if arc is None:
            return None
        arcs.append(arc)
    # Positions of the two pairs with variables in the loop.
    positions = [pairs.index(joint.pairs[0]) for joint in joints]
    first_angles, second_angles = (
        _planar_angles(equations, pairs, links, position) for position in positions
    )
    variables = (joints[0].variable, joints[1].variable)
    planar_closures = []
    for first, second in product(first_angles, second_angles):
        is_same_side = (first.is_same_side, second.is_same_side)
        if _closes_in_plane(arcs, positions, is_same_side, decimal_mechanism.in_degrees):
            planar_closures.append({variables[0]: first, variables[1]: second})
    return FourPairLoop(equation, variables, planar_closures)


def _closes_in_plane(
    arcs: Sequence[Fraction],
    positions: Sequence[int],
    is_same_side: tuple[bool, bool],
    in_degrees: bool,
) -> bool:
    """Return whether a loop of four links closes with all its axes in one plane.

    The axes are then on one great circle, and each arc runs along it in one of two senses.
    The loop closes if the signed arcs add up to whole turns. At two given joints the side
    of the links is prescribed. Two links are on the same side of the joint axis if their
    senses are opposite, and on opposite sides if their senses are equal.

    Parameters
    ----------
    arcs
        Exact arc of the link before each joint, in the unit of the file.
    positions
        Indices of the two given joints in the loop.
    is_same_side
        For each of the two joints whether its links are on the same side.
    in_degrees
        Whether the unit is degrees; otherwise it is radians.
    """
    for senses in product((1, -1), repeat=4):
        total = sum(sense * arc for sense, arc in zip(senses, arcs, strict=True))
        # Both links of joint k are on the same side if their senses differ.
        has_sides = all(
            (senses[k] != senses[(k + 1) % 4]) == same_side
            for k, same_side in zip(positions, is_same_side, strict=True)
        )
        # In radians, only the sum 0 is certain: no other decimal number is a multiple of 2
        # pi.
        remainder = total % 360 if in_degrees else total
        if has_sides and remainder == 0:
            return True
    return False


def _exact_arc(
    decimal_mechanism: DecimalMechanism, link: int, first_pair: int, second_pair: int
) -> Fraction | None:
    """Return the arc between two pair axes of a link exactly as the file gives it.

    Exact arcs decide whether a loop closes in one plane.

    Parameters
    ----------
    decimal_mechanism
        The mechanism with its file.
    link, first_pair, second_pair
        Indices of the link and of the two pairs (joints) in the structure.

    Returns
    -------
    The arc as a fraction in the unit of the file, between 0 and half a turn. None if the
    file does not give this arc, or if no such exact fraction exists.
    """
    arc_text = _find_arc_text(decimal_mechanism, link, first_pair, second_pair)
    if arc_text is None:
        return None
    # TOML allows underscores between digits.
    arc = Fraction(arc_text.replace("_", ""))
    if decimal_mechanism.in_degrees:
        # The arcs both ways round the great circle. The smaller one is at most half a turn.
        forward_arc = arc % 360
        backward_arc = (-arc) % 360
        arc = min(forward_arc, backward_arc)
        upper_limit = 180.0
    else:
        # The limit is a little below half a turn, because pi is not a decimal number. Arcs
        # above are refused, because 2 pi cannot be subtracted exactly.
        upper_limit = 3.14159
    return arc if 0 < arc < upper_limit else None


def _find_arc_text(
    decimal_mechanism: DecimalMechanism, link: int, first_pair: int, second_pair: int
) -> str | None:
    """Return the arc between two pair axes of a link as the decimal text of the file.

    The caller makes an exact fraction of the text. The file lists the arcs from the first
    axis of a link to each other axis, so arcs between two other axes are not found.

    Parameters
    ----------
    decimal_mechanism
        The mechanism with its file.
    link, first_pair, second_pair
        Indices of the link and of the two pairs (joints) in the structure.

    Returns
    -------
    The text of the number. None if the file does not give this arc.
    """
    structure = decimal_mechanism.structure
    table = decimal_mechanism.document.data["links"].get(structure.links[link])
    if first_pair == second_pair or not table or "axes" not in table:
        return None
    first_axis, *other_axes = table["axes"]
    pair_names = {structure.pairs[first_pair], structure.pairs[second_pair]}
    if first_axis not in pair_names:
        return None
    # `arcs` has the arc from the first axis to each of the other axes, in their order.
    (other_axis,) = pair_names - {first_axis}
    if other_axis not in other_axes:
        return None
    return decimal_text(table["arcs"][other_axes.index(other_axis)])


def _planar_angles(
    equations: ArcEquations, pairs: Sequence[int], links: Sequence[int], joint: int
) -> tuple[PlanarAngle, PlanarAngle]:
    """Return the two angles of a joint with the arcs of both its links in one plane.

    The caller combines such angles of two joints to find the ways in which the whole loop
    closes in one plane. Each link of the joint has another axis in the loop, the
    neighbouring axis. This axis has an azimuth about the joint axis. The angles follow from
    both azimuths. The angles are balls (numbers with a bound of their error).

    Parameters
    ----------
    equations
        The equations of the mechanism.
    pairs, links
        Indices of the pairs and links around the loop. Joint k (pair k) is between the
        links k and k + 1.
    joint
        Number k of the joint.

    Returns
    -------
    The angle with the arcs of both links on the same side of the joint axis, then the angle
    with the arcs on opposite sides.
    """
    pair = pairs[joint]
    link_before = links[joint]
    link_after = links[(joint + 1) % len(links)]
    pair_after = pairs[(joint + 1) % len(pairs)]
    azimuth_by_link = {
        link_before: _azimuth_in_link(equations, link_before, pair, pairs[joint - 1]),
        link_after: _azimuth_in_link(equations, link_after, pair, pair_after),
    }
    # In its own link, the neighbouring axis of the first link has the azimuth a1, and that
    # of the second link a2. The joint angle q turns the second link relative to the first.
    # So, seen from the first link, the axis of the second link has the azimuth a2 + q. The
    # arcs are on the same side if a2 + q = a1.
    first_link, second_link = equations.decimal_mechanism.structure.ends[pair]
    same_side = azimuth_by_link[first_link] - azimuth_by_link[second_link]
    return (
        PlanarAngle(same_side, is_same_side=True),
        PlanarAngle(same_side + pi_ball(), is_same_side=False),
    )


def _azimuth_in_link(
    equations: ArcEquations, link: int, pair: int, other_pair: int
) -> Ball:
    """Return the azimuth of another pair axis of a link about the axis of a pair.

    The azimuth is the angle about the axis from the zero direction (where pair angles
    begin) to the other axis. The caller computes the azimuths in both links of a pair. From
    these it gets the pair angles at which the arcs of both links lie in one plane.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    link
        Index of the link that has both pairs.
    pair
        Index of the pair about which the azimuth is counted.
    other_pair
        Index of the pair with the axis that has the azimuth.

    Returns
    -------
    The azimuth (rad) as a ball (a number with a bound of its error).
    """
    # The rows of a frame are the zero direction, the side (90 degrees from it) and the
    # axis.
    other_axis = equations.pair_frame(other_pair, link)[2]
    zero_and_side = equations.pair_frame(pair, link)[:2]
    return polar_angle(*(zero_and_side @ other_axis))


class Crossings:
    """All saddles of a search: places where curves cross, or narrowly miss each other.

    Each saddle is in a box in the space of the variables. The boxes of two saddles have no
    point in common. Four branches of curves, the arms of the saddle, leave each box.

    Parameters
    ----------
    equations
        The equations of the mechanism.

    Attributes
    ----------
    loops
        The loops of four pairs with exact arcs, for which a crossing can be proven. If the
        sizes have a tolerance there are none.
    saddles
        The saddles that the search has found so far.
    """

    def __init__(self, equations: ArcEquations) -> None:
        """Find the loops with exact arcs; the list of saddles is empty at the start."""
        self.equations = equations
        self.loops: list[FourPairLoop] = []
        decimal_mechanism = equations.decimal_mechanism
        # Only a geometry given by arcs without tolerances has exact arcs.
        has_sizes = isinstance(decimal_mechanism.mechanism.geometry, SizeGeometry)
        if has_sizes and not decimal_mechanism.tolerance:
            for number, step in enumerate(equations.construction.equation_steps):
                if loop := _find_four_pair_loop(equations, number, step):
                    self.loops.append(loop)
        self.saddles: list[Saddle] = []

    def find(self, position: Floats) -> bool:
        """Look for a saddle near a position (v,) rad, and return whether one was added.

        A saddle is a place where configuration curves cross or narrowly miss each other.
        """
        if len(self.saddles) >= MAX_SADDLES:
            return False
        saddle = find_saddle(
            self.equations, position, self._contains_proven_crossing, self._is_disjoint
        )
        if saddle is not None:
            self.saddles.append(saddle)
        return saddle is not None

    def arm(self, piece: CertifiedArc) -> Arm | None:
        """Return the arm that the middle of an arc is on, None if none is proven."""
        for number, saddle in enumerate(self.saddles):
            if quadrant := saddle.find_quadrant(piece.centre, piece.centre_error):
                return number, quadrant
        return None

    def chain_ends(
        self, pieces: Sequence[CertifiedArc], closed: bool
    ) -> tuple[Arm | None, Arm | None]:
        """Return the arms on which a chain of arcs begins and ends, None if none is proven.

        An arm is a branch of a curve that leaves a saddle, where curves cross or nearly do.
        """
        if closed:
            return None, None
        end_arm = self.arm(pieces[-1])
        if len(pieces) == 1:
            # One arc is on at most one arm, and must not count as two ends on it. It stands
            # for an arm that leaves the range of the input near its saddle: one end of the
            # chain is on the arm, the other is outside the range.
            return None, end_arm
        return self.arm(pieces[0]), end_arm

    def may_contain(self, position: Floats, error: float) -> bool:
        """Return whether a configuration may be in the box of a saddle.

        A saddle is a place where configuration curves cross or nearly do. The configuration
        differs from `position` (v,) by at most `error` in each of the v variables (rad).
        """
        return any(saddle.may_contain(position, error) for saddle in self.saddles)

    def is_constant(self, pieces: Sequence[CertifiedArc], variable: int) -> bool:
        """Return whether a variable is proven to be constant along a configuration curve.

        If the input is constant, for example, the mechanism moves along the curve while
        the input is locked. False only means that nothing is proven.

        The curve is given as a chain of certified arcs. The proof uses the middle one:

        1. The equation of a loop of four pairs contains two of its pair angles, x and y. At
           certain values of x it holds for all y
           (`FourPairLoop.angles_that_free_other_variable`). These configurations form a
           curve along which x is constant.
        2. A configuration of this curve is inside the box of the middle arc.
        3. The box contains only configurations of the arc. So the arc is a piece of the
           curve of step 1, and the variable is constant along the whole chain.

        Parameters
        ----------
        pieces
            The arcs of the curve, each with a box that contains no other configurations.
        variable
            Index of the variable.
        """
        middle_piece = pieces[len(pieces) // 2]
        # `loops` has only loops of links whose sizes are known exactly.
        for loop in self.loops:
            if variable not in loop.variables:
                continue
            # A configuration near the centre of the middle arc, on a curve as in step 1
            # with this variable as x. None if no such configuration is found.
            configuration = self._find_on_constant_curve(
                loop, variable, middle_piece.centre
            )
            # Later loops are not tried. The result may be False although the variable is
            # constant.
            if configuration is not None:
                return _is_inside_box(configuration, middle_piece)
        return False

    def _find_on_constant_curve(
        self, loop: FourPairLoop, variable: int, position: Floats
    ) -> Array | None:
        """Return a configuration near a position, on a curve with a constant variable.

        The equation of the loop contains two variables, x and y. At certain values of x,
        the loop is closed for all values of y. The mechanism can then move along a curve of
        configurations while x stays constant. With the returned configuration, the caller
        proves that a given curve is of this kind.

        Parameters
        ----------
        loop
            The loop of four pairs. The two variables are the angles of two of its pairs.
        variable
            Index of the variable x that is constant along the curve.
        position
            (v,) values (rad) of all variables. The variable y keeps its value.

        Returns
        -------
        (v,) the configuration as balls (rad), which are numbers with error bounds. None if
        there is no such curve near the position, or if no configuration is proven.
        """
        other_variable = loop.other_variable(variable)
        other_angle = exact_ball(position[other_variable])
        # The values of x at which the loop is closed for all y.
        for angle in loop.angles_that_free_other_variable(variable):
            # With these x and y the equation of this loop holds. The equations of the other
            # loops determine the remaining variables.
            given = {variable: angle, other_variable: other_angle}
            balls = complete_configuration(self.equations, loop.equation, given, position)
            if balls is not None:
                return balls
        return None

    def _contains_proven_crossing(self, box: OrientedBox) -> bool:
        """Return whether configuration curves are proven to cross in a box.

        The test looks for a configuration in the box in which a loop of four pairs (joints)
        has all its axes in one plane. Curves cross there, for this reason: The equations of
        the mechanism are F_1 = 0, F_2 = 0, ... In the box there is a smooth surface of
        positions, with two coordinates u and v, on which F_i = l_i g(u, v) with constants
        l_i. All configurations in the box are on this surface, where g = 0. The caller,
        `find_saddle`, has proven that both slopes of g are 0 at exactly one of its points.

        1. Let F_i = 0 be the equation of the loop. A reflection in the plane of the loop
           changes the signs of all small changes of its angles, but not F_i. So the first
           derivatives of F_i are 0 in the planar configuration.
        2. The surface is smooth because the equations F_i - l_i g = 0 have independent
           derivatives with respect to the variables and g. By step 1, only -l_i is left of
           the derivatives of the loop's equation. So l_i is not 0.
        3. On the surface g = F_i / l_i. The derivatives of F_i are 0, so both slopes of g
           are 0, too. The planar configuration is therefore the saddle point of g. It is a
           configuration, so g = 0. Two curves g = 0 cross at a saddle point with g = 0.
        """
        for configuration in self._find_planar_configurations(box.centre):
            # `_is_near_centre` proves that the configuration is in the box.
            if _is_near_centre(configuration, box):
                return True
        return False

    def _find_planar_configurations(self, position: Floats) -> Iterator[Array]:
        """Yield configurations near a position in which a loop of four pairs is planar.

        In a planar loop all four axes are in one plane. Curves of configurations can cross
        there, and the caller uses such a configuration to prove a crossing. A planar loop
        closes if the arcs of its links, with suitable signs, add up to whole turns. This is
        tested with exact arcs, so `FourPairLoop.planar_closures` are proven.

        Parameters
        ----------
        position
            (v,) values (rad) of all variables. Configurations that are not near these
            values are left out.

        Yields
        ------
        (v,) a configuration in balls (rad): numbers with bounds of their errors.
        """
        for loop in self.loops:
            for closure in loop.planar_closures:
                # A planar closure has the two variables of the loop, which satisfy the
                # equation of the loop. The other equations determine all other variables.
                given = {variable: planar.angle for variable, planar in closure.items()}
                configuration = complete_configuration(
                    self.equations, loop.equation, given, position
                )
                if configuration is not None:
                    yield configuration

    def _is_disjoint(self, box: OrientedBox) -> bool:
        """Return whether a box is proven to be apart from the boxes of all saddles.

        The boxes are in the space of the variables. A saddle is a place where configuration
        curves cross or nearly do.
        """
        return all(_are_disjoint(box, saddle) for saddle in self.saddles)


def _is_near_centre(configuration: Array, box: OrientedBox) -> bool:
    """Return whether a configuration (v,) is so near the centre of a box that it is inside.

    The v variables (rad) are balls, numbers with a bound of their error. The box may be
    rotated. The distance from its centre is at most sqrt(v) times the largest difference of
    a variable, which `NEAR_CENTRE_RATIO` allows for.
    """
    differences = configuration - exact_balls(box.centre)
    largest_difference = max(map(upper_magnitude, differences))
    return bool(largest_difference < NEAR_CENTRE_RATIO * np.min(box.limits))


def _is_inside_box(configuration: Array, piece: CertifiedArc) -> bool:
    """Return whether a configuration (v,), given as balls, is inside the box of an arc."""
    # The balls bound the distance of the configuration from their centres in each variable.
    # The sides of the box can have any directions, so the test needs the Euclidean
    # distance.
    centres = centre_floats(configuration)
    distances = list(map(upper_magnitude, configuration - exact_balls(centres)))
    error = float(np.linalg.norm(distances)) * ROUND_UP
    return piece.contains(centres, error)


def _are_disjoint(first: OrientedBox, second: OrientedBox) -> bool:
    """Return whether a side of one of two oriented boxes separates them."""
    offset = wrap(second.centre - first.centre)
    for box, other_box in ((first, second), (second, first)):
        other_reach = np.abs(box.frame.T @ other_box.frame) @ other_box.limits
        # 1e-9 rad covers the rounding of offset and reach.
        if np.any(np.abs(offset @ box.frame) > box.limits + other_reach + 1e-9):
            return True
    return False
