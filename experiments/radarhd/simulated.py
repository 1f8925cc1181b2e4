r"""Pairs as RadarHD's, made by the simulator: thousands of other rooms to train on.

    python -m experiments.radarhd.simulated pairs.npz --layouts 2000

Each layout is a scene of its own, seen by a unit of its own (board, height, clutter)
with RadarHD's chirp, three seconds apart. The packed file has the form that `pairs`
reads; a layout is a trajectory. Both images are formed as RadarHD forms its own (its
folder create_dataset/):

    radar     one chirp of the 8 antennas in a row, Fourier transforms over samples and
              antennas without a window; amplitudes of at least 5 % of the largest, from
              the seventh range bin on and within 70 degrees, in dB from the smallest to
              the largest
    LiDAR     returns in front, within 10 m to the front and the sides and 0.3 m above
              and below the sensor
    cell      the first grid value that is not below a point's range or azimuth; of
              several amplitudes in a cell the largest

The simulator's walls are smoother than RadarHD's, whose images no single echo rules. So
each layout draws the strength of its diffuse echoes and its threshold: about as many
pixels remain as in real images. A layout takes half a second on one core.
"""

import dataclasses
import sys
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Complex, Float, UInt8

from experiments.radarhd.pairs import LIDAR, MAX_RANGE_M, RADAR, PolarGrid
from jradar.lidar import transform
from jradar.progress import progress
from jradar.radar import RadarSpec
from jradar.simulation import draw_unit, lidar_scans, make_setting, radar_frames
from jradar.simulation.hardware.hardware import make_unit_hardware
from jradar.simulation.rig import base_from
from jradar.simulation.sequence import Setting

OFFSET_M = 0.17  # by which RadarHD's radar images lie behind its LiDAR's
# RadarHD's waveform (its radarhd_config.xml); its images use one chirp of each antenna.
CHIP = RadarSpec.awr1843(
    start_frequency_hz=77e9,
    slope_hz_per_s=63.343e12,
    sample_rate_hz=9.121e6,
    num_samples=512,
    num_chirps=1,
    idle_time_s=10e-6,
    adc_start_time_s=6e-6,
    ramp_end_time_s=63.14e-6,
)
RANGE_STEP_M = 21.59 / 511  # of RadarHD's range bins
NEAREST_BIN, NUM_BEAMS = 6, 64
THRESHOLD = 0.05  # of the largest amplitude
THRESHOLDS, CLUTTER_COUNTS = (0.008, 0.04), (2.0, 24.0)  # of layouts
VIEW = np.deg2rad(70.0)  # to either side, of the radar
REACH_M, HALF_HEIGHT_M = 10.0, 0.3  # of the LiDAR's slice
FAMILIES = ("home", "lab", "hall", "hallways", "corridor")
MOMENTS_S = np.array([0.0, 3.0, 6.0])


def radar_image(
    cube: Complex[np.ndarray, "tx rx chirp sample"], *, threshold: float = THRESHOLD
) -> UInt8[np.ndarray, "range radar_azimuth"]:
    """Return RadarHD's radar image of the first chirp of a frame of `CHIP`."""
    amplitude = beams(cube)
    strong = amplitude >= threshold * amplitude[:, NEAREST_BIN:].max()
    strong[:, :NEAREST_BIN] = False
    beam, bin_ = np.nonzero(strong)
    # RadarHD spreads its beams over both ends of the sines, and so do its images.
    azimuth = np.arcsin(np.linspace(-1, 1, NUM_BEAMS))[beam]
    range_m = RANGE_STEP_M * bin_
    kept = in_front(range_m * np.cos(azimuth), range_m * np.sin(azimuth))
    kept &= (np.abs(azimuth) <= VIEW) & (range_m <= MAX_RANGE_M)
    image = np.zeros(RADAR.shape, np.uint8)
    if kept.any():
        level = np.log(amplitude[beam, bin_][kept])
        level -= level.min()
        grey = (255 * level / max(level.max(), 1e-9)).astype(np.uint8)
        np.maximum.at(image, cells(range_m[kept], azimuth[kept], RADAR), grey)
    return image


def beams(
    cube: Complex[np.ndarray, "tx rx chirp sample"],
) -> Float[np.ndarray, "beam range"]:
    """Return amplitudes in RadarHD's range bins and beams, from right to left.

    They are those of the first chirp, at the antennas of the row z = 0.
    """
    column, height = CHIP.virtual_positions.T
    level = np.flatnonzero(height == 0)
    row = cube[:, :, 0].reshape(CHIP.num_virtual, -1)[level[np.argsort(column[level])]]
    spectrum = np.fft.fft(np.fft.fft(row), NUM_BEAMS, axis=0)
    return np.abs(np.fft.fftshift(spectrum, axes=0))


