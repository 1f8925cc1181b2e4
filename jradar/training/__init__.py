"""The training loop: a pure step, exact resumption, checkpoints that are verified.

TrainState, create_state         what a checkpoint holds
make_train_step, ema_decay_at    (state, key, batch) -> (state, metrics), pure
train                            steps, evaluation, metrics.jsonl, checkpoints
Checkpoints                      Orbax, with a digest of its own; latest and best
join_processes                   before training with jax.distributed
write_model_card                 what a run was made from
"""

from jradar.training.cards import write_model_card as write_model_card
from jradar.training.checkpoints import (
    CheckpointError as CheckpointError,
    Checkpoints as Checkpoints,
)
from jradar.training.loop import (
    Interrupted as Interrupted,
    train as train,
)
from jradar.training.parallel import join_processes as join_processes
from jradar.training.state import TrainState as TrainState, create_state as create_state
from jradar.training.step import (
    Batch as Batch,
    ema_decay_at as ema_decay_at,
    make_train_step as make_train_step,
)
