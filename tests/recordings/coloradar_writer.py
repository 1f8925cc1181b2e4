"""Writes ColoRadar sequences number by number, in the files' order.

It shares nothing with the reader: `struct.pack` and loops.
"""

import functools
import json
import math
import struct

import numpy as np

START = 1608568420.25  # seconds since 1970
TX, RX, CHIRPS, SAMPLES = 2, 2, 4, 8
FRAME_BYTES = TX * RX * CHIRPS * SAMPLES * 4
ANTENNAS = "F_design 76.8\nrx 0 0 0\nrx 1 1 0\ntx 0 0 0\ntx 1 2 1\n"
RADAR_YAW = "0 0 0.706825181105 0.707388269167"
TRANSFORMS = {
    "single_chip": f"-0.145 0.09 -0.025\n{RADAR_YAW}\n",
    "cascade": f"0.03 0.12 -0.09\n{RADAR_YAW}\n",
    "lidar": "-0.075 -0.02 0.03618\n0.0 0.0 0.721382357437 -0.692536998563\n",
}


def waveform(tx=TX, rx=RX, chirps=CHIRPS, samples=SAMPLES):
    """Numbers as the data set has them, rounded to float32."""
    return f"""\
num_rx {rx}
num_tx {tx}
num_adc_samples_per_chirp {samples}
num_chirps_per_frame {chirps}
adc_sample_frequency 10666000.0
start_frequency 76999999488.0
idle_time 0.00011
adc_start_time 7.00000009601e-06
ramp_end_time 1.99999994948e-05
frequency_slope 1.00000000377e+14
"""


def coupling_text(values, **claimed):
    """The file of `[tx, rx, range bin]`, with other sizes if they are claimed."""
    tx, rx, bins = np.shape(values)
    sizes = {"num_tx": tx, "num_rx": rx, "num_range_bins": bins, "num_doppler_bins": 1}
    lines = "".join(f"{name}:{size}\n" for name, size in (sizes | claimed).items())
    numbers = ",".join(f"{v.real},{v.imag}" for v in np.ravel(values).tolist())
    return f"{lines}data:{numbers}\n"


def phases_text(frequencies, phases, **changes):
    """The file of frequencies `[tx, rx]`, in bins, and of complex phases."""
    tx, rx = np.shape(frequencies)
    values = {
        "numTx": tx,
        "numRx": rx,
        "frequencySlope": 79e12,
        "samplingRate": 8e6,
        "frequencyCalibrationMatrix": np.ravel(frequencies).tolist(),
        "phaseCalibrationMatrix": np.ravel(phases).view(float).tolist(),
    }
    return json.dumps({"antennaCalib": values | changes})


def write(path, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def write_calib(
    folder, sensors=("single_chip",), transforms=TRANSFORMS, sizes=(), antennas=ANTENNAS
):
    for sensor in sensors:
        write(folder / sensor / "waveform_cfg.txt", waveform(*sizes))
        write(folder / sensor / "antenna_cfg.txt", antennas)
    for name, text in transforms.items():
        write(folder / "transforms" / f"base_to_{name}.txt", text)


def value(frame, tx, rx, chirp, sample):
    """In-phase part of one sample; its quadrature part is 1 - 2 of it."""
    return (frame * 1000 + tx * 317 + rx * 91 + chirp * 17 + sample * 5) % 4001 - 2000


@functools.cache
def frame_bytes(frame):
    counts = [value(frame, *at) for at in np.ndindex(TX, RX, CHIRPS, SAMPLES)]
    return b"".join(struct.pack("<hh", count, 1 - 2 * count) for count in counts)


def stamps_text(count, rate, start=START):
    return "".join(f"{start + n / rate:6f}\n" for n in range(count))


def write_radar(folder, sensor="single_chip", count=12, first=0):
    at = folder / sensor / "adc_samples"
    write(at / "timestamps.txt", stamps_text(count, 10))
    for n in range(count):
        write(at / "data" / f"frame_{n + first}.bin", frame_bytes(n))


def write_lidar(folder, count=12, points=((-3.0, 0.0, 0.0, 7.0), (0, 0, 0, 0))):
    write(folder / "lidar" / "timestamps.txt", stamps_text(count, 10, START + 0.01))
    content = b"".join(struct.pack("<4f", *point) for point in points)
    for n in range(count):
        name = f"lidar_pointcloud_{n}.bin"
        write(folder / "lidar" / "pointclouds" / name, content)


def write_poses(folder, source="groundtruth", count=14):
    """A base that drives 0.1 m along x and turns 0.1 rad a step."""
    turns = ((n, math.sin(0.05 * n), math.cos(0.05 * n)) for n in range(count))
    rows = "".join(f"{0.1 * n} 0 0.5 0 0 {sin} {cos}\n" for n, sin, cos in turns)
    write(folder / source / "timestamps.txt", stamps_text(count, 10))
    write(folder / source / f"{source}_poses.txt", rows)


def expected_cube(frame):
    cube = np.zeros((TX, RX, CHIRPS, SAMPLES), complex)
    for at in np.ndindex(*cube.shape):
        counts = value(frame, *at)
        cube[at] = counts + 1j * (1 - 2 * counts)
    return cube
