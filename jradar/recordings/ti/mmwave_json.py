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
from jradar.files import read_json
from jradar.radar import RadarSpec
from jradar.radar.devices import BOARDS, Board
from jradar.recordings.text_files import MAX_BYTES, radar_of
from jradar.recordings.ti.cfg import CaptureSpec
from jradar.recordings.ti.studio_log import MAX_CHIRPS, one_tx_each

LARGEST = 1e12  # in the units of the file: GHz, us, MHz/us, ksps
VARIATIONS = (
    *("startFreqVar_MHz", "freqSlopeVar_KHz_usec"),
    *("idleTimeVar_usec", "adcStartTimeVar_usec"),
)


def read_mmwave_json(
    path: Path | str, *, device: str = "awr1843"
) -> tuple[RadarSpec, CaptureSpec]:
    """Return the radar that an `.mmwave.json` configures, and its stream of samples.

    Transmitters are in firing order, which is also their order in the recorded file.
    Raises UsageError for a `device` that is unknown or has another band or fewer
    transmitters, and for the description of a capture card. Raises ValueError for
    missing values, and for frames that a `RadarSpec` cannot describe.
    """
    if device not in BOARDS:
        raise UsageError(f"device = {device!r}, expected one of {', '.join(BOARDS)}")
    board = BOARDS[device]
    described = _device(path)
    radio = _Table(path, described.take("rfConfig", dict))
    profile, tx = _turn(path, radio)
    rx = radio.bits("rlChanCfg_t", "rxChannelEn")
    _check_board(path, board, device, radio, profile, tx, rx)
    frame = _Table(path, radio.take("rlFrameCfg_t", dict))
    fields = {
        "name": device,
        "start_frequency_hz": profile.number("startFreqConst_GHz") * 1e9,
        "slope_hz_per_s": profile.number("freqSlopeConst_MHz_usec") * 1e12,
        "sample_rate_hz": profile.number("digOutSampleRate") * 1e3,
        "num_samples": profile.whole("numAdcSamples"),
        "num_chirps": frame.whole("numLoops"),
        "idle_time_s": profile.number("idleTimeConst_usec") * 1e-6,
        "adc_start_time_s": profile.number("adcStartTimeConst_usec") * 1e-6,
        "ramp_end_time_s": profile.number("rampEndTime_usec") * 1e-6,
        "tx_positions": tuple(board.tx_positions[t] for t in tx),
        "rx_positions": tuple(board.rx_positions[r] for r in rx),
        "design_frequency_hz": board.design_frequency_hz,
        "frame_period_s": frame.number("framePeriodicity_msec") * 1e-3,
        "row_spacing": board.row_spacing,
        "real_samples": board.real_samples,
    }
    capture = CaptureSpec(
        iq_order=_iq_order(path, described, board),
        channel_factors=tuple(complex(board.rx_signs[r]) for _ in tx for r in rx),
    )
    return radar_of(path, fields), capture


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
        plain = isinstance(value, kind) and not isinstance(value, bool)
        if not plain:
            names = getattr(kind, "__name__", "number")
            raise ValueError(
                f"{self.path}: {' '.join(chain)} = {value!r:.80}, expected a {names}"
            )
        return value

    def tables(self, key: str, inner: str) -> Iterator["_Table"]:
        """Yield the objects of a list, each the value of `inner` in its entry."""
        for entry in self.take(key, list):
            yield _Table(
                self.path, _Table(self.path, {key: entry}).take(key, inner, dict)
            )

    def number(self, *keys: str) -> float:
        value = self.take(*keys, (int, float))
        if not abs(value) <= LARGEST:  # NaN compares as False
            raise ValueError(
                f"{self.path}: {' '.join(keys)} = {value!r:.80}, expected a number of "
                f"at most {LARGEST:g}"
            )
        return float(value)

    def whole(self, *keys: str) -> int:
        value = self.number(*keys)
        if value != int(value) or not 0 <= value < 2**16:
            raise ValueError(
                f"{self.path}: {' '.join(keys)} = {value:g}, expected a whole number "
                f"from 0 to {2**16 - 1}"
            )
        return int(value)

    def bits(self, *keys: str) -> list[int]:
        """Return the numbers of the bits that a mask such as "0xF" sets."""
        text = self.take(*keys, str)
        try:
            mask = int(text, 16)
        except ValueError:
            mask = -1
        if not 0 <= mask < 2**16:
            raise ValueError(
                f"{self.path}: {' '.join(keys)} = {text!r:.80}, expected a mask such "
                "as '0xF'"
            )
        return [bit for bit in range(16) if mask >> bit & 1]


