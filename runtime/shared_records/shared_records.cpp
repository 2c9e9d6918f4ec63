#include "runtime/shared_records/shared_records.hpp"

#include <algorithm>
#include <atomic>
#include <bit>
#include <cerrno>
#include <cmath>
#include <fcntl.h>
#include <stdexcept>
#include <sys/mman.h>
#include <system_error>
#include <unistd.h>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "arm_interface/arm_error.hpp"
#include "core/reference/target.hpp"
#include "core/state/arm_state.hpp"

namespace multipanda {

namespace {

static_assert(std::endian::native == std::endian::little, "the memory is little-endian");
static_assert(std::atomic_ref<std::uint64_t>::is_always_lock_free);

constexpr std::size_t kNumberBytes = 8;  // of a slot's number, before its contents
constexpr std::size_t kEventHead = 32;   // number, cycle, time, size of the text

std::atomic_ref<std::uint64_t> number_of(std::byte* slot) {
  return std::atomic_ref<std::uint64_t>(*reinterpret_cast<std::uint64_t*>(slot));
}

// Slot number n of a ring: odd while it is written, then 2 n + 2, which tells a reader whether its copy
// is valid.
template <class Fill>
void write_slot(std::byte* slot, std::uint64_t n, const Fill& fill) {
  number_of(slot).store(2 * n + 1, std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_release);
  fill(slot);
  number_of(slot).store(2 * n + 2, std::memory_order_release);
}

void publish(std::uint64_t& counter, std::uint64_t value) {
  std::atomic_ref<std::uint64_t>(counter).store(value, std::memory_order_release);
}

std::uint64_t fnv1a(const std::string& text) {
  std::uint64_t hash = 0xcbf29ce484222325u;
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3u;
  return hash;
}

std::size_t reference_size(const std::string& quantity, std::uint32_t arms, const RecordLayout& layout) {
  std::size_t joints = 0;
  for (std::size_t i = 0; i < layout.arms.size(); ++i) {
    if ((arms >> i & 1u) != 0) joints = std::max(joints, layout.arms[i].joint_count);
  }
  for (const auto known :
       {Quantity::pose, Quantity::twist, Quantity::wrench, Quantity::joints, Quantity::scalar}) {
    if (to_string(known) == quantity) return value_count(known, joints);
  }
  return kMaxTargetValues;
}

const std::array<double, kMaxTargetValues> kNotActive = [] {
  std::array<double, kMaxTargetValues> values{};
  values.fill(std::numeric_limits<double>::quiet_NaN());
  return values;
}();

std::size_t whole_pages(std::size_t bytes) { return (bytes + 4095) / 4096 * 4096; }

}  // namespace

SharedRecords::SharedRecords(const std::string& scene, const RecordLayout& layout,
                             const std::vector<std::shared_ptr<const ArmModel>>& models,
                             const std::vector<ArmFrames>& frames,
                             const std::vector<std::optional<BaseMount>>& mounts)
    : mounts_(mounts) {
  mounts_.resize(models.size());
  for (std::size_t i = 0; i < models.size(); ++i) {
    arms_.push_back({.joints = layout.arms.at(i).joint_count, .terms = ModelTerms(models[i]), .more = {}});
    arms_[i].terms.set_config(frames.at(i), {}, {});
  }
  lay_out(layout);
  write_table(scene, layout);
}

void SharedRecords::lay_out(const RecordLayout& layout) {
  FieldList list(kNumberBytes);
  visit_cycle(list, CycleRecord{});
  for (const auto& arm : layout.arms) {
    list.prefix(arm.name + "/");
    visit_arm(list, ArmSample{}, ArmAddition{}, arm.joint_count);
  }
  for (const auto& instance : layout.instances) {
    list.prefix(instance.name + "/");
    auto& inputs = references_.emplace_back();
    for (const auto& input : instance.inputs) {
      inputs.push_back({list.offset(), reference_size(input.quantity, instance.arms, layout)});
      list.add(input.name, 'f', inputs.back().size);
    }
  }
  outputs_at_ = list.offset();
  output_count_ = layout.output_count;
  // In the order of CycleRecord::outputs, which is copied as a whole.
  for (const auto& instance : layout.instances) {
    list.prefix(instance.name + "/outputs/");
    for (const auto& output : instance.outputs) list.add(output.name, 'f', output.size);
  }
  record_bytes_ = list.offset();
  fields_ = std::move(list.fields());
}

void SharedRecords::write_table(const std::string& scene, const RecordLayout& layout) {
  using nlohmann::ordered_json;
  ordered_json table{{"version", 1}, {"scene", scene}};
  for (const auto& arm : layout.arms)
    table["arms"].push_back({{"name", arm.name}, {"joints", arm.joint_count}});
  for (const auto& instance : layout.instances) table["controllets"].push_back(instance.name);
  for (int mode = 0; mode <= static_cast<int>(ArmMode::disconnected); ++mode)
    table["modes"].push_back(to_string(static_cast<ArmMode>(mode)));
  for (std::size_t bit = 0; bit < kArmErrorCount; ++bit)
    table["errors"].push_back(to_string(static_cast<ArmError>(bit)));
  table["interventions"].push_back("");
  for (std::size_t code = 1; code < static_cast<std::size_t>(Intervention::count_); ++code) {
    std::string name(to_string(static_cast<Intervention>(code)));
    std::replace(name.begin(), name.end(), ' ', '_');
    table["interventions"].push_back(std::move(name));
  }
#define MULTIPANDA_KNOWN(type, member, name, message, known, doc) \
  if (std::string_view(#known) != "always") table["known_by"][#name] = #known;
  MULTIPANDA_ARM_FIELDS(MULTIPANDA_KNOWN)
#undef MULTIPANDA_KNOWN
  for (const auto& field : fields_)
    table["fields"].push_back({field.name, std::string(1, field.type) + "8", field.offset, field.count});
  table["record_bytes"] = record_bytes_;
  table["records"] = kRecords;
  table["event_bytes"] = kEventBytes;
  table["events"] = kEvents;
  // Offsets depend on the length of the text: space for their digits is reserved.
  constexpr std::size_t kDigits = 64;
  first_record_ = whole_pages(sizeof(Header) + table.dump().size() + kDigits);
  first_event_ = whole_pages(first_record_ + kRecords * record_bytes_);
  table["first_record"] = first_record_;
  table["first_event"] = first_event_;
  table_ = table.dump();
  const std::uint64_t hash = fnv1a(table_);
  hash_ = fmt::format("{:016x}", hash);
  memory_ = std::make_unique<SealedMemory>("multipanda-records", first_event_ + kEvents * kEventBytes);
  Header& head = header();
  head.table_bytes = table_.size();
  head.table_hash = hash;
  head.bytes = memory_->size();
  std::memcpy(memory_->data() + sizeof(Header), table_.data(), table_.size());
  std::memcpy(head.magic, "mp-rec-1", sizeof(head.magic));
}

std::byte* SharedRecords::record_at(std::uint64_t number) const {
  return memory_->data() + first_record_ + number % kRecords * record_bytes_;
}

std::byte* SharedRecords::event_at(std::uint64_t number) const {
  return memory_->data() + first_event_ + number % kEvents * kEventBytes;
}

void SharedRecords::take(const Event& event) {
  for (std::size_t i = 0; i < arms_.size(); ++i) note_removal(event, i, arms_[i].more.removed_by);
  if (event.arm >= arms_.size()) return;
  Arm& arm = arms_[event.arm];
  if (event.kind == EventKind::intervention) arm.more.last_intervention = event.intervention;
  ArmFrames frames;
  Load tool, load;
  if (read_arm_config(event, frames, tool, load)) arm.terms.set_config(frames, {}, {});
}

void SharedRecords::take(const CycleRecord& record, ArmSet stopped) {
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    Arm& arm = arms_[i];
    const auto n = static_cast<Eigen::Index>(arm.joints);
    arm.terms.update(JointVector(Eigen::Map<const Eigen::VectorXd>(record.arms[i].q.data(), n)),
                     JointVector(Eigen::Map<const Eigen::VectorXd>(record.arms[i].dq.data(), n)));
  }
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    Arm& arm = arms_[i];
    if (mounts_[i]) arm.terms.stand_on(arms_[mounts_[i]->carrier].terms, *mounts_[i]);
    arm.more.X_WE = arm.terms.X_WE();
    arm.more.stopped = stopped.contains(i);
  }
  write_slot(record_at(records_), records_, [&](std::byte* slot) {
    FieldWriter out(slot + kNumberBytes);
    visit_cycle(out, record);
    for (std::size_t i = 0; i < arms_.size(); ++i)
      visit_arm(out, record.arms[i], arms_[i].more, arms_[i].joints);
    for (const auto& inputs : references_) {
      for (const Reference& place : inputs)
        std::memcpy(slot + place.offset, kNotActive.data(), 8 * place.size);
    }
    for (std::size_t i = 0; i < record.reference_count; ++i) {
      const ReferenceSample& sample = record.references[i];
      const Reference& place = references_[sample.instance][sample.input];
      std::memcpy(slot + place.offset, sample.values.data(),
                  8 * std::min<std::size_t>(place.size, sample.size));
    }
    std::memcpy(slot + outputs_at_, record.outputs.data(), 8 * output_count_);
  });
  publish(header().records, ++records_);
}

void SharedRecords::take(const RunEvent& event) {
  std::string text;
  for (std::string words = event.text;; words.resize(words.size() * 9 / 10)) {
    text = nlohmann::json{{"kind", event.kind}, {"arm", event.arm}, {"text", words}}.dump(
        -1, ' ', false, nlohmann::json::error_handler_t::replace);
    if (text.size() <= kEventBytes - kEventHead || words.empty()) break;
  }
  write_slot(event_at(events_), events_, [&](std::byte* slot) {
    const std::array<std::uint64_t, 3> head{event.cycle, std::bit_cast<std::uint64_t>(event.t.ns),
                                            text.size()};
    std::memcpy(slot + kNumberBytes, head.data(), sizeof(head));
    std::memcpy(slot + kEventHead, text.data(), text.size());
  });
  publish(header().events, ++events_);
}

void SharedRecords::count_lost(std::uint64_t records, std::uint64_t events) {
  if (records > 0) publish(header().records_lost, header().records_lost + records);
  if (events > 0) publish(header().events_lost, header().events_lost + events);
}

SealedMemory::SealedMemory(const std::string& name, std::size_t bytes) : size_(bytes) {
  const auto failed = [this](const char* step) {
    const std::string why = std::generic_category().message(errno);
    if (data_ != nullptr) munmap(data_, size_);
    if (file_ >= 0) close(file_);
    throw std::runtime_error("shared memory of " + std::to_string(size_) + " bytes: " + step + ": " + why);
  };
  file_ = memfd_create(name.c_str(), MFD_CLOEXEC | MFD_ALLOW_SEALING);
  if (file_ < 0) failed("memfd_create");
  if (ftruncate(file_, static_cast<off_t>(bytes)) != 0) failed("ftruncate");
  void* mapped = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, file_, 0);
  if (mapped == MAP_FAILED) failed("mmap");
  data_ = static_cast<std::byte*>(mapped);
  // After the mapping above, which remains the only writable one.
  if (fcntl(file_, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_FUTURE_WRITE | F_SEAL_SEAL) != 0)
    failed("seals (Linux 5.1 or newer has them)");
}

