"""The synthesiser's errors: phase noise, and chirps that start late by a clock's edge.

A mixer multiplies the echo with what is sent just then. Phase noise of the synthesiser
is in both, tau apart, and cancels but for its change (range correlation; Budge & Burt
1993). Where it falls by 20 dB a decade, as outside a loop's band, its derivative is
white: then every echo of delay tau is turned by tau w(t), with one white w(t) for all.
A chirp of slope S has a beat of S tau, and

    phase noise   w(t)   turns it as if its samples were taken w / (2 pi S) late
    jitter        d      of the chirp's start against the ADC turns it by 2 pi S tau d

so that both are errors of the sampling time: the echo plus its derivative times the
error. The skirts around an echo grow with its power and the square of its range: over
all ranges by the phase noise, over all velocities at its range by the jitter.

Levels: -93 dBc/Hz 1 MHz off a carrier of 77 to 81 GHz (TI, AWR1843 data sheet); starts
0 or 1.1 ns late, either as likely (TI, SPRACV2, 2020: AWR1843 and AWR2243). Within
the loop's band, which TI does not state, the noise is below the model's, and so it is
where pi f tau is no longer small: by 0.5 dB at 5 MHz and 5 m. The cascade's chips
are taken to err together.
"""

import dataclasses

import jax
from jaxtyping import Array, Float, Key

from jradar.radar import RadarSpec

OFFSET_HZ = 1e6  # from the carrier, where phase noise is stated


@dataclasses.dataclass(frozen=True)
class SynthesiserSpec:
    """Phase noise at 1 MHz and the two starts of a chirp, apart in time."""

    phase_noise_dbc_hz: float = -93.0
    start_jitter_s: float = 1.1e-9

    def wander_s(self, radar: RadarSpec) -> float:
        """Standard deviation of the sampling time's error by phase noise.

        The noise in the ADC's band, L f_s, has a derivative of 2 pi 1 MHz at 1 MHz.
        """
        density = 10 ** (self.phase_noise_dbc_hz / 10)
        return (
            OFFSET_HZ * (density * radar.sample_rate_hz) ** 0.5 / radar.slope_hz_per_s
        )


def sampling_errors(
    key: Key[Array, ""], radar: RadarSpec, synthesiser: SynthesiserSpec
) -> Float[Array, "tx chirp sample"]:
    """Seconds by which samples are late, alike for all receivers; the mean is zero."""
    noisy, late = jax.random.split(key)
    chirps = (radar.num_tx, radar.num_chirps)
    noise = jax.random.normal(noisy, (*chirps, radar.num_samples))
    start = jax.random.bernoulli(late, shape=(*chirps, 1)) - 0.5
    return synthesiser.wander_s(radar) * noise + synthesiser.start_jitter_s * start
