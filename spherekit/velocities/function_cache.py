"""The kernels and equations of motion that were made in this process."""

from spherekit.mechanism.cache import MechanismCache

FUNCTION_CACHE = MechanismCache()
"""Row kernels and compiled equations of motion, by mechanism and a key of text."""
