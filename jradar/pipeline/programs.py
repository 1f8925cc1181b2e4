"""Traced programs that one process saves for the next, in the folder of JAX's cache.

JAX finds a compiled program by its text, but tracing the text takes longer than running
the program a hundred times. Here texts are found by what shapes them: options, kinds of
arrays, jradar's source files, and versions. The code of a class from outside of jradar,
such as a network of your own, is not among these. So the programs of such options stay
in the process that traced them, and so do all once a source file is not the one that
was imported.
"""

import contextlib
import dataclasses
import functools
import hashlib
import json
import os
import sys
import zlib
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import flax
import jax
import jaxlib
import numpy as np
from flax.serialization import msgpack_restore, msgpack_serialize
from jax.tree_util import keystr, tree_flatten_with_path

from jradar import IMPORTED_S
from jradar.diffusion import RangeMixture
from jradar.errors import UsageError
from jradar.files import atomic_path, open_file
from jradar.model import compiler_options
from jradar.model.grids.polar import PolarImage
from jradar.pipeline.fusion import Seen
from jradar.range_image import RangeImage
from jradar.types import PointCloud

PACKAGE = Path(__file__).parents[1]
SUFFIX = ".programs"
MOST_FILES = 32  # in the folder, of about 1 MB each; the oldest are removed
MOST_BYTES = 1 << 28  # of a file, unpacked
RECORDS = {
    kind.__name__: kind
    for kind in (PointCloud, RangeImage, PolarImage, RangeMixture, Seen)
}
MOST_READY = 16  # sets of programs in a process
Compiled = dict[str, Callable[..., Any]]
READY: dict[str, tuple[Compiled, list[type]]] = {}  # by `digest`, and classes they need


class Program(NamedTuple):
    """A traced function: its text from `jax.export`, and its result's structure."""

    text: bytes
    result: Any  # whose leaves are the numbers of the values that the program returns


def ready(
    arguments: Any,
    *options: Any,
    trace: Callable[[], Iterator[tuple[str, Program]]],
) -> Compiled:
    """Return compiled programs by name: of this process, an earlier one, or traced now.

    `trace` yields names and `traced` programs, whose names follow from the arguments.
    Saved programs are found by the shapes and types of `arguments` and the `repr` of
    `options`. Those that XLA refuses are traced again and replaced.
    """
    foreign = [*classes_of_others(options)]
    name = digest(arguments, *options, *map(id, foreign))
    if name not in READY:
        shared, found = not foreign and unedited(), None
        known = load(name) if shared else None
        if known:
            with contextlib.suppress(Exception):  # a text of no program
                found, _ = _compiled(known.items())
        if found is None:
            found, texts = _compiled(trace())
            if shared and unedited():
                save(name, texts)
        if len(READY) >= MOST_READY:
            del READY[next(iter(READY))]
        READY[name] = found, foreign
    return READY[name][0]


def _compiled(
    programs: Iterable[tuple[str, Program]],
) -> tuple[Compiled, dict[str, Program]]:
    """Return programs by name, compiled and as they are."""
    compiling, texts = dict[str, Future](), dict[str, Program]()
    quick = compiler_options()
    with ThreadPoolExecutor() as threads:  # XLA does not hold Python's lock
        for stage, program in programs:
            texts[stage] = program
            compiling[stage] = threads.submit(compiled, program, quick)
    return {stage: future.result() for stage, future in compiling.items()}, texts


def traced(function: Callable[..., Any], *arguments: Any) -> tuple[Program, Any]:
    """Return the program for arguments of these kinds, and the kinds of its result."""
    leaves, taken = jax.tree.flatten(arguments)
    result: Any = None

    def of_leaves(*values: Any) -> list[Any]:
        nonlocal result
        returned, result = jax.tree.flatten(function(*taken.unflatten(values)))
        return returned

    kinds = [shaped(jax.typeof(leaf)) for leaf in leaves]
    exported = jax.export.export(jax.jit(of_leaves))(*kinds)
    numbers = result.unflatten(range(result.num_leaves))
    found = result.unflatten(map(shaped, exported.out_avals))
    return Program(bytes(exported.serialize()), numbers), found


def compiled(program: Program, quick: dict[str, Any]) -> Callable[..., Any]:
    """Return the program as XLA compiles it with options, or as JAX's cache has it."""
    exported = jax.export.deserialize(bytearray(program.text))
    lowered = jax.jit(exported.call).lower(*exported.in_avals)
    run, result = lowered.compile(quick), jax.tree.structure(program.result)
    result.unflatten(exported.out_avals)  # ValueError if they are not as many
    return lambda *arguments: result.unflatten(run(*jax.tree.leaves(arguments)))


