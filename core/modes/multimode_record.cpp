#include <algorithm>
#include <limits>

#include "core/modes/multimode_controller.hpp"
#include "core/modes/request.hpp"

// Data for the log: names before the loop; events, references and outputs in it.
namespace multipanda {

RecordLayout MultimodeController::layout() const {
  RecordLayout layout;
  for (ArmIndex arm = 0; arm < arm_names_.size(); ++arm) {
    layout.arms.push_back({arm_names_[arm], blocks_.terms[arm].joint_count()});
  }
  for (const auto& instance : instances_) {
    RecordLayout::Instance entry;
    entry.name = instance->name();
    entry.type = instance->descriptor().type;
    entry.arms = instance->arms().bits();
    for (const auto& input : std::as_const(*instance).inputs()) {
      entry.inputs.push_back(
          {input.spec().name, std::string(to_string(input.spec().quantity)), input.spec().frame});
    }
    entry.parameters = instance->parameter_names();
    for (std::size_t i = 0; i < instance->feature_count(); ++i) {
      entry.features.push_back(instance->feature_descriptor(i).type);
    }
    for (const auto& output : instance->output_specs()) {
      entry.outputs.push_back({output.name, layout.output_count, output.size});
      layout.output_count += output.size;
    }
    layout.max_references += entry.inputs.size();
    layout.instances.push_back(std::move(entry));
  }
  return layout;
}

void MultimodeController::record_cycle(CycleRecord& record) const {
  record.reference_count = 0;
  std::fill(record.outputs.begin(), record.outputs.end(), std::numeric_limits<double>::quiet_NaN());
  for_each(active_, [&](InstanceIndex i) {
    const Instance& instance = *instances_[i];
    for (std::size_t k = 0; k < instance.inputs().size(); ++k) {
      const Reference& reference = instance.inputs()[k];
      ReferenceSample& sample = record.references[record.reference_count++];
      sample.instance = i;
      sample.input = static_cast<std::uint8_t>(k);
      sample.size = static_cast<std::uint8_t>(reference.size());
      sample.streaming = reference.streaming();
      reference.record(sample.values.data(), sample.rates.data());
    }
    std::copy(instance.outputs().begin(), instance.outputs().end(),
              record.outputs.begin() + static_cast<std::ptrdiff_t>(output_offsets_[i]));
  });
}

void MultimodeController::emit(Event event, const Tick& tick) {
  if (record_ == nullptr) return;
  event.t = tick.t;
  event.cycle = tick.cycle;
  if (!record_->events.push(event)) record_->dropped_events.fetch_add(1, std::memory_order_relaxed);
}

void MultimodeController::emit_finding(EventKind kind, ArmIndex arm, InstanceIndex instance,
                                       const Finding& finding, const Tick& tick) {
  Event event{.kind = kind, .intervention = finding.rule};
  event.arm = static_cast<std::uint16_t>(arm);
  event.instance = instance;
  event.joint = finding.joint;
  event.size = 2;
  event.values[0] = finding.value;
  event.values[1] = finding.limit;
  emit(event, tick);
}

}  // namespace multipanda
