"""Scores of methods against LiDAR: tables, intervals, comparisons, reports.

score_frames, Method             scores of each method on each frame of a sequence
score_points, mean_scores        scores of one cloud; their means over several
score_records, score_and_keep, View, Frame, drawn
                                 methods on records: rows, and clouds of some frames
write_results, write_report      all of it, written as the report of a run
detector_methods, choose_rates   CFAR detectors, and `splat`, with the best rates
with_confidence                  a model whose confidence holds on given records
fitted_confidence, fitted_table, Judged, Around
                                 the table of points whose truth is known
write_scores, read_scores        the file of scores, the source of all that follows
mean_interval                    mean of correlated frames, with its interval
score_rings, ring_edges          scores by distance from the radar
near_truth, reliability, reliability_error, precision_over_coverage
                                 whether the confidence of points holds
summarise, pooled, markdown, COLUMNS
                                 means of groups of rows, as a table; its columns
overview, write_tables           the tables that a run prints; Markdown, LaTeX and CSV
markdown_table                   any titles and cells as Markdown
seeds_table                      mean and spread over runs with other seeds
save_clouds                      clouds of a few frames
build_report, open_report        tables, curves and clouds of a run in one HTML file
"""

from jradar.evaluation.confidence import (
    THRESHOLDS as THRESHOLDS,
    Around as Around,
    Judged as Judged,
    fitted_confidence as fitted_confidence,
    fitted_table as fitted_table,
    least_alone as least_alone,
    least_confidence as least_confidence,
    mean_f_scores as mean_f_scores,
    with_confidence as with_confidence,
)
from jradar.evaluation.detectors import (
    best_choice as best_choice,
    choose_rates as choose_rates,
    detected as detected,
    detector_methods as detector_methods,
    seen_points as seen_points,
    smeared as smeared,
)
from jradar.evaluation.methods import (
    Method as Method,
    known_mean as known_mean,
    mean_scores as mean_scores,
    ring_edges as ring_edges,
    score_frames as score_frames,
    score_points as score_points,
    score_rings as score_rings,
)
from jradar.evaluation.records import (
    Frame as Frame,
    View as View,
    check_view as check_view,
    drawn as drawn,
    points_of as points_of,
    samples as samples,
    score_and_keep as score_and_keep,
    score_records as score_records,
    surest_points as surest_points,
    view_of as view_of,
    write_report as write_report,
    write_results as write_results,
)
from jradar.evaluation.reliability import (
    near_truth as near_truth,
    precision_over_coverage as precision_over_coverage,
    reliability as reliability,
    reliability_error as reliability_error,
)
from jradar.evaluation.report import (
    build_report as build_report,
    open_report as open_report,
    save_clouds as save_clouds,
)
from jradar.evaluation.scores import (
    read_scores as read_scores,
    write_scores as write_scores,
)
from jradar.evaluation.statistics import (
    compare_methods as compare_methods,
    mean_interval as mean_interval,
    spread as spread,
)
from jradar.evaluation.tables import (
    COLUMNS as COLUMNS,
    markdown as markdown,
    markdown_table as markdown_table,
    overview as overview,
    pooled as pooled,
    seeds_table as seeds_table,
    summarise as summarise,
    write_tables as write_tables,
)
