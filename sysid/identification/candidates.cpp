#include <algorithm>
#include <atomic>
#include <cmath>
#include <stdexcept>
#include <thread>

#include <fmt/format.h>

#include "common/text.hpp"
#include "sysid/identification/identify.hpp"
#include "sysid/identification/identify_parts.hpp"

namespace multipanda {
namespace {

using Kind = FrictionKind;
using Parts = std::vector<FrictionPart>;

// Two means count as equal below a relative difference, or below the resolution of torque sensors.
constexpr double kAsGood = 0.03;
constexpr double kUnresolved = 0.003;  // [N m]

Parts presliding(const std::vector<double>& distances) {
  Parts out;
  for (const double s : distances) out.push_back({Kind::presliding, s});
  return out;
}

Parts joined_parts(Parts a, const Parts& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

struct Law {
  std::string name;
  Parts parts;
};

std::vector<Law> laws(bool table) {
  const Parts viscous{{Kind::offset}, {Kind::viscous}};
  const Parts stribeck{{Kind::offset}, {Kind::viscous}, {Kind::stribeck}};
  const Parts three = presliding({0.003, 0.02, 0.1});
  const Parts six = presliding({0.001, 0.003, 0.01, 0.03, 0.1, 0.3});
  std::vector<Law> out{{"rigid", {}}, {"offset", {{Kind::offset}}}};
  if (table) out.push_back({"table", {{Kind::offset}, {Kind::sigmoid}}});
  out.push_back({"coulomb", joined_parts(viscous, {{Kind::coulomb}})});
  out.push_back({"presliding3", joined_parts(viscous, three)});
  out.push_back({"stribeck+presliding3", joined_parts(stribeck, three)});
  out.push_back({"stribeck+presliding4", joined_parts(stribeck, presliding({0.002, 0.01, 0.06, 0.3}))});
  out.push_back(
      {"stribeck+presliding5", joined_parts(stribeck, presliding({0.001, 0.003, 0.01, 0.03, 0.1}))});
  out.push_back({"stribeck+presliding6", joined_parts(stribeck, six)});
  return out;
}

Family family_of(const Law& law, bool tilt, bool gains, Parts& all) {
  Family family{law.name + (tilt ? "+tilt" : "") + (gains ? "+gains" : ""), {}, tilt, gains};
  for (const FrictionPart& part : law.parts) {
    const auto at = std::find(all.begin(), all.end(), part);
    family.parts.push_back(static_cast<std::size_t>(at - all.begin()));
    if (at == all.end()) all.push_back(part);
  }
  return family;
}

void keep(std::vector<Family>& families, const std::vector<std::string>& requested) {
  if (requested.empty()) return;
  std::vector<std::string> known;
  for (const Family& family : families) known.push_back(family.name);
  std::vector<Family> kept;
  for (const std::string& name : requested) {
    const auto at = std::find(known.begin(), known.end(), name);
    if (at == known.end()) {
      throw std::invalid_argument(fmt::format("unknown candidate '{}'{}", name, name_hint(name, known, "")));
    }
    kept.push_back(families[static_cast<std::size_t>(at - known.begin())]);
  }
  families = std::move(kept);
}

Eigen::VectorXd root_mean(const Eigen::VectorXd& squares, Eigen::Index rows) {
  return (squares / static_cast<double>(std::max<Eigen::Index>(1, rows))).cwiseSqrt();
}

}  // namespace

std::size_t coefficient_count(const Family& family, std::size_t joints) {
  return joints * (family.parts.size() + (family.gains ? 1 : 0)) + (family.tilt ? 2 : 0);
}

Candidates candidates(bool table, const std::vector<std::string>& requested, bool one_base) {
  Candidates out;
  for (const Law& law : laws(table)) {
    out.families.push_back(family_of(law, false, false, out.parts));
    if (one_base) out.families.push_back(family_of(law, true, false, out.parts));
    out.families.push_back(family_of(law, one_base, true, out.parts));
  }
  Law inertia = laws(table).back();
  inertia.name += "+joint inertia";
  inertia.parts.push_back({Kind::acceleration});
  Family family = family_of(inertia, one_base, true, out.parts);
  family.eligible = false;
  std::stable_sort(out.families.begin(), out.families.end(), [](const Family& a, const Family& b) {
    return coefficient_count(a, 7) < coefficient_count(b, 7);
  });
  out.families.push_back(family);
  keep(out.families, requested);
  return out;
}

Candidates payload_candidates() {
  Candidates out;
  const Parts friction{{Kind::offset}, {Kind::viscous}, {Kind::coulomb}};
  for (const Law& law :
       {Law{"body", {}}, Law{"body+offset", {{Kind::offset}}}, Law{"body+coulomb", friction}}) {
    out.families.push_back(family_of(law, false, false, out.parts));
  }
  return out;
}

Eigen::VectorXd expected_rmse(const Eigen::VectorXd& validated, const Eigen::VectorXd& fitted,
                              std::size_t folds) {
  const double share = 1 - 1 / static_cast<double>(folds);
  const Eigen::VectorXd square = fitted.cwiseAbs2();
  return (square + share * (validated.cwiseAbs2() - square).cwiseMax(0)).cwiseSqrt();
}

Expected fit_and_expect(std::span<const Equations> blocks, std::span<const Equations> alone,
                        const FitProblem& problem, const Family& family) {
  const Equations all = stacked(blocks, [](std::size_t) { return true; });
  Expected out{fit_consistent(all, problem, family), {}};
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(all.size()));
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    const Equations others = stacked(blocks, [k](std::size_t b) { return b != k; });
    sum += squared_errors(alone[k], problem, fit_consistent(others, problem, family));
  }
  const Eigen::Index rows = all.front().rows;
  out.rmse = expected_rmse(root_mean(sum, rows), root_mean(squared_errors(all, problem, out.fit), rows),
                           blocks.size());
  return out;
}

