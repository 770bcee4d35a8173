"""Parts that sources in JavaScript, Julia and Python have in common."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from spherekit.exchange.source_head import head_comment
from spherekit.exchange.source_printer import Source
from spherekit.exchange.source_text import nested, nested_with_nan, wrap_lines


def join_parts(source: Source, parts: Iterable[str]) -> str:
    """Return a source: its head, the helpers that it needs, and its parts."""
    return "\n".join([head_comment(source), *source.helpers, *parts]) + "\n"


def join_items(items: Iterable[str], indent: int = 4) -> str:
    """Return items as a list in lines, indented from the second line on."""
    return wrap_lines(", ".join(items), " " * indent)


def write_series(
    source: Source, template: str, closed_template: str, open_template: str
) -> Iterator[str]:
    """Yield the source code of a function for each stored series, which evaluates it.

    A stored series is a table of Chebyshev coefficients by which functions of one variable
    are computed, such as the coordinates of a contact profile over its arc length. Its
    range is divided into cells. A template is source code with fields in braces, which
    `str.format` replaces by the values of a series.

    Parameters
    ----------
    source
        The formulas with their series.
    template
        Template of the function in a programming language. Its fields are the keys of the
        dictionaries in `Source.series_fields`, and ``{around}``.
    closed_template, open_template
        Templates of the lines that replace ``{around}``. They deal with values of the
        variable outside of the range of the series. On a closed curve they are moved into
        the range by whole periods, on an open curve the function returns NaN.
    """
    for fields in source.series_fields:
        around_template = closed_template if fields["closed"] else open_template
        # Arrays are written as nested lists of numbers, in lines of limited width.
        texts = {
            "edges": wrap_lines(nested(fields["edges"])),
            "coefficients": wrap_lines(nested(fields["coefficients"])),
            "around": around_template.format(**fields),
        }
        yield template.format(**{**fields, **texts})


@dataclass(frozen=True)
class SmoothModeTexts:
    """Source code for the function that selects an assembly mode at a given input.

    An assembly mode is one of the ways to assemble the mechanism. In formulas it is
    selected by numbers, the mode values. In closed form they are the signs of its dyads
    (two links and three R pairs). Otherwise they are the pair variables (rad) of a known
    configuration, from which Newton's method starts. If a mode follows a smooth curve of
    configurations, the mode values are constant in intervals of the input.

    Attributes
    ----------
    fields
        Values of the fields of the template of this function. Three of them are arrays, as
        text in the programming language:

        - ``starts`` (intervals,): the input (rad) at which each interval begins,
        - ``places`` (intervals, modes, values): the mode values, under the name that they
          have in the source code,
        - ``inputs``: see `known_inputs`.
    known_inputs
        The text of the array ``inputs``, also for templates other than that of this
        function. The array has the axes (intervals, modes): the input (rad) of the known
        configuration. Without a closed form, Newton's method follows the mode from there.
    shift_lines
        Lines that move an input by whole periods into the range of the mechanism. Empty if
        configurations do not repeat after a period.
    """

    fields: dict[str, Any]
    known_inputs: str
    shift_lines: str


def smooth_mode_texts(
    source: Source, nan_literal: str, infinity_literal: str, moved_template: str
) -> SmoothModeTexts:
    """Return source code for the function that selects an assembly mode at a given input.

    An assembly mode is one of the ways to assemble the mechanism. In formulas it is
    selected by numbers, the mode values. In closed form they are the signs of its dyads
    (two links and three R pairs). Otherwise they are the pair variables (rad) of a known
    configuration, from which Newton's method starts. If a mode follows a smooth curve of
    configurations, the mode values are constant in intervals of the input. The function
    returns those of the interval of its input.

    Parameters
    ----------
    source
        The formulas in a programming language, with modes that follow smooth curves.
    nan_literal, infinity_literal
        NaN and infinity in the language.
    moved_template
        Template of the lines that move an input outside of the range by whole periods. They
        are only written if configurations repeat after a period of the input.
    """
    fields = source.smooth_mode_fields
    shift_lines = moved_template.format(**fields) if source.is_periodic else ""
    # Three arrays are written as nested lists in brackets: the input at which each interval
    # begins, the mode values, and the input of the known configuration with these values.
    text_by_name = {
        name: nested_with_nan(fields[name], "[]", nan_literal, infinity_literal)
        for name in ("starts", "places", "inputs")
    }
    return SmoothModeTexts(
        fields={**fields, **text_by_name},
        known_inputs=text_by_name["inputs"],
        shift_lines=shift_lines,
    )
