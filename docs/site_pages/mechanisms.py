"""A page for every shipped mechanism, from its file and a run of it."""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import spherekit as sk
from site_pages.picture import save_picture
from spherekit.files.library import shipped

SAMPLES = {1: 91, 2: (7, 7), 3: (4, 4, 4)}
"""Samples that a page's numbers are taken from, by the number of inputs."""
SINGULARITIES_UP_TO = 8
"""Links up to which a page lists singular positions: a search of seconds."""

INDEX = """\
# Shipped mechanisms

Each page is made from the mechanism's file by this build: what it is and where it comes
from, a picture, its Table, its freedoms, assembly modes, swings and singular positions, and
the file.

| mechanism | links | pairs | inputs | what it is |
|---|---:|---|---|---|
{rows}

```{{toctree}}
:hidden:

{names}
```
"""

PAGE = """\
# {name}

{citation}.

{assumed}

![{name} on the unit sphere in a configuration of its first assembly mode]({name}.png)

Links are arcs between the axes of their pairs, wheels and cams the curves that touch;
dotted is what lies behind.

## Numbers

{numbers}

## Table

Which pole axis is found in which pass ([how the planner thinks](../../planner.md)):

```text
{table}
```

{swings}

{singular}

## File

```toml
{file}
```

## Try it

```text
spherekit view {name}
spherekit run {name} --save {name}.rrd
spherekit view {name}.rrd --web
spherekit plan {name} --steps
```
"""


LINKED = re.compile(r"generated/mechanisms/(\w+)\.md")


def pages(home: Path, only: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield the pages with their paths: of all, or of those named or linked from pages."""
    if only:
        texts = (page.read_text("utf-8") for page in home.rglob("*.md"))
        linked = {name for text in texts for name in LINKED.findall(text)} - {"index"}
        only = sorted({*only, *linked})
    files = {name: path for pack in shipped() for name, path in pack.files.items()}
    rows = []
    for name in sorted(only or sk.mechanisms()):
        mechanism = sk.load(name)
        if not mechanism.inputs:
            mechanism = mechanism.with_inputs(mechanism.pairs[0].name)
        rows.append(_row(mechanism))
        folder = home / "generated" / "mechanisms"
        folder.mkdir(parents=True, exist_ok=True)
        save_picture(mechanism, folder / f"{name}.png")
        yield (
            f"mechanisms/{name}.md",
            _page(mechanism, files[name].read_text("utf-8").rstrip()),
        )
    names = "\n".join(sorted(only or sk.mechanisms()))
    yield "mechanisms/index.md", INDEX.format(rows="\n".join(rows), names=names)


def _row(mechanism: sk.Mechanism) -> str:
    citation = mechanism.source.citation if mechanism.source else ""
    driven = ", ".join(each.pair for each in mechanism.inputs)
    return (
        f"| [{mechanism.name}]({mechanism.name}.md) | {len(mechanism.links)} "
        f"| {_pairs(mechanism)} | {driven} | {citation} |"
    )


def _pairs(mechanism: sk.Mechanism) -> str:
    kinds = [pair.type for pair in mechanism.pairs]
    return " ".join(
        f"{kinds.count(kind)} {kind}" for kind in ("R", "Cr", "Cs") if kind in kinds
    )


def _page(mechanism: sk.Mechanism, file: str) -> str:
    source = mechanism.source
    inputs = len(mechanism.inputs)
    asked = inputs == 1 and len(mechanism.links) <= SINGULARITIES_UP_TO
    result = sk.run(
        mechanism, ["singularities"] if asked else ["poles"], samples=SAMPLES[inputs]
    )
    return PAGE.format(
        name=mechanism.name,
        citation=source.citation.rstrip(".") if source else "",
        assumed=f"Assumed: {source.assumed}." if source and source.assumed else "",
        numbers=_numbers(mechanism, result.summary),
        table=sk.table(sk.plan(mechanism)),
        swings=_swings(mechanism, result) if inputs == 1 else "",
        singular=_singular(mechanism, result) if asked else "",
        file=file,
    )


def _numbers(mechanism: sk.Mechanism, summary: dict[str, Any]) -> str:
    mobility = summary["mobility"]
    ranges = "; ".join(
        f"{name} from {np.degrees(low):g}° to {np.degrees(high):g}°"
        for name, (low, high) in summary["inputs"].items()
    )
    outputs = ", ".join(output.name for output in mechanism.outputs) or "none declared"
    modes = summary["assembly_modes"]
    rows = [
        ("links, pairs", f"{len(mechanism.links)} links; {_pairs(mechanism)}"),
        ("mobility", f"{mobility['graph']} by the graph, {mobility['rank']} by rank"),
        ("inputs", ranges),
        ("outputs", outputs),
        ("Assur groups", ", ".join(summary["groups"]) or "none"),
        ("assembly modes", f"{len(modes)}: {', '.join(mode['mode'] for mode in modes)}"),
        ("how they were found", summary["search"]),
        ("samples", ", ".join(f"{n} {status}" for status, n in summary["status"].items())),
    ]
    constraints = summary["redundant_constraints"]["count"]
    if constraints:
        rows.insert(2, ("redundant constraints", str(constraints)))
    return "\n".join(
        ["| | |", "|---|---|", *(f"| {key} | {value} |" for key, value in rows)]
    )


def _swings(mechanism: sk.Mechanism, result: sk.RunResult) -> str:
    frame = result.frame("motion")
    frame = frame[frame["status"] == "OK"]
    driven = {f"theta_{each.pair}" for each in mechanism.inputs}
    columns = [c for c in frame.columns if c.startswith("theta_") and c not in driven]
    if not columns:
        return ""
    lines = [
        "## Swings",
        "",
        "How far each R pair turns over the input's range, in degrees, by assembly mode.",
        "",
        f"| assembly mode | {' | '.join(c.removeprefix('theta_') for c in columns)} |",
        f"|---|{'---:|' * len(columns)}",
    ]
    for mode, rows in frame.groupby("assembly_mode", observed=True):
        turned = [np.ptp(np.degrees(np.unwrap(rows[c].to_numpy()))) for c in columns]
        lines.append(f"| {mode} | {' | '.join(f'{angle:.1f}' for angle in turned)} |")
    return "\n".join(lines)


def _singular(mechanism: sk.Mechanism, result: sk.RunResult) -> str:
    frame = result.frame("singularities")
    lines = ["## Singular positions", ""]
    if frame.empty:
        return "\n".join([*lines, f"None for {_outputs(mechanism)}."])
    lines += [
        "| type | input, degrees | assembly mode | output | what coincides |",
        "|---|---:|---|---|---|",
    ]
    lines += [
        f"| {row.kind} | {np.degrees(row.q):.4f} | {row.assembly_mode} | {row.output} "
        f"| {row.note} |"
        for row in frame.sort_values(["kind", "q"]).itertuples()
    ]
    return "\n".join(
        [*lines, "", f"What is known of others: {frame['guarantee'].iloc[0]}."]
    )


def _outputs(mechanism: sk.Mechanism) -> str:
    named = ", ".join(output.name for output in mechanism.outputs)
    return f"the outputs {named}" if named else "any output"
