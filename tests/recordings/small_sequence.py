"""A small sequence in ColoRadar's layout: a room with a pillar, byte by byte."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from jradar.radar import Scatterers, simulate_cube
from jradar.recordings.coloradar.calib import radar_from_coloradar
from jradar.simulation.coloradar_writer import write_rows, write_stamps as write_stamps
from tests.recordings.coloradar_writer import write, write_calib

SIZES = (3, 4, 16, 64)  # tx, rx, chirps, samples
ANTENNAS = "F_design 76.8\nrx 0 0 0\nrx 1 1 0\nrx 2 2 0\nrx 3 3 0\n"
ANTENNAS += "tx 0 0 0\ntx 1 4 0\ntx 2 2 1\n"
AT_BASE = dict.fromkeys(("single_chip", "lidar"), "0 0 0\n0 0 0 1\n")
SIDE = 5.0  # metres from the radar to each wall
PILLAR = np.array([3.0, 0.8])


def room_scan(rng) -> np.ndarray:
    """[point, 4] of a square room's walls, floor and ceiling, and a round pillar."""
    azimuth, elevation = np.meshgrid(
        np.linspace(-np.pi, np.pi, 240, endpoint=False), np.linspace(-0.3, 0.3, 24)
    )
    wall = SIDE / np.maximum(abs(np.cos(azimuth)), abs(np.sin(azimuth)))
    ground = np.minimum(wall, 1.2 / np.maximum(abs(np.tan(elevation)), 1e-6))
    turn = np.arctan2(PILLAR[1], PILLAR[0])
    ground = np.where(abs(azimuth - turn) < 0.06, np.hypot(*PILLAR), ground)
    xyz = np.array([np.cos(azimuth), np.sin(azimuth), np.tan(elevation)]) * ground
    scan = np.stack([*xyz, np.full_like(ground, 100.0)], -1).reshape(-1, 4)
    scan[:, :3] += rng.normal(0, 0.01, (len(scan), 3))
    scan[::50] = 0  # missing returns
    return scan.astype("<f4")


def room_echoes(rng) -> Scatterers:
    """The wall ahead and the pillar."""
    y, z = rng.uniform(-3, 3, 40), rng.uniform(-1, 1, 40)
    wall = np.stack([np.full(40, SIDE), y, z], -1)
    pillar = np.stack([*np.tile(PILLAR, (10, 1)).T, rng.uniform(-0.8, 0.8, 10)], -1)
    xyz = np.concatenate([wall, pillar])
    amplitude = jnp.full(50, 50.0, jnp.float32)
    return Scatterers(jnp.asarray(xyz, jnp.float32), jnp.zeros(50), amplitude)


def write_sequence(root: Path, name="run0", frames=6, lidar_delay=0.01, seed=0) -> Path:
    """Write a sequence below `root`, creating calib/ if missing."""
    calib = root / "calib"
    if not calib.is_dir():
        write_calib(calib, transforms=AT_BASE, sizes=SIZES, antennas=ANTENNAS)
    radar = radar_from_coloradar(calib / "single_chip")
    rng = np.random.default_rng(seed)
    folder = root / name
    stamps = 1000.0 + 0.1 * np.arange(frames)
    adc, lidar = folder / "single_chip" / "adc_samples", folder / "lidar"
    for i in range(frames):
        key = jax.random.key(seed * 1000 + i)
        cube = simulate_cube(key, room_echoes(rng), radar, noise_power=100.0)
        samples = np.stack([cube.real, cube.imag], -1).round().astype("<i2")
        write(adc / "data" / f"frame_{i}.bin", samples.tobytes())
        scan = room_scan(rng).tobytes()
        write(lidar / "pointclouds" / f"lidar_pointcloud_{i}.bin", scan)
    write_stamps(adc, stamps)
    write_stamps(lidar, stamps + lidar_delay)
    poses = 1000.0 - 0.5 + 0.05 * np.arange(20 + 2 * frames)
    write_stamps(folder / "groundtruth", poses)
    rows = np.array([[0.5 * (t - 1000), 0, 0, 0, 0, 0, 1] for t in poses])
    write_rows(folder / "groundtruth" / "groundtruth_poses.txt", rows)
    return folder


def write_splits(root: Path, splits: dict[str, str]) -> None:
    """A `splits.json`."""
    (root / "splits.json").write_text(json.dumps(splits))
