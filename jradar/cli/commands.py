"""Commands on whole recordings, models and runs, each of which returns its result.

The first line of a command's docstring is its help text. A room of the library, and JAX
with it, loads when a command first names it.
"""

import argparse
import dataclasses
import functools
import shutil
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jradar
from jradar.cli.groups import given_drawing
from jradar.cli.printing import Results
from jradar.cli.reading import given, open_frames, opening, summary
from jradar.errors import UsageError
from jradar.outputs.guard import GuardedFolder
from jradar.progress import progress

if TYPE_CHECKING:
    from jradar.data import PrepareSpec
    from jradar.model import Model
    from jradar.motion.velocities import Velocities
    from jradar.options.drawing import Drawing
    from jradar.recordings import Recording

PREVIEW, INTERRUPTED = "preparation.png", 130


def info(options: argparse.Namespace) -> dict[str, Any]:
    """Describe a recording, a bag, a cloud or a radar's configuration; check it."""
    recordings = jradar.recordings
    points = options.topic or recordings.holds_points(options.path)
    if not points and recordings.is_description(options.path):
        return recordings.describe_configuration(options.path, device=options.device)
    described = options.radar or recordings.describes_its_radar(options.path)
    if not points and not (described and recordings.is_recording(options.path)):
        # Bags may hold radar frames: a description of the radar asks for those.
        if (contents := recordings.describe_file(options.path)) is not None:
            return contents
    recording, (frame,) = open_frames(options)
    return jradar.pipeline.describe_recording(recording, frame=frame)


def calibrate(options: argparse.Namespace) -> dict[str, Any]:
    """Estimate the factors of the radar's channels from echoes; write a description."""
    if (picture := options.picture) and (not options.mount or Path(picture).exists()):
        raise UsageError(
            f"--picture {picture}: expected --mount, and the name of a new file"
        )
    recording = jradar.open_recording(options.path, **opening(options))
    found = jradar.calibration.calibrate_recording(
        recording,
        frames=options.frames,
        reflector=options.reflector,
        level=options.level,
        mount=options.mount,
    )
    jradar.recordings.write_radar_toml(
        options.output,
        found.radar,
        **({"iq_order": recording.iq_order} if recording.iq_order else {}),
        lanes=recording.lanes,
        axes=recording.axes,
        mount=None if found.mount is None else found.mount.base_from_radar,
        comment=f"written by jradar calibrate from {recording.name}",
    )
    if picture and found.mount is not None:
        mount = found.mount
        figure = jradar.viz.velocities_figure(
            mount.stamps, mount.velocity, mount.expected
        )
        jradar.viz.save_figure(figure, picture)
    return {
        **summary(recording, found.warnings),
        **found.describe(),
        "written": [options.output, *([picture] if picture else [])],
    }


def odometry(options: argparse.Namespace) -> dict[str, Any]:
    """Estimate the radar's trajectory from Doppler, and write it."""
    motion = jradar.motion
    source, velocities = _velocities(options)
    rotation = options.rotation or ("none" if source.imu is None else "imu")
    found = motion.odometry(source, velocities, rotation=rotation)
    motion.write_tum(options.output, found)
    return {
        **summary(source, found.notes),
        "rotation": rotation,
        **motion.describe_trajectory(found, velocities, source.poses),
        "written": [options.output],
    }


def _velocities(options: argparse.Namespace) -> "tuple[Recording, Velocities]":
    """Return the recording, and the radar's velocity in each frame."""
    from jradar.motion.velocities import POINTS

    recording = jradar.open_recording(options.path, **opening(options))
    count = len(recording.frames)
    frames = range(*options.frames.indices(count))
    if len(frames) < 2:
        raise UsageError(
            f"{options.path}: {len(frames)} of frames 0 to {count - 1} are chosen, "
            "expected 2 or more, because the motion is between frames"
        )
    recording = jradar.recordings.with_sample_warnings(recording, frames[0])
    points = dataclasses.replace(POINTS, **given(options, "folds"))
    with progress("odometry", len(frames), unit="frames") as show:
        found = jradar.motion.frame_velocities(
            recording, frames=frames, points=points, advance=show
        )
    return recording, found


