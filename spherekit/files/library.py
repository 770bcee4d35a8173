"""Finds mechanism and study files by path, or by the name of a shipped one.

Packages ship mechanisms as packs: folders of files with an entry point.
"""

import os
import re
import textwrap
from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from spherekit.conventions import MAX_NAME_LENGTH, NAME_PATTERN, AnyPath
from spherekit.errors import FileError
from spherekit.wording import listing, nearest

GROUP = "spherekit.mechanisms"
"""Entry-point group of packs; the value is the package that holds the files."""

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")
_SUFFIX = ".toml"
STUDY_SUFFIX = ".study.toml"
"""How the names of study files end; all other files are mechanisms."""


class Pack(NamedTuple):
    """A pack of mechanism and study files that an installed package ships.

    Attributes
    ----------
    name
        Name of the entry point (declaration in the metadata of an installed package).
    files, studies
        Paths of the mechanism files and of the study files, by name without ending.
    fault
        Reason why the pack cannot be used; empty if it can.
    """

    name: str
    files: Mapping[str, Path] = MappingProxyType({})
    studies: Mapping[str, Path] = MappingProxyType({})
    fault: str = ""

    def path(self, name: str) -> Path | None:
        """Return the path of the file with a name, or None.

        If a mechanism and a study have this name, the mechanism is returned.
        """
        return self.files.get(name) or self.studies.get(name)


def shipped() -> tuple[Pack, ...]:
    """Return all installed packs with their mechanisms, without importing them."""
    unique = {(point.name, point.value): point for point in entry_points(group=GROUP)}
    return tuple(_pack(unique[key]) for key in sorted(unique))


class MechanismNames(tuple[str, ...]):
    """Names of mechanisms, printed in groups by the pack that ships them."""

    packs: tuple[Pack, ...]

    def __repr__(self) -> str:
        lines = []
        for pack in self.packs:
            names = f"broken: {pack.fault}" if pack.fault else ", ".join(sorted(pack.files))
            lines += textwrap.wrap(f"{pack.name}: {names}", 88, subsequent_indent="  ")
        return "\n".join(lines)


def mechanisms() -> MechanismNames:
    """Return the names of shipped mechanisms, including those of plugins.

    Functions such as `load` accept such a name in place of a path. Plugins are installed
    packages that ship mechanism files.

    Examples
    --------
    >>> import spherekit as sk
    >>> "four_bar" in sk.mechanisms()
    True
    """
    # A pack is the set of files that one installed package ships.
    packs = shipped()
    names = MechanismNames(sorted(name for pack in packs for name in pack.files))
    names.packs = packs
    return names


def find(name_or_path: AnyPath) -> Path:
    """Return the path of a mechanism or study file, given as a path or shipped name.

    A pack is the set of mechanism and study files that one installed package ships. A plain
    name, without folder and ending, is first searched in all packs, and then taken as a
    path.

    Raises
    ------
    FileError
        If there is no such file, or if two packs have a file of this name.
    """
    text = os.fspath(name_or_path)
    if _CONTROL.search(text):
        raise FileError(
            f"{ascii(text)[:200]}: this cannot be a path, because it has control characters"
        )
    path = Path(text)
    packs = shipped() if isinstance(name_or_path, str) and _is_name(text) else ()
    pack_paths = [pack.path(text) for pack in packs]
    shipped_paths = [pack_path for pack_path in pack_paths if pack_path is not None]
    if len(shipped_paths) == 1:
        return shipped_paths[0]
    if shipped_paths:
        raise FileError(
            f'"{text}" is in several packs; give one of their paths: '
            f"{listing(shipped_paths)}"
        )
    try:
        if path.exists():
            return path
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise FileError(f"{ascii(text)[:200]}: this cannot be a path: {reason}") from None
    raise FileError(_not_found_message(path, shipped()))


