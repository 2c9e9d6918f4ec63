#include "experiments/refine/refine_page.hpp"

#include <cstdlib>
#include <stdexcept>

#include "analysis/python_script.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

fs::path from_environment(const char* name, const fs::path& otherwise) {
  const char* value = std::getenv(name);
  return value != nullptr && *value != '\0' ? fs::path(value) : otherwise;
}

Json per_arm(const std::vector<Comparison>& comparisons) {
  Json json = Json::object();
  for (const auto& comparison : comparisons) json[comparison.arm] = to_json(comparison);
  return json;
}

}  // namespace

Json refine_json(const Experiment& experiment, const ExperimentVariant& variant, const RefineOptions& options,
                 const RefineResult& result) {
  Json json{{"experiment", experiment.name},    {"title", experiment.title},
            {"variant", variant.name},          {"variant_label", variant.label},
            {"target", options.target.words()}, {"repeats", options.repeats},
            {"plant", options.plant},           {"faults", result.faults},
            {"before", per_arm(result.before)}, {"rounds", Json::array()}};
  if (options.target.hidden) json["hidden_seed"] = *options.target.hidden;
  bool worse = false;
  for (const auto& round : result.rounds) {
    Json one{{"models", Json::object()}, {"after", per_arm(round.comparisons)}, {"changes", Json::object()}};
    for (std::size_t i = 0; i < round.arms.size(); ++i) {
      const auto& arm = round.arms[i];
      one["models"][arm.arm] = {
          {"file", arm.model.filename().string()}, {"found", arm.found}, {"warnings", arm.warnings}};
      one["changes"][arm.arm] = to_json(round.changes[i]);
    }
    json["rounds"].push_back(one);
  }
  if (!result.rounds.empty()) {
    for (const auto& changes : result.rounds.back().changes) {
      for (const auto& change : changes) worse = worse || change.worse;
    }
  }
  json["worse"] = worse;
  return json;
}

fs::path make_refine_page(const fs::path& json) {
  const fs::path python = from_environment("MULTIPANDA_PYTHON", MULTIPANDA_DEFAULT_PYTHON);
  const fs::path script =
      from_environment("MULTIPANDA_SHARE", MULTIPANDA_DEFAULT_SHARE) / "analysis" / "refine" / "main.py";
  for (const fs::path& needed : {python, script}) {
    if (!fs::exists(needed)) {
      throw std::runtime_error("the report needs " + needed.string() +
                               ", which is not there: run ./multipanda setup");
    }
  }
  const ScriptResult made = run_script(python, {"-I", "-B", script.string(), json.string()});
  if (!made.good) {
    throw std::runtime_error("the report was not made; " + script.string() + " says:\n" + made.output);
  }
  return json.parent_path() / "report.html";
}

}  // namespace multipanda
