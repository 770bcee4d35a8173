"""The stiffness of an output link if the inputs that hold it yield like springs."""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.dynamics.inverse_dynamics import InverseSolution
from spherekit.geometry.vectors import nans
from spherekit.status import Status

MIN_RELATIVE_COMPLIANCE = 1e-12
"""Smallest compliance of an axis, relative to the largest, that is no rounding error.

Larger: stiff axes count as rigid. Smaller: rounding errors count as compliance.
"""

MIN_RELATIVE_LINK_SPEED = 1e-12
"""Smallest angular velocity of the link by an input, relative to that of the fastest link,
that is no rounding error.

Larger: inputs that move the link slowly count as not moving it. Smaller: rounding errors
count as motion.
"""


@dataclass(frozen=True)
class Stiffness:
    """How the inputs move an output link, and how stiffly they hold this link.

    The inputs move and hold the output link relative to another link. Each input yields
    like a spring; all other parts are rigid. The arrays have n rows, one for each
    configuration.

    Attributes
    ----------
    w
        (n, inputs, 3) angular velocity of the link relative to the other link, per unit
        rate of each input, in ground axes.
    advantage
        (n, inputs) mechanical advantage ``1 / |w|``: the moment on the link about the axis
        of w that a unit torque at this input balances while the other inputs are locked.
        Infinite if the input does not move the link.
    stiffness
        (n, 3) principal stiffnesses of the link in rising order, N m/rad: moment about a
        principal axis, divided by the angle by which the link yields. Infinite about axes
        that do not yield.
    axes
        (n, 3, 3) the principal axes in rows, in ground axes. A moment about a principal
        axis turns the link about this axis alone. NaN for axes that do not yield.
    """

    w: Floats
    advantage: Floats
    stiffness: Floats
    axes: Floats


def output_stiffness(
    solution: InverseSolution, link: str, relative_to: str, stiffness: Floats
) -> Stiffness:
    """Return the stiffness of a link against moments, if each input yields like a spring.

    Parameters
    ----------
    solution
        Configurations with the motion of the links, from `inverse_dynamics` for example.
    link
        Name of the link.
    relative_to
        Name of the link relative to which it moves.
    stiffness
        (inputs,) stiffness of each input, N m/rad.

    Notes
    -----
    A moment m on the link is balanced by the torques w_i . m of the inputs. These torques
    turn the inputs by w_i . m / k_i, and therefore the link by C m with the compliance C =
    sum of w_i w_i^T / k_i. Here w_i is the angular velocity of the link per unit rate of
    input i, and k_i the stiffness of this input. The principal stiffnesses are the
    reciprocals of the eigenvalues of C. The loads count as constant, even
    if they would change when the link yields.
    """
    link_number = solution.mechanism.link_number
    all_w = solution.motion.w
    w = all_w[:, :, link_number[link]] - all_w[:, :, link_number[relative_to]]
    # Velocities that are only rounding errors count as zero.
    fastest = np.max(np.linalg.norm(all_w, axis=3), axis=2)
    w[np.linalg.norm(w, axis=2) < MIN_RELATIVE_LINK_SPEED * fastest] = 0.0
    is_ok = solution.rate_status == Status.OK
    w[~is_ok] = np.nan
    # Letters: n row, i input, a b components.
    compliance = np.einsum("nia,nib,i->nab", w, w, 1.0 / stiffness)
    principal_compliances = nans((len(w), 3))
    axes = nans((len(w), 3, 3))
    # Eigenvalues in rising order, and eigenvectors in columns.
    principal_compliances[is_ok], columns = np.linalg.eigh(compliance[is_ok])
    axes[is_ok] = np.swapaxes(columns, 1, 2)
    # Axes about which the link does not yield get NaN, and an infinite stiffness below.
    is_rigid = principal_compliances < (
        MIN_RELATIVE_COMPLIANCE * principal_compliances[:, -1:]
    )
    principal_compliances[is_rigid] = 0.0
    axes[principal_compliances == 0.0] = np.nan
    # An eigenvector has an arbitrary sense. The sense on the side of a weighted sum of the
    # angular velocities w_i is chosen. The weights differ, so that two opposite velocities
    # do not cancel.
    weights = 1.0 + np.arange(w.shape[1])
    side = np.sum(w / weights[:, None], axis=1)
    axes *= np.where(axes @ side[..., None] < 0.0, -1.0, 1.0)
    # The mechanical advantage of an input is the moment on the link that a unit torque at
    # this input balances: 1 / |w|. Axes are in the order of rising stiffness, so of falling
    # compliance.
    with np.errstate(divide="ignore", invalid="ignore"):
        return Stiffness(
            w=w,
            advantage=1.0 / np.linalg.norm(w, axis=2),
            stiffness=1.0 / principal_compliances[:, ::-1],
            axes=axes[:, ::-1],
        )
