"""Singularities over a range, proven: where the input or an output is stationary.

If one pair joins the output link to its reference link, the output rotates about the axis
of this pair. It is stationary (type I) where the variable of the pair is stationary. The
input is stationary (type II) where its own variable is stationary. Elsewhere on the curves
there are no singularities of these types.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.completeness import Guarantee
from spherekit.mechanism.elements import Output
from spherekit.mechanism.output_choice import observed_outputs
from spherekit.numerics.angles import wrap
from spherekit.proof.configuration_curves import CertifiedCurves
from spherekit.proof.decimal_mechanism import DecimalMechanism
from spherekit.proof.stationary_points import StationaryPoint, StationaryPoints

INPUT_ROUNDING_RAD = 1e-12
"""Bound (rad) of the rounding of inputs, by which clearances are reduced.

Larger: smaller clearances. Smaller: below some 1e-14 it is no longer a bound.
"""


@dataclass(frozen=True)
class CertifiedSingularity:
    """A singular configuration of a mechanism, proven to be the only one near its point.

    Attributes
    ----------
    output
        Name of the output, a relative rotation of two links.
    type
        "I" if the output is stationary, "II" if the input is. Type III means that both are
        stationary. Type III is never proven. If it cannot be excluded, the type is "I or
        III" or "II or III".
    q
        The input (rad).
    curve
        Index of the curve of configurations.
    point
        The configuration, with an error bound of its variables. In no other configuration
        within this bound is the angle of the output (type I) or of the input (type II)
        stationary.
    """

    output: str
    type: str
    q: float
    curve: int
    point: StationaryPoint


@dataclass(frozen=True)
class CertifiedSingularities:
    """All singularities of types I and II of the outputs along certified curves.

    An output is a link that is observed relative to another link.
    In type I the output is stationary along a curve, in type II the input is.

    Attributes
    ----------
    curves
        The configuration curves.
    singularities
        The singularities, ordered by output, type and input.
    undecided
        Number of parts of curves in which there may be more singularities.
    skipped
        Outputs with an angle that is no variable of the equations. Only their singularities
        of type II are known.
    resting
        Outputs that are stationary all along a curve, each with the index of the curve.
    """

    curves: CertifiedCurves
    singularities: Sequence[CertifiedSingularity]
    undecided: int
    skipped: Sequence[str]
    resting: Sequence[tuple[str, int]]

    def clearance(self, q: float) -> float:
        """Return a proven distance (rad) from q within which there is no singularity.

        The command ``certify`` prints it for the option ``--clear-of``. It is a lower bound
        of the distance from q to the nearest critical input, in both directions and for all
        assembly modes (ways to assemble). Critical inputs are:

        - the ends of the range, unless it is a full cycle,
        - inputs at singularities of type I (the output is stationary along a curve of
          configurations) and type II (the input is stationary),
        - inputs at crossings and near crossings of curves,
        - inputs that are constant along a whole curve.

        Singularities of type I are unknown for the outputs in `skipped`, so they do not
        count. An output in `resting` is stationary along a whole curve. These singularities
        do not count either. The result is 0 if anything else is not proven.
        """
        curves = self.curves
        # `undecided` counts parts of curves that may have further singularities.
        if curves.completeness.guarantee is not Guarantee.CERTIFIED or self.undecided:
            return 0.0
        # After a cycle of `cycle_turns` turns of the input, all links are back at the same
        # place. So no distance exceeds half a cycle.
        half_cycle = np.pi * curves.cycle_turns
        distances = [half_cycle]
        for value, error in self._list_critical_inputs():
            # Offset to the nearest repetition after whole cycles of the input.
            offset = np.remainder(value - q + half_cycle, 2.0 * half_cycle) - half_cycle
            distances.append(abs(offset) - error)
        if not curves.is_full_cycle:
            distances += [q - curves.low, curves.high - q]
        # The variable of the equations is the input divided by `cycle_turns`. So a rounding
        # error of this variable causes an error of the input that is `cycle_turns` times
        # larger.
        rounding = curves.cycle_turns * INPUT_ROUNDING_RAD
        return max(min(distances) - rounding, 0.0)

    def _list_critical_inputs(self) -> list[tuple[float, float]]:
        """Return the inputs (rad) near which singularities can be, with their errors (rad).

        `clearance` computes the distance from an input to the nearest of them. They are:

        - inputs of configurations in which an output (type I) or the input (type II) is
          stationary along a curve,
        - inputs at saddles, where curves of configurations cross or nearly cross,
        - inputs that are constant along a whole curve.
        """
        curves = self.curves
        points = [
            point
            for stationary_points in curves.input_stationary_points
            for point in stationary_points.proven
        ]
        points += [singularity.point for singularity in self.singularities]
        # After `cycle_turns` turns of the input all wheels are at their initial angles. The
        # equations contain the input divided by this number. `input_angle` multiplies this
        # variable by the number, so its errors are multiplied as well.
        critical_inputs = [
            (curves.input_angle(point.position), curves.cycle_turns * point.error)
            for point in points
        ]
        for saddle in curves.saddles:
            # Curves that nearly cross bend in the central zone of the saddle, so
            # singularities may occur in this zone. `central_zone` has the half width (rad)
            # of this zone for each variable.
            half_width = saddle.central_zone[curves.input_variable]
            critical_inputs.append(
                (curves.input_angle(saddle.centre), curves.cycle_turns * half_width)
            )
        critical_inputs += [(value, 0.0) for value in curves.constant_input_values]
        return critical_inputs


def find_output_pairs(decimal_mechanism: DecimalMechanism) -> dict[str, int]:
    """Return the pair whose angle measures each output, by the name of the output.

    An output is a link that is observed relative to another link. The pair joins these two
    links. The output is stationary (singular of type I) where the angle of this pair is
    stationary. Outputs without such a pair are left out.

    The result has the index of the pair in `decimal_mechanism.structure`. An output without
    a name is called like its links, such as ``rocker/frame``. The decimal mechanism is the
    mechanism with the decimal sizes of its file.
    """
    mechanism = decimal_mechanism.mechanism
    pairs = dict[str, int]()
    for output in observed_outputs(mechanism):
        output_links = {mechanism.link(output.link), mechanism.link(output.relative_to)}
        for number, ends in enumerate(decimal_mechanism.structure.ends):
            if set(ends) == output_links:
                pairs.setdefault(_output_name(output), number)
    return pairs


def _output_name(output: Output) -> str:
    """Return the name of an output, or of its two links if it has none."""
    return output.name or f"{output.link}/{output.relative_to}"


def locate_singularities(curves: CertifiedCurves) -> CertifiedSingularities:
    """Return the singularities of all observed outputs other than the input itself.

    An output is a link that is observed relative to another link. The angle of the pair
    between both links measures the output. If this angle is stationary along a
    configuration curve, the configuration is singular of type I. If the input angle is
    stationary, the configuration is singular of type II.
    """
    construction = curves.construction
    output_pairs = find_output_pairs(curves.decimal_mechanism)
    singularities: list[CertifiedSingularity] = []
    skipped: list[str] = []
    resting: list[tuple[str, int]] = []
    # Pairs that rotate with the input: the input itself, and wheels that share its
    # variable.
    input_like_pairs = {
        construction.pairs[curves.input_variable],
        *curves.equations.follower_offsets,
    }
    # Each variable that was examined, with its stationary points on each chain.
    examined = [(curves.input_variable, curves.input_stationary_points)]
    mechanism = curves.decimal_mechanism.mechanism
    output_names = [
        name
        for name in map(_output_name, observed_outputs(mechanism))
        if output_pairs.get(name) not in input_like_pairs
    ]
    if not output_names:
        # The singularities of type II are listed under this name, once.
        output_names = ["-"]
    for output in output_names:
        pair = output_pairs.get(output)
        # By default none: for outputs with an angle that is no variable of the equations.
        output_points = [StationaryPoints() for _ in curves.chains]
        if pair in construction.pairs:
            variable = construction.pairs.index(pair)
            output_points = curves.locate_stationary_points(variable)
            examined.append((variable, output_points))
            resting += [
                (output, curve)
                for curve, is_constant in enumerate(curves.find_constant_chains(variable))
                if is_constant
            ]
        elif output != "-":
            skipped.append(output)
        # Type I: the output is stationary. Type II: the input is stationary. If both may
        # be in one configuration, it may be of type III.
        for curve, (of_output, of_input) in enumerate(
            zip(output_points, curves.input_stationary_points, strict=True)
        ):
            for singularity_type, points, other_points in (
                ("I", of_output.proven, of_input.proven),
                ("II", of_input.proven, of_output.proven),
            ):
                for point in points:
                    type_text = singularity_type
                    if _may_coincide(point, other_points):
                        type_text = f"{singularity_type} or III"
                    q = curves.input_angle(point.position)
                    q_in_range = curves.wrap_into_range(q)
                    singularities.append(
                        CertifiedSingularity(
                            output=output,
                            type=type_text,
                            q=q if q_in_range is None else q_in_range,
                            curve=curve,
                            point=point,
                        )
                    )
    singularities.sort(key=lambda item: (item.output, item.type, item.q))
    # Undecided parts: stretches of curves, and saddles (places where curves cross or nearly
    # do) near which a variable may be stationary.
    undecided = sum(
        len(points.undecided) for _, by_chain in examined for points in by_chain
    )
    undecided += sum(
        bool(doubt > 0.0)
        for variable, _ in examined
        for doubt in curves.bound_saddle_doubts(variable)
    )
    return CertifiedSingularities(
        curves=curves,
        singularities=singularities,
        undecided=undecided,
        skipped=skipped,
        resting=resting,
    )


def _may_coincide(point: StationaryPoint, others: Sequence[StationaryPoint]) -> bool:
    """Return whether a stationary point may be the same configuration as another point."""
    return any(
        np.all(np.abs(wrap(point.position - other.position)) <= point.error + other.error)
        for other in others
    )
