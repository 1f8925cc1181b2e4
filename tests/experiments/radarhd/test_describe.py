"""What a training adds to its weights: a card, and tables fitted to spared pairs."""

import re

import numpy as np

from experiments.configs import radarhd
from experiments.radarhd.describe import described, judged_pairs, reliability_table
from experiments.radarhd.pairs import RadarHD, open_radarhd
from jradar.model.grids.polar import LIDAR, RADARHD
from tests.experiments.radarhd.conftest import random_model, shrink


def test_a_described_model_is_as_sure_of_spared_pairs_as_it_is_right(walls):
    config = shrink(radarhd.get_config(), walls)
    config.confidence.sizes = ()
    pairs = open_radarhd(walls)
    train, spared = pairs.of([1, 138]), pairs.of([136, 137])
    lidar = spared.lidar
    hears = RadarHD(
        spared.keys, spared.radar, lidar, lambda i: LIDAR.xyz[lidar(i)][100:400]
    )
    params = random_model(config, scale=0.5).params
    model = described(config, params, [spared, hears], 10 * [train])
    assert model.card.radar == RADARHD and "simulated" in model.card.trained_on
    tables = model.tables
    assert all(part is not None for part in tables)
    alone = described(config, params, [spared], [train])
    assert alone.tables.echoes is None and "simulated" not in alone.card.trained_on
    frames = [*judged_pairs(alone, spared, range(len(spared)))]
    assert len(frames) == 4 and all(0 < f.right.mean() < 1 for f in frames)
    whole = alone.with_tables(
        confidence=alone.tables.confidence._replace(least=np.float32(0))
    )
    table = reliability_table(whole, spared, range(len(spared)))
    (line,) = (line for line in table.splitlines() if "112 to 140" in line)
    sure, right = map(float, re.findall(r"\d+\.\d", line)[:2])
    assert abs(sure - right) < 3 and right > 0
