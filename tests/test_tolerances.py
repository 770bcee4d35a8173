"""Tolerances that decide a status: each once, explained, and in the table of the docs."""

import ast
import re
from pathlib import Path

import pytest

from spherekit import tolerances

ROOT = Path(__file__).parent.parent
MODULE = ROOT / "spherekit" / "tolerances.py"
PAGE = ROOT / "docs" / "tolerances.md"
NOT_IN_TABLE = {"EPS"}
"""The spacing of floats decides no status."""


def assignments(path):
    """Yield name, source of the value and docstring of each constant of a module."""
    source = path.read_text(encoding="utf-8")
    body = ast.parse(source).body
    for statement, following in zip(body, [*body[1:], None], strict=True):
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name):
            docstring = ""
            if isinstance(following, ast.Expr) and isinstance(
                following.value, ast.Constant
            ):
                docstring = following.value.value
            value = ast.get_source_segment(source, statement.value)
            yield statement.targets[0].id, value, docstring


CONSTANTS = {
    name: (value, docstring)
    for name, value, docstring in assignments(MODULE)
    if name not in NOT_IN_TABLE
}


@pytest.mark.parametrize("name", CONSTANTS)
def test_a_tolerance_says_what_changes_with_it(name):
    _, docstring = CONSTANTS[name]
    says_both = "arger" in docstring or "earer to zero" in docstring
    assert says_both or "The same for" in docstring


def test_the_table_of_the_docs_has_the_names_and_values_of_the_module():
    rows = re.findall(r"^\| `(\w+)` \| (\S.*?) \|", PAGE.read_text("utf-8"), re.M)
    assert dict(rows) == {name: value for name, (value, _) in CONSTANTS.items()}
    assert all(isinstance(getattr(tolerances, name), float) for name in CONSTANTS)


def test_no_other_module_defines_a_constant_of_these_names():
    for path in sorted((ROOT / "spherekit").rglob("*.py")):
        if path != MODULE:
            names = {name for name, _, _ in assignments(path)}
            assert names.isdisjoint(CONSTANTS), path
