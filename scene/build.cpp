#include "scene/build.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <stdexcept>

#include "common/machine.hpp"
#include "common/text.hpp"
#include "core/plugin/load_plugin.hpp"
#include "core/state/load_ramp.hpp"
#include "models/arm_source.hpp"

namespace multipanda {
namespace {

InstanceIndex find_instance(const MultimodeController& controller, const std::string& name) {
  const InstanceIndex index = controller.find(name);
  if (index == kNoInstance) {
    throw std::invalid_argument("the multimode controller has no controllet '" + name +
                                "'; build it from the same scene (build_cycle_config)");
  }
  return index;
}

InstanceSet find_all(const MultimodeController& controller, const std::vector<std::string>& names) {
  InstanceSet set = 0;
  for (const auto& name : names) set |= bit(find_instance(controller, name));
  return set;
}

ArmSet find_arms(const MultimodeController& controller, const std::vector<std::string>& names) {
  if (names.empty()) return ArmSet::all(controller.arm_count());
  ArmSet set;
  for (const auto& name : names) {
    ArmIndex arm = 0;
    while (arm < controller.arm_count() && controller.arm_name(arm) != name) ++arm;
    if (arm == controller.arm_count()) {
      throw std::invalid_argument("the multimode controller has no arm '" + name +
                                  "'; build it from the same scene");
    }
    set |= ArmSet::of(arm);
  }
  return set;
}

void copy_values(const std::vector<double>& values, std::uint8_t& size, std::span<double> out) {
  if (values.size() > out.size()) throw std::invalid_argument("too many values in an event");
  size = static_cast<std::uint8_t>(values.size());
  std::copy(values.begin(), values.end(), out.begin());
}

Request request_of(const TimelineEvent& event, const MultimodeController& controller) {
  using What = TimelineEvent::What;
  Request request;
  if (event.what == What::switch_controllets) {
    request.activate = find_all(controller, event.activate);
    request.deactivate = find_all(controller, event.deactivate);
    request.only = event.only;
    return request;
  }
  if (event.what == What::resume) {
    request.kind = Request::Kind::resume;
    request.arms = find_arms(controller, event.arms);
    return request;
  }
  request.instance = find_instance(controller, event.controllet);
  const Instance& instance = controller.instance(request.instance);
  if (event.what == What::set_parameter) {
    request.kind = Request::Kind::set_parameter;
    request.index = static_cast<std::uint16_t>(instance.find_parameter(event.name));
    copy_values(event.values, request.size, request.values);
  } else if (event.what == What::set_feature) {
    request.kind = Request::Kind::set_feature;
    request.index = static_cast<std::uint16_t>(instance.find_feature(event.name));
    request.on = event.on;
  } else if (event.what == What::set_motion) {
    request.kind = Request::Kind::set_target;
    request.index = static_cast<std::uint16_t>(instance.find_input(event.name));
    request.target.delivery = Delivery::motion;
    copy_values(event.rise, request.target.size, request.target.values);
    copy_values(event.sine, request.target.size, request.target.sine);
    request.target.period_s = event.period_s;
    request.target.cycles = event.cycles;
    request.target.ramp_s = event.ramp_s;
    if (event.overtones.size() > kMaxHarmonics) throw std::invalid_argument("too many overtones in an event");
    for (const auto& part : event.overtones) {
      HarmonicPart& harmonic = request.target.harmonics[request.target.harmonic_count++];
      std::copy(part.rise.begin(), part.rise.end(), harmonic.rise.begin());
      std::copy(part.sine.begin(), part.sine.end(), harmonic.sine.begin());
    }
  } else {
    request.kind = Request::Kind::set_target;
    request.index = static_cast<std::uint16_t>(instance.find_input(event.name));
    request.target.duration_s = event.duration_s;
    copy_values(event.values, request.target.size, request.target.values);
  }
  return request;
}

std::string kilograms(double mass) {
  std::array<char, 32> text;
  std::snprintf(text.data(), text.size(), "%.4g kg", mass);
  return text.data();
}

}  // namespace

Registry build_registry(const std::vector<std::string>& plugins) {
  Registry registry = Registry::with_builtins();
  for (const auto& path : plugins) load_plugin(registry, path);
  return registry;
}

RobotDescription robot_of(const SceneArm& arm) { return load_robot(arm.model); }

RobotDescription plant_robot_of(const SceneArm& arm) {
  RobotDescription robot = arm.plant_robot           ? *arm.plant_robot
                           : arm.plant_model.empty() ? robot_of(arm)
                                                     : load_robot(arm.plant_model);
  robot.motor_inertia = acting_motor_inertia(robot, arm.rotor_hidden);
  return robot;
}

Transmission transmission_of(const PlantFidelity& plant, std::size_t n) {
  Transmission t;
  if (plant.transmission_stiffness_nm_per_rad > 0)
    t.stiffness = joint_constant(n, plant.transmission_stiffness_nm_per_rad);
  if (plant.gear_ripple_nm > 0) {
    constexpr std::size_t kLargeJoints = 4;
    t.ripple = joint_constant(n, plant.gear_ripple_nm);
    t.ripple_cycles = joint_constant(n, 160);
    t.ripple_cycles.head(static_cast<Eigen::Index>(std::min(n, kLargeJoints))).setConstant(240);
    t.ripple_phase = JointVector::LinSpaced(static_cast<Eigen::Index>(n), 0, static_cast<double>(n - 1));
  }
  return t;
}

namespace {

Pose tilted(Pose X, const RobotDescription& plant) {
  if (!plant.base_tilt.isZero(0))
    X.rotation *= rotation_from_rpy({plant.base_tilt.x(), plant.base_tilt.y(), 0});
  return X;
}

}  // namespace

Pose plant_base_of(const SceneArm& arm, const RobotDescription& plant) { return tilted(arm.X_WB, plant); }

Pose plant_mount_of(const BaseMount& mount, const RobotDescription& plant) {
  return tilted(mount.X_JB, plant);
}

namespace {

// Virtual arms have loopback addresses; their motors are those of the model file.
bool is_physical(const SceneArm& arm) { return arm.fci && !is_on_this_computer(arm.fci->address); }

JointVector motor_inertia_of(const SceneArm& arm, const RobotDescription& robot) {
  if (!is_physical(arm)) {
    const RobotDescription plant = plant_robot_of(arm);
    return plant.joint_count() == robot.joint_count() ? plant.motor_inertia : JointVector();
  }
  if (robot.motor_inertia.size() > 0) return robot.motor_inertia;
  return joint_constant(robot.joint_count(), kAssumedMotorInertia);
}

// Hand and tool according to the scene: the tool center point, and the shapes of the tool.
Vector3 tool_end(const SceneArm& arm, const RobotDescription& robot) {
  Vector3 end = arm.hand && robot.hand ? (robot.hand->mount.pose() * robot.hand->tcp.pose()).position
                                       : Vector3(Vector3::Zero());
  const auto take = [&end](const Vector3& p) {
    if (p.squaredNorm() > end.squaredNorm()) end = p;
  };
  for (const auto& [shape, size, X_FS, place] : arm.tool_shapes) {
    if (shape == ShapeType::sphere) {
      const double from = X_FS.position.norm();
      const Vector3 outwards = from > 0 ? Vector3(X_FS.position / from) : Vector3(Vector3::UnitZ());
      take(X_FS.position + 0.5 * size.x() * outwards);
      continue;
    }
    for (int corner = 0; corner < 8; ++corner) {
      const Vector3 side(corner & 1 ? 0.5 : -0.5, corner & 2 ? 0.5 : -0.5, corner & 4 ? 0.5 : -0.5);
      take(X_FS * Vector3(side.cwiseProduct(size)));
    }
  }
  return end;
}

ArmModelSource model_source(const SceneArm& arm) {
  const RobotDescription robot = robot_of(arm);
  ArmModelSource source = arm_model_source(robot, arm.X_WB, arm.hand);
  source.name = arm.name;
  add_tool_shapes(arm.tool_shapes, robot.flange.pose(), source);
  if (arm.known_friction) {
    if (!robot.friction) {
      throw std::invalid_argument("arm '" + arm.name + "': the model '" + arm.model +
                                  "' has no friction table");
    }
    source.known_friction = JointFrictionTable{robot.friction->p1, robot.friction->p2, robot.friction->p3};
  }
  source.tool = arm.tool;
  source.tool_end = tool_end(arm, robot);
  source.largest_load = flange_load(arm, robot).payload();
  source.farthest_end_effector = arm.farthest_end_effector;
  source.motor_inertia = motor_inertia_of(arm, robot);
  return source;
}

std::optional<ForceSensorMount> force_sensor_of(const SceneArm& arm) {
  if (!arm.force_sensor) return std::nullopt;
  ForceSensorMount mount = arm.force_sensor->mount;
  mount.carried = arm.force_sensor->carried.value_or(combined(hand_load(arm), 1, arm.tool, 1));
  return mount;
}

}  // namespace

std::shared_ptr<const ArmModel> build_arm_model(const SceneArm& arm) {
  return std::make_shared<const ArmModel>(model_source(arm));
}

std::shared_ptr<const ArmModel> build_controller_model(const SceneArm& arm) {
  ArmModelSource source = model_source(arm);
  if (arm.known_rotor_inertia) {
    // The hidden share is a property of the simulation: for a real arm only identified inertia counts.
    const RobotDescription robot = robot_of(arm);
    source.known_motor_inertia =
        is_physical(arm) ? robot.motor_inertia : acting_motor_inertia(robot, arm.rotor_hidden);
  }
  ArmLimits& own = source.limits;
  const ArmLimits& scene = arm.safety.joints;
  if (scene.q_min.size() == own.q_min.size()) {
    own.q_min = own.q_min.cwiseMax(scene.q_min).eval();
    own.q_max = own.q_max.cwiseMin(scene.q_max).eval();
    own.dq_max = own.dq_max.cwiseMin(scene.dq_max).eval();
    own.ddq_max = own.ddq_max.cwiseMin(scene.ddq_max).eval();
  }
  return std::make_shared<const ArmModel>(std::move(source));
}

ArmConfig arm_config(const SceneArm& arm) {
  ArmConfig config;
  config.tool = arm.tool;
  config.load = arm.load_declared;
  config.frames.X_EK = arm.X_EK;
  if (arm.X_FE) {
    config.frames.X_FE = *arm.X_FE;
  } else if (arm.hand) {
    const RobotDescription robot = robot_of(arm);
    if (!robot.hand)
      throw std::invalid_argument("arm '" + arm.name + "': the model '" + arm.model + "' has no hand");
    config.frames.X_FE = robot.hand->mount.pose() * robot.hand->tcp.pose();
  }
  return config;
}

Load hand_load(const SceneArm& arm) {
  const RobotDescription robot = robot_of(arm);
  if (!arm.hand || !robot.hand) return {};
  const RigidBody hand = moved(rigid_hand(*robot.hand), robot.hand->mount.pose());
  return {hand.mass, hand.com, hand.inertia};
}

CycleConfig build_cycle_config(const Scene& scene, std::size_t record_capacity) {
  CycleConfig config;
  for (const auto& arm : scene.arms)
    config.arms.push_back({arm.name, build_controller_model(arm), arm.safety, arm.mount, arm.observer_hz,
                           force_sensor_of(arm)});
  config.controllets = scene.controllets;
  for (ArmIndex arm = 0; arm < scene.arms.size(); ++arm) {  // holds that the scene does not declare
    InstanceConfig hold{.name = scene.arms[arm].name + "_hold", .type = "hold", .arms = {arm}};
    const bool changed = std::any_of(scene.controllets.begin(), scene.controllets.end(),
                                     [&](const auto& own) { return own.name == hold.name; });
    if (!changed) config.controllets.push_back(std::move(hold));
  }
  // Every controllet respects the scene's bounds, also one that is added later.
  for (auto& controllet : config.controllets)
    controllet.contact = tighter(controllet.contact, scene.contact_bounds);
  config.obstacles = fixed_obstacles(scene);
  config.record_capacity = record_capacity;
  return config;
}

std::vector<ScheduledRequest> build_schedule(const Scene& scene, MultimodeController& controller) {
  std::vector<ScheduledRequest> schedule;
  schedule.reserve(scene.timeline.size());
  for (ArmIndex arm = 0; arm < scene.arms.size() && !scene.timeline.empty(); ++arm)
    controller.set_end_effector(arm, arm_config(scene.arms[arm]).frames.X_FE);
  for (const auto& event : scene.timeline) {
    if (event.what == TimelineEvent::What::place) continue;  // carried out by the simulation
    ScheduledRequest scheduled;
    scheduled.at = LoopTime::from_seconds(event.at_s);
    if (event.what == TimelineEvent::What::stop) {
      scheduled.what = ScheduledRequest::What::stop;
      scheduled.stop = find_arms(controller, event.arms);
    } else {
      scheduled.request = request_of(event, controller);
      const Verdict verdict = controller.check(scheduled.request);
      if (verdict != Verdict::accepted) {
        std::string why = controller.refusal(scheduled.request);
        why = why.empty() ? std::string(to_string(verdict))
                          : "'" + event.controllet + "', input '" + event.name + "': " + why;
        throw ConfigError(event.place, "the event at " + number_text(event.at_s) + " s is refused: " + why);
      }
    }
    schedule.push_back(scheduled);
  }
  return schedule;
}

InstanceSet start_set(const Scene& scene, const MultimodeController& controller) {
  return find_all(controller, scene.active);
}

const SceneArm* carried_arm(const Scene& scene) {
  const auto found = std::find_if(scene.arms.begin(), scene.arms.end(),
                                  [](const SceneArm& arm) { return arm.mount.has_value(); });
  return found == scene.arms.end() ? nullptr : &*found;
}

void refuse_carried_arms(const Scene& scene, const std::string& what) {
  const SceneArm* arm = carried_arm(scene);
  if (arm == nullptr) return;
  SourcePlace place = arm->mount_place;
  if (place.file.empty()) place.file = scene.path.empty() ? scene.name : scene.path;
  throw CarriedArmRefused(
      place, "arm '" + arm->name + "' stands on arm '" + scene.arms.at(arm->mount->carrier).name +
                 "': " + what +
                 " cannot place a moving base; run it with `multipanda run` on the simulation "
                 "(backend mujoco)");
}

ConvexShape convex_shape(ShapeType shape, const Vector3& size) {
  switch (shape) {
    case ShapeType::plane:
      return ConvexShape::half_space();
    case ShapeType::sphere:
      return ConvexShape::sphere(Vector3::Zero(), 0.5 * size.x());
    case ShapeType::cylinder:
      return ConvexShape::cylinder(0.5 * size.x(), size.z());
    case ShapeType::capsule: {
      const Vector3 end(0, 0, 0.5 * size.z());  // half of the straight part
      return ConvexShape::capsule(-end, end, 0.5 * size.x());
    }
    case ShapeType::box:
      break;
  }
  return ConvexShape::box(size);
}

void add_tool_shapes(const std::vector<ToolShape>& tool, const Pose& X_JF, ArmModelSource& source) {
  auto& parts = source.collision_shapes;
  // The last joint of the arm, even if no shape moves with it.
  const int last = static_cast<int>(source.limits.q_min.size()) - 1;
  const std::size_t others = parts.size();
  for (std::size_t i = 0; i < tool.size(); ++i) {
    parts.push_back(
        {"tool " + std::to_string(i), last, convex_shape(tool[i].shape, tool[i].size), X_JF * tool[i].X_FS});
    for (std::size_t k = 0; k < others; ++k) {
      if (parts[k].joint < last - 1) source.self_pairs.emplace_back(k, parts.size() - 1);
    }
  }
}

std::vector<Obstacle> fixed_obstacles(const Scene& scene) {
  std::vector<Obstacle> obstacles;
  for (const auto& object : scene.objects) {
    if (!object.fixed) continue;
    const bool is_placed = std::ranges::any_of(scene.timeline, [&](const TimelineEvent& event) {
      return event.what == TimelineEvent::What::place && event.object == object.name;
    });
    obstacles.push_back({object.name, convex_shape(object.shape, object.size), object.X_WO, is_placed});
  }
  return obstacles;
}

FlangeLoad flange_load(const SceneArm& arm, const RobotDescription& robot) {
  return {.hand_and_tool = arm.tool.mass + (arm.hand && robot.hand ? rigid_hand(*robot.hand).mass : 0),
          .rated = robot.rated_payload,
          .allowed = arm.largest_load};
}

std::string load_text(const FlangeLoad& flange, double payload) {
  const double carried = flange.hand_and_tool + payload;
  std::string text = "a payload of " + kilograms(payload) + " is declared: ";
  if (flange.hand_and_tool > 0) text += "with hand and tool (" + kilograms(flange.hand_and_tool) + ") ";
  text += "the flange carries " + kilograms(carried);
  if (!flange.most()) return text + "; the model has no rating";
  text += " of the " + kilograms(*flange.most()) + " that ";
  if (flange.allowed) {
    text += "the scene allows (";
    text += flange.rated ? "the model is rated for " + kilograms(*flange.rated) : "the model has no rating";
    text += ")";
  } else {
    text += "the model is rated for";
  }
  return text + ", " + kilograms(*flange.most() - carried) + " remain";
}

}  // namespace multipanda
