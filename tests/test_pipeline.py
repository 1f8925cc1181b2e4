"""Three-TX frames to clouds: with a perfect denoiser the LiDAR's image comes out."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar import enhance
from jradar.diffusion import NoiseSpec
from jradar.pipeline import draw_range_image
from jradar.radar import RadarSpec, Scatterers, simulate_cube
from jradar.range_image import ImageSpec, encode_target, project

RADAR = RadarSpec.awr1843(num_chirps=32, num_samples=64)
COARSE, FINE = ImageSpec(8, 8), ImageSpec(16, 32)
OPTIONS = {
    "radar": RADAR,
    "coarse": COARSE,
    "fine": FINE,
    "num_slices": 4,
    "points": {"capacity": 64, "false_alarm_rate": 1.0},
    "noise": NoiseSpec(),
    "steps": 4,
}


def echoes(key):
    """A cube of 20 targets in front of the radar."""
    place = jax.random.uniform(key, (20, 3), minval=-1.0, maxval=1.0)
    targets = Scatterers(
        place + jnp.array([3.0, 0.0, 0.0]), jnp.zeros(20), jnp.full(20, 50.0)
    )
    return simulate_cube(key, targets, RADAR, noise_power=1.0)


def test_the_denoisers_image_becomes_the_cloud():
    lidar = 4.0 + jnp.sin(jnp.arange(16 * 32.0)).reshape(FINE.shape)
    seen = []

    def oracle(condition):
        seen.append(condition.shape)
        target = encode_target(lidar, FINE)[None]
        return lambda x, sigma: jnp.broadcast_to(target, x.shape)

    run = jax.jit(lambda key, cube: enhance(key, cube, oracle, **OPTIONS))
    cloud = run(jax.random.key(1), echoes(jax.random.key(0)))
    assert seen == [(1, 8, 8, 12)]  # encoded once
    assert cloud.xyz.shape == (16 * 32, 3)
    np.testing.assert_allclose(project(cloud, FINE), lidar, atol=1e-4)


def test_of_several_draws_comes_what_they_agree_on():
    near, far = jnp.full(FINE.shape, 3.0), jnp.full(FINE.shape, 6.0)
    draws = jnp.stack([near, far, far + 0.1, jnp.zeros(FINE.shape)])

    def oracle(condition):
        return lambda x, sigma: encode_target(draws, FINE)

    sampling = dict(fine=FINE, noise=NoiseSpec(), steps=2)
    condition = jnp.zeros((8, 8, 12))
    key = jax.random.key(0)
    image = draw_range_image(key, condition, oracle, draws=4, **sampling)
    np.testing.assert_allclose(image, 6.05, atol=1e-4)
    with pytest.raises(ValueError, match="draws=0, expected at least 1"):
        draw_range_image(key, condition, oracle, draws=0, **sampling)


def test_vmap_over_frames_equals_the_loop():
    def echo(condition):
        strength = condition.mean()
        return lambda x, sigma: jnp.tanh(x) * strength + strength

    keys = jax.random.split(jax.random.key(0), 2)
    cubes = jnp.stack([echoes(key) for key in keys])
    batch = jax.vmap(lambda key, cube: enhance(key, cube, echo, **OPTIONS))(keys, cubes)
    for i in range(2):
        alone = enhance(keys[i], cubes[i], echo, **OPTIONS)
        np.testing.assert_allclose(batch.xyz[i], alone.xyz, atol=1e-3)
