"""Intervals hold their promise on correlated series; tests keep their level."""

import numpy as np
import pytest
from scipy.stats import wilcoxon

from jradar.evaluation.statistics import compare_methods, compare_paired, mean_interval
from tests.evaluation import invented


def autoregressive(rng, length, correlation, *, mean=0.0):
    """Stationary AR(1) of unit variance."""
    noise = rng.normal(size=length) * np.sqrt(1 - correlation**2)
    series = np.empty(length)
    series[0] = rng.normal()
    for i in range(1, length):
        series[i] = correlation * series[i - 1] + noise[i]
    return series + mean


@pytest.mark.parametrize("lengths", [(400,), (150, 150, 100)], ids=str)
@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_95_of_100_intervals_cover_the_mean(correlation, lengths):
    rng = np.random.default_rng(1)
    found = [
        mean_interval([autoregressive(rng, n, correlation, mean=2.0) for n in lengths])
        for _ in range(300)
    ]
    known = [x for x in found if np.isfinite(x.low)]
    covered = np.mean([x.low <= 2.0 <= x.high for x in known])
    assert len(known) > 250 and abs(covered - 0.95) < 3 * np.sqrt(0.95 * 0.05 / 300)


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_effective_frames_of_an_autoregressive_series(correlation):
    rng = np.random.default_rng(2)
    found = mean_interval([autoregressive(rng, 100_000, correlation)])
    expected = 100_000 * (1 - correlation) / (1 + correlation)
    assert found.effective == pytest.approx(expected, rel=0.1)
    assert found.frames == 100_000


def test_the_interval_of_independent_frames_is_students():
    values = np.random.default_rng(3).normal(size=2000)
    found = mean_interval([values])
    half = (found.high - found.low) / 2
    assert half == pytest.approx(1.96 * values.std() / 2000**0.5, rel=0.1)


def test_sequences_that_differ_more_than_their_frames_are_what_counts():
    rng = np.random.default_rng(4)
    levels = [1.0, 2.0, 3.0, 4.0]
    found = mean_interval([level + 1e-3 * rng.normal(size=50) for level in levels])
    assert found.effective == pytest.approx(4, rel=0.05)
    one_each = mean_interval([levels])
    assert found.mean == pytest.approx(2.5, abs=1e-3)
    assert found.high - found.low > 0.8 * (one_each.high - one_each.low)


def test_two_or_three_blocks_have_no_interval():
    rng = np.random.default_rng(5)
    levels = [1.0, 2.0, 3.0, 4.0]
    blocks = [level + 1e-3 * rng.normal(size=50) for level in levels]
    for count, known in ((2, False), (3, False), (4, True)):
        for series in (blocks[:count], [levels[:count]]):
            found = mean_interval(series)
            assert np.isfinite([found.low, found.high]).all() == known
            assert found.mean == pytest.approx(np.mean(levels[:count]), abs=1e-3)


def test_interval_test_and_effective_frames_agree_on_what_is_too_little():
    rng = np.random.default_rng(9)
    series = [rng.normal(1.0, size=50) for _ in range(200)]
    both = [compare_paired([one], [np.zeros(50)]) for one in series]
    known = np.array([np.isfinite(found.difference.low) for found in both])
    assert 0.7 < known.mean() < 1
    for one, found, is_known in zip(series, both, known, strict=True):
        assert found.difference == pytest.approx(mean_interval([one]), nan_ok=True)
        assert np.isfinite(found.t_test) == is_known
        assert (found.difference.effective >= 4) == is_known


@pytest.mark.parametrize("most", [1.0, 50.0, np.inf])
def test_intervals_of_scores_stay_where_scores_are(most):
    values = min(most, 50) * np.array([0.01, 0.01, 0.02, 0.9])
    wide, found = mean_interval([values]), mean_interval([values], most=most)
    assert wide.low < 0 < found.low < found.mean < found.high < most
    narrow = min(most, 50) * np.random.default_rng(6).normal(0.5, 0.01, 2000)
    straight, bent = mean_interval([narrow]), mean_interval([narrow], most=most)
    assert bent.low == pytest.approx(straight.low, rel=1e-5)
    assert bent.high == pytest.approx(straight.high, rel=1e-5)
    if most < np.inf:  # what is missing to the most has the mirrored interval
        other = mean_interval([most - values], most=most)
        assert other.low == pytest.approx(most - found.high)
    assert mean_interval([[0.0] * 9], most=most)[:3] == (0, 0, 0)


