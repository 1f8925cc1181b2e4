"""Files that cannot be converted are refused in one line, whatever PyTorch raises."""

import pickle
import sys
import types

import pytest

from experiments.convert_weights import main

# What torch.load(weights_only=True) raises for an object of a file.
ADVICE = (
    "Weights only load failed. Re-running `torch.load` with `weights_only` set to "
    "`False` will likely succeed"
)


@pytest.fixture
def loading(monkeypatch):
    """A function that makes `torch.load` raise an error."""
    torch = types.ModuleType("torch")
    monkeypatch.setitem(sys.modules, "torch", torch)

    def install(error):
        def load(*_, **options):
            assert options["weights_only"] is True
            raise error

        monkeypatch.setattr(torch, "load", load, raising=False)

    return install


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (pickle.UnpicklingError(ADVICE), "contains more than a state dict"),
        (RuntimeError("failed finding central directory"), "central directory"),
        (EOFError("Ran out of input"), "Ran out of input"),
        (IndexError("pop from an empty list"), "pop from an empty list"),
    ],
)
def test_what_torch_refuses_ends_in_one_line(tmp_path, capsys, loading, error, message):
    path = tmp_path / "net.pt"
    path.write_bytes(b"content")
    loading(error)
    assert main([str(path), str(tmp_path / "out.safetensors")]) == 4
    err = capsys.readouterr().err
    assert f"{path} is damaged or not a file of weights" in err and message in err
    assert err.count("\n") == 1 and "weights_only" not in err
    assert not (tmp_path / "out.safetensors").exists()


@pytest.mark.parametrize("kept", [0, 1, 7, 30])
def test_a_cut_pickle_is_named(tmp_path, capsys, loading, kept):
    path = tmp_path / "net.pkl"
    path.write_bytes(pickle.dumps({"ema": {"weights": [1, 2, 3]}})[:kept])
    loading(EOFError())
    assert main([str(path), str(tmp_path / "out.safetensors")]) == 4
    assert f"{path} is damaged or not a file" in capsys.readouterr().err


@pytest.mark.parametrize("suffix", [".pt", ".pkl"])
def test_a_missing_file_is_named_before_torch_is_needed(tmp_path, capsys, suffix):
    path = tmp_path / f"nowhere{suffix}"
    assert main([str(path), str(tmp_path / "out.safetensors")]) == 2
    assert capsys.readouterr().err == f"error: no such file: {path}\n"
