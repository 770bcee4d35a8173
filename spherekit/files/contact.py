"""Contact pairs of a file: profiles as they stand, gears, cones and followers."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

from spherekit.conventions import nearest
from spherekit.errors import ModelError
from spherekit.files.locate import KeyPath
from spherekit.files.values import DocumentValues, Table
from spherekit.model.gears import gear_axes, pitch_angles, touching_angles
from spherekit.model.geometry import given_axis
from spherekit.model.parts import Pair, PoseGeometry, Profile, SizeGeometry


@final
@dataclass(frozen=True)
class Contacts(DocumentValues):
    """The contact pairs of a document; `joined` has the two links of every R pair."""

    geometry: SizeGeometry | PoseGeometry
    joined: Mapping[str, tuple[str, str]]

    def pair(self, name: str) -> Pair:
        """Return a contact pair with the curves of both its links.

        Raises
        ------
        FileError
            If its keys contradict each other or the rest of the file.
        """
        item, path = self.document.data["pairs"][name], ("pairs", name)
        cones = "teeth" in item or "half_angles" in item
        start = self.angles((*path, "start"), item.get("start", [0.0, 0.0]))
        return Pair(
            name,
            item["type"],
            (item["links"][0], item["links"][1]),
            self.cones(path, item) if cones else self.profiles(path, item),
            item.get("contact", "external"),
            (start[0], start[1]),
            item.get("one_sided", False),
            item.get("distance"),
            self.angle((*path, "pressure_angle"), item["pressure_angle"])
            if "pressure_angle" in item
            else None,
        )

    def cones(self, path: KeyPath, item: Table) -> tuple[Profile, Profile]:
        """Return the circles in which two cones, or the pitch cones of gears, roll."""
        links, axes = item["links"], item["axes"]
        contact = item.get("contact", "external")
        try:
            centres, shaft_angle = gear_axes(
                self.geometry, self.joined, (links[0], links[1]), (axes[0], axes[1])
            )
        except ModelError as error:
            self.fail((*path, "axes"), str(error))
        key = "teeth" if "teeth" in item else "half_angles"
        try:
            if key == "teeth":
                teeth = (item["teeth"][0], item["teeth"][1])
                radii = pitch_angles(teeth, shaft_angle, contact)
            else:
                given = self.angles((*path, key), item[key])
                radii = touching_angles(given, shaft_angle, contact)
        except ModelError as error:
            self.fail((*path, key), str(error))
        first, second = (
            Profile("circle", centre, radius)
            for centre, radius in zip(centres, radii, strict=True)
        )
        return first, second

    def profiles(self, path: KeyPath, item: Table) -> tuple[Profile, Profile]:
        """Return the curves given under profiles and follower, in the order of links."""
        tables: dict[str, KeyPath] = {
            link: (*path, "profiles", link) for link in item["profiles"]
        }
        made = {
            link: self.profile(place, item["profiles"][link])
            for link, place in tables.items()
        }
        follower = item.get("follower")
        if follower is not None:
            link, place = follower["link"], (*path, "follower", "link")
            if link in tables:
                line = self.document.line(tables[link])
                self.fail(
                    place,
                    f'the profile of "{link}" is given already (line {line}); profiles '
                    "holds the curve of the other link only",
                )
            tables[link] = place
            made[link] = self.follower((*path, "follower"), follower)
        first, second = item["links"]
        for link, place in tables.items():
            if link not in (first, second):
                self.fail(
                    place,
                    f'the pair joins "{first}" and "{second}", not "{link}"'
                    f"{nearest(link, (first, second))}",
                )
        for link in (first, second):
            if link not in made:
                self.fail(
                    (*path, "profiles"),
                    f'the curve of link "{link}" is missing; give its profile, or the '
                    "key follower for a roller or a flat face",
                )
        return made[first], made[second]

    def profile(self, path: KeyPath, item: Table) -> Profile:
        """Return the curve stated in a table of profiles."""
        has_centre = "centre_xyz" in item or "centre_lonlat" in item
        radius = item.get("radius")
        return Profile(
            kind=item["kind"],
            centre=self.vector(path, item, "centre_") if has_centre else None,
            radius=None if radius is None else self.angle((*path, "radius"), radius),
            points=tuple(self.vectors(path, item, "points", "points_xyz")),
            closed=item.get("closed", True),
            cosines=self.angles((*path, "cosines"), item.get("cosines", [])),
            sines=self.angles((*path, "sines"), item.get("sines", [])),
        )

    def follower(self, path: KeyPath, item: Table) -> Profile:
        """Return the circle of a roller or the great circle of a flat face."""
        if "flat" in item:
            return Profile("great_circle", self.vector(path, item, "pole_"))
        radius = self.angle((*path, "roller"), item["roller"])
        if not 0.0 < radius < math.pi:
            self.fail(
                (*path, "roller"),
                f"the angular radius is {math.degrees(radius):.6g} deg; it has to lie "
                "between 0 and 180 deg, both excluded",
            )
        if "axis" not in item:
            return Profile("circle", self.vector(path, item, "centre_"), radius)
        try:
            axis = given_axis(self.geometry, self.joined, item["link"], item["axis"])
        except ModelError as error:
            self.fail((*path, "axis"), str(error))
        return Profile("circle", axis, radius)
