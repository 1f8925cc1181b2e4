r"""Smoke test: the whole way on small images, in about a minute on 2 cores.

    python -m experiments.main --config=experiments/configs/smoke.py \
        --workdir=runs/smoke

It proves the plumbing. The network sees too little to be of use.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.purpose = "a smoke test: these weights prove the plumbing, nothing else"
    config.radar.update(num_chirps=32, num_samples=64)
    config.image.update(coarse=(16, 16), fine=(32, 128))
    config.points.capacity = 512
    config.baseline.capacity = 512
    config.data.update(num_train=96, num_validation=8)
    config.network.update(multipliers=(1, 2), attention_levels=(1,))
    config.train.update(steps=120, warmup_steps=20, checkpoint_every=40)
    config.train.ema_decay = 0.98
    return config
