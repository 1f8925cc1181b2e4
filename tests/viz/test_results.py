"""Figures of results: curves end where they should, clouds share a view."""

import json

import numpy as np
import pytest

from jradar.viz import learning_curve_figure
from jradar.viz.results import clouds_figure, error_curves_figure

RNG = np.random.default_rng(0)


def test_error_curves_count_frames():
    nan = float("nan")
    errors = {
        "Hall": {"OS-CFAR": [4.0, nan, 1.0, 2.0], "jradar": [0.5, 0.5, 1.0, 0.1]},
        "Mine": {"jradar": [0.2, 0.3]},
        "Nowhere": {"OS-CFAR": [nan] * 3},
    }
    figure = error_curves_figure(errors)
    hall, mine, nowhere = figure.axes
    assert [*nowhere.lines[0].get_ydata()] == [0] and nowhere.get_xlim()[1] > 0
    baseline, ours = hall.lines
    assert [*baseline.get_xdata()[:4]] == [0, 1, 2, 4]
    heights = [*baseline.get_ydata()]
    assert heights == [0, 0.25, 0.5, 0.75, 0.75]  # one frame found nothing
    assert ours.get_ydata()[-1] == 1 and ours.get_linewidth() > baseline.get_linewidth()
    assert mine.lines[0].get_color() == ours.get_color() != baseline.get_color()
    assert [t.get_text() for t in figure.legends[0].texts] == ["OS-CFAR", "jradar"]
    assert 4 <= hall.get_xlim()[1] < 5
    with pytest.raises(ValueError, match="no scenes"):
        error_curves_figure({})


def test_clouds_of_a_row_share_view_limits_and_colours():
    truth = RNG.uniform([0, -3, -1], [9, 3, 2], size=(4000, 3))
    scenes = {
        "Hall": {"OS-CFAR": truth[:50], "jradar": truth[:3500], "LiDAR": truth},
        "Mine": {"jradar": truth[:0], "LiDAR": truth * 0.5},
    }
    figure = clouds_figure(scenes, enlarged=["OS-CFAR"])
    panels = [axes for axes in figure.axes if hasattr(axes, "get_zlim")]
    assert len(panels) == 6
    assert [axes.get_title() for axes in panels[:3]] == ["OS-CFAR", "jradar", "LiDAR"]
    for row in (panels[:3], panels[3:]):
        assert len({(a.get_xlim(), a.get_ylim(), a.get_zlim()) for a in row}) == 1
        assert len({(a.elev, a.azim) for a in row}) == 1
        assert len({a.collections[0].get_clim() for a in row}) == 1
    sizes = [np.sqrt(axes.collections[0].get_sizes()[0]) for axes in panels[:3]]
    plain = clouds_figure(scenes).axes[0].collections[0].get_sizes()[0]
    assert sizes[0] == pytest.approx(2 * np.sqrt(plain))
    cloud = panels[2].collections[0]
    assert cloud.get_cmap()(1.0)[0] > 0.4 > cloud.get_cmap()(1.0)[2]  # red is high
    inside = [len(axes.collections[0].get_offsets()) for axes in panels[:3]]
    assert inside[0] == 50 and inside[1] >= 3400 and inside[2] >= 3900
    assert len(panels[4].collections[0].get_offsets()) == 0
    sure = np.hstack([truth, np.full((4000, 1), 100.0)])  # would widen the limits
    (axes, *_) = clouds_figure({"Hall": {"LiDAR": sure}}).axes
    again = axes.collections[0]
    np.testing.assert_array_equal(again.get_offsets(), cloud.get_offsets())
    np.testing.assert_array_equal(again.get_array(), cloud.get_array())
    with pytest.raises(ValueError, match="no clouds"):
        clouds_figure({})


def test_learning_curve(tmp_path):
    path = tmp_path / "metrics.jsonl"
    loss = np.exp(-np.arange(300) / 100) + 0.01
    lines = [
        json.dumps({"step": i, "gradient_norm": 1.0, "loss": float(value)})
        for i, value in enumerate(loss)
    ]
    path.write_text("\n".join(lines) + '\n{"step": 300, "lo')  # a run in progress
    figure = learning_curve_figure(path)
    first, second = figure.axes
    assert (first.get_title(), second.get_title()) == ("loss", "gradient norm")
    faint, smooth = first.lines
    np.testing.assert_allclose(faint.get_ydata(), loss)
    assert smooth.get_xdata()[0] == 29  # a tenth of the steps
    np.testing.assert_allclose(smooth.get_ydata()[0], loss[:30].mean())
    both = (
        '{"step": 0, "loss": 1, "chamfer": null}\n{"step": 1, "loss": 1, "chamfer": 2}'
    )
    path.write_text(both)
    loss, chamfer = learning_curve_figure(path).axes
    assert [*loss.lines[0].get_xdata()] == [0, 1]
    alone = chamfer.lines[1]
    assert [*alone.get_xdata()] == [1] and alone.get_marker() == "o"


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "holds no steps"),
        ('{"loss": 1}\n{"step": 1, "loss": 1}\n', "line 1: KeyError"),
        ('{"step": 0, "loss": "x"}\n{"step": 1, "loss": 1}\n', "line 1: ValueError"),
        (f'{{"step": {10**400}}}\n{{"step": 1}}\n', "line 1: OverflowError"),
        ("[" * 100_000 + '\n{"step": 1}\n', "line 1: RecursionError"),
    ],
)
def test_metrics_that_cannot_be_read(tmp_path, text, message):
    (tmp_path / "metrics.jsonl").write_text(text)
    with pytest.raises(ValueError, match=message):
        learning_curve_figure(tmp_path / "metrics.jsonl")
