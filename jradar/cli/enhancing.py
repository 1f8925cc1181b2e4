"""`jradar enhance`: frames of a recording through a trained model, every stage timed.

The stages of a frame are compiled before the first one, which is timed apart: what
stands beside a stage is the median of running it. All frames are drawn with the same
noise, so that a frame does not depend on which others were asked for.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax

from jradar import diffusion, radar as radar_room, recordings, viz
from jradar.bundle import (
    Bundle,
    BundleSpec,
    default_bundle,
    load_bundle,
    shipped_bundles,
)
from jradar.pipeline import AGREEMENT, draw_range_image
from jradar.progress import progress
from jradar.range_image import condition_image, unproject
from jradar.types import PointCloud

WRITTEN = ("radar.ply", "enhanced.ply", "enhanced.npz", "capture.png")


class Stages(NamedTuple):
    """What is compiled, each a function of the one before."""

    radar: Callable[[Any], Any]
    condition: Callable[[Any], Any]
    sampling: Callable[[Any], Any]
    back_projection: Callable[[Any], Any]


class Stopwatch(dict[str, list[float]]):
    """Seconds that calls took, by what they were for."""

    def __call__(self, what: str, call: Callable, *given: Any) -> Any:
        """The call's result, once it is ready."""
        begin = time.perf_counter()
        result = jax.block_until_ready(call(*given))
        self.setdefault(what, []).append(time.perf_counter() - begin)
        return result


def named_bundle(name: str | None) -> Bundle:
    """The bundle in a folder or shipped under a name; the default where none is named.

    Raises BundleError where there is none.
    """
    if name is None:
        return load_bundle(default_bundle())
    return load_bundle(shipped_bundles().get(name, Path(name)))


def enhance_frames(
    bundle: Bundle,
    recording: recordings.Recording,
    first: Any,
    frames: range,
    to_points: Callable[..., PointCloud],
    options: argparse.Namespace,
) -> dict[str, Any]:
    """Draw and write the frames; `first` is the first one's cube.

    `to_points(cube, recording, **options)` is the radar processing.
    """
    spec, watch = bundle.spec, Stopwatch()
    stages = watch(
        "compiling", _compiled, _stages(bundle, recording, to_points, options), first
    )
    found = []
    with progress("enhancing", len(frames), unit="frames") as show:
        for done, frame in enumerate(frames, 1):
            cube = watch("read", recordings.calibrated_cube, recording, frame)
            cloud = watch("radar processing", stages.radar, cube)
            condition = watch("condition", stages.condition, cloud)
            image = watch("sampling", stages.sampling, condition)
            dense = watch("back-projection", stages.back_projection, image)
            folder = Path(options.output)
            if options.frames:
                folder = folder / f"{frame:06d}"
            drawn = cube, cloud, image, dense
            watch("writing", _write, folder, recording, frame, spec, *drawn)
            found.append(
                {
                    "frame": frame,
                    "radar points": int(cloud.valid.sum()),
                    "enhanced points": int(dense.valid.sum()),
                }
            )
            if len(frames) > 1:
                show(done)
    written = [str(Path(options.output) / name) for name in WRITTEN]
    if options.frames:
        return {"enhanced": found, **_times(watch), "written": [options.output]}
    return {**found[0], **_times(watch), "written": written}


def sampling_options(spec: BundleSpec, options: argparse.Namespace) -> dict[str, Any]:
    """Options of `draw_range_image` for `--draws` and `--steps`."""
    several = {**AGREEMENT, "draws": options.draws} if options.draws > 1 else {}
    steps = {"steps": options.steps} if options.steps else {}
    return {**spec.sampling, **several, **steps}


def _stages(bundle, recording, to_points, options) -> Stages:
    """The way of a frame, cut where it is timed."""
    params, spec = bundle

    def sampling(condition):
        return draw_range_image(
            jax.random.key(options.seed),
            condition,
            diffusion.conditional_denoiser(spec.network, params, spec.noise),
            fine=spec.fine,
            noise=spec.noise,
            codec=spec.codec,
            **sampling_options(spec, options),
        )

    return Stages(
        lambda cube: to_points(cube, recording, **spec.points),
        lambda cloud: condition_image(cloud, spec.coarse, num_slices=spec.num_slices),
        sampling,
        lambda image: unproject(image, spec.fine),
    )


def _compiled(stages: Stages, given: Any) -> Stages:
    """The stages compiled for what each gets from the one before."""
    compiled = []
    for stage in stages:
        compiled.append(jax.jit(stage).lower(given).compile())
        given = jax.eval_shape(stage, given)
    return Stages(*compiled)


def _times(watch: Stopwatch) -> dict[str, Any]:
    """Milliseconds of each stage of a frame, and how many frames a second that is."""
    (compiling,) = watch.pop("compiling")
    stages = {what: 1e3 * statistics.median(times) for what, times in watch.items()}
    drawing = sum(stages.values()) - stages["writing"]
    return {
        "milliseconds of a frame": stages,
        "frames a second, without writing": 1e3 / drawing,
        "compiling (s)": compiling,
    }


def _write(folder: Path, recording, frame, spec: BundleSpec, cube, cloud, image, dense):
    """The clouds, the range image and a picture of a frame."""
    figure = viz.capture_figure(
        radar_room.power_map(cube),
        recording.radar,
        cloud,
        spec.fine,
        dense=dense,
        lidar=recordings.nearest_scan(recording, frame),
        title=f"{recording.name}, frame {frame}; weights: {spec.purpose}",
    )
    recordings.write_ply(folder / "radar.ply", cloud)
    recordings.write_ply(folder / "enhanced.ply", dense)
    columns = recordings.valid_points(dense) | {"range_image": image}
    recordings.write_npz(folder / "enhanced.npz", columns)
    viz.save_figure(figure, folder / "capture.png")
