"""The numerical tests on a lesser processor: NumPy's and OpenBLAS's kernels turned down.

Sums in another order, without fused products, round otherwise. What these tests claim has
to hold there too.
"""

import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest
from numpy._core._multiarray_umath import __cpu_dispatch__ as DISPATCHED

TESTS = Path(__file__).parent
NUMERICAL = (
    *("test_bounds", "test_engine_dyads", "test_reference_rows", "test_poles"),
    *("test_reduced", "test_singular_single", "test_special_dyads", "test_transmission"),
    "test_units",
)
"""Files whose claims are close to rounding."""
OTHERS = (
    *("test_assembly_modes", "test_change_points", "test_contact", "test_engine"),
    *("test_equivalent_rotation", "test_inverse", "test_region", "test_singular_several"),
    *("test_curve_contact", "test_verification"),
)
"""Files that are asked when there is time, as the whole suite may be by its settings."""

PROCESSES = 2
"""Of several files each, which is quicker than one for each file."""
QUICK = "not slow and not long"
"""The tests of a file that are asked there; its slow ones hold what quick ones do too."""
CORES = {"x86_64": "Prescott", "AMD64": "Prescott", "aarch64": "ARMV8"}
"""The least kernels of OpenBLAS by machine."""


def lesser():
    """Return the environment of programs that are to use the least kernels."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")}
    return kept | {
        "NPY_DISABLE_CPU_FEATURES": " ".join(DISPATCHED),
        "OPENBLAS_CORETYPE": CORES.get(platform.machine(), ""),
        "OPENBLAS_NUM_THREADS": "1",
    }


def test_the_kernels_are_turned_down():
    code = (
        "from numpy._core._multiarray_umath import __cpu_features__, __cpu_dispatch__\n"
        "print([name for name in __cpu_dispatch__ if __cpu_features__[name]])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env=lesser(), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "chosen"),
    [
        *((NUMERICAL[k::PROCESSES], QUICK) for k in range(PROCESSES)),
        pytest.param(NUMERICAL, "slow and not long", marks=pytest.mark.long),
        pytest.param(OTHERS, QUICK, marks=pytest.mark.long),
    ],
)
def test_numerical_tests_hold_there(names, chosen):
    words = ["-m", "pytest", "-n", "0", "-p", "no:cacheprovider", "-q"]
    files = [str(TESTS / f"{name}.py") for name in names]
    done = subprocess.run(
        [sys.executable, *words, "-m", chosen, *files],
        env=lesser(),
        cwd=TESTS.parent,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout[-4000:]
