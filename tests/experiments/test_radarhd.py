"""RadarHD's task on invented rooms: training, resumption, limits and the table."""

import numpy as np
import pytest

from experiments.configs import radarhd as default, radarhd_regression
from experiments.radarhd_pairs import LIDAR, RADAR, open_radarhd
from experiments.tasks import radarhd


@pytest.fixture(scope="module")
def packed(tmp_path_factory):
    """Straight walls at a distance of their own in each frame; radar sees them too."""
    path = tmp_path_factory.mktemp("radarhd") / "pairs.npz"
    radar, lidar, keys = [], [], []
    for trajectory in (1, 136, 137, 138, 140):
        for frame in range(2):
            row = 60 + 20 * frame + trajectory % 7
            wall = np.zeros(LIDAR.shape, bool)
            wall[row] = True
            echo = np.zeros(RADAR.shape, np.uint8)
            echo[row - 1 : row + 2] = 200
            radar.append(echo)
            lidar.append(np.packbits(wall, axis=-1))
            keys.append((trajectory, frame))
    trajectory, frame = np.array(keys).T
    np.savez(
        path,
        radar=np.stack(radar),
        lidar_packed=np.stack(lidar),
        trajectory=trajectory,
        frame=frame,
    )
    return path


def small(module, path):
    config = module.get_config()
    config.data.update(path=str(path), every=1)
    config.network.update(
        channels=8, multipliers=(1,), attention_levels=(), condition_channels=8
    )
    config.train.update(steps=3, batch_size=2, checkpoint_every=2, evaluate_every=2)
    config.train.warmup_steps = 1
    config.sampling.update(steps=2, batch_size=2)
    return config


def test_mirrored_items_are_turned_left_and_right(packed):
    pairs = open_radarhd(packed)
    items = radarhd.Items(pairs, history=2, mirror=True)
    assert len(items) == 2 * len(pairs)
    plain, turned = items[1], items[1 + len(pairs)]
    np.testing.assert_array_equal(turned.target, plain.target[:, ::-1])
    np.testing.assert_array_equal(turned.condition, plain.condition[:, ::-1])
    assert plain.condition.shape == (256, 64, 2) and plain.condition.max() <= 1
    assert set(np.unique(plain.target)) == {0.0, 1.0}


@pytest.mark.parametrize("module", [default, radarhd_regression])
def test_a_run_ends_with_its_table_and_goes_on_from_its_checkpoint(
    module, packed, tmp_path, capsys
):
    config = small(module, packed)
    radarhd.run_training(config, tmp_path)
    table = (tmp_path / "evaluation" / "table.md").read_text()
    names = {"diffusion": ["one-step estimate", "diffusion, Heun 2"]}
    for name in names.get(config.method, ["direct regression"]):
        assert name in table
    assert "138, 140" in table and table in capsys.readouterr().out
    assert (tmp_path / "evaluation" / "samples.png").stat().st_size > 5000
    assert (tmp_path / "weights.safetensors").stat().st_size < 2e6
    elsewhere = tmp_path / "elsewhere"
    with pytest.raises(FileNotFoundError, match="no weights at .*elsewhere"):
        radarhd.run_evaluation(config, elsewhere)
    config.weights = str(tmp_path / "weights.safetensors")
    radarhd.run_evaluation(config, elsewhere)
    assert (elsewhere / "evaluation" / "table.md").read_text() == table


def test_the_limit_with_the_best_mean_is_chosen():
    rows = [
        {"method": "a", "limit": limit, "f_score_0.2": score}
        for limit, scores in ((0.1, (0.9, 0.1)), (0.5, (0.6, 0.6)), (0.9, (0.0, 0.9)))
        for score in scores
    ]
    assert radarhd.choose_limits(rows) == {"a": 0.5}


def test_a_frame_where_nothing_was_found():
    truth = np.array([[1.0, 0.0, 0.0]])
    nothing = radarhd.plane_scores(np.empty((0, 3)), truth)
    assert np.isnan(nothing["chamfer"]) and nothing["f_score_0.2"] == 0
    found = radarhd.plane_scores(truth + [0.3, 0, 0], truth)
    assert found["chamfer"] == pytest.approx(0.3)
    assert radarhd.mean_scores([nothing, found])["chamfer"] == pytest.approx(5.55)
