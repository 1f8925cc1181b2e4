"""Frames in the plane of one row of antennas: clouds, warnings, files, refusals."""

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.model import dense_cloud, draw
from jradar.model.grids.polar import (
    RADARHD,
    PolarImage,
    image_features,
    polar_image,
)
from jradar.outputs.frame_folder import FrameFolder
from jradar.outputs.guard import GuardedFolder
from jradar.pipeline import Pipeline, enhance_recording
from jradar.pipeline.history import LastImages
from jradar.radar import Radar, RadarSpec, calibrate
from jradar.range_image import ConfidenceTable, fit_trust
from jradar.recordings import Recording, Stream
from tests.models import tiny_polar_model
from tests.radar.targets import simulate, targets

MODEL = tiny_polar_model()
KEY = jax.random.key(0)
ROW = RadarSpec.awr1642(num_chirps=8, num_samples=64)
UNIT = Radar(ROW).with_factors(np.exp(1j * np.linspace(0, 3, 8)))
CUBES = [
    np.asarray(simulate(targets((3, 20 * k, 0, 0), (5, -9, 0, 0)), ROW))
    for k in range(2)
]


def recording(radar=UNIT, read=CUBES.__getitem__, stamps=None):
    count = 2 if stamps is None else len(stamps)
    return Recording("row", Path("row"), radar, Stream(read, count, stamps))


@pytest.fixture(scope="module")
def enhanced():
    found = enhance_recording(recording(), MODEL)
    return [*found], found


def test_a_frame_goes_from_samples_to_a_cloud_in_the_plane(enhanced):
    frames, _ = enhanced
    for frame, cube in zip(frames, CUBES, strict=True):
        seen = polar_image(calibrate(cube, UNIT), ROW)
        np.testing.assert_allclose(frame.image.radar, seen, atol=1.5 / 255)
        image = draw(KEY, frame.image.radar[..., None], MODEL)
        cloud = dense_cloud(image, frame.points, MODEL)
        np.testing.assert_allclose(frame.cloud.confidence, cloud.confidence, atol=1e-3)
        assert frame.cloud.valid.any() and not np.asarray(frame.cloud.xyz)[:, 2].any()
        assert frame.describe()["enhanced points"] == frame.cloud.valid.sum()


def test_what_is_not_measured_and_what_differs_is_said(enhanced):
    height, others, *_ = enhanced[1].warnings
    assert height == "height is not measured: all points lie at height 0"
    assert "range to 8." in others or "range bins of" in others
    assert "antennas in a row" not in others and "(radarhd)" in others


def test_an_image_unlike_training_is_warned_of(enhanced):
    usual = np.asarray(image_features(enhanced[0][0].image.radar))
    noise = np.random.default_rng(0).normal(scale=0.05, size=(60, len(usual)))
    for mean, strange in ((usual, False), (usual + 1.0, True)):
        model = MODEL.with_tables(trust=fit_trust(mean + noise))
        found = enhance_recording(recording(), model, frames=range(1))
        (frame,) = found
        assert (frame.unlikeness == 1) == strange
        unlike = "frame 0 is unlike 99 % of the training frames"
        assert any(unlike in w for w in found.warnings) == strange


def test_the_cloud_the_images_and_a_picture_are_written(enhanced, tmp_path):
    frames, found = enhanced
    guarded = GuardedFolder(tmp_path / "out", "enhance")
    clouds = "radar", "enhanced"
    folder = FrameFolder(guarded, clouds, range(1), pictured=True, radar=ROW)
    folder.write_enhanced(frames[0], found.recording, MODEL)
    with np.load(tmp_path / "out/enhanced.npz") as arrays:
        assert arrays["polar_image"].shape == (256, 64)
        points = arrays["occupancy"] > 0
        assert points.sum() == len(arrays["xyz"]) and not arrays["xyz"][:, 2].any()
        cloud = frames[0].cloud
        kept = np.asarray(cloud.confidence)[np.asarray(cloud.valid)]
        np.testing.assert_array_equal(arrays["confidence"], kept)
    assert (tmp_path / "out/capture.png").stat().st_size > 20_000


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"draws": 2}, "draws: a model of one pass draws no"),
        (
            {"fuse": 2},
            "the model answers by occupancy, expected marginal",
        ),
    ],
)
def test_options_of_other_models_are_refused(options, message):
    with pytest.raises(UsageError, match=message):
        enhance_recording(recording(), MODEL, **options)


