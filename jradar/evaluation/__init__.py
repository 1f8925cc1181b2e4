"""Scores of methods against LiDAR: tables, intervals, comparisons, reports.

A method is a function from a key and a frame to a PointCloud, such as a model's answer
or a CFAR detector. All methods answer the same frames, and every score is written to
one file, from which the tables, curves and comparisons of a report are made:

    view = records_in_view(Records("records", "test"))
    pairs = pairs_of(model.spec, view.records)
    methods = {"jradar": drawn(model)} | detector_methods(view, {"os": 1e-3})
    write_results(key, Path("run"), view, pairs, methods)
"""

from jradar.evaluation.confidence import (
    Judged as Judged,
    fitted as fitted,
    judged_answer as judged_answer,
    with_confidence as with_confidence,
)
from jradar.evaluation.detectors import (
    choose_rates as choose_rates,
    detector_methods as detector_methods,
    in_view as in_view,
    smeared as smeared,
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
    MethodInput as MethodInput,
    RecordsInView as RecordsInView,
    check_view as check_view,
    drawn as drawn,
    points_of as points_of,
    records_in_view as records_in_view,
    samples as samples,
    score_and_keep as score_and_keep,
    score_records as score_records,
    surest_points as surest_points,
    write_report as write_report,
    write_results as write_results,
)
from jradar.evaluation.reliability import (
    Reliability as Reliability,
    precision_over_coverage as precision_over_coverage,
    reliability as reliability,
)
from jradar.evaluation.report import open_report as open_report
from jradar.evaluation.scored import Score as Score
from jradar.evaluation.scores import (
    read_scores as read_scores,
    write_scores as write_scores,
)
from jradar.evaluation.scoring import score as score
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
from jradar.evaluation.trust import trust_of as trust_of
