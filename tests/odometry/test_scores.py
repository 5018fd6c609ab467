from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("kiss_icp")

from dqreg.errors import InputError
from dqreg.odometry.run_sequence import TrajectoryRun
from dqreg.odometry.scores import match_truth, results_table
from dqreg.rigid import pose


def test_truth_is_matched_by_number_or_by_time() -> None:
    truth = pose.exp(np.arange(4.0)[:, None] * [0.1, -0.2, 0.3, 1.0, 2.0, 3.0])
    np.testing.assert_array_equal(match_truth(truth, None, None, 4), truth)
    matched = match_truth(truth, np.arange(4.0), np.array([1.0, 3.0]), 2)
    np.testing.assert_array_equal(matched, truth[[1, 3]])
    with pytest.raises(InputError, match="4 poses for 2 frames"):
        match_truth(truth, None, None, 2)
    with pytest.raises(InputError, match="away from the nearest"):
        match_truth(truth, np.arange(4.0), np.array([1.0, 9.0]), 2)


def test_without_a_truth_the_table_has_no_columns_of_errors() -> None:
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[2] = np.nan
    run = TrajectoryRun("dq", poses, (), np.full(4, 0.5))
    table = results_table([run], None)
    assert [column.name for column in table.columns] == ["engine", "lost", "frames\na second"]
    assert table.rows == (("dq", "1", "2.0"),)
    assert len(results_table([run], np.tile(np.eye(4), (4, 1, 1))).columns) == 8
