"""The command line: `jradar info | points | enhance | simulate`.

Heavy modules are imported by the command that needs them, so that `--help` and a wrong
option answer at once. Exit codes: 0 ok, 2 usage, 3 environment, 4 bad data, 5 no usable
weights.
"""

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from jradar import __version__

CAPTURE_HELP = """\
A capture is a complex .npy cube, with --radar naming the TOML file that describes the
radar and the cube's axes, or the adc_data.bin of mmWave Studio and a DCA1000, with its
log as --radar. Without --radar the only such file beside the capture is taken."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    options = _parser().parse_args(argv)
    try:
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
    """What a capture holds: radar, derived limits, strongest echoes of a frame."""
    cubes, cube = _open(options)
    from jradar import radar as radar_room

    found = {}
    window = _window(cubes.radar, (2, 2), (4, 4))
    for kind, remove_static in (("echoes", False), ("moving echoes", True)):
        if remove_static and cubes.radar.num_chirps == 1:
            continue
        cloud = radar_room.radar_points(
            cube, cubes.radar, remove_static=remove_static, **window
        )
        found[kind] = _echoes(cloud, cubes.radar)
    return {**_describe(cubes), "frame": options.frame, **found}


def points(options: argparse.Namespace) -> dict[str, Any]:
    """Detections of a frame, as PLY, NPZ and a picture."""
    cubes, cube = _open(options)
    from jradar import data, radar as radar_room, viz
    from jradar.range_image import ImageSpec

    cloud = radar_room.radar_points(
        cube,
        cubes.radar,
        capacity=options.capacity,
        detector=options.detector,
        false_alarm_rate=options.false_alarm_rate,
        remove_static=options.remove_static,
        **_window(cubes.radar, (2, 2), (4, 4)),
    )
    figure = viz.capture_figure(
        radar_room.power_map(cube, remove_static=options.remove_static),
        cubes.radar,
        cloud,
        ImageSpec(64, 64, max_range_m=cubes.radar.max_range_m),
        title=f"{cubes.path.name}, frame {options.frame}",
    )
    folder = Path(options.output)
    data.write_ply(folder / "radar.ply", cloud)
    data.write_npz(folder / "radar.npz", data.valid_points(cloud))
    viz.save_figure(figure, folder / "capture.png")
    return {
        **_describe(cubes),
        "frame": options.frame,
        "points": int(cloud.valid.sum()),
        "echoes": _echoes(cloud, cubes.radar),
        "written": [str(folder / n) for n in ("radar.ply", "radar.npz", "capture.png")],
    }


def enhance(options: argparse.Namespace) -> dict[str, Any]:
    """The dense cloud that a trained model draws for a frame."""
    from jradar.bundle import load_bundle

    params, spec = load_bundle(options.weights)
    cubes, cube = _open(options)
    import jax

    from jradar import data, diffusion, radar as radar_room, viz
    from jradar.pipeline import draw_range_image
    from jradar.range_image import condition_image, unproject

    model_points = {**spec.points}
    model_points |= _window(
        cubes.radar,
        model_points.pop("guard", (2, 2)),
        model_points.pop("train", (4, 4)),
    )
    cloud = radar_room.radar_points(cube, cubes.radar, **model_points)
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
    if not cubes.radar.has_elevation:
        notes.append(
            "this radar has one row of antennas and measures no elevation: the "
            "condition is flat, and heights in the result come from the model alone"
        )
    figure = viz.capture_figure(
        radar_room.power_map(cube),
        cubes.radar,
        cloud,
        spec.fine,
        dense=dense,
        title=f"{cubes.path.name}, frame {options.frame}; weights: {spec.purpose}",
    )
    folder = Path(options.output)
    names = ("radar.ply", "enhanced.ply", "enhanced.npz", "capture.png")
    data.write_ply(folder / names[0], cloud)
    data.write_ply(folder / names[1], dense)
    columns = data.valid_points(dense) | {"range_image": image}
    data.write_npz(folder / names[2], columns)
    viz.save_figure(figure, folder / names[3])
    return {
        **_describe(cubes, notes),
        "frame": options.frame,
        "weights": weights,
        "radar points": int(cloud.valid.sum()),
        "enhanced points": int(dense.valid.sum()),
        "written": [str(folder / name) for name in names],
    }


def simulate(options: argparse.Namespace) -> dict[str, Any]:
    """Simulated recordings in ColoRadar's layout, or as a capture of one's own."""
    from jradar.data.simulation import simulate

    return simulate(options)


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
        sub.add_argument("capture", metavar="CAPTURE", help=".npy cube or adc_data.bin")
        sub.add_argument(
            "--radar", metavar="FILE", help="TOML file or mmWave Studio log"
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
    _add_simulate(commands)
    return parser


def _add_simulate(commands: Any) -> None:
    """Options of `simulate`."""
    summary = (simulate.__doc__ or "").splitlines()[0]
    sub = commands.add_parser("simulate", help=summary, description=summary)
    sub.set_defaults(command=simulate)
    families = ("hallways", "mine", "lab", "outdoor", "corridor", "hall")
    sub.add_argument("--scene", choices=families, help="kind of scene")
    sub.add_argument("--set", metavar="NAME", help="benchmark set, such as jradar-sim")
    frames = "of each sequence (default 50; 100 in a set)"
    sub.add_argument("--frames", type=_at_least_1, help=frames)
    sub.add_argument("--seed", type=int, default=0, help="of the scene (default 0)")
    sensors = ("single_chip", "cascade", "both")
    sub.add_argument("--sensor", choices=sensors, default="single_chip")
    formats = ("coloradar", "capture")
    sub.add_argument("--format", choices=formats, default="coloradar")
    sub.add_argument("--dry-run", action="store_true", help="say size and time only")
    sub.add_argument("--json", action="store_true", help="print JSON and only that")
    sub.add_argument("-o", "--output", metavar="DIR", required=True)


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
    """The capture and the frame that the options name."""
    from jradar.data import open_cubes

    cubes = open_cubes(
        options.capture, options.radar, frames_as_chirps=options.frames_as_chirps
    )
    if not 0 <= options.frame < len(cubes):
        raise ValueError(
            f"--frame {options.frame}: {cubes.path} has frames 0 to {len(cubes) - 1}"
        )
    return cubes, cubes[options.frame]


def _window(radar, guard, train):
    """CFAR window of the options, cut down to the radar's map."""
    from jradar.radar import largest_window

    guard, train = largest_window(radar.cube_shape, guard, train)
    return {"guard": guard, "train": train}


