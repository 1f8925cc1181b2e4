"""`-q` and `-v`: errors alone, or where each value came from."""

import logging
import warnings

import pytest

from jradar.cli import main
from jradar.progress import progress


def test_verbose_says_where_values_came_from(small_cube, capsys):
    assert main(["info", small_cube, "-v"]) == 0
    out, err = capsys.readouterr()
    assert "is read as a .npy cube with its .toml" in err
    assert "the radar, a awr1843, is described by" in err and "radar.toml" in err
    assert "does not hold name, " in err and "slope_hz_per_s" in err
    assert "num_chirps," not in err  # which it holds
    assert "compiled programs are in" in err and "the command took" in err
    assert main(["info", small_cube]) == 0
    assert capsys.readouterr() == (out, "")
    assert not logging.getLogger("jradar").handlers


def test_quiet_prints_errors_and_the_result_alone(small_cube, capsys, monkeypatch):
    def info(options):
        """Make noise."""
        with progress("trying", 2) as show:
            show(1)
            show(2)
        warnings.warn("a library's", stacklevel=1)
        logging.getLogger("jradar.stream").warning("open this")
        return {"found": 3}

    monkeypatch.setattr("jradar.cli.commands.info", info)
    assert main(["info", small_cube]) == 0
    out, err = capsys.readouterr()
    assert all(text in err for text in ("trying 2/2", "a library's", "open this"))
    assert main(["info", small_cube, "--quiet"]) == 0
    assert capsys.readouterr() == (out, "")
    assert main(["info", "/no", "--quiet"]) == 2
    assert "no such file or folder: /no" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["info", small_cube, "-q", "-v"])
