r"""Compare simulated frames with real ones: a picture and a few numbers.

    python -m experiments.studies.realism SAMPLES -o runs/realism

SAMPLES is a folder of real frames, which are not part of jradar:

    openradar/doppler_example_1.npy    a capture from OpenRadar (PreSenseRadar)
    coloradar_pairs/                   pairs from ColoRadar (Radar-Diffusion):
      range_azimuth_heatmap/N.png      [range 128, azimuth 64], 8 bits
      lidar_pcl_bev_polar_img/N.png    [range 160, azimuth 100], 0.1 m and 1.8 degrees

The capture is compared with a simulated frame of the same chirps. The pairs are
compared with simulated frames turned into pictures by the same recipe: Blackman window,
32 azimuths, power summed over elevation and velocity, divided by its 30 % quantile, in
dB, from 0 to the frame's largest. The authors of the pairs treat LiDAR and radar as one
place, so simulated LiDAR points are not moved to the radar either.

The real frames are eight, of other rooms: the numbers are a comparison, not a score.
"""

import sys
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Float

from experiments.command import run_study, study_parser
from experiments.studies.realism_figure import Row, realism_figure
from experiments.tables import markdown_table
from jradar import viz
from jradar.errors import UsageError, parsing
from jradar.files import write_text
from jradar.radar import PointSpec, RadarSpec, radar_points, range_doppler
from jradar.simulation import (
    FAMILIES,
    lidar_scans,
    make_setting,
    radar_frames,
)
from jradar.simulation.hardware import make_hardware

CAPTURE = Path("openradar") / "doppler_example_1.npy"
PAIRS = Path("coloradar_pairs")
OPENRADAR = {  # the chirps of OpenRadar's example
    "start_frequency_hz": 77.4201e9,
    "slope_hz_per_s": 60e12,
    "sample_rate_hz": 2.5e6,
    "idle_time_s": 30e-6,
    "ramp_end_time_s": 62e-6,
}
MAX_RANGE_M, AZIMUTHS = 16.0, 32  # of the pairs' pictures, before interpolation
CROPPED = 6  # range bins at either end that are black
NEAR_SENSOR_M = 0.6  # LiDAR points farther up or down are floor or ceiling
TIME_S, SEED = 2.0, 200  # of the simulated frames, from the test split
RATE = 1e-3  # false-alarm rate
ABOVE_FLOOR_DB = 12.0
LEAKY = 4  # range bins of leakage, excluded from the numbers of the map


class PolarFrame(NamedTuple):
    """A polar radar image over the sine of azimuth, and LiDAR points in the plane."""

    image: Float[np.ndarray, "range azimuth"]  # 0 to 1; left is the last column
    lidar: Float[np.ndarray, "point 2"]


def read_capture(path: Path) -> tuple[Complex[np.ndarray, "2 4 128 128"], RadarSpec]:
    """Return OpenRadar's example as a cube, with signed samples, and its radar."""
    if not path.exists():
        raise UsageError(
            f"no {path}: expected SAMPLES to contain {CAPTURE} and {PAIRS}, see --help"
        )
    with parsing(path, "a .npy file"):
        stored = np.load(path, allow_pickle=False)
    if stored.shape != (128, 8, 128) or not np.iscomplexobj(stored):
        raise ValueError(
            f"{path} holds {stored.dtype} of shape {stored.shape}, expected complex "
            "values of shape (128, 8, 128): chirps, antennas, samples"
        )
    real, imaginary = (
        part.astype("u2").view("i2").astype(np.float32)
        for part in (stored.real, stored.imag)
    )
    cube = (real + 1j * imaginary).reshape(128, 2, 4, 128).transpose(1, 2, 0, 3)
    return cube, RadarSpec.awr1642(**OPENRADAR)


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


