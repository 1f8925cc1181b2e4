"""Three-TX frames to clouds: with a perfect denoiser the LiDAR's image comes out."""

import jax
import jax.numpy as jnp
import numpy as np

from jradar import enhance
from jradar.data import room_frame
from jradar.diffusion import NoiseSpec
from jradar.radar import RadarSpec
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


def test_the_denoisers_image_becomes_the_cloud():
    frame = room_frame(jax.random.key(0), RADAR, FINE)
    seen = []

    def oracle(condition):
        seen.append(condition.shape)
        target = encode_target(frame.lidar, FINE)[None]
        return lambda x, sigma: jnp.broadcast_to(target, x.shape)

    run = jax.jit(lambda key, cube: enhance(key, cube, oracle, **OPTIONS))
    cloud = run(jax.random.key(1), frame.cube)
    assert seen == [(1, 8, 8, 12)]  # encoded once
    assert cloud.xyz.shape == (16 * 32, 3)
    np.testing.assert_allclose(project(cloud, FINE), frame.lidar, atol=1e-4)


def test_vmap_over_frames_equals_the_loop():
    def echo(condition):
        strength = condition.mean()
        return lambda x, sigma: jnp.tanh(x) * strength + strength

    keys = jax.random.split(jax.random.key(0), 2)
    cubes = jnp.stack([room_frame(key, RADAR, FINE).cube for key in keys])
    batch = jax.vmap(lambda key, cube: enhance(key, cube, echo, **OPTIONS))(keys, cubes)
    for i in range(2):
        alone = enhance(keys[i], cubes[i], echo, **OPTIONS)
        np.testing.assert_allclose(batch.xyz[i], alone.xyz, atol=1e-3)
