"""Options load without JAX, and name what the library has."""

import pkgutil

from jradar import options
from jradar.options import models, outputs, scenes
from jradar.recordings import CLOUD_WRITERS
from jradar.simulation.scenes.layouts import FAMILIES
from jradar.simulation.sets import SETS
from jradar.stream.outputs import STREAMED
from tests.programs import finished


def test_options_and_recordings_load_without_jax():
    names = [module.name for module in pkgutil.iter_modules(options.__path__)]
    assert len(names) > 6
    code = (
        f"import sys, jradar.recordings\nfrom jradar.options import {','.join(names)}"
    )
    assert finished(f"{code}\nsys.exit('jax' in sys.modules)").returncode == 0


def test_names_are_those_of_the_library():
    assert scenes.FAMILIES == tuple(FAMILIES)
    assert tuple(scenes.SETS) == tuple(SETS)
    assert outputs.CLOUDS == tuple(CLOUD_WRITERS)
    assert outputs.STREAMS == STREAMED
    assert {*models.shipped_models()} <= models.MODELS.keys()
    assert {models.DEFAULT, models.DEFAULT_OF_MAPS} <= models.MODELS.keys()
