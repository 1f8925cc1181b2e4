"""LiDARs in a scene: rays cast while the head turns and the rig moves.

Every ray starts where the sensor is at the time of the ray; bodies stand where they are
in the middle of the scan. The strength of a return falls with the square of the range,
and with the cosine of incidence and the albedo; weak returns are lost. Glass returns a
ray only head-on and lets it pass otherwise. A lost return is (0, 0, 0, 0), as in the
files of the Ouster's driver.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from jradar.simulation.rig import sensor_pose
from jradar.simulation.scenes.materials import MATERIALS
from jradar.simulation.scenes.scene import NUDGE_M, Scene, cast, placements

PANES = 2  # of glass that a ray passes at most
PANE_TRANSMISSION = 0.8  # of one pane, both ways
PANE_HEAD_ON = 0.998  # cosine above which a pane returns the ray


@dataclasses.dataclass(frozen=True)
class ScannerSpec:
    """A LiDAR; the defaults describe an Ouster OS1-64 (gen 1).

    At `reach_m` an albedo of 0.1, hit head-on, returns every second ray.
    """

    name: str = "lidar"  # on the rig
    period_s: float = 0.1
    least_range_m: float = 0.5
    reach_m: float = 45.0
    noise_m: float = 0.012
    fading_db: float = 2.0  # standard deviation of a return's strength


OUSTER = ScannerSpec()
MID360 = ScannerSpec(name="livox", least_range_m=0.1, reach_m=40.0, noise_m=0.02)
OUSTER_ROWS, OUSTER_COLUMNS = 64, 1024
MID360_POINTS, MID360_LINES = 20_000, 4


def ouster_rays() -> tuple[Float[np.ndarray, "65536 3"], Float[np.ndarray, " 65536"]]:
    """Return directions and times of a scan, row by row, each clockwise from x."""
    elevation = np.radians(np.linspace(16.6, -16.6, OUSTER_ROWS))[:, None]
    column = np.arange(OUSTER_COLUMNS)
    directions = _directions(-2 * np.pi * column / OUSTER_COLUMNS, elevation)
    seconds = np.tile(column * OUSTER.period_s / OUSTER_COLUMNS, OUSTER_ROWS)
    return directions.reshape(-1, 3), seconds


def mid360_rays(
    frame: int,
) -> tuple[Float[np.ndarray, "20000 3"], Float[np.ndarray, " 20000"]]:
    """Return directions and times of a frame: 360 x (-7 .. 52) degrees.

    Four lines draw a rosette that never repeats. Livox does not publish the pattern;
    this one covers the same field of view with the same number of points.
    """
    seconds = np.arange(MID360_POINTS) * MID360.period_s / MID360_POINTS
    time_s = seconds + frame * MID360.period_s
    line = np.arange(MID360_POINTS) % MID360_LINES
    azimuth = 2 * np.pi * (29.3 * time_s + line / MID360_LINES)
    swing = np.arcsin(np.sin(2 * np.pi * 29.3 * 7 * (5**0.5 - 1) / 2 * time_s + line))
    elevation = np.radians(22.5 + 29.5 * swing / (np.pi / 2))
    return _directions(azimuth, elevation), seconds


def scan(
    random: np.random.Generator,
    scene: Scene,
    time_s: float,
    directions: Float[np.ndarray, "ray 3"],
    seconds: Float[np.ndarray, " ray"],
    *,
    scanner: ScannerSpec = OUSTER,
) -> Float[np.ndarray, "ray 4"]:
    """Return x, y, z (metres) and intensity of each ray, in the sensor's frame.

    `seconds` are the times of the rays after the start of the scan at `time_s`. Points
    are relative to the sensor's place at the time of their ray.
    """
    places = placements(scene, time_s + scanner.period_s / 2)
    when, ray_time = np.unique(seconds, return_inverse=True)
    if len(when) > OUSTER_COLUMNS:  # 20 rays, 0.1 ms apart, share a pose
        when, ray_time = when[::20], ray_time // 20
    xyz, turn = sensor_pose(scene.platform, scanner.name, time_s + when)
    origins = xyz.astype(np.float32)[ray_time]
    local = directions.astype(np.float32)
    world = np.einsum("rij,rj->ri", turn.astype(np.float32)[ray_time], local)
    distance, strength = _returns(scene, places, origins, world)

    fading = 10 ** (scanner.fading_db / 10 * random.standard_normal(len(local)))
    signal = strength * scanner.reach_m**2 / 0.1 / np.maximum(distance, 0.1) ** 2
    weak = np.clip(1 / np.maximum(signal, 1e-6), 0, 4) ** 0.5  # noisier where weaker
    noise = scanner.noise_m * (1 + weak) * random.standard_normal(len(local))
    heard = signal * fading > 1
    heard &= (distance > scanner.least_range_m) & np.isfinite(distance)
    measured = np.where(heard, distance + noise, 0.0)
    intensity = np.where(heard, np.minimum(5 * np.sqrt(signal * fading), 2000), 0.0)
    cloud = np.column_stack([measured[:, None] * local, np.rint(intensity)])
    return cloud.astype(np.float32)


def _returns(scene, places, origins, directions):
    """Return the distance of each return, and albedo times cosine there."""
    albedo = np.array([material.albedo for material in MATERIALS])
    clear = np.array([material.clear for material in MATERIALS])
    hits = cast(scene, places, origins, directions)
    distance = hits.distance.astype(float)
    strength = np.where(hits.body < 0, 0.0, albedo[hits.material] * hits.cosine)
    live = np.flatnonzero((hits.body >= 0) & clear[hits.material])
    cosine, passed = hits.cosine[live], 1.0
    for _ in range(PANES):
        head_on = cosine > PANE_HEAD_ON
        strength[live[head_on]] = passed
        live, passed = live[~head_on], passed * PANE_TRANSMISSION
        if not live.size:
            break
        start = distance[live] + NUDGE_M
        begin = origins[live] + start[:, None].astype(np.float32) * directions[live]
        hits = cast(scene, places, begin, directions[live])
        distance[live] = start + hits.distance
        glass = (hits.body >= 0) & clear[hits.material]
        found = np.where(hits.body < 0, 0.0, albedo[hits.material] * hits.cosine)
        strength[live] = passed * found
        live, cosine = live[glass], hits.cosine[glass]
    return distance, strength


def _directions(azimuth, elevation):
    ground, z = np.cos(elevation), np.sin(elevation)
    xyz = np.broadcast_arrays(ground * np.cos(azimuth), ground * np.sin(azimuth), z)
    return np.stack(xyz, -1)
