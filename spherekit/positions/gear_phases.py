"""How far wheels have rolled on each other at given inputs, over whole revolutions.

Two wheels that are put together one tooth or one revolution further on also close the
loops, but the mechanism then has another configuration. The rolled length of a contact is
therefore not reduced by whole revolutions, as an angle is. Which assembly a file means is
fixed at one value of the inputs, the anchor. If the file has a reference pose, this is the
anchor. Otherwise all inputs are zero at the anchor. The file then means the assembly in
which the wheels have the smallest rolled lengths at the anchor
(`spherekit.planning.least_rolling`). From the anchor the rolled lengths continue with the
inputs over any number of revolutions. If a train of wheels leads from the inputs to a
contact, its rolled length is a linear function of the inputs, also where the rest of the
mechanism does not close.
"""

from fractions import Fraction
from math import lcm
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.geometry.vectors import nans
from spherekit.mechanism.joint import MAX_TEETH, Joint
from spherekit.planning.gear_train import GearTrain
from spherekit.planning.least_rolling import SAME_ROLLED_LENGTH_RAD
from spherekit.positions.loop_closure import Closure
from spherekit.positions.pair_states import list_rolling_variables

GEAR_RATIO_TOLERANCE = 1e-9
"""Gear ratios below this are zero, and laps per revolution that differ by less are equal.

Larger: wheels of irrational ratio can get a finite period. Smaller: rounding errors of the
radii hide the ratio of the numbers of teeth.
"""
MAX_LENGTHS_PER_CONTACT = 8
"""Largest number of rolled lengths of one contact that are tried. Larger: more time."""
MAX_LENGTH_COMBINATIONS = 4096
"""Largest number of combinations of rolled lengths of all contacts that are compared.

Larger: more time. Smaller: the assembly that is looked for may not be among them.
"""
MAX_TRIED_ASSEMBLIES = 64
"""Largest number of combinations of rolled lengths, smallest first, that are assembled.

Larger: more time. Smaller: the assembly that is looked for may not be among them.
"""
MAX_INPUT_REVOLUTIONS = 12
"""Largest number of whole revolutions in the combinations of inputs that are all tried.

Larger: more combinations of inputs are tried. Smaller: if several inputs must make many
revolutions and the rolled lengths do not determine them, wheels are not recognised.
"""


class GearPhases(NamedTuple):
    """The lengths that wheels have rolled on each other, as linear functions of the inputs.

    A rolled length is the arc length by which two wheels have rolled on each other. The
    rolled length tells the position of the wheels, also after many revolutions.

    Attributes
    ----------
    variables
        Indices of the m variables that are these rolled lengths.
    anchor_inputs
        (inputs,) values of the inputs (rad) at which the lengths are `lengths`.
    lengths
        (m,) rolled lengths (rad) at these inputs, the anchor.
    ratios
        (m, inputs) derivatives of the rolled lengths with respect to the inputs.
    periods
        (inputs,) for each input, by how much it must grow (rad) until the same
        configurations return. This follows from the gear ratios.

        - Finite: after this growth, all wheels are in their first positions again.
        - Infinite: the wheels are never all in their first positions again, or some contact
          only after more than `MAX_TEETH` revolutions. The period is set to infinite if
          only some rolled lengths follow from the inputs.
        - NaN for all inputs: no rolled length follows from the inputs.
    all_known
        Whether the rolled lengths of all contacts follow from the inputs.
    """

    variables: tuple[int, ...]
    anchor_inputs: Floats
    lengths: Floats
    ratios: Floats
    periods: Floats
    all_known: bool

    def rolled_lengths(self, q: Floats) -> Floats:
        """Return the rolled lengths (n, m) in rad at inputs q (n, inputs) in rad."""
        return self.lengths + (q - self.anchor_inputs) @ self.ratios.T


def variable_periods(closure: Closure) -> Floats:
    """Return the period (variables,) of each pair variable, in rad.

    The period is the growth of the variable after which the pair is in the same state
    again, such as one revolution. The period is infinite for variables that never return to
    the same state.
    """
    return np.array([period for joint in closure.joints for period in joint.periods])


