"""The conditional EDM denoiser (sections III-B and IV-C of the paper).

NoiseSpec                        noise levels, a static argument
training_sigma, loss_weight, karras_sigmas, log_sigmas
UNet, PRESETS                    the network
load_pretrained, save_prior      trained weights for it: published, or of one's own
read_state, Transfer             their file, and what was loaded
precondition, conditional_denoiser   network -> D(x; sigma), given a condition
denoising_loss, occupancy_denoising_loss, LossSpec   training
target_mask, channel_weights     what counts in it
lpips, load_lpips, LpipsWeights  the perceptual distance
sample                           sampling with one of SOLVERS
solve, heun_step, heun_churn, multistep_table   its parts
"""

from jradar.diffusion.denoiser import (
    ConditionalDenoiser as ConditionalDenoiser,
    conditional_denoiser as conditional_denoiser,
)
from jradar.diffusion.losses import (
    LossSpec as LossSpec,
    channel_weights as channel_weights,
    denoising_loss as denoising_loss,
    occupancy_denoising_loss as occupancy_denoising_loss,
    target_mask as target_mask,
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
    Denoiser as Denoiser,
    precondition as precondition,
    scalings as scalings,
)
from jradar.diffusion.pretrained import (
    Transfer as Transfer,
    load_pretrained as load_pretrained,
    read_state as read_state,
    save_prior as save_prior,
)
from jradar.diffusion.solvers import (
    SOLVERS as SOLVERS,
    heun_churn as heun_churn,
    heun_step as heun_step,
    multistep_table as multistep_table,
    sample as sample,
    solve as solve,
)
from jradar.diffusion.unet import PRESETS as PRESETS, UNet as UNet
