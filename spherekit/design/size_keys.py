"""Which sizes a mechanism has, as keys of its file, and which angles say where it is."""

import numpy as np

from spherekit.design.variables import DesignVariable
from spherekit.engine.row_quantities import row_quantities
from spherekit.files.schema import Limits
from spherekit.model.geometry import COLLINEAR
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import PoseGeometry, SizeGeometry
from spherekit.model.pose_sizes import pose_sizes


def link_sizes(mechanism: Mechanism) -> dict[str, DesignVariable]:
    """Return the arcs and angles (rad) of the links of a reference pose by their keys.

    They are named as in a file of sizes. Mechanisms with contacts have none here: their
    profiles stand in the axes of the pose.
    """
    if not isinstance(mechanism.geometry, PoseGeometry) or mechanism.has_contacts:
        return {}
    made = {}
    for link in mechanism.links:
        sizes = pose_sizes(mechanism, link)
        for size in sizes:
            alone = sum(other.kind == size.kind for other in sizes) == 1
            ending = size.kind[:-1] if alone else f"{size.kind}.{size.pair}"
            key, place = f"links.{link}.{ending}", (size.link, size.pair)
            path = ("links", link, size.kind, size.pair)
            slot = size.kind, place
            made[key] = DesignVariable(key, path, size.value, True, slot, Limits())
    return made


def sizes_of(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the keys of all arcs and angles, or of all axes in a reference pose.

    Without those of links with two axes on one line, which no small size parts.
    """
    if isinstance(mechanism.geometry, SizeGeometry):
        coaxial = coaxial_links(mechanism.geometry)
        return tuple(
            f"links.{link}.{kind}" + (f"s.{pair}" if len(axes) > 1 else "")
            for link, sizes in mechanism.geometry.links.items()
            if link not in coaxial
            for kind, axes in (("arc", sizes.axes[1:]), ("angle", sizes.axes[2:]))
            for pair in axes
        )
    return tuple(
        f"pairs.{pair.name}.{kind}"
        for pair in mechanism.pairs
        if pair.kind.has_axis
        for kind in ("longitude", "latitude")
    )


def coaxial_links(geometry: SizeGeometry) -> tuple[str, ...]:
    """Return the links with an axis on one line with the first."""
    return tuple(
        link
        for link, sizes in geometry.links.items()
        if any(abs(np.sin(arc)) <= COLLINEAR for arc in sizes.arcs)
    )


def quantities_of(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the angles that say where outputs are, else those of all passive pairs.

    Without any, how outputs turn while the inputs move.
    """
    driven = {item.pair for item in mechanism.inputs}
    ends = {frozenset((output.link, output.relative_to)) for output in mechanism.outputs}
    passive = [p for p in mechanism.pairs if p.kind.has_axis and p.name not in driven]
    chosen = [p for p in passive if frozenset(p.links) in ends] or passive
    if chosen:
        return tuple(f"theta_{pair.name}" for pair in chosen)
    possible = row_quantities(mechanism)
    speeds = [f"velocity_coefficient_{o.link}_{o.relative_to}" for o in mechanism.outputs]
    return tuple(
        name
        for name in possible
        if any(name == speed or name.startswith(f"{speed}_by_") for speed in speeds)
    )
