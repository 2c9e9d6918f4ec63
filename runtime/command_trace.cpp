#include "runtime/command_trace.hpp"

#include <algorithm>
#include <unistd.h>

#include "logs/npz.hpp"

namespace multipanda {
namespace {

constexpr std::size_t kMissing = 30000;  // allowance for missing cycles among the samples

double us(std::int64_t ns) { return static_cast<double>(ns) * 1e-3; }

void copy(const JointArray& from, double (&to)[kMaxJoints]) { std::copy(from.begin(), from.end(), to); }

}  // namespace

CommandTrace::CommandTrace(const RecordLayout& layout, Options options)
    : layout_(layout),
      options_(options),
      samples_(options.samples),
      arms_(options.samples * layout.arms.size()),
      whole_ns_(options.samples + kMissing) {
  if (options.instance < layout_.instances.size()) {
    const auto& instance = layout_.instances[options.instance];
    for (const auto& output : instance.outputs) {
      const bool of_feature =
          std::any_of(instance.features.begin(), instance.features.end(),
                      [&](const auto& name) { return output.name.starts_with(name + "."); });
      if (of_feature && output.size == 1)
        columns_.push_back({instance.name + "/" + output.name, output.offset});
    }
  }
  feature_values_.resize(options.samples * columns_.size());
}

void CommandTrace::step_done(const Tick& tick) {
  if (tick.cycle > last_cycle_.load(std::memory_order_relaxed)) return;  // samples are never overwritten
  if (loop_thread_.load(std::memory_order_relaxed) == 0)
    loop_thread_.store(gettid(), std::memory_order_release);
  whole_ns_[tick.cycle % whole_ns_.size()] = (host_now() - tick.start).count();
}

bool CommandTrace::begins(const CycleRecord& record) {
  if (options_.streaming && !streaming()) {
    for (std::size_t i = 0; i < record.reference_count; ++i) {
      const auto& reference = record.references[i];
      if (reference.instance == options_.instance && reference.streaming)
        streaming_.store(true, std::memory_order_release);
    }
    if (!streaming()) return false;
  }
  return waited_++ >= options_.lead;
}

void CommandTrace::take(const CycleRecord& record) {
  const std::size_t n = count();
  if (full() || (n == 0 && !begins(record))) return;
  if (n > 0 && record.cycle - samples_[0].cycle >= whole_ns_.size()) {
    last_cycle_.store(samples_[n - 1].cycle, std::memory_order_release);
    return;
  }
  samples_[n] = {.cycle = record.cycle,
                 .overruns = record.overruns,
                 .t_ns = record.t.ns,
                 .start_ns = record.start.ns,
                 .stages = record.stages};
  for (std::size_t i = 0; i < arm_count(); ++i) {
    const ArmSample& from = record.arms[i];
    ArmCycle& to = arms_[n * arm_count() + i];
    to.sequence = from.sequence;
    copy(from.q, to.q);
    copy(from.tau_J, to.tau_J);
    copy(from.tau_J_d, to.tau_J_d);
    copy(from.tau_cmd, to.tau_cmd);
    copy(from.tau_feature, to.tau_feature);
  }
  for (std::size_t i = 0; i < columns_.size(); ++i)
    feature_values_[n * columns_.size() + i] = record.outputs[columns_[i].offset];
  count_.store(n + 1, std::memory_order_release);
  if (n + 1 == options_.samples) last_cycle_.store(record.cycle, std::memory_order_release);
}

double CommandTrace::whole_us(const Sample& sample) const {
  return us(whole_ns_[sample.cycle % whole_ns_.size()]);
}

void CommandTrace::write(const std::filesystem::path& npz, const std::string& about) const {
  using Kind = NpzWriter::Kind;
  const std::size_t n = count();
  std::vector<NpzWriter::Array> arrays{
      {"cycle", Kind::integer, n, 1, false}, {"overruns", Kind::integer, n, 1, false},
      {"t_ns", Kind::integer, n, 1, false},  {"start_ns", Kind::integer, n, 1, false},
      {"stages_us", Kind::real, n, 6, true}, {"whole_us", Kind::real, n, 1, false}};
  const std::size_t first_arm = arrays.size();
  for (const auto& arm : layout_.arms) {
    const std::size_t joints = arm.joint_count;
    arrays.push_back({arm.name + "/sequence", Kind::integer, n, 1, false});
    arrays.push_back({arm.name + "/tau_J_d", Kind::real, n, joints, true});
    arrays.push_back({arm.name + "/tau_cmd", Kind::real, n, joints, true});
    arrays.push_back({arm.name + "/tau_feature", Kind::real, n, joints, true});
  }
  const std::size_t first_column = arrays.size();
  for (const auto& column : columns_) arrays.push_back({column.name, Kind::real, n, 1, false});

  const std::size_t at_about = arrays.size();
  if (!about.empty()) arrays.push_back({"about", Kind::text, 1, code_points(about).size(), false});

  NpzWriter writer(npz, std::move(arrays));
  if (!about.empty()) writer.add(at_about, about);
  const auto add = [&](std::size_t index, std::int64_t value) { writer.add(index, std::vector{value}); };
  const auto add_all = [&](std::size_t index, const double* values, std::size_t size) {
    writer.add(index, std::vector<double>(values, values + size));
  };
  for (std::size_t i = 0; i < n; ++i) {
    const Sample& s = samples_[i];
    const StageTimes& stage = s.stages;
    add(0, static_cast<std::int64_t>(s.cycle));
    add(1, static_cast<std::int64_t>(s.overruns));
    add(2, s.t_ns);
    add(3, s.start_ns);
    const double stages[] = {us(stage.read),   us(stage.controllets), us(stage.features),
                             us(stage.safety), us(stage.write),       us(stage.total)};
    add_all(4, stages, std::size(stages));
    const double whole = whole_us(s);
    add_all(5, &whole, 1);
    for (std::size_t a = 0; a < arm_count(); ++a) {
      const ArmCycle& cycle = arm(i, a);
      const std::size_t joints = layout_.arms[a].joint_count, at = first_arm + 4 * a;
      add(at, static_cast<std::int64_t>(cycle.sequence));
      add_all(at + 1, cycle.tau_J_d, joints);
      add_all(at + 2, cycle.tau_cmd, joints);
      add_all(at + 3, cycle.tau_feature, joints);
    }
    for (std::size_t k = 0; k < columns_.size(); ++k)
      add_all(first_column + k, &feature_values_[i * columns_.size() + k], 1);
  }
  writer.close();
}

}  // namespace multipanda
