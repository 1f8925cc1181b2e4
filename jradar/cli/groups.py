"""Options that several commands share; `options` builds the commands from them."""

import argparse
import dataclasses
import functools
import os
import typing
from typing import Any

from jradar.cli import values
from jradar.options.boards import BOARDS
from jradar.options.drawing import FLAGS, Drawing, given
from jradar.options.models import DEFAULT
from jradar.options.outputs import CLOUDS
from jradar.options.points import PointSpec
from jradar.options.recordings import IQ_ORDERS, SENSORS

Options = argparse._ActionsContainer  # a command, or a group of its options

MAX_COUNT = 10**9
CHANCE: dict[str, Any] = {"type": values.share, "default": 0.0}
MAX_FUSED = 16
MODEL = "name of a shipped model, or folder of a model or of its training"
KINDS: dict[Any, dict[str, Any]] = {  # by the annotation of a field
    bool: {"action": argparse.BooleanOptionalAction},
    str: {"metavar": "NAME"},
    int: {"metavar": "N", "type": functools.partial(values.whole, 0, 1 << 20)},
    float: {"metavar": "X", "type": values.positive},
    tuple[int, int]: {"metavar": "D,R", "type": values.cells},
}


def flag(sub: Options, name: str | tuple[str, str], text: str) -> None:
    """Add an option without a value, by its name, or by a short and a long one."""
    names = (name,) if isinstance(name, str) else name
    sub.add_argument(*names, action="store_true", help=text)


def option(sub: Options, name: str, metavar: str, text: str, **options: Any) -> None:
    """Add an option with a value."""
    sub.add_argument(name, metavar=metavar, help=text, **options)


def count(
    sub: Options, name: str, text: str, *, most: int = MAX_COUNT, **options: Any
) -> None:
    """Add an option whose value is a whole number from 1 to `most`."""
    option(
        sub, name, "N", text, type=functools.partial(values.whole, 1, most), **options
    )


def workers(sub: Options) -> None:
    """Add where the jobs of several recordings run."""
    text = "processes on this machine (default: its CPU cores, %(default)s)"
    count(sub, "--workers", text, default=os.cpu_count() or 1)
    text = "run on the Dask cluster at this address instead"
    option(sub, "--scheduler", "ADDRESS", text)


def recording(sub: Options) -> None:
    """Add the options of opening a recording."""
    text = "description of the radar: a .toml, .cfg or .lua, a log or a calib folder"
    option(sub, "--radar", "FILE", text)
    device(sub)
    sub.add_argument(
        "--sensor",
        choices=SENSORS,
        help="radar of a ColoRadar sequence (default: single_chip if it has both)",
    )
    text = f"order of I and Q in adc_data.bin: {', '.join(IQ_ORDERS)}"
    text += " (default: as in the radar's description)"
    option(sub, "--iq-order", "ORDER", text)
    text = "accept an adc_data.bin that ends inside a frame; leave that frame out"
    flag(sub, "--allow-partial", text)
    text = "topic of a radar's points in a bag (default: the only one with a velocity)"
    option(sub, "--topic", "NAME", text)


def device(sub: Options) -> None:
    """Add the option that names the board of a .cfg or .lua."""
    text = f"board of a .cfg, .lua or .json: {', '.join(BOARDS)} (default: awr1843)"
    option(sub, "--device", "NAME", text, choices=tuple(BOARDS))


def frame(sub: Options, *, several: bool = False) -> None:
    """Add the options that choose a frame or, for commands on `several`, frames."""
    which = sub.add_mutually_exclusive_group()
    option(which, "--frame", "N", "frame to read (default: 0)", type=int)
    if several:
        text = "frames A to B-1, each written to its own folder inside DIR"
        option(which, "--frames", "A:B", text, type=values.frames)
        text = "write only clouds, in a folder for each kind: DIR/enhanced/000010.ply, "
        text += "as KISS-ICP and other tools read them"
        flag(sub, "--flat", text)
    text = "read a recording of one chirp per frame as one frame of many chirps"
    flag(sub, "--frames-as-chirps", text)


def all_frames(sub: Options, text: str) -> None:
    """Add the option that chooses frames, for a command that takes all by default."""
    option(sub, "--frames", "A:B", text, type=values.frames, default=slice(None))


