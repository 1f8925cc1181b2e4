"""Files: one owner of a folder, nothing half-written."""

import contextlib
import fcntl
import itertools
import os
import pwd
import shutil
import sys
from pathlib import Path

import pytest

from jradar import files
from jradar.errors import UsageError
from jradar.files import (
    FolderLocked,
    atomic_folder,
    atomic_path,
    inside,
    lock_folder,
    read_json,
    remove_leftovers,
    use_compilation_cache,
)


def test_a_folder_has_one_owner_who_is_named(tmp_path):
    with lock_folder(tmp_path / "new"):
        with pytest.raises(FolderLocked, match=f"{os.getpid()}.* is running in"):
            with lock_folder(tmp_path / "new"):
                pass
    with lock_folder(tmp_path / "new"):
        pass


@pytest.mark.parametrize("exists", [True, False])
def test_a_lock_that_is_a_link_is_not_followed(tmp_path, exists):
    target = tmp_path / "target"
    if exists:
        target.write_text("")
    (tmp_path / "new").mkdir()
    (tmp_path / "new" / ".lock").symlink_to(target)
    with pytest.raises(UsageError, match="lock is not a lock of jradar"):
        with lock_folder(tmp_path / "new"):
            pass
    assert not target.read_text() if exists else not target.exists()


def test_a_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(RuntimeError):
        with atomic_path(path) as scratch:
            scratch.write_text("new")
            raise RuntimeError
    assert path.read_text() == "old" and [*tmp_path.iterdir()] == [path]


def test_a_file_never_replaces_a_folder(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.txt").write_text("years of work")
    with pytest.raises(UsageError, match="out is a folder"):
        with atomic_path(tmp_path / "out") as scratch:
            scratch.write_text("new")
    late = tmp_path / "late"
    with pytest.raises(UsageError, match="late is a folder"):
        with atomic_path(late) as scratch:
            scratch.write_text("new")
            late.mkdir()
    assert (tmp_path / "out" / "thesis.txt").read_text() == "years of work"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["late", "out"]


def write_note(folder, text):
    with atomic_folder(folder, marker="note.txt") as scratch:
        (scratch / "note.txt").write_text(text)


def test_a_folder_replaces_only_its_own_kind(tmp_path):
    folder, others = tmp_path / "run", tmp_path / "others"
    folder.mkdir()  # an empty one is free
    for text in ("first", "second"):
        write_note(folder, text)
        assert (folder / "note.txt").read_text() == text
    others.mkdir()
    (others / "thesis.txt").write_text("years of work")
    with pytest.raises(UsageError, match="others holds thesis.txt but no note.txt"):
        write_note(others, "lost")
    (tmp_path / "file").write_text("years of work")
    with pytest.raises(UsageError, match="file is a file, expected a folder"):
        write_note(tmp_path / "file", "lost")
    assert [p.name for p in others.iterdir()] == ["thesis.txt"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "others", "run"]


def test_what_a_killed_process_left_is_removed(tmp_path):
    tails = ("abandons", "in_use00", "notes", "unmarked")
    left, used, mine, unmarked = (tmp_path / f".a.txt-{tail}" for tail in tails)
    for folder in (left, used, mine, unmarked):
        folder.mkdir()
        (folder / "half").write_text("written")
    for folder in (left, used, mine):
        (folder / ".lock").touch()
    with (used / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with atomic_path(tmp_path / "a.txt") as scratch:
            scratch.write_text("new")
    found = {path.name for path in tmp_path.iterdir()}
    assert found == {"a.txt", used.name, mine.name, unmarked.name}


@contextlib.contextmanager
def traced(act):
    """Call `act(number)` before every line that `jradar.files` executes."""
    count, before = itertools.count(1), sys.gettrace()

    def trace(frame, event, _):
        if frame.f_code.co_filename != files.__file__:
            return None
        if event == "line":
            act(next(count))
        return trace

    sys.settrace(trace)
    try:
        yield
    finally:
        sys.settrace(before)


def old_run(root):
    """A folder with its own kind of contents."""
    (root / "run").mkdir(parents=True)
    (root / "run" / "note.txt").write_text("old")
    return root / "run"


def test_an_interruption_at_any_line_leaves_the_old_or_the_new_folder(tmp_path):
    def interrupt(number):
        if number == last:
            raise KeyboardInterrupt

    found = []
    for last in range(1, 200):
        folder = old_run(tmp_path / str(last))
        try:
            with traced(interrupt):
                write_note(folder, "new")
        except KeyboardInterrupt:
            pass
        else:
            break
        assert [p.name for p in folder.parent.iterdir()] == ["run"], last
        found.append((folder / "note.txt").read_text())
    assert 30 < len(found) < 198 and {*found} == {"old", "new"}
    assert found == sorted(found, reverse=True)  # first old, then new


def test_a_kill_at_any_line_leaves_the_old_or_the_new_folder(tmp_path):
    folder = old_run(tmp_path / "here")

    def keep_copy(number):
        shutil.copytree(folder.parent, tmp_path / f"{number:03d}")

    with traced(keep_copy):
        write_note(folder, "new")
    copies = sorted(p for p in tmp_path.iterdir() if p.name.isdecimal())
    assert len(copies) > 30
    for copy in copies:  # as a kill leaves the folder, for the next writer
        remove_leftovers(copy / "run")
        assert (copy / "run" / "note.txt").read_text() in ("old", "new")
        assert [p.name for p in copy.iterdir()] == ["run"]


def test_a_writer_whose_new_folder_another_one_removed_tries_again(tmp_path):
    """Between the folder and its lock, where a kill leaves an empty folder as well."""
    path, removed = tmp_path / "a.txt", list[Path]()

    def open_once(self, *arguments, **options):
        if self.name == ".lock" and not removed:
            removed.append(self.parent)
            remove_leftovers(path)
        return opened(self, *arguments, **options)

    opened = Path.open
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "open", open_once)
        with atomic_path(path) as scratch:
            scratch.write_text("new")
    assert removed and not removed[0].exists() and path.read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.parametrize("name", ["/etc/passwd", "../x", "a/../../x", None, 3])
def test_a_file_names_only_its_neighbours(name):
    with pytest.raises(ValueError, match=r"manifest.json names .* inside data without"):
        inside("data", name, source="manifest.json")
    assert inside("data", "a/b.txt", source="x") == Path("data/a/b.txt")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"{", "bad.json is damaged or not a JSON file"),
        (b"[" * 100_000, "bad.json is damaged or not a JSON file"),
        (b"\xff\xfe", "bad.json is damaged or not a JSON file"),
        (b"[1]", "is a list, expected an object"),
        (b" " * 200, "holds 200 bytes, expected at most 100"),
    ],
)
def test_a_file_that_is_no_json_object(tmp_path, content, message):
    (tmp_path / "bad.json").write_bytes(content)
    with pytest.raises(ValueError, match=message):
        read_json(tmp_path / "bad.json", limit=100 if b" " in content else 1 << 20)


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


def test_a_user_without_a_home_has_no_compilation_cache(monkeypatch):
    def no_entry(_):
        raise KeyError("getpwuid(): uid not found: 12345")

    for name in ("HOME", "XDG_CACHE_HOME", "JRADAR_CACHE", "JAX_COMPILATION_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", no_entry)
    use_compilation_cache()
    assert "JAX_COMPILATION_CACHE_DIR" not in os.environ
