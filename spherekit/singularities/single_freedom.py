"""All singularities of a mechanism with one degree of freedom, one input and any outputs.

On a configuration curve the rate of the input w_ir and the rate of an output w_os, per
unit of arc length, are smooth functions. If only the rate of the output is zero at a
point of the curve, this is a singularity of type I. If only the rate of the input is
zero, the singularity is of type II. If both rates are zero, it is a self-motion. Type
III occurs where curves cross.

Each type is checked by input-output relations c y' = d q' (Di Gregorio 2012). q' is the
rate of the input. In the relation of form "i", y' is the rate of the output. In the
relation of form "ii", y' is the rate of the output link relative to the reference link
of the input. c and d follow from pole axes, the axes about which links turn relative to
each other. At crossings, c and d of the configuration alone vanish. They also vanish where
the links of the relation are badly chosen, which is no singularity.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import chain, pairwise

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.errors import PlanError
from spherekit.geometry.vectors import cross, max_abs, nans
from spherekit.planning.pole_plan import Plan, Pole, ordered_pole, pole_of
from spherekit.planning.pole_planner import plan
from spherekit.positions.configuration_curve import ArcCurve
from spherekit.positions.curve_crossing import Crossing, find_crossing
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.singularities.curve_velocities import CurveMotion, LinkMotion
from spherekit.singularities.geometric_conditions import (
    TYPE_OF_VANISHING,
    RelationAt,
    compare_with_rates,
)
from spherekit.singularities.input_output_relation import (
    Form,
    FourLinks,
    Relation,
    Type,
    make_relation,
)
from spherekit.singularities.singular_point import SingularPoint
from spherekit.status import Status
from spherekit.tolerances import CLOSURE_TOLERANCE, SINGULAR_CURVE_CONDITION

UNDECIDED_GAP_FACTOR = 100.0
"""Successive singularities of different types are undecided if they are nearer than this
times their error bounds. Larger: more singularities are marked as uncertain."""
MAX_SHARED_ERROR_RAD = 1e-9
"""If input and output rest at the same point within error bounds larger than this, it is
not certain that they rest together. Larger: fewer self-motions are marked as uncertain."""
MAX_CROSSING_MISS_RAD = 1e-14
"""If a computed crossing is farther from an exact one, the curves may not cross at all:
rounding of the sizes decides. Larger: fewer crossings are marked as uncertain."""
SAME_CROSSING_RAD = 1e-7
"""Crossings whose variables differ by less are one crossing. Larger: crossings near each
other are taken for one; smaller: one crossing is listed twice."""
ONE_CURVE_NOTE = (
    "c and d are those of this curve: its motion determines the third pole, which the "
    "configuration alone does not"
)
"""Note of a relation at a crossing whose c and d do not vanish."""
VANISHING_RELATION = 1e-12
"""A relation whose coefficients are smaller on most of a curve vanishes on all of it.
Larger: relations of mechanisms with small arcs are reported as useless."""
SAMPLES_OF_FREEDOMS = 9
"""Number of configurations of each mode at which the degrees of freedom of a mechanism
without curves are computed."""
TYPE_OF_REST = {**TYPE_OF_VANISHING, (True, True): Type.SELF_MOTION}
"""The type of a singularity, by whether the input rests and whether the output rests."""
NO_ZERO = np.array([[np.nan], [np.nan], [np.inf]])
"""Stands for a missing zero: arc length, whether it is double, and error bound."""


@dataclass(frozen=True)
class CurveRelations:
    """Rates and input-output relations at n points of a curve of configurations.

    The input is the rotation of a link relative to its reference link, and so is the
    output. A relation is an equation c y' = d q'. q' is the rate of the input. y' is the
    rate of the output link, relative to its own reference link or to that of the input. c
    and d follow from the pole axes, about which links turn relative to each other.

    Attributes
    ----------
    input_rate, output_rate
        (n,) rates of the input and of the output per unit of arc length of the curve.
    relations
        One or two relations. In the first one (form "i"), y' is the rate of the output. In
        the second one (form "ii"), y' is the rate of the output link relative to the
        reference link of the input. Form "ii" does not exist if the output link is one of
        the two links of the input. c and d can be NaN at points with an unknown pole
        axis.
    """

    input_rate: Floats
    output_rate: Floats
    relations: list[Relation]


class SingleFreedomSingularities:
    """The singularities of one input and some outputs along given curves.

    Parameters
    ----------
    position_analysis
        A mechanism with one degree of freedom.
    curves
        Its configuration curves.
    outputs
        Relative motions (o, s): indices or names of links, or text such as ``"4/1"``.
    input
        The input (i, r), given like an output. By default it is the second link of the
        driven pair relative to the first.

    Attributes
    ----------
    curve_motions
        Velocities along each curve.
    input, outputs
        The input as link indices (i, r), and each output as link indices (o, s).
    links
        For each output the links of its relations, by form "i" and, if it exists, "ii". A
        relation of form "ii" may use another link s than the reference link of the output.

    Raises
    ------
    PlanError
        If the mechanism has several inputs, if a link is unknown, or if the two links of a
        relative motion are the same.
    """

    def __init__(
        self,
        position_analysis: PositionAnalysis,
        curves: Sequence[ArcCurve],
        outputs: Iterable[str | tuple[int | str, int | str]],
        input: str | tuple[int | str, int | str] | None = None,
    ) -> None:
        """Prepare velocities along curves, and choose the links of all relations.

        A relation is an equation c y' = d q' between the rate y' of an output and the rate
        q' of the input. c and d follow from the axes about which some links turn relative
        to each other. `_choose_links` explains which links these are.

        Parameters
        ----------
        position_analysis
            A mechanism with one degree of freedom.
        curves
            Curves of configurations of the mechanism, along which velocities are needed.
        outputs
            Motions of a link relative to another: a text such as ``"4/1"``, or indices
            or names of both links.
        input
            The input, given like an output. By default it is the motion of the driven pair.
        """
        mechanism = position_analysis.mechanism
        if len(position_analysis.inputs) != 1:
            raise PlanError(
                f"{mechanism.name}: the mechanism has {len(position_analysis.inputs)} "
                "inputs, but a relation between one input and one output exists only if "
                "there is a single degree of freedom; lock the other inputs"
            )
        self.position_analysis = position_analysis
        # A pole is the axis about which two links turn relative to each other. Unknown
        # poles are constructed from known ones in some order, the plan. A plan is the same
        # on all curves, so each plan is made only once.
        self._plan_poles = cache(self._find_plan)
        self.curve_motions = [
            CurveMotion(position_analysis, curve, self._plan_poles) for curve in curves
        ]
        # From here on each motion is a pair of indices: moving link, reference link.
        if input is None:
            # A pair's variable is the angle of its second link relative to its first one.
            first, second = mechanism.ends[position_analysis.assembly.input]
            self.input = (second, first)
        else:
            self.input = ordered_pole(mechanism, input)
        self.outputs = tuple(ordered_pole(mechanism, output) for output in outputs)
        self.links = [self._choose_links(output) for output in self.outputs]

    def _find_plan(self, poles: tuple[Pole, ...]) -> Plan | None:
        """Return the order in which some poles are constructed from each other.

        A pole is the axis about which two links turn relative to each other. The result is
        None if the poles cannot be constructed.
        """
        mechanism = self.position_analysis.mechanism
        # The number of degrees of freedom usually follows from counting links and pairs. If
        # counting gives too few (redundant constraints), the rank of the velocity equations
        # is used.
        by_rank = self.position_analysis.by_rank
        try:
            return plan(mechanism, poles, by_rank=by_rank)
        except PlanError:
            return None

    def _choose_links(self, output: tuple[int, int]) -> dict[Form, FourLinks]:
        """Return the links of the one or two relations between an output and the input.

        A relation is an equation c y' = d q', where q' is the rate of the input. The
        coefficients c and d follow from the axes about which four links turn relative to
        each other. Each relation becomes useless (c = d = 0) in some configurations. There
        are two if possible, since one can still be used where the other one vanishes. The
        input is the rotation of link i relative to link r, and the output is the rotation
        of link o relative to link s:

        - In form "i", y' is the rate of the output. The four links are i, r, o and s.
        - In form "ii", y' is the rate of o relative to r. The four links are i, r, o and an
          auxiliary link, which takes the place of s in the formulas. This form exists only
          if o is neither i nor r.

        Parameters
        ----------
        output
            Indices of the output link and of its reference link.

        Returns
        -------
        The four links i, r, o and s, by form.
        """
        # The indices of the input link i and of its reference link r.
        input_link, input_reference = self.input
        output_link, output_reference = output
        links = FourLinks(
            i=input_link, r=input_reference, o=output_link, s=output_reference
        )
        links_by_form: dict[Form, FourLinks] = {"i": links}
        if output_link in self.input:
            return links_by_form
        # Usually the auxiliary link of form "ii" is the reference link of the output. If
        # this is r, the output is already relative to r, and both forms would be the same
        # relation. Another link is chosen in this case, None if there is none.
        auxiliary_link: int | None = output_reference
        if output_reference == input_reference:
            auxiliary_link = self._choose_auxiliary_link(links)
        if auxiliary_link is not None:
            links_by_form["ii"] = replace(links, s=auxiliary_link)
        return links_by_form

    def _choose_auxiliary_link(self, links: FourLinks) -> int | None:
        """Return the auxiliary link of a second relation between an output and the input.

        A relation is an equation c y' = d q'. Here input and output have the same reference
        link r: q' is the rate of link i relative to r, and y' is the rate of link o
        relative to r. The caller makes a second relation, because the first one is useless
        in some configurations. Its coefficients c and d are computed with the help of any
        further link, the auxiliary link.

        Both coefficients contain the sine of the angle between two axes: those about which
        links o and i turn relative to the auxiliary link. The relation is most accurate if
        this sine is large. Therefore the link with the greatest sum of these sines at the
        computed points of all curves is chosen. The result is None if there is no further
        link.

        Parameters
        ----------
        links
            The input link i, the output link o, and their reference link. It is stored
            twice: as `r`, the reference of the input, and as `s`, that of the output.
        """
        link_count = len(self.position_analysis.mechanism.links)
        # Any link that is none of i, o and their reference link.
        candidates = [link for link in range(link_count) if link not in links.different]
        if not candidates:
            return None
        # For each candidate the poles of the output link and of the input link.
        pole_pairs = [
            (pole_of(links.o, candidate), pole_of(links.i, candidate))
            for candidate in candidates
        ]
        poles = list(chain.from_iterable(pole_pairs))
        sum_of_sines = np.zeros(len(candidates))
        for curve_motion in self.curve_motions:
            axes = curve_motion.pole_axes(curve_motion.curve.s, poles).directions
            for k, (output_pole, input_pole) in enumerate(pole_pairs):
                products = cross(axes[output_pole], axes[input_pole])
                sum_of_sines[k] += np.nansum(np.linalg.norm(products, axis=1))
        return candidates[int(np.argmax(sum_of_sines))]

    def poles(self, output: int) -> list[Pole]:
        """Return the poles that the input-output relations of an output use, each once.

        A pole is the axis about which one link rotates relative to another.

        `output` is the position of the output in `outputs`.
        """
        poles: dict[Pole, None] = {}
        for links in self.links[output].values():
            poles |= dict.fromkeys(links.poles)
        return list(poles)

    def evaluate_relations(self, curve: int, s: Floats, output: int) -> CurveRelations:
        """Return the rates of input and output, and their relations, at points of a curve.

        The curve consists of configurations of the mechanism. Rates are derivatives
        with respect to the arc length of this curve. A relation is an equation c y' = d
        q' between the rates of output and input. c and d are triple products of pole
        axes, the axes of relative rotation of links. The singularity analysis makes columns
        of its tables from the rates and the coefficients.

        Parameters
        ----------
        curve
            Index of the configuration curve.
        s
            (n,) arc lengths (rad) of the points.
        output
            Index of the output in `outputs`.
        """
        curve_motion = self.curve_motions[curve]
        # Unit vectors along the pole axes, with senses that are continuous along the curve.
        axes = curve_motion.oriented_axes(s, self.poles(output))
        link_motion = curve_motion.links_at(s)  # the angular velocities of all links
        return CurveRelations(
            input_rate=_relative_rate(link_motion, axes, self.input),
            output_rate=_relative_rate(link_motion, axes, self.outputs[output]),
            relations=self._compute_relations(output, axes),
        )

    def _compute_relations(self, output: int, axes: dict[Pole, Floats]) -> list[Relation]:
        """Return the one or two equations between the rates of an output and of the input.

        Each equation is a relation c y' = d q'. Here q' is the rate of the input: of its
        link relative to its reference link. There are two forms:

        - In form "i", y' is the rate of the output.
        - In form "ii", y' is the rate of the output link relative to the reference link of
          the input.

        One form can still be used where the other one vanishes (c = d = 0). `_choose_links`
        says when form "ii" does not exist. c and d are computed from pole axes alone, the
        axes about which links turn relative to each other.

        Parameters
        ----------
        output
            Index of the output in `outputs`.
        axes
            (n, 3) unit vectors along the pole axes, by pole (pair of links).
        """
        links_by_form = self.links[output]
        return [
            make_relation(form, links, pole_axis=lambda pole: axes[pole])
            for form, links in links_by_form.items()
        ]

    @cached_property
    def _points_and_resting_curves(self) -> list[SingularPoint]:
        """All singularities, in the order of output, curve and arc length.

        If the input or an output rests on a whole curve, a single item with the arc length
        NaN stands for the curve.
        """
        points: list[SingularPoint] = []
        for output in range(len(self.outputs)):
            for number in range(len(self.curve_motions)):
                points += self._points_on_curve(number, output)
        return points

    @property
    def points(self) -> list[SingularPoint]:
        """All singularities on curves, by output, curve and arc length."""
        return [point for point in self._points_and_resting_curves if np.isfinite(point.s)]

    @property
    def resting_curves(self) -> list[SingularPoint]:
        """Curves on which the input or an output rests everywhere, one item for each.

        Their arc length is NaN, and `points` has no points of that output on them.
        """
        return [point for point in self._points_and_resting_curves if np.isnan(point.s)]

    @property
    def gaps(self) -> list[str]:
        """Where singularities may be missed, in words."""
        return [
            f"curve {number} was not followed to its end; singularities on the rest of it "
            "are not known"
            for number, curve_motion in enumerate(self.curve_motions)
            if Status.MODE_LOST in curve_motion.curve.ends
        ]

    def _points_on_curve(self, number: int, output: int) -> list[SingularPoint]:
        """Return the singularities of an output on a configuration curve.

        Singularities are the points at which the input or the output is at rest while the
        mechanism moves along the curve.

        Parameters
        ----------
        number
            Index of the curve.
        output
            Position of the output in `outputs`.

        Returns
        -------
        One item for each point, in order of arc length. If the input or the output rests on
        the whole curve, the list has a single item for the whole curve, whose arc length,
        error and values are NaN.
        """
        curve_motion = self.curve_motions[number]
        output_links = self.outputs[output]
        input_pole = pole_of(*self.input)
        output_pole = pole_of(*output_links)
        # `rest_points` returns None if the two links rest on the whole curve.
        input_rests = curve_motion.rest_points(input_pole) is None
        output_rests = curve_motion.rest_points(output_pole) is None
        if input_rests or output_rests:
            whole_curve = SingularPoint(
                type=TYPE_OF_REST[input_rests, output_rests],
                output=output_links,
                places=((number, np.nan),),
                error=np.nan,
                values=nans(curve_motion.curve.nodes.values.shape[1]),
            )
            return [whole_curve]

        rests = find_input_output_rests(curve_motion, input_pole, output_pole)
        types = [
            TYPE_OF_REST[input_is_resting, output_is_resting]
            for input_is_resting, output_is_resting in zip(
                rests.input_rests.tolist(), rests.output_rests.tolist(), strict=True
            )
        ]
        # Texts that say why a type is not certain. If the output is the input itself or its
        # reverse, both rest together without doubt.
        curve = curve_motion.curve
        notes = explain_doubts(
            rests,
            types,
            is_input=input_pole == output_pole,
            lap=curve.length if curve.closed else np.inf,
        )
        link_motion = curve_motion.links_at(rests.s)
        relations = self._check_types(output, link_motion, types)
        # At a simple zero a rate changes its sign, so the motion reverses. At a double zero
        # the sign stays the same.
        input_turns = rests.input_rests & ~rests.input_is_double
        output_turns = rests.output_rests & ~rests.output_is_double
        is_double = rests.input_is_double | rests.output_is_double
        s = rests.s.tolist()
        errors = rests.errors.tolist()
        return [
            SingularPoint(
                type=types[k],
                output=output_links,
                places=((number, s[k]),),
                error=errors[k],
                values=link_motion.values[k],
                input_turns=bool(input_turns[k]),
                output_turns=bool(output_turns[k]),
                double=bool(is_double[k]),
                note=notes[k],
                relations=relations[k],
            )
            for k in range(len(types))
        ]

    def _check_types(
        self, output: int, link_motion: LinkMotion, types: Sequence[Type]
    ) -> list[tuple[RelationAt, ...]]:
        """Check the types of n singularities by the input-output relations of an output.

        The types follow from rates: the output rests at type I, the input at type II. In a
        relation c y' = d q' between both rates, d should then vanish at type I and c at
        type II. c and d are computed from pole axes (axes of relative rotation of links),
        independently of the rates. Each `RelationAt` has the type by c and d, and a note if
        this type differs from the type by rates.

        An output has two relations if possible, because one can still be used where the
        other one vanishes (c = d = 0). In the first, y' is the rate of the output: of its
        link relative to its reference link. In the second, y' is the rate of the output
        link relative to the reference link of the input.

        Parameters
        ----------
        output
            Index of the output in `outputs`.
        link_motion
            Velocities of the links at the singularities.
        types
            Type of each singularity by the rates.

        Returns
        -------
        For each singularity its one or two relations.
        """
        # The plan says how to construct the poles by intersections of great circles.
        poles = tuple(self.poles(output))
        axes = link_motion.pole_axes(poles, self._plan_poles(poles))
        # If links of a relation rest relative to each other, a note states this as the
        # reason why c = d = 0.
        is_resting = {pole: link_motion.rests(pole) for pole in poles}
        input_rate = _relative_rate(link_motion, axes.directions, self.input)
        relations = [
            compare_with_rates(
                relation,
                self.position_analysis.mechanism.links,
                output_rate=_relative_rate(link_motion, axes.directions, relation.output),
                input_rate=input_rate,
                axis_errors=axes.largest_error(relation.links.poles),
                output=self.outputs[output],
                types_by_rates=types,
                is_resting=is_resting,
            )
            for relation in self._compute_relations(output, axes.directions)
        ]
        # From one list for each relation to one tuple for each singularity.
        return list(zip(*relations, strict=True))

    @cached_property
    def notes(self) -> list[str]:
        """Texts about relations that say nothing about the rates on a whole curve.

        A relation c y' = d q' connects the rate y' of an output and the rate q' of the
        input. Normally it checks the types of singularities, which follow from computed
        rates. On some curves of configurations, c and d are zero or unknown everywhere, so
        the types cannot be checked there. A note tells users. Curves on which the input or
        the output rests get no note.
        """
        link_names = self.position_analysis.mechanism.links
        notes: list[str] = []
        resting = {(point.curve, point.output) for point in self.resting_curves}
        for output, output_links in enumerate(self.outputs):
            for number, curve_motion in enumerate(self.curve_motions):
                if (number, output_links) in resting:
                    continue
                # Arc lengths of the computed points of the curve.
                s = curve_motion.curve.s
                # The axes of relative rotation of links, from which c and d follow.
                axes = curve_motion.pole_axes(s, self.poles(output))
                for relation in self._compute_relations(output, axes.directions):
                    if _vanishes_on_curve(relation):
                        notes.append(
                            _explain_vanishing_relation(relation, number, link_names)
                        )
        return notes

    @cached_property
    def crossings(self) -> list[SingularPoint]:
        """The singularities at which the closure equations lose rank, for each output.

        Generally several curves of configurations cross there. At a crossing, the velocity
        equations have at least two independent solutions. They can be combined into a
        motion in which the input rests, and into one in which the output rests. So the
        singularity is of type III.
        """
        points: list[SingularPoint] = []
        for curve_end in self._singular_curve_ends():
            # None if the crossing was not located.
            crossing = curve_end.crossing
            for output, output_links in enumerate(self.outputs):
                point = SingularPoint(
                    type=Type.III,
                    output=output_links,
                    # The index of each curve that ends here, with the arc length.
                    places=tuple(curve_end.places),
                    error=np.nan if crossing is None else crossing.error,
                    values=curve_end.values,
                    note=_explain_crossing_doubts(crossing),
                    # The relation of the rates of input and output on each curve.
                    relations=self._relations_at_crossing(crossing, output),
                    crossing=crossing,
                )
                points.append(point)
        return points

    def _singular_curve_ends(self) -> list["_SingularCurveEnd"]:
        """Return the crossings at which curves end, with the curve ends at each of them.

        At a crossing of curves of configurations, the closure equations lose rank. The ends
        of several curves belong to one crossing if their configurations agree within a
        tolerance, apart from whole periods of the variables. Each crossing is returned
        once.
        """
        curve_ends: list[_SingularCurveEnd] = []
        for number, curve_motion in enumerate(self.curve_motions):
            curve = curve_motion.curve
            for s, node, status in zip(
                (0.0, curve.length), (0, -1), curve.ends, strict=True
            ):
                if status != Status.AT_SINGULARITY:
                    continue
                # The curve ends a little before the crossing, which is located from there.
                last_values = curve.nodes.values[node]
                crossing = find_crossing(curve.closure, last_values)
                values = last_values if crossing is None else crossing.values
                for curve_end in curve_ends:
                    difference = curve.wrapped(values - curve_end.values)
                    if max_abs(difference) < SAME_CROSSING_RAD:
                        # Another curve ends at the same crossing.
                        curve_end.places.append((number, s))
                        break
                else:
                    curve_ends.append(_SingularCurveEnd(crossing, values, [(number, s)]))
        return curve_ends

    def _relations_at_crossing(
        self, crossing: Crossing | None, output: int
    ) -> tuple[RelationAt, ...]:
        """Return the relations c y' = d q' on each curve through a crossing of curves.

        q' is the rate of the input, and y' the rate of the output link. c and d follow
        from pole axes, the axes about which links turn relative to each other.

        Several curves of configurations meet at a crossing, and each is another motion of
        the mechanism. The mechanism may follow any of these curves. So the configuration
        does not determine the motion, and the crossing is of type III (c = d = 0).

        The motion along a single curve determines all pole axes. So c and d of this motion
        may differ from zero. A note then says that c and d apply to this curve only.

        Parameters
        ----------
        crossing
            The crossing, or None if it was not located.
        output
            Index of the output in `outputs`.

        Returns
        -------
        The relations on the first curve, then those on the second one, and so on. On each
        curve an output has one or two relations, one for each form that exists (see
        `_compute_relations`). The result is empty if the crossing was not located.
        """
        if crossing is None:
            return ()
        # The tangent of a curve has the rates of all variables in the motion along it.
        curve_count = len(crossing.tangents)
        link_motion = LinkMotion(
            self.position_analysis,
            values=np.tile(crossing.values, (curve_count, 1)),
            tangents=crossing.tangents,
            # The second derivatives along the curves are not known.
            bends=None,
        )
        # `_check_types` computes the relations. If c or d does not vanish, it adds a
        # general note about the difference from type III. If neither vanishes,
        # `_note_single_curve` below replaces this note by one that names the cause.
        types = [Type.III] * curve_count
        relations_by_curve = self._check_types(output, link_motion, types)
        relations = list(chain.from_iterable(relations_by_curve))
        # If the output is the input itself, c and d are constants on every curve.
        is_input = {*self.outputs[output]} == {*self.input}
        if is_input:
            return tuple(relations)
        return tuple(_note_single_curve(relation) for relation in relations)

    @cached_property
    def everywhere(self) -> int | None:
        """Number of degrees of freedom, if the mechanism has more than one everywhere.

        The caller then reports that the mechanism is singular everywhere. If curves of
        configurations were found, the mechanism has one degree of freedom, and the result
        is None. Without curves, the number is computed at some configurations from the rank
        of the closure equations. At singular configurations this number is too large, so
        the smallest number counts. If it is 1 or 0, the result is None.

        The configurations are all assembly modes (ways to assemble the mechanism) at a few
        values of the input. If the loops close with all variables zero, this configuration
        is added.
        """
        if self.curve_motions:
            return None
        solver = self.position_analysis.solver
        # The configurations of all assembly modes at a few samples of the input.
        motion = self.position_analysis.sparse(SAMPLES_OF_FREEDOMS)
        reference = np.zeros((1, motion.values.shape[1]))
        closed_values = motion.values[~motion.failed]
        if solver.closure.linearise(reference).closure_residual[0] < CLOSURE_TOLERANCE:
            closed_values = np.concatenate([reference, closed_values])
        least = min(
            (
                solver.compute_mobility(values, SINGULAR_CURVE_CONDITION)
                for values in closed_values
            ),
            default=0,
        )
        return least if least > 1 else None


def _note_single_curve(relation: RelationAt) -> RelationAt:
    """Return a relation at a crossing, with a note if it applies to one curve only.

    A relation c y' = d q' of the configuration alone has c = d = 0 at a crossing. If
    both are known and neither vanishes, c and d belong to the motion along one curve. The
    general note that the type of the relation differs from that of the crossing is replaced
    by a note that names the cause.
    """
    is_known = np.isfinite(relation.c) and np.isfinite(relation.d)
    neither_vanishes = relation.type is None and is_known
    return replace(relation, note=ONE_CURVE_NOTE) if neither_vanishes else relation


def _vanishes_on_curve(relation: Relation) -> bool:
    """Return whether c and d of a relation c y' = d q' vanish on a whole curve.

    y' and q' are the rates of output and input. The median over the computed points of the
    curve decides, because single points mislead: a pole axis can be inaccurate, or the
    relation can be zero at a singularity. Unknown coefficients (NaN) count as zero.
    """
    sizes = np.nan_to_num(np.hypot(relation.c, relation.d))
    return bool(np.median(sizes) < VANISHING_RELATION)


def _explain_vanishing_relation(
    relation: Relation, curve: int, link_names: Sequence[str]
) -> str:
    """Return a note for users why a relation is useless on a whole curve.

    A relation c y' = d q' connects the rate q' of the input and a rate y' of the output
    link. The type of a singularity is normally checked by which of c and d is zero. The
    coefficients follow from the axes about which links turn relative to each other.

    - With four links, c and d are both zero if all axes are in one plane.
    - With three links, c and d are unknown if all axes are on one line. A plane through the
      axes is needed to compute them, and the line lies in many planes.

    The note says that the types then follow from the rates y' and q' alone.

    Parameters
    ----------
    relation
        The relation. In its form "i", y' is the rate of the output link relative to the
        reference link of the output, in form "ii" relative to that of the input.
    curve
        Index of the curve.
    link_names
        Names of all links of the mechanism.
    """
    links = relation.links.different
    names = ", ".join(link_names[link] for link in links)
    case = "lie in one plane" if len(links) == 4 else "are one line"
    return (
        f"curve {curve}: the axes of the links {names} {case} everywhere, so form "
        f"{relation.form} is undefined: the rates determine the types"
    )


@dataclass(frozen=True)
class _SingularCurveEnd:
    """A configuration at which curves of configurations end.

    The loop-closure equations lose rank at this configuration, and generally several curves
    cross there.

    Attributes
    ----------
    crossing
        The crossing of curves, or None if it was not located.
    values
        (variables,) variables of the crossing (rad). If the crossing was not located,
        the variables of the last computed point of a curve.
    places
        One item for each curve end at the crossing: the index of the curve, and the arc
        length (rad) at which it ends.
    """

    crossing: Crossing | None
    values: Floats
    places: list[tuple[int, float]]


@dataclass(frozen=True)
class InputOutputRests:
    """The n points of a curve of configurations where the input, the output, or both rest.

    These points are the singularities of the curve. Input and output each have a rate: the
    angular velocity between their two links per unit of arc length. It is zero where they
    rest. The zeros of both rates are computed independently. A zero of the input's rate and
    a zero of the output's rate count as one point if they agree within their error bounds.

    Attributes
    ----------
    s, errors
        (n,) arc lengths of the points, and bounds of their errors (rad).
    distances
        (n,) distance (rad) along the curve between the computed zeros of both rates. It is
        0 if only the input or only the output rests.
    input_rests, output_rests
        (n,) whether the input rests, and whether the output rests.
    input_is_double, output_is_double
        (n,) whether the zero of the rate is double. The input or output does not reverse
        there.
    """

    s: Floats
    errors: Floats
    distances: Floats
    input_rests: Bools
    output_rests: Bools
    input_is_double: Bools
    output_is_double: Bools


def find_input_output_rests(
    curve_motion: CurveMotion, input_pole: Pole, output_pole: Pole
) -> InputOutputRests:
    """Return the points at which an input or an output rests, in order of arc length.

    The points are zeros of the rates of input and output along the curve. If a zero of the
    input and a zero of the output agree within their error bounds, they are one point at
    which both rest. Neither may rest on the whole curve.

    Parameters
    ----------
    curve_motion
        Velocities along the curve.
    input_pole, output_pole
        The two links of the input and of the output.
    """
    curve = curve_motion.curve
    # Each column is a zero. The rows are arc length, whether the zero is double, and error
    # bound. The last column represents a missing zero: its arc length is NaN.
    input_zeros = np.hstack([_stack_rest_points(curve_motion, input_pole), NO_ZERO])
    output_zeros = np.hstack([_stack_rest_points(curve_motion, output_pole), NO_ZERO])
    input_s, _, input_errors = input_zeros
    output_s, _, output_errors = output_zeros
    # (zeros of the input, zeros of the output) distances along the curve.
    distances = np.abs(input_s[:, None] - output_s)
    if curve.closed:
        distances = np.minimum(distances, curve.length - distances)
    # agrees[j, k]: zero j of the input and zero k of the output are the same point. The
    # comparison is false in the last row and column, where distances are NaN.
    agrees = distances <= input_errors[:, None] + output_errors
    # A zero of one rate that agrees with no zero of the other rate is paired with the
    # missing zero of the other rate, which is its last one (index -1).
    input_alone = ~agrees[:-1].any(axis=1)
    output_alone = ~agrees[:, :-1].any(axis=0)
    agrees[:-1, -1] = input_alone
    agrees[-1, :-1] = output_alone
    input_numbers, output_numbers = np.nonzero(agrees)
    input_zeros = input_zeros[:, input_numbers]
    output_zeros = output_zeros[:, output_numbers]
    # From here on, column k of both arrays is pair k of zeros.
    distance = np.nan_to_num(distances[agrees])
    # The more accurate zero of a pair gives the arc length.
    _, input_double, input_errors = input_zeros
    _, output_double, output_errors = output_zeros
    is_input_better = input_errors <= output_errors
    s, _, errors = np.where(is_input_better, input_zeros, output_zeros)
    # If both rest at one point, both zeros are estimates of this point. So the error of the
    # point is at least their distance.
    errors = np.maximum(errors, distance)
    order = np.argsort(s, kind="stable")
    # 1.0 for a double zero, 0.0 for a simple one, NaN for a missing one.
    input_double = input_double[order]
    output_double = output_double[order]
    return InputOutputRests(
        s=s[order],
        errors=errors[order],
        distances=distance[order],
        input_rests=~np.isnan(input_double),
        output_rests=~np.isnan(output_double),
        input_is_double=input_double == 1.0,
        output_is_double=output_double == 1.0,
    )


def _stack_rest_points(curve_motion: CurveMotion, pole: Pole) -> Floats:
    """Return the zeros of a pole's rate: (3, k) arc length, 1.0 if double, error bound."""
    points = curve_motion.rest_points(pole)
    assert points is not None
    return np.stack([points.s, points.is_double, points.errors])


