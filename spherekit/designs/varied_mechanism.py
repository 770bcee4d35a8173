"""A mechanism in which numbers of its file vary: the sizes that kernels need of a design.

Kernels are functions that evaluate many designs at once. They take arcs, angles and axes of
R pairs directly. Numbers of masses and loads, and of contacts of circles, are computed from
the file of each design, with the checks of the file.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import Names
from spherekit.designs.design_kernel import DesignKernel
from spherekit.designs.design_variables import (
    ACTIONS,
    OK,
    POINTED,
    DesignVariable,
    differentiate_by_variable,
    make_design,
    reason_of,
)
from spherekit.designs.profile_numbers import DesignProfiles, has_shaped_profiles
from spherekit.errors import DesignError, SpherekitError
from spherekit.files.mechanism_reader import replace_actions
from spherekit.files.number_change import with_numbers
from spherekit.files.schema import check_numbers
from spherekit.files.toml_document import Document
from spherekit.geometry.vectors import all_finite, nans
from spherekit.mechanism.coaxial_links import SAME_AXIS_RAD
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap
from spherekit.symbolic.expression_graph import symbols
from spherekit.symbolic.frame_expressions import direction_from_angles
from spherekit.symbolic.vector_algebra import Exprs
from spherekit.velocities.axis_rotations import pair_rotations
from spherekit.velocities.design_expressions import DesignExpressions
from spherekit.velocities.equivalent_linkage import (
    EquivalentLinkage,
    find_equivalent_linkage,
)
from spherekit.velocities.load_numbers import (
    list_numbers,
    masses_and_loads,
    replace_numbers,
)

RADIANS_PER_DEGREE = np.pi / 180.0
"""One degree in rad: the unit of the angles of files in degrees."""

OTHER_FORM = "its loads or contacts have another form"
"""Reason of a design that the kernel does not cover; it is then analysed on its own."""

TRIAL_DEVIATIONS = (0.0173, -0.0311)
"""Changes of variables that show which numbers of a file depend on the variables.

Each variable x is replaced by x (1 + change) + change, in the unit of the file. The
digits have no meaning.
"""

TRIAL_FACTORS = (1.0, 1e-2, 1e-4)
"""Factors of `TRIAL_DEVIATIONS` in the order of the trials, if larger trials fail.

The smallest factor gives trials within the reach of the shortest difference quotients. With
larger factors only, some designs that are possible are missed. With smaller factors, the
derivatives at a trial differ from those in the file by little more than rounding.
"""

RELATIVE_DIFFERENCE_STEPS = np.array([1e-2, 1e-4, 1e-6])
"""Steps of difference quotients, relative to a variable, in the order of the trials.

A shorter step is used if the file does not allow the numbers of a longer one.
"""

SAME_NUMBER = 1e-14
"""Numbers (rad, SI) of files that differ by at most this count as equal."""

MAX_DIFFERENCE_RAD = 1.0
"""Largest change of an angle of a contact within a difference quotient.

The Euler angles of a rotation jump where its second angle is zero. Larger: quotients across
such a jump are accepted. Smaller: shorter steps are used, with fewer digits.
"""

CONSTANT_SLOPE_TOLERANCE = 1e-10
"""Largest relative difference of derivatives that count as the same at all designs.

