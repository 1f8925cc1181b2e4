"""An exported function equals `enhance` and runs without jradar."""

import json
import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.export import export_function, loading
from jradar.model import enhance
from jradar.radar import Radar
from tests.models import RADAR, tiny_model

MODEL = tiny_model()
CUBE, (real, imag) = (
    np.random.default_rng(seed).normal(size=shape)
    for seed, shape in ((0, RADAR.cube_shape), (2, (2, 3, 4, 32)))
)
COUPLING = np.complex64(60 * (real + 1j * imag))
UNIT, WITHOUT = Radar(RADAR, leakage=COUPLING), Radar(RADAR, leakage=0 * COUPLING)

READER = """
import sys
import numpy as np
cube = np.load("cube.npy").astype(np.complex64)
{loading}
assert "jradar" not in sys.modules and "flax" not in sys.modules
np.savez("out.npz", **cloud)
"""


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The file made from the model."""
    path = tmp_path_factory.mktemp("export") / "model.jradar"
    export_function(path, UNIT, MODEL, draws=1, steps=3)
    return path


@pytest.mark.slow
def test_the_file_runs_without_jradar_and_equals_enhance(exported, tmp_path):
    np.save(tmp_path / "cube.npy", CUBE)
    code = READER.format(loading="\n".join(loading(exported)))
    (tmp_path / "reader.py").write_text(code.replace("uint32(0)", "uint32(7)"))
    kept = {k: v for k, v in os.environ.items() if k.startswith(("JAX_", "XLA_"))}
    subprocess.run(
        [sys.executable, "reader.py"],
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

    assert {*out} == {"xyz", "valid", "velocity"}  # one draw
    header = json.loads(exported.read_bytes().split(b"\n", 1)[0])
    assert header["radar"] == RADAR.name and header["leakage"]


def test_an_unknown_platform_is_refused(tmp_path):
    with pytest.raises(ValueError, match="expected some of"):
        export_function(tmp_path / "x", UNIT, MODEL, platforms=["gpu"])
