r"""Measure `jradar calibrate` on boards whose errors are known.

    python -m experiments.studies.calibration -o runs/calibration --model jradar-sim

For each uncalibrated board of the robustness set there are five calibrations:

    none         as recorded
    walk         from the echoes of a walk through a room of its own
    level        the same, and the tilt from the motion of that walk (`--level`)
    reflector    the echoes of the walk; then tilt and range bias from a corner
                 reflector in front of the standing radar
    true         the channels of the simulator

The phase error is the rms over the virtual antennas, once with and once without its
linear part, which no echo of an unknown direction shows. The tilt is the elevation that
this part adds. Each calibration is applied to the board's recordings of the set, and
the model is scored on them; the truth is always the LiDAR's part that the truly
calibrated radar could have seen.

`--samples` names a folder of real captures, as `realism` takes it. Their channels are
not known: the table has the residuals of echoes that were left out of the fit.
"""

import dataclasses
import sys
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex

from experiments.build import prepare_spec
from experiments.command import run_study, study_parser
from experiments.configs import varied
from experiments.studies.realism_captures import real_captures
from experiments.studies.robustness import simulated_shift
from experiments.studies.variants import (
    Scores,
    score_cells,
    score_recordings,
    truths_of,
    with_excision,
)
from experiments.tables import markdown_table
from jradar import data
from jradar.calibration import (
    SelfCalibration,
    level_tilt,
    self_calibrate,
    strong_snapshots,
    untilted,
)
from jradar.calibration.self_calibration import linear_phases
from jradar.files import write_text
from jradar.model import Model, load_model
from jradar.radar import PointSpec, RadarSpec, calibrate_channels, radar_points
from jradar.recordings import CaptureSpec, open_recording, write_radar_toml
from jradar.simulation import UnitSpec, make_setting, shifted_unit
from jradar.simulation.hardware.hardware import sample_frame
from jradar.simulation.paths.link import LINK
from jradar.simulation.paths.propagation import Paths, radar_paths
from jradar.simulation.sequence import radar_frames, stream_stamps

BOARDS = ("board-a", "board-b", "twice-the-channel-errors")
ROOM = ("lab", 900)  # of the walk and of the reflector: in no set
CORNER_M, CORNER_M2 = 3.0, 10.0  # range and radar cross-section
STANDING_FRAMES = 5


class Calibration(NamedTuple):
    """Factors of the virtual antennas, and the bias of their ranges."""

    factors: Complex[np.ndarray, " virtual"]
    range_bias_m: float


class PhaseError(NamedTuple):
    """What is left of the channels' phases, in degrees."""

    total: float  # rms
    curved: float  # rms without the linear part
    tilt: float  # the elevation that the linear part adds


def main(argv: list[str] | None = None) -> int:
    """Run the study and return the exit code."""
    parser = study_parser("calibration", __doc__)
    parser.add_argument("--model", default="jradar-sim", help="to score")
    parser.add_argument("--board", action="append", choices=BOARDS, help="only this")
    text = "of the walk, 10 a second (default 100)"
    parser.add_argument("--frames", type=int, default=100, help=text)
    parser.add_argument("--samples", type=Path, help="folder of real captures")
    return run_study(study, parser, argv)


def study(options: Namespace) -> None:
    """Calibrate, simulate, score, and write the tables."""
    model = with_excision(load_model(options.model), True)
    rows, scores = [], {}
    boards = options.board or BOARDS
    for board in boards:
        unit = shifted_unit(board)
        folder = options.output / "data" / board
        found = calibrations(unit, frames=options.frames)
        scores[board] = scored(model, found, board, folder)
        cells = cells_of(scores[board])
        rows += [
            [board, name, *_errors(unit, calibration), *cells[name]]
            for name, calibration in found.items()
        ]
    titles = [
        *("board", "calibration", "phase error (deg)", "without linear part (deg)"),
        *("tilt (deg)", "range bias left (m)", "Chamfer (m)", "F-score (%)"),
        "F-score, gain on none (points)",
    ]
    if len(boards) > 1:
        everything = {
            name: np.concatenate([of_board[name] for of_board in scores.values()])
            for name in scores[boards[0]]
        }
        rows += [
            ["**all**", name, *[""] * 4, *cells]
            for name, cells in cells_of(everything).items()
        ]
    text = markdown_table(titles, rows)
    if options.samples:
        text += "\n" + markdown_table(*captures_table(options.samples))
    write_text(options.output / "calibration.md", text)
    print(text)


def calibrations(unit: UnitSpec, *, frames: int) -> dict[str, Calibration]:
    """Return the calibrations of a unit by name."""
    setting = make_setting(*ROOM, unit=unit)
    ((radar, hardware),) = setting.radars.values()
    stamps = stream_stamps(setting, "single_chip", frames / 10)
    cubes = _cubes(radar_frames(setting, "single_chip", stamps))
    walked = _calibrated(cubes, radar)
    ones = np.ones(radar.num_virtual, np.complex64)
    walk = walked.factors if walked.improves else ones
    level = walk * untilted(_tilt(cubes, radar, walk), radar)
    corner = [calibrate_channels(cube, walk) for cube in _cubes(corner_frames(unit))]
    towards = _calibrated(corner, radar, (CORNER_M, 0.0, 0.0))
    return {
        "none": Calibration(ones, 0.0),
        "walk": Calibration(walk, 0.0),
        "level": Calibration(level, 0.0),
        "reflector": Calibration(walk * towards.factors, towards.range_bias_m or 0.0),
        "true": Calibration(1 / hardware.phase.ravel(), unit.range_bias_m),
    }


