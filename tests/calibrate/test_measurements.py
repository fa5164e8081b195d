"""What lies between sensor and model: frames, scales, offsets per session, delays, variables that nobody measured."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel.calibrate import Choice, Correction, Measurements, Pose, calibrate, prepare
from gtmodel.inference import Prior
from gtmodel.measurements import Corrections, Session, Signal
from gtmodel.results import Trajectory
from tests.calibrate.synthetic import GEOMETRY, disturbed, geometry, measured, poses, true_robot

RECOVERED = 1e-9  # m, 1 or rad: as in test_recovery
GEO = ("A", "v", "L", "B")


def rotation(u: np.ndarray) -> Rotation:
    return Rotation.from_quat(np.asarray(u), scalar_first=True)


def seen_by_a_device(kind: str, number: int) -> tuple[Measurements, dict[str, np.ndarray]]:
    """Poses as a tracker elsewhere sees a target beside T, with the frames that were used (scipy's rotations)."""
    data = poses(kind, number)
    t_d, u_d = np.array([0.3, -1.2, 0.5]), Rotation.from_rotvec([0.4, -0.3, 0.8])
    values = dict(data)
    if kind == "three_link":
        values["T"] = u_d.inv().apply(data["T"] - t_d)
        return Measurements(values, poses=[Pose("T", device=True)]), {"t": t_d, "u": u_d.as_quat(scalar_first=True)}
    t_t, u_t = np.array([0.05, 0.02, -0.1]), Rotation.from_rotvec([0.2, 0.5, -0.1])
    R = rotation(data["e"])
    target = R * u_t.inv()  # orientation of the target in the robot's frame: R = target * u_t
    values["T"] = u_d.inv().apply(data["T"] - target.apply(t_t) - t_d)
    values["e"] = (u_d.inv() * target).as_quat(scalar_first=True)
    return (
        Measurements(values, poses=[Pose("T", "e", device=True, target=True)]),
        {"t": t_d, "u": u_d.as_quat(scalar_first=True), "tt": t_t, "ut": u_t.as_quat(scalar_first=True)},
    )


def numbers(c, name: str, size: int) -> np.ndarray:
    return np.array([c.values[f"{name}[{k}]"] for k in range(size)])


def test_the_frame_of_a_tracker_is_found_for_a_known_robot():
    m, frame = seen_by_a_device("three_link", 20)
    c = calibrate(true_robot("three_link"), m, Choice(fixed=("A", "v", "L")))
    assert c.status.ok and c.problem.unknowns.names[3:] == tuple(f"T.device.u turned about {a}" for a in "xyz")
    np.testing.assert_allclose(numbers(c, "T.device.t", 3), frame["t"], atol=RECOVERED)
    np.testing.assert_allclose(numbers(c, "T.device.u", 4), frame["u"], atol=RECOVERED)


def test_frames_of_device_and_target_are_found_where_the_pose_is_measured():
    m, frame = seen_by_a_device("f1", 40)
    c = calibrate(true_robot("f1"), m, Choice(fixed=("A0", "v", "L", "A", "B", "u1_2", "u1_3", "u2_3", "r3")))
    assert c.status.ok and len(c.x) == 12
    for name, expected in (("device.t", "t"), ("device.u", "u"), ("target.t", "tt"), ("target.u", "ut")):
        np.testing.assert_allclose(numbers(c, f"T.{name}", len(frame[expected])), frame[expected], atol=RECOVERED)


def test_a_free_frame_beside_a_free_robot_is_six_gauges_and_priors_hold_them():
    m, _ = seen_by_a_device("three_link", 30)
    p = prepare(true_robot("three_link"), m)
    assert len(p.unknowns.names) == 27 and p.identifiability().redundant == 6
    held = Choice(priors=[Prior(n, v, 1e-3) for n, v in geometry(true_robot("three_link"), ("A", "v")).items()])
    with_noise = Measurements(m.values, {"q": 1e-5, "T": 5e-5}, poses=m.poses)
    c = calibrate(true_robot("three_link"), with_noise, held)
    assert c.estimate is not None and not c.estimate.undetermined
    assert max(abs(c.values[n] - v) for n, v in geometry(true_robot("three_link"), ("A", "v")).items()) < 1e-7


def test_offsets_of_each_session_a_scale_and_a_delay_are_found():
    data = poses("three_link", 60)
    rate = np.random.default_rng(0).uniform(-0.2, 0.2, (60, 3))
    sessions = ["monday"] * 30 + ["friday"] * 30
    offset = {"monday": np.array([1e-3, -2e-3, 0.5e-3]), "friday": np.array([-1e-3, 1e-3, 3e-3])}
    scale = np.array([1.002, 0.998, 1.001])
    shift = np.array([offset[s] for s in sessions])
    values = {"T": data["T"], "q": (data["q"] + shift) / scale - 0.004 * rate, "der(q)": rate}
    m = Measurements(values, sessions=sessions, corrections=[Correction("q", offset=True, scale=True, delay=True)])
    c = calibrate(true_robot("three_link"), m, Choice(fixed=("A", "v", "L")))
    assert c.status.ok and len(c.x) == 1 + 3 + 6
    assert c.values["q.delay"] == pytest.approx(0.004, abs=RECOVERED)
    np.testing.assert_allclose(numbers(c, "q.scale", 3), scale, atol=RECOVERED)
    for s, expected in offset.items():
        np.testing.assert_allclose([c.values[f"q.offset in {s}[{k}]"] for k in range(3)], expected, atol=RECOVERED)


def test_an_offset_has_the_sign_that_it_has_in_a_log():
    """The number found, given to a log's signal, makes the cart positions of the log those of the model."""
    data, read = poses("three_link", 30), 2e-3
    m = Measurements({**data, "q": data["q"] + read}, corrections=[Correction("q", offset=True)])
    c = calibrate(true_robot("three_link"), m, Choice(fixed=("A", "v", "L")))
    at = np.arange(30.0)
    log = Session("", Trajectory(at, {"q": data["q"][:, 0] + read}), 1.0)
    (corrected,) = Corrections({"q": Signal("q", "m", offset=c.values["q.offset[0]"])}, [log]).apply()
    assert c.values["q.offset[0]"] == pytest.approx(read, abs=RECOVERED)
    inside = np.searchsorted(at, corrected.trajectory.time)
    np.testing.assert_allclose(corrected.trajectory["q"], data["q"][inside, 0], atol=RECOVERED)


def test_a_scale_of_the_carts_is_the_length_of_v():
    m = Measurements(poses("three_link", 30), corrections=[Correction("q", scale=True)])
    identified = prepare(true_robot("three_link"), m).identifiability(keep=["v"])
    assert identified.redundant == 3
    assert all(any(n.startswith(("v[", "q.scale")) for n in d.weights) for d in identified.null)


def test_positions_alone_calibrate_six_links_with_the_orientation_latent():
    """Three equations a pose are left of six; what misses the measured T is given with the orientation eliminated."""
    true = true_robot("six_link")
    data = poses("six_link", 60)
    m = Measurements({"q": data["q"], "T": data["T"]}, {"q": 1e-6, "T": 1e-6})
    start = disturbed(true, ("L",), 5e-4, 9)
    c = calibrate(start, m, Choice(free=("L",)), cost="orthogonal", latent=("e",))
    assert c.status.ok and c.estimate is not None and c.estimate.degrees_of_freedom == 60 * 3 - 6
    assert max(abs(c.values[n] - v) for n, v in geometry(true, ("L",)).items()) < RECOVERED
    np.testing.assert_allclose(c.positioning_errors()["T"], 0.0, atol=RECOVERED)


def test_three_and_six_dimensional_noise_may_differ_from_pose_to_pose():
    noise = np.array([np.diag([1e-10, 4e-10, 1e-8])] * 20 + [np.diag([1e-8] * 3)] * 20)
    rng = np.random.default_rng(3)
    data = dict(poses("three_link", 40))
    data["T"] = data["T"] + np.einsum("kij,kj->ki", np.sqrt(noise), rng.standard_normal((40, 3)))
    m = Measurements(data, {"q": 1e-6, "T": noise})
    c = calibrate(true_robot("three_link"), m, cost="orthogonal")
    assert c.estimate is not None and 0.8 < c.estimate.noise < 1.2
    part = m.part(np.arange(40) >= 20)
    assert len(part) == 20 and np.asarray(part.noise["T"]).shape == (20, 3, 3)
    assert c.on(part).shape == (20, 3)


@pytest.mark.parametrize(
    ("values", "more", "sentence"),
    [
        ({"T": np.zeros((4, 3))}, {}, "the actuators 'q' are not among the measured T"),
        ({"q": np.zeros((4, 3)), "T": np.zeros((5, 3))}, {}, "'T' has 5 rows and 'q' 4; give one per pose"),
        ({"q": np.zeros((4, 2)), "T": np.zeros((4, 3))}, {}, "'q' has 2 columns; the model's variable has 3"),
        ({"q": np.full((4, 3), np.nan), "T": np.zeros((4, 3))}, {}, "'q' is not finite at pose 0"),
        ({"q": 1.0}, {}, "'q' is one number; expected an array"),
        ({}, {}, "there are no measurements"),
        ({"q": np.zeros((4, 3))}, {"sessions": ["a"]}, "1 sessions for 4 poses"),
        (None, {"corrections": [Correction("p")]}, "a correction names 'p', which is not a signal"),
        (None, {"corrections": [Correction("q", delay=True)]}, r"needs its rate among the values, named 'der\(q\)'"),
        (None, {"poses": [Pose("X")]}, "a pose names 'X', which is not measured; found q, T"),
        (None, {"poses": [Pose("T", target=True)]}, "the target of 'T' needs a measured orientation"),
    ],
)
def test_wrong_measurements_get_a_sentence(values, more, sentence):
    with pytest.raises(gt.ModelError, match=sentence):
        prepare(true_robot("three_link"), Measurements(poses("three_link", 5) if values is None else values, **more))


@pytest.mark.parametrize(
    ("choice", "sentence"),
    [
        (Choice(free=("a",)), "no parameter 'a'; did you mean|no parameter 'a'; they contain A, v, L"),
        (Choice(free=("m_p",)), "no parameter 'm_p'"),
        (Choice(fixed=("A", "v", "L")), "no parameter of .* is free"),
        (Choice(tied={"v[1]": "v[0]"}), ""),
        (Choice(tied={"v[1]": "L"}), r"'v\[1,0\]' in 1 is tied to 'L\[0\]' in m"),
        (Choice(tied={"v[1]": "A"}), r"'v\[1\]' with 3 numbers is tied to 'A' with 9"),
        (Choice(tied={"L[0]": "L[1]", "L[1]": "L[0]"}), r"'L\[0\]' is tied to itself in a circle"),
        (Choice(fixed=("u turned about x",)), "'u turned about x' is fixed, but 'u' is not listed"),
        (Choice(unit=("v[0]",)), r"unit names 'v\[0\]' with 3 numbers"),
        (Choice(priors=[Prior("L[7]", 1.0, 1.0)]), r"a prior names 'L\[7\]', which is not free"),
        (Choice(sizes={"L": 0.0}), "the expected error of 'L' is 0; it must be positive"),
    ],
)
def test_wrong_choices_get_a_sentence(choice, sentence):
    if not sentence:
        assert len(prepare(true_robot("three_link"), Measurements(poses("three_link", 5)), choice).unknowns.names) == 18
        return
    with pytest.raises(gt.ModelError, match=sentence):
        prepare(true_robot("three_link"), Measurements(poses("three_link", 5)), choice)


def test_wrong_calls_get_a_sentence():
    robot, m = true_robot("three_link"), measured("three_link", 5, {"q": 1e-5}, 0)
    with pytest.raises(gt.ModelError, match="there is no cost 'lenght'; choose one of: squared, length"):
        calibrate(robot, m, cost="lenght")
    few = calibrate(robot, m)  # 15 equations for 21 unknowns: said, not refused
    assert few.estimate is None and few.identifiability is not None and few.identifiability.rank == 15
    assert few.message.endswith("but no degrees of freedom are left to estimate their errors")
    with pytest.raises(gt.ModelError, match="do not determine"):
        calibrate(robot, m, hold_undetermined=False)
    with pytest.raises(gt.ModelError, match="start names 'x', which is not free"):
        calibrate(robot, m, start={"x": 1.0})
    with pytest.raises(gt.ModelError, match="the noise of 'q' must be positive"):
        calibrate(robot, Measurements(poses("three_link", 30), {"q": 0.0, "T": 1.0}))
    with pytest.raises(gt.ModelError, match="state the noise of measured signals"):
        calibrate(robot, Measurements(poses("three_link", 30)), cost="orthogonal")
    with pytest.raises(gt.ModelError, match="the stated noise can close 1 of the 2 equations of a pose"):
        calibrate(true_robot("six_link"), Measurements(poses("six_link", 30)), cost="inverse")
    with pytest.raises(gt.ModelError, match="priors are weighted against the noise: state that of T"):
        calibrate(robot, measured("three_link", 30, {"q": 1e-5}, 0), Choice(priors=[Prior("L[0]", 2.0, 1e-3)]))


def test_sizes_and_geometry_of_a_choice_are_by_name():
    u = prepare(
        disturbed(true_robot("three_link"), GEOMETRY["three_link"], 1e-3, 0),
        Measurements(poses("three_link", 5)),
        Choice(free=("A[0]", "L"), fixed=("L[2]",), sizes={"L": 1e-4, "A[0,1]": 5e-3}),
    ).unknowns
    assert dict(zip(u.names, u.sizes, strict=True)) == pytest.approx(
        {"A[0,0]": 1e-3, "A[0,1]": 5e-3, "A[0,2]": 1e-3, "L[0]": 1e-4, "L[1]": 1e-4}
    )
    assert u.units == ("m",) * 5


def two_set_ups(**more) -> tuple[Measurements, list[tuple[np.ndarray, Rotation]]]:
    """Two recordings of one robot, between which the device was moved."""
    data = poses("three_link", 40)
    frames = [(np.array([0.3, -1.2, 0.5]), Rotation.from_rotvec([0.4, -0.3, 0.8])),
              (np.array([-0.8, 0.4, 0.1]), Rotation.from_rotvec([0.1, 0.6, -0.5]))]  # fmt: skip
    T = np.vstack([u.inv().apply(part - t) for (t, u), part in zip(frames, np.split(data["T"], 2), strict=True)])
    pose = Pose("T", device=True, device_per_session=True, **more)
    return Measurements({"q": data["q"], "T": T}, sessions=["first"] * 20 + ["second"] * 20, poses=[pose]), frames


def test_each_session_has_the_frame_of_its_device():
    m, frames = two_set_ups()
    c = calibrate(true_robot("three_link"), m, Choice(fixed=("A", "v", "L")))
    assert c.status.ok and len(c.x) == 12
    for name, (t, u) in zip(("first", "second"), frames, strict=True):
        np.testing.assert_allclose(numbers(c, f"T.device.t in {name}", 3), t, atol=RECOVERED)
        np.testing.assert_allclose(numbers(c, f"T.device.u in {name}", 4), u.as_quat(scalar_first=True), atol=RECOVERED)
    # geometry from both: one frame is a choice of coordinates, the other follows
    t, u = frames[0]
    starts = {s: (f[0], f[1].as_quat(scalar_first=True)) for s, f in zip(("first", "second"), frames, strict=True)}
    known = two_set_ups(device_starts=starts)[0]
    both = calibrate(disturbed(true_robot("three_link"), ("L",), 1e-3, 5), known, Choice(fixed=("A", "v")))
    true = geometry(true_robot("three_link"), ("L",))
    assert max(abs(both.values[n] - v) for n, v in true.items()) < RECOVERED
    # poses of the second session alone are judged by the parameters of both
    assert np.abs(c.on(m.part(np.arange(20, 40)))).max() < RECOVERED
    with pytest.raises(gt.ModelError, match="session 'third' is unknown; the problem has: first, second"):
        c.on(Measurements(m.values, sessions=["third"] * 40, poses=m.poses))


def test_a_load_that_varies_determines_the_sag_and_a_constant_one_does_not():
    data, k = poses("three_link", 40), 2e-6
    load = np.where(np.arange(40) % 2, 200.0, 0.0)
    T = data["T"] - k * load[:, None] * np.array([0.0, 0.0, 1.0])  # downwards
    m = Measurements({"q": data["q"], "T": T, "load(T)": load}, poses=[Pose("T", sag=True)])
    c = calibrate(disturbed(true_robot("three_link"), ("L",), 1e-3, 5), m)
    true = geometry(true_robot("three_link"), GEOMETRY["three_link"])
    assert c.values["T.sag"] == pytest.approx(k, rel=1e-7)
    assert max(abs(c.values[n] - v) for n, v in true.items()) < RECOVERED
    force = load[:, None] * np.array([0.0, 0.0, -1.0])
    same = calibrate(true_robot("three_link"), Measurements({**m.values, "load(T)": force}, poses=m.poses))
    assert same.values["T.sag"] == pytest.approx(k, rel=1e-7)
    constant = Measurements({**m.values, "load(T)": np.full(40, 200.0)}, poses=m.poses)
    identified = prepare(true_robot("three_link"), constant).identifiability()
    assert identified.redundant == 1 and any("T.sag" in s and "A[0,2]" in s for s in identified.notes)
    given = Measurements({**m.values}, poses=[Pose("T", sag=True, sag_start=k)])
    held = calibrate(true_robot("three_link"), given, Choice(fixed=("T.sag",)))
    assert "T.sag" not in held.problem.unknowns.names and np.abs(held.residuals).max() < RECOVERED
    with pytest.raises(gt.ModelError, match=r"the sag of 'T' needs the load in N among the values, named 'load\(T\)'"):
        prepare(true_robot("three_link"), Measurements(data, poses=[Pose("T", sag=True)]))
