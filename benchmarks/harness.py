"""Time jradar's calls and their peers' in the same interleaved rounds.

Compiling is timed apart from running. All calls of a case run once to compile and once
to warm up; results that should be equal are compared. Rounds follow, each in random
order. In a round every call runs once untimed, so that no call pays for the caches that
another left behind, and once timed until its result is ready. The figure of merit is
the ratio of our median to the fastest peer's.
"""

import random
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

Call = Callable[[], Any]


class Case(NamedTuple):
    """Our call and the peers' calls, named after what is computed and its size.

    `same(ours, peer)` returns whether the results agree; None if the peers compute
    less, or something else.
    """

    name: str
    ours: Call
    peers: dict[str, Call]
    same: Callable[[Any, Any], bool] | None = None


class Timing(NamedTuple):
    """Milliseconds of one case; `compile_ms` is the first call minus the median."""

    name: str
    compile_ms: float
    median_ms: float
    min_ms: float
    peers_ms: dict[str, float]

    @property
    def best_peer(self) -> str | None:
        """Name of the fastest peer; None without peers."""
        return min(self.peers_ms, key=lambda name: self.peers_ms[name], default=None)

    @property
    def ratio(self) -> float | None:
        """Our median divided by the fastest peer's; None without peers."""
        peer = self.best_peer
        return None if peer is None else self.median_ms / self.peers_ms[peer]


def measure(
    case: Case, *, seconds: float = 3.0, least: int = 5, most: int = 200
) -> Timing:
    """Time a case for about `seconds`, in `least` to `most` rounds.

    Raises ValueError for a peer whose result differs from ours.
    """
    calls = {"": case.ours, **case.peers}
    first = {name: _elapsed(call) for name, call in calls.items()}
    results = {name: jax.block_until_ready(call()) for name, call in calls.items()}
    for name in case.peers:
        if case.same and not case.same(results[""], results[name]):
            raise ValueError(f"{case.name}: the result of {name} differs from ours")
    times: dict[str, list[float]] = {name: [] for name in calls}
    begin = time.perf_counter()
    for count in range(1, most + 1):
        for name in random.sample([*calls], len(calls)):
            jax.block_until_ready(calls[name]())
            times[name].append(_elapsed(calls[name]))
        if count >= least and time.perf_counter() - begin > seconds:
            break
    medians = {name: 1e3 * statistics.median(values) for name, values in times.items()}
    ours = medians.pop("")
    return Timing(
        case.name, 1e3 * first[""] - ours, ours, 1e3 * min(times[""]), medians
    )


def available(makers: dict[str, Callable[[], Call]]) -> dict[str, Call]:
    """Return the peers that can be made, from functions that make them.

    Prints why a peer is left out: its package is missing or too old to import.
    """
    peers = {}
    for name, make in makers.items():
        try:
            peers[name] = make()
        except (ImportError, AttributeError) as error:
            print(f"without {name}: {error}", file=sys.stderr)
    return peers


def random_params(network: Any, *inputs: Any) -> Any:
    """Return random parameters without zeros, which would hide other layers."""
    rng = np.random.default_rng(1)

    def fill(leaf):
        fan_in = np.prod(leaf.shape[:-1]) if leaf.ndim > 1 else 4
        return jnp.asarray(rng.normal(size=leaf.shape) / np.sqrt(fan_in), leaf.dtype)

    return jax.tree.map(fill, jax.eval_shape(network.init, jax.random.key(0), *inputs))


def _elapsed(call):
    begin = time.perf_counter()
    jax.block_until_ready(call())
    return time.perf_counter() - begin
