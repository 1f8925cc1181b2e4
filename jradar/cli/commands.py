"""The commands: each takes argparse's options and returns what is printed."""

import argparse
from pathlib import Path
from typing import Any


def info(options: argparse.Namespace) -> dict[str, Any]:
    """What a recording, a bag or a cloud holds, and whether it can be read."""
    from jradar.recordings import describe, describe_file

    if (found := describe_file(options.path)) is not None:
        return found
    recording, cube = _open(options)
    found = {}
    for kind, remove_static in (("echoes", False), ("moving echoes", True)):
        if remove_static and recording.radar.num_chirps == 1:
            continue
        cloud = _points(cube, recording, remove_static=remove_static)
        found[kind] = _echoes(cloud, recording.radar)
    if (recording.path / "capture.toml").is_file() and recording.lidar is not None:
        found["time offset"] = _time_offset(recording)
    return {**describe(recording), "frame": options.frame, **found}


def points(options: argparse.Namespace) -> dict[str, Any]:
    """Detections of a frame, as PLY, NPZ and a picture."""
    recording, cube = _open(options)
    from jradar import radar as radar_room, recordings, viz
    from jradar.range_image import ImageSpec

    radar = recording.radar
    cloud = _points(
        cube,
        recording,
        capacity=options.capacity,
        detector=options.detector,
        false_alarm_rate=options.false_alarm_rate,
        remove_static=options.remove_static,
    )
    figure = viz.capture_figure(
        radar_room.power_map(cube, remove_static=options.remove_static),
        radar,
        cloud,
        ImageSpec(64, 64, max_range_m=radar.max_range_m),
        lidar=recordings.nearest_scan(recording, options.frame),
        title=f"{recording.name}, frame {options.frame}",
    )
    folder = Path(options.output)
    recordings.write_ply(folder / "radar.ply", cloud)
    recordings.write_npz(folder / "radar.npz", recordings.valid_points(cloud))
    viz.save_figure(figure, folder / "capture.png")
    return {
        **_summary(recording),
        "frame": options.frame,
        "points": int(cloud.valid.sum()),
        "echoes": _echoes(cloud, radar),
        "written": [str(folder / n) for n in ("radar.ply", "radar.npz", "capture.png")],
    }


def enhance(options: argparse.Namespace) -> dict[str, Any]:
    """The dense clouds that a trained model draws for one frame or several."""
    from jradar.cli.enhancing import enhance_frames, named_bundle

    bundle = named_bundle(options.weights)
    if options.frames:
        options.frame = options.frames.start or 0
    recording, cube = _open(options)
    frames = range(options.frame, options.frame + 1)
    if options.frames:
        frames = range(*options.frames.indices(len(recording.cubes)))
    spec, notes = bundle.spec, []
    if not recording.radar.has_elevation:
        notes.append(
            "this radar has one row of antennas and measures no elevation: the "
            "condition is flat, and heights in the result come from the model alone"
        )
    weights = {
        "folder": options.weights or "as shipped",
        "purpose": spec.purpose,
        "training steps": spec.steps_seen,
        "trained on": f"{spec.trained_on}, radar {spec.radar.name}",
    }
    drawn = enhance_frames(bundle, recording, cube, frames, _points, options)
    return {**_summary(recording, notes), "weights": weights, **drawn}


def prepare(options: argparse.Namespace) -> dict[str, Any]:
    """Training pairs from recordings with radar and LiDAR, as records."""
    from jradar.data import PrepareSpec, find_sources, prepare as prepare_all

    spec = PrepareSpec.from_toml(options.spec) if options.spec else PrepareSpec()
    opening = {
        "description": options.radar,
        "sensor": options.sensor,
        "iq_order": options.iq_order,
        "allow_partial": options.allow_partial or None,
        "device": options.device,
    }
    opening = {name: value for name, value in opening.items() if value is not None}
    if options.preview:
        source, *_ = find_sources(options.path, **opening)
        return _preview(source.open(), spec, options)
    manifest = prepare_all(
        options.path,
        options.output,
        spec,
        frames=options.frames,
        workers=options.workers,
        scheduler=options.scheduler,
        keep_going=options.keep_going,
        **opening,
    )
    columns = ("name", "split", "frames")
    sequences = [
        {name: s[name] for name in columns} | {"dropped": sum(s["dropped"].values())}
        for s in manifest["sequences"]
    ]
    return {
        "frames": sum(s["frames"] for s in sequences),
        "sequences": sequences,
        "dropped": {
            f"{s['name']}, {why}": count
            for s in manifest["sequences"]
            for why, count in s["dropped"].items()
        },
        "notes": [
            f"{s['name']}: {n}" for s in manifest["sequences"] for n in s["notes"]
        ],
        "written": [str(Path(options.output) / "manifest.json")],
    }


