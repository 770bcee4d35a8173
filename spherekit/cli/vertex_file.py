"""Mechanism file of a vertex of folded paper, from its sector angles.

The rigid sectors between the creases are the links s1, s2, ..., sn, and the creases c1,
c2, ..., cn are the pairs. Crease ck joins the sectors s(k - 1) and sk, and c1 joins sn and
s1. The first n - 3 creases are driven. The other three follow from the spherical triangle
whose sides are the sectors s(n - 2) and s(n - 1) and the arc between the creases c(n - 2)
and cn.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.errors import OutputError
from spherekit.geometry.rotation import rotation_about_axis

DEFAULT_SECTORS_DEG = (100.0, 60.0, 80.0, 120.0)
"""Sector angles of a new vertex if the user gives none: a flat-foldable vertex."""

MIN_CREASES = 4
MAX_CREASES = 12
"""The least and the largest number of creases for which files are written.

A vertex of three creases is rigid. The upper limit bounds the time of the search for
ranges, which tries all combinations of signs of the driven fold angles.
"""

FOLD_MARGIN_DEG = 5
"""Least distance of the fold angle of the second-last crease from 0 and 180 degrees.

At 0 and 180 degrees the two assembly modes meet, so the motion of the last creases is not
determined. Larger: smaller ranges of inputs. Smaller: ranges that end closer to a
singularity.
"""

TEMPLATE = Path(__file__).parent / "templates" / "vertex.toml.in"


@dataclass(frozen=True)
class FoldRange:
    """Range of fold angles in which the driven creases fold, all by the same magnitude.

    Attributes
    ----------
    signs
        Sign of each driven fold angle: +1 for a valley, -1 for a mountain.
    low, high
        Ends of the range of the magnitude, in whole degrees.
    """

    signs: tuple[int, ...]
    low: int
    high: int


def vertex_text(sectors_deg: Sequence[float]) -> str:
    """Return the text of the mechanism file of a vertex, with ``NAME`` as its name.

    A vertex is a point of folded paper at which n creases meet. The sectors s1 ... sn
    between them are links, and s1 is fixed. The creases c1 ... cn are pairs, of which
    c1 ... c(n - 3) are driven. Crease ck joins the sectors s(k - 1) and sk, and c1 joins sn
    and s1.

    Parameters
    ----------
    sectors_deg
        (n,) angles of the sectors, counter-clockwise, degrees.

    Raises
    ------
    OutputError
        There are too few or too many sectors, an angle is not between 0 and 180 degrees, or
        no fold angles were found with which the sectors close.
    """
    _check_sectors(sectors_deg)
    n = len(sectors_deg)
    fold_range = find_fold_range(sectors_deg)
    links = [
        f's{k} = {{ axes = ["c{k}", "c{k % n + 1}"], arcs = [{angle}] }}'
        for k, angle in enumerate(map(float, sectors_deg), 1)
    ]
    pairs = [
        f'c{k} = {{ type = "R", links = ["s{(k - 2) % n + 1}", "s{k}"], zero = 180.0 }}'
        for k in range(1, n + 1)
    ]
    inputs = [
        f"[inputs.c{k}]\n"
        f"from = {sign * fold_range.low:.1f}\n"
        f"to = {sign * fold_range.high:.1f}"
        for k, sign in enumerate(fold_range.signs, 1)
    ]
    # The output is a sector that moves with every driven crease. Only s(n - 2) and s(n - 1)
    # do so: sn moves only with c1, and the sectors before s(n - 2) do not move with c1. The
    # one of these two sectors that is more nearly opposite to s1 is used.
    output_number = max(n // 2 + 1, n - 2)
    output_name = "opposite" if n <= 7 else "sector"
    output = f'[outputs.{output_name}]\nlink = "s{output_number}"'
    if len(inputs) == 2:
        # Two inputs determine only a direction of the output. The output is s(n - 2), which
        # has two creases. Of these, c(n - 2) does not move with c1, so c(n - 1) is used.
        output += f'\naxis = "c{n - 1}"   # the crease that is pointed with'
    replacements = {
        "@DEGREE@": str(n),
        "@LINKS@": "\n".join(links),
        "@PAIRS@": "\n".join(pairs),
        "@INPUTS@": "\n\n".join(inputs),
        "@OUTPUT@": output,
        "@BEFORE@": str(n - 2),
        "@LAST@": str(n - 1),
        "@MIDDLE@": f"c{n - 1}",
        "@MARGIN@": str(FOLD_MARGIN_DEG),
        "@TOGETHER@": " while all inputs fold together" if len(inputs) > 1 else "",
    }
    text = TEMPLATE.read_text("utf-8")
    for word, replacement in replacements.items():
        text = text.replace(word, replacement)
    return text


def find_fold_range(sectors_deg: Sequence[float]) -> FoldRange:
    """Return the longest range of fold angles in which a vertex of folded paper closes.

    At a vertex n creases (hinges) meet, with rigid sectors between them. The vertex closes
    if all sectors fit together. The fold angle of the second-last crease must also differ
    from 0 and 180 degrees by at least `FOLD_MARGIN_DEG`, since two assembly modes meet
    there. The fold angles of the driven creases have equal magnitude, which runs from 1 to
    179 degrees. All combinations of valleys and mountains are tried.

    Parameters
    ----------
    sectors_deg
        (n,) angles of the sectors, counter-clockwise, degrees.

    Raises
    ------
    OutputError
        The vertex closes in no such configuration.
    """
    # A vertex of n creases moves with n - 3 degrees of freedom: so many creases are driven.
    driven_count = len(sectors_deg) - 3
    fold_ranges: list[FoldRange] = []
    for signs in itertools.product((1, -1), repeat=driven_count):
        # Reversing all fold angles only mirrors the vertex. So the first crease is always a
        # valley (+1).
        if signs[0] == 1:
            fold_ranges += _list_fold_ranges(sectors_deg, signs)
    # Of several longest ranges the first one is returned.
    longest = max(fold_ranges, key=_length, default=None)
    if longest is None:
        angles = ", ".join(f"{angle:g}" for angle in sectors_deg)
        raise OutputError(
            f"--sectors: no fold angles were found at which sectors of {angles} deg close; "
            "the first creases were folded by equal angles. Each sector must be smaller "
            "than the sum of the others, and any three sectors together smaller than the "
            "sum of the others plus 360 deg (any five: plus 720 deg, and so on); if they "
            "are, begin the list with another sector"
        )
    return longest


def _list_fold_ranges(
    sectors_deg: Sequence[float], signs: tuple[int, ...]
) -> list[FoldRange]:
    """Return the ranges of fold angles in which a vertex of folded paper closes.

    At a vertex n creases (hinges) meet, with rigid sectors between them. The first n - 3
    creases are driven. Their fold angles have the same magnitude, with given signs. The
    vertex closes if the last three creases can connect the remaining two sectors. The fold
    angle of the second-last crease must also differ from 0 and 180 degrees by at least
    `FOLD_MARGIN_DEG`, since two assembly modes meet there. Magnitudes are tried in steps of
    one degree. The caller selects the longest range.

    Parameters
    ----------
    sectors_deg
        (n,) angles of the sectors, counter-clockwise, degrees.
    signs
        (n - 3,) sign of the fold angle of each driven crease: +1 for a valley, -1 for a
        mountain.
    """
    sectors = np.radians(np.asarray(sectors_deg, float))
    magnitudes_deg = np.arange(1, 180)
    fold_angles = np.radians(magnitudes_deg[:, None] * np.array(signs))
    is_closed = _can_close(sectors, fold_angles)
    # Successive magnitudes at which the vertex closes form a range. The last range grows
    # by one magnitude at a time.
    fold_ranges: list[FoldRange] = []
    range_start: int | None = None
    for magnitude, closes in zip(magnitudes_deg.tolist(), is_closed, strict=True):
        if not closes:
            range_start = None
        elif range_start is None:
            range_start = magnitude
            fold_ranges.append(FoldRange(signs, range_start, magnitude))
        else:
            fold_ranges[-1] = FoldRange(signs, range_start, magnitude)
    return fold_ranges


def _length(fold_range: FoldRange) -> int:
    """Return the length of a range of fold angles, degrees."""
    return fold_range.high - fold_range.low


def _can_close(sectors: Floats, fold_angles: Floats) -> Bools:
    """Return a mask of configurations in which the last three creases can close a vertex.

    At a vertex n creases (hinges) c1 ... cn meet. Between them are rigid sectors, in the
    order c1, s1, c2, s2, ..., cn, sn. The creases c1 ... c(n - 3) are driven. So the
    sectors sn, s1, ..., s(n - 3) form a strip with known angles. The end creases of the
    strip are c(n - 2) and cn, and two more sectors must connect them:

        c(n - 2)   s(n - 2)   c(n - 1)   s(n - 1)   cn

    These three creases are the corners of a spherical triangle with known sides. Its cosine
    rule gives the fold angle of c(n - 1).

    Parameters
    ----------
    sectors
        (n,) angles of the sectors s1 ... sn, rad.
    fold_angles
        (t, n - 3) fold angles of the driven creases, rad, in t configurations.

    Returns
    -------
    Mask (t,) of the configurations in which the vertex closes and the fold angle of c(n -
    1) differs from 0 and 180 degrees by at least `FOLD_MARGIN_DEG`.
    """
    *driven_sectors, side_a, side_b, last_sector = (
        sectors  # s1 ... s(n - 3); the last three
    )
    cos_distance = _cos_end_creases([last_sector, *driven_sectors], fold_angles)
    # Cosine of the angle of the triangle at c(n - 1), which is 180 degrees minus the fold
    # angle. If the triangle is impossible, the magnitude of this cosine exceeds 1.
    cos_middle = (cos_distance - np.cos(side_a) * np.cos(side_b)) / (
        np.sin(side_a) * np.sin(side_b)
    )
    # The tolerance admits fold angles that equal the margin up to rounding.
    limit = np.cos(np.radians(FOLD_MARGIN_DEG)) + 1e-12
    return np.abs(cos_middle) <= limit


def _cos_end_creases(sectors: Sequence[float], fold_angles: Floats) -> Floats:
    """Return the cosine of the angle between first and last crease of a folded strip.

    The strip has m rigid sectors, which are joined by creases (hinges) that meet in one
    point. The caller checks whether two more sectors can connect the first and the last
    crease.

    Parameters
    ----------
    sectors
        (m,) angles of successive sectors, rad.
    fold_angles
        (t, m - 1) fold angles of the creases between them, rad, in t configurations.

    Returns
    -------
    (t,) cosines.
    """
    # Follow the strip with a frame, starting at the first crease. Axis z is the crease
    # reached so far. A sector turns the frame about x by its angle, a crease about z by its
    # fold angle.
    x_axis, _, z_axis = np.eye(3)
    first_sector, *later_sectors = sectors
    frames = np.broadcast_to(np.eye(3), (len(fold_angles), 3, 3))
    frames = frames @ rotation_about_axis(x_axis, [first_sector])
    for sector, crease_angles in zip(later_sectors, fold_angles.T, strict=True):
        frames = frames @ rotation_about_axis(z_axis, crease_angles)
        frames = frames @ rotation_about_axis(x_axis, [sector])
    # The first crease is the axis z at the start, so this is the scalar product of the two
    # creases.
    return frames[:, 2, 2]


def _check_sectors(sectors_deg: Sequence[float]) -> None:
    """Raise `OutputError` unless a file of these sectors can be written."""
    n = len(sectors_deg)
    if not MIN_CREASES <= n <= MAX_CREASES:
        raise OutputError(
            f"--sectors: found {n} angles, expected {MIN_CREASES} to {MAX_CREASES}, one "
            "for each sector between two creases; three sectors are rigid"
        )
    for k, angle in enumerate(sectors_deg, 1):
        if not 0.0 < angle < 180.0:
            raise OutputError(
                f"--sectors: sector {k} has {angle:g} deg, expected an angle between 0 and "
                "180 deg; split a larger sector by a crease"
            )
