"""A model on disk: what is kept, and what is refused."""

import copy
import dataclasses
import functools
import itertools
import json
import operator

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax.traverse_util import flatten_dict, unflatten_dict

import jradar
from jradar.errors import ModelError
from jradar.model import Model, draw, load_model, save_model, shipped_models
from jradar.model.mirror import Scaling
from jradar.options import models
from jradar.radar import PointSpec
from jradar.range_image import ConfidenceTable, ImageSpec, fit_trust
from tests.models import (
    CONDITION_SHAPE,
    changed,
    tiny_map_model,
    tiny_model,
    tiny_polar_model,
)


@pytest.fixture(scope="module")
def model():
    return tiny_model(fine=ImageSpec(8, 32, azimuth=(-1.0, 0.5)))


@pytest.fixture(scope="module")
def leaves(model):
    """Parameters by name, on the host."""
    return {k: np.asarray(v) for k, v in flatten_dict(model.params, sep="/").items()}


@pytest.fixture
def saved(tmp_path, model):
    """A function that puts a value at a place of a saved model's description."""
    save_model(tmp_path, model)
    good = json.loads((tmp_path / "model.json").read_text())

    def folder(place, value):
        values = copy.deepcopy(good)
        functools.reduce(operator.getitem, place[:-1], values)[place[-1]] = value
        (tmp_path / "model.json").write_text(json.dumps(values))
        return tmp_path

    folder.good = good
    return folder


def test_round_trip_is_exact_except_for_half_precision(tmp_path, model, leaves):
    other = dataclasses.replace(model.card.radar, slope_hz_per_s=5e13)
    card = dataclasses.replace(model.card, radars=(model.card.radar, other))
    model = dataclasses.replace(model, card=card)
    save_model(tmp_path / "m", model)
    save_model(tmp_path / "m", model)  # replaces the first
    loaded = load_model(tmp_path / "m")
    assert loaded.spec == model.spec and loaded.card == card
    assert jax.tree.structure(loaded) == jax.tree.structure(model)
    for name, found in flatten_dict(loaded.params, sep="/").items():
        assert found.dtype == np.float32
        np.testing.assert_array_equal(found, leaves[name].astype(np.float16))
    names = sorted(path.name for path in (tmp_path / "m").iterdir())
    assert names == [".jradar", "model.json", "weights.safetensors"]
    assert [path.name for path in tmp_path.iterdir()] == ["m"]


@pytest.mark.slow
def test_a_model_that_computes_in_bfloat16_does_so_after_loading(tmp_path, model):
    half = model.spec.network.clone(dtype="bfloat16")
    spec = dataclasses.replace(model.spec, network=half)
    save_model(tmp_path, Model(model.params, spec), dtype=np.float32)
    loaded = load_model(tmp_path)
    assert loaded.spec == spec != model.spec
    near, exact = (
        np.asarray(
            draw(jax.random.key(0), jnp.ones(CONDITION_SHAPE), m, draws=1).range_m
        )
        for m in (loaded, model)
    )
    assert 0 < np.abs(near - exact).mean() < 0.05 * spec.grid.fine.max_range_m


def test_int8_halves_the_file_and_keeps_every_weight_within_half_a_step(
    tmp_path, model, leaves
):
    save_model(tmp_path / "half", model)
    save_model(tmp_path / "eight", model, dtype=np.int8)
    loaded = load_model(tmp_path / "eight")
    for name, found in flatten_dict(loaded.params, sep="/").items():
        axes = tuple(range(found.ndim - 1))
        step = np.abs(leaves[name]).max(axes, keepdims=True) / 127
        assert found.dtype == np.float32
        error = np.abs(np.asarray(found) - leaves[name])
        assert (error <= np.maximum(0.501 * step, 1e-3)).all()
    files = (tmp_path / name / "weights.safetensors" for name in ("half", "eight"))
    half, eight = (file.stat().st_size for file in files)
    assert eight < 0.8 * half


TABLES = {
    "echoes": ConfidenceTable.of((0.0, 0.3, 0.8), least=0.1),
    "trust": fit_trust(np.random.default_rng(0).normal(size=(60, 8))),
    "scaling": Scaling.of((0.1, -2.0), (1.0, -0.5)),
}


@pytest.mark.parametrize(
    ("name", "broken", "message"),
    [
        ("echoes", {"least": 2.0}, "least = 2.0"),
        ("trust", {"mean": [0.0]}, "whitening has"),
        ("scaling", {"offset": [0.0]}, "expected two finite numbers"),
    ],
)
def test_a_table_comes_back_and_a_broken_one_is_refused(
    tmp_path, model, name, broken, message
):
    save_model(tmp_path / "m", model.with_tables(**{name: TABLES[name]}))
    found = getattr(load_model(tmp_path / "m").tables, name)
    for one, kept in zip(found, TABLES[name], strict=True):
        np.testing.assert_allclose(one, kept, atol=1e-6)
    path = tmp_path / "m" / "model.json"
    text = json.loads(path.read_text())
    text["tables"][name] |= broken
    path.write_text(json.dumps(text))
    with pytest.raises(ModelError, match=f"not usable: .*{message}"):
        load_model(tmp_path / "m")


@pytest.mark.parametrize("make", [tiny_polar_model, tiny_map_model])
def test_models_of_every_grid_have_one_format(tmp_path, make):
    model = make()
    save_model(tmp_path, model, dtype=np.float32)
    found = load_model(tmp_path)
    assert found.spec == model.spec and found.card == model.card
    jax.tree.map(np.testing.assert_array_equal, found.params, model.params)


