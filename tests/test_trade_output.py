"""A trade as people see it: the table, the chart, and where both are written."""

import re
from dataclasses import replace
from itertools import combinations

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


def make_trade():
    """Return an invented trade with settings that are close in time and error.

    A trade (of accuracy for speed) has the time and the error of settings, which are ways
    to compute a run. Times and errors of some settings are so close that their labels in
    the chart would overlap if they were not moved.

    - "numpy r0" to "numpy r7" evaluate each of 361 samples in about 10 us.
    - "numpy s n" interpolates between n nodes, each of which takes 100 us. Its error is
      10/n^4.
    - "numpy t n" and "compiled" do not apply. They have a reason and no numbers.

    The best and the median time of a setting are equal. The error of a column was divided
    by a scale, 1.0 or 1.5, which the text states. The error of the reference itself
    (`floor`) is 2e-16.
    """
    sample_count = 361
    random = np.random.default_rng(7)
    settings = []
    for k, fraction in enumerate(random.random(8)):
        seconds = 1e-3 + 1e-5 * sample_count * (1.0 + 0.1 * fraction)
        settings.append(
            Measured(
                f"numpy r{k}",
                Setting(),
                seconds=seconds,
                seconds_median=seconds,
                error=1e-15,
            )
        )
    for n in (32, 64, 128, 4096):
        seconds = 1e-4 * n + 1e-7 * sample_count
        settings.append(
            Measured(
                f"numpy s {n}",
                Setting(),
                seconds=seconds,
                seconds_median=seconds,
                error=10.0 / n**4,
                worst_column=WORST,
            )
        )
    for n in (32, 64, 4096):
        settings.append(Measured(f"numpy t {n}", None, reason="no curve closes"))
    settings.append(Measured("compiled", None, reason="no heyoka"))
    columns = (
        ("poles.q", "absolute rad", 1.0),
        ("poles.velocity_coefficient", "relative to all", 1.5),
    )
    return Trade(
        mechanism="m",
        analysis="poles",
        samples=sample_count,
        checked=sample_count,
        rows=2 * sample_count,
        reference="truth",
        floor=2e-16,
        derivatives=1,
        columns=columns,
        settings=tuple(settings),
        made_for={},
    )


def test_times_have_three_digits_and_the_largest_unit_below_them():
    texts_by_seconds = {
        4e-7: "0 us",
        9.994e-4: "999 us",
        9.996e-4: "1.00 ms",
        0.0251: "25.1 ms",
        0.31: "310 ms",
        0.9996: "1.00 s",
        50.0: "50.0 s",
        999.7: "1000 s",
    }
    for seconds, text in texts_by_seconds.items():
        assert format_seconds(seconds) == text


def test_the_table_of_a_trade_is_aligned_and_explains_its_errors():
    """The twelve measured settings have lines of one length, which end with a time."""
    lines = as_text(make_trade(), 1e-9).splitlines()
    rows = [line for line in lines if re.match(r"(\* |  ) numpy .*(ms|us| s)$", line)]
    assert len(rows) == 12
    assert len({len(line) for line in rows}) == 1
    assert "error of poles.velocity_coefficient: relative to all (1.5)" in lines
    assert "error of poles.q: absolute rad" in lines
    assert "does not apply: numpy t 32, numpy t 64, numpy t 4096: no curve closes" in lines
    assert "does not apply: compiled: no heyoka" in lines


def test_settings_that_do_not_apply_for_one_reason_share_a_line():
    """Settings of a trade that do not apply for the same reason share a line of its table.

    A trade has the time and the error of several settings, which are ways to compute a run.
    Reasons that differ only in the name of the setting or in a number count as one. A
    reason begins with the name of the mechanism, here m, which the line does not repeat.
    """
    refused_engines = [
        Measured(name, None, reason=f"m: engine {name} finds rates by one input")
        for name in ("compiled", "extended")
    ]
    ended_simulations = [
        Measured(f"compiled 1e-{k}", None, reason=f"m: ended at t = 0.{k} s")
        for k in (3, 5)
    ]
    trade = make_trade()
    settings = (*trade.settings, *refused_engines, *ended_simulations)
    trade = replace(trade, settings=settings)
    lines = [line for line in as_text(trade).splitlines() if "not apply" in line]
    assert lines[-2:] == [
        "does not apply: compiled, extended: engine finds rates by one input",
        "does not apply: compiled 1e-3, compiled 1e-5: ended at t = 0.3 s",
    ]


