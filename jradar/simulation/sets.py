"""Named sets of simulated sequences, split so that no layout is in two splits.

`jradar-sim` is to train on and `jradar-sim-test` to test on, both with a frame of each
of many layouts, which differ more than the frames of one; `jradar-sim-mini` is one
layout for each split, to try things out.

A set's folder holds ColoRadar's layout, `splits.json`, which preparation reads, and
`manifest.json`: splits, seeds, and a digest of every sequence. Sets are made anew by
anyone, and a copy is checked by its digests. Samples are sums in float32, whose order
differs between kinds of processors: made on another kind, some may differ by one count,
and the digests tell so.
"""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jradar import __version__
from jradar.files import write_text
from jradar.simulation.layouts import FAMILIES
from jradar.simulation.sequence import simulate_sequence

MANIFEST = "manifest.json"
SPLIT_SEEDS = {
    "jradar-sim": {
        "train": (*range(96), *range(1000, 1288)),
        "validation": (100, 101, 102, 103),
        "test": (200, 201, 202, 203),
    },
    "jradar-sim-test": {
        "validation": tuple(range(100, 116)),
        "test": tuple(range(200, 392)),
    },
    "jradar-sim-mini": {"train": (0,), "validation": (100,), "test": (200,)},
}
SETS: dict[str, dict[str, tuple[tuple[str, int], ...]]] = {
    name: {
        split: tuple((family, seed) for family in FAMILIES for seed in seeds)
        for split, seeds in splits.items()
    }
    for name, splits in SPLIT_SEEDS.items()
}
FRAMES = 1  # of each sequence, unless told otherwise


def set_sequences(name: str) -> list[tuple[str, str, int]]:
    """(split, family, seed) of every sequence; ValueError for an unknown set."""
    if name not in SETS:
        raise ValueError(f"set {name!r}, expected one of {', '.join(SETS)}")
    return [(split, *pair) for split, pairs in SETS[name].items() for pair in pairs]


def simulate_set(
    name: str,
    root: Path | str,
    *,
    frames: int = FRAMES,
    sensor: str = "single_chip",
    advance: Callable[[], None] = lambda: None,
) -> Path:
    """Write a set and its manifest to `root`; returns the manifest's path.

    Sequences that are there and as the manifest says are kept, so that a run that was
    interrupted goes on. Raises ValueError where `root` holds another set.
    """
    root, wanted = Path(root), set_sequences(name)
    path = root / MANIFEST
    made = {"set": name, "frames": frames, "sensor": sensor, "jradar": __version__}
    manifest: dict[str, Any] = {**made, "sequences": {}}
    if path.exists():
        manifest = read_manifest(root)
        found = {key: manifest.get(key) for key in made}
        if found != made:
            raise ValueError(f"{path} is of {found}, asked for {made}: another folder?")
    splits = {f"{family}_{seed}": split for split, family, seed in wanted}
    write_text(root / "splits.json", json.dumps(splits, indent=2) + "\n")
    for split, family, seed in wanted:
        sequence = f"{family}_{seed}"
        entry = manifest["sequences"].get(sequence)
        if entry and entry["sha256"] == folder_digest(root / sequence):
            for _ in range(frames):
                advance()
            continue
        folder = simulate_sequence(
            family, seed, root, frames=frames, sensor=sensor, advance=advance
        )
        digest = folder_digest(folder)
        manifest["sequences"][sequence] = {"split": split, "sha256": digest}
        manifest["calib_sha256"] = folder_digest(root / "calib")
        write_text(path, json.dumps(manifest, indent=2) + "\n")
    return path


def check_set(root: Path | str) -> list[str]:
    """Names of the sequences in `root` that are not as its manifest says."""
    manifest = read_manifest(root)
    expected = {name: entry["sha256"] for name, entry in manifest["sequences"].items()}
    expected["calib"] = manifest["calib_sha256"]
    return [
        n for n, digest in expected.items() if folder_digest(Path(root) / n) != digest
    ]


def read_manifest(root: Path | str) -> dict[str, Any]:
    """The manifest of a set's folder; ValueError where it is none."""
    path = Path(root) / MANIFEST
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        entries = manifest["sequences"].values()
        if not all({"split", "sha256"} <= set(entry) for entry in entries):
            raise KeyError("split, sha256")
    except (json.JSONDecodeError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(
            f"{path} is no manifest of a simulated set: {error}"
        ) from error
    return manifest


def folder_digest(folder: Path | str) -> str:
    """SHA-256 over the names and contents of a folder's files, in order of names."""
    folder, total = Path(folder), hashlib.sha256()
    names = sorted(
        p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()
    )
    for name in names:
        with open(folder / name, "rb") as file:
            content = hashlib.file_digest(file, "sha256").hexdigest()
        total.update(f"{name} {content}\n".encode())
    return total.hexdigest()
