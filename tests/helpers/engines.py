"""Parametrization of tests over the two simulation engines."""

import pytest

from spherekit.symbolic.compiler import available

needs_heyoka = pytest.mark.skipif(not available(), reason="heyoka is not installed")

ENGINES = (pytest.param("compiled", marks=needs_heyoka), "numpy")
"""Names of the engines; the compiled one is skipped where heyoka is not installed."""
