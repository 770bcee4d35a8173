"""Environment of all tests, and which of them run by default.

Of a test marked `many` the first case runs by default; the others are slow.
"""

import os
import sys
from pathlib import Path

import pytest

os.environ.setdefault("CI", "true")
os.environ.setdefault("RERUN_STRICT", "1")
os.environ.setdefault("RUST_LOG", "error")
sys.path.insert(0, str(Path(__file__).parent))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    seen = set()
    for item in items:
        if item.get_closest_marker("many"):
            test = item.nodeid.partition("[")[0]
            if test in seen:
                item.add_marker(pytest.mark.slow)
            seen.add(test)