def map_(options: argparse.Namespace) -> dict[str, Any]:
    """Turn a walk into a map, and into the map that a LiDAR would have made."""
    mapping = jradar.mapping
    results = GuardedFolder(options.output, "map", force=options.force)
    results.check(mapping.FILES)
    model = jradar.load_model(options.model)
    mapping.column_grid(model)  # refuses a model of frames
    recording = jradar.open_recording(options.path, **opening(options))
    frames = range(*options.frames.indices(len(recording.frames)))
    with progress("mapping", len(frames), unit="frames") as show:
        found = mapping.map_recording(
            recording,
            model,
            frames=frames,
            rotation=options.rotation,
            loops=options.loops,
            advance=show,
        )
    result = Results(
        {
            **summary(recording, found.notes),
            "model": {"name": options.model, "purpose": model.card.purpose},
            **found.describe(),
            "written": results.put(mapping.map_files(found)),
        }
    )
    result.code = INTERRUPTED if found.interrupted else 0
    return result


def prepare(options: argparse.Namespace) -> dict[str, Any]:
    """Turn recordings of radar and LiDAR into training pairs."""
    kind = jradar.data.PrepareSpec
    spec = kind.from_toml(options.spec) if options.spec else kind()
    if options.preview:
        return _preview(options, spec)
    manifest = jradar.data.prepare(
        options.path,
        options.output,
        spec,
        frames=options.frames,
        workers=options.workers,
        scheduler=options.scheduler,
        keep_going=options.keep_going,
        splits={
            name: split
            for split in ("validation", "test")
            for name in getattr(options, split)
        },
        validation_share=options.validation_share,
        **opening(options),
    )
    written = [str(Path(options.output) / "manifest.json")]
    return {**jradar.data.describe_manifest(manifest), "written": written}


def _preview(options: argparse.Namespace, spec: "PrepareSpec") -> dict[str, Any]:
    """Write the picture of one frame's preparation, and return its numbers."""
    results = GuardedFolder(options.output, "prepare", force=options.force)
    results.check([PREVIEW])
    source, *_ = jradar.data.find_sources(options.path, **opening(options))
    recording, viz = source.open(), jradar.viz
    found = jradar.data.preview(recording, spec, frames=options.frames)
    figure = viz.preparation_figure(
        found.steps,
        found.trusted,
        spec.lidar,
        title=f"{recording.name}, frame {found.frame.frame}",
    )
    return {
        "recording": str(recording.path),
        **found.describe(),
        "notes": jradar.data.notes_of(recording),
        "written": results.put({PREVIEW: lambda path: viz.save_figure(figure, path)}),
    }


def finetune(options: argparse.Namespace) -> dict[str, Any]:
    """Fine-tune a model on the records of your own rig."""
    from jradar.training import FinetuneSpec, finetune as tune

    of_old = given(options, "forget", "replay_share", "replay_records")
    if options.own_view and of_old:
        name = "--" + next(iter(of_old)).replace("_", "-")
        raise UsageError(f"{name}: --own-view leaves old places behind, give only one")
    try:
        chosen = given(options, "steps", "learning_rate", "forget")
        if options.replay_share is not None:
            chosen["replay"] = options.replay_share
        spec = FinetuneSpec(**chosen, seed=options.seed, own_view=options.own_view)
    except ValueError as error:
        raise UsageError(str(error)) from error
    folder, replay = Path(options.output), options.replay_records
    try:
        found = tune(
            options.records, folder, model=options.model, spec=spec, replay=replay
        )
    except KeyboardInterrupt as stop:
        raise type(stop)(f"interrupted: {folder} keeps {_kept(folder)}") from None
    written = [str(folder / name) for name in ("model", "learning.png")]
    return {"records": options.records, **found.describe(), "written": written}


def _kept(folder: Path) -> str:
    """Return what a stopped fine-tuning has done, and how to go on."""
    shards = len([*folder.glob("replay/records/*/*.json")])
    names = [path.name for path in folder.glob("checkpoints/*")]
    steps = sorted(int(name) for name in names if name.isdigit())  # no half ones
    done = [
        *([f"{shards} frames of old places"] if shards else []),
        *([f"the weights of step {steps[-1]}"] if steps else []),
    ]
    return f"{' and '.join(done) or 'nothing yet'}; run the same command to go on"


