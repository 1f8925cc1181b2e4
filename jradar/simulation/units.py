"""Units: how radars, their mounts and their places of use differ.

A `UnitSpec` describes one radar in somebody's hands: the errors of its board, how well
they were calibrated, how it is mounted and carried, and what disturbs it. The default
is the unit of `jradar-sim-1`. `draw_unit` draws a unit from the population that models
are trained on: boards, mounts, speeds, chirps (`WAVEFORMS`), clutter, reflections by
way of the floor and between walls, moving leaves, receivers that clip. `SHIFTS`
names the units of the robustness set; the population contains none of their boards.

The spreads are those of the boards and captures at hand: phases of channels that TI's
demo measured on an AWR1843 and an AWR6843AOP (`compRangeBiasAndRxChanPhase`), and on
captures of standing AWR1642s and AWR1843s the image of I and Q (-34 to -43 dBc), the
drift of the phase in a frame (36 to 47 mrad), the noise at the end of the range axis
(6 to 8 dB lower) and the diffuse echoes of rooms.
"""

import dataclasses
from typing import Any

import numpy as np

from jradar.radar import RadarSpec

FIRST_SHIFT = 1 << 20  # boards of the robustness set; the population's lie below
WAVEFORM_FIELDS = ("num_chirps", "num_samples", "slope_hz_per_s", "sample_rate_hz",
                   "idle_time_s", "ramp_end_time_s")  # fmt: skip
# Share of units, and WAVEFORM_FIELDS; None where they are ColoRadar's. They are of the
# kind that TI's SDK and published .cfg files for the AWR1843 set: range bins of 4.4 to
# 12.5 cm, ranges of 9 to 16 m. They are few because each is compiled once.
WAVEFORMS = {
    "coloradar": (0.52, None, None, None, None, None, None),
    "96-chirps": (0.08, 96, None, 80e12, 5e6, 30e-6, 40e-6),
    "255-chirps": (0.06, 255, None, None, None, 40e-6, None),
    "long-chirps": (0.1, None, None, 60e12, 5e6, 60e-6, 40e-6),
    "slow-slope": (0.08, None, None, 40e12, 4e6, 20e-6, 44e-6),
    "fine-range": (0.08, 64, 256, 72e12, 5.4e6, 150e-6, 55e-6),
    "fine-range-quick": (0.08, 64, 256, 79e12, 8e6, 20e-6, 42e-6),
}
# RadarHD's, of `radarhd_config.xml` in its repository. No unit draws it.
RADARHD = {"radarhd": (0.0, 64, 512, 63.343e12, 9.121e6, 10e-6, 63.14e-6)}
WAVEFORM_NAMES = tuple(WAVEFORMS)
WAVEFORM_SHARES = [share for share, *_ in WAVEFORMS.values()]


@dataclasses.dataclass(frozen=True)
class UnitSpec:
    """One radar as it is built, calibrated, mounted, carried and disturbed.

    `board` is the seed of the errors of channels; None is the board that TI measured.
    `calibration_degrees` is the rms error of the phases in its calibration file; None
    is a board without such a file. `tilt_degrees` tilts rig and scanner down.
    `mount_degrees` is the rms error of the mount's description. `speed_mps` None keeps
    the scene's pace, and 0 stands on a tripod.
    """

    board: int | None = None
    channel_degrees: float = 17.0  # rms, of each transmitter and each receiver
    channel_db: float = 0.7
    calibration_degrees: float | None = None
    range_bias_m: float = 0.0659  # by which measured ranges are too long
    noise_db: float = 0.0  # relative to the link budget's noise figure
    leakage_db: float = 0.0  # relative to ColoRadar's
    coupling_file: bool = True
    gain_db: float = 0.0  # of the receivers; strong echoes are clipped
    edge_db: float = 0.0  # loss of the filter at the largest range
    image_db: float | None = None  # of I and Q, below the signal
    offset_counts: float = 0.0  # DC
    drift_mrad: float = 0.0  # rms wander of the phase within a frame
    clutter_counts: float = 0.0  # rms of diffuse echoes in 0.117 m at 3 m
    interferers: int = 0  # radars nearby whose chirps cross
    interferer_counts: float = 0.0  # amplitude of their bursts
    mount_degrees: float = 0.0
    height_m: float | None = None
    tilt_degrees: float = 0.0
    speed_mps: float | None = None
    chirps: int = 128
    slope_hz_per_s: float = 100e12
    one_row: bool = False
    waveform: str | None = None  # of `WAVEFORMS`, instead of `chirps` and the slope
    floor_bounces: bool = False  # paths via the floor, with its phase
    floor_roughness_m: float = 0.5e-3
    wall_echoes: bool = False  # between parallel walls
    ghost_db: float = 0.0  # of ghosts in walls, relative to their materials'
    wind_mph: float = 0.0  # moves leaves

    def radar(self) -> RadarSpec:
        """Return the radar of this unit, an AWR1843 or a row of its antennas."""
        device = RadarSpec.awr1642 if self.one_row else RadarSpec.awr1843
        if self.waveform is not None:
            return device(**named_waveform(self.waveform))
        return device(num_chirps=self.chirps, slope_hz_per_s=self.slope_hz_per_s)

    def written(self) -> dict[str, Any]:
        """Return the fields for `unit.json`; later ones only if they were changed."""
        fields = dataclasses.fields(self)
        later = [f.name for f in fields].index("waveform")
        return {
            field.name: getattr(self, field.name)
            for k, field in enumerate(fields)
            if k < later or getattr(self, field.name) != field.default
        }


