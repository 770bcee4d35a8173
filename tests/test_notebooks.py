"""The notebooks of the pages run, cell after cell, and what cells end with is shown."""

import ast
import re
from pathlib import Path

import numpy as np
import pytest

NOTEBOOKS = sorted((Path(__file__).parent.parent / "docs" / "notebooks").glob("*.md"))
CELL = re.compile(r"^```\{code-cell\} ipython3\n(.*?)^```$", re.M | re.S)
CHECKS = {
    "first_steps": lambda names, last: (
        last
        and len(names["roots"]) == 2
        and np.degrees(names["roots"]) == pytest.approx(sorted(names["in_mode_0"]["q"]))
    ),
    "wrist": lambda names, last: (
        any("30.9007" in text for text in last)
        and min(abs(d - names["wanted"]).max() for d in names["pointed"]) < 1e-12
    ),
    "dynamics": lambda names, last: (
        abs(names["work"] - names["work_against_loads"]) < 1e-3
        and abs(names["states"].q.ravel() - names["simulated"]["q"]).max() < 1e-9
    ),
}
"""What the text around the cells says of them."""


def shown(value):
    """Return what a notebook would make of a value."""
    for name in ("_repr_html_", "_repr_png_"):
        text = getattr(value, name, lambda: None)()
        if text:
            return text
    return repr(value)


def run(path):
    """Run all cells, show what they end with, and check what the text says."""
    names: dict[str, object] = {}
    last = None
    for number, cell in enumerate(CELL.findall(path.read_text(encoding="utf-8"))):
        tree = ast.parse(cell)
        ends = isinstance(tree.body[-1], ast.Expr)
        body = tree.body[:-1] if ends else tree.body
        exec(compile(ast.Module(body, []), f"{path.name} cell {number}", "exec"), names)
        if ends:
            expression = ast.Expression(tree.body[-1].value)
            last = eval(compile(expression, f"{path.name} cell {number}", "eval"), names)
            assert shown(last)
    assert CHECKS[path.stem](names, last)


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_cells_run_and_show_something(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run(path)
