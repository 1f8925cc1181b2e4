"""The options of all commands. Nothing here imports JAX, so `--help` is fast.

A default that belongs to the library is None here and stays in the library; the help
text shows its value, which a test compares.
"""

import argparse
from collections.abc import Callable

from jradar import __version__
from jradar.cli import commands, frames, groups, streaming, texts, values
from jradar.cli.printing import Parser
from jradar.options.models import DEFAULT_OF_MAPS
from jradar.options.protocols import PAPER, PROTOCOLS
from jradar.options.recordings import ROTATIONS, SENSORS, SPLITS
from jradar.options.scenes import FAMILIES, SETS

OF_SAMPLES = (  # options of `jradar live` that a radar's points do not take
    *("host", "card", "command_port", "data_port", "packet_delay", "no_commands"),
    *("loss", "reorder", "duplicate", "iq_order", "remove_interference"),
)
PLANAR = ", or radarhd for a cloud in the plane of one row of antennas"


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    text = "Dense point clouds from mmWave radar."
    top = Parser(prog="jradar", description=text, epilog=texts.COMPLETION)
    top.add_argument("--version", action="version", version=f"jradar {__version__}")
    kinds = top.add_subparsers(required=True, metavar="COMMAND")
    _info(_command(kinds, commands.info, texts.FILES, paths="each"))
    _points(_command(kinds, frames.points, paths="each"))
    _enhance(_command(kinds, frames.enhance, paths="each"))
    _live(_command(kinds, streaming.live, texts.LIVE))
    _record(_command(kinds, streaming.record, texts.RECORD))
    _replay(_command(kinds, streaming.replay, texts.REPLAY, paths="one"))
    _calibrate(_command(kinds, commands.calibrate, texts.CALIBRATE, paths="one"))
    _odometry(_command(kinds, commands.odometry, texts.ODOMETRY, paths="each"))
    _map(_command(kinds, commands.map_, texts.MAP, paths="each"))
    _prepare(_command(kinds, commands.prepare, texts.PREPARE, paths="together"))
    _finetune(_command(kinds, commands.finetune, texts.FINETUNE))
    _score(_command(kinds, commands.score, texts.SCORE, paths="together"))
    _simulate(_command(kinds, commands.simulate))
    _view(_command(kinds, commands.view))
    _export(_command(kinds, commands.export))
    return top


