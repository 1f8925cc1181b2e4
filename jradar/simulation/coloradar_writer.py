"""Files of ColoRadar's layout (Kramer et al. 2022): the calib folder and the streams.

    calib/transforms/base_to_X.txt          calib/single_chip/..   calib/cascade/..
    SEQUENCE/single_chip/adc_samples/       timestamps.txt  data/frame_N.bin
    SEQUENCE/lidar/                         timestamps.txt  pointclouds/lidar_..N.bin
    SEQUENCE/groundtruth/  imu/             timestamps.txt  and one text file

ColoRadar's heat maps and point clouds are left out: they follow from the samples.
"""

import json
from pathlib import Path

import numpy as np
from jaxtyping import Complex, Float

from jradar.files import atomic_folder
from jradar.radar import RadarSpec
from jradar.recordings.coloradar.calib import FIELDS
from jradar.simulation.hardware.hardware import Hardware, channel_factors
from jradar.simulation.rig import EXTRINSICS, described_mount
from jradar.simulation.units import UnitSpec

WAVEFORM = {"num_rx": "num_rx", "num_tx": "num_tx", **FIELDS}  # keys and fields
IN_CALIB = ("single_chip", "cascade", "lidar", "imu")
NOTE = "simulated.txt"
CALIBRATED_AT_BIN = 100.0  # of the phase calibration's target


def write_calib(
    folder: Path,
    radars: dict[str, tuple[RadarSpec, Hardware]],
    unit: UnitSpec | None = None,
) -> None:
    """Write the `calib` folder of a rig with these radars, in one step.

    With a `unit`, the mount of the single chip is described with its error, and its
    coupling may be missing. Raises UsageError instead of replacing a `calib` that was
    not simulated.
    """
    unit = unit or UnitSpec()
    with atomic_folder(folder, marker=NOTE) as scratch:
        transforms = scratch / "transforms"
        transforms.mkdir()
        write_note(scratch)
        for sensor in IN_CALIB:
            place = EXTRINSICS[sensor]
            if sensor == "single_chip" and unit.mount_degrees:
                place = described_mount(sensor, unit)
            lines = (" ".join(map(repr, row)) for row in place)
            (transforms / f"base_to_{sensor}.txt").write_text("\n".join(lines) + "\n")
        for sensor, (radar, hardware) in radars.items():
            (scratch / sensor).mkdir()
            _write_radar(scratch / sensor, radar, hardware)
            if unit.coupling_file:
                _write_coupling(scratch / sensor, radar, hardware)


def write_note(folder: Path) -> None:
    """Write the note by which a simulated folder is recognised."""
    (folder / NOTE).write_text("Written by `jradar simulate`.\n")


def write_stamps(folder: Path, stamps: Float[np.ndarray, " item"]) -> None:
    """Write `timestamps.txt`: seconds since 1970, to the microsecond."""
    folder.mkdir(parents=True, exist_ok=True)
    text = "".join(f"{stamp:.6f}\n" for stamp in stamps)
    (folder / "timestamps.txt").write_text(text)


def write_rows(path: Path, rows: Float[np.ndarray, "item column"]) -> None:
    """Write a text file with one record on each line."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(" ".join(f"{v:.9g}" for v in row) + "\n" for row in rows))


def _write_radar(folder: Path, radar: RadarSpec, hardware: Hardware) -> None:
    waveform = (f"{key} {getattr(radar, field)!r}" for key, field in WAVEFORM.items())
    (folder / "waveform_cfg.txt").write_text("\n".join(waveform) + "\n")
    antennas = [
        f"num_rx {radar.num_rx}",
        f"num_tx {radar.num_tx}",
        f"F_design {radar.design_frequency_hz / 1e9!r}",
    ]
    for kind, places in (("rx", radar.rx_positions), ("tx", radar.tx_positions)):
        antennas += [f"{kind} {k} {a} {e}" for k, (a, e) in enumerate(places)]
    (folder / "antenna_cfg.txt").write_text("\n".join(antennas) + "\n")

    if hardware.calibration is None:
        return
    measured = hardware.calibration.ravel().view(float)
    calibration = {
        "numRx": radar.num_rx,
        "numTx": radar.num_tx,
        "frequencySlope": radar.slope_hz_per_s,
        "samplingRate": radar.sample_rate_hz,
        "frequencyCalibrationMatrix": [
            round(CALIBRATED_AT_BIN + f, 9) for f in hardware.frequency.ravel().tolist()
        ],
        "phaseCalibrationMatrix": measured.round(9).tolist(),
    }
    path = folder / "phase_frequency_calib.txt"
    path.write_text(json.dumps({"antennaCalib": calibration}))


def _write_coupling(folder: Path, radar: RadarSpec, hardware: Hardware) -> None:
    """Write the leakage, which ColoRadar subtracts from calibrated samples."""
    numbers = coupling(radar, hardware).ravel().view(float)
    (folder / "coupling_calib.txt").write_text(
        f"num_tx:{radar.num_tx}\nnum_rx:{radar.num_rx}\n"
        f"num_range_bins:{radar.num_samples // 2}\n"
        f"num_doppler_bins:{radar.num_chirps}\n"
        "data:" + ",".join(f"{number:.6g}" for number in numbers) + "\n"
    )


def coupling(
    radar: RadarSpec, hardware: Hardware
) -> Complex[np.ndarray, "tx rx half_range"]:
    """Return the leakage that calibrated samples have, as the file holds it."""
    half = radar.num_samples // 2
    phase = 2 * np.pi * np.arange(radar.num_samples) / radar.num_samples
    blackman = 0.42 - 0.5 * np.cos(phase) + 0.08 * np.cos(2 * phase)
    left = hardware
    if (measured := hardware.calibration) is not None:
        common = np.full_like(hardware.frequency, hardware.frequency[0, 0])
        exact = hardware.phase == measured  # division would round
        phase = np.where(exact, 1.0, hardware.phase / measured)
        left = hardware._replace(frequency=common, phase=phase)
    leakage = hardware.leakage * channel_factors(left, radar)
    leakage *= 10 ** (hardware.gain_db / 20)
    return np.fft.fft(leakage * blackman)[..., 1 : half + 1]
