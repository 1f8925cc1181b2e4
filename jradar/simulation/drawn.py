"""Training frames of many places, simulated when they are prepared.

A recording on disk holds a walk through one scene. Here each frame has a layout or a
place of its own, and only the records are written. A `DrawnSource` opens as a
`Recording` whose frames are simulated on access, so `data.prepare_sources` prepares it
in any number of processes, and resumes.

The frames of one source share a radar unit (`draw_unit`). Radar and LiDAR look ahead at
the same time, and the truth uses the true mount: errors of clocks and mounts belong to
a user's rig, and should not be learned.

    jradar-sim-5        12,000 frames of ten kinds without a template, 3,200 of eight
                        older families, and 5,280 of real places, from six environments'
                        maps (`surfaces`); 24 frames of each to validate and to test
    jradar-sim-5-mini   8 frames of each for each split
    jradar-sim-5-row    3,776 frames of the kinds and families, of radars with one row
                        of antennas and RadarHD's chirp; they train
    jradar-sim-6        walks of 12 frames at 10 Hz through other places of the same
                        kinds: 30 of each kind, 10 of each older family, 20 of each
                        environment, with poses; 2 of each to validate and to test
    jradar-sim-6-mini   one walk of each for each split

A kind is the name of a sequence without its number: it can be left out of training. No
split shares a layout; runs of ColoRadar that validate or test do not train, but they
show the same buildings.
"""

import dataclasses
import functools
import itertools
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from jradar.errors import UsageError
from jradar.lidar import Poses
from jradar.radar import Radar, RadarSpec
from jradar.recordings.coloradar.maps import VOXEL_M, MapRun, open_run
from jradar.recordings.recording import Recording, Stream
from jradar.simulation.coloradar_writer import coupling
from jradar.simulation.hardware.hardware import Hardware, make_unit_hardware
from jradar.simulation.rig import PLATFORM_FROM_BASE, base_from, sensor_pose
from jradar.simulation.scanner import ouster_rays, scan
from jradar.simulation.scenes.kinds import KINDS, TUNNEL
from jradar.simulation.scenes.layouts import EYE_M, make_scene
from jradar.simulation.scenes.scene import Scene, cast, make_body, placements
from jradar.simulation.scenes.trajectory import pose_at, walk
from jradar.simulation.scenes.voxels import surfaces
from jradar.simulation.sequence import Setting, carried, radar_frame
from jradar.simulation.units import UnitSpec, draw_unit

FRAMES = 8  # of a source
WALK_FRAMES, WALK_HZ = 12, 10.0  # of a source that is a walk
WALK_MPS = 0.4  # most of a walk in a map, whose free place is small
OF_A_MAP = 4  # frames in the same part of a map
TIME_S, AHEAD_S = 0.2, 0.05  # of a frame; until the scanner looks ahead
VIEW, ROW_VIEW = np.radians((75, 90))  # half of it, to which rays are cast
WALK_M, FREE_M = 0.4, 0.3  # around a place of a map; beyond it, without a voxel
TRIES = 12  # places
REACH_M = 14.0  # of the part of a map
ASIDE = 0.5  # share of the frames in which the rig looks in any direction
LEAST_SEEN, ANGLES = 0.6, np.radians(np.linspace(-50, 50, 24))  # of a map
FIRST_SEED = 10_000  # of layouts; those of other sets lie below
NUMBERS = {"train": 0, "validation": 50_000, "test": 60_000}  # of sources
WALKS = {"train": 20_000, "validation": 55_000, "test": 65_000}  # of those of walks
OLDER = ("hallways", "mine", "lab", "outdoor", "corridor", "hall", "home", "forest")
NEWER = (*KINDS, TUNNEL)
# Floors, walls and other surfaces of ColoRadar's environments.
INDOORS = (("floor",), ("drywall", "drywall", "concrete", "wood", "metal"),
           ("wood", "metal", "plastic", "drywall"))  # fmt: skip
ROCK = (("rock",), ("rock", "rock", "concrete"), ("rock", "rock", "metal", "wood"))
OUTDOORS = (("asphalt", "grass"), ("brick", "concrete", "metal"),
            ("foliage", "grass", "concrete", "metal"))  # fmt: skip
