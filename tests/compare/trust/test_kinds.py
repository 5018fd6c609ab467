from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from dqreg.compare.trust import scans, shapes
from dqreg.compare.trust.kinds import KINDS, kinds_named
from dqreg.compare.trust.task import Drive, TrustTask
from dqreg.compare.trust.trial import _names_rivals, is_right
from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface, PointCloud, sample_mesh
from dqreg.rigid import pose
from dqreg.synth.parts.plain import box
from dqreg.trust.records import Direction


def distances(task: TrustTask, T: np.ndarray) -> np.ndarray:
    if isinstance(task.target, Mesh):
        return MeshSurface(task.target).closest(pose.apply(T, task.source)).distances
    from scipy.spatial import cKDTree

    return cKDTree(task.target.points).query(pose.apply(T, task.source))[0]


@pytest.mark.parametrize("name", [name for name in KINDS if not name.startswith("drive")])
def test_the_true_pose_lays_most_of_the_scan_onto_the_target(name):
    task = KINDS[name].task(3)
    assert isinstance(task, TrustTask)
    assert np.isfinite(task.source).all()
    assert len(task.source) >= 8
    if len(task.truths) and not name.startswith(("clouds", "strays-60", "on-a-table")):
        # Half of the points lie within two standard deviations; a camera's steps and flying pixels count a tenth more.
        assert np.quantile(distances(task, task.truths[0]), 0.5) <= 2.0 * task.noise
        assert is_right(task.truths[0], task) == (True, 0.0)
    assert KINDS[name].good <= bool(len(task.truths)), "a good task has a right pose"


@pytest.mark.parametrize("name", ["pegs-middle", "rack-middle", "thread-middle", "notch-unseen"])
def test_rivals_fit_as_well_as_the_truth(name):
    # The scan was moved by less than 0.1 of a period, or 8 degrees: the closest pose is found from the target's side,
    # where the truth is what the start is the inverse of. Here the rivals are asked of the target alone.
    task = KINDS[name].task(5)
    assert isinstance(task, TrustTask)
    assert isinstance(task.target, Mesh)
    points = task.target.vertices
    surface = MeshSurface(task.target)
    for rival in task.rivals:
        # All but the ends, or but the notch, comes to lie on the part again.
        assert np.mean(surface.closest(pose.apply(rival, points)).distances < 1e-6 * task.size) > 0.6


def test_a_corner_of_a_block_fits_at_each_of_its_corners_three_ways_round():
    task = KINDS["corner-of-box"].task(5)
    assert isinstance(task, TrustTask)
    assert isinstance(task.target, Mesh)
    assert len(task.rivals) == 23
    corner, edges = task.target.vertices.max(axis=0), np.ptp(task.target.vertices, axis=0)
    points = sample_mesh(task.target, 4_000, np.random.default_rng(0)).points
    points = points[np.linalg.norm(points - corner, axis=1) < 0.7 * edges.min()]
    surface = MeshSurface(task.target)
    assert len(points) > 100
    for rival in task.rivals:
        assert surface.closest(pose.apply(rival, points)).distances.max() < 1e-6 * task.size


def test_a_seed_makes_the_same_task_and_another_seed_another_part():
    one, again, other = (KINDS["two-views"].task(seed) for seed in (4, 4, 5))
    assert isinstance(one, TrustTask)
    assert isinstance(again, TrustTask)
    assert isinstance(other, TrustTask)
    assert one.source.tobytes() == again.source.tobytes()
    assert one.size != other.size


@pytest.mark.parametrize("family", [*shapes.ASYMMETRIC, shapes.plate, shapes.flange, shapes.box])
@pytest.mark.parametrize("seed", range(3))
def test_random_parts_are_closed(family, seed):
    mesh = shapes.draw(family, np.random.default_rng(seed))
    edges = np.sort(np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    # Two blocks that touch along an edge share it: four faces there.
    assert (counts % 2 == 0).all()


def test_a_drive_begins_at_its_first_frame():
    drive = KINDS["drive-pilasters"].task(0)
    assert isinstance(drive, Drive)
    np.testing.assert_allclose(drive.poses[0], np.eye(4), atol=1e-12)
    assert all(len(frame) > 1000 for frame in drive.frames)


def test_kinds_are_chosen_by_name_or_group():
    assert [kind.name for kind in kinds_named(["tree", "two-views"])] == ["two-views", "tree"]
    assert {kind.group for kind in kinds_named(["rivals"])} == {"rivals"}
    with pytest.raises(InputError, match=r"pegs-of.*pegs-off"):
        kinds_named(["pegs-of"])


def test_a_pose_is_right_where_the_part_lies_on_itself():
    task = KINDS["corner-of-box"].task(0)
    box = TrustTask(task.source, task.target, None, np.eye(4)[None], task.probes, task.size, task.noise)
    assert isinstance(task.target, Mesh)
    half_turn = pose.about(pose.from_parts(np.diag([1.0, -1.0, -1.0]), np.zeros(3)), task.target.centre)
    right, off = is_right(half_turn, box)
    assert right
    assert off > 0.1
    tilted = pose.about(pose.exp(np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0])), task.target.centre)
    assert not is_right(tilted, box)[0]
    assert not is_right(np.full((4, 4), np.nan), box)[0]
    cloud = TrustTask(task.source, PointCloud(task.probes), None, np.eye(4)[None], task.probes, task.size, task.noise)
    assert not is_right(half_turn, cloud)[0]


