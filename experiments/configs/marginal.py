r"""One pass: trains `jradar-sim` on, which predicts each pixel's distribution of range.

    python -m experiments.main --config=experiments/configs/marginal.py \
        --workdir=runs/marginal

The network learns the likelihood of LiDAR images (`jradar.diffusion.mixture`). Some
components lie where the radar's points are (`jradar.diffusion.evidence`). Each frame
has a place of its own (`jradar-sim-5`), and changes in size and direction whenever it
is drawn. The card of `jradar-sim` says which trainings and means made it.
"""

from experiments.configs import varied


def get_config():
    config = varied.get_config()
    config.method = "marginal"
    config.noise.prediction = "mixture"
    config.network.kind = "evidence"
    config.train.update(initial="jradar-sim", steps=4000)
    return config
