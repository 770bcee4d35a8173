"""The one place that imports matplotlib: figures are drawn without a display."""

from spherekit.errors import OutputError

try:
    from matplotlib import style
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import LineCollection, PatchCollection
    from matplotlib.colors import BoundaryNorm, Normalize
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle
    from matplotlib.patheffects import withStroke
    from matplotlib.ticker import MaxNLocator
    from matplotlib.transforms import Transform
    from matplotlib.tri import Triangulation
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection
except ImportError as error:
    raise OutputError(
        "figures need matplotlib, which is not installed; install it with: "
        'pip install "spherekit-mechanisms[plot]"'
    ) from error

__all__ = [
    "Axes",
    "BoundaryNorm",
    "Figure",
    "LineCollection",
    "MaxNLocator",
    "Normalize",
    "PatchCollection",
    "Poly3DCollection",
    "Rectangle",
    "ScalarMappable",
    "Transform",
    "Triangulation",
    "style",
    "withStroke",
]
