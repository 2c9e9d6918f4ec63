"""Every service and every parameter, including their refusals."""

import os
import signal
import time

import kinematics
import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion
from multipanda_msgs.msg import ObjectPoses, RobotState, Switch
from multipanda_msgs.srv import (
    ListArms,
    ListControllets,
    ListFeatures,
    PlaceObjects,
    RecoverFromError,
    ResumeArms,
    SetCartesianStiffness,
    SetCollisionBehavior,
    SetFeatures,
    SetGuidingMode,
    SetJointStiffness,
    SetLoad,
    SetStiffnessFrame,
    SetToolFrame,
    StepSimulation,
    StopArms,
    SwitchControllets,
)
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters, SetParametersAtomically
from ros_case import ARMS, RosCase, nanoseconds
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool, Trigger

NODE = "/multipanda"
UNIT = Quaternion(w=1.0)


def number(name, value):
    return Parameter(name=name, value=ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value))


def numbers(name, values):
    return Parameter(
        name=name, value=ParameterValue(type=ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=values)
    )


def word(name, value):
    return Parameter(name=name, value=ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value))


class ModeServices(RosCase):
    def test_lists(self):
        arms = {a.name: a for a in self.call(ListArms, f"{NODE}/list_arms").arms}
        self.assertEqual(sorted(arms), sorted(ARMS))
        self.assertEqual(
            (arms["left"].owner, arms["left"].base_frame, arms["left"].has_gripper, arms["left"].period),
            ("left_pose", "left_link0", True, 0.001),
        )
        infos = {c.name: c for c in self.call(ListControllets, f"{NODE}/list_controllets").controllets}
        self.assertEqual({name for name, info in infos.items() if info.active}, {"left_pose", "right_pose"})
        self.assertEqual(list(infos["dual"].arms), ["left", "right"])
        (pose,) = infos["left_pose"].inputs
        self.assertEqual(
            (pose.topic, pose.type, pose.frame, pose.timeout),
            (f"{NODE}/left_pose/pose", "geometry_msgs/msg/PoseStamped", "world", 2.0),
        )
        self.assertEqual(sorted(pose.frames), ["left_link0", "right_link0", "world"])
        self.assertEqual(
            {c.name for c in self.call(ListControllets, f"{NODE}/get_controllers").controllets}, set(infos)
        )
        features = self.call(ListFeatures, f"{NODE}/list_features", instance="left_pose").features
        self.assertEqual([f.name for f in features if f.on], ["joint_limits"])
        everything = self.call(ListFeatures, f"{NODE}/list_features").features
        self.assertGreater({f.instance for f in everything}, {"left_pose"})
        self.assertEqual(list(self.call(ListFeatures, f"{NODE}/list_features", instance="nobody").features), [])

    def test_switch(self):
        begin = time.monotonic_ns()
        response = self.switch("left_joint")
        end = time.monotonic_ns()
        self.assertTrue(response.accepted)
        self.assertEqual(
            (list(response.started), list(response.stopped), list(response.kept), list(response.arms)),
            (["left_joint"], ["left_pose"], ["right_pose"], ["left"]),
        )
        self.assertTrue(begin < response.first_torque_ns < end)  # one clock on this computer
        self.assertTrue(0 < response.computing_s < response.total_s <= (end - begin) * 1e-9)
        self.assertAlmostEqual(response.waiting_s + response.computing_s, response.total_s, delta=1e-6)
        self.assertLess(response.torque_step[0], 1.0)
        self.assertGreaterEqual(self.owned("left", "left_joint").cycle, response.cycle)

    def test_switch_of_both_arms_and_by_the_name_of_the_reference_system(self):
        response = self.switch("dual")
        self.assertEqual((list(response.arms), list(response.started)), (list(ARMS), ["dual"]))
        response = self.call(SwitchControllets, f"{NODE}/set_controllers", activate=["left_guide"])
        self.assertEqual((response.accepted, list(response.stopped)), (True, ["dual"]))
        self.owned("left", "left_guide")
        self.owned("right", "right_hold")

    def test_refused_switches_change_nothing(self):
        switches = self.topic(Switch, f"{NODE}/switch_events", latched=True)
        for request, verdict, expected in [
            ({"activate": ["left_pose", "dual"]}, "two_owners", ["'left_pose' and 'dual'", "left"]),
            ({"activate": ["left_pos"]}, "unknown_instance", ["left_pos", "left_pose"]),
            ({"activate": ["x" * 5000]}, "unknown_instance", ["xxx"]),
            ({}, "malformed", ["activate"]),
            ({"activate": ["dual"], "deactivate": ["dual"]}, "malformed", ["dual"]),
        ]:
            response = self.call(SwitchControllets, f"{NODE}/switch_controllets", **request)
            self.assertEqual(response.verdict, verdict)
            self.refused(response, *expected)
            self.assertLess(len(response.reason), 500)
        self.assertEqual({self.state(arm).owner for arm in ARMS}, {"left_pose", "right_pose"})
        self.assertIsNotNone(switches.newest())

    def test_features(self):
        def on():
            return {
                f.name for f in self.call(ListFeatures, f"{NODE}/list_features", instance="left_pose").features if f.on
            }

        def ask(features, values, instance="left_pose"):
            return self.call(SetFeatures, f"{NODE}/set_features", instance=instance, features=features, on=values)

        self.assertTrue(ask(["joint_limits"], [False]).accepted)
        self.assertEqual(on(), set())
        self.assertTrue(ask(["joint_limits", "manipulability"], [True, True]).accepted)
        self.assertEqual(on(), {"joint_limits", "manipulability"})
        self.assertTrue(ask(["manipulability"], [False]).accepted)
        for response, verdict in [
            (ask(["joint_limit"], [True]), "unknown_feature"),
            (ask(["joint_limits"], []), "malformed"),
            (ask(["joint_limits"], [True], "nobody"), "unknown_instance"),
        ]:
            self.assertEqual((response.accepted, response.verdict), (False, verdict))
        self.assertEqual(on(), {"joint_limits"})

    def test_stop_and_resume(self):
        stopped = self.call(StopArms, f"{NODE}/stop", arms=["left"])
        self.assertTrue(stopped.accepted)
        self.assertEqual(list(stopped.stopped), ["left"])
        self.assertTrue(self.owned("left", "left_hold").stopped)
        self.assertEqual(self.state("right").owner, "right_pose")  # the other arm continues
        refused = self.switch("left_pose")
        self.assertEqual(refused.verdict, "arm_stopped")
        self.refused(refused, "left", "resume")
        seen = self.owned("left", "left_hold").stops
        wrong = self.call(StopArms, f"{NODE}/stop", arms=["lef"])
        self.assertEqual(self.call(ResumeArms, f"{NODE}/resume", stops=seen).verdict, "arm_stopped")
        self.assertEqual((wrong.accepted, list(wrong.stopped)), (True, ["left", "right"]))
        self.assertIn("there is no arm 'lef'", wrong.reason)
        self.assertEqual(self.call(ResumeArms, f"{NODE}/resume", arms=["middle"]).verdict, "unknown_arm")
        self.assertTrue(self.call(ResumeArms, f"{NODE}/resume").accepted)  # all
        self.wait(lambda: not self.states("left").newest().stopped, "the end of the stop")
        self.assertEqual(self.state("left").owner, "left_hold")
        self.switched("left_pose", "right_pose")

    def test_nothing_acts_that_was_asked_while_the_run_stood_still(self):
        self.call(SwitchControllets, f"{NODE}/switch_controllets", only=True)
        services = [
            (ResumeArms, f"{NODE}/resume", {}),
            (SwitchControllets, f"{NODE}/switch_controllets", {"activate": ["left_pose", "right_pose"]}),
            (SetBool, "/left/set_user_stop", {"data": False}),
            (SetBool, "/right/set_user_stop", {"data": True}),  # what ends a motion counts
        ]
        clients = [self.client.made(self.client.node.create_client, kind, name) for kind, name, _ in services]
        for client in clients:
            self.assertTrue(client.wait_for_service(30))
        os.kill(self.run_.process.pid, signal.SIGSTOP)
        try:
            asked = [client.call_async(kind.Request(**fields)) for client, (kind, _, fields) in zip(clients, services)]
            time.sleep(2)
        finally:
            os.kill(self.run_.process.pid, signal.SIGCONT)
        for future in asked:
            self.wait(future.done, "an answer")
        answers = [future.result() for future in asked]
        self.assertEqual([answer.verdict for answer in answers[:2]], ["timeout", "timeout"])
        self.assertRegex(answers[2].message, "stalled|too old")
        self.assertTrue(answers[3].success, answers[3].message)
        self.owned("left", "left_hold")
        self.wait(lambda: self.states("left").newest().stopped, "a state of after the stop")
        time.sleep(0.5)  # what may wait for a while longer
        self.assertEqual(self.state("left").mode, RobotState.MODE_MOVE)
        self.assertEqual(self.state("right").mode, RobotState.MODE_USER_STOPPED)
        self.recover_all()
        self.switched("left_pose", "right_pose")
        for client in clients:
            self.client.made(self.client.node.destroy_client, client)


