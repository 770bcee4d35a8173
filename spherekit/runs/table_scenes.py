"""Scenes of an analysis that defines none: the columns of its tables."""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
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
from spherekit.scenes.scene import Primitive, Range, Scene, Series
from spherekit.status import Status
from spherekit.tables.table import (
    ASSEMBLY_MODE,
    INPUTS,
    SAMPLE,
    TIME,
    Column,
    Table,
    TableArrays,
    Tables,
    arrays,
)
from spherekit.velocities.pole_field import PoleField, axis_pairs
from spherekit.wording import listing

Fields = Sequence[PoleField | LazyField]
"""The poles of a motion, for each input that moves."""


Angles = Mapping[str, Floats]
"""Variables that go on from sample to sample, by pair."""


Values = TypeVar("Values", bound=Array)


Made = TypeVar("Made")


@dataclass(frozen=True)
class Batch:
    """Read-only view of a block of samples of all modes, limited to declared needs.

    Its arrays cannot be written to; copy one to change it. Rows run mode after mode, in
    each the samples in order; failed rows hold NaN. `plans` has one plan for each input,
    which moves alone with the others locked; where a method takes `moved`, it is the
    position of that input, the first by default.
    `timed` says that the samples are times, by a law or from a start; without it an
    input that turns at 1 rad/s gives them their time.

    What goes on from sample to sample, signs of directions and `continued_value`, does so
    from block to block too.
    """

    mechanism: Mechanism
    plans: tuple[Plan, ...]
    needs: Needs
    _motion: Motion
    _fields: Fields = field(repr=False)
    _angles: Angles = field(default_factory=dict, repr=False)
    timed: bool = False
    _tracer: PositionAnalysis | None = field(default=None, repr=False)
    _of_run: list[Floats] | None = field(default=None, repr=False)
    _made: dict[Hashable, Any] = field(default_factory=dict, repr=False)

    def __len__(self) -> int:
        return len(self._motion)

    @property
    def sample(self) -> Integers:
        """(n,) sample numbers."""
        return _sealed(self._motion.sample)

    @property
    def moving_inputs(self) -> Names:
        """Names of the driven pairs, in the order that `moved` counts."""
        return self.mechanism.input_pairs

    @property
    def assembly_mode(self) -> Integers:
        """(n,) assembly mode numbers."""
        return _sealed(self._motion.assembly_mode)

    @property
    def q(self) -> Floats:
        """(n,) variable of the driven pair, rad; `SolveError` with several inputs."""
        return _sealed(self._motion.q)

    @property
    def inputs(self) -> Floats:
        """(n, inputs) variables of the driven pairs, rad."""
        return _sealed(self._motion.inputs)

    @property
    def t(self) -> Floats:
        """(n,) time, s."""
        return _sealed(self._timing.t)

    @property
    def dq(self) -> Floats:
        """(n,) rate of the driven pair, rad/s; `SolveError` with several inputs."""
        return _sealed(self._single(self._timing.dq))

    @property
    def ddq(self) -> Floats:
        """(n,) its acceleration, rad/s2; `SolveError` with several inputs."""
        return _sealed(self._single(self._timing.ddq))

    @property
    def input_rates(self) -> Floats:
        """(n, inputs) rates of the driven pairs, rad/s."""
        return _sealed(self._timing.dq)

    @property
    def input_accelerations(self) -> Floats:
        """(n, inputs) accelerations of the driven pairs, rad/s2."""
        return _sealed(self._timing.ddq)

    @property
    def q_range(self) -> Range:
        """Least and greatest q of the whole run, rad; `SolveError` with several inputs."""
        return self._range(0)

    @property
    def dq_range(self) -> Range:
        """Least and greatest dq of the whole run, rad/s; `SolveError` likewise."""
        self._check("time", "time")
        return self._range(1)

    @property
    def residual(self) -> Floats:
        """(n,) closure residual, rad."""
        return _sealed(self._motion.residual)

    @property
    def closure_conditioning(self) -> Floats:
        """(n,) condition of the closure Jacobian without the inputs, in the 2-norm."""
        return _sealed(self._motion.conditioning)

    @property
    def status(self) -> SmallIntegers:
        """(n,) codes of `spherekit.status.Status`."""
        return _sealed(run_status(self._motion, self._fields))

    @property
    def tracer(self) -> PositionAnalysis:
        """The tracer of the run: its solver, its modes, all configuration curves."""
        self._check("the tracer", "tracer")
        assert self._tracer is not None
        return self._tracer

    @property
    def motion(self) -> Motion:
        """The configurations of all rows, for an analysis that asks the tracer for more."""
        self._check("the motion", "tracer")
        return self._motion

    def once(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """Return what `make` gives, called once for this batch and analysis."""
        if key not in self._made:
            self._made[key] = make()
        made: Made = self._made[key]
        return made

    @staticmethod
    def interleaved(parts: Sequence[Array | NDArray[np.str_]]) -> Interleaved:
        """Return a column with a row for each of several subjects at every row.

        `parts` (n,) are those of one subject each; they are not copied.
        """
        return Interleaved(parts)

    def of_poles(
        self, poles: Sequence[tuple[int, int, int]]
    ) -> Callable[[str, int | None], Interleaved]:
        """Return what gives columns for a table, with a row for each pole at every row.

        `poles` are two links and the position of the input that moves. What is returned is
        called with the name of a method that takes these, such as ``"direction"``, and of
        vectors a component, else None. What it gives may be left to be made when the table
        is read, so a run of many samples that only hands columns on takes less time.
        """

        def column(quantity: str, component: int | None) -> Interleaved:
            if quantity not in _QUANTITIES:
                raise AnalysisError(
                    f"a column of {quantity!r} was asked for; give one of "
                    f"{listing(_QUANTITIES)}"
                )
            name = _QUANTITIES[quantity]
            parts: list[Array | LazyColumn] = []
            for i, j, moved in poles:
                here = self._found(moved)
                if isinstance(here, LazyField) and name not in here.KNOWN:
                    self._declared(i, j, quantity)
                    parts.append(here.column(name, pole_of(i, j), component or 0))
                else:
                    made = np.asarray(getattr(self, quantity)(i, j, moved))
                    parts.append(made if component is None else made[:, component])
            return Interleaved(parts)

        return column

    def pole_columns(self, poles: Sequence[tuple[int, int, int]]) -> dict[str, Interleaved]:
        """Return columns of a table with a row for each pole at every row, see `of_poles`.

        Which sample, mode, links and moving input; axis, coefficients, residual, status.
        """
        of = self.of_poles(poles)
        links = self.mechanism.links
        pairs = self.moving_inputs
        words = {
            "link": [links[j] for _, j, _ in poles],
            "relative_to": [links[i] for i, *_ in poles],
            "moving": [pairs[moved] for *_, moved in poles],
        }
        return {
            **{
                name: Interleaved([getattr(self, name)] * len(poles))
                for name in ("sample", "assembly_mode", "residual")
            },
            **{
                name: Interleaved([np.broadcast_to(np.array(x), len(self)) for x in texts])
                for name, texts in words.items()
            },
            **{f"u{axis}": of("direction", k) for k, axis in enumerate("xyz")},
            "velocity_coefficient": of("velocity_coefficient", None),
            "acceleration_coefficient": of("acceleration_coefficient", None),
            "status": of("pole_status", None),
        }

    def assembly_mode_rows(self) -> Mapping[int, slice]:
        """Return the rows of each assembly mode, by its number."""
        k = self._motion.samples
        return {
            item.number: slice(n * k, (n + 1) * k)
            for n, item in enumerate(self._motion.assembly_modes)
        }

    def direction(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return the pole axis of two links: unit vectors (n, 3) in ground axes."""
        return self._pole(i, j, "direction", moved)

    def has_continuous_sign(self, i: int, j: int, moved: int = 0) -> bool:
        """Return whether the direction of two links' pole is continuous over the rows.

        That of a pair's axis always is, and others are along a path of samples. Over a
        grid of several inputs others point to one side, so that the direction and the
        coefficients may change their signs between neighbours.
        """
        plan = self.plans[moved]
        return self._motion.is_path or plan.pole(i, j) in {None, *axis_pairs(plan)}

    def conditioning(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return (n,) how far the links' angular velocities are from cancelling.

        ``|w_j - w_i|`` over ``|w_i| + |w_j|``; 1 for the axis of a pair.
        """
        return self._pole(i, j, "conditioning", moved)

    def error_bound(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return (n,) a bound of the error of the pole's direction, rad.

        Of rounding, and of what the configuration is off by.
        """
        return self._pole(i, j, "error_bound", moved)

    def pole_status(self, i: int, j: int, moved: int = 0) -> SmallIntegers:
        """Return (n,) status codes, with NO_POLE or ILL_CONDITIONED for this pole alone."""
        return self._pole(i, j, "pole_status", moved)

    def velocity_coefficient(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return (n,) the coefficient of link max(i, j) relative to the other."""
        return self._pole(i, j, "velocity_coefficient", moved)

    def acceleration_coefficient(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return (n,) the derivative of the coefficient by the input, 1/rad."""
        return self._pole(i, j, "acceleration_coefficient", moved)

    def direction_dq(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return (n, 3) the derivative of the pole axis by the input, 1/rad.

        NaN where the velocity coefficient is too small to know it.
        """
        return self._pole(i, j, "direction_dq", moved)

    def velocity_coefficient_error_bound(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return (n,) a bound of the error of `velocity_coefficient`."""
        return self._pole(i, j, "velocity_coefficient_error_bound", moved)

    def acceleration_coefficient_error_bound(
        self, i: int, j: int, moved: int = 0
    ) -> Floats:
        """Return (n,) a bound of the error of `acceleration_coefficient`, 1/rad."""
        return self._pole(i, j, "acceleration_coefficient_error_bound", moved)

    def direction_dq_error_bound(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return (n,) a bound of the error of `direction_dq`, 1/rad.

        It bounds the length of the error vector; NaN where `direction_dq` is.
        """
        return self._pole(i, j, "direction_dq_error_bound", moved)

    def rates_loss(self, moved: int = 0) -> Floats:
        """Return (n,) the part of the angular velocities or their derivatives in doubt.

        Of the largest of all links, or of 1, where that is smaller; 0 below about 1e-10.
        """
        return _sealed(self._found(moved).loss)

    def planes(self, i: int, j: int, moved: int = 0) -> Floats:
        """Return (n, 2, 3) unit normals of the great circles that gave the pole."""
        return self._pole(i, j, "planes", moved)

    def pair_value(self, name: str) -> Floats:
        """Return (n,) the variable of a pair, rad in (-pi, pi]."""
        self._check("pair_value", "pair_values", name)
        (number,) = self.mechanism.variables_of(self.mechanism.pair_number[name])
        return _sealed(self._motion.values[:, number])

    def continued_value(self, name: str) -> Floats:
        """Return (n,) the variable of a pair, rad, as it goes on over all turns.

        That of a driven pair is the input as it was given; of the others the first sample
        of each assembly mode is in (-pi, pi], and no angle moves by half a turn or more
        from one sample to the next.
        """
        self._check("continued_value", "continued_values", name)
        return _sealed(self._angles[name])

    def rotation(self, link: str) -> Floats:
        """Return (n, 3, 3) from link axes to ground axes."""
        self._check("rotation", "rotations", link)
        return _sealed(self._motion.rotations[:, self.mechanism.link_number[link]])

    def angular_velocity(self, link: str, moved: int = 0) -> Floats:
        """Return (n, 3) of a link relative to the ground per unit rate of the input.

        In ground axes.
        """
        return self._link_rate(link, self._found(moved).w)

    def angular_velocity_dq(self, link: str, moved: int = 0) -> Floats:
        """Return (n, 3) the derivative of the angular velocity by the input, 1/rad."""
        self._check("angular_velocity_dq", "derivatives")
        return self._link_rate(link, self._found(moved).dw)

    def pair_rate(self, name: str, moved: int = 0) -> Floats:
        """Return (n,) the rate of a pair's variable per unit rate of the input."""
        self._check("pair_rate", "pair_rates", name)
        pair = self.mechanism.pair_number[name]
        (number,) = self.mechanism.variables_of(pair)
        first, second = self.mechanism.ends[pair]
        vector = self._motion.vectors[:, number]
        w = self._found(moved).w
        along = np.sum((w[second] - w[first]) * vector, axis=1)
        return along / np.vecdot(vector, vector)

    def _check(self, read: str, need: str, name: str | None = None) -> None:
        """Refuse what was not declared: a need, or a name in it."""
        declared = getattr(self.needs, need)
        if name is None and not declared:
            raise UndeclaredNeed(f"{read} was read; declare Needs({need}=True)")
        if name is not None and name not in declared:
            raise UndeclaredNeed(
                f'{read}("{name}") was read; declare it in Needs({need}=...)'
            )

    def _link_rate(self, link: str, values: Mapping[int, Floats]) -> Floats:
        self._check("angular_velocity", "link_rates", link)
        return _sealed(values[self.mechanism.link_number[link]])

    @property
    def _timing(self) -> Timing:
        self._check("time", "time")
        assert self._motion.timing is not None
        return self._motion.timing

    def _range(self, quantity: int) -> Range:
        """Return the extents of the run, or of the batch if there is no run."""
        whole = self._of_run or input_extents(self._motion.inputs, self._motion.timing)
        low, high = self._single(whole[quantity])
        return float(low), float(high)

    def _single(self, columns: Floats) -> Floats:
        if columns.shape[1] != 1:
            raise SolveError(
                f"{self.mechanism.name} has {columns.shape[1]} inputs; read input_rates "
                "or input_accelerations"
            )
        return columns[:, 0]

    def _found(self, moved: int) -> PoleField | LazyField:
        if not self._fields:
            raise UndeclaredNeed("a pole was read; declare it in needs()")
        return self._fields[moved]

    def _pole(self, i: int, j: int, quantity: str, moved: int) -> Array:
        self._declared(i, j, quantity)
        part = _QUANTITIES.get(quantity, quantity)
        values: Mapping[Pole, Array] = getattr(self._found(moved), part)
        return _sealed(values[pole_of(i, j)])

    def _declared(self, i: int, j: int, quantity: str) -> None:
        """Raise `UndeclaredNeed` if a quantity of a pole was not said to be read."""
        pole = pole_of(i, j)
        needs = self.needs
        if quantity.startswith("acceleration"):
            self._check(quantity, "derivatives")
        # Every column of every pole is asked about, so no union of these sets is formed.
        declared = [needs.directions, needs.rates, needs.planes]
        said = "directions=..."
        if quantity == "planes":
            declared = [needs.planes]
            said = "planes=..."
        elif quantity.startswith("direction_dq"):
            declared = [needs.turns] if needs.derivatives else []
            said = "turns=..., derivatives=True"
        elif "coefficient" in quantity:
            declared = [needs.rates]
            said = "rates=..."
        if not any(pole in poles for poles in declared):
            low, high = (self.mechanism.links[link] for link in pole)
            raise UndeclaredNeed(
                f"{quantity} of the pole of links {high} and {low} was read; declare it in "
                f"Needs({said})"
            )


_QUANTITIES: Mapping[str, str] = {
    "direction": "direction",
    "direction_dq": "direction_dq",
    "velocity_coefficient": "velocity_coefficient",
    "acceleration_coefficient": "acceleration_coefficient",
    "conditioning": "angle",
    "error_bound": "error",
    "velocity_coefficient_error_bound": "velocity_coefficient_error",
    "acceleration_coefficient_error_bound": "acceleration_coefficient_error",
    "direction_dq_error_bound": "direction_dq_error",
    "pole_status": "pole_status",
}
"""What `PoleField` calls them."""


def _sealed(values: Values) -> Values:
    """Return a view of an array that nobody can write to."""
    seen = values.view()
    seen.flags.writeable = False
    return seen


def run_status(motion: Motion, fields: Fields) -> SmallIntegers:
    """Return (n,) status codes of a motion, or of the first input that says more."""
    status = motion.status
    for pole_field in fields:
        if pole_field.status is not motion.status:
            status = np.where(status == Status.OK, pole_field.status, status)
    return status


MOST_SUBJECTS = 60
"""A table with more rows at a sample is not drawn."""


def table_scenes(tables: Sequence[Table], data: Tables, batch: Batch) -> list[Scene]:
    """Return the numbers of tables with rows at the samples, over these, by mode.

    Rows that belong to one sample are told apart by what their columns of text say.
    """
    scenes = []
    for mode, rows in batch.assembly_mode_rows().items():
        parts = tuple(
            part
            for table in tables
            if table.in_assembly_modes
            for part in _parts(table, arrays(data[table.name]), mode, batch.sample[rows])
        )
        if parts:
            scenes.append(Scene(mode, parts))
    return scenes


def _parts(
    table: Table, data: TableArrays, mode: int, samples: Integers
) -> Iterator[Primitive]:
    """Yield the columns of one mode, of each subject that has a row at every sample."""
    here = np.flatnonzero(data[ASSEMBLY_MODE.name] == mode)
    words = (data[c.name][here] for c in table.columns if c.kind == "text")
    named = zip(np.full(len(here), ""), *words, strict=True)
    subjects = np.array([", ".join(filter(None, words)) for words in named], dtype=str)
    names = dict.fromkeys(subjects.tolist())
    for subject in names if len(names) <= MOST_SUBJECTS else ():
        chosen = here[subjects == subject]
        if not np.array_equal(data[SAMPLE.name][chosen], samples):
            continue
        for column in filter(_shown, table.columns):
            yield Series(
                f"tables/{table.name}/{column.name}/{subject}",
                subject or column.name,
                column.meaning,
                data[column.name][chosen],
                column.unit,
            )


def _shown(column: Column) -> bool:
    """Return whether a column is a result, and not an input, the time or an error."""
    return (
        column.kind == "number"
        and column.scale != "none"
        and column != TIME
        and not column.meaning.startswith(INPUTS.meaning)
    )
