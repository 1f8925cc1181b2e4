"""Programs of an earlier process: they run alike, and no others are taken for them."""

import dataclasses
import json
import os

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.diffusion import RangeMixture
from jradar.pipeline import programs
from jradar.pipeline.fusion import Seen
from jradar.types import PointCloud
from tests.models import tiny_model

CLOUD = PointCloud(jnp.arange(12.0).reshape(4, 3), jnp.array([True] * 3 + [False]))
NEAR = {"max_range_m": 9.0}
MODEL = tiny_model(method="marginal")
FOLDER = "jax_compilation_cache_dir"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """The folder of a cache that is on."""
    monkeypatch.setenv("JRADAR_CACHE", "")
    before = jax.config.values[FOLDER]
    jax.config.update(FOLDER, str(tmp_path))
    yield tmp_path
    jax.config.update(FOLDER, before)


def within(cloud, **options):
    """The cloud within limits as a new process finds it, and whether it traced."""
    traced = []

    def trace():
        traced.append(True)
        yield "within", programs.traced(lambda c: c.within(**options), cloud)[0]

    programs.READY.clear()
    programs._code.cache_clear()
    found = programs.ready(cloud, options, trace=trace)["within"](cloud)
    return found, bool(traced)


def test_a_second_process_traces_nothing_and_finds_the_same(cache):
    (first, traced), (again, traced_again) = (
        within(CLOUD, **NEAR),
        within(CLOUD, **NEAR),
    )
    assert (traced, traced_again) == (True, False)
    assert 0 < first.valid.sum() < CLOUD.valid.sum()
    jax.tree.map(np.testing.assert_array_equal, first, again)
    assert again.velocity is None and len([*cache.iterdir()]) == 1


@pytest.mark.parametrize(
    "what", ["options", "shape", "part", "source", "damage", "off"]
)
def test_other_programs_are_not_taken_for_it(cache, monkeypatch, tmp_path, what):
    package = tmp_path / "package"
    package.mkdir()
    (package / "kernel.py").write_text("")
    monkeypatch.setattr(programs, "PACKAGE", package)
    cloud, options = CLOUD, NEAR
    within(cloud, **options)
    assert not within(cloud, **options)[1]
    if what == "options":
        options = {"max_range_m": 10.0}
    elif what == "shape":
        cloud = PointCloud(cloud.xyz[:3], cloud.valid[:3])
    elif what == "part":
        cloud = cloud._replace(power=jnp.ones(4))
    elif what == "source":
        os.utime(package / "kernel.py", (0, 0))
    elif what == "damage":
        (file,) = cache.glob("*" + programs.SUFFIX)
        file.write_bytes(file.read_bytes()[:-9])
    else:
        monkeypatch.setenv("JRADAR_CACHE", "off")
    found, traced = within(cloud, **options)
    assert traced
    jax.tree.map(np.testing.assert_array_equal, found, cloud.within(**options))


def test_programs_with_classes_of_ones_own_stay_in_the_process(cache):
    """Their `repr` says nothing of their code; jradar's own are kept."""

    def answer(factor):
        @dataclasses.dataclass(frozen=True)
        class Own:
            size: int = 1

        def trace():
            program, _ = programs.traced(lambda x: factor * x, jnp.ones(2))
            yield "scaled", program

        return programs.ready(jnp.ones(2), (Own(),), trace=trace)["scaled"](jnp.ones(2))

    assert answer(2.0)[0] == 2 and answer(3.0)[0] == 3
    assert not [*cache.iterdir()]
    assert not [*programs.classes_of_others((MODEL.spec, MODEL.card.radar, NEAR))]


def test_structures_of_results_come_back():
    mixture = RangeMixture(0, 1, 2, 3)
    for result in (0, (CLOUD._replace(xyz=0, valid=1), 2), Seen(mixture, 4, None)):
        parts = json.loads(json.dumps(programs.described(result)))
        found = programs.built(parts)
        assert jax.tree.structure(found) == jax.tree.structure(result)
        assert jax.tree.leaves(found) == jax.tree.leaves(result)
    with pytest.raises(TypeError, match="returns dict, expected one of"):
        programs.described({"a": 0})


def test_the_oldest_programs_make_room(cache, monkeypatch):
    monkeypatch.setattr(programs, "MOST_FILES", 2)
    for distance in range(3):
        within(CLOUD, max_range_m=float(distance))
    assert len([*cache.iterdir()]) == 2
    assert not within(CLOUD, max_range_m=2.0)[1]
