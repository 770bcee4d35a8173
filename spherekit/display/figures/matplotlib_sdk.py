"""The one place that imports matplotlib: figures are drawn without a display."""

from spherekit.errors import OutputError

try:
    from matplotlib import style
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import BoundaryNorm, Normalize, to_rgba, to_rgba_array
    from matplotlib.figure import Figure
    from matplotlib.patheffects import withStroke
    from matplotlib.ticker import MaxNLocator
    from matplotlib.tri import Triangulation
except ImportError as error:
    raise OutputError(
        "figures need matplotlib, which is not installed; install it with: "
        'pip install "spherekit-mechanisms[plot]"'
    ) from error

__all__ = [
    "Axes",
    "BoundaryNorm",
    "Figure",
    "MaxNLocator",
    "Normalize",
    "PolyCollection",
    "ScalarMappable",
    "Triangulation",
    "style",
    "to_rgba",
    "to_rgba_array",
    "withStroke",
]
