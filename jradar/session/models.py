"""Models that frames go through, of either kind, by name."""

from pathlib import Path

from jradar.model import Model, load_model
from jradar.planar import PlanarModel, load_planar_model, planar_description
from jradar.planar.files import ELSEWHERE

AnyModel = Model | PlanarModel


def load_any_model(name: Path | str) -> AnyModel:
    """Load a model by what `load_model` takes, or `load_planar_model`.

    Raises ModelError, with the reason, for a model that is missing or damaged.
    """
    if planar_description(name) is not None or str(name) in ELSEWHERE:
        return load_planar_model(name)
    return load_model(name)