SealedMemory::~SealedMemory() {
  munmap(data_, size_);
  close(file_);
}

namespace {

// Force at the end effector [N]: from the simulator's contacts if known, which have no offset.
double force_of(const ArmSample& sample) {
  const auto& F = sample.has_contact_truth ? sample.F_K_W_true : sample.F_K_W_est;
  if (!sample.has_contact_truth && !sample.has_wrench_estimate) return 0;
  return std::hypot(F[0], F[1], F[2]);
}

// Largest external torque of a joint [N m] and the joint, from 0.
std::pair<double, std::size_t> torque_of(const ArmSample& sample, std::size_t joints) {
  std::pair<double, std::size_t> largest{0, 0};
  for (std::size_t j = 0; sample.has_tau_ext && j < joints; ++j) {
    if (std::abs(sample.tau_ext[j]) > largest.first) largest = {std::abs(sample.tau_ext[j]), j};
  }
  return largest;
}

}  // namespace

RunEvents::RunEvents(const RecordLayout& layout) : layout_(layout) {
  for (const auto& arm : layout.arms) arms_.push_back({.name = arm.name, .joints = arm.joint_count});
}

std::vector<RunEvent> RunEvents::take(const Event& event) {
  RunEvent out{.cycle = event.cycle, .t = event.t, .kind = std::string(to_string(event.kind))};
  out.text = words_.of(event);
  out.arm = words_.arm_name(event.arm);
  if (event.kind == EventKind::intervention) {  // as in the summary of a run
    out.text = to_string(event.intervention);
    std::replace(out.text.begin(), out.text.end(), ' ', '_');
  }
  std::vector<RunEvent> all;
  if (event.kind != EventKind::stopped && event.kind != EventKind::resumed) {
    all.push_back(std::move(out));
    return all;
  }
  for (const std::string& arm : words_.arm_names(event.arms)) {  // one per arm
    out.arm = arm;
    out.text = event.kind == EventKind::stopped ? "held until resume" : "switches are allowed again";
    all.push_back(out);
  }
  return all;
}

