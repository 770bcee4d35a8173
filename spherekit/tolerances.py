"""Tolerances that decide the status of a row, or the reason for which a path ends.

Each docstring says which status the number decides, and what changes with a larger or a
smaller value. Constants that only control an algorithm stand in its module. The page
docs/tolerances.md has these numbers as a table.
"""

EPS = 2.220446049250313e-16
"""Spacing of float64 numbers just above 1, twice the unit roundoff."""

# ---- NOT_CLOSED, OUT_OF_REACH and NOT_CONVERGED: whether a configuration exists

CLOSURE_TOLERANCE = 1e-12
"""Largest loop rotation (rad) of an OK row; others are NOT_CLOSED. Solvers reach 1e-15.

Ten times larger: less accurate configurations are OK. Ten times smaller: long chains,
whose rounding errors add up, become NOT_CLOSED.
"""

REACH_SLACK = 16 * EPS
"""Angle (rad) by which a triangle may fail to close without being OUT_OF_REACH.

It is the rounding error of its arcs. Larger: rows just beyond a dead centre count as
rows at it. Smaller: rows at a dead centre become OUT_OF_REACH by rounding.
"""

MAX_UNREACHED_SQUARE = -1e-4
"""Largest square of a triple product at which a row kernel calls a dyad OUT_OF_REACH.

Rounding errors of its outer axes do not make a square this negative. Other rows with a
negative square are decided by the position analysis. Nearer to zero: dyads at their
dead centres can count as out of reach. More negative: the position analysis solves more
rows.
"""

NEAREST_TOLERANCE_RAD = 1e-11
"""Largest error (rad) of a configuration that is the nearest to a target orientation.

Rows with a larger one are NOT_CONVERGED. Larger: less accurate rows are OK. Smaller:
rows near singular configurations become NOT_CONVERGED because of rounding errors.
"""

CLOSING_RESIDUAL = 1e-7
"""Largest residual f with which a turn of a closing link is a solution (NOT_CONVERGED).

At the limit of a dyad's reach the slope of f is infinite, so the Newton step alone does
not show a root. Larger: turns at which f only jumps count as roots. Smaller: roots near
the limit of the reach are lost because of rounding errors.
"""

# ---- AT_SINGULARITY: whether the inputs determine the motion

SINGULAR_RATIO = 1e-11
"""Smallest relative singular value of the closure Jacobian with which rates are accepted
that are computed from sizes rounded to float64.

Mechanisms of R pairs without redundant constraints: rows with a smaller value are
computed again from the decimal sizes, and `MAX_RATE_SENSITIVITY` decides. Other
mechanisms: such rows are AT_SINGULARITY. The error of rates is about the rounding error
2e-16 divided by this value. Larger: rates with more correct digits are rejected.
Smaller: rates with fewer correct digits are returned, unless `MAX_RATE_ERROR` excludes
them.
"""

SINGULAR_DYAD_SINE = 1e-6
"""Sine of a dyad at its dead centre below which half of the digits are lost.

Mechanisms of R pairs without redundant constraints: such rows are solved again in quad
precision. They are OK unless the rounding error of the inputs reaches the dead centre.
Larger: more rows are solved again, with the same status. Smaller: angles with fewer
correct digits are returned. Other mechanisms and inverse kinematics: such rows are
AT_SINGULARITY. Larger: more rows have this status, and no rates.
"""

SINGULAR_GROUP_CONDITION = 1e-6
"""The same for the reciprocal condition number of a group that is not a dyad.

Its rows, too, are solved again in quad precision if all pairs are R pairs and no
constraint is redundant.

It is a number of its own because the sine of a dyad is known in closed form, with its
error, while a condition number is computed from the Jacobian.
"""

SINGULAR_CURVE_CONDITION = 1e-6
"""Reciprocal condition of the bordered Jacobian at which curves of configurations cross.

A curve that is followed ends AT_SINGULARITY at such a node. Nearer to a crossing,
rounding errors move points by more than a small part of the remaining steps. Four-bars
whose arcs differ from those of a folding one by less than about 1e-11 rad reach such a
node. Larger: curves that pass each other end. Smaller: a curve may continue on another
one.
"""

