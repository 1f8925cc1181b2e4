"""The options of all commands; nothing heavy is imported here."""

import argparse
import os
from collections.abc import Callable

from jradar import __version__
from jradar.cli import commands

CAPTURE_HELP = """\
PATH names a recording:

  cube.npy         complex samples; --radar names the TOML file that describes the
                   radar and the cube's axes
  adc_data.bin     of a DCA1000; --radar names the log of mmWave Studio, the .cfg of
                   the mmWave SDK or a TOML file
  a folder         with a capture.toml; or a sequence of ColoRadar, such as
                   12_21_2020_ec_hallways_run0, for which --radar names calib/ where
                   it is not inside, beside or above it

Without --radar the only such file beside the recording is taken."""
FILES_HELP = """

PATH may also be a bag (.bag, .mcap, .db3, a ROS 2 folder) or a cloud (.ply, .pcd, a
.bin of KITTI or of ColoRadar's LiDAR)."""
FAMILIES = ("hallways", "mine", "lab", "outdoor", "corridor", "hall")
PREPARE_HELP = """

PATH may also be a folder of ColoRadar sequences: all are prepared. Started again, it
finishes what is missing."""


def parser() -> argparse.ArgumentParser:
    """Options of all commands."""
    top = argparse.ArgumentParser(
        prog="jradar", description="Dense point clouds from mmWave radar."
    )
    top.add_argument("--version", action="version", version=f"jradar {__version__}")
    kinds = top.add_subparsers(required=True, metavar="COMMAND")
    sub = _add(kinds, commands.info, FILES_HELP)
    _recording(sub)
    _frame(sub)
    sub = _add(kinds, commands.points)
    _recording(sub)
    _frame(sub)
    _output(sub)
    sub.add_argument(
        "--capacity", type=_at_least_1, default=1024, metavar="N", help="most points"
    )
    sub.add_argument(
        "--detector", choices=("ca", "go", "so", "os"), default="os", help="CFAR"
    )
    sub.add_argument(
        "--false-alarm-rate",
        type=_rate,
        default=1e-3,
        metavar="RATE",
        help="of each cell of noise (default 0.001)",
    )
    sub.add_argument("--remove-static", action="store_true", help="movers only")
    sub = _add(kinds, commands.enhance)
    _recording(sub)
    _frame(sub, several=True)
    _output(sub)
    sub.add_argument(
        "--weights",
        metavar="BUNDLE",
        help="bundle folder, or the name of shipped weights (jradar-sim)",
    )
    _sampling(sub)
    sub.add_argument("--seed", type=int, default=0, help="of the drawn sample")
    _prepare(_add(kinds, commands.prepare, PREPARE_HELP))
    _simulate(_add(kinds, commands.simulate, has_path=False))
    sub = _add(kinds, commands.view, has_path=False)
    sub.add_argument("run", metavar="RUN", help="workdir of an experiment")
    sub.add_argument("--no-open", action="store_true", help="only say where it is")
    sub = _add(kinds, commands.export, has_path=False)
    sub.add_argument("weights", metavar="BUNDLE", help="bundle folder, or shipped name")
    sub.add_argument("-o", "--output", metavar="FILE", required=True)
    _sampling(sub)
    sub.add_argument(
        "--coupling", metavar="FILE", help="this radar's own, coupling_calib.txt"
    )
    return top


def _sampling(sub):
    """How the diffusion model is sampled."""
    sub.add_argument(
        "--draws",
        type=_at_least_1,
        default=1,
        help="more than one: what so many quick draws agree on; 8 take about as long",
    )
    sub.add_argument(
        "--steps", type=_at_least_1, help="of a draw (18; of one of several, 5)"
    )


