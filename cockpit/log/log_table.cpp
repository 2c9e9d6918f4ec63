#include "cockpit/log/log_table.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>

#include "cockpit/view/scene_bodies.hpp"
#include "core/reference/target.hpp"
#include "logs/arm_state_fields.hpp"
#include "logs/cdr.hpp"
#include "logs/messages.hpp"
#include "runtime/faulty.hpp"
#include "scene/build.hpp"
#include "scene/load.hpp"

namespace multipanda::cockpit {
namespace {

using nlohmann::json;

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

double seconds_of(const msg::Time& time) { return time.sec + 1e-9 * time.nanosec; }

std::size_t count_of(const std::string& quantity, std::size_t joints) {
  for (const auto known :
       {Quantity::pose, Quantity::twist, Quantity::wrench, Quantity::joints, Quantity::scalar}) {
    if (to_string(known) == quantity) return value_count(known, joints);
  }
  return kMaxTargetValues;
}

Pose pose_of(const msg::Pose& pose) {
  const auto& [p, q] = std::tie(pose.position, pose.orientation);
  return Pose::from({p.x, p.y, p.z}, Quaternion(q.w, q.x, q.y, q.z));
}

std::string text_of(const McapReader& reader, const std::string& attachment) {
  for (const auto& found : reader.attachments()) {
    if (found.name == attachment) return found.data;
  }
  return {};
}

std::string metadata_of(const McapReader& reader, const std::string& key, const std::string& fallback) {
  for (const auto& metadata : reader.metadata()) {
    if (metadata.name != "run") continue;
    for (const auto& [name, value] : metadata.values) {
      if (name == key) return value;
    }
  }
  return fallback;
}

}  // namespace

LogTable::LogTable(const std::filesystem::path& log, std::size_t most_rows)
    : most_(most_rows), name_(log.parent_path().filename().string()) {
  McapReader reader(log);
  bool begun = false;
  while (const auto message = reader.next()) {
    if (!begun) begin(reader);
    begun = true;
    take(*message);
  }
  if (!begun)
    throw std::runtime_error(log.string() + ": the log has no messages; record a run with --record");
  end_row();
  if (t_.empty()) throw std::runtime_error(log.string() + ": the log has no states");
  row_.clear();
}

void LogTable::begin(const McapReader& reader) {
  const std::string text = text_of(reader, "scene.yaml");
  const std::string path = metadata_of(reader, "scene_path", "scene.yaml");
  layout_ = json::parse(text_of(reader, "layout.json"), nullptr, false);
  if (text.empty() || !layout_.is_object())
    throw std::runtime_error(
        "the log has no scene or no layout: it comes from an older version or another program");
  Registry registry = build_registry(scene_plugins(text, path));
  registry.add(faulty_controllet());  // of the demo's scene
  scene_ = parse_scene(text, path, registry);
  refuse_carried_arms(scene_, "the page");
  for (const SceneArm& arm : scene_.arms) {
    models_.push_back(build_controller_model(arm));
    Arm& entry = arms_[arm.name];
    entry.joints = models_.back()->joint_count();
    entry.terms = std::make_unique<ModelTerms>(models_.back());
    entry.frames = arm_config(arm).frames;
    entry.changes.emplace_back(-std::numeric_limits<double>::infinity(), entry.frames);
  }
  for (const auto& instance : layout_.at("instances")) {
    owner_of_.emplace(instance.at("name"), static_cast<std::uint16_t>(owners_.size()));
    owners_.push_back(instance.at("name"));
  }
  lay_out();
}

void LogTable::lay_out() {
  FieldList list(0);
  visit_cycle(list, CycleRecord{});
  for (const SceneArm& arm : scene_.arms) {
    list.prefix(arm.name + "/");
    visit_arm(list, ArmSample{}, ArmAddition{}, arms_.at(arm.name).joints);
  }
  for (const auto& instance : layout_.at("instances")) {
    std::size_t joints = 0;
    for (const auto& arm : instance.at("arms"))
      joints = std::max(joints, arms_.at(arm.get<std::string>()).joints);
    list.prefix(instance.at("name").get<std::string>() + "/");
    for (const auto& input : instance.at("inputs"))
      list.add(input.at("name"), 'f', count_of(input.at("quantity"), joints));
    list.prefix(instance.at("name").get<std::string>() + "/outputs/");
    for (const auto& output : instance.at("outputs")) list.add(output.at("name"), 'f', output.at("size"));
  }
  list.prefix("objects/");
  for (const auto& object : scene_.objects) {
    if (!object.fixed) list.add(object.name, 'f', 7);
  }
  width_ = list.offset() / 8;
  for (const auto& field : list.fields()) {
    fields_.push_back({.name = field.name, .type = 'f', .offset = field.offset, .count = field.count});
    places_[field.name] = {field.offset / 8, field.count};
    const std::size_t slash = field.name.find('/');
    const auto owner = arms_.find(field.name.substr(0, slash));
    if (slash != std::string::npos && owner != arms_.end())
      owner->second.at[field.name.substr(slash + 1)] = {field.offset / 8, field.count};
  }
  for (const auto& object : scene_.objects) {
    if (object.fixed) continue;
    Object& entry = objects_[object.name];
    entry.at = places_.at("objects/" + object.name).first;
    entry.now.fill(kNone);
  }
  row_.assign(width_, kNone);
}

LogTable::Arm& LogTable::arm(const std::string& name) {
  const auto found = arms_.find(name);
  if (found == arms_.end())
    throw std::runtime_error("the log has an arm '" + name + "' that its scene lacks");
  return found->second;
}

void LogTable::put(std::size_t at, const std::vector<double>& values, std::size_t most) {
  for (std::size_t k = 0; k < std::min(values.size(), most); ++k) put(at + k, values[k]);
}

void LogTable::take(const McapReader::Message& message) {
  const bool of_cycle = holds<msg::ArmState>(*message.schema) || holds<msg::ArmCommand>(*message.schema) ||
                        holds<msg::ArmWrench>(*message.schema) || holds<msg::Reference>(*message.schema) ||
                        holds<msg::ControlletOutput>(*message.schema) ||
                        holds<msg::ControlletOutputs>(*message.schema) ||
                        holds<msg::CycleTiming>(*message.schema);
  if (holds<msg::ObjectPose>(*message.schema)) return take_object(message);
  if (holds<msg::ArmReport>(*message.schema)) {
    const auto report = from_cdr<msg::ArmReport>(message.data);
    arm(report.arm).report = report;
    return;
  }
  if (!of_cycle) return take_event(message);
  if (message.log_time_ns != row_ns_) {
    end_row();
    begin_row(message.log_time_ns);
  }
  if (kept_) take_numbers(message);
}

void LogTable::begin_row(std::int64_t t_ns) {
  row_ns_ = t_ns;
  kept_ = seen_++ % every_ == 0;
  if (!kept_) return;
  std::ranges::fill(row_, kNone);
  put(places_.at("t_ns").first, static_cast<double>(t_ns));
  for (const auto& [name, object] : objects_) put_object(object);
}

// They follow the records of their cycle.
void LogTable::take_object(const McapReader::Message& message) {
  const auto moved = from_cdr<msg::ObjectPose>(message.data);
  const auto found = objects_.find(moved.object);
  if (found == objects_.end()) return;
  write_pose(pose_of(moved.pose), found->second.now.data());
  if (kept_ && message.log_time_ns == row_ns_) put_object(found->second);
}

void LogTable::put_object(const Object& object) {
  for (std::size_t k = 0; k < object.now.size(); ++k) put(object.at + k, object.now[k]);
}

void LogTable::end_row() {
  if (!kept_ || row_ns_ < 0) return;
  kept_ = false;
  for (auto& [name, arm] : arms_) {
    put(arm, "stopped", {arm.stopped ? 1.0 : 0.0});
    put(arm, "has_report", {arm.report ? 1.0 : 0.0});
    if (arm.report) put_quantities(arm, *arm.report);
    JointVector q(static_cast<Eigen::Index>(arm.joints));
    for (std::size_t k = 0; k < arm.joints; ++k)
      q[static_cast<Eigen::Index>(k)] = row_[arm.at.at("q_rad").first + k];
    if (!q.allFinite()) continue;
    arm.terms->set_config(arm.frames, {}, {});
    arm.terms->update(q, JointVector::Zero(q.size()));
    const auto pose = arm.terms->X_WE().values();
    put(arm, "position_m", {pose.begin(), pose.begin() + 3});
    put(arm, "quaternion_wxyz", {pose.begin() + 3, pose.end()});
  }
  t_.push_back(1e-9 * static_cast<double>(row_ns_));
  cycles_.push_back(row_cycle_);
  values_.insert(values_.end(), row_.begin(), row_.end());
  if (t_.size() >= most_) thin();
}

// Keeps every second row, from the first one on.
void LogTable::thin() {
  std::size_t kept = 0;
  for (std::size_t row = 0; row < t_.size(); row += 2, ++kept) {
    t_[kept] = t_[row];
    cycles_[kept] = cycles_[row];
    std::copy_n(values_.begin() + static_cast<std::ptrdiff_t>(row * width_), width_,
                values_.begin() + static_cast<std::ptrdiff_t>(kept * width_));
  }
  t_.resize(kept);
  cycles_.resize(kept);
  values_.resize(kept * width_);
  // Kept rows have twice the spacing; so do all later rows.
  every_ *= 2;
}

void LogTable::put(const Arm& of, const std::string& field, const std::vector<double>& values) {
  const auto& [at, most] = of.at.at(field);
  put(at, values, most);
}

void LogTable::put_quantities(const Arm& of, const auto& message) {
  for_each_number(message,
                  [&](const char* name, const std::vector<double>& numbers) { put(of, name, numbers); });
}

void LogTable::put_output(const std::string& instance, const std::string& output,
                          const std::vector<double>& values) {
  const auto place = places_.find(instance + "/outputs/" + output);
  if (place != places_.end()) put(place->second.first, values, place->second.second);
}

void LogTable::take_numbers(const McapReader::Message& message) {
  if (holds<msg::ArmState>(*message.schema)) {
    const auto state = from_cdr<msg::ArmState>(message.data);
    const Arm& of = arm(state.arm);
    row_cycle_ = static_cast<double>(state.cycle);
    put_quantities(of, state);
  } else if (holds<msg::ArmCommand>(*message.schema)) {
    const auto command = from_cdr<msg::ArmCommand>(message.data);
    const Arm& of = arm(command.arm);
    const auto owner = owner_of_.find(command.owner);
    if (owner != owner_of_.end()) put(of, "owner", {static_cast<double>(owner->second)});
    put_quantities(of, command);
  } else if (holds<msg::ArmWrench>(*message.schema)) {
    const auto wrench = from_cdr<msg::ArmWrench>(message.data);
    const Arm& of = arm(wrench.arm);
    if (wrench.has_estimate) put(of, "wrench_n_nm", numbers_of(wrench.estimated));
    put_quantities(of, wrench);
  } else if (holds<msg::Reference>(*message.schema)) {
    const auto reference = from_cdr<msg::Reference>(message.data);
    const auto place = places_.find(reference.instance + "/" + reference.input);
    if (place != places_.end()) put(place->second.first, reference.value, place->second.second);
  } else if (holds<msg::ControlletOutput>(*message.schema)) {
    const auto output = from_cdr<msg::ControlletOutput>(message.data);
    put_output(output.instance, output.name, output.values);
  } else if (holds<msg::ControlletOutputs>(*message.schema)) {
    const auto message_of = from_cdr<msg::ControlletOutputs>(message.data);
    for (const auto& output : message_of.outputs) put_output(message_of.instance, output.name, output.values);
  } else {
    const auto timing = from_cdr<msg::CycleTiming>(message.data);
    constexpr double kNs = 1e9;
    put(places_.at("period_s").first, timing.period);
    put(places_.at("overruns").first, static_cast<double>(timing.overruns));
    for (const auto& [field, duration] : {std::pair{"read_ns", timing.read},
                                          {"controllets_ns", timing.controllets},
                                          {"features_ns", timing.features},
                                          {"safety_ns", timing.safety},
                                          {"write_ns", timing.write},
                                          {"total_ns", timing.total}})
      put(places_.at(field).first, kNs * duration);
  }
}

// --- events ---

void LogTable::add_event(std::uint64_t cycle, double t, const std::string& kind, const std::string& arm,
                         const std::string& text) {
  if (events_.size() < kMostEvents)
    events_.push_back({{"cycle", cycle}, {"t_s", t}, {"kind", kind}, {"arm", arm}, {"text", text}});
}

void LogTable::take_event(const McapReader::Message& message) {
  if (holds<msg::Switch>(*message.schema)) {
    const auto change = from_cdr<msg::Switch>(message.data);
    add_event(change.cycle, seconds_of(change.stamp), change.accepted ? "switched" : "switch_refused", "",
              change.text);
  } else if (holds<msg::Intervention>(*message.schema)) {
    const auto act = from_cdr<msg::Intervention>(message.data);
    add_event(act.cycle, seconds_of(act.stamp), "intervention", act.arm, act.code);
  } else if (holds<msg::Event>(*message.schema)) {
    const auto event = from_cdr<msg::Event>(message.data);
    for (const auto& name : event.arms) {
      if (event.kind == "stopped" || event.kind == "resumed") arm(name).stopped = event.kind == "stopped";
    }
    add_event(event.cycle, seconds_of(event.stamp), event.kind,
              event.arms.size() == 1 ? event.arms.front() : "", event.text);
  } else if (holds<msg::ArmConfig>(*message.schema)) {
    const auto config = from_cdr<msg::ArmConfig>(message.data);
    Arm& of = arm(config.arm);
    of.frames = {pose_of(config.end_effector), pose_of(config.stiffness)};
    of.changes.emplace_back(seconds_of(config.stamp), of.frames);
  }
}

// --- rows ---

std::size_t LogTable::row_at(double t_s) const {
  const auto after = std::ranges::upper_bound(t_, t_s);
  return after == t_.begin() ? 0 : static_cast<std::size_t>(after - t_.begin()) - 1;
}

double LogTable::value(std::size_t row, const RecordReader::Field& field, std::size_t k) const {
  if (field.name == "t_ns") return 1e9 * t_[row];
  if (field.name == "cycle") return cycles_[row];
  return values_[row * width_ + field.offset / 8 + k];
}

RecordReader::Record LogTable::record(std::size_t row) const {
  RecordReader::Record record(8 * width_);
  for (const auto& field : fields_) {
    for (std::size_t k = 0; k < field.count; ++k) {
      const double number = value(row, field, k);
      std::memcpy(record.data() + field.offset + 8 * k, &number, sizeof(number));
    }
  }
  return record;
}

std::vector<std::optional<Pose>> LogTable::objects(std::size_t row) const {
  std::vector<std::optional<Pose>> all;
  for (const SceneObject& object : scene_.objects) {
    auto& X_WO = all.emplace_back();
    const auto found = objects_.find(object.name);
    if (found == objects_.end()) continue;
    std::array<double, 7> v{};
    for (std::size_t k = 0; k < v.size(); ++k) v[k] = values_[row * width_ + found->second.at + k];
    if (std::isfinite(v[0]))
      X_WO = Pose::from({v[0], v[1], v[2]}, Quaternion(v[3], v[4], v[5], v[6]).normalized());
  }
  return all;
}

std::vector<ArmFrames> LogTable::frames(std::size_t row) const {
  std::vector<ArmFrames> all;
  for (const SceneArm& arm : scene_.arms) {
    const auto& changes = arms_.at(arm.name).changes;
    const auto after =
        std::ranges::upper_bound(changes, t_[row], {}, [](const auto& change) { return change.first; });
    all.push_back(after == changes.begin() ? changes.front().second : std::prev(after)->second);
  }
  return all;
}

}  // namespace multipanda::cockpit
