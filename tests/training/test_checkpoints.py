"""Checkpoints: damage is found, an older step is restored, the newest are kept."""

import errno
import json
import shutil

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.errors import CheckpointError
from jradar.training import TrainState
from jradar.training.checkpoints import Checkpoints, tree_digest


def state_of(step, *, size=2000, dtype=np.float32):
    """Return a state whose numbers depend on its step."""
    weights = np.random.default_rng(step).normal(size=size).astype(dtype)
    params, opt_state = {"w": weights}, (np.asarray(step), {"mean": weights / 2})
    return TrainState(np.asarray(step, np.int32), params, params, opt_state)


@pytest.fixture
def folder(tmp_path):
    """Steps 2 and 4 on disk."""
    save(tmp_path / "checkpoints", 2, 4)
    return tmp_path / "checkpoints"


def save(folder, *steps, **options):
    checkpoints = Checkpoints(folder, **options)
    for step in steps:
        checkpoints.save(state_of(step))
    checkpoints.close()


def restored_step(folder, like=None):
    """Return the restored step, after a check that its arrays belong to it."""
    checkpoints = Checkpoints(folder)
    state = checkpoints.restore(like or state_of(0))
    checkpoints.close()
    if state is None:
        return None
    jax.tree.map(np.testing.assert_array_equal, state, state_of(int(state.step)))
    return int(state.step)


def flip(path):
    """Flip a bit in the middle of a file."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def data_file(folder):
    """The largest file below a folder that holds arrays."""
    files = [path for path in folder.rglob("d/*") if path.is_file()]
    return max(files, key=lambda path: path.stat().st_size)


def test_flipped_bit_is_found_and_the_older_step_is_restored(folder, caplog):
    flip(data_file(folder / "4"))
    assert restored_step(folder) == 2
    assert "checkpoint of step 4 is not usable: its data does not match" in caplog.text
    assert (folder.parent / "checkpoints-unusable" / "4").is_dir()
    save(folder, 4)  # in the place that has become free
    assert restored_step(folder) == 4


def test_flipped_bits_of_every_file_never_give_wrong_numbers(folder):
    files = [p for p in sorted((folder / "4").rglob("*")) if p.is_file()]
    assert len(files) >= 4
    backup = shutil.copytree(folder, folder.parent / "backup")
    for path in files:
        flip(path)
        assert restored_step(folder) in (2, 4)  # and compares every array
        shutil.rmtree(folder)
        shutil.copytree(backup, folder)


@pytest.mark.parametrize("how", ["digest", "state", "truncated"])
def test_incomplete_step_is_passed_over(folder, how):
    if how == "truncated":
        path = data_file(folder / "4")
        path.write_bytes(path.read_bytes()[:100])
    else:
        shutil.rmtree(folder / "4" / how)
    assert restored_step(folder) == 2


def test_folders_that_are_no_checkpoints_are_moved_aside_whole(folder, caplog):
    (folder / "9").mkdir()
    (folder / "3").mkdir()
    (folder / "3" / "notes.txt").write_text("mine")
    (folder / "plots").mkdir()
    assert restored_step(folder) == 4
    assert "9: not a whole checkpoint, moved to" in caplog.text
    aside = folder.parent / "checkpoints-unusable"
    assert (aside / "3" / "notes.txt").read_text() == "mine"
    (folder / "3").mkdir()
    assert restored_step(folder) == 4 and (aside / "3-1").is_dir()
    assert (folder / "plots").is_dir()


def test_only_foreign_folders_is_a_new_run(tmp_path):
    (tmp_path / "checkpoints" / "4").mkdir(parents=True)
    assert restored_step(tmp_path / "checkpoints") is None
    save(tmp_path / "checkpoints", 4)
    assert restored_step(tmp_path / "checkpoints") == 4


def test_only_damaged_checkpoints_is_an_error_and_nothing_moves(folder):
    for step in ("2", "4"):
        flip(data_file(folder / step))
    before = sorted(folder.rglob("*"))
    with pytest.raises(CheckpointError, match=r"none of the checkpoints \[4, 2\] in"):
        restored_step(folder)
    assert sorted(folder.rglob("*")) == before


def test_state_of_another_network_or_run_is_refused_with_the_difference(folder):
    for other, message in (
        (state_of(0, size=5), r"\['w'\] was float32\[2000\], now float32\[5\]"),
        (state_of(0, dtype=jnp.bfloat16), r"now bfloat16\[2000\] \(3 differ\)"),
    ):
        with pytest.raises(CheckpointError, match=message):
            restored_step(folder, other)
    assert restored_step(folder) == 4
    save(folder.parent / "other", 1, run={"key": [0, 3]})
    checkpoints = Checkpoints(folder.parent / "other", run={"key": [0, 4]})
    with pytest.raises(CheckpointError, match=r"key was \[0, 3\], now \[0, 4\]"):
        checkpoints.restore(state_of(0))
    checkpoints.close()


def test_the_newest_are_kept(tmp_path):
    save(tmp_path, *range(1, 5))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["3", "4"]
    save(tmp_path, 5, 6, keep=3)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["4", "5", "6"]


def test_full_disk_leaves_the_older_checkpoints(small_disk):
    folder = small_disk / "checkpoints"
    checkpoints = Checkpoints(folder)
    rng = np.random.default_rng(0)
    weights = {"w": rng.normal(size=30_000).astype(np.float32)}  # 360 kB a step

    def state(step):
        return TrainState(np.asarray(step), weights, weights, weights)

    with pytest.raises(OSError, match=r"no space left to save step \d") as error:
        for step in range(1, 9):
            checkpoints.save(state(step))
            last = step
    assert error.value.errno == errno.ENOSPC and str(folder) in str(error.value)
    assert not [*folder.glob("*tmp*")]
    found = checkpoints.restore(state(0))
    assert found is not None and int(found.step) == last >= 1
    jax.tree.map(np.testing.assert_array_equal, found, state(last))
    checkpoints.close()


@pytest.mark.parametrize("fault", [errno.ENOSPC, errno.EDQUOT])
def test_full_disk_of_any_kind_is_told_from_other_faults(folder, monkeypatch, fault):
    checkpoints = Checkpoints(folder)

    def full(*_, **__):
        raise OSError(fault, "no room")

    monkeypatch.setattr(checkpoints._manager, "save", full)
    with pytest.raises(OSError, match="no space left to save step 6; steps .2, 4. are"):
        checkpoints.save(state_of(6))
    fault = errno.EIO
    monkeypatch.setattr(checkpoints._manager, "save", full)
    with pytest.raises(OSError, match="no room"):
        checkpoints.save(state_of(6))
    checkpoints.close()
    assert restored_step(folder) == 4


def test_digest_is_of_content_and_goes_into_json():
    digest = tree_digest(state_of(3))
    assert digest == json.loads(json.dumps(tree_digest(state_of(3))))
    assert digest != tree_digest(state_of(4)) and len(digest) == 5
