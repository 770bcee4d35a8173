"""Mechanism files from MJCF and URDF."""

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from spherekit.argument_validation import checked
from spherekit.conventions import MAX_NAME_LENGTH, AnyPath, Names
from spherekit.errors import FileError
from spherekit.escaping import toml_comment
from spherekit.exchange.mechanism_from_bodies import ImportedFile
from spherekit.exchange.mujoco_file import ForeignModel
from spherekit.files.mechanism_reader import loads
from spherekit.files.schema import FORMAT
from spherekit.files.toml_text import assignment_text, table_lines
from spherekit.mechanism.mechanism import Mechanism
from spherekit.storage.atomic_write import write_text


class Imported(NamedTuple):
    """A mechanism that was read from the file of another program (MJCF or URDF).

    Attributes
    ----------
    mechanism
        The mechanism.
    text
        The same mechanism as the text of a spherekit file (TOML), with comments.
    notes
        Sentences for the user on everything that was left out or changed.
    """

    mechanism: Mechanism
    text: str
    notes: Names

    def save(self, path: AnyPath) -> None:
        """Write the mechanism file.

        Raises
        ------
        OutputError
            If the file cannot be written there.
        """
        write_text(path, self.text)


@checked(FileError)
def import_mechanism(path: AnyPath, *, within: float | None = None) -> Imported:
    """Return the spherical mechanism that an MJCF or URDF file describes.

    Hinges become pairs (joints), and so does each point at which a loop is closed. A ball
    joint becomes three pairs, or none if other pairs connect its links. Welded bodies
    become one link. Joints with controlled actuators become inputs. If the mechanism has
    more degrees of freedom than such actuators, other joints become inputs too. Springs,
    dampers, dry friction, gravity and actuators without control become loads. Limits become
    joint limits.

    Parameters
    ----------
    path
        The file, ``*.xml`` (MJCF) or ``*.urdf``. A URDF may close loops by ``<loop_joint>``
        or ``<loop>``.
    within
        Largest distance (m) of an axis from the centre of the sphere, the point in which
        all axes should meet. By default 1e-6 of the size of the model.

    Raises
    ------
    FileError
        If MuJoCo (extra ``import``) is not installed or cannot read the file, if the axes
        of the mechanism do not meet in a point, or if it has joints other than hinges and
        ball joints.

    Examples
    --------
    >>> import spherekit as sk
    >>> made = sk.export("four_bar", "four_bar.xml")
    >>> again = sk.import_mechanism("four_bar.xml").mechanism
    >>> again.links
    ('1', '2', '3', '4')
    """
    model_path = Path(path)
    if within is not None and not 0.0 <= within < math.inf:
        raise FileError(f"{model_path}: within is {within}; it has to be a distance in m")
    foreign_model = ForeignModel(model_path)
    name = re.sub(r"[^A-Za-z0-9_]", "_", foreign_model.name)[:MAX_NAME_LENGTH]
    imported_file = ImportedFile(str(model_path), foreign_model, within)
    text = "\n".join([*_format_lines(name, imported_file), ""])
    mechanism = loads(text, f"{model_path}: imported")
    return Imported(mechanism, text, tuple(imported_file.notes))


def _format_lines(name: str, imported_file: ImportedFile) -> Iterator[str]:
    """Yield the lines of a mechanism file, with comments above its tables.

    Parameters
    ----------
    name
        Name of the mechanism that is written.
    imported_file
        The content of an MJCF or URDF file, sorted into the tables of a mechanism file, and
        the comments on these tables.
    """
    for comment in imported_file.heading:
        yield f"# {toml_comment(comment)}"
    # The first link of an imported file is the ground.
    ground = next(iter(imported_file.content["links"]))
    yield assignment_text("format", FORMAT)
    yield assignment_text("name", name)
    yield assignment_text("angle_unit", "deg")
    yield assignment_text("ground", ground)
    for table_name, content in imported_file.content.items():
        # The table of the source (citation) has keys with values. All other tables have
        # named items, each with a table of its own.
        if table_name == "source":
            yield from table_lines((table_name,), content)
            continue
        for item, table in content.items():
            # The first line is empty, so the comment follows it.
            empty_line, *lines = table_lines((table_name, item), table)
            yield empty_line
            if (table_name, item) in imported_file.comments:
                yield f"# {toml_comment(imported_file.comments[table_name, item])}"
            yield from lines
