"""A page for every shipped mechanism, from its file and a run of it."""

import re
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

import spherekit as sk
from site_pages import moving
from site_pages.picture import save_pictures
from spherekit.escaping import markdown_text
from spherekit.files.library import shipped
from spherekit.wording import counted

FOLDER = "generated/mechanisms"
MAX_SAMPLES = 91
"""Samples from which the numbers of a page are taken. More: the site takes longer to build,
and the ranges on the page are a little closer to the true ones."""
LONGEST_CARD_TEXT = 90
"""Letters of the description that fit on a card of the index; longer: numbers instead."""
KINDS = ("Four and six bars", "Wrists", "Cams, cones and gears", "Eight bars and more")
"""The groups of the index."""

INDEX = """\
# Shipped mechanisms

Each of these mechanisms comes with spherekit. Commands and `sk.load` take its name in place
of the path of a file. `spherekit new mechanism NAME --like four_bar` copies the file of
`four_bar`, so that you can change it.

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

{description}

```{{moving}} {name}
```

Drag the sphere to turn it, and drag the ringed knob to move the input.
[Pages](../../pages.md) explains the other controls.

## Properties

{numbers}

## Pole table

Each entry says how the pole axis of two links is found: x is the axis of a pair, and a
Roman numeral is the pass in which it is constructed from other poles
([explanation](../../planner.md)).

```text
{table}
```

{swings}

{singular}

## Try it

```text
spherekit run {name}
spherekit run {name} -a singularities
spherekit plan {name} --steps
spherekit run {name} -o {name} --save {name}/{name}.rrd --view
spherekit page {name} -o {name}.html
```

These commands print its motion, its singularities and the construction of its poles, show a
recording, and write the moving page above as one file.

## File

:::{{dropdown}} {name}.toml
```toml
{file}
```
:::

{source}
"""


LINKED = re.compile(r"generated/mechanisms/(\w+?)(?:_card\.png|>`)|\{moving\} (\w+)")


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
    text = re.split(r"[:.]", mechanism.description)[0]
    if not text or len(text) > LONGEST_CARD_TEXT:
        inputs = len(mechanism.inputs)
        text = f"{counted(len(mechanism.links), 'link')}; {_pairs(mechanism)}"
        text += f"; {inputs} inputs" if inputs > 1 else ""
    return CARD.format(name=mechanism.name, said=markdown_text(text))


def _pairs(mechanism: sk.Mechanism) -> str:
    kinds = [pair.type for pair in mechanism.pairs]
    counts = [f"{kinds.count(kind)} {kind}" for kind in ("R", "Cr", "Cs") if kind in kinds]
    return f"{', '.join(counts)} pairs"


def _page(mechanism: sk.Mechanism, file: str) -> str:
    inputs = len(mechanism.inputs)
    asked = _kind(mechanism) == KINDS[0]  # a search of a second; of others up to twenty
    analysis = "singularities" if asked else "poles"
    result = sk.run(mechanism, [analysis], samples=_samples(inputs))
    return PAGE.format(
        name=mechanism.name,
        description=_description(mechanism),
        numbers=_numbers(mechanism, result.summary),
        table=sk.table(sk.plan(mechanism)),
        swings=_swings(mechanism, result) if inputs == 1 else "",
        singular=_singular(mechanism, result) if asked else "",
        file=file,
        source=_source(mechanism),
    )


def _samples(inputs: int) -> int | tuple[int, ...]:
    """Return the samples of a run: a grid, or a path if a grid would be too large."""
    samples_per_input = int(MAX_SAMPLES ** (1.0 / inputs))
    if inputs == 1 or samples_per_input < 2:
        return MAX_SAMPLES
    return (samples_per_input,) * inputs


def _description(mechanism: sk.Mechanism) -> str:
    """Return what the mechanism is: the text of its file, or its numbers without one."""
    if mechanism.description:
        return markdown_text(mechanism.description)
    inputs = counted(len(mechanism.inputs), "input")
    return f"A mechanism with {counted(len(mechanism.links), 'link')} and {inputs}."


def _source(mechanism: sk.Mechanism) -> str:
    """Return the section with the publication and the assumptions, if the file has them."""
    if mechanism.source is None:
        return ""
    lines = ["## Source", "", f"{markdown_text(mechanism.source.citation.rstrip('.'))}."]
    if mechanism.source.assumed:
        assumed = mechanism.source.assumed.rstrip(".")
        lines += ["", f"Assumed in addition: {markdown_text(assumed)}."]
    return "\n".join(lines)


def _numbers(mechanism: sk.Mechanism, summary: dict[str, Any]) -> str:
    """Return the table of properties: links, degrees of freedom, inputs, modes, samples."""
    ranges = "; ".join(
        f"{name} from {np.degrees(low):g}° to {np.degrees(high):g}°"
        for name, (low, high) in summary["inputs"].items()
    )
    outputs = ", ".join(output.name for output in mechanism.outputs) or "none declared"
    modes = summary["assembly_modes"]
    mode_names = ", ".join(
        str(mode["number"]) + (f" ({label})" if (label := _label(mode)) else "")
        for mode in modes
    )
    mobility = summary["mobility"]
    freedoms = str(mobility["rank"])
    if mobility["graph"] != mobility["rank"]:
        freedoms += f"; the Grübler formula gives {mobility['graph']}"
    sample_count = sum(summary["status"].values())
    rows = [
        (
            "links and pairs",
            f"{counted(len(mechanism.links), 'link')}; {_pairs(mechanism)}",
        ),
        ("degrees of freedom", freedoms),
        ("inputs", ranges),
        ("outputs", outputs),
        ("Assur groups", ", ".join(summary["groups"]) or "none"),
        ("assembly modes", f"{len(modes)}: {mode_names}"),
        ("completeness", summary["completeness"]),
        ("configurations", f"{summary['status'].get('OK', 0)} of {sample_count} close"),
    ]
    constraints = summary["redundant_constraints"]["count"]
    if constraints:
        rows.insert(2, ("redundant constraints", str(constraints)))
    lines = [f"| {name} | {value} |" for name, value in rows]
    return "\n".join(["| property | value |", "|---|---|", *lines])


def _label(mode: Mapping[str, Any]) -> str:
    """Return the name of an assembly mode in the file, or its signs, or nothing."""
    signs = mode["mode"].strip("~ ")  # ~ stands for a group without a sign
    return str(mode.get("name") or signs)


def _swings(mechanism: sk.Mechanism, result: sk.RunResult) -> str:
    frame = result.frame("motion")
    frame = frame[frame["status"] == "OK"]
    driven = {f"theta_{each.pair}" for each in mechanism.inputs}
    columns = [c for c in frame.columns if c.startswith("theta_") and c not in driven]
    if not columns:
        return ""
    lines = [
        "## Ranges of the pairs",
        "",
        "The difference between the largest and the smallest angle of each pair over the "
        "range of the input, in degrees.",
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
        "| type | input (deg) | assembly mode | output | geometric condition |",
        "|---|---:|---|---|---|",
    ]
    lines += [
        f"| {row.kind} | {np.degrees(row.q):.4f} | {row.assembly_mode} | {row.output} "
        f"| {row.note} |"
        for row in frame.sort_values(["kind", "q"]).itertuples()
    ]
    return "\n".join([*lines, "", f"Completeness: {frame['guarantee'].iloc[0]}."])


def _outputs(mechanism: sk.Mechanism) -> str:
    named = ", ".join(output.name for output in mechanism.outputs)
    return f"the outputs {named}" if named else "any output"
