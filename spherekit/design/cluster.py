"""Parts of a sweep computed by the workers of a Dask cluster; dask's only home."""

from collections.abc import Generator, Sequence
from importlib.util import find_spec
from socket import gethostname
from typing import final

from spherekit.conventions import listing
from spherekit.design.sweep import Sweep
from spherekit.design.sweep_identity import code_identity, other_code
from spherekit.errors import DesignError


@final
class Cluster:
    """The workers that a scheduler has, by its address; they see the folder of parts.

    A lost worker's parts are computed again by others. That changes nothing: a part that
    is there is kept, and each is written under another name first.
    """

    def __init__(self, address: str) -> None:
        if find_spec("distributed") is None:
            raise DesignError(
                "a cluster needs dask and distributed: "
                'pip install "spherekit-mechanisms[cluster]"'
            )
        self.address = address

    def __call__(
        self, sweep: Sweep, folder: str, numbers: Sequence[int]
    ) -> Generator[int, None, None]:
        """Yield the numbers of parts when they are written.

        Raises
        ------
        DesignError
            If no scheduler answers at the address, or a worker has other versions.
        """
        from dask.distributed import Client, as_completed

        try:
            client = Client(self.address, timeout="10s")
        except (OSError, ValueError) as problem:
            raise DesignError(f"{self.address}: no scheduler answers ({problem})") from None
        with client:
            (shared,) = client.scatter([sweep], broadcast=True)
            futures = client.map(
                _write,
                [shared] * len(numbers),
                [folder] * len(numbers),
                numbers,
                [code_identity()] * len(numbers),
                pure=False,
            )
            for future in as_completed(futures):
                yield future.result()


def _write(sweep: Sweep, folder: str, number: int, code: dict[str, str]) -> int:
    """Write a part, by the same code as all others.

    Raises
    ------
    DesignError
        If this worker has other versions than the machine at which the sweep was started.
    """
    other = other_code(code_identity(), code)
    if other:
        raise DesignError(
            f"{sweep.mechanism.name}: a worker of the cluster ({gethostname()}) has other "
            f"versions, {listing(other)}; a data set is made by one"
        )
    return sweep.write(folder, number)
