"""From noise to image: solvers of the probability-flow ODE (Eq. 8).

With sigma(t) = t the ODE is dx/dsigma = (x - D(x; sigma)) / sigma. A solver walks the N
levels sigma_0 > ... > sigma_N-1 in one `lax.scan`. The last step, to sigma = 0, is the
denoised image itself, outside the scan.

    solver                     evaluations   error for steps h
    euler                      N             h
    heun                       2 N - 1       h^2
    ipndm2, ipndm3, ipndm4     N             h^2 after their first, short steps

Heun is the paper's. iPNDM (Zhang & Chen 2023) reuses earlier evaluations: it
extrapolates slopes with the weights of equal steps.

A solver is an object with its own rule: a new one is a class here, or an instance, and
an entry in `SOLVERS`. Functions that take a denoiser are not jitted: jit the whole
around them.
"""

import abc
import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key

from jradar.diffusion.noise import NoiseSpec, karras_sigmas
from jradar.diffusion.precondition import Denoiser

Image = Float[Array, "*batch row column channel"]

# Adams-Bashforth weights of the newest slopes for equal steps.
ADAMS = (
    (1.0,),
    (3 / 2, -1 / 2),
    (23 / 12, -16 / 12, 5 / 12),
    (55 / 24, -59 / 24, 37 / 24, -9 / 24),
)


@dataclasses.dataclass(frozen=True)
class Solver(abc.ABC):
    """A rule that walks noise levels: hashable, so that it can be a static argument."""

    name: str

    @abc.abstractmethod
    def solve(self, denoise: Denoiser, x: Image, sigmas: np.ndarray) -> Image:
        """Solve the ODE from `x` at level `sigmas[0]` through all levels down to 0."""


class Heun(Solver):
    """Heun's method of second order."""

    def solve(self, denoise: Denoiser, x: Image, sigmas: np.ndarray) -> Image:
        """Solve the ODE from `x`; see `Solver`."""
        levels = jnp.asarray(sigmas, x.dtype)

        def step(x, pair):
            sigma, after = pair
            slope = (x - denoise(x, sigma)) / sigma
            euler = x + (after - sigma) * slope
            slope_after = (euler - denoise(euler, after)) / after
            return x + (after - sigma) * (slope + slope_after) / 2, None

        end, _ = jax.lax.scan(step, x, (levels[:-1], levels[1:]))
        return denoise(end, levels[-1])


@dataclasses.dataclass(frozen=True)
class Multistep(Solver):
    """Steps x' = x + weights . slopes, newest first; the first ones of lower order."""

    order: int

    def solve(self, denoise: Denoiser, x: Image, sigmas: np.ndarray) -> Image:
        """Solve the ODE from `x`; see `Solver`."""
        weights = np.zeros((len(sigmas) - 1, self.order))
        for i, step in enumerate(np.diff(sigmas)):
            past = min(i + 1, self.order)
            weights[i, :past] = step * np.array(ADAMS[past - 1])
        levels, weights = (jnp.asarray(v, x.dtype) for v in (sigmas, weights))

        def step(carry, given):
            x, slopes = carry
            sigma, weights = given
            newest = (x - denoise(x, sigma)) / sigma
            slopes = jnp.concatenate([newest[None], slopes[:-1]])
            return (x + jnp.tensordot(weights, slopes, 1), slopes), None

        slopes = jnp.zeros((self.order, *x.shape), x.dtype)
        (end, _), _ = jax.lax.scan(step, (x, slopes), (levels[:-1], weights))
        return denoise(end, levels[-1])


HEUN = Heun("heun")
FEWEST_HEUN = 8  # steps below which the levels are too far apart for Heun's method
SOLVERS: dict[str, Solver] = {
    solver.name: solver
    for solver in (
        HEUN,
        Multistep("euler", 1),
        Multistep("ipndm2", 2),
        Multistep("ipndm3", 3),
        Multistep("ipndm4", 4),
    )
}


def solver_for(steps: int) -> Solver:
    """Return the solver for a number of steps: Heun's method, or iPNDM below 8.

    In few steps Heun's correction overshoots; iPNDM starts as Euler's method.
    """
    return HEUN if steps >= FEWEST_HEUN else SOLVERS["ipndm3"]


def sample(
    key: Key[Array, ""],
    denoise: Denoiser,
    shape: tuple[int, ...],
    *,
    noise: NoiseSpec,
    solver: Solver | None = None,
    steps: int = 18,
    temperature: float | Float[Array, ""] = 1.0,
) -> Image:
    """Draw images of `shape` [*batch, row, column, channel].

    `solver` is by default that of `solver_for`. `steps=1` is the one-step estimate,
    nearly the mean of all images that the condition allows. `temperature` scales the
    noise from which a draw starts: below 1, images differ less from one another, and
    unlikely ones are rarer.
    """
    start = temperature * noise.sigma_max * jax.random.normal(key, shape)
    solver = solver or solver_for(steps)
    denoise = jax.jit(denoise)  # traced once, however often the solver names it
    return solver.solve(denoise, start, karras_sigmas(steps, noise))