def test_a_radar_without_azimuths_is_refused_before_anything_is_read():
    antennas = {"tx_positions": ((0, 0),), "rx_positions": ((0, 0), (0, 1))}
    column = dataclasses.replace(RADARHD, **antennas, tx_firing_order=())
    with pytest.raises(UsageError, match="no two antennas next to each other"):
        enhance_recording(recording(Radar(column), pytest.fail), MODEL)


def test_more_confident_points_are_fewer():
    (frame, _) = enhance_recording(recording(), MODEL, least_confidence=0.6)
    assert isinstance(frame.image, PolarImage)
    kept = np.asarray(frame.cloud.valid)
    assert kept.any() and np.asarray(frame.cloud.confidence)[kept].min() >= 0.6
    assert jax.tree.structure(MODEL) == jax.tree.structure(tiny_polar_model())


def test_the_radars_points_follow_the_pixels():
    table = ConfidenceTable.of((0.5, 0.5), least=0.5)
    model = MODEL.with_tables(echoes=table)
    (frame,) = enhance_recording(recording(), model, frames=range(1))
    (plain,) = enhance_recording(recording(), MODEL, frames=range(1))
    found = np.asarray(frame.points.valid).sum()
    assert frame.cloud.valid.sum() == plain.cloud.valid.sum() + 10 * found > 0
    np.testing.assert_array_equal(frame.pixels, plain.pixels)
    assert frame.confidence == plain.confidence  # of the pixels
    (sure,) = enhance_recording(
        recording(), model, frames=range(1), least_confidence=0.6
    )
    assert np.asarray(sure.cloud.valid).sum() == sure.pixels.sum()


def conditions(stamps, history):
    """Which frame stands at each place of the last one's condition."""
    images = LastImages(history)
    for number, stamp_s in enumerate(stamps):
        found = images.add(np.full((1, 1, history), float(number)), float(stamp_s))
    return found[0, 0].tolist()


def test_the_images_of_a_condition_are_those_of_training_or_the_nearest_in_time():
    assert conditions(0.05 * np.arange(9), 4) == [8, 7, 6, 5]
    assert conditions(0.05 * np.arange(2), 4) == [1, 0, 0, 0]
    assert conditions(0.1 * np.arange(9) + 1e-3 * np.arange(9), 5) == [8, 8, 7, 7, 6]
    assert conditions(0.025 * np.arange(9), 3) == [8, 6, 4]
    assert conditions([0, 0.05, 0.1, 5.0, 5.05], 4) == [4, 3, 3, 3]  # after a pause
    assert conditions([0, 0.2], 4) == [1, 1, 1, 1]  # longer than a condition
    assert conditions([7, 7.05, 1, 1.05], 4) == [3, 2, 2, 2]  # time was set back


@pytest.mark.parametrize("history", [4, 41])
def test_a_condition_is_the_same_wherever_one_starts(history):
    pipeline = Pipeline(
        recording(stamps=np.zeros(0)), tiny_polar_model(history=history)
    )
    for period_s in (0.02, 0.05, 0.06, 0.08, 0.1, 0.12):
        stamps = period_s * np.arange(120)
        pipeline.recording = recording(read=pytest.fail, stamps=stamps)
        for start in range(100, 120):
            lead = pipeline.before(range(start, 120))
            found = conditions(stamps[lead.start : start + 1], history)
            whole = conditions(stamps[: start + 1], history)
            assert [lead.start + k for k in found] == whole


@pytest.mark.slow
def test_a_model_of_several_images_is_given_the_frames_before():
    model = tiny_polar_model(history=3)
    cubes, stamps = [*CUBES, CUBES[0]], 0.05 * np.arange(3)
    walk = recording(read=cubes.__getitem__, stamps=stamps)
    (frame,) = enhance_recording(walk, model, frames=slice(2, 3))
    seen = [polar_image(calibrate(cube, UNIT), ROW) for cube in cubes]
    image = draw(KEY, jnp.stack(seen[::-1], -1), model)
    np.testing.assert_allclose(frame.image.confidence, image.confidence, atol=2e-2)


@pytest.mark.parametrize(
    ("stamps", "message"),
    [
        (None, "row has 2 frames and no known time between them.*such as radarhd"),
        (np.arange(2.0), "a frame every 1 s, expected at most 0.125 s"),
    ],
)
def test_frames_without_times_or_too_far_apart_are_refused(stamps, message):
    with pytest.raises(UsageError, match=message):
        enhance_recording(recording(stamps=stamps), tiny_polar_model(history=3))
