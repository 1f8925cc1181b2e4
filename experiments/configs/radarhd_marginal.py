r"""RadarHD's real pairs in one pass: the probability that each pixel is occupied.

    python -m experiments.main --config=experiments/configs/radarhd_marginal.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd_marginal

A U-Net with small patches: what it learns of a wall holds anywhere in the image, which
helps in buildings that it has not seen.
"""

from experiments.configs import radarhd


def get_config():
    config = radarhd.get_config()
    config.method = "marginal"
    config.network.update(
        channels=32,
        multipliers=(1, 2, 4, 4),
        attention_levels=(),
        stem=(4, 8),
        condition_stem=(4, 1),
        condition_channels=32,
    )
    return config