SINGULAR_TRANSMISSION = 1e-6
"""Transmission from the inputs to the output below which a row is a singularity of type
II.

There the output is known to less than half of the digits of the inputs. Larger: more
rows near singularities are AT_SINGULARITY. Smaller: rounding can hide a singularity.
"""

SINGULAR_INPUT_DETERMINACY = 1e-6
"""Smallest determinacy of the inputs in a row of inverse dynamics that is OK.

Rows in which the inputs determine the motion less well are AT_SINGULARITY: about half
of the digits of their rates are lost. Larger: rows farther from dead centres have no
torques.
"""

SINGULAR_TARGET_CONDITION = 1e-7
"""Reciprocal condition below which a target orientation does not determine the links.

It is smaller than the other conditions: rotations about a fixed axis return rows nearer
to singular configurations. Larger: more rows around a singular configuration are
AT_SINGULARITY. Smaller: rows with half their digits or less count as regular.
"""

MAX_SINGULAR_ANGLE_ERROR_RAD = 1e-5
"""Largest error bound (rad) of the variables of a row AT_SINGULARITY that are returned.

Variables with a larger bound are NaN. Larger: less accurate variables are returned.
Smaller: more rows at dead centres have none.
"""

EXACT_DISTANCE_RAD = 1e-5
"""Distance (rad) within which a singular configuration is replaced by an exact one.

Exact configurations are known to all digits, such as that of a reference pose. Larger:
the configuration of another mode may be replaced. Smaller: a closed form, which has
half the digits at a dead centre, is no longer recognised.
"""

NEAR_CROSSING_RAD = 1e-4
"""Distance (rad) from a crossing of curves within which a lost row is AT_SINGULARITY.

Curves end a little before crossings. Larger: rows that lost their mode are called
singular. Smaller: rows in that gap are MODE_LOST.
"""

MAX_RATE_RESIDUAL = 1e-10
"""Largest residual of solved velocity or acceleration equations, relative to their terms.

Equations with a larger residual contradict each other. Mechanisms of R pairs without
redundant constraints: their rows are computed again from the decimal sizes. Other
mechanisms: they are AT_SINGULARITY. Larger: rows with contradicting equations are
accepted. Smaller: rounding counts as a contradiction.
"""

MAX_RATE_ERROR = 1e-2
"""Largest relative error bound of angular velocities and their derivatives in an OK row.

Rows with a larger bound from float64 sizes are computed again from the decimal sizes,
if all pairs are R pairs and no constraint is redundant. They are AT_SINGULARITY if that
bound is larger too. Larger: rates are returned nearer to singularities, with fewer
correct digits. Smaller: rows of other mechanisms are AT_SINGULARITY.
"""

MAX_RATE_SENSITIVITY = 1e12
"""Largest norm of the inverse velocity equations (rad of a variable per rad by which
loops open) of a row whose rates are computed from the decimal sizes.

Rows with a larger norm are AT_SINGULARITY. At a dead centre, the norm is about the
reciprocal of the distance in the pair variables. Only rows that `SINGULAR_RATIO` or
`MAX_RATE_ERROR` rejects are computed from the decimal sizes, so for a distance above 1e-11
`SINGULAR_RATIO` has to be as large as the distance. Larger: rows nearer to a singularity
have rates. Smaller: more of these rows are AT_SINGULARITY.
"""

# ---- Why a path ends: AT_SINGULARITY, OUT_OF_REACH, CURVATURE, OFF_PROFILE or MODE_LOST

END_AT_SINGULARITY_CONDITION = 1e-3
"""Condition of the last node of a path below which a singularity is the reason of its end.

It is the relative singular value or the reciprocal condition of the equations that are
followed. The end of other paths has another reason or is MODE_LOST. Larger: other
failures are called singularities. Smaller: ends at singularities are reported as
MODE_LOST.
"""

END_AT_EQUAL_CURVATURE = 1e-3
"""Difference of curvatures at the last node below which a path ends because of CURVATURE.

It applies to paths along which inputs move straight to given values. Larger: other
failures are called so. Smaller: such ends are reported as MODE_LOST.
"""

