"""An exported function equals `enhance`, runs without jradar, and guards its bits."""

import contextlib
import hashlib
import json
import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.export import export_function, load_function
from jradar.model import enhance
from jradar.radar import PointSpec, Radar
from tests.models import RADAR, tiny_model

pytest.importorskip("flatbuffers", reason="needs jradar[export]")

MODEL = tiny_model(points=PointSpec(capacity=16))
CUBE = np.random.default_rng(0).normal(size=RADAR.cube_shape)
COUPLING = np.random.default_rng(2).normal(size=(RADAR.num_tx, RADAR.num_rx, 32, 2))
COUPLING = (60 * COUPLING).astype(np.float32).view(np.complex64)[..., 0]
UNIT, WITHOUT = Radar(RADAR, leakage=COUPLING), Radar(RADAR, leakage=0 * COUPLING)

# What the docstring of jradar.export tells users to write.
READER = """
import hashlib, json, sys
import jax, numpy as np
header, function = open(sys.argv[1], "rb").read().split(b"\\n", 1)
assert hashlib.sha256(function).hexdigest() == json.loads(header)["sha256"]
cube = np.load(sys.argv[2]).astype(np.complex64)
call = jax.export.deserialize(bytearray(function)).call
cloud = call(np.uint32(7), cube)
assert "jradar" not in sys.modules and "flax" not in sys.modules
np.savez(sys.argv[3], **cloud)
"""


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The file made from the model."""
    path = tmp_path_factory.mktemp("export") / "model.jradar"
    export_function(path, UNIT, MODEL, draws=1, steps=3)
    return path


def test_the_file_runs_without_jradar_and_equals_enhance(exported, tmp_path):
    np.save(tmp_path / "cube.npy", CUBE)
    (tmp_path / "reader.py").write_text(READER)
    kept = {k: v for k, v in os.environ.items() if k.startswith("JAX_")}
    subprocess.run(
        [sys.executable, "reader.py", str(exported), "cube.npy", "out.npz"],
        cwd=tmp_path,
        env={"JAX_PLATFORMS": "cpu", "PATH": "", **kept},
        check=True,
    )
    cube = jnp.asarray(CUBE, jnp.complex64)
    cloud, without = (
        enhance(jax.random.key(7), cube, unit, MODEL, draws=1, steps=3)
        for unit in (UNIT, WITHOUT)
    )
    out = np.load(tmp_path / "out.npz")
    np.testing.assert_array_equal(out["valid"], cloud.valid)
    np.testing.assert_allclose(out["xyz"], cloud.xyz, atol=1e-4)
    assert 0 < out["valid"].sum()
    assert not np.allclose(out["xyz"], without.xyz, atol=1e-3)

    function = load_function(exported)
    again = function.call(7, CUBE)
    assert set(again) == {*out} == {"xyz", "valid", "velocity"}  # one draw
    for name, values in again.items():
        np.testing.assert_array_equal(values, out[name])
    assert function.header["radar"] == RADAR.name and function.header["leakage"]
    with pytest.raises(ValueError, match="expects"):
        function.call(7, CUBE[:1])


def test_damage_is_found(exported, tmp_path):
    good = exported.read_bytes()
    flipped = bytearray(good)
    flipped[len(good) * 3 // 4] ^= 1
    header, content = good.split(b"\n", 1)
    other = json.dumps(json.loads(header) | {"format": "x"}).encode()
    path = tmp_path / "bad.jradar"
    for bad, message in (
        (bytes(flipped), "does not match its digest"),
        (good[:-1], "does not match its digest"),
        (b"", "is damaged or not an exported function"),
        (content[:100], "is damaged or not an exported function"),
        (other + b"\n" + content, "has format 'x', expected"),
    ):
        path.write_bytes(bad)
        with pytest.raises(ValueError, match=message):
            load_function(path)


def resealed(header, content):
    """The file with a digest that matches other content."""
    digest = hashlib.sha256(content).hexdigest()
    return (
        json.dumps(json.loads(header) | {"sha256": digest}).encode() + b"\n" + content
    )


def test_damage_under_a_new_digest_is_refused_by_the_files_name(exported, tmp_path):
    header, content = exported.read_bytes().split(b"\n", 1)
    path, random = tmp_path / "bad.jradar", np.random.default_rng(0)
    for bad in (b"", b"\xff" * 100, content[:100], content[: len(content) // 2]):
        path.write_bytes(resealed(header, bad))
        with pytest.raises(ValueError, match="bad.jradar is damaged or not"):
            load_function(path).call(7, CUBE)
    for _ in range(6):
        bad = bytearray(content)
        bad[random.integers(2000)] ^= 1 << random.integers(8)
        path.write_bytes(resealed(header, bytes(bad)))
        with contextlib.suppress(ValueError):
            load_function(path).call(7, CUBE)


def test_a_function_of_other_arguments_is_refused(exported, tmp_path):
    header, _ = exported.read_bytes().split(b"\n", 1)
    other = jax.export.export(jax.jit(lambda x: x))(
        jax.ShapeDtypeStruct((3,), "float32")
    )
    path = tmp_path / "other.jradar"
    path.write_bytes(resealed(header, bytes(other.serialize())))
    with pytest.raises(ValueError, match="other.jradar is damaged or not an exported"):
        load_function(path)


@pytest.mark.parametrize("header", [b"[]", b"3", b"{}", b"null", b'{"sha256": 1}'])
def test_other_headers_are_refused(tmp_path, header):
    (tmp_path / "x.jradar").write_bytes(header + b"\n" + b"content")
    with pytest.raises(ValueError, match="x.jradar is damaged or not an exported"):
        load_function(tmp_path / "x.jradar")


def test_unknown_platform_and_missing_extra(exported, tmp_path, monkeypatch):
    with pytest.raises(ValueError, match="expected some of"):
        export_function(tmp_path / "x", UNIT, MODEL, platforms=["gpu"])
    monkeypatch.setitem(sys.modules, "flatbuffers", None)
    with pytest.raises(ImportError, match=r"jradar\[export\]"):
        load_function(exported)
