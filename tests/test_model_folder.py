"""A model on disk: what is kept, and what is refused."""

import copy
import dataclasses
import itertools
import json
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax.traverse_util import flatten_dict, unflatten_dict

import jradar
from jradar import model as models
from jradar.errors import ModelError
from jradar.model import (
    Model,
    draw,
    load_model,
    save_model,
    shipped_models,
)
from jradar.radar import PointSpec
from jradar.range_image import ImageSpec, fit_trust
from tests.models import tiny_model


@pytest.fixture(scope="module")
def model():
    return tiny_model(fine=ImageSpec(8, 32, azimuth=(-1.0, 0.5)))


def test_round_trip_is_exact_except_for_half_precision(tmp_path, model):
    save_model(tmp_path / "m", model)
    save_model(tmp_path / "m", model)  # replaces the first
    loaded = load_model(tmp_path / "m")
    assert loaded.spec == model.spec and loaded.card == model.card
    assert jax.tree.structure(loaded) == jax.tree.structure(model)
    halved = jax.tree.map(lambda v: v.astype(jnp.float16), model.params)
    jax.tree.map(np.testing.assert_array_equal, loaded.params, halved)
    assert {v.dtype for v in jax.tree.leaves(loaded)} == {jnp.dtype("float32")}
    names = sorted(path.name for path in (tmp_path / "m").iterdir())
    assert names == ["model.json", "weights.safetensors"]
    assert [path.name for path in tmp_path.iterdir()] == ["m"]


def test_a_model_that_computes_in_bfloat16_does_so_after_loading(tmp_path, model):
    half = model.spec.network.clone(dtype="bfloat16")
    spec = dataclasses.replace(model.spec, network=half)
    save_model(
        tmp_path / "half", Model(model.params, spec, model.card), dtype=np.float32
    )
    loaded = load_model(tmp_path / "half")
    assert loaded.spec == spec != model.spec
    key, image = jax.random.key(0), jnp.ones((8, 8, 12))
    near, exact = (draw(key, image, m, draws=1, steps=1) for m in (loaded, model))
    near, exact = np.asarray(near.range_m), np.asarray(exact.range_m)
    assert 0 < np.abs(near - exact).mean() < 0.05 * spec.fine.max_range_m


def test_the_other_radars_of_a_training_are_kept(tmp_path, model):
    other = dataclasses.replace(model.card.radar, slope_hz_per_s=5e13)
    card = dataclasses.replace(model.card, radars=(model.card.radar, other))
    save_model(tmp_path / "m", dataclasses.replace(model, card=card))
    assert load_model(tmp_path / "m").card == card


def test_int8_halves_the_file_and_keeps_every_weight_within_half_a_step(
    tmp_path, model
):
    save_model(tmp_path / "half", model)
    save_model(tmp_path / "eight", model, dtype=np.int8)
    loaded = load_model(tmp_path / "eight")
    for found, value in zip(
        jax.tree.leaves(loaded.params), jax.tree.leaves(model.params), strict=True
    ):
        axes = tuple(range(value.ndim - 1))
        step = jnp.abs(value).max(axes, keepdims=True) / 127
        assert found.dtype == jnp.float32
        assert (jnp.abs(found - value) <= jnp.maximum(0.501 * step, 1e-3)).all()
    sizes = [
        (tmp_path / name / "weights.safetensors").stat().st_size
        for name in ("half", "eight")
    ]
    assert sizes[1] < 0.8 * sizes[0]


def test_what_conditions_looked_like_in_training_is_kept(tmp_path, model):
    features = np.random.default_rng(0).normal(size=(60, 2 * model.spec.num_slices))
    trust = fit_trust(features)
    save_model(tmp_path / "m", dataclasses.replace(model, trust=trust))
    jax.tree.map(
        lambda found, kept: np.testing.assert_allclose(found, kept, atol=1e-6),
        load_model(tmp_path / "m").trust,
        trust,
    )
    path = tmp_path / "m" / "model.json"
    text = json.loads(path.read_text())
    text["trust"]["mean"] = text["trust"]["mean"][1:]
    path.write_text(json.dumps(text))
    with pytest.raises(ModelError, match="not usable: whitening has"):
        load_model(tmp_path / "m")


def test_a_missing_model_is_named_with_the_shipped_ones(tmp_path):
    expected = r"no model at .*nowhere: expected a folder .*shipped model: jradar-sim"
    with pytest.raises(ModelError, match=expected):
        load_model(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("format", 99, "format 99, this version reads 4"),
        ("method", "magic", "not usable: method = 'magic'"),
        ("noise", {"sigma_data": -1.0, "prediction": "edm"}, "sigma_data = -1"),
        ("network", {"kind": "unet", "chanels": 3}, "not usable: .*chanels"),
        ("codec", None, "not usable"),
        ("surprise", 1, "not usable: .*surprise"),
    ],
)
def test_an_unusable_description_is_refused(tmp_path, model, field, value, message):
    save_model(tmp_path, model)
    path = tmp_path / "model.json"
    values = json.loads(path.read_text()) | {field: value}
    if value is None:
        del values[field]
    path.write_text(json.dumps(values))
    with pytest.raises(ModelError, match=message):
        load_model(tmp_path)


WRONG = ("8", -1.5, True, None, [], [[3]], {}, {"x": 1}, 10**400)


