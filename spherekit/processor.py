"""What the last bits of results depend on, apart from versions: the kernels in use.

NumPy and OpenBLAS choose among kernels by the processor, and by environment variables.
Kernels add in different orders, or with fused products, and so round differently.
"""

import hashlib
from functools import cache

import numpy as np

SIZE = 24
"""Numbers in the vectors, and rows in the matrices, whose results are compared.

Larger than the vectors of any processor, so that each kernel is used with its remainder.
"""


@cache
def processor_identity() -> dict[str, str]:
    """Return what the kernels of this process are, in words and by what they compute.

    Processes for which this is equal, with equal versions of all libraries, compute the
    same bits. `instructions` are the extensions that NumPy uses, `blas` is its linear
    algebra, and `arithmetic` the start of a SHA-256 sum over results of both.
    """
    config = np.show_config(mode="dicts")
    blas = config["Build Dependencies"]["blas"]
    extensions = config["SIMD Extensions"]
    return {
        "instructions": " ".join([*extensions["baseline"], *extensions.get("found", [])]),
        "blas": f"{blas['name']} {blas['version']}",
        "arithmetic": _sum_of_results()[:16],
    }


def _sum_of_results() -> str:
    """Return the SHA-256 sum of the bits of some results."""
    x = np.arange(1, SIZE + 1) / 7.0
    z = x + 1j * x[::-1]
    matrix = np.sin(np.outer(x, x[::-1] + 0.3))
    # The last rows of a product with a remainder go another way in some kernels.
    wide = matrix[:, : SIZE - 5]
    results = [
        *(f(x) for f in (np.sin, np.cos, np.tan, np.exp, np.log, np.arctan, np.sqrt)),
        *(np.arctan2(x, x[::-1]), np.hypot(x, x[::-1]), x**1.5, np.arcsin(x / 4.0)),
        *(z * z, z / z[::-1], np.exp(z), np.abs(z)),
        *(np.sum(x), np.sum(matrix, axis=0), np.dot(x, x[::-1]), np.vecdot(matrix, x)),
        *(wide @ wide.T, np.einsum("ij,kj->ik", matrix, wide.T @ matrix)),
        *(np.linalg.inv(matrix + np.eye(SIZE)), np.linalg.solve(matrix + np.eye(SIZE), x)),
        *np.linalg.svd(wide),
        *np.linalg.qr(matrix),
        np.linalg.eigvals(matrix),
    ]
    digest = hashlib.sha256()
    for result in results:
        digest.update(np.ascontiguousarray(result).tobytes())
    return digest.hexdigest()
