"""The radar as a static description: chirp, antennas and derived resolutions.

    frequency
      ^      adc start       ramp end
      |          |   ADC   |   |
      |          v  samples v  v
      |        /:::::::::::/   .        one chirp per transmitter in turn,
      |      /             /   .        `num_chirps` turns make a frame
      |____/              /____.___> time
      idle

Everything is in SI units. Antenna positions (a, e) count columns to the left and rows
upwards, as the target sees phase lead. Columns are half a wavelength apart at the
design frequency, rows `row_spacing` times as much. A plane wave from direction
(u, w) = (sin az cos el, sin el) has the phase 2 pi (d_c a u + d_r e w), where d_c and
d_r are the distances of neighbouring columns and rows in wavelengths.

A receiver with one mixer delivers real samples. Their spectrum is symmetric, so that
only half of it is range: N real samples have N / 2 range bins.
"""

import dataclasses
import math
from typing import Any

import numpy as np

from jradar.fields import typed_fields
from jradar.options.boards import RECORDED, device_fields

SPEED_OF_LIGHT = 299_792_458.0  # m/s

MAY_BE_ZERO = ("idle_time_s", "adc_start_time_s", "frame_period_s")
# The smallest and largest value of each number, with ample room on both sides of every
# radar that is built: values beyond are in another unit, or damaged.
LIMITS: dict[str, tuple[float, float]] = {
    "start_frequency_hz": (1e8, 1e13),
    "slope_hz_per_s": (1e8, 1e18),
    "sample_rate_hz": (1e2, 1e12),
    "num_samples": (1, 1 << 16),
    "num_chirps": (1, 1 << 16),
    "idle_time_s": (0, 100),
    "adc_start_time_s": (0, 100),
    "ramp_end_time_s": (1e-9, 100),
    "design_frequency_hz": (1e8, 1e13),
    "frame_period_s": (0, 1e6),
    "row_spacing": (0.01, 100),
}
MOST_ANTENNAS = 256  # transmitters, or receivers
FARTHEST = 1024  # column or row of an antenna
MOST_IN_FRAME = 1 << 28  # samples, 2 GiB

RAMP = ("adc_start_time_s", "num_samples", "sample_rate_hz", "ramp_end_time_s")
TOO_LATE = "sampling ends"

Positions = tuple[tuple[int, int], ...]


