"""The same mechanism said otherwise: turned as a whole, or links of other names, order.

Tables of an analysis compared: where they differ, in words.
"""

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.conventions import Names
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.changed_axes import redescribe, rotate_profile, rotate_vector
from spherekit.mechanism.elements import Pair, PoseGeometry, Profile, SizeGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import pair_frames
from spherekit.mechanism.sizes_from_frames import sizes_from_frames
from spherekit.numerics.angles import wrap
from spherekit.tables.table import Column, Table, TableArrays, row_count


class NotAppliesError(Exception):
    """A check does not apply; says why."""


def turned(mechanism: Mechanism, rotation: Floats) -> Mechanism:
    """Return a mechanism rotated as a whole, `rotation` (3, 3), its ground axes kept.

    Links given by their sizes keep their axes, those given in a pose turn with it.

    Raises
    ------
    NotAppliesError
        If the origin of a profile's arc length follows from the axes.
    """
    given = mechanism.geometry
    links: Names = (mechanism.ground,)
    if isinstance(given, PoseGeometry):
        links = mechanism.links
        axes = {name: rotate_vector(rotation, axis) for name, axis in given.axes.items()}
        geometry: PoseGeometry | SizeGeometry = replace(given, axes=axes)
    else:
        first, second = (
            {
                pair.name: rotation @ frames[pair.name]
                if pair.links[end] == mechanism.ground
                else frames[pair.name]
                for pair in mechanism.pairs
                if pair.kind.has_axis
            }
            for end, frames in enumerate(pair_frames(mechanism))
        )
        others = {k: x for k, x in given.links.items() if k != mechanism.ground}
        geometry = sizes_from_frames(mechanism.pairs, (first, second), others)
    return replace(
        mechanism,
        geometry=geometry,
        **redescribe(
            mechanism,
            rotations=dict.fromkeys(links, rotation),
            ground_rotation=rotation,
            rotate_pair_profile=_profile,
        ),
    )


def _profile(profile: Profile, rotation: Floats, pair: Pair) -> Profile:
    if not profile.points:
        raise NotAppliesError(f"a {profile.kind} counts its arc length from the axes")
    return rotate_profile(profile, rotation, pair)


def renamed(mechanism: Mechanism, names: Mapping[str, str]) -> Mechanism:
    """Return a mechanism with other names of links; moving ones in the order of `names`."""
    given = mechanism.geometry
    if isinstance(given, SizeGeometry):
        links = {names[link]: sizes for link, sizes in given.links.items()}
        given = replace(given, links=links)
    words = {
        f"s_{pair.name}_{link}": f"s_{pair.name}_{names[link]}"
        for pair in mechanism.pairs
        if pair.kind.variable_count > 1
        for link in pair.links
    }
    return replace(
        mechanism,
        ground=names[mechanism.ground],
        links=tuple(names.values()),
        geometry=given,
        **redescribe(mechanism, link_names=names, expression_names=words),
    )


BLOCKS = 1e-10
"""Numbers from other blocks may differ by so much, of the largest of their column or 1."""
VARIANTS = 1e-6
"""Numbers from a mechanism said otherwise: roundings grow where it is nearly singular."""


def difference(
    table: Table,
    one: TableArrays,
    other: TableArrays,
    within: float = BLOCKS,
    rotation: Floats | None = None,
) -> str:
    """Return the first column in which tables differ, in words, or nothing.

    What describes the computation is compared where the mechanism is said the same. With
    a `rotation` (3, 3) vectors of the first are turned by it, and what else depends on axes
    is left out. Where rows are not those of samples, or texts that depend on axes name
    them, they are other rows in other axes, and none is compared.
    """
    others = [column.kind for column in table.columns if column.turns == "otherwise"]
    unnamed = not table.in_assembly_modes or "text" in others
    if rotation is not None and others and unnamed:
        return ""
    rows = [row_count(one), row_count(other)]
    if rows[0] != rows[1]:
        return f"table {table.name} has {rows[1]} rows instead of {rows[0]}"
    for column, first, second in _pairs(table, one, other, rotation):
        if within >= VARIANTS and column.scale == "none":
            continue
        off = _off(column, first, second, within)
        if off is not None:
            return (
                f"table {table.name}, column {column.name}, row {off}: {second[off]} "
                f"instead of {first[off]}"
            )
    return ""


def _pairs(
    table: Table, one: TableArrays, other: TableArrays, rotation: Floats | None
) -> Iterator[tuple[Column, Array, Array]]:
    """Yield columns to be compared, the vectors of the first table turned."""
    vector: list[Column] = []
    for column in table.columns:
        if rotation is None or column.kind == "text" or column.turns == "no":
            yield column, one[column.name], other[column.name]
            continue
        if column.turns == "vector":
            vector.append(column)
        if len(vector) == 3:
            components = rotation @ np.stack([one[axis.name] for axis in vector])
            for component, turned in zip(vector, components, strict=True):
                yield component, turned, other[component.name]
            vector = []


def _off(column: Column, one: Array, other: Array, within: float) -> int | None:
    """Return the first row in which columns differ, if there is one."""
    wrong = one != other
    if column.kind == "number":
        scale = max(1.0, max_abs(one[np.isfinite(one)]))
        if column.unit == "rad":
            with np.errstate(invalid="ignore"):
                away = wrap(other - one)
            other = np.where(np.isfinite(away), one + away, other)
        wrong = ~np.isclose(other, one, rtol=0.0, atol=within * scale, equal_nan=True)
    return int(np.argmax(wrong)) if np.any(wrong) else None


def in_words(data: TableArrays, words: Mapping[str, str]) -> TableArrays:
    """Return a table in whose texts words are replaced, such as names of links."""

    def put(text: str) -> str:
        return re.sub(r"\w+", lambda match: words.get(match[0], match[0]), text)

    return {
        name: np.array([put(text) for text in values.tolist()], dtype=str)
        if values.dtype.kind == "U"
        else values
        for name, values in data.items()
    }


def matched(
    table: Table, one: TableArrays, other: TableArrays, links: Collection[str]
) -> tuple[TableArrays, TableArrays] | str:
    """Return the rows that two tables share whose rows may have another order, or words.

    Rows are told apart by texts and whole numbers. Where a row is of one link relative to
    another, it is left out if the order of these links is not the same: it may then be
    that of the second relative to the first. `links` are the names of all.
    """
    names = [c.name for c in table.columns if c.kind in ("text", "integer")]
    first, second = (
        {
            key: row
            for row, key in enumerate(zip(*(x[n].tolist() for n in names), strict=True))
        }
        for x in (one, other)
    )
    if (len(first), len(second)) != (row_count(one), row_count(other)):
        return one, other
    shared = [key for key in first if key in second]
    for key in first:
        words = re.findall(r"\w+", " ".join(x for x in key if isinstance(x, str)))
        if key not in second and sum(word in links for word in words) < 2:
            return f"table {table.name} has no row of {', '.join(map(str, key))} any more"
    one, other = (
        {name: values[[rows[key] for key in shared]] for name, values in data.items()}
        for data, rows in ((one, first), (other, second))
    )
    return one, other
