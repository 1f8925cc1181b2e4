"""Chirps of the radars that units are: ColoRadar's, and others in use indoors.

Slopes, sample rates and numbers of chirps are of the kind that TI's SDK and published
`.cfg` files for the AWR1843 set: 60 to 100 MHz/us, 2 to 11 million samples a second, up
to 255 chirps of each transmitter. Range bins are 4.4 to 12.5 cm wide, and ranges end at
9 to 16 m. None of the waveforms is one of the robustness set's. They are few because
each is compiled once.
"""

from typing import Any

WAVEFORMS: dict[str, tuple[float, dict[str, Any]]] = {  # share of units, fields
    "coloradar": (0.52, {}),
    "96-chirps": (
        0.08,
        {
            "num_chirps": 96,
            "slope_hz_per_s": 80e12,
            "sample_rate_hz": 5e6,
            "idle_time_s": 30e-6,
            "ramp_end_time_s": 40e-6,
        },
    ),
    "255-chirps": (0.06, {"num_chirps": 255, "idle_time_s": 40e-6}),
    "long-chirps": (
        0.1,
        {
            "slope_hz_per_s": 60e12,
            "sample_rate_hz": 5e6,
            "idle_time_s": 60e-6,
            "ramp_end_time_s": 40e-6,
        },
    ),
    "slow-slope": (
        0.08,
        {
            "slope_hz_per_s": 40e12,
            "sample_rate_hz": 4e6,
            "idle_time_s": 20e-6,
            "ramp_end_time_s": 44e-6,
        },
    ),
    "fine-range": (
        0.08,
        {
            "num_chirps": 64,
            "num_samples": 256,
            "slope_hz_per_s": 72e12,
            "sample_rate_hz": 5.4e6,
            "idle_time_s": 150e-6,
            "ramp_end_time_s": 55e-6,
        },
    ),
    "fine-range-quick": (
        0.08,
        {
            "num_chirps": 64,
            "num_samples": 256,
            "slope_hz_per_s": 79e12,
            "sample_rate_hz": 8e6,
            "idle_time_s": 20e-6,
            "ramp_end_time_s": 42e-6,
        },
    ),
}
# Of the robustness set: TI's 3-D example for the AWR1843 (`1843_3d.cfg` of its ROS
# driver), with 16 chirps.
UNSEEN_WAVEFORMS: dict[str, dict[str, Any]] = {
    "ti-3d": {
        "num_chirps": 16,
        "num_samples": 256,
        "slope_hz_per_s": 70e12,
        "sample_rate_hz": 5.209e6,
        "idle_time_s": 267e-6,
        "ramp_end_time_s": 57.14e-6,
    }
}
WAVEFORM_NAMES = tuple(WAVEFORMS)
WAVEFORM_SHARES = [share for share, _ in WAVEFORMS.values()]


def named_waveform(name: str) -> dict[str, Any]:
    """Return the fields of a `RadarSpec` by which a waveform differs from ColoRadar's.

    Raises ValueError for an unknown name.
    """
    known = {each: fields for each, (_, fields) in WAVEFORMS.items()} | UNSEEN_WAVEFORMS
    if name not in known:
        raise ValueError(f"waveform {name!r}, expected one of {', '.join(known)}")
    return known[name]
