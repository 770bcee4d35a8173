"""Runs programs with the most basic kernels of NumPy and OpenBLAS.

A kernel is an implementation of an operation for certain instructions of a processor. The
most basic one needs the fewest instructions.
"""

import os
import platform

from numpy._core._multiarray_umath import __cpu_dispatch__ as DISPATCHED

CORES = {"x86_64": "Prescott", "AMD64": "Prescott", "aarch64": "ARMV8"}
"""The processor whose kernels OpenBLAS is to use, by the kind of machine."""


def environment_with_least_kernels():
    """Return the environment variables of a program that is to use the most basic kernels.

    NumPy is forbidden every instruction set that it chooses at run time, and OpenBLAS is
    told that the processor is the oldest of its kind and has one thread. Settings of pytest
    are left out.
    """
    inherited = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")}
    return inherited | {
        "NPY_DISABLE_CPU_FEATURES": " ".join(DISPATCHED),
        "OPENBLAS_CORETYPE": CORES.get(platform.machine(), ""),
        "OPENBLAS_NUM_THREADS": "1",
    }
