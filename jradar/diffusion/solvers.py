"""From noise to image: solvers of the probability-flow ODE (Eq. 8).

With sigma(t) = t the ODE is dx/dsigma = (x - D(x; sigma)) / sigma. A solver walks the N
levels sigma_0 > ... > sigma_N-1 in one `lax.scan`. The last step, to sigma = 0, is the
denoised image itself and stands outside.

    solver                     evaluations   error for steps h
    euler                      N             h
    heun                       2 N - 1       h^2
    ipndm2, ipndm3, ipndm4     N             h^2 after their first, short steps
    dpm++2m, dpm++3m           N             h^2, h^3

Heun is the paper's. The multistep solvers reuse earlier evaluations: iPNDM (Zhang &
Chen 2023) extrapolates slopes with the weights of equal steps; DPM-Solver++ (Lu et al.
2022) extrapolates the denoised image over ln sigma, here with the exact integral of the
polynomial, and walks levels that are equal in ln sigma.

A solver is an object with its own levels and rule: a new one is a class here, or an
instance, and an entry in `SOLVERS`. Functions that take a denoiser are not jitted: jit
the whole around them.
"""

import abc
import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key

from jradar.diffusion.noise import NoiseSpec, karras_sigmas, log_sigmas
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

    def evaluations(self, steps: int) -> int:
        """Return how often `steps` steps evaluate the network."""
        return steps

    def levels(self, steps: int, noise: NoiseSpec) -> np.ndarray:
        """Return the levels that the solver walks, `[steps]`, on the host."""
        return karras_sigmas(steps, noise)

    @abc.abstractmethod
    def solve(self, denoise: Denoiser, x: Image, sigmas: np.ndarray) -> Image:
        """Solve the ODE from `x` at level `sigmas[0]` through all levels down to 0."""


class Heun(Solver):
    """Heun's method of second order."""

    def evaluations(self, steps: int) -> int:
        """Return how often `steps` steps evaluate the network."""
        return 2 * steps - 1

    def solve(self, denoise: Denoiser, x: Image, sigmas: np.ndarray) -> Image:
        """Solve the ODE from `x`; see `Solver`."""
        levels = jnp.asarray(sigmas, x.dtype)
        pairs = jnp.stack([levels[:-1], levels[1:]], axis=-1)

        def step(x, pair):
            return heun_step(denoise, x, pair[0], pair[1]), None

        end, _ = jax.lax.scan(step, x, pairs)
        return denoise(end, levels[-1])


@dataclasses.dataclass(frozen=True)
class Multistep(Solver):
    """Steps x' = keep x + weights . history, with a table made on the host.

    The history holds slopes, or with `exponential` denoised images, newest first.
    """

    order: int
    exponential: bool = False

    def levels(self, steps: int, noise: NoiseSpec) -> np.ndarray:
        """Return levels equal in ln sigma with `exponential`, else Karras et al.'s."""
        return (log_sigmas if self.exponential else karras_sigmas)(steps, noise)

    def table(self, sigmas: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return `keep` [step] and `weights` [step, order] in float64, on the host.

        The first steps have too short a history and are of lower order.
        """
        steps = len(sigmas) - 1
        weights = np.zeros((steps, self.order))
        for i in range(steps):
            past = min(i + 1, self.order)
            if self.exponential:
                nodes = np.log(sigmas[i]) - np.log(sigmas[i + 1 - past : i + 1])[::-1]
                weights[i, :past] = _exponential_weights(
                    nodes, np.log(sigmas[i] / sigmas[i + 1])
                )
            else:
                step = sigmas[i + 1] - sigmas[i]
                weights[i, :past] = step * np.array(ADAMS[past - 1])
        keep = sigmas[1:] / sigmas[:-1] if self.exponential else np.ones(steps)
        return keep, weights

    def solve(self, denoise: Denoiser, x: Image, sigmas: np.ndarray) -> Image:
        """Solve the ODE from `x`; see `Solver`."""
        keep, weights = self.table(sigmas)
        levels, keep, weights = (
            jnp.asarray(v, x.dtype) for v in (sigmas[:-1], keep, weights)
        )

        def step(carry, given):
            x, history = carry
            sigma, keep, weights = given
            newest = denoise(x, sigma)
            if not self.exponential:
                newest = (x - newest) / sigma
            history = jnp.concatenate([newest[None], history[:-1]])
            x = keep * x + jnp.tensordot(weights, history, 1)
            return (x, history), None

        history = jnp.zeros((weights.shape[1], *x.shape), x.dtype)
        (end, _), _ = jax.lax.scan(step, (x, history), (levels, keep, weights))
        return denoise(end, jnp.asarray(sigmas[-1], x.dtype))


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
        Multistep("dpm++2m", 2, exponential=True),
        Multistep("dpm++3m", 3, exponential=True),
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
    return solver.solve(denoise, start, solver.levels(steps, noise))


def heun_step(
    denoise: Denoiser,
    x: Image,
    sigma: Float[Array, ""],
    after: Float[Array, ""],
) -> Image:
    """Take one step of second order from level `sigma` to level `after` > 0."""
    slope = (x - denoise(x, sigma)) / sigma
    euler = x + (after - sigma) * slope
    slope_after = (euler - denoise(euler, after)) / after
    return x + (after - sigma) * (slope + slope_after) / 2


def _exponential_weights(nodes, step):
    """Weights of values at `nodes` for the integral of exp(s - step) over 0 .. step.

    They are exact for polynomials of degree `len(nodes) - 1`.
    """
    moments = [-np.expm1(-step)]
    for degree in range(1, len(nodes)):
        moments.append(step**degree - degree * moments[-1])
    return np.linalg.solve(np.vander(nodes, increasing=True).T, moments)
