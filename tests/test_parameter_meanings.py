"""The meaning of each parameter of an analysis, on the screen and on the site."""

import inspect
import json

import pytest

from spherekit.cli.analyses import _default_text
from spherekit.cli.main import main
from spherekit.runs.parameter_meanings import parameter_meanings, plain_meaning
from spherekit.runs.parameter_text import Parameter, describe_parameters
from spherekit.runs.registry import analysis_names, load_analysis


@pytest.mark.parametrize("name", analysis_names())
def test_every_parameter_has_the_meaning_that_numpydoc_reads(name):
    """Every parameter of an analysis has a meaning, read from the docstring of its class.

    numpydoc, an independent reader of docstrings, finds the same meanings.
    """
    docscrape = pytest.importorskip("numpydoc.docscrape")
    analysis_class = load_analysis(name)
    meanings = parameter_meanings(analysis_class)
    assert meanings.keys() >= describe_parameters(analysis_class).keys()
    assert all(meanings.values())

    docstring = docscrape.NumpyDocString(inspect.getdoc(analysis_class))
    entries = [*docstring["Parameters"], *docstring["Attributes"]]
    expected = {
        one_name.strip(): " ".join(" ".join(entry.desc).split())
        for entry in entries
        for one_name in entry.name.split(",")
    }
    assert meanings == expected


def test_the_command_prints_the_meanings_of_parameters(capsys):
    assert main(["analyses", "poles"]) == 0
    printed = capsys.readouterr().out
    assert "Poles to compute, such as 31+42. By default all." in printed

    assert main(["analyses", "poles", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["parameter_meanings"].keys() == facts["parameters"].keys()
    assert facts["parameter_meanings"]["only"].startswith("Poles to compute")


def test_code_in_a_meaning_is_printed_without_backticks():
    assert plain_meaning("of `low` to ``high``.") == "of low to high."


def test_two_parameters_can_share_a_meaning():
    """An entry of a docstring with two names is the meaning of both parameters.

    The expected meanings are written out. Only the section with the parameters is read:
    "third" in the notes is no parameter.
    """

    # The class is here for its docstring, from which the meanings are read. A line end in a
    # meaning becomes a space. Both kinds of backticks stay as they are.
    class Example:
        """A class whose docstring is read.

        Attributes
        ----------
        low, high
            Ends of the range of `low`
            to ``high``.
        other : float
            Another one.

        Notes
        -----
        third
            Looks like a parameter, but is in the notes, so it is left out.
        """

    assert parameter_meanings(Example) == {
        "low": "Ends of the range of `low` to ``high``.",
        "high": "Ends of the range of `low` to ``high``.",
        "other": "Another one.",
    }


@pytest.mark.parametrize(
    ("default", "text"), [(5, "5 deg"), ((1, 2.5), "1+2.5 deg"), ((), "-"), (None, "None")]
)
def test_a_default_value_is_shown_with_its_unit(default, text):
    assert _default_text(Parameter("angle", default, "deg")) == text
