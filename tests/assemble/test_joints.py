"""Joints: what they lock, what they leave free, and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmsreduce.assemble import assemble, place_bodies, rigid_response, rigid_substructure
from cmsreduce.errors import ConstraintError, SceneError, UnitsError
from cmsreduce.model import DOF_NAMES, Configuration, Placement, Point, Scene
from tests.assemble.rigs import in_joint, joint, rigid_body, substructures, turned
from tests.frames import frame, line, rotation

HINGE_AT = np.array([1.0, 0.3, -0.2])
UP = np.array([0.0, 0.0, 1.0])


def hub(**options):
    return rigid_body("hub", 5.0, [0.1, 0, 0], [1.0, 2.0, 2.5], {"h": HINGE_AT}, **options)


def vane(**options):
    return rigid_body("vane", 2.0, [2.0, 0.5, 0], [0.3, 0.4, 0.5], {"h": HINGE_AT}, **options)


def system(bodies, joints, angles=None, **options):
    configuration = Configuration("now", angles or {})
    subs = bodies if isinstance(bodies, dict) else substructures(bodies)
    scene = Scene(tuple(subs), (0.0, 1.0), tuple(joints), (configuration,), **options)
    return assemble(subs, scene, configuration)


def rotate_rigidly(subs, placed) -> np.ndarray:
    """Coordinates of rigid bodies under the six motions of the whole scene (sum m, 6)."""
    rows = []
    for name, sub in subs.items():
        Q, t = placed[name].rotation, placed[name].translation
        # Coordinates of a rigid body are the motion of its centre of mass.
        x = Q @ sub.position["cg"] + t
        S = np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])
        rows.append(np.block([[Q.T, -Q.T @ S], [np.zeros((3, 3)), Q.T]]))
    return np.vstack(rows)


@pytest.mark.parametrize("dof", range(6), ids=DOF_NAMES)
@pytest.mark.parametrize("axes", [np.eye(3), rotation([1, 2, 3], 0.7).T], ids=["basic", "own frame"])
def test_the_free_motion_is_the_one_asked_for(dof, axes):
    bodies = (hub(frame=axes), vane())
    found = system(bodies, [joint("j", "hub.h", "vane.h", DOF_NAMES[dof])])
    assert found.N == found.rigid.shape[1] == 7
    relative = np.zeros((6, 7))
    for sign, body, rows in zip((-1, 1), bodies, np.split(found.T @ found.rigid, 2), strict=True):
        arm = HINGE_AT - body.cg
        move = rows[:3] + np.cross(rows[3:], arm, axisa=0, axisc=0)
        relative += sign * np.vstack([axes @ move, axes @ rows[3:]])
    assert np.linalg.matrix_rank(relative, tol=1e-10) == 1
    others = np.delete(relative, dof, axis=0)
    assert abs(others).max() < 1e-12 < abs(relative[dof]).max()


@pytest.mark.parametrize(
    "free", ["", "rz", "x", "rx ry rz", "x rx", "x y rz", "x y z rx ry", "x y z rx ry rz"], ids=lambda f: f or "weld"
)
@pytest.mark.parametrize("kind", ["rigid bodies", "frames"])
def test_rigid_motions_are_six_and_the_free_ones(free, kind):
    if kind == "rigid bodies":
        bodies = (hub(), vane())
    else:
        bodies = (
            frame("hub", [[0, 0, 0], HINGE_AT, [0, 1, 0.5]], [(1, 2), (1, 3)], {"h": 2}),
            frame("vane", [HINGE_AT, [2, 0, 0], [2, 1, 1]], [(1, 2), (2, 3)], {"h": 1}),
        )
    found = system(bodies, [joint("j", "hub.h", "vane.h", free)])
    count = 6 + len(free.split())
    assert found.rigid.shape[1] == count
    dofs = 12 if kind == "rigid bodies" else 36
    assert dofs - 6 + len(free.split()) == found.N
    M, K = (A.toarray() if hasattr(A, "toarray") else A for A in (found.M, found.K))
    np.testing.assert_allclose(found.rigid.T @ M @ found.rigid, np.eye(count), atol=1e-10)
    assert abs(K @ found.rigid).max(initial=0.0) < 1e-9 * max(abs(K).max(), 1e-300) * abs(found.rigid).max()


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    free=st.sets(st.integers(0, 5), min_size=1),
    seed=st.integers(0, 10**6),
    offset=st.booleans(),
    reverse=st.booleans(),
)
def test_the_whole_may_move_rigidly_however_joints_are_set(free, seed, offset, reverse):
    """Slides, turns, offsets and frames of any kind leave the six motions of the whole scene free."""
    rng = np.random.default_rng(seed)
    far = HINGE_AT + (rng.uniform(-1, 1, 3) if offset else 0)
    one = hub(frame=rotation(rng.standard_normal(3), 1.0))
    two = rigid_body("vane", 2.0, [2.0, 0.5, 0], [0.3, 0.4, 0.5], {"h": far, "tip": [3.0, 1, 1]})
    three = rigid_body("tip", 1.0, [3, 2, 1], [1, 1, 1], {"h": [3.0, 1, 1]}, frame=rotation(rng.standard_normal(3), 2))
    arm = tuple(far - HINGE_AT) if offset else None
    ends = ("hub.h", "vane.h")
    if reverse:
        ends, arm = ends[::-1], None if arm is None else tuple(-x for x in arm)
    joints = [
        joint("j", *ends, " ".join(DOF_NAMES[k] for k in free), offset=arm),
        joint("k", "vane.tip", "tip.h", "y rx"),
    ]
    angles = {("j", k): rng.uniform(-1, 1) for k in free} | {("k", 1): 0.4, ("k", 3): -0.9}
    subs = substructures((one, two, three))
    scene = Scene(tuple(subs), (0.0, 1.0), tuple(joints), (Configuration("now", angles),))
    found = assemble(subs, scene, scene.configurations[0])
    whole = rotate_rigidly(subs, place_bodies(subs, scene, scene.configurations[0]))
    np.testing.assert_allclose(found.T @ (found.T.T @ whole), whole, atol=1e-11)
    assert found.N == found.rigid.shape[1] == 8 + len(free)


def moved_by(subs, scene, angles, dof, step=1e-6) -> np.ndarray:
    """Coordinates of rigid bodies under a small motion of joint ``j``, by the difference of two placements."""
    placed = [
        place_bodies(subs, scene, Configuration("near", {**angles, ("j", dof): angles[("j", dof)] + change}))
        for change in (0.0, -step, step)
    ]
    rows = []
    for name, sub in subs.items():
        now, before, after = (each[name] for each in placed)
        turn = (after.rotation - before.rotation) / (2 * step) @ now.rotation.T
        travel = (after.rotation - before.rotation) @ sub.position["cg"] + after.translation - before.translation
        rows += [now.rotation.T @ travel / (2 * step), now.rotation.T @ [turn[2, 1], turn[0, 2], turn[1, 0]]]
    return np.concatenate(rows)


@pytest.mark.parametrize("reverse", [False, True], ids=["first is inboard", "first is outboard"])
@pytest.mark.parametrize("free", ["rz", "rx ry", "rx rz", "ry rz", "x ry rz", "y z", "z rx", "x rx ry rz"])
def test_settings_of_a_turned_joint_move_as_its_constraints_allow(free, reverse):
    """A turn about the later of two axes carries the earlier one, as in a universal joint."""
    subs = substructures((hub(frame=rotation([1, 2, 3], 0.7)), vane(frame=rotation([-1, 1, 0], 1.3))))
    ends = ("vane.h", "hub.h") if reverse else ("hub.h", "vane.h")
    turning = joint("j", *ends, free)
    angles = {("j", dof): [0.2, -0.1, 0.3, 0.5, -1.1, 0.9][dof] for dof in turning.free}
    found = system(subs, [turning], angles)
    scene = Scene(tuple(subs), (0.0, 1.0), (turning,), (Configuration("now", angles),))
    allowed, _ = np.linalg.qr(found.T @ found.rigid)
    assert allowed.shape[1] == 6 + len(free.split())
    for dof in turning.free:
        motion = moved_by(subs, scene, angles, dof)
        left = motion - allowed @ (allowed.T @ motion)
        assert np.linalg.norm(left) < 1e-8 * np.linalg.norm(motion)


@pytest.mark.parametrize("angle", [0.0, 0.4, np.pi / 2, 2.8])
def test_a_pendulum_of_two_bodies(angle):
    """Torque in the hinge against the angle it makes: closed form of two free bodies hinged in a plane."""
    m1, m2, J1, J2 = 5.0, 2.0, 2.5, 0.5
    one = rigid_body("hub", m1, [0.1, 0.2, 0], [9, 9, J1], {"h": [1.0, 0.3, 0]})
    two = rigid_body("vane", m2, [2.0, 0.5, 0], [9, 9, J2], {"h": [1.0, 0.3, 0]})
    found = system(
        (one, two),
        [joint("j", "hub.h", "vane.h", "rz")],
        {("j", 5): angle},
        actuators=(in_joint("j", "rz"),),
        sensors=(in_joint("j", "rz"), in_joint("j", "x")),
    )
    a1 = np.array([0.9, 0.1])
    a2 = rotation([0, 0, 1], angle)[:2, :2] @ np.array([-1.0, -0.2])
    mu = m1 * m2 / (m1 + m2)
    inertia = np.array([[J1 + mu * a1 @ a1, -mu * a1 @ a2], [-mu * a1 @ a2, J2 + mu * a2 @ a2]])
    across = np.array([-1.0, 1.0])
    compliance = across @ np.linalg.solve(inertia, across)
    w = np.array([0.5, 3.0])
    H = rigid_response(found, w)
    np.testing.assert_allclose(H[:, 0, 0], -compliance / w**2, rtol=1e-12)
    # A locked motion does not answer.
    np.testing.assert_allclose(H[:, 1, 0], 0, atol=1e-14)


@pytest.mark.parametrize("free", [(5,), (4, 5), (3, 4, 5)], ids=["hinge", "universal", "ball"])
def test_a_grounded_pendulum(free):
    locked = tuple(k + 1 for k in range(6) if k not in free)
    body = rigid_body("bob", 3.0, [0.4, 0, 0], [0.1, 0.2, 0.3], {"pivot": [0, 0, 0], "p": [0, 0, 0]}, dofs=locked)
    found = system((body,), [], ground=(Point("bob", "pivot"),))
    assert found.N == found.rigid.shape[1] == len(free)
    # About the pivot, by Steiner.
    J = np.array([0.1, 0.2 + 3 * 0.16, 0.3 + 3 * 0.16])[[k - 3 for k in free]]
    rotations = (found.T @ found.rigid)[3:]
    np.testing.assert_allclose((rotations @ rotations.T).diagonal()[[k - 3 for k in free]], 1 / J, rtol=1e-12)


def test_an_offset_is_a_rigid_bar():
    """A body whose interface lies off is joined as if its interface lay where the other is."""
    bar = line("bar", [0, 0, 0], [1, 0, 0], 4, interfaces={"b": 5})
    far = np.array([1.0, 0.4, -0.7])
    near = rigid_body("tip", 3.0, [1.5, 0, 0], [1, 2, 2.5], {"h": [1.0, 0, 0]})
    off = rigid_body("tip", 3.0, [1.5, 0, 0], [1, 2, 2.5], {"h": far})
    lam = [
        np.linalg.eigvals(np.linalg.solve(found.M.toarray(), found.K.toarray()) if hasattr(found.M, "toarray") else
                          np.linalg.solve(found.M, found.K))
        for found in (
            system((bar, near), [joint("j", "bar.b", "tip.h")]),
            system((bar, off), [joint("j", "bar.b", "tip.h", offset=tuple(far - [1, 0, 0]))]),
            # The arm may as well belong to the rigid body.
            system((bar, off), [joint("j", "tip.h", "bar.b", offset=tuple([1, 0, 0] - far))]),
        )
    ]  # fmt: skip
    exact = np.sort(lam[0].real)
    for other in lam[1:]:
        np.testing.assert_allclose(np.sort(other.real)[6:], exact[6:], rtol=1e-8)


@settings(max_examples=15, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6))
def test_a_body_written_in_another_frame_and_placed_back_is_the_same(seed):
    rng = np.random.default_rng(seed)
    bodies = (hub(frame=rotation([1, 1, 0], 0.4)), vane())
    joints = [joint("j", "hub.h", "vane.h", "rx y")]
    channels = {
        "actuators": (in_joint("j", "rx"), in_joint("j", "y")),
        "sensors": (in_joint("j", "rx"), in_joint("j", "y")),
    }
    angles = {("j", 3): 0.8, ("j", 1): 0.3}
    w = np.array([1.0, 2.0])
    plain = rigid_response(system(bodies, joints, angles, **channels), w)
    for moved in range(2):
        Q, t = rotation(rng.standard_normal(3), rng.uniform(0, 6)), rng.uniform(-5, 5, 3)
        other, back = turned(bodies[moved], Q, t)
        pair = tuple(other if k == moved else body for k, body in enumerate(bodies))
        found = system(pair, joints, angles, placements={other.name: back}, **channels)
        np.testing.assert_allclose(rigid_response(found, w), plain, rtol=1e-10, atol=1e-13)


def four_bar():
    """A closed loop of rigid links, all hinged about z."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1.2, 1, 0], [0, 0.8, 0]])
    return [
        rigid_body(f"bar{k}", 1.0, (a + b) / 2, [0.1, 0.1, 0.1], {"a": a, "b": b})
        for k, (a, b) in enumerate(zip(corners, np.roll(corners, -1, axis=0), strict=True))
    ]


