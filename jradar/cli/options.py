"""The options of all commands. Nothing here imports JAX, so `--help` is fast.

A default that belongs to the library is None here and stays in the library; the help
text shows its value, which a test compares.
"""

import argparse
import os
from collections.abc import Callable

from jradar import __version__
from jradar.cli import commands

RECORDING_HELP = """\
PATH is a recording:

  cube.npy        complex samples; --radar names a TOML file that describes the
                  radar and the axes of the cube
  adc_data.bin    a capture of TI's DCA1000; --radar names the log of mmWave Studio,
                  the .cfg of the mmWave SDK or a TOML file
  a folder        with a capture.toml, or a ColoRadar sequence such as
                  12_21_2020_ec_hallways_run0; --radar names its calib folder if
                  that is not inside, beside or above the sequence

Without --radar, jradar looks for the description beside the recording."""
FILES_HELP = """

PATH can also be a bag (.bag, .mcap, .db3 or a ROS 2 folder) or a point cloud (.ply,
.pcd, or a .bin of KITTI or of ColoRadar's LiDAR)."""
PREPARE_HELP = """

PATH can also be a folder of ColoRadar sequences: all of them are prepared. Run the same
command again to resume after an interruption."""
DEVICES = ("awr1443", "awr1642", "awr1843", "iwr6843isk")
DETECTORS = ("ca", "go", "so", "os")
FAMILIES = ("hallways", "mine", "lab", "outdoor", "corridor", "hall")
SETS = ("jradar-sim-1", "jradar-sim-1-test", "jradar-sim-1-mini")


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    top = argparse.ArgumentParser(
        prog="jradar", description="Dense point clouds from mmWave radar."
    )
    top.add_argument("--version", action="version", version=f"jradar {__version__}")
    kinds = top.add_subparsers(required=True, metavar="COMMAND")
    _info(_add(kinds, commands.info, RECORDING_HELP + FILES_HELP))
    _points(_add(kinds, commands.points, RECORDING_HELP))
    _enhance(_add(kinds, commands.enhance, RECORDING_HELP))
    _prepare(_add(kinds, commands.prepare, RECORDING_HELP + PREPARE_HELP))
    _simulate(_add(kinds, commands.simulate))
    _view(_add(kinds, commands.view))
    _export(_add(kinds, commands.export))
    return top


def _add(kinds, command: Callable, path_help: str = ""):
    """Return a command's parser; `path_help` describes its PATH, if it has one."""
    summary = (command.__doc__ or "").splitlines()[0]
    sub = kinds.add_parser(
        command.__name__,
        help=summary,
        description=f"{summary}\n\n{path_help}".strip(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    sub.set_defaults(command=command)
    if path_help:
        sub.add_argument("path", metavar="PATH", help="file or folder, see above")
    sub.add_argument("--json", action="store_true", help="print the result as JSON")
    return sub


def _info(sub):
    """Add the options of `jradar info`."""
    _recording(sub)
    _frame(sub)


def _points(sub):
    """Add the options of `jradar points`."""
    _recording(sub)
    _frame(sub)
    _output(sub)
    sub.add_argument(
        "--detector",
        choices=DETECTORS,
        help="CFAR detector: cell averaging, greatest of, smallest of or ordered "
        "statistic (default: os)",
    )
    sub.add_argument(
        "--false-alarm-rate",
        type=_rate,
        metavar="RATE",
        help="probability that a cell of pure noise is detected (default: 0.001)",
    )
    sub.add_argument(
        "--capacity",
        type=_at_least_1,
        metavar="N",
        help="keep at most the N strongest points (default: 1024)",
    )
    sub.add_argument(
        "--remove-static", action="store_true", help="keep only echoes that move"
    )


def _enhance(sub):
    """Add the options of `jradar enhance`."""
    _recording(sub)
    _frame(sub, several=True)
    _output(sub)
    sub.add_argument(
        "--model",
        default="jradar-sim",
        metavar="NAME|FOLDER",
        help="name of a shipped model, or folder of a model (default: %(default)s)",
    )
    _drawing(sub)
    sub.add_argument(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="random seed of the draws (default: %(default)s)",
    )


def _prepare(sub):
    """Add the options of `jradar prepare`."""
    _recording(sub)
    _output(sub)
    sub.add_argument(
        "--spec",
        metavar="FILE",
        help="TOML file with the fields of jradar.data.PrepareSpec to change",
    )
    sub.add_argument(
        "--frames",
        type=_frames,
        default=slice(None),
        metavar="A:B",
        help="frames of each sequence: A to B-1 (default: all)",
    )
    sub.add_argument(
        "--workers",
        type=_at_least_1,
        default=os.cpu_count() or 1,
        metavar="N",
        help="processes on this machine (default: its CPU cores, %(default)s)",
    )
    sub.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="run on the Dask cluster at this address instead",
    )
    sub.add_argument(
        "--keep-going",
        action="store_true",
        help="skip frames that cannot be read, and count them",
    )
    sub.add_argument(
        "--preview",
        action="store_true",
        help="write only a picture of how the first of the frames is prepared",
    )


def _simulate(sub):
    """Add the options of `jradar simulate`."""
    _output(sub)
    what = sub.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--scene",
        choices=FAMILIES,
        metavar="FAMILY",
        help=f"one recording of a scene of this family: {', '.join(FAMILIES)}",
    )
    what.add_argument(
        "--set",
        choices=SETS,
        metavar="NAME",
        help=f"a whole data set: {', '.join(SETS)}",
    )
    sub.add_argument(
        "--frames",
        type=_at_least_1,
        metavar="N",
        help="frames of each recording (default: 50 for a scene, 1 in a set)",
    )
    sub.add_argument(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="random seed of a scene (default: %(default)s)",
    )
    sub.add_argument(
        "--sensor",
        choices=("single_chip", "cascade", "both"),
        default="single_chip",
        help="simulated radar (default: %(default)s)",
    )
    sub.add_argument(
        "--format",
        choices=("coloradar", "capture"),
        default="coloradar",
        help="coloradar: files laid out as in the ColoRadar data set; capture: a "
        "DCA1000 file and a ROS bag of a Livox LiDAR (default: %(default)s)",
    )
    sub.add_argument(
        "--dry-run",
        action="store_true",
        help="print the expected size and time, write nothing",
    )


