"""Published state dicts make this network the published one, or are refused."""

import functools
import io
import json
import zipfile

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import safetensors.numpy
from flax.traverse_util import flatten_dict

from jradar.diffusion import UNet, load_pretrained, network_fields, write_params
from jradar.diffusion.weights.files import read_state
from tests.diffusion.networks import apply, build, random_params
from tests.diffusion.reference_unet import State, edm

SIZES = {"channels": 8, "multipliers": (1, 2), "blocks": 1}
C_NOISE = -0.3
RNG = np.random.default_rng(3)
NO_LABEL = np.zeros(3)


@functools.cache
def published(kind, labelled=False):
    """A state dict in float32, a grey image, and the network's output for it."""
    state, image = State(), RNG.normal(size=(8, 16 if kind == "song" else 8))
    rgb, label = np.repeat(image[None], 3, 0), NO_LABEL if labelled else None
    options = {**SIZES, "attention": (1,), "head": 4}
    output = edm(state, rgb, C_NOISE, song=kind == "song", label=label, **options)
    state = {name: tensor.astype(np.float32) for name, tensor in state.items()}
    return state, image, output.mean(0)


def network_for(kind, stem):
    return UNet(
        form="ddpm++" if kind == "song" else "adm",
        attention_levels=(1,),
        head_channels=4,
        stem=stem,
        **SIZES,
    )


def arguments(image, stem):
    """The image with each pixel as large as the stem, a validity, a condition."""
    full = np.kron(image, np.ones(stem))
    x = np.stack([full, RNG.normal(size=full.shape)], -1)[None]
    condition = RNG.normal(size=(1, *image.shape, 3))
    x, condition = (jnp.asarray(values, jnp.float32) for values in (x, condition))
    return x, jnp.float32([C_NOISE]), condition


def shapes_of(network, args):
    shapes = jax.eval_shape(network.init, jax.random.key(0), *args)
    return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)


def save(path, state):
    np.savez(path, **state)
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "stem", "labelled"),
    [
        ("song", (1, 4), False),
        ("dhariwal", (1, 1), False),
        *((kind, (1, 1), True) for kind in ("song", "dhariwal")),
    ],
)
def test_the_network_first_is_the_published_one(tmp_path, kind, stem, labelled):
    state, image, expected = published(kind, labelled)
    safetensors.numpy.save_file(state, tmp_path / "w.safetensors")
    network, args = network_for(kind, stem), arguments(image, stem)
    params = random_params(network, *args)
    path = tmp_path / "w.safetensors"
    params, report = load_pretrained(path, network, params)
    output = apply(network, params, *args)[0]
    spread = np.kron(expected, np.ones(stem))
    np.testing.assert_allclose(output[..., 0], spread, atol=1e-5)
    assert np.abs(expected).max() > 0.1
    assert not output[..., 1].any()
    unused = ("resample_filter", "map_label.weight")
    assert all(name.endswith(unused) for name in report.unused)
    assert {name.split("/")[0] for name in report.new} == {
        "angles", "detail", "detail_affine", "detail_angles", "enc0_condition",
        "enc1_condition", "refine", "unfold",
    }  # fmt: skip


def song_with(name, value):
    """The state dict with another tensor: the one whose name ends so, or a new one."""

    def change(state):
        full = next((known for known in state if known.endswith(name)), name)
        return state | {full: value}

    return change


def filtered(*taps):
    """The state dict with another resampling filter."""
    kernel = np.outer(taps, taps)[None, None] / np.sum(taps) ** 2

    def change(state):
        return {k: kernel if "resample" in k else v for k, v in state.items()}

    return change


def without(part):
    return lambda state: {k: v for k, v in state.items() if part not in k}


