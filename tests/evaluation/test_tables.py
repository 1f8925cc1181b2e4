"""Tables: the paper's layout, the best in bold, a caption that counts empty frames."""

import csv
import re

import numpy as np
import pytest

from jradar.evaluation import (
    COLUMNS,
    markdown,
    markdown_table,
    summarise,
    write_scores,
    write_tables,
)
from jradar.evaluation.tables import csv_table, overview, scenes_table
from tests.evaluation import invented

ROWS = invented.scores(truths=("LiDAR", "re-projected"))
ROWS += [
    invented.row("Hall", "run0", i, "LiDAR", method, chamfer, points=points)
    for i in range(4)
    for method, chamfer, points in (
        ("OS-CFAR", 2.0, 200 * (i > 0)), ("RPDNet", 1.0, 50), ("jradar", 1.0, 900)
    )
]  # fmt: skip
EVERY = {"truth": "LiDAR", "scenes": ("Hallways", "Outdoor", "Hall")}


def cells(line):
    return [cell.strip() for cell in line.strip().strip("|").split(" | ")]


def test_rows_are_methods_and_columns_scenes():
    table = scenes_table(summarise(ROWS), **EVERY).splitlines()
    assert cells(table[0]) == ["method", "Hallways", "Outdoor", "Hall"]
    assert [cells(line)[0] for line in table[2:5]] == [*invented.METHODS]
    assert len({line.count("|") for line in table[:5]}) == 1
    place = ("Outdoor", "LiDAR", "RPDNet")
    rows = [r for r in ROWS if (r["scene"], r["truth"], r["method"]) == place]
    chamfer = np.mean([row["chamfer"] for row in rows])
    assert cells(table[3])[2].startswith(f"{chamfer:.3f} / ")
    assert "CD (m) / MHD (m) / F 0.2 m (%) against LiDAR." in table[6]


def test_the_best_of_each_scene_is_bold_and_ties_share_it():
    table = scenes_table(summarise(ROWS), **EVERY).splitlines()
    for column in (1, 2):
        assert cells(table[4])[column].count("**") == 6
        assert "**" not in cells(table[2])[column] + cells(table[3])[column]
    assert cells(table[4])[3] == "**1.000** / **0.125** / **16.7**"
    assert cells(table[3])[3] == cells(table[4])[3]


def test_empty_frames_are_counted_in_the_caption():
    table = scenes_table(summarise(ROWS), **EVERY)
    f_score = 100 * 0.75 * 0.2 / 2.2
    assert f"2.000 / 0.250 / {f_score:.1f} †" in table
    assert "† OS-CFAR found nothing in 1 of 4 frames of Hall" in table
    only = scenes_table(summarise(ROWS), truth="LiDAR", scenes=["Outdoor"])
    assert "†" not in only and "Hall" not in only


def test_scenes_and_truths_can_be_chosen():
    summary, scenes = summarise(ROWS), ("Hallways", "Outdoor")
    table = scenes_table(
        summary, truth="re-projected", scenes=scenes, intervals=True
    ).splitlines()
    assert cells(table[0]) == ["method", "Hallways", "Outdoor"]
    assert "F 0.2 m" in table[-1] and "re-projected" in table[-1]
    assert re.fullmatch(
        r"(\d+\.\d+ \(\d+\.\d+–\d+\.\d+\)( / )?){3}", cells(table[2])[1]
    )


def test_a_method_that_was_not_run_on_a_scene():
    rows = [r for r in ROWS if (r["scene"], r["method"]) != ("Hall", "RPDNet")]
    table = scenes_table(summarise(rows), **EVERY).splitlines()
    assert cells(table[3])[3] == "–"


def test_listing_of_every_score():
    summary = summarise(ROWS)
    table = markdown(summary, intervals=True).splitlines()
    assert cells(table[0])[:4] == ["truth", "scene", "method", "CD (m)"]
    assert len(table) == 2 + len(summary) == 2 + 6 + 6 + 3
    assert "ms" not in table[0] and "ms" in markdown(summary, columns=COLUMNS)
    assert cells(table[-3])[-2:] == ["4", "1"]
    only = [row for row in summary if row["scene"] == "Hall"]
    assert cells(markdown(only).splitlines()[0])[0] == "method"


def test_rows_are_grouped_by_any_names():
    summary = summarise(ROWS, by=("scene", "method"), columns=("chamfer",))
    table = markdown(summary, columns=("chamfer",)).splitlines()
    assert cells(table[0]) == ["scene", "method", "CD (m)", "frames", "empty"]
    line = markdown_table(["a|b", 1], [["x", 0.5]]).splitlines()
    assert line == [r"| a\|b | 1 |", "|---|---|", "| x | 0.5 |"]


def test_csv_holds_every_number():
    summary = summarise(ROWS)
    lines = [*csv.DictReader(csv_table(summary).splitlines())]
    assert len(lines) == len(summary)
    for line, row in zip(lines, summary, strict=True):
        assert (line["scene"], line["method"]) == (row["scene"], row["method"])
        low = float(line["chamfer low"] or "nan")
        assert low == pytest.approx(row["chamfer"].low, rel=1e-5, nan_ok=True)
        assert int(line["empty"]) == row["empty"]


def test_latex_is_escaped_and_balanced():
    scene = "Ec_Hallways & 100%"
    summary = summarise([row | {"scene": scene} for row in ROWS[:80]])
    table = scenes_table(
        summary, truth="LiDAR", scenes=(scene,), style="latex", intervals=True
    )
    assert r"Ec\_Hallways \& 100\%" in table and r"F 0.2 m (\%)" in table
    assert r"\textbf{" in table and table.count(r"\\") == 4
    assert re.search(r"\d+\.\d+ \(\d+\.\d+--\d+\.\d+\)", table)
    assert table.count("{") == table.count("}")
    assert table.index(r"\toprule") < table.index(r"\midrule")


def test_tables_are_made_again_from_the_file_alone(tmp_path):
    path = tmp_path / "frames.jsonl"
    write_scores(path, ROWS)
    first = {p.name: p.read_bytes() for p in write_tables(path)}
    assert {*first} == {"table.md", "table.tex", "table.csv"}
    for name in first:
        (tmp_path / name).unlink()
    faster = [row | {"milliseconds": 0.1} for row in ROWS]  # times are no result
    write_scores(path, faster)
    assert {p.name: p.read_bytes() for p in write_tables(path)} == first
    for scenes in (["Hallways", "Outdoor"], ["Hall"]):  # the paper's Tables I and II
        table = scenes_table(summarise(ROWS), truth="LiDAR", scenes=scenes)
        assert table in first["table.md"].decode()
    assert "re-projected" in first["table.tex"].decode()


def test_overview_has_every_method_over_all_scenes_and_its_time():
    text = overview(ROWS)
    first, one, two = text.split("| method ")[1:]
    assert "| ms |" in first and "Hallways | Outdoor |" in one and "Hall |" in two
    against = ROWS[0]["truth"]
    ours = [r for r in ROWS if r["method"] == "jradar" and r["truth"] == against]
    cells = next(line for line in first.splitlines() if "jradar" in line).split(" | ")
    mean = sum(row["chamfer"] for row in ours) / len(ours)
    assert float(cells[1]) == pytest.approx(mean, abs=6e-4)
    assert int(cells[-2]) == len(ours) and "re-projected" not in text
