"""The analysis `singularities`, for mechanisms with one input and with several."""

from .analysis import SingularityAnalysis as SingularityAnalysis
