"""What is said beside a verdict: that the pose contradicts what was given, and what is odd about scan and target."""

from __future__ import annotations

import numpy as np

from dqreg.geometry import Mesh
from dqreg.registration.fit.displacement import is_elsewhere
from dqreg.registration.fit.fit import Fit
from dqreg.registration.problem.problem import Problem
from dqreg.rigid import pose
from dqreg.trust.records import Reason, Verdict

REPEATED = "faces of the target that were there more than once were left out: {}"
START_LOST = (
    "the initial pose leads nowhere, as hardly any point of the scan comes near the target from there: a search found "
    "this pose"
)
START_LEFT = (
    "the pose is {:.0f} degrees and {:.2g} of the target's size from the initial pose, farther than a rough one errs: "
    "the scan fits better here"
)
PRIOR_LEFT = (
    "the pose is {:.0f} standard deviations of the prior away from it, where {:.0f} would be chance: the prior is of "
    "another frame, off, or not as sure as it says"
)
# Standard deviations beyond which a prior or prediction contradicts: of six motions three in a million are so far off.
EXCLUDED_SIGMAS = 6.0
NOT_JUDGED = "the pose was not judged, as verdict=False asks: whether it is right is for the caller to tell"
UNJUDGED = Verdict("suspect", (Reason(NOT_JUDGED, "not_judged"),))


def remarked_on_guesses(verdict: Verdict, fit: Fit, *, start_lost: bool) -> Verdict:
    """The verdict with remarks where the pose contradicts the initial one, or its prior."""
    if verdict.level == "accepted" and (words := START_LOST if start_lost else _left_by(fit)):
        verdict = verdict._remarked(Reason(words, "contradicted_start"))
    if fit.found and (sigmas := fit.constraints.prior_sigmas(fit.T_target_source)) > EXCLUDED_SIGMAS:
        verdict = verdict._remarked(Reason(PRIOR_LEFT.format(sigmas, EXCLUDED_SIGMAS), "contradicted_prior"))
    return verdict


def _left_by(fit: Fit) -> str:
    """How far a scan was put on a part from its initial pose, in words; "" where that may have meant the pose."""
    if fit.problem.start is None or fit.between_clouds:
        return ""
    here, start = fit.T_target_source, fit.problem.to_centred(fit.problem.start)
    if not is_elsewhere(fit, here, start):
        return ""
    shift = pose.offset_between(here, start, at=np.zeros(3)) / fit.prepared.surface.diagonal
    return START_LEFT.format(np.rad2deg(pose.angle_between(here, start)), shift)


def remarked_on_inputs(verdict: Verdict, problem: Problem) -> Verdict:
    """The verdict with a remark on what lay far from all other points of either side, and on faces given twice."""
    for name, strays in (("source", problem.source.strays), ("target", problem.target.strays)):
        verdict = verdict if strays is None else verdict._remarked(strays.remark(f"the {name}"))
    part = problem.target.geometry
    if isinstance(part, Mesh) and part._repeated:
        verdict = verdict._remarked(Reason(REPEATED.format(part._repeated), "repeated_faces"))
    return verdict
