"""Simulated beside real frames: the recipe, the numbers, what is missing."""

import numpy as np
import pytest

from experiments.studies.realism import (
    CROPPED,
    MAX_RANGE_M,
    PolarFrame,
    azimuth_image,
    main,
    pair_statistics,
    peak_distances,
    polar_mask,
    polar_points,
    read_capture,
    read_pairs,
)
from jradar.radar import RadarSpec, Scatterers, simulate_cube

RADAR = RadarSpec.awr1843()


def echo(azimuth_deg, distance, *, velocity=0.0):
    """A cube of one echo, and where it is in the plane."""
    import jax
    import jax.numpy as jnp

    turn = np.radians(azimuth_deg)
    place = distance * np.array([np.cos(turn), np.sin(turn), 0.0])
    one = Scatterers(
        jnp.asarray(place[None], jnp.float32),
        jnp.full(1, velocity, jnp.float32),
        jnp.ones(1, jnp.float32),
    )
    cube = simulate_cube(jax.random.key(0), one, RADAR, noise_power=0.01)
    return np.asarray(cube), place[:2]


@pytest.mark.parametrize("azimuth_deg", [-40, 25])
def test_an_echo_stands_in_the_image_where_it_is(azimuth_deg):
    cube, place = echo(azimuth_deg, 6.0, velocity=0.6)
    image = azimuth_image(cube, RADAR)
    assert image.max() == 1 and not image[:CROPPED].any()
    row, column = np.unravel_index(image.argmax(), image.shape)
    assert row * RADAR.range_resolution_m == pytest.approx(6.0, abs=0.1)
    assert 2 * column / 32 - 1 == pytest.approx(
        np.sin(np.radians(azimuth_deg)), abs=0.04
    )
    near = peak_distances(PolarFrame(image, place[None]))
    assert near.min() < 0.3
    # With one echo, every azimuth's peak lies on one circle.
    sine = 2 * np.arange(32) / 32 - 1
    turns = np.arcsin(sine[np.abs(sine) < np.sin(np.radians(60))])
    circle = 12 * np.abs(np.sin((turns - np.radians(azimuth_deg)) / 2))
    assert np.abs(near - circle)[circle < 4].max() < 0.3


def test_lidar_pictures_keep_places():
    random = np.random.default_rng(0)
    azimuth, distance = random.uniform(-1.2, 1.2, 50), random.uniform(1, 15, 50)
    xyz = distance[:, None] * np.stack(
        [np.cos(azimuth), np.sin(azimuth), 0 * azimuth], -1
    )
    xyz[0] = (3.0, 0.0, 2.0)  # on the ceiling
    found = polar_points(polar_mask(xyz))
    apart = np.linalg.norm(found[:, None] - xyz[None, 1:, :2], axis=-1).min(1)
    assert len(found) >= 45 and (apart < 0.05 + 0.016 * 15).all()


def test_numbers_of_a_known_pair():
    image = np.zeros((128, 32))
    image[40] = 1.0
    columns = np.arange(-90, 91)
    arc = 40 * MAX_RANGE_M / 128
    turns = np.radians(columns)
    circle = arc * np.stack([np.cos(turns), np.sin(turns)], -1)
    numbers = pair_statistics([PolarFrame(image, circle)])
    assert numbers["peaks within 0.2 m of LiDAR (%)"] == 100
    assert numbers["mean of the image (% of its largest dB)"] == pytest.approx(
        100 / 116
    )
    assert pair_statistics([PolarFrame(image, 2 * circle)])[
        "peaks to LiDAR, median (m)"
    ] == pytest.approx(arc, rel=1e-3)


@pytest.mark.parametrize("part", ["openradar", "coloradar_pairs"])
def test_missing_samples_are_named(part, tmp_path, capsys):
    if part == "coloradar_pairs":
        (tmp_path / "openradar").mkdir()
        np.save(
            tmp_path / "openradar/doppler_example_1.npy",
            np.zeros((128, 8, 128), complex),
        )
    assert main([str(tmp_path), "-o", str(tmp_path / "out")]) == 2
    assert part in capsys.readouterr().err


def test_a_capture_of_another_shape_is_refused(tmp_path):
    path = tmp_path / "other.npy"
    np.save(path, np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"shape \(2, 3\), expected complex"):
        read_capture(path)


def test_the_command_draws_stand_ins(tmp_path, capsys):
    random = np.random.default_rng(0)
    (tmp_path / "openradar").mkdir()
    words = random.integers(-99, 99, (2, 128, 8, 128)).astype("i2").view("u2")
    stored = words[0].astype(float) + 1j * words[1]
    np.save(tmp_path / "openradar/doppler_example_1.npy", stored)
    folders = ("range_azimuth_heatmap", "lidar_pcl_bev_polar_img")
    for folder, shape in zip(folders, ((128, 64), (160, 100)), strict=True):
        (tmp_path / "coloradar_pairs" / folder).mkdir(parents=True)
        grey = random.integers(0, 255, shape)[..., None].repeat(3, -1).astype("u1")
        path = tmp_path / "coloradar_pairs" / folder / "0.png"
        write_grey(path, grey[..., 0])
    out = tmp_path / "out"
    assert main([str(tmp_path), "-o", str(out), "--scenes", "corridor"]) == 0
    assert (out / "realism.png").stat().st_size > 10_000
    assert "all simulated" in capsys.readouterr().out


def write_grey(path, grey):
    """A grey PNG of 8 bits, by the format's own rules."""
    import struct
    import zlib

    def chunk(kind, data):
        return (
            struct.pack(">I", len(data))
            + kind
            + data
            + struct.pack(">I", zlib.crc32(kind + data))
        )

    rows = b"".join(b"\0" + row.tobytes() for row in grey)
    header = struct.pack(">IIBBBBB", grey.shape[1], grey.shape[0], 8, 0, 0, 0, 0)
    path.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


def test_real_pairs_line_up_with_lidar(samples):
    pairs = read_pairs(samples / "coloradar_pairs")
    assert len(pairs) == 7
    numbers = pair_statistics(pairs)
    assert (
        numbers["peaks within 0.5 m of LiDAR (%)"]
        > numbers["peaks within 0.5 m of LiDAR mirrored, by chance (%)"]
    )


def test_the_real_capture_has_its_wall(samples):
    cube, radar = read_capture(samples / "openradar" / "doppler_example_1.npy")
    power = (np.abs(np.fft.fft(cube.mean(2))) ** 2).sum((0, 1))
    assert power[50:].argmax() + 50 == 107
    assert radar.range_resolution_m == pytest.approx(0.04879, abs=1e-5)
