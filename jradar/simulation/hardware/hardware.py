"""Hardware of a radar: what its channels and its ADC make of the paths.

ColoRadar calibrates the cascade's channels, but not the single chip's. The single chip
of the default unit has the channels of a real AWR1843: the coefficients that TI's demo
measured on one board (`compRangeBiasAndRxChanPhase` in radarize_ae's 1843_v1.cfg). A
factor for each transmitter times a factor for each receiver reproduces all twelve to
0.3 dB and 3 degrees. They spread by 3.5 dB and 47 degrees; the channels of an
AWR6843AOP, measured in the same way, spread by 3.1 dB and 30 degrees. The phase of the
third transmitter tilts the elevation by about 9 degrees, the other phases rotate the
azimuth by 1 degree. The coefficients do not show how much of that is due to the board,
and how much to a reflector off boresight. Measured ranges are 6.6 cm too long.

The channels of every other unit are drawn from its seed, in the same form. A unit that
was calibrated has a `calibration` that differs from its channels by the errors of the
measurement.
"""

import os
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int, Key

from jradar.compiled import jit
from jradar.options.sensor import SPEED_OF_LIGHT
from jradar.radar import RadarSpec, Scatterers, simulate_cube
from jradar.radar.clean.interference import (
    Interferers,
    crossing_chirps,
    draw_interferers,
)
from jradar.simulation.hardware.front_end import FrontEnd, distort, make_front_end
from jradar.simulation.hardware.synthesiser import SynthesiserSpec, sampling_errors
from jradar.simulation.paths.line_of_sight import Paths
from jradar.simulation.paths.link import FULL_SCALE, LINK
from jradar.simulation.paths.propagation import CAPACITY
from jradar.simulation.units import UnitSpec

LEAKS = 3  # echoes of the leakage, in the first range bins
SYNTHESISER = SynthesiserSpec()
SKIRTED = 128  # strongest paths, which the synthesiser's errors blur
# Gain and phase of the single chip's channels, relative to the first.
TX_DB, TX_DEGREES = (0.0, -0.97, -1.91), (0.0, 11.4, 34.7)
RX_DB, RX_DEGREES = (0.0, -0.14, -0.27, -1.29), (0.0, 2.5, 5.6, 14.7)
RANGE_BIAS_M = UnitSpec.range_bias_m
TX_SHARE, RX_SHARE = 1.0, 0.5  # of a unit's spread; TI's receivers are closer
INTERFERERS = 5  # at most, around a unit
GAIN_ERROR_DB = 0.05  # of a calibration, for each degree of its phase error
# LLVM's last optimisations take half of the time to compile, and gain none here.
LEVEL = "xla_backend_optimization_level"
QUICK: dict[str, int] = {} if LEVEL in os.environ.get("XLA_FLAGS", "") else {LEVEL: 1}


class Hardware(NamedTuple):
    """Errors of a radar's channels, the same in every frame."""

    leakage: Complex[np.ndarray, "tx rx sample"]  # ADC counts, before the channels
    frequency: Float[np.ndarray, "tx rx"]  # delay of a channel in range bins
    phase: Complex[np.ndarray, "tx rx"]  # factor of a channel
    calibration: Complex[np.ndarray, "tx rx"] | None = None  # `phase` as measured
    front_end: FrontEnd | None = None
    interferers: Interferers | None = None
    noise_db: float = 0.0
    gain_db: float = 0.0


def make_unit_hardware(unit: UnitSpec, radar: RadarSpec) -> Hardware:
    """Return the hardware of a unit's single chip."""
    default = make_hardware("single_chip", radar)
    channels = (radar.num_tx, radar.num_rx)
    random = np.random.default_rng([unit.board or 0, *b"board"])
    phase, leakage = default.phase, default.leakage
    if unit.board is not None:
        draws = (random.standard_normal((2, count)) for count in channels)
        tx, rx = (
            _factor(share * unit.channel_db * db, share * unit.channel_degrees * angle)
            for share, (db, angle) in zip((TX_SHARE, RX_SHARE), draws, strict=True)
        )
        phase = tx[:, None] * rx
        phase = phase / phase[0, 0]
        leakage = leakage * np.exp(2j * np.pi * random.random((*channels, 1)))
    calibration = None
    if (error := unit.calibration_degrees) is not None:
        db, angle = random.standard_normal((2, *channels))
        calibration = phase * _factor(error * GAIN_ERROR_DB * db, error * angle)
    return Hardware(
        leakage * 10 ** (unit.leakage_db / 20),
        np.full(channels, unit.range_bias_m / radar.range_resolution_m),
        phase,
        calibration,
        make_front_end(random, unit, radar),
        _interferers(unit, radar),
        unit.noise_db,
        unit.gain_db,
    )


def _interferers(unit, radar):
    """Return the radars around a unit, padded to `INTERFERERS`; None without any."""
    if not unit.interferers:
        return None
    weight = np.geomspace(1.0, 0.3, INTERFERERS) * unit.interferer_counts
    weight[unit.interferers :] = 0.0
    key = jax.random.fold_in(jax.random.key(unit.board or 0), INTERFERERS)
    return draw_interferers(
        key, radar, count=INTERFERERS, amplitude=jnp.asarray(weight, jnp.float32)
    )


def _factor(db, degrees):
    return 10 ** (db / 20) * np.exp(1j * np.radians(degrees))


