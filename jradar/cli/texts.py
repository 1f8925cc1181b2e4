"""What `--help` says of commands, below their first line."""

RECORDING = """\
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
FILES = """

PATH can also be a bag (.bag, .mcap, .db3 or a ROS 2 folder) or a point cloud (.ply,
.pcd, or a .bin of KITTI or of ColoRadar's LiDAR). It can be a radar's configuration
(.cfg, .toml, a .lua, log or .json of mmWave Studio), too: then jradar prints what the
radar measures, and whether its board can run it."""
PREPARE = """

PATH can also be a folder of ColoRadar sequences: all of them are prepared. Run the same
command again to resume after an interruption."""
EACH = """

Several PATHs, or a folder of recordings: each is done on its own, into a folder or file
of its name in the output. One that fails is named in recordings.csv, the others go on,
and the exit code is 4. The same command goes on where it was stopped."""
LIVE = """

The board runs the .cfg that --radar names; the DCA1000 sends its samples here, and the
newest frame becomes a cloud. Ctrl-C ends the session. A radar that sends points needs
no card: with --points they come over the board's second serial port. Without a radar,
--replay plays a recording: samples through an emulated card, points as they are.
jradar/stream/README.md describes the wiring and the network."""
RECORD = """

walk.mcap is one file with the samples, the time at which each frame came, its lost
bytes, and the radar: every command reads it without --radar. A folder holds the same in
several files. If you recorded a LiDAR at the same time, add its tables to the folder's
capture.toml. Ctrl-C ends the recording. A recording that was killed is readable, too.
The other options are those of `jradar live`, which also saves the points of a radar
that sends no samples: jradar live --points PORT --model none -o walk.ros2"""
REPLAY = """

The emulated card answers commands on --card and sends to --host. A program starts it,
such as jradar live --radar FILE --host 127.0.0.1 --card 127.0.0.2. If a program stops
it, it waits for the next START. It ends with the recording, or by Ctrl-C."""
CALIBRATE = """

FILE describes the same radar with its channels' factors: pass it as --radar, or name it
in a capture.toml. Record many single objects at several ranges and angles, while the
radar moves, or one corner reflector. Echoes alone do not show the rotation and the tilt
of the whole array. A reflector shows both. --level finds the tilt from a walk straight
ahead over level ground."""
ODOMETRY = """

Doppler gives the radar's own velocity in each frame. FILE holds the poses of the
base in TUM's format, a line `stamp x y z qx qy qz qw` in the middle of each frame. If
the recording has poses, the trajectory is compared with them: APE (positions, aligned
without scale) and RPE (from frame to frame), as evo defines them. A radar's points need
a Doppler velocity."""
MAP = """

Poses are the recording's own, or follow from Doppler. DIR receives map.ply, the map
that a LiDAR would have made, with the confidence of each voxel; radar_map.ply, the
radar's own map; a plan for ROS's map_server (grid.pgm, grid.yaml); the poses of the map
(trajectory.tum); and a picture. With --loops, poses are corrected where the walk comes
back, which takes a few times as long. Ctrl-C ends the walk and writes the maps of the
frames until then."""
FINETUNE = """\
RECORDS hold a train and a validation split: see --validation of `jradar prepare`.
The same command resumes a run that was stopped. `--model DIR` then uses the model."""
SCORE = """

PATH can also be a folder of recordings, or one folder of `jradar prepare`. Its test
frames are scored or, if there are none, its validation frames. The truth is the part of
the LiDAR's points that the radar could have seen, as in training; recordings are also
scored against all its points in view. Intervals hold 95 % and allow for frames that
resemble each other."""
COMPLETION = """\
Completion of commands and options in a shell: pip install argcomplete, then
eval "$(register-python-argcomplete jradar)"."""