def explain_doubts(
    rests: InputOutputRests, types: Sequence[Type], is_input: bool, lap: float
) -> list[str]:
    """Return, for each singularity, why the type is uncertain, or an empty text.

    Singularities are points of a curve of configurations at which the input, the output, or
    both rest. The errors of these points can leave a question open:

    - One point counts as a self-motion, at which input and output both rest. The input and
      the output may rest at two different points near each other.
    - Two neighbouring points count as different, one where the input rests and one where
      the output rests, but may be the same point.

    Parameters
    ----------
    rests
        The n points and their errors.
    types
        The types of the points.
    is_input
        Whether the output is the input itself or its reverse, so that both rest together
        without doubt.
    lap
        The length (rad) of a closed curve, infinite for an open one.
    """
    # If both notes apply to a point, the second note replaces the first one.
    notes = [""] * len(types)
    if not is_input:
        _note_uncertain_self_motions(notes, rests, types)
    _note_near_neighbours(notes, rests, types, lap)
    return notes


def _note_uncertain_self_motions(
    notes: list[str], rests: InputOutputRests, types: Sequence[Type]
) -> None:
    """Write notes for points at which input and output may not rest together.

    An input or output rests where its derivative along a curve of configurations is zero.
    A self-motion is a point at which both rest. The point where the input rests and the
    point where the output rests are computed independently. If the error of their positions
    exceeds `MAX_SHARED_ERROR_RAD`, they may be two different points. The note tells this to
    the user, with the distance of both points along the curve.

    Parameters
    ----------
    notes
        n texts, changed in place.
    rests, types
        The n points at which input or output rest, and their types of singularity.
    """
    distances = rests.distances.tolist()
    errors = rests.errors.tolist()
    for k, kind in enumerate(types):
        if kind == Type.SELF_MOTION and errors[k] > MAX_SHARED_ERROR_RAD:
            notes[k] = _format_undecided(distances[k], errors[k])


