r"""The paper's setting on the real ColoRadar data set; for a GPU.

    python -m experiments.main --config=experiments/configs/coloradar.py \
        --config.data.path=RECORDS --config.train.initial=WEIGHTS \
        --workdir=runs/coloradar

Prepare the downloaded set first: `jradar prepare COLORADAR -o RECORDS` uses the paper's
split. It has not been run to the end yet.
"""

from experiments.configs import paper


def get_config():
    config = paper.get_config()
    config.purpose = "trained on ColoRadar, single chip, split of the paper"
    config.data.set = ""
    return config
