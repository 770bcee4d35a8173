"""What differs from kind to kind of pair is asked of the joint, but in few listed files."""

import ast
import re
from pathlib import Path

import pytest

from spherekit.model.joints import KINDS

ROOT = Path(__file__).parent.parent
FILES = sorted([*(ROOT / "spherekit").rglob("*.py"), *(ROOT / "analyses").rglob("*.py")])
MOST = 8
TYPES = {*KINDS, "P"}
"""The types of pairs that files know; P is an R pair by its arc."""
PROFILES = {"circle", "great_circle", "points", "fourier"}
PAGE = ROOT / "docs" / "architecture.md"


def joint_classes(trees):
    """Return the names of all classes that derive, over any steps, from a joint."""
    bases = {
        node.name: {ast.unparse(base).split(".")[-1] for base in node.bases}
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }
    found = {kind.__name__ for kind in KINDS.values()}
    while more := {name for name, own in bases.items() if own & found} - found:
        found |= more
    assert found <= set(bases)
    return found


def asks(tree, classes):
    """Return the lines of a module that depend on the kind of a pair or of a profile."""
    constants = {
        target.id
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Name) and names_kind(node.value, classes, set())
    }
    lines = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func).split(".")[-1]
            if called in ("isinstance", "issubclass", "register"):
                asked = any(names_kind(arg, classes, constants) for arg in node.args)
                lines |= {node.lineno} if asked else set()
        elif isinstance(node, ast.Compare):
            parts = [node.left, *node.comparators]
            kinds = [kind for kind in parts if names_kind(kind, classes, constants)]
            lines |= {node.lineno} if kinds else set()
        elif isinstance(node, ast.Dict):
            keys = [key for key in node.keys if key is not None]
            if any(names_kind(key, classes, constants) for key in keys):
                lines.add(node.lineno)
        elif isinstance(node, ast.match_case):
            for part in ast.walk(node.pattern):
                if isinstance(part, ast.MatchClass | ast.MatchValue):
                    own = part.cls if isinstance(part, ast.MatchClass) else part.value
                    if names_kind(own, classes, constants):
                        lines.add(part.lineno)
        elif isinstance(node, ast.FunctionDef):
            if any("register" in ast.unparse(each) for each in node.decorator_list):
                notes = [arg.annotation for arg in node.args.args if arg.annotation]
                if any(names_kind(each, classes, constants) for each in notes):
                    lines.add(node.lineno)
        elif isinstance(node, ast.Attribute) and node.attr == "rolling":
            lines.add(node.lineno)
    return lines


def names_kind(node, classes, constants):
    """Return whether an expression is a kind, or a collection or union that holds one."""
    if isinstance(node, ast.Constant):
        return node.value in TYPES | PROFILES
    if isinstance(node, ast.Name):
        return node.id in classes | constants
    if isinstance(node, ast.Attribute):
        return node.attr in classes
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        return any(names_kind(each, classes, constants) for each in node.elts)
    if isinstance(node, ast.BinOp):
        sides = node.left, node.right
        return any(names_kind(side, classes, constants) for side in sides)
    return False


@pytest.mark.slow
def test_files_that_branch_on_the_kind_of_a_pair_are_few_and_listed():
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in FILES}
    classes = joint_classes(trees.values())
    asking = {
        path.relative_to(ROOT).as_posix(): sorted(lines)
        for path, tree in trees.items()
        if (lines := asks(tree, classes))
    }
    assert len(asking) <= MOST, asking
    text = PAGE.read_text(encoding="utf-8")
    section = re.search(r"\n## Where a kind of pair matters\n(.*?)\n## ", text, re.S)
    assert section is not None
    listed = re.findall(r"^\| `([\w/]+\.py)` \|", section[1], re.M)
    assert sorted(f"spherekit/{name}" for name in listed) == sorted(asking)
