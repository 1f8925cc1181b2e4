r"""RadarHD's real pairs in one pass: how near each pixel is to the closest LiDAR point.

    python -m experiments.main --config=experiments/configs/radarhd_nearness.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd_nearness

    python -m experiments.main --config=experiments/configs/radarhd_nearness.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd_test --mode=eval \
        --config.model=radarhd-nearness

Its condition is that of `radarhd_history`, the radar images of two seconds. Training
takes an hour on one core.
"""

from experiments.configs import radarhd_history


def get_config():
    config = radarhd_history.get_config()
    config.method = "nearness"
    # A U-Net with small patches: what it learns of a wall holds anywhere in the image.
    config.network.update(channels=32, multipliers=(1, 1, 2, 4), attention_levels=())
    config.network.update(stem=(4, 8), condition_stem=(4, 1), condition_channels=32)
    config.train.update(steps=4000, warmup_steps=50, ema_decay=0.99)
    return config