def output(
    sub: Options,
    text: str = "output folder, created if missing",
    *,
    file_begins: str | None = None,
    suffixes: tuple[str, ...] = (),
    may_stream: bool = False,
    required: bool = True,
    force: bool = True,
) -> None:
    """Add the output: a folder or, with `file_begins`, a file.

    The file begins so if the command wrote it, and has one of the `suffixes`. If the
    output `may_stream`, it can also be one file or bag of all frames. `force` adds the
    option to replace anything.
    """
    folder = file_begins is None
    metavar = "OUT" if may_stream else "DIR" if folder else "FILE"
    sub.add_argument("-o", "--output", metavar=metavar, required=required, help=text)
    sub.set_defaults(output_is_folder=folder, output_may_stream=may_stream)
    sub.set_defaults(output_begins=file_begins, output_suffixes=suffixes)
    if force:
        text = "also replace files that another program or command wrote"
        flag(sub, "--force", text)


def model(sub: Options, more: str = "") -> None:
    """Add the option that names the model."""
    text = f"{MODEL}{more} (default: %(default)s)"
    option(sub, "--model", "NAME|FOLDER", text, default=DEFAULT)


def background(sub: Options) -> None:
    """Add the option that names the frames of the background."""
    text = "subtract the mean of frames A to B-1, for a radar that stands still; "
    text += "frames of the empty room are best, and : takes all frames"
    option(sub, "--background", "A:B", text, type=values.frames)


def clouds(sub: Options) -> None:
    """Add the limits and the format of clouds."""
    sub.add_argument(
        "--format",
        choices=CLOUDS,
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


def seed(sub: Options, text: str) -> None:
    """Add the seed of a random generator."""
    text += " (default: %(default)s)"
    option(sub, "--seed", "N", text, type=values.seed_value, default=0)


def drawing(sub: Options) -> None:
    """Add the options of drawing."""
    for name, (flag_, text, most) in FLAGS.items():
        if most is None:
            option(sub, flag_, "P", text, type=values.share, dest=name)
        else:
            count(sub, flag_, text, most=most, dest=name)


def given_drawing(options: argparse.Namespace) -> Drawing:
    """Return the options of drawing that the user gave."""
    return Drawing(**given({name: getattr(options, name) for name in FLAGS}))


def fusing(sub: Options) -> None:
    """Add the number of frames to fuse."""
    text = "fuse each frame with the N - 1 before it, by recorded poses or else by the "
    text += "radar's velocity, with its IMU if there is one (default: %(default)s)"
    count(sub, "--fuse", text, most=MAX_FUSED, default=1)
    text = "instead add the points of the last S seconds to those of each frame, moved "
    text += "to where they are now; for a radar that sends few (default: 0)"
    option(sub, "--history", "S", text, type=values.positive, default=0.0)


def anyway(sub: Options) -> None:
    """Add the option to enhance a radar with one row of antennas, too."""
    text = "also enhance a radar with one row of antennas; heights are then invented"
    flag(sub, "--anyway", text)


def network(sub: Options, host: str, card: str) -> None:
    """Add the addresses of this machine and of the card."""
    for name, default, what in (
        ("--host", host, "address that receives the packets"),
        ("--card", card, "address of the card"),
    ):
        option(sub, name, "ADDRESS", f"{what} (default: {default})", default=default)
    for name, port in (("--command-port", 4096), ("--data-port", 4098)):
        text = "UDP port (default: %(default)s)"
        option(sub, name, "PORT", text, type=values.port, default=port)


def playing(sub: Options) -> None:
    """Add the options of playing a recording."""
    text = "play S times as fast as it was recorded (default: 1)"
    option(sub, "--speed", "S", text, type=values.positive, default=1.0)
    option(sub, "--loss", "P", "lose packets with this probability", **CHANCE)
    text = "delay packets by up to N places"
    option(sub, "--reorder", "N", text, type=values.places, default=0)
    option(
        sub, "--duplicate", "P", "send packets twice with this probability", **CHANCE
    )
    flag(sub, "--repeat", "begin again at the end of the recording")


def add_point_options(sub: Options, *names: str) -> None:
    """Add an option for each field of `PointSpec`, or for those of these names."""
    kinds = typing.get_type_hints(PointSpec)
    for field in dataclasses.fields(PointSpec):
        if names and field.name not in names:
            continue
        kind, default, text = kinds[field.name], field.default, field.metadata["help"]
        options = KINDS[kind if kind in KINDS else typing.get_args(kind)[0]]
        if default is False:
            options = {"action": "store_const", "const": True}
        elif default is not None:
            shown = "yes" if default is True else str(default).strip("()")
            text = f"{text} (default: {shown.replace(', ', ',')})"
        flag = "--" + field.name.replace("_", "-")
        sub.add_argument(flag, help=text, default=None, **options)


def given_points(options: argparse.Namespace) -> dict[str, Any]:
    """Return the fields of `PointSpec` that the user gave."""
    names = [field.name for field in dataclasses.fields(PointSpec)]
    found = {name: getattr(options, name, None) for name in names}
    return {name: value for name, value in found.items() if value is not None}
