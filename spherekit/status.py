"""Status codes of samples, and what each of them means."""

from enum import IntEnum


class Status(IntEnum):
    """The outcome of one sample, or of one number of it.

    OK means that there is a result. All other values are reasons why there is none.
    `STATUS_MEANING` has the texts for users, which also say what to do.
    """

    OK = 0
    OUT_OF_REACH = 1  # the links cannot be assembled at this input or pose
    AT_SINGULARITY = 2  # the inputs do not determine the motion
    MODE_LOST = 3  # a solution in another assembly mode than the requested one
    NOT_CONVERGED = 4  # the iteration ended without a solution
    NOT_CLOSED = 5  # the loops are open by more than the tolerance
    NO_POLE = 6  # two links without relative motion, which have no pole axis
    ILL_CONDITIONED = 7  # too few digits of a pole axis, an inertia or a torque
    OFF_PROFILE = 8  # a contact is beyond the end of an open profile
    CURVATURE = 9  # profiles with equal curvature, or that enter each other
    OVERFLOW = 10  # a number too large for float64
    LIFT_OFF = 11  # a contact that would have to pull
    BOUND_EXCEEDED = 12  # a proof contradicts the error bound of the sample


STATUS_MEANING = {
    Status.OK: "closed, on its assembly mode, with finite rates",
    Status.OUT_OF_REACH: "the arcs cannot close at this input or pose, a joint limit "
    "excludes the pose (column limiting names it), the assembly mode ends at a "
    "dead centre before it, or with several inputs no configuration here is joined to it; "
    "narrow the range, sample more finely or change the arcs",
    Status.AT_SINGULARITY: "the links close, but the input rate does not determine "
    "the motion here; choose another input pair or step around it",
    Status.MODE_LOST: "a solution was found, but not on this assembly mode; ask for more "
    "samples or start nearer",
    Status.NOT_CONVERGED: "the iteration did not reach the tolerance; start nearer "
    "or check for nearly parallel axes",
    Status.NOT_CLOSED: "the closure residual is above the tolerance",
    Status.NO_POLE: "the two links do not move relative to each other here: the "
    "coefficient is zero and they have no pole axis",
    Status.ILL_CONDITIONED: "nearly parallel axes or a singularity nearby leave the "
    "direction of this pole, though the links move, or the inertia and torque of this row "
    "unknown to the accuracy asked for",
    Status.OFF_PROFILE: "the contact has run off the end of an open profile",
    Status.CURVATURE: "at the contact the profiles have equal curvature or would enter "
    "each other; use a smaller roller or a less curved cam",
    Status.OVERFLOW: "a load, an inertia or their torque is too large for a number; use "
    "other units, or look for a load that grows without bound",
    Status.LIFT_OFF: "a contact would have to pull to keep its links together; press it "
    "with a spring, or move more slowly",
    Status.BOUND_EXCEEDED: "a proven enclosure shows that this row is off by more than its "
    "error bound says; please report it with the mechanism",
}