class Parameters(RosCase):
    STIFFNESS = "left_pose.translational_stiffness_n_per_m"

    def get(self, *names):
        return self.call(GetParameters, f"{NODE}/get_parameters", names=list(names)).values

    def set(self, *parameters):
        return self.call(SetParameters, f"{NODE}/set_parameters", parameters=list(parameters)).results

    def set_all(self, *parameters):
        return self.call(
            SetParametersAtomically, f"{NODE}/set_parameters_atomically", parameters=list(parameters)
        ).result

    def test_names_and_descriptors(self):
        names = self.call(ListParameters, f"{NODE}/list_parameters").result.names
        info = next(
            c for c in self.call(ListControllets, f"{NODE}/list_controllets").controllets if c.name == "left_pose"
        )
        self.assertLess(set(info.parameters), set(names))
        some = self.call(ListParameters, f"{NODE}/list_parameters", prefixes=["left_pose"]).result.names
        self.assertEqual(set(some), set(info.parameters))
        asked = [self.STIFFNESS, "left_pose.projector", "left_pose.damping_ratio", "left_pose.acceleration_feedforward"]
        array, choice, one, switch = self.call(
            DescribeParameters, f"{NODE}/describe_parameters", names=asked
        ).descriptors
        self.assertEqual(
            [d.type for d in (array, choice, one, switch)],
            [
                ParameterType.PARAMETER_DOUBLE_ARRAY,
                ParameterType.PARAMETER_STRING,
                ParameterType.PARAMETER_DOUBLE,
                ParameterType.PARAMETER_BOOL,
            ],
        )
        self.assertEqual(
            (array.floating_point_range[0].from_value, array.floating_point_range[0].to_value), (0.0, 5000.0)
        )
        self.assertIn("N/m", array.additional_constraints)
        self.assertIn("paper_pseudoinverse", choice.additional_constraints)
        self.assertTrue(all(d.description for d in (array, choice, one, switch)))

    def test_values_are_set_reported_and_in_force(self):
        events = self.topic(ParameterEvent, "/parameter_events")
        new = [500.0, 600.0, 700.0]
        (result,) = self.set(numbers(self.STIFFNESS, new))
        self.assertTrue(result.successful, result.reason)
        self.assertEqual(list(self.get(self.STIFFNESS)[0].double_array_value), new)
        event = events.wait(
            lambda m: m.node == NODE and any(p.name == self.STIFFNESS for p in m.changed_parameters), "the change"
        )
        self.assertEqual(list(event.changed_parameters[0].value.double_array_value), new)
        self.assertTrue(self.set(number(self.STIFFNESS, 400.0))[0].successful)  # one number sets all
        self.assertEqual(list(self.get(self.STIFFNESS)[0].double_array_value), [400.0] * 3)
        self.assertTrue(self.set(word("left_pose.projector", "paper_pseudoinverse"))[0].successful)
        self.assertEqual(self.get("left_pose.projector")[0].string_value, "paper_pseudoinverse")
        self.assertTrue(self.set(word("left_pose.projector", "dynamic"))[0].successful)

    def test_bad_values_are_refused_with_reasons(self):
        before = list(self.get(self.STIFFNESS)[0].double_array_value)
        for parameter, expected in [
            (numbers(self.STIFFNESS, [1.0, 2.0, 6000.0]), ["5000"]),
            (numbers(self.STIFFNESS, [1.0, float("nan"), 1.0]), []),
            (numbers(self.STIFFNESS, [1.0, 2.0]), ["3"]),
            (word(self.STIFFNESS, "stiff"), ["number"]),
            (word("left_pose.projector", "paper"), ["dynamic", "paper_pseudoinverse"]),
            (number("left_pose.stiffnes", 1.0), ["stiffnes"]),
            (number("nobody.damping_ratio", 1.0), ["nobody"]),
        ]:
            (result,) = self.set(parameter)
            self.assertFalse(result.successful, parameter)
            self.assertTrue(result.reason)
            for each in expected:
                self.assertIn(each, result.reason)
        self.assertEqual(list(self.get(self.STIFFNESS)[0].double_array_value), before)
        self.assertEqual(self.get("nobody.x")[0].type, ParameterType.PARAMETER_NOT_SET)

    def test_atomic_sets_are_all_or_none(self):
        good, bad = numbers(self.STIFFNESS, [300.0] * 3), number("left_pose.damping_ratio", 9.0)
        result = self.set_all(good, bad)
        self.assertFalse(result.successful)
        self.assertIn("damping_ratio", result.reason)
        self.assertEqual(list(self.get(self.STIFFNESS)[0].double_array_value), [400.0] * 3)
        one, other = self.set(good, bad)  # each by itself
        self.assertEqual((one.successful, other.successful), (True, False))
        self.assertTrue(
            self.set_all(numbers(self.STIFFNESS, [400.0] * 3), number("left_pose.damping_ratio", 1.0)).successful
        )
        self.assertEqual(list(self.get(self.STIFFNESS)[0].double_array_value), [400.0] * 3)


