"""A page for every shipped mechanism, from its file and a run of it."""

import re
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import spherekit as sk
from site_pages import moving
from site_pages.picture import save_pictures
from spherekit.escaping import markdown_text
from spherekit.files.library import shipped

FOLDER = "generated/mechanisms"
SAMPLES_PER_INPUT = {1: 91, 2: 7, 3: 4}
"""Samples of each input that a page's numbers are taken from, by the number of inputs."""
LEAST_SAMPLES_PER_INPUT = 3
"""The same for more inputs. Larger: the number of configurations grows as its power."""
KINDS = ("Four and six bars", "Wrists", "Cams, cones and gears", "Eight bars and more")
"""The groups of the index."""

INDEX = """\
# Mechanisms

Every mechanism that is shipped, on a page made from its file: it moves, and has its Table,
freedoms, assembly modes and swings beside it.

{groups}

```{{toctree}}
:hidden:

{names}
```
"""

GROUP = """\
## {title}

::::{{grid}} 2 3 4 4
:gutter: 3

{cards}
::::
"""

CARD = """\
:::{{grid-item-card}} {name}
:img-top: {name}_card.png
:link: {name}
:link-type: doc
{said}
:::
"""

PAGE = """\
# {name}

{citation}.

```{{moving}} {name}
```

Drag the sphere to turn it and the ringed knob to drive the input; what else moves is on
[pages](../../pages.md). `spherekit page {name} -o {name}.html` makes this page as one file.

{assumed}

## Numbers

{numbers}

## Table

Which pole axis is found in which pass ([the planner](../../planner.md)):

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
spherekit run {name} -a singularities
spherekit page {name} -o {name}.html
```
"""


LINKED = re.compile(r"generated/mechanisms/(\w+?)(?:_card\.png|\.md)|\{moving\} (\w+)")


Pages = list[tuple[str, str]]


def pages(home: Path, only: Sequence[str], workers: int) -> Callable[[], Pages]:
    """Begin the pages of all, or of those named or linked from pages; return what waits."""
    if only:
        found = (path for path in home.rglob("*.md") if "generated" not in path.parts)
        texts = [page.read_text("utf-8") for page in found]
        linked = {"".join(names) for text in texts for names in LINKED.findall(text)}
        only = sorted({*only, *linked} - {"index"})
    names = sorted(only or sk.mechanisms())
    (home / FOLDER).mkdir(parents=True, exist_ok=True)
    pool = ProcessPoolExecutor(workers)
    made = [pool.submit(_made, name, home) for name in names]

    def wait() -> Pages:
        with pool:
            shown = [each.result() for each in made]
        return [*(page for page, *_ in shown), ("mechanisms/index.md", _index(shown))]

    return wait


def _made(name: str, home: Path) -> tuple[tuple[str, str], str, str]:
    """Return the path and text of a page, its group in the index, and its card there."""
    (path,) = (pack.files[name] for pack in shipped() if name in pack.files)
    mechanism = sk.load(name)
    page, last = home / FOLDER / f"{name}.md", home / moving.HOME / f"{name}.html"
    if _is_older(last, path, home) or not page.exists():
        save_pictures(mechanism, page.with_suffix(".png"))
        text = _page(mechanism, path.read_text("utf-8").rstrip())
        moving.make(mechanism, last)
    else:
        text = page.read_text("utf-8")
    return (f"mechanisms/{name}.md", text), _kind(mechanism), _card(mechanism)


def _is_older(made: Path, mechanism: Path, home: Path) -> bool:
    """Whether what was made is older than the mechanism, the package or this folder."""
    if not made.exists():
        return True
    folders = (Path(sk.__file__).parent, home / "site_pages")
    sources = [
        path for folder in folders for path in folder.rglob("*.*") if path.suffix != ".pyc"
    ]
    newest = max(path.stat().st_mtime for path in (mechanism, *sources))
    return made.stat().st_mtime < newest


def _index(made: Sequence[tuple[tuple[str, str], str, str]]) -> str:
    groups = []
    for title in KINDS:
        cards = [card for _, kind, card in made if kind == title]
        groups += [GROUP.format(title=title, cards="\n".join(cards))] if cards else []
    names = "\n".join(Path(page).stem for (page, _), *_ in made)
    return INDEX.format(groups="\n".join(groups), names=names)


def _kind(mechanism: sk.Mechanism) -> str:
    """Return the group of the index that a mechanism is shown in."""
    bars, wrists, contacts, chains = KINDS
    if any(pair.type != "R" for pair in mechanism.pairs):
        return contacts
    if len(mechanism.inputs) > 1:
        return wrists
    return bars if len(mechanism.links) <= 6 else chains


def _card(mechanism: sk.Mechanism) -> str:
    inputs = len(mechanism.inputs)
    said = f"{len(mechanism.links)} links; {_pairs(mechanism)}"
    said += f"; {inputs} inputs" if inputs > 1 else ""
    return CARD.format(name=mechanism.name, said=said)


def _pairs(mechanism: sk.Mechanism) -> str:
    kinds = [pair.type for pair in mechanism.pairs]
    return " ".join(
        f"{kinds.count(kind)} {kind}" for kind in ("R", "Cr", "Cs") if kind in kinds
    )


def _page(mechanism: sk.Mechanism, file: str) -> str:
    source = mechanism.source
    assumed = source.assumed if source else ""
    inputs = len(mechanism.inputs)
    asked = _kind(mechanism) == KINDS[0]  # a search of a second; of others up to twenty
    samples = (SAMPLES_PER_INPUT.get(inputs, LEAST_SAMPLES_PER_INPUT),) * inputs
    result = sk.run(mechanism, ["singularities"] if asked else ["poles"], samples=samples)
    return PAGE.format(
        name=mechanism.name,
        citation=markdown_text(source.citation.rstrip(".")) if source else "",
        assumed=f"Assumed: {markdown_text(assumed)}." if assumed else "",
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
