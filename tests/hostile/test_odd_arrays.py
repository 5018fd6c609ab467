"""Arrays of every make, and what is none, at other doors than that of `register`: an answer or a named error."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import dqreg
from dqreg import inspection, quaternion, solvers, synth
from dqreg.errors import DqregError, InputError
from dqreg.geometry import CloudSurface, Mesh, MeshSurface, sample_mesh
from dqreg.rigid import pose
from dqreg.synth.parts import box

PART = Mesh(*box((3.0, 2.0, 1.0)))
SURFACE = MeshSurface(PART)
CLOUD = sample_mesh(PART, 300, np.random.default_rng(0)).points
NEAREST = CloudSurface(dqreg.PointCloud(CLOUD))
TURN = pose.exp([0.3, -0.2, 0.1, 1.0, 2.0, 3.0])
FACES = inspection.part_faces(PART)
DEVIATIONS = inspection.measure_deviations(CLOUD, PART, SURFACE)

# The same numbers in other clothes: the answer is that of the plain array, to the digits that they hold.
CLOTHES: dict[str, Callable[[np.ndarray], Any]] = {
    "float32": lambda a: a.astype(np.float32),
    "big-endian": lambda a: a.astype(">f8"),
    "Fortran": np.asfortranarray,
    "strided": lambda a: np.repeat(a, 2, axis=0)[::2],
    "read-only": lambda a: np.frombuffer(a.tobytes()).reshape(a.shape),
    "masked": lambda a: np.ma.masked_array(a, mask=np.zeros(a.shape, dtype=bool)),
    "lists": lambda a: a.tolist(),
    "objects": lambda a: a.astype(object),
}
ANSWERS: dict[str, Callable[[Any], Any]] = {
    "pose.apply": lambda p: pose.apply(TURN, p),
    "rotate": lambda p: quaternion.rotate([0.6, 0.8, 0.0, 0.0], p),
    "apply of a dual quaternion": lambda p: dqreg.DualQuaternion.from_matrix(TURN).apply(p),
    "solve": lambda p: dqreg.solve(p, pose.apply(TURN, CLOUD)).T_target_source,
    "cramer_rao": lambda p: solvers.cramer_rao(p),
    "deviations": lambda p: inspection.measure_deviations(p, PART, SURFACE).values,
    "fit_feature": lambda p: inspection.fit_feature(p, "sphere").point,
    "cloud": lambda p: dqreg.PointCloud(p).points,
    "closest of a mesh": lambda p: SURFACE.closest(p).points,
    "closest of a cloud": lambda p: NEAREST.closest(p).points,
}


@pytest.mark.parametrize("name", ANSWERS)
@pytest.mark.parametrize("clothes", CLOTHES)
def test_the_same_numbers_give_the_same_answer_whatever_holds_them(name: str, clothes: str) -> None:
    expected, found = ANSWERS[name](CLOUD), ANSWERS[name](CLOTHES[clothes](CLOUD))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-5 if clothes == "float32" else 1e-12)


def test_a_frame_over_the_bytes_of_a_message_is_followed() -> None:
    pytest.importorskip("kiss_icp")
    frame = np.frombuffer(CLOUD.tobytes()).reshape(-1, 3)
    assert not frame.flags.writeable
    assert dqreg.Odometry().register_frame(frame).verdict.level == "accepted"


RAGGED = [[1.0, 2.0], [1.0]]
NOT_QUERIES: list[tuple[Any, str]] = [
    *((np.ones(shape), r"points must have shape \(n, 3\)") for shape in ((5, 2), (5, 4), (3,), (0,), (), (2, 5, 3))),
    *((x, "points must be an array of real numbers") for x in (CLOUD + 0j, "abc", [["a", "b", "c"]], None, RAGGED)),
]
NOT_A_PLACE = [None, "abc", [1.0, 2.0], np.full(3, np.nan), np.zeros((3, 3)), {"x": 1.0}]
MATCHES = solvers.read_matches(CLOUD, CLOUD)
REFUSED: list[tuple[Callable[[], Any], str]] = [
    *((lambda x=x: inspection.edge_point(DEVIATIONS, x), "point must be") for x in NOT_A_PLACE),
    *((lambda x=x: inspection.nearest_face(PART, FACES, x), "point must be") for x in NOT_A_PLACE),
    *((lambda x=x: sample_mesh(PART, x, np.random.default_rng(0)), "count must be a whole") for x in (0, 1.5, "9")),
    *((lambda x=x: solvers.cost_of_pose(x, MATCHES), "T_target_source must") for x in (None, "T", np.eye(3))),
    (lambda: inspection.measure_deviations(np.where(CLOUD > 1.4, np.nan, CLOUD), PART, SURFACE), "points holds .* NaN"),
    (lambda: inspection.measure_deviations(CLOUD[:0], PART, SURFACE), "points are empty"),
    (lambda: inspection.align_points(CLOUD[:0], CLOUD[:0], CLOUD[:0]), "one at least"),
    (lambda: inspection.align_points(1e200 * CLOUD, CLOUD, CLOUD), "points hold coordinates up to"),
    *((lambda k=k: inspection.fit_feature(1e200 * CLOUD, k), "hold coordinates up to") for k in ("plane", "cone")),
    (lambda: inspection.fit_feature(1e-200 * CLOUD, "cone"), "finer unit"),
    (lambda: solvers.cramer_rao(CLOUD[:0]), r"points must have shape \(..., n, 3\) with n > 0"),
    (lambda: solvers.cramer_rao(CLOUD, CLOUD[None]), "leading axes"),
    *((lambda x=x: SURFACE.closest(x), said) for x, said in NOT_QUERIES),
    *((lambda x=x: NEAREST.closest(x), said) for x, said in NOT_QUERIES),
    (lambda: NEAREST.closest(np.full((2, 3), np.nan)), "points holds 6 numbers that are NaN"),
    (lambda: NEAREST.closest(1e200 * CLOUD), "points hold coordinates up to"),
    *((lambda x=x: solvers.cramer_rao(CLOUD, centre=x), "centre ") for x in ([1.0, 2.0], np.full(3, np.nan), 3.0)),
    *((lambda x=x: solvers.cramer_rao(CLOUD, sigma_p=x), "sigma_p and sigma_n") for x in ("a", None, CLOUD, 0.0)),
    *((lambda x=x: inspection.align_points(*[CLOUD] * 3, sigma=x), "sigma must") for x in ("a", CLOUD, [1.0], -1.0)),
    *((lambda x=x: inspection.measure_deviations(CLOUD, PART, SURFACE, origin=x), "origin") for x in ("a", [1.0])),
    *((lambda x=x: inspection.measure_deviations(CLOUD, PART, SURFACE, covariance=x), "cov") for x in ("a", [1.0])),
    *((lambda x=x: inspection.measure_deviations(CLOUD, PART, SURFACE, centre=x), "centre") for x in ("a", [1.0])),
    (lambda: inspection.measure_deviations(CLOUD, PART, SURFACE, exclude=["a"]), "a box to exclude"),
    (lambda: dqreg.DualQuaternion.from_matrix(RAGGED), "T_target_source must be an array of real numbers"),
    (lambda: dqreg.Odometry().register_frame(RAGGED), "points must be an array of real numbers"),
    (lambda: dqreg.PointCloud.from_depth(RAGGED, np.eye(3)), "depth must have rows of one length"),
    (lambda: synth.visible_share(CLOUD, RAGGED, synth.Scanner([[0, 0, 1.0]], 9)), "faces must be an array"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "said"), REFUSED)
def test_what_cannot_be_used_is_refused_by_name(call: Callable[[], Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        call()


def odd() -> st.SearchStrategy[Any]:
    """Arrays of odd shapes, kinds and numbers, and things that are no arrays."""
    number = st.sampled_from([0.0, 1.0, -2.5, 1e-300, 1e200, np.inf, np.nan])
    shape = st.sampled_from([(), (3,), (1, 3), (5, 3), (3, 5), (0, 3), (2, 5, 3), (4, 4), (5, 4)])

    @st.composite
    def arrays(draw: Callable[[Any], Any]) -> Any:
        wanted = draw(shape)
        size = int(np.prod(wanted))
        array = np.array(draw(st.lists(number, min_size=size, max_size=size)), dtype=float).reshape(wanted)
        kind = draw(st.sampled_from(["f8", "f4", "O", ">f8", "U8", "c16"]))
        with np.errstate(over="ignore"):
            return array.astype(kind)

    return st.one_of(arrays(), st.sampled_from([None, "", "abc", b"1", {}, {1.0}, len, 3]))


def doors(value: Any) -> Iterator[Callable[[], Any]]:
    yield lambda: dqreg.solve(value, value)
    yield lambda: dqreg.solve(CLOUD[:5], CLOUD[:5], value, value)
    yield lambda: solvers.cramer_rao(value)
    yield lambda: solvers.cramer_rao(CLOUD, centre=value)
    yield lambda: SURFACE.closest(value)
    yield lambda: NEAREST.closest(value)
    yield lambda: dqreg.PoseCost.points(value, value).minimise()
    yield lambda: inspection.fit_feature(value, "plane")
    yield lambda: inspection.align_points(value, value, value)
    yield lambda: inspection.measure_deviations(value, PART, SURFACE)
    yield lambda: inspection.nearest_face(PART, FACES, value)
    yield lambda: dqreg.PointCloud(value)
    yield lambda: dqreg.DualQuaternion.from_matrix(value)
    yield lambda: dqreg.Trajectory([0.0], [value])


@settings(deadline=None, max_examples=60)
@given(odd())
def test_no_array_whatsoever_ends_in_an_error_without_a_name(value: Any) -> None:
    for call in doors(value):
        try:
            call()
        except DqregError as error:
            # What was given or expected, and not a bare word.
            assert len(str(error)) > 20  # noqa: PT017
