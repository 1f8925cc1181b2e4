"""Exit codes: the nearest kind of an error decides; faults of the program have none."""

import gc
import json
import os
import signal
import sys
import time

import jax
import pytest

from jradar.errors import (
    CheckpointError,
    ModelError,
    Terminated,
    UsageError,
    check_platform,
    exit_code,
    parsing,
    sigterm_raises,
)
from jradar.files import FolderLocked

CODES = {
    UsageError("no such option"): 2,
    FileNotFoundError("no such recording"): 2,
    FolderLocked("another process is running"): 3,
    OSError("disk full"): 3,
    ModuleNotFoundError("missing extra"): 3,
    ValueError("bad data"): 4,
    json.JSONDecodeError("bad data", "{", 1): 4,
    FloatingPointError("loss is nan"): 4,
    ModelError("no weights"): 5,
    CheckpointError("none is whole"): 5,
    KeyboardInterrupt(): 130,
    Terminated(): 143,
}
FAULTS = TypeError, KeyError, AssertionError, ZeroDivisionError, SystemExit
CODES |= {kind("else"): None for kind in (*FAULTS, RuntimeError)}


@pytest.mark.parametrize("error", CODES, ids=lambda error: type(error).__name__)
def test_errors_that_a_user_can_mend_have_their_code_and_others_none(error):
    assert exit_code(error) == CODES[error]


@pytest.mark.parametrize("kind", [UsageError, ModelError, CheckpointError])
def test_callers_that_catch_value_errors_catch_them_too(kind):
    with pytest.raises(ValueError, match="why"):
        raise kind("why")


@pytest.mark.parametrize(
    "raised",
    [ValueError("bad"), KeyError("x"), MemoryError(), RecursionError(), OSError("cut")],
    ids=lambda error: type(error).__name__,
)
def test_what_a_parser_raises_names_the_file(raised):
    with pytest.raises(ValueError, match="^a.npy is damaged or not a .npy file: "):
        with parsing("a.npy", "a .npy file"):
            raise raised


@pytest.mark.parametrize(
    "raised",
    [UsageError("x"), ModelError("x"), FileNotFoundError("x"), ImportError("x")]
    + [ValueError("a.npy holds 3 bytes"), KeyboardInterrupt()],
    ids=lambda error: type(error).__name__,
)
def test_other_errors_pass_a_parser_unchanged(raised):
    with pytest.raises(type(raised)) as found:
        with parsing("a.npy", "a .npy file"):
            raise raised
    assert found.value is raised


def test_sigterm_runs_what_cleans_up_and_a_second_one_ends_at_once():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(Terminated, match="ended by SIGTERM"):
        with sigterm_raises():
            try:
                os.kill(os.getpid(), signal.SIGTERM)
            finally:
                assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    assert signal.getsignal(signal.SIGTERM) == before


def test_sigterm_while_garbage_is_collected_is_not_lost(capfd):
    def terminated(*_):
        gc.callbacks.remove(terminated)
        os.kill(os.getpid(), signal.SIGTERM)

    before = signal.getsignal(signal.SIGTERM), sys.unraisablehook
    with pytest.raises(Terminated, match="ended by SIGTERM"):
        with sigterm_raises():
            gc.callbacks.append(terminated)
            gc.collect()
            time.sleep(60)
    assert (signal.getsignal(signal.SIGTERM), sys.unraisablehook) == before
    assert "Exception ignored" not in capfd.readouterr().err


def test_other_faults_without_a_caller_are_reported(monkeypatch):
    reported = []
    monkeypatch.setattr(sys, "unraisablehook", reported.append)

    def fails(*_):
        gc.callbacks.remove(fails)
        raise ValueError("of the callback")

    with sigterm_raises():
        gc.callbacks.append(fails)
        gc.collect()
    assert [str(fault.exc_value) for fault in reported] == ["of the callback"]


@pytest.mark.parametrize("name", ["cuda", "tpu", "nonsense"])
@pytest.mark.parametrize("error", [AssertionError(), RuntimeError("Unable to ..")])
def test_a_platform_without_devices_is_named(monkeypatch, name, error):
    def devices():
        raise error

    monkeypatch.setattr(jax, "devices", devices)
    check_platform()
    monkeypatch.setenv("JAX_PLATFORMS", name)
    with pytest.raises(OSError, match=f"JAX_PLATFORMS={name}, but JAX finds no such"):
        check_platform()
