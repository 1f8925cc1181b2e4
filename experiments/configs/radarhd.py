r"""RadarHD's real pairs, one radar image in, an occupancy image out: diffusion.

    python -m experiments.main --config=experiments/configs/radarhd.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd

    python -m experiments.main --config=experiments/configs/radarhd.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd_test --mode=eval \
        --config.weights=experiments/results/radarhd.safetensors

`data.path` is the public folder dataset_5, or the packed part of its training pairs.
`--mode=eval` scores weights on the folder's test pairs, or, where there are none, on
the training trajectories that were kept apart.

2026-11-22, 5,400 steps on one core (1.28 s each beside another run): on trajectories
138 and 140, 124 frames, Heun 18 has a Chamfer distance of 0.219 m, MHD 0.158 m, F-score
68.6 % at 0.2 m; the one-step estimate 0.233 m, 0.145 m, 71.4 %; intervals overlap. On
136 and 137 the estimate had F-scores of 64.6, 70.1, 73.2, 74.3, 75.4 and 75.5 % after
every 900 steps; the rate fell to nothing meanwhile, so this does not say whether data,
network or steps limit it. After 1,800 steps, on every 32nd frame of these, temperatures
of 0.6 and 0.2 cost samples 5 and 28 points, and the mean of an estimate and its mirror
image gained 0.8. Before, 1,200 steps of 16 at weaker noise
(log_mean 0) reached 0.302 m, 0.235 m, 57.3 % and 0.277 m, 0.181 m, 66.1 %.
"""

from ml_collections import ConfigDict


def get_config():
    config = ConfigDict()
    config.task = "radarhd"
    config.purpose = "trained on RadarHD's polar images"
    config.seed = 0

    config.data = ConfigDict()
    config.data.path = ""
    config.data.history = 1  # radar images in a condition, the newest first
    config.data.threshold_trajectories = (136, 137)  # never trained on
    config.data.report_trajectories = (138, 140)  # nor these
    config.data.every = 4  # of the frames of these, one is scored

    config.method = "diffusion"  # or "regression"
    config.weights = ""  # to evaluate; the workdir's own where none are named

    # The network says what radar and surroundings tell of a pixel, Bayes adds what
    # its own noisy value tells: no pixel's noise has to pass through a coarse patch.
    config.noise = ConfigDict()
    config.noise.prediction = "occupancy"
    config.noise.sigma_data = 0.094  # measured: 0.9 % of the pixels are occupied
    config.noise.sigma_min = 0.05
    config.noise.sigma_max = 20.0
    config.noise.rho = 7.0
    config.noise.log_mean = 1.2  # below 0.2 a pixel's own value decides
    config.noise.log_std = 1.2

    # Patches of 16 x 32 pixels of the LiDAR's and 16 x 4 of the radar's image are the
    # same part of the room: both make a grid of 16 x 16, which a CPU can train.
    config.network = ConfigDict()
    config.network.channels = 128
    config.network.multipliers = (1, 1)
    config.network.blocks = 1
    config.network.attention_levels = (0,)
    config.network.stem = (16, 32)
    config.network.condition_stem = (16, 4)
    config.network.condition_channels = 64
    config.network.detail_channels = 0
    config.network.outputs = 1

    config.train = ConfigDict()
    config.train.steps = 5400
    config.train.batch_size = 8
    config.train.learning_rate = 1e-3
    config.train.warmup_steps = 100
    config.train.clip_norm = 1.0
    config.train.weight_decay = 1e-2
    config.train.mirror = True  # left and right are alike: half of the pairs turned
    config.train.ema_decay = 0.995
    config.train.checkpoint_every = 300
    config.train.evaluate_every = 900

    config.sampling = ConfigDict()
    config.sampling.steps = 18
    config.sampling.batch_size = 8
    return config
