"""One command over several recordings: a table, failures that are named, resuming."""

import csv
import functools
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from jradar.cli import commands, main, several
from jradar.errors import Terminated

NAMES = "name", "frames", "seconds", "warnings", "error"


def walk(path, seed=0, frames=4):
    """A CSV of the points of a radar that moves ahead with 1 m/s past 40 points."""
    world = np.random.default_rng(seed).uniform([4, -2, -1], [9, 2, 1], (40, 3))
    lines = ["frame,timestamp,x,y,z,doppler,snr"]
    for k in range(frames):
        xyz = world - [0.1 * k, 0, 0]
        for point, doppler in zip(
            xyz, -xyz[:, 0] / np.linalg.norm(xyz, axis=1), strict=True
        ):
            row = [k, 0.1 * k, *point.round(4), round(doppler, 4), 20]
            lines.append(",".join(map(str, row)))
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def walks(tmp_path, monkeypatch):
    """Folder with three walks and a broken one, the working directory above it."""
    (tmp_path / "walks").mkdir()
    for n in range(3):
        walk(tmp_path / "walks" / f"walk_{n}.csv", n)
    (tmp_path / "walks" / "broken.csv").write_text("x,y,z\n")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "walks"


def command(walks, *options, name="odometry"):
    return [name, *map(str, sorted(walks.iterdir())), "--workers", "1", *options]


def table(folder):
    with open(folder / "recordings.csv") as file:
        return {row["name"]: row for row in csv.DictReader(file)}


def test_a_recording_that_fails_is_named_and_the_others_go_on(walks, tmp_path, capsys):
    assert main(command(walks, "-o", "out", "--json")) == several.FAILED
    shown, err = capsys.readouterr()
    assert "broken: " in err and "has the columns x, y, z, expected a radar" in err
    found = json.loads(shown)
    assert (found["recordings"], found["failed"]) == (4, 1)
    assert found["notes"][0].startswith("3 recordings: the radar's place on the base")
    rows = table(tmp_path / "out")
    assert [*rows] == ["broken", "walk_0", "walk_1", "walk_2"]
    assert "has the columns x, y, z, expected" in rows["broken"]["error"]
    assert float(rows["walk_1"]["distance (m)"]) == pytest.approx(0.3, abs=0.01)
    assert rows["walk_1"]["warnings"] == "1" and not rows["walk_1"]["error"]
    one = main(["odometry", str(walks / "walk_1.csv"), "-o", "one.tum"])
    same = (tmp_path / "out" / "walk_1.tum").read_text()
    assert one == 0 and (tmp_path / "one.tum").read_text() == same


def test_a_warning_of_one_recording_has_its_name(walks, capsys):
    text = (walks / "walk_1.csv").read_text()
    (walks / "walk_1.csv").write_text(text + "3,0.3,nan,1,1,0,20\n")
    (walks / "broken.csv").unlink()
    assert main([*command(walks, "-o", "out", "--json")]) == 0
    first, *others = json.loads(capsys.readouterr().out)["notes"]
    assert first.startswith("3 recordings: ")
    assert any(note.startswith("walk_1: ") and "are NaN" in note for note in others)


def test_a_table_of_frames_becomes_its_means():
    rows = [{"frame": 4, "points": 10, "sure": 0.5, "why": "a"}]
    rows += [{"frame": 5, "points": 20, "sure": 0.7, "why": "b"}]
    result = {
        "frames": 60,
        "enhanced": rows,
        "notes": ["a frame"],
        "model": {"name": 1},
    }
    result["streams"] = [{"stream": "radar", "items": 4}]
    expected = {"frames": 2, "mean points": 15, "mean sure": 0.6, "model name": 1}
    assert dict(several._flat(result)) == pytest.approx(expected)


def test_what_is_done_and_unchanged_is_not_done_again(walks, tmp_path, monkeypatch):
    done = []

    def counted(job, run=several.run_one):
        done.append(job.name)
        return run(job)

    monkeypatch.setattr(several, "run_one", counted)
    (walks / "broken.csv").unlink()
    assert main(command(walks, "-o", "out")) == 0
    assert main(command(walks, "-o", "out")) == 0
    assert done == ["walk_0", "walk_1", "walk_2"]
    walk(walks / "walk_1.csv", 7)  # another recording
    (tmp_path / "out" / "walk_2.tum").unlink()
    main(["odometry", *map(str, walks.iterdir()), "--workers", "1", "-o", "out"])
    assert sorted(done[3:]) == ["walk_1", "walk_2"]
    main(command(walks, "-o", "out", "--rotation", "none"))  # as before, but asked for
    assert len(done) == 8 and len(table(tmp_path / "out")) == 3


def test_a_run_of_some_keeps_what_is_known_of_the_others(walks, tmp_path):
    (walks / "broken.csv").unlink()
    assert main(command(walks, "-o", "out")) == 0
    some = [str(walks / "walk_0.csv"), str(walks / "walk_2.csv")]
    assert main(["odometry", *some, "--workers", "1", "-o", "out"]) == 0
    listed = json.loads((tmp_path / "out" / "recordings.json").read_text())
    assert sorted(listed) == ["walk_0", "walk_1", "walk_2"]


