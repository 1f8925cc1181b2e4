"""The table of mounts: errors of the axes that a walk shows, and what it does not."""

from experiments.studies import mounts
from jradar.calibration.mount import AXES


def test_errors_count_where_a_walk_shows_the_axis(tmp_path):
    shown = [True] * len(AXES)

    def walk(name, error, poses="true poses", seen=shown):
        numbers = {"error": [error] * len(AXES), "deviation": [0.5] * len(AXES)}
        return {"walk": name, "poses": poses, **numbers, "shown": seen}

    hidden = [False, *shown[1:]]
    found = [
        walk("hall", 0.3),
        walk("lab", -1.2, seen=hidden),
        walk("straight, 4 s", 9.0),  # in the list of walks alone
        {"walk": "home", "poses": "KISS-ICP", "refused": "4 poses"},
    ]
    mounts.report(tmp_path / "mounts.md", found)
    lines = (tmp_path / "mounts.md").read_text().splitlines()
    first, second, name = (AXES[0][0], AXES[1][0], AXES[0][0])
    assert f"| true poses | {first} (deg) | 1/2 | 0.300 | 0.300 | 1 of 1 |" in lines
    assert f"| true poses | {second} (deg) | 2/2 | 0.875 | 1.200 | 1 of 2 |" in lines
    assert f"| KISS-ICP | {first} (deg) | 0/0 |  |  |  |" in lines
    assert f"| lab | true poses | {name} |" in lines
    assert "| home | KISS-ICP | 4 poses |" in lines
