"""Writing in one step, locked folders, limited reading, and JAX's cache of programs."""

import contextlib
import errno
import fcntl
import glob
import json
import os
import re
import secrets
import shutil
import stat
import zipfile
from collections.abc import Callable, Iterator
from io import BufferedReader, TextIOWrapper
from pathlib import Path
from typing import Any

from jradar.errors import UsageError, parsing

MAX_TEXT_BYTES = 4 << 20  # the largest description, a cascade's coupling, takes 0.5 MB
MAX_JSON_BYTES = 64 << 20
DISK_FULL = (errno.ENOSPC, errno.EDQUOT)
LOCK, REPLACED = ".lock", ".replaced"  # in a scratch folder: its lock, the old folder
LIST, HEAD = ".jradar", "# jradar"  # the list of files in a folder, and its first line


class FolderLocked(OSError):
    """Another process has locked the folder."""


@contextlib.contextmanager
def lock_folder(folder: Path | str) -> Iterator[None]:
    """Lock a folder, created if missing.

    Raises FolderLocked, with the other process's number, if another process has locked
    it, and UsageError for a `.lock` that is a link, or that holds anything but a
    process's number.
    """
    path = Path(folder) / ".lock"
    path.parent.mkdir(parents=True, exist_ok=True)
    foreign = UsageError(f"{path} is not a lock of jradar: choose another folder")
    if path.is_symlink():
        raise foreign
    with open(path, "a+", errors="replace", opener=_not_followed) as lock:
        lock.seek(0)
        holder = lock.read(20).strip()
        if holder and not holder.isdecimal():
            raise foreign
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            holder = holder or "unknown"
            raise FolderLocked(
                f"another process ({holder}) is running in {folder}: wait for it, or "
                "choose another folder"
            ) from error
        lock.seek(0)
        lock.truncate()
        lock.write(f"{os.getpid()}\n")
        lock.flush()
        yield


def _not_followed(path: str, flags: int) -> int:
    """Open a file unless it is a link, even one that has just been made."""
    return os.open(path, flags | os.O_NOFOLLOW, 0o666)


@contextlib.contextmanager
def atomic_path(path: Path | str) -> Iterator[Path]:
    """Yield a temporary path next to `path`; on success its file becomes `path`.

    An earlier file is replaced, and missing parents are created. The temporary path
    keeps the name, because writers such as `np.savez` look at its suffix. Raises
    UsageError if `path` is a folder.
    """
    path = Path(path)

    def refuse_folder() -> None:
        if path.is_dir():
            raise UsageError(f"{path} is a folder, expected the name of a file")

    with _scratch(path, refuse_folder) as scratch:
        yield scratch
        refuse_folder()
        os.replace(scratch, path)


@contextlib.contextmanager
def atomic_folder(folder: Path | str, *, marker: str) -> Iterator[Path]:
    """Yield a new temporary folder; on success it becomes `folder`.

    `marker` is the file by which folders of this kind are recognised; the caller writes
    it. An empty folder and one with the marker are replaced, missing parents are
    created. Raises UsageError for a folder with other contents, or to which somebody
    has added a file, and for a file.
    """
    folder = Path(folder)

    def refuse_others() -> None:
        if folder.exists() and not folder.is_dir():
            raise UsageError(f"{folder} is a file, expected a folder or a new name")
        names = sorted(entry.name for entry in folder.glob("*"))
        if names and marker not in names:
            raise UsageError(
                f"{folder} holds {', '.join(names[:3])}{' ..' if names[3:] else ''} "
                f"but no {marker}, so jradar did not write it: choose another name"
            )
        if (folder / LIST).is_file():
            known = read_text(folder / LIST, limit=MAX_JSON_BYTES).splitlines()
            for name in sorted({*_files(folder)} - {*known, LIST}):
                raise UsageError(
                    f"{folder / name} was not written by jradar: move it out of this "
                    "folder, or choose another name"
                )

    with _scratch(folder, refuse_others) as scratch:
        scratch.mkdir()
        yield scratch
        (scratch / LIST).write_text("\n".join([HEAD, *_files(scratch), ""]))
        refuse_others()
        if folder.exists():
            os.replace(folder, scratch.parent / REPLACED)
        os.replace(scratch, folder)


def _files(folder: Path) -> list[str]:
    found = (path for path in folder.rglob("*") if path.is_symlink() or path.is_file())
    return sorted(path.relative_to(folder).as_posix() for path in found)


def remove_leftovers(path: Path | str) -> None:
    """Remove what killed writers of `path` left next to it.

    If a writer was killed while it replaced the folder `path`, the old one returns.
    """
    path = Path(path)
    prefix = f".{path.name}-"
    for scratch in path.parent.glob(f"{glob.escape(prefix)}*"):
        if re.fullmatch("[a-z0-9_]{8}", scratch.name.removeprefix(prefix)):
            with contextlib.suppress(OSError):  # in use, gone, or somebody else's
                try:
                    with (scratch / LOCK).open("r+") as lock:
                        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                        _discard(scratch, path)
                except FileNotFoundError:  # killed before there was a lock
                    scratch.rmdir()  # fails unless it is empty


