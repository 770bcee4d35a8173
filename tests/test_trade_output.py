"""A trade as people see it: the table, the chart, and where both are written."""

import re
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from spherekit.cli.main import main
from spherekit.display.figures.contents import plan_figures
from spherekit.runs.evaluation_options import Setting
from spherekit.runs.trade_chart import scene
from spherekit.runs.trade_record import Measured, Trade, format_seconds
from spherekit.runs.trade_text import as_text

WORST = "poles.velocity_coefficient"


def made():
    """Return a trade with settings close to each other in time and error."""
    random = np.random.default_rng(7)
    every = [
        Measured(f"numpy r{k}", Setting(), t, t, error=1e-15)
        for k, t in enumerate(1e-3 + 361e-5 * (1.0 + 0.1 * random.random(8)))
    ]
    read = [
        Measured(f"numpy s {n}", Setting(), t, t, error=10.0 / n**4, worst_column=WORST)
        for n, t in ((n, 1e-4 * n + 361e-7) for n in (32, 64, 128, 4096))
    ]
    without = [
        Measured(f"numpy t {n}", None, reason="no curve closes") for n in (32, 64, 4096)
    ]
    columns = (
        ("poles.q", "absolute rad", 1.0),
        ("poles.velocity_coefficient", "relative to all", 1.5),
    )
    settings = (*every, *read, *without, Measured("compiled", None, reason="no heyoka"))
    return Trade("m", "poles", 361, 361, 722, "truth", 2e-16, 1, columns, settings, {})


def test_times_have_three_digits():
    shown = {4e-7: "0 us", 9.994e-4: "999 us", 9.996e-4: "1.00 ms", 0.0251: "25.1 ms"}
    shown |= {0.31: "310 ms", 0.9996: "1.00 s", 50.0: "50.0 s", 999.7: "1000 s"}
    assert {value: format_seconds(value) for value in shown} == shown


def test_columns_of_times_end_at_the_right():
    lines = as_text(made(), 1e-9).splitlines()
    rows = [line for line in lines if re.match(r"(\* |  ) numpy .*(ms|us| s)$", line)]
    assert len(rows) == 12 and len({len(line) for line in rows}) == 1
    assert "error of poles.velocity_coefficient: relative to all (1.5)" in lines
    assert "error of poles.q: absolute rad" in lines
    assert "does not apply: numpy t 32, numpy t 64, numpy t 4096: no curve closes" in lines
    assert "does not apply: compiled: no heyoka" in lines


def test_settings_with_one_reason_are_in_one_line():
    """One that differs in the setting's name, or in a number, is the same."""
    named = [
        Measured(name, None, reason=f"m: engine {name} finds rates by one input")
        for name in ("compiled", "extended")
    ]
    ended = [
        Measured(f"compiled 1e-{k}", None, reason=f"m: ended at t = 0.{k} s")
        for k in (3, 5)
    ]
    trade = replace(made(), settings=(*made().settings, *named, *ended))
    lines = [line for line in as_text(trade).splitlines() if "not apply" in line]
    assert lines[-2:] == [
        "does not apply: compiled, extended: engine finds rates by one input",
        "does not apply: compiled 1e-3, compiled 1e-5: ended at t = 0.3 s",
    ]


@pytest.mark.parametrize(
    "tolerances", [(None, 1e-5), pytest.param((1e-30, 1e5), marks=pytest.mark.slow)]
)
def test_everything_is_in_the_chart(tolerances):
    trade = made()
    for tolerance in tolerances:
        (chart, _) = scene(trade, tolerance).primitives
        labels = [curve.label for curve in chart.curves]
        assert any("numpy s 64" in label for label in labels)
        assert sum(label.startswith("tolerance") for label in labels) == (
            tolerance is not None
        )
        chosen = None if tolerance is None else trade.cheapest(tolerance)
        assert [mark.label == "taken" for mark in chart.marks].count(True) == (
            chosen is not None
        )
        places = np.array([mark.place for mark in chart.marks])
        assert np.all(places[:, 0] > chart.x_range[0])
        assert np.all(places[:, 1] < chart.y_range[1])
        (figure,) = plan_figures([scene(trade, tolerance)], {}).values()
        figure.draw_without_rendering()
        (panel,) = figure.axes
        frame = panel.get_window_extent()
        written = [text.get_window_extent() for text in panel.texts]
        assert len(written) == len(chart.marks)
        assert sum(frame.overlaps(box) for box in written) == len(written)
        assert not any(
            a.overlaps(b) for k, a in enumerate(written[:12]) for b in written[:k]
        )
    empty = Trade("m", "poles", 9, 9, 9, "truth", 2e-16, 1, (), (), {})
    assert scene(empty).primitives


def test_places_are_refused_before_anything_is_measured(tmp_path, capsys):
    file = tmp_path / "file"
    file.write_text("mine")
    for flags, words in [
        (["-o", str(file)], "is a file, not a folder"),
        (["-o", str(file / "below")], "a part of the path is a file"),
        (["--save", str(tmp_path / "x.txt")], "named *.rrd"),
        (["--save", str(tmp_path / "no" / "x.rrd")], "does not exist"),
    ]:
        assert main(["trade", "four_bar", "--samples", "1000000", *flags]) == 1
        out, err = capsys.readouterr()
        assert not out and words in err
    assert list(tmp_path.iterdir()) == [file] and file.read_text() == "mine"