def lidar_image(
    points: Float[np.ndarray, "point 3"],
) -> Bool[np.ndarray, "range azimuth"]:
    """Return the occupied cells of the horizontal slice of a scan, x forward."""
    x, y, z = points.T
    range_m = np.linalg.norm(points, axis=1)
    kept = in_front(x, y) & (np.abs(z) <= HALF_HEIGHT_M) & (range_m <= MAX_RANGE_M)
    image = np.zeros(LIDAR.shape, bool)
    image[cells(range_m[kept], np.arctan2(y, x)[kept], LIDAR)] = True
    return image


def in_front(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return which places are within reach to the front and the sides."""
    return (x > 0) & (x <= REACH_M) & (np.abs(y) <= REACH_M)


def cells(
    range_m: Float[np.ndarray, " point"],
    azimuth: Float[np.ndarray, " point"],
    grid: PolarGrid,
) -> tuple[np.ndarray, np.ndarray]:
    """Return row and column of the first grid values that are not below a point's."""
    return np.searchsorted(grid.ranges, range_m), np.searchsorted(grid.angles, azimuth)


def level_scan(
    scan: Float[np.ndarray, "ray xyzi"],
) -> Float[np.ndarray, "point 3"]:
    """Return the rig's scan around its radar, x along the radar's view, z upright."""
    xyz = scan[:, :3]
    radar = base_from("single_chip")
    points = transform(base_from("lidar"), xyz[(xyz != 0).any(1)]) - radar[:3, 3]
    cosine, sine = radar[:2, 0] / np.linalg.norm(radar[:2, 0])
    x, y, z = points.T
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], -1)


def layout(family: str, seed: int) -> Setting:
    """Return a scene and a level unit that has RadarHD's chirp and range offset."""
    unit = dataclasses.replace(
        draw_unit(seed, population=2),
        clutter_counts=_between(seed, CLUTTER_COUNTS),
        calibration_degrees=None,
        range_bias_m=OFFSET_M,
        leakage_db=-40.0,
        interferers=0,
        tilt_degrees=0.0,
    )
    setting = make_setting(family, seed, unit=unit)
    hardware = make_unit_hardware(unit, CHIP)
    return setting._replace(radars={"single_chip": (CHIP, hardware)})


def pairs_of(setting: Setting) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield a radar and a LiDAR image of each of `MOMENTS_S`."""
    threshold = _between(setting.seed, THRESHOLDS)
    frames = radar_frames(setting, "single_chip", MOMENTS_S)
    for frame, scan in zip(frames, lidar_scans(setting, MOMENTS_S), strict=True):
        i, q = np.moveaxis(np.asarray(frame), -1, 0)
        seen = radar_image(i + 1j * q, threshold=threshold)
        yield seen, lidar_image(level_scan(scan))


def _between(seed: int, ends: tuple[float, float]) -> float:
    """A random number between `ends`, evenly spread in its logarithm."""
    random = np.random.default_rng([seed, *np.float64(ends).tobytes()])
    return float(np.exp(random.uniform(*np.log(ends))))


def write_pairs(layouts: int, path: Path, *, first: int = 0) -> int:
    """Write the pairs of layouts `first` and following as a packed file.

    Returns the number of pairs. Those with an empty image are left out.
    """
    found = []
    with progress("layouts", layouts) as show:
        for seed in range(first, first + layouts):
            setting = layout(FAMILIES[seed % len(FAMILIES)], seed)
            for moment, (seen, truth) in enumerate(pairs_of(setting)):
                if seen.any() and truth.any():
                    found.append((seen, np.packbits(truth, axis=-1), seed, moment))
            show(seed - first + 1)
    names = ("radar", "lidar_packed", "trajectory", "frame")
    columns = map(np.stack, zip(*found, strict=True))
    np.savez_compressed(path, **dict(zip(names, columns, strict=True)))
    return len(found)


def main(arguments: Sequence[str]) -> None:
    """Write the pairs that the command line asks for."""
    parser = ArgumentParser(prog="experiments.radarhd.simulated", description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--layouts", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0, help="seed of the first layout")
    chosen = parser.parse_args(arguments)
    if chosen.layouts < 1:
        parser.error(f"--layouts = {chosen.layouts}, expected 1 or more")
    number = write_pairs(chosen.layouts, chosen.out, first=chosen.first)
    print(f"{number} pairs of {chosen.layouts} layouts written to {chosen.out}")


if __name__ == "__main__":
    main(sys.argv[1:])
