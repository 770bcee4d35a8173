"""Tolerances that decide a status: each once, explained, and in the table of the docs."""

import ast
import re
from pathlib import Path

import pytest
from helpers.source_files import tree_of

from spherekit import tolerances

ROOT = Path(__file__).parent.parent
MODULE = ROOT / "spherekit" / "tolerances.py"
PAGE = ROOT / "docs" / "tolerances.md"
NOT_IN_TABLE = {"EPS"}
"""The spacing of floats decides no status."""


def constants_of(path):
    """Yield name, source of the value and docstring of each constant of a Python module.

    The docstring of a constant is the text that stands alone after it; it is empty if there
    is none. Tests check that each tolerance is explained.
    """
    source = path.read_text(encoding="utf-8")
    statements = ast.parse(source).body
    next_statements = [*statements[1:], None]
    for statement, following in zip(statements, next_statements, strict=True):
        if not isinstance(statement, ast.Assign):
            continue
        target = statement.targets[0]
        if not isinstance(target, ast.Name):
            continue
        stands_alone = isinstance(following, ast.Expr)
        if stands_alone and isinstance(following.value, ast.Constant):
            docstring = following.value.value
        else:
            docstring = ""
        yield target.id, ast.get_source_segment(source, statement.value), docstring


CONSTANTS = {
    name: (value, docstring)
    for name, value, docstring in constants_of(MODULE)
    if name not in NOT_IN_TABLE
}
"""Source of the value and docstring of each tolerance, by name."""


@pytest.mark.parametrize("name", CONSTANTS)
def test_a_tolerance_says_what_changes_with_it(name):
    """What a larger value, or one nearer to zero, does; or the same as for another one."""
    _, docstring = CONSTANTS[name]
    says_effect = "arger" in docstring or "earer to zero" in docstring
    assert says_effect or "The same for" in docstring


def test_the_table_of_the_docs_has_the_names_and_values_of_the_module():
    rows = re.findall(r"^\| `(\w+)` \| (\S.*?) \|", PAGE.read_text("utf-8"), re.M)
    assert dict(rows) == {name: value for name, (value, _) in CONSTANTS.items()}
    assert all(isinstance(getattr(tolerances, name), float) for name in CONSTANTS)


def test_no_other_module_defines_a_constant_of_these_names():
    for path in sorted((ROOT / "spherekit").rglob("*.py")):
        if path != MODULE:
            names = {
                target.id
                for statement in tree_of(path).body
                if isinstance(statement, ast.Assign)
                for target in statement.targets
                if isinstance(target, ast.Name)
            }
            assert names.isdisjoint(CONSTANTS), path
