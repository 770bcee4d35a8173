"""A trade of speed against accuracy whose chart can be drawn."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from spherekit.runs import trade as measured
from spherekit.runs.run_result import Columns
from spherekit.runs.trade_record import Trade

if TYPE_CHECKING:
    from matplotlib.figure import Figure

from spherekit.api.run import _published


def _trade(*arguments: Any, **options: Any) -> Trade:
    """Measure a trade, and let it be drawn."""
    return replace(measured.trade(*arguments, **options), draw=_figure)


trade = _published(measured.trade, _trade)


def _figure(result: Trade, tolerance: float | None, columns: Columns) -> "Figure":
    from spherekit.display.figures.contents import figures_of
    from spherekit.runs.trade_chart import scene

    (figure,) = figures_of([scene(result, tolerance)], {}, columns=columns).values()
    return figure
