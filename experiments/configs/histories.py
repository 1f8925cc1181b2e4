r"""The points of the last second: trains `jradar-sim` on, with what radars send.

    python -m experiments.places --set=jradar-sim-6 --maps=ColoRadar -o runs/sim6
    python -m experiments.studies.map_views --maps ColoRadar --views 900 --thin \
        -o runs/views
    python -m experiments.main --config=experiments/configs/histories.py \
        --config.data.path=runs/sim6 --config.data.views=runs/views \
        --workdir=runs/histories

A condition holds the points of 1 to 12 frames of a walk (`jradar-sim-6`), and its
detector is drawn, too: all weak cells, as a capture card gives them, or the few points
of a chip (`jradar.data.histories`). Views of ColoRadar's real radar maps add real
ghosts and gaps.

Training on costs single dense frames 3 points. The mean of both networks, 0.4 of what
it starts from and 0.6 of what it ends with, costs none.
"""

from experiments.configs import marginal


def get_config():
    config = marginal.get_config()
    config.data.set = "jradar-sim-6"
    config.image.channels = ("presence", "range", "power", "age", "count")
    config.history.update(frames=12, sparse=0.5, drift=0.5)
    config.train.update(learning_rate=4e-4)
    config.stages = ({"train": {"steps": 0}}, {"train": {"steps": 3000}})
    config.average = (0.4, 0.6)
    return config