ENVIRONMENTS = {
    "arpg_lab": INDOORS,
    "aspen": INDOORS,
    "ec_hallways": INDOORS,
    "edgar_army": ROCK,
    "edgar_classroom": ROCK,
    "outdoors": OUTDOORS,
}
RUNS = {  # of each environment, to validate and to test
    "validation": ("arpg_lab_run4", "aspen_run11", "ec_hallways_run4",
                   "edgar_army_run5", "edgar_classroom_run5", "outdoors_run9"),
    "test": ("arpg_lab_run3", "aspen_run10", "ec_hallways_run3",
             "edgar_army_run4", "edgar_classroom_run4", "outdoors_run8"),
}  # fmt: skip
NEVER = "_run0"  # the published test runs
# Sources of each newer kind, older family and environment, of training and of others.
DRAWN = {
    "jradar-sim-5": (150, 50, 110, 3),
    "jradar-sim-5-mini": (1, 1, 1, 1),
    "jradar-sim-6": (30, 10, 20, 2),
    "jradar-sim-6-mini": (1, 1, 1, 1),
}
OF_WALKS = ("jradar-sim-6", "jradar-sim-6-mini")
ROW_SOURCES = 28, 24  # of each newer kind and older family


class DrawnSource(NamedTuple):
    """A source of frames that are simulated on access; any process can open it."""

    name: str
    split: str
    kind: str
    number: int
    path: str = ""  # of a map, for a real place
    row: bool = False  # one row of antennas
    walk: bool = False  # all frames show one place, one after the other

    def open(self) -> Recording:
        """Return the recording; its frames are simulated on access."""
        radar = described(*_radar(self.name, self.row))
        walk = WALK_FRAMES, 1 / WALK_HZ
        count, step_s = walk if self.walk else (FRAMES, 0.0)
        found = recording_of(
            lambda k: _setting(self, 0 if self.walk else k),
            count,
            radar,
            name=self.name,
            view=ROW_VIEW if self.row else VIEW,
            step_s=step_s,
        )
        poses = _poses(self) if self.walk else None
        return found._replace(path=Path(self.path), poses=poses)

    def frames(self, recording: Recording, chosen: slice) -> range:
        """Return the numbers of the chosen frames."""
        return range(*chosen.indices(len(recording.cubes)))


def drawn_sources(name: str, *, maps: Path | str = "") -> tuple[DrawnSource, ...]:
    """Return the sources of a set; without a folder of `maps` it has no real places.

    Raises UsageError for an unknown set, and FileNotFoundError without the maps.
    """
    if name not in DRAWN:
        raise UsageError(f"set {name!r}, expected one of {', '.join(DRAWN)}")
    newer, older, mapped, few = DRAWN[name]
    walk = name in OF_WALKS
    found: list[DrawnSource] = []
    for split, first in (WALKS if walk else NUMBERS).items():
        for kinds, count in ((NEWER, newer), (OLDER, older)):
            numbers = range(first, first + (count if split == "train" else few))
            found += [
                DrawnSource(f"{kind}_{number:05d}", split, kind, number)
                for kind in kinds
                for number in numbers
            ]
        numbers = range(first, first + (mapped if split == "train" else few))
        for kind in ENVIRONMENTS if maps else ():
            runs = _runs(maps, kind, split)
            found += [
                DrawnSource(f"{kind}_{n:05d}", split, kind, n, str(runs[n % len(runs)]))
                for n in numbers
            ]
    return tuple(source._replace(walk=walk) for source in found)


def row_sources() -> tuple[DrawnSource, ...]:
    """Return the sources of `jradar-sim-5-row`, all of them to train on."""
    return tuple(
        DrawnSource(f"{kind}_{number:05d}", "train", kind, number, row=True)
        for kinds, count in zip((NEWER, OLDER), ROW_SOURCES, strict=True)
        for kind in kinds
        for number in range(count)
    )


def kind_of(sequence: str) -> str:
    """Return the kind of a sequence, by its name."""
    return sequence.rsplit("_", 1)[0]


