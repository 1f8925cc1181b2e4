"""A live radar with a planar model publishes the clouds of its recording."""

import numpy as np
from jradar.pipeline import enhance_recording

from jradar.stream import Processor, quickest
from tests.models import tiny_polar_model
from tests.pipeline.test_planar import CUBES, MODEL, recording


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