def _note_near_neighbours(
    notes: list[str], rests: InputOutputRests, types: Sequence[Type], lap: float
) -> None:
    """Write notes for two neighbouring singularities that may be one singularity.

    The singularities are points of a curve of configurations. At some only the input rests,
    at others only the output. If two such points are nearer to each other than their errors
    allow to decide, they may be one point, at which both rest.

    Parameters
    ----------
    notes
        n texts, changed in place.
    rests, types
        The n points in order of arc length, and their types.
    lap
        The length (rad) of a closed curve, infinite for an open one.
    """
    s = rests.s.tolist()
    errors = rests.errors.tolist()
    numbers = range(len(types))
    # On a closed curve the first point follows the last one. On an open curve the gap
    # between them is infinite: a negative number modulo infinity is infinity.
    for k, following in pairwise([*numbers, *numbers[:1]]):
        gap = (s[following] - s[k]) % lap
        sum_of_errors = errors[k] + errors[following]
        is_near = gap < UNDECIDED_GAP_FACTOR * sum_of_errors
        if types[k] != types[following] and is_near:
            notes[k] = _format_undecided(gap, sum_of_errors)
            notes[following] = notes[k]


def _format_undecided(distance: float, error: float) -> str:
    """Return the note that input and output may come to rest at one point or at two.

    On a curve of configurations, the rate of the input is zero at one computed point, and
    the rate of the output at another point near it. The errors of these points are too
    large to decide whether they are the same. In the note, "vanish" means that a rate is
    zero.

    Parameters
    ----------
    distance
        Distance (rad) of both points along the curve.
    error
        Error (rad) of the positions of these points.
    """
    return (
        f"undecided within tolerance: input and output vanish {distance:.3g} rad apart, "
        f"but their positions are accurate to {error:.3g} rad only"
    )