def _device(path: Path | str) -> _Table:
    """Return the only device that a file configures."""
    values = read_json(path, limit=MAX_BYTES)
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


def _turn(path, radio: _Table) -> tuple[_Table, list[int]]:
    """Return the profile of the chirps of a frame, and transmitters in firing order."""
    chirps: dict[int, _Table] = {}
    for chirp in radio.tables("rlChirps", "rlChirpCfg_t"):
        ends = (chirp.whole(key) for key in ("chirpStartIdx", "chirpEndIdx"))
        chirps |= dict.fromkeys(_range(path, *ends), chirp)
    ends = (radio.whole("rlFrameCfg_t", k) for k in ("chirpStartIdx", "chirpEndIdx"))
    turn = _range(path, *ends)
    if not set(turn) <= set(chirps):
        raise ValueError(
            f"{path}: a frame sends chirps {turn[0]} to {turn[-1]}, rlChirps describes "
            f"{sorted(chirps)[:20]}"
        )
    fired = [chirps[number] for number in turn]
    profiles = {chirp.whole("profileId") for chirp in fired}
    varied = any(chirp.number(key) for chirp in fired for key in VARIATIONS)
    if len(profiles) > 1 or varied:
        raise ValueError(
            f"{path}: the chirps of a frame differ in profile, frequency, slope or "
            "times, expected one profile without variations"
        )
    tx = one_tx_each(path, [chirp.bits("txEnable") for chirp in fired])
    for profile in radio.tables("rlProfiles", "rlProfileCfg_t"):
        if profile.whole("profileId") in profiles:
            return profile, tx
    raise ValueError(f"{path}: rlProfiles lacks profile {profiles.pop()} of the chirps")


def _range(path, first: int, last: int) -> range:
    if not first <= last < MAX_CHIRPS:
        raise ValueError(
            f"{path}: chirps {first} to {last}, expected 0 to {MAX_CHIRPS - 1} in "
            "rising order"
        )
    return range(first, last + 1)


def _check_board(path, board: Board, device, radio, profile, tx, rx) -> None:
    """Raise an error if the board cannot do what the file configures."""
    enabled = radio.bits("rlChanCfg_t", "txChannelEn")
    if not rx or not set(tx) <= set(enabled):
        raise ValueError(
            f"{path}: rlChanCfg_t enables receivers {rx} and transmitters {enabled}, "
            f"the frame needs at least one receiver and transmitters {tx}"
        )
    low, high = (edge / 1e9 for edge in board.band_hz)
    start = profile.number("startFreqConst_GHz")
    fits = max(tx) < len(board.tx_positions) and max(rx) < len(board.rx_positions)
    if not fits or not low <= start <= high:
        raise UsageError(
            f"{path}: transmitters {tx} and receivers {rx}, counted from 0, at "
            f"{start:g} GHz, but the {device} has {len(board.tx_positions)} and "
            f"{len(board.rx_positions)}, from {low:g} to {high:g} GHz: name the board, "
            f"one of {', '.join(BOARDS)}"
        )


def _iq_order(path, described: _Table, board: Board) -> str:
    """Return the order of I and Q; refuse samples that the board does not deliver."""
    bits = described.whole("rfConfig", "rlAdcOutCfg_t", "fmt", "b2AdcBits")
    kind = described.whole("rfConfig", "rlAdcOutCfg_t", "fmt", "b2AdcOutFmt")
    if bits != 2 or (kind == 0) != board.real_samples:
        expected = "real" if board.real_samples else "complex"
        raise ValueError(
            f"{path}: b2AdcBits {bits}, b2AdcOutFmt {kind}, expected 2 (16 bits) and "
            f"{expected} samples"
        )
    if board.real_samples:
        return "I"
    stream = ("rawDataCaptureConfig", "rlDevDataFmtCfg_t")
    orders = (
        ("IIQQ", "QQII")
        if described.whole(*stream, "chInterleave")
        else ("I4Q4", "Q4I4")
    )
    return orders[bool(described.whole(*stream, "iqSwapSel"))]
