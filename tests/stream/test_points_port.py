"""A radar's points over a pseudo-terminal: whole, torn, late, lost, foreign, gone."""

import numpy as np
import pytest

from jradar.recordings import open_recording
from jradar.stream.live import run_live
from jradar.stream.points_port import PointsPort, data_rate, points_on_the_cable
from jradar.stream.processing import Processor
from tests.recordings.points.test_ti_serial import CFG
from tests.recordings.points.ti_writer import old_packet, packet, whole
from tests.stream.loops import wait_until
from tests.stream.serial_line import line, listening, taken

# The line's two ends are this test and a thread with timeouts.
pytestmark = pytest.mark.flaky(reruns=2, reruns_delay=5)
POINTS = [(0.5, 2.0, 0.1, -1.5), (-0.5, 3.0, 0.2, 0.5)]


def stream(numbers, points=POINTS):
    return [packet(number, points, [20.0] * len(points)) for number in numbers]


def numbers(frames):
    return [frame.number for frame in frames]


@pytest.mark.parametrize(("size", "pause_s"), [(7, 0.0), (50, 0.01), (1 << 12, 0.0)])
def test_a_stream_torn_anywhere_becomes_clouds_along_jradars_axes(size, pause_s):
    with listening() as (sender, port):
        sender.send(b"".join(stream(range(100, 110))), size=size, pause_s=pause_s)
        frames = taken(port, 10)
    assert numbers(frames) == [*range(10)]
    for frame in frames:
        expected = [(2.0, -0.5, 0.1), (3.0, 0.5, 0.2)]
        np.testing.assert_allclose(frame.data.xyz, expected, rtol=1e-6)
        np.testing.assert_allclose(frame.data.velocity, [-1.5, 0.5])
        np.testing.assert_allclose(frame.data.snr, 100.0, rtol=1e-5)
    assert (np.diff([frame.stamp_s for frame in frames]) >= 0).all()
    assert not any(port.describe().values()) and not port.dropped
    assert port.losses() == "0 bytes lost"


def test_a_real_stream_gives_the_clouds_of_its_reader(samples):
    path = samples / "ti_serial" / "ti_gates_xwr68xx.dat"
    expected = open_recording(path).points
    with listening() as (sender, port):
        sender.send(path.read_bytes(), size=1000)
        frames = taken(port, len(expected))
    for frame, cloud in zip(frames, expected, strict=True):
        for name in ("xyz", "velocity", "snr"):
            found, known = getattr(frame.data, name), getattr(cloud, name)
            np.testing.assert_array_equal(found, known)


def test_lost_bytes_are_counted_and_the_next_packet_is_taken():
    """A stream that begins in a packet, and loses bytes, packets, and a TLV's size."""
    packets = stream([*range(5), *range(7, 12)])
    packets[0] = packets[0][30:]
    packets[3] = packets[3][:60] + packets[3][80:]
    odd = whole(12, 1, [(1, bytes(17))], version=0x03060000, cycles=0)
    with listening() as (sender, port):
        sender.send(b"".join([*packets, odd, *stream([13])]))
        frames = taken(port, 9)
        lost = len(packets[0]) + len(packets[3]) + len(odd)
        assert port.describe() == {
            "frames missing": 3,  # 3, 5 and 6
            "frames damaged": 1,
            "lost bytes": lost,
            "restarts of the board": 0,
        }
    assert numbers(frames) == [0, 1, 3, 6, 7, 8, 9, 10, 12]


def test_the_newest_frame_wins_and_the_others_are_counted():
    with listening(waiting=1) as (sender, port):
        sender.send(b"".join(stream(range(20))))
        wait_until(lambda: port.received == 20, "the last frame")
        (last,) = taken(port, 1)
    assert last.number == 19 and port.dropped == 19


def test_a_restart_and_sub_frames_are_frames_of_their_own():
    with listening() as (sender, port):
        sender.send(b"".join(stream([5, 5, 6, 6, 0, 0, 1, 10**6])))
        frames = taken(port, 8)
        assert port.restarts == 1 and port.missing == 0
    assert numbers(frames) == [*range(8)]


def test_empty_frames_have_the_columns_of_the_others():
    plain = packet(1, POINTS)  # without the SNRs of TLV 7
    with listening() as (sender, port):
        sender.send(b"".join([packet(0, []), plain, packet(2, []), *stream([3])]))
        frames = taken(port, 4)
    assert [len(frame.data.valid) for frame in frames] == [0, 2, 0, 2]
    assert [frame.data.snr is None for frame in frames] == [False, True, True, False]


