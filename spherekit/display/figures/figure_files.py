"""Figures as files."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, get_args

from spherekit.display.figures.matplotlib_sdk import Figure
from spherekit.errors import OutputError
from spherekit.storage.atomic_write import (
    SOFTWARE_MARK,
    check_made_by_spherekit,
    make_folder,
)

FigureFormat = Literal["png", "pdf", "svg"]
"""Formats of files of figures."""

FORMATS: tuple[FigureFormat, ...] = get_args(FigureFormat)


def write_figures(
    figures: Mapping[str, Figure], folder: Path, kind: FigureFormat = "png"
) -> list[Path]:
    """Write every figure of a run into a folder, named by analysis and subject.

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
    paths = []
    for name in figures:
        path = folder / f"{file_stem(name)}.{kind}"
        check_made_by_spherekit(path, SOFTWARE_MARK.encode())
        try:
            figures[name].savefig(path, metadata={"Creator": SOFTWARE_MARK})
        except OSError as error:
            raise OutputError(
                f"cannot write {path}: {error.strerror}; choose a folder you may write to, "
                "on a disk with room"
            ) from error
        paths.append(path)
    return paths


def file_stem(name: str) -> str:
    """Return the name of the file of a figure, without its ending."""
    return re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
