"""Files that `spherekit new` and `spherekit import` write, and suggested commands."""

import shlex

import pytest
from helpers.source_files import ROOT

import spherekit as sk
from spherekit.cli.main import main

FOUR_BAR = (ROOT / "mechanisms" / "four_bar.toml").read_text("utf-8")
HEAD = FOUR_BAR[: FOUR_BAR.index("description = ")]
LINKS = FOUR_BAR[FOUR_BAR.index("[source]") :]
TEXT = 'description = """\nname = x\n"""\n'


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """Return the path of a MuJoCo model of a four-bar."""
    pytest.importorskip("mujoco")
    path = tmp_path_factory.mktemp("model") / "bar.xml"
    sk.export("four_bar", path)
    return path


def suggested_files(out):
    """Return the last word of each command that a report suggests."""
    commands = out.partition("Next:\n")[2].splitlines()
    return [shlex.split(line.strip().partition("  ")[0])[-1] for line in commands]


@pytest.mark.parametrize(
    "head",
    [
        HEAD.replace("name", '"name"'),
        HEAD.replace("name", f"{TEXT}name"),
        f"\ufeff{HEAD}",
    ],
    ids=["quoted key", "a text before it", "byte-order mark"],
)
def test_a_copy_has_the_new_name_and_the_old_description(head, tmp_path):
    original = tmp_path / "original.toml"
    original.write_text(f"{head}\n{LINKS}", "utf-8")
    copy = tmp_path / "copy.toml"
    assert main(["new", "mechanism", str(copy), "--like", str(original), "-q"]) == 0
    assert sk.load(copy).name == "copy"
    assert sk.load(copy).description == sk.load(original).description


@pytest.mark.parametrize("what", ["mechanism", "analysis"])
def test_suggested_commands_quote_the_path_of_a_new_file(what, tmp_path, capsys):
    path = tmp_path / "my designs" / "some_bar"
    path.parent.mkdir()
    assert main(["new", what, str(path)]) == 0
    first_file, *_, last_file = suggested_files(capsys.readouterr().out)
    suffix = ".toml" if what == "mechanism" else ""
    assert {first_file, last_file} == {f"{path}{suffix}"}


def test_suggested_commands_quote_the_path_of_an_imported_file(model, tmp_path, capsys):
    path = tmp_path / "my bar.toml"
    assert main(["import", str(model), "-o", str(path)]) == 0
    assert suggested_files(capsys.readouterr().out) == [str(path)] * 2


def test_a_model_is_not_imported_under_the_name_of_a_study(model, tmp_path, capsys):
    path = tmp_path / "bar.study.toml"
    assert main(["import", str(model), "-o", str(path)]) == 1
    assert "only study files are named *.study.toml" in capsys.readouterr().err
    assert not path.exists()


@pytest.mark.parametrize("folder", [".", "/"])
def test_a_folder_is_refused_as_a_model_in_one_sentence(folder, capsys):
    assert main(["import", folder]) == 1
    assert capsys.readouterr().err.startswith(f"spherekit: {folder}: ")


@pytest.mark.parametrize("name", ["none", "series", "table_data", "ratio_"])
def test_names_with_which_a_new_analysis_would_not_work_are_refused(name, tmp_path, capsys):
    """The class would be None or Series, or the package would be spherekit-ratio-."""
    assert main(["new", "analysis", str(tmp_path / name)]) == 1
    assert f'"{name}" cannot be the name of a new analysis' in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
