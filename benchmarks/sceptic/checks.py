"""All checks, by what they ask: importing this module registers them."""

from benchmarks.sceptic import (  # noqa: F401  (importing registers)
    ask_commands,
    ask_dynamics,
    ask_modes,
    ask_outputs,
    ask_poles,
    ask_singular,
    ask_symmetry,
)
from benchmarks.sceptic.check import CHECKS as CHECKS
