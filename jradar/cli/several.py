"""One command over several recordings: a folder of results each, and one table.

    jradar enhance walks/* -o out --workers 4

    out/recordings.csv     a row a recording: what the command found, or why it failed
    out/NAME/              what the command writes for one recording

Each recording is a job for `jradar.workers`. One that fails is named and the others go
on. What `recordings.json` lists as done, of the same files, model and options, is not
done again, so the same command resumes.
"""

import argparse
import collections
import contextlib
import csv
import functools
import hashlib
import io
import json
import os
import textwrap
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from jradar import __version__
from jradar.cli.paths import check_paths
from jradar.cli.printing import Results, in_words
from jradar.cli.verbosity import LOG, speaking
from jradar.errors import UsageError, exit_code
from jradar.files import lock_folder, read_json, write_text
from jradar.options.models import absolute_model
from jradar.outputs.guard import GuardedFolder
from jradar.progress import progress
from jradar.workers import run_jobs

TABLE, DONE = "recordings.csv", "recordings.json"
ENDINGS = (".bag", ".mcap", ".db3", ".bin", ".dat", ".npy", ".npz", ".pcap")
DESCRIPTIONS = (".cfg", ".json", ".lua", ".toml", ".tum", ".txt")  # next to a file
UNRELATED = (  # options that do not change what a command writes
    *("path", "output", "recordings", "workers", "scheduler", "force"),
    *("json", "quiet", "verbose"),
)
FAILED = 4  # the exit code where a recording fails
SHOWN = 80  # letters of an error in the table that is printed


class Job(NamedTuple):
    """A recording, and the options of the command for it."""

    name: str
    options: argparse.Namespace
    digest: str


def begins_several(options: argparse.Namespace) -> bool:
    """Set the recordings of a command that takes several; return whether it got some.

    Otherwise its `path` becomes the only one.
    """
    options.recordings = []
    if not getattr(options, "takes_several", False):
        return False
    options.recordings = recordings_at(options.path)
    if not options.recordings:
        (options.path,) = options.path
    return bool(options.recordings)


def recordings_at(paths: list[str]) -> list[str]:
    """Return the recordings of several paths, or nothing for that of a single one.

    A folder that is not a recording stands for those in it, and in the folders there;
    also for what ends as one and may be damaged.
    """
    if len(paths) == 1 and not os.path.isdir(paths[0]):
        return []
    from jradar.recordings import is_recording, recordings_in

    found = list[str]()
    for path in paths:  # one without any is kept, so that its error is shown
        is_folder = os.path.isdir(path) and not is_recording(path)
        inside = recordings_in(Path(path), endings=ENDINGS) if is_folder else ()
        found += [*map(str, inside)] or [path]
    return found if len(paths) > 1 or found != [paths[0]] else []


def run(options: argparse.Namespace) -> Results:
    """Run the command over `options.recordings`, and return their table.

    Raises UsageError for two recordings of one name, and for a folder that another
    command wrote.
    """
    jobs = _jobs(options)
    if getattr(options, "output", None) is None:
        found = _Run(jobs, None)
        found.go(options)
        return found.results()
    kind = f"{options.command.__name__.rstrip('_')} of several recordings"
    folder = GuardedFolder(options.output, kind, force=options.force)
    folder.check([TABLE, DONE])
    with lock_folder(options.output):
        found = _Run(jobs, folder)
        found.go(options)
        return found.results()


