"""The model card records data, config and versions."""

import json

import jax

import jradar
from jradar.training import write_model_card


def test_the_card_holds_config_data_and_versions(tmp_path):
    config = {"train": {"steps": 7}, "image": {"coarse": (8, 8)}}
    write_model_card(
        tmp_path, config=config, data_digest="rooms 12ab", seed=3, steps=7,
        purpose="a test",
    )  # fmt: skip
    card = json.loads((tmp_path / "model_card.json").read_text())
    assert card["config"] == {"train": {"steps": 7}, "image": {"coarse": [8, 8]}}
    assert card["versions"]["jax"] == jax.__version__
    assert card["versions"]["jradar"] == jradar.__version__
    assert card["data_digest"] == "rooms 12ab"
    assert (card["purpose"], card["seed"], card["steps"]) == ("a test", 3, 7)
