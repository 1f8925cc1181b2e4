"""Checks the shapes in every signature while tests run; names the real samples."""

import gc
import os
import subprocess
from pathlib import Path

import jax
import jaxtyping
import pytest
from jaxtyping import install_import_hook

install_import_hook("jradar", "beartype.beartype")

from jradar.files import use_compilation_cache  # noqa: E402  (after the hook)

use_compilation_cache()  # compiled programs are kept from one run to the next
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.02"
for option in ("compilation_cache_dir", "persistent_cache_min_compile_time_secs"):
    value = os.environ.get(f"JAX_{option.upper()}")  # a plug-in has imported JAX
    jax.config.update(f"jax_{option}", float(value) if "secs" in option else value)
os.environ["JRADAR_CACHE"] = "off"  # the tests of the cache turn it on themselves

MOST_MAPS = 20_000
SAMPLES = Path(__file__).parents[2] / "shared" / "samples"


def pytest_collection_modifyitems(items):
    """Start with the files that take longest, so that both workers end together."""
    items.sort(
        key=lambda item: item.path.parent.name not in ("training", "experiments")
    )


@pytest.fixture(scope="module", autouse=True)
def few_memory_maps():
    """Forget compiled programs before they fill the process's table of memory maps.

    Linux allows 65,530 (`vm.max_map_count`); XLA aborts where it gets no other.
    """
    yield
    with open("/proc/self/maps") as maps:
        count = sum(1 for _ in maps)
    if count > MOST_MAPS:
        jax.clear_caches()
        gc.collect()


@pytest.fixture
def small_disk(tmp_path):
    """The folder of a disk of 1 MiB."""
    path = tmp_path / "disk"
    path.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(path)]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("may not mount a small disk here")
    yield path
    subprocess.run(["umount", "--lazy", str(path)], check=True)


@pytest.fixture
def as_a_user():
    """Calls without the tests' checks of shapes, which users do not have."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(scope="session")
def samples():
    """Folder of real captures, which are not part of the repository."""
    if not SAMPLES.is_dir():
        pytest.skip("no real captures at ../shared/samples: they are not distributed")
    return SAMPLES
