r"""Pairs as RadarHD's, made of the simulator's recordings: other rooms to train on.

    python -m experiments.tasks.radarhd_simulated RECORDINGS pairs.npz \
        --families home,lab,hall,hallways,corridor

Each frame of RECORDINGS gives a radar and a LiDAR image of the polar grid, which the
packed file holds in the form that `radarhd_pairs` reads. Both are formed as RadarHD
forms its own (its folder create_dataset/):

    radar     one chirp of the 8 antennas in a row, Fourier transforms over samples and
              antennas without a window; amplitudes of at least 5 % of the largest, from
              1.2 m on and within 70 degrees, in dB from the smallest to the largest
    LiDAR     returns in front, within 10 m to the front and the sides and 0.3 m above
              and below the sensor
    cell      the first grid value that is not below a point's range or azimuth

The simulated radars have another chirp than RadarHD's, and their field of view is that
of a ColoRadar chip.
"""

import sys
from argparse import ArgumentParser
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Complex, Float, UInt8

from experiments.tasks.radarhd_pairs import LIDAR, RADAR, PolarSpec
from jradar.lidar import transform
from jradar.radar import RadarSpec
from jradar.radar.sensor import SPEED_OF_LIGHT
from jradar.recordings import Recording, calibrated_cube, open_recording

RANGE_STEP_M = 21.59 / 511  # of RadarHD's range bins
NEAREST_BIN = 28  # RadarHD's is 6; the simulated chips leak more, to 1.2 m
OFFSET_M = 0.17  # by which RadarHD's radar images lie behind its LiDAR's
NUM_BEAMS = 64
THRESHOLD = 0.05  # of the largest amplitude
VIEW = np.deg2rad(70.0)  # to either side, of the radar
REACH_M, HALF_HEIGHT_M = 10.0, 0.3  # of the LiDAR's slice
FAMILIES = ("home", "lab", "hall", "hallways", "corridor")


def radar_image(
    cube: Complex[np.ndarray, "tx rx chirp sample"], radar: RadarSpec
) -> UInt8[np.ndarray, "range radar_azimuth"]:
    """Return RadarHD's radar image of the first chirp of a frame."""
    amplitude = beams(first_row(cube, radar), radar)
    strong = amplitude >= THRESHOLD * amplitude[:, NEAREST_BIN:].max()
    strong[:, :NEAREST_BIN] = False
    beam, bin_ = np.nonzero(strong)
    # RadarHD spreads its beams over both ends of the sines, and so do its images.
    azimuth = np.arcsin(np.linspace(-1, 1, NUM_BEAMS))[beam]
    range_m = RANGE_STEP_M * bin_
    x, y = range_m * np.cos(azimuth), range_m * np.sin(azimuth)
    kept = (x > 0) & (x <= REACH_M) & (np.abs(y) <= REACH_M) & (np.abs(azimuth) <= VIEW)
    kept &= range_m <= RADAR.max_range_m
    image = np.zeros(RADAR.shape, np.uint8)
    if not kept.any():
        return image
    level = np.log(amplitude[beam, bin_][kept])
    level -= level.min()
    grey = (255 * level / max(level.max(), 1e-9)).astype(np.uint8)
    image[cells(range_m[kept], azimuth[kept], RADAR)] = grey
    return image


def first_row(
    cube: Complex[np.ndarray, "tx rx chirp sample"], radar: RadarSpec
) -> Complex[np.ndarray, "antenna sample"]:
    """Return the first chirp of the antennas of the row z = 0, from left to right.

    Raises ValueError unless these are a row without gaps.
    """
    places = {
        (tx[0] + rx[0]): (i, j)
        for i, tx in enumerate(radar.tx_positions)
        for j, rx in enumerate(radar.rx_positions)
        if tx[1] + rx[1] == 0
    }
    if sorted(places) != [*range(len(places))]:
        raise ValueError(f"antennas at {sorted(places)}, expected a row without gaps")
    return np.stack([cube[*places[column], 0] for column in sorted(places)])


