"""Checkpoints by Orbax, verified when they are read; the newest ones are kept.

Orbax restores flipped bits without complaint, never falls back to an older step, and
takes any folder named by a number for a checkpoint. Therefore a digest of every array
is stored with the state, `restore` returns the newest step that is whole, and
unusable folders are moved to `<folder>-unusable`, never deleted.
"""

import errno
import json
import os
import shutil
import zlib
from pathlib import Path
from typing import Any

import jax
import numpy as np
import orbax.checkpoint as ocp
from absl import logging

from jradar.errors import CheckpointError
from jradar.files import DISK_FULL
from jradar.training.parallel import wait_for_all
from jradar.training.step import TrainState


class Checkpoints:
    """The checkpoints of one run, in a folder that nothing else uses."""

    def __init__(
        self, folder: Path | str, *, keep: int = 2, run: dict[str, Any] | None = None
    ):
        """Open the checkpoints in `folder`, of which the `keep` newest stay.

        `run` identifies the run (JSON values); `restore` refuses checkpoints of others.
        """
        self._folder, self._run = Path(folder).absolute(), run or {}
        names = [path.name for path in self._folder.glob("*") if _is_foreign(path)]
        self._put_aside(names, "not a whole checkpoint")
        options = ocp.CheckpointManagerOptions(
            max_to_keep=keep,
            cleanup_tmp_directories=True,
            enable_async_checkpointing=False,
        )
        self._manager = ocp.CheckpointManager(self._folder, options=options)

    def save(self, state: TrainState) -> None:
        """Save the state under its step, and wait until it is on disk.

        Raises OSError if the disk is full; older checkpoints stay.
        """
        step = int(state.step)
        if step in self._manager.all_steps():
            return
        shapes, digest = _leaves(state), tree_digest(state)
        content = {"run": self._run, "leaves": shapes, "crc32": digest}
        items = ocp.args.Composite(
            state=ocp.args.StandardSave(state),
            digest=ocp.args.JsonSave({**content, "seal": _seal(content)}),
        )
        try:
            self._manager.save(step, args=items)
        except (OSError, ValueError) as error:
            if not _disk_is_full(error):
                raise
            for scratch in self._folder.glob(f"{step}.orbax-checkpoint-tmp*"):
                shutil.rmtree(scratch, ignore_errors=True)
            raise OSError(
                errno.ENOSPC,
                f"no space left to save step {step}; steps {self._manager.all_steps()} "
                "are kept: free space, then run again",
                str(self._folder),
            ) from error

    def restore(self, like: TrainState) -> TrainState | None:
        """Return the newest whole state, with the shapes of `like`; None without any.

        A warning names every damaged step that is newer. If an older step is whole,
        the damaged ones are moved aside, so that they can be saved again. Raises
        CheckpointError, and moves nothing, if no step is whole or if the checkpoints
        belong to another run.
        """
        steps, reason = sorted(self._manager.all_steps(), reverse=True), ""
        for index, step in enumerate(steps):
            state, reason = self._read(step, like)
            if state is not None:
                self._put_aside(steps[:index], "damaged")
                self._manager.reload()
                return state
            logging.warning("checkpoint of step %d is not usable: %s", step, reason)
        if steps:
            raise CheckpointError(
                f"none of the checkpoints {steps} in {self._folder} is usable: {reason}"
            )
        return None

    def close(self) -> None:
        """Finish writing. Call it once, at the end."""
        self._manager.close()

    def _read(self, step, like):
        """Return the state of a step, or None and the reason why it cannot be used."""
        try:
            wanted = ocp.args.Composite(digest=ocp.args.JsonRestore())
            items: Any = self._manager.restore(step, args=wanted)
            found = items.digest
            if found.pop("seal") != _seal(found):
                return None, "its digest is damaged"
            self._compare(step, found, like)
            abstract = jax.tree.map(ocp.utils.to_shape_dtype_struct, like)
            wanted = ocp.args.Composite(state=ocp.args.StandardRestore(abstract))
            items = self._manager.restore(step, args=wanted)
        except CheckpointError:
            raise
        except Exception as error:  # the kind that Orbax raises for truncated arrays
            return None, f"{type(error).__name__}: {error}".splitlines()[0]
        if found["crc32"] != tree_digest(items.state):
            return None, "its data does not match its digest"
        return items.state, ""

    def _compare(self, step, found, like):
        """Raise CheckpointError for the checkpoint of another run."""
        for name, given, wanted in (
            ("run", found["run"], self._run),
            ("state", found["leaves"], _leaves(like)),
        ):
            changed = sorted(k for k in given | wanted if given.get(k) != wanted.get(k))
            if changed:
                key = changed[0]
                raise CheckpointError(
                    f"step {step} in {self._folder} is of another {name}: {key} was "
                    f"{given.get(key)}, now {wanted.get(key)} ({len(changed)} differ); "
                    "choose another workdir"
                )

    def _put_aside(self, names, reason):
        """Move steps into a folder next to this one, in the first process."""
        aside = self._folder.with_name(f"{self._folder.name}-unusable")
        for name in names if jax.process_index() == 0 else ():
            aside.mkdir(exist_ok=True)
            count = sum(p.name.split("-")[0] == str(name) for p in aside.iterdir())
            source = self._folder / str(name)
            target = aside / (f"{name}-{count}" if count else str(name))
            logging.warning("%s: %s, moved to %s", source, reason, target)
            os.replace(source, target)
        wait_for_all("put aside")


def tree_digest(tree: TrainState) -> dict[str, int]:
    """Return the CRC-32 of every array of a tree, by its path."""
    return {
        jax.tree_util.keystr(path): zlib.crc32(np.ascontiguousarray(leaf).tobytes())
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree)
    }


def _leaves(tree):
    """Return the type and shape of every array of a tree, by its path."""
    return {
        jax.tree_util.keystr(path): f"{leaf.dtype}{list(leaf.shape)}"
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree)
    }


def _seal(content):
    return zlib.crc32(json.dumps(content, sort_keys=True).encode())


def _is_foreign(path):
    """Return whether a path is named by a number, but is not a checkpoint of Orbax."""
    return path.name.isdecimal() and not (path / "_CHECKPOINT_METADATA").is_file()


def _disk_is_full(error):
    """Return whether an error, or one of its causes, is a full disk."""
    while error is not None:
        full = getattr(error, "errno", None) in DISK_FULL
        if full or "RESOURCE_EXHAUSTED" in str(error) or "No space left" in str(error):
            return True
        error = error.__cause__ or error.__context__
    return False
