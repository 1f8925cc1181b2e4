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
from jradar.radar import Radar
from tests.models import RADAR, tiny_model

pytest.importorskip("flatbuffers", reason="needs jradar[export]")

MODEL = tiny_model()
CUBE, (real, imag) = (
    np.random.default_rng(seed).normal(size=shape)
    for seed, shape in ((0, RADAR.cube_shape), (2, (2, 3, 4, 32)))
)
COUPLING = np.complex64(60 * (real + 1j * imag))
UNIT, WITHOUT = Radar(RADAR, leakage=COUPLING), Radar(RADAR, leakage=0 * COUPLING)
DAMAGED = "{} is damaged or not an exported function"

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


@pytest.fixture
def refused(tmp_path):
    """A function: other content of a file is refused with this message."""

    def check(content, message):
        path = tmp_path / "bad.jradar"
        path.write_bytes(content)
        with pytest.raises(ValueError, match=message.format(path.name)):
            load_function(path).call(7, CUBE)

    return check


def test_the_file_runs_without_jradar_and_equals_enhance(exported, tmp_path):
    np.save(tmp_path / "cube.npy", CUBE)
    (tmp_path / "reader.py").write_text(READER)
    kept = {k: v for k, v in os.environ.items() if k.startswith(("JAX_", "XLA_"))}
    subprocess.run(
        [sys.executable, "reader.py", str(exported), "cube.npy", "out.npz"],
        cwd=tmp_path,
        env={"JAX_PLATFORMS": "cpu", "PATH": "", **kept},
        check=True,
    )
    key, cube = jax.random.key(7), jnp.asarray(CUBE, jnp.complex64)
    cloud, without = (
        enhance(key, cube, unit, MODEL, draws=1, steps=3) for unit in (UNIT, WITHOUT)
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


def test_damage_is_found(exported, refused):
    good = exported.read_bytes()
    flipped = bytearray(good)
    flipped[len(good) * 3 // 4] ^= 1
    header, content = good.split(b"\n", 1)
    other = json.dumps(json.loads(header) | {"format": "x"}).encode()
    refused(bytes(flipped), "does not match its digest")
    refused(good[:-1], "does not match its digest")
    refused(b"", DAMAGED)
    refused(content[:100], DAMAGED)
    refused(other + b"\n" + content, "has format 'x', expected")


def test_damage_under_a_new_digest_is_refused_by_the_files_name(exported, refused):
    header, content = exported.read_bytes().split(b"\n", 1)

    def resealed(content):
        changed = {"sha256": hashlib.sha256(content).hexdigest()}
        return json.dumps(json.loads(header) | changed).encode() + b"\n" + content

    shape = jax.ShapeDtypeStruct((3,), "float32")
    other = jax.export.export(jax.jit(lambda x: x))(shape)
    for bad in (b"", b"\xff" * 100, content[: len(content) // 2], other.serialize()):
        refused(resealed(bytes(bad)), DAMAGED)
    random = np.random.default_rng(0)
    for _ in range(6):
        bad = bytearray(content)
        bad[random.integers(2000)] ^= 1 << random.integers(8)
        # A bit may change nothing, or an error names the file: no other ones come.
        with contextlib.suppress(pytest.fail.Exception):
            refused(resealed(bytes(bad)), "{}")


@pytest.mark.parametrize("header", [b"[]", b"3", b"{}", b"null", b'{"sha256": 1}'])
def test_other_headers_are_refused(refused, header):
    refused(header + b"\n" + b"content", DAMAGED)


def test_unknown_platform_and_missing_extra(exported, tmp_path, monkeypatch):
    with pytest.raises(ValueError, match="expected some of"):
        export_function(tmp_path / "x", UNIT, MODEL, platforms=["gpu"])
    monkeypatch.setitem(sys.modules, "flatbuffers", None)
    with pytest.raises(ImportError, match=r"jradar\[export\]"):
        load_function(exported)
