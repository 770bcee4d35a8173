"""The analysis `equivalent_rotation`: its tables and its scenes."""

from .analysis import EquivalentRotation as EquivalentRotation
