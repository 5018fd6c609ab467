"""Many scans, one frame: pairs, which of them to use, and all poses refined together."""

from dqreg.multiway.exports import Factors
from dqreg.multiway.loop_errors import LoopError
from dqreg.multiway.pairwise.pair_runs import Progress
from dqreg.multiway.pose_graph.edges import Edge
from dqreg.multiway.register_many import register_many
from dqreg.multiway.result import Multiway

__all__ = ["Edge", "Factors", "LoopError", "Multiway", "Progress", "register_many"]