@dataclasses.dataclass(frozen=True)
class RadarSpec:
    """An FMCW radar with transmitters that fire in turn (TDM-MIMO)."""

    name: str
    start_frequency_hz: float
    slope_hz_per_s: float
    sample_rate_hz: float
    num_samples: int
    num_chirps: int
    idle_time_s: float
    adc_start_time_s: float
    ramp_end_time_s: float
    tx_positions: Positions
    rx_positions: Positions
    design_frequency_hz: float
    tx_firing_order: tuple[int, ...] = ()  # array indices in time; () is array order
    frame_period_s: float = 0.0  # from frame to frame; 0 if unknown
    row_spacing: float = 1.0  # of rows of antennas, in distances of columns
    real_samples: bool = False  # one mixer: no imaginary part

    def __post_init__(self):
        order = tuple(self.tx_firing_order) or tuple(range(self.num_tx))
        object.__setattr__(self, "tx_firing_order", order)
        if sorted(order) != list(range(self.num_tx)):
            raise ValueError(
                f"tx_firing_order = {order}, expected each of the {self.num_tx} "
                "transmitters' indices once"
            )
        for name, (low, high) in LIMITS.items():
            value, zero_is_fine = getattr(self, name), name in MAY_BE_ZERO
            if not (value > 0 or (value == 0 and zero_is_fine)):
                expected = "0 or more" if zero_is_fine else "more than 0"
                raise ValueError(f"{name} = {value}, expected {expected}")
            if not low <= value <= high:
                raise ValueError(
                    f"{name} = {value!s:.40}, expected {low:g} to {high:g}: is it in "
                    "another unit?"
                )
        for name in ("tx_positions", "rx_positions"):
            places = getattr(self, name)
            if not 1 <= len(places) <= MOST_ANTENNAS:
                raise ValueError(f"{len(places)} {name}, expected 1 to {MOST_ANTENNAS}")
            if far := [place for place in places if max(map(abs, place)) > FARTHEST]:
                raise ValueError(
                    f"{name} contains {far[0]}, expected columns and rows from "
                    f"{-FARTHEST} to {FARTHEST}"
                )
        if (count := math.prod(self.cube_shape)) > MOST_IN_FRAME:
            raise ValueError(
                f"a frame of {self.cube_shape} [tx, rx, chirp, sample] holds "
                f"{count:,} samples, expected at most {MOST_IN_FRAME:,}"
            )
        end_s = self.adc_start_time_s + self.num_samples / self.sample_rate_hz
        if end_s > self.ramp_end_time_s * 1.001:
            raise ValueError(
                f"{TOO_LATE} {end_s * 1e6:.2f} us into the chirp, after "
                f"ramp_end_time_s = {self.ramp_end_time_s * 1e6:.2f} us: are the times "
                "in seconds?"
            )

    # Antennas

    @property
    def num_tx(self) -> int:
        """Number of transmit antennas."""
        return len(self.tx_positions)

    @property
    def num_rx(self) -> int:
        """Number of receive antennas."""
        return len(self.rx_positions)

    @property
    def num_virtual(self) -> int:
        """Number of tx-rx pairs."""
        return self.num_tx * self.num_rx

    @property
    def virtual_positions(self) -> np.ndarray:
        """(azimuth, elevation) of each tx-rx pair, `[virtual, 2]`, from (0, 0) up."""
        tx, rx = np.array(self.tx_positions), np.array(self.rx_positions)
        positions = (tx[:, None] + rx[None]).reshape(-1, 2)
        return positions - positions.min(0)

    @property
    def has_azimuth(self) -> bool:
        """Whether the array has several columns, and therefore measures azimuth."""
        return bool(self.virtual_positions[:, 0].any())

    @property
    def has_elevation(self) -> bool:
        """Whether the array has several rows, and therefore measures elevation."""
        return bool(self.virtual_positions[:, 1].any())

    @property
    def firing_position(self) -> np.ndarray:
        """Place of each transmitter in the firing order, `[tx]`; the first is 0."""
        return np.argsort(self.tx_firing_order)

    @property
    def cube_shape(self) -> tuple[int, int, int, int]:
        """Shape of one frame, [tx, rx, chirp, sample]."""
        return self.num_tx, self.num_rx, self.num_chirps, self.num_samples

    # Derived resolutions and limits

    @property
    def bandwidth_hz(self) -> float:
        """Bandwidth of the sampled part of a chirp, B."""
        return self.slope_hz_per_s * self.num_samples / self.sample_rate_hz

    @property
    def center_frequency_hz(self) -> float:
        """Frequency in the middle of the samples, used for Doppler and angles."""
        middle_s = self.adc_start_time_s + self.num_samples / (2 * self.sample_rate_hz)
        return self.start_frequency_hz + self.slope_hz_per_s * middle_s

    @property
    def wavelength_m(self) -> float:
        """Wavelength at the centre frequency."""
        return SPEED_OF_LIGHT / self.center_frequency_hz

    @property
    def spacing_wavelengths(self) -> float:
        """Distance between neighbouring columns of antennas in wavelengths, d_c."""
        return 0.5 * self.center_frequency_hz / self.design_frequency_hz

    @property
    def row_spacing_wavelengths(self) -> float:
        """Distance between neighbouring rows of antennas in wavelengths, d_r."""
        return self.row_spacing * self.spacing_wavelengths

    @property
    def num_range_bins(self) -> int:
        """Number of range bins of a spectrum: half of the samples if they are real."""
        return self.num_samples // 2 if self.real_samples else self.num_samples

    @property
    def range_resolution_m(self) -> float:
        """Width of a range bin, c / (2 B)."""
        return SPEED_OF_LIGHT / (2 * self.bandwidth_hz)

    @property
    def max_range_m(self) -> float:
        """Range at which the spectrum ends: f_s c / (2 S), or half for real samples."""
        return self.num_range_bins * self.range_resolution_m

    @property
    def chirp_period_s(self) -> float:
        """Time from one chirp to the next, of any transmitter."""
        return self.idle_time_s + self.ramp_end_time_s

    @property
    def turn_period_s(self) -> float:
        """Time between chirps of the same transmitter, T_c."""
        return self.num_tx * self.chirp_period_s

    @property
    def frame_middle_s(self) -> float:
        """Time from the first chirp to the middle of the frame.

        Ranges of moving targets refer to it: windows over chirps weigh the middle most.
        """
        return self.num_chirps * self.turn_period_s / 2

    @property
    def max_velocity_mps(self) -> float:
        """Largest velocity without ambiguity, lambda / (4 T_c)."""
        return self.wavelength_m / (4 * self.turn_period_s)

    @property
    def velocity_resolution_mps(self) -> float:
        """Width of a Doppler bin, lambda / (2 T_c num_chirps)."""
        return 2 * self.max_velocity_mps / self.num_chirps

    # Named devices

    @classmethod
    def named(cls, device: str, **changes: Any) -> "RadarSpec":
        """Return a device of `jradar.options.boards`, with fields that replace its own.

        Raises ValueError as `from_dict`.
        """
        return cls.from_dict({"device": device, **changes})

    @classmethod
    def awr1843(cls, **changes: Any) -> "RadarSpec":
        """Return TI's AWR1843 with ColoRadar's waveform: 3 TX x 4 RX, 16 m."""
        return cls.named("awr1843", **changes)

    @classmethod
    def awr1642(cls, **changes: Any) -> "RadarSpec":
        """Return TI's AWR1642: one row of 2 TX x 4 RX, hence no elevation."""
        return cls.named("awr1642", **changes)

    @classmethod
    def cascade(cls, **changes: Any) -> "RadarSpec":
        """Return TI's MMWCAS cascade with ColoRadar's waveform: 12 TX x 16 RX."""
        return cls.named("cascade", **changes)

    @classmethod
    def simple(
        cls,
        *,
        start_frequency_hz: float,
        bandwidth_hz: float,
        chirp_s: float,
        num_samples: int,
        num_chirps: int,
        num_rx: int = 1,
        num_tx: int = 1,
        period_s: float | None = None,
        **others: Any,
    ) -> "RadarSpec":
        """Return a radar that samples whole chirps with a row of antennas.

        Receivers are half a wavelength apart at the centre of the band, transmitters
        `num_rx` half wavelengths. A chirp begins every `period_s`, by default as soon
        as the one before it has ended. `others` are further fields, such as `name` or
        `real_samples`. Raises ValueError for a radar that cannot exist.
        """
        fields = {
            "name": "radar",
            "start_frequency_hz": start_frequency_hz,
            "slope_hz_per_s": bandwidth_hz / chirp_s,
            "sample_rate_hz": num_samples / chirp_s,
            "num_samples": num_samples,
            "num_chirps": num_chirps,
            "idle_time_s": 0.0 if period_s is None else period_s - chirp_s,
            "adc_start_time_s": 0.0,
            "ramp_end_time_s": chirp_s,
            "tx_positions": tuple((num_rx * k, 0) for k in range(num_tx)),
            "rx_positions": tuple((k, 0) for k in range(num_rx)),
            "design_frequency_hz": start_frequency_hz + bandwidth_hz / 2,
        }
        return cls.from_dict(fields | others)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> "RadarSpec":
        """Return a radar from its fields, or from a `device` and fields that differ.

        With `upside_down`, it is mounted upside down. Raises ValueError for an unknown
        device, and for a field that is unknown, missing or of the wrong type.
        """
        given, names = dict(values), ("device", "upside_down")
        start = {name: given.pop(name) for name in names if name in given}
        start = _Start(**typed_fields(_Start, start))
        complete: dict[str, Any] = {"name": "radar"}
        if start.device is not None:
            complete = device_fields(start.device)
        complete |= typed_fields(cls, given)
        required = (
            f for f in dataclasses.fields(cls) if f.default is dataclasses.MISSING
        )
        if missing := [f.name for f in required if f.name not in complete]:
            raise ValueError(
                f"missing radar fields: {', '.join(missing)} "
                f"(or start from a device: {', '.join(RECORDED)})"
            )
        try:
            found = cls(**complete)
        except ValueError as error:
            assumed = [n for n in RAMP if n in complete and n not in given]
            if start.device is None or not assumed or TOO_LATE not in str(error):
                raise
            raise ValueError(
                f"{error} Not described, and taken from the {start.device}: "
                f"{', '.join(assumed)}"
            ) from error
        return found.upside_down() if start.upside_down else found

    def upside_down(self) -> "RadarSpec":
        """Return the radar mounted upside down: left and right, up and down swap."""
        swapped = {
            name: tuple((-column, -row) for column, row in getattr(self, name))
            for name in ("tx_positions", "rx_positions")
        }
        return dataclasses.replace(self, **swapped)


@dataclasses.dataclass(frozen=True)
class _Start:
    """What a description may name in addition to the fields of a `RadarSpec`."""

    device: str | None = None
    upside_down: bool = False
