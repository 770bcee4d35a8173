"""Programs that compute with the least instructions of this processor."""

import os
import platform

from numpy._core._multiarray_umath import __cpu_dispatch__ as DISPATCHED

CORES = {"x86_64": "Prescott", "AMD64": "Prescott", "aarch64": "ARMV8"}
"""The least kernels of OpenBLAS by machine."""


def environment_with_least_kernels():
    """Return the environment for a program that is to use the least kernels.

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
