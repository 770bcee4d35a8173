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
    """Yield the text of the functions that evaluate the stored series.

    A stored series is a table of Chebyshev coefficients by which a formula is computed.

    Parameters
    ----------
    source
        The formulas with their series.
    template
        Template of such a function in the language, with the fields of
        `Source.series_fields` and `around`.
    closed_template, open_template
        Templates of the field `around`: the lines that move the variable into the period
        of a closed curve, and the lines that return NaN outside of an open curve.
    """
    for fields in source.series_fields:
        around_template = closed_template if fields["closed"] else open_template
        texts = {
            "edges": wrap_lines(nested(fields["edges"])),
            "coefficients": wrap_lines(nested(fields["coefficients"])),
            "around": around_template.format(**fields),
        }
        yield template.format(**{**fields, **texts})


@dataclass(frozen=True)
class SmoothModeTexts:
    """The parts of the function of places on smooth curves that differ between sources.

    Places are the values that select an assembly mode: signs of dyads or variables.

    Attributes
    ----------
    fields
        Fields of the template, with the arrays `starts` and `places` as text.
    inputs
        The array of known inputs as text.
    moved
        Lines that move an input by whole periods, empty if there is no period.
    """

    fields: dict[str, Any]
    inputs: str
    moved: str


def smooth_mode_texts(
    source: Source, nan_literal: str, infinity_literal: str, moved_template: str
) -> SmoothModeTexts:
    """Return the parts of the function of places on smooth curves.

    In the source this function returns, for an input, the values that select an assembly
    mode there (the places): signs of dyads or variables.

    Parameters
    ----------
    source
        A source whose modes follow smooth curves.
    nan_literal, infinity_literal
        NaN and infinity in the language.
    moved_template
        Template of the lines that move an input by whole periods.
    """
    fields = source.smooth_mode_fields
    moved = moved_template.format(**fields) if source.is_periodic else ""
    texts = {
        name: nested_with_nan(fields[name], "[]", nan_literal, infinity_literal)
        for name in ("starts", "places", "inputs")
    }
    return SmoothModeTexts({**fields, **texts}, texts["inputs"], moved)
