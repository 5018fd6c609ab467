"""What a worker process of the studio can be asked for, and which results stand as long as the visit is the same."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dqreg.studio.visit import Visit

if TYPE_CHECKING:
    from dqreg.studio.worker_cache import Place

Values = dict[str, Any]
# Fields of a visit that each result depends on: where one of them changes, the result is of yesterday.
DEPENDS = {
    "scan": ("scan", "mirrored"),
    "draw_scan": ("scan", "mirrored", "cuts"),
    "part": ("part",),
    "compare": ("scan", "mirrored", "part"),
    "mirror": ("scan", "mirrored", "part"),
    "align": ("scan", "mirrored", "part", "cuts", "start", "pairs", "T_start", "dof"),
}
DEPENDS["reach"] = (*DEPENDS["align"], "reach")
DEPENDS["judge"] = (
    *DEPENDS["align"],
    "alignment",
    "chosen",
    "weights",
    "goal",
    "datums",
    "references",
    "reach",
    "tolerance",
    "minus",
    "required",
    "faces",
    "sections",
    "labels",
    "plan",
)
DEPENDS["report"] = (*DEPENDS["judge"], "head", "views")
# What a worker can be asked for by name; `tasks` does it.
NAMES = (
    *("scan", "part", "compare", "mirror", "plane", "draw_scan", "lasso", "pick_part", "pick_scan"),
    *("pairs", "hand", "align", "reach", "judge", "suggest_datums", "report", "pdf"),
)
# Questions that nothing waits for: answered beside the work.
ASIDE = ("mirror",)


def perform(name: str, folder: Path, visit: Visit, values: Values) -> Any:
    """Do a task, in a worker process."""
    from dqreg.files.strict_json import plain
    from dqreg.studio.worker_cache import Place

    return plain(tasks()[name](Place(folder, visit), values))


def tasks() -> dict[str, Callable[[Place, Values], Any]]:
    """What a worker can be asked for, imported where the work is done: the server stays light."""
    from dqreg.studio import aligning, alignments, judging, picking, reading

    return {
        "scan": lambda place, _: reading.read_scan(place),
        "part": lambda place, _: reading.read_part(place),
        "compare": lambda place, _: reading.compare_sides(place),
        "mirror": lambda place, _: aligning.mirror_question(place),
        "plane": lambda place, _: reading.plane_question(place),
        "draw_scan": lambda place, _: reading.draw_scan(place),
        "lasso": picking.lasso_cut,
        "pick_part": picking.pick_part,
        "pick_scan": picking.pick_scan,
        "pairs": lambda place, _: aligning.align_pairs(place),
        "hand": aligning.pose_of_drawn,
        "align": lambda place, _: aligning.align(place),
        "reach": lambda place, _: judging.show_reach(place),
        "judge": lambda place, _: judging.judge(place),
        "suggest_datums": lambda place, _: alignments.suggest_datums(place),
        "report": lambda place, _: judging.write_sheet(place),
        "pdf": lambda place, _: judging.print_sheet(place),
    }


def warm() -> None:
    """Load what every task needs."""
    from dqreg._open3d import load_open3d

    load_open3d()
