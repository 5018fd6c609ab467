"""Features of a part: planes, lines, circles, cylinders, cones, spheres, slots and edges fitted to points."""

from __future__ import annotations

from dqreg.inspection.features.edge import EdgePoint
from dqreg.inspection.features.feature import Feature, FeatureMethod
from dqreg.inspection.features.fit import fit_feature
from dqreg.inspection.features.models import FeatureKind
from dqreg.inspection.features.torus import Torus

__all__ = ["EdgePoint", "Feature", "FeatureKind", "FeatureMethod", "Torus", "fit_feature"]
