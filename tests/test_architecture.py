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
from helpers.public_packages import PUBLIC
from helpers.source_files import ANALYSES, FILES, PACKAGE, ROOT, nodes_of, tree_of

import spherekit
from spherekit.files.study import Study
from spherekit.runs.execution import Execution

LAYERS = """ library_warnings arrays errors status tolerances wording conventions
escaping number_text quantity completeness version progress time_limit > type_descriptions
type_checks argument_validation markup processor resources > numerics > geometry >
mechanism > symbolic storage > files planning > tables positions > velocities >
singularities proof > outputs > dynamics > scenes > runs > designs > exchange
display.rerun display.figures > display.pages > display > api > plugin > cli
"""
"""Each package may import only packages named before it, and itself."""

FORBIDDEN = {
    "dynamics": ("singularities",),
    "outputs": ("proof", "symbolic"),
    "proof": ("symbolic",),
    "designs": ("runs.trade",),
}
"""What a package may not import although it is named before it, as beginnings of names."""
HOME_OF = {
    "rerun": {"display/rerun"},
    "pandas": {"tables/table_files.py"},
    "pyarrow": {"tables/table_files.py", "display/rerun"},
    "networkx": {"mechanism/graph.py"},
    "jsonschema": {"files/schema.py"},
    "filelock": {"storage/file_lock.py"},
    "heyoka": {"symbolic/compiler.py"},
    "distributed": {"designs/dask_cluster.py"},
    "dask": {"designs/dask_cluster.py"},
    "flint": {"proof/balls.py"},
    "numpy_quaddtype": {"numerics/quad_precision.py"},
    "matplotlib": {"display/figures/matplotlib_sdk.py"},
    "mujoco": {"exchange/mujoco_file.py"},
    "rich": {"cli/screen_report.py", "cli/progress_bar.py"},
}