def named_waveform(name: str) -> dict[str, Any]:
    """Return the fields of a `RadarSpec` by which a waveform differs from ColoRadar's.

    Raises ValueError for an unknown name.
    """
    known = WAVEFORMS | RADARHD
    if name not in known:
        raise ValueError(f"waveform {name!r}, expected one of {', '.join(known)}")
    fields = zip(WAVEFORM_FIELDS, known[name][1:], strict=True)
    return {field: value for field, value in fields if value is not None}


def draw_unit(seed: int) -> UnitSpec:
    """Return unit number `seed` of the population that models are trained on."""
    random = np.random.default_rng([seed, *b"unit 2"])
    uniform, chance = random.uniform, random.random
    calibration = [1.5, 6.0, None][random.choice(3, p=[0.45, 0.25, 0.3])]
    bias = uniform(0.03, 0.09) if calibration is None else random.normal(scale=0.01)
    speed = uniform(0.2, 2.0) if chance() < 0.5 else uniform(2.0, 3.2)
    return UnitSpec(
        board=int(random.integers(1, FIRST_SHIFT)),
        channel_degrees=uniform(5, 25) if calibration else uniform(8, 36),
        channel_db=uniform(0.3, 1.5),
        calibration_degrees=calibration,
        range_bias_m=float(bias),
        noise_db=uniform(-2, 7),
        leakage_db=uniform(-8, 4),
        coupling_file=chance() < 0.6,
        gain_db=uniform(-6, 6) if chance() < 0.8 else uniform(6, 40),
        edge_db=uniform(0, 16),
        image_db=uniform(-46, -30),
        offset_counts=uniform(0, 30),
        drift_mrad=uniform(0, 60),
        clutter_counts=float(chance() < 0.85) * float(np.exp(uniform(-1, np.log(10)))),
        interferers=int(random.choice(5, p=[0.65, 0.15, 0.1, 0.06, 0.04])),
        interferer_counts=float(np.exp(uniform(3, 7.2))),
        mount_degrees=uniform(0, 2),
        height_m=uniform(0.45, 2.1),
        tilt_degrees=float(np.clip(random.normal(scale=5), -8, 14)),
        speed_mps=0.0 if chance() < 0.3 else speed,
        waveform=WAVEFORM_NAMES[random.choice(len(WAVEFORMS), p=WAVEFORM_SHARES)],
        floor_bounces=chance() < 0.7,
        floor_roughness_m=float(np.exp(uniform(np.log(1e-4), np.log(3e-3)))),
        wall_echoes=chance() < 0.5,
        ghost_db=uniform(-10, 3),
        wind_mph=uniform(1, 25) if chance() < 0.7 else 0.0,
    )


# How units of the robustness set differ from `CALIBRATED`, the clean unit.
CALIBRATED = UnitSpec(calibration_degrees=2.0, range_bias_m=0.01, mount_degrees=0.5)
SHIFTS: dict[str, dict[str, object]] = {
    "clean": {},
    "unseen-scene": {},
    "board-a": {"board": FIRST_SHIFT + 1, "calibration_degrees": None},
    "board-b": {"board": FIRST_SHIFT + 2, "calibration_degrees": None},
    "board-c-calibrated": {"board": FIRST_SHIFT + 3},
    "twice-the-channel-errors": {
        "board": FIRST_SHIFT + 4,
        "channel_degrees": 34.0,
        "channel_db": 1.4,
        "calibration_degrees": None,
    },
    "more-noise": {"noise_db": 7.0},
    "tilted-down": {"tilt_degrees": 10.0},
    "low": {"height_m": 0.5},
    "high": {"height_m": 2.0},
    "standing-still": {"speed_mps": 0.0},
    "fast": {"speed_mps": 3.0},
    "half-the-chirps": {"chirps": 64},
    "half-the-range-resolution": {"slope_hz_per_s": 50e12},
    "strong-interference": {"interferers": 5, "interferer_counts": 1500.0},
    "weak-interference": {"interferers": 1, "interferer_counts": 300.0},
    "clutter": {"clutter_counts": 7.7},
    "clutter-standing-still": {"clutter_counts": 7.7, "speed_mps": 0.0},
    "desk": {
        "board": FIRST_SHIFT + 5,
        "calibration_degrees": 8.0,
        "clutter_counts": 7.7,
        "mount_degrees": 2.0,
        "coupling_file": False,
        "image_db": -36.0,
        "offset_counts": 20.0,
        "drift_mrad": 45.0,
        "edge_db": 7.0,
        "height_m": 0.9,
        "speed_mps": 0.0,
    },
    "one-row": {"one_row": True},
}


def shifted_unit(shift: str) -> UnitSpec:
    """Return the unit of a named shift of the robustness set."""
    return dataclasses.replace(CALIBRATED, **SHIFTS[shift])
