"""The training loop: a pure step, exact resumption, verified checkpoints.

TrainState, create_state         what a checkpoint holds
Batch, make_train_step           (state, key, batch) -> (state, metrics), pure
train, Interrupted               steps, evaluation, metrics.jsonl, checkpoints
Checkpoints, CheckpointError     Orbax with a digest of every array
join_processes                   several processes with jax.distributed
write_model_card                 data, config and versions of a run
"""

from jradar.errors import CheckpointError as CheckpointError
from jradar.training.checkpoints import Checkpoints as Checkpoints
from jradar.training.logs import write_model_card as write_model_card
from jradar.training.loop import Interrupted as Interrupted, train as train
from jradar.training.parallel import join_processes as join_processes
from jradar.training.step import (
    Batch as Batch,
    TrainState as TrainState,
    create_state as create_state,
    ema_decay_at as ema_decay_at,
    make_train_step as make_train_step,
)
