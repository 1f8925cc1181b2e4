"""Pixels near an echo: by distance along each axis, of points that stand out alone."""

import jax
import jax.numpy as jnp
import numpy as np

from jradar.range_image import ImageSpec, near_echo, unproject
from jradar.types import PointCloud

SPEC = ImageSpec(8, 16, azimuth=(-1.0, 1.0), elevation=(-0.4, 0.4), max_range_m=12.0)
RANDOM = np.random.default_rng(0)
RANGES = RANDOM.uniform(0.5, 12.0, (3, 8, 16)).astype(np.float32)
RANGES[:, 0, :4] = 0.0
SEEN = np.asarray(unproject(RANGES[0], SPEC).xyz)
# Some close to what the image shows, others anywhere, also beyond the view.
POINTS = np.concatenate(
    [SEEN[::9] + RANDOM.normal(0, 0.4, SEEN[::9].shape), [[30, 0, 0]]]
)
CLOUD = PointCloud(jnp.asarray(POINTS, jnp.float32), jnp.arange(len(POINTS)) % 5 > 0)


def test_near_is_half_a_metre_along_each_axis():
    near = np.asarray(near_echo(RANGES[0], CLOUD, SPEC)).ravel()
    known = POINTS[np.asarray(CLOUD.valid)]
    away = np.abs(SEEN[:, None] - known).max(-1).min(1)
    shown = RANGES[0].ravel() > 0
    assert near[shown & (away <= 0.5)].all() and (shown & (away <= 0.5)).any()
    assert not near[away > 0.75].any() and not near[~shown].any()


def test_only_echoes_of_6_db_stand_out():
    quiet = CLOUD._replace(snr=jnp.full(len(POINTS), 3.9))
    assert not near_echo(RANGES[0], quiet, SPEC).any()
    loud = CLOUD._replace(snr=jnp.full(len(POINTS), 4.1))
    same = near_echo(RANGES[0], CLOUD, SPEC)
    np.testing.assert_array_equal(near_echo(RANGES[0], loud, SPEC), same)


def test_images_together_are_images_one_by_one():
    both = jax.vmap(near_echo, (0, None, None))(jnp.asarray(RANGES), CLOUD, SPEC)
    one_by_one = [near_echo(image, CLOUD, SPEC) for image in RANGES]
    np.testing.assert_array_equal(both, one_by_one)
