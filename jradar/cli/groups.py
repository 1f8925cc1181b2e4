"""Options that several commands share; `options` builds the commands from them.

The fields of `PointSpec` are read from its source: importing the class would load JAX,
and `--help` would wait for it.
"""

import argparse
import ast
import functools
from pathlib import Path
from typing import Any

from jradar.cli import values

DEVICES = (
    *("awr1443", "awr1642", "awr1843", "awr2944"),
    *("iwr6843isk", "iwr6843ods", "iwr6843aop"),
)
CLOUD_FORMATS = ("ply", "pcd", "csv")
MAX_COUNT = 10**9
CHANCE: dict[str, Any] = {"type": values.share, "default": 0.0}
MAX_DRAWS, MAX_STEPS = 64, 1000
MODEL = "name of a shipped model, or folder of a model or of its training"
SOURCE = Path(__file__).parents[1] / "radar" / "point_spec.py"
KINDS: dict[str, dict[str, Any]] = {  # by the annotation of a field
    "str": {"metavar": "NAME"},
    "int": {"metavar": "N", "type": functools.partial(values.whole, 0, 1 << 20)},
    "float": {"metavar": "X", "type": values.positive},
    "tuple[int, int]": {"metavar": "D,R", "type": values.cells},
}


def flag(sub, name: str, text: str):
    """Add an option without a value."""
    sub.add_argument(name, action="store_true", help=text)


def option(sub, name: str, metavar: str, text: str, **options):
    """Add an option with a value."""
    sub.add_argument(name, metavar=metavar, help=text, **options)


def count(sub, name: str, text: str, *, most: int = MAX_COUNT, **options):
    """Add an option whose value is a whole number from 1 to `most`."""
    option(
        sub, name, "N", text, type=functools.partial(values.whole, 1, most), **options
    )


def recording(sub):
    """Add how a recording is opened."""
    text = "description of the radar: a .toml, a .cfg, a log or a calib folder"
    option(sub, "--radar", "FILE", text)
    device(sub)
    sub.add_argument(
        "--sensor",
        choices=("single_chip", "cascade"),
        help="radar of a ColoRadar sequence (default: single_chip if it has both)",
    )
    text = "order of I and Q in adc_data.bin: IIQQ, QQII, IQIQ, QIQI, I4Q4 or Q4I4"
    text += " (default: as in the radar's description)"
    option(sub, "--iq-order", "ORDER", text)
    text = "accept an adc_data.bin that ends inside a frame; leave that frame out"
    flag(sub, "--allow-partial", text)


def device(sub):
    """Add the board of a .cfg."""
    text = f"board that a .cfg was written for: {', '.join(DEVICES)} (default: awr1843)"
    option(sub, "--device", "NAME", text, choices=DEVICES)


def frame(sub, *, several: bool = False):
    """Add which frame is read, or which frames."""
    which = sub.add_mutually_exclusive_group()
    option(which, "--frame", "N", "frame to read (default: 0)", type=int)
    if several:
        text = "frames A to B-1, each written to its own folder inside DIR"
        option(which, "--frames", "A:B", text, type=values.frames)
        text = "write clouds alone, one folder of each kind: DIR/enhanced/000010.ply, "
        text += "as KISS-ICP and other tools read them"
        flag(sub, "--flat", text)
    text = "read a recording of one chirp per frame as one frame of many chirps"
    flag(sub, "--frames-as-chirps", text)


def all_frames(sub, text: str):
    """Add which frames a command uses that takes all by default."""
    option(sub, "--frames", "A:B", text, type=values.frames, default=slice(None))


def output(
    sub,
    text: str = "output folder, created if missing",
    *,
    file_begins: str | None = None,
    may_stream: bool = False,
    required: bool = True,
    force: bool = True,
):
    """Add the output, a folder; or a file, which begins so if the command wrote it.

    Where it `may_stream`, it can be one file or bag of all frames. With `force`, the
    user can have anything replaced.
    """
    folder = file_begins is None
    metavar = "OUT" if may_stream else "DIR" if folder else "FILE"
    sub.add_argument("-o", "--output", metavar=metavar, required=required, help=text)
    sub.set_defaults(output_is_folder=folder, output_may_stream=may_stream)
    sub.set_defaults(output_begins=file_begins)
    if force:
        text = "also replace files that another program or command wrote"
        flag(sub, "--force", text)


def model(sub, more: str = ""):
    """Add which model is used."""
    text = f"{MODEL}{more} (default: %(default)s)"
    option(sub, "--model", "NAME|FOLDER", text, default="jradar-sim")


