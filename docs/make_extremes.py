"""Write the figures of docs/extremes.md from the record of a run of all its cases.

In the root of the repository ``python -m benchmarks extremes --json docs/extremes.json``
takes the record anew; then run ``python docs/make_extremes.py``.
"""

import json
import re
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parent
PAGE, RECORD = DOCS / "extremes.md", DOCS / "extremes.json"
FIGURES = re.compile(r"(?<=^## Figures\n\n).*?(?=^## )", re.M | re.S)

TEXT = """\
Measured at commit {commit} ({machine}).
`python -m benchmarks --list` describes each case. "Ratio" is the largest error divided by
(unit roundoff x conditioning), among rows with a conditioning of at most 1e12. The next
column names the quantity and the value of the parameter at which this largest error occurs.
"Wrong" counts numbers whose error exceeds the limit of the rule above, although no status
marks them: {wrong}.

| family | case | from, to | ratio | quantity | first status | statuses | wrong |
|---|---|---|---:|---|---|---|---:|
"""


def figures(record: Any) -> str:
    """Return the figures as Markdown."""
    lines, wrong = [], {}
    for section in record["benchmarks"]["extremes"]:
        family = section["title"].removeprefix("Extremes: ")
        for row in section["rows"]:
            cells = dict(zip(section["columns"], row, strict=True))
            over, missed = (
                cells["error / (roundoff x conditioning)"],
                cells["wrong without a status"],
            )
            shown = "-" if over is None else f"{over:.2g}"
            named = f"`{cells['case']}`"
            lines.append(
                f"| {family} | {named} | {cells['from, to']} | {shown} | {cells['of']} | "
                f"{cells['first status']} | {cells['statuses']} | {missed or ''} |"
            )
            family = ""
            if missed:
                wrong[named] = missed
    machine = ", ".join(
        text if key in ("processor", "system") else f"{key} {text}"
        for key, text in record["machine"].items()
        if key not in ("cores", "spherekit")
    )
    every = ", ".join(f"{count} of {named}" for named, count in wrong.items()) or "none"
    text = TEXT.format(commit=record["commit"], machine=machine, wrong=every)
    return text + "\n".join(lines) + "\n\n"


def page() -> str:
    """Return the text of the page with the figures of the record."""
    made = figures(json.loads(RECORD.read_text(encoding="utf-8")))
    return FIGURES.sub(lambda _: made, PAGE.read_text(encoding="utf-8"))


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
