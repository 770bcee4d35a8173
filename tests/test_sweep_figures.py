"""Figures of sweeps: a line, a map or points of each figure of merit."""

import numpy as np
import pandas as pd
import pytest

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import DesignError

pytest.importorskip("matplotlib")

SWING = "swing=swing(theta_41)"
ONE_SIZE = {"links.2.arc": [10.0, 15.0, 20.0]}


def test_one_size_gives_a_line_for_each_mode():
    result = sk.sweep("four_bar", ONE_SIZE, SWING, samples=31)
    figure = result.plot()["swing"]
    (axes,) = figure.axes
    assert len(axes.lines) == 2
    frame = result.frame()
    for line, mode in zip(axes.lines, ("+", "-"), strict=True):
        values = frame["swing"][frame["mode"] == mode]
        assert np.array_equal(line.get_ydata(), values)
        assert np.array_equal(line.get_xdata(), ONE_SIZE["links.2.arc"])
    assert axes.get_xlabel() == "links_2_arc, deg"
    assert axes.get_ylabel() == "swing, deg"


def test_a_grid_of_two_sizes_gives_a_map_for_each_mode():
    sizes = {**ONE_SIZE, "links.4.arc": "40:60:5"}
    figure = sk.sweep("four_bar", sizes, SWING, samples=31).plot()["swing"]
    maps = [axes for axes in figure.axes if axes.get_title()]
    assert [axes.get_title() for axes in maps] == ["assembly mode +", "assembly mode -"]
    for axes in maps:
        (mesh,) = axes.collections
        assert mesh.get_array().shape == (5, 3)


def test_three_sizes_give_points_over_each_size():
    sizes = {"links.2.arc": "10:20", "links.3.arc": "60:80", "links.4.arc": "40:60"}
    result = sk.sweep("four_bar", sizes, SWING, samples=31, designs=20)
    figure = result.plot(columns=1)["swing"]
    assert len(figure.axes) == 3
    frame = result.frame()
    for axes, size in zip(figure.axes, list(frame.columns[1:4]), strict=True):
        points = np.concatenate([c.get_offsets() for c in axes.collections])
        expected = frame[frame["status"] == "OK"]
        assert sorted(points[:, 0]) == sorted(expected[size])
        assert sorted(points[:, 1]) == sorted(expected["swing"])


def test_no_line_is_drawn_across_a_design_without_the_figure_and_lone_points_are_marked(
    monkeypatch,
):
    result = sk.sweep("four_bar", {"links.2.arc": "10:18:5"}, SWING, samples=31)
    frame = result.frame()
    # The second mode has no swing at the second and the fourth design.
    is_missing = (frame["mode"] == "-") & frame["design"].isin([1, 3])
    frame.loc[is_missing, "swing"] = np.nan
    monkeypatch.setattr(type(result), "frame", lambda _: frame)
    (axes,) = result.plot()["swing"].axes
    first, second = axes.lines
    assert np.all(np.isfinite(first.get_ydata()))
    assert np.array_equal(second.get_xdata(), first.get_xdata())
    has_value = [True, False, True, False, True]
    assert np.array_equal(np.isfinite(second.get_ydata()), has_value)
    assert second.get_marker() == "."
    assert second.get_markevery() == [0, 2, 4]


def test_a_mode_has_one_colour_in_all_figures_of_a_sweep(monkeypatch):
    merits = [SWING, "least=min(theta_41)"]
    result = sk.sweep("four_bar", ONE_SIZE, merits, samples=31)
    frame = result.frame()
    frame.loc[frame["mode"] == "+", "least"] = np.nan
    monkeypatch.setattr(type(result), "frame", lambda _: frame)
    figures = result.plot()
    colours = [
        {line.get_label(): line.get_color() for line in figures[name].axes[0].lines}
        for name in ("swing", "least")
    ]
    assert list(colours[1]) == ["assembly mode -"]
    assert colours[1].items() <= colours[0].items()


@pytest.mark.parametrize("columns", [1, 2])
def test_the_legend_of_many_modes_is_inside_the_figure(monkeypatch, columns):
    result = sk.sweep("four_bar", ONE_SIZE, SWING, samples=31)
    frame = result.frame()
    copies = [frame.assign(mode=frame["mode"].astype(str) * k) for k in range(1, 5)]
    monkeypatch.setattr(type(result), "frame", lambda _: pd.concat(copies))
    figure = result.plot(columns=columns)["swing"]
    figure.draw_without_rendering()
    (legend,) = figure.legends
    extent = legend.get_window_extent()
    assert len(legend.get_texts()) == 8
    assert figure.bbox.x0 <= extent.x0 and extent.x1 <= figure.bbox.x1


def test_a_width_of_other_than_one_or_two_columns_is_refused():
    result = sk.sweep("four_bar", ONE_SIZE, SWING, samples=31)
    with pytest.raises(DesignError, match="columns is 3"):
        result.plot(columns=3)


@pytest.mark.slow
def test_the_command_draws_figures_into_the_folder(tmp_path, capsys):
    command = ["sweep", "four_bar", "--vary", "links.2.arc=10:20:3", "--samples", "31"]
    command += ["--reduce", SWING, "--workers", "1", "--figures"]
    assert main(command) == 1
    assert "--figures needs an output folder" in capsys.readouterr().err
    assert main([*command, "-o", str(tmp_path / "designs")]) == 0
    assert "1 figure in" in capsys.readouterr().out
    (picture,) = (tmp_path / "designs" / "_figures").iterdir()
    assert picture.name == "swing.png"
    assert len(pd.read_parquet(tmp_path / "designs")) == 6
    # The next run with the same folder finds the parts of the sweep, and draws again.
    assert main([*command, "-o", str(tmp_path / "designs")]) == 0