def _jobs(options: argparse.Namespace) -> list[Job]:
    names = collections.defaultdict(list)
    for path in options.recordings:
        names[Path(path).name if os.path.isdir(path) else Path(path).stem].append(path)
    for name, (first, *others) in names.items():
        if others:
            raise UsageError(
                f"{first} and {others[0]} are both named {name}, and so would be their "
                "results: rename one, or give each a run of its own"
            )
    common = vars(options) | {"recordings": [], "quiet": True, "verbose": False}
    chosen = {k: v for k, v in common.items() if k not in UNRELATED}
    jobs, described = [], [*_described(chosen)]
    near = functools.cache(_descriptions)  # a folder may hold thousands
    for name, (path,) in names.items():
        own: dict[str, Any] = {"path": path}
        if common.get("frames", 0) is None and common["frame"] is None:
            own["frames"] = slice(None)
        if common.get("output") is not None:
            suffix = next(iter(options.output_suffixes or ()), "")
            own["output"] = os.path.join(options.output, name + suffix)
        state = [__version__, _stamps(path, near), *described]
        digest = hashlib.sha256(json.dumps(state).encode()).hexdigest()
        given = common | own
        if options.scheduler is not None:  # whose workers may run in another folder
            given = {k: _absolute(k, value) for k, value in given.items()}
        jobs.append(Job(name, argparse.Namespace(**given), digest))
    return jobs


def _absolute(name: str, value: Any) -> Any:
    """Return the value of an option; what it names on disk becomes an absolute path."""
    if value is None or name not in ("path", "output", "radar", "model"):
        return value
    return absolute_model(value) if name == "model" else os.path.abspath(value)


def _described(chosen: dict[str, Any]) -> Iterator[Any]:
    """Yield options by name, with the state of the files that they name."""
    for name, value in sorted(chosen.items()):
        text = getattr(value, "__qualname__", None) or str(value)
        is_path = isinstance(value, str) and os.path.exists(value)
        yield [name, text, _stamps(value) if is_path else None]


def _descriptions(folder: Path) -> list[Path]:
    """Return the files of a folder that may describe the recordings next to them."""
    return [p for p in sorted(folder.iterdir()) if p.suffix in DESCRIPTIONS]


def _stamps(path: str, near: Callable[[Path], list[Path]] = _descriptions) -> list[Any]:
    """Return sizes and times of a recording's files, and of those that describe it."""
    top = Path(path)
    files = [*sorted(top.rglob("*"))] if top.is_dir() else [top, *near(top.parent)]
    files = [p for p in files if p.is_file()]
    states = [(str(p.resolve()), p.stat()) for p in files]
    return [[name, state.st_size, state.st_mtime_ns] for name, state in states]


def _listed(folder: Path) -> dict[str, dict[str, Any]]:
    """Return what earlier runs did, by the recordings' names."""
    return read_json(folder / DONE) if (folder / DONE).is_file() else {}


def _unchanged(done: dict[str, Any], job: Job) -> bool:
    return done["digest"] == job.digest and all(map(os.path.exists, done["written"]))


