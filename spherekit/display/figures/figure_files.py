"""Figures as files."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, get_args

from spherekit.display.figures.matplotlib_sdk import Figure
from spherekit.storage.atomic_write import (
    SOFTWARE_MARK,
    check_made_by_spherekit,
    make_folder,
    output_error,
)

FigureFormat = Literal["png", "pdf", "svg"]
"""Formats of files of figures."""

FORMATS: tuple[FigureFormat, ...] = get_args(FigureFormat)


def write_figures(
    figures: Mapping[str, Figure], folder: Path, kind: FigureFormat = "png"
) -> list[Path]:
    """Write every figure of a run into a folder, named by analysis and subject.

    Figures whose names give the same file name get numbers, so that each has a file.
    An existing file is replaced only if it contains the name of this software.

    Parameters
    ----------
    figures
        The figures by name.
    folder
        The folder, which is made if it does not exist.
    kind
        Format of the files.

    Returns
    -------
    The paths of the files.

    Raises
    ------
    OutputError
        If a file cannot be written, or would replace a file that spherekit has not made.
    """
    make_folder(folder)
    paths: list[Path] = []
    # Some disks do not distinguish capital letters in the names of files.
    used_stems: set[str] = set()
    for name in figures:
        first_stem = stem = file_stem(name) or "figure"
        number = 1
        while stem.lower() in used_stems:
            number += 1
            stem = f"{first_stem}_{number}"
        used_stems.add(stem.lower())
        path = folder / f"{stem}.{kind}"
        check_made_by_spherekit(path, SOFTWARE_MARK.encode())
        try:
            figures[name].savefig(path, metadata={"Creator": SOFTWARE_MARK})
        except OSError as error:
            raise output_error(path, "written", error) from error
        paths.append(path)
    return paths


def file_stem(name: str) -> str:
    """Return the name of the file of a figure, without its ending.

    The name has only letters of ASCII, digits and underscores, and may be empty.
    """
    return re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
