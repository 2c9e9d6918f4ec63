#include "core/controllets/parameters.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace multipanda {

ParameterSet::ParameterSet(std::vector<ParameterSpec> specs, std::size_t joint_count)
    : specs_(std::move(specs)), entries_(specs_.size()) {
  for (std::size_t i = 0; i < specs_.size(); ++i) {
    const auto& spec = specs_[i];
    auto& entry = entries_[i];
    entry.size = spec.size == ParameterSpec::kPerJoint ? joint_count : spec.size;
    if (entry.size == 0 || entry.size > kMaxParameterSize) {
      throw std::invalid_argument("parameter '" + spec.name + "': 1 to " + std::to_string(kMaxParameterSize) +
                                  " numbers are supported, not " + std::to_string(entry.size));
    }
    // Defaults are written for the largest arm; extra values are ignored.
    const bool one_for_all = spec.initial.size() == 1;
    if (!one_for_all && spec.initial.size() < entry.size) {
      throw std::invalid_argument("parameter '" + spec.name + "': " + std::to_string(entry.size) +
                                  " initial values expected, " + std::to_string(spec.initial.size()) +
                                  " given");
    }
    entry.max.fill(spec.max);
    for (std::size_t k = 0; k < entry.size; ++k) {
      entry.now[k] = spec.initial[one_for_all ? 0 : k];
      entry.goal[k].store(entry.now[k], std::memory_order_relaxed);
    }
    if (const Verdict verdict = check(i, values(i)); verdict != Verdict::accepted) {
      throw std::invalid_argument("parameter '" + spec.name + "': initial " +
                                  std::string(to_string(verdict)));
    }
  }
}

std::size_t ParameterSet::find(std::string_view name) const {
  const auto it = std::find_if(specs_.begin(), specs_.end(), [&](const auto& s) { return s.name == name; });
  return static_cast<std::size_t>(it - specs_.begin());
}

Verdict ParameterSet::check(std::size_t i, std::span<const double> values) const {
  if (values.size() != entries_[i].size) return Verdict::wrong_size;
  for (std::size_t k = 0; k < values.size(); ++k) {
    const double v = values[k];
    if (!std::isfinite(v)) return Verdict::not_finite;
    if (v < specs_[i].min || v > entries_[i].max[k]) return Verdict::out_of_bounds;
    const auto& choices = specs_[i].choices;
    if (!choices.empty() && (v != std::floor(v) || v < 0 || v >= static_cast<double>(choices.size()))) {
      return Verdict::out_of_bounds;
    }
  }
  return Verdict::accepted;
}

void ParameterSet::lower_max(std::size_t i, std::span<const double> max, std::string reason) {
  auto& entry = entries_[i];
  for (std::size_t k = 0; k < entry.size && k < max.size(); ++k) {
    if (!(max[k] < entry.max[k])) continue;
    entry.max[k] = std::max(max[k], specs_[i].min);
    entry.now[k] = std::min(entry.now[k], entry.max[k]);
    entry.goal[k].store(entry.now[k], std::memory_order_relaxed);
    entry.bound_reason = reason;
  }
}

void ParameterSet::set_now(std::size_t i, std::span<const double> values) {
  auto& entry = entries_[i];
  for (std::size_t k = 0; k < entry.size; ++k) {
    entry.now[k] = values[k];
    entry.goal[k].store(values[k], std::memory_order_relaxed);
  }
  if (entry.remaining_s > 0) --ramping_;
  entry.remaining_s = 0;
  ++version_;
}

void ParameterSet::set(std::size_t i, std::span<const double> values) {
  if (!specs_[i].choices.empty()) return set_now(i, values);
  auto& entry = entries_[i];
  for (std::size_t k = 0; k < entry.size; ++k) {
    entry.goal[k].store(values[k], std::memory_order_relaxed);
    entry.rate[k] = (values[k] - entry.now[k]) / kRamp;
  }
  if (entry.remaining_s <= 0) ++ramping_;
  entry.remaining_s = kRamp;
}

void ParameterSet::advance(double dt) {
  if (ramping_ == 0) return;
  for (auto& entry : entries_) {
    if (entry.remaining_s <= 0) continue;
    entry.remaining_s -= dt;
    if (entry.remaining_s > 0) {
      for (std::size_t k = 0; k < entry.size; ++k) entry.now[k] += entry.rate[k] * dt;
    } else {
      arrive(entry);
    }
    ++version_;
  }
}

void ParameterSet::finish() {
  for (auto& entry : entries_) {
    if (entry.remaining_s <= 0) continue;
    arrive(entry);
    ++version_;
  }
}

void ParameterSet::arrive(Entry& entry) {
  for (std::size_t k = 0; k < entry.size; ++k) entry.now[k] = entry.goal[k].load(std::memory_order_relaxed);
  entry.remaining_s = 0;
  --ramping_;
}

std::vector<double> ParameterSet::target(std::size_t i) const {
  std::vector<double> values(entries_[i].size);
  for (std::size_t k = 0; k < values.size(); ++k)
    values[k] = entries_[i].goal[k].load(std::memory_order_relaxed);
  return values;
}

}  // namespace multipanda
