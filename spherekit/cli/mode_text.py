"""Texts of assembly modes: their names and numbers, and the places where they close."""

from collections.abc import Sequence
from typing import Any

from spherekit.cli.place_text import PlaceText
from spherekit.conventions import Lines
from spherekit.wording import counted, listing


def mode_name(mode: Any) -> str:
    """Return the number of an assembly mode, followed by its name or its signs in brackets.

    An assembly mode is one of the ways to assemble the mechanism. Its name comes from the
    mechanism file. The text ``mode["mode"]`` has one character for each group of links. For
    a dyad (two links with three revolute pairs) the character is a sign. For other groups
    it is ``~``, which is left out here. If there is neither name nor sign, only the number
    is returned.

    Parameters
    ----------
    mode
        The facts of the mode: an entry of ``assembly_modes`` in the summary of a run.
    """
    title = mode.get("name") or mode["mode"].replace("~", "")
    return f"{mode['number']} ({title})" if title else str(mode["number"])


def number_list(numbers: Sequence[int]) -> str:
    """Return numbers as text, with successive numbers as a range, such as ``0-5, 7``.

    The numbers denote assembly modes (ways to assemble the mechanism).
    """
    parts: Lines = []
    ordered = sorted(numbers)
    start = 0
    while start < len(ordered):
        stop = start
        while stop + 1 < len(ordered) and ordered[stop + 1] == ordered[stop] + 1:
            stop += 1
        # A range needs at least three numbers.
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
    """Return lines about the assembly modes of a run: their names, and where they exist.

    An assembly mode is one of the ways to assemble the mechanism. If all modes exist
    everywhere, there is one line, for example::

        2 assembly modes, both exist over the whole range: 0 (+), 1 (-)

    Otherwise further lines say where the modes exist, for example::

        3 assembly modes: 0 (+), 1 (-), 2 (+)
        Modes 0, 1 exist at input 21 = 0 to 137 deg.
        Mode 2 exists everywhere.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of a run.
    """
    modes = summary["assembly_modes"]
    # A simulation has one mode, in which it starts.
    if "simulation" in summary:
        simulated = f"assembly mode {mode_name(modes[0])}"
        others = summary["other_modes"]
        if not others:
            return [f"The simulation starts in {simulated}, the only one that was found."]
        noun = "Mode" if len(others) == 1 else "Modes"
        return [
            f"The simulation starts in {simulated}. {noun} {_mode_titles(others)} "
            f"{'is' if len(others) == 1 else 'are'} not simulated; --assembly-mode N "
            "starts in another one."
        ]
    overview = summary["overview"]
    # Where each mode exists. None: the run has no such facts of the mode.
    entries = [overview["modes"].get(str(mode["number"])) for mode in modes]
    count = counted(len(modes), "assembly mode")
    # If the only mode is number 0 without name and signs, the number is not printed.
    titles = "" if mode_name(modes[0]) == "0" and len(modes) == 1 else _mode_titles(modes)
    ending = f": {titles}" if titles else ""

    if all(entry is not None and entry["closes_everywhere"] for entry in entries):
        which_exist = {1: "which exists", 2: "both exist"}.get(len(modes), "all exist")
        # The samples of the inputs form a path or a grid.
        if not overview["is_path"]:
            everywhere = "at all samples"
        elif len(summary["inputs"]) > 1:
            everywhere = "on the whole path"
        else:
            everywhere = "over the whole range"
        if titles and len(modes) == 1:
            ending = f": mode {titles}"
        return [f"{count}, {which_exist} {everywhere}{ending}"]

    lines = [f"{count}{ending}"]
    place_text = PlaceText(overview)
    # Modes that exist at the same places share a line.
    modes_by_place: dict[str, list[int]] = {}
    for mode, entry in zip(modes, entries, strict=True):
        place = _closing_place(mode, entry, overview, place_text)
        modes_by_place.setdefault(place, []).append(mode["number"])
    for place, numbers in modes_by_place.items():
        word = "Mode" if len(numbers) == 1 else "Modes"
        verb = "exists" if len(numbers) == 1 else "exist"
        lines.append(f"{word} {number_list(numbers)} {verb} {place}.")
    return lines


def _mode_titles(modes: Sequence[Any]) -> str:
    """Return the names of modes in one text, such as ``0 (+), 1 (-)``.

    The signs in brackets say how each dyad (two links with three R pairs) is assembled.
    Modes that have neither names nor signs are listed by number, such as ``0-5``.

    Parameters
    ----------
    modes
        The items of the list ``assembly_modes`` or ``other_modes`` in the summary.
    """
    names = [mode_name(mode) for mode in modes]
    if not all(name.isdigit() for name in names):
        return listing(names, 16)
    return number_list([mode["number"] for mode in modes])


def _closing_place(mode: Any, entry: Any, overview: Any, place_text: PlaceText) -> str:
    """Return where an assembly mode exists, such as ``at input 21 = 0 to 137 deg``.

    An assembly mode is one of the ways to assemble the mechanism. A mode may exist only in
    a part of the range of the input, where the loops of links close.

    Parameters
    ----------
    mode
        The facts of the mode: an entry of ``assembly_modes`` in the summary of a run.
    entry
        Where the mode exists: the entry of the mode in ``overview["modes"]``. None if the
        overview lacks the mode. ``closes`` lists spans of places in which the mode exists.
        A long list is cut, and ``unlisted_closing_spans`` is the number of other spans.
    overview
        The overview of the motion in the summary of the run. ``is_path`` tells whether the
        samples form a path; otherwise they form a grid.
    place_text
        Converts places (inputs or times) of this overview to text.
    """
    if entry is None or not entry["closes"]:
        return "nowhere"
    if entry["closes_everywhere"]:
        return "everywhere"
    # A span is named by its first and last input or time. Samples on a grid have no order,
    # so only their number is stated.
    has_input_or_time = overview["is_path"] and place_text.kind in ("input", "time")
    if has_input_or_time:
        spans_with_mode = entry["closes"]  # first and last place of each span
        return place_text.named_spans(spans_with_mode, entry["unlisted_closing_spans"])
    sample_count_by_status = mode["status"]
    sample_count = sum(sample_count_by_status.values())
    # At a singularity the loops close, too.
    closing_count = sum(
        sample_count_by_status.get(status, 0) for status in ("OK", "AT_SINGULARITY")
    )
    return f"at {closing_count} of the {sample_count} samples"
