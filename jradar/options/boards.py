"""Boards and recorded devices, each under one name.

A board has antennas and a band; its waveform is configured by a `.cfg` of TI's SDK,
by mmWave Studio, or by fields of a `RadarSpec`. A recorded device adds the waveform
and the order of transmitters of a public data set. The AWR1843 in ColoRadar has this
virtual array, in half wavelengths, seen from behind:

    elevation 1          t2 t2 t2 t2
    elevation 0    t0 t0 t0 t0 t1 t1 t1 t1      azimuth 0 .. 7

Sources: TI's user guides; ColoRadar (Kramer et al. 2022) and its converter; TI's
MMWCAS reference design for the cascade. ColoRadar does not document the cascade's
firing order: TI's default is assumed.
"""

import dataclasses
import difflib
from typing import Any

ROW_OF_RECEIVERS = ((0, 0), (1, 0), (2, 0), (3, 0))


@dataclasses.dataclass(frozen=True)
class Board:
    """Antennas and band of a single-chip board that TI's tools configure.

    Positions are (column, row), as in `RadarSpec`, in the order of the antennas' bits
    in a mask. `rx_signs` is -1 for receivers that are fed from the opposite side, whose
    signal is therefore inverted. `studio_chip` is the chip's name in logs of mmWave
    Studio.
    """

    tx_positions: tuple[tuple[int, int], ...]
    rx_positions: tuple[tuple[int, int], ...] = ROW_OF_RECEIVERS
    band_hz: tuple[float, float] = (76e9, 81e9)
    design_frequency_hz: float = 76.8e9
    studio_chip: str = ""
    rx_signs: tuple[int, ...] = (1, 1, 1, 1)
    row_spacing: float = 1.0
    real_samples: bool = False


ELEVATED_SECOND = ((0, 0), (2, 1), (4, 0))
BAND_60_GHZ: dict[str, Any] = {"band_hz": (60e9, 64e9), "design_frequency_hz": 62e9}

# The boards of the 6843 and the 2944 follow `antGeometry0`, `antGeometry1`,
# `antPhaseRot` and `antGeometryCfg` in TI's configurations for them. The design
# frequency of the 6843's boards is taken from TI's IWR6843L board, that of the 2944 is
# assumed.
BOARDS = {
    "awr1443": Board(ELEVATED_SECOND),
    "awr1642": Board(((0, 0), (4, 0)), studio_chip="AR1642"),
    "awr1843": Board(ELEVATED_SECOND, studio_chip="AR1843"),
    "awr2944": Board(
        ((0, 0), (2, 1), (4, 0), (8, 0)), row_spacing=1.6, real_samples=True
    ),
    "iwr6843isk": Board(ELEVATED_SECOND, **BAND_60_GHZ),
    "iwr6843ods": Board(
        ((0, 0), (2, 0), (2, -2)),
        ((0, 0), (0, -1), (1, -1), (1, 0)),
        rx_signs=(1, -1, -1, 1),
        **BAND_60_GHZ,
    ),
    "iwr6843aop": Board(
        ((0, 0), (2, -2), (0, -2)),
        ((1, -1), (1, 0), (0, -1), (0, 0)),
        rx_signs=(1, -1, 1, -1),
        **BAND_60_GHZ,
    ),
}

SINGLE_CHIP: dict[str, Any] = {
    "start_frequency_hz": 77e9,
    "slope_hz_per_s": 100e12,
    "sample_rate_hz": 10.666e6,
    "num_samples": 128,
    "num_chirps": 128,
    "idle_time_s": 110e-6,
    "adc_start_time_s": 7e-6,
    "ramp_end_time_s": 20e-6,
}

CASCADE: dict[str, Any] = {
    "start_frequency_hz": 77e9,
    "slope_hz_per_s": 79e12,
    "sample_rate_hz": 8e6,
    "num_samples": 256,
    "num_chirps": 16,
    "idle_time_s": 5e-6,
    "adc_start_time_s": 5e-6,
    "ramp_end_time_s": 40e-6,
    "tx_positions": (
        *((0, 0), (4, 0), (8, 0)),
        *((9, 1), (10, 4), (11, 6)),
        *((12, 0), (16, 0), (20, 0), (24, 0), (28, 0), (32, 0)),
    ),
    "rx_positions": tuple((a + k, 0) for a in (0, 11, 46, 50) for k in range(4)),
    "design_frequency_hz": 76.8e9,
    "tx_firing_order": (0, 1, 2, 6, 7, 8, 9, 10, 11, 3, 4, 5),
}

RECORDED: dict[str, dict[str, Any]] = {
    "awr1642": SINGLE_CHIP,
    "awr1843": SINGLE_CHIP | {"tx_positions": ((0, 0), (4, 0), (2, 1))},
    "cascade": CASCADE,
}


def device_fields(name: str) -> dict[str, Any]:
    """Return what is fixed in the `RadarSpec` of a device; ValueError if it is unknown.

    A board that no data set was recorded with has antennas but no waveform.
    """
    if name not in (names := BOARDS | RECORDED):
        near = difflib.get_close_matches(name, names, 1)
        hint = f": did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"device = {name!r}, expected one of {[*names]}{hint}")
    antennas = {}
    if name in BOARDS:
        keys = ("tx_positions", "rx_positions", "design_frequency_hz", "row_spacing")
        keys = (*keys, "real_samples")
        antennas = {key: getattr(BOARDS[name], key) for key in keys}
    return {"name": name, **antennas, **RECORDED.get(name, {})}
