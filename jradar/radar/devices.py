"""Named radars: chirp and antennas of devices that data sets were recorded with.

AWR1843 (and ColoRadar's single chip): two transmitters in the row of the receivers, the
third half a wavelength above it; in units of half wavelengths, seen from behind:

    elevation 1          t2 t2 t2 t2
    elevation 0    t0 t0 t0 t0 t1 t1 t1 t1      azimuth 0 .. 7

Sources: ColoRadar (Kramer et al. 2022) and its converter; TI's MMWCAS reference design
for the cascade, whose firing order ColoRadar does not document: TI's default is taken.
"""

from typing import Any

ROW_OF_RECEIVERS = ((0, 0), (1, 0), (2, 0), (3, 0))

SINGLE_CHIP: dict[str, Any] = {
    "start_frequency_hz": 77e9,
    "slope_hz_per_s": 100e12,
    "sample_rate_hz": 10.666e6,
    "num_samples": 128,
    "num_chirps": 128,
    "idle_time_s": 110e-6,
    "adc_start_time_s": 7e-6,
    "ramp_end_time_s": 20e-6,
    "tx_positions": ((0, 0), (4, 0), (2, 1)),
    "rx_positions": ROW_OF_RECEIVERS,
    "design_frequency_hz": 76.8e9,
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

DEVICES: dict[str, dict[str, Any]] = {
    "awr1843": SINGLE_CHIP,
    "awr1642": SINGLE_CHIP | {"tx_positions": ((0, 0), (4, 0))},
    "cascade": CASCADE,
}

# Boards that TI's tools configure: positions of the transmitters in the order of their
# bits in a mask. The ISK's agree with TI's `antGeometry` commands for it; its 62 GHz is
# assumed, from TI's IWR6843L board. ODS and AOP boards have other arrays.
ELEVATED_SECOND = ((0, 0), (2, 1), (4, 0))
PHYSICAL_TX = {
    "xwr1443": ELEVATED_SECOND,
    "xwr1642": ((0, 0), (4, 0)),
    "xwr1843": ELEVATED_SECOND,
    "xwr6843isk": ELEVATED_SECOND,
}
BANDS_HZ = dict.fromkeys(PHYSICAL_TX, (76e9, 81e9)) | {"xwr6843isk": (60e9, 64e9)}
DESIGN_FREQUENCIES_HZ = dict.fromkeys(PHYSICAL_TX, 76.8e9) | {"xwr6843isk": 62e9}
STUDIO_CHIPS = {"AR1642": "xwr1642", "AR1843": "xwr1843"}  # as in mmWave Studio's logs