def simulate(options: argparse.Namespace) -> dict[str, Any]:
    """Recordings of a simulated scene, or the whole set jradar-sim."""
    from jradar.simulation import simulate as simulate_all

    return simulate_all(options)


def view(options: argparse.Namespace) -> dict[str, Any]:
    """A run's report in a browser: tables, curves, clouds to turn."""
    from jradar.evaluation import open_report

    return {"report": str(open_report(options.run, show=not options.no_open))}


def export(options: argparse.Namespace) -> dict[str, Any]:
    """A trained model as one file that runs without jradar: ADC cube to dense cloud."""
    from jradar.cli.enhancing import named_bundle, sampling_options
    from jradar.export import export_function
    from jradar.recordings import read_coupling

    bundle = named_bundle(options.weights)
    coupling = read_coupling(options.coupling) if options.coupling else None
    sampling = sampling_options(bundle.spec, options)
    export_function(options.output, bundle, coupling=coupling, **sampling)
    return {
        "takes": f"seed, cube {list(bundle.spec.radar.cube_shape)} of complex64",
        "weights": bundle.spec.purpose,
        "written": [options.output],
    }


def _preview(recording, spec, options):
    """Pictures of one frame's preparation; nothing else is written."""
    from jradar import viz
    from jradar.data import matches_of, prepare_frame

    matches = matches_of(recording, spec)
    wanted = range(*options.frames.indices(len(recording.cubes)))
    found = [pair for pair in zip(*matches[:2], strict=True) if pair[0] in wanted]
    if not found:
        raise ValueError(
            f"{recording.path}: none of the frames asked for has a LiDAR scan: "
            f"{next(iter(matches.dropped.values()), 'there are none')}"
        )
    i, j = map(int, found[0])
    frame, steps, trusted = prepare_frame(recording, i, j, spec)
    path = Path(options.output) / "preparation.png"
    figure = viz.preparation_figure(
        steps,
        trusted,
        spec.lidar,
        title=f"{recording.name}, frame {frame.frame}",
    )
    viz.save_figure(figure, path)
    return {
        "capture": str(recording.path),
        "frame": frame.frame,
        "LiDAR points": len(steps.xyz),
        "radar points": len(trusted),
        "in the shared view": int(steps.in_view.sum()),
        "floor and ceiling": int((steps.ground | steps.ceiling).sum()),
        "kept": len(frame.lidar_xyz),
        "matched frames": len(matches.radar),
        "notes": list(recording.notes),
        "written": [str(path)],
    }


def _open(options):
    """The recording and its calibrated frame that the options name."""
    from jradar.recordings import calibrated_cube, open_recording

    recording = open_recording(
        options.path,
        options.radar,
        sensor=options.sensor,
        frames_as_chirps=options.frames_as_chirps,
        iq_order=options.iq_order,
        allow_partial=options.allow_partial,
        device=options.device,
    )
    count = len(recording.cubes)
    if not 0 <= options.frame < count:
        raise ValueError(
            f"--frame {options.frame}: {options.path} has frames 0 to {count - 1}"
        )
    return recording, calibrated_cube(recording, options.frame)


def _points(cube, recording, *, guard=(2, 2), train=(4, 4), **options):
    """Points of a frame; CFAR window and angle bins are fitted to the radar."""
    from jradar.radar import azimuth_bins, largest_window, radar_points

    guard, train = largest_window(recording.radar.cube_shape, guard, train)
    options.setdefault("num_azimuth", azimuth_bins(recording.radar))
    return radar_points(
        cube,
        recording.radar,
        coupling=recording.coupling,
        range_bias_m=recording.range_bias_m,
        guard=guard,
        train=train,
        **options,
    )


def _time_offset(recording):
    """What the motion that both sensors saw says of their clocks."""
    from jradar.recordings import propose_offset

    try:
        seconds, confidence = propose_offset(recording)
    except ValueError as error:
        return {"not estimated": str(error)}
    return {"add to the radar's start (s)": seconds, "confidence, 0 to 1": confidence}


def _echoes(cloud, radar):
    """The strongest echoes as dictionaries."""
    from jradar.radar import strongest_echoes

    return [echo._asdict() for echo in strongest_echoes(cloud, radar)]


def _summary(recording, notes=()):
    """What commands that write say of the recording that they read."""
    return {
        "capture": str(recording.path),
        "radar": recording.radar.name,
        "frames": len(recording.cubes),
        "notes": [*recording.notes, *notes],
    }
