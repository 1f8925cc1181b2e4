r"""A prior from height maps: the default recipe with the network of terrain_diffusion.

    pip download --no-deps adaptive-terrain-diffusion==0.4.2
    unzip adaptive_terrain_diffusion-0.4.2-py3-none-any.whl
    python -m experiments.convert_weights \
        terrain_diffusion/weights/terrain_consistency_unet_difficulty100.onnx \
        heights.safetensors
    python -m experiments.main --config=experiments/configs/heights.py \
        --config.train.initial=heights.safetensors --workdir=runs/heights

An ADM for images of 128 x 128 pixels, which is what the trunk sees behind a stem of
1 x 4. Its 10 M weights, distilled to one step, drew the heights of terrain (MIT). The
same config without `train.initial` starts from random weights.
"""

from ml_collections import config_dict

from experiments.configs import varied


def get_config():
    config = varied.get_config()
    config.network = {
        "channels": 32,
        "multipliers": (1, 1, 2, 3, 4),
        "blocks": 4,
        "attention_levels": (2, 3, 4),
        "head_channels": 32,
        "group_channels": 1,
        "noise_scale": 1000.0,
        "stem": (1, 4),
        "detail_channels": 8,
    }
    config.noise.prediction = "edm"
    config.train.initial = config_dict.placeholder(str)
    config.train.update(attention_order="new", steps=600)
    return config
