"""Changes the names and axes of links of a mechanism, and its loads with them."""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.mechanism.elements import Pair, Profile, as_vector
from spherekit.mechanism.load_kinds import as_tensor
from spherekit.mechanism.mechanism import Mechanism, field_kinds
from spherekit.mechanism.sizes import Vector

AxisRotations = Mapping[str, Floats]
"""Rotations (3, 3) from the old axes of links to the new ones, by link."""


Replacements = Mapping[str, str]
"""Texts that replace names, by name."""


EMPTY_MAPPING: Mapping[str, Any] = MappingProxyType({})
"""Default of optional mappings."""


def rotate_profile(profile: Profile, rotation: Floats, pair: Pair) -> Profile:
    """Return a profile of a contact in other link axes: its centre and points are rotated.

    Parameters
    ----------
    profile
        The profile, in link axes.
    rotation
        (3, 3) rotation from the old to the new link axes.
    pair
        The contact, which is not used. The parameter is needed because `redescribe` calls
        each function `rotate_pair_profile` with the pair.
    """
    del pair
    centre = None if profile.centre is None else rotate_vector(rotation, profile.centre)
    points = tuple(rotate_vector(rotation, point) for point in profile.points)
    return replace(profile, centre=centre, points=points)


def redescribe(
    mechanism: Mechanism,
    *,
    link_names: Replacements = EMPTY_MAPPING,
    rotations: AxisRotations = EMPTY_MAPPING,
    ground_rotation: Floats | None = None,
    expression_names: Replacements = EMPTY_MAPPING,
    rotate_pair_profile: Callable[[Profile, Floats, Pair], Profile] = rotate_profile,
) -> dict[str, Any]:
    """Return the pairs, outputs, masses and loads of a mechanism in another description.

    Locking a pair needs the new description, because the joined link has one name and one
    set of axes.

    Links can get other names and other axes, and names in the expressions of loads can be
    replaced. The caller changes the geometry (arcs of links or axes of pairs) itself.

    Parameters
    ----------
    mechanism
        The mechanism.
    link_names
        New names of links by their old names. Other links keep theirs.
    rotations
        Rotations (3, 3) from the old to the new axes of links, by link. Other links keep
        their axes.
    ground_rotation
        (3, 3) rotation from the old to the new ground axes, if these change.
    expression_names
        Texts that replace names in expressions of loads.
    rotate_pair_profile
        Function that returns the profile of a contact in rotated link axes. Its arguments
        are the profile, the rotation and the contact.

    Returns
    -------
    The new parts by the names of the fields of `Mechanism`.
    """
    # Links that keep their axes keep all their numbers, to the last digit.
    rotations = {
        link: rotation
        for link, rotation in rotations.items()
        if not np.array_equal(rotation, np.eye(3))
    }

    def replace_names(expression: str) -> str:
        """Return an expression of a load with other names of variables."""
        return re.sub(
            r"\w+", lambda name: expression_names.get(name[0], name[0]), expression
        )

    def rotate_both_profiles(
        contact: Pair, profiles: tuple[Profile, Profile]
    ) -> tuple[Profile, ...]:
        """Return the profiles of a contact, each in the new axes of its link."""
        new_profiles = []
        for link, profile in zip(contact.links, profiles, strict=True):
            if link in rotations:
                new_profiles.append(rotate_pair_profile(profile, rotations[link], contact))
            else:
                new_profiles.append(profile)
        return tuple(new_profiles)

    def redescribe_part(part: Any) -> Any:
        """Return a pair, output, mass or load with new names of links and in new axes.

        Vectors, tensors, profiles (contact curves) and the component expressions of forces
        and moments are rotated. Variables in expressions get their new names. The new names
        and the rotations from old to new axes are parameters of `redescribe`.
        """
        # Vectors and tensors are in the axes of the link of the part, such as a centre of
        # mass. If the part has no link, they are in ground axes, such as gravity. A
        # rotation of None leaves the axes as they are.
        link = getattr(part, "link", None)
        if link is None:
            rotation = ground_rotation
        else:
            rotation = rotations.get(link)
        # A force or moment has three expressions as components. Its field `axes` says
        # whether they are along link axes or ground axes.
        if getattr(part, "axes", "ground") == "link":
            component_rotation = rotation
        else:
            component_rotation = ground_rotation
        # Each field of a part has a kind. A "text" is one scalar expression with names of
        # variables, such as "theta_41". "texts" are three expressions, the components of a
        # force or moment.
        changes: dict[str, Any] = {}
        for name, kind in field_kinds(part).items():
            match kind, getattr(part, name):
                case "link", value:
                    changes[name] = link_names.get(value, value)
                case "links", links:
                    changes[name] = tuple(link_names.get(link, link) for link in links)
                case "profiles", (_, _) as profiles:
                    changes[name] = rotate_both_profiles(part, profiles)
                case "vector", value if value is not None and rotation is not None:
                    changes[name] = rotate_vector(rotation, value)
                case "tensor", rows if rotation is not None:
                    tensor = rotation @ np.array(rows, dtype=float) @ rotation.T
                    # Rounding errors of the products are not symmetric.
                    changes[name] = as_tensor(0.5 * (tensor + tensor.T))
                case "texts", texts:
                    texts = tuple(map(replace_names, texts))
                    if component_rotation is not None:
                        texts = _rotate_components(component_rotation, texts)
                    changes[name] = texts
                case "text", str() as value:
                    changes[name] = replace_names(value)
        return replace(part, **changes)

    return {
        name: tuple(map(redescribe_part, getattr(mechanism, name)))
        for name in ("pairs", "outputs", "masses", "loads")
    }


def rotate_vector(rotation: Floats, vector: ArrayLike) -> Vector:
    """Return a vector (3,) rotated by a matrix (3, 3)."""
    return as_vector(rotation @ np.array(vector, dtype=float))


def _rotate_components(rotation: Floats, texts: Names) -> Names:
    """Return the components of a vector in rotated axes, as texts of expressions.

    Parameters
    ----------
    rotation
        (3, 3) rotation from the old to the new axes.
    texts
        Expressions of the three components in the old axes.
    """
    # Each new component is a sum of the old ones, with factors from a row of the matrix.
    # Terms with the factor zero are left out.
    new_texts = []
    for row in rotation.tolist():
        terms = [
            f"({factor!r})*({text})"
            for factor, text in zip(row, texts, strict=True)
            if factor
        ]
        new_texts.append(" + ".join(terms) or "0")
    return tuple(new_texts)
