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

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from jradar.errors import UsageError
from jradar.files import MAX_TEXT_BYTES, read_json
from jradar.radar import RadarSpec
from jradar.radar.devices import Board
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
    described = _device(path)
    radio = _Table(path, described.take("rfConfig", dict))
    frame = _Table(path, radio.take("rlFrameCfg_t", dict))
    chirps: dict[int, Chirp] = {}
    for entry in radio.tables("rlChirps", "rlChirpCfg_t"):
        varied = [entry.number(key) for key in VARIATIONS]
        tx = bits(path, entry.mask("txEnable"))
        chirp = Chirp(entry.number("profileId"), varied, tx)
        numbers = chirp_range(path, [entry.number(key) for key in ENDS])
        chirps |= dict.fromkeys(numbers, chirp)
    radar, tx, rx = radar_of_frame(
        path,
        device,
        profiles={
            entry.number("profileId"): [entry.number(key) for key in PROFILE]
            for entry in radio.tables("rlProfiles", "rlProfileCfg_t")
        },
        chirps=chirps,
        ends=[frame.number(key) for key in ENDS],
        turns=frame.number("numLoops"),
        period_s=frame.number("framePeriodicity_msec") * 1e-3,
        rx_mask=radio.mask("rlChanCfg_t", "rxChannelEn"),
        tx_mask=radio.mask("rlChanCfg_t", "txChannelEn"),
    )
    capture = CaptureSpec(
        iq_order=_iq_order(path, described, board),
        channel_factors=tuple(complex(board.rx_signs[r]) for _ in tx for r in rx),
    )
    return radar, capture


class _Table:
    """An object of the file; errors name the file and the key."""

    def __init__(self, path: Path | str, values: dict[str, Any]):
        self.path, self.values = path, values

    def take(self, *keys: Any) -> Any:
        """Return the value behind a chain of keys, whose last item is its type."""
        *chain, kind = keys
        value: Any = self.values
        for key in chain:
            value = value.get(key) if isinstance(value, dict) else None
        if not isinstance(value, kind) or isinstance(value, bool):
            names = getattr(kind, "__name__", "number")
            raise ValueError(
                f"{self.path}: {' '.join(chain)} = {value!r:.80}, expected a {names}"
            )
        return value

    def tables(self, key: str, inner: str) -> Iterator["_Table"]:
        """Yield the objects of a list, each the value of `inner` in its entry."""
        for entry in self.take(key, list):
            found = _Table(self.path, {key: entry}).take(key, inner, dict)
            yield _Table(self.path, found)

    def number(self, *keys: str) -> float:
        """Return a number that a float can hold."""
        value = self.take(*keys, (int, float))
        if not abs(value) <= LARGEST:  # NaN compares as False
            raise ValueError(
                f"{self.path}: {' '.join(keys)} = {value!r:.80}, expected a number of "
                f"at most {LARGEST:g}"
            )
        return float(value)

    def mask(self, *keys: str) -> int:
        """Return a mask such as "0xF"."""
        text = self.take(*keys, str)
        try:
            return int(text[:MOST_DIGITS], 16)
        except ValueError as error:
            raise ValueError(
                f"{self.path}: {' '.join(keys)} = {text!r:.80}, expected a mask such "
                "as '0xF'"
            ) from error


def _device(path: Path | str) -> _Table:
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
        raise ValueError(f"{path}: {count} mmWaveDevices, expected a list of one")
    if not isinstance(devices[0], dict):
        raise ValueError(f"{path}: mmWaveDevices holds {devices[0]!r:.80}")
    return _Table(path, devices[0])


def _iq_order(path, described: _Table, board: Board) -> str:
    """Return the order of I and Q; refuse samples that the board does not deliver."""
    width = described.number("rfConfig", "rlAdcOutCfg_t", "fmt", "b2AdcBits")
    kind = described.number("rfConfig", "rlAdcOutCfg_t", "fmt", "b2AdcOutFmt")
    if width != 2 or (kind == 0) != board.real_samples:
        expected = "real" if board.real_samples else "complex"
        raise ValueError(
            f"{path}: b2AdcBits {width:g}, b2AdcOutFmt {kind:g}, expected 2 (16 bits) "
            f"and {expected} samples"
        )
    if board.real_samples:
        return "I"
    stream = ("rawDataCaptureConfig", "rlDevDataFmtCfg_t")
    orders = (
        ("IIQQ", "QQII")
        if described.number(*stream, "chInterleave")
        else ("I4Q4", "Q4I4")
    )
    return orders[bool(described.number(*stream, "iqSwapSel"))]
