"""Programs of an earlier process: they run alike, and no others are taken for them."""

import dataclasses
import json
import os
import time

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
    monkeypatch.setattr(programs, "IMPORTED_S", time.time())
    before = jax.config.values[FOLDER]
    jax.config.update(FOLDER, str(tmp_path))
    yield tmp_path
    jax.config.update(FOLDER, before)


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package of one file, in place of jradar's."""
    monkeypatch.setattr(programs, "PACKAGE", tmp_path / "package")
    programs.PACKAGE.mkdir()
    (programs.PACKAGE / "kernel.py").write_text("")
    return programs.PACKAGE


def within(cloud, *, restarted=True, **options):
    """The cloud within limits as a new process finds it, and whether it traced."""
    traced = []

    def trace():
        traced.append(True)
        yield "within", programs.traced(lambda c: c.within(**options), cloud)[0]

    programs.READY.clear()
    programs._code.cache_clear()
    if restarted:
        programs.IMPORTED_S = time.time()
    ready = programs.ready(cloud, options, trace=trace)
    return ready["within"](cloud), bool(traced)


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
def test_other_programs_are_not_taken_for_it(cache, monkeypatch, package, what):
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


def test_programs_of_files_that_changed_after_the_import_are_not_kept(cache, package):
    kept = [*cache.glob("*" + programs.SUFFIX)]
    before = (package / "kernel.py").stat()
    (package / "kernel.py").write_text("CHANGED = 1")
    os.utime(package / "kernel.py", ns=(before.st_atime_ns, before.st_mtime_ns))
    assert within(CLOUD, restarted=False, **NEAR)[1]
    assert [*cache.glob("*" + programs.SUFFIX)] == kept == []
    assert within(CLOUD, **NEAR)[1]
    assert not within(CLOUD, **NEAR)[1]
    (package / "kernel.py").write_text("CHANGED = 2")
    assert within(CLOUD, restarted=False, **NEAR)[1]  # it imported the one before


@pytest.mark.parametrize("what", ["text", "result", "folder", "full folder"])
def test_programs_that_do_not_run_are_traced_again_and_replaced(cache, what):
    expected, _ = within(CLOUD, **NEAR)
    (file,) = cache.iterdir()
    (program,) = programs.load(file.stem).values()
    wrong = {
        "text": {"within": program._replace(text=b"no program")},
        "result": {"within": program._replace(result=(0, 1, 2))},
    }
    if what in wrong:
        programs.save(file.stem, wrong[what])
    else:
        file.unlink()
        file.mkdir()
        if what == "full folder":
            (file / "mine").write_text("")
    found, traced = within(CLOUD, **NEAR)
    assert traced
    jax.tree.map(np.testing.assert_array_equal, found, expected)
    assert within(CLOUD, **NEAR)[1] == (what == "full folder")


def test_programs_with_classes_of_ones_own_stay_in_the_process(cache):
    """Their `repr` says nothing of their code; jradar's own are kept."""

    def answer(factor):
        @dataclasses.dataclass(frozen=True)
        class Own:
            size: int = 1

        def trace():
            program, _ = programs.traced(lambda x: factor * x, jnp.ones(2))
            yield "scaled", program

        ready = programs.ready(jnp.ones(2), (Own(),), trace=trace)
        return ready["scaled"](jnp.ones(2))

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


def test_the_digest_names_settings_and_versions(monkeypatch):
    first = programs.digest((), "option")
    before = jax.config.jax_default_matmul_precision
    jax.config.update("jax_default_matmul_precision", "highest")
    try:
        assert programs.digest((), "option") != first
    finally:
        jax.config.update("jax_default_matmul_precision", before)
    assert programs.digest((), "option") == first
    programs._code.cache_clear()
    with monkeypatch.context() as patch:
        patch.setattr(np, "__version__", "0.0")
        assert programs.digest((), "option") != first
    programs._code.cache_clear()
