"""The files of the product, each parsed once for all tests of a process."""

import ast
import functools
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
PACKAGE = ROOT / "spherekit"
FILES = sorted(PACKAGE.rglob("*.py"))
ANALYSES = sorted((ROOT / "analyses").rglob("*.py"))


@functools.cache
def tree_of(path):
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


@functools.cache
def nodes_of(path):
    """Return all nodes of the syntax tree of a file."""
    return tuple(ast.walk(tree_of(path)))
