"""A bag of a radar's own points: fields by name, clocks, and a drive past points."""

import struct
from functools import partial

import numpy as np
import pytest

from jradar.errors import UsageError
from jradar.motion import frame_velocities, odometry
from jradar.recordings import (
    holds_points,
    is_recording,
    nearest_scan,
    open_recording,
)
from tests.recordings import bag_writer
from tests.recordings.bag_writer import CLOUD, CONTAINERS, START, TENTH, write_bag

VELOCITY = np.array([1.5, 0.4, 0.1])  # m/s, of the radar along its axes
ODOMETRY, TF = "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"
SCAN = "radar_msgs/msg/RadarScan"
RETURN = "radar_msgs/msg/RadarReturn"
SCAN_FIELDS = ("range", "azimuth", "elevation", "doppler_velocity", "amplitude")
DEFINITIONS = {
    RETURN: "\n".join(f"float32 {name}" for name in SCAN_FIELDS) + "\n",
    SCAN: "std_msgs/Header header\nradar_msgs/RadarReturn[] returns\n",
}


def named(*names):
    return [(name, 7, "f") for name in ("x", "y", "z", *names)]


@pytest.fixture
def fields(monkeypatch):
    monkeypatch.setattr(bag_writer, "FIELDS", named("Doppler", "snr"))


def table(rng, count=40, *, flat=False):
    """Points at rest, and one that moves, as the radar sees them: x y z, v, SNR."""
    xyz = rng.uniform((2, -3, -1), (8, 3, 1), (count, 3))
    if flat:
        xyz[:, 2] = 0
    doppler = -(xyz / np.linalg.norm(xyz, axis=1, keepdims=True)) @ VELOCITY
    doppler[:1] += 3.0
    return np.column_stack([xyz, doppler, rng.uniform(10, 20, count)])


def columns(points):
    names = (name for name, *_ in bag_writer.FIELDS)
    return dict(zip(names, points.T, strict=True))


def bag(folder, container="mcap", *, topics=("/radar",), frames=None, late=0, **more):
    rng = np.random.default_rng(0)
    frames = frames or [table(rng, **more) for _ in range(20)]
    messages = []
    for at, points in enumerate(frames):
        stamp = START + at * TENTH
        make = bag_writer.point_cloud2(columns(points), stamp - late)
        messages += [(topic, CLOUD, stamp, make) for topic in topics]
    return write_bag(folder, container, messages)


@pytest.mark.parametrize("container", CONTAINERS)
def test_points_come_back_with_their_fields(tmp_path, fields, container):
    points = table(np.random.default_rng(1))
    path = bag(tmp_path / "a", container, frames=[points] * 3)
    assert holds_points(path)
    found = open_recording(path)
    (cloud, *_), taken = found.points, dict(found.fields)
    np.testing.assert_allclose(cloud.xyz, points[:, :3], rtol=1e-6)
    np.testing.assert_allclose(cloud.velocity, points[:, 3], rtol=1e-5)
    np.testing.assert_allclose(cloud.snr, 10 ** (points[:, 4] / 10), rtol=1e-5)
    assert cloud.power is None and not len(found.cubes) and found.radar is None
    assert taken["velocity"].startswith("Doppler") and taken["snr"] == "snr (dB)"
    np.testing.assert_allclose(np.diff(found.points.stamps), 0.1, rtol=1e-5)


def test_a_drive_past_points_at_rest_comes_back(tmp_path, fields):
    found = open_recording(bag(tmp_path / "a"))
    velocities = frame_velocities(found)
    np.testing.assert_allclose(velocities.velocity - VELOCITY, 0, atol=1e-3)
    assert (velocities.points == 40).all() and (velocities.moving == 1).all()
    walk = odometry(found, velocities, rotation="none")
    reached = walk.world_from_base[-1, :3, 3]
    np.testing.assert_allclose(reached, 1.9 * VELOCITY, rtol=1e-3)


def test_points_without_heights_are_followed_in_their_plane(tmp_path, fields):
    found = open_recording(bag(tmp_path / "a", flat=True))
    assert not found.has_elevation
    velocity = frame_velocities(found, frames=range(5)).velocity
    np.testing.assert_allclose(velocity, [(*VELOCITY[:2], 0)] * 5, atol=1e-3)


def test_of_several_topics_one_is_named(tmp_path, fields):
    path = bag(tmp_path / "a", topics=("/front", "/rear"))
    with pytest.raises(UsageError, match=r"2 topics .*or the name of one.*/rear \(x"):
        open_recording(path)
    found = open_recording(path, topic="/rear")
    assert "on the topic /rear" in found.notes[0] and found.lidar is None


