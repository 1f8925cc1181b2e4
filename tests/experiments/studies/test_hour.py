"""The walk of an hour: where it goes, and what the radar sends."""

import numpy as np
import pytest

from experiments.studies import hour


def test_the_walk_goes_round_at_its_speed():
    xy, yaw = hour.path(3000)
    steps = np.linalg.norm(np.diff(xy, axis=0), axis=1)
    np.testing.assert_allclose(steps, hour.SPEED_MPS * hour.PERIOD_S, atol=1e-9)
    np.testing.assert_allclose(xy[1400], xy[0], atol=1e-9)  # after one round
    ahead = np.stack([np.cos(yaw), np.sin(yaw)], -1)[:-1]
    along = (np.diff(xy, axis=0) * ahead).sum(1) / steps
    assert np.median(along) > 0.999 and along.min() > -0.1  # it turns in corners


def test_points_are_of_the_walls_and_their_velocities_of_the_walk():
    recording = hour.walk(500)
    cloud = recording.points[300]
    assert len(cloud.xyz) == hour.POINTS
    world = np.asarray(cloud.xyz)[:, :2] + (30.0, 0)  # 30 m along the first side
    walls = [abs(world[:, 1] - y) for y in (-5, 5)]  # its sides, and those across
    walls += [abs(world[:, 0] - x) for x in (35, 45)]
    assert np.min(walls, axis=0).max() < 5 * hour.NOISE_M
    unit = cloud.xyz / np.linalg.norm(cloud.xyz, axis=1, keepdims=True)
    np.testing.assert_allclose(cloud.velocity, -unit[:, 0], atol=1e-6)


@pytest.mark.slow
def test_time_and_memory_are_written(tmp_path, capsys):
    assert hour.main(["-o", str(tmp_path), "--frames", "200"]) == 0
    assert "| 200 |" in (tmp_path / "hour.md").read_text()
    assert (tmp_path / "hour.png").stat().st_size > 1000
    assert "times as fast as recorded" in capsys.readouterr().out
