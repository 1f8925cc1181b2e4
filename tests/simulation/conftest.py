"""One scene, built once, for all tests that write files."""

import pytest

from jradar.simulation import capture_writer, sequence, simulate_sequence
from jradar.simulation.sequence import make_setting


@pytest.fixture(scope="session")
def corridor():
    """The setting of corridor 5."""
    pytest.importorskip("embreex", reason="the extra `sim` is not installed")
    return make_setting("corridor", 5)


@pytest.fixture
def scene_built_once(corridor, monkeypatch):
    """Let every corridor have the geometry of number 5."""
    _use(corridor, monkeypatch)


@pytest.fixture(scope="session")
def folder(corridor, tmp_path_factory):
    """Two frames of corridor 5 on disk."""
    root = tmp_path_factory.mktemp("sim")
    with pytest.MonkeyPatch.context() as patch:
        _use(corridor, patch)
        return simulate_sequence("corridor", 5, root, frames=2)


def _use(corridor, patch):
    def setting(family, seed, *, sensor="single_chip", unit=None):
        assert (family, sensor, unit) == ("corridor", "single_chip", None)
        scene = corridor.scene._replace(name=f"corridor_{seed}")
        return corridor._replace(seed=seed, scene=scene)

    for module in (sequence, capture_writer):
        patch.setattr(module, "make_setting", setting)
