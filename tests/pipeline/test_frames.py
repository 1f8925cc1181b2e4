"""Frames of a recording: those of the library, one by one, lazily, and fused."""

import collections
import dataclasses
import gc
import threading
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.lidar import Poses
from jradar.model import condition, enhance, fuse, mixtures
from jradar.pipeline import Stages, detect_recording, enhance_recording, fusion
from jradar.pipeline.stages import Stopwatch
from jradar.radar import PointSpec, Radar, RadarSpec, calibrate, radar_points
from jradar.radar.points import points_and_count
from jradar.radar.spectrum import power_map
from jradar.range_image import condition_features, fit_trust
from jradar.recordings import Recording, Stream
from jradar.recordings.frame_checks import FRAMES
from tests.models import RADAR, SPEC, echoes, one_pass_model, tiny_model

CUBES = [np.asarray(echoes(seed)) for seed in range(2)]
MODEL = tiny_model()
FACTORS = np.exp(1j * np.linspace(0, 3, 12)) * np.linspace(0.5, 1.5, 12)
UNIT = Radar(RADAR, range_bias_m=0.1).with_factors(FACTORS)
DRAWING = {"draws": 2, "steps": 2}
STEP_M = 0.4  # that the radar moves ahead from frame to frame


def recording(count, *, radar=UNIT, read=lambda number: CUBES[number % 2]):
    """Frames at 10 Hz of a radar that moves along x, with its poses."""
    stamps = 0.1 * np.arange(count)
    times = np.arange(-1.0, 0.1 * count + 1, 0.1)
    xyz = np.stack([STEP_M * 10 * times, 0 * times, 0 * times], 1)
    poses = Poses(times, xyz, np.tile([0.0, 0, 0, 1], (len(times), 1)))
    cubes = Stream(read, count, stamps)
    mount = np.eye(4)
    place = {"poses": poses, "base_from_radar": mount}
    return Recording("walk", Path("walk"), radar, cubes, **place)


def workers():
    """Threads of executors that are alive."""
    return {t for t in threading.enumerate() if "ThreadPoolExecutor" in t.name}


@pytest.fixture(scope="module")
def stopped():
    """Two of 40 frames, the numbers that were read, and threads that are left."""
    before, numbers = workers(), []

    def read(number):
        numbers.append(number)
        return CUBES[number % 2]

    walk = recording(40, read=read)
    frames = enhance_recording(walk, MODEL, seed=3, **DRAWING)
    taken = [next(frames), next(frames)]
    times, warnings = frames.times, frames.warnings
    del frames  # which threads refer to until they have done what was begun
    end = time.monotonic() + 60
    while (left := workers() - before) and time.monotonic() < end:
        gc.collect()
        time.sleep(0.01)
    return taken, numbers, left, times, warnings


@pytest.mark.slow
def test_each_frame_is_what_enhance_gives_for_the_same_seed(stopped):
    for number, frame in enumerate(stopped[0]):
        keys = map(jax.random.key, (3, 4))
        cloud, other = (enhance(k, CUBES[number], UNIT, MODEL, **DRAWING) for k in keys)
        assert frame.number == number and frame.stamp_s == 0.1 * number
        np.testing.assert_array_equal(frame.cloud.valid, cloud.valid)
        np.testing.assert_allclose(frame.cloud.xyz, cloud.xyz, atol=1e-4)
        np.testing.assert_allclose(frame.cloud.velocity, cloud.velocity, atol=1e-4)
        assert not np.allclose(cloud.xyz, other.xyz, atol=1e-2)


def test_the_channels_and_the_bias_of_a_radar_are_applied_once(stopped):
    frame = stopped[0][0]
    expected = calibrate(CUBES[0], UNIT)
    np.testing.assert_allclose(frame.samples, expected, rtol=1e-5, atol=1e-3)
    points = MODEL.spec.points.fitted(RADAR)
    expected = radar_points(CUBES[0], UNIT, points=points)
    assert expected.valid.any()
    np.testing.assert_allclose(frame.points.xyz, expected.xyz, atol=1e-3)


def test_only_a_few_frames_are_read_ahead(stopped):
    checked = [0, *range(FRAMES)]  # samples first, then whether frames end as described
    numbers = stopped[1]
    assert numbers[: len(checked)] == checked
    numbers = numbers[len(checked) :]
    assert numbers == [*range(len(numbers))]
    assert 2 <= max(numbers) < 10


def test_no_thread_is_left_when_the_caller_stops_early(stopped):
    assert not stopped[2]


def test_every_stage_is_timed_and_warnings_are_about_the_frames_so_far(stopped):
    _, _, _, times, warnings = stopped
    assert {"reading", "points", "answer", "cloud", "compiling"} <= times.keys()
    assert min(times.values()) > 0
    assert not any("frame 2" in warning for warning in warnings)


def test_a_frame_is_processed_while_another_is_in_the_network(monkeypatch):
    begun, waited, seen = threading.Event(), [], collections.Counter()
    call = Stopwatch.__call__

    def spy(watch, stage, *rest):
        seen[stage] += 1
        if stage == "condition" and seen[stage] == 2:
            begun.set()
        if stage == "answer" and seen[stage] == 1:
            waited.append(begun.wait(60))
        return call(watch, stage, *rest)

    monkeypatch.setattr(Stopwatch, "__call__", spy)
    assert len([*enhance_recording(recording(2), MODEL, **DRAWING)]) == 2
    assert waited == [True]