Larger: a derivative that varies slightly counts as constant. Smaller: rounding errors make
constant derivatives count as varying, and they are computed again for each design.
"""


class _OtherFormError(SpherekitError):
    """A design has other contacts or kinds of loads, so the kernel does not apply."""


@dataclass(frozen=True)
class ColumnGradients:
    """Quantities of a design at n samples, and their derivatives by the design variables.

    Attributes
    ----------
    closes
        (n,) whether the mechanism can be assembled at the sample. This is tested only if
        positions are computed in closed form. Otherwise positions are arguments, and all
        values are true.
    columns
        (columns, n) values of the quantities in rad and SI units.
    gradients
        (variables, columns, n) derivatives with respect to the design variables, each
        variable in the unit of the mechanism file. If a variable changes, the inputs stay
        constant, and the other pairs move so that the loops stay closed.
    """

    closes: Bools
    columns: Floats
    gradients: Floats


@dataclass(frozen=True)
class DesignPoint:
    """A design, as numbers that compiled functions of many designs take as arguments.

    Such a function is called a kernel, and its arguments that depend on the design are
    called sizes: arcs and angles, and also numbers of masses and loads.

    Attributes
    ----------
    values
        (variables,) values of the variables, in the units of the file.
    sizes
        (sizes,) the arguments of the kernel, in rad and SI units.
    slopes
        (sizes, variables) derivatives of the sizes with respect to the values.
    profiles
        The profiles of the contacts, if they are not circles.
    """

    values: Floats
    sizes: Floats
    slopes: Floats
    profiles: DesignProfiles | None

    def evaluate_gradients(
        self,
        kernel: DesignKernel,
        samples: Floats,
        position_arguments: Floats,
        pair_values: Floats,
        revolution_offsets: Floats | None = None,
    ) -> ColumnGradients:
        """Return quantities at samples, with derivatives with respect to design variables.

        A kernel is a compiled function of many designs. It returns the quantities
        (columns), and their derivatives with respect to sizes and numbers of contact
        profiles. By the chain rule, these derivatives are multiplied by the derivatives of
        the sizes and profiles with respect to the variables. The products are added.

        Parameters
        ----------
        kernel
            A kernel with the gradients of its columns (quantities).
        samples, position_arguments, revolution_offsets
            The n samples, the configurations at them and the whole revolutions of angles;
            arguments of `DesignKernel.evaluate_samples`.
        pair_values
            (n, variables of pairs) configurations (rad) at the samples, NaN if a sample has
            none. The profiles are evaluated at them. If all profiles are circles, only the
            number n of configurations is used.
        """
        profile_columns = None
        if self.profiles is not None:
            profile_columns = self.profiles.evaluate_columns(pair_values)
        outputs = kernel.evaluate_samples(
            samples,
            position_arguments,
            sizes=self.sizes[:, None],
            profile_columns=profile_columns,
            revolution_offsets=revolution_offsets,
        )
        closes = np.all(outputs[: kernel.reach_count] >= 0.0, axis=0)
        count = len(pair_values)
        if not kernel.columns:
            # Figures that depend only on sizes and inputs use no column of a configuration.
            return ColumnGradients(
                closes,
                columns=np.zeros((0, count)),
                gradients=np.zeros((len(self.values), 0, count)),
            )
        # Index 0 has the columns, then their derivatives with respect to each size and each
        # column of the profiles.
        columns_and_slopes = outputs[kernel.reach_count :].reshape(
            -1, len(kernel.columns), count
        )
        gradients = np.zeros((len(self.values), *columns_and_slopes.shape[1:]))
        for variable, slopes in enumerate(self.slopes.T):
            # Derivatives with respect to sizes may be infinite. Sizes that do not depend on
            # the variable are left out, because 0 times infinity is NaN.
            changing = np.flatnonzero(slopes)
            gradients[variable] = np.tensordot(
                slopes[changing], columns_and_slopes[1 + changing], 1
            )
        if self.profiles is not None:
            closed = all_finite(pair_values, 1)
            profile_slopes = self.profiles.differentiate_columns(pair_values[closed])
            # Indices: k variable, p column of profiles, c column of the kernel, n sample.
            gradients[:, :, closed] += np.einsum(
                "kpn,pcn->kcn",
                profile_slopes,
                columns_and_slopes[1 + len(self.sizes) :, :, closed],
            )
        return ColumnGradients(closes, columns_and_slopes[0], gradients)


@dataclass(frozen=True, eq=False)
class VariedMechanism:
    """All designs of a mechanism file, in which some numbers vary.

    A kernel is a function that evaluates many designs at once. Its *sizes* are the
    arguments that depend on the design, in this order:

    1. the variables that are angles of links, R pairs and outputs, unless contacts are
       replaced by links,
    2. numbers that are read from the file of each design and follow the variables: angles
       of replaced contacts, then numbers of masses and loads.

    Attributes
    ----------
    document
        The mechanism file.
    mechanism
        The mechanism in the file.
    variables
        The numbers that are varied.
    inputs
        Names of the driven pairs.
    equivalent_linkage
        The mechanism with links instead of contacts of circles. None if contacts are not
        replaced.
    masses_follow_sizes
        Whether the file states masses by sizes of links, so that masses change with these
        sizes.
    wheel_gap_rad
        Largest distance (rad) of wheels that still roll on each other.
    """

    document: Document
    mechanism: Mechanism
    variables: tuple[DesignVariable, ...]
    inputs: Names
    equivalent_linkage: EquivalentLinkage | None = None
    masses_follow_sizes: bool = False
    wheel_gap_rad: float = SAME_AXIS_RAD

    @cached_property
    def nominal_values(self) -> Floats:
        """(variables,) values of the variables in the file, in its units."""
        return np.array([variable.value for variable in self.variables])

    @property
    def _angle_unit(self) -> float:
        """The unit of angles in the file, in rad."""
        in_degrees = self.document.data["angle_unit"] == "deg"
        return RADIANS_PER_DEGREE if in_degrees else 1.0

    @cached_property
    def unit_scales(self) -> Floats:
        """(variables,) the unit of each variable in rad or SI units."""
        unit = self._angle_unit
        return np.array([unit if v.is_angle else 1.0 for v in self.variables])

    @cached_property
    def size_variables(self) -> list[int]:
        """Indices of the variables that are sizes of the kernel."""
        if self.equivalent_linkage is not None:
            return []
        return [k for k, v in enumerate(self.variables) if v.is_angle]

    @cached_property
    def has_shaped_profiles(self) -> bool:
        """Whether a profile is not a circle, so that kernels take columns of profiles."""
        return has_shaped_profiles(self.mechanism)

    @property
    def varies_outputs(self) -> bool:
        """Whether numbers of outputs vary."""
        return any(variable.path[0] == "outputs" for variable in self.variables)

    def make_expressions(
        self, closed_form: bool | None = None, closed: Floats | None = None
    ) -> DesignExpressions:
        """Return the quantities of the mechanism as expressions of the sizes of a design.

        The sizes depend on the kind of mechanism. If contacts are replaced by links, the
        expressions describe the equivalent linkage of R pairs. The sizes are then the
        numbers of the linkage that change with the variables (`varied_contact_numbers`). If
        contacts are not replaced, the sizes are those variables that are sizes of R pairs,
        or of directions of outputs. In both cases, varied numbers of masses and loads
        follow.

        Parameters
        ----------
        closed_form
            Whether positions are in closed form, by default if this is possible. Profiles
            that are not circles never have a closed form.
        closed
            (variables,) variables (rad) of a closed configuration at which independent
            equations are chosen if equations repeat each other. By default one is computed.
            Not used if contacts are replaced by links.

        Raises
        ------
        DesignError
            If outputs vary and contacts are replaced by links.
        EngineError
            If there are no expressions for the pairs of the mechanism.
        """
        linkage = self.equivalent_linkage
        contact_count = self._contact_number_count
        # `varied_numbers` counts the numbers of contacts first, then those of masses and
        # loads. The expressions count masses and loads from 0.
        varied_actions = [
            k - contact_count for k in self.varied_numbers if k >= contact_count
        ]
        if linkage is not None:
            if self.varies_outputs:
                raise DesignError(
                    f"{self.mechanism.name}: its contacts are replaced by equivalent "
                    "links, which is not possible while directions of outputs vary; vary "
                    "either outputs or contacts"
                )
            # The angles and ratios that describe the replaced contacts become symbols.
            name_of_number = {k: f"turned_{k}" for k in self.varied_contact_numbers}
            return DesignExpressions(
                linkage.mechanism,
                self.inputs,
                sizes=tuple(name_of_number.values()),
                make_pairs=lambda symbol_by_name: linkage.pairs(
                    {k: symbol_by_name[name] for k, name in name_of_number.items()}
                ),
                closed_form=closed_form,
                differing=varied_actions,
                pointing=self._output_directions(),
            )
        angles = {
            variable.name: variable.geometric_angle
            for variable in self.variables
            if variable.geometric_angle is not None
        }
        # Directions of outputs change no pair.
        pair_sizes = [name for name, angle in angles.items() if angle.kind != POINTED]
        has_columns = self.has_shaped_profiles
        mechanism = self.mechanism
        return DesignExpressions(
            mechanism,
            self.inputs,
            sizes=list(angles),
            make_pairs=lambda symbol_by_name: pair_rotations(
                mechanism,
                {angles[name]: symbol_by_name[name] for name in pair_sizes},
                as_columns=has_columns,
            ),
            closed_form=False if has_columns else closed_form,
            differing=varied_actions,
            closed=closed,
            pointing=self._output_directions(),
        )

    def _output_directions(self) -> dict[str, str | Exprs]:
        """Return the directions of outputs that may differ between designs, by output.

        A design is one choice of the numbers that vary. An output is a direction fixed in a
        link. Formulas for many designs use the result in place of the directions in the
        file. Two kinds of outputs may differ:

        - An output along the axis of a pair (joint). Its direction follows from the sizes
          of the link, which may vary. Its item in the result is the name of the pair.
        - An output with a longitude or latitude that varies. Its item in the result is a
          unit vector (3,) in link axes, as an expression of the design variables.
        """
        directions: dict[str, str | Exprs] = {}
        directions |= self._outputs_along_axes()
        directions |= self._outputs_with_varied_angles()
        return directions

    @property
    def _outputs(self) -> Mapping[str, Any]:
        """The outputs in the file, by name."""
        return self.document.data.get("outputs", {})

    def _outputs_along_axes(self) -> dict[str, str]:
        """Return the pair of each output that points along the axis of a pair."""
        return {
            name: output["axis"]
            for name, output in self._outputs.items()
            if "axis" in output
        }

    def _outputs_with_varied_angles(self) -> dict[str, Exprs]:
        """Return the direction of each output for which longitude or latitude varies.

        An output is a direction fixed in a link. The result is a unit vector in link axes,
        as a symbolic expression. An angle that varies is a symbol, and an angle that does
        not vary is a number.
        """
        # Longitude and latitude (rad) by output.
        angles_by_output: dict[str, list[Any]] = {}
        for variable in self.variables:
            # `POINTED` angles are longitudes and latitudes of directions of outputs.
            varied_angle = variable.geometric_angle
            if varied_angle is None or varied_angle.kind != POINTED:
                continue
            # The index is 0 for the longitude, 1 for the latitude.
            output, index = varied_angle.owner
            if output not in angles_by_output:
                longitude, latitude = self._outputs[output]["lonlat"]
                angles_by_output[output] = [
                    self._angle_unit * float(longitude),
                    self._angle_unit * float(latitude),
                ]
            (angle_symbol,) = symbols([variable.name])
            angles_by_output[output][index] = angle_symbol
        return {
            output: direction_from_angles(longitude, latitude)
            for output, (longitude, latitude) in angles_by_output.items()
        }

    @property
    def nominal_sizes(self) -> Floats:
        """(sizes,) sizes of the kernel in the design of the file, in rad and SI units."""
        variable_sizes = (self.unit_scales * self.nominal_values)[self.size_variables]
        return np.concatenate([variable_sizes, self._nominal_numbers[self.varied_numbers]])

    def kernel_sizes(self, values: Floats) -> tuple[Floats, NDArray[np.object_]]:
        """Return the sizes of n designs in the form that kernels need.

        A kernel is a function that computes quantities of many designs (choices of numbers
        of a mechanism) at once. Some sizes are design variables themselves, such as the arc
        of a link. The others describe contacts, masses and loads. To read them, the values
        of the design are set in the mechanism file.

        Parameters
        ----------
        values
            (variables, n) values of the design variables, in the units of the file.

        Returns
        -------
        sizes
            (sizes, n) sizes in rad and SI units. The numbers that are read from a file are
            NaN if it cannot be read or the kernel does not apply to the design.
        reasons
            (n,) a text for each design:

            - `OK` if its sizes are valid,
            - `OTHER_FORM` if the kernel does not apply, because the design has other loads
              or contacts. The caller can analyse it without a kernel.
            - otherwise a message that says why the design is impossible.
        """
        design_count = values.shape[1]
        numbers = nans((len(self.varied_numbers), design_count))
        reasons = np.full(design_count, OK, dtype=object)
        # If neither masses nor loads nor contacts vary, there is no number to read.
        if self._reads_files:
            for k, design in enumerate(values.T):
                try:
                    numbers[:, k] = self._read_varied_numbers(design)
                except _OtherFormError:
                    reasons[k] = OTHER_FORM
                except SpherekitError as problem:
                    reasons[k] = reason_of(problem)
        scaled_values = values * self.unit_scales[:, None]  # in rad and SI units
        # The design variables that are sizes themselves.
        variable_sizes = scaled_values[self.size_variables]
        return np.concatenate([variable_sizes, numbers]), reasons

    def evaluate_design(
        self, values: Floats, mechanism: Mechanism | None = None
    ) -> DesignPoint | None:
        """Return the sizes of a design and their derivatives, as kernels need them.

        A kernel is a function that computes quantities of many designs (choices of numbers
        of a mechanism) at once. Its arguments are called sizes. Some are design variables
        themselves. The others describe contacts, masses and loads, and are functions of the
        variables.

        Parameters
        ----------
        values
            (variables,) values of the design variables, in the units of the file.
        mechanism
            The mechanism of the design, if the caller has it; only needed for contact
            curves that are not circles.

        Returns
        -------
        The design, with its contact profiles if they are not circles. None if the design is
        impossible.
        """
        sizes, reasons = self.kernel_sizes(values[:, None])
        if reasons[0] != OK:
            return None
        # (sizes, variables) derivatives of the sizes with respect to the variables.
        slopes = np.concatenate(
            [self._variable_size_slopes(), self._differentiate_all_numbers(values)]
        )
        profiles = None
        if self.has_shaped_profiles:
            try:
                profiles = DesignProfiles(self.document, self.variables, values, mechanism)
            except SpherekitError:
                return None
        return DesignPoint(values, sizes[:, 0], slopes, profiles)

    def _variable_size_slopes(self) -> Floats:
        """Return the factors from the units of the file to rad and SI units, as a matrix.

        The arguments of the compiled functions are called sizes. Some sizes are design
        variables, converted from the units of the file. Each row of the matrix has the
        derivatives of one of these sizes with respect to all variables.

        Returns
        -------
        (variable sizes, variables) derivatives. A variable changes only its own size, so
        all other elements of the matrix are zero.
        """
        slopes = np.zeros((len(self.size_variables), len(self.variables)))
        for size, variable in enumerate(self.size_variables):
            slopes[size, variable] = self.unit_scales[variable]
        return slopes

    def _differentiate_all_numbers(self, values: Floats) -> Floats:
        """Return derivatives of contacts, masses and loads for all design variables.

        Contacts, masses and loads are described by numbers. Numbers that are the same in
        all designs are left out. The derivatives are with respect to the design variables.

        Parameters
        ----------
        values
            (variables,) values of the design variables, in the units of the file.

        Returns
        -------
        (varied numbers, variables) derivatives in rad and SI units.
        """
        slopes_by_variable = []
        for k, constant_slopes in enumerate(self.constant_slopes):
            # Derivatives that are the same in all designs were computed before.
            if constant_slopes is not None:
                slopes_by_variable.append(constant_slopes)
            else:
                slopes_by_variable.append(self._differentiate_numbers(values, k))
        return np.stack(slopes_by_variable, axis=1)

    # Numbers that are read from the file of each design: contacts, then masses and loads.

    @property
    def _reads_whole_file(self) -> bool:
        """Whether the whole file of a design is read, and not only its masses and loads."""
        return self.masses_follow_sizes or self.equivalent_linkage is not None

    @property
    def _reads_files(self) -> bool:
        """Whether numbers are read from the file of each design."""
        return self._reads_whole_file or any(v.path[0] in ACTIONS for v in self.variables)

    @property
    def _contact_number_count(self) -> int:
        """Number of angles of replaced contacts; they come before masses and loads."""
        linkage = self.equivalent_linkage
        return 0 if linkage is None else len(linkage.numbers)

    @cached_property
    def _nominal_numbers(self) -> Floats:
        """All numbers of contacts, masses and loads in the design of the file."""
        linkage = self.equivalent_linkage
        contact_numbers = linkage.numbers if linkage else []
        return np.array([*contact_numbers, *list_numbers(masses_and_loads(self.mechanism))])

    @cached_property
    def _trials(self) -> list[tuple[Floats, Floats]]:
        """Designs near the one in the file, which show what changes with the variables.

        All variables are changed at once. Each design is listed with its values
        (variables,), and with the numbers of its contacts, masses and loads as read from
        its file. Designs that are impossible are left out.
        """
        trials = []
        for deviation in TRIAL_DEVIATIONS:
            design = self.nominal_values * (1.0 + deviation) + deviation
            numbers = self._read_numbers_if_possible(design)
            if numbers is not None:
                trials.append((design, numbers))
        return trials

    @cached_property
    def can_vary(self) -> bool:
        """Whether the file allows other values of at least one variable."""
        if self._trials:
            return True
        # Some variables are whole numbers, and some can be changed only one at a time.
        # If a variable is zero, its steps are relative to 1.
        values = self.nominal_values
        unit_steps = np.diag(np.where(values == 0.0, 1.0, values))
        steps = np.concatenate([size * unit_steps for size in (1.0, *TRIAL_DEVIATIONS)])
        return any(
            self._read_numbers_if_possible(values + step) is not None for step in steps
        )

    @cached_property
    def varied_numbers(self) -> Indices:
        """Indices of numbers of contacts, masses and loads that depend on the variables.

        A number depends on the design variables if it changes in a trial: a design in which
        all variables are changed a little (`_trials`). If all these designs are impossible,
        all numbers count as dependent.
        """
        if not self._reads_files:
            return np.zeros(0, np.intp)
        differences = [numbers != self._nominal_numbers for _, numbers in self._trials]
        if not differences:
            return np.arange(len(self._nominal_numbers))
        return np.flatnonzero(np.any(differences, axis=0))

    @property
    def varied_contact_numbers(self) -> list[int]:
        """Indices of the varied numbers that belong to contacts."""
        return [k for k in self.varied_numbers if k < self._contact_number_count]

    def _read_numbers(self, values: Floats) -> Floats:
        """Return the numbers that describe contacts, masses and loads of a design.

        The numbers are arguments of a kernel, a function that computes many designs at
        once, and are read from the mechanism file with the values of the design. The kernel
        applies only to designs with the same contacts and kinds of loads as the file.

        Circular contacts may be replaced by an equivalent linkage, which moves in the same
        way. A link between the centres of two circles replaces a sliding contact. A
        constant ratio of two pair angles replaces wheels that roll on each other. The
        angles of the links of this linkage and the ratios then describe the contacts.

        Parameters
        ----------
        values
            (variables,) values of the variables, in the units of the file.

        Returns
        -------
        (numbers,) angles (rad) and ratios of the equivalent linkage, if there is one, then
        the numbers of masses and loads in SI units.

        Raises
        ------
        _OtherFormError
            If contacts or kinds of loads differ.
        SpherekitError
            If the design is impossible.
        """
        mechanism = self._read_mechanism(values)
        actions = masses_and_loads(mechanism)
        # This raises `_OtherFormError` if other contacts slide or roll than in the file.
        contact_numbers = self._contact_numbers(mechanism)
        # Loads without their values are compared, so that only their kinds count.
        if _without_values(actions) != _without_values(masses_and_loads(self.mechanism)):
            raise _OtherFormError(OTHER_FORM)
        return np.array([*contact_numbers, *list_numbers(actions)])

    def _read_mechanism(self, values: Floats) -> Mechanism:
        """Return the mechanism of a design from the mechanism file with its values.

        The caller `_read_numbers` lists the numbers of its contacts, masses and loads. If
        the mechanism has no equivalent linkage and its masses do not follow from sizes,
        only the masses and loads are read, which is faster. The result then has the sizes
        of the original file.

        Parameters
        ----------
        values
            (variables,) values of the design variables, in the units of the file.
        """
        if self._reads_whole_file:
            return make_design(self.document, self.variables, values)
        # `ACTIONS` are the tables of masses and loads in the file. Only variables in these
        # tables are set: here masses and loads do not depend on the other ones.
        numbers_by_path = {
            variable.path: float(value)
            for variable, value in zip(self.variables, values, strict=True)
            if variable.path[0] in ACTIONS
        }
        changed_document = with_numbers(self.document, numbers_by_path)
        check_numbers(changed_document, numbers_by_path)
        return replace_actions(self.mechanism, changed_document)

    def _contact_numbers(self, mechanism: Mechanism) -> list[float]:
        """Return the numbers that describe the contacts of one design for the kernel.

        The kernel is a function that computes many designs at once. In place of a mechanism
        with contacts of circles, it may compute a linkage of R pairs (revolute joints) that
        moves in the same way. A link hinged at the centres of both circles replaces a
        sliding contact. A constant ratio of two pair angles replaces wheels that roll on
        each other. The numbers are the constant angles (rad) that describe the links of
        this linkage, and these ratios. The list is empty if the kernel uses no linkage.

        Parameters
        ----------
        mechanism
            The mechanism of one design: the mechanism of the file with other sizes.

        Raises
        ------
        _OtherFormError
            If other contacts slide or other wheels roll than in the mechanism of the file.
            The kernel does not apply to such a design.
        """
        if self.equivalent_linkage is None:
            return []
        # If a size deviates, wheels that touch in the file can have a small gap. With a gap
        # up to `wheel_gap_rad` they still count as wheels that roll on each other.
        linkage = find_equivalent_linkage(mechanism, self.inputs, self.wheel_gap_rad)
        if linkage is None:
            raise _OtherFormError(OTHER_FORM)
        # The form says which contacts slide, and which pairs (joints) are driven by the
        # inputs through wheels.
        has_same_form = linkage.form == self.equivalent_linkage.form
        if not has_same_form:
            raise _OtherFormError(OTHER_FORM)
        return linkage.numbers

    def _read_numbers_if_possible(self, values: Floats) -> Floats | None:
        """Return the numbers of a design (variables,), or None if it is impossible."""
        with suppress(SpherekitError):
            return self._read_numbers(values)
        return None

    def _read_varied_numbers(self, values: Floats) -> Floats:
        """Return those numbers of contacts, masses and loads that the variables change.

        The numbers describe one design, and are arguments of the kernel, a function that
        computes many designs at once. They are read from the mechanism file, after the
        design variables in it are set to `values`.

        Trial designs have shown which numbers the variables change (`varied_numbers`). In
        the kernel all other numbers are constants. So the kernel applies only to designs
        whose other numbers are the same as in the original file.

        Parameters
        ----------
        values
            (variables,) values of the design variables, in the units of the file.

        Raises
        ------
        _OtherFormError
            If the kernel does not apply to the design.
        SpherekitError
            If the design is impossible.
        """
        numbers = self._read_numbers(values)
        differences = numbers - self._nominal_numbers
        # The first numbers describe contacts. An angle of pi can also be read as -pi, which
        # is no difference.
        contact_count = self._contact_number_count
        differences[:contact_count] = wrap(differences[:contact_count])
        # Numbers that are constants in the kernel must not differ.
        differences = np.delete(differences, self.varied_numbers)
        if not np.all(np.abs(differences) <= SAME_NUMBER):
            raise _OtherFormError(OTHER_FORM)
        return numbers[self.varied_numbers]

    @cached_property
    def constant_slopes(self) -> list[Floats | None]:
        """For each design variable, the derivatives of numbers, if equal in all designs.

        The numbers describe contacts, masses and loads (`varied_numbers`). The item of a
        variable has the derivative (numbers,) of each number. The item is None if the
        derivatives differ between designs, and are computed for each design.
        """
        return [
            self._find_constant_slopes(k)
            if self._can_change_numbers(variable)
            else np.zeros(len(self.varied_numbers))
            for k, variable in enumerate(self.variables)
        ]

    def _can_change_numbers(self, variable: DesignVariable) -> bool:
        """Return whether a variable can change a number of a contact, mass or load.

        A variable that is a number of a mass or load changes this number. If masses follow
        from the sizes of links, sizes change the masses. If an equivalent linkage replaces
        the contacts, sizes change the angles of this linkage.
        """
        # `ACTIONS` are the tables of masses and loads in the file.
        is_mass_or_load = variable.path[0] in ACTIONS
        has_equivalent_linkage = self.equivalent_linkage is not None
        return is_mass_or_load or self.masses_follow_sizes or has_equivalent_linkage

    def _find_constant_slopes(self, k: int) -> Floats | None:
        """Return derivatives of numbers with respect to variable k, None if not constant.

        The numbers (`varied_numbers`) describe contacts, masses and loads. A design is a
        choice of values of the variables. The values in the mechanism file are the design
        of the file. In trial designs all these values are changed a little. If the
        derivatives are the same in all these designs, they are computed only once, and not
        for each design.

        Returns
        -------
        (varied numbers,) derivatives in the design of the file; None if they differ in a
        trial design, or if all trial designs are impossible.
        """
        if not self._trials:
            return None
        # The first item belongs to the design of the file.
        nominal_slopes, *trial_slopes = self.trial_slopes(k)
        # The tolerance is relative, because the numbers have different units.
        agrees = all(
            np.allclose(nominal_slopes, slopes, rtol=CONSTANT_SLOPE_TOLERANCE, atol=0.0)
            for slopes in trial_slopes
        )
        return nominal_slopes if agrees else None

    def trial_slopes(self, k: int) -> list[Floats]:
        """Return derivatives of numbers with respect to variable k, at several designs.

        The numbers describe contacts, masses and loads. The designs are the design in the
        file and some designs near it. If the derivatives (varied numbers,) are the same at
        all of these designs, they count as constant. There is only one item, that of the
        file, if all designs that are tried near it are impossible.
        """
        designs = [self.nominal_values, *self._designs_near_file]
        return [self._differentiate_numbers(design, k) for design in designs]

    @cached_property
    def _designs_near_file(self) -> list[Floats]:
        """Possible designs (variables,) near the one in the file.

        Derivatives in these designs are compared with those in the file, to find out which
        are constant. In each design all variables are changed at once. Three kinds of
        changes are tried in this order, until one gives a possible design:

        1. The changes of `_trials`.
        2. Smaller changes. The file reader refuses some larger ones: an inertia tensor with
           one component that is far too large, or coordinates of a unit vector whose length
           is not 1 within a tolerance.
        3. A change by the whole magnitude of each variable, or by 1 if it is zero.

        The list is empty if all these changes are impossible.
        """
        if self._trials:
            return [design for design, _ in self._trials]
        step_scales = np.array(
            [self._step_scale(value, k) for k, value in enumerate(self.nominal_values)]
        )
        for factor in TRIAL_FACTORS:
            designs = [
                self.nominal_values + factor * deviation * step_scales
                for deviation in TRIAL_DEVIATIONS
            ]
            possible_designs = [
                design
                for design in designs
                if self._read_numbers_if_possible(design) is not None
            ]
            if possible_designs:
                return possible_designs
        # Numbers of teeth are whole numbers, so small changes are impossible for them.
        # A positive variable is doubled.
        doubled_design = self.nominal_values + step_scales
        if self._read_numbers_if_possible(doubled_design) is not None:
            return [doubled_design]
        return []

    def _differentiate_numbers(self, values: Floats, k: int) -> Floats:
        """Return derivatives of the varied numbers with respect to a variable, at a design.

        The varied numbers describe contacts, masses and loads, and depend on the design
        variables. They are read from the mechanism file with the values of a design. So
        there is no formula for their derivatives, and difference quotients are used.

        Parameters
        ----------
        values
            (variables,) values of the design variables, in the units of the file.
        k
            Index of the variable.

        Returns
        -------
        (varied numbers,) derivatives, NaN if no difference quotient is possible because
        designs with other values are impossible, or because angles of a contact jump.
        """
        no_slopes = nans(len(self.varied_numbers))
        try:
            numbers_at_values = self._read_varied_numbers(values)
        except SpherekitError:
            return no_slopes

        def read_change(design: Floats) -> Floats:
            """Return the varied numbers of a design, less those of the design `values`."""
            change = self._read_varied_numbers(design) - numbers_at_values
            # The first numbers belong to contacts: angles and ratios of wheels. An angle
            # may jump by a whole revolution, which `wrap` removes. Changes of ratios are
            # far below pi, so `wrap` leaves them.
            contact_count = len(self.varied_contact_numbers)
            change[:contact_count] = wrap(change[:contact_count])
            # A larger change is a jump, across which an angle has no derivative. The error
            # makes this difference quotient fail.
            if np.any(np.abs(change[:contact_count]) > MAX_DIFFERENCE_RAD):
                raise _OtherFormError(OTHER_FORM)
            return change

        # The longest step is tried first. If a design that the quotient needs is impossible
        # or jumps, a shorter step is tried.
        steps = RELATIVE_DIFFERENCE_STEPS * self._step_scale(values[k], k)
        slopes = differentiate_by_variable(read_change, values, k, steps)
        return no_slopes if slopes is None else slopes

    def _step_scale(self, value: float, k: int) -> float:
        """Return the number to which steps of variable k from `value` are relative.

        It is the magnitude of the value, or 1 if the value is zero. Sizes and contact
        numbers can be zero up to rounding. Masses and loads can really be tiny.
        """
        is_action = self.variables[k].path[0] in ACTIONS
        is_zero = abs(value) <= (0.0 if is_action else SAME_NUMBER)
        return 1.0 if is_zero else abs(value)


def _without_values(actions: Any) -> Any:
    """Return masses and loads with all numbers set to zero, to compare their kinds.

    A kernel (compiled function of many designs) serves designs with other values of masses
    and loads, but not with other kinds.
    """
    return replace_numbers(actions, lambda number: 0.0)
