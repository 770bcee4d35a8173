"""How far wheels have rolled at an input, which is a place on the line, not on the circle.

Two wheels put together one turn further on close the loops as well, and stand differently.
Which of these assemblies a file means is said at one value of the inputs, the anchor: that
of the reference pose, or zero, where the wheels have rolled least. From there the lengths
rolled go on with the inputs over any number of turns. Where a train of wheels leads from
the inputs to a contact, its length is a linear function of them, known also where the
rest of the mechanism does not close.
"""

from fractions import Fraction
from math import lcm
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.geometry.rotation import nans
from spherekit.mechanism.joint import MAX_TEETH, Joint
from spherekit.planning.gear_mesh import SAME_LENGTH
from spherekit.planning.wheel_train import GearTrain
from spherekit.positions.curve_continuation import periods_of
from spherekit.positions.loop_closure import Closure
from spherekit.positions.pair_states import rolled_lengths

SAME_RATIO = 1e-9
"""Laps in a turn of an input that differ by less are the same."""
MOST_CHOICES, MOST_SORTED, MOST_ASSEMBLIES = 8, 4096, 64
"""Lengths of one contact, assemblies of all, and the least rolled of those, to be tried."""
MOST_TURNS = 12
"""Whole turns of an input by which a configuration found may have been put together."""


class GearPhases(NamedTuple):
    """The rolled lengths that follow from the inputs alone.

    `variables` are their numbers; `lengths` (m,) those at the inputs `anchor` (k,), rad;
    `ratios` (m, k) their rates by the inputs. `all_known` says that no other contact
    rolls. `periods` (k,) is the growth of each input with which the same assembly
    returns, infinite if there is none, and NaN where no length follows from the inputs, so
    that a curve itself says when it returns (`ArcCurve.returns_after`).
    """

    variables: tuple[int, ...]
    anchor: Floats
    lengths: Floats
    ratios: Floats
    periods: Floats
    all_known: bool

    def rolled(self, q: Floats) -> Floats:
        """Return the lengths (n, m), rad, at inputs q (n, k)."""
        return self.lengths + (q - self.anchor) @ self.ratios.T


def meshes_of(
    closure: Closure, anchor: Floats, train: GearTrain | None
) -> GearPhases | None:
    """Return what is known of the lengths rolled, None where no contact rolls.

    `anchor` (k,) rad are the inputs from which they go on, `train` is what is known of
    wheels that follow the inputs.
    """
    rolling = [variable for variable, _ in rolled_lengths(closure.joints)]
    if not rolling:
        return None
    if train is None:
        none = np.zeros((0, len(anchor)))
        return GearPhases((), anchor, none[:, 0], none, nans(len(anchor)), False)
    variables = [v for v in rolling if closure.tree.owners[v] in train.contacts]
    ratios, all_known = train.length_ratios, len(variables) == len(rolling)
    periods = np.full(len(anchor), np.inf)
    if all_known:
        laps = periods_of(closure)[variables]
        periods = np.array([_period(laps, ratio) for ratio in ratios.T])
    lengths = train.lengths + ratios @ anchor
    return GearPhases(tuple(variables), anchor, lengths, ratios, periods, all_known)


def whole_turns_apart(joint: Joint, length: float) -> list[float]:
    """Return lengths that differ from one by whole turns of a wheel, the least first."""
    lengths = {round(length / SAME_LENGTH): length}
    for lap in joint.closed_lengths:
        least = length - lap * round(length / lap)
        most = int(np.ceil(0.5 * max(joint.closed_lengths) / lap))
        for turns in range(-most, most + 1):
            lengths[round((least + turns * lap) / SAME_LENGTH)] = least + turns * lap
    return sorted(lengths.values(), key=abs)[:MOST_CHOICES]


def _period(laps: Floats, ratios: Floats) -> float:
    """Return the growth (rad), in whole turns, of an input with which all wheels return."""
    turns = 1
    if np.any(np.isinf(laps) & (np.abs(ratios) > SAME_RATIO)):
        return np.inf
    for passed in TURN * ratios / laps:
        whole = Fraction(float(passed)).limit_denominator(MAX_TEETH)
        if abs(whole - passed) > SAME_RATIO:
            return np.inf
        turns = lcm(turns, whole.denominator)
    return TURN * turns
