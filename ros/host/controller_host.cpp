#include "ros/host/controller_host.hpp"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <type_traits>

#include "common/text.hpp"
#include "models/robot_description.hpp"
#include "ros/adapter/controllets/parameter_services.hpp"
#include "ros/adapter/ros_adapter.hpp"
#include "runtime/embedded/hosted_cycle.hpp"
#include "runtime/request_text.hpp"
#include "scene/build.hpp"
#include "scene/from_parameters.hpp"
#include "scene/load.hpp"

namespace multipanda::ros {

static_assert(std::is_same_v<FlatParameters, multipanda::FlatParameters>);

// A folder with the robot description as a model for scenes. The destructor removes it.
class DescriptionFolder {
 public:
  explicit DescriptionFolder(const std::string& urdf) : urdf_(urdf) {}
  ~DescriptionFolder() {
    std::error_code ignored;
    if (!folder_.empty()) std::filesystem::remove_all(folder_, ignored);
  }
  DescriptionFolder(const DescriptionFolder&) = delete;

  std::string model_of(const HostedArm& arm) {
    if (urdf_.empty()) {
      throw std::invalid_argument("parameter 'arms." + arm.name +
                                  ".model': the node has no robot description; set the parameter "
                                  "'robot_description', or name a model");
    }
    if (arm.base_link.empty() || arm.tip_link.empty()) {
      throw std::invalid_argument(
          "parameter 'arms." + arm.name +
          ".model': robot_description also needs 'base_link' and 'tip_link', the ends of the arm");
    }
    if (folder_.empty()) make();
    const std::filesystem::path file = folder_ / (arm.name + ".yaml");
    std::ofstream out(file);
    out << "name: " << arm.name << "\ntitle: " << arm.name
        << " of the robot description\nurdf: robot.urdf\nbase_link: " << arm.base_link
        << "\ntip_link: " << arm.tip_link << "\n";
    if (!out.flush()) throw std::runtime_error("cannot write " + file.string());
    return file.string();
  }

 private:
  void make() {
    std::string pattern = (std::filesystem::temp_directory_path() / "multipanda-XXXXXX").string();
    if (::mkdtemp(pattern.data()) == nullptr)
      throw std::runtime_error("cannot make a temporary folder in " + pattern);
    folder_ = pattern;
    std::ofstream out(folder_ / "robot.urdf");
    out << urdf_;
    if (!out.flush()) throw std::runtime_error("cannot write to " + folder_.string());
  }
  std::string urdf_;
  std::filesystem::path folder_;
};

namespace {

// With a controller_manager, other nodes publish these topics, so they are off unless a parameter
// enables them.
void leave_to_others(const FlatParameters& parameters, RosSection::Rates& rates) {
  const std::pair<const char*, double*> others[] = {{"joint_states", &rates.joint_states},
                                                    {"tf", &rates.tf},
                                                    {"clock", &rates.clock},
                                                    {"object_poses", &rates.object_poses}};
  for (const auto& [name, rate] : others) {
    const std::string key = std::string("ros.rates_hz.") + name;
    const bool is_set =
        std::any_of(parameters.begin(), parameters.end(), [&](const auto& p) { return p.first == key; });
    if (!is_set) *rate = 0;
  }
}

// A torque meant for one joint must not reach another one. Throws std::invalid_argument.
void check_order(const std::vector<std::string>& given, const std::vector<std::string>& chain) {
  bool moved = false;
  for (std::size_t i = 0; i < given.size() && i < chain.size(); ++i) {
    moved = moved || (given[i] != chain[i] && std::ranges::find(chain, given[i]) != chain.end());
  }
  if (!moved) return;
  throw std::invalid_argument("the arm's 'joints' are " + joined(given) +
                              "; expected the order of the robot description, " + joined(chain) +
                              ": correct it, or remove 'joints'");
}

}  // namespace

struct ControllerHost::Implementation {
  Implementation(const FlatParameters& parameters, const ControllerHostOptions& options)
      : description(options.robot_description) {
    ParameterScene given =
        scene_from_parameters(parameters, [this](const HostedArm& arm) { return description.model_of(arm); });
    registry = build_registry(given.plugins);
    const Scene scene = parse_scene(given.yaml, "parameters", registry);
    refuse_carried_arms(scene, "a controller of ros2_control");
    for (ArmIndex i = 0; i < given.arms.size(); ++i) {
      if (given.arms[i].base_link.empty()) continue;
      std::vector<std::string> names = robot_of(scene.arms[i]).joint_names;  // as named in the description
      check_order(given.arms[i].joints, names);
      if (given.arms[i].joints.empty()) given.arms[i].joints = std::move(names);
    }
    arms = given.arms;
    HostedOptions hosted{.arms = std::move(given.arms),
                         .period_s = options.period_s,
                         .stop_after_gaps = !options.simulated_time,
                         .make_adapter = {},
                         .trace = hosted_trace_options(parameters),
                         .report = options.report};
    if (options.node != nullptr) {
      hosted.make_adapter = [&](const RunContext& run) {
        RosOptions ros;
        static_cast<RosSection&>(ros) = run.scene->ros;
        ros.parameter_services = false;  // the node has its own
        ros.arms = false;                // provided by the hardware's node
        leave_to_others(parameters, ros.rates_hz);
        return std::make_unique<RosAdapter>(run, ros, options.node);
      };
    }
    cycle = std::make_unique<HostedCycle>(scene, registry, std::move(hosted));
    table = std::make_unique<ParameterTable>(cycle->modes());
    name_interfaces();
  }

