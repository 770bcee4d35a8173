"""How many bytes the rows of a table take in a file, judged from a few of them."""

import numpy as np

from spherekit.analysis.tables import TableArrays
from spherekit.conventions import Status

DICTIONARY = 1 << 17
"""Different numbers (8 bytes each) that fill the dictionary of a Parquet column: 1 MiB."""

COMPRESSED = 0.8
"""What compression leaves of numbers along smooth motions: 0.64 to 0.97 was measured."""

LONG_RUN = 8
"""Equal values in a row from which Parquet counts them instead of listing them."""


def csv_row(data: TableArrays, samples: int) -> float:
    """Return the mean bytes of a row as CSV, numbers with the fewest digits that do."""
    total = 0.0
    for name, values in data.items():
        if name == "sample":
            total += _digits(samples)
        elif name == "status":
            names = [Status(code).name for code in values.tolist()]
            total += _mean([len(word) for word in names])
        else:
            texts = [
                "" if isinstance(value, float) and value != value else str(value)
                for value in values.tolist()
            ]
            total += _mean([len(text) for text in texts])
    return total + len(data)


def _digits(count: int) -> float:
    """Return the mean number of digits of 0 to count - 1."""
    total, digits, low = 0, 1, 0
    while low < count:
        high = min(10**digits, count)
        total += digits * (high - low)
        low, digits = high, digits + 1
    return total / max(count, 1)


def _mean(lengths: list[int]) -> float:
    return sum(lengths) / max(len(lengths), 1)


def parquet_row(data: TableArrays, rows: int, samples: int) -> float:
    """Return the mean bytes of a row as Parquet with dictionaries, without the frame.

    Different numbers are kept once, each of so many `rows` as a place among them; equal
    neighbours cost little. How many differ follows from every second sample of `data`.
    """
    total = 0.0
    for name, values in data.items():
        some = data["sample"] % 2 == 0 if "sample" in data else slice(None, None, 2)
        less, more = (len(np.unique(subset)) for subset in (values[some], values))
        growing = (more - less) / max(len(values) - len(values[some]), 1)
        different = max(more + growing * (rows - len(values)), 1.0)
        if name == "sample":
            different = float(samples)
        held = min(different, DICTIONARY)
        width = 8.0 if values.dtype.kind in "fi" and name != "status" else 0.0
        place = np.log2(held) / 8.0
        run = len(values) / max(1, int(np.sum(values[1:] != values[:-1])) + 1)
        if run >= LONG_RUN:
            place = min(place, (1.0 + np.ceil(place)) / run)
        share = min(1.0, different / max(rows, 1))
        plain = max(0.0, 1.0 - DICTIONARY / different) if different > DICTIONARY else 0.0
        total += (1.0 - plain) * place + width * share
    return COMPRESSED * total
