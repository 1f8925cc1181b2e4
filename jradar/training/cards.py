"""The model card: data, config and versions of a run, as Markdown and JSON."""

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
    """Write `model_card.md` and `model_card.json` into a run's folder.

    `data_digest` identifies the training data.
    """
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
    folder = Path(workdir)
    write_text(folder / "model_card.json", json.dumps(card, indent=2) + "\n")
    write_text(folder / "model_card.md", _markdown(card))


def _markdown(card):
    names = ("steps", "seed", "data_digest", "devices")
    parts = [
        "# Model card",
        card["purpose"],
        _table(("", ""), [(name.replace("_", " "), card[name]) for name in names]),
        _table(("library", "version"), card["versions"].items()),
        f"## Config\n\n```json\n{json.dumps(card['config'], indent=2)}\n```",
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _table(head, rows):
    return "\n".join(f"| {a} | {b} |" for a, b in (head, ("---", "---"), *rows))
