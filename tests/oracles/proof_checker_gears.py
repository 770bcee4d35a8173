"""Computes the angle of a wheel in mesh from the input and the teeth, without spherekit.

One link, the carrier, carries two wheels on R pairs. They turn relative to it by f and g.
With the numbers of teeth N1 and N2, N1 f + N2 g is constant, or N1 f - N2 g if one wheel is
within the other. The constant follows from the reference pose. Without a reference pose,
contacts begin at azimuth 0 about both centres. The constant is then known up to whole
turns. They are chosen so that the driven wheel has rolled least at an input of 0.
"""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import arb
from oracles.proof_checker import across, need

HALF_TURN_APART = 1e-6
"""Smallest distance (rad) of an azimuth from half a turn. At a smaller one, the wheel has
rolled about as far in one sense as in the other, so the least rolling is not clear."""


@dataclass(frozen=True)
class Follower:
    """A pair whose angle is `ratio` times the angle of the input plus `offset` (rad)."""

    pair: str
    driven: str
    ratio: Fraction
    offset: arb


def follower_of(sizes, inputs):
    """Return the pair that the only two wheels of a file turn with an input.

    Parameters
    ----------
    sizes
        `Sizes` of the file.
    inputs
        Names of the input pairs.

    Returns
    -------
    Follower
        Ratio and offset of its angle, from the teeth and from the zero positions.
    """
    rolling = [p for p in sizes.data["pairs"].values() if p["type"] == "Cr"]
    need(len(rolling) == 1, "more than one pair of wheels is not checked")
    (item,) = rolling
    need("teeth" in item and "axes" in item, "wheels without teeth are not checked")
    need(not any(float(e) for e in item.get("start", [])), "a start is not checked")
    pairs = item["axes"]
    wheels = item["links"]
    need(len(set(pairs)) == len(set(wheels)) == 2, "not two wheels")
    carriers = set()
    for pair, wheel in zip(pairs, wheels, strict=True):
        need(wheel in sizes.ends[pair], "a wheel that is not about its axis")
        carriers.add(next(link for link in sizes.ends[pair] if link != wheel))
    need(len(carriers) == 1, "wheels that no link carries")
    (carrier,) = carriers
    is_internal = {"external": False, "internal": True}[item.get("contact", "external")]
    teeth = [Fraction(int(count)) for count in item["teeth"]]
    need(min(teeth) > 0, "no teeth")

    # N1 f +- N2 g is constant. The angle of a pair turns its second link.
    factors = [
        count if sizes.ends[pair][1] == wheel else -count
        for pair, wheel, count in zip(pairs, wheels, teeth, strict=True)
    ]
    if is_internal:
        factors[1] = -factors[1]
    driving = [k for k in (0, 1) if pairs[k] in inputs]
    need(len(driving) == 1, "wheels that no input turns, or two do")
    driven = driving[0]
    following = 1 - driven

    if "axes" in sizes.data["links"][wheels[0]]:
        # Contacts begin at azimuth 0 about both centres.
        azimuths = contact_azimuths(sizes, pairs, wheels, carrier, is_internal)
        largest_azimuth = arb.pi() - HALF_TURN_APART
        need(abs(azimuths[driven]) < largest_azimuth, "rolled as far in both senses")
        constant_sum = azimuths[0] * as_ball(teeth[0])
        constant_sum += azimuths[1] * as_ball(teeth[1]) * (-1 if is_internal else 1)
    else:
        # The reference pose gives both angles.
        constant_sum = 0
        for pair, factor in zip(pairs, factors, strict=True):
            value = sizes.data["pairs"][pair].get("value", "0")
            slack = sizes.slack if value != "0" else 0
            constant_sum = constant_sum + as_ball(factor) * (sizes.angle(value) + slack)
    ratio = -factors[driven] / factors[following]
    offset = constant_sum / as_ball(factors[following])
    return Follower(pairs[following], pairs[driven], ratio, offset)


def as_ball(fraction):
    return arb(fraction.numerator) / fraction.denominator


def contact_azimuths(sizes, pairs, wheels, carrier, is_internal):
    """Return the azimuths (rad) at which two wheels touch, with all pair angles zero.

    There is one azimuth for each wheel. It is the angle about the axis of the wheel from
    the direction `across(axis)`, which is fixed in the wheel, to the contact point. The
    azimuths determine the constant in the relation of both pair angles. All numbers are
    intervals that contain the exact number.

    Parameters
    ----------
    sizes
        `Sizes` of the file, with the frames of the pairs in the axes of each link.
    pairs, wheels
        Names of the two pairs, and of the wheel that turns about each of them.
    carrier
        Name of the link that carries both wheels.
    is_internal
        Whether the first circle is within the second one.
    """
    frames_in_carrier = [sizes.frame(pair, carrier) for pair in pairs]
    first_centre, second_centre = (frame[:, 2] for frame in frames_in_carrier)
    cosine = first_centre @ second_centre
    # Direction from each centre to the other one, perpendicular to the axis it starts from.
    to_second_centre = second_centre - cosine * first_centre
    to_first_centre = first_centre - cosine * second_centre
    # The circles touch between the centres, or, if internal, beyond the first centre.
    if is_internal:
        directions_to_contact = (-to_second_centre, to_first_centre)
    else:
        directions_to_contact = (to_second_centre, to_first_centre)
    azimuths = []
    for pair, wheel, frame_in_carrier, direction in zip(
        pairs, wheels, frames_in_carrier, directions_to_contact, strict=True
    ):
        # The frame of a pair is the same in both links while its angle is zero.
        frame_in_wheel = sizes.frame(pair, wheel)
        direction_in_wheel = frame_in_wheel @ frame_in_carrier.T @ direction
        axis = frame_in_wheel[:, 2]
        x = across(axis)
        y = np.cross(axis, x)
        azimuths.append(arb.atan2(direction_in_wheel @ y, direction_in_wheel @ x))
    return azimuths


def check_stated(stated, follower, laps, tolerance):
    """Check that a certificate states the turns and the offset of a follower."""
    need(len(stated) == 1, "other wheels")
    (row,) = stated
    need(row["pair"] == follower.pair, "another wheel")
    need(laps == follower.ratio.denominator, "wheels that are back after other turns")
    need(row["turns"] == follower.ratio * laps, "a wheel that turns otherwise")
    need(0 <= row["off"] < 1e-14 + 1e3 * tolerance, "an offset that is no number")
    apart = follower.offset - arb(row["at_zero_rad"], row["off"])
    need((apart / (2 * arb.pi())).contains_integer(), "a wheel put together otherwise")
