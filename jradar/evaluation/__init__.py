"""Scores of methods against LiDAR: tables, intervals, comparisons, reports.

score_frames, Method, Truth      scores of each method on each frame of a sequence
score_points                     scores of one cloud
write_scores, read_scores        the file of scores, the source of all that follows
mean_interval, Estimate          means of correlated frames, with intervals
compare_paired, compare_methods, Comparison
                                 paired tests of two methods
near_truth, reliability, calibration_error, precision_over_coverage
                                 whether the confidence of points holds
summarise, markdown, scenes_table, overview, csv_table, write_tables
                                 tables of all scores, the paper's tables, CSV
markdown_table                   any table
read_runs, comparison_table      several runs side by side
runs_table, frames_csv           one run minus another, frame by frame
save_clouds, load_clouds         clouds of a few frames
build_report, open_report        tables, curves and clouds of a run in one HTML file
"""

from jradar.evaluation.methods import (
    Method as Method,
    Truth as Truth,
    score_frames as score_frames,
    score_points as score_points,
)
from jradar.evaluation.reliability import (
    Coverage as Coverage,
    Reliability as Reliability,
    calibration_error as calibration_error,
    near_truth as near_truth,
    precision_over_coverage as precision_over_coverage,
    reliability as reliability,
)
from jradar.evaluation.report import (
    build_report as build_report,
    load_clouds as load_clouds,
    open_report as open_report,
    save_clouds as save_clouds,
)
from jradar.evaluation.runs import (
    comparison_table as comparison_table,
    frames_csv as frames_csv,
    read_runs as read_runs,
    runs_table as runs_table,
)
from jradar.evaluation.scores import (
    read_scores as read_scores,
    write_scores as write_scores,
)
from jradar.evaluation.statistics import (
    Comparison as Comparison,
    Estimate as Estimate,
    compare_methods as compare_methods,
    compare_paired as compare_paired,
    mean_interval as mean_interval,
)
from jradar.evaluation.tables import (
    csv_table as csv_table,
    markdown as markdown,
    markdown_table as markdown_table,
    overview as overview,
    scenes_table as scenes_table,
    summarise as summarise,
    write_tables as write_tables,
)
