"""The training loop: a pure step, exact resumption, verified checkpoints.

state = create_state(key, network, optimizer, **shapes)   # what a checkpoint holds
step = make_train_step(network, optimizer, noise)         # pure and jitted
train(key, state, step, batches.__getitem__, steps=5000, workdir="run")
"""

from jradar.training.logs import write_model_card as write_model_card
from jradar.training.loop import (
    train as train,
)
from jradar.training.step import (
    Batch as Batch,
    TrainState as TrainState,
    create_state as create_state,
    make_train_step as make_train_step,
)
