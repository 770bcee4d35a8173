"""Parts that sources in JavaScript, Julia and Python have in common."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.exchange.source_head import head_comment
from spherekit.exchange.source_printer import FormulaSource
from spherekit.exchange.source_text import nested, nested_with_nan, wrap_lines


def join_parts(source: FormulaSource, parts: Iterable[str]) -> str:
    """Return a source: its head, the helpers that it needs, and its parts."""
    return "\n".join([head_comment(source), *source.helpers, *parts]) + "\n"


def join_items(items: Iterable[str], indent: int = 4) -> str:
    """Return items as a list in lines, indented from the second line on."""
    return wrap_lines(", ".join(items), " " * indent)


def write_series(
    source: FormulaSource, template: str, closed_template: str, open_template: str
) -> Iterator[str]:
    """Yield the source code of a function for each stored series, which evaluates it.

    A stored series is a table of Chebyshev coefficients by which functions of one variable
    are computed, such as the coordinates of a contact profile over its arc length. The
    range of the variable is divided into cells. A template is source code with fields in
    braces, which `str.format` replaces by the values of a series.

    Parameters
    ----------
    source
        The formulas with their series.
    template
        Template of the function in a programming language. `FormulaSource.series_fields`
        has a dictionary for each series. Its keys are the names of the fields. A further
        field is ``{around}``.
    closed_template, open_template
        Templates of the lines that replace ``{around}``. These lines deal with values of
        the variable outside of the range of the series. On a closed curve such values are
        moved into the range by whole periods. On an open curve the function returns NaN.
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
    """Parts of the source code of a generated function that selects an assembly mode.

    The function reads the mode values at an input from a table, which these parts define.

    Mode values are the arguments of the formulas that select the assembly mode (way to
    assemble the mechanism):

    - Formulas in closed form need the sign of each dyad (two links and three R pairs),
      because each dyad can be assembled in two ways.
    - Other formulas are steps of Newton's method. The steps need a start, which is a known
      configuration of the mode: the variables (rad) of all pairs.

    A mode can follow a smooth curve of configurations through crossings with other modes.
    The mode values change at crossings. The table therefore divides the range of the input
    into intervals, and has one set of mode values for each interval and mode.

    Attributes
    ----------
    interval_starts
        Array (intervals,) of the inputs (rad) at which the intervals begin.
    mode_values
        Array (intervals, modes, values) of the mode values.
    known_inputs
        Array (intervals, modes) of the inputs (rad) of the known configurations. Newton's
        method follows the mode from there.
    shift_lines
        Lines that move an input by whole periods into the range of the mechanism. Empty if
        configurations do not repeat after a period.
    """

    interval_starts: str
    mode_values: str
    known_inputs: str
    shift_lines: str


def smooth_mode_texts(
    source: FormulaSource, nan_literal: str, infinity_literal: str, moved_template: str
) -> SmoothModeTexts:
    """Return source code of the table that selects an assembly mode at each input.

    An assembly mode is one way to assemble the mechanism. The formulas select it by
    numbers, the mode values. Over the input, the configurations of a mode form a smooth
    curve. This curve can cross the curve of another mode. Beyond the crossing the curve has
    other mode values. The table therefore has mode values for each interval of the input.
    The table also has an input at which a configuration with these values is known, as a
    start for Newton's method.

    Parameters
    ----------
    source
        The formulas in a programming language. Their `smooth_modes` are the table.
    nan_literal, infinity_literal
        NaN and infinity in the language.
    moved_template
        Template of the lines that move an input from outside of the range into it, by whole
        periods. The lines are written only if configurations repeat after a period of the
        input.
    """
    smooth_modes = source.smooth_modes
    assert smooth_modes is not None

    def array_text(values: Floats) -> str:
        """Return an array as nested lists in square brackets."""
        return nested_with_nan(values, "[]", nan_literal, infinity_literal)

    shift_lines = ""
    if source.is_periodic:
        # The fields of the template include the range and the period of the input.
        shift_lines = moved_template.format(**source.smooth_mode_fields)
    return SmoothModeTexts(
        interval_starts=array_text(np.array(smooth_modes.starts)),
        mode_values=array_text(smooth_modes.mode_values),
        known_inputs=array_text(smooth_modes.inputs),
        shift_lines=shift_lines,
    )
