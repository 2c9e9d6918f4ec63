#include <algorithm>
#include <set>

#include "core/reference/harmonic.hpp"
#include "scene/load_parts.hpp"
#include "scene/names.hpp"
#include "scene/schema.hpp"

namespace multipanda {
namespace {

// Which keys of a reference carry which quantity.
struct ReferenceKeys {
  Quantity quantity;
  std::vector<std::string> keys;
  const char* expected;
};
const std::vector<ReferenceKeys>& reference_keys() {
  static const std::vector<ReferenceKeys> table{
      {Quantity::pose,
       {"position_m", "rpy_rad", "quaternion_wxyz"},
       "position_m [m] with rpy_rad [rad] or quaternion_wxyz"},
      {Quantity::twist,
       {"linear_m_per_s", "angular_rad_per_s"},
       "linear_m_per_s [m/s] and/or angular_rad_per_s [rad/s]"},
      {Quantity::wrench, {"force_n", "torque_nm"}, "force_n [N] and/or torque_nm [N m]"},
      {Quantity::joints, {"q_rad"}, "q_rad [rad], one number per joint"},
      {Quantity::scalar, {"value"}, "value, one number"}};
  return table;
}

std::vector<double> pose_values(const Mapping& mapping) {
  if (!mapping.has("position_m") || (!mapping.has("rpy_rad") && !mapping.has("quaternion_wxyz"))) {
    mapping.self().refuse("a pose needs position_m [m] and rpy_rad [rad] or quaternion_wxyz");
  }
  const Pose X = read_pose(mapping);
  const Quaternion q = X.quaternion();
  return {X.position.x(), X.position.y(), X.position.z(), q.w(), q.x(), q.y(), q.z()};
}

std::vector<double> reference_values(const Mapping& mapping, const InputSpec& input,
                                     std::size_t joint_count) {
  for (const auto& row : reference_keys()) {
    const auto present = mapping.present(row.keys);
    if (row.quantity == input.quantity && present.empty()) {
      mapping.self().refuse("input '" + input.name + "' carries a " + std::string(to_string(row.quantity)) +
                            ": expected " + row.expected);
    }
    if (row.quantity == input.quantity || present.empty()) continue;
    const auto right = std::find_if(reference_keys().begin(), reference_keys().end(),
                                    [&](const auto& r) { return r.quantity == input.quantity; });
    mapping.entry(present[0])
        .refuse("input '" + input.name + "' carries a " + std::string(to_string(input.quantity)) +
                ": expected " + right->expected);
  }
  const auto pair = [&](const char* first, const char* second) {
    std::vector<double> values(6, 0.0);
    std::size_t offset = 0;
    for (const char* key : {first, second}) {
      const auto half = mapping.has(key) ? mapping.numbers(key, 3) : std::vector<double>(3, 0.0);
      std::copy(half.begin(), half.end(), values.begin() + static_cast<std::ptrdiff_t>(offset));
      offset += 3;
    }
    return values;
  };
  switch (input.quantity) {
    case Quantity::pose:
      return pose_values(mapping);
    case Quantity::twist:
      return pair("linear_m_per_s", "angular_rad_per_s");
    case Quantity::wrench:
      return pair("force_n", "torque_nm");
    case Quantity::joints:
      return mapping.numbers("q_rad", joint_count);
    case Quantity::scalar:
      break;
  }
  return {mapping.number("value")};
}

std::vector<double> motion_numbers(const Mapping& mapping, const std::string& key, std::size_t count) {
  return mapping.has(key) ? mapping.numbers(key, count) : std::vector<double>(count, 0.0);
}

// Reads one event; `active_` follows what would run at its time, so that a reference to a controllet that is
// not running is found here and not in the middle of a run.
class TimelineReader {
 public:
  explicit TimelineReader(SceneReader& reader) : reader_(reader) {
    for (const auto& name : reader.scene.active) active_.insert(name);
  }

  TimelineEvent read(const Mapping& mapping) {
    TimelineEvent event;
    event.at_s = mapping.number("at_s");
    event.place = mapping.self().place();
    const auto what =
        mapping.present({"switch", "parameter", "feature", "reference", "motion", "place", "stop", "resume"});
    if (what.size() != 1) {
      mapping.self().refuse(
          "expected exactly one of switch, parameter, feature, reference, motion, place, stop, resume, "
          "found " +
          (what.empty() ? "none" : joined(what, " and ")));
    }
    if (what[0] == "switch") read_switch(mapping.section("switch"), event);
    if (what[0] == "parameter") read_set_parameter(mapping.section("parameter"), event);
    if (what[0] == "feature") read_set_feature(mapping.section("feature"), event);
    if (what[0] == "reference") read_reference(mapping.section("reference"), event);
    if (what[0] == "motion") read_motion(mapping.section("motion"), event);
    if (what[0] == "place") read_place(mapping.section("place"), event);
    if (what[0] == "stop") read_arms(mapping, "stop", TimelineEvent::What::stop, event);
    if (what[0] == "resume") read_arms(mapping, "resume", TimelineEvent::What::resume, event);
    return event;
  }

