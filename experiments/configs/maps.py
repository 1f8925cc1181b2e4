r"""ColoRadar's real maps: a radar map in, the probability of LiDAR voxels out.

    python -m experiments.main --config=experiments/configs/maps.py \
        --config.data.path=coloradar_maps --workdir=runs/maps
"""

from ml_collections import ConfigDict

from experiments.configs import default


def get_config():
    main = default.get_config()
    config = ConfigDict()
    config.task = "maps"
    config.purpose = "trained on ColoRadar's maps"
    config.seed = main.seed

    config.data = ConfigDict()
    config.data.path = ""
    config.data.validation = (  # runs, not trained on
        "arpg_lab_run4",
        "aspen_run11",
        "ec_hallways_run4",
        "edgar_army_run5",
        "edgar_classroom_run5",
        "outdoors_run9",
    )
    config.data.without = ""  # an environment that training leaves out

    config.map = {"voxel_m": 0.15, "heights": 64, "tile": 64}
    config.tiles = {"whole": 0.15, "thin": 0.5}
    config.network = {
        "channels": 64,
        "multipliers": (1, 2, 3),
        "blocks": 1,
        "attention_levels": (),
        "stem": (2, 2),
        "condition_stem": (2, 2),
        "condition_channels": 64,
        "detail_channels": 0,
        "outputs": 65,
        "angles": False,
    }
    config.train = main.train
    del config.train.thin
    config.train.update(steps=6000, checkpoint_every=250, evaluate_every=500)
    config.train.ema_decay = 0.998

    config.evaluation = ConfigDict()
    config.evaluation.every = 5
    return config
