"""How long do the angles of detections take?

Every case is one frame's detections: `directions`, and as its peer SciPy's 2-D FFT
over the same zero-padded grid with an argmax per cell, as published radar chains do.

    python -m benchmarks.bench_angle
"""

import statistics
import time
from collections.abc import Callable, Iterator

import jax
import jax.numpy as jnp
import numpy as np
import scipy.fft

from jradar.radar import RadarSpec, directions

ROUNDS = 40
CASES = [  # radar, detections, elevation and azimuth bins
    (RadarSpec.awr1843(), 1024, 32, 64),
    (RadarSpec.cascade(), 256, 64, 128),
]


def cases() -> Iterator[tuple[str, Callable, dict[str, Callable]]]:
    """Name, our function and its peers, each without arguments and synchronous."""
    for radar, count, num_elevation, num_azimuth in CASES:
        rng = np.random.default_rng(0)
        parts = rng.normal(size=(2, count, radar.num_virtual)).astype(np.float32)
        cells = parts[0] + 1j * parts[1]
        on_device = jnp.asarray(cells)
        bins = {"num_azimuth": num_azimuth, "num_elevation": num_elevation}

        def ours(cells=on_device, radar=radar, bins=bins):
            return jax.block_until_ready(directions(cells, radar, **bins))

        def peer(cells=cells, radar=radar, shape=(num_elevation, num_azimuth)):
            return fourier_peak(cells, radar, shape)

        name = f"{radar.name}, {count} detections, {num_elevation} x {num_azimuth} bins"
        yield name, ours, {"scipy.fft.fft2": peer}


def fourier_peak(
    cells: np.ndarray, radar: RadarSpec, shape: tuple[int, int]
) -> np.ndarray:
    """Flat bin of the strongest direction of each cell, by a zero-padded 2-D FFT.

    Where antennas share a position, the last one counts.
    """
    column, row = radar.virtual_positions.T
    grid = np.zeros((len(cells), row.max() + 1, column.max() + 1), np.complex64)
    grid[:, row, column] = cells
    spectrum = scipy.fft.fft2(grid, s=shape)
    power = spectrum.real**2 + spectrum.imag**2
    return power.reshape(len(cells), -1).argmax(1)


def timed(function: Callable) -> float:
    """Milliseconds that one call takes."""
    start = time.perf_counter()
    function()
    return 1e3 * (time.perf_counter() - start)


def main() -> None:
    """Compile and first run, then medians over rounds in which all take turns."""
    for name, ours, peers in cases():
        first = timed(ours)
        functions = {"jradar": ours, **peers}
        rounds = [{k: timed(f) for k, f in functions.items()} for _ in range(ROUNDS)]
        median = {k: statistics.median(r[k] for r in rounds) for k in functions}
        print(f"{name}: jradar {median['jradar']:.3f} ms (compiling {first:.0f} ms)")
        for peer in peers:
            ratio = median["jradar"] / median[peer]
            print(f"    {peer} {median[peer]:.3f} ms, ratio {ratio:.4f}")


if __name__ == "__main__":
    main()