def loop(*free: str):
    return [joint(f"pin{k}", f"bar{k}.b", f"bar{(k + 1) % 4}.a", f) for k, f in enumerate(free)]


def test_a_planar_loop_locks_three_motions_twice():
    with pytest.raises(ConstraintError, match=r"3 of 20 locked motions .* already .*: pin3 z, pin3 rx, pin3 ry\. Free"):
        system(four_bar(), loop("rz", "rz", "rz", "rz"))


@pytest.mark.parametrize("free", [("rz", "rz", "rz", "rz z rx ry"), ("rz", "rz", "rx ry rz", "x y z rx ry rz")])
def test_a_loop_with_room_is_accepted(free):
    found = system(four_bar(), loop(*free))
    motions = sum(len(f.split()) for f in free)
    assert motions == found.N


def test_a_flexible_loop_may_be_welded():
    corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
    bodies = [line(f"bar{k}", corners[k], corners[(k + 1) % 3], 2) for k in range(3)]
    joints = [joint(f"j{k}", f"bar{k}.b", f"bar{(k + 1) % 3}.a") for k in range(3)]
    found = system(bodies, joints)
    assert (found.N, found.rigid.shape[1]) == (3 * 18 - 18, 6)


def test_a_body_grounded_twice_is_refused():
    body = rigid_body("bob", 3.0, [0.4, 0, 0], [0.1, 0.2, 0.3], {"a": [0, 0, 0], "b": [1, 0, 0]})
    with pytest.raises(ConstraintError, match=r"6 of 12 .*ground bob\.b x, .* ground bob\.b rz"):
        system((body,), [], ground=(Point("bob", "a"), Point("bob", "b")))


