"""`jradar enhance`: frames of a recording through a trained model, every stage timed.

The stages of `jradar.enhance` are compiled before the first frame, so their times do
not include compiling. Every frame uses the same noise: its result does not depend on
which other frames are enhanced.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from jradar import recordings, viz
from jradar.cli.reading import frame_points, open_frames, summary
from jradar.model import Model, ModelSpec, draw, load_model
from jradar.progress import progress
from jradar.radar import power_map
from jradar.range_image import condition_image, unproject

WRITTEN = ("radar.ply", "enhanced.ply", "enhanced.npz", "capture.png")
FLAT = (
    "this radar has one row of antennas and measures no elevation: heights in the "
    "result come from the model alone"
)


class Stopwatch(dict[str, list[float]]):
    """The seconds of each call, by stage."""

    def __call__(self, stage: str, call: Callable, *arguments: Any) -> Any:
        """Return the call's result, once it is ready."""
        begin = time.perf_counter()
        result = jax.block_until_ready(call(*arguments))
        self.setdefault(stage, []).append(time.perf_counter() - begin)
        return result


def enhance_frames(options: argparse.Namespace) -> dict[str, Any]:
    """Enhance the frames that the options name, and write the results."""
    model = load_model(options.model)
    recording, frames = open_frames(options)
    spec, watch = model.spec, Stopwatch()
    key = jax.random.key(options.seed)
    stages = watch("compiling", _compiled_stages, key, model, recording, options)
    rows = []
    with progress("enhancing", len(frames), unit="frames") as show:
        for done, frame in enumerate(frames, 1):
            values = [watch("read", recordings.calibrated_cube, recording, frame)]
            for name, stage in stages.items():
                values.append(watch(name, stage, key, model, values[-1]))
            cube, cloud, _, image, dense = values
            folder = Path(options.output, f"{frame:06d}" if options.frames else "")
            drawn = cube, cloud, image, dense
            watch("writing", _write, folder, recording, frame, spec, *drawn)
            rows.append(
                {
                    "frame": frame,
                    "radar points": int(cloud.valid.sum()),
                    "enhanced points": int(dense.valid.sum()),
                }
            )
            if len(frames) > 1:
                show(done)
    written = [str(Path(options.output) / name) for name in WRITTEN]
    return {
        **summary(recording, () if recording.radar.has_elevation else (FLAT,)),
        "model": {
            "name": str(options.model),
            "purpose": spec.purpose,
            "training steps": spec.steps_seen,
            "trained on": f"{spec.trained_on}, radar {spec.radar.name}",
        },
        **({"enhanced": rows} if options.frames else rows[0]),
        **_times(watch),
        "written": [options.output] if options.frames else written,
    }


def _compiled_stages(key, model: Model, recording, options) -> dict[str, Callable]:
    """Compile the stages of `jradar.enhance`; each takes the result of the last."""
    spec = model.spec

    def radar_processing(_key, _model, cube):
        return frame_points(cube, recording, spec.points)

    def condition(_key, _model, cloud):
        return condition_image(cloud, spec.coarse, num_slices=spec.num_slices)

    def sampling(key, model, condition):
        return draw(key, condition, model, draws=options.draws, steps=options.steps)

    def back_projection(_key, _model, image):
        return unproject(image, spec.fine)

    value: Any = jax.ShapeDtypeStruct(recording.radar.cube_shape, jnp.complex64)
    compiled = {}
    for stage in (radar_processing, condition, sampling, back_projection):
        name = stage.__name__.replace("_", " ")
        compiled[name] = jax.jit(stage).lower(key, model, value).compile()
        value = jax.eval_shape(stage, key, model, value)
    return compiled


def _times(watch: Stopwatch) -> dict[str, Any]:
    """Return the median time of each stage, the frame rate and the compile time."""
    (compiling,) = watch.pop("compiling")
    stages = {name: 1e3 * statistics.median(times) for name, times in watch.items()}
    drawing = sum(stages.values()) - stages["writing"]
    return {
        "milliseconds per frame": stages,
        "frames/s without writing": 1e3 / drawing,
        "compiling (s)": compiling,
    }


def _write(folder: Path, recording, frame, spec: ModelSpec, cube, cloud, image, dense):
    """Write the clouds, the range image and a picture of one frame."""
    figure = viz.capture_figure(
        power_map(cube),
        recording.radar,
        cloud,
        spec.fine,
        dense=dense,
        lidar=recordings.nearest_scan(recording, frame),
        title=f"{recording.name}, frame {frame}; model: {spec.purpose}",
    )
    recordings.write_ply(folder / "radar.ply", cloud)
    recordings.write_ply(folder / "enhanced.ply", dense)
    columns = recordings.valid_points(dense) | {"range_image": image}
    recordings.write_npz(folder / "enhanced.npz", columns)
    viz.save_figure(figure, folder / "capture.png")