def test_values_of_a_wrong_type_are_refused_everywhere(tmp_path, model):
    save_model(tmp_path, model)
    path = tmp_path / "model.json"
    good = json.loads(path.read_text())
    places = [(name,) for name in good]
    for part in ("network", "noise", "coarse", "fine", "radar", "points"):
        places += [(part, name) for name in good[part]]
    for place, wrong in itertools.product(places, WRONG):
        values = copy.deepcopy(good)
        inner = values if len(place) == 1 else values[place[0]]
        if type(wrong) is type(inner[place[-1]]):
            continue  # -1.5 and texts can be right
        if isinstance(inner[place[-1]], float) and wrong == 10**400:
            wrong = 10**500
        inner[place[-1]] = wrong
        path.write_text(json.dumps(values))
        with pytest.raises(ModelError, match=str(tmp_path)):
            load_model(tmp_path)


@pytest.mark.parametrize(
    ("part", "field", "value"),
    [
        ("fine", "width", 1 << 40),
        ("points", "capacity", 99999999999),
        ("points", "num_azimuth", 1 << 40),
        ("network", "channels", 1 << 40),
        ("network", "blocks", 1 << 40),
        ("network", "multipliers", [1] * 10_000),
        ("network", "stem", [0, 0]),
        ("network", "form", "cubist"),
        ("noise", "sigma_min", -1.0),
    ],
)
def test_values_that_no_machine_can_hold_are_refused_at_once(
    tmp_path, model, part, field, value
):
    save_model(tmp_path, model)
    path = tmp_path / "model.json"
    values = json.loads(path.read_text())
    values[part][field] = value
    path.write_text(json.dumps(values))
    with pytest.raises(ModelError, match=str(tmp_path)):
        load_model(tmp_path)


@pytest.mark.parametrize("text", ["[1]", "[" * 100_000, "", "\x00"])
def test_other_json_is_no_model(tmp_path, model, text):
    save_model(tmp_path, model)
    (tmp_path / "model.json").write_text(text)
    with pytest.raises(ModelError, match="model.json"):
        load_model(tmp_path)


def test_damaged_files_are_refused(tmp_path, model):
    save_model(tmp_path, model)
    weights = tmp_path / "weights.safetensors"
    good = weights.read_bytes()
    flipped = bytearray(good)
    flipped[-5] ^= 1
    for bad in (bytes(flipped), good[:-1], b""):
        weights.write_bytes(bad)
        with pytest.raises(
            ModelError, match=r"does not match the digest in model\.json"
        ):
            load_model(tmp_path)
    weights.write_bytes(good)
    (tmp_path / "model.json").write_text("{")
    with pytest.raises(ModelError, match="not usable"):
        load_model(tmp_path)


def test_many_channels_are_refused_before_they_take_memory(tmp_path, model):
    save_model(tmp_path, model)
    path = tmp_path / "model.json"
    values = json.loads(path.read_text())
    values["network"]["channels"] = 300_000_000
    path.write_text(json.dumps(values))
    with pytest.raises(ModelError, match="300,000,000 channels for arrays of at most"):
        load_model(tmp_path)


def test_weights_of_another_network_are_named(tmp_path, model):
    flat = flatten_dict(model.params, sep="/")
    name = "params/trunk/stem/bias"
    for leaf, message in (
        (jnp.zeros(9), rf"{name} is \(9,\), expected \(8,\) \(1 differ\)"),
        (None, rf"{name} is missing, expected \(8,\) \(1 differ\)"),
    ):
        changed = {k: v for k, v in (flat | {name: leaf}).items() if v is not None}
        save_model(tmp_path, Model(unflatten_dict(changed, sep="/"), model.spec))
        with pytest.raises(ModelError, match=rf"does not fit its network: {message}"):
            load_model(tmp_path)
    params = unflatten_dict(flat | {"params/more": jnp.zeros(2)}, sep="/")
    save_model(tmp_path, Model(params, model.spec))
    with pytest.raises(ModelError, match=r"params/more is \(2,\), expected no such"):
        load_model(tmp_path)
    small = dataclasses.replace(model.spec, fine=ImageSpec(8, 30))
    save_model(tmp_path, Model(model.params, small))
    with pytest.raises(ModelError, match="cannot be built: image of 30 columns"):
        load_model(tmp_path)


def test_shipped_models_are_found_by_name(tmp_path, model, monkeypatch):
    monkeypatch.setattr(models.folder, "SHIPPED", tmp_path / "weights")
    assert shipped_models() == {}
    with pytest.raises(ModelError, match="shipped model: none is shipped"):
        load_model("jradar-sim")
    save_model(tmp_path / "weights" / "other", model)
    (tmp_path / "weights" / "empty").mkdir()
    save_model(tmp_path / "weights" / "jradar-sim", model)
    assert [*shipped_models()] == ["jradar-sim", "other"]
    assert load_model("jradar-sim").spec == model.spec


def test_the_shipped_model_is_whole_and_small():
    folders = shipped_models()
    assert "jradar-sim" in folders
    for name in folders:
        model = jradar.load_model(name)
        points = dataclasses.replace(model.spec.points, remove_interference=False)
        expected = PointSpec(false_alarm_rate=1.0, num_azimuth=64)
        assert model.card.purpose and points == expected
    size = sum(p.stat().st_size for f in folders.values() for p in f.iterdir())
    assert size <= 25_000_000


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_wheel_holds_the_weights(tmp_path, model):
    root = Path(__file__).parents[1]
    for name in ("pyproject.toml", "README.md", "LICENSE", ".gitignore"):
        shutil.copy(root / name, tmp_path)
    shutil.copytree(root / "jradar", tmp_path / "jradar")
    save_model(tmp_path / "jradar" / "weights" / "tiny", model)
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "-w", tmp_path / "w"]
    subprocess.run([*command, tmp_path], check=True)
    (wheel,) = (tmp_path / "w").glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    for name in ("model.json", "weights.safetensors"):
        assert f"jradar/weights/tiny/{name}" in names