def simulated_pair(family: str) -> tuple[Complex[np.ndarray, "..."], PolarFrame]:
    """Return a simulated cube, and its image with the LiDAR points of that time."""
    setting, stamps = make_setting(family, SEED), np.array([TIME_S])
    (frame,) = radar_frames(setting, "single_chip", stamps)
    frame = np.asarray(frame, np.float32)
    cube = frame[..., 0] + 1j * frame[..., 1]
    (scan,) = lidar_scans(setting, stamps - 0.05)
    seen = scan[np.any(scan[:, :3] != 0, 1), :3] * [-1, -1, 1]
    radar, _ = setting.radars["single_chip"]
    return cube, PolarFrame(azimuth_image(cube, radar), polar_points(polar_mask(seen)))


def simulated_capture(family: str, radar: RadarSpec) -> Complex[np.ndarray, "..."]:
    """Return a simulated cube of a radar with other chirps."""
    setting = make_setting(family, SEED)
    radars = {"single_chip": (radar, make_hardware("single_chip", radar))}
    setting = setting._replace(radars=radars)
    (frame,) = radar_frames(setting, "single_chip", np.array([TIME_S]))
    frame = np.asarray(frame, np.float32)
    return frame[..., 0] + 1j * frame[..., 1]


def map_statistics(
    cube: Complex[np.ndarray, "..."], radar: RadarSpec
) -> tuple[dict[str, float], np.ndarray, np.ndarray]:
    """Return statistics of a frame's range-Doppler map, the map, and its points."""
    frame = jnp.asarray(cube, jnp.complex64)
    power = np.asarray(range_doppler(frame)[1], np.float64)
    cloud = radar_points(frame, radar, points=PointSpec(false_alarm_rate=RATE))
    xyz = np.asarray(cloud.xyz)[np.asarray(cloud.valid)]
    level = 10 * np.log10(power / np.median(power))[:, LEAKY:]
    still = np.zeros(len(power), bool)
    still[len(power) // 2 - 2 : len(power) // 2 + 3] = True
    return (
        {
            "peak over median (dB)": level.max(),
            f"cells over median + {ABOVE_FLOOR_DB:g} dB (%)": 100
            * (level > ABOVE_FLOOR_DB).mean(),
            "power within 2 bins of zero velocity (%)": 100
            * power[still, LEAKY:].sum()
            / power[:, LEAKY:].sum(),
            f"points at a false-alarm rate of {RATE:g}": float(len(xyz)),
        },
        power,
        xyz,
    )


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


def over_angles(image: Float[np.ndarray, "range azimuth"]) -> np.ndarray:
    """Return the image over 90 equal angles from -90 to 90 degrees."""
    sine = 2 * np.arange(image.shape[1]) / image.shape[1] - 1
    angles = np.sin(np.radians(np.linspace(-90, 90, 90)))
    return np.stack([np.interp(angles, sine, row) for row in image])


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
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Draw `realism.png`, and write and print `realism.md`."""
    families: list[str] = options.scenes
    cube, radar = read_capture(options.samples / CAPTURE)
    real_pairs = read_pairs(options.samples / PAIRS)
    made = [simulated_pair(family)[1] for family in families]
    numbers, *seen = map_statistics(cube, radar)
    simulated = [
        map_statistics(simulated_capture(family, radar), radar) for family in families
    ]
    rows = {
        name: Row(
            *maps,
            np.stack([over_angles(pair.image) for pair in pairs[:4]]),
            [pair.lidar for pair in pairs[:4]],
            titles[:4],
        )
        for name, maps, pairs, titles in (
            ("real", seen, real_pairs, ()),
            ("simulated", simulated[0][1:], made, tuple(families)),
        )
    }
    maps = {"real, OpenRadar": numbers}
    maps |= {f: found[0] for f, found in zip(families, simulated, strict=True)}
    images = {"real, ColoRadar": pair_statistics(real_pairs)}
    images |= {f: pair_statistics([p]) for f, p in zip(families, made, strict=True)}
    images["all simulated"] = pair_statistics(made)
    text = f"{table(maps)}\n{table(images)}"
    figure = realism_figure(rows, radar, max_range_m=MAX_RANGE_M)
    viz.save_figure(figure, options.output / "realism.png")
    write_text(options.output / "realism.md", text)
    print(f"{text}\npicture: {options.output / 'realism.png'}")


if __name__ == "__main__":
    sys.exit(main())
