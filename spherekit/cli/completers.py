"""Words that a shell offers when Tab is pressed within an argument.

A completer takes the text typed so far and the options read so far, and returns the whole
words that may stand there. `argcomplete` calls it.
"""

import argparse
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

Completer = Callable[[str, argparse.Namespace], Sequence[str]]


def set_completer(argument: argparse.Action, completer: Completer) -> None:
    """Let a shell complete an argument with the Tab key, by words from a function.

    Parameters
    ----------
    argument
        The argument of a command.
    completer
        Function of the text typed so far and the options read so far. It returns the words
        that may stand there.
    """

    def complete(
        prefix: str, parsed_args: argparse.Namespace, action: object, parser: object
    ) -> Sequence[str]:
        """Return the words. `argcomplete` passes four arguments by these names."""
        return completer(prefix, parsed_args)

    vars(argument)["completer"] = complete


def complete_mechanisms(prefix: str, options: argparse.Namespace) -> list[str]:
    """Return the shipped mechanisms, and TOML files and folders."""
    from spherekit.files.library import shipped

    names = [name for pack in shipped() for name in pack.files]
    return names + _paths(prefix, ".toml")


def complete_studies(prefix: str, options: argparse.Namespace) -> list[str]:
    """Return the shipped studies and mechanisms, and TOML files and folders."""
    from spherekit.files.library import shipped

    names = [name for pack in shipped() for name in pack.studies]
    return names + complete_mechanisms(prefix, options)


def complete_analyses(prefix: str, options: argparse.Namespace) -> list[str]:
    """Return the words that a shell offers for the name of an analysis, with the Tab key.

    The words are the installed analyses. After ``NAME:`` they are the parameters of this
    analysis.
    """
    name, colon, parameter_text = prefix.partition(":")
    if not colon:
        # The registry would import NumPy, which takes longer than a user waits for Tab.
        from importlib.metadata import entry_points

        return [point.name for point in entry_points(group="spherekit.analyses")]
    from spherekit.errors import SpherekitError
    from spherekit.runs.parameter_text import describe_parameters
    from spherekit.runs.registry import load_analysis

    # The text is NAME:key=value,key=value,... The last parameter is not finished, so all
    # words begin with the text before it.
    _, _, unfinished = parameter_text.rpartition(",")
    finished = prefix[: len(prefix) - len(unfinished)]
    with suppress(SpherekitError):  # no such analysis, or a broken plugin
        return [f"{finished}{key}=" for key in describe_parameters(load_analysis(name))]
    return []


def complete_pairs(prefix: str, options: argparse.Namespace) -> list[str]:
    """Return the pairs of the mechanism that the command line names, if it can be read."""
    from spherekit.errors import SpherekitError
    from spherekit.files.study_reader import load_study

    # The file may not be typed yet (AttributeError, TypeError), or be wrong.
    with suppress(SpherekitError, AttributeError, TypeError):
        return [pair.name for pair in load_study(options.file).mechanism.pairs]
    return []


def complete_recordings(prefix: str, options: argparse.Namespace) -> list[str]:
    """Return recordings and folders."""
    return _paths(prefix, ".rrd")


def complete_toml_files(prefix: str, options: argparse.Namespace) -> list[str]:
    """Return TOML files and folders."""
    return _paths(prefix, ".toml")


def _paths(prefix: str, suffix: str) -> list[str]:
    """Return the paths that begin with a prefix: files with a suffix, and folders."""
    folder, slash, name_prefix = prefix.rpartition("/")
    folder_text = folder + slash
    paths = []
    with suppress(OSError):
        for path in Path(folder_text or ".").iterdir():
            if not path.name.startswith(name_prefix):
                continue
            if path.is_dir():
                paths.append(f"{folder_text}{path.name}/")
            elif path.suffix == suffix:
                paths.append(f"{folder_text}{path.name}")
    return paths
