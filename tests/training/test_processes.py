"""Whole processes: killed, told to stop, several at a time, on several devices."""

import json
import os
import random
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.training import tiny

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.timeout(280)


@pytest.fixture(scope="module")
def launch(tmp_path_factory):
    """Start `tests.training.tiny`; what it compiles is kept for the next one."""
    cache, started = tmp_path_factory.mktemp("cache"), []

    def start(workdir, steps, *flags, **variables):
        environment = {
            **os.environ,
            "JAX_COMPILATION_CACHE_DIR": str(cache),
            "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
            **variables,
        }
        command = [sys.executable, "-m", "tests.training.tiny", str(workdir)]
        process = subprocess.Popen(
            [*command, str(steps), *flags],
            cwd=ROOT,
            env=environment,
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        return process

    yield start
    for process in started:  # SIGTERM may be taken by jax.distributed
        process.kill()
        process.wait()


def finish(process, *, code=0):
    """Its messages, once it has ended as expected."""
    _, err = process.communicate(timeout=120)
    assert process.returncode == code, err
    return err


def losses(workdir):
    text = (workdir / "metrics.jsonl").read_text()
    return [(line["step"], line["loss"]) for line in map(json.loads, text.splitlines())]


def wait_for_step(process, workdir, step):
    """Wait until the metrics of a step are written."""
    path, deadline = workdir / "metrics.jsonl", time.monotonic() + 120
    while not (path.exists() and f'"step": {step}' in path.read_text()):
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Workdir of a run of 12 steps that nothing disturbed."""
    workdir = tmp_path_factory.mktemp("whole")
    tiny.run(workdir, 12)
    assert len(losses(workdir)) == 12
    return workdir


def kill(launch, workdir, delay):
    """Kill a run `delay` seconds after its first new step."""
    process = launch(workdir, 12, "--seconds=0.02")
    path, deadline = workdir / "metrics.jsonl", time.monotonic() + 120
    before = path.stat().st_mtime_ns if path.exists() else 0
    while process.poll() is None and time.monotonic() < deadline:
        if path.exists() and path.stat().st_mtime_ns != before:
            break
        time.sleep(0.005)
    time.sleep(delay)
    process.kill()
    process.wait()


def test_killed_and_stopped_runs_end_like_an_uninterrupted_one(launch, whole, tmp_path):
    kill(launch, tmp_path, 0.1)
    done = len(losses(tmp_path)) if (tmp_path / "metrics.jsonl").exists() else 0
    process = launch(tmp_path, 12, "--seconds=0.2")
    wait_for_step(process, tmp_path, min(done, 10))
    process.send_signal(signal.SIGTERM)
    assert "run again to resume" in finish(process, code=143)
    tiny.run(tmp_path, 12)
    assert losses(tmp_path) == losses(whole)
    assert not (tmp_path / "checkpoints-unusable").exists()


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("seed", range(5))
def test_runs_killed_at_random_end_like_an_uninterrupted_one(
    launch, whole, tmp_path, seed
):
    for delay in random.Random(seed).choices([n / 100 for n in range(60)], k=5):
        kill(launch, tmp_path, delay)
    tiny.run(tmp_path, 12)
    assert losses(tmp_path) == losses(whole)


def same(found, expected):
    """Whether losses agree but for the order in which sums are taken."""
    assert [step for step, _ in found] == [step for step, _ in expected]
    np.testing.assert_allclose(
        [loss for _, loss in found], [loss for _, loss in expected], rtol=1e-4
    )


def test_four_devices_give_the_losses_of_one(launch, whole, tmp_path):
    four = {"XLA_FLAGS": "--xla_force_host_platform_device_count=4"}
    finish(launch(tmp_path, 7, **four))
    tiny.run(tmp_path, 12)  # the rest on one device
    same(losses(tmp_path), losses(whole))


def together(launch, workdir, steps, *flags):
    """Two processes of one run, which meet at a free port of this machine."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{probe.getsockname()[1]}"
    return [
        launch(
            workdir, steps, *flags, JAX_COORDINATOR_ADDRESS=address,
            JAX_COORDINATOR_BIND_ADDRESS=address, JAX_NUM_PROCESSES="2",
            JAX_PROCESS_ID=str(index),
        )
        for index in range(2)
    ]  # fmt: skip


def test_two_processes_give_the_losses_of_one_and_stop_together(
    launch, whole, tmp_path
):
    pair = together(launch, tmp_path, 12, "--seconds=0.1")
    wait_for_step(pair[0], tmp_path, 2)
    pair[1].send_signal(signal.SIGTERM)  # either may be told; both save and end
    for process in pair:
        assert "run again to resume" in finish(process, code=143)
    assert 3 <= len(losses(tmp_path)) < 12
    tiny.run(tmp_path, 12)  # the rest in one process
    same(losses(tmp_path), losses(whole))


def test_full_disk_ends_with_its_code_and_freed_space_resumes(launch, whole, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("may not mount a small disk here")
    try:
        ballast = disk / "ballast"
        process = launch(disk / "run", 12, "--seconds=0.1")
        wait_for_step(process, disk / "run", 2)
        with pytest.raises(OSError), ballast.open("wb") as file:
            while True:
                file.write(bytes(4096))
                file.flush()
        assert "o space left" in finish(process, code=3)
        ballast.unlink()
        tiny.run(disk / "run", 12)
        assert losses(disk / "run") == losses(whole)
    finally:
        subprocess.run(["umount", "--lazy", str(disk)], check=True)