def recording_of(
    setting_at: Callable[[int], Setting],
    frames: int,
    radar: Radar,
    *,
    name: str,
    view: float = VIEW,
    step_s: float = 0.0,
) -> Recording:
    """Return a recording whose frames each have a setting of their own.

    Frames are simulated on access. `radar` describes the radar of all settings. Scans
    cover `view` radians to either side. The frames of a walk are `step_s` apart in one
    setting.
    """
    seen = TIME_S + step_s * np.arange(frames)
    stamps = seen if step_s else np.arange(frames, dtype=float)
    return Recording(
        name=name,
        path=Path(),
        radar=radar,
        cubes=Stream(lambda k: _cube(setting_at(k), seen, k), frames, stamps),
        lidar=Stream(lambda k: _scan(setting_at(k), seen, k, view), frames, stamps),
        base_from_radar=base_from("single_chip"),
        base_from_lidar=base_from("lidar"),
    )


def described(radar: RadarSpec, hardware: Hardware) -> Radar:
    """Return the radar as its calibration files describe it."""
    channels = beats = None
    if (measured := hardware.calibration) is not None:
        channels = (measured[0, 0] / measured).astype(np.complex64)
        beats = (hardware.frequency - hardware.frequency[0, 0]).astype(np.float32)
    return Radar(radar, channels, beats, coupling(radar, hardware).astype(np.complex64))


def make_map_scene(
    kind: str, seed: int, run: MapRun, random: np.random.Generator
) -> Scene:
    """Return the surfaces around a random free place of the robot in a run's map.

    The rig walks around that place, looking in any direction. Patches have no order.
    """
    xyz = (run.lidar + 0.5) * VOXEL_M
    place, floor, apart = _free_place(random, run, xyz)
    near = xyz[apart < REACH_M] - [*place, floor]
    floors, walls, others = ENVIRONMENTS[kind]
    solid = surfaces(random, near, VOXEL_M, floors=floors, walls=walls, others=others)
    turn = random.uniform(0, 2 * np.pi) + np.pi / 2 * np.arange(4)
    way = WALK_M * np.stack([np.cos(turn), np.sin(turn)], -1)
    at_eye = np.column_stack([way, np.full(4, EYE_M)])
    platform = walk(random, at_eye, speed_mps=1.0, rounding_m=0.3, hand_held=True)
    return Scene(f"{kind}_{seed}", (make_body(random, solid),), platform)


def _free_place(random, run, xyz) -> Any:
    """Return a place without a voxel around it, its floor, and distances to voxels.

    The last of `TRIES` is taken as it is.
    """
    for tries in itertools.count(1):
        place = run.place(int(random.integers(len(run.lidar_in_patch))))
        apart = np.linalg.norm(xyz[:, :2] - place, axis=1)
        floor = floor_height(xyz[apart < 2.5, 2])
        above = xyz[apart < WALK_M + FREE_M, 2] - floor
        if tries == TRIES or not ((above > 0.3) & (above < 2.2)).any():
            return place, floor, apart


def floor_height(heights: np.ndarray) -> float:
    """Return the height of the lowest level with 40 % as many voxels as the fullest."""
    level = np.rint(heights / VOXEL_M - 0.5).astype(int)
    counts = np.bincount(level - level.min())
    lowest = np.flatnonzero(counts >= 0.4 * counts.max())[0] + level.min()
    return float((lowest + 0.5) * VOXEL_M)


@functools.lru_cache(maxsize=64)
def _radar(name: str, row: bool) -> tuple[RadarSpec, Hardware]:
    unit = _unit(name, row)
    radar = unit.radar()
    return radar, make_unit_hardware(unit, radar)


def _unit(name, row) -> UnitSpec:
    unit = draw_unit(zlib.crc32(name.encode()))
    return dataclasses.replace(unit, one_row=True, waveform="radarhd") if row else unit


@functools.lru_cache(maxsize=2)
def _scene(source: DrawnSource, frame: int) -> Scene:
    """Return a layout of this frame, or the part of a map that several frames share."""
    seed = FIRST_SEED + source.number * FRAMES + frame
    if not source.path:
        return make_scene(source.kind, seed)
    random = np.random.default_rng([seed, *source.kind.encode()])
    return make_map_scene(source.kind, seed, _run(source.path), random)


