"""Work in other threads: the next item ahead of its use, or all items at once."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from spherekit.resources import usable_cores

Item = TypeVar("Item")
Result = TypeVar("Result")


def prefetch(
    compute: Callable[[Item], Result], items: Iterable[Item], looks_ahead: bool
) -> Iterator[Result]:
    """Yield the result of each item, and compute the next result while one is used.

    While the caller uses result k, a thread computes result k + 1. When the caller asks for
    result k, item k + 1 is taken from `items` before result k is returned. At that time the
    caller has used the results up to k - 1, so item k + 1 may depend on them.

    Parameters
    ----------
    compute
        Function of one item that returns its result.
    items
        The items.
    looks_ahead
        Whether the next result is computed in another thread, which needs a second core.
        Otherwise each result is computed when the caller asks for it.
    """
    if not looks_ahead or usable_cores() < 2:
        yield from map(compute, items)
        return
    with ThreadPoolExecutor(1) as thread:
        # Taking a future from this generator starts its computation.
        futures = (thread.submit(compute, item) for item in items)
        next_future = next(futures, None)
        while next_future:
            result = next_future.result()
            next_future = next(futures, None)
            yield result


def thread_map(
    compute: Callable[[Item], Result], items: Sequence[Item], uses_threads: bool
) -> list[Result]:
    """Return the result of each item, computed on all cores if threads are used.

    Threads help only if the function spends most of its time outside of the Python
    interpreter, as compiled functions do.
    """
    if not uses_threads:
        return list(map(compute, items))
    with ThreadPoolExecutor(usable_cores()) as pool:
        return list(pool.map(compute, items))
