"""Guarded folders: another command's results are kept, unless they are forced."""

import pytest

from jradar.errors import UsageError
from jradar.outputs.guard import GuardedFolder

WORDS = {"notes.txt": lambda path: path.write_text("of radar points")}


def test_another_command_replaces_results_only_if_forced(tmp_path):
    GuardedFolder(tmp_path, "enhance").put(
        {"cloud.txt": lambda path: path.write_text("of a cloud")}
    )
    with pytest.raises(UsageError, match="holds what `jradar enhance` wrote"):
        GuardedFolder(tmp_path, "points")
    GuardedFolder(tmp_path, "points", force=True).put(WORDS)
    assert [path.name for path in tmp_path.glob("*.txt")] == ["notes.txt"]
    GuardedFolder(tmp_path, "points").check(WORDS)  # they are its own now
    (tmp_path / "notes.txt").write_text("of somebody else")
    with pytest.raises(UsageError, match="or changed since"):
        GuardedFolder(tmp_path, "points").check(WORDS)
    GuardedFolder(tmp_path, "points", force=True).check(WORDS)
