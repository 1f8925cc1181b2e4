"""Preparing what is damaged, on a full disk, after a kill, beside what is not ours."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from jradar import workers as workers_module
from jradar.data.frames import prepare_frame
from jradar.data.prepare import prepare
from jradar.data.records import Records, write_shard
from jradar.errors import UsageError, exit_code
from jradar.recordings import open_recording
from tests.data.prepared import SPEC, digests, with_points
from tests.recordings.small_sequence import write_sequence, write_stamps

MODULE = sys.modules["jradar.data.prepare"]


def test_a_damaged_frame_stops_or_is_counted(tmp_path):
    folder = write_sequence(tmp_path / "src", frames=4)
    path = folder / "single_chip/adc_samples/data/frame_1.bin"
    path.write_bytes(path.read_bytes()[:-2])
    with pytest.raises(ValueError, match="frame_1.bin"):
        prepare(folder, tmp_path / "dst", SPEC, workers=1)
    with pytest.raises(ValueError, match="run the same"):
        Records(tmp_path / "dst")
    manifest = prepare(folder, tmp_path / "dst", SPEC, workers=1, keep_going=True)
    (sequence,) = manifest["sequences"]
    assert sequence["frames"] == 3
    assert [frame for _, frame in Records(tmp_path / "dst").where] == [0, 2, 3]
    ((reason, count),) = sequence["dropped"].items()
    assert "frame_1.bin" in reason and count == 1


def blind(folder, radar=(), lidar=()):
    """Let the radar and the LiDAR see nothing in some frames."""
    paths = [folder / f"single_chip/adc_samples/data/frame_{i}.bin" for i in radar]
    paths += [folder / f"lidar/pointclouds/lidar_pointcloud_{i}.bin" for i in lidar]
    for path in paths:
        path.write_bytes(bytes(path.stat().st_size))


def test_frames_in_which_a_sensor_saw_nothing_are_dropped_and_counted(tmp_path):
    folder = write_sequence(tmp_path / "src", frames=7)
    blind(folder, radar=[0, 1], lidar=[4])  # frames 0 and 1 are a block of their own
    manifest = prepare(folder, tmp_path / "dst", SPEC, workers=1)
    (sequence,) = manifest["sequences"]
    dropped = {"all radar samples are zero": 2, "no LiDAR point is in view": 1}
    assert sequence["dropped"] == dropped
    records = Records(tmp_path / "dst")
    kept = [2, 3, 5, 6]
    assert [frame for _, frame in records.where] == [r.frame for r in records] == kept
    with pytest.raises(ValueError, match="run0, frame 4: no LiDAR point is in view"):
        prepare_frame(open_recording(folder), 4, 4, SPEC)


def test_sequences_of_one_frame_may_be_blind_but_not_all_of_them(tmp_path):
    for name in ("run0", "run1"):
        write_sequence(tmp_path / "src", name, frames=1)
    blind(tmp_path / "src/run0", radar=[0])
    manifest = prepare(tmp_path / "src", tmp_path / "dst", SPEC, workers=1)
    assert [s["frames"] for s in manifest["sequences"]] == [0, 1]
    assert Records(tmp_path / "dst").where == [("run1", 0)]
    blind(tmp_path / "src/run1", lidar=[0])
    with pytest.raises(ValueError, match="no usable frame in run0, run1: all radar"):
        prepare(tmp_path / "src", tmp_path / "other", SPEC, workers=1)


def test_a_recording_too_short_to_be_cut_says_so(tmp_path):
    write_sequence(tmp_path / "src", frames=3)
    with pytest.raises(UsageError, match="3 frames is too short .* --validation"):
        folders = tmp_path / "src", tmp_path / "dst"
        prepare(*folders, SPEC, workers=1, validation_share=0.3)


def no_space(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("workers", [1, 2])
def test_a_full_disk_ends_with_an_error_and_the_same_call_resumes(
    root, prepared, tmp_path, monkeypatch, workers
):
    written = []

    def write(path, *arguments):
        if written:
            no_space()
        written.append(path)
        return write_shard(path, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(MODULE, "write_shard", write)
        if workers == 2:  # threads, which see the patch
            patch.setattr(workers_module, "_processes", ThreadPoolExecutor)
        with pytest.raises(OSError) as error:
            prepare(root, tmp_path, SPEC, workers=workers)
    assert exit_code(error.value) == 3 and error.value.errno == errno.ENOSPC
    assert len([*tmp_path.rglob("*.json")]) == 2  # the claim, and one shard
    prepare(root, tmp_path, SPEC, workers=1)
    assert digests(tmp_path) == digests(prepared)


def test_a_folder_without_a_finished_shard_is_free_for_other_options(root, tmp_path):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(MODULE, "write_shard", no_space)
        with pytest.raises(OSError):
            prepare(root, tmp_path, with_points(SPEC, capacity=64), workers=1)
    assert (tmp_path / "manifest.json").exists()
    prepare(root, tmp_path, SPEC, workers=1, frames=slice(0, 1))
    assert Records(tmp_path).manifest["options"]["points"]["capacity"] == 128


def test_options_that_do_not_suit_the_radar_leave_the_folder_free(root, tmp_path):
    def refuse(*_, **__):
        raise ValueError("the window does not fit")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(MODULE, "radar_side", refuse)
        with pytest.raises(ValueError, match="does not fit"):
            prepare(root, tmp_path, SPEC, workers=1)
    assert [p.name for p in tmp_path.iterdir()] == [".lock"]


def test_too_few_scans_and_none_at_all_are_an_error(tmp_path):
    folder = write_sequence(tmp_path / "src", frames=4)
    write_stamps(folder / "lidar", 1000.4 + 0.1 * np.arange(4))
    with pytest.raises(ValueError, match="4 of 4 radar frames.*do the two clocks"):
        prepare(folder, tmp_path / "dst", SPEC, workers=1)
    folder = folder.rename(tmp_path / "src" / "bare")  # what was opened is kept
    shutil.rmtree(folder / "lidar")
    with pytest.raises(ValueError, match="no LiDAR.*capture.toml"):
        prepare(folder, tmp_path / "dst", SPEC, workers=1)


@pytest.mark.flaky(reruns=2, reruns_delay=5)  # the run may end before it is killed
def test_a_killed_run_resumes_with_the_same_bytes(root, prepared, tmp_path):
    code = (
        "import sys; from tests.data.prepared import SPEC; "
        "from jradar.data.prepare import prepare; "
        "prepare(sys.argv[1], sys.argv[2], SPEC, workers=1)"
    )
    command = [sys.executable, "-c", code, str(root), str(tmp_path / "dst")]
    process = subprocess.Popen(command, cwd=Path(__file__).parents[2])
    deadline = time.monotonic() + 200
    while not [*tmp_path.rglob("0000.json")] and time.monotonic() < deadline:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    torn = tmp_path / "dst" / "12_21_2020_ec_hallways_run0" / ".0001.json-killed00"
    torn.mkdir()
    for name in (".lock", "0001.json"):  # as a kill within a write leaves them
        (torn / name).write_bytes(b"half")
    with pytest.raises(ValueError, match="run the same `jradar prepare` again"):
        Records(tmp_path / "dst")
    prepare(root, tmp_path / "dst", SPEC, workers=1)
    assert digests(tmp_path / "dst") == digests(prepared)
    left = {p.name for p in (tmp_path / "dst").rglob("*") if p.name.startswith(".")}
    assert left <= {".lock"}
