"""The numerical tests on a lesser processor: NumPy's and OpenBLAS's kernels turned down.

Sums in another order, without fused products, round otherwise. What these tests claim has
to hold there too.
"""

import subprocess
import sys
from pathlib import Path

import pytest
from helpers.least_kernels import environment_with_least_kernels

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


def test_numpy_uses_no_special_features_of_the_processor_in_that_environment():
    """NumPy itself lists the features that it dispatches to; the list has to be empty."""
    code = (
        "from numpy._core._multiarray_umath import __cpu_features__, __cpu_dispatch__\n"
        "print([name for name in __cpu_dispatch__ if __cpu_features__[name]])"
    )
    process = subprocess.run(
        [sys.executable, "-c", code],
        env=environment_with_least_kernels(),
        capture_output=True,
        text=True,
    )
    assert process.returncode == 0, process.stderr
    assert process.stdout.strip() == "[]"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "chosen"),
    [
        *((NUMERICAL[k::PROCESSES], QUICK) for k in range(PROCESSES)),
        pytest.param(NUMERICAL, "slow and not long", marks=pytest.mark.long),
        pytest.param(OTHERS, QUICK, marks=pytest.mark.long),
    ],
)
def test_numerical_tests_pass_with_the_least_kernels(names, chosen):
    """Tests with tolerances close to rounding pass with other rounding too.

    NumPy and OpenBLAS choose routines (kernels) for a processor. The least kernels use no
    special instructions, such as fused products or wide registers, and round differently.
    `names` are the test files of one process; `chosen` is pytest's expression of markers
    (`-m`) that selects tests in them.
    """
    pytest_options = ["-n", "0", "-p", "no:cacheprovider", "-q", "-m", chosen]
    files = [str(TESTS / f"{name}.py") for name in names]
    process = subprocess.run(
        [sys.executable, "-m", "pytest", *pytest_options, *files],
        env=environment_with_least_kernels(),
        cwd=TESTS.parent,
        capture_output=True,
        text=True,
    )
    assert process.returncode == 0, process.stdout[-4000:]
