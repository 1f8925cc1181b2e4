"""Makes dense clouds of a recording's frames one by one, as `jradar enhance` does.

    for frame in enhance_recording(recording, model, fuse=3):
        frame.cloud, frame.warnings, frame.times

Four threads work on consecutive frames: one reads, one finds the radar points, one runs
the network, and the caller uses the finished frame. If there are enough cores, a
recording takes as long as its slowest thread.
"""

import collections
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Unpack

from jradar.errors import UsageError
from jradar.model import Model
from jradar.options.drawing import Drawing
from jradar.pipeline.history import frame_times
from jradar.pipeline.pipeline import Frame, Pipeline, without_interference
from jradar.recordings import Recording, need_samples, with_sample_warnings

AHEAD = 2  # frames that wait between two threads


class Enhancement(Iterator[Frame]):
    """An iterator over a recording's frames, with times and warnings of all so far."""

    def __init__(self, pipeline: Pipeline, frames: range):
        """`enhance_recording` makes one."""
        self.recording = with_sample_warnings(pipeline.recording, frames[0])
        self.model = pipeline.model
        self.frames, self.watch = frames, pipeline.watch
        self._pipeline, self._times = pipeline, frame_times(pipeline.recording)
        self._iterator = self._run(pipeline.before(frames))

    def __next__(self) -> Frame:
        """Return the next frame."""
        return next(self._iterator)

    @property
    def times(self) -> dict[str, float]:
        """Median seconds of each stage, and the time to compile."""
        return self._pipeline.times

    @property
    def motion(self) -> dict[str, int]:
        """The number of steps between fused frames that each source of motion gave."""
        return self._pipeline.motion

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the radar and the frames so far."""
        return tuple(self._pipeline.warnings)

    def _run(self, lead: range) -> Iterator[Frame]:
        """Yield the frames; those of `lead` are processed before them, not yielded."""
        pipeline = self._pipeline

        def read(number):
            read_one = self.recording.frames.__getitem__
            return number, self.watch("reading", read_one, number)

        def observe(frame):
            number, measured = frame
            observed = pipeline.observe(number, measured, self._time(number))
            return number, observed, pipeline.detections(observed)

        def answer(frame):
            number, observed, detections = frame
            image = pipeline.answer(number, observed, self._time(number))
            cloud = pipeline.cloud(image, observed)
            return number, detections, (observed, image, cloud)

        with (
            ThreadPoolExecutor(1) as reader,
            ThreadPoolExecutor(1) as processor,
            ThreadPoolExecutor(1) as network,
        ):
            measured = ahead(reader, read, (*lead, *self.frames))
            observed = ahead(processor, observe, measured)
            for number, detections, found in ahead(network, answer, observed):
                if number not in lead:
                    stamp = stamp_s(self.recording, number)
                    yield pipeline.judge(number, stamp, *found, detections=detections)

    def _time(self, number: int) -> float | None:
        """Return the time of a frame, from the frame period if it has no stamp."""
        return None if self._times is None else float(self._times[number])


def enhance_recording(
    recording: Recording,
    model: Model,
    *,
    frames: slice | range = slice(None),
    seed: int = 0,
    fuse: int = 1,
    history_s: float = 0.0,
    remove_interference: bool | None = None,
    anyway: bool = False,
    **drawing: Unpack[Drawing],
) -> Enhancement:
    """Return an iterator over the enhanced `frames` of a recording; host.

    `fuse` is the number of last frames that are fused, or `history_s` the seconds whose
    points are joined, by the recorded poses or by the radar's own velocity.
    `remove_interference` is that of `PointSpec`, by default the
    model's, and the options of drawing are those of `draw`. Every frame draws with the
    key of `seed`. `anyway` enhances a radar that does not measure the angles that the
    model needs. Raises UsageError for frames that the recording lacks, for such a
    radar, and for options that the model does not take.
    """
    chosen = chosen_frames(recording, frames)
    if remove_interference:
        need_samples(recording)
    model = without_interference(model, remove_interference)
    earlier = {"fuse": fuse, "history_s": history_s}
    options = {"seed": seed, "anyway": anyway, **earlier, **drawing}
    return Enhancement(Pipeline(recording, model, **options), chosen)


def chosen_frames(recording: Recording, frames: slice | range) -> range:
    """Return the numbers of `frames`; UsageError if the recording lacks some."""
    count = len(recording.frames)
    chosen = range(*frames.indices(count)) if isinstance(frames, slice) else frames
    if not chosen or chosen.start < 0 or chosen.stop > count:
        raise UsageError(
            f"frames = {frames}: {recording.path} has frames 0 to {count - 1}"
        )
    return chosen


def stamp_s(recording: Recording, frame: int) -> float | None:
    """Return the time of a frame, None if the recording has no times."""
    stamps = recording.frames.stamps
    return None if stamps is None else float(stamps[frame])


def ahead(threads: ThreadPoolExecutor, call: Callable, items: Iterable) -> Iterator:
    """Yield `call(item)` in order; a thread works on the next items meanwhile."""
    waiting: collections.deque[Future] = collections.deque()
    try:
        for item in items:
            waiting.append(threads.submit(call, item))
            if len(waiting) > AHEAD:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for future in waiting:
            future.cancel()
