"""The networks that a model can hold, and how configs and files name them.

A network is a Flax module, or any hashable object with the same `init` and `apply`,
that splits into two methods: `encode` turns a condition into features once per frame,
`decode` turns a noisy image and these features into the network's output at each step
of a sampler. A call does both in a row.

A new network is a module of its own and one entry in `NETWORKS`.
"""

import dataclasses
import difflib
from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import jax
from jaxtyping import Array, Float

from jradar.diffusion.evidence import EvidenceUNet
from jradar.diffusion.unet import PRESETS, UNet


@runtime_checkable
class Network(Protocol):
    """What models, training and samplers need of a network."""

    def init(
        self,
        key: jax.Array,
        x: Float[Array, "batch row column channel"],
        c_noise: Float[Array, " batch"],
        condition: Float[Array, "batch coarse_row coarse_column slice"],
        /,
    ) -> Any:
        """Return parameters for images and conditions of these shapes."""
        ...

    def apply(self, params: Any, /, *arrays: Any, method: str = ...) -> Any:
        """Call the network, or its method "encode" or "decode"."""
        ...


NETWORKS: dict[str, Callable[..., Any]] = {"unet": UNet, "evidence": EvidenceUNet}
SKIPPED = ("parent", "name", "dtype")  # fields that do not describe the network


def build_network(
    *, kind: str = "unet", preset: str | None = None, **fields: Any
) -> Network:
    """Return a network by its name in `NETWORKS`, with a preset's and further fields.

    Raises ValueError for an unknown kind, preset or field, naming the choices.
    """
    if kind not in NETWORKS:
        raise ValueError(f"network kind = {kind!r}, expected one of {[*NETWORKS]}")
    known: Any = NETWORKS[kind]
    if preset is not None and preset not in PRESETS:
        raise ValueError(f"preset = {preset!r}, expected one of {[*PRESETS]}")
    values = (PRESETS[preset] if preset else {}) | fields
    names = [field.name for field in dataclasses.fields(known)]
    for name in values:
        if name not in names:
            near = difflib.get_close_matches(name, names, 1) or [", ".join(names)]
            raise ValueError(f"unknown network field {name!r}, expected {near[0]}")
    return known(**values)


def network_fields(network: Network) -> dict[str, Any]:
    """Return the kind and fields of a network, as JSON takes them.

    Raises ValueError for a network that is not in `NETWORKS`.
    """
    kinds = {known: kind for kind, known in NETWORKS.items()}
    if type(network) not in kinds:
        raise ValueError(
            f"network {type(network).__name__} has no entry in NETWORKS: add one"
        )
    fields: Any = dataclasses.fields(network)  # pyright: ignore[reportArgumentType]
    names = [field.name for field in fields if field.name not in SKIPPED]
    values = {name: getattr(network, name) for name in names}
    return {"kind": kinds[type(network)], **values}


def network_from_fields(values: dict[str, Any]) -> Network:
    """Return the network of `network_fields`, with lists as tuples."""
    values = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
    return build_network(**values)
