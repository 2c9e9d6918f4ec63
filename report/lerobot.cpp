#include <fstream>
#include <stdexcept>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "common/own_files.hpp"
#include "common/process.hpp"
#include "logs/export.hpp"
#include "report/report.hpp"
#include "report/run_of_log.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// A temporary folder, removed at the end unless its contents were moved away.
class WorkFolder {
 public:
  explicit WorkFolder(fs::path path) : path_(std::move(path)) {
    std::error_code error;
    fs::create_directories(path_, error);
    if (error) throw std::runtime_error("cannot create " + path_.string() + ": " + error.message());
  }
  ~WorkFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

// Data of a log that the script needs besides its arrays.
Json about(const fs::path& log, const fs::path& npz) {
  const RunOfLog run = read_run(log);
  const fs::path whole = fs::absolute(log).lexically_normal();
  Json out{{"name", (whole.parent_path().filename() / whole.filename()).string()},
           {"log", whole.string()},
           {"npz", npz.string()}};
  const auto scene = run.run.find("scene");
  out["scene"] = scene != run.run.end() ? scene->second : whole.stem().string();
  const Json layout = Json::parse(run.layout, nullptr, false);
  out["arms"] = Json::array();
  out["instances"] = Json::array();
  if (!layout.is_discarded()) {
    for (const auto& arm : layout.value("arms", Json::array())) out["arms"].push_back(arm.at("name"));
    for (const auto& instance : layout.value("instances", Json::array())) {
      out["instances"].push_back({{"name", instance.at("name")},
                                  {"arms", instance.at("arms")},
                                  {"inputs", instance.value("inputs", Json::array())}});
    }
  }
  if (out["arms"].empty())
    throw std::runtime_error(log.string() + " names no arms: it is not the log of a run");
  out["bases"] = Json::object();
  if (run.scene) {
    refuse_carried_arms(*run.scene, "a data set with one base per arm");
    for (const SceneArm& arm : run.scene->arms) out["bases"][arm.name] = arm.X_WB.values();
  }
  return out;
}

}  // namespace

LerobotResult export_lerobot(const std::vector<fs::path>& logs, const fs::path& folder,
                             const LerobotOptions& options) {
  if (logs.empty()) throw std::runtime_error("a data set needs one log or more");
  if (fs::exists(folder))
    throw std::runtime_error(folder.string() + " exists already; choose another folder, or remove it");
  const fs::path script = share_folder() / "report" / "export_lerobot.py";
  const fs::path python = page_python();
  if (!fs::exists(script) || !fs::exists(python))
    throw std::runtime_error("the export needs " + script.string() + " and " + python.string() + "; " +
                             page_packages_cure());
  // Next to the result, so that the last step is a rename.
  const WorkFolder work(folder.string() + ".part" + std::to_string(getpid()));
  LerobotResult result;
  Json material{{"arms", options.arms},         {"action", options.action},   {"observe", options.observe},
                {"grippers", options.grippers}, {"leaders", options.leaders}, {"outcomes", options.outcomes},
                {"fps", options.fps},           {"task", options.task},       {"logs", Json::array()}};
  for (const fs::path& log : logs) {
    const fs::path npz = work.path() / ("log" + std::to_string(material["logs"].size()) + ".npz");
    for (const auto& note : export_npz(log, npz).notes) result.notes.push_back(log.string() + ": " + note);
    material["logs"].push_back(about(log, npz));
  }
  const fs::path input = work.path() / "material.json", made = work.path() / "dataset";
  fs::create_directories(made);
  std::ofstream(input) << material.dump(-1, ' ', false, Json::error_handler_t::replace);
  // -E: keeps PYTHONPATH of a sourced ROS 2 from hiding the interpreter's packages.
  const ProgramResult ran = run_program(python, {"-E", "-B", script.string(), input.string(), made.string()});
  std::ifstream answered(work.path() / "result.json");
  const Json answer = Json::parse(answered, nullptr, false);
  if (!ran.good() || answer.is_discarded())
    throw std::runtime_error("no data set was made; " + script.string() + " reported:\n" + ran.output +
                             ran.reason);
  if (answer.contains("error")) throw std::runtime_error(answer["error"].get<std::string>());
  for (const auto& note : answer.at("notes")) result.notes.push_back(note.get<std::string>());
  result.said = answer.at("said").get<std::string>();
  fs::rename(made, folder);
  return result;
}

}  // namespace multipanda
