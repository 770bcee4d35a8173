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
    if not isinstance(needs, Needs):
        return f"needs returns a {type(needs).__name__}, it has to return Needs(...)"
    for what, held in vars(needs).items():
        for item in held if isinstance(held, frozenset) else ():
            fault = _fault_of_item(what, item, mechanism)
            if fault:
                return f"Needs({what}=...) holds {item!r}{fault}"
    return ""


def _fault_of_item(what: str, item: Any, mechanism: Mechanism) -> str:
    """Return what is wrong with a pole, pair or link that is declared, or nothing."""
    if what in (*_POLES, "links"):
        ends, count = np.ravel(item), len(mechanism.links)
        if np.any((ends < 0) | (ends >= count)):
            return f", but the links of {mechanism.name} have the numbers 0 to {count - 1}"
        rises = np.all(ends[:-1] < ends[1:])
        return "" if rises else "; pole_of(link, other) puts the smaller first"
    names = mechanism.link_number if what in _LINKS else mechanism.pair_number
    kind = "link" if what in _LINKS else "pair"
    if item not in names:
        said = choices(item, names, f"{kind}s")
        return f", but {mechanism.name} has no {kind} of that name{said}"
    if what in _PAIRS and mechanism.pair(item).kind.freedoms > 1:
        return ", a pair with two variables, which has no single one"
    return ""
