"""The options of all commands. Nothing here imports JAX, so `--help` is fast.

A default that belongs to the library is None here and stays in the library; the help
text shows its value, which a test compares.
"""

import argparse
import os
from collections.abc import Callable

from jradar import __version__
from jradar.cli import commands, frames, groups, streaming, values
from jradar.cli.printing import Parser
from jradar.options.models import DEFAULT_OF_MAPS
from jradar.options.protocols import PAPER, PROTOCOLS
from jradar.options.recordings import ROTATIONS, SENSORS, SPLITS
from jradar.options.scenes import FAMILIES, SETS

RECORDING_HELP = """\
PATH is a recording:

  cube.npy        complex samples; --radar names a TOML file that describes the
                  radar and the axes of the cube
  adc_data.bin    a capture of TI's DCA1000; --radar names the script (.lua) or log of
                  mmWave Studio, the .cfg of the mmWave SDK or a TOML file
  walk.mcap       a file of jradar record, which describes its radar
  points          that a radar sends: a ROS bag, a serial stream of TI's demo (.dat),
                  .ply, .pcd, .csv, .npz or a folder of them; what needs samples says so
  a folder        with a capture.toml, or a ColoRadar sequence such as
                  12_21_2020_ec_hallways_run0; --radar names its calib folder if
                  that is not inside, next to or above the sequence

Without --radar, jradar looks for the description next to the recording."""
FILES_HELP = """

PATH can also be a bag (.bag, .mcap, .db3 or a ROS 2 folder) or a point cloud (.ply,
.pcd, or a .bin of KITTI or of ColoRadar's LiDAR). It can be a radar's configuration
(.cfg, .toml, a .lua, log or .json of mmWave Studio), too: then jradar prints what the
radar measures, and whether its board can run it."""
PREPARE_HELP = """

PATH can also be a folder of ColoRadar sequences: all of them are prepared. Run the same
command again to resume after an interruption."""
LIVE_HELP = """

The board runs the .cfg that --radar names; the DCA1000 sends its samples here, and the
newest frame becomes a cloud. Ctrl-C ends the session. A radar that sends points needs
no card: with --points they come over the board's second serial port. Without a radar,
--replay plays a recording: samples through an emulated card, points as they are.
jradar/stream/README.md describes the wiring and the network."""
RECORD_HELP = """

walk.mcap is one file with the samples, the time at which each frame came, its lost
bytes, and the radar: every command reads it without --radar. A folder holds the same in
several files. If you recorded a LiDAR at the same time, add its tables to the folder's
capture.toml. Ctrl-C ends the recording. A recording that was killed is readable, too.
The other options are those of `jradar live`, which also saves the points of a radar
that sends no samples: jradar live --points PORT --model none -o walk.ros2"""
REPLAY_HELP = """

The emulated card answers commands on --card and sends to --host. A program starts it,
such as jradar live --radar FILE --host 127.0.0.1 --card 127.0.0.2. If a program stops
it, it waits for the next START. It ends with the recording, or by Ctrl-C."""
CALIBRATE_HELP = """

FILE describes the same radar with its channels' factors: pass it as --radar, or name it
in a capture.toml. Record many single objects at several ranges and angles, while the
radar moves, or one corner reflector. Echoes alone do not show the rotation and the tilt
of the whole array. A reflector shows both. --level finds the tilt from a walk straight
ahead over level ground."""
ODOMETRY_HELP = """

Doppler gives the radar's own velocity in each frame. FILE holds the poses of the
base in TUM's format, a line `stamp x y z qx qy qz qw` in the middle of each frame. If
the recording has poses, the trajectory is compared with them: APE (positions, aligned
without scale) and RPE (from frame to frame), as evo defines them. A radar's points need
a Doppler velocity."""
MAP_HELP = """

Poses are the recording's own, or follow from Doppler. DIR receives map.ply, the map
that a LiDAR would have made, with the confidence of each voxel; radar_map.ply, the
radar's own map; a plan for ROS's map_server (grid.pgm, grid.yaml); and a picture."""
FINETUNE_HELP = """\
RECORDS hold a train and a validation split: see --validation of `jradar prepare`.
The same command resumes a run that was stopped. `--model DIR` then uses the model."""
SCORE_HELP = """

PATH can also be a folder of recordings, or one folder of `jradar prepare`. Its test
frames are scored or, if there are none, its validation frames. The truth is the part of
the LiDAR's points that the radar could have seen, as in training; recordings are also
scored against all its points in view. Intervals hold 95 % and allow for frames that
resemble each other."""
OF_SAMPLES = (  # options of `jradar live` that a radar's points do not take
    *("host", "card", "command_port", "data_port", "packet_delay", "no_commands"),
    *("loss", "reorder", "duplicate", "iq_order", "remove_interference"),
)
PLANAR = ", or radarhd for a cloud in the plane of one row of antennas"
COMPLETION = """\
Completion of commands and options in a shell: pip install argcomplete, then
eval "$(register-python-argcomplete jradar)"."""


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    text = "Dense point clouds from mmWave radar."
    top = Parser(prog="jradar", description=text, epilog=COMPLETION)
    top.add_argument("--version", action="version", version=f"jradar {__version__}")
    kinds = top.add_subparsers(required=True, metavar="COMMAND")
    _info(_command(kinds, commands.info, RECORDING_HELP + FILES_HELP))
    _points(_command(kinds, frames.points, RECORDING_HELP))
    _enhance(_command(kinds, frames.enhance, RECORDING_HELP))
    _live(_command(kinds, streaming.live, more=LIVE_HELP))
    _record(_command(kinds, streaming.record, more=RECORD_HELP))
    _replay(_command(kinds, streaming.replay, RECORDING_HELP + REPLAY_HELP))
    _calibrate(_command(kinds, commands.calibrate, RECORDING_HELP + CALIBRATE_HELP))
    _odometry(_command(kinds, commands.odometry, RECORDING_HELP + ODOMETRY_HELP))
    _map(_command(kinds, commands.map_, RECORDING_HELP + MAP_HELP))
    _prepare(
        _command(kinds, commands.prepare, RECORDING_HELP + PREPARE_HELP, several=True)
    )
    _finetune(_command(kinds, commands.finetune, more=FINETUNE_HELP))
    _score(_command(kinds, commands.score, RECORDING_HELP + SCORE_HELP, several=True))
    _simulate(_command(kinds, commands.simulate))
    _view(_command(kinds, commands.view))
    _export(_command(kinds, commands.export))
    return top