def test_a_frame_that_cannot_be_read_ends_the_recording():
    def read(number):
        if number == 3:
            raise ValueError("frame 3 is damaged")
        return CUBES[number % 2]

    frames = enhance_recording(recording(5, read=read), MODEL, **DRAWING)
    with pytest.raises(ValueError, match="frame 3 is damaged"):
        assert max(frame.number for frame in frames) < 3


def test_detections_are_counted_by_cfar_not_by_capacity():
    few = dataclasses.replace(MODEL.spec.points, capacity=8)
    stages = Stages(jax.random.key(0), UNIT, None, points=few)
    observed = stages.observe(CUBES[0])
    _, cells = stages.detections(observed)
    points = PointSpec(false_alarm_rate=1e-3)
    (found,) = detect_recording(recording(1), points=points)
    assert int(observed.points.valid.sum()) == 8 < found.detected
    assert int(cells.sum()) == pytest.approx(found.detected, rel=0.3)


@pytest.mark.slow
def test_a_frame_unlike_training_is_not_to_be_trusted():
    usual = np.asarray(condition_features(condition(CUBES[0], UNIT, MODEL)))
    noise = np.random.default_rng(0).normal(scale=0.05, size=(60, len(usual)))
    for mean, strange in ((usual, False), (usual + 1.0, True)):
        model = MODEL.with_tables(trust=fit_trust(mean + noise))
        found = enhance_recording(recording(1), model, **DRAWING)
        (frame,) = found
        assert (frame.unlikeness == 1) == strange
        unlike = "frame 0 is unlike 99 % of"
        assert any(unlike in w for w in found.warnings) == strange


def test_points_are_the_librarys_and_what_they_lack_is_warned_of():
    points = PointSpec(capacity=3, train=(20, 4))
    found = detect_recording(recording(2), points=points)
    for number, frame in enumerate(found):
        fitted = points.fitted(RADAR)
        expected, count = points_and_count(CUBES[number], UNIT, points=fitted)
        np.testing.assert_allclose(frame.points.xyz, expected.xyz, atol=1e-3)
        assert frame.number == number and frame.stamp_s == 0.1 * number
        assert frame.detected == count > 3 == len(expected.valid)
        assert frame.dropped == count - 3 and not frame.empty
        power = power_map(calibrate(CUBES[number], UNIT))
        np.testing.assert_allclose(frame.power, power, rtol=1e-3, atol=1e-3)
    shrunk, dropped = found.warnings
    assert "shrunk to guard (0, 2), train (15, 4)" in shrunk
    assert "detections were dropped" in dropped


def test_stages_of_the_same_radar_and_model_compile_once():
    def compiled(radar, **drawing):
        return Stages(jax.random.key(0), radar, MODEL, **drawing)._ready(None)

    first = compiled(UNIT, **DRAWING)
    again = compiled(Radar(RADAR, range_bias_m=0.2).with_factors(FACTORS), **DRAWING)
    assert all(first[stage] is again[stage] for stage in first)
    assert compiled(UNIT, draws=3, steps=2)["answer"] is not first["answer"]


@pytest.mark.slow
def test_two_frames_are_fused_by_their_poses_without_what_moves(monkeypatch):
    model, moving = one_pass_model(), np.zeros(SPEC.grid.fine.shape, bool)
    moving[:, 20:] = True
    monkeypatch.setattr(fusion, "moving_pixels", lambda *_, **__: jnp.array(moving))
    frames = enhance_recording(recording(2), model, fuse=2)
    first, second = frames
    assert frames.motion == {"poses": 1}
    each = [mixtures(condition(cube, UNIT, model), model) for cube in CUBES[::-1]]

    def fused(count, step_m, *, marked=True):
        poses = np.stack([np.eye(4)] * count).astype("float32")
        poses[1:, 0, 3] = -step_m  # what the older frame saw is nearer now
        newest_first = jax.tree.map(lambda *x: jnp.stack(x), *each[-count:])
        movers = jnp.array([moving & marked] * count)
        return fuse(newest_first, jnp.array(poses), model, moving=movers)

    expected = fused(2, STEP_M)
    np.testing.assert_allclose(second.image.range_m, expected.range_m, atol=1e-3)
    confidence = second.image.confidence
    np.testing.assert_allclose(confidence, expected.confidence, atol=1e-4)
    for other in (fused(2, 0.0), fused(2, STEP_M, marked=False)):
        assert not np.allclose(other.confidence, confidence, atol=1e-3)
    alone = fused(1, 0.0, marked=False)
    np.testing.assert_allclose(first.image.range_m, alone.range_m, atol=1e-3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frames": range(1, 4)}, r"range\(1, 4\): walk has frames 0 to 2"),
        ({"frames": slice(3, None)}, "walk has frames 0 to 2"),
        (
            {"fuse": 2},
            "the model answers by diffusion, expected marginal",
        ),
        ({"least_confidence": 0.5, "draws": 1}, "this model has no confidence"),
    ],
)
def test_what_a_recording_or_a_model_does_not_have_is_refused(options, message):
    with pytest.raises(UsageError, match=message):
        enhance_recording(recording(3), MODEL, **options)


def test_a_radar_that_measures_one_angle_is_refused_before_anything_is_read():
    flat = Radar(RadarSpec.awr1642(num_chirps=32, num_samples=64))
    with pytest.raises(UsageError, match="no elevation.*awr1843.*--anyway"):
        enhance_recording(recording(3, radar=flat, read=pytest.fail), MODEL)
