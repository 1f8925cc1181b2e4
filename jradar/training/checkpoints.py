"""Checkpoints by Orbax, verified when they are read.

Orbax restores data whose bits have changed without complaint, and never falls back to
an older step; both are done here: a digest of every array is stored beside the state,
and `restore` takes the newest step that is whole.
"""

import zlib
from pathlib import Path
from typing import Any

import jax
import numpy as np
import orbax.checkpoint as ocp
from absl import logging

from jradar.training.state import TrainState


class Checkpoints:
    """The checkpoints of one run, in a folder of its own."""

    def __init__(self, folder: Path | str, *, keep: int = 2):
        """Checkpoints in `folder`, of which the `keep` newest stay."""
        self._manager = ocp.CheckpointManager(
            Path(folder).absolute(),
            options=ocp.CheckpointManagerOptions(
                preservation_policy=ocp.checkpoint_managers.LatestN(keep),
                cleanup_tmp_directories=True,
                enable_async_checkpointing=False,
            ),
        )

    def save(self, state: TrainState) -> None:
        """Save the state under its step, and wait until it is on disk."""
        step = int(state.step)
        if step in self._manager.all_steps():
            return
        items = ocp.args.Composite(
            state=ocp.args.StandardSave(state),
            digest=ocp.args.JsonSave({"crc32": tree_digest(state)}),
        )
        self._manager.save(step, args=items)

    def restore(self, like: TrainState) -> TrainState | None:
        """The newest state that is whole, of the shapes of `like`; None without any.

        Steps that are damaged are named in a warning and deleted, so that they are
        saved anew. Raises ValueError where every step there is is damaged.
        """
        abstract = jax.tree.map(ocp.utils.to_shape_dtype_struct, like)
        steps = sorted(self._manager.all_steps(), reverse=True)
        for step in steps:
            try:
                items: Any = self._manager.restore(
                    step,
                    args=ocp.args.Composite(
                        state=ocp.args.StandardRestore(abstract),
                        digest=ocp.args.JsonRestore(),
                    ),
                )
            except (ValueError, KeyError, OSError) as error:
                reason = str(error).splitlines()[0]
            else:
                if items.digest["crc32"] == tree_digest(items.state):
                    return items.state
                reason = "its data does not match its digest"
            logging.warning("checkpoint of step %d is damaged: %s", step, reason)
            self._manager.delete(step)
        if steps:
            raise ValueError(f"none of the checkpoints {steps} is whole")
        return None

    def close(self) -> None:
        """Finish writing; to be called once, at the end."""
        self._manager.close()


def tree_digest(tree: TrainState) -> dict[str, int]:
    """CRC-32 of every array of a tree, by its path."""
    return {
        jax.tree_util.keystr(path): zlib.crc32(np.ascontiguousarray(leaf).tobytes())
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree)
    }
