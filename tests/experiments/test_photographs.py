"""Photographs: upright luminance, crops that only depend on their generator, limits."""

import numpy as np
import pytest
from PIL import Image

from experiments.tasks import photographs as module
from experiments.tasks.photographs import Photographs, crop


def ramp(rows, columns):
    """Luminance that grows by 1 per row and by 2 per column."""
    return (np.arange(rows)[:, None] + 2 * np.arange(columns)).astype(np.uint8)


@pytest.fixture
def folder(tmp_path):
    """Four usable files, one of them in a subfolder, and unusable ones."""
    grey = ramp(40, 60)
    (tmp_path / "below").mkdir()
    Image.fromarray(np.stack([grey] * 3, -1)).save(tmp_path / "a.png")
    Image.fromarray(grey).save(tmp_path / "b.JPG", quality=95)
    turned = Image.fromarray(np.rot90(grey))  # a camera on its side: 8 turns it back
    exif = Image.Exif()
    exif[module.ORIENTATION] = 6
    turned.save(tmp_path / "below" / "c.jpeg", exif=exif, quality=95)
    Image.fromarray(grey).save(tmp_path / "d.png", format="WEBP", lossless=True)
    Image.fromarray(ramp(40, 31)).save(tmp_path / "narrow.png")
    Image.fromarray(grey.astype(np.uint16)).save(tmp_path / "deep.png")
    (tmp_path / "text.jpg").write_text("no image")
    (tmp_path / "notes.txt").write_text("no image either")
    return tmp_path


def test_usable_files_are_read_upright_in_order_and_others_are_named(folder):
    found = Photographs(folder, smallest=(8, 32))
    assert len(found) == 4
    for index, tolerance in enumerate((0, 3, 3, 0)):
        assert found[index].dtype == np.uint8
        np.testing.assert_allclose(
            found[index].astype(int), ramp(40, 60).astype(int), atol=tolerance
        )
    reasons = {path.split("/")[-1]: why for path, why in found.skipped.items()}
    assert reasons.keys() == {"narrow.png", "deep.png", "text.jpg"}
    assert reasons["narrow.png"] == "31 x 40 pixels, expected 32 x 8"
    assert reasons["deep.png"].startswith("mode I;16, expected one of")
    assert "not usable: cannot identify" in reasons["text.jpg"]
    with pytest.raises(IndexError):
        _ = found[4]
    before = found.digest
    assert before == Photographs(folder, smallest=(8, 32)).digest
    (folder / "a.png").unlink()
    assert Photographs(folder, smallest=(8, 32)).digest != before


def test_limits_and_damage(folder, monkeypatch):
    content = (folder / "a.png").read_bytes()
    (folder / "a.png").write_bytes(content[: len(content) // 2])
    found = Photographs(folder, smallest=(8, 32))
    with pytest.raises(ValueError, match="a.png is damaged, remove it"):
        _ = found[0]
    monkeypatch.setattr(module, "KEPT_PIXELS", 600)  # a crop of 16 x 32 needs more
    small = Photographs(folder, smallest=(16, 32))[3]
    assert small.shape == (21, 32)
    np.testing.assert_allclose(np.diff(small[3:-3, 3:-3].astype(int)), 4, atol=1)
    monkeypatch.setattr(module, "MAX_PIXELS", 40 * 60 - 1)
    with pytest.raises(ValueError, match="60 x 40 pixels, expected at most 2,399"):
        Photographs(folder, smallest=(8, 32))
    monkeypatch.setattr(module, "MAX_FILE_BYTES", 10)
    with pytest.raises(ValueError, match="bytes, expected at most 10"):
        Photographs(folder, smallest=(8, 32))
    with pytest.raises(ValueError, match="contains no photographs of at least 32 x 8"):
        Photographs(folder / "below", smallest=(8, 32))
    with pytest.raises(FileNotFoundError, match="no such folder: .*nowhere"):
        Photographs(folder / "nowhere", smallest=(8, 32))


def test_a_crop_is_a_part_of_the_photograph_at_a_random_scale():
    """Every part of a ramp is a ramp; its slope is the scale, its sign the flip."""
    image, scales, sides = ramp(40, 60), [], []
    for seed in range(200):
        part = crop(np.random.default_rng(seed), image, (4, 8))
        assert part.shape == (4, 8) and part.dtype == np.float32
        counts = (part + 1) * 127.5
        down = np.median(np.diff(counts, axis=0))
        across = np.median(np.diff(counts, axis=1))
        assert abs(across) == pytest.approx(2 * down, abs=1)
        assert 0 <= counts.min() and counts.max() <= 39 + 2 * 59
        scales.append(down)
        sides.append(across > 0)
    assert min(scales) < 1.5 and max(scales) > 6  # between 1 and 7.5
    assert 70 < sum(sides) < 130
    again = crop(np.random.default_rng(199), image, (4, 8))
    np.testing.assert_array_equal(again, part)


def test_a_crop_as_large_as_the_photograph_is_the_photograph():
    image = ramp(10, 40)
    part = crop(np.random.default_rng(1), image, (10, 40))
    expected = image.astype(np.float32) / 127.5 - 1
    assert np.array_equal(part, expected) or np.array_equal(part, expected[:, ::-1])
