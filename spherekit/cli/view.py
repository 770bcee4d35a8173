"""`spherekit view`: a recording or a mechanism in the viewer, or as a picture."""

import shlex
import shutil
import sys
import tempfile
from argparse import ArgumentParser, Namespace
from contextlib import suppress
from pathlib import Path

from spherekit.cli.argument_types import whole_number
from spherekit.cli.completers import complete_recordings, set_completer
from spherekit.cli.main import note
from spherekit.cli.screen_report import ScreenReport
from spherekit.errors import OutputError
from spherekit.escaping import terminal_text
from spherekit.wording import listing

DEFAULT_SIZE = "1600x1000"
"""Width and height of a picture in pixels."""

EXAMPLES = """examples:
  # a mechanism before any run: links, pairs, arcs, zero positions
  spherekit view four_bar
  # the recording in the folder of a run
  spherekit view out
  # a picture of a sample, no display needed
  spherekit view out --png picture.png --sample 90
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `spherekit view`.

    This command shows a recording of a motion, or a mechanism, in a 3D viewer. It can write
    a picture instead.
    """
    file_argument = parser.add_argument(
        "file",
        metavar="FILE|DIR",
        help=(
            "what to show: a recording (X.rrd), the folder of a run, or a mechanism "
            "(X.toml, or the name of a shipped one)"
        ),
    )
    set_completer(file_argument, complete_recordings)
    parser.add_argument(
        "--png",
        metavar="PNG",
        help="write a picture to this file instead of opening the viewer; needs no display",
    )
    parser.add_argument(
        "--web",
        action="store_true",
        help=(
            "show FILE or DIR in a browser; this computer serves the page until you press "
            "Ctrl-C"
        ),
    )
    parser.add_argument(
        "--sample",
        metavar="N",
        type=whole_number,
        help="number of the sample to show in the picture, from 0",
    )
    parser.add_argument(
        "--front",
        metavar="TITLE",
        action="append",
        help=(
            "title of the page or tab of the recording that the picture shows; may be "
            "repeated, for example to select a page and a tab on it"
        ),
    )
    parser.add_argument(
        "--only-3d",
        action="store_true",
        help="the picture of --png shows only the 3D view, not the whole window",
    )
    parser.add_argument(
        "--size",
        metavar="WxH",
        default=DEFAULT_SIZE,
        help=f"width and height of the picture in pixels (default: {DEFAULT_SIZE})",
    )


def execute(options: Namespace) -> int:
    """Execute ``spherekit view``: show a recording or a mechanism, or write a picture.

    A study (a file that states what to compute) is refused, since it has no recording
    before its run. Returns the exit status.
    """
    if names_study(options.file):
        command = shlex.join(["spherekit", "run", options.file, "--view"])
        raise OutputError(
            f"{options.file}: a study cannot be shown before it is run: `{command}`; its "
            "mechanism alone is shown by `spherekit view MECHANISM.toml`"
        )
    if options.web and options.png:
        raise OutputError("--web and --png cannot be used together; give only one of them")
    describes_picture = (
        options.sample is not None
        or options.front
        or options.only_3d
        or options.size != DEFAULT_SIZE
    )
    if describes_picture and not options.png:
        raise OutputError(
            "--sample, --front, --only-3d and --size apply only to a picture; add --png, "
            "or leave them out"
        )
    if options.png:
        from spherekit.display.rerun.screenshot import check_picture

        check_picture(Path(options.png), _size(options.size))
    if is_mechanism(options.file):
        return _show_mechanism(options)
    return _show_recording(find_recording(options.file, options.quiet), options)


def is_mechanism(name: str) -> bool:
    """Return whether a name belongs to a mechanism file or a shipped mechanism.

    A file or folder with the name of a shipped mechanism comes first.
    """
    from spherekit.files.library import shipped

    path = Path(name)
    if path.suffix == ".toml":
        return True
    return any(name in pack.files for pack in shipped()) and not path.exists()


def names_study(name: str) -> bool:
    """Return whether a name belongs to a study file or a shipped study.

    A mechanism, file or folder with the name of a shipped study comes first.
    """
    from spherekit.files.library import STUDY_SUFFIX, shipped

    if name.endswith(STUDY_SUFFIX):
        return True
    is_shipped = any(name in pack.studies for pack in shipped())
    return is_shipped and not is_mechanism(name) and not Path(name).exists()


