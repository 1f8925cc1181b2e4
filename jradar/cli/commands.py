"""The commands. Each takes the parsed options and returns the result to print.

The first line of a command's docstring is its help text.
"""

import argparse
import dataclasses
from pathlib import Path
from typing import Any


def info(options: argparse.Namespace) -> dict[str, Any]:
    """Describe a recording, a bag or a point cloud, and check that it can be read."""
    from jradar.cli.reading import echoes, frame_points, open_frames
    from jradar.radar import PointSpec, calibrate, noise_statistics, power_map
    from jradar.recordings import (
        check_samples,
        describe,
        describe_file,
        is_recording,
    )
    from jradar.session.warnings import no_echoes

    radar_frames = options.radar and is_recording(options.path)  # also those in bags
    if not radar_frames and (contents := describe_file(options.path)) is not None:
        return contents
    recording, (frame,) = open_frames(options)
    cube, radar = recording.cube(frame), recording.radar
    samples = check_samples(cube)
    cloud = frame_points(cube, radar, PointSpec())
    found: dict[str, Any] = {
        "largest sample": samples.largest,
        "share at full scale": samples.share,
        "noise": noise_statistics(
            power_map(calibrate(cube, radar)), radar.spec
        )._asdict(),
        "echoes": echoes(cloud, radar),
    }
    if radar.spec.num_chirps > 1:
        moving = frame_points(cube, radar, PointSpec(remove_static=True))
        found["moving echoes"] = echoes(moving, radar)
    if (recording.path / "capture.toml").is_file() and recording.lidar is not None:
        found["time offset"] = _time_offset(recording)
    described = describe(recording)
    if not cloud.valid.any():
        described["notes"] += no_echoes([frame])
    return {**described, "frame": frame, **found}


def points(options: argparse.Namespace) -> dict[str, Any]:
    """Detect points in radar frames; write them as clouds, with a picture."""
    from jradar.cli.detecting import detect_frames

    return detect_frames(options)


def enhance(options: argparse.Namespace) -> dict[str, Any]:
    """Turn radar frames into dense point clouds with a trained model."""
    from jradar.cli.enhancing import enhance_frames

    return enhance_frames(options)


def live(options: argparse.Namespace) -> dict[str, Any]:
    """Publish dense clouds of a radar on the cable, as it runs."""
    from jradar.cli.streaming import live_session

    return live_session(options)


def replay(options: argparse.Namespace) -> dict[str, Any]:
    """Send a recording over UDP as the DCA1000 capture card would."""
    from jradar.cli.streaming import replay_recording

    return replay_recording(options)


def calibrate(options: argparse.Namespace) -> dict[str, Any]:
    """Find the factors of the radar's channels from its echoes; write a description."""
    from jradar.cli.calibrating import calibrate_recording

    return calibrate_recording(options)


def odometry(options: argparse.Namespace) -> dict[str, Any]:
    """Find where the radar went, by its own Doppler; write the trajectory."""
    from jradar.cli.moving import odometry_of_recording

    return odometry_of_recording(options)


def prepare(options: argparse.Namespace) -> dict[str, Any]:
    """Turn recordings of radar and LiDAR into training pairs."""
    from jradar.cli.reading import opening
    from jradar.data import PrepareSpec, find_sources, prepare as prepare_all

    spec = PrepareSpec.from_toml(options.spec) if options.spec else PrepareSpec()
    if options.preview:
        source, *_ = find_sources(options.path, **opening(options))
        return _preview(source.open(), spec, options)
    manifest = prepare_all(
        options.path,
        options.output,
        spec,
        frames=options.frames,
        workers=options.workers,
        scheduler=options.scheduler,
        keep_going=options.keep_going,
        **opening(options),
    )
    sequences = manifest["sequences"]
    return {
        "frames": sum(s["frames"] for s in sequences),
        "sequences": [
            {name: s[name] for name in ("name", "split", "frames")}
            | {"dropped": sum(s["dropped"].values())}
            for s in sequences
        ],
        "dropped": {
            f"{s['name']}, {reason}": count
            for s in sequences
            for reason, count in s["dropped"].items()
        },
        "notes": [f"{s['name']}: {note}" for s in sequences for note in s["notes"]],
        "written": [str(Path(options.output) / "manifest.json")],
    }


def simulate(options: argparse.Namespace) -> dict[str, Any]:
    """Simulate a recording of a scene, or a whole data set."""
    from jradar.cli.simulating import simulate as simulate_all

    return simulate_all(options)


def view(options: argparse.Namespace) -> dict[str, Any]:
    """Open the report of an experiment in a browser."""
    from jradar.evaluation import open_report

    return {"report": str(open_report(options.run, show=not options.no_open))}


def export(options: argparse.Namespace) -> dict[str, Any]:
    """Write a trained model as one file that runs without jradar."""
    from jradar.cli.reading import given
    from jradar.export import export_function
    from jradar.model import load_model
    from jradar.radar import Radar
    from jradar.recordings import read_coupling, read_description

    model = load_model(options.model)
    radar = Radar(model.card.radar)
    if options.radar:
        described = read_description(options.radar, device=options.device)
        radar = described.capture.radar(described.radar)
    if options.coupling:
        radar = dataclasses.replace(radar, leakage=read_coupling(options.coupling))
    drawing = given(options, "draws", "steps")
    export_function(options.output, radar, model, **drawing)
    kind = "float32" if radar.spec.real_samples else "complex64"
    return {
        "radar": radar.spec.name,
        "takes": f"seed, cube {list(radar.spec.cube_shape)} of {kind}",
        "purpose": model.card.purpose,
        "written": [options.output],
    }


def _preview(recording, spec, options):
    """Write the picture of one frame's preparation, and return its numbers."""
    from jradar import viz
    from jradar.data import matches_of, prepare_frame

    matches = matches_of(recording, spec)
    wanted = range(*options.frames.indices(len(recording.cubes)))
    found = [pair for pair in zip(*matches[:2], strict=True) if pair[0] in wanted]
    if not found:
        reason = next(iter(matches.dropped.values()), "no frame is in --frames")
        raise ValueError(
            f"{recording.path}: none of the chosen frames has a LiDAR scan: {reason}"
        )
    i, j = map(int, found[0])
    frame, steps, trusted = prepare_frame(recording, i, j, spec)
    path = Path(options.output) / "preparation.png"
    title = f"{recording.name}, frame {frame.frame}"
    figure = viz.preparation_figure(steps, trusted, spec.lidar, title=title)
    viz.save_figure(figure, path)
    return {
        "recording": str(recording.path),
        "frame": frame.frame,
        "radar points": len(trusted),
        "LiDAR points": len(steps.xyz),
        "in the radar's view": int(steps.in_view.sum()),
        "floor and ceiling": int((steps.ground | steps.ceiling).sum()),
        "kept": len(frame.lidar_xyz),
        "matched frames": len(matches.radar),
        "notes": list(recording.notes),
        "written": [str(path)],
    }


def _time_offset(recording):
    """Estimate the offset between the sensors' clocks from the rig's motion."""
    from jradar.recordings import propose_offset

    try:
        seconds, confidence = propose_offset(recording)
    except ValueError as error:
        return {"not estimated": str(error)}
    return {"add to the radar's start (s)": seconds, "confidence, 0 to 1": confidence}