@pytest.mark.parametrize(
    ("free", "named"), [((0,), False), ((0, 2), True), ((1,), False), ((0, 1, 2), True), ((), False)]
)
def test_a_step_along_motions_that_are_said_to_be_free_is_named(free, named):
    """Steps rise along z and lead along x: one wall of them leaves both free, and the rotation about y."""
    task = KINDS["stairs-middle"].task(0)
    assert (np.abs(task.rivals[:, [0, 2], 3]) > 0.02 * task.size).all()
    assert not task.rivals[:, 1, 3].any()
    motions = [Direction(0.0, np.nan if k in free else 0.1, "", "translation", tuple(np.eye(3)[k])) for k in range(3)]
    motions.append(Direction(0.0, np.nan, "", "rotation", (0.0, 1.0, 0.0), tuple(task.target.centre)))
    answer = SimpleNamespace(T_target_source=task.equals[0], alternatives=[], observability=motions)
    assert _names_rivals(answer, task) == named


def test_any_other_corner_of_a_block_is_a_rival_of_the_one_that_is_answered():
    # Corners of a block with three edges are no group: what leads from one to the next leads from most others astray.
    task = KINDS["corner-of-box"].task(3)
    assert len(task.equals) == 24

    def names(answer, other):
        alternatives = [SimpleNamespace(T_target_source=other)]
        return _names_rivals(SimpleNamespace(T_target_source=answer, alternatives=alternatives, observability=()), task)

    assert all(names(task.equals[1], other) for other in task.equals[2:])
    assert names(task.equals[1], task.equals[0])
    # The answer itself, and a pose that does not fit, are none.
    assert not names(task.equals[1], task.equals[1])
    away = pose.from_parts(np.eye(3), [0.3 * task.size, 0.0, 0.0])
    assert not names(task.equals[1], away @ task.equals[2])


def test_a_pose_at_which_the_scan_lies_on_the_part_alike_is_a_rival_too():
    # Points of one face of a cube: shifted along it they lie as well, beyond its end or from within they do not.
    rng = np.random.default_rng(0)
    cube = Mesh(*box((1.0, 1.0, 1.0)))
    middle, top = cube.centre, cube.vertices[:, 2].max()
    scan = np.column_stack([middle[:2] + rng.uniform(-0.2, 0.2, (500, 2)), np.full(500, top)])
    scan += rng.normal(0.0, 1e-3, scan.shape)
    task = TrustTask(scan, cube, "identity", np.zeros((0, 4, 4)), cube.vertices, 1.0, 1e-3, equals=np.eye(4)[None])

    def names(other):
        others = [SimpleNamespace(T_target_source=other)]
        result = SimpleNamespace(T_target_source=np.eye(4), alternatives=others, observability=())
        return _names_rivals(result, task)

    along, away = (pose.from_parts(np.eye(3), [shift, 0.0, 0.0]) for shift in (0.2, 0.4))
    assert names(along)
    assert not names(away)
    half_turn = pose.about(pose.exp(np.array([np.pi, 0.0, 0.0, 0.0, 0.0, 0.0])), middle)
    assert names(half_turn)
    from_within = pose.exp(np.array([np.pi, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert not names(pose.about(from_within, [*middle[:2], top]))
    raised = pose.from_parts(np.eye(3), [0.2, 0.0, 3e-3])
    assert not names(raised)


def test_shared_noise_is_common_to_neighbours_and_to_no_others():
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0.0, 40.0, (2_000, 2)), np.zeros(2_000)])
    moved = [scans.shared_noise(points, np.array([0.0, 3.0, 4.0]), 0.1, rng) - points for _ in range(20)]
    along = np.array([field @ [0.0, 0.6, 0.8] for field in moved])
    np.testing.assert_allclose(moved[0], along[0][:, None] * [0.0, 0.6, 0.8], atol=1e-12)
    # Each field has some ten independent values: the mean square of twenty of them is good to a tenth.
    assert np.mean(along**2) == pytest.approx(0.01, rel=0.25)
    near, far = (np.argsort(np.linalg.norm(points - points[0], axis=1))[k] for k in (50, 1_999))
    agree = [np.mean(along[:, 0] * along[:, k]) / np.mean(along[:, 0] ** 2) for k in (near, far)]
    assert agree[0] > 0.6
    assert abs(agree[1]) < 0.6


def test_a_sheet_on_its_other_side_is_wrong_and_a_slide_along_it_is_not():
    task = KINDS["sheet-one-side"].task(0)
    assert isinstance(task, TrustTask)
    assert task.walls is not None
    for share, right in ((0.3, True), (1.0, False)):
        shift = pose.from_parts(np.eye(3), share * task.walls.thickness * task.walls.normals[0])
        assert is_right(shift @ task.truths[0], task)[0] == right
    # The folds are along y.
    assert is_right(pose.from_parts(np.eye(3), [0.0, 0.01 * task.size, 0.0]) @ task.truths[0], task)[0]
