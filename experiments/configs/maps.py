r"""ColoRadar's real maps: a radar map in, the probability of LiDAR voxels out.

    python -m experiments.main --config=experiments/configs/maps.py \
        --config.data.path=ColoRadar --workdir=runs/maps

`data.path` is the folder ColoRadar of UpPoinTr, or a folder of packed runs.
`--mode=eval --config.evaluation.split=test` scores the workdir's model, or that of
--config.model, on the published test runs. Training takes 1.5 hours on one core.
"""

from ml_collections import ConfigDict

from experiments.configs import default


def get_config():
    main = default.get_config()
    config = ConfigDict()
    config.task = "maps"
    config.purpose = "trained on real maps of ColoRadar"
    config.seed = main.seed
    config.method = "occupancy"  # or nearness, diffusion
    config.model = ""  # to evaluate; by default the workdir's own

    config.data = ConfigDict()
    config.data.path = ""
    config.data.without = ""  # an environment to leave out, and to validate on
    config.data.validation = (  # one run of each environment; fit the confidence, too
        "arpg_lab_run4",
        "aspen_run11",
        "ec_hallways_run4",
        "edgar_army_run5",
        "edgar_classroom_run5",
        "outdoors_run9",
    )

    config.map = {"voxel_m": 0.15, "heights": 64, "tile": 64}
    config.tiles = {"whole": 0.15, "thin": 0.5}

    # Patches of 2 x 2 columns; without angles, since a tile may lie anywhere.
    config.network = {
        "channels": 64,
        "multipliers": (1, 2, 3),
        "blocks": 1,
        "attention_levels": (),
        "stem": (2, 2),
        "condition_stem": (2, 2),
        "condition_channels": 64,
        "condition_at_input": False,
        "detail_channels": 0,
        "angles": False,
    }

    config.stages, config.average = main.stages, main.average
    config.train = main.train
    config.train.update(steps=4000, checkpoint_every=250, evaluate_every=1000)
    config.train.ema_decay = 0.998

    config.evaluation = ConfigDict()
    config.evaluation.split = "validation"  # or test: the run0 of each environment
    config.evaluation.every = 1  # score every so many patches
    return config
