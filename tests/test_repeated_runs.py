"""The run that is repeated for figures and recordings is the run of the result."""

import pickle

import numpy as np
import pytest

import spherekit as sk
from spherekit.files.library import find


def drawn_points(result):
    """Return the vertical positions of all curves of a figure of the poles."""
    figure = result.plot("velocity coefficients")
    lines = (line for axes in figure.axes for line in axes.lines)
    return np.concatenate([line.get_ydata() for line in lines])


@pytest.fixture
def expected_points():
    """Curves of the four-bar at 9 samples from 0 to 1 rad."""
    pytest.importorskip("matplotlib")
    return drawn_points(sk.run("four_bar", "poles", path=np.linspace(0.0, 1.0, 9)[:, None]))


@pytest.mark.parametrize("is_keyword", [False, True])
def test_figures_show_the_file_as_it_was_at_the_run(tmp_path, expected_points, is_keyword):
    path = tmp_path / "linkage.toml"
    text = find("four_bar").read_text(encoding="utf-8")
    path.write_text(text, encoding="utf-8")
    subjects = [] if is_keyword else [path]
    options = {"subject": path, "analyses": "poles"} if is_keyword else {}
    options["path"] = np.linspace(0.0, 1.0, 9)[:, None]
    result = sk.run(*subjects, **options)
    path.write_text(text.replace("arcs = [70.0]", "arcs = [75.0]"), encoding="utf-8")
    copied = pickle.loads(pickle.dumps(result))
    path.unlink()
    np.testing.assert_array_equal(drawn_points(result), expected_points)
    np.testing.assert_array_equal(drawn_points(copied), expected_points)


def test_figures_show_the_arrays_and_lists_as_they_were_at_the_run(expected_points):
    path = np.linspace(0.0, 1.0, 9)[:, None]
    analyses = ["poles"]
    result = sk.run("four_bar", analyses, path=path)
    path *= 2.0
    analyses[0] = "dynamics"
    np.testing.assert_array_equal(drawn_points(result), expected_points)
