"""What is said of the rows of a run that were verified in many digits."""

from collections.abc import Mapping
from typing import Any

from spherekit.analysis.result import MOTION
from spherekit.conventions import listing

BOUNDED = {
    "directions": "pole directions",
    "rates": "rates",
    "rate_derivatives": "derivatives of rates",
}
"""What has an error bound, by its name in a verdict."""


def told(verdict: Mapping[str, Any]) -> list[str]:
    """Return a verdict in lines for people."""
    if "problem" in verdict:
        return [f"not verified: {verdict['problem']}"]
    if not verdict["rows"]:
        return ["verified: no row has a configuration and finite rates"]
    lines = [
        f"verified {verdict['rows']} rows in {verdict['digits']} digits "
        f"({verdict['seconds']:.1f} s): configurations within "
        f"{verdict['largest_distance_rad']:.1e} rad, conditioning up to "
        f"{verdict['largest_condition']:.1e}"
    ]
    variables = [item for item in verdict["columns"] if item["table"] == MOTION]
    shown = sorted(variables, key=lambda item: float(item["deviation"]))[-1:]
    shown += [item for item in verdict["columns"] if item["table"] != MOTION]
    for item in shown:
        if item["deviation"] == 0.0:
            continue
        lines.append(
            f"  {item['table']}.{item['column']}: off by {item['deviation']:.1e} "
            f"{item['unit']}".rstrip()
            + f" at {_place(item)} ({item['in_roundings']:.2g} roundings)"
        )
    for name, words in BOUNDED.items():
        judged = verdict[name]
        if judged["count"]:
            lines.append(
                f"  {judged['within_bound']} of {judged['count']} {words} lie within "
                f"their error bound; nearest to it {judged['error']:.1e}, "
                f"{judged['over_bound']:.2g} of the bound, at {_place(judged)}"
            )
    for row in verdict["without_reference"]:
        lines.append(f"  no reference at {_place(row)}: {row['status']}")
    worst = verdict["worst"]
    lines.append(
        f"  worst row: {_place(worst)}: {worst['column']} = {worst['value']!r}, "
        f"in {verdict['digits']} digits {worst['reference']!r}"
    )
    if verdict["not_verified"]:
        names = ", ".join(verdict["not_verified"])
        lines.append(
            f"  not verified, as they failed or find configurations of their own: {names}"
        )
    return lines


def faults(verdict: Mapping[str, Any]) -> list[str]:
    """Return what of a verdict is wrong beyond rounding, in sentences."""
    sentences = []
    if "problem" in verdict:
        sentences.append(f"verify: no row was verified: {verdict['problem']}")
    if verdict.get("beyond"):
        sentences.append(
            f"verify: {listing(verdict['beyond'])} deviate by more than rounding from "
            f"their values in {verdict['digits']} digits"
        )
    for name, words in BOUNDED.items():
        judged = verdict.get(name)
        if judged and judged["within_bound"] < judged["count"]:
            sentences.append(
                f"verify: {judged['count'] - judged['within_bound']} of "
                f"{judged['count']} {words} are off by more than their error bound"
            )
    if verdict.get("without_reference"):
        places = listing(
            f"{_place(row)} ({row['status']})" for row in verdict["without_reference"]
        )
        sentences.append(f"verify: no solution in many digits belongs to {places}")
    return sentences


def _place(item: Mapping[str, Any]) -> str:
    subject = "".join(f", {key} {name}" for key, name in item.get("subject", {}).items())
    return f"sample {item['sample']}, assembly mode {item['assembly_mode']}{subject}"