@functools.cache
def imports(path):
    """Return the modules that a Python file imports, and whether for type checking only.

    Relative imports are allowed in analyses only, because their package has another name
    when it is installed.

    Returns
    -------
    set of (module, is_for_types)
    """
    # The most dots of a relative import that stays in the repository. 0 forbids all.
    most_dots = len(path.relative_to(ROOT).parts) - 1 if path in ANALYSES else 0
    imported = set()

    def visit(node, is_for_types):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            for child in node.body:
                visit(child, True)
            for child in node.orelse:
                visit(child, is_for_types)
            return
        if isinstance(node, ast.Import):
            imported.update((alias.name, is_for_types) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level <= most_dots, f"{path}: relative import"
            imported.add((node.module, is_for_types))
        for child in ast.iter_child_nodes(node):
            visit(child, is_for_types)

    visit(tree_of(path), False)
    return imported


PROOF_MAY_IMPORT = {
    "positions": {"Motion"},
    "velocities": {"PoleField", "Request"},
    "geometry": {"Floats", "SplinePath", "spline_through"},
}
"""Data that proofs and reference values share with the solvers that they check."""


def package_of(module):
    """Return the package of `LAYERS` that a module, named without `spherekit.`, belongs
    to."""
    first, second, *_ = f"{module}..".split(".")
    return f"{first}.{second}" if f"{first}.{second}" in LAYERS.split() else first


def module_name(path):
    """Return the dotted name of a file of the package, without `spherekit.`."""
    return ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix(
        ".__init__"
    )


def test_packages_import_only_packages_of_lower_layers():
    """Modules of spherekit import only packages of lower layers.

    `LAYERS` lists the packages, lowest layer first. Packages of one layer may not import
    each other, but single-file modules of one layer may. `FORBIDDEN` lists imports that are
    not allowed although their layer is lower.
    """
    layers = [part.split() for part in LAYERS.split(">")]
    level = {name: k for k, names in enumerate(layers) for name in names}
    single_files = {name for name in level if (PACKAGE / f"{name}.py").exists()}
    wrong = []
    for path in FILES:
        package = package_of(module_name(path))
        if package in ("__init__", "__main__"):
            continue
        assert package in level, f"{package} has no layer"
        for module, _ in imports(path):
            top, _, inside = module.partition(".")
            imported_package = package_of(inside)
            if top != "spherekit" or imported_package == package:
                continue
            # A package without a layer counts as above all others.
            imported_level = level.get(imported_package, len(layers))
            is_above = imported_level > level[package]
            are_single_files = {package, imported_package} <= single_files
            is_beside = imported_level == level[package] and not are_single_files
            is_forbidden = inside.startswith(FORBIDDEN.get(package, ()))
            if is_above or is_beside or is_forbidden:
                wrong.append(f"{path.relative_to(ROOT)} imports {module}")
    assert not wrong, "\n".join(wrong)


def test_no_modules_import_each_other():
    """No cycle leads through any modules, imports inside functions counted."""
    names = {f"spherekit.{module_name(path)}" for path in FILES}
    graph = {}
    for path in FILES:
        if path.parent != PACKAGE or path.stem not in ("__init__", "__main__"):
            own = f"spherekit.{module_name(path)}"
            graph[own] = {module for module, _ in imports(path) if module in names} - {own}
    while free := [name for name, used in graph.items() if not used & set(graph)]:
        for name in free:
            del graph[name]
    assert not graph, sorted(graph)


def run_python(code):
    """Return what a new Python process prints for a piece of code."""
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    return process.stdout.strip()


def test_the_page_draws_these_packages():
    """The drawing names the packages floor by floor, the lowest first."""
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    drawing = page.partition("```text\n")[2].partition("```")[0]
    drawn = [line.split("  ")[0].split() for line in drawing.splitlines()]
    drawn = [
        [name.strip(",") for name in names] for names in drawn if names not in ([], ["|"])
    ]
    floors = [part.split() for part in LAYERS.split(">")]
    packages = [
        [n for n in names if not (PACKAGE / f"{n}.py").exists()] for names in floors
    ]
    assert [*filter(None, packages)] == drawn


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


def test_the_default_analysis_loads_no_code_for_outputs_or_designs():
    """Each start of a run would load this code for nothing."""
    code = (
        "import sys, spherekit_analyses.poles\n"
        "parts = ('spherekit.outputs.', 'spherekit.designs.')\n"
        "print([name for name in sys.modules if name.startswith(parts)])"
    )
    assert run_python(code) == "[]"


@pytest.mark.parametrize("library", HOME_OF)
def test_each_heavy_library_has_one_home(library):
    for path in FILES:
        where = path.relative_to(PACKAGE).as_posix()
        if any(where == home or where.startswith(home + "/") for home in HOME_OF[library]):
            continue
        used = {m.split(".")[0] for m, typing_only in imports(path) if not typing_only}
        assert library not in used, f"{where} imports {library}"


def test_importing_spherekit_loads_no_large_library():
    code = (
        "import sys; before = set(sys.modules); import spherekit; "
        "print(' '.join({m.split('.')[0] for m in set(sys.modules) - before}))"
    )
    loaded = set(run_python(code).split()) - sys.stdlib_module_names
    assert loaded <= {"spherekit", "lazy_loader"}


@pytest.mark.parametrize("package", PUBLIC)
def test_public_names_resolve(package):
    module = importlib.import_module(package)
    assert module.__doc__ and set(module.__all__) <= set(dir(module))
    for name in module.__all__:
        assert getattr(module, name) is not None
    with pytest.raises(AttributeError, match="attribute .?no_such_name"):
        module.no_such_name


def test_public_functions_have_no_catch_all_keywords_and_are_described():
    for path in FILES:
        assert ast.get_docstring(tree_of(path)) or path.name == "__init__.py", path
        for node in nodes_of(path):
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                named = any(
                    "takes_study_options(" in ast.unparse(each)
                    for each in node.decorator_list
                )
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
    for part in ("runs", "cli"):
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
    others = ("subject", "analyses", "input_pair", "angle_unit")
    options = {name for name in shown if name not in others}
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
ClosedKinematics CurvePoints CurveContinuation InputMotion Joint JointReactions Load
OutputKinematics CommandLineParser PlanError Problem RotationPath Sampler SpherekitError
VelocityEquations OrientedBox DecimalGeometry
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


MODULE_ATTRIBUTES = {"EXAMPLES"}
"""Constants that each of several modules has with a value of its own, because other code
reads them from a module by this name. `EXAMPLES` are the examples of a subcommand."""


def test_class_names_are_unique():
    """A class name stands for one class, so that a reader may search for it."""
    paths: dict[str, list[str]] = {}
    for path in (*FILES, *ANALYSES):
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.ClassDef):
                paths.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    assert not {name: found for name, found in paths.items() if len(found) > 1}


def test_no_constant_name_has_two_values():
    """A name in capitals has one value in all modules, so that a reader may search for it.

    Only the names in `MODULE_ATTRIBUTES`, which other code reads from each of several
    modules, may have several values.
    """
    values: dict[str, dict[str, str]] = {}
    for path in FILES:
        for node in tree_of(path).body:
            if isinstance(node, ast.Assign):
                targets = node.targets
            elif isinstance(node, ast.AnnAssign) and node.value is not None:
                targets = [node.target]
            else:
                continue
            value = ast.unparse(node.value)
            for name in (x for target in targets for x in ast.walk(target)):
                if isinstance(name, ast.Name) and name.id.strip("_").isupper():
                    values.setdefault(name.id, {})[value] = str(path.relative_to(ROOT))
    ambiguous = {name: list(x.values()) for name, x in values.items() if len(x) > 1}
    assert set(ambiguous) == MODULE_ATTRIBUTES, ambiguous
