"""Confidence of a trained model: fitted to validation frames, with a threshold."""

import numpy as np

from experiments.confidence import Judged, least_confidence


def frame(wrong_from):
    """Points on a line, of which those above a confidence are right."""
    truth = np.stack([np.arange(0.0, 100.0, 0.5)] + [np.zeros(200)] * 2, -1)
    confidence = np.linspace(0, 1, 200)
    away = np.where(confidence < wrong_from, 30.0, 0.0)
    xyz = truth + np.stack([0 * away, away, 0 * away], -1)
    return Judged(xyz, confidence, away == 0, truth)


def test_wrong_points_are_cut_off_and_right_ones_kept():
    assert 0.3 <= least_confidence([frame(0.32)]) <= 0.35
    assert least_confidence([frame(0.0)]) == 0.05
    between = least_confidence([frame(0.2), frame(0.5)])
    assert 0.2 <= between <= 0.5
