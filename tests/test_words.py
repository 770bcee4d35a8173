"""One word for one thing: retired words are in no key, column, message or page."""

import ast
import json
import re
from pathlib import Path

import pytest

from spherekit.analysis.registry import load as analysis_of
from spherekit.analysis.registry import names
from spherekit.files.read import load

ROOT = Path(__file__).parent.parent
PAGES = [
    ROOT / "README.md",
    *(
        page
        for page in sorted((ROOT / "docs").rglob("*.md"))
        if "generated" not in page.parts
    ),
]
SOURCES = [
    *sorted((ROOT / "spherekit").rglob("*.py")),
    *sorted((ROOT / "analyses").glob("*.py")),
]
KEYS = {
    *("branch", "branches", "moved", "rate", "rate_dq", "flatness", "lattice", "show"),
    *("stops", "decided", "turns", "angle_I", "angle_II", "to_I", "to_II", "kinetic"),
    *("across", "push", "couple", "departure"),
}
"""Words that no key of a file and no column has any more."""
RETIRED = {
    r"\bbranch(?:es)?\b": r"a \*branch\* is a piece|\"branch\" and|branch(?:es)? points?",
    r"\bBRANCH_LOST\b": None,
    r"\brate_dq\b": None,
    r"\blattice\b": None,
    r"\bmid-plane form\b": None,
    r"\bno talk\b": None,
    r"\bspherekit size\b": None,
    r"\b[Ss]izings?\b": None,
    r"\b(?:size_of|quickest|online_model|grid_model|online_motion)\(": None,
    r"\bbefore any number is\b": None,
    r"\bhold by the inputs\b": None,
    r"\boff the fixed axis\b": None,
    r"(?<![Tt]here )\bis no "
    r"(?:pole|pose|mid-plane|CSV|Parquet|recording|trade|number|input)\b": None,
}
"""Words by pattern, each with what may stand around it."""
VAGUE = ("found", "own", "each", "known")
"""Words that no local is called, for a noun of the field says more."""


def retired(text):
    """Return the retired words of a text."""
    found = []
    for pattern, allowed in RETIRED.items():
        rest = re.sub(allowed, "", text) if allowed else text
        found += re.findall(pattern, rest)
    return found


def messages(path):
    """Return the texts of a module that are no docstrings, with their lines."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    docs = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    return [
        (node.lineno, node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and id(node) not in docs
    ]


def test_retired_words_are_told_apart():
    assert retired("a mode of this branch") and retired("the pose is no pole")
    assert not retired("a branching point, there is no pose, a *branch* is a piece of it")


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.stem)
def test_messages(path):
    wrong = [(line, text) for line, text in messages(path) if retired(text)]
    assert not wrong


def locals_of(path):
    """Return the names that the functions of a module bind, each with its line."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.arg):
            yield node.arg, node.lineno
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id, node.lineno


def test_locals_are_called_by_nouns_of_the_field():
    there = [
        f"{path.relative_to(ROOT)}:{line}: {name}"
        for path in SOURCES
        for name, line in locals_of(path)
        if name in VAGUE
    ]
    assert not there


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.stem)
def test_pages(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    assert not [(k, line) for k, line in enumerate(lines, 1) if retired(line)]


@pytest.mark.parametrize("path", sorted((ROOT / "spherekit").rglob("*.schema.json")))
def test_keys_of_files(path):
    def keys(node):
        if isinstance(node, dict):
            yield from node.get("properties", {})
            node = list(node.values())
        if isinstance(node, list):
            for item in node:
                yield from keys(item)

    assert not KEYS & set(keys(json.loads(path.read_text(encoding="utf-8"))))


@pytest.mark.parametrize("name", names())
@pytest.mark.parametrize("mechanism", ["four_bar", "five_bar"])
def test_columns_and_parameters(name, mechanism):
    made = analysis_of(name)
    columns = {
        column.name: column.meaning
        for table in made.tables
        for column in table.of(load(mechanism)).columns
    }
    parameters = set(made.__dataclass_fields__)
    assert not KEYS & (set(columns) | parameters)
    assert not [meaning for meaning in columns.values() if retired(meaning)]
