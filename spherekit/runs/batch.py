"""The block of samples that an analysis reads, limited to what it has declared."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Array, Floats, Integers, SmallIntegers
from spherekit.conventions import Names
from spherekit.errors import AnalysisError, SolveError, UndeclaredNeed
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.lazy_columns import Interleaved, LazyColumn
from spherekit.planning.pole_plan import Plan, Pole, pole_of
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.timing import Timing, input_extents
from spherekit.runs.kernel_columns import LazyField
from spherekit.runs.needs import Needs
from spherekit.scenes.scene import Range
from spherekit.status import Status
from spherekit.velocities.pole_field import (
    BASIC_NEEDS,
    POLE_QUANTITIES,
    PoleField,
    PoleQuantity,
    axis_pairs,
)
from spherekit.wording import listing

PoleFields = Sequence[PoleField | LazyField]
"""The poles at the rows of a motion: one field per moving input."""

ContinuedAngles = Mapping[str, Floats]
"""(n,) pair variables in rad without jumps of whole revolutions, by pair."""

ArrayT = TypeVar("ArrayT", bound=Array)
Result = TypeVar("Result")

_POLE_FIELD_NAMES: Mapping[str, str] = {
    **{quantity.name: quantity.name for quantity in POLE_QUANTITIES},
    **{
        quantity.error_column: quantity.error_name
        for quantity in POLE_QUANTITIES
        if quantity.has_error_bound
    },
    "pole_status": "pole_status",
}
"""For each name of a quantity in `Batch.of_poles`, the attribute of `PoleField` with it."""

_QUANTITY_BY_NAME: Mapping[str, PoleQuantity] = {
    name: quantity
    for quantity in POLE_QUANTITIES
    for name in (quantity.name, quantity.error_column)
}
"""The quantity of a pole that has this name, or whose error bound has it."""

_VECTOR_SIZES: Mapping[str, int] = {
    quantity.name: quantity.components
    for quantity in POLE_QUANTITIES
    if quantity.components > 1
}
"""Numbers of components of the quantities of a pole that are vectors."""


@dataclass(frozen=True)
class Batch:
    """The data of a block of samples that an analysis may read.

    An analysis may read only the quantities that it has declared as its needs. Arrays have
    n rows: all samples in the first assembly mode (way to assemble the mechanism), then all
    samples in the next mode, and so on. In failed rows, computed numbers are NaN. The
    arrays cannot be written to; copy one to change it. Signs of directions and
    `continued_value` continue from block to block.

    A method with the parameter `moved` returns a quantity while one input moves and the
    other inputs are locked. `moved` is the index of that input, by default the first.

    Attributes
    ----------
    mechanism
        The mechanism, with the inputs of the run.
    plans
        For each input, the plan by which pole axes are computed while this input moves and
        the other inputs are locked.
    needs
        What the analysis has declared. Other quantities raise `UndeclaredNeed`.
    timed
        Whether the samples are times of a time law or of a simulation. Otherwise the
        samples are values of inputs, and the times are those of a motion in which the
        fastest input moves at 1 rad/s.
    simulated
        Whether the samples are times of a simulation. Its motion follows from torques and
        loads.
    """

    mechanism: Mechanism
    plans: tuple[Plan, ...]
    needs: Needs
    _motion: Motion
    _pole_fields: PoleFields = field(repr=False)
    _angles: ContinuedAngles = field(default_factory=dict, repr=False)
    timed: bool = False
    simulated: bool = False
    # The position analysis of the run, which `tracer` gives to analyses.
    _position_analysis: PositionAnalysis | None = field(default=None, repr=False)
    # Lowest and highest inputs, and input rates, of the whole run.
    _run_extents: list[Floats] | None = field(default=None, repr=False)
    _results: dict[Hashable, Any] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self._motion)

    @property
    def sample(self) -> Integers:
        """(n,) sample numbers."""
        return _read_only(self._motion.sample)

    @property
    def moving_inputs(self) -> Names:
        """Names of the driven pairs. The parameter `moved` of methods is an index here."""
        return self.mechanism.input_pairs

    @property
    def assembly_mode(self) -> Integers:
        """(n,) assembly mode numbers."""
        return _read_only(self._motion.assembly_mode)

    @property
    def q(self) -> Floats:
        """(n,) variable of the driven pair, rad; `SolveError` with several inputs."""
        return _read_only(self._motion.q)

    @property
    def inputs(self) -> Floats:
        """(n, inputs) variables of the driven pairs, rad."""
        return _read_only(self._motion.inputs)

    @property
    def t(self) -> Floats:
        """(n,) time, s."""
        return _read_only(self._timing.t)

    @property
    def dq(self) -> Floats:
        """(n,) rate of the driven pair, rad/s; `SolveError` with several inputs."""
        return _read_only(self._single(self._timing.dq))

    @property
    def ddq(self) -> Floats:
        """(n,) acceleration of the driven pair, rad/s2.

        With several inputs it raises `SolveError`.
        """
        return _read_only(self._single(self._timing.ddq))

    @property
    def input_rates(self) -> Floats:
        """(n, inputs) rates of the driven pairs, rad/s."""
        return _read_only(self._timing.dq)

    @property
    def input_accelerations(self) -> Floats:
        """(n, inputs) accelerations of the driven pairs, rad/s2."""
        return _read_only(self._timing.ddq)

    @property
    def q_range(self) -> Range:
        """Least and greatest value of the input `q` in the whole run, rad.

        With several inputs it raises `SolveError`.
        """
        return self._range(0)

    @property
    def dq_range(self) -> Range:
        """Least and greatest rate `dq` of the input in the whole run, rad/s.

        With several inputs it raises `SolveError`.
        """
        self._check("time", "time")
        return self._range(1)

    @property
    def residual(self) -> Floats:
        """(n,) closure residual, rad."""
        return _read_only(self._motion.residual)

    @property
    def closure_conditioning(self) -> Floats:
        """(n,) condition number (2-norm) of the loop equations, linearised in each row.

        The matrix has a column for each passive variable (not an input). A large condition
        number means that the configuration is near a singularity, where the inputs hardly
        determine the passive variables.
        """
        return _read_only(self._motion.conditioning)

    @property
    def status(self) -> SmallIntegers:
        """(n,) codes of `spherekit.status.Status`."""
        return _read_only(run_status(self._motion, self._pole_fields))

    @property
    def tracer(self) -> PositionAnalysis:
        """The position analysis of the run: its solver, assembly modes and curves."""
        self._check("the tracer", "tracer")
        assert self._position_analysis is not None
        return self._position_analysis

    @property
    def motion(self) -> Motion:
        """The configurations of all rows, for analyses that compute more configurations."""
        self._check("the motion", "tracer")
        return self._motion

    def once(self, key: Hashable, make: Callable[[], Result]) -> Result:
        """Return the result of `make`, which is called once for this batch and analysis.

        `compute`, `findings` and `scene` of an analysis can share such a result.
        """
        if key not in self._results:
            self._results[key] = make()
        result: Result = self._results[key]
        return result

    @staticmethod
    def interleaved(parts: Sequence[Array | NDArray[np.str_]]) -> Interleaved:
        """Return a table column with a number for each subject in each row of the batch.

        A subject is what the table has a row for at each sample, such as a link or a pole.
        `parts` has one array (n,) for each subject, with a value for each row of the batch.
        The column has the values of all subjects at the first row, then those at the second
        row, and so on.
        """
        return Interleaved(parts)

    def of_poles(
        self, poles: Sequence[tuple[int, int, int]]
    ) -> Callable[[str, int | None], Interleaved]:
        """Return a function that makes the columns of a table of poles.

        A pole is the instantaneous axis about which one link rotates relative to another. A
        batch row is one sample in one assembly mode (way to assemble the mechanism). The
        table has one row for each pole in each batch row. The rows of all poles at the
        first batch row come first, then those at the second batch row, and so on.

        In long runs, most numbers are computed only when a column is read.

        Parameters
        ----------
        poles
            For each pole the indices of two links, and the index of the input that moves
            while the other inputs are locked.

        Returns
        -------
        A function ``(quantity, component)`` that returns a column. The quantity is one of
        `spherekit.velocities.pole_field.POLE_QUANTITIES` by name, the bound of its error,
        such as ``"velocity_coefficient_error_bound"``, or ``"pole_status"``. The component
        is the index in a vector, or None for a number.

        Raises
        ------
        AnalysisError
            In the returned function, if there is no such quantity or component.
        """

        def make_column(quantity: str, component: int | None) -> Interleaved:
            """Return the table column of a quantity of all poles.

            A pole is the axis about which one link rotates relative to another. A row of
            the batch is one sample in one assembly mode (way to assemble the mechanism).
            The column first has the values of all poles at the first row, then the values
            at the second row, and so on. Values that are not computed yet are computed when
            the column is read.

            Parameters
            ----------
            quantity
                Name of a quantity of a pole, such as "direction".
            component
                Index of the component if the quantity is a vector, otherwise None.
            """
            if quantity not in _POLE_FIELD_NAMES:
                raise AnalysisError(
                    f"found the quantity {quantity!r}, expected one of "
                    f"{listing(_POLE_FIELD_NAMES)}"
                )
            components: Sequence[int | None] = (None,)
            if quantity in _VECTOR_SIZES:
                components = range(_VECTOR_SIZES[quantity])
            if component not in components:
                raise AnalysisError(
                    f"{quantity}: found the component {component}, expected "
                    f"{' or '.join(map(str, components))}"
                )
            values_by_pole: list[Array | LazyColumn] = []
            # The links i and j of the pole, and the index of the input that moves while the
            # other inputs are locked.
            for i, j, moved in poles:
                if self._is_computed(quantity, moved):
                    values = self._pole(i, j, quantity, moved)
                    if component is not None:
                        values = values[:, component]
                    values_by_pole.append(values)
                else:
                    lazy_column = self._make_lazy_column(i, j, moved, quantity, component)
                    values_by_pole.append(lazy_column)
            return Interleaved(values_by_pole)

        return make_column

    def _is_computed(self, quantity: str, moved: int) -> bool:
        """Return whether a quantity of the poles has been computed already.

        A pole is the axis of the relative rotation of two links. In long runs, most
        quantities are computed when they are read. `moved` is the index of the input that
        moves while the other inputs are locked.
        """
        pole_field = self._pole_field(moved)
        if not isinstance(pole_field, LazyField):
            return True
        # A lazy field has computed only these attributes before they are read.
        return _POLE_FIELD_NAMES[quantity] in pole_field.IN_MEMORY

    def _make_lazy_column(
        self, i: int, j: int, moved: int, quantity: str, component: int | None
    ) -> LazyColumn | Floats:
        """Return a column (n,) of a quantity of a pole that is computed when it is read.

        A pole is the axis of the relative rotation of two links. A column has one number
        for each of the n rows (samples in all assembly modes). If no compiled function
        computes the quantity, the result is an array that is computed at once.

        Parameters
        ----------
        i, j
            Indices of the two links of the pole.
        moved
            Index of the input that moves while the other inputs are locked.
        quantity
            Name of a quantity that is not computed yet, such as "direction".
        component
            Index of the component if the quantity is a vector, otherwise None.
        """
        self._check_pole(i, j, quantity)
        pole_field = self._pole_field(moved)
        assert isinstance(pole_field, LazyField)
        # A scalar quantity is stored as component 0.
        component_index = 0 if component is None else component
        return pole_field.column(
            _POLE_FIELD_NAMES[quantity], pole_of(i, j), component_index
        )

    def pole_columns(self, poles: Sequence[tuple[int, int, int]]) -> dict[str, Interleaved]:
        """Return the columns of a pole table, with one row per pole and batch row.

        A pole is the instantaneous axis about which one link rotates relative to another. A
        batch row is one sample in one assembly mode (way to assemble the mechanism). The
        table has the rows of all poles at the first batch row, then the rows of all poles
        at the second, and so on.

        Parameters
        ----------
        poles
            For each pole the indices of two links, and the index of the input that moves
            while the other inputs are locked. The motion of the link with the larger index
            is stated relative to the other link.

        Returns
        -------
        The columns by name: sample, assembly mode and closure residual of the batch row,
        names of the links and of the moving input, unit vector of the axis, velocity
        coefficient (angular velocity per unit rate of the input), acceleration coefficient
        (its derivative with respect to the input), and status.
        """
        columns: dict[str, Interleaved] = {}
        # These columns have equal numbers for all poles of a batch row.
        for name in ("sample", "assembly_mode", "residual"):
            columns[name] = Interleaved([getattr(self, name)] * len(poles))

        # These columns have equal texts in all batch rows of a pole.
        links = self.mechanism.links
        texts_by_column = {
            "link": [links[max(i, j)] for i, j, _ in poles],
            "relative_to": [links[min(i, j)] for i, j, _ in poles],
            "moving": [self.moving_inputs[moved] for _, _, moved in poles],
        }
        for name, texts in texts_by_column.items():
            columns[name] = Interleaved(
                [np.broadcast_to(np.array(text), len(self)) for text in texts]
            )

        make_column = self.of_poles(poles)
        for component, axis in enumerate("xyz"):
            columns[f"u{axis}"] = make_column("direction", component)
        columns["velocity_coefficient"] = make_column("velocity_coefficient", None)
        columns["acceleration_coefficient"] = make_column("acceleration_coefficient", None)
        columns["status"] = make_column("pole_status", None)
        return columns

    def assembly_mode_rows(self) -> Mapping[int, slice]:
        """Return the rows of each assembly mode, keyed by the index of the mode."""
        # The rows of the n-th mode follow the rows of the earlier modes. Each mode has k
        # rows.
        k = self._motion.samples
        return {
            item.number: slice(n * k, (n + 1) * k)
            for n, item in enumerate(self._motion.assembly_modes)
        }

    def direction(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return the pole axis of two links: unit vectors (n, 3) in ground axes."""
        return self._pole(i, j, "direction", moved)

    def has_continuous_sign(self, i: int, j: int, moved: int = 0) -> bool:
        """Return whether the direction of a pole is continuous over the rows.

        The pole is the axis of the relative rotation of the links i and j. The direction is
        always continuous if the pole is the axis of a pair. Other poles have continuous
        directions along a path of samples. Over a grid of several inputs, other directions
        can reverse between neighbouring samples.
        """
        plan = self.plans[moved]
        return self._motion.is_path or plan.pole(i, j) in {None, *axis_pairs(plan)}

    def conditioning(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return the ratio (n,) ``|w_j - w_i| / (|w_i| + |w_j|)`` of angular velocities.

        Here w_i and w_j are the angular velocities of the links i and j. The pole (axis of
        their relative rotation) is along w_j - w_i. If the ratio is small, digits cancel in
        this difference, so the computed pole has few correct digits. If a pair joins the
        links, the pole is the axis of the pair. It is not computed from this difference
        then, and the result is 1.
        """
        return self._pole(i, j, "conditioning", moved)

    def error_bound(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return an error bound (n,) of the direction of a pole, rad.

        The pole is the axis of the relative rotation of the links i and j. The bound
        includes rounding and the error of the configuration.
        """
        return self._pole(i, j, "error_bound", moved)

    def pole_status(self, i: int, j: int, moved: int = 0) -> SmallIntegers:
        """Return status codes (n,), with NO_POLE or ILL_CONDITIONED for this pole only."""
        return self._pole(i, j, "pole_status", moved)

    def velocity_coefficient(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return the velocity coefficient (n,) of two links.

        The coefficient is the angular velocity of the link with the larger index relative
        to the other link, per unit rate of the input. The velocity is measured along the
        pole (axis of the relative rotation).
        """
        return self._pole(i, j, "velocity_coefficient", moved)

    def acceleration_coefficient(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return the input derivative (n,) of `velocity_coefficient`, 1/rad."""
        return self._pole(i, j, "acceleration_coefficient", moved)

    def direction_dq(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return the input derivative (n, 3) of the direction of a pole, 1/rad.

        The pole is the axis of the relative rotation of the links i and j. The derivative
        is NaN in rows in which the links hardly rotate relative to each other.
        """
        return self._pole(i, j, "direction_dq", moved)

    def velocity_coefficient_error_bound(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return an error bound (n,) of `velocity_coefficient`."""
        return self._pole(i, j, "velocity_coefficient_error_bound", moved)

    def acceleration_coefficient_error_bound(
        self, i: int, j: int, moved: int = 0
    ) -> Floats:
        """Return an error bound (n,) of `acceleration_coefficient`, 1/rad."""
        return self._pole(i, j, "acceleration_coefficient_error_bound", moved)

    def direction_dq_error_bound(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return an error bound (n,) of `direction_dq`, 1/rad.

        `direction_dq` is the derivative of a pole direction with respect to the input. The
        bound limits the length of the difference from the exact derivative. The bound is
        NaN where `direction_dq` is NaN.
        """
        return self._pole(i, j, "direction_dq_error_bound", moved)

    def rates_loss(self, moved: int = 0) -> Floats:
        """Return the relative error bound (n,) of angular velocities and derivatives.

        The error is relative to the largest value of all links, or to 1 if that value is
        smaller than 1. Rows that are computed with double precision and pass all checks
        have a bound of at most about 1e-8. It is not computed, and 0 is returned for them.
        """
        return _read_only(self._pole_field(moved).relative_error_bound)

    def planes(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return unit normals (n, 2, 3) of the two great circles that meet in the pole."""
        return self._pole(i, j, "planes", moved)

    def pair_value(self, name: str) -> Floats:
        """Return the variable (n,) of a pair, rad, passive angles in (-pi, pi]."""
        self._check("pair_value", "pair_values", name)
        (number,) = self.mechanism.variables_of(self.mechanism.pair_number[name])
        return _read_only(self._motion.values[:, number])

    def continued_value(self, name: str) -> Floats:
        """Return the variable (n,) of a pair without jumps of whole revolutions, rad.

        The variable of a driven pair is the input itself. Revolutions of passive angles are
        counted from the inputs of the reference pose. Without a reference pose, they are
        counted from inputs of zero. At these inputs, passive angles are in (-pi, pi].
        Angles that cannot be followed from there are NaN.
        """
        self._check("continued_value", "continued_values", name)
        return _read_only(self._angles[name])

    def rotation(self, link: str) -> Floats:
        """Return rotation matrices (n, 3, 3) from link axes to ground axes."""
        self._check("rotation", "rotations", link)
        return _read_only(self._motion.rotations[:, self.mechanism.link_number[link]])

    def angular_velocity(self, link: str, moved: int = 0) -> Floats:
        """Return the angular velocity (n, 3) of a link per unit input rate, in ground axes.

        The angular velocity is relative to the ground. The input is that with the index
        `moved`.
        """
        self._check("angular_velocity", "link_rates", link)
        w = self._pole_field(moved).w
        return _read_only(w[self.mechanism.link_number[link]])

    def angular_velocity_dq(self, link: str, moved: int = 0) -> Floats:
        """Return the input derivative (n, 3) of the angular velocity of a link, 1/rad."""
        self._check("angular_velocity_dq", "link_rates", link)
        self._check("angular_velocity_dq", "derivatives")
        dw = self._pole_field(moved).dw
        return _read_only(dw[self.mechanism.link_number[link]])

    def pair_rate(self, name: str, moved: int = 0) -> Floats:
        """Return the rate (n,) of a pair's variable per unit rate of the input.

        A pair (joint) such as an R pair has one variable, its angle. Each of the n rows is
        one sample in one assembly mode.

        Parameters
        ----------
        name
            Name of a pair with one variable.
        moved
            Index of the input that moves while the other inputs are locked.

        Raises
        ------
        UndeclaredNeed
            If the analysis has not declared the pair in `Needs.pair_rates`.
        """
        self._check("pair_rate", need="pair_rates", name=name)
        pair = self.mechanism.pair_number[name]
        # Pairs with several variables cannot be declared in `Needs.pair_rates`.
        (variable,) = self.mechanism.variables_of(pair)
        first, second = self.mechanism.ends[pair]
        # (n, 3) relative angular velocity of the two links per unit rate of the variable.
        axis = self._motion.vectors[:, variable]
        # `w` has the angular velocity (n, 3) of each link per unit rate of the input.
        # w[second] - w[first] is the axis times the rate that is sought.
        w = self._pole_field(moved).w
        along_axis = np.sum((w[second] - w[first]) * axis, axis=1)
        return _read_only(along_axis / np.vecdot(axis, axis))

    def _check(self, quantity: str, need: str, name: str | None = None) -> None:
        """Raise `UndeclaredNeed` if an analysis reads a quantity that it has not declared.

        An analysis declares in its `Needs` which quantities it reads, because a run
        computes only declared quantities.

        Parameters
        ----------
        quantity
            Name of the quantity in the message.
        need
            Name of the field of `Needs` that declares the quantity. Some fields are flags.
            Others are sets of the pairs or links for which the quantity is read.
        name
            The pair or link that the set must contain. None if the field is a flag.
        """
        declared = getattr(self.needs, need)
        if name is None and not declared:
            raise UndeclaredNeed(f"{quantity} was read; declare Needs({need}=True)")
        if name is not None and name not in declared:
            raise UndeclaredNeed(
                f'{quantity}("{name}") was read; declare it in Needs({need}=...)'
            )

    @property
    def _timing(self) -> Timing:
        self._check("time", "time")
        assert self._motion.timing is not None
        return self._motion.timing

    def _range(self, quantity: int) -> Range:
        """Return the least and the greatest value of the only input, or of its rate.

        `quantity` is 0 for the input and 1 for the rate. The result covers the whole run,
        or only this batch if there is no run.
        """
        run_extents = self._run_extents or input_extents(
            self._motion.inputs, self._motion.timing
        )
        low, high = self._single(run_extents[quantity])
        return float(low), float(high)

    def _single(self, columns: Floats) -> Floats:
        """Return the values (n,) of the only input, from an array (n, inputs)."""
        if columns.shape[1] != 1:
            raise SolveError(
                f"{self.mechanism.name} has {columns.shape[1]} inputs; read inputs, "
                "input_rates or input_accelerations"
            )
        return columns[:, 0]

    def _pole_field(self, moved: int) -> PoleField | LazyField:
        if not self._pole_fields:
            raise UndeclaredNeed("a pole was read; declare it in needs()")
        return self._pole_fields[moved]

    def _pole(self, i: int, j: int, quantity: str, moved: int) -> Array:
        self._check_pole(i, j, quantity)
        attribute = _POLE_FIELD_NAMES.get(quantity, quantity)
        values: Mapping[Pole, Array] = getattr(self._pole_field(moved), attribute)
        return _read_only(values[pole_of(i, j)])

    def _check_pole(self, i: int, j: int, quantity: str) -> None:
        """Raise `UndeclaredNeed` if an analysis reads an undeclared quantity of a pole.

        A pole is the instantaneous axis of the relative rotation of two links. An analysis
        declares in its `Needs` which quantities of which poles it reads, because a run
        computes only these. `Needs` has several sets of poles. It is enough that the pole
        is in one of the sets for which the quantity is computed. For example, a direction
        is computed for poles in `directions` and for poles in `rates`.

        Parameters
        ----------
        i, j
            Indices of the links of the pole, in any order.
        quantity
            Name of the method that was called, such as ``"direction"``.
        """
        pole = pole_of(i, j)
        needs = self.needs
        # "planes" and "pole_status" are not in `_QUANTITY_BY_NAME`.
        pole_quantity = _QUANTITY_BY_NAME.get(quantity)
        if pole_quantity is not None:
            sufficient_needs = pole_quantity.sufficient_needs
        elif quantity == "planes":
            sufficient_needs = ("planes",)
        else:
            # "pole_status" is computed for each pole in any of the sets of `BASIC_NEEDS`.
            sufficient_needs = BASIC_NEEDS
        is_declared = any(pole in getattr(needs, name) for name in sufficient_needs)
        # The declaration that the message proposes.
        declaration = f"{sufficient_needs[0]}=..."
        if pole_quantity is not None and pole_quantity.is_derivative:
            is_declared = is_declared and needs.derivatives
            declaration += ", derivatives=True"
        if not is_declared:
            # The link with the larger number comes first, as in the names of poles.
            low, high = (self.mechanism.links[link] for link in pole)
            raise UndeclaredNeed(
                f"{quantity} of the pole of links {high} and {low} was read; declare it in "
                f"Needs({declaration})"
            )


def _read_only(values: ArrayT) -> ArrayT:
    """Return a view of an array that nobody can write to."""
    view = values.view()
    view.flags.writeable = False
    return view


def run_status(motion: Motion, pole_fields: PoleFields) -> SmallIntegers:
    """Return the status codes (n,) of the rows of a run.

    A row has the code of its first failure: of the position first, then of the velocities
    (`pole_fields`) while each input in turn moves and the others are locked. If nothing has
    failed, the code is OK.
    """
    status = motion.status
    for pole_field in pole_fields:
        if pole_field.status is not motion.status:
            status = np.where(status == Status.OK, pole_field.status, status)
    return status