CrossValidation cross_validate(std::span<const Equations> blocks, std::span<const Equations> alone,
                               const FitProblem& problem, const Candidates& candidates, bool choose,
                               unsigned threads) {
  const std::size_t folds = blocks.size(), families = candidates.families.size();
  const Eigen::Index n = static_cast<Eigen::Index>(blocks.front().size());
  const Equations all = stacked(blocks, [](std::size_t) { return true; });
  CrossValidation out;
  out.folds = folds;
  out.rmse.resize(families);
  out.mean.assign(families, 0);
  if (choose) {
    std::vector<Equations> others;
    for (std::size_t k = 0; k < folds; ++k) {
      others.push_back(stacked(blocks, [k](std::size_t b) { return b != k; }));
    }
    // One task per family and fold.
    std::vector<Eigen::VectorXd> squares(families * folds);
    std::atomic<std::size_t> next{0};
    const auto work = [&] {
      for (std::size_t task = next++; task < squares.size(); task = next++) {
        const Family& family = candidates.families[task / folds];
        const std::size_t k = task % folds;
        squares[task] = squared_errors(alone[k], problem, fit_consistent(others[k], problem, family));
      }
    };
    {
      std::vector<std::jthread> pool;
      for (unsigned i = 1; i < threads; ++i) pool.emplace_back(work);
      work();
    }
    for (std::size_t f = 0; f < families; ++f) {
      Eigen::VectorXd sum = Eigen::VectorXd::Zero(n);
      for (std::size_t k = 0; k < folds; ++k) sum += squares[f * folds + k];
      out.rmse[f] = root_mean(sum, all.front().rows);
      out.mean[f] = out.rmse[f].mean();
    }
    double best = INFINITY;
    for (std::size_t f = 0; f < families; ++f) {
      if (candidates.families[f].eligible) best = std::min(best, out.mean[f]);
    }
    const double enough = best + std::max(kAsGood * best, kUnresolved);
    while (!candidates.families[out.chosen].eligible || !(out.mean[out.chosen] <= enough)) ++out.chosen;
  } else {
    out.chosen = families - 1;
  }
  const Family& family = candidates.families[out.chosen];
  out.fit = fit_consistent(all, problem, family);
  return out;
}

std::vector<std::string> family_names() {
  std::vector<std::string> out;
  for (const Family& family : candidates(true).families) out.push_back(family.name);
  return out;
}

}  // namespace multipanda
