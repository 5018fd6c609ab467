"""Sets of the codes of verdicts that decisions hang on: who adds a code decides here in which of them it belongs."""

from __future__ import annotations

from typing import TypeAlias

from dqreg.trust.records import Code

Codes: TypeAlias = frozenset[Code]

# Remarks on the data, beside any doubt: they say nothing of the pose.
REMARKS: Codes = frozenset({"stray_points", "repeated_faces"})

# Of one registration: what another pose cannot mend. And of two clouds, of which a wrong pose often lies on one face,
# where the right one would have more.
REASONS_OF_SCAN: Codes = frozenset({"unconstrained", "alternative_poses", "outliers", "not_converged"})
REASONS_OF_SCAN_BETWEEN_CLOUDS: Codes = REASONS_OF_SCAN - {"unconstrained"}
# What is said of a pose that too little speaks for, and nothing against; of one beside a pose that is refused; and of
# both sides of a wall, which are faces apart that are none.
TOO_LITTLE: Codes = frozenset({"unconstrained", "large_uncertainty", "weakly_constrained", "not_converged"})
TOO_LITTLE_IF_REFUSED: Codes = frozenset({"one_plane"})
SIDES_OF_WALL: Codes = frozenset({"faces_apart"})
# What comes of how a part was scanned or of what was asked; all other doubts may come of its shape.
OF_HOW_IT_WAS_SCANNED: Codes = (
    REMARKS
    | TOO_LITTLE
    | frozenset(
        {
            "alternative_poses",
            "one_plane",
            "wrong_viewpoint",
            "search_time_limit",
            "not_judged",
            "scale_unobservable",
            "scale_ambiguous",
            "scale_uncertain",
        }
    )
)

# What a part says that deviates by more than is expected of it; all may come of another part or a wrong pose too.
OF_A_DEVIATING_PART: Codes = REMARKS | frozenset(
    {"stretched", "bent", "deformed", "wavy", "deviating_patches", "large_residuals", "drift", "contradicting_surface"}
)

# What pairs say of a scan whose shape is not that of the others: a scale, a bend, a part that was clamped anew.
OF_ANOTHER_SHAPE: Codes = frozenset({"stretched", "bent", "deformed", "wavy"})

# Of a drive: what is said of a frame that may lie elsewhere, and reasons after which its place is not known.
PLACE_IN_DOUBT: Codes = frozenset({"lost", "low_inlier_fraction", "falling_inlier_fraction", "looked_through"})
PLACE_UNKNOWN: Codes = PLACE_IN_DOUBT | {"unconstrained", "alternative_poses", "no_correspondences"}

# Of a scan that fits, among many: how well its motions are known. The first of them are said of single ones.
HARDLY_HELD: Codes = frozenset({"weakly_constrained", "unconstrained"})
WEAKLY_CONSTRAINED: Codes = REMARKS | HARDLY_HELD | {"large_uncertainty"}
# What may be doubted of the only pose of one that fits all others: that, and its scale.
WEAKLY_CONSTRAINED_AMONG_ALL: Codes = WEAKLY_CONSTRAINED | {"scale_unobservable"}
# What may be doubted of a right pose: how well its motions are known, and whether the search and the steps have come to
# an end. That says nothing against where a scan stands. And what is said of a pair against which nothing speaks but the
# viewpoints that were given.
DOUBTS_OF_RIGHT_POSE: Codes = WEAKLY_CONSTRAINED | {"alternative_poses", "not_converged", "search_time_limit"}
VIEWPOINT_OFF: Codes = DOUBTS_OF_RIGHT_POSE | {"looked_through", "accepted"}
# May be doubted of pairs that all agree, since loops tell it: how well motions are held, and whether beyond one plane.
SETTLED_BY_LOOPS: Codes = WEAKLY_CONSTRAINED | {"one_plane"}
# Of a scan that fits, where all pairs agree: how well it is held, also by one plane; and its normals, which are guesses
# for a plate seen from its edge.
SETTLED_BY_AGREEMENT: Codes = SETTLED_BY_LOOPS | {"disagreeing_normals"}
# The same where the steps of a table confirm its pairs: they tell which of several poses it is.
SETTLED_BY_TABLE: Codes = SETTLED_BY_AGREEMENT | {"alternative_poses"}
# What the steps tell of a pair besides how well it is held: which of several poses it is, and that of one plane.
SETTLED_BY_STEPS: Codes = DOUBTS_OF_RIGHT_POSE | {"one_plane"}
