"""The conditional EDM denoiser (sections III-B and IV-C of the paper).

Noise, and what a network predicts
    NoiseSpec                       noise levels and prediction, a static argument
    PREDICTIONS, Prediction         predictions by name; each carries its rule
    training_sigma                  random levels to train at
    scalings                        EDM's factors of input and output

Networks
    UNet, PRESETS                   the paper's network, and its sizes
    NETWORKS, Network               all networks by name, and what each provides
    build_network, network_fields, network_from_fields
                                    from configs, to JSON, and back
    precondition, Denoiser          network -> D(x; sigma)
    conditional_denoiser            the same for a network that takes a condition

Sampling
    sample                          draws images with a solver
    SOLVERS, HEUN, Solver           solvers by name; each carries its rule
    solver_for                      the solver that suits a number of steps
    heun_step                       one step of the paper's

Training
    denoising_loss, LossSpec        Eq. 12 and its weights
    target_mask                     which values count
    lpips, load_lpips               the perceptual distance
    regression_loss, regression_estimate
                                    the same network without diffusion, a baseline

One pass
    RangeMixture, range_mixture     each pixel's distribution, from one evaluation
    mixture_mass, window_mass       a probability of it; the same, asked several times
    mixture_loss                    its negative log-likelihood

Weights
    load_pretrained                 weights to start from, published or trained here
    write_params, read_params       parameters to a file and back
    misfit, parameter_shapes        in what they do not fit a network; their shapes
"""

from jradar.diffusion.losses import (
    LossSpec as LossSpec,
    denoising_loss as denoising_loss,
    regression_estimate as regression_estimate,
    regression_loss as regression_loss,
    target_mask as target_mask,
)
from jradar.diffusion.mixture import (
    RangeMixture as RangeMixture,
    mixture_loss as mixture_loss,
    mixture_mass as mixture_mass,
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
from jradar.diffusion.perceptual import load_lpips as load_lpips, lpips as lpips
from jradar.diffusion.precondition import (
    Denoiser as Denoiser,
    conditional_denoiser as conditional_denoiser,
    precondition as precondition,
)
from jradar.diffusion.predictions import (
    PREDICTIONS as PREDICTIONS,
    Prediction as Prediction,
    scalings as scalings,
)
from jradar.diffusion.solvers import (
    HEUN as HEUN,
    SOLVERS as SOLVERS,
    Solver as Solver,
    heun_step as heun_step,
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
from jradar.diffusion.weights.pretrained import (
    load_pretrained as load_pretrained,
)
