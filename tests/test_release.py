"""What a release needs says the same as pyproject.toml and the pages, and is well made."""

import importlib
import re
import tomllib
from pathlib import Path

import pytest

import spherekit
from spherekit.cli.main import main

yaml = pytest.importorskip("yaml", reason="it comes with the packages of the site")
ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PIXI = PROJECT["tool"]["pixi"]
META = PROJECT["project"]
PAPER = (ROOT / "docs" / "paper" / "paper.md").read_text("utf-8")
BIBLIOGRAPHY = (ROOT / "docs" / "paper" / "paper.bib").read_text("utf-8")


def requirement(text):
    """Return name and set of bounds of a requirement such as "numpy >=2,<3; ..."."""
    name, bounds = re.fullmatch(r"([\w.-]+)\s*(.*)", text.split(";")[0].strip()).groups()
    return name, frozenset(bounds.replace(" ", "").split(","))


@pytest.fixture(scope="module")
def recipe():
    return yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text("utf-8"))


@pytest.fixture(scope="module")
def workflow():
    path = ROOT / ".github" / "workflows" / "tests.yml"
    return yaml.safe_load(path.read_text("utf-8"))


@pytest.fixture(scope="module")
def citation():
    return yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))


def test_the_recipe_has_the_dependencies_of_the_project(recipe):
    """To run, to build, and the bounds of heyoka, which is optional."""
    requirements = recipe["requirements"]
    python = ("python", frozenset([META["requires-python"]]))
    to_run = {requirement(text) for text in META["dependencies"]}
    in_recipe = {requirement(text) for text in requirements["run"]}
    assert in_recipe == to_run | {python}
    to_build = {requirement(text) for text in PROJECT["build-system"]["requires"]}
    in_recipe = {requirement(text) for text in requirements["host"]}
    assert to_build | {python} <= in_recipe
    (compiled,) = META["optional-dependencies"]["compiled"]
    (constraint,) = requirements["run_constraints"]
    assert requirement(compiled)[1] == requirement(constraint)[1]


def test_the_recipe_states_name_version_and_commands_of_the_project(recipe):
    about = recipe["about"]
    assert recipe["context"]["version"] == spherekit.__version__
    assert recipe["package"]["name"] == META["name"]
    assert about["license"] == META["license"]
    assert about["summary"] == META["description"]
    assert (ROOT / about["license_file"]).is_file()
    lines = recipe["build"]["python"]["entry_points"]
    entry_points = dict(text.split(" = ") for text in lines)
    assert entry_points == META["scripts"]


def test_tests_of_the_recipe_pass_in_an_empty_folder(recipe, tmp_path, monkeypatch, capsys):
    """Its modules are imported and its commands run, but for the first, `--version`."""
    modules, commands = recipe["tests"]
    for name in modules["python"]["imports"]:
        importlib.import_module(name)
    monkeypatch.chdir(tmp_path)
    for command in commands["script"][1:]:
        arguments = command.split()[1:]
        assert main(arguments) == 0
    assert (tmp_path / "out" / "poles.csv").is_file()


def test_the_workflow_runs_the_commands_that_the_readme_has_for_developers(workflow):
    """The workflow of GitHub runs the commands that the README states for developers.

    They are in the second block of the README; its first line creates the environment. The
    workflow names programs without their folder, and may leave out `pip`, `python` and the
    option `--quiet`. It also runs the command that builds the site, and states when it runs
    (`on`).
    """
    readme = (ROOT / "README.md").read_text("utf-8")
    developers_block = re.findall(r"^```sh\n(.*?)^```$", readme, re.M | re.S)[1]
    steps = [step for job in workflow["jobs"].values() for step in job["steps"]]
    commands_of_workflow = "\n".join(step.get("run", "") for step in steps)
    for line in developers_block.splitlines()[1:]:
        command = line.replace(".venv/bin/", "").replace("--quiet ", "")
        command = command.removeprefix("pip ").removeprefix("python ")
        assert command in commands_of_workflow, line
    assert PIXI["tasks"]["site"] in commands_of_workflow
    key_on = True  # YAML 1.1 reads the key `on` as the truth value true
    assert key_on in workflow


def test_the_workflow_tests_the_oldest_python_with_the_oldest_packages(workflow):
    matrix = workflow["jobs"]["tests"]["strategy"]["matrix"]
    oldest = META["requires-python"].removeprefix(">=")
    assert matrix["python"][0] == oldest
    assert PIXI["dependencies"]["python"].removeprefix(">=") == oldest
    rows = {(row["python"], row["versions"]) for row in matrix["include"]}
    assert (oldest, "oldest") in rows
    assert (ROOT / "tests" / "oldest.py").is_file()


def test_pixi_installs_the_project_and_runs_the_commands_of_the_pages():
    """The README has the command that tests, CONTRIBUTING those of style and types."""
    readme = (ROOT / "README.md").read_text("utf-8")
    contributing = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    ((name, how),) = PIXI["pypi-dependencies"].items()
    assert name == META["name"]
    assert set(how["extras"]) <= set(META["optional-dependencies"])
    assert f".venv/bin/{PIXI['tasks']['test']}\n" in readme
    for task in ("lint", "types"):
        assert f"`.venv/bin/{PIXI['tasks'][task]}`" in contributing
    assert PIXI["tasks"]["site"] in contributing


def test_the_citation_file_has_version_and_license_and_complete_references(citation):
    assert citation["version"] == spherekit.__version__
    assert citation["license"] == META["license"]
    for reference in citation["references"]:
        assert reference["title"] and reference["authors"] and reference["year"]


def test_the_paper_cites_exactly_its_bibliography():
    """Keys such as `@Chiang1988` in the text after the head of the paper."""
    entries = re.findall(r"^@\w+\{(\w+),$", BIBLIOGRAPHY, re.M)
    assert len(set(entries)) == len(entries)
    text = PAPER.split("---\n", 2)[2]
    cited = set(re.findall(r"@([A-Z]\w+)", text))
    assert cited == set(entries)


def test_entries_of_the_bibliography_have_author_title_and_year():
    for entry in re.split(r"^(?=@)", BIBLIOGRAPHY, flags=re.M)[1:]:
        assert entry.count("{") == entry.count("}")
        for key in ("author", "title", "year"):
            assert re.search(rf"^  {key}\s+= \{{.+\}},?$", entry, re.M), (key, entry)


def test_claims_of_the_paper_are_measured_in_the_pages():
    """Each line of the section names a page and words of it, in a comment."""
    measured = PAPER.partition("# What was measured")[2].partition("\n# ")[0]
    claims = re.findall(r"<!-- ([\w/]+\.md): (.+?) -->", measured)
    assert len(claims) == len(measured.strip().splitlines())
    for page, words in claims:
        assert words in (ROOT / "docs" / page).read_text("utf-8"), (page, words)
