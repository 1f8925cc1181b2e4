r"""RPDNet (Cheng et al. 2022), a learned detector, on the simulated ColoRadar.

    python -m experiments.main --config=experiments/configs/rpdnet.py \
        --config.data.path=RECORDS --workdir=runs/rpdnet

Its points are those of a CFAR detector with another mask; `evaluation.read_runs` puts
its row beside other runs on the same records. Sixteen channels are for a CPU: the
authors' network has 64. 2,000 steps take 10 minutes on one core (2026-11-22); its row
in README is of 576 layouts of 4 frames.
"""

from experiments.configs import default


def get_config():
    config = default.get_config()
    config.task = "rpdnet"
    config.data.frames = 2  # labels need a velocity, between two of a layout
    config.data.min_snr_db = 3.0  # of a cell that the LiDAR confirms, over the noise
    config.network = {"channels": 16, "levels": 8}
    config.train.update(steps=2000, batch_size=8, learning_rate=1e-3, warmup_steps=100)
    config.train.mirror = False  # maps of range and Doppler have no left and right
    config.train.adversarial = 0.1  # weight of the critic's distance; 0 goes without
    config.train.evaluate_every = 500
    config.evaluation.frames_for_limit = 48
    return config
