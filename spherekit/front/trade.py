"""A trade whose chart can be drawn."""

from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from typing import TYPE_CHECKING, ParamSpec

from spherekit.analysis.result import Columns
from spherekit.tradeoff import trade as measured
from spherekit.tradeoff.record import Trade

if TYPE_CHECKING:
    from matplotlib.figure import Figure

P = ParamSpec("P")


def _drawable(function: Callable[P, Trade]) -> Callable[P, Trade]:
    """Return a function that measures, with results that can be drawn."""

    @wraps(function)
    def _trade(*args: P.args, **kwargs: P.kwargs) -> Trade:
        return replace(function(*args, **kwargs), draw=_figure)

    return _trade


def _figure(result: Trade, tolerance: float | None, columns: Columns) -> "Figure":
    from spherekit.figures.contents import figures_of
    from spherekit.tradeoff.chart import scene

    (figure,) = figures_of([scene(result, tolerance)], {}, columns=columns).values()
    return figure


trade = _drawable(measured.trade)
