"""Fine-tuning: a model and the records of one's own rig to a model that knows them.

finetune, FinetuneSpec, Finetuned       the run, resumable, and its result
simulate_replay                         records of old frames
trust_of                                what conditions look like in training

    FOLDER/model/             the model, for load_model(FOLDER) and --model FOLDER
    FOLDER/checkpoints/       from which a stopped run resumes
    FOLDER/metrics.jsonl      loss and validation scores; learning.png draws them
    FOLDER/replay/            simulated frames of the places that the model knew
"""

from jradar.finetuning.frames import simulate_replay as simulate_replay
from jradar.finetuning.tune import (
    Finetuned as Finetuned,
    FinetuneSpec as FinetuneSpec,
    finetune as finetune,
    trust_of as trust_of,
)
