"""Published files become state dicts; their code is never run, and faults are named."""

import pickle
import sys
import types

import numpy as np
import pytest

from experiments.convert_weights import main
from jradar.diffusion.weights.files import read_state
from tests.diffusion.test_perceptual import Evil

# What torch.load(weights_only=True) raises for an object of a file.
ADVICE = (
    "Weights only load failed. Re-running `torch.load` with `weights_only` set to "
    "`False` will likely succeed"
)
NOISE = np.random.default_rng(0).bytes(300)
TENSOR = b"\x80\x03ctorch.storage\n_load_from_bytes\nC\1x\x85R."  # asks for its bytes
PICKLE = pickle.dumps({"ema": {"weights": [1, 2, 3]}})


@pytest.fixture
def torch():
    return pytest.importorskip("torch", reason="needs jradar[bench]")


class Persistent:
    """Pickled as NVIDIA's persistent classes are: with source, and its state."""

    def __init__(self, source, **state):
        self.meta = {"type": "class", "version": 6, "module_src": source,
                     "class_name": "Net", "state": state}  # fmt: skip

    def __reduce__(self):
        return sys.modules["torch_utils.persistence"]._reconstruct_persistent_obj, (
            self.meta,
        )


@pytest.fixture
def persistence(monkeypatch):
    """A module of the name that the pickles ask for."""
    module = types.ModuleType("torch_utils.persistence")

    def _reconstruct_persistent_obj(meta):
        raise AssertionError("the file's source would run")

    _reconstruct_persistent_obj.__module__ = module.__name__
    _reconstruct_persistent_obj.__qualname__ = "_reconstruct_persistent_obj"
    module._reconstruct_persistent_obj = _reconstruct_persistent_obj
    monkeypatch.setitem(sys.modules, "torch_utils", types.ModuleType("torch_utils"))
    monkeypatch.setitem(sys.modules, module.__name__, module)


def test_a_published_pickle_becomes_its_state_dict(torch, tmp_path, persistence):
    weight = torch.nn.Parameter(torch.arange(6.0).reshape(2, 3))
    source = f"open({str(tmp_path / 'ran')!r}, 'w')"
    conv = Persistent(
        source,
        _parameters={"weight": weight, "bias": None},
        _buffers={"filter": torch.ones(2).half()},
        _modules={},
    )
    blocks = torch.nn.ModuleDict()
    blocks._modules = {"8x8_conv": conv}
    network = Persistent(source, _parameters={}, _modules={"enc": blocks})
    path = tmp_path / "net.pkl"
    path.write_bytes(pickle.dumps({"ema": network, "loss_fn": None}))
    assert main([str(path), str(tmp_path / "net.safetensors")]) == 0
    state = read_state(tmp_path / "net.safetensors")
    assert sorted(state) == ["enc.8x8_conv.filter", "enc.8x8_conv.weight"]
    np.testing.assert_array_equal(state["enc.8x8_conv.weight"], weight.detach())
    assert state["enc.8x8_conv.filter"].dtype == np.float32
    assert not (tmp_path / "ran").exists()


@pytest.fixture
def refused(tmp_path, capsys, monkeypatch):
    """Convert what cannot be, without PyTorch, whose `load` raises `error`."""

    def run(name, content, error=None):
        def load(*_, **options):
            assert options["weights_only"] is True
            raise error

        stand_in = types.ModuleType("torch")
        stand_in.load = load
        stand_in._utils = types.SimpleNamespace(_rebuild_tensor_v2=None)
        monkeypatch.setitem(sys.modules, "torch", stand_in)
        path = tmp_path / name
        path.write_bytes(content)
        assert main([str(path), str(tmp_path / "out.safetensors")]) == 4
        assert not (tmp_path / "out.safetensors").exists()
        err = capsys.readouterr().err
        assert f"{path} is damaged or not a file of weights" in err
        assert err.count("\n") == 1
        return err

    return run


def test_other_code_is_refused(tmp_path, refused):
    content = pickle.dumps({"ema": Evil(tmp_path / "sentinel")})
    assert "asks for pathlib" in refused("net.pkl", content)
    assert not (tmp_path / "sentinel").exists()


@pytest.mark.parametrize("kept", [0, 1, 7, 30, None])
def test_a_damaged_pickle_is_named(refused, kept):
    err = refused("w.pkl", PICKLE[:kept])
    assert kept is not None or "contains no network under `ema`" in err
    refused("w.pkl", NOISE)


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (pickle.UnpicklingError(ADVICE), "contains more than a state dict"),
        (RuntimeError("failed finding central directory"), "central directory"),
        (EOFError("Ran out of input"), "Ran out of input"),
        (IndexError("pop from an empty list"), "pop from an empty list"),
    ],
)
def test_what_torch_refuses_ends_in_one_line(refused, error, message):
    err = refused("net.pkl", TENSOR, error)
    assert message in err and "weights_only" not in err
