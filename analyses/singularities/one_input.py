"""The analysis `singularities` of mechanisms with one input."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.plugin import (
    Arrow,
    Axis,
    Batch,
    Findings,
    Floats,
    GreatCircle,
    InputMarks,
    Mark,
    PlaneCurve,
    Portrait,
    Primitive,
    Scene,
    Status,
    Text,
    counted,
    link_bodies,
    listing,
    number_text,
)
from spherekit.plugin.rotations import wrap
from spherekit.plugin.singularities import (
    Completeness,
    Guarantee,
    NearMiss,
    SampledSingularities,
    SingularPoint,
    SixPoles,
    Type,
    grashof,
    near_misses,
)

from ..common import output_in_words
from .findings import (
    describe_accuracy,
    describe_inputs_of_kinds,
    describe_least_transmission,
    describe_output_ranges,
    warn_of_near_misses,
)
from .scenes import (
    COLOUR_OF_KIND,
    SELF_MOTION,
    break_at_jumps,
    name_kind,
    plot_plane,
    relation_plots,
)
from .tables import ASPECTS, RELATION, SINGULARITIES, configuration_columns, of_kind

Columns = dict[str, Any]
"""Columns of a table, or one row of it, by the names of columns."""

RESTING_RATE = 1e-8
"""A rate (derivative with respect to arc length) below this is zero in the table of
relations. Larger: rows near singularities are called singular; smaller: rounding hides
singular rows."""
CURVE_COLOUR = 4
"""Index of the colour of configuration curves."""
POINTS_PER_CURVE = 721
"""Points with which a whole configuration curve is drawn. Larger: smoother lines."""
LABEL_OF_AXIS = {
    "ir": "ir",
    "or_": "or",
    "os": "os",
    "io": "io",
    "is_": "is",
    "rs": "rs",
}
"""Labels of the axes of `SixPoles` in drawings, in the order in which they are drawn."""
AXES_OF_PLANES = {
    "I": (("io", "os", "is_"), ("ir", "is_", "rs")),
    "I with four links": (("or_", "ir", "io"), ("ir", "is_", "rs")),
    "II": (("or_", "os", "rs"), ("io", "os", "is_")),
}
"""The axes of the two planes that coincide, by the type of the singularity. At type I they
are other planes if the links of input and output are four different links."""
GALLERY_HEADER = (
    "Arrows: poles of the input link i, its reference r, the output link o and its "
    "reference s, or the fourth link of form ii. Great circles: the planes that "
    "coincide.\n\n"
    "| sample | type | condition | mode | q, deg | output |\n"
    "|---|---|---|---|---:|---|"
)
"""Text above the list of singularities on their page, in Markdown."""


@dataclass(frozen=True)
class OneInput:
    """Tables, drawings and findings on the singularities of a mechanism with one input.

    At type I an output has no velocity while the input moves; at type II the input has no
    velocity while the output moves; at type III configuration curves cross.

    Attributes
    ----------
    batch
        The rows, which are configurations of the mechanism along its assembly modes.
    outputs
        The relative motions of interest: each is given by the indices of two links.
    near
        Angle to a singularity (deg) below which a warning is given.
    """

    batch: Batch
    outputs: tuple[tuple[int, int], ...]
    near: float

    @cached_property
    def sampled(self) -> SampledSingularities:
        """The singularities on all configuration curves, and where each row is on a curve.

        A configuration curve consists of all configurations that one continuous motion
        passes. A row is one configuration of the batch.
        """
        batch = self.batch
        # Singularities are marked as inside or outside of the motion. A simulation passes
        # only a part of the range of the input. The inputs (rad) of all rows tell which
        # part.
        passed_inputs = None
        # Only simulations have a sense of motion (+1 or -1).
        if batch.motion.sense is not None:
            passed_inputs = batch.q
        return SampledSingularities(
            batch.tracer,
            self.outputs,
            values=batch.motion.values,
            assembly_mode=batch.assembly_mode,
            passed=passed_inputs,
        )

    @cached_property
    def names(self) -> list[str]:
        """The outputs as texts with names of links, such as ``4/1``."""
        return [self._name_links(links) for links in self.sampled.report.outputs]

    def _name_links(self, links: Iterable[int]) -> str:
        """Return the names of links, given by their numbers, such as ``4/1``."""
        return "/".join(
            self.sampled.position_analysis.mechanism.links[link] for link in links
        )

    @cached_property
    def names_in_words(self) -> list[str]:
        """The outputs in sentences, such as ``rocker (4/1)``, in the order of `names`."""
        return [output_in_words(self.batch.mechanism, name) for name in self.names]

    @cached_property
    def points(self) -> Columns:
        """The main table: one row for each singularity of each output.

        Rows of points on configuration curves come first, then crossings of curves, then
        curves on which the input or an output is at rest everywhere. At a singularity, the
        rate of the input or output is zero. The singularity is double if this rate does not
        change its sign there. Other columns are:

        - `inside`: whether the singularity is in the range of the input. For a simulation,
          whether its motion passes the singularity.
        - `certain`: whether its kind is certain despite rounding errors.
        - `guarantee`: how completely the curves are known.
        """
        sampled = self.sampled
        report = sampled.report
        rows: list[Columns] = []
        for point in (*report.points, *report.crossings):
            rows += self._rows_of_point(point)
        # A curve on which the input or an output is at rest gives one row, without a point.
        # The residual (error of a point) is therefore 0.
        for point in report.resting_curves:
            # A piece is a part of a curve in one assembly mode (way to assemble the links).
            pieces = sampled.configurations.curves[point.curve].pieces
            # A simulation moves along this curve if some of its rows are on it.
            is_inside = not sampled.is_simulation or point.curve in sampled.curve
            rows.append(
                {
                    "kind": str(point.type),
                    "assembly_mode": _join_numbers(sampled.modes_of(pieces)),
                    "inside": "yes" if is_inside else "no",
                    "output": self._name_links(point.output),
                    "curve": point.curve,
                    "residual": 0.0,
                    "certain": "yes",
                    "note": f"at rest on the whole of curve {point.curve}",
                }
            )
        defaults = {"double": "no", "guarantee": sampled.configurations.guarantee.value}
        return SINGULARITIES.stacked(self.batch.mechanism, [defaults | row for row in rows])

    def _rows_of_point(self, point: SingularPoint) -> list[Columns]:
        """Return the rows of a singularity in the main table.

        There is a row for each value of the input at which the singularity occurs. The rows
        differ in the input, the assembly modes and whether the input is inside the range.
        The note names the geometric conditions of a point on a curve, such as parallel
        axes, or the curves that cross. Conditions come from the relations c y' = d q'
        between the rates y' of the output and q' of the input. At a singularity c or d is
        zero.
        """
        sampled = self.sampled
        # The part of the mechanism on which the outputs depend, if it is not the whole.
        part = (
            None
            if sampled.position_analysis is self.batch.tracer
            else sampled.position_analysis
        )
        # At type III configuration curves cross.
        is_crossing = point.type is Type.III

        # Conditions. A relation that disagrees with the rates has no conditions of this
        # singularity.
        relations = [
            relation for relation in point.relations if is_crossing or relation.agrees
        ]
        conditions = [
            condition for relation in relations for condition in relation.conditions
        ]
        # A question mark marks a condition that is not certain within rounding.
        labels = [
            condition.label + ("" if condition.certain else "?") for condition in conditions
        ]
        residuals = [condition.residual for condition in conditions]
        if is_crossing:
            notes = [*_describe_crossing(point), point.note]
        elif conditions:
            notes = [point.note, *(condition.words for condition in conditions)]
        else:
            notes = [point.note, *(relation.note for relation in point.relations)]

        # Reversals: whether input or output turn back here. At type I only the output can
        # reverse, at type II only the input.
        reversals = []
        if point.input_turns and point.type is not Type.I:
            reversals.append("input")
        if point.output_turns and point.type is not Type.II:
            reversals.append("output")

        columns = {
            **configuration_columns(
                self.batch, point.values[None], point.output, part=part
            ),
            "kind": str(point.type),
            "certain": "yes" if point.certain else "no",
            "error": point.error,
            "reversal": " and ".join(reversals),
            "double": "yes" if point.double else "no",
            "condition": " ".join(dict.fromkeys(labels)),
            "residual": min(residuals, default=np.nan),
            "output": self._name_links(point.output),
            "curve": point.curve,
            "s": point.s,
            # Empty notes and repetitions are left out.
            "note": "; ".join(dict.fromkeys(filter(None, notes))),
        }
        return [
            {
                **columns,
                "assembly_mode": _join_numbers(occurrence.modes),
                "q": occurrence.q,
                "inside": "yes" if occurrence.is_inside else "no",
            }
            for occurrence in sampled.find_occurrences(point.places, point.values)
        ]

    @cached_property
    def relation(self) -> Columns:
        """The table of the relation c y' = d q' and of the nearness of singularities.

        y' is the rate of an output, q' the rate of the input. Both are derivatives with
        respect to the arc length of the configuration curve. The coefficients c and d
        follow from the pole axes, about which links turn relative to each other. c is 0 at
        type II, d is 0 at type I. There are up to two forms, which use different pole axes.
        In form i, y' is the rate of the output link relative to its own reference s. In
        form ii it is the rate relative to the reference r of the input. The table has every
        row of the batch once for each output and form. It is empty without curves.

        A row has type I if the rate of the output is zero, and type II if the rate of
        the input is zero. If both rates are zero, other links move (a self-motion).
        Where configuration curves cross, all rates may be zero, and the type is III.
        """
        batch = self.batch
        sampled = self.sampled
        # Smallest singular value of the loop equations with the input locked, and its ratio
        # to the largest one. They are 0 if a link can move although the input is locked.
        sigma, reciprocal_condition = sampled.singular_values()
        # A status of the row itself takes precedence over the status of a singularity
        # measure.
        status = np.where(batch.status == Status.OK, sampled.status, batch.status)
        measures = sampled.measures()
        if not measures and sampled.curves:
            # No row is on a curve, so no rates are known.
            unknown = np.full(len(batch), np.nan)
            measures = {
                (output, form): {"output_rate": unknown, "input_rate": unknown}
                for output, links_by_form in enumerate(sampled.report.links)
                for form in links_by_form
            }
        tables: list[Columns] = []
        for (output, form), columns in measures.items():
            output_rate = columns["output_rate"]
            input_rate = columns["input_rate"]
            output_rests = np.abs(output_rate) < RESTING_RATE
            input_rests = np.abs(input_rate) < RESTING_RATE
            # The first condition that is fulfilled decides. `crossed` marks rows at which
            # configuration curves cross. Without a rate the row is on no curve.
            kinds = np.select(
                [
                    sampled.crossed,
                    np.isnan(input_rate),
                    output_rests & input_rests,
                    output_rests,
                    input_rests,
                ],
                ["III", "", SELF_MOTION, "I", "II"],
                "regular",
            )
            with np.errstate(divide="ignore", invalid="ignore"):
                velocity_coefficient = output_rate / input_rate
            # Group 1 has the rows of types I, II and III, group 0 all other rows.
            group = np.isin(kinds, ("I", "II", "III")).astype(np.int64)
            tables.append(
                {
                    **columns,
                    "sample": batch.sample,
                    "assembly_mode": batch.assembly_mode,
                    "q": batch.q,
                    "output": self.names[output],
                    "form": form,
                    "velocity_coefficient": velocity_coefficient,
                    "sigma": sigma,
                    "reciprocal_condition": reciprocal_condition,
                    "status": status,
                    "moving": batch.moving_inputs[0],
                    "type": kinds,
                    "group": group,
                }
            )
        return RELATION.stacked(batch.mechanism, tables)

    @property
    def aspects(self) -> Columns:
        """The table of aspects. It has no rows, because aspects need several inputs."""
        return ASPECTS.stacked(self.batch.mechanism)

    def findings(self) -> Findings:
        """Return how many singularities exist, and where an assembly mode comes near one.

        The result has three parts:

        - The summary: how many singularities of each type exist, near misses (modes
          that come near a singularity without reaching it), and uncertain results.
        - Warnings: singularities that may be missed, type II in the range, near misses.
        - Remarks: sentences on all other results.
        """
        sampled = self.sampled
        points = self.points
        names = self.names
        names_in_words = self.names_in_words
        report = sampled.report
        configurations = sampled.configurations
        input_pair = self.batch.moving_inputs[0]
        is_inside = points["inside"] == "yes"
        counts_inside = _count_kinds(points["kind"][is_inside])
        counts_outside = _count_kinds(points["kind"][~is_inside])
        misses = near_misses(sampled, np.radians(self.near))
        summary: dict[str, Any] = {
            "singularities": counts_inside,
            "outside": counts_outside,
            "configuration_curves": len(sampled.curves),
            "guarantee": str(configurations.claim),
            "checks_failed": list(configurations.mismatches),
            "notes": [*report.gaps, *report.notes],
            "near_misses": [_near_miss_record(miss, names) for miss in misses],
        }

        # `gaps` are sentences on curves that were not followed to their ends. `mismatches`
        # are sentences on inputs at which the curves disagree with the assembly modes.
        warnings = [*report.gaps, *configurations.mismatches]
        # `everywhere` is the number of degrees of freedom if it is more than one in every
        # configuration, else None. Singular values of the closure equations below a part in
        # a million of the largest one count as zero.
        if report.everywhere is not None:
            summary["freedoms_everywhere"] = report.everywhere
            warnings.append(
                "Within a relative tolerance of 1e-6, the mechanism has "
                f"{report.everywhere} degrees of freedom in every configuration: it is "
                "singular everywhere, and its tables are empty"
            )
        is_type_two = is_inside & (points["kind"] == "II")
        for name in dict.fromkeys(points["output"][is_type_two]):
            warnings.append(
                f"The output {output_in_words(self.batch.mechanism, name)} meets a "
                "singularity of type II in the range: there the locked input does not "
                "hold it"
            )
        warnings += warn_of_near_misses(
            misses, points, names, names_in_words, self.near, input_pair
        )

        remarks = [self._describe_counts(counts_inside, counts_outside)]
        four_bar_class = grashof(self.batch.mechanism)
        if four_bar_class is not None:
            summary["grashof"] = four_bar_class.name
            remarks.append(str(four_bar_class))
        for name, name_in_words in zip(names, names_in_words, strict=True):
            remarks += describe_inputs_of_kinds(points, name, name_in_words, input_pair)
        if report.everywhere is None:
            remarks += describe_output_ranges(sampled, names_in_words)
        remarks += describe_least_transmission(sampled, names_in_words, input_pair)
        remarks += describe_accuracy(points)
        return Findings(summary, tuple(warnings), tuple(remarks))

    def _describe_counts(
        self, counts_inside: Mapping[str, int], counts_outside: Mapping[str, int]
    ) -> str:
        """Return a sentence that counts the singularities and the searched curves.

        Parameters
        ----------
        counts_inside, counts_outside
            Counts of singularities by kind (type I, II, ...) inside and outside of the
            range of the input.
        """
        sampled = self.sampled
        counts = "No singularities"
        if counts_inside:
            counts = f"Singular configurations: {_format_counts(counts_inside)}"
        if sampled.is_simulation:
            counts += " passed"
        else:
            counts += " in the range of the input"
        if counts_outside:
            counts += f", {_format_counts(counts_outside)} outside"
        curves = counted(len(sampled.curves), "configuration curve")
        # Only the part of the mechanism on which the outputs depend was searched.
        links_of_part = sampled.position_analysis.mechanism.links
        if len(links_of_part) < len(self.batch.mechanism.links):
            curves += f" of the links {listing(links_of_part)}"
        # The claim says whether all configuration curves are known.
        return f"{counts} on {curves}; {_describe_claim(sampled.configurations.claim)}"

    def scenes(self) -> tuple[Scene, ...]:
        """Return the page of singularities, if there are points, and one of each mode."""
        pages = []
        if np.any(np.isfinite(self.points["s"])):
            pages.append(self._gallery())
        for mode, rows in self.batch.assembly_mode_rows().items():
            portraits = [
                self._input_output_plot(output, rows) for output in range(len(self.names))
            ]
            plots = relation_plots(self.relation, len(self.batch), rows)
            marks = self._mark_singular_inputs(rows)
            pages.append(Scene(mode, (*portraits, *plots, *marks)))
        return tuple(pages)

    def _mark_singular_inputs(self, rows: slice) -> list[Primitive]:
        """Return marks at the inputs of the singularities of an assembly mode.

        An assembly mode is one way to assemble the links. The marks are vertical lines in
        plots over the input. Plots over time have no marks.

        Parameters
        ----------
        rows
            The rows of the batch with this mode.
        """
        if self.batch.timed:
            return []
        points = self.points
        # At a singularity several assembly modes can meet. The column has their numbers as
        # a text such as "0+2".
        mode = str(int(self.batch.assembly_mode[rows.start]))
        is_in_mode = np.array(
            [mode in modes.split("+") for modes in points["assembly_mode"]], bool
        )
        is_marked = is_in_mode & np.isfinite(points["q"])
        marks: list[Primitive] = []
        for kind in dict.fromkeys(points["kind"][is_marked].tolist()):
            q = np.unique(points["q"][is_marked & (points["kind"] == kind)])
            # (marks, inputs), with the only input.
            marked_inputs = q[:, None]
            colour = COLOUR_OF_KIND[kind]
            label = name_kind(kind)
            marks.append(InputMarks(f"marks/{kind}", label, marked_inputs, colour))
        return marks

    @cached_property
    def curve_lines(self) -> dict[tuple[int, int], Floats]:
        """Drawn points of all configuration curves, by indices of curve and output.

        A configuration curve consists of all configurations that one continuous motion
        passes. An output is the rotation of one link relative to another. Each value is an
        array (`POINTS_PER_CURVE`, 2) of input and output angles in rad. The points are
        equally spaced in arc length.
        """
        lines: dict[tuple[int, int], Floats] = {}
        sampled = self.sampled
        for number, curve in enumerate(sampled.curves):
            s = _drawn_arc_lengths(curve.length)
            for output in range(len(self.names)):
                angle = sampled.output_angle(number, output, s)
                # If a pair (joint) connects the links of the output, the output angle is
                # the angle of the pair, drawn in (-pi, pi]. Without a pair, the output
                # angle is counted from the start of the curve and includes whole
                # revolutions.
                if self._has_pair(output):
                    angle = wrap(angle)
                q = sampled.input_at(number, s)
                lines[number, output] = np.stack([q, angle], axis=1)
        return lines

    def _has_pair(self, output: int) -> bool:
        """Return whether an R pair connects the two links of an output."""
        links = self.sampled.report.outputs[output]
        mechanism = self.sampled.position_analysis.mechanism
        return mechanism.angle_between(*links) is not None

    def _points_on_line(self, curve: int, output: int, s: Floats) -> Floats:
        """Return the points (k, 2) of a drawn curve at arc lengths s (k,).

        The line shows the output angle over the input along a configuration curve. A point
        has both angles in rad. Without a pair between the links of the output, the output
        angle is interpolated between the drawn points.
        """
        if self._has_pair(output):
            angle = wrap(self.sampled.output_angle(curve, output, s))
        else:
            drawn_s = _drawn_arc_lengths(self.sampled.curves[curve].length)
            angle = np.interp(s, drawn_s, self.curve_lines[curve, output][:, 1])
        return np.stack([self.sampled.input_at(curve, s), angle], axis=1)

    def _input_output_plot(self, output: int, rows: slice) -> Portrait:
        """Return a plot of an output angle against the input angle.

        The plot shows all configuration curves, marks at singularities, and a point that
        moves along the rows of the batch. Curves are drawn over one period of the input.
        The input of the moving point is shifted by whole periods onto the curve.

        Parameters
        ----------
        output
            Index of the output among all outputs.
        rows
            Rows of the batch at which the moving point is drawn.
        """
        sampled = self.sampled
        name = self.names[output]
        curve_numbers = range(len(sampled.curves))
        # (rows, 2) input and output. Rows that could not be assigned to a curve have the
        # curve number -1. Their points remain NaN and are not drawn.
        curve_of_row = sampled.curve[rows]
        row_points = np.full((len(curve_of_row), 2), np.nan)
        for number in curve_numbers:
            is_on_curve = curve_of_row == number
            s = sampled.s[rows][is_on_curve]  # arc lengths along the curve
            points = self._points_on_line(number, output, s)
            # `_points_on_line` shifts all inputs into one period, which begins at the
            # first drawn point. A row at the end of the period would be shifted to its
            # beginning. The inputs q of rows in the first period therefore stay unchanged.
            q = self.batch.q[rows][is_on_curve]
            points[:, 0] = np.where(sampled.is_in_first_period(number, q), q, points[:, 0])
            row_points[is_on_curve] = points
        marks = []
        for point in sampled.report.points:
            if point.output != sampled.report.outputs[output]:
                continue
            (position,) = self._points_on_line(point.curve, output, np.array([point.s]))
            # A mark needs a place, but a failed point of a curve is NaN.
            if np.all(np.isfinite(position)):
                colour = COLOUR_OF_KIND[str(point.type)]
                marks.append(Mark(name_kind(str(point.type)), position, colour))
        curves = []
        for number in curve_numbers:
            line = break_at_jumps(self.curve_lines[number, output])
            curves.append(PlaneCurve(line, CURVE_COLOUR))
        return plot_plane(
            f"plots/input_output/{name.replace('/', '_')}",
            f"output {name} against the input",
            row_points,
            (f"input {self.batch.moving_inputs[0]}", f"output {name}"),
            curves,
            marks,
        )

    def _gallery(self) -> Scene:
        """Return a page that draws the singularities: sample k shows singularity k.

        A drawing has the links, six pole axes and two planes. A pole axis is the axis of
        the relative rotation of two links. The six axes are those of any two of four links:
        the input link, its reference, the output link and a fourth link, such as the
        reference of the output. The three axes of any three of these links are in one
        plane, which gives four planes. Two of the four planes coincide at a singularity,
        and these two are drawn. They depend on the type of the singularity, see
        `_coinciding_planes`.

        Curves that are singular as a whole are left out.
        """
        # A singular point has an arc length s on its curve. A whole curve has NaN.
        has_point = np.isfinite(self.points["s"])
        points = {name: column[has_point] for name, column in self.points.items()}
        six_poles = self._poles_of_singularities(points)
        rotations = self._link_rotations(points)
        parts: list[Primitive] = [
            *link_bodies(self.sampled.position_analysis.mechanism, rotations),
            *_pole_arrows(six_poles),
            *_coinciding_planes(six_poles, points["kind"], self._have_four_links(points)),
            Text("list", "Singularities", _gallery_text(points)),
        ]
        sample_axis = Axis("singularity", "", np.arange(float(len(points["s"]))))
        return Scene("Singularities", tuple(parts), (sample_axis,))

    def _have_four_links(self, points: Mapping[str, Any]) -> NDArray[np.bool_]:
        """Return whether (n,) input and output have four different links.

        `points` are columns of the table of singularities, with the name of the output.
        """
        links_by_name = dict(zip(self.names, self.sampled.report.links, strict=True))
        return np.array(
            [len(links_by_name[name]["i"].different) == 4 for name in points["output"]],
            dtype=bool,
        )

    def _link_rotations(self, points: Mapping[str, Any]) -> Floats:
        """Return the orientations (n, links, 3, 3) of all links at n singularities.

        `points` are columns of the table of singularities, with the number of a
        configuration curve and the arc length on the curve.
        """
        return np.stack(
            [
                self.sampled.configuration(curve, s)
                for curve, s in zip(points["curve"].tolist(), points["s"], strict=True)
            ]
        )

    def _poles_of_singularities(self, points: Mapping[str, Any]) -> SixPoles:
        """Return the six pole axes of input and output at n singularities, to be drawn.

        A pole axis is the axis of the relative rotation of two links. The six axes are
        those of any two of four links: the input link i, its reference r, the output link o
        and a link s. The axis of links o and s is named `os`, and so on.

        The axes belong to a relation c y' = d q'. Here q' is the rate of the input, and c
        and d are computed from the axes. There are two forms of the relation:

        - Form i: y' is the rate of o relative to s, which is the reference of the output.
        - Form ii: y' is the rate of o relative to r, and s may be another link. This form
          does not exist if the output link is one of the two links of the input.

        The result has the axes of form ii at singularities where this form exists, else
        those of form i.

        Parameters
        ----------
        points
            Columns of the table of singularities. ``curve`` is the number of a curve of
            configurations, and ``s`` the arc length (rad) along the curve.
        """
        poles_of_each: list[SixPoles] = []
        curves = points["curve"].tolist()
        for curve, s, name in zip(curves, points["s"], points["output"], strict=True):
            # The relations, one or two forms, of this output at this point of the curve.
            curve_relations = self.sampled.report.evaluate_relations(
                curve, s[None], self.names.index(name)
            )
            relation_by_form = {
                relation.form: relation for relation in curve_relations.relations
            }
            if "ii" in relation_by_form:
                relation = relation_by_form["ii"]
            else:
                relation = relation_by_form["i"]
            poles_of_each.append(relation.poles)
        # `LABEL_OF_AXIS` has the names of the six axes.
        axes_by_name = {
            name: np.concatenate([getattr(poles, name) for poles in poles_of_each])
            for name in LABEL_OF_AXIS
        }
        return SixPoles(**axes_by_name)


def _pole_arrows(six_poles: SixPoles) -> list[Primitive]:
    """Return an arrow along each pole axis that is defined at some singularity."""
    arrows: list[Primitive] = []
    for name, label in LABEL_OF_AXIS.items():
        axes = getattr(six_poles, name)
        if np.any(np.isfinite(axes)):
            arrow = Arrow(f"pole/{name}", label, axes, primary=False, path_shown=False)
            arrows.append(arrow)
    return arrows


def _drawn_arc_lengths(length: float) -> Floats:
    """Return the arc lengths of the drawn points of a curve of a length (rad)."""
    # The last point is just before the end, where a closed curve would begin again.
    return np.linspace(0.0, length * (1.0 - 1e-12), POINTS_PER_CURVE)


def _coinciding_planes(
    six_poles: SixPoles, kinds: Any, have_four_links: NDArray[np.bool_]
) -> list[Primitive]:
    """Return two great circles at each singularity, which show that two planes coincide.

    A pole axis is the axis of relative rotation of two links. Six pole axes are those of
    any two of four links: the input link, its reference, the output link and a fourth link,
    usually the reference of the output. The three pole axes of any three of these links are
    in one plane. At a singularity, two of these planes coincide:

    - At type I (the output rests while the input moves) they depend on whether input
      and output, with their references, are four different links.
    - At type II (the input rests while the output moves) they are always the same two.

    `AXES_OF_PLANES` lists the axes of these planes. Singularities of other types are drawn
    with the planes of type II.

    Parameters
    ----------
    six_poles
        The pole axes at n singularities.
    kinds
        (n,) the types of the singularities as texts.
    have_four_links
        (n,) whether the links of input and output, with their references, are four
        different links.
    """
    is_type_1 = np.array([kind == "I" for kind in kinds], dtype=bool)
    planes: list[Primitive] = []
    # A triplet is three links with their three pole axes in one plane.
    for number, label in enumerate(("one triplet", "the other")):
        # The second result of `plane`, a measure of accuracy, is not needed.
        normals, _ = six_poles.plane(AXES_OF_PLANES["II"][number])
        for key, is_drawn in (
            ("I", is_type_1 & ~have_four_links),
            ("I with four links", is_type_1 & have_four_links),
        ):
            normals_at_type_1, _ = six_poles.plane(AXES_OF_PLANES[key][number])
            normals[is_drawn] = normals_at_type_1[is_drawn]
        planes.append(GreatCircle(f"plane/{number}", f"plane of {label}", normals))
    return planes


def _gallery_text(points: Mapping[str, Any]) -> str:
    """Return the text, in Markdown, of the page that draws singularities one by one.

    The text has a table of the singularities, and a note on each that names the axes or
    planes that coincide. Singularity k is called "sample" k.

    Parameters
    ----------
    points
        Columns of the table of singularities, with a row for each drawn singularity.
    """
    lines = []
    for row, q in enumerate(np.degrees(points["q"])):
        cells = (
            points["kind"][row],
            points["condition"][row],
            points["assembly_mode"][row],
            f"{q:.4f}",
            points["output"][row],
        )
        lines.append(f"| {row} | {' | '.join(cells)} |")
    notes = [f"- sample {row}: {note}" for row, note in enumerate(points["note"]) if note]
    return "\n".join([GALLERY_HEADER, *lines, "", "What coincides:", "", *notes])


def _describe_crossing(point: SingularPoint) -> list[str]:
    """Return how many curves cross, and which curves end at the crossing."""
    curve_count = 0 if point.crossing is None else len(point.crossing.tangents)
    numbers = sorted({curve for curve, _ in point.places})
    return [
        f"{counted(curve_count, 'curve')} cross" if curve_count else "curves end",
        f"ends of curves {_join_numbers(numbers, ', ')}",
    ]


def _describe_claim(claim: Completeness) -> str:
    """Return in words whether curves of configurations may have been missed."""
    if claim.guarantee in (Guarantee.CERTIFIED, Guarantee.COMPLETE):
        return "no other curves exist"
    if claim.guarantee is Guarantee.TO_BOX:
        return (
            f"curves over less than {number_text(np.degrees(claim.box), digits=3)} deg of "
            "the input could be missed"
        )
    return f"further curves could be missed: {claim.reason}"


def _count_kinds(kinds: Any) -> dict[str, int]:
    """Return how often each kind occurs in a column (n,) of kinds, sorted by kind."""
    return dict(sorted(Counter(kinds.tolist()).items()))


def _format_counts(counts: Mapping[str, int]) -> str:
    """Return the counts of singularities by kind in words, such as ``2 of type II``."""
    return ", ".join(f"{count} {of_kind(kind)}" for kind, count in counts.items())


def _join_numbers(numbers: Iterable[int], separator: str = "+") -> str:
    """Return numbers as one text, such as ``0+2``."""
    return separator.join(str(number) for number in numbers)


def _near_miss_record(miss: NearMiss, names: Sequence[str]) -> dict[str, Any]:
    """Return a near miss as a record of the summary.

    `names` are the names of the outputs by position.
    """
    return {
        "type": str(miss.type),
        "output": names[miss.output],
        "assembly_modes": list(miss.assembly_modes),
        "q_rad": miss.q,
        "angle_rad": miss.angle,
        "velocity_coefficient": miss.velocity_coefficient,
    }