def make_hardware(sensor: str, radar: RadarSpec) -> Hardware:
    """Return the hardware of the rig's radar `sensor`, with the default unit.

    The leakage crosses the board, a few centimetres. Channels differ in gain, phase and
    delay. The cascade's calibration file lists them; the single chip's were measured on
    another AWR1843.
    """
    random = np.random.default_rng([*sensor.encode()])
    channels = (radar.num_tx, radar.num_rx)
    shape = (LEAKS, *channels, 1)
    each = np.array([1.0, 2.0, 4.0]).reshape(-1, 1, 1, 1)
    metres = random.uniform(0.02, 0.05, shape) * each
    amplitude = LINK.leakage_counts / each * random.uniform(0.5, 1.2, shape)
    bins = metres / radar.range_resolution_m / radar.num_samples
    turns = bins * np.arange(radar.num_samples) + random.random(shape)
    leakage = (amplitude * np.exp(2j * np.pi * turns)).sum(0)
    if sensor != "cascade":
        late = np.full(channels, RANGE_BIAS_M / radar.range_resolution_m)
        sides = ((TX_DB, TX_DEGREES), (RX_DB, RX_DEGREES))
        tx, rx = (_factor(np.array(db), np.array(degrees)) for db, degrees in sides)
        return Hardware(leakage, late, tx[: radar.num_tx, None] * rx[: radar.num_rx])
    frequency = 0.05 * random.standard_normal(channels)
    gain = 1 + 0.05 * random.standard_normal(channels)
    phase = gain * np.exp(2j * np.pi * random.random(channels))
    phase = phase / phase[0, 0]
    return Hardware(leakage, frequency - frequency[0, 0], phase, calibration=phase)


def sample_frame(
    key: Key[Array, ""], paths: Paths, hardware: Hardware, radar: RadarSpec
) -> Int[Array, "tx rx chirp sample 2"]:
    """Return the ADC's samples of a frame: I and Q in int16, clipped at full scale.

    The call does not wait for the samples: JAX computes them while the caller prepares
    the next frame.
    """
    used = len(paths.power)
    size = -(-max(used, 1) // CAPACITY) * CAPACITY

    def padded(column):
        column = np.asarray(column, np.float32)
        empty = np.zeros((size - used, *column.shape[1:]), np.float32)
        return jnp.asarray(np.concatenate([column, empty]))

    amplitude = LINK.counts(paths.power)
    cycles_per_s = 2 * radar.slope_hz_per_s / SPEED_OF_LIGHT
    legs = np.linalg.norm(paths.xyz, axis=-1) + np.linalg.norm(paths.departure, axis=-1)
    rate = 2 * np.pi * cycles_per_s * legs / 2 * amplitude
    loud, noise = np.argsort(-rate, kind="stable"), LINK.noise_power(radar)
    xyz, velocity, departure, amplitude, rate = (
        padded(column[loud])
        for column in (paths.xyz, paths.velocity, paths.departure, amplitude, rate)
    )
    return _sampled(
        key,
        Scatterers(xyz, velocity, amplitude, departure),
        rate[:SKIRTED],
        jnp.asarray(hardware.leakage, jnp.complex64),
        jnp.asarray(channel_factors(hardware, radar), jnp.complex64),
        hardware.front_end,
        hardware.interferers,
        np.float32((noise / 2) ** 0.5 * 10 ** (hardware.noise_db / 20)),
        np.float32(10 ** (hardware.gain_db / 20)),
        radar,
    )


def channel_factors(
    hardware: Hardware, radar: RadarSpec
) -> Complex[np.ndarray, "tx rx sample"]:
    """Return the factors of the samples: gain, phase, and delay as a frequency."""
    time = np.arange(radar.num_samples) / radar.num_samples
    turns = np.exp(2j * np.pi * hardware.frequency[..., None] * time)
    return turns * hardware.phase[..., None]


@jit(static_argnames="radar", compiler_options=QUICK)
def _sampled(
    key,
    scatterers,
    rate,
    leakage,
    channels,
    front_end,
    interferers,
    noise_counts,
    gain,
    radar,
):
    """Return samples as int16 pairs; the receivers add their noise after the channels.

    `rate` is the change per second of the first scatterers' beats, which the errors of
    the sampling time multiply. `noise_counts` is the rms noise of I and of Q, and
    `gain` multiplies everything.
    """
    # A frame's time is that of its first chirp.
    echoes = simulate_cube(key, scatterers, radar, at="start")
    strong = Scatterers(*(column[: len(rate)] for column in scatterers))
    change = 1j * simulate_cube(key, strong._replace(amplitude=rate), radar, at="start")
    late_s = sampling_errors(jax.random.fold_in(key, 1), radar, SYNTHESISER)
    echoes += change * late_s[:, None]
    cube = (echoes + leakage[:, :, None]) * channels[:, :, None]
    if interferers is not None:  # their clocks drift: each frame has its own start
        start, phases = jax.random.split(jax.random.fold_in(key, 3))
        start_s = jax.random.uniform(start, interferers.period_s.shape)
        now = interferers._replace(start_s=start_s * interferers.period_s)
        cube += crossing_chirps(phases, now, radar)
    noise = jax.random.normal(key, (*radar.cube_shape, 2)) * noise_counts
    counts = jnp.stack([cube.real, cube.imag], -1) + noise
    if front_end is not None:
        heard = jax.lax.complex(counts[..., 0], counts[..., 1])
        heard = distort(jax.random.fold_in(key, 2), heard, front_end, radar)
        counts = jnp.stack([heard.real, heard.imag], -1)
    counts = jnp.rint(gain * counts)
    return jnp.clip(counts, -FULL_SCALE, FULL_SCALE - 1).astype(jnp.int16)
