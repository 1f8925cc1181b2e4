r"""The smoke experiment with a network that compiles in seconds.

python -m experiments.main --config=tests/experiments/tiny_config.py --workdir=run
"""

from experiments.configs import smoke


def get_config():
    config = shrink(smoke.get_config())
    config.train.update(steps=12, batch_size=4, checkpoint_every=4)
    config.sampling.update(steps=3, draws=1)
    config.evaluation.detectors = ("os",)
    return config


def shrink(config):
    """Change images and network to a size that compiles in seconds."""
    config.image.update(coarse=(8, 8), fine=(16, 64))
    config.network.update(channels=8, multipliers=(1,), attention_levels=(), blocks=1)
    config.network.update(stem=(2, 8), condition_stem=(1, 1), condition_channels=8)
    return config
