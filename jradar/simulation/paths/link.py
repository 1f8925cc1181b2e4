"""Radar equation of a chip: transmit power, antennas, noise, ADC counts."""

import dataclasses

import numpy as np
from jaxtyping import Float

from jradar.radar import RadarSpec

BOLTZMANN_MW = 1.380649e-23 * 1e3
ROOM_K = 290.0
FULL_SCALE = 2**15  # counts
BACK_GAIN = 1e-3  # behind the board


@dataclasses.dataclass(frozen=True)
class LinkSpec:
    """Link budget of an AWR1843BOOST, from its data sheet; the losses are assumed.

    Powers of the cosine, with a floor for side lobes, fit the antennas' beam: 6 dB down
    at about 50 degrees in azimuth and 20 in elevation. `full_scale_dbm` is the received
    power that fills the ADC at 30 dB receive gain. ColoRadar's coupling file has a
    leakage of about 400 counts in the first range bins.
    """

    transmit_dbm: float = 12.0
    gain_dbi: float = 10.5
    noise_figure_db: float = 15.0
    losses_db: float = 6.0
    full_scale_dbm: float = -25.0
    azimuth_power: float = 3.1
    elevation_power: float = 22.0
    side_lobes_db: float = -20.0
    leakage_counts: float = 400.0

    def noise_mw(self, radar: RadarSpec) -> float:
        """Return the noise power in the ADC's band, k T f_s F."""
        figure = 10 ** (self.noise_figure_db / 10)
        return BOLTZMANN_MW * ROOM_K * radar.sample_rate_hz * figure

    def counts(
        self, power_mw: Float[np.ndarray, "*batch"]
    ) -> Float[np.ndarray, "*batch"]:
        """Return the amplitude of a received power in ADC counts."""
        return FULL_SCALE * np.sqrt(power_mw / 10 ** (self.full_scale_dbm / 10))

    def noise_power(self, radar: RadarSpec) -> float:
        """Return the noise power in ADC counts squared."""
        return float(self.counts(np.array([self.noise_mw(radar)]))[0] ** 2)

    def received_mw(
        self,
        radar: RadarSpec,
        xyz: Float[np.ndarray, "*batch 3"],
        distance: Float[np.ndarray, "*batch"],
        section: Float[np.ndarray, "*batch"],
    ) -> Float[np.ndarray, "*batch"]:
        """Return the power received from radar cross-sections (m2) at `xyz`."""
        fixed_db = self.transmit_dbm + 2 * self.gain_dbi - self.losses_db
        fixed = 10 ** (fixed_db / 10) * radar.wavelength_m**2 / (4 * np.pi) ** 3
        power = fixed * (self.antenna_gain(xyz) ** 2 * section / distance**4)
        return power * self.passband(radar, distance)

    def antenna_gain(
        self, xyz: Float[np.ndarray, "*batch 3"]
    ) -> Float[np.ndarray, "*batch"]:
        """Return the power gain of one antenna relative to boresight (x)."""
        distance = np.maximum(np.linalg.norm(xyz, axis=-1), 1e-9)
        ground = np.maximum(np.hypot(xyz[..., 0], xyz[..., 1]), 1e-9)
        azimuth, elevation = xyz[..., 0] / ground, ground / distance
        pattern = np.maximum(azimuth, 0) ** self.azimuth_power
        pattern = pattern * elevation**self.elevation_power
        floor = 10 ** (self.side_lobes_db / 10) * np.where(azimuth > 0, azimuth, 0)
        return np.maximum(np.maximum(pattern, floor), BACK_GAIN)

    def reach_m(self, radar: RadarSpec) -> float:
        """Return the range beyond which the ADC's filter stops all echoes."""
        return 0.98 * radar.max_range_m

    def passband(
        self, radar: RadarSpec, distance: Float[np.ndarray, "*batch"]
    ) -> Float[np.ndarray, "*batch"]:
        """Return the share that passes the ADC's filter: 1 to 0.88 f_s, 0 at 0.98."""
        edge = (np.asarray(distance) / radar.max_range_m - 0.88) / 0.10
        return np.cos(np.pi / 2 * np.clip(edge, 0, 1)) ** 2


LINK = LinkSpec()
