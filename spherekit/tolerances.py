"""Tolerances that decide the status of a sample."""

EPS = 2.220446049250313e-16
"""Unit roundoff of float64, doubled (the spacing of numbers just above 1)."""


CLOSURE_TOLERANCE = 1e-12
"""Largest loop rotation (rad) of a sample reported as OK; solvers reach 1e-15."""


REACH_SLACK = 16 * EPS
"""A spherical triangle may miss closing by this much (rad): rounding of its arcs."""


USABLE_DIRECTION = 1e-6
"""A pole direction with a larger error bound (rad) is not given."""


NO_MOTION = 1e-9
"""Links whose relative rate is below this part of their own rates move as one."""


EQUAL_CURVATURE = 1e-9
"""Profiles in contact whose curvatures differ by less do not determine their motion."""


SINGULAR_RATIO = 1e-11
"""Smallest relative singular value of the closure Jacobian with trusted rates."""


SINGULAR_DYAD_SINE = 1e-6
"""A dyad whose sine at its dead centre is smaller has half its digits only.

Such samples are solved in quad precision and have the status AT_SINGULARITY. Larger: more
samples near dead centres have this status, and no rates. Smaller: rates with fewer correct
digits are returned.
"""


SINGULAR_GROUP_CONDITION = 1e-6
"""The same for the reciprocal condition number of a group that is not a dyad."""