def _command(kinds, command: Callable, more: str = "", *, paths: str = ""):
    """Return a command's parser; `more` continues its help.

    `paths` is "one" for a command of one recording, "each" for one that is run for each
    of several, and "together" for one that takes several.
    """
    summary = (command.__doc__ or "").splitlines()[0]
    parts = (texts.RECORDING if paths else "", more, texts.EACH * (paths == "each"))
    described = "\n\n".join(part.strip() for part in (summary, *parts) if part)
    sub = kinds.add_parser(
        command.__name__.rstrip("_"),
        help=summary,
        description=described,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    sub.set_defaults(command=command, takes_several=paths == "each")
    if paths:
        number = None if paths == "one" else "+"
        text = "file or folder, see above"
        sub.add_argument("path", metavar="PATH", nargs=number, help=text)
    groups.flag(sub, "--json", "print the result as JSON")
    loudness = sub.add_mutually_exclusive_group()
    text = "print errors and the result alone"
    groups.flag(loudness, ("-q", "--quiet"), text)
    text = "print where each value came from, and how long it took"
    groups.flag(loudness, ("-v", "--verbose"), text)
    if paths == "each":
        groups.workers(sub)
    return sub


def _info(sub):
    groups.recording(sub)
    groups.frame(sub)


def _points(sub):
    groups.recording(sub)
    groups.frame(sub, several=True)
    groups.output(sub)
    groups.add_point_options(sub)
    text = "also write the standard deviation of each coordinate to the NPZ file"
    groups.flag(sub, "--deviations", text)
    groups.background(sub)
    groups.clouds(sub)


def _enhance(sub):
    groups.recording(sub)
    groups.frame(sub, several=True)
    text = "output folder, created if missing; or a new .mcap, .ros2, .mp4 or .gif, by "
    groups.output(sub, text + "default of all frames", may_stream=True)
    groups.model(sub, PLANAR)
    groups.anyway(sub)
    groups.add_point_options(sub, "remove_interference")
    groups.background(sub)
    groups.drawing(sub)
    groups.fusing(sub)
    sub.add_argument(
        "--picture",
        action=argparse.BooleanOptionalAction,
        help="draw each frame (default: a single frame is drawn, several are not)",
    )
    groups.seed(sub, "random seed of the draws")
    groups.clouds(sub)


def _live(sub):
    groups.recording(sub)
    text = "play this recording; samples go through an emulated card on this machine"
    groups.option(sub, "--replay", "RECORDING", text)
    text = "take the points that the board finds, from this serial port (default: the "
    text += "second one of --board); without --board, only listen to it"
    groups.option(sub, "--points", "DATA_PORT", text, nargs="?", const="")
    text = "new .mcap file, new .ros2 bag, or folder of clouds to write"
    groups.output(sub, text, may_stream=True, required=False)
    text = "serve Foxglove over a WebSocket (default port: 8765)"
    groups.option(sub, "--serve", "PORT", text, type=values.port, nargs="?", const=8765)
    text = "address to serve on; 0.0.0.0 serves on all addresses (default: %(default)s)"
    groups.option(sub, "--serve-host", "ADDRESS", text, default="127.0.0.1")
    text = "also serve web pages of this origin, such as https://viewer.example.org "
    text += "(default: this machine's and Foxglove's; repeatable)"
    groups.option(sub, "--allow-origin", "ORIGIN", text, action="append", default=[])
    groups.model(sub, PLANAR + ", or none for detections only")
    groups.anyway(sub)
    groups.add_point_options(sub, "remove_interference")
    groups.drawing(sub)
    groups.fusing(sub)
    groups.seed(sub, "random seed of the draws")
    _on_the_cable(sub)


def _record(sub):
    groups.recording(sub)
    text = "record what an emulated card plays of this recording"
    groups.option(sub, "--replay", "RECORDING", text)
    text = "new .mcap file, or new or empty folder"
    groups.output(sub, text, force=False)
    sub.set_defaults(points=None)  # are not recorded
    _on_the_cable(sub)


def _on_the_cable(sub):
    """Add how long to listen, the board, and the addresses."""
    groups.option(sub, "--seconds", "S", "end after S seconds", type=values.positive)
    text = "report when no packet comes for S seconds (default: %(default)s)"
    groups.option(sub, "--silence", "S", text, type=values.positive, default=5.0)
    text = "send the .cfg to the board on this serial port, such as /dev/ttyACM0"
    groups.option(sub, "--board", "PORT", text)
    text = "only listen: another program commands the card"
    groups.flag(sub, "--no-commands", text)
    text = "pause between two packets of the card, 5 to 500 us (default: %(default)s)"
    groups.option(sub, "--packet-delay", "US", text, type=values.positive, default=25.0)
    groups.network(sub, "192.168.33.30", "192.168.33.180")
    groups.playing(sub)
    sub.set_defaults(of_samples={name: sub.get_default(name) for name in OF_SAMPLES})


def _replay(sub):
    groups.recording(sub)
    groups.flag(sub, "--now", "send at once, without waiting for a command")
    groups.network(sub, "127.0.0.1", "127.0.0.2")
    groups.playing(sub)


def _calibrate(sub):
    groups.recording(sub)
    groups.all_frames(
        sub, "frames to use: A to B-1 (default: 200 of them, evenly spaced)"
    )
    text = "description to write, a .toml"
    begins = "# written by jradar calibrate"
    groups.output(sub, text, file_begins=begins, suffixes=(".toml",))
    text = (
        "a corner reflector that stands still at M metres, by default straight ahead, "
        "or AZ degrees to the left and EL up; it fixes rotation, tilt and range bias"
    )
    groups.option(sub, "--reflector", "M[,AZ,EL]", text, type=values.reflector)
    text = "estimate the tilt from Doppler; the radar was carried over level ground"
    groups.flag(sub, "--level", text)
    text = "estimate the radar's yaw and place on the rig, from its motion and the "
    text += (
        "recording's poses or LiDAR scans; the rig was moved ahead and rotated. Pitch "
    )
    text += "and roll are not estimated"
    groups.flag(sub, "--mount", text)
    text = "new .png that shows how well --mount explains the radar's velocities"
    groups.option(sub, "--picture", "FILE", text)


def _odometry(sub):
    groups.recording(sub)
    groups.all_frames(sub, "frames A to B-1 (default: all)")
    text = "trajectory to write, such as trajectory.tum"
    suffixes = (".tum", ".txt")
    groups.output(sub, text, file_begins="# jradar", suffixes=suffixes)
    text = (
        "source of the rig's rotation: the recording's IMU, its poses, LiDAR scans, "
        "or no rotation (default: imu if there is one, else none)"
    )
    groups.option(sub, "--rotation", "NAME", text, choices=ROTATIONS)
    groups.add_point_options(sub, "folds")


def _map(sub):
    groups.recording(sub)
    groups.output(sub)
    groups.all_frames(sub, "frames A to B-1 (default: all)")
    text = "model of maps, shipped or the workdir of a run (default: %(default)s)"
    groups.option(sub, "--model", "NAME", text, default=DEFAULT_OF_MAPS)
    text = "take poses from Doppler and this rotation (default: the recording's poses)"
    groups.option(sub, "--rotation", "NAME", text, choices=ROTATIONS)
    text = "close loops: correct the drift of the poses where the walk comes back"
    groups.flag(sub, "--loops", text)


def _prepare(sub):
    groups.recording(sub)
    groups.output(sub)
    text = "TOML file with the fields of jradar.data.PrepareSpec to change"
    groups.option(sub, "--spec", "FILE", text)
    groups.all_frames(sub, "frames of each sequence: A to B-1 (default: all)")
    groups.workers(sub)
    groups.flag(sub, "--keep-going", "skip frames that cannot be read, and count them")
    text = "write only a picture of how the first of the frames is prepared"
    groups.flag(sub, "--preview", text)
    for split in ("validation", "test"):
        text = f"put the recording NAME into the {split} split (repeatable)"
        groups.option(sub, f"--{split}", "NAME", text, action="append", default=[])
    text = "share of each training recording, at its end, for validation, 0 to 1"
    groups.option(sub, "--validation-share", "P", text, type=values.share, default=0.0)


def _finetune(sub):
    sub.add_argument("records", metavar="RECORDS", help="folder of `jradar prepare`")
    groups.output(sub, "folder of the run, which --model takes", force=False)
    groups.model(sub)
    groups.count(sub, "--steps", "steps of training (default: by the number of frames)")
    text = "peak of the learning rate (default: 3e-4)"
    groups.option(sub, "--learning-rate", "RATE", text, type=values.positive)
    text = "points of the F-score that old places may lose (default: 1)"
    groups.option(sub, "--forget", "POINTS", text, type=values.positive)
    text = "share of old frames in each batch (default: 0.25)"
    groups.option(sub, "--replay-share", "P", text, type=values.share)
    text = "records of old frames (default: simulated ones, made in three minutes)"
    groups.option(sub, "--replay-records", "FOLDER", text)
    groups.flag(sub, "--own-view", "take the records' view, leave old places behind")
    groups.seed(sub, "random seed of the batches")


def _score(sub):
    groups.recording(sub)
    text = "folder for tables, pictures and a report (default: only print)"
    groups.output(sub, text, required=False)
    text = f"{groups.MODEL}; repeatable (default: jradar-sim)"
    groups.option(sub, "--model", "NAME|FOLDER", text, action="append", default=[])
    groups.all_frames(sub, "frames of each recording: A to B-1 (default: all)")
    text = "whose definitions of the scores to use (default: %(default)s): "
    text += "; ".join(f"{name}: {what}" for name, what in PROTOCOLS.items())
    groups.option(sub, "--protocol", "NAME", text, choices=[*PROTOCOLS], default=PAPER)
    text = "split of records (default: test, or else validation)"
    groups.option(sub, "--split", "NAME", text, choices=SPLITS)
    groups.workers(sub)
    groups.seed(sub, "random seed of the draws and of splat")


def _simulate(sub):
    groups.output(sub, force=False)
    what = sub.add_mutually_exclusive_group(required=True)
    text = f"one recording of a scene of this family: {', '.join(FAMILIES)}"
    groups.option(what, "--scene", "FAMILY", text, choices=FAMILIES)
    text = f"a whole data set: {', '.join(SETS)}, or jradar-sim-2-robust/SHIFT"
    groups.option(what, "--set", "NAME", text)
    text = "frames of each recording (default: 50 for a scene, 1 in a set)"
    groups.count(sub, "--frames", text)
    groups.seed(sub, "random seed of a scene")
    sub.add_argument(
        "--sensor",
        choices=(*SENSORS, "both"),
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
    groups.flag(sub, "--dry-run", "print the expected size and time, write nothing")


def _view(sub):
    sub.add_argument("run", metavar="RUN", help="workdir of an experiment")
    groups.flag(sub, "--no-open", "print the report's path, do not open it")


def _export(sub):
    sub.add_argument("model", metavar="MODEL", help=groups.MODEL)
    text = "file to write: .onnx takes a radar's points, other names take samples and "
    text += "need JAX"
    groups.output(sub, text, file_begins='{"format": "jradar function')
    groups.drawing(sub)
    text = "description of the radar that will use the file, with its calibration "
    text += "(default: the radar of the model's training, not calibrated)"
    groups.option(sub, "--radar", "FILE", text)
    groups.device(sub)
    text = "ColoRadar's coupling_calib.txt of that radar: the leakage of its antennas"
    groups.option(sub, "--coupling", "FILE", text)