class _Run:
    """The jobs of a run, and what became of them."""

    def __init__(self, jobs: list[Job], folder: GuardedFolder | None):
        self.jobs, self.folder = jobs, folder
        self.listed = _listed(folder.path) if folder else {}
        self.failed: dict[str, str] = {}
        listed = [job for job in jobs if job.name in self.listed]
        changed = [j for j in listed if not _unchanged(self.listed[j.name], j)]
        self.done = {job.name for job in listed} - {job.name for job in changed}

    def go(self, options: argparse.Namespace) -> None:
        """Do what is left; KeyboardInterrupt says how much is done."""
        left = [job for job in self.jobs if job.name not in self.done]
        what, total = options.command.__name__.rstrip("_"), len(self.jobs)
        if self.done:
            LOG.warning(f"{len(self.done)} of {total} recordings are done, unchanged")
        work: dict[str, Any] = {"workers": min(options.workers, len(left)) or 1}
        work["scheduler"] = options.scheduler if left else None
        try:
            with (
                progress(what, total, first=len(self.done), unit="recordings") as show,
                contextlib.closing(run_jobs(run_one, left, **work)) as finished,
            ):
                for job, found in finished:
                    self._add(job, found)
                    show(len(self.done) + len(self.failed), job.name)
        except KeyboardInterrupt as stop:
            kept = f"{len(self.done)} of {total} recordings are done"
            more = "; run the same command to go on" if self.folder else ""
            raise type(stop)(f"interrupted: {kept}{more}") from None

    def _add(self, job: Job, found: dict[str, Any]) -> None:
        if "error" in found:
            self.failed[job.name] = found["error"]
            LOG.warning(f"{job.name}: {found['error']}")
        else:
            self.listed[job.name] = found | {"digest": job.digest}
            self.done.add(job.name)
        self.write()

    def write(self) -> list[str]:
        """Write the table and the list of what is done; return their paths."""
        if self.folder is None:
            return []
        rows, text = [*self.rows()], io.StringIO()
        names = dict.fromkeys(name for row in rows for name in row)
        table = csv.DictWriter(text, [*names], lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
        listed = json.dumps(self.listed, indent=1)
        return self.folder.put(
            {
                TABLE: lambda path: write_text(path, text.getvalue()),
                DONE: lambda path: write_text(path, listed),
            }
        )

    def rows(self) -> Iterator[dict[str, Any]]:
        """Yield a row for each recording that is done or failed, in their order."""
        for job in self.jobs:
            if job.name in self.done:
                found = self.listed[job.name]
                last = {"seconds": found["seconds"], "warnings": len(found["notes"])}
                yield {"name": job.name, **found["row"], **last}
            elif job.name in self.failed:
                yield {"name": job.name, "error": self.failed[job.name]}

    def results(self) -> Results:
        """Return what is printed; the warnings of all recordings are counted."""
        having = collections.defaultdict[str, list[str]](list)
        for name in (job.name for job in self.jobs if job.name in self.done):
            for note in self.listed[name]["notes"]:
                having[note].append(name)
        notes = sorted(having.items(), key=lambda found: -len(found[1]))  # stable
        result = Results(
            {
                "recordings": len(self.jobs),
                "failed": len(self.failed),
                "by recording": [_short(row) for row in self.rows()],
                "notes": [f"{_which(names)}: {note}" for note, names in notes],
                "written": self.write(),
            }
        )
        result.code = FAILED if self.failed else 0
        return result


def _which(names: list[str]) -> str:
    """Return the name of a recording, or how many there are."""
    return names[0] if len(names) == 1 else f"{len(names)} recordings"


def run_one(job: Job) -> dict[str, Any]:
    """Run the command for one recording, and return its row, notes and files.

    What a user can fix is returned as an error.
    """
    begin, options = time.perf_counter(), job.options
    try:
        with warnings.catch_warnings(), speaking(options):
            warnings.simplefilter("ignore")
            check_paths(options)
            result = options.command(options)
        if getattr(result, "code", 0):  # a part of a map is not done
            raise KeyboardInterrupt
    except Exception as error:
        if exit_code(error) is None:
            raise
        return {"error": in_words(error)}
    return {
        "row": dict(_flat(result)),
        "seconds": round(time.perf_counter() - begin, 3),
        "notes": [str(note) for note in result.get("notes", ())],
        "written": [str(path) for path in result.get("written", ())],
    }


def _flat(result: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the single values of a result, those of tables within it by both names.

    Of a table of frames, these are their number and the means.
    """
    for name, value in result.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name} ")
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            yield from _means(value) if "frame" in value[0] else ()
        elif isinstance(value, str | int | float):
            yield prefix + name, value


def _means(rows: list[dict[str, Any]]) -> Iterator[tuple[str, float]]:
    """Yield how many frames there are, and the mean of each column but their times.

    The number replaces that of the frames in the recording.
    """
    yield "frames", len(rows)
    for name in rows[0]:
        values: list[Any] = [row.get(name) for row in rows]
        values = [value for value in values if type(value) in (int, float)]
        if name not in ("frame", "stamp_s") and len(values) == len(rows):
            yield f"mean {name}", sum(values) / len(values)


def _short(row: dict[str, Any]) -> dict[str, Any]:
    """Return what the terminal shows of a row; the table has the rest."""
    sure = "mean confidence (%)"
    names = ("name", "frames", *([sure] if sure in row else []), "seconds", "warnings")
    shown = {name: row.get(name) for name in names}
    error = textwrap.shorten(row.get("error", ""), SHOWN, placeholder=" ..")
    return shown | ({"error": error} if error else {})
