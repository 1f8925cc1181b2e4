"""Networks: built from configs, described as JSON, wrong names refused."""

import json

import numpy as np
import pytest
import safetensors

from jradar import diffusion
from jradar.model import load_model, shipped_models


def test_a_presets_fields_can_be_replaced():
    network = diffusion.build_network(preset="small", channels=64)
    assert network == diffusion.UNet(**diffusion.PRESETS["small"] | {"channels": 64})
    assert diffusion.build_network() == diffusion.UNet()


def test_json_of_a_network_makes_an_equal_network():
    network = diffusion.build_network(preset="tiny", outputs=4)
    values = json.loads(json.dumps(diffusion.network_fields(network)))
    assert values["kind"] == "unet" and "dtype" not in values
    again = diffusion.network_from_fields(values)
    assert again == network and hash(again) == hash(network)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kind": "vit"}, r"kind = 'vit', expected one of \['unet', 'evidence'\]"),
        ({"preset": "huge"}, "preset = 'huge', expected one of .*'tiny'"),
        ({"chanels": 64}, "'chanels', expected channels"),
    ],
)
def test_unknown_names_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        diffusion.build_network(**options)


def test_networks_without_an_entry_are_refused():
    class Other(diffusion.UNet):
        """A network that no config can name."""

    with pytest.raises(ValueError, match="Other has no entry in NETWORKS"):
        diffusion.network_fields(Other())


def test_shipped_weights_are_rewritten_byte_for_byte_and_start_a_training(tmp_path):
    # Those of eight bits are not: their steps are rounded once more.
    path = shipped_models()["jradar-sim-diffusion"] / "weights.safetensors"
    with safetensors.safe_open(path, "numpy") as file:
        metadata = file.metadata()
    params, copy = diffusion.read_params(path), tmp_path / "weights.safetensors"
    assert params["params"]["trunk"]["stem"]["kernel"].dtype == np.float32
    diffusion.write_params(copy, params, metadata=metadata)
    assert copy.read_bytes() == path.read_bytes()
    network = load_model("jradar-sim-diffusion").spec.network
    _, report = diffusion.load_pretrained(path, network, params)
    assert not report.new and not report.unused
    with pytest.raises(FileNotFoundError):
        diffusion.read_params(tmp_path / "none.safetensors")