def test_the_old_form_has_velocities_with_the_cfg_of_the_board(tmp_path):
    (tmp_path / "old.cfg").write_text(CFG)
    sent = old_packet(7, [(k, k - 2, 100, 0.25, 1.5, 0.5) for k in range(5)])
    described = tmp_path / "old.cfg"
    with listening(described, device="awr1642") as (sender, port):
        sender.send(sent)
        (frame,) = taken(port, 1)
        assert not port.oddity()
    step = points_on_the_cable("COM3", described, device="awr1642").radar.spec
    expected = step.velocity_resolution_mps * np.arange(-2, 3)
    np.testing.assert_allclose(frame.data.velocity, expected)
    with listening() as (sender, port):
        sender.send(sent)
        (frame,) = taken(port, 1)
        assert "SDK 1.2.0.5 sends no velocities" in port.oddity()
    assert frame.data.velocity is None
    np.testing.assert_allclose(frame.data.power, 101.0)  # a peak is never in dB


@pytest.mark.parametrize(
    ("kind", "name"),
    [(301, "xWRL"), (1000, "people counting"), (1020, "people tracking")],
)
def test_packets_of_another_demo_are_refused_by_name(kind, name):
    other = packet(7, [], parts=[(kind, bytes(28))])
    with listening() as (sender, port):
        sender.send(b"".join([*stream([6]), other]))
        wait_until(lambda: port._fault, "the packet")
        assert port.take(0.0) is not None  # what came before is not lost
        with pytest.raises(ValueError, match=f"frame 7 .*{name}.*, TLV {kind}"):
            port.take(0.0)


def live(port, **options):
    return run_live(port, Processor(points_on_the_cable(port.port)), [], **options)


def test_a_port_without_a_stream_is_explained():
    with listening() as (_, port):
        with pytest.raises(TimeoutError, match="nothing came from .* the data port"):
            live(port, silence_s=0.3)
    with listening() as (sender, port):
        sender.send(bytes(range(256)) * 40)
        with pytest.raises(TimeoutError, match="10,240 bytes .* is 921,600 baud its"):
            live(port, silence_s=0.3)


def test_a_radar_that_falls_silent_is_reported_and_heard_again():
    said, sent = [], iter([stream([4])])
    with listening() as (sender, port):
        sender.send(b"".join(stream(range(3))))
        wait_until(lambda: port.received == 3, "frames")

        def finished():
            for packets in sent if said else ():
                sender.send(b"".join(packets))
            return port.received == 4

        session = live(port, silence_s=0.5, say=said.append, finished=finished)
    assert len(said) == 1 and "nothing came" in said[0]
    assert session.published == 4 and session.warnings == said


def test_a_port_that_vanishes_ends_the_session_after_its_frames():
    with listening() as (sender, port):
        sender.send(b"".join(stream(range(3))))
        wait_until(lambda: port.received == 3, "frames")
        sender.vanish()
        wait_until(lambda: port._fault, "the end of the line")
        assert [port.take(0.0) is None for _ in range(3)] == [False] * 3
        with pytest.raises(OSError, match=r"is gone after 3 frames .* cable pulled"):
            port.take(0.0)


def test_a_port_that_vanishes_before_the_session_is_named():
    with line() as sender:
        port = PointsPort(sender.port, points_on_the_cable(sender.port))
        sender.vanish()
        with pytest.raises(OSError, match="is gone after 0 frames"), port:
            pass
        port.close()


def test_a_port_that_is_missing_or_in_use_is_named(tmp_path):
    missing = str(tmp_path / "ttyACM1")
    with pytest.raises(OSError, match=r"ttyACM1 cannot be opened .* dialout"):
        PointsPort(missing, points_on_the_cable(missing))
    with listening() as (sender, _):
        with pytest.raises(OSError, match="no other program using the port"):
            PointsPort(sender.port, points_on_the_cable(sender.port))


def test_what_a_running_board_sent_before_is_forgotten():
    with line() as sender:
        port = PointsPort(sender.port, points_on_the_cable(sender.port), waiting=9)
        sender.send(b"".join(stream([0])))
        with port:
            sender.send(b"".join(stream([1])))
            (frame,) = taken(port, 1)
    assert frame.number == 0 and port.missing == 0


def test_the_rate_is_that_of_the_cfg(tmp_path):
    cfg = tmp_path / "profile.cfg"
    for text, baud in [
        (CFG, 921600),
        (CFG + "configDataPort 921600 1\nconfigDataPort 3125000 0 % fast\n", 3125000),
    ]:
        cfg.write_text(text)
        assert data_rate(cfg) == baud
    cfg.write_text("sensorStop\nconfigDataPort fast 1\n")
    with pytest.raises(ValueError, match="line 2: 'configDataPort fast 1', expected"):
        data_rate(cfg)
