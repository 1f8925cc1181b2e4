"""Training losses by grid and method.

    LOSSES["view"]["marginal"](key, denoise, clean, noise=noise) -> scalar

view      range images; their pixels of validity 0 do not count
polar     occupancy images in the plane of a row of antennas
columns   occupied voxels of a map, a column of heights for each pixel

The losses themselves are in `jradar.diffusion`. A nearness is learnt as an occupancy
is; only the target differs.
"""

from collections.abc import Callable
from typing import Any

import jax

from jradar.diffusion import (
    LossSpec,
    denoising_loss,
    mixture_loss,
    regression_loss,
    where_known,
)
from jradar.diffusion.occupancy_losses import (
    SHARE,
    dice_loss,
    estimate_loss,
    log_odds_loss,
    occupancy_loss,
)
from jradar.training.step import Loss
from jradar.training.targets import polar_nearness, voxel_nearness

WEIGHTS = LossSpec(range_weight=4.0)  # of the shipped models


def view_losses(
    *, weights: LossSpec = WEIGHTS, perceptual: Callable[..., jax.Array] | None = None
) -> dict[str, Loss]:
    """Return the losses of range images by method; see `denoising_loss`."""
    return {
        "diffusion": where_known(
            denoising_loss, weights=weights, perceptual=perceptual
        ),
        "regression": where_known(regression_loss, range_weight=weights.range_weight),
        "marginal": mixture_loss,
    }


def with_target(loss: Loss, target: Callable[[Any], Any]) -> Loss:
    """Return the loss for `target(clean)` in place of the images `clean`."""

    def changed(key: Any, denoise: Any, clean: Any, **options: Any) -> jax.Array:
        return loss(key, denoise, target(clean), **options)

    return changed


LOSSES: dict[str, dict[str, Loss]] = {
    "view": view_losses(),
    "polar": {
        "diffusion": occupancy_loss,
        "nearness": with_target(estimate_loss, polar_nearness),
        "regression": dice_loss,
    },
    "columns": {
        "occupancy": log_odds_loss,
        "nearness": with_target(log_odds_loss, voxel_nearness),
        "diffusion": with_target(denoising_loss, lambda clean: 2 * (clean - SHARE)),
    },
}
