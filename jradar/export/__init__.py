"""Files that make dense clouds without jradar.

export_function   a cube to a cloud, for one radar; runs where JAX is
export_onnx       a radar's points to a cloud; runs in ONNX Runtime, OpenVINO and others
"""

from jradar.export.function import (
    export_function as export_function,
    loading as loading,
)
from jradar.export.onnx import (
    ONNX as ONNX,
    export_onnx as export_onnx,
    running as running,
)
