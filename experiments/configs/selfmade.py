r"""The paper's own kind of captures, AWR1843BOOST and Livox Mid-360; for a GPU.

    python -m experiments.main --config=experiments/configs/selfmade.py \
        --config.data.path=RECORDS --config.train.initial=WEIGHTS \
        --workdir=runs/selfmade

Describe each capture by a capture.toml, and prepare them with `jradar prepare CAPTURES
-o RECORDS`. It has not been run to the end yet.
"""

from experiments.configs import coloradar


def get_config():
    config = coloradar.get_config()
    config.purpose = "trained on captures with an AWR1843BOOST and a Livox Mid-360"
    return config
