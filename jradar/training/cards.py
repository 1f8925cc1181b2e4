"""The model card: data, config and versions of a run, as JSON."""

import json
import platform
from importlib import metadata
from pathlib import Path
from typing import Any

import jax

from jradar import __version__
from jradar.files import write_text

LIBRARIES = ("jax", "jaxlib", "flax", "optax", "orbax-checkpoint", "numpy")


def write_model_card(
    workdir: Path | str,
    *,
    config: dict[str, Any],
    data_digest: str,
    seed: int,
    steps: int,
    purpose: str = "",
) -> None:
    """Write `model_card.json` into a run's folder; `data_digest` is of its data."""
    versions = {"jradar": __version__, "python": platform.python_version()}
    versions |= {name: metadata.version(name) for name in LIBRARIES}
    card = {
        "purpose": purpose,
        "seed": seed,
        "steps": steps,
        "data_digest": data_digest,
        "versions": versions,
        "devices": f"{jax.device_count()} x {jax.devices()[0].device_kind}",
        "config": config,
    }
    write_text(Path(workdir) / "model_card.json", json.dumps(card, indent=2) + "\n")
