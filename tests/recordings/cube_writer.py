"""Writes .npy cubes and samples of mmWave Studio with their descriptions."""

import numpy as np

from tests.recordings.dca1000_writer import as_bytes

RADAR = """
[radar]
device = "awr1642"
num_chirps = 4
num_samples = 8
"""
LOG = """\
API:select_chip_version,AR1642,0,
API:ChannelConfig,3,15,0,
API:AdcOutConfig,2,1,0,
API:ProfileConfig,0,1435384036,10000,600,6000,0,0,621,0,8,10000,0,0,30,0,
API:ChirpConfig,0,0,0,0,0,0,0,1,0,
API:ChirpConfig,1,1,0,0,0,0,0,0,1,
API:FrameConfig,0,1,3,4,200000,0,512,0,
"""
SHAPE = (2, 4, 4, 8)  # tx, rx, chirp, sample


def random_cube(shape=SHAPE, seed=0):
    parts = np.random.default_rng(seed).integers(-2000, 2000, (2, *shape))
    return (parts[0] + 1j * parts[1]).astype(np.complex64)


def save(folder, array, axes=None):
    np.save(folder / "cube.npy", array)
    file = f"[file]\naxes = {axes}\n" if axes else ""
    (folder / "radar.toml").write_text(RADAR + file)
    return folder / "cube.npy"


def save_studio(folder, cubes, log=LOG):
    """Frames [frame, tx, rx, chirp, sample] as I0 I1 Q0 Q1, chirp by chirp."""
    folder.mkdir(exist_ok=True)
    (folder / "adc_data.bin").write_bytes(as_bytes(cubes))
    (folder / "adc_LogFile.txt").write_text(log)
    return folder / "adc_data.bin"
