"""The conditional EDM denoiser (sections III-B and IV-C of the paper).

NoiseSpec                        noise levels, a static argument
training_sigma, loss_weight, karras_sigmas, log_sigmas
Prediction, PREDICTIONS, EDM     what a network predicts, with its rule
Network, NETWORKS, build_network, network_fields, network_from_fields
                                 networks, and how configs and files name them
UNet, PRESETS                    the network of the paper
precondition, conditional_denoiser
                                 network -> D(x; sigma), without and with a condition
Solver, SOLVERS, HEUN, sample    images from noise
heun_step, heun_churn, Heun, Multistep
denoising_loss, LossSpec         training
target_mask, channel_weights     values that count in it, and their weights
lpips, load_lpips, LpipsWeights  the perceptual distance
regression_estimate, regression_loss
                                 the same network without diffusion, a baseline
load_pretrained, Transfer        weights to start from, published or trained here
save_prior, read_state, write_params, read_params
                                 files of weights
"""

from jradar.diffusion.losses import (
    LossSpec as LossSpec,
    channel_weights as channel_weights,
    denoising_loss as denoising_loss,
    target_mask as target_mask,
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
    karras_sigmas as karras_sigmas,
    log_sigmas as log_sigmas,
    loss_weight as loss_weight,
    training_sigma as training_sigma,
)
from jradar.diffusion.perceptual import (
    LpipsWeights as LpipsWeights,
    load_lpips as load_lpips,
    lpips as lpips,
)
from jradar.diffusion.precondition import (
    ConditionalDenoiser as ConditionalDenoiser,
    Denoiser as Denoiser,
    conditional_denoiser as conditional_denoiser,
    precondition as precondition,
)
from jradar.diffusion.predictions import (
    EDM as EDM,
    PREDICTIONS as PREDICTIONS,
    Prediction as Prediction,
    scalings as scalings,
)
from jradar.diffusion.pretrained import (
    Transfer as Transfer,
    load_pretrained as load_pretrained,
    read_params as read_params,
    read_state as read_state,
    save_prior as save_prior,
    write_params as write_params,
)
from jradar.diffusion.regression import (
    regression_estimate as regression_estimate,
    regression_loss as regression_loss,
)
from jradar.diffusion.solvers import (
    HEUN as HEUN,
    SOLVERS as SOLVERS,
    Heun as Heun,
    Multistep as Multistep,
    Solver as Solver,
    heun_churn as heun_churn,
    heun_step as heun_step,
    sample as sample,
)
from jradar.diffusion.unet import PRESETS as PRESETS, UNet as UNet
