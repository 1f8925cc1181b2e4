"""The front door: a trained model, and the paper in three functions.

    model = load_model("jradar-sim")            # shipped with the package, or a folder
    cloud = enhance(key, cube, radar, model)    # ADC cube to a dense PointCloud

`enhance` makes a condition from the cube, lets the model `draw`, and makes a
`dense_cloud` from its image. The model's grid says what a condition and an image are:
range images, polar images of one row of antennas, or columns of a map. `Radar` and
`Model` are pytrees, so all of them take both under `jit`, `vmap` and `grad`.
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
)
from jradar.model.fusion import (
    fuse as fuse,
    mixtures as mixtures,
    moving_pixels as moving_pixels,
)
from jradar.model.grids import (
    GRIDS as GRIDS,
    ColumnGrid as ColumnGrid,
    FrameGrid as FrameGrid,
    Grid as Grid,
    PolarGrid as PolarGrid,
    ViewGrid as ViewGrid,
)
from jradar.model.model import Card as Card, Model as Model, ModelSpec as ModelSpec
from jradar.model.tables import Tables as Tables
from jradar.options.models import shipped_models as shipped_models
