"""Packs of mechanism files, found through entry points without importing them."""

import os
import sys

import pytest
from helpers.refusals import mechanism_text

from spherekit.cli.main import main
from spherekit.errors import FileError
from spherekit.files import library
from spherekit.files.library import GROUP, Pack, find, shipped
from spherekit.files.mechanism_reader import load

SOUND_FILE = mechanism_text("library_sound")
"""Text of a correct mechanism file with its name left open."""


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Return a function that installs a pack of mechanism files, as pip would.

    A pack is an installed package with mechanism files. It is found by its entry point,
    without importing it.
    """
    site = tmp_path / "site"
    site.mkdir()
    monkeypatch.syspath_prepend(str(site))

    def add(package, files, module=None, code="raise RuntimeError('imported')"):
        """Write the files of an installed package, a pack of mechanism files.

        Parameters
        ----------
        package
            Name of the package.
        files
            Names of its mechanism files. With None the package has no folder, as if it were
            not installed completely.
        module
            Module to which the entry point refers; by default the package itself.
        code
            Text of `__init__.py`. It fails by default, since packs must not be imported.

        Returns
        -------
        Path of the package's folder.
        """
        # What pip writes: the metadata, and the entry point, which declares that the
        # package is a pack. `GROUP` is the name of the entry points of packs.
        info = site / f"{package}-1.5.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.5\n"
        )
        (info / "entry_points.txt").write_text(
            f"[{GROUP}]\n{package} = {module or package}\n"
        )
        if files is not None:
            folder = site / package
            folder.mkdir()
            (folder / "__init__.py").write_text(code)
            for name in files:
                text = SOUND_FILE.format(name=name.split(".")[0])
                (folder / name).write_text(text)
        return site / package

    return add


def find_pack(name):
    """Return the record of an installed pack."""
    return next(pack for pack in shipped() if pack.name == name)


def test_packs_are_listed_and_found_without_importing(install):
    """A pack lists its mechanism files; studies and other files are left out."""
    folder = install("sk_pack", ["alpha_bar.toml", "beta.toml", "x.study.toml", "a.txt"])
    pack = find_pack("sk_pack")
    assert dict(pack.files) == {
        "alpha_bar": folder / "alpha_bar.toml",
        "beta": folder / "beta.toml",
    }
    assert not pack.fault
    assert find("beta") == folder / "beta.toml"
    assert load("alpha_bar").name == "alpha_bar"
    assert "sk_pack" not in sys.modules


def test_broken_packs_are_listed_with_their_faults_and_leave_others_usable(install):
    install("sk_sound", ["gamma.toml"])
    install("sk_gone", None)
    install("sk_empty", [])
    install("sk_named", ["two words.toml"])
    install("sk_odd", None, module="sk_missing.inner")
    assert "no package is named" in find_pack("sk_gone").fault
    assert "holds no .toml files" in find_pack("sk_empty").fault
    assert "not a name of letters" in find_pack("sk_named").fault
    assert "ModuleNotFoundError" in find_pack("sk_odd").fault
    assert find("gamma").name == "gamma.toml"
    with pytest.raises(FileError, match=r"Broken packs: .*sk_empty \(sk_empty holds no"):
        find("delta")


def test_a_pack_may_have_studies_only(install):
    folder = install("sk_studies", ["beta.study.toml"])
    pack = find_pack("sk_studies")
    assert not pack.fault
    assert dict(pack.studies) == {"beta": folder / "beta.study.toml"}
    assert find("beta") == folder / "beta.study.toml"


def test_broken_packs_are_named_if_there_is_no_mechanism_at_all(monkeypatch, tmp_path):
    """The sentence about the folder ends before the one about the packs."""
    broken = Pack("sk_broken", fault="why")
    monkeypatch.setattr(library, "shipped", lambda: (broken,))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileError) as caught:
        find("delta")
    ending = "no .toml files in the current folder. Broken packs: sk_broken (why)."
    assert str(caught.value).endswith(ending)


def test_a_name_that_several_packs_ship_is_refused(install):
    install("sk_one", ["same.toml"])
    install("sk_two", ["same.toml"])
    with pytest.raises(
        FileError, match=r"is in several packs; give one of their paths: .*sk_one"
    ):
        find("same")


def test_a_folder_of_the_same_name_does_not_hide_a_shipped_mechanism(
    install, tmp_path, monkeypatch
):
    """With a separator the name is a path and means the folder."""
    folder = install("sk_pack", ["alpha_bar.toml"])
    monkeypatch.chdir(tmp_path)
    (tmp_path / "alpha_bar").mkdir()
    assert find("alpha_bar") == folder / "alpha_bar.toml"
    assert find(f".{os.sep}alpha_bar").name == "alpha_bar"


def test_an_unknown_name_is_refused_with_the_nearest_shipped_name(
    install, tmp_path, monkeypatch
):
    install("sk_pack", ["alpha_bar.toml"])
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileError) as caught:
        find("alpa_bar")
    assert 'alpa_bar: not found; did you mean "alpha_bar"?' in str(caught.value)
    assert "Shipped mechanisms: " in str(caught.value)


def test_an_unknown_path_is_refused_with_the_nearest_file_of_its_folder(tmp_path):
    (tmp_path / "my_bar.toml").write_text("")
    with pytest.raises(FileError) as caught:
        find(tmp_path / "mybar.toml")
    assert 'did you mean "my_bar.toml"?' in str(caught.value)
    assert f"Files in {tmp_path}: my_bar.toml" in str(caught.value)


def test_a_path_in_an_unknown_folder_is_refused(tmp_path):
    with pytest.raises(FileError, match="and its folder"):
        find(tmp_path / "none" / "x.toml")


@pytest.mark.parametrize("name", ["", "\0", "a" * 5000, "../../../none.toml", "x/\0.toml"])
def test_names_that_no_file_can_have_are_refused(name):
    with pytest.raises(FileError):
        load(name)


def test_a_mechanism_without_a_possible_input_is_left_out_of_the_list(install, capsys):
    """A contact cannot be driven; the other mechanisms are listed."""
    folder = install("sk_contact", ["alpha.toml", "beta.toml"])
    text = find("roller_cam").read_text("utf-8")
    driven = text.replace("[inputs.cam_shaft]", "[inputs.contact]")
    (folder / "beta.toml").write_text(driven, "utf-8")
    assert main(["mechanisms"]) == 0
    out, err = capsys.readouterr()
    assert "contact is a contact pair" in err.replace('"', "")
    names = [line.split()[0] for line in out.splitlines()]
    assert "alpha" in names and "beta" not in names


def test_a_mechanism_without_a_description_is_listed_with_its_whole_source(install, capsys):
    folder = install("sk_source", ["alpha.toml"])
    lines = find("four_bar").read_text("utf-8").splitlines()
    text = "\n".join(line for line in lines if not line.startswith("description"))
    (folder / "alpha.toml").write_text(text, "utf-8")
    assert main(["mechanisms"]) == 0
    (line,) = [x for x in capsys.readouterr().out.splitlines() if x.split()[0] == "alpha"]
    assert "R. Di Gregorio, Dynamic model of single-DOF" in line
