// Drives the hosts with the calls of a controller_manager, and times each update() of the controller from
// outside. Arguments, each KEY=VALUE:
//
//   hardware.NAME=TEXT    parameter of MujocoSystem
//   controller.NAME=VALUE parameter of the controller: true, a number, [a, b], or text
//   cycles=N              length of the activation
//   paced=true            a cycle each millisecond of the wall clock, with SCHED_FIFO 50 if permitted
//   late=[A, B]           cycles before which the loop sleeps for 5 ms more
//   node=NAME             the controller's interfaces are on a ROS node of this name
//   times=FILE            gets the duration of every update [us], one a line
//
// Prints the messages of the controller.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>
#include <optional>
#include <sched.h>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "ros/host/controller_host.hpp"
#include "ros/host/hardware_host.hpp"
#include "ros/rcl/rcl.hpp"

namespace multipanda::ros::drive_host {
namespace {

using Clock = std::chrono::steady_clock;

struct Settings {
  std::map<std::string, std::string> hardware, others;
  FlatParameters controller;
  std::string text(const std::string& key) const {
    const auto found = others.find(key);
    return found == others.end() ? std::string() : found->second;
  }
};

std::vector<std::string> items_of(const std::string& text) {
  std::vector<std::string> items;
  std::istringstream in(text.substr(1, text.size() - 2));
  for (std::string item; std::getline(in, item, ',');) {
    item.erase(0, item.find_first_not_of(' '));
    items.push_back(item);
  }
  return items;
}

bool is_number(const std::string& text) {
  return !text.empty() && text.find_first_not_of("0123456789.-") == std::string::npos;
}

ParameterValue value_of(const std::string& text) {
  if (text.starts_with('[')) {
    const auto items = items_of(text);
    if (items.empty() || !std::ranges::all_of(items, is_number)) return items;
    std::vector<double> numbers;
    for (const auto& item : items) numbers.push_back(std::stod(item));
    return numbers;
  }
  if (text == "true" || text == "false") return text == "true";
  if (is_number(text)) return std::stod(text);
  return text;
}

Settings settings_of(int count, char** words) {
  Settings settings;
  for (int i = 1; i < count; ++i) {
    const std::string word = words[i];
    const auto equals = word.find('=');
    if (equals == std::string::npos) throw std::invalid_argument("expected KEY=VALUE, found '" + word + "'");
    const std::string key = word.substr(0, equals), value = word.substr(equals + 1);
    if (key.starts_with("hardware.")) {
      settings.hardware[key.substr(9)] = value;
    } else if (key.starts_with("controller.")) {
      settings.controller.emplace_back(key.substr(11), value_of(value));
    } else {
      settings.others[key] = value;
    }
  }
  return settings;
}

struct Ros {
  explicit Ros(const std::string& name) : node(context, name) {}
  Context context;
  Node node;
};

void run(const Settings& settings) {
  std::optional<Ros> ros;
  if (!settings.text("node").empty()) ros.emplace(settings.text("node"));
  HardwareHost hardware(HardwareHost::Kind::mujoco, settings.hardware, {});
  ControllerHostOptions options;
  options.report = [](const std::string& text) { std::cout << text << std::endl; };
  if (ros) options.node = ros->node.handle();
  std::optional<ControllerHost> controller;
  controller.emplace(settings.controller, options);

  std::map<std::string, double*> numbers;
  for (const auto& n : hardware.states()) numbers["state " + n.prefix + "/" + n.name] = n.value;
  for (const auto& n : hardware.commands()) numbers["command " + n.prefix + "/" + n.name] = n.value;
  std::vector<double*> states, commands;
  for (const auto& name : controller->state_names()) states.push_back(numbers.at("state " + name));
  for (const auto& name : controller->command_names()) commands.push_back(numbers.at("command " + name));
  const auto take = [&] {
    for (std::size_t i = 0; i < states.size(); ++i) controller->states()[i] = *states[i];
  };

  hardware.connect();
  std::string why;
  if (!hardware.prepare_switch(controller->command_names(), {}, why)) throw std::runtime_error(why);
  hardware.perform_switch(controller->command_names(), {});
  take();
  if (why = controller->activate(); !why.empty()) throw std::runtime_error(why);

  const bool paced = settings.text("paced") == "true";
  if (paced) {
    const sched_param priority{.sched_priority = 50};
    if (sched_setscheduler(0, SCHED_FIFO, &priority) != 0) std::cout << "no SCHED_FIFO\n";
  }
  std::vector<std::size_t> late;
  if (!settings.text("late").empty())
    for (const auto& item : items_of(settings.text("late"))) late.push_back(std::stoul(item));
  const std::size_t cycles = std::stoul(settings.text("cycles"));
  std::vector<double> times(cycles);
  auto next = Clock::now(), before = next;
  for (std::size_t cycle = 1; cycle <= cycles; ++cycle) {
    if (paced) std::this_thread::sleep_until(next += std::chrono::milliseconds(1));
    if (std::ranges::find(late, cycle) != late.end())
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    // A controller_manager passes the time since its last cycle.
    const auto now = Clock::now();
    const double period_s = paced ? std::chrono::duration<double>(now - before).count() : 0.001;
    before = now;
    if (paced && now > next + std::chrono::milliseconds(1)) next = now;
    bool stands = hardware.read();
    take();
    const auto begin = Clock::now();
    stands = controller->update(period_s) && stands;
    times[cycle - 1] = std::chrono::duration<double, std::micro>(Clock::now() - begin).count();
    for (std::size_t i = 0; i < commands.size(); ++i) *commands[i] = controller->commands()[i];
    stands = hardware.write(static_cast<std::int64_t>(cycle) * 1'000'000) && stands;
    if (!stands) throw std::runtime_error("the arms stopped: " + hardware.fault());
    if (!paced && cycle % 500 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  controller->deactivate();
  controller.reset();  // its file is written
  hardware.disconnect();
  if (settings.text("times").empty()) return;
  std::ofstream out(settings.text("times"));
  for (const double us : times) out << us << '\n';
}

}  // namespace
}  // namespace multipanda::ros::drive_host

int main(int count, char** words) {
  using namespace multipanda::ros::drive_host;
  try {
    run(settings_of(count, words));
  } catch (const std::exception& error) {
    std::cerr << "drive_host: " << error.what() << '\n';
    return 1;
  }
  return 0;
}