ZEROS = np.zeros(64, np.float32)
FILTER = r"resample_filter has taps in the shares .*, expected \[0.5, 0.5\]"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "fields", "change", "message"),
    [
        ("song", {}, filtered(1, 3, 3, 1), FILTER),
        ("song", {}, filtered(1, 2), FILTER),
        ("song", {"group_channels": 1}, None, "set its group_channels = 4"),
        ("song", {"form": "adm"}, None, r"has the form 'ddpm\+\+', the network 'adm'"),
        ("song", {"noise_scale": 1e3}, None, "needs noise_scale = 1.0, the network"),
        ("song", {}, without("block0.conv1"), "8 parameters missing"),
        ("song", {}, without(""), "no first convolution found"),
        ("song", {}, song_with("enc.64x64_block1.conv0.bias", ZEROS[:8]), "1 too many"),
        ("song", {}, song_with("map_noise.freqs", ZEROS), r"found NCSN\+\+ \(ve\), e"),
        ("song", {}, song_with("layer0.bias", ZEROS), r"shape \(64,\), .* needs \(32"),
        ("song", {}, song_with("_conv.weight", np.float32(3)), r"w\.npz"),
        ("song", {}, song_with("map_layer0.weight", np.zeros((2, 2, 2))), r"w\.npz"),
        ("song", {}, song_with("qkv.weight", ZEROS[:3]), r"w\.npz"),
        ("song", {}, song_with("layer0.bias", np.nan * ZEROS[:32]), r"w\.npz"),
        ("song", {}, song_with("enc.0x0_conv.bias", ZEROS[:3]), r"w\.npz"),
    ],
)
def test_what_is_not_the_published_network(tmp_path, kind, fields, change, message):
    state, image, _ = published(kind)
    network = network_for(kind, (1, 4)).clone(**fields)
    path = save(tmp_path / "w.npz", change(state) if change else state)
    params = shapes_of(network, arguments(image, (1, 4)))
    with pytest.raises(ValueError, match=message):
        load_pretrained(path, network, params)


def test_a_network_without_the_full_path_keeps_its_own_head(tmp_path):
    state, image, _ = published("song")
    network = network_for("song", (1, 4)).clone(detail_channels=0)
    params = shapes_of(network, arguments(image, (1, 4)))
    _, report = load_pretrained(save(tmp_path / "w.npz", state), network, params)
    assert {n for n in report.new if n.startswith("unfold")} == {
        "unfold/kernel", "unfold/bias",
    }  # fmt: skip
    rest = {n for n in report.unused if not n.endswith("resample_filter")}
    assert rest == {"dec.0_aux_conv.bias", "dec.0_aux_conv.weight"}
    assert len(report.loaded) == len(state) - len(report.unused)


def test_npz_prefix_and_what_is_not_used(tmp_path):
    state, image, _ = published("song")
    network = network_for("song", (1, 4))
    params = shapes_of(network, arguments(image, (1, 4)))
    extra = {"map_augment.weight": np.ones((8, 9)), "map_label.weight": np.ones((8, 3))}
    named = {f"model.{name}": tensor for name, tensor in (state | extra).items()}
    loaded, report = load_pretrained(save(tmp_path / "w.npz", named), network, params)
    assert set(report.unused) == {
        *(f"{place}.resample_filter" for place in (
            "enc.1_down.conv0", "enc.1_down.skip", "dec.0_up.conv0", "dec.0_up.skip"
        )),
        "map_augment.weight",
        "map_label.weight",
    }  # fmt: skip
    trunk = loaded["params"]["trunk"]
    kernel = trunk["enc1_down"]["conv0"]["kernel"]
    expected = state["enc.32x32_down.conv0.weight"].transpose(2, 3, 1, 0)
    np.testing.assert_array_equal(kernel, expected)
    assert loaded["params"]["tower"] is params["params"]["tower"]


def test_a_file_of_the_trunk_fills_the_trunk_alone(tmp_path):
    network, params, args = build()
    path = tmp_path / "trunk.safetensors"
    metadata = {"network": json.dumps(network_fields(network))}
    trunk = {"params": {"trunk": params["params"]["trunk"]}}
    write_params(path, trunk, metadata=metadata, dtype=np.float32)
    start = shapes_of(network, (*args[:2], args[2][..., :1]))  # another condition
    loaded, report = load_pretrained(path, network, start)
    trunks = (loaded["params"]["trunk"], params["params"]["trunk"])
    jax.tree.map(np.testing.assert_array_equal, *trunks)
    assert not any(leaf.any() for leaf in jax.tree.leaves(loaded["params"]["tower"]))
    assert report.new and all(n.startswith("params/tower/") for n in report.new)
    assert len(report.loaded) == len(jax.tree.leaves(params["params"]["trunk"]))
    for change, message in (
        ({"stem": (2, 2)}, r"with stem = \[1, 4\], expected \[2, 2\]"),
        ({"noise_scale": 1000.0}, "with noise_scale = 1.0, expected 1000.0"),
        ({"head_channels": 4}, "with head_channels = 64, expected 4"),
    ):
        with pytest.raises(ValueError, match=message):
            load_pretrained(path, network.clone(**change), start)


