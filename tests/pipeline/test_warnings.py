"""Warnings about a radar that a model did not see in training, and about clouds."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from jradar.model import load_model
from jradar.pipeline import Frame
from jradar.pipeline.warnings import Tally, of_model, strange_from
from jradar.radar import Radar
from jradar.types import PointCloud
from tests.models import tiny_model, tiny_polar_model


@pytest.fixture(scope="module")
def card():
    return load_model("jradar-sim").card


def of_radar(card, radar):
    """Warnings about a radar, of a model with this card."""
    return of_model(tiny_model(card=card), radar)


def of_frames(frames, radar):
    """Warnings about frames."""
    tally = Tally()
    for each in frames:
        tally.add(each)
    return tally.warnings(radar)


def frame(number, confidence=0.7, unlikeness=0.5, points=3, kept=2):
    """A frame of which warnings look at these numbers."""
    seen, cloud = (
        PointCloud(jnp.ones((4, 3)), np.arange(4) < count) for count in (points, kept)
    )
    fields = dict.fromkeys(Frame._fields)
    fields |= {"number": number, "points": seen, "confidence": confidence}
    fields |= {"cloud": cloud}
    return Frame(**fields | {"unlikeness": unlikeness})


def test_every_radar_of_the_training_is_known(card):
    assert len(card.radars) >= 7
    assert all([*of_radar(card, radar)] == [] for radar in card.radars)


def test_a_waveform_between_those_of_the_training_is_not_warned_of(card):
    slower = dataclasses.replace(card.radar, slope_hz_per_s=1.1e14)
    assert [*of_radar(card, slower)] == []
    alone = dataclasses.replace(card, radars=card.radars[:1])
    [text] = of_radar(alone, slower)
    assert "range bins of 0.114 m here, 0.125 in training" in text


def test_a_waveform_beyond_the_training_is_named_with_what_was_seen(card):
    coarse = dataclasses.replace(card.radar, slope_hz_per_s=2e13)
    [text] = of_radar(card, coarse)
    assert "range bins of 0.625 m here, 0.0439 to 0.125 in training" in text


@pytest.mark.parametrize("model", [tiny_polar_model(), tiny_model()])
def test_less_makes_a_frame_of_an_unknown_radar_strange(model):
    known = model.card.radar
    other = dataclasses.replace(known, slope_hz_per_s=known.slope_hz_per_s / 3)
    assert strange_from(model, known) == strange_from(model, None) == 0.99
    tally = Tally(strange_from(model, other))
    tally.add(frame(0, unlikeness=0.79))
    assert [*tally.warnings(None)] == []
    tally.add(frame(1, unlikeness=0.82))
    [text] = tally.warnings(None)
    assert text.startswith("frame 1 of 2 is unlike 80 % of the training frames, and")


def test_an_unsure_cloud_of_an_uncalibrated_radar_names_the_fix(card):
    frames = [frame(3, confidence=0.31), frame(4)]
    plain = Radar(card.radar)
    [known] = of_frames(frames, plain.with_factors(np.ones(12)))
    [unknown] = of_frames(frames, plain)
    assert "do not trust frame 3 of 2:" in known and "calibrate" not in known
    assert "jradar calibrate --level" in unknown
    assert [*of_frames(frames[1:], plain)] == []


def test_strange_and_empty_frames_are_named(card):
    frames = [frame(0, unlikeness=0.995), frame(1, points=0), frame(2, confidence=None)]
    empty, strange = of_frames(frames, Radar(card.radar))
    assert "no echoes in frame 1:" in empty
    assert "frame 0 of 3 is unlike 99 % of the training frames" in strange


def test_a_cloud_without_a_sure_point_is_named_once_the_radar_saw_something(card):
    frames = [frame(0, kept=0), frame(1), frame(2, points=0, kept=0)]
    empty, bare = of_frames(frames, Radar(card.radar))
    assert "no echoes in frame 2:" in empty
    assert bare.startswith("no point of frame 0 of 3 is sure enough")
