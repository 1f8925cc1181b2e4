"""EDM's SongUNet (DDPM++) and DhariwalUNet, written in NumPy.

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

    def conv(self, name, x, out, size=3):
        """torch.nn.Conv2d with padding."""
        weight = self.take(f"{name}.weight", out, len(x), size, size)
        rows, columns = x.shape[1:]
        padded = np.pad(x, ((0, 0), (size // 2,) * 2, (size // 2,) * 2))
        total = np.zeros((out, rows, columns))
        for i, j in np.ndindex(size, size):
            patch = padded[:, i : i + rows, j : j + columns]
            total += np.tensordot(weight[:, :, i, j], patch, 1)
        return total + self.take(f"{name}.bias", out)[:, None, None]

    def norm(self, name, x, eps):
        """torch.nn.GroupNorm with EDM's number of groups."""
        groups = min(32, len(x) // 4)
        parts = x.reshape(groups, -1)
        spread = np.sqrt(parts.var(1, keepdims=True) + eps)
        y = ((parts - parts.mean(1, keepdims=True)) / spread).reshape(x.shape)
        scale, shift = (self.take(f"{name}.{k}", len(x)) for k in ("weight", "bias"))
        return y * scale[:, None, None] + shift[:, None, None]

    def resample(self, name, x, way):
        """EDM's resampling by the filter (1, 1)."""
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
