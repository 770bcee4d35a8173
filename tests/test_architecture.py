"""The house rules that a machine can check: layers, heavy imports, public names."""

import ast
import functools
import importlib
import inspect
import subprocess
import sys
import tomllib
from dataclasses import fields

import pytest
from public_packages import PUBLIC
from sources import ANALYSES, FILES, PACKAGE, ROOT, nodes_of, tree_of

import spherekit
from spherekit.analysis.execution import Execution
from spherekit.model.study import Study

LAYERS = """
arrays errors conventions escaping guarantee version progress library_warnings >
api_validation
argument_validation budget lazy_imports markup processor resources > numeric > sphere >
model region > files planning > motion > rates > engine > singular output guidance proof >
dynamics workspace > analysis > tradeoff design > figures view > exchange > pages >
front > conformance > plugin > cli
"""
"""Each layer may import only layers named before it, and itself."""

SIBLINGS = {
    "model": {"region"},
    "region": {"model"},
    "files": {"planning"},
    "planning": {"files"},
    "proof": {"singular", "output", "guidance", "engine"},
    "singular": {"proof"},
    "output": {"proof"},
    "guidance": {"proof"},
    "engine": {"singular", "proof"},
    "dynamics": {"singular", "workspace"},
    "figures": {"view", "tradeoff"},
    "view": {"figures"},
    "tradeoff": {"design"},
    "design": {"tradeoff"},
    "workspace": {"dynamics", "engine", "singular"},
}
HOME_OF = {
    "rerun": {"view"},
    "pandas": {"analysis/frames.py"},
    "pyarrow": {"analysis/frames.py", "view"},
    "networkx": {"model/graph.py"},
    "jsonschema": {"files/schema.py"},
    "filelock": {"files/plain.py"},
    "heyoka": {"engine/compiler.py"},
    "distributed": {"design/cluster.py"},
    "dask": {"design/cluster.py"},
    "flint": {"proof/balls.py"},
    "numpy_quaddtype": {"numeric/quad.py"},
    "matplotlib": {"figures/sdk.py"},
    "mujoco": {"exchange/mujoco_file.py"},
}


