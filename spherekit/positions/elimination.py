"""All configurations of a group of R pairs at one sample, by elimination.

The arc equations of the group (`spherekit.positions.arc_equations`) have a known number of
complex solutions. All of them are computed, and the real ones are the configurations of the
group. The checks of `find_near_real_angles` in `spherekit.geometry.trigonometric_system`
detect lost solutions.
"""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.geometry.trigonometric_system import find_near_real_angles
from spherekit.geometry.vectors import max_abs
from spherekit.planning.assembly_plan import Group
from spherekit.positions.arc_equations import GroupGeometry
from spherekit.positions.elimination_order import find_binary_links, find_elimination_orders
from spherekit.positions.loop_closure import Closure

NEARLY_REAL_RAD = 0.03
"""Largest imaginary part (rad) of a solution that is tried as a real one.

Rounding gives multiple real solutions an imaginary part. A smaller limit can miss them. A
larger one starts Newton's method at more solutions that are not real.
"""

REAL_RAD = 1e-7
"""Largest imaginary part (rad) of a solution that must be real.

With a larger value complex solutions could be taken for real ones, and a sound elimination
would be rejected. With a smaller value a lost real solution could remain unnoticed.
"""

MIN_ELIMINATION_ARC_SINE = 1e-5
"""Smallest sine of the arc of a binary link for which elimination is used.

An error d of the arc changes its cosine, and thus the equation, only by d sin(arc). With a
smaller limit the equations lose digits. With a larger one more groups are searched.
"""


@dataclass(frozen=True)
class EliminationResult:
    """Configurations of a group of links that were found by elimination.

    The group is solved by arc equations: the angle between the two axes of a link equals
    its arc (size). Complex solutions of these equations are computed. The result has those
    that are real or nearly real.

    Attributes
    ----------
    angles
        (solutions, pairs) real parts of the angles (rad). These are starting values for
        Newton's method. A configuration can occur more than once.
    is_real
        (solutions,) whether the solution is real up to rounding. If Newton's method then
        finds no closed configuration next to it, the caller reports that a configuration
        may be missing. Other solutions have a small imaginary part, and may be complex, or
        real with larger rounding errors.
    problem
        Why a real solution may be missing; empty if none can be missing.
    """

    angles: Floats
    is_real: Bools
    problem: str


def solve_by_elimination(group: Group, closure: Closure) -> EliminationResult:
    """Compute all real solutions of the arc equations of a group at one sample.

    The group becomes a tree of bodies if some links with two pairs are removed. Each of
    these links gives an arc equation in the angles of the tree: the angle between the axes
    of its two pairs equals the arc of the link. An elimination order says which links are
    removed, and in which order the angles are eliminated. Orders are tried until the checks
    of one succeed. If all orders fail, the solutions of all orders are returned together,
    because a solution that one order has lost may be among those of another.

    Parameters
    ----------
    group
        A group (bodies that are placed together by closing their loops) for which
        `has_elimination` is true.
    closure
        Closure of this group with a single sample.
    """
    pair_count = len(group.pairs)
    # The state of a pair at an angle has its frames in both bodies, turned by this angle.
    # At zero angles they are the constant frames that the equations need.
    pair_states = closure.linearise(np.zeros((1, pair_count))).states
    # Axes: first or second body, sample, pair, and the frame. `GroupGeometry` has the pair
    # before the sample.
    frames = np.stack([pair_states.first, pair_states.second])
    geometry = GroupGeometry(group, pair_frames=np.moveaxis(frames, 1, 2))

    # A link whose two axes coincide rotates freely, so there are infinitely many solutions.
    arc_sines = [np.min(geometry.arc_sines(link)) for link in find_binary_links(group)]
    if min(arc_sines) < MIN_ELIMINATION_ARC_SINE:
        return EliminationResult(
            angles=np.empty((0, pair_count)),
            is_real=np.empty(0, dtype=bool),
            problem="a link has an arc of about 0 or 180 deg",
        )

    angles_of_orders: list[Floats] = []
    is_real_of_orders: list[Bools] = []
    problem = ""
    for order in find_elimination_orders(group):
        # Solve the equations of the only sample for the angles of the tree. `incidence`
        # says which equation contains which angle.
        equations = geometry.form_equations(order)[0]
        tree_angles, problem = find_near_real_angles(equations, order.incidence)
        # Rounding gives real solutions an imaginary part, which is larger for multiple
        # solutions. Solutions below the wide limit `NEARLY_REAL_RAD` may be real. Solutions
        # below the narrow limit `REAL_RAD` are real.
        imaginary_part = max_abs(tree_angles.imag, axis=1)
        is_candidate = imaginary_part < NEARLY_REAL_RAD
        orientations = geometry.place_bodies(order, tree_angles[None, is_candidate].real)
        angles = geometry.measure_pair_angles(orientations)
        is_real = imaginary_part[is_candidate] < REAL_RAD
        if not problem:
            return EliminationResult(angles, is_real, problem="")
        angles_of_orders.append(angles)
        is_real_of_orders.append(is_real)
    # Every order had a problem. The problem of the last order is reported.
    return EliminationResult(
        np.concatenate(angles_of_orders), np.concatenate(is_real_of_orders), problem
    )
