"""jradar: dense LiDAR-like point clouds from mmWave radar, in pure JAX functions.

The way of one frame, which is also the order of the rooms:

    ADC cube [tx, rx, chirp, sample] and its Radar
      -> radar.range_doppler           [virtual, doppler, range]
      -> radar.os_cfar                 mask [doppler, range]
      -> radar.angle_spectrum          azimuth, elevation of each detection
      -> radar.radar_points            PointCloud
      -> range_image.condition_image   [row, column, channel]           64 x 64
      -> diffusion.sample              Heun on the EDM denoiser         128 x 512
      -> range_image.unproject         PointCloud                       dense
      -> metrics, viz
    ground truth: LiDAR scan -> lidar.preprocess -> range_image.project

The front door:

    recording = jradar.open_recording("sim/lab_0")
    model = jradar.load_model("jradar-sim")
    cloud = jradar.enhance(key, recording.cube(0), recording.radar, model)
    for frame in jradar.enhance_recording(recording, model): ...
    cloud.save("frame.ply")

A room is loaded when it is first named.
"""

import importlib
import pkgutil
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jradar import (
        calibration as calibration,
        data as data,
        diffusion as diffusion,
        evaluation as evaluation,
        export as export,
        lidar as lidar,
        mapping as mapping,
        metrics as metrics,
        model as model,
        motion as motion,
        options as options,
        outputs as outputs,
        pipeline as pipeline,
        radar as radar,
        range_image as range_image,
        recordings as recordings,
        simulation as simulation,
        stream as stream,
        training as training,
        types as types,
        viz as viz,
    )
    from jradar.model import (
        enhance as enhance,
        enhance_points as enhance_points,
        load_model as load_model,
    )
    from jradar.options.sensor import RadarSpec as RadarSpec
    from jradar.pipeline import enhance_recording as enhance_recording
    from jradar.radar import Radar as Radar
    from jradar.recordings import open_recording as open_recording
    from jradar.types import PointCloud as PointCloud

__version__ = "0.2.0"
IMPORTED_S = time.time()  # files that change later are not those that were imported

NAMES = {  # of the front door, and where each is defined
    "PointCloud": "jradar.types",
    "Radar": "jradar.radar",
    "RadarSpec": "jradar.options.sensor",
    "open_recording": "jradar.recordings",
    "load_model": "jradar.model",
    "enhance": "jradar.model",
    "enhance_points": "jradar.model",
    "enhance_recording": "jradar.pipeline",
}
ROOMS = [m.name for m in pkgutil.iter_modules(__path__) if m.name[0] != "_"]

__all__ = [*NAMES, *ROOMS]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Load a room, or one of the names in NAMES, on first use."""
    if name in ROOMS:
        return importlib.import_module(f"jradar.{name}")
    if name not in NAMES:
        raise AttributeError(f"module 'jradar' has no attribute {name!r}")
    return globals().setdefault(
        name, getattr(importlib.import_module(NAMES[name]), name)
    )


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
