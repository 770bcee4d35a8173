"""A trade whose chart can be drawn."""

from dataclasses import replace
from functools import wraps
from typing import TYPE_CHECKING, Any

from spherekit.analysis.result import Columns
from spherekit.trade import trade as measured
from spherekit.trade.record import Trade

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@wraps(measured.trade)
def trade(*args: Any, **options: Any) -> Trade:
    """Return what a trade finds, with its figure."""
    return replace(measured.trade(*args, **options), draw=_figure)


def _figure(found: Trade, tolerance: float | None, columns: Columns) -> "Figure":
    from spherekit.figures.contents import figures_of
    from spherekit.trade.chart import scene

    (figure,) = figures_of([scene(found, tolerance)], {}, columns=columns).values()
    return figure
