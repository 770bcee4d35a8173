"""Identifies the numerical kernels on which the last bits of results depend.

NumPy and its linear algebra library (OpenBLAS) contain several kernels for one operation.
They choose among them by the type of the processor and by environment variables. Kernels
add numbers in different orders, or use fused multiply-add instructions, so they round
differently.
"""

import hashlib
from functools import cache

import numpy as np

VECTOR_SIZE = 24
"""Number of elements of the test vectors, and number of rows of the test matrices.

The number exceeds the length of the vector registers of usual processors, which hold at
most 8 numbers. It is a multiple of 8, so a remainder is computed only by kernels that
compute more numbers at once, such as 16. The remainder of products is tested with
matrices that have fewer columns.
"""


@cache
def processor_identity() -> dict[str, str]:
    """Identify the numerical kernels (code variants for processors) that this process uses.

    The last bits of results depend on them. Two processes with equal identities and equal
    library versions are expected to compute results that are equal bit by bit.

    Returns
    -------
    Three texts:

    - ``"instructions"``: the SIMD instruction sets that NumPy uses, such as
      ``"SSE SSE2 AVX2"``,
    - ``"blas"``: name and version of the linear algebra library,
    - ``"arithmetic"``: the first 16 hexadecimal digits of a SHA-256 checksum of test
      results of NumPy and of the linear algebra library.
    """
    numpy_config = np.show_config(mode="dicts")
    blas = numpy_config["Build Dependencies"]["blas"]
    extensions = numpy_config["SIMD Extensions"]
    return {
        "instructions": " ".join([*extensions["baseline"], *extensions.get("found", [])]),
        "blas": f"{blas['name']} {blas['version']}",
        "arithmetic": _hash_results()[:16],
    }


def _hash_results() -> str:
    """Compute test results with NumPy, and return a checksum of their bits.

    NumPy and its linear algebra library have several variants (kernels) of each operation.
    They choose by the type of the processor, and the variants round differently. Processes
    with equal checksums are expected to use the same variants, and so to compute equal
    bits. The checksum is SHA-256, as a hexadecimal text.
    """
    # The numbers have no meaning. Most are not exact in binary, so each operation rounds.
    x = np.arange(1, VECTOR_SIZE + 1) / 7.0
    z = x + 1j * x[::-1]
    matrix = np.sin(np.outer(x, x[::-1] + 0.3))
    # Kernels compute several columns at once. The number of columns here is no multiple of
    # usual block sizes. So the code for the remaining columns is tested, too.
    rectangular_matrix = matrix[:, : VECTOR_SIZE - 5]
    results = [
        *(
            function(x)
            for function in (np.sin, np.cos, np.tan, np.exp, np.log, np.arctan, np.sqrt)
        ),
        *(np.arctan2(x, x[::-1]), np.hypot(x, x[::-1]), x**1.5, np.arcsin(x / 4.0)),
        *(z * z, z / z[::-1], np.exp(z), np.abs(z)),
        *(np.sum(x), np.sum(matrix, axis=0), np.dot(x, x[::-1]), np.vecdot(matrix, x)),
        *(
            rectangular_matrix @ rectangular_matrix.T,
            np.einsum("ij,kj->ik", matrix, rectangular_matrix.T @ matrix),
        ),
        *(
            np.linalg.inv(matrix + np.eye(VECTOR_SIZE)),
            np.linalg.solve(matrix + np.eye(VECTOR_SIZE), x),
        ),
        *np.linalg.svd(rectangular_matrix),
        *np.linalg.qr(matrix),
        np.linalg.eigvals(matrix),
    ]
    digest = hashlib.sha256()
    for result in results:
        digest.update(np.ascontiguousarray(result).tobytes())
    return digest.hexdigest()
