"""Benchmarks: rounds and ratios of the harness; names and peers of all cases."""

import importlib
import json
from pathlib import Path

import pytest

from benchmarks import soak_points, soak_stream
from benchmarks.harness import Case, Timing, available, measure

FOLDER = Path(__file__).parents[1] / "benchmarks"
ROOMS = sorted(path.stem for path in FOLDER.glob("bench_*.py"))


def test_every_call_runs_in_every_round():
    counts = {"ours": 0, "peer": 0}

    def call(name):
        counts[name] += 1

    case = Case("x", lambda: call("ours"), {"peer": lambda: call("peer")})
    timing = measure(case, seconds=0.0)
    assert counts == {"ours": 12, "peer": 12}  # compile, warm up, five rounds of 2
    assert timing.best_peer == "peer" and timing.ratio > 0


def test_ratio_is_to_the_fastest_peer():
    timing = Timing("x", 1.0, 3.0, 2.0, {"slow": 30.0, "fast": 6.0})
    assert timing.best_peer == "fast" and timing.ratio == 0.5


def test_without_a_peer_there_is_no_ratio():
    timing = Timing("x", 1.0, 3.0, 2.0, {})
    assert timing.best_peer is None and timing.ratio is None


def test_peers_that_are_not_installed_are_left_out(capsys):
    def missing():
        import no_such_package  # noqa: F401

    peers = available({"there": lambda: print, "missing": missing})
    assert peers == {"there": print}
    assert "without missing: No module named 'no_such_pac" in capsys.readouterr().err


def test_peer_with_another_result_is_refused():
    peers = {"right": lambda: 1.0, "wrong": lambda: 2.0}
    case = Case("x", lambda: 1.0, peers, same=lambda ours, peer: ours == peer)
    with pytest.raises(ValueError, match="x: the result of wrong differs from ours"):
        measure(case, seconds=0.0)


SLOW = ("bench_diffusion",)  # the quick run in CI covers them


@pytest.mark.parametrize(
    "room",
    [pytest.param(r, marks=[pytest.mark.slow] if r in SLOW else []) for r in ROOMS],
)
def test_cases_have_unique_names_and_peers(room, capsys):
    cases = [*importlib.import_module(f"benchmarks.{room}").cases()]
    assert cases and len({case.name for case in cases}) == len(cases)
    alone = [case.name for case in cases if not case.peers]
    left_out = sorted({*capsys.readouterr().err.splitlines()})
    if alone and left_out:
        pytest.skip(f"{len(alone)} cases have no installed peer: {left_out}")
    assert not alone


@pytest.mark.slow
def test_a_live_session_without_a_model_publishes_what_was_sent(capsys):
    soak_stream.main(["--seconds", "1", "--rate", "4"])
    printed = capsys.readouterr().out
    found = json.loads(printed[printed.index("{") :])
    assert found["published and bit-identical"] == found["frames published"] > 0


@pytest.mark.slow
def test_a_live_session_of_points_publishes_all_that_was_sent(capsys):
    soak_points.main(["--seconds", "1", "--rate", "4"])
    printed = capsys.readouterr().out
    found = json.loads(printed[printed.index("{") :])
    assert 0 < found["frames published"] <= found["frames received"]
    assert found["frames received"] <= found["frames sent"] and not found["lost bytes"]
