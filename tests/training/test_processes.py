"""Disturbed runs: killed, told to stop, on several devices, on a full disk."""

import json
import os
import random
import signal
import socket
import time

import numpy as np
import pytest

from tests import programs
from tests.training import tiny

pytestmark = pytest.mark.timeout(280)
# A run may end before it is killed or stopped, and processes may meet too late.
RACES = pytest.mark.flaky(reruns=2, reruns_delay=5)


@pytest.fixture(scope="module")
def launch():
    """Start `tests.training.tiny`, which keeps its compiled programs."""
    started = []

    def start(workdir, steps, *flags, **variables):
        cache = {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
        process = programs.started(
            "tests.training.tiny",
            *(workdir, steps, *flags),
            env={**os.environ, **cache, **variables},
        )
        started.append(process)
        return process

    yield start
    for process in started:  # SIGTERM may be taken by jax.distributed
        process.kill()
        process.wait()


def finish(process, *, code=0):
    """Wait for the end with the expected code; return what was printed."""
    _, err = process.communicate(timeout=120)
    assert process.returncode == code, err
    return err


def losses(workdir):
    text = (workdir / "metrics.jsonl").read_text()
    return [(line["step"], line["loss"]) for line in map(json.loads, text.splitlines())]


def wait_for_step(process, workdir, step):
    """Wait until a step is in metrics.jsonl."""
    path, deadline = workdir / "metrics.jsonl", time.monotonic() + 120
    while not (path.exists() and f'"step": {step}' in path.read_text()):
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The workdir of an uninterrupted run of 12 steps."""
    workdir = tmp_path_factory.mktemp("whole")
    tiny.run(workdir, 12)
    assert len(losses(workdir)) == 12
    return workdir


def launch_to_kill(launch, workdir):
    """Start a run of 12 steps with a cache of its own, which a kill may damage."""
    cache = {"JAX_COMPILATION_CACHE_DIR": str(workdir / "cache")}
    return launch(workdir, 12, "--seconds=0.05", **cache)


def kill(process):
    process.kill()
    process.wait()
    assert process.returncode == -signal.SIGKILL


@pytest.mark.slow
@RACES
def test_killed_run_resumes_and_ends_like_an_uninterrupted_one(launch, whole, tmp_path):
    process = launch_to_kill(launch, tmp_path)
    wait_for_step(process, tmp_path, 4)  # after the checkpoint of step 4
    time.sleep(0.05)
    kill(process)
    resumed = []
    tiny.run(tmp_path, 12, before_step=resumed.append)
    assert resumed and resumed[0] >= 4
    assert losses(tmp_path) == losses(whole)
    assert not (tmp_path / "checkpoints-unusable").exists()


@RACES
@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("seed", range(2))
def test_runs_killed_at_random_end_like_an_unbroken_one(launch, whole, tmp_path, seed):
    path = tmp_path / "metrics.jsonl"
    for delay in random.Random(seed).choices([n / 100 for n in range(30)], k=5):
        before = path.read_text() if path.exists() else ""
        process = launch_to_kill(launch, tmp_path)
        # A resumed run first drops lines, so its first new line starts a new text.
        while process.poll() is None:
            if path.exists() and not before.startswith(path.read_text()):
                break
            time.sleep(0.005)
        time.sleep(delay)
        if process.poll() is None:
            kill(process)
        else:
            finish(process)
    tiny.run(tmp_path, 12)
    assert losses(tmp_path) == losses(whole)


def same(found, expected):
    """Check that losses agree, up to the order of sums."""
    (steps, values), (all_steps, wanted) = (
        zip(*v, strict=True) for v in (found, expected)
    )
    assert steps == all_steps
    np.testing.assert_allclose(values, wanted, rtol=1e-4)


@RACES
@pytest.mark.slow
def test_four_devices_stop_at_sigterm_with_the_losses_of_one(launch, whole, tmp_path):
    flags = f"{os.environ['XLA_FLAGS']} --xla_force_host_platform_device_count=4"
    process = launch(tmp_path, 12, "--seconds=0.1", XLA_FLAGS=flags)
    wait_for_step(process, tmp_path, 5)
    process.send_signal(signal.SIGTERM)
    assert "run again to resume" in finish(process, code=143)
    assert 6 <= len(losses(tmp_path)) < 12
    tiny.run(tmp_path, 12)  # the rest on one device
    same(losses(tmp_path), losses(whole))


def together(launch, workdir, steps, *flags):
    """Start two processes of one run, which meet at a free port of this machine."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{probe.getsockname()[1]}"
    common = {
        "JAX_COORDINATOR_ADDRESS": address,
        "JAX_COORDINATOR_BIND_ADDRESS": address,
        "JAX_NUM_PROCESSES": "2",
    }
    ranks = ({"JAX_PROCESS_ID": str(index)} for index in range(2))
    return [launch(workdir, steps, *flags, **common, **rank) for rank in ranks]


@RACES
@pytest.mark.slow
def test_two_processes_give_the_losses_of_one_and_stop(launch, whole, tmp_path):
    pair = together(launch, tmp_path, 12, "--seconds=0.1")
    wait_for_step(pair[0], tmp_path, 2)
    pair[1].send_signal(signal.SIGTERM)  # one is told, both save and end
    for process in pair:
        assert "run again to resume" in finish(process, code=143)
    assert 3 <= len(losses(tmp_path)) < 12
    tiny.run(tmp_path, 12)  # the rest in one process
    same(losses(tmp_path), losses(whole))


@RACES
@pytest.mark.slow
@pytest.mark.parametrize("victim", [0, 1])
def test_a_process_whose_partner_dies_ends_and_resumes(launch, whole, tmp_path, victim):
    pair = together(launch, tmp_path, 12, "--seconds=0.1")
    wait_for_step(pair[0], tmp_path, 4)
    kill(pair[victim])
    _, err = pair[1 - victim].communicate(timeout=120)
    assert pair[1 - victim].returncode not in (0, None), err
    tiny.run(tmp_path, 12)
    same(losses(tmp_path), losses(whole))


def test_full_disk_stops_the_run_and_freed_space_resumes(whole, small_disk):
    ballast = small_disk / "ballast"

    def fill(step):
        if step == 3:
            with pytest.raises(OSError), ballast.open("wb") as file:
                while True:
                    file.write(bytes(4096))
                    file.flush()

    with pytest.raises(OSError, match="o space left"):
        tiny.run(small_disk / "run", 12, before_step=fill)
    assert ballast.exists() and len(losses(small_disk / "run")) < 12
    ballast.unlink()
    resumed = []
    tiny.run(small_disk / "run", 12, before_step=resumed.append)
    assert resumed[0] == 3  # from the last checkpoint before the disk was full
    assert losses(small_disk / "run") == losses(whole)
