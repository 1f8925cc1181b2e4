"""A bag of a radar's own clouds: a drive past points at rest comes back."""

import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.motion import cloud_velocities, odometry
from jradar.recordings import holds_radar_clouds, open_radar_clouds, open_recording
from tests.recordings import bag_writer
from tests.recordings.bag_writer import CLOUD, CONTAINERS, START, TENTH, write_bag

VELOCITY = np.array([1.5, 0.4, 0.1])  # m/s, of the radar along its axes
FIELDS = [(name, 7, "f") for name in ("x", "y", "z", "Doppler", "snr")]


@pytest.fixture
def fields(monkeypatch):
    monkeypatch.setattr(bag_writer, "FIELDS", FIELDS)


def cloud(rng, count=40, *, flat=False):
    """Points at rest, and one that moves, as the radar sees them."""
    xyz = rng.uniform((2, -3, -1), (8, 3, 1), (count, 3))
    if flat:
        xyz[:, 2] = 0
    doppler = -(xyz / np.linalg.norm(xyz, axis=1, keepdims=True)) @ VELOCITY
    doppler[0] += 3.0
    table = np.column_stack([xyz, doppler, rng.uniform(10, 20, count)])
    return dict(zip((name for name, *_ in FIELDS), table.T, strict=True))


def bag(folder, container="mcap", *, topics=("/radar",), **options):
    rng = np.random.default_rng(0)
    messages = [
        (topic, CLOUD, stamp, bag_writer.point_cloud2(cloud(rng, **options), stamp))
        for topic in topics
        for stamp in range(START, START + 20 * TENTH, TENTH)
    ]
    return write_bag(folder, container, sorted(messages, key=lambda m: m[2]))


@pytest.mark.parametrize("container", CONTAINERS)
def test_a_drive_past_points_at_rest_comes_back(tmp_path, fields, container):
    path = bag(tmp_path / "a", container)
    assert holds_radar_clouds(path)
    found = open_radar_clouds(path)
    assert (found.topic, found.field, len(found.clouds)) == ("/radar", "Doppler", 20)
    velocities = cloud_velocities(found)
    np.testing.assert_allclose(velocities.velocity - VELOCITY, 0, atol=1e-3)
    assert (velocities.points == 40).all() and (velocities.moving == 1).all()
    walk = odometry(found, velocities, rotation="none")
    reached = walk.world_from_base[-1, :3, 3]
    np.testing.assert_allclose(reached, 1.9 * VELOCITY, rtol=1e-3)


def test_clouds_without_heights_are_followed_in_their_plane(tmp_path, fields):
    found = open_radar_clouds(bag(tmp_path / "a", flat=True))
    assert not found.has_elevation
    velocity = cloud_velocities(found, frames=slice(5)).velocity
    np.testing.assert_allclose(velocity, [(*VELOCITY[:2], 0)] * 5, atol=1e-3)


def test_of_several_topics_one_is_named(tmp_path, fields):
    path = bag(tmp_path / "a", topics=("/front", "/rear"))
    with pytest.raises(UsageError, match=r"2 topics .*or the name of one.*/rear \(x"):
        open_radar_clouds(path)
    assert open_radar_clouds(path, topic="/rear").topic == "/rear"


def test_clouds_without_a_velocity_name_their_fields(tmp_path):
    columns, stamp = bag_writer.columns(5), START
    make = bag_writer.point_cloud2(columns, stamp)
    path = write_bag(tmp_path / "a", "mcap", [("/lidar", CLOUD, stamp, make)])
    with pytest.raises(
        UsageError, match=r"0 topics .* named velocity.*/lidar \(z, int"
    ):
        open_radar_clouds(path)
    assert not holds_radar_clouds(tmp_path)


def test_other_commands_say_what_the_bag_holds(tmp_path, fields):
    path = bag(tmp_path / "a")
    with pytest.raises(UsageError, match=r"bag of point clouds.*jradar odometry"):
        open_recording(path)


def test_the_command_writes_the_trajectory(tmp_path, fields, capsys):
    from jradar.cli import main

    path, out = bag(tmp_path / "a"), tmp_path / "walk.tum"
    assert main(["odometry", str(path), "-o", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "/radar" in shown and "2.9" in shown  # metres
    assert len(out.read_text().splitlines()) == 21
    assert main(["odometry", str(path), "-o", str(out), "--frames", "0:1"]) == 2
    assert "1 clouds, expected 2 or more" in capsys.readouterr().err
