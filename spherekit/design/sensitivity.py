"""How quantities of a configuration change with sizes, and what deviations of sizes do."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import TURN, listing, nearest
from spherekit.design.file_numbers import FileNumbers
from spherekit.design.profile_numbers import (
    APART,
    ProfileNumbers,
    columns_of,
    has_other_profiles,
)
from spherekit.design.variables import (
    DesignVariable,
    check_variables,
    design_variable,
    designed_pairs,
)
from spherekit.engine.design_kernel import (
    DesignKernel,
    DesignTerms,
    NewtonKernel,
    design_kernel,
    newton_kernel,
)
from spherekit.engine.hinges import Hinged, hinged
from spherekit.engine.row_quantities import row_quantities, sample_names
from spherekit.errors import CountError, DesignError, EngineError
from spherekit.files.change import document_of
from spherekit.model.geometry import COLLINEAR
from spherekit.model.joints import Track
from spherekit.model.mechanism import Mechanism, SizeGeometry
from spherekit.planning.inputs import driven_at
from spherekit.sphere.rotation import Floats

Distribution = Literal["normal", "uniform"]

DISTRIBUTIONS: tuple[Distribution, ...] = ("normal", "uniform")

NEWTON_STEPS = 12
"""Most steps from the configuration of the file to that of a deviating mechanism."""
TOGETHER = 8192
"""Deviating configurations that are solved together."""
SHRINKING = 0.125
"""Newton's steps that shrink by this part lead to the nearest configuration."""
SHORTEST = 2.0**-16
"""Part of a deviation below which it is not followed: no configuration is ahead."""
STILL = 1e-9
"""Steps (rad) so short do not leap."""
CLOSED = 1e-12
"""A configuration whose pairs miss each other by less (rad) is closed."""


@final
@dataclass(frozen=True)
class Deviations:
    """Draws of sizes about those of the file.

    With a ``"normal"`` distribution `size` (rad) is the standard deviation, and the worst
    case three of it; with a ``"uniform"`` one sizes are off by at most `size`.
    """

    size: float
    distribution: Distribution = "normal"
    count: int = 1024
    seed: int = 0

    def __post_init__(self) -> None:
        if self.distribution not in DISTRIBUTIONS:
            raise DesignError(
                f'distribution "{self.distribution}" is not known; it is normal or uniform'
            )
        if not (np.isfinite(self.size) and self.size > 0.0) or self.count < 0:
            raise DesignError(
                "a deviation is a positive angle, the number of draws not < 0"
            )

    @property
    def spread(self) -> float:
        """The standard deviation (rad)."""
        return self.size if self.distribution == "normal" else self.size / np.sqrt(3.0)

    @property
    def worst(self) -> float:
        """The deviation (rad) of the worst case."""
        return 3.0 * self.size if self.distribution == "normal" else self.size

    def draws(self, sizes: int) -> Floats:
        """Return deviations (sizes, count) rad, spread evenly by a Sobol sequence."""
        from scipy.special import ndtri
        from scipy.stats import qmc

        power = int(np.ceil(np.log2(max(self.count, 1))))
        unit = qmc.Sobol(sizes, rng=self.seed).random_base2(power).T[:, : self.count]
        if self.distribution == "uniform":
            return np.asarray(self.size * (2.0 * unit - 1.0))
        return np.asarray(self.size * ndtri(np.clip(unit, 1e-12, 1.0 - 1e-12)))


