"""Fine-tuning on a small room: what is kept, refused, and resumed."""

import contextlib
import dataclasses
import json
import shutil

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jradar.data import PrepareSpec, Records, prepare
from jradar.errors import UsageError
from jradar.lidar import LidarSpec
from jradar.model import enhance_points, load_model, save_model
from jradar.range_image import ImageSpec
from jradar.training import FinetuneSpec, choosing, finetune, finetuning, replay
from jradar.training.choosing import SCORE, Scores, kept_change
from jradar.training.replay import Old, halves
from jradar.types import PointCloud
from tests.models import GRID, one_pass_model, tiny_model
from tests.recordings.points.astyx_writer import write_astyx
from tests.recordings.small_sequence import write_sequence, write_splits

VIEW = {k: getattr(GRID.view, k) for k in ("azimuth", "elevation", "max_range_m")}
QUICK = FinetuneSpec(steps=8, batch_size=2, learning_rate=1e-2, replay=0.5)


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    source, folder = (tmp_path_factory.mktemp(name) for name in ("source", "records"))
    for seed, (name, frames) in enumerate({"a": 4, "b": 2}.items()):
        write_sequence(source, name, frames=frames, seed=seed)
    write_splits(source, {"a": "train", "b": "validation"})
    prepare(source, folder, PrepareSpec(lidar=LidarSpec(**VIEW)), workers=1)
    return folder


@pytest.fixture(scope="module")
def start(tmp_path_factory):
    folder = tmp_path_factory.mktemp("model") / "start"
    save_model(folder, tiny_model(method="regression"), dtype=np.float32)
    return folder


@pytest.mark.slow
def test_own_frames_are_learnt_and_the_best_stay(records, start, tmp_path, monkeypatch):
    found = finetune(
        records, tmp_path / "mine", model=start, spec=QUICK, replay=records
    )
    before, after = (s.own["f_score_0.2"] for s in (found.before, found.after))
    assert after >= before
    counts = {"training": 4, "validation": 2, "old": 4, "old, held out": 4}
    assert found.frames == counts
    lines = (tmp_path / "mine" / "metrics.jsonl").read_text().splitlines()
    scores = [json.loads(line).get("validation/f_score_0.2", -1) for line in lines]
    assert len(scores) == 8
    if found.share == 1:
        assert after == pytest.approx(max(*scores, before))
    saved = load_model(tmp_path / "mine")
    assert saved.spec == dataclasses.replace(found.model.spec)
    if found.share:
        assert "fine-tuned on 4 frames" in saved.card.purpose
        assert Records(records).radar in saved.card.radars
    assert (tmp_path / "mine" / "learning.png").stat().st_size > 1000
    # Again: nothing is trained, and the same model comes out.
    again = finetune(
        records, tmp_path / "mine", model=start, spec=QUICK, replay=records
    )
    jax.tree.map(np.testing.assert_array_equal, again.model.params, found.model.params)
    # A run that was killed ends with the same model. Confidence is fitted to
    # validation and old frames.
    fitted = []

    def with_confidence(key, model, *sets):
        fitted.append([len(frames) for frames in sets])
        return model

    monkeypatch.setattr(finetuning, "with_confidence", with_confidence)
    judged, judge = [], choosing.frame_scores

    def killed(model, records, **options):
        judged.append(model)
        if len(judged) == 5:
            raise KeyboardInterrupt
        return judge(model, records, **options)

    for module in (choosing, finetuning):
        monkeypatch.setattr(module, "frame_scores", killed)
    for _ in range(2):
        with contextlib.suppress(KeyboardInterrupt):
            options = {"spec": QUICK, "replay": records}
            resumed = finetune(records, tmp_path / "killed", model=start, **options)
    assert len(judged) > 5 and fitted == [[2, 4]]
    assert resumed.before == found.before
    assert resumed.best_step == found.best_step
    both = resumed.model.params, found.model.params
    jax.tree.map(np.testing.assert_array_equal, *both)
    with pytest.raises(UsageError, match="holds a run with learning_rate = 0.01"):
        other = dataclasses.replace(QUICK, learning_rate=1e-4)
        finetune(records, tmp_path / "mine", model=start, spec=other, replay=records)
    with pytest.raises(UsageError, match="holds a run with replay_records = "):
        finetune(records, tmp_path / "mine", model=start, spec=QUICK)


