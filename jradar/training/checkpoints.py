"""Checkpoints by Orbax, verified when they are read; the latest and the best are kept.

Orbax restores data whose bits have changed without complaint, never falls back to an
older step, and takes any folder named by a number for one. So a digest of every array
is stored beside the state, `restore` takes the newest step that is whole, and what is
of no use is put aside, in `<folder>-unusable`, never deleted.
"""

import errno
import json
import math
import os
import shutil
import zlib
from pathlib import Path
from typing import Any

import jax
import numpy as np
import orbax.checkpoint as ocp
from absl import logging

from jradar.training.parallel import wait_for_all
from jradar.training.state import TrainState


class CheckpointError(ValueError):
    """Checkpoints that are all damaged, or of another run."""


class Checkpoints:
    """The checkpoints of one run, in a folder of its own."""

    def __init__(
        self, folder: Path | str, *, keep: int = 2, run: dict[str, Any] | None = None
    ):
        """Checkpoints in `folder`: the `keep` newest stay, and the best.

        `run` is what must be the same when training goes on, as JSON takes it.
        """
        self._folder, self._run = Path(folder).absolute(), run or {}
        self._put_aside(self._foreign(), "not a whole checkpoint")
        policies = ocp.checkpoint_managers
        best = policies.BestN(
            get_metric_fn=_value,
            reverse=True,
            n=1,
            keep_checkpoints_without_metrics=False,
        )
        self._manager = ocp.CheckpointManager(
            self._folder,
            options=ocp.CheckpointManagerOptions(
                preservation_policy=policies.AnyPreservationPolicy(
                    [policies.LatestN(keep), best]
                ),
                best_fn=_value,
                best_mode="min",
                cleanup_tmp_directories=True,
                enable_async_checkpointing=False,
            ),
        )

    def save(self, state: TrainState, *, value: float | None = None) -> None:
        """Save the state under its step, and wait until it is on disk.

        The smallest `value` is the best; none, or one that is not finite, never is.
        Raises OSError where the disk is full; older checkpoints stay.
        """
        step = int(state.step)
        if step in self._manager.all_steps():
            return
        content = {
            "run": self._run,
            "leaves": _leaves(state),
            "crc32": tree_digest(state),
        }
        items = ocp.args.Composite(
            state=ocp.args.StandardSave(state),
            digest=ocp.args.JsonSave({**content, "seal": _seal(content)}),
        )
        ranked = math.inf
        if value is not None and math.isfinite(value):
            ranked = float(value)
        try:
            self._manager.save(
                step,
                args=items,
                metrics={"value": ranked},
            )
        except (OSError, ValueError) as error:
            if not _disk_is_full(error):
                raise
            for scratch in self._folder.glob(f"{step}.*tmp*"):
                shutil.rmtree(scratch, ignore_errors=True)
            raise OSError(
                errno.ENOSPC,
                f"no space left to save step {step}; steps {self._manager.all_steps()} "
                "are kept: free some and run again",
                str(self._folder),
            ) from error

    def restore(self, like: TrainState) -> TrainState | None:
        """The newest state that is whole, of the shapes of `like`; None without any.

        Newer steps that are damaged are named in a warning, and put aside once an older
        one is found to be whole, so that they are saved anew. Raises CheckpointError,
        and moves nothing, where none is, or for the checkpoints of another run.
        """
        return self._first_whole(like, sorted(self._manager.all_steps(), reverse=True))

    def restore_best(self, like: TrainState) -> TrainState | None:
        """The state of the smallest value; None where no step has one."""
        step = self._manager.best_step()
        if step is None or math.isinf(_value(self._manager.metrics(step))):
            return None
        return self._first_whole(like, [step])

    def close(self) -> None:
        """Finish writing; to be called once, at the end."""
        self._manager.close()

    def _first_whole(self, like, steps):
        """State of the first of `steps` that is whole; those before it go aside."""
        reason = ""
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

    def _read(self, step, like):
        """State of a step, or None and the reason why it cannot be used."""
        try:
            items: Any = self._manager.restore(
                step, args=ocp.args.Composite(digest=ocp.args.JsonRestore())
            )
            found = items.digest
            if found.pop("seal") != _seal(found):
                return None, "its digest is damaged"
            self._compare(step, found, like)
            abstract = jax.tree.map(ocp.utils.to_shape_dtype_struct, like)
            items = self._manager.restore(
                step,
                args=ocp.args.Composite(state=ocp.args.StandardRestore(abstract)),
            )
        except CheckpointError:
            raise
        except Exception as error:  # Orbax raises just that for truncated arrays
            return None, f"{type(error).__name__}: {error}".splitlines()[0]
        if found["crc32"] != tree_digest(items.state):
            return None, "its data does not match its digest"
        return items.state, ""

    def _compare(self, step, found, like):
        """Refuse the checkpoint of another run, naming the first difference."""
        for name, given, wanted in (
            ("run", found["run"], self._run),
            ("state", found["leaves"], _leaves(like)),
        ):
            changed = sorted(k for k in given | wanted if given.get(k) != wanted.get(k))
            if changed:
                key = changed[0]
                raise CheckpointError(
                    f"step {step} in {self._folder} is of another {name}: {key} was "
                    f"{given.get(key)}, now {wanted.get(key)} ({len(changed)} such)"
                )

    def _foreign(self):
        """Folders named by a number that the manager would trip over."""
        if not self._folder.is_dir():
            return []
        numbered = [path for path in self._folder.iterdir() if path.name.isdecimal()]
        return [path.name for path in numbered if not _is_checkpoint(path)]

    def _put_aside(self, names, reason):
        """Move steps into a folder beside this one; one process does."""
        aside = self._folder.with_name(f"{self._folder.name}-unusable")
        for name in names if jax.process_index() == 0 else ():
            aside.mkdir(exist_ok=True)
            count = sum(
                path.name.split("-")[0] == str(name) for path in aside.iterdir()
            )
            target = aside / (f"{name}-{count}" if count else str(name))
            logging.warning(
                "%s/%s: %s, moved to %s", self._folder, name, reason, target
            )
            os.replace(self._folder / str(name), target)
        wait_for_all("put aside")


def tree_digest(tree: TrainState) -> dict[str, int]:
    """CRC-32 of every array of a tree, by its path."""
    return {
        jax.tree_util.keystr(path): zlib.crc32(np.ascontiguousarray(leaf).tobytes())
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree)
    }


def _leaves(tree):
    """Type and shape of every array of a tree, by its path."""
    return {
        jax.tree_util.keystr(path): f"{leaf.dtype}{list(leaf.shape)}"
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree)
    }


def _seal(content):
    """Digest of the digests themselves."""
    return zlib.crc32(json.dumps(content, sort_keys=True).encode())


def _is_checkpoint(folder):
    """Whether a manager made the folder, and can read its value."""
    try:
        metrics = json.loads((folder / "metrics" / "metrics").read_bytes())
        readable = isinstance(_value(metrics), float)
    except (OSError, ValueError, KeyError, TypeError):
        return False
    return readable and (folder / "_CHECKPOINT_METADATA").is_file()


def _value(metrics):
    """What checkpoints are ranked by."""
    return metrics["value"]


def _disk_is_full(error):
    """Whether an error, or one that it came from, is a full disk."""
    while error is not None:
        full = isinstance(error, OSError) and error.errno in (
            errno.ENOSPC,
            errno.EDQUOT,
        )
        if full or "RESOURCE_EXHAUSTED" in str(error) or "No space left" in str(error):
            return True
        error = error.__cause__ or error.__context__
    return False
