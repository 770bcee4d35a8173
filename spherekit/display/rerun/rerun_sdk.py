"""The one place that imports rerun: mistakes raise, and nothing is reported home."""
# ruff: noqa: E402

import os

from spherekit.resources import need_space

need_space(3_000_000_000, "recordings need")

os.environ.setdefault("CI", "true")  # the only variable that turns its analytics off
os.environ.setdefault("RUST_LOG", "error")

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader
from rerun.experimental import ViewerClient

rr.set_strict_mode(True)  # without it, wrong shapes only warn and nothing is logged

__all__ = ["RrdReader", "ViewerClient", "rr", "rrb"]