def test_a_lidar_is_a_radar_only_by_name(tmp_path):
    make = bag_writer.point_cloud2(bag_writer.columns(5), START)
    path = write_bag(tmp_path / "a", "mcap", [("/lidar", CLOUD, START, make)])
    assert not is_recording(path)
    with pytest.raises(UsageError, match=r"0 topics .*velocity.*/lidar \(z, int"):
        open_recording(path)
    assert len(open_recording(path, topic="/lidar").points) == 1


@pytest.mark.parametrize(
    ("names", "quantity", "taken"),
    [
        (("v_doppler_mps", "snr_db"), "velocity", "v_doppler_mps"),
        (("radial_speed", "RCS"), "velocity", "radial_speed"),
        (("range_rate", "RCS"), "power", "RCS"),
        (("velocity", "intensity"), "power", "intensity"),
        (("vel", "power"), "power", "power"),
    ],
)
def test_drivers_name_their_fields_in_many_ways(
    tmp_path, monkeypatch, names, quantity, taken
):
    monkeypatch.setattr(bag_writer, "FIELDS", named(*names))
    found = open_recording(
        bag(tmp_path / "a", frames=[table(np.random.default_rng(0))])
    )
    assert dict(found.fields)[quantity].split()[0] == taken


def test_another_clock_becomes_the_recorders(tmp_path, fields):
    late = 338_524 * 10**9
    stamps = range(START, START + 20 * TENTH, TENTH)
    rng = np.random.default_rng(0)
    points = [table(rng) for _ in stamps]
    messages = [
        ("/radar", CLOUD, s, bag_writer.point_cloud2(columns(p), s))
        for s, p in zip(stamps, points, strict=True)
    ]
    record = np.array([0, 0, 9.8, 0, 0, 0])
    imu = [
        ("/imu", bag_writer.IMU, s, bag_writer.imu(record, s - late)) for s in stamps
    ]
    path = write_bag(tmp_path / "a", "mcap", sorted(messages + imu, key=lambda m: m[2]))
    found = open_recording(path)
    assert found.imu is not None
    np.testing.assert_allclose(found.imu.stamps, found.points.stamps, atol=1e-5)
    assert any("338,524.000 s behind" in note for note in found.notes)


def scan_messages(points):
    """A RadarScan of the points, written by the definition."""
    xyz, (velocity, snr) = points[:, :3], points[:, 3:].T
    distance = np.linalg.norm(xyz, axis=1)
    rows = np.column_stack(
        [
            *(distance, np.arctan2(xyz[:, 1], xyz[:, 0])),
            *(np.arcsin(xyz[:, 2] / distance), velocity, snr),
        ]
    )

    def make(store):
        returns = [store.types[RETURN](*map(float, row)) for row in rows]
        return store.types[SCAN](bag_writer.header(store, START, "radar"), returns)

    return [("/scan", SCAN, START, make)]


@pytest.mark.parametrize("container", CONTAINERS)
def test_a_radar_scan_has_angles(tmp_path, container):
    for name, text in DEFINITIONS.items():
        register(container, name, text)
    points = table(np.random.default_rng(2))
    found = open_recording(write_bag(tmp_path / "a", container, scan_messages(points)))
    (cloud,) = found.points
    np.testing.assert_allclose(cloud.xyz, points[:, :3], atol=1e-5)
    np.testing.assert_allclose(cloud.velocity, points[:, 3], rtol=1e-5)
    np.testing.assert_allclose(cloud.power, 10 ** (points[:, 4] / 10), rtol=1e-4)


def test_odd_points_are_named_and_nothing_else_is_lost(tmp_path, fields):
    good = table(np.random.default_rng(0))
    nan, empty = good.copy(), good[:0]
    nan[3, 0], nan[5, 3] = np.nan, np.inf
    found = open_recording(bag(tmp_path / "a", frames=[good, nan, empty]))
    assert [len(cloud.valid) for cloud in found.points] == [40, 38, 0]
    notes = " ".join(found.notes)
    assert "2 of 80 points are NaN" in notes and "1 of 3 frames" in notes


