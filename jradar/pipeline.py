"""One radar frame to one dense cloud: the paper in one function (Fig. 3b)."""

from typing import Any

from jaxtyping import Array, Complex, Float, Key

from jradar.diffusion import ConditionalDenoiser, NoiseSpec, sample
from jradar.radar import RadarSpec, radar_points
from jradar.range_image import (
    ImageSpec,
    agreed_range,
    condition_image,
    decode_target,
    unproject,
)
from jradar.types import PointCloud

# Options of `draw_range_image`, chosen on validation frames: 40 evaluations of the
# network, eight at a time, take about as long as the 35 of the paper's one draw.
AGREEMENT: dict[str, Any] = {
    "draws": 8,
    "solver": "ipndm3",
    "steps": 5,
    "temperature": 1.0,
}


def enhance(
    key: Key[Array, ""],
    cube: Complex[Array, "tx rx chirp sample"],
    denoise: ConditionalDenoiser,
    *,
    radar: RadarSpec,
    coarse: ImageSpec,
    fine: ImageSpec,
    num_slices: int = 8,
    points: dict[str, Any],
    **sampling: Any,
) -> PointCloud:
    """One radar frame to a LiDAR-like PointCloud (Fig. 3b).

    `denoise` is a `conditional_denoiser`, `points` the options of `radar_points`,
    `sampling` those of `draw_range_image`. One frame; `jit` and `vmap` it.
    """
    cloud = radar_points(cube, radar, **points)
    condition = condition_image(cloud, coarse, num_slices=num_slices)
    return unproject(
        draw_range_image(key, condition, denoise, fine=fine, **sampling), fine
    )


def draw_range_image(
    key: Key[Array, ""],
    condition: Float[Array, "row column channel"],
    denoise: ConditionalDenoiser,
    *,
    fine: ImageSpec,
    noise: NoiseSpec,
    codec: str = "log",
    validity_threshold: float = 0.0,
    steps: int = 18,
    draws: int = 1,
    **solving: Any,
) -> Float[Array, "fine_row fine_column"]:
    """A LiDAR-like range image in metres, 0 for a miss, given a `condition_image`.

    `steps=1` is the one-step estimate; `solving` are further options of `sample`. Of
    more than one of `draws`, taken at once, it is what they agree on (`agreed_range`);
    `AGREEMENT` holds options for that. Raises ValueError for less than one.
    """
    if draws < 1:
        raise ValueError(f"draws={draws}, expected at least 1")
    values = sample(
        key,
        denoise(condition[None]),
        (draws, *fine.shape, 2),
        noise=noise,
        steps=steps,
        **solving,
    )
    images = decode_target(
        values, fine, codec=codec, validity_threshold=validity_threshold
    )
    return images[0] if draws == 1 else agreed_range(images)
