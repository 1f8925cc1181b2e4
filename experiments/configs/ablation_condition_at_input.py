r"""Ablation: the condition resized and concatenated with the noisy image.

    python -m experiments.main \
        --config=experiments/configs/ablation_condition_at_input.py \
        --config.data.path=RECORDS --workdir=runs/ablation_condition_at_input

The paper has it enter while downsampling, as `default` does. 2026-11-22, on 96 layouts
of 20 frames, none mirrored, 550 steps of each, 48 validation frames, Heun 18 at 0.6:
0.95 m and 46.0 % (F-score at 0.2 m) against 1.07 m and 40.1 % of `default`; frame by
frame +5.9 points (3.8 to 8.0) and -0.13 m (-0.20 to -0.05). As many steps teach it
more, but one takes 2.9 s on a core where `default` takes about 1.1 s. Between them:
experiments/README.md.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.network.condition_at_input = True
    return config
