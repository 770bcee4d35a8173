"""Texts of assembly modes: their names and numbers, and the places where they close."""

from collections.abc import Sequence
from typing import Any

from spherekit.cli.place_text import PlaceText
from spherekit.conventions import Lines
from spherekit.wording import counted, listing


def mode_name(mode: Any) -> str:
    """Return the number of a mode with its name in the file, or with its signs.

    A mode has one sign for each dyad. Other groups have the character ``~`` instead, which
    is left out. If the mode has neither name nor sign, only its number is returned.

    Parameters
    ----------
    mode
        An entry of ``assembly_modes`` of the summary.
    """
    title = mode.get("name") or mode["mode"].replace("~", "")
    return f"{mode['number']} ({title})" if title else str(mode["number"])


def number_list(numbers: Sequence[int]) -> str:
    """Return numbers of modes as text, successive ones as a range: ``0-5, 7``."""
    parts: Lines = []
    ordered = sorted(numbers)
    start = 0
    while start < len(ordered):
        stop = start
        while stop + 1 < len(ordered) and ordered[stop + 1] == ordered[stop] + 1:
            stop += 1
        if stop - start >= 2:
            parts.append(f"{ordered[start]}-{ordered[stop]}")
        else:
            parts += [str(number) for number in ordered[start : stop + 1]]
        start = stop + 1
    return ", ".join(parts)


def modes_text(numbers: Sequence[int], begins_sentence: bool = False) -> str:
    """Return the numbers of modes with the noun: ``mode 3`` or ``modes 0-5, 7``."""
    word = "mode" if len(numbers) == 1 else "modes"
    return f"{word.capitalize() if begins_sentence else word} {number_list(numbers)}"


def describe_modes(summary: Any) -> Lines:
    """Return lines about the assembly modes: their names, and where they close.

    Parameters
    ----------
    summary
        The content of ``summary.json``.
    """
    modes = summary["assembly_modes"]
    overview = summary["overview"]
    place_text = PlaceText(overview)
    names = [mode_name(mode) for mode in modes]
    entries = [overview["modes"].get(str(mode["number"])) for mode in modes]
    if "simulation" in summary:
        return [f"The simulation starts in assembly mode {names[0]}."]
    count = counted(len(modes), "assembly mode")
    titles = listing(names, 16)
    if all(name.isdigit() for name in names):
        titles = number_list([mode["number"] for mode in modes])
    closes = [entry is not None and entry["closes_everywhere"] for entry in entries]
    if len(modes) == 1 and names[0].isdigit():
        titles = ""
    if all(closes):
        which = {1: "which exists", 2: "both exist"}
        closing = which.get(len(modes), "all exist")
        place = "over the whole range"
        if len(summary["inputs"]) > 1:
            place = "on the whole path"
        if not overview["is_path"]:
            place = "at all samples"
        return [": ".join(filter(None, [f"{count}, {closing} {place}", titles]))]
    lines = [": ".join(filter(None, [count, titles]))]
    # Modes that close at the same places share a line.
    modes_by_place: dict[str, list[int]] = {}
    for mode, entry in zip(modes, entries, strict=True):
        place = _closing_place(mode, entry, overview, place_text)
        modes_by_place.setdefault(place, []).append(mode["number"])
    for place, numbers in modes_by_place.items():
        word = "Mode" if len(numbers) == 1 else "Modes"
        verb = "exists" if len(numbers) == 1 else "exist"
        lines.append(f"{word} {number_list(numbers)} {verb} {place}.")
    return lines


def _closing_place(mode: Any, entry: Any, overview: Any, place_text: PlaceText) -> str:
    """Return where a mode closes, such as ``at 21 = 0 to 137 deg``.

    Parameters
    ----------
    mode
        The entry of the mode in ``assembly_modes`` of the summary.
    entry
        Its entry in the overview, None if it has none.
    overview
        The entry ``overview`` of the summary.
    place_text
        Texts of the places of this overview.
    """
    if entry is None or not entry["closes"]:
        return "nowhere"
    if entry["closes_everywhere"]:
        return "everywhere"
    if overview["is_path"] and place_text.kind != "sample":
        return place_text.named_spans(entry["closes"])
    counts = mode["status"]
    share = counts.get("OK", 0) / max(sum(counts.values()), 1)
    return f"at {share:.0%} of the samples"
