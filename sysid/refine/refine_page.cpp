#include "report/page_script.hpp"
#include "sysid/refine/refine.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

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
  if (options.target.hidden) {
    json["hidden_seed"] = *options.target.hidden;
    json["hidden_motors"] = options.target.motors;
  }
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
  PageScript("sysid/refine/refine_page.py", "the report").run({json.string()});
  return json.parent_path() / "report.html";
}

}  // namespace multipanda
