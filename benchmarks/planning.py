"""Planning time against the number of links."""

import statistics
import time

import numpy as np

from benchmarks.harness import Cell, Section, median, ratio, rounds
from benchmarks.samples import grown
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.planning.pole_planner import plan

SIZES = (4, 6, 8, 12, 16, 24, 32, 48, 64, 80, 100)
QUICK = (4, 8, 16, 32)
FIT_FROM = 16
"""Smaller chains are dominated by constant costs and left out of the exponent."""


def run(quick: bool) -> list[Section]:
    """Return the tables of chains of dyads and of chains with irreducible parts."""
    return [_table(quick, False), _table(quick, True)]


def _table(quick: bool, triads: bool) -> Section:
    sizes, chains, repeats = (QUICK, 2, 3) if quick else (SIZES, 5, 5)
    rows: list[tuple[Cell, ...]] = []
    for links in sizes:
        poles, groups, relation, blocks, largest = [], [], [], [], []
        for seed in range(chains):
            made = grown(np.random.default_rng([links, seed]), links, triads)
            jobs = {
                "poles": lambda made=made: plan(made),
                "groups": lambda made=made: plan_assembly(made),
            }
            times = rounds(jobs, repeats, 0.01, now=time.process_time)
            poles.append(median(times, "poles"))
            groups.append(median(times, "groups"))
            relation.append(ratio(times, "poles", "groups"))
            blocks.append(len(plan(made).blocks))
            found = plan_assembly(made).groups
            largest.append(max(len(group.bodies) for group in found))
        count = links * (links - 1) // 2
        rows.append(
            (
                links,
                count,
                statistics.median(blocks),
                max(largest),
                1e3 * statistics.median(poles),
                1e6 * statistics.median(poles) / count,
                1e3 * statistics.median(groups),
                statistics.median(relation),
            )
        )
    what = "dyads and triads" if triads else "dyads"
    title = "chains with irreducible parts" if triads else "chains of dyads"
    return Section(
        f"Planning: {title}",
        f"A four-bar grown by {what} added at random links ({chains} seeded chains of "
        "each size, medians over them). `poles` is the plan of all m(m - 1)/2 pole "
        "axes by Aronhold-Kennedy passes with irreducible parts; `groups` is the order "
        "in which positions are solved.",
        (
            "links",
            "poles",
            "irreducible parts",
            "largest group, bodies",
            "plan of poles, ms",
            "us per pole",
            "plan of groups, ms",
            "poles / groups",
        ),
        rows,
        f"Fitted growth from {FIT_FROM} links on: plan of poles as links to the power "
        f"{_exponent(rows, 4):.2f}, plan of groups {_exponent(rows, 6):.2f}. The "
        "number of poles alone grows as the power 2.",
    )


def _exponent(rows: list[tuple[Cell, ...]], column: int) -> float:
    """Return the slope of the logarithm of a column over that of the links."""
    large = [row for row in rows if float(row[0] or 0) >= FIT_FROM]
    links = np.log([float(row[0] or 0) for row in large])
    times = np.log([float(row[column] or 0) for row in large])
    return float(np.polyfit(links, times, 1)[0])