def digest(arguments: Any, *options: Any) -> str:
    """Return the name of the programs of these arguments and options, as `ready`."""
    leaves, _ = tree_flatten_with_path(arguments)
    kinds = [(keystr(path), jax.typeof(leaf)) for path, leaf in leaves]
    settings = sorted(jax.config.values.items())
    text = repr((options, kinds, settings, jax.default_backend(), *_code()))
    return hashlib.sha256(text.encode()).hexdigest()


def classes_of_others(options: Any) -> Iterator[type]:
    """Yield the classes of options, and of their fields, from outside of jradar."""
    if isinstance(options, (tuple, list)):
        parts = [*options]
    elif dataclasses.is_dataclass(options) and not isinstance(options, type):
        parts = [getattr(options, f.name, None) for f in dataclasses.fields(options)]
    else:
        parts = []
    for part in parts:
        yield from classes_of_others(part)
    room = type(options).__module__.partition(".")[0]
    if room not in ("builtins", "jradar", "jax", "jaxlib", "numpy", "flax"):
        yield type(options)


@functools.cache
def _code() -> tuple[Any, ...]:
    """Return the package's files with sizes and times, and the versions in use."""
    files = ((path, path.stat()) for path in sorted(PACKAGE.rglob("*.py")))
    versions = [module.__version__ for module in (jax, jaxlib, flax, np)]
    stats = [(str(path), stat.st_size, stat.st_mtime_ns) for path, stat in files]
    return stats, versions, sys.version


def unedited() -> bool:
    """Return whether all source files are those that were imported.

    A file's time of change cannot be set, as that of its content can.
    """
    try:
        files = (path.stat() for path in PACKAGE.rglob("*.py"))
        return all(stat.st_ctime < IMPORTED_S for stat in files)
    except OSError:  # a file that is gone
        return False


def load(name: str) -> dict[str, Program] | None:
    """Return the programs that were saved by this digest, None if there are none."""
    try:
        with open_file(_place(name), limit=MOST_BYTES) as file:
            unpacking = zlib.decompressobj()
            found: Any = msgpack_restore(unpacking.decompress(file.read(), MOST_BYTES))
        return {
            stage: Program(text, built(json.loads(parts)))
            for stage, (text, parts) in found.items()
        }
    except Exception:  # no folder, no file, or one that was cut short
        return None


def save(name: str, found: dict[str, Program]) -> None:
    """Keep programs for the next process, if JAX has a folder for its cache."""
    content = msgpack_serialize(
        {
            stage: [program.text, json.dumps(described(program.result))]
            for stage, program in found.items()
        }
    )
    try:
        path = _place(name)
        with contextlib.suppress(OSError):
            path.rmdir()  # an empty folder of this name
        with atomic_path(path) as scratch:
            scratch.write_bytes(zlib.compress(content, 1))
        files = filter(Path.is_file, path.parent.glob("*" + SUFFIX))
        for old in sorted(files, key=lambda file: -file.stat().st_mtime)[MOST_FILES:]:
            old.unlink()
    except (OSError, UsageError):  # a full disk, or a folder: the next traces again
        return


def described(result: Any) -> Any:
    """Return the structure of a result as lists: the name of a record, and its parts.

    Raises TypeError for a record that is not in RECORDS.
    """
    if result is None or isinstance(result, int):
        return result
    if (name := type(result).__name__) not in (*RECORDS, "tuple"):
        raise TypeError(f"a program returns {name}, expected one of {[*RECORDS]}")
    return [name, *map(described, result)]


def built(parts: Any) -> Any:
    """Return the result that `described` described."""
    if not isinstance(parts, list):
        return parts
    name, *inside = parts
    inside = tuple(map(built, inside))
    return inside if name == "tuple" else RECORDS[name](*inside)


def _place(name: str) -> Path:
    """Return the file of a digest; FileNotFoundError without a cache."""
    folder = jax.config.values["jax_compilation_cache_dir"]
    if not folder or os.environ.get("JRADAR_CACHE") == "off":
        raise FileNotFoundError("no cache of programs")
    return Path(folder) / (name + SUFFIX)


def shaped(value: Any) -> jax.ShapeDtypeStruct:
    """Return a placeholder of an array."""
    return jax.ShapeDtypeStruct(value.shape, value.dtype)
