"""Singularities: where a mechanism locks or loses control, and how near it comes."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from spherekit.plugin import (
    AbstractAnalysis,
    AnalysisError,
    Batch,
    FigureOfMerit,
    Findings,
    Mechanism,
    Needs,
    ParameterTrade,
    Scene,
    TableData,
)
from spherekit.plugin.designs import middle_pairs
from spherekit.plugin.quantities import Degrees, Seconds
from spherekit.plugin.singularities import (
    NEAREST_TRANSMISSION_REDUCTION,
    NEAREST_TRANSMISSION_WORD,
    observed_outputs,
    ordered_pole,
    output_of,
)

from .one_input import OneInput
from .several_inputs import MAX_OUTPUT_FREEDOMS, SeveralInputs, no_aspects
from .tables import ASPECTS, RELATION, SINGULARITIES

EFFECTS_OF_ZERO = {
    "near": "no near misses are reported",
    "slices": "neither curves nor surfaces are searched",
    "mesh": "no surfaces are computed",
    "input_grid": "no aspects are searched",
    "seconds": "the searches end at once",
}
"""Parameters that must not be negative, and what their value 0 does, for the message."""


def _compare_positions(
    parameter: str, values: tuple[float, ...], inputs: Literal["one", "several"]
) -> ParameterTrade:
    """Return a declaration of how values of a parameter are compared by speed and accuracy.

    The analysis is run with each value of the parameter. The inputs ``q`` of its
    singularities are compared with those of the most accurate run. Each input is
    compared with the nearest input that has the same kind of singularity and the same
    output.

    Parameters
    ----------
    parameter, values
        Name of the parameter, and the values that are compared.
    inputs
        Whether the comparison applies to mechanisms with one input or with several.
    """
    # The time limit, the parameter `seconds`, is raised to 100 s so that it does not also
    # limit the accuracy. It stays if it is itself compared. Runs with one input, compared
    # by `samples`, have no time limit.
    raises_time_limit = parameter not in ("samples", "seconds")
    return ParameterTrade(
        parameter,
        values,
        table="singularities",
        column="q",
        match=("kind", "output"),
        # Each number in the column is compared with the nearest number, not with the
        # one in the same row.
        places=True,
        # Values of other parameters during the comparison.
        beside=(("seconds", 100.0),) if raises_time_limit else (),
        inputs=inputs,
    )


@dataclass(frozen=True, kw_only=True)
class SingularityAnalysis(AbstractAnalysis):
    """Singularities of types I, II and III, and the distance from them along the motion.

    With two inputs, singular configurations are curves, with three inputs surfaces. They
    are searched on slices, where all inputs but one are locked, or from random starts. An
    aspect is a set of configurations that are connected without a singularity.

    Attributes
    ----------
    output
        Relative motions of interest with one input, such as ``41`` or ``4/1``. By default
        the outputs that the mechanism declares. With several inputs these are always used.
    near
        Angle to a singularity (in Python in degrees) below which a warning is given. If
        dyads place the output, a warning of type II also needs the transmission angle of
        one of them to be below it.
    slices
        With several inputs, the number of values at which each input is locked. The default
        is 12 if there are two inputs and all groups are dyads. Other mechanisms are
        searched from random starts by default, since each slice takes seconds to minutes.
        With 0, neither curves nor surfaces are searched.
    mesh
        Length of the edges of surfaces (in Python in degrees), by default a sixteenth of
        the narrowest range. With 0, no surfaces are computed.
    input_grid
        With several inputs, the number of values of each input in the grid over which
        aspects are searched, 11 by default. With 0, no aspects are searched. With more than
        three inputs, the output can always rest while inputs move, so there are no aspects.
    seconds
        Processor time (s) after which the searches with several inputs end. The results
        until then are returned.
    """

    name = "singularities"
    version = "1"
    summary = "singularities of types I, II, III, and how near they are"
    cites = (
        "R. Di Gregorio, Proc. IMechE C 227(8), 2013, 1830-1840",
        "R. Di Gregorio, J. Mechanisms and Robotics 7(3), 2015, 031008",
    )
    tables = (SINGULARITIES, RELATION, ASPECTS)

    trades = (
        _compare_positions("samples", (31, 91, 181, 361, 1441), "one"),
        _compare_positions("slices", (3, 6, 12, 24), "several"),
        _compare_positions("mesh", (20.0, 10.0, 5.0, 2.5), "several"),
        _compare_positions("seconds", (1.0, 3.0, 10.0, 100.0), "several"),
    )

    output: tuple[str, ...] = ()
    near: Degrees = 5.0
    slices: int | None = None
    mesh: Degrees | None = None
    input_grid: int | None = None
    seconds: Seconds = 50.0

    def outputs(self, mechanism: Mechanism) -> tuple[tuple[int, int], ...]:
        """Return the relative motions of interest as indices (o, s) of links.

        Link o moves relative to link s. The motions are those of the parameter `output`. If
        it is empty, a mechanism with one input has the motions of `observed_outputs`, and a
        mechanism with several inputs those of the outputs that it declares.
        """
        if self.output:
            given_motions = [ordered_pole(mechanism, text) for text in self.output]
            return tuple(dict.fromkeys(given_motions))  # without repetitions
        outputs = mechanism.outputs
        if len(mechanism.inputs) == 1:
            outputs = observed_outputs(mechanism)
        number = mechanism.link_number
        motions = [(number[output.link], number[output.relative_to]) for output in outputs]
        return tuple(dict.fromkeys(motions))  # without repetitions

    def merits(self, mechanism: Mechanism) -> tuple[FigureOfMerit, ...]:
        """Return a figure of merit for each dyad: how near it comes to type II.

        A dyad is two links joined by a pair, each an arc on the sphere. The figure is the
        smallest transmission angle at all samples: the acute angle between the planes of
        both arcs. The angle is 0 at type II, where the output can move while the inputs
        rest.
        """
        return tuple(
            FigureOfMerit(
                f"{NEAREST_TRANSMISSION_WORD}_transmission_angle_{pair}",
                NEAREST_TRANSMISSION_REDUCTION,
                f"transmission_angle_{pair}",
                meaning=f"{NEAREST_TRANSMISSION_WORD} transmission angle at pair {pair}",
            )
            for pair in middle_pairs(mechanism)
        )

    def needs(self, mechanism: Mechanism) -> Needs:
        """Check all parameters, and return which results of a run this analysis reads.

        The analysis reads the links of the outputs and the position analysis (`tracer`).
        The position analysis follows curves of configurations, on which singularities are
        searched.

        Raises
        ------
        AnalysisError
            If a parameter is not valid for the mechanism.
        ModelError
            If a mechanism with several inputs declares no output.
        """
        # Parameters that must not be negative.
        for name, effect_of_zero in EFFECTS_OF_ZERO.items():
            value = getattr(self, name)
            if value is not None and not value >= 0:
                raise AnalysisError(
                    f"singularities: {name}: found {value:g}, expected a number of at "
                    f"least 0; with 0, {effect_of_zero}"
                )
        if len(mechanism.inputs) > 1:
            if self.output:
                raise AnalysisError(
                    "singularities: output: can be given only for a mechanism with one "
                    "input; leave it out. With several inputs the analysis computes all "
                    "outputs that the mechanism file declares as [outputs.NAME]"
                )
            # This raises an error if the mechanism declares no output.
            output_of(mechanism)
            # `input_grid` is for the search of aspects: connected sets of configurations
            # without singularities. An output has at most three degrees of freedom. So more
            # than three inputs can move while it rests, and every configuration is
            # singular.
            if self.input_grid and len(mechanism.inputs) > MAX_OUTPUT_FREEDOMS:
                raise AnalysisError(
                    f"singularities: input_grid: {no_aspects(mechanism)}; leave it out, or "
                    "give 0"
                )
        output_links = {link for links in self.outputs(mechanism) for link in links}
        return Needs(tracer=True, links=frozenset(output_links))

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the tables of singularities, the relation along the motion, aspects."""
        singularities = self._singularities(batch)
        return {
            "singularities": singularities.points,
            "relation": singularities.relation,
            "aspects": singularities.aspects,
        }

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return plots of each assembly mode, and drawings of the singularities."""
        return self._singularities(batch).scenes()

    def findings(self, batch: Batch) -> Findings:
        """Return how many singularities exist, and where a mode comes near one of them."""
        return self._singularities(batch).findings()

    def _singularities(self, batch: Batch) -> OneInput | SeveralInputs:
        """Return the singularities of a batch, which are computed once."""

        def compute() -> OneInput | SeveralInputs:
            """Compute the singularities for one or for several inputs.

            `near` is the angle (degrees) to a singularity below which a warning is given.
            The other parameters limit the searches with several inputs:

            - `slices`: the singular configurations are a curve with two inputs, and a
              surface with three. The search starts from single points of the curve or
              surface: singular configurations in which all inputs but one are locked at
              given values. `slices` is the number of these values for each input.
            - `mesh` is the length of the edges of surfaces (degrees).
            - `input_grid` is the number of values of each input for the search of aspects:
              sets of configurations that singularities separate from each other.
            - `seconds` is the time limit.
            """
            if len(batch.mechanism.inputs) == 1:
                return OneInput(batch, self.outputs(batch.mechanism), self.near)
            # None stands for the default.
            mesh_rad = None if self.mesh is None else float(np.radians(self.mesh))
            return SeveralInputs(
                batch,
                slices=self.slices,
                mesh=mesh_rad,
                input_grid=self.input_grid,
                near=self.near,
                seconds=self.seconds,
            )

        return batch.once("singularities", compute)