@functools.cache
def imports(path):
    """Return the modules a file imports, and whether at run time (not type checking).

    The analyses import their helpers relatively: their package has its name when it is
    installed, and type checkers see the folder.
    """
    deepest = 1 if path.parent.name == "analyses" else 0
    found = set()

    def visit(node, typing_only):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            for child in node.body:
                visit(child, True)
            for child in node.orelse:
                visit(child, typing_only)
            return
        if isinstance(node, ast.Import):
            found.update((alias.name, typing_only) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level <= deepest, f"{path}: relative import"
            found.add((node.module, typing_only))
        for child in ast.iter_child_nodes(node):
            visit(child, typing_only)

    visit(tree_of(path), False)
    return found


PROOF_MAY_IMPORT = {
    "motion": {"Motion"},
    "rates": {"PoleField", "Request"},
    "sphere": {"Floats", "SplinePath", "spline_through"},
}
"""Data that proofs and reference values share with the solvers that they check."""


def test_dependencies_point_one_way():
    level = {name: k for k, part in enumerate(LAYERS.split(">")) for name in part.split()}
    wrong = []
    for path in FILES:
        inside = path.relative_to(PACKAGE).parts
        own = inside[0].removesuffix(".py")
        if own in ("__init__", "__main__"):
            continue
        assert own in level, f"{own} has no layer"
        for module, _ in imports(path):
            package, other, *_ = f"{module}.top".split(".")
            beyond = level.get(other, 99) > level[own] or other in SIBLINGS.get(own, ())
            if package == "spherekit" and beyond:
                wrong.append(f"{path.relative_to(ROOT)} imports {module}")
    assert not wrong, "\n".join(wrong)


def test_reference_values_share_data_only_with_what_they_check():
    for path in sorted((PACKAGE / "proof").glob("*.py")):
        for node in nodes_of(path):
            if isinstance(node, ast.ImportFrom) and node.module.startswith("spherekit."):
                allowed = PROOF_MAY_IMPORT.get(node.module.split(".")[1])
                names = {alias.name for alias in node.names}
                assert allowed is None or names <= allowed, f"{path.name}: {names}"


def test_plugins_use_the_public_contract_only():
    for path in ANALYSES:
        for module, _ in imports(path):
            if module.split(".")[0] == "spherekit":
                inside = module in PUBLIC and f"{module}.".startswith("spherekit.plugin.")
                assert inside, f"{path.name}: {module}"
            assert module.split(".")[0] not in HOME_OF, f"{path.name}: {module}"


def test_the_kit_of_plugins_is_small():
    assert len(importlib.import_module("spherekit.plugin").__all__) <= 52


@pytest.mark.parametrize("library", HOME_OF)
def test_each_heavy_library_has_one_home(library):
    for path in FILES:
        where = path.relative_to(PACKAGE).as_posix()
        if any(where == home or where.startswith(home + "/") for home in HOME_OF[library]):
            continue
        used = {m.split(".")[0] for m, typing_only in imports(path) if not typing_only}
        assert library not in used, f"{where} imports {library}"


def test_importing_spherekit_loads_the_standard_library_and_numpy_only():
    code = (
        "import sys; before = set(sys.modules); import spherekit; "
        "print(' '.join({m.split('.')[0] for m in set(sys.modules) - before}))"
    )
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    loaded = {name for name in out.stdout.split() if name not in sys.stdlib_module_names}
    assert loaded <= {"spherekit", "numpy"}


@pytest.mark.parametrize("package", PUBLIC)
def test_public_names_resolve(package):
    module = importlib.import_module(package)
    assert module.__doc__ and dir(module) == module.__all__
    for name in module.__all__:
        assert getattr(module, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'no_such_name'"):
        module.no_such_name


def test_public_functions_have_no_catch_all_keywords_and_are_described():
    for path in FILES:
        assert ast.get_docstring(tree_of(path)) or path.name == "__init__.py", path
        for node in nodes_of(path):
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                named = any("takes(" in ast.unparse(each) for each in node.decorator_list)
                assert node.args.kwarg is None or named, f"{path.name}: {node.name}(**...)"


MOST_PARAMETERS = 6


def test_no_public_name_is_that_of_a_module():
    """The module would take its place once anything in it is imported."""
    for package in PUBLIC:
        offered = set(importlib.import_module(package).__all__)
        folder = PACKAGE.joinpath(*package.split(".")[1:])
        if folder.is_dir():
            assert offered.isdisjoint(path.stem for path in folder.iterdir()), package


def test_what_carries_a_run_takes_few_parameters():
    """What a run goes through is one object, and how it is done another."""
    too_many = []
    for part in ("analysis", "tradeoff", "cli"):
        for path in sorted((PACKAGE / part).rglob("*.py")):
            for node in nodes_of(path):
                if isinstance(node, ast.FunctionDef):
                    named = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                    count = sum(each.arg not in ("self", "cls") for each in named)
                    if count > MOST_PARAMETERS:
                        too_many.append(f"{path.name}: {node.name} takes {count}")
    assert not too_many, "\n".join(too_many)


def test_options_of_a_run_are_shown_and_are_fields():
    shown = inspect.signature(spherekit.run).parameters
    assert all(each.kind is not each.VAR_KEYWORD for each in shown.values())
    options = {name for name in shown if name not in ("subject", "analyses", "input_pair")}
    kept = {item.name for kind in (Study, Execution) for item in fields(kind)}
    assert options == kept - {"name", "mechanism", "analyses", "recording", "locate"}
    assert shown["samples"].default == Study("x", spherekit.load("four_bar")).samples


def test_every_package_is_in_the_distribution():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    listed = set(project["tool"]["setuptools"]["packages"])
    made = (path.parent.relative_to(ROOT) for path in PACKAGE.rglob("__init__.py"))
    assert {".".join(path.parts) for path in made} <= listed


INHERITED = """
AbstractAnalysis AnalysisError ArrayRows BearingFriction Chords
ClosedKinematics CurvePoints Curves InputMotion Joint JointReactions Load
OutputKinematics Parser PlanError Problem Sampler SpherekitError
VelocityEquations Way Zone
"""


def test_only_these_classes_are_inherited_from():
    """Each is abstract, or bears rows or errors of several kinds; all others are final."""
    classes = {
        node.name: [ast.unparse(base).split("[")[0].split(".")[-1] for base in node.bases]
        for path in (*FILES, *ANALYSES)
        for node in nodes_of(path)
        if isinstance(node, ast.ClassDef)
    }
    inherited = {base for bases in classes.values() for base in bases if base in classes}
    assert inherited == set(INHERITED.split())
