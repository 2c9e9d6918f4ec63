#include "experiments/beside_log.hpp"

#include <algorithm>
#include <charconv>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include <fmt/format.h>

#include "common/spelling.hpp"
#include "experiments/on_arms.hpp"
#include "experiments/task_runs.hpp"
#include "logs/export.hpp"
#include "logs/mcap_reader.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// The scene as stored in the log; empty if the log has none.
std::string scene_in(const fs::path& log) {
  McapReader reader(log);
  (void)reader.next();  // attachments precede the first message
  for (const auto& attachment : reader.attachments()) {
    if (attachment.name == "scene.yaml") return attachment.data;
  }
  return {};
}

// "measured_k10_2.mcap": variant and repeat.
bool split_name(const std::string& stem, std::string& variant, std::size_t& repeat) {
  const std::string head = std::string(kMeasured) + "_";
  const auto last = stem.rfind('_');
  if (!stem.starts_with(head) || last <= head.size()) return false;
  variant = stem.substr(head.size(), last - head.size());
  const char* end = stem.data() + stem.size();
  return std::from_chars(stem.data() + last + 1, end, repeat).ptr == end;
}

void add_folder(const fs::path& folder, const std::vector<const ExperimentVariant*>& variants,
                std::vector<BesideLog>& logs) {
  const std::size_t before = logs.size();
  for (const auto& entry : fs::directory_iterator(folder)) {
    std::string name;
    std::size_t repeat = 0;
    if (entry.path().extension() != ".mcap" || !split_name(entry.path().stem().string(), name, repeat))
      continue;
    const auto variant = std::ranges::find_if(variants, [&](const auto* each) { return each->name == name; });
    if (variant != variants.end()) logs.push_back({*variant, repeat, entry.path()});
  }
  if (logs.size() == before)
    throw std::invalid_argument(
        fmt::format("--beside {}: it has no log of a variant of this run, such as {}_{}_1.mcap",
                    folder.string(), kMeasured, variants.front()->name));
}

// "CA-MA_2.npz": CA-MA; empty: not such a name.
std::string condition_of(const fs::path& file) {
  const std::string stem = file.stem().string();
  const auto last = stem.rfind('_');
  if (file.extension() != ".npz" || last == std::string::npos || last + 1 == stem.size() ||
      stem.find_first_not_of("0123456789", last + 1) != std::string::npos)
    return {};
  return stem.substr(0, last);
}

// The directory at the end of the zip archive lists its entries. The page reads and checks them; this finds a
// wrong file before the conditions run.
void check_file(const std::string& said, const fs::path& file) {
  constexpr std::streamoff kDirectory = 1 << 16;
  std::ifstream in(file, std::ios::binary | std::ios::ate);
  if (!in || !fs::is_regular_file(file))
    throw std::invalid_argument(fmt::format("--beside {}: there is no file {}", said, file.string()));
  in.seekg(std::max<std::streamoff>(in.tellg() - std::streamoff{kDirectory}, 0));
  const std::string end{std::istreambuf_iterator<char>(in), {}};
  if (end.find("about.npy") == std::string::npos || end.find("stages_us.npy") == std::string::npos)
    throw std::invalid_argument(
        fmt::format("--beside {}: {} is not a measurement by the multimode controller (docs/ros2_control.md)",
                    said, file.string()));
}

}  // namespace

std::vector<BesideLog> beside_logs(const std::vector<std::string>& named,
                                   const std::vector<const ExperimentVariant*>& variants) {
  std::vector<std::string> names;
  for (const auto* variant : variants) names.push_back(variant->name);
  std::vector<BesideLog> logs;
  for (const auto& text : named) {
    const auto equals = text.find('=');
    const auto variant = std::ranges::find(names, text.substr(0, equals));
    const bool says = equals != std::string::npos && !fs::exists(text);
    if (says && variant == names.end())
      throw std::invalid_argument(fmt::format("--beside {}: there is no variant '{}'{}", text,
                                              text.substr(0, equals),
                                              name_hint(text.substr(0, equals), names, "there are none")));
    fs::path path = says ? text.substr(equals + 1) : text;
    if (!says && fs::is_directory(path / "logs")) {
      add_folder(path / "logs", variants, logs);
      continue;
    }
    if (fs::is_directory(path)) path /= "log.mcap";
    if (!fs::is_regular_file(path))
      throw std::invalid_argument(fmt::format("--beside {}: there is no log {}", text, path.string()));
    if (!says && variants.size() != 1)
      throw std::invalid_argument(
          fmt::format("--beside {}: {} variants run; name the one of this log: --beside {}={}", text,
                      variants.size(), names.front(), text));
    logs.push_back(
        {says ? variants[static_cast<std::size_t>(variant - names.begin())] : variants.front(), 1, path});
  }
  for (std::size_t i = 0; i < logs.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      if (logs[i].variant == logs[k].variant && logs[i].repeat == logs[k].repeat)
        throw std::invalid_argument(fmt::format("--beside: two logs of variant '{}', repeat {}",
                                                logs[i].variant->name, logs[i].repeat));
    }
  }
  return logs;
}

Json beside_run(const BesideLog& log, const Json& like, const fs::path& folder) {
  const std::string name = fmt::format("{}_{}_{}", kMeasured, log.variant->name, log.repeat);
  const fs::path arrays = folder / "data" / (name + ".npz");
  (void)export_npz(log.log, arrays);
  const std::string scene = scene_in(log.log);
  Json run = like;
  run["name"] = name;
  run["plant"] = kMeasured;
  run["repeat"] = log.repeat;
  run["seed"] = 0;
  run["log"] = fs::absolute(log.log).lexically_relative(fs::absolute(folder)).string();
  run["npz"] = fs::relative(arrays, folder).string();
  run.erase("objects");
  run["faults"] = Json::array();
  run["interventions"] = Json::array();
  if (!scene.empty()) {
    run["scene_text"] = scene;
    run["timeline"] = timeline_of(scene);
  }
  return run;
}

std::vector<BesideTrace> beside_traces(const std::vector<std::string>& named,
                                       const std::vector<std::string>& conditions) {
  std::vector<BesideTrace> traces;
  const auto runs = [&](const std::string& name) {
    return std::ranges::find(conditions, name) != conditions.end();
  };
  const auto add = [&](const std::string& said, const std::string& condition, const fs::path& file) {
    check_file(said, file);
    traces.push_back({condition, fs::absolute(file)});
  };
  for (const auto& text : named) {
    const auto equals = text.find('=');
    const bool says = equals != std::string::npos && !fs::exists(text);
    const fs::path path = says ? text.substr(equals + 1) : text;
    if (!says && fs::is_directory(path)) {
      std::vector<fs::path> files;
      for (const auto& entry : fs::directory_iterator(path))
        if (runs(condition_of(entry.path()))) files.push_back(entry.path());
      if (files.empty())
        throw std::invalid_argument(
            fmt::format("--beside {}: it has no file of a condition of this run, such as {}_1.npz", text,
                        conditions.front()));
      std::ranges::sort(files);
      for (const auto& file : files) add(text, condition_of(file), file);
      continue;
    }
    const std::string condition = says ? text.substr(0, equals) : condition_of(path);
    if (condition.empty())
      throw std::invalid_argument(fmt::format(
          "--beside {}: its condition is unknown; name it: --beside {}={}", text, conditions.front(), text));
    if (!runs(condition))
      throw std::invalid_argument(fmt::format("--beside {}: there is no condition '{}'{}", text, condition,
                                              name_hint(condition, conditions, "there are none")));
    add(text, condition, path);
  }
  return traces;
}

}  // namespace multipanda
