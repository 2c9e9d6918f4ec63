#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "arm_interface/arm_settings.hpp"
#include "backends/simulated_arm/measured_limits.hpp"
#include "backends/simulated_arm/self_collision.hpp"
#include "core/record/arm_config.hpp"
#include "core/state/arm_state.hpp"
#include "runtime/error_report.hpp"
#include "scene/build.hpp"

namespace multipanda {
namespace {

std::filesystem::path temporary_folder() {
  std::error_code error;
  auto base = std::filesystem::temp_directory_path(error);
  if (error) base = "/tmp";
  std::string pattern = (base / "multipanda_run_XXXXXX").string();
  return mkdtemp(pattern.data()) != nullptr ? std::filesystem::path(pattern) : std::filesystem::path();
}

}  // namespace

std::string ReflexReport::headline() const {
  return fmt::format("arm '{}' stopped itself at {:.3f} s: {}", arm, t_s, error_names(errors));
}

std::string ReflexReport::reason() const {
  return fmt::format("{}{}{}", error_names(errors), why.sentences.empty() ? "" : ": ",
                     fmt::join(why.sentences, " "));
}

std::vector<std::string> ReflexReport::lines() const {
  std::vector<std::string> lines{headline()};
  for (const auto& sentence : why.sentences) lines.push_back(fmt::format("  {}", sentence));
  lines.push_back(
      fmt::format("  {:.0f} % of the last {} cycles were answered; at most {} in a row were missed",
                  100 * why.answered, why.cycles, why.missed_in_row));
  for (const auto& text : why.cures) lines.push_back(fmt::format("  next: {}", text));
  lines.push_back(file.empty() ? fmt::format("  the last cycles could not be written: {}", file_problem)
                               : fmt::format("  the last cycles: {}", file.string()));
  return lines;
}

ReflexWatch::ReflexWatch(RecordLayout layout, std::vector<ArmErrorLimits> limits,
                         std::filesystem::path folder)
    : layout_(std::move(layout)),
      limits_(std::move(limits)),
      folder_(std::move(folder)),
      ring_(kCycles * layout_.arms.size()),
      errors_(layout_.arms.size(), 0) {}

void ReflexWatch::take(const Event& event) {
  if (event.arm >= limits_.size()) return;
  ArmErrorLimits& limits = limits_[event.arm];
  (void)read_arm_config(event, limits.frames, limits.tool, limits.load);
}

std::vector<ReflexReport> ReflexWatch::take(const CycleRecord& record) {
  std::vector<ReflexReport> reports;
  const std::size_t arms = layout_.arms.size(), slot = taken_++ % kCycles;
  const auto due = static_cast<std::size_t>(
      std::count_if(record.arms.begin(), record.arms.end(), [](const ArmSample& arm) { return arm.due; }));
  for (std::size_t arm = 0; arm < arms; ++arm) {
    ArmCycle& cycle = ring_[arm * kCycles + slot];
    cycle.cycle = record.cycle;
    cycle.t = record.t;
    cycle.period_s = record.period_s;
    cycle.total_ns = record.stages.total;
    cycle.arm = record.arms[arm];
    cycle.others_due = due > (cycle.arm.due ? 1u : 0u);
  }
  for (std::size_t arm = 0; arm < arms; ++arm) {
    const std::uint64_t errors = record.arms[arm].errors;
    // Errors that persist or join a reflex belong to the same report.
    if (errors != 0 && errors_[arm] == 0) reports.push_back(report(arm, errors));
    errors_[arm] = errors;
  }
  return reports;
}

std::vector<ArmCycle> ReflexWatch::history(std::size_t arm) const {
  std::vector<ArmCycle> cycles;
  const std::size_t count = std::min(taken_, kCycles);
  for (std::size_t i = taken_ - count; i < taken_; ++i) cycles.push_back(ring_[arm * kCycles + i % kCycles]);
  return cycles;
}

ReflexReport ReflexWatch::report(std::size_t arm, std::uint64_t errors) {
  const std::vector<ArmCycle> cycles = history(arm);
  ReflexReport result{.arm = layout_.arms[arm].name,
                      .t_s = cycles.back().t.seconds(),
                      .cycle = cycles.back().cycle,
                      .errors = errors,
                      .why = explain(errors, cycles, limits_[arm])};
  write(result, arm, cycles);
  return result;
}

std::filesystem::path ReflexWatch::folder() {
  const std::lock_guard lock(folder_mutex_);
  if (folder_.empty()) folder_ = temporary_folder();
  return folder_;
}

void ReflexWatch::write(ReflexReport& report, std::size_t arm, const std::vector<ArmCycle>& cycles) {
  if (folder().empty()) {
    report.file_problem = std::strerror(errno);
    return;
  }
  const auto path = folder_ / fmt::format("reflex_{}_{}.csv", ++files_, report.arm);
  std::ofstream file(path);
  file << to_csv(cycles, layout_.arms[arm].joint_count);
  file.close();
  if (file) {
    report.file = path;
  } else {
    report.file_problem = fmt::format("{}: {}", path.string(), std::strerror(errno));
  }
}

std::string to_csv(const std::vector<ArmCycle>& cycles, std::size_t joint_count) {
  struct Column {
    const char *name, *unit;
    JointArray ArmSample::*values;
  };
  static constexpr Column kColumns[] = {{"q", "rad", &ArmSample::q},
                                        {"dq", "rad_per_s", &ArmSample::dq},
                                        {"tau_J", "nm", &ArmSample::tau_J},
                                        {"tau_J_d", "nm", &ArmSample::tau_J_d},
                                        {"tau_ext", "nm", &ArmSample::tau_ext},
                                        {"tau_cmd", "nm", &ArmSample::tau_cmd}};
  std::string text = "cycle,t_s,period_ms,computing_us,packet,due,age_ms,mode,errors";
  const auto add = [&text](auto... values) { fmt::format_to(std::back_inserter(text), values...); };
  for (const auto& column : kColumns) {
    for (std::size_t i = 1; i <= joint_count; ++i) add(FMT_STRING(",{}{}_{}"), column.name, i, column.unit);
  }
  for (const char* axis : {"fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"})
    add(FMT_STRING(",F_K_W_{}"), axis);
  text += "\n";
  for (const auto& c : cycles) {
    add(FMT_STRING("{},{:.6f},{:.4f},{:.2f},{},{},{:.4f},{},{}"), c.cycle, c.t.seconds(), 1e3 * c.period_s,
        1e-3 * c.total_ns, c.arm.sequence, c.arm.due ? 1 : 0, 1e3 * c.arm.age_s,
        to_string(static_cast<ArmMode>(c.arm.mode)), error_names(c.arm.errors, "+"));
    for (const auto& column : kColumns) {
      const bool known = column.values != &ArmSample::tau_ext || c.arm.has_tau_ext;
      for (std::size_t i = 0; i < joint_count; ++i) {
        if (known) {
          add(FMT_STRING(",{:.9g}"), (c.arm.*column.values)[i]);
        } else {
          text += ",";
        }
      }
    }
    for (const double value : c.arm.F_K_W_est) {
      if (c.arm.has_wrench_estimate) {
        add(FMT_STRING(",{:.9g}"), value);
      } else {
        text += ",";
      }
    }
    text += "\n";
  }
  return text;
}

namespace {

bool carries(const Scene& scene, std::size_t arm) {
  return std::any_of(scene.arms.begin(), scene.arms.end(),
                     [&](const SceneArm& other) { return other.mount && other.mount->carrier == arm; });
}

}  // namespace

std::vector<ArmErrorLimits> error_limits(const Scene& scene,
                                         const std::vector<std::shared_ptr<const ArmModel>>& models,
                                         const std::vector<bool>& simulated) {
  std::vector<ArmErrorLimits> all;
  for (std::size_t i = 0; i < models.size(); ++i) {
    const SceneArm& arm = scene.arms[i];
    const ArmConfig config = arm_config(arm);
    const ArmLimits& limits = models[i]->limits();
    ArmErrorLimits one{.joint_count = models[i]->joint_count(),
                       .motion = MotionLimits::of(robot_of(arm)),
                       .tau_max = limits.tau_max,
                       .tau_rate_max = limits.tau_rate_max,
                       .thresholds = arm.collision,
                       .model = models[i],
                       .frames = config.frames,
                       .tool = config.tool,
                       .load = config.load,
                       .beside_moving_base = arm.mount.has_value() || carries(scene, i)};
    if (simulated[i]) {
      if (!one.thresholds) one.thresholds = default_settings(*models[i]).thresholds;
      one.self_distance = SelfCollision::kMargin;
      one.velocity_margin = MeasuredLimits::kVelocityMargin;
      one.power_max = MeasuredLimits::kPowerShare * one.tau_max.dot(one.motion.dq_max);
    }
    all.push_back(std::move(one));
  }
  return all;
}

}  // namespace multipanda
