"""Polar images: RadarHD's, point by point; other radars see the same; empty frames."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.model.grids.polar import (
    RADAR,
    RADARHD,
    azimuth_row,
    image_features,
    polar_image,
)
from jradar.radar import RadarSpec, simulate_cube
from tests.model.polar.radarhd import drawn
from tests.radar.targets import targets

ONE_TURN = dataclasses.replace(RADARHD, num_chirps=1)
PLACES = [(2.0, 30.0, 0.0, 0.0), (4.5, -20.0, 0.0, 0.0), (7.0, 0.0, 0.0, 0.0)]


def frame(radar=ONE_TURN, places=PLACES, seed=0, noise_power=900.0):
    key = jax.random.key(seed)
    return simulate_cube(key, targets(*places), radar, noise_power=noise_power)


@pytest.mark.parametrize("seed", range(4))
def test_the_image_is_radarhds_pixel_by_pixel(seed):
    """Up to steps of the 8 bits, where float32 rounds to another side."""
    rng = np.random.default_rng(seed)
    angles, ranges = rng.uniform(-75, 75, 20), rng.uniform(0.3, 20, 20)
    places = [(r, a, 0.0, 0.0) for r, a in zip(ranges, angles, strict=True)]
    samples = frame(places=places, seed=seed, noise_power=100.0 * 10**seed)
    found = np.rint(255 * np.asarray(polar_image(samples, ONE_TURN))).astype(int)
    expected = drawn(np.asarray(samples)[:, :, 0].reshape(8, 512))
    different = found != expected
    assert (expected > 0).sum() > 500 and different.mean() < 2e-3
    assert abs(found - expected)[different].sum() <= 2 * different.sum()


def test_pixels_that_can_be_lit_are_those_of_the_published_heatmaps(samples):
    """No published heatmap has a value where no cell of ours falls."""
    published = np.load(samples / "radarhd" / "train_every4.npz")["radar"]
    noise = (frame(places=PLACES[:1], seed=s, noise_power=1e8) for s in range(6))
    lit = np.max([polar_image(samples, ONE_TURN) for samples in noise], axis=0) > 0
    ever = (published > 0).any(0)
    assert not (ever & ~lit).any() and (lit & ~ever).mean() < 0.02
    # Of two cells in a pixel the stronger may be lost, and with it the value 255.
    assert 0.6 < (published.max((1, 2)) == 255).mean() < 0.8


def test_an_echo_lies_at_its_range_and_azimuth():
    for place in PLACES:
        image = np.asarray(polar_image(frame(places=[place]), ONE_TURN))
        row, column = np.unravel_index(image.argmax(), image.shape)
        assert abs(RADAR.ranges[row] - place[0]) < 0.06
        assert abs(np.degrees(RADAR.angles[column]) - place[1]) < 3.5


@pytest.mark.parametrize(
    "radar",
    [
        RadarSpec.awr1843(num_chirps=1),
        dataclasses.replace(
            ONE_TURN, start_frequency_hz=60e9, design_frequency_hz=62e9
        ),
        dataclasses.replace(ONE_TURN, num_samples=256, real_samples=True),
    ],
    ids=["awr1843", "60 GHz", "real samples"],
)
def test_other_radars_see_the_same_places(radar):
    places = [place[:2] + (0.0, 0.0) for place in PLACES]
    image = np.asarray(polar_image(frame(radar, places), radar))
    for distance, degrees, *_ in places:
        row = int(np.abs(RADAR.ranges - distance).argmin())
        column = int(np.abs(np.degrees(RADAR.angles) - degrees).argmin())
        near = image[row - 3 : row + 4, column - 2 : column + 3]
        assert near.max() > 0.6


def test_the_longest_row_of_neighbours_is_used():
    cascade, columns = azimuth_row(RadarSpec.cascade())
    assert len(cascade) == 8 and (np.diff(columns) == 1).all()
    antennas, columns = azimuth_row(RadarSpec.awr1843())
    assert antennas.tolist() == [0, 1, 2, 3, 4, 5, 6, 7] == columns.tolist()
    alone = dataclasses.replace(RADARHD, tx_positions=((0, 0),), tx_firing_order=())
    assert azimuth_row(alone)[1].tolist() == [0, 1, 2, 3]
    column = dataclasses.replace(
        alone, tx_positions=((0, 0),), rx_positions=((0, 0), (2, 0))
    )
    with pytest.raises(UsageError, match="no two antennas next to each other in a row"):
        azimuth_row(column)


def test_a_frame_without_signal_is_empty():
    silence = jnp.zeros(ONE_TURN.cube_shape, jnp.complex64)
    assert not polar_image(silence, ONE_TURN).any()


def test_features_are_the_lit_shares_and_mean_values_of_bands():
    image = np.zeros(RADAR.shape, np.float32)
    rows = RADAR.shape[0] // 8
    image[rows : 2 * rows : 4] = 0.5  # a quarter of the second band
    shares, means = np.split(np.asarray(image_features(image)), 2)
    np.testing.assert_allclose(shares, np.eye(8)[1] / 2, atol=1e-6)
    np.testing.assert_allclose(means, np.eye(8)[1] / 2, atol=1e-6)
    many = image_features(np.stack([image, 0 * image]))
    assert many.shape == (2, 16) and not many[1].any()


def test_images_of_several_frames_are_those_of_each():
    frames = jnp.stack([frame(seed=s) for s in range(2)])
    many = jax.vmap(lambda samples: polar_image(samples, ONE_TURN))(frames)
    one = jnp.stack([polar_image(samples, ONE_TURN) for samples in frames])
    np.testing.assert_allclose(many, one, atol=1 / 254)
