#include "ros/host/hardware_host.hpp"

#include <stdexcept>

#include "ros/adapter/ros_adapter.hpp"
#include "runtime/embedded/hardware_system.hpp"

namespace multipanda::ros {
namespace {

bool flag(const std::map<std::string, std::string>& parameters, const std::string& name, bool otherwise) {
  const auto it = parameters.find(name);
  if (it == parameters.end()) return otherwise;
  if (it->second == "true" || it->second == "True") return true;
  if (it->second == "false" || it->second == "False") return false;
  throw std::invalid_argument("hardware parameter '" + name + "': expected true or false, found '" +
                              it->second + "'");
}

std::vector<HardwareHost::Number> plain(const std::vector<HardwareNumber>& numbers) {
  std::vector<HardwareHost::Number> list;
  for (const auto& number : numbers) list.push_back({number.prefix, number.name, number.value});
  return list;
}

}  // namespace

struct HardwareHost::Implementation {
  Extras extras;
  std::unique_ptr<HardwareSystem> system;
  std::unique_ptr<RosAdapter> services;
  TearDown tear_down;
};

HardwareHost::HardwareHost(Kind kind, const std::map<std::string, std::string>& parameters,
                           std::function<void(const std::string&)> report)
    : self_(std::make_unique<Implementation>()) {
  self_->extras.services = flag(parameters, "services", true);
  const bool real = kind == Kind::fci;
  const bool lockstep = flag(parameters, "lockstep", false);
  const Scene scene = hardware_scene(parameters, real, {"services", "lockstep"});
  self_->system =
      std::make_unique<HardwareSystem>(scene, !real      ? mujoco_arms(scene)
                                              : lockstep ? lockstep_arms(scene, std::move(report))
                                                         : answered_arms(scene, std::move(report)));
}

HardwareHost::~HardwareHost() {
  self_->tear_down.wait();
  self_->services.reset();
}

const HardwareHost::Extras& HardwareHost::extras() const { return self_->extras; }
std::vector<HardwareHost::Number> HardwareHost::states() const { return plain(self_->system->states()); }
std::vector<HardwareHost::Number> HardwareHost::commands() const { return plain(self_->system->commands()); }
void HardwareHost::connect() {
  self_->tear_down.wait();
  self_->system->connect();
}
void HardwareHost::disconnect() {
  self_->tear_down.wait();
  if (self_->system->is_connected()) self_->system->disconnect();
}

void HardwareHost::disconnect_later(std::shared_ptr<void> node) noexcept {
  // The system's own thread starts at once, without waiting for the services.
  self_->system->disconnect_later();
  self_->tear_down.start([this, node = std::move(node)]() mutable {
    self_->services.reset();
    node.reset();
  });
}

void HardwareHost::serve(rcl_node_t* node) {
  RosOptions options;
  options.parameter_services = options.controllets = options.state = options.motions = false;
  self_->services = std::make_unique<RosAdapter>(self_->system->run_context(), options, node);
}
void HardwareHost::stop_serving() {
  self_->tear_down.wait();
  self_->services.reset();
}

bool HardwareHost::prepare_switch(const std::vector<std::string>& start, const std::vector<std::string>& stop,
                                  std::string& why) const {
  return self_->system->prepare_switch(start, stop, why);
}
void HardwareHost::perform_switch(const std::vector<std::string>& start,
                                  const std::vector<std::string>& stop) noexcept {
  self_->system->perform_switch(start, stop);
}
void HardwareHost::deactivate() noexcept { self_->system->deactivate(); }
bool HardwareHost::read() noexcept { return self_->system->read() == HardwareSystem::Result::ok; }
bool HardwareHost::write(std::int64_t stamp_ns) noexcept {
  return self_->system->write(stamp_ns) == HardwareSystem::Result::ok;
}
std::string HardwareHost::fault() const { return self_->system->fault(); }

}  // namespace multipanda::ros