@contextlib.contextmanager
def _scratch(path: Path, check: Callable[[], None]) -> Iterator[Path]:
    """Yield a path of this name in a hidden, locked folder next to it; delete that."""
    check()
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_leftovers(path)
    while True:
        scratch = path.parent / f".{path.name}-{secrets.token_hex(4)}"
        try:
            try:
                scratch.mkdir(mode=0o700)
                if (lock := _new_lock(scratch)) is None:
                    continue
                with lock:
                    with contextlib.suppress(OSError):  # a file system without locks
                        fcntl.flock(lock, fcntl.LOCK_EX)
                    if os.fstat(lock.fileno()).st_nlink:
                        yield scratch / path.name
                        return
                    # Another writer took it for a leftover: try another name.
            finally:
                _discard(scratch, path)
        except OSError as error:
            if error.filename is None and error.errno in DISK_FULL:
                error.filename = str(path)  # errors of `write` name no file
            raise
        finally:
            _discard(scratch, path)  # if a signal has interrupted the first call


def _new_lock(scratch: Path) -> TextIOWrapper | None:
    """Open the lock; None if another writer took the empty folder for a leftover."""
    try:
        return (scratch / LOCK).open("w")
    except FileNotFoundError:
        return None


def _discard(scratch: Path, path: Path) -> None:
    """Delete a scratch folder; put an old folder back if its place is still free."""
    old = scratch / REPLACED
    if old.exists() and not path.exists():
        os.replace(old, path)
    shutil.rmtree(scratch, ignore_errors=True)


def inside(folder: Path | str, name: Any, *, source: Path | str) -> Path:
    """Return `folder / name`; ValueError if `name`, read in `source`, leaves `folder`.

    Absolute paths and `..` are refused, so that a file can only name its neighbours.
    """
    known = isinstance(name, str) and not Path(name).is_absolute()
    if not known or ".." in Path(name).parts:
        raise ValueError(
            f"{source} names {name!r}, expected a path inside {folder} without `..`"
        )
    return Path(folder) / name


def write_text(path: Path | str, text: str) -> None:
    """Write `text` to `path` in one step."""
    with atomic_path(path) as scratch:
        scratch.write_text(text, encoding="utf-8")


def open_file(path: Path | str, *, limit: int | None = None) -> BufferedReader:
    """Open a file for reading bytes.

    Raises UsageError for a pipe or a device, which may never answer or never end, and
    ValueError for a file of more than `limit` bytes.
    """
    # O_NONBLOCK does not wait for somebody who writes into a pipe.
    file = open(path, "rb", opener=lambda p, flags: os.open(p, flags | os.O_NONBLOCK))
    status = os.fstat(file.fileno())
    if stat.S_ISREG(status.st_mode) and (limit is None or status.st_size <= limit):
        return file
    file.close()
    if stat.S_ISREG(status.st_mode):
        raise ValueError(
            f"{path} holds {status.st_size:,} bytes, expected at most {limit:,}"
        )
    raise UsageError(f"{path} is a pipe or a device, expected a file")


def read_text(
    path: Path | str, *, errors: str = "strict", limit: int = MAX_TEXT_BYTES
) -> str:
    """Return the text of a file; ValueError if it is binary or exceeds `limit` bytes.

    `errors="replace"` is for formats whose comments may use another encoding.
    """
    with open_file(path, limit=limit) as file:
        content = file.read(limit)
    try:
        return content.decode("utf-8-sig", errors)
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is not a text file: {error.reason}") from error


def read_json(path: Path | str, *, limit: int = MAX_JSON_BYTES) -> dict[str, Any]:
    """Return the JSON object in a file of at most `limit` bytes.

    Raises FileNotFoundError for a missing file, UsageError for a pipe or a device, and
    ValueError for anything else.
    """
    if not os.path.exists(path):
        raise FileNotFoundError(f"no such file: {path}")
    with open_file(path, limit=limit) as file, parsing(path, "a JSON file"):
        values = json.loads(file.read(limit))
    if not isinstance(values, dict):
        raise ValueError(f"{path} is a {type(values).__name__}, expected an object")
    return values


def check_unpacked(path: Path | str, *, limit: int) -> None:
    """Raise ValueError for a zip archive, such as .npz, of more than `limit` bytes."""
    with zipfile.ZipFile(path) as archive:
        size = sum(member.file_size for member in archive.infolist())
    if size > limit:
        raise ValueError(f"it unpacks to {size:,} bytes, expected at most {limit:,}")


def use_compilation_cache() -> None:
    """Let JAX keep compiled programs in ~/.cache/jradar, also in child processes.

    Call it before JAX is imported. XDG_CACHE_HOME moves the folder, JAX's own variables
    take precedence, and JRADAR_CACHE=off disables it. A user without a home has none.
    """
    if os.environ.get("JRADAR_CACHE") == "off":
        return
    try:
        root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:  # no HOME, and no entry of the user
        return
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(root / "jradar"))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
