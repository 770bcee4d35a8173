"""One word for one thing: retired words are in no key, column, message or page."""

import ast
import json
import re

import pytest
from helpers.source_files import ANALYSES, FILES, PACKAGE, ROOT, nodes_of

from spherekit.files.mechanism_reader import load
from spherekit.runs.registry import analysis_names
from spherekit.runs.registry import load_analysis as analysis_of

PAGES = [
    ROOT / "README.md",
    *(
        page
        for page in sorted((ROOT / "docs").rglob("*.md"))
        if "generated" not in page.parts
    ),
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


ANY_RETIRED = re.compile("|".join(RETIRED))


def retired(text):
    """Return the retired words of a text, but for those in a phrase that is allowed."""
    if not ANY_RETIRED.search(text):
        return []
    words = []
    for pattern, allowed in RETIRED.items():
        rest = re.sub(allowed, "", text) if allowed else text
        words += re.findall(pattern, rest)
    return words


def messages(path):
    """Return (line, text) of every text of a module that is no docstring."""
    docstring_ids = set()
    for node in nodes_of(path):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            docstring_ids.add(id(node.value))
    texts = []
    for node in nodes_of(path):
        is_text = isinstance(node, ast.Constant) and isinstance(node.value, str)
        if is_text and id(node) not in docstring_ids:
            texts.append((node.lineno, node.value))
    return texts


def test_retired_words_are_told_apart():
    assert retired("a mode of this branch") and retired("the pose is no pole")
    assert not retired("a branching point, there is no pose, a *branch* is a piece of it")


def test_messages_and_pages_have_no_retired_words():
    """Texts of all modules but docstrings, and all lines of the documentation."""
    texts_by_path = {path: messages(path) for path in (*FILES, *ANALYSES)}
    for page in PAGES:
        texts_by_path[page] = enumerate(page.read_text("utf-8").splitlines(), 1)
    faults = [
        f"{path.relative_to(ROOT)}:{line}: {text}"
        for path, texts in texts_by_path.items()
        for line, text in texts
        if retired(text)
    ]
    assert not faults


def locals_of(path):
    """Return the names that the functions of a module bind, each with its line."""
    for node in nodes_of(path):
        if isinstance(node, ast.arg):
            yield node.arg, node.lineno
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id, node.lineno


def test_locals_are_called_by_nouns_of_the_field():
    faults = [
        f"{path.relative_to(ROOT)}:{line}: {name}"
        for path in (*FILES, *ANALYSES)
        for name, line in locals_of(path)
        if name in VAGUE
    ]
    assert not faults


@pytest.mark.parametrize("path", sorted(PACKAGE.rglob("*.schema.json")))
def test_keys_of_files_are_no_retired_words(path):
    """Every property of a JSON schema, at any depth."""

    def keys(node):
        """Yield the keys that a schema, or a list in it, describes."""
        if isinstance(node, dict):
            yield from node.get("properties", {})
            node = list(node.values())
        if isinstance(node, list):
            for item in node:
                yield from keys(item)

    assert not KEYS & set(keys(json.loads(path.read_text(encoding="utf-8"))))


@pytest.mark.parametrize("name", analysis_names())
@pytest.mark.parametrize("mechanism", ["four_bar", "five_bar"])
def test_columns_and_parameters_of_analyses_are_no_retired_words(name, mechanism):
    """With one input and with two; nor are such words in the meanings of columns."""
    analysis = analysis_of(name)
    meaning_by_column = {}
    for table in analysis.tables:
        for column in table.of(load(mechanism)).columns:
            meaning_by_column[column.name] = column.meaning
    parameters = set(analysis.__dataclass_fields__)
    assert not KEYS & (set(meaning_by_column) | parameters)
    assert not [text for text in meaning_by_column.values() if retired(text)]


def test_the_change_log_of_the_first_version_has_no_history():
    """It is one page by topic, and says what the version can do.

    Nothing was released before, so nothing has changed for a reader. New abilities go into
    the section of their topic.
    """
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    history = re.compile(
        r"\bno longer\b|\b(?:is|are) gone\b|^- Fixed|\bended in a trace", re.M
    )
    assert "## 0.1.0" in text
    assert not history.findall(text)
    assert len(text.splitlines()) <= 120
