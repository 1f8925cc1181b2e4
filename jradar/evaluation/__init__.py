"""Scores of methods against LiDAR: tables, intervals, comparisons, reports.

    rows = [*score_records(key, view, pairs, methods)]  # each method on each frame
    print(markdown(summarise(rows)))
    write_report(run, rows, clouds, figures)            # all in one page

A `Method` makes a cloud of a prepared frame; `detector_methods` are CFAR detectors and
`splat`, with the rates that `choose_rates` found on validation data. The file of scores
(`write_scores`) is the source of all that follows. `with_confidence` gives a model a
confidence that holds on given records, `reliability` says whether it does.
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
    choose_rates as choose_rates,
    detector_methods as detector_methods,
)
from jradar.evaluation.methods import (
    Method as Method,
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
    open_report as open_report,
)
from jradar.evaluation.scores import (
    read_scores as read_scores,
    write_scores as write_scores,
)
from jradar.evaluation.statistics import (
    compare_methods as compare_methods,
    spread as spread,
)
from jradar.evaluation.tables import (
    COLUMNS as COLUMNS,
    markdown as markdown,
    markdown_table as markdown_table,
    pooled as pooled,
    summarise as summarise,
    write_tables as write_tables,
)
