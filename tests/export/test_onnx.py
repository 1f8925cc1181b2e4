"""An ONNX file gives the cloud of `enhance_points`, without JAX and without jradar."""

import contextlib
import io
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

from jradar import diffusion
from jradar.cli import main
from jradar.export import export_onnx, running
from jradar.model import enhance_points, save_model
from jradar.range_image import ConfidenceTable
from jradar.types import PointCloud
from tests.models import one_pass_model, tiny_map_model, tiny_model, tiny_polar_model

VIEW = one_pass_model().spec.frame_grid.view
EVIDENCE = diffusion.build_network(
    **{"kind": "evidence", "channels": 8, "multipliers": (1,), "blocks": 1},
    **{"attention_levels": (), "outputs": 14, "anchors": 2, "evidence_channels": 8},
    **{"azimuth": VIEW.azimuth, "elevation": VIEW.elevation},
    max_range_m=VIEW.max_range_m,
)
CAPACITY = 64
MODEL = tiny_model(
    method="marginal",
    network=EVIDENCE,
    noise=diffusion.NoiseSpec(
        sigma_data=0.7, prediction=diffusion.PREDICTIONS["mixture"]
    ),
    confidence=ConfidenceTable.of((0.0, 1.0), least=0.0),
)
README = Path(__file__).parents[2] / "jradar" / "stream" / "README.md"
NEEDS = "jax2onnx", "onnxruntime"

READER = """
import sys
import numpy as np
xyz = np.load("xyz.npy")
{running}
assert "jradar" not in sys.modules and "jax" not in sys.modules
np.save("dense.npy", dense)
"""


def points(count, seed=0):
    """A frame of some points in view, none near the edge of a pixel."""
    random = np.random.default_rng(seed)
    azimuth = (random.integers(1, 7, CAPACITY) + 0.5) / 8 * 2.0 - 1.0
    elevation = (random.integers(1, 7, CAPACITY) + 0.5) / 8 * 0.6 - 0.3
    far = random.uniform(2, 9, CAPACITY) * np.cos(elevation)
    parts = far * np.cos(azimuth), far * np.sin(azimuth), far * np.tan(elevation)
    xyz = np.where(np.arange(CAPACITY)[:, None] < count, np.column_stack(parts), 0.0)
    velocity, power = random.normal(size=CAPACITY), random.uniform(1, 9, CAPACITY)
    valid = np.arange(CAPACITY) < count
    return PointCloud(
        *(np.asarray(xyz, np.float32), valid),
        *(np.float32(velocity), np.float32(power)),
    )


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The file made from the model."""
    for module in NEEDS:
        pytest.importorskip(module)
    path = tmp_path_factory.mktemp("onnx") / "model.onnx"
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        export_onnx(path, MODEL)
    assert not printed.getvalue()
    return path


def run(path, frame):
    import onnxruntime

    session = onnxruntime.InferenceSession(str(path))
    names = [entry.name for entry in session.get_inputs()]
    return session.run(None, dict(zip(names, frame, strict=False)))


@pytest.mark.parametrize("count", [0, 1, 40, CAPACITY])
def test_the_cloud_is_that_of_enhance_points(exported, count):
    frame = points(count)
    xyz, valid, velocity, confidence = run(exported, frame[:4])
    cloud = jax.tree.map(np.asarray, enhance_points(jax.random.key(0), frame, MODEL))
    np.testing.assert_array_equal(valid, cloud.valid)
    assert valid.any() == (count > 0)
    np.testing.assert_allclose(xyz[valid], cloud.xyz[valid], atol=1e-3)
    np.testing.assert_allclose(confidence[valid], cloud.confidence[valid], atol=1e-3)
    np.testing.assert_allclose(velocity[valid], cloud.velocity[valid], atol=1e-3)


def test_the_file_says_what_it_takes_and_where_it_is_from(exported):
    import onnxruntime

    session = onnxruntime.InferenceSession(str(exported))
    found = session.get_modelmeta().custom_metadata_map
    assert found["format"] == "jradar onnx 1" and found["capacity"] == str(CAPACITY)
    assert json.loads(found["inputs"])["velocity"].startswith("m/s, positive")
    assert found["purpose"] == "nothing" and len(found["sha256_of_weights"]) == 64
    assert float(found["max_range_m"]) == MODEL.spec.frame_grid.view.max_range_m
    assert [entry.name for entry in session.get_inputs()] == [
        *("xyz", "valid", "velocity", "power")
    ]
    assert [entry.name for entry in session.get_outputs()] == [
        *("cloud_xyz", "cloud_valid", "cloud_velocity", "cloud_confidence")
    ]


def test_it_runs_without_jax_and_jradar(exported, tmp_path):
    np.save(tmp_path / "xyz.npy", points(CAPACITY).xyz[:30])
    code = READER.format(running="\n".join(running(exported, CAPACITY)))
    (tmp_path / "reader.py").write_text(code)
    command = [sys.executable, "reader.py"]
    subprocess.run(command, cwd=tmp_path, env={"PATH": ""}, check=True)
    assert len(np.load(tmp_path / "dense.npy")) > 30


def test_openvino_gives_the_same_cloud(exported):
    openvino = pytest.importorskip("openvino")
    compiled, frame = openvino.compile_model(str(exported), "CPU"), points(40)
    xyz, valid, *_ = compiled(frame[:4]).to_tuple()
    expected, same, *_ = run(exported, frame[:4])
    np.testing.assert_array_equal(valid, same)
    np.testing.assert_allclose(xyz[same], expected[same], atol=1e-3)


@pytest.mark.parametrize(
    ("model", "said"),
    [
        (tiny_model(), "draws samples in several steps"),
        (tiny_polar_model(), "sees a radar's samples, not its points"),
        (tiny_map_model(), "completes maps"),
    ],
)
def test_models_that_cannot_be_exported_are_refused(model, said, tmp_path):
    with pytest.raises(ValueError, match=said):
        export_onnx(tmp_path / "model.onnx", model)
    assert not [*tmp_path.iterdir()]


def test_options_of_cubes_and_draws_are_refused(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_model("mine", MODEL)
    command = ["export", "mine", "-o", "model.onnx"]
    for option in (["--device", "awr1843"], ["--draws", "1"]):
        assert main([*command, *option]) == 2
        assert f"{option[0]}: an ONNX file takes the points" in capsys.readouterr().err
    assert not Path("model.onnx").exists()


@pytest.mark.slow
def test_the_example_in_cpp_runs(exported, tmp_path):
    """With the headers and the library in ONNXRUNTIME, such as a release's folder."""
    runtime = Path(os.environ.get("ONNXRUNTIME", "/usr/local"))
    found = [*runtime.glob("include/**/onnxruntime_cxx_api.h")]
    if not (found and shutil.which("g++")):
        pytest.skip("needs g++, and ONNX Runtime's headers in ONNXRUNTIME/include")
    (code,) = re.findall(r"```cpp\n(.*?)```", README.read_text(), re.DOTALL)
    (tmp_path / "cloud.cpp").write_text(code.replace("1024", str(CAPACITY)))
    build = ["g++", "-std=c++17", "cloud.cpp", "-o", "cloud", f"-I{found[0].parent}"]
    build += [f"-L{runtime}/lib", "-lonnxruntime", f"-Wl,-rpath,{runtime}/lib"]
    subprocess.run(build, cwd=tmp_path, check=True)
    shutil.copy(exported, tmp_path / "enhance.onnx")
    shown = subprocess.run(["./cloud"], cwd=tmp_path, capture_output=True, check=True)
    assert int(shown.stdout.split()[0]) > 0
