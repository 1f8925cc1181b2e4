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

        Newer steps that are damaged are named in a warning, and deleted once an older
        one is found to be whole, so that they can be saved anew. Raises ValueError, and
        deletes nothing, where none is.
        """
        abstract = jax.tree.map(ocp.utils.to_shape_dtype_struct, like)
        steps = sorted(self._manager.all_steps(), reverse=True)
        reason = ""
        for index, step in enumerate(steps):
            state, reason = self._read(step, abstract)
            if state is not None:
                for damaged in steps[:index]:
                    self._manager.delete(damaged)
                return state
            logging.warning("checkpoint of step %d is not usable: %s", step, reason)
        if steps:
            raise ValueError(f"none of the checkpoints {steps} is usable: {reason}")
        return None

    def _read(self, step, abstract):
        """State of a step, or None and the reason why it cannot be used."""
        try:
            items: Any = self._manager.restore(
                step,
                args=ocp.args.Composite(
                    state=ocp.args.StandardRestore(abstract),
                    digest=ocp.args.JsonRestore(),
                ),
            )
        except (ValueError, KeyError, OSError) as error:
            return None, str(error).strip().splitlines()[0]
        if items.digest["crc32"] != tree_digest(items.state):
            return None, "its data does not match its digest"
        return items.state, ""

    def close(self) -> None:
        """Finish writing; to be called once, at the end."""
        self._manager.close()


def tree_digest(tree: TrainState) -> dict[str, int]:
    """CRC-32 of every array of a tree, by its path."""
    return {
        jax.tree_util.keystr(path): zlib.crc32(np.ascontiguousarray(leaf).tobytes())
        for path, leaf in jax.tree_util.tree_leaves_with_path(tree)
    }
