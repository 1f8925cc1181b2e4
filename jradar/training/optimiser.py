"""The optimiser of every training."""

import optax


def clipped_adamw(
    *,
    steps: int,
    learning_rate: float,
    warmup_steps: int,
    clip_norm: float = 1.0,
    weight_decay: float = 1e-2,
) -> optax.GradientTransformation:
    """Return AdamW with clipped gradients.

    The learning rate rises from 0 over the warm-up, at most half of the steps, and then
    falls by a cosine.
    """
    rate = optax.warmup_cosine_decay_schedule(
        0.0, learning_rate, min(warmup_steps, steps // 2), max(steps, 1)
    )
    return optax.chain(
        optax.clip_by_global_norm(clip_norm),
        optax.adamw(rate, weight_decay=weight_decay),
    )