  void name_interfaces() {
    for (ArmIndex i = 0; i < arms.size(); ++i) {
      Place place;
      place.first_state = state_names.size();
      place.first_command = command_names.size();
      place.joints = cycle->joint_count(i);
      for (const auto& joint : cycle->joint_names(i)) {
        state_names.push_back(joint + "/position");
        state_names.push_back(joint + "/velocity");
        if (arms[i].has_effort) state_names.push_back(joint + "/effort");
        command_names.push_back(joint + "/effort");
      }
      place.shared = state_names.size();
      if (arms[i].has_robot_state) state_names.push_back(arms[i].name + "/" + kStateInterface);
      places.push_back(place);
      cycle->signals(i).has_effort = arms[i].has_effort;
    }
    states.assign(state_names.size(), 0.0);
    commands.assign(command_names.size(), 0.0);
  }

  void take_states() noexcept {
    for (ArmIndex i = 0; i < places.size(); ++i) {
      ArmSignals& signals = cycle->signals(i);
      const double* state = states.data() + places[i].first_state;
      for (std::size_t k = 0; k < places[i].joints; ++k) {
        signals.position[k] = *state++;
        signals.velocity[k] = *state++;
        if (arms[i].has_effort) signals.effort[k] = *state++;
      }
    }
  }
  void leave_commands() noexcept {
    for (ArmIndex i = 0; i < places.size(); ++i) {
      const auto& command = cycle->signals(i).effort_command;
      std::copy_n(command.begin(), places[i].joints,
                  commands.begin() + static_cast<std::ptrdiff_t>(places[i].first_command));
    }
  }
  // Returns whether the addresses are still valid. The hardware withdraws its address before it is destroyed.
  bool addresses_valid() const noexcept {
    for (ArmIndex i = 0; i < places.size(); ++i) {
      const SharedArmState* shared = cycle->signals(i).shared;
      if (shared != nullptr && states[places[i].shared] != to_interface(shared)) return false;
    }
    return true;
  }

