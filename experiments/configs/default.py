r"""The paper's image sizes on simulated rooms, with a network that a CPU can train.

    python -m experiments.main --config=experiments/configs/default.py \
        --workdir=runs/default

Every field of every experiment is here; other configs are differences from it. Not run
to the end yet.
"""

from ml_collections import ConfigDict


def get_config():
    config = ConfigDict()
    config.purpose = "trained on simulated rooms only"  # said to users of the weights
    config.seed = 0

    # The radar: a named device and fields that replace its own.
    config.radar = ConfigDict({"device": "awr1843"}, allow_dotted_keys=False)
    config.radar.num_chirps = 128
    config.radar.num_samples = 128

    # Images [rows, columns] of the same field of view.
    config.image = ConfigDict()
    config.image.coarse = (64, 64)  # the radar's: the condition
    config.image.fine = (128, 512)  # the LiDAR's: the target
    config.image.azimuth_deg = (-60.0, 60.0)
    config.image.elevation_deg = (-20.0, 20.0)
    config.image.max_range_m = 12.0
    config.image.num_slices = 8
    config.image.codec = "log"  # log, linear or inverse

    # Radar points: for the condition, and of the detector to compare with.
    config.points = ConfigDict()
    config.points.capacity = 1024
    config.points.detector = "os"  # ca, go, so or os
    config.points.false_alarm_rate = 1.0  # the paper: a threshold approaching zero
    config.points.guard = (2, 2)
    config.points.train = (4, 4)
    config.baseline = ConfigDict()
    config.baseline.capacity = 1024
    config.baseline.detector = "os"
    config.baseline.false_alarm_rate = 1e-3
    config.baseline.guard = (2, 2)
    config.baseline.train = (4, 4)

    # Simulated rooms; frames of the two sets never share a key.
    config.data = ConfigDict()
    config.data.num_train = 1000
    config.data.num_validation = 32

    config.noise = ConfigDict()
    config.noise.sigma_data = 0.68  # measured on the encoded LiDAR images
    config.noise.sigma_min = 0.002
    config.noise.sigma_max = 80.0
    config.noise.rho = 7.0
    config.noise.log_mean = -1.2
    config.noise.log_std = 1.2

    config.network = ConfigDict()
    config.network.preset = "tiny"

    config.train = ConfigDict()
    config.train.steps = 20_000
    config.train.batch_size = 8
    config.train.learning_rate = 5e-4
    config.train.warmup_steps = 500
    config.train.clip_norm = 1.0
    config.train.ema_decay = 0.999
    config.train.checkpoint_every = 500

    config.sampling = ConfigDict()
    config.sampling.steps = 18
    config.sampling.validity_threshold = 0.0
    return config
