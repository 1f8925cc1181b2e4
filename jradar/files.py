"""Atomic writing, locked folders, and JAX's cache of compiled programs."""

import contextlib
import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path


class FolderLocked(OSError):
    """Another process has locked the folder."""


@contextlib.contextmanager
def lock_folder(folder: Path | str) -> Iterator[None]:
    """Lock a folder, created if missing.

    Raises FolderLocked, with the other process's number, if another one has locked it.
    """
    path = Path(folder) / ".lock"
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            lock.seek(0)
            holder = lock.read(20).strip() or "unknown"
            raise FolderLocked(
                f"another process ({holder}) is running in {folder}: wait for it, or "
                "choose another folder"
            ) from error
        lock.seek(0)
        lock.truncate()
        lock.write(f"{os.getpid()}\n")
        lock.flush()
        yield


@contextlib.contextmanager
def atomic_path(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path beside `path`, and move it to `path` on success.

    It works for a file and for a folder, which the caller creates with `mkdir`. Missing
    parents are created. The temporary path keeps the name, because writers such as
    `np.savez` look at its suffix.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(prefix=f".{path.stem}-", dir=path.parent))
    try:
        yield scratch / path.name
        if path.is_dir():
            os.replace(path, scratch / "replaced")
        os.replace(scratch / path.name, path)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def write_text(path: Path | str, text: str) -> None:
    """Write `text` to `path` in one step."""
    with atomic_path(path) as scratch:
        scratch.write_text(text, encoding="utf-8")


def use_compilation_cache() -> None:
    """Let JAX keep compiled programs in ~/.cache/jradar, also in child processes.

    Call it before JAX is imported. XDG_CACHE_HOME moves the folder, JAX's own variables
    take precedence, and JRADAR_CACHE=off disables it.
    """
    if os.environ.get("JRADAR_CACHE") == "off":
        return
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(root / "jradar"))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
