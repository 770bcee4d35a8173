"""Mechanism files from MJCF and URDF."""

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from spherekit.argument_validation import checked
from spherekit.conventions import AnyPath, Names
from spherekit.errors import FileError
from spherekit.escaping import toml_comment
from spherekit.exchange.mechanism_from_bodies import ForeignTables
from spherekit.exchange.mujoco_file import ForeignModel
from spherekit.files.mechanism_reader import loads
from spherekit.files.schema import FORMAT
from spherekit.files.toml_text import assignment, tables
from spherekit.mechanism.mechanism import Mechanism
from spherekit.storage.atomic_write import write_text


class Imported(NamedTuple):
    """A mechanism from another program's file.

    `text` is its mechanism file, commented; `notes` say what was left out or changed.
    """

    mechanism: Mechanism
    text: str
    notes: Names

    def save(self, path: AnyPath) -> None:
        """Write the mechanism file.

        Raises
        ------
        OutputError
            If it cannot be written there.
        """
        write_text(path, self.text)


@checked(FileError)
def import_mechanism(path: AnyPath, *, within: float | None = None) -> Imported:
    """Return the spherical mechanism that an MJCF or URDF file describes.

    Hinges are pairs, and so is each point at which a loop is closed; bodies that are
    welded are one link. Actuated joints are inputs. Springs, dampers, dry friction, limits,
    gravity and constant actuators are loads and joint limits.

    Parameters
    ----------
    path
        The file, ``*.xml`` or ``*.urdf``; a URDF may close loops by ``<loop_joint>`` or
        ``<loop>``.
    within
        Distance (m) by which axes may miss their common point, by default 1e-6 of the
        size of the model.

    Raises
    ------
    FileError
        If MuJoCo (extra ``import``) is not installed or cannot read the file, its axes do
        not meet in a point, or it has joints other than hinges.

    Examples
    --------
    >>> import spherekit as sk
    >>> made = sk.export("four_bar", "four_bar.xml")
    >>> again = sk.import_mechanism("four_bar.xml").mechanism
    >>> again.links
    ('1', '2', '3', '4')
    """
    where = Path(path)
    if within is not None and not 0.0 <= within < math.inf:
        raise FileError(f"{where}: within is {within}; it has to be a distance in m")
    model = ForeignModel(where)
    name = re.sub(r"[^A-Za-z0-9_]", "_", model.name) or where.stem
    built = ForeignTables(str(where), model, within)
    text = "\n".join([*_lines(name, built), ""])
    return Imported(loads(text, f"{where}: imported"), text, tuple(built.notes))


def _lines(name: str, built: ForeignTables) -> Iterator[str]:
    for line in built.heading:
        yield f"# {toml_comment(line)}"
    ground = next(iter(built.content["links"]))
    first = {"format": FORMAT, "name": name, "angle_unit": "deg", "ground": ground}
    yield from (assignment(key, value) for key, value in first.items())
    for key, content in built.content.items():
        if key == "source":
            yield from tables((key,), content)
            continue
        for item, table in content.items():
            blank, *rest = tables((key, item), table)
            yield blank
            if (key, item) in built.comments:
                yield f"# {toml_comment(built.comments[key, item])}"
            yield from rest
