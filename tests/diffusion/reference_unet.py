"""EDM's SongUNet (DDPM++) and DhariwalUNet, and OpenAI's ADM, written in NumPy.

The published networks by their own names, one image [channel, row, column] at a time,
in float64. A tensor is made when it is first asked for, so a run leaves a state dict
with the names and shapes of a published one.
"""

import numpy as np


def silu(x):
    return x / (1 + np.exp(-x))


class State(dict):
    """A state dict that makes the tensors which it does not have; and layers."""

    def __init__(self, seed=0):
        super().__init__()
        self.rng = np.random.default_rng(seed)

    def take(self, name, *shape):
        """The tensor of this name."""
        if name not in self:
            fan_in = max(1, np.prod(shape[1:])) if len(shape) > 1 else 4
            self[name] = self.rng.normal(size=shape) / np.sqrt(fan_in)
        assert self[name].shape == shape, name
        return self[name]

    def linear(self, name, x, out, bias=True):
        """torch.nn.Linear."""
        y = self.take(f"{name}.weight", out, len(x)) @ x
        return y + self.take(f"{name}.bias", out) if bias else y

    def conv(self, name, x, out, size=3, flat=False):
        """torch.nn.Conv2d, or Conv1d over pixels, with padding."""
        shape = (out, len(x), 1) if flat else (out, len(x), size, size)
        weight = self.take(f"{name}.weight", *shape).reshape(out, len(x), size, size)
        rows, columns = x.shape[1:]
        padded = np.pad(x, ((0, 0), (size // 2,) * 2, (size // 2,) * 2))
        total = np.zeros((out, rows, columns))
        for i, j in np.ndindex(size, size):
            patch = padded[:, i : i + rows, j : j + columns]
            total += np.tensordot(weight[:, :, i, j], patch, 1)
        return total + self.take(f"{name}.bias", out)[:, None, None]

    def norm(self, name, x, eps, groups=None):
        """torch.nn.GroupNorm, by default with EDM's number of groups."""
        groups = groups or min(32, len(x) // 4)
        parts = x.reshape(groups, -1)
        spread = np.sqrt(parts.var(1, keepdims=True) + eps)
        y = ((parts - parts.mean(1, keepdims=True)) / spread).reshape(x.shape)
        scale, shift = (self.take(f"{name}.{k}", len(x)) for k in ("weight", "bias"))
        return y * scale[:, None, None] + shift[:, None, None]

    def resample(self, name, x, way):
        """EDM's resampling by the filter (1, 1), which is OpenAI's."""
        if way:
            self[f"{name}.resample_filter"] = np.full((1, 1, 2, 2), 0.25)
        return RESAMPLE[way](x)


def half(x):
    """Means of 2 x 2 pixels."""
    return (x[:, ::2, ::2] + x[:, 1::2, ::2] + x[:, ::2, 1::2] + x[:, 1::2, 1::2]) / 4


def double(x):
    """Nearest neighbours."""
    return np.kron(x, np.ones((1, 2, 2)))


RESAMPLE = {"": lambda x: x, "down": half, "up": double}


def attend(q, k, v):
    """Softmax attention of one head, all [channel, pixel]."""
    logits = q.T @ k / np.sqrt(len(q))
    weights = np.exp(logits - logits.max(1, keepdims=True))
    return v @ (weights / weights.sum(1, keepdims=True)).T


def edm_block(state, name, x, emb, out, song, attention=False, way="", head=64):
    eps, scale = (1e-6, np.sqrt(0.5)) if song else (1e-5, 1.0)
    h = silu(state.norm(f"{name}.norm0", x, eps))
    h = state.resample(f"{name}.conv0", h, way)
    h = state.conv(f"{name}.conv0", h, out)
    level = state.linear(f"{name}.affine", emb, out if song else 2 * out)[:, None, None]
    if song:
        h = silu(state.norm(f"{name}.norm1", h + level, eps))
    else:
        h = silu(state.norm(f"{name}.norm1", h, eps) * (level[:out] + 1) + level[out:])
    h = state.conv(f"{name}.conv1", h, out)
    changed = len(x) != out
    x = state.resample(f"{name}.skip", x, way)
    if changed or (song and way):
        x = state.conv(f"{name}.skip", x, out, 1)
    x = (x + h) * scale
    if not attention:
        return x
    heads = 1 if song else out // head
    h = state.conv(f"{name}.qkv", state.norm(f"{name}.norm2", x, eps), 3 * out, 1)
    parts = h.reshape(heads, out // heads, 3, -1)
    h = np.concatenate([attend(*np.moveaxis(p, 1, 0)) for p in parts])
    return (x + state.conv(f"{name}.proj", h.reshape(x.shape), out, 1)) * scale


def embed(c_noise, channels, song):
    count = channels // 2
    freqs = np.arange(count) / (count - 1 if song else count)
    phase = c_noise * (1 / 10000) ** freqs
    parts = (np.cos(phase), np.sin(phase))
    return np.concatenate(parts[::-1] if song else parts)


def edm(state, x, c_noise, *, song, channels, multipliers, blocks, attention, head=64,
        resolution=64, label=None):  # fmt: skip
    """SongUNet or DhariwalUNet for RGB; `attention` lists levels."""
    emb = embed(c_noise, channels, song)
    if label is not None and song:
        emb = emb + state.linear("map_label", label * np.sqrt(len(label)), channels)
    emb = silu(state.linear("map_layer0", emb, 4 * channels))
    emb = state.linear("map_layer1", emb, 4 * channels)
    if label is not None and not song:
        emb = emb + state.linear("map_label", label, 4 * channels, bias=False)
    emb = silu(emb)

    def block(name, x, out, **options):
        return edm_block(state, name, x, emb, out, song, head=head, **options)

    x = state.conv(f"enc.{resolution}x{resolution}_conv", x,
                   channels if song else channels * multipliers[0])  # fmt: skip
    skips = [x]
    for level, multiplier in enumerate(multipliers):
        size = resolution >> level
        if level:
            x = block(f"enc.{size}x{size}_down", x, len(x), way="down")
            skips.append(x)
        for i in range(blocks):
            x = block(f"enc.{size}x{size}_block{i}", x, channels * multiplier,
                      attention=level in attention)  # fmt: skip
            skips.append(x)
    for level, multiplier in reversed([*enumerate(multipliers)]):
        size = resolution >> level
        name = f"dec.{size}x{size}"
        if level == len(multipliers) - 1:
            x = block(f"{name}_in0", x, len(x), attention=True)
            x = block(f"{name}_in1", x, len(x))
        else:
            x = block(f"{name}_up", x, len(x), way="up")
        for i in range(blocks + 1):
            here = level in attention and (not song or i == blocks)
            x = np.concatenate([x, skips.pop()])
            x = block(f"{name}_block{i}", x, channels * multiplier, attention=here)
    if song:
        name = f"dec.{resolution}x{resolution}_aux"
        return state.conv(f"{name}_conv", silu(state.norm(f"{name}_norm", x, 1e-6)), 3)
    return state.conv("out_conv", silu(state.norm("out_norm", x, 1e-5)), 3)


def adm_block(state, name, x, emb, out, way=""):
    h = RESAMPLE[way](silu(state.norm(f"{name}.in_layers.0", x, 1e-5, 32)))
    h = state.conv(f"{name}.in_layers.2", h, out)
    level = state.linear(f"{name}.emb_layers.1", silu(emb), 2 * out)[:, None, None]
    h = state.norm(f"{name}.out_layers.0", h, 1e-5, 32)
    h = h * (1 + level[:out]) + level[out:]
    h = state.conv(f"{name}.out_layers.3", silu(h), out)
    if len(x) != out:
        return state.conv(f"{name}.skip_connection", x, out, 1) + h
    return RESAMPLE[way](x) + h


def adm_attention(state, name, x, head, new_order):
    count, heads = len(x), len(x) // head
    h = state.norm(f"{name}.norm", x, 1e-5, 32)
    h = state.conv(f"{name}.qkv", h, 3 * count, 1, flat=True).reshape(3 * count, -1)
    if new_order:
        parts = h.reshape(3, heads, head, -1).transpose(1, 0, 2, 3)
    else:
        parts = h.reshape(heads, 3, head, -1)
    h = np.concatenate([attend(*part) for part in parts]).reshape(x.shape)
    return x + state.conv(f"{name}.proj_out", h, count, 1, flat=True)


def adm(state, x, log_sigma, *, channels, multipliers, blocks, attention, head,
        new_order=False, label=None):  # fmt: skip
    """OpenAI's UNetModel as its consistency models run it, with one of 3 classes."""
    emb = embed(1000 * 0.25 * log_sigma, channels, False)
    emb = silu(state.linear("time_embed.0", emb, 4 * channels))
    emb = state.linear("time_embed.2", emb, 4 * channels)
    if label is not None:
        emb = emb + label @ state.take("label_emb.weight", 3, 4 * channels)
    x = state.conv("input_blocks.0.0", x, channels * multipliers[0])
    skips, number = [x], 1
    for level, multiplier in enumerate(multipliers):
        for _ in range(blocks):
            name = f"input_blocks.{number}"
            x = adm_block(state, f"{name}.0", x, emb, channels * multiplier)
            if level in attention:
                x = adm_attention(state, f"{name}.1", x, head, new_order)
            skips.append(x)
            number += 1
        if level < len(multipliers) - 1:
            x = adm_block(state, f"input_blocks.{number}.0", x, emb, len(x), "down")
            skips.append(x)
            number += 1
    x = adm_block(state, "middle_block.0", x, emb, len(x))
    x = adm_attention(state, "middle_block.1", x, head, new_order)
    x = adm_block(state, "middle_block.2", x, emb, len(x))
    number = 0
    for level, multiplier in reversed([*enumerate(multipliers)]):
        for i in range(blocks + 1):
            name, layer = f"output_blocks.{number}", 1
            x = np.concatenate([x, skips.pop()])
            x = adm_block(state, f"{name}.0", x, emb, channels * multiplier)
            if level in attention:
                x = adm_attention(state, f"{name}.1", x, head, new_order)
                layer = 2
            if level and i == blocks:
                x = adm_block(state, f"{name}.{layer}", x, emb, len(x), "up")
            number += 1
    return state.conv("out.2", silu(state.norm("out.0", x, 1e-5, 32)), 3)
