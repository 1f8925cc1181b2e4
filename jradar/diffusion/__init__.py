"""The conditional EDM denoiser (sections III-B and IV-C of the paper).

NoiseSpec, training_sigma, scalings      noise levels, to train at and to scale by
PREDICTIONS, Prediction                  what a network predicts, with its rule
OCCUPANCY, prior                         the rule of pixels that are 0 or 1
UNet, PRESETS, NETWORKS, Network         the paper's network, its sizes, and others
build_network, network_fields, network_from_fields
                                         networks from configs, to JSON, and back
precondition, conditional_denoiser, Denoiser     a network as D(x; sigma)
sample, SOLVERS, HEUN, Solver, solver_for        images by a solver
denoising_loss, LossSpec, lpips, load_lpips      Eq. 12, its weights and its distance
regression_loss, regression_estimate     the same network without diffusion
occupancy_loss, estimate_loss, dice_loss, log_odds_loss, log_odds, SHARE
                                         losses of pixels from 0 to 1
RangeMixture, range_mixture, window_mass, mixture_loss
                                         one pass: each pixel's distribution of range
load_pretrained                          weights to start from
write_params, read_params, misfit, parameter_shapes     parameters in files
"""

from jradar.diffusion.losses import (
    LossSpec as LossSpec,
    denoising_loss as denoising_loss,
    regression_estimate as regression_estimate,
    regression_loss as regression_loss,
    where_known as where_known,
)
from jradar.diffusion.mixture import (
    RangeMixture as RangeMixture,
    mixture_loss as mixture_loss,
    range_mixture as range_mixture,
    window_mass as window_mass,
)
from jradar.diffusion.network import (
    NETWORKS as NETWORKS,
    Network as Network,
    build_network as build_network,
    network_fields as network_fields,
    network_from_fields as network_from_fields,
)
from jradar.diffusion.noise import (
    NoiseSpec as NoiseSpec,
    training_sigma as training_sigma,
)
from jradar.diffusion.occupancy import OCCUPANCY as OCCUPANCY, prior as prior
from jradar.diffusion.occupancy_losses import (
    SHARE as SHARE,
    dice_loss as dice_loss,
    estimate_loss as estimate_loss,
    log_odds as log_odds,
    log_odds_loss as log_odds_loss,
    occupancy_loss as occupancy_loss,
)
from jradar.diffusion.perceptual import load_lpips as load_lpips, lpips as lpips
from jradar.diffusion.precondition import (
    Denoiser as Denoiser,
    conditional_denoiser as conditional_denoiser,
    precondition as precondition,
)
from jradar.diffusion.predictions import (
    PREDICTIONS as PREDICTIONS,
    Prediction as Prediction,
)
from jradar.diffusion.solvers import (
    HEUN as HEUN,
    SOLVERS as SOLVERS,
    Solver as Solver,
    sample as sample,
    solver_for as solver_for,
)
from jradar.diffusion.unet import PRESETS as PRESETS, UNet as UNet
from jradar.diffusion.weights.files import (
    misfit as misfit,
    parameter_shapes as parameter_shapes,
    read_params as read_params,
    write_params as write_params,
)
from jradar.diffusion.weights.pretrained import load_pretrained as load_pretrained
