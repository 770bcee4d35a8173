"""Environment of all tests, and which of them run by default.

Of a test marked `many` the first case runs by default; the others are slow. Where the mark
says how many are slow, as `many(slow=8)`, those after them are long.
"""

import os
import shutil
import sys
from collections import Counter
from pathlib import Path

import pytest

os.environ.setdefault("CI", "true")
os.environ.setdefault("RERUN_STRICT", "1")
os.environ.setdefault("RUST_LOG", "error")
# Compiled modules are kept even where the environment forbids it: else every command that a
# test starts compiles the whole package again, which takes longer than most commands.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.path.insert(0, str(Path(__file__).parent))

SWITCHES = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]


@pytest.fixture(scope="module")
def browser():
    """A Chromium that is installed, without a window."""
    driver = pytest.importorskip("playwright.sync_api", reason="it opens the browser")
    path = shutil.which("chromium") or shutil.which("google-chrome")
    if path is None:
        pytest.skip("there is no Chromium here")
    with driver.sync_playwright() as started:
        opened = started.chromium.launch(executable_path=path, args=SWITCHES)
        yield opened
        opened.close()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    cases = Counter()
    for item in items:
        mark = item.get_closest_marker("many")
        if mark is None:
            continue
        test = item.nodeid.partition("[")[0]
        if cases[test] > mark.kwargs.get("slow", len(items)):
            item.add_marker(pytest.mark.long)
        elif cases[test] > 0:
            item.add_marker(pytest.mark.slow)
        cases[test] += 1