@pytest.mark.slow
def test_a_radars_points_are_learnt_next_to_old_samples(records, start, tmp_path):
    walks = [
        write_astyx(tmp_path / f"{name}.npz", [("wall", "pillar")] * 2, seed=seed)
        for seed, name in enumerate("ab")
    ]
    spec = PrepareSpec(lidar=LidarSpec(**VIEW))
    splits = {"b": "validation"}
    prepare(walks, tmp_path / "points", spec, workers=1, splits=splits)
    options = {"model": start, "spec": QUICK, "replay": records}
    found = finetune(tmp_path / "points", tmp_path / "mine", **options)
    counts = {"training": 2, "validation": 2, "old": 4, "old, held out": 4}
    assert found.frames == counts and found.after.own[SCORE] >= found.before.own[SCORE]
    assert found.best_step and found.share  # what it starts from is random
    saved = load_model(tmp_path / "mine")
    assert "fine-tuned on 2 frames" in saved.card.purpose
    assert saved.card.radars == load_model(start).card.radars
    assert saved.card.sent_points and not load_model(start).card.sent_points


def test_in_a_view_five_times_as_large_a_model_draws_what_is_five_times_as_far(
    tmp_path,
):
    wide = ImageSpec(1, 1, VIEW["azimuth"], VIEW["elevation"], 5 * VIEW["max_range_m"])
    lidar = LidarSpec(wide.azimuth, wide.elevation, max_range_m=wide.max_range_m)
    walk = write_astyx(tmp_path / "walk.npz", [("wall", "pillar")])
    prepare(walk, tmp_path / "wide", PrepareSpec(lidar=lidar), workers=1)
    model = one_pass_model()
    grown = finetuning.in_view_of(model, Records(tmp_path / "wide"))
    assert grown.spec.frame_grid.view == dataclasses.replace(GRID.view, max_range_m=60)
    xyz = np.random.default_rng(0).uniform((1, -2, -1), (8, 2, 1), (30, 3))
    power = jnp.geomspace(1, 100, 30)
    cloud = PointCloud.from_xyz(xyz)._replace(power=power).padded()
    far = cloud._replace(xyz=5 * cloud.xyz)
    key = jax.random.key(0)
    near, away = enhance_points(key, cloud, model), enhance_points(key, far, grown)
    assert near.valid.sum() > 50
    np.testing.assert_array_equal(near.valid, away.valid)
    np.testing.assert_allclose(away.xyz, 5 * near.xyz, rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(away.confidence, near.confidence, atol=1e-3)


@pytest.mark.slow
def test_in_a_view_of_its_own_a_model_learns_without_old_frames(start, tmp_path):
    lidar = LidarSpec(**VIEW | {"max_range_m": 20.0})
    for seed, name in enumerate("ab"):
        write_astyx(tmp_path / f"{name}.npz", [("wall", "pillar")] * 2, seed=seed)
    walks = [tmp_path / f"{name}.npz" for name in "ab"]
    splits = {"b": "validation"}
    prepare(walks, tmp_path / "far", PrepareSpec(lidar=lidar), workers=1, splits=splits)
    with pytest.raises(UsageError, match="max_range_m.*--own-view"):
        finetune(tmp_path / "far", tmp_path / "mine", model=start, spec=QUICK)
    spec = dataclasses.replace(QUICK, own_view=True)
    with pytest.raises(UsageError, match="replays no old frames"):
        options = {"model": start, "spec": spec, "replay": tmp_path}
        finetune(tmp_path / "far", tmp_path / "mine", **options)
    found = finetune(tmp_path / "far", tmp_path / "mine", model=start, spec=spec)
    assert found.after.own[SCORE] > found.before.own[SCORE] and not found.after.old
    assert found.share == 1 and "old places before" not in found.describe()
    assert load_model(tmp_path / "mine").spec.frame_grid.view.max_range_m == 20
    again = finetune(tmp_path / "far", tmp_path / "mine", model=start, spec=spec)
    assert again.after == found.after


def test_old_frames_are_held_out_by_sequence(tmp_path):
    source, folder = tmp_path / "source", tmp_path / "records"
    frames = {"a": 1, "b": 2, "c": 3, "d": 1}
    for seed, (name, count) in enumerate(frames.items()):
        write_sequence(source, name, frames=count, seed=seed)
    write_splits(source, dict.fromkeys(frames, "train"))
    prepare(source, folder, PrepareSpec(), workers=1)
    found = [
        "".join(frame.sequence for frame in part) for part in halves(Records(folder))
    ]
    assert found == ["accc", "bbd"]


def test_old_places_are_simulated_once_and_said_before(
    records, tmp_path, monkeypatch, caplog
):
    own, made = Records(records, "train"), []

    def prepare_sources(sources, folder, spec, **_):
        made.append([source.kind for source in sources])
        shutil.copytree(records, folder)

    monkeypatch.setattr(replay.data, "prepare_sources", prepare_sources)
    for _ in range(2):
        found = replay.simulate_replay(tmp_path / "replay", own, steps=150)
        assert found == tmp_path / "replay" / "records"
    assert len(made) == 1 and len(set(made[0])) > 10
    (said,) = caplog.messages
    assert f"They are kept in {tmp_path / 'replay'}." in said
    assert "first, 144 frames of old places" in said
    assert "about 3 minutes on two cores, of 8 in all with 150 steps" in said


@pytest.mark.parametrize(
    ("lost", "share"),  # points at 1, then at the middle of what is left
    [
        ((0,), 1.0),
        ((3, 0.5, 0.9, 2), 0.75),
        ((9, 8, 5, 0.9), 0.125),
        ((9, 8, 5, 2), 0.0),
    ],
)
def test_of_the_change_so_much_is_kept_as_old_places_bear(
    lost, share, start, monkeypatch
):
    old = iter([0.6 - points / 100 for points in lost])

    def scores(model, checked, held_out):
        return Scores({SCORE: 0.5}, {SCORE: next(old)})

    monkeypatch.setattr(choosing, "both_scores", scores)
    model = load_model(start)
    tuned = jax.tree.map(lambda value: value + 1.0, model.params)
    before = Scores({SCORE: 0.4}, {SCORE: 0.6})
    old_frames = Old([], [])
    found = kept_change(model, tuned, [], old_frames, before=before, forget=1.0)
    assert found.share == share
    moved = jax.tree.map(lambda a, b: a - b, found.model.params, model.params)
    for leaf in jax.tree.leaves(moved):
        np.testing.assert_allclose(leaf, share, atol=1e-5)


def test_forgetting_is_judged_on_frames_that_are_not_replayed(records, start):
    (frame, *_) = own = Records(records, "validation")
    other = frame._replace(lidar_xyz=frame.lidar_xyz + np.float32(9))
    model, old = load_model(start), Old([other], [frame])
    scores = choosing.both_scores(model, own, old)
    assert scores.old == choosing.frame_scores(model, [frame])
    assert scores.old != choosing.frame_scores(model, [other])


def test_records_without_a_validation_split_say_how_to_get_one(start, tmp_path):
    source, folder = tmp_path / "source", tmp_path / "records"
    source.mkdir()
    write_sequence(source, "walk", frames=2)
    prepare(source, folder, PrepareSpec(lidar=LidarSpec(**VIEW)), workers=1)
    with pytest.raises(UsageError, match=r"no validation frames.*--validation NAME"):
        finetune(folder, tmp_path / "mine", model=start, spec=QUICK)


def test_another_field_of_view_is_refused(records, tmp_path):
    wide = dataclasses.replace(GRID.view, max_range_m=20.0)
    save_model(tmp_path / "wide", tiny_model(fine=wide), dtype=np.float32)
    with pytest.raises(UsageError, match="was prepared for the view"):
        finetune(records, tmp_path / "mine", model=tmp_path / "wide", spec=QUICK)


def test_a_folder_of_something_else_is_kept(records, start, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"holds notes\.txt"):
        finetune(records, tmp_path, model=start, spec=QUICK)
    assert (tmp_path / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize(("frames", "steps"), [(10, 110), (400, 500), (10_000, 3000)])
def test_steps_follow_from_the_number_of_frames(frames, steps):
    assert FinetuneSpec().steps_for(frames) == steps


@pytest.mark.parametrize(
    "values",
    [
        *({"steps": 0}, {"replay": 1.0}, {"learning_rate": 0.0}, {"batch_size": 0}),
        {"forget": -1.0},
    ],
)
def test_values_that_cannot_be_used_are_refused(values):
    with pytest.raises(ValueError, match=f"{next(iter(values))} = "):
        FinetuneSpec(**values)
