r"""RadarHD's real pairs: one radar image in, an occupancy image out, by diffusion.

    python -m experiments.main --config=experiments/configs/radarhd.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd

    python -m experiments.main --config=experiments/configs/radarhd.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd_test --mode=eval \
        --config.weights=experiments/results/radarhd.safetensors

`data.path` is the public folder dataset_5, or a packed file of its training pairs.
`--mode=eval` scores weights on the folder's test pairs; without these, on the training
trajectories that are kept for the report. Training takes two hours on one core.
"""

from ml_collections import ConfigDict, config_dict


def get_config():
    config = ConfigDict()
    config.task = "radarhd"
    config.purpose = "trained on RadarHD's polar images"
    config.seed = 0

    config.data = ConfigDict()
    config.data.path = ""
    config.data.history = 1  # radar images in a condition, newest first
    config.data.threshold_trajectories = (136, 137)  # not trained on
    config.data.report_trajectories = (138, 140)  # not trained on
    config.data.every = 4  # score every fourth frame of both
    config.data.turn = 0.0  # degrees to the left, of the pairs that are reported
    config.data.simulated = ""  # packed file of radarhd_simulated
    config.data.simulated_share = 0.0  # of each batch; 1 trains on them alone

    config.method = "diffusion"  # "nearness": one pass; "regression": a baseline
    config.weights = ""  # to evaluate; by default the workdir's own

    # The network predicts a pixel from radar and surroundings, and Bayes' rule adds its
    # own noisy value: no pixel's noise has to pass through a coarse patch.
    config.noise = ConfigDict()
    config.noise.prediction = "occupancy"
    config.noise.sigma_data = 0.094  # 0.9 % of the pixels are occupied
    config.noise.sigma_min = 0.05
    config.noise.sigma_max = 20.0
    config.noise.rho = 7.0
    config.noise.log_mean = 1.2  # below sigma = 0.2 a pixel's own value decides
    config.noise.log_std = 1.2

    # A patch of 16 x 32 LiDAR pixels covers the same part of the room as one of 16 x 4
    # radar pixels. Both give a grid of 16 x 16 patches, which a CPU can train.
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

    # A U-Net with small patches: what it learns of a wall holds anywhere in the image.
    # It is the network of `radarhd_nearness`; draws may be averaged with its images.
    config.nearness = ConfigDict()
    config.nearness.weights = ""  # "": no row of draws and nearness
    config.nearness.network = ConfigDict()
    config.nearness.network.channels = 32
    config.nearness.network.multipliers = (1, 1, 2, 4)
    config.nearness.network.blocks = 1
    config.nearness.network.attention_levels = ()
    config.nearness.network.stem = (4, 8)
    config.nearness.network.condition_stem = (4, 1)
    config.nearness.network.condition_channels = 32
    config.nearness.network.detail_channels = 0
    config.nearness.network.outputs = 1

    config.train = ConfigDict()
    config.train.initial = config_dict.placeholder(str)  # weights to start from
    config.train.attention_order = config_dict.placeholder(str)
    config.train.steps = 5400
    config.train.batch_size = 8
    config.train.learning_rate = 1e-3
    config.train.warmup_steps = 100
    config.train.clip_norm = 1.0
    config.train.weight_decay = 1e-2
    config.train.mirror = True  # train on mirror images too
    config.train.augment = ()  # names of radarhd_augment.AUGMENTATIONS
    config.train.ema_decay = 0.995
    config.train.checkpoint_every = 300
    config.train.evaluate_every = 900

    config.sampling = ConfigDict()
    config.sampling.steps = 18
    config.sampling.draws = 8  # quick draws for the row of their agreement; 1: no row
    config.sampling.batch_size = 8
    return config
