"""Sensitivities: derivatives of quantities of a configuration with respect to sizes."""

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.designs.design_kernel import DesignKernel
from spherekit.designs.design_variables import (
    ACTIONS,
    DesignVariable,
    check_variables,
    coaxial_links,
    default_quantities,
    default_size_keys,
    design_variable,
    is_angle_of_load,
    link_sizes,
    make_design,
)
from spherekit.designs.figures_of_merit import INERTIAL
from spherekit.designs.homotopy import (
    SHORT_PATH_CONTRACTION,
    ProfileColumns,
    track_solutions,
)
from spherekit.designs.path_kernel import PathKernel
from spherekit.designs.profile_numbers import (
    DEVIATING_PROFILE_GAP_RAD,
    has_shaped_profiles,
)
from spherekit.designs.varied_mechanism import DesignPoint, VariedMechanism
from spherekit.errors import CountError, DesignError, EngineError, SpherekitError
from spherekit.files.number_change import document_of
from spherekit.files.toml_lines import KeyPath
from spherekit.mechanism.elements import SizeGeometry
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.load_dependence import (
    acting_links,
    check_torque_tables_cover,
    wound_pairs,
)
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap
from spherekit.planning.assembly_plan import driven_at, plan_assembly
from spherekit.planning.gear_mesh import find_carried_contact, find_carried_contacts
from spherekit.progress import ProgressReporter
from spherekit.symbolic.expression_evaluation import array_function
from spherekit.velocities.design_expressions import DesignExpressions
from spherekit.velocities.equivalent_linkage import (
    EquivalentLinkage,
    find_equivalent_linkage,
)
from spherekit.velocities.load_numbers import LOAD_DEPENDENT_PREFIXES
from spherekit.velocities.row_quantities import row_quantities, sample_names
from spherekit.wording import choices, listing, nearest

TRIAL_STEP_RAD = 1e-3
"""Change of a size that shows whether the size moves two touching wheels apart.

Larger: the changed file may be impossible. Smaller: the gap is not distinguished from
rounding.
"""

TOUCHING_COSINE_TOLERANCE = 1e-9
"""Largest error of the cosine of the arc between the centres of two wheels that touch.

Larger: sizes that move wheels apart by little count as sizes that do not. Smaller: rounding
counts as a gap.
"""

MAX_DEVIATING_ROWS = 2**16
"""Number of deviating configurations that are solved together.

Larger: more memory. Smaller: more calls.
"""


