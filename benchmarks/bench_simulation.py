"""How fast are the forward model and the rays of a LiDAR?

The forward model is compared with a sum that computes a phasor for each sample of each
chirp, and a LiDAR scan with trimesh's first hits.
"""

import functools
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.harness import Case, available
from jradar.radar import RadarSpec, Scatterers, simulate_cube
from jradar.simulation import make_setting
from jradar.simulation.scanner import ouster_rays
from jradar.simulation.scenes.scene import cast, placements

RADAR = RadarSpec.awr1843()
TIME_S = 1.0
SCATTERERS = 1024


def cases() -> Iterator[Case]:
    """Yield the forward model, and the rays of a scan."""
    scatterers = _scatterers(SCATTERERS)
    yield Case(
        f"ADC cube of {SCATTERERS} scatterers, 12 x 128 x 128",
        functools.partial(simulate_cube, jax.random.key(0), scatterers, RADAR),
        {"phasor per sample": functools.partial(_every_sample, scatterers)},
    )
    setting = make_setting("mine", 0)
    places = placements(setting.scene, TIME_S)
    directions = ouster_rays()[0].astype(np.float32)
    origins = np.zeros_like(directions) + np.float32([*places[0].xyz])
    origins += setting.scene.platform.curve(0.0).astype(np.float32)
    yield Case(
        "65,536 rays into a mine of 20,000 triangles and a person",
        lambda: cast(setting.scene, places, origins, directions),
        available({"trimesh": lambda: _trimesh(setting, origins, directions)}),
    )


def _scatterers(count: int) -> Scatterers:
    """Return scatterers in front of the radar that approach and recede."""
    random = np.random.default_rng(0)
    xyz = random.uniform([1, -5, -2], [12, 5, 2], (count, 3))
    columns = xyz, random.uniform(-1.5, 1.5, count), np.ones(count)
    return Scatterers(*(jnp.asarray(column, jnp.float32) for column in columns))


@jax.jit
def _every_sample(scatterers: Scatterers) -> jax.Array:
    """Return the model's sum as it is defined, chirp by chirp."""
    distance = jnp.linalg.norm(scatterers.xyz, axis=-1)
    direction = scatterers.xyz[:, 1:] / distance[:, None]
    positions = jnp.array(RADAR.rx_positions), jnp.array(RADAR.tx_positions)
    receive, transmit = (
        jnp.exp(2j * jnp.pi * RADAR.spacing_wavelengths * direction @ p.T)
        for p in positions
    )
    samples = jnp.arange(RADAR.num_samples) / RADAR.sample_rate_hz
    offset_hz = RADAR.slope_hz_per_s * (samples + RADAR.adc_start_time_s)
    per_m = 2 * (RADAR.start_frequency_hz + offset_hz) / 299_792_458.0

    def chirp(index):
        tx = index % RADAR.num_tx
        now = distance + scatterers.velocity * index * RADAR.chirp_period_s
        beat = jnp.exp(2j * jnp.pi * jnp.mod(now[:, None] * per_m, 1.0))
        weight = scatterers.amplitude * transmit[:, tx]
        return (weight[:, None] * receive).T @ beat

    cube = jax.lax.map(chirp, jnp.arange(RADAR.num_chirps * RADAR.num_tx))
    cube = cube.reshape(RADAR.num_chirps, RADAR.num_tx, RADAR.num_rx, -1)
    return jnp.moveaxis(cube, 0, 2)


def _trimesh(setting, origins, directions):
    """Return a function that finds the first hits on the world's mesh."""
    import trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    solid = setting.scene.bodies[0].solid
    rays = RayMeshIntersector(
        trimesh.Trimesh(solid.vertices, solid.faces, process=False)
    )
    return lambda: rays.intersects_location(origins, directions, multiple_hits=False)
