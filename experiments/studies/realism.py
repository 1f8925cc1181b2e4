r"""Compare simulated frames with real ones, in numbers.

    python -m experiments.studies.realism SAMPLES -o runs/realism

SAMPLES is a folder of real frames, which are not part of jradar:

    openradar/doppler_example_1.npy    a capture from OpenRadar (PreSenseRadar)
    dca1000/adc_data_0.bin             a capture of an AWR1642, with its LogFile_0.txt
    awr1843_3tx/adc_data_Raw_0.bin     a frame of an AWR1843's three transmitters
    coloradar_pairs/                   pairs from ColoRadar (Radar-Diffusion):
      range_azimuth_heatmap/N.png      [range 128, azimuth 64], 8 bits
      lidar_pcl_bev_polar_img/N.png    [range 160, azimuth 100], 0.1 m and 1.8 degrees

The radars of the captures stand still. Each is compared with simulated radars that have
its chirps and stand in simulated rooms: with the one unit of `jradar-sim-1`, and with
units of `jradar-sim-4`. The exit code is 1 if a number of a real capture is outside the
range of the second.

The pairs are compared with simulated frames made into pictures by the same recipe:
Blackman window, 32 azimuths, power summed over elevation and velocity, divided by its
30 % quantile, in dB, from 0 to the frame's largest. The authors of the pairs treat
LiDAR and radar as one place, so simulated LiDAR points are not moved to the radar
either.

The real frames are ten, of other rooms: the numbers are a comparison, not a score.
"""

import sys
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex, Float

from experiments.command import run_study, study_parser
from experiments.studies.realism_captures import (
    UNITS,
    compared,
    comparison_table,
    many_units,
    one_unit,
    real_captures,
    simulated_captures,
)
from jradar.errors import UsageError, parsing
from jradar.evaluation import markdown_table
from jradar.files import write_text
from jradar.radar import RadarSpec
from jradar.simulation import FAMILIES, lidar_scans, make_setting, radar_frames

PAIRS = Path("coloradar_pairs")
MAX_RANGE_M, AZIMUTHS = 16.0, 32  # of the pairs' pictures, before interpolation
CROPPED = 6  # range bins at either end that are black
NEAR_SENSOR_M = 0.6  # LiDAR points farther up or down are floor or ceiling
TIME_S, SEED = 2.0, 200  # of the simulated frames, from the test split


class PolarFrame(NamedTuple):
    """A polar radar image over the sine of azimuth, and LiDAR points in the plane."""

    image: Float[np.ndarray, "range azimuth"]  # 0 to 1; left is the last column
    lidar: Float[np.ndarray, "point 2"]


def read_pairs(folder: Path) -> list[PolarFrame]:
    """Return the real pairs of a folder."""
    from matplotlib.image import imread

    pairs = []
    for path in sorted((folder / "range_azimuth_heatmap").glob("*.png")):
        partner = folder / "lidar_pcl_bev_polar_img" / path.name
        with parsing(path, "a PNG"):
            image = np.asarray(imread(path), np.float64)
        with parsing(partner, "a PNG"):
            polar = np.asarray(imread(partner))
        if image.ndim != 2 or polar.ndim != 2:
            raise ValueError(f"{path} and its LiDAR picture: expected grey pictures")
        pairs.append(PolarFrame(image[::-1, ::-1], polar_points(polar[::-1, ::-1] > 0)))
    if not pairs:
        raise UsageError(f"no range_azimuth_heatmap/*.png in {folder}, see --help")
    return pairs


def polar_points(mask: np.ndarray) -> np.ndarray:
    """Return points `[point, 2]` of a mask [range, azimuth], from right to left."""
    row, column = np.nonzero(mask)
    distance = (row + 0.5) * MAX_RANGE_M / mask.shape[0]
    azimuth = np.radians(np.linspace(-90, 90, mask.shape[1]))[column]
    return distance[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], -1)


def polar_mask(xyz: Float[np.ndarray, "point 3"]) -> np.ndarray:
    """Return the mask [160, 100] of the LiDAR points ahead, like the real pictures."""
    ahead = (xyz[:, 0] > 0) & (np.abs(xyz[:, 2]) < NEAR_SENSOR_M)
    x, y, _ = xyz[ahead].T
    row = (np.hypot(x, y) / 0.1).astype(int)
    column = np.rint((np.degrees(np.arctan2(y, x)) + 90) / 180 * 99).astype(int)
    mask = np.zeros((160, 100), bool)
    mask[row[row < 160], column[row < 160]] = True
    return mask


