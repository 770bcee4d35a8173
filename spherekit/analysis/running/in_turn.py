"""Pieces of work done in turn, the next while the last is made use of."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
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
        following: Future[Made] | None = None
        for item in items:
            made = [] if following is None else [following.result()]
            following = thread.submit(make, item)
            yield from made
        if following is not None:
            yield following.result()


def each_at_once(
    make: Callable[[Given], Made], items: Sequence[Given], threads: bool
) -> list[Made]:
    """Return what is made of each item, with `threads` on all cores.

    Every core has its items from the start: threads that take them one by one wait for
    each other more often. They are of use where calls without the interpreter are long.
    """
    cores = min(usable_cores(), len(items)) if threads else 1
    if cores < 2:
        return list(map(make, items))
    made: list[Made] = []
    with ThreadPoolExecutor(cores) as pool:
        shares = [
            items[len(items) * k // cores : len(items) * (k + 1) // cores]
            for k in range(cores)
        ]
        for some in pool.map(lambda share: list(map(make, share)), shares):
            made += some
    return made
