r"""The paper's image sizes on simulated ColoRadar scenes, with a network for a CPU.

    python -m experiments.main --config=experiments/configs/default.py \
        --workdir=runs/default

This file contains every field of the task `enhance`; other configs change some of them.
Training takes an hour on one core, after the simulation. To train on ColoRadar or on
your own recordings, prepare them with `jradar prepare`, and pass the folder as
--config.data.path=FOLDER.
"""

from ml_collections import ConfigDict, config_dict


def get_config():
    config = ConfigDict()
    config.task = "enhance"
    config.purpose = "trained on simulated scenes only"  # shown to users of the model
    config.seed = 0
    config.method = "diffusion"  # "marginal": one pass; "regression": a baseline

    # Records of `jradar prepare`. Without a path, the run simulates and prepares the
    # set in its workdir.
    config.data = ConfigDict()
    config.data.path = ""
    config.data.set = "jradar-sim-1"
    config.data.frames = 1  # per sequence
    # Of jradar-sim-5: a folder of packed runs of ColoRadar's maps, for real places.
    # `without` names kinds, with commas, that are left out of training and validation;
    # the run tests on them alone.
    config.data.maps = ""
    config.data.without = ""
    # Views of real maps, as `experiments.studies.map_views` writes them, that are
    # trained on, too, if named.
    config.data.views = ""

    # How recordings are prepared; the field of view is taken from `image`.
    config.prepare = ConfigDict()
    config.prepare.visible_false_alarm_rate = 1e-3
    # The condition's points: fields of PointSpec.
    config.points = ConfigDict()
    config.points.capacity = 1024
    config.points.detector = "os"  # ca, go, so or os
    config.points.false_alarm_rate = 1.0  # the paper: a threshold approaching zero
    config.points.remove_interference = False  # crossing chirps of other radars

    # Images [rows, columns] of the same field of view.
    config.image = ConfigDict()
    config.image.coarse = (64, 64)  # radar: the condition
    config.image.fine = (128, 512)  # LiDAR: the target
    config.image.azimuth_deg = (-60.0, 60.0)
    config.image.elevation_deg = (-20.0, 20.0)
    config.image.max_range_m = 12.0
    config.image.num_slices = 8
    config.image.codec = "log"  # log, linear or inverse
    # Of the condition; "age" and "count" describe points of several frames.
    config.image.channels = ("presence", "range", "power")
    # Training closes gaps up to this wide, which lie between the LiDAR's beams.
    config.image.gap_pixels = 2

    # Strong noise, so that the network has to use the condition. The prediction
    # "gaussian" handles weak noise by Bayes' rule.
    config.noise = ConfigDict()
    config.noise.sigma_data = 0.75  # standard deviation of the targets
    config.noise.sigma_min = 0.002
    config.noise.sigma_max = 80.0
    config.noise.rho = 7.0
    config.noise.log_mean = 1.0
    config.noise.log_std = 1.5
    config.noise.prediction = "gaussian"  # or edm, clean

    config.network = ConfigDict()
    config.network.preset = "tiny"  # further keys override fields of the preset

    # Eq. 12; LPIPS needs the extra `lpips`.
    config.loss = ConfigDict()
    config.loss.squared = 1.0
    config.loss.range_weight = 4.0  # of the range's error; validity's error is larger
    config.loss.absolute = 0.0
    config.loss.perceptual = 0.0
    config.loss.perceptual_network = "alexnet"  # or vgg16

    # Runs one after another, each with changes of this config, and the shares of their
    # weights in the model; see `stages.py`. Without stages, the config is one run.
    config.stages = ()
    config.average = ()

    config.train = ConfigDict()
    # Weights to start from: a run's workdir, a model, or a file for load_pretrained.
    config.train.initial = config_dict.placeholder(str)
    config.train.steps = 3600
    config.train.steps_before = 0  # of earlier stages; the model's card adds them
    config.train.batch_size = 8
    config.train.learning_rate = 1e-3
    config.train.warmup_steps = 100
    config.train.clip_norm = 1.0
    config.train.weight_decay = 1e-2
    config.train.ema_decay = 0.995
    config.train.checkpoint_every = 200
    config.train.evaluate_every = 900  # scores what `enhance` draws

    # Whose points a condition holds, drawn at random in training: fields of
    # data.HistorySpec.
    config.history = ConfigDict()
    config.history.frames = 1
    config.history.single = 0.35
    config.history.sparse = 0.0
    config.history.drift = 0.0

    # How frames change at random in training: fields of data.AugmentSpec.
    config.augment = ConfigDict()
    config.augment.mirror = True
    config.augment.thin = 0.0
    config.augment.scale = (1.0, 1.0)
    config.augment.rotation_deg = 0.0
    config.augment.alone = 0.0
    config.augment.perfect = 0.0

    config.sampling = ConfigDict()
    config.sampling.steps = 18
    config.sampling.solver = "heun"
    config.sampling.validity_threshold = 0.0
    config.sampling.temperature = 0.6  # chosen on validation frames
    config.sampling.draws = 8  # quick draws for the row of their agreement; 1: no row

    # The CFAR detectors in the tables have their best rate on the validation split.
    config.evaluation = ConfigDict()
    config.evaluation.split = "test"
    config.evaluation.protocol = "paper"  # of distances; see evaluation.protocols
    config.evaluation.every = 5  # score every fifth frame
    config.evaluation.detectors = ("so", "ca", "go", "os")
    config.evaluation.frames_for_rates = 48
    config.evaluation.frames_while_training = 24
    return config
