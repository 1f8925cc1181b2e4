"""The front door: a trained model, and the paper in three functions.

    model = load_model("jradar-sim")       # shipped with the package, or a folder
    cloud = enhance(key, cube, model)      # ADC cube to a dense PointCloud

`enhance` is `condition`, then `draw`, then `dense_cloud`. A `Model` is a pytree, so all
of them take it as an argument under `jit`, `vmap` and `grad`: its parameters are the
leaves, and its `ModelSpec` is static.

Model, ModelSpec, METHODS           a trained network, and how models answer
load_model, save_model, shipped_models
                                    folders of models
enhance, condition, draw, dense_cloud
                                    from a cube to a cloud
mixtures, moving_pixels, fuse       several frames as one
compiler_options                    for `jit` around them, quicker on a CPU
"""

from jradar.model.compiling import compiler_options as compiler_options
from jradar.model.enhancing import (
    condition as condition,
    dense_cloud as dense_cloud,
    draw as draw,
    enhance as enhance,
)
from jradar.model.folder import (
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
from jradar.model.spec import Model as Model, ModelSpec as ModelSpec