def _add(kinds, command: Callable, more: str = "", *, has_path: bool = True):
    """A command's parser, with what all have."""
    summary = (command.__doc__ or "").splitlines()[0]
    sub = kinds.add_parser(
        command.__name__,
        help=summary,
        description=f"{summary}\n\n{CAPTURE_HELP}{more}" if has_path else summary,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    sub.set_defaults(command=command)
    sub.add_argument("--json", action="store_true", help="print JSON and only that")
    if has_path:
        sub.add_argument("path", metavar="PATH", help="file or folder")
    return sub


def _recording(sub):
    """How a recording is opened."""
    sub.add_argument(
        "--radar", metavar="FILE", help="TOML file, log, .cfg or calib folder"
    )
    sub.add_argument(
        "--device", metavar="NAME", help="board of a .cfg, such as xwr1642 (xwr1843)"
    )
    sub.add_argument(
        "--sensor",
        choices=("single_chip", "cascade"),
        help="radar of a ColoRadar sequence (single_chip where it has both)",
    )
    sub.add_argument(
        "--iq-order",
        metavar="ORDER",
        help="how I and Q alternate in adc_data.bin, if not as described: IIQQ, "
        "QQII, IQIQ, QIQI, I4Q4 or Q4I4",
    )
    sub.add_argument(
        "--allow-partial",
        action="store_true",
        help="take the whole frames of an adc_data.bin that was cut off",
    )


def _frame(sub, *, several: bool = False):
    """Which frame, or which frames."""
    which = sub.add_mutually_exclusive_group()
    which.add_argument("--frame", type=int, default=0, help="which frame (default 0)")
    if several:
        which.add_argument(
            "--frames",
            type=_frames,
            metavar="A:B",
            help="from A up to B, each in a folder of its own below DIR",
        )
    sub.add_argument(
        "--frames-as-chirps",
        action="store_true",
        help="one chirp per frame: take the frames as slow time",
    )


def _output(sub):
    """Where to write."""
    sub.add_argument(
        "-o", "--output", metavar="DIR", required=True, help="made if need be"
    )


def _prepare(sub):
    """Options of `jradar prepare`."""
    _recording(sub)
    _output(sub)
    sub.add_argument(
        "--spec",
        metavar="FILE",
        help="TOML file with whatever differs from the defaults of PrepareSpec",
    )
    sub.add_argument(
        "--frames",
        type=_frames,
        default=slice(None),
        metavar="A:B",
        help="of each sequence, from A up to B (all)",
    )
    cores = os.cpu_count() or 1
    sub.add_argument(
        "--workers",
        type=_at_least_1,
        default=cores,
        metavar="N",
        help=f"processes of this machine (its cores, {cores})",
    )
    sub.add_argument(
        "--scheduler", metavar="ADDRESS", help="run in this Dask cluster instead"
    )
    sub.add_argument(
        "--keep-going",
        action="store_true",
        help="drop and count frames that cannot be read",
    )
    sub.add_argument(
        "--preview",
        action="store_true",
        help="only a picture of each step on the first of the frames",
    )


def _simulate(sub):
    """Options of `jradar simulate`."""
    _output(sub)
    sub.add_argument("--scene", choices=FAMILIES, help="kind of scene")
    sub.add_argument(
        "--set", metavar="NAME", help="a whole set: jradar-sim, or -test or -mini"
    )
    sub.add_argument(
        "--frames",
        type=_at_least_1,
        metavar="N",
        help="of each sequence (50; 4 in a set)",
    )
    sub.add_argument("--seed", type=int, default=0, help="of the scene (default 0)")
    sub.add_argument(
        "--sensor",
        choices=("single_chip", "cascade", "both"),
        default="single_chip",
        help="radar (default single_chip)",
    )
    sub.add_argument(
        "--format",
        choices=("coloradar", "capture"),
        default="coloradar",
        help="layout of ColoRadar, or a DCA1000's file and a Livox's bag",
    )
    sub.add_argument(
        "--dry-run", action="store_true", help="say size and time, write nothing"
    )


def _frames(text: str) -> slice:
    """A range A:B of frames, either end open."""
    first, colon, last = text.partition(":")
    if not colon or not all(part.isdecimal() or not part for part in (first, last)):
        raise argparse.ArgumentTypeError(f"{text!r}, expected A:B, such as 0:100")
    chosen = slice(*(int(part) if part else None for part in (first, last)))
    if chosen.stop is not None and chosen.stop <= (chosen.start or 0):
        raise argparse.ArgumentTypeError(f"{text!r} holds no frame")
    return chosen


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