def bar(name="bar", nodes=(3,), dofs=(1, 2, 3, 4, 5, 6)):
    return line(name, [0, 0, 0], HINGE_AT, 2, interfaces={"h": (nodes, dofs)})


FAR = rigid_body("far", 1.0, [1, 0, 0], [1, 1, 1], {"h": HINGE_AT + 0.01 * UP, "mm": 1000 * HINGE_AT})
REFUSED = {
    "different dofs": (
        (bar(), bar("other", dofs=(1, 2, 3))),
        joint("j", "bar.h", "other.h"),
        SceneError,
        r"'j' locks rx, ry, rz, but only one of 'bar\.h' \(dofs 123456\) and 'other\.h' \(dofs 123\)",
    ),
    "a gap": (
        (hub(), FAR),
        joint("j", "hub.h", "far.h"),
        SceneError,
        r"'j': its interfaces lie 0\.01 apart .*'hub\.h' at \(1, 0\.3, -0\.2\).*`place:`",
    ),
    "another unit of length": (
        (hub(), FAR),
        joint("j", "hub.h", "far.mm"),
        UnitsError,
        r"'j': the coordinates of 'far\.mm' are 1000 times those of 'hub\.h', as m and mm are",
    ),
    "an unknown interface": (
        (hub(), vane()),
        joint("j", "hub.h", "vane.x"),
        SceneError,
        r"'vane\.x': component 'vane' has no interface 'x' \(it has: h\)",
    ),
    "another number of nodes": (
        (bar(), bar("other", nodes=(2, 3))),
        joint("j", "bar.h", "other.h"),
        SceneError,
        r"'j' connects 1 nodes of 'bar\.h' with 2 of 'other\.h'",
    ),
    "a hinge of many nodes": (
        (bar(nodes=(2, 3)), bar("other", nodes=(2, 3))),
        joint("j", "bar.h", "other.h", "rz"),
        SceneError,
        r"'j' has free motions but its interfaces have 2 nodes each",
    ),
    "nodes in another order": (
        (bar(nodes=(2, 3)), bar("other", nodes=(3, 2))),
        joint("j", "bar.h", "other.h"),
        SceneError,
        r"'j': its interfaces lie .*List the nodes of 'other\.h' in the order of those of .bar\.h.: nodes: \[2, 3\]",
    ),
    "a joint that locks nothing": (
        (bar(dofs=(1, 2, 3)), bar("other", dofs=(1, 2, 3))),
        joint("j", "bar.h", "other.h", "x y z"),
        SceneError,
        r"'j' locks nothing: .*\(dofs 123\).* rx, ry, rz",
    ),
    "an arm that nothing swings": (
        (
            bar(dofs=(1, 2, 3)),
            rigid_body("tip", 1.0, [1, 0, 0], [1, 1, 1], {"h": HINGE_AT + UP}, dofs=(1, 2, 3)),
        ),
        joint("j", "bar.h", "tip.h", offset=(0.0, 0.0, 1.0)),
        SceneError,
        r"'j': its interfaces lie apart.*'bar\.h' \(dofs 123\) has no rotations to swing the arm",
    ),
}  # fmt: skip


