"""`spherekit view`: a recording in the viewer, or as a picture."""

import argparse
import sys
from pathlib import Path

from spherekit.cli.suggest import recordings, suggesting
from spherekit.errors import OutputError

MARK = b"RRF"
"""What every recording of rerun starts with."""

EXAMPLES = (
    (
        "spherekit view out",
        "the recording in the folder of a run",
    ),
    (
        "spherekit view out --png picture.png --sample 90",
        "a picture of a sample, no display needed",
    ),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    suggesting(
        parser.add_argument("file", metavar="FILE|DIR", help="X.rrd, or a folder with one"),
        recordings,
    )
    parser.add_argument("--png", metavar="FILE", help="write a picture, no display needed")
    parser.add_argument("--sample", type=int, metavar="N", help="sample to show")
    parser.add_argument(
        "--front",
        action="append",
        default=[],
        metavar="TITLE",
        help="page or tab to bring to the front of the picture, may be repeated",
    )
    parser.add_argument(
        "--only-3d", action="store_true", help="only the mechanism in the picture"
    )
    parser.add_argument(
        "--size", default="1600x1000", metavar="WxH", help="size of the picture"
    )


def execute(options: argparse.Namespace) -> int:
    """Open the viewer, or write the picture."""
    path = find_recording(options.file)
    if options.png is None:
        from spherekit.view.viewer import open_viewer

        note = open_viewer(path)
        if note and not options.quiet:
            print(note, file=sys.stderr)
        return 0
    from spherekit.view.screenshot import screenshot

    try:
        width, height = (int(part) for part in options.size.lower().split("x"))
    except ValueError:
        raise OutputError(
            f"--size {options.size!r}: write WIDTHxHEIGHT, as 1600x1000"
        ) from None
    screenshot(
        path,
        Path(options.png),
        sample=options.sample,
        size=(width, height),
        view="3D" if options.only_3d else "all",
        front=options.front,
    )
    return 0


def find_recording(name: str) -> Path:
    """Return the recording that a path or a folder stands for."""
    path = Path(name)
    if path.is_dir():
        found = sorted(path.glob("*.rrd"))
        if not found:
            raise OutputError(f"{name}: the folder holds no recording; run with --save")
        return max(found, key=lambda item: item.stat().st_mtime)
    if not path.is_file():
        raise OutputError(f"{name}: no such recording; make one: run FILE --save X.rrd")
    try:
        with path.open("rb") as stream:
            start = stream.read(len(MARK))
    except OSError as error:
        raise OutputError(f"{name}: cannot be read: {error.strerror}") from None
    if start != MARK:
        raise OutputError(f"{name}: is not a recording; make one: run FILE --save X.rrd")
    return path
