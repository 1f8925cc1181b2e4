"""Velocities beyond the unambiguous one: the fold, estimated from the virtual array.

A target that is faster than `max_velocity_mps` appears `fold` times twice that velocity
away. The phases between its transmitters' chirps are then compensated wrongly, and its
direction is wrong too:

    fold k          adds 2 pi k f_t / num_tx to transmitter t, the f_t-th to fire
    right fold      the array's phases are a plane wave: the beam has full power
    wrong fold      they jump between transmitters: the beam is weaker

Folds that differ by num_tx look alike. Transmitters whose virtual antennas overlap
separate folds in every direction. A transmitter with a row of its own does not, because
a jump looks like another elevation.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from jradar.compiled import jit
from jradar.options.sensor import RadarSpec
from jradar.radar.angle.direction import directions
from jradar.radar.channels import compensate_tdm

TINY = 1e-30
MOST_DB = 99.0  # margin over a fold without any power


class Folds(NamedTuple):
    """The fold of each snapshot, and how clearly it was chosen."""

    fold: Int[Array, "*batch"]
    margin_db: Float[Array, "*batch"]  # beam power over that of the next best fold


@jit(static_argnames=("radar", "most", "num_azimuth", "num_elevation"))
def velocity_folds(
    snapshot: Complex[Array, "*batch virtual"],
    doppler_bin: Float[Array, "*batch"],
    radar: RadarSpec,
    *,
    most: int = 1,
    num_azimuth: int = 64,
    num_elevation: int = 32,
) -> Folds:
    """Return the fold, from -`most` to `most`, that makes each snapshot a plane wave.

    Snapshots are those of the spectrum, without `compensate_tdm`. The velocity is that
    of Doppler bin `doppler_bin + fold * num_chirps`. Of folds that look alike, the one
    with the lower speed is returned. Raises ValueError if `most` is negative.
    """
    if most < 0:
        raise ValueError(f"{most=}, expected 0 or more folds")
    choices = _choices(radar.num_tx, most)
    options: Any = {"num_azimuth": num_azimuth, "num_elevation": num_elevation}

    def beam_power(fold):
        wave = compensate_tdm(snapshot, doppler_bin + fold * radar.num_chirps, radar)
        azimuth, elevation = directions(wave, radar, **options)
        return _power_towards(wave, azimuth, elevation, radar)

    firsts = jnp.array([alike[0] for alike in choices], jnp.float32)
    power = jax.lax.map(beam_power, firsts)
    best = jnp.argmax(power, 0)
    chosen = jnp.take_along_axis(power, best[None], 0)[0]
    others = jnp.where(
        jnp.arange(len(choices))[:, None] == best.ravel()[None], 0.0, 1.0
    )
    next_best = (power * others.reshape(power.shape)).max(0)
    ratio = jnp.maximum(chosen, TINY) / jnp.maximum(next_best, TINY)
    return Folds(
        fold=_slowest(best, choices, doppler_bin / radar.num_chirps),
        margin_db=jnp.minimum(10 * jnp.log10(ratio), MOST_DB),
    )


def _choices(num_tx, most):
    """Folds up to `most`, in groups that look alike to `num_tx` transmitters; host."""
    folds = sorted(range(-most, most + 1), key=abs)
    groups: dict[int, list[int]] = {}
    for fold in folds:
        groups.setdefault(fold % num_tx, []).append(fold)
    return [*groups.values()]


def _slowest(best, choices, turns):
    """The fold of the group `best` with the lowest speed; `turns` is that of fold 0."""
    width = max(map(len, choices))
    table = jnp.array([group + [group[0]] * (width - len(group)) for group in choices])
    alike = table[best]
    place = jnp.argmin(jnp.abs(turns[..., None] + alike), -1)
    return jnp.take_along_axis(alike, place[..., None], -1)[..., 0]


def _power_towards(wave, azimuth, elevation, radar):
    """Power of the beam of all antennas in one direction for each snapshot."""
    shape = (*(1 for _ in wave.shape[1:]), radar.num_virtual)
    columns, rows = (jnp.asarray(p.reshape(shape), jnp.float32) for p in _metric(radar))
    w = jnp.sin(elevation)[..., None]
    u = (jnp.sin(azimuth) * jnp.cos(elevation))[..., None]
    beam = (wave * jnp.exp(-2j * jnp.pi * (columns * u + rows * w))).sum(-1)
    return beam.real**2 + beam.imag**2


def _metric(radar):
    """Columns and rows of the virtual antennas in wavelengths; host."""
    spacing = radar.spacing_wavelengths, radar.row_spacing_wavelengths
    return (radar.virtual_positions * np.array(spacing)).T
