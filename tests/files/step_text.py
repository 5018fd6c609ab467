"""STEP files written by hand: a block with a hole whose wall is two half cylinders, as CAD programs write it."""

from __future__ import annotations

import numpy as np

HEADER = "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('a','2026-01-01',(''),(''),'','','');\n"
SCHEMA = "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n"
MM = "( LENGTH_UNIT ( ) NAMED_UNIT ( * ) SI_UNIT ( .MILLI., .METRE. ) )"


class _Writer:
    """Statements of a STEP file, numbered as they come."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._known: dict[str, int] = {}

    def add(self, text: str) -> int:
        """Number of a statement; the same text is one."""
        if text not in self._known:
            self._known[text] = len(self.lines) + 1
            self.lines.append(f"#{len(self.lines) + 1} = {text} ;")
        return self._known[text]

    def point(self, p: np.ndarray) -> int:
        return self.add(f"CARTESIAN_POINT('',({p[0]:.9f},{p[1]:.9f},{p[2]:.9f}))")

    def direction(self, p: np.ndarray) -> int:
        return self.add(f"DIRECTION('',({p[0]:.9f},{p[1]:.9f},{p[2]:.9f}))")

    def vertex(self, p: np.ndarray) -> int:
        return self.add(f"VERTEX_POINT('',#{self.point(p)})")

    def frame(self, origin: np.ndarray, z: np.ndarray, x: np.ndarray) -> int:
        return self.add(f"AXIS2_PLACEMENT_3D('',#{self.point(origin)},#{self.direction(z)},#{self.direction(x)})")

    def straight(self, a: np.ndarray, b: np.ndarray) -> str:
        """An edge from a to b, either way round of one curve."""
        forward = tuple(a) < tuple(b)
        low, high = (a, b) if forward else (b, a)
        along = self.add(f"VECTOR('',#{self.direction((high - low) / np.linalg.norm(high - low))},1.0)")
        line = self.add(f"LINE('',#{self.point(low)},#{along})")
        edge = self.add(f"EDGE_CURVE('',#{self.vertex(low)},#{self.vertex(high)},#{line},.T.)")
        return f"#{self.add(f'ORIENTED_EDGE({chr(39) * 2},*,*,#{edge},.{chr(84) if forward else chr(70)}.)')}"

    def arc(self, centre: np.ndarray, radius: float, first: float, forward: bool = True) -> str:
        """Half a turn about z from an angle on."""
        unit = np.array([1.0, 0.0, 0.0])
        circle = self.add(f"CIRCLE('',#{self.frame(centre, np.array([0, 0, 1.0]), unit)},{radius:.9f})")
        a, b = (centre + radius * np.array([np.cos(t), np.sin(t), 0.0]) for t in (first, first + np.pi))
        edge = self.add(f"EDGE_CURVE('',#{self.vertex(a)},#{self.vertex(b)},#{circle},.T.)")
        return f"#{self.add(f'ORIENTED_EDGE({chr(39) * 2},*,*,#{edge},.{chr(84) if forward else chr(70)}.)')}"

    def face(self, surface: int, outer: list[str], inner: list[str] | None = None, same: bool = True) -> int:
        bounds = [f"#{self.add(f'FACE_OUTER_BOUND({chr(39) * 2},#{self._loop(outer)},.T.)')}"]
        if inner:
            bounds.append(f"#{self.add(f'FACE_BOUND({chr(39) * 2},#{self._loop(inner)},.T.)')}")
        return self.add(f"ADVANCED_FACE('',({','.join(bounds)}),#{surface},.{'T' if same else 'F'}.)")

    def _loop(self, edges: list[str]) -> int:
        return self.add(f"EDGE_LOOP('',({','.join(edges)}))")


def block_with_hole(
    size: tuple[float, float, float] = (30.0, 20.0, 10.0),
    hole: tuple[float, float, float] = (12.0, 8.0, 3.0),
    unit: str = MM,
) -> bytes:
    """A block from the origin with a through hole along z at (x, y) of a radius; lengths in its unit."""
    w = _Writer()
    corners = {(i, j, k): np.array([i, j, k]) * size for i in (0, 1) for j in (0, 1) for k in (0, 1)}
    faces = []
    for axis in range(3):
        for end in (0, 1):
            # Corners counter-clockwise as seen from outside.
            u, v = [(1, 2), (2, 0), (0, 1)][axis]
            ring = []
            for s, t in [(0, 0), (1, 0), (1, 1), (0, 1)][:: 1 if end else -1]:
                key = [0, 0, 0]
                key[axis], key[u], key[v] = end, s, t
                ring.append(corners[key[0], key[1], key[2]])
            normal = np.eye(3)[axis] * (1.0 if end else -1.0)
            plane = w.add(f"PLANE('',#{w.frame(ring[0], normal, np.eye(3)[u])})")
            outer = [w.straight(a, b) for a, b in zip(ring, [*ring[1:], ring[0]], strict=True)]
            inner = None
            if axis == 2:
                at = np.array([hole[0], hole[1], end * size[2]])
                arcs = [w.arc(at, hole[2], 0.0, not end), w.arc(at, hole[2], np.pi, not end)]
                inner = arcs[::-1] if end else arcs
            faces.append(w.face(plane, outer, inner))
    low = np.array([hole[0], hole[1], 0.0])
    high = low + np.array([0.0, 0.0, size[2]])
    wall = w.add(f"CYLINDRICAL_SURFACE('',#{w.frame(low, np.array([0, 0, 1.0]), np.array([1.0, 0, 0]))},{hole[2]:.9f})")
    for first in (0.0, np.pi):
        a, b = (np.array([np.cos(t), np.sin(t), 0.0]) * hole[2] for t in (first, first + np.pi))
        # The material lies outside of the wall: its face runs against the surface's normal.
        ring = [w.arc(high, hole[2], first), w.straight(high + b, low + b), w.arc(low, hole[2], first, False),
                w.straight(low + a, high + a)]  # fmt: skip
        faces.append(w.face(wall, ring, None, same=False))
    shell = w.add(f"CLOSED_SHELL('',({','.join(f'#{face}' for face in faces)}))")
    return HEADER.encode() + SCHEMA.encode() + _product(w, shell, unit).encode()


def ring(major: float, minor: float, unit: str = MM) -> bytes:
    """A torus about the z axis as one face between its two seams; lengths in its unit."""
    w = _Writer()
    x, y, z = np.eye(3)
    surface = w.add(f"TOROIDAL_SURFACE('',#{w.frame(np.zeros(3), z, x)},{major:.9f},{minor:.9f})")
    start = w.vertex((major + minor) * x)
    seams = []
    for frame, radius in ((w.frame(np.zeros(3), z, x), major + minor), (w.frame(major * x, -y, x), minor)):
        circle = w.add(f"CIRCLE('',#{frame},{radius:.9f})")
        seams.append(w.add(f"EDGE_CURVE('',#{start},#{start},#{circle},.T.)"))
    turns = [(seams[0], "T"), (seams[1], "T"), (seams[0], "F"), (seams[1], "F")]
    outline = [f"#{w.add(f'ORIENTED_EDGE({chr(39) * 2},*,*,#{edge},.{way}.)')}" for edge, way in turns]
    shell = w.add(f"CLOSED_SHELL('',(#{w.face(surface, outline)}))")
    return HEADER.encode() + SCHEMA.encode() + _product(w, shell, unit).encode()


def _inch(w: _Writer) -> str:
    # The metre that it is converted from is a length unit too, but not that of the shapes.
    metre = w.add("( LENGTH_UNIT ( ) NAMED_UNIT ( * ) SI_UNIT ( $, .METRE. ) )")
    much = w.add(f"LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(0.0254),#{metre})")
    exponents = w.add("DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)")
    return f"( CONVERSION_BASED_UNIT ( 'INCH', #{much} ) LENGTH_UNIT ( ) NAMED_UNIT ( #{exponents} ) )"


def _product(w: _Writer, shell: int, unit: str) -> str:
    solid = w.add(f"MANIFOLD_SOLID_BREP('block',#{shell})")
    length = w.add(unit if unit != "inch" else _inch(w))
    angle = w.add("( NAMED_UNIT ( * ) PLANE_ANGLE_UNIT ( ) SI_UNIT ( $, .RADIAN. ) )")
    solid_angle = w.add("( NAMED_UNIT ( * ) SI_UNIT ( $, .STERADIAN. ) SOLID_ANGLE_UNIT ( ) )")
    close = w.add(f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-07),#{length},'distance_accuracy_value','')")
    context = w.add(
        f"( GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#{close})) "
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT((#{length},#{angle},#{solid_angle})) REPRESENTATION_CONTEXT('','') )"
    )
    shape = w.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',(#{solid}),#{context})")
    app = w.add("APPLICATION_CONTEXT('automotive design')")
    about = w.add(f"PRODUCT_CONTEXT('',#{app},'mechanical')")
    product = w.add(f"PRODUCT('block','block','',(#{about}))")
    formation = w.add(f"PRODUCT_DEFINITION_FORMATION('','',#{product})")
    design = w.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',#{app},'design')")
    definition = w.add(f"PRODUCT_DEFINITION('design','',#{formation},#{design})")
    of = w.add(f"PRODUCT_DEFINITION_SHAPE('','',#{definition})")
    w.add(f"SHAPE_DEFINITION_REPRESENTATION(#{of},#{shape})")
    return "\n".join(w.lines) + "\nENDSEC;\nEND-ISO-10303-21;\n"
