"""A mechanism described in another way: rotated as a whole, or with other link names.

An analysis has to give the same results for all of them.
"""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.mechanism.changed_axes import redescribe, rotate_profile, rotate_vector
from spherekit.mechanism.elements import Pair, PoseGeometry, Profile, SizeGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import pair_frames
from spherekit.mechanism.sizes_from_frames import sizes_from_frames
from spherekit.plugin.checks.report import NotApplicableError
from spherekit.runs.analysis_faults import convert_plugin_errors
from spherekit.runs.contract import AbstractAnalysis


def rotate_mechanism(mechanism: Mechanism, rotation: Floats) -> Mechanism:
    """Return a mechanism rotated as a whole, relative to the ground axes.

    The geometry of a mechanism is described in one of two ways. If it is described by sizes
    (arcs between the axes of each link), moving links have axes of their own. Only what is
    fixed in the ground is rotated then. If it is described by a pose, all axes are given in
    ground axes in one configuration, and all are rotated.

    Parameters
    ----------
    mechanism
        The mechanism.
    rotation
        (3, 3) rotation matrix.

    Raises
    ------
    NotApplicableError
        If a rotated link has a profile that is not given by points. The arc length of such
        a profile starts at a place that depends on the ground axes or link axes. The
        rotated profile would therefore have other arc lengths.
    """
    geometry = mechanism.geometry
    rotated_links: Names = (mechanism.ground,)
    rotated_geometry: PoseGeometry | SizeGeometry
    if isinstance(geometry, PoseGeometry):
        rotated_links = mechanism.links
        rotated_geometry = replace(
            geometry,
            axes={
                name: rotate_vector(rotation, axis) for name, axis in geometry.axes.items()
            },
        )
    else:
        # Frames of the pairs in their first and in their second link. Frames in the ground
        # are rotated, frames in moving links are not.
        frames_by_end = []
        for end, frames in enumerate(pair_frames(mechanism)):
            rotated_frames = {}
            for pair in mechanism.pairs:
                if pair.kind.has_axis:
                    frame = frames[pair.name]
                    is_in_ground = pair.links[end] == mechanism.ground
                    rotated_frames[pair.name] = rotation @ frame if is_in_ground else frame
            frames_by_end.append(rotated_frames)
        first_frames, second_frames = frames_by_end
        other_links = {
            link: sizes
            for link, sizes in geometry.links.items()
            if link != mechanism.ground
        }
        rotated_geometry = sizes_from_frames(
            mechanism.pairs, (first_frames, second_frames), other_links
        )
    # Pairs, outputs, masses and loads in the rotated axes, by field of the mechanism.
    rotated_parts = redescribe(
        mechanism,
        rotations=dict.fromkeys(rotated_links, rotation),
        ground_rotation=rotation,
        rotate_pair_profile=_rotate_profile,
    )
    return replace(mechanism, geometry=rotated_geometry, **rotated_parts)


def _rotate_profile(profile: Profile, rotation: Floats, pair: Pair) -> Profile:
    """Return a rotated profile through points; other kinds cannot be compared."""
    if not profile.points:
        raise NotApplicableError(
            f"the arc length of a {profile.kind} is measured from the coordinate axes, so "
            "a rotated mechanism has other arc lengths"
        )
    return rotate_profile(profile, rotation, pair)


def rename_links(mechanism: Mechanism, names: Mapping[str, str]) -> Mechanism:
    """Return a mechanism with other names and another order of links.

    An analysis has to give the same results for both mechanisms, which a check tests.

    Parameters
    ----------
    mechanism
        The mechanism.
    names
        The new name of each link, by its old name. The order of the new names becomes the
        order of the links.
    """
    geometry = mechanism.geometry
    # The geometry is stated either by sizes of links or by axes of pairs in a pose. Axes
    # stay as they are, because pairs keep their names.
    if isinstance(geometry, SizeGeometry):
        links = {names[link]: sizes for link, sizes in geometry.links.items()}
        geometry = replace(geometry, links=links)
    # Pairs, outputs, masses and loads with the new names, by field of the mechanism.
    # Formulas of loads contain no names of links.
    renamed_parts = redescribe(mechanism, link_names=names)
    return replace(
        mechanism,
        ground=names[mechanism.ground],
        links=tuple(names.values()),
        geometry=geometry,
        **renamed_parts,
    )


def rename_parameters(
    analysis: AbstractAnalysis, names: Mapping[str, str]
) -> AbstractAnalysis:
    """Return an analysis with the new names of links in its parameters.

    A check computes an analysis for a mechanism with renamed links (see `rename_links`),
    and tests that the results are the same. The parameters must have the new names, too.

    A parameter can be the name of a link or of a pole. A pole, the axis of the relative
    rotation of two links, is named by both links, such as ``4/1``.

    Parameters
    ----------
    analysis
        The analysis.
    names
        The new name of each link, by its old name.

    Raises
    ------
    PluginError
        If the constructor of the analysis raises an error with the new names.
    """

    def rename(value: Any) -> Any:
        """Return a parameter; the name of a link, or a pole as ``4/1``, is renamed."""
        if isinstance(value, tuple):
            return tuple(map(rename, value))
        links = value.split("/") if isinstance(value, str) else [value]
        if all(isinstance(link, str) and link in names for link in links):
            return "/".join(names[link] for link in links)
        return value

    changes = {
        item.name: rename(getattr(analysis, item.name))
        for item in fields(analysis)  # type: ignore[arg-type]
        if item.init  # the class computes the others itself
    }
    with convert_plugin_errors(analysis.name, "its constructor"):
        return replace(analysis, **changes)  # type: ignore[type-var]