def beams(
    row: Complex[np.ndarray, "antenna sample"], radar: RadarSpec
) -> Float[np.ndarray, "beam range"]:
    """Return amplitudes in RadarHD's range bins and beams, from right to left."""
    sample = np.arange(row.shape[1]) / radar.sample_rate_hz
    ranges = RANGE_STEP_M * np.arange(int(RADAR.max_range_m / RANGE_STEP_M) + 1)
    beat = 2 * radar.slope_hz_per_s * (ranges - OFFSET_M) / SPEED_OF_LIGHT
    profile = row @ np.exp(-2j * np.pi * sample[:, None] * beat[None])
    spectrum = np.fft.fft(profile, NUM_BEAMS, axis=0)
    return np.abs(np.fft.fftshift(spectrum, axes=0))


def lidar_image(
    points: Float[np.ndarray, "point 3"],
) -> Bool[np.ndarray, "range azimuth"]:
    """Return the occupied cells of the horizontal slice of a scan, x forward."""
    x, y, z = points.T
    kept = (x > 0) & (x <= REACH_M) & (np.abs(y) <= REACH_M)
    kept &= np.abs(z) <= HALF_HEIGHT_M
    range_m = np.linalg.norm(points, axis=1)
    kept &= range_m <= LIDAR.max_range_m
    image = np.zeros(LIDAR.shape, bool)
    image[cells(range_m[kept], np.arctan2(y, x)[kept], LIDAR)] = True
    return image


def cells(
    range_m: Float[np.ndarray, " point"],
    azimuth: Float[np.ndarray, " point"],
    grid: PolarSpec,
) -> tuple[np.ndarray, np.ndarray]:
    """Return row and column of the first grid values that are not below a point's."""
    return np.searchsorted(grid.ranges, range_m), np.searchsorted(grid.angles, azimuth)


def level_scan(recording: Recording, frame: int) -> Float[np.ndarray, "point 3"]:
    """Return a scan around the radar, x along its view, z upright."""
    if recording.lidar is None or recording.base_from_lidar is None:
        raise ValueError(f"{recording.path}: expected a recording with a LiDAR's place")
    xyz = recording.lidar[frame][:, :3]
    points = transform(recording.base_from_lidar, xyz[(xyz != 0).any(1)])
    points = points - recording.base_from_radar[:3, 3]
    forward = recording.base_from_radar[:2, 0]
    cosine, sine = forward / np.linalg.norm(forward)
    x, y, z = points.T
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], -1)


def pairs_of(recording: Recording) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the radar and the LiDAR image of each frame."""
    for frame in range(len(recording.cubes)):
        cube = np.asarray(calibrated_cube(recording, frame))
        radar = radar_image(cube, recording.radar)
        yield radar, lidar_image(level_scan(recording, frame))


def write_pairs(folders: Sequence[Path], path: Path) -> int:
    """Write the pairs of recordings as a packed file; return their number.

    A recording is a trajectory, numbered in the order of `folders`.
    """
    radar, lidar, keys = [], [], []
    for trajectory, folder in enumerate(folders):
        for frame, pair in enumerate(pairs_of(open_recording(folder))):
            radar.append(pair[0])
            lidar.append(np.packbits(pair[1], axis=-1))
            keys.append((trajectory, frame))
    trajectories, frames = np.array(keys).T
    np.savez_compressed(
        path,
        radar=np.stack(radar),
        lidar_packed=np.stack(lidar),
        trajectory=trajectories,
        frame=frames,
    )
    return len(keys)


def main(arguments: Sequence[str]) -> None:
    """Write the pairs that the command line names."""
    parser = ArgumentParser(prog="radarhd_simulated", description=__doc__)
    parser.add_argument("recordings", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--families", default=",".join(FAMILIES))
    chosen = parser.parse_args(arguments)
    families = chosen.families.split(",")
    folders = [
        folder
        for folder in sorted(chosen.recordings.iterdir())
        if folder.is_dir() and folder.name.rpartition("_")[0] in families
    ]
    if not folders:
        parser.error(f"{chosen.recordings} has no recordings of {families}")
    print(f"{write_pairs(folders, chosen.out)} pairs written to {chosen.out}")


if __name__ == "__main__":
    main(sys.argv[1:])
