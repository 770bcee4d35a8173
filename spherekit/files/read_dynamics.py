"""Masses, loads and stops of a mechanism from the data of its file."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, final

import numpy as np

from spherekit.conventions import listing, nearest
from spherekit.errors import ModelError
from spherekit.files.angles import angle_at, to_radians
from spherekit.files.document import Document
from spherekit.files.locate import KeyPath
from spherekit.model.changes import AngleUnit
from spherekit.model.dynamics import LOADS, Mass, PairTorque, Stop
from spherekit.model.dynamics_checks import check_tensor
from spherekit.model.geometry import link_axes
from spherekit.model.inertia import axes_frame, moved_to_sphere_centre, uniform_arc
from spherekit.model.load import Form, Load, Vector, vector_of
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats


@final
class DynamicsReader:
    """Builds masses, loads and stops from data that fits the schema.

    `mechanism` has everything else that stands in the file.
    """

    def __init__(self, document: Document, mechanism: Mechanism) -> None:
        self.document = document
        self.mechanism = mechanism
        self.unit: AngleUnit = document.data["angle_unit"]

    def masses(self) -> tuple[Mass, ...]:
        """Return the masses, with all tensors in link axes about the sphere's centre.

        Raises
        ------
        FileError
            If an arc or a frame names pairs that the link does not have.
        ModelError
            If a tensor is not symmetric or not physical as it stands in the file.
        """
        given = self.document.data.get("mass", {})
        return tuple(self._mass(link, item) for link, item in given.items())

    def loads(self) -> tuple[Load, ...]:
        """Return the loads, angles in rad."""
        given = self.document.data.get("loads", {})
        return tuple(self._load(name, item) for name, item in given.items())

    def stops(self) -> tuple[Stop, ...]:
        """Return the stops (rad)."""
        given = self.document.data.get("stops", {})
        return tuple(
            Stop(
                pair,
                self._angle(("stops", pair, "from"), item["from"]),
                self._angle(("stops", pair, "to"), item["to"]),
            )
            for pair, item in given.items()
        )

    def _mass(self, link: str, item: Mapping[str, Any]) -> Mass:
        path: KeyPath = ("mass", link)
        if link not in self.mechanism.link_number:
            raise self.document.fault(
                path,
                f'no link is named "{link}"'
                f"{nearest(link, self.mechanism.links) or ';'} Links: "
                f"{listing(self.mechanism.links)}",
            )
        mass = float(item["mass"]) if "mass" in item else None
        centre = np.array(item["centre"], dtype=float) if "centre" in item else None
        if "arc" in item:
            assert mass is not None
            first, second = self._axes((*path, "arc"), link, item["arc"])
            radius = float(item["radius"])
            if not radius > 0:
                raise self.document.fault(
                    (*path, "radius"), f"found {radius:g} m, needs more than 0"
                )
            try:
                tensor, centre = uniform_arc(first, second, mass, radius)
            except ModelError as error:
                raise self.document.fault((*path, "arc"), str(error)) from None
            return Mass(link, _symmetric(tensor), mass, vector_of(centre))
        if "tensor" in item:
            tensor = self._tensor(link, "tensor")
        else:
            assert mass is not None
            assert centre is not None
            about_centre = self._tensor(link, "tensor_at_centre")
            tensor = moved_to_sphere_centre(about_centre, mass, centre)
        if "frame" in item:
            first, second = self._axes((*path, "frame"), link, item["frame"])
            try:
                frame = axes_frame(first, second)
            except ModelError as error:
                raise self.document.fault((*path, "frame"), str(error)) from None
            tensor = frame @ tensor @ frame.T
            centre = None if centre is None else frame @ centre
        return Mass(
            link, _symmetric(tensor), mass, None if centre is None else vector_of(centre)
        )

    def _tensor(self, link: str, key: str) -> Floats:
        tensor = np.array(self.document.data["mass"][link][key], dtype=float)
        check_tensor(f"mass.{link}.{key}", tensor)
        return tensor

    def _axes(self, path: KeyPath, link: str, pairs: Sequence[str]) -> list[Floats]:
        """Return the axes of R pairs in link axes."""
        axes = self._axes_in_links[link]
        for number, pair in enumerate(pairs):
            if pair not in axes:
                raise self.document.fault(
                    (*path, number),
                    f'link "{link}" has no R pair "{pair}"'
                    f"{nearest(pair, axes) or ';'} R pairs on it: {listing(axes)}",
                )
        return [axes[pair] for pair in pairs]

    @cached_property
    def _axes_in_links(self) -> dict[str, dict[str, Floats]]:
        return link_axes(self.mechanism)

    def _load(self, name: str, item: Mapping[str, Any]) -> Load:
        kind = LOADS[item.get("kind", PairTorque.kind)]
        fields = {
            key: self._field(form, ("loads", name, key), item[key])
            for key, form in kind.keys.items()
            if key in item
        }
        made: Callable[..., Load] = kind
        return made(name, **{**kind.absent, **fields})

    def _field(self, form: Form, path: KeyPath, given: Any) -> Any:
        if form == "angle":
            return self._angle(path, given)
        if form == "rate":
            return to_radians(given, self.unit)
        return _FIELDS[form](given)

    def _angle(self, path: KeyPath, number: float) -> float:
        return angle_at(self.document, path, number, self.unit)


def _texts(parts: Sequence[str]) -> tuple[str, str, str]:
    x, y, z = parts
    return x, y, z


def _numbers(given: Sequence[float]) -> tuple[float, ...]:
    return tuple(map(float, given))


_FIELDS: Mapping[Form, Callable[[Any], Any]] = {
    "pair": str,
    "link": str,
    "text": str,
    "texts": _texts,
    "number": float,
    "numbers": _numbers,
    "vector": vector_of,
    "flag": bool,
}


def _symmetric(tensor: Floats) -> tuple[Vector, Vector, Vector]:
    """Return a tensor with the rounding of its mirrored entries made equal."""
    first, second, third = (tensor + tensor.T) / 2
    return vector_of(first), vector_of(second), vector_of(third)
