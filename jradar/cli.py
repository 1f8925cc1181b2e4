"""The command line: `jradar info | points | enhance`.

Heavy modules are imported by the command that needs them, so that `--help` and a wrong
option answer at once. Exit codes: 0 ok, 2 usage, 3 environment, 4 bad data, 5 no usable
weights.
"""

import argparse
import json
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from jradar import __version__
from jradar.files import use_compilation_cache

CAPTURE_HELP = """\
PATH names a recording:

  cube.npy         complex samples; --radar names the TOML file that describes the
                   radar and the cube's axes
  adc_data.bin     of a DCA1000; --radar names the log of mmWave Studio, the .cfg of
                   the mmWave SDK or a TOML file
  a folder         a sequence of ColoRadar, such as 12_21_2020_ec_hallways_run0;
                   --radar names calib/ where it is not inside, beside or above it

Without --radar the only such file beside the recording is taken."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    options = _parser().parse_args(argv)
    use_compilation_cache()
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            return _print(options.command(options), options.json)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except KeyboardInterrupt:
        return 130
    except Exception as error:
        code = _exit_code(error)
        if code is None:
            raise
        print(f"jradar: {error}", file=sys.stderr)
        return code


def info(options: argparse.Namespace) -> dict[str, Any]:
    """What a recording, a bag or a cloud holds, and whether it can be read."""
    from jradar.data import describe, describe_file

    if (found := describe_file(options.path)) is not None:
        return found
    recording, cube = _open(options)
    found = {}
    for kind, remove_static in (("echoes", False), ("moving echoes", True)):
        if remove_static and recording.radar.num_chirps == 1:
            continue
        cloud = _points(cube, recording, remove_static=remove_static)
        found[kind] = _echoes(cloud, recording.radar)
    return {**describe(recording), "frame": options.frame, **found}


def points(options: argparse.Namespace) -> dict[str, Any]:
    """Detections of a frame, as PLY, NPZ and a picture."""
    recording, cube = _open(options)
    from jradar import data, radar as radar_room, viz
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
        lidar=data.nearest_scan(recording, options.frame),
        title=f"{recording.name}, frame {options.frame}",
    )
    folder = Path(options.output)
    data.write_ply(folder / "radar.ply", cloud)
    data.write_npz(folder / "radar.npz", data.valid_points(cloud))
    viz.save_figure(figure, folder / "capture.png")
    return {
        **_summary(recording),
        "frame": options.frame,
        "points": int(cloud.valid.sum()),
        "echoes": _echoes(cloud, radar),
        "written": [str(folder / n) for n in ("radar.ply", "radar.npz", "capture.png")],
    }


def enhance(options: argparse.Namespace) -> dict[str, Any]:
    """The dense cloud that a trained model draws for a frame."""
    from jradar.bundle import load_bundle

    params, spec = load_bundle(options.weights)
    recording, cube = _open(options)
    import jax

    from jradar import data, diffusion, radar as radar_room, viz
    from jradar.pipeline import draw_range_image
    from jradar.range_image import condition_image, unproject

    cloud = _points(cube, recording, **spec.points)
    image = jax.jit(
        lambda key, condition: draw_range_image(
            key,
            condition,
            diffusion.conditional_denoiser(spec.network, params, spec.noise),
            fine=spec.fine,
            noise=spec.noise,
            codec=spec.codec,
            validity_threshold=spec.validity_threshold,
            steps=options.steps,
        )
    )(
        jax.random.key(options.seed),
        condition_image(cloud, spec.coarse, num_slices=spec.num_slices),
    )
    dense = unproject(image, spec.fine)
    weights = {
        "folder": str(options.weights),
        "purpose": spec.purpose,
        "training steps": spec.steps_seen,
        "trained on": f"{spec.trained_on}, radar {spec.radar.name}",
    }
    notes = []
    if not recording.radar.has_elevation:
        notes.append(
            "this radar has one row of antennas and measures no elevation: the "
            "condition is flat, and heights in the result come from the model alone"
        )
    figure = viz.capture_figure(
        radar_room.power_map(cube),
        recording.radar,
        cloud,
        spec.fine,
        dense=dense,
        lidar=data.nearest_scan(recording, options.frame),
        title=f"{recording.name}, frame {options.frame}; weights: {spec.purpose}",
    )
    folder = Path(options.output)
    names = ("radar.ply", "enhanced.ply", "enhanced.npz", "capture.png")
    data.write_ply(folder / names[0], cloud)
    data.write_ply(folder / names[1], dense)
    columns = data.valid_points(dense) | {"range_image": image}
    data.write_npz(folder / names[2], columns)
    viz.save_figure(figure, folder / names[3])
    return {
        **_summary(recording, notes),
        "frame": options.frame,
        "weights": weights,
        "radar points": int(cloud.valid.sum()),
        "enhanced points": int(dense.valid.sum()),
        "written": [str(folder / name) for name in names],
    }


def _parser() -> argparse.ArgumentParser:
    """Options of all commands."""
    parser = argparse.ArgumentParser(
        prog="jradar", description="Dense point clouds from mmWave radar."
    )
    parser.add_argument("--version", action="version", version=f"jradar {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def add(command: Callable, *, writes: bool) -> argparse.ArgumentParser:
        """A command with the options that all have."""
        summary = (command.__doc__ or "").splitlines()[0]
        sub = commands.add_parser(
            command.__name__,
            help=summary,
            description=f"{summary}\n\n{CAPTURE_HELP}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        sub.set_defaults(command=command)
        sub.add_argument("path", metavar="PATH", help="file or folder")
        sub.add_argument(
            "--radar", metavar="FILE", help="TOML file, log, .cfg or calib folder"
        )
        sub.add_argument(
            "--sensor",
            choices=("single_chip", "cascade"),
            help="radar of a ColoRadar sequence (single_chip where it has both)",
        )
        sub.add_argument(
            "--iq-order",
            metavar="ORDER",
            help="how I and Q alternate in adc_data.bin, if not as described: IIQQ..",
        )
        sub.add_argument(
            "--allow-partial",
            action="store_true",
            help="take the whole frames of an adc_data.bin that was cut off",
        )
        sub.add_argument("--frame", type=int, default=0, help="which frame (default 0)")
        sub.add_argument(
            "--frames-as-chirps",
            action="store_true",
            help="one chirp per frame: take the frames as slow time",
        )
        sub.add_argument("--json", action="store_true", help="print JSON and only that")
        if writes:
            sub.add_argument("-o", "--output", metavar="DIR", required=True)
        return sub

    add(info, writes=False)
    sub = add(points, writes=True)
    sub.add_argument("--capacity", type=_at_least_1, default=1024, help="most points")
    sub.add_argument("--detector", choices=("ca", "go", "so", "os"), default="os")
    sub.add_argument("--false-alarm-rate", type=_rate, default=1e-3, metavar="RATE")
    sub.add_argument("--remove-static", action="store_true", help="movers only")
    sub = add(enhance, writes=True)
    sub.add_argument("--weights", metavar="BUNDLE", required=True, help="bundle folder")
    sub.add_argument("--steps", type=_at_least_1, default=18, help="sampling steps")
    sub.add_argument("--seed", type=int, default=0, help="of the drawn sample")
    return parser


def _at_least_1(text: str) -> int:
    """A whole number of 1 or more."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}, expected 1 or more")
    return int(text)