@final
class Sensitivity:
    """Quantities of configurations and their exact derivatives by sizes.

    Parameters
    ----------
    mechanism
        A mechanism with its inputs.
    keys
        Sizes, as keys of its file; by default all arcs and angles, or all axes of a pose.
    quantities
        Names of `row_quantities`; by default the angles of pairs between an output and the
        link it is seen from, or else of all passive pairs.

    Raises
    ------
    DesignError
        If a key is no size of an R pair and no number of a profile, or a quantity is not
        known.
    """

    def __init__(
        self, mechanism: Mechanism, keys: Sequence[str] = (), quantities: Sequence[str] = ()
    ) -> None:
        mechanism = driven_at(mechanism)
        self.inputs = tuple(item.pair for item in mechanism.inputs)
        self.mechanism = mechanism
        self.document = document_of(mechanism, "rad")
        self.keys = tuple(keys) or sizes_of(mechanism) or self._of_profiles()
        if not self.keys:
            raise DesignError(
                f"{mechanism.name}: no link of it has sizes, for none has two axes; name "
                "numbers of the file"
            )
        self.variables = tuple(self._variable(key) for key in self.keys)
        check_variables(self.document, self.variables)
        self.quantities = tuple(quantities) or quantities_of(mechanism)
        try:
            possible = row_quantities(mechanism)
        except CountError as counted:
            raise DesignError(
                f"{mechanism.name}: some of its constraints are redundant, so that it "
                "closes with its sizes as they are and with none that deviate; leave "
                f"redundant pairs out of a copy of the file ({counted})"
            ) from None
        for name in self.quantities:
            if name not in possible:
                raise DesignError(
                    f'{mechanism.name}: "{name}" is no quantity of its configurations'
                    f"{nearest(name, possible) or ';'} such are theta_PAIR, rate_PAIR and "
                    "velocity_coefficient_LINK_OTHER"
                )

    def _of_profiles(self) -> tuple[str, ...]:
        """Return the keys of radii and harmonics."""
        made = []
        for pair, table in self.document.data["pairs"].items():
            for link, profile in table.get("profiles", {}).items():
                for name in ("radius", "cosines", "sines"):
                    key, number = f"pairs.{pair}.profiles.{link}.{name}", profile.get(name)
                    if isinstance(number, list):
                        made += [f"{key}.{k}" for k in range(len(number))]
                    elif number is not None:
                        made.append(key)
        return tuple(made)

    @cached_property
    def _profiled(self) -> bool:
        return has_other_profiles(self.mechanism)

    def _variable(self, key: str) -> DesignVariable:
        variable = design_variable(self.document, key)
        of_contact = variable.path[0] == "pairs" and (
            self._hinged is not None if not self._profiled else "profiles" in variable.path
        )
        if variable.slot is None and not of_contact:
            raise DesignError(
                f"{self.mechanism.name}: {key} is no size: derivatives are by arcs, "
                "angles, zeros and axes of R pairs, and by numbers of profiles"
            )
        return variable

    @cached_property
    def _hinged(self) -> Hinged | None:
        return hinged(self.mechanism, self.inputs)

    @cached_property
    def _as_given(self) -> DesignTerms | None:
        """Terms of the mechanism with its contacts; None if wheels repeat too much."""
        chosen = self.variables
        if self._profiled:
            chosen = tuple(chosen[k] for k in self._sized)
        try:
            return DesignTerms.of(
                self.mechanism,
                self.inputs,
                [variable.name for variable in chosen],
                lambda numbers: designed_pairs(
                    self.mechanism, chosen, numbers, self._profiled
                ),
                closed_form=False,
            )
        except EngineError:
            if self._hinged is None or self._hinged.train is None:
                raise
            return None

    @cached_property
    def _numbers(self) -> FileNumbers | None:
        """The numbers of contacts that follow the sizes, where some are of contacts."""
        sized = all(variable.slot is not None for variable in self.variables)
        if self._profiled or (sized and self._as_given is not None):
            return None
        made = FileNumbers(
            self.document,
            self.mechanism,
            self.variables,
            self.inputs,
            self._hinged,
            False,
            APART,
        )
        if not made.varied:
            raise DesignError(
                f"{self.mechanism.name}: with other {listing(self.keys)} there is no such "
                "mechanism: its profiles would not touch in the reference pose; vary "
                "sizes of links"
            )
        return made

    @cached_property
    def _profiles(self) -> ProfileNumbers | None:
        """What profiles other than circles are, None where there are none."""
        if not self._profiled:
            return None
        return ProfileNumbers(self.document, self.mechanism, self.variables)

    @cached_property
    def _sized(self) -> list[int]:
        """Which of the variables are sizes of the kernel, where profiles are handed in."""
        return [k for k, variable in enumerate(self.variables) if variable.slot is not None]

    @property
    def timed(self) -> bool:
        """Whether a quantity depends on how the inputs move."""
        moving = sample_names(self.inputs)[len(self.inputs) :]
        return any(name in moving or name.startswith("torque") for name in self.quantities)

    def at_rest(self, inputs: Floats) -> Floats:
        """Return samples (n, 3 inputs + 1) at inputs (n, inputs) rad that rest."""
        rest = np.zeros((len(inputs), 2 * len(self.inputs) + 1))
        return np.concatenate([inputs, rest], axis=1)

    @cached_property
    def _terms(self) -> DesignTerms:
        if self._numbers is not None and self._hinged is not None:
            contacts = self._hinged
            names = {k: f"turned_{k}" for k in self._numbers.of_contacts}
            return DesignTerms.of(
                contacts.mechanism,
                self.inputs,
                tuple(names.values()),
                lambda numbers: contacts.pairs({k: numbers[n] for k, n in names.items()}),
                closed_form=False,
            )
        assert self._as_given is not None
        return self._as_given

    @cached_property
    def _gradient(self) -> DesignKernel:
        return design_kernel(self._terms, self.quantities, gradients=True, compiled=False)

    @cached_property
    def _plain(self) -> DesignKernel:
        return design_kernel(self._terms, self.quantities, compiled=False)

    @cached_property
    def _newton(self) -> NewtonKernel:
        return newton_kernel(self._terms, compiled=False)

    @cached_property
    def _nominal(self) -> Floats:
        if self._numbers is not None:
            return np.array(self._numbers.nominal)[self._numbers.of_contacts][:, None]
        values = np.array([[variable.value] for variable in self.variables])
        return values[self._sized] if self._profiled else values

    def _by_sizes(self, gradients: Floats, values: Floats) -> Floats:
        """Return derivatives (sizes, c, n) from those by what the kernel has as inputs.

        At the configurations `values` (n, w).
        """
        if self._profiles is not None:
            count = len(self._sized)
            slopes = self._profiles.slopes(values)
            made = np.einsum("kpn,pcn->kcn", slopes, gradients[count:])
            made[self._sized] += gradients[:count]
            return np.asarray(made)
        if self._numbers is None:
            return gradients
        values = np.array([variable.value for variable in self.variables])
        count = len(self._numbers.of_contacts)
        return np.tensordot(self._numbers.slopes(values)[:count].T, gradients, 1)

    def _deviating(self, deviations: Floats) -> Floats:
        """Return what the kernel has as inputs (k, draws); NaN where nothing is."""
        if self._profiled:
            return self._nominal + deviations[self._sized]
        if self._numbers is None:
            return self._nominal + deviations
        values = np.array([[variable.value] for variable in self.variables])
        numbers, _ = self._numbers.at(values + deviations)
        return numbers[: len(self._numbers.of_contacts)]

    def _placed(self, values: Floats) -> Floats:
        """Return the variables (n, v) that the kernel has, from those of a motion."""
        if self._numbers is None or self._hinged is None:
            return values
        return self._hinged.values(values)

    def at(self, samples: Floats, values: Floats) -> tuple[Floats, Floats]:
        """Return quantities (c, n) and their derivatives (sizes, c, n).

        Parameters
        ----------
        samples
            (n, 3 inputs + 1) q, dq, ddq of each input, then t.
        values
            (n, variables) the closed configurations there, rad.

        Notes
        -----
        Rad and SI. The inputs are held, and the loops stay closed: from the derivative of
        the closure equations by a size, solved for the variables.
        """
        kernel = self._gradient
        prepared = kernel.prepare(np.repeat(self._nominal, len(samples), axis=1))
        rows = [samples.T, self._placed(values).T]
        if self._profiles is not None:
            rows.append(self._profiles.columns(values))
        columns = kernel.evaluate(np.concatenate([*rows, prepared]))
        made = columns.reshape(-1, len(self.quantities), len(samples))
        return made[0], self._by_sizes(made[1:], values)

    def scattered(self, samples: Floats, values: Floats, deviations: Floats) -> Floats:
        """Return the quantities (c, n, draws) of deviating mechanisms.

        Parameters
        ----------
        samples, values
            (n, 3 inputs + 1) and (n, variables) as in `at`.
        deviations
            (sizes, draws) rad, added to the sizes.

        Notes
        -----
        Followed from each configuration by Newton's method; NaN where none is there.
        """
        draws = deviations.shape[1]
        sizes = self._deviating(deviations)
        tracks = () if self._profiles is None else self._profiles.tracks
        if self._profiles is not None and self._profiles.vary:
            profiles = self._profiles.drawn(deviations)
            drawn = [
                self._closed(samples, values, sizes[:, [k]], tracks)
                for k, tracks in enumerate(profiles)
            ]
            return np.concatenate(drawn, axis=2)
        together = max(1, TOGETHER // draws)
        made = [
            self._closed(samples[k : k + together], values[k : k + together], sizes, tracks)
            for k in range(0, len(samples), together)
        ]
        return np.concatenate(made, axis=1)

    def _closed(
        self,
        samples: Floats,
        values: Floats,
        of_draws: Floats,
        tracks: Sequence[Track] | None = (),
    ) -> Floats:
        """Return the quantities (c, n, draws) of mechanisms with sizes (k, draws)."""
        n, draws = len(samples), of_draws.shape[1]
        if tracks is None:
            return np.full((len(self.quantities), n, draws), np.nan)
        start = np.repeat(self._placed(values).T, draws, axis=1)
        sizes = np.tile(of_draws, n)
        now, closed = self._followed(start, sizes, tracks)
        with np.errstate(all="ignore"):
            kernel = self._plain
            placed = [now, columns_of(tracks, now.T)] if tracks else [now]
            rows = [np.repeat(samples.T, draws, axis=1), *placed, kernel.prepare(sizes)]
            result = kernel.evaluate(np.concatenate(rows))
        return np.where(closed, result, np.nan).reshape(-1, n, draws)

    def _followed(
        self, start: Floats, sizes: Floats, tracks: Sequence[Track]
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the variables (v, m) that follow to sizes (k, m), and which get there.

        In parts of the way, halved where Newton's steps do not shrink at once, so that none
        leaps to another assembly mode.
        """
        away = sizes - self._nominal
        if self._numbers is not None:
            away -= TURN * np.round(away / TURN)  # angles of wheels are of any turn
        now, m = start.copy(), sizes.shape[1]
        gone, part = np.zeros(m), np.ones(m)
        while len(left := np.flatnonzero((gone < 1.0) & (part >= SHORTEST))):
            ahead = np.minimum(gone[left] + part[left], 1.0)
            there = sizes[:, left] - (1.0 - ahead) * away[:, left]
            beyond, holds = self._stepped(now[:, left], there, tracks)
            now[:, left[holds]] = beyond[:, holds]
            gone[left[holds]] = ahead[holds]
            part[left] *= np.where(holds, 2.0, 0.5)
        return now, gone >= 1.0

    def _stepped(
        self, start: Floats, sizes: Floats, tracks: Sequence[Track]
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return the variables (v, m) by Newton's method, and where it goes straight there.

        That is where each step is an eighth of the one before at most (Kantorovich 1948).
        """
        newton = self._newton
        prepared, now = newton.prepare(sizes), start
        lengths: list[Floats] = []
        with np.errstate(all="ignore"):
            for _ in range(NEWTON_STEPS):
                placed = [now, columns_of(tracks, now.T)] if tracks else [now]
                result = newton.step(np.concatenate([*placed, prepared]))
                closed = result[-1] < CLOSED**2
                lengths.append(np.linalg.norm(result[:-1], axis=0))
                if np.all(closed | ~np.isfinite(result[-1])):
                    break
                now = now + result[:-1]
            shrinks = np.ones(len(closed), dtype=bool)
            for step, following in pairwise(lengths):
                shrinks &= following <= np.maximum(SHRINKING * step, STILL)
        return now, closed & shrinks


def sizes_of(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the keys of all arcs and angles, or of all axes in a reference pose.

    Without those of links with two axes on one line, which no small size parts.
    """
    if isinstance(mechanism.geometry, SizeGeometry):
        return tuple(
            f"links.{link}.{kind}" + (f"s.{pair}" if len(axes) > 1 else "")
            for link, sizes in mechanism.geometry.links.items()
            if all(abs(np.sin(arc)) > COLLINEAR for arc in sizes.arcs)
            for kind, axes in (("arc", sizes.axes[1:]), ("angle", sizes.axes[2:]))
            for pair in axes
        )
    return tuple(
        f"pairs.{pair.name}.{kind}"
        for pair in mechanism.pairs
        if pair.kind.has_axis
        for kind in ("longitude", "latitude")
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
