"""How quantities of a configuration change with sizes, and what deviations of sizes do."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import final

import numpy as np

from spherekit.conventions import TURN, listing, nearest
from spherekit.design.file_numbers import FileNumbers
from spherekit.design.profile_numbers import APART, ProfileNumbers, has_other_profiles
from spherekit.design.size_keys import (
    coaxial_links,
    link_sizes,
    quantities_of,
    sizes_of,
)
from spherekit.design.variables import (
    ACTIONS,
    DesignVariable,
    check_variables,
    design_variable,
    designed_pairs,
    is_angle_of_load,
)
from spherekit.design.verified_steps import Profiles, followed
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
from spherekit.model.actions import acting_links, need_tabulated, wound_pairs
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import SizeGeometry
from spherekit.planning.inputs import driven_at
from spherekit.progress import Working
from spherekit.sphere.rotation import Floats

TOGETHER = 2**16
"""Deviating configurations that are solved together."""


@final
class Sensitivity:
    """Quantities of configurations and their exact derivatives by sizes.

    Parameters
    ----------
    mechanism
        A mechanism with its inputs.
    keys
        Sizes, or numbers of masses and loads, as keys of its file; by default all arcs and
        angles, which a pose with R pairs alone has too, or else all axes of the pose.
    quantities
        Names of `row_quantities`; by default the angles of pairs between an output and the
        link it is seen from, or else of all passive pairs.

    Raises
    ------
    DesignError
        If a key is no size of an R pair and no number of a profile, a mass or a load, or a
        quantity is not known.
    """

    def __init__(
        self, mechanism: Mechanism, keys: Sequence[str] = (), quantities: Sequence[str] = ()
    ) -> None:
        mechanism = driven_at(mechanism)
        self.inputs = tuple(item.pair for item in mechanism.inputs)
        self.mechanism = mechanism
        self.document = document_of(mechanism, "rad")
        self._in_pose = link_sizes(mechanism)
        self.keys = (
            tuple(keys)
            or tuple(self._in_pose)
            or sizes_of(mechanism)
            or self._of_profiles()
        )
        if not self.keys:
            raise DesignError(
                f"{mechanism.name}: no link of it has sizes, for none has two axes; name "
                "numbers of the file"
            )
        every = tuple(self._variable(key) for key in self.keys)
        self._named = [variable.path for variable in every] if keys else []
        check_variables(self.document, every)
        acting = [variable.path[0] in ACTIONS for variable in every]
        self._shaping, self._acting = (
            np.flatnonzero(~np.array(acting)),
            np.flatnonzero(acting),
        )
        self.variables = tuple(every[k] for k in self._shaping)
        self.actions: FileNumbers | None = None
        if any(acting):
            chosen = [every[k] for k in self._acting]
            self.actions = FileNumbers(
                self.document, mechanism, chosen, self.inputs, None, whole=False
            )
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

    @property
    def left_out(self) -> tuple[str, ...]:
        """The links with two axes on one line, whose sizes are none by default."""
        geometry = self.mechanism.geometry
        if not isinstance(geometry, SizeGeometry):
            return ()
        named = [path[1] for key in self.keys if (path := key.split("."))[0] == "links"]
        return tuple(x for x in coaxial_links(geometry) if x not in named)

    @cached_property
    def _profiled(self) -> bool:
        return has_other_profiles(self.mechanism)

    def _variable(self, key: str) -> DesignVariable:
        if key in self._in_pose:
            return self._in_pose[key]
        variable = design_variable(self.document, key)
        if variable.path[0] in ACTIONS:
            return variable
        of_contact = variable.path[0] == "pairs" and (
            self._hinged is not None if not self._profiled else "profiles" in variable.path
        )
        if variable.slot is None and not of_contact:
            raise DesignError(
                f"{self.mechanism.name}: {key} is no size: derivatives are by arcs, "
                "angles, zeros and axes of R pairs, by numbers of profiles, and of masses "
                "and loads"
            )
        return variable

    @property
    def _of_actions(self) -> list[int]:
        """Which numbers of masses and loads the kernel has after its sizes."""
        return [] if self.actions is None else self.actions.of_actions

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
                differing=self._of_actions,
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

    def deviating(self, size: float, singly: Mapping[str, float]) -> tuple[float, ...]:
        """Return by how much each size is off, `size` (rad) or what is said `singly`.

        The latter in degrees for angles, and in the unit of other numbers; masses and loads
        are exact where nothing is said.

        Raises
        ------
        DesignError
            If nothing is asked by a key, or what it stands for is exact anyway.
        """
        for key in singly:
            if key not in self.keys:
                raise DesignError(
                    f"{self.mechanism.name}: a deviation of {key}, by which nothing is "
                    f"asked{nearest(key, self.keys) or ';'} it is by {listing(self.keys)}"
                )
        made = np.full(len(self.keys), size)
        made[self._acting] = 0.0
        for key, deviation in singly.items():
            place = self.keys.index(key)
            is_angle = place in self._shaping or is_angle_of_load(self.document, key)
            made[place] = np.radians(deviation) if is_angle else deviation
        return tuple(made.tolist())

    @cached_property
    def links(self) -> frozenset[int]:
        """The numbers of the links on which quantities depend, or whose sizes are named."""
        pairs, names = self.mechanism.pairs, self.mechanism.links
        made = {
            f"{kind}_{pair.name}": pair.links
            for kind in ("theta", "rate", "transmission_angle")
            for pair in pairs
        }
        for kind in ("velocity_coefficient", "acceleration_coefficient"):
            made |= {f"{kind}_{a}_{b}": (a, b) for a in names for b in names}
        wanted: set[str] = set()
        acting = False
        for quantity in self.quantities:
            wanted |= set(made.get(quantity.split("_by_")[0], ()))
            acting |= quantity.split("_")[0] in ("torque", "B", "dB")
        for path in self._named:
            acting |= path[0] in ACTIONS
            on = [pair.links for pair in pairs if path[1] in (pair.name, *pair.links)]
            wanted |= set().union(*on)
        numbers = frozenset(self.mechanism.link_number[name] for name in wanted)
        return numbers | (acting_links(self.mechanism) if acting else frozenset())

    @property
    def wound(self) -> tuple[str, ...]:
        """The pairs whose turns count: loads that matter depend on their variables."""
        if not any(name.split("_by_")[0] == "torque" for name in self.quantities):
            return ()
        return wound_pairs(self.mechanism)

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
                differing=self._of_actions,
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
        """What the kernel has as inputs (k, 1) in the file."""
        sizes = np.array([[variable.value] for variable in self.variables]).reshape(-1, 1)
        if self._numbers is not None:
            sizes = np.array(self._numbers.nominal)[self._numbers.of_contacts][:, None]
        elif self._profiled:
            sizes = sizes[self._sized]
        if self.actions is None:
            return sizes
        numbers = np.array(self.actions.nominal)[self._of_actions]
        return np.concatenate([sizes, numbers[:, None]])

    @property
    def _acting_from(self) -> int:
        """At which of the kernel's inputs numbers of masses and loads begin."""
        return len(self._nominal) - len(self._of_actions)

    def _by_sizes(self, gradients: Floats, values: Floats) -> Floats:
        """Return derivatives (sizes, c, n) from those by what the kernel has as inputs.

        At the configurations `values` (n, w).
        """
        first, last = self._acting_from, len(self._nominal)
        made = np.empty((len(self.keys), *gradients.shape[1:]))
        shape = np.concatenate([gradients[:first], gradients[last:]])
        made[self._shaping] = self._by_shape(shape, values)
        if self.actions is not None:
            numbers = np.array([variable.value for variable in self.actions.variables])
            slopes = self.actions.slopes(numbers)
            made[self._acting] = np.tensordot(slopes.T, gradients[first:last], 1)
        return made

    def _by_shape(self, gradients: Floats, values: Floats) -> Floats:
        """Return those by what says where links are."""
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
        shape, first = deviations[self._shaping], self._acting_from
        if self._numbers is not None:
            values = np.array([[variable.value] for variable in self.variables])
            numbers, _ = self._numbers.at(values + shape)
            made = numbers[: len(self._numbers.of_contacts)]
        else:
            made = self._nominal[:first] + (shape[self._sized] if self._profiled else shape)
        if self.actions is None:
            return made
        values = np.array([[variable.value] for variable in self.actions.variables])
        numbers, _ = self.actions.at(values + deviations[self._acting])
        return np.concatenate([made, numbers])

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
            (n, variables) the closed configurations there, rad; those of `wound` pairs
            with the turns that they have made.

        Notes
        -----
        Rad and SI. The inputs are held, and the loops stay closed: from the derivative of
        the closure equations by a size, solved for the variables.
        """
        if any(name.startswith("torque") for name in self.quantities):
            need_tabulated(self.mechanism, samples[:, -1])
        kernel = self._gradient
        prepared = kernel.prepare(np.repeat(self._nominal, len(samples), axis=1))
        rows = [samples.T, self._placed(values).T]
        if self._profiles is not None:
            rows.append(self._profiles.columns(values))
        rows.append(np.zeros((len(kernel.turning), len(samples))))  # values count turns
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
            (sizes, draws) rad, or in the unit of the number, added to the sizes.

        Notes
        -----
        Followed from each configuration by Newton's method; NaN where none is there.
        """
        draws = deviations.shape[1]
        sizes, profiles = self._deviating(deviations), None
        if self._profiles is not None:
            profiles = self._profiles.towards(deviations[self._shaping])
        together = max(1, TOGETHER // draws)
        made, working = [], Working(f"{self.mechanism.name}: deviating mechanisms")
        for k in range(0, len(samples), together):
            working.tell(f"configuration {k + 1} of {len(samples)}".__str__)
            some = slice(k, k + together)
            made.append(self._closed(samples[some], values[some], sizes, profiles))
        return np.concatenate(made, axis=1)

    def _closed(
        self, samples: Floats, values: Floats, of_draws: Floats, profiles: Profiles | None
    ) -> Floats:
        """Return the quantities (c, n, draws) of mechanisms with sizes (k, draws)."""
        n, draws = len(samples), of_draws.shape[1]
        start = np.repeat(self._placed(values).T, draws, axis=1)
        sizes = np.tile(of_draws, n)
        away = self._away(sizes)
        now, closed = followed(self._newton, start, sizes, away, profiles, short=True)
        with np.errstate(all="ignore"):
            kernel, placed = self._plain, [now]
            if profiles is not None:
                placed.append(profiles(now, np.arange(n * draws), np.ones(n * draws)))
            placed.append(np.zeros((len(kernel.turning), n * draws)))
            rows = [np.repeat(samples.T, draws, axis=1), *placed, kernel.prepare(sizes)]
            result = kernel.evaluate(np.concatenate(rows))
        return np.where(closed, result, np.nan).reshape(-1, n, draws)

    def _away(self, sizes: Floats) -> Floats:
        """Return what sizes (k, m) of the kernel are from those of the file."""
        away = sizes - self._nominal
        if self._numbers is not None:
            angles = away[: self._acting_from]
            angles -= TURN * np.round(angles / TURN)  # those of wheels are of any turn
        return away
