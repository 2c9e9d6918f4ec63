#include "cli/link_words.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "core/rt/thread_setup.hpp"
#include "generators/live_link.hpp"
#include "generators/topic_link.hpp"
#include "runtime/project.hpp"
#include "scene/names.hpp"

namespace multipanda::cli {

namespace fs = std::filesystem;

void add_link_words(CLI::App* command, LinkWords& words) {
  CLI::Option* socket =
      command->add_option("--socket", words.socket, "Of the run; without it the only one that is there")
          ->type_name("PATH");
  CLI::Option* ros =
      command->add_flag("--ros", words.ros, "By ROS topics, to a run with --ros, in place of the socket")
          ->excludes(socket);
  command->add_option("--node", words.node, "Of the run, on ROS")
      ->type_name("NAME")
      ->capture_default_str()
      ->needs(ros);
}

std::unique_ptr<SetPointLink> open_link(const LinkWords& words, const std::string& own_node) {
  if (words.ros) return make_topic_link({.node = words.node, .own_node = own_node, .remaps = {}});
  return std::make_unique<LiveLink>(words.socket.empty() ? only_running_socket() : fs::path(words.socket));
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
  // Below the loop's 80: a set-point that comes late is bridged, a cycle is not.
  constexpr int kPriority = 70;
  nlohmann::json thread = nlohmann::json::array();
  for (const auto& step : set_up_thread({.lock_memory = false, .fifo_priority = kPriority, .cpu = {}})) {
    thread.push_back({{"what", step.what}, {"done", step.done}, {"reason", step.reason}});
  }
  return thread;
}

fs::path config_file(const std::string& command, const std::string& folder, const std::string& name) {
  if (name.find('/') != std::string::npos || name.ends_with(".yaml")) return name;
  const fs::path place = project_root() / "config" / folder;
  std::vector<std::string> names;
  std::error_code missing;
  for (const auto& entry : fs::directory_iterator(place, missing))
    names.push_back(entry.path().stem().string());
  std::sort(names.begin(), names.end());
  if (std::find(names.begin(), names.end(), name) == names.end()) {
    throw UsageError(fmt::format("{}: there is no '{}'{} (a path needs a slash or the ending .yaml)", command,
                                 name, name_hint(name, names, "there are none")));
  }
  return place / (name + ".yaml");
}

}  // namespace multipanda::cli
