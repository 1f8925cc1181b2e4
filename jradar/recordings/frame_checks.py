"""Checks whether frames begin and end where the radar's did.

A capture holds chirps without a mark between frames, so a description with another
number of chirps cuts them elsewhere, and nothing else looks wrong:

    sent        |········|········|········|········
    described   |················|················        an echo jumps inside a frame
    or          |····|····|····|····|····|····|····|····  and goes on into another one

Between frames the radar pauses, while targets move on, and its first chirp may differ.
Chirps within a frame follow one another steadily.
"""

import contextlib
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Inexact

from jradar.recordings.recording import Recording

LEAST_CHIRPS = 4  # of a frame
FRAMES, CHIRPS = 17, 1024  # at most, that are looked at
LEAST_JUMPS = 3  # the same number of chirps apart
# Where a real radar paused, chirps differed 300 times as much as elsewhere. Where a
# simulated one walks, they may differ twice as much.
JUMP, STEADY = 1.5, 1.1


def frame_warnings(recording: Recording, frame: int) -> Iterator[str]:
    """Yield a warning if the frames hold another number of chirps than described."""
    chirps = recording.radar.spec.num_chirps
    count = max(min(FRAMES, CHIRPS // chirps), 2)
    first = max(0, min(frame, len(recording.cubes) - count))
    frames = range(first, min(first + count, len(recording.cubes)))
    if chirps < LEAST_CHIRPS:
        return
    cubes = []
    with contextlib.suppress(ValueError, OSError):  # of a frame that nobody asked for
        for k in frames:
            cubes.append(recording.cubes[k][:1])  # of one transmitter
    if sum(cube.shape[2] for cube in cubes) <= LEAST_JUMPS * LEAST_CHIRPS:
        return
    steps = changes(np.concatenate(cubes, 2))
    if sent := chirps_of_frames(steps, chirps, start=first * chirps):
        yield (
            f"the echoes jump after every {sent} chirps of a transmitter, as from "
            f"frame to frame, and not after {chirps} as described: velocities and "
            f"times are wrong; describe the radar with {sent} chirps per frame "
            "(num_chirps, or the loops in frameCfg)"
        )


def changes(cube: Inexact[np.ndarray, "tx rx chirp sample"]) -> Float[np.ndarray, " s"]:
    """Return how much each chirp differs from the one before, 1 being usual.

    What all echoes of a range bin turn from chirp to chirp is taken away.
    """
    spectra = np.fft.fft(cube * np.hanning(cube.shape[-1]))[..., 2:]
    late, early = spectra[:, :, 1:], spectra[:, :, :-1]
    turn = np.exp(1j * np.angle((late * early.conj()).sum((0, 1, 2))))
    power = (np.abs(late - early * turn) ** 2).sum((0, 1))
    usual = np.median(power, 0)
    seen = usual > 0
    if not seen.any():
        return np.ones(len(power))
    return (power[:, seen] / usual[seen]).mean(-1)


def chirps_of_frames(
    steps: Float[np.ndarray, " step"], described: int, *, start: int = 0
) -> int:
    """Return after how many chirps the echoes jump; 0 if they do not, or as described.

    `start` is the number of the first chirp; chirp 0 begins a frame.
    """
    number = start + 1 + np.arange(len(steps))  # of the chirp after each step
    candidates = [described, *range(LEAST_CHIRPS, len(steps) // LEAST_JUMPS + 1)]
    for chirps in candidates:
        jumps = number % chirps == 0
        # The first chirp after a pause may differ from the second, too.
        rest = steps[~jumps & (number % chirps != 1)]
        if jumps.sum() < LEAST_JUMPS or not rest.size:
            continue
        seen, others = steps[jumps], rest.max()
        if seen.min() > others and np.median(seen) > JUMP * others:
            inside = steps[(number % described != 0) & (number % described != 1)]
            between = steps[~jumps & (number % described == 0)]
            if chirps % described or between.max(initial=0) < STEADY * inside.max():
                return 0 if chirps == described else chirps
    return 0
