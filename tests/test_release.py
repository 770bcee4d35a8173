"""What a release needs says the same as pyproject.toml and the pages, and is well made."""

import importlib
import re
import tomllib
from pathlib import Path

import pytest

import spherekit

yaml = pytest.importorskip("yaml", reason="it comes with the packages of the site")
ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
PIXI = PROJECT["tool"]["pixi"]
META = PROJECT["project"]
PAPER = (ROOT / "docs" / "paper" / "paper.md").read_text("utf-8")
BIBLIOGRAPHY = (ROOT / "docs" / "paper" / "paper.bib").read_text("utf-8")


def requirement(text):
    """A requirement as its name and its bounds, in any order and spelling."""
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
    python = ("python", frozenset([META["requires-python"]]))
    wanted = {requirement(text) for text in META["dependencies"]}
    assert {requirement(text) for text in recipe["requirements"]["run"]} == wanted | {
        python
    }
    build = {requirement(text) for text in PROJECT["build-system"]["requires"]}
    assert build | {python} <= {
        requirement(text) for text in recipe["requirements"]["host"]
    }
    (compiled,) = META["optional-dependencies"]["compiled"]
    (constraint,) = recipe["requirements"]["run_constraints"]
    assert requirement(compiled)[1] == requirement(constraint)[1]


def test_the_recipe_is_of_this_project(recipe, tmp_path, monkeypatch, capsys):
    assert recipe["context"]["version"] == spherekit.__version__
    assert recipe["package"]["name"] == META["name"]
    assert recipe["about"]["license"] == META["license"]
    assert recipe["about"]["summary"] == META["description"]
    assert (ROOT / recipe["about"]["license_file"]).is_file()
    points = dict(text.split(" = ") for text in recipe["build"]["python"]["entry_points"])
    assert points == META["scripts"]
    modules, commands = recipe["tests"]
    for name in modules["python"]["imports"]:
        importlib.import_module(name)
    from spherekit.cli.main import main

    monkeypatch.chdir(tmp_path)
    for command in commands["script"][1:]:
        assert main(command.split()[1:]) == 0
    assert (tmp_path / "out" / "poles.csv").is_file()


def test_the_workflow_runs_what_the_readme_says(workflow):
    readme = (ROOT / "README.md").read_text("utf-8")
    second = re.findall(r"^```sh\n(.*?)^```$", readme, re.M | re.S)[1]
    run = "\n".join(
        step.get("run", "") for job in workflow["jobs"].values() for step in job["steps"]
    )
    for line in second.splitlines()[1:]:
        said = line.replace(".venv/bin/", "").replace("--quiet ", "")
        assert said.removeprefix("pip ").removeprefix("python ") in run, line
    assert PIXI["tasks"]["site"] in run
    assert True in workflow  # the key `on`, which YAML 1.1 reads as a truth


def test_the_matrix_begins_at_the_oldest_python(workflow):
    matrix = workflow["jobs"]["tests"]["strategy"]["matrix"]
    oldest = META["requires-python"].removeprefix(">=")
    assert (
        matrix["python"][0] == oldest == PIXI["dependencies"]["python"].removeprefix(">=")
    )
    rows = {(row["python"], row["versions"]) for row in matrix["include"]}
    assert (oldest, "oldest") in rows
    assert (ROOT / "tests" / "oldest.py").is_file()


def test_pixi_installs_the_project_and_runs_the_readmes_commands():
    readme = (ROOT / "README.md").read_text("utf-8")
    (own,) = PIXI["pypi-dependencies"].items()
    assert own[0] == META["name"]
    assert set(own[1]["extras"]) <= set(META["optional-dependencies"])
    for task in ("lint", "types", "test"):
        assert f".venv/bin/{PIXI['tasks'][task]}\n" in readme
    assert PIXI["tasks"]["site"] in (ROOT / "CONTRIBUTING.md").read_text("utf-8")


def test_the_citation_is_of_this_version(citation):
    assert citation["version"] == spherekit.__version__
    assert citation["license"] == META["license"]
    for reference in citation["references"]:
        assert reference["title"] and reference["authors"] and reference["year"]


def test_citations_of_the_paper_are_its_bibliography():
    entries = re.findall(r"^@\w+\{(\w+),$", BIBLIOGRAPHY, re.M)
    assert len(set(entries)) == len(entries)
    assert set(re.findall(r"@([A-Z]\w+)", PAPER.split("---\n", 2)[2])) == set(entries)
    for entry in re.split(r"^(?=@)", BIBLIOGRAPHY, flags=re.M)[1:]:
        assert entry.count("{") == entry.count("}")
        for key in ("author", "title", "year"):
            assert re.search(rf"^  {key}\s+= \{{.+\}},?$", entry, re.M), (key, entry)


def test_claims_of_the_paper_are_measured_in_the_pages():
    measured = PAPER.partition("# What was measured")[2].partition("\n# ")[0]
    claims = re.findall(r"<!-- ([\w/]+\.md): (.+?) -->", measured)
    assert len(claims) == len(measured.strip().splitlines())
    for page, words in claims:
        assert words in (ROOT / "docs" / page).read_text("utf-8"), (page, words)
