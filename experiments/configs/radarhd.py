r"""RadarHD's real pairs: one radar image in, an occupancy image out, by diffusion.

    python -m experiments.main --config=experiments/configs/radarhd.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd

    python -m experiments.main --config=experiments/configs/radarhd.py \
        --config.data.path=dataset_5 --workdir=runs/radarhd_test --mode=eval \
        --config.model=radarhd

`data.path` is the public folder dataset_5, or a packed file of its training pairs.
`--mode=eval` scores a model on the folder's test pairs; without these, on the training
trajectories that are kept for the report. Training takes two hours on one core.
"""

from ml_collections import ConfigDict

from experiments.configs import default


def get_config():
    main = default.get_config()
    config = ConfigDict()
    config.task = "radarhd"
    config.purpose = "trained on RadarHD's polar images"
    config.seed = main.seed

    config.data = ConfigDict()
    config.data.path = ""
    config.data.simulated = ""  # folder of simulated pairs, every other one of training
    config.data.history = 1  # radar images in a condition, newest first
    config.data.threshold_trajectories = (136, 137)  # not trained on
    config.data.report_trajectories = (138, 140)  # not trained on
    config.data.every = 4  # score every fourth frame of both
    config.data.turn = 0.0  # degrees to the left, of the pairs that are reported

    config.method = "diffusion"  # "nearness": one pass; "regression": a baseline
    config.answer = "occupancy"  # of the model in one pass, or by draws: "diffusion"
    config.model = ""  # to evaluate; by default the workdir's own

    # The network predicts a pixel from radar and surroundings, and Bayes' rule adds its
    # own noisy value: no pixel's noise has to pass through a coarse patch.
    config.noise = main.noise
    config.noise.prediction = "occupancy"
    config.noise.sigma_data = 0.094  # 0.9 % of the pixels are occupied
    config.noise.update(sigma_min=0.05, sigma_max=20.0)
    config.noise.log_mean = 1.2  # below sigma = 0.2 a pixel's own value decides
    config.noise.log_std = 1.2

    # A patch of 16 x 32 LiDAR pixels covers the same part of the room as one of 16 x 4
    # radar pixels. Both give a grid of 16 x 16 patches, which a CPU can train.
    config.network = {
        "channels": 128,
        "multipliers": (1, 1),
        "blocks": 1,
        "attention_levels": (0,),
        "stem": (16, 32),
        "condition_stem": (16, 4),
        "condition_channels": 64,
        "detail_channels": 0,
        "outputs": 1,
    }
    config.nearness = ""  # model whose images are averaged with draws; "": no row

    config.stages, config.average = main.stages, main.average
    config.train = main.train
    config.train.mirror = True  # every other pair
    config.train.update(steps=5400, checkpoint_every=300)
    config.train.varied = False  # other speeds, rotations and sizes of places

    # The confidence is fitted to the pairs of the limits. Rotated, and with rooms of
    # sizes that varied pairs seldom have, they stand for another building.
    config.confidence = ConfigDict()
    config.confidence.turns = (0.0, 20.0, 40.0)  # degrees to the left
    config.confidence.sizes = (0.4, 0.5, 1.6, 2.0)  # relative to their own

    config.sampling = ConfigDict()
    config.sampling.steps = 18
    config.sampling.draws = 8  # quick draws for the row of their agreement; 1: no row
    config.sampling.batch_size = 8
    return config
