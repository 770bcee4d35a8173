"""`spherekit.trade`: measures speed against accuracy, with a chart of the results."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from spherekit.api.run import with_signature_of
from spherekit.runs import trade as measurement
from spherekit.runs.run_result import Columns
from spherekit.runs.trade_record import Trade

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _trade(*arguments: Any, **options: Any) -> Trade:
    """Measure the settings of a run, and return a result that can also draw a chart."""
    return replace(measurement.trade(*arguments, **options), draw=_draw_chart)


trade = with_signature_of(measurement.trade, _trade)


def _draw_chart(result: Trade, tolerance: float | None, columns: Columns) -> "Figure":
    """Return the chart of run time against error, with a tolerance marked."""
    from spherekit.display.figures.contents import plan_figures
    from spherekit.runs.trade_chart import scene

    (figure,) = plan_figures([scene(result, tolerance)], {}, columns=columns).values()
    return figure
