r"""Smoke test: everything on small images, in two to three minutes on 2 cores.

    python -m experiments.main --config=experiments/configs/smoke.py \
        --workdir=runs/smoke

Runs simulation, preparation, training, evaluation and the report. The network sees too
little data to be useful.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.purpose = "a smoke test: this model is not useful"
    config.data.update(set="jradar-sim-1-mini", frames=2)
    config.points.capacity = 512
    config.image.update(coarse=(16, 16), fine=(32, 128))
    config.network.update(channels=16, multipliers=(1, 2), attention_levels=(1,))
    config.train.update(steps=120, warmup_steps=20, checkpoint_every=60)
    config.train.evaluate_every = 60
    config.train.ema_decay = 0.98
    config.evaluation.update(detectors=("ca", "os"), frames_for_rates=6, every=1)
    config.evaluation.frames_while_training = 2
    return config