def background(sub):
    """Add which frames of a standing radar are its background."""
    text = "subtract the mean of frames A to B-1, for a radar that stands still: best "
    text += "frames of the empty room, or all of them with :"
    option(sub, "--background", "A:B", text, type=values.frames)


def clouds(sub):
    """Add how clouds are limited and written."""
    sub.add_argument(
        "--format",
        choices=CLOUD_FORMATS,
        default="ply",
        help="format of the clouds, in addition to NPZ (default: %(default)s)",
    )
    for name, metavar, kind, what in (
        ("--min-range", "M", values.positive, "nearer than M metres"),
        ("--max-range", "M", values.positive, "farther than M metres"),
        ("--max-azimuth", "DEG", values.angle, "more than DEG degrees to either side"),
        ("--max-elevation", "DEG", values.angle, "more than DEG degrees up or down"),
    ):
        option(sub, name, metavar, f"leave out points {what}", type=kind)


def seed(sub, text: str):
    """Add the seed of a random generator."""
    text += " (default: %(default)s)"
    option(sub, "--seed", "N", text, type=values.seed_value, default=0)


def drawing(sub):
    """Add how a diffusion model is sampled."""
    text = "draw N samples and keep the points on which they agree; the paper draws 1"
    count(sub, "--draws", f"{text} (default: 8)", most=MAX_DRAWS)
    text = "solver steps per draw (default: 5 for several draws, 18 for one); one draw"
    text += " takes Heun's method, or iPNDM below 8 steps"
    count(sub, "--steps", text, most=MAX_STEPS)


def anyway(sub):
    """Add that a radar with one row of antennas is enhanced too."""
    text = "also enhance a radar with one row of antennas; heights are then invented"
    flag(sub, "--anyway", text)


def network(sub, host: str, card: str):
    """Add the addresses of this machine and of the card."""
    for name, default, what in (
        ("--host", host, "address that receives the packets"),
        ("--card", card, "address of the card"),
    ):
        option(sub, name, "ADDRESS", f"{what} (default: {default})", default=default)
    for name, port in (("--command-port", 4096), ("--data-port", 4098)):
        text = "UDP port (default: %(default)s)"
        option(sub, name, "PORT", text, type=values.port, default=port)


def playing(sub):
    """Add how a recording is played."""
    text = "play S times as fast as it was recorded (default: 1)"
    option(sub, "--speed", "S", text, type=values.positive, default=1.0)
    option(sub, "--loss", "P", "lose packets with this probability", **CHANCE)
    text = "packets are late by up to N places"
    option(sub, "--reorder", "N", text, type=values.places, default=0)
    option(
        sub, "--duplicate", "P", "send packets twice with this probability", **CHANCE
    )
    flag(sub, "--repeat", "begin again at the end of the recording")


@functools.cache
def point_fields() -> dict[str, tuple[str, Any, str]]:
    """Return type, default and help of each field of `PointSpec`, in their order."""
    module = ast.parse(SOURCE.read_text(encoding="utf-8"))
    (body,) = (n.body for n in module.body if isinstance(n, ast.ClassDef))
    found = {}
    for field, below in zip(body, body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(below, ast.Expr):
            kind = ast.unparse(field.annotation).removesuffix(" | None")
            default = ast.literal_eval(ast.unparse(field.value or ast.Constant(None)))
            text = " ".join(ast.literal_eval(below.value).split())
            found[ast.unparse(field.target)] = kind, default, text
    return found


def add_point_options(sub: argparse.ArgumentParser, *names: str) -> None:
    """Add an option for each field of `PointSpec`, or for those of these names."""
    for name, (kind, default, text) in point_fields().items():
        if names and name not in names:
            continue
        flag = "--" + name.replace("_", "-")
        if kind == "bool" and not default:
            sub.add_argument(
                flag, action="store_const", const=True, default=None, help=text
            )
        elif kind == "bool":
            optional = argparse.BooleanOptionalAction
            sub.add_argument(flag, action=optional, help=f"{text} (default: yes)")
        else:
            shown = str(default).strip("()").replace(", ", ",")
            text = text if default is None else f"{text} (default: {shown})"
            sub.add_argument(flag, help=text, **KINDS[kind])


def given_points(options: argparse.Namespace) -> dict[str, Any]:
    """Return the fields that the user gave."""
    found = {name: getattr(options, name, None) for name in point_fields()}
    return {name: value for name, value in found.items() if value is not None}
