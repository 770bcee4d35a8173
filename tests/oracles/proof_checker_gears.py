"""How far a wheel in mesh turns with an input, from the teeth of a file, without spherekit.

Two wheels that one link carries on R pairs turn in it by f and g, and N1 f + N2 g stays
the same, N1 f - N2 g where one is within the other. How they are put together is said by
the reference pose; without one, contacts begin at azimuth 0 about both centres, and of
whole turns those are meant with which the driven wheel has rolled least at an input of 0.
"""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import arb
from oracles.proof_checker import across, need

HALF_TURN_APART = 1e-6
"""Azimuths (rad) so near to half a turn may be rolled least in both senses."""


@dataclass(frozen=True)
class Follower:
    """A pair that turns by `ratio` times the angle of the input, and `offset` (rad)."""

    pair: str
    driven: str
    ratio: Fraction
    offset: arb


def follower_of(sizes, inputs):
    """The pair that the only wheels of a file turn with an input."""
    rolling = [p for p in sizes.data["pairs"].values() if p["type"] == "Cr"]
    need(len(rolling) == 1, "more than one pair of wheels is not checked")
    (item,) = rolling
    need("teeth" in item and "axes" in item, "wheels without teeth are not checked")
    need(not any(float(e) for e in item.get("start", [])), "a start is not checked")
    pairs, wheels = item["axes"], item["links"]
    need(len(set(pairs)) == len(set(wheels)) == 2, "not two wheels")
    carriers = set()
    for pair, wheel in zip(pairs, wheels, strict=True):
        need(wheel in sizes.ends[pair], "a wheel that is not about its axis")
        carriers.add(next(link for link in sizes.ends[pair] if link != wheel))
    need(len(carriers) == 1, "wheels that no link carries")
    (carrier,) = carriers
    inner = {"external": False, "internal": True}[item.get("contact", "external")]
    teeth = [Fraction(int(count)) for count in item["teeth"]]
    need(min(teeth) > 0, "no teeth")
    # a pair's angle turns its second link
    factors = [
        count if sizes.ends[pair][1] == wheel else -count
        for pair, wheel, count in zip(pairs, wheels, teeth, strict=True)
    ]
    if inner:
        factors[1] = -factors[1]
    driving = [k for k in (0, 1) if pairs[k] in inputs]
    need(len(driving) == 1, "wheels that no input turns, or two do")
    driven, following = driving[0], 1 - driving[0]
    if "axes" in sizes.data["links"][wheels[0]]:
        azimuths = contact_azimuths(sizes, pairs, wheels, carrier, inner)
        room = arb.pi() - HALF_TURN_APART
        need(abs(azimuths[driven]) < room, "rolled as far in both senses")
        whole = azimuths[0] * as_ball(teeth[0])
        whole += azimuths[1] * as_ball(teeth[1]) * (-1 if inner else 1)
    else:
        values = [sizes.data["pairs"][pair].get("value", "0") for pair in pairs]
        rolled = zip(factors, values, strict=True)
        whole = sum(
            as_ball(f) * (sizes.angle(v) + (sizes.slack if v != "0" else 0))
            for f, v in rolled
        )
    ratio = -factors[driven] / factors[following]
    offset = whole / as_ball(factors[following])
    return Follower(pairs[following], pairs[driven], ratio, offset)


def as_ball(fraction):
    return arb(fraction.numerator) / fraction.denominator


def contact_azimuths(sizes, pairs, wheels, carrier, inner):
    """Where the contact is about both centres, in the wheels, with all angles zero."""
    held = [sizes.frame(pair, carrier) for pair in pairs]
    a, b = (frame[:, 2] for frame in held)
    ahead, back = b - (a @ b) * a, a - (a @ b) * b
    azimuths = []
    # circles one within the other touch beyond the centre of the smaller one
    towards = -ahead if inner else ahead, back
    for pair, wheel, frame, way in zip(pairs, wheels, held, towards, strict=True):
        own = sizes.frame(pair, wheel)
        direction, axis = own @ frame.T @ way, own[:, 2]
        x = across(axis)
        azimuths.append(arb.atan2(direction @ np.cross(axis, x), direction @ x))
    return azimuths


def check_stated(stated, follower, laps, tolerance):
    """Show that turns and offset are those that a certificate states."""
    need(len(stated) == 1, "other wheels")
    (row,) = stated
    need(row["pair"] == follower.pair, "another wheel")
    need(laps == follower.ratio.denominator, "wheels that are back after other turns")
    need(row["turns"] == follower.ratio * laps, "a wheel that turns otherwise")
    need(0 <= row["off"] < 1e-14 + 1e3 * tolerance, "an offset that is no number")
    apart = follower.offset - arb(row["at_zero_rad"], row["off"])
    need((apart / (2 * arb.pi())).contains_integer(), "a wheel put together otherwise")
