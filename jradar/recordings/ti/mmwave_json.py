"""Radar and sample stream in an `.mmwave.json`, which mmWave Studio exports.

    mmWaveDevices[0]
      rfConfig
        rlChanCfg_t     rxChannelEn, txChannelEn: masks such as "0xF"
        rlAdcOutCfg_t   fmt: b2AdcBits 2 (16 bits), b2AdcOutFmt 0 real, 1 complex
        rlProfiles      [ { rlProfileCfg_t: GHz, us, MHz/us, samples, ksps } ]
        rlChirps        [ { rlChirpCfg_t: first, last, profile, txEnable mask } ]
        rlFrameCfg_t    first and last chirp of a turn, numLoops, framePeriodicity_msec
      rawDataCaptureConfig
        rlDevDataFmtCfg_t   iqSwapSel 1: Q before I; chInterleave 0: four lanes

The file does not name the board. A `.setup.json` or `cf.json` describes the capture
card only.
"""

from pathlib import Path
from typing import Any

from jradar.errors import UsageError, parsing
from jradar.files import MAX_TEXT_BYTES, read_json
from jradar.options.boards import Board
from jradar.options.sensor import RadarSpec
from jradar.recordings.ti.frame import (
    CaptureSpec,
    Chirp,
    bits,
    board_of,
    chirp_range,
    radar_of_frame,
)

LARGEST = 1e12  # in the units of the file: GHz, us, MHz/us, ksps
MOST_DIGITS = 20  # of a mask
ENDS = ("chirpStartIdx", "chirpEndIdx")
PROFILE = (  # in the order of `frame.PROFILE`
    *("startFreqConst_GHz", "idleTimeConst_usec", "adcStartTimeConst_usec"),
    *("rampEndTime_usec", "freqSlopeConst_MHz_usec", "numAdcSamples"),
    "digOutSampleRate",
)
VARIATIONS = (
    *("startFreqVar_MHz", "freqSlopeVar_KHz_usec"),
    *("idleTimeVar_usec", "adcStartTimeVar_usec"),
)


def read_mmwave_json(
    path: Path | str, *, device: str = "awr1843"
) -> tuple[RadarSpec, CaptureSpec]:
    """Return the radar that an `.mmwave.json` configures, and its stream of samples.

    Raises UsageError for an unknown `device` and for the description of a capture card,
    ValueError for missing values, and errors as `radar_of_frame`.
    """
    board = board_of(device)
    with parsing(path, "an .mmwave.json"):
        described = _device(path)
        radio = _take(described, "rfConfig")
        frame = _take(radio, "rlFrameCfg_t")
        chirps: dict[int, Chirp] = {}
        for entry in _tables(radio, "rlChirps", "rlChirpCfg_t"):
            varied = [_number(entry, key) for key in VARIATIONS]
            tx = bits(path, _mask(entry, "txEnable"))
            numbers = chirp_range(path, [_number(entry, key) for key in ENDS])
            chirp = Chirp(_number(entry, "profileId"), varied, tx)
            chirps |= dict.fromkeys(numbers, chirp)
        radar, tx, rx = radar_of_frame(
            path,
            device,
            profiles={
                _number(entry, "profileId"): [_number(entry, key) for key in PROFILE]
                for entry in _tables(radio, "rlProfiles", "rlProfileCfg_t")
            },
            chirps=chirps,
            ends=[_number(frame, key) for key in ENDS],
            turns=_number(frame, "numLoops"),
            period_s=_number(frame, "framePeriodicity_msec") * 1e-3,
            rx_mask=_mask(radio, "rlChanCfg_t", "rxChannelEn"),
            tx_mask=_mask(radio, "rlChanCfg_t", "txChannelEn"),
        )
        order = _iq_order(described, board)
    factors = tuple(complex(board.rx_signs[r]) for _ in tx for r in rx)
    return radar, CaptureSpec(iq_order=order, channel_factors=factors)


def _take(table: dict[str, Any], *keys: str, kind: Any = dict) -> Any:
    """Return the value at the end of these keys; ValueError for another kind."""
    value: Any = table
    for key in keys:
        value = value.get(key) if isinstance(value, dict) else None
    if not isinstance(value, kind) or isinstance(value, bool):
        names = getattr(kind, "__name__", "number")
        raise ValueError(f"{' '.join(keys)} = {value!r:.80}, expected a {names}")
    return value


def _tables(table: dict[str, Any], key: str, inner: str) -> list[dict[str, Any]]:
    """Return the objects of a list, each the value of `inner` in its entry."""
    entries = _take(table, key, kind=list)
    return [_take({key: entry}, key, inner) for entry in entries]


def _number(table: dict[str, Any], *keys: str) -> float:
    value = _take(table, *keys, kind=(int, float))
    if not abs(value) <= LARGEST:  # NaN compares as False
        raise ValueError(
            f"{' '.join(keys)} = {value!r:.80}, expected a number of at most "
            f"{LARGEST:g}"
        )
    return float(value)


def _mask(table: dict[str, Any], *keys: str) -> int:
    text = _take(table, *keys, kind=str)
    try:
        return int(text[:MOST_DIGITS], 16)
    except ValueError:
        raise ValueError(
            f"{' '.join(keys)} = {text!r:.80}, expected a mask such as '0xF'"
        ) from None


def _device(path: Path | str) -> dict[str, Any]:
    """Return the only device that a file configures."""
    values = read_json(path, limit=MAX_TEXT_BYTES)
    devices = values.get("mmWaveDevices")
    if devices is None and "DCA1000Config" in values:
        raise UsageError(
            f"{path} describes the capture card, not the radar: name a .cfg, a log of "
            "mmWave Studio or an .mmwave.json with --radar"
        )
    if not isinstance(devices, list) or len(devices) != 1:
        count = len(devices) if isinstance(devices, list) else "no"
        raise ValueError(f"{count} mmWaveDevices, expected a list of one")
    if not isinstance(devices[0], dict):
        raise ValueError(f"mmWaveDevices holds {devices[0]!r:.80}")
    return devices[0]


def _iq_order(described: dict[str, Any], board: Board) -> str:
    """Return the order of I and Q; refuse samples that the board does not deliver."""
    fmt = _take(described, "rfConfig", "rlAdcOutCfg_t", "fmt")
    width, kind = _number(fmt, "b2AdcBits"), _number(fmt, "b2AdcOutFmt")
    if width != 2 or (kind == 0) != board.real_samples:
        expected = "real" if board.real_samples else "complex"
        raise ValueError(
            f"b2AdcBits {width:g}, b2AdcOutFmt {kind:g}, expected 2 (16 bits) and "
            f"{expected} samples"
        )
    if board.real_samples:
        return "I"
    stream = _take(described, "rawDataCaptureConfig", "rlDevDataFmtCfg_t")
    orders = ("IIQQ", "QQII") if _number(stream, "chInterleave") else ("I4Q4", "Q4I4")
    return orders[bool(_number(stream, "iqSwapSel"))]