END_AT_PROFILE_END_RAD = 1e-6
"""Distance (rad) of the last node from the end of an open profile that means OFF_PROFILE.

It applies to paths along which inputs move straight to given values. Larger: other
failures are called so. Smaller: such ends are reported as MODE_LOST.
"""

# ---- MODE_LOST: whether a configuration is on its assembly mode

PREDICTION_RATIO = 0.25
"""Largest distance of a solution from its prediction, over the distance of two nodes.

Solutions farther away are MODE_LOST, unless `PREDICTION_SLACK_RAD` accepts them.
Larger: the solution of a neighbouring mode can be accepted. Smaller: rows between
distant nodes are lost.
"""

PREDICTION_SLACK_RAD = 1e-6
"""Deviation (rad) of a solution from its prediction that is always accepted.

Larger: the solution of a mode that is this near can be accepted. Smaller: rounding
errors near singular configurations are reported as MODE_LOST.
"""

MODE_CHANGE_RATIO = 10.0
"""Largest change of a row by Newton's method, over the verified error of its cell.

It applies to rotations about a fixed axis, whose cells have verified errors. Larger:
rows of another mode can be accepted. Smaller: correct rows are reported as MODE_LOST.
"""

MODE_CHANGE_RAD = 1e-8
"""Change of such a row by Newton's method (rad) that never counts as a change of the mode.

Larger: rows of another mode can be accepted between close nodes. Smaller: rounding
errors near singular configurations are reported as MODE_LOST.
"""

SAME_SOLUTION_AS_ROW_RAD = 1e-6
"""Distance (rad) of a reference solution from its row up to which it is the same solution.

Rows with a larger error bound may be farther away. Larger: a neighbouring solution may
be taken. Smaller: inaccurate rows get the status MODE_LOST.
"""

# ---- NO_POLE and ILL_CONDITIONED: whether two links have a pole axis

NO_MOTION = 1e-9
"""Relative rate of two links, over the rate of one of them, below which they have NO_POLE.

The rate is that of the link with the larger index, or 1 if it is less. Links with a
usable pole direction keep their pole. Larger: slow relative motions have no axis.
Smaller: rounding of equal rates is called motion.
"""

USABLE_DIRECTION = 1e-6
"""Error bound (rad) above which a pole direction is not returned but ILL_CONDITIONED.

Larger: less accurate directions are returned. Smaller: more rows near singularities
have none.
"""

# ---- CURVATURE, OFF_PROFILE and LIFT_OFF: contacts

EQUAL_CURVATURE = 1e-9
"""Difference of curvatures below which profiles do not determine their motion.

Such rows have the status CURVATURE. Larger: more rows near equal curvatures have it.
Smaller: rates with fewer than seven digits are returned.
"""

PROFILE_END_ROUNDING = 4.0 * EPS
"""Arc length, relative to the whole length, by which a point may be beyond an open end.

Points farther beyond are OFF_PROFILE. Larger: points beyond the end count as its end.
Smaller: the rounding error of an arc length can put the end itself outside.
"""

MAX_ROW_PULL = 1e-12
"""Largest pull of a contact, relative to the largest reaction, of a row that is OK.

Rows with a larger pull are LIFT_OFF. Larger: small pulls are not noticed. Smaller:
rounding counts as a pull.
"""

MAX_SIMULATED_PULL = 1e-9
"""The same for a simulation, which ends when a contact pulls more.

It is larger than `MAX_ROW_PULL` because the states of a simulation have the errors of
its steps. Larger: contacts lift off late. Smaller: these errors end simulations.
"""

# ---- BOUND_EXCEEDED: comparison with a proof

SAME_PROVEN_CONFIGURATION_RAD = 1e-6
"""Distance (rad) up to which a proven configuration is that of the row.

Only then are its poles compared with the row, which may become BOUND_EXCEEDED. Larger:
the poles of a neighbouring mode may be compared. Smaller: rows with a large error are
not compared.
"""