def _show_mechanism(options: Namespace) -> int:
    """Show a mechanism at one value of its inputs in every assembly mode, without a run.

    An assembly mode is one way to assemble the mechanism. A recording is written to a
    temporary folder and shown. The folder is deleted afterwards, unless an opened viewer
    still reads the recording. Returns the exit status 0.
    """
    from spherekit.display.rerun.preview import preview
    from spherekit.display.rerun.viewer import has_display
    from spherekit.files.mechanism_reader import load

    mechanism = load(options.file)
    if not (options.png or options.web or has_display()):
        command = shlex.join(["spherekit", "view", options.file, "--png", "X.png"])
        note(options, f"no display here: make a picture with `{command}`")
        return 0
    folder = Path(tempfile.mkdtemp(prefix="spherekit-"))
    path = folder / f"{mechanism.name}.rrd"
    try:
        # If the mechanism cannot be assembled at its first inputs, other inputs are shown.
        # The remark names these inputs, or is empty. `note` prints no empty text.
        other_inputs_remark = preview(mechanism, path)
        if other_inputs_remark:
            other_inputs_remark = f"{mechanism.name}: {other_inputs_remark}"
        note(options, other_inputs_remark)
        return _show_recording(path, options)
    finally:
        # A viewer that was opened still reads the recording. No viewer is opened for a
        # picture or a browser, or if an error has prevented the recording.
        is_read_by_viewer = path.exists() and not (options.png or options.web)
        if not is_read_by_viewer:
            shutil.rmtree(folder)


def _show_recording(path: Path, options: Namespace) -> int:
    """Show a recording in a browser or the viewer, or write a picture of it.

    Parameters
    ----------
    path
        The recording, ``*.rrd``.
    options
        Values of the arguments. ``file`` is the mechanism or recording that the user named.
        With ``web`` it is served to browsers, and with ``png`` a picture is written to this
        file. Otherwise the viewer is opened, if there is a display. The other arguments
        describe the picture, such as its size and the sample that it shows.

    Returns
    -------
    The exit status 0.
    """
    if options.web:
        from spherekit.display.rerun.web_viewer import serve_web

        serve_web(path, lambda url: print(f"{url}  (Ctrl-C ends it)", file=sys.stderr))
        return 0
    if not options.png:
        from spherekit.display.rerun.viewer import open_viewer

        note(options, open_viewer(path))
        return 0
    from spherekit.display.rerun.screenshot import screenshot

    screenshot(
        path,
        Path(options.png),
        sample=options.sample,
        size=_size(options.size),
        view="3D" if options.only_3d else "all",
        front=options.front or (),  # tabs that are brought to the front
    )
    what = "the mechanism" if is_mechanism(options.file) else "the recording"
    sample = "" if options.sample is None else f" at sample {options.sample}"
    report = ScreenReport(
        f"{path.stem}: picture of {what}{sample}", files=f"{options.png}, {options.size}"
    )
    command = shlex.join(["spherekit", "view", options.file])
    report.next_steps = [(command, "turn and zoom it in the viewer")]
    report.print(options)
    return 0


def _size(text: str) -> tuple[int, int]:
    """Return width and height in pixels from a text such as ``1600x1000``."""
    try:
        width, height = map(int, text.lower().split("x"))
    except ValueError:
        raise OutputError(
            f"--size {text!r}: write WIDTHxHEIGHT, such as 1600x1000"
        ) from None
    return width, height


def find_recording(name: str, quiet: bool = False) -> Path:
    """Return the path of a recording; for a folder, of its newest recording."""
    from spherekit.display.rerun.viewer_program import recording_at

    path = Path(name)
    with suppress(OSError, ValueError):  # reported by recording_at below
        path = _newest_recording(path, quiet) if path.is_dir() else path
    return recording_at(path)


def _newest_recording(folder: Path, quiet: bool) -> Path:
    """Return the newest recording in a folder, and print the names of the others."""
    recordings = sorted(path for path in folder.glob("*.rrd") if path.is_file())
    if not recordings:
        raise OutputError(f"{folder}: the folder holds no recording; run with --save")
    newest = max(recordings, key=lambda path: path.stat().st_mtime)
    if len(recordings) > 1 and not quiet:
        others = listing(path.name for path in recordings if path != newest)
        message = f"{newest}: the newest; also there: {others}"
        print(terminal_text(message), file=sys.stderr)
    return newest
