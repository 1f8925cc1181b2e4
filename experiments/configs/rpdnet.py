r"""RPDNet (Cheng et al. 2022), a learned detector, on simulated ColoRadar scenes.

    python -m experiments.main --config=experiments/configs/rpdnet.py \
        --config.data.path=RECORDS --workdir=runs/rpdnet

The network marks cells in the place of a CFAR detector. The authors' network has 64
channels; 16 train on a CPU, in 10 minutes on one core.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.task = "rpdnet"
    config.purpose = "RPDNet, a learned detector, trained on simulated scenes only"
    config.data.min_snr_db = 3.0  # of a labelled cell, above the noise
    config.network = {"channels": 16, "levels": 8}
    config.train.update(steps=2000, batch_size=8, learning_rate=1e-3, warmup_steps=100)
    del config.augment  # range-Doppler maps have no left and right
    config.train.adversarial = 0.1  # weight of the critic's distance; 0: no critic
    config.train.evaluate_every = 500
    config.evaluation.frames_for_limit = 48
    return config
