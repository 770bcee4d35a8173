"""Compiles C functions in a driver and measures the time of a call."""

import ctypes
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spherekit.arrays import Floats

CALL_SAMPLES = 1000
"""Number of samples at which the functions are called."""

DRIVER_PROGRAM = """#include "{path}"
#include <string.h>
#include <time.h>
double run(const double *motions, double *places, double *results) {{
  struct timespec a, b;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &a);
  for (int n = 0, k = 0; n < 10000; ++n, k = n % 1000) {{
    const double *motion = motions + {motion} * k;
    double *place = places + {place} * k, *result = results + {result} * k;
    {call} }}
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &b);
  return (1e9 * (b.tv_sec - a.tv_sec) + (b.tv_nsec - a.tv_nsec)) / 1e4; }}
"""
"""C program that calls a function at all samples, ten times each.

Its function `run` takes the motions, the places (pair variables that are not inputs) and
the array for the results, and returns the processor time (ns) of one call. In the braces
are the path of the C source of the function, the call, and the numbers by which the three
arrays advance from sample to sample.
"""


@dataclass(frozen=True)
class MeasuredCalls:
    """The results of calls at all samples.

    Attributes
    ----------
    nanoseconds
        Mean processor time (ns) of a call.
    results
        (samples, results) what the calls returned.
    """

    nanoseconds: float
    results: Floats


CallJob = Callable[[], MeasuredCalls]
"""Calls a compiled function at all samples."""


def compile_calls(
    source_path: Path, call: str, motions: Floats, places: Floats, result_count: int
) -> CallJob:
    """Compile a C function and a driver, and return a job that calls it at all samples.

    Parameters
    ----------
    source_path
        Path of the C source of the function.
    call
        C statements that call it with ``motion``, ``place`` and ``result``.
    motions
        (samples, k) inputs, their rates and accelerations.
    places
        (samples, m) pair variables at all samples. If each call updates them, (1, m) the
        pair variables before the first sample.
    result_count
        Number of results of a call.
    """
    results = np.empty((CALL_SAMPLES, result_count))
    # The arrays must be contiguous. They are kept alive by the job.
    arrays = [np.array(x, order="C") for x in (motions, places, results)]
    steps = [x.shape[1] if len(x) == CALL_SAMPLES else 0 for x in arrays]
    widths = dict(zip(("motion", "place", "result"), steps, strict=True))
    folder = Path(tempfile.mkdtemp(dir=source_path.parent))
    program = DRIVER_PROGRAM.format(path=source_path, call=call, **widths)
    (folder / "run.c").write_text(program, "utf-8")
    command = ["gcc", "-O2", "-shared", "-fPIC", "-o", f"{folder}/run.so"]
    subprocess.run([*command, f"{folder}/run.c", "-lm"], check=True)
    function = ctypes.CDLL(str(folder / "run.so")).run
    function.restype = ctypes.c_double
    pointers = [x.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for x in arrays]

    def call_at_samples() -> MeasuredCalls:
        nanoseconds = function(*pointers)
        return MeasuredCalls(nanoseconds, arrays[-1])

    return call_at_samples