def _command(
    kinds,
    command: Callable,
    path_help: str = "",
    *,
    more: str = "",
    several: bool = False,
):
    """Return a command's parser; `path_help` describes its PATH, or `several` of them.

    `more` is the description of a command without a PATH.
    """
    summary = (command.__doc__ or "").splitlines()[0]
    sub = kinds.add_parser(
        command.__name__.rstrip("_"),
        help=summary,
        description=f"{summary}\n\n{path_help}{more.strip()}".strip(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    sub.set_defaults(command=command)
    if path_help:
        sub.add_argument(
            "path",
            metavar="PATH",
            nargs="+" if several else None,
            help="file or folder, see above",
        )
    groups.flag(sub, "--json", "print the result as JSON")
    loudness = sub.add_mutually_exclusive_group()
    text = "print errors and the result alone"
    groups.flag(loudness, ("-q", "--quiet"), text)
    text = "print where each value came from, and how long it took"
    groups.flag(loudness, ("-v", "--verbose"), text)
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
    groups.output(sub, text, file_begins="# jradar odometry", suffixes=suffixes)
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


def _prepare(sub):
    groups.recording(sub)
    groups.output(sub)
    text = "TOML file with the fields of jradar.data.PrepareSpec to change"
    groups.option(sub, "--spec", "FILE", text)
    groups.all_frames(sub, "frames of each sequence: A to B-1 (default: all)")
    text = "processes on this machine (default: its CPU cores, %(default)s)"
    groups.count(sub, "--workers", text, default=os.cpu_count() or 1)
    text = "run on the Dask cluster at this address instead"
    groups.option(sub, "--scheduler", "ADDRESS", text)
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
    groups.output(sub, "file to write", file_begins='{"format": "jradar function')
    groups.drawing(sub)
    text = "description of the radar that will use the file, with its calibration "
    text += "(default: the radar of the model's training, not calibrated)"
    groups.option(sub, "--radar", "FILE", text)
    groups.device(sub)
    text = "ColoRadar's coupling_calib.txt of that radar: the leakage of its antennas"
    groups.option(sub, "--coupling", "FILE", text)