def _echoes(cloud, radar):
    """The strongest echoes as dictionaries."""
    from jradar.radar import strongest_echoes

    return [echo._asdict() for echo in strongest_echoes(cloud, radar)]


def _describe(cubes, notes=()):
    """A recording and its radar, for people and scripts."""
    radar = cubes.radar
    return {
        "capture": str(cubes.path),
        "frames": len(cubes),
        "radar": {
            "name": radar.name,
            "tx x rx x chirps x samples": list(radar.cube_shape),
            "measures elevation": radar.has_elevation,
            "range_resolution_m": radar.range_resolution_m,
            "max_range_m": radar.max_range_m,
            "velocity_resolution_mps": radar.velocity_resolution_mps,
            "max_velocity_mps": radar.max_velocity_mps,
            "wavelength_m": radar.wavelength_m,
        },
        "notes": [*cubes.notes, *notes],
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
            yield f"{indent}{key:<28}{_short(item)}"


def _table(rows):
    """Dictionaries with the same keys as lines of a table."""
    cells = [[*rows[0]], *([_short(v) for v in row.values()] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    for row in cells:
        yield "  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True))


def _short(value):
    """A value with as many digits as people read."""
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1 else f"{value:.2f}"
    if isinstance(value, bool):
        return "yes" if value else "no"
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
