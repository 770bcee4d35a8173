"""Poles of rows that a kernel can give, of which nothing is made until it is read."""

from collections.abc import Callable, Iterator, Mapping, MutableMapping
from typing import Any, Generic, TypeVar, final

from numpy.typing import NDArray

from spherekit.numeric.lent_memory import Cut, Refilled, SetAside, Template
from spherekit.rates.columns import Gaps, RateColumns
from spherekit.sphere.rotation import Floats

Key = TypeVar("Key")


@final
class ShownColumns:
    """What columns of an input look like in a template, which hold nothing."""

    def __init__(self, template: Template, columns: RateColumns) -> None:
        self._template, self._columns = template, columns
        self._parts: dict[str, Mapping[Any, Floats]] = {}
        self._cuts: dict[tuple[str, Any, int | None], Cut | Floats] = {}

    def part(self, name: str) -> Mapping[Any, Floats]:
        """Return the columns of a name by pole or link."""
        if name not in self._parts:
            self._parts[name] = part_of(self._columns, name)
        return self._parts[name]

    def cut(self, name: str, key: Any, component: int | None) -> Cut | Floats:
        """Return where a column lies, or it, where it is a number throughout."""
        place = name, key, component
        if place not in self._cuts:
            shown = self.part(name)[key]
            view = shown if component is None else shown[component]
            self._cuts[place] = self._template.cut(view) if view.strides[-1] else view
        return self._cuts[place]


def part_of(columns: RateColumns, name: str) -> Mapping[Any, Floats]:
    """Return the columns of a name, as `RateColumns` and `PoleColumns` have them."""
    if name in ("w", "dw"):
        links: Mapping[int, Floats] = getattr(columns, name)
        return links
    return {pole: getattr(part, name) for pole, part in columns.poles.items()}


@final
class UnreadColumns:
    """The columns of an input that moves, which `source` makes when they are read.

    `read` gives them of all that `source` holds; what is a number throughout has the
    `gaps` of rows without a configuration.
    """

    def __init__(
        self,
        source: Refilled,
        shown: ShownColumns,
        read: Callable[[Floats], RateColumns],
        gaps: Gaps,
    ) -> None:
        self._source, self._shown, self._read, self._gaps = source, shown, read, gaps
        self._made: RateColumns | None = None

    @property
    def made(self) -> RateColumns:
        """All of them."""
        if self._made is None:
            self._made = self._gaps.within(self._read(self._source.memory))
        return self._made

    def part(self, name: str) -> "Unread[Any]":
        """Return the columns of this name by pole or link, as `PoleField` has them."""
        return Unread(self, name, self._shown.part(name))

    def column(self, name: str, key: Any, component: int | None) -> NDArray[Any] | SetAside:
        """Return a column (n,), of vectors a component, without making it now."""
        cut = self._shown.cut(name, key, component)
        return SetAside(cut, self._source) if isinstance(cut, Cut) else self._gaps.of(cut)


@final
class Unread(MutableMapping[Key, Floats], Generic[Key]):
    """Arrays (n,) or (n, 3) by key, which are made when one is read.

    `largest` is the largest number in those that were not given later, where it is known.
    """

    def __init__(
        self, columns: UnreadColumns, name: str, shown: Mapping[Key, Floats]
    ) -> None:
        self._columns, self._name, self._shown = columns, name, shown
        self._given: dict[Key, Floats] = {}
        self.largest: float | None = None

    def column(self, key: Key, component: int | None) -> NDArray[Any] | SetAside:
        """Return a column (n,), of vectors a component, without making it now."""
        if key in self._given:
            given = self._given[key]
            return given if component is None else given[:, component]
        return self._columns.column(self._name, key, component)

    def __getitem__(self, key: Key) -> Floats:
        if key not in self._given:
            if key not in self._shown:
                raise KeyError(key)
            made = part_of(self._columns.made, self._name)
            self._given = {name: values.T for name, values in made.items()} | self._given
        return self._given[key]

    def __contains__(self, key: object) -> bool:
        return key in self._shown or key in self._given

    def __setitem__(self, key: Key, values: Floats) -> None:
        self._given[key] = values

    def __delitem__(self, key: Key) -> None:
        raise TypeError("columns of a motion are there")

    def __iter__(self) -> Iterator[Key]:
        return iter({**self._shown, **self._given})

    def __len__(self) -> int:
        return len({**self._shown, **self._given})