void RunEvents::add(std::vector<RunEvent>& out, const CycleRecord& record, const Arm& arm, const char* kind,
                    std::string text) const {
  out.push_back(
      {.cycle = record.cycle, .t = record.t, .kind = kind, .arm = arm.name, .text = std::move(text)});
}

std::vector<RunEvent> RunEvents::take(const CycleRecord& record,
                                      const std::map<std::string, std::string>& reasons) {
  std::vector<RunEvent> out;
  for (std::size_t i = 0; i < arms_.size(); ++i) {
    Arm& arm = arms_[i];
    const ArmSample& sample = record.arms[i];
    if (arm.known && sample.owner != arm.owner) {
      add(out, record, arm, "controllet",
          words_.instance_name(sample.owner) + " after " + words_.instance_name(arm.owner));
    }
    const std::uint64_t before = arm.known ? arm.errors : 0;
    if (sample.errors != before) {
      if (sample.errors == 0) {
        add(out, record, arm, "recovered", "no errors left");
      } else {
        const auto known = reasons.find(arm.name);
        add(out, record, arm, "error", known != reasons.end() ? known->second : error_names(sample.errors));
      }
    }
    if (arm.known && sample.has_gripper && sample.gripper_grasped != arm.grasped) {
      add(out, record, arm, sample.gripper_grasped ? "grasped" : "released",
          fmt::format("{:.1f} mm", 1e3 * sample.gripper_width));
    }
    watch_contact(out, record, arm, sample);
    arm.owner = sample.owner;
    arm.errors = sample.errors;
    arm.grasped = sample.gripper_grasped;
    arm.known = true;
  }
  return out;
}

void RunEvents::watch_contact(std::vector<RunEvent>& out, const CycleRecord& record, Arm& arm,
                              const ArmSample& sample) const {
  const double force = force_of(sample);
  const auto [torque, joint] = torque_of(sample, arm.joints);
  if (force >= kForce * kRelease || torque >= kTorque * kRelease) arm.pressed = record.t;
  if (!arm.in_contact && (force >= kForce || torque >= kTorque)) {
    arm.in_contact = true;
    add(out, record, arm, "contact",
        force >= kForce ? fmt::format("{:.1f} N at the end effector", force)
                        : fmt::format("{:.1f} N m at joint {}", torque, joint + 1));
  } else if (arm.in_contact && seconds(record.t - arm.pressed) >= kRest) {
    arm.in_contact = false;
    add(out, record, arm, "contact_ended", fmt::format("{:.1f} N at the end effector", force));
  }
}

}  // namespace multipanda
