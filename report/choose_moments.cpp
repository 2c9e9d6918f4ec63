#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>

#include "report/scene_pictures.hpp"

namespace multipanda {
namespace {

constexpr double kApart = 0.4;  // pictures closer in time than this [s] show the same

std::string at(double t, const std::string& what) {
  char text[48];
  (void)std::snprintf(text, sizeof(text), "t = %.1f s", t);
  return text + (what.empty() ? std::string() : ": " + what);
}

std::string joined(const std::vector<std::string>& names) {
  std::string out;
  for (const std::string& name : names) out += (out.empty() ? "" : ", ") + name;
  return out;
}

// The last moment not after t; the first one if there is none.
std::size_t moment_at(const RunOfLog& run, double t) {
  const auto after = std::upper_bound(run.moments.begin(), run.moments.end(), t,
                                      [](double time, const RunOfLog::Moment& m) { return time < m.t; });
  return after == run.moments.begin() ? 0 : static_cast<std::size_t>(after - run.moments.begin()) - 1;
}

}  // namespace

std::vector<ChosenMoment> choose_moments(const RunOfLog& run, std::size_t at_most) {
  std::vector<ChosenMoment> chosen;
  if (run.moments.empty() || at_most == 0) return chosen;
  const auto far_from_all = [&](std::size_t moment) {
    return std::none_of(chosen.begin(), chosen.end(), [&](const ChosenMoment& c) {
      return std::abs(run.moments[c.moment].t - run.moments[moment].t) < kApart;
    });
  };
  const double start = run.moments.front().t, end = run.moments.back().t;
  chosen.push_back({0, at(start, "start")});

  std::vector<RunOfLog::SwitchMoment> switches;
  for (const auto& change : run.switches) {
    if (change.t > start + kApart && (switches.empty() || change.t > switches.back().t + kApart))
      switches.push_back(change);
  }
  const std::size_t room = at_most - 1;
  const std::size_t shown = std::min(room, switches.size());
  for (std::size_t i = 0; i < shown; ++i) {  // spread evenly if there are too many
    const auto& change = switches[shown == switches.size() ? i : i * switches.size() / shown];
    const std::size_t moment = moment_at(run, change.t);
    if (far_from_all(moment)) chosen.push_back({moment, at(change.t, joined(change.started) + " starts")});
  }
  for (const auto& [t, what] : {std::pair(end, "end"), std::pair((start + end) / 2, "")}) {
    const std::size_t moment = moment_at(run, t);
    if (chosen.size() < at_most && far_from_all(moment)) chosen.push_back({moment, at(t, what)});
  }
  std::sort(chosen.begin(), chosen.end(),
            [](const ChosenMoment& a, const ChosenMoment& b) { return a.moment < b.moment; });
  return chosen;
}

}  // namespace multipanda