class ArmServices(RosCase):
    def changed(self, arm, look, what):
        states = self.states(arm)
        return self.wait(lambda: states.newest() and look(states.newest()), what)

    def test_load(self):
        inertia = [0.01, 0.0, 0.0, 0.0, 0.02, 0.0, 0.0, 0.0, 0.02]
        response = self.call(
            SetLoad, "/left/set_load", mass=0.4, center_of_mass=[0.0, 0.01, 0.05], load_inertia=inertia
        )
        self.assertTrue(response.success, response.error)
        self.changed(
            "left",
            lambda s: abs(s.load.mass - 0.4) < 1e-12 and abs(s.load.center.z - 0.05) < 1e-12,
            "the load in the state",
        )
        for fields in (
            {"mass": -1.0},
            {"mass": 0.5, "center_of_mass": [float("nan")] * 3},
            {"mass": 1.0, "load_inertia": [1.0, 0.5, *[0.0] * 7]},
        ):
            response = self.call(SetLoad, "/left/set_load", **fields)
            self.assertEqual((response.success, bool(response.error)), (False, True), fields)
        self.assertTrue(self.call(SetLoad, "/left_param_service_server/set_load", mass=0.0).success)  # the old name
        self.changed("left", lambda s: s.load.mass == 0, "no load in the state")

    def test_frames(self):
        # Frames are set while no controllet is active, since a controller would take a new end effector for a jump of
        # the arm.
        self.assertTrue(self.switch(deactivate=["right_pose"]).accepted)
        version = self.state("right").config_version
        shifted = Pose(position=Point(z=0.1034), orientation=UNIT)
        before = self.state("right")
        for service, name, part in (
            (SetToolFrame, "set_tool_frame", "end_effector"),
            (SetStiffnessFrame, "set_stiffness_frame", "stiffness"),
        ):
            response = self.call(service, f"/right/{name}", pose=shifted)
            self.assertTrue(response.success, response.error)
            self.changed("right", lambda s, p=part: abs(getattr(s, p).position.z - 0.1034) < 1e-9, name)
            refused = self.call(service, f"/right/{name}", pose=Pose())  # a quaternion of length 1 by default: w = 1
            refused = self.call(service, f"/right/{name}", pose=Pose(orientation=Quaternion(w=0.5)))
            self.refused(refused, "quaternion")
        self.assertGreater(self.state("right").config_version, version)
        self.assertTrue(self.call(SetToolFrame, "/right/set_tool_frame", pose=before.end_effector).success)
        self.assertTrue(self.call(SetStiffnessFrame, "/right/set_stiffness_frame", pose=before.stiffness).success)
        self.changed(
            "right",
            lambda s: s.end_effector == before.end_effector and s.stiffness == before.stiffness,
            "the earlier frames",
        )

    def test_stiffness_and_thresholds(self):
        for service, name, key, good in (
            (SetJointStiffness, "set_joint_stiffness", "joint_stiffness", [3000.0] * 7),
            (SetCartesianStiffness, "set_cartesian_stiffness", "cartesian_stiffness", [1000.0] * 3 + [100.0] * 3),
        ):
            response = self.call(service, f"/left/{name}", **{key: good})
            self.assertTrue(response.success or response.error, name)  # a simulated arm may have no such controller
            wrong = self.call(service, f"/left/{name}", **{key: [-1.0] * len(good)})
            self.assertFalse(wrong.success)
        self.refused(self.call(SetJointStiffness, "/left/set_joint_stiffness", joint_stiffness=[1.0] * 3), "7")
        self.refused(
            self.call(SetCollisionBehavior, "/left/set_collision_behavior", lower_torque_thresholds_nominal=[1.0]), "7"
        )

    def test_reflex_thresholds_may_be_lowered_and_not_raised(self):
        most = [87.0] * 4 + [12.0] * 3, [100.0] * 6  # of a simulated arm without 'collision' in its scene

        def thresholds(share, kind="upper"):
            return {
                f"{kind}_{what}_thresholds_nominal": [share * v for v in values]
                for what, values in zip(("torque", "force"), most, strict=True)
            }

        def ask(**more):
            return self.call(
                SetCollisionBehavior, "/left/set_collision_behavior", **{**thresholds(0.2, "lower"), **more}
            )

        for what, name in (("torque", "joint 6"), ("force", "axis 6")):
            high = thresholds(0.8)
            high[f"upper_{what}_thresholds_nominal"][5] = 101.0
            self.refused(ask(**high), f"{what}_thresholds_nominal of {name}: 101")
        self.assertTrue(ask(**thresholds(0.8)).success)
        response = ask(**thresholds(1.0))
        self.assertTrue(response.success, response.error)

    def test_guiding_mode_frees_nothing_by_itself(self):
        before = self.state("left")
        response = self.call(SetGuidingMode, "/left/set_guiding_mode", axes=[True] * 3 + [False] * 3, elbow=True)
        self.assertTrue(response.success, response.error)
        after = self.state("left")
        self.assertEqual((after.mode, after.owner), (before.mode, before.owner))
        self.assertNotIn("/left/vacuum/on", dict(self.client.node.get_service_names_and_types()))  # it has a hand

    def test_stop_button_and_recovery(self):
        self.refused(self.call(RecoverFromError, "/left/recover"))
        self.assertTrue(self.call(SetBool, "/left/set_user_stop", data=True).success)
        self.changed("left", lambda s: s.mode == RobotState.MODE_USER_STOPPED and s.owner == "left_hold", "the stop")
        self.refused(self.switch("left_pose"), "left")
        self.assertEqual(self.state("right").owner, "right_pose")
        self.assertTrue(self.call(SetBool, "/left/set_user_stop", data=False).success)
        if self.state("left").mode != RobotState.MODE_MOVE:
            self.call(RecoverFromError, "/left_error_recovery_service_server/error_recovery")
        self.changed("left", lambda s: s.mode == RobotState.MODE_MOVE, "control again")
        self.switched("left_pose")


