"""How many simulated frames per second, and where does the time go?

    python -m benchmarks.bench_simulation [FAMILY]     a table of one scene's steps

`benchmarks.run` compares the forward model with a sum that computes a phasor for each
sample of each chirp, and a LiDAR scan with trimesh's first hits.
"""

import functools
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.harness import Case, available
from jradar.radar import RadarSpec, Scatterers, simulate_cube
from jradar.simulation import make_setting, simulate_sequence
from jradar.simulation.hardware.hardware import sample_frame
from jradar.simulation.paths.propagation import radar_paths
from jradar.simulation.scanner import ouster_rays, scan
from jradar.simulation.scenes.scene import cast, placements

RADAR = RadarSpec.awr1843()
TIME_S = 1.0
FRAMES = 20


def cases() -> Iterator[Case]:
    """Yield the forward model at two sizes, and the rays of a scan."""
    for count in (256, 1024):
        scatterers = _scatterers(count)
        key = jax.random.key(0)
        yield Case(
            f"ADC cube of {count} scatterers, 12 x 128 x 128",
            functools.partial(simulate_cube, key, scatterers, RADAR),
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


def main(family: str = "hallways") -> None:
    """Print frames per second and the share of each step."""
    setting = make_setting(family, 0)
    radar, hardware = setting.radars["single_chip"]
    directions, seconds = ouster_rays()
    key, scene = jax.random.key(0), setting.scene
    random = np.random.default_rng(0)
    find_paths = functools.partial(
        radar_paths, scene, setting.reflectors, "single_chip", TIME_S, radar
    )
    measure = functools.partial(scan, random, scene, TIME_S, directions, seconds)
    paths = find_paths()
    frame, cloud = np.asarray(sample_frame(key, paths, hardware, radar)), measure()
    with tempfile.TemporaryDirectory() as folder:
        steps = {
            "paths of the radar": find_paths,
            f"samples of {len(paths.power)} paths": lambda: np.asarray(
                sample_frame(key, paths, hardware, radar)
            ),
            "LiDAR scan": measure,
            "writing": lambda: [
                item.tofile(Path(folder) / f"{k}.bin")
                for k, item in enumerate((frame, cloud))
            ],
        }
        print("| step | wall (ms) | processor (ms) |\n|---|---|---|")
        for name, step in steps.items():
            wall, processor = _median(step)
            print(f"| {name} | {wall:.1f} | {processor:.1f} |")
        ticks: list[float] = []

        def advance():
            ticks.append(time.perf_counter())

        simulate_sequence(family, 0, folder, frames=FRAMES, advance=advance)
        rate = (len(ticks) - 2) / (ticks[-1] - ticks[1])
        print(f"\n{family}: {rate:.1f} frames/s of radar and LiDAR, written to disk")


def _median(step) -> tuple[float, float]:
    """Return the median milliseconds of the clock and of all processors."""
    times = []
    for _ in range(10):
        begin = time.perf_counter(), time.process_time()
        step()
        times.append((time.perf_counter() - begin[0], time.process_time() - begin[1]))
    wall, processor = 1e3 * np.median(times, axis=0)
    return float(wall), float(processor)


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


if __name__ == "__main__":
    main(*sys.argv[1:])
