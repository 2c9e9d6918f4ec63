#include "cli/channel_arguments.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "common/own_files.hpp"
#include "common/text.hpp"
#include "core/rt/thread_setup.hpp"
#include "motion_generators/set_point_channel.hpp"

namespace multipanda::cli {

namespace fs = std::filesystem;

void add_channel_arguments(CLI::App* command, ChannelArguments& arguments) {
  CLI::Option* socket = option(command, "--socket", arguments.socket,
                               "Socket of the run (default: that of the only running scene)", named("PATH"));
  CLI::Option* ros = command
                         ->add_flag("--ros", arguments.ros,
                                    "Publish to ROS topics of a run with --ros instead of the socket")
                         ->excludes(socket);
  option(command, "--node", arguments.node, "Name of the run's ROS node", named("NAME"), shown)->needs(ros);
}

std::unique_ptr<SetPointChannel> open_channel(const ChannelArguments& arguments,
                                              const std::string& own_node) {
  if (arguments.ros) return make_topic_link({.node = arguments.node, .own_node = own_node, .remaps = {}});
  return std::make_unique<LiveInputChannel>(arguments.socket.empty() ? only_running_socket()
                                                                     : fs::path(arguments.socket));
}

nlohmann::json publication_of(const PublishReport& report) {
  return {
      {"ended_by", report.ended_by},
      {"samples", report.samples},
      {"missed", report.missed},
      {"unsent", report.unsent},
      {"elapsed_s", report.elapsed_s},
      {"rate_hz", report.rate_hz},
      {"late_us",
       {{"median", report.late_median_us}, {"p99", report.late_p99_us}, {"worst", report.late_worst_us}}}};
}

nlohmann::json set_up_publishing_thread() {
  // Below the loop's priority of 80: a late set-point is bridged, a late cycle is not.
  constexpr int kPriority = 70;
  nlohmann::json thread = nlohmann::json::array();
  for (const auto& step : set_up_thread({.lock_memory = false, .fifo_priority = kPriority, .cpu = {}})) {
    thread.push_back({{"what", step.what}, {"done", step.done}, {"reason", step.reason}});
  }
  return thread;
}

fs::path config_file(const std::string& command, const std::string& folder, const std::string& name) {
  if (name.find('/') != std::string::npos || name.ends_with(".yaml")) return name;
  const fs::path place = share_folder() / "config" / folder;
  std::vector<std::string> names;
  std::error_code missing;
  for (const auto& entry : fs::directory_iterator(place, missing))
    names.push_back(entry.path().stem().string());
  std::sort(names.begin(), names.end());
  if (std::find(names.begin(), names.end(), name) == names.end()) {
    throw UsageError(fmt::format("{}: there is no '{}'{} (a path contains a slash or ends in .yaml)", command,
                                 name, name_hint(name, names, "there are none")));
  }
  return place / (name + ".yaml");
}

}  // namespace multipanda::cli
