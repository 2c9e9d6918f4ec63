#include <algorithm>
#include <fstream>
#include <stdexcept>

#include <nlohmann/json.hpp>

#include "logs/npz.hpp"
#include "report/page_script.hpp"
#include "sysid/comparison/compare.hpp"

namespace multipanda {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// "0/t", "0/q/real", "0/q/sim", ... per arm, by its number.
void write_series(const fs::path& file, std::span<const ComparedArm> arms) {
  std::vector<NpzWriter::Array> arrays;
  std::vector<const Eigen::MatrixXd*> values;
  std::vector<Eigen::MatrixXd> times;
  times.reserve(arms.size());
  const auto add = [&](const std::string& name, const Eigen::MatrixXd& series) {
    arrays.push_back({name, NpzWriter::Kind::real, static_cast<std::size_t>(series.rows()),
                      static_cast<std::size_t>(series.cols()), true});
    values.push_back(&series);
  };
  for (std::size_t i = 0; i < arms.size(); ++i) {
    const AlignedPair& pair = arms[i].shown;
    const std::string arm = std::to_string(i) + "/";
    add(arm + "t", times.emplace_back(pair.t));
    for (std::size_t k = 0; k < pair.series.size(); ++k) {
      if (!pair.series[k].missing.empty()) continue;
      add(arm + quantities()[k].name + "/real", pair.series[k].real);
      add(arm + quantities()[k].name + "/sim", pair.series[k].sim);
    }
  }
  NpzWriter writer(file, std::move(arrays));
  std::vector<double> row;
  for (std::size_t i = 0; i < values.size(); ++i) {
    for (Eigen::Index k = 0; k < values[i]->rows(); ++k) {
      const Eigen::VectorXd numbers = values[i]->row(k);
      row.assign(numbers.begin(), numbers.end());
      writer.add(i, row);
    }
  }
  writer.close();
}

Json gate_json(const std::vector<GateResult>& gate) {
  Json out = Json::array();
  for (const GateResult& result : gate) {
    out.push_back({{"quantity", result.limit.quantity},
                   {"figure", result.limit.figure},
                   {"limit", result.limit.limit},
                   {"found", result.found ? Json(*result.found) : Json()},
                   {"axis", result.axis},
                   {"held", result.held},
                   {"text", result.text}});
  }
  return out;
}

}  // namespace

Json comparison_results(const std::string& real, const std::string& sim, std::span<const ComparedArm> arms) {
  Json out{{"real", real}, {"sim", sim}, {"passed", true}, {"arms", Json::array()}};
  for (const ComparedArm& arm : arms) {
    Json entry = to_json(arm.comparison);
    entry["gate"] = gate_json(arm.gate);
    for (const GateResult& result : arm.gate) {
      if (!result.held) out["passed"] = false;
    }
    out["arms"].push_back(std::move(entry));
  }
  return out;
}

fs::path make_comparison_page(const fs::path& folder, const Json& results,
                              std::span<const ComparedArm> arms) {
  fs::create_directories(folder);
  std::ofstream(folder / "results.json")
      << results.dump(1, ' ', false, Json::error_handler_t::replace) << '\n';
  const fs::path series = folder / "series.npz";
  write_series(series, arms);
  PageScript("sysid/comparison/compare_page.py", "the page").run({folder.string()});
  std::error_code ignored;
  fs::remove(series, ignored);
  return folder / "report.html";
}

}  // namespace multipanda
