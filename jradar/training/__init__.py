"""The training loop: a pure step, exact resumption, checkpoints that are verified.

TrainState, create_state         what a checkpoint holds
make_train_step                  (state, key, batch) -> (state, metrics), pure
train                            steps, progress, metrics.jsonl, checkpoints
Checkpoints                      Orbax, with a digest of its own
"""

from jradar.training.checkpoints import Checkpoints as Checkpoints
from jradar.training.loop import (
    Interrupted as Interrupted,
    train as train,
)
from jradar.training.state import TrainState as TrainState, create_state as create_state
from jradar.training.step import Batch as Batch, make_train_step as make_train_step
