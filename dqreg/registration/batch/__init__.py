"""Many registrations: a manifest in, one result file each and one summary out.

`read_manifest` checks every row, `run_batch` works them off in processes of their own or on a Dask cluster.
"""

from __future__ import annotations

from dqreg.registration.batch.line import Line
from dqreg.registration.batch.manifest import Defaults, read_manifest
from dqreg.registration.batch.row import Row
from dqreg.registration.batch.row_inspection import RowInspection
from dqreg.registration.batch.run import Batch, BatchProgress, Workers, run_batch

__all__ = [
    "Batch",
    "BatchProgress",
    "Defaults",
    "Line",
    "Row",
    "RowInspection",
    "Workers",
    "read_manifest",
    "run_batch",
]
