"""What an analysis declares to read of a mechanism, checked before it is planned.

`Needs` have judged the types of what they hold.
"""

from typing import Any

import numpy as np

from spherekit.analysis.batch import Needs
from spherekit.analysis.class_check import fault_of_class
from spherekit.analysis.contract import AbstractAnalysis, BrokenAnalysis
from spherekit.analysis.faults import faults_of
from spherekit.conventions import choices
from spherekit.errors import PluginError
from spherekit.model.mechanism import Mechanism

_POLES = ("directions", "rates", "planes", "turns")
_PAIRS = ("pair_values", "continued_values", "pair_rates")
_LINKS = ("rotations", "link_rates")


def declared(analysis: AbstractAnalysis, mechanism: Mechanism) -> Needs:
    """Return what an analysis needs of a mechanism.

    Raises
    ------
    PluginError
        If the analysis breaks the contract: its class, or the types, links or pairs in
        what it returns.
    SpherekitError
        With which it refuses the mechanism, or its parameters.
    """
    name = getattr(analysis, "name", type(analysis).__name__)
    fault = "" if isinstance(analysis, BrokenAnalysis) else fault_of_class(type(analysis))
    if not fault:
        with faults_of(name, "needs"):
            needs = analysis.needs(mechanism)
        fault = _fault(needs, mechanism)
    if fault:
        raise PluginError(f"{name}: {fault}")
    return needs


def _fault(needs: Any, mechanism: Mechanism) -> str:
    """Return what is wrong with a pole, pair or link that is declared, or nothing."""
    if not isinstance(needs, Needs):
        return f"needs returns a {type(needs).__name__}, it has to return Needs(...)"
    count = len(mechanism.links)
    name = mechanism.name
    for what, held in vars(needs).items():
        for item in held if isinstance(held, frozenset) else ():
            fault = ""
            if what in (*_POLES, "links"):
                ends = np.ravel(item)
                if np.any((ends < 0) | (ends >= count)):
                    fault = f", but the links of {name} have the numbers 0 to {count - 1}"
                elif not np.all(ends[:-1] < ends[1:]):
                    fault = "; pole_of(link, other) puts the smaller first"
            else:
                is_link = what in _LINKS
                kind = "link" if is_link else "pair"
                names = mechanism.link_number if is_link else mechanism.pair_number
                if item not in names:
                    fault = (
                        f", but {name} has no {kind} of that name"
                        f"{choices(item, names, f'{kind}s')}"
                    )
                elif what in _PAIRS and mechanism.pair(item).kind.freedoms > 1:
                    fault = ", a pair with two variables, which has no single one"
            if fault:
                return f"Needs({what}=...) holds {item!r}{fault}"
    return ""