def test_the_same_dofs_of_turned_axes_are_refused_by_node_and_direction():
    """The message asked for the same dofs, which both have."""
    far = rigid_body("far", 1.0, [1, 0, 0], [1, 1, 1], {"h": [0, 0, 0]}, dofs=(2, 6))
    placed = {"far": Placement(rotation(UP, 0.5), HINGE_AT)}
    words = r"'j' locks y along \(0, 1, 0\), .*: node 3 and a position have dofs 26 both, but of axes that are turned"
    with pytest.raises(SceneError, match=words):
        system((bar(dofs=(2, 6)), far), [joint("j", "bar.h", "far.h", "rz")], placements=placed)


@pytest.mark.parametrize(("bodies", "bad", "error", "message"), REFUSED.values(), ids=REFUSED)
def test_refused(bodies, bad, error, message):
    with pytest.raises(error, match=message):
        system(bodies, [bad])


def test_a_gap_along_a_free_slide_is_no_setting():
    """Interfaces must coincide as built, slide or not: the slide's length is an articulation."""
    with pytest.raises(SceneError, match=r"lie 0\.01 apart"):
        system((hub(), FAR), [joint("j", "hub.h", "far.h", "z")])


def test_a_placed_body_may_close_the_gap():
    found = system(
        (hub(), FAR),
        [joint("j", "hub.h", "far.h", "rz")],
        placements={"far": Placement(np.eye(3), np.array([0, 0, -0.01]))},
    )
    assert found.rigid.shape[1] == 7


def test_a_loop_that_a_setting_tears_is_refused():
    bodies = {body.name: rigid_substructure(body) for body in four_bar()}
    with pytest.raises(SceneError, match=r"closes a loop.* leave .*they fit at"):
        system(bodies, loop("rz", "rz", "rz", "rz z rx ry"), {("pin0", 5): 0.3})
