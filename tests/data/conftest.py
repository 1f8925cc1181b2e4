"""Two sequences in ColoRadar's layout, and what becomes of them."""

import pytest

from jradar.data.prepare import prepare
from tests.data.prepared import SPEC
from tests.recordings.small_sequence import write_sequence


@pytest.fixture(scope="session")
def root(tmp_path_factory):
    root = tmp_path_factory.mktemp("coloradar")
    write_sequence(root, "12_21_2020_ec_hallways_run0", frames=5)
    write_sequence(root, "12_21_2020_ec_hallways_run3", frames=3, seed=1)
    return root


@pytest.fixture(scope="session")
def prepared(root, tmp_path_factory):
    folder = tmp_path_factory.mktemp("prepared")
    prepare(root, folder, SPEC, workers=1)
    return folder
