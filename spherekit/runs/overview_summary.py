"""The overview of the motion of a run, as ``summary.json`` stores it."""

from collections.abc import Sequence

import numpy as np

from spherekit.conventions import Facts
from spherekit.runs.mode_overview import OutputOverview
from spherekit.runs.motion_overview import MotionOverview
from spherekit.runs.overview_plan import OverviewPlan
from spherekit.status import Status


def summarize_overview(overview: MotionOverview, plan: OverviewPlan) -> Facts:
    """Return the overview for the summary of a run.

    Parameters
    ----------
    overview
        The overview of all blocks of samples. Configurations that still wait to be examined
        are examined first.
    plan
        What was examined.

    Returns
    -------
    A mapping with these keys:

    - ``place``: what identifies a sample (time, first input or number), its name and unit.
    - ``place_range``: the places of the first and the last sample.
    - ``is_path``: whether successive samples are neighbours on a path.
    - ``examined_samples``: at how many samples outputs were examined.
    - ``ratio``: unit of the entries that end with ``_ratio``; empty for velocity ratios.
    - ``outputs``: their labels, links, whether they turn about a fixed axis, and the pair
      at which their transmission angle is taken.
    - ``modes``: for each mode, keyed by index: the spans, from place to place, in which the
      mechanism closes, the spans with statuses other than OK, the numbers of spans that
      these lists leave out, the least transmission angle of all dyads, and for each output
      the range of its angle, its velocity ratios, its least transmission angle and measure,
      how near it is to singularities of type I, and where it comes to rest.
      ``excess_between_samples`` has estimates by how much these extremes are exceeded
      between samples: the angle in rad, the ratio, and the transmission angle in rad (or
      the measure, if there is no such angle).
    """
    overview.examine_pending(plan)
    mechanism = plan.mechanism
    places = plan.places
    names: dict[str, tuple[str, str]] = {
        "time": ("t", "s"),
        "input": (mechanism.input_pairs[0], "rad"),
        "sample": ("sample", ""),
    }
    place_name, place_unit = names[plan.place_kind]

    def place_spans(spans: Sequence[Sequence[int]]) -> list[list[float]]:
        """Convert the sample numbers of spans [first, last] to the places of the samples.

        The place of a sample is its time, its first input or its number.
        """
        return [[float(places[first]), float(places[last])] for first, last in spans]

    sample_count = len(places)
    modes = {}
    for number, mode in overview.modes.items():
        least_of_all_dyads = None
        if mode.transmission is not None:
            angle, pair, place = mode.transmission
            least_of_all_dyads = _summarize_transmission(plan, angle, pair, place)
        closing = mode.closing_spans
        modes[number] = {
            "closes": place_spans(closing.listed),
            "closes_everywhere": closing.listed == [[0, sample_count - 1]],
            "unlisted_closing_spans": closing.unlisted_count,
            "statuses": {
                name: place_spans(spans.listed)
                for name, spans in mode.spans.items()
                if name != Status.OK.name
            },
            "unlisted_spans": {
                name: spans.unlisted_count
                for name, spans in mode.spans.items()
                if spans.unlisted_count
            },
            "least_transmission": least_of_all_dyads,
            "outputs": [
                {
                    "lowest_rad": output.lowest_rad,
                    "highest_rad": output.highest_rad,
                    "lowest_ratio": output.lowest_ratio,
                    "highest_ratio": output.highest_ratio,
                    "excess_between_samples": _summarize_excess(output),
                    "rests": output.rests,
                    "uncertain_rests": output.uncertain_rests,
                    "further_rests": output.further_rests,
                    "least_transmission": (
                        None
                        if output.transmission_angle is None or dyad is None
                        else _summarize_transmission(
                            plan,
                            output.transmission_angle[0],
                            plan.middle_pair(dyad),
                            output.transmission_angle[1],
                        )
                    ),
                    "least_transmission_measure": output.transmission,
                    "largest_transmission_measure": output.largest_transmission,
                    "inputs_of_least_measure_rad": (
                        None
                        if output.transmission is None
                        else _inputs_at(plan, output.transmission[1])
                    ),
                    "jacobian": _summarize_jacobian(plan, output),
                }
                for output, dyad in zip(mode.outputs, plan.joining_dyads, strict=True)
            ],
        }
    return {
        "place": {"kind": plan.place_kind, "name": place_name, "unit": place_unit},
        "place_range": [float(places[0]), float(places[-1])] if sample_count else [],
        "is_path": plan.is_path,
        "examined_samples": len(plan.examined_samples(0, sample_count)),
        "ratio": "rad/s" if plan.moves_over_time else "",
        "outputs": [
            {
                "name": output.name,
                "label": output.label,
                "link": mechanism.links[output.link],
                "relative_to": mechanism.links[output.reference],
                "fixed_axis": output.variable is not None,
                "points": output.direction is not None,
                "transmission_pair": None if dyad is None else plan.middle_pair(dyad),
            }
            for output, dyad in zip(plan.outputs, plan.joining_dyads, strict=True)
        ],
        "modes": modes,
    }


