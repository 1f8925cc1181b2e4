"""`jradar finetune` says what a stopped run keeps."""

import pytest

from jradar.cli import main
from jradar.errors import Terminated
from jradar.training import finetuning


@pytest.mark.parametrize(
    ("stop", "code"), [(KeyboardInterrupt, 130), (Terminated, 143)]
)
def test_a_stopped_run_says_what_is_kept_and_how_to_go_on(
    stop, code, tmp_path, monkeypatch, capsys
):
    (tmp_path / "records").mkdir()
    command = ["finetune", str(tmp_path / "records"), "-o", str(tmp_path / "mine")]

    def begun(*_, **__):
        raise stop

    monkeypatch.setattr(finetuning, "finetune", begun)
    assert main(command) == code
    err = capsys.readouterr().err
    assert "keeps nothing yet; run the same command to go on" in err

    def stopped(*_, **__):
        for name in ("room_1", "room_2"):
            (tmp_path / "mine" / "replay" / "records" / name).mkdir(parents=True)
            (tmp_path / "mine/replay/records" / name / "0000.json").write_text("{}")
        for name in ("40", "60.orbax-checkpoint-tmp"):  # one was half written
            (tmp_path / "mine" / "checkpoints" / name).mkdir(parents=True)
        raise stop

    monkeypatch.setattr(finetuning, "finetune", stopped)
    assert main([*command, "--replay-records", str(tmp_path / "records")]) == code
    err = capsys.readouterr().err
    assert "keeps 2 frames of old places and the weights of step 40; run" in err
