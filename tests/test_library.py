"""Packs of mechanism files, found through entry points without importing them."""

import os
import sys

import pytest
from helpers.refusals import mechanism_text

from spherekit.errors import FileError
from spherekit.files.library import GROUP, find, shipped
from spherekit.files.mechanism_reader import load

SOUND = mechanism_text("library_sound")


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Return a function that installs a pack of files under a package name."""
    site = tmp_path / "site"
    site.mkdir()
    monkeypatch.syspath_prepend(str(site))

    def add(package, files, value=None, code="raise RuntimeError('imported')"):
        info = site / f"{package}-1.5.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.5\n"
        )
        (info / "entry_points.txt").write_text(
            f"[{GROUP}]\n{package} = {value or package}\n"
        )
        if files is not None:
            folder = site / package
            folder.mkdir()
            (folder / "__init__.py").write_text(code)
            for name in files:
                (folder / name).write_text(SOUND.format(name=name.split(".")[0]))
        return site / package

    return add


def pack(name):
    """Return the record of an installed pack."""
    return next(each for each in shipped() if each.name == name)


def test_packs_are_listed_and_found_without_importing(install):
    folder = install("sk_pack", ["alpha_bar.toml", "beta.toml", "x.study.toml", "a.txt"])
    found = pack("sk_pack")
    assert dict(found.files) == {
        "alpha_bar": folder / "alpha_bar.toml",
        "beta": folder / "beta.toml",
    }
    assert not found.fault
    assert find("beta") == folder / "beta.toml"
    assert load("alpha_bar").name == "alpha_bar"
    assert "sk_pack" not in sys.modules


def test_broken_packs_are_records(install):
    install("sk_sound", ["gamma.toml"])
    install("sk_gone", None)
    install("sk_empty", [])
    install("sk_named", ["two words.toml"])
    install("sk_odd", None, value="sk_missing.inner")
    assert "no package is named" in pack("sk_gone").fault
    assert "holds no .toml files" in pack("sk_empty").fault
    assert "not a name of letters" in pack("sk_named").fault
    assert "ModuleNotFoundError" in pack("sk_odd").fault
    assert find("gamma").name == "gamma.toml"
    with pytest.raises(FileError, match=r"Broken packs: .*sk_empty \(sk_empty holds no"):
        find("delta")

    install("sk_one", ["same.toml"])
    install("sk_two", ["same.toml"])
    with pytest.raises(FileError, match=r"shipped by several packs; give a path: .*sk_one"):
        find("same")


def test_a_shipped_name_is_not_hidden_by_a_folder(install, tmp_path, monkeypatch):
    folder = install("sk_pack", ["alpha_bar.toml"])
    monkeypatch.chdir(tmp_path)
    (tmp_path / "alpha_bar").mkdir()
    assert find("alpha_bar") == folder / "alpha_bar.toml"
    assert find(f".{os.sep}alpha_bar").name == "alpha_bar"


def test_not_found_names_the_nearest(install, tmp_path, monkeypatch):
    install("sk_pack", ["alpha_bar.toml"])
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileError) as caught:
        find("alpa_bar")
    assert 'alpa_bar: not found; did you mean "alpha_bar"?' in str(caught.value)
    assert "Shipped mechanisms: " in str(caught.value)
    (tmp_path / "my_bar.toml").write_text("")
    with pytest.raises(FileError) as caught:
        find(tmp_path / "mybar.toml")
    assert 'did you mean "my_bar.toml"?' in str(caught.value)
    assert f"Files in {tmp_path}: my_bar.toml" in str(caught.value)
    with pytest.raises(FileError, match="nor is its folder"):
        find(tmp_path / "none" / "x.toml")


@pytest.mark.parametrize("name", ["", "\0", "a" * 5000, "../../../none.toml", "x/\0.toml"])
def test_unusable_names_are_file_errors(name):
    with pytest.raises(FileError):
        load(name)
