"""Chirps of the radars that units are: ColoRadar's, and others in use indoors.

Slopes, sample rates and numbers of chirps are of the kind that TI's SDK and published
`.cfg` files for the AWR1843 set: 60 to 100 MHz/us, 2 to 11 million samples a second, up
to 255 chirps of each transmitter. Range bins are 4.4 to 12.5 cm wide, and ranges end at
9 to 16 m. None of the waveforms is one of the robustness set's. They are few because
each is compiled once.
"""

from typing import Any

FIELDS = ("num_chirps", "num_samples", "slope_hz_per_s", "sample_rate_hz",
          "idle_time_s", "ramp_end_time_s")  # fmt: skip
# Share of units, and FIELDS; None where they are ColoRadar's.
WAVEFORMS = {
    "coloradar": (0.52, None, None, None, None, None, None),
    "96-chirps": (0.08, 96, None, 80e12, 5e6, 30e-6, 40e-6),
    "255-chirps": (0.06, 255, None, None, None, 40e-6, None),
    "long-chirps": (0.1, None, None, 60e12, 5e6, 60e-6, 40e-6),
    "slow-slope": (0.08, None, None, 40e12, 4e6, 20e-6, 44e-6),
    "fine-range": (0.08, 64, 256, 72e12, 5.4e6, 150e-6, 55e-6),
    "fine-range-quick": (0.08, 64, 256, 79e12, 8e6, 20e-6, 42e-6),
}
# Of the robustness set: TI's 3-D example for the AWR1843 (`1843_3d.cfg` of its ROS
# driver), with 16 chirps.
UNSEEN = {"ti-3d": (0.0, 16, 256, 70e12, 5.209e6, 267e-6, 57.14e-6)}
WAVEFORM_NAMES = tuple(WAVEFORMS)
WAVEFORM_SHARES = [share for share, *_ in WAVEFORMS.values()]


def named_waveform(name: str) -> dict[str, Any]:
    """Return the fields of a `RadarSpec` by which a waveform differs from ColoRadar's.

    Raises ValueError for an unknown name.
    """
    known = WAVEFORMS | UNSEEN
    if name not in known:
        raise ValueError(f"waveform {name!r}, expected one of {', '.join(known)}")
    fields = zip(FIELDS, known[name][1:], strict=True)
    return {field: value for field, value in fields if value is not None}
