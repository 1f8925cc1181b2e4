"""Jobs in processes and clusters: results, errors, and clusters that cannot work."""

import math
import os
from types import SimpleNamespace

import pytest

from jradar import __version__, workers
from jradar.workers import run_jobs


def test_jobs_come_with_their_results():
    assert list(run_jobs(math.factorial, [3, 4])) == [(3, 6), (4, 24)]
    assert {*run_jobs(math.factorial, [3, 4, 5], workers=2)} == {
        (3, 6), (4, 24), (5, 120)
    }  # fmt: skip


def test_the_first_error_of_a_job_ends_all():
    for number in (1, 2):
        with pytest.raises(ValueError, match="not defined for negative values"):
            list(run_jobs(math.factorial, [3, -1], workers=number))


def test_a_process_that_dies_is_named():
    with pytest.raises(OSError, match="one of 2 processes died: for lack of memory"):
        list(run_jobs(os._exit, [0, 0], workers=2))


def test_a_cluster_that_is_not_there_or_has_no_workers(monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(workers, "PATIENCE_S", 0.5)
    with pytest.raises(OSError, match="no Dask scheduler at nowhere:1 .* start one by"):
        list(run_jobs(math.factorial, [3], scheduler="nowhere:1"))
    options = {"n_workers": 0, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(**options) as cluster:
        with pytest.raises(OSError, match="has no workers: start some by `dask worker"):
            list(run_jobs(math.factorial, [3], scheduler=cluster.scheduler_address))


@pytest.mark.parametrize(
    ("packages", "said"),
    [
        ({}, "has no jradar: install"),
        ({"jradar": "0.1.0"}, "has jradar 0.1.0: install"),
    ],
)
def test_workers_of_another_version_are_refused(packages, said):
    found = {
        "client": {"packages": {"jradar": __version__}},
        "workers": {"tcp://10.0.0.7:1": {"packages": packages}},
    }
    client = SimpleNamespace(get_versions=lambda packages: found)
    with pytest.raises(OSError, match=f"the worker at tcp://10.0.0.7:1 {said}"):
        workers._check_versions(client)
