"""The result of a verification in words: what was compared, and what is wrong."""

from dataclasses import dataclass

from spherekit.conventions import Facts
from spherekit.runs.run_result import MOTION
from spherekit.wording import listing


@dataclass(frozen=True)
class BoundedQuantity:
    """A quantity of poles (axes of relative rotation) with an error bound to check.

    Attributes
    ----------
    title
        Name of the quantity in sentences, in the plural.
    bound
        Attribute of `PoleField` that has the error bound.
    """

    title: str
    bound: str


BOUNDED_QUANTITIES = {
    "directions": BoundedQuantity("pole directions", "direction_error"),
    "rates": BoundedQuantity("rates", "velocity_coefficient_error"),
    "rate_derivatives": BoundedQuantity(
        "derivatives of rates", "acceleration_coefficient_error"
    ),
    "direction_derivatives": BoundedQuantity(
        "derivatives of pole directions", "direction_dq_error"
    ),
}
"""Quantities with an error bound, by their key in a verification."""


def format_verification(verification: Facts) -> list[str]:
    """Return the lines that tell a user the result of a verification.

    In a verification some rows of a run are computed again in many digits and compared. The
    lines state, one after another:

    - how many rows were verified;
    - the largest deviation in each column that deviates, of pair variables only the worst;
      also the largest deviation in roundings, perhaps in another row: divided by the
      rounding error of the number and by the condition number of the closure equations;
    - for each quantity with error bounds, how many errors are within their bound;
    - the rows that could not be computed in many digits, the worst row, and the analyses
      and samples that were not verified.

    Parameters
    ----------
    verification
        The result of `Verifier.verify`, with `describe_resumption` for a resumed run. It
        has a key "problem" if the verification was not possible.
    """
    if "problem" in verification:
        return [f"not verified: {verification['problem']}"]
    # Samples that were computed before the run was resumed are not verified.
    resumed_at = verification.get("resumed_at", 0)
    if not verification["rows"]:
        start = f" from sample {resumed_at} on" if resumed_at else ""
        return [
            f"verified: nothing, because no row{start} has a configuration and finite rates"
        ]
    lines = [
        f"verified {verification['rows']} rows in {verification['digits']} digits "
        f"({verification['seconds']:.1f} s): configurations within "
        f"{verification['largest_distance_rad']:.1e} rad, conditioning up to "
        f"{verification['largest_condition']:.1e}"
    ]
    for item in _columns_to_show(verification["columns"]):
        if item["deviation"]:
            unit = f" {item['unit']}" if item["unit"] else ""
            lines.append(
                f"  {item['table']}.{item['column']}: off by {item['deviation']:.1e}"
                f"{unit} at {_describe_row(item)} "
                f"(all rows: at most {item['in_roundings']:.2g} times the expected "
                "rounding error)"
            )
    # `over_bound` is the largest ratio of an error to its bound; it should be at most 1.
    for name, quantity in BOUNDED_QUANTITIES.items():
        facts = verification[name]
        if facts["count"]:
            lines.append(
                f"  {facts['within_bound']} of {facts['count']} {quantity.title} "
                "are within their error bound; the error nearest to its bound is "
                f"{facts['error']:.1e}, {facts['over_bound']:.2g} times the bound, at "
                f"{_describe_row(facts)}"
            )
    lines += [
        f"  no reference at {_describe_row(row)}: {row['status']}"
        for row in verification["without_reference"]
    ]
    worst = verification["worst"]
    lines.append(
        f"  worst row: {_describe_row(worst)}: {worst['column']} = {worst['value']!r}, "
        f"in {verification['digits']} digits {worst['reference']!r}"
    )
    # Two kinds of analyses are not verified. Some have failed. Others find configurations
    # of their own, such as singular configurations, but only configurations of the run are
    # computed again in many digits.
    if verification["not_verified"]:
        lines.append(
            "  not verified, because they failed or search for configurations themselves: "
            + ", ".join(verification["not_verified"])
        )
    if resumed_at:
        lines.append(
            f"  samples before {resumed_at} are not verified, because they were computed "
            "before the run was resumed"
        )
    return lines


def describe_resumption(resumed_at: int, sample_count: int) -> Facts:
    """Return what the verification of a resumed run states about earlier samples.

    Parameters
    ----------
    resumed_at
        Number of samples that were computed before the run was resumed. They cannot be
        verified. It is 0 if no run was resumed.
    sample_count
        Number of samples of the whole run.

    Returns
    -------
    Entries to add to the verification, none if no run was resumed.
    """
    if not resumed_at:
        return {}
    facts: Facts = {"resumed_at": resumed_at}
    if resumed_at == sample_count:
        facts["problem"] = "all samples were computed before the run was resumed"
    return facts


def _columns_to_show(columns: list[Facts]) -> list[Facts]:
    """Return the compared columns to print.

    Pair variables are the columns of the table `MOTION`. Only the one with the largest
    deviation is printed.
    """
    variables = [item for item in columns if item["table"] == MOTION]
    others = [item for item in columns if item["table"] != MOTION]
    worst_variable = sorted(variables, key=lambda item: item["deviation"])[-1:]
    return worst_variable + others


def verification_failures(verification: Facts) -> list[str]:
    """Return a sentence for each fault that a verification has shown.

    In a verification some rows of a run (samples in assembly modes) are computed again in
    many digits and compared. Faults are deviations that rounding does not explain, errors
    above their error bounds, and rows without a solution in many digits.

    Parameters
    ----------
    verification
        The result of `Verifier.verify`. It has a key "problem" if the verification was not
        possible.
    """
    sentences = []
    if "problem" in verification:
        sentences.append(f"verify: no row was verified: {verification['problem']}")
    if verification.get("beyond"):
        sentences.append(
            f"verify: {listing(verification['beyond'])} deviate by more than rounding from "
            f"their values in {verification['digits']} digits"
        )
    for name, quantity in BOUNDED_QUANTITIES.items():
        facts = verification.get(name)
        if facts and facts["within_bound"] < facts["count"]:
            sentences.append(
                f"verify: {facts['count'] - facts['within_bound']} of {facts['count']} "
                f"{quantity.title} have an error above their error bound"
            )
    if verification.get("without_reference"):
        rows = listing(
            f"{_describe_row(row)} ({row['status']})"
            for row in verification["without_reference"]
        )
        sentences.append(
            f"verify: the computation with many digits found no solution for {rows}"
        )
    return sentences


def _describe_row(item: Facts) -> str:
    """Return sample, assembly mode and subject of a row in words."""
    subject = "".join(f", {key} {name}" for key, name in item.get("subject", {}).items())
    return f"sample {item['sample']}, assembly mode {item['assembly_mode']}{subject}"