  struct Place {
    std::size_t first_state = 0, first_command = 0, joints = 0, shared = 0;
  };
  DescriptionFolder description;
  Registry registry;
  std::vector<HostedArm> arms;
  std::unique_ptr<HostedCycle> cycle;
  std::unique_ptr<ParameterTable> table;
  std::vector<std::string> state_names, command_names;
  std::vector<double> states, commands;
  std::vector<Place> places;
};

ControllerHost::ControllerHost(const FlatParameters& parameters, const ControllerHostOptions& options)
    : self_(std::make_unique<Implementation>(parameters, options)) {}
ControllerHost::~ControllerHost() = default;

const std::vector<std::string>& ControllerHost::state_names() const { return self_->state_names; }
const std::vector<std::string>& ControllerHost::command_names() const { return self_->command_names; }
std::span<double> ControllerHost::states() { return self_->states; }
std::span<const double> ControllerHost::commands() const { return self_->commands; }

std::string ControllerHost::activate() {
  auto& self = *self_;
  for (ArmIndex i = 0; i < self.arms.size(); ++i) {
    ArmSignals& signals = self.cycle->signals(i);
    signals.shared = nullptr;
    if (!self.arms[i].has_robot_state) continue;
    const double value = self.states[self.places[i].shared];
    if (std::string why = shared_arm_state_refusal(value); !why.empty())
      return "arm '" + self.arms[i].name + "': " + why;
    signals.shared = shared_arm_state(value);
  }
  self.take_states();
  if (std::string why = self.cycle->check(); !why.empty()) return why;
  self.cycle->activate();
  return {};
}

bool ControllerHost::update(double period_s) noexcept {
  auto& self = *self_;
  if (!self.addresses_valid()) {
    std::fill(self.commands.begin(), self.commands.end(), 0.0);
    return false;
  }
  self.take_states();
  (void)self.cycle->step(period_s);
  self.leave_commands();
  return true;
}

void ControllerHost::deactivate() noexcept {
  auto& self = *self_;
  if (!self.cycle->is_active()) return;
  if (!self.addresses_valid()) {  // the hardware may have been destroyed
    for (ArmIndex i = 0; i < self.arms.size(); ++i) self.cycle->signals(i).shared = nullptr;
  }
  self.take_states();
  self.cycle->deactivate();
  self.leave_commands();
}

std::vector<ControllerHost::Parameter> ControllerHost::parameters() const {
  std::vector<Parameter> list;
  for (const auto& name : self_->table->names()) {
    list.push_back({self_->table->describe(name), self_->table->get(name)});
  }
  return list;
}

bool ControllerHost::has_parameter(const std::string& name) const { return self_->table->has(name); }

std::string ControllerHost::set_parameters(const std::vector<rcl_interfaces::msg::Parameter>& parameters) {
  std::vector<Request> requests;
  for (const auto& parameter : parameters) {
    if (!self_->table->has(parameter.name)) continue;  // the node's own parameter
    std::string reason;
    const auto request = self_->table->request(parameter, reason);
    if (!request) return parameter.name + ": " + reason;
    requests.push_back(*request);
  }
  if (requests.empty()) return {};
  MultimodeController& modes = self_->cycle->modes();
  if (self_->cycle->is_active()) {
    const Answer answer = modes.ask(requests);
    return answer.accepted() ? "" : reason(modes, requests.front(), answer.verdict);
  }
  std::uint64_t ticket = 0;  // set by the first step after activation, whenever that is
  const Verdict verdict = modes.post(requests, ticket, Mailbox::kForever);
  return verdict == Verdict::accepted ? "" : reason(modes, requests.front(), verdict);
}

std::vector<std::string> ControllerHost::active() const {
  MultimodeController& modes = self_->cycle->modes();
  std::vector<std::string> names;
  for (std::size_t i = modes.arm_count(); i < modes.instance_count(); ++i) {
    const auto index = static_cast<InstanceIndex>(i);
    if ((modes.active() & bit(index)) != 0) names.push_back(modes.instance(index).name());
  }
  return names;
}

}  // namespace multipanda::ros
