"""The front door: a trained model, and the paper in three functions.

    model = load_model("jradar-sim")            # shipped with the package, or a folder
    cloud = enhance(key, cube, radar, model)    # ADC cube to a dense PointCloud

`enhance` is `radar_points`, then `enhance_points`: `draw`, then `dense_cloud`. `Radar`
and `Model` are pytrees, so all of them take both under `jit`, `vmap` and `grad`.

Model, ModelSpec, Card, METHODS     a trained network, and how models answer
load_model, load_card, save_model, shipped_models
                                    folders of models; a card alone
enhance, enhance_points, condition, draw, dense_cloud
                                    from a cube, or its points, to a cloud
mixtures, moving_pixels, fuse       several frames as one
compiler_options                    for `jit` around them, quicker on a CPU
"""

from jradar.model.compiling import compiler_options as compiler_options
from jradar.model.enhancing import (
    condition as condition,
    dense_cloud as dense_cloud,
    draw as draw,
    enhance as enhance,
    enhance_points as enhance_points,
)
from jradar.model.folder import (
    load_card as load_card,
    load_model as load_model,
    save_model as save_model,
    shipped_models as shipped_models,
)
from jradar.model.fusion import (
    fuse as fuse,
    mixtures as mixtures,
    moving_pixels as moving_pixels,
)
from jradar.model.methods import METHODS as METHODS
from jradar.model.spec import Card as Card, Model as Model, ModelSpec as ModelSpec