@pytest.mark.parametrize(
    "tolerance",
    [
        None,
        1e-5,
        pytest.param(1e-30, marks=pytest.mark.slow),
        pytest.param(1e5, marks=pytest.mark.slow),
    ],
)
def test_the_chart_of_a_trade_shows_all_settings_and_the_chosen_one(tolerance):
    """The chart of a trade has a line for the tolerance and a mark on the chosen setting.

    A trade has the time and the error of several settings, which are ways to compute a run.
    The chart shows the error of each setting over its time. Labels of curves name the
    settings, for example "numpy s 64". The recommended setting is the cheapest one that
    meets the tolerance; its mark has the label "taken". If no setting meets it, there is no
    such mark.
    """
    trade = make_trade()
    # The other primitive is a text.
    (chart, _) = scene(trade, tolerance).primitives
    labels = [curve.label for curve in chart.curves]
    assert any("numpy s 64" in label for label in labels)
    tolerance_curves = [label for label in labels if label.startswith("tolerance")]
    assert len(tolerance_curves) == (0 if tolerance is None else 1)

    chosen = None if tolerance is None else trade.cheapest(tolerance)
    taken_marks = [mark for mark in chart.marks if mark.label == "taken"]
    assert len(taken_marks) == (0 if chosen is None else 1)

    # No mark is beyond the left or the upper edge of the chart, where it could not be seen.
    positions = np.array([mark.place for mark in chart.marks])
    assert np.all(positions[:, 0] > chart.x_range[0])
    assert np.all(positions[:, 1] < chart.y_range[1])


@pytest.mark.parametrize(
    "tolerance",
    [
        None,
        1e-5,
        pytest.param(1e-30, marks=pytest.mark.slow),
        pytest.param(1e5, marks=pytest.mark.slow),
    ],
)
def test_names_of_settings_in_the_figure_do_not_cover_each_other(tolerance):
    """All names lie within the frame; the first twelve, those of settings, are apart."""
    trade = make_trade()
    (chart, _) = scene(trade, tolerance).primitives
    (figure,) = plan_figures([scene(trade, tolerance)], {}).values()
    figure.draw_without_rendering()
    (panel,) = figure.axes
    frame = panel.get_window_extent()
    text_boxes = [text.get_window_extent() for text in panel.texts]
    assert len(text_boxes) == len(chart.marks)
    assert all(frame.overlaps(box) for box in text_boxes)
    for first, second in combinations(text_boxes[:12], 2):
        assert not first.overlaps(second)


@pytest.mark.parametrize("tolerance", [1e-30, 1e-20, 1e-5, 1e5])
def test_the_line_of_the_tolerance_is_within_the_frame_of_the_chart(tolerance):
    for trade in (make_trade(), replace(make_trade(), settings=())):
        (chart, _) = scene(trade, tolerance).primitives
        (line,) = [item for item in chart.curves if item.label.startswith("tolerance")]
        bottom, top = chart.y_range
        assert np.all((line.points[:, 1] > bottom) & (line.points[:, 1] < top))


def test_a_trade_without_settings_has_a_chart():
    trade = Trade("m", "poles", 9, 9, 9, "truth", 2e-16, 1, (), (), {})
    assert scene(trade).primitives


def test_output_paths_are_refused_before_anything_is_measured(tmp_path, capsys):
    """The command `trade` refuses paths that it cannot write before it measures anything.

    A million samples would take minutes, so a late refusal would be noticed. Nothing is
    written.
    """
    file = tmp_path / "file"
    file.write_text("mine")
    for flags, message in [
        (["-o", str(file)], "is a file, not a folder"),
        (["-o", str(file / "below")], "a part of the path is a file"),
        (["--save", str(tmp_path / "x.txt")], "named *.rrd"),
        (["--save", str(tmp_path / "no" / "x.rrd")], "does not exist"),
    ]:
        assert main(["trade", "four_bar", "--samples", "1000000", *flags]) == 1
        printed, error_text = capsys.readouterr()
        assert not printed
        assert message in error_text
    assert list(tmp_path.iterdir()) == [file]
    assert file.read_text() == "mine"


def test_the_heading_of_a_trade_of_one_sample_is_in_the_singular():
    heading = as_text(replace(make_trade(), samples=1, checked=1, rows=1)).splitlines()[0]
    assert "m, poles: 1 sample, " in heading
    assert "timed at 1 sample, 1 row compared with truth" in heading