def test_constant_series_and_missing_values():
    assert mean_interval([[0.1] * 30]) == (0.1, 0.1, 0.1, 30, 30.0)
    nan = float("nan")
    found = mean_interval([[1.0, nan, 3.0, nan], [nan], [2.0], [1.0], [3.0], []])
    assert found.mean == 2 and found.frames == 5 and found.low < 1.5
    for few in ([], [[nan]], [[1.0, nan]]):
        found = mean_interval(few)
        assert np.isnan(found.low) and np.isnan(found.high) and found.frames < 2


def test_gaps_keep_their_place_in_time():
    rng = np.random.default_rng(6)
    series = autoregressive(rng, 20_000, 0.9)
    full = mean_interval([series])
    series[rng.random(20_000) < 0.5] = np.nan
    half = mean_interval([series])
    assert half.high - half.low == pytest.approx(full.high - full.low, rel=0.25)
    assert half.effective < 0.2 * half.frames


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_methods_that_are_alike_are_seldom_told_apart(correlation):
    rng, runs = np.random.default_rng(7), 200
    rejected = np.zeros(2)
    for _ in range(runs):
        first, second = (
            [autoregressive(rng, 150, correlation) for _ in range(2)] for _ in range(2)
        )
        found = compare_paired(first, second)
        naive = wilcoxon(np.concatenate(first) - np.concatenate(second)).pvalue
        rejected += np.array([found.t_test, naive]) <= 0.05
    t_test, naive = rejected / runs
    assert t_test < 0.1
    assert naive < 0.1 if correlation == 0 else naive > 0.4


def test_a_difference_is_found_though_frames_differ_more():
    rng = np.random.default_rng(8)
    hard = [10 * autoregressive(rng, 200, 0.95) for _ in range(2)]
    noise = [autoregressive(rng, 200, 0.5) for _ in range(2)]
    better = [h + 0.5 + n for h, n in zip(hard, noise, strict=True)]
    found = compare_paired(better, hard)
    assert found.difference.low > 0 and found.difference.low < 0.5
    assert found.t_test < 0.01
    swapped = compare_paired(hard, better)
    assert swapped.difference.mean == -found.difference.mean


def test_equal_runs_do_not_differ():
    found = compare_paired([[1.0, 2.0, 3.0, 4.0]], [[1.0, 2.0, 3.0, 4.0]])
    assert found.difference.mean == 0 and found.t_test == 1


def test_rows_are_matched_by_frame():
    rows = invented.scores()
    ours, theirs = (
        [r for r in rows if r["method"] == name] for name in ("jradar", "RPDNet")
    )
    whole = compare_methods(ours, theirs, score="chamfer")
    assert whole.difference.high < 0 and whole.difference.frames == len(ours)
    theirs[3] = invented.row("Hallways", "run3", 3, "LiDAR", "RPDNet", 1, points=0)
    part = compare_methods(ours[::-1], theirs[:-5], score="chamfer")
    assert part.difference.frames == len(ours) - 6
    expected = [
        a["chamfer"] - b["chamfer"] for a, b in zip(ours, theirs[:-5], strict=False)
    ]
    assert part.difference.mean == pytest.approx(np.nanmean(expected))


def test_what_cannot_be_compared():
    rows = invented.scores()
    ours = [row for row in rows if row["method"] == "jradar"]
    with pytest.raises(ValueError, match=r"methods \['OS-CFAR', 'RPDNet', 'jradar'\]"):
        compare_methods(rows, ours, score="chamfer")
    with pytest.raises(ValueError, match="truths"):
        both = [*ours, ours[0] | {"truth": "re-projected"}]
        compare_methods(ours, both, score="chamfer")
    with pytest.raises(ValueError, match="no frame in common"):
        other = [row | {"sequence": "run9"} for row in ours]
        compare_methods(ours, other, score="chamfer")
    with pytest.raises(ValueError, match=r"of \[3\] and of \[2\] frames"):
        compare_paired([[1.0, 2.0, 3.0]], [[1.0, 2.0]])
