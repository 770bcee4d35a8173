"""The analysis `singularities` of mechanisms with several inputs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from spherekit.plugin import (
    Axis,
    Batch,
    Findings,
    Floats,
    Mark,
    Mechanism,
    Output,
    PlaneCurve,
    Portrait,
    Primitive,
    Scene,
    ScreenColumn,
    ScreenTable,
    SphereCurves,
    Surface,
    counted,
    degrees_text,
    input_columns,
    numbered,
)
from spherekit.plugin.rotations import wrap
from spherekit.plugin.singularities import (
    Aspects,
    Completeness,
    CurveSeen,
    LockedInputSection,
    LocusName,
    OutputCoefficients,
    RowType,
    SingularCurves,
    SingularPoints,
    SingularSurface,
    TimeLimit,
    aspects,
    coefficients,
    cut,
    mid_plane_loci,
    moved_by_all,
    output_of,
    ranges_of,
    singular_curves,
    singular_surface,
    solver_of,
    what_vanishes,
)

from .scenes import (
    COLOUR_OF_KIND,
    SELF_MOTION,
    break_at_jumps,
    name_kind,
    plot_plane,
    relation_plots,
)
from .tables import (
    ASPECTS,
    RELATION,
    SINGULARITIES,
    angle_from_sine,
    configuration_columns,
    of_kind,
)

Columns = dict[str, Any]
"""Columns of a table, or one row of it, by the names of columns."""

OUTPUT_KINDS: tuple[LocusName, ...] = ("II", "I")
"""Kinds of singularities that are searched for every output."""
SLICE_TIME_SHARE = 0.4
"""Part of the time limit that slices (searches with all inputs but one locked) may
take. The rest is for following loci and aspects. Larger: more loci are found; smaller:
more of each locus is followed."""
SAME_TYPE_THREE_POINT_RAD = 1e-6
"""Points of type III whose variables differ by less are one point, met on two curves.
Larger: points near each other are listed once; smaller: one point is listed twice."""
ANGLE_DECIMALS = 9
"""Decimals of an angle in degrees that are not rounding."""
DEFAULT_SLICES = 12
"""Default number of values at which each of two inputs is locked in mechanisms of
dyads. Larger: smaller loci are found, in more time."""
EDGES_PER_RANGE = 4.0
"""Smallest number of edges of the first mesh along the narrowest range of an input, unless
`mesh` is longer. Larger: smaller triangles, and more time."""
MAX_EDGE_HALVINGS = 2
"""Largest number of times that the edges are halved afterwards, with vertices on the
surface. Larger: finer surfaces, in more time."""
PARTS_PER_CHORD = 8
"""Parts into which each chord between two nodes of a drawn curve is divided. Larger:
smoother curves."""
LONGEST_EDGE_RAD = np.radians(15.0)
"""Longest edge of the first mesh, unless `mesh` is longer."""
MAX_OUTPUT_FREEDOMS = 3
"""Largest number of degrees of freedom of an output."""
CURVE_INPUT_COUNT = 2
"""With this number of inputs, singular configurations of one kind form curves."""
SURFACE_INPUT_COUNT = 3
"""With this number of inputs, singular configurations of one kind form surfaces."""
DEFAULT_ASPECT_SAMPLES = 11
"""Values of each input for aspects by default. Larger: narrow aspects are found, in more
time."""


EFFECTS: Mapping[str, str] = {
    "I": "the output loses a direction of motion",
    "II": "the locked inputs do not hold the output",
    SELF_MOTION: "links move while inputs and output rest",
}
"""What each kind of singularity means for the mechanism."""
EFFECTS_EVERYWHERE: Mapping[str, str] = {
    **EFFECTS,
    "I": "the inputs can always move while the output rests",
}
"""What a kind of singularity means if it occurs in every configuration."""
MAX_LISTED_REACHES = 4
"""Number of curves or surfaces whose inputs are printed; the table of points has all."""


def no_aspects(mechanism: Mechanism) -> str:
    """Return why a mechanism of more than three inputs has no aspects."""
    return (
        f"an output has at most {MAX_OUTPUT_FREEDOMS} degrees of freedom, so with "
        f"{len(mechanism.inputs)} inputs it can always rest, and no configuration is "
        "free of type I"
    )


Locus = SingularCurves | SingularSurface
"""The singularities of one kind: curves of two inputs, surfaces of three."""


@dataclass(frozen=True)
class SearchResult:
    """The results of all searches for singularities that share the time limit.

    Attributes
    ----------
    loci
        The loci (curves or surfaces of singular configurations), by the name of the
        output.
    aspects
        The aspects (connected sets of configurations without singularities), or None if
        the user does not want aspects.
    """

    loci: dict[str, list[Locus]]
    aspects: Aspects | None


@dataclass(frozen=True)
class SeveralInputs:
    """Singularities of a mechanism with several inputs, and of the rows of a run.

    Attributes
    ----------
    batch
        The rows: one for each sample of each assembly mode.
    slices
        Number of values at which each input is locked to search for singular curves and
        surfaces. With 0 nothing is searched. By default (None) slices are used for
        mechanisms of dyads (groups of two links) with two inputs. Other mechanisms are
        searched from random starts.
    mesh
        Length (rad) of the edges of surfaces, 0 for no surfaces; None for the default.
    input_grid
        Number of values of each input for aspects, 0 for none. By default (None) 11 if the
        mechanism has at most three inputs.
    near
        A warning is given if the angle (deg) in the column ``distance_I`` or
        ``distance_II`` is at most this. The angle is 0 only at a singularity.
    seconds
        Processor time (s) that the searches may take.
    """

    batch: Batch
    slices: int | None
    mesh: float | None
    input_grid: int | None
    near: float
    seconds: float

    @cached_property
    def slice_count(self) -> int:
        """The number of values of each input for slices, 0 for random starts.

        A slice is the set of configurations in which all inputs but one are locked.
        Searches for singular curves and surfaces start from slices, or from random
        configurations.
        """
        if self.slices is not None:
            return self.slices
        has_two_inputs = len(self.batch.moving_inputs) == 2
        if has_two_inputs and self.batch.tracer.assembly.has_closed_form:
            return DEFAULT_SLICES
        return 0

    @cached_property
    def first_edge_and_halvings(self) -> tuple[float, int]:
        """Edge length (rad) of the first mesh of surfaces, and number of its halvings.

        With three inputs, the singular configurations are surfaces in the space of the pair
        variables. Each surface is covered by a coarse mesh of triangles. All edges of the
        mesh are then halved several times. The user can choose the length `mesh` after the
        last halving. Without a choice (None) the first mesh is as coarse as is allowed, and
        is halved as often as is allowed. With the length 0 no surfaces are computed.
        """
        last_edge = self.mesh
        if last_edge == 0.0:
            return 0.0, 0
        # Ranges of the inputs (rad). Several edges must fit into the narrowest range.
        widths = [
            abs(driven_input.stop - driven_input.start)
            for driven_input in self.batch.mechanism.inputs
        ]
        longest = min(LONGEST_EDGE_RAD, min(widths) / EDGES_PER_RANGE)
        if last_edge is None:
            return longest, MAX_EDGE_HALVINGS
        # The first edge is `last_edge`, doubled as often as the result is at most
        # `longest`. A longer `last_edge` is not doubled.
        halvings = int(np.clip(np.log2(longest / last_edge), 0, MAX_EDGE_HALVINGS))
        first_edge = last_edge * 2**halvings
        return first_edge, halvings

    @cached_property
    def points(self) -> Columns:
        """The main table: points of singular curves or surfaces, by output.

        - If every configuration has a kind of singularity, this kind has a single row.
        - A surface has one row for each vertex of its mesh.
        - A curve has one row for each of its points. Points of type III, which are of types
          I and II at once, have a further row as type III.

        The set of all singular points of one kind is called a locus. The `claim` of a locus
        states how complete the search was, for example certified or only sampled. The
        column `inside` states whether all inputs are within their declared ranges. The
        column `curve` has a number for each curve of an output, or for each connected
        surface of an output.
        """
        tables: list[Columns] = []
        for output in self.batch.mechanism.outputs:
            name = name_output(self.batch.mechanism, output)
            curve_number = 0
            # (k, variables) points of type III that have a row already. A curve of type I
            # and one of type II pass through such a point; the first adds the row.
            listed_values = np.zeros((0, len(self.batch.mechanism.variable_names)))
            for locus in self.loci[output.name]:
                if locus.everywhere:
                    tables.append(
                        {
                            "kind": locus.kind,
                            # Configurations with inputs within their ranges are
                            # singular, too.
                            "inside": "yes",
                            "residual": 0.0,
                            "output": name,
                            "curve": -1,  # no curve
                            **_certainty_columns(locus.claim),
                            "note": "in every configuration",
                        }
                    )
                elif isinstance(locus, SingularSurface):
                    columns = self._point_columns(locus.points, output, locus.claim)
                    components = locus.component
                    columns["curve"] = curve_number + components
                    curve_number += len(np.unique(components))
                    columns["note"] = "vertex of a surface"
                    tables.append(columns)
                else:
                    for curve in locus.curves:
                        tables += self._curve_tables(
                            curve, curve_number, output, locus.claim, listed_values
                        )
                        # `curve.both` has the points of type III on the curve.
                        listed_values = np.concatenate([listed_values, curve.both.values])
                        curve_number += 1
        return SINGULARITIES.stacked(self.batch.mechanism, tables)

    def _curve_tables(
        self,
        curve: CurveSeen,
        number: int,
        output: Output,
        claim: Completeness,
        listed_values: Floats,
    ) -> list[Columns]:
        """Return the rows of a singular curve, and of its points of type III.

        Points of type III are of types I and II at once. Each point is on a curve of type I
        and on a curve of type II, but is listed only once.

        Parameters
        ----------
        curve, number
            A curve of singular configurations of type I or II, and its number. `curve.s`
            are arc lengths of its points (rad) in the space of all pair variables.
            `curve.why` is the geometric reason of the singularity in words, if it is the
            same on the whole curve. `curve.both` has the points of type III on the curve.
        output
            The output.
        claim
            How complete the search for curves was.
        listed_values
            (k, variables) points of type III of this output that are listed already (rad).
        """
        columns = self._point_columns(curve.points, output, claim)
        columns["curve"] = number
        columns["s"] = curve.s
        columns["note"] = "closed" if curve.closed else "open"
        if curve.why:
            columns["condition"] = curve.why
        tables = [columns]

        points_of_type_3 = curve.both
        # Array axes: point of this curve, listed point, variable.
        differences = np.abs(wrap(points_of_type_3.values[:, None] - listed_values))
        is_listed = np.any(np.max(differences, axis=2) < SAME_TYPE_THREE_POINT_RAD, axis=1)
        if not np.all(is_listed):
            new_points = points_of_type_3.rows(~is_listed)
            both_types = self._point_columns(new_points, output, claim)
            both_types["kind"] = "III"
            both_types["note"] = "of both types"
            both_types["curve"] = number
            tables.append(both_types)
        return tables

    def _point_columns(
        self, points: SingularPoints, output: Output, claim: Completeness
    ) -> Columns:
        """Return columns of singular points of an output.

        Parameters
        ----------
        points
            n singular configurations. `inside` states whether all inputs are within their
            declared ranges. If the output is a direction of a link, `pointing` has this
            direction. If the output is the orientation of a link, `pointing` is None.
        output
            The output.
        claim
            How complete the search for such points was, for example certified or only
            sampled.

        Returns
        -------
        Columns (n,) by name. `condition` is the geometric reason of the singularity, such
        as three axes in one plane. `residual` is the larger of two errors: by how much the
        loops are open (rad), and the rates that should be zero at the singularity.
        """
        batch = self.batch
        mechanism = self.batch.mechanism
        links = (
            mechanism.link_number[output.link],
            mechanism.link_number[output.relative_to],
        )
        return {
            "kind": [RowType(code).label for code in points.type],
            "condition": self._describe_conditions(points, output),
            **input_columns(mechanism, points.inputs),
            **configuration_columns(batch, points.values, links, points.pointing),
            "inside": np.where(points.inside, "yes", "no"),
            "output": name_output(mechanism, output),
            "residual": points.residual,
            **_certainty_columns(claim),
        }

    def _describe_conditions(self, points: SingularPoints, output: Output) -> list[str]:
        """Return the geometric condition of each singular point as a text for the table.

        An example is that the pole axes of several inputs are in one plane. A pole axis is
        the axis of a relative rotation of two links.

        Parameters
        ----------
        points
            n singular configurations.
        output
            The output that is singular there.
        """
        position_analysis = self.batch.tracer
        # The orientations of all links at these configurations.
        motion = position_analysis.given(points.values)
        # Linear equations in the rates of all variables, which are satisfied if the output
        # rests.
        output_equations = output_of(self.batch.mechanism, output.name)
        # `what_vanishes` tests which pole axes coincide or are in one plane.
        # `points.pointing` are the directions of the output, None if the output is an
        # orientation. `by_rank` is true if constraints are redundant. The degrees of
        # freedom then follow from the rank of the velocity equations, because counting
        # links and pairs fails. The pole axes are found by the same rule.
        return what_vanishes(
            motion,
            output_equations,
            pointing=points.pointing,
            by_rank=position_analysis.by_rank,
        )

    @cached_property
    def relation(self) -> Columns:
        """The table of relations c_i w_i = d_i q_i' and of the nearness of singularities.

        q_i' is the rate of input i, which moves while the others are locked. w_i is the
        angular velocity of the output about its pole axis.

        The table has every row of the batch once for each output and input.
        """
        batch = self.batch
        tables: list[Columns] = []
        for output in batch.mechanism.outputs:
            for input_number in range(len(batch.moving_inputs)):
                tables.append(self._relation_columns(output, input_number))
        return RELATION.stacked(batch.mechanism, tables)

    def _relation_columns(self, output: Output, input_number: int) -> Columns:
        """Return the columns of the relation of an output and one input that moves alone.

        The input moves at the rate q' while the others are locked. The output then turns
        about its pole axis u (axis of relative rotation) with the angular velocity y' u.
        The relation is c y' = d q'. At singularities of type II c is 0, at those of type I
        d is 0.

        Parameters
        ----------
        output
            The output.
        input_number
            Index of the input among the moving inputs.
        """
        batch = self.batch
        # Coefficients, rates and distances of all n rows, arrays (n, inputs, ...).
        rows = self.coefficients[output.name]
        angular_velocities = rows.w[:, input_number]  # (n, 3) vectors per unit rate q'
        pole_axes = rows.u[:, input_number]  # (n, 3) unit vectors
        return {
            "sample": batch.sample,
            "assembly_mode": batch.assembly_mode,
            **input_columns(batch.mechanism, batch.inputs),
            "output": name_output(batch.mechanism, output),
            # In form "i", y' is relative to the reference link of the output. Only
            # mechanisms with one input can also have rows of the form "ii".
            "form": "i",
            # Angles that are 0 at singularities of type I, and of type II.
            "distance_I": angle_from_sine(rows.type_one),
            "distance_II": angle_from_sine(rows.type_two),
            # The smallest singular value of the loop equations with all inputs locked. It
            # is 0 if a link can move although the inputs are locked.
            "sigma": rows.hold,
            # The ratio of the smallest to the largest singular value of the same equations.
            "reciprocal_condition": rows.reciprocal_condition,
            "status": batch.status,
            # Type of the singularity, such as I or II, or regular.
            "type": [RowType(code).label for code in rows.type],
            # Which motion is singular. 1: the motion of a single input while the others
            # are locked. 2: only a motion of several inputs. 0: not type I, II or III.
            "group": rows.group,
            "moving": batch.moving_inputs[input_number],
            "c": rows.c[:, input_number],
            "d": rows.d[:, input_number],
            "velocity_coefficient": np.vecdot(angular_velocities, pole_axes),
            # Speed of the output and rate of the input. Both are scaled such that the rates
            # of all pairs form a unit vector, so they are finite at singularities.
            "output_rate": rows.output_rate[:, input_number],
            "input_rate": rows.input_rate[:, input_number],
        }

    @property
    def aspects(self) -> Columns:
        """The table of aspects: configurations over a grid of input values.

        An aspect is a connected set of configurations without singularities. Each row of
        the table has the inputs of a configuration and the number of its aspect. The other
        columns describe the whole aspect. `sign_II` is the sign of a determinant that is 0
        at singularities of type II, `sign_I` that of one that is 0 at type I.
        `assembly_modes` is the largest number of configurations of the aspect at one sample
        of the inputs.
        """
        # None if the user does not want aspects.
        found_aspects = self._search_result.aspects
        mechanism = self.batch.mechanism
        if found_aspects is None:
            return ASPECTS.stacked(mechanism)
        # (n,) number of the aspect of each configuration. `sign_two`, `sign_one` and
        # `modes` have one value for each aspect.
        aspect = found_aspects.label
        columns = {
            "aspect": aspect,
            **input_columns(mechanism, found_aspects.inputs),
            "sign_II": found_aspects.sign_two[aspect],
            "sign_I": found_aspects.sign_one[aspect],
            "assembly_modes": found_aspects.modes[aspect],
        }
        return ASPECTS.stacked(mechanism, [columns])

    def findings(self) -> Findings:
        """Return which singularities and aspects exist, and rows near singularities.

        A locus is the set of all singular configurations of one kind: curves if there are
        two inputs, surfaces if there are three. An aspect is a connected set of
        configurations without singularities.

        - The summary of each output has the kinds that occur in every configuration, the
          number of curves or of vertices of surfaces, and the guarantee of each search.
        - The table for the screen has the number of curves or surfaces of each kind, and
          the inputs that they reach over.
        - Warnings concern rows near a singularity.
        - Remarks describe everything else.
        """
        batch = self.batch
        summary: dict[str, Any] = {"slices": self.slice_count}
        warnings: list[str] = []
        remarks: list[str] = []
        table_rows: list[tuple[str, ...]] = []
        is_singular_everywhere = False
        for output in batch.mechanism.outputs:
            # 1. Loci.
            name = name_output(batch.mechanism, output)
            name_in_words = f"{output.name} ({output.link}/{output.relative_to})"
            loci = self.loci[output.name]
            kinds_everywhere = [locus.kind for locus in loci if locus.everywhere]
            is_singular_everywhere |= bool(kinds_everywhere)
            remarks += [
                f"The output {name_in_words} has singularities {of_kind(kind)} in every "
                f"configuration ({EFFECTS_EVERYWHERE[kind]})."
                for kind in kinds_everywhere
            ]
            summary[name] = {"everywhere": sorted(kinds_everywhere)}
            for locus in loci:
                if locus.everywhere:
                    continue
                suffix = locus.kind.replace("-", "_")
                for key, value in _summarize_locus(locus).items():
                    summary[name][f"{key}_{suffix}"] = value
                table_rows.append((name_in_words, *self._locus_cells(locus)))
                remarks += _describe_search(locus, name_in_words)

            # 2. Rows of the motion: assembly modes that are singular in every row, by the
            # type, and rows near a singularity.
            rows = self.coefficients[output.name]
            singular_modes = {} if kinds_everywhere else _singular_modes(batch, rows)
            for kind, modes in singular_modes.items():
                remarks.append(
                    f"The output {name_in_words} has singularities {of_kind(kind)} in "
                    f"every row of {numbered('assembly mode', modes)}."
                )
            for kind, sines in (("I", rows.type_one), ("II", rows.type_two)):
                if kind not in kinds_everywhere:
                    # Modes of type III are of both types.
                    modes = [
                        *singular_modes.get(kind, []),
                        *singular_modes.get(RowType.III.label, []),
                    ]
                    warnings += self._warn_of_near_rows(kind, name_in_words, sines, modes)

        # 3. Aspects.
        if self.input_grid is None and len(batch.mechanism.inputs) > MAX_OUTPUT_FREEDOMS:
            remarks.append(f"There are no aspects: {no_aspects(batch.mechanism)}.")
        found_aspects = self._search_result.aspects
        if found_aspects is not None:
            summary["aspects"] = found_aspects.sizes.tolist()
            summary["aspects_guarantee"] = found_aspects.guarantee
            summary["singular_on_lattice"] = found_aspects.singular
            # Aspects are expected unless every configuration is singular.
            has_none_unexpectedly = (
                len(found_aspects.sizes) == 0 and not is_singular_everywhere
            )
            if len(found_aspects.sizes) or found_aspects.note or has_none_unexpectedly:
                remark = (
                    f"{counted(len(found_aspects.sizes), 'aspect')} (sets of "
                    "configurations within which no singularity is passed)"
                )
                if found_aspects.singular:
                    remark += (
                        f"; {counted(found_aspects.singular, 'configuration')} met are "
                        "singular"
                    )
                if found_aspects.note:
                    remark += f"; {found_aspects.note}"
                remarks.append(f"{remark}.")
        # 4. Accuracy.
        residuals = np.asarray(self.points["residual"], dtype=float)
        if np.any(residuals > 0.0):
            remarks.append(
                "The geometric conditions of the listed singular configurations are met to "
                f"{np.nanmax(residuals):.0e} (sine of the deviation)."
            )
        tables = (_locus_table(table_rows),) if table_rows else ()
        return Findings(summary, tuple(warnings), tuple(remarks), tables)

    def _locus_cells(self, locus: Locus) -> tuple[str, ...]:
        """Return the cells of a table row about a locus (all singularities of one kind).

        The cells are the kind, the number of curves or surfaces inside and outside of the
        ranges of the inputs, and the range of each input that they span. Surfaces are
        computed only inside the ranges, so their number outside is "-".
        """
        inputs = self.batch.moving_inputs
        kind = f"{name_kind(locus.kind)} ({EFFECTS[locus.kind]})"
        if isinstance(locus, SingularSurface):
            components = np.unique(locus.component)
            count_text = counted(len(components), "surface") if len(components) else "none"
            parts = [locus.points.inputs[locus.component == part] for part in components]
            return kind, count_text, "-", _reach_text(parts, inputs)
        parts = []
        for curve in locus.curves:
            if np.any(curve.points.inside):
                # The computed points of a curve are too far apart to show where it leaves
                # the ranges, so points between them are added.
                points = self._dense_points(curve)
                parts.append(points.inputs[points.inside])
        count_text = counted(len(parts), "curve") if parts else "none"
        outside = len(locus.curves) - len(parts)
        outside_text = counted(outside, "curve") if outside else "none"
        return kind, count_text, outside_text, _reach_text(parts, inputs)

    def _warn_of_near_rows(
        self, kind: str, output: str, sines: Floats, singular_modes: Sequence[int]
    ) -> list[str]:
        """Return a warning if rows (configurations) come near a type of singularity.

        The list is empty if no row comes near.

        Parameters
        ----------
        kind, output
            Type I or II, and the output in words.
        sines
            (n,) measure of each row from 0 to 1, which is 0 at a singularity of this type.
            It is the sine of the angle in the column ``distance_I`` or ``distance_II``.
        singular_modes
            Assembly modes (ways to assemble the links) that are singular of this type in
            every row. Their rows are left out.
        """
        batch = self.batch
        is_left_out = np.isin(batch.assembly_mode, singular_modes)
        angles_deg = np.where(is_left_out, np.nan, np.degrees(angle_from_sine(sines)))
        is_near = angles_deg <= self.near
        if not np.any(is_near):
            return []
        row = int(np.nanargmin(angles_deg))
        inputs = ", ".join(
            f"{pair} = {degrees_text(q)}"
            for pair, q in zip(batch.moving_inputs, batch.inputs[row], strict=True)
        )
        modes = numbered("assembly mode", np.unique(batch.assembly_mode[is_near]))
        # Adding 0.0 changes -0.0 to 0.0.
        nearest_deg = round(angles_deg[row], ANGLE_DECIMALS) + 0.0
        return [
            f"Samples of {modes} come within {self.near:g} deg of type {kind} of output "
            f"{output}, where {EFFECTS[kind]}. The nearest one is {nearest_deg:.3g} deg "
            f"away, in assembly mode {batch.assembly_mode[row]} at {inputs} deg."
        ]

    @property
    def loci(self) -> dict[str, list[Locus]]:
        """The loci (sets of singular configurations) by name of the output."""
        return self._search_result.loci

    @cached_property
    def _search_result(self) -> SearchResult:
        """The results of all searches: types II and I, self-motions, and aspects.

        In a self-motion links move while inputs and output rest. Self-motions are not
        searched if all pairs take part in the motion of the output, because type II then
        includes them. An aspect is a connected set of configurations without singularities.
        Each search gets an equal share of the remaining time.

        Singular configurations of one kind are curves if there are two inputs, surfaces if
        there are three. With other numbers of inputs only aspects are searched.
        """
        # 1. The searches: kind of singularity and name of the output.
        mechanism = self.batch.mechanism
        input_count = len(mechanism.inputs)
        time_limit = TimeLimit(self.seconds)
        outputs = [output.name for output in mechanism.outputs]
        aspect_samples = self.input_grid
        if aspect_samples is None:
            has_aspects = input_count <= MAX_OUTPUT_FREEDOMS
            aspect_samples = DEFAULT_ASPECT_SAMPLES if has_aspects else 0

        searches: list[tuple[LocusName, str]] = []
        # Surfaces are covered with triangles. An edge of length 0 stands for no surfaces.
        first_edge, _ = self.first_edge_and_halvings
        has_curves = input_count == CURVE_INPUT_COUNT
        has_surfaces = input_count == SURFACE_INPUT_COUNT and first_edge > 0.0
        # The parameter `slices` is 0 if the user wants no searches, None if it is not
        # given.
        if self.slices != 0 and (has_curves or has_surfaces):
            for name in outputs:
                for kind in OUTPUT_KINDS:
                    searches.append((kind, name))
            for name in outputs:
                if not moved_by_all(mechanism, name):
                    searches.append((SELF_MOTION, name))

        # 2. Slices: curves of configurations with all inputs but one locked, from which all
        # searches start. `slice_count` is `slices` or its default, which may be 0. Without
        # slices the searches start from random configurations.
        section = None
        if self.slice_count and searches:
            share = time_limit.part(SLICE_TIME_SHARE, "slices")
            solver = solver_of(mechanism)
            section = cut(solver, ranges_of(mechanism), self.slice_count, share)

        # 3. The loci of each output: curves or surfaces of singular configurations.
        loci: dict[str, list[Locus]] = {name: [] for name in outputs}
        for number, (kind, name) in enumerate(searches):
            # Number of searches that remain, including the search for aspects.
            remaining = len(searches) - number + (aspect_samples > 0)
            share = time_limit.part(1.0 / remaining, f"singularities {of_kind(kind)}")
            loci[name].append(self._search_locus(kind, name, section, share))

        # 4. The aspects.
        if not aspect_samples:
            return SearchResult(loci, None)
        share = time_limit.part(1.0, "aspects")
        found_aspects = aspects(
            mechanism,
            samples=aspect_samples,
            free_of=OUTPUT_KINDS,
            output=outputs[0],
            budget=share,
        )
        return SearchResult(loci, found_aspects)

    def _search_locus(
        self,
        kind: LocusName,
        output: str,
        section: LockedInputSection | None,
        time_limit: TimeLimit,
    ) -> Locus:
        """Search the singularities of one kind.

        With two inputs, the singular configurations are curves. With three inputs, they are
        surfaces. A slice consists of the configurations with all inputs but one locked. The
        search starts from singular configurations in slices.

        Parameters
        ----------
        kind, output
            The kind, and the name of the output.
        section
            The slices, which have been computed before. With None the search uses no
            slices, but starts from random configurations.
        time_limit
            Processor time to spend.
        """
        mechanism = self.batch.mechanism
        # `slices_of_each=0` says that no other slices than `section` are computed.
        if len(mechanism.inputs) == SURFACE_INPUT_COUNT:
            # A coarse mesh of triangles covers a surface. All edges are then halved several
            # times.
            edge, halvings = self.first_edge_and_halvings
            return singular_surface(
                mechanism,
                kind,
                output,
                side=edge,
                halved=halvings,
                slices_of_each=0,
                made=section,
                budget=time_limit,
            )
        # In a mid-plane architecture, the leg axes at the output link are the mirror image
        # of those at the base, also while the mechanism moves. The normal of the mirror
        # plane determines the configuration, up to a choice of two for each leg.
        # `mid_plane_loci` finds the singular curves of types I and II as curves of normals.
        # It returns None for other mechanisms. It is not used if there are slices.
        if section is None and kind != SELF_MOTION:
            curves = mid_plane_loci(mechanism, kind, output, time_limit)
            if curves is not None:
                return curves
        return singular_curves(
            mechanism, kind, output, slices_of_each=0, made=section, budget=time_limit
        )

    @cached_property
    def coefficients(self) -> dict[str, OutputCoefficients]:
        """Coefficients and types of the rows for each output, by the name of the output."""
        position_analysis = self.batch.tracer
        mechanism = self.batch.mechanism
        return {
            output.name: coefficients(
                self.batch.motion,
                output_of(mechanism, output.name),
                position_analysis.by_rank,
            )
            for output in mechanism.outputs
        }

    def scenes(self) -> tuple[Scene, ...]:
        """Return a page of singular surfaces, and one page for each assembly mode.

        An assembly mode is one way to assemble the links. Its page has plots of the
        coefficients c and d of the relation c w = d q' between the rates of output and
        input, and of distances to singularities.

        With two inputs, the singular configurations are curves. Each page of an assembly
        mode shows all curves, in the plane of the two inputs and as paths of the output's
        direction on the sphere. With three inputs, the singular configurations are
        surfaces. They are drawn in the space of the three inputs, on the first page.
        """
        pages = []
        surfaces = self._draw_surfaces()
        if surfaces:
            # Surfaces are the same at all samples of the run, so their page has only one.
            single_sample = Axis("surfaces", "", np.zeros(1))
            pages.append(Scene("Singular surfaces", surfaces, (single_sample,)))
        for mode, rows in self.batch.assembly_mode_rows().items():
            parts: list[Primitive] = []
            for output in self.batch.mechanism.outputs:
                loci = [
                    locus
                    for locus in self.loci[output.name]
                    if isinstance(locus, SingularCurves) and locus.curves
                ]
                if loci:
                    parts.append(self._draw_in_input_plane(output, loci, rows))
                    parts += self._draw_on_sphere(output, loci)
            # The coefficients and distances are columns of the table `relation`.
            parts += relation_plots(self.relation, len(self.batch), rows)
            pages.append(Scene(mode, tuple(parts)))
        return tuple(pages)

    def _draw_surfaces(self) -> tuple[Surface, ...]:
        """Return drawings of the singular surfaces, in the space of the three inputs."""
        surfaces = []
        for output in self.batch.mechanism.outputs:
            for mesh in self.loci[output.name]:
                if not isinstance(mesh, SingularSurface) or not len(mesh.triangles):
                    continue
                # Only mechanisms with three inputs have surfaces.
                a, b, c = self.batch.moving_inputs
                surfaces.append(
                    Surface(
                        f"plots/surface/{output.name}/{mesh.kind}",
                        f"{name_kind(mesh.kind)} of {output.name}",
                        vertices=mesh.points.inputs,
                        triangles=mesh.triangles,
                        axes=(a, b, c),
                        tone=COLOUR_OF_KIND[mesh.kind],
                        unit="rad",
                    )
                )
        return tuple(surfaces)

    def _draw_in_input_plane(
        self, output: Output, loci: Sequence[SingularCurves], rows: slice
    ) -> Portrait:
        """Return a drawing of an output's singular curves in the plane of both inputs.

        A moving point shows the inputs of the motion. Points of type III, which are of
        types I and II at once, are marked.

        Parameters
        ----------
        output
            The output.
        loci
            Its singular curves of each kind.
        rows
            The rows of the batch (configurations of the motion) at which the moving point
            is drawn.
        """
        curves = []
        marks = []
        for locus in loci:
            colour = COLOUR_OF_KIND[locus.kind]
            for curve in locus.curves:
                # Further points between the computed ones make the drawn lines smooth.
                line = break_at_jumps(self._dense_points(curve).inputs)
                curves.append(PlaneCurve(line, colour, name_kind(locus.kind)))
                # `both` are the points of type III on the curve.
                marks += _mark_type_three(curve.both.inputs)
        first, second = self.batch.moving_inputs
        return plot_plane(
            f"plots/inputs/{output.name}",
            f"singular curves of {output.name} in the inputs",
            rows=self.batch.inputs[rows],
            axes=(first, second),
            curves=curves,
            marks=marks,
            # Points that extend the axes of the drawing: the inputs in all rows of the
            # batch.
            further_points=[self.batch.inputs],
        )

    def _draw_on_sphere(
        self, output: Output, loci: Sequence[SingularCurves]
    ) -> list[Primitive]:
        """Return drawings of the singular curves of an output on the sphere.

        The path of the output's direction along a singular curve is a curve on the sphere.
        A singular configuration allows a motion in which the output (type I) or all inputs
        (type II) rest. Points of type III, which are of both types at once, are marked.
        `loci` are the singular curves of each kind.
        """
        parts: list[Primitive] = []
        for locus in loci:
            # Further points between the computed ones make the drawn lines smooth.
            lines = [
                _output_directions(self._dense_points(curve)) for curve in locus.curves
            ]
            marks = []
            for curve in locus.curves:
                # `both` are the points of type III on the curve.
                marks += _mark_type_three(_output_directions(curve.both))
            parts.append(
                SphereCurves(
                    f"singular/{output.name}/{locus.kind}",
                    f"{name_kind(locus.kind)} of {output.name}",
                    lines,
                    COLOUR_OF_KIND[locus.kind],
                    marks,
                )
            )
        return parts

    def _dense_points(self, curve: CurveSeen) -> SingularPoints:
        """Return points of a curve that are dense enough to draw it, computed once."""
        key = ("dense", id(curve))
        return self.batch.once(key, lambda: curve.dense(PARTS_PER_CHORD))


def _mark_type_three(points: Floats) -> list[Mark]:
    """Return marks of type III at points (k, 2) of a plane or (k, 3) of the sphere."""
    return [Mark("type III", point, COLOUR_OF_KIND["III"]) for point in points]


def _output_directions(points: SingularPoints) -> Floats:
    """Return the direction of the output (n, 3), or its z axis if it has no direction."""
    return points.orientation[:, :, 2] if points.pointing is None else points.pointing


def _certainty_columns(claim: Completeness) -> Columns:
    """Return the columns on the certainty of the points of a locus.

    The points belong to a locus, the set of all singular configurations of one kind.
    `claim` says how complete the search for the locus was.
    """
    return {"double": "no", "certain": "yes", "guarantee": claim.guarantee.value}


def _summarize_locus(locus: Locus) -> dict[str, Any]:
    """Return numbers about a locus (all singularities of one kind), for the summary.

    The singularities are on curves or on surfaces. The entries for curves state how
    many curves are inside and outside of the ranges of the inputs. The entries for
    surfaces are:

    - ``vertices``: the number of vertices of the meshes that cover the surfaces.
    - ``irregular``: the number of singular configurations that were found, but at which no
      mesh can start. For example, surfaces cross there.

    The entry ``claim`` says in words how complete the search was.
    """
    if isinstance(locus, SingularSurface):
        return {
            "vertices": len(locus.nodes),
            "irregular": locus.irregular,
            "claim": locus.guarantee,
        }
    count = sum(bool(np.any(curve.points.inside)) for curve in locus.curves)
    outside = len(locus.curves) - count
    return {"curves": count, "curves_outside": outside, "claim": str(locus.claim)}


def _reach_text(parts: Sequence[Floats], inputs: Sequence[str]) -> str:
    """Return the ranges of the inputs over which curves or surfaces extend, as text.

    Parameters
    ----------
    parts
        (n, inputs) inputs (rad) of the points of each curve or surface.
    inputs
        Names of the inputs.
    """
    texts = []
    for points in parts:
        ranges = []
        # Degrees are rounded, because points are about a degree apart. Adding 0.0 changes
        # -0.0 to 0.0.
        lowest = np.round(np.degrees(np.min(points, axis=0))) + 0.0
        highest = np.round(np.degrees(np.max(points, axis=0))) + 0.0
        for pair, low, high in zip(inputs, lowest, highest, strict=True):
            low_text, high_text = f"{low:.0f}", f"{high:.0f}"
            range_text = low_text if low_text == high_text else f"{low_text} to {high_text}"
            ranges.append(f"{pair} = {range_text}")
        texts.append(", ".join(ranges))
    # Curves of several assembly modes (ways to assemble the links) can have the same
    # ranges.
    distinct_texts = list(dict.fromkeys(texts))
    listed = "; ".join(distinct_texts[:MAX_LISTED_REACHES])
    further = len(distinct_texts) - MAX_LISTED_REACHES
    return f"{listed} and {further} more" if further > 0 else listed or "-"


def _locus_table(rows: Sequence[tuple[str, ...]]) -> ScreenTable:
    """Return a table for the screen about the loci of singularities.

    A locus is the set of all singularities of one kind. It consists of curves or surfaces.
    The table has a row for each locus, with these columns:

    - "kind": the kind of the singularities, and what it means for the mechanism.
    - "in the ranges": the number of curves or surfaces in the ranges of the inputs.
    - "outside": the number of the other curves. Surfaces are computed only in the ranges.
    - "over the inputs, about (deg)": the intervals of input angles that the curves or
      surfaces in the ranges span.

    The name of a single output is in the title. Names of several outputs are a column.

    Parameters
    ----------
    rows
        For each locus the name of the output, then the cells of the columns.
    """
    columns = [
        ScreenColumn("kind"),
        ScreenColumn("in the ranges"),
        ScreenColumn("outside"),
        ScreenColumn("over the inputs, about (deg)"),
    ]
    outputs = list(dict.fromkeys(row[0] for row in rows))
    if len(outputs) == 1:
        title = f"Singularities of the output {outputs[0]} in the ranges of the inputs:"
        return ScreenTable(tuple(columns), tuple(row[1:] for row in rows), title)
    title = "Singularities of the outputs in the ranges of the inputs:"
    return ScreenTable((ScreenColumn("output"), *columns), tuple(rows), title)


def _describe_search(locus: Locus, output: str) -> list[str]:
    """Return sentences on how complete the search for a locus was, and what it left out.

    A locus is the set of all singular configurations of one kind. At irregular
    configurations no curve or surface could be followed, for example where curves cross.
    """
    if isinstance(locus, SingularSurface):
        shape = "surface"
        irregular = locus.irregular
        claim = locus.guarantee
    else:
        shape = "curve"
        # `stray` are the irregular configurations.
        irregular = len(locus.stray)
        claim = locus.claim.sentence or str(locus.claim)
    sentences = [f"Search for singularities {of_kind(locus.kind)} of {output}: {claim}."]
    if irregular:
        sentences.append(
            f"{counted(irregular, 'configuration')} {of_kind(locus.kind)} met are not on a "
            f"regular {shape}, and are not listed."
        )
    return sentences


def _singular_modes(batch: Batch, rows: OutputCoefficients) -> Mapping[str, list[int]]:
    """Return the assembly modes that are singular in every row, by their type.

    Rows of unknown type are ignored.
    """
    modes_by_type: dict[str, list[int]] = {}
    for mode, mode_rows in batch.assembly_mode_rows().items():
        types = set(rows.type[mode_rows].tolist()) - {RowType.UNKNOWN}
        if len(types) == 1 and types != {RowType.REGULAR}:
            label = RowType(types.pop()).label
            modes_by_type.setdefault(label, []).append(mode)
    return modes_by_type


def name_output(mechanism: Mechanism, output: Output) -> str:
    """Return the links of an output, such as ``4/1``.

    The first link is the output link, the second its reference link. The name of the output
    is added if another output has the same links.
    """
    links = f"{output.link}/{output.relative_to}"
    links_of_outputs = [
        f"{declared.link}/{declared.relative_to}" for declared in mechanism.outputs
    ]
    if links_of_outputs.count(links) == 1:
        return links
    return f"{links} {output.name}"