def test_the_command_writes_the_trajectory(tmp_path, fields, capsys):
    from jradar.cli import main

    path, out = bag(tmp_path / "a"), tmp_path / "walk.tum"
    assert main(["odometry", str(path), "-o", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "/radar" in shown and "2.9" in shown  # metres
    assert len(out.read_text().splitlines()) == 21
    assert main(["odometry", str(path), "-o", str(out), "--frames", "0:1"]) == 2
    assert "1 of frames 0 to 19 are chosen, expected 2" in capsys.readouterr().err


def test_commands_that_need_samples_name_those_that_take_points(
    tmp_path, fields, capsys
):
    from jradar.cli import main

    path = str(bag(tmp_path / "a"))
    for command, output in (
        ("points", "out"),
        ("calibrate", "out.toml"),
        ("replay", ""),
    ):
        options = ["-o", str(tmp_path / output)] if output else []
        assert main([command, path, *options]) == 2
        lines = capsys.readouterr().err.strip().splitlines()
        assert len(lines) == 1 and "`score` and `live` take points" in lines[0]


def test_real_bag_of_a_carried_radar(samples):
    path = samples / "reve/demo_ti_mmwave_rospkg_format.bag"
    found = open_recording(path)
    assert len(found.points) == 412 and found.imu is not None
    inside = found.imu.stamps[[0, -1]] - found.points.stamps[[0, -1]]
    assert -0.5 < inside[0] < 0.1 and -0.1 < inside[1] < 0.5
    assert any("338,524.892 s behind" in note for note in found.notes)
    assert dict(found.fields)["power"] == "intensity (dB)"


def test_real_bag_of_packets_without_stamps(samples):
    found = open_recording(samples / "ars430/side_to_side_movement.bag")
    assert len(found.points) == 1304  # of 2,783 packets
    assert any("headers are zero" in note for note in found.notes)
    np.testing.assert_allclose(
        np.median(np.diff(found.points.stamps)), 0.036, atol=1e-3
    )
    first = found.points[0]
    assert len(first.valid) == 25
    np.testing.assert_allclose(first.xyz[0], (6.9627972, 0.10214554, 0))


def test_a_scan_that_is_cut_off_is_a_clear_error(tmp_path):
    head = struct.pack("<4sIIII", b"\0\1\0\0", 1, 1, 1, 0)
    raw = head + struct.pack("<I", 9) + bytes(20)
    path = write_bag(tmp_path / "a", "mcap", [("/s", SCAN, START, lambda _: raw)])
    with pytest.raises(ValueError, match="9 points of 20 bytes do not fit"):
        open_recording(path)


def robot(store, kind, stamp, base="base_link"):
    """Odometry that moves along x, or the places of the sensors on the robot."""
    types = store.types
    vector, turn = (
        types["geometry_msgs/msg/Vector3"],
        types["geometry_msgs/msg/Quaternion"],
    )
    ahead = turn(0.0, 0.0, 0.0, 1.0)
    if kind == ODOMETRY:
        point = types["geometry_msgs/msg/Point"](1e-9 * (stamp - START), 0.0, 0.0)
        pose = types["geometry_msgs/msg/Pose"](point, ahead)
        twist = types["geometry_msgs/msg/Twist"](vector(0.0, 0, 0), vector(0.0, 0, 0))
        head = bag_writer.header(store, stamp, "odom")
        return types[ODOMETRY](
            *(head, base),
            types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
            types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
        )
    places = [("base_link", "mast", 1.0), ("mast", "livox_frame", 0.25)]
    return types[TF](
        [
            types["geometry_msgs/msg/TransformStamped"](
                *(bag_writer.header(store, stamp, parent), child),
                types["geometry_msgs/msg/Transform"](vector(0.0, 0.0, up), ahead),
            )
            for parent, child, up in places
        ]
    )


def register(container, name, text):
    """Let the writer of a container know a type, if it does not."""
    from rosbags.typesys import get_types_from_msg

    store, types = bag_writer.STORES[container], get_types_from_msg(text, name)
    store.register({k: v for k, v in types.items() if k not in store.types})


@pytest.mark.parametrize("container", CONTAINERS)
def test_the_rest_of_a_robots_bag_belongs_to_the_recording(tmp_path, fields, container):
    register(container, TF, "geometry_msgs/TransformStamped[] transforms\n")
    points = columns(table(np.random.default_rng(0)))
    stamps = range(START, START + 5 * TENTH, TENTH)
    scan = bag_writer.livox(bag_writer.livox_rows(7), START)
    messages = [("/tf_static", TF, START, partial(robot, kind=TF, stamp=START))]
    for stamp in stamps:
        make = bag_writer.point_cloud2(points, stamp)
        walk = partial(robot, kind=ODOMETRY, stamp=stamp)
        messages += [("/radar", CLOUD, stamp, make), ("/odom", ODOMETRY, stamp, walk)]
        scan = bag_writer.livox(bag_writer.livox_rows(7), stamp)
        messages += [("/scan", bag_writer.LIVOX, stamp, scan)]
    found = open_recording(write_bag(tmp_path / "a", container, messages))
    assert found.poses is not None and found.lidar is not None and found.imu is None
    np.testing.assert_allclose(found.poses.xyz[:, 0], 0.1 * np.arange(5), atol=1e-6)
    up = np.eye(4)
    up[2, 3] = 1.25  # all sensors of these messages are in one frame
    np.testing.assert_allclose(found.base_from_radar, up)
    np.testing.assert_allclose(found.base_from_lidar, up)
    scan = nearest_scan(found, 3)
    assert scan is not None and len(scan) == 7


def moved(store, stamp, length=1.0):
    """The frames of a robot that moves along x: a fixed one is sent each time, too."""
    types = store.types
    vector = types["geometry_msgs/msg/Vector3"]
    ahead = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, length)
    metres = 1e-9 * (stamp - START)
    return types[TF](
        [
            types["geometry_msgs/msg/TransformStamped"](
                *(bag_writer.header(store, stamp, parent), child),
                types["geometry_msgs/msg/Transform"](vector(*xyz), ahead),
            )
            for parent, child, xyz in [
                ("odom", "base_link", (metres, 0.0, 0.0)),
                ("base_link", "livox_frame", (0.0, 0.5, 1.0)),
            ]
        ]
    )


def moving_bag(folder, length=1.0):
    points, messages = columns(table(np.random.default_rng(0))), []
    for stamp in range(START, START + 5 * TENTH, TENTH):
        frames = partial(moved, stamp=stamp, length=length)
        make = bag_writer.point_cloud2(points, stamp)
        messages += [("/radar", CLOUD, stamp, make), ("/tf", TF, stamp, frames)]
    return open_recording(write_bag(folder, "mcap", messages))


def test_without_odometry_poses_come_from_frames_that_move(tmp_path, fields):
    register("mcap", TF, "geometry_msgs/TransformStamped[] transforms\n")
    found = moving_bag(tmp_path / "a")
    np.testing.assert_allclose(found.poses.xyz[:, 0], 0.1 * np.arange(5), atol=1e-6)
    np.testing.assert_allclose(found.base_from_radar[:3, 3], (0, 0.5, 1))
    assert "poses are those of base_link in odom, on the topic /tf" in found.notes


def test_frames_that_are_no_rotations_are_left_out_with_a_note(tmp_path, fields):
    register("mcap", TF, "geometry_msgs/TransformStamped[] transforms\n")
    found = moving_bag(tmp_path / "a", length=3.0)
    assert found.poses is None and found.base_from_radar is None
    assert any(
        "places are left out" in n and "not a rotation" in n for n in found.notes
    )


def test_two_lidars_are_named_and_none_is_used(tmp_path, fields):
    make = bag_writer.point_cloud2(columns(table(np.random.default_rng(0))), START)
    scan = bag_writer.livox(bag_writer.livox_rows(7), START)
    messages = [("/radar", CLOUD, START, make)]
    messages += [(name, bag_writer.LIVOX, START, scan) for name in ("/l", "/r")]
    found = open_recording(write_bag(tmp_path / "a", "mcap", messages))
    assert found.lidar is None
    assert any("2 topics hold a LiDAR's clouds, and none" in n for n in found.notes)


def test_a_capture_joins_points_with_a_lidar(tmp_path, fields):
    """The radar's bag and the LiDAR's are two, as of two programs that record."""
    folder = tmp_path / "walk"
    folder.mkdir()
    radar = bag(folder / "radar").relative_to(folder)
    rows = [bag_writer.livox_rows(7)] * 20
    lidar = bag_writer.livox_bag(folder / "lidar", "mcap", rows).relative_to(folder)
    (folder / "capture.toml").write_text(
        f'[radar]\nfile = "{radar}"\nxyz = [0.5, 0, 0]\nadd_s = 0.02\n'
        f'[lidar]\nfile = "{lidar}"\n'
    )
    found = open_recording(folder)
    assert found.points is not None and not len(found.cubes)
    np.testing.assert_allclose(found.points.stamps[0] - START / 1e9, 0.02, atol=1e-5)
    scan = nearest_scan(found, 4)
    assert scan is not None and len(scan) == 7
    assert found.base_from_radar[0, 3] == 0.5 and dict(found.fields)["snr"]


def test_a_capture_times_a_serial_stream(tmp_path):
    from tests.recordings.points.ti_writer import packet

    frames = [packet(k, [(0, 2, 0, 1)], cycles=20_000_000 * k) for k in range(4)]
    (tmp_path / "out.dat").write_bytes(b"".join(frames))
    text = '[radar]\nfile = "out.dat"\nstart_time_s = 1700000000.0\n'
    (tmp_path / "capture.toml").write_text(text)
    stamps = open_recording(tmp_path).points.stamps
    np.testing.assert_allclose(stamps - 1.7e9, 0.1 * np.arange(4), atol=1e-6)
