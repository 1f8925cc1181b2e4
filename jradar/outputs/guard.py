"""What a command may replace: what it wrote itself when it ran before.

It never touches its input, a file of somebody else, or another command's results,
unless `--force` is given.

    a file      begins as the command writes it: check_replaceable
    a folder    lists what the command wrote there: GuardedFolder
"""

import hashlib
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path, PurePath

from jradar.errors import UsageError
from jradar.files import (
    HEAD,
    LIST,
    MAX_JSON_BYTES,
    open_file,
    read_text,
    remove_leftovers,
    write_text,
)


def check_replaceable(path: Path | str, *, begins: str, force: bool = False) -> None:
    """Raise UsageError for a file that does not begin as the command's files do.

    `force` lets the command replace any file, but no pipe and no device.
    """
    path, ours = Path(path), not os.path.lexists(path)
    if path.exists():
        with open_file(path) as file:
            ours = file.read(len(begins)) == begins.encode()
    if not (ours or force):
        raise _kept(path, "was not written by this command")


def _kept(path: Path, why: str) -> UsageError:
    return UsageError(f"{path} {why}: name another output, or add --force")


class GuardedFolder:
    """A folder with the results of one command, which are replaced when it runs again.

    The file `.jradar` in it names the command and lists the digests of what it wrote.
    Files that it does not list, or that somebody has changed, are never touched, unless
    `force` replaces those whose names are needed.
    """

    def __init__(self, folder: Path | str, command: str, *, force: bool = False):
        """Raise UsageError for a folder with the results of another command."""
        self.path, self.force = Path(folder), force
        self._list, self._head = self.path / LIST, f"{HEAD} {command}"
        self._digests: dict[str, str] = {}
        self._earlier: dict[PurePath, set[str]] = {}  # by folder, of earlier runs
        self._begun = self._list.is_file() and self._read()

    def check(self, names: Iterable[str]) -> None:
        """Raise UsageError if one of these files exists and is not as it was written.

        Names are relative to the folder.
        """
        for name in names:
            path = self.path / name
            if os.path.lexists(path) and not (self.force or self._unchanged(name)):
                raise _kept(path, "was not written by this command, or changed since")

    def put(
        self, files: Mapping[str, Callable[[Path], None]], *, keep: bool = False
    ) -> list[str]:
        """Write each file with its function, which takes a path; return the paths.

        Files of an earlier run in the same folders are removed, unless `keep` is set.
        """
        self.check(files)
        for parent in {PurePath(name).parent for name in files} if not keep else ():
            for name in self._earlier.pop(parent, set()) - files.keys():
                remove_leftovers(self.path / name)
                if self._unchanged(name):
                    (self.path / name).unlink()
        for name, write in files.items():
            write(self.path / name)
            self._add(name)
        return [str(self.path / name) for name in files]

    def _read(self) -> bool:
        """Read the list; return whether this command began it."""
        head, *lines = read_text(self._list, limit=MAX_JSON_BYTES).splitlines() or [""]
        if head != self._head and not self.force:
            raise _kept(self.path, f"holds what `{head.removeprefix('# ')}` wrote")
        for digest, _, name in (line.partition("  ") for line in lines):
            self._digests[name] = digest
            self._earlier.setdefault(PurePath(name).parent, set()).add(name)
        return head == self._head

    def _unchanged(self, name: str) -> bool:
        return self._digests.get(name, "") == self._digest(name)

    def _digest(self, name: str) -> str | None:
        if not (self.path / name).is_file():
            return None
        with (self.path / name).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    def _add(self, name: str) -> None:
        if not self._begun:
            lines = (f"{digest}  {old}\n" for old, digest in self._digests.items())
            write_text(self._list, "".join([f"{self._head}\n", *lines]))
            self._begun = True
        digest = self._digest(name) or ""
        if self._digests.get(name) != digest:
            self._digests[name] = digest
            with self._list.open("a", encoding="utf-8") as file:
                file.write(f"{digest}  {name}\n")
