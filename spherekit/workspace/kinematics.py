"""Inverse and forward kinematics of one output, whatever way leads there.

A closed form has a row for each pose and working mode; on the graph of a mechanism with
other groups there is one for each configuration that was found.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from spherekit.conventions import listing
from spherekit.errors import AnalysisError
from spherekit.guidance.mid_plane_architecture import MidPlaneArchitecture
from spherekit.model.geometry import geometry_of
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Output
from spherekit.motion.assembly_modes import label_of
from spherekit.motion.closure import Closure
from spherekit.motion.motion import motion_of
from spherekit.output.dyads import Signs
from spherekit.output.forward import ForwardKinematics, output_rates
from spherekit.output.solutions import PoseSolutions
from spherekit.rates.transmission import Transmission
from spherekit.sphere.rotation import Floats
from spherekit.workspace.constraints import AngleLimit, Constraints, bounds_of, left_of
from spherekit.workspace.rows import InverseRows, Rows, Span


class OutputKinematics(ABC):
    """The poses of one declared output.

    Attributes
    ----------
    mechanism, output
        The output, and the mechanism that declares it.
    points
        Whether poses are directions (n, 3), else rotations (n, 3, 3).
    modes, legs
        The signs of all working modes, and what each sign belongs to.
    form
        The mid-plane symmetric architecture of the output, if it has one.
    solved_by
        What gives the configurations: ``dyads``, ``mid-plane`` or ``graph``.
    """

    modes: tuple[Signs, ...] = ()
    legs: tuple[str, ...] = ()
    form: MidPlaneArchitecture | None = None
    solved_by: str

    def __init__(self, mechanism: Mechanism, output: Output, points: bool) -> None:
        self.mechanism, self.output, self.points = mechanism, output, points

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the working modes."""
        return tuple(map(label_of, self.modes))

    def chosen_modes(self, text: str) -> tuple[Signs, ...]:
        """Return the modes that a text names: all for ``""``, else a label or a number.

        Raises
        ------
        AnalysisError
            If it names none.
        """
        if not text:
            return self.modes
        if text in self.labels:
            return (self.modes[self.labels.index(text)],)
        if text.isdecimal() and int(text) < len(self.modes):
            return (self.modes[int(text)],)
        raise AnalysisError(
            f'{self.mechanism.name}: outputs.{self.output.name}: working mode "{text}" is '
            f"none of {listing(self.labels, 64)}, nor a number below {len(self.modes)}; "
            f"the signs are those of: {'; '.join(self.legs)}"
        )

    @abstractmethod
    def inverse(
        self, poses: Floats, modes: Sequence[str], pairs: Sequence[int] = ()
    ) -> InverseRows:
        """Return the configurations of poses in some modes, with variables of pairs.

        Modes are named by their labels.
        """

    def forward(self, inputs: Floats) -> PoseSolutions:
        """Return every pose found at inputs (n, inputs) rad."""
        return self._forward.solutions(inputs)

    def turns(self, values: Floats) -> Floats:
        """Return the output's angular velocity (n, 3, inputs) per unit rate of each input.

        At configurations (n, variables), in axes of the link that the output is seen from;
        NaN where the inputs do not determine the motion.
        """
        return output_rates(motion_of(self._forward.solver, values), self.output)

    def type_2(self, values: Floats) -> Floats:
        """Return the measure (n,) of type II at configurations (n, variables)."""
        transmission = Transmission.of(self.mechanism, self.output)
        return transmission.of_values(self._closure, values)

    def residual(self, values: Floats) -> Floats:
        """Return (n,) rad by how much loops fail to close at values (n, variables)."""
        return self._closure.at(values).gap

    @cached_property
    def _forward(self) -> ForwardKinematics:
        return ForwardKinematics(self.mechanism, self.output.name)

    @cached_property
    def _closure(self) -> Closure:
        return Closure.of(self.mechanism, geometry_of(self.mechanism).joints)


class ClosedKinematics(OutputKinematics):
    """An output in a closed form that needs no start; poses are judged by its limits.

    `wheels` are the numbers of the pairs that turn and do not carry it.
    """

    wheels: frozenset[int] = frozenset()

    @property
    @abstractmethod
    def spans(self) -> tuple[Span, ...]:
        """What limits the reach."""

    @abstractmethod
    def at(self, poses: Floats, signs: Signs) -> Rows:
        """Return one mode at poses."""

    def name_of(self, pair: int) -> str:
        """Return the name of a pair, or that of the output for a pair made for it."""
        pairs = self.mechanism.pairs
        return pairs[pair].name if pair < len(pairs) else self.output.name

    @cached_property
    def bounds(self) -> tuple[AngleLimit, ...]:
        """The reach of the legs, and the stops of the mechanism."""
        return bounds_of(self, Constraints())

    def inverse(
        self, poses: Floats, modes: Sequence[str], pairs: Sequence[int] = ()
    ) -> InverseRows:
        """Return a row for each pose and mode."""
        limits = tuple(bound.name for bound in self.bounds)
        signs = dict(zip(self.labels, self.modes, strict=True))
        count = len(poses)
        parts = []
        for mode in modes:
            with np.errstate(invalid="ignore", divide="ignore"):
                rows = self.at(poses, signs[mode])
                values = [rows.angle(pair) for pair in pairs]
                part = InverseRows.judged(
                    np.arange(count),
                    np.full(count, mode),
                    (*left_of(self.bounds, rows), limits),
                    inputs=rows.inputs,
                    type_1=rows.type_1,
                    type_2=rows.type_2,
                    rates=rows.rates,
                    values=np.stack(values, axis=1) if values else np.empty((count, 0)),
                )
            parts.append(part)
        return InverseRows.joined(parts)