def make_gear_phases(
    closure: Closure, anchor: Floats, train: GearTrain | None
) -> GearPhases | None:
    """Return how far wheels have rolled on each other, as linear functions of the inputs.

    A rolled length is how far two wheels have rolled on each other, as an arc length. The
    loops also close if two wheels are put together one tooth further. The rolled lengths at
    the anchor, one chosen value of the inputs, say which of these assemblies is meant. At
    other inputs, the rolled lengths follow from those at the anchor by gear ratios.

    Parameters
    ----------
    closure
        The loops of the whole mechanism.
    anchor
        (inputs,) values of the inputs (rad) at the anchor.
    train
        The wheels that follow the inputs by gear ratios, None if there are none.

    Returns
    -------
    The rolled lengths, with the periods of the inputs after which the same configurations
    return. Periods are infinite if only some rolled lengths follow from the inputs, and NaN
    if none does. The result is None if the mechanism has no rolling contact.
    """
    # Variables that count how far two wheels have rolled on each other.
    rolling = [variable for variable, _ in list_rolling_variables(closure.joints)]
    if not rolling:
        return None
    if train is None:
        # No rolled length follows from the inputs. NaN periods mark this case.
        no_ratios = np.zeros((0, len(anchor)))
        return GearPhases(
            variables=(),
            anchor_inputs=anchor,
            lengths=no_ratios[:, 0],
            ratios=no_ratios,
            periods=nans(len(anchor)),
            all_known=False,
        )
    # The variables that are rolled lengths of the contacts in the train.
    variables = [v for v in rolling if closure.tree.pair_of_variable[v] in train.contacts]
    ratios = train.length_ratios
    # Whether the rolled lengths of all contacts follow from the inputs. If only some do,
    # the periods stay infinite.
    all_known = len(variables) == len(rolling)
    periods = np.full(len(anchor), np.inf)
    if all_known:
        # Growth of each rolled length after which the contact is in the same state again.
        lap_lengths = variable_periods(closure)[variables]
        periods = np.array(
            [_find_input_period(lap_lengths, input_ratios) for input_ratios in ratios.T]
        )
    return GearPhases(
        variables=tuple(variables),
        anchor_inputs=anchor,
        # `train.lengths` are the rolled lengths if all inputs are zero.
        lengths=train.lengths + ratios @ anchor,
        ratios=ratios,
        periods=periods,
        all_known=all_known,
    )


def list_equivalent_lengths(joint: Joint, length: float) -> list[float]:
    """Return rolled lengths that differ from a given one by whole revolutions of a wheel.

    A rolled length is how far the two wheels of a contact have rolled on each other, as an
    arc length. After a whole revolution a wheel looks the same, but the rolled length
    differs by its circumference. The other wheel then generally touches at another point.

    The caller knows a rolled length that closes the loops, but not how many revolutions the
    wheels have made. It tries the lengths of this list.

    Parameters
    ----------
    joint
        The rolling contact.
    length
        A rolled length (rad) of this contact.

    Returns
    -------
    The length itself, and lengths that differ from it by revolutions of the first wheel or
    of the second wheel, the smallest absolute values first. For each wheel these
    are all lengths between minus and plus half of the longer circumference, and a few
    beyond. There are at most `MAX_LENGTHS_PER_CONTACT` lengths. If one wheel is much
    smaller than the other, the largest lengths by its revolutions are therefore missing.
    """
    # Keys are rounded lengths, so that equal lengths occur once.
    lengths = {round(length / SAME_ROLLED_LENGTH_RAD): length}
    # The wheel with the longer circumference comes first, because it has few lengths, none
    # of which may be missing.
    circumferences = sorted(joint.closed_lengths, reverse=True)
    for circumference in circumferences:
        # The given length, less as many revolutions of this wheel as bring it nearest to 0.
        smallest = length - circumference * round(length / circumference)
        # So many revolutions cover half of the longer circumference.
        max_revolutions = int(np.ceil(0.5 * max(circumferences) / circumference))
        revolutions = range(-max_revolutions, max_revolutions + 1)
        candidates = [smallest + number * circumference for number in revolutions]
        for candidate in sorted(candidates, key=abs):
            lengths.setdefault(round(candidate / SAME_ROLLED_LENGTH_RAD), candidate)
    return sorted(list(lengths.values())[:MAX_LENGTHS_PER_CONTACT], key=abs)


def _find_input_period(lap_lengths: Floats, ratios: Floats) -> float:
    """Return the growth (rad) of one input after which all wheels are as before.

    After this growth the same configurations return. The growth is a whole number of
    revolutions of the input. Each contact of two wheels needs a number of revolutions until
    its wheels are as before. The result has the least common multiple of these numbers.

    A rolled length is how far the two wheels of a contact have rolled on each other, as an
    arc length on the unit sphere (rad).

    Parameters
    ----------
    lap_lengths
        (m,) growth of the rolled length (rad) of each contact after which both its wheels
        are in their first positions again. Infinite if they never are.
    ratios
        (m,) derivatives of the rolled lengths with respect to the input.

    Returns
    -------
    The period, infinite if the wheels never return together.
    """
    never_returns = np.isinf(lap_lengths) & (np.abs(ratios) > GEAR_RATIO_TOLERANCE)
    if np.any(never_returns):
        return np.inf
    # If a contact makes p / q laps in one revolution of the input, its wheels are back
    # after q revolutions. A contact at rest makes 0 / 1 laps.
    revolutions = 1
    for laps_per_revolution in TURN * ratios / lap_lengths:
        # The number of laps is a ratio of numbers of teeth. The denominator is limited,
        # because some fraction with a huge denominator is close to any number.
        fraction = Fraction(float(laps_per_revolution)).limit_denominator(MAX_TEETH)
        if abs(fraction - laps_per_revolution) > GEAR_RATIO_TOLERANCE:
            return np.inf
        revolutions = lcm(revolutions, fraction.denominator)
    return TURN * revolutions
