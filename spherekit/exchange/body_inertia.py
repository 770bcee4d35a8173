"""Masses and inertia tensors of the bodies of exported models.

Links without mass are given a small inertia, since general physics engines cannot move a
link without inertia. If no moving link has inertia, links are taken as wires.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.mechanism.inertia import point_mass_inertia
from spherekit.mechanism.mechanism import Mechanism
from spherekit.scenes.link_scenes import link_shapes

LEAST_INERTIA_KG_M2 = 1e-13
"""Smallest moment of inertia (kg m2) that is given to a link without inertia.

A point mass gets the same about its centre of mass. Smaller: MuJoCo refuses less than 1e-14
about the centre of mass, where a link without inertia has 7/8 of this, which bodies may
share; larger: tiny mechanisms move too slowly.
"""

MAX_ADDED_INERTIA_RATIO = 1e-3
"""Largest inertia that is added to a point mass, relative to its inertia about O.

Smaller: MuJoCo refuses more of the small point masses; larger: they move too slowly.
"""

CENTRE_RADIUS_RATIO = 1e-9
"""Distance below which a centre of mass is at the centre of the sphere, relative to the
radius of gyration.

Larger: the weight of a link whose centre is close to the centre of the sphere is lost;
smaller: a centre that differs from it by rounding counts as a stated one, and MuJoCo weighs
loops wrongly.
"""


class BodyInertia(NamedTuple):
    """Mass and inertia of a body of an exported model.

    Vectors and tensors are in ground axes, for the configuration that is exported. Centres
    are counted from the centre of the sphere.

    MuJoCo needs a mass for each body, so bodies without mass in the mechanism file get a
    small one.

    Attributes
    ----------
    link
        Name of the body: a link, or a coupler. A coupler replaces a sliding contact between
        two circles. It is hinged to one link at the centre of each circle.
    mass
        Mass (kg).
    centre
        (3,) centre of mass (m).
    tensor
        (3, 3) inertia tensor about the centre of mass (kg m2).
    is_stated
        Whether the mechanism file states this mass and centre. Otherwise mass and centre
        are chosen so that the tensor about O, the centre of the sphere, is right.
    """

    link: str
    mass: float
    centre: Floats
    tensor: Floats
    is_stated: bool


class MassCentre(NamedTuple):
    """Mass and centre of mass of a body.

    Attributes
    ----------
    mass
        Mass (kg).
    centre
        (3,) centre of mass (m), in ground axes, from the centre of the sphere.
    """

    mass: float
    centre: Floats


class LinkInertia(NamedTuple):
    """Inertia of a link, in axes that are fixed in the link.

    Attributes
    ----------
    tensor
        (3, 3) inertia tensor about the centre of the sphere (kg m2).
    mass
        Mass (kg), or None if the mechanism file does not state it.
    centre
        (3,) centre of mass (m), or None if the file does not state it.
    """

    tensor: Any
    mass: float | None
    centre: Any


@dataclass(frozen=True)
class LinkInertias:
    """The inertia of the links of a mechanism, for models that other programs read.

    Attributes
    ----------
    by_link
        Inertia by the name of the moving link. The mapping has the links with a mass in the
        mechanism file, or all moving links if the inertia is made up. The tensor is zero
        for a point mass at the centre of the sphere.
    are_made_up
        True if no moving link has inertia in the file. All moving links are then taken as
        wires of 1 kg/m on a sphere of 1 m. Forces in such a model mean nothing.
    """

    by_link: Mapping[str, LinkInertia]
    are_made_up: bool

    def has_mass(self, link: str) -> bool:
        """Return whether a link has an inertia that is not zero."""
        return link in self.by_link and bool(np.any(self.by_link[link].tensor))


def find_link_inertias(mechanism: Mechanism) -> LinkInertias:
    """Return the inertia of all moving links that have a mass in the mechanism file.

    Other programs can't move a mechanism without inertia. If no moving link has inertia,
    all moving links are taken as wires of 1 kg/m on a sphere of 1 m radius. The wires run
    along the arcs of a link, and from the centre of the sphere to the axis of each of its
    pairs (joints).
    """
    inertia_by_link = {
        mass.link: LinkInertia(mass.tensor, mass.mass, mass.centre)
        for mass in mechanism.masses
        if mass.link != mechanism.ground
    }
    # A point mass at the centre of the sphere has a zero tensor, and does not count.
    has_moving_mass = any(np.any(inertia.tensor) for inertia in inertia_by_link.values())
    if has_moving_mass:
        return LinkInertias(inertia_by_link, are_made_up=False)
    shapes = link_shapes(mechanism)
    for link, shape in zip(mechanism.links, shapes, strict=True):
        if link == mechanism.ground:
            continue
        wires = [*shape.curves, *radial_lines(shape.joints)]
        inertia_by_link[link] = _wire_inertia(wires)
    return LinkInertias(inertia_by_link, are_made_up=True)


def _wire_inertia(wires: list[Floats]) -> LinkInertia:
    """Return the inertia about the origin of thin straight wires of 1 kg/m.

    A link is taken as such wires if the mechanism file states no inertia of moving links.

    The tensor is trace(M) 1 - M with the unit matrix 1. M are the second moments, the sum
    of mass times r r^T over all positions r.

    Parameters
    ----------
    wires
        Polylines (n, 3) of points (m).
    """
    # A segment s of the length L with its middle at m is a thin rod of the mass L. The rod
    # has the second moments L m m^T + (L / 12) s s^T.
    middles = np.concatenate([0.5 * (wire[1:] + wire[:-1]) for wire in wires])
    segments = np.concatenate([np.diff(wire, axis=0) for wire in wires])
    lengths = np.linalg.norm(segments, axis=1)
    moments_of_middles = (lengths * middles.T) @ middles
    moments_of_segments = (lengths / 12.0 * segments.T) @ segments
    second_moments = moments_of_middles + moments_of_segments
    mass = float(np.sum(lengths))
    tensor = np.trace(second_moments) * np.eye(3) - second_moments
    return LinkInertia(tensor, mass, lengths @ middles / (mass or 1.0))


def radial_lines(axes: Floats) -> Floats:
    """Return the lines (j, 2, 3) from the centre of the sphere to axes (j, 3) of a link."""
    return np.stack([0.0 * axes, axes], axis=1)


def make_body_inertia(
    link_inertias: LinkInertias, link: str, rotation: Floats, light_ratio: float
) -> BodyInertia:
    """Return the mass, centre and inertia tensor of a body of an exported model.

    The body turns about O, the centre of the sphere, so its motion depends on the tensor
    about O. Mass and centre of mass are taken from the mechanism file. In two cases mass
    and centre are chosen such that the tensor about O is right:

    - The mass or the centre of mass is missing in the file.
    - The centre of mass is at O. MuJoCo would close the loops of the model wrongly.

    A link without inertia gets a small inertia, because MuJoCo refuses such bodies.

    Parameters
    ----------
    link_inertias
        Inertia of the moving links.
    link
        Name of the body: a link, or a body without mass that replaces a sliding contact.
    rotation
        (3, 3) rotation from the axes of the link to ground axes.
    light_ratio
        Inertia that a body without inertia gets, relative to the largest of all moving
        links.

    Returns
    -------
    The mass, the centre of mass, and the tensor about this centre, in ground axes.
    """
    link_inertia = link_inertias.by_link.get(link)
    # A zero tensor belongs to a point mass at O, which has no effect on the motion.
    if link_inertia is None or not np.any(link_inertia.tensor):
        # The tensor is a multiple of the unit tensor, so it needs no rotation to ground
        # axes.
        light_tensor = _make_light_tensor(link_inertias, light_ratio)
        mass_centre = _choose_mass_centre(light_tensor)  # mass and centre of mass
        return _make_body_about_centre(link, light_tensor, mass_centre, is_stated=False)

    tensor_about_O = rotation @ link_inertia.tensor @ rotation.T
    mass_centre_of_file = _find_usable_mass_centre(link_inertia, rotation, tensor_about_O)
    return _make_body_about_centre(
        link,
        tensor_about_O,
        mass_centre_of_file or _choose_mass_centre(tensor_about_O),
        is_stated=mass_centre_of_file is not None,
    )


def _make_light_tensor(link_inertias: LinkInertias, light_ratio: float) -> Floats:
    """Return the inertia tensor (3, 3) about O of a body without inertia (kg m2).

    Simulation programs cannot move a body without inertia, so such a body gets a small one.
    All its moments are `light_ratio` times the largest trace of the tensors of all moving
    links, but at least `LEAST_INERTIA_KG_M2`.
    """
    largest_trace = max(
        np.trace(inertia.tensor) for inertia in link_inertias.by_link.values()
    )
    moment = max(light_ratio * largest_trace, LEAST_INERTIA_KG_M2)
    return moment * np.eye(3)


def _find_usable_mass_centre(
    link_inertia: LinkInertia, rotation: Floats, tensor_about_O: Floats
) -> MassCentre | None:
    """Return the stated mass and centre of a link, or None if they can't be used.

    If the result is None, the caller chooses others for which the tensor about O is right.

    Mass and centre can't be used if one of them is missing in the mechanism file. A centre
    at O, the centre of the sphere, can't be used, because MuJoCo would close loops wrongly.

    Parameters
    ----------
    link_inertia
        Inertia of the link in its axes.
    rotation
        (3, 3) rotation from the axes of the link to ground axes.
    tensor_about_O
        (3, 3) inertia tensor about O (kg m2).
    """
    if link_inertia.mass is None or link_inertia.centre is None:
        return None
    gyration_radius = np.sqrt(np.trace(tensor_about_O) / link_inertia.mass)
    centre_distance = np.linalg.norm(link_inertia.centre)
    is_away_from_O = centre_distance > CENTRE_RADIUS_RATIO * gyration_radius
    if not is_away_from_O:
        return None
    return MassCentre(link_inertia.mass, rotation @ link_inertia.centre)


def _choose_mass_centre(tensor: Floats) -> MassCentre:
    """Return a possible mass and centre of a body with a certain inertia tensor about O.

    O is the centre of the sphere. Many bodies with different masses and centres have the
    same tensor about O. MuJoCo closes loops wrongly if the centre of mass is at O, so a
    centre away from O is chosen.

    The second moments S of a body are the sum of mass times r r^T over its points r. The
    second moments follow from the tensor. A mass m and a centre c can belong to a real body
    if S - m c c^T (the second moments about c) has no negative eigenvalues. The mass and
    the centre are chosen as follows:

    1. m = trace(S). The root mean square of the distances of the points from O is then 1 m.
    2. c is on the axis of the largest eigenvalue of S, where its distance from O may be up
       to sqrt(eigenvalue / m).
    3. c is at half of this distance, so that the moment about c is not zero.

    Parameters
    ----------
    tensor
        (3, 3) inertia tensor about O (kg m2).
    """
    second_moments = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    mass = float(np.trace(second_moments))
    # `eigh` returns the moments in ascending order.
    moments, directions = np.linalg.eigh(second_moments)
    largest_distance = np.sqrt(moments[-1] / mass)
    return MassCentre(mass, 0.5 * largest_distance * directions[:, -1])


def _make_body_about_centre(
    link: str, tensor_about_O: Floats, mass_centre: MassCentre, is_stated: bool
) -> BodyInertia:
    """Return the inertia of a body, with its tensor moved from O to the centre of mass.

    MuJoCo refuses a body whose least principal moment of inertia is nearly zero, such as a
    point mass. If this moment is below `LEAST_INERTIA_KG_M2`, the difference is added to
    all three principal moments. The tensor is not changed if the difference exceeds the
    trace of the tensor about O times `MAX_ADDED_INERTIA_RATIO`.

    Parameters
    ----------
    link
        Name of the body.
    tensor_about_O
        (3, 3) inertia tensor about the centre of the sphere O (kg m2), in ground axes.
    mass_centre
        Mass and centre of mass of the body.
    is_stated
        Whether the mechanism file states mass and centre. It becomes an attribute of the
        result.
    """
    mass, centre = mass_centre
    # The parallel axis theorem.
    tensor = tensor_about_O - point_mass_inertia(mass, centre)
    # Rounding errors can make the tensor slightly asymmetric.
    symmetric_tensor = 0.5 * (tensor + tensor.T)
    # Eigenvalues are in ascending order, so the first one is the least principal moment.
    added_moment = LEAST_INERTIA_KG_M2 - np.linalg.eigvalsh(symmetric_tensor)[0]
    if 0.0 < added_moment < MAX_ADDED_INERTIA_RATIO * np.trace(tensor_about_O):
        symmetric_tensor = symmetric_tensor + added_moment * np.eye(3)
    return BodyInertia(link, mass, centre, symmetric_tensor, is_stated)
