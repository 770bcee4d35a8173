"""Pole axes and velocity coefficients of links relative to each other."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from spherekit.plugin import (
    ASSEMBLY_MODE,
    INPUT,
    RESIDUAL,
    SAMPLE,
    STATUS,
    AbstractAnalysis,
    AnalysisError,
    Arrow,
    Batch,
    Column,
    FigureOfMerit,
    Floats,
    GreatCircle,
    Mechanism,
    Needs,
    Pole,
    Primitive,
    Scene,
    Series,
    Status,
    Table,
    TableData,
    all_poles,
    parse_pole,
    pole_of,
)

from .gnomonic_chart import (
    ChartAxis,
    chart_axes,
    chart_coordinates,
    circle_coordinates,
)
from .pole_drawings import draw_axodes, draw_chart, draw_construction, short_name

MAX_POLES_SHOWN_FIRST = 6
"""With more poles than this, only some poles are visible when a drawing is opened: axes of
pairs, poles relative to the ground and the pole with great circles. Larger: drawings of
large mechanisms are crowded."""


CHART_MEANINGS = {
    "xi": "coordinate of the pole in the gnomonic chart (a projection of the sphere onto a "
    "plane): arctan(y/x), where x, y and z are the components of the pole in the axes "
    "of the chart",
    "zeta": "coordinate of the pole in the gnomonic chart (a projection of the sphere onto "
    "a plane): arctan(z/x), where x, y and z are the components of the pole in the axes "
    "of the chart",
    "circle_1_epsilon": "slope angle, in the gnomonic chart, of the first of the two "
    "great circles that determine the pole",
    "circle_1_theta": "angle between the x axis of the chart and the plane of the first "
    "great circle; positive if the circle is above the origin of the chart",
    "circle_2_epsilon": "slope angle, in the gnomonic chart, of the second of the two "
    "great circles that determine the pole",
    "circle_2_theta": "angle between the x axis of the chart and the plane of the second "
    "great circle; positive if the circle is above the origin of the chart",
}
"""Meanings of the columns of the gnomonic chart. Axes of pairs have no great circles."""


class MovingPole(NamedTuple):
    """A pole (axis of relative rotation of two links) while one input moves.

    The other inputs are locked. The pole depends on the input that moves.

    Attributes
    ----------
    first_link, second_link
        Indices of the links. The pole belongs to the motion of the second link relative
        to the first.
    input_number
        Position of the moving input among the inputs.
    """

    first_link: int
    second_link: int
    input_number: int


@dataclass(frozen=True, kw_only=True)
class Poles(AbstractAnalysis):
    """Pole axis, velocity coefficient and its derivative for pairs of links.

    With several inputs, one input at a time moves while the others are locked, so that
    the mechanism has one degree of freedom. If all inputs move, their motions add up
    (superposition).

    Parameters
    ----------
    only
        Poles to compute, such as ``31+42``. By default all.
    circles
        Pole whose two great circles are drawn. By default the first one that is not the
        axis of a pair.
    axodes
        Poles whose axodes are drawn: the cones that roll on each other while the input
        moves. The mechanism must have one input, or all others must be locked.
    chart
        Adds the coordinates of the poles in the gnomonic chart to the table. With ``x``,
        ``y`` or ``z``, the chart touches the sphere at the end of this ground axis. With
        ``yes``, this is the axis that the drawn chart uses: the one nearest to the mean
        direction of the pair axes on the ground. With ``no``, nothing is added.
    """

    name = "poles"
    version = "2"
    summary = "pole axes and velocity coefficients of all pairs of links"
    cites = (
        "R. Di Gregorio, Proc. IMechE C 225(9), 2011, 2062-2075",
        "R. Di Gregorio, Mechanism and Machine Theory 2024, 105720, eqs. (3), (5), (8)",
    )
    rowwise = True
    tables = (
        Table(
            "poles",
            "one row per sample, assembly mode, moving input and pair of links",
            (
                SAMPLE,
                ASSEMBLY_MODE,
                INPUT,
                Column("link", "", "link whose motion is described", "text"),
                Column(
                    "relative_to",
                    "",
                    "link relative to which the motion is described",
                    "text",
                ),
                *(
                    Column(
                        f"u{axis}",
                        "",
                        f"{axis} component of the unit vector u along the pole axis "
                        "(the instantaneous axis of rotation), in ground axes",
                        scale="absolute",
                        turns="vector",
                    )
                    for axis in "xyz"
                ),
                *(
                    Column(
                        f"du{axis}_dq",
                        "1/rad",
                        f"derivative of u{axis} with respect to q; empty if the "
                        "velocity coefficient k in this row is too small to determine "
                        "the derivative",
                        scale="none",
                        turns="vector",
                    )
                    for axis in "xyz"
                ),
                Column(
                    "velocity_coefficient",
                    "",
                    "velocity coefficient k: angular velocity of `link` relative to "
                    "`relative_to` about the pole axis u, divided by the rate of the "
                    "input q",
                ),
                Column(
                    "acceleration_coefficient",
                    "1/rad",
                    "acceleration coefficient: derivative of the velocity coefficient with "
                    "respect to q",
                ),
                Column(
                    "conditioning",
                    "",
                    "relative speed of the two links divided by the sum of their speeds; "
                    "a small value means that digits are lost, because nearly equal "
                    "velocities are subtracted; 1 if nothing is subtracted: for a pole "
                    "that is a pair axis, and for motion relative to the ground",
                    scale="none",
                ),
                Column(
                    "error_bound",
                    "rad",
                    "upper bound of the angular error of the pole axis u, caused by "
                    "rounding and by loops that do not close exactly",
                    scale="none",
                ),
                Column(
                    "velocity_coefficient_error_bound",
                    "",
                    "upper bound of the error of velocity_coefficient, caused by "
                    "rounding and by loops that do not close exactly",
                    scale="none",
                ),
                Column(
                    "acceleration_coefficient_error_bound",
                    "1/rad",
                    "upper bound of the error of acceleration_coefficient, caused by "
                    "rounding and by loops that do not close exactly",
                    scale="none",
                ),
                Column(
                    "direction_dq_error_bound",
                    "1/rad",
                    "upper bound of the error of the vector (dux_dq, duy_dq, duz_dq): "
                    "length of its difference from the exact vector, caused by "
                    "rounding and by loops that do not close exactly",
                    scale="none",
                ),
                RESIDUAL,
                STATUS,
                Column(
                    "moving",
                    "",
                    "driven pair that moves while the other inputs are locked",
                    "text",
                ),
                *(
                    Column(
                        name,
                        "rad",
                        f"{meaning}; computed only if the parameter `chart` is given",
                        scale="none",
                        turns="otherwise",
                        on_request="chart",
                    )
                    for name, meaning in CHART_MEANINGS.items()
                ),
            ),
        ),
    )

    only: tuple[str, ...] = ()
    circles: str = ""
    axodes: tuple[str, ...] = ()
    chart: ChartAxis = "no"

    def poles(self, mechanism: Mechanism) -> tuple[Pole, ...]:
        """Return the poles of interest as pairs of link numbers."""
        if self.only:
            return tuple(dict.fromkeys(parse_pole(mechanism, text) for text in self.only))
        return all_poles(len(mechanism.links))

    def pole_with_circles(self, mechanism: Mechanism) -> Pole | None:
        """Return the pole whose great circles are drawn, None if all poles are of pairs."""
        if self.circles:
            return parse_pole(mechanism, self.circles)
        for pole in self.poles(mechanism):
            if pole not in mechanism.pole_pairs:
                return pole
        return None

    def merits(self, mechanism: Mechanism) -> tuple[FigureOfMerit, ...]:
        """Return the largest velocity coefficients, as figures of merit to compare designs.

        A velocity coefficient is the relative angular velocity of two links per unit rate
        of the input. The figures are for the poles in `only`. By default they are for the
        motions of the declared outputs or, without outputs, of all links relative to the
        ground.
        """
        names = mechanism.links
        # A relative motion is a link and its reference link. Pole (i, j) belongs to the
        # motion of link j relative to link i.
        if self.only:
            relative_motions = [(names[j], names[i]) for i, j in self.poles(mechanism)]
        else:
            relative_motions = [
                (output.link, output.relative_to) for output in mechanism.outputs
            ] or [(link, names[0]) for link in names[1:]]
        inputs = mechanism.input_pairs
        # With several inputs, one input moves at a time. The figures are named by this
        # input.
        suffixes = {"": ""}
        if len(inputs) > 1:
            suffixes = {f"_by_{pair}": f" by input {pair} alone" for pair in inputs}
        return tuple(
            FigureOfMerit(
                f"largest_coefficient_{link}_{reference}{suffix}",
                "max",
                f"abs(velocity_coefficient_{link}_{reference}{suffix})",
                meaning=(
                    f"largest velocity ratio of link {link} relative to link {reference}"
                    f"{condition}"
                ),
            )
            for link, reference in relative_motions
            for suffix, condition in suffixes.items()
        )

    def needs(self, mechanism: Mechanism) -> Needs:
        """Return the quantities that a run has to compute for this analysis.

        A pole is the axis about which one link turns relative to another. If it is not the
        axis of a pair (joint), it is constructed as the intersection of two great circles.
        A page can show this construction step by step.

        The fields are:

        - `directions`: poles whose direction is computed.
        - `rates`: poles whose velocity coefficient is computed. It is the relative angular
          velocity per unit rate of the input.
        - `derivatives`: yes, the velocity coefficients are differentiated with respect to
          the input.
        - `turns`: poles whose direction is differentiated with respect to the input.
        - `planes`: poles whose two great circles are computed. Figures show the circles of
          one selected pole. A drawing of the construction needs the circles of all
          constructed poles. Coordinates in a chart (projection of the sphere onto a plane)
          need the same circles.
        - `rotations`: all links if the construction is drawn, otherwise the links with a
          drawn axode. An axode is the path of a pole in the axes of a link.
        """
        axode_poles = self._axode_poles(mechanism)
        poles = frozenset(self.poles(mechanism)) | frozenset(axode_poles)
        pole_with_circles = self.pole_with_circles(mechanism)
        draws_construction = self._draws_construction(mechanism)
        has_chart = self.chart != "no"

        planes: frozenset[Pole] = frozenset()
        if pole_with_circles is not None:
            planes = frozenset([pole_with_circles])
        if draws_construction or has_chart:
            planes |= poles - set(mechanism.pole_pairs)

        rotations = {mechanism.links[link] for pole in axode_poles for link in pole}
        if draws_construction:
            rotations = set(mechanism.links)  # the drawing shows all links

        return Needs(
            directions=poles,
            rates=poles,
            derivatives=True,
            planes=planes,
            turns=poles,
            rotations=frozenset(rotations),
        )

    def _axode_poles(self, mechanism: Mechanism) -> tuple[Pole, ...]:
        """Return the poles whose axodes are drawn.

        Raises
        ------
        AnalysisError
            If axodes are requested and several inputs move. A run computes each pole for
            the motion of one input while the others rest. An axode of the motion by all
            inputs together would need other poles.
        """
        if self.axodes and len(mechanism.inputs) > 1:
            first, *others = mechanism.input_pairs
            locks = " ".join(f"--lock {pair}=VALUE" for pair in others)
            raise AnalysisError(
                f"{mechanism.name}: poles: axodes are drawn for one moving input, but this "
                f"mechanism has {len(mechanism.inputs)}. Lock all others, such as {locks} "
                f"for the motion by {first}"
            )
        return tuple(dict.fromkeys(parse_pole(mechanism, text) for text in self.axodes))

    def _draws_construction(self, mechanism: Mechanism) -> bool:
        """Return whether the construction of the poles is drawn step by step.

        The mechanism must have one input, and the user must want all poles (`only` is
        empty).
        """
        return not self.only and len(mechanism.inputs) == 1

    def compute(self, batch: Batch) -> Mapping[str, TableData]:
        """Return the table `poles`: the axes about which links turn relative to each other.

        A row of the batch is a sample in one assembly mode (way to assemble the links). The
        pole of two links depends on which input moves. So for each row of the batch, the
        table has a row for each combination of a pole and an input that moves alone.
        """
        # A moving pole is such a combination.
        moving_poles = self._list_moving_poles(batch)
        columns = dict[str, Any]()
        # Names of the links, axes, and coefficients of velocity and acceleration.
        columns |= batch.pole_columns(moving_poles)
        # The value q of the input that moves. The column has the values of all moving poles
        # at the first row of the batch, then those at the second row, and so on.
        moving_input_values = [batch.inputs[:, pole.input_number] for pole in moving_poles]
        columns["q"] = batch.interleaved(moving_input_values)
        columns |= _make_accuracy_columns(batch, moving_poles)
        columns |= _make_direction_derivative_columns(batch, moving_poles)
        # The user can ask for coordinates in a chart, a projection of the sphere onto a
        # plane.
        if self.chart != "no":
            columns |= self._make_chart_columns(batch, moving_poles)
        (table,) = self.requested_tables()
        return {"poles": {column.name: columns[column.name] for column in table.columns}}

    def _list_moving_poles(self, batch: Batch) -> list[MovingPole]:
        """Return the poles of interest for each moving input, one input after another."""
        return [
            MovingPole(first_link, second_link, input_number)
            for input_number in range(len(batch.moving_inputs))
            for first_link, second_link in self.poles(batch.mechanism)
        ]

    def _make_chart_columns(
        self, batch: Batch, moving_poles: Sequence[MovingPole]
    ) -> dict[str, Any]:
        """Return the columns of the table with the coordinates of poles in the chart.

        Further columns have the coordinates of the great circles of the poles. A pole is
        the axis about which two links turn relative to each other. A pole that is not the
        axis of a pair (joint) is the intersection of two great circles. The chart is a
        projection of the sphere from its centre onto a plane.

        Parameters
        ----------
        batch
            The rows, with the great circles of these poles.
        moving_poles
            The poles, each with the input that moves while the other inputs rest.

        Returns
        -------
        The columns by name, with the names of `CHART_MEANINGS`.
        """
        mechanism = batch.mechanism
        # Indices of the ground axes that are called x, y and z in the chart.
        axes = list(chart_axes(mechanism, self.chart))
        values_by_name: dict[str, list[Floats]] = {name: [] for name in CHART_MEANINGS}
        for pole in moving_poles:
            coordinates = [*chart_coordinates(batch.direction(*pole)[:, axes])]
            # In the chart a great circle is a straight line. Its two coordinates are the
            # angles epsilon of its slope, and theta of its distance from the origin. The
            # axis of a pair has no circles, so its four columns are empty.
            if (pole.first_link, pole.second_link) in mechanism.pole_pairs:
                coordinates += [np.full(len(batch), np.nan)] * 4
            else:
                normals = batch.planes(*pole)
                for circle in (0, 1):
                    coordinates += circle_coordinates(normals[:, circle][:, axes])
            for name, values in zip(CHART_MEANINGS, coordinates, strict=True):
                values_by_name[name].append(values)
        # Each column has the values of all poles in the first row of the batch, then those
        # in the second row, and so on.
        return {name: batch.interleaved(values) for name, values in values_by_name.items()}

    def scene(self, batch: Batch) -> tuple[Scene, ...]:
        """Return a page for each assembly mode, and one for the construction of the poles.

        An assembly mode is one way to assemble the mechanism. The page of a mode has arrows
        along the poles, and the two great circles that intersect in a selected pole. Plots
        show the velocity coefficients (rates of rotation per unit rate of the input).

        The last page shows, at one configuration, how the pole axes follow step by step
        from the axes of the pairs (joints) by intersections of great circles. This page
        exists only if the mechanism has one input and the user wants all poles.
        Only the first block of a long motion has the page, and only if it has a row with
        the status OK.
        """
        pages = []
        for mode, rows in batch.assembly_mode_rows().items():
            parts: list[Primitive] = []
            # Poles depend on which input moves, so there are drawings for each input.
            for input_number in range(len(batch.moving_inputs)):
                parts += self._draw_mode(batch, rows, input_number)
            pages.append(Scene(mode, tuple(parts)))
        good_rows = np.flatnonzero(batch.status == Status.OK)
        is_first_block = batch.sample[0] == 0
        draws_construction = self._draws_construction(batch.mechanism)
        if len(good_rows) and is_first_block and draws_construction:
            modes = batch.assembly_mode[good_rows]
            rows_of_first_mode = good_rows[modes == modes[0]]
            # Any row of the first mode is suitable, for example the one a third of the way
            # along.
            row = rows_of_first_mode[len(rows_of_first_mode) // 3]
            pages.append(draw_construction(batch, int(row), self.chart))
        return tuple(pages)

    def _draw_mode(
        self, batch: Batch, rows: slice, input_number: int
    ) -> Iterator[Primitive]:
        """Yield the drawing of one assembly mode while one input moves, the others locked.

        A pole is the axis about which two links turn relative to each other. The drawing
        has an arrow along each pole, with plots of the coefficients, and axodes, which are
        paths of poles. The chart and two great circles show the construction of one pole.

        Parameters
        ----------
        batch, rows
            The batch, and its rows with the assembly mode.
        input_number
            Position of the moving input among the inputs.
        """
        mechanism = batch.mechanism
        moving_input = batch.moving_inputs[input_number]
        has_several_inputs = len(batch.moving_inputs) > 1
        folder = f"{moving_input}/" if has_several_inputs else ""
        by_input = f" by {moving_input}" if has_several_inputs else ""
        poles = self.poles(mechanism)
        pole_with_circles = self.pole_with_circles(mechanism)
        has_many_poles = len(poles) > MAX_POLES_SHOWN_FIRST

        # 1. Arrows, plots and axodes.
        for pole in poles:
            yield from self._draw_arrow(batch, rows, input_number, pole)
            yield from self._plot_coefficients(batch, rows, input_number, pole)
        if input_number == 0:
            for pole in self._axode_poles(mechanism):
                yield from draw_axodes(batch, pole, rows)
        if pole_with_circles is None:
            return

        # 2. The chart, with the two great circles (n, 2, 3) of one pole.
        normals = batch.planes(*pole_with_circles, input_number)[rows]
        # Poles of pairs come last, to be drawn on top. In both groups, poles relative to
        # the ground (link 0) come first.
        charted_poles = sorted(
            poles, key=lambda pole: (pole in mechanism.pole_pairs, pole[0] != 0)
        )
        directions = np.stack(
            [batch.direction(*pole, input_number)[rows] for pole in charted_poles], axis=1
        )
        yield draw_chart(
            mechanism,
            charted_poles,
            directions,
            normals,
            moving_input=moving_input if has_several_inputs else "",
            chart=self.chart,
        )

        # 3. The great circles on the sphere.
        if has_many_poles and input_number > 0:
            return
        for number in (0, 1):
            yield GreatCircle(
                f"construction/{folder}circle_{number}",
                f"great circle {number + 1} of "
                f"P{short_name(mechanism, pole_with_circles)}{by_input}",
                normals[:, number],
            )

    def _draw_arrow(
        self, batch: Batch, rows: slice, input_number: int, pole: Pole
    ) -> Iterator[Arrow]:
        """Yield the arrow along the axis about which two links turn relative to each other.

        At most one arrow is yielded. The axis of a pair (joint) does not depend on which
        input moves, so its arrow is drawn only for the first input. In mechanisms of many
        links some arrows are hidden until the user selects them.

        Parameters
        ----------
        batch, rows
            The batch, and its rows with one assembly mode (way to assemble the links).
        input_number
            Position of the moving input among the inputs.
        pole
            The indices of the two links.
        """
        mechanism = batch.mechanism
        # Whether the pole is the axis of a pair that joins the two links.
        is_pair_axis = pole in mechanism.pole_pairs
        if input_number > 0 and is_pair_axis:
            return
        first_link, second_link = pole
        first_name = mechanism.links[first_link]
        second_name = mechanism.links[second_link]
        moving_input = batch.moving_inputs[input_number]
        has_several_inputs = len(batch.moving_inputs) > 1
        # Of many arrows, three sorts are visible when a drawing is opened: axes of pairs,
        # poles relative to the ground (link 0), and the pole whose great circles are drawn.
        # The last two sorts are visible only for the first input.
        has_few_poles = len(self.poles(mechanism)) <= MAX_POLES_SHOWN_FIRST
        if has_few_poles or is_pair_axis:
            is_visible = True
        else:
            is_relative_to_ground = first_link == 0
            has_circles = pole == self.pole_with_circles(mechanism)
            is_visible = input_number == 0 and (is_relative_to_ground or has_circles)
        has_short_names = all(len(name) == 1 for name in mechanism.links)
        if has_short_names:
            label = f"P{short_name(mechanism, pole)}"
        else:
            label = f"{second_name}/{first_name}"
        if has_several_inputs and not is_pair_axis:
            label += f" by {moving_input}"
        folder = f"{moving_input}/" if has_several_inputs else ""
        # (rows of this mode, 3) unit vectors along the pole axis.
        directions = batch.direction(first_link, second_link, input_number)[rows]
        path = f"pole/{folder}{second_name}_{first_name}"
        yield Arrow(path, label, directions, primary=is_pair_axis, shown=is_visible)

    def _plot_coefficients(
        self, batch: Batch, rows: slice, input_number: int, pole: Pole
    ) -> Iterator[Series]:
        """Yield plots of the velocity and acceleration coefficients of a pole.

        The velocity coefficient is the relative angular velocity of the two links per unit
        rate of the moving input. The acceleration coefficient is the derivative of the
        velocity coefficient with respect to this input. Nothing is yielded for the input
        itself, and for links that the locked inputs join.

        Parameters
        ----------
        batch, rows
            The batch, and its rows with one assembly mode.
        input_number
            Position of the moving input among the inputs.
        pole
            The indices of the two links.
        """
        mechanism = batch.mechanism
        pair = batch.moving_inputs[input_number]
        has_several_inputs = len(batch.moving_inputs) > 1
        first_link, second_link = pole
        first_name = mechanism.links[first_link]
        second_name = mechanism.links[second_link]
        input_pole = pole_of(*mechanism.ends[mechanism.pair_number[pair]])
        body = batch.plans[input_number].body
        if pole == input_pole or body[first_link] == body[second_link]:
            return
        has_short_names = all(len(name) == 1 for name in mechanism.links)
        velocity = batch.velocity_coefficient(*pole, input_number)
        acceleration = batch.acceleration_coefficient(*pole, input_number)
        velocity_label = f"{second_name}/{first_name}"
        if has_short_names:
            output_name = short_name(mechanism, pole)
            velocity_label = f"ω{output_name}/ω{short_name(mechanism, input_pole)}"
        acceleration_label = f"({velocity_label})′" if has_short_names else velocity_label
        if not batch.has_continuous_sign(*pole, input_number):
            # The axis, and so the sign of the coefficient, may be reversed between
            # neighbours in a grid of inputs. So the absolute value of the coefficient is
            # drawn, with its derivative.
            acceleration = np.where(velocity < 0.0, -acceleration, acceleration)
            velocity = np.abs(velocity)
            velocity_label = f"|{velocity_label}|"
            acceleration_label = f"{velocity_label}′" if has_short_names else velocity_label
        is_to_ground = first_link == 0
        kind = ""
        if len(self.poles(mechanism)) > MAX_POLES_SHOWN_FIRST:
            kind = " to ground" if is_to_ground else " between links"
        title = f"{pair} moves: " if has_several_inputs else ""
        name = (
            f"{pair}/{second_name}_{first_name}"
            if has_several_inputs
            else f"{second_name}_{first_name}"
        )
        link = second_link if is_to_ground else None
        yield Series(
            f"plots/velocity/{name}",
            label=velocity_label,
            group=f"{title}velocity coefficients{kind}",
            values=velocity[rows],
            unit="",
            link=link,
        )
        yield Series(
            f"plots/acceleration/{name}",
            label=acceleration_label,
            group=f"{title}acceleration coefficients{kind}",
            values=acceleration[rows],
            unit="1/rad",
            link=link,
        )


def _make_direction_derivative_columns(
    batch: Batch, moving_poles: Sequence[MovingPole]
) -> dict[str, Any]:
    """Return, by column, the derivatives of poles with respect to the moving input."""
    make_column = batch.of_poles(moving_poles)
    return {
        f"du{axis}_dq": make_column("direction_dq", component)
        for component, axis in enumerate("xyz")
    }


def _make_accuracy_columns(
    batch: Batch, moving_poles: Sequence[MovingPole]
) -> dict[str, Any]:
    """Return the error bounds and the conditioning of poles, by name.

    The velocity coefficient is the relative angular velocity per unit rate of the input q.
    The acceleration coefficient and ``direction_dq`` are the derivatives of this
    coefficient and of the pole direction with respect to q.

    The conditioning is the relative speed of the two links divided by the sum of their
    speeds. If it is small, digits cancel in the difference of their angular velocities.

    Parameters
    ----------
    batch
        The rows.
    moving_poles
        The poles (axes of relative rotation of two links), each while one input moves.
    """
    make_column = batch.of_poles(moving_poles)
    names = (
        "conditioning",
        "error_bound",
        "velocity_coefficient_error_bound",
        "acceleration_coefficient_error_bound",
        "direction_dq_error_bound",
    )
    # None: these quantities are single numbers, not components of vectors.
    return {name: make_column(name, None) for name in names}