 private:
  const InstanceConfig& instance(const Mapping& mapping) {
    (void)mapping.text("controllet");
    return reader_.instance(mapping.entry("controllet"));
  }

  const InstanceConfig& config(const std::string& name) const {
    for (const auto* list : {&reader_.scene.controllets, &reader_.holds}) {
      for (const auto& candidate : *list) {
        if (candidate.name == name) return candidate;
      }
    }
    throw std::logic_error("unknown controllet '" + name + "'");
  }

  void release(ArmSet arms) {
    std::erase_if(active_, [&](const auto& name) { return arms_of(config(name)).overlaps(arms); });
  }

  void read_switch(const Mapping& mapping, TimelineEvent& event) {
    event.what = TimelineEvent::What::switch_controllets;
    const auto starting = read_owners(reader_, mapping.text_items("activate"));
    for (const InstanceConfig* started : starting) {
      const bool hold = started->name == reader_.scene.arms[started->arms[0]].name + "_hold";
      if (const ArmSet stopped = arms_of(*started) & stopped_; !stopped.empty() && !hold) {
        mapping.entry("activate")
            .refuse("arm '" + reader_.scene.arms[stopped.first()].name +
                    "' is stopped at that time; expected a 'resume' event before '" + started->name +
                    "' takes it");
      }
      event.activate.push_back(started->name);
    }
    for (const auto& name : mapping.text_items("deactivate")) {
      const std::string& stopping = reader_.instance(name).name;
      if (std::find(event.activate.begin(), event.activate.end(), stopping) != event.activate.end()) {
        name.refuse(in_quotes(stopping) + " is in activate and in deactivate");
      }
      event.deactivate.push_back(stopping);
    }
    event.only = mapping.boolean("only");
    if (event.activate.empty() && event.deactivate.empty() && !event.only) {
      mapping.self().refuse(
          "switches nothing; expected 'activate' or 'deactivate' with names of controllets");
    }
    if (event.only) active_.clear();
    for (const auto& name : event.deactivate) active_.erase(name);
    for (const InstanceConfig* started : starting) release(arms_of(*started));
    for (const auto& name : event.activate) active_.insert(name);
  }

  void read_set_parameter(const Mapping& mapping, TimelineEvent& event) {
    event.what = TimelineEvent::What::set_parameter;
    const InstanceConfig& target = instance(mapping);
    event.controllet = target.name;
    event.name = mapping.text("name");
    const ParameterSpec& spec = find_parameter(reader_, target, mapping.entry("name"), event.name);
    event.values = read_parameter(mapping.entry("value"), spec, reader_.joint_count(target));
  }

  void read_set_feature(const Mapping& mapping, TimelineEvent& event) {
    event.what = TimelineEvent::What::set_feature;
    const InstanceConfig& target = instance(mapping);
    event.controllet = target.name;
    event.name = mapping.text("name");
    check_feature(reader_, target, mapping.entry("name"));
    event.on = mapping.boolean("on");
  }

  void read_reference(const Mapping& mapping, TimelineEvent& event) {
    event.what = TimelineEvent::What::set_reference;
    const InputSpec& input = read_input(mapping, event);
    const InstanceConfig& target = config(event.controllet);
    event.values = reference_values(mapping, input, reader_.joint_count(target, input.arm));
    event.duration_s = mapping.number("duration_s");
  }

