"""Pieces of work done in turn, the next while the last is made use of."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from spherekit.resources import usable_cores

Given = TypeVar("Given")
Made = TypeVar("Made")


def in_turn(
    make: Callable[[Given], Made], items: Iterable[Given], ahead: bool
) -> Iterator[Made]:
    """Yield what is made of each item; one `ahead`, in a thread, with cores to spare.

    An item is asked for when all but the last before it were made use of.
    """
    if not ahead or usable_cores() < 2:
        yield from map(make, items)
        return
    with ThreadPoolExecutor(1) as thread:
        futures = (thread.submit(make, item) for item in items)
        following = next(futures, None)
        while following:
            made = following.result()
            following = next(futures, None)
            yield made


def each_at_once(
    make: Callable[[Given], Made], items: Sequence[Given], threads: bool
) -> list[Made]:
    """Return what is made of each item, with `threads` on all cores.

    They are of use where calls without the interpreter are long.
    """
    if not threads:
        return list(map(make, items))
    with ThreadPoolExecutor(usable_cores()) as pool:
        return list(pool.map(make, items))
