r"""The paper's own setting on simulated ColoRadar scenes; for a GPU.

    python -m experiments.main --config=experiments/configs/paper.py \
        --config.train.initial=WEIGHTS --workdir=runs/paper

The trunk of EDM's FFHQ network with a horizontal stem, EDM's noise levels and
prediction (Karras et al. 2022, Table 1), all terms of Eq. 12, and one draw at
temperature 1. WEIGHTS are those of a network for images, such as EDM's FFHQ network
(`experiments.convert_weights`). It has not been run to the end yet: a step of one frame
takes 13 s and 6.3 GiB on two CPU cores in float32.
"""

from experiments.configs import paper_loss


def get_config():
    config = paper_loss.get_config()
    config.network = {"preset": "paper", "dtype": "bfloat16", "remat": True}
    config.noise.update(prediction="edm", sigma_data=0.5, log_mean=-1.2, log_std=1.2)
    config.train.initial = ""
    config.train.update(steps=100_000, batch_size=32, learning_rate=2e-4)
    config.train.ema_decay = 0.9999
    config.sampling.update(temperature=1.0, draws=1)
    return config
