"""A radar's TOML file: how its samples are stored, and its calibration.

    [radar]                             fields of RadarSpec, or a device and changes
    device = "awr1843"

    [file]                              all optional
    axes = ["frame", "chirp", "tx", "rx", "sample"]       of a cube.npy
    iq_order = "IIQQ"                   of an adc_data.bin, see `iq_order`
    lanes = 4                           enabled, of which a card took two, see `lanes`;
                                        of an adc_data.bin, described as configured

    [calibration]                       all optional, as `jradar calibrate` writes it
    range_bias_m = 0.066                subtracted from measured ranges
    gain_db = [0.0, 0.1, ..]            by which samples are multiplied: one number for
    phase_degrees = [0.0, -2.5, ..]     each tx and rx, the receivers of tx 0 first

    [mount]                             optional, of `jradar calibrate --mount`
    xyz = [0.03, 0.12, -0.09]           position on the base of the rig
    quaternion = [0.0, 0.0, 0.0, 1.0]   rotation from the radar to the base, x y z w

Without gains and phases, samples are multiplied by the signs of the board's receivers.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # loads `spatial` when it is first used
from jaxtyping import Float

import jradar
from jradar.errors import UsageError, printable
from jradar.files import write_text
from jradar.options.boards import BOARDS
from jradar.options.recordings import IQ_ORDERS
from jradar.options.sensor import RadarSpec
from jradar.recordings.text_files import check_names, radar_of, toml
from jradar.recordings.ti.frame import CaptureSpec
from jradar.recordings.ti.lanes import whole

FILE_KEYS = ("axes", "iq_order", "lanes")
LANES = (0, 1, 2, 4)
MOUNT = ("xyz", "quaternion")
CALIBRATION_KEYS = ("range_bias_m", "gain_db", "phase_degrees")
LARGEST = {"gain_db": 60.0, "phase_degrees": 720.0}  # beyond, another unit


def read_radar_toml(path: Path | str) -> tuple[RadarSpec, CaptureSpec]:
    """Return the radar of a TOML file, its samples' order and its calibration.

    Raises UsageError for unknown keys and for values that do not fit the radar.
    """
    return radar_of_tables(path, toml(path))


def radar_of_tables(
    path: Path | str, tables: dict[str, Any]
) -> tuple[RadarSpec, CaptureSpec]:
    """Return what `read_radar_toml` does of the tables; `path` is named in errors."""
    values = _table(path, tables, "radar")
    stored = _table(path, tables, "file", FILE_KEYS)
    measured = _table(path, tables, "calibration", CALIBRATION_KEYS)
    try:
        radar = radar_of(path, values)
    except ValueError as error:
        raise UsageError(str(error)) from error
    if (order := stored.get("iq_order", CaptureSpec.iq_order)) not in IQ_ORDERS:
        raise UsageError(
            f"{path}: iq_order = {order!r:.40}, expected one of {', '.join(IQ_ORDERS)}"
        )
    lanes = stored.get("lanes", CaptureSpec.lanes)
    if type(lanes) is not int or lanes not in LANES:
        raise UsageError(
            f"{path}: lanes = {lanes!r:.40}, expected 1, 2 or 4 LVDS lanes, or 0 if "
            "they are unknown"
        )
    board = BOARDS.get(values.get("device", ""))
    factors: tuple[complex, ...] = ()
    if "gain_db" in measured or "phase_degrees" in measured:
        gain_db, degrees = (_each(path, measured, key, radar) for key in LARGEST)
        factors = tuple(
            (10 ** (gain_db / 20) * np.exp(1j * np.radians(degrees))).tolist()
        )
    elif board is not None and board.rx_positions == radar.rx_positions:
        factors = tuple(complex(sign) for sign in board.rx_signs) * radar.num_tx
    place = _table(path, tables, "mount", MOUNT)
    numbers = [*place.get("xyz", [0.0] * 3), *place.get("quaternion", [0.0] * 3 + [1])]
    good = len(numbers) == 7 and all(type(n) in (int, float) for n in numbers)
    if not good or not 0.99 < sum(n * n for n in numbers[3:]) < 1.01:
        raise UsageError(
            f"{path}: [mount] {place!r:.80}, expected xyz and quaternion, 3 and 4 "
            "numbers, the quaternion x y z w of length 1"
        )
    bias = measured.get("range_bias_m", 0.0)
    if type(bias) not in (int, float) or not abs(bias) < radar.max_range_m:
        raise UsageError(
            f"{path}: range_bias_m = {bias!r:.40}, expected metres, within the radar's "
            f"{radar.max_range_m:.2f} m"
        )
    return radar, CaptureSpec(
        iq_order=order,
        range_bias_m=float(bias),
        channel_factors=factors,
        mount=tuple(map(float, numbers)) if place else (),
        lanes=lanes,
    )


def write_radar_toml(
    path: Path | str,
    radar: "jradar.Radar",
    *,
    iq_order: str = CaptureSpec.iq_order,
    lanes: int = 0,
    axes: Sequence[str] = (),
    mount: Float[np.ndarray, "4 4"] | None = None,
    comment: str = "",
) -> None:
    """Write `radar_toml` to a file; `comment` is put at the top."""
    lines = [f"# {printable(line)}" for line in comment.splitlines()]
    text = radar_toml(radar, iq_order=iq_order, lanes=lanes, axes=axes, mount=mount)
    write_text(path, "\n".join([*lines, "", text]).lstrip())


def radar_toml(
    radar: "jradar.Radar",
    *,
    iq_order: str = CaptureSpec.iq_order,
    lanes: int = 0,
    axes: Sequence[str] = (),
    mount: Float[np.ndarray, "4 4"] | None = None,
) -> str:
    """Return what `read_radar_toml` reads: a radar, its channels and its range bias.

    `mount` is base_from_radar, if it was measured. The samples have the `axes` of a
    cube, or else an `iq_order`. `lanes` are those of a `Recording`: the radar is then
    described as it was configured, with the samples that were lost.
    """
    stored: dict[str, Any] = {"axes": [*axes]} if axes else {"iq_order": iq_order}
    spec = radar.spec
    if lanes:
        stored["lanes"], spec = lanes, whole(spec)
    measured: dict[str, Any] = {"range_bias_m": float(radar.range_bias_m)}
    if radar.channels is not None:
        factors = np.asarray(radar.channels).ravel()
        measured["gain_db"] = (20 * np.log10(abs(factors))).round(4).tolist()
        measured["phase_degrees"] = np.degrees(np.angle(factors)).round(3).tolist()
    tables = {"radar": asdict(spec), "file": stored, "calibration": measured}
    if mount is not None:
        quaternion = scipy.spatial.transform.Rotation.from_matrix(
            mount[:3, :3]
        ).as_quat()
        tables["mount"] = {
            "xyz": mount[:3, 3].round(6).tolist(),
            "quaternion": quaternion.round(9).tolist(),
        }
    lines = []
    for name, table in tables.items():
        lines += [f"\n[{name}]", *(f"{k} = {_as_toml(v)}" for k, v in table.items())]
    return "\n".join(lines).lstrip() + "\n"


def _as_toml(value: Any) -> str:
    """Return a value as TOML: as JSON, but for texts with DEL, or outside Unicode."""
    text = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return text.encode("utf-8", "replace").decode()


def _table(path, tables, name: str, keys=None) -> dict[str, Any]:
    """Return a table, empty if it is missing; UsageError for keys not in `keys`."""
    table = tables.get(name, {})
    if not isinstance(table, dict):
        raise UsageError(f"{path}: {name} = {table!r:.80}, expected a table [{name}]")
    if keys is not None:
        check_names(path, f"key of [{name}]", table, keys)
    return table


def _each(path, table, key: str, radar: RadarSpec) -> np.ndarray:
    """Return a number for each virtual antenna; zeros if the key is missing."""
    values = table.get(key, [0.0] * radar.num_virtual)
    plain = isinstance(values, list) and len(values) == radar.num_virtual
    if not plain or not all(
        type(value) in (int, float) and abs(value) <= LARGEST[key] for value in values
    ):
        raise UsageError(
            f"{path}: {key} = {values!r:.80}, expected {radar.num_virtual} numbers of "
            f"at most {LARGEST[key]:g}, one for each of {radar.num_tx} tx x "
            f"{radar.num_rx} rx"
        )
    return np.array(values, float)
