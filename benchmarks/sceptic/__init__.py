"""What one analysis says of a mechanism against what another says of it.

`python -m benchmarks sceptic [COUNT] [SEED]` runs every analysis by its default command
on all shipped mechanisms and on COUNT random ones from SEED on, and reads what comes out
as a sceptic would: see `benchmarks.sceptic.checks` for what is asked.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from itertools import chain

from benchmarks.report import Section, markdown
from benchmarks.sceptic.checks import CHECKS
from benchmarks.sceptic.examine import BUDGET, LIMIT, Examined, examine
from benchmarks.sceptic.finding import Kind
from benchmarks.sceptic.suspects import random_suspects, shipped_suspects

QUICK = ("four_bar", "five_bar", "bevel_pair")
"""The shipped mechanisms of a short run."""


def run(quick: bool) -> list[Section]:
    """Return what was asked, and what contradicts, of shipped and random mechanisms."""
    names = QUICK if quick else ()
    suspects = [*shipped_suspects(names), *random_suspects(10 if quick else 50, 0)]
    return sections(examine(suspects))


def sections(examined: Sequence[Examined]) -> list[Section]:
    """Return a table of checks and one of findings."""
    asked = []
    for name, check in CHECKS.items():
        own = [each.noted[name] for each in examined if name in each.noted]
        if not own:
            continue
        asked.append(
            (
                name,
                check.text,
                sum(1 for notes in own if notes.compared),
                sum(notes.compared for notes in own),
                sum(notes.seconds for notes in own),
                *(
                    sum(1 for notes in own for each in notes.findings if each.kind is kind)
                    for kind in Kind
                ),
            )
        )
    found = [
        (each.name, finding.check, finding.kind.value, finding.what)
        for each in examined
        for notes in each.noted.values()
        for finding in notes.findings
    ]
    refused: Counter[str] = Counter()
    for each in examined:
        for notes in each.noted.values():
            for text in notes.refused:
                refused[text] += 1
    unasked = sum(len(each.unasked) for each in examined)
    wrong = sum(each.contradictions for each in examined)
    seconds = sum(each.seconds for each in examined)
    return [
        Section(
            "Analyses against each other",
            f"{len(examined)} mechanisms: "
            + ", ".join(f"{n} {kind}" for kind, n in _kinds(examined).items())
            + ". `of` counts the mechanisms on which a check had something to compare.",
            ("check", "what is asked", "of", "comparisons", "s", *(k.value for k in Kind)),
            asked,
            f"{wrong} contradictions in {seconds:.0f} s of processor time; {unasked} "
            f"checks were left out, those of mechanisms that took more than {BUDGET:g} s.",
        ),
        Section(
            "What contradicts",
            "Each with what reproduces it: mechanism, check and place.",
            ("mechanism", "check", "kind", "what"),
            found,
            "" if found else "Nothing.",
        ),
        Section(
            "What was refused",
            "Analyses that say they do not apply, by what they say first.",
            ("refusal", "times"),
            refused.most_common(),
        ),
    ]


def _kinds(examined: Sequence[Examined]) -> dict[str, int]:
    kinds = [each.kind for each in examined]
    return {kind: kinds.count(kind) for kind in dict.fromkeys(kinds)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Examine mechanisms, print what contradicts; 1 if anything does."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks sceptic")
    parser.add_argument(
        "count", nargs="?", type=int, default=50, help="random mechanisms, default 50"
    )
    parser.add_argument("seed", nargs="?", type=int, default=0, help="the first's seed")
    parser.add_argument(
        "--only", action="append", metavar="NAME", help="these mechanisms: a shipped one "
        "by its name, a random one as random_SEED"
    )  # fmt: skip
    parser.add_argument("--check", action="append", metavar="CHECK", help="these checks")
    parser.add_argument("--random", action="store_true", help="no shipped mechanisms")
    parser.add_argument(
        "--limit",
        type=float,
        default=LIMIT,
        help=f"seconds of processor time a check may take, default {LIMIT:g}",
    )
    options = parser.parse_args(arguments)
    checks = options.check or list(CHECKS)
    unknown = [name for name in checks if name not in CHECKS]
    if unknown:
        parser.error(f"no check is named {unknown[0]}; choose from {', '.join(CHECKS)}")
    if options.only:
        drawn = [name[7:] for name in options.only if name.startswith("random_")]
        named = [name for name in options.only if not name.startswith("random_")]
        suspects = chain(
            shipped_suspects(named) if named else (),
            (s for seed in drawn for s in random_suspects(1, int(seed))),
        )
    else:
        suspects = chain(
            () if options.random else shipped_suspects(),
            random_suspects(options.count, options.seed),
        )
    examined = examine(suspects, checks, options.limit, tell=sys.stderr)
    for section in sections(examined):
        print("\n" + markdown(section))
    return 1 if any(each.contradictions for each in examined) else 0
