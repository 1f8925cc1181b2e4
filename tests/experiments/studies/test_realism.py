"""Simulated beside real frames: the recipe, the numbers, what is missing."""

import numpy as np
import pytest
from PIL import Image

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
    read_pairs,
)
from experiments.studies.realism_captures import (
    OPENRADAR_CHIRPS,
    compared,
    comparison_table,
    many_units,
    one_unit,
    phase_drift,
    read_awr1843,
    read_openradar,
    real_captures,
    simulated_captures,
    standing_statistics,
    width,
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


@pytest.mark.slow
def test_the_command_compares_stand_ins(tmp_path, capsys):
    random = np.random.default_rng(0)
    (tmp_path / "openradar").mkdir()
    words = random.integers(-99, 99, (2, 128, 8, 128)).astype("i2").view("u2")
    stored = words[0].astype(float) + 1j * words[1]
    np.save(tmp_path / "openradar/doppler_example_1.npy", stored)
    folders = ("range_azimuth_heatmap", "lidar_pcl_bev_polar_img")
    for folder, shape in zip(folders, ((128, 64), (160, 100)), strict=True):
        (tmp_path / "coloradar_pairs" / folder).mkdir(parents=True)
        grey = random.integers(0, 255, shape).astype(np.uint8)
        Image.fromarray(grey).save(tmp_path / "coloradar_pairs" / folder / "0.png")
    out = tmp_path / "out"
    options = ["--scenes", "corridor", "--units", "1"]
    assert main([str(tmp_path), "-o", str(out), *options]) == 1  # noise is no room
    printed = capsys.readouterr().out
    assert (out / "realism.md").read_text() in printed
    assert "all simulated" in printed
    assert "outside the range of 1 simulated units: OpenRadar: static" in printed


def test_real_pairs_line_up_with_lidar(samples):
    pairs = read_pairs(samples / "coloradar_pairs")
    assert len(pairs) == 7
    numbers = pair_statistics(pairs)
    assert (
        numbers["peaks within 0.5 m of LiDAR (%)"]
        > numbers["peaks within 0.5 m of LiDAR mirrored, by chance (%)"]
    )


def test_real_captures_are_read_as_the_index_says(samples):
    found = real_captures(samples)
    assert [*found] == ["OpenRadar", "AWR1642", "AWR1843"]
    for capture in found.values():
        assert capture.cube.shape == capture.radar.cube_shape

    def profile(name):
        return (np.abs(np.fft.fft(found[name].cube.mean(2))) ** 2).sum((0, 1))

    assert {*np.argsort(profile("AWR1642")[4:120])[-2:] + 4} == {11, 19}
    assert profile("AWR1843")[4:200].argmax() + 4 == 38
    assert profile("OpenRadar")[50:].argmax() + 50 == 107  # its wall
    resolution = found["OpenRadar"].radar.range_resolution_m
    assert resolution == pytest.approx(0.04879, abs=1e-5)


def test_captures_of_another_shape_are_refused(tmp_path):
    np.save(tmp_path / "other.npy", np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"shape \(2, 3\), expected complex"):
        read_openradar(tmp_path / "other.npy")
    path = tmp_path / "cut.bin"
    path.write_bytes(bytes(1000))
    with pytest.raises(ValueError, match="holds 500 words, expected those of one"):
        read_awr1843(path)


def tone(*, drift_rad=0.0, level_db=40.0, at=30):
    """A cube of one standing echo over white noise, `level_db` above it in the map."""
    random = np.random.default_rng(0)
    shape = (2, 4, 128, 128)
    noise = random.standard_normal((*shape, 2)) @ [1, 1j]
    turn = drift_rad * random.standard_normal(128)[:, None]
    # Two Hann windows gather 128 x 128 / 1.5^2 times the power of white noise.
    amplitude = 10 ** (level_db / 20) * np.sqrt(2) * 1.5 / 128
    cycles = np.arange(128) * at / 128
    return amplitude * np.exp(1j * (2 * np.pi * cycles + turn)) + noise


def test_numbers_of_one_echo_in_noise():
    found = standing_statistics(tone(level_db=60.0))
    # The Hann window is at 0, -6.02 and minus infinity dB, 0, 1 and 2 bins away.
    assert found["width of the strongest static echoes at -6 dB (bins)"] <= 3
    assert np.isnan(
        standing_statistics(tone(level_db=0))["drift of their phase (mrad)"]
    )
    assert found["static echoes, weakest tenth of the ranges (dB)"] == pytest.approx(
        0, abs=2.5
    )
    assert found["ranges with static echoes over 20 dB (%)"] == pytest.approx(
        100 * 3 / 113, abs=0.1
    )
    assert abs(found["noise at the largest range, relative to the middle (dB)"]) < 0.5
    static = standing_statistics(tone(level_db=20.0))
    assert (
        static["power outside zero velocity (%)"]
        > found["power outside zero velocity (%)"]
    )


def test_width_and_drift_of_known_echoes():
    level = np.full(20, -30.0)
    level[8:12] = [-3.0, 0.0, -5.0, -7.0]
    assert width(level, 9) == 3
    assert width(np.zeros(5), 2) == 5
    random = np.random.default_rng(0)
    walk = 0.04 * random.standard_normal(4096)
    echo = np.exp(1j * walk)[None] * np.exp(1j * np.arange(3))[:, None]
    assert phase_drift(echo) == pytest.approx(40, rel=0.05)


@pytest.mark.slow
def test_units_of_the_second_set_echo_at_every_range():
    radar = RadarSpec.awr1642(**OPENRADAR_CHIRPS)
    sets = {
        "one": [*simulated_captures(radar, one_unit(3))],
        "many": [*simulated_captures(radar, many_units(3))],
    }
    median = {
        name: np.median(
            [
                standing_statistics(c.cube)["static echoes, median over range (dB)"]
                for c in captures
            ]
        )
        for name, captures in sets.items()
    }
    assert median["many"] > median["one"] + 3
    one = sets["many"][0]
    rows = compared({"one": one}, {"one": (sets["one"], sets["many"])})
    assert all(row.inside for row in rows)  # it is one of them
    assert "| yes |" in comparison_table(rows)
