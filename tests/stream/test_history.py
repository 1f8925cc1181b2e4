"""A live radar publishes the clouds of its recording, with the frames before each."""

import numpy as np

from jradar.pipeline import enhance_recording
from jradar.stream import Processor, quickest
from tests.models import one_pass_model, tiny_polar_model
from tests.pipeline.test_frames import CUBES as FRAMES, recording as walk
from tests.pipeline.test_polar import CUBES, MODEL, recording


def test_a_live_radar_publishes_the_same():
    assert quickest(MODEL) == {}
    (frame, _) = enhance_recording(recording(), MODEL)
    shown = Processor(recording(), model=MODEL).published(CUBES[0], 0, 0.0)
    np.testing.assert_array_equal(shown.clouds["enhanced"].valid, frame.cloud.valid)


def test_a_model_of_several_images_is_given_the_frames_before():
    model, stamps = tiny_polar_model(history=3), 0.05 * np.arange(2)
    (frame,) = enhance_recording(recording(stamps=stamps), model, frames=slice(1, 2))
    processor = Processor(recording(stamps=stamps), model=model)
    for number, cube in enumerate(CUBES):
        shown = processor.published(cube, number, 100 + 0.05 * number)
    found, expected = shown.clouds["enhanced"].confidence, frame.cloud.confidence
    np.testing.assert_allclose(found, expected, atol=2e-2)


def test_frames_of_a_live_radar_are_fused_as_those_of_a_recording():
    model = one_pass_model()
    expected = [*enhance_recording(walk(3), model, fuse=2)]
    processor = Processor(walk(3), model=model, fuse=2)
    processor.warm_up()  # leaves no trace
    for number, frame in enumerate(expected):
        cube = FRAMES[number % 2]
        shown = processor.published(cube, number, 0.1 * number).clouds["enhanced"]
        np.testing.assert_array_equal(shown.valid, frame.cloud.valid)
        np.testing.assert_allclose(shown.confidence, frame.cloud.confidence, atol=1e-5)
    assert processor.pipeline.motion == {"poses": 2}
