"""Writing files so that nothing half-written is left behind; locks; JAX's cache."""

import contextlib
import fcntl
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path


class FolderLocked(OSError):
    """Another process holds the folder."""


@contextlib.contextmanager
def lock_folder(folder: Path | str) -> Iterator[None]:
    """Hold a folder, which is made if need be; FolderLocked if another process does."""
    path = Path(folder) / ".lock"
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            lock.seek(0)
            holder = lock.read(20).strip() or "unknown"
            raise FolderLocked(
                f"another process ({holder}) is running in {folder}"
            ) from error
        lock.seek(0)
        lock.truncate()
        lock.write(f"{os.getpid()}\n")
        lock.flush()
        yield


@contextlib.contextmanager
def atomic_path(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path beside `path`; it takes `path`'s place on success only.

    Works for a file and for a folder (make it with `mkdir`); missing parents are made.
    The temporary path keeps the suffix, which writers such as `np.savez` look at.
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
    """Let JAX keep what it compiles in ~/.cache/jradar, for this process and its own.

    To be called before JAX is imported. XDG_CACHE_HOME moves the folder, JAX's own
    variables win, JRADAR_CACHE=off leaves it.
    """
    if os.environ.get("JRADAR_CACHE") == "off":
        return
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(root / "jradar"))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
