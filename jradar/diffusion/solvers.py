"""From noise to image: solvers of the probability-flow ODE (Eq. 8), and with churn.

With sigma(t) = t the ODE is dx/dsigma = (x - D(x; sigma)) / sigma. A solver walks the N
levels sigma_0 > ... > sigma_N-1 in one `lax.scan`; the last step, to sigma = 0, is the
denoised image itself and stands outside.

    solver                     evaluations   error for steps h
    euler                      N             h
    heun                       2 N - 1       h^2
    ipndm2, ipndm3, ipndm4     N             h^2 after their first, short steps
    dpm++2m, dpm++3m           N             h^2, h^3

Heun is the paper's; the multistep solvers reuse earlier evaluations. iPNDM (Zhang &
Chen 2023) extrapolates slopes with the weights of equal steps; DPM-Solver++ (Lu et al.
2022) extrapolates the denoised image over ln sigma, here with the exact integral of the
polynomial, and walks levels equal in ln sigma.

Functions that take a denoiser are not jitted: jit the whole around them.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key

from jradar.diffusion.noise import NoiseSpec, karras_sigmas, log_sigmas
from jradar.diffusion.precondition import Denoiser

Image = Float[Array, "*batch row column channel"]
Path = Float[Array, "step *batch row column channel"]

SOLVERS = ("heun", "euler", "ipndm2", "ipndm3", "ipndm4", "dpm++2m", "dpm++3m")

# Adams-Bashforth weights of the newest slopes for equal steps.
ADAMS = (
    (1.0,),
    (3 / 2, -1 / 2),
    (23 / 12, -16 / 12, 5 / 12),
    (55 / 24, -59 / 24, 37 / 24, -9 / 24),
)


def sample(
    key: Key[Array, ""],
    denoise: Denoiser,
    shape: tuple[int, ...],
    *,
    noise: NoiseSpec,
    solver: str = "heun",
    steps: int = 18,
    temperature: float = 1.0,
    churn: float = 0.0,
    churn_range: tuple[float, float] = (0.0, math.inf),
    churn_noise: float = 1.0,
    return_path: bool = False,
) -> Image | Path:
    """Draw images of `shape` [*batch, row, column, channel] with one of `SOLVERS`.

    `steps=1` is the one-step estimate, nearly the mean of all images that the
    condition allows. `temperature` scales the noise that a draw starts from: below 1
    images differ less from one another, and none is as unlikely. `churn` > 0 adds
    noise in every step of Heun (`heun_churn`).
    """
    start_key, churn_key = jax.random.split(key) if churn else (key, key)
    start = temperature * noise.sigma_max * jax.random.normal(start_key, shape)
    schedule = log_sigmas if solver.startswith("dpm++") else karras_sigmas
    sigmas = schedule(steps, noise)
    if not churn:
        return solve(denoise, start, sigmas, solver=solver, return_path=return_path)
    if solver != "heun":
        raise ValueError(f"{churn=} with {solver=}: only Heun's method takes churn")
    return heun_churn(
        churn_key,
        denoise,
        start,
        sigmas,
        churn=churn,
        churn_range=churn_range,
        churn_noise=churn_noise,
        return_path=return_path,
    )


def solve(
    denoise: Denoiser,
    x: Image,
    sigmas: np.ndarray,
    *,
    solver: str = "heun",
    return_path: bool = False,
) -> Image | Path:
    """Solve the ODE from `x` at level `sigmas[0]` through all levels down to 0.

    `return_path=True` returns the image at every level, from `x` to the result.
    """
    if solver not in SOLVERS:
        raise ValueError(f"{solver=}, expected one of {SOLVERS}")
    levels = jnp.asarray(sigmas, x.dtype)
    if solver == "heun":
        pairs = jnp.stack([levels[:-1], levels[1:]], axis=-1)

        def heun(x, pair):
            after = heun_step(denoise, x, pair[0], pair[1])
            return after, after if return_path else None

        end, path = jax.lax.scan(heun, x, pairs)
    else:
        end, path = _multistep(denoise, x, sigmas, solver, return_path)
    return _finish(x, path, denoise(end, levels[-1]))


def heun_step(
    denoise: Denoiser,
    x: Image,
    sigma: Float[Array, ""],
    after: Float[Array, ""],
) -> Image:
    """One step of second order from level `sigma` to level `after` > 0."""
    slope = (x - denoise(x, sigma)) / sigma
    euler = x + (after - sigma) * slope
    slope_after = (euler - denoise(euler, after)) / after
    return x + (after - sigma) * (slope + slope_after) / 2


def heun_churn(
    key: Key[Array, ""],
    denoise: Denoiser,
    x: Image,
    sigmas: np.ndarray,
    *,
    churn: float,
    churn_range: tuple[float, float] = (0.0, math.inf),
    churn_noise: float = 1.0,
    return_path: bool = False,
) -> Image | Path:
    """Heun's method that first adds noise in each step (Karras et al., Algorithm 2).

    Levels within `churn_range` (S_min, S_max) are raised by the fraction
    min(`churn` / N, sqrt 2 - 1), with noise of standard deviation `churn_noise`.
    """
    low, high = churn_range
    raise_by = min(churn / len(sigmas), math.sqrt(2) - 1)
    raised = np.where((sigmas >= low) & (sigmas <= high), (1 + raise_by), 1.0) * sigmas
    added = churn_noise * np.sqrt(raised**2 - sigmas**2)
    raised, added, levels = (jnp.asarray(v, x.dtype) for v in (raised, added, sigmas))
    keys = jax.random.split(key, len(sigmas))

    def stir(key, x, amount):
        return x + amount * jax.random.normal(key, x.shape, x.dtype)

    def step(x, given):
        key, amount, sigma, after = given
        x = heun_step(denoise, stir(key, x, amount), sigma, after)
        return x, x if return_path else None

    end, path = jax.lax.scan(step, x, (keys[:-1], added[:-1], raised[:-1], levels[1:]))
    result = denoise(stir(keys[-1], end, added[-1]), raised[-1])
    return _finish(x, path, result)


def _finish(start, path, result):
    """The result, or start, steps and result as one array."""
    if path is None:
        return result
    return jnp.concatenate([start[None], path, result[None]])


def _multistep(denoise, x, sigmas, solver, return_path):
    """Steps x' = keep * x + weights . history, with a table made on the host."""
    extrapolates_slopes = not solver.startswith("dpm++")
    keep, weights = multistep_table(sigmas, solver=solver)
    levels, keep, weights = (
        jnp.asarray(v, x.dtype) for v in (sigmas[:-1], keep, weights)
    )

    def step(carry, given):
        x, history = carry
        sigma, keep, weights = given
        newest = denoise(x, sigma)
        if extrapolates_slopes:
            newest = (x - newest) / sigma
        history = jnp.concatenate([newest[None], history[:-1]])
        x = keep * x + jnp.tensordot(weights, history, 1)
        return (x, history), x if return_path else None

    history = jnp.zeros((weights.shape[1], *x.shape), x.dtype)
    (end, _), path = jax.lax.scan(step, (x, history), (levels, keep, weights))
    return end, path