@pytest.mark.parametrize("stop", [KeyboardInterrupt, Terminated])
def test_a_stopped_run_says_how_much_is_done(walks, monkeypatch, capsys, stop):
    def stopped(job, run=several.run_one):
        if job.name == "walk_1":
            raise stop
        return run(job)

    monkeypatch.setattr(several, "run_one", stopped)
    assert main(command(walks, "-o", "out")) in (130, 143)
    said = "1 of 4 recordings are done; run the same command to go on"
    assert said in capsys.readouterr().err


def test_a_part_of_a_recording_is_not_done(walks, monkeypatch, tmp_path):
    @functools.wraps(commands.odometry)
    def part(_):
        found = several.Results({"written": []})
        found.code = 130
        return found

    monkeypatch.setattr(commands, "odometry", part)
    assert main(command(walks, "-o", "out")) == 130
    assert not (tmp_path / "out" / "recordings.json").exists()


def test_folders_stand_for_the_recordings_in_them(walks, tmp_path):
    for n in range(2):
        (tmp_path / "all" / f"day_{n}").mkdir(parents=True)
        for k in range(2):
            folder = tmp_path / "all" / f"day_{n}" / f"walk_{n}{k}"
            folder.mkdir()
            walk(folder / "points.csv")
            text = '[radar]\nfile = "points.csv"\n'
            (folder / "capture.toml").write_text(text)
    (tmp_path / "all" / "damaged.mcap").write_bytes(b"")
    (tmp_path / "all" / ".hidden").mkdir()
    found = several.recordings_at(["all"])
    assert [path.rsplit("/", 1)[1] for path in found] == [
        *("damaged.mcap", "walk_00", "walk_01", "walk_10", "walk_11")
    ]
    assert len(several.recordings_at(["walks"])) == 4  # the broken one, too
    (tmp_path / "frames").mkdir()
    for n in range(3):
        walk(tmp_path / "frames" / f"{n}.csv", n, frames=1)
    assert several.recordings_at(["frames"]) == []  # a file for each frame
    assert several.recordings_at(["all/day_0/walk_00"]) == []
    assert several.recordings_at(["walks/walk_0.csv"]) == []


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("-o", "out.tum"), "expected that of a folder for 4 recordings"),
        (("-o", "out"), "are both named walk_0"),
        (("-o", "taken"), "holds what `jradar map` wrote"),
    ],
)
def test_what_several_recordings_cannot_be_given(
    walks, tmp_path, capsys, arguments, said
):
    if "named" in said:
        (walks / "walk_0.npz").write_bytes(b"another")
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / ".jradar").write_text("# jradar map\n")
    assert main(command(walks, *arguments)) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_recording_that_is_gone_is_one_of_those_that_fail(walks, capsys):
    (walks / "gone.csv").symlink_to("nowhere.csv")
    assert main(command(walks, name="info")) == several.FAILED
    shown, err = capsys.readouterr()
    assert "gone: " in err and "no such file" in err.lower()
    assert "walk_2" in shown


def test_own_files_of_users_are_kept(walks, tmp_path, capsys):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "walk_1.tum").write_text("my own trajectory")
    assert main(command(walks, "-o", "out")) == several.FAILED
    assert (tmp_path / "out" / "walk_1.tum").read_text() == "my own trajectory"
    assert "walk_1: " in capsys.readouterr().err


@pytest.mark.slow
def test_a_cluster_does_what_a_killed_worker_leaves(walks, tmp_path):
    """Two worker processes of Dask in another folder; one is killed in the middle."""
    pytest.importorskip("distributed")
    for n in range(40):
        walk(walks / f"walk_{n}.csv", n)
    begin = [sys.executable, "-c", SCHEDULER]
    scheduler = subprocess.Popen(begin, stdout=subprocess.PIPE, text=True)
    assert scheduler.stdout is not None
    address = scheduler.stdout.readline().strip()
    begin = [sys.executable, "-c", WORKER, address]
    (tmp_path / "elsewhere").mkdir()
    workers = [subprocess.Popen(begin, cwd="elsewhere") for _ in range(2)]
    try:
        run = [
            sys.executable,
            "-m",
            "jradar",
            "odometry",
            *map(str, Path("walks").iterdir()),
        ]
        run += ["--scheduler", address, "-o", "out"]
        ours = subprocess.Popen(run, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        listed = tmp_path / "out" / "recordings.json"
        until = time.monotonic() + 120
        while time.monotonic() < until and not listed.exists():
            time.sleep(0.1)
        workers[0].send_signal(signal.SIGKILL)
        said = ours.communicate(timeout=200)[0].decode()
        assert ours.returncode == several.FAILED, said
        rows = table(tmp_path / "out")
        assert len(rows) == 41 and sum(bool(row["error"]) for row in rows.values()) == 1
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


SCHEDULER = """
import asyncio
from distributed import Scheduler
async def main():
    async with Scheduler(host="127.0.0.1", port=0, dashboard_address=None) as scheduler:
        print(scheduler.address, flush=True)
        await scheduler.finished()
asyncio.run(main())
"""
WORKER = """
import asyncio, sys
from distributed import Worker
async def main():
    async with Worker(sys.argv[1], nthreads=1) as worker:
        await worker.finished()
asyncio.run(main())
"""