class Simulation(RosCase):
    def test_pause_and_step(self):
        clock = self.topic(Clock, "/clock", best_effort=True)  # 1 kHz is too much for Python to acknowledge
        clock.next(5)
        self.addCleanup(self.call, SetBool, "/simulation/pause", data=False)
        self.assertTrue(self.call(SetBool, "/simulation/pause", data=True).success)
        before = self.standing(clock)
        response = self.call(StepSimulation, "/simulation/step", periods=25)
        self.assertTrue(response.success, response.error)
        self.wait(lambda: nanoseconds(clock.newest().clock) >= before + 25_000_000, "25 ms of simulated time")
        self.assertEqual(self.standing(clock), before + 25_000_000)
        self.refused(self.call(StepSimulation, "/simulation/step", periods=0))
        self.assertTrue(self.call(SetBool, "/simulation/pause", data=False).success)
        self.wait(lambda: nanoseconds(clock.newest().clock) > before + 100_000_000, "a running clock")
        self.refused(self.call(StepSimulation, "/simulation/step", periods=1))  # of a paused one only
        self.client.forget(clock)

    def standing(self, clock):
        """Returns the time [ns] at which the clock stopped: that of its newest message."""

        def stands():
            newest = [nanoseconds(m.clock) for m in list(clock.messages)[-20:]]
            return len(set(newest)) == 1 or time.monotonic() - clock.arrived > 0.5

        self.wait(stands, "a standing clock")
        return nanoseconds(clock.newest().clock)

    def test_place_objects_and_reset(self):
        poses = self.topic(ObjectPoses, "/simulation/object_poses")

        def at(position):
            return self.wait(
                lambda: (
                    poses.newest()
                    and np.linalg.norm(kinematics.of_pose(poses.newest().poses[0])[:3, 3] - position) < 5e-3
                ),
                f"the box at {position}",
            )

        def place(names, *targets, frame_id=""):
            return self.call(
                PlaceObjects, "/simulation/place_objects", names=names, poses=list(targets), frame_id=frame_id
            )

        self.assertTrue(place(["box"], Pose(position=Point(x=-0.65, y=0.03, z=0.33), orientation=UNIT)).success)
        at([-0.65, 0.03, 0.33])
        in_base = np.linalg.inv(self.base("left")) @ [-0.55, -0.03, 0.33, 1]
        x, y, z, _ = (float(v) for v in in_base)
        self.assertTrue(
            place(["box"], Pose(position=Point(x=x, y=y, z=z), orientation=UNIT), frame_id="left_link0").success
        )
        at([-0.55, -0.03, 0.33])
        somewhere = Pose(position=Point(z=1.0), orientation=UNIT)
        for response, expected in [
            (place(["bx"], somewhere), "bx"),
            (place(["stand"], somewhere), "stand"),
            (place(["box"]), "pose"),
            (place(["box"], somewhere, frame_id="moon"), "moon"),
            (place([]), "object"),
            (place(["box"], Pose(position=Point(x=float("nan")), orientation=UNIT)), "finite"),
        ]:
            self.refused(response, expected)
        reset = self.call(Trigger, "/simulation/reset")
        self.assertTrue(reset.success, reset.message)
        at([-0.6, 0, 0.33])
