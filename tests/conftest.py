"""Programs compile quickly, and few are kept; names the real samples.

With JRADAR_TYPECHECK set, the shapes in every signature are checked.
"""

import ctypes
import gc
import os
import subprocess
from pathlib import Path

# LLVM's optimisations take longer than these small programs run without them.
QUICK = "--xla_backend_optimization_level=0"
os.environ["XLA_FLAGS"] = f"{QUICK} {os.environ.get('XLA_FLAGS', '')}"

import jax  # noqa: E402  (after its flags)
import jaxtyping  # noqa: E402
import pytest  # noqa: E402

CHECKED = bool(os.environ.get("JRADAR_TYPECHECK"))
if CHECKED:
    jaxtyping.install_import_hook("jradar", "beartype.beartype")

from jradar.files import use_compilation_cache  # noqa: E402  (after the hook)

use_compilation_cache()  # compiled programs are kept from one run to the next
os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.02"
for option in ("compilation_cache_dir", "persistent_cache_min_compile_time_secs"):
    value = os.environ.get(f"JAX_{option.upper()}")  # a plug-in has imported JAX
    jax.config.update(f"jax_{option}", float(value) if "secs" in option else value)
os.environ["JRADAR_CACHE"] = "off"  # the tests of the cache turn it on themselves
if CHECKED:  # a radar checks itself, and JAX makes some of placeholders
    from jradar.radar import Radar

    Radar.__init__ = Radar.__init__.__wrapped__

LONG = {"training", "experiments", "test_readme", "test_own_rig"}  # rooms and files
MOST_MAPS, MOST_BYTES = 20_000, 1 << 30
SAMPLES = Path(__file__).parents[2] / "shared" / "samples"


def pytest_collection_modifyitems(items):
    """Start with the files that take longest, so that both workers end together."""
    items.sort(key=lambda item: not LONG & {item.path.parent.name, item.path.stem})


@pytest.fixture(scope="module", autouse=True)
def little_memory():
    """Forget compiled programs once they fill 1 GiB, or the table of memory maps.

    Linux allows 65,530 maps (`vm.max_map_count`); XLA aborts where it gets no other.
    """
    yield
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    with open("/proc/self/maps") as maps:
        count = sum(1 for _ in maps)
    if count > MOST_MAPS or pages * os.sysconf("SC_PAGE_SIZE") > MOST_BYTES:
        jax.clear_caches()
        gc.collect()
        if trim := getattr(ctypes.CDLL(None), "malloc_trim", None):
            trim(0)  # glibc keeps it otherwise


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
