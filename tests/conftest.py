"""Environment of all tests: strict viewer, no analytics, modules of this folder."""

import os
import sys
from pathlib import Path

os.environ.setdefault("CI", "true")
os.environ.setdefault("RERUN_STRICT", "1")
os.environ.setdefault("RUST_LOG", "error")
sys.path.insert(0, str(Path(__file__).parent))