  void read_motion(const Mapping& mapping, TimelineEvent& event) {
    event.what = TimelineEvent::What::set_motion;
    const InputSpec& input = read_input(mapping, event);
    const std::size_t count =
        motion_count(input.quantity, reader_.joint_count(config(event.controllet), input.arm));
    if (mapping.present({"sine", "rise", "overtones"}).empty()) {
      mapping.self().refuse("moves nothing; expected 'sine' or 'rise' with " + std::to_string(count) +
                            " numbers");
    }
    event.sine = motion_numbers(mapping, "sine", count);
    event.rise = motion_numbers(mapping, "rise", count);
    for (const auto& item : mapping.items("overtones")) {
      const Mapping part(item, schema::overtone());
      if (event.overtones.size() == kMaxOvertones) {
        item.refuse("is one too many; expected at most " + std::to_string(kMaxOvertones) + " overtones");
      }
      event.overtones.push_back({motion_numbers(part, "sine", count), motion_numbers(part, "rise", count)});
    }
    event.period_s = mapping.number("period_s");
    event.cycles = mapping.number("cycles");
    event.ramp_s = mapping.number("ramp_s");
    if (event.ramp_s > event.period_s * event.cycles) {
      mapping.entry("ramp_s").expected("at most period_s * cycles");
    }
    Harmonic motion{.period_s = event.period_s};
    std::copy(event.sine.begin(), event.sine.end(), motion.sine.begin());
    std::copy(event.rise.begin(), event.rise.end(), motion.rise.begin());
    for (const auto& part : event.overtones) {
      Overtone& overtone = motion.overtones[motion.overtone_count++];
      std::copy(part.sine.begin(), part.sine.end(), overtone.sine.begin());
      std::copy(part.rise.begin(), part.rise.end(), overtone.rise.begin());
    }
    double fastest = 0;
    if (input.quantity == Quantity::pose) {
      fastest = motion.top_speed(0, 3);
    } else {
      for (std::size_t i = 0; i < count; ++i) fastest = std::max(fastest, motion.top_speed(i, 1));
    }
    double allowed = input.max_speed;
    for (const auto& change : config(event.controllet).inputs) {
      if (change.name == input.name) allowed = change.max_speed;
    }
    if (fastest > allowed) {
      mapping.self().refuse("the motion is as fast as " + number_text(fastest) + " per second, input '" +
                            input.name + "' allows " + number_text(allowed) +
                            "; expected a longer period_s, or a higher limit under the controllet's inputs");
    }
  }

  // The input that an event names, of a controllet that runs then.
  const InputSpec& read_input(const Mapping& mapping, TimelineEvent& event) {
    const InstanceConfig& target = instance(mapping);
    event.controllet = target.name;
    event.name = mapping.text("input");
    const auto& inputs = reader_.registry.controllet(target.type)->statement.inputs;
    const auto input =
        std::find_if(inputs.begin(), inputs.end(), [&](const auto& spec) { return spec.name == event.name; });
    if (input == inputs.end()) {
      std::vector<std::string> valid;
      for (const auto& spec : inputs) valid.push_back(spec.name);
      mapping.entry("input").refuse("'" + target.type + "' has no input " + in_quotes(event.name) +
                                    name_hint(event.name, valid, "it has none"));
    }
    if (!active_.contains(target.name)) {
      mapping.entry("controllet")
          .refuse("'" + target.name +
                  "' does not run at that time; expected it in 'active' or a switch before");
    }
    return *input;
  }

  void read_place(const Mapping& mapping, TimelineEvent& event) {
    event.what = TimelineEvent::What::place;
    event.object = mapping.text("object");
    std::vector<std::string> names;
    for (const auto& object : reader_.scene.objects) {
      names.push_back(object.name);
      if (object.name != event.object) continue;
      event.X_WO = read_pose(mapping);
      if (mapping.present({"rpy_rad", "quaternion_wxyz"}).empty()) event.X_WO.rotation = object.X_WO.rotation;
      return;
    }
    mapping.entry("object").refuse("there is no object " + in_quotes(event.object) +
                                   name_hint(event.object, names, "there are no objects"));
  }

  void read_arms(const Mapping& mapping, const std::string& key, TimelineEvent::What what,
                 TimelineEvent& event) {
    event.what = what;
    ArmSet arms;
    if (!mapping.entry(key).is_word({"all"})) {
      for (const auto& name : mapping.text_items(key)) {
        arms |= ArmSet::of(reader_.arm(name));
        event.arms.push_back(name.node().Scalar());
      }
      if (event.arms.empty()) mapping.entry(key).expected("'all' or a list of arms");
    } else {
      arms = ArmSet::all(reader_.scene.arms.size());
    }
    if (what == TimelineEvent::What::stop) {
      release(arms);
      stopped_ |= arms;
    } else {
      stopped_ = stopped_ - arms;
    }
  }

  SceneReader& reader_;
  std::set<std::string> active_;  // the built-in holds left out, unless named
  ArmSet stopped_;
};

}  // namespace

void read_timeline(const Mapping& root, SceneReader& reader) {
  std::vector<std::pair<double, Mapping>> events;
  std::size_t number = 0;
  for (const auto& item : root.items("timeline")) {
    Mapping mapping(item.as("event " + std::to_string(++number)), schema::event());
    events.emplace_back(mapping.number("at_s"), mapping);
  }
  std::vector<std::size_t> order(events.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(),
                   [&](auto a, auto b) { return events[a].first < events[b].first; });
  TimelineReader timeline(reader);
  for (const std::size_t i : order) reader.scene.timeline.push_back(timeline.read(events[i].second));
}

}  // namespace multipanda