def _relative_rate(
    motion: LinkMotion, axes: dict[Pole, Floats], links: tuple[int, int]
) -> Floats:
    """Return the rate (n,) of the first of two links relative to the second.

    The rate is the component of the relative angular velocity along the pole axis (axis of
    relative rotation) of both links.

    Parameters
    ----------
    motion
        Angular velocities of all links at n configurations.
    axes
        For each pole (two links) unit vectors (n, 3) along its axis. The sense of the
        vectors decides the sign of the rate.
    links
        Indices of the two links.
    """
    link, reference = links
    w, _dw = motion.relative(reference, link)  # angular velocity and its derivative
    return np.vecdot(w, axes[pole_of(link, reference)])


def _explain_crossing_doubts(crossing: Crossing | None) -> str:
    """Return why a crossing at the end of curves is uncertain, or an empty text.

    Curves of configurations cross where the equations that close the loops lose rank: some
    of their singular values vanish.

    Parameters
    ----------
    crossing
        The crossing near the end of the curves, or None if it was not located.
    """
    # Newton's method locates a crossing if the singular values vanish in proportion to the
    # distance from it. If they vanish faster (of higher order), the method fails.
    if crossing is None:
        return (
            "the curve ends where the closure equations lose rank, but the configuration "
            "was not located: the loss is of higher order"
        )
    notes = []
    # `miss` is the distance of the configuration from an exact crossing.
    if crossing.miss > MAX_CROSSING_MISS_RAD:
        notes.append(
            f"undecided within tolerance: the loops miss the crossing by "
            f"{crossing.miss:.3g} rad, so two curves may pass each other instead"
        )
    # To first order, the equations allow `freedoms` independent motions at the crossing.
    # The terms of second order should tell which of these motions continue along curves.
    # `resolved` is False if this remains open.
    if not crossing.resolved:
        notes.append(
            f"terms of second order do not tell how many curves there are among the "
            f"{crossing.freedoms} freedoms"
        )
    return "; ".join(notes)
