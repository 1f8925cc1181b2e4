"""Named data sets of simulated sequences, whose splits share no layout.

    jradar-sim-1        to train on
    jradar-sim-1-test   to test on
    jradar-sim-1-mini   one layout of each family for each split, to try things out

A set has a frame of each of many layouts, because layouts differ more than the frames
of one. The number in the name is the version: it changes whenever the data do.

The folder of a set holds ColoRadar's layout, `splits.json` for preparation, and
`manifest.json` with the splits and a digest of every sequence. Samples are float32
sums, whose order depends on the kind of processor: on another kind some samples can
differ by one count, and the digests then differ.
"""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jradar import __version__
from jradar.errors import UsageError, parsing
from jradar.files import read_json, write_text
from jradar.simulation.layouts import FAMILIES
from jradar.simulation.sequence import simulate_sequence

SETS: dict[str, dict[str, tuple[int, ...]]] = {  # seeds of each split
    "jradar-sim-1": {
        "train": (*range(96), *range(1000, 1288)),
        "validation": (100, 101, 102, 103),
        "test": (200, 201, 202, 203),
    },
    "jradar-sim-1-test": {
        "validation": tuple(range(100, 116)),
        "test": tuple(range(200, 392)),
    },
    "jradar-sim-1-mini": {"train": (0,), "validation": (100,), "test": (200,)},
}
FRAMES = 1  # of each sequence, by default


def set_sequences(name: str) -> list[tuple[str, str, int]]:
    """Return (split, family, seed) of every sequence of a set."""
    if name not in SETS:
        raise UsageError(f"set {name!r}, expected one of {', '.join(SETS)}")
    return [
        (split, family, seed)
        for split, seeds in SETS[name].items()
        for family in FAMILIES
        for seed in seeds
    ]


def simulate_set(
    name: str,
    root: Path | str,
    *,
    frames: int = FRAMES,
    sensor: str = "single_chip",
    advance: Callable[[], None] = lambda: None,
) -> Path:
    """Write a set and its manifest to `root`; return the manifest's path.

    Sequences that match the manifest are kept: an interrupted run resumes. Raises
    UsageError if `root` holds another set or anything else.
    """
    root, wanted = Path(root), set_sequences(name)
    path = root / "manifest.json"
    made = {"set": name, "frames": frames, "sensor": sensor, "jradar": __version__}
    manifest: dict[str, Any] = {**made, "sequences": {}}
    if path.exists():
        manifest = _read_manifest(path)
        found = {key: manifest.get(key) for key in made}
        if found != made:
            raise UsageError(
                f"{path} describes {found}, expected {made}: choose another folder"
            )
    elif names := sorted(p.name for p in root.glob("[!.]*")):
        raise UsageError(
            f"{root} holds {names[0]} but no manifest of a set: choose another folder"
        )
    write_text(path, json.dumps(manifest, indent=2) + "\n")
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


def _read_manifest(path):
    """Return the manifest of a set; ValueError if the file is not one."""
    manifest = read_json(path)
    with parsing(path, "the manifest of a simulated set"):
        for entry in manifest["sequences"].values():
            _ = entry["split"], entry["sha256"]
    return manifest


def folder_digest(folder: Path | str) -> str:
    """Return the SHA-256 of the names and contents of a folder's files."""
    folder, total = Path(folder), hashlib.sha256()
    names = sorted(
        p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()
    )
    for name in names:
        with open(folder / name, "rb") as file:
            content = hashlib.file_digest(file, "sha256").hexdigest()
        total.update(f"{name} {content}\n".encode())
    return total.hexdigest()