def _cubes(frames) -> list[jax.Array]:
    """Complex samples of frames of int16 pairs."""
    parts = (np.asarray(frame, np.float32) for frame in frames)
    return [jnp.asarray(part[..., 0] + 1j * part[..., 1]) for part in parts]


def _calibrated(cubes, radar, reflector=None) -> SelfCalibration:
    """The fit to the echoes of all cubes."""
    echoes = [strong_snapshots(cube, radar) for cube in cubes]
    stacked = jax.tree.map(lambda *columns: jnp.stack(columns), *echoes)
    return self_calibrate(stacked, radar, reflector=reflector)


def _tilt(cubes, radar, factors) -> float:
    """The tilt that the motion shows; the rig is level on its walk."""
    points = PointSpec(capacity=512).fitted(radar)
    clouds = [
        radar_points(calibrate_channels(cube, factors), radar, points=points)
        for cube in cubes
    ]
    stacked = jax.tree.map(lambda *columns: jnp.stack(columns), *clouds)
    return level_tilt(stacked, radar).sine


def corner_frames(unit: UnitSpec) -> Iterator:
    """Yield frames of the standing unit with a corner reflector at its boresight."""
    setting = make_setting(*ROOM, unit=dataclasses.replace(unit, speed_mps=0.0))
    ((radar, hardware),) = setting.radars.values()
    xyz, distance = np.array([[CORNER_M, 0.0, 0.0]]), np.array([CORNER_M])
    power = LINK.received_mw(radar, xyz, distance, np.array([CORNER_M2]))
    corner = Paths(xyz, xyz, np.zeros(1), power)
    for k, time_s in enumerate(
        stream_stamps(setting, "single_chip", STANDING_FRAMES / 10)
    ):
        room = radar_paths(
            setting.scene,
            setting.reflectors,
            "single_chip",
            float(time_s),
            radar,
            unit=setting.unit,
        )
        paths = Paths(*map(np.concatenate, zip(room, corner, strict=True)))
        yield sample_frame(jax.random.key(k), paths, hardware, radar)


def phase_error(
    factors: Complex[np.ndarray, " virtual"],
    channels: Complex[np.ndarray, " virtual"],
    radar: RadarSpec,
) -> PhaseError:
    """Return what the factors leave of the channels' phases."""
    left = factors * channels
    phase = np.angle(left / left.sum())
    basis = linear_phases(radar)
    curved = phase - basis @ (basis.T @ phase)
    row = radar.virtual_positions[:, 1]
    columns = np.column_stack([np.ones(len(row)), radar.virtual_positions])
    slope = np.linalg.lstsq(columns, phase, rcond=None)[0][2] if row.any() else 0.0
    sine = slope / (2 * np.pi * radar.row_spacing_wavelengths)
    rms = (float(np.degrees(np.sqrt((p**2).mean()))) for p in (phase, curved))
    return PhaseError(*rms, float(np.degrees(np.arcsin(np.clip(sine, -1, 1)))))


def _errors(unit: UnitSpec, calibration: Calibration) -> list[str]:
    """The cells of a calibration's errors."""
    setting = make_setting(*ROOM, unit=unit)
    ((radar, hardware),) = setting.radars.values()
    error = phase_error(calibration.factors, hardware.phase.ravel(), radar)
    bias = unit.range_bias_m - calibration.range_bias_m
    return [
        f"{error.total:.1f}",
        f"{error.curved:.1f}",
        f"{error.tilt:+.1f}",
        f"{bias:+.3f}",
    ]


def scored(
    model: Model, found: dict[str, Calibration], board: str, folder: Path
) -> dict[str, Scores]:
    """Return the scores of each frame of a board under each calibration."""
    recordings = simulated_shift(folder / "recordings", board)
    files = {name: folder / f"{name}.toml" for name in found}
    for name, (factors, range_bias_m) in found.items():
        capture = CaptureSpec(
            range_bias_m=float(range_bias_m),
            channel_factors=tuple(np.asarray(factors).tolist()),
        )
        write_radar_toml(files[name], shifted_unit(board).radar(), capture)
    records, spec = folder / "records", prepare_spec(varied.get_config())
    data.prepare(recordings, records, spec, workers=1, description=str(files["true"]))
    truths = truths_of(data.Records(records, "test"))
    sources = data.find_sources(recordings)
    return {
        name: score_recordings(
            model, (open_recording(source.path, file) for source in sources), truths
        )
        for name, file in files.items()
    }


def cells_of(scores: dict[str, Scores]) -> dict[str, list[str]]:
    """Return the cells of each calibration's scores, with the gain on "none"."""
    return {
        name: score_cells(found, None if name == "none" else scores["none"])
        for name, found in scores.items()
    }


def captures_table(samples: Path) -> tuple[list[str], list[list[str]]]:
    """Return titles and rows: residuals of real captures before and after."""
    rows = []
    for name, capture in real_captures(samples).items():
        cube = jnp.asarray(capture.cube, jnp.complex64)[None]
        echoes = jax.vmap(lambda c, r=capture.radar: strong_snapshots(c, r))(cube)
        found = self_calibrate(echoes, capture.radar)
        pairs = zip(found.before, found.after, strict=True)
        cells = [f"{before:.3g} / {after:.3g}" for before, after in pairs]
        rows.append(
            [name, str(found.echoes), *cells, "yes" if found.improves else "no"]
        )
    titles = [
        *("capture", "echoes", "phase of the best quarter (deg), before / after"),
        *("power not explained, before / after", "peak to mean, before / after"),
        "improves",
    ]
    return titles, rows


if __name__ == "__main__":
    sys.exit(main())
