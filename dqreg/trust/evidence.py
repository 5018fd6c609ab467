"""The numbers that the verdict is made of."""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

from dqreg._statuses import SearchStage, Status
from dqreg.trust.records import Alternative, Direction

# What of a scan may be off the target: anything, or of the part alone nothing.
Clutter = Literal["allowed", "none"]
# Deviation of made parts from their models, in sizes, for which limits on shapes were set.
PART_DEVIATION_DIAGONALS = 5e-4


def deviation_ratio(expected: float, size: float) -> float:
    """What limits on shapes of a part are multiplied by, given how far it is expected to deviate: 1 at least.

    >>> deviation_ratio(0.01, 100.0), deviation_ratio(0.2, 100.0)
    (1.0, 4.0)
    """
    # In this order a missing length asks for nothing.
    return max(1.0, expected / (PART_DEVIATION_DIAGONALS * size)) if size > 0.0 else 1.0


@dataclasses.dataclass(frozen=True)
class Evidence:
    """What the tests of the verdict look at.

    Attributes
    ----------
    status : str
        How the loop ended, see `dqreg._statuses`.
    found : bool
        Whether there is a pose at all.
    inliers : float
        Sum of the inlier probabilities.
    share_near, near : float
        Fraction of inliers among the points within the distance ``near`` of the target; infinite counts all points.
    patches, patches_off : int, float
        Patches of neighbouring points within ``near``, and the fraction of them that deviate as a whole.
    strays : float
        Fraction of all points that lie neither on the target nor on any other surface.
    normals_apart : float
        Fraction of the inliers whose normal disagrees with the target's.
    width, expected : float
        Standard deviation of the inliers' distances from the target's tangent planes, and the scan's own noise.
    max_distance : float
        Largest distance of a correspondence.
    directions : tuple of Direction
        The six motions, the weakest first.
    alternatives : tuple of Alternative
        Other poses that are equally likely.
    search : str
        The last stage that the global search finished, see `dqreg._statuses`.
    has_border : bool
        Whether the target has a boundary: a cloud, an open mesh.
    units : str or None
        Of all lengths, where known.
    mirror_gain : float
        Mean log-likelihood that the scan gains when it is mirrored; minus infinity where that was not tested.
    freed_gain : float
        Mean log-likelihood that the scan gains where locked motions and a prior are left out; NaN where there are none,
        or that was not asked.
    freed_rad, freed_shift : float
        Rotation, and displacement of the middle of the target, to the pose that gains it.
    stretch, stretched_along : float, tuple of 3 floats
        Significant strain of the scan against the target along an axis, below 0 where it is shorter; the axis is zero
        for a scale.
    bend : float
        Significant bend of the scan against the target: sagitta over length.
    waviness : float
        Significant part of the residuals that neighbouring points have in common, one standard deviation; a length.
    share_together : float
        Fraction of the points near the target that lie off it beside each other, as a displaced feature does.
    is_detail : bool
        Whether points lie off the target together, of a scan that shows little of it and may fit elsewhere.
    local_noise : float
        The scan's noise from point to point, by what the residuals of neighbours differ; NaN where that is not known.
    usual : float
        Fraction of inliers in the frames before, of a sequence; NaN where there are none.
    random_ratio : float
        Residuals over those at random poses near by; about 1 is chance, 0 far below it.
    size : float
        Diagonal of the target; NaN where the uncertainty is not to be tested.
    carriers : tuple of float
        Number of points, about, that constrain each of the directions; empty where that was not counted.
    carriers_of_both : bool
        Whether those are the points on which the normals of two scans agree.
    sliding_loss : float
        Least log-likelihood that the scan loses where it is displaced along the motions that few points constrain; NaN
        where that was not asked.
    share_on, share_other, share_contradicting : float
        Fractions of the scan on the target, on other objects, and on surface of the part itself off the target.
    share_on_faces : float
        Fraction of the scan on smooth surface that is on the target; NaN where that was not asked.
    going_on : float
        Of the points on the target, the share beside which the scan goes on beyond it in one plane; NaN where the scan
        is no larger than a closed target.
    looked_through : float
        Fraction of the points compared that stand where a scanner looked through; NaN where its place is not known.
    seen_alike : float
        Fraction of all points that the other scan's rays met as far, where `looked_through` is by the rays themselves:
        of two scans from places amid what they show; NaN else.
    faces_apart : float
        Share of the places that both of two scans show at which they lie apart; NaN where that was not asked.
    ends_apart : float
        Share of the faces of two scans that have a few planes in common at most which reaches beyond the other's, of
        the one with less of it; NaN where they have more in common, and where more than three planes share their rims.
    rims_shared : float
        Share of the rims of faces in those planes that are rims of the other scan's faces too, of the scan with more of
        it, or of the sparser one, or of some of its rims, where they tell enough; NaN where that was not asked.
    rims_elsewhere : tuple of 2 floats
        Share of those rims that both would have more after a slide along a plane's normal, NaN likewise, and the length
        of that slide, 0 where nothing is gained; of three planes at most.
    opposed_edges : float
        Share of the rims of both scans in a common plane beside which their faces turn to opposite sides, of the plane
        with most of it; NaN for few, and where no plane holds an eighth of what looks its way.
    closed_hole : float
        Diameter of the largest hole in a face of one scan, in those planes, that a face of the other one closes, 0 for
        none that counts; NaN where they have more in common. A length.
    largest_plane : float
        Share of the places that both scans show which the largest of three planes holds; NaN where they have more in
        common.
    deformation : float
        Displacement of the scan's surface against the target's, along its normals, by a significant smooth deformation
        that no motion explains, root mean square; else 0. A length.
    drift, drift_rad : float
        Significant displacement and rotation of the pose from the first point of the scan to the last; else 0.
    drift_along : tuple of 3 floats
        Direction of that displacement, target frame; zeros where it is a rotation about the middle, or is not known.
    places : float
        Distinct places at which inliers lie, of some hundreds of them; infinite where that was not counted.
    clutter : str
        "allowed", or "none" where the scan is of the part alone.
    looking_away : float
        Share of the points near the target whose normals, of known sides, look the other way than its faces; NaN where
        the sides are not known.
    viewpoint_behind : float
        Share of the scan's own points that stand behind others, seen from the viewpoint that was given; NaN without.
    is_scene : bool
        Whether the scan is so large that it shows more than a closed target; True where that is not known.
    patches_deformed : float
        Fraction of the patches that deviate on faces of which most is on the target: no motion explains these. 0 where
        not more deviate than a right pose may have.
    share_deformed : float
        Fraction of the scan off the target in those.
    expected_deviation : float
        How far the part may be off its mesh; 0 where nothing is said.
    _width_of_inliers : float
        The width without what is an inlier only because the part may deviate so far; NaN where it was not asked.
    _common : float
        Share of the points compared at which both of two scans show one smooth surface; NaN where that was not asked.

    Examples
    --------
    >>> nothing = Evidence("no correspondences", False, 0.0, 0.0, 0.5, 0, 0, 0, 0, 0, 0, 20.0, (), (), units="mm")
    >>> nothing.length(nothing.max_distance)
    '20 mm'
    """

    status: Status
    found: bool
    inliers: float
    share_near: float
    near: float
    patches: int
    patches_off: float
    strays: float
    normals_apart: float
    width: float
    expected: float
    max_distance: float
    directions: tuple[Direction, ...]
    alternatives: tuple[Alternative, ...]
    search: SearchStage = ""
    has_border: bool = False
    units: str | None = None
    stretch: float = 0.0
    stretched_along: tuple[float, float, float] = (0.0, 0.0, 0.0)
    mirror_gain: float = -math.inf
    freed_gain: float = math.nan
    freed_rad: float = math.nan
    freed_shift: float = math.nan
    usual: float = math.nan
    random_ratio: float = 0.0
    size: float = math.nan
    carriers: tuple[float, ...] = ()
    carriers_of_both: bool = False
    bend: float = 0.0
    share_on: float = 1.0
    share_other: float = 0.0
    share_contradicting: float = 0.0
    clutter: Clutter = "allowed"
    is_scene: bool = True
    looked_through: float = math.nan
    faces_apart: float = math.nan
    ends_apart: float = math.nan
    drift: float = 0.0
    drift_rad: float = 0.0
    sliding_loss: float = math.nan
    drift_along: tuple[float, float, float] = (0.0, 0.0, 0.0)
    waviness: float = 0.0
    local_noise: float = math.nan
    share_together: float = 0.0
    is_detail: bool = False
    rims_shared: float = math.nan
    largest_plane: float = math.nan
    deformation: float = 0.0
    places: float = math.inf
    rims_elsewhere: tuple[float, float] = (math.nan, 0.0)
    share_on_faces: float = math.nan
    opposed_edges: float = math.nan
    closed_hole: float = math.nan
    seen_alike: float = math.nan
    looking_away: float = math.nan
    viewpoint_behind: float = math.nan
    patches_deformed: float = 0.0
    share_deformed: float = 0.0
    going_on: float = math.nan
    expected_deviation: float = 0.0
    _common: float = math.nan
    _width_of_inliers: float = math.nan

    @property
    def deviation_ratio(self) -> float:
        """What limits on the shape of the part are multiplied by, see `deviation_ratio`."""
        return deviation_ratio(self.expected_deviation, self.size)

    @property
    def contradiction(self) -> float:
        """Share of the part's own surface that is off the target: faces against faces, whatever a sparse scan blurs."""
        on = self.share_on_faces if math.isfinite(self.share_on_faces) else self.share_on
        own = on + self.share_contradicting
        return self.share_contradicting / own if own > 0.0 else math.nan

    @property
    def distinct_inliers(self) -> float:
        """The inliers, each place counted once."""
        return min(self.inliers, self.places)

    @property
    def _other_poses(self) -> tuple[Alternative, ...]:
        """The alternatives to which no symmetry of the part leads."""
        return tuple(alternative for alternative in self.alternatives if not alternative._is_symmetric)

    @property
    def share_nowhere(self) -> float:
        """Fraction of the scan neither on the target nor on any surface off it."""
        return 1.0 - self.share_on - self.share_other - self.share_contradicting

    def length(self, value: float) -> str:
        """A length in words, with its unit where that is known.

        Parameters
        ----------
        value : float
            The length.

        Returns
        -------
        str
            Three digits.
        """
        return f"{value:.3g}" + (f" {self.units}" if self.units else "")
