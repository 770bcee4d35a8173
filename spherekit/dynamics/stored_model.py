"""What stored models of one coordinate and of several have in common: torques and loads."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.dynamics.model_metadata import (
    StoredHeading,
    StoredLoad,
    torque_load,
)
from spherekit.model.expression import Expression, made_of
from spherekit.model.load import TorqueTable

Floats = NDArray[np.float64]

NUMBER = (float, int)
"""What is one place; a tuple is tested in less time than a union."""

Single = Callable[[Any], list[float]]
"""Some functions at one place, in the least time."""


@dataclass(frozen=True)
class StoredModel(ABC):
    """Functions of m coordinates of one assembly mode: what all stored models do."""

    heading: StoredHeading
    alone: ClassVar[bool]
    """Whether a place is a number, the only coordinate."""

    @property
    def error(self) -> float:
        """Largest measured error of all functions, relative to the largest of each."""
        return max(function.error for part in self.heading.parts for function in part)

    @overload
    def torque(self, x: float, dx: float, ddx: float, t: float = 0.0) -> float: ...
    @overload
    def torque(
        self, x: ArrayLike, dx: ArrayLike, ddx: ArrayLike, t: ArrayLike = 0.0
    ) -> Floats: ...

    def torque(
        self, x: ArrayLike, dx: ArrayLike, ddx: ArrayLike, t: ArrayLike = 0.0
    ) -> float | Floats:
        """Return the torques (N m) of the actuators for this motion, all loads acting.

        M x'' + C x' - Q, of one coordinate B x'' + 1/2 dB/dx x'^2 - Q (Di Gregorio 2024,
        eq. (21)). With coordinates of inputs they act at these; with the arc length s it
        is per unit of that, and the torque at a pair is that divided by the pair's rate
        along the curve.

        Parameters
        ----------
        x, dx, ddx
            Coordinates (rad) and their first and second rates by time.
        t
            Time (s) for loads that depend on it.

        Raises
        ------
        SolveError
            At a single place outside the domain; rows of several inputs are NaN there.
        """
        if self._is_one(x):
            single: float | Floats = self.torque_at(self.dynamics.at(x), x, dx, ddx, t)
            return single
        (q, dq, ddq), times, shape = self._together(x, dx, ddx, t=t)
        rows = self._rows(0, q)
        M = self._inertia(rows)
        torque = (M @ ddq[..., None])[..., 0] - np.sum(
            self._forces(rows, dq, times), axis=2
        )
        first, second = np.tril_indices(M.shape[1])
        for i, symbols in enumerate(self.heading.christoffel):
            bends = rows[:, self._columns(symbols)] * list(symbols.values())
            torque[:, i] += np.sum(bends * dq[:, first] * dq[:, second], axis=1)
        return np.asarray(torque.reshape(shape))

    def forces(self, x: ArrayLike, dx: ArrayLike, t: ArrayLike = 0.0) -> dict[str, Floats]:
        """Return each load's generalised forces Q (N m) by its name, shaped as x."""
        (q, dq), times, shape = self._together(x, dx, t=t)
        parts = self._forces(self._rows(0, q), dq, times)
        made, at = {}, 0
        for load in self.heading.loads:
            its = parts[..., at : at + len(load.works_on)]
            made[load.name] = np.sum(its, axis=-1).reshape(shape)
            at += len(load.works_on)
        return made

    def _value(self, name: str, x: Any) -> Any:
        """Return a stored function at one place or several."""
        if self._is_one(x):
            if name not in self._values:
                self._values[name] = self._named(name)
            return self._values[name](x)[0]
        group, column = self.heading.place(name)
        (q,), _, shape = self._together(x)
        return np.asarray(self._rows(group, q)[:, column].reshape(self._places(shape)))

    def _with_torques(
        self, torques: Mapping[str, tuple[str, str]]
    ) -> tuple[StoredLoad, ...]:
        """Return the loads with torques more: by name what they work on, and how large."""
        heading = self.heading
        more = [torque_load(heading, name, *torque) for name, torque in torques.items()]
        return (*heading.loads, *more)

    @abstractmethod
    def _is_one(self, x: Any) -> bool:
        """Return whether x is one place, not several."""

    @abstractmethod
    def _together(
        self, *given: ArrayLike, t: ArrayLike = 0.0
    ) -> tuple[list[Floats], Floats, tuple[int, ...]]:
        """Return places and rates (n, m), times (n,), and the shape that was given."""

    @abstractmethod
    def _places(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """Return the shape of a function at places of this shape."""

    @abstractmethod
    def _rows(self, group: int, q: Floats) -> Floats:
        """Return the functions of a group (n, F) at places (n, m)."""

    @abstractmethod
    def _single(self, group: int, factors: Floats) -> Single:
        """Return sums of the functions of a group by factors (F, K) at one place."""

    def _named(self, *names: str) -> Single:
        places = [self.heading.place(name) for name in names]
        group = places[0][0]
        unit = np.eye(len(self.heading.parts[group]))
        return self._single(group, unit[:, [column for _, column in places]])

    def _columns(self, names: Iterable[str]) -> list[int]:
        return [self.heading.place(name)[1] for name in names]

    @cached_property
    def _values(self) -> dict[str, Single]:
        """Functions at single places, by name, once asked for."""
        return {}

    @cached_property
    def dynamics(self) -> "_Dynamics":
        """Inertia and loads in single states."""
        return _Dynamics(self)

    def torque_at(self, row: list[float], x: Any, dx: Any, ddx: Any, t: Any) -> Any:
        """Return the torques in a state at a place of which `row` is `dynamics.at`."""
        try:
            return self.dynamics.torque(row, dx, ddx, t)
        except (ValueError, ArithmeticError):
            once = [np.array([given], dtype=float) for given in (x, dx, ddx, t)]
            return self.torque(*once)[0]

    def _inertia(self, rows: Floats) -> Floats:
        """Return M (n, m, m) of all functions in rows."""
        m = len(self.heading.christoffel)
        M = np.empty((len(rows), m, m))
        for i, k, column in zip(
            *np.tril_indices(m), self._columns(self.heading.inertia), strict=True
        ):
            M[:, i, k] = M[:, k, i] = rows[:, column]
        return M

    def _forces(self, rows: Floats, dq: Floats, t: Floats) -> Floats:
        """Return the generalised forces (n, m, components) of each load component."""
        heading = self.heading
        names = {"t": t}
        for name in (f"theta_{pair}" for pair in heading.angles):
            names[name] = rows[:, heading.place(name)[1]]
            by = self._columns(heading.by_coordinates(name))
            names[f"d{name}"] = np.sum(rows[:, by] * dq, axis=1)
        forces = np.empty((*dq.shape, len(heading.works_on)))
        for k, law in enumerate(heading.magnitudes):
            works_on = rows[:, self._columns(heading.works_on[k])]
            size = law.at(t) if isinstance(law, TorqueTable) else law.evaluate(names)
            forces[:, :, k] = np.broadcast_to(size, len(rows))[:, None] * works_on
        return forces


@final
class _Dynamics:
    """Inertia, Christoffel symbols and loads of a model, one state at a time.

    `at` returns the factors of accelerations, of products of rates and of -1, which the
    loads are that do not change, for each coordinate, then what the other loads need;
    `torque` is one Python function of these and of dq, ddq and t.
    """

    def __init__(self, model: StoredModel) -> None:
        heading = model.heading
        m, unit = len(heading.christoffel), np.eye(len(heading.parts[0]))
        alone = model.alone
        factors: dict[tuple[float, ...], str] = {}

        def put(factor: Floats) -> str:
            return factors.setdefault(tuple(factor.tolist()), f"row[{len(factors)}]")

        def stored(name: str) -> Floats:
            return np.asarray(unit[heading.place(name)[1]])

        dq, ddq = ([x] if alone else [f"{x}[{i}]" for i in range(m)] for x in ("dq", "ddq"))
        steady = np.zeros((m, len(unit)))
        laws: dict[str, tuple[Expression | TorqueTable, list[Floats]]] = {}
        for law, by in zip(heading.magnitudes, heading.works_on, strict=True):
            ways = [stored(name) for name in by]
            if isinstance(law, Expression) and not law.names:
                steady += float(law.evaluate({})) * np.array(ways)
            else:
                laws[f"size_{len(laws)}"] = law, ways
        lower = [(i, k) for i in range(m) for k in range(i + 1)]
        of = {(i, k): name for (i, k), name in zip(lower, heading.inertia, strict=True)}
        torques = []
        for i in range(m):
            inertia = [of[max(i, k), min(i, k)] for k in range(m)]
            terms = [f"{put(stored(x))}*{ddq[k]}" for k, x in enumerate(inertia)]
            for (a, b), (x, half) in zip(
                lower, heading.christoffel[i].items(), strict=True
            ):
                terms.append(f"{put(half * stored(x))}*({dq[a]}*{dq[b]})")
            if np.any(steady[i]):
                terms.append(f"-{put(steady[i])}")
            terms += [f"-{size}*{put(ways[i])}" for size, (_, ways) in laws.items()]
            torques.append(" + ".join(terms))
        given, tables = _sizes(
            heading,
            {size: law for size, (law, _) in laws.items()},
            dq,
            lambda x: put(stored(x)),
        )
        body = torques[0] if alone else f"array([{', '.join(torques)}])"
        if given:
            first = ", ".join(f"{name} := {text}" for name, text in given.items())
            body = f"({first}, {body})[-1]"
        self.torque = made_of(
            f"lambda row, dq, ddq, t: {body}", {"array": np.array, **tables}
        )
        self.at = model._single(0, np.array(list(factors)).T)


def _sizes(
    heading: StoredHeading,
    laws: Mapping[str, Expression | TorqueTable],
    dq: Sequence[str],
    put: Callable[[str], str],
) -> tuple[dict[str, str], dict[str, Callable[[float], float]]]:
    """Return magnitudes by name as Python, with the rates they need first, and tables.

    `dq` are the rates of the coordinates, `put` gives a stored function of a name.
    """
    written, given = {"t": "t"}, dict[str, str]()
    used = {x for law in laws.values() if isinstance(law, Expression) for x in law.names}
    for name in sorted(used - {"t"}):
        if name.startswith("dtheta_"):
            by = heading.by_coordinates(name[1:])
            text = " + ".join(f"{put(x)}*{rate}" for x, rate in zip(by, dq, strict=True))
            written[name] = f"rate_{len(given)}"
            given[written[name]] = text
        else:
            written[name] = put(name)
    tables: dict[str, Callable[[float], float]] = {}
    for size, law in laws.items():
        if isinstance(law, TorqueTable):
            tables[f"table_{size}"] = law.one
            given[size] = f"table_{size}(t)"
        else:
            given[size] = law.code(written)
    return given, tables