def test_a_missing_model_is_named_with_the_shipped_ones(tmp_path):
    expected = r"no model at .*nowhere: expected a folder .*shipped model: jradar-maps"
    with pytest.raises(ModelError, match=expected):
        load_model(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("format", 99, "format 99, this version reads 5"),
        ("method", "magic", "not usable: method = 'magic'"),
        ("grid.kind", "torus", "not usable: 'torus'"),
        ("grid", {"kind": "polar", "history": 1000}, "history = 1000, expected 1 to"),
        ("grid.codec", "x", "not usable: codec = 'x', expected one of .'log', 'lin"),
        ("temperature", -1.0, "temperature = -1.0, expected 0 or more"),
        ("temperature", float("nan"), "temperature = nan, expected a number"),
        ("noise", {"sigma_data": -1.0, "prediction": "edm"}, "sigma_data = -1"),
        ("network", {"kind": "unet", "chanels": 3}, "not usable: .*chanels"),
        ("surprise", 1, "not usable: .*surprise"),
        ("grid.fine.width", 1 << 40, ""),
        ("points.capacity", 99999999999, ""),
        ("points.num_azimuth", 1 << 40, ""),
        ("network.channels", 300_000_000, "300,000,000 channels for arrays"),
        ("network.blocks", 1 << 40, ""),
        ("network.multipliers", [1] * 10_000, ""),
        ("network.stem", [0, 0], ""),
        ("network.form", "cubist", ""),
        ("noise.sigma_min", -1.0, ""),
        ("noise.log_std", float("inf"), "log_std = inf, expected a number"),
    ],
)
def test_an_unusable_description_is_refused(saved, field, value, message):
    folder = saved(field.split("."), value)
    with pytest.raises(ModelError, match=message) as found:
        load_model(folder)
    assert str(folder) in str(found.value)


WRONG = ("8", -1.5, True, None, [], [[3]], {}, {"x": 1}, 10**400)


def test_values_of_a_wrong_type_and_missing_ones_are_refused_everywhere(saved):
    good = saved.good
    parts = {(): good, ("card",): good["card"]}
    parts[("card", "radars", 0)] = good["card"]["radars"][0]
    for part in ("network", "noise", "grid", "points"):
        parts[(part,)] = good[part]
    for part in ("coarse", "fine"):
        parts[("grid", part)] = good["grid"][part]
    for part, values in parts.items():
        for (name, value), wrong in itertools.product(values.items(), WRONG):
            if type(wrong) is type(value):
                continue  # -1.5 and texts can be right
            huge = isinstance(value, float) and wrong == 10**400
            folder = saved([*part, name], 10**500 if huge else wrong)
            with pytest.raises(ModelError, match=str(folder)):
                load_model(folder)
    less = {name: value for name, value in good.items() if name != "grid"}
    (folder / "model.json").write_text(json.dumps(less))
    with pytest.raises(ModelError, match="not usable"):
        load_model(folder)


@pytest.mark.parametrize("text", ["[1]", "[" * 100_000, "", "\x00", "{"])
def test_other_json_is_no_model(tmp_path, model, text):
    save_model(tmp_path, model)
    (tmp_path / "model.json").write_text(text)
    with pytest.raises(ModelError, match="model.json"):
        load_model(tmp_path)


def test_damaged_weights_are_refused(tmp_path, model):
    save_model(tmp_path, model)
    weights = tmp_path / "weights.safetensors"
    good = weights.read_bytes()
    flipped = bytearray(good)
    flipped[-5] ^= 1
    for bad in (bytes(flipped), good[:-1], b""):
        weights.write_bytes(bad)
        with pytest.raises(ModelError, match="does not match the digest in model.json"):
            load_model(tmp_path)


def test_weights_of_another_network_are_named(tmp_path, model, leaves):
    name = "params/trunk/stem/bias"
    small = changed(model.spec, fine=ImageSpec(8, 30))
    without = {k: v for k, v in leaves.items() if k != name}
    wrong = rf"does not fit its network: {name} is"
    for params, spec, message in (
        (leaves | {name: np.zeros(9)}, model.spec, rf"{wrong} \(9,\), expected \(8,\)"),
        (without, model.spec, rf"{wrong} missing, expected \(8,\) \(1 differ\)"),
        (leaves | {"params/more": np.zeros(2)}, model.spec, "more is .*expected no su"),
        (leaves, small, "cannot be built: image of 30 columns"),
    ):
        save_model(tmp_path, Model(unflatten_dict(params, sep="/"), spec))
        with pytest.raises(ModelError, match=message):
            load_model(tmp_path)


def test_shipped_models_are_found_by_name(tmp_path, model, monkeypatch):
    monkeypatch.setattr(models, "WEIGHTS", tmp_path / "weights")
    assert shipped_models() == {}
    with pytest.raises(ModelError, match="shipped model: none is shipped"):
        load_model("jradar-sim")
    save_model(tmp_path / "weights" / "other", model)
    (tmp_path / "weights" / "empty").mkdir()
    save_model(tmp_path / "weights" / "jradar-sim", model)
    assert [*shipped_models()] == ["jradar-sim", "other"]
    assert load_model("jradar-sim").spec == model.spec


def test_the_shipped_models_are_whole_and_small():
    folders = shipped_models()
    assert folders.keys() == models.MODELS.keys()
    for name in folders:
        model = jradar.load_model(name)
        assert model.card.purpose and model.card.trained_on
        if model.spec.grid.kind == "view":
            points = dataclasses.replace(model.spec.points, remove_interference=False)
            assert points == PointSpec(false_alarm_rate=1.0, num_azimuth=64)
    size = sum(p.stat().st_size for f in folders.values() for p in f.iterdir())
    assert size <= 65_000_000  # as text; the wheel is smaller
