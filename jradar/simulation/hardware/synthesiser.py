"""Errors of the synthesiser: phase noise, and chirps that start late by a clock's edge.

A mixer multiplies the echo with the signal sent at that moment. The phase noise is in
both, a delay tau apart, and only its change remains (range correlation; Budge & Burt
1993). Outside the loop's band phase noise falls by 20 dB a decade, so its derivative is
white: the phase of an echo of delay tau shifts by tau w(t), with the same white w(t)
for all echoes. A chirp of slope S gives a beat of S tau, and

    phase noise   w(t)   shifts it as if samples were taken w / (2 pi S) late
    jitter        d      of the chirp's start against the ADC shifts it by 2 pi S tau d

so both are errors of the sampling time: the echo plus its derivative times the error.
Each echo has a skirt that grows with its power and the square of its range. Phase noise
spreads the skirt over all ranges, jitter over all velocities at the echo's range.

Levels: -93 dBc/Hz at 1 MHz from a carrier of 77 to 81 GHz (TI, AWR1843 data sheet);
starts 0 or 1.1 ns late, equally likely (TI, SPRACV2, 2020: AWR1843 and AWR2243). The
real noise is below the model's within the loop's band, which TI does not state, and
where pi f tau is not small (by 0.5 dB at 5 MHz and 5 m). All chips of the cascade have
the same errors.
"""

import dataclasses

import jax
from jaxtyping import Array, Float, Key

from jradar.radar import RadarSpec

OFFSET_HZ = 1e6  # from the carrier, of the data sheet's phase noise


@dataclasses.dataclass(frozen=True)
class SynthesiserSpec:
    """Phase noise at 1 MHz, and the time between the two starts of a chirp."""

    phase_noise_dbc_hz: float = -93.0
    start_jitter_s: float = 1.1e-9

    def wander_s(self, radar: RadarSpec) -> float:
        """Return the standard deviation of the sampling time due to phase noise.

        The noise in the ADC's band is L f_s; differentiated at 1 MHz, it is multiplied
        by 2 pi 1 MHz.
        """
        density = 10 ** (self.phase_noise_dbc_hz / 10)
        return (
            OFFSET_HZ * (density * radar.sample_rate_hz) ** 0.5 / radar.slope_hz_per_s
        )


def sampling_errors(
    key: Key[Array, ""], radar: RadarSpec, synthesiser: SynthesiserSpec
) -> Float[Array, "tx chirp sample"]:
    """Return the seconds by which samples are late, the same for all receivers."""
    noisy, late = jax.random.split(key)
    chirps = (radar.num_tx, radar.num_chirps)
    noise = jax.random.normal(noisy, (*chirps, radar.num_samples))
    start = jax.random.bernoulli(late, shape=(*chirps, 1)) - 0.5
    return synthesiser.wander_s(radar) * noise + synthesiser.start_jitter_s * start
