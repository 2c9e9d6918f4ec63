#include <cmath>
#include <filesystem>

#include <Eigen/Eigenvalues>

#include "common/text.hpp"
#include "core/model/prismatic_joints.hpp"
#include "models/arm_source.hpp"
#include "models/load_parts.hpp"
#include "scene/build.hpp"
#include "scene/load_parts.hpp"

namespace multipanda {
namespace {

std::string joint_name(Eigen::Index i) { return "joint" + std::to_string(i + 1); }

void check_inertia(const Archive& archive, const Matrix3& I) {
  const Vector3 moments = Eigen::SelfAdjointEigenSolver<Matrix3>(I, Eigen::EigenvaluesOnly).eigenvalues();
  const double slack = 1e-9 * moments.cwiseAbs().maxCoeff();
  if (moments[0] < -slack || moments[0] + moments[1] < moments[2] - slack) {
    archive.self().refuse(
        "inertia is not physically consistent: expected principal moments of at least 0, each at most the "
        "sum of the other two, found " +
        number_text(moments[0]) + ", " + number_text(moments[1]) + ", " + number_text(moments[2]));
  }
}

// The robot named by `key`; `name` becomes a name that load_robot finds from any working directory.
RobotDescription read_robot(const Node& node, std::string& name) {
  const bool path = name.find('/') != std::string::npos || name.ends_with(".yaml");
  if (path) {
    name = node.resolved(name);
    if (name.find('/') == std::string::npos) name = "./" + name;
  }
  const auto known = available_robots();
  if (!path && std::find(known.begin(), known.end(), name) == known.end())
    node.refuse("there is no robot model " + in_quotes(name) + name_hint(name, known, "there are no models"));
  try {
    return load_robot(name);
  } catch (const std::invalid_argument& error) {
    node.refuse(error.what());
  }
}

void check_plant_model(const Archive& archive, const RobotDescription& robot, SceneArm& arm) {
  const Node node = archive.at("plant_model");
  const RobotDescription plant = read_robot(node, arm.plant_model);
  if (plant.joint_count() != robot.joint_count()) {
    node.refuse("the model " + in_quotes(arm.plant_model) + " has " + std::to_string(plant.joint_count()) +
                " joints; expected " + std::to_string(robot.joint_count()) + ", as many as " +
                in_quotes(arm.model) + " has");
  }
  for (std::size_t i = 0; i < robot.joint_count(); ++i) {
    if (robot.is_prismatic(i) != plant.is_prismatic(i))
      node.refuse(joint_name(static_cast<Eigen::Index>(i)) + " is revolute in one of " +
                  in_quotes(arm.model) + " and " + in_quotes(arm.plant_model) + ", prismatic in the other");
  }
  if (arm.hand && !plant.hand)
    node.refuse("the model " + in_quotes(arm.plant_model) + " has no hand; expected one, or 'hand: false'");
}

void check_hand(const Archive& archive, const RobotDescription& robot, const SceneArm& arm) {
  if (arm.hand && !robot.hand)
    archive.at("hand").refuse("the model " + in_quotes(arm.model) + " has no hand; write 'hand: false'");
  if (archive.has("fingers") && !arm.hand)
    archive.at("fingers").refuse("the arm has no hand; remove this line, or 'hand: false'");
  if (arm.vacuum && arm.hand)
    archive.at("vacuum").refuse("the vacuum gripper replaces the hand; add 'hand: false'");
}

void check_start(const Archive& archive, const RobotDescription& robot, const SceneArm& arm) {
  if (!archive.has("start_rad") || archive.at("start_rad").is_scalar()) return;
  const auto& limits = robot.limits;
  for (Eigen::Index i = 0; i < arm.q_start.size(); ++i) {
    if (arm.q_start[i] >= limits.q_min[i] && arm.q_start[i] <= limits.q_max[i]) continue;
    archive.at("start_rad")
        .items()[static_cast<std::size_t>(i)]
        .refuse("unreachable start: " + joint_name(i) + " of " + in_quotes(arm.model) + " has the range " +
                number_text(limits.q_min[i]) + " to " + number_text(limits.q_max[i]) +
                (robot.is_prismatic(static_cast<std::size_t>(i)) ? " m" : " rad") + ", found " +
                number_text(arm.q_start[i]));
  }
}

// One limit of the safety section. `sign`: +1 if smaller values are tighter, -1 if larger ones are.
void visit_limit(Archive& archive, Key key, double sign, JointVector& limit, bool loosen, SceneArm& arm) {
  key.joints(static_cast<std::size_t>(limit.size())).or_one();
  std::optional<JointVector> requested;
  archive(key, requested);
  if (!requested) return;
  const Node node = archive.at(key.name);
  if (node.is_scalar()) {  // a cap: never loosens
    const double cap = (*requested)[0];
    if ((sign * (limit.array() - cap) <= 0).all()) {
      node.refuse("no joint is limited by " + number_text(cap) + " " + key.unit +
                  ": the model's own limits are tighter" +
                  (loosen ? "; to loosen them, give one number per joint" : ""));
    }
    limit = sign > 0 ? JointVector(limit.cwiseMin(cap)) : JointVector(limit.cwiseMax(cap));
    return;
  }
  for (Eigen::Index i = 0; i < limit.size(); ++i) {
    if (sign * ((*requested)[i] - limit[i]) <= 0) continue;
    const std::string text = key.name + " of " + joint_name(i) + ": " + number_text((*requested)[i]) + " " +
                             key.unit + " is looser than the model's " + number_text(limit[i]) + " " +
                             key.unit;
    if (!loosen) {
      node.items()[static_cast<std::size_t>(i)].refuse(
          text + "; if this is intended, write 'allow_looser_limits: true' in this section");
    }
    arm.loosened.push_back(text);
  }
  limit = *requested;
}

void check_ranges(const Archive& archive, const SafetyLimits& safety, const SceneArm& arm) {
  for (Eigen::Index i = 0; i < safety.joints.q_min.size(); ++i) {
    const double low = safety.joints.q_min[i], high = safety.joints.q_max[i];
    if (low >= high) {
      archive.self().refuse("empty position range for " + joint_name(i) + ": position_min_rad " +
                            number_text(low) + ", position_max_rad " + number_text(high));
    }
    if (arm.q_start[i] < low || arm.q_start[i] > high) {
      archive.self().refuse("unreachable start: " + joint_name(i) + " starts at " +
                            number_text(arm.q_start[i]) + ", this section allows " + number_text(low) +
                            " to " + number_text(high));
    }
  }
}

void check_load(const Archive& archive, const RobotDescription& robot, SceneArm& arm) {
  const auto& rated = robot.rated_payload;
  if (arm.largest_load && (!rated || *arm.largest_load > *rated)) {
    arm.loosened.push_back(
        "largest_load_kg: " + number_text(*arm.largest_load) + " kg, " +
        (rated ? "the model is rated for " + number_text(*rated) + " kg" : "the model has no rating"));
  }
  const double payload = arm.load_declared.mass, fixed = flange_load(arm, robot).hand_and_tool;
  const auto most = arm.largest_load ? arm.largest_load : rated;
  if (!most && payload > 0) {
    archive.at("load_declared")
        .refuse("the model " + in_quotes(robot.name) +
                " has no 'rated_payload_kg': its largest load is unknown; add 'largest_load_kg' to this arm");
  }
  if (!most || payload + arm.tool.mass == 0 || fixed + payload <= *most) return;
  archive.at(archive.has("load_declared") ? "load_declared" : "tool")
      .refuse("too heavy: hand, tool and payload are " + number_text(fixed + payload) +
              " kg, expected at most " + number_text(*most) +
              " kg; if the arm can carry them, write 'largest_load_kg: " +
              number_text(std::ceil(fixed + payload)) + "' in this arm");
}

void check_end_effector(const Archive& archive, SceneArm& arm) {
  if (arm.farthest_end_effector > kFarthestEndEffector) {
    arm.loosened.push_back("farthest_end_effector_m: " + number_text(arm.farthest_end_effector) +
                           " m, usually " + number_text(kFarthestEndEffector) + " m");
  }
  const double far = arm.X_FE ? arm.X_FE->position.norm() : 0;
  if (far <= arm.farthest_end_effector) return;
  archive.at("end_effector")
      .refuse("it is " + number_text(far) + " m from the flange, expected at most " +
              number_text(arm.farthest_end_effector) +
              " m; if the tool is that long, write 'farthest_end_effector_m: " +
              number_text(std::ceil(10 * far) / 10) + "' in this arm");
}

// After the safety section, which may reduce the force.
void check_axes(const Archive& archive, const RobotDescription& robot, const SceneArm& arm) {
  if (!robot.has_prismatic_joints()) return;
  ArmModelSource source = arm_model_source(robot, arm.X_WB, arm.hand);
  source.name = arm.name;
  source.tool = arm.tool;
  source.largest_load = flange_load(arm, robot).payload();
  const std::string why = weight_on_an_axis(ArmModel(std::move(source)), arm.safety.joints.tau_max);
  if (!why.empty()) archive.at("model").refuse(why);
}

std::size_t joint_count_of(const std::optional<RobotDescription>& robot) {
  return robot ? robot->joint_count() : 0;
}

}  // namespace

void visit(Archive& archive, Load& load) {
  archive.about("Load", "A rigid body on the flange, in the flange's frame.");
  archive(Key("mass_kg", "Mass.").within(0, 50).required(), load.mass);
  archive(Key("com_m", "Center of mass in the flange.").within(-2, 2), load.p_FC);
  archive.part(
      Key("inertia_kg_m2", "About the center of mass, in the axes of the flange. Default: a point mass."),
      [&](Archive& inner) {
        visit_inertia(inner, load.inertia_C, false);
        if (inner.reading()) check_inertia(inner, load.inertia_C);
      });
  if (archive.reading() && load.mass == 0 && load.inertia_C != Matrix3::Zero()) {
    archive.self().refuse("a body without mass has no inertia; set mass_kg above 0, or remove inertia_kg_m2");
  }
}

void visit(Archive& archive, ToolShape& shape) {
  archive.about(
      "Tool shape",
      "A rigid shape in the frame F of the flange. In the simulation it collides with everything but "
      "the last link and the hand. Collision avoidance uses it, too.");
  visit_shape(archive, shape.shape, shape.size, {"box", "sphere"}, 2, "Type of the shape.");
  visit_pose(archive, shape.X_FS, Key("position_m", "Center in the flange."));
  if (archive.reading()) shape.place = archive.self().place();
}

void visit(Archive& archive, SafetyLimits& safety, SceneArm& arm) {
  archive.about(
      "Safety",
      "Limits of one arm, tighter than those of its model. A list has one number per joint. A single number "
      "caps every joint; lower limits of the model stay. Looser limits are refused unless "
      "`allow_looser_limits` is true; they are then shown and logged.");
  bool loosen = false;
  archive(Key("allow_looser_limits", "Limits of this section may be looser than those of the model."),
          loosen);
  ArmLimits& joints = safety.joints;
  visit_limit(archive, Key("torque_max_nm", "Largest commanded torque.").at_least(0), 1, joints.tau_max,
              loosen, arm);
  visit_limit(
      archive,
      Key("torque_rate_max_nm_per_s", "Largest rate of change of the commanded torque.").at_least(0.001), 1,
      joints.tau_rate_max, loosen, arm);
  visit_limit(archive,
              Key("velocity_max_rad_per_s", "An arm that moves faster goes to hold.").at_least(0.001), 1,
              joints.dq_max, loosen, arm);
  visit_limit(archive, Key("position_min_rad", "An arm that moves outward below this goes to hold."), -1,
              joints.q_min, loosen, arm);
  visit_limit(archive, Key("position_max_rad", "An arm that moves outward above this goes to hold."), 1,
              joints.q_max, loosen, arm);
  std::optional<Vector3> low, high;
  archive(Key("workspace_min_m",
              "Lower corner, in the world, of a box that end effector, flange, tool center point and tool "
              "shapes (by their farthest corner) must not leave. Requires "
              "`workspace_max_m`.")
              .within(-kFarthest, kFarthest),
          low);
  archive(Key("workspace_max_m",
              "Upper corner of that box. Guide an arm whose law is refused outside the box back by hand, or "
              "stop and resume it first.")
              .within(-kFarthest, kFarthest),
          high);
  const double usual_age = safety.max_state_age_s;
  archive(Key("max_state_age_s",
              "An arm whose state is older goes to hold, with the other arms of its controllet. For an arm "
              "that is the only one of its controllet the limit is 0.02 s.")
              .within(kArmPeriod, 0.1),
          safety.max_state_age_s);
  if (!archive.reading()) return;
  check_ranges(archive, safety, arm);
  if (safety.max_state_age_s > usual_age) {
    const std::string text = "max_state_age_s: " + number_text(safety.max_state_age_s) +
                             " s is looser than the usual " + number_text(usual_age) + " s";
    if (!loosen) {
      archive.at("max_state_age_s")
          .refuse(text + "; if this is intended, write 'allow_looser_limits: true' in this section");
    }
    arm.loosened.push_back(text);
  }
  if (low.has_value() != high.has_value()) {
    archive.at(low ? "workspace_min_m" : "workspace_max_m")
        .refuse("expected both workspace_min_m and workspace_max_m, found only one of them");
  }
  if (!low) return;
  safety.workspace = WorkspaceBox{*low, *high};
  if ((*high - *low).minCoeff() <= 0)
    archive.at("workspace_max_m").refuse("the box is empty; expected numbers above those of workspace_min_m");
}

void visit(Archive& archive, SceneArm& arm, SceneReader& reader) {
  archive.about("Arm",
                "Frames are named in CONVENTIONS.md: W world, B base, F flange, E end effector, K stiffness "
                "frame.");
  archive(Key("name", "Unique name, for example `left`.").identifier().required(), arm.name);
  if (archive.reading()) {
    arm.place = archive.self().place();
    for (const auto& other : reader.scene.arms) {
      if (other.name == arm.name) {
        archive.at("name").refuse("two arms have this name, the first in line " +
                                  std::to_string(other.place.line));
      }
    }
  }
  archive(Key("model",
              "A robot of models/ (`fer`, `fr3`, `fr3v2`), or the path of a model file, "
              "relative to this file.")
              .like(available_robots()),
          arm.model);
  std::optional<RobotDescription> robot;
  if (archive.reading()) robot = read_robot(archive.at("model"), arm.model);
  const std::size_t n = joint_count_of(robot);
  archive(Key("plant_model",
              "Model of the simulated arm, if it differs from the `model` that the controllers and the "
              "simulated firmware use. It must have the same number of joints (docs/simulation.md).")
              .like(available_robots()),
          arm.plant_model);
  archive(Key("hand", "The model's hand is on the flange."), arm.hand);
  std::string fingers;
  archive(Key("fingers",
              "Fingers of the simulated hand. `locked`: closed and rigid; `movable`: a gripper that grasps "
              "(docs/gripper.md). Default: locked; movable on virtual arms. The controllers' model "
              "always has the rigid hand.")
              .one_of({"locked", "movable"}),
          fingers);
  if (!fingers.empty()) arm.movable_fingers = fingers == "movable";
  archive(
      Key("vacuum",
          "A vacuum gripper replaces the hand (`hand: false`). Suction acts at the end effector, along its "
          "z axis."),
      arm.vacuum);
  if (robot) {
    check_hand(archive, *robot, arm);
    if (archive.has("plant_model")) check_plant_model(archive, *robot, arm);
    arm.q_start = robot->q_home;
  }
  read_base(archive, arm, reader, robot ? &*robot : nullptr);
  archive(Key("start_rad",
              "Joint positions of the simulated arm at the start; `ready`: those of the model. Controllets "
              "always begin from the measured state.")
              .joints(n)
              .one_of({"ready"})
              .otherwise("ready"),
          arm.q_start);
  if (robot) check_start(archive, *robot, arm);
  archive.section(Key("end_effector",
                      "X_FE (Franka's F_T_EE): end effector in the flange. Default: the tool center point of "
                      "the hand; without a hand, the flange."),
                  arm.X_FE);
  archive(
      Key("farthest_end_effector_m",
          "Distance from the flange within which this scene and requests may set the end effector. More than "
          "the default is shown and logged.")
          .within(0, 10),
      arm.farthest_end_effector);
  if (archive.reading()) check_end_effector(archive, arm);
  archive.section(Key("stiffness_frame", "X_EK (Franka's EE_T_K): stiffness frame in the end effector."),
                  arm.X_EK);
  archive.section(Key("tool",
                      "Rigid tool on the flange, in addition to the hand. Both the plant and the "
                      "controllers' model include it."),
                  arm.tool);
  archive.section(Key("load_declared", "Payload that the controllers know."), arm.load_declared);
  archive.section(Key("load_present",
                      "Payload in the plant. Declare a payload that is present and known under both keys."),
                  arm.load_present);
  archive(
      Key("largest_load_kg",
          "Mass that the flange may carry by this scene and by requests: hand, tool and declared payload. "
          "Default: `rated_payload_kg` of the model. More than that is shown and logged; a model without a "
          "rating needs it before a payload may be declared.")
          .within(0, 100),
      arm.largest_load);
  if (robot) check_load(archive, *robot, arm);
  archive.list(Key("tool_shapes", "Collision geometry of the tool, without mass: its mass is in `tool`.")
                   .each("tool shape"),
               arm.tool_shapes);
  std::string friction = "none";
  archive(Key("known_friction",
              "`model`: the controllers know the friction table of the model (feature "
              "`friction_compensation`).")
              .one_of({"none", "model"}),
          friction);
  arm.known_friction = friction == "model";
  if (arm.known_friction && !robot->friction) {
    archive.at("known_friction")
        .refuse("the model " + in_quotes(robot->name) + " has no friction table; write 'none'");
  }
  if (archive.reading()) arm.rotor_hidden = reader.scene.plant.rotor_hidden.value_or(1);
  std::string rotors = "none";
  archive(Key("known_rotor_inertia",
              "`model`: the mass matrix of the controllers contains the motors' inertia according to their "
              "model, `motor_inertia_kg_m2` or what `rotor_inertia_hidden` leaves of `rotor_inertia_kg_m2`.")
              .one_of({"none", "model"}),
          rotors);
  arm.known_rotor_inertia = rotors == "model";
  if (arm.known_rotor_inertia && acting_motor_inertia(*robot, arm.rotor_hidden).size() == 0) {
    archive.at("known_rotor_inertia")
        .refuse("no motor inertia acts according to the model " + in_quotes(robot->name) +
                "; write 'none', or 'rotor_inertia_hidden' below 1 in 'plant' with a model that has "
                "'rotor_inertia_kg_m2'");
  }
  if (robot) {
    const JointLimits& own = robot->limits;
    arm.unguarded = robot->unguarded_pairs;
    arm.left_out_friction = robot->left_out_friction;
    arm.safety.joints = {own.q_min,
                         own.q_max,
                         own.dq_max,
                         own.ddq_max,
                         own.tau_max,
                         own.tau_rate_max,
                         robot->position_based_velocity};
  }
  archive.section(Key("safety", "Limits of the safety stage. Default: those of the model."), arm.safety, arm);
  if (robot && !archive.has("safety")) check_ranges(archive, arm.safety, arm);
  if (robot) check_axes(archive, *robot, arm);
  archive.section(
      Key("fci",
          "Connection to a real arm; the address alone may be written. The option `--backend` of a "
          "run overrides it.")
          .or_text(),
      arm.fci, reader);
  if (arm.fci && archive.at("fci").is_scalar()) {
    arm.fci->address = archive.at("fci").yaml().Scalar();
    arm.fci->place = archive.at("fci").place();
    check_address(archive.at("fci"), *arm.fci, reader);
  }
  if (archive.reading() && arm.fci && !arm.fci->robotiq.empty() && (arm.hand || arm.vacuum))
    archive.at("fci").refuse(
        "the Robotiq gripper replaces the hand and the vacuum gripper; write 'hand: false'");
  const RobotDescription& description = robot ? *robot : RobotDescription{};
  archive.section(Key("collision",
                      "Thresholds of contact and reflex, set on the arm at the start. Default: 80 N, 25 N m "
                      "and 40 N m or less per joint, on real arms; see `keep_collision_thresholds`."),
                  arm.collision, description);
  archive(
      Key("observer_hz",
          "Forces by this program's momentum observer with that cut-off (5 to 100: force laws are tuned for "
          "at most 30 ms of lag), also where the arm sends an estimate of its own; 0: 30 Hz, only where it "
          "sends none.")
          .within(0, 100),
      arm.observer_hz);
  if (arm.observer_hz > 0 && arm.observer_hz < 5)
    archive.at("observer_hz")
        .refuse("the observer's cut-off must be 0 or 5 to 100 Hz: force laws tolerate no more lag");
  archive.section(Key("force_sensor", "A force and torque sensor that measures the arm's wrench."),
                  arm.force_sensor);
  if (archive.reading() && arm.force_sensor && arm.observer_hz > 0)
    archive.at("force_sensor")
        .refuse(
            "the arm's forces come from its sensor or from the observer; remove 'observer_hz' or this key");
  archive(
      Key("joint_stiffness_nm_per_rad",
          "Stiffness of the arm's internal joint controller, set at the start; controllets do not use it.")
          .within(0, 14250)
          .joints(n)
          .or_one(),
      arm.joint_stiffness);
  archive(
      Key("cartesian_stiffness",
          "Stiffness of the arm's internal Cartesian controller (x, y, z, roll, pitch, yaw in K), set at the "
          "start; controllets do not use it.")
          .in("N/m, N m/rad")
          .within(0, 3000),
      arm.cartesian_stiffness);
  if (!archive.reading()) return;
  reader.holds.push_back({.name = arm.name + "_hold", .type = "hold", .arms = {reader.scene.arms.size()}});
  reader.robots.push_back(std::move(*robot));
}

ArmIndex SceneReader::arm(const Node& name) const {
  const std::string& requested = name.yaml().Scalar();
  std::vector<std::string> names;
  for (ArmIndex i = 0; i < scene.arms.size(); ++i) {
    if (scene.arms[i].name == requested) return i;
    names.push_back(scene.arms[i].name);
  }
  name.refuse("there is no arm " + in_quotes(requested) + name_hint(requested, names, "there are none"));
}

}  // namespace multipanda