def _view(sub):
    """Add the options of `jradar view`."""
    sub.add_argument("run", metavar="RUN", help="workdir of an experiment")
    sub.add_argument(
        "--no-open", action="store_true", help="print the report's path, do not open it"
    )


def _export(sub):
    """Add the options of `jradar export`."""
    sub.add_argument(
        "model",
        metavar="MODEL",
        help="name of a shipped model (jradar-sim), or folder of a model",
    )
    sub.add_argument(
        "-o", "--output", metavar="FILE", required=True, help="file to write"
    )
    _drawing(sub)
    sub.add_argument(
        "--coupling",
        metavar="FILE",
        help="coupling_calib.txt of the radar unit that will use the file",
    )


def _recording(sub):
    """Add how a recording is opened."""
    sub.add_argument(
        "--radar",
        metavar="FILE",
        help="description of the radar: a .toml, a .cfg, a log or a calib folder",
    )
    sub.add_argument(
        "--device",
        choices=DEVICES,
        metavar="NAME",
        help=f"board that a .cfg was written for: {', '.join(DEVICES)} "
        "(default: awr1843)",
    )
    sub.add_argument(
        "--sensor",
        choices=("single_chip", "cascade"),
        help="radar of a ColoRadar sequence (default: single_chip if it has both)",
    )
    sub.add_argument(
        "--iq-order",
        metavar="ORDER",
        help="order of I and Q in adc_data.bin: IIQQ, QQII, IQIQ, QIQI, I4Q4 or Q4I4 "
        "(default: as in the radar's description)",
    )
    sub.add_argument(
        "--allow-partial",
        action="store_true",
        help="accept an adc_data.bin that ends inside a frame; leave that frame out",
    )


def _frame(sub, *, several: bool = False):
    """Add which frame is read, or which frames."""
    which = sub.add_mutually_exclusive_group()
    which.add_argument(
        "--frame",
        type=int,
        default=0,
        metavar="N",
        help="frame to read (default: %(default)s)",
    )
    if several:
        which.add_argument(
            "--frames",
            type=_frames,
            metavar="A:B",
            help="frames A to B-1, each written to its own folder inside DIR",
        )
    sub.add_argument(
        "--frames-as-chirps",
        action="store_true",
        help="read a recording of one chirp per frame as one frame of many chirps",
    )


def _output(sub):
    """Add the output folder."""
    sub.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        required=True,
        help="output folder, created if missing",
    )


def _drawing(sub):
    """Add how a diffusion model is sampled."""
    sub.add_argument(
        "--draws",
        type=_at_least_1,
        metavar="N",
        help="draw N samples and keep what they agree on; 1 is the paper's single draw "
        "(default: 8)",
    )
    sub.add_argument(
        "--steps",
        type=_at_least_1,
        metavar="N",
        help="solver steps per draw (default: 5 for several draws, 18 for one)",
    )


def _frames(text: str) -> slice:
    """Parse a range A:B of frames; either end can be left out."""
    first, colon, last = text.partition(":")
    if not colon or not all(part.isdecimal() or not part for part in (first, last)):
        raise argparse.ArgumentTypeError(f"{text!r}, expected A:B, such as 0:100")
    chosen = slice(*(int(part) if part else None for part in (first, last)))
    if chosen.stop is not None and chosen.stop <= (chosen.start or 0):
        raise argparse.ArgumentTypeError(f"{text!r} holds no frame, expected A < B")
    return chosen


def _at_least_1(text: str) -> int:
    """Parse a whole number of 1 or more."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}, expected 1 or more")
    return int(text)


def _rate(text: str) -> float:
    """Parse a probability above 0."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value <= 1:
        raise argparse.ArgumentTypeError(f"{text!r}, expected more than 0, at most 1")
    return value
