"""The radar equation of a chip: transmit power to ADC counts, antennas, noise."""

import dataclasses

import numpy as np
from jaxtyping import Float

from jradar.radar import RadarSpec

BOLTZMANN_MW = 1.380649e-23 * 1e3
ROOM_K = 290.0
FULL_SCALE = 2**15  # counts


@dataclasses.dataclass(frozen=True)
class LinkSpec:
    """An AWR1843BOOST as its data sheet and guide have it; the losses are assumed.

    The antennas' gain and their beam, 6 dB down at about 50 degrees in azimuth and 20
    in elevation, are fitted by powers of the cosine with a floor for side lobes.
    `full_scale_dbm` is a received power that fills the ADC at 30 dB receive gain. The
    leakage is that of ColoRadar's coupling file, some 400 counts at the first bins.
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
        """Noise power in the ADC's band, k T f_s F."""
        figure = 10 ** (self.noise_figure_db / 10)
        return BOLTZMANN_MW * ROOM_K * radar.sample_rate_hz * figure

    def counts(
        self, power_mw: Float[np.ndarray, "*batch"]
    ) -> Float[np.ndarray, "*batch"]:
        """Amplitude in ADC counts of a received power."""
        return FULL_SCALE * np.sqrt(power_mw / 10 ** (self.full_scale_dbm / 10))

    def noise_power(self, radar: RadarSpec) -> float:
        """Noise in counts squared, as `simulate_cube` takes it."""
        return float(self.counts(np.array([self.noise_mw(radar)]))[0] ** 2)

    def radar_equation(
        self, radar: RadarSpec, gain2_section_per_m4: Float[np.ndarray, "*batch"]
    ) -> Float[np.ndarray, "*batch"]:
        """Received mW of a section over R^4, with relative antenna gains in it."""
        fixed_db = self.transmit_dbm + 2 * self.gain_dbi - self.losses_db
        fixed = 10 ** (fixed_db / 10) * radar.wavelength_m**2 / (4 * np.pi) ** 3
        return fixed * gain2_section_per_m4

    def reach_m(self, radar: RadarSpec) -> float:
        """Range beyond which the ADC's filter lets nothing pass."""
        return 0.98 * radar.max_range_m

    def passband(
        self, radar: RadarSpec, distance: Float[np.ndarray, "*batch"]
    ) -> Float[np.ndarray, "*batch"]:
        """Power that passes the filter before the ADC: flat to 0.88 f_s, 0 at 0.98."""
        edge = (np.asarray(distance) / radar.max_range_m - 0.88) / 0.10
        return np.cos(np.pi / 2 * np.clip(edge, 0, 1)) ** 2


def antenna_gain(
    xyz: Float[np.ndarray, "*batch 3"], link: LinkSpec
) -> Float[np.ndarray, "*batch"]:
    """Power gain of one antenna relative to boresight (x); 30 dB down behind."""
    distance = np.maximum(np.linalg.norm(xyz, axis=-1), 1e-9)
    ground = np.maximum(np.hypot(xyz[..., 0], xyz[..., 1]), 1e-9)
    azimuth, elevation = xyz[..., 0] / ground, ground / distance
    pattern = np.maximum(azimuth, 0) ** link.azimuth_power
    pattern = pattern * elevation**link.elevation_power
    floor = 10 ** (link.side_lobes_db / 10) * np.where(azimuth > 0, azimuth, 0)
    return np.maximum(np.maximum(pattern, floor), 1e-3)