def multistep_table(
    sigmas: np.ndarray, *, solver: str
) -> tuple[np.ndarray, np.ndarray]:
    """`keep` [step] and `weights` [step, order], newest first, in float64 on the host.

    The first steps have too short a history and are of lower order.
    """
    order = {"euler": 1, "dpm++2m": 2, "dpm++3m": 3}.get(solver) or int(solver[-1])
    steps = len(sigmas) - 1
    weights = np.zeros((steps, order))
    for i in range(steps):
        past = min(i + 1, order)
        if solver.startswith("dpm++"):
            nodes = np.log(sigmas[i]) - np.log(sigmas[i + 1 - past : i + 1])[::-1]
            weights[i, :past] = _exponential_weights(
                nodes, np.log(sigmas[i] / sigmas[i + 1])
            )
        else:
            step = sigmas[i + 1] - sigmas[i]
            weights[i, :past] = step * np.array(ADAMS[past - 1])
    if solver.startswith("dpm++"):
        return sigmas[1:] / sigmas[:-1], weights
    return np.ones(steps), weights


def _exponential_weights(nodes, step):
    """Weights of values at `nodes` for the integral of exp(s - step) over 0 .. step.

    Exact for polynomials of one degree less than there are nodes.
    """
    moments = [-np.expm1(-step)]
    for degree in range(1, len(nodes)):
        moments.append(step**degree - degree * moments[-1])
    return np.linalg.solve(np.vander(nodes, increasing=True).T, moments)