class Sensitivity:
    """Computes quantities of configurations and their derivatives with respect to sizes.

    Parameters
    ----------
    mechanism
        A mechanism with its inputs.
    keys
        Sizes, or numbers of masses and loads, as keys of its file. By default these are the
        arcs and angles of all links, except those of links with two axes on one line
        (`left_out`) and those that move wheels apart (`moves_wheels_apart`). For a file
        with contacts and a reference pose, the default is the directions of the axes of
        all R pairs. If there are no such numbers, the default is the radii and Fourier
        coefficients of the contact profiles.
    quantities
        Names of the quantities, see `row_quantities`. By default these are the angles of
        pairs between an output and the link from which it is seen, or else of all passive
        R pairs. Without passive R pairs, these are the velocity coefficients of outputs.

    Attributes
    ----------
    inputs
        Names of the driven pairs.
    document
        The mechanism as a file with angles in rad.
    variables
        The sizes as numbers of this file.
    sizes_that_move_wheels_apart
        Keys that are left out of the default sizes, see `moves_wheels_apart`.

    Raises
    ------
    DesignError
        If a key is not a size of a link or R pair, nor a number of a contact, mass or load,
        or if a quantity is unknown.
    FileError
        If the file has no number of a key.
    """

    def __init__(
        self, mechanism: Mechanism, keys: Sequence[str] = (), quantities: Sequence[str] = ()
    ) -> None:
        """Choose the sizes and quantities, and check them.

        Parameters
        ----------
        mechanism
            The mechanism, from which a file with angles in rad is made.
        keys
            The numbers of the file with respect to which derivatives are computed, such as
            ``links.2.arc``. The defaults are stated at the class.
        quantities
            Names of the quantities that are differentiated, as in `row_quantities`.

        Raises
        ------
        DesignError
            If there are no sizes or no such quantity, if a size moves wheels apart, or if
            constraints are redundant.
        """
        mechanism = driven_at(mechanism)
        self.mechanism = mechanism
        self.inputs = mechanism.input_pairs
        self.document = document_of(mechanism, "rad")
        # Arcs and angles of links by key, derived from the reference pose if the file has
        # one.
        self._link_sizes = link_sizes(mechanism)
        possible_keys = (
            tuple(keys)
            or tuple(self._link_sizes)
            or default_size_keys(mechanism)
            or self._profile_keys()
        )
        if not possible_keys:
            raise DesignError(
                f"{mechanism.name}: no link has two axes, so there are no link dimensions "
                "with respect to which derivatives could be taken; name numbers of the "
                "file instead"
            )
        # Sizes without derivatives are refused if the user named them or if nothing else
        # is left. Otherwise the defaults do without them.
        without_derivatives = tuple(
            key for key in possible_keys if self.moves_wheels_apart(key)
        )
        self.keys = tuple(key for key in possible_keys if key not in without_derivatives)
        if without_derivatives and (keys or not self.keys):
            raise DesignError(
                f"{mechanism.name}: there are no derivatives with respect to "
                f"{listing(without_derivatives)}, because a change moves two touching "
                "wheels apart and another contact has a profile that is not a circle; vary "
                "other numbers, or compare designs with a sweep"
            )
        self.sizes_that_move_wheels_apart: Names = without_derivatives
        self.variables = tuple(self._make_variable(key) for key in self.keys)
        # Paths, in the file, of the numbers that the user has named.
        self._named_paths = [variable.path for variable in self.variables] if keys else []
        check_variables(self.document, self.variables)
        # (sizes,) whether the variable is a number of a mass or load. `path[0]` is the
        # table of the file in which the number is.
        self._is_mass_or_load = np.array(
            [variable.path[0] in ACTIONS for variable in self.variables]
        )
        self.quantities = tuple(quantities) or default_quantities(mechanism)
        # Planning fails if there are fewer degrees of freedom than inputs.
        try:
            plan_assembly(mechanism)
        except CountError as counted:
            raise DesignError(
                f"{mechanism.name}: some of its constraints are redundant, so its loops "
                "close only with the exact dimensions of the file and not with dimensions "
                f"that deviate; leave redundant pairs out of a copy of the file ({counted})"
            ) from None
        possible = row_quantities(mechanism)
        for name in self.quantities:
            if name not in possible:
                raise DesignError(
                    f'{mechanism.name}: there is no quantity "{name}"'
                    f"{nearest(name, possible) or '.'} Examples: theta_PAIR, rate_PAIR and "
                    "velocity_coefficient_LINK_OTHER, where OTHER is another link"
                )

    def _profile_keys(self) -> Names:
        """Return the keys of the radii and series coefficients of all profiles."""
        keys = []
        for pair, table in self.document.data["pairs"].items():
            for link, profile in table.get("profiles", {}).items():
                for name in ("radius", "cosines", "sines"):
                    key = f"pairs.{pair}.profiles.{link}.{name}"
                    number = profile.get(name)
                    if isinstance(number, list):
                        keys += [f"{key}.{k}" for k in range(len(number))]
                    elif number is not None:
                        keys.append(key)
        return tuple(keys)

    def moves_wheels_apart(self, key: str) -> bool:
        """Return whether a size has no derivatives, because it moves wheels apart.

        A wheel is a circle that rolls on another one. Both rotate about axes on the same
        link, their carrier. If a size changes, the wheels may no longer touch exactly.

        If all contact profiles are circles, this does no harm, because constant gear ratios
        replace the wheels. If another profile is not a circle, all contacts are kept. The
        loops of a mechanism with wheels that do not touch cannot be closed. So a trial step
        shows whether all wheels still touch.

        Parameters
        ----------
        key
            Key of a number of the mechanism file with angles in rad.

        Raises
        ------
        DesignError
            If there is no such number, or no derivative with respect to it.
        """
        if not (has_shaped_profiles(self.mechanism) and self._wheel_contacts):
            return False
        variable = self._make_variable(key)
        # Numbers of masses, loads and outputs move no wheel.
        if variable.path[0] in ACTIONS or variable.path[0] == "outputs":
            return False
        for step in (TRIAL_STEP_RAD, -TRIAL_STEP_RAD):
            try:
                changed = make_design(self.document, [variable], [variable.value + step])
                joints = make_joints(changed, DEVIATING_PROFILE_GAP_RAD)
            except SpherekitError:
                # The file does not allow this value. The other one is tried.
                continue
            # A contact is None if its wheels no longer touch or have no common carrier.
            return any(
                find_carried_contact(changed, joints, pair, TOUCHING_COSINE_TOLERANCE)
                is None
                for pair in self._wheel_contacts
            )
        return False

    @cached_property
    def _wheel_contacts(self) -> frozenset[int]:
        """Indices of the rolling contacts of two circles with a common carrier."""
        return find_carried_contacts(self.mechanism)

    @property
    def left_out(self) -> Names:
        """Links with two axes on one line, whose sizes are left out by default."""
        geometry = self.mechanism.geometry
        if not isinstance(geometry, SizeGeometry):
            return ()
        named_links = [key.split(".")[1] for key in self.keys if key.startswith("links.")]
        return tuple(link for link in coaxial_links(geometry) if link not in named_links)

    def _make_variable(self, key: str) -> DesignVariable:
        """Return the number of the mechanism file that a key names, as a design variable.

        Quantities are differentiated with respect to such numbers. Possible are all angles,
        masses and loads. Numbers that describe contacts between links are possible in two
        cases:

        - If some profile (contact curve) is not a circle, the numbers of all profiles are
          possible.
        - If all profiles are circles, and a linkage without contacts has the same motion,
          all numbers of the contacts are possible. The linkage then replaces the contacts.

        Raises
        ------
        DesignError
            If there are no derivatives with respect to this number.
        """
        # A file with a reference pose has no arcs and angles of links. `_link_sizes` has
        # those that were computed from the axes.
        if key in self._link_sizes:
            return self._link_sizes[key]
        variable = design_variable(self.document, key)
        # `path[0]` is the table of the file in which the number is.
        is_mass_or_load = variable.path[0] in ACTIONS
        if is_mass_or_load:
            return variable
        if has_shaped_profiles(self.mechanism):
            may_be_contact_number = "profiles" in variable.path
        else:
            may_be_contact_number = self._equivalent_linkage is not None
        is_contact_number = variable.path[0] == "pairs" and may_be_contact_number
        has_derivatives = variable.is_angle or is_contact_number
        if not has_derivatives:
            raise DesignError(
                f"{self.mechanism.name}: {key} is not a dimension; derivatives can be "
                "taken with respect to arcs, angles, zeros and axes of R pairs, and "
                "numbers of profiles, masses and loads"
            )
        return variable

    @cached_property
    def _equivalent_linkage(self) -> EquivalentLinkage | None:
        """The mechanism with links instead of contacts of circles, if there is one."""
        return find_equivalent_linkage(self.mechanism, self.inputs)

    @property
    def _has_gear_train(self) -> bool:
        """Whether wheels roll on each other that are carried by a common link."""
        linkage = self._equivalent_linkage
        return linkage is not None and linkage.train is not None

    @cached_property
    def _varied(self) -> tuple[VariedMechanism, DesignExpressions]:
        """The mechanism with its sizes as variables, and its expressions.

        Contacts of circles can be replaced by links with R pairs between the centres of the
        circles (the equivalent linkage). Contacts with other profiles cannot.

        1. If a contact has another profile, or if no size of a contact varies, the contacts
           are kept.
        2. In all other cases, links replace the contacts.

        There is one exception to rule 1. If a size of a link or R pair varies in a gear
        train, links replace the contacts. Such a size can move the axes of two wheels. With
        the contacts kept, the wheels would hold their axes at the old distance, and the
        derivatives would be wrong.

        Returns
        -------
        varied_mechanism
            Computes the sizes of the expressions from values of the file's numbers.
        expressions
            Quantities of a configuration as functions of the variables of all pairs.

        Raises
        ------
        DesignError
            If the file allows no other values of the sizes.
        """
        # An angle here is a size of a link or R pair, not a number of a contact.
        is_angle = np.array([variable.is_angle for variable in self.variables])
        no_contact_varies = np.all(is_angle | self._is_mass_or_load)
        varies_links = any(
            variable.is_angle and variable.path[0] != "outputs"
            for variable in self.variables
        )
        # 1. The contacts as they are
        if has_shaped_profiles(self.mechanism) or (
            no_contact_varies and not (varies_links and self._has_gear_train)
        ):
            varied_mechanism = VariedMechanism(
                self.document, self.mechanism, self.variables, self.inputs
            )
            try:
                # Without closed form, the arguments of the expressions are the variables of
                # all pairs in a configuration.
                return varied_mechanism, varied_mechanism.make_expressions(
                    closed_form=False
                )
            except EngineError:
                # For wheels (a gear train) go on with links in place of contacts.
                if not self._has_gear_train:
                    raise
        # 2. Links in place of contacts. If a size deviates, the wheels of the reference
        # pose no longer touch exactly. Wheels count as rolling on each other if their gap
        # is below `wheel_gap_rad`.
        varied_mechanism = VariedMechanism(
            self.document,
            self.mechanism,
            self.variables,
            self.inputs,
            equivalent_linkage=self._equivalent_linkage,
            wheel_gap_rad=DEVIATING_PROFILE_GAP_RAD,
        )
        if not varied_mechanism.can_vary:
            raise DesignError(
                f"{self.mechanism.name}: {listing(self.keys)} cannot be varied, because "
                "with other values the profiles would not touch in the reference pose; "
                "vary dimensions of links instead"
            )
        return varied_mechanism, varied_mechanism.make_expressions(closed_form=False)

    @property
    def _varied_mechanism(self) -> VariedMechanism:
        """The mechanism with its sizes as variables."""
        varied_mechanism, _ = self._varied
        return varied_mechanism

    @property
    def _expressions(self) -> DesignExpressions:
        """The mechanism as expressions of its sizes."""
        _, expressions = self._varied
        return expressions

    @cached_property
    def _nominal_design(self) -> DesignPoint:
        """The sizes of the file, and derivatives of sizes with respect to variables."""
        varied_mechanism = self._varied_mechanism
        design = varied_mechanism.evaluate_design(
            varied_mechanism.nominal_values, self.mechanism
        )
        if design is None:
            raise DesignError(
                f"{self.mechanism.name}: the numbers of its file do not form a valid "
                "mechanism, so there are no derivatives; check the file with `spherekit "
                "validate`"
            )
        return design

    @property
    def timed(self) -> bool:
        """Whether a quantity depends on the rates or accelerations of inputs, or time."""
        rates_and_time = sample_names(self.inputs)[len(self.inputs) :]
        moving = (*rates_and_time, "kinetic_energy")
        return any(
            name in moving or name.startswith(LOAD_DEPENDENT_PREFIXES)
            for name in self.quantities
        )

    def deviating(self, size: float, singly: Mapping[str, float]) -> tuple[float, ...]:
        """Return how much each number of the mechanism file deviates, in rad and SI units.

        A tolerance analysis needs these deviations, which are standard deviations or limits
        of random errors of the numbers in `keys`: sizes, masses and loads.

        Parameters
        ----------
        size
            Common deviation (rad) of all sizes that are not in `singly`. Masses and loads
            that are not in `singly` do not deviate.
        singly
            Individual deviations, by the key of the number in the file: in degrees for
            angles, in deg/s for rates of angles, and in SI units for other numbers.

        Returns
        -------
        (keys,) deviations in rad and SI units.

        Raises
        ------
        DesignError
            If a key of `singly` is not among the numbers.
        """
        for key in singly:
            if key not in self.keys:
                raise DesignError(
                    f"{self.mechanism.name}: a deviation is given for {key}, but "
                    "derivatives with respect to it are not requested"
                    f"{choices(key, self.keys, 'Requested')}"
                )
        deviations = np.where(self._is_mass_or_load, 0.0, size)
        for key, deviation in singly.items():
            # `is_angle` is also true for rates of angles.
            is_in_degrees = self.is_angle(key)
            if is_in_degrees:
                deviation = np.radians(deviation)
            deviations[self.keys.index(key)] = deviation
        return tuple(deviations.tolist())

    def is_angle(self, key: str) -> bool:
        """Return whether one of the varied numbers is an angle or an angular velocity.

        Parameters
        ----------
        key
            Key of the number in the file, such as ``links.2.arc``.
        """
        index = self.keys.index(key)
        # A few numbers of loads are angles.
        if self._is_mass_or_load[index]:
            return is_angle_of_load(self.document, key)
        # On the unit sphere sizes are angles. Exceptions are the distance (m) of a contact
        # from the centre, and the components of the centre of a profile, a unit vector:
        # ("pairs", PAIR, "distance"), ("pairs", PAIR, "profiles", LINK, "centre_xyz", k).
        path = self.variables[index].path
        return path[2] != "distance" and "centre_xyz" not in path[4:]

    @cached_property
    def links(self) -> frozenset[int]:
        """Indices of the links that are needed for the requested derivatives.

        The user asks for derivatives of quantities with respect to named numbers of the
        mechanism file: sizes, or numbers of masses and loads. A run leaves out other links,
        which saves time.
        """
        link_names: set[str] = set()
        for quantity in self.quantities:
            link_names.update(self._list_links_of_quantity(quantity))
        for path in self._named_paths:
            link_names.update(self._list_links_of_number(path))
        links = frozenset(self.mechanism.link_number[name] for name in link_names)
        if self._needs_masses_or_loads:
            # Quantities such as the equivalent inertia also depend on the links that have
            # mass, and on those to which loads refer.
            return links | acting_links(self.mechanism)
        return links

    def _list_links_of_quantity(self, quantity: str) -> Sequence[str]:
        """Return the names of the links whose motion determines a quantity.

        A run leaves out links that the derivatives do not need. Quantities of masses and
        loads, such as the equivalent inertia, have no links here. The property `links` adds
        the links on which masses and loads act.
        """
        if quantity.startswith(INERTIAL):
            return ()
        # With several inputs, names of quantities end with "_by_" and the moving input.
        without_input, *_ = quantity.split("_by_")
        # All quantities that are not listed are assumed to depend on all links.
        return self._links_of_relative_quantity.get(without_input, self.mechanism.links)

    @cached_property
    def _links_of_relative_quantity(self) -> dict[str, tuple[str, str]]:
        """The two links of each quantity that describes their relative motion, by name."""
        links_of_quantity: dict[str, tuple[str, str]] = {}
        for kind in ("theta", "rate", "transmission_angle"):
            for pair in self.mechanism.pairs:
                links_of_quantity[f"{kind}_{pair.name}"] = pair.links
        for kind in ("velocity_coefficient", "acceleration_coefficient"):
            for link in self.mechanism.links:
                for reference_link in self.mechanism.links:
                    quantity = f"{kind}_{link}_{reference_link}"
                    links_of_quantity[quantity] = (link, reference_link)
        return links_of_quantity

    def _list_links_of_number(self, path: KeyPath) -> list[str]:
        """Return the names of the links that a number of the mechanism file affects.

        A run needs these links for derivatives with respect to the number. It leaves out
        links that no derivative needs.

        If the number belongs to a pair (joint), these are its two links. If the number
        belongs to a link, these are the links of all its pairs. A name may occur several
        times.

        Parameters
        ----------
        path
            Place of the number in the file, such as ("links", "2", "arc") or
            ("pairs", "41", "zero").
        """
        # The second part of the path names a pair or a link.
        pair_or_link = path[1]
        links: list[str] = []
        for pair in self.mechanism.pairs:
            if pair_or_link == pair.name or pair_or_link in pair.links:
                links.extend(pair.links)
        return links

    @property
    def _needs_masses_or_loads(self) -> bool:
        """Whether the quantities or the named numbers include masses or loads."""
        # `ACTIONS` are the tables of masses and loads in the file.
        return any(name.startswith(INERTIAL) for name in self.quantities) or any(
            path[0] in ACTIONS for path in self._named_paths
        )

    @property
    def wound(self) -> Names:
        """Pairs whose revolutions count, because loads depend on their variables."""
        if not any(name.startswith(LOAD_DEPENDENT_PREFIXES) for name in self.quantities):
            return ()
        return wound_pairs(self.mechanism)

    def at_rest(self, inputs: Floats) -> Floats:
        """Return samples (n, 3 * inputs + 1) at resting inputs (n, inputs) rad, time 0."""
        return np.pad(inputs, ((0, 0), (0, 2 * len(self.inputs) + 1)))

    @cached_property
    def _gradient_kernel(self) -> DesignKernel:
        """Computes the quantities and their derivatives."""
        return DesignKernel(
            self._expressions, self.quantities, gradients=True, compiled=False
        )

    @cached_property
    def _quantity_kernel(self) -> DesignKernel:
        """Computes the quantities without derivatives."""
        return DesignKernel(self._expressions, self.quantities, compiled=False)

    @cached_property
    def _path_kernel(self) -> PathKernel:
        """The closure equations, by which configurations are tracked."""
        return PathKernel(self._expressions, compiled=False)

    def _kernel_variables(self, values: Floats) -> Floats:
        """Return the pair variables (rad) of the mechanism that the equations describe.

        The equations describe the mechanism itself, or the equivalent linkage. In this
        linkage, links between the centres of circles replace the contacts. The n
        configurations `values` (n, v) of the mechanism become those (n, w) of the linkage.
        """
        linkage = self._varied_mechanism.equivalent_linkage
        return values if linkage is None else linkage.values(values)

    def at(self, samples: Floats, values: Floats) -> tuple[Floats, Floats]:
        """Return quantities at n configurations, and derivatives with respect to the sizes.

        Inputs, rates and accelerations stay constant. If a size changes, the other pairs
        move so that all loops of links stay closed.

        Parameters
        ----------
        samples
            (n, 3 * inputs + 1) the inputs (rad), their rates (rad/s) and accelerations
            (rad/s2), and the time (s).
        values
            (n, variables) pair (joint) variables in rad with which all loops close. Angles
            on which loads depend, such as that of a wound spring, include whole
            revolutions.

        Returns
        -------
        quantities
            (quantities, n) in rad and SI units.
        derivatives
            (sizes, quantities, n) derivatives of the quantities with respect to the sizes,
            in rad and SI units.
        """
        if not len(samples):
            quantity_count = len(self.quantities)
            return np.zeros((quantity_count, 0)), np.zeros(
                (len(self.keys), quantity_count, 0)
            )
        # Torques can be tables over time. An error is raised if a time is outside them.
        times_in_s = samples[:, -1]
        self._check_times(times_in_s)
        # A kernel (function of many configurations) computes the quantities and their
        # derivatives. The kernel may describe an equivalent linkage, in which links between
        # the centres of circles replace contacts of circles. Its pair variables differ from
        # those of the mechanism.
        kernel_variables = self._kernel_variables(values)
        column_gradients = self._nominal_design.evaluate_gradients(
            self._gradient_kernel,
            samples.T,
            position_arguments=kernel_variables.T,
            # Contact profiles (curves) that are not circles remain in the linkage. They are
            # evaluated at the variables of the mechanism.
            pair_values=values,
        )
        return column_gradients.columns, column_gradients.gradients

    def _check_times(self, times: Floats) -> None:
        """Raise an error if a table of torques over time does not cover all times.

        `times` (n,) are in seconds. If no quantity depends on loads, nothing is checked.
        """
        if any(name.startswith(LOAD_DEPENDENT_PREFIXES) for name in self.quantities):
            check_torque_tables_cover(self.mechanism, times)

    def scattered(self, samples: Floats, values: Floats, deviations: Floats) -> Floats:
        """Return quantities of mechanisms with deviating sizes, for a tolerance analysis.

        A draw is one set of deviating sizes. Its configurations are followed by Newton's
        method from the configurations of the nominal mechanism. To limit memory, the
        samples are computed in blocks, each with all draws.

        Parameters
        ----------
        samples
            (n, 3 * inputs + 1) inputs (rad), their rates and accelerations, and the time
            (s).
        values
            (n, variables) pair variables (rad) of the nominal mechanism.
        deviations
            (numbers, draws) for each draw, the deviations of numbers of the mechanism file:
            in rad for angles, otherwise in the unit of the file.

        Returns
        -------
        (quantities, n, draws) the quantities with which this object was made, in rad and SI
        units. NaN where a mechanism cannot be assembled.
        """
        draw_count = deviations.shape[1]
        if not (len(samples) and draw_count):
            return np.zeros((len(self.quantities), len(samples), draw_count))
        design = self._nominal_design
        numbers_of_draws = design.values[:, None] + deviations
        # (sizes, draws) the sizes in the closure equations follow from the numbers of the
        # file. Sizes that cannot be computed for a draw are NaN.
        sizes, _reasons = self._varied_mechanism.kernel_sizes(numbers_of_draws)
        # Contact profiles that are not circles deviate, too. `profiles` is a function that
        # returns the profiles at each step from the nominal mechanism to a draw.
        profiles = None
        if design.profiles is not None:
            profiles = design.profiles.interpolate_to(deviations)
        block_size = max(1, MAX_DEVIATING_ROWS // draw_count)
        parts = []
        progress = ProgressReporter(f"{self.mechanism.name}: deviating mechanisms")
        # `start` is the first sample of a block.
        for start in range(0, len(samples), block_size):
            # `report_if_due` calls the lambda at once, so `start` still has its present
            # value.
            progress.report_if_due(
                lambda: f"configuration {start + 1} of {len(samples)}",  # noqa: B023
                done=start,
                total=len(samples),
            )
            block = slice(start, start + block_size)
            parts.append(self._close_draws(samples[block], values[block], sizes, profiles))
        return np.concatenate(parts, axis=1)

    def _close_draws(
        self,
        samples: Floats,
        values: Floats,
        draw_sizes: Floats,
        profiles: ProfileColumns | None,
    ) -> Floats:
        """Return the quantities of mechanisms whose sizes deviate from the nominal ones.

        A draw is one set of deviating sizes. From each nominal configuration, the
        configuration of each draw is tracked by Newton's method while the sizes change from
        the nominal sizes to the sizes of the draw.

        Parameters
        ----------
        samples
            (n, 3 * inputs + 1) inputs (rad), rates, accelerations, and the time (s).
        values
            (n, variables) pair variables (rad) of the nominal mechanism.
        draw_sizes
            (k, draws) sizes of each draw, as the equations have them.
        profiles
            Returns the numbers of contact profiles along the paths to the draws. None if
            all profiles are circles.

        Returns
        -------
        (quantities, n, draws) quantities, NaN where a mechanism does not close.
        """
        sample_count = len(samples)
        draw_count = draw_sizes.shape[1]
        # In all arrays below, column s * draw_count + d is draw d of sample s.
        nominal_sizes = self._nominal_design.sizes[:, None]
        nominal_configurations = np.repeat(
            self._count_wheel_revolutions(self._kernel_variables(values).T, nominal_sizes),
            draw_count,
            axis=1,
        )
        sizes = np.tile(draw_sizes, sample_count)
        # The first sizes are numbers of contacts: Euler angles, and ratios and angles of
        # wheels. Whole revolutions of the angles are no deviation. Ratios deviate less.
        contact_count = len(self._varied_mechanism.varied_contact_numbers)
        sizes[:contact_count] = nominal_sizes[:contact_count] + wrap(
            sizes[:contact_count] - nominal_sizes[:contact_count]
        )
        configurations, is_closed = track_solutions(
            self._path_kernel,
            nominal_configurations,
            sizes=(nominal_sizes, sizes),
            profiles=profiles,
            contraction=SHORT_PATH_CONTRACTION,
        )
        with np.errstate(all="ignore"):
            profile_columns = None
            if profiles is not None:
                column_count = sample_count * draw_count
                # The path parameter is 1 at the end of each path.
                profile_columns = profiles(
                    configurations, np.arange(column_count), np.ones(column_count)
                )
            quantities = self._quantity_kernel.evaluate_samples(
                np.repeat(samples.T, draw_count, axis=1),
                position_arguments=configurations,
                sizes=sizes,
                profile_columns=profile_columns,
            )
        quantities = np.where(is_closed, quantities, np.nan)
        return quantities.reshape(-1, sample_count, draw_count)

    def _count_wheel_revolutions(self, configurations: Floats, sizes: Floats) -> Floats:
        """Add whole revolutions to the angles of pairs that the inputs drive by wheels.

        The position analysis returns angles from -pi to pi. In the closure equations, the
        angle of such a pair is a linear function of the inputs, and can be larger. An angle
        that differs from it by whole revolutions does not solve the equations. Then the
        configuration cannot be the start of Newton's method.

        Parameters
        ----------
        configurations
            (variables, n) pair variables (rad) of the mechanism that the equations
            describe: the mechanism itself or its equivalent linkage.
        sizes
            (k, 1) values of the sizes that are symbols in the equations.

        Returns
        -------
        (variables, n) the same pair variables, with these angles as the linear functions
        give them, up to rounding.
        """
        expressions = self._expressions
        symbols = expressions.configuration_symbols
        # In `expressions.variables`, pairs that wheels drive have a linear function. All
        # other variables are their own symbols.
        function_by_variable = {
            k: variable
            for k, variable in enumerate(expressions.variables)
            if variable is not symbols[k]
        }
        if not function_by_variable:
            return configurations
        followers = [*function_by_variable]
        evaluate = array_function(
            [*function_by_variable.values()], [*symbols, *expressions.size_symbols]
        )
        n = configurations.shape[1]
        angles = evaluate(np.concatenate([configurations, np.repeat(sizes, n, axis=1)]))
        revolutions = np.round((angles - configurations[followers]) / (2.0 * np.pi))
        configurations = configurations.copy()
        configurations[followers] += 2.0 * np.pi * revolutions
        return configurations