def azimuth_image(
    cube: Complex[np.ndarray, "tx rx chirp sample"], radar: RadarSpec
) -> Float[np.ndarray, "range azimuth"]:
    """Return a range-azimuth image, 0 to 1, by the recipe of the real pairs.

    Columns are evenly spaced in the sine of azimuth.
    """
    window = np.blackman(radar.num_samples)
    spectra = np.fft.fft2(cube * window)
    cycles = np.fft.fftfreq(radar.num_chirps)[None, :] * radar.firing_position[:, None]
    spectra *= np.exp(-2j * np.pi * cycles / radar.num_tx)[:, None, :, None]
    spectra = spectra.reshape(radar.num_virtual, *spectra.shape[2:])
    places = radar.virtual_positions
    power = np.zeros((radar.num_samples, AZIMUTHS))
    for elevation in np.unique(places[:, 1]):
        row = np.zeros((AZIMUTHS, *spectra.shape[1:]), complex)
        mine = places[:, 1] == elevation
        row[places[mine, 0]] = spectra[mine]
        power += (np.abs(np.fft.fft(row, axis=0)) ** 2).sum(1).T
    power = np.fft.fftshift(power, axes=1)
    power[:CROPPED] = power[-CROPPED:] = 0
    level = 10 * np.log10(power / np.quantile(power, 0.3) + 1)
    return level / level.max()


def simulated_pair(family: str) -> PolarFrame:
    """Return the image of a simulated frame, with the LiDAR points of that time."""
    setting, stamps = make_setting(family, SEED), np.array([TIME_S])
    (frame,) = radar_frames(setting, "single_chip", stamps)
    frame = np.asarray(frame, np.float32)
    cube = frame[..., 0] + 1j * frame[..., 1]
    (scan,) = lidar_scans(setting, stamps - 0.05)
    seen = scan[np.any(scan[:, :3] != 0, 1), :3] * [-1, -1, 1]
    radar, _ = setting.radars["single_chip"]
    return PolarFrame(azimuth_image(cube, radar), polar_points(polar_mask(seen)))


def pair_statistics(pairs: Sequence[PolarFrame]) -> dict[str, float]:
    """Return how full the images are, and how near their peaks lie to LiDAR points."""
    kept = [pair.image[CROPPED:-CROPPED] for pair in pairs]
    apart = np.concatenate([peak_distances(pair) for pair in pairs])
    mirrored = [pair._replace(lidar=pair.lidar * [1, -1]) for pair in pairs]
    by_chance = np.concatenate([peak_distances(pair) for pair in mirrored])
    return {
        "mean of the image (% of its largest dB)": 100
        * float(np.mean([image.mean() for image in kept])),
        "cells over half of the largest dB (%)": 100
        * float(np.mean([(image > 0.5).mean() for image in kept])),
        "peaks within 0.2 m of LiDAR (%)": 100 * float((apart < 0.2).mean()),
        "peaks within 0.5 m of LiDAR (%)": 100 * float((apart < 0.5).mean()),
        "peaks within 0.5 m of LiDAR mirrored, by chance (%)": 100
        * float((by_chance < 0.5).mean()),
        "peaks to LiDAR, median (m)": float(np.median(apart)),
    }


def peak_distances(pair: PolarFrame) -> Float[np.ndarray, " azimuth"]:
    """Return the distance to LiDAR of the strongest cell of each azimuth.

    Azimuths are within 60 degrees; beams of neighbouring columns overlap.
    """
    from scipy.spatial import KDTree

    rows, columns = pair.image.shape
    sine = 2 * np.arange(columns) / columns - 1
    ahead = np.flatnonzero(np.abs(sine) < np.sin(np.radians(60)))
    distance = pair.image[:, ahead].argmax(0) * MAX_RANGE_M / rows
    plane = distance[:, None] * np.stack(
        [np.sqrt(1 - sine[ahead] ** 2), sine[ahead]], -1
    )
    if not len(pair.lidar):
        return np.full(len(plane), np.inf)
    return np.asarray(KDTree(pair.lidar).query(plane)[0])


def table(columns: dict[str, dict[str, float]]) -> str:
    """Return Markdown: a row for each number, a column for each kind of frame."""
    names = dict.fromkeys(name for numbers in columns.values() for name in numbers)
    rows = [[n, *(f"{found[n]:.3g}" for found in columns.values())] for n in names]
    return markdown_table(["", *columns], rows)


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("realism", __doc__)
    parser.add_argument("samples", type=Path, help="folder of real frames")
    parser.add_argument(
        "--scenes", nargs="+", choices=FAMILIES, default=[*FAMILIES], help="to simulate"
    )
    parser.add_argument(
        "--units", type=int, default=UNITS, help="simulated for each capture"
    )
    return run_study(study, parser, argv)


def study(options: Namespace) -> int:
    """Write and print `realism.md`, and return the exit code."""
    families: list[str] = options.scenes
    real = real_captures(options.samples)
    real_pairs = read_pairs(options.samples / PAIRS)
    captures = {
        name: (
            [*simulated_captures(capture.radar, one_unit(options.units))],
            [*simulated_captures(capture.radar, many_units(options.units))],
        )
        for name, capture in real.items()
    }
    numbers = compared(real, captures)
    made = [*map(simulated_pair, families)]
    images = {"real, ColoRadar": pair_statistics(real_pairs)}
    images |= {f: pair_statistics([p]) for f, p in zip(families, made, strict=True)}
    images["all simulated"] = pair_statistics(made)
    text = f"{comparison_table(numbers)}\n{table(images)}"
    write_text(options.output / "realism.md", text)
    print(text)
    outside = [f"{c.capture}: {c.number}" for c in numbers if not c.inside]
    for number in outside:
        print(f"outside the range of {options.units} simulated units: {number}")
    return 1 if outside else 0


if __name__ == "__main__":
    sys.exit(main())
