"""How quantities of a configuration change with sizes, and what deviations of sizes do."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.designs.design_kernel import DesignKernel
from spherekit.designs.design_variables import (
    ACTIONS,
    DesignVariable,
    check_variables,
    coaxial_links,
    design_variable,
    is_angle_of_load,
    link_sizes,
    quantities_of,
    sizes_of,
)
from spherekit.designs.figures_of_merit import INERTIAL
from spherekit.designs.homotopy import SHORT, Profiles, tracked
from spherekit.designs.path_kernel import PathKernel
from spherekit.designs.profile_numbers import APART, has_other_profiles
from spherekit.designs.varied_mechanism import DesignAt, VariedMechanism
from spherekit.errors import CountError, DesignError, EngineError
from spherekit.files.number_change import document_of
from spherekit.mechanism.elements import SizeGeometry
from spherekit.mechanism.load_dependence import acting_links, need_tabulated, wound_pairs
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap
from spherekit.planning.assembly_plan import driven_at, plan_assembly
from spherekit.progress import ProgressReporter
from spherekit.velocities.design_expressions import DesignExpressions
from spherekit.velocities.equivalent_linkage import (
    EquivalentLinkage,
    find_equivalent_linkage,
)
from spherekit.velocities.load_numbers import LOAD_DEPENDENT_PREFIXES
from spherekit.velocities.row_quantities import row_quantities, sample_names
from spherekit.wording import choices, listing, nearest

TOGETHER = 2**16
"""Deviating configurations that are solved together."""


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
        mechanism = self.mechanism = driven_at(mechanism)
        self.inputs = mechanism.input_pairs
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
        self.variables = every = tuple(self._variable(key) for key in self.keys)
        self._named = [variable.path for variable in every] if keys else []
        check_variables(self.document, every)
        self._acting = np.array([variable.path[0] in ACTIONS for variable in every])
        self.quantities = tuple(quantities) or quantities_of(mechanism)
        try:
            plan_assembly(mechanism)
        except CountError as counted:
            raise DesignError(
                f"{mechanism.name}: some of its constraints are redundant, so that it "
                "closes with its sizes as they are and with none that deviate; leave "
                f"redundant pairs out of a copy of the file ({counted})"
            ) from None
        possible = row_quantities(mechanism)
        for name in self.quantities:
            if name not in possible:
                raise DesignError(
                    f'{mechanism.name}: "{name}" is no quantity of its configurations'
                    f"{nearest(name, possible) or ';'} such are theta_PAIR, rate_PAIR and "
                    "velocity_coefficient_LINK_OTHER"
                )

    def _of_profiles(self) -> Names:
        """Return the keys of radii and harmonics."""
        made = []
        for pair, table in self.document.data["pairs"].items():
            for link, profile in table.get("profiles", {}).items():
                for name in ("radius", "cosines", "sines"):
                    key = f"pairs.{pair}.profiles.{link}.{name}"
                    number = profile.get(name)
                    if isinstance(number, list):
                        made += [f"{key}.{k}" for k in range(len(number))]
                    elif number is not None:
                        made.append(key)
        return tuple(made)

    @property
    def left_out(self) -> Names:
        """The links with two axes on one line, whose sizes are none by default."""
        geometry = self.mechanism.geometry
        if not isinstance(geometry, SizeGeometry):
            return ()
        named = [key.split(".")[1] for key in self.keys if key.startswith("links.")]
        return tuple(x for x in coaxial_links(geometry) if x not in named)

    def _variable(self, key: str) -> DesignVariable:
        if key in self._in_pose:
            return self._in_pose[key]
        variable = design_variable(self.document, key)
        if variable.path[0] in ACTIONS:
            return variable
        of_contact = variable.path[0] == "pairs" and (
            "profiles" in variable.path
            if has_other_profiles(self.mechanism)
            else self._hinged is not None
        )
        if variable.slot is None and not of_contact:
            raise DesignError(
                f"{self.mechanism.name}: {key} is no size: derivatives are by arcs, "
                "angles, zeros and axes of R pairs, by numbers of profiles, and of masses "
                "and loads"
            )
        return variable

    @cached_property
    def _hinged(self) -> EquivalentLinkage | None:
        return find_equivalent_linkage(self.mechanism, self.inputs)

    @cached_property
    def _terms(self) -> DesignExpressions:
        """The terms of kernels, and `_varied` what designs have of them.

        Of the mechanism with its contacts, or with these as links where some of their
        numbers vary, or wheels repeat too much.
        """
        given = self.document, self.mechanism, self.variables, self.inputs
        sized = np.array([variable.slot is not None for variable in self.variables])
        if has_other_profiles(self.mechanism) or np.all(sized | self._acting):
            self._varied = VariedMechanism(*given)
            try:
                return self._varied.terms(False)
            except EngineError:
                if self._hinged is None or self._hinged.train is None:
                    raise
        self._varied = VariedMechanism(*given, self._hinged, apart=APART)
        if not self._varied.varies:
            raise DesignError(
                f"{self.mechanism.name}: with other {listing(self.keys)} there is no such "
                "mechanism: its profiles would not touch in the reference pose; vary "
                "sizes of links"
            )
        return self._varied.terms(False)

    @cached_property
    def _design(self) -> DesignAt:
        """What kernels have of the file."""
        _ = self._terms
        design = self._varied.design_at(self._varied.values, self.mechanism)
        if design is None:
            raise DesignError(f"{self.mechanism.name}: its file states no such mechanism")
        return design

    @property
    def timed(self) -> bool:
        """Whether a quantity depends on how the inputs move."""
        moving = (*sample_names(self.inputs)[len(self.inputs) :], "kinetic_energy")
        return any(
            name in moving or name.startswith(LOAD_DEPENDENT_PREFIXES)
            for name in self.quantities
        )

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
                    f"asked{choices(key, self.keys, 'it is by')}"
                )
        made = np.where(self._acting, 0.0, size)
        for key, deviation in singly.items():
            place = self.keys.index(key)
            is_angle = not self._acting[place] or is_angle_of_load(self.document, key)
            made[place] = np.radians(deviation) if is_angle else deviation
        return tuple(made.tolist())

    @cached_property
    def links(self) -> frozenset[int]:
        """The numbers of the links on which quantities depend, or whose sizes are named."""
        pairs = self.mechanism.pairs
        names = self.mechanism.links
        made = {
            f"{kind}_{pair.name}": pair.links
            for kind in ("theta", "rate", "transmission_angle")
            for pair in pairs
        }
        for kind in ("velocity_coefficient", "acceleration_coefficient"):
            made |= {f"{kind}_{a}_{b}": (a, b) for a in names for b in names}
        ends = [
            made.get(name.split("_by_")[0], () if name.startswith(INERTIAL) else names)
            for name in self.quantities
        ]
        ends += [
            pair.links
            for path in self._named
            for pair in pairs
            if path[1] in (pair.name, *pair.links)
        ]
        numbers = frozenset(self.mechanism.link_number[name] for name in chain(*ends))
        acting = any(name.startswith(INERTIAL) for name in self.quantities)
        if acting or any(path[0] in ACTIONS for path in self._named):
            return numbers | acting_links(self.mechanism)
        return numbers

    @property
    def wound(self) -> Names:
        """The pairs whose turns count: loads that matter depend on their variables."""
        if not any(name.startswith(LOAD_DEPENDENT_PREFIXES) for name in self.quantities):
            return ()
        return wound_pairs(self.mechanism)

    def at_rest(self, inputs: Floats) -> Floats:
        """Return samples (n, 3 inputs + 1) at inputs (n, inputs) rad that rest."""
        return np.pad(inputs, ((0, 0), (0, 2 * len(self.inputs) + 1)))

    @cached_property
    def _gradient(self) -> DesignKernel:
        return DesignKernel(self._terms, self.quantities, gradients=True, compiled=False)

    @cached_property
    def _plain(self) -> DesignKernel:
        return DesignKernel(self._terms, self.quantities, compiled=False)

    @cached_property
    def _newton(self) -> PathKernel:
        return PathKernel(self._terms, compiled=False)

    def _placed(self, values: Floats) -> Floats:
        """Return the variables (n, v) that the kernel has, from those of a motion."""
        contacts = self._varied.contacts
        return values if contacts is None else contacts.values(values)

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
        if any(name.startswith(LOAD_DEPENDENT_PREFIXES) for name in self.quantities):
            need_tabulated(self.mechanism, samples[:, -1])
        design = self._design
        places = self._placed(values).T
        return design.at(self._gradient, samples.T, places, values)[1:]

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
        design = self._design
        sizes, _ = self._varied.sizes(design.values[:, None] + deviations)
        given = design.profiles
        profiles = None if given is None else given.towards(deviations)
        together = max(1, TOGETHER // draws)
        made = []
        working = ProgressReporter(f"{self.mechanism.name}: deviating mechanisms")
        for k in range(0, len(samples), together):
            working.tell(f"configuration {k + 1} of {len(samples)}".__str__)
            some = slice(k, k + together)
            made.append(self._closed(samples[some], values[some], sizes, profiles))
        return np.concatenate(made, axis=1)

    def _closed(
        self, samples: Floats, values: Floats, of_draws: Floats, profiles: Profiles | None
    ) -> Floats:
        """Return the quantities (c, n, draws) of mechanisms with sizes (k, draws)."""
        n = len(samples)
        draws = of_draws.shape[1]
        start = np.repeat(self._placed(values).T, draws, axis=1)
        sizes = np.tile(of_draws, n)
        away = sizes - self._design.sizes[:, None]
        count = len(self._varied.of_contacts)
        away[:count] = wrap(away[:count])  # angles of wheels are of any turn
        now, closed = tracked(
            self._newton, start, (sizes - away, sizes), profiles=profiles, contracts=SHORT
        )
        with np.errstate(all="ignore"):
            columns = None
            if profiles is not None:
                columns = profiles(now, np.arange(n * draws), np.ones(n * draws))
            result = self._plain.at(
                np.repeat(samples.T, draws, axis=1), now, sizes, columns
            )
        return np.where(closed, result, np.nan).reshape(-1, n, draws)


Distribution = Literal["normal", "uniform"]

DISTRIBUTIONS: tuple[Distribution, ...] = ("normal", "uniform")


@dataclass(frozen=True)
class SizeDeviations:
    """Draws of sizes about those of the file.

    With a ``"normal"`` distribution `size` (rad) is the standard deviation, and the worst
    case three of it; with a ``"uniform"`` one sizes are off by at most `size`. It is one
    for all, or one for each, in the unit of that number.
    """

    size: float | tuple[float, ...]
    distribution: Distribution = "normal"
    count: int = 1024
    seed: int = 0

    def __post_init__(self) -> None:
        if self.distribution not in DISTRIBUTIONS:
            raise DesignError(
                f'distribution "{self.distribution}" is not known; it is normal or uniform'
            )
        sizes = np.atleast_1d(self.size)
        possible = np.all(np.isfinite(sizes) & (sizes >= 0.0)) and np.any(sizes > 0.0)
        if not possible or self.count < 0:
            raise DesignError(
                "a deviation is a positive number, of some sizes perhaps 0, and the number "
                "of draws not < 0"
            )

    @property
    def spread(self) -> Any:
        """The standard deviation (rad), one or (sizes,)."""
        return np.multiply(self.size, 1.0 if self.distribution == "normal" else 3.0**-0.5)

    @property
    def worst(self) -> Any:
        """The deviation (rad) of the worst case, one or (sizes,)."""
        return np.multiply(self.size, 3.0 if self.distribution == "normal" else 1.0)

    def draws(self, sizes: int) -> Floats:
        """Return deviations (sizes, count), spread evenly by a Sobol sequence."""
        from scipy.special import ndtri
        from scipy.stats import qmc

        power = (self.count - 1).bit_length()
        unit = qmc.Sobol(sizes, rng=self.seed).random_base2(power).T[:, : self.count]
        size = np.reshape(self.size, (-1, 1))
        if self.distribution == "uniform":
            return size * (2.0 * unit - 1.0)
        return size * ndtri(np.clip(unit, 1e-12, 1.0 - 1e-12))
