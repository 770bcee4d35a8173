"""Environment of all tests, and which of them run by default.

Of a test marked `many` the first case runs by default; the others are slow.
"""

import os
import shutil
import sys
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
    seen = set()
    for item in items:
        if item.get_closest_marker("many"):
            test = item.nodeid.partition("[")[0]
            if test in seen:
                item.add_marker(pytest.mark.slow)
            seen.add(test)
