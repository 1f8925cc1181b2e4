"""Bundles: round trip, and every way in which one can be unusable."""

import dataclasses
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

from jradar import bundle as bundles
from jradar.bundle import (
    Bundle,
    BundleError,
    BundleSpec,
    default_bundle,
    load_bundle,
    save_bundle,
    shipped_bundles,
)
from jradar.diffusion import NoiseSpec, UNet
from jradar.radar import RadarSpec
from jradar.range_image import ImageSpec

NETWORK = UNet(channels=8, multipliers=(1, 2), blocks=1, attention_levels=(1,))


@pytest.fixture(scope="module")
def bundle():
    shapes = jax.eval_shape(
        NETWORK.init,
        jax.random.key(0),
        jnp.zeros((1, 8, 32, 2)),
        jnp.zeros(1),
        jnp.zeros((1, 8, 8, 12)),
    )
    rng = np.random.default_rng(0)
    params = jax.tree.map(
        lambda leaf: jnp.asarray(rng.normal(size=leaf.shape), leaf.dtype), shapes
    )
    spec = BundleSpec(
        network=NETWORK,
        noise=NoiseSpec(sigma_data=0.7),
        coarse=ImageSpec(8, 8),
        fine=ImageSpec(8, 32, azimuth=(-1.0, 0.5)),
        radar=RadarSpec.awr1843(num_chirps=32, num_samples=64),
        num_slices=4,
        codec="inverse",
        steps_seen=7,
        trained_on="a test",
        purpose="nothing",
        points={"capacity": 64, "guard": (1, 2)},
    )
    return Bundle(params, spec)


def test_round_trip_is_exact_but_for_half_precision(tmp_path, bundle):
    save_bundle(tmp_path / "b", bundle)
    save_bundle(tmp_path / "b", bundle)  # replaces the first
    loaded = load_bundle(tmp_path / "b")
    assert loaded.spec == bundle.spec and hash(loaded.spec) == hash(bundle.spec)
    assert jax.tree.structure(loaded.params) == jax.tree.structure(bundle.params)
    halved = jax.tree.map(lambda v: v.astype(jnp.float16), bundle.params)
    jax.tree.map(np.testing.assert_array_equal, loaded.params, halved)
    assert {v.dtype for v in jax.tree.leaves(loaded.params)} == {jnp.dtype("float32")}
    names = sorted(path.name for path in (tmp_path / "b").iterdir())
    assert names == ["bundle.json", "weights.safetensors"]
    assert [path.name for path in tmp_path.iterdir()] == ["b"]


def test_missing_bundle_says_what_was_expected(tmp_path):
    with pytest.raises(
        BundleError, match=r"no weights at .*nowhere: expected a folder"
    ):
        load_bundle(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("format", 99, "format 99, expected 2"),
        ("noise", {"sigma_data": -1.0}, "not usable: sigma_data = -1"),
        ("network", {"chanels": 3}, "not usable: .*chanels"),
        ("codec", None, "not usable"),
        ("surprise", 1, "not usable: .*surprise"),
    ],
)
def test_unusable_description_is_refused(tmp_path, bundle, field, value, message):
    save_bundle(tmp_path, bundle)
    path = tmp_path / "bundle.json"
    values = json.loads(path.read_text()) | {field: value}
    if value is None:
        del values[field]
    path.write_text(json.dumps(values))
    with pytest.raises(BundleError, match=message):
        load_bundle(tmp_path)


def test_damaged_files_are_refused(tmp_path, bundle):
    save_bundle(tmp_path, bundle)
    weights = tmp_path / "weights.safetensors"
    good = weights.read_bytes()
    flipped = bytearray(good)
    flipped[-5] ^= 1
    for bad in (bytes(flipped), good[:-1], b""):
        weights.write_bytes(bad)
        with pytest.raises(BundleError, match="does not match its digest"):
            load_bundle(tmp_path)
    weights.write_bytes(good)
    (tmp_path / "bundle.json").write_text("{")
    with pytest.raises(BundleError, match="not usable"):
        load_bundle(tmp_path)


def test_weights_of_another_network_are_named(tmp_path, bundle):
    flat = flatten_dict(bundle.params, sep="/")
    name = "params/trunk/stem/bias"
    for leaf, message in (
        (jnp.zeros(9), rf"{name} is \(9,\), expected \(8,\) \(1 such\)"),
        (None, rf"{name} is missing, expected \(8,\) \(1 such\)"),
    ):
        changed = {k: v for k, v in (flat | {name: leaf}).items() if v is not None}
        params = unflatten_dict(changed, sep="/")
        save_bundle(tmp_path, Bundle(params, bundle.spec))
        with pytest.raises(BundleError, match=rf"does not fit its network: {message}"):
            load_bundle(tmp_path)
    params = unflatten_dict(flat | {"params/more": jnp.zeros(2)}, sep="/")
    save_bundle(tmp_path, Bundle(params, bundle.spec))
    with pytest.raises(BundleError, match=r"params/more is \(2,\), expected none"):
        load_bundle(tmp_path)
    small = dataclasses.replace(bundle.spec, fine=ImageSpec(8, 30))
    save_bundle(tmp_path, Bundle(bundle.params, small))
    with pytest.raises(BundleError, match="cannot be built: image of 30 columns"):
        load_bundle(tmp_path)


def test_shipped_bundles_are_found_by_name(tmp_path, bundle, monkeypatch):
    monkeypatch.setattr(bundles, "WEIGHTS", tmp_path / "weights")
    assert shipped_bundles() == {}
    with pytest.raises(BundleError, match="no weights 'jradar-sim'; or train"):
        default_bundle()
    save_bundle(tmp_path / "weights" / "other", bundle)
    (tmp_path / "weights" / "empty").mkdir()
    with pytest.raises(BundleError, match="'jradar-sim', only other: name one"):
        default_bundle()
    save_bundle(tmp_path / "weights" / "jradar-sim", bundle)
    assert [*shipped_bundles()] == ["jradar-sim", "other"]
    assert load_bundle(default_bundle()).spec == bundle.spec


def test_what_is_shipped_is_whole_and_small():
    folders = shipped_bundles().values()
    for folder in folders:
        assert load_bundle(folder).spec.purpose, folder
    size = sum(p.stat().st_size for f in folders for p in f.iterdir())
    assert size <= 25_000_000


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_wheel_holds_the_weights(tmp_path, bundle):
    root = Path(__file__).parents[1]
    for name in ("pyproject.toml", "README.md", "LICENSE", ".gitignore"):
        shutil.copy(root / name, tmp_path)
    shutil.copytree(root / "jradar", tmp_path / "jradar")
    save_bundle(tmp_path / "jradar" / "weights" / "tiny", bundle)
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "-w", tmp_path / "w"]
    subprocess.run([*command, tmp_path], check=True)
    (wheel,) = (tmp_path / "w").glob("*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    for name in ("bundle.json", "weights.safetensors"):
        assert f"jradar/weights/tiny/{name}" in names
