"""Methods scored frame by frame against LiDAR, and the table of their means.

score_frames                     scores of each method on each frame
summarise, markdown              the table
"""

from jradar.evaluation.methods import Method as Method, score_frames as score_frames
from jradar.evaluation.tables import (
    markdown as markdown,
    summarise as summarise,
)