def _summarize_transmission(
    plan: OverviewPlan, angle: float, pair: str, place: float
) -> Facts:
    """Return a least transmission angle (rad), its pair, and where it occurs in the run.

    `place` is the time, the first input or the number of the sample; see `place_kind` of
    the plan.
    """
    return {
        "angle_rad": angle,
        "pair": pair,
        "place": place,
        "inputs_rad": _inputs_at(plan, place),
    }


def _summarize_excess(output: OutputOverview) -> Facts:
    """Return by how much true extremes may exceed the extremes in the overview.

    A quantity can have an extreme between two samples. Parabolas through the values at
    successive samples estimate such extremes (`SmoothExtremes`). The results are for the
    angle of an output (rad), its velocity ratio, and its transmission angle (rad) or
    transmission measure.
    """
    # There are two ways to estimate how far the angle goes beyond its range:
    # - If the rates along a path are known, the angle turns back where its rate changes
    #   sign. `turning_error_rad` is the largest estimated error of the angle there. No
    #   parabolas are made, and their excess is 0.
    # - Otherwise parabolas estimate it, and `turning_error_rad` is 0.
    parabola_excess = output.smooth_angle.excess(output.lowest_rad, output.highest_rad)
    angle_excess = max(parabola_excess, output.turning_error_rad)
    ratios = [
        smooth.excess(lowest, highest)
        for smooth, lowest, highest in zip(
            output.smooth_ratios, output.lowest_ratio, output.highest_ratio, strict=True
        )
    ]
    transmission = 0.0
    # Only small values of the transmission matter. With None, `excess` leaves out the
    # maximum.
    if output.transmission_angle is not None:
        least_angle = output.transmission_angle[0]
        transmission = output.smooth_transmission_angle.excess(least_angle, None)
    elif output.transmission is not None:
        least_measure = output.transmission[0]
        transmission = output.smooth_transmission.excess(least_measure, None)
    return {
        "angle_rad": angle_excess,
        "ratio": max(ratios, default=0.0),
        "transmission": transmission,
    }


def _summarize_jacobian(plan: OverviewPlan, output: OutputOverview) -> Facts | None:
    """Return how near an output comes to singularities of type I, None if it is unknown.

    At type I the smallest singular value of the output's velocity Jacobian is zero. Each
    sample has such a smallest singular value. The result has the least and the largest of
    them over all samples, and the place of the least. A place is a time, the first input or
    the number of a sample, see `place_kind` of the plan. Places of type I are those where
    the determinant of the Jacobian changes its sign. Only some of them are listed.
    `further_type_1_places` is the number of the others.
    """
    if output.gain is None:
        return None
    least, place, largest = output.gain
    return {
        "least_singular_value": least,
        "largest_least_singular_value": largest,
        "place": place,
        "inputs_rad": _inputs_at(plan, place),
        "type_1_places": output.type_1_places,
        "type_1_inputs_rad": [_inputs_at(plan, place) for place in output.type_1_places],
        "further_type_1_places": output.further_type_1_places,
    }


def _inputs_at(plan: OverviewPlan, place: float) -> list[float]:
    """Return the inputs (rad) at a place of the run, for the summary.

    A place is a time (s), a value of the first input (rad) or the number of a sample. The
    run decides which of these is used. Between samples of a path the inputs are
    interpolated. In a grid of inputs the place is the number of a sample.
    """
    if not plan.is_path:
        values: list[float] = plan.sampling.inputs[round(place)].tolist()
        return values
    places = plan.places
    inputs = plan.sampling.inputs
    if places[-1] < places[0]:
        # The input falls. `np.interp` needs places that rise.
        places = places[::-1]
        inputs = inputs[::-1]
    return [float(np.interp(place, places, column)) for column in inputs.T]
