"""What differs from kind to kind of pair is asked of the joint, but in few listed files."""

import ast
import re

import pytest
from helpers.source_files import ANALYSES, FILES, ROOT, nodes_of, tree_of

from spherekit.mechanism.joint import JOINT_KINDS

MOST = 8
TYPES = {*JOINT_KINDS, "P"}
"""The types of pairs that files know; P is an R pair by its arc."""
PROFILES = {"circle", "great_circle", "points", "fourier"}
PAGE = ROOT / "docs" / "architecture.md"


def joint_classes():
    """Return the names of all classes that derive, over any steps, from a joint."""
    bases = {
        node.name: {ast.unparse(base).split(".")[-1] for base in node.bases}
        for path in (*FILES, *ANALYSES)
        for node in nodes_of(path)
        if isinstance(node, ast.ClassDef)
    }
    found = {kind.__name__ for kind in JOINT_KINDS.values()}
    while more := {name for name, own in bases.items() if own & found} - found:
        found |= more
    assert found <= set(bases)
    return found


def is_dispatch_on_kinds(table, classes):
    """Return whether all keys of a dict display are kinds of pairs or of profiles.

    A table whose values are tuples of sizes, or a table with other keys beside a kind, maps
    names of fields, which are chosen freely.
    """
    if not table.keys or any(isinstance(value, ast.Tuple) for value in table.values):
        return False
    return all(
        (isinstance(key, ast.Constant) and key.value in TYPES | PROFILES)
        or getattr(key, "id", getattr(key, "attr", "")) in classes
        for key in table.keys
    )


def lines_that_depend_on_kinds(path, classes):
    """Return the numbers of lines of a module that branch on the kind of a pair or profile.

    A line counts if it checks a type, compares with the name of a kind, matches a kind, or
    begins a dispatch table, a dict from kinds to what is done with them.

    Parameters
    ----------
    path
        Path of the module.
    classes
        Names of all classes of joints, such as "Revolute".
    """

    def names_a_kind(nodes, constants=()):
        """Return whether expressions name a kind, or a constant that holds one."""
        for node in (part for top in nodes for part in ast.walk(top)):
            if isinstance(node, ast.Constant) and node.value in TYPES | PROFILES:
                return True
            if isinstance(node, ast.Name) and node.id in {*classes, *constants}:
                return True
            # A class of a module, such as `joint.Revolute`.
            if isinstance(node, ast.Attribute) and node.attr in {*classes, *constants}:
                return True
        return False

    constants = {
        target.id
        for node in tree_of(path).body
        if isinstance(node, ast.Assign) and names_a_kind([node.value])
        for target in node.targets
        if isinstance(target, ast.Name)
    }
    lines = set()
    for node in nodes_of(path):
        match node:
            # Checks of a type, and functions for a type that `functools.singledispatch`
            # registers.
            case ast.Call(
                ast.Name("isinstance" | "issubclass") | ast.Attribute("register")
            ):
                expressions = node.args
            case ast.Compare():
                # Comparisons with a name, not with the result of a function, whose
                # arguments may happen to be spelled like a kind.
                expressions = [
                    part
                    for part in (node.left, *node.comparators)
                    if not isinstance(part, ast.Call)
                ]
            case ast.Dict():
                # Only a dict whose keys are all kinds is a dispatch table. In others, such
                # as {"points": ..., "x_range": ...}, the keys are names of fields.
                expressions = node.keys if is_dispatch_on_kinds(node, classes) else []
            case ast.match_case():
                expressions = [node.pattern]
            case _:
                continue
        if names_a_kind(expressions, constants):
            lines.add(expressions[0].lineno)
    return lines


@pytest.mark.slow
def test_files_that_branch_on_the_kind_of_a_pair_are_few_and_listed():
    """At most eight files do, and the architecture page's table lists exactly these."""
    classes = joint_classes()
    asking = {
        path.relative_to(ROOT).as_posix(): sorted(lines)
        for path in (*FILES, *ANALYSES)
        if (lines := lines_that_depend_on_kinds(path, classes))
    }
    assert len(asking) <= MOST, asking
    text = PAGE.read_text(encoding="utf-8")
    section = re.search(r"\n## Where a kind of pair matters\n(.*?)(?:\n## |\Z)", text, re.S)
    assert section is not None
    listed = re.findall(r"^\| `([\w/]+\.py)` \|", section[1], re.M)
    assert sorted(f"spherekit/{name}" for name in listed) == sorted(asking)


@pytest.mark.parametrize(
    ("table", "is_dispatch"),
    [
        ("{Revolute: turn, Rolling: roll}", True),
        ("{joints.Revolute: turn}", True),
        ('{"R": turn, "P": slide}', True),
        ('{"circle": circle_of, "fourier": series_of, "points": spline_of}', True),
        ('{"points": spline_of}', True),
        ('{"points": ("k", 2)}', False),
        ('{"points": array, "x_range": limits}', False),
        ('{"circle": radius, "label": text}', False),
        ("{Axis: values, Mark: place}", False),
        ("{}", False),
    ],
)
def test_a_table_of_fields_that_are_spelled_like_kinds_is_no_dispatch(table, is_dispatch):
    """`table` is the source of a dict; it is a dispatch if its keys are all kinds."""
    (statement,) = ast.parse(table).body
    assert is_dispatch_on_kinds(statement.value, {"Revolute", "Rolling"}) == is_dispatch
