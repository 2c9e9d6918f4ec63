#include "experiments/finished_runs.hpp"

#include <fstream>
#include <stdexcept>

#include <fmt/format.h>

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

}  // namespace

Json what_decides(const Experiment& experiment, const ExperimentOptions& options, const std::string& scenes) {
  Json what = describe(experiment);
  for (const char* shown : {"machine", "description", "published", "show", "limits"}) what.erase(shown);
  Json addresses = Json::object();
  for (const auto& [arm, address] : options.backend.addresses) addresses[arm] = address;
  what["fast"] = options.fast;
  what["backend"] = name_of(options.backend.kind);
  what["addresses"] = addresses;
  what["runs_and_scenes"] = fmt::format("{:016x}", std::hash<std::string>{}(scenes));
  return what;
}

FinishedRuns::FinishedRuns(fs::path folder, Json what, bool resume)
    : file_(std::move(folder) / "finished_runs.json"), what_(std::move(what)) {
  if (!resume) return;
  std::ifstream in(file_);
  const Json read = Json::parse(in, nullptr, false);
  if (!in || !read.is_object() || !read.contains("what") || !read.contains("runs"))
    throw std::invalid_argument(fmt::format("{} has no interrupted experiment: there is no valid {}",
                                            file_.parent_path().string(), file_.filename().string()));
  for (const auto& [key, value] : what_.items()) {
    const Json before = read["what"].value(key, Json());
    if (before != value)
      throw std::invalid_argument(
          fmt::format("{} was begun with another {}: {}, now {}; resume it with the same arguments",
                      file_.parent_path().string(), key, before.dump(), value.dump()));
  }
  for (const auto& [name, record] : read["runs"].items()) runs_.emplace(name, record);
}

const Json* FinishedRuns::find(const std::string& run) const {
  const auto found = runs_.find(run);
  return found == runs_.end() ? nullptr : &found->second;
}

void FinishedRuns::add(const std::string& run, const Json& record) {
  runs_[run] = record;
  const fs::path part = file_.string() + ".part";
  std::ofstream out(part, std::ios::trunc);
  out << Json{{"what", what_}, {"runs", runs_}}.dump(1, ' ', false, Json::error_handler_t::replace) << '\n';
  out.close();
  if (!out) throw std::runtime_error("cannot write " + part.string() + "; has the disk space?");
  fs::rename(part, file_);
}

void FinishedRuns::remove_file() const {
  std::error_code ignored;
  fs::remove(file_, ignored);
}

}  // namespace multipanda
