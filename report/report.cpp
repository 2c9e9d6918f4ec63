#include "report/report.hpp"

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <stdexcept>
#include <string_view>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "common/process.hpp"
#include "core/types/codes.hpp"
#include "logs/export.hpp"
#include "report/page_script.hpp"
#include "report/run_of_log.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

fs::path found_log(const fs::path& given) {
  std::error_code error;
  if (fs::is_regular_file(given, error)) return given;
  const fs::path log = given / "log.mcap";
  if (fs::is_regular_file(log, error)) return log;
  throw std::runtime_error("there is no log " + log.string() +
                           "; give a log, or the folder of a recorded run");
}

// Must not replace the file of an active run: its writer uses it and flushes twice per second.
bool is_being_written(const fs::path& log) {
  std::error_code error;
  const auto written = fs::last_write_time(log, error);
  return !error && fs::file_time_type::clock::now() - written < std::chrono::seconds(2);
}

void repair(const fs::path& log, ReportResult& result, std::vector<std::string>& notes) {
  if (is_being_written(log)) return;  // the export reports a missing footer
  try {
    const RepairResult repaired = repair_log(log, true);
    if (repaired.was_complete) return;
    result.repaired = true;
    notes.push_back("The log had no footer (killed, or the disk was full). It was repaired: " +
                    std::to_string(repaired.messages) + " messages are complete" +
                    (repaired.bytes_dropped > 0
                         ? ", the last " + std::to_string(repaired.bytes_dropped) + " bytes were not"
                         : "") +
                    ".");
    if (repaired.chunks_dropped > 0) {
      notes.push_back(std::to_string(repaired.chunks_dropped) + " damaged chunks of the log are left out.");
    }
  } catch (const std::exception& error) {
    notes.push_back(std::string("The log could not be repaired: ") + error.what());
  }
}

Json numbers(const JointVector& values) { return std::vector<double>(values.begin(), values.end()); }

// Data from scene and log for report/report.py; docs/logs.md lists the keys.
Json metadata(const RunOfLog& run, const ReportOptions& options) {
  Json out;
  out["run"] = run.run;
  for (const auto& [key, value] : options.info) out["run"][key] = value;
  out["missing"] = run.missing ? Json(*run.missing) : Json();
  const Json layout = Json::parse(run.layout, nullptr, false);
  if (!layout.is_discarded()) out["layout"] = layout;
  out["scene_text"] = run.scene_text;
  for (std::size_t i = 0; i < static_cast<std::size_t>(Intervention::count_); ++i) {
    const auto rule = static_cast<Intervention>(i);
    out["intervention_units"][std::string(to_string(rule))] = unit_of(rule);
  }
  if (!run.scene) return out;
  const Scene& scene = *run.scene;
  out["scene_name"] = scene.name;
  out["scene_description"] = scene.description;
  const PlantFidelity& plant = scene.plant;
  out["plant"] = {{"name", plant.name},
                  {"joint_friction", plant.joint_friction},
                  {"torque_bandwidth_hz", plant.torque_bandwidth_hz},
                  {"command_delay_s", plant.command_delay_s},
                  {"noise_q_rad", plant.noise_q_rad},
                  {"noise_dq_rad_per_s", plant.noise_dq_rad_per_s},
                  {"noise_tau_nm", plant.noise_tau_nm},
                  {"substeps", scene.substeps}};
  for (const SceneArm& arm : scene.arms) {
    const ArmLimits& limits = arm.safety.joints;
    out["limits"][arm.name] = {{"q_min", numbers(limits.q_min)},
                               {"q_max", numbers(limits.q_max)},
                               {"dq_max", numbers(limits.dq_max)},
                               {"tau_max", numbers(limits.tau_max)},
                               {"tau_rate_max", numbers(limits.tau_rate_max)}};
  }
  for (const InstanceConfig& instance : scene.controllets) {
    Json arms = Json::array();
    for (const ArmIndex arm : instance.arms) arms.push_back(scene.arms.at(arm).name);
    out["instance_arms"][instance.name] = arms;
  }
  return out;
}

void add_pictures(const ScenePictures& drawn, Json& meta, ReportResult& result) {
  meta["pictures"] = Json::array();
  for (const auto& picture : drawn.pictures) {
    meta["pictures"].push_back({{"file", picture.file.filename().string()}, {"caption", picture.caption}});
    result.pictures.push_back(picture.file);
  }
  meta["pictures_missing"] = drawn.missing;
  meta["pictures_note"] = drawn.note;
}

// Data files of the page, removed at the end, on failure, and on Ctrl-C, SIGTERM or SIGHUP, which end
// the program.
class Material {
 public:
  Material(const fs::path& directory, bool keep)
      : keep_(keep),
        npz_(directory / "report_data.npz"),
        json_(directory / "report_data.json"),
        signals_([this](int signal) {
          remove();
          constexpr std::string_view kMessage = "no report: interrupted\n";
          (void)!write(STDERR_FILENO, kMessage.data(), kMessage.size());
          _exit(128 + signal);
        }) {}
  ~Material() {
    if (!keep_) remove();
  }
  Material(const Material&) = delete;
  Material& operator=(const Material&) = delete;
  const fs::path& npz() const { return npz_; }
  const fs::path& json() const { return json_; }

 private:
  void remove() const {
    std::error_code ignored;
    fs::remove(npz_, ignored);
    fs::remove(json_, ignored);
  }

  bool keep_;
  fs::path npz_, json_;
  SignalWatch signals_;
};

}  // namespace

ReportResult make_report(const fs::path& log_or_directory, const ReportOptions& options) {
  const fs::path log = found_log(log_or_directory);
  const fs::path directory = options.directory.empty() ? fs::absolute(log).parent_path() : options.directory;
  const PageScript script("report/report.py", "the report");
  std::error_code error;
  fs::create_directories(directory, error);
  if (error)
    throw std::runtime_error("cannot create the folder " + directory.string() + ": " + error.message());

  ReportResult result;
  std::vector<std::string> notes;
  repair(log, result, notes);
  const Material material(directory, options.keep_data);
  const ExportResult exported = export_npz(log, material.npz());
  notes.insert(notes.end(), exported.notes.begin(), exported.notes.end());

  const RunOfLog run = read_run(log, options.controllets);
  if (!run.scene) notes.push_back("Limits and plant: " + run.scene_missing + ".");
  Json meta = metadata(run, options);
  ScenePictures drawn;
  if (options.pictures) {
    drawn = draw_scene(run, options.max_pictures, directory);
  } else {
    drawn.missing = "they were not requested";
  }
  add_pictures(drawn, meta, result);
  meta["notes"] = notes;
  std::ofstream(material.json()) << meta.dump(1, ' ', false, Json::error_handler_t::replace);

  std::vector<std::string> arguments{material.npz().string(), "--meta", material.json().string(), "--out",
                                     directory.string()};
  if (!result.pictures.empty()) arguments.push_back("--pictures");
  for (const fs::path& picture : result.pictures) arguments.push_back(picture.string());
  script.run(arguments);
  result.page = directory / "report.html";
  if (!fs::exists(result.page)) {
    throw std::runtime_error("the report was not made: there is no " + result.page.string());
  }
  if (!drawn.missing.empty()) notes.push_back("No pictures of the scene: " + drawn.missing + ".");
  result.notes = std::move(notes);
  return result;
}

}  // namespace multipanda