def named_in(name: str, folder: Path) -> str | Path:
    """Return the mechanism that a study file names: a shipped name or the path of a file.

    Parameters
    ----------
    name
        What the study states: a shipped name, or a path relative to its folder.
    folder
        The folder of the study file.
    """
    return name if any(name in pack.files for pack in shipped()) else folder / name


def is_study(path: Path) -> bool:
    """Return whether a path is named as a study file."""
    return path.name.endswith(STUDY_SUFFIX)


def _is_name(word: str) -> bool:
    return bool(NAME_PATTERN.fullmatch(word)) and len(word) <= MAX_NAME_LENGTH


def _pack(entry: EntryPoint) -> Pack:
    """Return the pack (shipped files) that an installed package declares.

    A pack is the set of mechanism and study files in the folder of an installed package.
    The package declares itself by an entry point (name in its metadata). If the pack cannot
    be used, the result has no files, and its `fault` is the reason.
    """

    def broken_pack(fault: str) -> Pack:
        """Return the pack without files, with the reason why it cannot be used."""
        return Pack(entry.name, fault=fault)

    # To find a package inside another one, Python imports the outer package. This runs
    # code, which may raise any error.
    try:
        spec = find_spec(entry.value)
    except Exception as error:
        return broken_pack(f"{type(error).__name__}: {error}")
    if spec is None:
        return broken_pack(f'no package is named "{entry.value}"')
    # Mechanism and study files by their names. A namespace package can have several
    # folders. The first file of each name is used.
    files: dict[str, Path] = {}
    studies: dict[str, Path] = {}
    for folder in spec.submodule_search_locations or ():
        try:
            entries = sorted(Path(folder).iterdir())
        except OSError as error:
            # A package that was installed as a zip archive has no folder.
            return broken_pack(
                f"{folder}: {error.strerror}; install the pack as a folder, not as a "
                "zip archive"
            )
        for path in entries:
            if not path.name.endswith(_SUFFIX):
                continue
            name = path.name.removesuffix(STUDY_SUFFIX).removesuffix(_SUFFIX)
            if not _is_name(name):
                return broken_pack(f"{path.name}: not a name of letters, digits and _")
            path_by_name = studies if is_study(path) else files
            path_by_name.setdefault(name, path)
    if not files and not studies:
        return broken_pack(f"{entry.value} holds no {_SUFFIX} files")
    return Pack(entry.name, files, studies)


def _not_found_message(path: Path, packs: tuple[Pack, ...]) -> str:
    """Return the message about a path at which there is no file.

    The message names the most similar existing name, the files in the folder, the shipped
    mechanisms, and packs that cannot be used.

    Parameters
    ----------
    path
        The path that the user gave.
    packs
        The packs (sets of files) that installed packages ship.
    """
    # Names of shipped mechanisms, and of shipped studies. A study file names a mechanism
    # and the analyses to run.
    names = sorted(name for pack in packs for name in pack.files)
    studies = [name for pack in packs for name in pack.studies]
    folder = path.parent
    try:
        nearby_files = sorted(
            file.name for file in folder.iterdir() if file.name.endswith(_SUFFIX)
        )
    except OSError:
        return f"{path}: not found, and its folder {folder} cannot be read"
    # A suggestion is "; did you mean ...?", or an empty text.
    suggestion = nearest(path.name, nearby_files)
    if not suggestion:
        suggestion = nearest(path.stem, [*names, *studies])
    message = f"{path}: not found"
    message += suggestion or "."
    folder_words = "the current folder" if folder == Path() else folder
    if nearby_files:
        message += f" Files in {folder_words}: {listing(nearby_files)}."
    if names:
        message += f" Shipped mechanisms: {listing(names)}."
    if not nearby_files and not names:
        message += f" There are no {_SUFFIX} files in {folder_words}."
    faults = [f"{pack.name} ({pack.fault})" for pack in packs if pack.fault]
    if faults:
        message += f" Broken packs: {listing(faults)}."
    return message
