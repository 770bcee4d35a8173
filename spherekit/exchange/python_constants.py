"""Constants at the beginning of sources in Python: arguments, results and modes."""

from pprint import pformat

from spherekit.exchange.source_printer import FormulaSource
from spherekit.exchange.source_text import LINE_WIDTH

CONSTANTS_TEMPLATE = """\
import {library}

MOTION = {motion}
SIZES = {sizes}
RESULTS = {results}
MODES = {modes}
"""

KNOWN_INPUTS_TEXT = ", and inputs at which it has them"
"""Part of the docstring of a function that returns known inputs too."""


def write_constants(source: FormulaSource, library: str) -> str:
    """Return the text of the first lines of an exported Python file.

    The exported file computes quantities of a mechanism by formulas. Its first lines import
    a library and define four constants:

    - The names of the arguments that describe the motion, such as the inputs.
    - The sizes (numbers of the mechanism that can change) with their values.
    - The names of the results with their units.
    - For each assembly mode (way to assemble the mechanism), the values that select it.

    Parameters
    ----------
    source
        The formulas to be written, with names that the language allows.
    library
        The library to import, such as ``numpy as np``.
    """
    formulas = source.formulas
    value_by_field = {
        "motion": [argument.name for argument in formulas.motion],
        "sizes": {size.name: size.value for size in formulas.sizes},
        "results": formulas.results,
        "modes": {mode.number: mode.values for mode in formulas.modes},
    }
    text_by_field = {
        field: pformat(value, width=LINE_WIDTH, sort_dicts=False)
        for field, value in value_by_field.items()
    }
    return CONSTANTS_TEMPLATE.format(library=library, **text_by_field)
