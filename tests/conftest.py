"""Checks the shapes in every signature while tests run; names the real samples."""

import os
import tempfile
from pathlib import Path

import pytest
from jaxtyping import install_import_hook

install_import_hook("jradar", "beartype.beartype")

os.environ["JRADAR_CACHE"] = "off"  # a test that wants it says so
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.5"
if "PYTEST_XDIST_WORKER" not in os.environ:  # workers and their processes share this
    _compiled = tempfile.TemporaryDirectory(prefix="jradar-tests-")
    os.environ["JAX_COMPILATION_CACHE_DIR"] = _compiled.name

SAMPLES = Path(__file__).parents[2] / "shared" / "samples"


@pytest.fixture(scope="session")
def samples():
    """Folder of real captures, which are not part of the repository."""
    if not SAMPLES.is_dir():
        pytest.skip("no real captures at ../shared/samples: they are not distributed")
    return SAMPLES
