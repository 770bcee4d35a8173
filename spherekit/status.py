"""Status codes of samples, and what each of them means."""

from enum import IntEnum


class Status(IntEnum):
    """The outcome of one sample (one input value) of an analysis, or of one of its results.

    OK means that there is a result. All other values are reasons why there is none, or why
    it must not be relied on: rows with LIFT_OFF or BOUND_EXCEEDED keep their numbers.
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
    Status.OK: "the loops close in this assembly mode, and all rates are finite",
    Status.OUT_OF_REACH: "there are four possible reasons: the links cannot be assembled "
    "at this input or pose; the assembly mode ends at a dead centre before it; a joint "
    "limit excludes the pose, and the column `limiting` names this limit; or, with several "
    "inputs, no motion leads here. Narrow the range, sample more finely, or change the "
    "arcs",
    Status.AT_SINGULARITY: "the loops close, but the rates of the inputs do not determine "
    "the motion in this configuration; choose another driven pair, or samples beside it",
    Status.MODE_LOST: "a configuration was found, but in another assembly mode; take more "
    "samples, or start nearer to this one",
    Status.NOT_CONVERGED: "the iteration did not reach its tolerance; start nearer, or "
    "check for nearly parallel axes",
    Status.NOT_CLOSED: "the closure residual is above its tolerance; start nearer, or "
    "check for nearly parallel axes",
    Status.NO_POLE: "the two links do not move relative to each other here: their velocity "
    "coefficient is 0, and they have no pole axis",
    Status.ILL_CONDITIONED: "nearly parallel axes or a singularity nearby leave too few "
    "digits of the pole axis, or of the inertia and torque of this row",
    Status.OFF_PROFILE: "the contact is beyond the end of an open profile; make the "
    "profile longer, or narrow the range",
    Status.CURVATURE: "at the contact the profiles have equal curvature or would enter "
    "each other; use a smaller roller or a less curved cam",
    Status.OVERFLOW: "a load, an inertia or a torque is too large for a float64; use "
    "other units, or look for a load that grows without bound",
    Status.LIFT_OFF: "a contact would have to pull to keep its links together; press it "
    "together with a spring, or move more slowly",
    Status.BOUND_EXCEEDED: "a proof shows that the error of this row exceeds its error "
    "bound; please report this with the mechanism file",
}
"""The meaning of each status for users, and what to do."""