def test_weights_for_images_start_a_network_of_means_and_spreads(tmp_path):
    options = {"multipliers": (1,), "attention_levels": (), "detail_channels": 0}
    network, params, args = build((4, 16), (4, 4), **options)
    flat = {k: np.asarray(v) for k, v in flatten_dict(params, sep="/").items()}
    both = network.clone(outputs=4)
    start = shapes_of(both, args)
    loaded, _ = load_pretrained(save(tmp_path / "w.npz", flat), both, start)
    output = apply(both, loaded, *args)
    before = apply(network, params, *args)
    np.testing.assert_allclose(output[..., :2], before, atol=1e-6)
    assert not output[..., 2:].any()


def test_weights_trained_here_that_do_not_fit_are_refused(tmp_path):
    network, params, _ = build()
    flat = {k: np.asarray(v) for k, v in flatten_dict(params, sep="/").items()}
    stem, tower = "params/trunk/stem/bias", "params/tower/input/bias"
    path = save(tmp_path / "w.npz", flat)
    zeros = jax.tree.map(jnp.zeros_like, params)
    loaded, report = load_pretrained(path, network, zeros)
    jax.tree.map(np.testing.assert_array_equal, loaded, params)
    assert len(report.loaded) == len(flat) and not report.new

    def without(name):
        return {k: v for k, v in flat.items() if k != name}

    for bad, message in (
        (without(stem), r"1 parameters missing \['params/trunk/stem/bias'\], 0 too"),
        (without(tower), r"1 parameters missing \['params/tower/input/bias'\]"),
        (flat | {"params/more": np.zeros(1)}, r"1 too many \['params/more'\]"),
        (
            flat | {stem: np.zeros(9)},
            r"stem/bias has shape \(9,\), the network needs \(8,",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            load_pretrained(save(path, bad), network, params)
    prior = tmp_path / "prior.safetensors"
    safetensors.numpy.save_file(flat, prior, {"network": "[1]"})
    with pytest.raises(ValueError, match="prior.safetensors is damaged or not"):
        load_pretrained(prior, network, params)


def test_unusable_files_are_refused(tmp_path, monkeypatch):
    from jradar.diffusion.weights import files

    objects = io.BytesIO()
    np.save(objects, np.array([{}], dtype=object), allow_pickle=True)
    with zipfile.ZipFile(tmp_path / "o.npz", "w") as archive:
        archive.writestr("a.npy", objects.getvalue())
    (tmp_path / "t.npz").write_bytes(b"PK\3\4")
    (tmp_path / "t.safetensors").write_bytes(b"\xff" * 64)
    (tmp_path / "t.pkl").write_bytes(b"")
    for name, message in (
        ("o.npz", "o.npz is damaged or not a .npz file of weights: Object arrays"),
        ("t.npz", "t.npz is damaged or not"),
        ("t.safetensors", "t.safetensors is damaged or not a .safetensors file"),
        ("t.pkl", "convert pickles with"),
    ):
        with pytest.raises(ValueError, match=message):
            read_state(tmp_path / name)
    np.savez_compressed(tmp_path / "bomb.npz", a=np.zeros(100_000))
    monkeypatch.setattr(files, "MAX_FILE_BYTES", 10_000)
    with pytest.raises(ValueError, match="it unpacks to 800,128 bytes"):
        read_state(tmp_path / "bomb.npz")
    np.save(tmp_path / "long.npz", np.zeros(100_000))
    with pytest.raises(ValueError, match="larger than 10,000 bytes"):
        read_state(tmp_path / "long.npz.npy")
