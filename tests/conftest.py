"""Environment of all tests, and which of them run by default.

The first case of a test marked `many` runs by default. The next `SLOW_CASES` cases are
slow, and all further cases are long. The mark can state another number of slow cases, as in
`many(slow=8)`, or `many(slow="all")` for texts of which every one has to be checked.
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

SLOW_CASES = 4
"""Cases of a test marked `many` that are slow, after the first one. With more of them, the
slow tests take longer than the 40 minutes that `.ci/run` may take."""

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
        slow_cases = mark.kwargs.get("slow", SLOW_CASES)
        if slow_cases != "all" and cases[test] > slow_cases:
            item.add_marker(pytest.mark.long)
        elif cases[test] > 0:
            item.add_marker(pytest.mark.slow)
        cases[test] += 1
