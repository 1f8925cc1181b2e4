"""The training loop: a pure step, exact resumption, verified checkpoints.

    state = create_state(key, network, optimizer, image_shape=..., condition_shape=...)
    step = make_train_step(network, optimizer, noise, loss=LOSSES["view"]["marginal"])
    batch_at = pair_batches(records, spec, AugmentSpec(), batch_size=8, seed=0)
    state = train(key, state, step, batch_at, steps=4000, workdir="run")

A run that is stopped resumes where it was. `finetune` trains a model on the records of
one's own rig; it is loaded when it is first named.
"""

import importlib
from typing import TYPE_CHECKING, Any

from jradar.training.logs import write_model_card as write_model_card
from jradar.training.loop import train as train
from jradar.training.losses import LOSSES as LOSSES, view_losses as view_losses
from jradar.training.optimiser import clipped_adamw as clipped_adamw
from jradar.training.parallel import join_processes as join_processes
from jradar.training.step import (
    Batch as Batch,
    Loss as Loss,
    TrainState as TrainState,
    create_state as create_state,
    make_step as make_step,
    make_train_step as make_train_step,
    state_of as state_of,
)
from jradar.training.targets import pair_batches as pair_batches

if TYPE_CHECKING:
    from jradar.training.finetuning import (
        FinetuneSpec as FinetuneSpec,
        finetune as finetune,
    )


def __getattr__(name: str) -> Any:
    """Load fine-tuning on first use: it also evaluates, simulates and draws."""
    if name in ("FinetuneSpec", "finetune"):
        return getattr(importlib.import_module("jradar.training.finetuning"), name)
    raise AttributeError(f"module 'jradar.training' has no attribute {name!r}")