def _rate(text: str) -> float:
    """A false-alarm rate."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value <= 1:
        raise argparse.ArgumentTypeError(f"{text!r}, expected more than 0, at most 1")
    return value


def _open(options):
    """The recording and its calibrated frame that the options name."""
    from jradar.data import calibrated_cube, open_recording

    recording = open_recording(
        options.path,
        options.radar,
        sensor=options.sensor,
        frames_as_chirps=options.frames_as_chirps,
        iq_order=options.iq_order,
        allow_partial=options.allow_partial,
    )
    count = len(recording.cubes)
    if not 0 <= options.frame < count:
        raise ValueError(
            f"--frame {options.frame}: {options.path} has frames 0 to {count - 1}"
        )
    return recording, calibrated_cube(recording, options.frame)


def _points(cube, recording, *, guard=(2, 2), train=(4, 4), **options):
    """Points of a frame; CFAR window and angle bins are fitted to the radar."""
    from jradar.radar import largest_window, radar_points

    guard, train = largest_window(recording.radar.cube_shape, guard, train)
    columns = int(recording.radar.virtual_positions[:, 0].max()) + 1
    options.setdefault("num_azimuth", max(64, 1 << (columns - 1).bit_length()))
    return radar_points(
        cube,
        recording.radar,
        coupling=recording.coupling,
        range_bias_m=recording.range_bias_m,
        guard=guard,
        train=train,
        **options,
    )


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


def _print(result: dict[str, Any], as_json: bool) -> int:
    """The result on stdout, as JSON or as lines."""
    text = json.dumps(result, indent=2) if as_json else "\n".join(_lines(result))
    print(text, flush=True)
    return 0


def _lines(value: Any, indent: str = ""):
    """Nested dictionaries and lists as indented lines."""
    for key, item in value.items():
        if isinstance(item, dict):
            yield f"{indent}{key}"
            yield from _lines(item, indent + "  ")
        elif isinstance(item, list) and item and isinstance(item[0], dict):
            yield f"{indent}{key}"
            yield from (f"{indent}  {line}" for line in _table(item))
        elif isinstance(item, list) and item and isinstance(item[0], str):
            yield f"{indent}{key}"
            yield from (f"{indent}  {text}" for text in item)
        elif item or item == 0:
            yield f"{indent}{key:<27} {_short(item)}"


def _table(rows):
    """Dictionaries with the same keys as lines of a table."""
    cells = [[*rows[0]], *([_short(v) for v in row.values()] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for row in cells:
        yield "  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True))


def _show_warning(message, *_args, **_kwargs):
    """A warning as one line, without the place in the code that a user cannot mend."""
    print(f"jradar: warning: {message}", file=sys.stderr)


def _short(value):
    """A value with as many digits as people read."""
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1 else f"{value:.2f}"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list) and value and isinstance(value[0], float):
        return "  ".join(f"{number:.4g}" for number in value)
    if value is None:
        return "-"
    return " x ".join(map(str, value)) if isinstance(value, list) else str(value)


def _exit_code(error):
    """Exit code of an error that a user can mend; None for a fault of ours."""
    from jradar.bundle import BundleError

    codes = {
        BundleError: 5,
        FileNotFoundError: 2,
        ValueError: 4,
        OSError: 3,
        ImportError: 3,
    }
    return next((code for kind, code in codes.items() if isinstance(error, kind)), None)


if __name__ == "__main__":
    sys.exit(main())
