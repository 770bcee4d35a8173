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
"""Numbers of creases for which files are written.

Three creases are rigid. The upper limit bounds the time of the search for ranges, which
tries all combinations of signs of the driven fold angles.
"""

FOLD_MARGIN_DEG = 5
"""Distance that the middle one of the last three creases keeps from 0 and 180 degrees.

The two assembly modes meet there, so the last creases are not determined. Larger: smaller
ranges of inputs. Smaller: ranges that end closer to a singularity.
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
    # do so: sn moves only with c1, and the sectors before s(n - 2) do not move with c1. Of
    # these two the one that is more nearly opposite to s1 is used.
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
    """Return the longest range in which the vertex closes while its inputs fold together.

    The fold angles of all driven creases have the same magnitude. All combinations of
    valleys and mountains among them are tried in steps of one degree.

    Parameters
    ----------
    sectors_deg
        (n,) angles of the sectors, counter-clockwise, degrees.

    Raises
    ------
    OutputError
        The vertex closes in no such configuration.
    """
    other_inputs = len(sectors_deg) - 4
    magnitudes_deg = np.arange(1, 180)
    longest: FoldRange | None = None
    for other_signs in itertools.product((1, -1), repeat=other_inputs):
        # The signs of all fold angles can be reversed, so the first one is a valley.
        signs = (1, *other_signs)
        fold_angles = np.radians(magnitudes_deg[:, None] * np.array(signs))
        is_closed = _can_close(np.radians(np.asarray(sectors_deg, float)), fold_angles)
        for closes, group in itertools.groupby(
            zip(magnitudes_deg, is_closed, strict=True), key=lambda item: bool(item[1])
        ):
            magnitudes = [int(magnitude) for magnitude, _ in group]
            fold_range = FoldRange(signs, magnitudes[0], magnitudes[-1])
            if closes and (longest is None or _length(fold_range) > _length(longest)):
                longest = fold_range
    if longest is None:
        angles = ", ".join(f"{angle:g}" for angle in sectors_deg)
        raise OutputError(
            f"--sectors: no fold angles were found at which sectors of {angles} deg close; "
            "the first creases were folded by equal angles. Each sector must be smaller "
            "than the sum of the others; if it is, begin the list with another sector"
        )
    return longest


def _length(fold_range: FoldRange) -> int:
    """Return the length of a range of fold angles, degrees."""
    return fold_range.high - fold_range.low


def _can_close(sectors: Floats, fold_angles: Floats) -> Bools:
    """Return where the last three creases can close the vertex.

    Crease ck joins the sectors s(k - 1) and sk, and c1 joins sn and s1. The creases
    c1 ... c(n - 3) are driven. The last three are c(n - 2), c(n - 1) and cn.

    Parameters
    ----------
    sectors
        (n,) angles of the sectors s1 ... sn, rad.
    fold_angles
        (t, n - 3) fold angles of the driven creases, rad, in t configurations.

    Returns
    -------
    (t,) booleans: the fold angle of the middle one of the last three creases differs from 0
    and 180 degrees by at least `FOLD_MARGIN_DEG`.
    """
    # Walk from crease cn along the sectors sn, s1, ..., s(n - 3) to crease c(n - 2), over
    # the driven creases between them. The axis z of a frame is the crease reached so far.
    # Along a sector the frame turns about x by the sector's angle, and at a driven crease
    # about z by the fold angle.
    x_axis, _, z_axis = np.eye(3)
    frames = np.broadcast_to(np.eye(3), (len(fold_angles), 3, 3))
    walked_sectors = [sectors[-1], *sectors[:-3]]
    for k, sector in enumerate(walked_sectors):
        frames = frames @ rotation_about_axis(x_axis, [sector])
        if k < fold_angles.shape[1]:
            frames = frames @ rotation_about_axis(z_axis, fold_angles[:, k])
    # The cosine of the angle between crease cn, the first z axis, and crease c(n - 2).
    cos_distance = frames[:, 2, 2]
    # Cosine rule of the spherical triangle of the last three creases. Its angle at the
    # middle one is 180 degrees minus the fold angle. The sectors s(n - 2) and s(n - 1) are
    # the sides that meet there.
    a, b = sectors[-3], sectors[-2]
    cos_middle = (cos_distance - np.cos(a) * np.cos(b)) / (np.sin(a) * np.sin(b))
    # The tolerance admits fold angles that equal the margin up to rounding.
    limit = np.cos(np.radians(FOLD_MARGIN_DEG)) + 1e-12
    return np.abs(cos_middle) <= limit


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
