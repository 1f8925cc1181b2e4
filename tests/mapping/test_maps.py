"""ColoRadar's patches, images of them, and the model of maps."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar import mapping, training
from jradar.errors import ModelError, UsageError
from jradar.mapping import predict
from jradar.mapping.predict import SPREAD
from jradar.mapping.recording import occupancy_grid
from jradar.mapping.tiles import symmetric
from jradar.metrics import f_score
from jradar.model import draw, load_model
from jradar.model.grids.base import Question
from jradar.model.grids.columns import (
    NOISE,
    condition_columns,
    outline,
    target_columns,
)
from jradar.model.grids.columns.images import Circle
from jradar.outputs.clouds import write_pcd
from jradar.training import LOSSES
from jradar.types import PointCloud
from tests.models import tiny_map_model, tiny_model

GRID = mapping.column_grid(tiny_map_model())


@pytest.fixture(scope="module")
def model():
    return tiny_map_model()


def room(rng, *, half=12, patches=2):
    """A run: walls of a square room, and radar voxels near them."""
    side = np.arange(-half, half)
    wall = np.stack(np.meshgrid(side, [half], np.arange(-4, 8)), -1).reshape(-1, 3)
    turns = wall, wall[:, [1, 0, 2]], wall * (1, -1, 1), wall[:, [1, 0, 2]] * (-1, 1, 1)
    lidar = np.unique(np.concatenate(turns), axis=0).astype(np.int16)
    radar = lidar[rng.choice(len(lidar), 200, replace=False)]
    radar = np.unique(radar + rng.integers(-1, 2, radar.shape), axis=0).astype(np.int16)
    ones = (np.ones((patches, len(voxels)), bool) for voxels in (radar, lidar))
    whole = [np.packbits(seen, axis=1) for seen in ones]
    return mapping.MapRun("room_run1", radar, lidar, *whole)


def poses_at(*places):
    """Poses without rotation."""
    poses = np.tile(np.eye(4), (len(places), 1, 1))
    poses[:, :3, 3] = places
    return poses


def save_run(path, run):
    maps = {"radar_map": run.radar, "lidar_map": run.lidar, "patch": np.arange(2)}
    seen = {"radar_in_patch": run.radar_in_patch, "lidar_in_patch": run.lidar_in_patch}
    np.savez(path, **maps, **seen)


def test_columns_hold_each_voxel_at_its_place():
    voxels = np.array([[10, 20, 5], [11, 20, 99], [9, 20, 5], [10, 20, -50]])
    circle = Circle(12, 22, 2.0)
    image = condition_columns(voxels, (10, 20, 0), (8, 8), GRID, observed=circle)
    assert image.shape == (8, 8, 16 + 3)
    heights = image[..., :16]
    # Voxels beyond the image are left out to the sides, and clipped in height.
    assert np.argwhere(heights).tolist() == [[0, 0, 0], [0, 0, 5], [1, 0, 15]]
    assert image[2, 2, -3] == 1
    assert image[7, 7, -3] == 0
    assert image[0, 0, -2] == pytest.approx(8 * 0.15 / 4)
    assert (image[..., -1] == 1).all()
    unknown = {"observed": None, "height_known": False}
    hidden = condition_columns(voxels, (10, 20, 0), (8, 8), GRID, **unknown)
    assert (hidden[..., -3] == 1).all()
    assert not hidden[..., -2:].any()


def test_targets_hold_the_lidar_voxels_of_the_image():
    lidar = np.array([[2, 2, 1], [6, 2, 1], [9, 2, 1], [2, 2, 40]])
    image = target_columns(lidar, (0, 0, 0), (8, 8), GRID)
    assert np.argwhere(image).tolist() == [[2, 2, 1], [6, 2, 1]]


def test_quarter_turns_and_mirrors_are_eight_different_images():
    image = np.arange(16.0).reshape(4, 4, 1)
    found = [symmetric(training.Batch(image, image), k) for k in range(8)]
    assert len({batch.condition.tobytes() for batch in found}) == 8
    assert all((a == b).all() for a, b in found)
    assert (found[0].condition == image).all()


def test_tiles_show_the_patch_and_repeat_with_their_seed():
    run = room(np.random.default_rng(0))
    tiles = mapping.Tiles([run], GRID, mapping.TileSpec(whole=0.5))
    first, again = (tiles.draw(tiles[1], np.random.default_rng(3)) for _ in range(2))
    assert all((a == b).all() for a, b in zip(first, again, strict=True))
    assert first.condition.shape == (32, 32, 19)
    assert first.target.sum() > 50
    assert len(tiles) == 2


def test_the_loss_is_least_where_the_odds_are_right():
    target = np.zeros((1, 4, 4, 16), np.float32)
    target[0, :2, :, 3] = 1
    loss, noise = LOSSES["columns"]["occupancy"], NOISE["occupancy"]

    def at(odds):
        known = jnp.asarray(odds)
        return float(loss(None, lambda x, sigma: known, target, noise=noise))

    right = np.where(target > 0, 20.0, -20.0)
    assert at(right) < 0.01 < at(np.zeros(target.shape))
    assert at(-right) > at(np.zeros(target.shape))


def test_a_draw_from_the_truth_scores_the_truth():
    """A denoiser that knows the answer draws it, whatever the noise."""
    clean = np.random.default_rng(0).random((4, 4, 16)) < 0.1
    known = jnp.asarray(2 * (clean - 0.03))[None]
    condition, key = jnp.zeros((4, 4, 16 + 3)), jax.random.key(0)
    noise = NOISE["diffusion"]
    asked = Question(key, lambda seen: lambda x, sigma: known, condition, noise, 1.0)
    for draws in (1, 2):
        found = GRID.answer("diffusion", asked, draws=draws)
        np.testing.assert_allclose(found, clean, atol=1e-3)


def test_a_model_of_draws_repeats_with_its_key_and_one_of_one_pass_takes_none():
    condition = jax.random.uniform(jax.random.key(1), GRID.condition_shape)
    model, quick = tiny_map_model("diffusion"), {"draws": 2, "steps": 1}
    first, again, other = (
        draw(jax.random.key(k), condition, model, **quick) for k in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert first.shape == GRID.image_shape and np.abs(first - other).max() > 1e-3
    assert 0 <= first.min() and first.max() <= 1
    with pytest.raises(UsageError, match="steps: a model of one pass draws no samples"):
        draw(jax.random.key(0), condition, tiny_map_model(), steps=3)
    with pytest.raises(ValueError, match=r"\[x, y, channel\] with 19 channels"):
        draw(jax.random.key(0), condition[..., 1:], tiny_map_model())


@pytest.mark.slow
@pytest.mark.parametrize("name", NOISE)
def test_a_few_steps_of_training_learn_a_room(model, name):
    optax = pytest.importorskip("optax")
    rooms = [room(np.random.default_rng(0))]
    tiles = mapping.Tiles(rooms, GRID, mapping.TileSpec(whole=0.0))
    optimizer = optax.adam(1e-2)
    state = training.TrainState(
        np.zeros((), np.int32), model.params, model.params, optimizer.init(model.params)
    )
    network, loss = model.spec.network, LOSSES["columns"][name]
    step = training.make_train_step(network, optimizer, NOISE[name], loss=loss)
    rng, losses = np.random.default_rng(1), []
    items = [tiles.draw(tiles[0], rng) for _ in range(2)]
    batch = training.Batch(*map(np.stack, zip(*items, strict=True)))
    for _ in range(20):
        state, metrics = step(state, jax.random.key(0), batch)
        losses.append(float(metrics["loss"]))
    assert losses[-1] < 0.8 * losses[0]


def test_the_best_count_has_the_largest_expected_f_score():
    probability = np.array([0.9, 0.8, 0.4, 0.1, 0.05])
    counts = np.arange(1, 6)
    expected = 2 * probability.cumsum() / (counts + 2)
    assert mapping.best_count(probability[:0], 2) == 0
    assert mapping.best_count(probability, 2) == counts[expected.argmax()] == 2


def test_a_map_has_as_many_voxels_as_are_expected():
    found = mapping.Occupied(np.arange(15).reshape(5, 3), np.full(5, 0.4))
    first = mapping.expected(found)
    assert first.voxels.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert first.probability.tolist() == [0.4, 0.4]


def test_scores_are_those_of_the_published_protocol():
    truth = np.array([[0.0, 0, 0], [10.0, 0, 0], [0, 0, 0.15]])
    away = np.linalg.norm(truth - truth.mean(0), axis=1).max()
    assert mapping.published_distance(truth) == pytest.approx(0.02 * away)
    assert f_score(truth, truth, within_m=0.1) == 1
    # One of two points is right, one of three is found.
    moved = truth[:2] + [[0, 0, 0], [0, 5, 0]]
    assert f_score(moved, truth, within_m=0.1) == pytest.approx(0.4)
    assert f_score(np.zeros((0, 3)), truth, within_m=0.1) == 0


def test_runs_are_read_from_pcd_files_as_from_packed_ones(tmp_path):
    run = room(np.random.default_rng(0))
    for kind, voxels in (("input", run.radar), ("gt", run.lidar)):
        (tmp_path / "loose" / kind).mkdir(parents=True)
        for patch in range(2):
            xyz = ((voxels + 0.5) * 0.15).astype(np.float32)
            path = tmp_path / "loose" / kind / f"room_run1_{patch}.pcd"
            write_pcd(path, PointCloud.from_xyz(xyz))
    (tmp_path / "packed").mkdir()
    save_run(tmp_path / "packed" / "room_run1.npz", run)
    for folder in ("loose", "packed"):
        (found,) = mapping.open_runs(tmp_path / folder)
        assert found.name == "room_run1"
        assert found.environment == "room"
        for patch, voxels in zip(found.patch(1), run[1:3], strict=True):
            assert {tuple(v) for v in patch} == {tuple(v) for v in voxels}
    (tmp_path / "loose" / "gt" / "room_run1_1.pcd").unlink()
    with pytest.raises(ValueError, match="incomplete download"):
        mapping.open_runs(tmp_path / "loose")


def test_folders_and_files_of_another_kind_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such folder"):
        mapping.open_runs(tmp_path / "none")
    with pytest.raises(ValueError, match="neither <run>.npz nor input/"):
        mapping.open_runs(tmp_path)
    for kind in ("input", "gt"):
        (tmp_path / kind).mkdir()
        cloud = PointCloud.from_xyz(np.array([[0.1, 0.0, 0.3]], np.float32))
        write_pcd(tmp_path / kind / "a_run1_0.pcd", cloud)
    with pytest.raises(ValueError, match="not centres of voxels of 0.15 m"):
        mapping.open_runs(tmp_path)
    (tmp_path / "a_run1.npz").write_bytes(b"PK\x03\x04 truncated")
    with pytest.raises(ValueError, match="a packed run with radar_map"):
        mapping.open_runs(tmp_path)


def test_real_runs_of_coloradar(samples):
    runs = mapping.open_runs(samples / "coloradar_maps")
    assert len(runs) == 38
    assert sum(len(run.radar_in_patch) for run in runs) == 8563
    assert {run.environment for run in runs} == {
        *("arpg_lab", "aspen", "ec_hallways", "edgar_army", "edgar_classroom"),
        "outdoors",
    }
    for run in runs[::8]:
        radar, lidar = run.patch(3)
        assert (len(radar), len(lidar)) == (2048, 8192)
        metres = GRID.metres(lidar)
        assert 0.06 < mapping.published_distance(metres) < 0.2
        # The radar's voxels are seldom the LiDAR's.
        exact = mapping.published_distance(metres)
        score = f_score(GRID.metres(radar), metres, within_m=exact)
        assert 0.01 < score < 0.25


@pytest.mark.slow
def test_the_shipped_model_completes_a_run_that_it_has_not_seen(samples):
    model = load_model("jradar-maps")
    runs = {run.name: run for run in mapping.open_runs(samples / "coloradar_maps")}
    run, metres = runs["edgar_army_run5"], mapping.column_grid(model).metres
    for number in (0, 100):
        radar, lidar = run.patch(number)
        found = mapping.enhance_patch(radar, model)
        count = mapping.best_count(found.probability, len(lidar))
        truth = metres(lidar)
        exact = mapping.published_distance(truth)
        before = f_score(metres(radar), truth, within_m=exact)
        found_m = metres(found.voxels[:count])
        assert f_score(found_m, truth, within_m=exact) > 3 * before > 0


def test_patches_and_maps_are_completed_where_they_are(model):
    radar = room(np.random.default_rng(0)).radar.astype(int)
    shift = np.array([1000, -2000, 0])
    for enhance in (mapping.enhance_patch, mapping.enhance_map):
        here, there = enhance(radar, model), enhance(radar + shift, model)
        assert len(here.voxels) > 100
        assert (np.diff(here.probability) <= 0).all()
        shown = {tuple(v) for v in here.voxels.tolist()}
        moved = {tuple(v) for v in (there.voxels - shift).tolist()}
        assert len(shown & moved) > 0.99 * len(shown)
    with pytest.raises(ValueError, match="no voxels"):
        mapping.enhance_map(radar[:0], model)
    with pytest.raises(ModelError, match="this model sees single frames, .* maps"):
        mapping.enhance_map(radar, tiny_model())
    far = np.concatenate([radar, radar + (10**6, 10**6, 0)])
    with pytest.raises(ValueError, match="do its poses jump"):
        mapping.enhance_map(far, model)


def test_a_plan_is_occupied_free_or_unknown_as_map_server_reads_it(tmp_path):
    poses = poses_at([0.05, 0.05, 0.05], [1.0, 0.05, 0.05])
    voxels = np.array([[8, 0, 0], [8, 1, 1], [3, 5, 30]])
    wall = mapping.Occupied(voxels, np.full(3, 0.9))
    free = np.array([[x, 0, 0] for x in range(8)])
    found = mapping.RecordingMap(GRID, wall, wall, free, poses, ())
    grid, corner = occupancy_grid(found)
    # Rows from the far end of y; the voxel high above is not in the way.
    assert grid.shape == (2, 9)
    assert grid[1].tolist() == [254] * 8 + [0]
    assert grid[0].tolist() == [205] * 8 + [0]
    assert corner.tolist() == [0, 0]
    for name, write in mapping.map_files(found).items():
        write(tmp_path / name)
    assert (tmp_path / "grid.pgm").read_bytes().startswith(b"P5\n9 2\n255\n")
    assert "resolution: 0.15" in (tmp_path / "grid.yaml").read_text()
    assert {path.name for path in tmp_path.iterdir()} == {
        *mapping.FILES[:-1]  # no trajectory without times
    }


def test_a_plan_is_of_heights_relative_to_the_path_where_it_climbs():
    poses = poses_at([0.05, 0.05, 0.0], [3.0, 0.05, 6.0])
    voxels = np.array([[1, 1, 40], [20, 1, 40]])  # at 6 m, above and at the radar
    wall, free = mapping.Occupied(voxels, np.full(2, 0.9)), np.zeros((0, 3), int)
    grid, corner = occupancy_grid(
        mapping.RecordingMap(GRID, wall, wall, free, poses, ())
    )
    row, column = np.argwhere(grid == 0).T
    assert (column * 0.15 + corner[0]).tolist() == [20 * 0.15]


def test_the_outline_is_the_smallest_circle():
    angle = np.linspace(0, 2 * np.pi, 100)
    rim = np.stack([7 + 20 * np.cos(angle), 20 * np.sin(angle), 0 * angle], -1)
    inside = rim * (0.5, 0.5, 0) + (3.5, 0, 2)
    found = outline(np.concatenate([rim, inside]))
    np.testing.assert_allclose(found, (7, 0, 20), atol=0.1)
    # More than half of the circle is enough, though its extent has another middle.
    half = outline(rim[rim[:, 0] >= 5])
    np.testing.assert_allclose(half, (7, 0, 20), atol=0.1)
    for few in ([[1, 2, 0]], [[0, 0, 0], [4, 0, 9]], [[0, 0, 0], [1, 0, 0], [4, 0, 0]]):
        x, y, radius = outline(np.array(few))
        away = np.linalg.norm(np.array(few)[:, :2] - (x, y), axis=1)
        assert radius == pytest.approx(away.max())
        assert radius == pytest.approx(np.ptp(np.array(few)[:, 0]) / 2)
    rng = np.random.default_rng(0)
    scattered = rng.integers(-30, 30, (500, 3))
    found = outline(scattered)
    for step in rng.normal(0, 1, (50, 2)):
        moved = np.linalg.norm(scattered[:, :2] - found[:2] - step, axis=1).max()
        assert moved > found.radius - 0.1


def test_the_nearest_voxels_of_a_patch_are_as_many_as_expected():
    x = np.arange(1, 2001)
    voxels = np.stack([x, 0 * x, 0 * x], -1)
    found = mapping.Occupied(voxels, np.full(2000, 0.5))
    near = mapping.nearest(found, 0.0, 0.0, 200)
    # 200 of the first 400 are expected.
    at = dict(zip(near.voxels[:, 0].tolist(), near.probability.tolist(), strict=True))
    assert at[1] == pytest.approx(0.5)
    # Nearer are 199.5 and half of the voxel's own ring; see `mapping.predict.SPREAD`.
    assert at[400] == pytest.approx(0.5 / (1 + (199.75 / 200) ** (1 / SPREAD)))
    assert at[2000] < 0.01
    assert (np.diff(near.probability) <= 0).all()
    assert near.probability.sum() == pytest.approx(200, rel=0.15)


def test_nearest_voxels_are_sorted_and_keep_their_order_where_they_are_equal():
    rng = np.random.default_rng(0)
    values = rng.choice(np.r_[0, 1, rng.random(50), 1e-30], 3000).astype(np.float32)
    voxels = np.stack([0 * values, 0 * values, np.arange(3000)], -1).astype(int)
    near = mapping.nearest(mapping.Occupied(voxels, values), 0.0, 0.0, 10**9)
    order = np.argsort(-values, kind="stable")
    np.testing.assert_array_equal(near.voxels, voxels[order])
    np.testing.assert_array_equal(near.probability, values[order])


def test_where_tiles_overlap_the_probability_is_their_mean(model, monkeypatch):
    shape = lambda condition: (*condition.shape[:2], GRID.heights)  # noqa: E731
    monkeypatch.setattr(
        predict, "_probability", lambda c, _: np.full(shape(c), 0.4, np.float32)
    )
    radar = np.array([[0, 0, 0], [predict.STRIDE + 3, 5, 0]])
    found = mapping.enhance_map(radar, model)
    np.testing.assert_allclose(found.probability, 0.4, rtol=1e-5)


def test_a_map_settled_row_by_row_equals_the_one_made_at_once(model, monkeypatch):
    rng = np.random.default_rng(3)
    radar = np.unique(rng.integers((0, 0, 0), (250, 150, 6), (400, 3)), axis=0)
    found = mapping.enhance_map(radar, model)
    settle, early = predict._Sums.settle, []

    def at_the_end(sums, x=None):
        early.append(x)
        if x is None:
            settle(sums)

    monkeypatch.setattr(predict._Sums, "settle", at_the_end)
    at_once = mapping.enhance_map(radar, model)
    assert len(early) == 5 and len(found.voxels) > 1000
    np.testing.assert_array_equal(found.voxels, at_once.voxels)
    np.testing.assert_array_equal(found.probability, at_once.probability)
