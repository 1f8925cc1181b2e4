r"""Draw two close targets that Capon and MUSIC resolve and the FFT does not.

    python -m experiments.studies.resolution -o angles.png

Simulates two equal targets in one range-Doppler cell of an AWR1843, closer in azimuth
than its beam width, and draws the three angular spectra of that cell.
"""

import sys
from argparse import Namespace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.command import run_study, study_parser
from jradar import viz
from jradar.radar import (
    RadarSpec,
    Scatterers,
    angle_spectrum,
    capon_spectrum,
    music_spectrum,
    range_doppler,
    simulate_cube,
)

DISTANCE_BINS = 40
NUM_AZIMUTH = 1024


class Spectra(NamedTuple):
    """Three spectra of one cell, over the sines of `direction_sines`."""

    fourier: np.ndarray
    capon: np.ndarray
    music: np.ndarray


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("resolution", __doc__, output="the picture, a PNG")
    parser.add_argument("--apart", type=float, default=9.0, help="degrees (default 9)")
    parser.add_argument("--snr", type=float, default=40.0, help="dB (default 40)")
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Draw the spectra."""
    radar = RadarSpec.awr1843()
    targets_deg = (options.apart / 2, -options.apart / 2)
    spectra = two_target_spectra(radar, targets_deg, snr_db=options.snr)
    names = ("FFT", "Capon", "MUSIC")
    figure = viz.angle_spectra_figure(
        dict(zip(names, spectra, strict=True)),
        radar,
        targets_deg=targets_deg,
        title=f"two targets {options.apart:g} degrees apart, beam of "
        f"{beam_width_deg(radar):.0f} degrees, one snapshot",
    )
    viz.save_figure(figure, options.output)
    print(options.output)


def two_target_spectra(
    radar: RadarSpec, azimuths_deg: tuple[float, float], *, snr_db: float
) -> Spectra:
    """Return the spectra of a cell with two equal targets at different phases."""
    azimuth = np.radians(azimuths_deg)
    distance = DISTANCE_BINS * radar.range_resolution_m
    distance = distance + np.array([[0.0], [radar.wavelength_m / 16]])
    direction = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(2)], -1)
    targets = Scatterers(
        xyz=jnp.asarray(distance * direction, jnp.float32),
        velocity=jnp.zeros(2),
        amplitude=jnp.ones(2),
    )
    samples = radar.num_chirps * radar.num_samples
    noise = samples * 10 ** (-snr_db / 10)
    cube = simulate_cube(jax.random.key(0), targets, radar, noise_power=noise)
    spectrum, _ = range_doppler(cube, range_window="none", doppler_window="none")
    cell = spectrum[:, radar.num_chirps // 2, DISTANCE_BINS]
    fourier = angle_spectrum(cell, radar, num_azimuth=NUM_AZIMUTH, num_elevation=32)
    return Spectra(
        np.asarray(fourier[16]),  # elevation 0
        np.asarray(capon_spectrum(cell[None], radar, num_azimuth=NUM_AZIMUTH)),
        np.asarray(
            music_spectrum(cell[None], radar, num_sources=2, num_azimuth=NUM_AZIMUTH)
        ),
    )


def beam_width_deg(radar: RadarSpec) -> float:
    """Return the width at half power of a beam straight ahead, 0.886 / length."""
    columns = int(radar.virtual_positions[:, 0].max()) + 1
    return float(np.degrees(0.886 / (columns * radar.spacing_wavelengths)))


if __name__ == "__main__":
    sys.exit(main())
