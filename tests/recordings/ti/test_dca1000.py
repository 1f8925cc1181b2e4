"""DCA1000 captures written byte by byte: orders, packets, parts, faults; a real one."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from jradar.recordings import open_recording
from jradar.recordings.ti.dca1000 import open_dca1000
from jradar.recordings.ti.packets import (
    Files,
    header_size,
    index_packets,
    lost_per_frame,
)
from tests.recordings.dca1000_writer import (
    CFG,
    FRAME,
    as_bytes,
    as_packets,
    random_cubes,
    with_headers,
)

CUBES = random_cubes()
STREAM = as_bytes(CUBES)
PACKETS = as_packets(STREAM)


@pytest.fixture
def write(tmp_path):
    """A function that writes a capture and its .cfg: their paths."""

    def write(content, name="adc_data.bin", cfg=CFG):
        (tmp_path / "radar.cfg").write_text(cfg)
        (tmp_path / name).write_bytes(content)
        return tmp_path / name, tmp_path / "radar.cfg"

    return write


def frames_of(recording):
    return np.stack([*recording.cubes])


@pytest.mark.parametrize(
    ("swap", "order"),
    [("0 1", "IIQQ"), ("1 1", "QQII"), ("0 0", "I4Q4"), ("1 0", "Q4I4")],
)
def test_the_cfg_names_the_order(write, swap, order):
    cubes = random_cubes(1)
    more = "" if order == "Q4I4" else "-1 "  # older files name no subframe
    cfg = CFG.replace("-1 0 0 1 1", f"{more}0 {swap} 1")
    recording = open_dca1000(*write(as_bytes(cubes, order), cfg=cfg))
    np.testing.assert_array_equal(frames_of(recording), cubes)
    assert recording.cubes[0].dtype == np.complex64


@pytest.mark.parametrize(("asked", "noted"), [(0, False), (2, True), (4, False)])
def test_more_frames_than_were_asked_for_are_noted(tmp_path, asked, noted):
    (tmp_path / "a.bin").write_bytes(as_bytes(random_cubes(4)))
    cfg = CFG.replace("frameCfg 0 2 5 0", f"frameCfg 0 2 5 {asked}")
    (tmp_path / "profile.cfg").write_text(cfg)
    notes = " ".join(open_recording(tmp_path / "a.bin").notes)
    assert ("asks for 2 frames, and the capture holds 4" in notes) == noted
    assert ("more chirps (loops) than 5" in notes) == noted


def test_times_and_channel_factors_of_a_cfg(write):
    factors = "compRangeBiasAndRxChanPhase 0.05 " + "1 0 " * 11 + "0 -1\n"
    recording = open_dca1000(*write(STREAM, cfg=CFG + factors))
    np.testing.assert_allclose(recording.cubes.stamps, [0, 0.1, 0.2])
    assert recording.radar.range_bias_m == 0.05
    # The board's third transmitter, mask 4, fires second.
    assert np.flatnonzero(recording.radar.channels == -1j).tolist() == [7]
    plain = open_dca1000(*write(STREAM))
    assert plain.radar.channels is None and plain.lost_bytes is None
    assert plain.name == "adc_data" and plain.notes == ()


@pytest.mark.parametrize("header", [14, 10])
def test_packets_whose_frames_begin_anywhere(write, header):
    recording = open_dca1000(*write(with_headers(PACKETS, header)))
    np.testing.assert_array_equal(frames_of(recording), CUBES)
    assert recording.lost_bytes.tolist() == [0, 0, 0] and recording.notes == ()


def test_lost_repeated_and_late_packets_are_placed_and_reported(write):
    cubes = random_cubes(4)
    stream = as_bytes(cubes)
    a, b, _, d, e, f, g = as_packets(stream)
    recording = open_dca1000(*write(with_headers([a, d, b, e, e, f, g])))
    expected = bytearray(stream)
    expected[2 * 1456 : 3 * 1456] = bytes(1456)
    # The packet held bytes 2,912 to 4,368: all in the second frame, 2,400 to 4,800.
    assert recording.lost_bytes.tolist() == [0, 1456, 0, 0]
    assert recording.notes == (
        "1,456 bytes (1 packets) were lost, in 1 of 4 frames: read as zeros",
        "1,456 bytes arrived more than once",
        "packets were out of order in 1 places: reordered",
    )
    received = frames_of(recording)
    np.testing.assert_array_equal(received[[0, 2, 3]], cubes[[0, 2, 3]])
    assert as_bytes(received) == bytes(expected)
    recording = open_dca1000(*write(with_headers(PACKETS[1:])))
    assert recording.lost_bytes.tolist() == [1456, 0, 0]
    assert as_bytes(recording.cubes) == bytes(1456) + STREAM[1456:]


@settings(max_examples=25, deadline=None, derandomize=True)
@given(data=st.data())
def test_any_packet_stream_against_its_bytes(data, tmp_path_factory):
    draw = data.draw
    sizes = draw(st.lists(st.sampled_from([1456] * 6 + [1, 2, 700, 1455]), max_size=20))
    sizes = [1456, *sizes]
    header = draw(st.sampled_from([14, 10]))
    if header == 10:  # without lengths, only the last packet may be short
        sizes = [1456] * (len(sizes) - 1) + sizes[-1:]
    seed = draw(st.integers(0, 1000))
    stream = np.random.default_rng(seed).bytes(sum(sizes))
    packets = as_packets(stream, sizes)
    lost = draw(st.sets(st.integers(1, len(packets)), max_size=len(packets) // 3))
    kept = [packet for packet in packets[1:] if packet[0] not in lost]
    again = draw(st.lists(st.sampled_from(kept), max_size=3)) if kept else []
    order = draw(st.permutations(kept + again))
    if header == 10:  # and it must come last
        short = [packet for packet in order if len(packet[2]) < 1456]
        order = [packet for packet in order if packet not in short] + short[:1]
    received = [packets[0], *order]

    expected, arrived = bytearray(len(stream)), bytearray(len(stream))
    for _, at, samples in received:
        expected[at : at + len(samples)] = samples
        arrived[at : at + len(samples)] = b"\1" * len(samples)
    end = max(at + len(samples) for _, at, samples in received)

    content = with_headers(received, header)
    cut = draw(st.integers(0, len(content)))  # parts may end within a header
    folder = tmp_path_factory.mktemp("packets")
    paths = [folder / "a_Raw_0.bin", folder / "a_Raw_1.bin"]
    for path, part in zip(paths, (content[:cut], content[cut:]), strict=True):
        path.write_bytes(part)
    files = Files.of(paths)
    assert header_size(files) == header
    index = index_packets(files, header, allow_partial=False)
    assert index.size == end

    start = draw(st.integers(0, end - 1))
    stop = draw(st.integers(start, end))
    assert index.read(start, stop).tobytes() == bytes(expected[start:stop])
    frame = draw(st.integers(1, end))
    frames = end // frame
    holes = [arrived[i * frame : (i + 1) * frame].count(0) for i in range(frames)]
    assert lost_per_frame(index, frame, frames).tolist() == holes


def test_parts_are_joined_in_the_order_of_their_numbers(write):
    cubes = random_cubes(12)
    stream = as_bytes(cubes)
    edges = [len(stream) * part // 12 + 2 * bool(part % 12) for part in range(13)]
    for part in range(12):  # frames straddle the files; "10" sorts before "2"
        name = f"adc_data_Raw_{part}.bin"
        path, cfg = write(stream[edges[part] : edges[part + 1]], name)
    write(b"other", "other_Raw_7.bin")
    recording = open_dca1000(path, cfg)
    assert "12 files were joined" in recording.notes and recording.name == "adc_data"
    np.testing.assert_array_equal(frames_of(recording), cubes)
    (path.parent / "adc_data_Raw_3.bin").unlink()
    with pytest.raises(ValueError, match=r"parts \[0, 1, 2, 4, .* expected 0 to 11"):
        open_dca1000(path, cfg)


def test_file_that_changes_after_opening(write):
    path, cfg = write(STREAM)
    recording = open_dca1000(path, cfg)
    path.write_bytes(STREAM + b"more")  # the recording continues
    np.testing.assert_array_equal(frames_of(recording), CUBES)
    path.write_bytes(STREAM[:-1])
    with pytest.raises(ValueError, match="was truncated while it was read"):
        recording.cubes[2]


@pytest.mark.parametrize("missing", [1, 1200, 2399])
def test_partial_frame_is_refused_or_left_out(write, missing):
    paths = write(STREAM[:-missing])
    with pytest.raises(ValueError, match=r"holds .* multiple of 2,400 .*: 2 whole fra"):
        open_dca1000(*paths)
    recording = open_dca1000(*paths, allow_partial=True)
    np.testing.assert_array_equal(frames_of(recording), CUBES[:2])
    assert f"the last {FRAME - missing:,} bytes" in recording.notes[0]


@pytest.mark.parametrize("header", [14, 10])
def test_truncation_anywhere_never_reads_wrong_samples(write, header):
    cubes = random_cubes(2)
    content = with_headers(as_packets(as_bytes(cubes)), header)
    record = header + 1456
    cuts = np.add.outer((0, record, 2 * record), (0, 4, header, -1))
    for cut in np.maximum(cuts, 0).ravel():
        paths = write(content[:cut])
        with pytest.raises(ValueError, match="bytes|truncated"):
            open_dca1000(*paths)
        # A frame lies in two packets. Without lengths, the second may be cut.
        if cut < 2 * record - (header == 10):
            with pytest.raises(ValueError, match="bytes|truncated"):
                open_dca1000(*paths, allow_partial=True)
        else:
            recording = open_dca1000(*paths, allow_partial=True)
            np.testing.assert_array_equal(frames_of(recording), cubes[:1])


def test_faults_are_named(write, tmp_path):
    damaged = bytearray(with_headers(PACKETS))
    damaged[2 * 1470 + 4 : 2 * 1470 + 8] = struct.pack("<I", 1457)
    wild = [*PACKETS[:-1], (2**30, 2**40, PACKETS[-1][2])]
    adc, cut = struct.pack("<IQ", 0x0ADC0CDA, 5), b"\xd4\xc3\xb2\xa1"
    dump = with_headers(as_packets(STREAM, [1456, 1456, 100, 1456]), 10)
    for name, content, message in [
        ("damaged.bin", bytes(damaged), "damaged.bin, byte 2,940: expected the header"),
        ("wild.bin", with_headers(wild), "a header is damaged, or most packets"),
        ("multi.bin", adc + STREAM, "data-separated"),
        ("a_hdr_0ADC_Raw_0.bin", STREAM, "data-separated"),
        ("pcap.bin", cut + STREAM, "packet trace"),
        ("empty.bin", b"", "holds 0 bytes"),
        ("other.bin", bytes(4 * 2 * 4 * 16 * 64), r"that fit: .*\(64, 16, 4, 2\)"),
        ("dump.bin", dump, "byte 4,398.* the packet before not full"),
    ]:
        with pytest.raises(ValueError, match=message):
            open_dca1000(*write(content, name))
    with pytest.raises(ValueError, match="'IQQI', expected one of IIQQ"):
        open_dca1000(*write(STREAM), iq_order="IQQI")
    with pytest.raises(ValueError, match="lvdsStreamCfg puts headers"):
        open_dca1000(*write(STREAM, cfg=CFG + "lvdsStreamCfg -1 1 1 0\n"))
    with pytest.raises(FileNotFoundError, match="no such file: .*none.bin"):
        open_dca1000(tmp_path / "none.bin", tmp_path / "radar.cfg")
    with pytest.raises(FileNotFoundError, match="no such radar description"):
        open_dca1000(write(STREAM)[0], tmp_path / "none.cfg")


def test_two_captures_in_one_file_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("jradar.recordings.ti.packets.REORDERED", 10_000)
    path = tmp_path / "a.bin"
    path.write_bytes(2 * with_headers(as_packets(bytes(20_000))))
    with pytest.raises(ValueError, match="falls from 20,000 to 0: .* two captures"):
        index_packets(Files.of([path]), 14, allow_partial=False)


def test_odd_number_of_samples_needs_pairs(write):
    cfg = CFG.replace("70 1 10 5209", "70 1 9 5209")
    cubes = random_cubes(1, (3, 4, 5, 9))
    with pytest.raises(ValueError, match="9 samples per chirp in the order IIQQ"):
        open_dca1000(*write(as_bytes(cubes, "I4Q4"), cfg=cfg))
    recording = open_dca1000(*write(as_bytes(cubes, "I4Q4"), cfg=cfg), iq_order="I4Q4")
    np.testing.assert_array_equal(frames_of(recording), cubes)


@pytest.mark.parametrize("order", [None, "I"])
def test_real_samples(write, order):
    parts = np.random.default_rng(0).integers(-2000, 2000, (2, 5, 3, 4, 10), np.int16)
    cfg = CFG.replace("adcCfg 2 1", "adcCfg 2 0")
    path, cfg = write(parts.astype("<i2").tobytes(), cfg=cfg)
    recording = open_dca1000(path, cfg, device="awr2944", iq_order=order)
    assert recording.cubes[0].dtype == np.float32
    np.testing.assert_array_equal(frames_of(recording), parts.transpose(0, 2, 3, 1, 4))
    with pytest.raises(ValueError, match="'IIQQ', but awr2944 has real samples: .* I$"):
        open_dca1000(path, cfg, device="awr2944", iq_order="IIQQ")
    path.write_bytes(path.read_bytes()[:-2])
    with pytest.raises(ValueError, match="multiple of 1,200 .* 10 samples x 2 bytes"):
        open_dca1000(path, cfg, device="awr2944")
    with pytest.raises(ValueError, match="'I', but awr1843 has complex samples"):
        open_dca1000(*write(b"1234"), iq_order="I")


def test_real_capture(samples):
    folder = samples / "dca1000"
    paths = folder / "adc_data_0.bin", folder / "LogFile_0.txt"
    recording = open_dca1000(*paths)
    merged = open_recording(paths[0], frames_as_chirps=True)
    assert merged.cubes[0].shape == (1, 4, 1000, 256)
    assert len(recording.cubes) == 1000 and recording.notes == ()
    assert recording.cubes.stamps[-1] == pytest.approx(0.999)
    frames = np.stack(recording.cubes[::50])[:, 0, :, 0]
    power = np.abs(np.fft.fft(frames * np.hanning(256))).mean((0, 1))
    peaks = [k for k in range(5, 128) if power[k] == power[k - 2 : k + 3].max()]
    strongest = sorted(sorted(peaks, key=lambda k: -power[k])[:2])
    assert strongest == [11, 19]
    for order in ("QQII", "IQIQ", "QIQI"):
        assert "in the order IIQQ" in open_dca1000(*paths, iq_order=order).notes[0]
