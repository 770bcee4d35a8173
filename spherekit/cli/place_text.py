"""Texts of places of the motion: inputs, times or numbers of samples."""

import math
from collections.abc import Sequence
from typing import Any

from spherekit.number_text import degrees_text, number_text
from spherekit.wording import listing

MAX_LISTED_PLACES = 4
"""Places, such as inputs at which an output rests, that are listed in a cell or line."""

COARSE_STEP_DEG = 5.0
"""Distance of samples (deg) from which a note says that places of rest may be missed.

From this distance on, a place between two samples is also given as an interval.
"""


class PlaceText:
    """Texts of places of the motion of a run.

    A place identifies a sample, or a configuration between two samples. It is stored as the
    value of the first input (rad), which is printed in degrees, as the time (s) or as the
    number of a sample.

    Parameters
    ----------
    overview
        The entry ``overview`` of the summary of a run.

    Attributes
    ----------
    kind
        What a place is: "input", "time" or "sample".
    name, unit, heading
        Name and unit of places, and the heading of a column of places.
    sample_step
        Distance of two examined samples, in rad or s.
    step_words
        This distance as text, such as ``2 deg of input 21``; empty for numbers of samples.
    step_text
        The distance as text, such as ``10 deg``, if samples are so far apart that a place
        between two of them is uncertain (`COARSE_STEP_DEG`). Otherwise empty.
    between_decimals
        Number of decimals (deg) of a place that is interpolated between samples.
    """

    def __init__(self, overview: Any) -> None:
        """Compute the distance of samples, on which the texts of places depend."""
        place = overview["place"]
        self.kind: str = place["kind"]
        self.unit = {"rad": "deg"}.get(place["unit"], place["unit"])
        self.name: str = place["name"]
        if self.kind == "input":
            self.heading = f"input {self.name} (deg)"
        elif self.kind == "time":
            self.heading = "t (s)"
        else:
            self.heading = "sample"
        low, high = overview["place_range"] or (0.0, 0.0)
        intervals = max(overview["examined_samples"] - 1, 1)
        step = abs(high - low) / intervals
        self.sample_step = step
        if self.kind == "input":
            step = math.degrees(step)
        self.step_words = ""
        if self.kind != "sample" and step:
            unit = "deg" if self.kind == "input" else "s"
            name = f" of input {self.name}" if self.kind == "input" else ""
            self.step_words = f"{number_text(step, digits=3)} {unit}{name}"
        self.step_text = ""
        if self.kind == "input" and step >= COARSE_STEP_DEG:
            self.step_text = f"{number_text(step, digits=3)} deg"
        # Decimals of a place between samples that is an input (deg). Its error grows with
        # the square of the step (deg), so that fewer are known with a larger step.
        if step < 1.5:
            self.between_decimals = 2
        elif step < 5.0:
            self.between_decimals = 1
        else:
            self.between_decimals = 0

    @property
    def named(self) -> str:
        """The name of places in a sentence: ``input 21`` or ``t``.

        The name of a pair is often a number, which would be read as a quantity.
        """
        return f"input {self.name}" if self.kind == "input" else self.name

    def value(self, place: float, between_samples: bool = False) -> str:
        """Return a place as text, without its name and unit.

        Parameters
        ----------
        place
            The place as the summary has it: the first input (rad), the time (s) or the
            number of a sample, see `kind`.
        between_samples
            Whether the place is interpolated between samples, and so gets only the digits
            that are known.
        """
        if self.kind == "input":
            if between_samples:
                text = f"{math.degrees(place):.{self.between_decimals}f}"
                return "0" if float(text) == 0.0 else text
            return angle_text(place)
        if self.kind == "time":
            return number_text(place, digits=3 if between_samples else 4)
        return f"{place:.0f}"

    def between(self, first: float, last: float) -> str:
        """Return the interval between two places as text: ``between 30 and 40``."""
        return f"between {self.value(first)} and {self.value(last)}"

    def at(self, place: float) -> str:
        """Return a place with its name and unit, such as ``input 21 = 30 deg``."""
        if self.kind == "sample":
            return f"sample {place:.0f}"
        return f"{self.named} = {self.value(place)} {self.unit}"

    def spans(self, spans: Sequence[Sequence[float]]) -> str:
        """Return spans as text, such as ``0 to 137, 220 to 360``."""
        texts = [
            self.value(first)
            if first == last
            else f"{self.value(min(first, last))} to {self.value(max(first, last))}"
            for first, last in spans
        ]
        return listing(texts, MAX_LISTED_PLACES)

    def named_spans(self, spans: Sequence[Sequence[float]]) -> str:
        """Return spans with name and unit, such as ``at input 21 = 0 to 137 deg``."""
        text = self.spans(spans)
        if self.kind == "sample":
            return f"at the samples {text}"
        return f"at {self.named} = {text} {self.unit}"


def angle_text(angle_rad: float) -> str:
    """Return an angle as text in degrees, with at most two decimals."""
    return degrees_text(math.radians(round(math.degrees(angle_rad), 2)))
