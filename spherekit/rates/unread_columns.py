"""Poles of rows that a kernel can give, of which nothing is made until it is read."""

from collections.abc import Callable, Iterator, Mapping, MutableMapping
from typing import Any, Generic, TypeVar, final

from numpy.typing import NDArray

from spherekit.numeric.lent_memory import Refilled, SetAside, Template
from spherekit.rates.columns import Gaps, RateColumns
from spherekit.sphere.rotation import Floats

Key = TypeVar("Key")


@final
class UnreadColumns:
    """The columns of an input that moves, which `source` makes when they are read.

    `read` gives them of all that `source` holds, `shown` are those of the template, which
    hold nothing; what is a number throughout has the `gaps` of rows without a
    configuration.
    """

    def __init__(
        self,
        source: Refilled,
        template: Template,
        shown: RateColumns,
        read: Callable[[Floats], RateColumns],
        gaps: Gaps,
    ) -> None:
        self._source, self._template, self._shown = source, template, shown
        self._read, self._gaps = read, gaps
        self._made: RateColumns | None = None

    @property
    def made(self) -> RateColumns:
        """All of them."""
        if self._made is None:
            self._made = self._gaps.within(self._read(self._source.memory))
        return self._made

    def part(self, name: str) -> "Unread[Any]":
        """Return the columns of this name by pole or link, as `PoleField` has them."""
        of_links = name in ("w", "dw")

        def of(columns: RateColumns) -> Mapping[Any, Floats]:
            if of_links:
                links: Mapping[int, Floats] = getattr(columns, name)
                return links
            return {pole: getattr(part, name) for pole, part in columns.poles.items()}

        return Unread(of(self._shown), lambda: of(self.made), self._column)

    def _column(self, view: Floats) -> NDArray[Any] | SetAside:
        if view.strides[-1] == 0:
            return self._gaps.of(view)
        return self._template.of(view, self._source)


@final
class Unread(MutableMapping[Key, Floats], Generic[Key]):
    """Arrays (n,) or (n, 3) by key, which are made when one is read.

    `largest` is the largest number in those that were not given later, where it is known.
    """

    def __init__(
        self,
        shown: Mapping[Key, Floats],
        make: Callable[[], Mapping[Key, Floats]],
        column: Callable[[Floats], NDArray[Any] | SetAside],
    ) -> None:
        self._shown, self._make, self._column = shown, make, column
        self._given: dict[Key, Floats] = {}
        self.largest: float | None = None

    def column(self, key: Key, component: int | None) -> NDArray[Any] | SetAside:
        """Return a column (n,), of vectors a component, without making it now."""
        if key in self._given:
            given = self._given[key]
            return given if component is None else given[:, component]
        shown = self._shown[key]
        return self._column(shown if component is None else shown[component])

    def __getitem__(self, key: Key) -> Floats:
        if key not in self._given:
            if key not in self._shown:
                raise KeyError(key)
            made = {name: values.T for name, values in self._make().items()}
            self._given = made | self._given
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
