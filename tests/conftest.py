"""Checks the shapes in every signature while tests run; names the real samples."""

import os
from pathlib import Path

import pytest
from jaxtyping import install_import_hook

install_import_hook("jradar", "beartype.beartype")

os.environ["JRADAR_CACHE"] = "off"  # a test that wants it says so

SAMPLES = Path(__file__).parents[2] / "shared" / "samples"


@pytest.fixture(scope="session")
def samples():
    """Folder of real captures, which are not part of the repository."""
    if not SAMPLES.is_dir():
        pytest.skip("no real captures at ../shared/samples: they are not distributed")
    return SAMPLES
