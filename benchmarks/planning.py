"""Time of planning poles and assembly, against the number of links."""

import statistics
import time

import numpy as np

from benchmarks.harness import Cell, Section, measure_rounds, median_ratio, median_time
from benchmarks.samples import grow_chain
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.planning.pole_planner import plan

PLANNED_LINK_COUNTS = (4, 6, 8, 12, 16, 24, 32, 48, 64, 80, 100)
QUICK_PLANNED_LINK_COUNTS = (4, 8, 16, 32)

MIN_FITTED_LINKS = 16
"""Smallest number of links in the fit of the growth.

Constant costs dominate the time of smaller chains.
"""

POLE_TIME_COLUMN = 4
GROUP_TIME_COLUMN = 6
"""Columns of the table with the times of both plans."""


def run(quick: bool) -> list[Section]:
    """Return the tables of chains of dyads and of chains with triads."""
    return [_measure_chains(quick, False), _measure_chains(quick, True)]


def _measure_chains(quick: bool, has_triads: bool) -> Section:
    """Measure both plans for random chains. A row has the medians over chains of a size."""
    link_counts = QUICK_PLANNED_LINK_COUNTS if quick else PLANNED_LINK_COUNTS
    chain_count = 2 if quick else 5
    round_count = 3 if quick else 5
    rows: list[tuple[Cell, ...]] = []
    for links in link_counts:
        pole_seconds = []
        group_seconds = []
        ratios = []
        block_counts = []
        largest_groups = []
        for seed in range(chain_count):
            mechanism = grow_chain(np.random.default_rng([links, seed]), links, has_triads)
            jobs = {
                "poles": lambda mechanism=mechanism: plan(mechanism),
                "groups": lambda mechanism=mechanism: plan_assembly(mechanism),
            }
            times = measure_rounds(jobs, round_count, 0.01, clock=time.process_time)
            pole_seconds.append(median_time(times, "poles"))
            group_seconds.append(median_time(times, "groups"))
            ratios.append(median_ratio(times, "poles", "groups"))
            block_counts.append(len(plan(mechanism).blocks))
            groups = plan_assembly(mechanism).groups
            largest_groups.append(max(len(group.bodies) for group in groups))
        pole_count = links * (links - 1) // 2
        rows.append(
            (
                links,
                pole_count,
                statistics.median(block_counts),
                max(largest_groups),
                1e3 * statistics.median(pole_seconds),
                1e6 * statistics.median(pole_seconds) / pole_count,
                1e3 * statistics.median(group_seconds),
                statistics.median(ratios),
            )
        )
    added = "dyads and triads" if has_triads else "dyads"
    title = "chains with irreducible parts" if has_triads else "chains of dyads"
    return Section(
        f"Planning: {title}",
        f"Each chain starts as a four-bar and grows by {added}, which are added at random "
        f"links. The times are medians of processor time over {chain_count} chains of each "
        "size. The plan of poles states how each of the m(m - 1)/2 pole axes of m links is "
        "computed, by passes of the Aronhold-Kennedy theorem or in irreducible parts. The "
        "plan of groups is the order in which positions are solved.",
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
        f"From {MIN_FITTED_LINKS} links on, the time of the plan of poles grows as the "
        f"number of links to the power {_fit_exponent(rows, POLE_TIME_COLUMN):.2f}, and "
        "that of the plan of groups to the power "
        f"{_fit_exponent(rows, GROUP_TIME_COLUMN):.2f}. The number of poles grows as "
        "the square of the number of links.",
    )


def _fit_exponent(rows: list[tuple[Cell, ...]], column: int) -> float:
    """Return the exponent of the growth of a column with the number of links.

    It is the slope of a line through the logarithms. The first column has the links.
    """
    large = [row for row in rows if float(row[0] or 0) >= MIN_FITTED_LINKS]
    links = np.log([float(row[0] or 0) for row in large])
    times = np.log([float(row[column] or 0) for row in large])
    return float(np.polyfit(links, times, 1)[0])
