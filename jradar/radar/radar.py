"""A radar as it was built and measured: its description and its calibration.

A cube never travels without it: with another chirp's slope a wall stands at half its
distance, and nothing else looks wrong.
"""

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Inexact

from jradar.options.sensor import RadarSpec


@functools.partial(
    jax.tree_util.register_dataclass,
    data_fields=["channels", "beat_bins", "leakage", "range_bias_m"],
    meta_fields=["spec"],
)
@dataclasses.dataclass(frozen=True, repr=False, eq=False)
class Radar:
    """A `RadarSpec` and the calibration of one unit: a pytree, the spec is static.

    Samples are multiplied by `channels`. Echoes of each pair of antennas lie
    `beat_bins` range bins too far. `leakage` from transmitters to receivers fills the
    range bins 1 .. N/2 of the plain FFT after a Blackman window, in ADC counts.
    `range_bias_m` is subtracted from ranges. Parts that were not measured are None.
    Raises ValueError for parts that do not fit the array.
    """

    spec: RadarSpec
    channels: Complex[Array | np.ndarray, "*batch tx rx"] | None = None
    beat_bins: Float[Array | np.ndarray, "*batch tx rx"] | None = None
    leakage: Complex[Array | np.ndarray, "*batch tx rx half_range"] | None = None
    range_bias_m: Float[Array | np.ndarray, "*batch"] | float = 0.0

    def __post_init__(self):
        """Refuse arrays of another shape; JAX's placeholders have none."""
        if not isinstance(self.spec, RadarSpec):
            raise ValueError(
                f"Radar of {type(self.spec).__name__}, expected a RadarSpec, such as "
                "RadarSpec.awr1843()"
            )
        pair = self.spec.num_tx, self.spec.num_rx
        expected = {
            "channels": pair,
            "beat_bins": pair,
            "leakage": (*pair, self.spec.num_samples // 2),
        }
        for name, shape in expected.items():
            found = getattr(getattr(self, name), "shape", None)
            if isinstance(found, tuple) and found[-len(shape) :] != shape:
                axes = "[tx, rx, range bin]" if len(shape) == 3 else "[tx, rx]"
                raise ValueError(
                    f"{name} has shape {found}, {self.spec.name} needs {shape} {axes}: "
                    "was it measured with another radar?"
                )

    @property
    def calibrated(self) -> bool:
        """Whether the channels were measured."""
        return self.channels is not None or self.beat_bins is not None

    def with_factors(self, factors: Inexact[Any, "virtual"]) -> "Radar":
        """Return the radar with further factors of its channels, and of its leakage.

        Factors are those of `jradar.calibration`, transmitter by transmitter. Raises
        ValueError for another number of them.
        """
        pair = self.spec.num_tx, self.spec.num_rx
        if np.size(factors) != self.spec.num_virtual:
            raise ValueError(
                f"{np.size(factors)} factors, {self.spec.name} needs "
                f"{self.spec.num_virtual}: one for each of {pair[0]} tx x {pair[1]} rx"
            )
        each = jnp.reshape(jnp.asarray(factors, jnp.complex64), pair)
        return dataclasses.replace(
            self,
            channels=each if self.channels is None else self.channels * each,
            leakage=None if self.leakage is None else self.leakage * each[..., None],
        )

    def once_calibrated(self) -> "Radar":
        """Return the radar that describes the samples after `calibrate`."""
        return dataclasses.replace(self, channels=None, beat_bins=None)

    def __repr__(self) -> str:
        """One line: name, shape of a frame, and what was measured."""
        shape = " x ".join(map(str, self.spec.cube_shape))
        parts = {
            "channels": self.channels,
            "beat frequencies": self.beat_bins,
            "leakage": self.leakage,
        }
        known = [name for name, part in parts.items() if part is not None]
        bias = self.range_bias_m
        if isinstance(bias, float | int | np.number | np.ndarray) and np.any(bias):
            known.append(f"range bias {bias!s:.9} m")
        measured = ", ".join(known) or "not calibrated"
        return f"Radar({self.spec.name!r}, {shape} [tx, rx, chirp, sample], {measured})"
