"""Named data sets of simulated sequences, whose splits share no layout.

    jradar-sim-1 ..           those of `options.scenes.SETS`, to train on and to test on
    jradar-sim-2-robust/NAME  test layouts under one named shift
    jradar-sim-4-robust/NAME  the same, of the shifts that were added later

A set has a frame of each of many layouts, because layouts differ more than the frames
of one. The number in the name is the version: it changes whenever the data do. No
board, interferer or clutter of a robustness set occurs in a training set, and neither
does the family of `jradar-sim-2-robust/unseen-scene`, nor the waveform of
`jradar-sim-4-robust/ti-indoor-waveform`.

The folder of a set holds ColoRadar's layout, `splits.json` for preparation, and
`manifest.json` with the splits and a digest of every sequence. Samples are float32
sums, whose order depends on the kind of processor: on another kind some samples can
differ by one count, and the digests then differ.
"""

import dataclasses
import hashlib
import json
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from jradar import __version__
from jradar.errors import UsageError, parsing
from jradar.files import read_json, write_text
from jradar.simulation.sequence import simulate_sequence
from jradar.simulation.units import (
    LATER_SHIFTS,
    SHIFTS,
    UnitSpec,
    draw_unit,
    shifted_unit,
)

Splits = dict[str, tuple[int, ...]]  # seeds of each split
FRAMES = 1  # of each sequence, by default
SIX = ("hallways", "mine", "lab", "outdoor", "corridor", "hall")
SEEN = (*SIX, "home")
EIGHT = (*SEEN, "forest")
UNSEEN = "warehouse"
TEST: Splits = {"validation": tuple(range(100, 116)), "test": tuple(range(200, 392))}
MINI: Splits = {"train": (0,), "validation": (100,), "test": (200,)}
ROBUST: Splits = {"test": tuple(range(200, 204))}


def _splits(train: int, validation: int) -> Splits:
    """Return so many seeds of each split; those of training begin at 0 and at 1000."""
    return {
        "train": (*range(96), *range(1000, 904 + train)),
        "validation": tuple(range(100, 100 + validation)),
        **ROBUST,
    }


class SetSpec(NamedTuple):
    """Layouts of a set, and the radar unit of each; None is the rig's own."""

    splits: Splits
    families: tuple[str, ...] = SIX
    unit: Callable[[str, int], UnitSpec | None] = lambda family, seed: None


class Sequence(NamedTuple):
    """A sequence of a set."""

    split: str
    family: str
    seed: int
    unit: UnitSpec | None = None


def _own_unit(family: str, seed: int) -> UnitSpec:
    return draw_unit(zlib.crc32(f"{family}_{seed}".encode()))


def _wide_unit(family: str, seed: int) -> UnitSpec:
    return draw_unit(zlib.crc32(f"{family}_{seed}".encode()), population=2)


def _coloradar_unit(family: str, seed: int) -> UnitSpec:
    return dataclasses.replace(_wide_unit(family, seed), waveform=None)


def _robust(shift: str) -> SetSpec:
    families = (UNSEEN,) if shift == "unseen-scene" else SIX
    return SetSpec(ROBUST, families, lambda family, seed: shifted_unit(shift))


def robust_set(shift: str) -> str:
    """Return the name of the set that holds a shift."""
    return f"jradar-sim-{2 if shift in SHIFTS else 4}-robust/{shift}"


ROBUSTNESS = {robust_set(shift): _robust(shift) for shift in (*SHIFTS, *LATER_SHIFTS)}
SETS = {
    "jradar-sim-1": SetSpec(_splits(384, 4)),
    "jradar-sim-1-test": SetSpec(TEST),
    "jradar-sim-1-mini": SetSpec(MINI),
    "jradar-sim-2": SetSpec(_splits(192, 6), SEEN, _own_unit),
    "jradar-sim-2-mini": SetSpec(MINI, SEEN, _own_unit),
    "jradar-sim-3": SetSpec(_splits(384, 6), SEEN, _own_unit),
    "jradar-sim-4": SetSpec(_splits(384, 8), EIGHT, _wide_unit),
    "jradar-sim-4-mini": SetSpec(MINI, EIGHT, _wide_unit),
    "jradar-sim-4-test": SetSpec(TEST, SIX, _coloradar_unit),
}


def set_sequences(name: str) -> list[Sequence]:
    """Return the sequences of a set."""
    if (found := (SETS | ROBUSTNESS).get(name)) is None:
        shifts, later = ", ".join(SHIFTS), ", ".join(LATER_SHIFTS)
        raise UsageError(
            f"set {name!r}, expected one of {', '.join(SETS)}, or "
            f"jradar-sim-2-robust/SHIFT with a shift of {shifts}, or "
            f"jradar-sim-4-robust/SHIFT with a shift of {later}"
        )
    return [
        Sequence(split, family, seed, found.unit(family, seed))
        for split, seeds in found.splits.items()
        for family in found.families
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
    splits = {f"{item.family}_{item.seed}": item.split for item in wanted}
    write_text(root / "splits.json", json.dumps(splits, indent=2) + "\n")
    for split, family, seed, unit in wanted:
        sequence = f"{family}_{seed}"
        entry = manifest["sequences"].get(sequence)
        if entry and entry["sha256"] == folder_digest(root / sequence):
            for _ in range(frames):
                advance()
            continue
        folder = simulate_sequence(
            family, seed, root, frames=frames, sensor=sensor, unit=unit, advance=advance
        )
        digest = folder_digest(folder)
        manifest["sequences"][sequence] = {"split": split, "sha256": digest}
        if unit is None:
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
