"""What the overview of the motion of a run examines: which outputs, and at which samples.

`motion_overview.py` has the overview, which is accumulated according to this plan.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.mechanism.elements import Output
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.output_choice import observed_outputs
from spherekit.planning.assembly_plan import Group
from spherekit.runs.sampling import Sampling
from spherekit.velocities.transmission_measure import Transmission

MAX_OVERVIEW_SAMPLES = 721
"""Number of samples at which outputs are examined, for half a degree of a turn each.

Runs with at most so many samples examine all of them. A longer run examines samples at
equal distances, and its last one.

Larger: narrow extremes are met more often, and long runs take more time.
"""


@dataclass(frozen=True)
class ExaminedOutput:
    """An output with a motion that the overview examines: a link, or a direction on a link.

    Attributes
    ----------
    name
        Its name in the file; empty if the file names only its links.
    label
        Its name for the screen: that in the file, and its links such as ``4/1``.
    link, reference
        Indices of the link that moves, and of the link relative to which it moves.
    variable
        Index of the variable (angle) of the pair that joins both links. None if there is no
        such pair, or if the output is a direction.
    sense
        +1 if this variable is the angle of the link relative to the reference, and -1 if
        this variable is the angle of the reference relative to the link.
    direction
        (3,) the direction in which the output points, in the axes of its link. None if
        the output is the orientation of the link.
    """

    name: str
    label: str
    link: int
    reference: int
    variable: int | None
    sense: float
    direction: tuple[float, float, float] | None


def examined_outputs(mechanism: Mechanism) -> tuple[ExaminedOutput, ...]:
    """Return the links, or directions on links, that the overview of a run examines.

    The result has the declared outputs, or else the links that `observed_outputs` names.
    """
    return tuple(
        _examined_output(mechanism, output) for output in observed_outputs(mechanism)
    )


def _examined_output(mechanism: Mechanism, output: Output) -> ExaminedOutput:
    """Return an output with the data that the overview of a run needs.

    An output is the angle of a link relative to a reference link, or a direction fixed in
    the link. If a pair (joint) joins the two links, the angle is the variable of this pair,
    or the variable with the opposite sign (`sense`).
    """
    link = mechanism.link_number[output.link]
    reference = mechanism.link_number[output.relative_to]
    variable = None
    if output.direction is None:
        variable = mechanism.angle_between(link, reference)
    sense = 1.0
    if variable is not None:
        # A pair variable is the angle of the second link of the pair relative to the first.
        # `variable_owners` has the pair of each variable.
        _, second_link = mechanism.ends[mechanism.variable_owners[variable]]
        sense = 1.0 if second_link == link else -1.0
    label = f"{output.link}/{output.relative_to}"
    # A name that only repeats the name of the link says nothing new.
    has_name = output.name not in ("", output.link)
    direction = None
    if output.direction is not None:
        x, y, z = output.direction
        direction = (float(x), float(y), float(z))
    return ExaminedOutput(
        name=output.name if has_name else "",
        label=f"{output.name} {label}" if has_name else label,
        link=link,
        reference=reference,
        variable=variable,
        sense=sense,
        direction=direction,
    )


@dataclass(frozen=True)
class OverviewPlan:
    """What the overview of a run's motion examines, and the place of each sample.

    The place identifies a sample for the user. It is the time, the value of the first
    input or the number of the sample, see `place_kind`.

    Attributes
    ----------
    sampling
        The samples and the assembly modes of the run.
    """

    sampling: Sampling

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism, with the inputs of the run."""
        return self.sampling.position_analysis.mechanism

    @cached_property
    def outputs(self) -> tuple[ExaminedOutput, ...]:
        """The outputs for which the motion is examined."""
        return examined_outputs(self.mechanism)

    @cached_property
    def dyads(self) -> list[Group]:
        """All dyads of the mechanism, in the order in which they are placed."""
        groups = self.sampling.position_analysis.assembly.groups
        return [group for group in groups if group.is_dyad]

    @cached_property
    def joining_dyads(self) -> list[Group | None]:
        """For each output the dyad of which the overview states the transmission angle.

        A group of links determines the motion of the output's link relative to its
        reference link. If this group is a dyad (two links with three R pairs), the overview
        states its transmission angle. Otherwise the item is None.
        """
        assembly = self.sampling.position_analysis.assembly
        joining_groups = [
            assembly.joining_group(output.link, output.reference) for output in self.outputs
        ]
        return [
            group if group is not None and group.is_dyad else None
            for group in joining_groups
        ]

    def middle_pair(self, dyad: Group) -> str:
        """Return the name of the pair at which a dyad has its transmission angle."""
        return self.mechanism.pairs[dyad.middle].name

    @cached_property
    def transmissions(self) -> list[Transmission] | None:
        """The transmission measure of each output, None if the transmission angle is used.

        Both say how well locked inputs keep the output at rest. The transmission angle,
        which designers know, is used if all groups of links are dyads (two links with three
        R pairs).
        """
        groups = self.sampling.position_analysis.assembly.groups
        if all(group.is_dyad for group in groups):
            return None
        links = self.mechanism.links
        return [
            Transmission.from_mechanism(
                self.mechanism,
                Output(
                    output.label,
                    links[output.link],
                    links[output.reference],
                    output.direction,
                ),
            )
            for output in self.outputs
        ]

    @cached_property
    def step(self) -> int:
        """Distance of successive examined samples, as a difference of their numbers."""
        return -(-len(self.sampling) // MAX_OVERVIEW_SAMPLES)

    def examined_samples(self, first_sample: int, count: int) -> Indices:
        """Return the examined samples among `count` successive samples of the run.

        Examining only some samples saves time in long runs. They are the multiples of
        `step`, and the last sample of the run.
        """
        samples = np.arange(first_sample, first_sample + count)
        is_last_of_run = samples == len(self.sampling) - 1
        return samples[(samples % self.step == 0) | is_last_of_run]

    @cached_property
    def is_path(self) -> bool:
        """Whether successive samples are neighbours on a path."""
        return len(self.sampling.shape) == 1

    @cached_property
    def place_kind(self) -> str:
        """What the place of a sample is: ``time``, ``input`` (the first) or ``sample``.

        This place identifies a sample for users. The kind is ``input`` if the first input
        always rises, or always falls, along a path.
        """
        if self.sampling.is_over_time:
            return "time"
        first_input = self.sampling.inputs[:, 0]
        steps = np.diff(first_input)
        is_monotonic = bool(np.all(steps > 0.0) or np.all(steps < 0.0))
        if self.is_path and len(first_input) > 1 and is_monotonic:
            return "input"
        return "sample"

    @cached_property
    def places(self) -> Floats:
        """(k,) the time (s), the first input (rad) or the number of each sample."""
        if self.place_kind == "time":
            times = self.sampling.t
            assert times is not None
            return times
        if self.place_kind == "input":
            return self.sampling.inputs[:, 0]
        return np.arange(float(len(self.sampling)))

    @property
    def moves_over_time(self) -> bool:
        """Whether speeds are examined instead of velocity ratios, as in simulations."""
        return self.sampling.simulation is not None