def score(options: argparse.Namespace) -> dict[str, Any]:
    """Score models and the radar's points against the LiDAR of recordings."""
    from jradar.evaluation import score as scored

    report, results = "evaluation/report.html", None
    if options.output:
        results = GuardedFolder(options.output, "score", force=options.force)
        results.check([report])
    found = scored(
        options.path,
        models=options.model or ("jradar-sim",),
        split=options.split,
        frames=options.frames,
        seed=options.seed,
        protocol=options.protocol,
        workers=options.workers,
        scheduler=options.scheduler,
        **opening(options),
    )
    result = found.describe()
    if results:
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch) / results.path.resolve().name
            found.write(folder)
            files = {
                path.relative_to(folder).as_posix(): functools.partial(_copied, path)
                for path in sorted(folder.rglob("*"))
                if path.is_file()
            }
            results.put(files)
        result["written"] = [str(results.path / report)]
    return result


def _copied(source: Path, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, path)


def simulate(options: argparse.Namespace) -> dict[str, Any]:
    """Simulate a recording of a scene, or a whole data set."""
    plan = jradar.simulation.SimulationPlan(
        **given(options, "scene", "set", "frames"),
        seed=options.seed,
        sensor=options.sensor,
        layout=options.format,
    )
    result = {
        "output": options.output,
        "recordings": plan.recordings,
        "frames per recording": plan.frames_each,
        "size": f"{plan.size / 1e6:,.0f} MB",
    }
    if options.dry_run:
        about = f"about {plan.seconds():,.0f} s on this machine"
        return {**result, "time": about, "written": "nothing (dry run)"}
    begin = time.perf_counter()
    frames = plan.recordings * plan.frames_each
    with progress("simulating", frames, unit="frames") as show:
        path = plan.write(options.output, advance=show)
    took = f"{time.perf_counter() - begin:.1f} s"
    return {**result, "time": took, "written": str(path)}


def view(options: argparse.Namespace) -> dict[str, Any]:
    """Open the report of an experiment in a browser."""
    report = jradar.evaluation.open_report(options.run, show=not options.no_open)
    return {"report": str(report), "open in a browser": report.resolve().as_uri()}


def export(options: argparse.Namespace) -> dict[str, Any]:
    """Write a trained model as one file that runs without jradar."""
    model = jradar.load_model(options.model)
    _ = model.spec.frame_grid  # refuses a model of maps
    drawing = given_drawing(options)
    if Path(options.output).suffix == jradar.export.ONNX:
        return _export_onnx(options, model, drawing)
    radar = jradar.Radar(model.card.radar)
    if options.radar:
        described = jradar.recordings.read_description(
            options.radar, device=options.device
        )
        radar = described.capture.radar(described.radar)
    if options.coupling:
        leakage = jradar.recordings.read_coupling(options.coupling)
        radar = dataclasses.replace(radar, leakage=leakage)
    jradar.export.export_function(options.output, radar, model, **drawing)
    kind = "float32" if radar.spec.real_samples else "complex64"
    return {
        "radar": radar.spec.name,
        "takes": f"seed, cube {list(radar.spec.cube_shape)} of {kind}",
        "purpose": model.card.purpose,
        "written": [options.output],
        "to use it in Python": jradar.export.loading(options.output),
    }


def _export_onnx(
    options: argparse.Namespace, model: "Model", drawing: "Drawing"
) -> dict[str, Any]:
    of_cubes = [*given(options, "radar", "device", "coupling"), *drawing]
    if of_cubes:
        raise UsageError(
            f"--{of_cubes[0].replace('_', '-')}: an ONNX file takes the points of any "
            "radar, and answers in one pass; leave it out"
        )
    jradar.export.export_onnx(options.output, model)
    capacity = model.spec.points.capacity
    return {
        "takes": f"xyz, valid, velocity and power of {capacity} points",
        "purpose": model.card.purpose,
        "written": [options.output],
        "to use it in Python": jradar.export.running(options.output, capacity),
    }
