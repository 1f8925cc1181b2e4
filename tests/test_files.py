"""Files: one owner of a folder, nothing half-written; progress where no terminal is."""

import os

import pytest

from jradar.files import (
    FolderLocked,
    atomic_path,
    lock_folder,
    use_compilation_cache,
)
from jradar.progress import progress


def test_a_folder_has_one_owner_who_is_named(tmp_path):
    with lock_folder(tmp_path / "new"):
        with pytest.raises(FolderLocked, match=f"{os.getpid()}.* is running in"):
            with lock_folder(tmp_path / "new"):
                pass
    with lock_folder(tmp_path / "new"):
        pass


def test_a_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(RuntimeError):
        with atomic_path(path) as scratch:
            scratch.write_text("new")
            raise RuntimeError
    assert path.read_text() == "old" and [*tmp_path.iterdir()] == [path]


def test_progress_without_a_terminal_is_a_line_at_start_and_end(capsys):
    with progress("counting", 3, unit="items") as show:
        for done in (1, 2, 3):
            show(done, "fine")
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "counting 1/3  fine"
    assert lines[1].startswith("counting 3/3  fine") and "items/s" in lines[1]
    assert len(lines) == 2


def test_compilation_cache_is_where_the_environment_says(tmp_path, monkeypatch):
    name = "JAX_COMPILATION_CACHE_DIR"
    monkeypatch.setenv("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "1")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv(name, "x")  # remembered, and put back at the end
    monkeypatch.delenv(name)
    monkeypatch.setenv("JRADAR_CACHE", "off")
    use_compilation_cache()
    assert name not in os.environ
    monkeypatch.delenv("JRADAR_CACHE")
    use_compilation_cache()
    assert os.environ[name] == str(tmp_path / "jradar")
    monkeypatch.setenv(name, "mine")
    use_compilation_cache()
    assert os.environ[name] == "mine"