@functools.lru_cache(maxsize=2)
def _setting(source: DrawnSource, frame: int) -> Setting:
    """Return the scene of a frame, with the rig at a random place and direction."""
    scene = _scene(source, frame - frame % OF_A_MAP if source.path else frame)
    seed = FIRST_SEED + source.number * FRAMES + frame
    random = np.random.default_rng([seed, *source.name.encode()])
    start_m = random.uniform(0, scene.platform.length_m)
    scene = scene._replace(platform=scene.platform._replace(start_m=start_m))
    aside = random.random() < ASIDE
    yaw = random.uniform(-np.pi, np.pi) if aside or source.path else 0.0
    for _ in range(TRIES if source.path else 0):  # not into what was never mapped
        if _seen_share(scene, yaw) > LEAST_SEEN:
            break
        yaw = random.uniform(-np.pi, np.pi)
    unit = _unit(source.name, source.row)
    if source.walk and source.path:
        speed = min(WALK_MPS, unit.speed_mps or 0.0)
        unit = dataclasses.replace(unit, speed_mps=speed)
    setting = carried(scene, seed, unit, yaw_rad=yaw)
    return setting._replace(radars={"single_chip": _radar(source.name, source.row)})


def _seen_share(scene, yaw) -> float:
    """Return the share of level rays to the front that meet a surface."""
    (xyz, turn), angles = pose_at(scene.platform, TIME_S), yaw + ANGLES
    local = np.stack([np.cos(angles), np.sin(angles), 0 * angles], -1)
    starts = np.broadcast_to(xyz, local.shape)
    hits = cast(scene, placements(scene, TIME_S), starts, local @ turn.T)
    return float((hits.distance < REACH_M).mean())


def _cube(setting, seen, frame):
    """Return the samples of a frame; each of a walk has noise of its own."""
    number = frame if seen[frame] != TIME_S else 0
    pairs = radar_frame(setting, "single_chip", seen[frame], number)
    return np.asarray(pairs).astype(np.float32).view(np.complex64)[..., 0]


def _scan(setting, seen, frame, view):
    """Return the part of the LiDAR's scan that the radar can see."""
    directions, seconds = _rays(view)
    number = frame if seen[frame] != TIME_S else 0
    random = np.random.default_rng([setting.seed, 1, number])
    return scan(random, setting.scene, seen[frame] - AHEAD_S, directions, seconds)


@functools.cache  # a place takes a second to make, and sources are opened often
def _poses(source: DrawnSource) -> Poses:
    """Return the true poses of the base, from before the first frame to the last."""
    stamps = TIME_S + np.arange(-1, WALK_FRAMES + 1) / WALK_HZ
    xyz, turn = sensor_pose(_setting(source, 0).scene.platform, "base", stamps)
    return Poses(stamps, xyz, Rotation.from_matrix(turn).as_quat())


@functools.cache
def _rays(view):
    directions, seconds = ouster_rays()
    ahead = directions @ (PLATFORM_FROM_BASE @ base_from("lidar")[:3, :3]).T
    front = np.abs(np.arctan2(ahead[:, 1], ahead[:, 0])) < view
    return directions[front], seconds[front]


@functools.lru_cache(maxsize=2)
def _run(path: str) -> MapRun:
    return open_run(Path(path))


def _runs(folder, kind, split) -> list[Path]:
    """Return the packed runs of an environment in a split, never `run0`."""
    runs = sorted(p for p in Path(folder).glob(f"{kind}_run*.npz") if _known(p, split))
    if not runs:
        raise FileNotFoundError(
            f"{folder} contains no {kind}_runN.npz to {split}: expected packed runs of "
            "ColoRadar's maps"
        )
    return runs


def _known(path, split) -> bool:
    kept = (*RUNS["validation"], *RUNS["test"])
    if path.stem.endswith(NEVER):
        return False
    return path.stem in RUNS[split] if split in RUNS else path.stem not in kept
