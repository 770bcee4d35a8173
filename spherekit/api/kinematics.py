"""A mechanism at given inputs: configurations, pole axes and coefficients by name."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Floats, Integers, SmallIntegers
from spherekit.conventions import Facts, Names
from spherekit.dynamics.configurations_at_inputs import analysis_covering, shift_into_range
from spherekit.errors import SolveError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.study import Crossings
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap
from spherekit.planning.assembly_plan import driven_at
from spherekit.planning.pole_plan import Pole, all_poles, ordered_pole, parse_pole
from spherekit.positions.motion import Motion
from spherekit.positions.motion_cache import position_analysis_of
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.runs.analysis_requests import requests_for
from spherekit.runs.batch import Batch
from spherekit.runs.needs import Needs
from spherekit.status import Status
from spherekit.tables.table import (
    ASSEMBLY_MODE,
    INPUTS,
    RESIDUAL,
    SAMPLE,
    STATUS,
    Column,
    Table,
    input_columns,
)
from spherekit.tables.table_files import to_frame
from spherekit.velocities.direction_signs import signs_by_sides
from spherekit.velocities.pole_evaluation import evaluate as evaluate_poles
from spherekit.velocities.pole_evaluation import make_certified_field
from spherekit.velocities.pole_request import MechanismKey
from spherekit.velocities.row_kernel import REFERENCES, EvaluatedRow, row_kernel
from spherekit.wording import counted, listing

TABLE = Table(
    "poles",
    "one row per sample, assembly mode, moving input and pole",
    (
        SAMPLE,
        ASSEMBLY_MODE,
        INPUTS,
        Column("link", "", "the link that moves", "text"),
        Column("relative_to", "", "the link it is seen from", "text"),
        Column("moving", "", "the input that moves, others locked", "text"),
        Column("ux", "", "pole axis, x in ground axes"),
        Column("uy", "", "pole axis, y in ground axes"),
        Column("uz", "", "pole axis, z in ground axes"),
        Column("velocity_coefficient", "", "its product with u is the angular velocity"),
        Column("acceleration_coefficient", "1/rad", "its derivative by the input"),
        Column("error_bound", "rad", "bound of the error of u", scale="none"),
        Column(
            "velocity_coefficient_error_bound",
            "",
            "bound of the error of the velocity coefficient",
            scale="none",
        ),
        Column(
            "acceleration_coefficient_error_bound",
            "1/rad",
            "bound of the error of the acceleration coefficient",
            scale="none",
        ),
        Column(
            "direction_dq_error_bound",
            "1/rad",
            "bound of the error of the derivative of u, the length of the error vector",
            scale="none",
        ),
        RESIDUAL,
        STATUS,
    ),
)


@dataclass(frozen=True)
class Kinematics:
    """A mechanism at given inputs, in rows: mode after mode, in each the inputs.

    Poles are named by two links, ``"3/1"``; coefficients are those of the link that comes
    later in the mechanism against the other, per unit rate of the input `moving` while
    the others are locked. `moving` may be left out where there is one input. The sense of
    a pole axis, and with it the sign of its coefficient, goes on along the rows of a
    assembly mode; in the first it is the side that the mechanism's axes are on. Angles are
    in rad, vectors in ground axes; rows that failed hold NaN and say why in `status`.
    The methods that end in `error_bound` say how far off numbers may be, as the columns of
    these names do in the table `poles`.

    With several inputs and groups that are no dyads, successive rows of one mode are joined
    by verified steps. After an input at which a mode has no configuration, its number may
    stand for another one. The numbers are those of a run whose samples are the same inputs,
    unless a mode has such a gap. They can differ from those at other inputs. `search`
    says how the modes were found, and whether there may be others.
    """

    mechanism: Mechanism
    poles: Names
    _read: Callable[[], Batch] = field(repr=False)
    search: str = ""

    @cached_property
    def _batch(self) -> Batch:
        return self._read()

    def __getstate__(self) -> Facts:
        return {**vars(self), "_batch": self._batch, "_read": None}

    @property
    def _motion(self) -> Motion:
        return self._batch.motion

    def __len__(self) -> int:
        return len(self._batch)

    def __repr__(self) -> str:
        modes = len(set(self.assembly_mode))
        return (
            f"<Kinematics of {self.mechanism.name}: {counted(len(self), 'row')} in "
            f"{counted(modes, 'assembly mode')}, {np.sum(self._motion.failed)} failed; "
            f"{counted(len(self.poles), 'pole')} while "
            f"{' or '.join(self.input_pairs)} moves>"
        )

    @property
    def input_pairs(self) -> Names:
        """Names of the driven pairs, in the order of the columns of `inputs`."""
        return self._batch.moving_inputs

    @property
    def q(self) -> Floats:
        """(n,) rad, the input; `SolveError` where there are several: see `inputs`."""
        return self._batch.q

    @property
    def inputs(self) -> Floats:
        """(n, inputs) rad, the inputs as they were given."""
        return self._batch.inputs

    @property
    def sample(self) -> Integers:
        """(n,) numbers of the inputs, from 0."""
        return self._batch.sample

    @property
    def assembly_mode(self) -> Integers:
        """(n,) numbers of the assembly modes."""
        return self._batch.assembly_mode

    @property
    def status(self) -> SmallIntegers:
        """(n,) codes of `spherekit.Status`."""
        return self._batch.status

    @property
    def residual(self) -> Floats:
        """(n,) rad, by how much loops fail to close."""
        return self._batch.residual

    @checked(SolveError)
    def variable(self, name: str) -> Floats:
        """Return (n,) a pair variable, by its own name or that of its pair.

        Raises
        ------
        SolveError
            If there is none of this name, or the pair has two.
        """
        names = self.mechanism.variable_names
        number = names.index(name) if name in names else self._variable(name)
        return self._motion.values[:, number]

    @checked(SolveError)
    def variable_coefficient(self, pair: str, moving: str | None = None) -> Floats:
        """Return (n,) the rate of a pair's variable per unit rate of the input.

        Raises
        ------
        SolveError
            If there is no such pair or input, or the pair has two variables.
        """
        self._variable(pair)
        return self._batch.pair_rate(pair, self._moving(moving))

    @checked(SolveError)
    def rotation(self, link: str) -> Floats:
        """Return (n, 3, 3) the rotations from link axes to ground axes."""
        return self._batch.rotation(self._link(link))

    @checked(SolveError)
    def angular_velocity(self, link: str, moving: str | None = None) -> Floats:
        """Return (n, 3) that of a link against the ground, per unit rate of the input."""
        return self._batch.angular_velocity(self._link(link), self._moving(moving))

    @checked(SolveError)
    def angular_velocity_dq(self, link: str, moving: str | None = None) -> Floats:
        """Return (n, 3) the derivative of `angular_velocity` by the input, 1/rad."""
        return self._batch.angular_velocity_dq(self._link(link), self._moving(moving))

    @checked(SolveError)
    def direction(self, pole: str, moving: str | None = None) -> Floats:
        """Return (n, 3) unit vectors along the pole axis of two links."""
        return self._batch.direction(*self._pole(pole), self._moving(moving))

    @checked(SolveError)
    def velocity_coefficient(self, pole: str, moving: str | None = None) -> Floats:
        """Return (n,) the velocity coefficient of two links.

        Times `direction` it is the angular velocity of the first link relative to the
        second, per unit rate of the input: that of ``"1/4"`` is the opposite of ``"4/1"``.
        """
        coefficient = self._batch.velocity_coefficient
        values = coefficient(*self._pole(pole), self._moving(moving))
        return self._of_first_link(pole, values)

    @checked(SolveError)
    def acceleration_coefficient(self, pole: str, moving: str | None = None) -> Floats:
        """Return (n,) the derivative of the velocity coefficient by the input, 1/rad."""
        coefficient = self._batch.acceleration_coefficient
        values = coefficient(*self._pole(pole), self._moving(moving))
        return self._of_first_link(pole, values)

    @checked(SolveError)
    def direction_dq(self, pole: str, moving: str | None = None) -> Floats:
        """Return (n, 3) the derivative of `direction` by the input, 1/rad.

        NaN where the velocity coefficient is so small that less than six digits are known.
        """
        return self._batch.direction_dq(*self._pole(pole), self._moving(moving))

    @property
    def configuration_error(self) -> Floats:
        """(n,) rad, a bound of the error of all pair variables; infinite where unknown."""
        return self._motion.configuration_error

    @checked(SolveError)
    def error_bound(self, pole: str, moving: str | None = None) -> Floats:
        """Return (n,) a bound of the error of `direction`, rad."""
        return self._batch.error_bound(*self._pole(pole), self._moving(moving))

    @checked(SolveError)
    def velocity_coefficient_error_bound(
        self, pole: str, moving: str | None = None
    ) -> Floats:
        """Return (n,) a bound of the error of `velocity_coefficient`."""
        links, moved = self._pole(pole), self._moving(moving)
        return self._batch.velocity_coefficient_error_bound(*links, moved)

    @checked(SolveError)
    def acceleration_coefficient_error_bound(
        self, pole: str, moving: str | None = None
    ) -> Floats:
        """Return (n,) a bound of the error of `acceleration_coefficient`, 1/rad."""
        links, moved = self._pole(pole), self._moving(moving)
        return self._batch.acceleration_coefficient_error_bound(*links, moved)

    @checked(SolveError)
    def direction_dq_error_bound(self, pole: str, moving: str | None = None) -> Floats:
        """Return (n,) a bound of the error of `direction_dq`, 1/rad.

        It bounds the length of the error vector.
        """
        links, moved = self._pole(pole), self._moving(moving)
        return self._batch.direction_dq_error_bound(*links, moved)

    @checked(SolveError)
    def frame(self, degrees: bool = False) -> Any:
        """Return a pandas frame with a row for each row here, input that moves, and pole.

        With `degrees` inputs are in degrees; coefficients stay as they are.
        """
        batch = self._batch
        inputs = input_columns(self.mechanism, self.inputs)
        poles = [self._pole(pole) for pole in self.poles]
        wanted = [(*pole, k) for k in range(len(self.input_pairs)) for pole in poles]
        data: Facts = batch.pole_columns(wanted)
        of = batch.of_poles(wanted)
        bounds = [c.name for c in TABLE.columns if c.name.endswith("error_bound")]
        data |= {name: of(name, None) for name in bounds}
        data |= {key: batch.interleaved([x] * len(wanted)) for key, x in inputs.items()}
        table = TABLE.of(self.mechanism)
        return to_frame(table, {c.name: data[c.name] for c in table.columns}, degrees)

    def _link(self, name: str) -> str:
        return self.mechanism.links[self.mechanism.link(name)]

    def _variable(self, pair: str) -> int:
        number = self.mechanism.pair_number[self.mechanism.pair(pair).name]
        variables = self.mechanism.variables_of(number)
        if len(variables) > 1:
            names = listing(self.mechanism.variable_names[k] for k in variables)
            raise SolveError(
                f"{self.mechanism.name}: pair {pair} has two variables: ask for {names}"
            )
        return variables[0]

    def _pole(self, text: str) -> Pole:
        pole = parse_pole(self.mechanism, text)
        name = _name(self.mechanism, pole)
        if name not in self.poles:
            raise SolveError(
                f"{self.mechanism.name}: pole {name} was not asked for; evaluated are "
                f"{listing(self.poles)}: name it in poles"
            )
        return pole

    def _of_first_link(self, text: str, values: Floats) -> Floats:
        """Return coefficients of the first link that a text names, relative to the second.

        Di Gregorio (2024), eq. (1): both orders have one direction, and the signed
        magnitude of the angular velocity changes its sign. Batches have those of the later
        link relative to the earlier one.
        """
        first, second = ordered_pole(self.mechanism, text)
        # A difference, as the opposite of 0 would be printed with a sign.
        return values if first > second else 0.0 - values

    def _moving(self, name: str | None) -> int:
        inputs = self.input_pairs
        if name in inputs:
            return inputs.index(name)
        if name is None and len(inputs) == 1:
            return 0
        raise SolveError(
            f"{self.mechanism.name}: moving is {name!r}: say which input moves; inputs: "
            f"{listing(inputs)}"
        )


@checked(SolveError)
def evaluate(
    mechanism: AnyMechanism,
    inputs: ArrayLike,
    *,
    poles: Sequence[str] | None = None,
    input_pair: str | Sequence[str] | None = None,
    assembly_mode: int | str | None = None,
    crossings: Crossings = "end",
) -> Kinematics:
    """Return a mechanism's configurations, pole axes and coefficients at given inputs.

    Parameters
    ----------
    mechanism
        The mechanism, the name of a shipped one, or the path of a file.
    inputs
        rad: a number or (n,) of the only input, (inputs,) or (n, inputs) of several.
    poles
        The poles wanted, such as ``["3/1", "4/1"]``; by default all.
    input_pair
        The driven pairs, if not those of the mechanism.
    assembly_mode
        The only assembly mode wanted, by the number that `run` gives it or its name in the
        file; by default all. With several inputs and groups that are no dyads the numbers
        are those of this call: that of the first input, and so on.
    crossings
        Whether modes keep the signs of their dyads where curves cross (``"end"``), or
        follow the smooth curves through the range of the only input (``"pass"``).

    Raises
    ------
    SolveError, PlanError, ModelError
        If the mechanism has not one freedom for each input, a name is unknown, or inputs
        are not finite numbers. Inputs that cannot be reached get a status instead.

    Examples
    --------
    >>> import numpy as np
    >>> import spherekit as sk
    >>> here = sk.evaluate("four_bar", 0.7, poles=["4/1"], assembly_mode=0)
    >>> here.velocity_coefficient("4/1").shape
    (1,)
    >>> turn = sk.evaluate("four_bar", np.linspace(0.0, 2.0 * np.pi, 50), assembly_mode=0)
    >>> turn.q.shape, turn.direction("3/1").shape, len(turn.frame()) == 50 * 6
    ((50,), (50, 3), True)

    With a plotting library: ``plt.plot(turn.q, turn.velocity_coefficient("4/1"))``.
    """
    at = _ready(
        MechanismKey(mechanism_of(mechanism)),
        None if poles is None else tuple(poles),
        input_pair if input_pair is None or isinstance(input_pair, str) else (*input_pair,),
        assembly_mode,
        crossings,
    )
    return at(np.asarray(inputs, dtype=float))


@lru_cache(maxsize=32)
def _ready(
    of: MechanismKey,
    poles: Sequence[str] | None,
    input_pair: str | Sequence[str] | None,
    assembly_mode: int | str | None,
    crossings: Crossings,
) -> Callable[[Floats], Kinematics]:
    """Return what gives a mechanism at inputs."""
    mechanism = driven_at(of.mechanism, input_pair)
    wanted = (
        all_poles(len(mechanism.links))
        if poles is None
        else tuple(dict.fromkeys(parse_pole(mechanism, text) for text in poles))
    )
    names = tuple(_name(mechanism, pole) for pole in wanted)
    pairs = frozenset(mechanism.pair_number)
    needs = Needs(
        directions=frozenset(wanted),
        rates=frozenset(wanted),
        derivatives=True,
        turns=frozenset(wanted),
        pair_values=pairs,
        pair_rates=pairs,
        rotations=frozenset(mechanism.links),
        link_rates=frozenset(mechanism.links),
        tracer=True,
    )
    first = position_analysis_of(mechanism) if len(mechanism.inputs) == 1 else None
    if crossings == "pass":
        # With several inputs this says why it is not possible.
        first = PositionAnalysis(mechanism, crossings=crossings)
    row = None
    if first is not None and assembly_mode is not None:
        row = _one_row(mechanism, first, first.find_mode_index(assembly_mode), needs)

    def at(q: Floats) -> Kinematics:
        if first is not None and row is not None and q.size == 1 and q.ndim < 2:
            read = row(q.item())
            if read is not None:
                return Kinematics(mechanism, names, read, first.search)
        if first is not None:
            q = np.atleast_1d(q)
            tracer = analysis_covering(first, q) if all_finite(q) else first
            motion = tracer.at(shift_into_range(tracer, q))
        else:
            path = q[None] if q.ndim == 1 else q
            tracer = PositionAnalysis(mechanism, path=path, independent=True)
            motion = tracer.motion()
        if assembly_mode is not None:
            number = tracer.assembly_modes[tracer.find_mode_index(assembly_mode)].number
            motion = motion.rows(motion.assembly_mode == number)
        requests = requests_for(tracer.mechanism, needs, tracer.by_rank)
        batch = partial(
            Batch,
            mechanism,
            tuple(request.plan for request in requests),
            needs,
            motion,
            tuple(evaluate_poles(motion, request) for request in requests),
        )
        return Kinematics(mechanism, names, batch, tracer.search)

    return at


def _one_row(
    mechanism: Mechanism, tracer: PositionAnalysis, place: int, needs: Needs
) -> Callable[[float], Callable[[], Batch] | None] | None:
    """Return what gives a mode at one input by terms of floats, None where in doubt.

    It reads the batch later. Contacts are left to the motion.
    """
    (wanted,) = requests_for(tracer.mechanism, needs, tracer.by_rank)
    mode = tracer.assembly_modes[place]
    motion = tracer.sparse(REFERENCES)
    # The order of elimination need not be the same in other modes.
    motion = motion.rows(motion.assembly_mode == mode.number)
    kernel = row_kernel(motion, [wanted], "numpy")
    if kernel is None or not kernel.can_certify_rows or mechanism.has_contacts:
        return None
    low, high = tracer.range
    there = replace(
        motion.rows(slice(0, 1)),
        sample=np.zeros(1, dtype=int),
        assembly_mode=np.array([mode.number]),
        status=np.zeros(1, dtype=np.int8),
        placed=None,
    )

    def batch(q: float, evaluated: EvaluatedRow) -> Batch:
        columns = np.array(evaluated.columns)[:, None]
        every = np.array([evaluated.variables])
        free = list(kernel.passive_variables)
        every[:, free] = wrap(every[:, free])
        row = replace(
            there,
            inputs=np.array([[q]]),
            values=every,
            residual=np.array([evaluated.residual]),
        )
        (moving,) = kernel.input_columns
        signed = moving.signed_part(columns)
        signed *= signs_by_sides(np.array([evaluated.axis_sum]))(signed[:3], 0, 0)
        return Batch(
            mechanism,
            (wanted.plan,),
            needs,
            row,
            (make_certified_field(moving, columns, row, wanted),),
        )

    def at(q: float) -> Callable[[], Batch] | None:
        if not low <= q <= high and isfinite(q):
            q = shift_into_range(tracer, np.array([q])).item()
        given = [q, *mode.signs_along(np.array([[q]]))[:, 0].astype(float).tolist()]
        if not kernel.has_closed_form:
            assert mode.guide is not None
            predicted, _, why = mode.guide.predict(np.array([[q]]), None)
            if why != Status.OK:
                return None
            given = predicted[0].tolist()
        evaluated = kernel.evaluate_row(given)
        return None if evaluated is None else partial(batch, q, evaluated)

    return at


def _name(mechanism: Mechanism, pole: Pole) -> str:
    return "/".join(mechanism.links[k] for k in reversed(pole))
