r"""The paper's image sizes on the simulated ColoRadar, with a network for a CPU.

    python -m experiments.main --config=experiments/configs/default.py \
        --workdir=runs/default

Every field of the main task is here; other configs are differences from it. To train on
recordings of your own or on ColoRadar, prepare them with `jradar prepare` and name the
folder: --config.data.path=FOLDER. An hour on one core, after the simulation.

2026-11-21, 10 core minutes each with gaps left open and equal weights, Heun 18 on 48
validation frames, Chamfer distance and F-score at 0.2 m: "gaussian" with patches of
16 x 16 pixels 1.03 m, 36.0 %; of 8 x 16 1.10 m, 30.8 %; of 8 x 32 1.12 m, 31.9 %;
"clean" with 16 x 16 1.71 m, 25.5 %; OS-CFAR 1.17 m, 31.1 %. As it stands now: 550
steps on 576 layouts of 4 frames, to which ablations are compared, 1.16 m, 38.7 % (a
frame of each of 96 validation layouts); 3,600 on 96 layouts of 20 frames 0.792 m, 57.1
% (40 frames).
"""

from ml_collections import ConfigDict, config_dict


def get_config():
    config = ConfigDict()
    config.task = "enhance"
    config.purpose = "trained on simulated scenes only"  # said to users of the weights
    config.seed = 0
    config.method = "diffusion"  # or "regression", a baseline

    # Records of `jradar prepare`; where none are named, a set is simulated and prepared
    # in the workdir.
    config.data = ConfigDict()
    config.data.path = ""
    config.data.set = "jradar-sim"
    config.data.frames = 1  # of each of its sequences

    # How it is then prepared; its field of view is that of the images.
    config.prepare = ConfigDict()
    config.prepare.capacity = 1024
    config.prepare.detector = "os"  # ca, go, so or os
    config.prepare.false_alarm_rate = 1.0  # the paper: a threshold approaching zero
    config.prepare.visible_false_alarm_rate = 1e-3

    # Images [rows, columns] of the same field of view.
    config.image = ConfigDict()
    config.image.coarse = (64, 64)  # the radar's: the condition
    config.image.fine = (128, 512)  # the LiDAR's: the target
    config.image.azimuth_deg = (-60.0, 60.0)
    config.image.elevation_deg = (-20.0, 20.0)
    config.image.max_range_m = 12.0
    config.image.num_slices = 8
    config.image.codec = "log"  # log, linear or inverse
    # A LiDAR's beams leave pixels empty: gaps as wide as this are closed in training.
    config.image.gap_pixels = 2

    # Noise so strong that the condition has to be used; the weak one is Bayes' part.
    config.noise = ConfigDict()
    config.noise.sigma_data = 0.75  # measured, gaps closed
    config.noise.sigma_min = 0.002
    config.noise.sigma_max = 80.0
    config.noise.rho = 7.0
    config.noise.log_mean = 1.0
    config.noise.log_std = 1.5
    config.noise.prediction = "gaussian"  # or edm, clean

    config.network = ConfigDict()
    config.network.preset = "tiny"

    # Eq. 12; LPIPS needs the extra `lpips`.
    config.loss = ConfigDict()
    config.loss.squared = 1.0
    config.loss.range_weight = 4.0  # validity has the larger error
    config.loss.absolute = 0.0
    config.loss.perceptual = 0.0
    config.loss.perceptual_network = "alexnet"  # or vgg16
    config.loss.perceptual_every = 1
    config.loss.mask_misses = False  # no error of the range where the LiDAR saw nothing

    config.train = ConfigDict()
    # Weights to start from: a run's workdir, a bundle, or a file for load_pretrained.
    config.train.initial = config_dict.placeholder(str)
    config.train.attention_order = config_dict.placeholder(str)  # of OpenAI's weights
    config.train.steps = 3600
    config.train.batch_size = 8
    config.train.mirror = True  # half of the pairs, left to right
    config.train.learning_rate = 1e-3
    config.train.warmup_steps = 100
    config.train.clip_norm = 1.0
    config.train.weight_decay = 1e-2
    config.train.ema_decay = 0.995
    config.train.checkpoint_every = 200
    config.train.evaluate_every = 900  # the one-step estimate on validation frames

    config.sampling = ConfigDict()
    config.sampling.steps = 18
    config.sampling.solver = "heun"
    config.sampling.validity_threshold = 0.0
    config.sampling.temperature = 0.6  # chosen on validation frames
    config.sampling.draws = 8  # quick ones; what they agree on is a row; 1 for none

    # Detectors beside the model, each at the rate that serves it best on validation.
    config.evaluation = ConfigDict()
    config.evaluation.split = "test"
    config.evaluation.every = 5  # of how many frames one is scored
    config.evaluation.detectors = ("so", "ca", "go", "os")
    config.evaluation.frames_for_rates = 48
    config.evaluation.frames_while_training = 24
    return config
