"""The conditional EDM denoiser (sections III-B and IV-C of the paper).

    noise, network = NoiseSpec(), build_network(preset="small")
    denoise = conditional_denoiser(network, params, noise)(condition)     # D(x; sigma)
    loss = denoising_loss(key, denoise, clean, noise=noise)               # Eq. 12
    images = sample(key, denoise, (8, 128, 512, 2), noise=noise)

A prediction, one of `PREDICTIONS`, is what a network predicts, with the rule that turns
it into a clean image. `RangeMixture` is the prediction of one pass, without diffusion.
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
)
from jradar.diffusion.occupancy import OCCUPANCY as OCCUPANCY
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
)
from jradar.diffusion.solvers import (
    SOLVERS as SOLVERS,
    Solver as Solver,
    sample as sample,
)
from jradar.diffusion.unet import PRESETS as PRESETS, UNet as UNet
from jradar.diffusion.weights.files import (
    misfit as misfit,
    parameter_shapes as parameter_shapes,
    read_params as read_params,
    write_params as write_params,
)
from jradar.diffusion.weights.pretrained import load_pretrained as load_pretrained
